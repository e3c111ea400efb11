r"""A node with prescribed motion."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar

from lcpimpact.errors import InputError
from lcpimpact.scheme.elements.base import GROUND, MISSING, Element, Polyline, described, distinct
from lcpimpact.scheme.signals import Described, Signal, checked
from lcpimpact.scheme.terms import Terms


@described
@dataclass(frozen=True)
class PrescribedMotion(Element):
    r"""A node with the motion q = y(t), whatever the forces on it: a vibrating table, a testing machine.

    The force that this takes balances the node; its power feeds the system, and the certificate counts it.

    ::

           o  node
        ━━━━━━━━ | y(t)    positive downwards
           /|\   v

    Parameters
    ----------
    node : str
        The node; it must carry no mass.
    y : Harmonic, Polynomial, Ramp, Table, a sum of them, or Motion
    symbols : tuple of str
        How drawings call the motion.

    Raises
    ------
    InputError
        If y is missing, does not know its velocity, or jumps, or the node is the ground; and when a scheme is assembled, if
        y(0) or y'(0) is no finite number.

    Examples
    --------
    >>> from lcpimpact import Harmonic
    >>> PrescribedMotion("table", Harmonic(amplitude=0.01, omega=30.0)).y(0.0)
    0.01
    """

    node: str
    y: Annotated[
        Signal,
        "m, position over time, with the velocity; the position must be continuous, and the velocity may jump",
    ] = MISSING
    symbols: tuple[str, ...] = ("y",)

    strokes: ClassVar[tuple[Polyline, ...]] = (((-0.5, -0.5), (0.5, -0.5)), ((-0.5, 0.5), (0.5, 0.5)))

    def __post_init__(self) -> None:
        distinct(self)
        if self.node == GROUND:
            raise InputError(f"{self}: the ground does not move; name another node")
        if self.y is MISSING or not callable(self.y) or not callable(getattr(self.y, "rate", None)):
            raise InputError(
                f"{self}: y = {self.y!r} must be a motion that knows its velocity: Harmonic(...), Polynomial(...), "
                "Ramp(...), Table(...) or Motion(place, velocity)"
            )
        if isinstance(self.y, Described) and not self.y.continuous:
            kind = type(self.y).__name__
            raise InputError(
                f"{self}: y is a {kind} that jumps, and a node moves continuously: let it rise over a time"
            )

    @property
    def nodes(self) -> tuple[str, ...]:
        """The node that is moved."""
        return (self.node,)

    def contribute(self, terms: Terms) -> None:
        """Give the node its motion."""
        i = terms.index[self.node]
        if i in terms.motions:
            raise InputError(f"node {self.node!r} has two prescribed motions: leave one out")
        terms.motions[i] = checked(f"{self}: y", self.y, "m", moves=True)
