"""Compiled functions by the public names of numba, where it has lost one that `lcpimpact.numba_internals` needs.

Each function is compiled at its first call, with the same bits; numba's own cache keeps the code, in the same folder.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import RLock
from types import FunctionType
from typing import Any

import numba
from numba import types
from numba.extending import typeof_impl

from lcpimpact.cache import folder, source_hash, usable

CONFIG: Any = numba.config

BY_ADDRESS = False
"""Functions are passed on as they are."""

LOCK = RLock()
"""Held while a function is compiled, or the settings of numba are changed."""


class Function:
    """A function with one signature, which is compiled when it is called first, or compiled code calls it.

    Attributes
    ----------
    py_func             the Python function
    ready               that it never runs in the interpreter
    taken_in            that other compiled code takes it in, which numba does not tell
    """

    ready = True
    taken_in = False

    def __init__(self, python: Any, stated: Callable[[], Any], inline: str) -> None:
        functools.update_wrapper(self, python)
        self.py_func = python
        self.stated = stated
        self.inline = inline

    @functools.cached_property
    def declared(self) -> Any:
        """Its signature."""
        return self.stated()

    @functools.cached_property
    def code(self) -> Any:
        """The dispatcher of numba."""
        with LOCK:
            return compile_function(numba.njit, self.py_func, self.declared, inline=self.inline, nogil=True)

    def resolve(self) -> None:
        """Compile the function for its signature, or read the compiled code."""
        _ = self.code

    def __call__(self, *arguments: Any) -> Any:
        """Call the compiled code."""
        return self.code(*arguments)


@typeof_impl.register(Function)
def typeof_function(function: Function, context: Any) -> Any:
    """Return the type by which compiled code calls a function."""
    return numba.typeof(function.code)


def compile_function(by: Callable[..., Any], python: FunctionType, signature: Any, **options: bool | str) -> Any:
    """Return a function that is compiled by ``numba.njit`` or ``numba.cfunc``, or read from numba's cache."""
    kept = source_hash(python.__code__.co_filename) is not None and usable()
    with settings(CACHE_DIR=str(folder()), CACHE_LOCATOR_CLASSES=""):
        return by(signature, cache=kept, error_model="numpy", **options)(python)


@contextmanager
def settings(**values: str) -> Iterator[None]:
    """Change settings of numba for a block: its cache sees no change of another file, and has to be in our `folder`."""
    with LOCK:
        before = {name: getattr(CONFIG, name, "") for name in values}
        try:
            vars(CONFIG).update(values)
            yield
        finally:
            vars(CONFIG).update(before)


def function_of(python: FunctionType, stated: Callable[[], Any], inline: str, allocates: bool) -> Function:
    """Return a function that is not compiled yet."""
    return Function(python, stated, inline)


@functools.cache
def address(function: Function, kind: types.FunctionType) -> Any:
    """Return a compiled function as one of a FunctionType."""
    # Numba's cache keeps one code for both, and that of a callback lacks what a call needs: the function comes first.
    function.resolve()
    with LOCK:
        return compile_function(numba.cfunc, function.py_func, kind.signature, nopython=True)


def function_at(kind: types.FunctionType) -> Function:
    """Return the function by which compiled code gets a function of a FunctionType from its `address`: itself."""

    def same(function: Function) -> Function:
        return function

    return Function(same, lambda: kind(kind), "never")
