"""The right-hand side X' = A X + B r + E s(X) of an explicit Runge-Kutta method, with the reactions r of active contacts."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lcpimpact.arrays import Flags, Indices, Matrix, Vector
from lcpimpact.compiled import compiled
from lcpimpact.errors import Status
from lcpimpact.integrators.stepping.law import (
    MAX_NEWTON,
    NEWTON_TOL,
    ContactProblem,
    Solving,
    solve_active,
    solve_law,
    submatrix,
)
from lcpimpact.integrators.stepping.runge_kutta.dashpots import Dashpots, Pushing, add_secants, dashpot_forces
from lcpimpact.scheme.power_law import spring_force

SOLVED = int(Status.SOLVED)
SINGULAR = int(Status.SINGULAR)
NON_FINITE = int(Status.NON_FINITE)
NEWTON = int(Status.NEWTON)

ACTIVE_GAP_FACTOR = 1e3
"""Factor on the tolerance for a closed gap while the contact is active, since it drifts."""

ZERO_RTOL = 1e-12
"""Tolerance for zero, relative to the terms of the sum at their largest so far."""


class Matrices(NamedTuple):
    """The right-hand side, as matrices over x = (y, signals, loads), and behind these t where a general force acts.

    Attributes
    ----------
    A, B, E : arrays                y' = A x + B r + E s (ny, .)
    C, U : arrays                   u = C x, U = U x (nc, .)
    O, O_s, G : arrays              u^(ρ) = O x + O_s s + G r (nc, .)
    approach, rate : arrays         δ and δ' of the springs (ns, .)
    law : (ns, 9) array             their rows of `lcpimpact.scheme.power_law`
    dashpots : Dashpots             the non-linear dashpots, whose forces follow those of the springs in s
    degree, e : (nc,) arrays        relative degrees and coefficients of restitution
    """

    A: Matrix
    B: Matrix
    E: Matrix
    C: Matrix
    U: Matrix
    O: Matrix  # noqa: E741
    O_s: Matrix
    G: Matrix
    approach: Matrix
    rate: Matrix
    law: Matrix
    dashpots: Dashpots
    degree: Indices
    e: Vector


class Point(NamedTuple):
    """Results at one instant: x, y', r, P, and the time since each gap closed."""

    x: Vector
    dy: Vector
    r: Vector
    P: Vector
    since: Vector


class StageWorkspace(NamedTuple):
    """Workspace: y' of the stages, the contact problem of a stage, the closed contacts, and the displacements of a step.

    ``G`` and ``B`` are those by which states follow impulses, ``v`` (1, nd) the rates of dashpots.
    """

    K: Matrix
    active: Indices
    q: Vector
    z: Vector
    lower: Vector
    upper: Vector
    s: Vector
    touches: Flags
    together: Flags
    moves: Vector
    G: Matrix
    B: Matrix
    v: Matrix


def room_for(system: Matrices, stages: int) -> StageWorkspace:
    """Return the workspace of a system and a number of stages."""
    ny = len(system.A)
    nc = len(system.C)
    ns = system.E.shape[1]
    q, z, lower = np.zeros((3, nc))
    touches, together = np.zeros((2, nc), bool)
    return StageWorkspace(
        K=np.zeros((stages, ny)), active=np.zeros(nc, np.int64), q=q, z=z, lower=lower, upper=np.full(nc, np.inf),
        s=np.zeros(ns), touches=touches, together=together, moves=np.zeros(ny),
        G=system.G.copy(), B=system.B.copy(), v=np.zeros((1, len(system.dashpots.laws))),
    )  # fmt: skip


@compiled(inline="always")
def term(M: Matrix, i: int, x: Vector) -> float:
    """Return row i of M x."""
    sum_ = 0.0
    for j in range(len(x)):
        sum_ += M[i, j] * x[j]
    return sum_


@compiled(inline="always")
def rounding(M: Matrix, i: int, scale: Vector) -> float:
    """Return the tolerance for zero of row i of M x."""
    sum_ = 0.0
    for j in range(len(scale)):
        sum_ += abs(M[i, j]) * scale[j]
    return ZERO_RTOL * sum_


@compiled()
def spring_forces(x: Vector, system: Matrices, s: Vector) -> None:
    """Write the forces s(δ, δ') of the non-linear springs at x."""
    for a in range(len(system.law)):
        s[a], _, _ = spring_force(system.law[a], term(system.approach, a, x), term(system.rate, a, x))


@compiled(inline="always")
def held(r: float) -> float:
    """Return the factor on the tolerance for a closed gap: an active contact drifts."""
    return ACTIVE_GAP_FACTOR if r > 0.0 else 1.0


@compiled()
def touching(x: Vector, system: Matrices, scale: Vector, r: Vector, touches: Flags) -> None:
    """Write the active rows: all of degree 0, those with u <= 0 of degree 1, those with u <= 0 and U = 0 of degree 2."""
    for i in range(len(r)):
        touches[i] = system.degree[i] == 0 or term(system.C, i, x) <= held(r[i]) * rounding(system.C, i, scale)
        if system.degree[i] == 2 and touches[i]:
            touches[i] = abs(term(system.U, i, x)) <= held(r[i]) * rounding(system.U, i, scale)


@compiled()
def reactions(
    x: Vector, system: Matrices, r: Vector, room: StageWorkspace, solving: Solving
) -> tuple[int, int, float]:  # fmt: skip
    """Write r under the forces s of the workspace, from a guess; return status, iterations and residual."""
    nc, na = len(r), 0
    for i in range(nc):
        if room.touches[i]:
            room.active[na], room.z[na] = i, max(r[i], 0.0)
            room.q[i] = term(system.O, i, x) + term(system.O_s, i, room.s)
            na += 1
        r[i] = 0.0
    status = SOLVED
    count = 0
    residual = 0.0
    rows = ContactProblem(system.G, room.q, room.lower, room.upper)
    if na == nc > 0:
        status, count, residual = solve_law(rows, room.z, solving)
    elif na > 0:
        status, count, residual = solve_active(rows, room.active[:na], room.z[:na], solving)
    for a in range(na):
        r[room.active[a]] = room.z[a]
    return status, count, residual


@compiled()
def add_dashpots(x: Vector, system: Matrices, r: Vector, touches: Flags, s: Vector, v: Matrix) -> bool:
    """Add the forces of the dashpots to s while the contacts push that touch with r > 0; return whether they are found."""
    dashpots = system.dashpots
    nd = len(dashpots.laws)
    free = np.empty(nd)
    for j in range(nd):
        s[dashpots.first + j] = 0.0
    for j in range(nd):
        free[j] = term(dashpots.V, j, x) + term(dashpots.V_s, j, s)
    rows = np.flatnonzero(touches & (r > 0.0))
    without = np.empty(len(rows))
    for a in range(len(rows)):
        without[a] = term(system.O, rows[a], x) + term(system.O_s, rows[a], s)
    return dashpot_forces(dashpots, free, Pushing(rows, submatrix(system.G, rows), without), s, v)


@compiled()
def reactions_on_dashpots(
    x: Vector, system: Matrices, r: Vector, room: StageWorkspace, solving: Solving
) -> tuple[int, int, float]:  # fmt: skip
    """Write r and the forces of the dashpots, which depend on which contacts push, as `reactions` does."""
    first, nd = system.dashpots.first, len(system.dashpots.laws)
    total, worst = 0, 0.0
    before = np.empty(nd)
    for turn in range(MAX_NEWTON):
        for j in range(nd):
            before[j] = room.s[first + j]
        if not add_dashpots(x, system, r, room.touches, room.s, room.v):
            return SINGULAR, total, worst
        change, size = 0.0, 0.0
        for j in range(nd):
            change = max(change, abs(room.s[first + j] - before[j]))
            size = max(size, abs(room.s[first + j]))
            if not abs(room.s[first + j]) < np.inf:
                return NON_FINITE, total, worst
        if turn > 0 and change <= NEWTON_TOL * size:
            return SOLVED, total, worst
        status, count, residual = reactions(x, system, r, room, solving)
        total, worst = total + count, max(worst, residual)
        if status != SOLVED:
            return status, total, worst
    return NEWTON, total, worst


@compiled()
def right_side(
    x: Vector, system: Matrices, r: Vector, dy: Vector, room: StageWorkspace, solving: Solving
) -> tuple[int, int, float]:
    """Write r and y' at x, with the active contacts of the workspace; return status, iterations and residual."""
    spring_forces(x, system, room.s)
    if len(system.dashpots.laws) > 0:
        status, count, residual = reactions_on_dashpots(x, system, r, room, solving)
    else:
        status, count, residual = reactions(x, system, r, room, solving)
    for j in range(len(dy)):
        dy[j] = term(system.A, j, x) + term(system.B, j, r) + term(system.E, j, room.s)
    return status, count, residual


@compiled()
def respond(end: Point, system: Matrices, room: StageWorkspace, solving: Solving) -> tuple[int, int, float]:
    """Write the G and B of impulses while the active contacts of degree 0 and 1 are closed."""
    r, dy = end.r.copy(), end.dy.copy()
    status, count, residual = right_side(end.x, system, r, dy, room, solving)
    room.G[:] = system.G
    room.B[:] = system.B
    add_secants(system.dashpots, room.v[0], room.G, room.B)
    return status, count, residual
