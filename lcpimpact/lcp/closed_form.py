"""The solution of one or two rows by cases: each complementary basis in turn."""

from __future__ import annotations

from numba import types

from lcpimpact.arrays import Array
from lcpimpact.compiled import compiled, f8, i8, matrix, vector
from lcpimpact.errors import Status
from lcpimpact.lcp.solver import CompiledSolver, Requirement

SOLVED, INFEASIBLE = int(Status.SOLVED), int(Status.INFEASIBLE)


@compiled(types.UniTuple(i8, 2)(matrix, vector, vector, f8, i8))
def closed_form(M: Array, q: Array, z: Array, tol: float, max_iter: int) -> tuple[int, int]:
    """Solve one or two rows by trying the bases {}, {1}, {2}, {1, 2} in this order.

    With one row: z = 0 if q >= 0, else z = -q/M, which is a solution only for M > 0.
    """
    if len(q) == 1:
        if q[0] >= 0.0:
            z[0] = 0.0
            return SOLVED, 1
        if M[0, 0] > 0.0:
            z[0] = -q[0] / M[0, 0]
            return SOLVED, 1
        return INFEASIBLE, 1

    z[0] = z[1] = 0.0
    if q[0] >= 0.0 and q[1] >= 0.0:
        return SOLVED, 1
    if q[0] < 0.0 and M[0, 0] > 0.0 and M[1, 0] * (-q[0] / M[0, 0]) + q[1] >= 0.0:
        z[0] = -q[0] / M[0, 0]
        return SOLVED, 2
    if q[1] < 0.0 and M[1, 1] > 0.0 and M[0, 1] * (-q[1] / M[1, 1]) + q[0] >= 0.0:
        z[1] = -q[1] / M[1, 1]
        return SOLVED, 3
    determinant = M[0, 0] * M[1, 1] - M[0, 1] * M[1, 0]
    if determinant != 0.0:
        z[0] = (M[0, 1] * q[1] - M[1, 1] * q[0]) / determinant
        z[1] = (M[1, 0] * q[0] - M[0, 0] * q[1]) / determinant
        if z[0] >= 0.0 and z[1] >= 0.0:
            return SOLVED, 4
        z[0] = z[1] = 0.0
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
