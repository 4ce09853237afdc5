"""Studies: errors against a brute-force truth, times as measured, and what is stored of them."""

import csv
import dataclasses
import json
from functools import lru_cache

import numpy as np
import pytest

import mbinterval as mb
from mbinterval import study as module
from mbinterval.bench_cases import make_case
from mbinterval.reference import Reference
from mbinterval.settings import Settings
from mbinterval.study import Truth, pareto, seconds_for, slope, study
from mbinterval.sweeps import SWEEPS, chosen

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


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("study")


@pytest.fixture(scope="module")
def result(folder):
    told = []
    names = ("samples", "occlusion", "occlusion-published", *FEW)
    found = study(
        case(), truth(), sweeps=names, rounds=1, folder=folder,
        progress=lambda *so_far: told.append(so_far),
    )  # fmt: skip
    total = sum(len(SWEEPS[name].rows) for name in names)
    assert [done for done, _total, _left in told][-1] == total
    assert told[-1][2] == 0.0
    assert told[0][2] > 0.0
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
    assert exact["exact"]["temporal"] < 0.2 * exact["exact"]["rmse"]
    assert exact["exact"]["temporal"] < exact[128]["temporal"] < 0.6 * exact[32]["temporal"]
    assert exact["exact"]["temporal"] < 0.5 * published["exact"]["temporal"]


def test_the_slope_of_a_study_is_that_of_its_rows(result):
    points = [(n, row["rmse"]) for n, row in rows_of(result, "samples").items()]
    assert result["slopes"]["samples"] == pytest.approx(slope(points))
    assert slope([(n, 3.0 * n**-0.75) for n in (1, 2, 4, 8)]) == pytest.approx(-0.75)


def test_it_is_stored_as_json_and_csv_with_a_film_of_each_row(result, folder):
    assert json.loads((folder / "study.json").read_text()) == json.loads(json.dumps(result))
    assert result["complete"]
    with (folder / "study.csv").open(newline="") as file:
        lines = list(csv.DictReader(file))
    stored = [row for sweep in result["sweeps"].values() for row in sweep["rows"]]
    assert [line["row"] for line in lines] == [row["name"] for row in stored]
    for line, row in zip(lines, stored, strict=True):
        assert float(line["rmse"]) == row["rmse"]
        assert float(line["median"]) == row["median"]
        film = mb.Film.read(folder / module.film_name(row["name"]))
        assert rms(film.rgba[..., :3] - slices(16, 32)) == pytest.approx(row["rmse"], rel=1e-4)


def test_a_study_that_was_stopped_goes_on(tmp_path, monkeypatch):
    made = []

    def counted(cases, rows, *others):
        made.append(list(rows))
        if len(made) == 2:
            raise KeyboardInterrupt
        return measure(cases, rows, *others)

    measure = module.measure
    monkeypatch.setattr(module, "measure", counted)
    options = {"sweeps": FEW, "rounds": 1, "folder": tmp_path}
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
    assert module.errors(film, {"method": "analytic"}, Truth([own])) == {}
    both = Truth([own, *truth().pixels])
    found = module.errors(film, {"method": "analytic"}, both)
    assert found["rmse"] == pytest.approx(rms(film.rgba[..., :3] - slices(16, 32)), rel=1e-4)


def test_a_row_that_a_scene_does_not_allow_says_why(tmp_path):
    camera = mb.Camera(position=(0, 0, 9), look_at=(0, 0, 0), f_stop=2.0, focus_distance=9.0)
    lens = dataclasses.replace(case(), scene=dataclasses.replace(case().scene, camera=camera))
    found = study(lens, truth(), sweeps=["limit"], rounds=1, folder=tmp_path)
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


def test_seconds_for_an_error_lie_on_the_front():
    assert seconds_for(ROWS, 0.02) == pytest.approx(4.0)
    assert seconds_for(ROWS, 0.04) == pytest.approx(2.0)  # errors 0.08 at 1 s, 0.02 at 4 s
    assert seconds_for(ROWS, 0.5) == 1.0
    assert seconds_for(ROWS, 1e-7) is None
    assert seconds_for([], 0.1) is None


def test_every_row_of_every_sweep_is_in_order_and_has_a_name_of_its_own():
    names = [name for sweep in SWEEPS.values() for name in sweep.rows]
    assert len(set(names)) == len(names) == len(set(map(module.film_name, names)))
    for sweep in SWEEPS.values():
        for values in sweep.rows.values():
            assert sweep.knob in values
            Settings.from_mapping(values)


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
