r"""A point mass."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar

from lcpimpact.errors import InputError
from lcpimpact.scheme.elements.base import GROUND, MISSING, Element, Polyline, described, distinct, positive
from lcpimpact.scheme.terms import Terms


@described
@dataclass(frozen=True)
class Mass(Element):
    r"""A mass m at a node: adds m to M; kinetic energy ½ m v².

    ::

          +-----+
          |  m  |   | x, v positive downwards
          +-----+   v

    Parameters
    ----------
    node : str
        The node that carries the mass.
    m : float
    symbols : tuple of str
        How drawings call the constant.

    Raises
    ------
    InputError
        If m is missing, not positive or not finite, or the node is the ground.

    Examples
    --------
    >>> Mass("x", m=100.0).m
    100.0
    """

    node: str
    m: Annotated[float, "kg, mass, positive"] = MISSING
    symbols: tuple[str, ...] = ("m",)

    strokes: ClassVar[tuple[Polyline, ...]] = (((-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5), (-0.5, -0.5)),)

    def __post_init__(self) -> None:
        distinct(self)
        positive(self, self.symbols[0], self.m, "kg")
        if self.node == GROUND:
            raise InputError(f"{self}: the ground does not move; put the mass at a node of another name")

    @property
    def nodes(self) -> tuple[str, ...]:
        """The node that carries the mass."""
        return (self.node,)

    def contribute(self, terms: Terms) -> None:
        """Add m to the diagonal of M."""
        i = terms.index[self.node]
        terms.M.add(self.m, (i, i))
