r"""Energy, integrals and laws of rows of θ-steps, whose forces balance at t + θ h, over a run.

A run is judged in blocks of steps that stay in the cache. Each quantity of a block is a row over its steps, or over their
ends, and all images of q, v and w = (q⁺ - q)/h by H, K, M and C are one sparse product. The work of a step is

.. math:: h w \cdot (f_θ + H^T r - C w),

which the θ-method balances with the change of the energy stored in masses and springs. At a node with prescribed motion the
driving force balances the others, and K q_θ - s remains.

Rows with a feedthrough, in which D r is not zero, are satisfied at t + θ h, or at t + h in a step with θ = 1; the smaller
violation counts. If all contacts of an impulse path over massless nodes are active, the impact law holds for their sum: the
product is the force transmitted by all of them times Σ (U⁺ + ρ e U), with ρ of
`lcpimpact.integrators.stepping.impulse_paths`. If a contact of a path penetrates when others close, only the penetration is
counted.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array

from lcpimpact.arrays import Array, FlagMatrix, Flags, Indices, Matrix, Sparse, Vector, largest
from lcpimpact.certificate.balances import judged_nodes, momentum_imbalances
from lcpimpact.certificate.energy import Energies
from lcpimpact.certificate.laws import RowViolations, judge_rows, node_kinds, row_kinds
from lcpimpact.certificate.scales import sizes
from lcpimpact.memo import once
from lcpimpact.numerics.rounding import EPS
from lcpimpact.record import CLOSED_GAP_RTOL
from lcpimpact.scheme.dynamics import Dynamics
from lcpimpact.scheme.power_law import energies, forces, mean_forces
from lcpimpact.scheme.rate_law import mean_forces as pulls
from lcpimpact.scheme.terms import NodeKind


class Recorded(NamedTuple):
    """Recorded run, and its forces.

    Attributes
    ----------
    t, q, v, r      t (nt,), q and v (nt, n), and r (nt - 1, nc)
    f               the loads (nt, n), or one row if constant
    f_θ             the general forces at t_θ, q_θ and v_θ of each step (nt - 1, n); no rows if there are none
    early           by how much w exceeds (1 - θ) v + θ v⁺ of masses on strong dashpots (nt - 1, n); no rows without such
    """

    t: Vector
    q: Matrix
    v: Matrix
    r: Matrix
    f: Matrix
    f_θ: Matrix
    early: Matrix


class Impulses(NamedTuple):
    """The impulses P (ni,) of a run in the order of their steps, with the step and the row of each."""

    step: Indices
    row: Indices
    P: Vector


class Violations(NamedTuple):
    """Largest violations of the steps of a run.

    Attributes
    ----------
    product, law : (nc,) arrays                 complementarity in J at velocity level and of rows with a feedthrough,
                                                and violation of the impact law in m/s
    penetration : (nc,) array                   penetration in m of rows with a feedthrough
    r, gap_change : (nc,) arrays                the largest |r| and |u⁺ - u|
    kinematics : (n,)                           difference between displacement and integrated velocity in m
    q, v : (n,) arrays                          the largest |q| and |v|
    """

    product: Vector
    law: Vector
    penetration: Vector
    r: Vector
    gap_change: Vector
    kinematics: Vector
    q: Vector
    v: Vector


class Kinds(NamedTuple):
    """The rows by the laws that are judged here, and the nodes by their velocities.

    Attributes
    ----------
    feedthrough, plain, on_path : (nc,) flags   rows with a feedthrough, other contacts and held rows, and contacts of
                                                impulse paths
    striking, held, at_gaps : indices           contacts whose law of impact is judged, rows that are held at velocity level,
                                                and contacts of paths that are judged by their gaps
    paths : tuple of flags (nc,)                the impulse paths over massless nodes
    loose, driven : indices                     nodes whose v is the mean of a step, and nodes with prescribed motion
    moved : (n,) flags                          nodes whose velocities are integrated
    """

    feedthrough: Flags
    plain: Flags
    on_path: Flags
    striking: Indices
    held: Indices
    at_gaps: Indices
    paths: tuple[Flags, ...]
    loose: Indices
    driven: Indices
    moved: Flags


@once
def kinds_of(d: Dynamics) -> Kinds:
    """Return the kinds of the rows and nodes."""
    feedthrough = (d.D != 0.0).any(axis=1) & (~d.limited | d.of_rate)
    plain = ~d.of_rate & ~d.limited & ~feedthrough
    on_path = (d.impulse_lines != 0.0).any(axis=0)
    by_rate = plain & (d.relative_degree == 2)
    held = by_rate & np.isinf(d.r_min)
    return Kinds(
        feedthrough=feedthrough,
        plain=plain,
        on_path=on_path,
        striking=np.flatnonzero(by_rate & ~held),
        held=np.flatnonzero(held),
        at_gaps=np.flatnonzero(plain & ~by_rate & on_path),
        paths=tuple(path > 0.0 for path in d.impulse_lines),
        loose=np.flatnonzero(judged_nodes(d).massless),
        driven=np.flatnonzero(d.driven),
        moved=node_kinds(d) != NodeKind.FREE,
    )


@once
def images_of(d: Dynamics) -> Sparse:
    """Return the matrix whose product with (q, v, w) is (H q, H v, K q, M v, H w, C w), without driven nodes in C w."""
    q, v, w = np.identity(3)
    C = np.where(d.driven[:, None], 0.0, d.C)
    blocks = ((q, d.H), (v, d.H), (q, d.K), (v, d.M), (w, d.H), (w, C))
    return csr_array(np.vstack([np.kron(of, A) for of, A in blocks]))


@dataclass(frozen=True, eq=False)
class StepSamples:
    """The quantities of m steps, each a row over the steps, (m,), or over their ends, (m + 1,).

    Attributes
    ----------
    d, run, θ           the system, its run, and where in a step its forces balance
    first, last         the first step, and the one after the last
    h                   lengths of the steps (m,)
    r, total            mean forces of the steps, without and with impulses (nc, m)
    f                   loads and general forces at t_θ (n, m)
    q, v, w             coordinates and velocities (n, m + 1), and mean velocities (n, m)
    rate                velocities at t_θ, of nodes without mass those at the ends of their steps (n, m)
    u, U, W             gaps and their rates (nc, m + 1), and mean rates (nc, m)
    K_q, M_v, C_w       forces of springs and momenta (n, m + 1), and forces of dashpots at nodes that are not driven (n, m)
    """

    d: Dynamics
    run: Recorded
    θ: float
    first: int
    last: int
    h: Array
    r: Array
    total: Array
    f: Array
    q: Array
    v: Array
    w: Array
    rate: Array
    u: Array
    U: Array
    K_q: Array
    M_v: Array
    W: Array
    C_w: Array


def samples_of(d: Dynamics, run: Recorded, impulses: Impulses, θ: float, first: int, last: int) -> StepSamples:
    """Return the quantities of the steps of a run from the first on, and before the last."""
    n, nc = len(d.nodes), len(d.contacts)
    h = np.diff(run.t[first : last + 1])
    r = np.ascontiguousarray(run.r[first:last].T)
    total = r
    here = slice(*np.searchsorted(impulses.step, (first, last)))
    if here.start < here.stop:
        at = impulses.step[here] - first
        total = r.copy()
        np.add.at(total, (impulses.row[here], at), impulses.P[here] / h[at])
    x = np.empty((3, n, len(h) + 1))
    q, v = x[:2]
    w = x[2, :, :-1]
    q[:] = run.q[first : last + 1].T
    v[:] = run.v[first : last + 1].T
    np.subtract(q[:, 1:], q[:, :-1], out=w)
    w /= h
    x[2, :, -1] = 0.0
    rate = _rates(d, run, θ, v, w, first)
    if len(run.f) == 1:
        f = np.broadcast_to(run.f.T, w.shape)
    else:
        f = ((1.0 - θ) * run.f[first:last] + θ * run.f[first + 1 : last + 1]).T
    if len(run.f_θ):
        f = f + run.f_θ[first:last].T
    images = np.split(images_of(d) @ x.reshape(3 * n, -1), np.cumsum([nc, nc, n, n, nc]))
    images[0] += d.u0[:, None]
    of_steps = (each[:, :-1] for each in images[4:])
    return StepSamples(d, run, θ, first, last, h, r, total, f, q, v, w, rate, *images[:4], *of_steps)


def _rates(d: Dynamics, run: Recorded, θ: float, v: Array, w: Array, first: int) -> Array:
    """Return the velocities at t_θ in the steps from the first on, by those at their ends and the mean ones (n, m)."""
    kinds = kinds_of(d)
    rate = (1.0 - θ) * v[:, :-1] + θ * v[:, 1:]
    if len(run.early):
        rate += run.early[first : first + w.shape[1]].T
    if len(kinds.loose):
        rate[kinds.loose] = v[kinds.loose, 1:]
    if len(kinds.driven):
        rate[kinds.driven] = w[kinds.driven]
    return np.asarray(rate)


class EnergyTerms(NamedTuple):
    """Stored energy at the ends of steps (m + 1,), power of what does not store energy, and own losses if θ > 1/2 (m,)."""

    stored: Array
    power: Array
    lost: Array | None


class Integrals(NamedTuple):
    """Integrals of the θ-rule over parts of a run: of q_θ, of loads and non-linear springs (np, n), and of r (np, nc).

    And the step at which each part ends (np,).
    """

    ends: Indices
    q: Matrix
    f: Matrix
    r: Matrix


class Judged(NamedTuple):
    """The result of judging all steps of a run: its violations, the largest imbalance of momentum in N s (n,), and energies.

    ``rows`` are the violations of the laws of the rows at the ends of steps, and ``apart`` forces of contacts that are open.
    """

    violations: Violations
    rows: RowViolations
    apart: Apart
    momentum: Array
    energies: Energies


class Apart(NamedTuple):
    """Forces of steps in which their contacts are open at both ends: row, mean force with impulses, smaller opening."""

    row: Indices
    force: Vector
    opening: Vector

    def beyond(self, way: Array) -> Array:
        """Return the largest |r u| in J of each row, with u what it is open beyond a ``way`` (nc,)."""
        found = np.zeros(len(way))
        product = np.abs(self.force) * np.maximum(self.opening - way[self.row], 0.0)
        np.maximum.at(found, self.row, product)
        return found


def judge_steps(
    d: Dynamics, run: Recorded, impulses: Impulses, θ: float, *, longest: int = 1 << 14, numbers: int = 1 << 16
) -> Judged:
    """Judge all steps of a run, in blocks of so many steps or ``numbers`` that they stay in the cache."""
    n, nc = len(d.nodes), len(d.contacts)
    steps = len(run.t) - 1
    length = max(1, min(steps, longest, numbers // (n + nc)))
    ends = np.append(np.arange(0, steps, length), steps)
    integrals = list[Integrals]()
    found = Violations(*np.zeros((5, nc)), *np.zeros((3, n)))
    rows = RowViolations(*np.zeros((6, nc)))
    apart = list[Apart]()
    energy = EnergyBalance()
    reach = 0.0
    for first, last in pairwise(ends):
        b = samples_of(d, run, impulses, θ, first, last)
        _judge_kinematics(b, found)
        _keep_largest_values(b, found)
        _judge_impacts(b, _judge_paths(b, found), found)
        rows = rows.larger(_judge_rows(b))
        apart.append(_apart(b, found))
        late, reach = _judge_feedthrough(b, reach, found)
        terms, spring_force = _energy_terms(b)
        energy = energy.after(b.h, terms)
        integrals.append(_integrals(b, spring_force, late))
    together = Apart(*map(np.concatenate, zip(*apart, strict=True)))
    momentum = _momentum(d, run, Integrals(*map(np.concatenate, zip(*integrals, strict=True))))
    return Judged(found, rows, together, momentum, energy.energies)


def _keep(kept: Array, values: Array) -> None:
    """Keep the larger of two values each."""
    np.maximum(kept, values, out=kept)


def _judge_kinematics(b: StepSamples, found: Violations) -> None:
    """Judge the ways of the steps by their velocities."""
    off = b.w - b.rate
    off *= b.h
    _keep(found.kinematics, largest(off.T) * kinds_of(b.d).moved)


def _keep_largest_values(b: StepSamples, found: Violations) -> None:
    """Keep the largest coordinates, velocities, reactions and changes of gaps."""
    _keep(found.q, largest(b.q.T))
    _keep(found.v, largest(b.v.T))
    _keep(found.r, largest(b.r.T))
    # A contact penetrates by up to h |U| of the step before it closes, which is more than h |W|.
    rate = np.maximum(np.abs(b.W), np.abs(b.U[:, 1:]))
    rate *= b.h
    _keep(found.gap_change, rate.max(axis=1))


def _judge_rows(b: StepSamples) -> RowViolations:
    """Judge the laws of the rows at the ends of the steps, by their mean reactions with impulses, and mean rates."""
    d = b.d
    U = u = b.u[:, 1:]
    if row_kinds(d).some_of_rate:
        # At velocity level a row of the rate obeys the law of impact.
        struck = b.U[:, 1:] + d.restitution[:, None] * b.U[:, :-1]
        U = np.where((d.relative_degree == 2)[:, None], struck, b.W)
    return judge_rows(d, b.total.T, u.T, U.T, partial(np.multiply, b.h[:, None]))


def _apart(b: StepSamples, found: Violations) -> Apart:
    """Return the forces of contacts that are open at both ends of a step by more than the way of any step so far."""
    least = found.gap_change + 64.0 * EPS * found.q.max(initial=0.0)
    opening = np.minimum(b.u[:, :-1], b.u[:, 1:])
    row, step = np.nonzero((opening > least[:, None]) & (b.total != 0.0))
    return Apart(row, b.total[row, step], opening[row, step])


def _judge_paths(b: StepSamples, found: Violations) -> FlagMatrix:
    """Judge the impulse paths over massless nodes, and return the flags of the contacts of active ones (nc, m).

    If all contacts of a path are active, the impact law holds for their sum.
    """
    paths = kinds_of(b.d).paths
    if not paths:
        return np.broadcast_to(np.False_, b.r.shape)
    by_path = np.zeros(b.r.shape, np.bool_)
    ρ = np.zeros(b.r.shape)
    U, after = b.U[:, :-1], b.U[:, 1:]
    approach = np.minimum(U, 0.0)
    for path in paths:
        active = b.total[path].min(axis=0) > 0.0
        by_path[path] |= active
        opening = U[path].sum(axis=0)
        ratio = np.zeros_like(opening)
        np.divide(opening, approach[path].sum(axis=0), out=ratio, where=active & (opening < 0.0))
        ρ[path] = np.maximum(ρ[path], ratio)
    for path in paths:
        defect = (after[path] + b.d.restitution[path, None] * ρ[path] * approach[path]).sum(axis=0)
        through = np.maximum(b.total[path].min(axis=0), 0.0)
        found.product[path] = np.maximum(found.product[path], (b.h * through * np.abs(defect)).max())
    return by_path


def _judge_impacts(b: StepSamples, by_path: FlagMatrix, found: Violations) -> None:
    """Judge the law of impact of rows in the steps, and contacts of paths that are not active by their gaps."""
    d = b.d
    kinds = kinds_of(d)
    product, law = np.zeros((2, len(d.contacts)))
    if len(held := kinds.held):
        law[held] = largest(b.U[held, 1:].T)
    if len(at := kinds.at_gaps):
        # If one of the contacts of a path penetrates when others close, only the penetration is counted.
        product[at] = np.where(by_path[at], 0.0, b.total[at] * b.u[at, 1:]).max(axis=1).clip(0.0)
    if len(at := kinds.striking):
        U, total = b.U[at], b.total[at]
        defect = U[:, 1:] + d.restitution[at, None] * U[:, :-1]
        off = np.abs(defect)
        acting = np.where(by_path[at], 0.0, total) if kinds.paths else total
        law[at] = (off * (acting > 0.0)).max(axis=1)
        off *= acting
        product[at] = largest((off * b.h).T)
        ahead = b.u[at, :-1] + 0.5 * b.h * U[:, :-1]
        late = np.maximum(ahead, defect) < 0.0
        if late.any():
            row, step = np.nonzero(late & ~(total > 0.0) & ~by_path[at])
            terms = np.abs(d.u0[at[row]]) + np.sum(sizes(d).H[at[row]] * np.abs(b.q[:, step]).T, axis=1)
            closed = ahead[row, step] < -CLOSED_GAP_RTOL * terms
            np.maximum.at(law, at[row], np.where(closed, -defect[row, step], 0.0))
    _keep(found.product, product)
    _keep(found.law, law)


def _judge_feedthrough(b: StepSamples, reach: float, found: Violations) -> tuple[Array | None, float]:
    """Judge the rows with a feedthrough, at t + θ h or at t + h.

    Returns how much later than t + θ h they are satisfied in each step in s (m,), or None if there are none, and the
    largest gap so far.
    """
    d = b.d
    rows = kinds_of(d).feedthrough
    if not rows.any():
        return None, reach
    end = b.u[:, 1:] + d.D @ b.r
    gaps = np.array([end - (1.0 - b.θ) * b.h * b.W, end])[:, rows]
    products = np.abs(b.total[rows] * gaps)
    joint = np.isinf(d.r_min[rows])[:, None]
    opened = np.where(joint, np.abs(gaps), -gaps)
    reaches = np.maximum.accumulate(np.append(reach, np.abs(gaps[1]).max(axis=0)))[1:]
    product_θ, product_end = products.max(axis=1)
    open_θ, open_end = opened.max(axis=1) if rows.all() else opened.max(axis=1).clip(0.0)
    rounding = CLOSED_GAP_RTOL * reaches * found.r.max()
    at_end = product_θ > np.maximum(rounding, product_end)
    at_end |= (product_θ <= rounding) & (open_θ > np.maximum(CLOSED_GAP_RTOL * reaches, open_end))
    for kept, each in ((found.product, products), (found.penetration, opened)):
        kept[rows] = np.maximum(kept[rows], np.where(at_end, each[1], each[0]).max(axis=1))
    return np.where(at_end, (1.0 - b.θ) * b.h, 0.0), float(reaches[-1])


def _energy_terms(b: StepSamples) -> tuple[EnergyTerms, Array | None]:
    """Return the account of energy of the steps, and the forces of non-linear springs on the nodes in them (n, m).

    A step of θ > 1/2 loses (θ - 1/2) (Δv·M Δv + Δq·K Δq), and Δs Δδ of other springs, by itself: its forces act at t_θ, and
    the energies of masses and springs are those of the mean of its ends.
    """
    d = b.d
    driven = kinds_of(d).driven
    stored = 0.5 * (_dot(b.v, b.M_v) + _dot(b.q, b.K_q))
    power = _dot(b.total, b.W) + _dot(b.w, b.f) - _dot(b.w, b.C_w)
    lost = None
    if len(b.run.early):
        # Strong dashpots take more than they do at the mean velocity of the step.
        power -= _dot(b.run.early[b.first : b.last].T, np.diff(b.M_v)) / b.h
    if len(driven):
        K_q = b.K_q[driven]
        K_q_θ = b.θ * K_q[:, 1:] + (1.0 - b.θ) * K_q[:, :-1]
        power += _dot(b.w[driven], K_q_θ - b.f[driven] - d.B[driven] @ b.total)
    if b.θ > 0.5:
        lost = (b.θ - 0.5) * (_dot(np.diff(b.v), np.diff(b.M_v)) + _dot(np.diff(b.q), np.diff(b.K_q)))
    if not d.springs and not d.dashpots:
        return EnergyTerms(stored, power, lost), None
    δ = d.approach(b.q.T)
    rate = np.ascontiguousarray(d.approach_rate(b.w.T))
    δ_θ = np.ascontiguousarray(d.approach((b.q[:, :-1] + b.θ * b.h * b.w).T))
    s = mean_forces(d.power_laws, δ_θ, rate, b.h)
    elastic = forces(d.power_laws, δ_θ, np.zeros_like(δ_θ))
    stored += energies(d.power_laws, δ).sum(axis=1)
    power -= ((s - elastic) * rate).sum(axis=1)
    on_nodes = d.directions.T @ s.T
    if d.dashpots:
        N = d.rate_directions
        rates = np.ascontiguousarray((N @ b.w).T)
        pull = pulls(d.rate_laws, np.ascontiguousarray((N @ b.v[:, :-1]).T), rates, b.θ, b.h)
        power -= (pull * rates).sum(axis=1)
        on_nodes -= N.T @ pull.T
    if len(driven):
        power -= _dot(b.w[driven], on_nodes[driven])
    if lost is not None:
        s_ends = forces(d.power_laws, δ, np.zeros_like(δ))
        lost += (b.θ - 0.5) * (np.diff(s_ends, axis=0) * np.diff(δ, axis=0)).sum(axis=1)
    return EnergyTerms(stored, power, lost), on_nodes


def _dot(x: Array, y: Array) -> Array:
    """Return the sum of x y over the rows of each column."""
    return np.asarray(np.einsum("is,is->s", x, y))


@dataclass(frozen=True)
class EnergyBalance:
    """The balance of energy of a run up to some step.

    Attributes
    ----------
    sum, kept           the sums of the imbalances, and of those less what the steps lose by themselves
    energies            the largest values so far
    """

    sum: float = 0.0
    kept: float = 0.0
    energies: Energies = field(default=Energies(0.0, 0.0))

    def after(self, h: Array, terms: EnergyTerms) -> EnergyBalance:
        """Return the balance after further steps of lengths h (m,)."""
        change = np.diff(terms.stored) - h * terms.power
        sums = self.sum + np.cumsum(change)
        kept = sums if terms.lost is None else self.kept + np.cumsum(change + terms.lost)
        now = Energies(np.abs(sums).max(), np.abs(terms.stored).max(), -kept.min())
        return EnergyBalance(float(sums[-1]), float(kept[-1]), Energies(*map(np.maximum, self.energies, now)))


def _integrals(b: StepSamples, spring_force: Array | None, late: Array | None, *, length: int = 512) -> Integrals:
    """Return the integrals of q_θ, of loads with non-linear springs, and of reactions, over parts of some ``length`` each.

    Rows with a feedthrough may be satisfied ``late``, by times after t + θ h (m,).
    """
    q_θ = b.θ * b.h * b.rate
    q_θ += b.q[:, :-1]
    force = b.f
    if late is not None:
        q_θ += late * b.w
        if len(b.run.f) > 1:
            force = force + late / b.h * np.diff(b.run.f[b.first : b.last + 1].T)
    if spring_force is not None:
        force = force + spring_force
    starts = np.arange(0, b.last - b.first, length)
    parts = (np.add.reduceat(b.h * each, starts, axis=1).T for each in (q_θ, force, b.total))
    return Integrals(np.append(b.first + starts[1:], b.last), *parts)


def _momentum(d: Dynamics, run: Recorded, over: Integrals) -> Array:
    """Return the largest imbalance of momentum of each node since the start in N s (n,)."""
    ends = np.append(0, over.ends)
    q, v = run.q[ends], run.v[ends]
    pushed = over.f + over.r @ d.B.T - over.q @ d.K.T - np.diff(q, axis=0) @ d.C.T
    return largest(np.cumsum(momentum_imbalances(d, q, v, pushed), axis=0))
