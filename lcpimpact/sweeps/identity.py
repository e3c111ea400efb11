"""Identity of the job of a sweep: digests of contents, the same in every process, interpreted or compiled."""

from __future__ import annotations

import dis
import functools
import hashlib
import struct
import sys
import sysconfig
import types
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from typing import Any

import numpy as np

from lcpimpact.errors import InputError

PACKAGE = __name__.partition(".")[0]

INSTALLED = tuple(sysconfig.get_paths()[name] for name in ("stdlib", "platstdlib", "purelib", "platlib"))
"""Folders of code that is known by its name and version."""

NO_CONTENT = frozenset({
    "__dict__", "__weakref__", "__module__", "__doc__", "__annotations__", "__dataclass_fields__", "__dataclass_params__",
    "__match_args__", "__abstractmethods__", "_abc_impl", "__parameters__", "__orig_bases__", "__firstlineno__",
    "__static_attributes__", "__slotnames__", "__annotate_func__", "__annotations_cache__",
})  # fmt: skip
"""Attributes of a class that do not change its behaviour."""

SCALARS = (type(None), bool, int, complex, str, bytes, types.EllipsisType, types.NotImplementedType)

BUILT_IN = (types.BuiltinFunctionType, types.MethodWrapperType)

DESCRIPTORS = (
    types.MethodDescriptorType, types.WrapperDescriptorType, types.GetSetDescriptorType, types.MemberDescriptorType,
    types.ClassMethodDescriptorType,
)  # fmt: skip


def digest(value: Any, what: str) -> str:
    """Return a digest of the content of a value: numbers, arrays, functions, objects, and all that these refer to.

    A function is its code, defaults, closure, attributes, and the globals that it names; an object its class and its
    attributes. Code of lcpimpact, of Python and of installed packages is known by its name and version. A compiled function
    is the function that it was compiled from.

    Parameters
    ----------
    value : object
    what : str
        How the message calls it.

    Raises
    ------
    InputError
        Naming what has no content that can be read, as a generator or an open file.
    """
    try:
        return _Reader().read(value).hex()[:16]
    except (_UnreadableError, RecursionError) as error:
        reason = "it is nested too deeply" if isinstance(error, RecursionError) else error
        raise InputError(
            f"{what} cannot be told from another one: {reason}; leave out= away, or write it as "
            "a function or an object whose attributes are numbers and arrays"
        ) from None


class _UnreadableError(Exception):
    """Something has no content that can be read."""


class _Reader:
    """Digests of values, each of which is read once."""

    def __init__(self) -> None:
        self._known: dict[int, tuple[Any, bytes]] = {}
        self._open: list[int] = []

    def read(self, value: Any) -> bytes:
        """Return the digest of a value."""
        if type(value) in SCALARS:
            return _hash(type(value).__name__, repr(value).encode(errors="surrogatepass"))
        if type(value) is float:
            return _hash("float", struct.pack("<d", value))
        key = id(value)
        if key in self._known:
            return self._known[key][1]
        if key in self._open:  # a circle
            return _hash("again", str(len(self._open) - self._open.index(key)).encode())
        self._open.append(key)
        try:
            found = _hash(type(value).__name__, *self._parts(value))
        finally:
            self._open.pop()
        self._known[key] = (value, found)  # the value is kept, so that its id is not given again
        return found

    def _all(self, values: Iterable[Any]) -> Iterator[bytes]:
        return map(self.read, values)

    def _parts(self, value: Any) -> Iterator[bytes]:
        """Yield the parts of the content of a value."""
        if isinstance(value, Enum):
            yield from self._all((type(value), value.name))
        elif isinstance(value, np.ndarray):
            yield from self._all((type(value), value.dtype.str, value.shape))
            yield from self._all(value.ravel().tolist()) if value.dtype.hasobject else (value.tobytes(),)
        elif type(value) in (tuple, list):
            yield from self._all(value)
        elif type(value) in (dict, types.MappingProxyType):
            yield from self._all(part for item in value.items() for part in item)
        elif type(value) in (set, frozenset):
            yield from sorted(self._all(value))
        elif isinstance(value, types.CodeType):
            yield from self._code(value)
        elif isinstance(value, types.FunctionType):
            yield from self._function(value)
        elif isinstance(value, types.MethodType):
            yield from self._all((value.__func__, value.__self__))
        elif isinstance(value, BUILT_IN):
            yield from self._built_in(value)
        elif isinstance(value, DESCRIPTORS):
            yield from self._all((value.__objclass__, value.__name__))
        elif isinstance(value, types.ModuleType):
            yield from self._all((value.__name__, str(getattr(value, "__version__", ""))))
        elif isinstance(value, type):
            yield from self._class(value)
        elif isinstance(value, (staticmethod, classmethod)):
            yield self.read(value.__func__)
        elif isinstance(value, property):
            yield from self._all((value.fget, value.fset, value.fdel))
        elif isinstance(value, functools.cached_property):
            yield self.read(value.func)
        elif isinstance(value, types.CellType):
            yield from self._all((value.cell_contents,) if _is_filled(value) else ())
        elif (inner := _compiled_from(value)) is not None:
            yield self.read(inner)
        else:
            yield from self._object(value)

    def _code(self, code: types.CodeType) -> Iterator[bytes]:
        yield code.co_code
        yield from self._all((code.co_consts, code.co_names, code.co_varnames, code.co_flags))
        yield from self._all((code.co_argcount, code.co_kwonlyargcount, getattr(code, "co_exceptiontable", b"")))

    def _function(self, function: types.FunctionType) -> Iterator[bytes]:
        yield from self._all((function.__defaults__, function.__kwdefaults__, function.__closure__, function.__dict__))
        if _is_installed(function.__module__):
            yield from self._name(function)
            return
        yield self.read(function.__code__)
        cells = zip(function.__code__.co_freevars, function.__closure__ or (), strict=True)
        held = {name: cell.cell_contents for name, cell in cells if _is_filled(cell)}
        for name, value in _named(function.__code__, {**function.__globals__, **held}):
            yield from self._all((name, value))

    def _built_in(self, function: types.BuiltinFunctionType | types.MethodWrapperType) -> Iterator[bytes]:
        owner = function.__self__
        if isinstance(owner, types.ModuleType) or owner is None:
            yield from self._name(function)
        else:
            yield from self._all((owner, function.__name__))

    def _class(self, kind: type) -> Iterator[bytes]:
        yield from self._name(kind)
        if not _is_installed(kind.__module__):
            yield from self._all(kind.__bases__)
            for name, value in vars(kind).items():
                if name not in NO_CONTENT:
                    yield from self._all((name, value))

    def _name(self, thing: Any) -> Iterator[bytes]:
        """Yield the name of a class or function, and the version of its package, unless that is lcpimpact."""
        module = thing.__module__ or ""
        package = module.partition(".")[0]
        version = "" if package == PACKAGE else getattr(sys.modules.get(package), "__version__", "")
        named = module if _is_installed(module) else ""  # a script is __main__, or has the name of its file
        yield from self._all((named, thing.__qualname__, str(version)))

    def _object(self, value: Any) -> Iterator[bytes]:
        kind = type(value)
        if is_dataclass(value) and kind.__module__.partition(".")[0] == PACKAGE:
            yield self.read(kind)
            yield from self._all(getattr(value, each.name) for each in fields(value))
            return
        try:
            reduced = value.__name__ if kind is np.ufunc else value.__reduce_ex__(4)
        except Exception as error:
            raise _UnreadableError(f"{kind.__name__} has no content that can be read ({error})") from error
        if isinstance(reduced, str):  # known by its name only
            if not _is_found(value, reduced):
                raise _UnreadableError(f"{reduced}, of type {kind.__name__}, is known by its name only")
            yield self.read(reduced)
            return
        make, arguments, *rest = reduced
        state, items, pairs = (*rest[:3], None, None, None)[:3]
        yield from self._all((kind, make, arguments))
        of = state if isinstance(state, tuple) else (state,)
        yield from self._all(_without_caches(kind, each) for each in of)
        yield from self._all((list(items or ()), list(pairs or ())))


def _hash(kind: str, *parts: bytes) -> bytes:
    found = hashlib.sha256(kind.encode())
    for part in parts:
        found.update(len(part).to_bytes(8, "little"))
        found.update(part)
    return found.digest()


def _is_filled(cell: types.CellType) -> bool:
    """Return whether a variable of a closure has a value yet."""
    try:
        cell.cell_contents  # noqa: B018 - reading it is the test
    except ValueError:
        return False
    return True


def _compiled_from(value: Any) -> Any:
    """Return the function that another one was made from, as by `compiled` or `functools.lru_cache`, or None."""
    return getattr(value, "py_func", None) or getattr(value, "__wrapped__", None) if callable(value) else None


def _named(code: types.CodeType, names: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """Yield the objects that a function and those within it use by name, and those of a user's modules."""
    for each in dis.get_instructions(code):
        if each.opname in ("LOAD_GLOBAL", "LOAD_NAME", "LOAD_DEREF", "LOAD_CLASSDEREF", "IMPORT_NAME"):
            value = sys.modules.get(each.argval) if each.opname == "IMPORT_NAME" else names.get(each.argval)
            yield each.argval, value
            if isinstance(value, types.ModuleType) and not _is_installed(value.__name__):
                yield from ((name, getattr(value, name)) for name in code.co_names if hasattr(value, name))
    for constant in code.co_consts:
        if isinstance(constant, types.CodeType):
            yield from _named(constant, names)


def _is_found(value: Any, name: str) -> bool:
    """Return whether a value is what an installed module has under this name."""
    modules = [getattr(value, "__module__", None) or "", "numpy", "scipy.special"]
    return any(_is_installed(each) and getattr(sys.modules.get(each), name, None) is value for each in modules)


def _without_caches(kind: type, state: Any) -> Any:
    """Return the attributes of an object without the values that its class computes from the others."""
    if type(state) is not dict:
        return state
    return {
        name: value
        for name, value in state.items()
        if not isinstance(getattr(kind, str(name), None), functools.cached_property)
    }


@functools.cache
def _is_installed(module: str | None) -> bool:
    """Return whether a module belongs to lcpimpact, to Python or to an installed package."""
    top = (module or "").partition(".")[0]
    if not top or top == "__main__":
        return False
    if top == PACKAGE or top in sys.stdlib_module_names:
        return True
    file = getattr(sys.modules.get(top), "__file__", None) or ""
    return file.startswith(INSTALLED)
