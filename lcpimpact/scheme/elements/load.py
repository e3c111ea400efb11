r"""A force on a node, constant or a function of time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

from lcpimpact.errors import InputError
from lcpimpact.numbers import is_real
from lcpimpact.scheme.elements.base import GROUND, MISSING, Element, Polyline, distinct
from lcpimpact.scheme.signals import Signal, checked
from lcpimpact.scheme.terms import Terms


@dataclass(frozen=True)
class Load(Element):
    r"""A force on a node: adds to f(t), positive downwards; its power is f v.

    ::

            |
            v  f(t)
            o  node

    Parameters
    ----------
    node : str
        The node that it acts on.
    f : float, signal or callable
        Force in N: a number; a `Harmonic`, `Polynomial`, `Ramp`, `Table` or `Square`; or any function, which takes the time
        in s and returns the force.
    symbols : tuple of str
        How drawings call the force.

    Raises
    ------
    InputError
        If f is missing, not finite, or the node is the ground; and when a scheme is assembled, if f(0) is no finite number.

    Examples
    --------
    >>> Load("x", f=100.0 * 9.81).f
    981.0
    """

    node: str
    f: float | Signal | Callable[[float], float] = MISSING
    symbols: tuple[str, ...] = ("f",)

    strokes: ClassVar[tuple[Polyline, ...]] = (
        ((-0.5, 0.0), (-0.15, 0.0)),
        ((-0.15, -0.06), (0.0, 0.0), (-0.15, 0.06), (-0.15, -0.06)),
    )

    def __post_init__(self) -> None:
        distinct(self)
        if self.node == GROUND:
            raise InputError(f"{self}: a force on the ground moves nothing; name another node")
        if self.f is MISSING:
            raise InputError(f"{self}: f is missing; give a force in N or a function of time")
        if not callable(self.f) and not is_real(self.f):
            raise InputError(f"{self}: f = {self.f!r} must be a finite force in N or a function of time")

    @property
    def nodes(self) -> tuple[str, ...]:
        """The node that the force acts on."""
        return (self.node,)

    def contribute(self, terms: Terms) -> None:
        """Add the force to f(t); a function that gives no number is refused here."""
        load = checked(f"{self}: f", self.f, "N") if callable(self.f) else self.f
        terms.loads.append((terms.index[self.node], load))
