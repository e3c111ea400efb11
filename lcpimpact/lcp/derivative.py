r"""Derivatives of the solution of an LCP by its data.

Between their bounds are the rows α, with w = 0, and at them the rows β, with w ≠ 0 and z = b. Then

.. math:: dz_β = db_β, \qquad M_{αα}\, dz_α = -(dq + dM\, z + M_{αβ}\, db_β)_α .

Ties γ have z at a bound and w = 0. The one-sided derivative solves an LCP in dz_γ, with the Schur complement

.. math:: S = M_{γγ} - M_{γα} M_{αα}^{-1} M_{αγ},

and is the only one if S is a P-matrix (the solution is then strongly regular, Robinson 1980).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from lcpimpact.arrays import Array, Flags, Indices, Matrix, Vector
from lcpimpact.compiled import compiled
from lcpimpact.errors import InputError, UnsupportedError
from lcpimpact.lcp.judge import PROOF_RTOL
from lcpimpact.lcp.lapack import PIVOT_TOL
from lcpimpact.lcp.operators import Banded, Delassus, Dense, Factored, Property, Sparse, as_operator, finite_array
from lcpimpact.lcp.problem import FREE, LCP, LOWER, UPPER
from lcpimpact.lcp.solve import solve_lcp
from lcpimpact.lcp.solver import for_storage
from lcpimpact.lcp.storage import absolute_product, longest_row, weight
from lcpimpact.numerics.rounding import EPS

if TYPE_CHECKING:
    from lcpimpact.lcp.problem import LCPSolution

Solve = Callable[[Array], Array]


@compiled()
def measure_rows(W: Matrix, q: Vector, z: Vector, size: Vector, effect: Vector) -> float:
    """Set ``size`` to the terms |q| + |M| |z| of each row, and ``effect`` to the largest effect of each z_i on a row.

    Returns the rounding error of a row, relative to its terms.
    """
    absolute_product(W, z, size)
    for i in range(len(q)):
        size[i] += abs(q[i])
    for i in range(len(q)):
        effect[i] = weight(W, i, size)
    return (longest_row(W) + 2) * EPS


class Factors(NamedTuple):
    """Solutions with M_αα and with its transpose."""

    solve: Solve
    transposed: Solve


class Basis(NamedTuple):
    """A basic solution of an LCP, and its ties.

    Attributes
    ----------
    rows : (k,) indices         the rows α between their bounds
    side : (n,) indices         FREE, LOWER or UPPER; a tie is at its bound
    tie : (n,) flags
    z : (n,) array
    factors : Factors
    """

    rows: Indices
    side: Indices
    tie: Flags
    z: Array
    factors: Factors


@np.errstate(invalid="ignore")  # an infinite room times zero is no number, and no tie
def derivative(
    solution: LCPSolution,
    dM: Any,
    dq: ArrayLike | None,
    dlower: ArrayLike | None,
    dupper: ArrayLike | None,
    one_sided: bool,
) -> Array:
    """Return dz; see `LCPSolution.derivative`."""
    problem = solution.problem
    if problem is None:
        raise InputError("derivative: this solution holds no problem: take one that solve_lcp returned")
    if not solution.success:
        raise UnsupportedError(
            f"derivative: there is no solution to differentiate, as the status is: {solution.message}"
        )
    n = problem.M.n
    low, high = _bound_rates("lower", dlower, problem.lower), _bound_rates("upper", dupper, problem.upper)
    fixed = problem.lower == problem.upper
    if (low[fixed] != high[fixed]).any():
        i = int(np.flatnonzero(fixed & (low != high))[0])
        raise InputError(f"derivative: lower[{i}] = upper[{i}] must stay so: give both the same rate")
    rate = _vector("dq", dq, n)
    basis = _basis(solution, problem)
    if dM is not None:
        rate += _product(_same_order(dM, n), basis.z)
    ties = np.flatnonzero(basis.tie)
    if len(ties) and not one_sided:
        i = int(ties[0])
        more = f", and {len(ties) - 1} more" if len(ties) > 1 else ""
        raise UnsupportedError(
            f"derivative: z has none here, as row {i} is a tie, z[{i}] at its bound and w[{i}] = 0 within rounding{more}: "
            "take one_sided=True for the derivative in this direction"
        )
    dz = np.where(basis.side == LOWER, low, np.where(basis.side == UPPER, high, 0.0))
    dz[ties] = 0.0
    rate += _product(problem.M, dz)
    if len(ties):
        rate += _solve_ties(problem.M, basis, ties, rate, low, high, dz)
    dz[basis.rows] = -basis.factors.solve(rate[basis.rows])
    return dz + 0.0


def _solve_ties(M: Delassus, basis: Basis, ties: Indices, rate: Array, low: Array, high: Array, dz: Array) -> Array:
    """Set dz of the ties, and return M dz of them."""
    n = M.n
    transposed = np.empty((len(ties), n))
    for column, j in zip(transposed, ties, strict=True):
        M.column(int(j), column)
    columns = transposed.T
    inner = np.zeros((n, len(ties) + 1))
    inner[basis.rows] = basis.factors.solve(np.column_stack([columns, rate])[basis.rows])
    through = np.column_stack([_product(M, each) for each in inner.T])[ties]
    S, s = Dense(columns[ties] - through[:, :-1]), rate[ties] - through[:, -1]
    if not S.has(Property.P):
        raise UnsupportedError(
            "derivative: several solutions may continue this one, as its ties leave no P-matrix: look for redundant contacts"
        )
    lower = np.where(basis.side[ties] == LOWER, low[ties], -np.inf)
    upper = np.where(basis.side[ties] == UPPER, high[ties], np.inf)
    dz[ties] = solve_lcp(S, s, lower=lower, upper=upper).z
    return columns @ dz[ties]


def _basis(solution: LCPSolution, problem: LCP) -> Basis:
    """Return the basic solution at the rows of the solution between their bounds, and its ties."""
    M, q = problem.M, problem.q
    lower, upper = problem.lower, problem.upper
    z = solution.z
    size, effect = np.empty(M.n), np.empty(M.n)
    rounding = for_storage(measure_rows, M.W)(M.W, q, z, size, effect)
    w = _product(M, z) + q
    if not (np.abs(w - solution.w) <= 4.0 * rounding * size).all():
        raise InputError(
            "derivative: M, q or z is no longer that of the solution: solve again, or change copies of them"
        )
    unit = np.where(size > 0.0, size, 1.0)
    room = np.minimum(z - lower, upper - z)
    inside, pushed = np.where(room > 0.0, room * effect, 0.0), np.abs(w) / unit
    equation = (lower == -np.inf) & (upper == np.inf)
    bound = np.where(z - lower <= upper - z, LOWER, UPPER)
    side = np.where(equation | (inside > pushed) & (lower < upper), FREE, bound)
    basis = _with_sides(problem, side, rounding)
    if basis is None:
        raise UnsupportedError(
            "derivative: z has none here, as M is singular in the rows between their bounds: look for redundant contacts"
        )
    if not isinstance(basis, Basis):
        raise UnsupportedError(
            f"derivative: the solution by {solution.solver!r} is too inexact to say which rows are at a bound: solve with a "
            "smaller tol, or a direct solver, as 'auto'"
        )
    return basis


def _with_sides(problem: LCP, side: Indices, rounding: float) -> Basis | bool | None:
    """Return the basic solution of these sides, with ties at their bounds; False if it is none, None if M_αα is singular."""
    M, q = problem.M, problem.q
    lower, upper = problem.lower, problem.upper
    rows = np.flatnonzero(side == FREE)
    factors = _factors(M, rows)
    if factors is None:
        return None
    z = np.where(side == LOWER, lower, np.where(side == UPPER, upper, 0.0))
    for _ in range(2):  # the second is a refinement
        z[rows] -= factors.solve((_product(M, z) + q)[rows])
    w = _product(M, z) + q
    size, effect = np.empty(M.n), np.empty(M.n)
    for_storage(measure_rows, M.W)(M.W, q, z, size, effect)
    room = np.where(side == FREE, np.minimum(z - lower, upper - z), np.where(side == LOWER, w, -w))
    room[lower == upper] = np.inf
    # The rounding errors of the rows α change z_α by M_αα⁻¹ times them, and w_β by that times M_βα.
    change = np.where(side == FREE, effect, 1.0 / np.where(size > 0.0, size, 1.0))
    tie = np.zeros(M.n, dtype=np.bool_)
    for i in np.flatnonzero((room <= 0.0) | (np.abs(room) * change <= PROOF_RTOL)):
        row = _row(M, int(i))[rows] if side[i] != FREE else (rows == i).astype(np.float64)
        error = np.abs(factors.transposed(row)) @ size[rows] + (size[i] if side[i] != FREE else 0.0)
        if room[i] < -rounding * error:
            return False
        tie[i] = room[i] <= rounding * error
    moved = tie & (side == FREE)
    if not moved.any():
        return Basis(rows, side, tie, z, factors)
    bound = np.where(z - lower <= upper - z, LOWER, UPPER)
    return _with_sides(problem, np.where(moved, bound, side), rounding)


def _factors(M: Delassus, rows: Indices) -> Factors | None:
    """Return the factors of M_αα, sparse if M is; None if it is singular to rounding."""
    if not len(rows):
        return Factors(np.zeros_like, np.zeros_like)
    if isinstance(M, Dense):
        return _lu(M.M[np.ix_(rows, rows)])
    if isinstance(M, Factored):
        return _lu_of_product(M, rows) if M.is_sparse else _lu(M.array()[np.ix_(rows, rows)])
    entries = M.M if isinstance(M, Sparse) else _entries(M)
    return _sparse_lu(entries[rows][:, rows])


def _lu(A: Array) -> Factors | None:
    """Return the factors of a dense matrix, scaled to a largest entry near one in each row and column."""
    from scipy.linalg import get_lapack_funcs

    row, unit = _scales(np.abs(A))
    factor, solve = get_lapack_funcs(("getrf", "getrs"), (A,))
    *lu, info = factor(row[:, None] * A * unit)
    if info != 0 or not np.abs(np.diag(lu[0])).min() > PIVOT_TOL:
        return None
    return _scaled(lambda b, transposed: np.asarray(solve(*lu, b, trans=transposed)[0]), row, unit)


def _sparse_lu(A: Any) -> Factors | None:
    """Return the factors of a sparse matrix, scaled likewise."""
    from scipy.sparse import diags_array
    from scipy.sparse.linalg import splu

    row, unit = _scales(abs(A))
    try:
        lu = splu((diags_array(row) @ A @ diags_array(unit)).tocsc())
    except RuntimeError:
        return None
    if not np.abs(lu.U.diagonal()).min() > PIVOT_TOL:
        return None
    return _scaled(lambda b, transposed: np.asarray(lu.solve(b, "T" if transposed else "N")), row, unit)


def _lu_of_product(M: Factored, rows: Indices) -> Factors | None:
    """Return the factors of H_α A⁻¹ H_αᵀ, by those of the sparse matrix of forces and velocities together."""
    from scipy.sparse import block_array, csr_array

    H = csr_array(M.H)[rows]
    whole = _sparse_lu(block_array([[csr_array(M.A), -H.T], [H, None]]).tocsr())
    if whole is None:
        return None
    m = M.A.shape[0]

    def part(solve: Solve) -> Solve:
        return lambda b: solve(np.concatenate([np.zeros((m, *b.shape[1:])), b]))[m:]

    return Factors(part(whole.solve), part(whole.transposed))


def _scales(size: Any) -> tuple[Array, Array]:
    """Return factors of rows, and then of columns, that bring the largest entries of |A| to one."""

    def inverse(largest: Any) -> Array:
        found = np.asarray(largest.toarray() if hasattr(largest, "toarray") else largest, dtype=np.float64).ravel()
        return np.asarray(1.0 / np.where(found > 0.0, found, 1.0))

    row = inverse(size.max(axis=1))
    scaled = size.multiply(row[:, None]).tocsr() if hasattr(size, "multiply") else row[:, None] * size
    return row, inverse(scaled.max(axis=0))


def _scaled(solve: Callable[[Array, int], Array], row: Array, unit: Array) -> Factors:
    """Return the solutions with A, from those with row A unit."""

    def scale(factors: Array, b: Array) -> Array:
        return (factors * b.T).T

    return Factors(
        lambda b: scale(unit, solve(scale(row, b), 0)),
        lambda b: scale(row, solve(scale(unit, b), 1)),
    )


def _entries(M: Delassus) -> Any:
    """Return the entries of a banded M by rows."""
    from scipy.sparse import diags_array

    assert isinstance(M, Banded)
    bands = [M.bands[k, : M.n - k] for k in range(len(M.bands))]
    offsets = [*range(0, -len(bands), -1), *range(1, len(bands))]
    return diags_array([*bands, *bands[1:]], offsets=offsets, shape=(M.n, M.n)).tocsr()


def _row(M: Delassus, i: int) -> Array:
    """Return M_i·."""
    if isinstance(M, Dense):
        return np.asarray(M.M[i])
    if isinstance(M, Sparse):
        return np.asarray(M.M[[i]].toarray()[0])
    row = np.empty(M.n)
    M.column(i, row)
    return row


def _product(M: Delassus, z: Array) -> Array:
    """Return M z."""
    w = np.empty(M.n)
    M.product(np.ascontiguousarray(z), w)
    return w


def _same_order(dM: Any, n: int) -> Delassus:
    """Return dM as an operator of order n."""
    try:
        given = as_operator(dM)
    except InputError as error:
        raise InputError(f"derivative: dM is given in a form of M, and {error}") from None
    if given.n != n:
        raise InputError(f"derivative: dM must be of order {n}, as M is, and it is of order {given.n}")
    return given


def _vector(name: str, values: ArrayLike | None, n: int) -> Array:
    """Return rates of the rows, of which one number counts for all bounds; by default 0."""
    found = finite_array(name, 0.0 if values is None else values)
    if found.shape != (n,) and not (found.shape == () and (values is None or name != "dq")):
        raise InputError(f"derivative: {name} must have shape ({n},) to fit M, and its shape is {found.shape}")
    return np.array(np.broadcast_to(found, (n,)))


def _bound_rates(name: str, values: ArrayLike | None, bound: Array) -> Array:
    """Return the rates of one of the bounds; those of infinite ones, which one number leaves out, are 0."""
    found = _vector(f"d{name}", values, len(bound))
    infinite = np.isinf(bound)
    if np.ndim(values if values is not None else 0.0) and found[infinite].any():
        i = int(np.flatnonzero(infinite & (found != 0.0))[0])
        raise InputError(f"derivative: d{name}[{i}] = {found[i]:g} moves no bound, as {name}[{i}] is infinite: give 0")
    found[infinite] = 0.0
    return found
