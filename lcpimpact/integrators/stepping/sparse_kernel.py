r"""The compiled loop of sparse steps, with the laws of each step judged in it.

The numbers of a step are x = (q, v, P, w), w only where A is not diagonal; two of them are kept, at t and at t + h, and
change places from step to step. The laws are judged on q, v, q⁺, v⁺ and P alone, by stencils of their own: the momentum of
each node,

.. math:: M (v^+ - v) + h K q_θ + C (q^+ - q) - h f - H^T P = 0, \qquad q_θ = (1 - θ) q + θ q^+,

its kinematics q⁺ - q = h v_θ, the law of impact and the gap of each contact, and the energy. Of each law the largest ratio
of a violation to its limit is kept, with both.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numba import types

from lcpimpact.arrays import Array, Flags, Indices
from lcpimpact.compiled import compiled, f8, flags, i8, indices, matrix, named_tuple, vector
from lcpimpact.errors import Status
from lcpimpact.integrators.stepping.law import ContactProblem, Solving, examine, solve_active
from lcpimpact.integrators.stepping.stencil import STENCIL, STRIP, Stencil, apply, is_empty, solve_banded
from lcpimpact.lcp.judge import clear_residual_of_chain
from lcpimpact.lcp.problem import KERNEL
from lcpimpact.lcp.solver import Kernel
from lcpimpact.lcp.solvers.banded import POOLS, Pools, isotonic_chain
from lcpimpact.lcp.solvers.block_pivoting import block_pivoting

SOLVED, NON_FINITE = int(Status.SOLVED), int(Status.NON_FINITE)

MOMENTUM, KINEMATICS, IMPACT_LAW, COMPLEMENTARITY = range(4)
"""The laws that are judged in each step."""

CLOSED_RTOL = 1e-12
"""Predicted penetration, relative to the terms of the gap, below which a contact need not act."""


class SparseTable(NamedTuple):
    """The coefficients of a sparse step of one length.

    Attributes
    ----------
    touching, L : Stencil       predicted gaps, and L without its part W P
    momentum, factor            right side of A w = b, and the bands of the Cholesky factor of A; empty where A is diagonal
    end : Stencil               q⁺ and v⁺ (2n rows)
    near : (nc,) array          gap by P up to which a contact that has just pushed takes part, as rounding may open it
    weight : (nc,) array        W_ii
    """

    touching: Stencil
    L: Stencil
    momentum: Stencil
    factor: Array
    end: Stencil
    near: Array
    weight: Array


class Laws(NamedTuple):
    """The laws of motion by which steps are judged.

    Attributes
    ----------
    momentum, elastic, damping      M v, K q and C q
    push, pushes                    Hᵀ P, and |H|ᵀ P
    gap, rate                       u and U
    f, per_mass, stiffness (n,)     loads, 1/M_ii, and h |K_ii| + |C_ii|
    e, u0 (nc,)                     coefficients of restitution, and gaps at q = 0
    """

    momentum: Stencil
    elastic: Stencil
    damping: Stencil
    push: Stencil
    pushes: Stencil
    gap: Stencil
    rate: Stencil
    f: Array
    per_mass: Array
    stiffness: Array
    e: Array
    u0: Array


class Contacts(NamedTuple):
    """The contact problem of a step.

    Attributes
    ----------
    W : matrix                  the lower bands (2, nc) of a chain, or (nc, nc)
    mass : (nc + 1,) array      the masses of a chain
    L, acting : (nc,) arrays    L without P; and the same, but inf where a contact is not active
    active : (nc,) flags
    lower, upper : (nc,)        bounds, written where a solver needs them
    pools : Pools               room for those of a chain
    tol, max_iter               of the LCP solver
    """

    W: Array
    mass: Array
    L: Array
    acting: Array
    active: Flags
    lower: Array
    upper: Array
    pools: Pools
    tol: float
    max_iter: int


class Motion(NamedTuple):
    """Numbers at t and t + h: x (2, size), M v, K q and C q (2, n), and U (2, nc)."""

    x: Array
    momentum: Array
    elastic: Array
    damping: Array
    rate: Array


class Room(NamedTuple):
    """Arrays a step works in: predicted and final gaps (nc,), Hᵀ P and |H|ᵀ P (n,).

    Those of the whole run are the largest -u and |U| of each contact (nc,), and the largest |v| of each node with what the
    impulses of the step change it by (n,).
    """

    predicted: Array
    gap: Array
    push: Array
    pushes: Array
    penetration: Array
    rate: Array
    speed: Array


class Found(NamedTuple):
    """What judging has found: ratio, violation and limit of each law (3, 4), and the account of energy (5,).

    The account is the largest imbalance, the scale, the stored energy, the sum of imbalances, and the largest speed.
    """

    laws: Array
    energy: Array


class Recorded(NamedTuple):
    """The chosen nodes and contacts, and their q, v (nt, nq) and mean forces r (nt - 1, nr)."""

    nodes: Indices
    contacts: Indices
    q: Array
    v: Array
    r: Array


class Steps(NamedTuple):
    """The steps of a block: first and last instant, h, θ, and the precision ε of the laws."""

    first: int
    last: int
    h: float
    θ: float
    ε: float


TABLE: Any = named_tuple((STENCIL,) * 3 + (matrix, STENCIL, vector, vector), SparseTable)
LAWS: Any = named_tuple((STENCIL,) * 7 + (vector,) * 5, Laws)
CONTACTS: Any = named_tuple((matrix, vector, vector, vector, flags, vector, vector, POOLS, f8, i8), Contacts)
MOTION: Any = named_tuple((matrix,) * 5, Motion)
ROOM: Any = named_tuple((vector,) * 7, Room)
FOUND: Any = named_tuple((matrix, vector), Found)
RECORDED: Any = named_tuple((indices, indices, matrix, matrix, matrix), Recorded)
STEPS: Any = named_tuple((i8, i8, f8, f8, f8), Steps)
RESULT: Any = types.Tuple((i8, i8, f8))
ContactSolver = Callable[[Contacts, Array, Kernel], tuple[int, int, float]]
CONTACT_SOLVER: Any = types.FunctionType(RESULT(CONTACTS, vector, KERNEL))


@compiled(types.void(CONTACTS), inline="always", allocates=False)
def write_bounds(contacts: Contacts) -> None:
    """Write the bounds of P: it is 0 at contacts that are not active."""
    for i in range(len(contacts.L)):
        contacts.lower[i], contacts.upper[i] = 0.0, np.inf if contacts.active[i] else 0.0


@compiled(RESULT(CONTACTS, vector))
def solve_doubtful_chain(contacts: Contacts, z: Array) -> tuple[int, int, float]:
    """Check the impulses of a chain by the full rule, and solve again by block pivoting where they do not hold."""
    W, L, lower, upper, tol = contacts.W, contacts.L, contacts.lower, contacts.upper, contacts.tol
    write_bounds(contacts)
    status, residual = examine(SOLVED, W, L, lower, upper, z, tol)
    if status == SOLVED:
        return status, 0, residual
    status, count = block_pivoting(W, L, lower, upper, z, tol, contacts.max_iter)
    status, residual = examine(status, W, L, lower, upper, z, tol)
    return status, count, residual


@compiled(RESULT(CONTACTS, vector, KERNEL), allocates=False)
def solve_chain(contacts: Contacts, z: Array, kernel: Kernel) -> tuple[int, int, float]:
    """Solve the contact problem of a chain by isotonic regression, and check it independently."""
    status = isotonic_chain(contacts.mass, contacts.acting, z, contacts.pools)
    if status == SOLVED and clear_residual_of_chain(contacts.W, contacts.acting, z) == 0.0:
        return status, 1, 0.0
    status, count, residual = solve_doubtful_chain(contacts, z)
    return status, count + 1, residual


@compiled(RESULT(CONTACTS, vector, KERNEL))
def solve_few(contacts: Contacts, z: Array, kernel: Kernel) -> tuple[int, int, float]:
    """Solve the contact problem of few contacts with a full W, by the solver of schemes that are not sparse."""
    active = np.flatnonzero(contacts.active)
    part = z[active]
    write_bounds(contacts)
    rows = ContactProblem(contacts.W, contacts.L, contacts.lower, contacts.upper)
    status, count, residual = solve_active(rows, active, part, Solving(contacts.tol, contacts.max_iter, kernel))
    z[:] = 0.0
    z[active] = part
    return status, count, residual


@compiled(types.boolean(TABLE, CONTACTS, vector, vector, ROOM), allocates=False)
def choose_active(table: SparseTable, contacts: Contacts, x: Array, P: Array, room: Room) -> bool:
    """Find the active contacts, with the impulses P of the last step; return whether there are any."""
    apply(table.touching, x, room.predicted)
    some = False
    for i in range(len(P)):
        gap = room.predicted[i]
        contacts.active[i] = gap == 0.0 or gap < table.near[i] * max(P[i], 0.0)
        some = some or contacts.active[i]
    return some


@compiled(types.void(FOUND, i8, f8, f8), inline="always", allocates=False)
def note(found: Found, law: int, violation: float, limit: float) -> None:
    """Keep a violation if its ratio to its limit is the largest so far."""
    if not violation <= found.laws[0, law] * limit:
        found.laws[0, law] = violation / limit if limit > 0.0 else np.inf
        found.laws[1, law], found.laws[2, law] = violation, limit


@compiled(types.boolean(STEPS, LAWS, MOTION, i8, ROOM, FOUND), allocates=False)
def judge_nodes(block: Steps, laws: Laws, motion: Motion, new: int, room: Room, found: Found) -> bool:
    """Judge momentum, kinematics and energy of a step, and return whether its numbers are finite."""
    (_, _, h, θ, ε), old, n = block, 1 - new, len(laws.f)
    now, then = motion.x[new], motion.x[old]
    apply(laws.momentum, now, motion.momentum[new])
    if not is_empty(laws.elastic):
        apply(laws.elastic, now, motion.elastic[new])
    if not is_empty(laws.damping):
        apply(laws.damping, now, motion.damping[new])
    apply(laws.push, then, room.push)
    apply(laws.pushes, then, room.pushes)
    stored, work, speed, stiff = 0.0, 0.0, found.energy[4], len(laws.stiffness) > 0
    for start in range(0, n, STRIP):
        part, part_work = 0.0, 0.0
        for i in range(start, min(start + STRIP, n)):
            q, q_then, v, v_then = now[i], then[i], now[n + i], then[n + i]
            moved, p, p_then = q - q_then, motion.momentum[new, i], motion.momentum[old, i]
            s, s_then = motion.elastic[new, i], motion.elastic[old, i]
            damped = motion.damping[new, i] - motion.damping[old, i]
            elastic, load = h * ((1.0 - θ) * s_then + θ * s), h * laws.f[i]
            defect = p - p_then + elastic + damped - load - room.push[i]
            size = abs(p) + abs(p_then) + abs(load) + room.pushes[i]
            if stiff:
                size += laws.stiffness[i] * (abs(q) + abs(q_then))
            note(found, MOMENTUM, abs(defect), ε * size)
            off = moved - h * ((1.0 - θ) * v_then + θ * v)
            note(found, KINEMATICS, abs(off), ε * (abs(q) + abs(q_then) + h * size * laws.per_mass[i]))
            part += v * p + q * s
            part_work += moved * (load + room.push[i] - damped)
            speed, reach = max(speed, abs(v)), abs(v) + room.pushes[i] * laws.per_mass[i]
            if reach > room.speed[i]:
                room.speed[i] = reach
            if not size < np.inf:
                return False
        stored += 0.5 * part
        work += part_work
    found.energy[3] += stored - found.energy[2] - work / h
    found.energy[0] = max(found.energy[0], abs(found.energy[3]))
    found.energy[1] = max(found.energy[1], abs(stored))
    found.energy[2], found.energy[4] = stored, speed
    return True


@compiled(types.void(STEPS, LAWS, TABLE, MOTION, i8, ROOM, FOUND), allocates=False)
def judge_contacts(
    block: Steps, laws: Laws, table: SparseTable, motion: Motion, new: int, room: Room, found: Found
) -> None:
    """Judge the law of impact and complementarity of a step, and keep the largest penetrations and rates."""
    (_, _, h, θ, ε), n, nc = block, len(laws.f), len(laws.u0)
    now, P, before = motion.x[new], motion.x[1 - new, 2 * n : 2 * n + nc], motion.x[new, 2 * n : 2 * n + nc]
    for i in range(nc):
        room.predicted[i] = room.gap[i] + 0.5 * h * motion.rate[1 - new, i]
    apply(laws.gap, now, room.gap)
    apply(laws.rate, now, motion.rate[new])
    speed, place = 2.0 * found.energy[4], 0.0
    for i in range(n):
        place = max(place, abs(now[i]))
    for i in range(nc):
        U = motion.rate[new, i]
        off = U + laws.e[i] * motion.rate[1 - new, i]
        terms = abs(laws.u0[i]) + 2.0 * place + h * speed
        limit = ε * (speed + table.weight[i] * P[i] / θ)
        if P[i] > 0.0:
            note(found, IMPACT_LAW, abs(off), limit)
            note(found, COMPLEMENTARITY, P[i] * abs(off), P[i] * limit)
            # A force at a distance; one that has just acted may go on where rounding has opened its contact.
            ahead = room.predicted[i] - table.near[i] * max(before[i], 0.0)
            note(found, COMPLEMENTARITY, P[i] / h * max(ahead, 0.0), P[i] / h * ε * terms)
        elif not P[i] >= 0.0:
            note(found, COMPLEMENTARITY, np.inf, 1.0)
        elif off < 0.0 and room.predicted[i] < -CLOSED_RTOL * terms:
            note(found, IMPACT_LAW, -off, limit)
        if abs(U) > room.rate[i]:
            room.rate[i] = abs(U)
        if -room.gap[i] > room.penetration[i]:
            room.penetration[i] = -room.gap[i]


@compiled(types.void(RECORDED, i8, i8, vector), inline="always", allocates=False)
def record(path: Recorded, k: int, n: int, x: Array) -> None:
    """Write q and v of the chosen nodes at an instant."""
    for a in range(len(path.nodes)):
        path.q[k, a], path.v[k, a] = x[path.nodes[a]], x[n + path.nodes[a]]


@compiled(RESULT(TABLE, CONTACTS, MOTION, i8, ROOM, CONTACT_SOLVER, KERNEL), allocates=False)
def take_step(
    table: SparseTable, contacts: Contacts, motion: Motion, new: int, room: Room, solve: ContactSolver, kernel: Kernel
) -> tuple[int, int, float]:
    """Take one step: write P and w of the old numbers, and q and v of the new ones."""
    x, nc, ends = motion.x[1 - new], len(contacts.L), len(table.end.c)
    P, w = x[ends : ends + nc], x[ends + nc :]
    some = choose_active(table, contacts, x, motion.x[new, ends : ends + nc], room)
    for i in range(nc):
        P[i] = motion.x[new, ends + i] if contacts.active[i] else 0.0
    status, count, residual, implicit = SOLVED, 0, 0.0, len(table.factor) > 0
    if some:
        if implicit:
            for i in range(nc):
                contacts.acting[i], P[i] = P[i], 0.0
            apply(table.momentum, x, w)
            solve_banded(table.factor, w)
            for i in range(nc):
                P[i] = contacts.acting[i]
        apply(table.L, x, contacts.L)
        for i in range(nc):
            contacts.acting[i] = contacts.L[i] if contacts.active[i] else np.inf
        status, count, residual = solve(contacts, P, kernel)
    if implicit:
        apply(table.momentum, x, w)
        solve_banded(table.factor, w)
    apply(table.end, x, motion.x[new, :ends])
    return status, count, residual


@compiled(
    types.Tuple((i8, i8, i8, f8))(
        STEPS, TABLE, types.Tuple((LAWS, ROOM, FOUND)), CONTACTS, MOTION, RECORDED, CONTACT_SOLVER, KERNEL
    ),
    allocates=False,
)
def sparse_steps(
    block: Steps,
    table: SparseTable,
    judge: tuple[Laws, Room, Found],
    contacts: Contacts,
    motion: Motion,
    path: Recorded,
    solve: ContactSolver,
    kernel: Kernel,
) -> tuple[int, int, int, float]:
    """Take a block of steps, from the numbers at k % 2 to those at (k + 1) % 2: status, step, iterations, residual."""
    (laws, room, found), n, iterations, worst = judge, len(table.end.c) // 2, 0, 0.0
    for k in range(block.first, block.last):
        new = (k + 1) % 2
        status, count, residual = take_step(table, contacts, motion, new, room, solve, kernel)
        iterations, worst = iterations + count, max(worst, residual)
        if status != SOLVED:
            return status, k, iterations, worst
        if not judge_nodes(block, laws, motion, new, room, found):
            return NON_FINITE, k, iterations, worst
        if len(room.gap) > 0:
            judge_contacts(block, laws, table, motion, new, room, found)
        record(path, k + 1, n, motion.x[new])
        for a in range(len(path.contacts)):
            path.r[k, a] = motion.x[1 - new, 2 * n + path.contacts[a]] / block.h
    return SOLVED, block.last, iterations, worst
