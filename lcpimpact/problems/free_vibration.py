r"""The free vibration of a damped oscillator, for any damping."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from lcpimpact.arrays import Array
from lcpimpact.formula import Formula, sqrt


def free_vibration(t: ArrayLike, ω: float, ζ: float) -> tuple[Array, Array, Array]:
    r"""Return S, C and S' of x'' + 2 ζ ω x' + ω² x = 0, where S(0) = 0, S'(0) = 1 and C(0) = 1, C'(0) = 0.

    .. math:: S = e^{-ζωt} \frac{\sin ω_d t}{ω_d}, \qquad C = S' + 2ζω S, \qquad ω_d = ω \sqrt{1 - ζ^2},

    so x = C x(0) + S x'(0) and x' = -ω² S x(0) + S' x'(0). With ζ > 1 sine and cosine turn into their hyperbolic kin.

    They are formulas of one time t, ω and ζ if these are.

    Parameters
    ----------
    t : array_like
        Times in s, not negative.
    ω : float
        Circular frequency without damping in rad/s.
    ζ : float
        Damping as a fraction of the critical one.

    Examples
    --------
    >>> S, C, dS = free_vibration([0.0, math.pi], ω=1.0, ζ=0.0)
    >>> C.tolist()
    [1.0, -1.0]
    """
    t = t if isinstance(t, Formula) else np.asarray(t, dtype=np.float64)
    root = sqrt(abs((1.0 - ζ) * (1.0 + ζ)))
    σ = ω * root
    if ζ < 1.0:
        decay = np.exp(-ζ * ω * t)
        S, even = decay * np.sin(σ * t) / σ, decay * np.cos(σ * t)
    elif σ == 0.0:
        even = np.exp(-ω * t)
        S = t * even
    else:
        slow = np.exp(-ω * t / (ζ + root))
        S = -0.5 * slow * np.expm1(-2.0 * σ * t) / σ
        even = 0.5 * slow * (1.0 + np.exp(-2.0 * σ * t))
    return S, even + ζ * ω * S, even - ζ * ω * S


def angle(ζ: float) -> float:
    """Return acos ζ/sqrt(1 - ζ²), which goes on as acosh ζ/sqrt(ζ² - 1) past ζ = 1: ω t at the first turning point of S."""
    root = math.sqrt(abs((1.0 - ζ) * (1.0 + ζ)))
    if root == 0.0:
        return 1.0
    return (math.atan2(root, ζ) if ζ < 1.0 else math.asinh(root)) / root
