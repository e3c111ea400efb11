"""The types of values in compiled code, from annotations, and the registers of LLVM that hold a value of each."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from types import NoneType
from typing import Annotated, Any, TypeAlias, get_args, get_origin, get_type_hints

import numpy as np

from lcpimpact.arrays import Axes


@dataclass(frozen=True)
class Scalar:
    """A number or a truth value.

    Attributes
    ----------
    name : str
    register : str      type of LLVM
    stored : str        type of LLVM in an array
    """

    name: str
    register: str
    stored: str


REAL = Scalar("float64", "double", "double")
WHOLE = Scalar("int64", "i64", "i64")
FLAG = Scalar("bool", "i1", "i8")
UNSIGNED = Scalar("uint64", "i64", "i64")
"""Elements of arrays that are whole numbers without sign."""
SHORT = Scalar("int32", "i64", "i32")
"""Elements of arrays that Fortran takes for its integers."""
POINTER = Scalar("pointer", "ptr", "ptr")
NONE = Scalar("None", "void", "void")

STORED = {each.name: each for each in (REAL, WHOLE, FLAG, UNSIGNED, SHORT)}
"""The elements of arrays by the names of their dtypes."""


@dataclass(frozen=True)
class ArrayKind:
    """An array: its elements, the number of its axes, and their order, "C" or, with strides, "A"."""

    element: Scalar
    axes: int
    order: str = "C"


@dataclass(frozen=True)
class TupleKind:
    """A tuple, or a named one of a class."""

    items: tuple[Kind, ...]
    named: type | None = None


@dataclass(frozen=True)
class FunctionKind:
    """A function that is called by its address."""

    takes: tuple[Kind, ...]
    gives: Kind


Kind: TypeAlias = Scalar | ArrayKind | TupleKind | FunctionKind


@cache
def registers(kind: Kind) -> tuple[str, ...]:
    """Return the types of the registers that hold a value.

    Those of an array are the address of its data, its lengths, its strides in elements where it is of order "A", and the
    address of the count of references to its memory, which is null where that belongs to Python.
    """
    match kind:
        case ArrayKind(_, axes, order):
            return ("ptr", *["i64"] * (axes if order == "C" else 2 * axes), "ptr")
        case TupleKind(items):
            return tuple(each for item in items for each in registers(item))
        case FunctionKind():
            return ("ptr",)
        case Scalar("None"):
            return ()
        case Scalar():
            return (kind.register,)


@cache
def owners(kind: Kind) -> tuple[int, ...]:
    """Return which of its registers are addresses of counts of references."""
    match kind:
        case ArrayKind():
            return (len(registers(kind)) - 1,)
        case TupleKind(items):
            found, first = list[int](), 0
            for item in items:
                found += [first + i for i in owners(item)]
                first += len(registers(item))
            return tuple(found)
    return ()


@cache
def kind_of(hint: Any) -> Kind:
    """Return the type of an annotation.

    Examples
    --------
    >>> from lcpimpact.arrays import Matrix
    >>> kind_of(tuple[int, Matrix]) == TupleKind((WHOLE, ArrayKind(REAL, 2)))
    True
    """
    origin = get_origin(hint) or hint
    arguments = get_args(hint)
    if origin in (float, int, bool):
        return {float: REAL, int: WHOLE, bool: FLAG}[origin]
    if origin in (None, NoneType):
        return NONE
    if origin is Annotated:
        return _marked(*arguments)
    if origin is Callable:
        return FunctionKind(tuple(map(kind_of, arguments[0])), kind_of(arguments[1]))
    if origin is tuple:
        return TupleKind(tuple(map(kind_of, arguments)))
    if hasattr(origin, "_fields"):
        fields = get_type_hints(origin, include_extras=True).values()
        return TupleKind(tuple(map(kind_of, fields)), origin)
    raise TypeError(
        f"{hint} has no type in compiled code: an array needs its axes, as lcpimpact.arrays.Vector has them"
    )


def _marked(hint: Any, *marks: Any) -> Kind:
    """Return the type of an array with its axes, or what another mark makes of the type without it."""
    mark = marks[-1]
    if not isinstance(mark, Axes):
        return mark(kind_of(hint))  # type: ignore[no-any-return]
    kind = hint
    while arguments := get_args(kind):  # `NDArray` is an array of a dtype, or from NumPy 2.5 on a name for one
        kind = arguments[-1]
    return ArrayKind(STORED[np.dtype(kind).name], mark.number, mark.order)


def function_kind(function: Any) -> FunctionKind:
    """Return the type of a function from its annotations."""
    hints = get_type_hints(function, include_extras=True)
    code = function.__code__
    takes = tuple(kind_of(hints[name]) for name in code.co_varnames[: code.co_argcount])
    return FunctionKind(takes, kind_of(hints["return"]))
