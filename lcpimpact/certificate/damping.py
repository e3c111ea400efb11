r"""Velocities that dashpots stop within a step, and that a method keeps or throws back.

In a direction p with C p = λ M p and pᵀ M p = 1, η = pᵀ M v obeys η' = -λ η + p · F with all forces F but those of the
dashpots. So over a step with z = λ h and impulses P

.. math:: |η^+| \le e^{-z} |η| + \frac{1}{λ} \max |p \cdot F| + |p \cdot P| .

The rules of many methods multiply η by about -1 instead, with their balances of momentum and energy closed: to a mean
velocity of zero a dashpot does nothing.

The same holds of the rate δ' at which the ends of a non-linear spring approach, with λ = (∂s/∂δ')/m while it is pressed,
where 1/m = N M⁻¹ Nᵀ for its row N: beside the other forces its own elastic one may part them, by s(δ, 0)/(∂s/∂δ').

A step may hold a whole blow, with the spring open at both its ends. Ends that approach at its beginning part at its end at
most as after a blow of their law (`lcpimpact.scheme.power_law.greatest_rebound`), and by what the other forces add.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from lcpimpact.arrays import Array
from lcpimpact.certificate.energy import impulses_in_steps
from lcpimpact.certificate.laws import forces_on_nodes, impulses_of_breaks
from lcpimpact.certificate.scales import largest_violation
from lcpimpact.integrators.stepping.strong_dashpots import blows, directions, may_damp, none
from lcpimpact.numerics.rounding import EPS
from lcpimpact.record import Event, Record, State
from lcpimpact.scheme.dynamics import Dynamics
from lcpimpact.scheme.power_law import forces, greatest_rebounds, tangents
from lcpimpact.scheme.sparse_dynamics import SparseDynamics

KEPT_RTOL = 0.2
"""Largest excess of |η⁺| relative to the largest |η| of a run: that of θ = 1/2 at z = 3."""

FORCE_FACTOR = 3.0
"""Largest force within a step, relative to the largest at its ends and at those of its neighbours."""


def judge_damping(d: Dynamics, record: Record, events: Sequence[Event]) -> tuple[float, float] | None:
    """Return the largest velocity in m/s that dashpots stop within a step and a run does not, and its limit.

    None if no dashpot stops a mass within a step.
    """
    h = np.diff(record.t)
    linear = may_damp(d, float(h.max()), 0.5)
    if not (linear or d.power_laws[:, 3:5].any()):
        return None
    impulses = np.abs(impulses_in_steps(d, record, events, 1))
    loads = impulses_of_breaks(d, record.t) / h.max()
    found = []

    def greatest(F: Array, π: Array) -> Array:
        """Return the greatest acceleration in each step by forces F on π, by reactions and by breaks of loads."""
        pushing = F, np.abs(record.reaction) @ np.abs(d.B.T @ π), np.abs(loads @ π)
        return np.asarray(FORCE_FACTOR * sum(_around(each, len(h)) for each in pushing))

    def struck(π: Array) -> Array:
        """Return the greatest change of a velocity in each step by impulses."""
        return _around(impulses @ np.abs(d.B.T @ π), len(h))

    def judge(η: Array, λ: Array, F: Array, turned: Array, π: Array, speed: float) -> None:
        force = greatest(np.abs(F), π)
        strong = 0.5 * λ * h > 1.0
        rate = np.where(strong, λ, 1.0)
        kept = np.abs(η[1:]) - np.exp(-λ * h) * np.abs(η[:-1]) - force / rate - turned
        excess = np.where(strong, np.maximum(kept, 0.0), 0.0).max()
        found.append(speed * np.array([excess, KEPT_RTOL * np.abs(η).max()]))

    if linear:
        F = _other_forces(d, record)
        for z, p in directions(d, float(h.max()), 0.5, none(d)):
            π = _transmitted(d, p)
            judge(record.v @ (d.M @ p), np.full(len(h), z / h.max()), F @ π, struck(π), π, float(np.abs(p).max()))
    lossy = np.flatnonzero(mobility := blows(d))
    if len(lossy):
        δ, rate = d.approach(record.q), d.approach_rate(record.v)
        force, _, damping = tangents(d.power_laws, δ, rate)
        lost = force - forces(d.power_laws, δ, np.zeros_like(rate))
        acting = forces_on_nodes(d, record.t, record.q, record.v, None)[1]
        # A plate on a dashpot, whose velocity is a mean of the step, is taken to be at rest.
        plates = ~(d.massive | d.driven)
        rate = d.approach_rate(np.where(plates, 0.0, record.v))
    for i in lossy:
        N = d.directions[i]
        π = _accelerations(d, N)
        F = acting - np.outer(lost[:, i], N)
        turned = struck(π) + _around(np.abs(np.diff(record.v[:, d.driven], axis=0) @ N[d.driven]), len(h))
        if not N[plates].any():
            judge(rate[:, i], damping[:-1, i] * mobility[i], F @ π, turned, π, 1.0)
        others = (acting - np.outer(force[:, i], N)) @ π
        apart, together = (h * greatest(np.maximum(each, 0.0), π) + turned for each in (others, -others))
        before = rate[:-1, i]
        parting = -rate[1:, i]
        met = np.where((before > 0.0) & (parting > 0.0), before + together, 0.0)
        most = apart + greatest_rebounds(d.power_laws[i], np.ascontiguousarray(δ[:-1, i]), met, mobility[i])
        excess = np.maximum(parting - most, 0.0)[met > 0.0].max(initial=0.0)
        found.append(np.array([excess, KEPT_RTOL * np.abs(rate[:, i]).max()]))
    return largest_violation(*np.transpose(found)) if found else None


class StrongDashpots:
    """The masses of a sparse scheme that their own dashpots, none to a massless node, may stop within a step.

    Without the directions p they are judged node by node: C v⁺ is balanced by the other forces and M v', except where a
    step throws back what it should stop: then C v⁺ is larger than M (v⁺ - v)/h by z/2 - 1. Of a body that lags behind by
    M v'/c steps of θ = 1/2 may show none and twice that in turn, so that such a throw is told from z = 8 on.

    Parameters
    ----------
    d : SparseDynamics
    h : float                   the step in s
    """

    def __init__(self, d: SparseDynamics, h: float) -> None:
        sizes = abs(d.C)
        c = np.asarray(sizes.sum(axis=1)).ravel()
        loose = np.asarray(sizes[:, d.kinds.massless].sum(axis=1)).ravel() > 0.0
        self.rows = np.flatnonzero(d.massive & ~loose & (h * c > 2.0 * d.M.diagonal()))
        self.h, self.driven = h, d.driven
        self.c = c[self.rows]
        self.C, self.K = d.C[self.rows], d.K[self.rows]
        self.M = d.M[self.rows]
        self.sizes, self.pushed = sizes[self.rows], abs(d.B[self.rows])

    def velocity_kept(self, before: State, end: State, loads: Array, speed: Array) -> tuple[float, float]:
        """Return the largest velocity in m/s that dashpots stop and a step, with its mean reactions, has kept; its limit.

        The largest ``loads`` and ``speed`` so far are those of all nodes (n,).
        """
        # The rate of a motion may jump at the end of the step: it counts with its limit behind, or its mean before.
        mean = np.where(self.driven, (end.q - before.q) / self.h, end.v)
        force = np.minimum(np.abs(self.C @ end.v), np.abs(self.C @ mean))
        inertia = 2.0 * np.abs(self.M @ (end.v - before.v)) / self.h
        others = (
            FORCE_FACTOR * (np.abs(self.K @ end.q) + loads[self.rows]) + self.pushed @ np.abs(end.reaction) + inertia
        )
        rounding = 64.0 * EPS * (self.sizes @ (np.abs(end.v) + np.abs(end.q) / self.h))
        excess = np.maximum(force - others - rounding, 0.0) / self.c
        # Nobody kept the largest rate of each dashpot: a tenth of the speeds at its ends is little for one that is struck.
        rates = np.maximum(force, 0.1 * (self.sizes @ speed)) / self.c
        return largest_violation(excess, KEPT_RTOL * rates)


def _accelerations(d: Dynamics, F: Array) -> Array:
    """Return M⁻¹ F at the nodes with mass, 0 at others (n,)."""
    found = np.zeros(len(d.nodes))
    found[d.massive] = np.linalg.solve(d.M[np.ix_(d.massive, d.massive)], F[d.massive])
    return found


def _transmitted(d: Dynamics, p: Array) -> Array:
    """Return p with the massless nodes on dashpots, which pass on the forces on them (n,)."""
    E, C = d.decomposition.damped, d.substitute_damping
    return np.asarray(p - E @ np.linalg.solve(E.T @ C @ E, E.T @ C @ p)) if E.size else p


def _around(sizes: Array, steps: int) -> Array:
    """Return the largest of values at the ends of each step and of its neighbours, or in these steps (steps,)."""
    wide = np.pad(sizes, 1) if len(sizes) else np.zeros(steps + 2)
    return np.asarray(sliding_window_view(wide, len(wide) - steps + 1).max(axis=1))


def _other_forces(d: Dynamics, record: Record) -> Array:
    """Return the forces on the nodes but those of dashpots among them and of rows, at all instants (nt, n)."""
    inner = np.where(d.driven, 0.0, record.v)
    return forces_on_nodes(d, record.t, record.q, record.v, None)[1] + inner @ d.C.T
