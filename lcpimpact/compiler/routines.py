"""Functions of other languages whose arguments are addresses, as SciPy offers those of BLAS and LAPACK."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from typing import Any

from lcpimpact.compiler.kinds import NONE, REAL, SHORT, Scalar

GIVES: dict[Any, Scalar] = {None: NONE, ctypes.c_int: SHORT, ctypes.c_double: REAL}
"""Types of results."""


@dataclass(frozen=True, eq=False)
class Routine:
    """A function of another language.

    Attributes
    ----------
    symbol : str            its module and its name
    count : int             number of its arguments
    gives : Scalar
    py_func : callable      the function, called by Python
    """

    symbol: str
    count: int
    gives: Scalar
    py_func: Callable[..., Any]

    def __call__(self, *arguments: Any) -> Any:
        """Call it from Python."""
        return self.py_func(*arguments)

    @property
    def declaration(self) -> str:
        """Its declaration."""
        return f"declare {self.gives.stored} @{self.symbol}({', '.join(['ptr'] * self.count)})"


@cache
def address_of(symbol: str) -> int:
    """Return the address of a function that a module in Cython exports."""
    module, _, name = symbol.rpartition(".")
    api = ctypes.pythonapi
    capsule = ctypes.py_object(import_module(module).__pyx_capi__[name])
    api.PyCapsule_GetName.restype = ctypes.c_char_p
    api.PyCapsule_GetPointer.restype = ctypes.c_void_p
    api.PyCapsule_GetPointer.argtypes = ctypes.py_object, ctypes.c_char_p
    return int(api.PyCapsule_GetPointer(capsule, api.PyCapsule_GetName(capsule)))


@cache
def routine(symbol: str, count: int, gives: type | None = None) -> Routine:
    """Return a function by its module and name, with the number of its arguments and the type of its result."""
    python = ctypes.CFUNCTYPE(gives, *[ctypes.c_void_p] * count)(address_of(symbol))
    return Routine(symbol, count, GIVES[gives], python)
