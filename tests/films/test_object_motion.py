"""Control of motion blur by object, and the shutter as an angle."""

from __future__ import annotations

import numpy as np
import pytest

from mbinterval.cli.commands import make_job
from mbinterval.cli.program import _parser
from mbinterval.errors import SceneError
from mbinterval.exposure.exposure import expose
from mbinterval.scene.formats.load import load
from mbinterval.scene.model import Camera, Mesh, Scene, Shutter
from mbinterval.scene.tracks import Track
from mbinterval.scene.transforms import Transform

TRIANGLE = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
FACES = [[0, 1, 2]]
CAMERA = Camera(position=(0, 0, 5), look_at=(0, 0, 0))
MOVING = Transform(translation=Track(np.array([0.0, 10]), np.array([[0.0, 0, 0], [10, 0, 0]])))


def places(shutter, frame=4.0, **fields):
    """Where the mesh is in x at the ends of its segments; it is at x = frame."""
    mesh = Mesh(TRIANGLE, FACES, shading="unlit", **({"transform": MOVING} | fields))
    return expose(Scene([mesh], CAMERA, shutter=shutter), frame, 1.0).meshes[0].positions[:, 0, 0]


@pytest.mark.parametrize("shutter", [Shutter(-0.25, 0.25), Shutter(0.0, 0.5), Shutter(0.5, 1.0)])
def test_without_motion_blur_a_mesh_stands_where_it_is_at_the_frame(shutter):
    assert places(shutter, motion_blur=False).tolist() == [4.0]
    assert places(shutter, shutter_scale=0.0).tolist() == [4.0]


@pytest.mark.parametrize("scale", [0.5, 2.0])
def test_its_own_shutter_is_scaled_around_the_frame(scale):
    for shutter in (Shutter(-0.25, 0.25), Shutter(0.0, 0.5), Shutter(-0.5, -0.25)):
        ends = 4.0 + scale * np.array([shutter.open, shutter.close])
        np.testing.assert_allclose(places(shutter, shutter_scale=scale), ends, rtol=1e-12)


def test_positions_per_time_are_scaled_around_the_frame_too():
    moving = np.stack([TRIANGLE, TRIANGLE + [1, 0, 0]])
    mesh = Mesh(moving, FACES, shading="unlit", shutter_scale=0.5)
    result = expose(Scene([mesh], CAMERA, shutter=Shutter(-0.25, 0.75)), 0.0, 1.0).meshes[0]
    np.testing.assert_allclose(result.positions[:, 0, 0], [0.125, 0.625])
    mesh = Mesh(moving, FACES, shading="unlit", motion_blur=False)
    result = expose(Scene([mesh], CAMERA, shutter=Shutter(-0.25, 0.75)), 0.0, 1.0).meshes[0]
    np.testing.assert_allclose(result.positions[:, 0, 0], [0.25])


def test_a_camera_that_moves_blurs_what_has_no_blur_of_its_own():
    camera = Camera(
        position=Track(np.array([0.0, 10]), np.array([[0.0, 0, 5], [10, 0, 5]])), fov=40
    )
    mesh = Mesh(TRIANGLE, FACES, shading="unlit", transform=MOVING, motion_blur=False)
    result = expose(Scene([mesh], camera), 4.0, 1.0).meshes[0]
    assert (result.segments, len(result.positions)) == (1, 1)


@pytest.mark.parametrize("scale", [-1.0, float("nan"), "x", True])
def test_a_wrong_scale_is_a_scene_error(scale):
    with pytest.raises(SceneError, match="mesh 'm': shutter_scale="):
        Mesh(TRIANGLE, FACES, name="m", shutter_scale=scale)


@pytest.mark.parametrize(
    ("angle", "place", "window"),
    [
        (180, "centre", (-0.25, 0.25)),
        (180, "start", (0.0, 0.5)),
        (90, "end", (-0.25, 0.0)),
        (720, "centre", (-1.0, 1.0)),
    ],
)
def test_a_shutter_by_its_angle(angle, place, window):
    shutter = Shutter.from_angle(angle, place, curve="triangle")
    assert (shutter.open, shutter.close, shutter.curve) == (*window, "triangle")
    table = {"angle": angle, "place": place, "curve": "triangle"}
    assert load({"shutter": table}).shutter == shutter


@pytest.mark.parametrize("arguments", [(0,), (-90,), (float("inf"),), (180, "middle")])
def test_a_wrong_angle_is_a_scene_error(arguments):
    with pytest.raises(SceneError, match=r"shutter: (angle|place)="):
        Shutter.from_angle(*arguments)


def test_fields_of_a_scene_file():
    table = {
        "objects": [
            {"primitive": {"kind": "box"}, "motion_blur": False},
            {"primitive": {"kind": "box"}, "shutter_scale": 0.5, "motion_segments": 3},
            {"primitive": {"kind": "box"}},
        ]
    }
    found = [(m.motion_blur, m.shutter_scale, m.motion_segments) for m in load(table).meshes]
    assert found == [(False, 1.0, None), (True, 0.5, 3), (True, 1.0, None)]


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ({"shutter": {"angle": 180, "open": 0.0}}, "shutter.angle: given beside open or close"),
        ({"shutter": {"place": "start"}}, "shutter.place: goes with angle"),
        (
            {"objects": [{"primitive": {"kind": "box"}, "visible": True, "visibility": []}]},
            r"objects\[0\].visible: is given beside visibility",
        ),
        (
            {
                "objects": [
                    {
                        "primitive": {"kind": "box"},
                        "visibility": [
                            {"frame": 2, "visible": True},
                            {"frame": 1, "visible": False},
                        ],
                    }
                ]
            },
            r"objects\[0\].visibility\[1\].frame: 1 must come after 2",
        ),
    ],
)
def test_contradictions_in_a_scene_file(table, said):
    with pytest.raises(SceneError, match=said):
        load(table)


@pytest.mark.parametrize(
    ("option", "window"),
    [
        ("--shutter=-0.5,0.75", (-0.5, 0.75)),
        ("--shutter-angle=180", (-0.25, 0.25)),
        ("--shutter-angle=90,start", (0.0, 0.25)),
    ],
)
def test_the_shutter_of_the_command_line_wins(tmp_path, option, window):
    (tmp_path / "a.toml").write_text('[shutter]\nopen = 0.1\nclose = 0.2\ncurve = "triangle"\n')
    job = make_job(_parser().parse_args(["render", str(tmp_path / "a.toml"), option]))
    shutter = job.scene.shutter
    assert (shutter.open, shutter.close, shutter.curve) == (*window, "triangle")


@pytest.mark.parametrize(
    "option", ["--shutter=1", "--shutter=1,0", "--shutter-angle=x", "--shutter-angle=90,middle"]
)
def test_a_wrong_shutter_on_the_command_line_is_bad_usage(capsys, option):
    with pytest.raises(SystemExit) as exit_:
        _parser().parse_args(["render", "a.toml", option])
    assert exit_.value.code == 2
    assert "argument --shutter" in capsys.readouterr().err
