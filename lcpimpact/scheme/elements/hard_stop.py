r"""The hard stop of Simscape: a spring and a dashpot that act at once, with or without damping of the rebound."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal, get_args

from lcpimpact.errors import InputError
from lcpimpact.registry import nearest
from lcpimpact.scheme.elements.base import MISSING, Polyline, described
from lcpimpact.scheme.elements.compliant import STOP, CompliantContact, check_contact, check_damping


@described
@dataclass(frozen=True)
class HardStop(CompliantContact):
    r"""Simscape's hard stop with full stiffness and damping at its bound: f = k δ + c δ' for δ > 0, and no force apart.

    With a damped rebound this holds until the ends part, so that it pulls at the end. With an undamped rebound the damping
    acts as long as δ grows, f = k δ + c max(δ', 0). The force jumps to c δ' at first touch. A free mass m returns with a
    restitution of ζ = c/(2 sqrt(k m)) alone, after the time T (ω² = k/m, σ = sqrt(1 - ζ²)); from ζ = 1 on a damped rebound
    never ends.

    .. math:: e = e^{-π ζ/σ}, \; T = \frac{π}{ω σ} \quad \text{(damped)}, \qquad
              e = e^{-ζ \arccos ζ/σ}, \; T = \frac{\arccos ζ}{ω σ} + \frac{π}{2 ω} \quad \text{(undamped)}.

    Where nothing is to pull take a `KelvinVoigtStop`, whose e is the square of that of the undamped rebound. The tool's
    smooth transition of stiffness and damping is not here.

    It stores ½ k δ² and dissipates the rest.

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
    rebound : str
        "damped" or "undamped".
    gap : float
    name : str, optional
        The name of the force in results; by default F, and F_2, F_3, ... for the next ones of a scheme without a name.
    symbols : tuple of str
        How drawings call the two constants.

    Raises
    ------
    InputError
        If k, c or rebound is missing, k is not above zero or c is below it, a number is not finite, or both ends are one
        node.

    Examples
    --------
    >>> HardStop("x", "ground", k=1e6, c=150.0, rebound="undamped").c
    150.0

    References
    ----------
    MathWorks, Simscape, Translational Hard Stop.
    """

    upper: str
    lower: str
    k: Annotated[float, "N/m, stiffness, positive"] = MISSING
    c: Annotated[float, "N s/m, damping, zero or positive"] = MISSING
    rebound: Literal["damped", "undamped"] = MISSING
    gap: Annotated[float, "m, opening when both coordinates are zero"] = 0.0
    name: str | None = None
    symbols: tuple[str, ...] = ("k", "c")

    strokes: ClassVar[tuple[Polyline, ...]] = STOP
    split: ClassVar[float | None] = 0.2

    def __post_init__(self) -> None:
        check_contact(self, "k", "N/m")
        check_damping(self, "c", "N s/m")
        kinds = list(get_args(Literal["damped", "undamped"]))
        if self.rebound is MISSING:
            raise InputError(f"{self}: rebound is missing; give {' or '.join(map(repr, kinds))}")
        if self.rebound not in kinds:
            raise InputError(nearest(str(self.rebound), kinds, "rebound of a HardStop"))

    @property
    def law(self) -> Mapping[str, float]:
        """The constants of its force, with an undamped rebound k δ at least."""
        least = {"least": 1.0} if self.rebound == "undamped" else {}
        return {"K": self.k, "n": 1.0, "c": self.c} | least
