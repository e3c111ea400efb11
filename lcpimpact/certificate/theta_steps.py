"""Certificate of θ-steps, whose forces balance at t + θ h: exact to rounding except for kinks of positions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from lcpimpact.arrays import Array, Flags, largest
from lcpimpact.certificate.balances import judged_nodes
from lcpimpact.certificate.energy import Energies
from lcpimpact.certificate.impacts import largest_impulses, rows_by_name
from lcpimpact.certificate.laws import (
    early_velocities,
    law_residual,
    loads_in_steps,
    motion_forces_in_steps,
    node_kinds,
    rate_forces,
    row_kinds,
)
from lcpimpact.certificate.scales import Judgement, Scales, largest_spring_forces, largest_violation, sizes
from lcpimpact.certificate.theta_balance import Impulses, Judged, Recorded, Violations, judge_steps, kinds_of
from lcpimpact.events import steps_of
from lcpimpact.integrators.base import Limits
from lcpimpact.memo import once
from lcpimpact.numerics.rounding import EPS
from lcpimpact.record import SLIP_RTOL, Event, Record
from lcpimpact.scheme.dynamics import Dynamics
from lcpimpact.scheme.signals import jumps, limits_at


@once
def at_velocity_level(d: Dynamics) -> Flags:
    """Return the contacts whose law may be at velocity level, and those of impulse paths (nc,).

    Contacts of an impulse path over massless nodes meet at velocity level, and may penetrate as others close.
    """
    return np.asarray(((d.relative_degree == 2) & ~d.switches) | (d.impulse_lines > 0.0).any(axis=0))


@once
def _moves_all_nodes(d: Dynamics) -> bool:
    """Return whether no node is quasi-static."""
    return bool((node_kinds(d) >= 0).all())


def judge_theta_steps(
    d: Dynamics, record: Record, events: Sequence[Event], θ: float, limits: Limits
) -> tuple[Judgement, Scales, Energies]:
    """Judge the run of a θ-method."""
    f = d.force(np.zeros(1) if d.constant_loads else record.t)
    f_θ = np.zeros((0, len(d.nodes)))
    impulses = _impulses(d, record, events)
    pushes = record.reaction > 0.0
    pushes[impulses.step, impulses.row] |= impulses.P > 0.0
    early = early_velocities(d, record, pushes, θ)
    if d.force_laws:
        f_θ = motion_forces_in_steps(d, record, θ, early)
    if d.breaking_loads:
        # The mean of a step has the left limit of the loads at its end, and f the right one.
        f = d.force_limits(record.t)[1]
        f_θ = loads_in_steps(d, record.t, θ) - ((1.0 - θ) * f[:-1] + θ * f[1:]) + (f_θ if len(f_θ) else 0.0)
    judged = judge_steps(d, Recorded(record.t, record.q, record.v, record.reaction, f, f_θ, early), impulses, θ)
    violations, energies = judged.violations, judged.energies
    lengths = np.diff(record.t)
    h = float(lengths.max())
    loads = largest(f) + largest(f_θ)
    springs = largest_spring_forces(d, record.q, record.v)
    scales = Scales.of_largest(d, violations.q, violations.v, violations.r, loads, springs).at_least(h)
    steps = len(record.t) - 1
    duration = float(record.t[-1] - record.t[0]) or 1.0
    # In systems with jumps of coordinates, steps with θ = 1 are recognised by u, which is ambiguous if no contact is active.
    late = (1.0 - θ) * h / duration if d.D.any() else 0.0
    run = RunFigures(steps, duration, h, float(lengths.min()), late, limits.precision)
    largest_each = largest_impulses(d, events)
    found = _judge_nodes(d, (violations.kinematics, judged.momentum), scales, sizes(d).B @ largest_each, run)
    found |= _judge_contacts(d, record, judged, largest_each, scales, run, θ)
    # The energy balance of a step is an identity, except with springs in series and non-linear springs.
    if _moves_all_nodes(d) and not d.springs and (θ == 0.5 or d.stores_energy):
        ε = limits.precision + 8.0 * steps * EPS
        momenta = scales.momenta + h * scales.forces
        # Forces do their work on the rounding of places too.
        allowed = ε * (energies.scale + float(scales.v @ momenta)) + steps * EPS * float(scales.q @ scales.forces)
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


def _ways(d: Dynamics, judged: Violations, scales: Scales, run: RunFigures) -> tuple[Array, Array]:
    """Return the largest change of each gap in a step, and the rounding of a gap, in m (nc,)."""
    change = np.maximum(judged.gap_change, run.h * scales.U)
    for path in d.impulse_lines > 0.0:
        change[path] = change[path].sum()
    # A gap that is held closed is a sum of places that need not be small themselves.
    return change, run.precision * scales.u + 64.0 * EPS * scales.q.max(initial=0.0)


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
    judged: Judged,
    largest_each: Array,
    scales: Scales,
    run: RunFigures,
    θ: float,
) -> Judgement:
    """Judge complementarity, penetration, bounds and the law of impact, with the largest impulses (nc,)."""
    steps, rows = judged.violations, judged.rows
    gap_change, near = _ways(d, steps, scales, run)
    kinds = kinds_of(d)
    by_rate = at_velocity_level(d)
    at_places = kinds.plain & (d.relative_degree < 2) & ~kinds.on_path
    h = run.h
    ε = run.precision
    r = steps.r
    bounds = np.zeros(len(d.contacts))
    slip = bounds
    # At velocity level a contact may be open where it acts, by no more than the way of a step.
    apart = judged.apart.beyond(gap_change + near) * d.impenetrable
    product = np.maximum(steps.product, rows.friction)
    product = np.maximum(product, np.maximum(rows.apart, rows.overlapping) * at_places)
    product = np.maximum(product, apart * by_rate)
    penetration = np.maximum(steps.penetration, rows.penetration * kinds.plain)
    strict = (d.bilateral & ~d.of_rate) | (~by_rate & _moves_all_nodes(d))
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
        by_rate,
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
        "penetration": largest_violation(penetration, np.where(strict, 0.0, gap_change) + near),
        "tension": largest_violation(rows.tension, ε * beyond),
        "impact_law": largest_violation(np.maximum(steps.law, rows.missed), slow),
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
