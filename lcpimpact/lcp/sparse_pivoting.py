"""Block principal pivoting for sparse LCPs of many contacts, which factors the free rows only when they change.

All infeasible rows are exchanged at once; where that does not reduce their number, one at a time by the largest
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
from lcpimpact.lcp.basis import PATIENCE
from lcpimpact.lcp.problem import FREE, LOWER, UPPER
from lcpimpact.numerics.rounding import EPS

MAX_PIVOTS = 500
"""Default limit of exchanges, each of which may cost a factorisation."""

SYMMETRIC: dict[str, Any] = {
    "permc_spec": "MMD_AT_PLUS_A", "diag_pivot_thresh": 1e-3, "options": {"SymmetricMode": True},
}  # fmt: skip
"""Order and pivots on the diagonal for symmetric matrices."""

Solve = Callable[[Array], Array]


class SparseContacts(ABC):
    """The matrix W of the contacts of a sparse system; factors of its last free rows are kept.

    Attributes
    ----------
    unit : (n,) array       units of z in which W_ii is near 1
    """

    unit: Array

    def __init__(self) -> None:
        self._last: tuple[Indices, Solve] | None = None

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
        """Return `factor` of the free rows, from memory where they are the rows of the last call."""
        last = self._last
        if last is None or not np.array_equal(free, last[0]):
            last = self._last = free, self.factor(free)
        return last[1]


class SparseMatrix(SparseContacts):
    """W itself, as where A is diagonal."""

    def __init__(self, W: Any, symmetric: bool = True) -> None:
        super().__init__()
        self.W, self.absolute = W.tocsr(), abs(W).tocsr()
        diagonal = np.abs(self.W.diagonal())
        self.unit = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
        self._how = SYMMETRIC if symmetric else {"permc_spec": "COLAMD"}

    def product(self, z: Array) -> Array:
        """Return W z."""
        return np.asarray(self.W @ z)

    def terms(self, z: Array) -> Array:
        """Return |W| z."""
        return np.asarray(self.absolute @ z)

    def factor(self, free: Indices) -> Solve:
        """Factor the free block, scaled to a unit diagonal."""
        unit = self.unit[free]
        scaled = sparse.diags_array(unit)
        solve = splu((scaled @ self.W[free][:, free] @ scaled).tocsc(), **self._how).solve
        return lambda q: np.asarray(unit * solve(unit * q))


class SparseProduct(SparseContacts):
    """W = L A⁻¹ B with sparse L, A and B, which has no zeros: it is never formed.

    The free block of W is solved with the sparse matrix of the forces and the velocities together.
    """

    def __init__(self, L: Any, A: Any, B: Any) -> None:
        super().__init__()
        self.L = L.tocsr()
        self.A = A.tocsc()
        self.B = B.tocsr()
        self.solve_A: Solve = splu(self.A).solve
        diagonal = self.A.diagonal()
        self._of_w = sparse.diags_array(1.0 / np.sqrt(diagonal))
        part = (self.L @ sparse.diags_array(1.0 / diagonal)).multiply(self.B.T)
        self.unit = 1.0 / np.sqrt(np.asarray(part.sum(axis=1)).ravel())

    def product(self, z: Array) -> Array:
        """Return L A⁻¹ B z."""
        return np.asarray(self.L @ self.solve_A(self.B @ z))

    def terms(self, z: Array) -> Array:
        """Return |L| |A⁻¹ |B| z|, which bounds the terms where A⁻¹ has no negative entry, as for springs and dashpots."""
        return np.asarray(abs(self.L) @ np.abs(self.solve_A(abs(self.B) @ z)))

    def factor(self, free: Indices) -> Solve:
        """Factor A w - B z = 0, L w = q in the free rows, in units of w and z in which the entries are near 1."""
        n, unit = self.A.shape[0], self.unit[free]
        scaled, D = sparse.diags_array(unit), self._of_w
        B = D @ self.B.tocsc()[:, free] @ scaled
        L = scaled @ self.L[free] @ D
        solve = splu(sparse.block_array([[D @ self.A @ D, -B], [L, None]]).tocsc()).solve
        return lambda q: np.asarray(unit * solve(np.concatenate([np.zeros(n), unit * q]))[n:])


def pivot(
    W: SparseContacts,
    q: Array,
    lower: Array,
    upper: Array,
    side: Indices,
    z: Array,
    tol: float,
    max_iter: int,
    *,
    row_rounding: float = 16.0 * EPS,
) -> tuple[Status, int, float]:
    """Solve w = W z + q with lower <= z <= upper, w >= 0 where z < upper, w <= 0 where z > lower; z is overwritten.

    ``row_rounding``: rounding error of a row, relative to the sum of its terms.

    Parameters
    ----------
    side : (n,) indices
        The first guess: FREE, LOWER or UPPER; overwritten. A row with lower = upper has no side to change to.

    Returns
    -------
    status, iterations : Status, int
    residual : float
        Largest natural residual of a row, relative to the sum of its terms, computed from W and q after the solution.
    """
    fewest = len(q) + 1
    patience = PATIENCE
    scale = W.unit * W.unit
    for step in range(1, max_iter + 1):
        rows = np.flatnonzero(side == FREE)
        z[:] = np.where(side == FREE, 0.0, np.where(side == LOWER, lower, upper))
        try:
            if len(rows):
                solve = W.solver(rows)
                for _ in range(2):  # the second is a refinement
                    z[rows] -= solve((W.product(z) + q)[rows])
        except RuntimeError:
            return Status.SINGULAR, step, np.inf
        w, size = W.product(z) + q, W.terms(np.abs(z)) + np.abs(q)
        if not np.isfinite(w).all():
            return Status.NON_FINITE, step, np.inf
        excess = np.where(side == FREE, np.maximum(lower - z, z - upper), np.where(side == LOWER, -w, w))
        excess[(side != FREE) & (lower == upper)] = 0.0
        # A value below the rounding error of the largest z may be significant in a row of small ones.
        rounding = np.where(side == FREE, size * scale, size)
        if patience < 0:
            largest = float((np.abs(z) / W.unit).max(initial=0.0))
            rounding = np.where(side == FREE, np.maximum(rounding, largest * W.unit), rounding)
        wrong = excess > row_rounding * rounding
        count = int(np.count_nonzero(wrong))
        if count == 0:
            np.minimum(np.maximum(z, lower), upper, out=z)
            residual = natural_residual(W, q, lower, upper, z)
            return (Status.SOLVED if residual <= tol else Status.INACCURATE), step, residual
        if count < fewest:
            fewest, patience = count, PATIENCE
        else:
            patience -= 1
        if patience < 0:
            wrong[: np.flatnonzero(wrong)[-1]] = False
        side[wrong] = np.where(side != FREE, FREE, np.where(z < lower, LOWER, UPPER))[wrong]
    return Status.MAX_ITER, max_iter, np.inf


def pivot_contacts(
    W: SparseContacts, q: Array, active: Flags, z: Array, tol: float, max_iter: int
) -> tuple[Status, int, float]:
    """Solve 0 <= z ⟂ W z + q >= 0 in the active rows, with z = 0 in the others, as `pivot` does, from the guess z.

    Free at first are the active rows with z > 0 or q < 0, or all if none has z > 0.
    """
    free = active & ((z > 0.0) | (q < 0.0)) if (z > 0.0).any() else active
    side = np.where(free, FREE, LOWER)
    return pivot(W, q, np.zeros(len(q)), np.where(active, np.inf, 0.0), side, z, tol, max_iter)


def natural_residual(W: SparseContacts, q: Array, lower: Array, upper: Array, z: Array, least: float = 0.0) -> float:
    """Return the largest w_i of a wrong sign in units of its terms; inf if z lies outside its bounds.

    Terms of less than ``least`` times the largest of the rows with lower < upper count as that part of it: the rounding of
    A⁻¹ leads from rows that carry much to rows at rest beside them.
    """
    w, size = W.product(z) + q, W.terms(np.abs(z)) + np.abs(q)
    if not ((lower <= z) & (z <= upper)).all():
        return np.inf
    off = np.where(z > lower, np.maximum(w, 0.0), 0.0) + np.where(z < upper, np.maximum(-w, 0.0), 0.0)
    size = np.maximum(size, least * size[lower < upper].max(initial=0.0))
    return float((off / np.where(size > 0.0, size, 1.0)).max(initial=0.0))
