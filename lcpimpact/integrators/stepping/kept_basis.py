r"""The LCP of many rows that keep their sides from step to step, by a basis that is kept with its transformed matrix.

With the rows α free and the others at a bound, the principal pivotal transform T of W gives the basic solution by one
product,

.. math:: \begin{pmatrix} z_α \\ w_β - q_β \end{pmatrix} = T \begin{pmatrix} -q_α \\ z_β \end{pmatrix},

and a row that changes sides costs one exchange, n² products as well. A solution is judged with W itself; where it is not
found within a few exchanges, or does not hold, the LCP is left to its solver.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lcpimpact.arrays import Flags, Indices, Matrix, Vector
from lcpimpact.compiled import compiled
from lcpimpact.integrators.stepping.law import SOLVED, ContactProblem, examine, restrict
from lcpimpact.lcp.basis import sides
from lcpimpact.lcp.judge import clear_residual
from lcpimpact.lcp.lapack import multiply
from lcpimpact.lcp.pivoting import PIVOT_TOL, exchange
from lcpimpact.lcp.problem import FREE, LOWER, UPPER

SMALLEST_KEPT = 20
"""Number of rows up to which a factorisation costs no more than keeping the basis."""

MOST_TURNS = 4
"""Maximum number of times that the rows of wrong sign change sides in a step."""


class KeptBasis(NamedTuple):
    """The basis of the last LCP.

    Attributes
    ----------
    T : (nc, nc) array          the transform of W; no rows where no basis is kept
    free : (nc,) flags          the rows that are free in T
    made : (1,) flags           whether T is that of W
    """

    T: Matrix
    free: Flags
    made: Flags


def kept_basis(nc: int) -> KeptBasis:
    """Return room for the basis of nc rows, if these are many."""
    n = nc if nc > SMALLEST_KEPT else 0
    return KeptBasis(np.zeros((n, n)), np.zeros(n, np.bool_), np.zeros(1, np.bool_))


@compiled()
def take_sides(W: Matrix, kept: KeptBasis, side: Indices) -> bool:
    """Exchange the rows whose sides have changed; return whether all pivots are positive beyond rounding."""
    T, free = kept.T, kept.free
    if not kept.made[0]:
        T[:, :] = W
        free[:], kept.made[0] = False, True
    for i in range(len(side)):
        if free[i] != (side[i] == FREE):
            # The pivot of a row that becomes free is at most W_ii, and that of one that ceases to be at least 1/W_ii.
            pivot = T[i, i] / W[i, i] if side[i] == FREE else 1.0 / (T[i, i] * W[i, i])
            if not PIVOT_TOL < pivot < np.inf:
                kept.made[0] = False
                return False
            exchange(T, i, i)
            free[i] = not free[i]
    return True


@compiled()
def basic_solution(T: Matrix, q: Vector, bound: Vector, side: Indices, given: Vector, found: Vector) -> None:
    """Write z of the free rows and w of the others."""
    n = len(q)
    for i in range(n):
        given[i] = -q[i] if side[i] == FREE else bound[i]
    multiply(T, given, found)
    for i in range(n):
        found[i] += 0.0 if side[i] == FREE else q[i]


@compiled()
def solve_from_basis(rows: ContactProblem, active: Indices, kept: KeptBasis, guess: Vector, tol: float) -> float:
    """Overwrite the guess z of the active rows by the solution; return the residual, infinite if none was found."""
    n, na = len(rows.q), len(active)
    vectors, side = np.zeros((5, n)), np.empty(n, np.int64)
    lower = vectors[0]
    upper = vectors[1]
    z = vectors[2]
    given = vectors[3]
    found = vectors[4]
    for a in range(na):
        i = active[a]
        lower[i] = rows.lower[i]
        upper[i] = rows.upper[i]
        z[i] = guess[a]
    sides(z, lower, upper, side)
    for _ in range(MOST_TURNS):
        if not take_sides(rows.W, kept, side):
            return np.inf
        for i in range(n):
            z[i] = lower[i] if side[i] == LOWER else upper[i]
        basic_solution(kept.T, rows.q, z, side, given, found)
        turned = False
        for i in range(n):
            if side[i] == FREE:
                z[i] = found[i]
                if not lower[i] <= z[i] <= upper[i]:
                    side[i], turned = LOWER if z[i] < lower[i] else UPPER, True
            elif lower[i] < upper[i] and (found[i] < 0.0 if side[i] == LOWER else found[i] > 0.0):
                side[i], turned = FREE, True
        if not turned:
            break
    if turned:
        return np.inf
    part = z
    if na < n:
        part, rows = z[active], restrict(rows, active)
    W = rows.W
    q = rows.q
    low = rows.lower
    high = rows.upper
    status = SOLVED
    residual = clear_residual(W, q, low, high, part, tol)
    if residual == np.inf:
        status, residual = examine(SOLVED, W, q, low, high, part, tol)
    kept.made[0] = residual == 0.0  # Else exchanges have lost digits.
    if status != SOLVED:
        return np.inf
    guess[:] = part
    return residual
