"""Certificate of a continuous solution, by Gaussian quadrature between its events."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import types

from lcpimpact.arrays import Array, Flags, Indices, inverse
from lcpimpact.certificate.energy import Account, Sinks
from lcpimpact.certificate.impacts import RunImpacts, judge_impacts, largest_impulses
from lcpimpact.certificate.laws import (
    accelerations,
    bound_violation,
    forces_on_nodes,
    friction_residual,
    node_kinds,
    switch_residual,
)
from lcpimpact.certificate.quadrature import Pieces, running_sum
from lcpimpact.certificate.scales import Judgement, Scales, largest_violation
from lcpimpact.certificate.theta_balance import DAMPED, FREE, MASSIVE
from lcpimpact.compiled import compiled, matrix, vector
from lcpimpact.integrators.base import Limits
from lcpimpact.record import ContinuousSolution, Event, Record
from lcpimpact.scheme.dynamics import Dynamics

SUM_RTOL = 64.0 * float(np.finfo(float).eps)
"""Rounding of sums over a run, relative to the largest term."""


@dataclass(frozen=True, eq=False)
class SampledMotion:
    """A continuous solution at the Gauss nodes and on both sides of its cuts.

    Attributes
    ----------
    pieces : Pieces
    resolved : (nk - 1,) array of bool      pieces on which the quadrature resolves the solution
    t, q, v, r : (nt, ...) arrays           at the Gauss nodes
    f, g : (nt, n) arrays                   the loads, and the sum of the forces on each node
    right, left : tuples                    q, v, r after each cut (nk, ...), and q, v before it
    before : tuple                          q and r before each event
    impacts : RunImpacts
    at : (ni,) array                        the cut of each impact
    grid : tuple                            q, v, r at the times of the record, right limits
    """

    pieces: Pieces
    resolved: Flags
    t: Array
    q: Array
    v: Array
    r: Array
    f: Array
    g: Array
    right: tuple[Array, Array, Array]
    left: tuple[Array, Array]
    before: tuple[Array, Array]
    impacts: RunImpacts
    at: Indices
    grid: tuple[Array, Array, Array]

    @classmethod
    def of(
        cls,
        d: Dynamics,
        start: tuple[Array, Array],
        grid: Array,
        dense: ContinuousSolution,
        events: Sequence[Event],
    ) -> SampledMotion:
        """Return the samples up to the end of a run on a grid; ``start`` holds the initial q and v."""
        end = float(grid[-1])
        inside = dense.cuts[dense.cuts <= end]
        pieces = Pieces(np.unique(np.concatenate([inside, [event.t for event in events if event.t <= end], [end]])))
        t, cuts = pieces.times, pieces.cuts
        (q, v, r), right, on_grid = _read_together(dense, (t, cuts, grid))
        q_left, v_left = right[0].copy(), right[1].copy()
        q_left[0], v_left[0] = start if d.stores_energy else (right[0][0], start[1])
        instants, first = np.unique([event.t for event in events], return_index=True)
        for k, one in zip(np.searchsorted(cuts, instants), first, strict=True):
            if 0 < k < len(cuts):
                q_left[k], v_left[k] = events[one].left.q, events[one].left.v
        impacts = RunImpacts.of(d, events)
        impacts = impacts[impacts.t <= end]
        f, g = forces_on_nodes(d, t, q, v, r)
        before = np.array([each.left.q for each in events]), np.array([each.left.reaction for each in events])
        at = np.asarray(np.searchsorted(cuts, impacts.t), dtype=np.int64)
        return cls(
            pieces=pieces, resolved=dense.resolves(cuts), t=t, q=q, v=v, r=r, f=f, g=g,
            right=right, left=(q_left, v_left), before=before, impacts=impacts, at=at, grid=on_grid,
        )  # fmt: skip

    def at_cuts(self, values: Array) -> Array:
        """Return the sum over the impacts at each cut of given values (ni, ...) as an array (nk, ...)."""
        sums = np.zeros((len(self.pieces.cuts), *values.shape[1:]))
        np.add.at(sums, self.at, values)
        return sums

    def imbalance(self, right: Array, left: Array, jumps: Array, rate: Array) -> Array:
        """Return right - left(0) - Σ jumps - ∫ rate dt on both sides of each cut (2 nk, ...).

        Pieces that the quadrature does not resolve are omitted.
        """
        between = (left[1:] - right[:-1]) - self.pieces.each(rate)
        resolved = self.resolved.reshape(-1, *[1] * (between.ndim - 1))
        return running_sum((right - left) - jumps, between * resolved)


def judge_continuous(
    d: Dynamics,
    start: tuple[Array, Array],
    record: Record,
    dense: ContinuousSolution,
    events: Sequence[Event],
    limits: Limits,
) -> tuple[Judgement, Scales, tuple[float, float]]:
    """Judge a continuous solution, piece by piece between its cuts and events."""
    run = SampledMotion.of(d, start, record.t, dense, events)
    q, v, r = (np.concatenate(each) for each in zip((run.q, run.v, run.r), run.right, strict=True))
    h = np.where(run.resolved, run.pieces.lengths, 0.0)
    scales = Scales.of(d, q, np.concatenate([v, run.left[1]]), r, run.f).at_least(float(h.max(initial=0.0)))
    elapsed = SUM_RTOL * np.cumsum(np.append(0.0, h))
    error_p, error_q = (limits.slack * run.pieces.error(each, limits.order) for each in (run.g, run.v))
    momentum, way, energy, energies, power = _imbalances(d, run)
    scale = float(np.abs(energies).max())
    # An energy of large terms that cancel has their rounding error.
    terms = SUM_RTOL * float(scales.forces @ scales.q + scales.momenta @ scales.v)
    allowed_E = limits.precision * scale + terms + elapsed * np.abs(power).max()
    allowed_E += limits.slack * run.pieces.error(power[:, None], limits.order)[:, 0]
    allowed_E += error_p @ scales.v + error_q @ scales.forces
    found = {
        **_judge_nodes(d, run, (momentum, way), scales, limits, elapsed, (error_p, error_q)),
        **_judge_contacts(d, run, scales, limits, largest_impulses(d, events), np.abs(d.H) @ error_q[-1]),
        "energy_balance": largest_violation(np.abs(energy), np.repeat(allowed_E, 2)),
        "sampling": _sampling(record, dense, run.grid, scales, limits.precision),
    }
    return found, scales, (float(np.abs(energy).max()), scale)


def _imbalances(d: Dynamics, run: SampledMotion) -> tuple[Array, Array, Array, Array, Array]:
    """Return the imbalances of momentum (2 nk, n), way (2 nk, n) and energy (2 nk,), the stored energies, and the power."""
    account, n, nk = Account(d, Sinks.all_as_one(d)), len(d.nodes), len(run.pieces.cuts)
    (q, v, _), (q_left, v_left), impacts = run.right, run.left, run.impacts
    stored = account.stored(np.concatenate([q, q_left]), np.concatenate([v, v_left]), q_left[0])
    total = stored.sum(axis=1)[:, None]
    power = account.balance(account.powers_under(run.f, run.q, run.v, run.r))
    gained = account.balance(account.of_impacts(impacts))[:, None]
    off = run.imbalance(
        np.hstack([v @ d.M.T, q, total[:nk]]),
        np.hstack([v_left @ d.M.T, q_left, total[nk:]]),
        run.at_cuts(np.hstack([impacts.P @ d.B.T, np.zeros((len(impacts.t), n)), gained])),
        np.hstack([run.g, run.v, power[:, None]]),
    )
    # An initial jump is judged by the momentum: massless nodes between springs jump to equilibrium.
    energy = np.append(0.0, off[1:, -1] - off[1, -1])
    return off[:, :n], off[:, n:-1], energy, stored[:, :2].sum(axis=1), power


def _judge_nodes(
    d: Dynamics,
    run: SampledMotion,
    imbalances: tuple[Array, Array],
    scales: Scales,
    limits: Limits,
    elapsed: Array,
    errors: tuple[Array, Array],
) -> Judgement:
    """Judge momentum, kinematics, and the balance of massless nodes; the former two by their imbalances (2 nk, n)."""
    ε, kind, forces = limits.precision, node_kinds(d), scales.forces
    momentum, way = imbalances
    allowed_p = np.repeat(ε * scales.momenta + elapsed[:, None] * forces + errors[0], 2, axis=0)
    allowed_q = np.repeat(ε * scales.q + elapsed[:, None] * scales.v + errors[1], 2, axis=0)
    massive, moves, massless = kind == MASSIVE, (kind >= DAMPED) & ~d.jumping, np.isin(kind, (DAMPED, FREE))
    return {
        "momentum": largest_violation(np.abs(momentum[:, massive]), allowed_p[:, massive]),
        "equilibrium": largest_violation(np.abs(run.g[:, massless]).max(axis=0), ε * forces[massless]),
        "kinematics": largest_violation(np.abs(way[:, moves]), allowed_q[:, moves]),
    }


def _judge_contacts(
    d: Dynamics, run: SampledMotion, scales: Scales, limits: Limits, largest: Array, gap_error: Array
) -> Judgement:
    """Judge complementarity, penetration, bounds and the impact law; ``gap_error`` is the error of gaps in m (nc,)."""
    ε, end = limits.precision, float(run.pieces.cuts[-1])
    q_right, _, r_right = run.right
    u, u_right = d.gap(run.q) + run.r @ d.D.T, d.gap(q_right) + r_right @ d.D.T
    product = np.maximum(np.abs(run.r * u).max(axis=0), np.abs(r_right * u_right).max(axis=0))
    friction = np.zeros(len(d.contacts))
    if d.rubs.any():
        friction = np.abs(run.pieces.each(friction_residual(d, run.r, d.gap_rate(run.v)))).max(axis=0)
    # What touches but for rounding may be one of the next instant.
    violation, by_impacts = judge_impacts(d, run.impacts, -ε * scales.u, limits.rest * end)
    slow = ε * scales.U + limits.rest * end * accelerations(d, run.g)
    for path in d.impulse_lines > 0.0:
        slow[path] = np.maximum(slow[path], slow[path].sum())
    one_sided, bounds = d.unilateral, d.friction_bounds(scales.r)
    largest = np.maximum(largest, d.friction_bounds(largest) * d.frictional)
    reach = ε * scales.u + gap_error
    penetration = np.maximum(0.0, -np.minimum(u.min(axis=0), u_right.min(axis=0)))
    penetration = np.where(d.joints, np.maximum(np.abs(u).max(axis=0), np.abs(u_right).max(axis=0)), penetration)
    beyond = np.maximum(bound_violation(d, run.r).max(axis=0), bound_violation(d, r_right).max(axis=0))
    return {
        "complementarity": largest_violation(
            np.maximum(np.where(one_sided, product, friction) + _switch_residuals(d, run, u, u_right), by_impacts),
            np.where(d.relays, d.r_max - d.r_min, scales.r) * reach
            + largest * slow
            + bounds * (gap_error + ε * end * scales.U),
        ),
        "penetration": largest_violation(penetration * (one_sided | d.joints), reach),
        "tension": largest_violation(beyond, ε * (scales.r + bounds * d.frictional)),
        "impact_law": largest_violation(violation, slow),
    }


def _switch_residuals(d: Dynamics, run: SampledMotion, u: Array, u_right: Array) -> Array:
    """Return the largest residual of each relay; zero for other rows (nc,)."""
    if not d.relays.any():
        return np.zeros(len(d.contacts))
    seen = [(run.r, u), (run.right[2], u_right)]
    if len(run.before[0]):
        q_before, r_before = run.before
        seen.append((r_before, d.gap(q_before) + r_before @ d.D.T))
    return np.asarray(np.max([switch_residual(d, *each).max(axis=0) for each in seen], axis=0))


def _read_together(dense: ContinuousSolution, times: Sequence[Array]) -> list[tuple[Array, Array, Array]]:
    """Return q, v and r at each of several series of times, right limits, in one reading."""
    together, ends = np.concatenate(times), np.cumsum([len(each) for each in times])[:-1]
    order = np.argsort(together, kind="stable")
    back = inverse(order)
    q, v, r = (np.split(each.take(back, axis=0), ends) for each in dense.read(together[order], "right"))
    return list(zip(q, v, r, strict=True))


def _sampling(
    record: Record, dense: ContinuousSolution, right: tuple[Array, Array, Array], scales: Scales, ε: float
) -> tuple[float, float]:
    """Return the largest difference of the record from either limit of the continuous solution, relative to each scale.

    ``right`` holds the right limits.
    """
    ours, sizes = (record.q, record.v, record.reaction), (scales.q, scales.v, scales.r)

    def differences(read: tuple[Array, Array, Array]) -> Array:
        largest = np.zeros(len(record.t))
        for mine, theirs, size in zip(ours, read, sizes, strict=True):
            if mine.shape != theirs.shape:
                raise ValueError(f"a record of the shape {mine.shape} for a solution of {theirs.shape}")
            _note_differences(np.ascontiguousarray(mine), np.ascontiguousarray(theirs), size, largest)
        return largest

    largest = differences(right)
    if (largest > ε).any():
        largest = np.minimum(largest, differences(dense.read(record.t, "left")))
    return float(largest.max()), ε


@compiled(types.void(matrix, matrix, vector, vector), allocates=False)
def _note_differences(a: Array, b: Array, size: Array, largest: Array) -> None:
    """Raise ``largest`` (nt,) to |a - b| of each instant (nt, m), relative to the size of each column; NaN is largest."""
    for k in range(len(a)):
        for j in range(len(size)):
            off = abs(a[k, j] - b[k, j])
            if size[j] > 0.0:
                off /= size[j]
            if off > largest[k] or off != off:
                largest[k] = off
