r"""Exact decisions in rational arithmetic: every float is a fraction.

Certificates of infeasibility are verified here, and recovered where rounding has spoilt them. Problems with few unknowns
are decided by branch and bound over the complementary pairs, with linear programs in integers.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from fractions import Fraction
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from lcpimpact.arrays import Array, Indices
from lcpimpact.lcp.operators import Banded, Delassus, Factored, Sparse
from lcpimpact.lcp.reduction import to_lcp

Whole: TypeAlias = Any
"""An array of Python's integers."""

MAX_ORDER = 30
"""Maximum order of a problem decided in rational arithmetic."""

DENOMINATORS = (1, 12, 1000)
"""Largest denominators tried for the entries of a ray, in units of the largest entry."""


class Decision(NamedTuple):
    """The decision on a problem.

    Attributes
    ----------
    z : list of Fraction, optional      a solution
    ray : list of Fraction, optional    a certificate of infeasibility for `proves_infeasible`

    With neither there is no solution: every complementary basis is infeasible, but there is no such certificate.
    """

    z: list[Fraction] | None = None
    ray: list[Fraction] | None = None


def whole(x: Array) -> tuple[Whole, int]:
    """Return integers m and an exponent e with x = m 2^e."""
    mantissa, exponent = np.frexp(x)
    m = (mantissa * 2.0**53).astype(np.int64).astype(object)
    e = exponent.astype(np.int64) - 53
    least = int(e[x != 0.0].min(initial=0)) if (x != 0.0).any() else 0
    return m * np.left_shift(np.ones(x.shape, object), np.where(x != 0.0, e - least, 0).astype(object)), least


def power_of_two(e: int) -> Fraction:
    """Return 2^e."""
    return Fraction(2**e) if e >= 0 else Fraction(1, 2**-e)


def transposed_product(M: Delassus, v: Array) -> tuple[Whole, int]:
    """Return Mᵀ v as integers and an exponent."""
    u, e = whole(v)
    if isinstance(M, Banded):
        bands, f = whole(M.bands)
        c = bands[0] * u
        for k in range(1, len(bands)):
            below = bands[k, : M.n - k]
            c[k:] = c[k:] + below * u[: M.n - k]
            c[: M.n - k] = c[: M.n - k] + below * u[k:]
        return c, e + f
    if isinstance(M, Sparse):
        of_v = M.M.tocoo()
        pushed = v[of_v.row] != 0.0
        values, f = whole(of_v.data[pushed])
        c = np.zeros(M.n, object)
        np.add.at(c, of_v.col[pushed], values * u[of_v.row[pushed]])
        return c, e + f
    rows = np.flatnonzero(v)
    N, f = whole(M.array()[rows])
    return u[rows] @ N, e + f


def rows_of(M: Delassus, rows: Indices) -> Array:
    """Return rows of M, or of H for M = H A⁻¹ Hᵀ, without the columns that are zero in all of them if it is sparse."""
    matrix: Any = M.H if isinstance(M, Factored) else M.M if isinstance(M, Sparse) else M.array()
    if not hasattr(matrix, "tocsr"):
        found: Array = matrix[rows]
        return found
    taken = matrix.tocsr()[rows].tocsc()
    dense: Array = taken[:, np.flatnonzero(np.diff(taken.indptr))].toarray()
    return dense


def annuls(M: Factored, v: Array) -> bool:
    """Return whether Hᵀ v = 0, so that M v = H A⁻¹ Hᵀ v = 0 without the rounding error of A⁻¹."""
    rows = np.flatnonzero(v)
    u, _ = whole(v[rows])
    return not (u @ whole(rows_of(M, rows))[0]).any()


def proves_infeasible(M: Delassus, q: Array, lower: Array, upper: Array, v: Array) -> bool:
    r"""Return whether v certifies, in exact arithmetic, that no z between the bounds has w of the right signs.

    For lower = 0, upper = inf: v >= 0, Mᵀ v <= 0 and q·v < 0 (Farkas); in general see `judge.proves_infeasible`.
    """
    if not np.isfinite(v).all():
        return False
    below, above = lower > -np.inf, upper < np.inf
    if (below & (v < 0.0)).any() or (above & (v > 0.0)).any():
        return False
    u, e = whole(v)
    p, f = whole(q)
    total = int(u @ p) * power_of_two(e + f)
    if isinstance(M, Factored):
        return total < 0 and annuls(M, v)
    c, e = transposed_product(M, v)
    bound = np.where(c > 0, upper, lower)
    pushed = np.flatnonzero(c)
    if not np.isfinite(bound[pushed]).all():
        return False
    terms, f = whole(bound[pushed])
    return total + int(c[pushed] @ terms if len(pushed) else 0) * power_of_two(e + f) < 0


def proof(M: Delassus, q: Array, lower: Array, upper: Array, v: Array) -> Array | None:
    """Return a ray near v that certifies infeasibility, or None.

    Rounding spoils the equations (Mᵀ v)_j = 0 of a ray, so v is also tried with its entries rounded to fractions of small
    denominator, and with the exact solution of these equations.
    """
    for each in _neighbours(M, v):
        if proves_infeasible(M, q, lower, upper, each):
            return each
    return None


def _neighbours(M: Delassus, v: Array, *, max_support: int = 60) -> Iterator[Array]:
    # max_support: maximum support of a ray whose equations are solved in fractions.
    size = float(np.abs(v).max(initial=0.0))
    if not 0.0 < size < np.inf:
        return
    yield v
    rows = np.flatnonzero(v)
    if len(rows) > 2 * max_support:
        for digits in (0, 3, 9):
            yield np.round(v / size, digits)
        return
    N = rows_of(M, rows)
    tight = np.ones(N.shape[1], bool)
    if not isinstance(M, Factored):
        tight = np.abs(v[rows] @ N) <= 1e-7 * (np.abs(v[rows]) @ np.abs(N))
    # Each row of M is scaled to near one, as rows in different units have entries of different size.
    largest = np.abs(N).max(axis=1, initial=0.0)
    unit = np.where(largest > 0.0, np.exp2(np.round(np.log2(np.where(largest > 0.0, largest, 1.0)))), 1.0)
    x = v[rows] * unit
    x = np.where(np.abs(x) > 1e-11 * np.abs(x).max(), x, 0.0)
    kept, x, N, unit = rows[x != 0.0], x[x != 0.0], N[x != 0.0], unit[x != 0.0]
    short = [[Fraction(a).limit_denominator(most) for a in x / np.abs(x).max()] for most in DENOMINATORS]
    found = [[a / Fraction(b) for a, b in zip(values, unit, strict=True)] for values in short]
    if 0 < len(kept) <= max_support:
        guess = [a / Fraction(b) for a, b in zip(short[-1], unit, strict=True)]
        found.append(_nearest_null_vector(N[:, tight], guess))
    for values in found:
        ray = np.zeros(M.n)
        ray[kept] = nearest_floats(values)
        yield ray


def _nearest_null_vector(N: Array, guess: list[Fraction]) -> list[Fraction]:
    """Return u with Nᵀ u = 0, its free entries taken from ``guess``; among dependent rows the largest stay free."""
    order = sorted(range(len(guess)), key=lambda i: abs(guess[i]))
    rows = [[Fraction(float(N[i, j])) for i in order] for j in range(N.shape[1])]
    pivots: list[tuple[int, list[Fraction]]] = []
    for row in rows:
        for at, other in pivots:
            if row[at]:
                factor = row[at]
                row = [a - factor * b for a, b in zip(row, other, strict=True)]
        first = next((k for k, a in enumerate(row) if a), None)
        if first is None:
            continue
        row = [a / row[first] for a in row]
        pivots = [
            (k, [a - other[first] * b for a, b in zip(other, row, strict=True)] if other[first] else other)
            for k, other in pivots
        ]
        pivots.append((first, row))
    bound = {at for at, _ in pivots}
    u = [Fraction(0) if k in bound else guess[i] for k, i in enumerate(order)]
    for at, row in pivots:
        u[at] = -sum((row[k] * u[k] for k in range(len(u)) if k not in bound), Fraction(0))
    found = [Fraction(0)] * len(guess)
    for k, i in enumerate(order):
        found[i] = u[k]
    return found


def nearest_floats(values: list[Fraction]) -> Array:
    """Return a multiple of the values in floats: coprime integers if these are representable."""
    denominator = 1
    for a in values:
        denominator = denominator * a.denominator // math.gcd(denominator, a.denominator)
    numbers = [int(a * denominator) for a in values]
    common = math.gcd(*numbers) or 1
    numbers = [a // common for a in numbers]
    largest = max(map(abs, numbers), default=0)
    if largest < 2**53:
        return np.array([float(a) for a in numbers])
    # No longer integers, and at most one; scaling by a power of two is exact.
    return np.array([float(Fraction(a, 2 ** largest.bit_length())) for a in numbers])


def floats(values: list[Fraction]) -> Array:
    """Return the nearest floats, infinite beyond the largest."""
    return np.array([_float(a) for a in values])


def _float(a: Fraction) -> float:
    try:
        return float(a)
    except OverflowError:
        return math.inf if a > 0 else -math.inf


def image(M: Delassus, q: Array, z: Array) -> Array:
    """Return w = M z + q, rounded once; M dense or banded."""
    N, p = M.array(), [Fraction(float(a)) for a in q]
    x = [Fraction(float(a)) for a in z]
    rows = [sum((Fraction(float(a)) * b for a, b in zip(row, x, strict=True) if a and b), Fraction(0)) for row in N]
    return floats([a + b for a, b in zip(rows, p, strict=True)])


class _Dictionary(NamedTuple):
    """The dictionary x_B = (b + A x_N) / D in integers for the pairs (y_k, s_k), numbered k and n + k.

    Data that are taken for rounded have s_k = (M y + q)_k + δ_k and u_k = δ_k - (M y + q)_k, numbered 2 n + k.

    Attributes
    ----------
    A : (n or 2 n, n + 1) array of int      the last column is b
    D : int                         positive
    basic, nonbasic : list of int
    zero : set of int               variables fixed at zero
    idle : set of int               variables of any sign
    """

    A: Whole
    D: int
    basic: list[int]
    nonbasic: list[int]
    zero: frozenset[int] = frozenset()
    idle: frozenset[int] = frozenset()

    def exchange(self, r: int, c: int) -> _Dictionary:
        """Exchange a basic and a nonbasic variable; the integer divisions are exact (Edmonds)."""
        A, pivot = self.A, self.A[r, c]
        sign = 1 if pivot > 0 else -1
        new = sign * (A * pivot - np.outer(A[:, c], A[r])) // self.D
        new[:, c] = sign * A[:, c]
        new[r] = -sign * A[r]
        new[r, c] = sign * self.D
        basic, nonbasic = list(self.basic), list(self.nonbasic)
        basic[r], nonbasic[c] = nonbasic[c], basic[r]
        return self._replace(A=new, D=abs(pivot), basic=basic, nonbasic=nonbasic)


def decide(
    M: Delassus, q: Array, lower: Array, upper: Array, rounded: bool = False, *, max_pivots: int = 2_000
) -> Decision | None:
    """Decide a problem of few rows; None if that takes too long or M is not given by its entries.

    Branch and bound: the relaxation keeps only y >= 0, s >= 0 for the pairs of the reduced LCP. If it is infeasible, a ray
    proves it; if a pair of the feasible point has both variables positive, branch by setting either to zero.

    With ``rounded``, M and q are known to a relative error ε in each entry: a row holds if |w_k| or, where y_k = 0, -w_k is
    at most δ_k = ε (|q_k| + Σ |M_kj| y_j) (Oettli and Prager). Then no problem within ε has a solution if there is none.

    ``max_pivots``: maximum number of pivots for one problem; a few seconds at the maximum order.
    """
    if M.n > MAX_ORDER or isinstance(M, Factored):
        return None
    N, p, row, sign, base, unit = _reduced(M, q, lower, upper)
    n = len(p)
    start = _Dictionary(np.column_stack([N, p]), 1, list(range(n, 2 * n)), list(range(n)))
    parts = []  # of free rows, z = y_a - y_a+1, of which one is zero where errors are those of |z|
    if rounded:
        start = _with_errors(start, sign == 0.0)
        parts = [(a, a + 1) for a in range(n - 1) if row[a] == row[a + 1] and sign[a + 1] != 0.0]
    left = max_pivots
    stack: list[tuple[_Dictionary, int | None]] = [(start, None)]
    while stack:
        origin, fixed = stack.pop()
        at: _Dictionary | None = origin
        if fixed is not None:
            at = origin._replace(idle=origin.idle - {fixed}) if fixed >= 2 * n else _set_to_zero(origin, fixed)
        if at is None:
            continue
        at, infeasible, left = _feasible(at, left)
        if left < 0:
            return None
        if infeasible is not None:
            if fixed is None:
                return Decision() if rounded else Decision(ray=_ray(at, infeasible, row, sign, unit, M.n))
            continue
        value = {x: at.A[i, n] for i, x in enumerate(at.basic)}
        both = [(a, b) for a, b in parts if value.get(a, 0) > 0 and value.get(b, 0) > 0]
        if rounded:
            both += [(k, 2 * n + k) for k in range(n) if value.get(k, 0) > 0 and value.get(2 * n + k, 0) < 0]
        else:
            both += [(k, n + k) for k in range(n) if value.get(k, 0) > 0 and value.get(n + k, 0) > 0]
        if not both:
            z = base.copy()
            for a in range(n):
                z[row[a]] += int(sign[a]) * Fraction(int(value.get(a, 0)), int(at.D))
            return Decision(z=z)
        stack += [(at, each) for each in both[0]]
    return Decision()


def _with_errors(start: _Dictionary, multiplier: Indices, *, rounding_bits: int = 44) -> _Dictionary:
    """Return the dictionary of s = M y + q + δ and u = δ - M y - q, both in units of ε; bounds have no error.

    ``rounding_bits``: relative error 2^-44 up to which data are taken for rounded: the rounding of sums of
    `MAX_ORDER` products, and more.
    """
    A, n = start.A, len(start.basic)
    error = abs(A)
    error[multiplier] = 0
    error[:, :n][:, multiplier] = 0
    whole_A = np.vstack([A * 2**rounding_bits + error, error - A * 2**rounding_bits])
    upper = list(range(2 * n, 3 * n))
    return start._replace(A=whole_A, basic=[*start.basic, *upper], idle=frozenset(upper))


def _reduced(
    M: Delassus, q: Array, lower: Array, upper: Array
) -> tuple[Whole, Whole, Indices, Array, list[Fraction], list[Fraction]]:
    """Return `to_lcp` in integers, with the powers of two by which the rows were multiplied."""
    full = M.array()
    _, _, row, sign, start = to_lcp(full, q, lower, upper)
    n = len(row)
    entries = [[Fraction(float(a)) for a in line] for line in full]
    base = [Fraction(float(a)) for a in start]
    N = np.zeros((n, n), object)
    p = np.zeros(n, object)
    unit = [Fraction(1)] * n
    for a in range(n):
        i, s = int(row[a]), int(sign[a])
        line = [Fraction(0)] * (n + 1)
        if s == 0:
            line[a - 1] = Fraction(-1)
            line[n] = Fraction(float(upper[i])) - Fraction(float(lower[i]))
        else:
            for b in range(n):
                line[b] = s * int(sign[b]) * entries[i][int(row[b])]
            if a + 1 < n and sign[a + 1] == 0.0:
                line[a + 1] = Fraction(1)
            line[n] = s * (
                Fraction(float(q[i])) + sum((x * y for x, y in zip(entries[i], base, strict=True)), Fraction(0))
            )
        unit[a] = Fraction(max(each.denominator for each in line))
        whole_line = [int(each * unit[a]) for each in line]
        common = math.gcd(*whole_line) or 1
        unit[a] /= common
        N[a] = [each // common for each in whole_line[:n]]
        p[a] = whole_line[n] // common
    return N, p, row, sign, base, unit


def _set_to_zero(at: _Dictionary, x: int) -> _Dictionary | None:
    """Return the dictionary with the additional equation x = 0, or None if x is a non-zero constant."""
    at = at._replace(zero=at.zero | {x})
    if x in at.nonbasic:
        return at
    r, n = at.basic.index(x), len(at.nonbasic)
    for c, other in enumerate(at.nonbasic):
        if other not in at.zero and at.A[r, c] != 0:
            return at.exchange(r, c)
    return at if at.A[r, n] == 0 else None


def _feasible(at: _Dictionary, left: int) -> tuple[_Dictionary, int | None, int]:
    """Pivot to feasibility by Bland's least-index rule; return the dictionary, an infeasible row or None, pivots left."""
    n = len(at.nonbasic)
    while left >= 0:
        wrong = [(x, r) for r, x in enumerate(at.basic) if at.A[r, n] < 0 and x not in at.idle]
        if not wrong:
            return at, None, left
        _, r = min(wrong)
        ways = [(x, c) for c, x in enumerate(at.nonbasic) if x not in at.zero and at.A[r, c] > 0]
        if not ways:
            return at, r, left
        at = at.exchange(r, min(ways)[1])
        left -= 1
    return at, None, left


def _ray(at: _Dictionary, r: int, row: Indices, sign: Array, unit: list[Fraction], n: int) -> list[Fraction]:
    """Return the certificate v of a row x_r = (b + A x_N) / D with b < 0 and A <= 0: then v·s < 0 for every y >= 0."""
    size, v = len(at.nonbasic), [Fraction(0)] * n
    weights = [(x, -at.A[r, c]) for c, x in enumerate(at.nonbasic)] + [(at.basic[r], at.D)]
    for x, weight in weights:
        if x >= size:
            a = x - size
            v[int(row[a])] += int(sign[a]) * int(weight) * unit[a]
    return v
