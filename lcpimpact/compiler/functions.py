"""Compiled functions: each is compiled with those that it calls, and its machine code is kept in the cache."""

from __future__ import annotations

import ctypes
import functools
import hashlib
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from lcpimpact.cache import (
    GENERATED,
    code_file,
    forget_generated,
    keep_code,
    kept_code,
    reason,
    source_hash,
    warn_once,
)
from lcpimpact.compiler import machine
from lcpimpact.compiler.boundary import PYTHON, Boundary, Method, classes_of, symbols
from lcpimpact.compiler.code import RUNTIME
from lcpimpact.compiler.kinds import FunctionKind
from lcpimpact.compiler.lowering import Lowered, lower
from lcpimpact.compiler.routines import address_of
from lcpimpact.logs import LOG

TAKEN_IN: set[Any] = set()
"""Functions whose code is in that of others."""


@functools.cache
def symbol_of(function: Function) -> str:
    """Return the name of a function, with a hash of what its code depends on."""
    found = [function]
    for each in found:
        found += [other for other in origin_of(each)[1] if other not in found]
    known = sys.version_info[:2], machine.processor(), np.dtype(np.int64).num
    digest = hashlib.sha256(repr((known, [origin_of(each)[0] for each in found])).encode()).hexdigest()
    name = "".join(each if each.isascii() and each.isalnum() else "_" for each in function.py_func.__name__)
    return f"{name[:40]}.{digest[:32]}"


@functools.cache
def origin_of(function: Function) -> tuple[str, list[Function]]:
    """Return the source of a function, with the numbers and types of its names, and the functions that these stand for."""
    python, code = function.py_func, function.py_func.__code__
    text = python.__dict__.get("text") or source_hash(code.co_filename)
    place = python.__module__, python.__qualname__, code.co_firstlineno, str(function.declared)
    cells = zip(code.co_freevars, (each.cell_contents for each in python.__closure__ or ()), strict=True)
    names = {name: python.__globals__[name] for name in code.co_names if name in python.__globals__} | dict(cells)
    plain = {name: each for name, each in names.items() if isinstance(each, bool | int | float | tuple | type)}
    functions = [each for each in names.values() if isinstance(each, Function)]
    return repr((text, place, code.co_code, str(plain))), functions


class Function:
    """A function with one declared type, which is compiled when it is called, or the code of another needs it.

    Attributes
    ----------
    py_func             the Python function
    ready               whether its code is loaded
    from_disk           whether that was in the cache
    vectors             whether its loops become operations on vectors
    instead             instead(arguments) -> what is called while it is not, or None
    """

    def __init__(self, python: Any, stated: Callable[[], FunctionKind], inline: bool) -> None:
        functools.update_wrapper(self, python)
        self.py_func = python
        self.stated = stated
        self.inline = inline
        self.ready = self.from_disk = self.vectors = False
        self.instead: Any = None
        self.call: Callable[..., Any] = self._first

    def __call__(self, *arguments: Any) -> Any:
        """Call it."""
        return self.call(*arguments)

    def __reduce__(self) -> str:
        return str(self.py_func.__qualname__)  # copies and other processes have it by its name, as a function of Python

    @cached_property
    def declared(self) -> FunctionKind:
        """Its type."""
        return self.stated()

    @property
    def symbol(self) -> str:
        """Name of the function, with a hash of what its code depends on."""
        return symbol_of(self)

    @property
    def lowered(self) -> Lowered:
        """Its own code."""
        found = lower(self.py_func, self.declared, self.symbol, self.inline)
        TAKEN_IN.update(each for each in found.calls if each is not self)
        return found

    @property
    def taken_in(self) -> bool:
        """Whether the code of another function of this process holds it."""
        return self.inline or self in TAKEN_IN

    def parts(self) -> Iterator[Function]:
        """Yield it and all functions that it calls."""
        found, left = {self}, [self]
        while left:
            each = left.pop()
            yield each
            new = [other for other in each.lowered.calls if other not in found]
            found.update(new)
            left += new

    def code_file(self) -> Path | None:
        """Return the file of its compiled code, if it can have one."""
        name = f"{self.symbol}.o"
        if "text" in self.py_func.__dict__:
            return code_file(f"{GENERATED}/{name}")
        return code_file(name) if source_hash(self.py_func.__code__.co_filename) else None

    def resolve(self) -> None:
        """Load the code of the function, which is read or compiled."""
        with machine.LOCK:
            if self.ready:
                return
            path = self.code_file()
            self.from_disk = bool(path and self._read(path))
            if not self.from_disk:
                needed, code = self._compiled()
                if path:
                    keep_code(path, " ".join(needed).encode() + b"\n" + code)
                    if path.parent.name == GENERATED:
                        forget_generated()
                self._load(code, needed)
            self.call = self._entry()
            self.ready = True

    def _read(self, path: Path) -> bool:
        """Load the code of a file; return whether there is any."""
        try:
            needed, _, code = kept_code(path).partition(b"\n")
        except FileNotFoundError:
            return False
        except Exception as error:  # noqa: BLE001 (whatever was read is made anew)
            warn_once(f"cannot be read ({reason(error)}) and is compiled again")
            return False
        self._load(code, needed.decode().split())
        return True

    def _load(self, code: bytes, needed: Sequence[str]) -> None:
        """Take machine code into this process, with the routines that it calls."""
        addresses = symbols() | {each: address_of(each) for each in needed}
        addresses |= {name.strip('"'): id(each) for name, each in classes_of(self.declared.gives).items()}
        machine.load(code, addresses)

    def _compiled(self) -> tuple[list[str], bytes]:
        """Return the routines that it calls, and its machine code."""
        began = time.perf_counter()
        parts = list(self.parts())
        declared = dict.fromkeys(each for part in parts for each in part.lowered.declared)
        routines = dict.fromkeys(each for part in parts for each in part.lowered.routines)
        declared |= dict.fromkeys(each.declaration for each in routines)
        texts = [part.lowered.text for part in parts]
        texts[0] = texts[0].replace("define internal", "define", 1)
        boundary = Boundary(self.symbol, self.py_func.__name__, self.declared).text()
        lowered = time.perf_counter() - began
        code = machine.machine_code("\n".join([RUNTIME, PYTHON, *declared, *texts, boundary]), vectors=self.vectors)
        LOG.debug(
            "compiled %s in %.2f s, %.2f s of them its text",
            self.py_func.__qualname__,
            time.perf_counter() - began,
            lowered,
        )
        return [each.symbol for each in routines], code

    def _entry(self) -> Callable[..., Any]:
        """Return the function that Python calls."""
        address = machine.address_of(f"{self.symbol}.python")
        takes_array = 0x80  # of its arguments, and their number
        self._method = Method(self.py_func.__name__.encode(), address, takes_array, None)
        make = ctypes.pythonapi.PyCFunction_NewEx
        make.restype = ctypes.py_object
        make.argtypes = ctypes.POINTER(Method), ctypes.c_void_p, ctypes.c_void_p
        found: Callable[..., Any] = make(ctypes.byref(self._method), None, None)
        if not any(isinstance(each, FunctionKind) for each in self.declared.takes):
            return found

        def call(*arguments: Any) -> Any:
            for i, (each, kind) in enumerate(zip(arguments, self.declared.takes, strict=False)):
                if isinstance(each, Function) and each.declared != kind:
                    raise TypeError(f"argument {i + 1} of {self.py_func.__name__} is no function of the type {kind}")
            return found(*(each.address if isinstance(each, Function) else each for each in arguments))

        return call

    def _first(self, *arguments: Any) -> Any:
        """Call it where its code is not loaded."""
        if self.instead and (called := self.instead(arguments)):
            return called(*arguments)
        self.resolve()
        return self.call(*arguments)

    @property
    def address(self) -> int:
        """The address of its code."""
        self.resolve()
        return machine.address_of(self.symbol)
