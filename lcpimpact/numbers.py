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
    """Return whether a value is a whole number above zero."""
    return is_real(value) and value >= 1 and value == int(value)
