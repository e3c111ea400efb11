"""Compilation: hot loops are plain Python functions, compiled for given types when they are first called.

With the environment variable ``NUMBA_DISABLE_JIT=1`` the same code runs in the interpreter, with bitwise equal results
(no fast-math, no reordering). Compiled code is cached on disk in the `folder` of this version of the source. If the cache
cannot be read or written, the code is compiled again, with a warning.
"""

from __future__ import annotations

import atexit
import hashlib
import os
import pickle
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from importlib.abc import Loader
from importlib.machinery import ModuleSpec
from importlib.util import module_from_spec, spec_from_file_location
from multiprocessing import parent_process
from pathlib import Path
from threading import Lock
from typing import Any, Literal, TypeVar, cast

import numba
import numpy as np
from numba import types
from numba.core import cgutils, event
from numba.core.caching import CompileResultCacheImpl, FunctionCache, IndexDataCacheFile, _CacheLocator
from numba.core.compiler_lock import global_compiler_lock
from numba.core.registry import CPUDispatcher
from numba.extending import intrinsic

from lcpimpact.cache import folder, mark_used
from lcpimpact.errors import InputError
from lcpimpact.interpreter import arrays_in, size_of, throughout
from lcpimpact.logs import LOG, progress_bar

F = TypeVar("F", bound=Callable[..., Any])

f8 = types.float64
i8 = types.int64
vector = types.float64[::1]
matrix = types.float64[:, ::1]
flags = types.boolean[::1]
cube = types.float64[:, :, ::1]
indices = types.int64[::1]
places = types.uint64[::1]
"""Unsigned indices, for which compiled code need not check for a count from the end."""
named_tuple: Any = types.BaseTuple.from_types
"""named_tuple(types, NamedTuple): the numba type of a NamedTuple."""


CONFIG: Any = numba.config

COMPILING = not CONFIG.DISABLE_JIT
"""Whether functions are compiled in this process."""

WHEN_TO_COMPILE = "LCPIMPACT_COMPILE"
"""Environment variable: "later", which is the default, or "first", before the first call of each function."""

PATIENCE = 0.5
"""Time that a function may take in the interpreter before it is compiled [s]."""

LONGEST = 1 << 21
"""Maximum count of numbers in the arguments of a call by the interpreter, a microsecond each."""

FEW_ROWS = 1 << 11
"""That of a function that takes n³ operations for n² numbers, or more."""

NICENESS = 10
"""By which a process that compiles beside this one gives way to others."""

DIGEST = 32
"""Bytes of a SHA-256."""


class Locator(_CacheLocator):
    """Location of one function's compiled code, in the `folder` of this source."""

    def __init__(self, file: str, line: int) -> None:
        self._path = str(folder() / self.get_suitable_cache_subpath(file))
        self._file, self._line = file, line

    @classmethod
    def from_function(cls, py_func: Any, py_file: str) -> Locator:
        """Return the location for a function of a file."""
        return cls(py_file, py_func.__code__.co_firstlineno)

    def get_cache_path(self) -> str:
        """Return the folder of the function's files."""
        return self._path

    def get_source_stamp(self) -> str:
        """Return a hash of the function's file, which may belong to another package."""
        return file_hash(self._file)

    def get_disambiguator(self) -> str:
        """Return a string that distinguishes functions of the same name in one file."""
        return str(self._line)


class Place(CompileResultCacheImpl):
    """Serialisation of compiled code by numba, with our own location."""

    _locator_classes = [Locator]  # noqa: RUF012 (as in numba)


class CheckedFiles(IndexDataCacheFile):
    """Files of compiled code that begin with a hash, so that a damaged or wrong one is never run."""

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
    """numba's cache of one function, robust against damaged files.

    If a file cannot be read, the function is compiled and saved again; if it cannot be saved, it is used without a cache.
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
        except Exception as error:  # noqa: BLE001 (a damaged file may raise anything)
            self._damaged = True
            warn_once(f"cannot be read ({reason(error)}) and is compiled again")
            return None

    @property
    def filled(self) -> bool:
        """Whether there is compiled code in the cache."""
        return Path(self._cache_file._data_path(self._cache_file._data_name(1))).exists()

    def save_overload(self, sig: Any, data: Any) -> None:
        """Save compiled code, replacing a damaged file."""
        try:
            if self._damaged:
                self.flush()
            super().save_overload(sig, data)
        except Exception as error:  # noqa: BLE001 (the code is compiled, only not saved)
            warn_once(f"cannot be saved ({reason(error)}) and is compiled again in each run")


@cache
def file_hash(file: str) -> str:
    """Return the hash of a source file."""
    return hashlib.sha256(Path(file).read_bytes()).hexdigest()


def reason(error: Exception) -> str:
    """Return the reason of an error in few words."""
    return (error.strerror if isinstance(error, OSError) else None) or str(error) or type(error).__name__


warned: list[str] = []
"""Warnings about the cache in this process."""


def warn_once(what: str) -> None:
    """Warn about the cache, once in a program: not for each function, and not in each worker."""
    if not warned and parent_process() is None:
        LOG.warning(
            "lcpimpact: the compiled code in %s %s; `lcpimpact cache --clear` empties the folder, and the environment "
            "variable NUMBA_CACHE_DIR names another",
            folder(),
            what,
        )
    warned.append(what)


class _Compilations(event.Listener):
    """Logs each function that is compiled, with its time; code from the cache is not compiled."""

    def __init__(self) -> None:
        self._started: list[float] = []

    def on_start(self, event: Any) -> None:
        self._started.append(time.perf_counter())

    def on_end(self, event: Any) -> None:
        name = event.data["dispatcher"].py_func.__qualname__
        LOG.debug("compiled %s in %.2f s", name, time.perf_counter() - self._started.pop())


@cache
def log_compilation() -> None:
    """Log each compiled function at the level DEBUG from now on."""
    event.register("numba:compile", _Compilations())


@cache
def usable() -> bool:
    """Return whether there is a folder for compiled code, and mark it as used."""
    try:
        mark_used()
    except OSError as error:
        warn_once(f"has no folder ({reason(error)}) and is compiled again in each run")
        return False
    return True


def as_declared(value: Any, kind: Any) -> Any:
    """Return a result as compiled code does: of the type of numbers that its signature declares."""
    kinds: Any = kind
    if isinstance(kind, types.BaseTuple) and not hasattr(kind, "instance_class"):
        return tuple(as_declared(each, of) for each, of in zip(value, kinds, strict=True))
    convert: Any = {types.float64: float, types.int64: int, types.boolean: bool}.get(kind)
    return convert(value) if convert else value


def warning_free(function: F) -> F:
    """Return a function whose arithmetic warns of nothing where the interpreter runs it, as in compiled code."""
    return function if COMPILING else np.errstate(all="ignore")(function)


def interpret(function: Any, signature: Any, arguments: Sequence[Any]) -> Any:
    """Call a compiled function in the interpreter; if that raises an error, its arrays are as before the call."""
    before = [(each, each.copy()) for each in arrays_in(arguments)]
    given = [throughout(each) if hasattr(each, "py_func") else each for each in arguments]
    try:
        with np.errstate(all="ignore"):
            return as_declared(throughout(function)(*given), signature.return_type)
    except BaseException:
        for each, copied in before:
            each[...] = copied
        raise


class Beside:
    """A process beside this one, which compiles functions into the cache."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        self._asked: set[Deferred] = set()
        self._lock = Lock()

    def compiles(self, function: Deferred) -> bool:
        """Return whether a function is being compiled, or is yet to be; the process takes one after the other."""
        name, module = function.py_func.__name__, function.py_func.__module__
        imported = getattr(sys.modules.get(module), name, None) is function
        if not imported or function.cached_code() is None or parent_process() is not None:
            return False
        with self._lock:
            if self._process is None or self._process.poll() is not None:
                if function in self._asked:
                    return False
                self._asked.add(function)
                gives_way = f"import os; getattr(os, 'nice', int)({NICENESS})"  # there is no nice on Windows
                self._process = start_python(f"{gives_way}; {_compile(f'{module}:{name}')}")
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
        If the environment variable `WHEN_TO_COMPILE` has another value than "later" and "first".
    """
    when = os.environ.get(WHEN_TO_COMPILE) or "later"
    if when not in ("later", "first"):
        raise InputError(
            f"the environment variable {WHEN_TO_COMPILE} = {when!r} must be 'later' or 'first', or not set"
        )
    return when == "later"


class Deferred(CPUDispatcher):
    """A function that is compiled, or read from the cache, when its calls or another compiled function need that.

    While there is no compiled code, short calls run in the interpreter, with the same bits; if they take more than
    `PATIENCE` together, a process beside this one compiles the function; workers of a pool do so themselves. A call in which
    the interpreter raises an error is repeated by compiled code.
    """

    _cache: Any

    declared: Any = None
    """Its signature."""

    ready = False
    """Whether the compiled code is in memory."""

    most = LONGEST
    """Maximum count of numbers in the arguments of a call by the interpreter."""

    seconds = 0.0
    """Time taken in the interpreter [s]."""

    def resolve(self) -> None:
        """Compile the function for its signature, or read the compiled code."""
        with global_compiler_lock:
            if self.declared is None or self.ready or self.is_compiling:
                return
            self._cache = self.cached_code() or self._cache
            self.compile(self.declared)
            self.disable_compile()
            self.ready = True

    def cached_code(self) -> CheckedCache | None:
        """Return the cache of its compiled code, if it can have one."""
        return CheckedCache(self.py_func) if usable() and Path(self.py_func.__code__.co_filename).exists() else None

    def waits(self, arguments: Sequence[Any], size: int | None = None) -> bool:
        """Return whether a call is left to the interpreter; its size is that of the arguments unless given."""
        if self.ready or not patient() or any(getattr(each, "most", 1) == 0 for each in (self, *arguments)):
            return False
        if (size_of(arguments) if size is None else size) > self.most:
            return False
        found = self.cached_code()
        return not (found and found.filled) and (self.seconds < PATIENCE or BESIDE.compiles(self))

    def interpret(self, arguments: Sequence[Any], compiled: Callable[[], Any]) -> Any:
        """Call the function in the interpreter, or, if that raises an error, by the compiled code that is given."""
        began = time.perf_counter()
        try:
            return interpret(self, self.declared, arguments)
        except Exception:  # noqa: BLE001 (such as 1.0/0.0, which is infinite in compiled code)
            LOG.debug("%s is compiled, since the interpreter raised an error", self.py_func.__qualname__, exc_info=True)
            self.resolve()
        finally:
            self.seconds += time.perf_counter() - began
        return compiled()

    def _compile_for_args(self, *arguments: Any, **named: Any) -> Any:
        """Return what is called in place of a function without compiled code (for numba)."""
        if self.waits(arguments):
            return lambda *arguments: self.interpret(arguments, lambda: self(*arguments))
        self.resolve()
        return self

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """Return what compiled code calls (for numba)."""
        self.resolve()
        return super().get_call_template(args, kws)

    def get_compile_result(self, sig: Any) -> Any:
        """Return the compiled code for a signature (for numba)."""
        self.resolve()
        return super().get_compile_result(sig)


DEFERRED: list[Deferred] = []
"""All compiled functions of this process."""


def compile_imported() -> None:
    """Compile all functions of the modules imported so far into the cache."""
    for each in DEFERRED:
        each.resolve()


def compiled(
    signature: Any, inline: Literal["never", "always"] = "never", allocates: bool = True, most: int = LONGEST
) -> Callable[[F], F]:
    """Compile a function for one signature when its calls repay that, and cache the result on disk.

    Parameters
    ----------
    signature : numba signature
        Argument and return types; an argument may itself be a compiled function (``types.FunctionType``), which,
        unlike an inferred one, does not defeat the cache.
    inline : {"never", "always"}
        Whether its code replaces each call, as for functions called in inner loops.
    allocates : bool
        Whether it allocates arrays. Otherwise reference counting is switched off, which costs more than the arithmetic of a
        few rows.
    most : int
        Maximum count of numbers in the arguments of a call that may run in the interpreter; 0 if this bounds no time, as in
        an iteration.
    """

    def decorate(function: F) -> F:
        if not COMPILING:
            cast(Any, function).py_func = function  # as for a compiled function
            return function
        options = {"nopython": True, "error_model": "numpy", "inline": inline, "_nrt": allocates, "nogil": True}
        deferred: Any = Deferred(function, targetoptions=options)
        deferred.declared, deferred.most = signature, most
        DEFERRED.append(deferred)
        return cast(F, deferred)

    return decorate


def as_it_is(function: Any) -> Any:
    """Return the function itself."""
    return function


@cache
def address(function: Any, kind: Any) -> Any:
    """Return the address of a compiled function of a FunctionType, for `function_at`; what is not compiled as it is."""
    if not hasattr(function, "get_compile_result"):
        return function
    code = function.get_compile_result(kind.signature)
    return int(code.library.get_pointer_to_function(code.fndesc.llvm_cfunc_wrapper_name))


def call_with(function: Any, arguments: Sequence[Any], functions: Any, kinds: Sequence[Any]) -> Any:
    """Call a function whose last argument is a named tuple of addresses of other functions, given with their types."""

    def compiled() -> Any:
        return function(*arguments, functions._make(map(address, functions, kinds)))

    if COMPILING and function.waits((*arguments, *functions), size=1):
        return function.interpret((*arguments, functions._make(map(throughout, functions))), compiled)
    return compiled()


def function_at(kind: Any) -> Callable[[Any], Any]:
    """Return what compiled code calls to get a function of a FunctionType from its `address`.

    A function as an argument of another costs more than a short run: numba looks for its address at each call.
    """
    if not COMPILING:
        return as_it_is

    def read(context: Any, address: Any) -> Any:
        def code(context: Any, builder: Any, _: Any, arguments: Any) -> Any:
            found = cgutils.create_struct_proxy(kind)(context, builder)
            found.c_addr = builder.inttoptr(arguments[0], context.get_value_type(types.voidptr))
            return found._getvalue()

        return kind(types.int64), code

    found: Any = intrinsic(read)
    found.py_func = as_it_is
    return cast(Callable[[Any], Any], found)


def source_file(text: str) -> Path:
    """Return the file in the cache in which a generated source is saved, once it is compiled."""
    return folder() / "generated" / f"{hashlib.sha256(text.encode()).hexdigest()[:16]}.py"


def compiled_text(text: str, name: str, signature: Any, names: Mapping[str, Any]) -> Callable[..., Any] | None:
    """Compile a function from its source, which is saved with the compiled code; None if there is no place for it.

    Parameters
    ----------
    text, name : str
        The source, and the function in it, which allocates no arrays.
    signature : numba signature
    names : mapping
        The global names of the source.
    """
    if not usable():
        return None
    file = source_file(text)
    try:
        if not file.exists():
            file.parent.mkdir(parents=True, exist_ok=True)
            part = file.with_suffix(f".{os.getpid()}")
            part.write_text(text, encoding="utf-8")
            part.replace(file)
        spec = cast(ModuleSpec, spec_from_file_location(__name__, file))
        module = module_from_spec(spec)
        vars(module).update(names)
        cast(Loader, spec.loader).exec_module(module)
    except OSError as error:
        warn_once(f"cannot be written ({reason(error)}) and is compiled again in each run")
        return None
    return compiled(signature, allocates=False, most=0)(cast(Callable[..., Any], vars(module)[name]))


def start_python(code: str) -> subprocess.Popen[bytes]:
    """Start a process that runs code, with the path of this one: with its own it would import what lies in the folder."""
    path = f"import sys; sys.path[:] = {sys.path!r}"
    return subprocess.Popen([sys.executable, "-c", f"{path}; {code}"], stderr=subprocess.DEVNULL)


def compile_ahead(*parts: Sequence[str]) -> None:
    """Compile functions into the cache, once for each version of the source, each part in its own process.

    Parameters
    ----------
    *parts
        Names of functions, "module:function", or of modules with all their functions, in the order of their imports; a part
        should import little that another part compiles.
    """
    done = folder() / hashlib.sha256(repr(parts).encode()).hexdigest()[:16]
    if not COMPILING or not usable() or done.exists():
        return
    running = [start_python("; ".join(map(_compile, part))) for part in parts]
    try:
        if not any(map(_watched, running)):
            done.touch()
    except OSError as error:
        warn_once(f"cannot be written ({reason(error)}) and is compiled again in each run")
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
                bar.update(sum(1 for _ in folder().rglob("*.nbi")) - bar.n)


def _compile(name: str) -> str:
    """Return the statements that compile a function, or all functions of the modules that are then imported."""
    module, _, function = name.partition(":")
    if function:
        return f"from {module} import {function}; {function}.resolve()"
    return f"import {module}; from lcpimpact.compiled import compile_imported; compile_imported()"
