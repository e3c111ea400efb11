"""Base class of the compliant contacts: one-sided non-linear springs between two nodes."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from typing import ClassVar

from lcpimpact.errors import InputError
from lcpimpact.formula import number
from lcpimpact.numbers import finite
from lcpimpact.scheme.elements.base import MISSING, Element, Polyline, distinct, positive
from lcpimpact.scheme.terms import PowerLaw, Terms


class CompliantContact(Element):
    """A contact that pushes its ends apart by a law of the penetration and its rate, a `PowerLaw`."""

    upper: str
    lower: str
    gap: float
    name: str | None
    reaction: ClassVar[str] = "F"

    @property
    def nodes(self) -> tuple[str, ...]:
        """The two ends."""
        return (self.upper, self.lower)

    @property
    @abstractmethod
    def law(self) -> Mapping[str, float]:
        """The constants of its `PowerLaw` but for the gap, by name."""

    def contribute(self, terms: Terms) -> None:
        """Add the one-sided spring."""
        law = {name: number(value) for name, value in self.law.items()}
        name = self.name or self.reaction
        terms.springs.append(PowerLaw(str(self), self.upper, self.lower, number(self.gap), name=name, **law))


def check_contact(element: CompliantContact, stiffness: str, unit: str, n: float = 1.0) -> None:
    """Check the ends, the stiffness, the exponent, whose stiffness at δ = 0 is infinite below 1, and the gap."""
    distinct(element)
    positive(element, stiffness, getattr(element, stiffness), unit)
    finite(f"{element}: n", n, least=1.0)
    finite(f"{element}: gap", element.gap, "m")


def check_damping(element: CompliantContact, constant: str, unit: str, pulls: bool = False) -> None:
    """Check a constant of damping, which may be zero, and whether it may pull."""
    value = getattr(element, constant)
    if value is MISSING:
        raise InputError(f"{element}: {constant} is missing; give a number in {unit}, 0 for a stop without loss")
    finite(f"{element}: {constant}", value, unit, least=0.0)
    if not isinstance(pulls, bool):
        raise InputError(f"{element}: pulls = {pulls!r} must be true or false")


STOP: tuple[Polyline, ...] = (
    ((0.0, 0.0), (0.16, 0.0)),
    ((0.16, -0.8), (0.16, 0.8)),
    ((0.3, -0.8), (0.3, 0.8)),
    ((0.3, -0.45), (0.4, -0.45), (0.44, -0.25), (0.52, -0.65), (0.6, -0.25), (0.68, -0.65), (0.76, -0.25), (0.8, -0.45),
     (0.9, -0.45)),
    ((0.3, 0.45), (0.56, 0.45)),
    ((0.56, 0.27), (0.56, 0.63)),
    ((0.48, 0.69), (0.66, 0.69), (0.66, 0.21), (0.48, 0.21)),
    ((0.66, 0.45), (0.9, 0.45)),
    ((0.9, -0.45), (0.9, 0.45)),
    ((0.9, 0.0), (1.0, 0.0)),
)  # fmt: skip
"""The strokes of a plate with a spring and a dashpot behind it."""

BALLS: tuple[Polyline, ...] = (
    ((0.0, 0.0), (0.3, 0.0)),
    ((0.3, -0.6), (0.4, -0.54), (0.46, -0.36), (0.5, 0.0), (0.46, 0.36), (0.4, 0.54), (0.3, 0.6), (0.3, -0.6)),
    ((0.7, -0.6), (0.6, -0.54), (0.54, -0.36), (0.5, 0.0), (0.54, 0.36), (0.6, 0.54), (0.7, 0.6), (0.7, -0.6)),
    ((0.7, 0.0), (1.0, 0.0)),
)
"""The strokes of two round bodies."""

LOSSY_BALLS: tuple[Polyline, ...] = (
    *BALLS,
    ((0.3, 0.6), (0.3, 0.9), (0.5, 0.9)),
    ((0.5, 0.78), (0.5, 1.02)),
    ((0.4, 1.08), (0.6, 1.08), (0.6, 0.72), (0.4, 0.72)),
    ((0.6, 0.9), (0.7, 0.9), (0.7, 0.6)),
)
"""The strokes of two round bodies with a dashpot."""
