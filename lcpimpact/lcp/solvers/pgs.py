"""Projected Gauss-Seidel, as in granular codes and physics engines."""

from __future__ import annotations

import numpy as np

from lcpimpact.arrays import Matrix, Vector
from lcpimpact.compiled import compiled
from lcpimpact.errors import Status
from lcpimpact.lcp.judge import holds, measure
from lcpimpact.lcp.operators import Property
from lcpimpact.lcp.solver import CompiledSolver
from lcpimpact.lcp.storage import entry, row_product
from lcpimpact.lcp.trace import NONE, note

SOLVED, MAX_ITER = int(Status.SOLVED), int(Status.MAX_ITER)


@compiled(most=0)
def pgs(W: Matrix, q: Vector, lower: Vector, upper: Vector, z: Vector, tol: float, max_iter: int) -> tuple[int, int]:
    """Sweep z_i <- P(z_i - (M z + q)_i / M_ii) until the residual is within tol or its rounding error."""
    n = len(q)
    w, basis = np.empty(n), np.empty(n, np.int64)
    for sweep in range(1, max_iter + 1):
        for i in range(n):
            z[i] = min(max(z[i] - (row_product(W, i, z) + q[i]) / entry(W, i, i), lower[i]), upper[i])
            basis[i] = n + i if lower[i] < z[i] < upper[i] else i
        note(z, basis, NONE, NONE)
        scaled, _, rounding = measure(W, q, lower, upper, z, w)
        if holds(scaled, rounding, tol):
            return SOLVED, sweep
    return MAX_ITER, max_iter


SOLVER = CompiledSolver(
    name="pgs",
    summary="projected Gauss-Seidel: a baseline, slow on tall stacks",
    requires=(Property.SYMMETRIC, Property.PSD, Property.POSITIVE_DIAGONAL),
    storages=("dense", "banded", "sparse"),
    boxed=True,
    tol=1e-12,
    max_iter=20_000,
    source="Cryer1971",
    kernel=pgs,
)
