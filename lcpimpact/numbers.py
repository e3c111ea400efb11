"""What counts as a number in the input."""

from __future__ import annotations

import math
from typing import Any


def is_real(value: Any) -> bool:
    """Return whether a value is a finite real number (and not a bool)."""
    try:
        return not isinstance(value, (bool, str)) and math.isfinite(value)
    except (TypeError, OverflowError):
        return False


def is_count(value: Any) -> bool:
    """Return whether a value is a whole number above zero that a machine counts to."""
    return is_real(value) and 1 <= value < 2**63 and value == int(value)
