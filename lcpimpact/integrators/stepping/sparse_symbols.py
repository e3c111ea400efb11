r"""The symbols of a sparse step, as in `lcpimpact.integrators.stepping.linear_step`, in sparse matrices.

Their columns belong to q, v, the impulses P, the inputs, the mean velocity w and the constant 1. Where A is diagonal,
w = A⁻¹ b is a sparse sum of the others. Otherwise A⁻¹ has no zeros, so that w remains an unknown of the step with the
equation A w = b.

The inputs of a step are the signals of the loads at t and at t + h, and the places, rates and mean rates of the prescribed
motions, as in `SparseDynamics`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import sparse

from lcpimpact.arrays import Flags, Sparse
from lcpimpact.integrators.stepping.linear_step import Prescribed
from lcpimpact.scheme.sparse import SparseDynamics


def input_sizes(d: SparseDynamics) -> tuple[int, ...]:
    """Return the numbers of inputs: signals at t and at t + h, places, rates and mean rates."""
    ns, nd = len(d.signals), len(d.motions)
    return ns, ns, nd, nd, nd


def select(rows: Flags, one: Sparse, other: Sparse) -> Sparse:
    """Return the rows of one matrix where ``rows`` is true, and of the other elsewhere."""
    if rows.all():
        return one
    chosen = rows.astype(np.float64)
    return sparse.diags_array(chosen).tocsr() @ one + sparse.diags_array(1.0 - chosen).tocsr() @ other


class SparseSymbols:
    """The knowns and unknowns of a sparse step, with the names and functions of `Symbols`.

    Attributes
    ----------
    q, v, w : (n, size) sparse      coordinates and velocities at t, and the mean velocity of the step
    one : (1, size) sparse          the constant 1
    loads : dict                    loads at t and at t + h, by 0 and 1 (n, size)
    prescribed : Prescribed         places and rates of the nodes whose motion is prescribed (n, size)
    P : tuple of (nc, size) sparse  the impulses of the contacts in N s, of one law
    A, b : sparse or None           the equation A w = b, where w is an unknown
    """

    def __init__(self, d: SparseDynamics) -> None:
        n = len(d.nodes)
        nc = len(d.u0)
        inputs = input_sizes(d)
        first = 2 * n + nc
        self.inputs = slice(first, first + sum(inputs))
        size = self.inputs.stop + n + 1
        self.dynamics = d
        self.A: Sparse = None
        self.b: Sparse = None
        self.q, self.v, P, self.w = (
            sparse.eye_array(rows, size, k=k, format="csr")
            for rows, k in ((n, 0), (n, n), (nc, 2 * n), (n, self.inputs.stop))
        )
        self.one = sparse.eye_array(1, size, k=size - 1, format="csr")
        self.P = (P,)
        starts = first + np.cumsum((0, *inputs[:-1]))
        s0, s1, *prescribed = (
            sparse.eye_array(rows, size, k=int(k), format="csr") for rows, k in zip(inputs, starts, strict=True)
        )
        self.loads = {0.0: self.column(d.f) + d.F @ s0, 1.0: self.column(d.f) + d.F @ s1}
        of_driven = sparse.eye_array(n, format="csr")[:, np.flatnonzero(d.driven)]
        self.prescribed = Prescribed(*(of_driven @ each for each in prescribed))

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
        """Return f(t + c h) - K q - C v on the nodes (n, size), for c = 0 and 1."""
        d = self.dynamics
        return self.loads[c] - d.K @ q - d.C @ v

    def prescribe(self, A: Sparse, b: Sparse, h: float) -> tuple[Sparse, Sparse]:
        """Return A w = b with w = (q⁺ - q)/h in the rows of the driven nodes; A stays symmetric."""
        driven = self.dynamics.driven
        if not driven.any():
            return A, b
        of_driven = sparse.diags_array(driven.astype(np.float64)).tocsr()
        of_free = sparse.eye_array(len(driven), format="csr") - of_driven
        rates = (self.prescribed.place - of_driven @ self.q) / h
        return of_free @ A @ of_free + of_driven, of_free @ (b - A @ rates) + rates

    def solve(self, A: Sparse, b: Sparse) -> Sparse:
        """Return w with A w = b: A⁻¹ b where A is diagonal, and else the unknown w, whose equation is kept."""
        diagonal = A.diagonal()
        if (A - sparse.diags_array(diagonal)).count_nonzero() == 0:
            return sparse.diags_array(1.0 / diagonal) @ b
        self.A, self.b = A, b
        return self.w


@dataclass(frozen=True, eq=False)
class SparseStep:
    """The end of a sparse step and its law, 0 <= P ⟂ L >= 0 where ``touching`` is not positive, in the symbols ``y``.

    ``unbalanced`` are the forces on the quasi-static coordinates at the end, which it is moved along until they vanish.
    """

    y: SparseSymbols
    q: Sparse
    v: Sparse
    L: Sparse
    touching: Sparse
    unbalanced: Sparse
