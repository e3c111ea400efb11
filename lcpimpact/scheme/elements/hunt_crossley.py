r"""The contact law of Hunt and Crossley: a Hertzian spring with loss."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar

from lcpimpact.formula import number
from lcpimpact.scheme.elements.base import MISSING, Element, Polyline, described, distinct, positive
from lcpimpact.scheme.elements.hertz_spring import HertzSpring, power_law_shape
from lcpimpact.scheme.terms import PowerLaw, Terms


@described
@dataclass(frozen=True)
class HuntCrossley(Element):
    r"""Hunt and Crossley's contact: f = K δⁿ (1 + b δ'), and no force apart.

    The damping grows with the penetration, so the force starts from zero and, in free rebound, ends at zero without tension.
    It stores K δⁿ⁺¹/(n + 1) and dissipates b K δⁿ δ'². Pulled apart faster than 1/b from outside, it would pull.

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
    b : float
    n : float
    gap : float
    name : str, optional
        The name of the force in results; by default F, and F_2, F_3, ... for the next ones of a scheme without a name.
    symbols : tuple of str
        How drawings call the two constants.

    Raises
    ------
    InputError
        If K or b is missing, not positive or not finite, n < 1, gap is not finite, or both ends are one node.

    Examples
    --------
    >>> HuntCrossley("x", "ground", K=1e6, b=0.1).b
    0.1

    References
    ----------
    Hunt and Crossley, Coefficient of restitution interpreted as damping in vibroimpact (1975).
    """

    upper: str
    lower: str
    K: Annotated[float, "N/mⁿ, stiffness, positive"] = MISSING
    b: Annotated[float, "s/m, loss, positive"] = MISSING
    n: Annotated[float, "1, exponent, at least 1: 3/2 for smooth bodies"] = 1.5
    gap: Annotated[float, "m, opening when both coordinates are zero"] = 0.0
    name: str | None = None
    symbols: tuple[str, ...] = ("K", "b")

    reaction: ClassVar[str] = "F"
    strokes: ClassVar[tuple[Polyline, ...]] = (
        *HertzSpring.strokes,
        ((0.3, 0.6), (0.3, 0.9), (0.5, 0.9)),
        ((0.5, 0.78), (0.5, 1.02)),
        ((0.4, 1.08), (0.6, 1.08), (0.6, 0.72), (0.4, 0.72)),
        ((0.6, 0.9), (0.7, 0.9), (0.7, 0.6)),
    )
    split: ClassVar[float | None] = HertzSpring.split

    def __post_init__(self) -> None:
        distinct(self)
        positive(self, "K", self.K, "N/mⁿ")
        positive(self, "b", self.b, "s/m")
        power_law_shape(self, self.n, self.gap)

    @property
    def nodes(self) -> tuple[str, ...]:
        """The two ends."""
        return (self.upper, self.lower)

    def contribute(self, terms: Terms) -> None:
        """Add the non-linear spring."""
        K, n, b, gap = map(number, (self.K, self.n, self.b, self.gap))
        law = PowerLaw(str(self), self.upper, self.lower, gap, K, n, b, name=self.name or self.reaction)
        terms.springs.append(law)
