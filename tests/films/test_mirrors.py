"""Mirror planes: rays of float64, scenes that are reflected by hand, and point samples."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.mirror_rays import BACKGROUND, CAMERA, Surface, scene, traced
from support.mirror_scenes import LIGHTS, flying, mirror, plane, rms, turned
from support.nightly import nightly, nightly_but

import mbinterval as mb
from mbinterval.exposure.asked import Asked
from mbinterval.exposure.exposure import expose
from mbinterval.exposure.mirrors import find_mirrors
from mbinterval.scene.model import Camera, Light, Material, Mesh, Scene, Texture
from mbinterval.scene.tracks import Track
from mbinterval.scene.transforms import Transform

SIZE = (32, 24)
TIMES = 240


def crowd(seed: int = 1) -> list[Surface]:
    """Triangles before the mirror, behind it, across its plane, and behind the eye; a wall."""
    rng = np.random.default_rng(seed)
    before = [flying(rng, [-1.5, -1, -5], [2.5, 1, -2.5], 0.6) for _ in range(10)]
    behind = [flying(rng, [-1.5, -1, -10], [2.5, 1, -7.5], 1.0) for _ in range(5)]
    across = [flying(rng, [-1, -1, -6.5], [1.5, 1, -5.5], 1.2) for _ in range(3)]
    beyond = [flying(rng, [0, -1, 0.5], [4, 1, 4], 0.8) for _ in range(8)]
    wall = Surface(plane(0.0, np.array([0, 0, -9.0]), 3.0), (0.9, 0.1, 0.1))
    screen = Surface(plane(20.0, np.array([3.5, 0, 2.0]), 1.5), (0.1, 0.2, 0.9))
    return [*before, *behind, *across, *beyond, wall, screen]


def two_mirrors() -> list[Surface]:
    """Two that see each other, and glass before them and in them."""
    rng = np.random.default_rng(2)
    glass = [flying(rng, [-1, -1, -5], [2, 1, -2], 1.0) for _ in range(5)]
    glass += [flying(rng, [0, -1, 0.5], [3, 1, 2], 1.5) for _ in range(4)]
    glass = [replace(g, opacity=o) for g, o in zip(glass, rng.uniform(0.2, 0.8, 9), strict=True)]
    other = Surface(plane(-60.0, np.array([-1.8, 0, -5.0]), 1.5), (0.2, 0.5, 0.6),
                    reflectivity=0.7)  # fmt: skip
    return [mirror(0.5), *glass, other, *crowd(3)]


def lit() -> list[Surface]:
    """Triangles that do not turn: normals are blended between the ends of a motion segment."""
    shiny = []
    for k, s in enumerate(crowd(4)):
        shift = (s.corners[:, 1] - s.corners[:, 0]).mean(axis=1, keepdims=True)
        corners = np.stack([s.corners[:, 0], s.corners[:, 0] + shift], axis=1)
        shiny.append(replace(s, corners=corners, lit=True, specular=0.5 * (k % 2)))
    return [mirror(0.8, lit=True), *shiny]


def shaded() -> list[Surface]:
    """Some of those before the mirror, across it and behind the eye, one of glass, and the wall."""
    surfaces = lit()
    few = [surfaces[k] for k in (0, 1, 2, 5, 11, 17, 19, 22, 25, 27)]
    return [*few[:3], replace(few[3], opacity=0.4), *few[4:]]


CASES = {
    "one mirror": (lambda: [mirror(), *crowd()], ()),
    "two mirrors and glass": (two_mirrors, ()),
    "lit": (lit, LIGHTS),
    "shaded": (shaded, [replace(light, shadows=True) for light in LIGHTS[:3]]),
}


def film(of: Scene, size: tuple[int, int] = SIZE, **settings: object) -> mb.Film:
    values = {"samples": 1, "motion_segments": 1} | settings
    return mb.render(of, width=size[0], height=size[1], settings=mb.Settings(**values))


@pytest.fixture(scope="module")
def case(request) -> tuple[str, list[Surface], tuple[Light, ...]]:
    make, lights = CASES[request.param]
    return request.param, make(), lights


@pytest.mark.parametrize("case", nightly_but(CASES, "two mirrors and glass"), indirect=True)
def test_what_mirrors_show_is_what_rays_find(case):
    name, surfaces, lights = case
    of = scene(surfaces, lights)
    found = film(of, shading_error=1e-4).rgba[..., :3]
    truth = traced(surfaces, SIZE, TIMES, lights)
    error = np.abs(found - truth).max(axis=-1)
    print(f"\n{name}: RMSE {rms(found - truth):.1e}, greatest {error.max():.1e}")
    # The rays' own error in time; more where an edge of what rests runs through a centre.
    bound = 2.0 / TIMES
    assert rms(found - truth) < 0.25 / TIMES
    assert (error > bound).mean() < 0.005
    # A mirror that is half a degree off is noticed, and one that shows 3 % less.
    for changed in ({"corners": plane(25.5)}, {"reflectivity": 0.97 * surfaces[0].reflectivity}):
        changed = scene([replace(surfaces[0], **changed), *surfaces[1:]], lights)
        other = film(changed, shading_error=1e-4).rgba[..., :3]
        assert rms(other - truth) > 2 * max(rms(found - truth), 0.25 / TIMES)


@pytest.mark.parametrize("case", nightly_but(CASES, "two mirrors and glass"), indirect=True)
def test_point_samples_see_the_same_in_mirrors(case):
    _, surfaces, lights = case
    of = scene(surfaces, lights)

    def mean(count: int, shown: Scene = of, **values: object) -> np.ndarray:
        return np.mean([film(shown, seed=k, **values).rgba for k in range(count)], axis=0)

    points = mean(4, method="stochastic", samples=2048)
    exact = mean(8, samples=64, pattern="sobol")
    assert rms(points - exact) < 1.5e-3
    assert abs((points - exact).mean()) < 5e-5
    dimmer = replace(surfaces[0], reflectivity=0.9 * surfaces[0].reflectivity)
    control = mean(8, scene([dimmer, *surfaces[1:]], lights), samples=64, pattern="sobol")
    assert rms(points - control) > 3 * rms(points - exact)
    slices = film(of, method="accumulation", slices=64, samples=16).rgba
    assert rms(slices - exact) < 0.01


@pytest.mark.parametrize(
    "cull", ["best", "dual_space", nightly("zmin_strata"), nightly("zmax_strata")]
)
def test_every_culling_method_sees_the_same_bytes_in_mirrors(cull):
    of = scene(two_mirrors())
    ways = {"method": "stochastic", "samples": 20, "seed": 3}
    a, b = film(of, **ways, cull="bbox"), film(of, **ways, cull=cull)
    assert a.rgba.tobytes() == b.rgba.tobytes()
    assert a.depth.tobytes() == b.depth.tobytes()


# Scenes that are reflected by hand

ROUND = np.array([[-9.0, -9, -4], [9, -9, -4], [9, 9, -4], [-9, 9, -4]])
"""All that the camera sees, at z = -4."""


def things(flip: bool) -> list[Mesh]:
    """A picture and a lit swarm, single-sided, behind the eye, or by hand reflected at z = -4."""
    rng = np.random.default_rng(5)
    corners = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    ends = np.stack([corners @ turned(a).T + [0.3, 0, 1.5] for a in (10.0, 60.0)])
    swarm = np.stack([rng.normal(0, 1.5, (24, 3)) + [1.0, 0, 2.5]] * 2)
    swarm[1] += [0.8, 0.3, -0.5]
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    triangles, normals = np.arange(24).reshape(8, 3), rng.normal(size=(24, 3))
    if flip:
        ends, swarm = (p * [1, 1, -1] + [0, 0, -8] for p in (ends, swarm))
        faces, triangles, normals = faces[:, ::-1], triangles[:, ::-1], normals * [1, 1, -1]
    picture = Material(texture=Texture(rng.uniform(0, 1, (8, 8, 3))), shading="unlit")
    uv = [[0, 0], [1, 0], [1, 1], [0, 1]]
    clay = Material(base_color=(0.8, 0.5, 0.3), double_sided=False, specular=(0.3, 0.3, 0.3))
    return [
        Mesh(positions=ends, faces=faces, uv=uv, material=picture),
        Mesh(positions=swarm, faces=triangles, normals=normals, material=clay),
    ]


MOVING_CAMERA = Camera(
    position=Track([0.75, 1.25], [[0.0, 0, 0], [0.3, 0.1, 0.2]]),
    look_at=Track([0.75, 1.25], [[0.0, 0, -1], [0.5, 0.1, -1]]),
    focal_length=30.0, f_stop=2.0, focus_distance=6.0,
)  # fmt: skip


@pytest.mark.parametrize("values", [{"samples": 4}, {"method": "stochastic", "samples": 16}],
                         ids=["exact", "points"])  # fmt: skip
def test_through_a_lens_that_moves_a_mirror_shows_the_scene_behind_it(values):
    """Blurred by what is between: the way to the mirror and on."""
    glass = Mesh(
        positions=ROUND, faces=[[0, 1, 2], [0, 2, 3]],
        material=Material(shading="unlit", reflectivity=1.0),
    )  # fmt: skip
    lights = [replace(light, shadows=True) for light in LIGHTS]
    flipped = [
        replace(light, direction=np.multiply(light.direction, (1, 1, -1)),
                position=np.multiply(light.position, (1, 1, -1)) + [0, 0, -8])
        for light in lights
    ]  # fmt: skip
    plain = Scene(meshes=[glass, *things(False)], camera=MOVING_CAMERA, lights=lights,
                  background=BACKGROUND)  # fmt: skip
    by_hand = replace(plain, meshes=things(True), lights=flipped)
    values = values | {"motion_segments": 2}
    a, b = film(plain, **values), film(by_hand, **values)
    assert rms((a.rgba - b.rgba)[..., :3]) < (2e-5 if "method" not in values else 2e-3)
    assert a.rgba[..., 3] == pytest.approx(1.0, abs=1e-6)
    assert rms(b.rgba - film(replace(by_hand, lights=lights), **values).rgba) > 0.01


# Layers


@pytest.fixture(scope="module")
def layered() -> tuple[mb.Film, list[Surface]]:
    surfaces = two_mirrors()
    aovs = "sharp,depth,object,normal,forward,crypto_object,deep,events"
    return film(scene(surfaces), aovs=aovs, aov_time=0.5, samples=2), surfaces


def test_layers_show_the_mirror_itself(layered):
    found, surfaces = layered
    bare = film(scene([replace(s, reflectivity=0.0) for s in surfaces]), samples=2,
                aovs="depth,object,normal,forward,crypto_object", aov_time=0.5)  # fmt: skip
    mirrors = np.isin(found.layers["object"], [1, 11])
    assert 0.1 < mirrors.mean() < 0.9
    for name in ("depth", "object", "normal", "forward"):
        assert np.array_equal(found.layers[name], bare.layers[name], equal_nan=True)
    # Glass before a mirror hides as much of it as without.
    assert found.rgba[..., 3] == pytest.approx(bare.rgba[..., 3], abs=2e-6)
    assert found.depth == pytest.approx(bare.depth, rel=0.02)  # by the middles of other spans
    ids = found.layers["crypto_object"], bare.layers["crypto_object"]
    for index in range(len(surfaces)):
        shares = [_share_of(layer, f"object {index + 1}") for layer in ids]
        assert shares[0] == pytest.approx(shares[1], abs=1e-5)


def _share_of(layer: np.ndarray, name: str) -> np.ndarray:
    from mbinterval.film.cryptomatte import id_of

    ids, shares = layer[..., 0::2], layer[..., 1::2]
    mine = np.ascontiguousarray(ids).view(np.uint32) == np.uint32(id_of(name))
    return np.where(mine, shares, 0.0).sum(axis=-1)


def test_events_and_deep_images_have_the_light_of_mirrors(layered):
    found, _ = layered
    behind = (1 - found.rgba[..., 3:]) * BACKGROUND
    want = np.concatenate([found.rgba[..., :3] - behind, found.rgba[..., 3:]], axis=-1)
    assert found.events.integrate(0.0, 1.0) == pytest.approx(want, abs=2e-5)
    assert found.deep.flatten() == pytest.approx(want, abs=2e-5)
    objects = np.unique(found.events["object"])
    assert {1, 11} <= set(objects.tolist()) <= set(range(1, 40))


def test_the_sharp_frame_has_mirrors_as_they_are_then(layered):
    found, surfaces = layered

    def frozen(s: Surface) -> Surface:
        middle = s.corners.mean(axis=1, keepdims=True)
        return replace(s, corners=np.repeat(middle, 2, axis=1))

    at_rest = film(scene([frozen(s) for s in surfaces]), samples=2).rgba
    differ = np.abs(found.layers["sharp"] - at_rest).max(axis=-1) > 1e-4
    assert differ.mean() < 0.01


# Backgrounds


def before_an_image() -> tuple[Scene, np.ndarray]:
    """A mirror that sees nothing, and the background's image."""
    rng = np.random.default_rng(6)
    image = rng.uniform(0, 1, (SIZE[1], SIZE[0], 3)).astype(np.float32)
    return replace(scene([mirror(0.5)]), background=image), image


def test_a_mirror_that_sees_nothing_shows_the_background_of_its_pixel():
    of, image = before_an_image()
    found = film(of).rgba
    seen = np.abs(found[..., :3] - image).max(axis=-1) > 0.01
    assert 0.2 < seen.mean() < 0.8
    want = np.where(seen[..., None], 0.5 * image + 0.5 * np.array([0.9, 0.8, 0.1]), image)
    assert found[..., :3] == pytest.approx(want, abs=1e-6)
    assert np.array_equal(found[..., 3], seen)
    points = film(of, method="stochastic", samples=4, pattern="fixed").rgba
    inside = points[..., 3] == found[..., 3]
    assert inside.mean() > 0.8
    assert points[inside] == pytest.approx(found[inside], abs=1e-5)
    # A film without background has it in its mirrors.
    clear = film(of, transparent=True).rgba
    assert clear[..., :3] == pytest.approx(want * seen[..., None], abs=1e-6)


@pytest.mark.parametrize(
    ("values", "left"),
    [({"samples": 1, "filter": "five_point"}, 9),
     nightly({"method": "stochastic", "samples": 4, "pattern": "rgss"}, 0)],
    ids=["five points", "rgss"],
)  # fmt: skip
def test_a_part_of_a_frame_has_its_own_part_of_the_background_in_mirrors(values, left):
    of, _ = before_an_image()
    whole, settings = film(of, **values).rgba, mb.Settings(**values)
    part = mb.render(of, width=SIZE[0], height=SIZE[1], settings=settings, crop=(left, 5, 13, 8))
    assert np.array_equal(part.rgba, whole[5:13, left : left + 13])


# What is refused, and what is left out


def glassy(positions: np.ndarray, **fields: object) -> Mesh:
    material = Material(shading="unlit", **{"reflectivity": 0.5} | fields)
    return Mesh(positions=positions, faces=[[0, 1, 2], [0, 2, 3]], material=material, name="pool")


@pytest.mark.parametrize(
    ("mesh", "words"),
    [
        (glassy(ROUND + [[0, 0, 0.1], [0, 0, 0], [0, 0, 0], [0, 0, 0]]), "off one plane"),
        (glassy(np.stack([ROUND, ROUND + [0, 0, 0.1]])), "moves while the shutter is open"),
        (glassy(ROUND * [1, 0, 0]), "no area"),
        (glassy(ROUND, opacity=0.5), "translucent"),
        (glassy(ROUND, alpha_mode="mask"), "translucent"),
    ],
)
def test_what_is_no_mirror_is_refused_by_name(mesh, words):
    with pytest.raises(mb.SceneError, match=words) as error:
        film(Scene(meshes=[mesh], camera=CAMERA))
    assert "mesh 'pool'" in str(error.value)
    assert "leave" in str(error.value) or "reflectivity" in str(error.value)


@pytest.mark.parametrize(
    "values", [{"paths": "triangulated"}, {"occlusion": 64}], ids=str,
)  # fmt: skip
def test_what_does_not_go_with_mirrors_is_refused(values):
    of = Scene(meshes=[mirror(lit=True).mesh], camera=CAMERA, lights=LIGHTS)
    with pytest.raises(mb.UsageError, match="mirrors"):
        film(of, **values)


def test_a_mirror_may_move_within_its_plane_and_its_mesh_without_blur():
    spin = Transform(rotation=Track([0.5, 1.5], [[0, 0, 0, 1], [0, 0, 1, 0]], quaternion=True))
    turning = replace(glassy(ROUND), transform=spin)
    slid = glassy(np.stack([ROUND, ROUND + [3, 1, 0]]))
    frozen = replace(glassy(np.stack([ROUND, ROUND + [0, 0, 1]])), motion_blur=False)
    for mesh in (turning, slid, frozen):
        found = expose(Scene(meshes=[mesh], camera=CAMERA), 1.0, 1.0)
        assert len(found.mirrors) == 1
        assert abs(found.mirrors[0].normal[2]) == pytest.approx(1.0)
    swing = Transform(rotation=Track([0.5, 1.5], [[0, 0, 0, 1], [0, 1, 0, 0]], quaternion=True))
    swinging = replace(glassy(ROUND), transform=swing, motion_blur=False)
    for frame in (0.75, 1.25):  # half a turn each frame
        found = expose(Scene(meshes=[swinging], camera=CAMERA), frame, 1.0)
        angle = np.pi * (frame - 0.5)
        normal = found.mirrors[0].normal
        assert abs(normal @ [np.sin(angle), 0, np.cos(angle)]) == pytest.approx(1.0)


def test_a_mesh_has_as_many_motion_segments_in_mirrors_as_outside():
    """So that what is seen in a mirror lies where it is shaded."""
    spin = Transform(rotation=Track([0.5, 1.5], [[0, 0, 0, 1], [0, 1, 0, 0]], quaternion=True))
    corners = np.array([[0.0, -1, 0], [0.5, -1, 0], [0, 1, 0]])
    for away in (-2.0, -40.0, 1.0):
        wing = Mesh(positions=corners, faces=[[0, 1, 2]], name="wing",
                    transform=replace(spin, translation=(0, 0, away)))  # fmt: skip
        of = Scene(meshes=[glassy(ROUND), wing], camera=CAMERA)
        found = expose(of, 1.0, 1.0, Asked(error=0.05), height=200).meshes
        wings = {mesh.world: mesh for mesh in found if mesh.mesh.name == "wing"}
        assert wings[0].segments > 1
        assert len({mesh.segments for mesh in wings.values()}) == 1
        assert 1 in wings or away == -40.0


def test_only_what_may_be_behind_a_mirror_is_reflected():
    surfaces = [mirror(), *crowd()]
    found = expose(scene(surfaces), 1.0, SIZE[0] / SIZE[1], Asked(segments=1))
    plane_of = found.mirrors[0]
    real = [m for m in found.meshes if not m.world]
    seen = {m.index: m for m in found.meshes if m.world}
    side = np.sign(plane_of.heights(np.zeros(3)))
    for mesh in real:
        ahead = (side * plane_of.heights(mesh.positions) > 1e-9).any()
        assert (mesh.index in seen) == (ahead and mesh.index != 0)
    assert 0 < len(seen) < len(real) - 1
    assert find_mirrors(real[1:]) == ()
