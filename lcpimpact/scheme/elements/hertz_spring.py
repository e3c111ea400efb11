r"""The contact spring of Hertz."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar

from lcpimpact.formula import number
from lcpimpact.numbers import finite
from lcpimpact.scheme.elements.base import MISSING, Element, Polyline, described, distinct, positive
from lcpimpact.scheme.terms import PowerLaw, Terms


@described
@dataclass(frozen=True)
class HertzSpring(Element):
    r"""Hertz's contact of two elastic bodies: f = K δ^(3/2), and no force apart.

    δ = q_upper - q_lower - gap is the penetration; the force pushes the bodies apart. The energy is
    2/5 K δ^(5/2), and more generally K δⁿ⁺¹/(n + 1). For two spheres K = 4/3 E* sqrt(R*), 1/E* = Σ (1 - ν²)/E and
    1/R* = Σ 1/R.

    ::

            o  upper, feels -f
           ( )
           ( )   δ > 0 in contact             | positive downwards
            o  lower, feels +f                 v

    Parameters
    ----------
    upper, lower : str
        The nodes; one may be the ground.
    K : float
    n : float
    gap : float
    name : str, optional
        The name of the force in results; by default F, and F_2, F_3, ... for the next ones of a scheme without a name.
    symbols : tuple of str
        How drawings call the constant.

    Raises
    ------
    InputError
        If K is missing, not positive or not finite, n < 1, gap is not finite, or both ends are one node.

    Examples
    --------
    >>> HertzSpring("x", "ground", K=1e6).n
    1.5

    References
    ----------
    Grzesikiewicz and Zbiciak, Eq. (1); Johnson, *Contact Mechanics* (1985), section 4.2.
    """

    upper: str
    lower: str
    K: Annotated[float, "N/mⁿ, stiffness, positive"] = MISSING
    n: Annotated[float, "1, exponent, at least 1: 3/2 for smooth bodies, 2 for a cone"] = 1.5
    gap: Annotated[float, "m, opening when both coordinates are zero"] = 0.0
    name: str | None = None
    symbols: tuple[str, ...] = ("K",)

    reaction: ClassVar[str] = "F"
    strokes: ClassVar[tuple[Polyline, ...]] = (
        ((0.0, 0.0), (0.3, 0.0)),
        ((0.3, -0.6), (0.4, -0.54), (0.46, -0.36), (0.5, 0.0), (0.46, 0.36), (0.4, 0.54), (0.3, 0.6), (0.3, -0.6)),
        ((0.7, -0.6), (0.6, -0.54), (0.54, -0.36), (0.5, 0.0), (0.54, 0.36), (0.6, 0.54), (0.7, 0.6), (0.7, -0.6)),
        ((0.7, 0.0), (1.0, 0.0)),
    )
    split: ClassVar[float | None] = 0.5

    def __post_init__(self) -> None:
        distinct(self)
        positive(self, "K", self.K, "N/mⁿ")
        power_law_shape(self, self.n, self.gap)

    @property
    def nodes(self) -> tuple[str, ...]:
        """The two ends."""
        return (self.upper, self.lower)

    def contribute(self, terms: Terms) -> None:
        """Add the non-linear spring."""
        K, n, gap = map(number, (self.K, self.n, self.gap))
        law = PowerLaw(str(self), self.upper, self.lower, gap, K, n, name=self.name or self.reaction)
        terms.springs.append(law)


def power_law_shape(element: Element, n: float, gap: float) -> None:
    """Check the exponent, whose stiffness at δ = 0 is infinite below 1, and the gap."""
    finite(f"{element}: n", n, least=1.0)
    finite(f"{element}: gap", gap, "m")
