"""Stage "sort": front to back in depth and time, checked by definition."""

from __future__ import annotations

import numpy as np
import pytest
from support.kernels import options, run

from mbinterval.device import records

TILE = 8
LANES, SORT_ARRAYS = 16, 9

Segments = np.ndarray
"""``(n, 4)``: t0, t1, w0, w1 of one sample's intervals, by ascending path."""


def sort(
    samples: list[Segments], *effects: str, capacity: int = 1 << 16, most: int = 0
) -> tuple[list[np.ndarray], bool]:
    """Sorted ``Interval`` records of every sample; ``first >> 4`` is the place in its list."""
    runs = np.zeros(TILE * TILE, records.RUN)
    parts, start = [], 0
    for index, segments in enumerate(samples):
        part = np.zeros(len(segments), records.INTERVAL)
        for name, column in zip(
            ("t0", "t1", "w0", "w1"), np.reshape(segments, (-1, 4)).T, strict=True
        ):
            part[name] = column
        part["first"] = part["last"] = np.arange(len(segments)) << 4
        parts.append(part[::-1])  # paths are listed last first
        runs[index] = start, len(segments)
        start += len(segments)
    assert start <= capacity
    pool = np.zeros(capacity, records.INTERVAL)
    pool[:start] = np.concatenate(parts) if parts else pool[:0]
    arrays = [
        pool, runs, np.uint32(capacity), np.int32(most),
        np.zeros(SORT_ARRAYS * (capacity + LANES), np.float32),
        np.zeros(capacity, records.INTERVAL), np.zeros(2, np.uint32),
    ]  # fmt: skip
    _, runs, _, sorted_, (done, _) = run(
        "sort.cl", "sort_tile", arrays, options(*effects, TILE=TILE)
    )
    found = [sorted_[start : start + count] for start, count in runs[: len(samples)]]
    return found, bool(done)


def depth(pieces: np.ndarray, t: np.ndarray) -> np.ndarray:
    t0, t1, w0, w1 = (pieces[name].astype(np.float64) for name in ("t0", "t1", "w0", "w1"))
    return w0 + (w1 - w0) * (t - t0) / (t1 - t0)


def hidden_time(pieces: np.ndarray) -> float:
    """Longest time for which a piece lies behind one that comes later, by more than rounding."""
    if not len(pieces):
        return 0.0
    worst, noise = 0.0, 2e-6 * max(pieces["w0"].max(), pieces["w1"].max())
    t0, t1 = pieces["t0"].astype(np.float64), pieces["t1"].astype(np.float64)
    for i in range(len(pieces) - 1):
        low, high = np.maximum(t0[i], t0[i + 1 :]), np.minimum(t1[i], t1[i + 1 :])
        one, others = np.broadcast_to(pieces[i : i + 1], low.shape), pieces[i + 1 :]
        at_low, at_high = (depth(one, t) - depth(others, t) - noise for t in (low, high))
        rise = np.where(at_high == at_low, 1.0, at_high - at_low)
        cut = np.clip(-at_low / rise, 0, 1)  # where one falls behind the other or comes before it
        part = np.where(
            at_low > 0, np.where(at_high > 0, 1.0, cut), np.where(at_high > 0, 1 - cut, 0)
        )
        worst = max(worst, float((part * np.maximum(high - low, 0)).max()))
    return worst


def assert_same_segments(pieces: np.ndarray, segments: Segments) -> None:
    """The pieces of each segment follow on each other, from its start to its end."""
    source = pieces["first"] >> 4
    order = np.lexsort((pieces["t0"], source))
    pieces, source = pieces[order], source[order]
    segments = np.asarray(segments, np.float32)
    first = np.flatnonzero(np.diff(source.astype(np.int64), prepend=-1))
    last = np.append(first[1:], len(pieces)) - 1
    assert np.array_equal(source[first], np.arange(len(segments)))
    assert np.array_equal(pieces["t0"][first], segments[:, 0])
    assert np.array_equal(pieces["t1"][last], segments[:, 1])
    inner = np.setdiff1d(np.arange(len(pieces)), first)
    assert np.array_equal(pieces["t0"][inner], pieces["t1"][inner - 1])
    whole = np.zeros(len(pieces), records.INTERVAL)
    for name, column in zip(("t0", "t1", "w0", "w1"), segments[source].T, strict=True):
        whole[name] = column
    for t, w in (("t0", "w0"), ("t1", "w1")):
        assert np.allclose(pieces[w], depth(whole, pieces[t].astype(np.float64)), rtol=1e-5)


def random_segments(rng: np.random.Generator, count: int, slope: float = 1.0) -> Segments:
    t = np.sort(rng.uniform(0, 1, (count, 2)), axis=1)
    t[rng.random(count) < 0.3, 0] = 0.0
    t[rng.random(count) < 0.3, 1] = 1.0
    t = t[t[:, 1] - t[:, 0] > 1e-3]
    w = rng.uniform(1, 5, (len(t), 1)) * np.exp(slope * rng.uniform(-0.5, 0.5, (len(t), 2)))
    return np.concatenate([t, w], axis=1).astype(np.float32)


def test_segments_that_do_not_cross_come_out_whole_in_an_order_that_hides_nothing():
    """Levels tilted alike never cross; least depth alone puts many in the wrong order."""
    rng = np.random.default_rng(0)
    samples, wrong = [], 0
    for _ in range(40):
        segments = random_segments(rng, 30, slope=0.0)
        tilt = rng.uniform(-3, 3)
        segments[:, 2] += 5 + tilt * segments[:, 0]
        segments[:, 3] += 5 + tilt * segments[:, 1]
        samples.append(segments)
    found, done = sort(samples)
    assert done
    for pieces, segments in zip(found, samples, strict=True):
        assert len(pieces) == len(segments)
        assert_same_segments(pieces, segments)
        assert hidden_time(pieces) < 5e-7
        by_depth = pieces[np.argsort(np.minimum(pieces["w0"], pieces["w1"]))]
        wrong += hidden_time(by_depth) > 1e-3
    assert wrong > 30


@pytest.mark.parametrize("slope", [0.2, 2.0])
def test_segments_that_cross_are_cut_where_they_do_and_nothing_hidden_comes_first(slope):
    rng = np.random.default_rng(1)
    samples = [random_segments(rng, rng.integers(2, 40), slope) for _ in range(60)]
    found, done = sort(samples)
    assert done
    cut = 0
    for pieces, segments in zip(found, samples, strict=True):
        cut += len(pieces) - len(segments)
        assert_same_segments(pieces, segments)
        assert hidden_time(pieces) < 5e-7
        assert hidden_time(pieces[::-1]) > 1e-3 or len(segments) < 6
    assert cut > 200


def test_two_that_cross_swap_their_order_at_the_crossing():
    (pieces,), _ = sort([np.array([[0.0, 1, 1, 3], [0.2, 0.8, 2.5, 1.5]])])
    # Depths 1 + 2 t and 2.5 - (t - 0.2) / 0.6 meet at t = 0.5, w = 2.
    assert len(pieces) == 4
    assert pieces["t1"][(pieces["t0"] < 0.5) & (pieces["first"] == 0)] == pytest.approx(0.5)
    assert hidden_time(pieces) < 2e-7
    assert sorted(pieces["first"] >> 4) == [0, 0, 1, 1]


def test_equal_depths_go_to_the_path_that_comes_first():
    rng = np.random.default_rng(2)
    samples = []
    for _ in range(30):
        one = random_segments(rng, 8, slope=0.0)
        samples.append(one[rng.integers(0, len(one), 20)])
    found, _ = sort(samples)
    ties = 0
    for pieces, segments in zip(found, samples, strict=True):
        source = (pieces["first"] >> 4).astype(int)
        assert len(pieces) == len(segments)
        for i in range(len(source)):
            for k in range(i + 1, len(source)):
                if np.array_equal(segments[source[i]], segments[source[k]]):
                    ties += 1
                    assert source[i] < source[k]
    assert ties > 200


def test_segments_that_meet_end_to_end_are_not_cut():
    """A fan: all ends at one point in time and depth, as on the edges of a closed mesh."""
    segments = np.array([[0.0, 0.5, w, 2.0] for w in (1.0, 1.5, 2.5, 3.0)])
    segments = np.concatenate([segments, segments[:, [1, 1, 3, 2]] + [0, 0.5, 0, 0]])
    (pieces,), _ = sort([segments])
    assert len(pieces) == len(segments)
    assert hidden_time(pieces) < 5e-7


def test_a_cycle_in_depth_order_is_broken_by_cuts():
    """Each of three is in front of the next in their common time; where they overlap they cross."""
    segments = np.array([[0.0, 0.66, 2.0, 1.0], [0.34, 1.0, 2.0, 1.0], [0.0, 1.0, 1.2, 1.8]])
    (pieces,), _ = sort([segments])
    assert_same_segments(pieces, segments)
    assert hidden_time(pieces) < 5e-7


@pytest.mark.parametrize("count", [0, 1, 2, 15, 16, 17, 33])
def test_any_number_of_segments_is_sorted(count):
    rng = np.random.default_rng(count)
    t = np.tile([0.0, 1.0], (count, 1))
    w = rng.permutation(count)[:, None] + np.array([1.0, 1.0])
    (pieces,), done = sort([np.concatenate([t, w], axis=1)])
    assert done
    assert pieces["w0"].tolist() == sorted(w[:, 0])


def test_thousands_of_segments_on_one_sample_keep_their_order():
    rng = np.random.default_rng(4)
    t = np.sort(rng.uniform(0, 1, (3000, 2)), axis=1) + [0, 1e-3]
    w = np.repeat(rng.permutation(3000)[:, None] + 100.0, 2, axis=1) + rng.uniform(
        -0.3, 0.3, (3000, 2)
    )
    segments = np.concatenate([np.minimum(t, 1.001), w], axis=1).astype(np.float32)
    (pieces,), done = sort([segments])
    assert done
    assert len(pieces) == 3000
    assert hidden_time(pieces) < 5e-7
    assert_same_segments(pieces, segments)


def test_hundreds_that_cross_each_other_are_sorted():
    segments = random_segments(np.random.default_rng(5), 150, slope=4.0)
    (pieces,), done = sort([segments])
    assert done
    assert len(pieces) > 10 * len(segments)
    assert_same_segments(pieces, segments)
    assert hidden_time(pieces) < 5e-7


def test_a_limit_keeps_those_of_least_minimum_depth():
    rng = np.random.default_rng(6)
    samples = [random_segments(rng, count, slope=0.0) for count in (5, 50, 12)]
    found, _ = sort(samples, "MAX_INTERVALS", most=10)
    for pieces, segments in zip(found, samples, strict=True):
        least = np.sort(segments[:, 2:].min(axis=1))[:10]
        assert np.sort(pieces["w0"]) == pytest.approx(least)


def test_a_full_pool_is_reported():
    segments = random_segments(np.random.default_rng(7), 60, slope=4.0)
    assert sort([segments], capacity=1 << 12)[1]
    assert not sort([segments], capacity=len(segments) + 10)[1]
