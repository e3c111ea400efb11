"""Events of methods without event location, from their recorded steps, and contact intervals of springs."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse.csgraph import connected_components

from lcpimpact.arrays import Array, Flags, Indices, largest
from lcpimpact.integrators.stepping.impulses import Blow, own_compliances, separate, smooth_change, takes_part
from lcpimpact.memo import once
from lcpimpact.numerics.rounding import EPS
from lcpimpact.record import SLIP_RTOL, ContinuousSolution, Event, Record, State
from lcpimpact.scheme.dynamics import Dynamics
from lcpimpact.scheme.lagrangian import LagrangianDynamics
from lcpimpact.scheme.signals import PiecewisePolynomial, terms_of
from lcpimpact.scheme.structure import Contact

TOUCH_RTOL = 8.0 * EPS
"""Approach, relative to the terms of its sum, below which it is rounding."""

RowEvent = tuple[float, int, Event]
"""An event with its instant and its row."""

Reading = Callable[[float], tuple[Array, Array]]
"""Takes a time, and returns q and v (1, n)."""


def events_of_steps(dynamics: Dynamics, record: Record, impact_steps: int = 1) -> tuple[tuple[Event, ...], Flags]:
    """Return the changes of the contact mode in a run, in the order of time, and which reactions are impulses.

    A closing is where the gap, an opening where the reaction, extrapolated from its last two positive values, reaches
    zero, within the step that it must lie in; limits are the neighbouring values on the grid. Where both sides of a contact
    have mass, the step that closes it, or the first ``impact_steps`` of them, holds an impact: its mean force is an impulse
    over h and belongs to the event. So does the step in which all contacts of an impulse path come to push. Friction has an
    impulse where its normal force has one, and a joint where a body that it holds has one.

    In a step with an impact, rows that were closed before take part too: their impulses are separated from their forces
    (`lcpimpact.integrators.stepping.impulses`), which take the place of their reactions in the record.
    """
    impulsive = np.zeros(record.reaction.shape, dtype=bool)
    if len(record.t) < 2:
        return (), impulsive
    steps_of_force = len(record.t_reaction) < len(record.t)
    struck = _struck(dynamics, record)
    joined = _joints_struck_by(dynamics)
    found: list[RowEvent] = []
    pushes = _pushes(dynamics, record)
    # An impact that is spread over several steps touches in the next one anyway.
    again = _struck_again(dynamics, record, pushes) if steps_of_force and impact_steps == 1 else set()
    blows: dict[int, dict[int, Event]] = {}
    for i, contact in enumerate(dynamics.contacts):
        r = record.reaction[:, i]
        if not contact.impenetrable:
            continue
        closed = pushes[:, i]
        before = closed.copy()
        before[1:] = closed[:-1]
        u = dynamics.gap(record.t[0], record.q[0])[i]
        U = dynamics.gap_rate(record.t[0], record.q[0], record.v[0])[i]
        if steps_of_force:
            # The first step closes a contact that is initially open, or that closes with an impact between two masses.
            before[0] &= u <= 0.0 and (contact.relative_degree < 2 or U >= 0.0)
        elif u <= 0.0 and closed[1]:
            # Plates in contact at the start are closed, even if their force starts from zero.
            before[0] = before[1] = closed[0] = True
        hit = {step for step, row in (*struck, *again) if row == i}
        for j in sorted({*map(int, np.flatnonzero(closed != before)), *hit}):
            # j is the first sample of the new mode: a node, or the step that begins there; the switch is after ``node``.
            node = j if steps_of_force else j - 1
            last = min(node + 1, len(record.t) - 1)
            if before[j] and j not in hit:
                t = zero(record.t_reaction[j - 2 : j], r[j - 2 : j], record.t_reaction[j - 1], record.t_reaction[j])
                kind = "open"
                impacts = contact.relative_degree == 2 or j - 1 in hit
                if impacts and not before[max(j - impact_steps, 0) : j].all():
                    continue
            else:
                # With a feedthrough D r, the gaps on the grid do not show the switch.
                ends = slice(node - 1, node + 1)
                gaps = np.zeros(0) if dynamics.D[i].any() else dynamics.gap(record.t[ends], record.q[ends])[:, i]
                t = zero(record.t[ends], gaps, record.t[node], record.t[last])
                kind = "impact" if contact.relative_degree == 2 or j in hit else "close"
                t = struck.get((j, i), t)
            steps, h = slice(j, j + impact_steps), record.t[last] - record.t[node]
            impulse = 0.0
            if kind == "impact":
                impulse = float(r[steps].sum() * h)
                impulsive[steps, i] = True
            left, right = _limit(record, node, j - 1), _limit(record, last, j)
            event = Event(t, contact.name, kind, left, right, impulse, "newton" if kind == "impact" else "")
            found.append((t, i, event))
            if kind == "impact":
                blows.setdefault(j, {})[i] = event
            others = [*np.flatnonzero(dynamics.normals == i), *joined[i]] if kind == "impact" else []
            for k in (each for each in others if not impulsive[j, each]):
                impulse = float(record.reaction[steps, k].sum() * h)
                impulsive[steps, k] = True
                if impulse != 0.0:
                    name, law = dynamics.contacts[k].name, dynamics.law_of_impacts
                    blows[j][int(k)] = Event(t, name, kind, left, right, impulse, law)
                    found.append((t, int(k), blows[j][int(k)]))
    if steps_of_force:
        found = _with_closed(dynamics, record, found, blows, (impulsive, pushes), impact_steps)
    found += _events_of_bounded_rows(dynamics, record, impulsive)
    return tuple(event for _, _, event in sorted(found, key=lambda each: each[:2])), impulsive


def events_of_springs(
    dynamics: Dynamics, record: Record, dense: ContinuousSolution | None, *, root_rtol: float = 4.0 * EPS
) -> list[Event]:
    """Return the activations, "close", and deactivations, "open", of each non-linear spring.

    A spring is active if δ > 0 and, where it does not pull, its force is positive. The instant is located on the continuous
    solution of the method, or otherwise on the cubic Hermite interpolant of the step, whose ends are then the limits. A
    spring in contact at the start is closed there, as any contact is.

    ``root_rtol``: tolerance of instants, relative to t.
    """
    t, found = record.t, list[Event]()
    if not dynamics.springs or len(t) < 2:
        return found
    if dense is None:
        samples = t
        q = record.q
        v = record.v
    else:
        # The solution has a cut at each activation, so no spring changes between the cuts; at the cuts the sign is rounding.
        cuts = np.unique(np.concatenate([t, dense.cuts[(dense.cuts > t[0]) & (dense.cuts < t[-1])]]))
        samples = np.concatenate([cuts[:1], 0.5 * (cuts[1:] + cuts[:-1]), cuts[-1:]])
        q, v, _ = dense.read(samples, "right")
    touch = TOUCH_RTOL * (largest(q) @ np.abs(dynamics.directions).T + np.abs(dynamics.power_laws[:, 0]))
    pushing = _pressed(dynamics, touch, q, v) > 0.0
    pushing[0] |= (dynamics.approach(q[0]) >= -touch) & pushing[1]
    for k, a in np.argwhere(pushing[1:] != pushing[:-1]):
        at = float(samples[k + 1])
        read = _on_solution(dense) if dense else _on_cubic(record, k)
        if read is not None:

            def pressed(t: float, a: int = a, read: Reading = read) -> float:
                return float(_pressed(dynamics, touch, *read(t))[0, a])

            if pressed(samples[k]) * pressed(at) < 0.0:
                from scipy.optimize import brentq  # here, as most runs do without it

                at = float(brentq(pressed, samples[k], at, xtol=1e-300, rtol=root_rtol))
        left, right = _limits(record, k) if dense is None else (_state(dense, at, side) for side in ("left", "right"))
        kind = "close" if pushing[k + 1, a] else "open"
        found.append(Event(at, dynamics.springs[a].name, kind, left, right))
    return sorted(found, key=lambda event: event.t)


def _pressed(dynamics: Dynamics, touch: Array, q: Array, v: Array) -> Array:
    """Return numbers above zero where non-linear springs act (nt, ns): δ, or min(δ, force) if it does not pull."""
    δ = dynamics.approach(q) - touch
    return np.where(dynamics.power_laws[:, 7] == 0.0, np.minimum(δ, dynamics.push(q, v, extended=True)), δ)


def _on_solution(dense: ContinuousSolution) -> Reading:
    return lambda t: dense.read(np.array([t]), "right")[:2]


def _on_cubic(record: Record, k: int) -> Reading | None:
    """Return the cubic Hermite interpolant of a step and its derivative; None if the step is not finite."""
    t = record.t[k : k + 2]
    q = record.q[k : k + 2]
    v = record.v[k : k + 2]
    if not (np.isfinite(q).all() and np.isfinite(v).all()):
        return None
    from scipy.interpolate import CubicHermiteSpline  # here, as most runs do without it

    place = CubicHermiteSpline(t, q, v)
    speed = place.derivative()
    return lambda t: (place(np.array([t])), speed(np.array([t])))


def _limits(record: Record, k: int) -> tuple[State, State]:
    """Return the states at both ends of a step, with the reactions there, or those of the previous step and of the step."""
    shift = 1 if len(record.reaction) < len(record.t) else 0
    return _limit(record, k, max(k - shift, 0)), _limit(record, k + 1, k + 1 - shift)


def _limit(record: Record, node: int, step: int) -> State:
    """Return the state at a node with the reactions of a step; before the first they are zero."""
    reaction = record.reaction[step] if step >= 0 else np.zeros(record.reaction.shape[1])
    return State(record.q[node], record.v[node], reaction)


def _state(dense: ContinuousSolution, t: float, side: str) -> State:
    return State(*(each[0] for each in dense.read(np.array([t]), side)))


def steps_of(events: Sequence[Event], t: Array, q: Array, v: Array) -> Indices:
    """Return the grid point at the start of the step of each event: the one with its left limits (ne,)."""
    if not events:
        return np.zeros(0, dtype=np.int64)
    near = np.searchsorted(t, [event.t for event in events], side="right") - 1
    q_left = np.array([event.left.q for event in events])
    v_left = np.array([event.left.v for event in events])
    found = np.minimum(near, max(len(t) - 2, 0))
    for shift in (1, -1, 0):
        k = np.clip(near + shift, 0, len(t) - 1)
        found = np.where((q[k] == q_left).all(axis=1) & (v[k] == v_left).all(axis=1), k, found)
    return found


def _struck_again(d: Dynamics, record: Record, pushes: Flags, *, meeting_part: float = 0.25) -> set[tuple[int, int]]:
    """Return the steps and contacts between masses whose bodies meet though they pushed in the step before.

    They approach faster than the forces of a step move them, unlike in the last bounces of a body that comes to rest.

    ``meeting_part``: least approach of bodies that meet, as a part of the change of their rate in the step.
    """
    found: set[tuple[int, int]] = set()
    if not d.stores_energy or len(record.reaction) < 2:
        return found
    h, r = np.diff(record.t), record.reaction
    U, W = d.gap_rate(record.t, record.q, record.v), _compliances(d, record)
    for i in np.flatnonzero(d.rigid).tolist():
        j = 1 + np.flatnonzero(pushes[1:, i] & pushes[:-1, i])
        approach = -U[j, i]
        meets = approach > meeting_part * W[j, i] * h[j] * r[j, i]
        for step, rate in zip(j[meets].tolist(), approach[meets].tolist(), strict=True):
            here = d.at(float(record.t[step]), record.q[step], record.v[step])
            change = smooth_change(here, record.v[step], record.v[step + 1], h[step] * r[step])
            if rate > abs(here.H[i] @ change):
                found.add((step, i))
    return found


def _with_closed(
    d: Dynamics,
    record: Record,
    found: list[RowEvent],
    blows: dict[int, dict[int, Event]],
    kinds: tuple[Flags, Flags],
    impact_steps: int,
) -> list[RowEvent]:
    """Return events with the impacts of rows that were closed before, whose forces are left in the record.

    ``blows`` are the impacts of each step by their rows, and ``kinds`` which reactions are impulses, and which are more than
    rounding.
    The impulse of a joint is separated from its force too where it is not alone with what is struck.
    """
    impulsive, pushes = kinds
    r = record.reaction
    h = np.diff(record.t)
    jumps = _jumps_of_motions(d, record) if d.stores_energy else {}
    if not d.stores_energy or not (blows or jumps):
        return found
    steady, replaced = pushes & ~impulsive, set[int]()
    new: list[RowEvent] = []
    for j in sorted({*blows, *jumps}):
        last = min(j + impact_steps, len(h))
        within = slice(j, last)
        if not steady[within].any() or not (closed := takes_part(d, steady[within])).any():
            continue
        jump = jumps.get(j, np.zeros(len(d.nodes)))
        total, length = h[within] @ r[within], float(h[within].sum())
        struck = impulsive[within].any(axis=0) & ~d.permanent
        here = d.at(float(record.t[j]), record.q[j], record.v[j])
        impulses = separate(here, Blow(record.v[j], record.v[last], jump, total, struck))
        of_step = blows.get(j, {})
        t = min((event.t for event in of_step.values()), default=float(record.t[j + 1]))
        left, right = _limit(record, j, j - 1), _limit(record, j + 1, j)
        for i in map(int, np.flatnonzero(impulses * (closed.any(axis=0) | ~d.impenetrable))):
            r[within, i] = (total[i] - impulses[i]) / length
            impulsive[within, i] = False
            if i in of_step:
                replaced.add(id(of_step[i]))
            new.append((t, i, Event(t, d.contacts[i].name, "impact", left, right, float(impulses[i]), "newton")))
    return [each for each in found if id(each[2]) not in replaced] + new


def _pushes(d: Dynamics, record: Record, *, impulse_rtol: float = 64.0 * EPS) -> Flags:
    """Return the flags of positive reactions (nr, nc) that change velocities between masses by more than their rounding.

    ``impulse_rtol``: impulse in a step, relative to the largest of a contact in the run and to that which stops its
    bodies at their fastest, below which it is rounding.
    """
    r = record.reaction
    found = r > 0.0
    if d.stores_energy and d.rigid.any() and len(r) < len(record.t):
        h = np.diff(record.t)
        W = _compliances(d, record)
        fastest = np.abs(d.along(record.t, record.q, record.v).H) @ largest(record.v)
        for i in np.flatnonzero(d.rigid).tolist():
            j = np.flatnonzero(found[:, i])
            impulses = h[j] * r[j, i]
            stopping = np.divide(fastest[i], W[j, i], out=np.zeros(len(j)), where=W[j, i] > 0.0)
            found[j, i] = impulses > impulse_rtol * np.maximum(stopping, impulses.max(initial=0.0))
    return found


def _compliances(d: Dynamics, record: Record) -> Array:
    """Return the change of the rate of each row by an impulse of its own, at the beginnings of the steps (steps, nc)."""
    if isinstance(d, LagrangianDynamics):
        return np.diagonal(d.compliance(record.t[:-1], record.q[:-1]), axis1=1, axis2=2)
    return np.broadcast_to(own_compliances(d), (len(record.t) - 1, len(d.contacts)))


def _jumps_of_motions(d: Dynamics, record: Record) -> dict[int, Array]:
    """Return the jumps of the velocities of prescribed motions (n,) by the steps in which they happen.

    A jump that moves no contact by more than the forces of its step do is part of an acceleration, as in a table of points.
    """
    found: dict[int, Array] = {}
    for i, term in ((i, term) for i, motion in d.motions.items() for term in terms_of(motion)):
        if isinstance(term, PiecewisePolynomial) and term.continuous and term.degree and d.H[:, i].any():
            at = term.breakpoints(record.t[0], record.t[-1])
            jumps = term.derivatives(at)[:, 1] - term.derivatives(np.nextafter(at, -np.inf))[:, 1]
            for j, jump in zip((np.searchsorted(record.t, at) - 1).tolist(), jumps.tolist(), strict=True):
                found.setdefault(j, np.zeros(len(d.nodes)))[i] += jump
    large = {}
    for j, jump in found.items():
        total = (record.t[j + 1] - record.t[j]) * record.reaction[j]
        smooth = smooth_change(d, record.v[j] + jump, record.v[j + 1], total)
        if (np.abs(d.H @ jump) > np.abs(d.H @ smooth))[d.relative_degree == 2].any():
            large[j] = jump
    return large


@once
def _joints_struck_by(dynamics: Dynamics) -> list[Indices]:
    """Return the joints, or other rows that always act, that an impulse at each row reaches, through bodies and joints."""
    joints = np.flatnonzero(dynamics.permanent)
    massive = dynamics.massive
    if not len(joints):
        return [joints] * len(dynamics.contacts)
    H, M = dynamics.entries
    linked = H[:, massive].astype(int) @ M[np.ix_(massive, massive)] @ H[:, massive].T > 0
    among = linked[np.ix_(joints, joints)]
    _, group = connected_components(among, directed=False)
    return [joints[np.isin(group, group[linked[i, joints]])] for i in range(len(dynamics.contacts))]


def _struck(dynamics: Dynamics, record: Record) -> dict[tuple[int, int], float]:
    """Return the instants at which contacts of an impulse path over massless nodes close, by step and contact."""
    struck = {}
    for line in dynamics.impulse_lines:
        rows = list(map(int, np.flatnonzero(line)))
        opening = dynamics.gap(record.t, record.q) @ line
        closed: Flags = np.min(record.reaction[:, rows], axis=1) > 0.0
        rate = dynamics.gap_rate(record.t[0], record.q[0], record.v[0]) @ line
        before = np.append(opening[0] <= 0.0 and rate >= 0.0, closed[:-1])
        for j in map(int, np.flatnonzero(closed & ~before)):
            known = slice(max(j - 1, 0), j + 1)
            t = zero(record.t[known], opening[known], record.t[j], record.t[j + 1])
            struck.update({(j, i): t for i in rows})
    return struck


def _holding(d: Dynamics, record: Record, friction: Array) -> Flags:
    """Return the flags of friction that holds whatever its force (nr, nc).

    That is static friction beyond the kinetic bounds or without slip, and any that ends a step without slip: rows that are
    redundant share a force in any way, also by their bounds.
    """
    steps = len(record.v) - len(record.reaction)
    U = np.abs(d.gap_rate(record.t[steps:], record.q[steps:], record.v[steps:]))
    rests = SLIP_RTOL * U.max(axis=0, initial=0.0) >= U
    beyond = np.abs(record.reaction) > friction * (1.0 + SLIP_RTOL)
    return np.asarray(((d.mu_s > d.mu) & (beyond | rests)) | (d.tangential & rests & bool(steps)))


@once
def _bounded_rows(d: Dynamics) -> list[int]:
    """Return the rows of sliders, friction, relays and the like, which have events but no gap that closes."""
    return [i for i, row in enumerate(d.contacts) if row.law.between and not row.impenetrable]


def _events_of_bounded_rows(d: Dynamics, record: Record, impulsive: Flags) -> list[RowEvent]:
    """Return the events of sliders, friction and relays, with their instants and rows."""
    found: list[RowEvent] = []
    if not (rows := _bounded_rows(d)):
        return found
    friction = np.zeros((1, len(d.contacts)))
    holds = np.zeros((1, len(d.contacts)), dtype=np.bool_)
    if d.tangential.any():
        friction = np.where(impulsive, 0.0, d.friction_bounds(record.reaction))
        holds = _holding(d, record, friction)
    for i in rows:
        bounds = (-friction[:, i], friction[:, i]) if d.tangential[i] else (d.r_min[i], d.r_max[i])
        r = record.reaction[:, i]
        if d.permanent[i]:
            # What the row passes on in an impact is no force of its law, which keeps that of the step before.
            r = r[np.maximum.accumulate(np.where(impulsive[:, i], 0, np.arange(len(r))))]
        crossed = _events_of_bounds(d.contacts[i], r, (*bounds, holds[:, i]), record)
        found += [(event.t, i, event) for event in crossed]
    return found


def _events_of_bounds(
    contact: Contact, r: Array, law: tuple[ArrayLike, ArrayLike, Flags], record: Record
) -> Iterator[Event]:
    """Yield where a force r (nr,) comes to a bound, leaves it, or goes to the other: between two forces on both sides.

    The law is its bounds, and where it holds between them whatever its value. Without room between the bounds (nr,), as
    where a contact with friction is open, there are no events.
    """
    t = record.t_reaction
    holds = law[2]
    low, high = np.broadcast_arrays(*law[:2], r)[:2]
    width = high - low if contact.limited or contact.law.tangential else np.abs(record.reaction).max()
    near, acts = 0.5 * SLIP_RTOL * width, high > low
    side = np.where(holds, 0.0, np.where(r >= high - near, 1.0, np.where(r <= low + near, -1.0, 0.0)))
    # What turns is between its bounds for one step; it does not stop.
    turning = 1 + np.flatnonzero((side[1:-1] == 0.0) & (side[:-2] * side[2:] < 0.0) & acts[1:-1])
    side[turning] = side[turning + 1]
    changes = acts[1:] & ((side[1:] != side[:-1]) | ~acts[:-1])
    at = np.flatnonzero(changes) + 1
    ends = np.searchsorted(record.t, t[at - 1], side="right") - 1, np.searchsorted(record.t, t[at])
    instants = 0.5 * (t[at - 1] + t[at])
    for j, before, after, instant in zip(at.tolist(), *(each.tolist() for each in (*ends, instants)), strict=True):
        left, right = _limit(record, before, j - 1), _limit(record, after, j)
        kind = contact.law.between if side[j] == 0.0 else contact.law.at_bound
        yield Event(instant, contact.name, kind, left, right)


def zero(t: Array, values: Array, earliest: float, latest: float) -> float:
    """Return the zero of the line through two decreasing values, limited to ``earliest`` ... ``latest``."""
    if len(values) < 2 or not values[0] > values[1]:
        return float(0.5 * (earliest + latest))
    crossing = t[1] + values[1] * (t[1] - t[0]) / (values[0] - values[1])
    return float(min(max(crossing, earliest), latest))
