"""Combinations that make no sense are refused, with what and why."""

from __future__ import annotations

from dataclasses import replace

import pytest
from support.hard_cases import CASES, SIZE
from support.lens_scenes import with_lens

import mbinterval as mb
from mbinterval.device.sources import kernel_root
from mbinterval.plan.stochastic_plan import SLABS

WRONG = [
    ({"cull": "hull"}, "cull='hull' with method='analytic': it is for method='stochastic'"),
    ({"slices": 8}, "it is for method='accumulation'"),
    ({"method": "stochastic", "occlusion": 128}, "it is for method='analytic'"),
    ({"method": "stochastic", "tile_size": 8}, "it is for method='analytic'"),
    ({"method": "stochastic", "slices": 3}, "it is for method='accumulation'"),
    ({"method": "stochastic", "cull": "box"}, "'best', 'bbox'"),
    ({"method": "stochastic", "test": "guess"}, "'vertices', 'edges'"),
    ({"method": "stochastic", "shading_rate": "line"}, "'sample', 'pixel'"),
    ({"method": "stochastic", "samples": 4097}, "4096"),
    ({"pattern": "rgss"}, "that has 'fixed', 'sobol'"),
    ({"method": "stochastic", "pattern": "rgss", "samples": 8}, "the rotated grid has 4"),
    ({"method": "stochastic", "pattern": "rgss", "filter": "gaussian"}, "a filter of its own"),
    ({"method": "stochastic", "cull": "interleave_uvt"}, "it is for pattern='interleave_uvt'"),
    ({"method": "stochastic", "cull_tile": 2}, "tiles of its own"),
    ({"method": "stochastic", "cull": "hull", "cull_tile": 17}, "16"),
    ({"method": "stochastic", "hybrid": True, "shading_rate": "pixel"}, "nothing is left to it"),
    ({"method": "stochastic", "frameless": 65}, "64"),
    ({"method": "accumulation", "frameless": 4}, "it is for method='stochastic'"),
    ({"method": "accumulation", "pattern": "sobol"}, "slice_times='stochastic'"),
    ({"method": "accumulation", "slices": 4096, "samples": 64}, "at most 65536"),
    ({"samples": 300}, "that has 1 to 256"),
    ({"method": "stochastic", "filter": "five_point", "samples": 1}, "for method='analytic'"),
    ({"method": "stochastic", "slice_lens": "line"}, "it is for method='accumulation'"),
    ({"slice_lens": "line"}, "it is for method='accumulation'"),
    ({"method": "accumulation", "slice_times": "now"}, "'uniform', 'jittered', 'stochastic'"),
]


@pytest.mark.parametrize(("values", "words"), WRONG)
def test_refused(values, words):
    with pytest.raises(mb.UsageError) as caught:
        mb.Settings(**values)
    assert words in str(caught.value)


@pytest.mark.parametrize(("values", "words"), [({"pattern": "rgss"}, "rgss"),
                                               ({"test": "edges"}, "edges")])  # fmt: skip
def test_without_a_lens_only(values, words):
    of = CASES["shared edges"].make()
    settings = mb.Settings(method="stochastic", **values)
    mb.render(of, width=SIZE[0], height=SIZE[1], settings=settings)
    with pytest.raises(mb.UsageError, match=words):
        mb.render(with_lens(of), width=SIZE[0], height=SIZE[1], settings=settings)


def test_every_choice_that_is_given_is_in_the_plan():
    from support.kernels import ready_for

    for values, macro in (
        ({}, "-DMB_CULL_BEST"),
        ({"cull": "pixar", "samples": 16}, "-DSTRATA=16"),
        ({"pattern": "jittered", "samples": 12}, "-DMB_PATTERN_JITTERED"),
        ({"test": "edges"}, "-DMB_TEST_EDGES"),
        ({"statistics": True}, "-DMB_STATISTICS"),
        ({"frameless": 4}, "-DMB_FRAMELESS"),
    ):
        settings = mb.Settings(method="stochastic", **values)
        plan = ready_for(CASES["shared edges"].make(), settings, *SIZE).plan
        assert macro in plan.options
        assert dict(plan.numbers)["columns"] == {4: 2, 12: 3, 16: 4}[settings.samples]
        plain = ready_for(CASES["shared edges"].make(), replace(settings, cull="bbox"), *SIZE).plan
        assert "-DMB_LENS" not in plain.options
        assert "-DMB_PHONG" not in plain.options


def test_the_kernels_have_room_for_the_samples_that_a_plan_has_them_work_on():
    header = (kernel_root() / "stochastic" / "tile_of_slabs.h").read_text(encoding="utf-8")
    assert f"#define MOST_SLABS {SLABS} " in header


def test_nothing_at_all_is_the_background():
    for method in ("stochastic", "accumulation"):
        of = replace(CASES["shared edges"].make(), meshes=[])
        film = mb.render(of, width=20, height=10, settings=mb.Settings(method=method))
        assert (film.rgba[..., 3] == 0).all()
        assert film.rgba[0, 0, :3] == pytest.approx(of.background)
