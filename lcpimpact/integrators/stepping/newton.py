r"""Non-linear springs within a θ-step: Newton's method around the LCP.

Spring j pushes with s_j = F_j(δ_θ, y), y = N w the rate of separation of its ends and δ_θ = δ - θ h y the penetration at
t_θ; the law is the mean force of `lcpimpact.scheme.power_law`, with δ' = -y. Along a step

.. math:: J = \frac{dF}{dy} = \frac{∂F}{∂y} - θ h \frac{∂F}{∂δ} .

The velocities are w = w_free + G r + G_s s with G_s = A⁻¹ Nᵀ, so the linearised law s = F + J (y⁺ - y) and y⁺ = N w⁺ give
s = s_0 + S r, and what is left is the LCP with the matrix W + H G_s S.

Newton's method may cycle for laws with kinks. But if forces decrease with y, the step minimises a convex function of w,
whose slope from one iterate to the next is

.. math:: φ'(t) = r \cdot H \dot w + (s - F) \cdot \dot y \;\text{ at }\; r + t \dot r, \; s + t \dot s, \; y + t \dot y .

So after some full steps a line search limits φ' from above.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import types

from lcpimpact.arrays import Array
from lcpimpact.compiled import compiled, f8, matrix, named_tuple, vector
from lcpimpact.errors import Status
from lcpimpact.integrators.stepping.law import (
    PROBLEM,
    SPRING_SIGNATURE,
    SPRINGS,
    ContactProblem,
    Solving,
    Springs,
    solve_law,
)
from lcpimpact.lcp.lapack import lu_solve
from lcpimpact.scheme.power_law import mean_force

SOLVED, NON_FINITE = int(Status.SOLVED), int(Status.NON_FINITE)
NEWTON, SINGULAR = int(Status.NEWTON), int(Status.SINGULAR)

MAX_NEWTON = 60

FULL_STEPS = 6
"""Newton iterations before the line search starts."""

NEWTON_TOL = 1e-12
"""Tolerance of s - F(y), relative to the largest spring force."""

ROUNDING = 8.0 * np.finfo(np.float64).eps
"""Rounding error of y, relative to its summands; times J it bounds the accuracy of F(y)."""


class Iterate(NamedTuple):
    """The iterate of Newton's method: z of the rows, forces s and rates y of the springs."""

    z: Array
    s: Array
    y: Array


ITERATE: Any = named_tuple((vector, vector, vector), Iterate)


@compiled(f8(matrix, SPRINGS, vector, ITERATE, ITERATE))
def line_search(W: Array, springs: Springs, δ: Array, old: Iterate, new: Iterate) -> float:
    """Return the step length t in (0, 1] to the new iterate: halved until φ'(t) is at most half of -φ'(0)."""
    dz, ds, dy = new.z - old.z, new.s - old.s, new.y - old.y
    nc, ns = len(dz), len(ds)
    dw = np.zeros(nc)
    for i in range(nc):
        for c in range(nc):
            dw[i] += W[i, c] * dz[c]
        for j in range(ns):
            dw[i] += springs.HGs[i, j] * ds[j]
    first, t = 0.0, 0.0
    while True:
        slope = 0.0
        for i in range(nc):
            slope += (old.z[i] + t * dz[i]) * dw[i]
        for j in range(ns):
            rate = old.y[j] + t * dy[j]
            _, K, n, b, c = springs.law[j]
            F, _, _ = mean_force(K, n, b, c, δ[j] - springs.θh * rate, -rate, springs.h)
            slope += (old.s[j] + t * ds[j] - F) * dy[j]
        if t == 0.0:
            if not slope < 0.0:
                return 1.0
            first, t = slope, 1.0
        elif slope <= -0.5 * first or t < 1e-6:
            return t
        else:
            t *= 0.5


@compiled(types.UniTuple(f8, 3)(SPRINGS, vector, vector, vector, vector, vector, vector))
def linearise(
    springs: Springs, y_free: Array, δ: Array, s: Array, y: Array, F: Array, J: Array
) -> tuple[float, float, float]:
    """Write F and J at y; return the largest |F - s|, the largest |F|, and the rounding of F."""
    error, scale, rounding = 0.0, 0.0, 0.0
    for j in range(len(y)):
        _, K, n, b, c = springs.law[j]
        F[j], by_δ, by_rate = mean_force(K, n, b, c, δ[j] - springs.θh * y[j], -y[j], springs.h)
        J[j] = -by_rate - springs.θh * by_δ
        size = abs(y_free[j]) + abs(y[j])
        for i in range(len(y)):
            size += abs(springs.NGs[j, i] * s[i])
        error = max(error, abs(F[j] - s[j]))
        scale = max(scale, abs(F[j]))
        rounding = max(rounding, abs(J[j]) * size)
    return error, scale, rounding


@compiled(types.boolean(SPRINGS, vector, vector, vector, vector, vector, matrix))
def eliminate_springs(springs: Springs, y_free: Array, y: Array, F: Array, J: Array, s_0: Array, S: Array) -> bool:
    """Write s_0 and S of the linearised law s = s_0 + S z; return whether its matrix is regular."""
    ns, nc = S.shape
    system, column = np.empty((ns, ns)), np.empty(ns)
    for c in range(nc + 1):
        for i in range(ns):
            for j in range(ns):
                system[i, j] = (1.0 if i == j else 0.0) - J[i] * springs.NGs[i, j]
            column[i] = F[i] + J[i] * (y_free[i] - y[i]) if c == nc else J[i] * springs.NG[i, c]
        if not lu_solve(system, column):
            return False
        if c == nc:
            s_0[:] = column
        else:
            S[:, c] = column
    return True


@compiled(types.void(PROBLEM, matrix, vector, matrix, matrix, vector), inline="always", allocates=False)
def add_springs(rows: ContactProblem, HGs: Array, s_0: Array, S: Array, W_s: Array, q_s: Array) -> None:
    """Write W_s and q_s of the LCP in which the springs push with s_0 + S z."""
    for i in range(len(q_s)):
        q_s[i] = rows.q[i]
        for j in range(len(s_0)):
            q_s[i] += HGs[i, j] * s_0[j]
        for c in range(len(q_s)):
            W_s[i, c] = rows.W[i, c]
            for j in range(len(s_0)):
                W_s[i, c] += HGs[i, j] * S[j, c]


@compiled(SPRING_SIGNATURE)
def solve_with_springs(
    rows: ContactProblem, springs: Springs, y_free: Array, δ: Array, z: Array, y: Array, s: Array, solving: Solving
) -> tuple[int, int, int, float]:
    """Solve the rows and the springs together: z, y and s are a guess on entry and the answer on return.

    Returns the status, the LCP iterations, the Newton iterations, and the LCP's residual.
    """
    ns, nc = len(y), len(z)
    s_0, S, F, J = np.empty(ns), np.empty((ns, nc)), np.empty(ns), np.empty(ns)
    W_s, q_s = np.empty((nc, nc)), np.empty(nc)
    total, residual, t = 0, 0.0, 1.0
    for newton in range(MAX_NEWTON + 1):
        error, scale, rounding = linearise(springs, y_free, δ, s, y, F, J)
        if not error < np.inf:
            return NON_FINITE, total, newton, residual
        if newton > 0 and t == 1.0 and error <= NEWTON_TOL * scale + ROUNDING * rounding:
            return SOLVED, total, newton, residual
        if not eliminate_springs(springs, y_free, y, F, J, s_0, S):
            return SINGULAR, total, newton, residual
        add_springs(rows, springs.HGs, s_0, S, W_s, q_s)
        old = Iterate(z.copy(), s.copy(), y.copy())
        if nc > 0:
            status, count, residual = solve_law(ContactProblem(W_s, q_s, rows.lower, rows.upper), z, solving)
            total += count
            if status != SOLVED:
                return status, total, newton, residual
        for j in range(ns):
            s[j] = s_0[j]
            for c in range(nc):
                s[j] += S[j, c] * z[c]
        for i in range(ns):
            y[i] = y_free[i]
            for j in range(ns):
                y[i] += springs.NGs[i, j] * s[j]
            for c in range(nc):
                y[i] += springs.NG[i, c] * z[c]
        if newton >= FULL_STEPS:
            t = line_search(rows.W, springs, δ, old, Iterate(z, s, y))
            if t < 1.0:
                z[:] = old.z + t * (z - old.z)
                s[:] = old.s + t * (s - old.s)
                y[:] = old.y + t * (y - old.y)
    return NEWTON, total, MAX_NEWTON, residual
