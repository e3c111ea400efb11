r"""The contact law of Tsuji, Tanaka and Ishida: Hertz's spring with a restitution that no speed changes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar

from lcpimpact.scheme.elements.base import MISSING, Polyline, described
from lcpimpact.scheme.elements.compliant import LOSSY_BALLS, CompliantContact, check_contact, check_damping


@described
@dataclass(frozen=True)
class Tsuji(CompliantContact):
    r"""Tsuji's contact: f = K δⁿ + c δ^((n-1)/2) δ', which is δ^(1/4) for n = 3/2, and no force apart.

    With y = δ^((n+1)/2) and dτ = δ^((n-1)/2) dt a free mass m is a linear oscillator, y'' + c/m y' + (n + 1)/2 K/m y = 0. So
    the restitution is that of a linear stop, and the same at all speeds:

    .. math:: ζ = \frac{c}{\sqrt{2 (n + 1) K m}}, \quad e = e^{-2 ζ \arccos ζ/\sqrt{1 - ζ^2}}, \quad
              \text{and where it pulls}\; e = e^{-π ζ/\sqrt{1 - ζ^2}} .

    The contact lasts T = ∫ y^(-(n-1)/(n+1)) dτ. Tsuji's number is α = c/sqrt(K m), for n = 3/2 ζ = α/sqrt(5) with the
    reduced mass as m.

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
    c : float
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
        If K or c is missing or not finite, K is not above zero or c is below it, n < 1, gap is not finite, or both ends are
        one node.

    Examples
    --------
    >>> Tsuji("x", "ground", K=1e6, c=300.0).n
    1.5

    References
    ----------
    Tsuji, Tanaka and Ishida, Lagrangian numerical simulation of plug flow of cohesionless particles in a horizontal pipe
    (1992); Antypov and Elliott, On an analytical solution for the damped Hertzian spring (2011).
    """

    upper: str
    lower: str
    K: Annotated[float, "N/mⁿ, stiffness, positive"] = MISSING
    c: Annotated[float, "N s/m^q, damping, zero or positive; q = (n + 1)/2"] = MISSING
    n: Annotated[float, "1, exponent, at least 1: 3/2 for smooth bodies"] = 1.5
    pulls: bool = False
    gap: Annotated[float, "m, opening when both coordinates are zero"] = 0.0
    name: str | None = None
    symbols: tuple[str, ...] = ("K", "c")

    strokes: ClassVar[tuple[Polyline, ...]] = LOSSY_BALLS
    split: ClassVar[float | None] = 0.5

    def __post_init__(self) -> None:
        check_contact(self, "K", "N/mⁿ", self.n)
        check_damping(self, "c", "N s/m^q", self.pulls)

    @property
    def law(self) -> Mapping[str, float]:
        """The constants of its force."""
        loss = {"c": self.c, "p": 0.5 * (self.n - 1.0), "least": -math.inf if self.pulls else 0.0}
        return {"K": self.K, "n": self.n} | loss
