r"""Proofs that rows c·X stay positive over windows of a flow, and the first window in which one falls.

On a window of length δ, a row is the polynomial

.. math:: c \cdot X(t_j + s δ) = \sum_{i=0}^{p} \frac{c (A δ)^i X(t_j)}{i!} s^i + ε, \qquad
          |ε| \le \frac{e}{(p+1)!} \, ‖c D‖ ‖D^{-1} X(t_j)‖ ,

with p so large that the remainder is below rounding. In the Bernstein basis, a polynomial lies in the convex hull of
its coefficients: a window is free of events only if all of them are positive, which proves that there is no root in it;
otherwise it is halved (de Casteljau) until the first sign change is located to rounding. So no event is missed, however
short the excursion. Floats decide which windows are free of events.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from lcpimpact.arrays import Array, Indices, Matrix, Stack, Vector
from lcpimpact.compiled import compiled
from lcpimpact.hybrid.generator import (
    DEGREE,
    Generator,
    SparseRows,
    expand_finely,
    horner,
    move_by,
    on_row,
    summed,
    write_terms,
)
from lcpimpact.numerics.double_double import FINE_EPS, add, divide, multiply
from lcpimpact.numerics.polynomials import bernstein, first_fall, polish
from lcpimpact.numerics.rounding import EPS

WINDOW_ROUNDING = 64.0 * EPS
"""Rounding error in floats of a row over a window, relative to its terms."""

BERNSTEIN = bernstein(DEGREE)


@compiled()
def stays_positive(rows: SparseRows, row: int, Y: Matrix, drop: int, basis: Matrix, a: Vector) -> bool:
    """Return whether floats prove that a row without its first ``drop`` powers is positive over a window; a is scratch."""
    noise, count = 0.0, max(len(Y) - drop, 1)
    for i in range(count):
        a[i] = 0.0
    for i in range(len(Y)):
        for at in range(rows.starts[row], rows.starts[row + 1]):
            y = float(rows.entries[0, at]) * float(Y[i, rows.columns[at]])
            noise += abs(y)
            if i >= drop:
                a[i - drop] += y
    noise *= WINDOW_ROUNDING
    low = a[0]
    for i in range(1, count):
        low -= abs(a[i])
    if low > noise:
        return True
    for m in range(len(basis)):
        b = 0.0
        for i in range(min(m + 1, count)):
            b += basis[m, i] * a[i]
        if not b > noise:
            return False
    return True


def hulls(A: Array, δ: float, rows: Array, basis: Array) -> Array:
    """Return the maps from X to the Bernstein coefficients of rows (k, N) over a window, in floats, and their rounding.

    Column m < p + 1 of the matrix (N, p + 2) of row c is Σ_i basis[m, i] c (A δ)^i/i!, the last one
    `WINDOW_ROUNDING` times Σ_i |c| (|A| δ)^i/i!.
    """
    found = np.zeros((*rows.shape, len(basis) + 1))
    c, size = rows, np.abs(rows)
    for i in range(len(basis)):
        found[:, :, :-1] += c[:, :, None] * basis[:, i]
        found[:, :, -1] += WINDOW_ROUNDING * size
        c, size = c @ A * (δ / (i + 1)), size @ np.abs(A) * (δ / (i + 1))
    return found


NO_HULLS = np.zeros((0, 0, 0))


@compiled()
def lies_above(hull: Matrix, X: Matrix, b: Vector) -> bool:
    """Return whether floats prove that a row is positive over the window from X (2, N), by its `hulls`; b is scratch."""
    noise = 0.0
    count = hull.shape[1] - 1
    above = True
    for m in range(count):
        b[m] = 0.0
    for j in range(len(hull)):
        noise += hull[j, count] * abs(X[0, j])
        for m in range(count):
            b[m] += hull[j, m] * X[0, j]
    for m in range(count):
        above &= b[m] > noise
    return above


@compiled()
def fall(rows: SparseRows, row: int, Z: Stack, drop: int, basis: Stack, scale: Vector) -> tuple[float, float]:
    """Return the zero in a window at which a row falls, a double-double, or NaN; its first ``drop`` powers are zero."""
    n = max(len(Z) - drop, 1)
    a = np.zeros((2, n))
    c = np.zeros((2, n))
    b = np.zeros((2, n))
    floor = 0.0
    for i in range(drop, len(Z)):
        x, x_lo = on_row(rows, row, Z[i])
        a[0, i - drop], a[1, i - drop] = x, x_lo
        c[0, i - drop], c[1, i - drop] = divide(x, x_lo, basis[0, n - 1, i - drop], basis[1, n - 1, i - drop])
    for m in range(n):  # C(m, i)/C(n - 1, i) is a quotient of two entries of the basis
        x, x_lo = 0.0, 0.0
        for i in range(m + 1):
            y, y_lo = multiply(float(basis[0, m, i]), float(basis[1, m, i]), float(c[0, i]), float(c[1, i]))
            x, x_lo = add(x, x_lo, y, y_lo)
        b[0, m], b[1, m] = x, x_lo
    for at in range(rows.starts[row], rows.starts[row + 1]):
        floor -= FINE_EPS * abs(rows.entries[0, at]) * scale[rows.columns[at]]
    s = first_fall(b, floor)
    return polish(a, s) if s > 0.0 else (s, 0.0)


class Window(NamedTuple):
    """The map of X' = A X over a window: generator, length δ, and exp(A δ) (2, N, N), or none where the series is taken."""

    A: Generator
    δ: float
    step: Stack


@compiled()
def scan(
    window: Window, X: Matrix, rows: SparseRows, hull: Stack, order: Indices, basis: Stack, count: int, scale: Vector
) -> tuple[int, int, float, float]:
    """Return the first window in which a row turns negative, the row, and where in the window, a double-double.

    X (2, N) moves on to that instant, or past the last of ``count`` windows, where the window is -1; ``scale`` (N,) grows
    to the largest |X| at the starts of windows. In the first window the powers below ``order`` of a row are zero; a row of
    negative order is zero for ever. ``hull`` are the `hulls` of the rows, or none: then each window is expanded.
    """
    A = window.A
    δ = window.δ
    step = window.step
    p = basis.shape[1] - 1
    n = X.shape[1]
    terms = 0
    Y = np.empty((p + 1, n))
    Z = np.empty((0, 2, n))
    a = np.empty(p + 1)
    work = np.empty((2, n))
    for j in range(count):
        for i in range(n):
            Y[0, i], scale[i] = X[0, i], max(scale[i], abs(X[0, i]))
        expands, known = j == 0 or len(hull) == 0, False
        if expands:
            terms = write_terms(A, δ, Y)
        first = -1
        where = math.inf
        rest = 0.0
        for row in range(len(order)):
            if order[row] < 0:
                continue
            drop = order[row] if j == 0 else 0
            if stays_positive(rows, row, Y[:terms], drop, basis[0], a) if expands else lies_above(hull[row], X, a):
                continue
            if not known:
                Z, known = expand_finely(A, δ, X, p), True
            s, s_lo = fall(rows, row, Z, drop, basis, scale)
            if s < where:
                first = row
                where = s
                rest = s_lo
        if first >= 0:
            X[:] = horner(Z, where, rest)
            return j, first, where, rest
        if len(step[0]):
            move_by(step, X, work)
        else:
            X[:] = summed(Z if known else expand_finely(A, δ, X, p))
    return -1, -1, 0.0, 0.0
