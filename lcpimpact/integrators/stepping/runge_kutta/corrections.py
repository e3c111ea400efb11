r"""Corrections at the end of a step of an explicit Runge-Kutta method: impulses of impacts, and closed contacts that drift.

A step that violates a constraint is corrected at its end by impulses, which are one LCP with the same G,

.. math:: 0 \le P \perp G P + \begin{cases} U + e U & (ρ = 2) \\ u & (ρ = 1) \end{cases} \ge 0, \qquad X^+ = X + B P :

for degree 2 Newton's law of impact, for degree 1 the missing force between the closing of the gap and the end of the
step. The impulse of an impact acts at the end of the step and counts from the instant, τ ago, at which the gap closed: U
is the speed at that instant, and X⁺ moves on by τ A B P. A rebound that would end within the step is suppressed, so that
a body at rest stays at rest. Non-linear dashpots at massless nodes are in G and B by their secants, at the rates with the
gaps closed.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lcpimpact.arrays import Flags, Indices, Vector
from lcpimpact.compiled import compiled
from lcpimpact.integrators.stepping.law import ContactProblem, Solving, solve_law, submatrix
from lcpimpact.integrators.stepping.runge_kutta.right_side import (
    SOLVED,
    Matrices,
    Point,
    StageWorkspace,
    held,
    respond,
    right_side,
    rounding,
    term,
    touching,
)
from lcpimpact.lcp.solver import Kernel


@compiled()
def violates(x: Vector, system: Matrices, scale: Vector, r: Vector, room: StageWorkspace) -> bool:
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
    gap: Vector
    speed: Vector
    free: Vector
    meets: Flags
    e: Vector


@compiled()
def land(end: Point, system: Matrices, scale: Vector) -> Landing:
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


@compiled(inline="always")
def derivative(system: Matrices, i: int, x: Vector, s: Vector, r: Vector) -> float:
    """Return u^(ρ) of row i."""
    return term(system.O, i, x) + term(system.O_s, i, s) + term(system.G, i, r)


@compiled()
def trace_back(landing: Landing, system: Matrices, h: float, since: Vector, ago: Vector, q: Vector) -> None:
    """Write q of the impulses, how long ago each gap closed within the step, and for how long the impulses act."""
    gap = landing.gap
    speed = landing.speed
    free = landing.free
    e = landing.e
    earliest = 0.0
    for a, i in enumerate(landing.rows):
        ago[i] = since[i] = 0.0
        q[a] = gap[i] if system.degree[i] < 2 else speed[i]
        if system.degree[i] == 1 and free[i] < 0.0:
            since[i] = min(max(gap[i] / free[i], 0.0), h)
        if landing.meets[i]:
            # The speed at which the gap closed, and how long ago: u = τ (U + U_c)/2, and U² = U_c² + 2 u'' u.
            closing = speed[i]
            square = speed[i] ** 2 - 2.0 * free[i] * gap[i]
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


@compiled()
def falls_back(end: Point, landing: Landing, system: Matrices, s: Vector, shortest: float) -> bool:
    """Set e to zero where the flight after a rebound ends sooner than the shortest that counts; return whether any does."""
    found = False
    for i in landing.rows:
        if landing.e[i] > 0.0 and (landing.meets[i] or end.P[i] > 0.0) and system.degree[i] == 2:
            acceleration = derivative(system, i, end.x, s, end.r)
            if 2.0 * (term(system.U, i, end.x) - acceleration * end.since[i]) <= -acceleration * shortest:
                landing.e[i], found = 0.0, True
    return found


@compiled()
def settle(end: Point, landing: Landing, system: Matrices, scale: Vector, solving: Solving) -> tuple[int, int, float]:
    """Bring contacts to rest that were struck without restitution and that damping has moved since: U = 0, by further P.

    The other contacts that touch do not approach, U >= 0.
    """
    x = end.x
    P = end.P
    na = 0
    moves = False
    rows = np.empty_like(landing.rows)
    for i in landing.rows:
        # One that has rebounded and falls again is left to `falls_back`.
        stopped = landing.e[i] == 0.0 and P[i] > 0.0
        if system.degree[i] == 2 and (stopped or not term(system.C, i, x) > rounding(system.C, i, scale)):
            rows[na] = i
            na += 1
    rows = rows[:na]
    q = np.empty(na)
    z = np.zeros(na)
    struck = np.zeros(len(P))
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


@compiled()
def slips_off(x: Vector, system: Matrices, scale: Vector, r: Vector, closed: Flags) -> bool:
    """Return whether a closed contact that pushes has left u = 0 or U = 0 by more than rounding."""
    found = False
    for i in range(len(r)):
        if closed[i] and r[i] > 0.0 and system.degree[i] > 0:
            u = term(system.C, i, x)
            near = held(r[i]) * rounding(system.C, i, scale)
            found = found or u > near
            if system.degree[i] == 2:
                found = found or u < -near or abs(term(system.U, i, x)) > held(r[i]) * rounding(system.U, i, scale)
    return found


@compiled()
def hold(end: Point, system: Matrices, h: float, room: StageWorkspace, solving: Solving) -> tuple[int, int, float]:
    """Return closed contacts that push at both ends of a step to u = 0 and U = 0, which its error has left.

    The impulses p are part of that of their forces: z = p + h r >= 0, so that a contact that has opened stays open; and so
    for the gaps of degree 2, moved by A B p with z = p + h² r.
    """
    x = end.x
    r = end.r
    ny = len(end.dy)
    na = 0
    rows = np.empty(len(r), np.int64)
    for i in range(len(r)):
        room.touches[i] = room.together[i] and (r[i] > 0.0 or system.degree[i] == 0)
    status, total, worst = right_side(x, system, r, end.dy, room, solving)
    if len(system.dashpots.laws) > 0 and status == SOLVED:
        status, count, residual = respond(end, system, room, solving)
        total, worst = total + count, max(worst, residual)
    for i in range(len(r)):
        if room.touches[i] and r[i] > 0.0 and system.degree[i] > 0:
            rows[na] = i
            na += 1
    pushes = np.zeros(len(r))
    p = np.zeros(len(r))
    moved = np.zeros(len(x))
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
            q[a] = term(system.C if level == 0 else system.U, i, x) - term(room.G, i, pushes)
        problem = ContactProblem(submatrix(room.G, part), q, np.zeros(len(part)), np.full(len(part), np.inf))
        status, count, residual = solve_law(problem, z, solving)
        total, worst = total + count, max(worst, residual)
        for a, i in enumerate(part):
            p[i] = z[a] - pushes[i]
        if level == 0:
            for i in part:
                if system.degree[i] == 2:
                    for j in range(ny):
                        moved[j] += room.B[j, i] * p[i]
                    p[i] = 0.0
        for j in range(ny):
            x[j] += term(room.B, j, p) + term(system.A, j, moved)
    return status, total, worst


@compiled()
def correct(
    end: Point, system: Matrices, scale: Vector, lengths: tuple[float, float], room: StageWorkspace, solving: Solving
) -> tuple[int, int, float]:
    """Correct constraint violations at the end of a step by impulses P, and write r and y' after them.

    ``lengths`` are those of the step and of the shortest flight: a shorter rebound is suppressed. ``since`` becomes the time
    since each gap closed, and zero if none did.
    """
    x = end.x
    dy = end.dy
    r = end.r
    P = end.P
    since = end.since
    h, shortest = lengths
    landing = land(end, system, scale)
    rows = landing.rows
    nc = len(r)
    ny = len(dy)
    status, total, worst = right_side(x, system, r, dy, room, solving)
    if status != SOLVED:
        return status, total, worst
    for i in range(nc):
        landing.free[i] = derivative(system, i, x, room.s, r)
    if len(system.dashpots.laws) > 0:
        for i in rows:
            room.touches[i] = room.touches[i] or system.degree[i] < 2
        status, count, residual = respond(end, system, room, solving)
        total, worst = total + count, max(worst, residual)
        if status != SOLVED:
            return status, total, worst
    before = x.copy()
    W = submatrix(room.G, rows)
    lower = np.zeros(len(rows))
    upper = np.full(len(rows), np.inf)
    q = np.empty(len(rows))
    z = np.empty(len(rows))
    ago = np.zeros(nc)
    drift = np.zeros(len(x))
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
            x[j] = before[j] + term(room.B, j, P) + term(system.A, j, drift)
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


@compiled()
def end_step(
    end: Point,
    system: Matrices,
    scale: Vector,
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
