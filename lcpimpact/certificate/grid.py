"""Certificate of a run that is known on its grid: trapezoidal rule with error bounds by second differences."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from lcpimpact.arrays import Array, Flags, Indices
from lcpimpact.certificate.balances import imbalances, judged_nodes
from lcpimpact.certificate.energy import Energies, account_of, open_work
from lcpimpact.certificate.impacts import RunImpacts, judge_impacts, largest_impulses, rows_by_name
from lcpimpact.certificate.laws import (
    accelerations,
    forces_on_nodes,
    impulses_of_breaks,
    judge_rows,
    law_residual,
    node_kinds,
    rate_forces,
    row_kinds,
)
from lcpimpact.certificate.scales import SCALE_FLOOR, Judgement, Scales, larger_violation, largest_violation
from lcpimpact.certificate.trapezoid import (
    NEIGHBOURS,
    SLOPE_FACTOR,
    largest_step_errors,
    mark_mode_changes,
    trapezoid_errors,
    trapezoids,
)
from lcpimpact.events import steps_of
from lcpimpact.integrators.base import Integrator, Limits
from lcpimpact.integrators.stepping.strong_dashpots import (
    LEAST_COUPLING,
    ONE_STAGE,
    damped_rows,
    directions,
    may_damp,
    may_stop,
    none,
)
from lcpimpact.record import Event, Record
from lcpimpact.scheme.dynamics import Dynamics
from lcpimpact.scheme.rate_law import pieces
from lcpimpact.scheme.signals import PiecewisePolynomial, breakpoints_at, means_in_steps, terms_of
from lcpimpact.scheme.terms import NodeKind

CLOSED = 0.02
"""Loss of energy, relative to the largest stored energy, up to which the trapezoidal rule alone is believed."""


@dataclass(frozen=True, eq=False)
class Steps:
    """A run on its grid, with the steps over which one impact is spread merged into one.

    Attributes
    ----------
    t, q, v, r : arrays                     the motion (nt, ...), and the reactions at its points or in its steps
    f, g : (nt, n) arrays                   the loads, and the forces on the nodes without reactions that belong to steps
    acting : (nt or steps, n) array         the forces on the nodes including reactions, at the instants of the reactions
    total, given : (nt, n), (steps, n)      forces to integrate by the trapezoidal rule, and additional impulses of the steps
    loads : (steps, n) array                those of loads that have breakpoints, which are among them; no rows for none
    P, P_end : (steps, nc) arrays           the impulses of each step, and the part of them at its end
    P_start : (nc,) array                   the impulses before the first step
    step : (ni,) array                      the step of each impulse
    spread : int                            number of steps over which an impact spreads
    mean : bool                             whether the reactions are means over steps
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
    loads: Array
    P: Array
    P_end: Array
    P_start: Array
    step: Indices
    spread: int
    mean: bool

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
        """Return the steps of a record."""
        in_steps = len(record.reaction) < len(record.t)
        spread = integrator.impact_steps if integrator else 1
        struck = [event for event in events if event.impulse != 0.0]
        rows = rows_by_name(d)
        if in_steps:
            first = steps_of(struck, record.t, record.q, record.v)
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
        mean = in_steps and (integrator is None or integrator.reaction_is_mean)
        if in_steps:
            if spread > 1:
                r = np.add.reduceat(np.diff(record.t)[:, None] * r, kept[:-1]) / h
            f, g = forces_on_nodes(d, t, q, v, None)
            acting = g[1:] + r @ d.B.T
            total = g if mean else np.concatenate([g[:1] + r[:1] @ d.B.T, acting])
            given = (h * r + P if mean else P) @ d.B.T
        else:
            r = r if spread == 1 else r[kept]
            f, g = forces_on_nodes(d, t, q, v, r)
            acting = g
            total = g
            given = P @ d.B.T
        loads = impulses_of_breaks(d, t)
        if len(loads):
            given = given + loads
        return cls(
            t=t, q=q, v=v, r=r, f=f, g=g, acting=acting, total=total, given=given, loads=loads,
            P=P, P_end=P_end, P_start=P_start, step=step, spread=spread, mean=mean,
        )  # fmt: skip

    def imbalances(self, d: Dynamics) -> tuple[Array, Array]:
        """Return the imbalances of momentum and displacement of each step."""
        return imbalances(d, self.q, self.v, trapezoids(self.h, self.total) + self.given, trapezoids(self.h, self.v))

    def impacts(self, d: Dynamics, events: Sequence[Event]) -> RunImpacts:
        """Return the impacts, with the limits at the ends of their steps if the reactions belong to steps."""
        if not self.in_steps:
            return RunImpacts.of(d, events)
        hit = np.flatnonzero(self.P.any(axis=1))
        impacts = RunImpacts(self.t[hit], self.q[hit], self.v[hit], self.v[hit + 1], self.P[hit])
        if self.spread == 1:
            return impacts
        # An impact that is spread over several steps obeys its law only if no other contact is active in them.
        return impacts[~self.r[hit].any(axis=1) & (np.count_nonzero(self.P[hit], axis=1) == 1)]


def judge_grid(
    d: Dynamics,
    start: tuple[Array, Array],
    record: Record,
    events: Sequence[Event],
    integrator: Integrator | None,
    limits: Limits,
    *,
    resolved: bool = True,
) -> tuple[Judgement, Scales, Energies]:
    """Judge a run that is known at the points of its grid; ``start`` holds the initial q and v.

    Momentum and kinematics are balances over the steps, which a record is too coarse for unless it is ``resolved``.
    """
    run = Steps.of(d, record, events, integrator)
    sampled = Scales.of(d, run.q, run.v, run.r, run.f)
    scales = sampled.at_least(run.longest)
    Δv = scales.v - sampled.v
    impacts = run.impacts(d, events)
    largest = largest_impulses(d, events)
    steps, defect, found = _judge_nodes(d, start, run, impacts, (scales, Δv), limits)
    found |= _judge_contacts(d, run, impacts, scales, largest, limits)
    if not resolved:
        del found["momentum"], found["kinematics"]
    elif d.stores_energy:
        single = _judge_steps(d, run, steps, events, (scales, Δv), limits)
        single["momentum"] = larger_violation(
            single["momentum"], _judge_impulses(d, run, defect, events, scales, limits)
        )
        for name, pair in single.items():
            found[name] = larger_violation(found[name], pair)
    return found, scales, _energies(d, record, events, run.spread, limits)


def _energies(d: Dynamics, record: Record, events: Sequence[Event], spread: int, limits: Limits) -> Energies:
    """Return the energies of a run, with the loss beyond that of its steps."""
    account = account_of(d)
    stored = account.stored(record.q, record.v, record.q[0])

    def imbalance(flows: Array) -> Array:
        return account.imbalance(stored[1:], stored[0], np.cumsum(account.balance(flows)))

    off = imbalance(account.by_trapezoidal_rule(record, events, spread))
    scale = np.abs(stored[:, :2].sum(axis=1)).max()
    struck = [event for event in events if event.impulse != 0.0]
    own = own_losses(d, record, limits, steps_of(struck, record.t, record.q, record.v))
    own += np.cumsum(open_work(d, record))
    loss = -off - own
    if d.stores_energy and loss.max(initial=0.0) > CLOSED * scale:
        # Where a body turns or is struck within a step, either rule may miss some of the work of its forces.
        loss = np.minimum(loss, -imbalance(account.by_theta_rule(record, events, 0.5, spread)) - own)
    return Energies(float(np.abs(off).max(initial=0.0)), float(scale), float(loss.max(initial=0.0)))


def own_losses(d: Dynamics, record: Record, limits: Limits, struck: Indices, *, widest: int = 3) -> Array:
    """Return the energy in J that steps may have lost by themselves since t = 0 (steps,).

    A step whose loss is of order 2 m - 1 takes c (ω h)^{2m} of the energy of a vibration ω, c times that of the differences
    of q and v over m steps; backward Euler takes that of m = 1, with c = 1. Twice as much may be lost. Over steps
    in which bodies are ``struck`` motion is not smooth.

    ``widest``: differences by which the loss of steps is estimated at most; at higher orders rounding and events
    would be in them.
    """
    lost, order = np.zeros(len(record.t) - 1), limits.order_loss
    if order < np.inf and (m := int(min(0.5 * (order + 1.0), widest))) <= len(lost):
        q = np.diff(record.q, n=m, axis=0)
        v = np.diff(record.v, n=m, axis=0)
        δ = np.diff(d.approach(record.q), n=m, axis=0)
        energy = d.kinetic_energy(q, v) + 0.5 * np.einsum("ki,ki->k", q @ d.K, q)
        if d.springs:
            energy += 0.5 * np.abs(np.diff(d.push(record.q, record.v), n=m, axis=0) * δ).sum(axis=1)
        for k in range(m):
            energy[struck[(struck >= k) & (struck - k < len(energy))] - k] = 0.0
        lost[m - 1 :] = 2.0 * limits.loss_constant * np.cumsum(np.maximum(energy, 0.0))
    return lost


def _judge_nodes(
    d: Dynamics,
    start: tuple[Array, Array],
    run: Steps,
    impacts: RunImpacts,
    scaled: tuple[Scales, Array],
    limits: Limits,
) -> tuple[tuple[Array, Array], Array, Judgement]:
    """Judge momentum, kinematics and the balance of massless nodes.

    Return also the imbalances of the steps, and the defect of momentum since the start.
    """
    ε = limits.precision
    nodes = judged_nodes(d)
    h = run.h
    scales, Δv = scaled
    steps = run.imbalances(d)
    defect, q_defect = (np.cumsum(each, axis=0) for each in steps)
    if d.stores_energy:
        defect = defect + (d.M @ (run.v[0] - start[1]) - d.B @ run.P_start)
        q_defect = q_defect + (run.q[0] - start[0])
    momentum_defect = np.abs(defect)
    if not run.in_steps:
        # The state recorded at the instant of an impact may be its left limit.
        momentum_defect = np.minimum(momentum_defect, np.abs(defect + run.P_end @ d.B.T))
    # A linearly implicit step has order 1 for springs whose damping depends on the compression.
    order = min(limits.order, 1.0) if run.in_steps and d.springs and d.power_laws[:, 3:5].any() else limits.order
    forces = scales.forces
    elapsed = 64.0 * np.finfo(float).eps * (run.t[1:] - run.t[0])[:, None]
    allowed_p = limits.slack * trapezoid_errors(h.ravel(), run.total, order)
    allowed_p += ε * scales.momenta + elapsed * forces + h * (limits.kick * _largest_forces(d, run))
    # Within a step a body may reverse its motion twice, which its velocities at the ends do not show.
    slack_speed = limits.slack * SLOPE_FACTOR * np.where(nodes.massive, Δv, 0.0)
    if len(run.loads):
        # An impulse in one step may come to half of its effect in the next.
        allowed_p += np.maximum.accumulate(np.abs(run.loads), axis=0)
    allowed_q = limits.slack * trapezoid_errors(h.ravel(), run.v, order)
    allowed_q += ε * scales.q + elapsed * scales.v + h * slack_speed
    if not run.in_steps:
        # Several impacts within one step may start and stop a body.
        jumps = np.zeros_like(run.q[1:])
        np.add.at(jumps, impacts.steps(run.t), np.abs(impacts.after - impacts.before))
        allowed_q += np.cumsum(h * jumps, axis=0)
    massless = nodes.massless
    allowed_f = ε * forces
    taken, way = _taken_by_dashpots(d, run)
    allowed_p = allowed_p + np.cumsum(taken, axis=0)
    allowed_q = allowed_q + np.cumsum(way, axis=0)
    if limits.drift:
        # A projected coordinate lags behind its forces, so errors accumulate over the distance that it moves.
        allowed_p += limits.drift * h * (np.abs(d.K[:, massless]) @ np.ptp(run.q[:, massless], axis=0))
        allowed_q += limits.drift * h * np.maximum.accumulate(np.abs(run.v[1:]), axis=0)
        allowed_f = allowed_f + limits.drift * np.abs(np.diff(run.q, axis=0) @ d.K.T).max(axis=0, initial=0.0)
    # In a step with an impulse the mean contact force is not known separately.
    known = run.acting[~run.P.any(axis=1)] if run.in_steps else run.acting
    return (
        steps,
        defect,
        {
            "momentum": largest_violation(momentum_defect[:, nodes.massive], allowed_p[:, nodes.massive]),
            "equilibrium": largest_violation(np.abs(known[:, massless]).max(axis=0, initial=0.0), allowed_f[massless]),
            "kinematics": largest_violation(np.abs(q_defect[:, nodes.moving]), allowed_q[:, nodes.moving]),
        },
    )


def _taken_by_dashpots(d: Dynamics, run: Steps) -> tuple[Array, Array]:
    """Return the momentum in N s that strong dashpots may take from each node in each step, and its way in m (steps, n).

    Their force decays within a step, which the recorded forces do not show. It takes what approaches, and nothing more: by
    as much as a body is thrown back, its momentum is out of balance.
    """
    taken = way = np.zeros((1, len(d.nodes)))
    if may_stop(d, ONE_STAGE * run.longest, 0.5):
        rows, H, Y, G = damped_rows(d)
        pushes = _pushing(run, rows)
        U = run.v @ H.T
        change = np.clip(np.diff(U, axis=0), 0.0, np.maximum(-U[:-1], 0.0)) * pushes
        taken = np.abs(change @ np.linalg.pinv(G) @ H)
        massive, E = d.massive, d.decomposition.damped
        plates = np.abs(np.linalg.pinv(Y) @ d.H[rows] @ E @ np.linalg.inv(E.T @ d.substitute_damping @ E) @ E.T)
        way = (np.maximum(-U[:-1], 0.0) * pushes) @ plates
        way[:, massive] += np.abs(np.linalg.solve(d.M[np.ix_(massive, massive)], taken[:, massive].T)).T
    if may_damp(d, run.longest, 0.5):
        pushes = np.asarray(_pushing(run, d.rigid).any(axis=1) | run.P.any(axis=1))
        for closed, here in ((none(d), np.ones_like(pushes)), (d.rigid, pushes)):
            for _, p in directions(d, run.longest, 0.5, closed):
                speed = run.v @ (d.M @ p)
                had = np.abs(speed[:-1]) * here
                # Contacts and dashpots pass on to a light plate what they take from a body.
                passed = np.abs(d.M @ p).sum() * (np.abs(p) > LEAST_COUPLING * np.abs(p).max())
                taken = taken + np.clip(-np.diff(speed) * np.sign(speed[:-1]), 0.0, had)[:, None] * passed
                way = way + had[:, None] * np.abs(p)
                if len(run.loads):
                    # Their force follows a load as it is at the ends of steps.
                    taken = taken + (np.abs(run.loads @ p) * here)[:, None] * np.abs(d.M @ p)
    return taken, run.h * way


def _pushing(run: Steps, rows: Indices | Flags) -> Flags:
    """Return which of some rows push in each step, or at one of its ends."""
    pushes = run.r[:, rows] > 0.0
    return np.asarray(pushes if run.in_steps else pushes[1:] | pushes[:-1])


def _largest_forces(d: Dynamics, run: Steps) -> Array:
    """Return the largest force at each node in N, including transmitted contact forces and impulses (n,)."""
    forces, links = np.abs(run.g).max(axis=0), np.abs(d.B)
    transmitted = np.maximum(np.abs(run.r).max(axis=0, initial=0.0), (links * forces[:, None]).max(axis=0, initial=0.0))
    return np.asarray(np.maximum(forces, links @ transmitted))


def _judge_contacts(
    d: Dynamics, run: Steps, impacts: RunImpacts, scales: Scales, largest: Array, limits: Limits
) -> Judgement:
    """Judge complementarity, penetration, bounds and the impact law; ``largest`` are the largest impulses (nc,)."""
    ε = limits.precision
    longest = run.longest
    v = run.v
    r = run.r
    at = slice(1, None) if run.in_steps else slice(None)
    u = d.gap(run.t[at], run.q[at]) + r @ d.D.T
    closes, bounds = d.impenetrable, rate_forces(d, scales.r)
    reach = np.where((d.relative_degree == 2) | (2 not in limits.relative_degrees), limits.penetration, 0.0)
    gap_tol = ε * scales.u + reach * longest * scales.U
    driven = np.abs(d.H[:, d.driven]) @ np.abs(np.diff(run.v[:, d.driven], axis=0)).max(axis=0, initial=0.0)
    changes = longest * accelerations(d, run.acting) + driven
    slow = 2.0 * run.spread * min(limits.slack, 3.0) * changes + ε * scales.U
    violation, by_impacts = judge_impacts(d, impacts, -gap_tol)
    U = d.gap_rate(run.t, run.q, v)
    mean = 0.5 * (U[1:] + U[:-1]) if run.in_steps else U
    duration = run.h if run.in_steps else np.append(run.h, run.h[-1:], axis=0)
    rows = judge_rows(d, r, u, mean, lambda power: duration * power)
    # A contact may open within the step over which its force is averaged.
    opening = longest * scales.U * ((d.relative_degree == 2) & run.in_steps)
    turned = np.zeros(len(d.contacts))
    if d.of_rate.any():
        turned = np.abs(np.diff(U, axis=0)).max(axis=0, initial=0.0)
    products = [
        (rows.apart[closes], (scales.r * (ε * scales.u + opening))[closes]),
        (rows.overlapping[closes], (scales.r * gap_tol)[closes]),
        (rows.friction, bounds * longest * (ε * scales.U + 2.0 * turned)),
        (by_impacts, largest * slow),
        (_missing_switches(d, run, u), (d.r_max - d.r_min)[d.switches] * (ε * scales.u)[d.switches]),
    ]
    largest = np.maximum(largest, d.friction_bounds(largest) * d.tangential)
    return {
        "complementarity": largest_violation(*(np.concatenate(each) for each in zip(*products, strict=True))),
        "penetration": largest_violation(rows.penetration, np.where(row_kinds(d).held, ε * scales.u, gap_tol)),
        "tension": largest_violation(
            rows.tension, ε * (scales.r + bounds * d.tangential + largest / float(run.h.max(initial=1e-300)))
        ),
        # Rates of massless nodes jump, and places have their rounding.
        "impact_law": largest_violation(
            np.concatenate([violation, rows.missed]),
            np.concatenate([slow, slow + 2.0 * turned * (d.relative_degree < 2) + ε * scales.u / float(np.ptp(run.t))]),
        ),
    }


def _missing_switches(d: Dynamics, run: Steps, u: Array) -> Array:
    """Return by how much relays miss their law in W at the instants of their reactions, or throughout any step (nr,)."""
    if not d.switches.any():
        return np.zeros(0)
    if run.mean:
        before = d.gap(run.t[:-1], run.q[:-1]) + run.r @ d.D.T
        u = np.where(before * u > 0.0, np.sign(u) * np.minimum(np.abs(before), np.abs(u)), 0.0)
    missing = law_residual(d, run.r, u, d.switches)
    if run.in_steps:
        # After a jump of an input in a step, the position at its end has the right limit, and the reaction the left one.
        for signal in (term for motion in d.motions.values() for term in terms_of(motion)):
            if isinstance(signal, PiecewisePolynomial) and not signal.continuous:
                at = breakpoints_at(signal, run.t)[0]
                within = means_in_steps(signal, run.t)[0]
                missing[np.union1d(within, at[at > 0] - 1)] = 0.0
    return np.asarray(missing[:, d.switches].max(axis=0, initial=0.0))


def _judge_steps(
    d: Dynamics,
    run: Steps,
    off: tuple[Array, Array],
    events: Sequence[Event],
    scaled: tuple[Scales, Array],
    limits: Limits,
    *,
    uniform_rtol: float = 1e-6,
) -> Judgement:
    """Judge the momentum and displacement of each single step away from events, by the second differences around it.

    ``uniform_rtol``: relative excess of a step over the shortest one above which the grid is not uniform.
    """
    nodes = judged_nodes(d)
    h = run.h
    t = run.t
    scales, Δv = scaled
    nonsmooth = h[:, 0] > (1.0 + uniform_rtol) * h.min(initial=np.inf)
    mark_mode_changes(run.r, *_intervals(d, run.r), nonsmooth)
    near = np.searchsorted(t, [event.t for event in events])[:, None] + np.array([-2, -1, 0])
    nonsmooth[np.clip(near, 0, len(h) - 1)] = True
    nonsmooth |= (_taken_by_dashpots(d, run)[0] > scales.momenta * limits.precision).any(axis=1)
    if d.springs:
        nonsmooth |= (np.diff(d.push(run.q, run.v) != 0.0, axis=0)).any(axis=1)
    if d.dashpots:
        nonsmooth |= np.diff(pieces(d.rate_laws, run.v @ d.rate_directions.T), axis=0).any(axis=1)
    margins = _impulse_margins(d, run, limits)
    ε = max(limits.precision, SCALE_FLOOR)
    none = np.zeros((0, len(d.nodes)))
    total = np.ascontiguousarray(run.total)
    steps = np.ascontiguousarray(h[:, 0])
    rounding = ε * scales.momenta
    defect = largest_step_errors(steps, off[0], total, margins, nonsmooth, rounding, limits.step)
    # A mean force of a step may act at any instant of it.
    placed = max(limits.kick, float(run.in_steps))
    rounding = ε * scales.q + placed * run.longest * Δv
    # A jump of a load within a step changes the displacement by at most h times its change of the velocity.
    moves = h * (margins @ np.abs(np.linalg.pinv(d.M))) if not d.constant_loads else none
    q_defect = largest_step_errors(steps, off[1], run.v, moves, nonsmooth, rounding, limits.step)
    momentum = defect[:, nodes.massive]
    displacement = q_defect[:, nodes.massive | (node_kinds(d) == NodeKind.DAMPED)]
    return {"momentum": largest_violation(*momentum), "kinematics": largest_violation(*displacement)}


def _intervals(d: Dynamics, r: Array) -> tuple[Array, Array]:
    """Return the bounds of reactions at each instant, those of r (nr, nc)."""
    low, high = d.interval(r)
    return np.array(np.broadcast_to(low, r.shape), order="C"), np.array(np.broadcast_to(high, r.shape), order="C")


def _impulse_margins(d: Dynamics, run: Steps, limits: Limits) -> Array:
    """Return bounds of the impulse errors of each step by loads, reactions and lossy springs in N s; no rows for none."""
    q = run.q
    v = run.v
    h = run.h
    f = run.f
    margins = np.zeros((0, len(d.nodes)))
    if limits.kick or not d.constant_loads or d.motions:
        # Prescribed loads and motions may have a kink within a step, and a recorded reaction may lag behind.
        if d.motions:
            f = f - q[:, d.driven] @ d.K[:, d.driven].T - v[:, d.driven] @ d.C[:, d.driven].T
        margins = 2.0 * h * _end_maximum(np.abs(np.diff(f, n=2, axis=0)), len(h))
        if limits.kick:
            margins += limits.kick * h * _neighbour_maximum(np.abs(np.diff(run.r, axis=0)) @ np.abs(d.B).T, len(h))
    if (d.power_laws[:, 3:5] > 0.0).any():
        # Methods may evaluate the compression of a lossy spring and its rate at different instants of a step.
        ends = d.spring_force(q, v)
        mixed = d.spring_force(q[1:], v[:-1])
        lossy = h * _neighbour_maximum(np.abs(ends[1:] - mixed) + np.abs(mixed - ends[:-1]), len(h))
        margins = margins + lossy if len(margins) else lossy
    if d.C.any():
        # A dashpot takes C (q⁺ - q), which on a light body with a spring differs by more than what remains of both forces.
        taken = np.abs((np.diff(q, axis=0) - 0.5 * h * (v[1:] + v[:-1])) @ d.C.T)
        margins = margins + taken if len(margins) else taken
    if len(run.loads):
        margins = margins + _shifted_maximum(np.abs(run.loads), len(h), 1, range(3))
    return margins


def _judge_impulses(
    d: Dynamics,
    run: Steps,
    defect: Array,
    events: Sequence[Event],
    scales: Scales,
    limits: Limits,
    *,
    impact_factor: float = 2.0,
) -> tuple[float, float]:
    """Judge the momentum over the steps around each isolated impact.

    The instant of an impact within its step depends on the method, so a jump of the forces may act longer or shorter by h.

    ``impact_factor``: limit of the error of an impulse, in units of h times the jump of the forces at the impact;
    known problems reach 1.
    """
    happened = np.searchsorted(run.t, [event.t for event in events]) - 1
    hit = np.unique(run.step)
    isolated = np.array(
        [(np.abs(happened - k) <= 1).sum() == (np.abs(happened - k) <= 2 * NEIGHBOURS).sum() for k in hit], dtype=bool
    )
    hit = hit[isolated & (hit >= 2 * NEIGHBOURS) & (hit < len(defect) - 2 * NEIGHBOURS)]
    around = hit[:, None] + np.arange(-NEIGHBOURS, NEIGHBOURS + 1)
    jump = np.abs(np.diff(run.total[around], axis=1)).max(axis=1)
    longest = run.h[around, 0].max(axis=1, keepdims=True)
    allowed = max(limits.precision, SCALE_FLOOR) * scales.momenta + impact_factor * longest * jump
    if limits.kick:
        allowed += limits.kick * longest * (np.ptp(run.r[around], axis=1) @ np.abs(d.B).T)
    taken, _ = _taken_by_dashpots(d, run)
    allowed += np.broadcast_to(taken, (len(run.h), len(d.nodes)))[around].sum(axis=1)
    off = np.abs(defect[hit + NEIGHBOURS - 1] - defect[hit - NEIGHBOURS])
    return largest_violation(off[:, d.massive], allowed[:, d.massive])


def _neighbour_maximum(changes: Array, steps: int) -> Array:
    """Return for each step the largest of the neighbouring changes from step to step, except its own (steps, n)."""
    return _shifted_maximum(
        changes, steps, NEIGHBOURS, (NEIGHBOURS - 3, NEIGHBOURS - 2, NEIGHBOURS + 3, NEIGHBOURS + 4)
    )


def _end_maximum(changes: Array, steps: int) -> Array:
    """Return for each step the largest change at its ends and at the next point on either side (steps, n)."""
    return _shifted_maximum(changes, steps, 1, range(steps + 3 - len(changes)))


def _shifted_maximum(changes: Array, steps: int, margin: int, shifts: Iterable[int]) -> Array:
    """Return for each step k the largest of the changes k + margin - shift (steps, n)."""
    wide = np.zeros((steps + 2 * margin, changes.shape[1]))
    for shift in shifts:
        part = wide[shift : shift + len(changes)]
        np.maximum(part, changes, out=part)
    return wide[margin:-margin]
