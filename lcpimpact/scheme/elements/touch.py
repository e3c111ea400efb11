r"""Contacts and joints of bodies in the plane."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar, NamedTuple

from lcpimpact.arguments import is_name
from lcpimpact.arrays import Array
from lcpimpact.errors import InputError
from lcpimpact.formula import Number
from lcpimpact.numbers import between, finite
from lcpimpact.registry import nearest
from lcpimpact.scheme.elements.base import GROUND, MISSING, described, named
from lcpimpact.scheme.elements.body import Body, Planar, Wall
from lcpimpact.scheme.lagrangian import FrictionContact, Joint
from lcpimpact.scheme.shapes import (
    Line,
    Placed,
    Point,
    Shape,
    ShapeGaps,
    checked_point,
    dot,
    gaps_between,
    keep,
    surrounds,
)
from lcpimpact.scheme.terms import Terms


class Partner(NamedTuple):
    """A body, a wall or the ground, and where its coordinates stand among all."""

    element: Body | Wall | None
    at: tuple[int, ...]

    def place(self, q: Array) -> Placed:
        """Return its place among coordinates, or its velocity among velocities."""
        return Placed(*(q[i] for i in self.at))

    def stands(self, q: Array) -> Placed:
        """Return its place; a wall has one of its own."""
        return Placed(self.element.x, self.element.y) if isinstance(self.element, Wall) else self.place(q)


class Coupling(Planar):
    """A contact or joint between two bodies, or of a body with a wall or the ground."""

    a: str
    b: str
    name: str | None

    def __post_init__(self) -> None:
        kind = type(self).__name__
        for each in (self.a, self.b):
            if not is_name(each):
                raise InputError(f"{each!r} of a {kind} must be the name of a body, of a wall, or {GROUND!r}")
        if self.a == self.b:
            raise InputError(f"{self}: a body is not coupled to itself; name two")
        named(self)

    def __str__(self) -> str:
        return f"{type(self).__name__} between {self.a!r} and {self.b!r}"

    @property
    def nodes(self) -> tuple[str, ...]:
        """The ground: a body names its own nodes."""
        return (GROUND,)

    @property
    def reaction_name(self) -> str:
        """The name of the reaction."""
        return self.name or self.reaction

    def contribute(self, terms: Terms) -> None:
        """Add nothing: a scheme traces the rows by `laws`."""

    def laws(self, surfaces: Mapping[str, Partner]) -> Iterator[FrictionContact | Joint]:
        """Return the contacts and joints, as functions of the coordinates of a scheme."""
        ends = []
        for each in (self.a, self.b):
            if each not in surfaces:
                raise InputError(f"{self}: {nearest(each, list(surfaces), 'body or wall')}")
            ends.append(surfaces[each])
        if not any(isinstance(end.element, Body) for end in ends):
            raise InputError(f"{self}: neither is a body, and nothing moves; name a Body")
        return self._laws(*ends)

    @abstractmethod
    def _laws(self, A: Partner, B: Partner) -> Iterator[FrictionContact | Joint]:
        """Yield the contacts and joints of two surfaces."""


@described
@dataclass(frozen=True)
class Touch(Coupling):
    r"""Contact of two shapes, with Coulomb's friction at the point where they touch.

    .. math:: 0 \le g \perp r_N \ge 0, \qquad -μ r_N \le r_T \le μ r_N, \quad\text{complementary to}\quad U_T

    ::

            ( a )     n from b to a,  t = (n_y, -n_x)
          ----o----   U_T = t·(v_a - v_b) at the point of contact
              b

    Discs touch lines and discs, and lie in hollow ones; each corner of a polygon, and each end of a rod, touches lines.
    Friction dissipates ``μ r_N |U_T|``, and impacts dissipate energy unless e = 1.

    Parameters
    ----------
    a, b : str
        A body, and another body or a wall, both with a shape.
    e : float
    mu : float
    e_T : float
    name : str, optional
        The name of the normal reaction; that of the friction is ``name`` and ``_T``. Corners have NAME.1, NAME.2, ..., in
        the order of the points. By default N, and N_2, N_3, ... for the next ones of a scheme without a name.

    Raises
    ------
    InputError
        If e is missing, or a number is out of its range; when a scheme is assembled, if a body is unknown, has no shape, or
        the two shapes are not among these pairs.

    Examples
    --------
    >>> from lcpimpact import Body, Disk, Line, Scheme, Wall
    >>> ball, floor = Body("ball", m=1.0, J=0.004, shape=Disk(0.1), g=9.81), Wall("floor", Line((0, 0), (1, 0)))
    >>> scheme = Scheme(ball, floor, Touch("ball", "floor", e=0.5, mu=0.2))
    >>> [contact.name for contact in scheme.assemble().contacts]
    ['N', 'N_T']

    References
    ----------
    Glocker, *Set-Valued Force Laws* (2001).
    """

    a: str
    b: str
    e: Annotated[float, "1, normal coefficient of restitution in [0, 1]"] = MISSING
    mu: Annotated[float, "1, coefficient of friction, at least 0; smooth by default"] = 0.0
    e_T: Annotated[float, "1, tangential coefficient of restitution in [0, 1]"] = 0.0
    name: str | None = None

    reaction: ClassVar[str] = "N"

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.e is MISSING:
            raise InputError(f"{self}: e is missing; give a coefficient of restitution from 0 to 1")
        between(f"{self}: e", self.e, 0.0, 1.0)
        finite(f"{self}: mu", self.mu, least=0.0)
        between(f"{self}: e_T", self.e_T, 0.0, 1.0)

    def _laws(self, A: Partner, B: Partner) -> Iterator[FrictionContact | Joint]:
        ends = [(A, self._shape(self.a, A)), (B, self._shape(self.b, B))]
        # Of two lines, the ends of the one that moves touch.
        ends.sort(key=lambda end: (surrounds(end[1]), isinstance(end[0].element, Wall)))
        (first, shape), (second, other) = ends
        found = gaps_between(shape, other)
        if found is None:
            raise InputError(
                f"{self}: a {type(shape).__name__} and a {type(other).__name__} do not touch here: give a disc and a line, "
                "two discs of which one may be hollow, or a polygon and a line"
            )
        for i, meets in enumerate(found, 1):
            name = f"{self.reaction_name}.{i}" if len(found) > 1 else self.reaction_name
            yield self._contact(name, meets, first, second)

    def _shape(self, name: str, end: Partner) -> Shape:
        """Return the shape of a body or wall, and refuse one without."""
        if end.element is None or end.element.shape is None:
            remedy = "name a Wall" if name == GROUND else "give it shape=Disk(R), Polygon(points) or Line(p, q)"
            raise InputError(f"{self}: {name!r} has no shape: {remedy}")
        return end.element.shape

    def _contact(self, name: str, meets: ShapeGaps, A: Partner, B: Partner) -> FrictionContact:
        def gap(t: float, q: Array) -> Number:
            return meets(A.stands(q), B.stands(q)).gap

        def slip(t: float, q: Array, v: Array) -> Number:
            return meets(A.stands(q), B.stands(q)).slip(A.place(v), B.place(v))

        rough = self.mu > 0.0 or self.e_T > 0.0
        return FrictionContact(name, gap, slip if rough else None, self.mu, self.e, self.e_T)


@described
@dataclass(frozen=True)
class Pin(Coupling):
    r"""A pin: a point of one body is one of another, and both turn freely; two joints, NAME.x and NAME.y.

    ::

          a ====o==== b     p of a at the place of q of b

    It stores and dissipates no energy.

    Parameters
    ----------
    a : str
        A body.
    p : pair of float
    b : str
        Another body, a wall or the ground.
    q : pair of float
    name : str, optional
        The name of the reaction; by default J, and J_2, J_3, ... for the next ones of a scheme without a name.

    Raises
    ------
    InputError
        If a point is no pair of finite numbers; when a scheme is assembled, if a body is unknown; and where a problem starts
        with the pin open.

    Examples
    --------
    A rod of 1 m that hangs by its upper end from (0, 0):

    >>> Pin("rod", (0.0, 0.5), "ground").q
    (0.0, 0.0)
    """

    a: str
    p: Annotated[Point, "m, point, seen from the centre of mass of a"]
    b: str = GROUND
    q: Annotated[Point, "m, point, seen from the centre of mass of b, or from the origin of the ground"] = (0.0, 0.0)
    name: str | None = None

    reaction: ClassVar[str] = "J"

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in "pq":
            keep(self, name, checked_point(f"{self}: {name}", getattr(self, name)))

    def _laws(self, A: Partner, B: Partner) -> Iterator[FrictionContact | Joint]:
        def along(i: int) -> Callable[[float, Array], Number]:
            return lambda t, q: A.stands(q).point(self.p)[i] - B.stands(q).point(self.q)[i]

        for i, axis in enumerate("xy"):
            yield Joint(f"{self.reaction_name}.{axis}", along(i))


@described
@dataclass(frozen=True)
class Guide(Coupling):
    r"""A guide: a point of a body moves on a line of another, or of the ground; it may hold the angle too.

    ::

          b ----o----   p of a on a line of b
               / a

    It stores and dissipates no energy.

    Parameters
    ----------
    a : str
        A body.
    p : pair of float
    line : Line
        The line, seen from the centre of mass of b.
    b : str
        Another body, a wall or the ground.
    phi : float, optional
    name : str, optional
        The name of the reaction, and of the moment with ``.φ`` behind it; by default J, and J_2, J_3, ... for the next ones
        of a scheme without a name.

    Raises
    ------
    InputError
        As `Pin`, and if the line is none or phi not finite.

    Examples
    --------
    A piston that slides along x and does not turn:

    >>> from lcpimpact import Line
    >>> piston = Guide("piston", (0.0, 0.0), Line((0.0, 0.0), (1.0, 0.0)), phi=0.0)
    """

    a: str
    p: Annotated[Point, "m, point, seen from the centre of mass of a"]
    line: Line
    b: str = GROUND
    phi: Annotated[float | None, "rad, angle of a from b, where it is held; free by default"] = None
    name: str | None = None

    reaction: ClassVar[str] = "J"

    def __post_init__(self) -> None:
        super().__post_init__()
        keep(self, "p", checked_point(f"{self}: p", self.p))
        if not isinstance(self.line, Line):
            raise InputError(f"{self}: line = {self.line!r} must be a Line of two points")
        if self.phi is not None:
            finite(f"{self}: phi", self.phi, "rad")

    def _laws(self, A: Partner, B: Partner) -> Iterator[FrictionContact | Joint]:
        def off(t: float, q: Array) -> Number:
            a, b = A.stands(q), B.stands(q)
            x, y = a.point(self.p)
            return dot(b.turned(self.line.normal), (x - b.x, y - b.y)) - self.line.height

        yield Joint(self.reaction_name, off)
        if (phi := self.phi) is not None:
            yield Joint(f"{self.reaction_name}.φ", lambda t, q: A.stands(q).φ - B.stands(q).φ - phi)
