"""Stage "stack": all that is seen at once, front to back, exactly in time."""

from __future__ import annotations

import numpy as np
import pytest
from support.stage_lists import Lists, draw, moments, records_of, solved, tables, within

ALPHAS = (1.0, 1.0 - 2.0**-10, 0.75, 0.25, 0.0, -0.5)
"""Below zero: it varies, and nothing is known to be hidden."""

NEAR = 1e-8
"""Relative difference of depths whose order is left open, but for triangles that are the same."""


def layers(
    lists: Lists, sample: np.ndarray, t: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Moment and path of what is seen, front to back, and moments at which that is not sure."""
    whose, path, times = lists.everything()
    moment, item = within(sample, t, whose, times)
    path = path[item]
    there = lists.alpha[path] != 0.0
    moment, path = moment[there], path[there]
    depth = lists.depth(sample[moment], path, t[moment])
    order = np.lexsort((path, depth, moment))
    moment, path, depth = moment[order], path[order], depth[order]
    others = lists.twin[path[1:]] != lists.twin[path[:-1]]
    close = (moment[1:] == moment[:-1]) & others & (depth[1:] <= depth[:-1] * (1 + NEAR))
    seen, open_, before = np.ones(len(path), bool), True, -1
    rest = 1.0
    for k, (now, one) in enumerate(zip(moment, path, strict=True)):
        if now != before:
            rest, open_, before = 1.0, True, now
        seen[k] = open_
        rest *= 1.0 - max(lists.alpha[one], 0.0)
        open_ = rest >= 1e-6
    return moment[seen], path[seen], np.unique(moment[1:][close])


@pytest.mark.parametrize("seed", range(2))
def test_stacks_are_what_is_there_from_near_to_far_until_no_light_passes(seed):
    lists = draw(seed, ALPHAS)
    spans, runs, done = solved("stack", tables(lists), "TRANSLUCENT")
    assert done
    owner, place = records_of(runs)
    found = spans[place]
    ends = np.stack([found["t0"], found["t1"]], axis=1).astype(np.float64)
    sample, t = moments(lists, spans, runs, seed)
    ours, item = within(sample, t, owner, ends)
    truth, path, unsure = layers(lists, sample, t)
    sure, told = ~np.isin(ours, unsure), ~np.isin(truth, unsure)
    assert len(unsure) < 0.15 * len(sample)
    assert np.array_equal(ours[sure], truth[told])
    assert np.array_equal(found["source"][item][sure], path[told])
    sizes = np.bincount(truth[told])
    assert sizes.max() > 8
    assert np.count_nonzero(sizes > 1) > 1000


def test_spans_of_a_stack_have_the_same_times_and_weigh_their_length():
    lists = draw(5, ALPHAS)
    spans, runs, _ = solved("stack", tables(lists), "TRANSLUCENT")
    owner, place = records_of(runs)
    found = spans[place]
    assert np.all(found["t0"] < found["t1"])
    assert np.array_equal(found["weight"], found["t1"] - found["t0"])
    follows = owner[1:] == owner[:-1]
    same = (found["t0"][1:] == found["t0"][:-1]) & (found["t1"][1:] == found["t1"][:-1])
    assert np.all((same | (found["t1"][:-1] <= found["t0"][1:]))[follows])
    assert np.count_nonzero(same & follows) > 1000


def test_a_full_pool_is_reported_and_nothing_is_written_beyond_it():
    given = tables(draw(3, ALPHAS))
    _, runs, done = solved("stack", given, "TRANSLUCENT")
    count = int(runs["count"].sum())
    assert done
    assert solved("stack", given, "TRANSLUCENT", capacity=count)[2]
    spans, _, done = solved("stack", given, "TRANSLUCENT", capacity=count - 1)
    assert not done
    assert np.all(spans["weight"][count - 1 :] == -1.0)
