"""What a lens with limits has in focus, in films: however meshes are cut, in all methods."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from reference.witness import film as witness
from support.nightly import nightly

import mbinterval as mb
from mbinterval.exposure import focus
from mbinterval.scene.model import Camera, Material, Mesh, Scene, Shutter
from mbinterval.scene.tracks import Track, Transform

SIZE = (48, 36)
UNLIT = Material(shading="unlit")
LENS = {"fov": 50.0, "f_stop": 1.0, "focus_distance": 6.0, "meters_per_unit": 0.03}
BOTH = {"sharp_range": (4.0, 9.0), "foreground_blur": 0.01}
CAMERA = Camera(**LENS, **BOTH)


def keys(*values: object, **given: object) -> Track:
    return Track(np.linspace(-0.25, 0.25, len(values)), values, **given)


def turned(degrees: float) -> list[float]:
    half = np.radians(degrees) / 2
    return [0.0, float(np.sin(half)), 0.0, float(np.cos(half))]


def road(strips: int = 1, near: float = 2.0, far: float = 20.0, **given: object) -> Mesh:
    """The road of `shared/cases/truth/sharp_range_large_triangles.py`, of 2 triangles or more."""
    z = -np.linspace(near, far, strips + 1)
    corners = np.stack([[np.full_like(z, x), np.full_like(z, -0.8), z] for x in (-0.4, 0.4)])
    first = 2 * np.arange(strips)[:, None]
    faces = np.concatenate([first + [0, 1, 3], first + [0, 3, 2]])
    return Mesh(corners.transpose(2, 0, 1).reshape(-1, 3), faces, **({"material": UNLIT} | given))


PAN = Transform(rotation=keys(turned(-8), turned(8), quaternion=True))
PUSH = replace(CAMERA, position=keys((0, 0, 0), (0.1, 0, -1.5)))
PASSING = Transform(translation=keys((0, 0, 0), (0.3, 0, 2.0)))
ROLLING = Shutter(rolling="down", line_offset=0.25 / 24 / SIZE[1], line_exposure=0.25 / 24)
MOTIONS = {
    "still": Scene([road()], CAMERA),
    "push": Scene([road()], PUSH),
    "pan": Scene([road()], Camera(transform=PAN, **LENS, **BOTH)),
    "mesh": Scene([road(transform=PASSING)], CAMERA),
    "pull": Scene([road()], replace(CAMERA, focus_distance=keys(4.0, 8.0), sharp_range=None)),
    "rolling": Scene([road()], PUSH, shutter=ROLLING),
    "behind": Scene([road(near=-3.0)], PUSH),
}
METHODS = {
    "exact": {"samples": 64, "pattern": "sobol"},
    "masks": {"samples": 64, "pattern": "sobol", "occlusion": 128},
    "points": {"method": "stochastic", "samples": 256},
    "slices": {"method": "accumulation", "slices": 16, "samples": 16},
}


def alpha(scene: Scene, **given: object) -> np.ndarray:
    film = mb.render(scene, frame=0.0, width=SIZE[0], height=SIZE[1], settings=mb.Settings(**given))
    return film.rgba[..., 3].astype(np.float64)


def in_strips(scene: Scene) -> Scene:
    z = -scene.meshes[0].positions[:, 2]
    mesh = road(128, z.min(), z.max(), transform=scene.meshes[0].transform)
    return replace(scene, meshes=[mesh, *scene.meshes[1:]])


@pytest.mark.parametrize("motion", [m if m in ("push", "pull") else nightly(m) for m in MOTIONS])
@pytest.mark.parametrize("method", METHODS)
def test_a_road_of_two_triangles_is_one_of_many_strips(motion, method):
    """On the same samples: they differed by .10 to .20 where vertices alone had the limits."""
    scene = MOTIONS[motion]
    films = [alpha(of, **METHODS[method]) for of in (scene, in_strips(scene))]
    away = np.abs(films[0] - films[1])
    assert away.max() < 0.03
    assert np.sqrt(np.mean(away**2)) < 2e-3
    free = replace(scene, camera=replace(scene.camera, sharp_range=None, foreground_blur=None))
    assert np.abs(alpha(free, **METHODS[method]) - films[0]).max() > 0.1


@pytest.mark.parametrize("motion", ["pan", "rolling", *map(nightly, ("push", "mesh", "pull"))])
def test_films_are_what_the_witness_sees(motion):
    scene = MOTIONS[motion]
    settings = METHODS["exact"] | {"samples": 256}
    films = [alpha(scene, **settings, seed=seed) for seed in range(4)]
    seen = witness.film(scene, 0.0, SIZE, witness.Asked(strata=256, repeats=4)).rgba[..., 3]
    away = np.mean(films, axis=0) - seen.mean(axis=0)
    noise = np.sqrt(np.mean(np.var(films, axis=0) / 4 + np.var(seen, axis=0) / 4))
    assert np.abs(away).max() < 0.04
    assert np.sqrt(np.mean(away**2)) < 2.0 * noise + 5e-4


def wall(unshared: bool) -> Mesh:
    """A slanted wall before everything, in two triangles that share no vertices."""
    corners = np.array([[-9, -9, -1], [9, -9, -12], [9, 9, -12.0], [-9, 9, -1]])
    faces = np.array([[0, 1, 2], [2, 3, 0]])
    if unshared:
        return Mesh(corners[faces.ravel()], [[0, 1, 2], [4, 5, 3]], material=UNLIT)
    return Mesh(corners, faces, material=UNLIT)


@pytest.mark.parametrize("method", ["exact", "points"])
def test_nothing_opens_along_cuts(method):
    """Each sample sees the wall all the time, seams of vertices that are not shared included."""
    push = replace(CAMERA, position=keys((0, 0, 1.0), (0.2, 0, -0.5)), foreground_blur=0.05)
    films = [
        alpha(Scene([wall(unshared)], push), **METHODS[method], shadows="off")
        for unshared in (False, True)
    ]
    assert films[0].min() > 1.0 - 1e-6
    assert np.array_equal(films[0], films[1])


def test_layers_and_ids_stay_what_they_are_without_limits():
    """They show what is seen through the middle of the lens, which limits don't move."""
    rng = np.random.default_rng(2)
    centre = rng.uniform((-2, -1.5, -11), (2, 1.5, -3), (8, 1, 3))
    corners = centre + rng.normal(0, (0.8, 0.8, 2.0), (8, 3, 3))
    ends = np.stack([corners, corners + rng.normal(0, 0.3, (8, 1, 3))]).reshape(2, -1, 3)
    colors = rng.uniform(size=(8, 3))
    mesh = Mesh(
        ends, np.arange(24).reshape(-1, 3), uv=rng.uniform(size=(24, 2)), name="some",
        material=Material("paint", shading="unlit"), color=colors, color_domain="face",
    )  # fmt: skip
    scene = Scene([mesh, road(name="road", material=Material("tar", shading="unlit"))], PUSH)
    aovs = ("depth", "normal", "uv", "object", "material", "forward", "events")
    settings = mb.Settings(samples=16, pattern="sobol", aovs=aovs)
    films = []
    for limits in (BOTH, {"sharp_range": None, "foreground_blur": None}):
        of = replace(scene, camera=replace(PUSH, **limits))
        size = {"width": SIZE[0], "height": SIZE[1]}
        films.append(mb.render(of, frame=0.0, settings=settings, **size))
    for name in ("object", "material"):
        same = films[0].layers[name] == films[1].layers[name]
        assert same.mean() > 0.998  # on an edge the last bit decides
        assert same.any()
    for name in ("depth", "normal", "uv", "forward"):
        given = [film.layers[name].reshape(-1) for film in films]
        with np.errstate(invalid="ignore"):
            away = np.nan_to_num(np.abs(given[0] - given[1]), nan=0.0)
        assert np.quantile(away, 0.995) < 2e-3
    # Faces of events are the mesh's, which their colours tell.
    events = films[0].events
    own = np.flatnonzero(events["object"] == 1)
    assert len(own) > 100
    face = events["face"][own]
    assert face.max() < 8
    seen = np.stack([events[name][own] for name in "rgb"], axis=1)
    assert np.allclose(seen, colors[face], atol=1e-5)


@pytest.mark.parametrize("shear", [0.0, nightly(0.1)])
def test_what_mirrors_show_has_the_limits_of_its_own_distance(shear):
    """The road stands on its head in a mirror above it; the mirror itself is cut too."""
    shiny = Material(
        shading="unlit", base_color=(0, 0, 0), reflectivity=1.0, reflection_shear=shear
    )
    corners = [[-3, 0.5, -1], [3, 0.5, -1], [3, 0.5, -20], [-3, 0.5, -20]]
    mirror = Mesh(corners, [[0, 1, 2], [0, 2, 3]], material=shiny)
    scene = Scene([road(), mirror], PUSH)
    red = []
    for of in (
        scene,
        in_strips(scene),
        replace(scene, camera=replace(PUSH, **dict.fromkeys(BOTH))),
    ):
        settings = mb.Settings(samples=64, pattern="sobol")
        film = mb.render(of, frame=0.0, width=SIZE[0], height=SIZE[1], settings=settings)
        red.append(film.rgba[: SIZE[1] // 2, :, 0].astype(np.float64))
    assert red[0].max() > 0.9
    assert np.abs(red[0] - red[1]).max() < 0.03
    assert np.abs(red[0] - red[2]).max() > 0.1


def test_films_say_what_is_left(monkeypatch):
    given = {"frame": 0.0, "settings": mb.Settings(samples=1), "width": SIZE[0], "height": SIZE[1]}
    assert mb.render(MOTIONS["push"], **given).notes == ()
    monkeypatch.setattr(focus, "_MOST_FACES", 20)
    (note,) = mb.render(MOTIONS["push"], **given).notes
    assert "motion_error=0.1 asks for more cuts or motion segments than are made" in note
