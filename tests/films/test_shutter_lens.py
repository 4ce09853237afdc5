"""Shutter curves, rolling shutters and thin lenses, against closed forms and brute force."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from reference import exact
from reference.paths import Paths, paths_of
from reference.samples import Points
from reference.visibility import exact as envelope
from support.closed_forms import FACES, UNIT_CAMERA, rectangle, slab, slab_times, world
from support.kernels import ready_for, run
from support.nightly import nightly, nightly_but
from support.places import places

import mbinterval as mb
from mbinterval.device import records
from mbinterval.exposure.exposure import expose
from mbinterval.layout.motion import lay_out
from mbinterval.scene.model import Camera, Mesh, Scene, Shutter
from mbinterval.scene.tracks import Track

SIZE = (32, 16)
X = np.arange(32) + 0.5
CURVES = {
    "box": Shutter(),
    "triangle": Shutter(curve="triangle"),
    "trapezoid": Shutter(curve="trapezoid", opening=0.3, closing=0.1),
    "late": Shutter(curve="trapezoid", opening=1.0, closing=0.0),
    "table": Shutter(curve=(0.2, 3.0, 0.0, 1.0, 1.0)),
}


def opening(shutter: Shutter, t: np.ndarray) -> np.ndarray:
    """How far the shutter is open at t in [0, 1]; written out again."""
    if isinstance(shutter.curve, tuple):
        return np.interp(t, np.linspace(0, 1, len(shutter.curve)), shutter.curve)
    if shutter.curve == "box":
        return np.ones_like(t)
    a, b = (0.5, 0.5) if shutter.curve == "triangle" else (shutter.opening, shutter.closing)
    rising = t / a if a else np.ones_like(t)
    falling = (1 - t) / b if b else np.ones_like(t)
    return np.minimum(np.minimum(rising, falling), 1.0)


def passed(shutter: Shutter, t: np.ndarray) -> np.ndarray:
    """Share of the light until t, by fine quadrature."""
    edges = np.linspace(0, 1, 200001)
    light = opening(shutter, 0.5 * (edges[1:] + edges[:-1]))
    return np.interp(t, edges, np.append(0, np.cumsum(light)) / light.sum())


def render(of: Scene, **settings: object) -> np.ndarray:
    crop = settings.pop("crop", None)
    chosen = mb.Settings(**({"samples": 1} | settings))
    return mb.render(of, width=SIZE[0], height=SIZE[1], settings=chosen, crop=crop).rgba


def two_slabs() -> list[Mesh]:
    front = slab(rectangle(2.3, 8.3, -1, 17), (17, 0), 2.0, SIZE, (1, 0, 0))
    return [front, slab(rectangle(20.3, 28.3, -1, 17), (-19, 0), 3.0, SIZE, (0, 1, 0))]


@pytest.mark.parametrize(
    ("name", "occlusion"),
    [*((name, "exact") for name in ("box", "triangle", "table")), ("triangle", 1024),
     nightly("trapezoid", "exact"), nightly("late", "exact")],
)  # fmt: skip
def test_a_curve_weights_time_as_its_closed_form(name, occlusion):
    shutter = CURVES[name]
    front, back = two_slabs()
    scene = Scene(meshes=[front, back], camera=UNIT_CAMERA, shutter=shutter)
    image = render(scene, occlusion=occlusion)[5]
    (a0, a1), (b0, b1) = slab_times(X, 2.3, 8.3, 17), slab_times(X, 20.3, 28.3, -19)
    red = passed(shutter, a1) - passed(shutter, a0)
    low, high = np.maximum(a0, b0), np.maximum(np.minimum(a1, b1), np.maximum(a0, b0))
    green = (
        passed(shutter, b1) - passed(shutter, b0) - (passed(shutter, high) - passed(shutter, low))
    )
    limit = 2e-5 if occlusion == "exact" else 2 / 1024
    assert image[:, 0] == pytest.approx(red, abs=limit)
    assert image[:, 1] == pytest.approx(green, abs=limit)
    plain = render(replace(scene, shutter=Shutter()))[5]
    assert name == "box" or np.abs(plain - image).max() > 0.05


@pytest.mark.parametrize("name", ["triangle", "table", nightly("trapezoid")])
def test_a_curve_is_the_weighted_sum_of_short_boxes(name):
    """Freely deforming triangles; 40 sub-shutters, each weighted by its light."""
    rng, parts = np.random.default_rng(1), 40
    middle = rng.uniform(0, SIZE, (2, 12, 1, 2)) + rng.normal(0, 6, (2, 12, 3, 2))
    # The curve is the same over each part of the shutter only if motion is linear in it.
    ends = world(middle, rng.uniform(2.0, 2.5, (1, 12, 3)), SIZE).reshape(2, -1, 3)
    looks = {"faces": np.arange(36).reshape(-1, 3), "color": rng.uniform(0, 1, (12, 3)),
             "color_domain": "face", "shading": "unlit"}  # fmt: skip
    shutter = CURVES[name]
    whole = Scene(meshes=[Mesh(positions=ends, **looks)], camera=UNIT_CAMERA, shutter=shutter)
    total = np.zeros((*SIZE[::-1], 4))
    for k in range(parts):
        low, high = k / parts, (k + 1) / parts
        part = np.stack([(1 - t) * ends[0] + t * ends[1] for t in (low, high)])
        film = render(Scene(meshes=[Mesh(positions=part, **looks)], camera=UNIT_CAMERA))
        total += film * (passed(shutter, high) - passed(shutter, low))
    error = np.abs(render(whole) - total)
    assert error.max() < 2.0 / parts**2 * 5
    assert np.abs(render(replace(whole, shutter=Shutter())) - total).max() > 0.05


def panned(shutter: Shutter, direction: tuple[float, float] = (0.35, 0.1)) -> Scene:
    """Slabs at rest before a camera that moves: any part of the shutter is linear motion."""
    rng = np.random.default_rng(2)
    pixels = rng.uniform((-8, -8), (40, 24), (12, 1, 2)) + rng.normal(0, 6, (12, 3, 2))
    positions = world(pixels, rng.uniform(1.8, 3.0, (12, 1)), SIZE).reshape(-1, 3)
    path = Track([0.0, 2.0], [[0.0, 0, 0], [4 * direction[0], 4 * direction[1], 0]])
    return Scene(
        meshes=[Mesh(positions=positions, faces=np.arange(36).reshape(-1, 3), shading="unlit",
                     color=rng.uniform(0, 1, (12, 3)), color_domain="face")],
        camera=Camera(position=path, focal_length=24.0), shutter=shutter, fps=24.0,
    )  # fmt: skip


ROLL = {"line_offset": 0.0004, "line_exposure": 0.006}


@pytest.mark.parametrize(
    ("direction", "curve"),
    [("down", "box"), ("up", "box"), ("right", "triangle"), ("left", "triangle"),
     nightly("down", "triangle"), nightly("up", "triangle"),
     nightly("right", "box"), nightly("left", "box")],
)  # fmt: skip
def test_each_line_of_a_rolling_shutter_has_its_own_window(direction, curve):
    rolling = Shutter(open=-0.1, rolling=direction, curve=curve, **ROLL)
    image = render(panned(rolling))
    columns = direction in ("right", "left")
    lines = SIZE[0] if columns else SIZE[1]
    for line in range(0, lines, 3):
        place = lines - 1 - line if direction in ("up", "left") else line
        start = -0.1 + 24.0 * ROLL["line_offset"] * place
        alone = Shutter(open=start, close=start + 24.0 * ROLL["line_exposure"], curve=curve)
        crop = (line, 0, 1, SIZE[1]) if columns else (0, line, SIZE[0], 1)
        want = render(panned(alone), crop=crop)
        got = image[:, line : line + 1] if columns else image[line : line + 1]
        assert got == pytest.approx(want, abs=2e-5)
    together = Shutter(open=-0.1, close=-0.1 + 24 * ROLL["line_exposure"], curve=curve)
    assert np.abs(image - render(panned(together))).max() > 0.05


@pytest.mark.parametrize("occlusion", [128, nightly("exact")])
def test_triangulated_paths_roll_too(occlusion):
    rolling = Shutter(open=-0.1, rolling="down", **ROLL)
    both = [
        render(panned(rolling), paths=p, occlusion=occlusion) for p in ("triangulated", "exact")
    ]
    assert np.abs(both[0] - both[1]).max() < (1e-4 if occlusion == "exact" else 2 / 128)


@pytest.mark.parametrize(
    "shutter",
    [
        nightly(Shutter(curve="triangle")),
        Shutter(rolling="left", **ROLL),
        Shutter(curve=(1.0, 0.0, 1.0)),
    ],
)
def test_what_does_not_move_does_not_care_about_the_shutter(shutter):
    still = replace(panned(Shutter()), camera=UNIT_CAMERA)
    assert np.array_equal(render(still), render(replace(still, shutter=shutter)))
    mixed = [*still.meshes, slab(rectangle(2.3, 8.3, 4, 8), (17, 0), 5.0, SIZE)]
    films = [render(replace(still, meshes=mixed, shutter=s)) for s in (Shutter(), shutter)]
    front = films[0][..., 3] == 1.0
    behind = slab(rectangle(2.3, 8.3, 4, 8), (17, 0), 0.5, SIZE)
    films = [render(replace(still, meshes=[*still.meshes, behind], shutter=s))
             for s in (Shutter(), shutter)]  # fmt: skip
    assert front.any()
    assert np.array_equal(films[0][10:], films[1][10:])


def test_nothing_of_it_is_compiled_where_it_is_not_asked_for():
    still = replace(panned(Shutter()), camera=UNIT_CAMERA)
    for scene in (panned(Shutter()), still, replace(still, shutter=Shutter(curve="triangle"))):
        options = " ".join(ready_for(scene, mb.Settings(), *SIZE).plan.options)
        for macro in ("LENS", "BLADES", "ROLLING", "SHUTTER", "PLACED", "SCATTERED", "FILTER"):
            assert macro not in options
    curved = ready_for(panned(CURVES["table"]), mb.Settings(), *SIZE).plan
    assert "-DMB_SHUTTER_CURVE" in curved.options
    assert dict(curved.numbers)["shutter_keys"] == 5


LENS = Camera(focal_length=48.0, vertical_aperture=48.0, f_stop=0.25, focus_distance=2.2)
"""A lens 0.192 wide, whose focal length is one image height."""


def circle(camera: Camera, w: np.ndarray, height: int = SIZE[1]) -> np.ndarray:
    """Radius of blur times w in pixels, written out again: positive behind the focus."""
    radius = camera.focal_length * 1e-3 / camera.f_stop / 2
    scale = radius * height * camera.focal_length / camera.vertical_aperture

    def blur(at: np.ndarray) -> np.ndarray:
        return scale * (at / camera.focus_distance - 1.0)

    value = blur(w)
    if camera.sharp_range is not None:
        near, far = (blur(np.asarray(end)) for end in camera.sharp_range)
        value = np.where(value > far, value - far, np.where(value < near, value - near, 0.0))
    if camera.foreground_blur is not None:
        value = np.maximum(value, -camera.foreground_blur * height * w)
    return value


def seen_through(paths: Paths, camera: Camera, place: np.ndarray) -> tuple[np.ndarray, float]:
    """Colour and coverage of one sample through its point of the lens: a sheared pinhole."""
    x, y, u, v = place
    points = paths.points.copy()
    blur = circle(camera, points[..., 2])
    points[..., 0] += u * blur
    points[..., 1] += v * blur
    sheared = replace(paths, points=points)
    found = exact.intervals(sheared, Points(np.array([[x, y]])))
    spans = envelope(found)
    color = paths.color[found.path[spans.interval]]
    return (spans.weight[:, None] * color).sum(axis=0), float(spans.weight.sum())


CAMERAS = {
    "round": LENS,
    "five blades": replace(LENS, blades=5, blade_rotation=20.0),
    "extended focus": replace(LENS, sharp_range=(2.0, 2.6)),
    "limited foreground": replace(LENS, foreground_blur=0.03),
}


@pytest.mark.parametrize("near", [1.0, -0.5], ids=["ahead", "behind the eye too"])
@pytest.mark.parametrize("name", nightly_but(CAMERAS, "round", "five blades"))
def test_films_are_the_mean_of_sheared_pinholes_at_the_same_points_of_the_lens(name, near):
    camera, rng = CAMERAS[name], np.random.default_rng(3)
    middle = rng.uniform((-2, -2), (18, 14), (2, 10, 1, 2)) + rng.normal(0, 5, (2, 10, 3, 2))
    ends = world(middle, rng.uniform(near, 4.0, (2, 10, 3)), SIZE).reshape(2, -1, 3)
    rest = world(middle[0, :5] + 3, rng.uniform(1.5, 4.0, (5, 3)), SIZE).reshape(-1, 3)
    meshes = [
        Mesh(positions=p, faces=np.arange(p.shape[-2]).reshape(-1, 3), shading="unlit",
             color=rng.uniform(0, 1, (p.shape[-2] // 3, 3)), color_domain="face")
        for p in (ends, rest)
    ]  # fmt: skip
    scene = Scene(meshes=meshes, camera=camera)
    settings = mb.Settings(samples=4, pattern="sobol", seed=5)
    crop = (3, 2, 5, 5)
    film = mb.render(scene, width=SIZE[0], height=SIZE[1], settings=settings, crop=crop)
    lenses, _ = places(settings, camera=camera)
    exposure = expose(scene, 1.0, 2.0, motion_error=settings.motion_error, height=SIZE[1])
    paths = paths_of(exposure, *SIZE)
    want = np.zeros_like(film.rgba, dtype=np.float64)
    for row in range(5):
        for column in range(5):
            for place in lenses[row + 2, column + 3]:
                color, cover = seen_through(paths, camera, place)
                want[row, column] += np.append(color, cover) / 4
    assert np.abs(film.rgba - want).max() < 1e-5
    pinhole = replace(camera, f_stop=None, focus_distance=None, blades=0, sharp_range=None,
                      foreground_blur=None)  # fmt: skip
    sharp = mb.render(
        replace(scene, camera=pinhole), width=SIZE[0], height=SIZE[1], settings=settings, crop=crop
    )
    assert np.abs(sharp.rgba - want).max() > 0.02


EDGES = {"vertical": (-200, 12.3, -200, 200), "horizontal": (-200, 200, -200, 8.3)}


@pytest.mark.parametrize("pattern", ["sobol", nightly("fixed")])
@pytest.mark.parametrize("edge", EDGES)
def test_noise_of_the_lens_falls_faster_than_with_independent_samples(edge, pattern):
    """An edge with a circle of confusion of 2.2 px; pixels along it differ by their samples alone.

    Independent samples have a deviation of 0.5 / sqrt(n): .125, .05 and .03 for these counts.
    """
    scene = Scene(
        meshes=[slab(rectangle(*EDGES[edge]), (0, 0), 2.0, (24, 16))],
        camera=Camera(focal_length=24, f_stop=1, focus_distance=4, meters_per_unit=0.05),
    )
    for count, limit in ((16, 0.08), (100, 0.03), (256, 0.014)):
        settings = [mb.Settings(samples=count, pattern=pattern, seed=seed) for seed in range(8)]
        films = [mb.render(scene, width=24, height=16, settings=s).rgba[..., 3] for s in settings]
        alpha = np.stack(films).transpose((2, 0, 1) if edge == "vertical" else (1, 0, 2))
        deviation = alpha.reshape(len(alpha), -1).std(axis=1)
        assert 0.002 < deviation.max() < limit


@pytest.mark.parametrize("w", [1.2, 1.5, 4.0])
def test_a_small_far_point_becomes_a_disc_of_the_closed_form_radius(w):
    """The second moment of a uniform disc is half its squared radius."""
    size = (48, 48)
    camera = replace(LENS, f_stop=0.1)
    point = rectangle(22.5, 25.5, 22.5, 25.5)
    mesh = Mesh(positions=world(point, w, size), faces=FACES, shading="unlit")
    settings = mb.Settings(samples=256, pattern="sobol")
    film = mb.render(Scene(meshes=[mesh], camera=camera), width=48, height=48, settings=settings)
    alpha = film.rgba[..., 3].astype(np.float64)
    radius = abs(float(circle(camera, np.asarray(w), 48))) / w
    y, x = np.indices((48, 48)) + 0.5 - 24
    noise = 4 * np.sqrt(9 / 256)  # of as many independent samples; a net has less
    assert alpha.sum() == pytest.approx(9.0, abs=noise)
    moment = (alpha * (x * x + y * y)).sum() / alpha.sum()
    assert 2 < radius < 24
    assert moment == pytest.approx(radius**2 / 2 + 3.0**2 / 6 + 1 / 6, rel=0.06)
    reach = np.hypot(x, y)[alpha > 0].max()
    assert radius < reach < radius + 3.5


def blur_of(camera: Camera, w: np.ndarray) -> np.ndarray:
    """Radius of blur in pixels that stage "vertices" gives points at depth w."""
    positions = np.zeros((len(w), 3))
    positions[:, 2] = -w
    mesh = Mesh(positions=positions, faces=[[0, 1, 2]])
    motion = lay_out(expose(Scene(meshes=[mesh], camera=camera), 1.0, 2.0), *SIZE)
    table = np.zeros(motion.vertex_count, records.VERTEX)
    given = [motion.jobs, motion.positions, motion.cameras, table]
    table = run("shared/vertices.cl", "vertices", given, ["-DMB_LENS"], len(motion.jobs))[-1]
    return table["circle"] / table["w"]


@pytest.mark.parametrize("name", CAMERAS)
def test_blur_is_continuous_in_depth_and_as_asked_for(name):
    camera = CAMERAS[name]
    w = np.linspace(0.2, 30.0, 20001)
    blur = blur_of(camera, w)
    assert blur == pytest.approx(circle(camera, w) / w, abs=1e-9)
    free = blur_of(replace(camera, sharp_range=None, foreground_blur=None), w)
    assert np.abs(np.diff(blur)).max() <= np.abs(np.diff(free)).max() + 1e-9  # no step
    assert np.all(np.abs(blur) <= np.abs(free) + 1e-9)
    if camera.sharp_range:
        near, far = camera.sharp_range
        assert np.all(blur[(w > near) & (w < far)] == 0)
        assert np.all(blur[w > far + 0.01] > 0)
        assert np.all(blur[w < near - 0.01] < 0)
    if camera.foreground_blur:
        assert blur.min() == pytest.approx(-camera.foreground_blur * SIZE[1])
        assert free.min() < 2 * blur.min()


def test_time_stays_exact_through_a_lens():
    """A plane in focus: a slab that moves in it is as sharp in time as without a lens."""
    front = slab(rectangle(2.3, 8.3, -9, 25), (17, 0), 2.2, SIZE)
    image = render(Scene(meshes=[front], camera=LENS))
    t0, t1 = slab_times(X, 2.3, 8.3, 17)
    assert image[5, :, 3] == pytest.approx(t1 - t0, abs=1e-6)


@pytest.mark.nightly  # which test_all_effects.py has for all effects together
@pytest.mark.parametrize(("seed", "tile"), [(0, 8), (1, 32)])
def test_lenses_and_scattered_samples_give_the_same_bytes_in_any_tiles_and_crops(seed, tile):
    scene = replace(panned(Shutter(curve="triangle", rolling="up", **ROLL)), camera=LENS)
    moving = [
        replace(m, positions=np.stack([m.positions, m.positions + 0.1])) for m in scene.meshes
    ]
    scene = replace(scene, meshes=moving)
    options = {"samples": 5, "pattern": "sobol", "filter": "mitchell", "seed": seed}
    whole = render(scene, **options)
    assert np.array_equal(whole, render(scene, **options))
    assert np.array_equal(whole, render(scene, tile_size=tile, **options))
    assert np.array_equal(whole[3:9, 5:21], render(scene, crop=(5, 3, 16, 6), **options))
    turned = [replace(m, faces=m.faces[::-1], color=m.color[::-1]) for m in moving]
    assert np.array_equal(whole, render(replace(scene, meshes=turned), **options))
    assert not np.array_equal(whole, render(scene, **(options | {"seed": 7})))
