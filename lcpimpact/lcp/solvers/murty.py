"""Murty's principal pivoting method: exchange the infeasible row of least index.

It is finite for every P-matrix and the simplest pivoting method, but visits all 2^n bases on some families.
"""

from __future__ import annotations

import numpy as np

from lcpimpact.arrays import Matrix, Vector
from lcpimpact.compiled import FEW_ROWS, compiled
from lcpimpact.errors import Status
from lcpimpact.lcp.basis import basic_solution, is_rounding, row_roots, sides, violation
from lcpimpact.lcp.operators import Property
from lcpimpact.lcp.problem import FREE, LOWER
from lcpimpact.lcp.solver import CompiledSolver
from lcpimpact.lcp.storage import is_symmetric, product
from lcpimpact.lcp.trace import NONE, note
from lcpimpact.numerics.rounding import EPS

SOLVED = int(Status.SOLVED)
SINGULAR = int(Status.SINGULAR)
MAX_ITER = int(Status.MAX_ITER)


@compiled(most=FEW_ROWS)
def murty(W: Matrix, q: Vector, lower: Vector, upper: Vector, z: Vector, tol: float, max_iter: int) -> tuple[int, int]:
    """Exchange w_i and z_i for the least i whose basic variable is negative, until there is none.

    The rows of the guess with z > 0 are free initially. Tolerances refer to the problem scaled to a unit diagonal, plus the
    rounding error of a product, and finally to each row's own terms.
    """
    n = len(q)
    definite = is_symmetric(W)
    side, basis = np.empty(n, np.int64), np.empty(n, np.int64)
    w, root = np.empty(n), np.empty(n)
    sides(z, lower, upper, side)
    size = row_roots(W, q, root)
    entering, leaving = NONE, NONE
    fine = 2 * n
    for step in range(1, max_iter + 1):
        if not basic_solution(W, definite, q, lower, upper, side, z):
            return SINGULAR, step
        product(W, z, w)
        terms = 0.0
        for i in range(n):
            terms += root[i] * abs(z[i])
            basis[i] = n + i if side[i] == FREE else i
        note(z, basis, entering, leaving)

        rounding = 1e-14 * size + 8.0 * EPS * terms
        entering = NONE
        for i in range(n):
            excess = violation(side[i], z[i], w[i] + q[i], lower[i], upper[i], root[i])
            if excess <= 0.0 or (excess <= rounding * root[i] and (fine == 0 or is_rounding(W, q, z, i, excess))):
                continue
            fine -= 1 if excess <= rounding * root[i] else 0
            entering, leaving = (i, n + i) if side[i] == FREE else (n + i, i)
            side[i] = LOWER if side[i] == FREE else FREE
            break
        if entering == NONE:
            for i in range(n):
                z[i] = max(z[i], 0.0)
            return SOLVED, step
    return MAX_ITER, max_iter


SOLVER = CompiledSolver(
    name="murty",
    summary="least-index principal pivoting, for teaching: finite for P-matrices, exponential on Murty's and Fathi's",
    requires=(Property.POSITIVE_DIAGONAL,),
    storages=("dense", "banded"),
    boxed=False,
    tol=1e-10,
    max_iter=10_000,
    source="Murty1974; Murty1988, section 4.1",
    kernel=murty,
)
