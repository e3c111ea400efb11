r"""The law of rows with friction in a step: as an LCP, or at once where each row stays open, sticks or slips as before.

In such a *case* the friction of a slipping row is P_T = ±μ P_N, and the law is a linear system in the other impulses.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from lcpimpact.arrays import Indices, Vector
from lcpimpact.compiled import compiled
from lcpimpact.integrators.stepping.law import ContactProblem, Solving, solve_law
from lcpimpact.lcp.friction import FrictionRows, friction_maps, unknowns
from lcpimpact.lcp.lapack import lu_solve
from lcpimpact.numerics.rounding import EPS

STICK_RTOL = 1e-9
"""Distance of |P_T| from μ P_N, relative to it, below which a row slips."""


@compiled()
def active_friction(friction: FrictionRows, active: Indices) -> FrictionRows:
    """Return the active rows with friction, by their positions among the active rows."""
    rows = np.full(len(friction.rows), -1)
    normals = np.full(len(friction.rows), -1)
    for k in range(len(rows)):
        for a in range(len(active)):
            if active[a] == friction.rows[k]:
                rows[k] = a
            elif active[a] == friction.normals[k]:
                normals[k] = a
    kept = rows >= 0
    return FrictionRows(rows[kept], normals[kept], friction.mu[kept], friction.formulation, friction.continues)


@compiled()
def solve_with_friction(
    rows: ContactProblem, friction: FrictionRows, P: Vector, solving: Solving
) -> tuple[int, int, float]:
    """Solve a contact problem of which some rows have friction, from the guess P: status, iterations, residual."""
    if len(friction.rows) == 0:
        return solve_law(rows, P, solving)
    E, T, V, lower, upper = friction_maps(rows.W, rows.lower, rows.upper, friction)
    z = unknowns(T, P, friction)
    status, count, residual = solve_law(ContactProblem(E @ rows.W @ T + V, E @ rows.q, lower, upper), z, solving)
    P[:] = T @ z
    return status, count, residual


class FrictionCase(NamedTuple):
    """The case of each active row: open or at a bound, free, sticking or slipping.

    Attributes
    ----------
    free : (na,) array          1 if its w is zero, as of a closed contact and of friction that sticks, else 0
    normal : (na,) array        position of the normal row of its friction among the active rows; -1 of other rows
    mu, slope : (na,) arrays    coefficient of friction, and P_T/P_N of a row that slips
    """

    free: Indices
    normal: Indices
    mu: Vector
    slope: Vector


@compiled()
def case_of(rows: ContactProblem, active: Indices, friction: FrictionRows, P: Vector, z: Vector) -> FrictionCase:
    """Return the case of the active rows in P, and write z of the rows at a bound; 0 of other rows."""
    n = len(active)
    counts, slopes = np.empty((2, n), np.int64), np.zeros((2, n))  # as two arrays, since each costs as much as a row
    case = FrictionCase(counts[0], counts[1], slopes[0], slopes[1])
    for a in range(n):
        i = active[a]
        case.free[a] = rows.lower[i] < P[i] < rows.upper[i]
        case.normal[a] = -1
        z[a] = 0.0 if case.free[a] else min(max(P[i], rows.lower[i]), rows.upper[i])
        for c in range(len(friction.rows)):
            if friction.rows[c] == i:
                P_N = P[friction.normals[c]]
                case.mu[a] = friction.mu[c]
                z[a] = 0.0
                for b in range(n):
                    if active[b] == friction.normals[c]:
                        case.normal[a] = b
                case.free[a] = abs(P[i]) < (1.0 - STICK_RTOL) * case.mu[a] * P_N
                if P_N > 0.0 and not case.free[a]:
                    case.slope[a] = math.copysign(case.mu[a], P[i])
    return case


@compiled()
def judge_case(rows: ContactProblem, active: Indices, case: FrictionCase, z: Vector) -> float:
    """Return the largest |w_i| of a free row, relative to its terms; infinite if an inequality of the case is violated."""
    W = rows.W
    q = rows.q
    lower = rows.lower
    upper = rows.upper
    residual, n = 0.0, len(active)
    for a in range(n):
        i = active[a]
        w = q[i]
        terms = abs(q[i])
        low = lower[i]
        high = upper[i]
        for b in range(n):
            w += W[i, active[b]] * z[b]
            terms += abs(W[i, active[b]] * z[b])
        if case.normal[a] >= 0:
            high = case.mu[a] * z[case.normal[a]]
            low = -high
        rounding = 4.0 * n * EPS * terms
        if case.free[a]:
            holds = low <= z[a] <= high
            residual = max(residual, abs(w) / terms if terms > 0.0 else 0.0)
        elif case.normal[a] >= 0:
            holds = case.slope[a] * w <= case.mu[a] * rounding
        else:
            holds = (z[a] != low or w >= -rounding) and (z[a] != high or w <= rounding)
        if not holds:
            return np.inf
    return residual


@compiled()
def solve_same_case(rows: ContactProblem, active: Indices, friction: FrictionRows, P: Vector, z: Vector) -> float:
    """Solve the law of the active rows for z, each in its case in P; return the residual, infinite if a case has changed."""
    W = rows.W
    q = rows.q
    n = len(active)
    case = case_of(rows, active, friction, P, z)
    free, k = np.empty(n, np.int64), 0
    for a in range(n):
        if case.free[a]:
            free[k] = a
            k += 1
    A, b = np.empty((k, k)), np.empty(k)
    for c in range(k):
        i = active[free[c]]
        b[c] = -q[i]
        for a in range(n):
            b[c] -= W[i, active[a]] * z[a]
        for d in range(k):
            A[c, d] = W[i, active[free[d]]]
            for a in range(n):
                if case.slope[a] != 0.0 and case.normal[a] == free[d]:
                    A[c, d] += case.slope[a] * W[i, active[a]]
    if k > 0 and not lu_solve(A, b):
        return np.inf
    for c in range(k):
        z[free[c]] = b[c]
    for a in range(n):
        if case.slope[a] != 0.0:
            z[a] = case.slope[a] * z[case.normal[a]]
    return judge_case(rows, active, case, z)
