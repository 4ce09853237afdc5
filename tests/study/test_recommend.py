"""Recommendations: predictions hold where laws hold, and what is said was measured."""

import dataclasses
import re
import time
from pathlib import Path

import pytest
from support.nightly import nightly

import mbinterval as mb
from mbinterval import cli
from mbinterval.bench.cases import make_case
from mbinterval.study import recommend as module
from mbinterval.study.recommend import CANDIDATES, Candidate, Model, options, recommend

SIZE = ("--width", "64", "--height", "48")
CUBES = Path(__file__).parents[2] / "scenes" / "ho17_cubes.toml"
COUNTED = Candidate("counted", {"method": "stochastic"}, "samples", (4, 16, 64), 4096)


def model(points, candidate=COUNTED):
    return Model(candidate, tuple(points))


def lawful(count):
    """An error that falls with the 0.75th power, and seconds on a line."""
    return count, 0.1 + 0.01 * count, 0.2 * count**-0.75


def test_laws_are_continued():
    found = model(map(lawful, (4, 16, 64)))
    for count in (1, 10, 100, 1000):
        assert found.seconds(count) == pytest.approx(lawful(count)[1])
        assert found.error(count) == pytest.approx(lawful(count)[2])
    assert found.exponent == pytest.approx(-0.75)


def test_the_least_count_for_an_error_and_the_largest_for_a_time():
    found = model(map(lawful, (4, 16, 64)))
    least = (0.2 / 0.003) ** (1 / 0.75)
    count = found.count_for(0.003, None)
    assert least <= count <= 1.08 * least
    count = found.count_for(None, 5.1)
    assert 0.93 * 500 <= count <= 500
    assert found.count_for(1e-9, None) is None
    assert found.count_for(None, 0.01) is None


def test_probes_that_others_disturbed_promise_no_time_below_zero():
    found = model([(4, 1.0, 0.1), (16, 20.0, 0.05)])
    assert found.seconds(1) == pytest.approx(0.25)
    assert found.seconds(8) > 1.0


def test_an_error_that_does_not_fall_is_not_continued():
    found = model([(1, 1.0, 0.0041), (2, 2.0, 0.0040), (4, 4.0, 0.0040)])
    assert found.exponent == 0.0
    assert found.count_for(0.003, None) is None
    assert found.count_for(0.0041, None) == 1


def test_a_measurement_scales_the_laws():
    found = model(map(lawful, (4, 16, 64))).mended(1000, 20.0, 0.01)
    assert found.seconds(1000) == pytest.approx(20.0)
    assert found.error(1000) == pytest.approx(0.01)
    assert found.error(500) == pytest.approx(0.01 * 2**0.75)
    again = found.mended(500, 30.0, 0.05)
    assert (again.seconds(500), again.error(500)) == pytest.approx((30.0, 0.05))
    assert again.exponent == -1.5  # 0.05 at 500 and 0.01 at 1000 are steeper than is believed
    assert found.mended(2000, 40.0, 0.01).exponent == 0.0


def test_candidates_are_settings_at_all_their_counts():
    for candidate in CANDIDATES:
        for count in (*candidate.probes, candidate.most):
            mb.Settings.from_mapping(candidate.settings(count))
    text = options({"method": "stochastic", "samples": 4, "slice_times": "jittered"})
    assert text == "--method stochastic --samples 4 --slice-times jittered"


def choose_from(monkeypatch, *names):
    """Fewer methods to choose from, of fewer probes: each count of each is a kernel to build."""
    chosen = [one for one in CANDIDATES if one.name in names]
    fewer = tuple(dataclasses.replace(one, probes=one.probes[:2]) for one in chosen)
    monkeypatch.setattr(module, "CANDIDATES", fewer)


@pytest.fixture
def few(monkeypatch):
    choose_from(monkeypatch, "exact", "stochastic sobol")


@pytest.mark.parametrize("fewer", [True, nightly(False)], ids=["few methods", "all methods"])
def test_an_error_that_is_asked_for_is_reached_and_measured(fewer, monkeypatch):
    if fewer:
        choose_from(monkeypatch, "exact", "published", "stochastic sobol")
    case = make_case("fast_cubes:60", width=64, height=48)
    best, *others = recommend(case, error=0.02)
    assert best.reached
    assert best.error <= 0.02
    assert all(other.seconds is None for other in others)
    predicted = [other.predicted_seconds for other in others]
    assert predicted == sorted(predicted)
    film = mb.render(
        case.scene, width=64, height=48, settings=mb.Settings.from_mapping(best.settings)
    )
    finest = mb.Settings(samples=256, pattern="sobol")
    truth = mb.render(case.scene, width=64, height=48, settings=finest)
    assert mb.compare(film, truth, which=["rmse"]).metrics["rmse"] == pytest.approx(
        best.error, rel=0.1
    )


def seconds_of_a_render(case):
    started = time.perf_counter()
    mb.render(case.scene, width=64, height=48, settings=mb.Settings(samples=4))
    return time.perf_counter() - started


def test_a_time_that_is_asked_for_is_used(few):
    case = make_case("fast_cubes:60", width=64, height=48)
    seconds = 100 * min(seconds_of_a_render(case) for _ in range(3))
    best = recommend(case, seconds=seconds)[0]
    assert best.reached == (best.seconds <= seconds)
    assert best.error < 0.01


class Told(module._Probing):
    """Measures nothing: seconds and errors of each candidate follow a law that it is told."""

    def __init__(self, **laws):
        self.told, self.laws, self.asked = (lambda _text: None), laws, []

    def measured(self, candidate, count):
        self.asked.append((candidate.name, count))
        return count, *self.laws[candidate.name](count)


def named(name, points):
    return model(points, dataclasses.replace(COUNTED, name=name))


def test_a_prediction_that_fails_is_mended_by_what_was_measured():
    """The method is worse than its probes: the count that they told is too small."""
    run = Told(one=lambda count: (0.001 * count, 0.4 * count**-0.5))
    optimist = named("one", [(4, 0.004, 0.2), (16, 0.016, 0.05), (64, 0.064, 0.0125)])
    (found,) = run.search({"one": optimist}, module._Goal(0.02, of_time=False))
    assert len(run.asked) > 1
    assert found.reached
    assert found.error <= 0.02
    assert 400 <= found.settings["samples"] <= 500


def test_another_method_is_taken_where_one_does_not_keep_what_it_promised():
    """One is biased: it never gets below an error that its probes do not show."""
    biased = named("biased", [(1, 0.001, 0.2), (2, 0.002, 0.1), (4, 0.004, 0.05)])
    slow = named("slow", [(1, 0.1, 0.2), (2, 0.2, 0.1), (4, 0.4, 0.05)])
    run = Told(
        biased=lambda count: (0.001 * count, max(0.2 / count, 0.03)),
        slow=lambda count: (0.1 * count, 0.2 / count),
    )
    best, *_ = run.search({"biased": biased, "slow": slow}, module._Goal(0.02, of_time=False))
    assert best.name == "slow"
    assert best.reached
    run.asked.clear()
    best, *_ = run.search({"biased": biased, "slow": slow}, module._Goal(3.0, of_time=True))
    assert best.name == "slow"
    assert best.error == pytest.approx(0.2 / best.settings["samples"])
    assert best.seconds <= 3.0


def test_the_command_prints_what_can_be_run(few, capsys):
    code = cli.main(["recommend", str(CUBES), "--frame", "3", *SIZE, "--error", "0.05"])
    out = capsys.readouterr().out
    assert code == 0
    assert re.search(
        r"mbinterval render \S+ho17_cubes.toml --frames 3 --width 64 --height 48 --", out
    )
    assert "measured RMSE" in out


def test_what_is_out_of_reach_is_said(few, capsys):
    code = cli.main(["recommend", str(CUBES), *SIZE, "--time", "1e-6"])
    assert code == 1
    assert "no method is predicted to reach 1e-06 s" in capsys.readouterr().err


@pytest.mark.parametrize("given", [{}, {"error": 1.0, "seconds": 1.0}, {"error": 0.0}])
def test_one_wish_at_a_time(given):
    with pytest.raises(mb.UsageError):
        recommend(make_case("fast_cubes:5", width=16, height=12), **given)


def test_methods_that_a_scene_does_not_allow_are_left_out(monkeypatch):
    choose_from(monkeypatch, "exact", "published")
    case = make_case("fast_cubes:20", width=32, height=24)
    camera = mb.Camera(position=(0, 0, 16), fov=40.0, f_stop=2.0, focus_distance=16.0)
    lens = dataclasses.replace(case, scene=dataclasses.replace(case.scene, camera=camera))
    names = {choice.name for choice in recommend(lens, error=0.05)}
    assert "published" not in names
    assert names
