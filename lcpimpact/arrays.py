"""The array types of the project's own signatures, the inverse of a permutation, and the largest values of columns."""

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[np.float64]
Indices: TypeAlias = NDArray[np.int64]
Places: TypeAlias = NDArray[np.uint64]
Flags: TypeAlias = NDArray[np.bool_]
Sparse: TypeAlias = Any
"""A matrix in compressed rows, `scipy.sparse.csr_array`."""


def inverse(order: Indices) -> Indices:
    """Return the permutation that puts entries in an order back in their places: a[order][inverse(order)] is a (n,)."""
    back = np.empty_like(order)
    back[order] = np.arange(len(order))
    return back


def largest(samples: Array) -> Array:
    """Return the largest absolute value in each column of samples (nt, n), or 0 for no samples (n,)."""
    # NumPy is slow along the first axis of narrow arrays.
    return np.asarray(np.abs(np.ascontiguousarray(samples.T)).max(axis=1, initial=0.0))
