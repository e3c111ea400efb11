"""Certificate of a continuous solution, by Gaussian quadrature between its events."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from lcpimpact.arrays import Array, Axes, Flags, Indices, Vector, largest
from lcpimpact.certificate.balances import imbalances, judged_nodes
from lcpimpact.certificate.energy import Energies, account_of
from lcpimpact.certificate.impacts import RunImpacts, judge_impacts, largest_impulses
from lcpimpact.certificate.laws import (
    accelerations,
    forces_on_nodes,
    judge_rows,
    law_residual,
    moving_accelerations,
    rate_forces,
)
from lcpimpact.certificate.quadrature import SAMPLES, Pieces, interleaved
from lcpimpact.certificate.scales import SCALE_FLOOR, Judgement, Scales, largest_violation, turning_time
from lcpimpact.compiled import compiled
from lcpimpact.integrators.base import Limits
from lcpimpact.numerics.rounding import EPS
from lcpimpact.record import ContinuousSolution, Event, Record
from lcpimpact.scheme.dynamics import Dynamics
from lcpimpact.scheme.lagrangian import LagrangianDynamics

SUM_RTOL = 64.0 * EPS
"""Rounding of sums over a run, relative to the largest term."""


@dataclass(frozen=True, eq=False)
class SampledMotion:
    """A continuous solution at its cuts and at the Gauss nodes between them.

    Attributes
    ----------
    pieces : Pieces
    resolved : (nk - 1,) array of bool      pieces on which the quadrature resolves the solution
    q, v, r : (ns, ...) arrays              at the `Pieces.samples`, right limits
    f, g : (nt, n) arrays                   the loads, and the sum of the forces on each node, at the Gauss nodes
    left : tuple                            q and v before each cut
    impacts : RunImpacts
    at : (ni,) array                        the cut of each impact
    """

    pieces: Pieces
    resolved: Flags
    q: Array
    v: Array
    r: Array
    f: Array
    g: Array
    left: tuple[Array, Array]
    impacts: RunImpacts
    at: Indices

    @classmethod
    def of(
        cls,
        d: Dynamics,
        start: tuple[Array, Array],
        end: float,
        dense: ContinuousSolution,
        events: Sequence[Event],
    ) -> SampledMotion:
        """Return the samples up to the end of a run; ``start`` holds the initial q and v."""
        inside = dense.cuts[dense.cuts <= end]
        events = [event for event in events if event.t <= end]
        pieces = Pieces.between(np.concatenate([inside, [event.t for event in events], [end]]))
        cuts = pieces.cuts
        q, v, r = dense.read(pieces.samples, "right")
        q_left = q[:: SAMPLES - 1].copy()
        v_left = v[:: SAMPLES - 1].copy()
        q_left[0], v_left[0] = start if d.stores_energy else (q[0], start[1])
        first = {event.t: event.left for event in reversed(events)}
        for k, before in zip(cuts.searchsorted(list(first)).tolist(), first.values(), strict=True):
            if 0 < k < len(cuts):
                q_left[k], v_left[k] = before.q, before.v
        impacts = RunImpacts.of(d, events)
        f, g = forces_on_nodes(d, pieces.times, *map(pieces.at_nodes, (q, v, r)))
        return cls(
            pieces=pieces, resolved=dense.resolves(cuts), q=q, v=v, r=r, f=f, g=g, left=(q_left, v_left),
            impacts=impacts, at=np.asarray(cuts.searchsorted(impacts.t), dtype=np.int64),
        )  # fmt: skip

    def at_cuts(self, values: Array) -> Array:
        """Return the sum over the impacts at each cut of given values (ni, ...) as an array (nk, ...)."""
        sums = np.zeros((len(self.pieces.cuts), *values.shape[1:]))
        np.add.at(sums, self.at, values)
        return sums

    def integrals(self, jumps: Array, rate: Array) -> Array:
        """Return the jumps (ni, ...) at each cut, and in turn ∫ rate dt of the piece behind it (2 nk - 1, ...)."""
        return interleaved(self.at_cuts(jumps), self.pieces.each(rate))

    def summed(self, off: Array) -> Array:
        """Return the sums of imbalances (2 nk - 1, m) on both sides of each cut, without unresolved pieces (2 nk, m)."""
        if not self.resolved.all():
            off[1::2] *= self.resolved[:, None]
        return np.concatenate([np.zeros((1, off.shape[1])), np.cumsum(off, axis=0)])


def judge_continuous(
    d: Dynamics,
    start: tuple[Array, Array],
    record: Record,
    dense: ContinuousSolution,
    events: Sequence[Event],
    limits: Limits,
) -> tuple[Judgement, Scales, Energies]:
    """Judge a continuous solution, piece by piece between its cuts and events."""
    run = SampledMotion.of(d, start, float(record.t[-1]), dense, events)
    h = np.where(run.resolved, run.pieces.lengths, 0.0)
    q, v = (np.concatenate(each) for each in zip((run.q, run.v), run.left, strict=True))
    # Pieces of stiff schemes are longer where fast modes rest.
    longest = min(float(h.max(initial=0.0)), turning_time(d))
    if isinstance(d, LagrangianDynamics):
        gained = moving_accelerations(d, run.pieces.samples, run.q, run.v, run.r)
        motion = run.pieces.samples, run.q, run.v
        scales = Scales.of_moving(d, motion, run.r, run.g, longest * largest(gained))
        pulls = np.abs(scales.dynamics.H) @ largest(gained)
    else:
        scales = Scales.of(d, q, v, run.r, run.f).at_least(longest)
        pulls = accelerations(d, run.g)
    elapsed = SUM_RTOL * np.cumsum(np.append(0.0, h))
    error_p, error_q = (
        limits.slack * run.pieces.error(each, limits.order) for each in (run.g, run.pieces.at_nodes(run.v))
    )
    momentum, way, energy, energies, power = _imbalances(d, run)
    if isinstance(d, LagrangianDynamics):
        # Where joints and contacts keep a coordinate at rest, it has the rounding of those that move.
        m = np.diagonal(d.mass(record.q), axis1=1, axis2=2)
        noise = SUM_RTOL * np.sqrt(2.0 * float(d.kinetic_energy(record.q, record.v).max()) * largest(m))
        error_p, error_q = error_p + noise, error_q + float(record.t[-1]) * noise / m.min(axis=0)
    scale = float(np.abs(energies).max())
    # An energy of large terms that cancel has their rounding error.
    terms = SUM_RTOL * float(scales.forces @ scales.q + scales.momenta @ scales.v)
    allowed_E = limits.precision * scale + terms + elapsed * np.abs(power).max()
    allowed_E += limits.slack * run.pieces.error(power[:, None], limits.order)[:, 0]
    allowed_E += error_p @ scales.v + error_q @ scales.forces
    found = {
        **_judge_nodes(d, run, (momentum, way), scales, limits, elapsed, (error_p, error_q)),
        **_judge_contacts(d, run, scales, limits, events, (np.abs(scales.dynamics.H) @ error_q[-1], pulls)),
        "energy_balance": largest_violation(energy, allowed_E),
        "sampling": _sampling(record, dense, scales, limits.precision),
    }
    return found, scales, Energies(float(energy.max()), scale)


def _imbalances(d: Dynamics, run: SampledMotion) -> tuple[Array, Array, Array, Array, Array]:
    """Return the imbalances of momentum (nk, n), way (nk, n) and energy (nk,), the stored energies, and the power.

    Of the imbalances on both sides of a cut it is the absolute value of the larger one.
    """
    account = account_of(d)
    n = len(d.nodes)
    pieces = run.pieces
    impacts = run.impacts
    q, v = (interleaved(left, pieces.at_cuts(each)) for left, each in zip(run.left, (run.q, run.v), strict=True))
    q_in, v_in, r_in = map(pieces.at_nodes, (run.q, run.v, run.r))
    stored = account.stored(q, v, q[0])
    power = account.balance(account.powers_under(pieces.times, run.f, q_in, v_in, r_in))
    work = run.integrals(account.balance(account.of_impacts(impacts)), power)
    impulses = run.integrals(d.reaction_force(impacts.q, impacts.P, impacts.t), run.g)
    momentum, way = imbalances(d, q, v, impulses, run.integrals(np.zeros((len(impacts.t), n)), v_in))
    energy = np.diff(stored.sum(axis=1)) - work
    off = run.summed(np.hstack([momentum, way, energy[:, None]]))
    # An initial jump is judged by the momentum: massless nodes between springs jump to equilibrium.
    off[1:, -1] -= off[1, -1]
    off[0, -1] = 0.0
    sizes = np.abs(off)
    sizes = np.maximum(sizes[::2], sizes[1::2])
    return sizes[:, :n], sizes[:, n:-1], sizes[:, -1], stored[:, :2].sum(axis=1), power


def _judge_nodes(
    d: Dynamics,
    run: SampledMotion,
    imbalances: tuple[Array, Array],
    scales: Scales,
    limits: Limits,
    elapsed: Array,
    errors: tuple[Array, Array],
) -> Judgement:
    """Judge momentum, kinematics, and the balance of massless nodes; the former two by their imbalances (nk, n)."""
    ε = limits.precision
    forces = scales.forces
    massive, moving, massless = judged_nodes(d)
    momentum, way = imbalances
    # What impulses through a light body leave of themselves has their rounding.
    passed = np.abs(scales.dynamics.B) @ np.abs(run.impacts.P).sum(axis=0)
    allowed_p = ε * scales.momenta + elapsed[:, None] * forces + errors[0] + SUM_RTOL * passed
    allowed_q = ε * scales.q + elapsed[:, None] * scales.v + errors[1]
    return {
        "momentum": largest_violation(momentum[:, massive], allowed_p[:, massive]),
        "equilibrium": largest_violation(np.abs(run.g[:, massless]).max(axis=0), ε * forces[massless]),
        "kinematics": largest_violation(way[:, moving], allowed_q[:, moving]),
    }


def _judge_contacts(
    d: Dynamics,
    run: SampledMotion,
    scales: Scales,
    limits: Limits,
    events: Sequence[Event],
    sizes: tuple[Array, Array],
) -> Judgement:
    """Judge complementarity, penetration, bounds and the impact law.

    The ``sizes`` are the errors of gaps in m and the largest accelerations of rows by forces in m/s² (nc,).
    """
    gap_error, pulls = sizes
    ε = limits.precision
    end = float(run.pieces.cuts[-1])
    r = run.r
    pieces = run.pieces
    u = d.gap(pieces.samples, run.q) + r @ d.D.T
    U = d.gap_rate(pieces.samples, run.q, run.v)
    rows = judge_rows(d, r, u, U, lambda power: pieces.each(pieces.at_nodes(power)))
    product = np.maximum(np.maximum(rows.apart, rows.overlapping), rows.friction)
    # A gap within rounding of zero may close at the next instant: only contacts below it must obey the law at this one.
    violation, by_impacts = judge_impacts(d, run.impacts, -ε * scales.u, limits.rest * end)
    slow = ε * scales.U + limits.rest * end * pulls
    for path in d.impulse_lines > 0.0:
        slow[path] = np.maximum(slow[path], slow[path].sum())
    bounds = rate_forces(d, scales.r)
    largest = largest_impulses(d, events)
    largest = np.maximum(largest, d.friction_bounds(largest) * d.tangential)
    reach = ε * scales.u + gap_error
    return {
        "complementarity": largest_violation(
            np.maximum(product + _switch_residuals(d, r, u, events), by_impacts),
            np.where(d.switches, d.r_max - d.r_min, scales.r) * reach
            + largest * slow
            + bounds * (gap_error + ε * end * scales.U),
        ),
        "penetration": largest_violation(rows.penetration, reach),
        "tension": largest_violation(rows.tension, ε * (scales.r + bounds * d.tangential)),
        "impact_law": largest_violation(np.maximum(violation, rows.missed), slow),
    }


def _switch_residuals(d: Dynamics, r: Array, u: Array, events: Sequence[Event]) -> Array:
    """Return the largest residual of each relay, at the samples and before each event; zero for other rows (nc,)."""
    if not d.switches.any():
        return np.zeros(len(d.contacts))
    seen = [(r, u)]
    if events:
        t = np.array([each.t for each in events])
        q_before, r_before = (np.array([getattr(each.left, name) for each in events]) for name in ("q", "reaction"))
        seen.append((r_before, d.gap(t, q_before) + r_before @ d.D.T))
    return np.asarray(np.max([law_residual(d, *each, d.switches).max(axis=0) for each in seen], axis=0))


def _sampling(record: Record, dense: ContinuousSolution, scales: Scales, ε: float) -> tuple[float, float]:
    """Return the largest difference of the record from either limit of the continuous solution, relative to each scale."""
    d = scales.dynamics
    # Forces of rows that bodies at rest do not load are the rounding of those that balance at their nodes.
    forces = scales.r + SCALE_FLOOR * (np.abs(d.H) @ scales.forces)
    ours = (record.q, record.v, record.reaction)
    sizes = (scales.q, scales.v, forces)

    def differences(side: str) -> Array:
        largest = np.zeros(len(record.t))
        for mine, theirs, size in zip(ours, dense.read(record.t, side), sizes, strict=True):
            if mine.shape != theirs.shape:
                raise ValueError(f"a record of the shape {mine.shape} for a solution of {theirs.shape}")
            if not np.array_equal(mine, theirs):
                _note_differences(mine, theirs, size, largest)
        return largest

    largest = differences("right")
    if not (largest <= ε).all():
        largest = np.minimum(largest, differences("left"))
    return float(largest.max()), ε


@compiled()
def _note_differences(
    a: Annotated[Array, Axes(2, "A")], b: Annotated[Array, Axes(2, "A")], size: Vector, largest: Vector
) -> None:
    """Raise ``largest`` (nt,) to |a - b| of each instant (nt, m), relative to the size of each column; NaN is largest."""
    for j in range(len(size)):
        for k in range(len(a)):
            off = abs(a[k, j] - b[k, j])
            if off == 0.0:
                continue
            if size[j] > 0.0:
                off /= size[j]
            if off > largest[k] or off != off:
                largest[k] = off
