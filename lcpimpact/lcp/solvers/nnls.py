r"""Non-negative least squares, by SciPy's implementation of Lawson and Hanson.

For definite M = Uᵀ U the LCP is min ‖U z + U⁻ᵀ q‖ over z >= 0. For semidefinite M = Bᵀ B it is the least-distance problem
min ½ ‖v‖² over w = Bᵀ v + q >= 0 with v = B z, which is

.. math:: \min_{u \ge 0} \left\| \begin{pmatrix} B \\ -q^T \end{pmatrix} u - \begin{pmatrix} 0 \\ 1 \end{pmatrix} \right\|,
          \qquad z = u / (1 + q^T u);

where its residual is zero, u certifies infeasibility: B u = 0 and q·u < 0.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from lcpimpact.arrays import Array
from lcpimpact.errors import Status
from lcpimpact.lcp.judge import proves_infeasible
from lcpimpact.lcp.operators import Delassus, Dense, Property
from lcpimpact.lcp.polish import polish
from lcpimpact.lcp.problem import FREE, LOWER
from lcpimpact.lcp.solver import Kernel, LCPSolver, SolverState

SOLVED = int(Status.SOLVED)
RAY = int(Status.RAY)
MAX_ITER = int(Status.MAX_ITER)


@dataclass(frozen=True, kw_only=True)
class NNLS(LCPSolver):
    """Non-negative least squares with a factor of M."""

    def init(self, M: Delassus) -> SolverState:
        """Scale M to a unit diagonal and factor it, by Cholesky or, if singular, by eigenvalues."""
        return SolverState(M.W, self._kernel(M), False, self.name)

    def _kernel(self, operator: Delassus, *, shift: float = 1e-13) -> Kernel:
        # shift: shift of q, in units of max |q|, against rounding of zero rows to negative values; removed for
        # the final basis.
        from scipy.linalg import solve_triangular
        from scipy.optimize import nnls

        M = operator.array()
        d = np.diag(M)
        unit = 1.0 / np.sqrt(np.where(d > 0.0, d, d.max() if d.max() > 0.0 else 1.0))
        N = M * unit[:, None] * unit
        B, definite = root(N)

        def kernel(
            W: Any, q: Array, lower: Array, upper: Array, z: Array, tol: float, max_iter: int
        ) -> tuple[int, int]:
            """Minimise the problem scaled to a unit diagonal and max |q| = 1."""
            if len(q) != operator.n:
                # A step with a subset of the contacts passes its own matrix.
                return self._kernel(Dense(W))(W, q, lower, upper, z, tol, max_iter)
            p = q * unit
            size = float(np.abs(p).max()) or 1.0
            p = p / size + shift
            A = B if definite else np.vstack([B, -p])
            b = -solve_triangular(B, p, trans="T") if definite else np.append(np.zeros(len(B)), 1.0)
            try:
                u, _ = nnls(A, b, maxiter=max_iter)
            except RuntimeError:
                z[:] = 0.0
                return MAX_ITER, max_iter
            rest = 1.0 if definite else 1.0 + float(p @ u)
            if rest <= shift or (not definite and proves_infeasible(N, p, lower, upper, u)):
                z[:] = u * unit
                return RAY, int(np.count_nonzero(u))
            z[:] = u * unit * (size / rest)
            polish(M, q, lower, upper, np.where(u > 0.0, FREE, LOWER), z, tol)
            return SOLVED, int(np.count_nonzero(u))

        return kernel


def root(N: Array) -> tuple[Array, bool]:
    """Return B with N = Bᵀ B, and whether it is the Cholesky factor of a definite N."""
    from scipy.linalg import cholesky

    B: Array
    try:
        B = cholesky(N)
        if np.diag(B).min() ** 2 > 1e-13 * len(N):
            return B, True
    except np.linalg.LinAlgError:
        pass
    values, vectors = np.linalg.eigh(N)
    kept = values > 1e-13 * len(N)
    B = (vectors[:, kept] * np.sqrt(values[kept])).T
    return B, False


SOLVER = NNLS(
    name="nnls",
    summary="non-negative least squares with a factor of M, by SciPy; a second opinion",
    requires=(Property.SYMMETRIC, Property.PSD),
    storages=("dense", "banded", "factored"),
    boxed=False,
    tol=1e-10,
    max_iter=10_000,
    source="LawsonHanson1995, chapter 23; Virtanen2020",
)
