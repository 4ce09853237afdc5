"""Stage "occlude": visible spans by bit masks over the shutter."""

from __future__ import annotations

import numpy as np
import pytest
from kernels import options, run

from mbinterval.device import records

TILE = 8
ALL_BITS = [32, 64, 128, 256]


def occlude(
    samples: list[np.ndarray], bits: int, capacity: int = 1 << 14, clock: list[float] | None = None
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
    arrays = [pool, runs, np.uint32(capacity), spans, np.zeros_like(runs), np.zeros(2, np.uint32)]
    defines = options(TILE=TILE, MASK_BITS=bits)
    _, _, spans, span_runs, (done, _) = run(
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


def test_the_walk_along_a_sample_ends_when_its_mask_is_full():
    """A million intervals behind one that covers all cost nothing; not so behind a gap."""
    times = np.tile([0.0, 0.9], (1_000_000, 1))
    closed, open_ = [], []
    for first, clock in ((1.0, closed), (0.9, open_)):
        times[0] = 0.0, first
        (spans,), _, _ = occlude([times], 128, clock=clock)
        assert spans["weight"].tolist() == [pytest.approx(first, abs=0.01)]
    assert open_[0] > 20 * closed[0]


def test_a_full_pool_is_reported_and_nothing_is_written_beyond_it():
    samples = [np.array([[0.0, 0.5], [0.5, 1.0]])] * 5
    assert occlude(samples, 32, capacity=10)[1]
    _, done, spans = occlude(samples, 32, capacity=9)
    assert not done
    assert np.all(spans["weight"][9:] == -1.0)
