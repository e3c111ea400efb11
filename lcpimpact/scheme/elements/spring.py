r"""A linear spring."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar

from lcpimpact.scheme.elements.base import MISSING, Element, Polyline, described, distinct, positive
from lcpimpact.scheme.terms import Terms


@described
@dataclass(frozen=True)
class Spring(Element):
    r"""A linear spring: force k (q_b - q_a) on node a and its opposite on node b; energy ½ k (q_b - q_a)².

    ::

        a o--/\/\/\--o b      pulls a towards b when q_b - q_a > 0

    Parameters
    ----------
    a, b : str
        The nodes that it joins; one may be the ground.
    k : float
    symbols : tuple of str
        How drawings call the constant.

    Raises
    ------
    InputError
        If k is missing, not positive or not finite, or both ends are one node.

    Examples
    --------
    >>> Spring("x", "y", k=1962.0).nodes
    ('x', 'y')
    """

    a: str
    b: str
    k: Annotated[float, "N/m, stiffness, positive"] = MISSING
    symbols: tuple[str, ...] = ("k",)

    strokes: ClassVar[tuple[Polyline, ...]] = (
        (
            (0.0, 0.0),
            (0.2, 0.0),
            (0.25, 0.5),
            (0.35, -0.5),
            (0.45, 0.5),
            (0.55, -0.5),
            (0.65, 0.5),
            (0.75, -0.5),
            (0.8, 0.0),
            (1.0, 0.0),
        ),
    )

    def __post_init__(self) -> None:
        distinct(self)
        positive(self, self.symbols[0], self.k, "N/m")

    @property
    def nodes(self) -> tuple[str, ...]:
        """The two ends."""
        return (self.a, self.b)

    def contribute(self, terms: Terms) -> None:
        """Add k to K between the two nodes."""
        terms.link(terms.K, self.a, self.b, self.k)
