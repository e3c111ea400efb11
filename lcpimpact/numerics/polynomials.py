r"""Polynomials on [0, 1] in Bernstein's basis: the first instant at which one falls below zero, proved and located.

.. math:: p(s) = \sum_{i=0}^{n} b_i B_{i,n}(s), \qquad B_{i,n}(s) = \binom ni s^i (1 - s)^{n-i}

A polynomial lies in the convex hull of its coefficients b, and has no more roots in ]0, 1[ than b has changes of sign.

References: Farouki, *The Bernstein polynomial basis: a centennial retrospective*, Comput. Aided Geom. Des. 29 (2012).
"""

from __future__ import annotations

import math

import numpy as np

from lcpimpact.arrays import Array, Matrix, Vector
from lcpimpact.compiled import compiled
from lcpimpact.numerics.double_double import DoubleDouble, add, multiply
from lcpimpact.numerics.rounding import EPS

ROOT_RTOL = 4.0 * EPS
"""Relative tolerance of a root."""

ROOT_STEPS = 6
"""Steps of Newton's method that find a simple root."""


def basis(n: int, s: Array) -> Array:
    """Return Bernstein's polynomials of degree n at the points s (ns,): (ns, n + 1)."""
    i = np.arange(n + 1)
    return np.asarray([math.comb(n, j) for j in i] * s[:, None] ** i * (1.0 - s[:, None]) ** (n - i))


def without_zeros(n: int, m: int, p: int = 0) -> Array:
    """Return the factors (n + 1,) that make of b those of the quotient by s^m (1 - s)^p; 0 for those that drop out.

    >>> (without_zeros(2, 1) * [0.0, 1.0, 0.0]).tolist()  # 2 s (1 - s) / s = 2 (1 - s)
    [0.0, 2.0, 0.0]
    """
    kept = range(m, n + 1 - p)
    return np.array([math.comb(n, i) / math.comb(n - m - p, i - m) if i in kept else 0.0 for i in range(n + 1)])


def bernstein(degree: int) -> Array:
    """Return the matrix from monomial to Bernstein coefficients on [0, 1]: b_j = Σ_i C(j, i)/C(p, i) a_i; (2, p+1, p+1)."""
    orders = range(degree + 1)
    choices = np.array([[float(math.comb(j, i)) for i in orders] for j in orders])
    found: Array = (DoubleDouble.of(choices) / choices[-1]).parts
    return found


@compiled()
def casteljau(b: Vector, s: float) -> tuple[float, float]:
    """Return value and slope at s of the polynomial on [0, 1] with Bernstein coefficients b."""
    c, right = b.copy(), np.empty_like(b)
    slope = 0.0
    for left in range(len(c) - 1, 0, -1):
        if left == 1:
            slope = (len(c) - 1) * (c[1] - c[0])
        np.multiply(c[1 : left + 1], s, right[:left])
        np.multiply(c[:left], 1.0 - s, c[:left])
        np.add(c[:left], right[:left], c[:left])
    return c[0], slope


@compiled()
def only_root(b: Vector) -> float:
    """Return the root in [0, 1] of a polynomial whose Bernstein coefficients change their sign once, from above zero."""
    low = 0.0
    high = 1.0
    s = b[0] / (b[0] - b[-1])
    moved = 1.0
    for _ in range(64):
        value, slope = casteljau(b, s)
        if value >= 0.0:
            low = s
        else:
            high = s
        better = s - value / slope if slope < 0.0 else -1.0
        if not low <= better <= high:
            better = 0.5 * (low + high)
        # At the last digits the steps of Newton's method become no smaller.
        last, moved = moved, abs(better - s)
        s = better
        if moved <= 4e-16 * s or (last <= moved and moved < 1e-9 * s):
            break
    return float(s)


@compiled()
def first_fall(b: Matrix, floor: float) -> float:
    """Return where a polynomial first falls below ``floor`` <= 0, or NaN if it does not.

    Intervals above the floor by the convex hull are skipped; the leftmost other one is halved, until its
    coefficients change their sign once: then it has one root (variation diminishing).

    Parameters
    ----------
    b : (2, p + 1) array        its Bernstein coefficients on [0, 1], double-doubles
    floor : float               negative values above it count as zero
    """
    n = b.shape[1]
    stack = np.empty((128, 2, n))
    starts, widths = np.empty(128), np.empty(128)
    stack[0] = b
    starts[0] = 0.0
    widths[0] = 1.0
    waiting = 1
    while waiting:
        waiting -= 1
        c = stack[waiting].copy()
        start = starts[waiting]
        width = widths[waiting]
        if c[0].min() >= floor:
            continue
        if c[0, 0] < floor:
            return float(start)
        changes = 0
        for j in range(1, n):
            changes += (c[0, j] >= floor) != (c[0, j - 1] >= floor)
        if changes == 1:
            return float(start + width * only_root(c[0] - floor))
        if width < 2.0**-110 or width < 2.0**-54 * start:
            return float(start)
        # The right half waits below the left one: [c_0 ... c_p] are its coefficients when the triangle is complete.
        half = 0.5 * width
        left = np.empty((2, n))
        for j in range(n):
            left[:, j] = c[:, 0]
            for i in range(n - 1 - j):
                hi, lo = add(float(c[0, i]), float(c[1, i]), float(c[0, i + 1]), float(c[1, i + 1]))
                c[0, i], c[1, i] = 0.5 * hi, 0.5 * lo
        stack[waiting] = c
        starts[waiting] = start + half
        widths[waiting] = half
        stack[waiting + 1] = left
        starts[waiting + 1] = start
        widths[waiting + 1] = half
        waiting += 2
    return math.nan


def fall_before(b: Array, below: float) -> tuple[float, float]:
    """Return the zero through which a polynomial falls at or before ``below``, and the slope there.

    ``below`` is what `first_fall` found; it is returned where the polynomial is not above zero before.
    """
    from scipy.optimize import brentq  # here, as the flows of modes do without it

    s = below
    for _ in range(ROOT_STEPS):
        value, slope = casteljau(b, s)
        if not slope < 0.0:
            break
        last, s = s, s - value / slope
        if not 0.0 < s <= below:
            break
        if abs(s - last) <= ROOT_RTOL * s:
            return float(s), float(slope)
    back = 1e-15 * below
    while casteljau(b, below)[0] < 0.0 and not casteljau(b, max(below - back, 0.0))[0] > 0.0:
        if below <= back:
            return below, float(casteljau(b, below)[1])
        back *= 8.0
    if casteljau(b, below)[0] < 0.0:
        below = float(brentq(lambda s: casteljau(b, s)[0], max(below - back, 0.0), below, xtol=1e-300, rtol=ROOT_RTOL))
    return below, float(casteljau(b, below)[1])


@compiled()
def polish(a: Matrix, s: float) -> tuple[float, float]:
    """Return the root of Σ a_i s^i near s, a double-double, by Newton's method; s itself where the root is not simple."""
    x, x_lo = s, 0.0
    for _ in range(4):
        value = 0.0
        value_lo = 0.0
        slope = 0.0
        for i in range(a.shape[1] - 1, -1, -1):
            slope = slope * x + value
            value, value_lo = multiply(value, value_lo, x, x_lo)
            value, value_lo = add(value, value_lo, float(a[0, i]), float(a[1, i]))
        step = value / slope if slope < 0.0 else 0.0
        if not abs(step) < 1e-6 * s:
            break
        x, x_lo = add(x, x_lo, -step, 0.0)
    return (x, x_lo) if x > 0.0 else (s, 0.0)
