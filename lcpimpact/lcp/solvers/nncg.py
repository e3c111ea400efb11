"""The nonsmooth nonlinear conjugate gradient method: projected Gauss-Seidel sweeps there and back, accelerated.

It needs the rows of M alone and no factor, so it serves sparse M whose factors would not fit in memory.
"""

from __future__ import annotations

import numpy as np

from lcpimpact.arrays import Matrix, Vector
from lcpimpact.compiled import compiled
from lcpimpact.errors import Status
from lcpimpact.lcp.judge import holds, measure
from lcpimpact.lcp.operators import Property
from lcpimpact.lcp.solver import CompiledSolver
from lcpimpact.lcp.solvers.psor import recedes
from lcpimpact.lcp.storage import diagonal, product, row_product
from lcpimpact.lcp.trace import NONE, note

SOLVED, RAY = int(Status.SOLVED), int(Status.RAY)
UNDECIDED = int(Status.UNDECIDED)
MAX_ITER = int(Status.MAX_ITER)

CHECK_INTERVAL = 16
"""Number of iterations between checks of the residual; a check costs about two sweeps."""


@compiled()
def sweep(W: Matrix, d: Vector, q: Vector, lower: Vector, upper: Vector, z: Vector) -> None:
    """Set z_i <- P(z_i - (M z + q)_i / M_ii) in ascending and then in descending order of the rows; d = diag(M)."""
    n = len(q)
    for k in range(2 * n):
        i = k if k < n else 2 * n - 1 - k
        z[i] = min(max(z[i] - (row_product(W, i, z) + q[i]) / d[i], lower[i]), upper[i])


@compiled(most=0)
def nncg(W: Matrix, q: Vector, lower: Vector, upper: Vector, z: Vector, tol: float, max_iter: int) -> tuple[int, int]:
    r"""Take the step s of a sweep there and back, and then β p, projected, with p the sum of the steps before.

    .. math:: z^+ = P(z + s + \beta p), \qquad p^+ = s + \beta p, \qquad
              \beta = \frac{\|s\|_D^2}{\|s^-\|_D^2}, \quad D = diag(M)

    (Fletcher and Reeves), with p = 0 when β > 1. Sweeps in both directions make s the gradient of the free rows times a
    symmetric matrix, as conjugate gradients need: a sweep in one direction takes several times as many. Repeating steps may
    certify infeasibility.
    """
    n = len(q)
    d = np.empty(n)
    s = np.empty(n)
    p = np.zeros(n)
    w = np.empty(n)
    basis = np.empty(n, np.int64)
    diagonal(W, d)
    for i in range(n):
        z[i] = min(max(z[i], lower[i]), upper[i])
    mark, before = z.copy(), 0.0
    for step in range(1, max_iter + 1):
        s[:] = z
        sweep(W, d, q, lower, upper, z)
        length = 0.0
        for i in range(n):
            s[i] = z[i] - s[i]
            length += d[i] * s[i] * s[i]
        if not length < np.inf:
            return UNDECIDED, step
        if step % CHECK_INTERVAL == 1 or step == max_iter or length == 0.0:
            for i in range(n):
                basis[i] = n + i if lower[i] < z[i] < upper[i] else i
            note(z, basis, NONE, NONE)
            scaled, _, rounding = measure(W, q, lower, upper, z, w)
            if holds(scaled, rounding, tol):
                return SOLVED, step
            if length == 0.0:
                return UNDECIDED, step
            for i in range(n):
                mark[i] = z[i] - mark[i]
            product(W, mark, w)
            if recedes(q, lower, upper, d, mark, w):
                z[:] = mark
                return RAY, step
            mark[:] = z
        beta = length / before if length <= before else 0.0
        before = length
        for i in range(n):
            p[i] = s[i] + beta * p[i]
            z[i] = min(max(z[i] + p[i] - s[i], lower[i]), upper[i])
    return MAX_ITER, max_iter


SOLVER = CompiledSolver(
    name="nncg",
    summary="nonsmooth nonlinear conjugate gradients: sweeps there and back, for large sparse M without factors",
    requires=(Property.SYMMETRIC, Property.POSITIVE_DIAGONAL),
    storages=("dense", "banded", "sparse"),
    boxed=True,
    tol=1e-10,
    max_iter=20_000,
    source="SilcowitzNiebeErleben2010",
    kernel=nncg,
)
