"""One LCP by one call."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from lcpimpact.arrays import Array
from lcpimpact.errors import FailureError, InputError, Status
from lcpimpact.lcp import SOLVERS
from lcpimpact.lcp.problem import LCP, LCPSolution, natural_residual, real_array, scaled_residual
from lcpimpact.lcp.solver import Delassus, LCPSolver
from lcpimpact.numbers import is_count, is_real


def solve_lcp(
    M: ArrayLike,
    q: ArrayLike,
    solver: str = "auto",
    *,
    tol: float | None = None,
    max_iter: int | None = None,
    z0: ArrayLike | None = None,
    throw: bool = True,
) -> LCPSolution:
    r"""Solve w = M z + q, 0 <= z ⟂ w >= 0.

    Parameters
    ----------
    M : (n, n) array_like
        Any square matrix; a solver refuses one that it is not made for.
    q : (n,) array_like
        Right side.
    solver : str
        A name of ``lcpimpact list solvers``.
    tol : float, optional
        Largest residual, in units where max |M| = max |q| = 1, of an answer that counts as solved; by default what
        the solver declares.
    max_iter : int, optional
        Limit of pivots, sweeps or backend iterations; by default what the solver declares.
    z0 : (n,) array_like, optional
        A guess, for the iterative solvers.
    throw : bool
        Raise when the status is not SOLVED, instead of returning the failed solution.

    Returns
    -------
    LCPSolution
        With z, w, status, success, residual, iterations and solver; the residual is computed outside the solver.

    Raises
    ------
    InputError
        For data of the wrong shape or kind, or an unknown solver.
    UnsupportedError
        If M lacks a property that the solver declares it needs.
    FailureError
        If no solution was reached and ``throw`` is set.

    Examples
    --------
    >>> solve_lcp([[2.0, 1.0], [1.0, 2.0]], [-5.0, -6.0]).z
    array([1.33333333, 2.33333333])

    References
    ----------
    Cottle, Pang and Stone, *The Linear Complementarity Problem* (1992).
    """
    problem = LCP.checked(M, q)
    chosen = SOLVERS[solver]
    chosen.check(problem.M)
    z = _guess(z0, len(problem.q))
    tol, max_iter = limits(chosen, tol, max_iter)

    kernel = chosen.prepare(Delassus(problem.M))
    code, iterations = kernel(problem.M, problem.q, z, tol, max_iter)
    status = judge(Status(code), scaled_residual(problem.M, problem.q, z), tol)
    solution = LCPSolution(
        z, problem.M @ z + problem.q, status, natural_residual(problem.M, problem.q, z), iterations, chosen.name
    )
    if throw and not solution.success:
        raise FailureError(f"{chosen.name}: {status.sentence} (residual {solution.residual:.1e})", solution)
    return solution


def judge(status: Status, residual: float, tol: float) -> Status:
    """Return the status that stands: an answer is solved only if its residual, computed outside the solver, says so."""
    if not np.isfinite(residual):
        return Status.NON_FINITE
    if status is Status.SOLVED and not residual <= tol:
        return Status.INACCURATE
    return status


def limits(solver: LCPSolver, tol: float | None, max_iter: int | None) -> tuple[float, int]:
    """Return tol and max_iter as given, or as the solver declares them where they are None.

    Raises
    ------
    InputError
        If tol is no positive number, or max_iter no whole number above zero.
    """
    if tol is not None and not (is_real(tol) and tol > 0.0):
        raise InputError(f"tol = {tol!r} must be a positive finite number")
    if max_iter is not None and not is_count(max_iter):
        raise InputError(f"max_iter = {max_iter!r} must be a whole number above zero")
    return (solver.tol if tol is None else float(tol)), (solver.max_iter if max_iter is None else int(max_iter))


def _guess(z0: ArrayLike | None, n: int) -> Array:
    if z0 is None:
        return np.zeros(n)
    z = real_array("z0", z0)
    if z.shape != (n,) or not np.isfinite(z).all():
        raise InputError(f"z0 must be {n} finite numbers, and it is {z0!r}")
    return np.maximum(z, 0.0)
