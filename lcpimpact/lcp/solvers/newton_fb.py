r"""Newton's method for the Fischer-Burmeister equations, globalised by a line search.

.. math:: \varphi(a, b) = a + b - \sqrt{a^2 + b^2} = 0 \iff a \ge 0,\ b \ge 0,\ a b = 0

turns a row of the LCP into the equation φ(z - lower, w) = 0, and a row with two bounds into Billups's
φ(z - lower, -φ(upper - z, -w)) = 0. The merit function, half the sum of squares, is smooth; steepest descent on it is the
fallback.
"""

from __future__ import annotations

import numpy as np

from lcpimpact.arrays import Matrix, Vector
from lcpimpact.compiled import compiled
from lcpimpact.errors import Status
from lcpimpact.lcp.judge import proves_infeasible
from lcpimpact.lcp.lapack import lu_solve
from lcpimpact.lcp.polish import identified, unknown_sides
from lcpimpact.lcp.problem import FREE, LOWER, UPPER
from lcpimpact.lcp.scaling import ScaledProblem, scaled
from lcpimpact.lcp.solver import CompiledSolver
from lcpimpact.lcp.storage import product
from lcpimpact.lcp.trace import NONE, note

SOLVED = int(Status.SOLVED)
RAY = int(Status.RAY)
UNDECIDED = int(Status.UNDECIDED)
MAX_ITER = int(Status.MAX_ITER)

CORNER = 1.0 - float(np.sqrt(0.5))
"""Generalised derivatives of φ at (0, 0): their value on a = b > 0."""

ARMIJO = 1e-4
"""Fraction of the predicted decrease required by the Armijo condition."""

MIN_STEP = 2.0**-40
"""Smallest step length."""

LEAST_SHIFT, MOST_SHIFT = 1e-12, 1e-2
"""Range of the shift ε added to a singular M with a unit diagonal."""


@compiled()
def fischer_burmeister(a: float, b: float) -> tuple[float, float, float]:
    """Return φ and its two derivatives."""
    size = max(abs(a), abs(b))
    if size == 0.0:
        return 0.0, CORNER, CORNER
    x, y = a / size, b / size
    h = np.sqrt(x * x + y * y)
    # Also φ = 2 a b / (a + b + h): the form without cancellation is used.
    value = 2.0 * a * y / (x + y + h) if x + y > 0.0 else size * (x + y - h)
    return value, 1.0 - x / h, 1.0 - y / h


@compiled()
def row_equation(z: float, w: float, lower: float, upper: float) -> tuple[float, float, float]:
    """Return Φ_i and its derivatives with respect to z_i and w_i, which are >= 0 and not both zero."""
    below, above = lower > -np.inf, upper < np.inf
    if lower == upper:
        return z - lower, 1.0, 0.0
    if not below and not above:
        return w, 0.0, 1.0
    if not above:
        return fischer_burmeister(z - lower, w)
    inner, inner_z, inner_w = fischer_burmeister(upper - z, -w)
    if not below:
        return -inner, inner_z, inner_w
    value, by_z, by_inner = fischer_burmeister(z - lower, -inner)
    return value, by_z + by_inner * inner_z, by_inner * inner_w


@compiled()
def merit(z: Vector, w: Vector, lower: Vector, upper: Vector) -> float:
    """Return Ψ = ½ Σ Φ_i²."""
    total = 0.0
    for i in range(len(z)):
        value = row_equation(z[i], w[i], lower[i], upper[i])[0]
        total += 0.5 * value * value
    return total


@compiled()
def dot(a: Vector, b: Vector) -> float:
    """Return a·b."""
    total = 0.0
    for i in range(len(a)):
        total += a[i] * b[i]
    return total


@compiled()
def newton_step(N: Matrix, phi: Vector, by_z: Vector, by_w: Vector, shift: float, d: Vector) -> bool:
    """Set d = -J⁻¹ Φ, J = diag(∂Φ/∂z) + diag(∂Φ/∂w) (N + ε I); return False if J is singular to rounding."""
    n = len(d)
    J = np.empty((n, n))
    for i in range(n):
        for j in range(n):
            J[i, j] = by_w[i] * N[i, j]
        J[i, i] += by_z[i] + by_w[i] * shift
        d[i] = -phi[i]
    return lu_solve(J, d)


@compiled()
def merit_gradient(N: Matrix, phi: Vector, by_z: Vector, by_w: Vector, gradient: Vector) -> None:
    """Set ``gradient`` to ∇Ψ = Jᵀ Φ."""
    n = len(phi)
    for j in range(n):
        gradient[j] = by_z[j] * phi[j]
    for i in range(n):
        for j in range(n):
            gradient[j] += by_w[i] * phi[i] * N[i, j]


@compiled()
def line_search(
    problem: ScaledProblem, x: Vector, y: Vector, psi: float, gradient: Vector, d: Vector, trial: Vector
) -> bool:
    """Set ``trial`` to x + length d by backtracking from 1 to the Armijo condition; return False if none satisfies it."""
    N = problem.N
    low = problem.low
    high = problem.high
    n = len(x)
    slope, w = np.empty(n), np.empty(n)
    fall = dot(gradient, d)
    product(N, d, slope)
    length = 1.0 if fall < -1e-12 * np.sqrt(dot(gradient, gradient)) * np.sqrt(dot(d, d)) else 0.0
    while length >= MIN_STEP:
        for i in range(n):
            trial[i] = x[i] + length * d[i]
            w[i] = y[i] + length * slope[i]
        if merit(trial, w, low, high) <= psi + ARMIJO * length * fall:
            return True
        length *= 0.5
    return False


@compiled(most=0)
def newton_fb(
    W: Matrix, q: Vector, lower: Vector, upper: Vector, z: Vector, tol: float, max_iter: int
) -> tuple[int, int]:
    """Take damped Newton steps -J⁻¹ Φ that decrease Ψ = ½ Φ·Φ, until the active set is identified.

    The problem is first scaled to a unit diagonal and max |q| = 1. Where J is singular, as near the solutions of a singular
    M, or its step fails the line search, M is replaced by M + ε I with increasing ε, and finally the step by -∇Ψ. When two
    successive iterates have the same free rows, their basic solution is tried. Steps that grow along a ray may certify
    infeasibility; a stationary Ψ > 0 may also be a local minimum.
    """
    n = len(q)
    x = np.empty(n)
    y = np.empty(n)
    d = np.empty(n)
    trial = np.empty(n)
    w = np.empty(n)
    phi = np.empty(n)
    by_z = np.empty(n)
    by_w = np.empty(n)
    gradient = np.empty(n)
    basis, sides = np.empty(n, np.int64), unknown_sides(n)
    problem = scaled(W, q, lower, upper)
    N, p, low, high, unit = problem
    for i in range(n):
        x[i] = z[i] / unit[i]
    before = np.inf
    for step in range(1, max_iter + 1):
        product(N, x, y)
        for i in range(n):
            y[i] += p[i]
            phi[i], by_z[i], by_w[i] = row_equation(x[i], y[i], low[i], high[i])
            side = LOWER if x[i] - y[i] <= low[i] else UPPER if x[i] - y[i] >= high[i] else FREE
            sides.now[i], basis[i] = side, n + i if side == FREE else i
            z[i] = min(max(x[i] * unit[i], lower[i]), upper[i])
        note(z, basis, NONE, NONE)
        if identified(W, q, lower, upper, sides, z, tol):
            return SOLVED, step
        psi = 0.5 * dot(phi, phi)
        if not psi < (1.0 - 1e-13) * before:
            return UNDECIDED, step
        before = psi

        merit_gradient(N, phi, by_z, by_w, gradient)
        shift, found = 0.0, False
        while not found and shift <= MOST_SHIFT:
            regular = newton_step(N, phi, by_z, by_w, shift, d)
            found = regular and line_search(problem, x, y, psi, gradient, d, trial)
            shift = max(100.0 * shift, LEAST_SHIFT)
        if not found:
            for i in range(n):
                d[i] = -gradient[i]
            if not line_search(problem, x, y, psi, gradient, d, trial):
                return UNDECIDED, step
        for i in range(n):
            x[i] = trial[i]
            w[i] = d[i] * unit[i]
        # Checked in both scalings: rows of the unscaled M may lie below rounding error.
        if proves_infeasible(N, p, low, high, d) and proves_infeasible(W, q, lower, upper, w):
            z[:] = w
            return RAY, step
    return MAX_ITER, max_iter


SOLVER = CompiledSolver(
    name="newton-fb",
    summary="semismooth Newton for the Fischer-Burmeister equations, with a line search; any M, and bounds",
    requires=(),
    storages=("dense",),
    boxed=True,
    tol=1e-10,
    max_iter=200,
    source="Fischer1992; DeLucaFacchineiKanzow1996; Billups1995, for bounds",
    kernel=newton_fb,
)
