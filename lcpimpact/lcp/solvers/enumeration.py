"""Enumeration of all complementary bases: a reference method for small problems."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from lcpimpact.arguments import checked
from lcpimpact.arrays import Array, Indices, Matrix, Vector
from lcpimpact.compiled import compiled, warning_free
from lcpimpact.errors import FailureError, InputError, Status
from lcpimpact.lcp.basis import basic_solution
from lcpimpact.lcp.judge import holds, measure
from lcpimpact.lcp.operators import as_operator, finite_array
from lcpimpact.lcp.polish import move_to_bounds
from lcpimpact.lcp.problem import FREE, LOWER, UPPER, LCPSolution, bounds
from lcpimpact.lcp.rational import decide
from lcpimpact.lcp.solver import CompiledSolver
from lcpimpact.lcp.storage import weight
from lcpimpact.lcp.trace import NONE, note

SOLVED = int(Status.SOLVED)
INFEASIBLE = int(Status.INFEASIBLE)
UNDECIDED = int(Status.UNDECIDED)
MAX_ITER = int(Status.MAX_ITER)


@compiled()
def nth_basis(number: int, lower: Vector, upper: Vector, side: Indices) -> bool:
    """Set ``side`` to the basis of the given number; return False beyond the last one.

    The number has one digit per row, which selects its lower bound (if finite), free, or its upper bound (if finite).
    """
    for i in range(len(side)):
        below, above = lower[i] > -np.inf, upper[i] < np.inf
        choices = 1 if lower[i] == upper[i] else 1 + int(below) + int(above)
        digit = number % choices + (0 if below else 1)
        number //= choices
        side[i] = LOWER if digit == 0 else FREE if digit == 1 else UPPER
    return number == 0


@compiled()
def try_basis(
    W: Matrix, q: Vector, lower: Vector, upper: Vector, side: Indices, z: Vector, tol: float
) -> tuple[bool, bool]:
    """Set z to the basic solution of ``side``; return whether z solves the problem, and whether this is inconclusive.

    It is inconclusive if the basis is singular, or so nearly singular that rounding exceeds the tolerance.
    """
    regular = basic_solution(W, False, q, lower, upper, side, z)
    scaled, _, rounding = measure(W, q, lower, upper, z, np.empty(len(q)))
    solved = regular and holds(scaled, rounding, tol)
    if regular and not solved and move_to_bounds(W, q, lower, upper, z):
        scaled, _, rounding = measure(W, q, lower, upper, z, np.empty(len(q)))
        solved = holds(scaled, rounding, tol)
    return solved, not solved and (not regular or scaled <= 10.0 * max(tol, rounding))


@compiled(most=0)
def enumeration(
    W: Matrix, q: Vector, lower: Vector, upper: Vector, z: Vector, tol: float, max_iter: int
) -> tuple[int, int]:
    """Return the first basic solution, in the order of the bases, whose residual is within tol.

    If there is none, the problem is infeasible, or undecided if any basis was inconclusive.
    """
    n = len(q)
    side = np.empty(n, np.int64)
    basis = np.empty(n, np.int64)
    trial = np.empty(n)
    any_doubt = False
    for i in range(n):
        z[i] = min(max(0.0, lower[i]), upper[i])
    for number in range(max_iter):
        if not nth_basis(number, lower, upper, side):
            return (UNDECIDED if any_doubt else INFEASIBLE), number
        solved, doubt = try_basis(W, q, lower, upper, side, trial, tol)
        any_doubt = any_doubt or doubt
        for i in range(n):
            basis[i] = n + i if side[i] == FREE else i
        note(trial, basis, NONE, NONE)
        if solved:
            for i in range(n):
                z[i] = min(max(trial[i], lower[i]), upper[i])
            return SOLVED, number + 1
    return MAX_ITER, max_iter


SOLVER = CompiledSolver(
    name="enumeration",
    summary="all 2^n complementary bases (3^n between bounds); the oracle for n <= 15",
    requires=(),
    storages=("dense",),
    boxed=True,
    tol=1e-10,
    max_iter=3**15,
    source="CottlePangStone2009, section 1.3",
    largest=15,
    kernel=enumeration,
)


@checked
@warning_free
def all_solutions(
    M: ArrayLike, q: ArrayLike, *, lower: ArrayLike | None = None, upper: ArrayLike | None = None, tol: float = 1e-10
) -> list[Array]:
    """Return every basic solution of LCP(M, q), each once.

    Parameters
    ----------
    M : (n, n) array_like
        n <= 15.
    q : (n,) array_like
    lower, upper : (n,) array_like, optional
        By default 0 and inf.
    tol : float
        Largest scaled residual of a solution.

    Returns
    -------
    list of (n,) arrays
        If the solutions form a continuum (singular bases), its vertices are included.

    Raises
    ------
    InputError, UnsupportedError
        For data of the wrong shape or kind, or n > 15.
    FailureError
        If no solution is found because bases are nearly singular.

    Examples
    --------
    >>> all_solutions([[0.0, 1.0], [1.0, 0.0]], [-1.0, -1.0])
    [array([1., 1.])]
    >>> len(all_solutions([[1.0, 2.0], [2.0, 1.0]], [-1.0, -1.0]))
    3

    References
    ----------
    Cottle, Pang and Stone, *The Linear Complementarity Problem* (1992), section 1.3.
    """
    operator = as_operator(M)
    right = finite_array("q", q)
    if right.shape != (operator.n,):
        raise InputError(f"q must have shape ({operator.n},) to fit M, and its shape is {right.shape}")
    SOLVER.check(operator)
    low, high, _ = bounds(operator.n, lower, upper)
    found: list[Array] = []
    any_doubt = False
    side, number = np.empty(operator.n, np.int64), 0
    while nth_basis(number, low, high, side):
        z = np.empty(operator.n)
        solved, doubt = try_basis(operator.array(), right, low, high, side, z, tol)
        if solved and not any(_same(operator.array(), right, z, other) for other in found):
            found.append(np.clip(z, low, high))
        any_doubt = any_doubt or doubt
        number += 1
    if not found and any_doubt:
        decision = decide(operator, right, low, high)
        if decision is None or decision.z is not None:
            unknown = np.full(operator.n, np.nan)
            undecided = LCPSolution(unknown, unknown, Status.UNDECIDED, np.inf, number, SOLVER.name, (SOLVER.name,))
            raise FailureError(
                "all_solutions: bases are so nearly singular that rounding hides their solutions", undecided
            )
    return found


def _same(M: Array, q: Array, z: Array, other: Array, *, same_rtol: float = 1e-9) -> bool:
    """Return whether two solutions differ by rounding only: in no z_j, or in z_j whose difference changes no row of w.

    ``same_rtol``: relative difference up to which two solutions are one.
    """
    apart = np.abs(z - other)
    larger = np.maximum(np.abs(z), np.abs(other))
    size = np.abs(q) + np.abs(M) @ larger
    differing = np.flatnonzero(apart > same_rtol * larger)
    return all(0.0 < apart[j] * weight(M, int(j), size) <= same_rtol for j in differing)
