r"""Energy, integrals and laws of impact of θ-steps, whose forces balance at t + θ h, over a run in compiled loops.

A run is judged in blocks of steps. Within a block every quantity is a row over the steps, and the loops over them are
innermost, so that the processor works on several steps at once.

With w = (q⁺ - q)/h the work of a step is

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

from typing import Generic, NamedTuple, TypeVar

import numpy as np

from lcpimpact.arrays import Array, FlagMatrix, Flags, Indices, Matrix, Places, Stack, Vector
from lcpimpact.compiled import compiled
from lcpimpact.record import CLOSED_GAP_RTOL
from lcpimpact.scheme.dynamics import Dynamics
from lcpimpact.scheme.power_law import mean_force, spring_energy, spring_force
from lcpimpact.scheme.terms import NodeKind


class SparsityPattern(NamedTuple):
    """Sparsity pattern in compressed rows: the first entry of each row (rows + 1,), and the column of each entry."""

    starts: Places
    columns: Places


class Nodes(NamedTuple):
    """The nodes of a system: the values of M, C and K in one sparse pattern, and their kinds (n,)."""

    pattern: SparsityPattern
    M: Vector
    C: Vector
    K: Vector
    kind: Indices


class JudgedRows(NamedTuple):
    """The rows of a system, of contacts and of all other laws.

    Attributes
    ----------
    pattern, H                          the constraint matrix by its pattern and values
    B : (n, nc), D : (nc, nc) arrays    directions of the reactions at the nodes, and compliance of the gaps
    u0, e, r_min : (nc,) arrays         gaps at q = 0, restitution, lower bounds of the reactions
    degree : (nc,) array                relative degrees
    paths : (np, nc) array              impulse paths over massless nodes
    """

    pattern: SparsityPattern
    H: Vector
    B: Matrix
    D: Matrix
    u0: Vector
    e: Vector
    r_min: Vector
    degree: Indices
    paths: Matrix


class SpringLaws(NamedTuple):
    """The non-linear springs of a system: their directions N (ns, n), and gap, K, n, b, c of each (ns, 5)."""

    N: Matrix
    law: Matrix


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


Kind = TypeVar("Kind", bound=Array)


class Violations(NamedTuple, Generic[Kind]):
    """Largest violations of a run; while it is judged, the largest of each place in a block, so that no step waits.

    Attributes
    ----------
    product, law : (nc,) arrays                 complementarity in J at velocity level and of rows with a feedthrough,
                                                and violation of the impact law in m/s
    penetration : (nc,) array                   penetration in m of rows with a feedthrough
    r, gap_change : (nc,) arrays                the largest |r| and |u⁺ - u|
    kinematics : (n,)                           difference between displacement and integrated velocity in m
    q, v : (n,) arrays                          the largest |q| and |v|
    """

    product: Kind
    penetration: Kind
    law: Kind
    r: Kind
    gap_change: Kind
    kinematics: Kind
    q: Kind
    v: Kind


class BlockSeries(NamedTuple):
    """The quantities of a block of steps, each a row over its steps s, or over their ends, s and s + 1 of step s.

    Attributes
    ----------
    t, q, v                     instants (B + 1,), and coordinates and velocities at them (n, B + 1)
    h, per_h : (B,)             lengths of the steps, and their reciprocals
    r, total : (nc, B)          mean forces of the steps, without and with impulses
    w, rate : (n, B)            mean velocities, and velocities at t_θ
    f : (n, B)                  loads that vary and general forces at t_θ, and those of non-linear springs
    dq : (n, B)                 changes of ∫ q_θ dt
    u, U : (nc, B + 1)          gaps and their rates
    W : (nc, B)                 mean rates of the gaps
    power : (B,)                power of what does not store energy
    lost : (B,)                 energy that a step of θ > 1/2 loses by itself
    stored : (B + 1,)           energy of masses and springs
    at_ends : (4, nc, B)        in rows with a feedthrough, products at t + θ h and at t + h, and penetrations there
    by_path : (nc, B) flags     contacts whose impulse paths are active
    work : (2, B)               rows for intermediate results
    """

    t: Vector
    q: Matrix
    v: Matrix
    h: Vector
    per_h: Vector
    r: Matrix
    total: Matrix
    w: Matrix
    rate: Matrix
    f: Matrix
    dq: Matrix
    u: Matrix
    U: Matrix
    W: Matrix
    power: Vector
    lost: Vector
    stored: Vector
    at_ends: Stack
    by_path: FlagMatrix
    work: Matrix


class Integrals(NamedTuple):
    """Integrals of the θ-rule over each block of steps: of q_θ, of loads and non-linear springs (nb, n), of r (nb, nc)."""

    q: Matrix
    f: Matrix
    r: Matrix


class Kinds(NamedTuple):
    """Flags of the rows (nc,): of those with a feedthrough, other contacts and held rows, and contacts on impulse paths."""

    feedthrough: Flags
    plain: Flags
    on_path: Flags


def block_steps(nc: int, n: int, steps: int, *, shortest: int = 32, longest: int = 512, numbers: int = 4096) -> int:
    """Return the number of steps in a block, for nc rows and n nodes.

    It is between ``shortest`` and ``longest``, with some ``numbers`` in its rows: so many that calls cost little, and so few
    that the rows fit in the cache.
    """
    return max(1, min(steps, longest, max(shortest, numbers // (n + nc))))


def no_violations(nc: int, n: int, B: int) -> Violations[Matrix]:
    """Return rows of zero violations of nc rows and n nodes, for blocks of B steps."""
    return Violations(*np.zeros((5, nc, B)), *np.zeros((3, n, B)))


@compiled()
def rows_for(nc: int, n: int, B: int) -> BlockSeries:
    """Return room for blocks of B steps."""
    return BlockSeries(
        np.zeros(B + 1), np.zeros((n, B + 1)), np.zeros((n, B + 1)), np.zeros(B), np.zeros(B), np.zeros((nc, B)),
        np.zeros((nc, B)), np.zeros((n, B)), np.zeros((n, B)), np.zeros((n, B)), np.zeros((n, B)), np.zeros((nc, B + 1)),
        np.zeros((nc, B + 1)), np.zeros((nc, B)), np.zeros(B), np.zeros(B), np.zeros(B + 1), np.zeros((4, nc, B)),
        np.zeros((nc, B), np.bool_), np.zeros((2, B)),
    )  # fmt: skip


def kinds_of(d: Dynamics) -> Kinds:
    """Return the flags of the rows."""
    feedthrough = (d.D != 0.0).any(axis=1) & (~d.limited | d.of_rate)
    return Kinds(feedthrough, ~d.of_rate & ~d.limited & ~feedthrough, (d.impulse_lines != 0.0).any(axis=0))


@compiled(inline="always", allocates=False)
def largest(values: Vector) -> float:
    """Return the largest |value|."""
    found = 0.0
    for i in range(len(values)):
        found = max(found, abs(values[i]))
    return found


@compiled(inline="always", allocates=False)
def sum_of(x: Vector, m: int) -> float:
    """Return the sum of the first m values: of four parts, since each addition waits for the last."""
    a = 0.0
    b = 0.0
    c = 0.0
    d = 0.0
    whole = m // 4
    for s in range(whole):
        a = a + x[4 * s]
        b = b + x[4 * s + 1]
        c = c + x[4 * s + 2]
        d = d + x[4 * s + 3]
    for s in range(4 * whole, m):
        a += x[s]
    return (a + b) + (c + d)


@compiled(allocates=False)
def read_block(run: Recorded, impulses: Impulses, first: int, m: int, at: int, rows: BlockSeries) -> int:
    """Copy m steps from the record, with their impulses from number ``at`` on; return the number of the next one."""
    t = rows.t
    h = rows.h
    per_h = rows.per_h
    times = run.t[first : first + m + 1]
    for s in range(m + 1):
        t[s] = times[s]
    for s in range(m):
        h[s] = t[s + 1] - t[s]
        per_h[s] = 1.0 / h[s]
    qs = run.q[first : first + m + 1]
    vs = run.v[first : first + m + 1]
    rs = run.r[first : first + m]
    for i in range(len(rows.q)):
        q, v = rows.q[i], rows.v[i]
        for s in range(m + 1):
            q[s], v[s] = qs[s, i], vs[s, i]
    for i in range(len(rows.r)):
        r, total = rows.r[i], rows.total[i]
        for s in range(m):
            r[s] = rs[s, i]
            total[s] = r[s]
    while at < len(impulses.P) and impulses.step[at] < first + m:
        s = impulses.step[at] - first
        rows.total[impulses.row[at], s] += impulses.P[at] / rows.h[s]
        at += 1
    return at


@compiled(inline="always", allocates=False)
def keep_largest(kept: Vector, x: Vector, first: int, m: int) -> None:
    """Replace each kept number by |x| from ``first`` on where that is larger."""
    values = x[first : first + m]
    for s in range(m):
        kept[s] = max(kept[s], abs(values[s]))


@compiled(allocates=False)
def judge_kinematics(
    run: Recorded, nodes: Nodes, first: int, m: int, θ: float, rows: BlockSeries, found: Violations[Matrix]
) -> None:
    """Judge the kinematics of the steps, and write w, the velocities at t_θ, and the changes of ∫ q_θ dt."""
    h, per_h = rows.h, rows.per_h
    for i in range(len(rows.q)):
        q = rows.q[i]
        v = rows.v[i]
        w = rows.w[i]
        rate = rows.rate[i]
        dq = rows.dq[i]
        off = found.kinematics[i]
        for s in range(m):
            w[s] = (q[s + 1] - q[s]) * per_h[s]
        if nodes.kind[i] == NodeKind.MASSIVE:
            for s in range(m):
                rate[s] = (1.0 - θ) * v[s] + θ * v[s + 1]
            if len(run.early) > 0:
                for s in range(m):
                    rate[s] += run.early[first + s, i]
        elif nodes.kind[i] == NodeKind.DRIVEN:
            for s in range(m):
                rate[s] = w[s]
        else:
            for s in range(m):
                rate[s] = v[s + 1]
        for s in range(m):
            dq[s] = h[s] * (q[s] + θ * h[s] * rate[s])
        if nodes.kind[i] != NodeKind.FREE:
            for s in range(m):
                off[s] = max(off[s], h[s] * abs(w[s] - rate[s]))
        keep_largest(found.q[i], q, 1, m)
        keep_largest(found.v[i], v, 1, m)


@compiled(allocates=False)
def read_loads(run: Recorded, first: int, m: int, θ: float, rows: BlockSeries) -> None:
    """Write the loads that vary and the general forces at t_θ."""
    for i in range(len(rows.q)):
        f = rows.f[i]
        for s in range(m):
            f[s] = (1.0 - θ) * run.f[first + s, i] + θ * run.f[first + s + 1, i] if len(run.f) > 1 else 0.0
            if len(run.f_θ) > 0:
                f[s] += run.f_θ[first + s, i]


@compiled(allocates=False)
def follow_gaps(contacts: JudgedRows, m: int, rows: BlockSeries, found: Violations[Matrix]) -> None:
    """Write u, U and W of the rows, and the largest changes and forces; add the power of the reactions."""
    h, power = rows.h, rows.power
    for i in range(len(contacts.u0)):
        u = rows.u[i]
        U = rows.U[i]
        W = rows.W[i]
        total = rows.total[i]
        change = found.gap_change[i]
        for s in range(m + 1):
            u[s], U[s] = contacts.u0[i], 0.0
        for s in range(m):
            W[s] = 0.0
        for p in range(contacts.pattern.starts[i], contacts.pattern.starts[i + 1]):
            H, j = contacts.H[p], contacts.pattern.columns[p]
            q = rows.q[j]
            v = rows.v[j]
            w = rows.w[j]
            for s in range(m + 1):
                u[s] += H * q[s]
                U[s] += H * v[s]
            for s in range(m):
                W[s] += H * w[s]
        # A contact penetrates by up to h |U| of the step before it closes, which is more than h |W|.
        for s in range(m):
            change[s] = max(change[s], h[s] * max(abs(W[s]), abs(U[s + 1])))
            power[s] += total[s] * W[s]
        keep_largest(found.r[i], rows.r[i], 0, m)


@compiled(allocates=False)
def follow_feedthrough(contacts: JudgedRows, i: int, m: int, θ: float, rows: BlockSeries) -> None:
    """Write the products and penetrations of a row with a feedthrough at t + θ h and at t + h."""
    h = rows.h
    total = rows.total[i]
    W = rows.W[i]
    end = rows.work[1]
    for s in range(m):
        end[s] = rows.u[i, s + 1]
    for j in range(len(contacts.u0)):
        D, r = contacts.D[i, j], rows.r[j]
        if D != 0.0:
            for s in range(m):
                end[s] += D * r[s]
    joint = contacts.r_min[i] == -np.inf
    for s in range(m):
        u_θ = end[s] - (1.0 - θ) * h[s] * W[s]
        rows.at_ends[0, i, s] = abs(total[s] * u_θ)
        rows.at_ends[1, i, s] = abs(total[s] * end[s])
        rows.at_ends[2, i, s], rows.at_ends[3, i, s] = (abs(u_θ), abs(end[s])) if joint else (-u_θ, -end[s])


@compiled(allocates=False)
def judge_impacts(
    contacts: JudgedRows, i: int, on_path: bool, m: int, rows: BlockSeries, found: Violations[Matrix]
) -> None:
    """Judge the impact law of a contact, and its products in J."""
    product = found.product[i]
    missed = found.law[i]
    u = rows.u[i]
    U = rows.U[i]
    h = rows.h
    e = contacts.e[i]
    acting, doubtful = rows.work[0], 0.0
    for s in range(m):
        acting[s] = rows.total[i, s]
    if on_path:
        for s in range(m):
            acting[s] = 0.0 if rows.by_path[i, s] else acting[s]
    for s in range(m):
        defect = U[s + 1] + e * U[s]
        missed[s] = max(missed[s], abs(defect) if acting[s] > 0.0 else 0.0)
        product[s] = max(product[s], abs(h[s] * acting[s] * defect))
    for s in range(m):
        doubtful = min(doubtful, max(u[s] + 0.5 * h[s] * U[s], U[s + 1] + e * U[s]))
    if not doubtful < 0.0:
        return
    for s in range(m):
        ahead, defect = u[s] + 0.5 * h[s] * U[s], U[s + 1] + e * U[s]
        by_path = on_path and rows.by_path[i, s]
        if ahead < 0.0 and defect < 0.0 and not by_path and not rows.total[i, s] > 0.0:
            terms = abs(contacts.u0[i])
            for p in range(contacts.pattern.starts[i], contacts.pattern.starts[i + 1]):
                terms += abs(contacts.H[p] * rows.q[contacts.pattern.columns[p], s])
            if ahead < -CLOSED_GAP_RTOL * terms:
                missed[s] = max(missed[s], -defect)


@compiled(allocates=False)
def judge_velocity_level(
    contacts: JudgedRows, i: int, m: int, rows: BlockSeries, kinds: Kinds, found: Violations[Matrix]
) -> None:
    """Judge the law of impact of a row in the steps, and the products of one on impulse paths that are not active."""
    if contacts.degree[i] == 2:
        if contacts.r_min[i] == -np.inf:
            keep_largest(found.law[i], rows.U[i], 1, m)
        else:
            judge_impacts(contacts, i, kinds.on_path[i], m, rows, found)
    elif kinds.on_path[i]:
        # If one of the contacts of a path penetrates when others close, only the penetration is counted.
        product = found.product[i]
        total = rows.total[i]
        u = rows.u[i]
        for s in range(m):
            product[s] = max(product[s], 0.0 if rows.by_path[i, s] else total[s] * u[s + 1])


@compiled()
def judge_paths(contacts: JudgedRows, m: int, rows: BlockSeries, found: Violations[Matrix]) -> None:
    """Judge the impulse paths over massless nodes, and mark the contacts of active ones.

    If all contacts of a path are active, the impact law holds for their sum.
    """
    nc = len(contacts.u0)
    paths = contacts.paths
    force = rows.total
    U = rows.U
    through, ρ = np.empty(len(paths)), np.zeros(nc)
    for s in range(m):
        for i in range(nc):
            rows.by_path[i, s], ρ[i] = False, 0.0
        for a in range(len(paths)):
            least = np.inf
            opening = 0.0
            approach = 0.0
            for i in range(nc):
                if paths[a, i] > 0.0:
                    least, opening = min(least, force[i, s]), opening + U[i, s]
                    approach += min(U[i, s], 0.0)
            through[a] = max(least, 0.0)
            for i in range(nc):
                if paths[a, i] > 0.0 and least > 0.0:
                    rows.by_path[i, s] = True
                    if opening < 0.0:
                        ρ[i] = max(ρ[i], opening / approach)
        for a in range(len(paths)):
            path_defect = 0.0
            for i in range(nc):
                if paths[a, i] > 0.0:
                    path_defect += U[i, s + 1] + contacts.e[i] * ρ[i] * min(U[i, s], 0.0)
            for i in range(nc):
                if paths[a, i] > 0.0:
                    found.product[i, s] = max(found.product[i, s], rows.h[s] * through[a] * abs(path_defect))


@compiled(allocates=False)
def judge_feedthrough(
    run: Recorded,
    first: int,
    m: int,
    θ: float,
    reach: float,
    rows: BlockSeries,
    kinds: Kinds,
    found: Violations[Matrix],
) -> float:
    """Judge the rows with a feedthrough, at t + θ h or at t + h; return the largest penetration so far."""
    largest_force = 0.0
    for i in range(len(found.r)):
        largest_force = max(largest_force, largest(found.r[i]))
    for s in range(m):
        product_θ = 0.0
        product = 0.0
        open_θ = -np.inf
        open_end = -np.inf
        for i in range(len(kinds.feedthrough)):
            if kinds.feedthrough[i]:
                product_θ = max(product_θ, rows.at_ends[0, i, s])
                product = max(product, rows.at_ends[1, i, s])
                open_θ = max(open_θ, rows.at_ends[2, i, s])
                open_end = max(open_end, rows.at_ends[3, i, s])
                reach = max(reach, abs(rows.at_ends[3, i, s]))
            else:
                open_θ, open_end = max(open_θ, 0.0), max(open_end, 0.0)
        rounding = CLOSED_GAP_RTOL * reach * largest_force
        at_end = product_θ > max(rounding, product) or (
            product_θ <= rounding and open_θ > max(CLOSED_GAP_RTOL * reach, open_end)
        )
        if at_end:
            late = rows.h[s] * (1.0 - θ)
            for i in range(len(rows.q)):
                rows.dq[i, s] += late * rows.h[s] * rows.w[i, s]
                if len(run.f) > 1:
                    rows.f[i, s] += (1.0 - θ) * (run.f[first + s + 1, i] - run.f[first + s, i])
        level = 1 if at_end else 0
        for i in range(len(kinds.feedthrough)):
            if kinds.feedthrough[i]:
                found.product[i, s] = max(found.product[i, s], rows.at_ends[level, i, s])
                found.penetration[i, s] = max(found.penetration[i, s], rows.at_ends[2 + level, i, s])
    return reach


@compiled(allocates=False)
def add_springs(nodes: Nodes, springs: SpringLaws, m: int, θ: float, rows: BlockSeries) -> None:
    """Add the forces of non-linear springs, their energy, and the power that they dissipate or extract at motions."""
    n = len(rows.q)
    for a in range(len(springs.law)):
        gap, K, exponent, b, c = springs.law[a]
        for s in range(m + 1):
            δ = -gap
            for j in range(n):
                δ -= springs.N[a, j] * rows.q[j, s]
            rows.stored[s] += spring_energy(K, exponent, δ)
        for s in range(m):
            δ, opening_rate = -gap, 0.0
            for j in range(n):
                δ -= springs.N[a, j] * (rows.q[j, s] + θ * rows.h[s] * rows.w[j, s])
                opening_rate += springs.N[a, j] * rows.w[j, s]
            force, _, _ = mean_force(K, exponent, b, c, δ, -opening_rate, rows.h[s])
            elastic_force, _, _ = spring_force(K, exponent, b, c, δ, 0.0)
            rows.power[s] += (force - elastic_force) * opening_rate
            for j in range(n):
                rows.f[j, s] += springs.N[a, j] * force
                if nodes.kind[j] == NodeKind.DRIVEN:
                    rows.power[s] -= springs.N[a, j] * force * rows.w[j, s]


@compiled(allocates=False)
def add_work(run: Recorded, nodes: Nodes, B: Matrix, first: int, m: int, θ: float, rows: BlockSeries) -> None:
    """Add the power of loads, dashpots and prescribed motions, and the energy of masses and linear springs."""
    power, stored = rows.power, rows.stored
    for i in range(len(rows.q)):
        w = rows.w[i]
        q = rows.q[i]
        v = rows.v[i]
        f = rows.f[i]
        driven = nodes.kind[i] == NodeKind.DRIVEN
        constant = run.f[0, i] if len(run.f) == 1 else 0.0
        if driven:
            for c in range(len(rows.r)):
                total = rows.total[c]
                if B[i, c] != 0.0:
                    for s in range(m):
                        power[s] -= total[s] * B[i, c] * w[s]
        else:
            if constant != 0.0:
                for s in range(m):
                    power[s] += w[s] * constant
            if len(run.f) > 1 or len(run.f_θ) > 0:
                for s in range(m):
                    power[s] += w[s] * f[s]
        for p in range(nodes.pattern.starts[i], nodes.pattern.starts[i + 1]):
            j = nodes.pattern.columns[p]
            M = 0.5 * nodes.M[p]
            K = 0.5 * nodes.K[p]
            C = nodes.C[p]
            other_q = rows.q[j]
            other_v = rows.v[j]
            other_w = rows.w[j]
            if M != 0.0:
                for s in range(m + 1):
                    stored[s] += v[s] * (M * other_v[s])
                if len(run.early) > 0:
                    # Strong dashpots take more than they do at the mean velocity of the step.
                    for s in range(m):
                        power[s] -= run.early[first + s, i] * (2.0 * M) * (other_v[s + 1] - other_v[s]) * rows.per_h[s]
            if K != 0.0:
                for s in range(m + 1):
                    stored[s] += q[s] * (K * other_q[s])
                if driven:
                    for s in range(m):
                        power[s] += w[s] * (2.0 * K) * (θ * other_q[s + 1] + (1.0 - θ) * other_q[s])
            if C != 0.0 and not driven:
                for s in range(m):
                    power[s] -= w[s] * (C * other_w[s])


@compiled(allocates=False)
def add_own_losses(nodes: Nodes, springs: SpringLaws, m: int, θ: float, rows: BlockSeries) -> None:
    """Add the energy that a step of θ > 1/2 loses by itself, (θ - 1/2) (Δv·M Δv + Δq·K Δq), and Δs Δδ of other springs.

    Its forces act at t_θ, and the energies of masses and springs are those of the mean of its ends.
    """
    n, lost = len(rows.q), rows.lost
    for i in range(n):
        q, v = rows.q[i], rows.v[i]
        for p in range(nodes.pattern.starts[i], nodes.pattern.starts[i + 1]):
            j = nodes.pattern.columns[p]
            M = (θ - 0.5) * nodes.M[p]
            K = (θ - 0.5) * nodes.K[p]
            other_q, other_v = rows.q[j], rows.v[j]
            for s in range(m):
                lost[s] += M * (v[s + 1] - v[s]) * (other_v[s + 1] - other_v[s])
                lost[s] += K * (q[s + 1] - q[s]) * (other_q[s + 1] - other_q[s])
    for a in range(len(springs.law)):
        gap, K, exponent, b, c = springs.law[a]
        δ_then, force_then = 0.0, 0.0
        for s in range(m + 1):
            δ = -gap
            for j in range(n):
                δ -= springs.N[a, j] * rows.q[j, s]
            force, _, _ = spring_force(K, exponent, b, c, δ, 0.0)
            if s > 0:
                lost[s - 1] += (θ - 0.5) * (force - force_then) * (δ - δ_then)
            δ_then, force_then = δ, force


@compiled(allocates=False)
def integrate(run: Recorded, varying: bool, m: int, rows: BlockSeries, block: int, found: Integrals) -> None:
    """Write the integrals over a block of m steps."""
    impulse = rows.work[0]
    for i in range(len(rows.q)):
        found.q[block, i] = sum_of(rows.dq[i], m)
        found.f[block, i] = run.f[0, i] * (rows.t[m] - rows.t[0]) if len(run.f) == 1 else 0.0
        if varying:
            for s in range(m):
                impulse[s] = rows.h[s] * rows.f[i, s]
            found.f[block, i] += sum_of(impulse, m)
    for i in range(len(rows.r)):
        total = rows.total[i]
        for s in range(m):
            impulse[s] = rows.h[s] * total[s]
        found.r[block, i] = sum_of(impulse, m)


@compiled()
def certify_steps(
    run: Recorded,
    impulses: Impulses,
    θ: float,
    nodes: Nodes,
    contacts: JudgedRows,
    springs: SpringLaws,
    kinds: Kinds,
    integrals: Integrals,
    found: Violations[Matrix],
) -> tuple[float, float, float, float]:
    """Judge all steps of a run: write violations and integrals; return the energy imbalance, loss and scale, and longest h.

    The loss is what is lost beyond what steps of θ > 1/2 lose by themselves.

    Massless nodes between springs may be projected after the step; their v is the mean of the step.
    """
    n = run.q.shape[1]
    nc = len(contacts.u0)
    steps = len(run.t) - 1
    at = 0
    first = 0
    B = found.q.shape[1]
    rows = rows_for(nc, n, B)
    block = 0
    any_feedthrough = False
    reach = 0.0
    balance = 0.0
    kept = 0.0
    scale = 0.0
    account = np.zeros((4, B))
    varying = len(run.f) > 1 or len(run.f_θ) > 0 or len(springs.law) > 0
    for i in range(n):
        found.q[i, 0] = abs(run.q[0, i])
        found.v[i, 0] = abs(run.v[0, i])
    for i in range(nc):
        any_feedthrough = any_feedthrough or kinds.feedthrough[i]
    while first < steps:
        m = min(B, steps - first)
        at = read_block(run, impulses, first, m, at, rows)
        rows.power[:] = 0.0
        rows.stored[:] = 0.0
        judge_kinematics(run, nodes, first, m, θ, rows, found)
        if varying:
            read_loads(run, first, m, θ, rows)
        follow_gaps(contacts, m, rows, found)
        if len(contacts.paths) > 0:
            judge_paths(contacts, m, rows, found)
        for i in range(nc):
            if kinds.feedthrough[i]:
                follow_feedthrough(contacts, i, m, θ, rows)
            if kinds.plain[i]:
                judge_velocity_level(contacts, i, m, rows, kinds, found)
        add_work(run, nodes, contacts.B, first, m, θ, rows)
        if any_feedthrough:
            reach = judge_feedthrough(run, first, m, θ, reach, rows, kinds, found)
        add_springs(nodes, springs, m, θ, rows)
        rows.lost[:] = 0.0
        if θ > 0.5:
            add_own_losses(nodes, springs, m, θ, rows)
        stored = rows.stored
        h = rows.h
        power = rows.power
        change = rows.work[0]
        lost = rows.lost
        scale = max(scale, abs(stored[0]))
        for s in range(m):
            change[s] = stored[s + 1] - stored[s] - h[s] * power[s]
        for s in range(m):
            kept += change[s] + lost[s]
            lost[s] = kept
            balance += change[s]
            change[s] = balance
        for s in range(m):
            account[3, s] = max(account[3, s], -lost[s])
            account[0, s] = max(account[0, s], abs(change[s]))
            account[1, s] = max(account[1, s], abs(stored[s + 1]))
            account[2, s] = max(account[2, s], h[s])
        integrate(run, varying, m, rows, block, integrals)
        block += 1
        first += m
    return largest(account[0]), largest(account[3]), max(scale, largest(account[1])), largest(account[2])
