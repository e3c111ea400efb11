r"""The ElastoGap of Modelica: a stop whose damping is no larger than the force of its spring."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar

from lcpimpact.scheme.elements.base import MISSING, Polyline, described
from lcpimpact.scheme.elements.compliant import STOP, CompliantContact, check_contact, check_damping


@described
@dataclass(frozen=True)
class ElastoGap(CompliantContact):
    r"""Modelica's ElastoGap: f = k δⁿ + min(max(c δ', -k δⁿ), k δⁿ) for δ > 0, and no force apart.

    The damping is no larger than the force of the spring: the force starts from zero, as that of a spring of 2 k, and never
    pulls. With n = 1 a free mass m returns with a restitution e of ζ = c/(2 sqrt(k m)) alone, after the time T (ω² = k/m),

    .. math:: e = e^{-ζ τ}, \quad T = \frac{\arctan(2 \sqrt 2\, ζ)}{\sqrt 2\, ω} + \frac τω, \quad
              τ = \frac{1}{\sqrt{1 - ζ^2}}
              \Bigl(2 \arccos ζ - \arctan \frac{2 ζ \sqrt{1 - ζ^2}}{1 + 2 ζ^2}\Bigr) .

    It stores k δⁿ⁺¹/(n + 1) and dissipates the rest.

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
    n : float
    gap : float
    name : str, optional
        The name of the force in results; by default F, and F_2, F_3, ... for the next ones of a scheme without a name.
    symbols : tuple of str
        How drawings call the two constants.

    Raises
    ------
    InputError
        If k or c is missing or not finite, k is not above zero or c is below it, n < 1, gap is not finite, or both ends are
        one node.

    Examples
    --------
    >>> ElastoGap("x", "ground", k=10.0, c=1.5).n
    1.0

    References
    ----------
    Modelica Standard Library, Mechanics.Translational.Components.ElastoGap, with k = c s_ref^(1 - n).
    """

    upper: str
    lower: str
    k: Annotated[float, "N/mⁿ, stiffness, positive"] = MISSING
    c: Annotated[float, "N s/m, damping, zero or positive"] = MISSING
    n: Annotated[float, "1, exponent, at least 1"] = 1.0
    gap: Annotated[float, "m, opening when both coordinates are zero"] = 0.0
    name: str | None = None
    symbols: tuple[str, ...] = ("k", "c")

    strokes: ClassVar[tuple[Polyline, ...]] = STOP
    split: ClassVar[float | None] = 0.2

    def __post_init__(self) -> None:
        check_contact(self, "k", "N/mⁿ", self.n)
        check_damping(self, "c", "N s/m")

    @property
    def law(self) -> Mapping[str, float]:
        """The constants of its force, which is between 0 and 2 k δⁿ."""
        return {"K": self.k, "n": self.n, "c": self.c, "least": 0.0, "most": 2.0}
