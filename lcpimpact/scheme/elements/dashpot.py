r"""A linear dashpot."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar

from lcpimpact.scheme.elements.base import MISSING, Element, Polyline, described, distinct, positive
from lcpimpact.scheme.terms import Terms


@described
@dataclass(frozen=True)
class Dashpot(Element):
    r"""A linear dashpot: force c (v_b - v_a) on node a and its opposite on node b; dissipates c (v_b - v_a)².

    ::

                +----+
        a o-----|  --|--o b      pulls a towards b when v_b - v_a > 0
                +----+

    Parameters
    ----------
    a, b : str
        The nodes that it joins; one may be the ground.
    c : float
    symbols : tuple of str
        How drawings call the constant.

    Raises
    ------
    InputError
        If c is missing, not positive or not finite, or both ends are one node.

    Examples
    --------
    >>> Dashpot("z", "ground", c=250.0).c
    250.0
    """

    a: str
    b: str
    c: Annotated[float, "N s/m, damping, positive"] = MISSING
    symbols: tuple[str, ...] = ("c",)

    strokes: ClassVar[tuple[Polyline, ...]] = (
        ((0.0, 0.0), (0.5, 0.0)),
        ((0.5, -0.35), (0.5, 0.35)),
        ((0.36, 0.5), (0.66, 0.5), (0.66, -0.5), (0.36, -0.5)),
        ((0.66, 0.0), (1.0, 0.0)),
    )
    split: ClassVar[float | None] = 0.5

    def __post_init__(self) -> None:
        distinct(self)
        positive(self, self.symbols[0], self.c, "N s/m")

    @property
    def nodes(self) -> tuple[str, ...]:
        """The two ends."""
        return (self.a, self.b)

    def contribute(self, terms: Terms) -> None:
        """Add c to C between the two nodes."""
        terms.link(terms.C, self.a, self.b, self.c)
