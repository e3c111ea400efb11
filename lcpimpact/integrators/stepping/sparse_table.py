"""The coefficients of a sparse step, and the choice of its contact solver."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, cast

import numpy as np
from scipy import linalg, sparse

from lcpimpact.arrays import Array
from lcpimpact.compiled import interpreted
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
    sparse_steps,
    take_step,
)
from lcpimpact.integrators.stepping.sparse_symbols import SparseStep
from lcpimpact.integrators.stepping.stencil import Stencil, apply, stencil
from lcpimpact.lcp import SOLVERS
from lcpimpact.lcp.operators import Dense
from lcpimpact.lcp.solve import limits
from lcpimpact.lcp.solver import Kernel
from lcpimpact.lcp.solvers.banded import chain_masses, pools_for
from lcpimpact.lcp.solvers.block_pivoting import block_pivoting
from lcpimpact.lcp.sparse_pivoting import MAX_PIVOTS, SparseContacts, SparseMatrix, SparseProduct, pivot_contacts
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
    try:
        return np.ascontiguousarray(linalg.cholesky_banded(lower_bands(A, half_bandwidth(A)), lower=True))
    except linalg.LinAlgError:
        raise UnsupportedError(
            "the matrix of a step, M/(θ h) + C + θ h K, is not positive definite: take a smaller dt, or Scheme in place of "
            "SparseScheme"
        ) from None


@dataclass(frozen=True, eq=False)
class PreparedStep:
    """A sparse step: its coefficients, its contact problem, and the loop that takes it.

    Attributes
    ----------
    table, contacts : SparseTable, Contacts
    solve, kernel : callable            the contact solver, and the LCP kernel that it uses
    loop : callable                     `sparse_steps`, in the interpreter where a sparse factor is of another library
    """

    table: SparseTable
    contacts: Contacts
    solve: ContactSolver
    kernel: Kernel
    loop: Callable[..., tuple[int, int, int, float]]


def tabulate_sparse(step: SparseStep, h: float, tol: float | None, max_iter: int | None) -> PreparedStep:
    """Return the coefficients of a step, and the solver of its contact problem.

    The contacts of a chain are solved by isotonic regression, few others with a full W, and others by pivoting with sparse
    factors.
    """
    n, nc, size = step.q.shape[0], step.L.shape[0], step.L.shape[1]
    first, last, A = 2 * n, 2 * n + nc, step.y.A
    of_P, L, momentum, solve_A = step.L.tocsc()[:, first:last], step.L, stencil(sparse.csr_array((0, size - 1))), None
    factor = np.zeros((0, n))
    W: SparseContacts = SparseMatrix(of_P)
    if A is not None:
        product = SparseProduct(L.tocsc()[:, last : last + n], A, step.y.b.tocsc()[:, first:last])
        W, momentum, banded = product, affine(step.y.b), half_bandwidth(A) <= WIDEST_BAND
        factor, solve_A = (banded_factor(A), None) if banded else (np.zeros((1, n)), product.solve_A)
    weight = _diagonal(W, nc)
    without_P = L @ sparse.diags_array(np.where((np.arange(size) < first) | (np.arange(size) >= last), 1.0, 0.0))
    table = SparseTable(
        affine(step.touching), affine(without_P), momentum, factor, affine(sparse.vstack([step.q, step.v])),
        REST_GAP_FACTOR * h * weight, weight,
    )  # fmt: skip
    contacts, solve, kernel = _solver(W, nc, limits(SOLVERS["auto"], tol, max_iter), max_iter or MAX_PIVOTS)
    if solve_A is None and solve in (solve_chain, solve_few):
        return PreparedStep(table, contacts, solve, kernel, sparse_steps)
    taken: dict[str, Any] = {"solve_banded": partial(_solve_sparse, solve_A)} if solve_A else {}
    loop = interpreted(sparse_steps, take_step=interpreted(take_step, **taken))
    return PreparedStep(table, contacts, solve, kernel, loop)


def _solver(W: SparseContacts, nc: int, limits: tuple[float, int], most: int) -> tuple[Contacts, ContactSolver, Kernel]:
    """Return the contact problem with the matrix in the storage of its solver, that solver, and its LCP kernel."""
    mass = np.zeros(nc + 1)
    if isinstance(W, SparseMatrix) and nc > 2 and half_bandwidth(W.W) <= 1:
        bands = lower_bands(W.W, 1)
        if chain_masses(bands, mass):
            return _contacts(bands, mass, limits), solve_chain, block_pivoting
    if nc <= FEW:
        full = np.zeros((nc, nc))
        for j, unit in enumerate(np.eye(nc)):
            full[:, j] = W.product(unit)
        kernel: Kernel = SOLVERS["auto"].init(Dense(full)).kernel if nc else block_pivoting
        return _contacts(full, mass, limits), solve_few, kernel

    def solve_many(contacts: Contacts, z: Array, kernel: Kernel) -> tuple[int, int, float]:
        status, count, residual = pivot_contacts(W, contacts.L, contacts.active, z, contacts.tol, most)
        return int(status), count, residual

    return _contacts(np.zeros((0, 0)), mass, limits), solve_many, block_pivoting


def _solve_sparse(solve: Callable[[Array], Array], factor: Array, b: Array) -> None:
    """Overwrite b by A⁻¹ b, in place of `solve_banded`."""
    b[:] = solve(b)


def _diagonal(W: SparseContacts, nc: int) -> Array:
    """Return W_ii; of a product of many rows the part of it that the diagonal of A gives, which is not larger."""
    if isinstance(W, SparseMatrix):
        return np.array(W.W.diagonal(), dtype=np.float64)
    product = cast(SparseProduct, W)
    if nc <= FEW:
        return np.array([W.product(unit)[i] for i, unit in enumerate(np.eye(nc))], dtype=np.float64)
    scaled = product.L @ sparse.diags_array(1.0 / product.A.diagonal())
    return np.asarray(scaled.multiply(product.B.T).sum(axis=1)).ravel()


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
    apply(laws.gap, motion.x[0], gap)
    room = Room(predicted, gap, push, pushes, np.zeros(nc), np.abs(motion.rate[0]), np.abs(start[1]))
    found = Found(np.zeros((3, 4)), np.zeros(5))
    energy = d.energy(*start)
    fall = h * d.f / d.M.diagonal()
    scale = abs(energy) + float(fall @ (d.M @ fall))
    found.energy[:] = 0.0, scale, energy, 0.0, max(np.abs(fall).max(), np.abs(start[1]).max())
    return motion, room, found
