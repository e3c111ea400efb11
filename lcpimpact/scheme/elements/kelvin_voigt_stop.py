r"""The Kelvin-Voigt stop: compliant contact without tension."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar

from lcpimpact.errors import InputError
from lcpimpact.formula import number
from lcpimpact.numbers import finite
from lcpimpact.scheme.elements.base import MISSING, Element, Polyline, described, distinct, positive
from lcpimpact.scheme.elements.hertz_spring import power_law_shape
from lcpimpact.scheme.terms import PowerLaw, Terms


@described
@dataclass(frozen=True)
class KelvinVoigtStop(Element):
    r"""A stop with a spring and a dashpot behind it: f = max(0, k δ + c δ') for δ > 0, and no force apart.

    The force jumps to c δ' at first touch, and ends where k δ + c δ' falls to zero: before the bodies have parted, since
    nothing pulls them together. The stop has no memory: its plate is home again as soon as the force is gone. A plate that
    creeps home as its dashpot lets it is a `Bumper` on a massless node with a `KelvinVoigt` behind.

    It stores ½ k δ² and dissipates the rest, c δ'² while it pushes.

    ::

                                +--/\/\/\--+
        o upper   |      |------|    k     |--- o lower      | positive downwards
          feels -f              +---[ |----+      feels +f   v
                  δ = q_upper - q_lower - gap

    Parameters
    ----------
    upper, lower : str
        The nodes; one may be the ground.
    k : float
    c : float
    gap : float
    name : str, optional
        The name of the force in results; by default F, and F_2, F_3, ... for the next ones of a scheme without a name.
    symbols : tuple of str
        How drawings call the two constants.

    Raises
    ------
    InputError
        If k or c is missing or not finite, k is not above zero or c is below it, gap is not finite, or both ends are one
        node.

    Examples
    --------
    >>> KelvinVoigtStop("x", "ground", k=3924.0, c=250.0).c
    250.0

    References
    ----------
    Schwager and Pöschel, Coefficient of restitution and linear-dashpot model revisited (2007).
    """

    upper: str
    lower: str
    k: Annotated[float, "N/m, stiffness, positive"] = MISSING
    c: Annotated[float, "N s/m, damping, zero or positive"] = MISSING
    gap: Annotated[float, "m, opening when both coordinates are zero"] = 0.0
    name: str | None = None
    symbols: tuple[str, ...] = ("k", "c")

    reaction: ClassVar[str] = "F"
    strokes: ClassVar[tuple[Polyline, ...]] = (
        ((0.0, 0.0), (0.16, 0.0)),
        ((0.16, -0.8), (0.16, 0.8)),
        ((0.3, -0.8), (0.3, 0.8)),
        ((0.3, -0.45), (0.4, -0.45), (0.44, -0.25), (0.52, -0.65), (0.6, -0.25), (0.68, -0.65), (0.76, -0.25),
         (0.8, -0.45), (0.9, -0.45)),
        ((0.3, 0.45), (0.56, 0.45)),
        ((0.56, 0.27), (0.56, 0.63)),
        ((0.48, 0.69), (0.66, 0.69), (0.66, 0.21), (0.48, 0.21)),
        ((0.66, 0.45), (0.9, 0.45)),
        ((0.9, -0.45), (0.9, 0.45)),
        ((0.9, 0.0), (1.0, 0.0)),
    )  # fmt: skip
    split: ClassVar[float | None] = 0.2

    def __post_init__(self) -> None:
        distinct(self)
        positive(self, "k", self.k, "N/m")
        if self.c is MISSING:
            raise InputError(f"{self}: c is missing; give a number in N s/m, 0 for a stop without loss")
        finite(f"{self}: c", self.c, "N s/m", least=0.0)
        power_law_shape(self, 1.0, self.gap)

    @property
    def nodes(self) -> tuple[str, ...]:
        """The two ends."""
        return (self.upper, self.lower)

    def contribute(self, terms: Terms) -> None:
        """Add the one-sided spring with its dashpot."""
        k, c, gap = map(number, (self.k, self.c, self.gap))
        law = PowerLaw(str(self), self.upper, self.lower, gap, k, 1.0, c=c, name=self.name or self.reaction)
        terms.springs.append(law)
