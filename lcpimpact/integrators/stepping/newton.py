r"""Non-linear springs and dashpots within a θ-step: Newton's method around the LCP.

Spring j pushes with s_j = F_j(δ_θ, y), y = N w the rate of separation of its ends and δ_θ = δ - θ h y the penetration at
t_θ; the law is the mean force of `lcpimpact.scheme.power_law`, with δ' = -y, or of `lcpimpact.scheme.rate_law`. Along a step

.. math:: J = \frac{dF}{dy} = \frac{∂F}{∂y} - θ h \frac{∂F}{∂δ} .

The velocities are w = w_free + G r + G_s s with G_s = A⁻¹ Nᵀ, so the linearised law s = F + J (y⁺ - y) and y⁺ = N w⁺ give
s = s_0 + S r, and what is left is the LCP with the matrix W + H G_s S.

Newton's method may cycle for laws with kinks. But if forces decrease with y, the step minimises a convex function of w,
whose slope from one iterate to the next is

.. math:: φ'(t) = r \cdot H \dot w + (s - F) \cdot \dot y \;\text{ at }\; r + t \dot r, \; s + t \dot s, \; y + t \dot y .

So after some full steps a line search limits φ' from above.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lcpimpact.arrays import Matrix, Vector
from lcpimpact.compiled import compiled
from lcpimpact.errors import Status
from lcpimpact.integrators.stepping.law import (
    MAX_NEWTON,
    NEWTON_TOL,
    RATE_ROUNDING,
    ContactProblem,
    Solving,
    Springs,
    solve_law,
)
from lcpimpact.lcp.lapack import lu_solve
from lcpimpact.numerics.rounding import TINY
from lcpimpact.scheme.rate_law import law_at_rate, rate_on_graph

SOLVED = int(Status.SOLVED)
NON_FINITE = int(Status.NON_FINITE)
NEWTON, SINGULAR = int(Status.NEWTON), int(Status.SINGULAR)

FULL_STEPS = 6
"""Newton iterations before the line search starts."""


class Iterate(NamedTuple):
    """The iterate of Newton's method: z of the rows, forces s and rates y of the springs."""

    z: Vector
    s: Vector
    y: Vector


@compiled()
def line_search(W: Matrix, springs: Springs, δ: Vector, old: Iterate, new: Iterate) -> float:
    """Return the step length t in (0, 1] to the new iterate: halved until φ'(t) is at most half of -φ'(0)."""
    dz = new.z - old.z
    ds = new.s - old.s
    dy = new.y - old.y
    nc, ns = len(dz), len(ds)
    dw = np.zeros(nc)
    for i in range(nc):
        for k in range(nc):
            dw[i] += W[i, k] * dz[k]
        for j in range(ns):
            dw[i] += springs.room.HGs[i, j] * ds[j]
    first, t = 0.0, 0.0
    while True:
        slope = 0.0
        for i in range(nc):
            slope += (old.z[i] + t * dz[i]) * dw[i]
        for j in range(ns):
            rate = old.y[j] + t * dy[j]
            F, _ = law_at_rate(springs.law[j], δ[j], rate, springs.θh, springs.h, 0.0)
            slope += (old.s[j] + t * ds[j] - F) * dy[j]
        if t == 0.0:
            if not slope < 0.0:
                return 1.0
            first, t = slope, 1.0
        elif slope <= -0.5 * first or t < 1e-6:
            return t
        else:
            t *= 0.5


@compiled()
def linearise(
    springs: Springs, y_free: Vector, δ: Vector, s: Vector, y: Vector, F: Vector, J: Vector
) -> tuple[float, float, float]:
    """Write F and J at y, or at `rate_on_graph`; return of y the largest |F - s|, the largest |F|, and the rounding of F."""
    at = springs.room.vectors[7]
    error = 0.0
    scale = 0.0
    rounding = 0.0
    for j in range(len(y)):
        size = TINY + abs(y_free[j]) + abs(y[j])
        for i in range(len(y)):
            size += abs(springs.room.NGs[j, i] * s[i])
        F[j], J[j] = law_at_rate(springs.law[j], δ[j], y[j], springs.θh, springs.h, RATE_ROUNDING * size)
        error = max(error, abs(F[j] - s[j]))
        scale = max(scale, abs(F[j]))
        rounding = max(rounding, abs(J[j]) * size)
        at[j] = rate_on_graph(springs.law[j], δ[j], s[j], y[j], springs.θh, springs.h)
        if at[j] != y[j]:
            F[j], J[j] = law_at_rate(springs.law[j], δ[j], at[j], springs.θh, springs.h, RATE_ROUNDING * size)
    return error, scale, rounding


@compiled()
def eliminate_springs(springs: Springs, nc: int, y_free: Vector, F: Vector, J: Vector, s_0: Vector) -> bool:
    """Write s_0 and S of the linearised law s = s_0 + S z of nc rows; return whether its matrix is regular."""
    vectors = springs.room.vectors
    NG = springs.room.NG
    S = springs.room.S
    NGs = springs.room.NGs
    system = springs.room.system
    ns = len(y_free)
    column = vectors[6]
    at = vectors[7]
    for c in range(nc + 1):
        for i in range(ns):
            for j in range(ns):
                system[i, j] = (1.0 if i == j else 0.0) - J[i] * NGs[i, j]
            column[i] = F[i] + J[i] * (y_free[i] - at[i]) if c == nc else J[i] * NG[i, c]
        if not lu_solve(system, column):
            return False
        for i in range(ns):
            if c == nc:
                s_0[i] = column[i]
            else:
                S[i, c] = column[i]
    return True


@compiled()
def solve_rows(
    rows: ContactProblem, springs: Springs, s_0: Vector, z: Vector, solving: Solving
) -> tuple[int, int, float]:
    """Solve the rows in which the springs push with s_0 + S z: status, iterations, residual."""
    nc = len(z)
    HGs = springs.room.HGs
    S = springs.room.S
    W_s, q_s = np.empty((nc, nc)), np.empty(nc)
    for i in range(nc):
        q_s[i] = rows.q[i]
        for j in range(len(s_0)):
            q_s[i] += HGs[i, j] * s_0[j]
        for c in range(nc):
            W_s[i, c] = rows.W[i, c]
            for j in range(len(s_0)):
                W_s[i, c] += HGs[i, j] * S[j, c]
    return solve_law(ContactProblem(W_s, q_s, rows.lower, rows.upper), z, solving)


@compiled()
def solve_with_springs(
    rows: ContactProblem, springs: Springs, y_free: Vector, δ: Vector, z: Vector, y: Vector, s: Vector, solving: Solving
) -> tuple[int, int, int, float]:
    """Solve the rows and the springs together: z, y and s are a guess on entry and the answer on return.

    Returns the status, the LCP iterations, the Newton iterations, and the LCP's residual.
    """
    vectors = springs.room.vectors
    NG = springs.room.NG
    S = springs.room.S
    NGs = springs.room.NGs
    ns = len(y)
    nc = len(z)
    s_0 = vectors[3]
    F = vectors[4]
    J = vectors[5]
    old = Iterate(z, s, y)
    total = 0
    residual = 0.0
    t = 1.0
    for newton in range(MAX_NEWTON + 1):
        error, scale, rounding = linearise(springs, y_free, δ, s, y, F, J)
        if not error < np.inf:
            return NON_FINITE, total, newton, residual
        if newton > 0 and t == 1.0 and error <= NEWTON_TOL * scale + RATE_ROUNDING * rounding:
            return SOLVED, total, newton, residual
        if not eliminate_springs(springs, nc, y_free, F, J, s_0):
            return SINGULAR, total, newton, residual
        if newton >= FULL_STEPS:
            old = Iterate(z.copy(), s.copy(), y.copy())
        if nc > 0:
            status, count, residual = solve_rows(rows, springs, s_0, z, solving)
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
                y[i] += NGs[i, j] * s[j]
            for c in range(nc):
                y[i] += NG[i, c] * z[c]
        if newton >= FULL_STEPS:
            t = line_search(rows.W, springs, δ, old, Iterate(z, s, y))
            if t < 1.0:
                z[:] = old.z + t * (z - old.z)
                s[:] = old.s + t * (s - old.s)
                y[:] = old.y + t * (y - old.y)
    return NEWTON, total, MAX_NEWTON, residual
