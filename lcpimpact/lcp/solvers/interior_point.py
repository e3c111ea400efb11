r"""Mehrotra's predictor-corrector interior-point method for monotone problems.

Each finite bound c of a row i(c) has the sign σ = 1 (lower) or -1 (upper), a slack s = σ (z_i - bound) > 0 and a
multiplier λ > 0. As μ decreases to zero the central path

.. math:: M z + q = \sum_c \sigma_c \lambda_c e_{i(c)}, \qquad s_c \lambda_c = \mu

leads to a solution; the number of iterations hardly grows with n.
"""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

import numpy as np

from lcpimpact.arrays import Indices, Matrix, Vector
from lcpimpact.compiled import compiled
from lcpimpact.errors import Status
from lcpimpact.lcp.judge import proves_infeasible
from lcpimpact.lcp.lapack import cholesky_solve, lu_solve
from lcpimpact.lcp.operators import Property
from lcpimpact.lcp.polish import identified, unknown_sides
from lcpimpact.lcp.problem import FREE, LOWER, UPPER
from lcpimpact.lcp.scaling import ScaledProblem, scaled
from lcpimpact.lcp.solver import CompiledSolver
from lcpimpact.lcp.storage import is_symmetric, product
from lcpimpact.lcp.trace import NONE, note
from lcpimpact.numerics.rounding import EPS

SOLVED = int(Status.SOLVED)
RAY = int(Status.RAY)
UNDECIDED = int(Status.UNDECIDED)
MAX_ITER = int(Status.MAX_ITER)


class Attempt(IntEnum):
    """Steps from an iterate, in the order in which they are tried."""

    PREDICTOR = 0
    CORRECTOR = 1
    CENTRING = 2


MIN_DECREASE = 0.01
"""Fraction of μ by which a full step must decrease it."""

MIN_STEP = 1e-10
"""Smallest step length."""

MAX_SIZE = 1e25
"""Scaled norm above which the iterates are considered divergent."""

MIN_MU = 1e-60
"""Smallest μ; below it rounding prevents a further decrease."""


class Slacks(NamedTuple):
    """The finite bounds c: row, σ, s and λ, with the steps ds and df of s and λ.

    Attributes
    ----------
    row : (m,) indices
    sign, s, force, ds, df : (m,) arrays
    """

    row: Indices
    sign: Vector
    s: Vector
    force: Vector
    ds: Vector
    df: Vector


class NewtonSystem(NamedTuple):
    """K = N + diag(barrier) and its factor; an infinite barrier fixes its row.

    Attributes
    ----------
    definite : bool             whether K has a Cholesky factor
    A : (n, n) array            the factor, scaled to a unit diagonal
    unit, barrier : (n,) arrays
    """

    definite: bool
    A: Matrix
    unit: Vector
    barrier: Vector


@compiled()
def start(low: Vector, high: Vector, x: Vector) -> Slacks:
    """Set x to an interior point of the box near zero, and return its slacks."""
    n = len(x)
    row = np.empty(2 * n, np.int64)
    sign = np.empty(2 * n)
    s = np.empty(2 * n)
    m = 0
    for i in range(n):
        inside = min(1.0, 0.5 * (high[i] - low[i]))
        x[i] = min(max(0.0, low[i] + inside), high[i] - inside)
        if low[i] > -np.inf and low[i] < high[i]:
            row[m] = i
            sign[m] = 1.0
            s[m] = max(x[i] - low[i], inside)
            m += 1
        if high[i] < np.inf and low[i] < high[i]:
            row[m] = i
            sign[m] = -1.0
            s[m] = max(high[i] - x[i], inside)
            m += 1
    force = np.empty(m)
    for c in range(m):
        force[c] = 1.0 / max(s[c], 1.0)
    return Slacks(row[:m], sign[:m], s[:m], force, np.zeros(m), np.zeros(m))


@compiled(inline="always")
def residual(problem: ScaledProblem, slacks: Slacks, x: Vector, r: Vector) -> float:
    """Set r = N x + p - Σ σ λ, and return max |r_i| over the rows with lower < upper."""
    N = problem.N
    p = problem.p
    low = problem.low
    high = problem.high
    product(N, x, r)
    for i in range(len(x)):
        r[i] += p[i]
    for c in range(len(slacks.row)):
        r[slacks.row[c]] -= slacks.sign[c] * slacks.force[c]
    error: float = 0.0
    for i in range(len(x)):
        if low[i] < high[i]:
            error = max(error, abs(r[i]))
    return error


@compiled(inline="always")
def read(
    problem: ScaledProblem, slacks: Slacks, lower: Vector, upper: Vector, x: Vector, z: Vector, side: Indices
) -> None:
    """Set z to the iterate, and ``side`` to its active set: a row is at a bound if λ > s."""
    low = problem.low
    high = problem.high
    unit = problem.unit
    row = slacks.row
    sign = slacks.sign
    s = slacks.s
    force = slacks.force
    for i in range(len(x)):
        side[i] = LOWER if low[i] == high[i] else FREE
        z[i] = x[i] * unit[i]
    for c in range(len(row)):
        i = row[c]
        if force[c] > s[c]:
            side[i] = LOWER if sign[c] > 0.0 else UPPER
        if c == 0 or row[c - 1] != i or s[c] < s[c - 1]:
            # Near a bound the slack is more accurate than z.
            z[i] = (lower[i] if sign[c] > 0.0 else upper[i]) + sign[c] * s[c] * unit[i]


@compiled(inline="always")
def factor_solve(N: Matrix, system: NewtonSystem, d: Vector) -> bool:
    """Overwrite d with K⁻¹ d, and A with the factor of K; return False if it is singular.

    A shift of the order of rounding regularises redundant rows.
    """
    definite = system.definite
    A = system.A
    unit = system.unit
    barrier = system.barrier
    n = len(d)
    for i in range(n):
        size = N[i, i] + barrier[i]
        unit[i] = 1.0 / np.sqrt(size) if size > 0.0 else 1.0
        d[i] *= unit[i]
    for i in range(n):
        for j in range(n):
            A[i, j] = N[i, j] * unit[i] * unit[j]
        if barrier[i] == np.inf:
            A[i, i] = 1.0
        else:
            A[i, i] = (N[i, i] + barrier[i]) * unit[i] * unit[i] + 16.0 * n * EPS
    regular = cholesky_solve(A, d) if definite else lu_solve(A, d)
    for i in range(n):
        d[i] *= unit[i]
    return regular


@compiled()
def solve_again(U: Matrix, unit: Vector, d: Vector) -> None:
    """Overwrite d with K⁻¹ d, using the Cholesky factor of `factor_solve`."""
    n = len(d)
    for k in range(n):
        d[k] = d[k] * unit[k]
    for k in range(n):
        d[k] /= U[k, k]
        for j in range(k + 1, n):
            d[j] -= U[k, j] * d[k]
    for k in range(n - 1, -1, -1):
        for j in range(k + 1, n):
            d[k] -= U[k, j] * d[j]
        d[k] /= U[k, k]
    for k in range(n):
        d[k] *= unit[k]


@compiled()
def room(x: Vector, d: Vector, most: float) -> float:
    """Return the largest step length <= most with x + length d >= 0."""
    for c in range(len(x)):
        if x[c] + most * d[c] < 0.0:
            most = x[c] / -d[c]
    return most


@compiled()
def mean_product(s: Vector, force: Vector, ds: Vector, df: Vector, length: float) -> float:
    """Return the mean of s λ after a step of the given length."""
    total = 0.0
    for c in range(len(s)):
        total += (s[c] + length * ds[c]) * (force[c] + length * df[c])
    return total / max(len(s), 1)


@compiled(inline="always")
def newton_step(
    problem: ScaledProblem,
    slacks: Slacks,
    system: NewtonSystem,
    r: Vector,
    d: Vector,
    target: float,
    correction: float,
    first: bool,
) -> bool:
    """Set d, ds and df to the Newton step towards s λ = target - correction ds df, with the previous ds and df.

    K is factored the first time, and, unless symmetric, each time. Returns False if it is singular.
    """
    N = problem.N
    low = problem.low
    high = problem.high
    row = slacks.row
    sign = slacks.sign
    s = slacks.s
    force = slacks.force
    ds = slacks.ds
    df = slacks.df
    barrier = system.barrier
    for i in range(len(d)):
        fixed = low[i] == high[i]
        d[i] = 0.0 if fixed else -r[i]
        barrier[i] = np.inf if fixed else 0.0
    for c in range(len(s)):
        i = row[c]
        barrier[i] += force[c] / s[c]
        d[i] += sign[c] * ((target - correction * ds[c] * df[c]) / s[c] - force[c])
    if not first and system.definite:
        solve_again(system.A, system.unit, d)
    elif not factor_solve(N, system, d):
        return False
    for c in range(len(s)):
        change = sign[c] * d[row[c]]
        df[c] = (target - correction * ds[c] * df[c] - force[c] * change) / s[c] - force[c]
        ds[c] = change
    return True


@compiled(inline="always")
def predict_correct(
    problem: ScaledProblem, slacks: Slacks, system: NewtonSystem, r: Vector, d: Vector, mu: float, error: float
) -> float:
    """Set d, ds and df to the predictor-corrector step at μ and |r| = error; return its length, -1 if K is singular."""
    s = slacks.s
    force = slacks.force
    ds = slacks.ds
    df = slacks.df
    target = 0.0
    correction = 0.0
    length = 0.0
    after = 0.0
    for attempt in (Attempt.PREDICTOR, Attempt.CORRECTOR, Attempt.CENTRING):
        if not newton_step(problem, slacks, system, r, d, target, correction, attempt == Attempt.PREDICTOR):
            return -1.0
        length = min(1.0, max(0.995, 1.0 - mu) * room(s, ds, room(force, df, 2.0)))
        after = mean_product(s, force, ds, df, length)
        if attempt == Attempt.CORRECTOR and (error > mu or after <= (1.0 - MIN_DECREASE * length) * mu):
            break
        ratio = after / mu if mu > 0.0 else 0.0
        target, correction = (mu * ratio * ratio * ratio, 1.0) if attempt == Attempt.PREDICTOR else (0.5 * mu, 0.0)
    while error <= mu and after > (1.0 - MIN_DECREASE * length) * mu and length > MIN_STEP:
        length *= 0.5
        after = mean_product(s, force, ds, df, length)
    return length


@compiled(most=0)
def interior_point(
    W: Matrix, q: Vector, lower: Vector, upper: Vector, z: Vector, tol: float, max_iter: int
) -> tuple[int, int]:
    """Predict the decrease of μ, choose the centring target, and correct for the second-order terms.

    Once |r| is below μ each step must decrease μ. If the corrected step does not, as may happen for strongly asymmetric M,
    it is replaced by an uncorrected step towards μ/2, shortened as needed.

    The problem is first scaled to a unit diagonal and max |q| = 1. Each iteration factors M + diag(Σ λ/s), for symmetric M
    once for both steps. The guess is not used as a start: the method starts inside the box near z = 0. When two successive
    iterates have the same free rows, their basic solution is tried. If the problem is infeasible the iterates diverge,
    usually along a ray that certifies it.
    """
    n = len(q)
    x = np.empty(n)
    r = np.empty(n)
    d = np.empty(n)
    w = np.empty(n)
    basis, sides = np.empty(n, np.int64), unknown_sides(n)
    for i in range(n):
        z[i] = min(max(z[i], lower[i]), upper[i])
        sides.now[i] = LOWER if z[i] <= lower[i] else UPPER if z[i] >= upper[i] else FREE
    if identified(W, q, lower, upper, sides, z, tol):
        return SOLVED, 1
    problem = scaled(W, q, lower, upper)
    N, p, low, high, unit = problem
    slacks = start(low, high, x)
    _, _, s, force, ds, df = slacks
    system = NewtonSystem(is_symmetric(W), np.empty((n, n)), np.empty(n), np.empty(n))
    length = 1.0
    for step in range(1, max_iter + 1):
        error = residual(problem, slacks, x, r)
        mu = mean_product(s, force, ds, df, 0.0)
        read(problem, slacks, lower, upper, x, z, sides.now)
        size = 0.0
        for i in range(n):
            size = max(size, abs(x[i]))
            basis[i] = n + i if sides.now[i] == FREE else i
        note(z, basis, NONE, NONE)
        if identified(W, q, lower, upper, sides, z, tol):
            return SOLVED, step
        if not size < MAX_SIZE or (len(s) > 0 and not mu > MIN_MU) or not length > MIN_STEP:
            return UNDECIDED, step
        length = predict_correct(problem, slacks, system, r, d, mu, error)
        if length < 0.0:
            return UNDECIDED, step
        for c in range(len(s)):
            s[c] += length * ds[c]
            force[c] += length * df[c]
        for i in range(n):
            x[i] += length * d[i]
            w[i] = d[i] * unit[i]
        # Checked in both scalings: rows of the unscaled M may lie below rounding error.
        if proves_infeasible(N, p, low, high, d) and proves_infeasible(W, q, lower, upper, w):
            z[:] = w
            return RAY, step
    return MAX_ITER, max_iter


SOLVER = CompiledSolver(
    name="interior-point",
    summary="Mehrotra predictor-corrector: few iterations at any n, for semidefinite M, not only symmetric",
    requires=(Property.PSD,),
    storages=("dense",),
    boxed=True,
    tol=1e-10,
    max_iter=100,
    source="Mehrotra1992; Wright1997, chapter 10",
    kernel=interior_point,
)
