"""Stage "envelope": what is seen of exact intervals, exactly in time."""

from __future__ import annotations

import numpy as np
import pytest
from reference.bernstein import evaluate
from support.kernels import run
from support.stage_lists import MANY, SAMPLES, draw, moments, records_of, solved, tables, within

EQUAL = 1e-8
"""Relative difference of depths that rounding may turn round, far off the frame's middle."""


@pytest.mark.parametrize("seed", range(2))
def test_the_nearest_is_seen_at_any_moment_and_nothing_where_nothing_is(seed):
    lists = draw(seed)
    spans, runs, done = solved("envelope", tables(lists))
    assert done
    owner, place = records_of(runs)
    found = spans[place]
    ends = np.stack([found["t0"], found["t1"]], axis=1).astype(np.float64)
    sample, t = moments(lists, spans, runs, seed)
    count = len(sample)
    moment, own = within(sample, t, owner, ends)
    assert np.all(np.bincount(moment, minlength=count) <= 1)
    ours = np.full(count, -1)
    ours[moment] = found["source"][own]
    whose, path, times = lists.everything()
    moment, item = within(sample, t, whose, times)
    assert np.bincount(whose).max() > 0.8 * MANY
    depth = lists.depth(whose[item], path[item], t[moment])
    least = np.full(count, np.inf)
    np.minimum.at(least, moment, depth)
    assert np.array_equal(ours >= 0, np.isfinite(least))
    shown = path[item] == ours[moment]
    assert np.array_equal(np.bincount(moment[shown], minlength=count), ours >= 0)
    assert np.all(depth[shown] <= least[moment[shown]] * (1 + EQUAL))
    # Of the same triangle several times over the first is seen.
    same = lists.twin[path[item]] == lists.twin[ours[moment]]
    first = np.full(count, len(lists.points))
    np.minimum.at(first, moment[same], path[item][same])
    assert np.array_equal(first[ours >= 0], ours[ours >= 0])
    assert np.count_nonzero(same & ~shown) > 100
    assert count > 10_000


def test_spans_are_in_order_of_time_and_joined_and_weigh_their_length():
    lists = draw(5)
    spans, runs, _ = solved("envelope", tables(lists))
    owner, place = records_of(runs)
    found = spans[place]
    assert np.all(found["t0"] < found["t1"])
    assert np.array_equal(found["weight"], found["t1"] - found["t0"])
    follows = owner[1:] == owner[:-1]
    apart = found["t1"][:-1] < found["t0"][1:]
    touches = found["t1"][:-1] == found["t0"][1:]
    assert np.all((apart | touches)[follows])
    other = found["source"][1:] != found["source"][:-1]
    assert np.all(other[follows & touches])
    assert np.count_nonzero(follows & touches) > SAMPLES


def test_crossings_are_found_where_the_ends_differ_by_many_orders_of_magnitude():
    """As they do where a triangle grows from a fiftieth of a pixel to the whole frame."""
    rng = np.random.default_rng(8)
    count = 1000
    size = 10.0 ** rng.uniform(-8, 14, (count, 6))
    first = rng.integers(1, 6, (count, 1))
    c = np.where(np.arange(6) < first, -size, size) * rng.choice([-1.0, 1.0], (count, 1))
    arrays = [c, np.uint32(count), np.zeros((count, 5)), np.zeros(count, np.int32)]
    *_, roots, counts = run("quintic.cl", "quintics", arrays)
    assert np.all(counts == 1)
    before, after = (evaluate(c, roots[:, 0] + step) for step in (-2e-9, 2e-9))
    assert np.all((before * c[:, 0] > 0) | (roots[:, 0] < 2e-9))
    assert np.all((after * c[:, 5] > 0) | (roots[:, 0] > 1 - 2e-9))


def test_a_full_pool_is_reported_and_nothing_is_written_beyond_it():
    given = tables(draw(3))
    spans, runs, done = solved("envelope", given)
    count = int(runs["count"].sum())
    assert done
    assert solved("envelope", given, capacity=count)[2]
    for less in (count - 1, MANY // 4):
        spans, _, done = solved("envelope", given, capacity=less)
        assert not done
        assert np.all(spans["weight"][less:] == -1.0)
