r"""Non-linear springs within a θ-step: Newton's method around the LCP.

Spring j pushes with s_j = F_j(y_j), y = N w the rate at which its ends part: with the approach δ_θ = δ - θ h y at t_θ,

.. math:: F(y) = K δ_θ^n (1 - b y), \qquad
          F'(y) = -θ h K n δ_θ^{n-1} (1 - b y) - b K δ_θ^n \qquad (δ_θ > 0),

and zero where δ_θ <= 0. The velocities are w = w_free + G r + G_s s with G_s = A⁻¹ Nᵀ, so the linearised law
s = F + J (y⁺ - y) and y⁺ = N w⁺ give s = s_0 + S r, and what is left is the LCP with the matrix W + H G_s S.
"""

from __future__ import annotations

import numpy as np

from lcpimpact.arrays import Array
from lcpimpact.compiled import compiled
from lcpimpact.errors import Status
from lcpimpact.integrators.law import SPRINGS_SIGNATURE, solve_law
from lcpimpact.lcp.lapack import lu_solve
from lcpimpact.lcp.solver import Kernel

SOLVED, NON_FINITE = int(Status.SOLVED), int(Status.NON_FINITE)
NEWTON, SINGULAR = int(Status.NEWTON), int(Status.SINGULAR)

MAX_NEWTON = 50
NEWTON_TOL = 1e-12
"""How near s must come to F(y), relative to the largest spring force."""


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
    y: Array,
    s: Array,
) -> tuple[int, int, int, float]:
    """Solve the step's law and springs together: z holds r, y and s are a guess on entry and the answer on return.

    HGs (nc, ns), NG (ns, nc), NGs (ns, ns) couple rows and springs; law (ns, 4) holds gap, K, n, b. Returns the status,
    the LCP iterations, the Newton iterations, and the LCP's residual.
    """
    ns, nc = len(y), len(b)
    s_0, S = np.empty(ns), np.empty((ns, nc))
    F, J = np.empty(ns), np.empty(ns)
    W_s, b_s, system, column = np.empty((nc, nc)), np.empty(nc), np.empty((ns, ns)), np.empty(ns)
    total, residual = 0, 0.0
    for newton in range(MAX_NEWTON + 1):
        error, scale = 0.0, 0.0
        for j in range(ns):
            _, K, n, loss = law[j]
            δ_θ = δ[j] - θh * y[j]
            F[j] = J[j] = 0.0
            if δ_θ > 0.0:
                power = K * δ_θ ** (n - 1.0)
                F[j] = power * δ_θ * (1.0 - loss * y[j])
                J[j] = -θh * n * power * (1.0 - loss * y[j]) - loss * power * δ_θ
            error = max(error, abs(F[j] - s[j]))
            scale = max(scale, abs(F[j]))
        if not error < np.inf:
            return NON_FINITE, total, newton, residual
        if newton > 0 and error <= NEWTON_TOL * scale:
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
    return NEWTON, total, MAX_NEWTON, residual
