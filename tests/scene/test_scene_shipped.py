"""Every scene in scenes/ loads, moves, says why it exists, and is what its comment claims."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mbinterval.exposure.exposure import expose
from mbinterval.scene.formats.load import load, load_file
from mbinterval.settings.settings import Settings

FOLDER = Path(__file__).parents[2] / "scenes"
SCENES = sorted(path.name for path in FOLDER.glob("*.toml"))


def test_there_are_enough_scenes():
    wanted = {"slab_behind_slit", "rolling_wheel", "crossing_depth", "ho17_cubes", "milk_truck"}
    assert wanted <= {name.removesuffix(".toml") for name in SCENES}
    assert len(SCENES) >= 6


@pytest.mark.parametrize("name", SCENES)
def test_scene(name):
    path = FOLDER / name
    assert path.read_text(encoding="utf-8").startswith("# Why: ")
    file = load_file(path)
    Settings.from_mapping(file.settings)
    assert file.render.width
    assert file.render.height
    assert file.scene.notes == ()
    first = float(file.render.frames.split("-")[0])
    exposure = expose(file.scene, first, file.render.width / file.render.height)
    assert exposure.notes == ()
    assert any(mesh.segments for mesh in exposure.meshes)
    for mesh in exposure.meshes:
        assert np.isfinite(mesh.positions).all()


def test_assets_are_small_and_their_licences_are_named():
    files = [path for path in (FOLDER / "assets").iterdir() if path.is_file()]
    assert sum(path.stat().st_size for path in files) < 1.5e6
    text = (FOLDER / "assets" / "LICENSES.md").read_text(encoding="utf-8")
    for path in files:
        if path.name != "LICENSES.md":
            assert path.name in text
    assert "trademark" in text


def test_milk_truck_rolls_without_slipping():
    """The lowest point of a wheel stands still while it touches the road."""
    scene = load(FOLDER / "milk_truck.toml")
    wheel = next(mesh for mesh in scene.meshes if "Wheels" in mesh.name)
    radius = np.hypot(wheel.positions[:, 0], wheel.positions[:, 1]).max()
    speeds = []
    for frame in np.linspace(1, 14, 27):
        before, after = (wheel.transform.at(frame + d) for d in (-0.01, 0.01))
        axle = wheel.transform.at(frame)[:3, 3]
        contact = np.append(axle - (0, radius, 0), 1.0)
        local = np.linalg.solve(wheel.transform.at(frame), contact)
        speeds.append(((after - before) @ local)[:3] / 0.02)
        assert ((after - before)[0, 3]) / 0.02 == pytest.approx(2 * 1.306 / 15, rel=1e-6)
        assert axle[1] == pytest.approx(radius, rel=1e-3)
    assert np.abs(np.mean(speeds, axis=0)).max() < 1e-3
    assert np.abs(speeds).max() < 0.02


def test_slab_behind_slit_has_its_closed_form_geometry():
    """The slab covers each point behind the slit for a third of the shutter."""
    file = load_file(FOLDER / "slab_behind_slit.toml")
    slab, left, right = expose(file.scene, 1.0, 1.5).meshes
    travelled = slab.positions[1, :, 0] - slab.positions[0, :, 0]
    np.testing.assert_allclose(travelled, 3.0)
    width = np.ptp(slab.positions[0, :, 0])
    assert width / travelled[0] == pytest.approx(1 / 3)
    # The slit's edges, seen from z = 4 and projected on the slab's plane.
    low, high = left.positions[0, :, 0].max() * 4 / 3, right.positions[0, :, 0].min() * 4 / 3
    assert (low, high) == (-0.5, 0.5)
    assert slab.positions[0, :, 0].max() < low
    assert slab.positions[1, :, 0].min() > high
