"""Knots: as few as keep the chords within a limit, against closed forms of arcs and parabolas."""

from __future__ import annotations

import numpy as np
import pytest

from mbinterval.exposure.knots import Followed, choose_knots
from mbinterval.exposure.looks import finer


def followed(times, places, corners=()):
    """Points ``(S, n, 3)`` in pixels."""
    places = np.asarray(places, float)

    def measure(which, errors):
        return np.linalg.norm(errors, axis=2).max(axis=1)

    return Followed(times, places, np.isin(times, corners), measure)


def arc(times, degrees, radius=100.0):
    angle = np.radians(degrees) * times
    return radius * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)[:, None]


def chosen(motion, limit, most=128, fixed=(), wanted=()):
    ends = (0, *fixed, len(motion.times) - 1)
    return choose_knots(motion, ends, wanted, limit, most)


@pytest.mark.parametrize("degrees", [10.0, 90.0, 700.0])
@pytest.mark.parametrize("limit", [0.03, 1.0])
def test_an_arc_has_as_many_as_its_sagitta_asks_for(degrees, limit):
    times = np.linspace(0, 1, 4097)
    motion = followed(times, arc(times, degrees))
    found = chosen(motion, limit, most=1000)
    most = 2 * np.arccos(1 - limit / 100.0)
    fewest = int(np.ceil(np.radians(degrees) / most))
    assert fewest <= len(found.knots) - 1 <= 1.05 * fewest + 1
    assert 0.5 * limit < found.deviation <= limit or len(found.knots) == 2
    longest = np.diff(times[found.knots]).max() * np.radians(degrees)
    assert 100.0 * (1 - np.cos(longest / 2)) <= limit


def test_between_coarse_samples_the_second_derivative_counts():
    """Of a parabola the chord between two samples is off by an eighth of the second difference."""
    times = np.linspace(0, 1, 5)
    places = np.stack([times, 8.0 * times**2, 0 * times], axis=1)[:, None]
    np.testing.assert_allclose(followed(times, places).between(), 8.0 * 2 / 16 / 8)
    found = choose_knots(followed(times, places), (0, 4), (), 0.65, 128)
    assert found.knots.tolist() == [0, 2, 4]  # an eighth of 4 is .5, and .125 may hide between
    fine = finer(times, followed(times, places).between(), 0.1)
    between = followed(fine, np.stack([fine, 8.0 * fine**2, 0 * fine], axis=1)[:, None]).between()
    assert between.max() <= 0.1 / 64 * 1.01


def test_corners_are_knots_where_the_limit_asks_for_them_and_else_not():
    times = np.linspace(0, 1, 101)
    bent = np.where(times < 0.37, times * 50, 18.5 - 30 * (times - 0.37))
    straight = 50 * times
    for line, knots in ((bent, [0, 37, 100]), (straight, [0, 100])):
        places = np.stack([line, 0 * times, 0 * times], axis=1)[:, None]
        found = chosen(followed(times, places, corners=times[10::9]), 0.1)
        assert len(found.knots) == len(knots)
        np.testing.assert_allclose(found.knots, knots, atol=1)


def test_knots_are_uneven_where_motion_is():
    times = np.linspace(0, 1, 1025)
    angle = np.where(times < 0.75, 0.0, (times - 0.75) * 8 * np.pi)
    places = 50 * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)[:, None]
    found = chosen(followed(times, places, corners=[0.75]), 0.5)
    knots = times[found.knots]
    assert knots[1] == pytest.approx(0.75, abs=0.04)
    even = chosen(followed(times, arc(times, 4 * 360.0, 50.0)), 0.5)
    assert len(found.knots) < 0.35 * len(even.knots)


def test_fixed_samples_are_knots_and_wanted_ones_where_motion_leaves_the_chord():
    times = np.linspace(0, 1, 65)
    turning = followed(times, arc(times, 20.0))
    found = chosen(turning, 0.2, fixed=(17,), wanted=(40,))
    assert {17, 40} <= set(found.knots.tolist())
    straight = followed(times, np.stack([times, times, times], axis=1)[:, None])
    assert chosen(straight, 0.2, wanted=(40,)).knots.tolist() == [0, 64]


def test_what_is_left_is_told_where_there_may_be_no_more():
    times = np.linspace(0, 1, 4097)
    motion = followed(times, arc(times, 3600.0))
    found = chosen(motion, 0.1, most=20)
    assert len(found.knots) == 21
    assert found.deviation == pytest.approx(100.0 * (1 - np.cos(np.pi / 2)), rel=0.05)
