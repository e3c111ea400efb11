r"""Double-double arithmetic: a number is the unevaluated sum of two floats, with some 32 digits.

.. math:: x = x_{hi} + x_{lo}, \qquad |x_{lo}| \le \tfrac12 \mathrm{ulp}(x_{hi})

Sums and products keep the rounding error of each operation, which is itself a float (Dekker 1971). A difference of two
places of size L keeps what it is down to 1e-32 L, so a gap that is closing may be told from one that is closed.

Beside its value a number may carry its derivatives by some parameters, which operations propagate: (a b)' = a' b + a b'.

References: Dekker, *A floating-point technique for extending the available precision*, Numer. Math. 18 (1971); Hida, Li and
Bailey, *Algorithms for quad-double precision floating point arithmetic* (2001).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
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


@compiled(vectors=True, inline="always")
def add_row(C: Matrix, C_lo: Matrix, i: int, a: float, a_lo: float, B: Matrix, B_lo: Matrix, k: int) -> None:
    """Add a number times row k of B to row i of C."""
    if a != 0.0:
        for j in range(C.shape[1]):
            x, x_lo = multiply(a, a_lo, B[k, j], B_lo[k, j])
            C[i, j], C_lo[i, j] = add(C[i, j], C_lo[i, j], x, x_lo)


@compiled(most=FEW_ROWS, vectors=True)
def product(A: Stack, B: Stack) -> Stack:
    """Return the product of two matrices (2 + 2 p, n, m) and (2 + 2 p, m, q), of which one may have the value only."""
    n = A.shape[1]
    m = A.shape[2]
    by_A = len(A) // 2 - 1
    by_B = len(B) // 2 - 1
    by = max(by_A, by_B)
    C = np.zeros((2 + 2 * by, n, B.shape[2]))
    for i in range(n):
        for k in range(m):
            add_row(C[0], C[1], i, A[0, i, k], A[1, i, k], B[0], B[1], k)
    for p in range(2, 2 + by):
        for i in range(n):
            for k in range(m if by_A else 0):
                add_row(C[p], C[p + by], i, A[p, i, k], A[p + by, i, k], B[0], B[1], k)
            for k in range(m if by_B else 0):
                add_row(C[p], C[p + by], i, A[0, i, k], A[1, i, k], B[p], B[p + by], k)
    return C


def product_by_columns(A: Stack, B: Stack) -> Stack:
    """Return `product` with the same bits, where the interpreter runs: column after column of A, for all entries at once."""
    plus, by = throughout(add), throughout(multiply)

    def summed(C: Array, a: Array, b: Array) -> Array:
        for k in range(A.shape[2]):
            column = a[..., k, None]
            C = np.where(column[0] != 0.0, plus(*C, *by(*column, *b[..., k, None, :])), C)
        return C

    def parted(parts: Stack) -> tuple[Array, Array]:
        return parts[:2], parts[2:].reshape(2, len(parts) // 2 - 1, *parts.shape[1:])

    (a, a_p), (b, b_p) = parted(A), parted(B)
    p = max(a_p.shape[1], b_p.shape[1])
    C_p = np.zeros((2, p, A.shape[1], B.shape[2]))
    if a_p.size:
        C_p = summed(C_p, a_p, b)
    if b_p.size:
        C_p = summed(C_p, a[:, None], b_p)
    C = summed(np.zeros((2, *C_p.shape[2:])), a, b)
    return np.concatenate([C, C_p.reshape(2 * p, *C.shape[1:])])


@compiled(vectors=True)
def total(a: Matrix, b: Matrix) -> Matrix:
    """Return the sum of two arrays (2 + 2 p, n)."""
    c = np.empty_like(a)
    for i in range(a.shape[1]):
        c[0, i], c[1, i] = add(a[0, i], a[1, i], b[0, i], b[1, i])
    by = len(a) // 2 - 1
    for p in range(2, 2 + by):
        for i in range(a.shape[1]):
            c[p, i], c[p + by, i] = add(a[p, i], a[p + by, i], b[p, i], b[p + by, i])
    return c


@compiled()
def multiply_slope(
    x: float, x_lo: float, y: float, y_lo: float, a: float, a_lo: float, b: float, b_lo: float
) -> tuple[float, float]:
    """Return (a b)' = a' b + a b', with x = a' and y = b'."""
    x, x_lo = multiply(x, x_lo, b, b_lo)
    y, y_lo = multiply(a, a_lo, y, y_lo)
    return add(x, x_lo, y, y_lo)


@compiled(vectors=True)
def times(a: Matrix, b: Matrix) -> Matrix:
    """Return the products of the entries of two arrays (2 + 2 p, n)."""
    c = np.empty_like(a)
    for i in range(a.shape[1]):
        c[0, i], c[1, i] = multiply(a[0, i], a[1, i], b[0, i], b[1, i])
    by = len(a) // 2 - 1
    for p in range(2, 2 + by):
        for i in range(a.shape[1]):
            c[p, i], c[p + by, i] = multiply_slope(
                a[p, i], a[p + by, i], b[p, i], b[p + by, i], a[0, i], a[1, i], b[0, i], b[1, i]
            )
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


@compiled()
def divide_slope(
    x: float, x_lo: float, y: float, y_lo: float, a: float, a_lo: float, b: float, b_lo: float
) -> tuple[float, float]:
    """Return (a/b)' = (a' - (a/b) b')/b, with x = a' and y = b'."""
    q, q_lo = divide(a, a_lo, b, b_lo)
    y, y_lo = multiply(q, q_lo, y, y_lo)
    x, x_lo = add(x, x_lo, -y, -y_lo)
    return divide(x, x_lo, b, b_lo)


@compiled(vectors=True)
def over(a: Matrix, b: Matrix) -> Matrix:
    """Return the quotients of the entries of two arrays (2 + 2 p, n)."""
    c = np.empty_like(a)
    for i in range(a.shape[1]):
        c[0, i], c[1, i] = divide(a[0, i], a[1, i], b[0, i], b[1, i])
    by = len(a) // 2 - 1
    for p in range(2, 2 + by):
        for i in range(a.shape[1]):
            c[p, i], c[p + by, i] = divide_slope(
                a[p, i], a[p + by, i], b[p, i], b[p + by, i], a[0, i], a[1, i], b[0, i], b[1, i]
            )
    return c


def add_slope(
    x: Array, x_lo: Array, y: Array, y_lo: Array, a: Array, a_lo: Array, b: Array, b_lo: Array
) -> tuple[Array, Array]:
    """Return (a + b)' = a' + b', with x = a' and y = b'."""
    found: tuple[Array, Array] = throughout(add)(x, x_lo, y, y_lo)
    return found


ONE_BY_ONE = {total: (add, add_slope), times: (multiply, multiply_slope), over: (divide, divide_slope)}
"""Operations on one entry and their derivatives, by the loops over all: the interpreter does them on whole arrays, with the
same bits."""


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
        sides = (
            np.ascontiguousarray(each) for each in (a[:, None] if a.ndim == 2 else a, b[..., None] if vector else b)
        )
        found: Array = or_whole(product, product_by_columns, *sides, size=0)
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
        length, shape = max(len(a), len(b)), a.shape[1:]
        sides = [np.ascontiguousarray(lifted(DoubleDouble(each), length)).reshape(length, -1) for each in (a, b)]
        found: Array = or_whole(operation, partial(on_whole, operation), *sides, size=0)
        return DoubleDouble(found.reshape(length, *shape))


def on_whole(operation: Any, a: Array, b: Array) -> Array:
    """Return an operation on the entries of two arrays (2 + 2 p, n), for all entries at once."""
    value, slope = map(throughout, ONE_BY_ONE[operation])
    parts = [np.array(value(*a[:2], *b[:2]))]
    if len(a) > 2:
        x, y = (each[2:].reshape(2, len(a) // 2 - 1, a.shape[1]) for each in (a, b))
        parts.append(np.array(slope(*x, *y, *a[:2], *b[:2])).reshape(len(a) - 2, a.shape[1]))
    return np.concatenate(parts)


def with_slopes(value: ArrayLike | DoubleDouble, slopes: ArrayLike | DoubleDouble) -> DoubleDouble:
    """Return numbers (...) with their derivatives (p, ...)."""
    parts, more = DoubleDouble.of(value).parts[:2], DoubleDouble.of(slopes).parts
    return DoubleDouble(np.concatenate([parts, more.reshape(2 * more.shape[1], *parts.shape[1:])]))


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
