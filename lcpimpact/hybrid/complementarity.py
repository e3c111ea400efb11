r"""Linear complementarity problems in double-doubles, from solutions in floats: of modes, and of impacts.

Floats determine which rows lie between their bounds; these are solved in double-doubles, and rows with wrong signs are
exchanged by Murty's rule. Newton's law of impact is the LCP

.. math:: 0 \le P \perp U^+ + e U^- \ge 0, \qquad U^+ = U^- + G P, \qquad G = C A B .
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lcpimpact.arrays import Array, Flags, Indices, Matrix, Stack, Vector
from lcpimpact.compiled import compiled
from lcpimpact.numerics.double_double import DoubleDouble, add, multiply, product, total
from lcpimpact.numerics.elimination import quotient
from lcpimpact.numerics.rounding import EPS

FLOAT_ZERO = 16.0 * EPS
"""Rounding error in the solution of an LCP in floats, relative to it."""


@compiled()
def exchange(W: Stack, q: Matrix, z: Vector, lower: Vector, upper: Vector, tiny: Vector) -> tuple[Matrix, Matrix, bool]:
    """Return z and w = W z + q, complementary within bounds, as double-doubles, from a solution z in floats.

    The rows between their bounds in floats are solved; the last row with a sign wrong by more than ``tiny`` (in the unit
    of q) is exchanged (Murty's rule) until there is none; the flag says whether the exchanges end.
    """
    n = len(z)
    free = np.zeros(n, np.bool_)
    high = np.zeros(n, np.bool_)
    slack = np.zeros(n)
    found, w = np.zeros((2, n)), q.copy()
    for i in range(n):
        unit = abs(W[0, i, i]) if W[0, i, i] != 0.0 else np.abs(W[0, :, i]).max()
        slack[i] = tiny[i] / unit if unit > 0.0 else 0.0
        w0 = q[0, i]
        for j in range(n):
            w0 += W[0, i, j] * z[j]
        # A float within rounding of its bound starts there: two redundant rows must not both be free.
        near = max(slack[i], FLOAT_ZERO * abs(z[i]))
        free[i] = z[i] - lower[i] > near and upper[i] - z[i] > near and (z[i] - lower[i]) * unit > w0
        high[i] = not free[i] and upper[i] - z[i] < z[i] - lower[i]
    for _ in range(4 * n + 4):
        for i in range(n):
            found[0, i] = 0.0 if free[i] else (upper[i] if high[i] else lower[i])
            found[1, i] = 0.0
        rows = np.flatnonzero(free)
        if len(rows):
            rest = product(W, found.reshape(2, n, 1))
            block = np.empty((2, len(rows), len(rows)))
            right = np.empty((2, len(rows), 1))
            for a, k in enumerate(rows):
                x, x_lo = add(q[0, k], q[1, k], rest[0, k, 0], rest[1, k, 0])
                right[0, a, 0], right[1, a, 0] = -x, -x_lo
                for b, m in enumerate(rows):
                    block[0, a, b], block[1, a, b] = W[0, k, m], W[1, k, m]
            solution = quotient(block, right)
            if np.isnan(solution[0, 0, 0]):
                return found, w, False
            for a, k in enumerate(rows):
                found[0, k] = solution[0, a, 0]
                found[1, k] = solution[1, a, 0]
        w = total(q, product(W, found.reshape(2, n, 1))[:, :, 0].copy())
        wrong, above = -1, False
        for i in range(n):
            if free[i]:
                if found[0, i] < lower[i] - slack[i] or found[0, i] > upper[i] + slack[i]:
                    wrong, above = i, found[0, i] > upper[i] + slack[i]
            elif lower[i] < upper[i] and (w[0, i] > tiny[i] if high[i] else w[0, i] < -tiny[i]):
                wrong, above = i, False
        if wrong < 0:
            return found, w, True
        free[wrong], high[wrong] = not free[wrong], above
    return found, w, False


def complementary(
    W: DoubleDouble, q: DoubleDouble, z: Array, lower: Array, upper: Array, tiny: Array
) -> tuple[DoubleDouble, DoubleDouble]:
    """Return z and w = W z + q, complementary within bounds, as double-doubles, from a solution z in floats.

    Where the exchanges of rows do not end, the matrix being no P-matrix, or where the rows between their bounds are
    redundant, z is refined by the pseudo-inverse of the rows with w = 0: first in the unknowns between their bounds, then
    also in those with both at zero.

    Raises
    ------
    numpy.linalg.LinAlgError
        If that gives no solution either.
    """
    found, w, ended = exchange(
        np.ascontiguousarray(W.parts), np.ascontiguousarray(q.parts), *(np.asarray(a) for a in (z, lower, upper, tiny))
    )
    if ended:
        return DoubleDouble(found), DoubleDouble(w)
    near = FLOAT_ZERO * np.abs(z).max(initial=0.0)
    equal = np.abs(W.hi @ z + q.hi) <= FLOAT_ZERO * (np.abs(W.hi) @ np.abs(z) + np.abs(q.hi))
    between = (z > lower + near) & (z < upper - near)
    bound = np.where(z - lower <= upper - z, lower, upper)
    for free in (equal & between, equal):
        refined, w_found = refine(W, q, np.where(equal & ~free, bound, z), equal, free)
        inside = (refined.hi >= lower - near) & (refined.hi <= upper + near)
        signs = np.where(free, np.abs(w_found.hi) <= tiny, np.where(z > lower, w_found.hi <= tiny, w_found.hi >= -tiny))
        if (inside & signs).all():
            return refined, w_found
    raise np.linalg.LinAlgError("no complementary basis")


def refine(
    W: DoubleDouble,
    q: DoubleDouble,
    z: Array,
    equal: Flags,
    free: Flags,
    *,
    redundant_rtol: float = 1e-10,
    refinements: int = 4,
) -> tuple[DoubleDouble, DoubleDouble]:
    """Return z and w = W z + q, double-doubles, with w = 0 in the rows ``equal``, by the least change of the ``free`` z.

    ``redundant_rtol``: singular value of redundant rows, relative to the largest.
    ``refinements``: number of refinements by a pseudo-inverse in floats, of which three reach double-doubles.
    """
    rows = np.flatnonzero(equal)
    columns = np.flatnonzero(free)
    refined = DoubleDouble.of(z)
    block = W.hi[np.ix_(rows, columns)]
    size = np.abs(block).max(axis=1, initial=0.0)
    a = 1.0 / np.where(size > 0.0, size, 1.0)
    size = np.abs(a[:, None] * block).max(axis=0, initial=0.0)
    b = 1.0 / np.where(size > 0.0, size, 1.0)
    inverse = b[:, None] * np.linalg.pinv(a[:, None] * block * b, redundant_rtol) * a
    for _ in range(refinements):
        change = np.zeros(len(z))
        change[columns] = inverse @ (W @ refined + q).hi[rows]
        refined = refined - change
    return refined, W @ refined + q


@compiled()
def approach(u: Matrix, U: Matrix, before: Matrix, e: Vector, meets: Flags) -> tuple[Indices, Vector, Vector, bool]:
    """Return the rows with impacts, e of each, or 0 where they open already, and U + e U⁻ in floats; U⁻ is ``before``.

    These are the rows of ``meets`` with u <= 0. The flag says whether any U + e U⁻ is negative: then there are impulses.
    """
    rows = np.flatnonzero(meets & (u[0] <= 0.0))
    bounce, q = np.empty(len(rows)), np.empty(len(rows))
    for a, i in enumerate(rows):
        bounce[a] = e[i] if before[0, i] < 0.0 else 0.0
        q[a] = U[0, i] + bounce[a] * before[0, i]
    return rows, bounce, q, bool((q < 0.0).any())


class Meeting(NamedTuple):
    """Rows with impacts (k,), e of each, or 0 where a contact opens already, and U and U⁻ of all rows, double-doubles."""

    rows: Indices
    e: Vector
    U: Matrix
    before: Matrix


@compiled()
def rebound(G: Stack, B: Stack, X: Matrix, meeting: Meeting, z: Vector, zero: float) -> tuple[Matrix, Matrix, bool]:
    """Return X + B P and P, double-doubles, where 0 <= P ⟂ G P + U + e U⁻ >= 0 on the rows with impacts.

    z are the impulses in floats (see `exchange`).
    """
    rows = meeting.rows
    e = meeting.e
    U = meeting.U
    before = meeting.before
    n = len(rows)
    W = np.empty((2, n, n))
    q = np.empty((2, n))
    tiny = np.empty(n)
    P = np.zeros((2, G.shape[1]))
    for a, i in enumerate(rows):
        back, back_lo = multiply(before[0, i], before[1, i], e[a], 0.0)
        q[0, a], q[1, a] = add(U[0, i], U[1, i], back, back_lo)
        tiny[a] = abs(q[0, a])
        for b, j in enumerate(rows):
            W[0, a, b], W[1, a, b] = G[0, i, j], G[1, i, j]
            tiny[a] += abs(W[0, a, b] * z[b])
    found, _, ended = exchange(W, q, z, np.zeros(n), np.full(n, np.inf), zero * tiny)
    for a, i in enumerate(rows):
        if found[0, a] > 0.0:
            P[0, i], P[1, i] = found[0, a], found[1, a]
    return total(X, product(B, P.reshape(2, -1, 1))[:, :, 0].copy()), P, ended


@compiled()
def at_rest(P: Vector, before: Matrix, e: Vector, G: Matrix, held: Flags, degree: Indices) -> Flags:
    """Return the rows of degree 2 with U = 0 after the impulses P: no rebound, or ``held`` and not affected by P."""
    found = np.empty(len(P), np.bool_)
    for i in range(len(P)):
        change = 0.0
        for j in range(len(P)):
            change += G[i, j] * P[j]
        stays = (P[i] > 0.0 and e[i] * min(before[0, i], 0.0) == 0.0) or (held[i] and change == 0.0)
        found[i] = stays and degree[i] == 2
    return found
