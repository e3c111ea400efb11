"""Expressions as instructions of LLVM."""

from __future__ import annotations

import ast
import builtins
import inspect
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from enum import IntEnum
from typing import Any

import numpy as np

from lcpimpact.compiler.arrays import Computed, Part
from lcpimpact.compiler.blas import product
from lcpimpact.compiler.code import Value, constant
from lcpimpact.compiler.kinds import (
    FLAG,
    POINTER,
    REAL,
    WHOLE,
    ArrayKind,
    FunctionKind,
    Kind,
    Scalar,
    TupleKind,
    owners,
    registers,
)
from lcpimpact.compiler.library import BUILTINS
from lcpimpact.compiler.routines import Routine
from lcpimpact.compiler.writer import CompileError, FunctionAt, Term, Thing, Writer, merged


class Expressions(Writer):
    """The writer of the expressions of a function."""

    def term(self, node: ast.expr) -> Term:
        """Return the term of an expression."""
        match node:
            case ast.Constant(value=bool() | int() | float() as number):
                return constant(number)
            case ast.Name(id=name):
                return self.name(name)
            case ast.Attribute(value=base, attr=name):
                return self.attribute(self.term(base), name)
            case ast.Subscript(value=base, slice=index):
                return self.subscript(self.term(base), index)
            case ast.Tuple(elts=parts):
                return self.tuple([self.value(self.term(each)) for each in parts])
            case ast.UnaryOp(op=op, operand=operand):
                return self.unary(op, self.term(operand))
            case ast.BinOp(left=left, op=op, right=right):
                return self.binary(op, self.before(self.term(left), right), self.term(right))
            case ast.Compare(left=left, ops=ops, comparators=others):
                return self.comparison(left, ops, others)
            case ast.BoolOp(op=op, values=operands):
                return self.connected(isinstance(op, ast.And), operands)
            case ast.IfExp(test=test, body=body, orelse=orelse):
                return self.either(test, body, orelse)
            case ast.Call(func=function, args=arguments, keywords=named):
                return self.call(function, arguments, named)
        raise CompileError(f"there is no {type(node).__name__} in compiled code: {ast.unparse(node)}")

    def before(self, term: Term, *later: ast.expr) -> Term:
        """Return a term as it is before later expressions, a call in which may change the arrays that it is computed of."""
        calls = any(isinstance(each, ast.Call) for node in later for each in ast.walk(node))
        return self.value(term) if calls and isinstance(term, Computed) else term

    def name(self, name: str) -> Term:
        """Return the term that a name stands for."""
        if name in self.values:
            return self.values[name]
        if name in self.variables:
            return self.held(self.variables[name], name in self.positive)
        if name in self.stored:
            raise CompileError(f"{name} has no value yet")
        names = dict(zip(self.python.__code__.co_freevars, self.python.__closure__ or (), strict=True))
        if name in names:
            return self.thing(names[name].cell_contents)
        if name in self.python.__globals__:
            return self.thing(self.python.__globals__[name])
        return Thing(getattr(builtins, name))

    def thing(self, thing: Any) -> Term:
        """Return a part of the program as a term."""
        if isinstance(thing, bool | int | float | IntEnum | np.integer | np.floating):
            return constant(int(thing) if isinstance(thing, IntEnum | np.integer) else thing)  # type: ignore[arg-type]
        if isinstance(thing, tuple) and all(isinstance(each, bool | int | float) for each in thing):
            return self.tuple([constant(each) for each in thing])
        return Thing(thing)

    def attribute(self, base: Term, name: str) -> Term:
        """Return an attribute of a term."""
        if isinstance(base, Thing):
            return self.thing(getattr(base.thing, name))
        base = self.value(base)
        match base.kind:
            case TupleKind(_, named) if named is not None and name in named._fields:  # type: ignore[attr-defined]
                return self.item(base, named._fields.index(name))  # type: ignore[attr-defined]
            case ArrayKind(_, axes) if name == "shape":
                lengths = [Value(WHOLE, (self.code.one(base, 1 + i),), positive=True) for i in range(axes)]
                return self.tuple(lengths)
            case ArrayKind(_, axes) if name == "size":
                size = "1"
                for i in range(axes):
                    size = self.code.whole("mul", size, self.code.one(base, 1 + i))
                return Value(WHOLE, (size,), positive=True)
            case ArrayKind(_, axes) if name == "ndim":
                return constant(axes)
            case ArrayKind() if name == "T":
                return self.arrays.transposed(base)
            case ArrayKind() if name == "ctypes":
                return Value(POINTER, (self.code.one(base),))
            case Scalar() if name == "value":  # of a member of an enumeration
                return base
        raise CompileError(f"a value of type {base.kind} has no {name}")

    def indices(self, array: Value, node: ast.expr) -> list[Any]:
        """Return the choice of each axis of an array: a place, a part, or None for all of it."""
        assert isinstance(array.kind, ArrayKind)
        given = node.elts if isinstance(node, ast.Tuple) else [node]
        found = list[Any]()
        for i in range(array.kind.axes):
            length = self.code.one(array, 1 + i)
            match given[i] if i < len(given) else None:
                case None | ast.Slice(lower=None, upper=None, step=None):
                    found.append(None)
                case ast.Slice(lower=lower, upper=upper, step=None):
                    first = self.bound(lower, length) if lower else "0"
                    last = self.bound(upper, length) if upper else length
                    size = self.code.whole("sub", last, first)
                    if lower is not None:
                        some = self.code.get(f"icmp sgt i64 {size}, 0")
                        size = self.code.select(some, "i64", size, "0")
                    found.append(Part(first, size))
                case ast.expr() as each:
                    value = self.term(each)
                    if not isinstance(value, Value) or isinstance(value.kind, ArrayKind):
                        raise CompileError("an array is no index beside others")
                    found.append(self.index(value, length))
        return found

    def bound(self, node: ast.expr, length: str) -> str:
        """Return an end of a part of an axis, which lies in it."""
        value = self.value(self.term(node))
        register, code = self.index(value, length), self.code
        if not value.positive:
            below = code.get(f"icmp slt i64 {register}, 0")
            register = code.select(below, "i64", "0", register)
        above = code.get(f"icmp sgt i64 {register}, {length}")
        return code.select(above, "i64", length, register)

    def subscript(self, base: Term, node: ast.expr) -> Term:
        """Return an item, an element or a part of a term."""
        if isinstance(base, Thing):
            index = self.term(node)
            return self.thing(base.thing[index.known])  # type: ignore[union-attr]
        if isinstance(base, Value) and isinstance(base.kind, TupleKind):
            index = self.value(self.term(node))
            if index.known is not None:
                return self.item(base, range(len(base.kind.items))[index.known])
            return self.chosen_item(base, index)
        array = self.value(base)
        assert isinstance(array.kind, ArrayKind)
        if not isinstance(node, ast.Tuple | ast.Slice):
            places = self.term(node)
            if isinstance(places, Computed) or (isinstance(places, Value) and isinstance(places.kind, ArrayKind)):
                return self.gathered(array, places)
            return self.element(array, [self.value(places)])
        chosen = self.indices(array, node)
        if all(isinstance(each, str) for each in chosen):
            return self.code.load(array.kind.element, self.arrays.address(array, chosen))
        return self.arrays.view(array, chosen)

    def unary(self, op: ast.unaryop, operand: Term) -> Term:
        """Return an operation on one term."""
        code = self.code
        single = isinstance(operand, Value) and not isinstance(operand.kind, ArrayKind)

        def apply(value: Value) -> Value:
            if isinstance(op, ast.Not):
                found = self.truth(value)
                opposite = {"true": "false", "false": "true"}
                return Value(FLAG, (opposite.get(found) or code.get(f"xor i1 {found}, true"),))
            if value.known is not None and isinstance(op, ast.USub):
                return constant(-value.known)
            register = code.one(value)
            if isinstance(op, ast.USub):
                if value.kind is REAL:
                    return Value(REAL, (code.get(f"fneg double {register}"),))
                return Value(WHOLE, (code.get(f"sub i64 0, {self.arrays.converted(value, WHOLE)}"),))
            if isinstance(op, ast.Invert) and value.kind is FLAG and not single:  # of Python, ~True = -2
                return Value(FLAG, (code.get(f"xor i1 {register}, true"),))
            if isinstance(op, ast.UAdd):
                return value
            raise CompileError("there is no such operation")

        if isinstance(op, ast.Not) and isinstance(operand, Value) and single:
            return apply(operand)
        return self.by_element(apply, operand)

    def binary(self, op: ast.operator, left: Term, right: Term) -> Term:
        """Return an operation on two terms."""
        if isinstance(op, ast.MatMult):
            return self.product(self.value(left), self.value(right))
        return self.by_element(lambda a, b: self.arithmetic(op, a, b), left, right)

    def comparison(self, left: ast.expr, ops: Sequence[ast.cmpop], others: Sequence[ast.expr]) -> Term:
        """Return a comparison, of which a < b < c is a < b and b < c."""
        a = self.before(self.term(left), *others)
        if isinstance(a, Value):
            a = self.code.loaded(a)
        found: Term | None = None
        for op, node in zip(ops, others, strict=True):
            b = self.term(node)
            if isinstance(op, ast.In):
                return self.among(self.value(a), self.value(b))
            one = self.by_element(lambda x, y, op=op: self.compared(op, x, y), a, b)
            found = (
                one if found is None else self.by_element(lambda x, y: self.arithmetic(ast.BitAnd(), x, y), found, one)
            )
            a = b
        assert found is not None
        return found

    @contextmanager
    def inside(self) -> Iterator[None]:
        """Write a part of an expression that may not be reached: what it makes is released there."""
        first = len(self.temporary)
        yield
        self.release_temporary(first)

    def connected(self, both: bool, operands: Sequence[ast.expr]) -> Value:
        """Return whether all, or any, of some conditions hold; a later one is asked only where it decides."""
        code, end = self.code, self.code.new("decided")
        place = code.place("i1")
        for i, each in enumerate(operands):
            with self.inside():
                value = self.value(self.term(each))
                if value.kind is not FLAG:
                    raise CompileError(f"{ast.unparse(each)} is no truth value: a comparison says what is meant")
                found = self.truth(value)
            if found in ("true", "false") and (found == "true") == both and i + 1 < len(operands):
                continue
            code.do(f"store i1 {found}, ptr {place}")
            if i + 1 < len(operands):
                on = code.new("more")
                code.branch(found, on if both else end, end if both else on)
                code.begin(on)
        code.go(end)
        code.begin(end)
        return Value(FLAG, (code.get(f"load i1, ptr {place}"),))

    def either(self, test: ast.expr, body: ast.expr, orelse: ast.expr) -> Term:
        """Return one of two terms."""
        code, condition = self.code, self.truth(self.term(test))
        if condition in ("true", "false"):
            return self.term(body if condition == "true" else orelse)
        kind = merged(self.kind_of(body), self.kind_of(orelse))
        places = [code.place(each) for each in registers(kind)]
        yes, no = code.new("then"), code.new("else")
        end = code.new("end")
        code.branch(condition, yes, no)
        for block, node in ((yes, body), (no, orelse)):
            code.begin(block)
            with self.inside():
                given = self.fitted(self.value(self.term(node)), kind)
                found = code.loaded(given)
                if owners(kind):
                    self.own(self._moved(given, found))
                code.keep(places, found)
            code.go(end)
        code.begin(end)
        return self.made(code.loaded(Value(kind, tuple(f"*{each}" for each in places), lasting=not owners(kind))))

    def kind_of(self, node: ast.expr) -> Kind:
        """Return the type of an expression, by writing it and throwing that away."""
        made = list(self.temporary)
        with self.code.draft():
            kind = self.value(self.term(node)).kind
        self.temporary = made
        return kind

    def call(self, function: ast.expr, arguments: Sequence[ast.expr], named: Sequence[ast.keyword]) -> Term:
        """Return the result of a call."""
        if isinstance(function, ast.Attribute):
            base = self.term(function.value)
            if not isinstance(base, Thing):
                given = [self.term(each) for each in arguments]
                return self.method(base, function.attr, given, {each.arg: self.term(each.value) for each in named})
            called: Term = self.thing(getattr(base.thing, function.attr))
        else:
            called = self.term(function)
        given = [self.term(each) for each in arguments]
        words = {str(each.arg): self.term(each.value) for each in named}
        if isinstance(called, Value) and isinstance(called.kind, FunctionKind):
            return self.called(called.kind, self.code.one(called), given)
        assert isinstance(called, Thing)
        thing = called.thing
        if hasattr(thing, "declared"):
            names = thing.py_func.__code__.co_varnames[: thing.py_func.__code__.co_argcount]
            given += [words[name] if name in words else self.default(thing, name) for name in names[len(given) :]]
            self.calls[thing] = None
            return self.called(thing.declared, f"@{thing.symbol}", given)
        if isinstance(thing, FunctionAt):
            (address,) = given
            return Value(thing.kind, (self.code.get(f"inttoptr i64 {self.code.one(self.value(address))} to ptr"),))
        if isinstance(thing, Routine):
            return self.routine(thing, [self.value(each) for each in given])
        if isinstance(thing, type) and hasattr(thing, "_fields"):
            fields = thing._fields[len(given) :]
            return self.tuple([*map(self.value, given), *(self.value(words[name]) for name in fields)], thing)
        return BUILTINS[thing](self, *given, **words)  # type: ignore[no-any-return]

    def default(self, function: Any, name: str) -> Term:
        """Return the value of an argument that is not given."""
        found = inspect.signature(function.py_func).parameters[name].default
        return self.thing(found)

    def method(self, base: Term, name: str, given: Sequence[Term], words: dict[str | None, Term]) -> Term:
        """Return the result of a method of an array or a tuple."""
        if name == "_replace":
            value = self.value(base)
            assert isinstance(value.kind, TupleKind)
            assert value.kind.named is not None
            fields = value.kind.named._fields  # type: ignore[attr-defined]
            parts = [self.value(words[n]) if n in words else self.item(value, i) for i, n in enumerate(fields)]
            return self.tuple(parts, value.kind.named)
        if name == "copy":
            return self.value(self.arrays.elements(self.value(base)))
        if name == "reshape":
            lengths = given if len(given) > 1 else [self.value(given[0])]
            value = self.value(base)
            if len(given) == 1 and isinstance(lengths[0].kind, TupleKind):  # type: ignore[union-attr]
                lengths = [self.item(lengths[0], i) for i in range(len(lengths[0].kind.items))]  # type: ignore[arg-type, union-attr]
            return self.arrays.reshaped(value, [self.code.one(self.value(each)) for each in lengths])
        return self.reduced(name, self.elements(base))

    def product(self, A: Value, B: Value) -> Value:
        """Return the product of matrices, or of a matrix and a vector, by BLAS."""
        return product(self, A, B)
