r"""A non-linear dashpot: a power of the rate, in one or both directions, or a table."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated, ClassVar, Literal, TypeAlias, get_args

from lcpimpact.errors import InputError
from lcpimpact.formula import NotTracedError, mentions
from lcpimpact.registry import nearest
from lcpimpact.scheme.elements.base import MISSING, Element, Polyline, described, distinct, positive
from lcpimpact.scheme.elements.dashpot import Dashpot
from lcpimpact.scheme.signals import number_field
from lcpimpact.scheme.terms import RateLaw, Terms

LawOfRate: TypeAlias = Literal["power", "compression", "extension", "table"]
"""Laws of a non-linear dashpot."""


@described
@dataclass(frozen=True)
class NonlinearDashpot(Element):
    r"""A non-linear dashpot: with v = v_b - v_a a force F(v) on node a and its opposite on node b; dissipates F(v) v.

    By the law "power" F = c \|v\|ⁿ sign v; where ``c_extension`` is given, it is the constant for v > 0, and c that for
    v < 0. By "compression" it is that for v < 0 alone, by "extension" for v > 0, and zero in the other direction. By "table"
    it is linear between points (v_i, F_i) and goes on straight beyond the first and the last.

    ::

                +----+
        a o-----|  --|--o b      pulls a towards b when v_b - v_a > 0, by F(v)
                +----+

    At a node without mass, as the paper's plate, the force must rise with the rate in both directions, so that it
    determines the rate, and a `Spring` or `Dashpot` stands beside it: the rate is that of k z + F(z') = R. A dashpot that
    acts in one direction stands there beside a `Dashpot`. `moreau-jean` takes any n there; `event-driven` and the explicit
    Runge-Kutta methods refuse the slope zero of n > 1 at rest, with which a plate comes to rest infinitely fast, and an
    infinite one, n < 1, on which masses act. Other methods take no such dashpots.

    Parameters
    ----------
    a, b : str
        The nodes that it joins; one may be the ground.
    law : str
        "power", "compression", "extension" or "table".
    c : float
    n : float
    c_extension : float, optional
    rates, forces : sequence of float
        v_i in m/s, ascending, and F_i in N, of the law "table": two points or more; F(0) = 0, and F does not fall.
    symbols : tuple of str
        How drawings call the constant.

    Raises
    ------
    InputError
        If a constant is missing, not positive or not finite, or belongs to another law; if a table falls, or
        has a force that drives the motion; or if both ends are one node. When a scheme is assembled, if its force leaves
        the rate of a node without mass undetermined.

    Examples
    --------
    Quadratic drag, under which a body falls at most with sqrt(m g/c) = 10 m/s:

    >>> from lcpimpact import Load, Mass, Problem, Scheme, simulate
    >>> body = Scheme(Mass("x", m=2.0), Load("x", f=20.0), NonlinearDashpot("x", "ground", c=0.2, n=2.0))
    >>> round(float(simulate(Problem("parachute", body), dt=0.01, t_end=10.0)["v_x"][-1]), 6)
    10.0

    A shock absorber that is softer in compression, by a table:

    >>> NonlinearDashpot("x", "y", law="table", rates=[-1.0, 0.0, 0.5, 1.0], forces=[-300.0, 0.0, 500.0, 700.0]).forces
    (-300.0, 0.0, 500.0, 700.0)

    References
    ----------
    Dixon, *The Shock Absorber Handbook* (2007).
    """

    a: str
    b: str
    law: LawOfRate = "power"
    c: Annotated[float, "N sⁿ/mⁿ, damping, positive"] = MISSING
    n: Annotated[float, "1, exponent, positive"] = MISSING
    c_extension: Annotated[float | None, "N sⁿ/mⁿ, damping where the ends part, positive"] = None
    rates: Sequence[float] = ()
    forces: Sequence[float] = ()
    symbols: tuple[str, ...] = ("c",)

    strokes: ClassVar[tuple[Polyline, ...]] = (
        *Dashpot.strokes,
        ((0.28, -0.75), (0.44, -0.65), (0.58, -0.35), (0.62, 0.0), (0.66, 0.35), (0.72, 0.6), (0.84, 0.78)),
    )
    split: ClassVar[float | None] = Dashpot.split

    def __post_init__(self) -> None:
        distinct(self)
        if self.law not in get_args(LawOfRate):
            raise InputError(nearest(str(self.law), list(get_args(LawOfRate)), "law of a NonlinearDashpot"))
        if self.law == "table":
            given = [name for name in ("c", "n", "c_extension") if getattr(self, name) is not MISSING]
            if given:
                raise InputError(f"{self}: {given[0]} belongs to a power, and its law is a table: leave it out")
            self._check_table()
            return
        positive(self, self.symbols[0], self.c, "N sⁿ/mⁿ")
        positive(self, "n", self.n, "1")
        if self.c_extension is not None:
            if self.law != "power":
                raise InputError(f"{self}: c_extension is of the law 'power', of both directions: leave it out")
            positive(self, "c_extension", self.c_extension, "N sⁿ/mⁿ")
        if len(self.rates) or len(self.forces):
            raise InputError(f"{self}: rates and forces are of the law 'table': give law='table', or leave them out")

    def _check_table(self) -> None:
        v = number_field(self, "rates")
        F = number_field(self, "forces")
        if len(v) != len(F) or len(v) < 2:
            raise InputError(f"{self}: it has {len(v)} rates and {len(F)} forces; give two points or more")
        for (v_1, F_1), (v_2, F_2) in pairwise(zip(v, F, strict=True)):
            if not v_1 < v_2:
                raise InputError(f"{self}: the rate {v_2:g} m/s follows {v_1:g} m/s; sort the points")
            if F_2 < F_1:
                raise InputError(
                    f"{self}: its force falls from {F_1:g} to {F_2:g} N between {v_1:g} and {v_2:g} m/s; one that falls is a"
                    " Force or Load f(t, q, v)"
                )
        at_rest = self._at_rest()
        if abs(at_rest) > 1e-12 * max(map(abs, F)):
            raise InputError(
                f"{self}: its force at rest is {at_rest:g} N; let the points pass through (0, 0), and add a Slider for dry "
                "friction or a Load for a constant force"
            )

    def _at_rest(self) -> float:
        """Return F(0) of a table."""
        points = list(zip(self.rates, self.forces, strict=True))
        pieces = list(pairwise(points))
        (v_1, F_1), (v_2, F_2) = next((each for each in pieces if each[1][0] > 0.0), pieces[-1])
        return F_1 - (F_2 - F_1) / (v_2 - v_1) * v_1

    @property
    def nodes(self) -> tuple[str, ...]:
        """The two ends."""
        return (self.a, self.b)

    def contribute(self, terms: Terms) -> None:
        """Add the law of the rate."""
        if mentions((self.c, self.n, self.c_extension)):
            raise NotTracedError(f"{self}: its force is no formula of the motion")
        if self.law == "table":
            points = [x for point in zip(self.rates, self.forces, strict=True) for x in point]
            numbers = (0.0, 0.0, -float(len(self.rates)), 0.0, 0.0, 0.0, 0.0, 0.0, *points)
        else:
            c = float(self.c)
            inwards = 0.0 if self.law == "extension" else c
            outwards = 0.0 if self.law == "compression" else float(self.c_extension or c)
            numbers = (0.0, 0.0, float(self.n), inwards, outwards, 0.0, 0.0, 0.0)
        terms.dashpots.append(RateLaw(str(self), self.a, self.b, numbers))
