"""What counts as a number in the input."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

NUMBERS = (int, float, np.integer, np.floating)
"""Others, as decimals and fractions, make arrays of objects."""


def is_real(value: Any) -> bool:
    """Return whether a value is a finite real number (and not a bool)."""
    try:
        return isinstance(value, NUMBERS) and not isinstance(value, bool) and math.isfinite(value)
    except OverflowError:
        return False


def is_count(value: Any) -> bool:
    """Return whether a value is a whole number above zero that a machine counts to."""
    return is_real(value) and 1 <= value < 2**63 and value == int(value)
