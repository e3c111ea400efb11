r"""The IMPACT function of Adams: a power law whose damping grows with the penetration by a step function."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar

from lcpimpact.scheme.elements.base import MISSING, Polyline, described, positive
from lcpimpact.scheme.elements.compliant import STOP, CompliantContact, check_contact, check_damping


@described
@dataclass(frozen=True)
class ImpactFunction(CompliantContact):
    r"""The function IMPACT of Adams and SolidWorks Motion: f = max(0, K δⁿ + c z² (3 - 2 z) δ'), and no force apart.

    z = min(δ/d, 1): the damping grows with the penetration by their function STEP, and is full at the ``depth`` d. So the
    force starts from zero, and never pulls. The restitution depends on the greatest penetration relative to d, and so on
    the speed. For a d that is small beside that penetration it is a `KelvinVoigtStop` if n = 1. With n < 2 a force that has
    ended begins again just before the ends part, where the spring outweighs the damping: `event-driven` may step over that
    push, which changes e in the sixth digit.

    It stores K δⁿ⁺¹/(n + 1) and dissipates the rest.

    ::

                                +--/\/\/\--+
        o upper   |      |------|    K     |--- o lower      | positive downwards
          feels -f              +---[ |----+      feels +f   v
                  δ = q_upper - q_lower - gap

    Parameters
    ----------
    upper, lower : str
        The nodes; one may be the ground.
    K : float
    c : float
    depth : float
    n : float
    gap : float
    name : str, optional
        The name of the force in results; by default F, and F_2, F_3, ... for the next ones of a scheme without a name.
    symbols : tuple of str
        How drawings call the two constants.

    Raises
    ------
    InputError
        If K, c, depth or n is missing or not finite, K or depth is not above zero or c is below it, n < 1, gap is not
        finite, or both ends are one node.

    Examples
    --------
    >>> ImpactFunction("x", "ground", K=1e8, c=1e4, depth=1e-4, n=1.5).depth
    0.0001

    References
    ----------
    Dassault Systèmes, SolidWorks Motion, IMPACT and STEP: IMPACT(x, x', x1, k, e, cmax, d), with K = k and n = e.
    """

    upper: str
    lower: str
    K: Annotated[float, "N/mⁿ, stiffness, positive"] = MISSING
    c: Annotated[float, "N s/m, greatest damping, zero or positive"] = MISSING
    depth: Annotated[float, "m, penetration of full damping, positive"] = MISSING
    n: Annotated[float, "1, exponent, at least 1"] = MISSING
    gap: Annotated[float, "m, opening when both coordinates are zero"] = 0.0
    name: str | None = None
    symbols: tuple[str, ...] = ("K", "c")

    strokes: ClassVar[tuple[Polyline, ...]] = STOP
    split: ClassVar[float | None] = 0.2

    def __post_init__(self) -> None:
        positive(self, "n", self.n, "1")
        check_contact(self, "K", "N/mⁿ", self.n)
        check_damping(self, "c", "N s/m")
        positive(self, "depth", self.depth, "m")

    @property
    def law(self) -> Mapping[str, float]:
        """The constants of its force, which does not pull."""
        return {"K": self.K, "n": self.n, "c": self.c, "depth": self.depth, "least": 0.0}
