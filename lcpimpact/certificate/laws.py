"""Forces on nodes, accelerations of gaps, and violations of friction and bounds, for given states of a system."""

from __future__ import annotations

from collections.abc import Callable
from itertools import chain
from typing import NamedTuple

import numpy as np

from lcpimpact.arrays import Array, Flags, Indices, largest
from lcpimpact.certificate.quadrature import GAUSS_NODES, GAUSS_WEIGHTS
from lcpimpact.certificate.scales import masses
from lcpimpact.integrators.stepping.strong_dashpots import WEIGHTS, blows, early_weights, on_strong_dashpots
from lcpimpact.memo import once
from lcpimpact.numerics.rounding import EPS
from lcpimpact.record import Record
from lcpimpact.scheme.dynamics import Dynamics
from lcpimpact.scheme.lagrangian import LagrangianDynamics
from lcpimpact.scheme.power_law import greatest_rebounds
from lcpimpact.scheme.terms import NodeKind


@once
def node_kinds(d: Dynamics) -> Indices:
    """Return the kinds of the nodes: 1 with mass, 2 with prescribed motion, 0 massless with dashpots, -1 without (n,)."""
    driven, massive = d.driven, d.massive
    loose: Flags = np.zeros(len(massive), dtype=np.bool_)
    if not (driven | massive).all():
        loose = np.asarray(d.decomposition.static.any(axis=1))
    return np.select(
        [driven, massive, loose], [NodeKind.DRIVEN, NodeKind.MASSIVE, NodeKind.FREE], NodeKind.DAMPED
    ).astype(np.int64)


@once
def elastic_contacts(d: Dynamics) -> Flags:
    """Return the contacts that give way by linear springs alone, where nothing on massless nodes dissipates (nc,)."""
    takes = d.decomposition.damped.any() or d.of_rate.any() or d.switches.any()
    if takes or d.springs or d.dashpots or d.force_laws:
        return np.zeros(len(d.contacts), dtype=np.bool_)
    on_path = (d.impulse_lines > 0.0).any(axis=0)
    return np.asarray(d.impenetrable & (d.relative_degree == 0) & ~on_path & ~d.D.any(axis=1))


def accelerations(d: Dynamics, g: Array) -> Array:
    """Return bounds of the acceleration U' of each row in m/s² by the forces g on the nodes with mass (nc,)."""
    massive, M = d.massive, masses(d)
    if M.ndim == 1:
        largest = np.abs(g).max(axis=0, initial=0.0)[massive] / M
    else:
        largest = np.abs(np.linalg.solve(M, g[:, massive].T)).max(axis=1, initial=0.0)
    return np.asarray(np.abs(d.H[:, massive]) @ largest)


def moving_accelerations(d: LagrangianDynamics, t: Array, q: Array, v: Array, r: Array) -> Array:
    """Return M⁻¹ of all forces of a Lagrangian system, gyroscopic ones included, with reactions r (nt, n)."""
    forces = d.forces_at(t, q, v).F + d.reaction_force(q, r, t)
    return np.asarray(np.linalg.solve(d.mass(q), forces[..., None])[..., 0])


def law_residual(d: Dynamics, r: Array, z: Array, rows: Flags) -> Array:
    """Return |(r - r_min) z| where z > 0 and |(r_max - r) z| where z < 0, of some ``rows``; zero for others (..., nc).

    z is the rate U, for rows of which the product is the power in W that friction takes too little, or the place u. Where
    a bound is infinite, z itself is the violation (`missed_rates`).
    """
    low, high = d.interval(r)
    room = np.where(z > 0.0, r - low, high - r)
    return np.asarray(np.abs(np.where(rows & np.isfinite(room), room, 0.0) * np.where(rows, z, 0.0)))


def missed_rates(d: Dynamics, U: Array) -> Array:
    """Return |U| in m/s of rows of the rate, where its sign is one that no reaction allows; zero elsewhere (..., nc)."""
    never = d.of_rate & ~d.tangential & np.where(U > 0.0, np.isinf(d.r_min), np.isinf(d.r_max))
    return np.where(never, np.abs(U), 0.0)


def rate_forces(d: Dynamics, r: Array) -> Array:
    """Return the scale in N of the reaction of each row of the rate: its bound, or |r| without one; 0 of others (nc,)."""
    unbounded = d.of_rate & ~d.tangential & ~d.limited
    return np.where(unbounded, np.abs(r), d.friction_bounds(r))


def bound_violation(d: Dynamics, r: Array) -> Array:
    """Return by how much reactions (ns, nc) leave their bounds at most in N (nc,)."""
    beyond = np.maximum(d.r_min - r.min(axis=0, initial=np.inf), r.max(axis=0, initial=-np.inf) - d.r_max)
    if row_kinds(d).some_of_rate:
        holding = (np.abs(r) - d.holding_bounds(r)).max(axis=0, initial=0.0)
        beyond = np.where(d.tangential, holding, beyond)
    return np.asarray(np.maximum(beyond, 0.0))


class RowViolations(NamedTuple):
    """Largest violations of the laws of each row (nc,).

    Attributes
    ----------
    apart, overlapping      |r u| in J of contacts that are open, and of those that penetrate
    friction                what rows of the rate dissipate too little, in J
    missed                  rates in m/s of rows of the rate that no reaction allows
    penetration             -u of contacts, and |u| of rows that are held at u = 0, in m
    tension                 reactions beyond their bounds in N
    """

    apart: Array
    overlapping: Array
    friction: Array
    missed: Array
    penetration: Array
    tension: Array

    def larger(self, other: RowViolations) -> RowViolations:
        """Return the larger of each violation."""
        return RowViolations(*map(np.maximum, self, other))


class RowKinds(NamedTuple):
    """Flags of the rows that are held at u = 0 (nc,), and whether there are any, and any whose law is of the rate."""

    held: Flags
    some_held: bool
    some_of_rate: bool


@once
def row_kinds(d: Dynamics) -> RowKinds:
    """Return which kinds of rows a system has."""
    held = d.bilateral & ~d.of_rate
    return RowKinds(held, bool(held.any()), bool(d.of_rate.any()))


def judge_rows(d: Dynamics, r: Array, u: Array, U: Array, integrate: Callable[[Array], Array]) -> RowViolations:
    """Judge the laws of the rows by reactions, places and rates of the same samples (ns, nc).

    A rule ``integrate``s powers at the samples over its steps (steps, nc). Rates are not read if no law is of them.
    """
    kinds = row_kinds(d)
    inside = np.minimum(u, 0.0)
    friction = missed = np.zeros(len(d.contacts))
    if kinds.some_of_rate:
        friction = largest(integrate(law_residual(d, r, U, d.of_rate)))
        missed = largest(missed_rates(d, U))
    penetration = largest(inside) * d.impenetrable
    if kinds.some_held:
        penetration = np.where(kinds.held, largest(u), penetration)
    return RowViolations(
        largest(r * (u - inside)) * d.impenetrable,
        largest(r * inside) * d.impenetrable,
        friction,
        missed,
        penetration,
        bound_violation(d, r),
    )


@once
def steady_loads(d: Dynamics) -> Array:
    """Return the constant loads f_0 (n,)."""
    f0 = np.zeros(len(d.nodes))
    for i, load in d.loads:
        if not callable(load):
            f0[i] += load
    return f0


def forces_on_nodes(d: Dynamics, t: Array, q: Array, v: Array, r: Array | None) -> tuple[Array, Array]:
    """Return the loads f, and the forces f + s - K q - C v + B r on the nodes (nt, n); with r None, without reactions.

    Of a Lagrangian system they are the other forces Q, and the rate of its momentum M v.
    """
    if isinstance(d, LagrangianDynamics):
        f, g = d.supplied_of(t, q, v)
        return f, g if r is None else g + d.reaction_force(q, r, t)
    f = np.broadcast_to(steady_loads(d), q.shape) if d.constant_loads else d.applied(t, q, v)
    g = f - q @ d.K.T - v @ d.C.T
    if d.springs:
        g += d.spring_force(q, v)
    if d.dashpots:
        g += d.dashpot_force(v)
    if r is not None:
        g += d.reaction_force(q, r, t)
    return f, g


def loads_in_steps(d: Dynamics, t: Array, θ: float) -> Array:
    """Return the means (1 - θ) f(t⁺) + θ f((t + h)⁻) of the loads in the steps of a grid (steps, n)."""
    if not d.breaking_loads:
        f = d.force(t)
        return np.asarray((1.0 - θ) * f[:-1] + θ * f[1:])
    left, right = d.force_limits(t)
    return np.asarray((1.0 - θ) * right[:-1] + θ * left[1:])


def impulses_of_breaks(d: Dynamics, t: Array) -> Array:
    """Return the impulses of the loads in the steps of a grid in N s, beyond those by the trapezoidal rule (steps, n).

    They are those of jumps at the end of a step, and of breakpoints in it; without rows for none.
    """
    if not d.breaking_loads:
        return np.zeros((0, len(d.nodes)))
    f = d.force(t)
    return np.asarray(np.diff(t)[:, None] * (loads_in_steps(d, t, 0.5) - 0.5 * (f[:-1] + f[1:])))


def motion_forces_in_steps(d: Dynamics, record: Record, θ: float, early: Array | None = None) -> Array:
    """Return the general forces on the nodes at t_θ, q_θ and v_θ of each step (steps, n).

    v_θ of a node without mass is its mean velocity; for others the recorded one has less rounding, with the
    `early_velocities` of steps on strong dashpots.
    """
    h, way = np.diff(record.t), np.diff(record.q, axis=0)
    v = np.where(d.massive, (1.0 - θ) * record.v[:-1] + θ * record.v[1:], way / h[:, None])
    if early is not None and len(early):
        v = v + early
    return d.motion_forces(record.t[:-1] + θ * h, record.q[:-1] + θ * way, v)


def mean_motion_forces(d: Dynamics, record: Record) -> Array:
    """Return the means of the general forces along the line from q to q⁺ of each step, by Gauss's rule (steps, n)."""
    t = record.t
    q = record.q
    v = record.v
    found = np.zeros((len(record.t) - 1, len(d.nodes)))
    for node, weight in zip(0.5 * (1.0 + GAUSS_NODES), 0.5 * GAUSS_WEIGHTS, strict=True):
        found += weight * d.motion_forces(*((1.0 - node) * each[:-1] + node * each[1:] for each in (t, q, v)))
    return found


def blows_that_end(d: Dynamics, record: Record, θ: float, *, near: float = 1e-6) -> Array:
    """Return the i of the weight 1/θ_k = 1 + i/n of each spring whose blow a step ends, -1 of others (steps, ns).

    Masses at ends that meet at U > 0 change their rate by (w - v)/θ_k in a step, with their mean velocity w. With θ they
    would part faster than after a blow of their law.

    ``near``: rounding of these rates, in units of U.
    """
    found = np.full((len(record.t) - 1, len(d.springs)), -1)
    mobility = blows(d)
    if θ == 1.0 or not mobility.any():
        return found
    δ = np.asfortranarray(d.approach(record.q))
    h = np.diff(record.t)
    w = np.diff(record.q, axis=0) / h[:, None] - record.v[:-1]
    change = np.diff(record.v, axis=0)
    for j in np.flatnonzero(mobility):
        N = d.directions[j]
        U = -(record.v[:-1] @ np.where(d.massive | d.driven, N, 0.0))
        of_masses = np.where(d.massive, N, 0.0)
        changed, mean = change @ of_masses, w @ of_masses
        parting = mean / θ - U
        rounding = 16.0 * EPS * (np.abs(record.q) @ np.abs(N)).max() / h
        thrown = (U > 0.0) & (parting > 0.0) & (np.abs(changed - mean / θ) > rounding / θ)
        after = greatest_rebounds(d.power_laws[j], δ[:-1, j], np.where(thrown, U, 0.0), mobility[j])
        thrown &= parting > after - near * U
        found[thrown, j] = np.rint(WEIGHTS * (changed[thrown] / mean[thrown] - 1.0)).clip(0, WEIGHTS)
    return found


def early_velocities(d: Dynamics, record: Record, pushes: Flags, θ: float, *, explained_rtol: float = 1e-14) -> Array:
    """Return by how much w exceeds (1 - θ) v + θ v⁺ in steps on strong dashpots, and in those that end blows (steps, n).

    A contact that ``pushes`` (steps, nc) is closed in its step. One that has just opened may be, or all of them, or one that
    does not push once it is taken to be closed: the closest rule counts.
    There are no rows if there are no such steps.

    ``explained_rtol``: difference of a way from a rule, relative to the largest coordinate, which is rounding.
    """
    h = np.diff(record.t)
    rows = on_strong_dashpots(d, float(h.max(initial=0.0)), θ)
    ends = blows_that_end(d, record, θ)
    if rows is None and not (ends >= 0).any():
        return np.zeros((0, len(d.nodes)))
    rows = np.zeros(0, dtype=np.int64) if rows is None else rows
    now = pushes[:, rows]
    before = np.vstack([now[:1], now[:-1]])
    change = np.diff(record.v, axis=0)
    level = np.rint(np.log2(h.max() / h))
    way = np.diff(record.q, axis=0)
    off = way - h[:, None] * ((1.0 - θ) * record.v[:-1] + θ * record.v[1:])
    early, least = np.zeros_like(way), np.full(len(h), np.inf)
    touched = (now | (np.arange(len(rows)) == k) for k in range(len(rows)))
    for closed in chain((now, now | before, np.ones_like(now)), touched):
        if (least <= explained_rtol * np.abs(record.q).max()).all():
            break
        modes, which = np.unique(np.column_stack([level, closed, ends]), axis=0, return_inverse=True)
        found = np.zeros_like(early)
        for k, mode in enumerate(modes):
            here = which.ravel() == k
            at, i = np.split(mode[1:].astype(int), [len(rows)])
            ended = {int(j): int(i[j]) for j in np.flatnonzero(i >= 0)}
            rule = early_weights(d, float(h[here].mean()), θ, rows[at > 0], ended)
            found[here] = change[here] @ rule.T
        miss = np.abs(np.where(d.massive, off - h[:, None] * found, 0.0)).max(axis=1)
        better = miss < least
        early[better], least[better] = found[better], miss[better]
    return early
