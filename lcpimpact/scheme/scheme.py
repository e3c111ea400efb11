"""A rheological scheme: elements between named nodes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import fields, replace
from itertools import count
from typing import Any

from lcpimpact.errors import InputError
from lcpimpact.scheme.assembly import assemble
from lcpimpact.scheme.dynamics import Dynamics
from lcpimpact.scheme.elements.base import Element


class Scheme:
    """Masses, springs, dashpots and bumpers between named nodes and the ground.

    Parameters
    ----------
    *elements : Element
        The elements; more can be added by `add`.

    Examples
    --------
    The paper's System No. 1:

    >>> from lcpimpact import Bumper, KelvinVoigt, Load, Mass, Scheme
    >>> scheme = Scheme(Mass("x", m=100.0), Load("x", f=981.0), Bumper("x", "z"))
    >>> dynamics = scheme.add(KelvinVoigt("z", "ground", k=3924.0, c=250.0)).assemble()
    >>> dynamics.nodes
    ('x', 'z')
    >>> dynamics.contacts[0].relative_degree
    1
    """

    def __init__(self, *elements: Element) -> None:
        self.elements: tuple[Element, ...] = ()
        self.add(*elements)

    def add(self, *elements: Element) -> Scheme:
        """Add elements and return the scheme itself.

        Reactions without a name get one, in the order of the elements: the first bumper R, the next R_2, R_3, ...; likewise
        F of sliders and Jenkins elements and T of ropes. Names that are given, also those that follow in the same call, are
        passed over, and stay as they are.

        Raises
        ------
        InputError
            If an object that is not an element is added.
        """
        for element in elements:
            if not isinstance(element, Element):
                raise InputError(f"{element!r} is not an element: add a Mass, Spring, Dashpot, Bumper, Load, ...")
        self.elements += tuple(_named(self.elements, elements))
        return self

    def assemble(self) -> Dynamics:
        """Return the equations of motion; what cannot be solved is refused by name (`InputError`)."""
        return assemble(self.elements)

    def __eq__(self, other: Any) -> bool:
        return isinstance(other, Scheme) and self.elements == other.elements

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        lines = [f"    {type(e).__name__}({', '.join(_arguments(e))})," for e in self.elements]
        return "\n".join(["Scheme(", *lines, ")"])


def _named(before: Sequence[Element], added: Sequence[Element]) -> Iterator[Element]:
    """Yield the elements that are added; a reaction without a name gets the first that is free of R, R_2, R_3, ..."""
    taken = {getattr(element, "name", None) for element in (*before, *added) if element.reaction}
    for element in added:
        if not element.reaction or getattr(element, "name", "") is not None:
            yield element
            continue
        name = next(name for name in _names(element.reaction) if name not in taken)
        taken.add(name)
        # Its symbol in drawings follows, unless given.
        follows = name != element.reaction and element.symbols == (element.reaction,)
        yield replace(element, name=name, symbols=(name,) if follows else element.symbols)  # type: ignore[type-var]


def _names(reaction: str) -> Iterator[str]:
    """Yield R, R_2, R_3, ..."""
    yield reaction
    for i in count(2):
        yield f"{reaction}_{i}"


def _arguments(element: Element) -> list[str]:
    values = {f.name: (getattr(element, f.name), f.default) for f in fields(element)}  # type: ignore[arg-type]
    return [f"{name}={value!r}" for name, (value, default) in values.items() if value != default]
