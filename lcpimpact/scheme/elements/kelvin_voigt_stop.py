r"""The Kelvin-Voigt stop: compliant contact without tension."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar

from lcpimpact.scheme.elements.base import MISSING, Polyline, described
from lcpimpact.scheme.elements.compliant import STOP, CompliantContact, check_contact, check_damping


@described
@dataclass(frozen=True)
class KelvinVoigtStop(CompliantContact):
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

    strokes: ClassVar[tuple[Polyline, ...]] = STOP
    split: ClassVar[float | None] = 0.2

    def __post_init__(self) -> None:
        check_contact(self, "k", "N/m")
        check_damping(self, "c", "N s/m")

    @property
    def law(self) -> Mapping[str, float]:
        """The constants of its force."""
        return {"K": self.k, "n": 1.0, "c": self.c, "least": 0.0}
