"""Stage "intervals": fragments of a path on a sample, paired into stretches of time."""

from __future__ import annotations

import numpy as np
import pytest
from support.kernels import one_material, options, run

from mbinterval.device import records

TILE = 8
EYE = 15

Fragments = list[tuple[int, float, float]]
"""Path, time and depth."""


def paired(
    lists: list[Fragments],
    *effects: str,
    facing: dict[int, list[float]] | None = None,
    segments: int = 1,
    flags: int = 0,
    static: dict[int, tuple[float, int]] | None = None,
    capacity: int = 4096,
) -> tuple[list[list[tuple]], bool, np.ndarray]:
    """Intervals of each sample's list of fragments, whether they fit, and the pool.

    An interval is (path, t0, t1, w0, w1, face of the first part, face of the last).
    ``facing`` gives, for some paths, 1 or -1 and the times of change; ``static`` depth and path.
    """
    nodes, heads = [], np.full(TILE * TILE, -1, np.int32)
    for sample, fragments in enumerate(lists):
        for face, (path, t, w) in enumerate(fragments):
            nodes.append((t, w, path << 4 | face, heads[sample]))
            heads[sample] = len(nodes) - 1
    paths, shapes = np.zeros(16, records.PATH), np.zeros(16, records.SHAPE)
    place = np.arange(16) % segments
    paths["open"], paths["close"] = place / segments, (place + 1) / segments
    shapes["facing_changes"] = [1.0, np.inf, np.inf, np.inf]
    for path, values in (facing or {}).items():
        shapes["facing_changes"][path, : len(values)] = values
    depth, part = np.full(TILE * TILE, np.inf), np.zeros(TILE * TILE, np.uint32)
    for sample, (w, path) in (static or {}).items():
        depth[sample], part[sample] = w, path << 4
    pool = np.zeros(max(capacity, 1) + 8, records.INTERVAL)
    pool["first"] = 999
    arrays = [
        paths, shapes, *one_material(flags), np.array(nodes or [(0, 0, 0, -1)], records.FRAGMENT),
        heads, depth, part, np.uint32(capacity), pool, np.zeros(TILE * TILE, records.RUN),
        np.zeros(TILE * TILE, np.uint32), np.zeros(2, np.uint32),
    ]  # fmt: skip
    *_, pool, runs, met, (done, _) = run(
        "intervals.cl", "intervals_tile", arrays, options(*effects, TILE=TILE)
    )
    if done:
        assert np.array_equal(met, runs["count"])
    result = []
    for start, count in runs[: len(lists)] if done else []:
        found = [
            (i["first"] >> 4, *(float(i[name]) for name in ("t0", "t1", "w0", "w1")),
             i["first"] & 15, i["last"] & 15)
            for i in pool[start : start + count]
        ]  # fmt: skip
        assert all(i["first"] >> 4 == i["last"] >> 4 for i in pool[start : start + count])
        result.append(found)
    return result, bool(done), pool


def near(found: tuple, *want: float) -> bool:
    return found[: len(want)] == pytest.approx(want, abs=1e-6)


def test_two_fragments_are_an_interval_in_order_of_time():
    ((one, two), empty), _, _ = paired(
        [[(3, 0.75, 2.0), (3, 0.25, 1.0), (5, 0.1, 4), (5, 0.9, 3)], []]
    )
    assert near(one, 5, 0.1, 0.9, 4.0, 3.0, 2, 3)  # the list's head is what came last
    assert near(two, 3, 0.25, 0.75, 1.0, 2.0, 1, 0)
    assert empty == []


def test_four_fragments_are_paired_in_order_of_time_or_as_published_of_depth():
    fragments = [(2, 0.1, 5.0), (2, 0.3, 1.0), (2, 0.6, 2.0), (2, 0.9, 4.0)]
    ((a, b),), _, _ = paired([fragments])
    assert near(a, 2, 0.1, 0.3, 5.0, 1.0)
    assert near(b, 2, 0.6, 0.9, 2.0, 4.0)
    ((a, b),), _, _ = paired([fragments], "PAIR_BY_DEPTH")
    assert near(a, 2, 0.3, 0.6, 1.0, 2.0)
    assert near(b, 2, 0.1, 0.9, 5.0, 4.0)


@pytest.mark.parametrize("order", range(6))
@pytest.mark.parametrize("by_depth", [False, True])
def test_pairing_does_not_depend_on_the_order_of_the_list(order, by_depth):
    rng = np.random.default_rng(order)
    count = 2 * rng.integers(1, 8)
    times, depths = rng.permutation(count) / count, rng.permutation(count) + 1.0
    (found,), _, _ = paired(
        [[(1, t, w) for t, w in zip(times, depths, strict=True)]],
        *["PAIR_BY_DEPTH"] * by_depth,
    )  # fmt: skip
    sequence = np.argsort(depths if by_depth else times)
    pairs = sequence.reshape(-1, 2)
    want = sorted(
        tuple((times[i], depths[i]) for i in sorted(pair, key=lambda i: times[i])) for pair in pairs
    )
    got = sorted(((i[1], i[3]), (i[2], i[4])) for i in found)
    assert np.allclose(got, want, atol=1e-6)


def test_fragments_at_one_time_make_no_interval():
    (found,), _, _ = paired([[(1, 0.5, 1.0), (1, 0.5, 2.0)]])
    assert found == []


def test_an_odd_count_is_completed_when_the_plane_passes_through_the_eye():
    (found,), _, _ = paired([[(4, 0.2, 3.0)]], facing={4: [1, 0.7]})
    assert near(found[0], 4, 0.2, 0.7, 3.0, 0.0, 0, EYE)
    (found,), _, _ = paired([[(4, 0.9, 3.0)]], facing={4: [1, 0.7]})
    assert near(found[0], 4, 0.7, 0.9, 0.0, 3.0, EYE, 0)


def test_an_odd_count_takes_the_passage_nearest_in_time_to_a_fragment():
    fragments = [(4, 0.2, 3.0), (4, 0.5, 2.0), (4, 0.8, 1.0)]
    (found,), _, _ = paired([fragments], facing={4: [1, 0.05, 0.45, 0.99]})
    assert near(found[0], 4, 0.2, 0.45, 3.0, 0.0)
    assert near(found[1], 4, 0.5, 0.8, 2.0, 1.0)


def test_an_odd_count_within_a_segment_is_completed_in_the_shutters_time():
    (found,), _, _ = paired([[(6, 0.6, 3.0)]], facing={6: [1, 0.5]}, segments=4)
    assert near(found[0], 6, 0.6, 0.5 + 0.25 * 0.5, 3.0, 0.0)


def test_an_odd_count_without_a_passage_leaves_the_nearest_fragment_out():
    (found,), _, _ = paired([[(4, 0.2, 3.0), (4, 0.5, 1.0), (4, 0.8, 2.0)]])
    assert near(found[0], 4, 0.2, 0.8, 3.0, 2.0)


SINGLE = {"flags": records.MATERIAL_SINGLE_SIDED}


@pytest.mark.parametrize(
    ("facing", "want"),
    [
        ([1.0], [(0.2, 0.8)]),
        ([-1.0], []),
        ([1.0, 0.5], [(0.2, 0.5)]),
        ([-1.0, 0.5], [(0.5, 0.8)]),
        ([1.0, 0.4, 0.6], [(0.2, 0.4), (0.6, 0.8)]),
        ([-1.0, 0.4, 0.6], [(0.4, 0.6)]),
        ([1.0, 0.3, 0.4, 0.7], [(0.2, 0.3), (0.4, 0.7)]),
        ([-1.0, 0.3, 0.4, 0.7], [(0.3, 0.4), (0.7, 0.8)]),
        ([1.0, 0.9], [(0.2, 0.8)]),
        ([1.0, 0.1], []),
    ],
)
def test_a_single_sided_path_is_seen_while_it_faces_us(facing, want):
    fragments = [(3, 0.2, 2.0), (3, 0.8, 5.0)]
    (found,), _, _ = paired([fragments], "SINGLE_SIDED", facing={3: facing}, **SINGLE)
    assert [(i[1], i[2]) for i in found] == [pytest.approx(times, abs=1e-6) for times in want]
    for i in found:
        assert i[3:5] == pytest.approx([2 + 5 * (i[1] - 0.2), 2 + 5 * (i[2] - 0.2)], abs=1e-5)
    (both,), _, _ = paired([fragments], "SINGLE_SIDED", facing={3: facing})
    assert near(both[0], 3, 0.2, 0.8)


def test_facing_is_counted_in_the_paths_own_segment():
    fragments = [(2, 0.5, 2.0), (2, 0.75, 2.0)]
    (found,), _, _ = paired(
        [fragments], "SINGLE_SIDED", facing={2: [1, 0.5]}, segments=4, **SINGLE
    )  # fmt: skip
    assert near(found[0], 2, 0.5, 0.625)


def test_the_nearest_static_surface_is_an_interval_of_the_whole_shutter():
    found, _, _ = paired(
        [[(3, 0.2, 2.0), (3, 0.8, 5.0)], [], []], "STATIC", static={0: (4.0, 1), 2: (6.0, 2)}
    )
    assert near(found[0][0], 3, 0.2, 0.8)
    assert near(found[0][1], 1, 0.0, 1.0, 4.0, 4.0)
    assert found[1] == []
    assert near(found[2][0], 2, 0.0, 1.0, 6.0, 6.0)


def test_a_full_pool_is_reported_and_nothing_is_written_beyond_it():
    lists = [[(1, 0.2, 2.0), (1, 0.8, 5.0)]] * 10
    assert paired(lists, capacity=10)[1]
    _, done, pool = paired(lists, capacity=9)
    assert not done
    assert np.all(pool["first"][9:] == 999)
    assert np.all(pool["first"][:9] != 999)
