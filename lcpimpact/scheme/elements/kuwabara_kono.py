r"""The contact law of Kuwabara and Kono: viscoelastic spheres."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar

from lcpimpact.scheme.elements.base import MISSING, Polyline, described
from lcpimpact.scheme.elements.compliant import LOSSY_BALLS, CompliantContact, check_contact, check_damping


@described
@dataclass(frozen=True)
class KuwabaraKono(CompliantContact):
    r"""Kuwabara and Kono's contact of viscoelastic bodies: f = K (δⁿ + n A δⁿ⁻¹ δ'), and no force apart.

    It is the law of `HertzSpring` at the penetration δ + A δ', to first order in A; for spheres
    f = K (δ^(3/2) + 3/2 A sqrt(δ) δ'). A free mass m returns with a restitution of A (K/m)^(1/(n+1)) v0^((n-1)/(n+1)) alone,
    which falls with the speed: for spheres (the 1.15344 of Schwager and Pöschel is two thirds of the number here)

    .. math:: e = 1 - a A \Bigl(\frac Km\Bigr)^{2/5} v_0^{1/5} + \dots, \qquad
              a = \tfrac65 \bigl(\tfrac54\bigr)^{3/5} B\bigl(\tfrac35, \tfrac32\bigr) = 1.73016 .

    It stores K δⁿ⁺¹/(n + 1) and dissipates the rest.

    ::

            o  upper, feels -f
           ( )
           ( )]   δ = q_upper - q_lower - gap > 0 in contact     | positive downwards
            o  lower, feels +f                                           v

    Parameters
    ----------
    upper, lower : str
        The nodes; one may be the ground.
    K : float
    A : float
    n : float
    pulls : bool
        Whether the damping may pull as the ends part, as the law is written; else the force ends where it is zero.
    gap : float
    name : str, optional
        The name of the force in results; by default F, and F_2, F_3, ... for the next ones of a scheme without a name.
    symbols : tuple of str
        How drawings call the two constants.

    Raises
    ------
    InputError
        If K or A is missing or not finite, K is not above zero or A is below it, n < 1, gap is not finite, or both ends are
        one node.

    Examples
    --------
    >>> KuwabaraKono("x", "ground", K=1e6, A=1e-4).n
    1.5

    References
    ----------
    Kuwabara and Kono, Restitution coefficient in a collision between two spheres (1987); Brilliantov, Spahn, Hertzsch and
    Pöschel, Model for collisions in granular gases (1996); Schwager and Pöschel, Coefficient of normal restitution of
    viscous particles and cooling rate of granular gases (1998).
    """

    upper: str
    lower: str
    K: Annotated[float, "N/mⁿ, stiffness, positive"] = MISSING
    A: Annotated[float, "s, time of dissipation, zero or positive"] = MISSING
    n: Annotated[float, "1, exponent, at least 1: 3/2 for smooth bodies"] = 1.5
    pulls: bool = False
    gap: Annotated[float, "m, opening when both coordinates are zero"] = 0.0
    name: str | None = None
    symbols: tuple[str, ...] = ("K", "A")

    strokes: ClassVar[tuple[Polyline, ...]] = LOSSY_BALLS
    split: ClassVar[float | None] = 0.5

    def __post_init__(self) -> None:
        check_contact(self, "K", "N/mⁿ", self.n)
        check_damping(self, "A", "s", self.pulls)

    @property
    def law(self) -> Mapping[str, float]:
        """The constants of its force."""
        loss = {"c": self.n * self.A * self.K, "p": self.n - 1.0, "least": -math.inf if self.pulls else 0.0}
        return {"K": self.K, "n": self.n} | loss
