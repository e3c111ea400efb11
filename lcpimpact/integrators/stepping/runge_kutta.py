r"""Explicit Runge-Kutta methods on the reduced equations, with an LCP at each stage.

The massless coordinates are eliminated (`lcpimpact.scheme.first_order`), so

.. math:: X' = A X + B r + E s(X), \qquad u = C X + D r,

and the right side is a function of X: the reactions obey the contact law at the level of the relative degree,

.. math:: 0 \le r \perp u^{(ρ)} = O X + G r + O_s s \ge 0 ,

which is the "differential succession" of the paper's Fig. 3. At relative degree 0 all rows are active; at 1 those with u
<= 0; at 2 those with u <= 0 and U = 0.

A step that violates a constraint is corrected at its end by impulses, which are one LCP with the same G,

.. math:: 0 \le P \perp G P + \begin{cases} U + e U & (ρ = 2) \\ u & (ρ = 1) \end{cases} \ge 0, \qquad X^+ = X + B P :

for degree 2 Newton's law of impact, for degree 1 the missing force between the closing of the gap and the end of the
step. The impulse of an impact acts at the end of the step and counts from the instant, τ ago, at which the gap closed: U
is the speed at that instant, and X⁺ moves on by τ A B P. A rebound that would end within the step is suppressed, so that
a body at rest stays at rest.

Loads are read at the instants of the stages, and may be any functions of time. General forces stand among those of the
springs, s(t, X); they are functions of Python, with which a block runs in the interpreter. "u <= 0" is meant up to rounding,
1e-12 of the largest terms of u so far.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache, partial
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numba import types

from lcpimpact.arrays import Array, Flags, Indices
from lcpimpact.compiled import compiled, cube, f8, flags, i8, indices, matrix, named_tuple, vector
from lcpimpact.errors import InputError, Status
from lcpimpact.hybrid.impacts import refuse_velocity_jumps
from lcpimpact.hybrid.system import System, refuse_mixed_degrees
from lcpimpact.integrators.base import Declared, Integrator, Limits
from lcpimpact.integrators.stepping.kernel import copy
from lcpimpact.integrators.stepping.law import (
    SOLVING,
    ContactProblem,
    Solving,
    solve_active,
    solve_law,
    submatrix,
    with_fallbacks,
)
from lcpimpact.integrators.stepping.tableau import Tableau
from lcpimpact.interpreter import interpreted
from lcpimpact.lcp import SOLVERS
from lcpimpact.lcp.operators import Dense
from lcpimpact.lcp.problem import KERNEL
from lcpimpact.lcp.solve import limits
from lcpimpact.lcp.solver import Kernel
from lcpimpact.lcp.solver import SolverState as Solver
from lcpimpact.numbers import is_real
from lcpimpact.problems.base import Problem
from lcpimpact.record import Event, Grid, Record, State, Stats
from lcpimpact.scheme.dynamics import Dynamics, Feature
from lcpimpact.scheme.first_order import FirstOrderForm, Inputs, forced_form
from lcpimpact.scheme.power_law import energies, spring_force, tangents
from lcpimpact.scheme.signals import Harmonic, PiecewisePolynomial, breakpoints_at, breaks, jumps, means_in_steps

SOLVED, NON_FINITE = int(Status.SOLVED), int(Status.NON_FINITE)

ACTIVE_GAP_FACTOR = 1e3
"""Factor on the tolerance for a closed gap while the contact is active, since it drifts."""

MAX_STATE = 1e100
"""Largest state: beyond, a step is too long to be a motion; its energy is still a number."""

ZERO_RTOL = 1e-12
"""Tolerance for zero, relative to the terms of the sum at their largest so far."""

STEP_TOLERANCE = 0.1
"""Error of one step in units of rtol, since the errors of steps add up."""

STATE_FLOOR = 1e-3
"""Smallest scale of a state, relative to the largest of its kind."""

SAMPLED = np.linspace(0.0, 1.0, 17)[1:-1]
"""Positions in a step at which gaps are sampled, in units of its length."""

declare = partial(
    Declared,
    order_force_jump=2,
    order_force_kink=2,
    order_impact=1,
    order_penetration=math.inf,
    level="acceleration within a step, position and velocity at its end",
    relative_degrees=(0, 1, 2),
    # All but sliders, whose force jumps as the velocity reverses.
    handles=(
        Feature.POWER_LAWS,
        Feature.FORCES,
        Feature.MOTIONS,
        Feature.SYSTEMS,
        Feature.MASSLESS,
        Feature.RESTITUTION,
    ),
    reaction_time="at t, right limit",
    energy="no bound; grows beyond the stability limit",
    dissipates=False,
)
"""Declared properties of an explicit Runge-Kutta method: the shared ones, and the arguments."""


class Matrices(NamedTuple):
    """The right-hand side, as matrices over x = (y, signals, loads), and behind these t where a general force acts.

    Attributes
    ----------
    A, B, E : arrays                y' = A x + B r + E s (ny, .)
    C, U : arrays                   u = C x, U = U x (nc, .)
    O, O_s, G : arrays              u^(ρ) = O x + O_s s + G r (nc, .)
    approach, rate : arrays         δ and δ' of the springs (ns, .)
    law : (ns, 5) array             their gap, K, n, b, c
    degree, e : (nc,) arrays        relative degrees and coefficients of restitution
    """

    A: Array
    B: Array
    E: Array
    C: Array
    U: Array
    O: Array  # noqa: E741
    O_s: Array
    G: Array
    approach: Array
    rate: Array
    law: Array
    degree: Indices
    e: Array


class GridValues(NamedTuple):
    """Results of the steps at each instant of the grid: y, y', r, P, and the time since each gap closed."""

    y: Array
    dy: Array
    r: Array
    P: Array
    since: Array


class Point(NamedTuple):
    """Results at one instant: x, y', r, P, and the time since each gap closed."""

    x: Array
    dy: Array
    r: Array
    P: Array
    since: Array


class Weights(NamedTuple):
    """The tableau: a (s, s), b (s,), and the weights of the estimated error (s,)."""

    a: Array
    b: Array
    b_error: Array


class StepBlock(NamedTuple):
    """The steps of a block.

    Attributes
    ----------
    first, last : int               indices of the first and the last instant
    h, shortest : float             length of the steps, and of the shortest flight, in s
    given : (steps or 1, s + 1, ng) signals and loads at the stages and at the end of a step
    tol, max_iter                   tolerance of the LCP solver, and its limit of iterations
    """

    first: int
    last: int
    h: float
    shortest: float
    given: Array
    tol: float
    max_iter: int


class StageWorkspace(NamedTuple):
    """Workspace: y' of the stages, the contact problem of a stage, the closed contacts, and the displacements of a step."""

    K: Array
    active: Indices
    q: Array
    z: Array
    lower: Array
    upper: Array
    s: Array
    touches: Flags
    together: Flags
    moves: Array


MATRICES: Any = named_tuple((matrix,) * 11 + (indices, vector), Matrices)
GRID_VALUES: Any = named_tuple((matrix,) * 5, GridValues)
POINT: Any = named_tuple((vector,) * 5, Point)
WEIGHTS: Any = named_tuple((matrix, vector, vector), Weights)
STEP_BLOCK: Any = named_tuple((i8, i8, f8, f8, cube, f8, i8), StepBlock)
STAGE_WORKSPACE: Any = named_tuple(
    (matrix, indices, vector, vector, vector, vector, vector, flags, flags, vector), StageWorkspace
)


def room_for(system: Matrices, stages: int) -> StageWorkspace:
    """Return the workspace of a system and a number of stages."""
    ny, nc, ns = len(system.A), len(system.C), system.E.shape[1]
    q, z, lower = np.zeros((3, nc))
    touches, together = np.zeros((2, nc), bool)
    return StageWorkspace(
        K=np.zeros((stages, ny)), active=np.zeros(nc, np.int64), q=q, z=z, lower=lower, upper=np.full(nc, np.inf),
        s=np.zeros(ns), touches=touches, together=together, moves=np.zeros(ny),
    )  # fmt: skip


@compiled(f8(matrix, i8, vector), inline="always", allocates=False)
def term(M: Array, i: int, x: Array) -> float:
    """Return row i of M x."""
    sum_ = 0.0
    for j in range(len(x)):
        sum_ += M[i, j] * x[j]
    return sum_


@compiled(f8(matrix, i8, vector), inline="always", allocates=False)
def rounding(M: Array, i: int, scale: Array) -> float:
    """Return the tolerance for zero of row i of M x."""
    sum_ = 0.0
    for j in range(len(scale)):
        sum_ += abs(M[i, j]) * scale[j]
    return ZERO_RTOL * sum_


@compiled(types.void(vector, MATRICES, vector), allocates=False)
def spring_forces(x: Array, system: Matrices, s: Array) -> None:
    """Write the forces s(δ, δ') of the non-linear springs at x."""
    for a in range(len(s)):
        K, n, b, c = system.law[a, 1], system.law[a, 2], system.law[a, 3], system.law[a, 4]
        s[a], _, _ = spring_force(K, n, b, c, term(system.approach, a, x), term(system.rate, a, x))


@compiled(f8(f8), inline="always", allocates=False)
def held(r: float) -> float:
    """Return the factor on the tolerance for a closed gap: an active contact drifts."""
    return ACTIVE_GAP_FACTOR if r > 0.0 else 1.0


@compiled(types.void(vector, MATRICES, vector, vector, flags), allocates=False)
def touching(x: Array, system: Matrices, scale: Array, r: Array, touches: Flags) -> None:
    """Write the active rows: all of degree 0, those with u <= 0 of degree 1, those with u <= 0 and U = 0 of degree 2."""
    for i in range(len(r)):
        touches[i] = system.degree[i] == 0 or term(system.C, i, x) <= held(r[i]) * rounding(system.C, i, scale)
        if system.degree[i] == 2 and touches[i]:
            touches[i] = abs(term(system.U, i, x)) <= held(r[i]) * rounding(system.U, i, scale)


@compiled(types.Tuple((i8, i8, f8))(vector, MATRICES, vector, vector, STAGE_WORKSPACE, SOLVING), allocates=False)
def right_side(
    x: Array, system: Matrices, r: Array, dy: Array, room: StageWorkspace, solving: Solving
) -> tuple[int, int, float]:
    """Write r and y' at x, with the active contacts of the workspace; return status, iterations and residual."""
    nc, na = len(r), 0
    spring_forces(x, system, room.s)
    for i in range(nc):
        if room.touches[i]:
            room.active[na], room.z[na] = i, max(r[i], 0.0)
            room.q[i] = term(system.O, i, x) + term(system.O_s, i, room.s)
            na += 1
        r[i] = 0.0
    status, count, residual = SOLVED, 0, 0.0
    rows = ContactProblem(system.G, room.q, room.lower, room.upper)
    if na == nc > 0:
        status, count, residual = solve_law(rows, room.z, solving)
    elif na > 0:
        status, count, residual = solve_active(rows, room.active[:na], room.z[:na], solving)
    for a in range(na):
        r[room.active[a]] = room.z[a]
    for j in range(len(dy)):
        dy[j] = term(system.A, j, x) + term(system.B, j, r) + term(system.E, j, room.s)
    return status, count, residual


@compiled(types.boolean(vector, MATRICES, vector, vector, STAGE_WORKSPACE), allocates=False)
def violates(x: Array, system: Matrices, scale: Array, r: Array, room: StageWorkspace) -> bool:
    """Write the active rows at the end of a step; return whether any violates its constraint."""
    touching(x, system, scale, r, room.touches)
    violated = False
    for i in range(len(r)):
        gap, near = term(system.C, i, x), rounding(system.C, i, scale)
        if system.degree[i] > 0 and gap <= held(r[i]) * near:
            if system.degree[i] == 2:
                slow = held(r[i]) * rounding(system.U, i, scale)
                violated = violated or term(system.U, i, x) < -slow
            else:
                room.touches[i] = gap >= -near
                violated = violated or gap < -near
    return violated


class Landing(NamedTuple):
    """Contacts that violate their constraints at the end of a step.

    Attributes
    ----------
    rows : (na,) indices            which
    gap, speed, free : (nc,) arrays u, U of degree 2, and u^(ρ)
    meets : (nc,) flags             where U < 0
    e : (nc,) array                 coefficients of restitution, 0 where a rebound counts as none
    """

    rows: Indices
    gap: Array
    speed: Array
    free: Array
    meets: Flags
    e: Array


LANDING: Any = named_tuple((indices, vector, vector, vector, flags, vector), Landing)


@compiled(LANDING(POINT, MATRICES, vector))
def land(end: Point, system: Matrices, scale: Array) -> Landing:
    """Return the contacts that violate their constraints at the end of a step, ``free`` not yet written."""
    nc, na = len(end.r), 0
    rows, meets = np.empty(nc, np.int64), np.zeros(nc, np.bool_)
    gap, speed = np.zeros(nc), np.zeros(nc)
    for i in range(nc):
        gap[i] = term(system.C, i, end.x)
        if system.degree[i] > 0 and gap[i] <= held(end.r[i]) * rounding(system.C, i, scale):
            rows[na] = i
            na += 1
            if system.degree[i] == 2:
                speed[i] = term(system.U, i, end.x)
                meets[i] = speed[i] < -held(end.r[i]) * rounding(system.U, i, scale)
    return Landing(rows[:na], gap, speed, np.zeros(nc), meets, system.e.copy())


@compiled(f8(MATRICES, i8, vector, vector, vector), inline="always", allocates=False)
def derivative(system: Matrices, i: int, x: Array, s: Array, r: Array) -> float:
    """Return u^(ρ) of row i."""
    return term(system.O, i, x) + term(system.O_s, i, s) + term(system.G, i, r)


@compiled(types.void(LANDING, MATRICES, f8, vector, vector, vector), allocates=False)
def trace_back(landing: Landing, system: Matrices, h: float, since: Array, ago: Array, q: Array) -> None:
    """Write q of the impulses, how long ago each gap closed within the step, and for how long the impulses act."""
    gap, speed, free, e, earliest = landing.gap, landing.speed, landing.free, landing.e, 0.0
    for a, i in enumerate(landing.rows):
        ago[i] = since[i] = 0.0
        q[a] = gap[i] if system.degree[i] < 2 else speed[i]
        if system.degree[i] == 1 and free[i] < 0.0:
            since[i] = min(max(gap[i] / free[i], 0.0), h)
        if landing.meets[i]:
            # The speed at which the gap closed, and how long ago: u = τ (U + U_c)/2, and U² = U_c² + 2 u'' u.
            closing, square = speed[i], speed[i] ** 2 - 2.0 * free[i] * gap[i]
            if square <= 0.0:
                # It falls back before it has left the penetration of an earlier impact.
                e[i] = 0.0
            if e[i] > 0.0:
                closing = -np.sqrt(square)
            ago[i] = since[i] = min(max(2.0 * gap[i] / (speed[i] + closing), 0.0), h)
            q[a] = (1.0 + e[i]) * closing
            earliest = max(earliest, ago[i])
    for i in landing.rows:
        if system.degree[i] == 2 and ago[i] == 0.0:
            ago[i] = earliest


@compiled(types.boolean(POINT, LANDING, MATRICES, vector, f8), allocates=False)
def falls_back(end: Point, landing: Landing, system: Matrices, s: Array, shortest: float) -> bool:
    """Set e to zero where the flight after a rebound ends sooner than the shortest that counts; return whether any does."""
    found = False
    for i in landing.rows:
        if landing.e[i] > 0.0 and (landing.meets[i] or end.P[i] > 0.0) and system.degree[i] == 2:
            acceleration = derivative(system, i, end.x, s, end.r)
            if 2.0 * (term(system.U, i, end.x) - acceleration * end.since[i]) <= -acceleration * shortest:
                landing.e[i], found = 0.0, True
    return found


@compiled(types.Tuple((i8, i8, f8))(POINT, LANDING, MATRICES, vector, SOLVING))
def settle(end: Point, landing: Landing, system: Matrices, scale: Array, solving: Solving) -> tuple[int, int, float]:
    """Bring contacts to rest that were struck without restitution and that damping has moved since: U = 0, by further P.

    The other contacts that touch do not approach, U >= 0.
    """
    x, P, na, moves = end.x, end.P, 0, False
    rows = np.empty_like(landing.rows)
    for i in landing.rows:
        # One that has rebounded and falls again is left to `falls_back`.
        stopped = landing.e[i] == 0.0 and P[i] > 0.0
        if system.degree[i] == 2 and (stopped or not term(system.C, i, x) > rounding(system.C, i, scale)):
            rows[na] = i
            na += 1
    rows = rows[:na]
    q, z, struck = np.empty(na), np.zeros(na), np.zeros(len(P))
    for a, i in enumerate(rows):
        U, slow = term(system.U, i, x), rounding(system.U, i, scale)
        struck[i] = P[i] if landing.e[i] == 0.0 else 0.0
        moves = moves or -slow > U or (slow < U and struck[i] > 0.0)
        q[a] = U
    if not moves:
        return SOLVED, 0, 0.0
    for a, i in enumerate(rows):
        q[a] -= term(system.G, i, struck)
    problem = ContactProblem(submatrix(system.G, rows), q, np.zeros(na), np.full(na, np.inf))
    status, count, residual = solve_law(problem, z, solving)
    more = np.zeros(len(P))
    more[rows] = z - struck[rows]
    for i in range(len(P)):
        P[i] = max(P[i] + more[i], 0.0)
    for j in range(len(end.dy)):
        x[j] += term(system.B, j, more)
    return status, count, residual


@compiled(types.boolean(vector, MATRICES, vector, vector, flags), allocates=False)
def slips_off(x: Array, system: Matrices, scale: Array, r: Array, closed: Flags) -> bool:
    """Return whether a closed contact that pushes has left u = 0 or U = 0 by more than rounding."""
    found = False
    for i in range(len(r)):
        if closed[i] and r[i] > 0.0 and system.degree[i] > 0:
            u, near = term(system.C, i, x), held(r[i]) * rounding(system.C, i, scale)
            found = found or u > near
            if system.degree[i] == 2:
                found = found or u < -near or abs(term(system.U, i, x)) > held(r[i]) * rounding(system.U, i, scale)
    return found


@compiled(types.Tuple((i8, i8, f8))(POINT, MATRICES, f8, STAGE_WORKSPACE, SOLVING))
def hold(end: Point, system: Matrices, h: float, room: StageWorkspace, solving: Solving) -> tuple[int, int, float]:
    """Return closed contacts that push at both ends of a step to u = 0 and U = 0, which its error has left.

    The impulses p are part of that of their forces: z = p + h r >= 0, so that a contact that has opened stays open; and so
    for the gaps of degree 2, moved by A B p with z = p + h² r.
    """
    x, r, ny, na = end.x, end.r, len(end.dy), 0
    rows = np.empty(len(r), np.int64)
    for i in range(len(r)):
        room.touches[i] = room.together[i] and (r[i] > 0.0 or system.degree[i] == 0)
    status, total, worst = right_side(x, system, r, end.dy, room, solving)
    for i in range(len(r)):
        if room.touches[i] and r[i] > 0.0 and system.degree[i] > 0:
            rows[na] = i
            na += 1
    pushes, p, moved = np.zeros(len(r)), np.zeros(len(r)), np.zeros(len(x))
    for level in range(2):
        part = rows[:na] if level == 0 else rows[:na][system.degree[rows[:na]] == 2]
        if status != SOLVED or len(part) == 0:
            break
        pushes[:] = p[:] = moved[:] = 0.0
        q, z = np.empty(len(part)), np.empty(len(part))
        for a, i in enumerate(part):
            pushes[i] = h ** (system.degree[i] - level) * r[i]
            z[a] = pushes[i]
        for a, i in enumerate(part):
            q[a] = term(system.C if level == 0 else system.U, i, x) - term(system.G, i, pushes)
        problem = ContactProblem(submatrix(system.G, part), q, np.zeros(len(part)), np.full(len(part), np.inf))
        status, count, residual = solve_law(problem, z, solving)
        total, worst = total + count, max(worst, residual)
        for a, i in enumerate(part):
            p[i] = z[a] - pushes[i]
        if level == 0:
            for i in part:
                if system.degree[i] == 2:
                    for j in range(ny):
                        moved[j] += system.B[j, i] * p[i]
                    p[i] = 0.0
        for j in range(ny):
            x[j] += term(system.B, j, p) + term(system.A, j, moved)
    return status, total, worst


@compiled(types.Tuple((i8, i8, f8))(POINT, MATRICES, vector, types.UniTuple(f8, 2), STAGE_WORKSPACE, SOLVING))
def correct(
    end: Point, system: Matrices, scale: Array, lengths: tuple[float, float], room: StageWorkspace, solving: Solving
) -> tuple[int, int, float]:
    """Correct constraint violations at the end of a step by impulses P, and write r and y' after them.

    ``lengths`` are those of the step and of the shortest flight: a shorter rebound is suppressed. ``since`` becomes the time
    since each gap closed, and zero if none did.
    """
    (x, dy, r, P, since), (h, shortest), landing = end, lengths, land(end, system, scale)
    rows, nc, ny = landing.rows, len(r), len(dy)
    status, total, worst = right_side(x, system, r, dy, room, solving)
    if status != SOLVED:
        return status, total, worst
    for i in range(nc):
        landing.free[i] = derivative(system, i, x, room.s, r)
    before, W, lower, upper = x.copy(), submatrix(system.G, rows), np.zeros(len(rows)), np.full(len(rows), np.inf)
    q, z, ago, drift = np.empty(len(rows)), np.empty(len(rows)), np.zeros(nc), np.zeros(len(x))
    for _attempt in range(nc + 1):
        trace_back(landing, system, h, since, ago, q)
        z[:] = 0.0
        status, count, residual = solve_law(ContactProblem(W, q, lower, upper), z, solving)
        total, worst = total + count, max(worst, residual)
        if status != SOLVED:
            return status, total, worst
        P[rows] = z
        for j in range(ny):
            drift[j] = term(system.B, j, ago * P)
        for j in range(ny):
            x[j] = before[j] + term(system.B, j, P) + term(system.A, j, drift)
        status, count, residual = settle(end, landing, system, scale, solving)
        total, worst = total + count, max(worst, residual)
        if status != SOLVED:
            return status, total, worst
        touching(x, system, scale, r, room.touches)
        status, count, residual = right_side(x, system, r, dy, room, solving)
        total, worst = total + count, max(worst, residual)
        if status != SOLVED:
            return status, total, worst
        if not falls_back(end, landing, system, room.s, shortest):
            break
    return SOLVED, total, worst


@compiled(
    types.Tuple((i8, i8, f8))(POINT, MATRICES, vector, types.UniTuple(f8, 2), STAGE_WORKSPACE, f8, i8, KERNEL),
    allocates=False,
)
def end_step(
    end: Point,
    system: Matrices,
    scale: Array,
    lengths: tuple[float, float],
    room: StageWorkspace,
    tol: float,
    max_iter: int,
    solve: Kernel,
) -> tuple[int, int, float]:
    """Write r and y' at the end of a step, and where a constraint is violated there, `correct` x by impulses P."""
    solving = Solving(tol, max_iter, solve)
    for i in range(len(end.r)):
        end.P[i] = end.since[i] = 0.0
    if violates(end.x, system, scale, end.r, room):
        return correct(end, system, scale, lengths, room, solving)
    return right_side(end.x, system, end.r, end.dy, room, solving)


@compiled(types.void(MATRICES, vector, vector, f8, vector, vector), allocates=False)
def add_to_scale(system: Matrices, x: Array, r: Array, h: float, scale: Array, moves: Array) -> None:
    """Raise the scale to the displacements of a step.

    A body at rest has no velocity to compare with, but balanced forces, and their effect in a step.
    """
    ny = len(moves)
    for j in range(ny):
        sum_ = 0.0
        for l in range(len(x)):  # noqa: E741
            sum_ += abs(system.A[j, l] * x[l])
        for c in range(len(r)):
            sum_ += abs(system.B[j, c] * r[c])
        moves[j] = h * sum_
    for j in range(ny):
        sum_ = 0.0
        for l in range(ny):  # noqa: E741
            sum_ += abs(system.A[j, l]) * moves[l]
        scale[j] = max(scale[j], moves[j], h * sum_)


@compiled(
    types.Tuple((i8, i8, i8, f8))(
        STEP_BLOCK, MATRICES, WEIGHTS, GRID_VALUES, types.UniTuple(vector, 2), matrix, STAGE_WORKSPACE, KERNEL
    ),
    allocates=False,
)
def steps(
    block: StepBlock,
    system: Matrices,
    weights: Weights,
    motion: GridValues,
    now: tuple[Array, Array],
    ahead: Array,
    room: StageWorkspace,
    solve: Kernel,
) -> tuple[int, int, int, float]:
    """Take a block of steps: compute the motion at [k + 1] from that at [k].

    ``now`` holds x and its scale so far; ``ahead`` (2, ny) becomes the last state before its correction, and its error
    estimate. Returns the status, the step reached, the sum of the LCP iterations, and the largest residual.
    """
    (x, scale), h, given, K = now, block.h, block.given, room.K
    s, ny, nc = len(weights.b), motion.y.shape[1], motion.r.shape[1]
    solving = Solving(block.tol, block.max_iter, solve)
    total, worst = 0, 0.0
    for k in range(block.first, block.last):
        p = k - block.first if len(given) > 1 else 0
        y, force = motion.y[k], motion.r[k + 1]
        copy(motion.dy[k], K[0])
        copy(motion.r[k], force)
        copy(y, x[:ny])
        copy(given[p, 0], x[ny:])
        add_to_scale(system, x, force, h, scale, room.moves)
        touching(x, system, scale, force, room.together)
        for i in range(1, s):
            for j in range(ny):
                sum_ = 0.0
                for l in range(i):  # noqa: E741
                    sum_ += weights.a[i, l] * K[l, j]
                x[j] = y[j] + h * sum_
            copy(given[p, i], x[ny:])
            touching(x, system, scale, force, room.touches)
            for c in range(nc):
                # A contact open at the start of the step stays so until its end, where `end_step` corrects it; one that
                # has pushed so far is closed, whatever the error of the stage.
                room.touches[c] = room.together[c] and (room.touches[c] or force[c] > 0.0)
            status, count, residual = right_side(x, system, force, K[i], room, solving)
            total, worst = total + count, max(worst, residual)
            if status != SOLVED:
                return status, k, total, worst
        for j in range(ny):
            sum_, estimate = 0.0, 0.0
            for l in range(s):  # noqa: E741
                sum_ += weights.b[l] * K[l, j]
                estimate += weights.b_error[l] * K[l, j]
            x[j] = y[j] + h * sum_
            ahead[0, j], ahead[1, j] = x[j], h * estimate
            if not abs(x[j]) < MAX_STATE:
                return NON_FINITE, k, total, worst
        copy(given[p, s], x[ny:])
        for j in range(len(scale)):
            scale[j] = max(scale[j], abs(x[j]))
        end = Point(x, motion.dy[k + 1], force, motion.P[k + 1], motion.since[k + 1])
        if slips_off(x, system, scale, force, room.together):
            status, count, residual = hold(end, system, h, room, solving)
            total, worst = total + count, max(worst, residual)
            if status != SOLVED:
                return status, k, total, worst
        status, count, residual = end_step(
            end, system, scale, (h, block.shortest), room, block.tol, block.max_iter, solve
        )
        total, worst = total + count, max(worst, residual)
        if status != SOLVED:
            return status, k, total, worst
        copy(x[:ny], motion.y[k + 1])
    return SOLVED, block.last, total, worst


@dataclass(frozen=True, eq=False)
class RungeKuttaRun:
    """State carried from block to block: the matrices, and the states, rates, forces and impulses on the grid.

    ``forces`` writes the forces of springs and general forces at x, as `spring_forces` does.
    """

    grid: Grid
    form: FirstOrderForm
    inputs: Inputs
    system: System
    matrices: Matrices
    forces: Callable[[Array, Matrices, Array], None]
    motion: GridValues
    scale: Array
    contacts: Dense
    solver: Solver
    tol: float
    max_iter: int
    step: Array
    largest: Array
    energy: Array
    metric: Array

    def allowed(self, y: Array, h: float, rtol: float, atol: float) -> Array:
        """Return the tolerance of each state in a step of length h that ends in y (ny,)."""
        size = np.maximum(self.largest, np.abs(y))
        places = len(y) - self.form.parts.massive.shape[1]
        speed = size[places:].max(initial=0.0)
        kinds = np.where(np.arange(len(y)) < places, max(size[:places].max(initial=0.0), h * speed), speed)
        return np.asarray(atol + rtol * np.maximum(size, STATE_FLOOR * kinds))

    def error(self, x: Array, error: Array, allowed: Array, rtol: float) -> float:
        """Return the estimated error of a step that ends in x = (y, signals, loads), relative to its tolerance."""
        δ = self._approach(x)
        _, stiffness, _ = tangents(self.inputs.law, np.maximum(δ, 0.0), np.zeros_like(δ), extended=True)
        moved = self.inputs.approach[:, : len(error)] @ error
        square = error @ self.metric @ error + (stiffness * moved**2).sum()
        limit = (
            rtol**2 * max(self.energy[0], self.energy_of(x))
            + STATE_FLOOR**2 * np.abs(np.diag(self.metric)) @ allowed**2
        )
        single = np.abs(np.divide(error, allowed, out=np.zeros_like(error), where=allowed > 0.0)).max(initial=0.0)
        return max(float(single), math.sqrt(max(square, 0.0) / limit) if limit > 0.0 else 0.0)

    def energy_of(self, x: Array) -> float:
        """Return twice the energy of springs and masses at x, without signals."""
        y = x[: len(self.metric)]
        return float(y @ self.metric @ y + 2.0 * energies(self.inputs.law, self._approach(x)).sum())

    def _approach(self, x: Array) -> Array:
        """Return δ of the non-linear springs (ns,)."""
        rows = self.inputs.approach
        return np.asarray(rows @ x[: rows.shape[1]])

    def given(self, t: Array) -> Array:
        """Return the `given` inputs at the times t, with the shape of t followed by (ng,)."""
        return given(self.form, self.inputs, t)

    def given_in_steps(self, t: Array, c: Array, h: float, first: float | None = None) -> Array:
        """Return the `given` inputs in the steps between instants, at t + c h and last at its end (steps, s + 1, ng).

        A stage at the end of a step sees the left limits of signals, all else the right ones. Of a load with breakpoints in
        the step, stages after the first, which has the weight b = ``first``, see what gives its mean with that.
        """
        found = self.given(t[:-1, None] + np.append(c, 1.0) * h)
        at = 1
        for signal in self.form.sources:
            states = 2 if isinstance(signal, Harmonic) else signal.degree + 1
            columns = slice(at, at + states)
            if isinstance(signal, PiecewisePolynomial) and (jumps(signal) or signal in self.motions):
                for i, b in zip(*breakpoints_at(signal, t), strict=True):
                    after = signal.derivatives(max(b, t[i]))
                    if i > 0:
                        found[i - 1, :-1][c == 1.0, columns] = signal.derivatives(np.nextafter(b, -np.inf))
                        found[i - 1, -1, columns] = after
                    if i < len(found):
                        found[i, :-1][c == 0.0, columns] = after
            if first is not None and breaks(signal) and signal not in self.motions:
                k, mean = means_in_steps(signal, t)
                found[k, 1:-1, columns] = 0.0
                found[k, 1:-1, at] = ((mean - first * found[k, 0, at]) / (1.0 - first))[:, None]
            at += states
        return found

    @cached_property
    def motions(self) -> frozenset[Any]:
        """The prescribed motions."""
        return frozenset(self.system.dynamics.motions.values())


def given(form: FirstOrderForm, inputs: Inputs, t: Array) -> Array:
    """Return the signals, the loads and, where a general force acts, t at the times t, with its shape and (ng,)."""
    functions = (*inputs.loads, float) if inputs.force_laws else inputs.loads
    loads = [[f(float(s)) for f in functions] for s in np.ravel(t)]
    return np.concatenate([form.signals_at(t), np.array(loads).reshape(*np.shape(t), len(functions))], axis=-1)


def _matrices(system: System, inputs: Inputs) -> Matrices:
    """Return the matrices of the kernel over x = (y, signals, loads) and t, with y without the signals."""
    form, d = system.form, system.dynamics
    ny, ns, clock = form.constant, inputs.of_state, int(len(inputs.force_laws) > 0)
    C, CA = system.derivatives[:2]

    def over(states: Array, loads: Array | None = None) -> Array:
        """Return the matrix over x with these columns of the states and the loads."""
        behind = np.zeros((len(states), len(inputs.loads))) if loads is None else loads
        return np.column_stack([states, behind, np.zeros((len(states), clock))])

    return Matrices(
        A=over(form.A, inputs.E[:, ns:])[:ny].copy(),
        B=form.B[:ny].copy(),
        E=inputs.E[:ny, :ns].copy(),
        C=over(C, inputs.D[:, ns:]),
        U=over(CA),
        O=over(system.O, system.O_w[:, ns:]),
        O_s=system.O_w[:, :ns].copy(),
        G=np.array(system.G, order="C"),
        approach=over(inputs.approach),
        rate=over(inputs.rate),
        law=inputs.law.copy(),
        degree=d.relative_degree,
        e=d.restitution,
    )


@dataclass(frozen=True)
class ExplicitRungeKutta(Integrator):
    """An explicit Runge-Kutta method; to write one, declare it and give its tableau.

    Parameters
    ----------
    tol : float, optional
        Largest LCP residual, in units where max |W| = max |q| = 1; by default what the LCP solver declares.
    max_iter : int, optional
        Limit of LCP iterations in a stage; by default what the LCP solver declares.

    Raises
    ------
    InputError
        If tol or max_iter is not positive.

    Notes
    -----
    The reaction is the force at each instant of the grid, its right limit at an event. Impulses act at grid points, and the
    instants of the events are read between them. A step beyond the stability limit makes the motion grow without
    bound: the rate of a stiff plate, k_o/c_o, counts as well as ω.
    """

    tol: float | None = None
    max_iter: int | None = None

    narrowest: ClassVar[float] = ZERO_RTOL
    family: ClassVar[str] = "explicit Runge-Kutta"
    tableau: ClassVar[Tableau]

    def __post_init__(self) -> None:
        limits(SOLVERS["auto"], self.tol, self.max_iter)

    def limits(self) -> Limits:
        """Return the limits for contacts imposed at acceleration level, which drift within `ACTIVE_GAP_FACTOR`."""
        return replace(super().limits(), precision=1e2 * ACTIVE_GAP_FACTOR * ZERO_RTOL)

    def start(self, problem: Problem, grid: Grid, lcp_solver: str, record: Record) -> RungeKuttaRun:
        """Eliminate the massless coordinates, and write the initial values; impacts at t = 0 come before them."""
        d, solver = problem.dynamics, SOLVERS[lcp_solver]
        form, inputs = forced_form(d, self.name)
        system = System(d, grid.t_end, form, (inputs.E, inputs.D))
        refuse_mixed_degrees(system, self.name)
        refuse_velocity_jumps(d, grid.t_end, self.name)
        matrices = _matrices(system, inputs)
        contacts = Dense(matrices.G if len(d.contacts) else np.eye(1))
        if len(d.contacts):
            solver.check(contacts, False)
        ny, nc = form.constant, len(d.contacts)
        motion = GridValues(*(np.zeros((grid.steps + 1, size)) for size in (ny, ny, nc, nc, nc)))
        tol, max_iter = limits(solver, self.tol, self.max_iter)
        X = form.state(problem.initial_coordinates, problem.initial_velocities)
        x = np.append(X[:ny], given(form, inputs, np.array(0.0)))
        run = RungeKuttaRun(
            grid=grid, form=form, inputs=inputs, system=system, matrices=matrices, forces=state_forces(inputs),
            motion=motion, scale=np.abs(x), contacts=contacts, solver=solver.init(contacts), tol=tol, max_iter=max_iter,
            step=np.array([grid.h]), largest=np.abs(X[:ny]), energy=np.zeros(1), metric=_metric(d, form),
        )  # fmt: skip

        def begin(state: Solver, first: int, last: int) -> tuple[Status, int]:
            """Apply the impacts at t = 0."""
            right, _ = _functions(run, state)
            end = Point(x.copy(), motion.dy[0], motion.r[0], motion.P[0], motion.since[0])
            room = room_for(matrices, 1)
            code, _, _ = right(end, matrices, run.scale, (0.0, grid.h), room, tol, max_iter, state.kernel)
            motion.y[0] = end.x[:ny]
            return Status(code), 1

        status, _ = with_fallbacks(begin, run.solver, contacts, 0, 1)
        if status is not Status.SOLVED:
            raise InputError(f"the contacts of {problem.name!r} have no reactions at the start: {status.sentence}")
        start = np.array([motion.y[0] - matrices.B @ motion.P[0], motion.y[0]])
        record.events = _happened(run, np.zeros(2), GridValues(*(each[[0, 0]] for each in motion))._replace(y=start))
        _write(run, record, 0, 0)
        return run

    def advance(self, carry: RungeKuttaRun, record: Record, first: int, last: int) -> tuple[Status, int]:
        """Take the steps of the block."""
        tableau = self.tableau.fixed
        constant = len(carry.form.signals) == 1 and not carry.inputs.loads and not carry.inputs.force_laws
        instants = carry.grid.times(0, 1) if constant else carry.grid.times(first, last)
        given = carry.given_in_steps(instants, np.array(tableau.c), carry.grid.h, tableau.b[0])
        given = np.ascontiguousarray(given)

        def run(solver: Solver, begin: int, end: int) -> tuple[Status, int]:
            part = given if constant else given[begin - first : end - first]
            h, ahead = carry.grid.h, np.zeros((2, carry.motion.y.shape[1]))
            block = StepBlock(begin, end, h, h, part, carry.tol, carry.max_iter)
            return _take(carry, solver, record.stats, block, tableau, carry.motion, ahead)

        status, reached = with_fallbacks(run, carry.solver, carry.contacts, first, last)
        t, closed = carry.grid.times(first, reached), carry.motion.r[first : reached + 1] > 0.0
        impacts = (carry.motion.P[first + 1 : reached + 1] > 0.0) & (carry.system.degree == 2)
        assert record.events is not None
        for k in first + np.flatnonzero((impacts | (closed[1:] != closed[:-1])).any(axis=1)):
            here = t[k - first : k - first + 2]
            record.events += _happened(carry, here, GridValues(*(each[k : k + 2] for each in carry.motion)))
        if status is Status.SOLVED:
            _write(carry, record, first + 1, reached)
        else:
            _write(carry, record, 1, reached, diverges=True)
        return status, reached


@dataclass(frozen=True)
class EmbeddedRungeKutta(ExplicitRungeKutta):
    r"""An embedded Runge-Kutta method, with optional step control within each dt.

    Parameters
    ----------
    rtol : float, optional
        Tolerance relative to the motion so far; with None the step is dt.
    atol : float, optional
        Absolute tolerance in the units of each state, 0 by default: for motions that need not be resolved.
    tol, max_iter : optional
        As of `ExplicitRungeKutta`.

    Raises
    ------
    InputError
        If an option is not positive, or atol is given without rtol.

    Notes
    -----
    With rtol the estimated error ε of a step must not exceed a tenth of it in either of two measures: each state relative to
    its largest value so far, and all of them together by the energy of ε relative to the largest energy,

    .. math:: |ε_i| \le \tfrac{1}{10} rtol \max |y_i|, \qquad ε^T G ε \le (\tfrac{1}{10} rtol)^2 \max y^T G y, \quad
              \tfrac 12 y^T G y = \tfrac 12 v^T M v + \tfrac 12 q^T K q .

    The energy norm relates errors of positions and velocities: δ in a position is ω δ in a velocity a quarter of a period
    later. A step with a penetration beyond the tolerance is rejected, too, and repeated up to the closing of the gap; so
    is one in which a gap falls below zero and rises again. Rebounds are suppressed if they are lower than the tolerance,
    or their flight is shorter than rtol dt.

    The error of a run is then a small multiple of rtol, unless the motion amplifies errors, as impacts of several bodies
    may.
    """

    rtol: float | None = None
    atol: float | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, value in (("rtol", self.rtol), ("atol", self.atol)):
            if value is not None and (not is_real(value) or not value > 0.0):
                raise InputError(f"{name} = {value!r} must be above zero, or None")
        if self.atol is not None and self.rtol is None:
            raise InputError(f"atol = {self.atol:g} is given without rtol: give both, or none for steps of dt")

    def limits(self) -> Limits:
        """Return the limits that follow from rtol, if it is given."""
        found = super().limits()
        return found if self.rtol is None else replace(found, precision=max(found.precision, self.rtol))

    def advance(self, carry: RungeKuttaRun, record: Record, first: int, last: int) -> tuple[Status, int]:
        """Take the steps of the block, or several within each by the step control."""
        if self.rtol is None:
            return super().advance(carry, record, first, last)
        for k in range(first, last):
            status = self._cross(carry, record, k, self.rtol, self.atol or 0.0)
            if status is not Status.SOLVED:
                _write(carry, record, 1, k, diverges=True)
                return status, k
        _write(carry, record, first + 1, last)
        return Status.SOLVED, last

    def _cross(self, carry: RungeKuttaRun, record: Record, k: int, rtol: float, atol: float) -> Status:
        """Integrate from t_k to t_k+1 with step control."""
        tableau, grid = self.tableau, carry.grid
        c, ny = np.array(tableau.c), carry.motion.y.shape[1]
        t, end = grid.t_end * k / grid.steps, grid.t_end * (k + 1) / grid.steps
        motion = GridValues(*(np.repeat(each[k : k + 1], 2, axis=0) for each in carry.motion))
        y, _, r, P, _ = motion
        ahead, scale, inertia = np.zeros((2, ny)), carry.scale.copy(), carry.system.degree == 2
        assert record.events is not None
        while t < end:
            h = min(carry.step[0], end - t)
            if h < 4.0 * np.spacing(end):
                if end - t < 4.0 * np.spacing(end):
                    break
                return Status.STEP_SIZE
            given = carry.given_in_steps(np.array([t, end if h == end - t else t + h]), c, h, tableau.b[0])

            def run(solver: Solver, first: int, last: int, h: float = h, given: Array = given) -> tuple[Status, int]:
                block = StepBlock(first, last, h, rtol * grid.h, given, carry.tol, carry.max_iter)
                return _take(carry, solver, record.stats, block, tableau, motion, ahead)

            scale[:] = carry.scale
            status, _ = with_fallbacks(run, carry.solver, carry.contacts, 0, 1)
            if status is not Status.SOLVED:
                carry.scale[:] = scale
                if status is not Status.NON_FINITE:
                    return status
                factor = 0.1
            else:
                factor = self._factor(carry, motion, given[0], ahead, h, (rtol, atol))
            if factor < 1.0:
                carry.scale[:] = scale
                carry.step[0] = factor * h
                record.stats.rejected += 1
                continue
            carry.step[0] = max(factor * h, carry.step[0] if h < carry.step[0] else 0.0)
            record.stats.steps += 1
            if (P[1, inertia] > 0.0).any() or ((r[0] > 0.0) != (r[1] > 0.0)).any():
                record.events += _happened(carry, np.array([t, t + h]), motion)
            np.maximum(carry.largest, np.abs(y[1]), out=carry.largest)
            carry.energy[0] = max(carry.energy[0], carry.energy_of(np.append(y[1], given[0, -1])))
            for each in motion:
                each[0] = each[1]
            t = end if h == end - t else t + h
        for each, of in zip(carry.motion, motion, strict=True):
            each[k + 1] = of[0]
        return Status.SOLVED

    def _factor(
        self,
        carry: RungeKuttaRun,
        motion: GridValues,
        given: Array,
        ahead: Array,
        h: float,
        tolerances: tuple[float, float],
    ) -> float:
        """Return the length of the next step in units of h; below 1 the step of h is to be taken again."""
        (y, dy, _, P, _), (before, error), ny = motion, ahead, ahead.shape[1]
        rtol, atol = (STEP_TOLERANCE * each for each in tolerances)
        allowed = carry.allowed(before, h, rtol, atol)
        size = max(carry.error(np.append(before, given[-1]), error, allowed, rtol), 1e-10)
        factor = float(np.clip(0.9 * size ** (-1.0 / (self.tableau.order_embedded + 1.0)), 0.2, 5.0))
        if size > 1.0:
            return factor
        # A penetration beyond the tolerance: back to where the line through both gaps is zero.
        C = carry.matrices.C[carry.system.degree > 0]
        u, u_next = C @ np.append(y[0], given[0]), C @ np.append(before, given[-1])
        bound = np.abs(C[:, :ny]) @ allowed + ACTIVE_GAP_FACTOR * ZERO_RTOL * (np.abs(C) @ carry.scale)
        begun = (u_next < -bound) & (u > bound)
        if begun.any():
            return float((u[begun] / (u[begun] - u_next[begun])).min())
        if (u_next < -bound).any():
            return 0.5
        if not P[1].any():
            lowest = _lowest(h, u, u_next, *(dy @ C[:, :ny].T))
            if ((u > bound) & (u_next > bound) & (lowest < -bound)).any():
                return 0.5
        return max(factor, 1.0)


def _metric(d: Dynamics, form: FirstOrderForm) -> Array:
    """Return G with ½ yᵀ G y the energy of springs and masses (ny, ny); zero of a system that has none."""
    ny, massive = form.constant, form.parts.massive
    G = np.zeros((ny, ny))
    if d.stores_energy:
        Q, speeds = form.Q[:, :ny], slice(ny - massive.shape[1], ny)
        G += Q.T @ d.K @ Q
        G[speeds, speeds] += massive.T @ d.M @ massive
    return G


def _lowest(h: float, u_0: Array, u_1: Array, rate_0: Array, rate_1: Array) -> Array:
    """Return the least values within a step of the cubics through gaps and their rates at both its ends."""
    s = SAMPLED[:, None]
    ends = (1.0 + 2.0 * s) * (1.0 - s) ** 2 * u_0 + s**2 * (3.0 - 2.0 * s) * u_1
    return np.asarray((ends + h * s * (1.0 - s) * ((1.0 - s) * rate_0 - s * rate_1)).min(axis=0))


def state_forces(inputs: Inputs) -> Callable[[Array, Matrices, Array], None]:
    """Return the function that writes the forces of springs and general forces at x; without the latter, `spring_forces`."""
    if not inputs.force_laws:
        return spring_forces

    def write(x: Array, system: Matrices, s: Array) -> None:
        """Write the forces s (ns + ng,) at x, which ends with t."""
        spring_forces(x, system, s[: len(system.law)])
        s[len(system.law) :] = inputs.motion_forces(float(x[-1]), x)

    return write


def _functions(run: RungeKuttaRun, solver: Solver) -> tuple[Callable[..., Any], Callable[..., Any]]:
    """Return `end_step` and `steps`, compiled or, if the solver or a force is written in Python, interpreted."""
    if solver.compiled and not run.inputs.force_laws:
        return end_step, steps
    return in_python(end_step, run.forces), in_python(steps, run.forces)


@lru_cache(maxsize=4)
def in_python(function: Callable[..., Any], forces: Callable[..., Any]) -> Callable[..., Any]:
    """Return a compiled function as the interpreter runs it, with the LCP solver's own kernel and the forces in it."""
    return interpreted(function, solve_law=interpreted(solve_law), spring_forces=forces)


def _take(
    run: RungeKuttaRun,
    solver: Solver,
    stats: Stats,
    block: StepBlock,
    tableau: Tableau,
    motion: GridValues,
    ahead: Array,
) -> tuple[Status, int]:
    """Take steps of one length, and count their cost."""
    _, step = _functions(run, solver)
    weights = Weights(tableau.matrix, np.array(tableau.b), tableau.error)
    now, room = (np.empty(len(run.scale)), run.scale), room_for(run.matrices, tableau.stages)
    code, reached, iterations, residual = step(block, run.matrices, weights, motion, now, ahead, room, solver.kernel)
    stats.add_lcps(tableau.stages * (reached - block.first), iterations, residual)
    return Status(code), reached


def _coordinates(
    run: RungeKuttaRun, t: Array, y: Array, dy: Array, r: Array, diverges: bool = False
) -> tuple[Array, Array]:
    """Return q and v (nt, n) from the states, their rates and the forces.

    A quasi-static node follows the others by its balance of forces; its velocity needs r', which keeps closed gaps closed.
    Where a run ``diverges``, the rounding of a gap is that of the states up to each instant, given from the start on.
    """
    form, inputs, system, ns = run.form, run.inputs, run.system, run.inputs.of_state
    given, generator = run.given(t), form.A[form.constant :, form.constant :]
    nl = len(generator)
    signals, loads = given[:, :nl], given[:, nl : nl + len(inputs.loads)]
    X, rate = np.column_stack([y, signals]), np.column_stack([dy, signals @ generator.T])
    Q_w, D_w = inputs.Q[:, ns:], inputs.D[:, ns:]
    q = X @ form.Q.T + r @ form.Qr.T + loads @ Q_w.T
    v = rate @ form.Q.T
    if form.Qr.any() or Q_w.any():
        δ = 1e-6 * run.grid.t_end
        dloads = (run.given(t + δ) - run.given(t - δ))[:, nl : nl + len(inputs.loads)] / (2.0 * δ)
        v += dloads @ Q_w.T
        u, du = X @ form.C.T + loads @ D_w.T, rate @ form.C.T + dloads @ D_w.T
        size = np.abs(run.matrices.C)
        so_far = np.maximum.accumulate(np.abs(X), axis=0) if diverges else None
        tiny = ZERO_RTOL * size @ run.scale if so_far is None else ZERO_RTOL * so_far @ size.T
        closed = ((r > 0.0) | ((u <= tiny) & (du < 0.0))) & (system.degree == 0)
        for pattern in np.unique(closed, axis=0):
            rows, here = np.flatnonzero(pattern), (closed == pattern).all(axis=1)
            D = form.D[np.ix_(rows, rows)]
            v[here] -= np.linalg.solve(D, du[np.ix_(here, rows)].T).T @ form.Qr[:, rows].T
    return q, v


def _write(run: RungeKuttaRun, record: Record, first: int, last: int, diverges: bool = False) -> None:
    """Write the grid points first ... last to the record.

    All are written anew of a run that ``diverges``: its scale has grown since, by how much depends on the length of a block
    of steps, and that on the clock.
    """
    if last >= first:
        here = slice(first, last + 1)
        y, dy, r, _, _ = (each[here] for each in run.motion)
        record.reaction[here] = r
        record.q[here], record.v[here] = _coordinates(run, record.t[here], y, dy, r, diverges)


def _happened(run: RungeKuttaRun, t: Array, motion: GridValues) -> list[Event]:
    """Return the events of a step from the first to the second of two states, with the impulses P of the second.

    A contact of degree 0 closes where the line through its gaps is zero, and any contact opens where that of u^(ρ) is, which
    is -G r while r pushes, or at the end of the step, where a load jumps there. The limits of an impact are the state after
    it, moved back to its instant, and that without P.
    """
    d, degree, (y, dy, r, P, since) = run.system.dynamics, run.system.degree, motion
    C, O, O_s, G, B = run.matrices.C, run.matrices.O, run.matrices.O_s, run.matrices.G, run.matrices.B  # noqa: E741
    q, v = _coordinates(run, t, y, dy, r)
    given = run.given(t)
    after = np.append(y[1], given[1])
    gap = np.array([C @ np.append(y[0], given[0]), C @ after])
    s = np.empty(run.inputs.of_state)
    run.forces(after, run.matrices, s)
    x_left = np.append(y[1], run.given_in_steps(t, np.ones(1), float(t[1] - t[0]))[0, 0])
    parting = np.array([-r[0] * np.diag(G), O @ x_left + O_s @ s + G @ r[1]])
    left, right = State(q[0], v[0], r[0]), State(q[1], v[1], r[1])
    closed = r > 0.0
    if t[0] == 0.0:
        # Contacts closed at the start are so even if their force starts from zero.
        closed[0] |= (gap[0] <= 0.0) & closed[1]
    found = []
    for i, contact in enumerate(d.contacts):
        meets = _zero(t, gap[:, i]) if degree[i] == 0 else float(t[1] - since[1, i])
        if degree[i] == 2 and P[1, i] > 0.0:
            back = y[1] - since[1, i] * dy[1]
            before, behind = (
                _at_event(run, meets, x, dy[1], force) for x, force in ((back - B @ P[1], r[0]), (back, r[1]))
            )
            law = d.laws_of_impact((P[1] > 0.0) & (since[1] == since[1, i]))[i]
            found.append(Event(meets, contact.name, "impact", before, behind, float(P[1, i]), law))
        if closed[1, i] and not closed[0, i]:
            found.append(Event(meets, contact.name, "close", left, right))
        if closed[0, i] and not closed[1, i]:
            found.append(Event(_zero(t, parting[:, i]), contact.name, "open", left, right))
    return sorted(found, key=lambda event: event.t)


def _at_event(run: RungeKuttaRun, t: float, y: Array, dy: Array, r: Array) -> State:
    """Return one limit of an impact; the velocities of nodes with mass are from y, of other nodes from dy."""
    q, v = _coordinates(run, np.array([t]), y[None], dy[None], r[None])
    massive = run.form.parts.massive
    return State(q[0], v[0] + massive @ (y[len(y) - massive.shape[1] :] - massive.T @ v[0]), r)


def _zero(t: Array, values: Array) -> float:
    """Return the instant at which the line through two values of different sign is zero, or the later instant."""
    if not min(values) < 0.0 < max(values):
        return float(t[1])
    return float(t[0] + (t[1] - t[0]) * values[0] / (values[0] - values[1]))
