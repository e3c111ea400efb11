"""A ball that bounces in air: quadratic drag, with a closed form from impact to impact."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from itertools import islice
from typing import Annotated, ClassVar, TypeVar

import numpy as np

from lcpimpact.arrays import Array
from lcpimpact.formula import sqrt
from lcpimpact.problems.base import Problem, above_zero, restitution
from lcpimpact.problems.facts import Fact
from lcpimpact.problems.registered import registered
from lcpimpact.reading import instant, limit
from lcpimpact.scheme.elements.base import GROUND
from lcpimpact.scheme.elements.bumper import Bumper
from lcpimpact.scheme.elements.load import Load
from lcpimpact.scheme.elements.mass import Mass
from lcpimpact.scheme.scheme import Scheme

V = TypeVar("V", float, complex)

LAST = 3
"""Number of the last impact in the suggested run."""


@dataclass(frozen=True)
class QuadraticDrag:
    """The force -c v |v| of a fluid at high Reynolds number.

    Attributes
    ----------
    c : float       half of the density times the drag coefficient and the cross-section, in kg/m
    """

    c: float

    formula: ClassVar[str] = "-c v |v|"
    """The force in a line, which files say."""

    def __call__(self, t: float, q: V, v: V) -> V:
        """Return the force in N, for complex v too."""
        force: V = -self.c * v * np.sqrt(v * v)
        return force


@registered
def ball_in_air(
    m: Annotated[float, "kg, mass"] = 1.0,
    g: Annotated[float, "m/s², gravity"] = 9.81,
    c: Annotated[float, "kg/m, drag"] = 0.3,
    H: Annotated[float, "m, height of fall"] = 2.0,
    e: Annotated[float, "1, coefficient of restitution"] = 0.7,
) -> Problem:
    r"""A ball dropped from rest at height H against the drag c v²: relative degree 2, with impacts U⁺ = -e U⁻.

    The coordinate x is positive downwards from the start, so the height is H - x. With ``v_t = sqrt(m g/c)``, the terminal
    speed,

    - it falls by ``v = v_t tanh(g t/v_t)``, and a height h in the time ``v_t/g acosh exp(g h/v_t²)``,
    - the approach speed of the n-th impact is ``v_n = v_t sqrt(1 - exp(-2 g h_n/v_t²))``, with h_1 = H,
    - it then rises in ``v_t/g atan(e v_n/v_t)`` seconds to ``h_(n+1) = v_t²/(2 g) ln(1 + (e v_n/v_t)²)``.

    It is the test of forces f(t, q, v), which only some methods handle. The trap is the sign: with -c v² for -c v |v| the
    air pushes a ball that rises. And abs(v) has no complex step, so the force is -c v sqrt(v²).

    Raises
    ------
    InputError
        If m, g, c or H is not above zero, or e lies outside [0, 1].

    Examples
    --------
    >>> [round(fact.value, 6) for fact in ball_in_air().facts]
    [0.703904, 4.780267, 1.336657, 2.888064, 1.736754]

    References
    ----------
    Timmerman and van der Weele, On the rise and fall of a ball with linear or quadratic drag (1999).
    """
    name = "ball-in-air"
    above_zero(name, m=m, g=g, c=c, H=H)
    restitution(name, e)
    weight = Load("x", m * g, symbols=("mg",))
    drag = Load("x", QuadraticDrag(c), symbols=("c v^2",))
    v_t = sqrt(m * g / c)

    def t_end() -> float:
        return 1.1 * list(islice(impacts(g, v_t, H, e), LAST))[-1][0]

    def facts() -> tuple[Fact, ...]:
        facts = []
        named = [("first", 1), ("second", 2), ("third", 3)]
        for (which, number), (t, v) in zip(named, impacts(g, v_t, H, e), strict=False):
            facts.append(Fact(f"t_{number}", f"{which} impact", t, "s", partial(instant, kind="impact", number=number)))
            if number < LAST:
                speed = partial(limit, kind="impact", number=number, of="v", i=0, side="left")
                facts.append(Fact(f"v_{number}", "its approach speed", v, "m/s", speed))
        return tuple(facts)

    def motion(t: Array) -> tuple[Array, Array]:
        """Return x and v (nt, 1) at the times t, right limits."""
        s, top = g * t / v_t, v_t**2 / g
        x = top * np.log(np.cosh(np.minimum(s, 300.0)))
        v = v_t * np.tanh(s)
        for t_n, v_n in impacts(g, v_t, H, e):
            after, φ = t >= t_n, math.atan(e * v_n / v_t)
            if not after.any():
                break
            s = g * (t[after] - t_n) / v_t - φ
            rises = s < 0.0
            up = np.minimum(s, 0.0)
            down = np.minimum(np.maximum(s, 0.0), 300.0)
            x[after] = (
                H + top * math.log(math.cos(φ)) + top * np.where(rises, -np.log(np.cos(up)), np.log(np.cosh(down)))
            )
            v[after] = v_t * np.where(rises, np.tan(up), np.tanh(down))
            if φ == 0.0:
                x[after], v[after] = H, 0.0
        return x[:, None], v[:, None]

    return Problem(
        name,
        Scheme(Mass("x", m), weight, drag, Bumper("x", GROUND, gap=H, e=e)),
        t_end=t_end,
        source="TimmermanVanDerWeele1999",
        facts=facts,
        motion=motion,
    )


def impacts(g: float, v_t: float, H: float, e: float) -> Iterator[tuple[float, float]]:
    """Yield the instants and approach speeds of the impacts, as long as they can be told apart."""
    t = 0.0
    h = H
    last = -1.0
    while h > 0.0 and t > last:
        last = t
        a = g * h / v_t**2
        v = v_t * math.sqrt(-math.expm1(-2.0 * a))
        t += v_t / g * (a + math.log1p(v / v_t))  # acosh(exp a), which overflows at large a
        yield t, v
        t += v_t / g * math.atan(e * v / v_t)
        h = v_t**2 / (2.0 * g) * math.log1p((e * v / v_t) ** 2)
