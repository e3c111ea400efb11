"""A run on its grid, judged by the trapezoidal rule, whose error the second differences of the run bound."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from lcpimpact.arrays import Array, Indices
from lcpimpact.certificate.energy import Account, Sinks
from lcpimpact.certificate.impacts import RunImpacts, judge_impacts, largest_impulses, rows_by_name
from lcpimpact.certificate.laws import accelerations, beyond_bounds, forces_on_nodes, missing_friction, node_kinds
from lcpimpact.certificate.scales import SCALE_FLOOR, Found, Scales, worse, worst
from lcpimpact.certificate.theta_balance import DAMPED, FREE, MASSIVE
from lcpimpact.certificate.trapezoid import (
    NEIGHBOURS,
    SLOPE,
    changes_of_mode,
    out_of_balance,
    trapezoid_errors,
    worst_steps,
)
from lcpimpact.events import step_of
from lcpimpact.integrators.base import Integrator, Limits
from lcpimpact.record import Event, Record
from lcpimpact.scheme.dynamics import Dynamics

IMPACT_FACTOR = 2.0
"""Error of an impulse, in units of h times the jump of the forces at an impact: registered problems show up to 1."""

UNIFORM_RTOL = 1e-6
"""Difference of a step from the shortest, relative to it, above which the steps are not uniform."""


@dataclass(frozen=True, eq=False)
class Steps:
    """A run on its grid, where the steps over which one impact spreads are one.

    Attributes
    ----------
    t, q, v, r : arrays                     the motion (nt, ...), and the reactions at its points or in its steps
    f, g : (nt, n) arrays                   the loads, and the forces on the nodes; without reactions that belong to steps
    acting : (nt or steps, n) array         the forces on the nodes where reactions are known
    total, given : (nt, n), (steps, n)      forces that the trapezoidal rule integrates, and impulses that the steps add
    P, P_end : (steps, nc) arrays           the impulses of each step, and those of them at its end
    P_start : (nc,) array                   the impulses before the first step
    step : (ni,) array                      the step of each impulse
    spread : int                            number of steps over which an impact spreads
    """

    t: Array
    q: Array
    v: Array
    r: Array
    f: Array
    g: Array
    acting: Array
    total: Array
    given: Array
    P: Array
    P_end: Array
    P_start: Array
    step: Indices
    spread: int

    @property
    def in_steps(self) -> bool:
        """Whether the reactions belong to steps."""
        return len(self.r) < len(self.t)

    @property
    def h(self) -> Array:
        """The lengths of the steps (steps, 1)."""
        return np.diff(self.t)[:, None]

    @property
    def longest(self) -> float:
        """The longest step."""
        return float(self.h.max(initial=0.0))

    @classmethod
    def of(cls, d: Dynamics, record: Record, events: Sequence[Event], integrator: Integrator | None) -> Steps:
        """Return the steps of what a method has recorded."""
        in_steps, spread = len(record.reaction) < len(record.t), integrator.impact_steps if integrator else 1
        struck, rows = [event for event in events if event.impulse != 0.0], rows_by_name(d)
        if in_steps:
            first = np.array([step_of(event, record.t, record.q, record.v) for event in struck], dtype=np.int64)
        else:
            first = np.searchsorted(record.t, [event.t for event in struck]) - 1
        within = np.zeros(len(record.t), dtype=np.bool_)
        for k in range(1, spread):
            within[np.minimum(first + k, len(record.t) - 1)] = True
        within[-1] = False
        kept = np.flatnonzero(~within)
        step = np.searchsorted(kept, first, side="right") - 1
        t, q, v = (record.t, record.q, record.v) if spread == 1 else (record.t[kept], record.q[kept], record.v[kept])
        h = np.diff(t)[:, None]
        P = np.zeros((len(h), len(d.contacts)))
        P_start, P_end = np.zeros(len(d.contacts)), np.zeros_like(P)
        for k, event in zip(step, struck, strict=True):
            (P_start if k < 0 else P[min(k, len(P) - 1)])[rows[event.contact]] += event.impulse
            if k >= 0 and event.t >= t[min(k, len(P) - 1) + 1]:
                P_end[min(k, len(P) - 1), rows[event.contact]] += event.impulse
        r = record.reaction
        if in_steps:
            if spread > 1:
                r = np.add.reduceat(np.diff(record.t)[:, None] * r, kept[:-1]) / h
            f, g = forces_on_nodes(d, t, q, v, None)
            acting = g[1:] + r @ d.B.T
            as_mean = integrator is None or integrator.reaction_is_mean
            total = g if as_mean else np.concatenate([g[:1] + r[:1] @ d.B.T, acting])
            given = (h * r + P if as_mean else P) @ d.B.T
        else:
            r = r if spread == 1 else r[kept]
            f, g = forces_on_nodes(d, t, q, v, r)
            acting, total, given = g, g, P @ d.B.T
        return cls(
            t=t, q=q, v=v, r=r, f=f, g=g, acting=acting, total=total, given=given,
            P=P, P_end=P_end, P_start=P_start, step=step, spread=spread,
        )  # fmt: skip

    def impacts(self, d: Dynamics, events: Sequence[Event]) -> RunImpacts:
        """Return the impacts: with the values at the ends of their steps where the method takes them so."""
        if not self.in_steps:
            return RunImpacts.of(d, events)
        hit = np.flatnonzero(self.P.any(axis=1))
        impacts = RunImpacts(self.t[hit], self.q[hit], self.v[hit], self.v[hit + 1], self.P[hit])
        if self.spread == 1:
            return impacts
        # An impact that spreads over several steps obeys its law only where no other contact pushes in them.
        return impacts[~self.r[hit].any(axis=1) & (np.count_nonzero(self.P[hit], axis=1) == 1)]


def judge_grid(
    d: Dynamics,
    start: tuple[Array, Array],
    record: Record,
    events: Sequence[Event],
    integrator: Integrator | None,
    limits: Limits,
) -> tuple[Found, Scales, tuple[float, float]]:
    """Judge a run that is known at the points of its grid, and that begins with q and v of ``start``."""
    run = Steps.of(d, record, events, integrator)
    bare = Scales.of(d, run.q, run.v, run.r, run.f)
    scales = bare.at_least(d, run.longest)
    turn, impacts, largest = scales.v - bare.v, run.impacts(d, events), largest_impulses(d, events)
    lack, found = _judge_nodes(d, start, run, impacts, (scales, turn), limits)
    found |= _judge_contacts(d, run, impacts, scales, largest, limits)
    if d.stores_energy:
        alone = _judge_steps(d, run, events, (scales, turn), limits)
        alone["momentum"] = worse(alone["momentum"], _judge_impulses(d, run, lack, events, scales, limits))
        for name, pair in alone.items():
            found[name] = worse(found[name], pair)
    account = Account(d, Sinks.all_as_one(d))
    stored = account.stored(record.q, record.v, record.q[0])
    net = np.cumsum(account.balance(account.by_trapezoidal_rule(record, events, run.spread)))
    energy = float(np.abs(account.imbalance(stored[1:], stored[0], net)).max(initial=0.0))
    found["energy_balance"] = (energy, np.inf)
    return found, scales, (energy, float(np.abs(stored[:, :2].sum(axis=1)).max()))


def _judge_nodes(
    d: Dynamics,
    start: tuple[Array, Array],
    run: Steps,
    impacts: RunImpacts,
    scaled: tuple[Scales, Array],
    limits: Limits,
) -> tuple[Array, Found]:
    """Judge momentum, kinematics and the balance of massless nodes; return the imbalance of momentum after each step too."""
    ε, kind, h, (scales, turn) = limits.precision, node_kinds(d), run.h, scaled
    first_p, first_q = np.zeros((2, len(d.nodes)))
    if d.stores_energy:
        first_p, first_q = d.M @ (run.v[0] - start[1]) - d.B @ run.P_start, run.q[0] - start[0]
    lack = out_of_balance(h.ravel(), run.v @ d.M.T, run.total, run.given, first_p)
    moved = out_of_balance(h.ravel(), run.q, run.v, run.given[:0], first_q)
    lacking = np.abs(lack)
    if not run.in_steps:
        # What is recorded at the very instant of an impact may be the limit before it.
        lacking = np.minimum(lacking, np.abs(lack + run.P_end @ d.B.T))
    # Springs that are damped as they are compressed leave a linear step order 1.
    order = min(limits.order, 1.0) if run.in_steps and d.springs and d.power_laws[:, 3:].any() else limits.order
    forces, elapsed = scales.forces(d), 64.0 * np.finfo(float).eps * (run.t[1:] - run.t[0])[:, None]
    allowed_p = limits.slack * trapezoid_errors(h.ravel(), run.total, order)
    allowed_p += ε * scales.momenta(d) + elapsed * forces + h * (limits.kick * _kicks(d, run))
    # Within a step a body may turn about as its forces let it, and show nothing of it at the ends.
    turning = limits.slack * SLOPE * np.where(kind == MASSIVE, turn, 0.0)
    allowed_q = limits.slack * trapezoid_errors(h.ravel(), run.v, order)
    allowed_q += ε * scales.q + elapsed * scales.v + h * turning
    if not run.in_steps:
        # Several impacts within a step may set a body in motion and stop it.
        jumps = np.zeros_like(run.q[1:])
        np.add.at(jumps, impacts.steps(run.t), np.abs(impacts.after - impacts.before))
        allowed_q += np.cumsum(h * jumps, axis=0)
    massive, moves, massless = kind == MASSIVE, (kind >= DAMPED) & ~d.jumping, np.isin(kind, (DAMPED, FREE))
    allowed_f = ε * forces
    if limits.drift:
        # What is projected lags its forces, whose errors add up to those of the way that it goes.
        allowed_p += limits.drift * h * (np.abs(d.K[:, massless]) @ np.ptp(run.q[:, massless], axis=0))
        allowed_q += limits.drift * h * np.maximum.accumulate(np.abs(run.v[1:]), axis=0)
        allowed_f = allowed_f + limits.drift * np.abs(np.diff(run.q, axis=0) @ d.K.T).max(axis=0, initial=0.0)
    # Where the force of a step was an impulse, it is not known beside it.
    known = run.acting[~run.P.any(axis=1)] if run.in_steps else run.acting
    return lack, {
        "momentum": worst(lacking[:, massive], allowed_p[:, massive]),
        "equilibrium": worst(np.abs(known[:, massless]).max(axis=0, initial=0.0), allowed_f[massless]),
        "kinematics": worst(np.abs(moved[:, moves]), allowed_q[:, moves]),
    }


def _kicks(d: Dynamics, run: Steps) -> Array:
    """Return the largest force at each node in N, including contact forces and impulses (n,)."""
    kicks, links = np.abs(run.g).max(axis=0), np.abs(d.B)
    passed = np.maximum(np.abs(run.r).max(axis=0, initial=0.0), (links * kicks[:, None]).max(axis=0, initial=0.0))
    return np.asarray(np.maximum(kicks, links @ passed))


def _judge_contacts(
    d: Dynamics, run: Steps, impacts: RunImpacts, scales: Scales, largest: Array, limits: Limits
) -> Found:
    """Judge complementarity, penetration, bounds and the law of impact; ``largest`` are the largest impulses (nc,)."""
    ε, longest, v, r = limits.precision, run.longest, run.v, run.r
    u = d.gap(run.q[1:] if run.in_steps else run.q) + r @ d.D.T
    one_sided, bounds = d.unilateral, d.friction_bounds(scales.r)
    reach = np.where((d.relative_degree == 2) | (2 not in limits.relative_degrees), limits.penetration, 0.0)
    opened = ε * scales.u + reach * longest * scales.U
    slow = 2.0 * run.spread * min(limits.slack, 3.0) * longest * accelerations(d, run.acting) + ε * scales.U
    violation, by_impacts = judge_impacts(d, impacts, -opened)
    apart = np.abs(r * np.maximum(u, 0.0)).max(axis=0, initial=0.0)
    penetrating = np.abs(r * np.minimum(u, 0.0)).max(axis=0, initial=0.0)
    # A contact may open in the step over which its force is a mean.
    opening = longest * scales.U * ((d.relative_degree == 2) & run.in_steps)
    friction = turned = np.zeros(len(d.contacts))
    if d.rubs.any():
        mean = 0.5 * (v[1:] + v[:-1]) if run.in_steps else v
        duration = run.h if run.in_steps else np.append(run.h, run.h[-1:], axis=0)
        friction = np.abs(duration * missing_friction(d, r, d.gap_rate(mean))).max(axis=0, initial=0.0)
        turned = np.abs(np.diff(d.gap_rate(v), axis=0)).max(axis=0, initial=0.0)
    products = [
        (apart[one_sided], (scales.r * (ε * scales.u + opening))[one_sided]),
        (penetrating[one_sided], (scales.r * opened)[one_sided]),
        (friction, bounds * longest * (ε * scales.U + 2.0 * turned)),
        (by_impacts, largest * slow),
    ]
    largest = np.maximum(largest, d.friction_bounds(largest) * d.frictional)
    beyond = beyond_bounds(d, r).max(axis=0, initial=0.0)
    parted = np.maximum(np.where(d.joints, np.abs(u), -u * one_sided).max(axis=0, initial=0.0), 0.0)
    return {
        "complementarity": worst(*(np.concatenate(each) for each in zip(*products, strict=True))),
        "penetration": worst(parted, np.where(d.joints, ε * scales.u, opened)),
        "tension": worst(beyond, ε * (scales.r + bounds * d.frictional + largest / float(run.h.max(initial=1e-300)))),
        "impact_law": worst(violation, slow),
    }


def _judge_steps(
    d: Dynamics, run: Steps, events: Sequence[Event], scaled: tuple[Scales, Array], limits: Limits
) -> Found:
    """Judge the momentum and displacement of each single step away from events, by the second differences around it."""
    kind, h, t, (scales, turn) = node_kinds(d), run.h, run.t, scaled
    loud = h[:, 0] > (1.0 + UNIFORM_RTOL) * h.min(initial=np.inf)
    changes_of_mode(run.r, *_bounds(d, run.r), loud)
    near = np.searchsorted(t, [event.t for event in events])[:, None] + np.array([-2, -1, 0])
    loud[np.clip(near, 0, len(h) - 1)] = True
    if d.springs:
        loud |= (np.diff(d.push(run.q, run.v) != 0.0, axis=0)).any(axis=1)
    kicks, given = _kicks_of_steps(d, run, limits), run.given if run.in_steps else run.given[:0]
    ε, none = max(limits.precision, SCALE_FLOOR), np.zeros((0, len(d.nodes)))
    total, steps = np.ascontiguousarray(run.total), np.ascontiguousarray(h[:, 0])
    lack = worst_steps(steps, run.v @ d.M.T, total, given, kicks, loud, ε * scales.momenta(d), limits.step)
    # A force that belongs to a step acts anywhere in it.
    placed = max(limits.kick, float(run.in_steps))
    rounding = ε * scales.q + placed * run.longest * turn
    # A load that jumps within a step moves its node by h times what it does to the velocity.
    moves = h * (kicks @ np.abs(np.linalg.pinv(d.M))) if not d.constant_loads else none
    moved = worst_steps(steps, run.q, run.v, none, moves, loud, rounding, limits.step)
    ways = (kind == MASSIVE) | (kind == DAMPED)
    return {"momentum": worst(*lack[:, kind == MASSIVE]), "kinematics": worst(*moved[:, ways])}


def _bounds(d: Dynamics, r: Array) -> tuple[Array, Array]:
    """Return the bounds of reactions r (nr, nc), infinite where there are none, those of friction by its normal forces."""
    bounds = d.friction_bounds(r)
    low, high = np.where(d.frictional, -bounds, d.r_min), np.where(d.frictional, bounds, d.r_max)
    return np.ascontiguousarray(low), np.ascontiguousarray(high)


def _kicks_of_steps(d: Dynamics, run: Steps, limits: Limits) -> Array:
    """Return bounds of the impulse errors of each step by loads, reactions and lossy springs in N s; no rows for none."""
    q, v, h, f = run.q, run.v, run.h, run.f
    kicks = np.zeros((0, len(d.nodes)))
    if limits.kick or not d.constant_loads or d.motions:
        # What is prescribed may have a kink within a step, and what is recorded of a reaction may lag it.
        if d.motions:
            f = f - q[:, d.driven] @ d.K[:, d.driven].T - v[:, d.driven] @ d.C[:, d.driven].T
        kicks = 2.0 * h * _around(np.abs(np.diff(f, n=2, axis=0)), len(h))
        if limits.kick:
            kicks += limits.kick * h * _beside(np.abs(np.diff(run.r, axis=0)) @ np.abs(d.B).T, len(h))
    if (d.power_laws[:, 3:] > 0.0).any():
        # Where in a step the way and the rate of a lossy spring are taken is for a method to choose.
        ends, mixed = d.spring_force(q, v), d.spring_force(q[1:], v[:-1])
        lossy = h * _beside(np.abs(ends[1:] - mixed) + np.abs(mixed - ends[:-1]), len(h))
        kicks = kicks + lossy if len(kicks) else lossy
    return kicks


def _judge_impulses(
    d: Dynamics, run: Steps, lack: Array, events: Sequence[Event], scales: Scales, limits: Limits
) -> tuple[float, float]:
    """Judge the momentum over the steps around each isolated impact.

    The instant of an impact within its step depends on the method, so a jump of the forces there may count h more or less.
    """
    happened, hit = np.searchsorted(run.t, [event.t for event in events]) - 1, np.unique(run.step)
    alone = np.array(
        [(np.abs(happened - k) <= 1).sum() == (np.abs(happened - k) <= 2 * NEIGHBOURS).sum() for k in hit], dtype=bool
    )
    hit = hit[alone & (hit >= 2 * NEIGHBOURS) & (hit < len(lack) - 2 * NEIGHBOURS)]
    around = hit[:, None] + np.arange(-NEIGHBOURS, NEIGHBOURS + 1)
    jump = np.abs(np.diff(run.total[around], axis=1)).max(axis=1)
    longest = run.h[around, 0].max(axis=1, keepdims=True)
    allowed = max(limits.precision, SCALE_FLOOR) * scales.momenta(d) + IMPACT_FACTOR * longest * jump
    if limits.kick:
        allowed += limits.kick * longest * (np.ptp(run.r[around], axis=1) @ np.abs(d.B).T)
    off = np.abs(lack[hit + NEIGHBOURS - 1] - lack[hit - NEIGHBOURS])
    return worst(off[:, d.massive], allowed[:, d.massive])


def _beside(changes: Array, steps: int) -> Array:
    """Return for each step the greatest of the changes from step to step on both sides, but for its own (steps, n)."""
    return _greatest(changes, steps, NEIGHBOURS, (NEIGHBOURS - 3, NEIGHBOURS - 2, NEIGHBOURS + 3, NEIGHBOURS + 4))


def _around(changes: Array, steps: int) -> Array:
    """Return for each step the greatest change at its ends and one further on either side (steps, n)."""
    return _greatest(changes, steps, 1, range(steps + 3 - len(changes)))


def _greatest(changes: Array, steps: int, margin: int, shifts: Iterable[int]) -> Array:
    """Return for each step k the greatest of the changes k + margin - shift (steps, n)."""
    wide = np.zeros((steps + 2 * margin, changes.shape[1]))
    for shift in shifts:
        part = wide[shift : shift + len(changes)]
        np.maximum(part, changes, out=part)
    return wide[margin:-margin]
