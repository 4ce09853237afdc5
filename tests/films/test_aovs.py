"""Layers: closed forms of what a pixel's centre sees at a moment, of the sharp frame, of flow."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from support.closed_forms import FACES, UNIT_CAMERA, rectangle, slab, slab_times, world
from support.nightly import nightly

import mbinterval as mb
from mbinterval.errors import UsageError
from mbinterval.film.aovs import AOVS, MOMENTARY, check_aovs
from mbinterval.scene.model import Camera, Material, Mesh, Scene, Shutter
from mbinterval.scene.tracks import Track
from mbinterval.scene.transforms import Transform

SIZE = (32, 16)
X, Y = np.meshgrid(np.arange(32) + 0.5, np.arange(16) + 0.5)
UV = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])


def film(scene: Scene, *aovs: str, frame: float = 1.0, crop=None, **settings: object) -> mb.Film:
    chosen = mb.Settings(aovs=aovs, **({"samples": 1} | settings))
    return mb.render(scene, frame=frame, width=32, height=16, settings=chosen, crop=crop)


TOGETHER = ("sharp", *MOMENTARY)


def layers(scene: Scene, *aovs: str, **options: object) -> dict[str, np.ndarray]:
    """The layers, and where they can be `TOGETHER`: scenes of the same effects share a kernel."""
    alone = aovs in (MOMENTARY, tuple(AOVS)) or scene.shutter.rolling or "filter" in options
    return film(scene, *aovs if alone else TOGETHER, **options).layers


def card(
    corners: np.ndarray, w: np.ndarray | float, way: tuple[float, float, float] = (0, 0, 0),
    **fields: object,
) -> Mesh:  # fmt: skip
    """A rectangle seen at ``corners`` px and depths ``w``; it moves by ``way`` in every frame."""
    keys = Track([0, 2], [-np.array(way, float), np.array(way, float)])
    return Mesh(
        positions=world(corners, w, SIZE), faces=FACES, uv=UV, shading="unlit",
        transform=Transform(translation=keys), **fields,
    )  # fmt: skip


def scene_of(*meshes: Mesh, camera: Camera = UNIT_CAMERA, **fields: object) -> Scene:
    return Scene(meshes=meshes, camera=camera, **fields)


WHOLE = rectangle(-40, 80, -40, 60)


@pytest.mark.parametrize("t", [0.5, nightly(0.3), nightly(0.0), nightly(1.0)])
def test_the_sharp_frame_of_a_slab_is_where_it_is_at_the_moment(t):
    mesh = slab(rectangle(4.25, 9.25, -5, 30), (12, 0), 2.0, SIZE, (1, 0.5, 0.2))
    found = film(scene_of(mesh, background=(0, 0, 1)), *TOGETHER, aov_time=t)
    left = 4.25 + 12 * t
    inside = (left <= X) & (left + 5 > X)
    want = np.where(inside[..., None], [1, 0.5, 0.2, 1], [0, 0, 1, 0])
    assert np.abs(found.layers["sharp"] - want).max() < 1e-6
    assert np.array_equal(found.layers["object"], inside)
    assert found.layers["depth"][inside] == pytest.approx(2.0)
    assert np.isinf(found.layers["depth"][~inside]).all()
    assert (
        np.abs(found.rgba[..., 3] - np.diff(slab_times(X, 4.25, 9.25, 12.0), axis=0)).max() < 1e-5
    )


def test_the_sharp_frame_is_smooth_at_edges_and_ids_are_not():
    mesh = slab(rectangle(4.0, 9.5, -5, 30), (12, 0), 2.0, SIZE)
    found = layers(scene_of(mesh), "sharp", "object", aov_time=0.5, samples=4)
    assert found["sharp"][0, 15, 3] == pytest.approx(0.5)
    assert set(np.unique(found["object"])) == {0, 1}
    assert found["object"].dtype == np.uint32


def test_the_five_point_rule_averages_the_sharp_frame_as_it_does_the_film():
    still = scene_of(slab(rectangle(4.3, 9.6, 2.2, 30), (0, 0), 2.0, SIZE), background=(0, 0.2, 1))
    moving = scene_of(slab(rectangle(4.3, 9.6, 2.2, 30), (6, 3), 2.0, SIZE), background=(0, 0.2, 1))
    want = film(still, filter="five_point").rgba
    found = layers(moving, "sharp", aov_time=0.0, filter="five_point")["sharp"]
    assert np.abs(found - want).max() < 1e-6
    assert len(np.unique(want[..., 3])) > 2
    part = layers(moving, "sharp", aov_time=0.0, filter="five_point", crop=(3, 1, 9, 7))["sharp"]
    assert np.array_equal(part, found[1:8, 3:12])


def test_flow_of_a_card_in_translation_is_its_speed_to_the_last_bit():
    mesh = card(WHOLE, 2.0, (0.75, 0.25, 0))  # at depth 2: 8 pixels a unit, y up
    found = layers(scene_of(mesh), "forward", "backward")
    for name, sign in (("forward", 1), ("backward", -1)):
        assert found[name] == pytest.approx(np.broadcast_to([6.0 * sign, -2.0 * sign], (16, 32, 2)))
        assert found[name].dtype == np.float32


def test_flow_of_what_comes_nearer_is_by_perspective():
    mesh = card(WHOLE, 4.0, (0, 0, 1.0))  # from depth 4 to 3, and from 5
    found = layers(scene_of(mesh), "forward", "backward")
    away = np.stack([X - 16, Y - 8], axis=-1)
    assert found["forward"] == pytest.approx(away * (4 / 3 - 1), abs=1e-5)
    assert found["backward"] == pytest.approx(away * (4 / 5 - 1), abs=1e-5)
    with pytest.raises(AssertionError):
        assert found["backward"] == pytest.approx(-found["forward"], abs=1e-2)


def test_flow_of_what_turns_is_the_rotation_about_its_middle():
    def turn(degrees: float) -> list[float]:
        half = np.radians(degrees) / 2
        return [0, 0, np.sin(half), np.cos(half)]

    frames = [0, 1, 2]
    keys = Track(frames, [turn(-20), turn(0), turn(20)], quaternion=True)
    mesh = replace(card(WHOLE, 2.0), transform=Transform(rotation=keys))
    # The moment is at the end of a motion segment, so that no path error plays a part.
    found = layers(scene_of(mesh), "forward", aov_time=0.25, motion_segments=4)["forward"]
    c, s = np.cos(np.radians(20)), np.sin(np.radians(20))
    x, y = X - 16, Y - 8
    want = np.stack([c * x + s * y - x, -s * x + c * y - y], axis=-1)  # y runs down
    assert found == pytest.approx(want, abs=2e-5)


@pytest.mark.parametrize("t", [1.0, nightly(0.0), nightly(0.5)])
def test_flow_starts_at_the_moment_and_ends_one_frame_on(t):
    """A card that gains speed: its place is 4 (frame + frame^2) pixels to the right."""
    keys = np.linspace(0, 3, 3 * 64 + 1)
    way = np.zeros((len(keys), 3))
    way[:, 0] = 0.5 * (keys + keys**2)
    mesh = replace(card(WHOLE, 2.0), transform=Transform(translation=Track(keys, way)))
    shutter = Shutter(open=0.0, close=0.5)
    found = layers(scene_of(mesh, shutter=shutter), "forward", "backward", aov_time=t)
    frame = 1 + 0.5 * t
    assert found["forward"][..., 0] == pytest.approx(4 * (2 + 2 * frame), abs=1e-4)
    assert found["backward"][..., 0] == pytest.approx(-4 * 2 * frame, abs=1e-4)


def test_flow_knows_the_camera_and_meshes_without_blur():
    camera = Camera(
        position=Track([0, 2], [[-1, 0, 0], [1, 0, 0]]), look_at=None, focal_length=24.0
    )
    still, moving = (
        card(rectangle(-40, 80, -40, 8), 2.0),
        card(rectangle(-40, 80, 8, 60), 4.0, (2, 0, 0)),
    )
    for blur in (True, False):
        scene = scene_of(still, replace(moving, motion_blur=blur), camera=camera)
        found = layers(scene, "forward")["forward"]
        assert found[:8, :, 0] == pytest.approx(-8.0, abs=1e-5)
        assert found[8:, :, 0] == pytest.approx(4.0, abs=1e-5)
        assert np.abs(found[..., 1]).max() < 1e-5


def test_flow_to_behind_the_eye_is_not_a_number_and_of_nothing_is_zero():
    mesh = card(rectangle(-40, 16, -40, 60), 2.0, (0, 0, 3))
    found = layers(scene_of(mesh), "forward", "backward")
    assert np.isnan(found["forward"][:, :16]).all()
    assert np.isfinite(found["backward"]).all()
    assert not found["forward"][:, 16:].any()


def test_depth_and_uv_of_a_slanted_card_are_by_perspective():
    corners = np.array([[0, 16], [32, 16], [32, 0], [0, 0]], float)
    w = np.array([2.0, 6.0, 6.0, 2.0])
    found = layers(scene_of(card(corners, w)), "depth", "uv")
    part = X / 32
    depth = 1 / ((1 - part) / 2 + part / 6)
    assert found["depth"] == pytest.approx(depth, rel=1e-6)
    assert found["uv"][..., 0] == pytest.approx(part / 6 * depth, abs=1e-6)


@pytest.mark.parametrize("double_sided", [True, False])
@pytest.mark.parametrize("given", [True, False])
def test_normals_point_to_the_viewer_in_the_world_and_are_of_length_one(double_sided, given):
    turn = [0, np.sin(np.radians(30)), 0, np.cos(np.radians(30))]  # 60 degrees about y
    material = Material(shading="unlit", double_sided=double_sided)
    mesh = Mesh(
        positions=world(WHOLE, 2.0, SIZE) + [0, 0, 2], faces=FACES, material=material,
        normals=np.tile([0, 0, 3.0], (4, 1)) if given else None,
        transform=Transform(rotation=turn, translation=(0, 0, -2)),
    )  # fmt: skip
    want = np.array([np.sin(np.radians(60)), 0, 0.5])
    seen = layers(scene_of(mesh), "normal")["normal"][8, 12:20]
    assert seen == pytest.approx(np.broadcast_to(want, seen.shape), abs=1e-6)
    back = replace(mesh, faces=FACES[:, ::-1], normals=None if not given else -mesh.normals)
    seen = layers(scene_of(back), "normal")["normal"][8, 12:20]
    assert seen == pytest.approx(np.broadcast_to(want * double_sided, seen.shape), abs=1e-6)


def test_ids_stay_when_others_vanish_and_the_file_names_them():
    paint, wood = Material("paint", shading="unlit"), Material("wood", shading="unlit")
    places = rectangle(0, 10, 0, 16), rectangle(10, 20, 0, 16), rectangle(20, 32, 0, 16)
    seen = Track([0, 3], [1.0, 0.0], "step")
    meshes = [
        Mesh(world(at, 2.0, SIZE), FACES, material=m, name=n, visible=v)
        for at, m, n, v in zip(
            places, (wood, paint, wood), ("first", "second", "dritte “3”"), (seen, True, True),
            strict=True,
        )
    ]  # fmt: skip
    found = film(scene_of(*meshes), "object", "material")
    assert found.layers["object"][0, [0, 10, 20]].tolist() == [1, 2, 3]
    assert found.layers["material"][0, [0, 10, 20]].tolist() == [1, 2, 1]
    assert json.loads(found.metadata["objects"]) == ["first", "second", "dritte “3”"]
    assert json.loads(found.metadata["materials"]) == ["wood", "paint"]
    later = film(scene_of(*meshes), "object", "material", frame=5)
    assert later.layers["object"][0, [0, 10, 20]].tolist() == [0, 2, 3]
    assert later.layers["material"][0, [0, 10, 20]].tolist() == [0, 2, 1]
    assert later.metadata["objects"] == found.metadata["objects"]
    assert "objects" not in film(scene_of(*meshes), "material").metadata


def test_materials_are_one_where_they_are_equal_and_have_their_objects_names_in_scene_files():
    box = {"primitive": {"kind": "box", "size": [1, 1, 1]}}
    table = {
        "camera": {"position": [0, 0, 9], "look_at": [0, 0, 0]},
        "objects": [
            box | {"name": "left", "transform": {"translation": [-2, 0, 0]}},
            box | {"name": "right", "transform": {"translation": [2, 0, 0]}},
        ],
    }
    scene = mb.load(table)
    assert json.loads(film(scene, "material").metadata["materials"]) == ["left", "right"]
    same = replace(scene, meshes=[replace(mesh, material=Material("tin")) for mesh in scene.meshes])
    found = film(same, "material", "object")
    assert set(np.unique(found.layers["material"])) == {0, 1}
    assert set(np.unique(found.layers["object"])) == {0, 1, 2}


@pytest.mark.parametrize(
    ("t", "frame", "there"),
    [(0.5, 1.005, 0), (0.5, 0.995, 1), nightly(0.49, 1.0, 0), nightly(0.51, 1.0, 1),
     nightly(0.0, 1.0, 0), nightly(1.0, 1.0, 1)],
)  # fmt: skip
def test_what_appears_within_the_shutter_is_there_from_then_on(t, frame, there):
    mesh = card(WHOLE, 2.0, (0.5, 0, 0), visible=Track([0, frame], [0.0, 1.0], "step"))
    found = layers(scene_of(mesh), "object", "sharp", aov_time=t)
    assert (found["object"] == there).all()
    assert (found["sharp"][..., 3] == there).all()


@pytest.mark.parametrize(
    ("rolling", "t"), [("down", 0.5), ("right", 0.5), nightly("down", 0.0), nightly("right", 0.0)]
)
def test_of_a_rolling_shutter_the_moment_is_that_of_each_line(rolling, t):
    shutter = Shutter(open=0.0, rolling=rolling, line_offset=0.001, line_exposure=0.02)
    line = X if rolling == "right" else Y
    keys = Track([0, 4], [[-4.0, 0, 0], [12.0, 0, 0]])  # 32 pixels a frame
    mesh = replace(card(rectangle(0, 64, -40, 60), 2.0), transform=Transform(translation=keys))
    found = layers(scene_of(mesh, shutter=shutter), "object", "sharp", aov_time=t)
    frames = 1 + 24 * (0.001 * (line - 0.5) + 0.02 * t)
    want = 32 * (frames - 1) < X
    sure = np.abs(X - 32 * (frames - 1)) > 0.01
    assert np.array_equal(found["object"][sure], want[sure])
    assert np.array_equal(found["sharp"][sure][:, 3], want[sure])


def test_through_a_lens_the_moment_is_in_focus():
    lens = replace(UNIT_CAMERA, f_stop=0.01, focus_distance=9.0)
    mesh = card(rectangle(8, 20, -5, 30), 2.0, (0.5, 0, 0))
    sharp = layers(scene_of(mesh), *MOMENTARY)
    found = film(scene_of(mesh, camera=lens), *MOMENTARY, samples=3)
    for name in MOMENTARY:
        assert np.array_equal(found.layers[name], sharp[name]), name
    assert 0 < found.rgba[0, 7, 3] < 1


def test_operations_are_what_the_film_counts():
    mesh = slab(rectangle(4, 9, -5, 30), (12, 0), 2.0, SIZE)
    found = film(scene_of(mesh), "operations", samples=3)
    assert found.layers["operations"].sum() == found.stats["tests"] > 0
    assert not found.layers["operations"][:, 25:].any()
    wall = slab(rectangle(-5, 50, -5, 30), (0, 0), 5.0, SIZE)
    both = film(scene_of(mesh, wall), "operations", samples=3)
    more = both.layers["operations"].sum() - both.stats["tests"]
    assert more >= 3 * 32 * 16  # each sample at least against the triangle that it sees


@pytest.mark.parametrize(
    "way", [{}, nightly({"occlusion": 64}), nightly({"paths": "triangulated"})]
)
def test_the_image_does_not_change(way):
    mesh = slab(rectangle(4, 9, -5, 30), (12, 0), 2.0, SIZE)
    scene = scene_of(mesh, card(WHOLE, 5.0, (0, 1, 0), color=(0, 1, 0)))
    aovs = [name for name in AOVS if not (way and name in ("sharp", "operations"))]
    plain, asked = film(scene, samples=3, **way), film(scene, *aovs, samples=3, **way)
    for name in ("rgba", "depth", "intervals"):
        assert getattr(plain, name).tobytes() == getattr(asked, name).tobytes()
    assert tuple(asked.layers) == tuple(aovs)
    assert plain.layers == {}


@pytest.mark.parametrize(
    "settings",
    [{"pattern": "sobol", "filter": "mitchell"}, {"paths": "triangulated"},
     nightly({"tile_size": 8}), nightly({"tile_size": 32}), nightly({"samples": 4}),
     nightly({"occlusion": 32})],
    ids=str,
)  # fmt: skip
def test_the_moment_is_the_same_whatever_the_samples(settings):
    scene = scene_of(slab(rectangle(4, 9, -5, 30), (12, 3), 2.0, SIZE), card(WHOLE, 5.0, (0, 1, 0)))
    want = layers(scene, *MOMENTARY)
    found = layers(scene, *MOMENTARY, **settings)
    for name in MOMENTARY:
        assert found[name].tobytes() == want[name].tobytes(), name


def test_an_empty_scene_has_layers_too():
    found = layers(Scene(meshes=[], camera=UNIT_CAMERA), *AOVS)
    assert np.isinf(found["depth"]).all()
    assert not any(found[name].any() for name in AOVS if name != "depth")


def test_arrays_per_time_have_no_flow_of_their_own_and_that_is_said():
    scene = scene_of(replace(slab(WHOLE, (12, 0), 2.0, SIZE), name="panel"))
    found = film(scene, *TOGETHER)
    assert np.abs(found.layers["forward"]).max() < 1e-12
    assert any("'panel'" in note and "same in every frame" in note for note in found.notes)
    assert film(scene, "object").notes == ()


def test_names_are_taken_in_any_form_and_order():
    assert (
        check_aovs("uv, depth,uv", "aovs") == check_aovs(["uv", "depth"], "aovs") == ("depth", "uv")
    )
    assert check_aovs(None, "aovs") == check_aovs("", "aovs") == check_aovs((), "aovs") == ()
    with pytest.raises(UsageError, match=r"'dept' is unknown, did you mean depth\?"):
        mb.Settings(aovs="uv,dept")


def test_what_cannot_be_found_is_refused():
    with pytest.raises(UsageError, match=r"aovs=.* with occlusion=128: a mask"):
        mb.Settings(aovs="sharp", occlusion=128)
    with pytest.raises(UsageError, match=r"aovs=.* with paths='triangulated': operations"):
        mb.Settings(aovs="operations", paths="triangulated")
    shutter = Shutter(rolling="down", line_offset=1e-4, line_exposure=0.01)
    with pytest.raises(UsageError, match=r"forward and backward .* the shutter rolls"):
        film(scene_of(card(WHOLE, 2.0), shutter=shutter), "backward")
