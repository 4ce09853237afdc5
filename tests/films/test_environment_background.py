"""An environment behind everything: as sharp as its texels, and filtered where these are narrow.

Against pictures that float64 interpolates between the centres of texels: at pixels' centres, and
the mean over pixels, over the lens, and over the time that the shutter is open.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from reference import panoramas as twin
from support.nightly import nightly

import mbinterval as mb

SIZE = (48, 36)
METHODS = {
    "analytic": {"samples": 1},
    "accumulation": {"method": "accumulation", "samples": 1, "slices": 2},
    "stochastic": {"method": "stochastic", "pattern": "fixed", "samples": 1},
}
"""Each looks at the middles of pixels."""
LOOKS = {
    "seam": ((0.1, 0.2, 1.0), 24.0),
    "pole": ((0.03, -1.0, 0.02), 40.0),
    "aslant": ((-0.7, 0.6, -1.0), 24.0),
}
UP = (0.3, 1.0, 0.2)


def camera(look: tuple[float, float, float], fov: float) -> mb.Camera:
    return mb.Camera(look_at=look, up=UP, fov=fov)


def ways(look: tuple[float, float, float], fov: float, across: object = 0.5,
         down: object = 0.5) -> np.ndarray:  # fmt: skip
    """``(..., h, w, 3)``: rays through places of pixels, from 0 to 1 across and down."""
    forward = np.array(look) / np.linalg.norm(look)
    right = np.cross(forward, UP)
    right /= np.linalg.norm(right)
    scale = 2.0 * np.tan(np.radians(fov / 2.0)) / SIZE[1]
    across, down = (np.asarray(part)[..., None, None] for part in (across, down))
    x = (np.arange(SIZE[0]) + across - SIZE[0] / 2.0) * scale
    y = -(np.arange(SIZE[1])[:, None] + down - SIZE[1] / 2.0) * scale
    x, y = np.broadcast_arrays(x, y)
    return forward + x[..., None] * right + y[..., None] * np.cross(right, forward)


def seen(of: mb.Environment, rays: np.ndarray) -> np.ndarray:
    image = np.asarray(of.image, np.float64)
    place = twin.places(image, rays.reshape(-1, 3), np.radians(of.rotation))
    return of.intensity * twin.interpolated(image, *place).reshape(rays.shape)


def texel_sizes(of: mb.Environment, rays: np.ndarray, fov: float) -> np.ndarray:
    """Widths of texels in pixels of the middle, across and down, the less of them ``(h, w)``."""
    pixel = 2.0 * np.tan(np.radians(fov / 2.0)) / SIZE[1]
    level = np.hypot(rays[..., 0], rays[..., 2]) / np.linalg.norm(rays, axis=-1)
    return np.minimum(level, 1.0) * np.pi / of.image.shape[0] / pixel


def over_pixels(of: mb.Environment, look: tuple[float, float, float], fov: float) -> np.ndarray:
    """The mean over each pixel, by 24 x 24 places."""
    part = (np.arange(24) + 0.5) / 24
    return np.mean(
        [seen(of, ways(look, fov, part, np.full(24, down))).mean(axis=0) for down in part], axis=0
    )


def film(of: mb.Environment, view: mb.Camera, meshes: object = (), **values: object) -> np.ndarray:
    scene = mb.Scene(meshes=list(meshes), camera=view, environment=of,
                     shutter=mb.Shutter(-0.5, 0.5))  # fmt: skip
    settings = mb.Settings(**values)
    return mb.render(scene, frame=0, width=SIZE[0], height=SIZE[1], settings=settings).rgba


def rmse(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.sqrt(np.mean((a - b) ** 2)))


def noise(rows: int, **fields: object) -> mb.Environment:
    image = np.random.default_rng(rows).uniform(0, 1, (rows, 2 * rows, 3))
    return mb.Environment(image, **fields)


def striped(rows: int, period: int) -> mb.Environment:
    image = np.zeros((rows, 2 * rows, 3))
    image[:, np.arange(2 * rows) % period >= period // 2] = 1.0
    return mb.Environment(image)


# Sharp


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("look", LOOKS)
def test_where_texels_are_wider_than_pixels_it_is_interpolated_between_them(method, look):
    of = noise(64, intensity=2.0, rotation=77.0)
    rays = ways(*LOOKS[look])
    sharp = texel_sizes(of, rays, LOOKS[look][1]) > 1.0
    assert sharp.mean() > 0.1
    found = film(of, camera(*LOOKS[look]), **METHODS[method])
    assert np.abs(found[..., :3] - seen(of, rays))[sharp].max() < 2e-4
    assert rmse(found[..., :3][sharp], seen(replace(of, rotation=77.5), rays)[sharp]) > 0.02
    assert (found[..., 3] == 0.0).all()


@pytest.mark.parametrize("period", [2, 4, 8, 16])
@pytest.mark.parametrize("rows", [64, 512])
def test_stripes_of_any_width_keep_their_contrast(rows, period):
    """24 texels from the top to the bottom of the frame."""
    fov = np.degrees(2.0 * np.arctan(0.5 * 24.0 * np.pi / rows))
    of, look = striped(rows, period), (0.3, 0.0, -1.0)
    found = film(of, camera(look, fov), samples=1)[..., :3]
    truth = seen(of, ways(look, fov))
    assert np.abs(found - truth).max() < 3e-3  # of 1024 columns a place is rounded to 2^-14
    assert np.ptp(found) == pytest.approx(np.ptp(truth), abs=3e-3)


@pytest.mark.parametrize("method", ["analytic", nightly("accumulation"), nightly("stochastic")])
def test_one_bright_texel_does_not_spread(method):
    image = np.full((64, 128, 3), 0.05)
    image[20, 59] = 3000.0
    of, look = mb.Environment(image), (-0.2, 0.6, -1.0)
    found = film(of, camera(look, 20.0), **METHODS[method])[..., 0]
    truth = seen(of, ways(look, 20.0))[..., 0]
    assert truth.max() > 2000.0
    assert np.abs(found - truth).max() < 3000.0 * 2e-4
    assert np.array_equal(found > 0.06, truth > 0.06)


# Filtered


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("look", LOOKS)
def test_where_texels_are_narrower_it_is_the_mean_over_pixels(method, look):
    """Waves of 7 texels and noise, 8 texels to a pixel; the middles alone would be aliased."""
    row, column = np.mgrid[:512, :1024]
    waves = np.sin(0.9 * column + 0.35 * row)[..., None] * [0.3, 0.2, 0.1]
    of = mb.Environment(waves + 0.5 + 0.2 * (noise(512).image - 0.5))
    view, fov = LOOKS[look][0], 80.0
    truth = over_pixels(of, view, fov)
    found = film(of, camera(view, fov), **METHODS[method])[..., :3]
    alias = rmse(seen(of, ways(view, fov)), truth)
    assert alias > 0.1
    assert rmse(found, truth) < 0.15 * alias
    assert np.abs(found.mean(axis=(0, 1)) - truth.mean(axis=(0, 1))).max() < 2e-3


def test_more_samples_come_to_the_mean_over_pixels():
    of, (look, fov) = noise(256), LOOKS["aslant"]
    truth = over_pixels(of, look, fov)
    for values in ({}, {"pattern": "sobol"}, {"method": "stochastic"}):
        less, more = (
            rmse(film(of, camera(look, fov), samples=n, **values)[..., :3], truth) for n in (4, 64)
        )
        assert more < 0.5 * less
        assert more < 0.01


def test_a_pole_shows_all_that_is_around_it():
    """Alternate columns right up to the pole: texels there are narrow at any size."""
    of, (look, fov) = striped(64, 2), LOOKS["pole"]
    fov = fov / 4.0
    truth = over_pixels(of, look, fov)
    rays = ways(look, fov)
    found = film(of, camera(look, fov), samples=1)[..., :3]
    narrow = texel_sizes(of, rays, fov) < 0.5
    assert 0.05 < narrow.mean() < 0.9
    assert np.abs(found - truth)[narrow].max() < 0.15
    assert rmse(found[narrow], truth[narrow]) < 0.2 * rmse(seen(of, rays)[narrow], truth[narrow])


def test_a_lens_shows_the_mean_over_its_disc():
    of, (look, fov) = striped(64, 4), LOOKS["aslant"]
    lens = {"fov": None, "focal_length": 12.0 / np.tan(np.radians(fov / 2.0)), "f_stop": 0.7,
            "focus_distance": 2.0}  # fmt: skip
    found = film(of, replace(camera(look, fov), **lens), samples=256, pattern="sobol")[..., :3]
    radius = 0.5 * lens["focal_length"] / 1000.0 / lens["f_stop"] / lens["focus_distance"]
    blur = radius * SIZE[1] / (2.0 * np.tan(np.radians(fov / 2.0)))  # pixels
    k = np.arange(600) + 0.5
    u, v = blur * np.sqrt(k / 600) * np.array([np.cos(k * 2.399963), np.sin(k * 2.399963)])
    truth = seen(of, ways(look, fov, 0.5 + u, 0.5 + v)).mean(axis=0)
    assert blur > 0.7
    assert np.abs(found - truth).max() < 0.04  # of a pixel's mean, too
    assert rmse(found, truth) < 0.01
    assert rmse(seen(of, ways(look, fov)), truth) > 0.02


# In time


def turning(degrees: float, axis: tuple[float, float, float]) -> tuple[mb.Camera, np.ndarray]:
    """A camera that turns evenly about an axis, and rays of its pixels at many times."""
    unit = np.array(axis) / np.linalg.norm(axis)
    frames, times = np.linspace(-0.5, 0.5, 33), (np.arange(1500) + 0.5) / 1500 - 0.5
    halves = np.radians(degrees) * frames / 2.0
    turns = np.concatenate([np.sin(halves)[:, None] * unit, np.cos(halves)[:, None]], axis=1)
    place = mb.Transform(rotation=mb.Track(frames, turns, "linear", True))
    y, x = np.mgrid[3 : SIZE[1] : 8, 2 : SIZE[0] : 7]
    scale = 2.0 * np.tan(np.radians(15.0)) / SIZE[1]
    away = [(x + 0.5 - SIZE[0] / 2) * scale, -(y + 0.5 - SIZE[1] / 2) * scale, -np.ones(x.shape)]
    away = np.stack(away, axis=-1)
    angle = np.radians(degrees) * times[:, None, None, None]
    across = np.cross(unit, away)
    along = (away @ unit)[..., None] * unit
    rays = along + np.cos(angle) * (away - along) + np.sin(angle) * across
    return mb.Camera(transform=place, fov=30.0), rays


AXES = [(0, 1, 0), nightly((1, 0, 0)), (1, 1, 0.3), (0.2, 0.1, 1.0)]


@pytest.mark.parametrize("axis", AXES)
@pytest.mark.parametrize("kind", ["noise", "lamps", nightly("stars")])
def test_what_passes_is_averaged_as_exactly_as_shading_error_asks(kind, axis):
    """In closed form but for time, of which there are 1500: lamps are one texel each."""
    image = np.random.default_rng(8).uniform(0, 1, (64, 128, 3))
    if kind != "noise":
        image = np.where(image[..., :1] < 0.03, 3000.0 if kind == "lamps" else 20.0, 0.05 * image)
    of = mb.Environment(image)
    view, rays = turning(16.0, axis)
    given = film(of, view, samples=1, motion_segments=128)[3::8, 2::7, :3]
    truth = seen(of, rays).mean(axis=0)
    allowed = 2e-3 + 1e-4 * truth.max()  # directions are rounded, and truth is of many moments
    assert np.abs(given - truth).max() < allowed
    late = seen(of, rays[15:]).mean(axis=0)  # a hundredth of the shutter is missing
    assert np.abs(late - truth).max() > 2.0 * allowed


def test_point_samples_and_slices_see_the_same_pass():
    of = noise(64)
    view, rays = turning(16.0, (1, 1, 0.3))
    truth = seen(of, rays).mean(axis=0)
    points = {"method": "stochastic", "samples": 1024, "filter_radius": 0.01}
    slices = {"method": "accumulation", "samples": 1, "slices": 512}
    for values in (points, slices):
        given = film(of, view, **values)[3::8, 2::7, :3]
        assert np.abs(given - truth).max() < 0.01


# Behind and in things


def test_what_stands_before_it_changes_nothing_of_it():
    """At rest, in motion and translucent; and what is seen through is not blurred either."""
    of, (look, fov) = noise(64), LOOKS["seam"]
    alone = film(of, camera(look, fov), samples=1)
    corners = np.array([[-0.3, -0.3, 2.0], [0.3, -0.3, 2.0], [0.0, 0.4, 2.0]])
    moving = np.stack([corners, corners + [0.3, 0.1, 0.0]])
    glass = mb.Material("glass", shading="unlit", base_color=(0.0, 0.0, 0.0), opacity=0.5)
    for positions, material in ((corners, None), (moving, None), (moving, glass)):
        mesh = mb.Mesh(positions=positions, faces=[[0, 1, 2]], color=(0.0, 0.0, 0.0),
                       material=material or mb.Material(shading="unlit"))  # fmt: skip
        found = film(of, camera(look, fov), [mesh], samples=1)
        assert 0.02 < found[..., 3].mean() < 0.5
        over = (1.0 - found[..., 3:]) * alone[..., :3]
        assert np.abs(found[..., :3] - over).max() < 1e-5


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("kind", ["flat mirror", "metal"])
def test_mirrors_show_it_as_sharp(kind, method):
    """A wall that turns the camera's view by 70 degrees, of a mirror or of a clear metal."""
    of, look, fov = noise(32), (0.0, 0.0, -1.0), 24.0
    normal = np.array([np.sin(np.radians(35.0)), 0.0, np.cos(np.radians(35.0))])
    right = np.array([normal[2], 0.0, -normal[0]])
    corners = [x * right + [0, y, -3.0] for x, y in ((-9, -9), (9, -9), (9, 9), (-9, 9))]
    mirror = mb.Material(shading="unlit", reflectivity=1.0)
    metal = mb.Material(shading="metallic_roughness", base_color=(1, 1, 1), metallic=1.0,
                        roughness=0.0)  # fmt: skip
    wall = mb.Mesh(positions=np.array(corners), faces=[[0, 1, 2], [0, 2, 3]],
                   material=mirror if kind == "flat mirror" else metal)  # fmt: skip
    view = mb.Camera(look_at=look, fov=fov)
    found = film(of, view, [wall], **METHODS[method])[..., :3]
    x = ways_level(fov)
    mirrored = x - 2.0 * (x @ normal)[..., None] * normal
    truth = seen(of, mirrored)
    assert texel_sizes(of, mirrored, fov).min() > 1.0
    if kind == "metal":  # Schlick's term is 1 and what facets mask is lost
        found = found * (truth.mean() / found.mean())
    assert np.abs(found - truth).max() < (1e-3 if kind == "flat mirror" else 0.02)
    assert (found[..., 0].max(), found[..., 0].min()) == pytest.approx(
        (truth[..., 0].max(), truth[..., 0].min()), abs=0.02
    )


def ways_level(fov: float) -> np.ndarray:
    """Rays of a camera that looks along -z, upright."""
    scale = 2.0 * np.tan(np.radians(fov / 2.0)) / SIZE[1]
    y, x = np.mgrid[: SIZE[1], : SIZE[0]]
    rays = np.stack([(x + 0.5 - SIZE[0] / 2) * scale, -(y + 0.5 - SIZE[1] / 2) * scale,
                     -np.ones(x.shape)], axis=-1)  # fmt: skip
    return rays / np.linalg.norm(rays, axis=-1, keepdims=True)
