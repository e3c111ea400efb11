"""The numba types of annotations, from which compiled functions have their signatures."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from types import NoneType
from typing import Annotated, Any, get_args, get_origin, get_type_hints

import numba
import numpy as np
from numba import types

from lcpimpact.arrays import Axes

SCALARS: dict[Any, types.Type] = {float: types.float64, int: types.int64, bool: types.boolean}
SCALARS |= dict.fromkeys((None, NoneType), types.none)


@cache
def numba_type(hint: Any) -> Any:
    """Return the numba type of an annotation.

    Examples
    --------
    >>> from collections.abc import Callable
    >>> from lcpimpact.arrays import Matrix, Vector
    >>> matrix, vector = types.float64[:, ::1], types.float64[::1]
    >>> numba_type(tuple[int, Matrix]) == types.Tuple((types.int64, matrix))
    True
    >>> numba_type(Callable[[Matrix, Vector], float]) == types.FunctionType(types.float64(matrix, vector))
    True
    """
    origin = get_origin(hint) or hint
    arguments = get_args(hint)
    if origin in SCALARS:
        return SCALARS[origin]
    if origin is Annotated:
        return _marked(*arguments)
    if origin is Callable:
        return types.FunctionType(numba_type(arguments[1])(*map(numba_type, arguments[0])))
    if origin is tuple:
        return types.BaseTuple.from_types(tuple(map(numba_type, arguments)))
    if hasattr(origin, "_fields"):
        fields = get_type_hints(origin, include_extras=True).values()
        return types.BaseTuple.from_types(tuple(map(numba_type, fields)), origin)
    raise TypeError(f"{hint} has no numba type: an array needs its axes, as lcpimpact.arrays.Vector has them")


def _marked(hint: Any, *marks: Axes | Callable[[types.Type], types.Type]) -> types.Type:
    """Return the type of an array with its axes, or what another mark makes of the type without it."""
    mark = marks[-1]
    if not isinstance(mark, Axes):
        return mark(numba_type(hint))
    kind = hint
    while arguments := get_args(kind):  # `NDArray` is an array of a dtype, or from NumPy 2.5 on a name for one
        kind = arguments[-1]
    return types.Array(numba.from_dtype(np.dtype(kind)), mark.number, mark.order)


def signature_of(function: Any) -> Any:
    """Return the numba signature of a function from its annotations."""
    hints = get_type_hints(function, include_extras=True)
    code = function.__code__
    arguments = code.co_varnames[: code.co_argcount]
    return numba_type(hints["return"])(*(numba_type(hints[name]) for name in arguments))
