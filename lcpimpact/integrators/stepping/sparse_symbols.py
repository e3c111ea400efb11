r"""The symbols of a sparse step: as those of `lcpimpact.integrators.stepping.linear_step`, in sparse matrices.

Their columns belong to q, v, the impulses P, the mean velocity w and the constant 1. Where A is diagonal, w = A⁻¹ b is a
sparse sum of the others. Otherwise A⁻¹ has no zeros, so that w remains an unknown of the step with the equation A w = b.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import sparse

from lcpimpact.scheme.sparse import Sparse, SparseDynamics


class SparseSymbols:
    """The knowns and unknowns of a sparse step, with the names and functions of `Symbols`.

    Attributes
    ----------
    q, v, w : (n, size) sparse      coordinates and velocities at t, and the mean velocity of the step
    one : (1, size) sparse          the constant 1
    P : tuple of (nc, size) sparse  the impulses of the contacts in N s, of one law
    A, b : sparse or None           the equation A w = b, where w is an unknown
    """

    def __init__(self, d: SparseDynamics) -> None:
        n, nc = len(d.nodes), len(d.u0)
        size = 3 * n + nc + 1
        self.dynamics = d
        self.A: Sparse = None
        self.b: Sparse = None
        self.q, self.v, P, self.w = (
            sparse.eye_array(rows, size, k=k, format="csr")
            for rows, k in ((n, 0), (n, n), (nc, 2 * n), (n, 2 * n + nc))
        )
        self.one, self.P = sparse.eye_array(1, size, k=size - 1, format="csr"), (P,)

    def column(self, values: Any) -> Sparse:
        """Return constants as symbols."""
        return sparse.csr_array(np.asarray(values)[:, None]) @ self.one

    def gap(self, q: Sparse) -> Sparse:
        """Return u = H q + u0 (nc, size)."""
        return self.dynamics.H @ q + self.column(self.dynamics.u0)

    def gap_rate(self, v: Sparse) -> Sparse:
        """Return U = H v (nc, size)."""
        return self.dynamics.H @ v

    def momentum(self, v: Sparse) -> Sparse:
        """Return M v (n, size)."""
        return self.dynamics.M @ v

    def push(self, impulse: Sparse) -> Sparse:
        """Return the impulses or forces of the contacts on the nodes, Hᵀ P (n, size)."""
        return self.dynamics.B @ impulse

    def force(self, c: float, q: Sparse, v: Sparse) -> Sparse:
        """Return f - K q - C v on the nodes (n, size); the loads are constant."""
        d = self.dynamics
        return self.column(d.f) - d.K @ q - d.C @ v

    def solve(self, A: Sparse, b: Sparse) -> Sparse:
        """Return w with A w = b: A⁻¹ b where A is diagonal, and else the unknown w, whose equation is kept."""
        diagonal = A.diagonal()
        if (A - sparse.diags_array(diagonal)).count_nonzero() == 0:
            return sparse.diags_array(1.0 / diagonal) @ b
        self.A, self.b = A, b
        return self.w


@dataclass(frozen=True, eq=False)
class SparseStep:
    """The end of a sparse step and its law, 0 <= P ⟂ L >= 0 where ``touching`` is not positive, in the symbols ``y``."""

    y: SparseSymbols
    q: Sparse
    v: Sparse
    L: Sparse
    touching: Sparse
