"""What is seen is what the true motion shows: against instants of it, which know no segments."""

from __future__ import annotations

from dataclasses import replace

import hypothesis
import numpy as np
import pytest
from hypothesis import strategies as st
from reference.witness import film as witness

from mbinterval import (
    Camera,
    Film,
    Light,
    Material,
    Mesh,
    Scene,
    Settings,
    Shutter,
    Track,
    Transform,
    render,
)

FACES = [[0, 1, 2], [0, 2, 3]]
FOV = 33.398488467987
STILL = Camera(position=(0, 0, 5), look_at=(0, 0, 0), fov=FOV)
WHOLE = Shutter(0.0, 1.0)
GREY = Material(shading="unlit", base_color=(0.0, 0.0, 0.2))
RED = Material(shading="unlit", base_color=(1.0, 0.0, 0.0))
METHODS = {
    "exact": {"samples": 4},
    "triangulated": {"samples": 4, "paths": "triangulated", "occlusion": 128},
    "points": {"method": "stochastic", "samples": 64},
    "slices": {"method": "accumulation", "slices": 64, "samples": 4},
}

TRUE_METHODS = ["exact", "points", "slices"]
"""Those that find when a path is seen; the published triangles stand for a path by other times."""


def rectangle(left, right, bottom, top, z=0.0, **fields):
    corners = [[left, bottom, z], [right, bottom, z], [right, top, z], [left, top, z]]
    return Mesh(corners, FACES, **({"material": GREY} | fields))


def keys(*pairs, **options):
    frames, values = zip(*pairs, strict=True)
    return Track(np.array(frames, float), np.array(values, float), **options)


def euler(*pairs, order="xyz"):
    return Transform(rotation=keys(*pairs, euler=order))


def film(scene: Scene, size=(80, 60), frame=0.0, **given) -> Film:
    given = {"samples": 4} | given
    return render(scene, frame=frame, width=size[0], height=size[1], settings=Settings(**given))


def seen(scene: Scene, size, strata=128, repeats=4, centre=False) -> witness.Repeats:
    return witness.film(scene, 0.0, size, witness.Asked(strata, repeats, centre))


# What hangs on one source


@pytest.mark.parametrize("method", TRUE_METHODS)
def test_a_sticker_on_a_turning_panel_is_all_seen(method):
    """One millimetre before the panel, keyed alike but on its own; the axis lies behind both."""
    panel, sticker = (
        rectangle(
            -w, w, -h, h, z, material=material, transform=euler((0, (0, -15, 0)), (1, (0, 15, 0)))
        )
        for w, h, z, material in ((1.2, 0.6, 1.0, GREY), (0.2, 0.2, 1.001, RED))
    )
    scene = Scene([panel, sticker], STILL, shutter=WHOLE)
    aovs = ("object", "crypto_object") if method == "exact" else ()
    given = film(scene, aovs=aovs, **METHODS[method])
    right = seen(scene, (80, 60), strata=64).rgba[..., 0].mean(axis=0)
    alone = film(replace(scene, meshes=[sticker]), **METHODS[method])
    assert given.rgba[..., 0].sum() == pytest.approx(alone.rgba[..., 0].sum(), rel=2e-3)
    assert given.rgba[..., 0].sum() == pytest.approx(right.sum(), rel=0.01)
    if aovs:
        middle = film(replace(scene, shutter=Shutter(0.5, 0.5)), samples=1, aovs=("object",))
        assert (given.layers["object"] == 2).sum() == (middle.layers["object"] == 2).sum() > 90


@pytest.mark.parametrize("method", TRUE_METHODS)
def test_what_rests_behind_a_wall_is_not_seen_however_the_camera_turns(method):
    camera = Camera(
        transform=Transform((0, 0, 5), keys((0, (0, -2, 0)), (1, (0, 8, 0)), euler="xyz")), fov=40
    )
    wall = rectangle(-6, 6, -2, 2)
    plate = rectangle(-0.6, 0.2, -0.4, 0.4, -0.005, material=RED)
    scene = Scene([wall, plate], camera, shutter=WHOLE)
    assert film(scene, **METHODS[method]).rgba[..., 0].max() == 0.0


def pieces(rng, mesh: Mesh, count: int) -> list[Mesh]:
    """The same triangles in several meshes."""
    part = rng.integers(0, count, len(mesh.faces))
    return [
        replace(mesh, faces=mesh.faces[part == k], color=mesh.color[part == k])
        for k in range(count)
        if (part == k).any()
    ]


def box() -> Mesh:
    corners = np.array(list(np.ndindex(2, 2, 2))) - 0.5
    faces = [
        [0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
        [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3],
    ]  # fmt: skip
    return Mesh(
        corners, faces, color=np.random.default_rng(3).uniform(0, 1, (12, 3)), material=GREY
    )


@pytest.mark.parametrize("count", [2, 5])
def test_a_rigid_body_is_the_same_however_it_is_cut_into_meshes(count):
    arm = Transform(rotation=keys((0, (0, 0, 0)), (1, (0, 70, 20)), euler="xyz"))
    hand = Transform((0.8, 0, 0), keys((0, (0, 0, 0)), (1, (90, 0, -150)), euler="zyx"), parent=arm)
    whole = replace(box(), transform=hand, material=Material(shading="unlit"))
    camera = replace(STILL, position=keys((0, (0, 0, 5)), (1, (1, 0.5, 4))))
    one = film(Scene([whole], camera, shutter=WHOLE), samples=1)
    parts = pieces(np.random.default_rng(count), whole, count)
    many = film(Scene(parts, camera, shutter=WHOLE), samples=1)
    assert one.rgba[..., 3].max() > 0.9
    np.testing.assert_allclose(many.rgba, one.rgba, atol=1e-6)


def test_a_seam_between_two_primitives_of_a_turning_wheel_stays_closed():
    """Tyre and rim share a ring of vertices, and have many and few faces."""

    def ring(inner, outer, count):
        angle = 2 * np.pi * np.arange(count) / count
        around = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
        faces = [[i, (i + 1) % count, count + i] for i in range(count)]
        faces += [[(i + 1) % count, count + (i + 1) % count, count + i] for i in range(count)]
        return Mesh(np.concatenate([inner * around, outer * around]), faces, material=GREY)

    turn = euler((0, (0, 0, 0)), (1, (0, 40, 130)))
    parts = [replace(ring(a, b, 24), transform=turn) for a, b in ((0.2, 0.8), (0.8, 1.1))]
    scene = Scene(parts, STILL, shutter=WHOLE)
    apart = film(scene, samples=1, motion_error=1.0).rgba[..., 3]
    joined = replace(
        parts[0],
        positions=np.concatenate([part.positions for part in parts]),
        faces=np.concatenate([parts[0].faces, parts[1].faces + len(parts[0].positions)]),
    )
    together = film(replace(scene, meshes=[joined]), samples=1, motion_error=1.0).rgba[..., 3]
    np.testing.assert_allclose(apart, together, atol=1e-6)


# Where motion has its knots


def test_a_blow_between_other_times_is_seen():
    """Keys from .13 to .24 of the shutter; all other motion is none."""
    away = keys((0, (0, 0, 0)), (0.13, (0, 0, 0)), (0.185, (1.2, 0, 0)), (0.24, (0, 0, 0)))
    plate = rectangle(-0.5, 0.5, -0.5, 0.5, transform=Transform(translation=away))
    scene = Scene([plate], STILL, shutter=WHOLE)
    given = film(scene, (160, 120), samples=16).rgba[..., 3]
    assert given[60, 60] == pytest.approx(0.891, abs=2e-3)
    assert given[60, 105] == pytest.approx(0.09, abs=0.02)


def test_keys_that_nothing_asks_for_are_no_knots():
    """Baked motion, a key for each 240th of a second, that is straight but for one corner."""
    frames = np.linspace(-12, 12, 241)
    places = np.stack([np.minimum(frames, 0.3) / 10, 0 * frames, 0 * frames], axis=1)
    mesh = rectangle(-0.5, 0.5, -0.5, 0.5, transform=Transform(translation=Track(frames, places)))
    from mbinterval.exposure.asked import Asked
    from mbinterval.exposure.exposure import expose

    scene = Scene([mesh], STILL, shutter=Shutter(-0.5, 0.5))
    (found,) = expose(scene, 0.0, 1.5, Asked(error=0.1), height=480).meshes
    assert found.segments == 2
    assert found.knots[1] == pytest.approx(0.8, abs=1e-6)


def test_a_long_exposure_shows_one_short_twitch():
    """48 frames; within one of them a bar turns by 60 degrees and back."""
    turn = euler((20.0, (0, 0, 0)), (20.5, (0, 0, 60)), (21.0, (0, 0, 0)))
    bar = rectangle(0.2, 1.2, -0.1, 0.1, transform=turn)
    scene = Scene([bar], STILL, shutter=Shutter(0.0, 48.0))
    given = film(scene, samples=16).rgba[..., 3]
    right = seen(scene, (80, 60), strata=4096, repeats=2).rgba[..., 3].mean(axis=0)
    assert np.abs(given - right).max() < 0.006
    assert given.sum() - given[given > 0.5].sum() > 0.004


@pytest.mark.parametrize("turns", [1, 30])
def test_what_no_number_of_segments_reaches_is_said(turns):
    bar = rectangle(
        0.2, 1.2, -0.1, 0.1, transform=euler((0, (0, 0, 0)), (1, (0, 0, 360.0 * turns))), name="bar"
    )
    given = film(Scene([bar], STILL, shutter=WHOLE), (160, 120), samples=1)
    said = [note for note in given.notes if "motion is off by up to" in note]
    assert bool(said) == (turns == 30)
    if said:
        assert "mesh 'bar'" in said[0]
        more = film(Scene([bar], STILL, shutter=WHOLE), (160, 120), samples=1, most_segments=4096)
        assert not any("motion is off" in note for note in more.notes)
        right = seen(Scene([bar], STILL, shutter=WHOLE), (160, 120), 4096, 1, True)
        assert np.abs(more.rgba[..., 3] - right.rgba[0, ..., 3]).max() < 0.03


def test_a_focus_pull_has_knots():
    pull = Camera(
        position=(0, 0, 4), fov=40.0, f_stop=0.3, meters_per_unit=0.04,
        focus_distance=keys((-0.25, 1.5), (0.25, 8.0)),
    )  # fmt: skip
    square = rectangle(-0.5, 0.5, -0.5, 0.5)
    from mbinterval.exposure.asked import Asked
    from mbinterval.exposure.exposure import expose

    scene = Scene([square], pull)
    counts = [
        expose(scene, 0.0, 4 / 3, Asked(error=error), height=600).meshes[0].segments
        for error in (np.inf, 1.0, 0.1)
    ]
    assert counts[0] == 1 < counts[1] < counts[2]


# One moment


def test_layers_never_change_the_film():
    turn = euler((0, (0, 0, 0)), (1, (10, 200, 90)))
    camera = replace(STILL, position=keys((0, (0, 0, 5)), (1, (2, 0.5, 4))))
    scene = Scene([replace(box(), transform=turn)], camera, shutter=WHOLE)
    for moment in (0.5, 0.3):
        plain, with_layers = (
            film(scene, samples=2, aov_time=moment, aovs=aovs)
            for aovs in ((), ("sharp", "depth", "normal", "forward", "events"))
        )
        np.testing.assert_array_equal(plain.rgba, with_layers.rgba)
        right = film(replace(scene, shutter=Shutter(moment, moment)), samples=2, aovs=("depth",))
        np.testing.assert_allclose(with_layers.layers["sharp"], right.rgba, atol=2e-5)
        near = np.isfinite(right.layers["depth"]) & np.isfinite(with_layers.layers["depth"])
        assert near.sum() > 500
        away = with_layers.layers["depth"][near] - right.layers["depth"][near]
        assert np.abs(away).max() < 1e-5


@pytest.mark.parametrize("method", METHODS)
def test_an_instant_is_a_picture(method):
    """With the shutter open for no time, all is where it is then: between keys, on cut cameras."""
    turn = euler((0, (0, 0, 0)), (1, (30, 200, 90)))
    camera = replace(STILL, position=keys((0, (0, 0, 5)), (1, (2, 0.5, 4))))
    scene = Scene(
        [replace(box(), transform=turn)], camera, [Light("directional")], shutter=Shutter(0.4, 0.4)
    )
    given = film(scene, **METHODS[method])
    short = film(replace(scene, shutter=Shutter(0.4, 0.4 + 1e-6)), **METHODS[method])
    assert given.rgba[..., 3].max() == 1.0
    assert np.abs(given.rgba - short.rgba).max() < (0.3 if method == "points" else 2e-3)


# Windings and cameras


@pytest.mark.parametrize("inner", [(), ((0.5, (0, 1, 1)),)])
def test_winding_follows_the_determinant_at_each_moment(inner):
    """Single-sided, scaled from 1 to -1: its outer side stays outside, so that it is seen."""
    front = Material(shading="unlit", double_sided=False)
    flip = Transform(scale=keys((0, (1, 1, 1)), *inner, (1, (-1, 1, 1))))
    plate = rectangle(-0.8, 0.8, -0.8, 0.8, material=front, transform=flip)
    scene = Scene([plate], STILL, shutter=WHOLE)
    right = seen(scene, (80, 60), centre=True).rgba[..., 3].mean(axis=0)
    assert right.max() > 0.9
    for given in METHODS.values():
        away = np.abs(film(scene, **given).rgba[..., 3] - right)
        assert away.max() < (0.2 if given.get("method") == "stochastic" else 0.06)
        back = replace(plate, faces=np.array(FACES)[:, ::-1])
        assert film(replace(scene, meshes=[back]), **given).rgba[..., 3].max() == 0.0


@pytest.mark.parametrize("scale", [(-1, 1, 1), (1, -1, 1), (-2, 3, 1), (-1, -1, 1)])
def test_a_mirrored_camera_mirrors_the_picture(scale):
    single = Material(shading="unlit", base_color=(1, 0, 0), double_sided=False)
    meshes = [
        rectangle(0.2, 1.0, -0.3, 0.6, material=single, name="single-sided"),
        rectangle(-0.9, -0.3, -0.5, 0.1, name="both"),
    ]
    straight = Scene(meshes, Camera(transform=Transform((0, 0, 5)), fov=FOV), shutter=WHOLE)
    mirrored = replace(
        straight, camera=Camera(transform=Transform((0, 0, 5), scale=scale), fov=FOV)
    )
    for given in METHODS.values():
        if given.get("method") == "stochastic":
            continue
        one, other = film(straight, **given).rgba, film(mirrored, **given).rgba
        step = [-1 if part < 0 else 1 for part in scale]
        np.testing.assert_allclose(other, one[:: step[1], :: step[0]], atol=1e-6)
    layers = film(mirrored, samples=1, aovs=("normal", "object")).layers
    there = layers["object"] > 0
    np.testing.assert_allclose(layers["normal"][there][:, 2], 1.0, atol=1e-6)


def test_a_sheared_camera_keeps_its_view_and_says_so():
    shear = np.eye(4)
    shear[1, 0] = 0.4
    uneven = Transform(scale=(2.0, 1.0, 3.0))
    square = rectangle(-0.5, 0.5, -0.5, 0.5)
    straight = film(Scene([square], Camera(transform=Transform((0, 0, 5)), fov=FOV)))
    for parent, said in (
        (Transform(matrix=shear), "made orthogonal"),
        (uneven, "uneven scale"),
    ):
        inner = Transform((0, 0, 5 / (3.0 if parent is uneven else 1.0)), parent=parent)
        camera = Camera(transform=inner, fov=FOV, name="eye")
        given = film(Scene([square], camera))
        np.testing.assert_allclose(given.rgba, straight.rgba, atol=1e-6)
        assert any(said in note and "'eye'" in note for note in given.notes)


# Random hierarchies with layers that nearly touch


def numbers(low, high):
    return st.floats(low, high).map(lambda x: round(x, 4))


@st.composite
def turns(draw, most):
    """A rotation of Euler keys over the shutter, perhaps with a key inside it."""
    times = [0.0, *sorted({draw(numbers(0.05, 0.95))} if draw(st.booleans()) else ()), 1.0]
    values = [[draw(numbers(-most, most)) for _ in range(3)] for _ in times]
    return Track(np.array(times), np.array(values), euler=draw(st.sampled_from(["xyz", "zyx"])))


@st.composite
def moves(draw, most):
    ends = [[draw(numbers(-most, most)) for _ in range(3)] for _ in range(2)]
    return Track(np.array([0.0, 1.0]), np.array(ends))


@st.composite
def nodes(draw, levels):
    node = None
    for _ in range(levels):
        node = Transform(draw(moves(0.4)), draw(turns(25.0)), parent=node)
    return node


@st.composite
def eyes(draw):
    """A camera that pans, rolls, dollies and zooms, all at once."""
    base = np.array([0, 0, 6.0])
    place = Track([0.0, 1.0], base + [[draw(numbers(-1, 1)) for _ in range(3)] for _ in range(2)])
    zoom = Track([0.0, 1.0], [draw(numbers(30, 50)), draw(numbers(30, 50))])
    return Camera(transform=Transform(place, draw(turns(8.0))), fov=zoom)


GAPS = st.sampled_from([1e-2, 1e-3, 1e-4, 1e-5])


@hypothesis.settings(max_examples=25, deadline=None)
@hypothesis.given(eyes(), st.integers(0, 3).flatmap(nodes), GAPS, st.sampled_from(TRUE_METHODS))
def test_on_one_source_what_is_hidden_is_never_seen(camera, node, gap, method):
    """A plate behind a much larger one, on one node of any hierarchy, and beside it before it.

    The gap is a part of their distance from the eye, 6.
    """
    wall = rectangle(-2, 2, -2, 2, 0.0, transform=node)
    behind = rectangle(-0.5, 0.5, -0.5, 0.5, -6.0 * gap, material=RED, transform=node)
    scene = Scene([wall, behind], camera, shutter=WHOLE)
    front = seen(scene, (24, 18), strata=32, repeats=1).cover
    given = film(scene, (24, 18), **METHODS[method])
    if front[..., 1].max() == 0.0:  # not turned so far that the back is before the wall
        assert given.rgba[..., 0].max() == 0.0
        before = replace(behind, positions=behind.positions * [1, 1, -1])
        shown = replace(scene, meshes=[wall, before])
        alone = replace(scene, meshes=[before])
        one, both = (film(of, (24, 18), **METHODS[method]).rgba for of in (alone, shown))
        loss = one - both
        assert np.abs(loss[..., 0]).max() < 0.1  # alone it has other knots, within motion_error


@hypothesis.settings(max_examples=12, deadline=None)
@hypothesis.given(eyes(), nodes(2), nodes(1))
def test_between_sources_no_leak_is_wider_than_the_error(camera, first, second):
    """What moves against each other: all that differs from truth is within the error in pixels."""
    meshes = [
        rectangle(-1, 1, -0.7, 0.7, 0.0, transform=first),
        rectangle(-0.6, 0.6, -1.2, 1.2, 0.02, material=RED, transform=second),
    ]
    scene = Scene(meshes, camera, shutter=WHOLE)
    size = (24, 18)
    given, fine = (
        film(scene, size, samples=64, pattern="sobol", motion_error=error).rgba
        for error in (0.1, 1e-3)
    )
    right = seen(scene, size, strata=1024, repeats=2).rgba.mean(axis=0)
    assert np.abs(fine - right).max() < 0.05  # of 64 places in a pixel
    assert np.abs(given - fine).max() < 0.1
    assert np.sqrt(np.mean((given - fine) ** 2)) < 0.01
