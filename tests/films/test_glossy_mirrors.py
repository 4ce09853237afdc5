"""Glossy mirrors: a closed form, rays of float64 whose mirrored directions vary, point samples."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.agreement import welch
from support.closed_forms import UNIT_CAMERA
from support.kernels import ready_for
from support.mirror_rays import Surface, sampled, scene
from support.mirror_scenes import LIGHTS, flying, mirror, plane, rms
from support.nightly import nightly

import mbinterval as mb
from mbinterval.scene.model import Camera, Material, Mesh, Scene

SIZE = (24, 16)
BATCHES, TIMES = 40, 16


def film(of: Scene, size: tuple[int, int] = SIZE, **settings: object) -> np.ndarray:
    values = {"samples": 16, "motion_segments": 1} | settings
    settings = mb.Settings(**values)
    return mb.render(of, width=size[0], height=size[1], settings=settings).rgba.astype(float)


def segment(u: np.ndarray) -> np.ndarray:
    """Share of the unit disc on one side of a line at distance ``u`` from its middle."""
    u = np.clip(u, -1, 1)
    return 0.5 + (u * np.sqrt(1 - u * u) + np.arcsin(u)) / np.pi


SHEAR, HEIGHT, START, SPEED = 0.15, 6.0, -0.5, 1.0


def half_plane(shear: float = SHEAR) -> Scene:
    """All that the camera sees is a mirror at z = -4; at z = 2, behind the eye, an edge moves."""
    round_it = np.array([[-9.0, -9, -4], [9, -9, -4], [9, 9, -4], [-9, 9, -4]])
    faces = [[0, 1, 2], [0, 2, 3]]
    glossy = Material(shading="unlit", reflectivity=1.0, reflection_shear=shear)
    half = np.array([[START, -50, 2.0], [80, -50, 2], [80, 50, 2], [START, 50, 2]])
    ends = np.stack([half, half + [SPEED, 0, 0]])
    meshes = [
        Mesh(positions=round_it, faces=faces, material=glossy),
        Mesh(positions=ends, faces=faces, shading="unlit"),
    ]
    return Scene(meshes=meshes, camera=UNIT_CAMERA)


@pytest.mark.parametrize(
    ("values", "near"),
    [
        ({"samples": 256}, 1e-3),
        nightly({"samples": 16, "pattern": "sobol"}, 6e-3),
        ({"method": "stochastic", "samples": 2048}, 2e-3),
        ({"method": "accumulation", "slices": 256, "samples": 4}, 4e-3),
    ],
    ids=["exact", "scattered", "points", "slices"],
)
def test_an_edge_is_a_ramp_as_wide_as_its_distance_from_the_mirror(values, near):
    """The image is ten units away: its columns are 10 / height wide."""
    width, height = SIZE
    places = np.arange(width)[:, None] + (np.arange(32) + 0.5) / 32
    x = (places - width / 2) * 10.0 / height
    passed = (np.arange(200) + 0.5) / 200

    def ramp(shear: float) -> np.ndarray:
        away = (x[..., None] - START - SPEED * passed) / (shear * HEIGHT)
        return segment(away).mean(axis=(1, 2))

    found = film(half_plane(), **values)[..., 0]
    assert np.count_nonzero((ramp(SHEAR) > 0.01) & (ramp(SHEAR) < 0.99)) >= 4
    assert rms(found - ramp(SHEAR)) < near
    assert abs((found - ramp(SHEAR)).mean()) < 4e-4
    assert rms(film(half_plane(1.2 * SHEAR), **values)[..., 0] - ramp(SHEAR)) > 1.5 * near


def test_a_few_slices_along_lines_are_nearer_than_through_points():
    of = half_plane(0.4)
    truth = np.mean([film(of, samples=64, pattern="sobol", seed=k) for k in range(8)], axis=0)

    def error(way: str) -> float:
        ways = {"method": "accumulation", "slices": 4, "samples": 4, "slice_lens": way}
        return rms(np.stack([film(of, seed=k, **ways) for k in range(8)]) - truth)

    assert error("line") < 0.8 * error("point")


def before_a_tilted_mirror(shear: float = 0.25) -> list[Surface]:
    """What moves before it, stands on it, and turns behind the eye; all is lit, without shine."""
    rng = np.random.default_rng(8)
    before = [flying(rng, [-1, -1, -5], [1.5, 1, -3], 0.8) for _ in range(3)]
    beyond = [flying(rng, [0, -1, 0.5], [4, 1, 4], 1.2) for _ in range(4)]
    across = Surface(plane(115.0, np.array([0.6, 0.2, -5.8]), 1.0), (0.2, 0.9, 0.3), lit=True)
    floor = replace(mirror(0.8), shear=shear)
    return [floor, *(replace(s, lit=k % 2 == 0) for k, s in enumerate([*before, *beyond])), across]


def unturned(surface: Surface) -> Surface:
    """Of what turns, normals that are blended between a motion segment's ends are not exact."""
    shift = (surface.corners[:, 1] - surface.corners[:, 0]).mean(axis=1, keepdims=True)
    return replace(
        surface, corners=np.stack([surface.corners[:, 0], surface.corners[:, 0] + shift], 1)
    )


def repeated(of: Scene, count: int, **values: object) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return summary(np.stack([film(of, seed=k, **values)[..., :3] for k in range(count)]))


def summary(films: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mean, its variance, and how many differ, as `welch` takes them."""
    differ = (np.abs(films - np.median(films, axis=0)) > 1e-6).sum(axis=0)
    return films.mean(axis=0), films.var(axis=0, ddof=1) / len(films), differ


@pytest.fixture(scope="module")
def exact() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    surfaces = [unturned(s) for s in before_a_tilted_mirror()]
    return repeated(scene(surfaces, LIGHTS), 40, pattern="sobol")


def test_rays_that_are_mirrored_into_cones_see_the_same(exact):
    surfaces = [unturned(s) for s in before_a_tilted_mirror()]
    rng = np.random.default_rng(1)
    rays = [sampled(surfaces, SIZE, TIMES, rng, LIGHTS) for _ in range(BATCHES)]
    t, bound = welch(summary(np.stack(rays)), exact, (BATCHES, 40))
    assert np.isfinite(t).sum() > 300
    assert np.nanmax(np.abs(t) / bound) < 1.0
    sharper = [replace(surfaces[0], shear=0.2), *surfaces[1:]]
    other = repeated(scene(sharper, LIGHTS), 40, pattern="sobol")
    t, bound = welch(summary(np.stack(rays)), other, (BATCHES, 40))
    assert np.nanmax(np.abs(t) / bound) > 1.0


def test_point_samples_agree_pixel_by_pixel_and_another_shear_does_not(exact):
    surfaces = [unturned(s) for s in before_a_tilted_mirror()]
    points = repeated(scene(surfaces, LIGHTS), 200, method="stochastic")
    t, bound = welch(points, exact, (200, 40))
    assert np.isfinite(t).sum() > 300
    assert np.nanmax(np.abs(t) / bound) < 1.0
    other = [replace(surfaces[0], shear=0.22), *surfaces[1:]]
    t, bound = welch(repeated(scene(other, LIGHTS), 200, method="stochastic"), exact, (200, 40))
    assert np.nanmax(np.abs(t) / bound) > 1.0


LENS = Camera(position=(0, 0, 0), look_at=(0, 0, -1), focal_length=24.0, f_stop=0.05,
              focus_distance=6.0)  # fmt: skip


@pytest.mark.nightly  # test_all_effects.py has these together with all others
def test_through_a_lens_point_samples_agree_too():
    """And with shadows, whose rays share nothing with how they are solved in time."""
    lights = [*LIGHTS[:1], replace(LIGHTS[1], shadows=True)]
    of = replace(scene(before_a_tilted_mirror(), lights), camera=LENS)
    points = repeated(of, 200, method="stochastic")
    t, bound = welch(points, repeated(of, 40, pattern="sobol"), (200, 40))
    assert np.isfinite(t).sum() > 300
    assert np.nanmax(np.abs(t) / bound) < 1.0


@pytest.mark.parametrize("of", ["lens", nightly("pinhole")])
def test_what_culling_leaves_out_is_never_seen(of):
    made = scene(before_a_tilted_mirror(0.6), LIGHTS)
    made = made if of == "pinhole" else replace(made, camera=LENS)
    ways = {"method": "stochastic", "samples": 20, "seed": 3}
    best, all_tested = film(made, **ways), film(made, cull="bbox", **ways)
    assert best.tobytes() == all_tested.tobytes()


@pytest.mark.nightly  # which test_all_effects.py has for all effects together
@pytest.mark.parametrize("tile", [8, 32])
def test_tiles_and_their_lists_do_not_matter(tile):
    """What bounds sheared paths on screen leaves none out."""
    made = scene([replace(s, lit=False) for s in before_a_tilted_mirror(0.6)])
    whole = film(made, (64, 48))
    assert film(made, (64, 48), tile_size=tile).tobytes() == whole.tobytes()


def test_a_mirror_without_shear_is_no_glossy_one():
    options = [
        ready_for(scene([replace(mirror(), shear=shear)]), mb.Settings(), *SIZE).plan.options
        for shear in (0.0, 0.1)
    ]
    assert set(options[1]) - set(options[0]) == {"-DMB_GLOSSY", "-DMB_PLACED"}


def test_edge_functions_over_time_refuse_glossy_mirrors():
    with pytest.raises(mb.UsageError, match="reflection_shear"):
        film(half_plane(), method="stochastic", test="edges")
