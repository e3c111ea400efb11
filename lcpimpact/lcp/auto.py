"""The choice of a solver when none is named: closed form for one or two rows, Lemke for more."""

from __future__ import annotations

from numba import types

from lcpimpact.compiled import compiled, f8, i8, matrix, vector
from lcpimpact.errors import Status
from lcpimpact.lcp.closed_form import closed_form
from lcpimpact.lcp.lemke import lemke
from lcpimpact.lcp.problem import scaled_residual
from lcpimpact.lcp.solver import CompiledSolver

SOLVED = int(Status.SOLVED)


@compiled(types.UniTuple(i8, 2)(matrix, vector, vector, f8, i8))
def auto(M, q, z, tol, max_iter):  # type: ignore[no-untyped-def]
    """Solve by closed form where it applies and its answer stands the check, else by Lemke's method."""
    if len(q) <= 2:
        status, iterations = closed_form(M, q, z, tol, max_iter)
        if status == SOLVED and scaled_residual(M, q, z) <= tol:
            return status, iterations
    return lemke(M, q, z, tol, max_iter)


SOLVER = CompiledSolver(
    name="auto",
    summary="closed-form for one or two rows, else lemke",
    requires=(),
    tol=1e-10,
    max_iter=10_000,
    source="-",
    kernel=auto,
)
