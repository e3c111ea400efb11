r"""Mehrotra's predictor-corrector method for monotone problems: through the inside of the box, not along its edges.

Each finite bound is a side c of its row i, with the sign σ = 1 below and -1 above, a slack s = σ (z_i - bound) and a force
λ, both kept positive. As μ falls to zero the path

.. math:: M z + q = \sum_c \sigma_c \lambda_c e_{i(c)}, \qquad s_c \lambda_c = \mu

leads to a solution, in a number of iterations that hardly grows with n.
"""

from __future__ import annotations

import numpy as np
from numba import types

from lcpimpact.arrays import Array
from lcpimpact.compiled import compiled, f8, matrix, vector
from lcpimpact.errors import Status
from lcpimpact.lcp.judge import proves_infeasible
from lcpimpact.lcp.lapack import EPS, cholesky_solve, lu_solve
from lcpimpact.lcp.operators import Property
from lcpimpact.lcp.problem import FREE, LOWER, SIGNATURE, UPPER
from lcpimpact.lcp.solver import CompiledSolver
from lcpimpact.lcp.solvers.newton_fb import UNKNOWN, identified, scale
from lcpimpact.lcp.storage import is_symmetric, product
from lcpimpact.lcp.trace import NONE, note

SOLVED, RAY, UNDECIDED, MAX_ITER = int(Status.SOLVED), int(Status.RAY), int(Status.UNDECIDED), int(Status.MAX_ITER)

PREDICTOR, CORRECTOR, CENTRING = 0, 1, 2

LOWEST = 0.01
"""Share of μ by which a full step must lower it."""

SHORTEST = 1e-10
"""Least length of a step."""

LARGEST = 1e25
"""Scaled size from which an iterate is taken to have left for infinity."""

LEAST = 1e-60
"""Least μ: what rounding leaves cannot be cut further."""


@compiled(types.boolean(types.boolean, matrix, vector, matrix, vector, vector))
def factor_solve(definite: bool, N: Array, barrier: Array, A: Array, unit: Array, d: Array) -> bool:
    """Overwrite d with K⁻¹ d, K = N + diag(barrier), and A with the factor of K in units of its diagonal.

    A barrier of inf fixes its row: d_i = 0. A rounding is added to the diagonal, so that redundant rows do no harm.
    """
    n = len(d)
    for i in range(n):
        size = N[i, i] + barrier[i]
        unit[i] = 1.0 / np.sqrt(size) if size > 0.0 else 1.0
        d[i] *= unit[i]
    for i in range(n):
        for j in range(n):
            A[i, j] = N[i, j] * unit[i] * unit[j]
        if barrier[i] == np.inf:
            A[i, i] = 1.0
        else:
            A[i, i] = (N[i, i] + barrier[i]) * unit[i] * unit[i] + 16.0 * n * EPS
    regular = cholesky_solve(A, d) if definite else lu_solve(A, d)
    for i in range(n):
        d[i] *= unit[i]
    return regular


@compiled(types.void(matrix, vector, vector))
def solve_again(U: Array, unit: Array, d: Array) -> None:
    """Overwrite d with K⁻¹ d for the Cholesky factor that `factor_solve` left."""
    n = len(d)
    for k in range(n):
        d[k] = d[k] * unit[k]
    for k in range(n):
        d[k] /= U[k, k]
        for j in range(k + 1, n):
            d[j] -= U[k, j] * d[k]
    for k in range(n - 1, -1, -1):
        for j in range(k + 1, n):
            d[k] -= U[k, j] * d[j]
        d[k] /= U[k, k]
    for k in range(n):
        d[k] *= unit[k]


@compiled(f8(vector, vector, f8))
def room(x: Array, d: Array, most: float) -> float:
    """Return the largest length <= most for which x + length d >= 0."""
    for c in range(len(x)):
        if x[c] + most * d[c] < 0.0:
            most = x[c] / -d[c]
    return most


@compiled(f8(vector, vector, vector, vector, f8))
def mean_product(s: Array, force: Array, ds: Array, df: Array, length: float) -> float:
    """Return the mean of the products s λ after a step of that length."""
    total = 0.0
    for c in range(len(s)):
        total += (s[c] + length * ds[c]) * (force[c] + length * df[c])
    return total / max(len(s), 1)


@compiled(SIGNATURE)
def interior_point(
    W: Array, q: Array, lower: Array, upper: Array, z: Array, tol: float, max_iter: int
) -> tuple[int, int]:
    """Predict how far μ would fall, aim as low as that allows, and correct for what the linear model left out.

    Once the equation holds to within μ each step must lower μ. Where M is far from symmetric this one may not; then it aims
    at half of μ, is not corrected, and is made short enough.

    The problem is first scaled to a unit diagonal and max |q| = 1. Each iteration factors M + diag(Σ λ/s), for symmetric M
    once for both steps. The guess is only looked at: the method starts inside the box near z = 0. Once two iterates agree on
    the free rows these are tried as a basis. Without a solution the iterates leave for infinity, as a rule along a ray that
    proves it.
    """
    n = len(q)
    N, A, p, low, high, unit = np.empty((n, n)), np.empty((n, n)), np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    x, r, d, barrier, diagonal, w = np.empty(n), np.empty(n), np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    row, sign, start = np.empty(2 * n, np.int64), np.empty(2 * n), np.empty(2 * n)
    basis, side, last, tried = np.empty(n, np.int64), np.empty(n, np.int64), np.full(n, UNKNOWN), np.full(n, UNKNOWN)
    nearest = np.empty(n)
    definite = is_symmetric(W)
    scale(W, q, lower, upper, N, p, low, high, unit)
    count = 0
    for i in range(n):
        z[i] = min(max(z[i], lower[i]), upper[i])
        side[i] = LOWER if z[i] <= lower[i] else UPPER if z[i] >= upper[i] else FREE
        below, above = low[i] > -np.inf, high[i] < np.inf
        inside = min(1.0, 0.5 * (high[i] - low[i]))
        x[i] = min(max(0.0, low[i] + inside), high[i] - inside)
        if below and low[i] < high[i]:
            row[count], sign[count], start[count] = i, 1.0, max(x[i] - low[i], inside)
            count += 1
        if above and low[i] < high[i]:
            row[count], sign[count], start[count] = i, -1.0, max(high[i] - x[i], inside)
            count += 1
    if identified(W, q, lower, upper, side, last, tried, z, tol):
        return SOLVED, 1
    s, force, ds, df = start[:count].copy(), np.empty(count), np.zeros(count), np.zeros(count)
    for c in range(count):
        force[c] = 1.0 / max(s[c], 1.0)
    length = 1.0
    for step in range(1, max_iter + 1):
        product(N, x, r)
        size, error = 0.0, 0.0
        for i in range(n):
            r[i] += p[i]
            side[i] = LOWER if low[i] == high[i] else FREE
            z[i] = x[i] * unit[i]
            nearest[i] = np.inf
            size = max(size, abs(x[i]))
        mu = mean_product(s, force, ds, df, 0.0)
        for c in range(count):
            i = row[c]
            r[i] -= sign[c] * force[c]
            if force[c] > s[c]:
                side[i] = LOWER if sign[c] > 0.0 else UPPER
            if s[c] < nearest[i]:
                # Where z is next to its bound the slack is the more exact of the two.
                nearest[i] = s[c]
                z[i] = (lower[i] if sign[c] > 0.0 else upper[i]) + sign[c] * s[c] * unit[i]
        for i in range(n):
            z[i] = min(max(z[i], lower[i]), upper[i])
            basis[i] = n + i if side[i] == FREE else i
            if low[i] < high[i]:
                error = max(error, abs(r[i]))
        note(z, basis, NONE, NONE)
        if identified(W, q, lower, upper, side, last, tried, z, tol):
            return SOLVED, step
        if not size < LARGEST or (count > 0 and not mu > LEAST) or not length > SHORTEST:
            return UNDECIDED, step

        target, correction, after = 0.0, 0.0, 0.0
        for attempt in (PREDICTOR, CORRECTOR, CENTRING):
            for i in range(n):
                fixed = low[i] == high[i]
                d[i], barrier[i] = 0.0 if fixed else -r[i], np.inf if fixed else 0.0
            for c in range(count):
                i = row[c]
                barrier[i] += force[c] / s[c]
                d[i] += sign[c] * ((target - correction * ds[c] * df[c]) / s[c] - force[c])
            if attempt != PREDICTOR and definite:
                solve_again(A, diagonal, d)
            elif not factor_solve(definite, N, barrier, A, diagonal, d):
                return UNDECIDED, step
            for c in range(count):
                change = sign[c] * d[row[c]]
                df[c] = (target - correction * ds[c] * df[c] - force[c] * change) / s[c] - force[c]
                ds[c] = change
            length = min(1.0, max(0.995, 1.0 - mu) * room(s, ds, room(force, df, 2.0)))
            after = mean_product(s, force, ds, df, length)
            if attempt == CORRECTOR and (error > mu or after <= (1.0 - LOWEST * length) * mu):
                break
            ratio = after / mu if mu > 0.0 else 0.0
            target, correction = (mu * ratio * ratio * ratio, 1.0) if attempt == PREDICTOR else (0.5 * mu, 0.0)
        while error <= mu and after > (1.0 - LOWEST * length) * mu and length > SHORTEST:
            length *= 0.5
            after = mean_product(s, force, ds, df, length)
        for c in range(count):
            s[c] += length * ds[c]
            force[c] += length * df[c]
        for i in range(n):
            x[i] += length * d[i]
            w[i] = d[i] * unit[i]
        # In both units: M as it is given may have rows that look like rounding there.
        if proves_infeasible(N, p, low, high, d) and proves_infeasible(W, q, lower, upper, w):
            z[:] = w
            return RAY, step
    return MAX_ITER, max_iter


SOLVER = CompiledSolver(
    name="interior-point",
    summary="Mehrotra predictor-corrector: few iterations at any n, for semidefinite M, not only symmetric",
    requires=(Property.PSD,),
    storages=("dense",),
    boxed=True,
    tol=1e-10,
    max_iter=100,
    source="Mehrotra (1992); Wright (1997), chapter 10",
    kernel=interior_point,
)
