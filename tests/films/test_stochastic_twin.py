"""Films of point samples against the float64 twin's at the same samples."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from reference.point_samples import nearest_paths
from support.hard_cases import CASES, SIZE
from support.hard_cases import scene as scene_of
from support.kernels import ready_for
from support.lens_scenes import with_lens
from support.nightly import nightly
from support.point_samples import drawn_in_frame, twin_film

import mbinterval as mb
from mbinterval.exposure.exposure import expose
from mbinterval.scene.model import Material, Scene

SLOW = ("a thousand intervals on a pixel",)
FLAT = ("huge scale", "tiny scale")
"""A lens has a size of its own."""


def films(of: Scene, **values: object) -> tuple[np.ndarray, np.ndarray]:
    """The kernels' film and the twin's."""
    settings = mb.Settings(method="stochastic", **values)
    ready = ready_for(of, settings, *SIZE)
    exposure, plan = ready.exposure, ready.plan
    found = mb.render(of, width=SIZE[0], height=SIZE[1], settings=settings).rgba
    return found, twin_film(plan, exposure, *SIZE)[0]


HARD = [(name, lens) for name in CASES for lens in (False, True)
        if name not in SLOW and not (lens and name in FLAT)]  # fmt: skip


@pytest.mark.parametrize(("name", "lens"), HARD)
def test_every_hard_case_is_the_twins(name, lens):
    of = CASES[name].make()
    found, want = films(with_lens(of) if lens else of, samples=8)
    differ = np.abs(found - want).max(axis=-1) > 1e-5
    assert differ.mean() < 2e-3, int(differ.sum())
    late = replace(of, meshes=[
        replace(m, positions=m.positions + 0.1 * (m.positions[-1] - m.positions[0]))
        for m in of.meshes])  # fmt: skip
    settings = mb.Settings(method="stochastic", samples=8)
    late = with_lens(late) if lens else late
    moved = mb.render(late, width=SIZE[0], height=SIZE[1], settings=settings).rgba
    if name not in ("nearly zero motion", "small motion", "through the eye"):
        assert (np.abs(moved - want).max(axis=-1) > 1e-5).mean() > 5e-3


@pytest.mark.parametrize(
    ("pattern", "samples", "lens"),
    [
        *(("sobol", 7, False), ("jittered", 3, False), ("random", 7, True)),
        *(("fixed", 64, False), ("interleave_uvt", 1, True)),
        *(nightly("sobol", 100, True), nightly("jittered", 64, True)),
        *(nightly("interleave_uvt", 7, False),),
        *(nightly("sobol", 1, True), nightly("interleave_uvt", 100, True)),
        *(nightly("jittered", 1, True), nightly("jittered", 7, True)),
        *(nightly("jittered", 100, False), nightly("random", 1, False)),
        *(nightly("random", 100, False), nightly("fixed", 1, False)),
        *(nightly("fixed", 3, True), nightly("fixed", 100, True)),
    ],
)
def test_every_pattern_and_count(pattern, samples, lens):
    of = CASES["interpenetrating meshes"].make()
    found, want = films(with_lens(of) if lens else of, pattern=pattern, samples=samples)
    assert (np.abs(found - want).max(axis=-1) > 1e-5).mean() < 5e-3


def test_edge_functions_over_time_see_the_same():
    for name in ("shared edges", "pivoting edges", "through the camera plane", "needles"):
        found, want = films(CASES[name].make(), samples=16, test="edges")
        assert (np.abs(found - want).max(axis=-1) > 1e-5).mean() < 5e-3


def test_one_sided_triangles_show_their_front_only():
    of = CASES["interpenetrating meshes"].make()
    material = Material(shading="unlit", double_sided=False)
    one = replace(of, meshes=[replace(m, material=material) for m in of.meshes])
    for each in (one, with_lens(one)):
        found, want = films(each, samples=16)
        assert (np.abs(found - want).max(axis=-1) > 1e-5).mean() < 2e-3
    assert np.abs(films(one, samples=16)[0] - films(of, samples=16)[0]).max() > 0.1


def test_motion_segments_and_static_meshes_together():
    moving = CASES["a way that leaves the hull of its ends"].make().meshes[0]
    still = CASES["interpenetrating meshes"].make().meshes[0]
    still = replace(still, positions=still.positions[0])
    of = scene_of(moving, still)
    found, want = films(of, samples=36)
    assert (np.abs(found - want).max(axis=-1) > 1e-5).mean() < 2e-3


def test_depth_is_the_mean_of_what_is_seen():
    of = CASES["order that swaps twice"].make()
    settings = mb.Settings(method="stochastic", samples=16)
    ready = ready_for(of, settings, *SIZE)
    exposure, plan = ready.exposure, ready.plan
    drawn = drawn_in_frame(plan, exposure, *SIZE)
    path, _, depth = nearest_paths(expose(of, 1.0, SIZE[0] / SIZE[1]), *SIZE, drawn)
    seen = path >= 0
    want = np.where(seen, depth, 0.0).sum(axis=0) / np.maximum(seen.sum(axis=0), 1)
    film = mb.render(of, width=SIZE[0], height=SIZE[1], settings=settings)
    ok = seen.any(axis=0)
    assert np.abs(film.depth / np.where(ok, want, np.inf) - 1)[ok].max() < 1e-3
    assert np.array_equal(film.intervals, seen.sum(axis=0))
