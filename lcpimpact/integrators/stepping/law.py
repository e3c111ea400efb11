"""The contact problem of a step: its LCP, an independent check of the solution, and fallback solvers."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple, TypeAlias

import numpy as np

from lcpimpact.arrays import Indices, Matrix, Vector
from lcpimpact.compiled import compiled
from lcpimpact.errors import Status, UnsupportedError
from lcpimpact.lcp import SOLVERS
from lcpimpact.lcp.judge import clear_residual, holds, measure
from lcpimpact.lcp.operators import Delassus
from lcpimpact.lcp.solver import Kernel, SolverState
from lcpimpact.numerics.rounding import EPS

SOLVED = int(Status.SOLVED)
INACCURATE = int(Status.INACCURATE)
NON_FINITE = int(Status.NON_FINITE)

MAX_NEWTON = 60
"""Newton iterations of a step with springs or forces s = F(y), at most."""

NEWTON_TOL = 1e-12
"""Tolerance of s - F(y), relative to the largest force."""

RATE_ROUNDING = 8.0 * EPS
"""Rounding error of y, relative to its summands; times J it bounds the accuracy of F(y)."""


class ContactProblem(NamedTuple):
    """Rows of a law as a complementarity problem: lower <= z <= upper, complementary to w = W z + q.

    Attributes
    ----------
    W : (nc, nc) array              the Delassus matrix
    q, lower, upper : (nc,) arrays  the free motion, and the bounds
    """

    W: Matrix
    q: Vector
    lower: Vector
    upper: Vector


class Solving(NamedTuple):
    """The LCP solver of contact problems: its tolerance, limit of iterations, and kernel."""

    tol: float
    max_iter: int
    solve: Kernel


class SpringRoom(NamedTuple):
    """Arrays that Newton's method for ns springs and up to m rows works in.

    Attributes
    ----------
    vectors : (9, ns) array         free rates and penetrations, y, s_0, F, J, a column, the y at which F and J are, and
                                    the weights by which a step does not throw them, as `features.find_throws` says
    HGs : (m, ns) array
    NG, S : (ns, m) arrays
    NGs, system : (ns, ns) arrays
    """

    vectors: Matrix
    HGs: Matrix
    NG: Matrix
    S: Matrix
    NGs: Matrix
    system: Matrix


def room_for_springs(m: int, ns: int) -> SpringRoom:
    """Return arrays for ns springs and up to m rows."""
    return SpringRoom(np.zeros((9, ns)), np.zeros((m, ns)), *np.zeros((2, ns, m)), *np.zeros((2, ns, ns)))


class Springs(NamedTuple):
    """Non-linear springs in a law, and their coupling with its rows.

    Attributes
    ----------
    law : (ns, 9) array     the row of `lcpimpact.scheme.power_law` of each
    θh, h : float           time in s at which the law evaluates their positions, and over which it averages
    room : SpringRoom       with HGs, the rate of the rows by unit forces of the springs, NG, that of the springs by unit
                            impulses of the rows, and NGs, that of the springs by unit forces of the springs
    """

    law: Matrix
    θh: float
    h: float
    room: SpringRoom


SpringSolver: TypeAlias = Callable[
    [ContactProblem, Springs, Vector, Vector, Vector, Vector, Vector, Solving], tuple[int, int, int, float]
]
"""Type of `newton.solve_with_springs`."""


@compiled()
def examine(
    status: int, W: Matrix, q: Vector, lower: Vector, upper: Vector, z: Vector, tol: float
) -> tuple[int, float]:
    """Check a doubtful solution independently of the solver: status and residual."""
    residual, _, rounding = measure(W, q, lower, upper, z, np.empty(len(z)))
    if status == SOLVED and not holds(residual, rounding, tol):
        return INACCURATE if residual < np.inf else NON_FINITE, residual
    return status, residual


@compiled(inline="always")
def solve_law(rows: ContactProblem, z: Vector, solving: Solving) -> tuple[int, int, float]:
    """Solve a contact problem from the guess z, and check the solution: status, iterations, residual."""
    W = rows.W
    q = rows.q
    lower = rows.lower
    upper = rows.upper
    tol = solving.tol
    max_iter = solving.max_iter
    solve = solving.solve
    status, count = solve(W, q, lower, upper, z, tol, max_iter)
    residual = clear_residual(W, q, lower, upper, z, tol)
    if residual == np.inf:
        status, residual = examine(status, W, q, lower, upper, z, tol)
    return status, count, residual


@compiled()
def submatrix(W: Matrix, rows: Indices) -> Matrix:
    """Return W with only these rows and columns."""
    part = np.empty((len(rows), len(rows)))
    for i in range(len(rows)):
        for j in range(len(rows)):
            part[i, j] = W[rows[i], rows[j]]
    return part


@compiled()
def restrict(rows: ContactProblem, active: Indices) -> ContactProblem:
    """Return the contact problem of the active rows alone."""
    W = rows.W
    q = rows.q
    lower = rows.lower
    upper = rows.upper
    return ContactProblem(submatrix(W, active), q[active], lower[active], upper[active])


@compiled()
def solve_active(rows: ContactProblem, active: Indices, z: Vector, solving: Solving) -> tuple[int, int, float]:
    """Solve the contact problem of the active rows alone, from their guess z: status, iterations, residual."""
    return solve_law(restrict(rows, active), z, solving)


@compiled()
def no_springs(
    rows: ContactProblem, springs: Springs, y_free: Vector, δ: Vector, z: Vector, y: Vector, s: Vector, solving: Solving
) -> tuple[int, int, int, float]:
    """Placeholder for schemes without non-linear springs; never called."""
    return SOLVED, 0, 0, 0.0


def fallback_solvers(solver: SolverState, contacts: Delassus) -> Iterator[SolverState]:
    """Yield the solvers that may solve an LCP which a solver does not, prepared for its matrix."""
    for name in solver.fallbacks:
        try:
            SOLVERS[name].check(contacts)
        except UnsupportedError:
            continue
        yield SOLVERS[name].init(contacts)


def with_fallbacks(
    run: Callable[[SolverState, int, int], tuple[Status, int]],
    solver: SolverState,
    contacts: Delassus,
    first: int,
    last: int,
) -> tuple[Status, int]:
    """Take steps by ``run(solver, first, last)``; a step whose LCP is not solved is repeated with the fallback solvers."""
    status, reached = run(solver, first, last)
    while status is not Status.SOLVED:
        for other in fallback_solvers(solver, contacts):
            again, after = run(other, reached, reached + 1)
            if again is Status.SOLVED:
                break
        else:
            return status, reached
        if after == last:
            return Status.SOLVED, last
        status, reached = run(solver, after, last)
    return status, reached
