r"""Velocities that dashpots stop within a step, and that a method keeps or throws back.

In a direction p with C p = λ M p and pᵀ M p = 1, η = pᵀ M v obeys η' = -λ η + p · F with all forces F but those of the
dashpots. So over a step with z = λ h and impulses P

.. math:: |η^+| \le e^{-z} |η| + \frac{1}{λ} \max |p \cdot F| + |p \cdot P| .

The rules of many methods multiply η by about -1 instead, with their balances of momentum and energy closed: to a mean
velocity of zero a dashpot does nothing.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from lcpimpact.arrays import Array
from lcpimpact.certificate.impacts import rows_by_name
from lcpimpact.certificate.laws import forces_on_nodes, impulses_of_breaks
from lcpimpact.certificate.scales import largest_violation
from lcpimpact.events import steps_of
from lcpimpact.integrators.stepping.strong_dashpots import directions, may_damp, none
from lcpimpact.record import Event, Record
from lcpimpact.scheme.dynamics import Dynamics

KEPT_RTOL = 0.2
"""Largest excess of |η⁺| relative to the largest |η| of a run: that of θ = 1/2 at z = 3."""

FORCE_FACTOR = 3.0
"""What a force of a step may exceed those at its ends by, or at the ends of its neighbours."""


def judge_damping(d: Dynamics, record: Record, events: Sequence[Event]) -> tuple[float, float] | None:
    """Return the largest velocity in m/s that dashpots stop within a step and a run does not, and its limit.

    None if no dashpot stops a mass within a step.
    """
    h = np.diff(record.t)
    if not may_damp(d, float(h.max()), 0.5):
        return None
    F, P = _other_forces(d, record), _impulses(d, record, events)
    loads = impulses_of_breaks(d, record.t) / h.max()
    found = []
    for z, p in directions(d, float(h.max()), 0.5, none(d)):
        λ = z / h.max()
        η = record.v @ (d.M @ p)
        π = _transmitted(d, p)
        push = np.abs(d.B.T @ π)
        forces = np.abs(F @ π), np.abs(record.reaction) @ push, np.abs(loads @ π)
        force = FORCE_FACTOR * sum(_around(each, len(h)) for each in forces)
        kept = np.abs(η[1:]) - np.exp(-λ * h) * np.abs(η[:-1]) - force / λ - _around(P @ push, len(h))
        found.append(np.abs(p).max() * np.array([max(kept.max(), 0.0), KEPT_RTOL * np.abs(η).max()]))
    return largest_violation(*np.transpose(found))


def _transmitted(d: Dynamics, p: Array) -> Array:
    """Return p with the massless nodes on dashpots, which pass on the forces on them (n,)."""
    E = d.decomposition.damped
    return np.asarray(p - E @ np.linalg.solve(E.T @ d.C @ E, E.T @ d.C @ p)) if E.size else p


def _around(sizes: Array, steps: int) -> Array:
    """Return the largest of values at the ends of each step and of its neighbours, or in these steps (steps,)."""
    wide = np.pad(sizes, 1) if len(sizes) else np.zeros(steps + 2)
    return np.asarray(sliding_window_view(wide, len(wide) - steps + 1).max(axis=1))


def _other_forces(d: Dynamics, record: Record) -> Array:
    """Return the forces on the nodes but those of dashpots among them and of rows, at all instants (nt, n)."""
    inner = np.where(d.driven, 0.0, record.v)
    return forces_on_nodes(d, record.t, record.q, record.v, None)[1] + inner @ d.C.T


def _impulses(d: Dynamics, record: Record, events: Sequence[Event]) -> Array:
    """Return the sums of |P| of each row in the steps (steps, nc)."""
    struck, rows = [event for event in events if event.impulse != 0.0], rows_by_name(d)
    P = np.zeros((len(record.t) - 1, len(d.contacts)))
    steps = steps_of(struck, record.t, record.q, record.v)
    row = np.array([rows[event.contact] for event in struck], dtype=np.int64)
    np.add.at(P, (steps, row), [abs(event.impulse) for event in struck])
    return P
