"""The stochastic kernels: built without a warning, and a witness of their own."""

from __future__ import annotations

import logging
import re

import pytest
from support.hard_cases import CASES, SIZE
from support.kernels import builds_without, ready_for, warns
from support.lens_scenes import with_lens
from support.oclgrind_scenes import SCENES as SMALL
from support.oclgrind_scenes import ready_for as small_ready

import mbinterval as mb
from mbinterval.device.sources import kernel_root
from mbinterval.settings.rules import CULLS

TILE = "stochastic/tile.cl"
POINTS = [name for name, small in SMALL.items() if "method" in small.settings]


@pytest.mark.parametrize("name", POINTS)
def test_kernels_build_without_a_warning(name, caplog):
    plan = small_ready(SMALL[name]).plan
    assert not warns(TILE, plan.options)
    if "rgss" in plan.stages:
        assert not warns("stochastic/rgss.cl", plan.options)
    assert not [record for record in caplog.records if record.levelno >= logging.WARNING]


@pytest.mark.parametrize("cull", CULLS)
def test_every_culling_method_builds_without_a_lens(cull):
    """Those with one are among the small scenes."""
    pattern = "interleave_uvt" if cull == "interleave_uvt" else "sobol"
    settings = mb.Settings(method="stochastic", cull=cull, pattern=pattern)
    assert not warns(TILE, ready_for(CASES["shared edges"].make(), settings, *SIZE).plan.options)


def test_nothing_of_roots_or_intervals_is_shared():
    """The witness includes no file of the analytic path, nor what finds roots."""
    seen, waiting = set(), ["stochastic/tile.cl", "stochastic/bounds.cl", "stochastic/bin.cl"]
    waiting += ["stochastic/rgss.cl", "shared/vertices.cl", "shared/scan.cl"]
    waiting += [f"stochastic/cull/{p.name}" for p in (kernel_root() / "stochastic/cull").iterdir()]
    while waiting:
        file = waiting.pop()
        if file not in seen:
            seen.add(file)
            text = (kernel_root() / file).read_text(encoding="utf-8")
            waiting += re.findall(r'#include "([^"]+)"', text)
    assert not [file for file in seen if file.startswith("analytic")]
    assert not seen & {"shared/bernstein.h", "shared/quintic.h"}
    assert "stochastic/cull/dual_space.h" in seen


def test_what_is_not_asked_for_leaves_no_code():
    settings = mb.Settings(method="stochastic")
    of = CASES["shared edges"].make()

    pinhole, lens = (ready_for(each, settings, *SIZE).plan for each in (of, with_lens(of)))
    assert builds_without(pinhole, ("texture_at", "phong"), "shared/shading.h", TILE)
    assert builds_without(pinhole, ("lens_point", "rank_samples"), "shared/lanes.h", TILE)
    assert not builds_without(lens, ("lens_point",), "shared/lanes.h", TILE)
