"""A file says how it was made, in terms that other programs know, and never when or where."""

import numpy as np
import OpenEXR
import pytest
from support.films import make_film

import mbinterval
from mbinterval.exposure.exposure import expose
from mbinterval.rendering.metadata import frame_metadata
from mbinterval.scene.model import Camera, Scene, Shutter
from mbinterval.scene.tracks import Track
from mbinterval.settings.settings import RULES, Settings

MOVING = Camera(
    position=Track(frames=[0, 2], values=[[3, 1, 5], [4, 1, 5]]),
    look_at=(0, 0, 0),
    fov=40,
    name="left",
)


def metadata(camera=MOVING, settings=None, **fields):
    scene = Scene(meshes=(), camera=camera, shutter=Shutter(0.0, 0.5), fps=25, **fields)
    return frame_metadata(scene, expose(scene, 1.0, 4 / 3), settings or Settings())


def test_it_names_frame_shutter_camera_settings_and_version():
    settings = Settings(samples=7, paths="triangulated", max_intervals=90, transparent=True)
    found = metadata(settings=settings, name="wheel")
    assert found["software"] == f"mbinterval {mbinterval.__version__}"
    assert (found["frame"], found["fps"]) == (1.0, 25.0)
    assert (found["shutterOpen"], found["shutterClose"]) == (0.0, 0.5)
    assert found["expTime"] == pytest.approx(0.02)
    assert found["fieldOfView"] == pytest.approx(40.0)
    assert (found["camera"], found["scene"]) == ("left", "wheel")
    assert (found["settings.samples"], found["settings.max_intervals"]) == (7, 90)
    assert found["settings.transparent"] == 1


def test_the_matrices_take_world_points_to_the_camera_at_open_and_close():
    found = metadata()
    for name, eye in (
        ("worldToCamera", np.array([3.5, 1, 5])),
        ("worldToCameraClose", np.array([3.75, 1, 5])),
    ):
        matrix = np.reshape(found[name], (4, 4))
        assert np.append(eye, 1) @ matrix == pytest.approx([0, 0, 0, 1])
        distance = np.linalg.norm(eye)
        assert [0, 0, 0, 1] @ matrix == pytest.approx([0, 0, -distance, 1])
        assert ([0, 1, 0, 1] @ matrix)[1] > 0
    still = metadata(Camera(position=(0, 0, 5), look_at=(0, 0, 0)))
    assert "worldToCameraClose" not in still


def test_what_cannot_change_the_image_is_left_out():
    assert metadata(settings=Settings(tile_size=8)) == metadata(settings=Settings(tile_size=32))
    changed = Settings(
        paths="triangulated",
        max_intervals=1,
        motion_segments=1,
        texture_samples=4,
        filter_radius=1.0,
        aovs="crypto_object,deep",
    )
    given = metadata(settings=changed)
    for name, rule in RULES.items():
        written = "analytic" in rule.methods and not rule.speed_only and name != "shadows"
        if rule.of_aovs:
            written = bool(set(rule.of_aovs) & set(changed.aovs))
        assert (f"settings.{name}" in given) == written
    of_aovs = {"aovs", "aov_time", *(name for name, rule in RULES.items() if rule.of_aovs)}
    assert not {f"settings.{name}" for name in of_aovs} & metadata(settings=Settings()).keys()
    sampled = metadata(settings=Settings(method="stochastic", cull="hull", statistics=True))
    assert sampled == metadata(settings=Settings(method="stochastic"))
    assert sampled["settings.pattern"] == "sobol"
    assert "settings.occlusion" not in sampled
    assert metadata(settings=Settings(shadows="off"))["settings.shadows"] == "off"
    mapped = metadata(settings=Settings(method="stochastic", shadow_map=64))
    assert {name: mapped[f"settings.shadow_{name}"] for name in ("map", "strata", "bias")} == {
        "map": 64, "strata": 4, "bias": 3.0
    }  # fmt: skip
    printed = metadata(settings=Settings(method="stochastic", cull="clip_space_printed"))
    assert printed["settings.cull"] == "clip_space_printed"


def test_a_file_takes_all_of_it_with_the_types_of_the_standard(tmp_path):
    found = metadata()
    path = make_film(metadata=found).write(tmp_path / "a.exr")
    header = OpenEXR.File(str(path)).header()
    assert header["worldToCamera"].shape == (4, 4)
    assert header["worldToCamera"].dtype == np.float32
    assert isinstance(header["expTime"], float)
    back = mbinterval.Film.read(path).metadata
    assert set(back) == set(found)
    assert back["frame"] == 1.0
    assert back["settings.paths"] == found["settings.paths"] == "exact"
    assert back["settings.transparent"] == found["settings.transparent"] == 0


def test_it_says_what_else_the_shutter_and_the_lens_do():
    plain = metadata()
    assert not {"shutterCurve", "shutterRolling", "lineOffset", "aperture", "focus"} & plain.keys()
    shutter = Shutter(curve="triangle", rolling="up", line_offset=1e-5, line_exposure=0.01)
    camera = Camera(position=(0, 0, 5), look_at=(0, 0, 0), f_stop=2.8, focus_distance=5.0)
    scene = Scene(meshes=(), camera=camera, shutter=shutter)
    found = frame_metadata(scene, expose(scene, 1.0, 4 / 3, lines=600), Settings())
    assert (found["shutterCurve"], found["shutterRolling"]) == ("triangle", "up")
    assert (found["lineOffset"], found["expTime"]) == (1e-5, 0.01)
    assert (found["aperture"], found["focus"]) == (2.8, 5.0)
