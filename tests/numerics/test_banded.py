"""The factors of banded matrices, and the solutions by them, against rational arithmetic."""

from fractions import Fraction

import numpy as np
import pytest
from scipy import linalg

from lcpimpact.numerics.banded import factor, solve_banded, solve_finely


def matrix_of(rng, n, w):
    """Return a positive definite matrix of half bandwidth w, with entries of few digits."""
    A = np.diag(4.0 * w + 1.0 + rng.integers(1, 9, n))
    for k in range(1, w + 1):
        A += np.diag(rng.integers(-8, 9, n - k) / 4.0, k)
    return np.triu(A) + np.triu(A, 1).T


def exact_solution(A, b):
    """Return A⁻¹ b by elimination of fractions."""
    rows = [[*map(Fraction, row), Fraction(right)] for row, right in zip(A.tolist(), b.tolist(), strict=True)]
    for k, pivot in enumerate(rows):
        for i, row in enumerate(rows):
            if i != k:
                part = row[k] / pivot[k]
                rows[i] = [a - part * p for a, p in zip(row, pivot, strict=True)]
    return [row[-1] / row[k] for k, row in enumerate(rows)]


@pytest.mark.parametrize(("n", "w"), [(1, 0), (5, 1), (9, 2), (7, 4)])
def test_factors_give_the_solution(n, w):
    rng = np.random.default_rng(n)
    A, b = matrix_of(rng, n, w), rng.integers(-9, 10, n).astype(float)
    bands = np.array([np.append(np.diag(A, -k), np.zeros(k)) for k in range(w + 1)])
    x = exact_solution(A, b)
    factors = bands.copy()
    assert factor(factors, factors[:0], 1e-12)
    np.testing.assert_allclose(factors[0], linalg.cholesky_banded(bands, lower=True)[0] ** -2, rtol=1e-13)
    found = b.copy()
    solve_banded(factors, found)
    np.testing.assert_allclose(found, np.array(x, dtype=float), rtol=1e-13, atol=1e-14)
    fine, right = np.array([bands, np.zeros_like(bands)]), np.zeros((2, n + 3))
    assert factor(fine[0], fine[1], 1e-12)
    right[0, 2 : 2 + n] = b
    solve_finely(fine, 2, right)
    assert (right[:, [0, 1, n + 2]] == 0.0).all(), "only the columns of the block change"
    for j in range(n):
        assert abs(Fraction(right[0, 2 + j]) + Fraction(right[1, 2 + j]) - x[j]) < Fraction(1, 10**29)


def test_an_indefinite_matrix_has_no_factors():
    A = np.array([[1.0, 1.0], [2.0, 0.0]])
    for low in (A[:0], np.zeros_like(A)):
        assert not factor(A.copy(), low, 1e-12)
