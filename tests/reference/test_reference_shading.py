"""The twin's colours along spans against closed forms."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from support.closed_forms import FACES, UNIT_CAMERA, rectangle, slab, slab_times, world

from mbinterval.exposure.exposure import expose
from mbinterval.scene.model import Light, Material, Mesh, Scene, Texture
from reference import shading
from reference.paths import Intervals
from reference.render import Image, render

SIZE = (32, 16)
UV = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])


def quad(speed: float, material: Material, **attributes: np.ndarray) -> Mesh:
    """A quad over columns 4 to 20 and all rows, moving right; uv run from left and from below."""
    corners = rectangle(4, 20, 0, 16)
    ends = world(np.stack([corners, corners + [speed, 0]]), 2.0, SIZE)
    return Mesh(
        positions=ends if speed else ends[0], faces=FACES, material=material, uv=UV, **attributes
    )


def shot(meshes: list[Mesh], lights: tuple[Light, ...] = (), **options: object) -> Image:
    scene = Scene(meshes=meshes, camera=UNIT_CAMERA, lights=lights)
    return render(expose(scene, 0, 2.0), *SIZE, bits=None, **options)


def textured(image: np.ndarray, wrap: str = "clamp") -> Material:
    return Material(shading="unlit", texture=Texture(image, wrap=wrap))


def ramp() -> np.ndarray:
    """An image whose texel centres hold their own u."""
    u = (np.arange(64) + 0.5) / 64
    return np.broadcast_to(u[None, :, None], (4, 64, 3))


@pytest.mark.parametrize("paths", ["triangulated", "exact"])
def test_a_moving_ramp_shows_the_mean_of_its_visible_part(paths):
    image = shot([quad(9.0, textured(ramp()))], paths=paths, texture_samples=64).rgba[8]
    x = np.arange(32) + 0.5
    t0, t1 = slab_times(x, 4, 20, 9.0)
    u = (x - 4 - 9.0 * (t0 + t1) / 2) / 16
    inner = (u > 0.05) & (u < 0.95) & (t1 > t0)
    assert np.count_nonzero(inner) > 15
    want = (u * (t1 - t0))[inner]
    assert image[inner, 0] == pytest.approx(want, abs=2e-4)
    assert np.abs(image[inner, 0] - (want + 0.01 * 9.0 / 16 * (t1 - t0)[inner])).max() > 2e-3


def test_only_the_part_that_is_left_after_occlusion_is_averaged():
    front = slab(rectangle(-9, 0, -1, 17), (16, 0), 1.0, SIZE, (0, 0, 0))
    image = shot([quad(9.0, textured(ramp())), front], texture_samples=64).rgba[8]
    x = np.arange(32) + 0.5
    hidden = np.clip(x / 16, 0, 1)  # the front slab arrives, and stays long enough
    t0, t1 = slab_times(x, 4, 20, 9.0)
    seen = np.minimum(t1, hidden)
    free = slab_times(x, -9, 0, 16.0)[1] >= 1
    use = free & (seen > t0) & (x > 6)
    u = (x - 4 - 9.0 * (t0 + seen) / 2) / 16
    assert np.count_nonzero(use) > 3
    assert image[use, 0] == pytest.approx((u * (seen - t0))[use], abs=2e-4)


def test_one_sample_of_a_fast_texture_takes_a_level_that_averages_it():
    noise = np.random.default_rng(0).uniform(0, 1, (64, 64, 3))
    mesh = quad(-16.0, textured(noise, "repeat"))
    image = shot([mesh], texture_samples=1).rgba[8]
    assert image[10, :3] / image[10, 3] == pytest.approx(noise.mean((0, 1)), abs=0.15)
    sharp = shot([quad(0.0, textured(noise, "repeat"))], texture_samples=1).rgba[8]
    assert np.abs(sharp[10:18, :3] - noise.mean((0, 1))).max() > 0.2


def test_texture_lookups_hit_texel_centres_with_v_up_and_wrap_as_told():
    image = np.arange(12.0).reshape(3, 4, 1).repeat(3, 2)
    centre = np.array([[0.5 / 4, 1 - 0.5 / 3], [3.5 / 4, 0.5 / 3]])
    outside = np.array([[4.5 / 4, 1 - 0.5 / 3]])
    for wrap, beyond in (("clamp", 3.0), ("repeat", 0.0), ("mirror", 3.0)):
        texture = Texture(image, wrap=wrap)
        found = shading.bilinear(texture.image, texture, centre)
        assert found[:, 0] == pytest.approx([0.0, 11.0], abs=1e-6)
        assert shading.bilinear(texture.image, texture, outside)[0, 0] == pytest.approx(beyond)
        assert shading.bilinear(texture.image, texture, centre[:1] + [1 / 8, 0])[0, 0] == (
            pytest.approx(0.5, abs=1e-6)
        )


@pytest.mark.parametrize("shape", [(8, 4), (5, 7), (1, 3), (1, 1), (6, 1)])
def test_levels_halve_down_to_one_texel_and_keep_a_constant(shape):
    chain = shading.mip_chain(np.full((*shape, 4), 0.25))
    assert chain[-1].shape == (1, 1, 4)
    assert all(np.allclose(level, 0.25) for level in chain)
    for fine, coarse in pairwise(chain):
        assert coarse.shape[:2] == tuple(max(size // 2, 1) for size in fine.shape[:2])
    noise = np.random.default_rng(1).uniform(size=(8, 4, 4))
    assert shading.mip_chain(noise)[-1][0, 0] == pytest.approx(noise.mean((0, 1)))


def test_levels_blend_linearly():
    texture = Texture(np.random.default_rng(2).uniform(0, 1, (8, 8, 3)))
    chain = shading.mip_chain(texture.image)
    uv = np.full((3, 2), 0.3)
    a, b, between = shading.trilinear(chain, texture, uv, np.array([1.0, 2.0, 1.25]))
    assert between == pytest.approx(0.75 * a + 0.25 * b)
    deep = shading.trilinear(chain, texture, uv[:1], np.array([99.0]))[0]
    assert deep == pytest.approx(chain[-1][0, 0])


def test_vertex_colours_are_linear_on_screen_at_equal_depth():
    colors = np.array([[0.0, 1, 0], [1, 1, 0], [1, 0, 0], [0, 0, 0]])
    mesh = quad(8.0, Material(shading="unlit", base_color=(0.5, 1, 1)), color=colors,
                color_domain="vertex")  # fmt: skip
    image = shot([mesh]).rgba
    x = np.arange(12, 20) + 0.5  # covered all the time
    assert image[3, 12:20, 0] == pytest.approx(0.5 * (x - 4 - 4) / 16)
    assert image[:, 15, 1] == pytest.approx((np.arange(16) + 0.5) / 16)


@pytest.mark.parametrize("speed", [0.0, 5.0])
def test_phong_is_ambient_plus_cosine_plus_highlight(speed):
    material = Material(base_color=(0.5, 0.25, 1.0), specular=(0.3, 0.2, 0.1), shininess=7.0)
    lights = (
        Light("ambient", intensity=0.1),
        Light("directional", color=(1, 0.5, 1), intensity=2.0, direction=(1, 0, -1)),
        Light("point", intensity=3.0, position=(0.4, 0.3, 0.0)),
        Light("directional", direction=(0, 0, 1)),  # from behind
    )
    image = shot([quad(speed, material)], lights).rgba[5, 12, :3]
    at = world(np.array([12.5, 5.5]), 2.0, SIZE)
    view, normal = -at / np.linalg.norm(at), np.array([0, 0, 1.0])
    base, want = np.array(material.base_color), 0.1 * np.array(material.base_color)
    for towards, arriving in (
        (np.array([-1, 0, 1]), np.array([2.0, 1.0, 2.0])),
        (np.array([0.4, 0.3, 0.0]) - at, 3.0),
    ):
        distance = np.linalg.norm(towards)
        arriving = arriving / distance**2 if np.isscalar(arriving) else arriving
        towards = towards / distance
        mirrored = 2 * (normal @ towards) * normal - towards
        want = want + arriving * (
            base * (normal @ towards) + np.array(material.specular) * (mirrored @ view) ** 7
        )
    assert image == pytest.approx(want, abs=1e-9)
    assert np.abs(image - 1.01 * want).max() > 1e-3


@pytest.mark.parametrize("inner", [0.0, 20.0, 29.999])
def test_a_spot_light_fades_between_its_angles(inner):
    spot = Light(
        "spot", position=(0.0, 0, 0), direction=(0, 0, -2), inner_angle=inner, outer_angle=30.0
    )
    wall = Mesh(
        positions=world(rectangle(0, 32, 0, 16), 2.0, SIZE),
        faces=FACES,
        material=Material(specular=(0, 0, 0)),
    )
    row = shot([wall], (spot,)).rgba[7, :, 0]
    lamp = shot([wall], (Light("point"),)).rgba[7, :, 0]
    at = world(np.stack([np.arange(32) + 0.5, np.full(32, 7.5)], axis=1), 2.0, SIZE)
    cosine = -at[:, 2] / np.linalg.norm(at, axis=1)
    low, high = np.cos(np.radians([30.0, inner]))
    share = np.clip((cosine - low) / max(high - low, 1e-3), 0, 1) ** 2
    assert np.count_nonzero(share) >= 8
    assert np.count_nonzero(share == 0) >= 4
    assert row == pytest.approx(share * lamp, abs=1e-9)
    assert lamp.min() > 0.01


def test_a_two_sided_surface_is_lit_on_the_viewers_side():
    lights = (Light("directional", direction=(0, 0, -1)),)
    front = quad(0.0, Material(specular=(0, 0, 0)))
    back = Mesh(positions=front.positions, faces=FACES[:, ::-1], material=front.material)
    assert shot([front], lights).rgba[5, 12, :3] == pytest.approx(1.0)
    assert shot([back], lights).rgba[5, 12, :3] == pytest.approx(1.0)


def test_a_turning_normal_is_averaged_over_the_span():
    turned = np.broadcast_to([np.sin(0.8), 0, np.cos(0.8)], (4, 3))
    normals = np.stack([np.broadcast_to([0.0, 0, 1], (4, 3)), turned])
    mesh = quad(1.0, Material(specular=(0, 0, 0)), normals=normals)
    image = shot([mesh], (Light("directional", direction=(0, 0, -1)),), texture_samples=256)
    t = (np.arange(4096) + 0.5) / 4096
    z, x = 1 + t * (np.cos(0.8) - 1), t * np.sin(0.8)
    assert image.rgba[5, 12, 0] == pytest.approx(np.mean(z / np.hypot(x, z)), abs=1e-5)


def test_values_of_intervals_are_linear_between_their_ends():
    one = Intervals(
        np.zeros(1, int), np.zeros(1, int), np.array([[0.2, 0.6]]), np.array([[1.0, 3.0]]),
        np.array([[[0.0], [4.0]]]),
    )  # fmt: skip
    assert one.depth(np.array([0]), np.array([0.3])) == pytest.approx(1.5)
    assert one.values(np.array([0]), np.array([0.3]))[0, 0] == pytest.approx(1.0)
