"""The code of a Python function for declared types: its statements, one after the other, as instructions of LLVM.

The language is what numerical loops need: numbers, arrays, tuples and named tuples, loops, conditions, and calls of other
compiled functions. Each operation rounds as in the interpreter, and none is moved or left out for speed.
"""

from __future__ import annotations

import ast
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

from lcpimpact.compiler.code import Value, constant, result
from lcpimpact.compiler.kinds import FLAG, NONE, WHOLE, ArrayKind, FunctionKind, TupleKind, owners, registers
from lcpimpact.compiler.routines import Routine
from lcpimpact.compiler.source import never_negative, source_of, stores
from lcpimpact.compiler.terms import Expressions
from lcpimpact.compiler.writer import CompileError, Needs, Term


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


@cache
def lower(python: Any, kind: FunctionKind, symbol: str, inline: bool) -> Lowered:
    """Return the code of a function with a type.

    Raises
    ------
    CompileError
        If it says what compiled code has no words for.
    """
    tree, needs = source_of(python), Needs(more=True)
    stored, positive = stores(tree), never_negative(tree)
    while needs.more:
        needs.more = False
        writer = Lowering(python, stored, positive, kind, symbol, needs)
        try:
            found = writer.written(tree, inline)
        except (TypeError, KeyError, AttributeError, ValueError, AssertionError, NotImplementedError) as error:
            line = getattr(writer.node, "lineno", 0) + python.__code__.co_firstlineno - 1
            what = ast.unparse(writer.node) if writer.node else ""
            place = f"{python.__code__.co_filename}:{line}"
            raise CompileError(f"{place}: {python.__qualname__}: {what[:80]}: {error}") from error
    return found


class Lowering(Expressions):
    """The writer of the statements of a function."""

    def written(self, tree: ast.FunctionDef, inline: bool) -> Lowered:
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
        self.body(tree.body)
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
                    code.count_references("release", self.held(variable))
            gives = self.kind.gives
            code.give(gives, code.read(Value(gives, tuple(f"*{place}" for place in self.result))))
        attributes = " alwaysinline" if inline else ""
        head = f"define internal {result(self.kind.gives)} @{code.symbol}({', '.join(takes)}){attributes} nounwind"
        return Lowered(code.text(head), tuple(self.calls), tuple(self.routines), tuple(self.declared))

    def leave(self, value: Value) -> None:
        """Return a value from the function: what it holds is released at its end."""
        fitting = self.fitted(value, self.kind.gives)
        found = self.code.loaded(fitting)
        self.own(self._moved(fitting, found))
        self.release_temporary(0)
        self.code.keep(self.result, found)
        self.code.go("exit")
        self.left.add("exit")

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
            case ast.For(target=target, iter=source, body=body, orelse=[]):
                self.loop(target, source, body)
            case ast.While(test=test, body=body, orelse=[]):
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
                self.scatter(self.value(self.term(base)), self.value(self.term(places)), self.apart(found))
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
        if isinstance(places.kind, ArrayKind) and places.kind.element is FLAG:
            places = self.where(self.arrays.elements(places))
        places = self.apart(places) if places.kind == array.kind else places
        given = self.arrays.elements(value)

        def write(indices: Sequence[str], place: Value) -> None:
            self.store(array, [self.index(place, length)], given.at(indices))

        self.arrays.over(self.arrays.elements(places), write)

    def fill(self, target: Value, found: Term) -> None:
        """Fill a part of an array."""
        kind = target.kind
        assert isinstance(kind, ArrayKind)
        if isinstance(found, Value) and found.kind == kind and kind.order == "C":
            self.arrays.copy(found, target)
            return
        value = self.apart(found)
        self.arrays.fill(target, self.arrays.elements(value) if isinstance(value.kind, ArrayKind) else value)

    def apart(self, found: Term) -> Value:
        """Return a number, or an array that shares no memory with what is written."""
        if isinstance(found, Value) and isinstance(found.kind, ArrayKind):
            return self.value(self.arrays.elements(found))
        return self.code.loaded(self.value(found))

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
        yes, no = code.new("then"), code.new("else")
        end = code.new("end")
        code.branch(condition, yes, no if orelse else end)
        code.begin(yes)
        self.body(body)
        reached = not orelse or not code.ended
        code.go(end)
        if orelse:
            code.begin(no)
            self.body(orelse)
            reached = reached or not code.ended
            code.go(end)
        if reached:
            code.begin(end)

    def repeat(self, test: ast.expr, body: Sequence[ast.stmt]) -> None:
        """Write a while loop."""
        code = self.code
        head, inside = code.new("head"), code.new("body")
        end = code.new("end")
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

        def more(i: str) -> str:
            if step.lstrip("-").isdigit():
                return code.get(f"icmp {'slt' if int(step) > 0 else 'sgt'} i64 {i}, {stop}")
            up, down = (code.get(f"icmp {each} i64 {i}, {stop}") for each in ("slt", "sgt"))
            return code.select(code.get(f"icmp sgt i64 {step}, 0"), "i1", up, down)

        with code.turns(first, step, more) as (i, on, end):
            self.turn([(target, Value(WHOLE, (i,)))], body, (on, end))

    def turn(self, given: Sequence[tuple[ast.expr, Value]], body: Sequence[ast.stmt], blocks: tuple[str, str]) -> None:
        """Write one turn of a loop, with the values of its targets, and the blocks of the next turn and the end."""
        self.depth += 1
        for target, value in given:
            self.write(target, value)
        self.loops.append(blocks)
        self.body(body)
        self.loops.pop()
        self.depth -= 1

    def over(self, target: ast.expr, source: Value, body: Sequence[ast.stmt], numbered: bool = False) -> None:
        """Write a loop over the items of a tuple, or over an array."""
        code = self.code
        hidden = f".{code.new('source')}"
        self.needs.counting.add(hidden)
        self.assign(hidden, source)
        self.release_temporary(0)
        source = code.loaded(self.held(self.variables[hidden]))

        def given(index: Value, item: Value) -> list[tuple[ast.expr, Value]]:
            if not numbered:
                return [(target, item)]
            assert isinstance(target, ast.Tuple)
            return [(target.elts[0], index), (target.elts[1], item)]

        if isinstance(source.kind, TupleKind):
            end = code.new("end")
            for i in range(len(source.kind.items)):
                on = code.new("next")
                self.turn(given(constant(i), self.item(source, i)), body, (on, end))
                code.go(on)
                code.begin(on)
            code.go(end)
            code.begin(end)
            return
        length = code.one(source, 1)
        with code.turns("0", "1", lambda i: code.get(f"icmp slt i64 {i}, {length}")) as (at, on, end):
            index = Value(WHOLE, (at,), positive=True)
            self.turn(given(index, self.element(source, [index])), body, (on, end))
