"""Projected Gauss-Seidel: the iteration that granular and game codes use."""

from __future__ import annotations

from numba import types

from lcpimpact.arrays import Array
from lcpimpact.compiled import compiled, f8, i8, matrix, vector
from lcpimpact.errors import Status
from lcpimpact.lcp.problem import scaled_residual
from lcpimpact.lcp.solver import CompiledSolver, Requirement

SOLVED, MAX_ITER = int(Status.SOLVED), int(Status.MAX_ITER)


@compiled(types.UniTuple(i8, 2)(matrix, vector, vector, f8, i8))
def pgs(M: Array, q: Array, z: Array, tol: float, max_iter: int) -> tuple[int, int]:
    """Sweep z_i <- max(0, z_i - (M z + q)_i / M_ii) until the residual is within tol."""
    for sweep in range(max_iter):
        for i in range(len(q)):
            w = q[i]
            for j in range(len(q)):
                w += M[i, j] * z[j]
            z[i] = max(0.0, z[i] - w / M[i, i])
        if scaled_residual(M, q, z) <= tol:
            return SOLVED, sweep + 1
    return MAX_ITER, max_iter


SOLVER = CompiledSolver(
    name="pgs",
    summary="projected Gauss-Seidel: a baseline, slow on tall stacks",
    requires=(Requirement.SYMMETRIC, Requirement.PSD, Requirement.POSITIVE_DIAGONAL),
    tol=1e-12,
    max_iter=20_000,
    source="Cryer (1971)",
    kernel=pgs,
)
