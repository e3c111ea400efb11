"""Solution of one LCP, or of many right-hand sides with one matrix."""

from __future__ import annotations

from collections.abc import Iterable
from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from lcpimpact.arguments import checked
from lcpimpact.arrays import Array
from lcpimpact.compiled import warning_free
from lcpimpact.errors import FailureError, InputError, Status, UnsupportedError
from lcpimpact.lcp import SOLVERS, judge, rational
from lcpimpact.lcp.farkas import infeasibility
from lcpimpact.lcp.operators import Delassus, Dense, Factored, as_operator, finite_array, real_array
from lcpimpact.lcp.problem import LCP, LCPSolution, bounds, is_plain
from lcpimpact.lcp.solver import LCPSolver, SolverState, for_storage
from lcpimpact.lcp.trace import Trace, traced
from lcpimpact.numbers import count, positive

STATUS = {int(each): each for each in Status}

SOLVED = Status.SOLVED
PROVEN = Status.SOLVED, Status.RAY, Status.INFEASIBLE
"""Conclusive statuses, after which no fallback is tried."""


class PreparedLCP(NamedTuple):
    """A solver prepared for one matrix and one pair of bounds; `solve` may be called for many q.

    Solves are independent of each other; pass z0 for a warm start.

    Attributes
    ----------
    solver : LCPSolver
    operator : Delassus
    lower, upper : (n,) arrays
    state : SolverState               returned by the solver's init
    """

    solver: LCPSolver
    operator: Delassus
    lower: Array
    upper: Array
    state: SolverState

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the arguments: compiled code cannot be pickled, so the solver is prepared again in the other process."""
        registered = SOLVERS.get(self.solver.name) == self.solver
        return _prepare, (self.operator, self.solver.name if registered else self.solver, self.lower, self.upper)

    @warning_free
    def solve(
        self,
        q: ArrayLike,
        *,
        z0: ArrayLike | None = None,
        tol: float | None = None,
        max_iter: int | None = None,
        throw: bool = True,
        trace: bool = False,
    ) -> LCPSolution:
        """Solve for one q; parameters, returns and errors as in `solve_lcp`."""
        n = self.operator.n
        solver = self.solver
        state = self.state
        right = finite_array("q", q, copy=False)
        if right.shape != (n,):
            raise InputError(f"q must have shape ({n},) to fit M, and its shape is {right.shape}")
        within, most = limits(solver, tol, max_iter)
        guess = None if z0 is None else _guess(z0, n)

        if state.fallbacks and max_iter is None:
            most = SOLVERS[state.name].max_iter
        solution = self._attempt(state, right, guess, within, most)
        for name in state.fallbacks:
            if solution.status in PROVEN:
                break
            solution = self._fall_back(name, solution, right, guess, within, max_iter)
        if state.fallbacks and solution.status not in PROVEN:
            solution = self._decide(solution, right, within)
        if trace:
            solution = solution._replace(trace=self._trace(solution, right, guess, within, most))
        if throw and solution.status is not SOLVED:
            raise FailureError(f"{solver.name}: {solution.message} (residual {solution.residual:.1e})", solution)
        return solution

    def _attempt(self, state: SolverState, q: Array, guess: Array | None, tol: float, max_iter: int) -> LCPSolution:
        """Run one method and judge its solution."""
        W = state.W
        lower = self.lower
        upper = self.upper
        z = np.zeros(len(q)) if guess is None else guess.copy()
        w = np.empty(len(q))
        try:
            code, iterations = state.kernel(W, q, lower, upper, z, tol, max_iter)
        except MemoryError:
            raise too_large(len(q)) from None
        status, ray = STATUS[code], None
        measure = for_storage(judge.measure, W)
        if status in (Status.RAY, Status.INFEASIBLE):
            status, ray = self._disproved(q, z if status is Status.RAY else None, tol)
            z = np.minimum(np.maximum(0.0, lower), upper)
        scaled, natural, rounding = measure(W, q, lower, upper, z, w)
        if status is not SOLVED or not (scaled <= tol and rounding <= tol):
            status = verdict(status, scaled, rounding, tol)
            if status is Status.INACCURATE and self._in_doubt(rounding, tol):
                w, scaled, natural = self._without_rounding(q, z)
                status = verdict(SOLVED, scaled, 0.0, tol)
            if status is not SOLVED:
                # An unfinished iterate may lie anywhere; the returned z is projected onto the bounds.
                z = np.minimum(np.maximum(np.where(np.isfinite(z), z, 0.0), lower), upper)
                _, natural, _ = measure(W, q, lower, upper, z, w)
        problem = LCP(self.operator, q, lower, upper)
        return LCPSolution(z, w, status, natural, iterations, self.solver.name, (state.name,), ray, None, problem)

    def _fall_back(
        self, name: str, before: LCPSolution, q: Array, guess: Array | None, tol: float, max_iter: int | None
    ) -> LCPSolution:
        """Run another method after a failure; skip it if it does not accept the problem."""
        method = SOLVERS[name]
        operator = self.state.chosen or self.operator
        try:
            method.check(operator, boxed=not is_plain(self.lower, self.upper))
            state = method.init(operator)
        except UnsupportedError:
            return before
        after = self._attempt(state, q, guess, tol, limits(method, None, max_iter)[1])
        # A failing method does not replace an earlier solution with a smaller residual.
        fails = after.status not in PROVEN and not after.residual < before.residual
        better = before if fails else after
        return better._replace(iterations=before.iterations + after.iterations, route=(*before.route, name))

    def _disproved(self, q: Array, ray: Array | None, tol: float) -> tuple[Status, Array | None]:
        """Return RAY or INFEASIBLE if rational arithmetic proves that there is no solution, else UNDECIDED.

        That the floats have none is no proof if data within their rounding error have one that meets the tolerance, as where
        q = -M z was rounded for a degenerate z.
        """
        problem = self.operator, q, self.lower, self.upper
        found = None if ray is None else rational.proof(*problem, ray)
        if found is not None:
            return Status.RAY, found
        decision = rational.decide(*problem)
        if decision is None or decision.z is not None or self._of_rounded_data(q, tol) is not None:
            return Status.UNDECIDED, None
        return self._without_solution(q, decision)

    def _without_solution(self, q: Array, decision: rational.Decision) -> tuple[Status, Array | None]:
        """Return RAY, with its proof in floats, or INFEASIBLE, from a decision that there is no solution."""
        if decision.ray is not None:
            found = rational.nearest_floats(decision.ray)
            if rational.proves_infeasible(self.operator, q, self.lower, self.upper, found):
                return Status.RAY, found
        return Status.INFEASIBLE, None

    def _in_doubt(self, rounding: float, tol: float, *, max_exact_order: int = 200) -> bool:
        """Return whether rounding error makes the check inconclusive and rational arithmetic can decide.

        ``max_exact_order``: maximum order at which an inconclusive solution is checked in rational arithmetic.
        """
        small = self.operator.n <= max_exact_order and not isinstance(self.operator, Factored)
        return small and not rounding <= max(tol, judge.PROOF_RTOL)

    def _without_rounding(self, q: Array, z: Array) -> tuple[Array, float, float]:
        """Return w computed in rational arithmetic, and its scaled and natural residuals."""
        M = self.operator.array()
        lower = self.lower
        upper = self.upper
        w = rational.image(self.operator, q, z)
        natural = np.abs(np.maximum(np.minimum(w, z - lower), z - upper)).max() / max(1.0, np.abs(q).max())
        return w, judge.row_defect(M, q, lower, upper, z, w, 0.0)[0], float(natural)

    def _decide(self, solution: LCPSolution, q: Array, tol: float) -> LCPSolution:
        """Decide a problem left undecided by every method: small ones in rational arithmetic, others by a linear program."""
        problem = self.operator, q, self.lower, self.upper
        decision = rational.decide(*problem)
        if decision is None:
            return self._prove(solution, q)
        route = (*solution.route, "rational arithmetic")
        found = self._of_rounded_data(q, tol) if decision.z is None else self._in_floats(q, decision.z)
        if found is None:
            status, ray = self._without_solution(q, decision)
            return solution._replace(status=status, ray=ray, route=route)
        z, w, scaled, natural = found
        return solution._replace(
            z=z, w=w, status=verdict(SOLVED, scaled, 0.0, tol), residual=natural, route=route, ray=None
        )

    def _in_floats(self, q: Array, exact: list[Fraction]) -> tuple[Array, Array, float, float]:
        """Return z and w in floats, and their scaled and natural residuals."""
        z = np.minimum(np.maximum(rational.floats(exact), self.lower), self.upper)
        return z, *self._without_rounding(q, z)

    def _of_rounded_data(self, q: Array, tol: float) -> tuple[Array, Array, float, float] | None:
        """Return z, w and residuals of a solution of data within rounding error, if it meets the tolerance, or None.

        The natural residual is compared with the least of q: a z so large that its rounding hides an entry is no solution.
        """
        decision = rational.decide(self.operator, q, self.lower, self.upper, rounded=True)
        if decision is None or decision.z is None:
            return None
        found = self._in_floats(q, decision.z)
        least = np.abs(q[q != 0.0]).min(initial=1.0) / max(1.0, np.abs(q).max())
        return found if found[3] <= tol * least else None

    def _prove(self, solution: LCPSolution, q: Array, *, max_program_order: int = 1_000) -> LCPSolution:
        """Search for a certificate of infeasibility by a linear program.

        ``max_program_order``: maximum order at which a linear program searches for a certificate of
        infeasibility.
        """
        if self.operator.n > max_program_order:
            return solution
        found = infeasibility(self.operator.array(), q, self.lower, self.upper)
        ray = None if found is None else rational.proof(self.operator, q, self.lower, self.upper, found)
        if ray is None:
            return solution
        return solution._replace(status=Status.RAY, ray=ray, route=(*solution.route, "linear program"))

    def _trace(self, solution: LCPSolution, q: Array, guess: Array | None, tol: float, max_iter: int) -> Trace:
        """Return the trace of the method that gave the solution, rerun in the interpreter."""
        M = Dense(self.operator.array())
        named = [name for name in solution.route if name in SOLVERS]
        method = SOLVERS[named[-1]] if named else self.solver
        kernel, notes = traced(method.init(M).kernel, M.M, q, method.name)
        start = np.zeros(len(q)) if guess is None else guess.copy()
        with np.errstate(all="ignore"):
            kernel(M.M, q, self.lower, self.upper, start, tol, max_iter)
        return notes().ending(solution.z)


@checked
@warning_free
def prepare_lcp(
    M: Any,
    solver: str | LCPSolver = "auto",
    *,
    lower: ArrayLike | None = None,
    upper: ArrayLike | None = None,
    tags: Iterable[str] = (),
) -> PreparedLCP:
    """Prepare a solver for one matrix: all work that depends only on M is done once.

    Parameters
    ----------
    M, solver, lower, upper, tags
        As for `solve_lcp`.

    Returns
    -------
    PreparedLCP
        Call its `solve` for each q.

    Raises
    ------
    InputError, UnsupportedError
        As for `solve_lcp`.

    Examples
    --------
    >>> stack = prepare_lcp([[2.0, -1.0], [-1.0, 1.0]])
    >>> first = stack.solve([-1.0, 0.0])
    >>> first.z, stack.solve([-1.0, 0.1], z0=first.z).z
    (array([1., 1.]), array([0.9, 0.8]))
    """
    try:
        return _prepare(as_operator(M, tags), solver, lower, upper)
    except MemoryError:
        raise too_large(len(M)) from None


def too_large(n: int) -> InputError:
    """Return the error of an LCP of order n whose matrix, or the copies of it that a solver makes, exceed the memory."""
    return InputError(
        f"an LCP of order {n:,} does not fit in memory: its dense matrix takes {8e-9 * n**2:.3g} GB, and solvers copy "
        "it; give M sparse, Banded or Factored, which need less"
    )


def _prepare(
    operator: Delassus, solver: str | LCPSolver, lower: ArrayLike | None, upper: ArrayLike | None
) -> PreparedLCP:
    chosen = SOLVERS[solver] if isinstance(solver, str) or not isinstance(solver, LCPSolver) else solver
    low, high, boxed = bounds(operator.n, lower, upper)
    chosen.check(operator, boxed)
    return PreparedLCP(chosen, operator, low, high, chosen.init(operator))


@checked
@warning_free
def solve_lcp(
    M: Any,
    q: ArrayLike,
    solver: str | LCPSolver = "auto",
    *,
    lower: ArrayLike | None = None,
    upper: ArrayLike | None = None,
    tags: Iterable[str] = (),
    tol: float | None = None,
    max_iter: int | None = None,
    z0: ArrayLike | None = None,
    throw: bool = True,
    trace: bool = False,
) -> LCPSolution:
    r"""Solve w = M z + q with lower <= z <= upper, w >= 0 where z < upper, w <= 0 where z > lower.

    With the default lower = 0 and upper = inf this is the LCP 0 <= z ⟂ w >= 0. A row with lower = -inf and
    upper = inf is free: w = 0.

    Parameters
    ----------
    M : (n, n) array_like, sparse matrix, `Dense`, `Banded`, `Sparse` or `Factored`
        Any square matrix; a solver rejects a matrix without the properties that it requires. A sparse matrix of SciPy is
        taken as `Banded` if symmetric and of few bands, as `Dense` if small or full, else as `Sparse`.
    q : (n,) array_like
        Right-hand side.
    solver : str or LCPSolver
        A name of ``lcpimpact list solvers``, or a user-defined solver.
    lower, upper : float or (n,) array_like, optional
        Bounds of z.
    tags : iterable of str
        Known properties of M, which are then not tested: "symmetric", "psd", "p", "positive_diagonal".
    tol : float, optional
        Tolerance on the residual, scaled so that max |M| = max |q| = 1; by default the solver's. If the rounding
        error of M z + q is larger, it is the tolerance.
    max_iter : int, optional
        Maximum number of pivots, sweeps or backend iterations; by default the solver's.
    z0 : (n,) array_like, optional
        Warm start: the initial iterate, or the initial set of free rows.
    throw : bool
        Raise when the status is not SOLVED, instead of returning the failed solution.
    trace : bool
        Rerun the method that gave the solution in the interpreter, and keep its pivots or iterates.

    Returns
    -------
    LCPSolution
        With z, w, status, success, residual (computed outside the solver), iterations, solver, route and explanation.

    Raises
    ------
    InputError
        For data of the wrong shape or kind, or an unknown solver.
    UnsupportedError
        If the problem lacks a property that the solver requires.
    FailureError
        If no solution was reached and ``throw`` is set.

    Examples
    --------
    >>> solve_lcp([[2.0, 1.0], [1.0, 2.0]], [-5.0, -6.0]).z
    array([1.33333333, 2.33333333])
    >>> solve_lcp([[2.0]], [-5.0], lower=-1.0, upper=1.0).w
    array([-3.])

    References
    ----------
    Cottle, Pang and Stone, *The Linear Complementarity Problem* (1992).
    """
    try:
        prepared = _prepare(as_operator(M, tags, copy=False), solver, lower, upper)
        return prepared.solve(q, z0=z0, tol=tol, max_iter=max_iter, throw=throw, trace=trace)
    except MemoryError:
        raise too_large(np.size(q)) from None


def verdict(status: Status, scaled: float, rounding: float, tol: float) -> Status:
    """Return the final status: SOLVED only if the residual, computed outside the solver, is within tolerance."""
    if not scaled < np.inf:
        return Status.NON_FINITE
    if status is SOLVED and not judge.holds(scaled, rounding, tol):
        return Status.INACCURATE
    return status


def limits(solver: LCPSolver, tol: float | None, max_iter: int | None) -> tuple[float, int]:
    """Return tol and max_iter, replaced by the solver's defaults where they are None.

    Raises
    ------
    InputError
        If tol is not a positive number, or max_iter not a positive integer.
    """
    if tol is not None:
        positive("tol", tol)
    if max_iter is not None:
        count("max_iter", max_iter)
    return (solver.tol if tol is None else float(tol)), (solver.max_iter if max_iter is None else int(max_iter))


def _guess(z0: ArrayLike, n: int) -> Array:
    z = real_array("z0", z0)
    if z.shape != (n,) or not np.isfinite(z).all():
        raise InputError(f"z0 must be {n} finite numbers, and it is {z0!r}")
    return z
