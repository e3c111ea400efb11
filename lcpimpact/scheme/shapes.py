r"""Shapes of bodies and walls, and where two of them meet.

Points are seen from the centre of mass of the body, before it turns. With the unit normal n from B to A, the tangent
``t = (n_y, -n_x)``, and the points of contact at the distances ``h_A = n·r_A`` and ``h_B = n·r_B`` from the two centres
along n, the surfaces slide at

.. math:: U_T = t \cdot (v_A - v_B) - h_A ω_A + h_B ω_B .

A disc has ``h_A = -R_A``; so a disc on a floor has ``x' + R φ'``, and two discs ``t·(v_A - v_B) + R_A ω_A + R_B ω_B``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

from lcpimpact.arguments import is_sequence
from lcpimpact.errors import InputError
from lcpimpact.formula import Formula, Number, sqrt
from lcpimpact.numbers import is_real, positive

Point: TypeAlias = Sequence[float]
"""A pair of x and y in m."""

Vector: TypeAlias = tuple[Number, Number]


def checked_point(what: str, given: Point) -> tuple[float, float]:
    """Return a point as a pair of floats, and refuse what is none."""
    if not is_sequence(given) or len(given) != 2 or not all(map(is_real, given)):
        raise InputError(f"{what} = {given!r} must be a point (x, y) of two finite numbers in m")
    return float(given[0]), float(given[1])


def keep(thing: object, name: str, points: Sequence[Point] | Point) -> None:
    """Keep points of a frozen object as tuples, by which schemes are compared."""
    object.__setattr__(thing, name, points)


@dataclass(frozen=True)
class Disk:
    """A disc about the centre of mass, or the round inside of a bowl.

    Parameters
    ----------
    R : float
        Radius in m, positive.
    hollow : bool
        Whether it is a bowl: it holds discs within, and touches none without.

    Examples
    --------
    >>> Disk(0.1)
    Disk(R=0.1, hollow=False)
    """

    R: float
    hollow: bool = False

    def __post_init__(self) -> None:
        positive("R of a Disk", self.R, "m")
        if not isinstance(self.hollow, bool):
            raise InputError(f"hollow = {self.hollow!r} of a Disk must be True or False")


@dataclass(frozen=True)
class Line:
    """A straight wall through two points, free on its left; of a rod, the segment between its ends.

    Parameters
    ----------
    p, q : pair of float
        Two points in m. Whoever goes from p to q has the free side on his left. The wall is as long as need be; against
        another line a rod touches by the ends p and q.

    Examples
    --------
    A floor, and a wall on its right:

    >>> Line((0.0, 0.0), (1.0, 0.0)).normal, Line((2.0, 0.0), (2.0, 1.0)).normal
    ((-0.0, 1.0), (-1.0, 0.0))
    """

    p: Point
    q: Point

    def __post_init__(self) -> None:
        for name in "pq":
            keep(self, name, checked_point(f"{name} of a Line", getattr(self, name)))
        if self.p == self.q:
            raise InputError(f"a Line from {self.p} to {self.q} has no direction: give two different points")

    @property
    def normal(self) -> tuple[float, float]:
        """The unit vector to the left."""
        x, y = self.q[0] - self.p[0], self.q[1] - self.p[1]
        length = math.hypot(x, y)
        return -y / length, x / length

    @property
    def height(self) -> float:
        """Distance of the line from the centre of mass along the normal."""
        return self.normal[0] * self.p[0] + self.normal[1] * self.p[1]

    @property
    def points(self) -> tuple[Point, ...]:
        """The two ends."""
        return self.p, self.q


@dataclass(frozen=True)
class Polygon:
    """A polygon, which touches lines by its corners.

    Parameters
    ----------
    points : sequence of pairs of float
        At least three corners in m, counterclockwise.

    Examples
    --------
    >>> Polygon([(-0.1, -0.4), (0.1, -0.4), (0.1, 0.4), (-0.1, 0.4)]).points[0]
    (-0.1, -0.4)
    """

    points: Sequence[Point]

    def __post_init__(self) -> None:
        if not is_sequence(self.points) or len(self.points) < 3:
            raise InputError(f"points = {self.points!r} of a Polygon must be three corners (x, y) or more")
        points = tuple(checked_point(f"corner {i} of a Polygon", each) for i, each in enumerate(self.points, 1))
        keep(self, "points", points)
        area = sum(a[0] * b[1] - a[1] * b[0] for a, b in zip(points, (*points[1:], points[0]), strict=True))
        if not area > 0.0:
            raise InputError(
                f"the points {list(points)} of a Polygon run clockwise or enclose nothing: list its corners counterclockwise"
            )


Shape: TypeAlias = Disk | Polygon | Line

SHAPES: dict[str, type[Shape]] = {each.__name__: each for each in (Disk, Polygon, Line)}


class Placed(NamedTuple):
    """The place of a body, or its velocity: x, y, and the angle φ or its rate."""

    x: Number = 0.0
    y: Number = 0.0
    φ: Number = 0.0

    def turned(self, p: Point) -> Vector:
        """Return a vector of the body, as it stands at the angle φ."""
        if not isinstance(self.φ, Formula):
            return p[0], p[1]
        c, s = self.φ.cos(), self.φ.sin()
        return c * p[0] - s * p[1], s * p[0] + c * p[1]

    def point(self, p: Point) -> Vector:
        """Return the place of a point of the body."""
        x, y = self.turned(p)
        return self.x + x, self.y + y


class ShapeGap(NamedTuple):
    """Gap of two surfaces A and B, unit normal from B to A, and distances h_A and h_B of the contact along it."""

    gap: Number
    n: Vector
    h_A: Number
    h_B: Number

    def slip(self, A: Placed, B: Placed) -> Number:
        """Return U_T for the velocities of both."""
        x, y = self.n
        return y * (A.x - B.x) - x * (A.y - B.y) - self.h_A * A.φ + self.h_B * B.φ


ShapeGaps: TypeAlias = Callable[[Placed, Placed], ShapeGap]


def dot(a: Sequence[Number], b: Sequence[Number]) -> Number:
    """Return the inner product of two vectors."""
    return a[0] * b[0] + a[1] * b[1]


def surrounds(shape: Shape) -> bool:
    """Return whether a shape stands second in a pair: a line, or a bowl."""
    return isinstance(shape, Line) or (isinstance(shape, Disk) and shape.hollow)


def gaps_between(a: Shape, b: Shape) -> list[ShapeGaps] | None:
    """Return the gaps of a pair of shapes, of which ``b`` may be a line or a bowl, one a contact; None for other pairs."""
    if isinstance(a, Disk) and isinstance(b, Disk) and not a.hollow:
        return [_disc_on_disc(a, b)]
    if isinstance(a, Disk) and isinstance(b, Line) and not a.hollow:
        return [_disc_on_line(a, b)]
    if isinstance(a, Polygon | Line) and isinstance(b, Line):
        return [_corner_on_line(corner, b) for corner in a.points]
    return None


def _disc_on_disc(a: Disk, b: Disk) -> ShapeGaps:
    side = -1.0 if b.hollow else 1.0

    def meets(A: Placed, B: Placed) -> ShapeGap:
        x, y = A.x - B.x, A.y - B.y
        distance = sqrt(x * x + y * y)
        n = side * x / distance, side * y / distance
        return ShapeGap(side * (distance - b.R) - a.R, n, -a.R, side * b.R)

    return meets


def _disc_on_line(a: Disk, b: Line) -> ShapeGaps:
    def meets(A: Placed, B: Placed) -> ShapeGap:
        n = B.turned(b.normal)
        return ShapeGap(dot(n, (A.x - B.x, A.y - B.y)) - b.height - a.R, n, -a.R, b.height)

    return meets


def _corner_on_line(corner: Point, b: Line) -> ShapeGaps:
    def meets(A: Placed, B: Placed) -> ShapeGap:
        n = B.turned(b.normal)
        h = dot(n, A.turned(corner))
        return ShapeGap(dot(n, (A.x - B.x, A.y - B.y)) + h - b.height, n, h, b.height)

    return meets
