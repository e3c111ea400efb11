"""The solution of one or two rows by cases: each complementary basis in turn."""

from __future__ import annotations

import numpy as np
from numba import types

from lcpimpact.arrays import Array
from lcpimpact.compiled import compiled, f8, i8, matrix, vector
from lcpimpact.errors import Status
from lcpimpact.lcp.problem import scaled_residual
from lcpimpact.lcp.solver import CompiledSolver, Requirement

SOLVED, INFEASIBLE = int(Status.SOLVED), int(Status.INFEASIBLE)


@compiled(types.UniTuple(i8, 2)(matrix, vector, vector, f8, i8))
def closed_form(M: Array, q: Array, z: Array, tol: float, max_iter: int) -> tuple[int, int]:
    """Solve one or two rows by trying the bases {}, {1}, {2}, {1, 2}.

    One row: z = 0 if q >= 0, else z = -q/M, which is a solution only for M > 0. Two rows: each basis gives a candidate,
    and the one with the smallest residual stands if it is within tol, so that rounding at a corner decides nothing.
    """
    if len(q) == 1:
        if q[0] >= 0.0:
            z[0] = 0.0
            return SOLVED, 1
        if M[0, 0] > 0.0:
            z[0] = -q[0] / M[0, 0]
            return SOLVED, 1
        return INFEASIBLE, 1

    s = max(max(abs(M[0, 0]), abs(M[0, 1])), max(abs(M[1, 0]), abs(M[1, 1])))
    p = max(abs(q[0]), abs(q[1]))
    z[0] = z[1] = 0.0
    if q[0] >= 0.0 and q[1] >= 0.0:
        return SOLVED, 1
    if s == 0.0:
        return INFEASIBLE, 1
    a, b, c, d = M[0, 0] / s, M[0, 1] / s, M[1, 0] / s, M[1, 1] / s
    f, g = q[0] / p, q[1] / p
    best, trial = np.zeros(2), np.zeros(2)
    smallest = scaled_residual(M, q, best)
    for basis in range(1, 4):
        trial[0] = trial[1] = 0.0
        if basis == 1 and a > 0.0:
            trial[0] = max(0.0, -f / a)
        elif basis == 2 and d > 0.0:
            trial[1] = max(0.0, -g / d)
        elif basis == 3 and abs(a * d - b * c) > 1e-14 * (abs(a * d) + abs(b * c)):
            trial[0] = max(0.0, (b * g - d * f) / (a * d - b * c))
            trial[1] = max(0.0, (c * f - a * g) / (a * d - b * c))
        trial *= p / s
        residual = scaled_residual(M, q, trial)
        if residual < smallest:
            smallest = residual
            best[:] = trial
    if smallest <= tol:
        z[:] = best
        return SOLVED, 4
    return INFEASIBLE, 4


SOLVER = CompiledSolver(
    name="closed-form",
    summary="one or two rows by cases; what the paper's own steps need",
    requires=(Requirement.AT_MOST_2,),
    tol=1e-12,
    max_iter=4,
    source="enumeration of the four complementary bases",
    kernel=closed_form,
)
