"""Compilation: hot loops are plain Python functions, compiled ahead of their first call for stated types.

With the environment variable ``NUMBA_DISABLE_JIT=1`` the same lines run in the interpreter, with the same bits
(no fast-math, no reordering). Compiled code is cached on disk in a folder named after a hash of the package's own
source, because numba's cache does not notice that a function called from another file has changed.
"""

from __future__ import annotations

import hashlib
import os
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from types import FunctionType
from typing import Any, TypeVar

import numba
from numba import types
from platformdirs import user_cache_path

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


CONFIG: Any = numba.config

COMPILING = not CONFIG.DISABLE_JIT
"""Whether functions are compiled in this process."""


@cache
def cache_folder() -> Path:
    """Return the folder of the compiled code of exactly this source."""
    digest = hashlib.sha256()
    package = Path(__file__).parent
    for file in sorted(package.rglob("*.py")):
        digest.update(file.relative_to(package).as_posix().encode())
        digest.update(file.read_bytes())
    base = Path(os.environ.get("NUMBA_CACHE_DIR") or user_cache_path("lcpimpact"))
    folder = base / digest.hexdigest()[:16]
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        # A home that cannot be written costs a compilation in each process, and nothing else.
        folder = Path(tempfile.mkdtemp(prefix="lcpimpact-"))
    return folder


def compiled(signature: Any) -> Callable[[F], F]:
    """Compile a function for one signature, and cache the result on disk.

    Parameters
    ----------
    signature : numba signature
        Argument and return types; an argument may itself be a compiled function (``types.FunctionType``), which,
        unlike an inferred one, does not defeat the cache.
    """

    def decorate(function: F) -> F:
        previous = CONFIG.CACHE_DIR
        CONFIG.CACHE_DIR = str(cache_folder())
        try:
            decorated: F = numba.njit(signature, cache=True, error_model="numpy")(function)
        finally:
            CONFIG.CACHE_DIR = previous
        return decorated

    return decorate


def interpreted(function: F, **names: Any) -> F:
    """Return the Python function behind a compiled one: the same lines, run by the interpreter.

    Parameters
    ----------
    function : compiled function
        With compilation switched off, the function itself.
    **names
        Functions to stand under global names of ``function``, in place of what its module has there: an operator's own
        product in place of that of an array, or a note-taker in place of one that takes none.
    """
    python: Any = getattr(function, "py_func", function)
    if names:
        python = FunctionType(python.__code__, python.__globals__ | names, python.__name__, None, python.__closure__)
    found: F = python
    return found
