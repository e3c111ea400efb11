"""The coefficients of a sparse step, and the choice of its contact solver."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, cast

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from lcpimpact.arrays import Array, Sparse
from lcpimpact.errors import Status, UnsupportedError
from lcpimpact.integrators.stepping.sparse_kernel import (
    ContactSolver,
    Found,
    MotionLaws,
    Room,
    SparseTable,
    StaticCoordinates,
    StepContacts,
    StepMotion,
    balance_static,
    solve_chain,
    solve_few,
    sparse_steps,
    take_step,
)
from lcpimpact.integrators.stepping.sparse_symbols import SparseStep, input_sizes
from lcpimpact.integrators.stepping.stencil import Stencil, apply, stencil
from lcpimpact.interpreter import interpreted
from lcpimpact.lcp import SOLVERS
from lcpimpact.lcp.operators import Dense
from lcpimpact.lcp.solve import limits
from lcpimpact.lcp.solver import Kernel, SolverState
from lcpimpact.lcp.solvers.banded import chain_masses, pools_for
from lcpimpact.lcp.sparse_pivoting import (
    MAX_PIVOTS,
    SparseContacts,
    SparseMatrix,
    SparseProduct,
    natural_residual,
    pivot_contacts,
)
from lcpimpact.numerics.banded import factor, half_bandwidth, lower_bands
from lcpimpact.scheme.sparse_dynamics import SparseDynamics
from lcpimpact.scheme.terms import NodeKind

FEW = 256
"""Largest number of contacts with a full W."""

WIDEST_BAND = 32
"""Largest half bandwidth of A that is factored as a banded matrix."""


def affine(rows: Sparse) -> Stencil:
    """Return symbols as a stencil; the last column belongs to the constant 1."""
    rows = rows.tocsc()
    rows.eliminate_zeros()
    return stencil(rows[:, :-1], rows[:, [-1]].toarray()[:, 0])


def banded_factor(A: Sparse) -> Array:
    """Return the factors of A = M/(θ h) + C + θ h K in bands."""
    factors = lower_bands(A, half_bandwidth(A))
    if not factor(factors, factors[:0], 0.0):
        raise UnsupportedError(
            "the matrix of a step, M/(θ h) + C + θ h K, is not positive definite: take a smaller dt, or Scheme in place of "
            "SparseScheme"
        )
    return factors


@dataclass(frozen=True, eq=False)
class PreparedStep:
    """A sparse step: its coefficients, its contact problem, and the loop that takes it.

    Attributes
    ----------
    table, contacts : SparseTable, Contacts
    solve : callable                    the contact solver
    solver, few : SolverState, Dense    the LCP solver of few contacts, and their W; None for others
    loop : callable                     `sparse_steps`, in the interpreter where a sparse factor is of another library
    """

    table: SparseTable
    contacts: StepContacts
    solve: ContactSolver
    solver: SolverState | None
    few: Dense | None
    loop: Callable[..., tuple[int, int, int, float]]


def tabulate_sparse(step: SparseStep, h: float, tol: float | None, max_iter: int | None) -> PreparedStep:
    """Return the coefficients of a step, and the solver of its contact problem.

    The contacts of a chain are solved by isotonic regression, few others with a full W, and others by pivoting with sparse
    factors.
    """
    n = step.q.shape[0]
    nc = step.L.shape[0]
    size = step.L.shape[1]
    first = 2 * n
    last = 2 * n + nc
    of_w = size - n - 1
    of_P = step.L.tocsc()[:, first:last]
    L = step.L
    momentum = stencil(sparse.csr_array((0, size - 1)))
    solve_A = None
    factors = np.zeros((0, n))
    W: SparseContacts = SparseMatrix(of_P)
    for A, b in cast(list[tuple[Sparse, Sparse]], step.y.equations):
        product = SparseProduct(L.tocsc()[:, of_w : of_w + n], A, b.tocsc()[:, first:last])
        W = product
        momentum = affine(b)
        banded = half_bandwidth(A) <= WIDEST_BAND
        factors, solve_A = (banded_factor(A), None) if banded else (np.zeros((1, n)), product.solve_A)
    weight, static, stiffness = _diagonal(W, nc), *_static_coordinates(cast(SparseDynamics, step.y.dynamics))
    without_P = L @ sparse.diags_array(np.where((np.arange(size) < first) | (np.arange(size) >= last), 1.0, 0.0))
    table = SparseTable(
        affine(step.touching), affine(without_P), momentum, factors, affine(sparse.vstack([step.q, step.v])),
        affine(step.unbalanced), static, step.y.rest_gap[:, 0] * h * weight, weight,
    )  # fmt: skip
    contacts, solve, few = _solver(W, nc, limits(SOLVERS["auto"], tol, max_iter), max_iter or MAX_PIVOTS)
    solver = None if few is None else SOLVERS["auto"].init(few)
    if solve_A is None and stiffness is None and solve in (solve_chain, solve_few):
        return PreparedStep(table, contacts, solve, solver, few, sparse_steps)
    taken: dict[str, Any] = {"solve_banded": partial(_solve_sparse, solve_A)} if solve_A else {}
    if stiffness is not None:
        taken["balance_static"] = interpreted(balance_static, find_ways=_ways(stiffness))
    loop = interpreted(sparse_steps, take_step=interpreted(take_step, **taken))
    return PreparedStep(table, contacts, solve, solver, few, loop)


def _static_coordinates(d: SparseDynamics) -> tuple[StaticCoordinates, Sparse | None]:
    """Return the quasi-static coordinates, and Sᵀ K S where it is not diagonal."""
    S = d.kinds.static
    stiffness = (S.T @ d.K @ S).tocsc()
    held = (d.H @ S).tocoo()
    moved = S.tocoo()
    diagonal, acting = stiffness.diagonal(), held.data != 0.0
    node = moved.row.astype(np.int64)
    of = moved.col.astype(np.int64)
    contact = held.row[acting].astype(np.int64)
    coordinate = held.col[acting].astype(np.int64)
    force = np.zeros(len(diagonal))
    free = np.zeros(len(diagonal), dtype=np.bool_)
    static = StaticCoordinates(node, of, contact, coordinate, diagonal, force, free)
    joined = (stiffness - sparse.diags_array(diagonal)).count_nonzero() > 0
    return static, stiffness if joined else None


def _ways(stiffness: Sparse) -> Callable[[StaticCoordinates, Array], None]:
    """Return `find_ways` for Sᵀ K S that is not diagonal, which keeps its factors until others are free."""
    kept: list[Any] = [None, None]

    def find(static: StaticCoordinates, force: Array) -> None:
        if kept[0] is None or not np.array_equal(kept[0], static.free):
            free = np.flatnonzero(static.free)
            kept[:] = (
                static.free.copy(),
                splu(stiffness[free][:, free], permc_spec="MMD_AT_PLUS_A") if len(free) else None,
            )
        way = kept[1].solve(force[static.free]) if kept[1] else 0.0
        force[static.free], force[~static.free] = way, 0.0

    return find


def _solver(
    W: SparseContacts, nc: int, limits: tuple[float, int], most: int, *, least_terms: float = 1e-3
) -> tuple[StepContacts, ContactSolver, Dense | None]:
    """Return the contact problem with the matrix in the storage of its solver, that solver, and W if it is full.

    ``least_terms``: terms of a row, relative to the largest, below which its error is the error of the largest.
    """
    mass = np.zeros(nc + 1)
    if isinstance(W, SparseMatrix) and nc > 2 and half_bandwidth(W.W) <= 1:
        bands = lower_bands(W.W, 1)
        if chain_masses(bands, mass):
            return _contacts(bands, mass, limits), solve_chain, None
    if nc <= FEW:
        full = np.zeros((nc, nc))
        for j, unit in enumerate(np.eye(nc)):
            full[:, j] = W.product(unit)
        return _contacts(full, mass, limits), solve_few, Dense(full) if nc else None

    def solve_many(contacts: StepContacts, z: Array, kernel: Kernel) -> tuple[int, int, float]:
        status, count, residual = pivot_contacts(W, contacts.L, contacts.active, z, contacts.tol, most)
        if status is Status.INACCURATE:
            most_of_z = np.where(contacts.active, np.inf, 0.0)
            residual = natural_residual(W, contacts.L, np.zeros(nc), most_of_z, z, least_terms)
            status = Status.SOLVED if residual <= contacts.tol else status
        return int(status), count, residual

    return _contacts(np.zeros((0, 0)), mass, limits), solve_many, None


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


def _contacts(W: Array, mass: Array, limits: tuple[float, int]) -> StepContacts:
    nc = len(mass) - 1
    L, acting, lower, upper = np.zeros((4, nc))
    return StepContacts(W, mass, L, acting, np.zeros(nc, dtype=np.bool_), lower, upper, pools_for(nc), *limits)


def laws_of(d: SparseDynamics, h: float) -> MotionLaws:
    """Return the laws by which steps of length h are judged, as sums of q, v and P, and of the signals of the loads."""
    n = len(d.nodes)

    def of(matrix: Sparse, before: int, c: Array | None = None) -> Stencil:
        pad = sparse.csr_array((matrix.shape[0], before))
        return stencil(sparse.hstack([pad, matrix]).tocsr(), c)

    impacts = d.relative_degree == 2
    static = d.kinds.static.sum(axis=1) > 0.0
    driven = np.flatnonzero(d.driven)
    kinds = np.select(
        [d.driven, d.massive, static], [NodeKind.DRIVEN, NodeKind.MASSIVE, NodeKind.FREE], NodeKind.DAMPED
    ).astype(np.int64)
    per_mass = np.divide(1.0, d.M.diagonal(), out=np.zeros(n), where=d.massive)
    return MotionLaws(
        of(d.M, n), of(d.K, 0), of(d.C, 0), of(d.B, 2 * n), of(np.abs(d.B), 2 * n), of(d.H, 0, d.u0), of(d.H, n),
        stencil(h * np.abs(d.K) + np.abs(d.C)), stencil(h * d.F, h * d.f), stencil(h * np.abs(d.F), h * np.abs(d.f)),
        stencil(d.H[:, driven]), per_mass, d.restitution.copy(),
        d.u0.copy(), kinds[: 0 if d.massive.all() else n], impacts[: 0 if impacts.all() else len(impacts)], driven,
    )  # fmt: skip


def begin(
    d: SparseDynamics, laws: MotionLaws, table: SparseTable, start: tuple[Array, Array], h: float
) -> tuple[StepMotion, Room, Found]:
    """Return the numbers at t = 0, the arrays that steps work in, and the checks before the first step."""
    n = len(d.nodes)
    nc = len(d.u0)
    nd = len(d.motions)
    x = np.zeros((2, 2 * n + nc + sum(input_sizes(d)) + (n if len(table.factor) else 0)))
    momentum, elastic, damping = np.zeros((3, 2, n))
    motion = StepMotion(x, momentum, elastic, damping, np.zeros((2, nc)))
    motion.x[0, : 2 * n] = np.concatenate(start)
    for function, values in zip((laws.momentum, laws.elastic, laws.damping), motion[1:4], strict=True):
        apply(function, motion.x[0], values[0])
    apply(laws.rate, motion.x[0], motion.rate[0])
    predicted, gap, turned = np.zeros((3, nc))
    push, pushes = np.zeros((2, n))
    apply(laws.gap, motion.x[0], gap)
    reached, unmoved = np.zeros((2, n if d.kinds.static.shape[1] else 0))
    reach, pull = np.zeros((2, n if d.K.nnz or d.C.nnz else 0))
    room = Room(
        predicted, gap, push, pushes, h * d.f, h * np.abs(d.f), reach, pull, reached, unmoved, turned,
        np.zeros(nd), np.zeros(nc), np.abs(motion.rate[0]), np.abs(start[1]),
    )  # fmt: skip
    found = Found(np.zeros((3, 6)), np.zeros(10))
    energy = d.energy(*start)
    fall = h * (d.f + d.F @ d.signals(0.0)) * laws.per_mass
    scale = abs(energy) + float(fall @ (d.M @ fall))
    found.energy[1], found.energy[2] = scale, energy
    found.energy[4] = max(np.abs(fall).max(), np.abs(start[1]).max())
    if len(pull):
        apply(laws.pull, np.abs(start[0]) + h * np.abs(start[1]), pull)
        with np.errstate(over="ignore"):
            found.energy[7] = (2.0 * np.abs(momentum[0]) + h * np.abs(d.f + d.F @ d.signals(0.0)) + pull).max()
    return motion, room, found
