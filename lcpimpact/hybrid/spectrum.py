"""The rates of X' = A X: the spectral radius of |A|, balanced units, and the fastest rates split off."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eig, matrix_balance, null_space, schur, solve_continuous_lyapunov, solve_sylvester

from lcpimpact.arrays import Array, Indices, Matrix
from lcpimpact.compiled import compiled
from lcpimpact.numerics.double_double import DoubleDouble

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


class RateBlocks(NamedTuple):
    """The motion in blocks of its rates: X = Z y, y = L X, and y' = B y with a block-diagonal B.

    Attributes
    ----------
    L, Z, B : DoubleDouble (N, N)
    bounds : (nb + 1,) array        the first state of each block, and the end; those that decay are first, the fastest ahead
    decay : (nb,) array             slowest decay rate in each block in 1/s; 0 for one that need not decay
    radius : (nb,) array            spectral radius of |B| in each
    norm, inverse : (N, N) arrays   S and S⁻¹, block-diagonal: |S y| of a block that decays never grows
    """

    L: DoubleDouble
    Z: DoubleDouble
    B: DoubleDouble
    bounds: Indices
    decay: Array
    radius: Array
    norm: Array
    inverse: Array

    @property
    def blocks(self) -> list[slice]:
        """The states of each block."""
        return [slice(a, b) for a, b in pairwise(self.bounds.tolist())]


def split_rates(
    generator: DoubleDouble,
    *,
    spectral_gap: float = 1.05,
    largest_projector: float = 1e3,
    damped: float = 1e-3,
    newton_steps: int = 4,
    coupled: float = 2.0**-90,
    known: float = 2.0**-80,
) -> RateBlocks | None:
    """Split the rates into blocks, |λ| of each at least `spectral_gap` times that of the next; None if none decays.

    ``largest_projector``: norm of the projector onto a block, in balanced units, above which it is not split off: readings
    in floats lose as many digits.
    ``damped``: smallest decay of a rate that decays, relative to it.
    ``newton_steps``: maximum number of Newton steps that refine the blocks from floats to double-doubles.
    ``coupled``: share of one block in another, in balanced units, that is the rounding of double-doubles.
    ``known``: smallest decay, relative to the largest rate, that stands out of that rounding.
    """
    balanced, scaling = balance(generator.hi)

    def by_size(rates: NDArray[np.complex128]) -> tuple[Indices, list[tuple[int, int]], bool]:
        """Return the order of rates by size, the blocks in it, and whether one decays."""
        order = np.argsort(-np.abs(rates), kind="stable")
        real, sizes = rates[order].real, np.abs(rates[order])
        cuts = np.flatnonzero(sizes[:-1] > spectral_gap * sizes[1:]) + 1
        blocks = list(pairwise([0, *cuts.tolist(), len(sizes)]))
        return order, blocks, any(-real[a:b].max() > damped * sizes[a] for a, b in blocks)

    if not by_size(np.linalg.eigvals(balanced).astype(np.complex128))[2]:
        return None  # at once: the bases of a hundred blocks take seconds
    rates, left, right = eig(balanced, left=True, right=True)
    order, blocks, _ = by_size(rates)
    rates, sizes = rates[order], np.abs(rates[order])
    found: list[tuple[Array, Array]] = []
    widths: list[int] = []
    decays = False
    for a, b in blocks:
        V = _basis(balanced, right[:, order[a:b]], sizes[a:b])
        W = _basis(balanced.T, left[:, order[a:b]], sizes[a:b])
        if V is not None and W is not None and np.linalg.norm(np.linalg.pinv(W.T @ V), 2) <= largest_projector:
            found.append((V, W))
            widths.append(b - a)
            decays |= bool(-rates.real[a:b].max() > damped * sizes[a])
    if not decays:
        return None
    V, W = (np.hstack(each) for each in zip(*found, strict=True))
    rest = null_space(W.T, rcond=1e-14)
    if V.shape[1] + rest.shape[1] != len(sizes):
        return None
    widths += [rest.shape[1]] * (rest.shape[1] > 0)
    bounds = np.cumsum([0, *widths])
    fine = DoubleDouble(generator.parts * (scaling / scaling[:, None]))  # exactly, as these are powers of two
    Z = DoubleDouble.of(np.hstack([V, rest]))
    for _ in range(newton_steps + 1):
        L = _inverse(Z)
        B = L @ (fine @ Z)
        E = _rotation(B.hi, bounds)
        if np.abs(E).max() <= coupled:
            break
        Z = Z + Z @ E
    else:
        return None
    # Floats lose the slow rates beside fast ones; those of the refined blocks are known.
    decay = np.zeros(len(widths))
    for k, (a, b) in enumerate(pairwise(bounds.tolist())):
        own = np.linalg.eigvals(B.hi[a:b, a:b])
        slowest = -float(own.real.max())
        if k < len(found) and slowest > max(damped * float(np.abs(own).max()), known * sizes[0]):
            decay[k] = slowest
    first = np.argsort(decay == 0.0, kind="stable")  # those that decay are first
    places = np.concatenate([np.arange(bounds[k], bounds[k + 1]) for k in first])
    L, Z = DoubleDouble(L.parts[:, places] / scaling), DoubleDouble(Z.parts[:, :, places] * scaling[:, None])
    B = DoubleDouble(B.parts[:, places[:, None], places])
    return _block_diagonal(L, Z, B, np.cumsum([0, *np.array(widths)[first]]), decay[first])


def _basis(A: Array, vectors: Array, sizes: Array, *, rtol: float = 1e-6) -> Array | None:
    """Return an orthonormal basis (N, k) of the subspace of the rates of some sizes; None if it is not found."""
    if len(sizes) == 1:
        return np.asarray(vectors.real / np.linalg.norm(vectors.real))
    low, high = sizes[-1] * (1.0 - rtol), sizes[0] * (1.0 + rtol)
    _, Q, count = schur(A, sort=lambda re, im: low <= math.hypot(re, im) <= high)
    return np.asarray(Q[:, :count]) if count == len(sizes) else None


def _inverse(Z: DoubleDouble, *, steps: int = 2) -> DoubleDouble:
    """Return Z⁻¹, that of floats refined by Newton's steps L (2 - Z L)."""
    L = DoubleDouble.of(np.linalg.inv(Z.hi))
    for _ in range(steps):
        L = L + L @ (np.eye(len(Z)) - Z @ L)
    return L


def _rotation(B: Array, bounds: Indices) -> Array:
    """Return E, by which Z (1 + E) makes B block-diagonal to first order: B_aa E_ab - E_ab B_bb = -B_ab."""
    single = np.diff(bounds) == 1
    at = bounds[:-1][single]
    E = np.zeros_like(B)
    λ = B[at, at]
    apart = λ[:, None] - λ
    E[np.ix_(at, at)] = np.where(apart != 0.0, -B[np.ix_(at, at)] / np.where(apart != 0.0, apart, 1.0), 0.0)
    parts = [slice(*each) for each in pairwise(bounds.tolist())]
    for k, a in enumerate(parts):
        for m, b in enumerate(parts):
            if k != m and not (single[k] and single[m]):
                E[a, b] = solve_sylvester(B[a, a], -B[b, b], -B[a, b])
    return E


def _block_diagonal(
    L: DoubleDouble, Z: DoubleDouble, B: DoubleDouble, bounds: Indices, decay: Array
) -> RateBlocks | None:
    """Return the blocks with their norms, without what rounding has left between them; None if a norm is not found."""
    kept = np.zeros_like(B.hi, dtype=np.bool_)
    norm, radius = np.eye(len(B)), np.zeros(len(decay))
    for k, (a, b) in enumerate(pairwise(bounds.tolist())):
        here = slice(a, b)
        kept[here, here] = True
        block = np.ascontiguousarray(B.hi[here, here])
        radius[k] = spectral_radius(block)
        if decay[k] > 0.0 and b - a > 1:
            P = solve_continuous_lyapunov(block.T, -radius[k] * np.eye(b - a))
            grows = np.linalg.eigvalsh(block.T @ P + P @ block).max() >= -0.5 * radius[k]
            if grows or not np.linalg.eigvalsh(P).min() > 0.0:
                return None
            norm[here, here] = np.linalg.cholesky(P).T
    B.parts[:, ~kept] = 0.0
    return RateBlocks(L, Z, B, bounds, decay, radius, norm, np.asarray(np.linalg.inv(norm), dtype=np.float64))
