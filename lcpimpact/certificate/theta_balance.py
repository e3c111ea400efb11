r"""Energy balance and laws of θ-steps, whose forces balance at t + θ h, summed over a run in one compiled loop.

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

from typing import Any, NamedTuple

import numpy as np
from numba import types

from lcpimpact.arrays import Array, Flags, Indices, Places
from lcpimpact.compiled import compiled, f8, flags, i8, indices, matrix, named_tuple, places, vector
from lcpimpact.scheme.power_law import mean_force, spring_energy, spring_force
from lcpimpact.scheme.terms import RowLaw

MASSIVE, DRIVEN, DAMPED, FREE = 1, 2, 0, -1
"""Kinds of nodes: with mass, prescribed, massless with dashpots, massless with springs only."""

CONTACT, SLIDER, FRICTION, JOINT, RELAY = range(len(RowLaw))

CHECK_INTERVAL = 16
"""Number of steps between checks of the sums over a run: an imbalance of them persists."""

CLOSED_GAP_RTOL = 1e-12
"""Penetration, relative to the terms of the gap, below which a contact is closed."""


class SparsityPattern(NamedTuple):
    """Sparsity pattern in compressed rows: the first entry of each row (rows + 1,), and the column of each entry."""

    starts: Places
    columns: Places


class Nodes(NamedTuple):
    """The nodes of a system: the values of M, C and K in one sparse pattern, and their kinds (n,)."""

    pattern: SparsityPattern
    M: Array
    C: Array
    K: Array
    kind: Indices


class Contacts(NamedTuple):
    """The contacts of a system.

    Attributes
    ----------
    pattern, H                          the constraint matrix by its pattern and values
    B : (n, nc), D : (nc, nc) arrays    directions of the reactions at the nodes, and compliance of the gaps
    u0, e, r_min, r_max : (nc,) arrays  gaps at q = 0, restitution, bounds of the reactions
    degree : (nc,) array                relative degrees
    law : (nc,) array                   laws, by their position in `RowLaw`
    mu, mu_s, normal : (nc,) arrays     kinetic and static coefficients of friction, and the rows of the normal forces
    paths : (np, nc) array              impulse paths over massless nodes
    """

    pattern: SparsityPattern
    H: Array
    B: Array
    D: Array
    u0: Array
    e: Array
    r_min: Array
    r_max: Array
    degree: Indices
    law: Indices
    mu: Array
    mu_s: Array
    normal: Indices
    paths: Array


class SpringLaws(NamedTuple):
    """The non-linear springs of a system: their directions N (ns, n), and gap, K, n, b, c of each (ns, 5)."""

    N: Array
    law: Array


class Recorded(NamedTuple):
    """Recorded run, and its forces.

    Attributes
    ----------
    t, q, v, r      t (nt,), q and v (nt, n), and r (nt - 1, nc)
    f               the loads (nt, n), or one row if constant
    f_θ             the forces of any kind at t_θ, q_θ and v_θ of each step (nt - 1, n); no rows if there are none
    """

    t: Array
    q: Array
    v: Array
    r: Array
    f: Array
    f_θ: Array


class Impulses(NamedTuple):
    """The impulses P (ni,) of a run in the order of their steps, with the step and the row of each."""

    step: Indices
    row: Indices
    P: Array


class Violations(NamedTuple):
    """Largest violations of a run.

    Attributes
    ----------
    product, penetration, tension, law : (nc,)  complementarity in J, penetration in m, reactions beyond their bounds in N,
                                                and violation of the impact law in m/s
    r, gap_change : (nc,) arrays                the largest |r| and |u⁺ - u|
    momentum, equilibrium, kinematics : (n,)    imbalance of momentum in N s, of impulse at massless nodes in N s, and
                                                difference between displacement and integrated velocity in m
    q, v : (n,) arrays                          the largest |q| and |v|
    """

    product: Array
    penetration: Array
    tension: Array
    law: Array
    r: Array
    gap_change: Array
    momentum: Array
    equilibrium: Array
    kinematics: Array
    q: Array
    v: Array


class Sums(NamedTuple):
    """Sums carried from step to step, and work arrays.

    Attributes
    ----------
    q_integral, load_impulse : (n,)     ∫ q_θ dt, and the impulses of loads and non-linear springs since the start
    impulse : (nc,) array               ∫ r dt since the start
    gap, rate : (nc,) arrays            u and U at the start of the step
    w : (n,) array                      the mean velocity of the step
    total : (nc,) array                 the mean forces of the step, including impulses
    path_pushes, on_path : (nc,) flags  contacts of active impulse paths, and contacts of any impulse path
    feedthrough : (nc,) flags           rows in which D is not zero
    of_step : (4, nc) array             products at t + θ h and at t + h, and penetrations there, in rows with a feedthrough
    """

    q_integral: Array
    load_impulse: Array
    impulse: Array
    gap: Array
    rate: Array
    w: Array
    total: Array
    path_pushes: Flags
    on_path: Flags
    feedthrough: Flags
    of_step: Array


SPARSITY: Any = named_tuple((places, places), SparsityPattern)
NODES: Any = named_tuple((SPARSITY, vector, vector, vector, indices), Nodes)
CONTACTS: Any = named_tuple(
    (SPARSITY, vector, matrix, matrix, *(vector,) * 4, indices, indices, vector, vector, indices, matrix), Contacts
)
SPRING_LAWS: Any = named_tuple((matrix, matrix), SpringLaws)
RECORDED: Any = named_tuple((vector, matrix, matrix, matrix, matrix, matrix), Recorded)
IMPULSES: Any = named_tuple((indices, indices, vector), Impulses)
VIOLATIONS: Any = named_tuple((vector,) * 11, Violations)
SUMS: Any = named_tuple((vector,) * 7 + (flags,) * 3 + (matrix,), Sums)


def no_violations(nc: int, n: int) -> Violations:
    """Return zero violations of nc contacts and n nodes."""
    return Violations(*np.zeros((6, nc)), *np.zeros((5, n)))


def sums_for(contacts: Contacts, n: int) -> Sums:
    """Return the sums at the start of a run."""
    nc = len(contacts.u0)
    w, q_integral, load_impulse = np.zeros((3, n))
    impulse, gap, rate, total = np.zeros((4, nc))
    on_path = np.asarray((contacts.paths != 0.0).any(axis=0))
    feedthrough = np.asarray((contacts.D != 0.0).any(axis=1) & ~(contacts.law == RELAY))
    return Sums(
        q_integral=q_integral, load_impulse=load_impulse, impulse=impulse, gap=gap, rate=rate, w=w, total=total,
        path_pushes=np.zeros(nc, bool), on_path=on_path, feedthrough=feedthrough, of_step=np.zeros((4, nc)),
    )  # fmt: skip


@compiled(f8(SPARSITY, vector, i8, vector), inline="always", allocates=False)
def row_of(pattern: SparsityPattern, values: Array, i: int, x: Array) -> float:
    """Return the product of row i of a sparse matrix with x."""
    sum_ = 0.0
    for p in range(pattern.starts[i], pattern.starts[i + 1]):
        sum_ += values[p] * x[pattern.columns[p]]
    return sum_


@compiled(f8(vector), inline="always", allocates=False)
def largest(values: Array) -> float:
    """Return the largest |value|."""
    found = 0.0
    for i in range(len(values)):
        found = max(found, abs(values[i]))
    return found


@compiled(f8(SPRING_LAWS, vector), inline="always", allocates=False)
def spring_energies(springs: SpringLaws, q: Array) -> float:
    """Return the energy stored in the non-linear springs in J."""
    stored = 0.0
    for a in range(len(springs.law)):
        δ = -springs.law[a, 0]
        for j in range(len(q)):
            δ -= springs.N[a, j] * q[j]
        stored += spring_energy(springs.law[a, 1], springs.law[a, 2], δ)
    return stored


@compiled(types.void(CONTACTS, f8, vector, vector, SUMS, vector))
def judge_paths(contacts: Contacts, h: float, before: Array, after: Array, sums: Sums, product: Array) -> None:
    """Judge the impulse paths over massless nodes in a step, with v before and after it.

    If all contacts of a path are active, the impact law holds for their sum. Marks the contacts of such paths.
    """
    nc, paths, force, path_pushes = len(contacts.u0), contacts.paths, sums.total, sums.path_pushes
    through, ρ, U, U_after = np.empty(len(paths)), np.zeros(nc), np.zeros(nc), np.zeros(nc)
    for i in range(nc):
        path_pushes[i] = False
        U[i] = row_of(contacts.pattern, contacts.H, i, before)
        U_after[i] = row_of(contacts.pattern, contacts.H, i, after)
    for a in range(len(paths)):
        least, opening, approach = np.inf, 0.0, 0.0
        for i in range(nc):
            if paths[a, i] > 0.0:
                least, opening, approach = min(least, force[i]), opening + U[i], approach + min(U[i], 0.0)
        through[a] = max(least, 0.0)
        for i in range(nc):
            if paths[a, i] > 0.0 and least > 0.0:
                path_pushes[i] = True
                if opening < 0.0:
                    ρ[i] = max(ρ[i], opening / approach)
    for a in range(len(paths)):
        path_defect = 0.0
        for i in range(nc):
            if paths[a, i] > 0.0:
                path_defect += U_after[i] + contacts.e[i] * ρ[i] * min(U[i], 0.0)
        for i in range(nc):
            if paths[a, i] > 0.0:
                product[i] = max(product[i], h * through[a] * abs(path_defect))


@compiled(types.void(RECORDED, NODES, i8, f8, SUMS, VIOLATIONS), inline="always", allocates=False)
def judge_kinematics(run: Recorded, nodes: Nodes, k: int, θ: float, sums: Sums, found: Violations) -> None:
    """Judge the kinematics of step k, write w, and update ∫ q_θ dt and the impulses of the loads."""
    h = run.t[k + 1] - run.t[k]
    per_h = 1.0 / h
    for i in range(len(sums.w)):
        w = (run.q[k + 1, i] - run.q[k, i]) * per_h
        rate_θ = run.v[k + 1, i]
        if nodes.kind[i] == MASSIVE:
            rate_θ = (1.0 - θ) * run.v[k, i] + θ * rate_θ
        elif nodes.kind[i] == DRIVEN:
            rate_θ = w
        if nodes.kind[i] != FREE and h * abs(w - rate_θ) > found.kinematics[i]:
            found.kinematics[i] = h * abs(w - rate_θ)
        sums.w[i] = w
        sums.q_integral[i] += h * (run.q[k, i] + θ * h * rate_θ)
        if len(run.f) > 1:
            sums.load_impulse[i] += h * ((1.0 - θ) * run.f[k, i] + θ * run.f[k + 1, i])
        if len(run.f_θ) > 0:
            sums.load_impulse[i] += h * run.f_θ[k, i]


@compiled(f8(CONTACTS, i8, f8, vector, f8, SUMS, VIOLATIONS), inline="always", allocates=False)
def product_of_impact(contacts: Contacts, i: int, h: float, q: Array, U: float, sums: Sums, found: Violations) -> float:
    """Judge the impact law of a contact with rate U after a step from q, and return its product in J."""
    before = sums.rate[i]
    impact_defect = U + contacts.e[i] * before
    if sums.path_pushes[i]:
        return 0.0
    ahead = sums.gap[i] + 0.5 * h * before
    if sums.total[i] > 0.0:
        found.law[i] = max(found.law[i], abs(impact_defect))
    elif ahead < 0.0 and impact_defect < 0.0:
        terms = abs(contacts.u0[i])
        for p in range(contacts.pattern.starts[i], contacts.pattern.starts[i + 1]):
            terms += abs(contacts.H[p] * q[contacts.pattern.columns[p]])
        if ahead < -CLOSED_GAP_RTOL * terms:
            found.law[i] = max(found.law[i], -impact_defect)
    product: float = h * sums.total[i] * impact_defect
    return product


@compiled(f8(RECORDED, CONTACTS, i8, i8, f8, SUMS, VIOLATIONS), inline="always", allocates=False)
def judge_contact(run: Recorded, contacts: Contacts, i: int, k: int, θ: float, sums: Sums, found: Violations) -> float:
    """Judge the laws of a contact in step k, and return the power of its mean force."""
    h, force, r_max = run.t[k + 1] - run.t[k], sums.total[i], contacts.r_max[i]
    u, U, W = contacts.u0[i], 0.0, 0.0
    for p in range(contacts.pattern.starts[i], contacts.pattern.starts[i + 1]):
        H, column = contacts.H[p], contacts.pattern.columns[p]
        u += H * run.q[k + 1, column]
        U += H * run.v[k + 1, column]
        W += H * sums.w[column]
    gap = u
    # A contact penetrates by up to h |U| of the step before it closes, which is more than h |W|.
    found.gap_change[i] = max(found.gap_change[i], h * abs(W), h * abs(U))
    found.r[i] = max(found.r[i], abs(run.r[k, i]))
    if contacts.law[i] == FRICTION:
        normal = max(sums.total[contacts.normal[i]], 0.0)
        r_max = contacts.mu[i] * normal
        found.tension[i] = max(found.tension[i], abs(force) - contacts.mu_s[i] * normal)
    elif force < contacts.r_min[i] or force > r_max:
        found.tension[i] = max(found.tension[i], contacts.r_min[i] - force, force - r_max)
    if sums.feedthrough[i]:
        for j in range(len(sums.gap)):
            u += contacts.D[i, j] * run.r[k, j]
        u_θ = u - (1.0 - θ) * h * W
        sums.of_step[0, i], sums.of_step[1, i] = abs(force * u_θ), abs(force * u)
        sums.of_step[2, i], sums.of_step[3, i] = -u_θ, -u
        if contacts.law[i] == JOINT:
            sums.of_step[2, i], sums.of_step[3, i] = abs(u_θ), abs(u)
    if contacts.law[i] == RELAY:
        product = 0.0
    elif contacts.law[i] == SLIDER or contacts.law[i] == FRICTION:
        slip = U + contacts.e[i] * sums.rate[i] if contacts.degree[i] == 2 else W
        product = h * (r_max * abs(slip) + force * slip)
    elif sums.feedthrough[i]:
        product = 0.0
    elif contacts.law[i] == JOINT:
        product = 0.0
        found.penetration[i] = max(found.penetration[i], abs(u))
        found.law[i] = max(found.law[i], abs(U) if contacts.degree[i] == 2 else 0.0)
    else:
        found.penetration[i] = max(found.penetration[i], -u)
        product = force * u
        if contacts.degree[i] == 2:
            product = product_of_impact(contacts, i, h, run.q[k], U, sums, found)
        if sums.on_path[i]:
            product = 0.0 if sums.path_pushes[i] else max(product, 0.0)
    found.product[i] = max(found.product[i], abs(product))
    sums.gap[i], sums.rate[i] = gap, U
    power: float = force * W
    return power


@compiled(f8(RECORDED, i8, f8, f8, SUMS, VIOLATIONS), inline="always", allocates=False)
def judge_feedthrough(run: Recorded, k: int, θ: float, reach: float, sums: Sums, found: Violations) -> float:
    """Judge the rows with a feedthrough, at t + θ h or at t + h; return the largest penetration so far."""
    of_step, h, n = sums.of_step, run.t[k + 1] - run.t[k], len(sums.w)
    product_θ, product, open_θ, open_end = largest(of_step[0]), largest(of_step[1]), -np.inf, -np.inf
    for i in range(len(sums.gap)):
        open_θ, open_end = max(open_θ, of_step[2, i]), max(open_end, of_step[3, i])
    reach = max(reach, largest(of_step[3]))
    rounding = CLOSED_GAP_RTOL * reach * largest(found.r)
    at_end = product_θ > max(rounding, product) or (
        product_θ <= rounding and open_θ > max(CLOSED_GAP_RTOL * reach, open_end)
    )
    if at_end:
        for i in range(n):
            sums.q_integral[i] += h * (1.0 - θ) * h * sums.w[i]
            if len(run.f) > 1:
                sums.load_impulse[i] += h * (1.0 - θ) * (run.f[k + 1, i] - run.f[k, i])
    level = 1 if at_end else 0
    for i in range(len(sums.gap)):
        found.product[i] = max(found.product[i], of_step[level, i])
        found.penetration[i] = max(found.penetration[i], of_step[2 + level, i])
    return reach


@compiled(f8(RECORDED, NODES, SPRING_LAWS, i8, f8, SUMS), inline="always", allocates=False)
def spring_power(run: Recorded, nodes: Nodes, springs: SpringLaws, k: int, θ: float, sums: Sums) -> float:
    """Return the power that non-linear springs dissipate or extract at prescribed motions in step k; add their impulses."""
    h, n, power = run.t[k + 1] - run.t[k], len(sums.w), 0.0
    for a in range(len(springs.law)):
        K, exponent, b, c = springs.law[a, 1], springs.law[a, 2], springs.law[a, 3], springs.law[a, 4]
        δ, opening_rate = -springs.law[a, 0], 0.0
        for j in range(n):
            δ -= springs.N[a, j] * (run.q[k, j] + θ * h * sums.w[j])
            opening_rate += springs.N[a, j] * sums.w[j]
        force, _, _ = mean_force(K, exponent, b, c, δ, -opening_rate, h)
        elastic_force, _, _ = spring_force(K, exponent, b, c, δ, 0.0)
        power += (force - elastic_force) * opening_rate
        for j in range(n):
            sums.load_impulse[j] += h * springs.N[a, j] * force
            if nodes.kind[j] == DRIVEN:
                power -= springs.N[a, j] * force * sums.w[j]
    return power


@compiled(types.UniTuple(f8, 2)(RECORDED, NODES, i8, f8, SUMS), inline="always", allocates=False)
def work_and_energy(run: Recorded, nodes: Nodes, k: int, θ: float, sums: Sums) -> tuple[float, float]:
    """Return the power of loads and dashpots in step k, and the energy of masses and linear springs after it."""
    power, stored, varying = 0.0, 0.0, len(run.f) > 1
    for i in range(len(sums.w)):
        inertia, elastic, damping = 0.0, 0.0, 0.0
        for p in range(nodes.pattern.starts[i], nodes.pattern.starts[i + 1]):
            j = nodes.pattern.columns[p]
            inertia += nodes.M[p] * run.v[k + 1, j]
            elastic += nodes.K[p] * run.q[k + 1, j]
            damping += nodes.C[p] * sums.w[j]
        if nodes.kind[i] == DRIVEN:
            power += sums.w[i] * (θ * elastic + (1.0 - θ) * row_of(nodes.pattern, nodes.K, i, run.q[k]))
        else:
            load = (1.0 - θ) * run.f[k, i] + θ * run.f[k + 1, i] if varying else run.f[0, i]
            if len(run.f_θ) > 0:
                load += run.f_θ[k, i]
            power += sums.w[i] * (load - damping)
        stored += 0.5 * (run.v[k + 1, i] * inertia + run.q[k + 1, i] * elastic)
    return power, stored


@compiled(types.void(RECORDED, NODES, matrix, i8, SUMS, VIOLATIONS), inline="always", allocates=False)
def judge_momentum(run: Recorded, nodes: Nodes, B: Array, k: int, sums: Sums, found: Violations) -> None:
    """Judge the balance of momentum and impulses of each node from the start to the end of step k."""
    elapsed = run.t[k + 1] - run.t[0]
    for i in range(len(sums.w)):
        found.q[i], found.v[i] = max(found.q[i], abs(run.q[k + 1, i])), max(found.v[i], abs(run.v[k + 1, i]))
        if nodes.kind[i] == DRIVEN:
            continue
        defect = -sums.load_impulse[i] if len(run.f) > 1 else -sums.load_impulse[i] - run.f[0, i] * elapsed
        for p in range(nodes.pattern.starts[i], nodes.pattern.starts[i + 1]):
            j = nodes.pattern.columns[p]
            defect += nodes.M[p] * (run.v[k + 1, j] - run.v[0, j])
            defect += nodes.C[p] * (run.q[k + 1, j] - run.q[0, j]) + nodes.K[p] * sums.q_integral[j]
        for j in range(len(sums.impulse)):
            defect -= B[i, j] * sums.impulse[j]
        violations = found.momentum if nodes.kind[i] == MASSIVE else found.equilibrium
        if not abs(defect) <= violations[i]:
            violations[i] = abs(defect) if abs(defect) < np.inf else np.inf


@compiled(
    types.UniTuple(f8, 3)(RECORDED, IMPULSES, f8, NODES, CONTACTS, SPRING_LAWS, SUMS, VIOLATIONS), allocates=False
)
def certify_steps(
    run: Recorded,
    impulses: Impulses,
    θ: float,
    nodes: Nodes,
    contacts: Contacts,
    springs: SpringLaws,
    sums: Sums,
    found: Violations,
) -> tuple[float, float, float]:
    """Judge all steps of a run: write the violations; return the energy imbalance, its scale and the longest h.

    Massless nodes between springs may be projected after the step; their v is the mean of the step.
    """
    n, nc, last, at = len(sums.w), len(contacts.u0), len(run.t) - 2, 0
    drives, any_feedthrough = False, False
    stored, reach, balance, largest_imbalance, longest = 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(n):
        drives = drives or nodes.kind[i] == DRIVEN
        inertia = row_of(nodes.pattern, nodes.M, i, run.v[0])
        elastic = row_of(nodes.pattern, nodes.K, i, run.q[0])
        stored += 0.5 * (run.v[0, i] * inertia + run.q[0, i] * elastic)
        found.q[i], found.v[i] = abs(run.q[0, i]), abs(run.v[0, i])
    for i in range(nc):
        any_feedthrough = any_feedthrough or sums.feedthrough[i]
        sums.gap[i] = contacts.u0[i] + row_of(contacts.pattern, contacts.H, i, run.q[0])
        sums.rate[i] = row_of(contacts.pattern, contacts.H, i, run.v[0])
    stored += spring_energies(springs, run.q[0])
    scale = abs(stored)
    for k in range(last + 1):
        h, power = run.t[k + 1] - run.t[k], 0.0
        longest = max(longest, h)
        judge_kinematics(run, nodes, k, θ, sums, found)
        for i in range(nc):
            sums.total[i] = run.r[k, i]
            sums.impulse[i] += h * run.r[k, i]
        while at < len(impulses.P) and impulses.step[at] == k:
            sums.total[impulses.row[at]] += impulses.P[at] / h
            sums.impulse[impulses.row[at]] += impulses.P[at]
            at += 1
        if len(contacts.paths) > 0:
            judge_paths(contacts, h, run.v[k], run.v[k + 1], sums, found.product)
        for i in range(nc):
            power += judge_contact(run, contacts, i, k, θ, sums, found)
            if drives:
                for j in range(n):
                    if nodes.kind[j] == DRIVEN:
                        power -= sums.total[i] * contacts.B[j, i] * sums.w[j]
        if any_feedthrough:
            reach = judge_feedthrough(run, k, θ, reach, sums, found)
        power += spring_power(run, nodes, springs, k, θ, sums)
        work, after = work_and_energy(run, nodes, k, θ, sums)
        after += spring_energies(springs, run.q[k + 1])
        balance += after - stored - h * (power + work)
        largest_imbalance, scale, stored = max(largest_imbalance, abs(balance)), max(scale, abs(after)), after
        if k % CHECK_INTERVAL == CHECK_INTERVAL - 1 or k == last:
            judge_momentum(run, nodes, contacts.B, k, sums, found)
    return largest_imbalance, scale, longest
