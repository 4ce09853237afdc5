"""Accumulated slices: static pictures at their times, stochastic passes for curved motion, lines
across the lens.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from reference.accumulation import render as twin
from support.agreement import repeated, welch, with_small_lens
from support.culling_scenes import EXACT, random_scene
from support.hard_cases import CASES, SIZE
from support.kernels import ready_for
from support.lens_scenes import with_lens
from support.nightly import nightly, nightly_but
from support.point_samples import twin_film

import mbinterval as mb
from mbinterval.exposure.exposure import expose
from mbinterval.scene.model import Scene


def film(of: Scene, **values: object) -> np.ndarray:
    settings = mb.Settings(**{"method": "accumulation", "samples": 1} | values)
    return mb.render(of, width=SIZE[0], height=SIZE[1], settings=settings).rgba


def test_slices_are_the_twins():
    for name in ("shared edges", "pivoting edges", "through the camera plane"):
        of = CASES[name].make()
        want = twin(expose(of, 1.0, 1.5), *SIZE, slices=8).rgba
        found = film(of, slices=8, motion_segments=1)
        assert (np.abs(found - want).max(axis=-1) > 1e-5).mean() < 2e-3, name
        other = film(of, slices=7, motion_segments=1)
        assert (np.abs(other - want).max(axis=-1) > 1e-5).mean() > 0.05


def test_one_slice_is_the_middle_of_the_shutter_at_rest():
    of = CASES["interpenetrating meshes"].make()
    still = [replace(m, positions=m.positions.mean(axis=0)) for m in of.meshes]
    want = mb.render(replace(of, meshes=still), width=SIZE[0], height=SIZE[1],
                     settings=mb.Settings(samples=9)).rgba  # fmt: skip
    found = film(of, slices=1, samples=9)
    assert (np.abs(found - want).max(axis=-1) > 1e-5).mean() < 2e-3


def test_more_slices_come_closer():
    of = CASES["interpenetrating meshes"].make()
    truth = mb.render(of, width=SIZE[0], height=SIZE[1], settings=mb.Settings(samples=4)).rgba
    errors = [
        np.sqrt(np.mean((film(of, slices=n, samples=4) - truth) ** 2)) for n in (4, 16, 64, 256)
    ]
    assert all(b < 0.5 * a for a, b in pairwise(errors))
    jittered = film(of, slices=64, samples=4, slice_times="jittered")
    assert np.sqrt(np.mean((jittered - truth) ** 2)) < 3 * errors[2]
    assert not np.array_equal(jittered, film(of, slices=64, samples=4))


def test_stochastic_passes_follow_a_curve():
    of = CASES["a way that leaves the hull of its ends"].make()
    truth = mb.render(of, width=SIZE[0], height=SIZE[1], settings=mb.Settings(samples=16)).rgba
    passes = film(of, slices=8, samples=16, slice_times="stochastic")
    assert np.sqrt(np.mean((passes - truth) ** 2)) < 0.02
    same = mb.render(of, width=SIZE[0], height=SIZE[1],
                     settings=mb.Settings(method="stochastic", samples=128)).rgba  # fmt: skip
    assert np.array_equal(passes, same)
    ends = replace(of, meshes=[replace(of.meshes[0], positions=of.meshes[0].positions[::8])])
    straight = film(ends, slices=8, samples=16, slice_times="stochastic")
    assert np.sqrt(np.mean((straight - truth) ** 2)) > 0.03


LINES = {"slice_lens": "line"}


@pytest.mark.parametrize("times", ["stochastic", nightly("uniform")])
def test_lines_are_the_twins(times):
    """On the samples that the kernels draw, seen by brute force."""
    of = with_lens(CASES["interpenetrating meshes"].make())
    settings = mb.Settings(
        method="accumulation", slices=8, samples=4, slice_times=times, **LINES
    )  # fmt: skip
    ready = ready_for(of, settings, *SIZE)
    exposure, plan = ready.exposure, ready.plan
    want = twin_film(plan, exposure, *SIZE)[0]
    found = mb.render(of, width=SIZE[0], height=SIZE[1], settings=settings).rgba
    assert (np.abs(found - want).max(axis=-1) > 1e-5).mean() < 5e-3
    point = mb.render(
        of, width=SIZE[0], height=SIZE[1], settings=replace(settings, slice_lens="point")
    )
    assert (np.abs(point.rgba - want).max(axis=-1) > 1e-2).mean() > 0.2


def test_lines_have_the_mean_of_the_thin_lens_and_a_narrower_lens_has_not():
    """In motion, pixel by pixel, against exact time with the same places in every pixel."""
    of = with_small_lens(CASES["interpenetrating meshes"].make())
    lines = {"method": "accumulation", "slices": 16, "samples": 4, "slice_times": "jittered"}
    slices = repeated(of, 200, **lines, **LINES)
    exact = {"samples": 4, "pattern": "fixed"}
    t, bound = welch(slices, repeated(of, 100, **exact), (200, 100))
    assert np.isfinite(t).sum() > 1500
    assert np.nanmax(np.abs(t) / bound) < 1.0
    assert abs(np.nanstd(t) - 1.0) < 0.1
    narrow = replace(of, camera=replace(of.camera, f_stop=1.1 * of.camera.f_stop))
    t, bound = welch(slices, repeated(narrow, 100, **exact), (200, 100))
    assert np.nanmax(np.abs(t) / bound) > 1.0


def test_lines_are_nearer_than_as_many_points_where_slices_are_few():
    of = with_small_lens(CASES["interpenetrating meshes"].make())
    truth = film(of, slices=512, samples=4)

    def error(**values: object) -> float:
        films = [film(of, samples=4, seed=seed, **values) for seed in range(6)]
        return float(np.sqrt(np.mean([(found - truth) ** 2 for found in films])))

    for slices in (4, 8):
        assert error(slices=slices, **LINES) < 0.8 * error(slices=slices)


@pytest.mark.parametrize("cull", nightly_but(EXACT, "best"))
def test_every_culling_method_sees_the_same_through_lines(cull):
    values = {"slices": 16, "samples": 4, **LINES}
    boxed = film(random_scene(3), cull="bbox", **values)
    assert np.array_equal(film(random_scene(3), cull=cull, **values), boxed)
    assert not np.array_equal(film(random_scene(3), cull="bbox", seed=1, **values), boxed)


def test_a_pinhole_has_no_lines():
    of = CASES["interpenetrating meshes"].make()
    assert film(of, slices=4, **LINES).tobytes() == film(of, slices=4).tobytes()
    for values, lens, there in ((LINES, True, True), (LINES, False, False), ({}, True, False)):
        settings = mb.Settings(method="accumulation", **values)
        plan = ready_for(with_lens(of) if lens else of, settings, *SIZE).plan
        assert ("-DMB_SLICE_LINES" in plan.options) == there
