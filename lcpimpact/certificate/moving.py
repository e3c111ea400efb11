r"""Certificate of a run of a Lagrangian system on its grid: balances of each step, bounded by the turning of forces in it.

With the momentum M(q) v and Lagrange's equations the balances of a step are

.. math:: M(q^+) v^+ - M(q) v = h \bar G + \bar H^T p, \qquad G = Q + \frac{∂}{∂q} \left( \tfrac12 v^T M v - V \right),
          \qquad q^+ - q = h \bar v,

with the impulses p of its rows, forces included, and means over both of its ends. The gyroscopic terms of the steps are in
the change of the momentum here, so that they are checked by other formulas. How far a method may be off follows from how far
values turn in a step and beside it: from second differences where they are smooth, from jumps where bodies strike. A step in
which forces turn as the motion itself does cannot be judged, and counts as one that misses impulses.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from lcpimpact.arrays import Array, Flags, largest
from lcpimpact.certificate.balances import momentum_imbalances
from lcpimpact.certificate.energy import Energies, account_of, impulses_in_steps
from lcpimpact.certificate.impacts import RunImpacts, impact_law
from lcpimpact.certificate.laws import forces_on_nodes, judge_rows, law_residual, moving_accelerations, row_kinds
from lcpimpact.certificate.scales import Judgement, Scales, largest_violation
from lcpimpact.certificate.trapezoid import JUMP_FACTOR, trapezoids
from lcpimpact.events import steps_of
from lcpimpact.integrators.base import Integrator, Limits
from lcpimpact.numerics.rounding import EPS
from lcpimpact.record import Event, Record
from lcpimpact.scheme.lagrangian import LagrangianDynamics, MotionRows, images

TURNED = 1.0 / 3.0
"""Impulse that the turning of forces within a step may miss, relative to the largest momentum: 4 steps of a period do."""


@dataclass(frozen=True, eq=False)
class MovingSteps:
    """A run on its grid.

    Attributes
    ----------
    record : Record
    h : (steps, 1) array                lengths of the steps
    rows : MotionRows                   the rows at the instants
    H_ahead : (steps, nc, n) array      H at q + h v, where steps may have their laws
    M : (nt, n, n) array                mass matrices
    spread : (steps, n, n) array        |M⁻¹| at the ends of the steps, the changes of v by impulses of any signs
    G : (nt, n) array                   the forces of Lagrange's equations; with reactions, if these are at the instants
    G_off, H_off, M_off : arrays        the largest differences of G, H and M half way through a step from their means
    struck : (steps, nc) flags          rows with an impact in a step
    p : (steps, nc) array               impulses that act apart from G: of impacts, and of reactions that belong to steps
    r : (steps, nc) array               mean reactions of the steps
    F : (nt, n) array                   the forces with the gyroscopic ones
    acceleration : (nt, n) array        M⁻¹ of all forces, of the steps that begin at the instants
    """

    record: Record
    h: Array
    rows: MotionRows
    H_ahead: Array
    M: Array
    spread: Array
    G: Array
    G_off: Array
    H_off: Array
    M_off: Array
    struck: Flags
    p: Array
    r: Array
    F: Array
    acceleration: Array

    @classmethod
    def of(cls, d: LagrangianDynamics, record: Record, events: Sequence[Event], spread: int) -> MovingSteps:
        """Return the steps of a record whose impacts take ``spread`` steps each."""
        t = record.t
        q = record.q
        v = record.v
        r = record.reaction
        h = np.diff(t)[:, None]
        in_steps = len(r) < len(t)
        t_half, q_half, v_half = map(_mean, (t, q, v))
        halves = q_half, q[:-1] + 0.5 * h * v[:-1], q[1:] - 0.5 * h * v[1:]
        mean = r if in_steps else 0.5 * (r[1:] + r[:-1])
        # A record with reactions at its instants begins behind the impacts at its start.
        P = impulses_in_steps(d, record, [each for each in events if in_steps or each.t > t[0]], spread)
        G = forces_on_nodes(d, t, q, v, None if in_steps else r)[1]
        rows, M = d.rows(t, q, v), d.mass(q)
        off = [
            (
                forces_on_nodes(d, t_half, each, v_half, None if in_steps else mean)[1] - _mean(G),
                d.rows(t_half, each, v_half).H - _mean(rows.H),
                d.mass(each) - _mean(M),
            )
            for each in halves
        ]
        G_off, H_off, M_off = (np.abs(each).max(axis=0) for each in zip(*off, strict=True))
        return cls(
            record=record, h=h, rows=rows, H_ahead=d.rows(t[1:], q[:-1] + h * v[:-1], v[:-1]).H, M=M,
            spread=np.abs(np.linalg.inv(M[1:])), G=G, G_off=G_off,
            H_off=H_off, M_off=M_off, struck=P != 0.0, p=h * r + P if in_steps else P, r=mean, F=d.forces_at(t, q, v).F,
            acceleration=moving_accelerations(d, t, q, v, np.append(r, r[-1:], axis=0) if in_steps else r),
        )  # fmt: skip

    def gains(self) -> Array:
        """Return the speeds that forces and reactions would give in the steps, if they did not balance (steps, n)."""
        pushes = images(np.abs(self.rows.H[1:]).swapaxes(1, 2), np.abs(self.r))
        return self.h * images(self.spread, np.abs(self.F[1:]) + pushes)

    def unbalanced(self, scales: Scales) -> Array:
        """Return the ways in m by which the rounding of forces that cancel moves places in the steps (steps, n)."""
        return 64.0 * EPS * self.h * images(self.spread, self.h * scales.forces)

    def pushed(self) -> Array:
        """Return the momentum that rows give in the steps, by the mean of H over both ends (steps, n)."""
        H = self.rows.H.swapaxes(1, 2)
        return 0.5 * (images(H[1:], self.p) + images(H[:-1], self.p))

    def turning(self) -> Array:
        """Return by how much the impulses half way through each step differ from the means of its ends in N s (steps, n)."""
        rows = images(self.H_off.swapaxes(1, 2), np.abs(self.p))
        return np.asarray(self.h * self.G_off + rows + images(self.M_off, np.abs(np.diff(self.record.v, axis=0))))

    def turned_kicks(self) -> Array:
        """Return by how much the changes of v by the forces at both ends of each step differ, in m/s (steps, n)."""
        return images(self.spread, self.h * np.abs(np.diff(self.F, axis=0)))

    def turned_ahead(self) -> Array:
        """Return by how much the rates at the ends of steps differ from those by the rows at q + h v, in m/s (steps, nc)."""
        return images(np.abs(self.H_ahead - self.rows.H[1:]), np.abs(self.record.v[1:]))


def judge_moving(
    d: LagrangianDynamics,
    start: tuple[Array, Array],
    record: Record,
    events: Sequence[Event],
    integrator: Integrator | None,
    limits: Limits,
) -> tuple[Judgement, Scales, Energies]:
    """Judge a run of a Lagrangian system that is known at the points of its grid; ``start`` holds the initial q and v."""
    spread = 1 if integrator is None else integrator.impact_steps
    θ = None if integrator is None else integrator.balance_point()
    order = 1.0 if θ not in (None, 0.5) else limits.order
    run = MovingSteps.of(d, record, events, spread)
    t = record.t
    q = record.q
    v = record.v
    scales = Scales.of_moving(d, (t, q, v), run.r, run.G, largest(run.gains()))
    off_p = momentum_imbalances(d, q, v, trapezoids(run.h, run.G) + run.pushed())
    off_q = np.abs(np.diff(q, axis=0) - trapezoids(run.h, v))
    may_p, may_q = _errors(d, run, limits, order)
    ε = limits.precision
    # Lengths of steps and angles have their rounding.
    rounding = 64.0 * EPS * float(t[-1]) * scales.forces + 64.0 * EPS * scales.momenta
    allowed_p = may_p + ε * (scales.momenta + run.h * scales.forces) + rounding
    allowed_q = may_q + ε * scales.q + run.unbalanced(scales) + 64.0 * EPS * _terms_of_gaps(run)
    if spread > 1:
        # An impact over several steps is one balance.
        struck_steps = np.asarray(run.struck.any(axis=1))
        first = np.flatnonzero(np.append([True], ~(struck_steps[1:] & struck_steps[:-1])))
        off_p, allowed_p = (np.add.reduceat(each, first) for each in (off_p, allowed_p))
    began = np.abs(q[0] - start[0]), np.abs(v[0] - start[1])
    struck = any(event.t <= t[0] and event.impulse for event in events)
    found = {
        "momentum": largest_violation(np.abs(off_p), allowed_p),
        "kinematics": largest_violation(
            np.vstack([off_q, began[0], 0.0 * began[1] if struck else began[1]]),
            np.vstack([allowed_q, ε * scales.q, ε * scales.v]),
        ),
        "missed_impulse": largest_violation(run.turning(), TURNED * scales.momenta + rounding),
        **_judge_rows(d, run, events, scales, limits, order, spread),
    }
    energies, allowed = _energies(d, run, events, (may_p, may_q), limits, integrator)
    if limits.balances_energy and order > 1.0:
        found["energy_balance"] = energies.imbalance, allowed + ε * energies.scale
    return found, scales, energies


def _errors(d: LagrangianDynamics, run: MovingSteps, limits: Limits, order: float) -> tuple[Array, Array]:
    """Return how far steps of a method may be off in momentum and in q (steps, n)."""
    p, h = run.p, run.h
    turns = np.abs(np.diff(run.rows.H, axis=0))
    Δv = np.abs(np.diff(run.record.v, axis=0))
    curved, jumps = _around(_curvature(run.record.v)), _around(_jumps(p))
    by_jumps = images((turns + run.H_off).swapaxes(1, 2), jumps)
    by_jumps += images(np.abs(np.diff(run.M, axis=0)) + run.M_off, curved)
    forces = limits.kick * _kicks(run) if limits.kick else 0.0
    error_p = 1.5 * run.turning() + JUMP_FACTOR * h * _around(_curvature(run.G)) + by_jumps + forces
    # Half steps have the velocities of half their forces, also where reactions hold those at their ends.
    error_q = JUMP_FACTOR * h * (curved + run.turned_kicks()) + _projections(d, run, order)
    if order < 2.0:
        error_p = error_p + h * (np.abs(np.diff(run.G, axis=0)) + np.abs(np.diff(run.F, axis=0)))
        error_p += images(turns.swapaxes(1, 2), np.abs(p))
        error_p += images(np.abs(np.diff(run.M, axis=0)), Δv)
        error_q = error_q + h * Δv
    return limits.slack * error_p, limits.slack * error_q


def _kicks(run: MovingSteps) -> Array:
    """Return the momentum that recorded velocities may miss (steps, n): of forces at impacts, of reactions half a step off.

    The rows of an impact take at most the part h F in the norm of M⁻¹, along whatever directions, and what turns them.
    """
    H, M = run.rows.H[1:], run.M[1:]
    F, h = run.F[1:], run.h
    W = np.einsum("kin,kni->ki", H, np.linalg.solve(M, H.swapaxes(1, 2)))
    turns = h * run.struck * np.divide(np.abs(run.rows.kappa[1:]), W, out=np.zeros_like(W), where=W > 0.0)
    along = np.abs(H).swapaxes(1, 2)
    force = np.sqrt((F * np.linalg.solve(M, F[..., None])[..., 0]).sum(axis=1, keepdims=True))
    lost = h * force * np.sqrt(np.einsum("knn->kn", M)) * (images(along, run.struck.astype(np.float64)) > 0.0)
    return _around(lost + images(along, turns)) + images(along, _jumps(h * run.r))


def _projections(d: LagrangianDynamics, run: MovingSteps, order: float) -> Array:
    """Return how far places may be moved at the ends of steps to close the joints (steps, n)."""
    H = run.rows.H[:, d.bilateral]
    v = run.record.v
    turns = np.abs(np.diff(H, axis=0))
    moved = run.H_off[:, d.bilateral] + (turns if order < 2.0 else 0.0)
    opened = images(moved, np.maximum(np.abs(v[1:]), np.abs(v[:-1]))) + images(turns, np.abs(np.diff(v, axis=0)))
    back = np.linalg.solve(run.M[1:], H[1:].swapaxes(1, 2))
    return run.h * images(np.abs(back @ np.linalg.inv(H[1:] @ back)), opened)


def _terms_of_gaps(run: MovingSteps) -> Array:
    """Return how far the terms of the gaps move places, whose rounding is in those that are closed (steps, n)."""
    H = np.abs(run.rows.H[1:])
    back = run.spread @ H.swapaxes(1, 2)
    unit = np.einsum("kin,kni->ki", H, back)
    per_gap = np.divide(images(H, np.abs(run.record.q[1:])), unit, out=np.zeros_like(unit), where=unit > 0.0)
    return images(back, per_gap)


def _judge_rows(
    d: LagrangianDynamics,
    run: MovingSteps,
    events: Sequence[Event],
    scales: Scales,
    limits: Limits,
    order: float,
    spread: int,
) -> Judgement:
    """Judge places, reactions, friction and the law of impact."""
    record, h = run.record, run.h
    ε = limits.precision
    t = record.t
    v = record.v
    r = record.reaction
    U = run.rows.rates(v)
    in_steps = len(r) < len(t)
    at = slice(1, None) if in_steps else slice(None)
    u, r_at = run.rows.g[at], r
    size = np.abs(scales.dynamics.H)
    # Where the law is that of rates, places drift by the errors of the steps.
    turns = _curvature(v) + run.turned_kicks()
    curved = JUMP_FACTOR * h * _curvature(U) + limits.slack * JUMP_FACTOR * h * (turns @ size.T)
    if order < 2.0:
        curved += h * np.abs(np.diff(U, axis=0))
    rounding = ε * scales.u + largest(images(np.abs(run.rows.H[1:]), run.unbalanced(scales)))
    drift = np.append(np.zeros((1, len(d.contacts))), np.cumsum(curved, axis=0), axis=0) + rounding
    moves = h * np.maximum(np.abs(U[1:]), np.abs(U[:-1]))
    closes = drift + limits.penetration * np.maximum.accumulate(np.append(0.0 * moves[:1], moves, axis=0), axis=0)
    held, laws = row_kinds(d).held, d.impenetrable
    off = np.where(held, np.abs(run.rows.g), np.maximum(-run.rows.g, 0.0))
    mean = 0.5 * (U[1:] + U[:-1])
    turned = np.abs(np.diff(U, axis=0)) + run.turned_ahead()
    slip = h * law_residual(d, run.r, mean, d.of_rate)
    bounds = d.friction_bounds(run.r)
    judged = judge_rows(d, r_at, u, U[at], lambda power: power)
    # A contact may be open where it acts by no more than the way of the step.
    apart = np.abs(u) * np.abs(r_at) * laws
    may_open = np.abs(r_at) * (closes + np.append(moves[:1], moves, axis=0))[at]
    if limits.kick:
        # Velocities that obey the law half a step before and after the end have means along its rows at the end.
        turned += images(_curvature(run.rows.H), np.abs(v[1:]))
    products = [(apart, may_open), (slip, h * bounds * (ε * scales.U + 2.0 * turned))]
    rates = np.abs(U[1:]) * held
    may_turn = run.turned_ahead() + ε * scales.U + _curvature(U)
    missed, allowed = _impacts(d, run, events, spread, limits, (-closes.max(axis=0), ε * scales.U))
    struck = largest(run.p / h)
    return {
        "complementarity": largest_violation(
            *(np.concatenate([each.ravel() for each in side]) for side in zip(*products, strict=True))
        ),
        "penetration": largest_violation(off * (laws | held), np.where(held, drift, closes)),
        "tension": largest_violation(judged.tension, ε * (scales.r + struck + d.friction_bounds(scales.r + struck))),
        "impact_law": largest_violation(
            np.concatenate([missed.ravel(), rates.ravel()]),
            np.concatenate([allowed.ravel(), (limits.slack * may_turn).ravel()]),
        ),
    }


def _impacts(
    d: LagrangianDynamics,
    run: MovingSteps,
    events: Sequence[Event],
    spread: int,
    limits: Limits,
    least: tuple[Array, Array],
) -> tuple[Array, Array]:
    """Return the violations of the law of impact in m/s, and how large they may be (ni, nc).

    ``least``: gap of closed contacts, and rounding of rates (nc,).
    """
    record = run.record
    t = record.t
    q = record.q
    v = record.v
    struck = [event for event in events if event.impulse != 0.0]
    if len(record.reaction) < len(t):
        hit = np.unique(steps_of(struck, t, q, v))
        impacts = RunImpacts.of_steps(d, record, events, spread)
        if limits.kick:
            # The force before an impact belongs to its step, and its contact may open.
            rests = np.abs(impacts.P) <= 2.0 * run.h[hit] * np.abs(record.reaction[np.maximum(hit - 1, 0)])
            rests = np.where(d.tangential, rests[:, d.normals], rests & d.impenetrable)
            impacts = replace(impacts, P=np.where(rests, 0.0, impacts.P))
    else:
        impacts = RunImpacts.of(d, events)
        hit = impacts.steps(t)
    end = np.minimum(hit + spread, len(t) - 1)
    after = d.gap_rate(t[end], q[end], impacts.after) - d.gap_rate(impacts.t, impacts.q, impacts.after)
    pushes = np.maximum(*(np.abs(images(run.rows.H[k], run.acceleration[k]) + run.rows.kappa[k]) for k in (hit, end)))
    by_turning = np.abs(after) + run.turned_ahead()[hit]
    touch, rounding = least
    return impact_law(d, impacts, touch), 2.0 * (by_turning + spread * run.h[hit] * pushes) + rounding


def _energies(
    d: LagrangianDynamics,
    run: MovingSteps,
    events: Sequence[Event],
    may: tuple[Array, Array],
    limits: Limits,
    integrator: Integrator | None,
) -> tuple[Energies, float]:
    """Return the energies of the run, and how large their imbalance may be by the errors of its steps."""
    account, record = account_of(d), run.record
    spread = 1 if integrator is None else integrator.impact_steps
    stored = account.stored(record.q, record.v, record.q[0])
    flows = account.by_trapezoidal_rule(record, events, spread)
    off = account.imbalance(stored[1:], stored[0], np.cumsum(account.balance(flows)))
    speed = np.maximum(np.abs(record.v[1:]), np.abs(record.v[:-1]))
    force = np.abs(images(run.M[1:], run.acceleration[1:])) + np.abs(_mean(run.G))
    allowed = float((may[0] * speed).sum() + (may[1] * force).sum())
    scale = float(np.abs(stored[:, :2]).sum(axis=1).max())
    lost = np.zeros(len(off))
    order, constant = limits.order_loss, limits.loss_constant
    if order < 2.0:
        v, q = np.diff(record.v, axis=0), np.diff(record.q, axis=0)
        K = d.forces_at(record.t[1:], record.q[1:], record.v[1:]).K
        energy = d.kinetic_energy(record.q[1:], v) + 0.5 * np.abs(np.einsum("ki,kij,kj->k", q, K, q))
        lost = 2.0 * constant * np.cumsum(energy)
    return Energies(float(np.abs(off).max()), scale, float((-off - lost).max())), allowed


def _mean(values: Array) -> Array:
    """Return the means of values over both ends of each step (steps, ...)."""
    return np.asarray(0.5 * (values[1:] + values[:-1]))


def _jumps(values: Array) -> Array:
    """Return the largest change from each step to those beside it (steps, ...)."""
    change = np.abs(np.diff(values, axis=0))
    wide = np.concatenate([change[:1], change, change[-1:]]) if len(change) else np.abs(values).repeat(2, axis=0)
    return np.asarray(np.maximum(wide[1:], wide[:-1]))


def _around(values: Array, *, reach: int = 2) -> Array:
    """Return the largest value of each step and those beside it, and the mean of all (steps, ...)."""
    wide = np.concatenate([values[:1].repeat(reach, axis=0), values, values[-1:].repeat(reach, axis=0)])
    around = [wide[k : k + len(values)] for k in range(2 * reach + 1)]
    return np.asarray(np.max(around, axis=0) + values.mean(axis=0))


def _curvature(values: Array) -> Array:
    """Return the largest second difference at both ends of each step; of a step alone its change (steps, ...)."""
    change = np.diff(values, axis=0)
    second = np.abs(np.diff(change, axis=0))
    if not len(second):
        return np.abs(change)
    wide = np.concatenate([second[:1], second, second[-1:]])
    return np.asarray(np.maximum(wide[1:], wide[:-1]))
