"""Accelerated projected gradient descent (Nesterov) with restarts, as in granular codes."""

from __future__ import annotations

import numpy as np

from lcpimpact.arrays import Matrix, Vector
from lcpimpact.compiled import compiled
from lcpimpact.errors import Status
from lcpimpact.lcp.judge import holds, measure
from lcpimpact.lcp.operators import Property
from lcpimpact.lcp.solver import CompiledSolver
from lcpimpact.lcp.solvers.psor import CHECK_INTERVAL, recedes
from lcpimpact.lcp.storage import diagonal, product
from lcpimpact.lcp.trace import NONE, note

SOLVED = int(Status.SOLVED)
RAY = int(Status.RAY)
MAX_ITER = int(Status.MAX_ITER)


@compiled()
def start(W: Matrix, q: Vector, lower: Vector, upper: Vector, z: Vector, d: Vector) -> bool:
    """Set d = diag(M), and z_i for rows with M_ii = 0; return False, with z a ray, if such a row has no solution.

    Such a row of a semidefinite M is zero, so w_i = q_i; its d_i is set to the largest M_ii.
    """
    diagonal(W, d)
    widest = 0.0
    for i in range(len(d)):
        widest = max(widest, d[i])
    for i in range(len(d)):
        z[i] = min(max(z[i], lower[i]), upper[i])
        if not d[i] > 0.0:
            if q[i] != 0.0:
                z[i] = lower[i] if q[i] > 0.0 else upper[i]
            if not abs(z[i]) < np.inf:
                z[:] = 0.0
                z[i] = -1.0 if q[i] > 0.0 else 1.0
                return False
            d[i] = widest if widest > 0.0 else 1.0
    return True


@compiled(most=0)
def apgd(W: Matrix, q: Vector, lower: Vector, upper: Vector, z: Vector, tol: float, max_iter: int) -> tuple[int, int]:
    r"""Take projected gradient steps from an extrapolated point y, v = M y + q, in the metric of D = diag(M).

    .. math:: z^+ = P(y - D^{-1} v / L), \qquad y^+ = z^+ + \beta (z^+ - z)

    L is increased until sᵀ M s <= L sᵀ D s for the step s, and β restarts from 0 when a step opposes the previous one.
    Each iteration needs one product; the gradients at z and y are updated by linear combination. Repeating steps may
    certify infeasibility.
    """
    n = len(q)
    d = np.empty(n)
    y = np.empty(n)
    v = np.empty(n)
    w = np.empty(n)
    s = np.empty(n)
    g = np.empty(n)
    basis = np.empty(n, np.int64)
    if not start(W, q, lower, upper, z, d):
        return RAY, 1
    mark = z.copy()
    product(W, z, w)
    for i in range(n):
        w[i] += q[i]
        y[i], v[i] = z[i], w[i]
    L, theta = 1.0, 1.0
    for step in range(1, max_iter + 1):
        while True:
            length, curvature = 0.0, 0.0
            for i in range(n):
                s[i] = min(max(y[i] - v[i] / (L * d[i]), lower[i]), upper[i]) - y[i]
                length += d[i] * s[i] * s[i]
            product(W, s, g)
            for i in range(n):
                curvature += s[i] * g[i]
            if not curvature > L * length > 0.0:
                break
            L = 1.1 * max(L, curvature / length)
        turn = 0.0
        for i in range(n):
            new = y[i] + s[i]
            turn -= d[i] * s[i] * (new - z[i])
            basis[i] = n + i if lower[i] < new < upper[i] else i
        following = 0.5 * (np.sqrt(theta * theta + 4.0) - theta) * theta
        beta = 0.0 if turn > 0.0 else theta * (1.0 - theta) / (theta * theta + following)
        theta = 1.0 if turn > 0.0 else following
        for i in range(n):
            new, gradient = y[i] + s[i], v[i] + g[i]
            y[i] = new + beta * (new - z[i])
            v[i] = gradient + beta * (gradient - w[i])
            z[i], w[i] = min(max(new, lower[i]), upper[i]), gradient
        L *= 0.9 if turn > 0.0 else 1.0
        note(z, basis, NONE, NONE)
        if step % CHECK_INTERVAL == 1 or step == max_iter:
            scaled, _, rounding = measure(W, q, lower, upper, z, g)
            if holds(scaled, rounding, tol):
                return SOLVED, step
            for i in range(n):
                s[i] = z[i] - mark[i]
                mark[i] = z[i]
                # Both gradients are recomputed to remove accumulated rounding errors.
                v[i] += g[i] - w[i]
                w[i] = g[i]
            product(W, s, g)
            if recedes(q, lower, upper, d, s, g):
                z[:] = s
                return RAY, step
    return MAX_ITER, max_iter


SOLVER = CompiledSolver(
    name="apgd",
    summary="accelerated projected gradient: needs products with M alone; a baseline of granular codes",
    requires=(Property.SYMMETRIC, Property.PSD),
    storages=("dense", "banded", "sparse", "factored"),
    boxed=True,
    tol=1e-10,
    max_iter=20_000,
    source="Nesterov1983; MazharHeynNegrutTasora2015; ODonoghueCandes2015, for the restart",
    kernel=apgd,
)
