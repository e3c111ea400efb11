"""Sine and cosine by sums and products, with the same bits for floats, arrays, formulas and compiled code.

Those of the C library, of NumPy and of vector libraries differ in the last bit.
"""

from __future__ import annotations

import math
from typing import TypeVar

import numpy as np

from lcpimpact.arrays import Array
from lcpimpact.formula import Number, number

X = TypeVar("X", float, Array, Number)

PI = 3.1415926534682512, 1.2154201012607932e-10, 4.044532497591901e-21
"""π as a sum, the first two terms with 33 bits each, so that their products with numbers of 20 bits are exact."""

COEFFICIENTS = (
    2.731444688085806e-15,
    -7.643970290470771e-13,
    1.6058977312265895e-10,
    -2.5052107616993125e-08,
    2.755731921916321e-06,
    -0.00019841269841254974,
    0.008333333333333316,
    -0.16666666666666666,
)
"""P, highest power first: sin r = r + r³ P(r²) for \\|r\\| <= π/2 to 2e-16 of it, by interpolation at Chebyshev's points."""

MAX_ANGLE = 2.0**30
"""Limit of x in rad: above it the rounding of x alone changes the sine by 1e-7, and more and more."""

TO_INFINITY = 2.0 * (2.0**1023 / MAX_ANGLE)
"""Least factor by which MAX_ANGLE overflows."""


def sine(x: X) -> X:
    """Return sin x, to 2e-16 of itself and of x; NaN for |x| >= 2³⁰.

    Examples
    --------
    >>> sine(1.0), cosine(0.0)
    (0.8414709848078965, 1.0)
    """
    n = _floor(x / math.pi + 0.5)
    return (1.0 - 2.0 * _odd(n)) * _on_half_turn(x, n)


def cosine(x: X) -> X:
    """Return cos x, to 2e-16 of itself and of x; NaN for |x| >= 2³⁰."""
    n = _floor(x / math.pi)
    return (2.0 * _odd(n) - 1.0) * _on_half_turn(x, n + 0.5)


def _on_half_turn(x: X, turns: X) -> X:
    """Return sin(x - π turns), for a difference within ±π/2; NaN for |x| >= 2³⁰."""
    r = x - turns * PI[0] - turns * PI[1] - turns * PI[2]
    u = r * r
    p: float | X = COEFFICIENTS[0]
    for coefficient in COEFFICIENTS[1:]:
        p = p * u + coefficient
    return r + r * u * p + 0.0 * (TO_INFINITY * x)


def _odd(n: X) -> X:
    """Return 1 for odd numbers, 0 for even ones."""
    return n - 2.0 * _floor(0.5 * n)


def _floor(x: X) -> X:
    if isinstance(x, np.ndarray):
        return np.floor(x)
    return number(math.floor(x))
