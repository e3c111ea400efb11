"""Elimination on floats and double-doubles against rational arithmetic."""

from fractions import Fraction

import numpy as np
import pytest

from lcpimpact.numerics.double_double import DoubleDouble
from lcpimpact.numerics.elimination import quotient, solve, solve_finely


def residual(A, x, b):
    """Return the largest |b - A x| of exact arithmetic, each row relative to its terms; x are lists of parts."""
    worst = Fraction(0)
    for row, right in zip(A.tolist(), b.tolist(), strict=True):
        terms = [Fraction(a) * sum(map(Fraction, parts)) for a, parts in zip(row, x, strict=True)]
        worst = max(worst, abs(Fraction(right) - sum(terms)) / (abs(Fraction(right)) + sum(map(abs, terms))))
    return worst


@pytest.mark.parametrize("n", [1, 2, 5, 12])
def test_solutions_have_the_digits_of_their_numbers(n):
    rng = np.random.default_rng(n)
    A = rng.normal(size=(n, n)) * 10.0 ** rng.integers(-12, 13, (n, 1))
    b = A @ rng.normal(size=n)
    assert residual(A, solve(A, b)[:, None].tolist(), b) < 1e-13
    assert residual(A, solve_finely(A, b).parts.T.tolist(), b) < 1e-28


def test_pivots_are_chosen_among_rows_of_one_size():
    A = np.array([[1e8, 1e30], [1.0, 1.0]])  # 1e8 is no pivot: it is small in its row
    x = solve_finely(A, np.array([1e30, 2.0])).parts.T.tolist()
    assert residual(A, x, np.array([1e30, 2.0])) < 1e-30
    assert abs(sum(map(Fraction, x[0])) + sum(map(Fraction, x[1])) - 2) < Fraction(1, 10**29)


def test_low_parts_count_and_change_places_with_their_rows():
    A = np.array([[[0.0, 3.0], [1.0, 0.0]], [[2.0**-60, 0.0], [0.0, 0.0]]])
    x = quotient(A, np.array([[[3.0], [1.0]], [[0.0], [2.0**-70]]]))
    small, third = Fraction(2) ** -70, Fraction(2) ** -60 / 3
    exact = 1 + small, 1 - third * (1 + small)
    for found, each in zip(x[:, :, 0].T.tolist(), exact, strict=True):
        assert abs(sum(map(Fraction, found)) - each) < Fraction(1, 10**30)


def test_a_singular_matrix_is_refused():
    A = np.array([[1.0, 2.0], [2.0, 4.0]])
    assert np.isnan(quotient(np.array([A, 0.0 * A]), np.ones((2, 2, 1)))).all()
    for solver in (solve, solve_finely):
        with pytest.raises(np.linalg.LinAlgError):
            solver(A, np.ones(2))


def test_solve_finely_takes_several_right_sides():
    X = solve_finely(DoubleDouble.of([[2.0, 0.0], [0.0, 4.0]]), np.array([[1.0, 2.0], [3.0, 5.0]]))
    np.testing.assert_array_equal(X.hi, [[0.5, 1.0], [0.75, 1.25]])
    assert solve_finely(np.zeros((0, 0)), np.zeros((0, 3))).shape == (0, 3)
