r"""Double-double arithmetic: a number is the unevaluated sum of two floats, with some 32 digits.

.. math:: x = x_{hi} + x_{lo}, \qquad |x_{lo}| \le \tfrac12 \mathrm{ulp}(x_{hi})

Sums and products keep the rounding error of each operation, which is itself a float (Dekker 1971). A difference of two
places of size L keeps what it is down to 1e-32 L, so a gap that is closing may be told from one that is closed.

Beside its value a number may carry its derivatives by some parameters, which operations propagate: (a b)' = a' b + a b'.

References: Dekker, *A floating-point technique for extending the available precision*, Numer. Math. 18 (1971); Hida, Li and
Bailey, *Algorithms for quad-double precision floating point arithmetic* (2001).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from lcpimpact.arrays import Array, Matrix, Stack
from lcpimpact.compiled import FEW_ROWS, compiled, or_whole
from lcpimpact.interpreter import throughout

FINE_EPS = 2.0**-100
"""Relative rounding error of a few sums and products."""

SPLITTER = 134217729.0
"""2²⁷ + 1, the factor that splits a float into two halves with exact products (Dekker)."""


@compiled()
def two_product(a: float, b: float) -> tuple[float, float]:
    """Return a b and the rounding error of the product."""
    p = a * b
    c = SPLITTER * a
    a1 = c - (c - a)
    a2 = a - a1
    c = SPLITTER * b
    b1 = c - (c - b)
    b2 = b - b1
    return p, ((a1 * b1 - p) + a1 * b2 + a2 * b1) + a2 * b2


@compiled()
def add(a: float, a_lo: float, b: float, b_lo: float) -> tuple[float, float]:
    """Return the sum of two double-doubles: two sums with their rounding errors, written out for the interpreter."""
    s = a + b
    t = s - a
    e = (a - (s - t)) + (b - t)
    t = a_lo + b_lo
    f = t - a_lo
    f = (a_lo - (t - f)) + (b_lo - f)
    e += t
    s, e = s + e, e - ((s + e) - s)
    e += f
    return s + e, e - ((s + e) - s)


@compiled()
def multiply(a: float, a_lo: float, b: float, b_lo: float) -> tuple[float, float]:
    """Return the product of two double-doubles."""
    p, e = two_product(a, b)
    e += a * b_lo + a_lo * b
    return p + e, e - ((p + e) - p)


@compiled(most=FEW_ROWS, vectors=True)
def product(A: Stack, B: Stack) -> Stack:
    """Return the product of two matrices (2, n, m) and (2, m, p)."""
    n = A.shape[1]
    m = A.shape[2]
    p = B.shape[2]
    C = np.zeros((2, n, p))
    for i in range(n):
        for k in range(m):
            a, a_lo = A[0, i, k], A[1, i, k]
            if a != 0.0:
                for j in range(p):
                    x, x_lo = multiply(a, a_lo, B[0, k, j], B[1, k, j])
                    C[0, i, j], C[1, i, j] = add(C[0, i, j], C[1, i, j], x, x_lo)
    return C


def product_by_columns(A: Stack, B: Stack) -> Stack:
    """Return `product` with the same bits, where the interpreter runs: column after column of A, for all entries at once."""
    plus, by = throughout(add), throughout(multiply)
    C = np.zeros((2, A.shape[1], B.shape[2]))
    for k in range(A.shape[2]):
        a = A[:, :, k, None]
        summed = plus(*C, *by(*a, *B[:, k]))
        C = np.where(a[0] != 0.0, summed, C)
    return C


@compiled(vectors=True)
def total(a: Matrix, b: Matrix) -> Matrix:
    """Return the sum of two arrays (2, n)."""
    c = np.empty_like(a)
    for i in range(a.shape[1]):
        c[0, i], c[1, i] = add(a[0, i], a[1, i], b[0, i], b[1, i])
    return c


@compiled(vectors=True)
def times(a: Matrix, b: Matrix) -> Matrix:
    """Return the products of the entries of two arrays (2, n)."""
    c = np.empty_like(a)
    for i in range(a.shape[1]):
        c[0, i], c[1, i] = multiply(a[0, i], a[1, i], b[0, i], b[1, i])
    return c


@compiled()
def divide(a: float, a_lo: float, b: float, b_lo: float) -> tuple[float, float]:
    """Return the quotient of two double-doubles."""
    q, q_lo = a / b, 0.0
    for _ in range(2):
        p, p_lo = multiply(q, q_lo, b, b_lo)
        rest, _ = add(a, a_lo, -p, -p_lo)
        q, q_lo = add(q, q_lo, rest / b, 0.0)
    return q, q_lo


@compiled(vectors=True)
def over(a: Matrix, b: Matrix) -> Matrix:
    """Return the quotients of the entries of two arrays (2, n)."""
    c = np.empty_like(a)
    for i in range(a.shape[1]):
        c[0, i], c[1, i] = divide(a[0, i], a[1, i], b[0, i], b[1, i])
    return c


ONE_BY_ONE = {total: add, times: multiply, over: divide}
"""Operations on one entry, by the loops over all: the interpreter does them on whole arrays, with the same bits."""


@dataclass(eq=False, slots=True)
class DoubleDouble:
    """An array of double-doubles, with their derivatives by p parameters.

    Attributes
    ----------
    parts : (2 + 2 p, ...) array
        The leading and the trailing floats, and after them the leading and then the trailing floats of the derivatives.

    Examples
    --------
    >>> third = DoubleDouble.of(1.0) / 3.0
    >>> bool(abs((third + third + third - 1.0).hi) < 1e-31)
    True
    >>> x = with_slopes(3.0, [1.0])
    >>> (x * x / 2.0).slopes.hi
    array([3.])
    """

    parts: Array

    __array_ufunc__ = None  # an array on the left leaves the operation to the methods below

    @classmethod
    def of(cls, values: ArrayLike | DoubleDouble) -> DoubleDouble:
        """Return floats as double-doubles."""
        if isinstance(values, DoubleDouble):
            return values
        hi = np.asarray(values, dtype=np.float64)
        parts = np.zeros((2, *hi.shape))
        parts[0] = hi
        return cls(parts)

    @property
    def hi(self) -> Array:
        """The nearest floats."""
        hi: Array = self.parts[0]
        return hi

    @property
    def lo(self) -> Array:
        """The low parts: the differences of the numbers from the nearest floats."""
        lo: Array = self.parts[1]
        return lo

    @property
    def value(self) -> DoubleDouble:
        """The numbers without their derivatives."""
        return DoubleDouble(self.parts[:2])

    @property
    def slopes(self) -> DoubleDouble:
        """The derivatives (p, ...)."""
        return DoubleDouble(self.parts[2:].reshape(2, len(self.parts) // 2 - 1, *self.shape))

    @property
    def shape(self) -> tuple[int, ...]:
        """The shape of the array of numbers."""
        return self.parts.shape[1:]

    @property
    def T(self) -> DoubleDouble:
        """The transpose of a matrix."""
        return DoubleDouble(np.ascontiguousarray(self.parts.transpose(0, 2, 1)))

    def __len__(self) -> int:
        return int(self.parts.shape[1])

    def __getitem__(self, index: Any) -> DoubleDouble:
        return DoubleDouble(self.parts[(slice(None), *index) if isinstance(index, tuple) else (slice(None), index)])

    def __neg__(self) -> DoubleDouble:
        return DoubleDouble(-self.parts)

    def __add__(self, other: ArrayLike | DoubleDouble) -> DoubleDouble:
        return self._each(total, other)

    def __sub__(self, other: ArrayLike | DoubleDouble) -> DoubleDouble:
        return self + (-DoubleDouble.of(other))

    def __rsub__(self, other: ArrayLike) -> DoubleDouble:
        return -self + other

    def __mul__(self, other: ArrayLike | DoubleDouble) -> DoubleDouble:
        return self._each(times, other)

    __radd__, __rmul__ = __add__, __mul__

    def __truediv__(self, other: ArrayLike | DoubleDouble) -> DoubleDouble:
        return self._each(over, other)

    def __matmul__(self, other: ArrayLike | DoubleDouble) -> DoubleDouble:
        a, b = self.parts, DoubleDouble.of(other).parts
        vector = b.ndim == 2
        found = _matrix_product(a[:, None] if a.ndim == 2 else a, b[..., None] if vector else b)
        found = found[:, 0] if a.ndim == 2 else found
        return DoubleDouble(found[..., 0] if vector else found)

    def __rmatmul__(self, other: ArrayLike) -> DoubleDouble:
        return DoubleDouble.of(other) @ self

    def _each(self, operation: Any, other: ArrayLike | DoubleDouble) -> DoubleDouble:
        a, b = self.parts, DoubleDouble.of(other).parts
        if a.shape[1:] != b.shape[1:]:
            a, b = _aligned(a, b.ndim), _aligned(b, a.ndim)
            shape = np.broadcast_shapes(a.shape[1:], b.shape[1:])
            a, b = (np.array(np.broadcast_to(each, (len(each), *shape))) for each in (a, b))
        sides = np.ascontiguousarray(a[:2]).reshape(2, -1), np.ascontiguousarray(b[:2]).reshape(2, -1)

        def whole(a: Array, b: Array) -> Array:
            return np.array(throughout(ONE_BY_ONE[operation])(*a, *b))

        found = DoubleDouble(or_whole(operation, whole, *sides, size=0).reshape(2, *a.shape[1:]))
        if len(a) == len(b) == 2:
            return found
        A, B = DoubleDouble(a), DoubleDouble(b)
        partials = PARTIALS[operation](A.value, B.value, found) if operation in PARTIALS else (None, None)
        with_some = [(each.slopes, by) for each, by in zip((A, B), partials, strict=True) if len(each.parts) > 2]
        slopes = [each if by is None else each * by for each, by in with_some]
        return with_slopes(found, sum(slopes[1:], slopes[0]))


PARTIALS: dict[Any, Callable[..., tuple[ArrayLike | DoubleDouble, ArrayLike | DoubleDouble]]] = {
    times: lambda a, b, c: (b, a),
    over: lambda a, b, c: (DoubleDouble.of(1.0) / b, -c / b),
}
"""The derivatives of a product or a quotient c of a and b by both."""


def with_slopes(value: ArrayLike | DoubleDouble, slopes: ArrayLike | DoubleDouble) -> DoubleDouble:
    """Return numbers (...) with their derivatives (p, ...)."""
    parts, more = DoubleDouble.of(value).parts[:2], DoubleDouble.of(slopes).parts
    return DoubleDouble(np.concatenate([parts, more.reshape(2 * more.shape[1], *parts.shape[1:])]))


def _matrix_product(a: Stack, b: Stack) -> Stack:
    """Return the parts of the product of two matrices (n, m) and (m, q)."""
    sides = np.ascontiguousarray(a[:2]), np.ascontiguousarray(b[:2])
    found: Stack = or_whole(product, product_by_columns, *sides, size=0)
    (n, m), q = a.shape[1:], b.shape[2]
    slopes = []
    if k := len(a) // 2 - 1:
        rows = a[2:].reshape(2, k * n, m)
        slopes.append(_matrix_product(rows, b[:2]).reshape(2, k, n, q))
    if k := len(b) // 2 - 1:
        columns = b[2:].reshape(2, k, m, q).transpose(0, 2, 1, 3).reshape(2, m, k * q)
        slopes.append(_matrix_product(a[:2], columns).reshape(2, n, k, q).transpose(0, 2, 1, 3))
    terms = list(map(DoubleDouble, slopes))
    return with_slopes(DoubleDouble(found), sum(terms[1:], terms[0])).parts if terms else found


def _aligned(parts: Array, ndim: int) -> Array:
    """Return parts with as many dimensions as its partner has, if it has more."""
    return parts.reshape(len(parts), *(1,) * max(ndim - parts.ndim, 0), *parts.shape[1:])


def lifted(values: ArrayLike | DoubleDouble, length: int) -> Array:
    """Return the parts of numbers with the derivatives zero if they have none, for ``length`` parts."""
    parts = DoubleDouble.of(values).parts
    return parts if len(parts) == length else np.concatenate([parts, np.zeros((length - 2, *parts.shape[1:]))])


def stacked(blocks: list[list[ArrayLike | DoubleDouble]]) -> DoubleDouble:
    """Return a matrix from its blocks, as `numpy.block` does."""
    length = max(len(DoubleDouble.of(block).parts) for row in blocks for block in row)
    rows = [np.concatenate([lifted(block, length) for block in row], axis=2) for row in blocks]
    return DoubleDouble(np.ascontiguousarray(np.concatenate(rows, axis=1)))
