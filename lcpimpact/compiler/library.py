"""The functions of Python, of its module math and of NumPy that compiled code knows."""

from __future__ import annotations

import ast
import math
from collections.abc import Callable
from typing import Any

import numpy as np

from lcpimpact.compiler.arrays import Computed
from lcpimpact.compiler.code import Value, constant
from lcpimpact.compiler.kinds import FLAG, REAL, WHOLE, ArrayKind, TupleKind, registers
from lcpimpact.compiler.writer import Term, Writer, merged


def _extreme(largest: bool) -> Callable[..., Term]:
    def found(writer: Writer, *given: Term) -> Term:
        def better(a: Value, b: Value) -> Value:
            kind = merged(a.kind, b.kind)
            op: ast.cmpop = ast.Gt() if largest else ast.Lt()
            condition = writer.compared(op, b, a)
            if condition.known is not None:
                return b if condition.known else a
            first, other = writer.fitted(a, kind), writer.fitted(b, kind)
            register = registers(kind)[0]
            chosen = writer.code.select(
                writer.code.one(condition), register, writer.code.one(other), writer.code.one(first)
            )
            return Value(kind, (chosen,), positive=(a.positive or b.positive) if largest else a.positive and b.positive)

        if len(given) == 1:
            return writer.reduced("max" if largest else "min", writer.elements(given[0]))
        values = [writer.code.loaded(writer.value(each)) for each in given]
        result = values[0]
        for each in values[1:]:
            result = better(result, each)
        return result

    return found


def _absolute(writer: Writer, given: Term) -> Term:
    def apply(value: Value) -> Value:
        if value.kind is REAL:
            return Value(REAL, (writer.c_function("llvm.fabs.f64", writer.code.one(value)),))
        x = writer.arrays.converted(value, WHOLE)
        below = writer.code.get(f"icmp slt i64 {x}, 0")
        opposite = writer.code.get(f"sub i64 0, {x}")
        return Value(WHOLE, (writer.code.select(below, "i64", opposite, x),), positive=True)

    return writer.by_element(apply, given)


def _real(name: str) -> Callable[..., Term]:
    """Return a function of real numbers, of C or of LLVM."""

    def found(writer: Writer, *given: Term) -> Term:
        def apply(*values: Value) -> Value:
            return Value(REAL, (writer.c_function(name, *(writer.arrays.converted(each, REAL) for each in values)),))

        return writer.by_element(apply, *given)

    return found


def _sign(writer: Writer, given: Term) -> Term:
    def apply(value: Value) -> Value:
        x, code = writer.arrays.converted(value, REAL), writer.code
        above, below = code.get(f"fcmp ogt double {x}, 0.0"), code.get(f"fcmp olt double {x}, 0.0")
        zero = code.get(f"fcmp oeq double {x}, 0.0")
        found = code.select(zero, "double", "0.0", x)
        return Value(REAL, (code.select(above, "double", "1.0", code.select(below, "double", "-1.0", found)),))

    return writer.by_element(apply, given)


def _not_a_number(writer: Writer, given: Term) -> Term:
    def apply(value: Value) -> Value:
        x = writer.arrays.converted(value, REAL)
        return Value(FLAG, (writer.code.get(f"fcmp uno double {x}, {x}"),))

    return writer.by_element(apply, given)


def _is_finite(writer: Writer, given: Term) -> Term:
    def apply(value: Value) -> Value:
        x = writer.c_function("llvm.fabs.f64", writer.arrays.converted(value, REAL))
        return Value(FLAG, (writer.code.get(f"fcmp olt double {x}, 0x7FF0000000000000"),))

    return writer.by_element(apply, given)


def _whole(writer: Writer, given: Term) -> Value:
    value = writer.value(given)
    if value.kind is REAL:
        return Value(WHOLE, (writer.code.get(f"fptosi double {writer.code.one(value)} to i64"),))
    return Value(WHOLE, (writer.arrays.converted(value, WHOLE),), positive=value.positive)


def _floor(writer: Writer, given: Term) -> Value:
    x = writer.c_function("llvm.floor.f64", writer.arrays.converted(writer.value(given), REAL))
    return Value(WHOLE, (writer.code.get(f"fptosi double {x} to i64"),))


def _length(writer: Writer, given: Term) -> Value:
    value = writer.value(given)
    if isinstance(value.kind, TupleKind):
        return constant(len(value.kind.items))
    return Value(WHOLE, (writer.code.one(value, 1),), positive=True)


def _frexp(writer: Writer, given: Term) -> Value:
    code, x = writer.code, writer.arrays.converted(writer.value(given), REAL)
    place = code.place("i32")
    writer.declared["declare double @frexp(double, ptr)"] = None
    part = code.get(f"call double @frexp(double {x}, ptr {place})")
    power = code.get(f"sext i32 {code.get(f'load i32, ptr {place}')} to i64")
    return writer.tuple([Value(REAL, (part,)), Value(WHOLE, (power,))])


def _ldexp(writer: Writer, number: Term, power: Term) -> Value:
    code = writer.code
    x, n = writer.arrays.converted(writer.value(number), REAL), writer.arrays.converted(writer.value(power), WHOLE)
    writer.declared["declare double @ldexp(double, i32)"] = None
    return Value(REAL, (code.get(f"call double @ldexp(double {x}, i32 {code.get(f'trunc i64 {n} to i32')})"),))


def _arange(writer: Writer, count: Term) -> Computed:
    n = writer.arrays.converted(writer.value(count), WHOLE)
    return Computed(WHOLE, (n,), lambda indices: Value(WHOLE, (indices[0],), positive=True))


def _like(writer: Writer, array: Term, fill: Term | None = None) -> Value:
    value = writer.value(array)
    assert isinstance(value.kind, ArrayKind)
    lengths = [axis.length for axis in writer.arrays.axes(value)]
    found = writer.code.allocate(ArrayKind(value.kind.element, value.kind.axes), lengths)
    if fill is not None:
        writer.arrays.fill(found, writer.code.loaded(writer.value(fill)))
    return writer.made(found)


def _into(op: ast.operator) -> Callable[..., Term]:
    def found(writer: Writer, left: Term, right: Term, out: Term) -> Term:
        target, elements = writer.value(out), writer.by_element(lambda a, b: writer.arithmetic(op, a, b), left, right)
        writer.arrays.fill(target, elements)  # type: ignore[arg-type]
        return target

    return found


BUILTINS: dict[Any, Callable[..., Any]] = {
    len: _length,
    max: _extreme(largest=True),
    min: _extreme(largest=False),
    int: _whole,
    float: lambda writer, given: Value(REAL, (writer.arrays.converted(writer.value(given), REAL),)),
    bool: lambda writer, given: Value(FLAG, (writer.truth(given),)),
    np.empty: lambda writer, shape, dtype=None: writer.new_array(shape, dtype),
    np.zeros: lambda writer, shape, dtype=None: writer.new_array(shape, dtype, zero=True),
    np.ones: lambda writer, shape: writer.new_array(shape, fill=constant(1.0)),
    np.full: lambda writer, shape, fill: writer.new_array(shape, fill=writer.code.loaded(writer.value(fill))),
    np.empty_like: _like,
    np.full_like: _like,
    np.arange: _arange,
    np.flatnonzero: lambda writer, flags: writer.where(writer.elements(flags)),
    np.asarray: lambda writer, array: writer.value(array),
    np.ascontiguousarray: lambda writer, array: writer.contiguous(writer.value(array)),
    np.multiply: _into(ast.Mult()),
    np.add: _into(ast.Add()),
    np.sum: lambda writer, array: writer.reduced("sum", writer.elements(array)),
    np.argmax: lambda writer, array: writer.reduced("argmax", writer.elements(array)),
    np.sign: _sign,
    np.isnan: _not_a_number,
    math.isfinite: _is_finite,
    math.floor: _floor,
    math.frexp: _frexp,
    math.ldexp: _ldexp,
    **{each: _real(each.__name__) for each in (math.exp, math.log, math.sin, math.cos, math.atan2)},
    **dict.fromkeys((abs, np.abs), _absolute),
    **dict.fromkeys((math.sqrt, np.sqrt), _real("llvm.sqrt.f64")),
    math.copysign: _real("llvm.copysign.f64"),
    np.floor: _real("llvm.floor.f64"),
}  # fmt: skip
"""Functions of Python, its module math and NumPy, and the code of each."""
