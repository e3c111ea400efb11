"""Names of numba beyond its public ones that lcpimpact takes, each of which may change in any release.

Where one is missing, the import of this module fails, and `lcpimpact.compiled` takes `lcpimpact.numba_public` in its place.
"""

from __future__ import annotations

import hashlib
import pickle
import sys
import time
from collections.abc import Callable, Hashable
from functools import cached_property
from pathlib import Path
from typing import Any, cast

import numba
from llvmlite import binding
from numba import types
from numba.core import cgutils
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompileResult, Flags, _make_subtarget, compile_extra, compile_result
from numba.core.compiler_lock import global_compiler_lock
from numba.core.registry import CPUDispatcher
from numba.core.serialize import dumps
from numba.core.typing.templates import make_concrete_template
from numba.extending import intrinsic

from lcpimpact.cache import GENERATED, code_file, keep_code, kept_code, reason, source_hash, warn_once
from lcpimpact.logs import LOG

for owner, names in (
    (CPUDispatcher, "_compile_for_args get_call_template get_compile_result get_overload disable_compile"),
    (CompileResult, "_reduce _rebuild _find_referenced_environments"),
    (JITCodeLibrary, "_get_module_for_linking _finalize_dynamic_globals"),
):
    for each in names.split():
        getattr(owner, each)  # AttributeError where numba has lost it

BY_ADDRESS = True
"""Functions are passed on by their addresses: numba looks for that of a function itself at each call."""

WHOLE, PART = "whole", "part"
"""Forms of compiled code: whole, for calls from Python or by its address, and as part of the code of its callers."""


class Part(JITCodeLibrary):
    """Code that is optimised and made machine code in that of its callers, and not by itself."""

    serialize_using_object_code = JITCodeLibrary.serialize_using_bitcode

    def finalize(self) -> None:
        """Take in the code of what is called (for numba)."""
        for library in dict.fromkeys(self._linking_libraries):
            getattr(self, "_reload_init", set()).update(getattr(library, "_reload_init", ()))  # not in numba 0.61
            self._final_module.link_in(library._get_module_for_linking(), preserve=True)
        self._finalize_dynamic_globals()
        self._finalized = True


def rebuilt(context: Any, form: str, kept: bytes) -> Any:
    """Return compiled code as `CompileResult._reduce` kept it, with the constants of its environment."""
    state, constants = pickle.loads(kept)
    known = state[2].consts  # the environment of the part, if that is here: the whole has more constants
    known += constants[len(known) :]
    if form != PART:
        return CompileResult._rebuild(context, *state)
    found = dict(zip(("library", "fndesc", "environment", "signature"), state, strict=False))
    library = Part(context.codegen(), found["library"][0])
    library._final_module = binding.parse_bitcode(found["library"][-1])
    library._finalized = True
    return compile_result(**found | {"library": library})


class Function(CPUDispatcher):
    """A function with one declared signature, which is compiled when it is called, or the code of another needs it."""

    stated: Any = None  # stated() -> its signature
    declared = cached_property(lambda self: self.stated())
    forms: dict[str, Any]
    ready = False
    instead: Any = None  # instead(arguments) -> what is called in place of a function that is not ready, or None

    @property
    def taken_in(self) -> bool:
        """Whether other compiled code of this process has taken it in, or any that calls it does."""
        return PART in self.forms or self.targetoptions["inline"] == "always"

    @cached_property
    def code_name(self) -> str:
        """Name of the function, with a hash of what its code depends on."""
        function = self.py_func
        target = cast(Any, self.targetctx).codegen()
        code = self.py_func.__code__
        known = numba.__version__, sys.version_info[:2], target.magic_tuple(), source_hash(code.co_filename)
        place = function.__module__, function.__qualname__, code.co_firstlineno, str(self.declared)
        cells = dumps([each.cell_contents for each in function.__closure__ or ()])
        digest = hashlib.sha256(repr((known, place, code.co_code, cells)).encode()).hexdigest()
        return f"{function.__name__.strip('<>')[:40]}-{digest[:32]}"

    def code_file(self, form: str = WHOLE) -> Path | None:
        """Return the file of its compiled code, if it can have one."""
        source = self.py_func.__code__.co_filename
        place = "generated/" if source in GENERATED else ""
        return code_file(f"{place}{self.code_name}-{form}.nbc") if source_hash(source) else None

    def code(self, form: str) -> Any:
        """Return its compiled code in a form, with its library and signature; it is read or compiled."""
        with global_compiler_lock:
            if form not in self.forms:
                path = self.code_file(form)
                self.forms[form] = found = (path and self._read(path, form)) or self._compile(path, form)
                if form == PART:
                    self.targetctx.insert_user_function(found.library, found.fndesc, [found.library])
            return self.forms[form]

    def _read(self, path: Path, form: str) -> Any:
        """Return the code of a file, or None."""
        self.targetctx.refresh()
        try:
            found = rebuilt(self.targetctx, form, kept_code(path))
            cast(Any, self)._cache_hits[form] += 1
            return found
        except FileNotFoundError:
            return None
        except Exception as error:  # noqa: BLE001 (whatever was read is made anew)
            warn_once(f"cannot be read ({reason(error)}) and is compiled again")
            return None

    def _compile(self, path: Path | None, form: str) -> Any:
        """Make the code of a form, and keep it unless it holds addresses of this process."""
        began = time.perf_counter()
        found = self._part() if form == PART else self._whole(self.code(PART))
        if path and not found.library.has_dynamic_globals:
            keep_code(path, dumps((found._reduce(), list(found.environment.consts))))
        name = self.py_func.__qualname__ + (", a part," if form == PART else "")
        LOG.debug("compiled %s in %.2f s", name, time.perf_counter() - began)
        return found

    def _flags(self) -> Any:
        """Return the flags of a compilation without what calls from Python or by its address need."""
        flags: Any = Flags()
        self.targetdescr.options.parse_as_flags(flags, self.targetoptions)
        flags.no_cpython_wrapper = flags.no_cfunc_wrapper = flags.no_compile = True
        return flags

    def _part(self) -> Any:
        """Compile the function."""
        library = Part(cast(Any, self.targetctx).codegen(), self.py_func.__qualname__)
        takes, gives = self.declared.args, self.declared.return_type
        no_locals: dict[str, str] = {}
        return compile_extra(
            self.typingctx, self.targetctx, self.py_func, takes, gives, self._flags(), no_locals, library
        )

    def _whole(self, part: Any) -> Any:
        """Make machine code of a part, with what calls from Python and by its address need."""
        context: Any = _make_subtarget(self.targetctx, self._flags())
        library = context.codegen().create_library(self.py_func.__qualname__)
        library.enable_object_caching()
        library.add_linking_library(part.library)
        same = {"fndesc": part.fndesc, "environment": part.environment, "signature": part.signature}
        described = part.fndesc, part.environment
        context.create_cpython_wrapper(library, *described, None, release_gil=True)
        context.create_cfunc_wrapper(library, *described, None)
        entry = context.get_executable(library, *described)
        found = compile_result(library=library, entry_point=entry, objectmode=False, lifted=(), reload_init=[], **same)
        for each in found._find_referenced_environments():
            library.codegen.set_env(each.env_name, each)
        return found

    def resolve(self) -> None:
        """Compile the function for calls from Python, or read the compiled code."""
        with global_compiler_lock:
            if self.stated is not None and not self.ready:
                self.add_overload(self.code(WHOLE))
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
        parameters, args = cast(Any, self)._compiler.fold_argument_types(args, kws)
        name = self.py_func.__name__
        return make_concrete_template(name, name, [self.code(PART).signature]), parameters, args, {}

    def get_overload(self, sig: Hashable) -> Any:
        """Return the key of the code that compiled code calls (for numba)."""
        return self.code(PART).library

    def get_compile_result(self, sig: Hashable) -> Any:
        """Return the compiled code for calls by its address (for numba)."""
        return self.code(WHOLE)


def function_of(python: Any, stated: Callable[[], Any], inline: str, allocates: bool) -> Function:
    """Return a function that is not compiled yet; if it allocates nothing, references are not counted."""
    options = {"nopython": True, "error_model": "numpy", "inline": inline, "_nrt": allocates, "nogil": True}
    found = Function(python, targetoptions=options)
    found.stated = stated
    found.forms = {}
    return found


def address(function: Function, kind: Any) -> int:
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
