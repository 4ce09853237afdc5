"""A small render starts at once: next to what else a process does, in processor seconds.

Other processes don't count in those, and how fast the machine is does not in their ratios.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from mbinterval.device.choose import choose_device

ROOT = Path(__file__).resolve().parents[2]
SCENE = """
[camera]
position = [0, 0, 5]
look_at = [0, 0, 0]

[[objects]]
primitive = { kind = "box", size = [1, 1, 1] }
transform.keys = [
  { frame = 0, translation = [-1, 0, 0] },
  { frame = 2, translation = [1, 0.5, 0], euler = [30, 40, 0] },
]
"""


def processor_seconds(*arguments: str, **environment: str) -> float:
    """User and system seconds that ``python ARGUMENTS`` takes; it must succeed."""
    path = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    process = subprocess.Popen(
        [sys.executable, *arguments], env=os.environ | {"PYTHONPATH": path} | environment
    )
    _, status, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    assert process.returncode == 0
    return used.ru_utime + used.ru_stime


def importing(names: str) -> float:
    return min(processor_seconds("-c", f"import {names}") for _ in range(3))


def test_importing_is_quick_and_loads_nothing_large():
    code = """if True:
        import sys, mbinterval, mbinterval.cli
        large = {"numpy", "pyopencl", "trimesh", "pydantic", "OpenEXR", "PIL"} & sys.modules.keys()
        assert not large, large
    """
    processor_seconds("-c", code)
    assert importing("mbinterval, mbinterval.cli") < 2 * importing("numpy")


def test_a_wrong_clock_would_be_noticed():
    assert processor_seconds("-c", "import time\nwhile time.process_time() < 0.5: pass") > 0.5


@pytest.fixture
def seconds_of_a_render(tmp_path):
    (tmp_path / "box.toml").write_text(SCENE)
    for name in ("kernels", "cache"):
        (tmp_path / name).mkdir()
    caches = {
        "POCL_CACHE_DIR": str(tmp_path / "kernels"),
        "XDG_CACHE_HOME": str(tmp_path / "cache"),
    }

    def render() -> float:
        output = tmp_path / "box.exr"
        options = ["--width", "320", "--height", "240", "-q", "-q", "-o", str(output)]
        command = ["-m", "mbinterval", "render", str(tmp_path / "box.toml"), *options]
        output.unlink(missing_ok=True)
        took = processor_seconds(*command, **caches)
        assert output.is_file()
        return took

    return render


def test_a_small_render_is_a_few_imports_and_building_kernels_is_done_once(seconds_of_a_render):
    """Other implementations than PoCL compile for longer, and may keep no kernels."""
    cold = seconds_of_a_render()
    warm = min(seconds_of_a_render() for _ in range(3))
    imports = importing("numpy, pyopencl, OpenEXR, pydantic")
    if "Portable Computing Language" in choose_device().platform.name:
        assert cold < 60 * imports  # 20 in 2026
        assert warm < 6 * imports  # 2
        assert warm < 0.5 * cold
    else:
        assert warm < 600 * imports
