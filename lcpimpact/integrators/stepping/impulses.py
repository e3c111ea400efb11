r"""Impulses of a step apart from its forces, of all contacts that take part in an impact, closed before it or not.

A step with an impact records for each contact the sum of its impulse P and its force r. The record tells what else acts on
the masses, M Δv - Hᵀ (P + h r) = h F. So the two are found one after the other: first Newton's law of impact of all closed
and approaching rows from v, then a step from the velocities after it, whose r are the forces,

.. math:: 0 \le P \perp U^+ + e\,U \ge 0, \quad U^+ = U + W P, \qquad
          0 \le r \perp U^+ + h H M^{-1} F + W h r \ge 0, \qquad W = H M^{-1} H^T .

Friction and joints have their own laws in both. The contacts of an impulse path over massless nodes are one row (see
`lcpimpact.hybrid.impact_law`). The impulse of a contact is what its force leaves of the recorded sum, so that momentum
balances to rounding whatever the method is, and a contact that the impact does not reach keeps its force.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lcpimpact.arrays import Array, Flags, Indices
from lcpimpact.hybrid.impact_law import restitution
from lcpimpact.lcp.friction import GLOCKER, FrictionRows, friction_maps
from lcpimpact.lcp.solve import solve_lcp
from lcpimpact.memo import once
from lcpimpact.scheme.dynamics import Dynamics

REDUNDANT_RTOL = 1e-10
"""Weight, relative to W, by which the impulses of redundant contacts are shared as the step has shared them."""


class Blow(NamedTuple):
    """A step, or the steps over which a method spreads an impact.

    Attributes
    ----------
    before, after : (n,)    v at their ends
    jump : (n,) array       jumps of the velocities of prescribed motions within them
    total : (nc,) array     impulses of the reactions, with those of their forces
    struck : (nc,) flags    rows whose whole sum is an impulse
    """

    before: Array
    after: Array
    jump: Array
    total: Array
    struck: Flags


class ImpactRows(NamedTuple):
    """The rows that transmit impulses: contacts, friction and joints between masses, and impulse paths.

    Attributes
    ----------
    D : (m, nc) array           the reactions of each row, D H v its rate
    W : (m, m) array            rates by impulses
    lines : int                 number of impulse paths, which come last
    contact : (m,) array        the row of the system, -1 of a path
    free : (n,) flags           nodes with mass that move freely
    push : (nf, m) array        velocities of these by impulses
    """

    D: Array
    W: Array
    lines: int
    contact: Indices
    free: Flags
    push: Array


@once
def impact_rows(d: Dynamics) -> ImpactRows:
    """Return the rows of a system that transmit impulses."""
    own = np.flatnonzero(d.impulsive)
    D = np.vstack([np.eye(len(d.contacts))[own], d.impulse_lines])
    free = d.massive & ~d.driven
    M, through = d.M[np.ix_(free, free)], d.B[free] @ D.T
    lumped = np.count_nonzero(M) == len(M)
    push = through / np.diag(M)[:, None] if lumped else np.asarray(np.linalg.solve(M, through), dtype=np.float64)
    contact = np.append(own, np.full(len(d.impulse_lines), -1))
    return ImpactRows(D, D @ d.H[:, free] @ push, len(d.impulse_lines), contact, free, push)


def takes_part(d: Dynamics, closed: Flags) -> Flags:
    """Return the flags (..., nc) of closed contacts that may take part in an impact: between masses, or on a closed path."""
    found = closed & d.rigid
    for line in d.impulse_lines > 0.0:
        found |= line & closed[..., line].all(axis=-1, keepdims=True)
    return found


@once
def own_compliances(d: Dynamics) -> Array:
    """Return the change of the rate of each row by an impulse of its own, W_ii; 0 of rows without impulses (nc,)."""
    rows, found = impact_rows(d), np.zeros(len(d.contacts))
    single = np.flatnonzero(rows.contact >= 0)
    found[rows.contact[single]] = np.diag(rows.W)[single]
    return found


def smooth_change(d: Dynamics, before: Array, after: Array, total: Array) -> Array:
    """Return the change of v (n,) that forces and motions alone account for in a step with recorded impulses (nc,)."""
    rows = impact_rows(d)
    return _smooth_change(d, before, after, rows.push @ _totals(d, rows, total)[0])


def _smooth_change(d: Dynamics, before: Array, after: Array, pushed: Array) -> Array:
    """Return the change of v (n,) without the velocities ``pushed`` (nf,) by impulses; 0 of massless nodes."""
    change = np.where(d.massive | d.driven, after - before, 0.0)
    free = impact_rows(d).free
    change[free] -= pushed
    return change


def separate(d: Dynamics, blow: Blow, *, takes_part_rtol: float = 1e-8, force_rtol: float = 1e-12) -> Array:
    """Return the impulses (nc,) of rows that are not ``struck`` in steps with an impact; the rest is due to their forces.

    ``takes_part_rtol``: impulse, relative to the largest of an impact and its step, below which a contact takes no
    part in it.
    ``force_rtol``: impulse of a force in a step, relative to the largest recorded in it, below which it is
    rounding.
    """
    impulses, all_rows = np.zeros(len(d.contacts)), impact_rows(d)
    Y, chosen = _totals(d, all_rows, blow.total)
    rows = np.flatnonzero(chosen)
    D = all_rows.D[rows]
    W = all_rows.W[np.ix_(rows, rows)]
    contact = all_rows.contact[rows]
    Y, single = Y[rows], contact >= 0
    U = d.H @ blow.before + d.chi
    jump, rate = D @ (d.H @ blow.jump), D @ U
    bounce = np.where(d.one_sided, np.minimum(U, 0.0), U) * d.restitution * ~d.bilateral
    back = D @ bounce
    back[~single] = restitution(D[~single], U, d.restitution)
    law = _Law(d, W, contact)
    smooth = _smooth_change(d, blow.before + blow.jump, blow.after, all_rows.push[:, rows] @ Y)
    P = law.solve(rate + jump + back, rate, Y)
    after = rate + jump + W @ P if P is not None else rate
    forces = None if P is None else law.solve(after + D @ (d.H @ smooth), after, Y - P)
    if P is None or forces is None:
        return impulses
    pushes, joins = law.pushes, single & d.bilateral[contact]
    forces = np.where(pushes, np.clip(forces, 0.0, np.maximum(Y, 0.0)), forces)
    forces[np.abs(forces) <= force_rtol * np.abs(Y).max(initial=0.0)] = 0.0
    taken = Y - forces
    least = takes_part_rtol * np.abs([P, Y]).max(initial=0.0)
    taken[np.minimum(np.abs(P), np.abs(taken)) <= least] = 0.0
    impulses = D[pushes | joins].T @ taken[pushes | joins]
    impulses = np.where(d.one_sided, np.minimum(impulses, blow.total), impulses)
    for k, n in zip(law.rubs, law.normals, strict=True):
        # Friction follows its law in the impact, as far as the rest obeys that of the force.
        t, normal = contact[k], contact[n]
        T = blow.total[t]
        N = blow.total[normal]
        wanted = P[k] * impulses[normal] / P[n] if P[n] > 0.0 else 0.0
        mu = d.mu_s[t] if abs(T) > d.mu[t] * N else d.mu[t]
        struck = mu * impulses[normal]
        loaded = mu * (N - impulses[normal])
        least = max(-struck, T - loaded)
        impulses[t] = np.clip(wanted, least, max(min(struck, T + loaded), least))
    # Friction under a contact that only a path makes transmit impulses follows its normal force.
    loaded = d.tangential & ~np.isin(np.arange(len(impulses)), contact) & (impulses[d.normals] > 0.0)
    impulses[loaded] = (blow.total * impulses[d.normals] / blow.total[d.normals])[loaded] if loaded.any() else 0.0
    return np.where(blow.struck, 0.0, impulses)


def _totals(d: Dynamics, rows: ImpactRows, total: Array) -> tuple[Array, Flags]:
    """Return the recorded impulse of each row, and which rows are closed (m,)."""
    own = rows.contact[: len(rows.contact) - rows.lines]
    rubs = d.tangential[own] & np.isin(d.normals[own], own) & (total[d.normals[own]] > 0.0)
    closed = np.where(d.impenetrable[own], total[own] > 0.0, d.permanent[own] | rubs)
    Y, left = [total[own]], total.copy()
    for line in rows.D[len(own) :]:
        on = line > 0.0
        through = max(float((left[on] / line[on]).min()), 0.0)
        left -= through * line
        Y.append(np.array([through]))
        closed = np.append(closed, through > 0.0)
    return np.concatenate(Y), np.asarray(closed, dtype=np.bool_)


class _Law:
    """The laws of some rows in an impact or a step: contacts push, friction is bounded by them, joints hold."""

    def __init__(self, d: Dynamics, W: Array, contact: Indices) -> None:
        self.d = d
        self.W = W
        self.contact = contact
        self.pushes = (contact < 0) | d.one_sided[contact]
        place = np.full(len(d.contacts) + 1, -1)
        place[contact[contact >= 0]] = np.flatnonzero(contact >= 0)
        self.rubs = np.flatnonzero((contact >= 0) & d.tangential[contact])
        self.normals = place[d.normals[contact[self.rubs]]]
        self.low = np.where(self.pushes, 0.0, -np.inf)
        self.redundant = len(W) > 1 and np.linalg.matrix_rank(W, tol=REDUNDANT_RTOL * np.abs(W).max()) < len(W)

    def solve(self, q: Array, rate: Array, target: Array, *, at_rest_rtol: float = 1e-9) -> Array | None:
        """Return impulses P with W P + q complementary to them, of redundant rows those nearest to the target.

        Rows with friction at whose ``rate`` surfaces stick have static friction. None if no solution is found.

        ``at_rest_rtol``: slip rate, relative to the fastest row, below which surfaces stick.
        """
        W, at = self.W, self.contact[self.rubs]
        if not np.isfinite(q).all():
            return None
        if self.redundant:
            more = REDUNDANT_RTOL * np.diag(W)
            W, q = W + np.diag(more), q - more * target
        high = np.full(len(W), np.inf)
        if not len(self.rubs):
            found = solve_lcp(W, q, lower=self.low, upper=high, throw=False)
            return found.z if found.success else None
        sticks = np.abs(rate[self.rubs]) <= at_rest_rtol * np.abs(rate).max()
        mu = np.where(sticks, self.d.mu_s[at], self.d.mu[at])
        maps = friction_maps(W, self.low, high, FrictionRows(self.rubs, self.normals, mu, GLOCKER))
        found = solve_lcp(maps.E @ W @ maps.T + maps.V, maps.E @ q, lower=maps.lower, upper=maps.upper, throw=False)
        return np.asarray(maps.T @ found.z) if found.success else None
