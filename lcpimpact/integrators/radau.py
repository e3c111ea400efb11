r"""Radau IIA with the contact law imposed at every stage and no detection of switches, for contrast with `radau-fesd`.

In first-order form (see `lcpimpact.scheme.first_order`) a step solves

.. math:: X_i = X + h \sum_j a_{ij} (A X_j + B r_j), \qquad 0 \le r_i \perp L_i \ge 0, \qquad X^+ = X_s ,

one LCP for all stages, with L = u for relative degree 0 or 1, and L = U for 2, on the contacts that are closed at the start
of the step. A slider's law is imposed on U; at relative degree 0, U_i is the derivative of the collocation polynomial.
Closed contacts of relative degree 2 with U < 0 undergo an impact first:

.. math:: 0 \le P \perp U^+ + e U \ge 0, \qquad X \to X + B P .

Friction obeys its law in both, |r| <= μ r_N at each stage and |P| <= μ P_N, a joint has U = 0, and a relay the law of u.

The order is 2 s - 1 only in steps without a change of mode. The error of a switch is of order 1 for any number of stages,
which is why `radau-fesd` locates switches.

A contact on a dashpot that stops a body within a step (see `lcpimpact.integrators.stepping.strong_dashpots`) may push at
some stages alone, between which the body would be thrown back, since the decay of its velocity oscillates from stage
to stage.
Such a step has one stage, with X⁺ = X + h (A (θ X⁺ + (1 - θ) X) + B r), the law at its end, and θ as there, so that the
velocity decays as it should.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import ClassVar, NamedTuple

import numpy as np

from lcpimpact.arrays import Array, Flags, Indices, Matrix, Vector
from lcpimpact.compiled import compiled
from lcpimpact.errors import Status
from lcpimpact.hybrid.grid_steps import GridMotion, Stages
from lcpimpact.hybrid.impacts import refuse_velocity_jumps
from lcpimpact.hybrid.radau_iia import RadauIIA, radau_iia
from lcpimpact.hybrid.spectrum import balance
from lcpimpact.hybrid.system import ZERO
from lcpimpact.integrators.base import Declared, Integrator, Limits, refuse_hysteresis
from lcpimpact.integrators.stepping.friction import active_friction, solve_same_case, solve_with_friction
from lcpimpact.integrators.stepping.kernel import (
    SWITCHES,
    UNWATCHED,
    Block,
    StepOutput,
    StepTable,
    Workspace,
    add_friction_rows,
    add_impulses,
    add_knowns,
    choose_rows,
    copy,
    room_for,
    solve_rows,
)
from lcpimpact.integrators.stepping.law import ContactProblem, Solving, restrict, solve_law, submatrix, with_fallbacks
from lcpimpact.integrators.stepping.strong_dashpots import (
    ONE_STAGE,
    damped_rows,
    directions,
    may_damp,
    may_stop,
    weight,
)
from lcpimpact.interpreter import interpreted
from lcpimpact.lcp import SOLVERS
from lcpimpact.lcp.friction import GLOCKER, FrictionRows, lcp_matrix
from lcpimpact.lcp.operators import Dense
from lcpimpact.lcp.solve import limits, solve_lcp
from lcpimpact.lcp.solver import Kernel, SolverState
from lcpimpact.problems.base import Problem
from lcpimpact.record import Grid, Record
from lcpimpact.scheme.dynamics import Dynamics
from lcpimpact.scheme.first_order import FirstOrderForm, first_order_form
from lcpimpact.scheme.lagrangian import LagrangianDynamics
from lcpimpact.scheme.signals import NEAR_ULPS, Harmonic, TimeFunction, breaks, means_in_steps, snapped, terms_of
from lcpimpact.scheme.structure import Feature

SOLVED = int(Status.SOLVED)
NON_FINITE = int(Status.NON_FINITE)


class ImpactMatrices(NamedTuple):
    """Matrices of Newton's law of impact, with u = C X, U = C A X, U' = C A A X + G r.

    Attributes
    ----------
    C, CA, CAA : (nc, N) arrays     C, C A, C A A
    G : (nc, nc) array              C A B
    B : (N, nc) array               change of the state by unit impulses
    e : (nc,) array                 coefficients of restitution
    bounces : (nc,) array           the contacts of relative degree 2
    permanent : (nc,) array         the rows of relative degree 2 that take part in any impact, as joints do
    low : (nc,) array               lower bounds of the impulses
    friction : FrictionRows         the rows with friction of relative degree 2
    watched : (nc,) array           the contacts on strong dashpots
    h : float                       step in s
    """

    C: Matrix
    CA: Matrix
    CAA: Matrix
    G: Matrix
    B: Matrix
    e: Vector
    bounces: Flags
    permanent: Flags
    low: Vector
    friction: FrictionRows
    watched: Flags
    h: float


class RadauState(NamedTuple):
    """State carried from step to step: X and the last r (N + nc,), r of all stages (1, s nc), and the size of X (N,)."""

    y: Vector
    stages: Matrix
    scale: Vector


class Start(NamedTuple):
    """A step's start: X after impacts and the last r (N + nc,), impulses (nc,), and which contacts are closed (nc,)."""

    x: Vector
    P: Vector
    closed: Flags


@compiled(inline="always")
def row_of(M: Matrix, i: int, x: Vector, scale: Vector) -> tuple[float, float]:
    """Return row i of M x, and its tolerance for zero."""
    value, rounding = 0.0, 0.0
    for j in range(len(scale)):
        value += M[i, j] * x[j]
        rounding += ZERO * abs(M[i, j]) * scale[j]
    return value, rounding


@compiled()
def approaches(impacts: ImpactMatrices, scale: Vector, start: Start) -> bool:
    """Write the flags of the contacts of degree 2 that are closed and do not open; return whether any of them approaches."""
    approach = False
    for i in range(len(impacts.e)):
        start.closed[i] = False
        if impacts.bounces[i]:
            u, rounding = row_of(impacts.C, i, start.x, scale)
            if u <= rounding:
                rate, slow = row_of(impacts.CA, i, start.x, scale)
                start.closed[i] = rate <= slow
                approach = approach or rate < -slow
    return approach


@compiled()
def fall(impacts: ImpactMatrices, i: int, x: Vector, r: Vector) -> float:
    """Return U' of a contact without its own force."""
    rate = 0.0
    for j in range(impacts.CAA.shape[1]):
        rate += impacts.CAA[i, j] * x[j]
    for c in range(len(r)):
        rate += impacts.G[i, c] * r[c] if c != i else 0.0
    return rate


@compiled()
def apply_impacts(impacts: ImpactMatrices, scale: Vector, start: Start, solving: Solving) -> tuple[int, int, float]:
    """Apply the law of impact to the contacts that touch, their friction, and joints: status, iterations, residual.

    Overwrites X by its right limit, and writes the impulses and the contacts that are closed then. A rebound that gravity
    and the forces r of the last step would end within this step is suppressed, so that a body comes to rest.
    """
    nc, N = len(impacts.e), len(scale)
    r = start.x[N:]
    touching = np.zeros(nc, np.bool_)
    U = np.empty(nc)
    for i in range(nc):
        u, rounding = row_of(impacts.C, i, start.x, scale)
        U[i], _ = row_of(impacts.CA, i, start.x, scale)
        touching[i] = impacts.permanent[i] or (impacts.bounces[i] and u <= rounding)
    for k in range(len(impacts.friction.rows)):
        touching[impacts.friction.rows[k]] = touching[impacts.friction.normals[k]]
    rows = np.flatnonzero(touching)
    count = len(rows)
    W = submatrix(impacts.G, rows)
    friction = active_friction(impacts.friction, rows)
    low = impacts.low[rows]
    high = np.full(count, np.inf)
    q = np.empty(count)
    z = np.zeros(count)
    rebound = impacts.e[rows]
    iterations = 0
    worst = 0.0
    U_after = np.empty(count)
    for _ in range(2):
        for a in range(count):
            before = min(U[rows[a]], 0.0) if impacts.bounces[rows[a]] else U[rows[a]]
            q[a] = U[rows[a]] + rebound[a] * before
        status, tried, residual = solve_with_friction(ContactProblem(W, q, low, high), friction, z, solving)
        iterations += tried
        worst = max(worst, residual)
        if status != SOLVED:
            return status, iterations, worst
        again = False
        for a in range(count):
            U_after[a] = U[rows[a]]
            for c in range(count):
                U_after[a] += W[a, c] * z[c]
            U_ahead = U_after[a] + 0.5 * impacts.h * fall(impacts, rows[a], start.x, r)
            if impacts.bounces[rows[a]] and z[a] > 0.0 and rebound[a] > 0.0 and U_ahead <= 0.0:
                rebound[a], again = 0.0, True
        if not again:
            break
    for a in range(count):
        i = rows[a]
        start.P[i] = z[a]
        for j in range(N):
            start.x[j] += impacts.B[j, i] * z[a]
        _, slow = row_of(impacts.CA, i, start.x, scale)
        start.closed[i] = impacts.bounces[i] and U_after[a] <= slow
    return SOLVED, iterations, worst


@compiled()
def solve_stages(
    table: StepTable, q: Vector, na: int, room: Workspace, friction: FrictionRows, last: Vector, solving: Solving
) -> tuple[int, int, float]:
    """Solve the law on its ``na`` active rows, given the forces of the last step: status, iterations, residual."""
    if len(friction.rows) == 0:
        return solve_rows(table, 0, q, na, room, solving)
    rows = ContactProblem(table.W[0], q, table.lower[0], table.upper[0])
    active = room.active[:na]
    r = room.z[:na]
    if friction.continues:
        residual = solve_same_case(rows, active, friction, last, r)
        if residual <= solving.tol:
            return SOLVED, 0, residual
    return solve_with_friction(restrict(rows, active), active_friction(friction, active), r, solving)


@compiled()
def pushes_at_times(watched: Flags, active: Indices, z: Vector) -> bool:
    """Return whether a watched contact pushes at some of the stages and not at others."""
    nc, stages = len(watched), 0
    for i in range(nc):
        pushing = stages = 0
        for a in range(len(active)):
            if watched[i] and active[a] % nc == i:
                stages += 1
                pushing += z[a] > 0.0
        if 0 < pushing < stages:
            return True
    return False


@compiled()
def steps(
    block: Block,
    table: StepTable,
    laws: tuple[ImpactMatrices, FrictionRows],
    state: RadauState,
    path: StepOutput,
    room: Workspace,
    start: Start,
    solve: Kernel,
) -> tuple[int, int, int, int, float]:
    """Take a block of steps and overwrite the state.

    The knowns of the table are X and the last r, its law is that of all stages, and its results are the new y, q and v.
    The laws are that of impacts, and the rows of the stages that have friction.
    Returns the status, SWITCHES before a step that is to have one stage, the step reached, the LCPs solved, the
    sum of their iterations, and the largest independent residual.
    """
    impacts, friction = laws
    N = len(state.scale)
    nc = len(impacts.e)
    n = path.q.shape[1]
    rows = state.stages.shape[1]
    sums, r_last = room.sums, state.stages[0]
    new, size = 2 * rows, N + nc
    solves = 0
    iterations = 0
    worst = 0.0
    for k in range(block.first, block.last):
        copy(state.y, start.x)
        for c in range(nc):
            start.P[c] = 0.0
        if approaches(impacts, state.scale, start):
            status, count, residual = apply_impacts(
                impacts, state.scale, start, Solving(block.tol, block.max_iter, solve)
            )
            solves = solves + 1
            iterations = iterations + count
            worst = max(worst, residual)
            if status != SOLVED:
                return status, k, solves, iterations, worst
        add_knowns(table.known, start.x, block.loads, k - block.first, sums)
        for i in range(rows):
            if impacts.bounces[i % nc]:
                sums[i] = -1.0 if start.closed[i % nc] else 1.0
        na = add_friction_rows(friction, choose_rows(table, 0, 0, r_last, room), r_last, room)
        if na > 0:
            solving = Solving(block.tol, block.max_iter, solve)
            status, count, residual = solve_stages(table, sums[rows:new], na, room, friction, r_last, solving)
            solves = solves + 1
            iterations = iterations + count
            worst = max(worst, residual)
            if status != SOLVED:
                return status, k, solves, iterations, worst
            if pushes_at_times(impacts.watched, room.active[:na], room.z[:na]):
                return SWITCHES, k, solves, iterations, worst
        add_impulses(table, 0, na, new, room, r_last)
        for i in range(new, len(sums)):
            if not abs(sums[i]) < np.inf:
                return NON_FINITE, k, solves, iterations, worst
        copy(sums[new : new + size], state.y)
        for j in range(N):
            state.scale[j] = max(state.scale[j], abs(state.y[j]))
        copy(sums[new + size : new + size + n], path.q[k + 1])
        copy(sums[new + size + n :], path.v[k + 1])
        for i in range(nc):
            path.r[k, i] = state.y[N + i] + start.P[i] / impacts.h
    return SOLVED, block.last, solves, iterations, worst


@dataclass(frozen=True, eq=False)
class RadauRun:
    """State carried from block to block: the tabulated step and the state of the motion.

    ``implicit`` is that of the same motion by steps of one stage, where some contact is on a strong dashpot.
    """

    grid: Grid
    form: FirstOrderForm
    breakpoints: Array
    motions: frozenset[TimeFunction]
    table: StepTable
    laws: tuple[ImpactMatrices, FrictionRows]
    state: RadauState
    contacts: Dense
    solver: SolverState
    tol: float
    max_iter: int
    implicit: RadauRun | None = None


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
    Handles constant loads and signals; a load with breakpoints inside a step acts by its mean there, at order 2, and those
    of a prescribed motion take effect at the end of the step, at order 1. The declared orders are those of three stages. The
    reaction is that of the last stage, at the end of the step. The impulse of an impact is in the event and not among the
    reactions. A rebound that would end within a step is suppressed.

    On a Lagrangian system the steps are those of one mode, and end at events, which are located in them; the reactions are
    recorded at all instants of the grid, as right limits. See `lcpimpact.hybrid.grid_steps`.
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
        order_loss=5,
        loss_constant=1 / 3600,
        order_force_jump=2,
        order_force_kink=2,
        order_impact=1,
        order_friction=1,
        order_relay=1,
        order_penetration=1,
        level="velocity at relative degree 2, else position",
        relative_degrees=(0, 1, 2),
        handles=(
            Feature.SLIDERS,
            Feature.RELAYS,
            Feature.MOTIONS,
            Feature.SYSTEMS,
            Feature.MASSLESS,
            Feature.RESTITUTION,
            Feature.FRICTION,
            Feature.JOINTS,
            Feature.EQUATIONS,
            Feature.LAGRANGIAN,
        ),
        reaction_time="at t + h, one for each step",
        energy="never gains in smooth motion and impacts; loses at order 2 s - 1",
        precision=1e-7,
        slack=3.0,
        kick=0.75,
        dissipates=True,
        source="HairerWanner1996, section IV.5; AcaryBrogliato2008, chapter 10 on contacts",
    )

    def __post_init__(self) -> None:
        radau_iia(self.stages)
        limits(SOLVERS["auto"], self.tol, self.max_iter)

    def own_loss(self) -> tuple[float, float]:
        """Return p and c of the energy loss, for its number of stages."""
        s = self.stages
        return 2.0 * s - 1.0, (math.factorial(s - 1) / math.factorial(2 * s - 1)) ** 2

    def limits(self) -> Limits:
        """Return the tolerances of the certificate, for its number of stages."""
        return replace(super().limits(), order=2.0 * self.stages - 1.0)

    def reaction_times(self, grid: Grid) -> Array:
        """Return t_k + h, one for each step."""
        return grid.times(1, grid.steps)

    def start(self, problem: Problem, grid: Grid, lcp_solver: str, record: Record) -> RadauRun | GridMotion:
        """Write the initial state and tabulate the step."""
        if isinstance(problem.dynamics, LagrangianDynamics):
            radau = radau_iia(self.stages)
            return GridMotion.start(problem, grid, lcp_solver, record, self.name, Stages(radau.a, radau.a[-1], radau.c))
        return self._start(problem, grid, lcp_solver, record, 1.0)

    def _start(self, problem: Problem, grid: Grid, lcp_solver: str, record: Record, θ: float) -> RadauRun:
        """Write the initial state and tabulate the step, for one stage with a weight θ."""
        d, radau = problem.dynamics, radau_iia(self.stages)
        refuse_velocity_jumps(d, grid.t_end, self.name)
        refuse_hysteresis(d, self.name)
        form = first_order_form(d)
        record.q[0] = problem.initial_coordinates
        record.v[0] = problem.initial_velocities
        X = form.state(record.q[0], record.v[0])
        y = np.concatenate([X, _first_forces(d, form, X, d.gap(0.0, record.q[0]), lcp_solver)])
        A = form.A
        B = form.B
        C = form.C
        # The scale includes the displacement of a step, since a body may begin at rest.
        scale, moves = np.abs(X), np.eye(len(A)) + grid.h * np.abs(A)
        scale[form.constant :] = form.signal_sizes
        scale = moves @ moves @ scale
        solver = SOLVERS[lcp_solver]
        impulsive = d.relative_degree == 2
        rubbing, normals, mu = d.friction
        CA = np.array(C @ A, order="C")
        CAA = np.array(C @ A @ A, order="C")
        shocked = impulsive[rubbing]
        watched = np.zeros(len(d.contacts), dtype=np.bool_)
        if self.stages > 1 and may_stop(d, ONE_STAGE * grid.h, 0.5):
            watched[damped_rows(d).rows] = True
        if self.stages > 1 and may_damp(d, grid.h, 0.5):
            watched |= d.impenetrable & impulsive
        impacts = ImpactMatrices(
            C=C.copy(), CA=CA, CAA=CAA, G=np.array(CA @ B, order="C"), B=B.copy(), e=d.restitution,
            bounces=d.impenetrable & impulsive, permanent=d.permanent & impulsive, low=np.where(d.permanent, d.r_min, 0.0),
            friction=FrictionRows(rubbing[shocked], normals[shocked], mu[shocked], GLOCKER), watched=watched, h=grid.h,
        )  # fmt: skip
        friction = _stage_friction(d, len(radau.c), lcp_solver == "auto")
        table = _tabulate(radau, d, form, grid.h, θ)
        contacts = Dense(np.eye(1))
        if len(rubbing):
            contacts = Dense(lcp_matrix(table.W[0], table.lower[0], table.upper[0], friction))
            solver.check(contacts, not d.one_sided.all())
        elif len(d.contacts):
            always = np.tile(~impacts.bounces, len(radau.c))
            W = table.W[0]
            # The LCP of a step has the rows that are always active, and the closed contacts.
            contacts = Dense(W[np.ix_(always, always)].copy() if always.any() else W.copy())
            for each in (contacts, Dense(W.copy())):
                solver.check(each, not d.one_sided.all())
        state = RadauState(y, np.zeros((1, table.W.shape[1])), scale)
        solving = solver.init(contacts)
        tol, max_iter = limits(solver, self.tol, self.max_iter)
        implicit = None
        if watched.any():
            largest = max([0.5, *(weight(z) for z, _ in directions(d, grid.h, 0.5, watched))])
            implicit = replace(self, stages=1)._start(problem, grid, lcp_solver, record, largest)
            implicit = replace(implicit, state=implicit.state._replace(y=state.y, scale=state.scale))
        motions = frozenset(term for each in d.motions.values() for term in terms_of(each))
        return RadauRun(
            grid=grid, form=form, breakpoints=form.breakpoints(0.0, grid.t_end),
            motions=motions, table=table, laws=(impacts, friction), state=state, contacts=contacts,
            solver=solving, tol=tol, max_iter=max_iter, implicit=implicit,
        )  # fmt: skip

    def advance(self, carry: RadauRun | GridMotion, record: Record, first: int, last: int) -> tuple[Status, int]:
        """Take the steps of the block; after a breakpoint the signals are read anew."""
        if isinstance(carry, GridMotion):
            return carry.advance(record, first, last)
        begin = first

        def run(solver: SolverState, first: int, last: int) -> tuple[Status, int]:
            return self._run(carry, solver, record, first, last)

        t = record.t[first : last + 1]
        inside = carry.breakpoints
        inside = inside[(inside > t[0]) & (inside <= t[-1] + NEAR_ULPS * np.spacing(t[-1]))]
        nearest, near = snapped(t, inside)
        ends = np.where(near, nearest, np.searchsorted(t, inside))
        for end in np.unique(ends[ends > 0]):
            last_whole = begin + int(end) - int((ends[~near] == end).any())
            status, reached = Status.SOLVED, first
            if first < last_whole:
                status, reached = with_fallbacks(run, carry.solver, carry.contacts, first, last_whole)
            if status is Status.SOLVED and last_whole < begin + end:
                _take_means(carry, t[end - 1 : end + 1])
                status, reached = with_fallbacks(run, carry.solver, carry.contacts, last_whole, last_whole + 1)
            if status is not Status.SOLVED:
                return status, reached
            first = reached
            _read_signals(carry, record, first, float(max(t[end], inside[ends == end].max())))
        return with_fallbacks(run, carry.solver, carry.contacts, first, last) if first < last else (Status.SOLVED, last)

    def _run(self, carry: RadauRun, solver: SolverState, record: Record, first: int, last: int) -> tuple[Status, int]:
        """Take steps, those with one stage where a contact on a strong dashpot pushes at some of them alone."""
        while first < last:
            code, first = self._steps(carry, solver, record, first, last)
            if code == SWITCHES and carry.implicit:
                status, first = self._take_one_stage(carry.implicit, record, first)
                code = int(status)
            if code != SOLVED:
                return Status(code), first
        return Status.SOLVED, first

    def _take_one_stage(self, carry: RadauRun, record: Record, k: int) -> tuple[Status, int]:
        """Take step k with one stage."""

        def run(solver: SolverState, first: int, last: int) -> tuple[Status, int]:
            code, reached = self._steps(carry, solver, record, first, last)
            return Status(code), reached

        return with_fallbacks(run, carry.solver, carry.contacts, k, k + 1)

    def _steps(self, carry: RadauRun, solver: SolverState, record: Record, first: int, last: int) -> tuple[int, int]:
        """Take steps in compiled code, or in the interpreter where the solver is written in Python."""
        run: Callable[..., tuple[int, int, int, int, float]] = steps
        if not solver.compiled:
            run = interpreted(steps, solve_law=interpreted(solve_law))
        N, nc = len(carry.state.scale), len(carry.laws[0].e)
        code, reached, solves, iterations, residual = run(
            Block(first, last, np.zeros((last - first, 0)), carry.tol, carry.max_iter, False, False, UNWATCHED),
            carry.table,
            carry.laws,
            carry.state,
            StepOutput(record.q, record.v, record.reaction),
            room_for(carry.table, 0),
            Start(np.empty(N + nc), np.empty(nc), np.empty(nc, bool)),
            solver.kernel,
        )
        record.stats.add_lcps(solves, iterations, residual)
        return code, reached


def _take_means(run: RadauRun, t: Array) -> None:
    """Replace the loads in the state before a step that contains their breakpoints by their means over the step."""
    at = run.form.constant + 1
    for signal in run.form.sources:
        states = 2 if isinstance(signal, Harmonic) else signal.degree + 1
        if breaks(signal) and signal not in run.motions:
            for mean in means_in_steps(signal, t)[1]:
                run.state.y[at : at + states] = 0.0
                run.state.y[at] = mean
        at += states


def _read_signals(run: RadauRun, record: Record, k: int, t: float) -> None:
    """Replace the signals in the state after step k by their right limits at t."""
    form, N = run.form, len(run.form.A)
    X = run.state.y[:N]
    moved = form.right_of(t, X, run.state.scale).hi - X
    record.q[k] += form.Q @ moved
    record.v[k] += form.Q @ (form.A @ moved)
    X += moved


def _first_forces(d: Dynamics, form: FirstOrderForm, X: Array, u: Array, lcp_solver: str) -> Array:
    """Return r at t = 0 of the rows of relative degree 0; a slider of them begins at the initial coordinates."""
    r = np.zeros(len(d.contacts))
    rows = np.flatnonzero(d.relative_degree == 0)
    if len(rows) and d.stores_energy:  # the coordinates of a given system do not depend on r
        place = np.where(d.of_rate, u, 0.0)[rows]
        D, q = form.D[np.ix_(rows, rows)], (form.C @ X)[rows] - place
        r[rows] = solve_lcp(D, q, lcp_solver, lower=d.r_min[rows], upper=d.r_max[rows]).z
    return r


def _stage_friction(d: Dynamics, s: int, continues: bool) -> FrictionRows:
    """Return the rows of all stages that have friction."""
    rows, normals, mu = d.friction
    first = len(d.contacts) * np.repeat(np.arange(s), len(rows))
    return FrictionRows(first + np.tile(rows, s), first + np.tile(normals, s), np.tile(mu, s), GLOCKER, continues)


def _tabulate(radau: RadauIIA, d: Dynamics, form: FirstOrderForm, h: float, θ: float) -> StepTable:
    """Return the table of a step in the knowns (X, the last r, 1) and r of its stages, which form one law.

    A weight θ < 1 of X⁺ is for one stage.
    """
    A = form.A
    B = form.B
    C = form.C
    D = form.D
    s = len(radau.c)
    N = len(A)
    nc = len(d.contacts)
    columns = np.eye(N + nc + s * nc)
    X = columns[:N]
    r_last = columns[N : N + nc]
    r = columns[N + nc :].reshape(s, nc, len(columns))

    # X_i - X = h Σ a_ij (A (X_j - X) + A X + B r_j), with states in units in which A is balanced.
    balanced, scaling = balance(A)
    rates = ((A @ X + B @ r) / scaling[:, None]).reshape(s * N, len(columns))
    weights = h * np.kron(radau.a, np.eye(N))
    moved = np.linalg.solve(np.eye(s * N) - θ * weights @ np.kron(np.eye(s), balanced), weights @ rates)
    stages = X + scaling[:, None] * moved.reshape(s, N, len(columns))

    u = C @ stages + D @ r
    U = C @ (A @ stages + B @ r)
    slid = np.einsum("ij,jcm->icm", radau.inverse / h, u - (C @ X + D @ r_last))
    degree = d.relative_degree[:, None]
    of_rate = d.of_rate[:, None]
    of_place = d.switches[:, None] | ~of_rate & (degree < 2)
    L = np.where(of_place, u / h, np.where(of_rate & (degree == 0), slid, U))

    # The positions of quasi-static nodes depend on r, so their velocities depend on its rate.
    r_rate = np.einsum("j,jcm->cm", radau.inverse[-1] / h, r - r_last)
    q = form.Q @ stages[-1] + form.Qr @ r[-1]
    v = form.Q @ (A @ stages[-1] + B @ r[-1]) + form.Qr @ r_rate
    L = L.reshape(s * nc, len(columns))
    rows = np.vstack([np.zeros_like(L), L, stages[-1], r[-1], q, v])
    known, unknown = np.split(np.array(rows.T, order="C"), [N + nc])
    one = np.zeros((1, len(rows)))
    # The kernel overwrites this for contacts of relative degree 2.
    one[0, : s * nc] = np.where(np.tile(d.tangential, s), 1.0, -1.0)
    return StepTable(
        np.vstack([known, one]),
        unknown,
        unknown[None, :, s * nc : 2 * s * nc].transpose(0, 2, 1).copy(),
        np.tile(d.r_min, (1, s)),
        np.tile(d.r_max, (1, s)),
        np.zeros(1, bool),
        np.zeros((1, s * nc)),
    )
