"""The array types of the project's own signatures, and the inverse of a permutation."""

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
