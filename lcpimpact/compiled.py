"""Compilation: when a function of Python is compiled by lcpimpact.compiler, and what runs until then.

Compiled functions run in the interpreter at first, and for good where llvmlite is not installed or the environment variable
``LCPIMPACT_COMPILE`` is ``never``, with bitwise equal results (no fast-math, no reordering). A function is compiled for the
types of its annotations when its calls repay that, and kept on disk in the `folder` of this version of the source. If the
cache cannot be read or written, the code is compiled again, with a warning.
"""

from __future__ import annotations

import atexit
import hashlib
import os
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from multiprocessing import parent_process
from threading import Lock
from typing import Annotated, Any, Literal, TypeAlias, TypeVar, cast

import numpy as np

from lcpimpact.background import start_python
from lcpimpact.cache import folder, keep, reason, usable, variable
from lcpimpact.errors import InputError
from lcpimpact.interpreter import arrays_in, function_of, size_of, throughout
from lcpimpact.logs import LOG, progress_bar

try:
    import llvmlite  # noqa: F401

    WITH_COMPILER = True
except ModuleNotFoundError as error:
    if error.name != "llvmlite":
        raise
    WITH_COMPILER = False

F = TypeVar("F", bound=Callable[..., Any])
T = TypeVar("T")

WHEN_TO_COMPILE = "LCPIMPACT_COMPILE"
"""Environment variable: "later", which is the default, "first", before the first call of each function, or "never"."""

COMPILING = WITH_COMPILER and variable(WHEN_TO_COMPILE) != "never"
"""Whether functions are compiled in this process."""

if not WITH_COMPILER and parent_process() is None:
    LOG.warning(
        "lcpimpact: llvmlite is not installed: all of it runs in the interpreter, with the same results and a tenth to a "
        "thousandth of the speed; `pip install llvmlite` where there is one for this Python"
    )

PATIENCE = 0.2
"""Time that a function may take in the interpreter before it is compiled [s]."""

LONGEST = 1 << 21
"""Maximum count of numbers in the arguments of a call by the interpreter, a microsecond each."""

FEW_ROWS = 1 << 11
"""Maximum count of numbers in the arguments of functions with O(n³) operations on n² numbers."""

NICENESS = 10
"""Niceness of the process beside this one that compiles."""


def as_declared(value: Any, kind: Any) -> Any:
    """Return a result as compiled code does: of the type of numbers that its signature declares."""
    items = getattr(kind, "items", None)
    if items is not None and kind.named is None:
        return tuple(as_declared(each, of) for each, of in zip(value, items, strict=True))
    convert: Any = {"float64": float, "int64": int, "bool": bool}.get(getattr(kind, "name", ""))
    return convert(value) if convert else value


def warning_free(function: F) -> F:
    """Return a function whose arithmetic warns of nothing where the interpreter runs it, as in compiled code."""
    return function if COMPILING else np.errstate(all="ignore")(function)


def in_interpreter(function: Any, arguments: Sequence[Any]) -> Any:
    """Call a compiled function in the interpreter; if that raises an error, its arrays are as before the call."""
    before = [(each, each.copy()) for each in arrays_in(arguments)]
    given = [throughout(each) if hasattr(each, "py_func") else each for each in arguments]
    try:
        with np.errstate(all="ignore"):
            return as_declared(throughout(function)(*given), function.declared.gives)
    except BaseException:
        for each, copied in before:
            each[...] = copied
        raise


def findable(function: Any) -> bool:
    """Return whether another process finds a function by its name, and its code in the cache."""
    python = function.py_func
    found: Any = getattr(sys.modules.get(python.__module__), python.__name__, None)
    return function is found and bool(function.code_file())


class Beside:
    """A process beside this one, which compiles functions into the cache."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        self._asked: set[Any] = set()
        self._lock = Lock()

    def compiles(self, *functions: Any) -> bool:
        """Return whether functions are being compiled, or are yet to be.

        The process takes them first, and then all others that run in the interpreter meanwhile, the longest first.
        """
        if not all(map(findable, functions)) or parent_process() is not None:
            return False
        with self._lock:
            if self._process is None or self._process.poll() is not None:
                if self._asked.issuperset(functions):
                    return False
                used = sorted((each for each in DEFERRED if each.seconds > 0.0), key=lambda each: -each.seconds)
                others = [each for each in used if each not in {*self._asked, *functions} and findable(each)]
                self._asked.update(functions, others)
                gives_way = f"import os; getattr(os, 'nice', int)({NICENESS})"  # there is no nice on Windows
                names = [f"{each.py_func.__module__}:{each.py_func.__name__}" for each in (*functions, *others)]
                try:
                    self._process = start_python(f"{gives_way}; {_compile(names)}")
                except OSError as error:
                    LOG.debug("%s is compiled here, as no process starts: %s", names[0], reason(error))
                    return False
        return True

    def end(self) -> None:
        """End the process."""
        if self._process:
            self._process.kill()


BESIDE = Beside()
atexit.register(BESIDE.end)


def patient() -> bool:
    """Return whether functions without compiled code run in the interpreter at first.

    Raises
    ------
    InputError
        If the environment variable `WHEN_TO_COMPILE` has another value, or "never" since the import only.
    """
    when = os.environ.get(WHEN_TO_COMPILE) or "later"
    if when not in ("later", "first"):
        raise InputError(
            f"the environment variable {WHEN_TO_COMPILE} = {when!r} must be 'later' or 'first', or not set; 'never' is "
            "read when lcpimpact is imported"
        )
    return when == "later"


def waits(function: Any, arguments: Sequence[Any], size: int | None = None, functions: Sequence[F] = ()) -> bool:
    """Return whether a call is left to the interpreter; its size is that of the arguments unless given.

    While there is no compiled code of it, or of the ``functions`` that it is given, short calls run in the interpreter, with
    the same bits; if they take more than `PATIENCE` together, a process beside this one compiles what is missing; workers of
    a pool do so themselves.
    """
    needed = [each for each in (function, *functions) if hasattr(each, "resolve")]
    if all(each.ready for each in needed) or not patient():
        return False
    if any(getattr(each, "most", 1) == 0 for each in (*needed, *arguments)):
        return False
    if (size_of(arguments) if size is None else size) > function.most:
        return False
    files = [(each, each.code_file()) for each in needed if not each.ready]
    missing = [each for each, file in files if not (file and file.exists())]
    return bool(missing) and (function.seconds < PATIENCE or BESIDE.compiles(*missing))


def interpret(function: Any, arguments: Sequence[Any], compiled: Callable[[], Any], instead: F | None = None) -> Any:
    """Call a function in the interpreter, or what is called ``instead``; if that raises an error, compiled code."""
    began = time.perf_counter()
    try:
        return instead(*arguments) if instead else in_interpreter(function, arguments)
    except Exception:  # noqa: BLE001 (such as 1.0/0.0, which is infinite in compiled code)
        LOG.debug("%s is compiled, since the interpreter raised an error", function.py_func.__qualname__, exc_info=True)
        function.resolve()
    finally:
        function.seconds += time.perf_counter() - began
    return compiled()


def or_whole(function: F, whole: F, *arguments: Any, size: int | None = None) -> Any:
    """Call a function, or while there is no compiled code of it what gives the same bits on whole arrays."""
    if not COMPILING:
        return whole(*arguments)
    if waits(function, arguments, size):
        return interpret(function, arguments, lambda: function(*arguments), whole)
    return function(*arguments)


def called_instead(function: Any, arguments: Sequence[Any]) -> Callable[..., Any] | None:
    """Return the function called in place of one without compiled code, or None if that is to be made now."""
    if not waits(function, arguments):
        return None
    return lambda *arguments: interpret(function, arguments, lambda: function(*arguments))


DEFERRED: list[Any] = []
"""All compiled functions of this process."""


def compile_imported() -> None:
    """Compile all functions of the modules imported so far into the cache, but those that other compiled code takes in."""
    for each in reversed(DEFERRED):  # callers first
        if not each.taken_in:
            each.resolve()


def compiled(
    signature: Any = None,
    inline: Literal["never", "always"] = "never",
    most: int = LONGEST,
    vectors: bool = False,
) -> Callable[[F], F]:
    """Compile a function for the types of its annotations when its calls repay that, and cache the result on disk.

    Parameters
    ----------
    signature : FunctionKind, optional
        Argument and return types, if the annotations do not say them; an argument may itself be a compiled function
        (``Callable[[...], ...]``).
    inline : {"never", "always"}
        Whether its code replaces each call, as for functions called in inner loops.
    most : int
        Maximum count of numbers in the arguments of a call that may run in the interpreter; 0 if this bounds no time, as in
        an iteration.
    vectors : bool
        Whether loops over entries that do not depend on each other become operations on vectors.
    """

    def decorate(function: F) -> F:
        if not COMPILING:
            cast(Any, function).py_func = function  # as for a compiled function
            return function
        from lcpimpact.compiler.functions import Function
        from lcpimpact.compiler.kinds import function_kind

        stated = partial(function_kind, function) if signature is None else lambda: signature
        deferred: Any = Function(function, stated, inline == "always")
        deferred.most = most
        deferred.vectors = vectors
        deferred.seconds = 0.0  # taken in the interpreter
        deferred.instead = partial(called_instead, deferred)
        DEFERRED.append(deferred)
        return cast(F, deferred)

    return decorate


def address(function: Any) -> Any:
    """Return the address of a compiled function, for `function_at`; what is not compiled as it is."""
    return function.address if hasattr(function, "resolve") else function


def kind_of(hint: Any) -> Any:
    """Return the type of an annotation in compiled code; the annotation itself if nothing is compiled."""
    if not COMPILING:
        return hint
    from lcpimpact.compiler import kinds

    return kinds.kind_of(hint)


def address_type(kind: Any) -> Any:
    """Return the type of the `address` of a function."""
    return kind_of(int)


ByAddress: TypeAlias = Annotated[F, address_type]
"""A function in a named tuple that compiled code takes, which gets its address there."""


def call_with(
    function: Any, arguments: Sequence[Any], functions: Any, instead: F | None = None
) -> tuple[Callable[..., Any], tuple[Any, ...]]:
    """Return the function to call, compiled or interpreted, and its arguments.

    The last of them is a named tuple of the addresses of other ``functions``. What is called ``instead`` of the interpreted
    function is counted as its time.
    """

    def addressed() -> tuple[Any, ...]:
        return (*arguments, functions._make(map(address, functions)))

    if COMPILING and waits(function, arguments, 1, functions):
        given = (*arguments, functions._make(map(throughout, functions)))
        return partial(interpret, function, given, lambda: function(*addressed()), instead), ()
    if COMPILING:
        function.resolve()  # the interpreter cannot call an address
    return function, addressed()


def as_it_is(function: T) -> T:
    """Return the function itself."""
    return function


def function_at(hint: Any) -> Callable[[Any], Any]:
    """Return the function by which compiled code gets a function of a type from its `address`."""
    if not COMPILING:
        return as_it_is
    from lcpimpact.compiler.writer import FunctionAt

    return FunctionAt(kind_of(hint))


def compiled_text(text: str, hint: Any, names: Mapping[str, Any], vectors: bool = False) -> Any:
    """Return the function of a generated source, to be compiled before it is called.

    Parameters
    ----------
    text : str              the source of one function
    hint : annotation       its type, as ``Callable[[...], ...]``
    names : mapping         the global names of the source
    vectors : bool          whether its loops are to become operations on vectors
    """
    function = function_of(text, names)
    function.text = text
    return compiled(kind_of(hint), most=0, vectors=vectors)(function)


def compile_ahead(*parts: Sequence[str]) -> None:
    """Compile functions into the cache, once for each version of the source, each part in its own process.

    Parameters
    ----------
    *parts
        Names of functions, "module:function", or of modules with all their functions that no other compiled code calls; a
        part should import little that another part compiles.
    """
    done = folder() / hashlib.sha256(repr(parts).encode()).hexdigest()[:16]
    if not COMPILING or not usable() or done.exists():
        return
    running: list[subprocess.Popen[bytes]] = []
    try:
        running.extend(start_python(_compile(part)) for part in parts)
        if not any(map(_watched, running)):
            keep(done, b"")
    except OSError as error:
        LOG.debug("functions are compiled at their first calls, as no process starts: %s", reason(error))
    finally:
        for process in running:
            process.kill()


def _watched(process: subprocess.Popen[bytes]) -> int:
    """Wait for a process that compiles, and show how many functions are in the cache; return its exit code."""
    with progress_bar(True, desc="compiling", bar_format="{desc:<17}{n_fmt} functions {elapsed}", leave=False) as bar:
        while True:
            try:
                return process.wait(timeout=1.0)
            except subprocess.TimeoutExpired:
                bar.update(len([*folder().rglob("*.o")]) - bar.n)


def _compile(names: Sequence[str]) -> str:
    """Return the statements that compile the functions named, and then all functions of the modules named."""
    named = [each.split(":") for each in names if ":" in each]
    modules = [f"import {each}" for each in names if ":" not in each]
    statements = [f"from {module} import {function}; {function}.resolve()" for module, function in named]
    if modules:
        statements += [*modules, "from lcpimpact.compiled import compile_imported; compile_imported()"]
    return "; ".join(statements)
