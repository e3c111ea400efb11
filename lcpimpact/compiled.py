"""Compilation: hot loops are plain Python functions, compiled ahead of their first call for stated types.

With the environment variable ``NUMBA_DISABLE_JIT=1`` the same lines run in the interpreter, with the same bits
(no fast-math, no reordering). Compiled code is cached on disk in the `folder` of exactly this source. A cache that cannot
be read or written costs a compilation and a sentence, and nothing else.
"""

from __future__ import annotations

import hashlib
import logging
import pickle
import subprocess
import sys
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from types import FunctionType
from typing import Any, Literal, TypeVar, cast

import numba
from numba import types
from numba.core.caching import CompileResultCacheImpl, FunctionCache, IndexDataCacheFile, _CacheLocator

from lcpimpact.cache import folder, note_use

F = TypeVar("F", bound=Callable[..., Any])

f8 = types.float64
i8 = types.int64
vector = types.float64[::1]
matrix = types.float64[:, ::1]
flags = types.boolean[::1]
cube = types.float64[:, :, ::1]
indices = types.int64[::1]
places = types.uint64[::1]
"""Indices that never count from the end: what compiled code need not ask of each."""
named_tuple: Any = types.BaseTuple.from_types
"""named_tuple(types, NamedTuple): the type of such a tuple."""


CONFIG: Any = numba.config

COMPILING = not CONFIG.DISABLE_JIT
"""Whether functions are compiled in this process."""

LOG = logging.getLogger("lcpimpact")

DIGEST = 32
"""Bytes of a SHA-256."""


class Locator(_CacheLocator):
    """The place of one function's compiled code: in the `folder` of this source, and nowhere else."""

    def __init__(self, file: str, line: int) -> None:
        self._path = str(folder() / self.get_suitable_cache_subpath(file))
        self._file, self._line = file, line

    @classmethod
    def from_function(cls, py_func: Any, py_file: str) -> Locator:
        """Return the place for a function of a file."""
        return cls(py_file, py_func.__code__.co_firstlineno)

    def get_cache_path(self) -> str:
        """Return the folder of the function's files."""
        return self._path

    def get_source_stamp(self) -> str:
        """Return a hash of the function's file, which need not be one of this package."""
        return file_hash(self._file)

    def get_disambiguator(self) -> str:
        """Return what tells apart functions of one name in one file."""
        return str(self._line)


class Place(CompileResultCacheImpl):
    """How numba turns compiled code to bytes, with our own place for them."""

    _locator_classes = [Locator]  # noqa: RUF012 (as numba has it)


class CheckedFiles(IndexDataCacheFile):
    """Files of compiled code that begin with a hash, so that a damaged one, or one of another function, is never run."""

    def _save_data(self, name: str, data: Any) -> None:
        code = self._dump(data)
        with self._open_for_write(self._data_path(name)) as file:
            file.write(self._hash(name, code))
            file.write(code)

    def _load_data(self, name: str) -> Any:
        content = memoryview(Path(self._data_path(name)).read_bytes())
        if content[:DIGEST] != self._hash(name, content[DIGEST:]):
            raise ValueError(f"{name} is damaged")
        return pickle.loads(content[DIGEST:])

    def _hash(self, name: str, code: Any) -> bytes:
        digest = hashlib.sha256(f"{name} {self._version} {self._source_stamp}".encode())
        digest.update(code)
        return digest.digest()


class CheckedCache(FunctionCache):
    """numba's cache of one function, which nothing on the disk can stop.

    A file that cannot be read is compiled and written anew; if that fails too, the code just made is used without it.
    """

    _impl_class = Place

    def __init__(self, function: Any) -> None:
        super().__init__(function)
        locator = self._impl.locator
        self._cache_file = CheckedFiles(locator.get_cache_path(), self._impl.filename_base, locator.get_source_stamp())
        self._damaged = False

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the compiled code for a signature, or None."""
        try:
            return super().load_overload(sig, target_context)
        except Exception as error:  # noqa: BLE001 (what is read may be anything)
            self._damaged = True
            say_once(f"cannot be read ({reason(error)}) and is made anew")
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Save compiled code, over what was damaged."""
        try:
            if self._damaged:
                self.flush()
            super().save_overload(sig, data)
        except Exception as error:  # noqa: BLE001 (the code is there, only not on the disk)
            say_once(f"cannot be saved ({reason(error)}) and is made anew in each run")


@cache
def file_hash(file: str) -> str:
    """Return the hash of a source file."""
    return hashlib.sha256(Path(file).read_bytes()).hexdigest()


def reason(error: Exception) -> str:
    """Return in few words what went wrong."""
    return (error.strerror if isinstance(error, OSError) else None) or str(error) or type(error).__name__


said: list[str] = []
"""What was said of the cache in this process."""


def say_once(what: str) -> None:
    """Say what is wrong with the cache, once in a program: neither for each function, nor again in each worker."""
    from multiprocessing import parent_process

    if not said and parent_process() is None:
        LOG.warning(
            "lcpimpact: the compiled code in %s %s; `lcpimpact cache --clear` empties the folder, and the environment "
            "variable NUMBA_CACHE_DIR names another",
            folder(),
            what,
        )
    said.append(what)


@cache
def usable() -> bool:
    """Return whether there is a folder for compiled code, and note that it is used."""
    try:
        note_use()
    except OSError as error:
        say_once(f"has no place ({reason(error)}) and is made anew in each run")
        return False
    return True


def compiled(signature: Any, inline: Literal["never", "always"] = "never", allocates: bool = True) -> Callable[[F], F]:
    """Compile a function for one signature, and cache the result on disk.

    Parameters
    ----------
    signature : numba signature
        Argument and return types; an argument may itself be a compiled function (``types.FunctionType``), which,
        unlike an inferred one, does not defeat the cache.
    inline : {"never", "always"}
        Whether its lines are put in the place of each call, as for what an inner loop calls in each step.
    allocates : bool
        Whether it makes arrays. Code that makes none counts no references to those that it is given, which costs more than
        the arithmetic of a few rows.
    """

    def decorate(function: F) -> F:
        if not COMPILING:
            cast(Any, function).py_func = function  # as a compiled one has it
            return function
        options: dict[str, Any] = {"error_model": "numpy", "inline": inline, "_nrt": allocates}
        decorated: Any = numba.njit(**options)(function)
        if usable() and Path(function.__code__.co_filename).exists():
            decorated._cache = CheckedCache(function)
        decorated.compile(signature)
        decorated.disable_compile()
        return cast(F, decorated)

    return decorate


def compile_ahead(*parts: Sequence[str]) -> None:
    """Compile modules into the cache, once for a source, each part of them in a process of its own.

    Parameters
    ----------
    *parts
        Names of modules, those first that others import; a part should import little that another one compiles.
    """
    done = folder() / hashlib.sha256(repr(parts).encode()).hexdigest()[:16]
    if not COMPILING or not usable() or done.exists():
        return
    imports = ["; ".join(f"import {name}" for name in part) for part in parts]
    running = [subprocess.Popen([sys.executable, "-c", each], stderr=subprocess.DEVNULL) for each in imports]
    try:
        codes = [process.wait() for process in running]
        if not any(codes):
            done.touch()
    except OSError as error:
        say_once(f"cannot be written ({reason(error)}) and is made anew in each run")
    finally:
        for process in running:
            process.kill()


def interpreted(function: F, **names: Any) -> F:
    """Return the Python function behind a compiled one: the same lines, run by the interpreter.

    Parameters
    ----------
    function : compiled function
        With compilation switched off, the function itself.
    **names
        Functions to stand under global names of ``function`` and of the functions that it calls, in place of what their
        modules have there: an operator's own product in place of that of an array, or a note-taker in place of one that
        takes none.
    """
    python: Any = getattr(function, "py_func", function)
    changed = {}
    for name in python.__code__.co_names if names else ():
        called = python.__globals__.get(name)
        if name in names:
            changed[name] = names[name]
        elif getattr(called, "py_func", function) is not function:
            inner = interpreted(called, **names)
            changed |= {name: inner} if inner is not called.py_func else {}
    if changed:
        python = FunctionType(python.__code__, python.__globals__ | changed, python.__name__, None, python.__closure__)
    found: F = python
    return found
