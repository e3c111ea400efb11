"""Certificate of θ-steps, whose forces balance at t + θ h: exact to rounding except for kinks of positions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from lcpimpact.arrays import Array, Flags, Indices, Places
from lcpimpact.certificate.impacts import largest_impulses, rows_by_name
from lcpimpact.certificate.laws import motion_forces_in_steps, node_kinds, switch_residual
from lcpimpact.certificate.scales import Judgement, Scales, largest_violation, sizes
from lcpimpact.certificate.theta_balance import (
    Contacts,
    Impulses,
    Nodes,
    Recorded,
    SparsityPattern,
    SpringLaws,
    Sums,
    Violations,
    certify_steps,
    no_violations,
    sums_for,
)
from lcpimpact.events import steps_of
from lcpimpact.integrators.base import Limits
from lcpimpact.record import SLIP_RTOL, Event, Record
from lcpimpact.scheme.dynamics import Dynamics, once
from lcpimpact.scheme.terms import RowLaw

EPS = float(np.finfo(float).eps)


class Constants(NamedTuple):
    """What the certificates of all runs of a system have in common.

    Attributes
    ----------
    loads : (1, n) array                the loads at t = 0, those of the run if they are constant
    nodes, contacts, springs            the system for the compiled loop
    sums : Sums                         those at the start of a run
    balances : bool                     whether no node is held by springs alone
    at_velocity_level : (nc,) flags     contacts whose law may be at velocity level, and those of impulse paths
    strict : (nc,) flags                rows that must not penetrate
    rubs, switches : bool               whether there is dry friction, and whether there are relays
    """

    loads: Array
    nodes: Nodes
    contacts: Contacts
    springs: SpringLaws
    sums: Sums
    balances: bool
    at_velocity_level: Flags
    strict: Flags
    rubs: bool
    switches: bool


@once
def _constants(d: Dynamics) -> Constants:
    """Return what the certificates of all runs of a system have in common."""
    pattern, at = _pattern((d.M != 0.0) | (d.C != 0.0) | (d.K != 0.0))
    H_pattern, H_at = _pattern(d.H != 0.0)
    contacts = Contacts(
        *(H_pattern, d.H[H_at], np.array(d.B, order="C"), np.array(d.D, order="C"), d.u0.copy(), d.restitution),
        *(d.r_min, d.r_max, d.relative_degree, _codes(d)),
        *(d.mu, d.mu_s, d.normals, np.array(d.impulse_lines, order="C")),
    )
    balances = bool((node_kinds(d) >= 0).all())
    # Contacts of an impulse path over massless nodes meet at velocity level, and may penetrate as others close.
    at_velocity_level = ((d.relative_degree == 2) & ~d.relays) | (d.impulse_lines > 0.0).any(axis=0)
    return Constants(
        d.force(np.zeros(1)),
        Nodes(pattern, d.M[at], d.C[at], d.K[at], node_kinds(d)),
        contacts,
        SpringLaws(d.directions, d.power_laws),
        sums_for(contacts, len(d.nodes)),
        balances,
        at_velocity_level,
        d.joints | (~at_velocity_level & balances),
        bool(d.rubs.any()),
        bool(d.relays.any()),
    )


def judge_theta_steps(
    d: Dynamics, record: Record, events: Sequence[Event], θ: float, limits: Limits
) -> tuple[Judgement, Scales, tuple[float, float]]:
    """Judge the run of a θ-method."""
    f, f_θ = _constants(d).loads if d.constant_loads else d.force(record.t), np.zeros((0, len(d.nodes)))
    if d.force_laws:
        f_θ = motion_forces_in_steps(d, record, θ)
    violations, balance, scale, h = _violations(d, record, events, θ, (f, f_θ))
    largest = np.abs(f).max(axis=0) + np.abs(f_θ).max(axis=0, initial=0.0)
    scales = Scales.of_largest(d, violations.q, violations.v, violations.r, largest).at_least(h)
    found = {
        **_judge_nodes(d, record, events, (violations, scales, h), θ, limits),
        **_judge_contacts(d, record, events, (violations, scales, h), θ, limits),
    }
    # The energy balance of a step is an identity for θ = 1/2, except with springs in series and non-linear springs.
    steps, identity = len(record.t) - 1, θ == 0.5 and _constants(d).balances and not d.springs
    ε = limits.precision + 8.0 * steps * EPS
    momenta = scales.momenta + h * scales.forces
    found["energy_balance"] = (balance, ε * (scale + float(scales.v @ momenta)) if identity else np.inf)
    return found, scales, (balance, scale)


def _violations(
    d: Dynamics, record: Record, events: Sequence[Event], θ: float, forces: tuple[Array, Array]
) -> tuple[Violations, float, float, float]:
    """Return the largest violations of each contact and node, the energy imbalance, its scale and the longest step."""
    rows, constants = rows_by_name(d), _constants(d)
    struck = [event for event in events if event.impulse != 0.0]
    step = steps_of(struck, record.t, record.q, record.v)
    row = np.array([rows[event.contact] for event in struck], dtype=np.int64)
    impulse = np.array([event.impulse for event in struck])
    order = np.lexsort((impulse, row, step)) if struck else step
    violations = no_violations(len(d.contacts), len(d.nodes))
    balance, scale, h = certify_steps(
        Recorded(record.t, record.q, record.v, record.reaction, *forces),
        Impulses(step[order], row[order], impulse[order]),
        float(θ),
        constants.nodes,
        constants.contacts,
        constants.springs,
        Sums._make(each.copy() for each in constants.sums),
        violations,
    )
    return violations, balance, scale, h


def _codes(d: Dynamics) -> Indices:
    """Return the law of each row by its position in `RowLaw` (nc,)."""
    laws = list(RowLaw)
    return np.array([laws.index(contact.law) for contact in d.contacts], dtype=np.int64)


def _pattern(filled: Array) -> tuple[SparsityPattern, tuple[Places, Places]]:
    """Return the sparsity pattern of a matrix in compressed rows, and the rows and columns of its entries."""
    rows, columns = np.nonzero(filled)
    starts = np.append(0, np.cumsum(np.count_nonzero(filled, axis=1)))
    places = rows.astype(np.uint64), columns.astype(np.uint64)
    return SparsityPattern(starts.astype(np.uint64), places[1]), places


def _judge_nodes(
    d: Dynamics,
    record: Record,
    events: Sequence[Event],
    results: tuple[Violations, Scales, float],
    θ: float,
    limits: Limits,
) -> Judgement:
    """Judge momentum, kinematics and the balance of massless nodes."""
    violations, scales, h = results
    steps, duration = len(record.t) - 1, float(record.t[-1] - record.t[0]) or 1.0
    forces, pushed = scales.forces, sizes(d).B @ largest_impulses(d, events)
    ε = limits.precision + 8.0 * steps * EPS
    # A step length is a difference of times and inherits their rounding; an impulse is h times a mean force.
    blur, shortest = 4.0 * EPS * duration, float(np.diff(record.t).min())
    # In systems with jumps of coordinates, steps with θ = 1 are recognised by u, which is ambiguous if no contact is active.
    late = (1.0 - θ) * h / duration if d.D.any() else 0.0
    allowed_p = ε * (scales.momenta + h * forces) + blur * (steps * forces + pushed / shortest)
    allowed_f = late * forces + ε * (forces + (pushed + scales.momenta) / duration)
    return {
        "momentum": largest_violation(violations.momentum, allowed_p),
        "equilibrium": largest_violation(violations.equilibrium / duration, allowed_f),
        "kinematics": largest_violation(violations.kinematics, limits.precision * (scales.q + h * scales.v)),
    }


def _judge_contacts(
    d: Dynamics,
    record: Record,
    events: Sequence[Event],
    results: tuple[Violations, Scales, float],
    θ: float,
    limits: Limits,
) -> Judgement:
    """Judge complementarity, penetration, bounds and the law of impact."""
    (violations, scales, h), ε, constants = results, limits.precision, _constants(d)
    largest, bounds = largest_impulses(d, events), d.friction_bounds(violations.r)
    if constants.rubs:
        # Friction is bounded by the normal force, and its impulse by that of the normal row.
        largest = np.maximum(largest, d.friction_bounds(largest) * d.frictional)
    slow = np.full(len(d.contacts), ε * scales.U.max(initial=0.0))
    if d.motions:
        # A node with prescribed motion has the mean velocity of its step in the law, and its own in the record.
        turned = np.abs(np.diff(record.v[:, d.driven], axis=0)).max(axis=0, initial=0.0)
        slow += sizes(d).H[:, d.driven] @ turned
    gap_change = np.maximum(violations.gap_change, h * scales.U)
    for path in d.impulse_lines > 0.0:
        gap_change[path] = gap_change[path].sum()
        slow[path] = np.maximum(slow[path], slow[path].sum())
    # A gap that is held closed is a sum of places that need not be small themselves.
    near = ε * scales.u + 64.0 * EPS * scales.q.max(initial=0.0)
    by_rounding = violations.r * near
    if constants.rubs:
        by_rounding += ε * h * bounds * scales.U + 2.0 * bounds * _slip_tolerance(d, record)
    products = np.where(constants.at_velocity_level, (h * (violations.r + bounds) + largest) * slow, by_rounding)
    product = violations.product
    if constants.switches:
        # Forces that balance at rest leave their rounding in u.
        reach = ε * scales.u + 64.0 * EPS * h * (sizes(d).H @ scales.forces)
        products = np.where(d.relays, (d.r_max - d.r_min) * reach, products)
        product = np.maximum(product, _missing_switches(d, record, θ))
    return {
        "complementarity": largest_violation(product, products),
        "penetration": largest_violation(violations.penetration, np.where(constants.strict, 0.0, gap_change) + near),
        "tension": largest_violation(
            violations.tension, ε * (violations.r + bounds * d.frictional + largest / max(h, 1e-300))
        ),
        "impact_law": largest_violation(violations.law, slow),
    }


def _missing_switches(d: Dynamics, record: Record, θ: float) -> Array:
    """Return by how much relays miss their law in any step (nc,), with the u of `lcpimpact.integrators.moreau_jean`."""
    t, q, r = record.t, record.q, record.reaction
    u, in_step = _images(d.H, q[1:]) + d.u0, np.diag(d.D) > 0.0
    if in_step.any():
        u = np.where(in_step, _images(d.H, (1.0 - θ) * q[:-1] + θ * q[1:]) + d.u0, u)
    u += _images(d.D, r)
    late = d.relays & (d.relative_degree > 1)
    if late.any():
        h = np.diff(t)
        level = np.rint(np.log2(h.max() / h))
        implicit = np.empty_like(q[1:])
        for k in np.unique(level):
            here = level == k
            A = d.C + h[here].mean() * d.K
            A[d.driven] = np.eye(len(A))[d.driven]
            forces = d.force(t[1:][here]) + _images(d.B, r[here])
            right = _images(d.C, q[:-1][here]) + h[here, None] * forces
            right[:, d.driven] = q[1:][here][:, d.driven]
            implicit[here] = np.linalg.solve(A, right.T).T
        u = np.where(late, _images(d.H, implicit) + d.u0, u)
    return np.asarray(switch_residual(d, r, u).max(axis=0, initial=0.0))


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
    if not static.any() or not d.slides.any():
        return np.zeros(len(d.contacts))
    moves = d.H @ static
    gives = np.abs(moves * np.linalg.lstsq(static.T @ d.K @ static, moves.T, rcond=None)[0].T).sum(axis=1)
    held = d.slides & (d.relative_degree == 0)
    turned = np.abs(np.diff(np.diff(record.q, axis=0) @ d.H[held].T, axis=0)).max(axis=0, initial=0.0)
    tolerance = np.asarray(SLIP_RTOL * d.thresholds * gives)
    tolerance[held] += turned
    return tolerance
