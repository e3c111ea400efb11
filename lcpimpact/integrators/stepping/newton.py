r"""Non-linear springs within a θ-step: Newton's method around the LCP.

Spring j pushes with s_j = F_j(δ_θ, y), y = N w the rate at which its ends part and δ_θ = δ - θ h y their approach at t_θ;
the law is the mean force of `lcpimpact.scheme.power_law`, with δ' = -y. Along a step

.. math:: J = \frac{dF}{dy} = \frac{∂F}{∂y} - θ h \frac{∂F}{∂δ} .

The velocities are w = w_free + G r + G_s s with G_s = A⁻¹ Nᵀ, so the linearised law s = F + J (y⁺ - y) and y⁺ = N w⁺ give
s = s_0 + S r, and what is left is the LCP with the matrix W + H G_s S.

Laws with corners can send Newton's method round in a circle. But where forces fall with y, the step minimises a convex
function of w, whose slope along the way from one iterate to the next is

.. math:: φ'(t) = r \cdot H \dot w + (s - F) \cdot \dot y \;\text{ at }\; r + t \dot r, \; s + t \dot s, \; y + t \dot y .

So after some full steps a line search goes only as far as φ' is not large and positive.
"""

from __future__ import annotations

import numpy as np

from lcpimpact.arrays import Array
from lcpimpact.compiled import compiled, f8, matrix, vector
from lcpimpact.errors import Status
from lcpimpact.integrators.stepping.law import SPRINGS_SIGNATURE, solve_law
from lcpimpact.lcp.lapack import lu_solve
from lcpimpact.lcp.solver import Kernel
from lcpimpact.scheme.power_law import mean_force

SOLVED, NON_FINITE = int(Status.SOLVED), int(Status.NON_FINITE)
NEWTON, SINGULAR = int(Status.NEWTON), int(Status.SINGULAR)

MAX_NEWTON = 60

FULL_STEPS = 6
"""Newton iterations before the line search starts."""

NEWTON_TOL = 1e-12
"""How near s must come to F(y), relative to the largest spring force."""

ROUNDING = 8.0 * np.finfo(np.float64).eps
"""How far F(y) may be off where y is rounded, relative to J and the summands of y: no force is nearer to s than that."""


@compiled(
    f8(matrix, matrix, matrix, vector, f8, f8, vector, vector, vector, vector, vector, vector)
)  # fmt: skip
def line_search(
    W: Array,
    HGs: Array,
    law: Array,
    δ: Array,
    θh: float,
    h: float,
    z: Array,
    s: Array,
    y: Array,
    z_new: Array,
    s_new: Array,
    y_new: Array,
) -> float:
    """Return the step length t in (0, 1] to the new iterate: halved until φ'(t) is at most half of -φ'(0)."""
    nc, ns = len(z), len(s)
    ahead = np.zeros(nc)
    for i in range(nc):
        for c in range(nc):
            ahead[i] += W[i, c] * (z_new[c] - z[c])
        for j in range(ns):
            ahead[i] += HGs[i, j] * (s_new[j] - s[j])
    first, t = 0.0, 0.0
    while True:
        slope = 0.0
        for i in range(nc):
            slope += (z[i] + t * (z_new[i] - z[i])) * ahead[i]
        for j in range(ns):
            rate = y[j] + t * (y_new[j] - y[j])
            _, K_j, n_j, b_j, c_j = law[j]
            F, _, _ = mean_force(K_j, n_j, b_j, c_j, δ[j] - θh * rate, -rate, h)
            slope += (s[j] + t * (s_new[j] - s[j]) - F) * (y_new[j] - y[j])
        if t == 0.0:
            if not slope < 0.0:
                return 1.0
            first, t = slope, 1.0
        elif slope <= -0.5 * first or t < 1e-6:
            return t
        else:
            t *= 0.5


@compiled(SPRINGS_SIGNATURE)
def solve_with_springs(
    W: Array,
    b: Array,
    lower: Array,
    upper: Array,
    z: Array,
    gap: Array,
    plain: bool,
    tol: float,
    max_iter: int,
    solve: Kernel,
    HGs: Array,
    NG: Array,
    NGs: Array,
    y_free: Array,
    δ: Array,
    law: Array,
    θh: float,
    h: float,
    y: Array,
    s: Array,
) -> tuple[int, int, int, float]:
    """Solve the step's law and springs together: z holds r, y and s are a guess on entry and the answer on return.

    HGs (nc, ns), NG (ns, nc), NGs (ns, ns) couple rows and springs; law (ns, 5) holds gap, K, n, b, c. Returns the status,
    the LCP iterations, the Newton iterations, and the LCP's residual.
    """
    ns, nc = len(y), len(b)
    s_0, S = np.empty(ns), np.empty((ns, nc))
    F, J = np.empty(ns), np.empty(ns)
    W_s, b_s, system, column = np.empty((nc, nc)), np.empty(nc), np.empty((ns, ns)), np.empty(ns)
    z_old, s_old, y_old = np.empty(nc), np.empty(ns), np.empty(ns)
    total, residual, t = 0, 0.0, 1.0
    for newton in range(MAX_NEWTON + 1):
        error, scale, rounding = 0.0, 0.0, 0.0
        for j in range(ns):
            _, K_j, n_j, b_j, c_j = law[j]
            F[j], by_δ, by_rate = mean_force(K_j, n_j, b_j, c_j, δ[j] - θh * y[j], -y[j], h)
            J[j] = -by_rate - θh * by_δ
            error = max(error, abs(F[j] - s[j]))
            scale = max(scale, abs(F[j]))
            size = abs(y_free[j]) + abs(y[j])
            for i in range(ns):
                size += abs(NGs[j, i] * s[i])
            rounding = max(rounding, abs(J[j]) * size)
        if not error < np.inf:
            return NON_FINITE, total, newton, residual
        if newton > 0 and t == 1.0 and error <= NEWTON_TOL * scale + ROUNDING * rounding:
            return SOLVED, total, newton, residual
        for c in range(nc + 1):
            for i in range(ns):
                for j in range(ns):
                    system[i, j] = (1.0 if i == j else 0.0) - J[i] * NGs[i, j]
                column[i] = F[i] + J[i] * (y_free[i] - y[i]) if c == nc else J[i] * NG[i, c]
            if not lu_solve(system, column):
                return SINGULAR, total, newton, residual
            if c == nc:
                s_0[:] = column
            else:
                S[:, c] = column
        for i in range(nc):
            b_s[i] = b[i]
            for j in range(ns):
                b_s[i] += HGs[i, j] * s_0[j]
            for c in range(nc):
                W_s[i, c] = W[i, c]
                for j in range(ns):
                    W_s[i, c] += HGs[i, j] * S[j, c]
        z_old[:], s_old[:], y_old[:] = z, s, y
        if nc > 0:
            status, count, residual = solve_law(W_s, b_s, lower, upper, z, gap, plain, tol, max_iter, solve)
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
            t = line_search(W, HGs, law, δ, θh, h, z_old, s_old, y_old, z, s, y)
            if t < 1.0:
                z[:] = z_old + t * (z - z_old)
                s[:] = s_old + t * (s - s_old)
                y[:] = y_old + t * (y - y_old)
    return NEWTON, total, MAX_NEWTON, residual
