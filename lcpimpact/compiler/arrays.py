"""Arrays in compiled code: their elements, views of them, and operations element by element."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass

from lcpimpact.compiler.code import BYTES, Axis, Code, Value
from lcpimpact.compiler.kinds import FLAG, REAL, SHORT, UNSIGNED, WHOLE, ArrayKind, Scalar


@dataclass(frozen=True, eq=False)
class Computed:
    """An array whose elements are computed when they are asked for: its lengths, and at(indices) -> element."""

    element: Scalar
    lengths: tuple[str, ...]
    at: Callable[[Sequence[str]], Value]


@dataclass(frozen=True)
class Part:
    """The part of an axis from first on."""

    first: str
    length: str


class Arrays:
    """Operations on arrays that write their code.

    Parameters
    ----------
    code : Code
    """

    def __init__(self, code: Code) -> None:
        self.code = code

    def axes(self, array: Value) -> list[Axis]:
        """Return the axes of an array."""
        kind, code = array.kind, self.code
        assert isinstance(kind, ArrayKind)
        lengths = [code.one(array, 1 + i) for i in range(kind.axes)]
        if kind.order == "A":
            return [Axis(each, code.one(array, 1 + kind.axes + i)) for i, each in enumerate(lengths)]
        stride, found = "1", list[Axis]()
        for each in reversed(lengths):
            found.append(Axis(each, stride))
            if len(found) < kind.axes:
                stride = code.whole("mul", stride, each)
        return found[::-1]

    def address(self, array: Value, indices: Sequence[str]) -> str:
        """Return the address of an element."""
        kind, code = array.kind, self.code
        at = "0"
        assert isinstance(kind, ArrayKind)
        if kind.order == "C":
            for i, index in enumerate(indices):
                at = code.whole("add", code.whole("mul", at, code.one(array, 1 + i)) if i else at, index)
        else:
            for axis, index in zip(self.axes(array), indices, strict=True):
                at = code.whole("add", at, code.whole("mul", axis.stride, index))
        return self.offset(kind.element, code.one(array), at)

    def offset(self, element: Scalar, data: str, at: str) -> str:
        """Return the address of the element at a place behind others."""
        return data if at == "0" else self.code.get(f"getelementptr inbounds {element.stored}, ptr {data}, i64 {at}")

    def view(self, array: Value, chosen: Sequence[str | Part | None]) -> Value:
        """Return a view of an array: of each axis an index, a part, or None for all of it."""
        kind, code = array.kind, self.code
        at = "0"
        assert isinstance(kind, ArrayKind)
        kept, ordered = list[Axis](), kind.order == "C"
        for axis, each in zip(self.axes(array), chosen, strict=True):
            first = each if isinstance(each, str) else each.first if each else "0"
            at = code.whole("add", at, code.whole("mul", axis.stride, first))
            if isinstance(each, str):
                ordered = ordered and not kept
            else:
                ordered = ordered and not (kept and each)
                kept.append(Axis(each.length if each else axis.length, axis.stride))
        return self.laid_out(array, self.offset(kind.element, code.one(array), at), kept, "C" if ordered else "A")

    def laid_out(self, array: Value, data: str, axes: Sequence[Axis], order: str = "A") -> Value:
        """Return a part of the memory of an array, from an address on, as an array with other axes."""
        assert isinstance(array.kind, ArrayKind)
        strides = [each.stride for each in axes] if order == "A" else []
        registers = (data, *(each.length for each in axes), *strides, self.code.one(array, len(array.registers) - 1))
        return Value(ArrayKind(array.kind.element, len(axes), order), registers, array.lasting)

    def transposed(self, array: Value) -> Value:
        """Return an array with its axes in the opposite order."""
        axes = self.axes(array)[::-1]
        return self.laid_out(array, self.code.one(array), axes) if len(axes) > 1 else array

    def reshaped(self, array: Value, lengths: Sequence[str]) -> Value:
        """Return an array in C order with other lengths, of which one may be -1."""
        code = self.code
        size = others = "1"
        assert isinstance(array.kind, ArrayKind)
        assert array.kind.order == "C"
        for axis in self.axes(array):
            size = code.whole("mul", size, axis.length)
        for each in lengths:
            others = code.whole("mul", others, each) if each != "-1" else others
        rest = code.get(f"sdiv i64 {size}, {others}") if "-1" in lengths else ""
        kind = ArrayKind(array.kind.element, len(lengths))
        found = [rest if each == "-1" else each for each in lengths]
        return Value(kind, (code.one(array), *found, code.one(array, len(array.registers) - 1)), array.lasting)

    def ordered(self, array: Value) -> Value:
        """Return an array with its strides as of order "A"."""
        return self.laid_out(array, self.code.one(array), self.axes(array))

    def elements(self, array: Value) -> Computed:
        """Return an array as its elements."""
        kind, array = array.kind, self.code.loaded(array)
        assert isinstance(kind, ArrayKind)
        return Computed(
            kind.element,
            array.registers[1 : 1 + kind.axes],
            lambda indices: self.code.load(kind.element, self.address(array, indices)),
        )

    def by_element(self, operation: Callable[..., Value], *operands: Computed | Value) -> Computed:
        """Return an operation on the elements of arrays, and on numbers, which go with each element."""
        arrays = [each for each in operands if isinstance(each, Computed)]
        longest = max(arrays, key=lambda each: len(each.lengths))

        def at(indices: Sequence[str]) -> Value:
            found = [
                each.at(indices[len(indices) - len(each.lengths) :]) if isinstance(each, Computed) else each
                for each in operands
            ]
            return operation(*found)

        return Computed(self._type_of(at, len(longest.lengths)), longest.lengths, at)

    def _type_of(self, at: Callable[[Sequence[str]], Value], axes: int) -> Scalar:
        """Return the type of the elements, by writing one that is thrown away."""
        with self.code.draft():
            kind = at(["0"] * axes).kind
        assert isinstance(kind, Scalar)
        return kind

    def over(self, elements: Computed, do: Callable[[Sequence[str], Value], None]) -> None:
        """Write a loop over all elements."""
        with ExitStack() as loops:
            indices = [loops.enter_context(self.code.each(each)) for each in elements.lengths]
            do(indices, elements.at(indices))

    def fill(self, array: Value, elements: Computed | Value) -> None:
        """Write elements, or one number, into an array of the same lengths."""
        kind = array.kind
        assert isinstance(kind, ArrayKind)
        array = self.code.loaded(array)
        own = self.elements(array)
        if isinstance(elements, Value):
            value = elements
            elements = Computed(kind.element, own.lengths, lambda _: value)
        short = len(own.lengths) - len(elements.lengths)
        given = elements

        def write(indices: Sequence[str], _: Value) -> None:
            value = given.at(indices[short:])
            self.code.store(kind.element, self.address(array, indices), self.converted(value, kind.element))

        self.over(Computed(kind.element, own.lengths, lambda _: Value(kind.element, ("undef",))), write)

    def kept(self, elements: Computed) -> Value:
        """Return a new array of elements."""
        found = self.code.allocate(ArrayKind(elements.element, len(elements.lengths)), elements.lengths)
        self.fill(found, elements)
        return found

    def copy(self, source: Value, target: Value) -> None:
        """Copy an array in C order into one of its lengths that may overlap it."""
        kind, code = target.kind, self.code
        assert isinstance(kind, ArrayKind)
        count = str(BYTES[kind.element.stored])
        for i in range(kind.axes):
            count = code.whole("mul", code.one(target, 1 + i), count)
        to, taken = code.one(target), code.one(source)
        code.do(f"call void @llvm.memmove.p0.p0.i64(ptr {to}, ptr {taken}, i64 {count}, i1 false)")

    def converted(self, value: Value, to: Scalar) -> str:
        """Return the register of a number as one of another type."""
        code, kind = self.code, value.kind
        register = code.one(value)
        real, whole = to is REAL, to in (WHOLE, UNSIGNED, SHORT)
        if kind is to or (whole and kind in (WHOLE, UNSIGNED, SHORT)):
            return register
        if kind is FLAG and real:
            return code.get(f"uitofp i1 {register} to double")
        if kind is FLAG and whole:
            return code.get(f"zext i1 {register} to i64")
        if kind is WHOLE and real:
            return code.get(f"sitofp i64 {register} to double")
        raise TypeError(f"a value of type {kind} is no {to.name}")
