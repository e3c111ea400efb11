r"""The compiled loop of all methods with linear steps.

The *knowns* of a step are the state y, the constant 1 and the loads. Its *unknowns* are, for each contact law, the
impulses P of the contacts and the forces s of the non-linear springs. Every quantity of the step is a row of a table with
one column for each of these numbers: in turn for each law

- the activation, a contact being active where it is negative (nc rows),
- L of the law 0 <= P ⟂ L >= 0 (nc rows),
- the rates and the penetrations of the springs in this law (ns rows each),

then the new state (N rows), the reactions (nc rows), and the residual forces at the static coordinates. The loop adds the
columns of the knowns, and those of the unknowns once they are solved.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import types

from lcpimpact.arrays import Array, Flags, Indices
from lcpimpact.compiled import compiled, cube, f8, flags, function_at, i8, indices, matrix, named_tuple, vector
from lcpimpact.errors import Status
from lcpimpact.integrators.stepping.banded_table import BANDED, DENSE, BandedTable, find_rows
from lcpimpact.integrators.stepping.friction import active_friction, solve_same_case
from lcpimpact.integrators.stepping.impulse_paths import PATHS, Paths, closes, write_shifts
from lcpimpact.integrators.stepping.kept_basis import KEPT, KeptBasis, solve_from_basis
from lcpimpact.integrators.stepping.law import (
    PROBLEM,
    SOLVING,
    SPRING_ROOM,
    SPRING_SOLVER,
    ContactProblem,
    Solving,
    SpringRoom,
    Springs,
    SpringSolver,
    restrict,
    room_for_springs,
    solve_active,
    solve_law,
)
from lcpimpact.integrators.stepping.static_balance import STATIC, Static, balance
from lcpimpact.lcp.friction import FRICTION, FrictionRows, friction_maps, unknowns
from lcpimpact.lcp.problem import KERNEL
from lcpimpact.lcp.solver import Kernel

SOLVED, NON_FINITE = int(Status.SOLVED), int(Status.NON_FINITE)

HOLDING_RTOL = 1e-9
"""Slip rate of surfaces that stick, relative to what their friction can change in a step."""

ROUNDING = 16.0 * float(np.finfo(float).eps)

MAX_ROWS = 3
"""Maximum number of rows by which a formulation of friction replaces one of its rows."""

NO_SPRINGS = room_for_springs(0, 0)

FEW_IMPULSES = 16
"""Number of impulses of a banded step up to which adding their dense columns is faster than to solve its equations again."""

SWITCHES = -1
"""Status of steps that stop at a change of the active contacts."""


class StepTable(NamedTuple):
    """The coefficients of a step of one length.

    Attributes
    ----------
    known : (N + 1 + nl, rows) array        columns of y, 1 and the loads
    unknown : (m (nc + ns), rows) array     columns of P and s of each law
    W : (m, nc, nc) array                   L by P of each law
    lower, upper : (m, nc) arrays           bounds of P
    strictly : (m,) array                   whether a contact needs a negative activation, zero not being enough
    near : (m, nc) array                    gap by P up to which a contact that has just pushed takes part, as rounding
                                            may have opened it
    """

    known: Array
    unknown: Array
    W: Array
    lower: Array
    upper: Array
    strictly: Flags
    near: Array


class StepSprings(NamedTuple):
    """The non-linear springs: gap, K, n, b, c of each (ns, 5), θh in s of each law (m,), and h."""

    law: Array
    θh: Array
    h: float


class StepState(NamedTuple):
    """State carried from step to step.

    Attributes
    ----------
    y : (N,) array
    P : (m, nc) array       the impulses of each law, 0 at inactive contacts
    kept : KeptBasis        the basis of the last LCP, where it is kept
    """

    y: Array
    P: Array
    kept: KeptBasis


class StepOutput(NamedTuple):
    """Results of the steps: q[k + 1] and v[k + 1] (n,), and the mean forces r[k] (nc,)."""

    q: Array
    v: Array
    r: Array


class Block(NamedTuple):
    """The steps of a block.

    Attributes
    ----------
    first, last : int       indices of the first and the last instant
    loads : (steps, nl)     variable loads, one row a step
    tol, max_iter           tolerance of the LCP solver, and its limit of iterations
    stops : bool            whether to stop before a step with other active contacts than the last one
    keeps : bool            whether the basis of the LCP is kept from step to step
    """

    first: int
    last: int
    loads: Array
    tol: float
    max_iter: int
    stops: bool
    keeps: bool


class Workspace(NamedTuple):
    """Arrays a step works in: sums (rows,), the active contacts of a law (nc,), their z (nc,), spring forces s (ns,).

    Those of banded equations are their knowns and unknowns x, and right sides.
    """

    sums: Array
    active: Indices
    z: Array
    s: Array
    springs: SpringRoom
    x: Array
    right: Array


def room_for(table: StepTable, ns: int, banded: BandedTable = DENSE) -> Workspace:
    """Return arrays for the steps of a table with ns springs."""
    nc = table.W.shape[1]
    springs = room_for_springs(MAX_ROWS * nc, ns) if ns else NO_SPRINGS
    right = np.zeros(len(banded.right.c))
    x = np.zeros(len(table.known) + len(table.W) * nc + len(right))
    return Workspace(
        np.zeros(table.known.shape[1]), np.zeros(nc, np.int64), np.zeros(nc), np.zeros(ns), springs, x, right
    )


class StaticFriction(NamedTuple):
    """Static friction above the kinetic one, and its memory in a step; no rows without.

    Attributes
    ----------
    kinetic, static : (nf,) arrays      coefficients of all rows with friction
    H : (nf, n) array                   their rows of U
    U, near : (nf,) arrays              U at the start of the step, 0 for rows that stick, and its rounding
    turned : (nf,) array                whether a row that slides would turn back in the step
    """

    kinetic: Array
    static: Array
    H: Array
    U: Array
    near: Array
    turned: Flags


TABLE: Any = named_tuple((matrix, matrix, cube, matrix, matrix, flags, matrix), StepTable)
STEP_SPRINGS: Any = named_tuple((matrix, vector, f8), StepSprings)
STEP_STATE: Any = named_tuple((vector, matrix, KEPT), StepState)
PATH: Any = named_tuple((matrix, matrix, matrix), StepOutput)
BLOCK: Any = named_tuple((i8, i8, matrix, f8, i8, types.boolean, types.boolean), Block)
ROOM: Any = named_tuple((vector, indices, vector, vector, SPRING_ROOM, vector, vector), Workspace)
STATIC_FRICTION: Any = named_tuple((vector, vector, matrix, vector, vector, flags), StaticFriction)
FEATURES: Any = types.Tuple((STEP_SPRINGS, PATHS, STATIC, FRICTION))
ALL_FEATURES: Any = types.Tuple((STEP_SPRINGS, PATHS, STATIC, FRICTION, STATIC_FRICTION))
CHANGE: Any = types.Tuple((types.boolean, matrix, matrix))
SOLVERS: Any = types.Tuple((SOLVING, SPRING_SOLVER))
RESULT: Any = types.Tuple((i8, i8, i8, i8, f8))

solver_at, spring_solver_at = function_at(KERNEL), function_at(SPRING_SOLVER)


@compiled(types.void(vector, vector), inline="always", allocates=False)
def copy(source: Array, target: Array) -> None:
    """Copy a vector."""
    for i in range(len(target)):
        target[i] = source[i]


@compiled(types.void(vector, f8, matrix, i8, i8), inline="always", allocates=False)
def add_column(sums: Array, x: float, columns: Array, j: int, first: int) -> None:
    """Add x times column j, from a given row."""
    if x != 0.0:
        for i in range(first, len(sums)):
            sums[i] += x * columns[j, i]


@compiled(types.Tuple((i8, i8, f8))(TABLE, i8, vector, i8, ROOM, SOLVING), inline="always", allocates=False)
def solve_rows(
    table: StepTable, law: int, q: Array, na: int, room: Workspace, solving: Solving
) -> tuple[int, int, float]:
    """Solve a law on its ``na`` active rows, from the guess in the workspace: status, iterations, residual."""
    rows = ContactProblem(table.W[law], q, table.lower[law], table.upper[law])
    if na < len(q):
        return solve_active(rows, room.active[:na], room.z[:na], solving)
    return solve_law(rows, room.z, solving)


@compiled(types.Tuple((i8, i8, f8))(TABLE, vector, i8, ROOM, KEPT, SOLVING))
def solve_many_rows(
    table: StepTable, q: Array, na: int, room: Workspace, kept: KeptBasis, solving: Solving
) -> tuple[int, int, float]:
    """Solve a single law on its ``na`` active rows from the basis of the last step, if it can."""
    rows = ContactProblem(table.W[0], q, table.lower[0], table.upper[0])
    residual = solve_from_basis(rows, room.active[:na], kept, room.z[:na], solving.tol)
    if residual < np.inf:
        return SOLVED, 0, residual
    return solve_rows(table, 0, q, na, room, solving)


@compiled(types.void(TABLE, i8, i8, i8, ROOM, vector), inline="always", allocates=False)
def add_impulses(table: StepTable, column: int, na: int, first: int, room: Workspace, P: Array) -> None:
    """Add the columns of the ``na`` impulses in the workspace, from a given row, and store them in P."""
    for i in range(len(P)):
        P[i] = 0.0
    for a in range(na):
        P[room.active[a]] = room.z[a]
        add_column(room.sums, room.z[a], table.unknown, column + room.active[a], first)


@compiled(types.void(TABLE, STEP_SPRINGS, types.UniTuple(i8, 2), ROOM), allocates=False)
def couple_springs(table: StepTable, springs: StepSprings, which: tuple[int, int], room: Workspace) -> None:
    """Write how the springs in law ``which[0]`` couple with its ``which[1]`` active rows, and their free motion."""
    (law, na), nc, ns, (vectors, HGs, NG, _, NGs, _) = which, table.W.shape[1], len(springs.law), room.springs
    rates, P, at_s = law * 2 * (nc + ns) + 2 * nc, law * (nc + ns), law * (nc + ns) + nc
    for j in range(ns):
        y_free = room.sums[rates + j]
        vectors[0, j], vectors[1, j] = y_free, room.sums[rates + ns + j] + springs.θh[law] * y_free
        vectors[2, j], room.s[j] = y_free, 0.0
        for a in range(na):
            HGs[a, j] = table.unknown[at_s + j, rates - nc + room.active[a]]
            NG[j, a] = table.unknown[P + room.active[a], rates + j]
        for i in range(ns):
            NGs[j, i] = table.unknown[at_s + i, rates + j]


@compiled(
    types.Tuple((i8, i8, i8, f8))(TABLE, STEP_SPRINGS, ROOM, types.UniTuple(i8, 2), PROBLEM, CHANGE, vector, SOLVERS)
)
def solve_once(
    table: StepTable,
    springs: StepSprings,
    room: Workspace,
    which: tuple[int, int],
    rows: ContactProblem,
    change: tuple[bool, Array, Array],
    z: Array,
    solvers: tuple[Solving, SpringSolver],
) -> tuple[int, int, int, float]:
    """Solve rows and springs from the guess z; ``change`` are E and T of rows that friction has changed, if it has."""
    (rough, E, T), (law, na), (solving, solve_springs), coupled = change, which, solvers, room.springs
    if len(springs.law) > 0:
        couple_springs(table, springs, which, room)
        if rough:
            m = len(z)
            HGs, NG = E @ coupled.HGs[:na], np.ascontiguousarray(coupled.NG[:, :na]) @ T
            coupled.HGs[:m], coupled.NG[:, :m] = HGs, NG
        y_free, δ, y = coupled.vectors[0], coupled.vectors[1], coupled.vectors[2]
        now = Springs(springs.law, springs.θh[law], springs.h, coupled)
        status, count, newton, residual = solve_springs(rows, now, y_free, δ, z, y, room.s, solving)
    else:
        newton = 0
        status, count, residual = solve_law(rows, z, solving)
    if rough:
        room.z[:na] = T @ z
    return status, count, newton, residual


@compiled(
    types.Tuple((i8, i8, i8, f8))(TABLE, FEATURES, STEP_STATE, ROOM, types.UniTuple(i8, 2), SOLVING, SPRING_SOLVER)
)
def solve_features(
    table: StepTable,
    features: tuple[StepSprings, Paths, Static, FrictionRows],
    state: StepState,
    room: Workspace,
    which: tuple[int, int],
    solving: Solving,
    solve_springs: SpringSolver,
) -> tuple[int, int, int, float]:
    """Solve law ``which[0]`` on its ``which[1]`` active rows with springs and friction; again while impulse paths close."""
    (springs, paths, _, all_friction), (law, na) = features, which
    nc, ns, n = table.W.shape[1], len(springs.law), paths.H.shape[1]
    first, active, P = law * 2 * (nc + ns) + nc, room.active[:na], room.z[:na]
    all_rows = ContactProblem(table.W[law], room.sums[first : first + nc], table.lower[law], table.upper[law])
    if all_friction.continues and ns == 0 and len(paths.lines) == 0:
        residual = solve_same_case(all_rows, active, all_friction, state.P[law], P)
        if residual <= solving.tol:
            return SOLVED, 0, 0, residual
    rough, rows, z = len(all_friction.rows) > 0, all_rows, P
    if rough or na < nc or len(paths.lines) > 0:
        rows = restrict(all_rows, active)
    q, E, T = rows.q, rows.W, rows.W  # E and T are placeholders without friction
    if rough:
        friction = active_friction(all_friction, active)
        E, T, V, lower, upper = friction_maps(rows.W, rows.lower, rows.upper, friction)
        rows, z = ContactProblem(E @ rows.W @ T + V, E @ q, lower, upper), unknowns(T, P, friction)
    solvers = solving, solve_springs
    status, iterations, newton, residual = solve_once(table, springs, room, which, rows, (rough, E, T), z, solvers)
    if len(paths.lines) == 0:
        return status, iterations, newton, residual
    closed, shift, at_active, q = np.zeros(len(paths.lines), np.bool_), np.zeros(nc), np.zeros(na), q.copy()
    while status == SOLVED and closes(paths.lines, closed, active, P):
        write_shifts(paths, closed, state.y[:n], state.y[n : 2 * n], shift)
        for a in range(na):
            at_active[a] = q[a] + shift[active[a]] / paths.h
        rows.q[:] = E @ at_active if rough else at_active
        status, count, tried, residual = solve_once(table, springs, room, which, rows, (rough, E, T), z, solvers)
        iterations, newton = iterations + count, newton + tried
    return status, iterations, newton, residual


@compiled(types.void(TABLE, i8, f8, FRICTION, STATIC_FRICTION, STEP_STATE))
def recall_slip(
    table: StepTable, law: int, h: float, friction: FrictionRows, memory: StaticFriction, state: StepState
) -> None:
    """Give what sticks at the start of a step its static coefficient of friction, and what slides its kinetic one."""
    n = memory.H.shape[1]
    for k in range(len(memory.static)):
        U, size, i = 0.0, 0.0, friction.rows[k]
        for j in range(n):
            U += memory.H[k, j] * state.y[n + j]
            # The mean rate of a node with prescribed motion is a difference of its places.
            size += abs(memory.H[k, j]) * (abs(state.y[n + j]) + abs(state.y[j]) / h)
        memory.near[k], memory.turned[k] = ROUNDING * size, False
        reach = memory.static[k] * abs(table.W[law, i, i]) * max(state.P[law, friction.normals[k]], 0.0)
        sticks = abs(U) <= memory.near[k] + HOLDING_RTOL * reach
        memory.U[k], friction.mu[k] = (0.0, memory.static[k]) if sticks else (U, memory.kinetic[k])


@compiled(types.boolean(TABLE, types.UniTuple(i8, 2), FRICTION, STATIC_FRICTION, ROOM))
def breaks_loose(
    table: StepTable, which: tuple[int, int], friction: FrictionRows, memory: StaticFriction, room: Workspace
) -> bool:
    """Return whether a law must be solved again, since what sticks slips, now with μ, or slip turns back, now with μ_s.

    ``which`` are the law and its number of active rows.
    """
    (law, na), nc, ns, again = which, table.W.shape[1], len(room.s), False
    column = law * (nc + ns)
    for k in range(len(memory.static)):
        i, reach = friction.rows[k], 0.0
        row = 2 * column + nc + i
        L = room.sums[row]
        for a in range(na):
            L += table.unknown[column + room.active[a], row] * room.z[a]
            if room.active[a] == friction.normals[k]:
                reach = friction.mu[k] * abs(table.W[law, i, i]) * room.z[a]
        for j in range(ns):
            L += table.unknown[column + nc + j, row] * room.s[j]
        moves, static = abs(L) > memory.near[k] + HOLDING_RTOL * reach, friction.mu[k] > memory.kinetic[k]
        if moves and static and (memory.U[k] == 0.0 or memory.turned[k]):
            friction.mu[k], again = memory.kinetic[k], True
        elif moves and memory.U[k] * L < 0.0 and not memory.turned[k]:
            friction.mu[k], memory.turned[k], again = memory.static[k], True, True
    return again


@compiled(types.void(matrix, vector, matrix, i8, vector), inline="always", allocates=False)
def add_knowns(columns: Array, y: Array, loads: Array, k: int, sums: Array) -> None:
    """Write the sums of the columns of y, 1 and the loads of step k."""
    N = len(y)
    for i in range(len(sums)):
        sums[i] = columns[N, i]
    for j in range(N):
        add_column(sums, y[j], columns, j, 0)
    for j in range(loads.shape[1]):
        add_column(sums, loads[k, j], columns, N + 1 + j, 0)


@compiled(types.void(TABLE, BANDED, STEP_STATE, matrix, i8, ROOM), inline="always", allocates=False)
def begin_step(table: StepTable, banded: BandedTable, state: StepState, loads: Array, k: int, room: Workspace) -> None:
    """Write the rows of step k without impulses."""
    if len(banded.factors) == 0:
        add_knowns(table.known, state.y, loads, k, room.sums)
        return
    x, N, known = room.x, len(state.y), len(table.known)
    copy(state.y, x[:N])
    for j in range(loads.shape[1]):
        x[N + 1 + j] = loads[k, j]
    for j in range(known, known + state.P.size):
        x[j] = 0.0
    find_rows(banded, x, room.right, room.sums)


@compiled(types.void(TABLE, BANDED, i8, i8, i8, ROOM, STEP_STATE), inline="always", allocates=False)
def end_law(
    table: StepTable, banded: BandedTable, law: int, na: int, after: int, room: Workspace, state: StepState
) -> None:
    """Add the impulses of a law to the rows from ``after`` on, and store them in the state."""
    P, ns = state.P[law], len(room.s)
    nc = len(P)
    if len(banded.factors) == 0:
        add_impulses(table, law * (nc + ns), na, after, room, P)
        return
    first = len(table.known) + law * nc
    add_impulses(table, law * nc, na if na <= FEW_IMPULSES else 0, after, room, P)
    for a in range(na):
        P[room.active[a]] = room.z[a]
    copy(P, room.x[first : first + nc])
    if na > FEW_IMPULSES:
        find_rows(banded, room.x, room.right, room.sums)


@compiled(i8(TABLE, i8, i8, vector, ROOM), inline="always", allocates=False)
def choose_rows(table: StepTable, law: int, first: int, P: Array, room: Workspace) -> int:
    """Write the active contacts of a law whose rows begin at ``first``, with P as a guess of z; return their number."""
    na, strictly = 0, table.strictly[law]
    for i in range(len(P)):
        touching = room.sums[first + i]
        if touching < table.near[law, i] * max(P[i], 0.0) or (touching == 0.0 and not strictly):
            room.active[na], room.z[na] = i, P[i]
            na += 1
    return na


@compiled(i8(FRICTION, i8, vector, ROOM), inline="always", allocates=False)
def add_friction_rows(friction: FrictionRows, na: int, P: Array, room: Workspace) -> int:
    """Add the rows with friction whose normal rows are among the ``na`` active ones; return the number of all."""
    last = na
    for k in range(len(friction.rows)):
        for a in range(na):
            if room.active[a] == friction.normals[k]:
                room.active[last], room.z[last] = friction.rows[k], P[friction.rows[k]]
                last += 1
    return last


@compiled(types.boolean(indices, vector, vector), inline="always", allocates=False)
def switches(active: Indices, z: Array, P: Array) -> bool:
    """Return whether a contact becomes active or inactive between impulses P and z of the active ones."""
    changed = False
    for a in range(len(active)):
        changed = changed or (z[a] > 0.0) != (P[active[a]] > 0.0)
    return changed


@compiled(RESULT(BLOCK, TABLE, BANDED, ALL_FEATURES, STEP_STATE, PATH, ROOM, KERNEL, SPRING_SOLVER), allocates=False)
def steps(
    block: Block,
    table: StepTable,
    banded: BandedTable,
    features: tuple[StepSprings, Paths, Static, FrictionRows, StaticFriction],
    state: StepState,
    path: StepOutput,
    room: Workspace,
    solve: Kernel,
    solve_springs: SpringSolver,
) -> tuple[int, int, int, int, float]:
    """Take a block of steps and overwrite the state.

    Returns the status, SWITCHES at a change of the active contacts, the step reached, the sums of the LCP and Newton
    iterations, and the largest independent residual.
    """
    (springs, paths, static, friction, memory), sums, active, z = features, room.sums, room.active, room.z
    n, nc, ns, N, m = path.q.shape[1], table.W.shape[1], len(springs.law), len(state.y), len(table.W)
    new = m * 2 * (nc + ns)
    forces = new + N
    simple, solving = ns == 0 and len(paths.lines) == 0, Solving(block.tol, block.max_iter, solve)
    simple, holds = simple and len(friction.rows) == 0, len(memory.static) > 0
    iterations, newton, worst = 0, 0, 0.0
    for k in range(block.first, block.last):
        begin_step(table, banded, state, block.loads, k - block.first, room)
        for law in range(m):
            first = law * 2 * (nc + ns)
            after, P = first + 2 * (nc + ns), state.P[law]
            na = choose_rows(table, law, first, P, room)
            if len(friction.rows) > 0:
                na = add_friction_rows(friction, na, P, room)
            status, count, tried, residual = SOLVED, 0, 0, 0.0
            if simple and na > 0 and block.keeps:
                status, count, residual = solve_many_rows(table, sums[nc:after], na, room, state.kept, solving)
            elif simple and na > 0:
                status, count, residual = solve_rows(table, law, sums[first + nc : after], na, room, solving)
            elif na + ns > 0:
                again = True
                if holds:
                    recall_slip(table, law, springs.h, friction, memory, state)
                while again and status == SOLVED:
                    status, count, tried, residual = solve_features(
                        table, (springs, paths, static, friction), state, room, (law, na), solving, solve_springs
                    )
                    again = holds and breaks_loose(table, (law, na), friction, memory, room)
            iterations += count
            newton += tried
            if status != SOLVED:
                return status, k, iterations, newton, worst
            worst = max(worst, residual)
            if block.stops and (k == 0 or switches(active[:na], z, P)):
                return SWITCHES, k, iterations, newton, worst
            end_law(table, banded, law, na, after, room, state)
            for j in range(ns):
                add_column(sums, room.s[j], table.unknown, law * (nc + ns) + nc + j, after)
        for i in range(n):
            if not abs(sums[new + i]) < np.inf:
                return NON_FINITE, k, iterations, newton, worst
        copy(sums[forces : forces + nc], path.r[k])
        if len(static.SKS) > 0:
            balance(static, sums[forces + nc :], path.r[k], sums[new : new + n])
        copy(sums[new : new + N], state.y)
        copy(state.y[:n], path.q[k + 1])
        copy(state.y[n : 2 * n], path.v[k + 1])
    return SOLVED, block.last, iterations, newton, worst


@compiled(RESULT(BLOCK, TABLE, BANDED, ALL_FEATURES, STEP_STATE, PATH, ROOM, i8, i8), allocates=False)
def take_steps(
    block: Block,
    table: StepTable,
    banded: BandedTable,
    features: tuple[StepSprings, Paths, Static, FrictionRows, StaticFriction],
    state: StepState,
    path: StepOutput,
    room: Workspace,
    solve: Any,
    solve_springs: Any,
) -> tuple[int, int, int, int, float]:
    """Take `steps`, with the solvers by their addresses."""
    return steps(block, table, banded, features, state, path, room, solver_at(solve), spring_solver_at(solve_springs))
