"""The array types of the project's own signatures, the inverse of a permutation, and the largest values of columns."""

from typing import TYPE_CHECKING, Annotated, Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from scipy.sparse import csr_array


class Axes(NamedTuple):
    """The number of axes of an array and the order of its numbers, "C" or, for arrays in any order, "A"."""

    number: int
    order: Literal["C", "A"] = "C"


Array: TypeAlias = NDArray[np.float64]
"""An array of any number of axes, in functions that are not compiled."""

Vector: TypeAlias = Annotated[Array, Axes(1)]
Matrix: TypeAlias = Annotated[Array, Axes(2)]
Stack: TypeAlias = Annotated[Array, Axes(3)]
"""A stack of matrices; its first index says which."""
Stacks: TypeAlias = Annotated[Array, Axes(4)]

Indices: TypeAlias = Annotated[NDArray[np.int64], Axes(1)]
IndexMatrix: TypeAlias = Annotated[NDArray[np.int64], Axes(2)]
Places: TypeAlias = Annotated[NDArray[np.uint64], Axes(1)]
"""Unsigned indices, for which compiled code need not check for a count from the end."""

Flags: TypeAlias = Annotated[NDArray[np.bool_], Axes(1)]
FlagMatrix: TypeAlias = Annotated[NDArray[np.bool_], Axes(2)]
Sparse: TypeAlias = "csr_array"
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
