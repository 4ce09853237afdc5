"""Events: times in closed form, exposures that were never rendered, brightness changes, files."""

from __future__ import annotations

import itertools
import json
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from support.closed_forms import UNIT_CAMERA, rectangle, scene, slab, slab_times
from support.nightly import nightly
from support.oclgrind_scenes import colorful, seen_through

import mbinterval as mb
from mbinterval.errors import OutputError, UsageError
from mbinterval.scene.model import Camera, Light, Material, Mesh, Scene, Shutter
from mbinterval.scene.tracks import Track
from mbinterval.scene.transforms import Transform

SIZE = (32, 16)
X = np.arange(32) + 0.5


def film(of: Scene, **settings: object) -> mb.Film:
    chosen = {"samples": 1, "aovs": "events", "transparent": True} | settings
    return mb.render(of, width=32, height=16, settings=mb.Settings(**chosen))


def of_row(events: mb.Events, row: int) -> dict[str, np.ndarray]:
    inside = events.pixel // events.shape[1] == row
    found = {name: values[inside] for name, values in events.columns.items()}
    return found | {"x": events.pixel[inside] % events.shape[1]}


# What they say


def test_times_objects_depth_and_colour_of_slabs_are_in_closed_form():
    near = slab(rectangle(4.25, 9.25, -50, 50), (12, 0), 2.0, SIZE, (0.9, 0.2, 0.1))
    far = slab(rectangle(-50, 90, -50, 50), (3, 0), 4.0, SIZE, (0.1, 0.3, 0.8))
    row = of_row(film(scene([near, far])).events, 5)
    t0, t1 = slab_times(X, 4.25, 9.25, 12.0)
    first = row["object"] == 1
    seen = np.flatnonzero(t0 < t1)
    order = np.argsort(row["x"][first], kind="stable")
    # A slab is two triangles, so that what passes its diagonal is two events.
    x = row["x"][first][order]
    assert set(x) == set(seen)
    starts = np.array([row["t0"][first][row["x"][first] == k].min() for k in seen])
    ends = np.array([row["t1"][first][row["x"][first] == k].max() for k in seen])
    assert starts == pytest.approx(t0[seen], abs=1e-6)
    assert ends == pytest.approx(t1[seen], abs=1e-6)
    with pytest.raises(AssertionError):
        assert starts == pytest.approx(t0[seen] + 1e-3, abs=1e-6)
    assert set(row["face"]) == {0, 1}
    colors = np.stack([row[c] for c in "rgba"], axis=1)
    assert colors[first] == pytest.approx(np.tile([0.9, 0.2, 0.1, 1], (first.sum(), 1)))
    assert colors[~first] == pytest.approx(np.tile([0.1, 0.3, 0.8, 1], ((~first).sum(), 1)))
    for name in ("z0", "z1"):
        assert row[name] == pytest.approx(np.where(first, 2.0, 4.0))
    assert row["weight"] == pytest.approx(row["t1"] - row["t0"], abs=1e-7)
    assert (row["share"] == 1).all()
    # The wall is seen whenever the slab is not: each pixel's times are the whole exposure.
    assert np.bincount(row["x"], row["weight"]) == pytest.approx(1.0)


def test_of_a_rolling_shutter_times_are_those_of_each_line():
    near = slab(rectangle(4.25, 9.25, -50, 50), (12, 0), 2.0, SIZE)
    keys = Track([0, 4], [[-8.0, 0, 0], [24.0, 0, 0]])
    moving = replace(near, positions=near.positions[0], transform=Transform(translation=keys))
    shutter = Shutter(open=0.0, rolling="down", line_offset=0.002, line_exposure=0.01)
    found = film(Scene(meshes=[moving], camera=UNIT_CAMERA, shutter=shutter))
    events = found.events
    assert (events["t0"] >= 0).all()
    assert (events["t1"] <= 1).all()
    weight = np.bincount(events.pixel, events["t1"] - events["t0"], 512).reshape(16, 32)
    assert np.abs(weight - found.rgba[..., 3]).max() < 1e-5
    speed = 8.0 * 8 * 24  # pixels a second: 8 units a frame at depth 2, 8 px a unit
    for row in (3, 6):
        own = of_row(events, row)
        start = 4.25 + speed * 0.002 * row
        t0, _ = slab_times(X, start, start + 5, speed * 0.01)
        first = [own["t0"][own["x"] == x].min() for x in np.unique(own["x"])]
        assert first == pytest.approx(t0[np.unique(own["x"])], abs=1e-4)


# Exposures that were never rendered


def turning(**look: object) -> Scene:
    """A box and a card that turn and pass before a wall, seen by a camera that moves."""

    def turn(speed: float, way: tuple[float, float, float]) -> Transform:
        keys = np.linspace(0, 2, 33)
        half = np.outer(keys - 1, np.array([0.3, 1.0, 0.2]) * speed)
        angle = np.linalg.norm(half, axis=1, keepdims=True) + 1e-12
        spin = np.concatenate([half / angle * np.sin(angle), np.cos(angle)], axis=1)
        place = np.outer(keys - 1, way) + [0.1, 0, -3]
        return Transform(
            translation=Track(keys, place), rotation=Track(keys, spin, quaternion=True)
        )

    def panel(size: float, color, speed: float, way) -> Mesh:
        corners = np.array([[-1, -1, 0.2], [1, -1, 0], [1, 1, -0.2], [-1, 1, 0.0]]) * size
        material = Material(f"paint {size}", base_color=color, **({"shading": "unlit"} | look))
        mesh = Mesh(corners, [[0, 1, 2], [0, 2, 3]], material=material, motion_segments=357)
        return replace(mesh, transform=turn(speed, way))

    return Scene(
        meshes=[
            panel(0.5, (0.9, 0.3, 0.1), 2.0, (1.2, 0.1, 0.0)),
            panel(0.8, (0.1, 0.5, 0.9), -1.0, (-0.5, 0.4, 0.3)),
            replace(slab(rectangle(3, 22, 2, 11), (0, 0), 5.0, SIZE, (0.2, 0.2, 0.2))),
        ],
        camera=Camera(focal_length=24.0),
        lights=[Light("ambient", intensity=0.2), Light("directional", direction=(-1, -1, -1))],
        shutter=Shutter(open=-0.25, close=0.25),
    )  # fmt: skip


def rendered(of: Scene, start: float, end: float, segments: int) -> np.ndarray:
    """Render a part of the exposure, of as many of its motion segments."""
    part = Shutter(open=-0.25 + 0.5 * start, close=-0.25 + 0.5 * end)
    meshes = [
        replace(mesh, motion_segments=segments) if mesh.motion_segments else mesh
        for mesh in of.meshes
    ]
    return film(replace(of, shutter=part, meshes=meshes), aovs=(), texture_samples=64).rgba


@pytest.mark.parametrize("count", [1, 7, 51])
def test_one_render_has_the_sub_frames_of_any_exposure_within_it(count):
    """Against renders of these exposures; their motion segments are those of the whole."""
    of = turning()
    events = film(of).events
    times = np.linspace(0, 1, count + 1)
    errors, moved = [], []
    for start, end in itertools.pairwise(times):
        found, want = events.integrate(start, end), rendered(of, start, end, 357 // count)
        errors.append(np.abs(found - want).max())
        moved.append(np.abs(found - events.integrate()).max())
    # Sums of hundreds of float32, and times of float32 in a window of 1 / 51 of the exposure.
    assert max(errors) < 1e-5
    assert count == 1 or min(moved) > 0.1
    if count == 7:  # a sub-frame late by a hundredth of itself is another image
        late = events.integrate(times[2] + 0.01 / 7, times[3] + 0.01 / 7)
        assert np.abs(late - events.integrate(times[2], times[3])).max() > 1e-3


def test_sub_frames_add_up_to_the_film():
    found = film(turning(), samples=2)
    parts = [found.events.integrate(k / 51, (k + 1) / 51) for k in range(51)]
    assert np.abs(np.mean(parts, axis=0) - found.events.integrate()).max() < 1e-6
    assert np.abs(found.events.integrate() - found.rgba).max() < 1e-5  # sums of float32


def test_where_colour_changes_along_a_span_exposures_at_the_steps_are_renders_of_them():
    of = turning(shading="phong", specular=(0.6, 0.6, 0.6), shininess=20.0)
    events = film(of, event_steps=7, texture_samples=64).events
    errors = []
    for k in range(7):
        found, want = events.integrate(k / 7, (k + 1) / 7), rendered(of, k / 7, (k + 1) / 7, 51)
        errors.append(np.abs(found - want).max())
    assert max(errors) < 1e-4
    with pytest.raises(AssertionError):
        assert np.abs(found - events.integrate(5.9 / 7, 1)).max() < 1e-4


@pytest.mark.parametrize(
    ("steps", "start", "end"),
    [(4, 0.25, 0.75), (4, 0.0, 1.0), nightly(3, 1 / 3, 2 / 3), (1, 0.25, 0.5)],
)
def test_within_a_step_colour_is_constant_and_across_steps_it_is_exact(steps, start, end):
    """A card of grey that grows by 1/24 a pixel passes; its colour here is linear in time."""
    corners = rectangle(-60, 60, -50, 50)
    grey = (corners[:, :1] + 60) / 24 @ np.ones((1, 3))
    card = replace(slab(corners, (6, 0), 2.0, SIZE), color=grey, color_domain="vertex")
    found = film(scene([card]), event_steps=steps).events.integrate(start, end)[7]
    assert found[:, 3] == pytest.approx(1.0)
    want = (X + 60 - 6 * (start + end) / 2) / 24
    if steps == 1:  # the two triangles' diagonal cuts it, but not at these times
        assert np.abs(found[:, 0] - want).max() > 0.01
        assert np.abs(found[:, 0] - want).max() < 6 / 24
    else:
        assert found[:, 0] == pytest.approx(want, abs=2e-5)


def test_what_is_seen_through_is_integrated_in_its_order():
    whole = film(Scene(meshes=seen_through(), camera=UNIT_CAMERA), event_steps=8, texture_samples=4)
    events = whole.events
    halves = events.integrate(0, 0.5) + events.integrate(0.5, 1)
    assert np.abs(halves / 2 - events.integrate()).max() < 1e-6
    assert np.abs(events.integrate() - whole.rgba).max() < 0.2  # finer in parts than the film is
    one = film(Scene(meshes=seen_through(), camera=UNIT_CAMERA), event_steps=1, texture_samples=4)
    assert np.abs(one.events.integrate() - one.rgba).max() < 2e-6


@pytest.mark.parametrize(("start", "end"), [(0.5, 0.5), (0.6, 0.5), (-0.1, 1), (0, 1.1), (0, None)])
def test_times_that_are_no_exposure_are_refused(start, end):
    events = film(scene([])).events
    with pytest.raises(UsageError, match=r"^(start|end)="):
        events.integrate(start, end)
    assert not events.integrate(0.25, 0.5).any()


# Brightness changes


@pytest.mark.parametrize("samples", [1, 4])
def test_brightness_changes_come_when_edges_pass_and_as_many_as_the_step_is_high(samples):
    bright, dark, threshold, floor = 0.8, 0.05, 0.25, 1e-3
    mesh = slab(rectangle(4.25, 9.25, -50, 50), (12, 0), 2.0, SIZE, [bright] * 3)
    events = film(scene([mesh]), samples=samples).events
    found = events.brightness_changes(threshold, (dark, dark, dark), floor)
    if samples == 1:
        t0, t1 = slab_times(X, 4.25, 9.25, 12.0)
        level = np.log(bright + floor) - np.log(dark + floor)
        steps = int(level / threshold)
        assert steps == 11
        for x in range(32):
            own = (found["x"] == x) & (found["y"] == 3)
            ups, downs = (own & (found["polarity"] == sign) for sign in (1, -1))
            assert ups.sum() == steps * (0 < t0[x] < t1[x])
            # What it goes down from is what was reported last, not the level itself.
            began = level if t0[x] == 0 < t1[x] else steps * threshold
            left = int(began / threshold) * (0 < t1[x] < 1)
            assert downs.sum() == left
            assert found["t"][ups] == pytest.approx(t0[x], abs=1e-6)
            assert found["t"][downs] == pytest.approx(t1[x], abs=1e-6)
    else:  # edges pass the samples one after the other
        assert len(np.unique(found["t"])) > 40
    assert (np.diff(found["t"]) >= 0).all()
    assert set(found["polarity"]) == {1, -1}
    assert len(events.brightness_changes(20.0, (dark, dark, dark))["t"]) == 0


def test_changes_follow_the_brightness_itself_to_within_a_threshold():
    """What reports add up to is never further from the level than the threshold."""
    of = turning()
    events = film(of, samples=2).events
    behind, threshold, floor = (0.3, 0.2, 0.1), 0.07, 0.01
    found = events.brightness_changes(threshold, behind, floor)
    luminance = np.array([0.2126, 0.7152, 0.0722])

    def level(t: float) -> np.ndarray:
        image = events.integrate(t, t + 1e-4)
        rgb = image[..., :3] + (1 - image[..., 3:]) * behind
        return np.log(rgb @ luminance + floor)

    start = level(0.0)
    quiet = 0
    for t in (0.21, 0.5, 0.83):
        reported = np.zeros((16, 32))
        before = found["t"] <= t
        np.add.at(reported, (found["y"][before], found["x"][before]), found["polarity"][before])
        near = (found["t"] > t - 1e-3) & (found["t"] < t + 1e-3)
        settled = np.ones((16, 32), bool)
        settled[found["y"][near], found["x"][near]] = False
        error = np.abs(start + threshold * reported - level(t))[settled]
        assert np.quantile(error, 0.99) < 1.02 * threshold
        quiet += (np.abs(level(t) - start)[settled] > threshold).sum()
    assert quiet > 20


@pytest.mark.parametrize("bad", [{"threshold": 0}, {"threshold": 1, "floor": 0}])
def test_a_threshold_that_is_none_is_refused(bad):
    events = film(scene([])).events
    with pytest.raises(UsageError, match="expected a number above 0"):
        events.brightness_changes(**bad)
    with pytest.raises(UsageError, match="background has 2 colours"):
        events.brightness_changes(0.1, np.zeros((2, 3)))
    assert len(events.brightness_changes(0.1, np.ones((16, 32, 3)))["t"]) == 0


# Files


@pytest.mark.parametrize("ending", ["npz", "parquet"])
def test_a_file_has_all_of_it_is_the_same_each_time_and_reads_back(tmp_path, ending):
    of = Scene(meshes=colorful(), camera=UNIT_CAMERA)
    chosen = mb.Settings(samples=2, aovs="events", event_steps=3, texture_samples=2)
    found = mb.render(of, width=32, height=16, settings=chosen, crop=(3, 2, 20, 11))
    path = found.write(tmp_path / f"a.{ending}")
    again = mb.Events.read(path)
    assert again.shape == (11, 20, 2)
    assert np.array_equal(again.offsets, found.events.offsets)
    for name, values in found.events.columns.items():
        assert again[name].dtype == values.dtype
        assert np.array_equal(again[name], values), name
    assert (again.resolution, again.origin) == ((32, 16), (3, 2))
    assert again.metadata["settings.event_steps"] == 3
    assert again.metadata["worldToCamera"] == found.metadata["worldToCamera"]
    assert again.write(tmp_path / f"b.{ending}").read_bytes() == path.read_bytes()
    data = path.read_bytes()
    for part in (0, 3, len(data) // 2, len(data) - 9):
        (tmp_path / f"cut.{ending}").write_bytes(data[:part])
        with pytest.raises(OutputError, match=rf"cut\.{ending}: not a whole file of events"):
            mb.Events.read(tmp_path / f"cut.{ending}")
    with pytest.raises(OutputError, match="no such file"):
        mb.Events.read(tmp_path / f"none.{ending}")
    empty = film(Scene(meshes=[], camera=UNIT_CAMERA)).write(tmp_path / f"empty.{ending}")
    assert len(mb.Events.read(empty)) == 0


def test_numpy_and_pyarrow_alone_read_what_the_readme_says(tmp_path):
    import pyarrow.parquet

    found = film(scene([slab(rectangle(4, 19, -5, 30), (6, 0), 2.0, SIZE)]), samples=2)
    with np.load(found.write(tmp_path / "a.npz")) as file:
        rows, columns, samples = json.loads(str(file["shape"]))
        assert (rows, columns, samples) == (16, 32, 2)
        place = (7 * columns + 20) * samples
        first, end = file["offsets"][place], file["offsets"][place + samples]
        alpha = (file["weight"] * file["a"])[first:end].sum()
    assert alpha == pytest.approx(found.rgba[7, 20, 3], abs=1e-6)
    assert 0.1 < alpha < 1.0
    table = pyarrow.parquet.read_table(found.write(tmp_path / "a.parquet"))
    assert table.column_names[:3] == ["x", "y", "sample"]
    x, y = table["x"].to_numpy(), table["y"].to_numpy()
    own = (x == 20) & (y == 7)
    assert (table["weight"].to_numpy() * table["a"].to_numpy())[own].sum() == pytest.approx(alpha)


def test_a_film_without_them_and_other_files_are_refused(tmp_path):
    plain = mb.render(scene([]), width=4, height=4)
    with pytest.raises(UsageError, match=r"a\.npz: the film has no events; .*aovs='events'"):
        plain.write(tmp_path / "a.npz")
    for name, refusal in (
        ("a.txt", "unknown ending"),
        ("a.exr", r"events are written as \.npz or"),
    ):
        with pytest.raises(UsageError, match=f"{name}: {refusal}"):
            film(scene([])).events.write(tmp_path / name)
    np.savez(tmp_path / "other.npz", a=np.zeros(3))
    with pytest.raises(OutputError, match=r"other\.npz: not a whole file of events"):
        mb.Events.read(tmp_path / "other.npz")


def test_without_pyarrow_parquet_is_refused_before_anything_is_rendered(tmp_path):
    code = (
        "import sys; sys.modules['pyarrow'] = None\n"
        "from mbinterval import cli\n"
        "sys.exit(cli.main(['render', 's.toml', '-o', 'a.parquet']))"
    )
    (tmp_path / "s.toml").write_text("[camera]\nposition = [0, 0, 4]\nlook_at = [0, 0, 0]\n")
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True
    )
    assert done.returncode == 2
    assert "need pyarrow: pip install 'mbinterval[parquet]', or write .npz" in done.stderr
