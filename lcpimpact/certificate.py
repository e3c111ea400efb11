"""The certificate of a run: how far it is from the laws that it should obey, computed from its record alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import types

from lcpimpact.arrays import Array, Indices
from lcpimpact.compiled import compiled, f8, indices, matrix, vector
from lcpimpact.integrators.base import Dense, Event, Record
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
        Largest product in J: r u on rows of relative degree 0 and 1; impulse times U⁺ + e U on rows of degree 2.
    penetration : float
        Largest -u in m.
    energy_balance : float
        Largest |E(t) - E(0) - work of loads and contacts + dissipation| in J. With the θ-method it is what the method
        itself adds or takes, zero to rounding for θ = 1/2.
    energy_scale : float
        Largest stored energy of the run in J, to compare with.
    """

    residual: float
    complementarity: float
    penetration: float
    energy_balance: float
    energy_scale: float


@compiled(
    types.UniTuple(f8, 4)(
        vector, matrix, matrix, matrix, matrix, f8, matrix, matrix, matrix, matrix, vector, vector, indices
    )
)
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
    u0: Array,
    e: Array,
    degree: Indices,
) -> tuple[float, float, float, float]:
    """Return complementarity, penetration, energy balance and scale of a run whose reactions belong to its steps.

    The work of a step is h w·(f_θ + Hᵀ r - C w) with w = (q⁺ - q)/h, which is what the θ-method balances.
    """
    n, nc = q.shape[1], len(u0)
    complementarity, penetration, balance, worst, scale = 0.0, 0.0, 0.0, 0.0, 0.0
    stored = 0.0
    for i in range(n):
        for j in range(n):
            stored += 0.5 * (v[0, i] * M[i, j] * v[0, j] + q[0, i] * K[i, j] * q[0, j])
    scale = stored
    for k in range(len(t) - 1):
        h = t[k + 1] - t[k]
        power = 0.0
        for i in range(nc):
            u, U, U_before, W = u0[i], 0.0, 0.0, 0.0
            for j in range(n):
                u += H[i, j] * q[k + 1, j]
                W += H[i, j] * (q[k + 1, j] - q[k, j]) / h
                if degree[i] == 2:
                    U += H[i, j] * v[k + 1, j]
                    U_before += H[i, j] * v[k, j]
            power += r[k, i] * W
            penetration = max(penetration, -u)
            product = h * r[k, i] * (U + e[i] * U_before) if degree[i] == 2 else r[k, i] * u
            complementarity = max(complementarity, abs(product))
        after = 0.0
        for i in range(n):
            w = (q[k + 1, i] - q[k, i]) / h
            load = f[0, i] if len(f) == 1 else (1.0 - θ) * f[k, i] + θ * f[k + 1, i]
            power += w * load
            inertia, elastic, damping = 0.0, 0.0, 0.0
            for j in range(n):
                inertia += M[i, j] * v[k + 1, j]
                elastic += K[i, j] * q[k + 1, j]
                damping += C[i, j] * (q[k + 1, j] - q[k, j])
            power -= w * damping / h
            after += 0.5 * (v[k + 1, i] * inertia + q[k + 1, i] * elastic)
        balance += after - stored - h * power
        worst = max(worst, abs(balance))
        stored = after
        scale = max(scale, stored)
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
        Where in its step a reaction lives, for methods whose reactions belong to steps.
    """
    residual = float(record.stats.get("residual", 0.0))
    d = dynamics
    if θ is not None:
        f = d.force(np.zeros(1) if d.constant_loads else record.t)
        M, C, K, H, u0, e = (np.array(a, order="C") for a in (d.M, d.C, d.K, d.H, d.u0, d.restitution))
        values = certify_steps(
            record.t, record.q, record.v, record.reaction, f, θ, M, C, K, H, u0, e, d.relative_degree
        )
        return Certificate(residual, *values)
    u = d.gap(record.q)
    stored = d.energy(record.q, record.v)
    balance = _balance_by_gauss(d, dense, events) if dense else _balance_by_trapezoid(d, record)
    products = np.abs(record.reaction * u)[:, d.relative_degree < 2]
    return Certificate(
        residual,
        float(products.max(initial=0.0)),
        float(max(0.0, (-u).max(initial=0.0))),
        balance,
        float(stored.max()),
    )


def _balance_by_trapezoid(dynamics: Dynamics, record: Record) -> float:
    """Return the largest |E(t) - E(0) - work| with the power of the record integrated from point to point."""
    power = dynamics.load_power(record.t, record.v) - dynamics.dissipated_power(record.v)
    power += (record.reaction * dynamics.gap_rate(record.v)).sum(axis=1)
    work = np.cumsum(0.5 * (power[1:] + power[:-1]) * np.diff(record.t))
    stored = dynamics.energy(record.q, record.v)
    return float(np.abs(stored[1:] - stored[0] - work).max(initial=0.0))


def _balance_by_gauss(dynamics: Dynamics, dense: Dense, events: Sequence[Event]) -> float:
    """Return the largest |E(t) - E(0) - work| over the cuts of the solution, with the power integrated between them."""
    cuts = np.unique(np.concatenate([dense.cuts, [event.t for event in events]]))
    half = 0.5 * np.diff(cuts)
    times = (cuts[:-1] + half)[:, None] + half[:, None] * GAUSS_NODES
    _, v, _ = dense.read(times.ravel(), "right")
    power = dynamics.load_power(times.ravel(), v) - dynamics.dissipated_power(v)
    work = np.concatenate([[0.0], np.cumsum((power.reshape(times.shape) * GAUSS_WEIGHTS).sum(axis=1) * half)])
    for t, event in {event.t: event for event in events if event.impulse > 0.0}.items():
        work[cuts >= t] += dynamics.kinetic_energy(event.right.v) - dynamics.kinetic_energy(event.left.v)
    q, v, _ = dense.read(cuts, "right")
    stored = dynamics.energy(q, v)
    return float(np.abs(stored - stored[0] - work).max())
