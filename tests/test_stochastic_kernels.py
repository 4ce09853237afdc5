"""The stochastic kernels: built without a warning, and a witness of their own."""

from __future__ import annotations

import logging
import os
import re

import pytest
from kernels import plan_of
from oclgrind_scenes import SCENES as SMALL
from oclgrind_scenes import plan_of as small_plan
from test_hard_cases import CASES, SIZE
from test_stochastic_twin import with_lens

import mbinterval as mb
from mbinterval.device.runtime import runtime
from mbinterval.device.sources import kernel_root
from mbinterval.errors import KernelBuildError
from mbinterval.settings import CULLS

POINTS = [name for name, small in SMALL.items() if "method" in small.settings]


def warns(options: tuple[str, ...], file: str = "stochastic/tile.cl") -> bool:
    import pyopencl as cl

    fresh = f"-DNOT_IN_ANY_CACHE={os.getpid()}"  # what comes from a cache has no log
    program = runtime()._build(f'#include "{file}"\n', file, (*options, fresh))
    log = program.get_build_info(runtime().device, cl.program_build_info.LOG)
    return "warning" in log.lower()  # some devices tell of each step


@pytest.mark.parametrize("name", POINTS)
def test_kernels_build_without_a_warning(name, caplog):
    plan = small_plan(SMALL[name])[2]
    assert not warns(plan.options)
    if "rgss" in plan.stages:
        assert not warns(plan.options, "stochastic/rgss.cl")
    assert not [record for record in caplog.records if record.levelno >= logging.WARNING]


@pytest.mark.parametrize("cull", CULLS)
def test_every_culling_method_builds_without_a_lens(cull):
    """Those with one are among the small scenes."""
    pattern = "interleave_uvt" if cull == "interleave_uvt" else "sobol"
    settings = mb.Settings(method="stochastic", cull=cull, pattern=pattern)
    assert not warns(plan_of(CASES["shared edges"].make(), settings, *SIZE)[2].options)


def test_nothing_of_roots_or_intervals_is_shared():
    """The witness includes no file of the analytic path, nor what finds roots."""
    seen, waiting = set(), ["stochastic/tile.cl", "stochastic/bounds.cl", "stochastic/bin.cl"]
    waiting += ["stochastic/rgss.cl", "shared/vertices.cl", "shared/scan.cl"]
    waiting += [f"stochastic/cull/{p.name}" for p in (kernel_root() / "stochastic/cull").iterdir()]
    while waiting:
        file = waiting.pop()
        if file not in seen:
            seen.add(file)
            text = (kernel_root() / file).read_text()
            waiting += re.findall(r'#include "([^"]+)"', text)
    assert not [file for file in seen if file.startswith("analytic")]
    assert not seen & {"shared/bernstein.h", "shared/quintic.h", "shared/wide.h"}
    assert "stochastic/cull/dual_space.h" in seen


def test_what_is_not_asked_for_leaves_no_code():
    settings = mb.Settings(method="stochastic")
    of = CASES["shared edges"].make()

    def builds_without(words: str, each: object, after: str) -> bool:
        plan = plan_of(each, settings, *SIZE)[2]
        source = f'#include "{after}"\n#pragma GCC poison {words}\n#include "stochastic/tile.cl"\n'
        try:
            runtime()._build(source, "stochastic/tile.cl", plan.options)
        except KernelBuildError as error:
            if "poisoned" not in str(error):
                raise
            return False
        return True

    assert builds_without("texture_at phong", of, "shared/shading.h")
    assert builds_without("lens_point rank_samples", of, "shared/lanes.h")
    assert not builds_without("lens_point", with_lens(of), "shared/lanes.h")
