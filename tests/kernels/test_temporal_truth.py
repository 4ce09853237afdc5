"""When a path covers a sample, against the float64 twin and exact fractions, where it is hard.

At least 100,000 paths of 13 kinds, 8 samples each (``adversarial_paths``). A stretch of time that
only the kernel or only the truth covers is an error. It may be 1e-6 of the shutter long (times
are stored as float32, and compared as such); a longer one must have the sample within 1e-9 pixels
of an edge throughout, which is far less than the 1e-5 pixels over the edge's speed that are
allowed. That holds at tangencies and for edges that rest, where no time is well defined.
``MB_TEMPORAL_PATHS=100000`` draws so many paths of each kind; the table is printed with ``-s``.
"""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import pytest
from support.adversarial_paths import KINDS, SAMPLES, draw
from support.nightly import nightly_but
from support.temporal_errors import (
    Cover,
    differences,
    ends_at,
    kernel_cover,
    rational_cover,
    triangulated_cover,
    twin_cover,
)

from mbinterval.device import records

COUNT = int(os.environ.get("MB_TEMPORAL_PATHS", "8000"))
TIME, PIXELS, NEAR = 1e-6, 1e-5, 1e-9
CHECKED = 60
"""Pairs of each kind whose truth is found in fractions: those on which twin and kernel differ."""


@dataclass(frozen=True, eq=False)
class Case:
    points: np.ndarray
    samples: np.ndarray
    truth: Cover

    def at(self, pair: np.ndarray, t: np.ndarray):
        return ends_at(self.points[pair // SAMPLES], self.samples.reshape(-1, 2)[pair], t)


@lru_cache(maxsize=2)
def case_of(kind: str, single_sided: bool = False) -> Case:
    rng = np.random.default_rng([KINDS.index(kind), 2024])
    points, samples = draw(rng, kind, COUNT)
    return Case(points, samples, twin_cover(points, samples, single_sided))


def kernel_of(case: Case, one_by_one: bool, single_sided: bool = False) -> Cover:
    flags = records.MATERIAL_SINGLE_SIDED if single_sided else 0
    return kernel_cover(case.points, case.samples, one_by_one, flags)


def with_fractions(case: Case, found: Cover, single_sided: bool = False) -> Case:
    """The truth in exact fractions for the pairs with the longest differences."""
    wrong = differences(found, case.truth)
    order = np.argsort(-wrong.length)[: 4 * CHECKED]
    pairs = np.unique(wrong.pair[order[wrong.length[order] > TIME]])[:CHECKED]
    exact = {
        int(pair): rational_cover(
            case.points[pair // SAMPLES], case.samples.reshape(-1, 2)[pair], single_sided
        )
        for pair in pairs
    }
    return replace(case, truth=case.truth.replaced(exact)) if exact else case


@dataclass(frozen=True, eq=False)
class Errors:
    """Of stretches longer than ``TIME``: their pair and length, and what the truth allows.

    ``near`` is the greatest distance, over the stretch, of the sample from the nearest edge, in
    pixels, or for paths that pass through the eye of their plane from it, relative.
    """

    pair: np.ndarray
    length: np.ndarray
    allowed: np.ndarray
    near: np.ndarray
    most: int

    def failures(self) -> np.ndarray:
        return np.flatnonzero((self.near > NEAR) | (self.length > self.allowed))


def errors_of(case: Case, found: Cover) -> Errors:
    wrong = differences(found, case.truth)
    long = np.flatnonzero(wrong.length > TIME)
    pair, t = wrong.pair[long], wrong.t[long]
    behind = (case.points[pair // SAMPLES][..., 2] <= 0).any(axis=(1, 2))
    near, slowest = np.zeros(len(pair)), np.full(len(pair), np.inf)
    for part in (1e-3, 0.25, 0.5, 0.75, 1.0 - 1e-3):
        ends = case.at(pair, t[:, 0] + part * (t[:, 1] - t[:, 0]))
        edge = ends.distance.argmin(axis=1)
        here = ends.distance.min(axis=1)
        near = np.maximum(near, np.where(behind, np.minimum(here, ends.eye), here))
        slowest = np.minimum(slowest, ends.speed[np.arange(len(pair)), edge])
    with np.errstate(divide="ignore"):
        allowed = TIME + PIXELS / slowest
    return Errors(pair, t[:, 1] - t[:, 0], allowed, near, wrong.most)


@pytest.mark.parametrize("one_by_one", [False, True], ids=["in vectors", "one by one"])
@pytest.mark.parametrize("kind", KINDS)
def test_interval_ends_are_the_true_ones(kind, one_by_one):
    case = case_of(kind)
    found = kernel_of(case, one_by_one)
    case = with_fractions(case, found)
    errors = errors_of(case, found)
    worst = errors.near.max(initial=0)
    print(f"\n{kind}: {len(case.truth.t)} intervals of {case.samples.size // 2} pairs; ", end="")
    print(f"{len(errors.pair)} stretches above 1e-6, at most {worst:.1e} px from an edge")
    assert len(case.truth.t) > 4 * COUNT
    assert errors.most <= 1  # a path never covers a sample twice at one time
    bad = errors.failures()
    assert not len(bad), (kind, errors.pair[bad][:5], errors.length[bad][:5])


@pytest.mark.parametrize("kind", KINDS)
def test_single_sided_paths_have_the_true_times_of_their_fronts(kind):
    case = case_of(kind, single_sided=True)
    found = kernel_of(case, False, single_sided=True)
    errors = errors_of(with_fractions(case, found, single_sided=True), found)
    assert len(case.truth.t) > COUNT
    assert not len(errors.failures())


@pytest.mark.parametrize(
    "kind",
    nightly_but(KINDS, "generic", "through the eye plane", "turning over", "tangent", "needles"),
)
def test_wrong_times_are_noticed(kind):
    """Controls: the shutter a hundredth late, samples off by 1e-3 px, and intervals left out."""
    case = case_of(kind)
    found = kernel_of(case, False)
    late = Cover(found.pair, found.t + 0.01 * (found.t > 0))
    moved = replace(case, samples=case.samples + np.array([1e-3, 0]))
    moved = kernel_cover(moved.points, moved.samples, False)
    some = (np.arange(len(found.t)) % 10 > 0) | (found.t[:, 1] - found.t[:, 0] < 1e-4)
    less = Cover(found.pair[some], found.t[some])
    for wrong in (late, moved, less):
        if kind == "nearly resting" and wrong is moved:
            continue  # edges at rest are no nearer to any time
        assert len(errors_of(case, wrong).failures()) > COUNT // 100, kind


def test_the_truth_itself_is_that_of_exact_fractions_on_random_pairs():
    rng = np.random.default_rng(3)
    for kind in KINDS:
        points, samples = draw(rng, kind, 3)
        twin = twin_cover(points, samples)
        exact = {
            pair: rational_cover(points[pair // SAMPLES], samples.reshape(-1, 2)[pair])
            for pair in range(3 * SAMPLES)
        }
        case = Case(points, samples, Cover(np.zeros(0, int), np.zeros((0, 2))).replaced(exact))
        assert not len(errors_of(case, twin).failures()), kind
        ours = kernel_cover(points, samples, False)
        assert not len(errors_of(case, ours).failures()), kind


@dataclass(frozen=True)
class Row:
    """Errors of covered time over all pairs that are covered at all, and lost or invented ones."""

    rms: float
    worst: float
    false: float

    def __str__(self) -> str:
        return f"{self.rms:9.1e} {self.worst:9.1e} {100 * self.false:8.3f} %"


def row_of(case: Case, found: Cover) -> Row:
    wrong = differences(found, case.truth)
    pairs = len(case.points) * SAMPLES
    error = np.bincount(wrong.pair, wrong.length, pairs)
    total = [np.bincount(c.pair, c.t[:, 1] - c.t[:, 0], pairs) for c in (case.truth, found)]
    met = (total[0] > 0) | (total[1] > 0)
    false = ((total[0] > PIXELS) != (total[1] > PIXELS)) & (np.abs(total[0] - total[1]) > PIXELS)
    # Edges that rest on a sample say nothing of a method: rounding decides about all the time.
    resting = error > 1e-6
    index = np.flatnonzero(resting)
    whole = np.full(len(index), 0.5)
    resting[index] = case.at(index, whole).distance.min(axis=1) < NEAR
    met &= ~resting
    return Row(
        float(np.sqrt(np.mean(error[met] ** 2))), float(error[met].max()), float(false[met].mean())
    )


METHODS = {
    "exact": lambda exact, split: exact,
    "exact, 128 bits": lambda exact, split: exact.masked(128),
    "exact, 64 bits": lambda exact, split: exact.masked(64),
    "exact, 32 bits": lambda exact, split: exact.masked(32),
    "Hong & Oh": lambda exact, split: split,
    "Hong & Oh, 128 bits": lambda exact, split: split.masked(128),
    "Hong & Oh, 64 bits": lambda exact, split: split.masked(64),
    "Hong & Oh, 32 bits": lambda exact, split: split.masked(32),
}


def test_table_of_temporal_errors():
    """Exact times beside masks and triangulated paths, by kind of path.

    Error: the part of the shutter that only one of method and truth covers, over pairs that are
    covered; its RMS and greatest value; and the share of pairs that are seen or missed falsely.
    Triangulated paths: split at the centre, crossings at t = 0.5, paired by time; masks: a bit
    counts when its centre is covered.
    """
    rows: dict[str, dict[str, Row]] = {}
    for kind in KINDS:
        full = case_of(kind)
        few = min(COUNT, 2000)
        keep = full.truth.pair < few * SAMPLES
        truth = Cover(full.truth.pair[keep], full.truth.t[keep])
        case = Case(full.points[:few], full.samples[:few], truth)
        exact = kernel_of(case, False)
        case = with_fractions(case, exact)
        split = triangulated_cover(case.points, case.samples)
        rows[kind] = {name: row_of(case, method(exact, split)) for name, method in METHODS.items()}
    print(f"\n{'':24}{'method':22}{'RMS':>9} {'worst':>9} {'false':>10}")
    for kind, methods in rows.items():
        for name, row in methods.items():
            print(f"{kind:24}{name:22}{row}")
    for kind, methods in rows.items():
        assert methods["exact"].rms < 1e-6, kind
        assert methods["exact"].false < 1e-4, kind
        assert methods["exact, 128 bits"].rms > 100 * methods["exact"].rms, kind
        if kind not in ("nearly resting", "translated"):
            assert methods["Hong & Oh"].rms > 1e-4, kind
