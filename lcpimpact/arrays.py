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


NARROW = 32
"""Number of columns up to which they are passed over one by one: NumPy is slow along the first axis of narrow arrays."""


def largest(samples: Array) -> Array:
    """Return the largest absolute value in each column of samples (nt, n), or 0 for no samples (n,)."""
    if samples.shape[1] > NARROW:
        return np.asarray(np.abs(samples).max(axis=0, initial=0.0))
    return np.array([np.abs(column).max(initial=0.0) for column in samples.T], dtype=np.float64)
