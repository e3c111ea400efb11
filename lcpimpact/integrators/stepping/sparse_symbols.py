r"""The symbols of a sparse step, as in `lcpimpact.integrators.stepping.linear_step`, in sparse matrices.

Their columns belong to q, v, the impulses P, the inputs, the mean velocity w and the constant 1. Where A is diagonal,
w = A⁻¹ b is a sparse sum of the others. Otherwise A⁻¹ has no zeros, so that w remains an unknown of the step with the
equation A w = b.

The inputs of a step are the signals of the loads at t and at t + h, and the places, rates and mean rates of the prescribed
motions, as in `SparseDynamics`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, cast

import numpy as np
from scipy import sparse

from lcpimpact.arrays import Flags, Sparse
from lcpimpact.integrators.stepping.linear_step import Named, Prescribed, Symbols
from lcpimpact.scheme.sparse_dynamics import SparseDynamics


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


def sparse_symbols(d: SparseDynamics) -> Symbols:
    """Return the symbols of a sparse step, in compressed rows."""
    n = len(d.nodes)
    nc = len(d.u0)
    sizes = (n, n, nc, *input_sizes(d), n, 1)
    starts = np.cumsum((0, *sizes))
    q, v, P, s0, s1, *prescribed, w, one = (
        sparse.eye_array(rows, starts[-1], k=int(start), format="csr")
        for rows, start in zip(sizes, starts, strict=False)
    )
    constant = sparse.csr_array(d.f[:, None]) @ one
    of_driven = sparse.eye_array(n, format="csr")[:, np.flatnonzero(d.driven)]
    return Symbols(
        dynamics=cast(Any, d), q=q, v=v, memory=Named("memory", {}), one=one,
        loads=Named("instants", {0.0: constant + d.F @ s0, 1.0: constant + d.F @ s1}), jump=np.zeros(0),
        prescribed=Prescribed(*(of_driven @ each for each in prescribed)), P=(P,), s=(), w=(w,),
    )  # fmt: skip


def prescribe(y: Symbols, A: Sparse, b: Sparse, h: float) -> tuple[Sparse, Sparse]:
    """Return A w = b with w = (q⁺ - q)/h in the rows of the driven nodes; A stays symmetric."""
    driven = y.dynamics.driven
    if not driven.any():
        return A, b
    of_driven = sparse.diags_array(driven.astype(np.float64)).tocsr()
    of_free = sparse.eye_array(len(driven), format="csr") - of_driven
    rates = (y.prescribed.place - of_driven @ y.q) / h
    return of_free @ A @ of_free + of_driven, of_free @ (b - A @ rates) + rates


@dataclass(frozen=True, eq=False)
class SparseStep:
    """The end of a sparse step and its law, 0 <= P ⟂ L >= 0 where ``touching`` is not positive, in the symbols ``y``.

    ``unbalanced`` are the forces on the quasi-static coordinates at the end, which it is moved along until they vanish.
    """

    y: Symbols
    q: Sparse
    v: Sparse
    L: Sparse
    touching: Sparse
    unbalanced: Sparse
