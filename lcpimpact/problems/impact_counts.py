r"""Impacts that are counted: how many there are, in closed form."""

from __future__ import annotations

import math
from functools import partial
from typing import Annotated

import numpy as np

from lcpimpact.arrays import Array
from lcpimpact.errors import InputError
from lcpimpact.problems.balls import row_of_balls
from lcpimpact.problems.base import Problem, above_zero, restitution
from lcpimpact.problems.facts import Fact
from lcpimpact.problems.registered import registered
from lcpimpact.reading import Readable, event, final, instant
from lcpimpact.scheme.elements.base import GROUND
from lcpimpact.scheme.elements.bumper import Bumper
from lcpimpact.scheme.elements.mass import Mass
from lcpimpact.scheme.scheme import Scheme

WHOLE_RTOL = 1e-12
"""Distance from a whole number, relative to it, that is rounding."""


COUNTED = 10_000
"""Maximum number of impacts that are followed."""


@registered
def pi_billiard(
    m: Annotated[float, "kg, mass of the light ball"] = 1.0,
    M: Annotated[float, "kg, mass of the heavy ball"] = 100.0,
    v0: Annotated[float, "m/s, speed of the heavy ball"] = 1.0,
    D: Annotated[float, "m, gap between the balls"] = 1.0,
    d: Annotated[float, "m, gap between the light ball and the wall"] = 1.0,
) -> Problem:
    r"""A heavy ball drives a light one against a wall: with M/m = 100ᴺ they count the digits of π.

    All impacts are elastic. The light ball m rests at d before the wall, the heavy one M comes from D behind it at v0. In
    the plane of ``ξ = sqrt(M) X`` and ``η = sqrt(m) x``, the distances X and x from the wall weighted by masses, the point
    moves at one speed inside a wedge of the angle ``θ = atan sqrt(m/M)``, and at the sides it is reflected as light is.
    Unfolded it runs along the straight line ``η = sqrt(m) d``, through every angle from below θ up to π, and meets the n-th
    image of a side at the angle n θ:

    - the n-th impact is at ``t_n = (D + d - d sqrt(m/M) cot n θ)/v0``, odd n of the balls and even n at the wall,
    - n θ < π leaves ``N = ceil(π/θ) - 1`` impacts, and the heavy ball goes back at ``-v0 cos(π - 2 ⌈N/2⌉ θ)``.

    M = m gives 3 impacts, ``100 m`` gives 31, ``10⁴ m`` gives 314: while π/θ and π sqrt(M/m) have one integer part, N is
    ``floor(π/θ)``, and its digits are those of π. Where π/θ is a whole number the last image is parallel to the line and is
    never met, so it is not floor(π/θ) there but one less: M = m has π/θ = 4. The trap is a step longer than the shortest
    time between impacts, ``θ d sqrt(m/M)/v0``: energy comes out right, the count does not.

    Raises
    ------
    InputError
        If a parameter is not above zero, or the impacts are more than 10,000.

    Examples
    --------
    >>> [round(fact.value, 6) for fact in pi_billiard().facts]
    [31.0, 1.0, 1.505, 3.926375, -0.998858, -0.047786]

    References
    ----------
    Galperin, Playing pool with π (2003).
    """
    name = "pi-billiard"
    above_zero(name, m=m, M=M, v0=v0, D=D, d=d)
    root = math.sqrt(m / M)
    θ = math.atan(root)
    N = math.ceil(math.pi / θ * (1.0 - WHOLE_RTOL)) - 1
    if N > COUNTED:
        raise InputError(f"{name}: M/m = {M / m:g} makes {N} impacts, and at most {COUNTED:,} are followed; lower M")
    t_N = (D + d - d * root / math.tan(N * θ)) / v0
    t_end = max(1.1 * t_N, 2.0 * (D + d) / v0)

    def facts() -> tuple[Fact, ...]:
        def impact(n: int) -> float:
            """Return t_n."""
            return (D + d - d * root / math.tan(n * θ)) / v0

        _, v = motion(np.array([t_end]))
        return (
            Fact("N", "how many impacts", float(N), "", _count),
            Fact("t_1", "the first", impact(1), "s", partial(instant, kind="impact")),
            Fact("t_2", "the second, at the wall", impact(2), "s", partial(instant, kind="impact", contact="R2")),
            Fact("t_N", "the last", impact(N), "s", partial(instant, kind="impact", number=-1)),
            Fact("V/v0", "heavy ball at last", float(v[0, 0]) / v0, "", partial(final, series="v_x1", unit=v0), scale=1.0),
            Fact("v/V_m", "light ball at last, over v0 sqrt(M/m)", float(v[0, 1]) * root / v0, "",
                 partial(final, series="v_x2", unit=v0 / root), scale=1.0),
        )  # fmt: skip

    def motion(t: Array) -> tuple[Array, Array]:
        # All in units of sqrt(M): ξ = X, η = x sqrt(m/M).
        ξ, η = D + d - v0 * np.asarray(t, dtype=np.float64), d * root
        r, φ = np.hypot(ξ, η), np.arctan2(η, ξ)
        images = np.floor(φ / θ)
        folds = 2.0 * θ * np.ceil(0.5 * images)
        # An even image is the wedge turned, an odd one the wedge turned and reflected.
        sign = 1.0 - 2.0 * np.mod(images, 2.0)
        place, course = sign * (φ - folds), sign * (math.pi - folds)
        q = np.column_stack([D + d - r * np.cos(place), d - r * np.sin(place) / root])
        return q, np.column_stack([-v0 * np.cos(course), -v0 * np.sin(course) / root])

    return Problem(
        name,
        Scheme(
            Mass("x1", M, symbols=("M",)),
            Bumper("x1", "x2", gap=D, e=1.0, name="R1", symbols=("R_1",)),
            Mass("x2", m),
            Bumper("x2", GROUND, gap=d, e=1.0, name="R2", symbols=("R_2",)),
        ),
        v0={"x1": v0},
        t_end=t_end,
        source="Galperin2003",
        facts=facts,
        motion=motion,
    )


def _count(run: Readable) -> float:
    """Return the number of impacts."""
    return float(sum(each.kind == "impact" for each in run.events))


@registered
def inelastic_collapse(
    m: Annotated[float, "kg, mass of each ball"] = 1.0,
    v0: Annotated[float, "m/s, speed of the first ball"] = 1.0,
    e: Annotated[float, "1, coefficient of restitution"] = 0.05,
    d: Annotated[float, "m, gap before ball 2"] = 0.1,
    delta: Annotated[float, "m, gap δ before ball 3"] = 0.2,
) -> Problem:
    r"""Three equal balls in a row: infinitely many impacts in finite time if e <= 7 - 4 sqrt(3).

    Ball 1 comes at v0 through d to ball 2, which rests δ before ball 3; the middle ball then goes to and fro between the
    others. At its n-th impact, n = 0, 1, ..., let p_n be the speed of approach of the pair that meets. The pair parts with
    e p_n and adds ``h p_n`` to the approach of the other, ``h = (1 + e)/2``, so

    - ``p_(n+1) = h p_n - e p_(n-1)``, ``p_0 = v0``, ``p_(-1) = 0``: a linear map with ``λ² - h λ + e = 0``,
    - and the n-th impact is at ``t_n = (d + δ p_(n-1)/p_n)/v0``, since the times between them are
      ``eⁿ v0 δ/(p_n p_(n+1))``, a sum that telescopes.

    The roots are real for ``(1 + e)² >= 16 e``, that is ``e <= e* = 7 - 4 sqrt(3) = 0.0718``. Then p_n never ends, and with
    the larger root λ the impacts accumulate at ``t_∞ = (d + δ/λ)/v0``, after which the three move on as one at v0/3. For
    larger e the roots are ``sqrt(e) exp(± i ψ)``, p_n is in proportion to ``e^(n/2) sin (n + 1) ψ``, and the impacts end
    after ``N = ceil(π/ψ) - 1`` of them, ``cos ψ = (1 + e)/(4 sqrt(e))``; for e = 1 it is 2. The trap is a program that goes
    from impact to impact: in granular gases it stops for ever at t_∞, though no two balls come to rest on anything.

    Raises
    ------
    InputError
        If m, v0, d or delta is not above zero, or e lies outside [0, 1].

    Examples
    --------
    >>> [round(fact.value, 9) for fact in inelastic_collapse().facts]
    [0.1, 0.480952381, 0.565373961, 0.225625, 0.6, 0.333333333]
    >>> [round(fact.value, 9) for fact in inelastic_collapse(e=0.5).facts]
    [0.1, 0.366666667, 3.0, 2.5, 0.203125, 0.5625]

    References
    ----------
    McNamara and Young, Inelastic collapse and clumping in a one-dimensional granular medium (1992).
    """
    name = "inelastic-collapse"
    above_zero(name, v0=v0, d=d, delta=delta)
    restitution(name, e)
    if e == 0.0:
        raise InputError(f"{name}: e = 0 leaves the first two balls together, and no one goes to and fro; raise e")

    def larger_root() -> float | None:
        """Return λ, where the roots are real."""
        h = 0.5 * (1.0 + e)
        return 0.5 * (h + math.sqrt(h**2 - 4.0 * e)) if h**2 >= 4.0 * e else None

    def approaches() -> tuple[int, list[float]]:
        """Return the number N of the impacts, and p_n of the last one, of that before and of that which does not follow."""
        ψ = math.acos(0.5 * (0.5 * (1.0 + e)) / math.sqrt(e))
        N = math.ceil(math.pi / ψ * (1.0 - WHOLE_RTOL)) - 1
        return N, [e ** (0.5 * n) * math.sin((n + 1) * ψ) / math.sin(ψ) * v0 for n in (N - 2, N - 1, N)]

    def last_impact() -> float:
        """Return t_N, or t_∞ where the impacts do not end."""
        λ = larger_root()
        if λ is not None:
            return (d + delta / λ) / v0
        _, (before, at_last, _) = approaches()
        return (d + delta * before / at_last) / v0

    def t_end() -> float:
        return 1.25 * last_impact()

    def facts() -> tuple[Fact, ...]:
        h = 0.5 * (1.0 + e)
        last = last_impact()
        λ = larger_root()
        first = (
            Fact("t_1", "first impact", d / v0, "s", partial(instant, kind="impact")),
            Fact("t_2", "second impact", (d + delta / h) / v0, "s", partial(instant, kind="impact", number=2)),
        )
        if λ is not None:
            # Of the impacts as many can be computed as have speeds above rounding; the rest of the time is left out.
            ratio = e / λ**2
            seen = math.log(np.finfo(float).eps) / math.log(λ)
            unseen = (1.0 - ratio) * ratio**seen * delta / (λ * v0)
            return (
                *first,
                Fact("t_3", "third impact", (d + delta * h / (h**2 - e)) / v0, "s",
                     partial(instant, kind="impact", number=3)),
                Fact("p_2", "its speed of approach", (h**2 - e) * v0, "m/s", _third_approach, scale=v0),
                Fact("t_∞", "accumulation of the impacts", last, "s", _accumulation, accuracy=max(1e-9, unseen / last)),
                Fact("v/v0", "speed of all at last", 1.0 / 3.0, "", partial(final, series="v_x1", unit=v0)),
            )  # fmt: skip
        N, (_, at_last, after) = approaches()
        # The approaches of balls 1 and 2, and of 2 and 3, at last: minus the speeds at which they part.
        a, b = (-e * at_last, after) if N % 2 else (after, -e * at_last)
        return (
            *first,
            Fact("N", "how many impacts", float(N), "", _count),
            Fact("t_N", "the last", last, "s", partial(instant, kind="impact", number=-1)),
            Fact("v_1/v0", "ball 1 at last", (v0 + 2.0 * a + b) / (3.0 * v0), "",
                 partial(final, series="v_x1", unit=v0), scale=1.0),
            Fact("v_3/v0", "ball 3 at last", (v0 - a - 2.0 * b) / (3.0 * v0), "",
                 partial(final, series="v_x3", unit=v0), scale=1.0),
        )  # fmt: skip

    return Problem(
        name,
        row_of_balls(3, m, e, d, delta),
        v0={"x1": v0},
        t_end=t_end,
        source="McNamaraYoung1992",
        facts=facts,
    )


def _third_approach(run: Readable) -> float:
    """Return the speed of approach of balls 1 and 2 just before the third impact."""
    return float(-np.diff(event(run, "impact", 3).left.v)[0])


def _accumulation(run: Readable) -> float:
    """Return the time of the last impact, if a twentieth of the run has gone without one."""
    last = instant(run, "impact", number=-1)
    if run.t[-1] - last < 0.05 * run.t[-1]:
        raise InputError("the impacts have not come to an end when the run does: run longer")
    return last
