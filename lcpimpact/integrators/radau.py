r"""Radau IIA with the law imposed at every stage and no detection of switches, for contrast with `radau-fesd`.

In first-order form (see `lcpimpact.scheme.first_order`) a step solves

.. math:: X_i = X + h \sum_j a_{ij} (A X_j + B r_j), \qquad 0 \le r_i \perp L_i \ge 0, \qquad X^+ = X_s ,

one LCP for all stages, with L = u where the relative degree is 0 or 1, and L = U where it is 2, on the rows that are closed
at the start of the step. A slider's law stands on U, within its bounds; where a spring alone gives way to it, U_i is the
derivative of the collocation polynomial. Contacts with mass on both sides that touch with U < 0
have an impact at once:

.. math:: 0 \le P \perp U^+ + e U \ge 0, \qquad X \to X + B P .

The step is of order 2 s - 1 only where the mode does not change within it. What a switch costs is of the order of the step,
however many stages there are: that is what `radau-fesd` is for.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from numba import types

from lcpimpact.arrays import Array, Flags
from lcpimpact.compiled import compiled, f8, i8, interpreted, matrix, vector
from lcpimpact.errors import Status
from lcpimpact.hybrid.modes import ZERO, refuse_velocity_jumps
from lcpimpact.integrators.base import Declared, Integrator, Limits
from lcpimpact.integrators.moreau_jean import submatrix
from lcpimpact.integrators.stepping.law import solve_law, with_fallbacks
from lcpimpact.integrators.stepping.linear_step import sum_columns
from lcpimpact.integrators.stepping.radau_iia import RadauIIA, radau_iia
from lcpimpact.lcp import SOLVERS
from lcpimpact.lcp.operators import Dense
from lcpimpact.lcp.problem import KERNEL
from lcpimpact.lcp.solve import limits, solve_lcp
from lcpimpact.lcp.solver import Kernel, State
from lcpimpact.problems.base import Problem
from lcpimpact.record import Grid, Record
from lcpimpact.scheme.dynamics import Dynamics, Feature
from lcpimpact.scheme.first_order import FirstOrderForm, first_order_form

SOLVED, NON_FINITE = int(Status.SOLVED), int(Status.NON_FINITE)


@compiled(types.Tuple((i8, i8, f8))(
    vector, vector, f8, matrix, matrix, matrix, matrix, matrix, vector, types.boolean[::1], vector, vector,
    types.boolean[::1], f8, i8, KERNEL,
))  # fmt: skip
def resolve_impacts(
    x: Array, r: Array, h: float, C: Array, CA: Array, CAA: Array, G: Array, B: Array, e: Array, bounces: Flags,
    scale: Array, P: Array, closed: Flags, tol: float, max_iter: int, solve: Kernel,
) -> tuple[int, int, float]:  # fmt: skip
    """Apply Newton's law of impact to the closed rows of relative degree 2 that approach: status, iterations, residual.

    Changes X to that after the impacts, and sets the impulses P and ``closed``. A rebound that gravity and the forces r of
    the last step would end within this one counts as none: so a body comes to rest.
    """
    nc, N = len(e), len(scale)
    U, touching = np.empty(nc), np.empty(nc, np.int64)
    count, approach = 0, False
    for i in range(nc):
        P[i], closed[i] = 0.0, False
        if not bounces[i]:
            continue
        u, rounding, U[i], slow = 0.0, 0.0, 0.0, 0.0
        for j in range(N):
            u += C[i, j] * x[j]
            U[i] += CA[i, j] * x[j]
            rounding += ZERO * abs(C[i, j]) * scale[j]
            slow += ZERO * abs(CA[i, j]) * scale[j]
        if u <= rounding:
            touching[count] = i
            count += 1
            approach = approach or U[i] < -slow
            closed[i] = U[i] <= slow
    if not approach:
        return SOLVED, 0, 0.0
    rows, W = touching[:count], submatrix(G, touching[:count])
    low, high = np.zeros(count), np.full(count, np.inf)
    q, z, w, rebound = np.empty(count), np.zeros(count), np.empty(count), np.empty(count)
    for a in range(count):
        rebound[a] = e[rows[a]]
    iterations, worst = 0, 0.0
    for _ in range(2):
        for a in range(count):
            q[a] = U[rows[a]] + rebound[a] * min(U[rows[a]], 0.0)
        status, tried, residual = solve_law(W, q, low, high, z, w, True, tol, max_iter, solve)
        iterations += tried
        worst = max(worst, residual)
        if status != SOLVED:
            return status, iterations, worst
        again = False
        for a in range(count):
            i, after, fall = rows[a], U[rows[a]], 0.0
            for c in range(count):
                after += W[a, c] * z[c]
            for j in range(N):
                fall += CAA[i, j] * x[j]
            for c in range(nc):
                fall += G[i, c] * r[c] if c != i else 0.0
            if z[a] > 0.0 and rebound[a] > 0.0 and after + 0.5 * h * fall <= 0.0:
                rebound[a], again = 0.0, True
        if not again:
            break
    for a in range(count):
        i = rows[a]
        P[i] = z[a]
        after, slow = U[i], 0.0
        for c in range(count):
            after += W[a, c] * z[c]
        for j in range(N):
            x[j] += B[j, i] * z[a]
            slow += ZERO * abs(CA[i, j]) * scale[j]
        closed[i] = after <= slow
    return SOLVED, iterations, worst


@compiled(
    types.Tuple((i8, i8, i8, i8, f8))(
        i8, i8, f8, matrix, matrix, matrix, matrix, matrix, matrix, matrix, vector, types.boolean[::1], vector, vector,
        vector, vector, matrix, matrix, matrix, f8, i8, KERNEL,
    )
)  # fmt: skip
def steps(
    first: int,
    last: int,
    h: float,
    L: Array,
    result: Array,
    C: Array,
    CA: Array,
    CAA: Array,
    G: Array,
    B: Array,
    e: Array,
    bounces: Flags,
    r_max: Array,
    scale: Array,
    y: Array,
    guess: Array,
    q: Array,
    v: Array,
    r: Array,
    tol: float,
    max_iter: int,
    solve: Kernel,
) -> tuple[int, int, int, int, float]:
    """Take the steps first ... last: fill q[k + 1], v[k + 1] and r[k], and leave the state in y.

    What a step starts from and solves for stands in one vector x: the state X and the last r, together y, then r of each
    stage. ``L`` holds the columns of the laws' rows, ``result`` those of the new y, q and v. Returns the status, the step
    reached, the LCPs solved, the sum of their iterations, and the largest residual, found outside the solver.
    """
    N, nc, n = len(scale), len(e), q.shape[1]
    known, rows = N + nc, L.shape[1]
    x, new = np.zeros(known + rows), np.empty(result.shape[1])
    b, z, gap, active = np.empty(rows), np.empty(rows), np.empty(rows), np.empty(rows, np.int64)
    lower, upper, P, closed = np.empty(rows), np.empty(rows), np.zeros(nc), np.zeros(nc, np.bool_)
    plain = True
    for i in range(nc):
        plain = plain and r_max[i] == np.inf
    solves, iterations, worst = 0, 0, 0.0
    for k in range(first, last):
        x[:known] = y
        x[known:] = 0.0
        status, count, residual = resolve_impacts(
            x, y[N:], h, C, CA, CAA, G, B, e, bounces, scale, P, closed, tol, max_iter, solve
        )  # fmt: skip
        iterations += count
        solves += count > 0
        if status != SOLVED:
            return status, k, solves, iterations, worst
        worst = max(worst, residual)
        sum_columns(L, x, b)
        na = 0
        for i in range(rows):
            c = i % nc
            if closed[c] or not bounces[c]:
                active[na], b[na], z[na] = i, b[i], guess[i]
                lower[na], upper[na] = (-r_max[c] if r_max[c] < np.inf else 0.0), r_max[c]
                na += 1
        guess[:] = 0.0
        if na > 0:
            W = np.empty((na, na))
            for a in range(na):
                for c in range(na):
                    W[a, c] = L[known + active[c], active[a]]
            status, count, residual = solve_law(
                W, b[:na], lower[:na], upper[:na], z[:na], gap[:na], plain, tol, max_iter, solve
            )
            iterations += count
            solves += 1
            if status != SOLVED:
                return status, k, solves, iterations, worst
            worst = max(worst, residual)
            for a in range(na):
                x[known + active[a]] = guess[active[a]] = z[a]
        sum_columns(result, x, new)
        for i in range(len(new)):
            if not abs(new[i]) < np.inf:
                return NON_FINITE, k, solves, iterations, worst
        y[:] = new[:known]
        for j in range(N):
            scale[j] = max(scale[j], abs(y[j]))
        q[k + 1], v[k + 1] = new[known : known + n], new[known + n :]
        for i in range(nc):
            r[k, i] = y[N + i] + P[i] / h
    return SOLVED, last, solves, iterations, worst


@dataclass(frozen=True, eq=False)
class Run:
    """What travels from block to block: the tabulated step, and the state that it stands at."""

    grid: Grid
    form: FirstOrderForm
    breakpoints: Array
    tables: tuple[Array, ...]
    scale: Array
    y: Array
    guess: Array
    contacts: Dense
    solver: State
    tol: float
    max_iter: int


@dataclass(frozen=True)
class Radau(Integrator):
    """Radau IIA without detection of switches.

    Parameters
    ----------
    stages : int
        s, from 1 to 5; the order in smooth motion is 2 s - 1.
    tol : float, optional
        Largest LCP residual, in units where max |W| = max |q| = 1; by default what the LCP solver declares.
    max_iter : int, optional
        Limit of LCP iterations in a step; by default what the LCP solver declares.

    Raises
    ------
    InputError
        If stages is not 1 to 5, or tol or max_iter is not positive.

    Notes
    -----
    Handles constant loads and signals; a breakpoint inside a step is felt from its end on, at order 1. The declared orders
    are those of three stages. The reaction is that of the last stage, at the end of the step. The step that begins with an
    impact holds its impulse, which stands in the event and not among the reactions. A rebound that would end within a step
    counts as none.
    """

    stages: int = 3
    tol: float | None = None
    max_iter: int | None = None

    reaction_is_mean: ClassVar[bool] = False
    name: ClassVar[str] = "radau"
    family: ClassVar[str] = "Radau IIA"
    declared: ClassVar[Declared] = Declared(
        summary="Radau IIA with one LCP for all stages, switches not located",
        order_smooth=5,
        order_force_jump=2,
        order_force_kink=2,
        order_impact=1,
        order_friction=1,
        order_penetration=1,
        level="velocity where r impacts, else position",
        relative_degrees=(0, 1, 2),
        handles=(Feature.SLIDERS, Feature.MOTIONS, Feature.SYSTEMS, Feature.MASSLESS, Feature.RESTITUTION),
        reaction_lives="at t + h, one for each step",
        energy="never gains in smooth motion and impacts; loses at order 2 s - 1",
        precision=1e-7,
        slack=3.0,
        kick=0.75,
        dissipates=True,
        source="Hairer and Wanner (1996), section IV.5; contacts as Acary and Brogliato (2008), chapter 10",
    )

    def __post_init__(self) -> None:
        radau_iia(self.stages)
        limits(SOLVERS["auto"], self.tol, self.max_iter)

    def limits(self) -> Limits:
        """Return those of its stages."""
        return replace(super().limits(), order=2.0 * self.stages - 1.0)

    def reaction_times(self, grid: Grid) -> Array:
        """Return t_k + h, one for each step."""
        return grid.times(1, grid.steps)

    def start(self, problem: Problem, grid: Grid, lcp_solver: str, record: Record) -> Run:
        """Write the initial state, and tabulate the step."""
        d, radau = problem.dynamics, radau_iia(self.stages)
        refuse_velocity_jumps(d, grid.t_end, self.name)
        form = first_order_form(d)
        record.q[0], record.v[0] = problem.initial_coordinates, problem.initial_velocities
        X = form.state(record.q[0], record.v[0])
        y = np.concatenate([X, _first_forces(d, form, X, d.gap(record.q[0]), lcp_solver)])
        L, result = _tabulate(radau, d, form, grid.h)

        A, B, C = form.A, form.B, form.C
        # What is rounding is so beside what a step moves, too, as a body may begin at rest.
        scale, moves = np.abs(X), np.eye(len(A)) + grid.h * np.abs(A)
        scale[form.constant :] = form.signal_sizes
        scale = moves @ moves @ scale
        solver, G = SOLVERS[lcp_solver], C @ A @ B
        bounces = (d.relative_degree == 2) & ~d.slides
        contacts = Dense(np.eye(1))
        if len(d.contacts):
            always = np.tile(~bounces, len(radau.c))
            W = L[:, len(y) :]
            # The LCP of a step has the rows that always stand in it, and those that touch.
            contacts = Dense(W[np.ix_(always, always)].copy() if always.any() else G.copy())
            for each in (contacts, Dense(W.copy())):
                solver.check(each, bool(d.slides.any()))
        tol, max_iter = limits(solver, self.tol, self.max_iter)
        tables = (L.T, result.T, C, C @ A, C @ A @ A, G, B, d.restitution, bounces, d.r_max)
        return Run(
            grid,
            form,
            form.breakpoints(0.0, grid.t_end),
            tuple(np.array(each, order="C") for each in tables),
            scale,
            y,
            np.zeros(len(L)),
            contacts,
            solver.init(contacts),
            tol,
            max_iter,
        )

    def advance(self, carry: Run, record: Record, first: int, last: int) -> tuple[Status, int]:
        """Take the steps of the block; after those that hold breakpoints of the signals, these are read anew."""

        def run(solver: State, first: int, last: int) -> tuple[Status, int]:
            return self._run(carry, solver, record, first, last)

        t = record.t[first : last + 1]
        inside = carry.breakpoints[(carry.breakpoints > t[0]) & (carry.breakpoints <= t[-1])]
        for end in first + np.unique(np.searchsorted(t, inside)):
            status, reached = with_fallbacks(run, carry.solver, carry.contacts, first, int(end))
            if status is not Status.SOLVED:
                return status, reached
            first = reached
            _read_signals(carry, record, first)
        return with_fallbacks(run, carry.solver, carry.contacts, first, last) if first < last else (Status.SOLVED, last)

    def _run(self, carry: Run, solver: State, record: Record, first: int, last: int) -> tuple[Status, int]:
        """Take steps in compiled code, or in the interpreter where the solver lives there."""
        run: Callable[..., tuple[int, int, int, int, float]] = steps
        if not solver.compiled:
            run = interpreted(steps, solve_law=interpreted(solve_law))
        code, reached, solves, iterations, residual = run(
            first, last, carry.grid.h, *carry.tables, carry.scale, carry.y, carry.guess,
            record.q, record.v, record.reaction, carry.tol, carry.max_iter, solver.kernel,
        )  # fmt: skip
        record.stats.add_lcps(solves, iterations, residual)
        return Status(code), reached


def _read_signals(run: Run, record: Record, k: int) -> None:
    """Put the signals at t_k in the place of those that the last step has carried on."""
    form, N = run.form, len(run.form.A)
    X = run.y[:N]
    moved = form.right_of(float(record.t[k]), X, run.scale).hi - X
    record.q[k] += form.Q @ moved
    record.v[k] += form.Q @ (form.A @ moved)
    X += moved


def _first_forces(d: Dynamics, form: FirstOrderForm, X: Array, u: Array, lcp_solver: str) -> Array:
    """Return r at t = 0 of the rows to which a spring alone gives way; a slider of them begins where the coordinates are."""
    r, rows = np.zeros(len(d.contacts)), np.flatnonzero(d.relative_degree == 0)
    if len(rows):
        place = np.where(d.slides, u, 0.0)[rows]
        D, q = form.D[np.ix_(rows, rows)], (form.C @ X)[rows] - place
        r[rows] = solve_lcp(D, q, lcp_solver, lower=d.r_min[rows], upper=d.r_max[rows]).z
    return r


def _tabulate(radau: RadauIIA, d: Dynamics, form: FirstOrderForm, h: float) -> tuple[Array, Array]:
    """Return the rows of the laws and of the results, over what a step starts from (X, the last r) and r of its stages."""
    A, B, C, D = form.A, form.B, form.C, form.D
    s, N, nc = len(radau.c), len(A), len(d.contacts)
    columns = np.eye(N + nc + s * nc)
    X, r_last, r = columns[:N], columns[N : N + nc], columns[N + nc :].reshape(s, nc, len(columns))

    # X_i - X = h Σ a_ij (A (X_j - X) + A X + B r_j).
    rates = (A @ X + B @ r).reshape(s * N, len(columns))
    weights = h * np.kron(radau.a, np.eye(N))
    moved = np.linalg.solve(np.eye(s * N) - weights @ np.kron(np.eye(s), A), weights @ rates).reshape(
        s, N, len(columns)
    )
    stages = X + moved

    u = C @ stages + D @ r
    U = C @ (A @ stages + B @ r)
    slid = np.einsum("ij,jcm->icm", radau.inverse / h, u - (C @ X + D @ r_last))
    degree = d.relative_degree[:, None]
    L = np.where(degree == 2, U, np.where(d.slides[:, None], np.where(degree == 0, slid, U), u / h))

    # The places of static nodes hold r, so their velocities hold its rate.
    r_rate = np.einsum("j,jcm->cm", radau.inverse[-1] / h, r - r_last)
    q = form.Q @ stages[-1] + form.Qr @ r[-1]
    v = form.Q @ (A @ stages[-1] + B @ r[-1]) + form.Qr @ r_rate
    return L.reshape(s * nc, len(columns)), np.vstack([stages[-1], r[-1], q, v])
