r"""Bodies in the plane, and the walls of the ground."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from lcpimpact.arguments import is_name
from lcpimpact.errors import InputError
from lcpimpact.numbers import finite
from lcpimpact.scheme.elements.base import GROUND, MISSING, Element, described, positive
from lcpimpact.scheme.shapes import SHAPES, Shape
from lcpimpact.scheme.terms import Terms


class Planar(Element):
    """An element of the plane, which drawings of schemes along a line leave out."""

    symbols = ()

    @property
    def inner(self) -> tuple[str, ...]:
        """None."""
        return ()

    def drawn(self) -> tuple[Element, ...]:
        """Return nothing."""
        return ()


@described
@dataclass(frozen=True)
class Body(Planar):
    r"""A rigid body in the plane: x and y of its centre of mass, y upwards, and its angle φ, counterclockwise.

    ::

           y ^    _____
             |   /  φ  \
             |  |   o---|--       nodes NAME.x, NAME.y, NAME.φ
             |   \_____/
             +------------> x

    It adds m, m and J to M; kinetic energy ½ m (x'² + y'²) + ½ J φ'². Springs, dashpots and loads act on its nodes. Bodies
    touch, and are joined, by `Touch`, `Pin` and `Guide`.

    Parameters
    ----------
    name : str
        The first part of the names of its nodes.
    m : float
    J : float
    shape : Disk, Polygon or Line, optional
        Its outline, with points seen from the centre of mass; needed where it touches.
    g : float

    Raises
    ------
    InputError
        If m or J is missing, not positive or not finite, g is not finite, or the shape is none.

    Examples
    --------
    >>> from lcpimpact import Disk
    >>> Body("ball", m=1.0, J=0.004, shape=Disk(0.1), g=9.81).nodes
    ('ball.x', 'ball.y', 'ball.φ')
    """

    name: str
    m: Annotated[float, "kg, mass, positive"] = MISSING
    J: Annotated[float, "kg m², moment of inertia about the centre of mass, positive"] = MISSING
    shape: Shape | None = None
    g: Annotated[float, "m/s², gravity, against y; none by default, as for masses"] = 0.0

    def __post_init__(self) -> None:
        check_shape(self, self.name, self.shape)
        positive(self, "m", self.m, "kg")
        positive(self, "J", self.J, "kg m²")
        finite(f"{self}: g", self.g, "m/s²")

    def __str__(self) -> str:
        return f"Body {self.name!r}"

    @property
    def nodes(self) -> tuple[str, ...]:
        """Its coordinates."""
        return f"{self.name}.x", f"{self.name}.y", f"{self.name}.φ"

    def contribute(self, terms: Terms) -> None:
        """Add the mass and the moment of inertia to M, and the weight to f."""
        for node, value in zip(self.nodes, (self.m, self.m, self.J), strict=True):
            terms.M.add(value, (terms.index[node],) * 2)
        if self.g:
            terms.loads.append((terms.index[self.nodes[1]], -self.m * self.g))


@described
@dataclass(frozen=True)
class Wall(Planar):
    r"""A surface of the ground, which bodies touch: a floor, a bowl, a peg, the edge of a table.

    ::

              n ^
                |            a Line is free on the left of its way from p to q
          p ----+---- q
          /////////////

    It stores no energy; what touches it dissipates.

    Parameters
    ----------
    name : str
    shape : Line, Disk or Polygon
        Its outline, with points seen from (x, y).
    x : float
    y : float

    Raises
    ------
    InputError
        If the shape is none, or x or y not finite.

    Examples
    --------
    >>> from lcpimpact import Line
    >>> floor = Wall("floor", Line((0.0, 0.0), (1.0, 0.0)))
    """

    name: str
    shape: Shape = MISSING
    x: Annotated[float, "m, place"] = 0.0
    y: Annotated[float, "m, place, upwards"] = 0.0

    def __post_init__(self) -> None:
        check_shape(self, self.name, self.shape)
        if self.shape is None:
            raise InputError(f"{self}: shape is missing; give a {', '.join(SHAPES)}")
        for name in "xy":
            finite(f"{self}: {name}", getattr(self, name), "m")

    def __str__(self) -> str:
        return f"Wall {self.name!r}"

    @property
    def nodes(self) -> tuple[str, ...]:
        """The ground."""
        return (GROUND,)

    def contribute(self, terms: Terms) -> None:
        """Add nothing: what touches it does."""


def check_shape(element: Element, name: str, shape: Shape | None) -> None:
    """Refuse what is no name or no shape."""
    if not is_name(name) or name == GROUND:
        raise InputError(f"name = {name!r} of a {type(element).__name__} must be a string other than {GROUND!r}")
    if shape is not None and not isinstance(shape, tuple(SHAPES.values())):
        raise InputError(f"{element}: shape = {shape!r} must be a {', '.join(SHAPES)}")
