"""Laws of a step that are more than plain rows: laws with springs, friction and impulse paths, and laws of many rows.

The kernel calls `solve_features` and `solve_kept_rows` by their addresses, so that steps without them do not compile them.
"""

from __future__ import annotations

import numpy as np

from lcpimpact.arrays import Matrix, Vector
from lcpimpact.compiled import compiled
from lcpimpact.integrators.stepping.friction import active_friction, solve_same_case
from lcpimpact.integrators.stepping.impulse_paths import closes, write_shifts
from lcpimpact.integrators.stepping.kept_basis import solve_from_basis
from lcpimpact.integrators.stepping.kernel import (
    SOLVED,
    Features,
    StaticFriction,
    StepSprings,
    StepState,
    StepTable,
    Workspace,
    solve_rows,
)
from lcpimpact.integrators.stepping.law import ContactProblem, Solving, Springs, SpringSolver, restrict, solve_law
from lcpimpact.integrators.stepping.strong_dashpots import WEIGHTS
from lcpimpact.lcp.friction import FrictionRows, friction_maps, unknowns
from lcpimpact.numerics.rounding import EPS
from lcpimpact.scheme.power_law import greatest_rebound

HOLDING_RTOL = 1e-9
"""Slip rate of surfaces that stick, relative to what their friction can change in a step."""

SLIP_ROUNDING = 16.0 * EPS
"""Rounding error of a slip rate, relative to its terms."""


@compiled()
def solve_kept_rows(
    table: StepTable,
    features: Features,
    state: StepState,
    room: Workspace,
    which: tuple[int, int],
    solving: Solving,
    solve_springs: SpringSolver,
) -> tuple[int, int, int, float]:
    """Solve the only law of a step on its ``which[1]`` active plain rows from the basis of the last step, if it can."""
    _, na = which
    nc = table.W.shape[1]
    q = room.sums[nc : 2 * nc]
    rows = ContactProblem(table.W[0], q, table.lower[0], table.upper[0])
    residual = solve_from_basis(rows, room.active[:na], state.kept, room.z[:na], solving.tol)
    if residual < np.inf:
        return SOLVED, 0, 0, residual
    status, count, residual = solve_rows(table, 0, q, na, room, solving)
    return status, count, 0, residual


@compiled()
def couple_springs(table: StepTable, springs: StepSprings, which: tuple[int, int], room: Workspace) -> None:
    """Write the coupling of the springs in law ``which[0]`` with its ``which[1]`` active rows, and their free motion."""
    law, na = which
    nc = table.W.shape[1]
    ns = len(springs.law)
    vectors = room.springs.vectors
    HGs = room.springs.HGs
    NG = room.springs.NG
    NGs = room.springs.NGs
    rates = law * 2 * (nc + ns) + 2 * nc
    P = law * (nc + ns)
    at_s = law * (nc + ns) + nc
    for j in range(ns):
        y_free = room.sums[rates + j]
        vectors[0, j] = y_free
        vectors[1, j] = room.sums[rates + ns + j] + springs.θh[law] * y_free
        vectors[2, j], room.s[j] = y_free, 0.0
        for a in range(na):
            HGs[a, j] = table.unknown[at_s + j, rates - nc + room.active[a]]
            NG[j, a] = table.unknown[P + room.active[a], rates + j]
        for i in range(ns):
            NGs[j, i] = table.unknown[at_s + i, rates + j]


@compiled()
def solve_once(
    table: StepTable,
    springs: StepSprings,
    room: Workspace,
    which: tuple[int, int],
    rows: ContactProblem,
    change: tuple[bool, Matrix, Matrix],
    z: Vector,
    solvers: tuple[Solving, SpringSolver],
) -> tuple[int, int, int, float]:
    """Solve rows and springs from the guess z; ``change`` are E and T of rows that friction has changed, if it has."""
    rough, E, T = change
    law, na = which
    solving, solve_springs = solvers
    coupled = room.springs
    if len(springs.law) > 0:
        couple_springs(table, springs, which, room)
        if rough:
            m = len(z)
            HGs = E @ coupled.HGs[:na]
            NG = np.ascontiguousarray(coupled.NG[:, :na]) @ T
            coupled.HGs[:m], coupled.NG[:, :m] = HGs, NG
        y_free = coupled.vectors[0]
        δ = coupled.vectors[1]
        y = coupled.vectors[2]
        now = Springs(springs.law, springs.θh[law], springs.h, coupled)
        status, count, newton, residual = solve_springs(rows, now, y_free, δ, z, y, room.s, solving)
    else:
        newton = 0
        status, count, residual = solve_law(rows, z, solving)
    if rough:
        room.z[:na] = T @ z
    return status, count, newton, residual


@compiled()
def solve_in_turn(
    table: StepTable,
    features: Features,
    state: StepState,
    room: Workspace,
    which: tuple[int, int],
    solving: Solving,
    solve_springs: SpringSolver,
) -> tuple[int, int, int, float]:
    """Solve law ``which[0]`` on its ``which[1]`` active rows with springs and friction; again while impulse paths close."""
    springs, paths, _, all_friction, _ = features
    law, na = which
    nc = table.W.shape[1]
    ns = len(springs.law)
    n = paths.H.shape[1]
    first = law * 2 * (nc + ns) + nc
    active = room.active[:na]
    P = room.z[:na]
    all_rows = ContactProblem(table.W[law], room.sums[first : first + nc], table.lower[law], table.upper[law])
    if all_friction.continues and ns == 0 and len(paths.lines) == 0:
        residual = solve_same_case(all_rows, active, all_friction, state.P[law], P)
        if residual <= solving.tol:
            return SOLVED, 0, 0, residual
    rough = len(all_friction.rows) > 0
    rows = all_rows
    z = P
    if rough or na < nc or len(paths.lines) > 0:
        rows = restrict(all_rows, active)
    q, E, T = rows.q, rows.W, rows.W  # E and T are placeholders without friction
    if rough:
        friction = active_friction(all_friction, active)
        E, T, V, lower, upper = friction_maps(rows.W, rows.lower, rows.upper, friction)
        rows = ContactProblem(E @ rows.W @ T + V, E @ q, lower, upper)
        z = unknowns(T, P, friction)
    solvers = solving, solve_springs
    status, iterations, newton, residual = solve_once(table, springs, room, which, rows, (rough, E, T), z, solvers)
    if len(paths.lines) == 0:
        return status, iterations, newton, residual
    closed = np.zeros(len(paths.lines), np.bool_)
    shift = np.zeros(nc)
    at_active = np.zeros(na)
    q = q.copy()
    while status == SOLVED and closes(paths.lines, closed, active, P):
        write_shifts(paths, closed, state.y[:n], state.y[n : 2 * n], shift)
        for a in range(na):
            at_active[a] = q[a] + shift[active[a]] / paths.h
        rows.q[:] = E @ at_active if rough else at_active
        status, count, tried, residual = solve_once(table, springs, room, which, rows, (rough, E, T), z, solvers)
        iterations, newton = iterations + count, newton + tried
    return status, iterations, newton, residual


@compiled()
def recall_slip(
    table: StepTable, law: int, h: float, friction: FrictionRows, memory: StaticFriction, state: StepState
) -> None:
    """Set the coefficient of friction in a step: static for rows that stick at its start, kinetic for rows that slide."""
    n = memory.H.shape[1]
    for k in range(len(memory.static)):
        U = 0.0
        size = 0.0
        i = friction.rows[k]
        for j in range(n):
            U += memory.H[k, j] * state.y[n + j]
            # The mean rate of a node with prescribed motion is a difference of its places.
            size += abs(memory.H[k, j]) * (abs(state.y[n + j]) + abs(state.y[j]) / h)
        memory.near[k], memory.turned[k] = SLIP_ROUNDING * size, False
        reach = memory.static[k] * abs(table.W[law, i, i]) * max(state.P[law, friction.normals[k]], 0.0)
        sticks = abs(U) <= memory.near[k] + HOLDING_RTOL * reach
        memory.U[k], friction.mu[k] = (0.0, memory.static[k]) if sticks else (U, memory.kinetic[k])


@compiled()
def breaks_loose(
    table: StepTable, which: tuple[int, int], friction: FrictionRows, memory: StaticFriction, room: Workspace
) -> bool:
    """Return whether a law must be solved again, since a sticking row slips, now with μ, or slip turns back, now with μ_s.

    ``which`` are the law and its number of active rows.
    """
    law, na = which
    nc = table.W.shape[1]
    ns = len(room.s)
    again = False
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
        moves = abs(L) > memory.near[k] + HOLDING_RTOL * reach
        static = friction.mu[k] > memory.kinetic[k]
        if moves and static and (memory.U[k] == 0.0 or memory.turned[k]):
            friction.mu[k], again = memory.kinetic[k], True
        elif moves and memory.U[k] * L < 0.0 and not memory.turned[k]:
            friction.mu[k] = memory.static[k]
            memory.turned[k] = True
            again = True
    return again


@compiled()
def end_of_step(table: StepTable, ns: int, which: tuple[int, int], room: Workspace, i: int) -> float:
    """Return row i of the state at the end of a step with one law, once that is solved."""
    law, na = which
    nc = table.W.shape[1]
    row = 2 * len(table.W) * (nc + ns) + i
    column = law * (nc + ns)
    found = room.sums[row]
    for a in range(na):
        found += room.z[a] * table.unknown[column + room.active[a], row]
    for j in range(ns):
        found += room.s[j] * table.unknown[column + nc + j, row]
    return float(found)


@compiled()
def find_throws(table: StepTable, springs: StepSprings, which: tuple[int, int], y: Vector, room: Workspace) -> None:
    """Write the i of the weights 1/θ_k = 1 + i/n with which ends part as after a blow, where they would faster, else -1.

    From the rate -U with which they meet they part with e U if (U + y)/θ_k = (1 + e) U. The mean rate y that they would
    have follows from that with θ by the slope J of the force. Both are those of the masses at the ends: what a prescribed
    motion or a plate adds is no rebound.
    """
    law, na = which
    N = springs.N
    n = N.shape[1]
    vectors = room.springs.vectors
    weight = springs.h / springs.θh[law]
    for j in range(len(N)):
        vectors[8, j] = -1.0
        mobility = springs.mobility[j]
        U = 0.0
        if mobility > 0.0:
            for i in range(n):
                U -= N[j, i] * y[n + i]
        change = U + vectors[2, j]
        if U > 0.0 and change * weight > U:
            δ = -springs.law[j, 0]
            for i in range(n):
                light = springs.light[j, i]
                δ -= (N[j, i] if light == 0.0 else light) * y[i]
                if light != 0.0:
                    place = end_of_step(table, len(N), (law, na), room, i)
                    change -= light * (place - y[i]) / springs.h - N[j, i] * y[n + i]
            wanted = U + greatest_rebound(springs.law[j], δ, U, mobility)
            if change * weight > wanted:
                J = vectors[5, j]
                if J < 0.0:
                    change += (wanted - change * weight) / (J * mobility * springs.h)
                vectors[8, j] = int(WEIGHTS * max(wanted / change - 1.0, 0.0) + 0.5)


@compiled()
def solve_features(
    table: StepTable,
    features: Features,
    state: StepState,
    room: Workspace,
    which: tuple[int, int],
    solving: Solving,
    solve_springs: SpringSolver,
) -> tuple[int, int, int, float]:
    """Solve law ``which[0]`` on its ``which[1]`` active rows with all features; again while static friction changes."""
    springs, _, _, friction, memory = features
    law, _ = which
    iterations = 0
    newton = 0
    again = True
    status = SOLVED
    count = 0
    tried = 0
    residual = 0.0
    holds = len(memory.static) > 0
    if holds:
        recall_slip(table, law, springs.h, friction, memory, state)
    while again and status == SOLVED:
        status, count, tried, residual = solve_in_turn(table, features, state, room, which, solving, solve_springs)
        iterations, newton = iterations + count, newton + tried
        again = holds and breaks_loose(table, which, friction, memory, room)
    if len(springs.mobility) > 0 and status == SOLVED:
        find_throws(table, springs, which, state.y, room)
    return status, iterations, newton, residual


@compiled()
def no_features(
    table: StepTable,
    features: Features,
    state: StepState,
    room: Workspace,
    which: tuple[int, int],
    solving: Solving,
    solve_springs: SpringSolver,
) -> tuple[int, int, int, float]:
    """Placeholder for steps of plain rows; never called."""
    return SOLVED, 0, 0, 0.0
