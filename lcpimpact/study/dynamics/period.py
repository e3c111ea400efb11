"""The period of a sequence of points."""

from __future__ import annotations

import numpy as np

from lcpimpact.arrays import Array

MAX_PERIOD = 16
"""Maximum period considered, in points of the section."""


def period_of(points: Array, tol: float = 1e-6, most: int = MAX_PERIOD) -> int:
    """Return the period of a sequence in points, 0 if not periodic.

    Parameters
    ----------
    points : (k, d) array
        Points of a section, without the transient.
    tol : float
        Tolerance, relative to the largest |value| of each column, or a millionth of the largest of all.
    most : int
        Maximum period considered; half of the points must show it.

    Examples
    --------
    >>> period_of(np.array([[1.0], [2.0], [1.0], [2.0], [1.0], [2.0]]))
    2
    """
    points = np.atleast_2d(np.asarray(points, dtype=np.float64))
    unit = tol * extents(points)
    for p in range(1, min(most, len(points) // 2) + 1):
        if (np.abs(points[p:] - points[:-p]) <= unit).all():
            return p
    return 0


def extents(points: Array) -> Array:
    """Return the largest |value| of each column (d,), bounded below relative to the others against rounding."""
    sizes = np.abs(points).max(axis=0, initial=0.0)
    return np.asarray(np.maximum(sizes, max(1e-6 * sizes.max(initial=0.0), 1e-300)))
