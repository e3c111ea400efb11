"""Steps whose forces balance at t + θ h, judged there: all but kinks in position is exact."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lcpimpact.arrays import Array, Places
from lcpimpact.certificate.impacts import largest_impulses, rows_by_name
from lcpimpact.certificate.laws import motion_forces_in_steps, node_kinds
from lcpimpact.certificate.scales import Found, Scales, worst
from lcpimpact.certificate.theta_balance import (
    Contacts,
    Impulses,
    Nodes,
    Recorded,
    SparsityPattern,
    SpringLaws,
    Violations,
    certify_steps,
    no_violations,
    sums_for,
)
from lcpimpact.events import step_of
from lcpimpact.integrators.base import Limits
from lcpimpact.record import SLIP_RTOL, Event, Record
from lcpimpact.scheme.dynamics import Dynamics


def judge_theta_steps(
    d: Dynamics, record: Record, events: Sequence[Event], θ: float, limits: Limits
) -> tuple[Found, Scales, tuple[float, float]]:
    """Judge the steps of a θ-method."""
    f, f_θ = d.force(np.zeros(1) if d.constant_loads else record.t), np.zeros((0, len(d.nodes)))
    if d.force_laws:
        f_θ = motion_forces_in_steps(d, record, θ)
    of, balance, scale, h = _violations(d, record, events, θ, (f, f_θ))
    largest = np.abs(f).max(axis=0) + np.abs(f_θ).max(axis=0, initial=0.0)
    scales = Scales.of_largest(d, of.q, of.v, of.r, largest).at_least(d, h)
    found = {
        **_judge_nodes(d, record, events, (of, scales, h), θ, limits),
        **_judge_contacts(d, record, events, (of, scales, h), limits),
    }
    # The balance of a step is an identity for θ = 1/2, but for springs in series and non-linear ones.
    steps, identity = len(record.t) - 1, θ == 0.5 and bool((node_kinds(d) >= 0).all()) and not d.springs
    ε = limits.precision + 8.0 * steps * np.finfo(float).eps
    momenta = scales.momenta(d) + h * scales.forces(d)
    found["energy_balance"] = (balance, ε * (scale + float(of.v @ momenta)) if identity else np.inf)
    return found, scales, (balance, scale)


def _violations(
    d: Dynamics, record: Record, events: Sequence[Event], θ: float, forces: tuple[Array, Array]
) -> tuple[Violations, float, float, float]:
    """Return the largest violations of each contact and node, the balance of energy, its scale and the longest step."""
    rows = rows_by_name(d)
    acting = sorted(
        (step_of(event, record.t, record.q, record.v), rows[event.contact], event.impulse)
        for event in events
        if event.impulse != 0.0
    )
    step, row = (np.array([each[i] for each in acting], dtype=np.int64) for i in (0, 1))
    pattern, at = _pattern((d.M != 0.0) | (d.C != 0.0) | (d.K != 0.0))
    H_pattern, H_at = _pattern(d.H != 0.0)
    contacts = Contacts(
        *(H_pattern, d.H[H_at], np.array(d.B, order="C"), np.array(d.D, order="C"), d.u0.copy(), d.restitution),
        *(d.r_min, d.r_max, d.relative_degree, np.array(d.impulse_lines, order="C")),
    )
    of = no_violations(len(d.contacts), len(d.nodes))
    balance, scale, h = certify_steps(
        Recorded(record.t, record.q, record.v, record.reaction, *forces),
        Impulses(step, row, np.array([each[2] for each in acting])),
        float(θ),
        Nodes(pattern, d.M[at], d.C[at], d.K[at], node_kinds(d)),
        contacts,
        SpringLaws(d.directions, d.power_laws),
        sums_for(contacts, len(d.nodes)),
        of,
    )
    return of, balance, scale, h


def _pattern(filled: Array) -> tuple[SparsityPattern, tuple[Places, Places]]:
    """Return where the filled places of a matrix are, by rows, and their rows and columns."""
    rows, columns = np.nonzero(filled)
    starts = np.append(0, np.cumsum(np.count_nonzero(filled, axis=1)))
    places = rows.astype(np.uint64), columns.astype(np.uint64)
    return SparsityPattern(starts.astype(np.uint64), places[1]), places


def _judge_nodes(
    d: Dynamics,
    record: Record,
    events: Sequence[Event],
    seen: tuple[Violations, Scales, float],
    θ: float,
    limits: Limits,
) -> Found:
    """Judge momentum, kinematics and the balance of massless nodes."""
    of, scales, h = seen
    steps, duration = len(record.t) - 1, float(record.t[-1] - record.t[0]) or 1.0
    forces, pushed = scales.forces(d), np.abs(d.B) @ largest_impulses(d, events)
    ε = limits.precision + 8.0 * steps * np.finfo(float).eps
    # The length of a step is a difference of times, and has their rounding; an impulse is h times a mean force.
    blur, shortest = 4.0 * np.finfo(float).eps * duration, float(np.diff(record.t).min())
    # Which steps of a system that can jump were taken with θ = 1 is read off u, and not certain where no row pushes.
    late = (1.0 - θ) * h / duration if d.D.any() else 0.0
    allowed_p = ε * (scales.momenta(d) + h * forces) + blur * (steps * forces + pushed / shortest)
    allowed_f = late * forces + ε * (forces + (pushed + scales.momenta(d)) / duration)
    return {
        "momentum": worst(of.momentum, allowed_p),
        "equilibrium": worst(of.equilibrium / duration, allowed_f),
        "kinematics": worst(of.kinematics, limits.precision * (scales.q + h * scales.v)),
    }


def _judge_contacts(
    d: Dynamics, record: Record, events: Sequence[Event], seen: tuple[Violations, Scales, float], limits: Limits
) -> Found:
    """Judge complementarity, penetration, bounds and the law of impact."""
    (of, scales, h), ε = seen, limits.precision
    largest, bounds = largest_impulses(d, events), d.thresholds
    # A node with prescribed motion has the mean velocity of its step in the law, and its own in the record.
    turned = np.abs(np.diff(record.v[:, d.driven], axis=0)).max(axis=0, initial=0.0)
    slow = ε * scales.U.max(initial=0.0) + np.abs(d.H[:, d.driven]) @ turned
    # Contacts of an impulse path over massless nodes meet at velocity level, and may penetrate as others close.
    at_velocity_level = (d.relative_degree == 2) | (d.impulse_lines > 0.0).any(axis=0)
    strict = ~at_velocity_level & ~(node_kinds(d) < 0).any()
    stroke = np.maximum(of.stroke, h * scales.U)
    for path in d.impulse_lines > 0.0:
        stroke[path] = stroke[path].sum()
        slow[path] = np.maximum(slow[path], slow[path].sum())
    by_rounding = ε * (of.r * scales.u + h * bounds * scales.U) + 2.0 * bounds * _crept(d, record)
    products = np.where(at_velocity_level, (h * (of.r + bounds) + largest) * slow, by_rounding)
    return {
        "complementarity": worst(of.product, products),
        "penetration": worst(of.penetration, np.where(strict, 0.0, stroke) + ε * scales.u),
        "tension": worst(of.tension, ε * (of.r + largest / max(h, 1e-300))),
        "impact_law": worst(of.law, slow),
    }


def _crept(d: Dynamics, record: Record) -> Array:
    """Return the allowed backward slip in m of a slider on springs near its threshold, per step (nc,).

    It is `SLIP_RTOL` times its threshold on the springs that hold it, plus, since a node between springs alone is in balance
    at the end of a step whose force is that at t + θ h, the difference of successive displacements.
    """
    static = d.decomposition.static
    if not static.any() or not d.slides.any():
        return np.zeros(len(d.contacts))
    moves = d.H @ static
    gives = np.abs(moves * np.linalg.lstsq(static.T @ d.K @ static, moves.T, rcond=None)[0].T).sum(axis=1)
    held = d.slides & (d.relative_degree == 0)
    turned = np.abs(np.diff(np.diff(record.q, axis=0) @ d.H[held].T, axis=0)).max(axis=0, initial=0.0)
    crept = np.asarray(SLIP_RTOL * d.thresholds * gives)
    crept[held] += turned
    return crept
