r"""The law of rows with friction in a step: as an LCP, or at once where each row stays open, sticks or slips as before.

In such a *case* the friction of a slipping row is P_T = ±μ P_N, and the law is a linear system in the other impulses.
"""

from __future__ import annotations

import math

import numpy as np
from numba import types

from lcpimpact.arrays import Array, Indices
from lcpimpact.compiled import compiled, f8, i8, indices, vector
from lcpimpact.integrators.stepping.law import PROBLEM, SOLVING, ContactProblem, Solving, solve_law
from lcpimpact.lcp.friction import FRICTION, FrictionRows, friction_maps, unknowns
from lcpimpact.lcp.lapack import EPS, lu_solve

STICK_RTOL = 1e-9
"""Distance of |P_T| from μ P_N, relative to it, below which a row slips."""


@compiled(FRICTION(FRICTION, indices))
def active_friction(friction: FrictionRows, active: Indices) -> FrictionRows:
    """Return the active rows with friction, by their positions among the active rows."""
    rows, normals = np.full(len(friction.rows), -1), np.full(len(friction.rows), -1)
    for k in range(len(rows)):
        for a in range(len(active)):
            if active[a] == friction.rows[k]:
                rows[k] = a
            elif active[a] == friction.normals[k]:
                normals[k] = a
    kept = rows >= 0
    return FrictionRows(rows[kept], normals[kept], friction.mu[kept], friction.formulation, friction.continues)


@compiled(types.Tuple((i8, i8, f8))(PROBLEM, FRICTION, vector, SOLVING))
def solve_with_friction(
    rows: ContactProblem, friction: FrictionRows, P: Array, solving: Solving
) -> tuple[int, int, float]:
    """Solve a contact problem of which some rows have friction, from the guess P: status, iterations, residual."""
    if len(friction.rows) == 0:
        return solve_law(rows, P, solving)
    E, T, V, lower, upper = friction_maps(rows.W, rows.lower, rows.upper, friction)
    z = unknowns(T, P, friction)
    status, count, residual = solve_law(ContactProblem(E @ rows.W @ T + V, E @ rows.q, lower, upper), z, solving)
    P[:] = T @ z
    return status, count, residual


@compiled(f8(PROBLEM, indices, FRICTION, vector, vector))
def solve_same_case(rows: ContactProblem, active: Indices, friction: FrictionRows, P: Array, z: Array) -> float:
    """Solve the law of the active rows for z, each in its case in P; return the residual, infinite if a case has changed.

    It is the largest |w_i| of a row that has to be zero, relative to its terms; inequalities hold up to rounding.
    """
    W, q, lower, upper = rows
    n, k = len(active), 0
    free, normal = np.empty(n, np.int64), np.full(n, -1)
    slope, limit = np.zeros(n), np.zeros(n)
    for a in range(n):
        i = active[a]
        z[a] = min(max(P[i], lower[i]), upper[i])
        is_free = lower[i] < P[i] < upper[i]
        for c in range(len(friction.rows)):
            if friction.rows[c] == i:
                P_N, limit[a] = P[friction.normals[c]], friction.mu[c]
                for d in range(n):
                    if active[d] == friction.normals[c]:
                        normal[a] = d
                is_free = abs(P[i]) < (1.0 - STICK_RTOL) * limit[a] * P_N
                slope[a] = 0.0 if is_free or not P_N > 0.0 else math.copysign(limit[a], P[i])
                z[a] = 0.0
        if is_free:
            free[k], z[a] = a, 0.0
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
                if slope[a] != 0.0 and normal[a] == free[d]:
                    A[c, d] += slope[a] * W[i, active[a]]
    if k > 0 and not lu_solve(A, b):
        return np.inf
    for c in range(k):
        z[free[c]] = b[c]
    for a in range(n):
        if slope[a] != 0.0:
            z[a] = slope[a] * z[normal[a]]
    residual, c = 0.0, 0
    for a in range(n):
        i = active[a]
        w, terms = q[i], abs(q[i])
        for d in range(n):
            w += W[i, active[d]] * z[d]
            terms += abs(W[i, active[d]] * z[d])
        rounding = 4.0 * n * EPS * terms
        if c < k and free[c] == a:
            c += 1
            low, high = lower[i], upper[i]
            if normal[a] >= 0:
                high = limit[a] * z[normal[a]]
                low = -high
            if not low <= z[a] <= high:
                return np.inf
            residual = max(residual, abs(w) / terms if terms > 0.0 else 0.0)
        elif normal[a] >= 0:
            if slope[a] * w > rounding * limit[a]:
                return np.inf
        elif (z[a] == lower[i] and w < -rounding) or (z[a] == upper[i] and w > rounding):
            return np.inf
    return residual
