"""Block principal pivoting for sparse LCPs of many contacts, which factors the free rows only when they change.

All rows of the wrong sign are exchanged at once; where that does not reduce their number, one at a time by the largest
index, which ends for a P-matrix (Murty). In time steps the free rows of the last step are often those of the next, so that
a step costs one product and one solve with factors that are known.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from lcpimpact.arrays import Array, Flags, Indices
from lcpimpact.errors import Status
from lcpimpact.lcp.lapack import EPS
from lcpimpact.lcp.solvers.block_pivoting import PATIENCE

MAX_PIVOTS = 500
"""Default limit of exchanges, each of which may cost a factorisation."""

ROUNDING = 16.0 * EPS
"""Rounding error of a row, relative to the sum of its terms."""

Solve = Callable[[Array], Array]


class SparseContacts(ABC):
    """The matrix W of the contacts of a sparse system; factors of its last free rows are kept."""

    def __init__(self) -> None:
        self._free: Indices | None = None
        self._solve: Solve | None = None

    @abstractmethod
    def product(self, z: Array) -> Array:
        """Return W z."""

    @abstractmethod
    def terms(self, z: Array) -> Array:
        """Return the sum of the |terms| of each row of W z, for z >= 0, or a bound of it."""

    @abstractmethod
    def factor(self, free: Indices) -> Solve:
        """Return the function that solves with the free rows and columns of W.

        Raises
        ------
        RuntimeError
            If they are singular.
        """

    def solver(self, free: Indices) -> Solve:
        """Return `factor` of the free rows, from memory where they are those of the last call."""
        if self._solve is None or self._free is None or not np.array_equal(free, self._free):
            self._solve, self._free = self.factor(free), free
        return self._solve


class SparseMatrix(SparseContacts):
    """W itself, symmetric and sparse, as where A is diagonal."""

    def __init__(self, W: Any) -> None:
        super().__init__()
        self.W, self.absolute = W.tocsr(), abs(W).tocsr()

    def product(self, z: Array) -> Array:
        """Return W z."""
        return np.asarray(self.W @ z)

    def terms(self, z: Array) -> Array:
        """Return |W| z."""
        return np.asarray(self.absolute @ z)

    def factor(self, free: Indices) -> Solve:
        """Factor the free block in an order for symmetric matrices."""
        solve: Solve = splu(self.W[free][:, free].tocsc(), permc_spec="MMD_AT_PLUS_A").solve
        return solve


class SparseProduct(SparseContacts):
    """W = L A⁻¹ B with sparse L, A and B, which has no zeros: it is never formed.

    The free block of W is solved with the sparse matrix of the forces and the velocities together.
    """

    def __init__(self, L: Any, A: Any, B: Any) -> None:
        super().__init__()
        self.L, self.A, self.B = L.tocsr(), A.tocsc(), B.tocsr()
        self.solve_A: Solve = splu(self.A).solve
        diagonal = self.A.diagonal()
        self._of_w = sparse.diags_array(1.0 / np.sqrt(diagonal))
        part = (self.L @ sparse.diags_array(1.0 / diagonal)).multiply(self.B.T)
        self._of_z = 1.0 / np.sqrt(np.asarray(part.sum(axis=1)).ravel())

    def product(self, z: Array) -> Array:
        """Return L A⁻¹ B z."""
        return np.asarray(self.L @ self.solve_A(self.B @ z))

    def terms(self, z: Array) -> Array:
        """Return |L| |A⁻¹ |B| z|, which bounds the terms where A⁻¹ has no negative entry, as for springs and dashpots."""
        return np.asarray(abs(self.L) @ np.abs(self.solve_A(abs(self.B) @ z)))

    def factor(self, free: Indices) -> Solve:
        """Factor A w - B z = 0, L w = q in the free rows, in units of w and z in which the entries are near 1."""
        n, unit = self.A.shape[0], self._of_z[free]
        scaled, D = sparse.diags_array(unit), self._of_w
        B, L = D @ self.B.tocsc()[:, free] @ scaled, scaled @ self.L[free] @ D
        solve = splu(sparse.block_array([[D @ self.A @ D, -B], [L, None]]).tocsc()).solve
        return lambda q: np.asarray(unit * solve(np.concatenate([np.zeros(n), unit * q]))[n:])


def pivot(W: SparseContacts, q: Array, active: Flags, z: Array, tol: float, max_iter: int) -> tuple[Status, int, float]:
    """Solve 0 <= z ⟂ W z + q >= 0 in the active rows, with z = 0 in the others, from the guess z, which is overwritten.

    Free at first are the active rows with z > 0 or q < 0, or all if none has z > 0.

    Returns
    -------
    status, iterations : Status, int
    residual : float
        Largest natural residual of a row, relative to the sum of its terms, computed from W and q after the solution.
    """
    free, fewest, patience = active & ((z > 0.0) | (q < 0.0)), len(q) + 1, PATIENCE
    if not (z > 0.0).any():
        free = active.copy()
    for step in range(1, max_iter + 1):
        rows = np.flatnonzero(free)
        z[:] = 0.0
        try:
            if len(rows):
                solve = W.solver(rows)
                z[rows] = solve(-q[rows])
                z[rows] -= solve((W.product(z) + q)[rows])
        except RuntimeError:
            return Status.SINGULAR, step, np.inf
        w, size = W.product(z) + q, W.terms(np.abs(z)) + np.abs(q)
        if not np.isfinite(w).all():
            return Status.NON_FINITE, step, np.inf
        small = ROUNDING * float(np.abs(z).max(initial=0.0))
        wrong = np.where(free, z < -small, active & (w < -ROUNDING * size))
        count = int(np.count_nonzero(wrong))
        if count == 0:
            np.maximum(z, 0.0, out=z)
            residual = natural_residual(W, q, active, z)
            return (Status.SOLVED if residual <= tol else Status.INACCURATE), step, residual
        if count < fewest:
            fewest, patience = count, PATIENCE
        else:
            patience -= 1
        if patience < 0:
            last = int(np.flatnonzero(wrong)[-1])
            free[last] = not free[last]
        else:
            free ^= wrong
    return Status.MAX_ITER, max_iter, np.inf


def natural_residual(W: SparseContacts, q: Array, active: Flags, z: Array) -> float:
    """Return the largest |min(z, w)| of the active rows in units of the terms of w; inf if z acts elsewhere or pulls."""
    w, size = W.product(z) + q, W.terms(np.abs(z)) + np.abs(q)
    if (z[~active] != 0.0).any() or not (z >= 0.0).all():
        return np.inf
    off = np.where(z > 0.0, np.abs(w), np.maximum(-w, 0.0))[active]
    scale = size[active]
    return float((off / np.where(scale > 0.0, scale, 1.0)).max(initial=0.0))
