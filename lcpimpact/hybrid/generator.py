"""The generator A of a flow, and the Taylor series of exp(A δ) X over a window of length δ, in double-doubles.

Floats do not preserve rigid motions: rounding ε in exp(A δ) is a small force, by which a body that flies for a time T is
off by about ‖A‖ T³ ε. So states are double-doubles (see `lcpimpact.numerics.double_double`).

The generator of a bar with a consistent mass matrix is dense, but A = P⁻¹ Q with a banded P, the mass matrix, and a sparse
Q. So the powers of A δ cost O(N) each (see `Generator`), and a large system has no dense exp(A δ) unless it must.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lcpimpact.arrays import Indices, Matrix, Stack, Vector
from lcpimpact.compiled import FEW_ROWS, compiled
from lcpimpact.numerics.banded import solve_banded, solve_finely
from lcpimpact.numerics.double_double import DoubleDouble, add, multiply, two_product

DEGREE = 30
"""Degree of the Taylor polynomial of a window: e/31! = 3e-34 is below the rounding of double-doubles."""

FINE_TERMS = 20
"""Number of its terms that are double-doubles; the rounding of later ones in floats is 1e-16/21! of the first."""


class SparseRows(NamedTuple):
    """A sparse matrix of double-doubles, row by row.

    Attributes
    ----------
    entries : (2, nnz) array        its entries
    starts : (n + 1,) array         where each row begins, and the end
    columns : (nnz,) array          the column of each entry
    """

    entries: Matrix
    starts: Indices
    columns: Indices


def sparse(A: DoubleDouble) -> SparseRows:
    """Return the nonzero entries of a matrix."""
    kept = A.hi != 0.0
    starts = np.concatenate([[0], np.cumsum(kept.sum(axis=1))])
    return SparseRows(np.ascontiguousarray(A.parts[:, kept]), starts, np.ascontiguousarray(np.nonzero(kept)[1]))


def unit_rows(n: int) -> SparseRows:
    """Return the entries of the unit matrix of n rows."""
    return SparseRows(np.array([np.ones(n), np.zeros(n)]), np.arange(n + 1), np.arange(n))


class Generator(NamedTuple):
    """A = P⁻¹ Q, where Q is sparse and P the unit matrix but for a banded block L D Lᵀ.

    Attributes
    ----------
    Q : SparseRows
    first : int                     first row and column of the block
    band : (2, w + 1, nb) array     the factors of the block, as of `factor`; nb = 0 without a block
    """

    Q: SparseRows
    first: int
    band: Stack


NO_BAND = np.zeros((2, 1, 0))


def products(A: Generator) -> int:
    """Return the number of products in A X."""
    return int(A.Q.entries.shape[1] + 2 * A.band[0].size)


@compiled()
def on_row(A: SparseRows, m: int, X: Matrix) -> tuple[float, float]:
    """Return row m of A X, a double-double."""
    x, x_lo = 0.0, 0.0
    for at in range(A.starts[m], A.starts[m + 1]):
        c = float(A.entries[0, at])
        c_lo = float(A.entries[1, at])
        j = A.columns[at]
        y, y_lo = float(X[0, j]), float(X[1, j])
        if c != 1.0 or c_lo != 0.0:
            y, y_lo = multiply(c, c_lo, y, y_lo)
        x, x_lo = add(x, x_lo, y, y_lo)
    return x, x_lo


@compiled()
def on_rows(R: SparseRows, X: Matrix) -> Vector:
    """Return R X in floats, of a double-double X (2, N)."""
    found = np.empty(len(R.starts) - 1)
    for m in range(len(found)):
        found[m], _ = on_row(R, m, X)
    return found


@compiled()
def next_term(A: Generator, δ: float, Y: Matrix, i: int) -> bool:
    """Write A δ Y_{i-1}/i into Y_i (p + 1, N), in floats, and return whether it is not zero."""
    Q = A.Q
    scale = δ / i
    moves = False
    for m in range(Y.shape[1]):
        x = 0.0
        for at in range(Q.starts[m], Q.starts[m + 1]):
            x += float(Q.entries[0, at]) * float(Y[i - 1, Q.columns[at]])
        Y[i, m] = x * scale
        moves |= x != 0.0
    nb = A.band.shape[2]
    if nb:
        solve_banded(A.band[0], Y[i, A.first : A.first + nb])
    return moves


@compiled()
def write_terms(A: Generator, δ: float, Y: Matrix) -> int:
    """Write (A δ)^i Y_0/i! into Y_i (p + 1, N), in floats, up to the last nonzero one, and return how many there are."""
    for i in range(1, len(Y)):
        if not next_term(A, δ, Y, i):
            return i
    return len(Y)


@compiled()
def write_fine_terms(A: Generator, δ: float, Z: Stack, Y: Matrix) -> int:
    """Write (A δ)^i Z_0/i! into Z_i (p + 1, 2, N), up to the last nonzero one, and return how many there are.

    The first `FINE_TERMS` are double-doubles; Y (p - `FINE_TERMS` + 1, N) takes the later ones. δ is a power of two.
    """
    fine, n = min(len(Z) - 1, FINE_TERMS), Z.shape[2]
    for i in range(1, fine + 1):
        inverse, moves = 1.0 / i, False
        p, p_lo = two_product(inverse, float(i))
        rest = ((1.0 - p) - p_lo) / i
        for m in range(n):
            x, x_lo = on_row(A.Q, m, Z[i - 1])
            Z[i, 0, m], Z[i, 1, m] = multiply(δ * x, δ * x_lo, inverse, rest)
            moves |= x != 0.0
        if not moves:
            return i
        if A.band.shape[2]:
            solve_finely(A.band, A.first, Z[i])
    for m in range(n):
        Y[0, m] = Z[fine, 0, m]
    for i in range(fine + 1, len(Z)):
        if not next_term(A, δ * (i - fine) / i, Y, i - fine):
            return i
        for m in range(n):
            Z[i, 0, m], Z[i, 1, m] = Y[i - fine, m], 0.0
    return len(Z)


@compiled()
def expand_finely(A: Generator, δ: float, X: Matrix, degree: int) -> Stack:
    """Return (A δ)^i X/i!, up to the last nonzero one, double-doubles (at most degree + 1, 2, N); δ is a power of two."""
    Z = np.empty((degree + 1, 2, X.shape[1]))
    Z[0] = X
    return Z[: write_fine_terms(A, δ, Z, np.empty((degree + 1, X.shape[1])))]


@compiled()
def horner(Z: Stack, s: float, s_lo: float) -> Matrix:
    """Return Σ Z_i s^i (2, N) for a double-double s."""
    X = Z[-1].copy()
    for i in range(len(Z) - 2, -1, -1):
        for m in range(X.shape[1]):
            x, x_lo = multiply(float(X[0, m]), float(X[1, m]), s, s_lo)
            X[0, m], X[1, m] = add(x, x_lo, float(Z[i, 0, m]), float(Z[i, 1, m]))
    return np.asarray(X)


@compiled()
def summed(Z: Stack) -> Matrix:
    """Return Σ Z_i (2, N), the state at the end of a window."""
    X = Z[-1].copy()
    for i in range(len(Z) - 2, -1, -1):
        for m in range(X.shape[1]):
            X[0, m], X[1, m] = add(float(X[0, m]), float(X[1, m]), float(Z[i, 0, m]), float(Z[i, 1, m]))
    return np.asarray(X)


@compiled()
def move_by(step: Stack, X: Matrix, Y: Matrix) -> None:
    """Replace a state X (2, N) by its product with a matrix (2, N, N); Y (2, N) is scratch."""
    for i in range(X.shape[1]):
        y, y_lo = 0.0, 0.0
        for k in range(X.shape[1]):
            a = float(step[0, i, k])
            if a != 0.0:
                x, x_lo = multiply(a, float(step[1, i, k]), float(X[0, k]), float(X[1, k]))
                y, y_lo = add(y, y_lo, x, x_lo)
        Y[0, i], Y[1, i] = y, y_lo
    for i in range(X.shape[1]):
        X[0, i], X[1, i] = Y[0, i], Y[1, i]


@compiled(most=FEW_ROWS, vectors=True)
def exponential(A: Generator, δ: float, n: int, degree: int) -> Stack:
    """Return exp(A δ) (2, n, n)."""
    found, unit = np.empty((2, n, n)), np.zeros((2, n))
    for j in range(n):
        unit[0, j] = 1.0
        found[:, :, j] = summed(expand_finely(A, δ, unit, degree))
        unit[0, j] = 0.0
    return found


@compiled(most=FEW_ROWS)
def walk(A: Generator, δ: float, X: Matrix, windows: int, degree: int) -> Matrix:
    """Return the state (2, N) after a number of windows, one after the other."""
    for _ in range(windows):
        X = summed(expand_finely(A, δ, X, degree))
    return X.copy()
