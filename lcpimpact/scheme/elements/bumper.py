r"""The bumper: a unilateral contact between two plates."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar

from lcpimpact.formula import number
from lcpimpact.numbers import between, finite
from lcpimpact.scheme.elements.base import Link, Polyline, described, distinct
from lcpimpact.scheme.terms import End, Row, Terms


@described
@dataclass(frozen=True)
class Bumper(Link):
    r"""A bumper: u := q_lower - q_upper + gap, 0 <= u ⟂ R >= 0; R pushes the plates apart.

    ::

            o  upper plate, feels -R
          ━━━━━
            u   (opening)                     | positive downwards
          ━━━━━                               v
            o  lower plate, feels +R

    Between two masses the velocity jumps at an impact, by Newton's law U⁺ = -e U⁻ for U = u'; if a plate is massless, on
    a spring or a dashpot, there is no impulse and no e, unless another bumper can stop that plate: then impulses pass
    through both. R does no work; an impact with e < 1 dissipates kinetic energy.

    Parameters
    ----------
    upper, lower : str or mapping
        The nodes of the plates; one may be the ground. A point of a body moves by a sum of coordinates, as
        {"y": 1.0, "φ": -0.1}; there R acts on y and 0.1 R, in the other sense, on φ.
    gap : float
    e : float, optional
    name : str, optional
        The name of the reaction; by default R, and R_2, R_3, ... for the next ones of a scheme without a name.
    symbols : tuple of str
        How drawings call the reaction.

    Raises
    ------
    InputError
        If gap is not finite, e lies outside [0, 1], or both plates are one node.

    Examples
    --------
    >>> Bumper("x", "z").nodes
    ('x', 'z')

    References
    ----------
    Grzesikiewicz and Zbiciak, Eq. (2c); Moreau (1988) for the law of impact.
    """

    upper: End
    lower: End
    gap: Annotated[float, "m, opening when both coordinates are zero"] = 0.0
    e: Annotated[
        float | None,
        "1, coefficient of restitution in [0, 1]; needed where impulses can act, since both sides have mass (or "
        "are ground) or other bumpers lead on over massless nodes to such a side; refused elsewhere",
    ] = None
    name: str | None = None
    symbols: tuple[str, ...] = ("R",)

    reaction: ClassVar[str] = "R"
    strokes: ClassVar[tuple[Polyline, ...]] = (
        ((0.0, 0.0), (0.44, 0.0)),
        ((0.44, -1.0), (0.44, 1.0)),
        ((0.56, -1.0), (0.56, 1.0)),
        ((0.56, 0.0), (1.0, 0.0)),
    )
    split: ClassVar[float | None] = 0.5

    def __post_init__(self) -> None:
        distinct(self)
        finite(f"{self}: gap", self.gap, "m")
        if self.e is not None:
            between(f"{self}: e", self.e, 0.0, 1.0)

    @property
    def ends(self) -> tuple[End, End]:
        """The upper and the lower plate."""
        return (self.upper, self.lower)

    def contribute(self, terms: Terms) -> None:
        """Add a row to H and to u0."""
        e = None if self.e is None else number(self.e)
        terms.rows.append(Row(str(self), self.name or self.reaction, self.upper, self.lower, number(self.gap), e))
