"""Benchmarks: what is measured is what was rendered, and what is compared is comparable."""

from __future__ import annotations

import dataclasses
import json
import os
from pathlib import Path

import numpy as np
import pytest
from support.closed_forms import rectangle, scene, slab

import mbinterval as mb
from mbinterval import cli
from mbinterval.bench import bench
from mbinterval.bench.cases import Case, is_closed, make_case
from mbinterval.bench.meter import (
    MEMBERS,
    MeteredRuntime,
    clear_peak_memory,
    copy_bandwidth,
    moved_bytes,
    peak_memory,
)
from mbinterval.bench.report import changes, comparison, read_result, table
from mbinterval.device import records
from mbinterval.device.choose import choose_device
from mbinterval.device.runtime import runtime
from mbinterval.errors import SceneError, UsageError
from mbinterval.files.results import write_result
from mbinterval.scene.generators import blades, dense_sphere, fast_cubes
from mbinterval.scene.primitives import box, plane

SCENES = Path(__file__).resolve().parents[2] / "scenes"
SMALL = ("--width", "48", "--height", "32", "--rounds", "2")


@pytest.fixture(scope="module")
def meter() -> MeteredRuntime:
    return MeteredRuntime(choose_device())


def small_case(**fields: object) -> Case:
    return dataclasses.replace(make_case("fast_cubes:40", width=48, height=32), **fields)


@pytest.fixture(scope="module")
def result() -> dict:
    settings = mb.Settings(samples=1)
    film = mb.render(fast_cubes(40), width=48, height=32, settings=settings)
    return bench.measure([small_case(reference=film.rgba[..., :3])], rounds=3)


def rows_of(result: dict) -> dict:
    return {row["name"]: row for row in result["scenes"][0]["rows"]}


def test_every_row_has_times_that_belong_together(result):
    rows = rows_of(result)
    assert tuple(rows) == tuple(bench.ROWS)
    for row in rows.values():
        assert len(row["seconds"]) == 3
        assert row["minimum"] == min(row["seconds"]) > 0
        assert row["median"] == sorted(row["seconds"])[1]
        assert row["ratio"] == pytest.approx(row["median"] / rows["exact 1"]["median"])
        assert 0 < row["processor"] < 1.5 * max(row["seconds"]) * (os.cpu_count() or 1)
        assert row["stages"]["host"] > 0
        assert sum(row["stages"].values()) < 3 * max(row["seconds"])
    assert {"solve", "envelope"} <= rows["exact 1"]["stages"].keys()
    assert {"rasterize", "sort"} <= rows["hong-oh"]["stages"].keys()


def test_the_counts_are_those_of_a_render(result):
    rows = rows_of(result)
    for name, count in (("exact 1", 1), ("exact 4", 4)):
        settings = mb.Settings(samples=count)
        film = mb.render(fast_cubes(40), width=48, height=32, settings=settings)
        assert rows[name]["intervals"] == pytest.approx(film.intervals.mean() / count)
        assert (rows[name]["tests"], rows[name]["hits"]) == (
            film.stats["tests"],
            film.stats["hits"],
        )
    assert result["scenes"][0]["triangles"] == 480
    assert "tests" not in rows["hong-oh"]


def test_the_error_is_nought_against_itself_and_not_against_others(result):
    rows = rows_of(result)
    assert rows["exact 1"]["rmse"] == 0.0
    assert all(row["rmse"] > 1e-3 for name, row in rows.items() if name != "exact 1")


def test_rows_state_their_settings_in_full(result):
    for row in rows_of(result).values():
        settings = eval(f"Settings({row['settings']})", {"Settings": mb.Settings})
        want = {**bench.ROWS[row["name"]]}
        assert {name: getattr(settings, name) for name in want} == want


def test_rounds_are_interleaved(monkeypatch):
    asked = []
    render = bench.render

    def noting(*arguments, **options):
        asked.append((options["settings"].samples, options["settings"].paths))
        return render(*arguments, **options)

    monkeypatch.setattr(bench, "render", noting)
    bench.measure([small_case()], ["exact 1", "exact 2", "hong-oh"], rounds=2)
    assert asked == [(1, "exact"), (2, "exact"), (1, "triangulated")] * 3  # one builds the kernels


def test_a_row_that_a_scene_does_not_allow_says_why_and_the_others_are_measured():
    lens = mb.Camera(position=(0, 0, 16), fov=40, f_stop=2.0, focus_distance=16)
    case = small_case(scene=dataclasses.replace(fast_cubes(10), camera=lens))
    got = bench.measure([case], ["hong-oh", "exact 1"], rounds=1)
    hong_oh, exact = got["scenes"][0]["rows"]
    assert "lens" in hong_oh["error"]
    assert exact["ratio"] == 1.0
    assert hong_oh["error"] in table(got)


def test_a_scene_files_settings_stay_unless_they_are_the_rows():
    stored = {"motion_segments": 3, "samples": 9, "paths": "triangulated", "filter_radius": 1.0}
    settings = bench._settings_of(small_case(settings=stored), bench.ROWS["exact 2"])
    assert settings == mb.Settings(samples=2, motion_segments=3)


def test_point_samples_have_their_rate_and_no_interval_or_byte():
    row = 'method="stochastic", samples=64'
    names = ["exact 1", row, "z-buffer 4", 'method="accumulation", slices=8, samples=2']
    result = bench.measure([small_case()], names, rounds=1)
    rows = rows_of(result)
    assert tuple(rows) == tuple(names)
    for name, count in zip(names[1:], (64, 4, 16), strict=True):
        assert rows[name]["rate"] == pytest.approx(48 * 32 * count / rows[name]["median"])
        assert not rows[name].keys() & {"intervals", "moved", "bandwidth"}
        assert {"scatter", "sample"} <= rows[name]["stages"].keys()
    assert "rate" not in rows["exact 1"]
    lines = [line for line in table(result).splitlines() if line.startswith("| method")]
    assert f"| {rows[row]['rate'] / 1e6:.1f} " in lines[0]


def test_a_scene_files_settings_of_other_methods_give_way():
    stored = {"texture_samples": 4, "tile_size": 8, "occlusion": 64, "seed": 3, "frameless": 2}
    case = small_case(settings=stored)
    stochastic = bench._settings_of(case, bench._values_of('method="stochastic",samples=9'))
    assert stochastic == mb.Settings(method="stochastic", samples=9, seed=3)
    assert bench._settings_of(case, bench.ROWS["exact 1"]) == mb.Settings(
        samples=1, seed=3, texture_samples=4
    )


def test_equal_error_takes_the_fewest_samples_that_are_as_good():
    settings = mb.Settings(samples=64, pattern="sobol")
    film = mb.render(fast_cubes(40), width=48, height=32, settings=settings)
    case = small_case(reference=film.rgba[..., :3])
    rows = rows_of(bench.measure([case], ["five-point 1", bench.EQUAL_ERROR], rounds=1))
    equal, first = rows[bench.EQUAL_ERROR], rows["five-point 1"]
    assert equal["rmse"] <= first["rmse"]
    found = eval(f"Settings({equal['settings']})", {"Settings": mb.Settings})
    assert found.method == "stochastic"
    fewer = mb.Settings(method="stochastic", samples=found.samples * 7 // 8 - 1)
    other = mb.render(fast_cubes(40), width=48, height=32, settings=fewer).rgba
    assert np.sqrt(np.mean((other[..., :3] - case.reference) ** 2)) > first["rmse"]
    alone = bench.measure([small_case()], ["exact 1", bench.EQUAL_ERROR], rounds=1)
    assert "needs a reference" in rows_of(alone)[bench.EQUAL_ERROR]["error"]


def test_at_rest_the_z_buffer_and_exact_time_see_the_same():
    case = make_case("fast_cubes:40", width=48, height=32, at_rest=True)
    exact, buffered = (
        mb.render(
            case.scene,
            width=48,
            height=32,
            settings=bench._settings_of(case, bench._values_of(row)),
        ).rgba
        for row in ("exact 4", "z-buffer 4")
    )
    assert np.abs(exact - buffered).max() < 1e-5
    moving = mb.render(fast_cubes(40), width=48, height=32, settings=mb.Settings(samples=4)).rgba
    assert np.abs(exact - moving).max() > 0.1
    with pytest.raises(UsageError, match="its camera moves"):
        make_case(str(SCENES / "fly_by.toml"), width=48, height=32, at_rest=True)


def test_a_row_that_is_unknown_is_named_with_the_nearest():
    with pytest.raises(UsageError, match=r"'exakt 1'.*did you mean exact 1"):
        bench.measure([], ["exakt 1"])


# What is metered.


def test_a_metered_device_renders_the_same_bytes(meter):
    for row in bench.ROWS.values():
        options = {"width": 48, "height": 32, "settings": mb.Settings(**row)}
        plain = mb.render(fast_cubes(40), **options)
        metered = mb.render(fast_cubes(40), device=meter, **options)
        assert np.array_equal(plain.rgba, metered.rgba)


def test_bytes_moved_are_those_of_a_scene_that_can_be_counted_by_hand(meter):
    """One triangle, listed by the one tile of the film."""
    slab_of_two = slab(rectangle(3, 9, -50, 50), (40, 0), 2.0, (16, 16))
    triangle = dataclasses.replace(slab_of_two, faces=slab_of_two.faces[:1], color=None)
    picture = scene([triangle])
    settings = mb.Settings(samples=1)
    meter.clear()
    film = mb.render(picture, width=16, height=16, settings=settings, device=meter)
    assert meter.allocated[MEMBERS] == 4
    vertices = len(triangle.positions[0]) * 2
    made = vertices * 32 + records.SHAPE.itemsize + records.DEPTH.itemsize + 4
    lists = int(film.intervals.sum()) * (
        records.VISIT.itemsize + records.FRONT.itemsize + records.SPAN.itemsize
    )
    path = records.PATH.itemsize + records.SHAPE.itemsize + 6 * 32 + records.DEPTH.itemsize
    want = sum(meter.uploaded.values()) + 2 * (made + lists + 24 * 256) + path
    assert film.intervals.sum() > 50
    assert moved_bytes(meter, film, settings) == want
    assert meter.uploaded["positions"] == vertices * 24


def test_more_intervals_move_more_bytes(meter):
    moved = []
    for count in (1, 2, 4):
        meter.clear()
        settings = mb.Settings(samples=count)
        film = mb.render(fast_cubes(40), width=48, height=32, settings=settings, device=meter)
        moved.append(moved_bytes(meter, film, settings))
    assert moved[0] < moved[1] < moved[2] < 4 * moved[0]


def test_the_copy_that_measures_the_device_copies_everything():
    device, rng = runtime(), np.random.default_rng(1)
    values = rng.integers(0, 2**30, 16 * 24 * device.workers, dtype=np.int32)
    values = values.view(np.float32)
    target = device.allocate("float", values.size)
    given = {"from": device.upload("float", values), "to": target, "share": 24}
    device.run(device.kernel("shared/copy.cl", "copy"), device.workers, given)
    found = device.download(target, values.shape, np.float32)
    assert np.array_equal(found.view(np.int32), values.view(np.int32))


def test_the_copy_bandwidth_is_plausible():
    assert 1e8 < copy_bandwidth(runtime(), rounds=2) < 1e13


def test_peak_memory_sees_what_is_touched_and_starts_anew():
    clear_peak_memory()
    before = peak_memory()
    block = np.ones(1 << 24)  # 128 MiB
    during = peak_memory()
    assert during - before > 0.9 * block.nbytes
    del block
    clear_peak_memory()
    assert peak_memory() < during - 0.5 * 2**27


# Scenes.


def test_closed_meshes_are_known():
    assert is_closed(fast_cubes(5).meshes[0])
    assert is_closed(dense_sphere(2).meshes[0])
    assert is_closed(box())  # each side has vertices of its own
    assert not is_closed(plane())
    assert not is_closed(blades(4).meshes[0])
    cubes = fast_cubes(5).meshes[0]
    assert not is_closed(dataclasses.replace(cubes, faces=cubes.faces[1:], color=None))
    assert not is_closed(dataclasses.replace(cubes, faces=cubes.faces[:, ::-1]))  # inside out
    doubled = np.concatenate([cubes.faces, cubes.faces[:12]])
    assert not is_closed(dataclasses.replace(cubes, faces=doubled, color=None))


def test_single_sided_closed_meshes_look_the_same_and_meet_fewer_intervals(tmp_path):
    mesh = fast_cubes(40, double_sided=True).meshes[0]
    path = tmp_path / "cubes.npz"
    np.savez(path, V0=mesh.positions[0], V1=mesh.positions[1], F=mesh.faces, C=mesh.color,
             eye=[0, 0, 16], fov=40.0, bg=0.18, W=48, H=32)  # fmt: skip
    films = [
        mb.render(case.scene, width=48, height=32, settings=mb.Settings(samples=4))
        for case in (make_case(str(path)), make_case(str(path), single_sided=True))
    ]
    assert np.abs(films[0].rgba - films[1].rgba).max() < 1e-5
    assert films[1].intervals.sum() < 0.6 * films[0].intervals.sum()


def test_generated_scenes_take_a_count_and_a_size():
    case = make_case("fast_cubes:3", height=96)
    assert (len(case.scene.meshes[0].faces), case.width, case.height) == (36, 128, 96)
    for name in bench.SCENES:
        assert make_case(name.replace("dense_sphere", "dense_sphere:1")).width == 1024


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ("fast_cube", "did you mean fast_cubes"),
        ("fast_cubes:many", "'many' is no count, as in fast_cubes:100"),
        ("no/such.toml", "no such file"),
        ("dense_sphere:40", "count=40, expected"),
    ],
)
def test_a_scene_that_is_neither_file_nor_generated_is_an_error(source, message):
    with pytest.raises((UsageError, SceneError), match=message):
        make_case(source)


def test_references_of_both_kinds_are_read_and_checked(tmp_path):
    film = mb.render(fast_cubes(3), width=48, height=32)
    film.write(tmp_path / "a.exr")
    np.savez(tmp_path / "a.npz", rgb=film.rgba[..., :3])
    np.savez(tmp_path / "other.npz", image=film.rgba)
    (tmp_path / "text.npz").write_text("no archive")
    for name in ("a.exr", "a.npz"):
        case = make_case("fast_cubes:3", str(tmp_path / name), 48, 32)
        assert np.array_equal(case.reference, film.rgba[..., :3])
    with pytest.raises(UsageError, match=r"48 x 32 pixels, but fast_cubes:3 is 64 x 32"):
        make_case("fast_cubes:3", str(tmp_path / "a.exr"), 64, 32)
    for name in ("other.npz", "text.npz", "missing.npz"):
        with pytest.raises(SceneError, match=f"{name}.*array rgb"):
            make_case("fast_cubes:3", str(tmp_path / name), 48, 32)


# Comparison.


def scaled(result: dict, factor: float) -> dict:
    other = json.loads(json.dumps(result))
    for row in rows_of(other).values():
        row["median"] *= factor
    return other


def test_a_result_survives_its_file(result, tmp_path):
    write_result(tmp_path / "r.json", result)
    assert read_result(tmp_path / "r.json") == result


@pytest.mark.parametrize("text", ["", "[]", '{"format": 0, "scenes": []}', '{"format": 1}'])
def test_a_file_that_is_no_result_is_an_error(text, tmp_path):
    (tmp_path / "r.json").write_text(text)
    with pytest.raises(UsageError, match=r"baseline .*r\.json: not a result"):
        read_result(tmp_path / "r.json")


def test_changes_are_ratios_of_medians_flagged_beyond_the_spread(result):
    steady = json.loads(json.dumps(result))
    for row in rows_of(steady).values():
        row["spread"] = 0.04
    assert all(c.ratio == 1.0 and not c.beyond for c in changes(steady, steady))
    assert not any(c.beyond for c in changes(steady, scaled(steady, 1.07)))
    faster = changes(steady, scaled(steady, 2.0))
    assert all(c.ratio == pytest.approx(0.5) and c.beyond for c in faster)
    text = comparison(changes(steady, scaled(steady, 0.5)), steady, steady)
    assert text.count("| slower |") == len(bench.ROWS)


def test_only_rows_of_the_same_settings_and_size_are_compared(result):
    other = json.loads(json.dumps(result))
    rows_of(other)["exact 2"]["settings"] = "samples=2, seed=1"
    found = changes(result, other)
    assert [c.row for c in found] == [name for name in bench.ROWS if name != "exact 2"]
    assert "1 rows are not in the baseline" in comparison(found, result, other)
    other["scenes"][0]["width"] += 1
    other["machine"] = {"processor": "another"}
    assert changes(result, other) == []
    assert "machine: processor was another, is" in comparison([], result, other)


# The command.


def test_the_command_prints_writes_and_compares(tmp_path, capsys):
    file, arguments = tmp_path / "r.json", ["bench", "fast_cubes:20", *SMALL, "--rows", "exact 1"]
    assert cli.main([*arguments, "--json", str(file)]) == 0
    out = capsys.readouterr().out
    assert "fast_cubes:20: 240 triangles, 48 x 32" in out
    assert "samples=1" in out
    stored = read_result(file)
    slow, quick = tmp_path / "slow.json", tmp_path / "quick.json"
    write_result(slow, scaled(stored, 100.0))
    write_result(quick, scaled(stored, 0.01))
    with_settings = [*arguments, "--settings", 'method="stochastic", samples=2']
    assert cli.main(with_settings) == 0
    assert capsys.readouterr().out.count('method="stochastic", samples=2') >= 1
    assert cli.main([*arguments, "--baseline", str(slow)]) == 0
    assert "faster" in capsys.readouterr().out
    assert cli.main([*arguments, "--baseline", str(quick)]) == 1
    captured = capsys.readouterr()
    assert "by more than 10%: fast_cubes:20, exact 1" in captured.err
    assert "slower" in captured.out
    assert cli.main([*arguments, "--baseline", str(quick), "--tolerance", "1e6"]) == 0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--rows", "nothing"], "row 'nothing': unknown, known here: exact 1"),
        (["--settings", "samples=x"], "expected settings as in"),
        (["--settings", "samples=4, 'a'"], "expected settings as in"),
        (["--settings", "sample=4"], "did you mean samples"),
        (["--settings", 'method="stochastic", paths="exact", occlusion=128'], "it is for method="),
        (["--tolerance", "0.2"], "give --baseline"),
        (["--reference", "a.exr", "--reference", "b.exr"], "2 references for 1 scenes"),
        (["--baseline", "missing.json"], "baseline missing.json"),
    ],
)
def test_mistakes_are_told_before_anything_is_rendered(options, message, capsys, monkeypatch):
    monkeypatch.setattr(bench, "render", lambda *_, **__: pytest.fail("rendered"))
    assert cli.main(["bench", "fast_cubes:20", *SMALL, *options]) == 2
    assert message in capsys.readouterr().err


def test_rows_may_be_settings_of_ones_own_with_figures_of_ones_own():
    rows = {"one": {"samples": 1}, "two": {"samples": 2}, "wrong": {"samples": 0}}
    measured = bench.measure(
        [small_case()],
        rows,
        rounds=1,
        figures=lambda name, film: {"red": (name, film.rgba[3, 4, 0])},
    )
    found = rows_of(measured)
    assert list(found) == list(rows)
    for name in ("one", "two"):
        settings = mb.Settings(samples=rows[name]["samples"])
        film = mb.render(small_case().scene, width=48, height=32, settings=settings)
        assert found[name]["red"] == (name, film.rgba[3, 4, 0])
        assert found[name]["first"] > 0
    assert "samples=0" in found["wrong"]["error"]
