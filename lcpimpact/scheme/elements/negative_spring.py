r"""The negative spring: a repelling linear force, as gravity on an inverted pendulum."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar

from lcpimpact.scheme.elements.base import MISSING, Element, Polyline, described, distinct, positive
from lcpimpact.scheme.terms import Terms


@described
@dataclass(frozen=True)
class NegativeSpring(Element):
    r"""A spring of stiffness -k: force -k (q_b - q_a) on node a and its opposite on node b; energy -½ k (q_b - q_a)².

    It is the linearised action of gravity on what stands: an inverted pendulum, or a rocking block between two impacts.
    A motion against it grows as exp(t sqrt(k/m)), and its energy has no lower bound. It cannot hold a node: one that has
    neither mass nor dashpot needs springs that are stiffer than it, and the assembly refuses anything else.

    ::

        a o--\/\/\/--o b      pushes a away from b when q_b - q_a > 0
               -k

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
    >>> from lcpimpact import Mass, Scheme
    >>> Scheme(Mass("x", m=1.0), NegativeSpring("x", "ground", k=4.0)).assemble().K.tolist()
    [[-4.0]]

    References
    ----------
    Housner, The behavior of inverted pendulum structures during earthquakes (1963).
    """

    a: str
    b: str
    k: Annotated[float, "N/m, magnitude of the negative stiffness, positive"] = MISSING
    symbols: tuple[str, ...] = ("-k",)

    strokes: ClassVar[tuple[Polyline, ...]] = (
        (
            (0.0, 0.0),
            (0.2, 0.0),
            (0.25, -0.5),
            (0.35, 0.5),
            (0.45, -0.5),
            (0.55, 0.5),
            (0.65, -0.5),
            (0.75, 0.5),
            (0.8, 0.0),
            (1.0, 0.0),
        ),
    )

    def __post_init__(self) -> None:
        distinct(self)
        positive(self, "k", self.k, "N/m")

    @property
    def nodes(self) -> tuple[str, ...]:
        """The two ends."""
        return (self.a, self.b)

    def contribute(self, terms: Terms) -> None:
        """Take k away from K between the two nodes."""
        terms.link(terms.K, self.a, self.b, -self.k)
