"""The coefficients of a sparse step, and the choice of its contact solver."""

from __future__ import annotations

import numpy as np
from scipy import linalg, sparse

from lcpimpact.arrays import Array
from lcpimpact.errors import UnsupportedError
from lcpimpact.integrators.stepping.linear_step import REST_GAP_FACTOR
from lcpimpact.integrators.stepping.sparse_kernel import (
    Contacts,
    ContactSolver,
    Found,
    Laws,
    Motion,
    Room,
    SparseTable,
    solve_chain,
    solve_few,
)
from lcpimpact.integrators.stepping.sparse_symbols import SparseStep
from lcpimpact.integrators.stepping.stencil import Stencil, apply, stencil
from lcpimpact.lcp import SOLVERS
from lcpimpact.lcp.operators import Dense
from lcpimpact.lcp.solve import limits
from lcpimpact.lcp.solver import Kernel
from lcpimpact.lcp.solvers.banded import chain_masses, pools_for
from lcpimpact.lcp.solvers.block_pivoting import block_pivoting
from lcpimpact.scheme.sparse import Sparse, SparseDynamics

FEW = 256
"""Largest number of contacts with a full W."""

WIDEST_BAND = 32
"""Largest half bandwidth of A that is factored as a banded matrix."""


def affine(rows: Sparse) -> Stencil:
    """Return symbols as a stencil; the last column is that of the constant 1."""
    rows = rows.tocsc()
    rows.eliminate_zeros()
    return stencil(rows[:, :-1], rows[:, [-1]].toarray()[:, 0])


def half_bandwidth(A: Sparse) -> int:
    """Return the largest |i - j| with an entry."""
    entries = A.tocoo()
    return int(np.abs(entries.row - entries.col).max(initial=0))


def lower_bands(A: Sparse, width: int) -> Array:
    """Return the lower bands (width + 1, n) of a symmetric matrix."""
    bands = np.zeros((width + 1, A.shape[0]))
    for k in range(width + 1):
        bands[k, : A.shape[0] - k] = A.diagonal(-k)
    return bands


def banded_factor(A: Sparse) -> Array:
    """Return the bands of the Cholesky factor of A = M/(θ h) + C + θ h K."""
    width = half_bandwidth(A)
    if width > WIDEST_BAND:
        raise UnsupportedError(
            f"springs or dashpots join nodes that are {width} places apart, and sparse steps factor bands of {WIDEST_BAND}: "
            "name the nodes in the order in which they are joined, or take Scheme in place of SparseScheme"
        )
    try:
        return np.ascontiguousarray(linalg.cholesky_banded(lower_bands(A, width), lower=True))
    except linalg.LinAlgError:
        raise UnsupportedError(
            "the matrix of a step, M/(θ h) + C + θ h K, is not positive definite: take a smaller dt, or Scheme in place of "
            "SparseScheme"
        ) from None


def contact_matrix(step: SparseStep, factor: Array, first: int, last: int) -> Sparse:
    """Return W = ∂L/∂P, whose columns are those of P from ``first`` to ``last``: sparse, or full where A is not diagonal."""
    W = step.L.tocsc()[:, first:last]
    if len(factor) == 0:
        return W.tocsr()
    n = factor.shape[1]
    L_w, b_P = step.L.tocsc()[:, last : last + n], step.y.b.tocsc()[:, first:last]
    return np.asarray(W.toarray() + L_w @ linalg.cho_solve_banded((factor, True), b_P.toarray()))


def tabulate_sparse(
    step: SparseStep, h: float, tol: float | None, max_iter: int | None
) -> tuple[SparseTable, Contacts, ContactSolver, Kernel]:
    """Return the coefficients of a step, its contact problem, and the solver of that.

    Raises
    ------
    UnsupportedError
        If the contacts are neither those of a chain of bodies nor few.
    """
    n, nc = step.q.shape[0], step.L.shape[0]
    first, last = 2 * n, 2 * n + nc
    implicit = step.y.A is not None
    factor = banded_factor(step.y.A) if implicit else np.zeros((0, n))
    if implicit and nc > FEW:
        raise _too_many(nc, "springs or dashpots couple the nodes")
    W = contact_matrix(step, factor, first, last)
    weight = np.array(W.diagonal(), dtype=np.float64)
    size = step.L.shape[1]
    keep = np.ones(size)
    keep[first:last] = 0.0
    without_P = step.L @ sparse.diags_array(keep)
    momentum = affine(step.y.b) if implicit else stencil(sparse.csr_array((0, size - 1)))
    end = affine(sparse.vstack([step.q, step.v]))
    table = SparseTable(
        affine(step.touching), affine(without_P), momentum, factor, end, REST_GAP_FACTOR * h * weight, weight
    )
    mass, solver = np.zeros(nc + 1), SOLVERS["auto"]
    solving = limits(solver, tol, max_iter)
    if not implicit and nc > 2 and half_bandwidth(W) <= 1:
        bands = lower_bands(W, 1)
        if chain_masses(bands, mass):
            return table, _contacts(bands, mass, solving), solve_chain, block_pivoting
    if nc > FEW:
        raise _too_many(nc, "they do not form one chain, each joining a body to the next")
    full = np.ascontiguousarray(W if implicit else W.toarray())
    kernel = solver.init(Dense(full)).kernel if nc else block_pivoting
    return table, _contacts(full, mass, solving), solve_few, kernel


def _too_many(nc: int, why: str) -> UnsupportedError:
    return UnsupportedError(
        f"{why}, and sparse steps solve at most {FEW} such contacts, where this scheme has {nc:,}: take Scheme in place of "
        "SparseScheme"
    )


def _contacts(W: Array, mass: Array, limits: tuple[float, int]) -> Contacts:
    nc = len(mass) - 1
    L, acting, lower, upper = np.zeros((4, nc))
    return Contacts(W, mass, L, acting, np.zeros(nc, dtype=np.bool_), lower, upper, pools_for(nc), *limits)


def laws_of(d: SparseDynamics, h: float) -> Laws:
    """Return the laws by which steps of length h are judged, as sums of q, v and P."""
    n = len(d.nodes)

    def of(matrix: Sparse, before: int, c: Array | None = None) -> Stencil:
        pad = sparse.csr_array((matrix.shape[0], before))
        return stencil(sparse.hstack([pad, matrix]).tocsr(), c)

    stiffness = h * np.abs(d.K.diagonal()) + np.abs(d.C.diagonal()) if d.K.nnz or d.C.nnz else np.zeros(0)
    return Laws(
        of(d.M, n), of(d.K, 0), of(d.C, 0), of(d.B, 2 * n), of(np.abs(d.B), 2 * n), of(d.H, 0, d.u0), of(d.H, n),
        d.f.copy(), 1.0 / d.M.diagonal(), stiffness, d.restitution.copy(), d.u0.copy(),
    )  # fmt: skip


def begin(
    d: SparseDynamics, laws: Laws, table: SparseTable, start: tuple[Array, Array], h: float
) -> tuple[Motion, Room, Found]:
    """Return the numbers at t = 0, the arrays that steps work in, and what judging starts from."""
    n, nc = len(d.nodes), len(d.u0)
    x = np.zeros((2, 2 * n + nc + (n if len(table.factor) else 0)))
    momentum, elastic, damping = np.zeros((3, 2, n))
    motion = Motion(x, momentum, elastic, damping, np.zeros((2, nc)))
    motion.x[0, : 2 * n] = np.concatenate(start)
    for function, values in zip((laws.momentum, laws.elastic, laws.damping), motion[1:4], strict=True):
        apply(function, motion.x[0], values[0])
    apply(laws.rate, motion.x[0], motion.rate[0])
    (predicted, gap), (push, pushes) = np.zeros((2, nc)), np.zeros((2, n))
    room = Room(predicted, gap, push, pushes, np.zeros(nc), np.abs(motion.rate[0]), np.abs(start[1]))
    found = Found(np.zeros((3, 4)), np.zeros(5))
    energy = d.energy(*start)
    fall = h * d.f / d.M.diagonal()
    scale = abs(energy) + float(fall @ (d.M @ fall))
    found.energy[:] = 0.0, scale, energy, 0.0, max(np.abs(fall).max(), np.abs(start[1]).max())
    return motion, room, found
