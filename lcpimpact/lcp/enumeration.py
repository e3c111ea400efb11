"""Every complementary basis in turn: slow, certain, and the oracle for small problems."""

from __future__ import annotations

import numpy as np
from numba import types

from lcpimpact.arrays import Array
from lcpimpact.compiled import compiled, f8, i8, matrix, vector
from lcpimpact.errors import Status
from lcpimpact.lcp.gauss import solve_basis
from lcpimpact.lcp.problem import scaled_residual
from lcpimpact.lcp.solver import CompiledSolver, Requirement

SOLVED, INFEASIBLE = int(Status.SOLVED), int(Status.INFEASIBLE)
UNDECIDED, MAX_ITER = int(Status.UNDECIDED), int(Status.MAX_ITER)


@compiled(types.UniTuple(i8, 2)(matrix, vector, vector, f8, i8))
def enumeration(M: Array, q: Array, z: Array, tol: float, max_iter: int) -> tuple[int, int]:
    """Try the 2ⁿ bases in the order of the binary numbers, and take the first whose residual is within tol.

    When none fits, the problem has no solution, unless a basis was singular: then it is undecided.
    """
    n = len(q)
    support = np.empty(n, np.int64)
    trial = np.empty(n)
    singular = False
    z[:] = 0.0
    for basis in range(2**n):
        if basis >= max_iter:
            return MAX_ITER, basis
        k = 0
        for i in range(n):
            if basis >> i & 1:
                support[k] = i
                k += 1
        if not solve_basis(M, q, support[:k], trial):
            singular = True
        elif scaled_residual(M, q, trial) <= tol:
            for i in range(n):
                z[i] = max(trial[i], 0.0)
            return SOLVED, basis + 1
    return (UNDECIDED if singular else INFEASIBLE), 2**n


SOLVER = CompiledSolver(
    name="enumeration",
    summary="all 2^n complementary bases; the oracle for n <= 15",
    requires=(Requirement.AT_MOST_15,),
    tol=1e-10,
    max_iter=2**15,
    source="Cottle, Pang and Stone (1992), section 1.3",
    kernel=enumeration,
)
