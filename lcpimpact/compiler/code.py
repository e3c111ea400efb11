"""The text of a function in LLVM's language while it is written: instructions, blocks, loops and memory."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from lcpimpact.compiler.kinds import FLAG, REAL, WHOLE, ArrayKind, Kind, Scalar, owners, registers

RUNTIME = """
declare noalias ptr @PyMem_RawMalloc(i64)
declare void @PyMem_RawFree(ptr)
declare void @Py_FatalError(ptr) noreturn cold
@no_memory = private constant [42 x i8] c"compiled code has no memory for an array\\0a\\00"
define internal ptr @allocate(i64 %size) alwaysinline {
  %all = add i64 %size, 64
  %wrong = icmp slt i64 %size, 0
  %asked = select i1 %wrong, i64 -1, i64 %all
  %block = call ptr @PyMem_RawMalloc(i64 %asked)
  %none = icmp eq ptr %block, null
  br i1 %none, label %end, label %found
end:
  call void @Py_FatalError(ptr @no_memory)
  unreachable
found:
  store i64 1, ptr %block
  ret ptr %block
}
define internal void @hold(ptr %owner) alwaysinline {
  %none = icmp eq ptr %owner, null
  br i1 %none, label %end, label %count
count:
  %n = load i64, ptr %owner
  %more = add i64 %n, 1
  store i64 %more, ptr %owner
  br label %end
end:
  ret void
}
define internal void @release(ptr %owner) alwaysinline {
  %none = icmp eq ptr %owner, null
  br i1 %none, label %end, label %count
count:
  %n = load i64, ptr %owner
  %less = sub i64 %n, 1
  store i64 %less, ptr %owner
  %last = icmp eq i64 %less, 0
  br i1 %last, label %free, label %end
free:
  call void @PyMem_RawFree(ptr %owner)
  br label %end
end:
  ret void
}
declare void @llvm.memset.p0.i64(ptr, i8, i64, i1)
declare void @llvm.memmove.p0.p0.i64(ptr, ptr, i64, i1)
"""
"""Memory of arrays: the count of references to it, in the first of 32 bytes, and its numbers behind them."""


@dataclass(frozen=True, eq=False)
class Value:
    """A value: its type and its registers. One that begins with ``*`` is still to be loaded from the address in it.

    Attributes
    ----------
    kind : Kind
    registers : tuple of str
    lasting : bool              whether its memory outlives the call, as that of arguments
    positive : bool             whether it is a whole number that is not negative
    known : object              the number itself, if it is known
    """

    kind: Kind
    registers: tuple[str, ...]
    lasting: bool = True
    positive: bool = False
    known: Any = None


def constant(number: float) -> Value:
    """Return a number or a truth value of the source."""
    if isinstance(number, bool):
        return Value(FLAG, ("true" if number else "false",), known=number)
    if isinstance(number, int):
        return Value(WHOLE, (str(int(number)),), positive=number >= 0, known=number)
    return Value(REAL, (f"0x{struct.pack('>d', number).hex()}",), known=float(number))


class Code:
    """The text of a function.

    Parameters
    ----------
    symbol : str
    """

    def __init__(self, symbol: str) -> None:
        self.symbol = symbol
        self.lines: list[str] = []
        self.places: list[str] = []  # of the variables, in the first block
        self.count = 0
        self.ended = False  # whether control does not pass the last line

    def new(self, stem: str = "t") -> str:
        """Return a new name."""
        self.count += 1
        return f"{stem}.{self.count}"

    def do(self, text: str) -> None:
        """Write an instruction without a result."""
        if not self.ended:
            self.lines.append(f"  {text}")

    def get(self, text: str) -> str:
        """Write an instruction and return its result."""
        name = f"%{self.new()}"
        self.do(f"{name} = {text}")
        return name

    def begin(self, block: str) -> None:
        """Begin a block."""
        self.lines.append(f"{block}:")
        self.ended = False

    def go(self, block: str) -> None:
        """Go to a block, if this place is reached."""
        self.do(f"br label %{block}")
        self.ended = True

    def branch(self, condition: str, yes: str, no: str) -> None:
        """Go to one of two blocks."""
        self.do(f"br i1 {condition}, label %{yes}, label %{no}")
        self.ended = True

    def place(self, register: str) -> str:
        """Return the address of a new variable."""
        name = f"%{self.new('place')}"
        self.places.append(f"  {name} = alloca {register}")
        return name

    def keep(self, places: Sequence[str], value: Value) -> None:
        """Store the registers of a value at places."""
        for place, each, register in zip(places, registers(value.kind), self.read(value), strict=True):
            self.do(f"store {each} {register}, ptr {place}")

    def read(self, value: Value) -> tuple[str, ...]:
        """Return the registers of a value, loaded."""
        kinds = registers(value.kind)
        return tuple(
            self.get(f"load {kind}, ptr {each[1:]}") if each[0] == "*" else each
            for kind, each in zip(kinds, value.registers, strict=True)
        )

    def one(self, value: Value, at: int = 0) -> str:
        """Return one register of a value."""
        each = value.registers[at]
        return self.get(f"load {registers(value.kind)[at]}, ptr {each[1:]}") if each[0] == "*" else each

    def loaded(self, value: Value) -> Value:
        """Return a value that no later assignment changes."""
        return Value(value.kind, self.read(value), value.lasting, value.positive, value.known)

    def whole(self, operation: str, a: str, b: str) -> str:
        """Return the result of an operation on two whole numbers, which may be known."""
        if a.lstrip("-").isdigit() and b.lstrip("-").isdigit() and operation in ("add", "sub", "mul"):
            x, y = int(a), int(b)
            return str({"add": x + y, "sub": x - y, "mul": x * y}[operation])
        if (operation, b) in (("mul", "1"), ("add", "0"), ("sub", "0")):
            return a
        if (operation, a) in (("mul", "1"), ("add", "0")):
            return b
        return self.get(f"{operation} i64 {a}, {b}")

    def select(self, condition: str, register: str, yes: str, no: str) -> str:
        """Return one of two registers."""
        return yes if yes == no else self.get(f"select i1 {condition}, {register} {yes}, {register} {no}")

    @contextmanager
    def turns(self, first: str, step: str, more: Callable[[str], str]) -> Iterator[tuple[str, str, str]]:
        """Write a loop over whole numbers from the first on, while a condition holds.

        Yields the number, and the blocks to go on with the next and to end the loop.
        """
        place = self.place("i64")
        head, body = self.new("head"), self.new("body")
        on, end = self.new("next"), self.new("end")
        self.do(f"store i64 {first}, ptr {place}")
        self.go(head)
        self.begin(head)
        i = self.get(f"load i64, ptr {place}")
        self.branch(more(i), body, end)
        self.begin(body)
        yield i, on, end
        self.go(on)
        self.begin(on)
        self.do(f"store i64 {self.get(f'add nsw i64 {i}, {step}')}, ptr {place}")
        self.go(head)
        self.begin(end)

    @contextmanager
    def each(self, count: str) -> Iterator[str]:
        """Write a loop over the whole numbers from zero to a count."""
        with self.turns("0", "1", lambda i: self.get(f"icmp slt i64 {i}, {count}")) as (i, _, _):
            yield i

    @contextmanager
    def draft(self) -> Iterator[None]:
        """Write something to see its type, and throw it away."""
        lines, places = len(self.lines), len(self.places)
        ended = self.ended
        yield
        del self.lines[lines:], self.places[places:]
        self.ended = ended

    @contextmanager
    def where(self, condition: str) -> Iterator[None]:
        """Write what is done under a condition."""
        body, end = self.new("then"), self.new("end")
        self.branch(condition, body, end)
        self.begin(body)
        yield
        self.go(end)
        self.begin(end)

    def call(self, function: str, gives: Kind, arguments: Sequence[tuple[str, str]]) -> Value:
        """Call a function with some registers and their types."""
        takes = ", ".join(f"{kind} {each}" for kind, each in arguments)
        text = f"call {result(gives)} {function}({takes})"
        if not registers(gives):
            self.do(text)
            return Value(gives, ())
        found = self.get(text)
        return Value(gives, self.parts(found, gives), lasting=not owners(gives))

    def parts(self, found: str, kind: Kind) -> tuple[str, ...]:
        """Return the registers of a result."""
        count = len(registers(kind))
        if count == 1:
            return (found,)
        return tuple(self.get(f"extractvalue {result(kind)} {found}, {i}") for i in range(count))

    def give(self, kind: Kind, found: Sequence[str]) -> None:
        """Return from the function with registers of a type."""
        kinds = registers(kind)
        if len(kinds) <= 1:
            self.do(f"ret {kinds[0]} {found[0]}" if kinds else "ret void")
        else:
            whole = "undef"
            for i, (each, register) in enumerate(zip(kinds, found, strict=True)):
                whole = self.get(f"insertvalue {result(kind)} {whole}, {each} {register}, {i}")
            self.do(f"ret {result(kind)} {whole}")
        self.ended = True

    def count_references(self, what: str, value: Value) -> None:
        """Hold or release the memory of a value."""
        for at in owners(value.kind):
            owner = self.one(value, at)
            if owner != "null":
                self.do(f"call void @{what}(ptr {owner})")

    def allocate(self, kind: ArrayKind, shape: Sequence[str], zero: bool = False, *, head: int = 32) -> Value:
        """Return a new array; its count of references is in the ``head`` of so many bytes."""
        size = "1"
        for each in shape:
            size = self.whole("mul", size, each)
        room = self.whole("mul", size, str(BYTES[kind.element.stored]))
        owner = self.get(f"call ptr @allocate(i64 {room})")
        data = self.get(f"getelementptr i8, ptr {owner}, i64 {head}")
        if zero:
            self.do(f"call void @llvm.memset.p0.i64(ptr {data}, i8 0, i64 {room}, i1 false)")
        return Value(kind, (data, *shape, owner), lasting=False)

    def load(self, element: Scalar, address: str) -> Value:
        """Return an element of an array."""
        found = self.get(f"load {element.stored}, ptr {address}")
        match element.name:
            case "bool":
                return Value(FLAG, (self.get(f"icmp ne i8 {found}, 0"),))
            case "int32":
                return Value(WHOLE, (self.get(f"sext i32 {found} to i64"),))
            case "uint64":
                return Value(WHOLE, (found,), positive=True)
        return Value(element, (found,))

    def store(self, element: Scalar, address: str, register: str) -> None:
        """Store an element of an array."""
        if element.stored != element.register:
            operation = "zext" if element is FLAG else "trunc"
            register = self.get(f"{operation} {element.register} {register} to {element.stored}")
        self.do(f"store {element.stored} {register}, ptr {address}")

    def text(self, head: str) -> str:
        """Return the text of the function behind its head."""
        return "\n".join([f"{head} {{", "entry:", *self.places, *self.lines, "}", ""])


BYTES = {"double": 8, "i64": 8, "i32": 4, "i8": 1}


@dataclass(frozen=True)
class Axis:
    """One axis of an array: its length, and its stride in elements."""

    length: str
    stride: str


def result(kind: Kind) -> str:
    """Return the type of LLVM of a result."""
    kinds = registers(kind)
    return (kinds[0] if kinds else "void") if len(kinds) <= 1 else "{" + ", ".join(kinds) + "}"
