r"""The rope: tension only."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar

from lcpimpact.errors import InputError
from lcpimpact.formula import number
from lcpimpact.numbers import between, finite
from lcpimpact.scheme.elements.base import MISSING, Element, Polyline, described, distinct
from lcpimpact.scheme.terms import Row, Terms


@described
@dataclass(frozen=True)
class Rope(Element):
    r"""A rope that does not stretch: u := slack - (q_b - q_a), 0 <= u ⟂ T >= 0; T pulls the ends together.

    It is the mirror image of a `Bumper`, which pushes its plates apart; it stores no energy, and dissipates only in the
    jerk with e < 1 when it comes taut between two masses. For an elastic rope put a `Spring` in series, from one end of
    the Rope to the body.

    ::

        a o--~~~~--o b      taut at q_b - q_a = slack      | positive downwards
                            a feels +T, b feels -T         v

    Parameters
    ----------
    a, b : str
        The nodes that it joins; one may be the ground.
    slack : float
    e : float, optional
    name : str, optional
        The name of the tension; by default T, and T_2, T_3, ... for the next ones of a scheme without a name.
    symbols : tuple of str
        How drawings call the tension.

    Raises
    ------
    InputError
        If slack is missing or not finite, e lies outside [0, 1], or both ends are one node.

    Examples
    --------
    >>> Rope("ground", "x", slack=2.0, e=0.0).nodes
    ('ground', 'x')

    References
    ----------
    Glocker, *Set-Valued Force Laws* (2001), on unilateral laws.
    """

    a: str
    b: str
    slack: Annotated[float, "m, separation from zero coordinates at which the rope is taut"] = MISSING
    e: Annotated[float | None, "1, coefficient of restitution in [0, 1]; needed and refused as for a `Bumper`"] = None
    name: str | None = None
    symbols: tuple[str, ...] = ("T",)

    reaction: ClassVar[str] = "T"
    strokes: ClassVar[tuple[Polyline, ...]] = (
        (
            (0.0, 0.0), (0.15, 0.0), (0.22, 0.12), (0.32, 0.18), (0.42, 0.12), (0.5, 0.0),
            (0.58, -0.12), (0.68, -0.18), (0.78, -0.12), (0.85, 0.0), (1.0, 0.0),
        ),
    )  # fmt: skip

    def __post_init__(self) -> None:
        distinct(self)
        if self.slack is MISSING:
            raise InputError(f"{self}: slack is missing; give a number in m, 0 for a rope that is just taut")
        finite(f"{self}: slack", self.slack, "m")
        if self.e is not None:
            between(f"{self}: e", self.e, 0.0, 1.0)

    @property
    def nodes(self) -> tuple[str, ...]:
        """The two ends."""
        return (self.a, self.b)

    def contribute(self, terms: Terms) -> None:
        """Add a row to H and to u0, as of a bumper with its plates exchanged."""
        e = None if self.e is None else number(self.e)
        terms.rows.append(Row(str(self), self.name or self.reaction, self.b, self.a, number(self.slack), e))
