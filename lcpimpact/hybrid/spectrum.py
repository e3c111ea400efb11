"""The rates of X' = A X: the spectral radius of |A|, balanced units, and the fastest rates split off."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.linalg import matrix_balance, schur, solve_sylvester

from lcpimpact.arrays import Array, Matrix
from lcpimpact.compiled import compiled
from lcpimpact.numerics.double_double import DoubleDouble
from lcpimpact.numerics.elimination import solve_finely

SQUARINGS = 14
"""log2 of the power of |A| whose size gives its spectral radius."""


@compiled()
def couplings(A: Matrix) -> Matrix:
    """Return |A| within strong components: zero where j acts on i and i does not act on j, even through others (N, N)."""
    n = len(A)
    acts = A != 0.0
    for k in range(n):
        for i in range(n):
            if acts[i, k]:
                acts[i] |= acts[k]
    found = np.zeros((n, n))
    for i in range(n):
        for j in range(n):
            if i == j or (acts[i, j] and acts[j, i]):
                found[i, j] = abs(A[i, j])
    return found


@compiled()
def spectral_radius(A: Matrix) -> float:
    """Return the spectral radius of |A|, at most 1e-3 too large, as a limit of ‖|A|ⁿ‖^{1/n} from above (Gelfand).

    The couplings between strong components, such as loads, have no part in it.
    """
    power, logarithm = couplings(A), 0.0
    for k in range(SQUARINGS + 1):
        size = power.max()
        if size == 0.0:
            return 0.0
        power /= size
        logarithm += math.log(size) / 2.0**k
        if k < SQUARINGS:
            power = power @ power
    return float(math.exp(logarithm) * len(A) ** (0.5**SQUARINGS))


def balance(A: Array) -> tuple[Array, Array]:
    """Return the balanced matrix D⁻¹ A D, and the diagonal of D, of powers of two."""
    if not A.any():
        return A, np.ones(len(A))
    with np.errstate(
        invalid="ignore"
    ):  # SciPy makes whole numbers of the scaling, for permutations that are not asked for
        balanced, (scaling, _) = matrix_balance(A, permute=False, separate=True)
    return balanced, scaling


class SplitRates(NamedTuple):
    """The fastest rates split off: X = Z y + Z_f y_f, y = L X, y_f = L_f X, and y' = B y.

    Attributes
    ----------
    fast, slow, back : DoubleDouble     L_f, L and Z: (nf, N), (N - nf, N), (N, N - nf)
    generator : DoubleDouble            B, with the slower rates only
    """

    fast: DoubleDouble
    slow: DoubleDouble
    back: DoubleDouble
    generator: DoubleDouble


def split_rates(generator: DoubleDouble, *, spectral_gap: float = 8.0, newton_steps: int = 4) -> SplitRates | None:
    """Split off the fastest rates, |λ| at least `spectral_gap` times the next; None where there is no such gap.

    ``spectral_gap``: smallest ratio of consecutive decay rates at which the faster ones are split off once they
    have decayed.
    ``newton_steps``: Newton steps that refine a splitting of the spectrum from floats to double-doubles.
    """
    balanced, scaling = balance(generator.hi)
    sizes = np.sort(np.abs(np.linalg.eigvals(balanced)))
    gaps = np.flatnonzero(sizes[1:] > spectral_gap * sizes[:-1])
    if len(gaps) == 0:
        return None
    n = int(gaps[-1]) + 1
    bound = float(sizes[n]) / math.sqrt(spectral_gap)
    _, Q, count = schur(balanced, sort=lambda re, im: math.hypot(re, im) < bound)
    if count != n:
        return None
    Z = DoubleDouble.of(np.diag(scaling) @ Q)
    for _ in range(newton_steps):
        B = solve_finely(Z, generator @ Z)
        up = solve_sylvester(B.hi[:n, :n], -B.hi[n:, n:], -B.hi[:n, n:])
        down = solve_sylvester(B.hi[n:, n:], -B.hi[:n, :n], -B.hi[n:, :n])
        Z = Z + Z @ np.block([[np.zeros((n, n)), up], [down, np.zeros_like(B.hi[n:, n:])]])
    B = solve_finely(Z, generator @ Z)
    L = solve_finely(Z, np.eye(len(generator)))
    return SplitRates(L[n:], L[:n], Z[:, :n], B[:n, :n])


def settling_time(A: Array, slow: int, *, decay_exponent: float = 40.0) -> float:
    """Return the time in s in which all modes but a number of slow ones decay; inf if they do not.

    ``decay_exponent``: exponent at which a decaying mode has vanished in floats: exp(-40) = 4e-18.
    """
    rates = np.linalg.eigvals(balance(A)[0])
    fast = rates[np.argsort(np.abs(rates))[slow:]]
    slowest = -float(fast.real.max())
    return decay_exponent / slowest if slowest > 0.0 else math.inf
