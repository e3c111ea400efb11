"""The choice of a solver when none is named: closed form for one or two rows, Lemke for more."""

from __future__ import annotations

from dataclasses import dataclass

from numba import types

from lcpimpact.arrays import Array
from lcpimpact.compiled import compiled, f8, i8, interpreted, matrix, vector
from lcpimpact.errors import Status
from lcpimpact.lcp.closed_form import closed_form
from lcpimpact.lcp.lemke import lemke
from lcpimpact.lcp.problem import scaled_residual
from lcpimpact.lcp.solver import Delassus, Kernel, LCPSolver

SOLVED = int(Status.SOLVED)


@compiled(types.UniTuple(i8, 2)(matrix, vector, vector, f8, i8))
def closed_form_or_lemke(M: Array, q: Array, z: Array, tol: float, max_iter: int) -> tuple[int, int]:
    """Solve by closed form where it applies and its answer stands the check, else by Lemke's method."""
    if len(q) <= 2:
        status, iterations = closed_form(M, q, z, tol, max_iter)
        if status == SOLVED and scaled_residual(M, q, z) <= tol:
            return status, iterations
    return lemke(M, q, z, tol, max_iter)


@dataclass(frozen=True)
class Auto(LCPSolver):
    """The choice by the matrix."""

    @property
    def is_compiled(self) -> bool:
        """Whether compilation is on."""
        return interpreted(closed_form) is not closed_form

    def prepare(self, delassus: Delassus) -> Kernel:
        """Return the closed form alone for one row of positive W, which it always solves."""
        one_row = delassus.W.shape == (1, 1) and delassus.W[0, 0] > 0.0
        return closed_form if one_row else closed_form_or_lemke


SOLVER = Auto(
    name="auto",
    summary="closed-form for one or two rows, else lemke",
    requires=(),
    tol=1e-10,
    max_iter=10_000,
    source="-",
)
