"""Every kernel under Oclgrind: no access outside of buffers, no races, nothing read unwritten.

Oclgrind simulates an OpenCL device and checks each access. Its exit code says nothing, so its log
must be empty. It lives in an environment of its own, where it is the only device:

    python3 -m venv oclgrind && oclgrind/bin/pip install 'pyopencl[oclgrind]' numpy
    MB_OCLGRIND=$PWD/oclgrind/bin/python pytest -m oclgrind

Oclgrind takes by-value arguments of a kernel's second launch in a process for uninitialized. So
each scene has its own process, and scenes whose tiles are done again with larger pools, or whose
paths are listed for lights as well, are checked for all but uninitialized reads.
"""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import numpy as np
import pytest
from support import oclgrind_scenes
from support.nightly import nightly_but
from support.oclgrind_scenes import SCENES

pytestmark = pytest.mark.oclgrind
ROOT = Path(__file__).resolve().parents[2]

BROKEN = """
import sys
import numpy as np
import pyopencl as cl
source = '''
kernel void outside(global int *a) { a[4] = 1; }
kernel void unwritten(global int *a) { int b[2]; b[a[0] & 1] = 1; a[1] = b[(a[0] & 1) ^ 1]; }
kernel void race(global int *a) { a[0] = (int)get_global_id(0); }
'''
context = cl.create_some_context(interactive=False)
queue = cl.CommandQueue(context)
program = cl.Program(context, source).build(options=["-cl-opt-disable"])
buffer = cl.Buffer(context, cl.mem_flags.COPY_HOST_PTR, hostbuf=np.zeros(4, np.int32))
cl.Kernel(program, sys.argv[1])(queue, (2,), (1,), buffer)
queue.finish()
"""


@pytest.fixture(scope="module")
def python() -> str:
    """A Python whose pyopencl has Oclgrind as its only device."""
    given = os.environ.get("MB_OCLGRIND")
    assert given, "MB_OCLGRIND must name a Python with pip install 'pyopencl[oclgrind]' numpy"
    return given


def checked(python: str, folder: Path, *command: str, reads: bool = True) -> tuple[str, str]:
    """Oclgrind's log, and what the program said, of ``python command`` under all its checks."""
    log = folder / f"{command[-1].replace(' ', '-')}.log"
    environment = {
        name: value
        for name, value in os.environ.items()
        if not name.startswith(("OCLGRIND", "OCL_ICD", "PYOPENCL", "MBINTERVAL"))
    } | {
        "OCLGRIND_DATA_RACES": "1",
        "OCLGRIND_LOG": str(log),
        "OCLGRIND_FILMS": str(folder),
        "PYOPENCL_NO_CACHE": "1",
        "PYTHONPATH": str(ROOT),
    }
    if reads:
        environment["OCLGRIND_UNINITIALIZED"] = "1"
    done = subprocess.run(
        [python, *command], env=environment, capture_output=True, text=True, timeout=600,
        check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert log.exists(), "Oclgrind did not run"
    return log.read_text(), done.stdout + done.stderr


EACH_TIME = (
    *("exact", "exact, behind the eye", "mask", "lens, scattered", "layers, behind the eye"),
    *("recorded", "translucent, adaptive", "textures over footprints", "mirrors, glossy"),
    *("shadows", "static", "environment", "triangulated, exact occlusion", "five points"),
    *("triangulated, by depth", "triangulated, pools grow", "stochastic, filter"),
    *("stochastic, rotated grid", "stochastic, interleaved", "stochastic, edges"),
    *("stochastic, shadow map", "stochastic, glossy mirrors", "stochastic, environment"),
    *("culling, hull", "culling, dual_space", "culling, zmin_strata", "accumulation, lines"),
)
"""Every stage is in these, and every effect; at night more combinations, patterns and cullings."""


@pytest.mark.parametrize("name", nightly_but(SCENES, *EACH_TIME))
def test_kernels_run_clean_and_give_the_film_of_another_device(name, python, tmp_path):
    # It takes the samples' scratch for unwritten right after a plain store to it.
    again = "grow" in name or "shadow" in name
    reads = not again and "method" not in SCENES[name].settings
    log, _ = checked(
        python, tmp_path, str(ROOT / "tests/support/oclgrind_scenes.py"), name, reads=reads
    )
    assert log == ""
    other = np.load(tmp_path / f"{name}.npy")
    ours = oclgrind_scenes.render(name)
    assert np.isfinite(ours).all()
    # Without fused functions on the way, but with other sines, logarithms and powers.
    differ = np.abs(other - ours).max(axis=-1) > 1e-5
    # A point sample at an edge may fall to either side.
    assert differ.sum() <= (3 if "method" in SCENES[name].settings else 0)


@pytest.mark.parametrize(
    ("kernel", "words"),
    [("outside", "Invalid write"), ("unwritten", "Uninitialized"), ("race", "race")],
)
def test_what_is_wrong_is_reported(kernel, words, python, tmp_path):
    (tmp_path / "broken.py").write_text(BROKEN)
    log, _ = checked(python, tmp_path, str(tmp_path / "broken.py"), kernel)
    assert words in log


def test_the_scenes_run_every_stage():
    from mbinterval.device.sources import kernel_root

    seen = set()
    for name in EACH_TIME:
        seen |= set(oclgrind_scenes.ready_for(SCENES[name]).plan.stages)
    files = {path.stem for path in kernel_root().rglob("*.cl")}
    assert seen == files - {"tile", "scan", "copy"} | {"sample"}
