"""Values of the code that is written: variables, references to memory, and operations on numbers and arrays."""

from __future__ import annotations

import ast
import operator
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from lcpimpact.compiler.arrays import Arrays, Computed
from lcpimpact.compiler.code import Code, Value, constant
from lcpimpact.compiler.kinds import (
    FLAG,
    NONE,
    REAL,
    STORED,
    WHOLE,
    ArrayKind,
    FunctionKind,
    Kind,
    Scalar,
    TupleKind,
    owners,
    registers,
)
from lcpimpact.compiler.routines import Routine


class CompileError(TypeError):
    """A statement that compiled code has no words for."""


@dataclass(frozen=True)
class Thing:
    """A part of the program that is no value: a module, a function, a class."""

    thing: Any


@dataclass(frozen=True)
class FunctionAt:
    """The word that makes a function of a type from its address."""

    kind: FunctionKind

    @staticmethod
    def py_func(function: Any) -> Any:
        """Return the function itself, in the interpreter."""
        return function

    def __call__(self, function: Any) -> Any:
        """Return the function itself, in the interpreter."""
        return function


Term = Value | Computed | Thing


@dataclass(eq=False)
class Local:
    """A variable: its type, its places, and whether it counts as a reference to its memory."""

    kind: Kind
    places: tuple[str, ...]
    counts: bool


@dataclass
class Needs:
    """Facts about variables that one writing of a function finds for the next: wider types, and counts of references.

    Attributes
    ----------
    kinds : dict of str to Kind
    counting : set of str
    more : bool                     whether any was found in this writing, and the function is to be written again
    """

    kinds: dict[str, Kind] = field(default_factory=dict)
    counting: set[str] = field(default_factory=set)
    more: bool = False


ORDER = {
    ast.Lt: ("slt olt", operator.lt), ast.LtE: ("sle ole", operator.le), ast.Gt: ("sgt ogt", operator.gt),
    ast.GtE: ("sge oge", operator.ge), ast.Eq: ("eq oeq", operator.eq), ast.NotEq: ("ne une", operator.ne),
}  # fmt: skip
"""Comparisons of whole numbers, of real ones, and of those that are known."""
ARITHMETIC = {ast.Add: "add", ast.Sub: "sub", ast.Mult: "mul"}
BITS = {ast.BitAnd: "and", ast.BitOr: "or", ast.BitXor: "xor", ast.RShift: "ashr", ast.LShift: "shl"}
SAME = {
    ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul, ast.Div: operator.truediv,
    ast.Pow: operator.pow, ast.FloorDiv: operator.floordiv,
}  # fmt: skip


class Writer:
    """The writer of the code of one function: its variables and memory, and operations on its values."""

    def __init__(
        self, python: Any, stored: Counter[str], positive: set[str], kind: FunctionKind, symbol: str, needs: Needs
    ) -> None:
        self.python = python
        self.stored = stored  # how many times names are assigned
        self.positive = positive  # names of whole numbers that are never negative
        self.kind = kind
        self.needs = needs
        self.code = Code(symbol)
        self.arrays = Arrays(self.code)
        self.node: ast.AST | None = None
        self.values: dict[str, Value] = {}  # arguments, and what is assigned once and for all
        self.depth = -1  # of the blocks of statements
        self.variables: dict[str, Local] = {}
        self.temporary: list[Value] = []  # values whose memory this statement releases
        self.loops: list[tuple[str, str]] = []  # blocks of continue and break
        self.left: set[str] = set()  # blocks of loops that are left by break
        self.calls: dict[Any, None] = {}
        self.routines: dict[Routine, None] = {}
        self.declared: dict[str, None] = {}
        self.result = [self.code.place(each) for each in registers(kind.gives)]

    def held(self, variable: Local, positive: bool = False) -> Value:
        """Return the value of a variable, still to be loaded."""
        places = tuple(f"*{place}" for place in variable.places)
        return Value(variable.kind, places, not variable.counts, positive)

    def assign(self, name: str, value: Value) -> None:
        """Assign a value to a variable; ``_`` is none."""
        if name == "_":
            return
        if self.depth == 0 and self.stored[name] == 1 and (value.lasting or not owners(value.kind)):
            self.values[name] = self.code.loaded(value)  # as it stands, wherever it is read
            return
        kind = value.kind
        if name not in self.variables:
            kind = self.needs.kinds.get(name, kind)
            places = tuple(self.code.place(each) for each in registers(kind))
            self.variables[name] = Local(kind, places, name in self.needs.counting)
        variable = self.variables[name]
        if variable.kind != kind:
            wider = merged(variable.kind, kind)
            if wider != variable.kind:
                self.needs.kinds[name] = wider
                self.needs.more = True
                places = tuple(self.code.place(each) for each in registers(wider))
                variable = self.variables[name] = Local(wider, places, variable.counts)
        if owners(variable.kind) and not value.lasting and not variable.counts:
            self.needs.counting.add(name)
            self.needs.more = variable.counts = True
        value = self.fitted(value, variable.kind)
        found = self.code.loaded(value)
        if variable.counts:
            self.own(self._moved(value, found))
            self.code.count_references("release", self.held(variable))
        self.code.keep(variable.places, found)

    def own(self, value: Value) -> None:
        """Take over the memory of a value: that of a temporary one, or hold it."""
        if value in self.temporary:
            self.temporary.remove(value)
        else:
            self.code.count_references("hold", value)

    def made(self, value: Value) -> Value:
        """Return a new value whose memory this statement releases."""
        if owners(value.kind) and not value.lasting:
            self.temporary.append(value)
        return value

    def _moved(self, value: Value, found: Value) -> Value:
        """Give the place of a temporary value to its loaded form."""
        if value in self.temporary:
            self.temporary[self.temporary.index(value)] = found
        return found

    def release_temporary(self, first: int) -> None:
        """Release the memory of temporary values."""
        for each in self.temporary[first:]:
            self.code.count_references("release", each)
        del self.temporary[first:]

    def fitted(self, value: Value, kind: Kind) -> Value:
        """Return a value as one of a type."""
        if value.kind == kind:
            return value
        match value.kind, kind:
            case Scalar(), Scalar():
                return Value(kind, (self.arrays.converted(value, kind),), positive=value.positive)
            case ArrayKind(element, axes, "C"), ArrayKind(same, number, "A") if (element, axes) == (same, number):
                return self._moved(value, self.arrays.ordered(value))
            case TupleKind(items), TupleKind(others) if len(items) == len(others):
                parts = [self.fitted(self.item(value, i), each) for i, each in enumerate(others)]
                return self._moved(
                    value, Value(kind, tuple(r for each in parts for r in self.code.read(each)), value.lasting)
                )
        raise CompileError(f"a value of type {value.kind} is no {kind}")

    def value(self, term: Term) -> Value:
        """Return a term as a value."""
        if isinstance(term, Computed):
            return self.made(self.arrays.kept(term))
        if isinstance(term, Thing):
            return self.function_value(term.thing)
        return term

    def elements(self, term: Term) -> Computed:
        """Return an array as its elements."""
        return term if isinstance(term, Computed) else self.arrays.elements(self.value(term))

    def function_value(self, thing: Any) -> Value:
        """Return a compiled function as a value."""
        if not hasattr(thing, "declared"):
            raise CompileError(f"{thing!r} is no value")
        self.calls[thing] = None
        return Value(thing.declared, (f"@{thing.symbol}",))

    def item(self, value: Value, i: int) -> Value:
        """Return an item of a tuple."""
        assert isinstance(value.kind, TupleKind)
        kind = value.kind.items[i]
        first = sum(len(registers(each)) for each in value.kind.items[:i])
        found = value.registers[first : first + len(registers(kind))]
        known = value.known[i] if value.known is not None else None
        positive = known.positive if known is not None else False
        return Value(kind, found, value.lasting, positive, known.known if known is not None else None)

    def tuple(self, parts: Sequence[Value], named: type | None = None) -> Value:
        """Return a tuple of values."""
        kind = TupleKind(tuple(each.kind for each in parts), named)
        lasting = all(each.lasting or not owners(each.kind) for each in parts)
        loaded = [self.code.loaded(each) for each in parts]
        if not lasting:
            for part, each in zip(parts, loaded, strict=True):
                if owners(each.kind):
                    self.own(self._moved(part, each))
        found = tuple(register for each in loaded for register in each.registers)
        return self.made(Value(kind, found, lasting, known=tuple(loaded)))

    def index(self, value: Value, length: str) -> str:
        """Return a place in an axis, of which a negative one counts from its end."""
        register = self.arrays.converted(value, WHOLE)
        if value.positive:
            return register
        if register.startswith("-"):
            return self.code.whole("add", length, register)
        below = self.code.get(f"icmp slt i64 {register}, 0")
        return self.code.select(below, "i64", self.code.whole("add", register, length), register)

    def element(self, array: Value, indices: Sequence[Value]) -> Value:
        """Return an element of an array, or a part of it where there are fewer indices than axes."""
        assert isinstance(array.kind, ArrayKind)
        chosen: list[Any] = [self.index(each, self.code.one(array, 1 + i)) for i, each in enumerate(indices)]
        if len(chosen) == array.kind.axes:
            return self.code.load(array.kind.element, self.arrays.address(array, chosen))
        return self.arrays.view(array, [*chosen, *[None] * (array.kind.axes - len(chosen))])

    def chosen_item(self, base: Value, index: Value) -> Value:
        """Return the item of a tuple of numbers at a place that is not known."""
        assert isinstance(base.kind, TupleKind)
        kind, *others = base.kind.items
        if not isinstance(kind, Scalar) or {kind, *others} != {kind}:
            raise CompileError("a place that is not known is that of a tuple of numbers of one type")
        found, at = self.code.one(self.item(base, 0)), self.index(index, str(len(base.kind.items)))
        for i in range(1, len(base.kind.items)):
            here = self.code.get(f"icmp eq i64 {at}, {i}")
            found = self.code.select(here, registers(kind)[0], self.code.one(self.item(base, i)), found)
        return Value(kind, (found,))

    def gathered(self, array: Value, places: Term) -> Computed:
        """Return the elements of an array at some places, or where a condition holds."""
        assert isinstance(array.kind, ArrayKind)
        some = self.elements(places)
        if some.element is FLAG:
            some = self.arrays.elements(self.where(some))
        own = self.arrays.elements(array)

        def at(indices: Sequence[str]) -> Value:
            return own.at([self.index(some.at(indices[:1]), own.lengths[0]), *indices[1:]])

        return Computed(own.element, (*some.lengths, *own.lengths[1:]), at)

    def where(self, flags: Computed) -> Value:
        """Return the places where a condition holds."""
        code, (length,) = self.code, flags.lengths
        found = code.allocate(ArrayKind(WHOLE, 1), [length])
        count = code.place("i64")
        code.do(f"store i64 0, ptr {count}")

        def write(indices: Sequence[str], flag: Value) -> None:
            with code.where(code.one(flag)):
                n = code.get(f"load i64, ptr {count}")
                code.store(WHOLE, self.arrays.address(found, [n]), indices[0])
                code.do(f"store i64 {code.get(f'add i64 {n}, 1')}, ptr {count}")

        self.arrays.over(flags, write)
        n = code.get(f"load i64, ptr {count}")
        return self.made(Value(found.kind, (found.registers[0], n, found.registers[-1]), lasting=False))

    def truth(self, term: Term) -> str:
        """Return whether a number is not zero."""
        value = self.value(term)
        if value.known is not None and not isinstance(value.known, tuple):
            return "true" if value.known else "false"
        register = self.code.one(value)
        if value.kind is FLAG:
            return register
        if value.kind is WHOLE:
            return self.code.get(f"icmp ne i64 {register}, 0")
        assert value.kind is REAL
        return self.code.get(f"fcmp une double {register}, 0.0")

    def by_element(self, operation: Callable[..., Value], *operands: Term) -> Term:
        """Return an operation on numbers, or on the elements of arrays."""
        found = list[Computed | Value]()
        for each in operands:
            if isinstance(each, Value) and isinstance(each.kind, ArrayKind):
                found.append(self.arrays.elements(each))
            else:
                found.append(each if isinstance(each, Computed) else self.code.loaded(self.value(each)))
        if any(isinstance(each, Computed) for each in found):
            return self.arrays.by_element(operation, *found)
        return operation(*found)

    def arithmetic(self, op: ast.operator, a: Value, b: Value) -> Value:
        """Return an operation on two numbers."""
        code, kinds = self.code, (a.kind, b.kind)
        if a.known is not None and b.known is not None and type(op) in SAME:
            try:
                return constant(SAME[type(op)](a.known, b.known))
            except ArithmeticError:
                pass  # such as 1.0 / 0.0, which compiled code computes
        if type(op) in BITS and kinds == (FLAG, FLAG):
            return Value(FLAG, (code.get(f"{BITS[type(op)]} i1 {code.one(a)}, {code.one(b)}"),))
        if isinstance(op, ast.Add | ast.Sub) and kinds == (FLAG, FLAG):
            raise CompileError("the sum of two truth values is a number in Python, and a truth value in NumPy")
        if REAL not in kinds and not isinstance(op, ast.Div | ast.Pow):
            x, y = self.arrays.converted(a, WHOLE), self.arrays.converted(b, WHOLE)
            positive = a.positive and b.positive and not isinstance(op, ast.Sub | ast.LShift)
            if type(op) in ARITHMETIC:
                return Value(WHOLE, (code.whole(ARITHMETIC[type(op)], x, y),), positive=positive)
            if type(op) in BITS:
                return Value(WHOLE, (code.get(f"{BITS[type(op)]} i64 {x}, {y}"),), positive=positive)
            return Value(WHOLE, (self.divided(op, x, y, b.known),), positive=positive)
        x, y = self.arrays.converted(a, REAL), self.arrays.converted(b, REAL)
        if isinstance(op, ast.Pow):
            return Value(REAL, (self.c_function("pow", x, y),))
        if isinstance(op, ast.Mod):
            return Value(REAL, (self.remainder(x, y),))
        name = {**ARITHMETIC, ast.Div: "div"}[type(op)]
        return Value(REAL, (code.get(f"f{name} double {x}, {y}"),))

    def divided(self, op: ast.operator, x: str, y: str, known: Any) -> str:
        """Return the quotient of whole numbers, rounded down, or its remainder; as in NumPy, 0 for a divisor 0."""
        code = self.code
        if known in (None, 0, -1):  # x / -1 = -x: the processor has no quotient of the least number
            special = code.get(f"icmp ult i64 {code.get(f'add i64 {y}, 1')}, 2")
            x = code.get(f"mul i64 {x}, {code.select(special, 'i64', y, '1')}")
            y = code.select(special, "i64", "1", y)
        q, r = code.get(f"sdiv i64 {x}, {y}"), code.get(f"srem i64 {x}, {y}")
        some = code.get(f"icmp ne i64 {r}, 0")
        opposed = code.get(f"icmp slt i64 {code.get(f'xor i64 {r}, {y}')}, 0")
        down = code.get(f"and i1 {some}, {opposed}")
        if isinstance(op, ast.FloorDiv):
            return code.select(down, "i64", code.get(f"sub i64 {q}, 1"), q)
        if isinstance(op, ast.Mod):
            return code.select(down, "i64", code.get(f"add i64 {r}, {y}"), r)
        raise CompileError("there is no such operation on whole numbers")

    def remainder(self, x: str, y: str) -> str:
        """Return the remainder of x divided by y, with the sign of y."""
        code = self.code
        r = code.get(f"frem double {x}, {y}")
        zero = code.get(f"fcmp oeq double {r}, 0.0")
        below, wanted = (code.get(f"fcmp olt double {each}, 0.0") for each in (r, y))
        opposed = code.get(f"xor i1 {below}, {wanted}")
        found = code.select(opposed, "double", code.get(f"fadd double {r}, {y}"), r)
        return code.select(zero, "double", self.c_function("llvm.copysign.f64", "0.0", y), found)

    def c_function(self, name: str, *operands: str) -> str:
        """Return a function of C, or of LLVM, of real numbers."""
        takes = ", ".join(["double"] * len(operands))
        self.declared[f"declare double @{name}({takes})"] = None
        # LLVM would make x*x of x**2, which has other bits than the library's.
        as_it_is = "" if name.startswith("llvm.") else " nobuiltin"
        return self.code.get(f"call double @{name}({', '.join(f'double {each}' for each in operands)}){as_it_is}")

    def compared(self, op: ast.cmpop, a: Value, b: Value) -> Value:
        """Return a comparison of two numbers."""
        words, python = ORDER[type(op)]
        whole, real = words.split()
        if a.known is not None and b.known is not None:
            return constant(bool(python(a.known, b.known)))
        if REAL in (a.kind, b.kind):
            x, y = self.arrays.converted(a, REAL), self.arrays.converted(b, REAL)
            return Value(FLAG, (self.code.get(f"fcmp {real} double {x}, {y}"),))
        if a.kind is FLAG and b.kind is FLAG and whole in ("eq", "ne"):
            return Value(FLAG, (self.code.get(f"icmp {whole} i1 {self.code.one(a)}, {self.code.one(b)}"),))
        x, y = self.arrays.converted(a, WHOLE), self.arrays.converted(b, WHOLE)
        return Value(FLAG, (self.code.get(f"icmp {whole} i64 {x}, {y}"),))

    def among(self, value: Value, items: Value) -> Value:
        """Return whether a number is one of a tuple."""
        assert isinstance(items.kind, TupleKind)
        found = "false"
        for i in range(len(items.kind.items)):
            same = self.code.one(self.compared(ast.Eq(), value, self.item(items, i)))
            found = self.code.get(f"or i1 {found}, {same}")
        return Value(FLAG, (found,))

    def reduced(self, name: str, elements: Computed) -> Value:
        """Return the largest or smallest element or its place, the sum, or whether any element is true."""
        code, kind = self.code, elements.element
        place, at = code.place(kind.register), code.place("i64")
        first = elements.at(["0"] * len(elements.lengths)) if name in ("max", "min", "argmax") else None
        if name in ("any", "all"):
            code.do(f"store i1 {'false' if name == 'any' else 'true'}, ptr {place}")
        elif name == "sum":
            if kind is REAL:
                raise CompileError("NumPy adds real numbers in an order of its own: a loop says which is meant")
            code.do(f"store i64 0, ptr {at}")
        else:
            assert first is not None
            code.do(f"store {kind.register} {code.one(first)}, ptr {place}")
            code.do(f"store i64 0, ptr {at}")

        operation = "or" if name == "any" else "and"

        def take(indices: Sequence[str], value: Value) -> None:
            found = code.one(value)
            if name in ("any", "all"):
                old = code.get(f"load i1, ptr {place}")
                code.do(f"store i1 {code.get(f'{operation} i1 {old}, {found}')}, ptr {place}")
                return
            if name == "sum":
                old = code.get(f"load i64, ptr {at}")
                more = self.arrays.converted(value, WHOLE)
                code.do(f"store i64 {code.get(f'add i64 {old}, {more}')}, ptr {at}")
                return
            old = code.get(f"load {kind.register}, ptr {place}")
            op: ast.cmpop = ast.Lt() if name == "min" else ast.Gt()
            better = code.one(self.compared(op, value, Value(kind, (old,))))
            if kind is REAL:  # NaN, once found, stays
                nan = code.get(f"fcmp uno double {found}, {found}")
                kept = code.get(f"fcmp ord double {old}, {old}")
                better = code.get(f"or i1 {better}, {code.get(f'and i1 {nan}, {kept}')}")
            with code.where(better):
                code.do(f"store {kind.register} {found}, ptr {place}")
                if name == "argmax":
                    code.do(f"store i64 {indices[0]}, ptr {at}")

        self.arrays.over(elements, take)
        if name in ("argmax", "sum"):
            return Value(WHOLE, (code.get(f"load i64, ptr {at}"),), positive=name == "argmax" or kind is FLAG)
        return Value(kind, (code.get(f"load {kind.register}, ptr {place}"),))

    def new_array(self, shape: Term, dtype: Term | None = None, fill: Value | None = None, zero: bool = False) -> Value:
        """Return a new array."""
        given = self.value(shape)
        lengths = (
            [self.item(given, i) for i in range(len(given.kind.items))]
            if isinstance(given.kind, TupleKind)
            else [given]
        )
        element = fill.kind if fill is not None and dtype is None else REAL
        if isinstance(dtype, Thing):
            element = STORED[np.dtype(dtype.thing).name]
        assert isinstance(element, Scalar)
        shape_of = [self.arrays.converted(each, WHOLE) for each in lengths]
        found = self.code.allocate(ArrayKind(element, len(lengths)), shape_of, zero)
        if fill is not None:
            self.arrays.fill(found, fill)
        return self.made(found)

    def contiguous(self, array: Value) -> Value:
        """Return an array in C order, itself or a new one."""
        assert isinstance(array.kind, ArrayKind)
        return array if array.kind.order == "C" else self.value(self.arrays.elements(array))

    def called(self, kind: FunctionKind, address: str, given: Sequence[Term]) -> Value:
        """Return the result of a compiled function."""
        arguments = list[tuple[str, str]]()
        for each, takes in zip(given, kind.takes, strict=True):
            value = self.fitted(self.value(each), takes)
            arguments += zip(registers(takes), self.code.read(value), strict=True)
        return self.made(self.code.call(address, kind.gives, arguments))

    def routine(self, routine: Routine, given: Sequence[Value]) -> Value:
        """Return the result of a function of another language."""
        self.routines[routine] = None
        takes = ", ".join(f"ptr {self.code.one(each)}" for each in given)
        if routine.gives is NONE:
            self.code.do(f"call void @{routine.symbol}({takes})")
            return Value(NONE, ())
        found = self.code.get(f"call {routine.gives.stored} @{routine.symbol}({takes})")
        if routine.gives.stored == "i32":
            return Value(WHOLE, (self.code.get(f"sext i32 {found} to i64"),))
        return Value(routine.gives, (found,))


def merged(a: Kind, b: Kind) -> Kind:
    """Return the type that values of two types have in common."""
    if a == b:
        return a
    match a, b:
        case Scalar(), Scalar():
            order = [FLAG, WHOLE, REAL]
            return max(a, b, key=order.index)
        case ArrayKind(element, axes), ArrayKind(same, number) if (element, axes) == (same, number):
            return ArrayKind(element, axes, "A")
        case TupleKind(items, named), TupleKind(others, same) if len(items) == len(others) and named is same:
            return TupleKind(tuple(map(merged, items, others)), named)
    raise CompileError(f"a variable has values of types {a} and {b}")
