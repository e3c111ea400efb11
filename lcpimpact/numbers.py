"""Checks of numbers in the input."""

from __future__ import annotations

import math
from typing import TypeGuard

import numpy as np
from numpy.typing import ArrayLike

from lcpimpact.arrays import Array
from lcpimpact.errors import InputError
from lcpimpact.formula import Formula, NotTracedError

NUMBERS = (int, float, np.integer, np.floating)
"""Accepted types; others, such as decimals and fractions, would give arrays of objects."""


def is_real(value: object) -> TypeGuard[float]:
    """Return whether a value is a finite real number (and not a bool), or a formula of one."""
    if isinstance(value, Formula):
        return math.isfinite(value.value)
    try:
        return isinstance(value, NUMBERS) and not isinstance(value, bool) and math.isfinite(value)
    except OverflowError:
        return False


def is_count(value: object) -> TypeGuard[int]:
    """Return whether a value is a positive whole number below 2**63."""
    return is_real(value) and 1 <= value < 2**63 and value == int(value)


def positive(name: str, value: float, unit: str = "") -> None:
    """Check that a value is a positive finite number."""
    if not is_real(value) or not value > 0.0:
        raise InputError(f"{name} = {value!r} must be a positive finite number{f' in {unit}' if unit else ''}")


def finite(name: str, value: float, unit: str = "", least: float = -math.inf) -> None:
    """Check that a value is a finite number, not below ``least``."""
    if not is_real(value) or (least > -math.inf and value < least):
        above = f", at least {least:g}" if least > -math.inf else ""
        raise InputError(f"{name} = {value!r} must be a finite number{f' in {unit}' if unit else ''}{above}")


def between(name: str, value: float, low: float, high: float) -> None:
    """Check that a value is a number from ``low`` to ``high``."""
    if not is_real(value) or not low <= value <= high:
        raise InputError(f"{name} = {value!r} must lie between {low:g} and {high:g}")


def count(name: str, value: float, least: int = 1) -> None:
    """Check that a value is a whole number, not below ``least``, which is 1 or 0."""
    if not (is_count(value) or (least == 0 and is_real(value) and value == 0)):
        raise InputError(f"{name} = {value!r} must be a whole number, at least {least}")


def random_numbers(seed: int) -> np.random.Generator:
    """Return the random numbers of a seed, a whole number, at least 0."""
    count("seed", seed, 0)
    return np.random.default_rng(int(seed))


def finite_array(name: str, value: ArrayLike) -> Array:
    """Return numbers as an array, and refuse other values and numbers that are not finite."""
    try:
        array = np.array(value, dtype=np.float64)
    except NotTracedError:
        raise
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"{name} must be a matrix of numbers") from None
    if not np.isfinite(array).all():
        raise InputError(f"{name} holds a number that is not finite")
    return array
