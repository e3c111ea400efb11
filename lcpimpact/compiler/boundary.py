"""Calls of compiled functions by Python: arguments are checked and taken apart, and the result is put together."""

from __future__ import annotations

import ctypes
import os
import re
import sys
from collections.abc import Iterator, Sequence
from functools import cache
from typing import Any

import numpy as np

from lcpimpact.compiler.code import BYTES, RUNTIME, Code, Value
from lcpimpact.compiler.kinds import (
    ArrayKind,
    FunctionKind,
    Kind,
    Scalar,
    TupleKind,
    registers,
)

PYTHON = """
declare ptr @PyEval_SaveThread()
declare void @PyEval_RestoreThread(ptr)
declare double @PyFloat_AsDouble(ptr)
declare i64 @PyLong_AsLongLong(ptr)
declare i32 @PyObject_IsTrue(ptr)
declare ptr @PyErr_Occurred()
declare void @PyErr_SetString(ptr, ptr)
declare i32 @PyType_IsSubtype(ptr, ptr)
declare ptr @PyTuple_GetItem(ptr, i64)
declare i64 @PyTuple_Size(ptr)
declare ptr @PyTuple_New(i64)
declare i32 @PyTuple_SetItem(ptr, i64, ptr)
declare ptr @PyFloat_FromDouble(double)
declare ptr @PyLong_FromLongLong(i64)
declare ptr @PyBool_FromLong(i64)
declare ptr @PyObject_Call(ptr, ptr, ptr)
declare void @Py_DecRef(ptr)
declare void @Py_IncRef(ptr)
declare ptr @PyArray_New(ptr, i32, ptr, i32, ptr, ptr, i32, i32, ptr)
@python_array = external global i8
@python_none = external global i8
@python_type_error = external global i8
define internal i1 @is_array(ptr %object, i32 %dtype, i32 %axes, i32 %flags) {
  %at.type = getelementptr i8, ptr %object, i64 8
  %type = load ptr, ptr %at.type
  %exact = icmp eq ptr %type, @python_array
  br i1 %exact, label %array, label %derived
derived:
  %found = call i32 @PyType_IsSubtype(ptr %type, ptr @python_array)
  %is.derived = icmp ne i32 %found, 0
  br i1 %is.derived, label %array, label %no
array:
  %at.axes = getelementptr i8, ptr %object, i64 24
  %has.axes = load i32, ptr %at.axes
  %at.flags = getelementptr i8, ptr %object, i64 64
  %has.flags = load i32, ptr %at.flags
  %masked = and i32 %has.flags, %flags
  %at.dtype = getelementptr i8, ptr %object, i64 56
  %descr = load ptr, ptr %at.dtype
  %at.number = getelementptr i8, ptr %descr, i64 28
  %number = load i32, ptr %at.number
  %a = icmp eq i32 %has.axes, %axes
  %b = icmp eq i32 %masked, %flags
  %c = icmp eq i32 %number, %dtype
  %at.bytes = getelementptr i8, ptr %descr, i64 26
  %bytes = load i8, ptr %at.bytes
  %d = icmp ne i8 %bytes, SWAPPED
  %ab = and i1 %a, %b
  %abc = and i1 %ab, %c
  %abcd = and i1 %abc, %d
  ret i1 %abcd
no:
  ret i1 false
}
""".replace("SWAPPED", str(ord(">" if sys.byteorder == "little" else "<")))
"""Names of Python and NumPy: data, lengths, dtype and flags of an array are at fixed places in it."""


class Method(ctypes.Structure):
    """A function as Python describes it (PyMethodDef)."""

    _fields_ = (("name", ctypes.c_char_p), ("code", ctypes.c_void_p), ("flags", ctypes.c_int), ("doc", ctypes.c_char_p))


C_FUNCTIONS = "pow", "exp", "log", "fmod", "frexp", "ldexp", "memset", "memmove", "memcpy"
"""Functions of C that compiled code calls, for LLVM finds them by itself only on some systems."""


@cache
def symbols() -> dict[str, int]:
    """Return the addresses that `RUNTIME` and `PYTHON` declare."""
    api = ctypes.pythonapi
    names = re.findall(r"^declare .*@(Py\w+)\(", RUNTIME + PYTHON, re.MULTILINE)
    found = {name: _address(getattr(api, name)) for name in names if name != "PyArray_New"}
    library = ctypes.CDLL("ucrtbase" if os.name == "nt" else None)
    found |= {name: _address(getattr(library, name)) for name in C_FUNCTIONS}
    inner: Any = sys.modules.get("numpy._core._multiarray_umath") or sys.modules["numpy.core._multiarray_umath"]
    api.PyCapsule_GetPointer.restype = ctypes.c_void_p
    api.PyCapsule_GetPointer.argtypes = ctypes.py_object, ctypes.c_char_p
    table = api.PyCapsule_GetPointer(ctypes.py_object(inner._ARRAY_API), None)
    new = ctypes.cast(table + 93 * ctypes.sizeof(ctypes.c_void_p), ctypes.POINTER(ctypes.c_void_p)).contents.value
    return found | {
        "PyArray_New": int(new or 0),
        "python_array": id(np.ndarray),
        "python_none": id(None),
        "python_type_error": id(TypeError),
    }


def _address(function: Any) -> int:
    return int(ctypes.cast(function, ctypes.c_void_p).value or 0)


def classes_of(kind: Kind) -> dict[str, type]:
    """Return the classes of the named tuples in a result, by their symbols."""
    match kind:
        case TupleKind(items, named):
            found = {name_of(named): named} if named else {}
            return found | {name: each for item in items for name, each in classes_of(item).items()}
    return {}


def name_of(named: type) -> str:
    """Return the symbol of a class."""
    return f'"class {named.__module__} {named.__qualname__}"'


class Boundary:
    """The function by which Python calls compiled code."""

    def __init__(self, symbol: str, name: str, kind: FunctionKind) -> None:
        self.code = Code(f"{symbol}.python")
        self.symbol = symbol
        self.name = name
        self.kind = kind
        self.words: list[str] = []

    def text(self) -> str:
        """Return its code."""
        code, count = self.code, len(self.kind.takes)
        self.check(code.get(f"icmp eq i64 %count, {count}"), f"{self.name} takes {count} arguments")
        given = list[tuple[str, str]]()
        for i, kind in enumerate(self.kind.takes):
            at = code.get(f"getelementptr ptr, ptr %arguments, i64 {i}")
            object_ = code.get(f"load ptr, ptr {at}")
            given += zip(registers(kind), self.taken(object_, kind, f"argument {i + 1} of {self.name}"), strict=True)
        thread = code.get("call ptr @PyEval_SaveThread()")
        found = code.call(f"@{self.symbol}", self.kind.gives, given)
        code.do(f"call void @PyEval_RestoreThread(ptr {thread})")
        code.do(f"ret ptr {self.made(found)}")
        code.begin("error")
        code.do("ret ptr null")
        head = f"define ptr @{code.symbol}(ptr %self, ptr %arguments, i64 %count)"
        classes = "".join(f"@{each} = external global i8\n" for each in classes_of(self.kind.gives))
        return classes + "".join(self.words) + code.text(head)

    def check(self, condition: str, words: str) -> None:
        """Raise a TypeError unless a condition holds."""
        code = self.code
        on, wrong = code.new("right"), code.new("wrong")
        code.branch(condition, on, wrong)
        code.begin(wrong)
        if words:
            given = words.encode() + b"\0"
            text = "".join(f"\\{each:02x}" for each in given)
            name = f"@{code.new(f'{code.symbol}.words')}"
            self.words.append(f'{name} = private constant [{len(given)} x i8] c"{text}"\n')
            code.do(f"call void @PyErr_SetString(ptr @python_type_error, ptr {name})")
        code.go("error")
        code.begin(on)

    def taken(self, given: str, kind: Kind, what: str) -> Iterator[str]:
        """Yield the registers of an argument."""
        code = self.code
        match kind:
            case ArrayKind(element, axes, order):
                flags = 0x500 | (order == "C")  # aligned, writeable, and contiguous in C order
                number = np.dtype(element.name).num
                right = code.get(f"call i1 @is_array(ptr {given}, i32 {number}, i32 {axes}, i32 {flags})")
                layout = "C-ordered " if order == "C" else ""
                self.check(right, f"{what} is no writeable {layout}array of {element.name} with {axes} axes")
                yield self.field(given, 16)
                lengths, strides = self.field(given, 32), self.field(given, 40)
                for i in range(axes):
                    yield code.get(f"load i64, ptr {code.get(f'getelementptr i64, ptr {lengths}, i64 {i}')}")
                for i in range(axes if order == "A" else 0):
                    stride = code.get(f"load i64, ptr {code.get(f'getelementptr i64, ptr {strides}, i64 {i}')}")
                    yield code.get(f"sdiv i64 {stride}, {BYTES[element.stored]}")
                yield "null"
            case TupleKind(items):
                size = code.get(f"call i64 @PyTuple_Size(ptr {given})")
                self.check(code.get(f"icmp eq i64 {size}, {len(items)}"), f"{what} is no tuple of {len(items)}")
                for i, item in enumerate(items):
                    part = code.get(f"call ptr @PyTuple_GetItem(ptr {given}, i64 {i})")
                    yield from self.taken(part, item, f"item {i + 1} of {what}")
            case FunctionKind():
                address = self.number(given, "PyLong_AsLongLong", "i64", "icmp eq i64", "-1")
                yield code.get(f"inttoptr i64 {address} to ptr")
            case Scalar("float64"):
                yield self.number(given, "PyFloat_AsDouble", "double", "fcmp oeq double", "-1.0")
            case Scalar("int64"):
                yield self.number(given, "PyLong_AsLongLong", "i64", "icmp eq i64", "-1")
            case Scalar("bool"):
                found = self.number(given, "PyObject_IsTrue", "i32", "icmp eq i32", "-1")
                yield code.get(f"icmp ne i32 {found}, 0")

    def field(self, given: str, at: int) -> str:
        """Return an address that an array holds."""
        return self.code.get(f"load ptr, ptr {self.code.get(f'getelementptr i8, ptr {given}, i64 {at}')}")

    def number(self, given: str, function: str, register: str, same: str, wrong: str) -> str:
        """Return a number of Python's."""
        code = self.code
        found = code.get(f"call {register} @{function}(ptr {given})")
        doubtful = code.get(f"{same} {found}, {wrong}")
        with code.where(doubtful):
            raised = code.get("call ptr @PyErr_Occurred()")
            self.check(code.get(f"icmp eq ptr {raised}, null"), "")
        return found

    def made(self, value: Value) -> str:
        """Return a result as an object of Python; its memory is released."""
        code, kind = self.code, value.kind
        match kind:
            case Scalar("None"):
                code.do("call void @Py_IncRef(ptr @python_none)")
                return "@python_none"
            case Scalar("float64"):
                return code.get(f"call ptr @PyFloat_FromDouble(double {code.one(value)})")
            case Scalar("int64"):
                return code.get(f"call ptr @PyLong_FromLongLong(i64 {code.one(value)})")
            case Scalar("bool"):
                return code.get(f"call ptr @PyBool_FromLong(i64 {code.get(f'zext i1 {code.one(value)} to i64')})")
            case TupleKind(items, named):
                return self.made_tuple(value, items, named)
            case ArrayKind():
                return self.made_array(value)
        raise TypeError(f"a function whose result is of type {kind} is called by compiled code alone")

    def made_tuple(self, value: Value, items: Sequence[Kind], named: type | None) -> str:
        """Return a tuple of Python's."""
        code, first = self.code, 0
        whole = code.get(f"call ptr @PyTuple_New(i64 {len(items)})")
        for i, item in enumerate(items):
            last = first + len(registers(item))
            part = self.made(Value(item, value.registers[first:last]))
            code.do(f"call i32 @PyTuple_SetItem(ptr {whole}, i64 {i}, ptr {part})")
            first = last
        if named is None:
            return whole
        found = code.get(f"call ptr @PyObject_Call(ptr @{name_of(named)}, ptr {whole}, ptr null)")
        code.do(f"call void @Py_DecRef(ptr {whole})")
        return found

    def made_array(self, value: Value) -> str:
        """Return an array of NumPy's with a copy of the numbers of one in C order."""
        code, kind = self.code, value.kind
        assert isinstance(kind, ArrayKind)
        if kind.order != "C":
            raise TypeError("a function whose result is an array with strides is called by compiled code alone")
        lengths, size = code.place(f"[{kind.axes} x i64]"), str(BYTES[kind.element.stored])
        for i in range(kind.axes):
            length = code.one(value, 1 + i)
            size = code.whole("mul", size, length)
            code.do(f"store i64 {length}, ptr {code.get(f'getelementptr i64, ptr {lengths}, i64 {i}')}")
        number = np.dtype(kind.element.name).num
        found = code.get(
            f"call ptr @PyArray_New(ptr @python_array, i32 {kind.axes}, ptr {lengths}, i32 {number}, ptr null, ptr null, "
            "i32 0, i32 0, ptr null)"
        )
        data = self.field(found, 16)
        code.do(f"call void @llvm.memmove.p0.p0.i64(ptr {data}, ptr {code.one(value)}, i64 {size}, i1 false)")
        code.count_references("release", value)
        return found
