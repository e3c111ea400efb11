r"""The contact law of Hunt and Crossley: a Hertzian spring with loss."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar

from lcpimpact.scheme.elements.base import MISSING, Polyline, described, positive
from lcpimpact.scheme.elements.compliant import LOSSY_BALLS, CompliantContact, check_contact


@described
@dataclass(frozen=True)
class HuntCrossley(CompliantContact):
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

    strokes: ClassVar[tuple[Polyline, ...]] = LOSSY_BALLS
    split: ClassVar[float | None] = 0.5

    def __post_init__(self) -> None:
        check_contact(self, "K", "N/mⁿ", self.n)
        positive(self, "b", self.b, "s/m")

    @property
    def law(self) -> Mapping[str, float]:
        """The constants of its force."""
        return {"K": self.K, "n": self.n, "b": self.b}
