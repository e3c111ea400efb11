"""Reduction of a mixed LCP to one without equations, and of a boxed LCP to a plain LCP, for methods without bounds."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lcpimpact.arrays import Flags, Indices, Matrix, Vector
from lcpimpact.compiled import compiled
from lcpimpact.lcp.lapack import largest
from lcpimpact.lcp.pivoting import PIVOT_TOL, exchange
from lcpimpact.lcp.problem import FREE, LOWER, UPPER
from lcpimpact.lcp.scaling import equilibrate
from lcpimpact.lcp.storage import product


@compiled()
def to_lcp(M: Matrix, q: Vector, lower: Vector, upper: Vector) -> tuple[Matrix, Vector, Indices, Vector, Vector]:
    r"""Return LCP(N, p) in y >= 0, the row and the sign of each unknown, and z at y = 0.

    .. math:: z_i = lower_i + y_i, \quad z_i = upper_i - y_i, \quad z_i = y_i - y_j

    for a row with a lower bound, with an upper bound only, and without bounds. A row with both bounds also has a multiplier
    μ, 0 <= μ ⟂ upper - lower - y >= 0, with sign 0 here. A row with lower = upper has no unknown.
    """
    n = len(q)
    row = np.empty(2 * n, np.int64)
    sign = np.empty(2 * n)
    base = np.zeros(n)
    count = 0
    for i in range(n):
        below, above = lower[i] > -np.inf, upper[i] < np.inf
        base[i] = lower[i] if below else upper[i] if above else 0.0
        if lower[i] == upper[i]:
            continue
        row[count] = i
        sign[count] = 1.0 if below or not above else -1.0
        count += 1
        if below == above:
            row[count], sign[count] = i, 0.0 if below else -1.0
            count += 1
    s = largest(M)
    s = s if s > 0.0 else 1.0
    w = np.empty(n)
    product(M, base, w)
    N, p = np.zeros((count, count)), np.empty(count)
    for a in range(count):
        i = row[a]
        if sign[a] == 0.0:
            p[a] = s * (upper[i] - lower[i])
            N[a, a - 1], N[a - 1, a] = -s, s
            continue
        p[a] = sign[a] * (q[i] + w[i])
        for b in range(count):
            if sign[b] != 0.0:
                N[a, b] = sign[a] * sign[b] * M[i, row[b]]
    return N, p, row[:count], sign[:count], base


@compiled()
def from_lcp(row: Indices, sign: Vector, y: Vector, z: Vector) -> None:
    """Add the contribution of y to z; on entry z is its value at y = 0 for a solution, 0 for a direction."""
    for a in range(len(y)):
        z[row[a]] += sign[a] * y[a]


class Eliminated(NamedTuple):
    """A mixed LCP after block pivots that took free z into the basis, for as many equations w = 0.

    The dictionary is that of the scaled w_i and z_i. Where M_FF of the free rows F is singular, as for constraints and their
    multipliers, the pair of a row with one bound is turned: its w becomes an unknown, and its z the image. Nothing depends
    on the signs or the order of the equations.

    Attributes
    ----------
    T : (n, n + 1) array        basic variables in terms of the nonbasic ones, and the constant
    kept : (m,) indices         rows that remain
    turned : (n,) flags         rows with w nonbasic and z basic
    equation : (n,) indices     the w of each row; the equations may have been exchanged
    w_unit, z_unit : (n,) arrays    the scaled variables are w_i w_unit_i and z_i / z_unit_i
    """

    T: Matrix
    kept: Indices
    turned: Flags
    equation: Indices
    w_unit: Vector
    z_unit: Vector


@compiled()
def has_equations(lower: Vector, upper: Vector) -> bool:
    """Return whether a row has no bounds."""
    found = False
    for i in range(len(lower)):
        found = found or (lower[i] == -np.inf and upper[i] == np.inf)
    return found


@compiled()
def swap_rows(T: Matrix, i: int, k: int) -> None:
    """Swap two rows."""
    for j in range(T.shape[1]):
        T[i, j], T[k, j] = T[k, j], T[i, j]


@compiled()
def largest_pivot(T: Matrix, free: Indices) -> tuple[int, int]:
    """Return the row and column of the largest entry of the free rows and columns, or -1 if all are rounding errors."""
    r = -1
    c = -1
    most = PIVOT_TOL
    for i in free:
        for j in free:
            if abs(T[i, j]) > most:
                r = i
                c = j
                most = abs(T[i, j])
    return r, c


@compiled()
def largest_turn(T: Matrix, free: Indices, single: Flags) -> tuple[int, int, int]:
    """Return the free row r, the free column c and the row b of one bound with the largest pivots T_rb and T_bc, or -1."""
    r = -1
    c = -1
    b = -1
    most = PIVOT_TOL
    for i in range(len(single)):
        if single[i]:
            row, column = free[0], free[0]
            for k in free:
                row = k if abs(T[k, i]) > abs(T[row, i]) else row
                column = k if abs(T[i, k]) > abs(T[i, column]) else column
            size = min(abs(T[row, i]), abs(T[i, column]))
            if size > most:
                r = row
                c = column
                b = i
                most = size
    return r, c, b


@compiled()
def eliminate_equations(M: Matrix, q: Vector, lower: Vector, upper: Vector) -> Eliminated:
    r"""Eliminate the free rows F by block pivots: for a nonsingular M_FF the Schur complement, whatever their signs.

    .. math:: w_B = (M_{BB} - M_{BF} M_{FF}^{-1} M_{FB}) z_B + q_B - M_{BF} M_{FF}^{-1} q_F

    References
    ----------
    Cottle, Pang and Stone, *The Linear Complementarity Problem* (1992), sections 1.5 and 2.3.
    """
    n = len(q)
    T = np.empty((n, n + 1))
    w_unit = np.empty(n)
    z_unit = np.empty(n)
    equation = np.arange(n)
    turned = np.zeros(n, np.bool_)
    single = np.zeros(n, np.bool_)
    gone = np.zeros(n, np.bool_)
    free = np.zeros(n, np.bool_)
    equilibrate(M, w_unit, z_unit)
    for i in range(n):
        below, above = lower[i] > -np.inf, upper[i] < np.inf
        free[i], single[i] = not below and not above, below != above
        for j in range(n):
            T[i, j] = M[i, j] * w_unit[i] * z_unit[j]
        T[i, n] = q[i] * w_unit[i]
    rows = np.flatnonzero(free)
    while len(rows) > 0:
        r, c = largest_pivot(T, rows)
        if r >= 0:
            exchange(T, r, c)
        else:
            r, c, b = largest_turn(T, rows, single)
            if r < 0:
                break
            exchange(T, r, b)
            exchange(T, b, c)
            swap_rows(T, r, b)
            for i in range(n):
                T[i, b], T[i, c] = T[i, c], T[i, b]
            turned[b], single[b] = not turned[b], False
        # z_c becomes basic in row c, and the equation of row r nonbasic in column c.
        swap_rows(T, r, c)
        equation[r], equation[c] = equation[c], equation[r]
        free[c], gone[c] = False, True
        rows = np.flatnonzero(free)
    return Eliminated(T, np.flatnonzero(~gone), turned, equation, w_unit, z_unit)


@compiled()
def remaining(problem: Eliminated, lower: Vector, upper: Vector) -> tuple[Matrix, Vector, Vector, Vector]:
    """Return M, q and the bounds of the rows that remain; a turned row of the bound l has 0 <= w ⟂ z - l >= 0."""
    T = problem.T
    kept = problem.kept
    turned = problem.turned
    z_unit = problem.z_unit
    m, n = len(kept), len(T)
    M = np.empty((m, m))
    q = np.empty(m)
    low = np.empty(m)
    high = np.empty(m)
    for a in range(m):
        i = kept[a]
        low[a] = lower[i] / z_unit[i]
        high[a] = upper[i] / z_unit[i]
        q[a] = T[i, n]
        if turned[i]:
            below = lower[i] > -np.inf
            q[a] -= low[a] if below else high[a]
            low[a], high[a] = (0.0, np.inf) if below else (-np.inf, 0.0)
        for b in range(m):
            M[a, b] = T[i, kept[b]]
    return M, q, low, high


@compiled()
def restore(problem: Eliminated, x: Vector, lower: Vector, upper: Vector, z: Vector, side: Indices) -> None:
    """Set z and its sides from the unknowns x of the rows that remain."""
    T = problem.T
    kept = problem.kept
    turned = problem.turned
    z_unit = problem.z_unit
    n = len(z)
    for i in range(n):
        z[i], side[i] = T[i, n], FREE
        for b in range(len(kept)):
            z[i] += T[i, kept[b]] * x[b]
        z[i] *= z_unit[i]
    for a in range(len(kept)):
        i = kept[a]
        if turned[i]:
            side[i] = FREE if x[a] == 0.0 else LOWER if lower[i] > -np.inf else UPPER
        else:
            z[i] = x[a] * z_unit[i]
            if x[a] <= lower[i] / z_unit[i] or lower[i] == upper[i]:
                side[i] = LOWER
            elif x[a] >= upper[i] / z_unit[i]:
                side[i] = UPPER
    for i in range(n):
        z[i] = min(max(z[i], lower[i]), upper[i])


@compiled()
def restore_ray(problem: Eliminated, x: Vector, v: Vector) -> None:
    """Set v, a certificate of infeasibility, from that of the rows that remain: Σ x_i y_i in terms of the w is v·w."""
    T = problem.T
    kept = problem.kept
    turned = problem.turned
    equation = problem.equation
    w_unit = problem.w_unit
    n = len(v)
    v[:] = 0.0
    for j in range(n):
        total = 0.0
        for b in range(len(kept)):
            total += x[b] * T[kept[b], j]
        v[equation[j]] = -total * w_unit[equation[j]]
    for a in range(len(kept)):
        i = kept[a]
        if not turned[i]:
            v[equation[i]] = x[a] * w_unit[equation[i]]
