"""Stage "mask": what of exact intervals is seen at the centres of a mask's bits."""

from __future__ import annotations

import numpy as np
import pytest
from reference.samples import expand
from support.stage_lists import SAMPLES, Lists, draw, records_of, solved, tables
from support.stretches import light_of_bits

BITS = 64
EQUAL = 1e-9
"""Relative difference of depths that rounding may turn round, far off the frame's middle."""


def owners(lists: Lists, spans: np.ndarray, runs: np.ndarray) -> np.ndarray:
    """Path that owns each bit ``(S, BITS)``, -1 for none; each bit belongs to one span at most."""
    found = np.full((SAMPLES, BITS), -1)
    sample, place = records_of(runs)
    for index, span in zip(sample, spans[place], strict=True):
        count = round(float(span["weight"]) * BITS)
        first = int(np.ceil(float(span["t0"]) * BITS - 0.5))  # the first centre within
        assert span["weight"] == count / BITS
        assert np.all(found[index, first : first + count] == -1)
        found[index, first : first + count] = span["source"]
    return found


def seen(lists: Lists) -> tuple[np.ndarray, np.ndarray]:
    """Depths of what is there at every bit, as flat arrays with the bit's cell and the path."""
    sample, path, t = lists.everything()
    first, last = (np.ceil(end * BITS - 0.5).astype(int) for end in t.T)
    index, bit = expand(first, last)
    depth = lists.depth(sample[index], path[index], (bit + 0.5) / BITS)
    return np.stack([sample[index] * BITS + bit, path[index]]), depth


@pytest.mark.parametrize("seed", range(2))
def test_each_bit_belongs_to_what_is_nearest_at_its_centre(seed):
    lists = draw(seed)
    spans, runs, done = solved("mask", tables(lists), MASK_BITS=BITS)
    assert done
    ours = owners(lists, spans, runs).ravel()
    (cell, path), depth = seen(lists)
    least = np.full(ours.shape, np.inf)
    np.minimum.at(least, cell, depth)
    assert np.array_equal(ours >= 0, np.isfinite(least))
    own = ours[cell] == path
    assert np.array_equal(np.bincount(cell[own], minlength=ours.size), ours >= 0)
    assert np.all(depth[own] <= least[cell[own]] * (1 + EQUAL))
    # Of the same triangle several times over the first is seen.
    first = np.full(ours.size, len(lists.points))
    same = own | (lists.twin[path] == lists.twin[ours[cell]])
    np.minimum.at(first, cell[same], path[same])
    assert np.array_equal(first[ours >= 0], ours[ours >= 0])
    assert np.count_nonzero(same & ~own) > 100
    assert np.count_nonzero(ours >= 0) > 10_000


def test_spans_lie_within_their_interval_and_within_their_bits():
    lists = draw(7)
    spans, runs, _ = solved("mask", tables(lists), MASK_BITS=BITS)
    sample, place = records_of(runs)
    found = spans[place]
    whole = {(s, p): t for s, p, t in zip(*lists.everything(), strict=True)}
    ends = np.array([whole[key] for key in zip(sample, found["source"], strict=True)])
    assert np.all((ends[:, 0] <= found["t0"]) & (found["t0"] <= found["t1"]))
    assert np.all(found["t1"] <= ends[:, 1])
    first = np.ceil(found["t0"] * BITS - 0.5)
    assert np.all(found["t0"] == np.maximum(first / BITS, ends[:, 0].astype(np.float32)))
    last = first / BITS + found["weight"]
    assert np.all(found["t1"] == np.minimum(last, ends[:, 1].astype(np.float32)))


@pytest.mark.parametrize("seed", range(2))
def test_partial_bits_see_all_of_every_stretch_that_holds_a_centre(seed):
    lists = draw(seed)
    spans, runs, done = solved("mask", tables(lists), "PARTIAL_BITS", MASK_BITS=BITS)
    assert done
    owner, place = records_of(runs)
    light = np.bincount(owner, spans["weight"][place].astype(np.float64), SAMPLES)
    sample, _, t = lists.everything()
    want = [light_of_bits(t[sample == index], BITS) for index in range(SAMPLES)]
    assert light == pytest.approx(want, abs=1e-6)
    assert np.count_nonzero((light > 0) & (light < 1)) > 100


def test_a_full_pool_is_reported_and_nothing_is_written_beyond_it():
    given = tables(draw(3))
    spans, runs, done = solved("mask", given, MASK_BITS=BITS)
    count = int(runs["count"].sum())
    assert done
    assert solved("mask", given, MASK_BITS=BITS, capacity=count)[2]
    spans, _, done = solved("mask", given, MASK_BITS=BITS, capacity=count - 1)
    assert not done
    assert np.all(spans["weight"][count - 1 :] == -1.0)
