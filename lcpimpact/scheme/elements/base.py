"""Base class of the elements, which join named nodes and add terms to M, C, K, f and H."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

from numpy.typing import ArrayLike

from lcpimpact.arguments import is_name
from lcpimpact.errors import InputError
from lcpimpact.numbers import finite_array, is_real
from lcpimpact.numbers import positive as positive_number
from lcpimpact.scheme.terms import GROUND, End, Terms, name_of, nodes_of
from lcpimpact.stated import described

__all__ = [
    "GROUND",
    "MISSING",
    "ArrayElement",
    "Compound",
    "Element",
    "Link",
    "Polyline",
    "Values",
    "described",
    "distinct",
    "named",
    "one_or_each",
    "positive",
]

MISSING: Any = None
"""Default of every physical constant: physics has no default, so an element that is left with it is refused."""

Polyline = Sequence[tuple[float, float]]

Values = float | tuple[float, ...]
"""One value for all, or one for each."""


class Element(ABC):
    r"""An element between named nodes.

    All coordinates are positive downwards. An element is drawn in a frame that runs from its first node, at
    (0, 0), to its last, at (1, 0); `strokes` holds its lines in that frame. When the ends move, a symbol stretches as a
    whole; with ``split`` it parts instead: strokes that reach no further than there go with the first node, others with
    the last.

    To write a new element: make a frozen dataclass with the nodes first and the constants next, check the constants in
    ``__post_init__`` with `positive`, add the terms in `contribute`, give `strokes`, and add a line to the registry.

    Examples
    --------
    An inerter, whose force B (a_b - a_a) adds B to the mass matrix:

    >>> from dataclasses import dataclass
    >>> from lcpimpact import Element, Mass, Scheme
    >>> @dataclass(frozen=True)
    ... class Inerter(Element):
    ...     a: str
    ...     b: str
    ...     B: float
    ...     symbols = ("B",)
    ...
    ...     @property
    ...     def nodes(self):
    ...         return self.a, self.b
    ...
    ...     def contribute(self, terms):
    ...         terms.link(terms.M, self.a, self.b, self.B)
    >>> Scheme(Mass("x", m=1.0), Inerter("x", "ground", B=3.0)).assemble().M
    array([[4.]])
    """

    strokes: ClassVar[tuple[Polyline, ...]] = ()
    split: ClassVar[float | None] = None
    reaction: ClassVar[str] = ""
    """Default name of the reaction; a `Scheme` numbers further ones of the same name."""
    symbols: tuple[str, ...]

    @property
    @abstractmethod
    def nodes(self) -> tuple[str, ...]:
        """The names of the nodes that the element touches: its two ends are the first and the last."""

    @property
    def inner(self) -> tuple[str, ...]:
        """The nodes that the element makes for itself, as NAME.1, NAME.2, ..., which no other may use."""
        return self.nodes[1:-1]

    @property
    def labels(self) -> tuple[str, ...]:
        """The symbols that a drawing shows."""
        return self.symbols

    @abstractmethod
    def contribute(self, terms: Terms) -> None:
        """Add the element's terms to the system."""

    def parts(self) -> tuple[Element, ...]:
        """Return the elementary pieces, as they act: the element itself unless it is compound."""
        return (self,)

    def drawn(self) -> tuple[Element, ...]:
        """Return the pieces to draw: the element itself where it has strokes of its own, else its parts."""
        return (self,) if self.strokes else self.parts()

    def __str__(self) -> str:
        first, last = self.nodes[0], self.nodes[-1]
        where = f"between {first!r} and {last!r}" if len(self.nodes) > 1 else f"at {first!r}"
        return f"{type(self).__name__} {where}"


class Link(Element):
    """An element between two ends, each a node or a sum of coordinates as {"x": 1.0, "φ": -0.1}."""

    @property
    @abstractmethod
    def ends(self) -> tuple[End, End]:
        """The two ends."""

    @property
    def nodes(self) -> tuple[str, ...]:
        """The nodes of both ends."""
        return (*nodes_of(self.ends[0]), *nodes_of(self.ends[1]))

    @property
    def inner(self) -> tuple[str, ...]:
        """None."""
        return ()

    def __str__(self) -> str:
        first, last = map(name_of, self.ends)
        return f"{type(self).__name__} between {first!r} and {last!r}"


class Compound(Element):
    """An element that consists of other elements."""

    @abstractmethod
    def parts(self) -> tuple[Element, ...]:
        """Return the elementary pieces."""

    def contribute(self, terms: Terms) -> None:
        """Add the terms of the parts."""
        for part in self.parts():
            part.contribute(terms)


class ArrayElement(Compound):
    """An element of many parts, which a `SparseScheme` adds by arrays."""

    @abstractmethod
    def contribute_arrays(self, terms: Terms) -> None:
        """Add the terms of the parts to sparse matrices, all of a kind at once."""


def positive(element: Element, symbol: str, value: float, unit: str) -> None:
    """Check that a constant is given, and is a positive finite number; the message names the element."""
    if value is MISSING:
        raise InputError(f"{element}: {symbol} is missing; give a positive number in {unit}")
    if not (is_real(value) and value > 0.0):
        positive_number(f"{element}: {symbol}", value, unit)


def distinct(element: Element) -> None:
    """Refuse node names that are no names, an element whose two ends are one node, and symbols for other constants.

    An end that is a sum of coordinates must have finite coefficients other than zero.
    """
    named(element)
    for end in element.ends if isinstance(element, Link) else ():
        if isinstance(end, str) or not isinstance(end, Mapping):
            continue
        if not end or not all(is_real(c) and c != 0.0 for c in end.values()):
            raise InputError(
                f"{type(element).__name__}: an end is a node or maps nodes to finite numbers other than zero, as "
                f'{{"x": 1.0, "φ": -0.1}}, and {dict(end)!r} does not'
            )
    nodes = element.nodes
    for node in nodes:
        if not is_name(node):
            raise InputError(
                f"{type(element).__name__}: the node name {node!r} must be a string, not empty and without hidden "
                "characters"
            )
    if len(set(nodes)) < len(nodes):
        raise InputError(f"{element}: both ends are one node; join two different nodes")


def named(element: Element) -> None:
    """Check the symbols of an element, and its ``name``, if given."""
    count = len(getattr(type(element), "symbols", ()))
    symbols = getattr(element, "symbols", ())
    if not isinstance(symbols, tuple) or len(symbols) != count or not all(map(is_name, symbols)):
        raise InputError(f"symbols = {symbols!r} of a {type(element).__name__} must be a tuple of {count} strings")
    name = getattr(element, "name", None)
    if name is not None and not is_name(name):
        raise InputError(
            f"{type(element).__name__}: name = {name!r} must be a string, not empty and without hidden characters"
        )


def one_or_each(label: str, given: ArrayLike, count: int) -> Values:
    """Return one number for all, or ``count`` of them as a tuple, by which schemes can be compared; refuse other values."""
    values = finite_array(label, given)
    if values.ndim > 1 or (values.ndim == 1 and len(values) != count):
        raise InputError(f"{label} must be one number, or {count} of them, and has the shape {values.shape}")
    return tuple(values.tolist()) if values.ndim else float(values)
