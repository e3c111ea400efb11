"""The certificate of a run: how far it is from the laws that it should obey, computed from its record alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import types

from lcpimpact.arrays import Array, Flags, Indices
from lcpimpact.compiled import compiled, f8, i8, indices, matrix, vector
from lcpimpact.integrators.base import Dense, Event, Record
from lcpimpact.integrators.spring_law import push
from lcpimpact.scheme.dynamics import Dynamics

GAUSS_NODES, GAUSS_WEIGHTS = np.polynomial.legendre.leggauss(6)


@dataclass(frozen=True)
class Certificate:
    """Greatest violations over a run; each is zero for the exact motion.

    Attributes
    ----------
    residual : float
        Largest residual of the LCPs of the steps, in units where max |W| = max |q| = 1; zero where none is solved.
    complementarity : float
        Largest product in J: r u on rows of relative degree 0 and 1; impulse times U⁺ + e U on rows of degree 2; what the
        friction of a slider should dissipate more than it does, r0 |U| + r U over a step, or as a power in W for a method
        whose reactions live at instants.
    penetration : float
        Largest -u in m.
    energy_balance : float
        Largest |E(t) - E(0) - work of loads and contacts + dissipation| in J. With the θ-method it is what the method
        itself adds or takes, zero to rounding for θ = 1/2 and linear springs. NaN for a system that is given directly,
        which has no energy to balance.
    energy_scale : float
        Largest size of the stored energy in the run in J, to compare with.
    """

    residual: float
    complementarity: float
    penetration: float
    energy_balance: float
    energy_scale: float


@dataclass(frozen=True, eq=False)
class Pieces:
    """The pieces of a motion between cuts (nk,), and integrals over them by Gauss's rule."""

    cuts: Array

    @property
    def times(self) -> Array:
        """The nodes of the rule, in the order of time (nt,)."""
        half = 0.5 * np.diff(self.cuts)
        return np.asarray(((self.cuts[:-1] + half)[:, None] + half[:, None] * GAUSS_NODES).ravel())

    def integral(self, values: Array) -> Array:
        """Return the integral of values (nt, ...) at the nodes from the first cut to each (nk, ...)."""
        inner = np.asarray(values).reshape(len(self.cuts) - 1, len(GAUSS_NODES), *values.shape[1:])
        pieces = np.einsum("kg...,g,k->k...", inner, GAUSS_WEIGHTS, 0.5 * np.diff(self.cuts))
        return np.concatenate([np.zeros((1, *values.shape[1:])), np.cumsum(pieces, axis=0)])


@compiled(f8(matrix, matrix, i8, vector))
def power_law(N: Array, springs: Array, a: int, q: Array) -> float:
    """Return the energy K δⁿ⁺¹/(n + 1) of one non-linear spring."""
    gap, K, n, _, _ = springs[a]
    δ = -gap
    for j in range(len(q)):
        δ -= N[a, j] * q[j]
    return float(K * max(δ, 0.0) ** (n + 1.0) / (n + 1.0))


@compiled(
    types.UniTuple(f8, 4)(
        vector, matrix, matrix, matrix, matrix, f8, matrix, matrix, matrix, matrix, matrix, vector, vector, vector,
        indices, types.boolean[::1], matrix, matrix,
    )
)  # fmt: skip
def certify_steps(
    t: Array,
    q: Array,
    v: Array,
    r: Array,
    f: Array,
    θ: float,
    M: Array,
    C: Array,
    K: Array,
    H: Array,
    D: Array,
    u0: Array,
    e: Array,
    r_max: Array,
    degree: Indices,
    driven: Flags,
    N: Array,
    springs: Array,
) -> tuple[float, float, float, float]:
    """Return complementarity, penetration, energy balance and scale of a run whose reactions belong to its steps.

    The work of a step is h w·(f_θ + Hᵀ r - C w) with w = (q⁺ - q)/h, which is what the θ-method balances; on a node whose
    motion is given the force that drives it balances the others, and leaves K q_θ - s.
    """
    n, nc, ns = q.shape[1], len(u0), len(springs)
    complementarity, penetration, balance, worst, scale = 0.0, 0.0, 0.0, 0.0, 0.0
    direct = np.zeros(nc, np.bool_)
    for i in range(nc):
        for j in range(nc):
            direct[i] |= D[i, j] != 0.0
    stored = 0.0
    for i in range(n):
        for j in range(n):
            stored += 0.5 * (v[0, i] * M[i, j] * v[0, j] + q[0, i] * K[i, j] * q[0, j])
    for a in range(ns):
        stored += power_law(N, springs, a, q[0])
    scale = abs(stored)
    for k in range(len(t) - 1):
        h = t[k + 1] - t[k]
        power = 0.0
        for i in range(nc):
            u, U, U_before, W = u0[i], 0.0, 0.0, 0.0
            for j in range(n):
                u += H[i, j] * q[k + 1, j]
                W += H[i, j] * (q[k + 1, j] - q[k, j]) / h
                if driven[j]:
                    power -= r[k, i] * H[i, j] * (q[k + 1, j] - q[k, j]) / h
                if degree[i] == 2:
                    U += H[i, j] * v[k + 1, j]
                    U_before += H[i, j] * v[k, j]
            power += r[k, i] * W
            if direct[i]:
                u -= (1.0 - θ) * h * W
                for j in range(nc):
                    u += D[i, j] * r[k, j]
            if r_max[i] < np.inf:
                U = U if degree[i] == 2 else W
                product = h * (r_max[i] * abs(U) + r[k, i] * U)
            else:
                penetration = max(penetration, -u)
                product = h * r[k, i] * (U + e[i] * U_before) if degree[i] == 2 else r[k, i] * u
            complementarity = max(complementarity, abs(product))
        after = 0.0
        for i in range(n):
            w = (q[k + 1, i] - q[k, i]) / h
            inertia, elastic, damping, elastic_θ = 0.0, 0.0, 0.0, 0.0
            for j in range(n):
                inertia += M[i, j] * v[k + 1, j]
                elastic += K[i, j] * q[k + 1, j]
                damping += C[i, j] * (q[k + 1, j] - q[k, j])
                if driven[i]:
                    elastic_θ += K[i, j] * ((1.0 - θ) * q[k, j] + θ * q[k + 1, j])
            if driven[i]:
                power += w * elastic_θ
            else:
                load = f[0, i] if len(f) == 1 else (1.0 - θ) * f[k, i] + θ * f[k + 1, i]
                power += w * (load - damping / h)
            after += 0.5 * (v[k + 1, i] * inertia + q[k + 1, i] * elastic)
        for a in range(ns):
            δ, rate = -springs[a, 0], 0.0
            for j in range(n):
                w = (q[k + 1, j] - q[k, j]) / h
                δ -= N[a, j] * (q[k, j] + θ * h * w)
                rate -= N[a, j] * w
            force, _, _ = push(springs[a], δ, -rate, h)
            power -= (force - springs[a, 1] * max(δ, 0.0) ** springs[a, 2]) * rate
            for j in range(n):
                if driven[j]:
                    power -= N[a, j] * force * (q[k + 1, j] - q[k, j]) / h
            after += power_law(N, springs, a, q[k + 1])
        balance += after - stored - h * power
        worst = max(worst, abs(balance))
        stored = after
        scale = max(scale, abs(stored))
    return complementarity, penetration, worst, scale


def certify(
    dynamics: Dynamics, record: Record, dense: Dense | None, events: Sequence[Event], θ: float | None
) -> Certificate:
    """Judge a run from its record.

    Parameters
    ----------
    dynamics : Dynamics
        The scheme.
    record : Record
        What was recorded.
    dense : callable or None
        The solution as a function of time, where the method has one: then work is integrated by Gauss's rule.
    events : sequence of Event
        Impacts, whose loss of energy counts as work of the contact.
    θ : float or None
        Where in a step its forces balance, for methods that balance them at one instant.
    """
    residual = float(record.stats.get("residual", 0.0))
    d = dynamics
    if θ is not None:
        f = d.force(np.zeros(1) if d.constant_loads else record.t)
        M, C, K, H, D = (np.array(a, order="C") for a in (d.M, d.C, d.K, d.H, d.D))
        complementarity, penetration, balance, scale = certify_steps(
            record.t, record.q, record.v, record.reaction, f, θ, M, C, K, H, D, d.u0.copy(), d.restitution, d.r_max,
            d.relative_degree, d.driven, d.directions, d.power_laws,
        )  # fmt: skip
    else:
        r = record.reaction
        q, v = (record.q, record.v) if len(r) == len(record.q) else (record.q[1:], 0.5 * (record.v[1:] + record.v[:-1]))
        u, U = d.gap(q) + r @ d.D.T, d.gap_rate(v)
        balance = _balance_by_gauss(d, dense, events) if dense else _balance_by_trapezoid(d, record, events)
        products = np.abs(r * u)[:, (d.relative_degree < 2) & ~d.slides]
        friction = np.abs(d.r_max[d.slides] * np.abs(U[:, d.slides]) + (r * U)[:, d.slides])
        complementarity = max(products.max(initial=0.0), friction.max(initial=0.0))
        penetration = max(0.0, (-u)[:, ~d.slides].max(initial=0.0))
        scale = np.abs(d.energy(record.q, record.v)).max()
    if not d.stores_energy:
        balance = scale = np.nan
    return Certificate(residual, float(complementarity), float(penetration), float(balance), float(scale))


def _contact_power(dynamics: Dynamics, t: Array, q: Array, v: Array, r: Array) -> Array:
    """Return the power in W that sliders and driven nodes take and give; unilateral contacts have none but in impacts."""
    friction = (r * dynamics.gap_rate(v))[..., dynamics.slides].sum(axis=-1)
    return np.asarray(friction + dynamics.driving_power(t, q, v, r))


def _balance_by_trapezoid(dynamics: Dynamics, record: Record, events: Sequence[Event]) -> float:
    """Return the largest |E(t) - E(0) - work| with the power of the record integrated from point to point.

    What a step that holds an impact changes is the work of its contact: in it, force and velocity make no power.
    """
    h, U = np.diff(record.t), dynamics.gap_rate(record.v)
    power = dynamics.load_power(record.t, record.v) - dynamics.dissipated_power(record.q, record.v)
    r = record.reaction
    if len(r) == len(record.t):
        power += (r * U).sum(axis=1) + dynamics.driving_power(record.t, record.q, record.v, r)
    work = 0.5 * (power[1:] + power[:-1]) * h
    if len(r) < len(record.t):
        t, q, v = (0.5 * (each[1:] + each[:-1]) for each in (record.t, record.q, record.v))
        work += h * ((r * dynamics.gap_rate(v)).sum(axis=1) + dynamics.driving_power(t, q, v, r))
    stored = dynamics.energy(record.q, record.v)
    change = np.diff(stored)
    for event in events:
        if event.impulse > 0.0 and len(h):
            step = min(int(np.searchsorted(record.t, event.t, side="right")), len(h)) - 1
            work[max(step - 1, 0) : step + 2] = change[max(step - 1, 0) : step + 2]
    return float(np.abs(np.cumsum(change - work)).max(initial=0.0))


def _balance_by_gauss(dynamics: Dynamics, dense: Dense, events: Sequence[Event]) -> float:
    """Return the largest |E(t) - E(0) - work| over the cuts of the solution, with the power integrated between them."""
    cuts = np.unique(np.concatenate([dense.cuts, [event.t for event in events]]))
    pieces = Pieces(cuts)
    times = pieces.times
    q, v, r = dense.read(times, "right")
    power = dynamics.load_power(times, v) - dynamics.dissipated_power(q, v) + _contact_power(dynamics, times, q, v, r)
    work = pieces.integral(power)
    for t, event in {event.t: event for event in events if event.impulse > 0.0}.items():
        work[cuts >= t] += dynamics.kinetic_energy(event.right.v) - dynamics.kinetic_energy(event.left.v)
    q, v, _ = dense.read(cuts, "right")
    stored = dynamics.energy(q, v)
    # What an impact at the very start takes, it takes before the first of these energies.
    return float(np.abs(stored - stored[0] - (work - work[0])).max())
