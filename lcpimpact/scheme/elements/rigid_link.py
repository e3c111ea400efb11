r"""The rigid link: a bilateral constraint."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from lcpimpact.scheme.elements.base import Link, Polyline, distinct
from lcpimpact.scheme.laws import JOINT
from lcpimpact.scheme.terms import End, Row, Terms


@dataclass(frozen=True)
class RigidLink(Link):
    r"""A rigid link: its ends move together, q_b - q_a = 0, and its force J, which pushes them apart, has any sign.

    It stores and dissipates no energy; in impacts it transmits impulses. With sums of coordinates
    it is a gear, a lever or a guide.

    ::

        a o======o b     a feels -J, b feels +J

    Parameters
    ----------
    a, b : str or mapping
        The nodes that it joins, or sums of coordinates as {"x": 1.0, "φ": -0.1}; one may be the ground.
    name : str, optional
        The name of the force J in results; by default J, and J_2, J_3, ... for the next ones of a scheme without a name.
    symbols : tuple of str
        How drawings call the force.

    Raises
    ------
    InputError
        If both ends are one.

    Examples
    --------
    A body that rolls, x = 0.1 φ:

    >>> RigidLink({"x": 1.0}, {"φ": 0.1}).nodes
    ('x', 'φ')

    References
    ----------
    Glocker, *Set-Valued Force Laws* (2001), chapter 5.
    """

    a: End
    b: End
    name: str | None = None
    symbols: tuple[str, ...] = ("J",)

    reaction: ClassVar[str] = "J"
    strokes: ClassVar[tuple[Polyline, ...]] = (
        ((0.0, 0.0), (0.1, 0.0)),
        ((0.1, -0.12), (0.9, -0.12), (0.9, 0.12), (0.1, 0.12), (0.1, -0.12)),
        ((0.9, 0.0), (1.0, 0.0)),
    )

    def __post_init__(self) -> None:
        distinct(self)

    @property
    def ends(self) -> tuple[End, End]:
        """The two ends."""
        return (self.a, self.b)

    def contribute(self, terms: Terms) -> None:
        """Add a row to H, with a force of any sign."""
        bounds = (-math.inf, math.inf)
        name = self.name or self.reaction
        terms.rows.append(Row(str(self), name, self.a, self.b, 0.0, law=JOINT, bounds=bounds))
