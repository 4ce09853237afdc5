"""Environments: their light on surfaces, what metals mirror of them, and what cameras see of them.

Against closed forms and sums over directions, exact time against point samples.
"""

from __future__ import annotations

import struct
from dataclasses import replace

import numpy as np
import pytest
from support.environments import (
    around,
    environment,
    hemisphere,
    metallic_roughness,
    smooth,
    stripes,
)
from support.nightly import nightly, nightly_but

import mbinterval as mb
from mbinterval.comparison.verdict import Repeats, judge
from mbinterval.device.runtime import runtime
from mbinterval.rendering import cube_maps
from mbinterval.scene.primitives import PRIMITIVES

SIZE = (24, 16)
FOV = 40.0
MATT = mb.Material("matt", specular=(0, 0, 0))
GOLD = (0.9, 0.6, 0.3)
METHODS = ("analytic", "stochastic")
FEWER = ("analytic", nightly("stochastic"))
"""Of what other tests have of point samples too."""


def film(of: mb.Scene, size: tuple[int, int] = SIZE, **values: object) -> mb.Film:
    settings = mb.Settings(**{"samples": 4, **values})
    return mb.render(of, frame=0, width=size[0], height=size[1], settings=settings)


def metal(metallic: float, roughness: float) -> mb.Material:
    return mb.Material("metal", shading="metallic_roughness", base_color=GOLD, metallic=metallic,
                       roughness=roughness)  # fmt: skip


def plate(material: mb.Material, turn: float = 0.0) -> mb.Mesh:
    """All that the camera sees, around the origin, turned about +y by so many degrees."""
    c, s = np.cos(np.radians(turn)), np.sin(np.radians(turn))
    across, up = np.array([c, 0.0, -s]), np.array([0.0, 1.0, 0.0])
    corners = [x * across + y * up for x, y in ((-9, -9), (9, -9), (9, 9), (-9, 9))]
    return mb.Mesh(positions=np.array(corners), faces=[[0, 1, 2], [0, 2, 3]], material=material)


def still(material: mb.Material, around: mb.Environment, turn: float = 0.0) -> mb.Scene:
    """The plate, and out of sight what makes the kernel the same for all materials."""
    hidden = [
        mb.Mesh(positions=np.eye(3) + [0, 0, 9.0], faces=[[0, 1, 2]], material=other)
        for other in (MATT, metal(1.0, 0.5))
    ]
    camera = mb.Camera(position=(0, 0, 4), look_at=(0, 0, 0), fov=FOV)
    return mb.Scene(meshes=[plate(material, turn), *hidden], camera=camera, environment=around)


def rays(size: tuple[int, int] = SIZE) -> np.ndarray:
    """Unit directions ``(h, w, 3)`` through the middles of pixels, looking along -Z."""
    height = 2.0 * np.tan(np.radians(FOV / 2.0))
    x = (np.arange(size[0]) + 0.5 - size[0] / 2.0) / size[1] * height
    y = -(np.arange(size[1]) + 0.5 - size[1] / 2.0) / size[1] * height
    ways = np.stack(np.broadcast_arrays(x, y[:, None], -1.0), axis=-1)
    return ways / np.linalg.norm(ways, axis=-1, keepdims=True)


# Light on surfaces


@pytest.mark.parametrize("method", FEWER)
def test_light_that_is_the_same_from_everywhere_is_what_a_white_wall_scatters(method):
    found = film(still(MATT, environment(lambda d: 0.0 * d + 0.7)), method=method).rgba
    assert np.abs(found[..., :3] - 0.7).max() < 3e-4
    assert (found[..., 3] == 1.0).all()


@pytest.mark.parametrize(("metallic", "roughness"), [(1.0, 0.3), (1.0, 1.0), (0.0, 0.4)])
def test_it_is_reflected_as_the_sum_over_all_directions(metallic, roughness):
    """A plate seen at 55 degrees: the model times the cosine, summed over the hemisphere."""
    of = still(metal(metallic, roughness), environment(lambda d: 0.0 * d + 0.7), 55.0)
    found = film(of, (3, 3), samples=1).rgba[1, 1, :3]
    ways, angles = hemisphere(500)
    view = np.array([np.sin(np.radians(55.0)), 0.0, np.cos(np.radians(55.0))])
    reflected = metallic_roughness(view, ways, np.array(GOLD), metallic, roughness)
    expected = 0.7 * ((ways[:, 2] * angles) @ reflected)
    assert found == pytest.approx(expected, abs=3e-3)
    assert found != pytest.approx(1.02 * expected, abs=3e-3)


def test_irradiance_is_the_integral_over_directions():
    made = environment(smooth, 256)
    normals = cube_maps.directions(4).reshape(-1, 3)
    found = cube_maps.irradiance(made, normals)
    ways, angles = hemisphere(120)
    weights = ways[:, 2] * angles / np.pi
    expected = np.array([weights @ smooth(around(n, ways)) for n in normals])
    assert np.abs(found - expected).max() < 5e-4
    turned = cube_maps.irradiance(replace(made, rotation=2.0), normals)
    assert np.abs(turned - expected).max() > 5e-3


def test_a_small_lamp_lights_walls_from_where_it_is():
    """One pixel of a fine image: a cosine, in closed form."""
    pixels = np.zeros((512, 1024, 3))
    pixels[150, 300] = 1e4
    lamp = mb.Environment(pixels, rotation=25.0)
    up = (0.5 - 150.5 / 512) * np.pi
    turn = (300.5 / 1024 - 0.5) * 2.0 * np.pi - np.radians(25.0)
    way = np.array([np.cos(up) * np.sin(turn), np.sin(up), -np.cos(up) * np.cos(turn)])
    angle = 2.0 * np.pi / 1024 * (np.sin(up + 0.5 * np.pi / 512) - np.sin(up - 0.5 * np.pi / 512))
    normals = cube_maps.directions(4).reshape(-1, 3)
    expected = 1e4 * angle / np.pi * np.maximum(normals @ way, 0.0)
    assert expected.max() > 0.05
    found = cube_maps.irradiance(lamp, normals)
    assert np.abs(found - expected[:, None]).max() < 1e-9


def lobe_points(alpha: float, count: int, seed: int) -> np.ndarray:
    """Directions that GGX facets mirror a view along +z in, drawn at random by the distribution."""
    rng = np.random.default_rng(seed)
    part, turn = rng.random(count), 2.0 * np.pi * rng.random(count)
    up = np.sqrt((1.0 - part) / (1.0 + (alpha**2 - 1.0) * part))
    out = np.sqrt(1.0 - up**2)
    half = np.stack([out * np.cos(turn), out * np.sin(turn), up], axis=-1)
    return 2.0 * up[:, None] * half - [0.0, 0.0, 1.0]


def test_levels_are_what_rough_facets_mirror():
    """Against random facets, of which the error is known."""
    made = environment(smooth, 256)
    maps = cube_maps.gather(runtime(), made, [])
    row, worst = maps.maps[0], 0.0
    levels = int(row["levels"])
    assert list(row["size"][:levels]) == [163, 128, 64, 32, 16, 8, 8]
    for level in range(1, levels):
        size, alpha = int(row["size"][level]), 0.5 ** (levels - 1 - level)
        count = cube_maps.texel_count(size)
        texels = maps.texels[row["first"][level] :][:count, :3]
        normals = cube_maps.directions(size).reshape(-1, 3)
        ways = lobe_points(alpha, 40_000, level)
        weights = np.maximum(ways[:, 2], 0.0)
        for place in np.linspace(0, count - 1, 12).astype(int):
            light = smooth(around(normals[place], ways))
            expected = weights @ light / weights.sum()
            noise = np.sqrt(weights**2 @ (light - expected) ** 2) / weights.sum()
            away = np.abs(texels[place] - expected)
            assert (away < 4.0 * noise + (0.02 if level == 1 else 0.012)).all(), (level, place)
            worst = max(worst, float((noise / np.maximum(expected, 0.05)).max()))
    assert worst < 0.03


def test_faces_of_a_cube_share_their_edges():
    maps = cube_maps.gather(runtime(), environment(smooth, 64), [])
    row = maps.maps[0]
    for level in range(int(row["levels"])):
        size = int(row["size"][level])
        texels = maps.texels[row["first"][level] :][: cube_maps.texel_count(size), :3]
        ways = cube_maps.directions(size).reshape(-1, 3).round(6) + 0.0
        _, place, count = np.unique(ways, axis=0, return_inverse=True, return_counts=True)
        assert sorted(np.unique(count)) == [1, 2, 3]
        for channel in texels.T:
            least, most = np.full(len(count), np.inf), np.full(len(count), -np.inf)
            np.minimum.at(least, place.ravel(), channel)
            np.maximum.at(most, place.ravel(), channel)
            assert (most - least).max() < 5e-3
            assert np.ptp(channel) > 0.1


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("rotation", [0.0, 70.0])
def test_a_mirror_shows_the_environment_that_is_turned_and_scaled(method, rotation):
    made = environment(smooth, 256, intensity=2.0, rotation=rotation)
    found = film(still(metal(1.0, 0.0), made, 35.0), method=method, samples=16).rgba[..., :3]
    normal = np.array([np.sin(np.radians(35.0)), 0.0, np.cos(np.radians(35.0))])
    ways = rays()
    cosine = -(ways @ normal)[..., None]
    mirrored = ways + 2.0 * cosine * normal
    fresnel = np.array(GOLD) + (1.0 - np.array(GOLD)) * (1.0 - cosine) ** 5
    c, s = np.cos(np.radians(-rotation)), np.sin(np.radians(-rotation))
    back = mirrored @ np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]]).T
    expected = 2.0 * fresnel * smooth(back)
    assert np.abs(found - expected).max() < 0.02
    assert np.sqrt(np.mean((found - expected) ** 2)) < 4e-3
    askew = smooth(back @ [[1.0, 0.0, 0.05], [0.0, 1.0, 0.0], [-0.05, 0.0, 1.0]])
    assert np.sqrt(np.mean((found - 2.0 * fresnel * askew) ** 2)) > 0.02


# Behind everything


def looking(degrees: float, rolls: bool = False) -> mb.Camera:
    """A camera that turns evenly to the right, or rolls, by so much over the exposure."""
    frames = np.linspace(-0.5, 0.5, 61)
    turn = np.radians(degrees) * frames
    side, front, none = np.sin(turn), np.cos(turn), 0.0 * turn
    if rolls:
        return mb.Camera(look_at=(0, 0, -1), up=mb.Track(frames, np.stack([side, front, none], 1)),
                         fov=FOV)  # fmt: skip
    return mb.Camera(look_at=mb.Track(frames, np.stack([side, none, -front], 1)), fov=FOV)


def empty(camera: mb.Camera, around: mb.Environment, **fields: object) -> mb.Scene:
    return mb.Scene(meshes=[], camera=camera, environment=around,
                    shutter=mb.Shutter(-0.5, 0.5), **fields)  # fmt: skip


@pytest.mark.parametrize("method", METHODS)
def test_a_camera_that_turns_sees_the_mean_of_what_passes(method):
    """Stripes of a sine that turn by 80 degrees, in closed form."""
    samples = 16 if method == "analytic" else 1024
    found = film(empty(looking(80.0), environment(stripes, 256)), method=method, samples=samples)
    turn = np.arctan2(rays()[..., 0], -rays()[..., 2])

    def mean(degrees: float) -> np.ndarray:
        half = 1.5 * np.radians(degrees)
        return 0.5 + 0.4 * np.sin(3.0 * turn + 0.3) * np.sin(half) / half

    assert np.abs(found.rgba[..., 0] - mean(80.0)).max() < (1e-3 if method == "analytic" else 5e-3)
    assert np.abs(found.rgba[..., 0] - mean(82.0)).max() > 7e-3
    assert (found.rgba[..., 3] == 0.0).all()
    assert np.isinf(found.depth).all()


def lamps(d: np.ndarray) -> np.ndarray:
    """Bright stripes with sudden edges."""
    bright = np.sin(9.0 * np.arctan2(d[..., 0], -d[..., 2])) > 0.3
    return np.where(bright[..., None], 9.0, 0.1) * [1.0, 0.8, 0.5]


def test_lamps_that_pass_are_averaged_as_exactly_as_shading_error_asks():
    """Against point samples, whose noise is known from their repeats."""
    of = empty(looking(12.0), environment(lamps, 64))
    repeats = [film(of, method="stochastic", samples=1024, seed=k).rgba for k in range(4)]
    points, noise = np.mean(repeats, axis=0), float(np.std(repeats, axis=0, ddof=1).max()) / 2.0
    found = film(of, samples=64, pattern="sobol").rgba
    assert np.abs(found - points).max() < 0.01 + 4.0 * noise
    assert noise < 0.01
    finest, usual, coarse = (film(of, samples=1, shading_error=e).rgba for e in (1e-5, 2e-3, 0.5))
    assert np.abs(usual - finest).max() < 2e-3
    assert np.abs(coarse - finest).max() > 8e-3


@pytest.mark.parametrize("method", METHODS)
def test_a_camera_that_rolls_sees_the_mean_over_its_roll(method):
    samples = 16 if method == "analytic" else 1024
    found = film(empty(looking(60.0, True), environment(smooth, 256)), method=method,
                 samples=samples).rgba  # fmt: skip

    def mean(degrees: float) -> np.ndarray:
        sums = 0.0
        for turn in np.radians(degrees) * ((np.arange(400) + 0.5) / 400 - 0.5):
            c, s = np.cos(turn), np.sin(turn)
            sums += smooth(rays() @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]))
        return sums / 400

    assert np.sqrt(np.mean((found[..., :3] - mean(60.0)) ** 2)) < 2.5e-3
    assert np.sqrt(np.mean((found[..., :3] - mean(66.0)) ** 2)) > 4e-3


def test_a_lens_blurs_what_is_infinitely_far_by_its_circle_of_confusion():
    """The mean over a disc as wide as the lens is in the plane that is in focus."""
    wide = {"fov": None, "focal_length": 24.0 / (2.0 * np.tan(np.radians(FOV / 2.0))),
            "f_stop": 0.025, "focus_distance": 2.0}  # fmt: skip
    camera = replace(mb.Camera(look_at=(0, 0, -1)), **wide)
    found = film(empty(camera, environment(stripes, 256)), samples=256, pattern="sobol").rgba
    radius = 0.5 * camera.focal_length / 1000.0 / camera.f_stop / camera.focus_distance

    def mean(radius: float) -> np.ndarray:
        places = (np.stack(np.meshgrid(*[(np.arange(40) + 0.5) / 20 - 1] * 2), -1)).reshape(-1, 2)
        places = radius * places[(places**2).sum(axis=1) < 1.0]
        flat = rays() / -rays()[..., 2:]
        sums = sum(stripes(flat + [x, y, 0.0]) for x, y in places)
        return sums / len(places)

    assert radius > 0.3
    assert np.abs(found[..., :3] - mean(radius)).max() < 5e-3
    assert np.abs(found[..., :3] - mean(0.8 * radius)).max() > 1e-2


def before(speed: float = 1.0, glass: bool = False, **fields: object) -> mb.Scene:
    """A metal ball, or a glass triangle, that moves before stripes while the camera turns."""
    if glass:
        corners = np.array([[-1.0, -0.5, -2.0], [0.2, -0.5, -2.0], [-0.4, 0.6, -2.0]])
        material = mb.Material("glass", shading="unlit", base_color=GOLD, opacity=0.4)
        moving = mb.Mesh(positions=np.stack([corners, corners + [speed, 0, 0]]), faces=[[0, 1, 2]],
                         material=material)  # fmt: skip
    else:
        track = mb.Track(np.array([-0.5, 0.5]), speed * np.array([[-0.4, 0.0, -2.0], [0.4, 0, -2]]))
        ball = PRIMITIVES["sphere"](radius=0.35)
        moving = replace(ball, material=metal(0.7, 0.2), transform=mb.Transform(translation=track))
    of = empty(looking(30.0), environment(smooth, 64))
    return replace(of, meshes=[moving], **fields)


CASES = {
    "metal": {},
    "glass": {
        "glass": True,
        "shutter": mb.Shutter(-0.5, 0.5, curve="triangle", rolling="down",
                              line_offset=1 / 24 / 64, line_exposure=0.03),
    },
}  # fmt: skip


@pytest.mark.parametrize("name", nightly_but(CASES, "glass"))
def test_exact_time_and_point_samples_agree(name):
    """By the statistical verdict; motion that is a twentieth too fast is told apart."""

    def repeats(of: mb.Scene, **values: object) -> list[np.ndarray]:
        return [film(of, seed=seed, **values).rgba for seed in range(8)]

    of, exact = before(**CASES[name]), {"samples": 16, "pattern": "sobol"}
    points = {"method": "stochastic", "samples": 256, "cull": "bbox"}
    sampled = Repeats(repeats(of, **points))
    same = judge(Repeats(repeats(of, **exact)), sampled)
    assert same is not None
    assert same.explained, str(same)
    wrong = judge(Repeats(repeats(before(1.1, **CASES[name]), **exact)), sampled)
    assert wrong is not None
    assert not wrong.explained


WAYS = {
    "mask": {"occlusion": 64},
    "triangulated": {"paths": "triangulated", "occlusion": 128},
    "five points": {"samples": 1, "filter": "five_point"},
    "negative lobes": {"samples": 8, "filter": "mitchell", "pattern": "sobol"},
    "rgss": {"method": "stochastic", "pattern": "rgss"},
    "points, negative lobes": {"method": "stochastic", "samples": 8, "filter": "mitchell"},
}


@pytest.mark.parametrize(
    "way", [nightly(way) if way in ("triangulated", "negative lobes") else way for way in WAYS]
)
def test_with_the_colour_of_what_it_is_behind_nothing_is_seen(way):
    """No light is lost or counted twice where surfaces and environment share a pixel."""
    corners = np.array([[-1.0, -0.5, -2.0], [0.2, -0.5, -2.0], [-0.4, 0.6, -2.0]])
    moving = mb.Mesh(positions=np.stack([corners, corners + [0.8, 0.1, 0]]), faces=[[0, 1, 2]],
                     color=(0.7, 0.7, 0.7), shading="unlit")  # fmt: skip
    of = empty(looking(30.0), environment(lambda d: 0.0 * d + 0.7, 8))
    found = film(replace(of, meshes=[moving]), **WAYS[way]).rgba
    assert np.ptp(found[..., 3]) > 0.5
    assert np.abs(found[..., :3] - 0.7).max() < 1e-5


def test_it_is_background_to_all_that_is_made_of_surfaces():
    of = before()
    asked = ("sharp", "depth", "crypto_object")
    found = film(of, aovs=asked)
    alone = film(replace(of, environment=replace(of.environment, background=False)), aovs=asked)
    assert np.array_equal(found.rgba[..., 3], alone.rgba[..., 3])
    assert np.array_equal(found.depth, alone.depth)
    assert np.array_equal(found.intervals, alone.intervals)
    for name in ("depth", "crypto_object"):
        assert np.array_equal(found.layers[name], alone.layers[name])
    open_ = found.rgba[..., 3] == 0.0
    assert 0.1 < open_.mean() < 0.9
    assert found.rgba[..., :3][open_].max() > 0.1
    assert alone.rgba[..., :3][open_].max() == 0.0
    assert np.array_equal(
        found.rgba[found.rgba[..., 3] == 1.0], alone.rgba[alone.rgba[..., 3] == 1.0]
    )
    sharp = found.layers["sharp"]
    assert sharp[sharp[..., 3] == 0.0][:, :3].max() > 0.1
    moment = film(replace(of, meshes=[], camera=mb.Camera(look_at=(0, 0, -1), fov=FOV))).rgba
    seen = (sharp[..., 3] == 0.0) & (alone.layers["sharp"][..., 3] == 0.0)
    assert np.abs(sharp - moment)[seen].max() < 2e-3


@pytest.mark.parametrize("method", FEWER)
def test_what_rests_and_casts_shadows_is_laid_over_it(method):
    made = environment(lambda d: 0.0 * d + 0.7, 8)
    sun = mb.Light("directional", direction=(-1, -1, -1), shadows=True)
    ball = replace(PRIMITIVES["sphere"](radius=0.5), material=MATT)
    camera = mb.Camera(position=(0, 0, 3), look_at=(0, 0, 0), fov=FOV)
    of = mb.Scene(meshes=[ball], camera=camera, lights=[sun], environment=made)
    found = film(of, method=method).rgba
    alone = film(replace(of, environment=replace(made, background=False)), method=method).rgba
    assert np.array_equal(found[..., 3], alone[..., 3])
    assert 0.0 < alone[..., 3].mean() < 1.0
    over = alone[..., :3] + 0.7 * (1.0 - alone[..., 3:])
    assert np.abs(found[..., :3] - over).max() < 2e-6


def test_a_transparent_film_leaves_it_out_but_keeps_its_light():
    of = before()
    clear = film(of, transparent=True).rgba
    assert clear[clear[..., 3] == 0.0].max() == 0.0
    assert clear[clear[..., 3] == 1.0][:, :3].max() > 0.1


# Files


def written(pixels: np.ndarray, runs: bool) -> bytes:
    """A Radiance picture of float pixels, by the layout of Ward's programs."""
    largest = pixels.max(axis=2)
    fraction, exponent = np.frexp(largest)
    scale = np.where(largest > 0, fraction * 256.0 / np.where(largest > 0, largest, 1.0), 0.0)
    body = np.empty((*pixels.shape[:2], 4), np.uint8)
    body[..., :3] = pixels * scale[..., None]
    body[..., 3] = np.where(largest > 0, exponent + 128, 0)
    head = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y %d +X %d\n" % pixels.shape[:2]
    if not runs:
        return head + body.tobytes()
    width, rows = pixels.shape[1], []
    for row in body:
        rows.append(struct.pack(">BBH", 2, 2, width))
        for channel in row.T:
            same = bytes([128 + 5, channel[0]]) if (channel[:5] == channel[0]).all() else b""
            rest = channel[5:] if same else channel
            rows.append(same + bytes([len(rest)]) + rest.tobytes())
    return head + b"".join(rows)


@pytest.mark.parametrize("runs", [False, True])
def test_radiance_pictures_are_read(runs, tmp_path):
    pixels = np.random.default_rng(0).uniform(0.0, 1.0, (8, 16, 3)) * [[[40.0, 1.0, 0.01]]]
    pixels[2, :7], pixels[3, 3] = 2.5, 0.0
    (tmp_path / "sky.hdr").write_bytes(written(pixels, runs))
    found = mb.read_image(tmp_path / "sky.hdr")
    assert found.dtype == np.float32
    assert (np.abs(found - pixels) <= pixels.max(axis=2, keepdims=True) / 127).all()
    assert (found[3, 3] == 0.0).all()
    for damaged in (written(pixels, runs)[:-5], b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 9"):
        (tmp_path / "sky.hdr").write_bytes(damaged)
        with pytest.raises(mb.SceneError, match=r"sky\.hdr"):
            mb.read_image(tmp_path / "sky.hdr")


def test_a_scene_file_names_its_environment(tmp_path):
    (tmp_path / "sky.hdr").write_bytes(written(np.full((4, 8, 3), 0.5), False))
    table = {"environment": {"file": "sky.hdr", "intensity": 2.0, "rotation": 30.0,
                             "background": False}}  # fmt: skip
    made = mb.load(table, tmp_path).environment
    assert made is not None
    assert made.image.shape == (4, 8, 3)
    assert (made.intensity, made.rotation, made.background) == (2.0, 30.0, False)
    assert list(mb.load_file(table, tmp_path).files) == [tmp_path / "sky.hdr"]


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({"file": "none.hdr"}, r"environment\.file: file not found: tried .*none\.hdr"),
        ({"file": "square.hdr"}, r"environment\.file: .*square\.hdr.* has 8 x 8 pixels; expected"),
        ({"file": "text.hdr"}, r"environment\.file: .*text\.hdr: not a Radiance picture"),
        ({"intensity": 2.0}, r"environment\.file: "),
        ({"file": "sky.hdr", "intensity": -1.0}, r"environment\.intensity: "),
        ({"file": "sky.hdr", "rotate": 1.0}, r"environment\.rotate: "),
    ],
)
def test_mistakes_in_a_scene_file_are_told_with_file_and_field(table, message, tmp_path):
    (tmp_path / "sky.hdr").write_bytes(written(np.full((4, 8, 3), 0.5), False))
    (tmp_path / "square.hdr").write_bytes(written(np.full((8, 8, 3), 0.5), False))
    (tmp_path / "text.hdr").write_bytes(b"#?RADIANCE\nFORMAT=32-bit_rle_xyze\n\n-Y 4 +X 8\n")
    with pytest.raises(mb.SceneError, match=message):
        mb.load({"environment": table}, tmp_path)


def test_mistakes_in_python_are_told():
    dark, broken = np.ones((4, 8, 3)), np.ones((4, 8, 3))
    dark[1, 2, 0], broken[1, 2, 0] = -0.5, np.nan
    with pytest.raises(mb.SceneError, match="first below 0 at row 1, column 2"):
        mb.Environment(dark)
    with pytest.raises(mb.SceneError, match=r"environment: image.* at pixel \(row 1, column 2\)"):
        mb.Environment(broken)
    with pytest.raises(mb.SceneError, match="twice as many columns"):
        mb.Environment(np.ones((4, 4, 3)))
    with pytest.raises(mb.SceneError, match="environment: image times intensity is up to 1e\\+31"):
        mb.Environment(np.ones((4, 8, 3)), intensity=1e31)
    with pytest.raises(mb.SceneError, match="environment: rotation"):
        mb.Environment(np.ones((4, 8, 3)), rotation="left")
    with pytest.raises(mb.SceneError, match="scene: environment"):
        mb.Scene(meshes=[], environment=np.ones((4, 8, 3)))
