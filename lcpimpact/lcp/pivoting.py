r"""The principal pivotal transform, and the steps of the principal pivoting methods.

The dictionary y = T x + const has one variable of each pair (z_i, w_i) in x (nonbasic) and the other in y (basic).
Initially x = z, y = w and T = M. A block pivot on the pairs α turns T into

.. math:: T'_{αα} = T_{αα}^{-1}, \quad T'_{αβ} = -T_{αα}^{-1} T_{αβ}, \quad T'_{βα} = T_{βα} T_{αα}^{-1}, \quad
          T'_{ββ} = T_{ββ} - T_{βα} T_{αα}^{-1} T_{αβ},

which is positive semidefinite or a P-matrix if M is. x and y are stored as values, so nonbasic variables need not be at a
bound, and an exchange swaps two numbers.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lcpimpact.arrays import Flags, Indices, Matrix, Vector
from lcpimpact.compiled import compiled
from lcpimpact.errors import Status
from lcpimpact.lcp.judge import holds, measure
from lcpimpact.lcp.polish import polish
from lcpimpact.lcp.problem import FREE, LOWER, UPPER
from lcpimpact.lcp.scaling import units
from lcpimpact.lcp.storage import product
from lcpimpact.lcp.trace import NONE, note
from lcpimpact.numerics.rounding import EPS

SOLVED, MAX_ITER = int(Status.SOLVED), int(Status.MAX_ITER)

PIVOT_TOL = 1e-11
"""Smallest pivot or rate of change above rounding error, for M with a unit diagonal."""

MAX_REFRESHES = 4
"""Maximum number of recomputations of the point to reduce its residual."""


class PivotTableau(NamedTuple):
    """A point of w = M z + q, scaled so that M has a unit diagonal and initially max |M z + q| = 1.

    Attributes
    ----------
    T : (n, n) array        y = T x + const
    x, y : (n,) arrays      nonbasic and basic variables
    free : (n,) flags       rows whose z is basic
    z_unit, w_unit : (n,) arrays
    size : float            max |M z + q| / w_unit before normalisation
    """

    T: Matrix
    x: Vector
    y: Vector
    free: Flags
    z_unit: Vector
    w_unit: Vector
    size: float


@compiled()
def scaled_tableau(W: Matrix, q: Vector, lower: Vector, upper: Vector, z: Vector) -> PivotTableau:
    """Set z to the projection of zero onto the box, and return the tableau there, with x = z; size = 0 if q = w = 0."""
    n = len(q)
    T = np.empty((n, n))
    x = np.empty(n)
    y = np.empty(n)
    z_unit = np.empty(n)
    w_unit = np.empty(n)
    free = np.zeros(n, np.bool_)
    units(W, q, z_unit)
    for i in range(n):
        z[i] = min(max(0.0, lower[i]), upper[i])
    product(W, z, y)
    size = 0.0
    for i in range(n):
        size = max(size, max(abs(q[i]), abs(y[i] + q[i])) * z_unit[i])
    if size > 0.0:
        for i in range(n):
            for j in range(n):
                T[i, j] = W[i, j] * z_unit[i] * z_unit[j]
            y[i] = (y[i] + q[i]) * z_unit[i] / size
        for i in range(n):
            w_unit[i] = size / z_unit[i]
            z_unit[i] *= size
            x[i] = min(max(0.0, lower[i] / z_unit[i]), upper[i] / z_unit[i])
    return PivotTableau(T, x, y, free, z_unit, w_unit, size)


@compiled()
def pair(x: float, y: float, free: bool) -> tuple[float, float]:
    """Return z_i and w_i."""
    return (y, x) if free else (x, y)


@compiled(inline="always")
def advance(tableau: PivotTableau, r: int, length: float) -> None:
    """Increase x_r by a step length, and update y."""
    T = tableau.T
    x = tableau.x
    y = tableau.y
    x[r] += length
    for i in range(len(y)):
        y[i] += length * T[i, r]


@compiled()
def ends_before(length: float, other: float, rate: float, fastest: float) -> bool:
    """Return whether one pair wins the ratio test against another; ties go to the faster rate."""
    margin = 1e-12 * length + 1e-15
    return length < other - margin or (length <= other + margin and rate > fastest)


@compiled()
def exchange(T: Matrix, r: int, c: int) -> None:
    """Pivot on T_rc: exchange the basic variable of row r with the nonbasic one of column c; T may be rectangular."""
    rows, columns = T.shape
    inverse = 1.0 / T[r, c]
    for j in range(columns):
        T[r, j] *= -inverse
    T[r, c] = inverse
    for i in range(rows):
        factor = T[i, c]
        if i != r and factor != 0.0:
            for j in range(columns):
                T[i, j] += factor * T[r, j]
            T[i, c] = factor * inverse


@compiled()
def exchange_two(T: Matrix, r: int, s: int) -> None:
    """Perform the 2 by 2 block pivot on the pairs r and s."""
    n = len(T)
    determinant = T[r, r] * T[s, s] - T[r, s] * T[s, r]
    a = T[s, s] / determinant
    b = -T[r, s] / determinant
    c = -T[s, r] / determinant
    d = T[r, r] / determinant
    for j in range(n):
        x, y = T[r, j], T[s, j]
        T[r, j], T[s, j] = -(a * x + b * y), -(c * x + d * y)
    T[r, r] = a
    T[r, s] = b
    T[s, r] = c
    T[s, s] = d
    for i in range(n):
        x, y = T[i, r], T[i, s]
        if i != r and i != s and (x != 0.0 or y != 0.0):
            for j in range(n):
                T[i, j] += x * T[r, j] + y * T[s, j]
            T[i, r], T[i, s] = x * a + y * c, x * b + y * d


@compiled(inline="always")
def swap(tableau: PivotTableau, i: int) -> None:
    """Swap the values x_i and y_i."""
    x = tableau.x
    y = tableau.y
    free = tableau.free
    x[i], y[i] = y[i], x[i]
    free[i] = not free[i]


@compiled(inline="always")
def pivot(tableau: PivotTableau, r: int) -> int:
    """Pivot on T_rr; return 1, the number of pairs exchanged."""
    exchange(tableau.T, r, r)
    swap(tableau, r)
    return 1


@compiled(inline="always")
def relieve(tableau: PivotTableau, r: int, s: int) -> int:
    """Pivot on the blocking pair s of x_r, or on r and s together if T_ss is too small; return the number exchanged.

    x_r follows the same path either way. Returns 0 if neither pivot is possible.
    """
    T = tableau.T
    across = T[r, s] * T[s, r]
    if T[s, s] > PIVOT_TOL and T[s, s] * T[s, s] > 1e-10 * abs(across):
        return pivot(tableau, s)
    if T[r, r] * T[s, s] - across > PIVOT_TOL * PIVOT_TOL:
        exchange_two(T, r, s)
        swap(tableau, r)
        swap(tableau, s)
        return 2
    return 0


@compiled(inline="always")
def record(tableau: PivotTableau, s: int, exchanged: int, z: Vector, basis: Indices) -> None:
    """Set z and the basis, and record them in the trace after an exchange that includes pair s."""
    x = tableau.x
    y = tableau.y
    free = tableau.free
    z_unit = tableau.z_unit
    n = len(z)
    for i in range(n):
        z[i] = z_unit[i] * pair(x[i], y[i], free[i])[0]
        basis[i] = n + i if free[i] else i
    entering, leaving = NONE, NONE
    if exchanged == 1:
        entering, leaving = (n + s, s) if free[s] else (s, n + s)
    note(z, basis, entering, leaving)


@compiled(inline="always")
def refresh(W: Matrix, q: Vector, tableau: PivotTableau) -> float:
    """Recompute the basic variables from M and q, and return their rounding error.

    The correction is repeated, because T has accumulated the rounding errors of the pivots.
    """
    T = tableau.T
    x = tableau.x
    y = tableau.y
    free = tableau.free
    z_unit = tableau.z_unit
    w_unit = tableau.w_unit
    n = len(q)
    z, w = np.empty(n), np.empty(n)
    for _ in range(2):
        for i in range(n):
            z[i] = z_unit[i] * pair(x[i], y[i], free[i])[0]
        product(W, z, w)
        for i in range(n):
            w[i] = (w[i] + q[i]) / w_unit[i]
            if not free[i]:
                y[i] = w[i]
        for i in range(n):
            if free[i]:
                for j in range(n):
                    if free[j]:
                        y[i] += T[i, j] * (x[j] - w[j])
    terms = 0.0
    for i in range(n):
        terms += abs(pair(x[i], y[i], free[i])[0])
    return 1e-14 + 8.0 * EPS * terms


@compiled()
def direction_of(tableau: PivotTableau, r: int, sign: int, v: Vector) -> None:
    """Set v = dz/dx_r times ``sign``; if the ray is unbounded, v may certify that there is no solution."""
    T = tableau.T
    free = tableau.free
    z_unit = tableau.z_unit
    size = tableau.size
    for i in range(len(v)):
        v[i] = sign * T[i, r] * z_unit[i] / size if free[i] and abs(T[i, r]) > PIVOT_TOL else 0.0
    if not free[r]:
        v[r] = sign * z_unit[r] / size


@compiled()
def finish(
    W: Matrix, q: Vector, lower: Vector, upper: Vector, tableau: PivotTableau, z: Vector, tol: float, status: int
) -> int:
    """Set z, polished if all nonbasic variables are at a bound; return SOLVED if its residual permits, else ``status``."""
    x = tableau.x
    y = tableau.y
    free = tableau.free
    z_unit = tableau.z_unit
    n = len(q)
    side, regular = np.empty(n, np.int64), True
    for i in range(n):
        z[i] = min(max(z_unit[i] * pair(x[i], y[i], free[i])[0], lower[i]), upper[i])
        side[i] = FREE if free[i] else LOWER if x[i] == lower[i] / z_unit[i] else UPPER
        regular = regular and (side[i] != UPPER or x[i] == upper[i] / z_unit[i])
    if status == MAX_ITER:
        return status
    if regular:
        return SOLVED if polish(W, q, lower, upper, side, z, tol) else status
    scaled, _, rounding = measure(W, q, lower, upper, z, np.empty(n))
    return SOLVED if holds(scaled, rounding, tol) else status
