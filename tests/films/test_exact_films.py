"""Films of exact paths against the exact twin: random, shipped and benchmark scenes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from reference.render import render
from support.exact_twin import SIZE, case_of, exposed, rms, twin
from support.nightly import nightly, nightly_but
from support.random_triangles import CASES, CROPS, late

import mbinterval as mb
from mbinterval.scene.formats.meshes.benchmark import read_benchmark

SCENES = Path(__file__).resolve().parents[2] / "scenes"
TRIANGULATED_ONLY = ("paired by depth", "at most six intervals", "32 bits", "256 bits")


RANDOM = [name for name in CASES if name not in TRIANGULATED_ONLY] + ["everything"]
PARTS = ("single-sided", "vertex colour", "texture", "four samples of a span", "phong",
         "static, all effects", "five samples")  # fmt: skip
"""Of what "everything" has together, for the night alone."""


@pytest.mark.parametrize("seed", [1, nightly(2)])
@pytest.mark.parametrize("name", [nightly(name) if name in PARTS else name for name in RANDOM])
def test_random_scenes_agree_with_the_exact_twin(name, seed):
    scene, settings = case_of(name, seed)
    film = mb.render(scene, width=SIZE[0], height=SIZE[1], settings=settings)
    truth = twin(exposed(scene, settings), settings)
    error = film.rgba - truth.rgba
    print(f"\n{name}: RMSE {rms(error):.1e}, greatest {np.abs(error).max():.1e}")
    assert rms(error) < 1e-5
    assert np.abs(error).max() < 1e-3
    covered = film.rgba[..., 3] > 1e-3
    assert film.depth[covered] == pytest.approx(truth.depth[covered], rel=1e-4)
    # What lies behind something static is not met at all.
    assert np.all(film.intervals <= truth.intervals + 1)
    if all(len(mesh.positions.shape) == 3 for mesh in scene.meshes):
        assert np.mean(film.intervals != truth.intervals) < 1e-3


@pytest.mark.parametrize("name", ["two-sided", "everything", nightly("texture"), nightly("phong")])
def test_a_hundredth_of_the_shutter_or_one_percent_of_colour_is_noticed(name):
    scene, settings = case_of(name, 1)
    film = mb.render(scene, width=SIZE[0], height=SIZE[1], settings=settings)
    frozen = exposed(scene, settings)
    assert rms(film.rgba - 1.01 * twin(frozen, settings).rgba) > 1e-3
    assert rms(film.rgba - twin(late(frozen, 0.01), settings).rgba) > 1e-4


@pytest.mark.parametrize("bits", [128, nightly(32)])
def test_masks_of_exact_paths_agree_with_the_twin_but_for_bits_at_a_rounding(bits):
    scene, settings = case_of("two-sided", 3)
    settings = replace(settings, occlusion=bits)
    film = mb.render(scene, width=SIZE[0], height=SIZE[1], settings=settings)
    truth = render(exposed(scene, settings), *SIZE, bits=bits, paths="exact")
    error = np.abs(film.rgba - truth.rgba).max(axis=-1)
    assert np.mean(error > 1e-6) < 0.01
    assert error.max() < 2 / bits
    exact = twin(exposed(scene, settings), settings)
    assert rms(exact.rgba - truth.rgba) > 1e-4


@pytest.mark.parametrize(
    "name",
    nightly_but(
        sorted(path.stem for path in SCENES.glob("*.toml")),
        *("walking_fox", "glass"),
    ),
)
def test_shipped_scenes_agree_with_the_exact_twin(name):
    scene = mb.load(SCENES / f"{name}.toml")
    if not isinstance(scene.background, tuple):  # the twin does not scale images
        scene = replace(scene, background=(0.5, 0.6, 0.7))
    if scene.shutter.rolling:  # and exposes all lines together (tests/films/test_shutter_lens.py)
        scene = replace(scene, shutter=mb.Shutter())
    if scene.camera.f_stop is not None:  # and has no lens (likewise)
        pinhole = replace(scene.camera, f_stop=None, focus_distance=None)
        scene = replace(scene, camera=pinhole)
    if scene.environment is not None:  # nor light from all around (tests/films/test_environment.py)
        meshes = [replace(mesh, reflections=None) for mesh in scene.meshes]
        scene = replace(scene, meshes=meshes, environment=None)
    flat = [  # nor mirrors (tests/films/test_mirrors.py)
        replace(mesh, material=replace(mesh.material, reflectivity=0.0, reflection_shear=0.0))
        if mesh.material is not None
        else mesh
        for mesh in scene.meshes
    ]
    scene = replace(scene, meshes=flat)
    settings = mb.Settings(  # nor shadows (tests/films/test_shadows.py)
        samples=1, texture_samples=16, shadows="off"
    )
    film = mb.render(scene, width=SIZE[0], height=SIZE[1], settings=settings)
    error = film.rgba - twin(exposed(scene, settings), settings).rgba
    print(f"\n{name}: RMSE {rms(error):.1e}, greatest {np.abs(error).max():.1e}")
    assert rms(error) < 1e-5
    assert np.abs(error).max() < 1e-3


@pytest.mark.parametrize("name", CROPS)
def test_crops_of_the_benchmark_agree_with_the_exact_twin(name, shared_file):
    scene, *size = read_benchmark(shared_file(f"benchmark/{name}.npz"))
    settings = mb.Settings(samples=1, texture_samples=16)
    crop = CROPS[name]
    film = mb.render(scene, width=size[0], height=size[1], settings=settings, crop=crop)
    error = film.rgba - twin(exposed(scene, settings, tuple(size)), settings, size, crop).rgba
    assert rms(error) < 1e-5
    assert np.abs(error).max() < 1e-3
