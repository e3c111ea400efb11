"""Compiled functions as the interpreter runs them, with the same bits: with other functions in them, or uncompiled."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache
from types import CodeType, FunctionType
from typing import Any, TypeVar

import numpy as np

F = TypeVar("F", bound=Callable[..., Any])


def interpreted(function: F, made: Callable[[F, FunctionType], F] | None = None, **names: Callable[..., Any]) -> F:
    """Return the Python function of a compiled one, to be run by the interpreter.

    Parameters
    ----------
    function : compiled function
        If compilation is switched off, the function itself.
    made : callable
        made(compiled, python) -> what takes the place of a function whose names are replaced, as one compiled again.
    **names
        Functions that replace the global names of ``function`` and of the functions that it calls, such as the product of an
        operator in place of that of an array, or a recording of iterates.
    """
    python: Any = getattr(function, "py_func", function)
    changed = {}
    for name in python.__code__.co_names if names else ():
        called = python.__globals__.get(name)
        if name in names:
            changed[name] = names[name]
        elif isinstance(getattr(called, "py_func", None), FunctionType):
            inner = interpreted(called, made, **names)
            changed |= {name: inner} if inner is not called.py_func else {}
    if changed:
        python = _with_names(python, changed)
        python = made(function, python) if made else python
    found: F = python
    return found


def function_of(text: str, names: Mapping[str, Any]) -> Any:
    """Return the function of a generated source, with the global names of the text."""
    (code,) = (each for each in compile(text, "<text>", "exec").co_consts if isinstance(each, CodeType))
    return FunctionType(code, {"__name__": __name__, **names})


@cache
def throughout(function: Any) -> Any:
    """Return the Python function of a compiled one, in which all functions that it calls are Python functions too."""
    python = getattr(function, "py_func", function)
    if not isinstance(python, FunctionType):
        return python
    called = {name: python.__globals__.get(name) for name in python.__code__.co_names}
    changed = {name: throughout(each) for name, each in called.items() if hasattr(each, "py_func")}
    return _with_names(python, changed) if changed else python


def _with_names(python: FunctionType, names: dict[str, Callable[..., Any]]) -> FunctionType:
    """Return a Python function in which some global names stand for something else."""
    return FunctionType(python.__code__, python.__globals__ | names, python.__name__, None, python.__closure__)


def arrays_in(arguments: Sequence[Any]) -> Iterator[np.ndarray]:
    """Yield the arrays of some arguments, which may be tuples of arrays."""
    for each in arguments:
        if isinstance(each, np.ndarray):
            yield each
        elif isinstance(each, tuple):
            yield from arrays_in(each)


def size_of(arguments: Sequence[Any]) -> int:
    """Return the count of numbers in the arrays of some arguments."""
    return sum(each.size for each in arrays_in(arguments))
