"""Stochastic transparency, which knows no order of layers, agrees with stacks exact in time.

A point sample sees one surface, by chance, so that the variance of independent samples follows
from the film with squared colours, as in `test_stochastic_agreement`.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.agreement import SAMPLES, SEEDS, analytic, critical, late, stochastic
from support.hard_cases import CASES, SIZE
from support.nightly import nightly_but
from support.translucent_scenes import CASES as KINDS
from support.translucent_scenes import LIGHTS, made

import mbinterval as mb
from mbinterval.scene.model import Material, Scene, Shutter

BLENDED = Material(shading="unlit", alpha_mode="blend")
NAMED = "interpenetrating meshes"
CULLS = ("hull", "dual_space", "zmax_strata", "best")


def glassy(alpha: float = 0.6) -> Scene:
    """Triangles that pass through each other, all but some translucent."""
    of = CASES[NAMED].make()
    (mesh,) = of.meshes
    alphas = np.where(np.arange(len(mesh.faces)) % 4, alpha, 1.0)
    color = np.column_stack([mesh.color, alphas])
    return replace(of, meshes=[replace(mesh, color=color, color_domain="face", material=BLENDED)])


def squared(of: Scene) -> Scene:
    """The same with the squares of all colours."""
    meshes = [replace(m, color=np.column_stack([m.color[:, :3] ** 2, m.color[:, 3:]]))
              for m in of.meshes]  # fmt: skip
    return replace(of, meshes=meshes, background=tuple(np.square(of.background)))


@pytest.fixture(scope="module")
def sampled() -> np.ndarray:
    return np.mean([stochastic(glassy(), seed=k, pattern="random") for k in range(SEEDS)], axis=0)


@pytest.fixture(scope="module")
def expected() -> tuple[np.ndarray, np.ndarray]:
    """Mean and standard deviation of a pixel's mean; those with too few events are left out."""
    mean, second = analytic(glassy()), analytic(squared(glassy()))
    variance = second - mean**2
    variance[..., 3] = mean[..., 3] * (1.0 - mean[..., 3])
    few = variance * SAMPLES * SEEDS < 25 * 0.25
    return mean, np.where(few, np.nan, np.sqrt(np.maximum(variance, 0) / (SAMPLES * SEEDS)))


def test_every_pixel_agrees_with_stacks(sampled, expected):
    mean, sigma = expected
    z = (sampled - mean) / sigma
    assert np.isfinite(z).sum() > 2000
    assert np.nanmax(np.abs(z)) < critical(sigma)
    assert abs(np.nanstd(z) - 1.0) < 0.1


@pytest.mark.parametrize("wrong", ["late", "thinner", "opaque"])
def test_what_is_wrong_is_rejected(wrong, sampled, expected):
    _, sigma = expected
    made = {
        "late": lambda: late(glassy(), 0.01),
        "thinner": lambda: glassy(0.594),
        "opaque": lambda: CASES[NAMED].make(),
    }
    z = (sampled - analytic(made[wrong]())) / sigma
    assert np.nanmax(np.abs(z)) > critical(sigma)


@pytest.mark.parametrize("cull", nightly_but(CULLS, "best"))
def test_every_culling_method_gives_the_same_film(cull):
    of, _ = made("everything", 3)
    settings = mb.Settings(method="stochastic", samples=16, cull="bbox")
    want = mb.render(of, width=SIZE[0], height=SIZE[1], settings=settings)
    found = mb.render(of, width=SIZE[0], height=SIZE[1], settings=replace(settings, cull=cull))
    assert np.array_equal(found.rgba, want.rgba)
    assert np.array_equal(found.depth, want.depth)


ROLL = Shutter(rolling="up", line_offset=2e-4, line_exposure=0.01)
LENS = {"focal_length": 24.0, "f_stop": 0.5, "focus_distance": 2.0, "fov": None}
WAYS = {
    "tested": ("tested", {}),
    "nothing moves": ("nothing moves", {}),
    "everything": ("everything", {}),
    "rolling": ("textured, at rest", {"shutter": ROLL}),
    "curve": ("vertices", {"shutter": Shutter(curve="triangle")}),
    "lens": ("lit", {"camera": LENS}),
}


def rms(error: np.ndarray) -> float:
    return float(np.sqrt(np.mean(error**2)))


@pytest.mark.parametrize("way", nightly_but(WAYS, "tested", "lens"))
def test_alpha_that_varies_agrees(way):
    name, fields = WAYS[way]
    meshes = KINDS[name].meshes(np.random.default_rng(8))
    camera = replace(KINDS[name].camera, **fields.get("camera", {}))
    given = {key: value for key, value in fields.items() if key != "camera"}
    of = Scene(meshes=meshes, camera=camera, lights=LIGHTS, background=(0.5, 0.6, 0.7), **given)

    def films(of: Scene, count: int, **values: object) -> np.ndarray:
        settings = [mb.Settings(seed=seed, **values) for seed in range(count)]
        made = [mb.render(of, width=48, height=32, settings=s).rgba for s in settings]
        return np.array(made)

    def noise(images: np.ndarray) -> float:
        return rms(images.std(axis=0, ddof=1)) / np.sqrt(len(images))

    in_time = {"samples": 48, "pattern": "sobol", "texture_samples": 64}
    exact = films(of, 4, **in_time)
    sampled = films(of, 8, method="stochastic", samples=512)
    error = rms(exact.mean(axis=0) - sampled.mean(axis=0))
    expected = np.hypot(noise(exact), noise(sampled))
    thinner = [replace(m, material=replace(m.material, opacity=0.8 * m.material.opacity))
               if m.material.alpha != "opaque" else m for m in of.meshes]  # fmt: skip
    other = films(replace(of, meshes=thinner), 4, **in_time)
    control = rms(other.mean(axis=0) - sampled.mean(axis=0))
    print(f"\n{way}: error {error:.1e}, noise {expected:.1e}, control {control:.1e}")
    assert error < 1.2 * expected
    assert control > 3.0 * expected
