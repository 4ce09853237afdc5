"""Studies: errors against a brute-force truth, times as measured, and what is stored of them."""

import csv
import dataclasses
import json
from functools import lru_cache

import numpy as np
import pytest
from support.nightly import nightly
from support.studies import with_rows

import mbinterval as mb
from mbinterval.bench.cases import make_case
from mbinterval.settings.rules import CULLS, PATTERNS
from mbinterval.settings.settings import Settings
from mbinterval.study import run as module
from mbinterval.study.judge import Truth, errors, exact_places, fixed_places, make_truth
from mbinterval.study.reference import Reference
from mbinterval.study.run import film_name, reference_name, study
from mbinterval.study.summary import (
    equal_errors,
    equal_times,
    pareto,
    seconds_for,
    slope,
    within,
)
from mbinterval.study.sweeps import SWEEPS, chosen

SIZE = (48, 36)
FEW = ("five-point", "limit")


@lru_cache
def case():
    return make_case("fast_cubes:60", width=SIZE[0], height=SIZE[1])


@lru_cache
def slices(samples, count):
    """Brute force: the mean of pictures at rest, at the middles of equal parts of the shutter."""
    total = np.zeros((SIZE[1], SIZE[0], 3))
    for time in (np.arange(count) + 0.5) / count:
        meshes = [
            dataclasses.replace(
                mesh, positions=(1 - time) * mesh.positions[0] + time * mesh.positions[1]
            )
            for mesh in case().scene.meshes
        ]
        still = dataclasses.replace(case().scene, meshes=meshes)
        settings = mb.Settings(samples=samples)
        total += mb.render(still, width=SIZE[0], height=SIZE[1], settings=settings).rgba[..., :3]
    return total / count


@lru_cache
def truth():
    return Truth(
        pixels=[Reference.of_image(slices(16, 32), "32 slices", "slices")],
        centres=[Reference.of_image(slices(1, 300), "300 slices", "slices")],
    )


def rms(difference):
    return float(np.sqrt(np.mean(np.square(difference, dtype=float))))


@pytest.fixture(scope="module", params=[3, nightly(2)], ids=["few rows", "more rows"])
def step(request):
    """Sweeps have one of so many of their rows."""
    return request.param


@pytest.fixture(scope="module")
def folder(step, tmp_path_factory):
    return tmp_path_factory.mktemp("study")


@pytest.fixture(scope="module")
def result(step, folder):
    told = []
    names = ("samples", "occlusion", "occlusion-published", "stochastic-fixed", "slices")
    names += FEW
    with pytest.MonkeyPatch.context() as patch:
        for name in names:  # films of 16 samples and 256 judge those of others
            patch.setitem(SWEEPS, name, with_rows(SWEEPS[name], 2 if name == "samples" else step))
        found = study(
            case(), truth(), sweeps=names, costs=False, rounds=1, folder=folder,
            progress=lambda *so_far: told.append(so_far),
        )  # fmt: skip
        total = sum(len(SWEEPS[name].rows) for name in names)
    assert [part for part, *_ in told] == [*names, ""]
    assert told[0][1:3] == (0, total)
    assert told[-1][1:] == (total, total, 0.0)
    assert told[0][3] is None
    assert all(left > 0.0 for *_, left in told[1:-1])
    return found


def rows_of(found, sweep):
    return {row["value"]: row for row in found["sweeps"][sweep]["rows"]}


def test_errors_are_those_of_the_renders(result):
    for count, row in rows_of(result, "samples").items():
        film = mb.render(
            case().scene, width=SIZE[0], height=SIZE[1], settings=mb.Settings(samples=count)
        )
        colour = film.rgba[..., :3]
        assert row["rmse"] == pytest.approx(rms(colour - slices(16, 32)), rel=1e-4)
        assert ("temporal" in row) == (count == 1)
        if count == 1:
            assert row["temporal"] == pytest.approx(rms(colour - slices(1, 300)), rel=1e-4)
        assert row["median"] > 0


def test_temporal_error_is_apart_from_the_full_pixels(result):
    """Of one exact sample time is next to nothing; of masks and triangulated paths it is more."""
    exact, published = rows_of(result, "occlusion"), rows_of(result, "occlusion-published")
    few, many = sorted(exact.keys() - {"exact"})[:2]
    assert exact["exact"]["temporal"] < 0.2 * exact["exact"]["rmse"]
    assert exact["exact"]["temporal"] < exact[many]["temporal"] < 0.6 * exact[few]["temporal"]
    assert exact["exact"]["temporal"] < 0.5 * published["exact"]["temporal"]


def test_point_samples_and_slices_are_judged_in_time_by_exact_time_at_the_same_places(result):
    for sweep in ("stochastic-fixed", "slices"):
        for row in result["sweeps"][sweep]["rows"]:
            values = SWEEPS[sweep].rows[row["name"]]
            count = values["samples"]
            if count > 256:
                assert "temporal" not in row
                continue
            options = {"width": SIZE[0], "height": SIZE[1]}
            film = mb.render(case().scene, settings=mb.Settings(**values), **options)
            exact = mb.render(case().scene, settings=mb.Settings(samples=count), **options)
            assert row["temporal"] == pytest.approx(rms(film.rgba[..., :3] - exact.rgba[..., :3]))
            assert row["temporal"] > 0.0
    errors_of = [row["temporal"] for row in result["sweeps"]["slices"]["rows"]]
    assert errors_of[-1] < 0.2 * errors_of[0]


def test_rows_say_where_they_sample():
    assert fixed_places({"method": "analytic", "samples": 7}) == 7
    assert fixed_places({"method": "stochastic", "samples": 7, "pattern": "fixed"}) == 7
    assert fixed_places({"method": "accumulation", "samples": 3}) == 3
    for values in (
        {"method": "stochastic", "samples": 7},
        {"method": "analytic", "pattern": "sobol"},
        {"method": "analytic", "samples": 1, "filter": "five_point"},
        {"method": "accumulation", "slice_times": "stochastic", "pattern": "sobol"},
        {"method": "stochastic", "pattern": "fixed", "frameless": 4},
    ):
        assert fixed_places(values) is None
    rows = {
        "exact": {"samples": 2},
        "masked": {"samples": 2, "occlusion": 64},
        "sobol": {"samples": 2, "pattern": "sobol"},
        "coarse": {"motion_error": 1.0},
    }
    assert exact_places(rows) == {"exact": 2}


def test_rows_that_would_take_too_long_are_left_out(tmp_path):
    found = study(case(), truth(), sweeps=["samples"], costs=False, rounds=2, row_seconds=1e-9)
    rows = found["sweeps"]["samples"]["rows"]
    assert len(rows[0]["seconds"]) == 2
    for row in rows[1:]:
        assert "left out: it would take about" in row["error"]


def test_default_references_are_of_another_method_than_what_they_judge(tmp_path):
    """A still scene costs them nothing, and they agree with each other."""
    small = make_case("ho17_cubes:20", width=16, height=12)
    told = []
    options = {"folder": tmp_path, "error": 3e-3}
    made = make_truth(small, **options, told=lambda what, *_: told.append(what))
    assert [of.method for of in made.pixels] == ["stochastic", "analytic"]
    assert [of.method for of in made.centres] == ["accumulation"]
    assert set(told) == {"point samples", "exact time", "slices"}
    assert rms(made.pixels[0].image - made.pixels[1].image) < 0.02
    again = make_truth(small, **options, told=lambda what, *_: told.append("again"))
    assert "again" not in told
    assert np.array_equal(again.pixels[0].halves, made.pixels[0].halves)


def test_the_slope_of_a_study_is_that_of_its_rows(result):
    points = [(n, row["rmse"]) for n, row in rows_of(result, "samples").items()]
    assert result["slopes"]["samples"] == pytest.approx(slope(points))
    assert slope([(n, 3.0 * n**-0.75) for n in (1, 2, 4, 8)]) == pytest.approx(-0.75)


def test_it_is_stored_as_json_and_csv_with_films_of_rows_that_differ_in_a_count(result, folder):
    assert json.loads((folder / "study.json").read_text()) == json.loads(json.dumps(result))
    assert result["complete"]
    with (folder / "study.csv").open(newline="") as file:
        lines = list(csv.DictReader(file))
    stored = [row for sweep in result["sweeps"].values() for row in sweep["rows"]]
    assert [line["row"] for line in lines] == [row["name"] for row in stored]
    for line, row in zip(lines, stored, strict=True):
        assert float(line["rmse"]) == row["rmse"]
        assert float(line["median"]) == row["median"]
    pictured = [row for row in stored if "film" in row]
    counted = {row["name"] for row in result["sweeps"]["samples"]["rows"]}
    assert {row["name"] for row in pictured} >= {*counted, "five-point"}
    assert not any(row["name"].startswith("exact masked") for row in pictured)
    for row in pictured:
        film = mb.Film.read(folder / row["film"])
        assert rms(film.rgba[..., :3] - slices(16, 32)) == pytest.approx(row["rmse"], rel=1e-4)
    reference = mb.Film.read(folder / reference_name("slices"))
    assert rms(reference.rgba[..., :3] - slices(16, 32)) < 1e-6


def test_a_study_that_was_stopped_goes_on(tmp_path, monkeypatch):
    made = []

    def counted(cases, rows, *others):
        made.append(list(rows))
        if len(made) == 2:
            raise KeyboardInterrupt
        return measure(cases, rows, *others)

    measure = module.measure
    monkeypatch.setattr(module, "measure", counted)
    for name in FEW:
        monkeypatch.setitem(SWEEPS, name, with_rows(SWEEPS[name], 3))
    options = {"sweeps": FEW, "costs": False, "rounds": 1, "folder": tmp_path}
    with pytest.raises(KeyboardInterrupt):
        study(case(), truth(), **options)
    stored = json.loads((tmp_path / "study.json").read_text())
    assert list(stored["sweeps"]) == [FEW[0]]
    assert not stored["complete"]
    found = study(case(), truth(), **options)
    assert found["complete"]
    assert [list(SWEEPS[name].rows) for name in (FEW[0], FEW[1], FEW[1])] == made
    assert found["sweeps"][FEW[0]] == stored["sweeps"][FEW[0]]
    other = Truth([Reference.of_image(slices(1, 300), "another", "slices")])
    anew = study(case(), other, **options | {"sweeps": FEW[:1]})
    assert anew["sweeps"][FEW[0]] != stored["sweeps"][FEW[0]]


def test_no_method_is_its_own_judge():
    film = mb.render(case().scene, width=SIZE[0], height=SIZE[1])
    own = Reference.of_image(film.rgba, "itself", "analytic")
    assert errors(film, {"method": "analytic"}, Truth([own])) == {}
    both = Truth([own, *truth().pixels])
    found = errors(film, {"method": "analytic"}, both)
    assert found["rmse"] == pytest.approx(rms(film.rgba[..., :3] - slices(16, 32)), rel=1e-4)
    points = Truth([Reference.of_image(film.rgba, "point samples", "stochastic")])
    assert errors(film, {"method": "accumulation"}, points) == {}
    assert errors(film, {"method": "analytic"}, points)["rmse"] == 0.0


def test_a_row_that_a_scene_does_not_allow_says_why(tmp_path):
    camera = mb.Camera(position=(0, 0, 9), look_at=(0, 0, 0), f_stop=2.0, focus_distance=9.0)
    lens = dataclasses.replace(case(), scene=dataclasses.replace(case().scene, camera=camera))
    found = study(lens, truth(), sweeps=["limit"], costs=False, rounds=1, folder=tmp_path)
    for row in found["sweeps"]["limit"]["rows"]:
        assert "lens" in row["error"]
    assert "lens" in (tmp_path / "study.csv").read_text()
    assert found["pareto"] == []


ROWS = [
    {"name": "slow and bad", "median": 4.0, "rmse": 0.1},
    {"name": "quick", "median": 1.0, "rmse": 0.08},
    {"name": "fine", "median": 16.0, "rmse": 0.005},
    {"name": "between", "median": 4.0, "rmse": 0.02},
    {"name": "failed", "error": "why"},
    {"name": "beyond the reference", "median": 20.0, "rmse": 1e-6, "resolved": False},
    {"name": "slower and beyond it", "median": 30.0, "rmse": 1e-9, "resolved": False},
]


def test_the_pareto_front_has_what_nothing_beats():
    assert pareto(ROWS) == ["quick", "between", "fine", "beyond the reference"]
    assert pareto(reversed(ROWS)) == pareto(ROWS)


def test_the_best_row_within_a_time_is_that_of_least_error():
    assert within(ROWS, 4.0)["name"] == "between"
    assert within(ROWS, 3.9)["name"] == "quick"
    assert within(ROWS, 0.5) is None


def test_times_and_errors_that_are_compared_are_such_as_all_series_reach():
    other = [{"name": "a", "median": 2.0, "rmse": 0.3}, {"name": "b", "median": 9.0, "rmse": 3e-3}]
    series = {"one": ROWS, "other": other, "none": [{"name": "failed", "error": "why"}]}
    times = equal_times(series)
    assert len(times) == 3
    assert times == sorted(times)
    for rows in (ROWS, other):
        assert all(within(rows, seconds) for seconds in times)
    found = equal_errors(series, 4)
    assert len(found) == 4
    assert found == sorted(found, reverse=True)
    assert all(seconds_for(ROWS, error) for error in found)
    assert equal_times({}) == equal_errors({}) == []


def test_seconds_for_an_error_lie_on_the_front():
    assert seconds_for(ROWS, 0.02) == pytest.approx(4.0)
    assert seconds_for(ROWS, 0.04) == pytest.approx(2.0)  # errors 0.08 at 1 s, 0.02 at 4 s
    assert seconds_for(ROWS, 0.5) == 1.0
    assert seconds_for(ROWS, 1e-7) is None
    assert seconds_for([], 0.1) is None


def test_every_row_of_every_sweep_is_in_order_and_has_a_name_of_its_own():
    names = [name for sweep in SWEEPS.values() for name in sweep.rows]
    assert len(set(names)) == len(names) == len(set(map(film_name, names)))
    for sweep in SWEEPS.values():
        for values in sweep.rows.values():
            assert sweep.knob in values
            Settings.from_mapping(values)


def test_every_knob_of_accuracy_is_swept_over_four_values_or_all_there_are():
    rows = [Settings.from_mapping(v) for sweep in SWEEPS.values() for v in sweep.rows.values()]

    def found(name):
        return {getattr(row, name) for row in rows}

    counted = ("samples", "occlusion", "texture_samples", "motion_segments", "motion_error")
    for name in (*counted, "max_intervals", "slices", "frameless"):
        assert len(found(name)) >= 4
    for name, choices in {
        "method": set(PATTERNS),
        "paths": {"exact", "triangulated"},
        "pairing": {"time", "depth"},
        "partial_bits": {False, True},
        "pattern": {None, *(name for names in PATTERNS.values() for name in names)},
        "cull": set(CULLS),
        "test": {"vertices", "edges"},
        "shading_rate": {"sample", "pixel"},
        "hybrid": {False, True},
        "slice_times": {"uniform", "jittered", "stochastic"},
        "slice_lens": {"point", "line"},
    }.items():
        assert found(name) == choices


@pytest.mark.parametrize(
    ("options", "what"),
    [({"sweeps": ["sample"]}, "did you mean samples"), ({"sweeps": []}, "no sweep"),
     ({"rounds": 0}, "rounds=0")],
)  # fmt: skip
def test_options_out_of_range_are_said(options, what):
    with pytest.raises(mb.UsageError, match=what):
        study(case(), truth(), **options)
    assert list(chosen(None)) == list(SWEEPS)


def test_a_reference_of_another_size_is_an_error():
    small = Truth([Reference.of_image(np.zeros((3, 4, 3)), "small")])
    with pytest.raises(mb.UsageError, match=r"4 x 3 pixels, but fast_cubes:60 is 48 x 36"):
        study(case(), small, sweeps=FEW)
