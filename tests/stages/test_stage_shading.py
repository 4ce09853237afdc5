"""Texture look-up and Phong's model (cl/shared/shading.h) against the twin's."""

from __future__ import annotations

import numpy as np
import pytest
from reference import shading as twin
from support.kernels import run

from mbinterval.layout.appearance import appearance
from mbinterval.scene.model import WRAPS, Light, Material, Texture


def blended(texture: Texture) -> Material:
    return Material(texture=texture, alpha_mode="blend")


def looked_up(texture: Texture, uv: np.ndarray, level: np.ndarray) -> np.ndarray:
    """Texels ``(M, 4)`` at ``uv`` and ``level``; another texture stands before it in the pool."""
    other = Material(texture=Texture(np.full((3, 5, 3), 1e9)))
    tables = appearance([other, blended(texture)], ())
    arrays = [
        tables.texels, tables.textures[1:], uv.astype(np.float32), level.astype(np.float32),
        np.uint32(len(uv)), np.zeros((len(uv), 4), np.float32),
    ]  # fmt: skip
    return run("shading.cl", "lookups", arrays, ["-DMB_ALPHA_VARIES"])[-1]


def reference(texture: Texture, uv: np.ndarray, level: np.ndarray) -> np.ndarray:
    chain = twin.mip_chain(twin.premultiplied(blended(texture)))
    uv, level = (np.float64(np.float32(values)) for values in (uv, level))
    return twin.trilinear(chain, texture, uv, level)


@pytest.mark.parametrize("shape", [(8, 8), (5, 12), (16, 3), (1, 7), (1, 1)])
@pytest.mark.parametrize("wrap", WRAPS)
def test_lookups_are_trilinear_and_wrap_as_told(wrap, shape):
    rng = np.random.default_rng(sum(shape))
    texture = Texture(rng.uniform(0, 1, (*shape, 4)), wrap=wrap)
    uv = rng.uniform(-3, 4, (4000, 2))
    uv[:400] = rng.integers(-6, 7, (400, 2)) / 2  # on the edges of the image
    level = rng.uniform(-1, 6, 4000)
    level[::3] = rng.integers(0, 5, len(level[::3]))
    found, truth = looked_up(texture, uv, level), reference(texture, uv, level)
    assert np.abs(found - truth).max() < 2e-5
    if shape != (1, 1):
        assert np.abs(found - reference(texture, uv + 0.01, level)).max() > 1e-3
        assert np.abs(found - reference(texture, uv, level + 0.01)).max() > 1e-3
    other = Texture(texture.image, wrap=WRAPS[WRAPS.index(wrap) - 1])
    if max(shape) > 1:
        assert np.abs(found - reference(other, uv, level)).max() > 0.1


def test_texel_centres_return_the_texels_with_v_upwards():
    image = np.random.default_rng(1).uniform(0, 1, (6, 4, 3)).astype(np.float32)
    row, column = np.indices((6, 4)).reshape(2, -1)
    uv = np.stack([(column + 0.5) / 4, 1 - (row + 0.5) / 6], axis=1)
    found = looked_up(Texture(image), uv, np.zeros(24))
    assert found[:, :3] == pytest.approx(image.reshape(-1, 3), abs=1e-6)
    assert np.abs(found[:, :3] - image[::-1].reshape(-1, 3)).max() > 0.1


def test_repeats_far_from_the_origin_keep_the_texel():
    image = np.arange(64, dtype=np.float32).reshape(1, 64, 1).repeat(3, 2)
    u = (np.arange(64) + 0.5) / 64
    for turns in (0, 1, 100, -1000):
        uv = np.stack([u + turns, np.full(64, 0.5)], axis=1)
        assert looked_up(Texture(image), uv, np.zeros(64))[:, 0] == pytest.approx(
            np.arange(64), abs=1e-5 * max(abs(turns), 1) * 64
        )


LIGHTS = (
    Light("ambient", color=(0.2, 0.4, 0.1), intensity=0.5),
    Light("directional", color=(1, 0.5, 0.25), intensity=2.0, direction=(0.3, -1, 0.5)),
    Light("point", color=(0.5, 1, 0.7), intensity=3.0, position=(0.4, 1.3, -0.2)),
    Light(
        "spot", color=(0.5, 0.8, 0.9), intensity=4.0, position=(-0.4, 1.2, 0.3),
        direction=(0.1, -1, 0.2), inner_angle=10.0, outer_angle=50.0,
    ),
)  # fmt: skip


@pytest.mark.parametrize("lights", [*((light,) for light in LIGHTS), LIGHTS, ()])
@pytest.mark.parametrize("shininess", [1.0, 7.5, 200.0])
def test_reflected_light_is_phongs_sum_over_the_lights(shininess, lights):
    rng = np.random.default_rng(2)
    material = Material(specular=(0.3, 0.2, 0.9), shininess=shininess)
    color, position = rng.uniform(0, 1, (3000, 3)), rng.uniform(-1, 1, (3000, 3))
    normal, view = (twin.unit(rng.normal(size=(3000, 3))) for _ in range(2))
    given = np.stack([color, position, normal, view], axis=1).astype(np.float32)
    tables = appearance([material], lights)
    arrays = [
        tables.materials, given, np.uint32(len(given)),
        tables.lights if lights else np.zeros(1, tables.lights.dtype), np.uint32(len(lights)),
        np.zeros((len(given), 3), np.float32),
    ]  # fmt: skip
    kinds = {light.kind for light in lights}
    defines = ["-DMB_POINT_LIGHTS"] * bool(kinds & {"point", "spot"})
    defines += ["-DMB_SPOT_LIGHTS"] * ("spot" in kinds)
    found = run("shading.cl", "reflections", arrays, defines)[-1]
    color, position, normal, view = given.astype(np.float64).swapaxes(0, 1)
    parts = [twin.phong(material, color, position, normal, view, light) for light in lights]
    truth = sum(parts, np.zeros((3000, 3)))
    assert np.abs(found - truth).max() < 1e-5 * max(shininess, 1.0) * max(truth.max(), 1e-3)
    if lights:
        assert np.abs(found - 1.01 * truth).max() > 1e-3


def test_powers_are_those_of_double_precision_from_the_least_to_the_greatest():
    rng = np.random.default_rng(4)
    x = np.concatenate(
        [
            rng.uniform(0, 1, 4000),
            1 - 10.0 ** rng.uniform(-8, -1, 2000),
            10.0 ** rng.uniform(-38, 0, 2000),
            [1.0, 0.5, 0.70710677, 0.7071068],
        ]
    )
    y = 10.0 ** rng.uniform(-3, 5, len(x))
    y[::7] = np.round(y[::7])
    x, y = x.astype(np.float32), y.astype(np.float32)
    found = run("shading.cl", "powers", [x, y, np.uint32(len(x)), np.zeros_like(x)])[-1]
    logarithm = y.astype(np.float64) * np.log(x.astype(np.float64))
    truth = np.exp(logarithm)
    # Rounding of the logarithm is scaled by it; what is below 2^-40 is 0.
    error = np.abs(found - truth)
    assert np.all(error <= 4e-7 * (1.0 - logarithm) * truth + 2.0**-40)
    assert np.any(error > 4e-9 * (1.0 - logarithm) * truth + 2.0**-40)
    assert np.all((found >= 0) & (found <= 1))
    assert np.median(error[truth > 0.1]) < 1e-7
    assert np.abs(found - truth**1.001).max() > 1e-4


def test_levels_of_the_pool_are_those_of_the_twin():
    rng = np.random.default_rng(3)
    textures = [Texture(rng.uniform(0, 1, (*s, 4))) for s in ((4, 8), (5, 7), (1, 6), (9, 1))]
    modes = ("opaque", "blend", "mask", "opaque")
    materials = [Material(texture=t, alpha_mode=m) for t, m in zip(textures, modes, strict=True)]
    tables = appearance(materials, ())
    for record, texture, material in zip(tables.textures, textures, materials, strict=True):
        first = record["texel"]
        for level in twin.mip_chain(twin.premultiplied(material)):
            texels = tables.texels[first : first + level.shape[0] * level.shape[1]]
            assert texels == pytest.approx(level.reshape(-1, 4), abs=1e-6)
            first += len(texels)
        assert record["levels"] == len(twin.mip_chain(texture.image))
