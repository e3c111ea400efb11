"""Block principal pivoting: exchange all infeasible rows at once, or one at a time when progress stalls.

It is Newton's method for the natural residual, made finite for P-matrices by the largest-index rule as a fallback. A warm
start with the correct free rows takes one factorisation and one product. Sparse M, and sparse factors of M, are factored by
sparse LU (`sparse_pivoting`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lcpimpact.arrays import Array, Indices, Matrix, Vector
from lcpimpact.compiled import FEW_ROWS, compiled
from lcpimpact.errors import Status
from lcpimpact.lcp.basis import PATIENCE, basic_solution, is_rounding, row_roots, sides, violation
from lcpimpact.lcp.compressed import for_entries
from lcpimpact.lcp.operators import Delassus, Factored, Property, Sparse
from lcpimpact.lcp.problem import FREE, LOWER, UNKNOWN_SIDE, UPPER
from lcpimpact.lcp.solver import CompiledSolver, Kernel, SolverState
from lcpimpact.lcp.solvers.nncg import nncg
from lcpimpact.lcp.storage import has_positive_diagonal, is_symmetric, product
from lcpimpact.lcp.trace import NONE, note
from lcpimpact.numerics.rounding import EPS

SOLVED, SINGULAR = int(Status.SOLVED), int(Status.SINGULAR)
UNDECIDED = int(Status.UNDECIDED)
MAX_ITER = int(Status.MAX_ITER)

START_SWEEPS = 4
"""Number of Gauss-Seidel sweeps of a cold start."""


@compiled()
def guess(M: Matrix, q: Vector, lower: Vector, upper: Vector, z: Vector, w: Vector) -> None:
    """Improve z by a few projected Gauss-Seidel sweeps for symmetric M.

    Each costs one product; together they save factorisations.
    """
    n = len(q)
    product(M, z, w)
    for i in range(n):
        w[i] += q[i]
    for _ in range(START_SWEEPS):
        for i in range(n):
            step = min(max(z[i] - w[i] / M[i, i], lower[i]), upper[i]) - z[i]
            if step != 0.0:
                z[i] += step
                for j in range(n):
                    w[j] += step * M[i, j]


@compiled()
def start(W: Matrix, q: Vector, lower: Vector, upper: Vector, z: Vector, definite: bool, side: Indices) -> None:
    """Set ``side`` from the guess z, or from a few sweeps if z is at its bounds and M is symmetric."""
    n = len(z)
    cold = True
    for i in range(n):
        z[i] = min(max(z[i], lower[i]), upper[i])
        cold = cold and (z[i] == lower[i] or z[i] == upper[i])
    if cold and definite and W.shape[0] == n:
        guess(W, q, lower, upper, z, np.empty(n))
    sides(z, lower, upper, side)


@compiled()
def equal(a: Indices, b: Indices) -> bool:
    """Return whether two bases are equal."""
    same = True
    for i in range(len(a)):
        same = same and a[i] == b[i]
    return same


@compiled(most=FEW_ROWS)
def block_pivoting(
    W: Matrix, q: Vector, lower: Vector, upper: Vector, z: Vector, tol: float, max_iter: int
) -> tuple[int, int]:
    """Exchange the infeasible rows of successive complementary bases until none is left.

    A free row has w = 0 and z from M_αα z_α = -(q_α + M_αβ z_β); a row at a bound has z fixed and w free. A row is
    infeasible if z lies outside its bounds or w has the wrong sign; it then changes sides. Tolerances refer to the problem
    scaled to a unit diagonal, plus the rounding error of a product; then to each row's own terms, as long as this reduces
    the number of infeasible rows. The method requires a positive diagonal.
    """
    n = len(q)
    if not has_positive_diagonal(W):
        return UNDECIDED, 0
    definite = is_symmetric(W)
    counts, vectors = (
        np.empty((4, n), np.int64),
        np.empty((2, n)),
    )  # for few rows an array costs more than what is in it
    side = counts[0]
    basis = counts[1]
    wrong = counts[2]
    before = counts[3]
    w, root = vectors[0], vectors[1]
    start(W, q, lower, upper, z, definite, side)
    size = row_roots(W, q, root)
    fewest, patience = n + 1, PATIENCE
    before[:] = UNKNOWN_SIDE
    at = 0
    power = 1
    for step in range(1, max_iter + 1):
        if not basic_solution(W, definite, q, lower, upper, side, z):
            return SINGULAR, step
        product(W, z, w)

        terms = 0.0
        for i in range(n):
            terms += root[i] * abs(z[i])
        rounding = 1e-14 * size + 8.0 * EPS * terms
        infeasible = 0
        for i in range(n):
            basis[i] = n + i if side[i] == FREE else i
            w[i] += q[i]
            excess = violation(side[i], z[i], w[i], lower[i], upper[i], root[i])
            tiny = rounding * root[i]
            # A value below the rounding error of the largest terms may be significant in a row of small ones.
            feasible = excess <= 0.0 or (excess <= tiny and (patience < 0 or is_rounding(W, q, z, i, excess)))
            if not feasible:
                wrong[infeasible] = i
                infeasible += 1
        note(z, basis, NONE, NONE)
        if infeasible == 0:
            for i in range(n):
                z[i] = min(max(z[i], lower[i]), upper[i])
            return SOLVED, step
        if infeasible < fewest:
            fewest, patience = infeasible, PATIENCE
            before[:] = UNKNOWN_SIDE
            at = 0
            power = 1
        else:
            patience -= 1
        if patience < 0:
            # Single exchanges never repeat a basis for a P-matrix (Murty); otherwise Brent's test detects a cycle.
            if equal(before, side):
                return UNDECIDED, step
            if at == power:
                before[:] = side
                at = 0
                power = 2 * power
            at += 1
        for a in range(infeasible - 1 if patience < 0 else 0, infeasible):
            i = wrong[a]
            side[i] = FREE if side[i] != FREE else LOWER if z[i] < lower[i] else UPPER
    return MAX_ITER, max_iter


@dataclass(frozen=True, kw_only=True)
class BlockPivoting(CompiledSolver):
    """Block principal pivoting, compiled for dense and banded M, and by sparse LU for others."""

    def init(self, M: Delassus) -> SolverState:
        """Return the kernel for the storage of M."""
        if isinstance(M, Sparse | Factored):
            return SolverState(M.W, sparse_kernel(M), False, self.name)
        return super().init(M)


def sparse_kernel(
    M: Sparse | Factored,
    *,
    start_iterations: int = 97,
    next_iterations: int = 33,
    most_iterations: int = 1_000,
    max_alternations: int = 20,
) -> Kernel:
    """Return the kernel for one M, which keeps the factors of its last free rows.

    With the entries of a symmetric M, a cold start is that of nonlinear conjugate gradients, and some of their iterations
    choose the next free rows: exchanges alone move the boundary of a contact area by one row at a time.

    ``start_iterations``: number of iterations of nonlinear conjugate gradients of a cold start of sparse M.
    ``next_iterations``: number of such iterations from the first basic solution on; from each further one on half
    as many more.
    ``most_iterations``: maximum number of such iterations from one basic solution on.
    ``max_alternations``: maximum number of basic solutions with such iterations between them; then rows are
    exchanged by their signs alone.
    """
    from scipy.sparse import csc_array, csr_array

    from lcpimpact.lcp.sparse_pivoting import SparseContacts, SparseMatrix, SparseProduct, pivot

    if isinstance(M, Sparse):
        symmetric = M.has(Property.SYMMETRIC)
        contacts: SparseContacts = SparseMatrix(M.M, symmetric)
    else:
        H = csr_array(M.H)
        symmetric = False
        contacts = SparseProduct(H, csc_array(M.A), H.T)

    def kernel(W: Matrix, q: Array, lower: Array, upper: Array, z: Array, tol: float, max_iter: int) -> tuple[int, int]:
        side = np.empty(len(q), np.int64)
        status = Status.MAX_ITER
        steps = 0
        np.minimum(np.maximum(z, lower), upper, out=z)
        cold = bool(((z == lower) | (z == upper)).all())

        def improve(iterations: int) -> None:
            guess = z.copy()
            code, _ = for_entries(nncg)(W, q, lower, upper, guess, tol, iterations)
            if code in (SOLVED, MAX_ITER):
                z[:] = guess

        if cold and symmetric:
            improve(start_iterations)
        sides(z, lower, upper, side)
        if cold and not symmetric:
            w = contacts.product(z) + q
            side[((side == LOWER) & (w < 0.0) | (side == UPPER) & (w > 0.0)) & (lower < upper)] = FREE
        while symmetric and status is Status.MAX_ITER and steps < min(max_alternations, max_iter - 1):
            status, _, _ = pivot(contacts, q, lower, upper, side, z, tol, 1)
            steps += 1
            if status is Status.MAX_ITER:
                np.minimum(np.maximum(z, lower), upper, out=z)
                improve(min(int(next_iterations * 1.5 ** (steps - 1)), most_iterations))
                sides(z, lower, upper, side)
        if status is Status.MAX_ITER:
            status, more, _ = pivot(contacts, q, lower, upper, side, z, tol, max_iter - steps)
            steps += more
        return (SOLVED if status is Status.INACCURATE else int(status)), steps

    return kernel


SOLVER = BlockPivoting(
    name="block-pivoting",
    summary="block principal pivoting: min-map Newton with a safeguard; for large definite M and P-matrices",
    requires=(Property.POSITIVE_DIAGONAL,),
    storages=("dense", "banded", "sparse", "factored"),
    boxed=True,
    tol=1e-10,
    max_iter=200,
    source="JudicePires1994; PortugalJudiceVicente1994",
    kernel=block_pivoting,
)
