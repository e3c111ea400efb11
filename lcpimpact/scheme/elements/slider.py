r"""The slider of Coulomb and St-Venant: dry friction."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar

from lcpimpact.formula import number
from lcpimpact.scheme.elements.base import MISSING, Link, Polyline, described, distinct, positive
from lcpimpact.scheme.laws import SLIDER
from lcpimpact.scheme.terms import End, Row, Terms


@described
@dataclass(frozen=True)
class Slider(Link):
    r"""Dry friction: the force F between -r0 and r0 is what keeps the ends together, or r0 against the sliding.

    With U = v_b - v_a, the law is -r0 <= F <= r0, and

    - F = -r0 where U > 0,
    - F = +r0 where U < 0,
    - anything between where U = 0 (the ends stick):

    the boxed complementarity -r0 <= F <= r0 ⟂ U, which dissipates |F U| = r0 |U|.

    ::

        a o------[=====]------o b     a feels -F, b feels +F
                 -------              positive downwards

    Parameters
    ----------
    a, b : str or mapping
        The nodes that it joins, or sums of coordinates as {"x": 1.0, "φ": -0.1}; one may be the ground.
    r0 : float
    name : str, optional
        The name of the force F in results; by default F, and F_2, F_3, ... for the next ones of a scheme without a name.
    symbols : tuple of str
        How drawings call the threshold.

    Raises
    ------
    InputError
        If r0 is missing, not positive or not finite, or both ends are one node.

    Examples
    --------
    >>> Slider("x", "ground", r0=2.0).r0
    2.0

    References
    ----------
    Acary and Brogliato, *Numerical Methods for Nonsmooth Dynamical Systems* (2008), section 3.9.
    """

    a: End
    b: End
    r0: Annotated[float, "N, threshold, positive: Coulomb's μN, or the yield force of St-Venant's element"] = MISSING
    name: str | None = None
    symbols: tuple[str, ...] = ("r_0",)

    reaction: ClassVar[str] = "F"
    strokes: ClassVar[tuple[Polyline, ...]] = (
        ((0.0, 0.0), (0.34, 0.0)),
        ((0.34, 0.16), (0.34, -0.34), (0.66, -0.34), (0.66, 0.16), (0.34, 0.16)),
        ((0.22, 0.22), (0.8, 0.22)),
        ((0.8, 0.22), (0.8, 0.0), (1.0, 0.0)),
    )
    split: ClassVar[float | None] = 0.7

    def __post_init__(self) -> None:
        distinct(self)
        positive(self, "r0", self.r0, "N")

    @property
    def ends(self) -> tuple[End, End]:
        """The two ends."""
        return (self.a, self.b)

    def contribute(self, terms: Terms) -> None:
        """Add a row to H, with a box as its law."""
        bounds = (-number(self.r0), number(self.r0))
        name = self.name or self.reaction
        terms.rows.append(Row(str(self), name, self.a, self.b, 0.0, law=SLIDER, bounds=bounds))
