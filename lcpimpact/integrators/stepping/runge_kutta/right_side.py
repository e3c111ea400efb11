"""The right-hand side X' = A X + B r + E s(X) of an explicit Runge-Kutta method, with the reactions r of active contacts."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lcpimpact.arrays import Flags, Indices, Matrix, Vector
from lcpimpact.compiled import compiled
from lcpimpact.errors import Status
from lcpimpact.integrators.stepping.law import ContactProblem, Solving, solve_active, solve_law
from lcpimpact.scheme.power_law import spring_force

SOLVED = int(Status.SOLVED)

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
    law : (ns, 5) array             their gap, K, n, b, c
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
    """Workspace: y' of the stages, the contact problem of a stage, the closed contacts, and the displacements of a step."""

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
    for a in range(len(s)):
        K = system.law[a, 1]
        n = system.law[a, 2]
        b = system.law[a, 3]
        c = system.law[a, 4]
        s[a], _, _ = spring_force(K, n, b, c, term(system.approach, a, x), term(system.rate, a, x))


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
def right_side(
    x: Vector, system: Matrices, r: Vector, dy: Vector, room: StageWorkspace, solving: Solving
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
    for j in range(len(dy)):
        dy[j] = term(system.A, j, x) + term(system.B, j, r) + term(system.E, j, room.s)
    return status, count, residual
