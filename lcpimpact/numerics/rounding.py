"""Limits of floating-point numbers, in which tolerances against rounding are stated."""

from __future__ import annotations

EPS = 2.0**-52
"""Distance from 1 to the next float: twice the largest relative rounding error of an operation."""

TINY = 2.0**-1022
"""The smallest number with all its digits."""
