r"""The compiled loop of sparse steps, with the laws of each step judged in it.

The numbers of a step are x = (q, v, P, s, w), with the inputs s of `lcpimpact.integrators.stepping.sparse_symbols`, and w
only where A is not diagonal; two of them are kept, at t and at t + h, and change places from step to step. The laws are
judged on q, v, q⁺, v⁺ and P alone, by stencils of their own: the momentum of each node,

.. math:: M (v^+ - v) + h K q_θ + C (q^+ - q) - h f_θ - H^T P = 0, \qquad q_θ = (1 - θ) q + θ q^+,

its kinematics q⁺ - q = h v_θ, the law of impact and the gap of each contact, and the energy. A node without mass has the
same balance, and q⁺ - q = h v⁺; one with prescribed motion has its place and velocity. Loads and motions are not read from
the inputs of the step, but given to the judge separately. Of each law the largest ratio of a violation to its limit is kept,
with both.
"""

from __future__ import annotations

from collections.abc import Callable
from enum import IntEnum
from typing import NamedTuple, TypeAlias

import numpy as np

from lcpimpact.arrays import Flags, Indices, Matrix, Vector
from lcpimpact.compiled import compiled
from lcpimpact.errors import Status
from lcpimpact.integrators.stepping.law import ContactProblem, Solving, examine, solve_active
from lcpimpact.integrators.stepping.stencil import STRIP, Stencil, apply, is_empty
from lcpimpact.lcp.judge import clear_residual_of_chain
from lcpimpact.lcp.solver import Kernel
from lcpimpact.lcp.solvers.banded import Pools, isotonic_chain
from lcpimpact.lcp.solvers.block_pivoting import block_pivoting
from lcpimpact.numerics.banded import solve_banded
from lcpimpact.record import CLOSED_GAP_RTOL
from lcpimpact.scheme.terms import NodeKind

SOLVED = int(Status.SOLVED)
NON_FINITE = int(Status.NON_FINITE)

NEGLIGIBLE = 1e-9
"""Terms of a balance, relative to the largest of all nodes, to which the solution of A w = b is below its rounding."""


class JudgedLaw(IntEnum):
    """The laws that are judged in each step."""

    MOMENTUM = 0
    KINEMATICS = 1
    IMPACT_LAW = 2
    COMPLEMENTARITY = 3
    EQUILIBRIUM = 4
    MOTION_LAW = 5


class StaticCoordinates(NamedTuple):
    """The quasi-static coordinates, which end a step in equilibrium where no closed contact holds them.

    Attributes
    ----------
    node, of : (m,) arrays          the nodes that they move, and the coordinate of each
    contact, held : (p,) arrays     contacts, and the coordinate that each holds where it is closed
    stiffness : (k,) array          Sᵀ K S where it is diagonal; its diagonal
    force : (k,) array              room for the forces, and for the ways
    free : (k,) flags               room
    """

    node: Indices
    of: Indices
    contact: Indices
    held: Indices
    stiffness: Vector
    force: Vector
    free: Flags


class SparseTable(NamedTuple):
    """The coefficients of a sparse step of one length.

    Attributes
    ----------
    touching, L : Stencil       predicted gaps, and L without its part W P
    momentum, factor            right side of A w = b, and the factors of A in bands; empty where A is diagonal
    end : Stencil               q⁺ and v⁺ (2n rows)
    unbalanced : Stencil        the forces on the quasi-static coordinates at the end
    static : StaticCoordinates
    near : (nc,) array          gap by P up to which a contact that has just pushed takes part, as rounding may open it
    weight : (nc,) array        W_ii
    """

    touching: Stencil
    L: Stencil
    momentum: Stencil
    factor: Matrix
    end: Stencil
    unbalanced: Stencil
    static: StaticCoordinates
    near: Vector
    weight: Vector


class MotionLaws(NamedTuple):
    """The laws of motion by which steps are judged.

    Attributes
    ----------
    momentum, elastic, damping      M v, K q and C q
    push, pushes                    Hᵀ P, and |H|ᵀ P
    gap, rate                       u and U
    pull                            h |K| + |C|
    load, loads                     h f_θ by the signals of the loads at t_θ, and its terms by their |values|
    turn                            what the rates of the driven nodes add to U
    per_mass (n,)                   1/M_ii, 0 without mass
    e, u0 (nc,)                     coefficients of restitution, and gaps at q = 0
    kind (n,)                       kinds of the nodes; none where all have mass
    impacts (nc,)                   contacts of relative degree 2; none where all are
    driven (nd,)                    nodes with prescribed motion
    """

    momentum: Stencil
    elastic: Stencil
    damping: Stencil
    push: Stencil
    pushes: Stencil
    gap: Stencil
    rate: Stencil
    pull: Stencil
    load: Stencil
    loads: Stencil
    turn: Stencil
    per_mass: Vector
    e: Vector
    u0: Vector
    kind: Indices
    impacts: Flags
    driven: Indices


class StepContacts(NamedTuple):
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

    W: Matrix
    mass: Vector
    L: Vector
    acting: Vector
    active: Flags
    lower: Vector
    upper: Vector
    pools: Pools
    tol: float
    max_iter: int


class StepMotion(NamedTuple):
    """Numbers at t and t + h: x (2, size), M v, K q and C q (2, n), and U (2, nc)."""

    x: Matrix
    momentum: Matrix
    elastic: Matrix
    damping: Matrix
    rate: Matrix


class Room(NamedTuple):
    """Arrays a step works in: predicted and final gaps (nc,), Hᵀ P, |H|ᵀ P, h f_θ and its terms (n,).

    ``reach`` is |q| + |q⁺|, and ``pull`` the terms of springs and dashpots by it (n,), where there are any.

    Where coordinates are static, ``reached`` and ``elastic`` are q and K q before they are moved (n,); where motions are
    prescribed, ``turned`` is U⁺ by the mean rates of the step less U⁺ (nc,), with ``turning`` for each motion (nd,).
    Those of the whole run are the largest -u and |U| of each contact (nc,), and the largest |v| of each node with what the
    impulses of the step change it by (n,).
    """

    predicted: Vector
    gap: Vector
    push: Vector
    pushes: Vector
    load: Vector
    loads: Vector
    reach: Vector
    pull: Vector
    reached: Vector
    elastic: Vector
    turned: Vector
    turning: Vector
    penetration: Vector
    rate: Vector
    speed: Vector


class Found(NamedTuple):
    """The result of the checks: ratio, violation and limit of each law (3, 6), and the account of energy (10,).

    The account is the largest imbalance, the scale, the stored energy, the sum of imbalances, and the largest speed; where
    loads or motions depend on time, the largest sum of the works of all forces of a step, taken as positive, and the works
    of these forces along |q| + |q⁺| in all steps, whose rounding is in the balance; the largest terms of a balance of
    momentum, where springs or dashpots couple them; and the sum of imbalances less what steps of θ > 1/2 lose by themselves,
    with the largest loss in it.
    """

    laws: Matrix
    energy: Vector


class ChosenSeries(NamedTuple):
    """The chosen nodes and contacts, and their q, v (nt, nq) and mean forces r (nt - 1, nr)."""

    nodes: Indices
    contacts: Indices
    q: Matrix
    v: Matrix
    r: Matrix


class Given(NamedTuple):
    """The loads and motions of the steps of a block, one row a step.

    Attributes
    ----------
    inputs : (steps, ni) array          of the step
    signals, sizes : (steps, ns)        of the loads at t_θ, for the judge, and their absolute values
    place, rate : (steps, nd) arrays    of the driven nodes at t + h, for the judge
    """

    inputs: Matrix
    signals: Matrix
    sizes: Matrix
    place: Matrix
    rate: Matrix


class BlockOfSteps(NamedTuple):
    """The steps of a block: first and last instant, h, θ, the precision ε of the laws, and the loads and motions."""

    first: int
    last: int
    h: float
    θ: float
    ε: float
    given: Given


ContactSolver: TypeAlias = Callable[[StepContacts, Vector, Kernel], tuple[int, int, float]]


@compiled(inline="always")
def write_bounds(contacts: StepContacts) -> None:
    """Write the bounds of P: it is 0 at contacts that are not active."""
    for i in range(len(contacts.L)):
        contacts.lower[i] = 0.0
        contacts.upper[i] = np.inf if contacts.active[i] else 0.0


@compiled()
def solve_doubtful_chain(contacts: StepContacts, z: Vector) -> tuple[int, int, float]:
    """Check the impulses of a chain by the full rule, and solve again by block pivoting where they do not hold."""
    W = contacts.W
    L = contacts.L
    lower = contacts.lower
    upper = contacts.upper
    tol = contacts.tol
    write_bounds(contacts)
    status, residual = examine(SOLVED, W, L, lower, upper, z, tol)
    if status == SOLVED:
        return status, 0, residual
    status, count = block_pivoting(W, L, lower, upper, z, tol, contacts.max_iter)
    status, residual = examine(status, W, L, lower, upper, z, tol)
    return status, count, residual


@compiled()
def solve_chain(contacts: StepContacts, z: Vector, kernel: Kernel) -> tuple[int, int, float]:
    """Solve the contact problem of a chain by isotonic regression, and check it independently."""
    status = isotonic_chain(contacts.mass, contacts.acting, z, contacts.pools)
    if status == SOLVED and clear_residual_of_chain(contacts.W, contacts.acting, z) == 0.0:
        return status, 1, 0.0
    status, count, residual = solve_doubtful_chain(contacts, z)
    return status, count + 1, residual


@compiled()
def solve_few(contacts: StepContacts, z: Vector, kernel: Kernel) -> tuple[int, int, float]:
    """Solve the contact problem of few contacts with a full W, by the solver of schemes that are not sparse."""
    active = np.flatnonzero(contacts.active)
    part = z[active]
    write_bounds(contacts)
    rows = ContactProblem(contacts.W, contacts.L, contacts.lower, contacts.upper)
    status, count, residual = solve_active(rows, active, part, Solving(contacts.tol, contacts.max_iter, kernel))
    z[:] = 0.0
    z[active] = part
    return status, count, residual


@compiled()
def choose_active(table: SparseTable, contacts: StepContacts, x: Vector, P: Vector, room: Room) -> bool:
    """Find the active contacts, with the impulses P of the last step; return whether there are any."""
    apply(table.touching, x, room.predicted)
    some = False
    for i in range(len(P)):
        gap = room.predicted[i]
        contacts.active[i] = gap == 0.0 or gap < table.near[i] * max(P[i], 0.0)
        some = some or contacts.active[i]
    return some


@compiled(inline="always")
def note(found: Found, law: int, violation: float, limit: float) -> None:
    """Keep a violation if its ratio to its limit is the largest so far."""
    if violation != 0.0 and not violation <= found.laws[0, law] * limit:
        found.laws[0, law] = violation / limit if limit > 0.0 else np.inf
        found.laws[1, law], found.laws[2, law] = violation, limit


@compiled()
def judge_motions(
    block: BlockOfSteps, k: int, laws: MotionLaws, motion: StepMotion, new: int, room: Room, found: Found
) -> None:
    """Judge the driven nodes, and find U⁺ by their mean rates m, v + (m - v)/θ, which obeys the law of impact.

    A mean rate is that of the places, or of the rates where one jumps.
    """
    now = motion.x[new]
    then = motion.x[1 - new]
    n = len(room.push)
    nd = len(laws.driven)
    h = block.h
    ε = block.ε
    place = block.given.place[k - block.first]
    rate = block.given.rate[k - block.first]
    inputs = block.given.inputs[k - block.first]
    for j in range(len(laws.driven)):
        i = laws.driven[j]
        v = now[n + i]
        v_then = then[n + i]
        mean = inputs[len(inputs) - nd + j]
        moved = now[i] - then[i]
        off = abs(now[i] - place[j]) + h * abs(v - rate[j])
        off += min(abs(h * mean - moved), h * abs(mean - (1.0 - block.θ) * v_then - block.θ * v))
        note(found, JudgedLaw.MOTION_LAW.value, off, ε * (abs(place[j]) + abs(then[i]) + h * (abs(v) + abs(v_then))))
        room.turning[j] = v_then + (mean - v_then) / block.θ - v
    apply(laws.turn, room.turning, room.turned)


@compiled(inline="always")
def find_forces(laws: MotionLaws, motion: StepMotion, new: int, room: Room) -> None:
    """Find the momenta and forces of a step."""
    now, then = motion.x[new], motion.x[1 - new]
    apply(laws.momentum, now, motion.momentum[new])
    if not is_empty(laws.elastic):
        apply(laws.elastic, now, motion.elastic[new])
        if len(room.reached) > 0:
            apply(laws.elastic, room.reached, room.elastic)
    if not is_empty(laws.damping):
        apply(laws.damping, now, motion.damping[new])
    if len(room.pull) > 0:
        for i in range(len(room.reach)):
            room.reach[i] = abs(now[i]) + abs(then[i])
        apply(laws.pull, room.reach, room.pull)
    apply(laws.push, then, room.push)
    apply(laws.pushes, then, room.pushes)


@compiled(inline="always")
def judge_all_nodes(
    block: BlockOfSteps, laws: MotionLaws, motion: StepMotion, new: int, room: Room, found: Found, special: bool
) -> bool:
    """Judge the nodes as `judge_nodes` does; unless ``special`` all have mass, and loads are constant."""
    h = block.h
    θ = block.θ
    ε = block.ε
    old = 1 - new
    n = len(room.push)
    now, then = motion.x[new], motion.x[old]
    stored = 0.0
    work = 0.0
    speed = found.energy[4]
    stiff = len(room.pull) > 0
    alike = not special or len(laws.kind) == 0
    moved_later = special and len(room.reached) > 0
    largest, floor = found.energy[7], NEGLIGIBLE * found.energy[7]
    works = 0.0
    rounding = 0.0
    lost = 0.0
    varying = special and (len(laws.driven) > 0 or not is_empty(laws.load))
    for start in range(0, n, STRIP):
        part = 0.0
        part_work = 0.0
        part_works = 0.0
        part_rounding = 0.0
        part_lost = 0.0
        for i in range(start, min(start + STRIP, n)):
            q = now[i]
            q_then = then[i]
            v = now[n + i]
            v_then = then[n + i]
            p, p_then, s, s_then = (
                motion.momentum[new, i], motion.momentum[old, i], motion.elastic[new, i], motion.elastic[old, i]
            )  # fmt: skip
            part += v * p + q * s
            if θ > 0.5:
                part_lost += (v - v_then) * (p - p_then) + (q - q_then) * (s - s_then)
            if moved_later:
                q, s = room.reached[i], room.elastic[i]
            moved = q - q_then
            damped = motion.damping[new, i] - motion.damping[old, i]
            elastic, load = h * ((1.0 - θ) * s_then + θ * s), room.load[i]
            defect = p - p_then + elastic + damped - load - room.push[i]
            size = abs(p) + abs(p_then) + (room.loads[i] if varying else abs(load)) + room.pushes[i]
            if stiff:
                size += room.pull[i]
                largest = max(largest, size)
            if not size < np.inf:
                return False
            speed = max(speed, abs(v))
            reach = abs(v) + room.pushes[i] * laws.per_mass[i]
            if reach > room.speed[i]:
                room.speed[i] = reach
            if varying:
                part_works += abs(moved) * size
                part_rounding += (abs(q) + abs(q_then)) * size
            if alike or laws.kind[i] == NodeKind.MASSIVE:
                note(found, JudgedLaw.MOMENTUM.value, abs(defect), ε * (size + floor))
                off = moved - h * ((1.0 - θ) * v_then + θ * v)
            elif laws.kind[i] == NodeKind.DRIVEN:
                part_work += moved * elastic
                continue
            else:
                note(found, JudgedLaw.EQUILIBRIUM.value, abs(defect) / h, ε * (size + floor) / h)
                off = moved - h * v
            note(found, JudgedLaw.KINEMATICS.value, abs(off), ε * (abs(q) + abs(q_then) + h * size * laws.per_mass[i]))
            part_work += moved * (load + room.push[i] - damped)
        stored += 0.5 * part
        work += part_work
        works += part_works
        rounding += part_rounding
        lost += part_lost
    change = stored - found.energy[2] - work / h
    found.energy[3] += change
    found.energy[8] += change + (θ - 0.5) * lost
    found.energy[9] = max(found.energy[9], -found.energy[8])
    found.energy[0] = max(found.energy[0], abs(found.energy[3]))
    found.energy[1] = max(found.energy[1], abs(stored))
    found.energy[2] = stored
    found.energy[4] = speed
    found.energy[5] = max(found.energy[5], works / h)
    found.energy[6] = found.energy[6] + rounding / h
    found.energy[7] = largest
    return True


@compiled()
def judge_nodes(block: BlockOfSteps, laws: MotionLaws, motion: StepMotion, new: int, room: Room, found: Found) -> bool:
    """Judge momentum, kinematics and energy of a step, and return whether its numbers are finite."""
    find_forces(laws, motion, new, room)
    if len(laws.kind) > 0 or not is_empty(laws.load):
        return judge_all_nodes(block, laws, motion, new, room, found, True)
    return judge_all_nodes(block, laws, motion, new, room, found, False)


@compiled()
def judge_contacts(
    block: BlockOfSteps, laws: MotionLaws, table: SparseTable, motion: StepMotion, new: int, room: Room, found: Found
) -> None:
    """Judge the law of impact and complementarity of a step, and keep the largest penetrations and rates."""
    h = block.h
    θ = block.θ
    ε = block.ε
    n = len(room.push)
    nc = len(laws.u0)
    now = motion.x[new]
    P = motion.x[1 - new, 2 * n : 2 * n + nc]
    before = motion.x[new, 2 * n : 2 * n + nc]
    for i in range(nc):
        room.predicted[i] = room.gap[i] + 0.5 * h * motion.rate[1 - new, i]
    apply(laws.gap, now, room.gap)
    apply(laws.rate, now, motion.rate[new])
    speed, place = 2.0 * found.energy[4], 0.0
    alike, turns = len(laws.impacts) == 0, len(laws.driven) > 0
    for i in range(n):
        place = max(place, abs(now[i]))
    for i in range(nc):
        U = motion.rate[new, i]
        off = U + laws.e[i] * motion.rate[1 - new, i] + (room.turned[i] if turns else 0.0)
        terms = abs(laws.u0[i]) + 2.0 * place + h * speed
        limit = ε * (speed + table.weight[i] * P[i] / θ)
        if not P[i] >= 0.0:
            note(found, JudgedLaw.COMPLEMENTARITY.value, np.inf, 1.0)
        elif not (alike or laws.impacts[i]):
            # At position level: where r acts, the contact is closed.
            note(found, JudgedLaw.COMPLEMENTARITY.value, P[i] / h * abs(room.gap[i]), P[i] / h * ε * terms)
        elif P[i] > 0.0:
            note(found, JudgedLaw.IMPACT_LAW.value, abs(off), limit)
            note(found, JudgedLaw.COMPLEMENTARITY.value, P[i] * abs(off), P[i] * limit)
            # A force at a distance; one that has just acted may go on where rounding has opened its contact.
            ahead = room.predicted[i] - table.near[i] * max(before[i], 0.0)
            note(found, JudgedLaw.COMPLEMENTARITY.value, P[i] / h * max(ahead, 0.0), P[i] / h * ε * terms)
        elif off < 0.0 and room.predicted[i] < -CLOSED_GAP_RTOL * terms:
            note(found, JudgedLaw.IMPACT_LAW.value, -off, limit)
        if abs(U) > room.rate[i]:
            room.rate[i] = abs(U)
        if -room.gap[i] > room.penetration[i]:
            room.penetration[i] = -room.gap[i]


@compiled(inline="always")
def record(path: ChosenSeries, k: int, n: int, x: Vector) -> None:
    """Write q and v of the chosen nodes at an instant."""
    for a in range(len(path.nodes)):
        path.q[k, a] = x[path.nodes[a]]
        path.v[k, a] = x[n + path.nodes[a]]


@compiled()
def find_ways(static: StaticCoordinates, force: Vector) -> None:
    """Overwrite the forces on the quasi-static coordinates by the ways to equilibrium, where Sᵀ K S is diagonal."""
    for s in range(len(force)):
        force[s] = force[s] / static.stiffness[s] if static.free[s] else 0.0


@compiled()
def balance_static(table: SparseTable, x: Vector, P: Vector, q: Vector) -> None:
    """Move the quasi-static coordinates that no closed contact holds to equilibrium."""
    static = table.static
    apply(table.unbalanced, x, static.force)
    static.free[:] = True
    for p in range(len(static.contact)):
        if P[static.contact[p]] > 0.0:
            static.free[static.held[p]] = False
    find_ways(static, static.force)
    for p in range(len(static.node)):
        q[static.node[p]] += static.force[static.of[p]]


@compiled()
def take_step(
    table: SparseTable,
    contacts: StepContacts,
    motion: StepMotion,
    new: int,
    room: Room,
    solve: ContactSolver,
    kernel: Kernel,
) -> tuple[int, int, float]:
    """Take one step: write P and w of the old numbers, and q and v of the new ones."""
    x = motion.x[1 - new]
    nc = len(contacts.L)
    ends = len(table.end.c)
    n = len(room.push)
    implicit = len(table.factor) > 0
    P = x[ends : ends + nc]
    w = x[len(x) - n if implicit else len(x) :]
    some = choose_active(table, contacts, x, motion.x[new, ends : ends + nc], room)
    for i in range(nc):
        P[i] = motion.x[new, ends + i] if contacts.active[i] else 0.0
    status = SOLVED
    count = 0
    residual = 0.0
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
    if len(room.reached) > 0:
        for i in range(n):
            room.reached[i] = motion.x[new, i]
        balance_static(table, x, P, motion.x[new, :n])
    return status, count, residual


@compiled(most=0)
def sparse_steps(
    block: BlockOfSteps,
    table: SparseTable,
    judge: tuple[MotionLaws, Room, Found],
    contacts: StepContacts,
    motion: StepMotion,
    path: ChosenSeries,
    solve: ContactSolver,
    kernel: Kernel,
) -> tuple[int, int, int, float]:
    """Take a block of steps, from the numbers at k % 2 to those at (k + 1) % 2: status, step, iterations, residual."""
    laws, room, found = judge
    n = len(table.end.c) // 2
    iterations = 0
    worst = 0.0
    given, inputs = block.given, 2 * n + len(room.gap)
    for k in range(block.first, block.last):
        new = (k + 1) % 2
        for a in range(given.inputs.shape[1]):
            motion.x[1 - new, inputs + a] = given.inputs[k - block.first, a]
        status, count, residual = take_step(table, contacts, motion, new, room, solve, kernel)
        iterations, worst = iterations + count, max(worst, residual)
        if status != SOLVED:
            return status, k, iterations, worst
        if not is_empty(laws.load):
            apply(laws.load, given.signals[k - block.first], room.load)
            apply(laws.loads, given.sizes[k - block.first], room.loads)
        if not judge_nodes(block, laws, motion, new, room, found):
            return NON_FINITE, k, iterations, worst
        if len(laws.driven) > 0:
            judge_motions(block, k, laws, motion, new, room, found)
        if len(room.gap) > 0:
            judge_contacts(block, laws, table, motion, new, room, found)
        record(path, k + 1, n, motion.x[new])
        for a in range(len(path.contacts)):
            path.r[k, a] = motion.x[1 - new, 2 * n + path.contacts[a]] / block.h
    return SOLVED, block.last, iterations, worst
