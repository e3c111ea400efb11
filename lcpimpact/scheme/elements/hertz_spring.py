r"""The contact spring of Hertz."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar

from lcpimpact.scheme.elements.base import MISSING, Polyline, described
from lcpimpact.scheme.elements.compliant import BALLS, CompliantContact, check_contact


@described
@dataclass(frozen=True)
class HertzSpring(CompliantContact):
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

    strokes: ClassVar[tuple[Polyline, ...]] = BALLS
    split: ClassVar[float | None] = 0.5

    def __post_init__(self) -> None:
        check_contact(self, "K", "N/mⁿ", self.n)

    @property
    def law(self) -> Mapping[str, float]:
        """The constants of its force."""
        return {"K": self.K, "n": self.n}
