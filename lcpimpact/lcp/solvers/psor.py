"""Projected successive over-relaxation, with a relaxation factor adapted during the iteration.

For symmetric semidefinite M with positive diagonal each relaxed step decreases ½ zᵀ M z + qᵀ z for every 0 < ω < 2, so ω
may change between sweeps. Young's relation between the contraction of the sweeps and the best ω is exact for consistently
ordered M (chains, grids) and heuristic otherwise, so a new ω is kept only if it contracts faster.
"""

from __future__ import annotations

import numpy as np

from lcpimpact.arrays import Matrix, Vector
from lcpimpact.compiled import compiled
from lcpimpact.errors import Status
from lcpimpact.lcp.judge import holds, measure
from lcpimpact.lcp.operators import Property
from lcpimpact.lcp.solver import CompiledSolver
from lcpimpact.lcp.storage import diagonal, product, row_product
from lcpimpact.lcp.trace import NONE, note

SOLVED = int(Status.SOLVED)
RAY = int(Status.RAY)
MAX_ITER = int(Status.MAX_ITER)

CHECK_INTERVAL = 8
"""Number of sweeps, or of gradient steps, between checks of the residual; a check costs one of them."""

MIN_DAMPING = 1e-4
"""Smallest 2 - ω."""


@compiled()
def recedes(q: Vector, lower: Vector, upper: Vector, d: Vector, v: Vector, c: Vector) -> bool:
    """Return whether the energy is unbounded below along v, so that there is no solution; c = M v, d = diag(M).

    The tolerance 1e-11 also applies with a unit diagonal, so that small rows count. The judge verifies the certificate.
    """
    size, largest = 0.0, 0.0
    for i in range(len(q)):
        size = max(size, abs(v[i]) * np.sqrt(d[i]))
        largest = max(largest, abs(v[i]))
    slope, terms = 0.0, 0.0
    for i in range(len(q)):
        root = np.sqrt(d[i])
        tiny = 1e-11 * min(size / root, largest)
        if (lower[i] > -np.inf and v[i] < -tiny) or (upper[i] < np.inf and v[i] > tiny):
            return False
        bound = upper[i] if c[i] > 0.0 else lower[i]
        if abs(bound) == np.inf:
            if abs(c[i]) > 1e-11 * size * root:
                return False
            bound = 0.0
        slope += q[i] * v[i] + c[i] * bound
        terms += abs(q[i] * v[i]) + abs(c[i] * bound)
    return slope < -1e-9 * terms


@compiled()
def young(omega: float, contraction: float) -> float:
    r"""Return the optimal ω, given the contraction λ of sweeps with the current one.

    .. math:: (\lambda + \omega - 1)^2 = \lambda \omega^2 \mu^2, \qquad \omega_{best} = \frac{2}{1 + \sqrt{1 - \mu^2}}

    λ = ω - 1 shows only that the current ω is not too small; it is then reduced.
    """
    if contraction <= 1.02 * (omega - 1.0):
        return 2.0 - 1.5 * (2.0 - omega)
    mu = (contraction + omega - 1.0) / (np.sqrt(contraction) * omega)
    root: float = np.sqrt(max(1.0 - mu * mu, 0.0))
    return 2.0 / (1.0 + root)


@compiled()
def proposal(best: float, contraction: float, reach: float, direction: int) -> float:
    """Return the next trial ω: Young's for direction 0, else one above or below; or the best, if equivalent."""
    ratio = 1.0 / reach if direction > 0 else reach
    if direction == 0:
        ratio = min(max((2.0 - young(best, contraction)) / (2.0 - best), 1.0 / reach), reach)
    if abs(ratio - 1.0) < 0.05:
        return best
    return 2.0 - min(max(ratio * (2.0 - best), MIN_DAMPING), 1.0)


@compiled(most=0)
def psor(W: Matrix, q: Vector, lower: Vector, upper: Vector, z: Vector, tol: float, max_iter: int) -> tuple[int, int]:
    """Sweep z_i <- P(z_i - ω (M z + q)_i / M_ii) until the residual is within tol or repeating steps certify infeasibility.

    Each stage tries one ω in three equal parts; the first is discarded, and λ² per sweep is the ratio of the energy
    decreases in the other two. Early sweeps contract faster than later ones, so a trial ω that seems slower than the best
    is rejected only if a new stage of the best is faster. The next trial is Young's, after a first rejection one above or
    below the best. Stages are long enough for the effect of an ω near 2, and after a rejection for the contraction seen.
    """
    n = len(q)
    d = np.empty(n)
    w = np.empty(n)
    change = np.empty(n)
    basis = np.empty(n, np.int64)
    diagonal(W, d)
    omega = 1.0
    best = 1.0
    trial = 1.0
    best_rate, trial_rate = np.inf, np.inf
    reach = 8.0
    direction = 0
    patience = 1.0
    count = 0
    third = 4
    early = 0.0
    late = 0.0
    for sweep in range(1, max_iter + 1):
        fall = 0.0
        for i in range(n):
            m, old = d[i], z[i]
            slope = row_product(W, i, z) + q[i]
            z[i] = min(max(old - omega * slope / m, lower[i]), upper[i])
            change[i] = z[i] - old
            fall -= change[i] * (slope + 0.5 * m * change[i])
            basis[i] = n + i if lower[i] < z[i] < upper[i] else i
        note(z, basis, NONE, NONE)
        if sweep % CHECK_INTERVAL == 1 or sweep == max_iter:
            scaled, _, rounding = measure(W, q, lower, upper, z, w)
            if holds(scaled, rounding, tol):
                return SOLVED, sweep
            product(W, change, w)
            if recedes(q, lower, upper, d, change, w):
                z[:] = change
                return RAY, sweep

        count += 1
        if count > 2 * third:
            late += fall
        elif count > third:
            early += fall
        if count < 3 * third:
            continue
        rate = (late / early) ** (0.5 / third) if 0.0 < early < np.inf and 0.0 < late < np.inf else 0.0
        if omega != best and rate >= best_rate:
            trial = omega
            trial_rate = rate
            omega = best
        else:
            if omega == best and trial_rate <= rate:
                omega, rate = trial, trial_rate
            elif trial_rate < np.inf:
                direction = 1 if direction < 0 else -1
                reach, patience = max(np.sqrt(reach), 1.2), 1.5 * patience
            best = omega
            best_rate = rate
            trial_rate = np.inf
            omega = proposal(best, best_rate, reach, direction)
            if omega == best:
                direction = -direction
        horizon = 1.0 / (2.0 - omega)
        if direction != 0:
            horizon = max(horizon, 0.5 / max(1.0 - min(best_rate, trial_rate), 1e-3))
        count = 0
        third = 4 + int(patience * horizon)
        early = 0.0
        late = 0.0
    return MAX_ITER, max_iter


SOLVER = CompiledSolver(
    name="psor",
    summary="projected successive over-relaxation, its factor found on the way: chains in O(n) sweeps",
    requires=(Property.SYMMETRIC, Property.PSD, Property.POSITIVE_DIAGONAL),
    storages=("dense", "banded", "sparse"),
    boxed=True,
    tol=1e-12,
    max_iter=20_000,
    source="Cryer1971; Young1954; HagemanYoung1981, chapter 9",
    kernel=psor,
)
