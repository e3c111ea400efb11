"""The code of a Python function for declared types: its statements, one after the other, as instructions of LLVM.

The language is what numerical loops need: numbers, arrays, tuples and named tuples, loops, conditions, and calls of other
compiled functions. Each operation rounds as in the interpreter, and none is moved or left out for speed.
"""

from __future__ import annotations

import ast
import builtins
import inspect
import math
import operator
import textwrap
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from enum import IntEnum
from functools import cache
from typing import Any

import numpy as np

from lcpimpact.compiler.arrays import Arrays, Elements, Part
from lcpimpact.compiler.code import Code, Value, constant, result
from lcpimpact.compiler.kinds import (
    FLAG,
    NONE,
    POINTER,
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
    """What compiled code has no words for."""


@dataclass(frozen=True)
class Known:
    """A part of the program that is no value: a module, a function, a class."""

    thing: Any


@dataclass(frozen=True)
class FunctionAt:
    """What makes a function of a type from its address."""

    kind: FunctionKind

    @staticmethod
    def py_func(function: Any) -> Any:
        """Return the function itself, in the interpreter."""
        return function

    def __call__(self, function: Any) -> Any:
        """Return the function itself, in the interpreter."""
        return function


Term = Value | Elements | Known


class Again(Exception):
    """A variable needs another type, or its memory a count: the function is written again."""


@dataclass(eq=False)
class Variable:
    """A variable: its type, its places, and whether it counts as a reference to its memory."""

    kind: Kind
    places: tuple[str, ...]
    counts: bool


@dataclass(frozen=True)
class Needs:
    """What the variables of a function were found to need: types wider than the first value, and counts of references."""

    kinds: dict[str, Kind] = field(default_factory=dict)
    counting: set[str] = field(default_factory=set)


@dataclass(frozen=True, eq=False)
class Lowered:
    """The code of a function.

    Attributes
    ----------
    text : str
    calls : tuple           the compiled functions that it calls
    routines : tuple        those of other languages
    declared : tuple of str     declarations of functions of LLVM and of C
    """

    text: str
    calls: tuple[Any, ...]
    routines: tuple[Routine, ...]
    declared: tuple[str, ...]


def lower(function: Any, python: Any, kind: FunctionKind, symbol: str, inline: bool) -> Lowered:
    """Return the code of a function with a type.

    Raises
    ------
    CompileError
        If it says what compiled code has no words for.
    """
    needs = Needs()
    tree = source_of(python)
    while True:
        writer = Lowering(python, tree, kind, symbol, needs)
        try:
            return writer.written(inline)
        except Again:
            continue
        except (TypeError, KeyError, AttributeError, ValueError, AssertionError, NotImplementedError) as error:
            line = getattr(writer.node, "lineno", 0) + python.__code__.co_firstlineno - 1
            what = ast.unparse(writer.node) if writer.node else ""
            place = f"{python.__code__.co_filename}:{line}"
            raise CompileError(f"{place}: {python.__qualname__}: {what[:80]}: {error}") from error


@cache
def source_of(python: Any) -> ast.FunctionDef:
    """Return the statements of a function, from its text if that was generated.

    Raises
    ------
    CompileError
        If the text in its file is not what is imported.
    """
    text = python.__dict__.get("text") or textwrap.dedent(inspect.getsource(python))
    tree = ast.parse(text).body[0]
    assert isinstance(tree, ast.FunctionDef)
    plain = ast.Module([ast.FunctionDef(tree.name, _bare(tree.args), tree.body, [], lineno=1, col_offset=0)], [])
    now, then = compile(ast.fix_missing_locations(plain), "", "exec").co_consts[0], python.__code__
    if repr((now.co_varnames, now.co_consts)) != repr((then.co_varnames, then.co_consts)):
        raise CompileError(f"{python.__code__.co_filename} has changed since {python.__qualname__} was imported")
    return tree


def _bare(arguments: ast.arguments) -> ast.arguments:
    """Return arguments without annotations and default values."""
    return ast.arguments([], [ast.arg(each.arg) for each in arguments.args], None, [], [], None, [])


def stores(tree: ast.AST) -> Counter[str]:
    """Return how many times names are assigned in some statements."""
    return Counter(each.id for each in ast.walk(tree) if isinstance(each, ast.Name) and isinstance(each.ctx, ast.Store))


ORDER = {
    ast.Lt: "slt olt",
    ast.LtE: "sle ole",
    ast.Gt: "sgt ogt",
    ast.GtE: "sge oge",
    ast.Eq: "eq oeq",
    ast.NotEq: "ne une",
}
ARITHMETIC = {ast.Add: "add", ast.Sub: "sub", ast.Mult: "mul"}
BITS = {ast.BitAnd: "and", ast.BitOr: "or", ast.BitXor: "xor", ast.RShift: "ashr", ast.LShift: "shl"}
SAME = {
    ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul, ast.Div: operator.truediv,
    ast.Pow: operator.pow, ast.FloorDiv: operator.floordiv,
}  # fmt: skip


class Lowering:
    """The writer of one function."""

    def __init__(self, python: Any, tree: ast.FunctionDef, kind: FunctionKind, symbol: str, needs: Needs) -> None:
        self.python = python
        self.tree = tree
        self.kind = kind
        self.needs = needs
        self.code = Code(symbol)
        self.arrays = Arrays(self.code)
        self.node: ast.AST | None = None
        self.stored = stores(tree)
        self.values: dict[str, Value] = {}  # arguments, and what is assigned once and for all
        self.depth = -1  # of the blocks of statements
        self.variables: dict[str, Variable] = {}
        self.temporary: list[Value] = []  # values whose memory this statement releases
        self.loops: list[tuple[str, str]] = []  # blocks of continue and break
        self.left: set[str] = set()  # blocks of loops that are left by break
        self.calls: dict[Any, None] = {}
        self.routines: dict[Routine, None] = {}
        self.declared: dict[str, None] = {}
        self.positive = self._positive()
        self.result = [self.code.place(each) for each in registers(kind.gives)]

    # The function as a whole

    def written(self, inline: bool) -> Lowered:
        """Return its code."""
        takes, code = [], self.code
        names = self.python.__code__.co_varnames[: self.python.__code__.co_argcount]
        for name, kind in zip(names, self.kind.takes, strict=True):
            arguments = tuple(f"%{code.new('arg')}" for _ in registers(kind))
            takes += [f"{each} {register}" for each, register in zip(registers(kind), arguments, strict=True)]
            value = Value(kind, arguments)
            if name in self.stored:
                self.assign(name, value)
            else:
                self.values[name] = value
        self.body(self.tree.body)
        if not code.ended:
            if self.kind.gives is NONE:
                self.leave(Value(NONE, ()))
            else:
                code.do("unreachable")
        if "exit" in self.left:
            code.begin("exit")
            for name, variable in self.variables.items():
                if variable.counts:
                    for at in owners(variable.kind):
                        code.places.append(f"  store ptr null, ptr {variable.places[at]} ; {name}")
                    code.count_references("release", Value(variable.kind, self._slots(variable), lasting=False))
            given = [
                code.get(f"load {each}, ptr {place}")
                for each, place in zip(registers(self.kind.gives), self.result, strict=True)
            ]
            code.give(self.kind.gives, given)
        attributes = " alwaysinline" if inline else ""
        head = f"define internal {result(self.kind.gives)} @{code.symbol}({', '.join(takes)}){attributes} nounwind"
        return Lowered(code.text(head), tuple(self.calls), tuple(self.routines), tuple(self.declared))

    def leave(self, value: Value) -> None:
        """Return a value from the function: what it holds is released at its end."""
        fitting = self.fitted(value, self.kind.gives)
        found = self.code.loaded(fitting)
        self.own(self._moved(fitting, found))
        self.release_temporary(0)
        for place, each, register in zip(self.result, registers(found.kind), found.registers, strict=True):
            self.code.do(f"store {each} {register}, ptr {place}")
        self.code.go("exit")
        self.left.add("exit")

    def _moved(self, value: Value, found: Value) -> Value:
        """Give the place of a temporary value to its loaded form."""
        if value in self.temporary:
            self.temporary[self.temporary.index(value)] = found
        return found

    def _positive(self) -> set[str]:
        """Return the names that only loops over ranges of numbers that are not negative assign."""
        loops, others = dict[str, list[ast.Call]](), set[str]()
        for each in ast.walk(self.tree):
            if isinstance(each, ast.For) and isinstance(each.target, ast.Name) and isinstance(each.iter, ast.Call):
                if getattr(each.iter.func, "id", "") == "range":
                    loops.setdefault(each.target.id, []).append(each.iter)
                    continue
            if isinstance(each, ast.For):
                counted = isinstance(each.iter, ast.Call) and getattr(each.iter.func, "id", "") == "enumerate"
                names = set(stores(each.target))
                if counted and isinstance(each.target, ast.Tuple) and isinstance(each.target.elts[0], ast.Name):
                    loops.setdefault(each.target.elts[0].id, [])
                    names -= {each.target.elts[0].id}
                others |= names
            if isinstance(each, ast.Assign | ast.AugAssign | ast.AnnAssign):
                others |= set(stores(each))
        candidates = set(loops) - others
        while True:
            wrong = {
                name for name in candidates for call in loops[name] if not self._from_zero(call, candidates)
            }  # fmt: skip
            if not wrong:
                return candidates
            candidates -= wrong

    def _from_zero(self, call: ast.Call, candidates: set[str]) -> bool:
        """Return whether all numbers of a range are known not to be negative."""

        def positive(node: ast.expr) -> bool:
            match node:
                case ast.Constant(value=int(number)):
                    return number >= 0
                case ast.Name(id=name):
                    return name in candidates
                case ast.BinOp(left=left, op=ast.Add() | ast.Mult(), right=right):
                    return positive(left) and positive(right)
                case ast.Call(func=ast.Name(id="len")):
                    return True
                case ast.Subscript(value=ast.Attribute(attr="shape")):
                    return True
            return False

        match call.args:
            case [_]:
                return True
            case [start, _]:
                return positive(start)
            case [start, stop, ast.UnaryOp(op=ast.USub())]:
                return ast.unparse(stop) == "-1" or positive(stop)
            case [start, _, step]:
                return positive(start) and positive(step)
        return False

    # Variables and memory

    def _slots(self, variable: Variable) -> tuple[str, ...]:
        return tuple(f"*{place}" for place in variable.places)

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
            self.variables[name] = Variable(kind, places, name in self.needs.counting)
        variable = self.variables[name]
        if variable.kind != kind:
            wider = merged(variable.kind, kind)
            if wider != variable.kind:
                self.needs.kinds[name] = wider
                raise Again
        if owners(variable.kind) and not value.lasting and not variable.counts:
            self.needs.counting.add(name)
            raise Again
        value = self.fitted(value, variable.kind)
        found = self.code.loaded(value)
        if variable.counts:
            self.own(self._moved(value, found))
            self.code.count_references("release", Value(variable.kind, self._slots(variable), lasting=False))
        for place, kinds, register in zip(variable.places, registers(variable.kind), found.registers, strict=True):
            self.code.do(f"store {kinds} {register}, ptr {place}")

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

    # Statements

    def body(self, statements: Sequence[ast.stmt]) -> None:
        """Write statements."""
        self.depth += 1
        for each in statements:
            if self.code.ended:
                break
            self.node = each
            self.statement(each)
            if not self.code.ended:
                self.release_temporary(0)
            self.temporary.clear()
        self.depth -= 1

    def statement(self, node: ast.stmt) -> None:
        """Write a statement."""
        match node:
            case ast.Assign(targets=targets, value=value):
                found = self.term(value)
                if len(targets) > 1:
                    found = self.value(found)
                for target in targets:
                    self.write(target, found)
            case ast.AnnAssign(target=target, value=ast.expr() as value):
                self.write(target, self.term(value))
            case ast.AugAssign(target=target, op=op, value=value):
                self.augment(target, op, value)
            case ast.If(test=test, body=body, orelse=orelse):
                self.choice(test, body, orelse)
            case ast.For(target=target, iter=source, body=body):
                self.loop(target, source, body)
            case ast.While(test=test, body=body):
                self.repeat(test, body)
            case ast.Return(value=value):
                self.leave(self.value(self.term(value)) if value else Value(NONE, ()))
            case ast.Expr(value=ast.Constant()):
                pass
            case ast.Expr(value=value):
                self.term(value)
            case ast.Break() | ast.Continue():
                on, off = self.loops[-1]
                if isinstance(node, ast.Break):
                    self.left.add(off)
                self.code.go(off if isinstance(node, ast.Break) else on)
            case ast.Pass():
                pass
            case _:
                raise CompileError(f"there is no {type(node).__name__} in compiled code")

    def write(self, target: ast.expr, found: Term) -> None:
        """Write an assignment."""
        match target:
            case ast.Name(id=name):
                self.assign(name, self.value(found))
            case ast.Tuple(elts=targets):
                value = self.value(found)
                if isinstance(value.kind, ArrayKind):
                    parts = [self.element(value, [constant(i)]) for i in range(len(targets))]
                else:
                    parts = [self.item(value, i) for i in range(len(targets))]
                parts = [self.code.loaded(each) for each in parts]
                for each, part in zip(targets, parts, strict=True):
                    self.write(each, part)
            case ast.Subscript(value=base, slice=ast.Name() as places) if self.is_array(places):
                self.scatter(self.value(self.term(base)), self.value(self.term(places)), self.value(found))
            case ast.Subscript(value=base, slice=index):
                array = self.value(self.term(base))
                chosen = self.indices(array, index)
                if all(isinstance(each, str) for each in chosen):
                    self.store(array, chosen, self.value(found))
                else:
                    self.fill(self.arrays.view(array, chosen), found)
            case _:
                raise CompileError("nothing can be assigned to it")

    def store(self, array: Value, indices: Sequence[Any], value: Value) -> None:
        """Store an element."""
        assert isinstance(array.kind, ArrayKind)
        register = self.arrays.converted(value, array.kind.element)
        self.code.store(array.kind.element, self.arrays.address(array, indices), register)

    def is_array(self, node: ast.Name) -> bool:
        """Return whether a name is that of an array."""
        found = self.name(node.id)
        return isinstance(found, Value) and isinstance(found.kind, ArrayKind)

    def scatter(self, array: Value, places: Value, value: Value) -> None:
        """Store numbers at some places of an array of one axis."""
        assert isinstance(array.kind, ArrayKind)
        array, length = self.code.loaded(array), self.code.one(array, 1)
        given = self.arrays.elements(value)

        def write(indices: Sequence[str], place: Value) -> None:
            self.store(array, [self.index(place, length)], given.at(indices))

        self.arrays.over(self.arrays.elements(places), write)

    def fill(self, target: Value, found: Term) -> None:
        """Fill a part of an array."""
        if isinstance(found, Elements):
            found = self.value(found)  # the whole right side comes first: it may read what is written
        assert isinstance(found, Value)
        if isinstance(found.kind, ArrayKind):
            kind = target.kind
            if found.kind == kind and kind.axes == 1 and kind.order == "C":
                self.arrays.copy(found, target)
            else:
                self.arrays.fill(target, self.arrays.elements(found))
        else:
            self.arrays.fill(target, self.code.loaded(found))

    def augment(self, target: ast.expr, op: ast.operator, value: ast.expr) -> None:
        """Write an assignment such as x += y."""
        if isinstance(target, ast.Name):
            old = self.value(self.term(ast.Name(target.id, ast.Load())))
            new = self.binary(op, old, self.term(value))
            if isinstance(old.kind, ArrayKind):
                self.fill(old, new)
            else:
                self.assign(target.id, self.value(new))
            return
        assert isinstance(target, ast.Subscript)
        array = self.code.loaded(self.value(self.term(target.value)))
        assert isinstance(array.kind, ArrayKind)
        chosen = self.indices(array, target.slice)
        if not all(isinstance(each, str) for each in chosen):
            part = self.arrays.view(array, chosen)
            self.fill(part, self.binary(op, part, self.term(value)))
            return
        right = self.term(value)
        old = self.code.load(array.kind.element, self.arrays.address(array, chosen))
        self.store(array, chosen, self.value(self.binary(op, old, right)))

    def choice(self, test: ast.expr, body: Sequence[ast.stmt], orelse: Sequence[ast.stmt]) -> None:
        """Write an if statement."""
        code = self.code
        condition = self.truth(self.term(test))
        self.release_temporary(0)
        if condition in ("true", "false"):
            self.body(body if condition == "true" else orelse)
            return
        yes, no, end = (code.new(each) for each in ("then", "else", "end"))
        code.branch(condition, yes, no if orelse else end)
        code.begin(yes)
        self.body(body)
        reached = not orelse or not code.ended
        if not code.ended:
            code.go(end)
        if orelse:
            code.begin(no)
            self.body(orelse)
            reached = reached or not code.ended
            if not code.ended:
                code.go(end)
        if reached:
            code.begin(end)

    def repeat(self, test: ast.expr, body: Sequence[ast.stmt]) -> None:
        """Write a while loop."""
        code = self.code
        head, inside, end = (code.new(each) for each in ("head", "body", "end"))
        code.go(head)
        code.begin(head)
        condition = self.truth(self.term(test))
        self.release_temporary(0)
        if condition == "true":
            code.go(inside)
        else:
            code.branch(condition, inside, end)
            self.left.add(end)
        code.begin(inside)
        self.loops.append((head, end))
        self.body(body)
        self.loops.pop()
        if not code.ended:
            code.go(head)
        if end in self.left:
            code.begin(end)

    def loop(self, target: ast.expr, source: ast.expr, body: Sequence[ast.stmt]) -> None:
        """Write a for loop."""
        match source:
            case ast.Call(func=ast.Name(id="range"), args=limits):
                self.count(target, [self.value(self.term(each)) for each in limits], body)
            case ast.Call(func=ast.Name(id="enumerate"), args=[each]):
                self.over(target, self.value(self.term(each)), body, numbered=True)
            case _:
                self.over(target, self.value(self.term(source)), body)

    def count(self, target: ast.expr, limits: Sequence[Value], body: Sequence[ast.stmt]) -> None:
        """Write a loop over a range."""
        code = self.code
        numbers = [self.arrays.converted(each, WHOLE) for each in limits]
        self.release_temporary(0)
        first, stop = ("0", numbers[0]) if len(numbers) == 1 else numbers[:2]
        step = numbers[2] if len(numbers) > 2 else "1"
        place = code.place("i64")
        head, inside, on, end = (code.new(each) for each in ("head", "body", "next", "end"))
        code.do(f"store i64 {first}, ptr {place}")
        code.go(head)
        code.begin(head)
        i = code.get(f"load i64, ptr {place}")
        if step.lstrip("-").isdigit():
            more = code.get(f"icmp {'slt' if int(step) > 0 else 'sgt'} i64 {i}, {stop}")
        else:
            up, down = (code.get(f"icmp {each} i64 {i}, {stop}") for each in ("slt", "sgt"))
            more = code.select(code.get(f"icmp sgt i64 {step}, 0"), "i1", up, down)
        code.branch(more, inside, end)
        code.begin(inside)
        self.depth += 1
        self.write(target, Value(WHOLE, (i,)))
        self.depth -= 1
        self.loops.append((on, end))
        self.body(body)
        self.loops.pop()
        if not code.ended:
            code.go(on)
        code.begin(on)
        code.do(f"store i64 {code.get(f'add nsw i64 {i}, {step}')}, ptr {place}")
        code.go(head)
        code.begin(end)

    def over(self, target: ast.expr, source: Value, body: Sequence[ast.stmt], numbered: bool = False) -> None:
        """Write a loop over the items of a tuple, or over an array."""
        code = self.code
        self.depth += 1
        numbers, targets = target.elts if numbered and isinstance(target, ast.Tuple) else [None, target]
        hidden = f".{code.new('source')}"
        self.needs.counting.add(hidden)
        self.assign(hidden, source)
        self.release_temporary(0)
        source = code.loaded(Value(source.kind, self._slots(self.variables[hidden]), lasting=False))
        if isinstance(source.kind, TupleKind):
            end = code.new("end")
            for i in range(len(source.kind.items)):
                on = code.new("next")
                if numbers is not None:
                    self.write(numbers, constant(i))
                assert targets is not None
                self.write(targets, self.item(source, i))
                self.loops.append((on, end))
                self.body(body)
                self.loops.pop()
                if not code.ended:
                    code.go(on)
                code.begin(on)
            code.go(end)
            code.begin(end)
            self.depth -= 1
            return
        array = source
        place = code.place("i64")
        head, inside, on, end = (code.new(each) for each in ("head", "body", "next", "end"))
        code.do(f"store i64 0, ptr {place}")
        code.go(head)
        code.begin(head)
        at = code.get(f"load i64, ptr {place}")
        code.branch(code.get(f"icmp slt i64 {at}, {code.one(array, 1)}"), inside, end)
        code.begin(inside)
        index = Value(WHOLE, (at,), positive=True)
        if numbers is not None:
            self.write(numbers, index)
        assert targets is not None
        self.write(targets, self.element(array, [index]))
        self.loops.append((on, end))
        self.body(body)
        self.loops.pop()
        if not code.ended:
            code.go(on)
        code.begin(on)
        code.do(f"store i64 {code.get(f'add nsw i64 {at}, 1')}, ptr {place}")
        code.go(head)
        code.begin(end)
        self.depth -= 1

    # Expressions

    def value(self, term: Term) -> Value:
        """Return a term as a value."""
        if isinstance(term, Elements):
            return self.made(self.arrays.kept(term))
        if isinstance(term, Known):
            return self.function_value(term.thing)
        return term

    def function_value(self, thing: Any) -> Value:
        """Return a compiled function as a value."""
        if not hasattr(thing, "declared"):
            raise CompileError(f"{thing!r} is no value")
        self.calls[thing] = None
        return Value(thing.declared, (f"@{thing.symbol}",))

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
                return self.binary(op, self.term(left), self.term(right))
            case ast.Compare(left=left, ops=ops, comparators=others):
                return self.comparison(left, ops, others)
            case ast.BoolOp(op=op, values=operands):
                return self.connected(isinstance(op, ast.And), operands)
            case ast.IfExp(test=test, body=body, orelse=orelse):
                return self.either(test, body, orelse)
            case ast.Call(func=function, args=arguments, keywords=named):
                return self.call(function, arguments, named)
        raise CompileError(f"there is no {type(node).__name__} in compiled code: {ast.unparse(node)}")

    def name(self, name: str) -> Term:
        """Return what a name stands for."""
        if name in self.values:
            return self.values[name]
        if name in self.variables:
            variable = self.variables[name]
            return Value(variable.kind, self._slots(variable), not variable.counts, name in self.positive)
        if name in self.stored:
            raise CompileError(f"{name} has no value yet")
        names = dict(zip(self.python.__code__.co_freevars, self.python.__closure__ or (), strict=True))
        if name in names:
            return self.thing(names[name].cell_contents)
        if name in self.python.__globals__:
            return self.thing(self.python.__globals__[name])
        return Known(getattr(builtins, name))

    def thing(self, thing: Any) -> Term:
        """Return a part of the program as a term."""
        if isinstance(thing, bool | int | float | IntEnum | np.integer | np.floating):
            return constant(int(thing) if isinstance(thing, IntEnum | np.integer) else thing)  # type: ignore[arg-type]
        if isinstance(thing, tuple) and all(isinstance(each, bool | int | float) for each in thing):
            return self.tuple([constant(each) for each in thing])
        return Known(thing)

    def attribute(self, base: Term, name: str) -> Term:
        """Return an attribute of a term."""
        if isinstance(base, Known):
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

    def indices(self, array: Value, node: ast.expr) -> list[Any]:
        """Return what of each axis of an array is chosen: a place, a part, or None for all of it."""
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

    def element(self, array: Value, indices: Sequence[Value]) -> Value:
        """Return an element of an array, or a part of it where there are fewer indices than axes."""
        assert isinstance(array.kind, ArrayKind)
        chosen: list[Any] = [self.index(each, self.code.one(array, 1 + i)) for i, each in enumerate(indices)]
        if len(chosen) == array.kind.axes:
            return self.code.load(array.kind.element, self.arrays.address(array, chosen))
        return self.arrays.view(array, [*chosen, *[None] * (array.kind.axes - len(chosen))])

    def subscript(self, base: Term, node: ast.expr) -> Term:
        """Return an item, an element or a part of a term."""
        if isinstance(base, Known):
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
            if isinstance(places, Elements) or (isinstance(places, Value) and isinstance(places.kind, ArrayKind)):
                return self.gathered(array, places)
            return self.element(array, [self.value(places)])
        chosen = self.indices(array, node)
        if all(isinstance(each, str) for each in chosen):
            return self.code.load(array.kind.element, self.arrays.address(array, chosen))
        return self.arrays.view(array, chosen)

    def chosen_item(self, base: Value, index: Value) -> Value:
        """Return the item of a tuple of numbers at a place that is not known."""
        assert isinstance(base.kind, TupleKind)
        kind = base.kind.items[0]
        found = self.code.one(self.item(base, 0))
        for i in range(1, len(base.kind.items)):
            here = self.code.get(f"icmp eq i64 {self.code.one(index)}, {i}")
            found = self.code.select(here, registers(kind)[0], self.code.one(self.item(base, i)), found)
        return Value(kind, (found,))

    def gathered(self, array: Value, places: Term) -> Elements:
        """Return the elements of an array at some places, or where a condition holds."""
        assert isinstance(array.kind, ArrayKind)
        some = places if isinstance(places, Elements) else self.arrays.elements(self.value(places))
        if some.element is FLAG:
            some = self.arrays.elements(self.where(some))
        own = self.arrays.elements(array)

        def at(indices: Sequence[str]) -> Value:
            return own.at([self.index(some.at(indices[:1]), own.lengths[0]), *indices[1:]])

        return Elements(own.element, (*some.lengths, *own.lengths[1:]), at)

    def where(self, flags: Elements) -> Value:
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
        data, _, owner = found.registers
        n = code.get(f"load i64, ptr {count}")
        return self.made(Value(found.kind, (data, n, owner), lasting=False))

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
        found = list[Elements | Value]()
        for each in operands:
            if isinstance(each, Value) and isinstance(each.kind, ArrayKind):
                found.append(self.arrays.elements(each))
            else:
                found.append(each if isinstance(each, Elements) else self.code.loaded(self.value(each)))
        if any(isinstance(each, Elements) for each in found):
            return self.arrays.by_element(operation, *found)
        return operation(*found)

    def unary(self, op: ast.unaryop, operand: Term) -> Term:
        """Return an operation on one term."""
        code = self.code

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
            if isinstance(op, ast.Invert) and value.kind is FLAG:
                return Value(FLAG, (code.get(f"xor i1 {register}, true"),))
            if isinstance(op, ast.UAdd):
                return value
            raise CompileError("there is no such operation")

        if isinstance(op, ast.Not) and isinstance(operand, Value) and not isinstance(operand.kind, ArrayKind):
            return apply(operand)
        return self.by_element(apply, operand)

    def binary(self, op: ast.operator, left: Term, right: Term) -> Term:
        """Return an operation on two terms."""
        if isinstance(op, ast.MatMult):
            return self.product(self.value(left), self.value(right))
        return self.by_element(lambda a, b: self.arithmetic(op, a, b), left, right)

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
        """Return the quotient of whole numbers, rounded down, or what is left."""
        code = self.code
        if not known:
            zero = code.get(f"icmp eq i64 {y}, 0")
            y = code.select(zero, "i64", "1", y)
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
        """Return what is left of x divided by y, with the sign of y."""
        code = self.code
        r = code.get(f"frem double {x}, {y}")
        some = code.get(f"fcmp une double {r}, 0.0")
        below = code.get(f"fcmp olt double {r}, 0.0")
        wanted = code.get(f"fcmp olt double {y}, 0.0")
        opposed = code.get(f"and i1 {some}, {code.get(f'xor i1 {below}, {wanted}')}")
        return code.select(opposed, "double", code.get(f"fadd double {r}, {y}"), r)

    def c_function(self, name: str, *operands: str) -> str:
        """Return a function of C, or of LLVM, of real numbers."""
        takes = ", ".join(["double"] * len(operands))
        self.declared[f"declare double @{name}({takes})"] = None
        return self.code.get(f"call double @{name}({', '.join(f'double {each}' for each in operands)})")

    def compared(self, op: ast.cmpop, a: Value, b: Value) -> Value:
        """Return a comparison of two numbers."""
        whole, real = ORDER[type(op)].split()
        if a.known is not None and b.known is not None:
            python = {"slt": operator.lt, "sle": operator.le, "sgt": operator.gt, "sge": operator.ge, "eq": operator.eq}
            return constant(bool(python.get(whole, operator.ne)(a.known, b.known)))
        if REAL in (a.kind, b.kind):
            x, y = self.arrays.converted(a, REAL), self.arrays.converted(b, REAL)
            return Value(FLAG, (self.code.get(f"fcmp {real} double {x}, {y}"),))
        if a.kind is FLAG and b.kind is FLAG and whole in ("eq", "ne"):
            return Value(FLAG, (self.code.get(f"icmp {whole} i1 {self.code.one(a)}, {self.code.one(b)}"),))
        x, y = self.arrays.converted(a, WHOLE), self.arrays.converted(b, WHOLE)
        return Value(FLAG, (self.code.get(f"icmp {whole} i64 {x}, {y}"),))

    def comparison(self, left: ast.expr, ops: Sequence[ast.cmpop], others: Sequence[ast.expr]) -> Term:
        """Return a comparison, of which a < b < c is a < b and b < c."""
        a = self.term(left)
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

    def among(self, value: Value, items: Value) -> Value:
        """Return whether a number is one of a tuple."""
        assert isinstance(items.kind, TupleKind)
        found = "false"
        for i in range(len(items.kind.items)):
            same = self.code.one(self.compared(ast.Eq(), value, self.item(items, i)))
            found = self.code.get(f"or i1 {found}, {same}")
        return Value(FLAG, (found,))

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
                found = self.truth(self.term(each))
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
        yes, no, end = (code.new(each) for each in ("then", "else", "end"))
        code.branch(condition, yes, no)
        for block, node in ((yes, body), (no, orelse)):
            code.begin(block)
            with self.inside():
                given = self.fitted(self.value(self.term(node)), kind)
                found = code.loaded(given)
                if owners(kind):
                    self.own(self._moved(given, found))
                for place, each, register in zip(places, registers(kind), found.registers, strict=True):
                    code.do(f"store {each} {register}, ptr {place}")
            code.go(end)
        code.begin(end)
        return self.made(code.loaded(Value(kind, tuple(f"*{each}" for each in places), lasting=not owners(kind))))

    def kind_of(self, node: ast.expr) -> Kind:
        """Return the type of an expression, by writing it and throwing that away."""
        code = self.code
        lines, places = len(code.lines), len(code.places)
        block, ended, made = code.block, code.ended, list(self.temporary)
        kind = self.value(self.term(node)).kind
        del code.lines[lines:], code.places[places:]
        code.block, code.ended, self.temporary = block, ended, made
        return kind

    # Calls

    def call(self, function: ast.expr, arguments: Sequence[ast.expr], named: Sequence[ast.keyword]) -> Term:
        """Return the result of a call."""
        if isinstance(function, ast.Attribute):
            base = self.term(function.value)
            if not isinstance(base, Known):
                given = [self.term(each) for each in arguments]
                return self.method(base, function.attr, given, {each.arg: self.term(each.value) for each in named})
            called: Term = self.thing(getattr(base.thing, function.attr))
        else:
            called = self.term(function)
        given = [self.term(each) for each in arguments]
        words = {str(each.arg): self.term(each.value) for each in named}
        if isinstance(called, Value) and isinstance(called.kind, FunctionKind):
            return self.called(called.kind, self.code.one(called), given)
        assert isinstance(called, Known)
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
                lengths = [self.item(lengths[0], i) for i in range(len(lengths[0].kind.items))]  # type: ignore
            return self.arrays.reshaped(value, [self.code.one(self.value(each)) for each in lengths])
        elements = base if isinstance(base, Elements) else self.arrays.elements(self.value(base))
        return self.reduced(name, elements)

    def reduced(self, name: str, elements: Elements) -> Value:
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
            return Value(WHOLE, (code.get(f"load i64, ptr {at}"),), positive=True)
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
        if isinstance(dtype, Known):
            element = STORED[np.dtype(dtype.thing).name]
        assert isinstance(element, Scalar)
        shape_of = [self.arrays.converted(each, WHOLE) for each in lengths]
        found = self.code.allocate(ArrayKind(element, len(lengths)), shape_of, zero)
        if fill is not None:
            self.arrays.fill(found, fill)
        return self.made(found)

    def product(self, A: Value, B: Value) -> Value:
        """Return the product of matrices, or of a matrix and a vector, by BLAS."""
        from lcpimpact.compiler.blas import product

        return product(self, A, B)

    def contiguous(self, array: Value) -> Value:
        """Return an array in C order, itself or a new one."""
        assert isinstance(array.kind, ArrayKind)
        return array if array.kind.order == "C" else self.value(self.arrays.elements(array))


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


# What the functions of Python, of its module math and of NumPy are


def _extreme(largest: bool) -> Callable[..., Term]:
    def found(writer: Lowering, *given: Term) -> Term:
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
            return writer.reduced("max" if largest else "min", writer.arrays.elements(writer.value(given[0])))
        values = [writer.code.loaded(writer.value(each)) for each in given]
        result = values[0]
        for each in values[1:]:
            result = better(result, each)
        return result

    return found


def _absolute(writer: Lowering, given: Term) -> Term:
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

    def found(writer: Lowering, *given: Term) -> Term:
        def apply(*values: Value) -> Value:
            return Value(REAL, (writer.c_function(name, *(writer.arrays.converted(each, REAL) for each in values)),))

        return writer.by_element(apply, *given)

    return found


def _sign(writer: Lowering, given: Term) -> Term:
    def apply(value: Value) -> Value:
        x, code = writer.arrays.converted(value, REAL), writer.code
        above, below = code.get(f"fcmp ogt double {x}, 0.0"), code.get(f"fcmp olt double {x}, 0.0")
        zero = code.get(f"fcmp oeq double {x}, 0.0")
        found = code.select(zero, "double", "0.0", x)
        return Value(REAL, (code.select(above, "double", "1.0", code.select(below, "double", "-1.0", found)),))

    return writer.by_element(apply, given)


def _not_a_number(writer: Lowering, given: Term) -> Term:
    def apply(value: Value) -> Value:
        x = writer.arrays.converted(value, REAL)
        return Value(FLAG, (writer.code.get(f"fcmp uno double {x}, {x}"),))

    return writer.by_element(apply, given)


def _is_finite(writer: Lowering, given: Term) -> Term:
    def apply(value: Value) -> Value:
        x = writer.c_function("llvm.fabs.f64", writer.arrays.converted(value, REAL))
        return Value(FLAG, (writer.code.get(f"fcmp olt double {x}, 0x7FF0000000000000"),))

    return writer.by_element(apply, given)


def _whole(writer: Lowering, given: Term) -> Value:
    value = writer.value(given)
    if value.kind is REAL:
        return Value(WHOLE, (writer.code.get(f"fptosi double {writer.code.one(value)} to i64"),))
    return Value(WHOLE, (writer.arrays.converted(value, WHOLE),), positive=value.positive)


def _floor(writer: Lowering, given: Term) -> Value:
    x = writer.c_function("llvm.floor.f64", writer.arrays.converted(writer.value(given), REAL))
    return Value(WHOLE, (writer.code.get(f"fptosi double {x} to i64"),))


def _length(writer: Lowering, given: Term) -> Value:
    value = writer.value(given)
    if isinstance(value.kind, TupleKind):
        return constant(len(value.kind.items))
    return Value(WHOLE, (writer.code.one(value, 1),), positive=True)


def _frexp(writer: Lowering, given: Term) -> Value:
    code, x = writer.code, writer.arrays.converted(writer.value(given), REAL)
    place = code.place("i32")
    writer.declared["declare double @frexp(double, ptr)"] = None
    part = code.get(f"call double @frexp(double {x}, ptr {place})")
    power = code.get(f"sext i32 {code.get(f'load i32, ptr {place}')} to i64")
    return writer.tuple([Value(REAL, (part,)), Value(WHOLE, (power,))])


def _ldexp(writer: Lowering, number: Term, power: Term) -> Value:
    code = writer.code
    x, n = writer.arrays.converted(writer.value(number), REAL), writer.arrays.converted(writer.value(power), WHOLE)
    writer.declared["declare double @ldexp(double, i32)"] = None
    return Value(REAL, (code.get(f"call double @ldexp(double {x}, i32 {code.get(f'trunc i64 {n} to i32')})"),))


def _arange(writer: Lowering, count: Term) -> Elements:
    n = writer.arrays.converted(writer.value(count), WHOLE)
    return Elements(WHOLE, (n,), lambda indices: Value(WHOLE, (indices[0],), positive=True))


def _like(writer: Lowering, array: Term, fill: Term | None = None) -> Value:
    value = writer.value(array)
    assert isinstance(value.kind, ArrayKind)
    lengths = [axis.length for axis in writer.arrays.axes(value)]
    found = writer.code.allocate(ArrayKind(value.kind.element, value.kind.axes), lengths)
    if fill is not None:
        writer.arrays.fill(found, writer.code.loaded(writer.value(fill)))
    return writer.made(found)


def _into(op: ast.operator) -> Callable[..., Term]:
    def found(writer: Lowering, left: Term, right: Term, out: Term) -> Term:
        target, elements = writer.value(out), writer.binary(op, left, right)
        writer.arrays.fill(target, elements)  # type: ignore[arg-type]
        return target

    return found


def _where(writer: Lowering, flags: Term) -> Value:
    return writer.where(flags if isinstance(flags, Elements) else writer.arrays.elements(writer.value(flags)))


def _reduction(name: str) -> Callable[..., Value]:
    def found(writer: Lowering, array: Term) -> Value:
        return writer.reduced(
            name, array if isinstance(array, Elements) else writer.arrays.elements(writer.value(array))
        )

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
    np.flatnonzero: _where,
    np.asarray: lambda writer, array: writer.value(array),
    np.ascontiguousarray: lambda writer, array: writer.contiguous(writer.value(array)),
    np.multiply: _into(ast.Mult()),
    np.add: _into(ast.Add()),
    np.sum: _reduction("sum"),
    np.argmax: _reduction("argmax"),
    np.sign: _sign,
    np.isnan: _not_a_number,
    math.isfinite: _is_finite,
    math.floor: _floor,
    math.frexp: _frexp,
    math.ldexp: _ldexp,
    math.exp: _real("exp"),
    math.log: _real("log"),
    **dict.fromkeys((abs, np.abs), _absolute),
    **dict.fromkeys((math.sqrt, np.sqrt), _real("llvm.sqrt.f64")),
    math.copysign: _real("llvm.copysign.f64"),
    np.floor: _real("llvm.floor.f64"),
}  # fmt: skip
"""What compiled code knows of Python, its module math and NumPy."""
