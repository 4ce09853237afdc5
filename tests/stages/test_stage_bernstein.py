"""Roots of polynomials in Bernstein form (cl/shared/bernstein.h)."""

from __future__ import annotations

from fractions import Fraction
from itertools import pairwise
from math import comb

import numpy as np
import pytest
from reference.bernstein import evaluate, product
from reference.bernstein import roots as twin_roots
from support.kernels import run


def solve(b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Roots ``(M, n)``, NaN where none, and how many, of ``(M, n + 1)`` coefficients."""
    b = np.ascontiguousarray(b, dtype=np.float64)
    count, degree = len(b), b.shape[1] - 1
    integers = [np.zeros(count, np.int32), np.zeros(count, np.int32)]
    arrays = [b, np.uint32(count), np.full((count, degree), np.nan), *integers]
    _, found, counts, signs = run("bernstein.cl", {2: "quadratics", 3: "cubics"}[degree], arrays)
    first = b[np.arange(count), np.argmax(b != 0, axis=1)]
    assert np.array_equal(signs, np.where(first < 0, -1, 1))  # just after 0
    return found, counts


def with_roots(roots: np.ndarray) -> np.ndarray:
    """Bernstein coefficients of the product of (t - r) over the last axis."""
    result = np.ones((len(roots), 1))
    for r in roots.T:
        result = product(result, np.stack([-r, 1.0 - r], axis=1))
    return result


def exact_value(b: np.ndarray, t: float) -> Fraction:
    """Value of one polynomial at ``t``, without rounding."""
    n, s = len(b) - 1, Fraction(t)
    return sum(Fraction(float(c)) * comb(n, i) * s**i * (1 - s) ** (n - i) for i, c in enumerate(b))


@pytest.mark.parametrize("degree", [2, 3])
def test_polynomials_made_from_roots_give_them_back(degree):
    rng = np.random.default_rng(degree)
    roots = np.sort(rng.uniform(0.001, 0.999, (4000, degree)), axis=1)
    apart = np.diff(roots, axis=1).min(axis=1) > 1e-2
    roots = roots[apart]
    found, counts = solve(with_roots(roots) * rng.choice([-1, 1], (len(roots), 1)))
    assert len(roots) > 2000
    assert np.all(counts == degree)
    assert np.abs(found - roots).max() < 1e-11
    assert np.abs(solve(with_roots(0.99 * roots))[0] - roots).max() > 1e-3


@pytest.mark.parametrize("degree", [2, 3])
def test_roots_outside_the_segment_are_left_out(degree):
    rng = np.random.default_rng(10 + degree)
    roots = np.sort(rng.uniform(-1.0, 2.0, (4000, degree)), axis=1)
    inside = (roots > 0) & (roots < 1)
    apart = np.diff(roots, axis=1).min(axis=1) > 1e-2
    found, counts = solve(with_roots(roots))
    assert np.array_equal(counts[apart], inside[apart].sum(axis=1))
    known = np.isfinite(found[apart])
    assert np.abs(np.sort(found[apart][known]) - np.sort(roots[apart][inside[apart]])).max() < 1e-10


@pytest.mark.parametrize("degree", [2, 3])
@pytest.mark.parametrize("scale", [1.0, 1e-150, 1e150])
def test_roots_part_the_segment_into_pieces_of_alternating_sign(degree, scale):
    """The definition, on random coefficients, two thirds of them from a few adversarial values."""
    if degree == 2 and scale != 1.0:
        scale **= 0.5  # the discriminant is a product of two coefficients
    rng = np.random.default_rng(20 + degree)
    b = rng.normal(size=(6000, degree + 1))
    special = rng.choice([0.0, 1.0, -1.0, 1e-9, -1e-9, 1e-300, 0.5], b.shape)
    b = np.where(rng.random(b.shape) < 0.6, special, b)
    if scale != 1.0:
        b = np.where(np.abs(b) < 1e-200, 0.0, b)
    found, counts = solve(b * scale)
    ends = np.sort(np.concatenate([np.zeros((len(b), 1)), found, np.ones((len(b), 1))], 1), axis=1)
    for row in range(0, len(b), 3):
        cuts = ends[row, : counts[row] + 2]
        assert np.all(np.diff(cuts) >= 0)
        assert np.all((cuts >= 0) & (cuts <= 1))
        value = [exact_value(b[row], 0.5 * (low + high)) for low, high in pairwise(cuts)]
        size = float(np.abs(b[row]).max())
        signs = [np.sign(float(v)) if abs(v) > 1e-14 * size else 0 for v in value]
        known = [(i, s) for i, s in enumerate(signs) if s]
        for (i, s), (j, r) in pairwise(known):
            assert s * r == (-1) ** (j - i), (b[row], cuts, signs)


@pytest.mark.parametrize("degree", [2, 3])
def test_roots_are_those_of_the_twin(degree):
    b = np.random.default_rng(30 + degree).normal(size=(20000, degree + 1))
    found, counts = solve(b)
    truth = twin_roots(b)
    assert np.array_equal(counts, np.isfinite(truth).sum(axis=1))
    gap = np.nan_to_num(np.diff(truth, axis=1), nan=1.0).min(axis=1)
    error = np.nan_to_num(np.abs(found - truth)).max(axis=1)
    assert error[gap > 1e-3].max() < 1e-10
    residual = np.abs(evaluate(b[:, None], np.nan_to_num(found)))[np.isfinite(found)]
    assert residual.max() < 1e-13


def test_a_root_where_the_sign_does_not_change_is_none():
    assert solve(np.array([[1.0, -1.0, 1.0], [-4.0, 2.0, -1.0]]))[1].tolist() == [0, 0]
    touching = np.array([[-2.25, 1.0, 0.25, -1.5]])  # 3 (t - 1/2)^2 (t - 3)
    assert touching == pytest.approx(3.0 * with_roots(np.array([[0.5, 0.5, 3.0]])))
    assert solve(touching)[1].tolist() == [0]
    apart = solve(touching + [[0.0, 0.0, 1e-12, 0.0]])[0]
    assert apart[0] == pytest.approx([0.5, 0.5, np.nan], abs=1e-5, nan_ok=True)
    crossing = with_roots(np.array([[0.5, 0.5, 0.875]]))
    found, counts = solve(crossing)
    assert counts.tolist() == [1]
    assert found[0, 0] == pytest.approx(0.875)


def test_a_triple_root_is_one():
    found, counts = solve(with_roots(np.array([[0.5, 0.5, 0.5]])))
    assert counts.tolist() == [1]
    assert found[0, 0] == pytest.approx(0.5, abs=1e-5)


@pytest.mark.parametrize(
    ("b", "want"),
    [
        ((0.0, -1.0, 1.0), [2 / 3]),  # the root at 0 must not hide the second one
        ((0.0, 1.0, 1.0), []),
        ((1.0, -1.0, 0.0), [1 / 3]),
        ((0.0, 1.0, 0.0), []),
        ((0.0, 0.0, 0.0), []),
        ((0.0, 0.0, 1.0), []),
        ((1.0, 0.5, 0.0), []),
        ((1.0, 0.0, -1.0), [0.5]),  # linear
        ((0.0, -1.0, 1.0, 1.0), [(9 - 21**0.5) / 10]),  # t (-5 t^2 + 9 t - 3)
        ((0.0, 0.0, -1.0, 1.0), [0.75]),
        ((1.0, -1.0, 0.0, 0.0), [0.25]),
        ((0.0, 1.0, 1.0, 0.0), []),
        ((0.0, 0.0, 0.0, 0.0), []),
        ((0.0, -2.0, 3.0, 0.0), [0.4]),
    ],
)
def test_roots_at_the_ends_are_left_out_and_hide_no_other(b, want):
    found, counts = solve(np.array([b]))
    assert counts[0] == len(want)
    assert found[0, : len(want)] == pytest.approx(want)
