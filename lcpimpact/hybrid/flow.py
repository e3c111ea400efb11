r"""The flow X(s) = exp(A s) X(0) of one contact mode, and the first instant at which an event function c·X turns negative.

The time is cut into windows of length δ with ρ δ <= 1, where ρ is the spectral radius of |A|: the infimum of ‖D⁻¹ A D‖
over all units D of the states. So windows depend on no units, and loads, however large, do not shorten them. On a window,
a row is the polynomial

.. math:: c \cdot X(t_j + s δ) = \sum_{i=0}^{p} \frac{c (A δ)^i X(t_j)}{i!} s^i + ε, \qquad
          |ε| \le \frac{e}{(p+1)!} \, ‖c D‖ ‖D^{-1} X(t_j)‖ ,

with p so large that the remainder is below rounding. In the Bernstein basis, a polynomial lies in the convex hull of
its coefficients: a window is free of events only if all of them are positive, which proves that there is no root in it;
otherwise it is halved (de Casteljau) until the first sign change is located to rounding. So no event is missed, however
short the excursion.

States are double-doubles (see `lcpimpact.numerics.double_double`), since floats do not preserve rigid motions: rounding ε in
exp(A δ) is a small force, by which a body that flies for a time T is off by about ‖A‖ T³ ε. Floats decide which windows are
free of events.

The generator of a bar with a consistent mass matrix is dense, but A = P⁻¹ Q with a banded P, the mass matrix, and a sparse
Q. So the powers of A δ cost O(N) each (see `Generator`), and a large system has no dense exp(A δ) unless it must.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numba import types
from numpy.typing import ArrayLike
from scipy.linalg import matrix_balance, schur, solve_sylvester

from lcpimpact.arrays import Array, Flags, Indices, inverse
from lcpimpact.compiled import FEW_ROWS, compiled, cube, f8, i8, indices, matrix, vector
from lcpimpact.errors import InputError
from lcpimpact.numerics.banded import factor_finely, solve_banded, solve_finely
from lcpimpact.numerics.double_double import EPS, DoubleDouble, add, multiply, pair, solve, two_product
from lcpimpact.numerics.polynomials import bernstein, first_fall, polish

DEGREE = 30
"""Degree of the Taylor polynomial of a window: e/31! = 3e-34 is below the rounding of double-doubles."""

FINE_TERMS = 20
"""Number of its terms that are double-doubles; the rounding of later ones in floats is 1e-16/21! of the first."""

READING_RTOL = 2.0**-75
"""Terms of a reading in floats, relative to the largest, that are omitted after the last larger one."""

MAX_KEPT = 1 << 20
"""Numbers in the polynomials that are kept from one reading to the next: 8 MB."""

FIRST_WINDOWS, WINDOWS_PER_CALL = 64, 20_000
"""Smallest number of windows in the first call of compiled code, and number in each later one; Ctrl-C acts between calls."""

SQUARINGS = 14
"""log2 of the power of |A| whose size gives its spectral radius."""

MIN_WINDOWS = 16
"""Minimum number of windows of a run."""

WINDOW_RTOL = 1e-3
"""Excess of a window over 1/ρ, so that the rounding of ρ does not halve it where ρ is a power of two."""

SPLIT_COST = 16
"""Windows, in units of the number of states, that cost as much as splitting off the fastest rates."""

SPECTRAL_GAP = 8.0
"""Smallest ratio of consecutive decay rates at which the faster ones are split off once they have decayed."""

MAX_WINDOWS = 10**11
"""Maximum number of windows of a segment, some hours of computation."""

DECAY_EXPONENT = 40.0
"""Exponent at which a decaying mode has vanished in floats: exp(-40) = 4e-18."""

NEWTON_STEPS = 4
"""Newton steps that refine a splitting of the spectrum from floats to double-doubles."""

WINDOW_ROUNDING = 64.0 * float(np.finfo(float).eps)
"""Rounding error in floats of a row over a window, relative to its terms."""


BERNSTEIN = bernstein(DEGREE)


@compiled(matrix(matrix))
def couplings(A: Array) -> Array:
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


@compiled(f8(matrix))
def spectral_radius(A: Array) -> float:
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


class SparseRows(NamedTuple):
    """A sparse matrix of double-doubles, row by row.

    Attributes
    ----------
    entries : (2, nnz) array        its entries
    starts : (n + 1,) array         where each row begins, and the end
    columns : (nnz,) array          the column of each entry
    """

    entries: Array
    starts: Indices
    columns: Indices


def sparse(A: DoubleDouble) -> SparseRows:
    """Return the nonzero entries of a matrix."""
    kept = A.hi != 0.0
    starts = np.concatenate([[0], np.cumsum(kept.sum(axis=1))])
    return SparseRows(np.ascontiguousarray(A.parts[:, kept]), starts, np.ascontiguousarray(np.nonzero(kept)[1]))


sparse_type = types.NamedTuple((matrix, indices, indices), SparseRows)


class Generator(NamedTuple):
    """A = P⁻¹ Q, where Q is sparse and P the unit matrix but for a banded block L D Lᵀ.

    Attributes
    ----------
    Q : SparseRows
    first : int                     first row and column of the block
    band : (2, w + 1, nb) array     the factors of the block, as of `factor_finely`; nb = 0 without a block
    """

    Q: SparseRows
    first: int
    band: Array


generator_type = types.NamedTuple((sparse_type, i8, cube), Generator)

NO_BAND, NO_STEP = np.zeros((2, 1, 0)), np.zeros((2, 0, 0))


@compiled(pair(sparse_type, i8, matrix), allocates=False)
def on_row(A: SparseRows, m: int, X: Array) -> tuple[float, float]:
    """Return row m of A X, a double-double."""
    x, x_lo = 0.0, 0.0
    for at in range(A.starts[m], A.starts[m + 1]):
        c, c_lo, j = A.entries[0, at], A.entries[1, at], A.columns[at]
        y, y_lo = X[0, j], X[1, j]
        if c != 1.0 or c_lo != 0.0:
            y, y_lo = multiply(c, c_lo, y, y_lo)
        x, x_lo = add(x, x_lo, y, y_lo)
    return x, x_lo


@compiled(types.boolean(generator_type, f8, matrix, i8), allocates=False)
def next_term(A: Generator, δ: float, Y: Array, i: int) -> bool:
    """Write A δ Y_{i-1}/i into Y_i (p + 1, N), in floats, and return whether it is not zero."""
    Q, scale, moves = A.Q, δ / i, False
    for m in range(Y.shape[1]):
        x = 0.0
        for at in range(Q.starts[m], Q.starts[m + 1]):
            x += Q.entries[0, at] * Y[i - 1, Q.columns[at]]
        Y[i, m] = x * scale
        moves |= x != 0.0
    nb = A.band.shape[2]
    if nb:
        solve_banded(A.band[0], Y[i, A.first : A.first + nb])
    return moves


@compiled(i8(generator_type, f8, matrix), allocates=False)
def write_terms(A: Generator, δ: float, Y: Array) -> int:
    """Write (A δ)^i Y_0/i! into Y_i (p + 1, N), in floats, up to the last nonzero one, and return how many there are."""
    for i in range(1, len(Y)):
        if not next_term(A, δ, Y, i):
            return i
    return len(Y)


@compiled(i8(generator_type, f8, cube, matrix), allocates=False)
def write_fine_terms(A: Generator, δ: float, Z: Array, Y: Array) -> int:
    """Write (A δ)^i Z_0/i! into Z_i (p + 1, 2, N), up to the last nonzero one, and return how many there are.

    The first `FINE_TERMS` are double-doubles; Y (p - `FINE_TERMS` + 1, N) takes the later ones. δ is a power of two.
    """
    fine, n = min(len(Z) - 1, FINE_TERMS), Z.shape[2]
    for i in range(1, fine + 1):
        inverse, moves = 1.0 / i, False
        p, p_lo = two_product(inverse, float(i))
        rest = ((1.0 - p) - p_lo) / i
        for m in range(n):
            x, x_lo = on_row(A.Q, m, Z[i - 1])
            Z[i, 0, m], Z[i, 1, m] = multiply(δ * x, δ * x_lo, inverse, rest)
            moves |= x != 0.0
        if not moves:
            return i
        if A.band.shape[2]:
            solve_finely(A.band, A.first, Z[i])
    for m in range(n):
        Y[0, m] = Z[fine, 0, m]
    for i in range(fine + 1, len(Z)):
        if not next_term(A, δ * (i - fine) / i, Y, i - fine):
            return i
        for m in range(n):
            Z[i, 0, m], Z[i, 1, m] = Y[i - fine, m], 0.0
    return len(Z)


@compiled(cube(generator_type, f8, matrix, i8))
def expand_finely(A: Generator, δ: float, X: Array, degree: int) -> Array:
    """Return (A δ)^i X/i!, up to the last nonzero one, double-doubles (at most degree + 1, 2, N); δ is a power of two."""
    Z = np.empty((degree + 1, 2, X.shape[1]))
    Z[0] = X
    return Z[: write_fine_terms(A, δ, Z, np.empty((degree + 1, X.shape[1])))]


@compiled(types.boolean(sparse_type, i8, matrix, i8, matrix, vector), allocates=False)
def stays_positive(rows: SparseRows, row: int, Y: Array, drop: int, basis: Array, a: Array) -> bool:
    """Return whether floats prove that a row without its first ``drop`` powers is positive over a window; a is scratch."""
    noise, count = 0.0, max(len(Y) - drop, 1)
    for i in range(count):
        a[i] = 0.0
    for i in range(len(Y)):
        for at in range(rows.starts[row], rows.starts[row + 1]):
            y = rows.entries[0, at] * Y[i, rows.columns[at]]
            noise += abs(y)
            if i >= drop:
                a[i - drop] += y
    noise *= WINDOW_ROUNDING
    low = a[0]
    for i in range(1, count):
        low -= abs(a[i])
    if low > noise:
        return True
    for m in range(len(basis)):
        b = 0.0
        for i in range(min(m + 1, count)):
            b += basis[m, i] * a[i]
        if not b > noise:
            return False
    return True


@compiled(cube(sparse_type, f8, sparse_type, matrix))
def hulls(A: SparseRows, δ: float, rows: SparseRows, basis: Array) -> Array:
    """Return the map from X to the Bernstein coefficients of rows over a window, in floats, and its rounding (k, N, p + 2).

    Column m < p + 1 of the matrix of row c is Σ_i basis[m, i] c (A δ)^i/i!, the last one Σ_i |c| (|A| δ)^i/i! times
    `WINDOW_ROUNDING`.
    """
    n, p = len(A.starts) - 1, len(basis)
    found = np.zeros((len(rows.starts) - 1, n, p + 1))
    for k in range(len(found)):
        c, size = np.zeros(n), np.zeros(n)
        for at in range(rows.starts[k], rows.starts[k + 1]):
            c[rows.columns[at]], size[rows.columns[at]] = rows.entries[0, at], abs(rows.entries[0, at])
        for i in range(p):
            for j in range(n):
                found[k, j, p] += WINDOW_ROUNDING * size[j]
                for m in range(i, p):
                    found[k, j, m] += basis[m, i] * c[j]
            next_c, next_size = np.zeros(n), np.zeros(n)
            for m in range(n):
                for at in range(A.starts[m], A.starts[m + 1]):
                    j, entry = A.columns[at], A.entries[0, at] * (δ / (i + 1))
                    next_c[j] += c[m] * entry
                    next_size[j] += size[m] * abs(entry)
            c, size = next_c, next_size
    return found


NO_HULLS = np.zeros((0, 0, 0))


@compiled(types.boolean(matrix, matrix, vector), allocates=False)
def lies_above(hull: Array, X: Array, b: Array) -> bool:
    """Return whether floats prove that a row is positive over the window from X (2, N), by its `hulls`; b is scratch."""
    noise, count, above = 0.0, hull.shape[1] - 1, True
    for m in range(count):
        b[m] = 0.0
    for j in range(len(hull)):
        noise += hull[j, count] * abs(X[0, j])
        for m in range(count):
            b[m] += hull[j, m] * X[0, j]
    for m in range(count):
        above &= b[m] > noise
    return above


@compiled(types.UniTuple(f8, 2)(sparse_type, i8, cube, i8, cube, vector))
def fall(rows: SparseRows, row: int, Z: Array, drop: int, basis: Array, scale: Array) -> tuple[float, float]:
    """Return the zero in a window at which a row falls, a double-double, or NaN; its first ``drop`` powers are zero."""
    a, b, floor = np.zeros((2, max(len(Z) - drop, 1))), np.zeros((2, basis.shape[1])), 0.0
    for i in range(drop, len(Z)):
        a[0, i - drop], a[1, i - drop] = on_row(rows, row, Z[i])
    for m in range(b.shape[1]):
        for i in range(min(m + 1, a.shape[1])):
            y, y_lo = multiply(basis[0, m, i], basis[1, m, i], a[0, i], a[1, i])
            b[0, m], b[1, m] = add(b[0, m], b[1, m], y, y_lo)
    for at in range(rows.starts[row], rows.starts[row + 1]):
        floor -= EPS * abs(rows.entries[0, at]) * scale[rows.columns[at]]
    s = first_fall(b, floor)
    return polish(a, s) if s > 0.0 else (s, 0.0)


@compiled(matrix(cube, f8, f8))
def horner(Z: Array, s: float, s_lo: float) -> Array:
    """Return Σ Z_i s^i (2, N) for a double-double s."""
    X = Z[-1].copy()
    for i in range(len(Z) - 2, -1, -1):
        for m in range(X.shape[1]):
            x, x_lo = multiply(X[0, m], X[1, m], s, s_lo)
            X[0, m], X[1, m] = add(x, x_lo, Z[i, 0, m], Z[i, 1, m])
    return np.asarray(X)


@compiled(matrix(cube))
def summed(Z: Array) -> Array:
    """Return Σ Z_i (2, N), the state at the end of a window."""
    X = Z[-1].copy()
    for i in range(len(Z) - 2, -1, -1):
        for m in range(X.shape[1]):
            X[0, m], X[1, m] = add(X[0, m], X[1, m], Z[i, 0, m], Z[i, 1, m])
    return np.asarray(X)


@compiled(types.void(cube, matrix, matrix), allocates=False)
def move_by(step: Array, X: Array, Y: Array) -> None:
    """Replace a state X (2, N) by its product with a matrix (2, N, N); Y (2, N) is scratch."""
    for i in range(X.shape[1]):
        y, y_lo = 0.0, 0.0
        for k in range(X.shape[1]):
            if step[0, i, k] != 0.0:
                x, x_lo = multiply(step[0, i, k], step[1, i, k], X[0, k], X[1, k])
                y, y_lo = add(y, y_lo, x, x_lo)
        Y[0, i], Y[1, i] = y, y_lo
    for i in range(X.shape[1]):
        X[0, i], X[1, i] = Y[0, i], Y[1, i]


@compiled(cube(generator_type, f8, i8, i8), most=FEW_ROWS)
def exponential(A: Generator, δ: float, n: int, degree: int) -> Array:
    """Return exp(A δ) (2, n, n)."""
    found, unit = np.empty((2, n, n)), np.zeros((2, n))
    for j in range(n):
        unit[0, j] = 1.0
        found[:, :, j] = summed(expand_finely(A, δ, unit, degree))
        unit[0, j] = 0.0
    return found


@compiled(matrix(generator_type, f8, matrix, i8, i8), most=FEW_ROWS)
def walk(A: Generator, δ: float, X: Array, windows: int, degree: int) -> Array:
    """Return the state (2, N) after a number of windows, one after the other."""
    for _ in range(windows):
        X = summed(expand_finely(A, δ, X, degree))
    return np.asarray(X.copy())


class Window(NamedTuple):
    """The map of X' = A X over a window: generator, length δ, and exp(A δ) (2, N, N), or none where the series is taken."""

    A: Generator
    δ: float
    step: Array


window_type = types.NamedTuple((generator_type, f8, cube), Window)


@compiled(types.Tuple((i8, i8, f8, f8))(window_type, matrix, sparse_type, cube, indices, cube, i8, vector))
def scan(
    window: Window, X: Array, rows: SparseRows, hull: Array, order: Indices, basis: Array, count: int, scale: Array
) -> tuple[int, int, float, float]:
    """Return the first window in which a row turns negative, the row, and where in the window, a double-double.

    X (2, N) moves on to that instant, or past the last of ``count`` windows, where the window is -1; ``scale`` (N,) grows
    to the largest |X| at the starts of windows. In the first window the powers below ``order`` of a row are zero; a row of
    negative order is zero for ever. ``hull`` are the `hulls` of the rows, or none: then each window is expanded.
    """
    (A, δ, step), p, n, terms = window, basis.shape[1] - 1, X.shape[1], 0
    Y, Z, a, work = np.empty((p + 1, n)), np.empty((0, 2, n)), np.empty(p + 1), np.empty((2, n))
    for j in range(count):
        for i in range(n):
            Y[0, i], scale[i] = X[0, i], max(scale[i], abs(X[0, i]))
        expands, known = j == 0 or len(hull) == 0, False
        if expands:
            terms = write_terms(A, δ, Y)
        first, where, rest = -1, math.inf, 0.0
        for row in range(len(order)):
            if order[row] < 0:
                continue
            drop = order[row] if j == 0 else 0
            if stays_positive(rows, row, Y[:terms], drop, basis[0], a) if expands else lies_above(hull[row], X, a):
                continue
            if not known:
                Z, known = expand_finely(A, δ, X, p), True
            s, s_lo = fall(rows, row, Z, drop, basis, scale)
            if s < where:
                first, where, rest = row, s, s_lo
        if first >= 0:
            X[:] = horner(Z, where, rest)
            return j, first, where, rest
        if len(step[0]):
            move_by(step, X, work)
        else:
            X[:] = summed(Z if known else expand_finely(A, δ, X, p))
    return -1, -1, 0.0, 0.0


@compiled(vector(sparse_type, matrix))
def on_rows(R: SparseRows, X: Array) -> Array:
    """Return R X in floats, of a double-double X (2, N)."""
    found = np.empty(len(R.starts) - 1)
    for m in range(len(found)):
        found[m], _ = on_row(R, m, X)
    return found


@compiled(i8(sparse_type, cube, matrix, matrix), allocates=False)
def read_terms(R: SparseRows, Z: Array, a: Array, sums: Array) -> int:
    """Write R Z_i (m, p + 1) into a, and return the last term that counts in a row; ``sums`` (2, p + 1) is scratch.

    The terms after the first `FINE_TERMS` are floats, and so are their sums.
    """
    last, terms, fine = 0, len(Z), min(len(Z), FINE_TERMS + 1)
    for j in range(len(a)):
        for i in range(terms):
            sums[0, i], sums[1, i] = 0.0, 0.0
        for at in range(R.starts[j], R.starts[j + 1]):
            c, c_lo, k = R.entries[0, at], R.entries[1, at], R.columns[at]
            for i in range(fine):
                x, x_lo = Z[i, 0, k], Z[i, 1, k]
                if c != 1.0 or c_lo != 0.0:
                    x, x_lo = multiply(c, c_lo, x, x_lo)
                sums[0, i], sums[1, i] = add(sums[0, i], sums[1, i], x, x_lo)
            for i in range(fine, terms):
                sums[0, i] += c * Z[i, 0, k]
        size = 0.0
        for i in range(terms):
            a[j, i] = sums[0, i]
            size = max(size, abs(a[j, i]))
            last = max(last, i) if abs(a[j, i]) > READING_RTOL * size else last
    return last


@compiled(types.void(matrix, i8, vector, matrix, i8), allocates=False)
def evaluate(a: Array, last: int, s: Array, found: Array, first: int) -> None:
    """Write Σ a_i s^i, i <= ``last``, of each row of a (m, p + 1) and s (nt,) into found (m, ...), from column ``first``."""
    for j in range(len(a)):
        x = found[j, first : first + len(s)]
        for k in range(len(s)):
            x[k] = a[j, last]
        for i in range(last - 1, -1, -1):
            for k in range(len(s)):
                x[k] = x[k] * s[k] + a[j, i]


class Expansions(NamedTuple):
    """The polynomials of R X in the windows of some segments, one segment after the other (nw).

    Attributes
    ----------
    first : (k + 1,) array          the first window of each segment, and the end; (1,) if none are kept
    last : (nw,) array              the last power that counts, or -1 as long as they are not computed
    a : (nw, m, p + 1) array        the coefficients
    """

    first: Indices
    last: Indices
    a: Array


expansions_type = types.NamedTuple((indices, indices, cube), Expansions)
powers_type = types.float64[:, :, :, ::1]


@compiled(matrix(generator_type, f8, powers_type, matrix, i8, i8))
def moved(A: Generator, δ: float, powers: Array, X: Array, windows: int, degree: int) -> Array:
    """Return the state (2, N) after a number of windows, by ``powers`` exp(2ᵏ A δ), or none to walk from one to the next."""
    if len(powers) == 0:
        return np.asarray(walk(A, δ, X, windows, degree))
    X, work, bit = X.copy(), np.empty_like(X), 0
    while windows:
        if windows & 1:
            move_by(powers[bit], X, work)
        windows, bit = windows >> 1, bit + 1
    return np.asarray(X)


class Chain(NamedTuple):
    """Segments, one after the other (ns): their initial instants (ns, 2) and states (ns, 2, N), double-doubles."""

    starts: Array
    states: Array


chain_type = types.NamedTuple((matrix, cube), Chain)


@compiled(
    types.void(window_type, powers_type, chain_type, indices, vector, indices, sparse_type, expansions_type, matrix)
)
def sample(
    window: Window, powers: Array, chain: Chain, mine: Indices, t: Array, bounds: Indices, R: SparseRows,
    kept: Expansions, found: Array,
) -> None:  # fmt: skip
    """Write R X in floats at the sorted times t (nt,) in the segments ``mine`` of a chain into ``found`` (m, nt).

    Segment i has the times t[bounds[i]] to t[bounds[i + 1] - 1]. Cancellation in R X, as in a stiff force, happens in the
    coefficients of a window, which are double-doubles; those of the windows ``kept`` are computed once. ``powers`` are as
    in `moved`.
    """
    (A, δ, _), (starts, states), degree = window, chain, DEGREE
    scratch, sums = np.empty((len(found), degree + 1)), np.empty((2, degree + 1))
    s = np.empty(len(t))
    for j in range(len(mine)):
        i, here = mine[j], 0
        first, last = bounds[i], bounds[i + 1]
        state, Z = states[i].copy(), np.empty((0, 2, states.shape[2]))
        for k in range(first, last):
            s[k] = ((t[k] - starts[i, 0]) - starts[i, 1]) / δ
        while first < last:
            w, end = int(max(s[first], 0.0)), first + 1
            while end < last and int(max(s[end], 0.0)) == w:
                end += 1
            place = kept.first[j] + w if j + 1 < len(kept.first) else len(kept.last)
            keeps = j + 1 < len(kept.first) and place < kept.first[j + 1]
            a, power = (kept.a[place], kept.last[place]) if keeps else (scratch, -1)
            if power < 0:
                if len(Z) and len(powers) == 0:
                    state, here = summed(Z), here + 1
                state, here = moved(A, δ, powers, state, w - here, degree), w
                Z = expand_finely(A, δ, state, degree)
                power = read_terms(R, Z, a, sums)
                if keeps:
                    kept.last[place] = power
            for k in range(first, end):
                s[k] -= w
            evaluate(a, power, s[first:end], found, first)
            first = end


class ZeroCrossing(NamedTuple):
    """The first event: the row that turns negative first.

    Attributes
    ----------
    row : int               its number; -1 if there is none
    t : DoubleDouble        the instant, from the start; the horizon if there is none
    scale : (N,) array      the largest |X| up to there
    state : DoubleDouble    X there; without an event that of the last window
    """

    row: int
    t: DoubleDouble
    scale: Array
    state: DoubleDouble


class Block(NamedTuple):
    """The block of P in A = P⁻¹ Q: its first row, and P itself (nb, nb), positive definite."""

    first: int
    P: DoubleDouble


@dataclass(frozen=True, eq=False)
class Flow:
    """The flow of X' = A X.

    Attributes
    ----------
    generator : DoubleDouble        A (N, N)
    duration : float                that of the run in s
    block : Block, optional         the block of P where A = P⁻¹ Q with a sparser Q
    """

    generator: DoubleDouble
    duration: float
    block: Block | None = None

    @property
    def A(self) -> Array:
        """A in floats (N, N)."""
        return self.generator.hi

    @cached_property
    def window(self) -> float:
        """δ, the length of a window in s, a power of two."""
        longest = 1.0 / max(spectral_radius(np.ascontiguousarray(self.A)), MIN_WINDOWS / self.duration)
        return float(2.0 ** math.floor(math.log2((1.0 + WINDOW_RTOL) * longest)))

    @cached_property
    def factors(self) -> Generator:
        """A, or P⁻¹ and Q if a product with them costs less."""
        plain = Generator(sparse(self.generator), 0, NO_BAND)
        if self.block is None:
            return plain
        first, P = self.block
        rows = slice(first, first + len(P))
        width = int(np.abs(np.subtract(*np.nonzero(P.hi))).max(initial=0))
        A = self.generator[rows]
        Q = DoubleDouble(self.generator.parts.copy())
        Q.parts[:, rows] = (P @ A).parts
        Q.parts[:, rows][:, np.abs(Q.hi[rows]) <= EPS * (np.abs(P.hi) @ np.abs(A.hi))] = 0.0
        found = Generator(sparse(Q), first, factor_finely(np.ascontiguousarray(P.parts), width))
        return found if _cost(found) < _cost(plain) else plain

    @cached_property
    def walks(self) -> bool:
        """Whether the series of a window costs less than a product with exp(A δ)."""
        return FINE_TERMS * _cost(self.factors) + DEGREE * len(self.A) < len(self.A) ** 2

    @cached_property
    def step(self) -> Array:
        """exp(A δ) (2, N, N), or an empty array if the flow walks."""
        return NO_STEP if self.walks else self.squares[0].parts

    @cached_property
    def squares(self) -> list[DoubleDouble]:
        """exp(A δ), exp(2 A δ), exp(4 A δ) ...: the powers computed so far."""
        return [DoubleDouble(exponential(self.factors, self.window, len(self.A), DEGREE))]

    def doubled(self, k: int) -> DoubleDouble:
        """Return exp(2ᵏ A δ)."""
        while len(self.squares) <= k:
            self.squares.append(self.squares[-1] @ self.squares[-1])
        return self.squares[k]

    def move(self, X: DoubleDouble, t: float, t_lo: float = 0.0, far: bool = False) -> DoubleDouble:
        """Return exp(A t) X for one state X (N,) and one time t >= 0, a double-double; by powers of exp(A δ) if ``far``."""
        δ, windows = self.window, math.floor(t / self.window)
        if self.walks and not far and windows <= SPLIT_COST * len(X):
            X = DoubleDouble(walk(self.factors, δ, np.ascontiguousarray(X.parts), windows, DEGREE))
        else:
            for k in range(windows.bit_length()):
                if windows >> k & 1:
                    X = self.doubled(k) @ X
        within, rest = add(t, t_lo, -windows * δ, 0.0)
        terms = expand_finely(self.factors, δ, np.ascontiguousarray(X.parts), DEGREE)
        return DoubleDouble(horner(terms, within / δ, rest / δ))

    def over(self, t: float) -> Array:
        """Return exp(A t) for one time t >= 0 (N, N)."""
        return np.column_stack([self.move(DoubleDouble.of(unit), t, far=True).hi for unit in np.eye(len(self.A))])

    def at(self, X: ArrayLike | DoubleDouble, times: Array) -> Array:
        """Return exp(A t) X at the times t >= 0 (nt,), in floats: (nt, N)."""
        t, order = np.asarray(times, dtype=np.float64), np.argsort(times, kind="stable")
        chain = Chain(np.zeros((1, 2)), np.array(DoubleDouble.of(X).parts, order="C")[None])
        found, rows = np.empty((len(self.A), len(t))), sparse(DoubleDouble.of(np.eye(len(self.A))))
        kept, bounds = self.expansions(np.array([np.inf]), rows), np.array([0, len(t)])
        self.read(chain, np.zeros(1, np.int64), t[order], bounds, rows, kept, found)
        return np.asarray(found.T[inverse(order)])

    def expansions(self, lengths: Array, rows: SparseRows) -> Expansions:
        """Return room for the polynomials of segments of given lengths in s; none above `MAX_KEPT` numbers."""
        m, counts = len(rows.starts) - 1, np.floor(lengths / self.window) + 1.0
        if not counts.sum() * m * (DEGREE + 1) <= MAX_KEPT:
            counts = counts[:0]
        first = np.concatenate([[0.0], np.cumsum(counts)]).astype(np.int64)
        return Expansions(first, np.full(first[-1], -1), np.empty((first[-1], m, DEGREE + 1)))

    def read(
        self, chain: Chain, mine: Indices, t: Array, bounds: Indices, rows: SparseRows, kept: Expansions, found: Array
    ) -> None:
        """Write R X at the sorted times t (nt,) in some segments of a chain, in floats, into ``found`` (m, nt).

        Parameters
        ----------
        chain : Chain                   all segments (ns)
        mine : (k,) array               those of this flow
        t : (nt,) array
        bounds : (ns + 1,) array        the first time in each segment, and the end
        rows : SparseRows               R (m, N)
        kept : Expansions               the polynomials that several readings share, those of `expansions`
        found : (m, nt) array
        """
        read = mine[bounds[mine + 1] > bounds[mine]]
        if not len(read):
            return
        last = max(float((t[bounds[read + 1] - 1] - chain.starts[read, 0]).max()), 0.0) / self.window
        if self.walks and last <= SPLIT_COST * (len(t) + len(self.A)):
            powers = np.zeros((0, 2, 0, 0))
        else:
            self.doubled(max(int(last).bit_length() - 1, 0))
            powers = np.array([power.parts for power in self.squares])
        sample(Window(self.factors, self.window, NO_STEP), powers, chain, mine, t, bounds, rows, kept, found)

    @cached_property
    def slower(self) -> tuple[DoubleDouble, DoubleDouble, DoubleDouble, Flow] | None:
        """Split off the fastest rates, |λ| at least `SPECTRAL_GAP` times the next: X = Z y + Z_f y_f, y = L X, y_f = L_f X.

        Returns
        -------
        L_f, L, Z : DoubleDouble        (nf, N), (N - nf, N), (N, N - nf)
        flow : Flow                     of y, with the slower rates only; None where there is no such gap
        """
        balanced, scaling = balance(self.A)
        sizes = np.sort(np.abs(np.linalg.eigvals(balanced)))
        gaps = np.flatnonzero(sizes[1:] > SPECTRAL_GAP * sizes[:-1])
        if len(gaps) == 0:
            return None
        n = int(gaps[-1]) + 1
        bound = float(sizes[n]) / math.sqrt(SPECTRAL_GAP)
        _, Q, count = schur(balanced, sort=lambda re, im: math.hypot(re, im) < bound)
        if count != n:
            return None
        Z = DoubleDouble.of(np.diag(scaling) @ Q)
        for _ in range(NEWTON_STEPS):
            B = solve(Z, self.generator @ Z)
            up = solve_sylvester(B.hi[:n, :n], -B.hi[n:, n:], -B.hi[:n, n:])
            down = solve_sylvester(B.hi[n:, n:], -B.hi[:n, :n], -B.hi[n:, :n])
            Z = Z + Z @ np.block([[np.zeros((n, n)), up], [down, np.zeros_like(B.hi[n:, n:])]])
        B, L = solve(Z, self.generator @ Z), solve(Z, np.eye(len(self.A)))
        return L[n:], L[:n], Z[:, :n], Flow(B[:n, :n], self.duration)

    @cached_property
    def settling(self) -> float:
        """Time in s in which the fastest modes, omitted by `slower`, decay; inf if they do not."""
        if self.slower is None:
            return math.inf
        rates = np.linalg.eigvals(balance(self.A)[0])
        fast = rates[np.argsort(np.abs(rates))[len(self.slower[3].A) :]]
        slowest = -float(fast.real.max())
        return DECAY_EXPONENT / slowest if slowest > 0.0 else math.inf

    def cuts(self, length: float, most: int) -> tuple[Array, Flags]:
        """Return times in [0, ``length``), and whether exp(A t) is resolved between them.

        They are the windows, and if there are more than ``most``, those of the slower modes after the decay of the fastest
        ones. Without a decay they are some of the windows, each with the gap behind it as one piece.
        """
        windows = math.ceil(length / self.window)
        if windows <= max(most, 1):
            return np.arange(windows, dtype=np.float64) * (length / max(windows, 1)), np.ones(windows, np.bool_)
        if self.slower is not None and self.settling < min(length, most * self.window):
            first = self.window * np.arange(math.ceil(self.settling / self.window))
            since = len(first) * self.window
            later, little = self.slower[3].cuts(length - since, most)
            return np.append(first, since + later), np.append(np.ones(len(first), np.bool_), little)
        some = np.unique(np.floor(np.geomspace(1.0, windows, most // 2)) - 1.0)
        times = np.unique(np.append(some, some[:-1] + 1.0))
        return times * (length / windows), np.isin(times, some)

    def first_crossing(
        self,
        X: ArrayLike | DoubleDouble,
        scale: Array,
        rows: ArrayLike | DoubleDouble,
        order: Indices,
        horizon: float,
        entries: SparseRows | None = None,
    ) -> ZeroCrossing:
        """Return the first instant up to ``horizon`` at which a row turns negative.

        Parameters
        ----------
        X : (N,) array or DoubleDouble      state at the start
        scale : (N,) array                  largest |X| of the run so far, the scale of rounding
        rows : (k, N) array or DoubleDouble rows c; c·X is zero or positive right after the start
        order : (k,) array                  order of the zero of c·X at the start, which is factored out of the first window
        horizon : float                     length of time in s
        entries : SparseRows, optional          those of the rows, if known

        """
        δ, lines = self.window, DoubleDouble.of(rows)
        window = Window(self.factors, δ, self.step)
        state, largest = np.array(DoubleDouble.of(X).parts, order="C"), np.array(scale, dtype=np.float64)
        total, done, count = math.floor(min(horizon / δ, 1e300)) + 1, 0, max(FIRST_WINDOWS, SPLIT_COST * len(scale))
        zeros, entries = np.asarray(order, dtype=np.int64), entries or sparse(lines)
        while done < total:
            count = min(count, total - done)
            j, row, s, s_lo = scan(window, state, entries, NO_HULLS, zeros, BERNSTEIN, count, largest)
            if j >= 0:
                t = DoubleDouble(np.array(add(s * δ, s_lo * δ, (done + j) * δ, 0.0)))  # δ is a power of two
                return ZeroCrossing(row if t.hi <= horizon else -1, t, largest, DoubleDouble(state))
            done, count, zeros = done + count, WINDOWS_PER_CALL, np.zeros_like(zeros)
            if total - done > MAX_WINDOWS and self.slower is None:
                raise InputError(
                    f"{horizon:.3g} s are {total:.1e} times what the motion turns in: take a shorter t_end, or moreau-jean"
                )
            if done < total and self.slower is not None:
                fast, slow, back, flow = self.slower
                if (np.abs((fast @ DoubleDouble(state)).hi) <= 16.0 * EPS * (np.abs(fast.hi) @ largest)).all():
                    rest = flow.first_crossing(
                        slow @ DoubleDouble(state), np.abs(slow.hi) @ largest, lines @ back, zeros, horizon - done * δ
                    )
                    largest = np.maximum(largest, np.abs(state[0]))
                    return ZeroCrossing(rest.row, rest.t + done * δ, largest, back @ rest.state)
        return ZeroCrossing(-1, DoubleDouble.of(horizon), largest, DoubleDouble(state))


def _cost(A: Generator) -> int:
    """Return the number of products in A X."""
    return int(A.Q.entries.shape[1] + 2 * A.band[0].size)
