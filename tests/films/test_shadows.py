"""Shadows in motion, exact in time: closed forms, brute force, and rays of point samples."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from reference.shadows import over_time
from support.closed_forms import FACES, UNIT_CAMERA, slab_times, world
from support.kernels import ready_for, render_with
from support.nightly import nightly, nightly_but
from support.shadow_scenes import (
    ALL,
    AMBIENT,
    CAMERA,
    CASES,
    LAMP,
    MATT,
    SPOT,
    SUN,
    plate,
    scene,
    solid,
)
from support.shadow_scenes import turning as turned

import mbinterval as mb
from mbinterval.exposure.asked import Asked
from mbinterval.exposure.exposure import expose
from mbinterval.scene.model import Camera, Light, Material, Mesh, Scene, Shutter, Texture

SIZE = (24, 16)


def film(of: Scene, size: tuple[int, int] = SIZE, **values: object) -> np.ndarray:
    settings = mb.Settings(**{"samples": 1, "motion_segments": 1, **values})
    rgba = mb.render(of, width=size[0], height=size[1], settings=settings).rgba
    return np.asarray(rgba, np.float64)


def wall(**fields: object) -> Mesh:
    """All that `UNIT_CAMERA` sees, at z = -2."""
    corners = np.array([[-3.0, -2, -2], [3, -2, -2], [3, 2, -2], [-3, 2, -2]])
    return Mesh(positions=corners, faces=FACES, material=MATT, **fields)


def shade_maker(left: float, right: float, speed: float, **fields: object) -> Mesh:
    """A tall rectangle at z = -1 over those x, out of sight, which moves by ``speed``."""
    start = np.array([[left, -9.0, -1], [right, -9, -1], [right, 9, -1], [left, 9, -1]])
    ends = np.stack([start, start + [speed, 0, 0]])
    return Mesh(positions=ends, faces=FACES, **{"material": MATT, **fields})


FORMS = {
    # A light, how x at z = -1 falls on the wall (factor, shift), and where what hides it is.
    "directional": (Light("directional", direction=(1, 0, -1), shadows=True), (1, 1), (-2.3, 0.9)),
    "point": (Light("point", position=(-3.0, 0, 0), shadows=True), (2, 3), (-2.1, 0.5)),
    "spot": (
        Light("spot", position=(-3.0, 0, 0), direction=(1, 0, -1), outer_angle=89.0, shadows=True),
        (2, 3), (-2.1, 0.5),
    ),
    "narrow spot": (
        Light("spot", position=(-3.0, 0, 0), direction=(1, 0, -1), outer_angle=55.0, shadows=True),
        (2, 3), (-2.1, 0.5),
    ),
}  # fmt: skip


def share(name: str, width: float = 0.4, speed_up: float = 1.0, opacity: float = 1.0) -> np.ndarray:
    """What part of its light the wall keeps, by column, in closed form."""
    _, (factor, shift), (left, speed) = FORMS[name]
    x = world(np.stack([np.arange(SIZE[0]) + 0.5, np.full(SIZE[0], 8.0)], 1), 2.0, SIZE)[:, 0]
    low, high = (factor * edge + shift for edge in (left, left + width))
    t0, t1 = slab_times(x, low, high, factor * speed * speed_up)
    return 1.0 - opacity * (t1 - t0)


def unshaded(light: Light) -> np.ndarray:
    """What the wall alone sends, red."""
    return film(Scene(meshes=[wall()], camera=UNIT_CAMERA, lights=[light]), shadows="off")[..., 0]


@pytest.mark.parametrize(
    ("name", "opacity"),
    [*((name, 1.0) for name in FORMS if name != "point"), nightly("point", 1.0),
     ("directional", 0.25), *(nightly(name, 0.25) for name in FORMS if name != "directional")],
)  # fmt: skip
def test_a_slab_that_passes_a_light_hides_it_for_its_exact_time(name, opacity):
    light, _, (left, speed) = FORMS[name]
    material = replace(MATT, opacity=opacity)
    moving = shade_maker(left, left + 0.4, speed, material=material)
    of = Scene(meshes=[wall(), moving], camera=UNIT_CAMERA, lights=[light])
    found, free = film(of)[..., 0], unshaded(light)
    lit = free > 1e-4
    assert lit.mean() > 0.6
    expected = np.broadcast_to(share(name, opacity=opacity), found.shape)
    assert np.ptp(expected[lit]) > 0.2 * opacity
    assert np.abs(found / free - expected)[lit].max() < 2e-6
    wrong = np.broadcast_to(share(name, speed_up=1.01, opacity=opacity), found.shape)
    assert np.abs(found / free - wrong)[lit].max() > 1e-3 * opacity


def test_translucent_layers_each_take_their_share_of_the_light():
    light, _, (left, speed) = FORMS["directional"]
    layers = [
        shade_maker(left, left + width, speed, material=replace(MATT, opacity=opacity))
        for width, opacity in ((0.4, 0.5), (0.7, 0.2))
    ]
    layers[1] = replace(layers[1], positions=layers[1].positions + [-0.2, 0, 0.2])
    of = Scene(meshes=[wall(), *layers], camera=UNIT_CAMERA, lights=[light])
    settings = mb.Settings(samples=1, motion_segments=1)
    found = mb.render(of, width=SIZE[0], height=SIZE[1], settings=settings).rgba[8, :, 0]
    free = unshaded(light)[8]
    x = world(np.stack([np.arange(SIZE[0]) + 0.5, np.full(SIZE[0], 8.0)], 1), 2.0, SIZE)[:, 0]
    t = (np.arange(20000) + 0.5) / 20000
    first = np.abs(x[:, None] - (left + 0.2 + 1 + speed * t)) < 0.2
    second = np.abs(x[:, None] - (left - 0.2 + 0.35 + 1.2 + speed * t)) < 0.35
    expected = np.mean(np.where(first, 0.5, 1.0) * np.where(second, 0.8, 1.0), axis=1)
    assert np.any(first & second)
    assert found / free == pytest.approx(expected, abs=2e-4)


BARS = np.tile([0.9, 0.2, 0.6, 0.0, 0.35, 1.0, 0.1, 0.75], (2, 1))  # alpha of texels


def barred(name: str, kind: str) -> Mesh:
    """What moves before the light of `FORMS`, with alphas that vary along x."""
    _, _, (left, speed) = FORMS[name]
    bars = Texture(np.dstack([np.ones((2, 8, 3)), BARS]), wrap="clamp")
    mode = "mask" if kind == "tested" else "blend"
    if kind == "vertices":
        return shade_maker(
            left, left + 0.4, speed, material=replace(MATT, alpha_mode="blend"),
            color=[[1.0, 1, 1, a] for a in (0.1, 0.9, 0.9, 0.1)], color_domain="vertex",
        )  # fmt: skip
    material = replace(MATT, texture=bars, alpha_mode=mode)
    uv = np.array([[0.0, 1], [1, 1], [1, 0], [0, 0]])
    return shade_maker(left, left + 0.4, speed, material=material, uv=uv)


def alpha_along(kind: str, u: np.ndarray) -> np.ndarray:
    """Alpha at ``u``, from 0 to 1 over the width of `barred`."""
    if kind == "vertices":
        return 0.1 + 0.8 * u
    alpha = np.interp(u * 8 - 0.5, np.arange(8), BARS[0])
    return (alpha >= 0.5).astype(float) if kind == "tested" else alpha


@pytest.mark.parametrize(
    ("name", "kind"),
    [("point", "blended"), ("point", "tested"), ("point", "vertices"),
     nightly("directional", "blended"), nightly("directional", "tested"),
     nightly("directional", "vertices")],
)  # fmt: skip
def test_alpha_that_varies_dims_the_light_as_it_passes(name, kind):
    """A texture's bars run over the wall; exactly in time but for half a texel here and there."""
    light, (factor, shift), (left, speed) = FORMS[name]
    of = Scene(meshes=[wall(), barred(name, kind)], camera=UNIT_CAMERA, lights=[light])
    found, free = film(of)[..., 0], unshaded(light)
    x = world(np.stack([np.arange(SIZE[0]) + 0.5, np.full(SIZE[0], 8.0)], 1), 2.0, SIZE)[:, 0]
    t = (np.arange(4000) + 0.5) / 4000
    u = ((x[:, None] - shift) / factor - left - speed * t) / 0.4
    alpha = np.where((u >= 0) & (u <= 1), alpha_along(kind, u), 0.0)
    expected = 1.0 - alpha.mean(axis=1)
    lit = free > 1e-4
    difference = np.abs(found / free - expected)[lit]
    assert np.ptp(np.broadcast_to(expected, free.shape)[lit]) > 0.15
    assert difference.max() < (5e-3 if kind == "tested" else 2e-3)
    backwards = 1.0 - np.where((u >= 0) & (u <= 1), alpha_along(kind, 1.0 - u), 0.0).mean(axis=1)
    assert np.abs(found / free - backwards)[lit].max() > 5 * difference.max()


@pytest.mark.parametrize("kind", ["blended", "tested", "vertices"])
def test_rays_of_point_samples_meet_alpha_that_varies(kind):
    light, _, _ = FORMS["point"]
    of = Scene(meshes=[wall(), barred("point", kind)], camera=UNIT_CAMERA, lights=[light])
    exact, free = film(of)[..., 0], unshaded(light)
    lit = free > 1e-4
    values = {"method": "stochastic", "samples": 256, "motion_segments": 1}
    sampled = mb.render(of, width=SIZE[0], height=SIZE[1], settings=mb.Settings(**values)).rgba
    share = np.where(lit, sampled[..., 0] / np.where(lit, free, 1.0), 0.0)
    rows = slice(4, 12)  # pixels of a column see the same, but for their own light
    assert np.abs((share - exact / np.where(lit, free, 1.0))[rows].mean(axis=0)).max() < 0.02


AT_NIGHT = (
    *("static on static", "both", "a turning sphere with smooth normals"),
    "casters behind the light and around it",
)


@pytest.mark.parametrize("name", [nightly(name) if name in AT_NIGHT else name for name in CASES])
def test_shadows_are_those_of_rays_at_many_times(name):
    size, times = (16, 12), 192
    segments = 8 if "camera" in name else 1  # the twin sees a surface where it is in the world
    of, values = CASES[name](), {"texture_samples": 64, "motion_segments": segments}
    truth = over_time(expose(of, 1.0, size[0] / size[1], Asked(segments=segments)), size, times)
    found = film(of, size, **values)[..., :3]
    without = film(of, size, shadows="off", **values)[..., :3]
    difference = np.abs(found - truth).max(axis=2)
    contrast = np.abs(without - truth).max(axis=2)
    # Each change of a light is at most half a step of time away.
    assert np.all(difference < 4e-3 + 4.0 * contrast.max() / times)
    assert difference.mean() < 2e-3 * contrast.max()
    assert contrast.mean() > 10.0 * difference.mean()
    assert contrast.max() > 0.1


def late(of: Scene, by: float) -> Scene:
    moving = [m for m in of.meshes if m.positions.ndim == 3]
    assert moving
    shifted = [
        replace(m, positions=m.positions + by * (m.positions[-1] - m.positions[0])) for m in moving
    ]
    return replace(of, meshes=[m for m in of.meshes if m not in moving] + shifted)


EFFECTS = {
    "lens": {"camera": replace(CAMERA, f_stop=0.4, focus_distance=4.2)},
    "rolling shutter": {
        "shutter": Shutter(rolling="down", line_offset=1e-3, line_exposure=8e-3, curve="triangle")
    },
    "curve": {"shutter": Shutter(curve=(0.0, 1.0, 0.3))},
}


@pytest.mark.parametrize("name", nightly_but((*CASES, *EFFECTS), "both", "rolling shutter"))
def test_rays_of_point_samples_agree(name):
    """By blocks of pixels, over repeated seeds; a caster that is late is told apart."""
    of = CASES[name if name in CASES else "both"]()
    of = replace(of, **EFFECTS.get(name, {}))
    repeats, size = 12, (24, 18)

    def blocks(**values: object) -> np.ndarray:
        films = [film(of, size, seed=k, **values)[..., 0] for k in range(repeats)]
        return np.array(films).reshape(repeats, 6, 3, 8, 3).mean(axis=(2, 4))

    points = blocks(method="stochastic", pattern="random", samples=128)
    exact = blocks(pattern="sobol", samples=16)
    deviation = np.sqrt((points.var(axis=0, ddof=1) + exact.var(axis=0, ddof=1)) / repeats)
    z = (points.mean(axis=0) - exact.mean(axis=0)) / np.maximum(deviation, 1e-5)
    assert np.abs(z).max() < 5.5  # 48 blocks, 22 degrees of freedom: one in 1,500
    assert np.sqrt(np.mean(z**2)) < 1.6
    if name == "both":
        of = late(of, 0.03)
        moved = blocks(pattern="sobol", samples=16).mean(axis=0)
        assert np.abs((points.mean(axis=0) - moved) / np.maximum(deviation, 1e-5)).max() > 8.0


@pytest.mark.parametrize("kind", ["box", "sphere"])
@pytest.mark.parametrize(
    ("method", "degrees", "bound"),
    [("analytic", 70.0, 1e-3), ("stochastic", 70.0, 1e-3), ("analytic", 0.0, 1e-6),
     nightly("stochastic", 0.0, 1e-6)],
)  # fmt: skip
def test_a_convex_body_that_turns_has_no_acne(kind, method, degrees, bound):
    """It never hides a light from a face that is turned to it: shadows change nothing.

    At the moment at which a face turns to the light they are more exact than its normal, which is
    linear in time and found for a part of a span.
    """
    body = replace(solid(kind, material=MATT), normals=None)
    values = {"method": method, "motion_segments": 3, "samples": 1 if method == "analytic" else 64}
    of = scene(turned(body, degrees), lights=(SUN, LAMP, SPOT))
    found, free = film(of, **values), film(of, shadows="off", **values)
    assert free[..., 0].max() > 0.5
    assert np.abs(found - free).max() < bound


@pytest.mark.parametrize("method", ["analytic", "stochastic"])
@pytest.mark.parametrize("at", [(0.0, 0.6, 0.0), (1e5 + 0.01, -2e4, 3e5)])
def test_no_light_leaks_out_of_a_closed_body_that_turns(method, at):
    at = np.array(at)
    body = turned(solid("sphere", material=Material(shading="unlit")), 70.0)
    body = replace(body, transform=replace(body.transform, translation=tuple(at)))
    floor = plate(tuple(at - [0, 0.6, 0]), 6.0, (0.3, 0.0, 0.1))
    lamp = Light("point", position=tuple(at), intensity=3.0, shadows=True)
    camera = Camera(position=tuple(at + [0.0, 1.6, 4.0]), look_at=tuple(at), fov=40.0)
    of = Scene(meshes=[floor, body], camera=camera, lights=[AMBIENT, lamp])
    values = {"method": method, "motion_segments": 3, "samples": 4 if method == "analytic" else 64}
    found = film(of, **values)
    dark = film(replace(of, lights=[AMBIENT]), **values)
    free = film(of, shadows="off", **values)
    assert (free - dark).max() > 0.2
    assert np.abs(found - dark).max() < 1e-6


def test_surfaces_that_coincide_do_not_shade_each_other():
    twice = [plate((0, 0.1, 0), 3.0, (0.2, 0.1, 0)) for _ in range(2)]
    for method in ("analytic", "stochastic"):
        of = scene(*twice)
        assert np.abs(film(of, method=method) - film(of, method=method, shadows="off")).max() < 1e-6


def contents(of: Scene, **values: object) -> bytes:
    settings = mb.Settings(**{"samples": 2, "motion_segments": 2, **values})
    return mb.render(of, width=40, height=30, settings=settings).rgba.tobytes()


@pytest.mark.nightly  # which test_all_effects.py has for all effects together
@pytest.mark.parametrize("tile", [8, 32])
def test_any_tile_and_a_crop_give_the_same_bytes(tile):
    of = CASES["a turning box shades itself and the floor"]()
    first = contents(of)
    assert contents(of) == first
    assert contents(of, tile_size=tile) == first
    settings = mb.Settings(samples=2, motion_segments=2)
    part = mb.render(of, width=40, height=30, settings=settings, crop=(9, 7, 20, 15)).rgba
    whole = np.frombuffer(first, np.float32).reshape(30, 40, 4)
    assert np.array_equal(part, whole[7:22, 9:29])
    assert contents(of, shadows="off") != first


def test_pools_of_any_size_give_the_same_bytes():
    of = CASES["both"]()
    settings = mb.Settings(samples=2, motion_segments=1)
    films = [render_with(of, settings, 20, 15, capacity=size).rgba for size in (40, 150, 65536)]
    assert all(np.array_equal(f, films[0]) for f in films)


@pytest.mark.parametrize("moment", [0.5, nightly(0.1), nightly(0.9)])
def test_sharp_frames_have_the_shadow_of_their_moment(moment):
    light, (_, shift), (left, speed) = FORMS["directional"]
    of = Scene(meshes=[wall(), shade_maker(left, left + 0.4, speed)], camera=UNIT_CAMERA,
               lights=[light])  # fmt: skip
    x = world(np.stack([np.arange(SIZE[0]) + 0.5, np.full(SIZE[0], 8.0)], 1), 2.0, SIZE)[:, 0]
    settings = mb.Settings(samples=1, aovs=("sharp",), aov_time=moment)
    made = mb.render(of, width=SIZE[0], height=SIZE[1], settings=settings)
    dark = np.abs(x - (left + 0.2 + shift + speed * moment)) < 0.2
    assert 0 < dark.sum() < 10
    assert np.array_equal(made.layers["sharp"][8, :, 0] < 0.01, dark)


def test_the_plan_says_why_and_a_scene_without_shadows_has_nothing_of_them():
    of = CASES["both"]()
    bright = replace(of, lights=[replace(light, shadows=False) for light in of.lights])
    unlit = replace(of, meshes=[replace(m, material=Material(shading="unlit")) for m in of.meshes])
    settings = mb.Settings()
    for scene_, chosen, count, reason in (
        (of, settings, 3, "3 of 4 lights cast them, shadows='lights'"),
        (bright, settings, 0, "0 of 4 lights cast them, shadows='lights'"),
        (bright, replace(settings, shadows="all"), 3, "3 of 4 lights cast them, shadows='all'"),
        (of, replace(settings, shadows="off"), 0, "0 of 4 lights cast them, shadows='off'"),
        (unlit, settings, 0, "nothing reflects them"),
    ):
        for method in ("analytic", "stochastic"):
            plan = ready_for(scene_, replace(chosen, method=method), 32, 16).plan
            effect = next(e for e in plan.effects if e.name == "shadows")
            assert (effect.active, effect.reason) == (count > 0, reason)
            named = [option for option in plan.options if "SHADOW" in option]
            assert named == ["-DMB_SHADOWS", f"-DSHADOW_LIGHTS={count}"] * (count > 0)
            assert ("shadow" in plan.stages) == (count > 0 and method == "analytic")
    assert contents(bright) == contents(of, shadows="off")
    assert contents(bright, shadows="all") == contents(of)


def test_triangulated_paths_refuse_shadows():
    with pytest.raises(mb.UsageError, match=r"shadows need paths='exact'.*shadows='off'"):
        film(CASES["both"](), paths="triangulated")
    assert film(CASES["both"](), paths="triangulated", shadows="off").max() > 0.5


def test_masks_see_shadows_too():
    of = CASES["moving caster on static receiver"]()
    exact, masked = film(of), film(of, occlusion=256)
    assert np.sqrt(np.mean((exact - masked) ** 2)) < 1e-3
    assert np.sqrt(np.mean((exact - film(of, shadows="off")) ** 2)) > 0.05


def test_slices_see_shadows_too():
    of = CASES["moving caster on static receiver"]()
    exact = film(of)
    errors = [
        np.sqrt(np.mean((film(of, method="accumulation", slices=n) - exact) ** 2)) for n in (4, 64)
    ]
    assert errors[1] < 0.01
    assert errors[0] > 3.0 * errors[1]


def test_a_scene_of_one_light_and_nothing_else_is_empty():
    for method in ("analytic", "stochastic"):
        assert film(Scene(meshes=[], camera=CAMERA, lights=ALL), method=method).max() == 0.0
