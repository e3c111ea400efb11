"""Harmonic signals at many instants."""

from __future__ import annotations

import math

import numpy as np

from lcpimpact.arrays import Array
from lcpimpact.compiled import compiled, f8, matrix, vector


@compiled(matrix(f8, f8, f8, vector))
def harmonic(amplitude: float, omega: float, phase: float, t: Array) -> Array:
    """Return a cos(ω t + φ) and its derivative (nt, 2), with the same bits as the functions of one instant."""
    found = np.empty((len(t), 2))
    for k in range(len(t)):
        found[k, 0] = amplitude * math.cos(omega * t[k] + phase)
        found[k, 1] = -amplitude * omega * math.sin(omega * t[k] + phase)
    return found
