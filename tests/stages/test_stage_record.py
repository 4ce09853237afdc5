"""Stage "record": visible spans with their times and what they add to their pixels."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from support.kernels import numbers, options, run
from support.stage_lists import LAYERS, SAMPLES, TILE
from support.stage_spans import EFFECTS, PIXELS, SIZES, Spans, draw, rests, tables

from mbinterval.device import records

PLACES, WIDTH = 2, 40
ROOM = 1 << 15


def recorded(of: Spans, steps: int, capacity: int = ROOM) -> tuple[np.ndarray, bool, int]:
    """Events of the pool, whether some found no room, and how many of the first did."""
    events = np.zeros(capacity + 8, records.EVENT)
    events["weight"] = -1.0
    frame = records.pack("Frame", x=33, y=16, width=WIDTH, height=99, background=(0, 0, 0))
    told = numbers(samples=LAYERS, layers=LAYERS, shading_times=PLACES, event_steps=steps)
    arrays = [told, frame, *tables(of).values(), np.zeros((16, 4), np.float32), np.uint32(capacity),
              events, np.zeros(1, np.uint32), np.array([records.NONE], np.uint32),
              np.zeros(1, np.uint32)]  # fmt: skip
    effects = ("TRANSLUCENT", "RECORDED", "RECORDED_COLOR", "EVENT_STEPS")
    defines = options(*EFFECTS, *effects, **SIZES)
    *_, events, (count,), (end,), (full,) = run("record.cl", "record_tile", arrays, defines)
    assert np.all(events["weight"][capacity:] == -1.0)
    return events[: min(count, end)], bool(full), int(min(count, end))


def told(of: Spans, steps: int) -> dict[str, np.ndarray]:
    """The same events, stack by stack: the whole, then its parts if there are several."""
    sample, stack, path = of.layers()
    rest = rests(of)
    rows = []
    for k in np.unique(stack):
        own = np.flatnonzero(stack == k)
        index = sample[own[0]]
        row, column = index % PIXELS // TILE, index % TILE
        if column == 0 or row >= TILE - 2:
            continue
        t0, t1 = of.t.reshape(-1, 2)[k]
        cuts = [c for c in np.float32(1 / steps) * np.arange(1, steps) if t0 < c < t1]
        if np.all(of.flat[path[own]]):
            cuts = []
        ends = [t0, *cuts, t1]
        pieces = [(t0, t1, records.EVENT_WHOLE if cuts else 0)]
        if cuts:
            pieces += [(a, b, records.EVENT_PART) for a, b in pairwise(ends)]
        pixel = row * WIDTH + column - 1
        for a, b, flag in pieces:
            light = of.weight.ravel()[k] if flag != records.EVENT_PART else b - a
            rows += [(index, pixel, index // PIXELS | flag, path[i], a, b, light, rest[i])
                     for i in own]  # fmt: skip
    order = sorted(range(len(rows)), key=lambda k: rows[k][0])
    columns = zip(*(rows[k] for k in order), strict=True)
    names = ("index", "pixel", "sample", "path", "t0", "t1", "light", "rest")
    return {name: np.array(c) for name, c in zip(names, columns, strict=True)}


@pytest.mark.parametrize("steps", [1, 4, 7])
def test_events_are_the_spans_and_their_parts_with_what_they_add(steps):
    of = draw(steps, deep=True)
    events, full, _ = recorded(of, steps)
    want = told(of, steps)
    assert not full
    assert len(events) == len(want["pixel"])
    for name in ("pixel", "sample", "path"):
        assert np.array_equal(events[name], want[name])
    for name in ("t0", "t1"):
        assert events[name] == pytest.approx(want[name], abs=1e-7)
    share = of.share[want["index"]] / LAYERS
    assert events["share"] == pytest.approx(share)
    assert events["weight"] == pytest.approx(want["light"] * share, abs=1e-6)
    path = want["path"]
    part = want["rest"] * of.alpha[path]
    color = of.mean_color(path, want["t0"], want["t1"], PLACES)
    size = part * of.base[path].max(axis=1) + 1e-3
    assert np.all(np.abs(events["color"][:, :3] - part[:, None] * color).max(1) <= 3e-5 * size)
    assert events["color"][:, 3] == pytest.approx(part, abs=1e-6)
    for name, time in (("z0", "t0"), ("z1", "t1")):
        assert events[name] == pytest.approx(of.depth(path, want[time]), rel=1e-5)
    assert np.count_nonzero(want["sample"] >= records.EVENT_PART) >= 1000 * (steps > 1)
    assert len(events) > SAMPLES


def test_a_full_pool_is_reported_and_nothing_is_written_beyond_it():
    of = draw(4, deep=True)
    whole, full, count = recorded(of, 4)
    assert not full
    assert not recorded(of, 4, count)[1]
    less, full, kept = recorded(of, 4, count - 1)
    assert full
    assert kept < count
    assert np.array_equal(less, whole[:kept])
