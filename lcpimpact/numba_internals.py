"""Names of numba beyond its public ones that lcpimpact takes, each of which may change in any release.

Where one is missing, the import of this module fails, and `lcpimpact.compiled` takes `lcpimpact.numba_public` in its place.
"""

from __future__ import annotations

import hashlib
import pickle
import sys
import time
from collections.abc import Callable
from functools import cached_property
from pathlib import Path
from typing import Any, cast

import numba
from numba import types
from numba.core import cgutils
from numba.core.caching import NullCache
from numba.core.compiler import CompileResult
from numba.core.compiler_lock import global_compiler_lock
from numba.core.registry import CPUDispatcher
from numba.core.serialize import dumps
from numba.extending import intrinsic

from lcpimpact.cache import code_file, keep, reason, source_hash, warn_once
from lcpimpact.logs import LOG

for each in ("_compile_for_args", "get_call_template", "get_compile_result", "disable_compile", "is_compiling"):
    getattr(CPUDispatcher, each)  # AttributeError where numba has lost it
_ = CompileResult._reduce, CompileResult._rebuild, NullCache.load_overload, NullCache.save_overload

BY_ADDRESS = True
"""Functions are passed on by their addresses: numba looks for that of a function itself at each call."""


class CodeFile(NullCache):
    """The file of one function's compiled code; it begins with a hash, so that a damaged or wrong one is never run."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the compiled code, or None."""
        target_context.refresh()
        try:
            content = self.path.read_bytes()
            if content[:32] != self._hash(code := content[32:]):
                raise ValueError(f"{self.path.name} is damaged")
            return CompileResult._rebuild(target_context, *pickle.loads(code))
        except FileNotFoundError:
            return None
        except Exception as error:  # noqa: BLE001 (whatever was read is made anew)
            warn_once(f"cannot be read ({reason(error)}) and is compiled again")
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Save compiled code, unless it holds addresses of this process."""
        if not data.library.has_dynamic_globals:
            code = dumps(data._reduce())
            keep(self.path, self._hash(code) + code)

    def _hash(self, code: bytes) -> bytes:
        return hashlib.sha256(self.path.name.encode() + code).digest()


class Function(CPUDispatcher):
    """A function with one declared signature, which is compiled when its calls or another compiled function need that."""

    stated: Any = None  # stated() -> its signature
    declared = cached_property(lambda self: self.stated())
    ready = False
    instead: Any = None  # instead(arguments) -> what is called in place of a function that is not ready, or None

    @cached_property
    def code_name(self) -> str:
        """Name of the file of its compiled code: a hash of what the code depends on."""
        function = self.py_func
        target = cast(Any, self.targetctx).codegen()
        code = self.py_func.__code__
        known = numba.__version__, sys.version_info[:2], target.magic_tuple(), source_hash(code.co_filename)
        place = function.__module__, function.__qualname__, code.co_firstlineno, str(self.declared)
        cells = dumps([each.cell_contents for each in function.__closure__ or ()])
        digest = hashlib.sha256(repr((known, place, code.co_code, cells)).encode()).hexdigest()
        return f"{function.__name__.strip('<>')[:40]}-{digest[:32]}.nbc"

    def code_file(self) -> Path | None:
        """Return the file of its compiled code, if it can have one."""
        return code_file(self.code_name) if source_hash(self.py_func.__code__.co_filename) else None

    def resolve(self) -> None:
        """Compile the function for its signature, or read the compiled code."""
        with global_compiler_lock:
            if self.stated is None or self.ready or self.is_compiling:
                return
            if path := self.code_file():
                self._cache: Any = CodeFile(path)
            began = time.perf_counter()
            self.compile(self.declared)
            if not self.stats.cache_hits:
                LOG.debug("compiled %s in %.2f s", self.py_func.__qualname__, time.perf_counter() - began)
            self.disable_compile()
            self.ready = True

    def _compile_for_args(self, *arguments: Any, **named: Any) -> Any:
        """Return the function that is called where there is no compiled code (for numba)."""
        if self.instead and (called := self.instead(arguments)):
            return called
        self.resolve()
        return self

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """Return the template of a call by compiled code (for numba)."""
        self.resolve()
        return super().get_call_template(args, kws)

    def get_compile_result(self, sig: Any) -> Any:
        """Return the compiled code for a signature (for numba)."""
        self.resolve()
        return super().get_compile_result(sig)


def function_of(python: Any, stated: Callable[[], Any], inline: str, allocates: bool) -> Function:
    """Return a function that is not compiled yet; if it allocates nothing, references are not counted."""
    options = {"nopython": True, "error_model": "numpy", "inline": inline, "_nrt": allocates, "nogil": True}
    found = Function(python, targetoptions=options)
    found.stated = stated
    return found


def address(function: Any, kind: Any) -> int:
    """Return the address of a compiled function of a FunctionType."""
    code = function.get_compile_result(kind.signature)
    return int(code.library.get_pointer_to_function(code.fndesc.llvm_cfunc_wrapper_name))


def function_at(kind: Any) -> Any:
    """Return the function by which compiled code gets a function of a FunctionType from its `address`."""

    def read(context: Any, address: Any) -> Any:
        def code(context: Any, builder: Any, _: Any, arguments: Any) -> Any:
            found = cgutils.create_struct_proxy(kind)(context, builder)
            found.c_addr = builder.inttoptr(arguments[0], context.get_value_type(types.voidptr))
            return found._getvalue()

        return kind(types.int64), code

    return intrinsic(read)
