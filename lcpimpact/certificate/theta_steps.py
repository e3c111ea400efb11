"""Certificate of θ-steps, whose forces balance at t + θ h: exact to rounding except for kinks of positions."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from lcpimpact.arrays import Array, Flags, Places, Vector, largest
from lcpimpact.certificate.balances import judged_nodes, momentum_imbalances
from lcpimpact.certificate.energy import Energies
from lcpimpact.certificate.impacts import largest_impulses, rows_by_name
from lcpimpact.certificate.laws import (
    RowViolations,
    early_velocities,
    judge_rows,
    law_residual,
    loads_in_steps,
    motion_forces_in_steps,
    node_kinds,
    rate_forces,
    row_kinds,
)
from lcpimpact.certificate.scales import Judgement, Scales, largest_spring_forces, largest_violation, sizes
from lcpimpact.certificate.theta_balance import (
    Impulses,
    Integrals,
    JudgedRows,
    Kinds,
    Nodes,
    Recorded,
    SparsityPattern,
    SpringLaws,
    Violations,
    block_steps,
    certify_steps,
    kinds_of,
    no_violations,
)
from lcpimpact.events import steps_of
from lcpimpact.integrators.base import Limits
from lcpimpact.memo import once
from lcpimpact.numerics.rounding import EPS
from lcpimpact.record import SLIP_RTOL, Event, Record
from lcpimpact.scheme.dynamics import Dynamics
from lcpimpact.scheme.signals import jumps, limits_at


class Constants(NamedTuple):
    """The constants of a system that the certificates of all its runs share.

    Attributes
    ----------
    loads : (1, n) array                the loads at t = 0, those of the run if they are constant
    nodes, contacts, springs            the system for the compiled loop
    kinds : Kinds                       rows with a feedthrough, and rows on impulse paths
    balances : bool                     whether no node is quasi-static
    at_velocity_level : (nc,) flags     contacts whose law may be at velocity level, and those of impulse paths
    strict : (nc,) flags                rows that must not penetrate
    feeds_through : bool                whether D is not zero
    """

    loads: Array
    nodes: Nodes
    contacts: JudgedRows
    springs: SpringLaws
    kinds: Kinds
    balances: bool
    at_velocity_level: Flags
    strict: Flags
    feeds_through: bool


@once
def _constants(d: Dynamics) -> Constants:
    """Return the constants of a system that the certificates of all its runs share."""
    pattern, at = _pattern((d.M != 0.0) | (d.C != 0.0) | (d.K != 0.0))
    H_pattern, H_at = _pattern(d.H != 0.0)
    contacts = JudgedRows(
        *(H_pattern, d.H[H_at], np.array(d.B, order="C"), np.array(d.D, order="C"), d.u0.copy(), d.restitution),
        *(d.r_min, d.relative_degree, np.array(d.impulse_lines, order="C")),
    )
    balances = bool((node_kinds(d) >= 0).all())
    # Contacts of an impulse path over massless nodes meet at velocity level, and may penetrate as others close.
    at_velocity_level = ((d.relative_degree == 2) & ~d.switches) | (d.impulse_lines > 0.0).any(axis=0)
    return Constants(
        d.force(np.zeros(1)),
        Nodes(pattern, d.M[at], d.C[at], d.K[at], node_kinds(d)),
        contacts,
        SpringLaws(d.directions, d.power_laws),
        kinds_of(d),
        balances,
        at_velocity_level,
        (d.bilateral & ~d.of_rate) | (~at_velocity_level & balances),
        bool(d.D.any()),
    )


def judge_theta_steps(
    d: Dynamics, record: Record, events: Sequence[Event], θ: float, limits: Limits
) -> tuple[Judgement, Scales, Energies]:
    """Judge the run of a θ-method."""
    f = _constants(d).loads if d.constant_loads else d.force(record.t)
    f_θ = np.zeros((0, len(d.nodes)))
    if d.force_laws:
        f_θ = motion_forces_in_steps(d, record, θ)
    if d.breaking_loads:
        # The mean of a step has the left limit of the loads at its end, and f the right one.
        f = d.force_limits(record.t)[1]
        f_θ = loads_in_steps(d, record.t, θ) - ((1.0 - θ) * f[:-1] + θ * f[1:]) + (f_θ if len(f_θ) else 0.0)
    impulses = _impulses(d, record, events)
    violations, momentum, energies, h = _violations(d, record, impulses, θ, (f, f_θ))
    loads = largest(f) + largest(f_θ)
    springs = largest_spring_forces(d, record.q, record.v)
    scales = Scales.of_largest(d, violations.q, violations.v, violations.r, loads, springs).at_least(h)
    steps = len(record.t) - 1
    duration = float(record.t[-1] - record.t[0]) or 1.0
    # In systems with jumps of coordinates, steps with θ = 1 are recognised by u, which is ambiguous if no contact is active.
    late = (1.0 - θ) * h / duration if _constants(d).feeds_through else 0.0
    run = RunFigures(steps, duration, h, float(np.diff(record.t).min()), late, limits.precision)
    largest_each = largest_impulses(d, events)
    found = _judge_nodes(d, (violations.kinematics, momentum), scales, sizes(d).B @ largest_each, run)
    found |= _judge_contacts(d, record, impulses, largest_each, violations, scales, run, θ)
    # The energy balance of a step is an identity, except with springs in series and non-linear springs.
    if _constants(d).balances and not d.springs and (θ == 0.5 or d.stores_energy):
        ε = limits.precision + 8.0 * steps * EPS
        momenta = scales.momenta + h * scales.forces
        allowed = ε * (energies.scale + float(scales.v @ momenta))
        name, off = ("energy_balance", energies.imbalance) if θ == 0.5 else ("energy_loss", energies.loss)
        found[name] = off, allowed
    return found, scales, energies


def _impulses(d: Dynamics, record: Record, events: Sequence[Event]) -> Impulses:
    """Return the impulses of a run in the order of their steps."""
    rows = rows_by_name(d)
    struck = [event for event in events if event.impulse != 0.0]
    step = steps_of(struck, record.t, record.q, record.v)
    row = np.array([rows[event.contact] for event in struck], dtype=np.int64)
    impulse = np.array([event.impulse for event in struck])
    order = np.lexsort((impulse, row, step)) if struck else step
    return Impulses(step[order], row[order], impulse[order])


def _ways(d: Dynamics, judged: Violations[Vector], scales: Scales, run: RunFigures) -> tuple[Array, Array]:
    """Return the largest change of each gap in a step, and the rounding of a gap, in m (nc,)."""
    change = np.maximum(judged.gap_change, run.h * scales.U)
    for path in d.impulse_lines > 0.0:
        change[path] = change[path].sum()
    # A gap that is held closed is a sum of places that need not be small themselves.
    return change, run.precision * scales.u + 64.0 * EPS * scales.q.max(initial=0.0)


def _judge_rows(
    d: Dynamics, record: Record, impulses: Impulses, way: Array, *, numbers: int = 1 << 13
) -> RowViolations:
    """Judge the laws of the rows at the ends of the steps, by their mean reactions with impulses, and mean rates.

    At velocity level a contact may be open where it acts, by no more than the ``way`` of a step (nc,): it is ``apart`` by
    what it is open beyond that at both ends of the step.
    They are judged in parts of so many ``numbers`` that these stay in the cache.
    """
    nc = len(d.contacts)
    found = RowViolations(*np.zeros((6, nc)))
    of_rate = row_kinds(d).some_of_rate
    steps = len(record.t) - 1
    length = max(1, numbers // max(1, nc))
    for first in range(0, steps if nc else 0, length):
        last = min(first + length, steps)
        h = np.diff(record.t[first : last + 1])[:, None]
        r = record.reaction[first:last]
        here = slice(*np.searchsorted(impulses.step, (first, last)))
        if here.start < here.stop:
            at = impulses.step[here] - first
            r = r.copy()
            np.add.at(r, (at, impulses.row[here]), impulses.P[here] / h[at, 0])
        ends = _images(d.H, record.q[first : last + 1]) + d.u0
        beyond = np.maximum(np.minimum(ends[:-1], ends[1:]) - way, 0.0)
        u = ends[1:]
        U = u
        if of_rate:
            # At velocity level a row of the rate obeys the law of impact.
            rate = _images(d.H, record.v[first : last + 1])
            mean = _images(d.H, np.diff(record.q[first : last + 1], axis=0) / h)
            U = np.where(d.relative_degree == 2, rate[1:] + d.restitution * rate[:-1], mean)
        rows = judge_rows(d, r, u, U, partial(np.multiply, h))
        apart = np.where(_constants(d).at_velocity_level, largest(r * beyond) * d.impenetrable, rows.apart)
        found = found.larger(rows._replace(apart=apart))
    return found


def _violations(
    d: Dynamics, record: Record, impulses: Impulses, θ: float, forces: tuple[Array, Array]
) -> tuple[Violations[Vector], Array, Energies, float]:
    """Return the largest violations of each row and node, and imbalance of momentum of each node in N s (n,).

    And the energies, and the longest step.
    """
    constants = _constants(d)
    nc, n = len(d.contacts), len(d.nodes)
    steps = len(record.t) - 1
    length = block_steps(nc, n, steps)
    violations = no_violations(nc, n, length)
    ends = np.append(np.arange(0, steps, length), steps)
    count = len(ends) - 1
    integrals = Integrals(np.zeros((count, n)), np.zeros((count, n)), np.zeros((count, nc)))
    pushes = record.reaction > 0.0
    pushes[impulses.step, impulses.row] |= impulses.P > 0.0
    balance, loss, scale, h = certify_steps(
        Recorded(record.t, record.q, record.v, record.reaction, *forces, early_velocities(d, record, pushes, θ)),
        impulses,
        float(θ),
        constants.nodes,
        constants.contacts,
        constants.springs,
        constants.kinds,
        integrals,
        violations,
    )
    pushed = integrals.f + integrals.r @ d.B.T - integrals.q @ d.K.T - np.diff(record.q[ends], axis=0) @ d.C.T
    momentum = largest(np.cumsum(momentum_imbalances(d, record.q[ends], record.v[ends], pushed), axis=0))
    return Violations(*(each.max(axis=1) for each in violations)), momentum, Energies(balance, scale, loss), h


def _pattern(filled: Array) -> tuple[SparsityPattern, tuple[Places, Places]]:
    """Return the sparsity pattern of a matrix in compressed rows, and the rows and columns of its entries."""
    rows, columns = np.nonzero(filled)
    starts = np.append(0, np.cumsum(np.count_nonzero(filled, axis=1)))
    places = rows.astype(np.uint64), columns.astype(np.uint64)
    return SparsityPattern(starts.astype(np.uint64), places[1]), places


class RunFigures(NamedTuple):
    """The figures of a run that set its limits: number of steps, duration, longest and shortest step.

    ``late`` is the part of h by which a balance of forces may lie off, relative to the duration, and ``precision`` the
    precision to which laws are solved.
    """

    steps: int
    duration: float
    h: float
    shortest: float
    late: float
    precision: float


def _judge_nodes(
    d: Dynamics, imbalances: tuple[Array, Array], scales: Scales, pushed: Array, run: RunFigures
) -> Judgement:
    """Judge momentum, the balance of massless nodes and kinematics; nodes are ``pushed`` by the largest impulses."""
    kinematics, momentum = imbalances
    nodes = judged_nodes(d)
    h, ε = run.h, run.precision + 8.0 * run.steps * EPS
    # A step length is a difference of times and inherits their rounding; an impulse is h times a mean force.
    blur = 4.0 * EPS * run.duration
    p, f = scales.momenta, scales.forces
    allowed_p = ε * (p + h * f) + blur * (run.steps * f + pushed / run.shortest)
    allowed_f = run.late * f + ε * (f + (pushed + p) / run.duration)
    return {
        "momentum": largest_violation(momentum * nodes.massive, allowed_p),
        "equilibrium": largest_violation(momentum * nodes.massless / run.duration, allowed_f),
        "kinematics": largest_violation(kinematics, run.precision * (scales.q + h * scales.v)),
    }


def _judge_contacts(
    d: Dynamics,
    record: Record,
    impulses: Impulses,
    largest_each: Array,
    judged: Violations[Vector],
    scales: Scales,
    run: RunFigures,
    θ: float,
) -> Judgement:
    """Judge complementarity, penetration, bounds and the law of impact, with the largest impulses (nc,)."""
    gap_change, near = _ways(d, judged, scales, run)
    rows = _judge_rows(d, record, impulses, gap_change + near)
    constants = _constants(d)
    kinds = constants.kinds
    at_places = kinds.plain & (d.relative_degree < 2) & ~kinds.on_path
    h = run.h
    ε = run.precision
    r = judged.r
    bounds = np.zeros(len(d.contacts))
    slip = bounds
    product = np.maximum(judged.product, rows.friction)
    product = np.maximum(product, np.maximum(rows.apart, rows.overlapping) * at_places)
    product = np.maximum(product, rows.apart * constants.at_velocity_level)
    penetration = np.maximum(judged.penetration, rows.penetration * kinds.plain)
    if row_kinds(d).some_of_rate:
        # Friction is bounded by the normal force, and its impulse by that of the normal row.
        bounds = rate_forces(d, r)
        slip = _slip_tolerance(d, record)
        largest_each = np.maximum(largest_each, d.friction_bounds(largest_each) * d.tangential)
    slow = np.full(len(bounds), ε * scales.U.max(initial=0.0))
    if d.motions:
        # A node with prescribed motion has the mean velocity of its step in the law, and its own in the record.
        turned = np.abs(np.diff(record.v[:, d.driven], axis=0)).max(axis=0, initial=0.0)
        slow += sizes(d).H[:, d.driven] @ turned
    for path in d.impulse_lines > 0.0:
        slow[path] = np.maximum(slow[path], slow[path].sum())
    allowed = np.where(
        constants.at_velocity_level,
        (h * (r + bounds) + largest_each) * slow,
        r * near + ε * h * bounds * scales.U + 2.0 * bounds * slip,
    )
    if d.switches.any():
        # Forces that balance at rest leave their rounding in u.
        reach = ε * scales.u + 64.0 * EPS * h * (sizes(d).H @ scales.forces)
        allowed = np.where(d.switches, (d.r_max - d.r_min) * reach, allowed)
        product = np.maximum(product, _missing_switches(d, record, θ))
    beyond = r + bounds * d.tangential + largest_each / max(h, 1e-300)
    return {
        "complementarity": largest_violation(product, allowed),
        "penetration": largest_violation(penetration, np.where(constants.strict, 0.0, gap_change) + near),
        "tension": largest_violation(rows.tension, ε * beyond),
        "impact_law": largest_violation(np.maximum(judged.law, rows.missed), slow),
    }


def _missing_switches(d: Dynamics, record: Record, θ: float) -> Array:
    """Return by how much relays miss their law in any step (nc,), with the u of `lcpimpact.integrators.moreau_jean`."""
    t = record.t
    q = record.q
    r = record.reaction
    end = _ends_of_steps(d, t, q)
    u, in_step = _images(d.H, end) + d.u0, np.diag(d.D) > 0.0
    if in_step.any():
        u = np.where(in_step, _images(d.H, (1.0 - θ) * q[:-1] + θ * end) + d.u0, u)
    u += _images(d.D, r)
    late = d.switches & (d.relative_degree > 1)
    if late.any():
        h = np.diff(t)
        level = np.rint(np.log2(h.max() / h))
        implicit = np.empty_like(q[1:])
        for k in np.unique(level):
            here = level == k
            A = d.C + h[here].mean() * d.K
            A[d.driven] = np.eye(len(A))[d.driven]
            forces = d.force_limits(t)[0][1:][here] + _images(d.B, r[here])
            right = _images(d.C, q[:-1][here]) + h[here, None] * forces
            right[:, d.driven] = end[here][:, d.driven]
            implicit[here] = np.linalg.solve(A, right.T).T
        u = np.where(late, _images(d.H, implicit) + d.u0, u)
    return np.asarray(law_residual(d, r, u, d.switches).max(axis=0, initial=0.0))


def _ends_of_steps(d: Dynamics, t: Array, q: Array) -> Array:
    """Return q at the ends of the steps, with the left limits of inputs that jump (steps, n)."""
    end = q[1:].copy()
    for i, motion in d.motions.items():
        if jumps(motion):
            end[:, i] = limits_at(motion, t)[0][1:]
    return end


def _images(A: Array, x: Array) -> Array:
    """Return A x of many instants, x (nt, n), by the entries of A: for a few columns BLAS would start threads (nt, m)."""
    found = np.zeros((len(x), len(A)))
    for i, j in np.argwhere(A):
        found[:, i] += A[i, j] * x[:, j]
    return found


def _slip_tolerance(d: Dynamics, record: Record) -> Array:
    """Return the allowed backward slip in m of a slider on springs near its threshold, per step (nc,).

    It is `SLIP_RTOL` times the deflection of the adjacent springs at the threshold, plus the difference of successive
    displacements, since a node between springs is in balance at the end of a step and its force is that at t + θ h.
    """
    static = d.decomposition.static
    if not static.any() or not (d.limited & d.of_rate).any():
        return np.zeros(len(d.contacts))
    moves = d.H @ static
    gives = np.abs(moves * np.linalg.lstsq(static.T @ d.K @ static, moves.T, rcond=None)[0].T).sum(axis=1)
    held = d.limited & d.of_rate & (d.relative_degree == 0)
    turned = np.abs(np.diff(np.diff(record.q, axis=0) @ d.H[held].T, axis=0)).max(axis=0, initial=0.0)
    tolerance = np.asarray(SLIP_RTOL * d.thresholds * gives)
    tolerance[held] += turned
    return tolerance
