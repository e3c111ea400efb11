"""Violation of the impact law, from the limits before and after each impact and its impulses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from lcpimpact.arrays import Array, Indices
from lcpimpact.certificate.multiple_impacts import rates_after
from lcpimpact.events import steps_of
from lcpimpact.memo import once
from lcpimpact.numerics.rounding import EPS
from lcpimpact.record import SLIP_RTOL, Event, Record
from lcpimpact.scheme.dynamics import Dynamics
from lcpimpact.scheme.impact_laws import LZB

EIGENVALUE_ROUNDING = 64.0 * EPS
"""Rounding error of an eigenvalue, per row of the matrix and relative to its largest entry."""


def rows_by_name(d: Dynamics) -> dict[str, int]:
    """Return the index of each row by its name."""
    return {contact.name: i for i, contact in enumerate(d.contacts)}


def largest_impulses(d: Dynamics, events: Sequence[Event]) -> Array:
    """Return the largest impulse of each row in N s (nc,)."""
    P = np.zeros(len(d.contacts))
    rows = rows_by_name(d)
    for event in events:
        if event.impulse:
            P[rows[event.contact]] = max(P[rows[event.contact]], abs(event.impulse))
    return P


@dataclass(frozen=True, eq=False)
class RunImpacts:
    """The impacts of a run; simultaneous ones are merged.

    Attributes
    ----------
    t : (ni,) array                 instants
    q, before, after : (ni, n)      positions, and the left and right limits of the velocities
    P : (ni, nc)                    the impulses
    """

    t: Array
    q: Array
    before: Array
    after: Array
    P: Array

    @classmethod
    def of(cls, d: Dynamics, events: Sequence[Event]) -> RunImpacts:
        """Return the impacts of a list of events; events with common limits are merged."""
        rows, n = rows_by_name(d), len(d.nodes)
        struck = [event for event in events if event.impulse != 0.0]
        if not struck:
            none = np.zeros((0, n))
            return cls(np.zeros(0), none, none, none, np.zeros((0, len(rows))))
        limits = [(event.t, event.left.v.tobytes(), event.right.v.tobytes()) for event in struck]
        first = [k for k, each in enumerate(limits) if k == 0 or each != limits[k - 1]]
        P = np.zeros((len(first), len(d.contacts)))
        one = np.searchsorted(first, np.arange(len(struck)), side="right") - 1
        row = np.array([rows[event.contact] for event in struck], dtype=np.int64)
        np.add.at(P, (one, row), [event.impulse for event in struck])
        t = np.array([struck[k].t for k in first])
        q, before, after = (
            np.array([getattr(getattr(struck[k], side), name) for k in first]).reshape(-1, n)
            for side, name in (("left", "q"), ("left", "v"), ("right", "v"))
        )
        return cls(t, q, before, after, P)

    @classmethod
    def of_steps(cls, d: Dynamics, record: Record, events: Sequence[Event], spread: int) -> RunImpacts:
        """Return the impacts of a record whose reactions belong to steps; those that begin in one step are merged.

        The impulses are those of the step, or of the ``spread`` steps over which an impact spreads, with those of contacts
        between masses that rest or slide in it.
        """
        struck = [event for event in events if event.impulse != 0.0]
        rows = rows_by_name(d)
        hit, first, one = np.unique(
            steps_of(struck, record.t, record.q, record.v), return_index=True, return_inverse=True
        )
        h = np.diff(record.t)
        last = np.minimum(hit + spread, len(record.t) - 1)
        P = np.zeros((len(hit), len(rows)))
        takes_up = d.impulsive | (d.impulse_lines != 0.0).any(axis=0)
        for k in range(spread):
            within = hit + k < len(h)
            P[within] += h[hit[within] + k, None] * record.reaction[hit[within] + k] * takes_up
        row = np.array([rows[event.contact] for event in struck], dtype=np.int64)
        np.add.at(P, (one, row), [event.impulse for event in struck])
        t = np.array([struck[k].t for k in first])
        return cls(t, record.q[hit], record.v[hit], record.v[last], P)

    def steps(self, t: Array) -> Indices:
        """Return the step of the grid t that contains each impact; an impact at a grid point belongs to the step before."""
        return np.clip(np.searchsorted(t, self.t) - 1, 0, len(t) - 2)

    def __getitem__(self, chosen: Any) -> RunImpacts:
        """Return a subset of the impacts."""
        return RunImpacts(self.t[chosen], self.q[chosen], self.before[chosen], self.after[chosen], self.P[chosen])


def struck_by(d: Dynamics, R: Array) -> Array:
    """Return L⁻¹ Hᵀ Rᵀ of combinations R (k, nc) of the rows, with the joints held: √M v of unit impulses (nm, k).

    L is the Cholesky factor of the masses; with their square roots, a diagonal M has it too.
    """
    return np.asarray(_by_unit_impulses(d) @ R.T)


@once
def _by_unit_impulses(d: Dynamics) -> Array:
    """Return L⁻¹ Hᵀ with the joints held (nm, nc)."""
    massive = d.massive
    M = d.M[np.ix_(massive, massive)]
    joints = d.bilateral & (d.relative_degree == 2)
    if np.count_nonzero(M) == len(M):
        X = d.H[:, massive].T / np.sqrt(np.diag(M))[:, None]
    else:
        X = np.linalg.solve(np.linalg.cholesky(M), d.H[:, massive].T)
    if joints.any():
        Q, size, _ = np.linalg.svd(X[:, joints], full_matrices=False)
        Q = Q[:, size > EIGENVALUE_ROUNDING * len(X) * size.max(initial=0.0)]
        X = X - Q @ (Q.T @ X)
    return np.asarray(X)


def impact_law(d: Dynamics, impacts: RunImpacts, touch: Array) -> Array:
    """Return the violation of the impact law in m/s of each row and impact (ni, nc); rows with u <= ``touch`` are closed.

    The velocities of massless nodes after an impact are no states: those that fit the law best are used.
    """
    before = d.gap_rate(impacts.t, impacts.q, impacts.before)
    after = d.gap_rate(impacts.t, impacts.q, impacts.after)
    P = impacts.P
    e = d.restitution
    struck, off = P != 0.0, after + e * before
    # A contact that opens already, and is held back by another, may part at any greater rate.
    off = np.where(d.one_sided & (before > 0.0) & (np.abs(after) < np.abs(off)), after, off)
    free = d.H[:, ~d.massive & ~d.driven]
    for k in np.flatnonzero((struck & free.any(axis=1)).any(axis=1)):
        rows = struck[k]
        off[k, rows] -= free[rows] @ np.linalg.lstsq(free[rows], off[k, rows], rcond=None)[0]
    violation = np.where(struck, np.abs(off), 0.0)
    pulls = d.one_sided & (P < 0.0)
    violation = np.where(pulls, np.maximum(violation, np.abs(after - before)), violation)
    if d.tangential.any():
        bounds, holds = d.friction_bounds(P), d.holding_bounds(P)
        beyond = np.abs(P) > holds * (1.0 + SLIP_RTOL)
        sticks = ~beyond & (np.abs(np.abs(P) - bounds) > SLIP_RTOL * bounds)
        missing = np.where(sticks, np.abs(off), np.maximum(0.0, off * np.sign(P)))
        missing = np.where(beyond, np.maximum(missing, np.abs(after - before)), missing)
        violation = np.where(d.tangential, np.where(bounds > 0.0, missing, violation), violation)
    violation = np.where(d.bilateral, np.abs(after), violation)
    closed = d.of_rate | (d.gap(impacts.t, impacts.q) <= touch)
    idle = ~struck & d.one_sided & closed & ~free.any(axis=1)
    violation = np.where(idle, np.maximum(0.0, -(after + e * np.minimum(before, 0.0))), violation)
    return _by_other_law(d, impacts, (before, after), touch, violation) if d.has_other_impact_law else violation


def _by_other_law(
    d: Dynamics,
    impacts: RunImpacts,
    rates: tuple[Array, Array],
    touch: Array,
    newton: Array,
    *,
    met_rtol: float = 1e-9,
    springs_rtol: float = 1e-10,
) -> Array:
    """Return the violation by another law than Newton's in m/s (ni, nc), where impacts have several closed contacts.

    Whether a gap within rounding is closed the law itself decides: of the contacts with the smallest gaps as many take part
    as fit it best.

    ``met_rtol``: violation, relative to the rates before an impact, at which no other contacts are tried.
    ``springs_rtol``: error of springs that are integrated, relative to the terms of a rate.
    """
    law, violation = d.impact_law, newton.copy()
    rtol = springs_rtol if isinstance(law, LZB) else 64.0 * EPS
    given = law.stiffness if isinstance(law, LZB) else {}
    k = np.array([given.get(each.name, 1.0) for each in d.contacts])
    X = struck_by(d, np.eye(len(d.contacts)))
    for j, (u, P, U, after) in enumerate(zip(d.gap(impacts.t, impacts.q), impacts.P, *rates, strict=True)):
        surely = d.rigid & ((P != 0.0) | (u <= touch))
        perhaps = np.flatnonzero(d.rigid & ~surely & (u <= np.abs(touch)))
        perhaps = perhaps[np.argsort(u[perhaps])]
        best = newton[j].max() if np.count_nonzero(surely) < 2 else np.inf
        for count in range(len(perhaps) + 1):
            rows = np.append(np.flatnonzero(surely), perhaps[:count])
            if best <= met_rtol * np.abs(U[rows]).max(initial=0.0):
                break
            if len(rows) < 2:
                continue
            off = np.abs(after[rows] - rates_after(law, X[:, rows], U[rows], d.restitution[rows], P[rows], k[rows]))
            # Impulses through a light body have the rounding of floats.
            size = np.abs(X[:, rows])
            off = np.maximum(off - rtol * (size.T @ (size @ np.abs(P[rows]))), 0.0)
            off = np.where(P[rows] < 0.0, np.maximum(off, np.abs(after - U)[rows]), off)
            worst = np.inf if np.isnan(off).any() else float(off.max())
            if worst < best or count == 0:
                best = worst
                violation[j] = np.where(d.one_sided & (u <= touch), np.maximum(0.0, -after), 0.0)
                violation[j, rows] = off
    return violation


def judge_impacts(d: Dynamics, impacts: RunImpacts, touch: Array, shortest: float = 0.0) -> tuple[Array, Array]:
    """Return the largest violation of the impact law and product of each row (nc,).

    A row that was open for less than ``shortest`` may stay closed, which ends an accumulation of impacts.
    """
    if not len(impacts.t):
        return np.zeros(len(d.contacts)), np.zeros(len(d.contacts))
    violation = impact_law(d, impacts, touch)
    count = np.arange(len(impacts.t))
    flown = np.full(violation.shape, np.inf)
    for i in range(len(d.contacts)):
        struck = np.flatnonzero(impacts.P[:, i])
        last = np.searchsorted(struck, count) - 1
        flown[last >= 0, i] = (impacts.t - impacts.t[struck[last]])[last >= 0] if len(struck) else 0.0
    ends = flown < shortest
    violation = np.where(
        ends, np.minimum(violation, np.abs(d.gap_rate(impacts.t, impacts.q, impacts.after))), violation
    )
    return violation.max(axis=0, initial=0.0), (np.abs(impacts.P) * violation).max(axis=0, initial=0.0)
