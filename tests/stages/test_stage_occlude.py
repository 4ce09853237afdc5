"""Stage "occlude": visible spans by bit masks over the shutter."""

from __future__ import annotations

import numpy as np
import pytest
from support.kernels import options, run
from support.stretches import light_of_bits

from mbinterval.device import records

TILE = 8
ALL_BITS = [32, 64, 128, 256]


def occlude(
    samples: list[np.ndarray],
    bits: int | None,
    *effects: str,
    capacity: int = 1 << 14,
    clock: list[float] | None = None,
) -> tuple[list[np.ndarray], bool, np.ndarray]:
    """Spans of every sample whose times ``(n, 2)`` are given front to back; whether all fit.

    The spans' last field says which interval of the sample they belong to.
    """
    runs = np.zeros(TILE * TILE, records.RUN)
    pool = np.zeros(max(sum(map(len, samples)), 1), records.INTERVAL)
    start = 0
    for index, times in enumerate(samples):
        runs[index] = start, len(times)
        pool["t0"][start : start + len(times)], pool["t1"][start : start + len(times)] = times.T
        start += len(times)
    spans = np.zeros(capacity + 8, records.SPAN)
    spans["weight"] = -1.0
    scratch = np.zeros(2 * (capacity + 16), np.float32)
    tail = [spans, np.zeros_like(runs), np.zeros(2, np.uint32)]
    arrays = [pool, runs, np.uint32(capacity), scratch, *tail]
    defines = options(*effects, TILE=TILE, MASK_BITS=bits)
    _, _, _, spans, span_runs, (done, _) = run(
        "occlude.cl", "occlude_tile", arrays, defines, clock=clock
    )
    found = []
    owner = records.SPAN.names[-1]
    for first, (begin, count) in zip(runs["start"], span_runs[: len(samples)], strict=False):
        part = spans[begin : begin + count].copy()
        part[owner] -= first
        found.append(part)
    return found, bool(done), spans


def seen_bits(times: np.ndarray, bits: int) -> np.ndarray:
    """Which interval is seen at each bit's centre: the first that holds it, or -1."""
    centre = (np.arange(bits) + 0.5) / bits
    seen = np.full(bits, -1)
    for index in reversed(range(len(times))):
        t0, t1 = times[index]
        seen[(t0 <= centre) & (centre < t1)] = index
    return seen


def random_times(rng: np.random.Generator, count: int, length: float) -> np.ndarray:
    """Float32 times, a third of their ends on the edges and centres of bits, 0 and 1."""
    t0 = rng.uniform(-0.1, 1, count)
    times = np.clip(np.stack([t0, t0 + rng.exponential(length, count)], axis=1), 0, 1)
    special = rng.integers(0, 513, times.shape) / 512
    times = np.where(rng.random(times.shape) < 0.3, special, times).astype(np.float32)
    return times[times[:, 0] < times[:, 1]].astype(np.float64)


@pytest.mark.parametrize("bits", ALL_BITS)
def test_each_bit_shows_the_first_interval_that_holds_its_centre(bits):
    rng = np.random.default_rng(bits)
    samples = [
        random_times(rng, rng.integers(0, 40), rng.choice([0.02, 0.2, 1])) for _ in range(60)
    ]
    found, done, _ = occlude(samples, bits)
    assert done
    owner = records.SPAN.names[-1]
    counted = 0
    for spans, times in zip(found, samples, strict=True):
        seen, ours = seen_bits(times, bits), np.full(bits, -1)
        order = np.argsort(spans["t0"])
        for span in spans[order]:
            index = span[owner]
            # The bits of a span are those whose centres it holds, up to its clipped ends.
            first = round(float(span["t0"]) * bits) if span["t0"] > times[index][0] else None
            run_of = np.flatnonzero(seen == index)
            runs = np.split(run_of, np.flatnonzero(np.diff(run_of) > 1) + 1)
            matching = [
                r for r in runs
                if max(times[index][0], r[0] / bits) == span["t0"]
                and min(times[index][1], (r[-1] + 1) / bits) == span["t1"]
            ]  # fmt: skip
            assert len(matching) == 1
            assert first is None or first == matching[0][0]
            assert np.all(ours[matching[0]] == -1)
            ours[matching[0]] = index
            assert span["weight"] == len(matching[0]) / bits
            counted += 1
        assert np.array_equal(ours, seen)
        assert np.all(np.diff(spans[owner].astype(int)) >= 0)  # front to back
    assert counted > 200


@pytest.mark.parametrize("bits", ALL_BITS)
def test_an_interval_that_holds_no_bit_centre_is_not_seen(bits):
    centre = 5.5 / bits
    eps = 1e-4 / bits
    below, above = [centre - 0.9 / bits, centre - eps], [centre + eps, centre + 0.9 / bits]
    none, just, after = (np.array([ends]) for ends in (below, [centre, centre + eps], above))
    found, _, _ = occlude([none, just, after, np.array([[0.0, 1.0]])], bits)
    assert [len(spans) for spans in found] == [0, 1, 0, 1]
    assert found[1]["weight"][0] == 1 / bits
    assert found[3]["weight"][0] == 1.0


def test_weights_sum_to_the_covered_part_and_never_beyond_one():
    rng = np.random.default_rng(9)
    samples = [random_times(rng, 30, 0.2) for _ in range(60)]
    found, _, _ = occlude(samples, 128)
    for spans, times in zip(found, samples, strict=True):
        assert spans["weight"].sum() == np.mean(seen_bits(times, 128) >= 0)


WAYS = {"128 bits": (128,), "partial bits": (128, "PARTIAL_BITS"), "exact": (None,)}


@pytest.mark.parametrize("way", WAYS)
def test_the_walk_along_a_sample_ends_when_all_of_it_is_covered(way):
    """A million intervals behind one that covers all cost nothing; not so behind a gap."""
    times = np.tile([0.0, 0.9], (1_000_000, 1))
    closed, gaping = [], []
    for first, clock in ((1.0, closed), (0.9, gaping)):
        times[0] = 0.0, first
        for _ in range(5):  # the least is what nothing else on the machine disturbed
            (spans,), _, _ = occlude([times], *WAYS[way], clock=clock)
            assert spans["weight"].tolist() == [pytest.approx(first, abs=0.01)]
    assert min(gaping) > 20 * min(closed)


def test_without_a_mask_spans_are_what_no_interval_before_has_covered():
    rng = np.random.default_rng(11)
    samples = [random_times(rng, rng.integers(0, 40), rng.choice([0.02, 0.2])) for _ in range(60)]
    found, done, _ = occlude(samples, None)
    assert done
    fine = 512 * 27  # cells whose centres lie on no end of an interval
    owner, compared = records.SPAN.names[-1], 0
    for spans, times in zip(found, samples, strict=True):
        centre = (np.arange(fine) + 0.5) / fine
        ours = np.full(fine, -1)
        for span in spans:
            inside = (span["t0"] <= centre) & (centre < span["t1"])
            assert np.all(ours[inside] == -1)
            ours[inside] = span[owner]
            assert span["weight"] == pytest.approx(span["t1"] - span["t0"], abs=1e-7)
            assert times[span[owner], 0] <= span["t0"] < span["t1"] <= times[span[owner], 1]
        assert np.array_equal(ours, seen_bits(times, fine))
        compared += len(spans)
    assert compared > 300


def test_partial_bits_give_an_interval_its_own_length_and_neighbours_a_common_border():
    rng = np.random.default_rng(12)
    alone = rng.uniform(0, 0.7, (60, 1)) + [0.0, 0.05] + rng.uniform(0, 0.2, (60, 1)) * [0, 1]
    found, _, _ = occlude([times[None] for times in alone], 32, "PARTIAL_BITS")
    for spans, (t0, t1) in zip(found, alone, strict=True):
        assert len(spans) == 1
        assert spans["weight"][0] == pytest.approx(t1 - t0, abs=1e-6)
        whole = np.mean(seen_bits(np.array([[t0, t1]]), 32) >= 0)
        assert abs(whole - (t1 - t0)) < 1 / 32
    samples = [random_times(rng, 30, 0.2) for _ in range(60)]
    found, _, _ = occlude(samples, 64, "PARTIAL_BITS")
    for spans, times in zip(found, samples, strict=True):
        order = spans[np.argsort(spans["t0"])]
        assert np.all(order["t1"][:-1] <= order["t0"][1:])
        assert np.all(order["t0"] < order["t1"])
        own = times[order[records.SPAN.names[-1]]]
        assert np.all((own[:, 0] <= order["t0"]) & (order["t1"] <= own[:, 1]))


def test_partial_bits_see_all_of_a_stretch_however_it_is_cut():
    rng = np.random.default_rng(13)
    samples = [random_times(rng, 30, rng.choice([0.002, 0.01, 0.05, 0.2])) for _ in range(40)]
    for _ in range(20):  # an object whose motion has many segments, before a gap
        cuts = np.sort(rng.uniform(0.0, rng.uniform(0.1, 1.0), 200)).astype(np.float32)
        samples.append(rng.permuted(np.stack([cuts[:-1], cuts[1:]], axis=1), axis=0))
    for bits in (32, 128):
        found, _, _ = occlude(samples, bits, "PARTIAL_BITS")
        for spans, times in zip(found, samples, strict=True):
            light = spans["weight"].astype(np.float64).sum()
            assert light == pytest.approx(light_of_bits(times, bits), abs=1e-6)


def test_a_full_pool_is_reported_and_nothing_is_written_beyond_it():
    samples = [np.array([[0.0, 0.5], [0.5, 1.0]])] * 5
    assert occlude(samples, 32, capacity=10)[1]
    _, done, spans = occlude(samples, 32, capacity=9)
    assert not done
    assert np.all(spans["weight"][9:] == -1.0)
