r"""Colliding balls: simultaneous and sequential impacts, and the limits of a restitution law.

Coordinates are positive downwards (to the right, for balls in a row), and count from where each ball starts.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Annotated

import numpy as np
from scipy.optimize import brentq

from lcpimpact.errors import InputError
from lcpimpact.formula import sqrt
from lcpimpact.problems.base import Problem, above_zero, defaults, restitution, whole
from lcpimpact.problems.facts import Fact
from lcpimpact.problems.registered import registered
from lcpimpact.reading import Readable, at, final, instant, limit
from lcpimpact.scheme.elements.base import GROUND, Element
from lcpimpact.scheme.elements.bumper import Bumper
from lcpimpact.scheme.elements.load import Load
from lcpimpact.scheme.elements.mass import Mass
from lcpimpact.scheme.elements.spring import Spring
from lcpimpact.scheme.scheme import Scheme
from lcpimpact.scheme.sparse import SparseScheme


@registered
def three_balls(
    m: Annotated[float, "kg, mass of each ball"] = 1.0,
    v0: Annotated[float, "m/s, speed of the first ball"] = 1.0,
    e: Annotated[float, "1, coefficient of restitution"] = 1.0,
    d: Annotated[float, "m, gap before the first ball"] = 0.5,
    delta: Annotated[float, "m, gap δ between the other two"] = 0.0,
) -> Problem:
    r"""One ball strikes two equal ones that touch: the problem that impact laws disagree about.

    Ball 1 runs through d at v0. Where balls 2 and 3 touch (δ = 0), Newton's law in Moreau's form asks for all impulses at
    once, ``0 <= P ⟂ U⁺ + e U⁻ >= 0``: the pair moves off as one body,

    - ``v = v0 ((1 - 2e)/3, (1 + e)/3, (1 + e)/3)``, for e = 1 ``(-1/3, 2/3, 2/3) v0``.

    The least gap δ > 0 makes it two impacts in a row, and after them

    - ``v = v0 ((1 - e)/2, (1 - e²)/4, (1 + e)²/4)``, for e = 1 ``(0, 0, 1) v0``: Newton's cradle.

    (with e = 0 the first two stay together, and all three go on with v0/3). Both keep momentum, and for e = 1 both keep
    energy. So the outcome depends on δ without a limit as δ → 0, and real balls (elastic, so neither) lie between. The trap:
    a solver that perturbs the gaps, or rounding that opens them by 1e-16, may silently turn one answer into the other.

    Raises
    ------
    InputError
        If m, v0 or d is not above zero, delta is negative, or e lies outside [0, 1].

    Examples
    --------
    >>> [round(fact.value, 6) for fact in three_balls().facts]
    [0.5, -0.333333, 0.666667, 0.666667]
    >>> [round(fact.value, 6) for fact in three_balls(delta=0.1).facts]
    [0.5, 0.6, 0.0, 0.0, 1.0]

    References
    ----------
    Moreau, Unilateral contact and dry friction in finite freedom dynamics (1988); Acary and Brogliato (2008), section 1.6.
    """
    name = "three-balls"
    _check_row(name, v0, e, d, delta)
    second = d / v0 + 2.0 * delta / ((1.0 + e) * v0)

    def facts() -> tuple[Fact, ...]:
        hit = d / v0
        touch = Fact("t_1", "first impact", hit, "s", partial(instant, kind="impact"))
        if delta == 0.0:
            v = ((1.0 - 2.0 * e) / 3.0, (1.0 + e) / 3.0, (1.0 + e) / 3.0)
            return (touch, *_velocities(v, v0, 1))
        v = ((1.0 - e) / 2.0, (1.0 - e**2) / 4.0, (1.0 + e) ** 2 / 4.0) if e > 0.0 else (1.0 / 3.0,) * 3
        next_touch = Fact("t_2", "second impact", second, "s", partial(instant, kind="impact", contact="R2"))
        return (touch, next_touch, *_velocities(v, v0, "R2"))

    return Problem(
        name, row_of_balls(3, m, e, d, delta), v0={"x1": v0}, t_end=2.0 * second, source="Moreau1988", facts=facts
    )


@registered
def newtons_cradle(
    N: Annotated[float, "1, number of balls, at least 2"] = 5,
    m: Annotated[float, "kg, mass of each ball"] = 1.0,
    v0: Annotated[float, "m/s, speed of the first ball"] = 1.0,
    e: Annotated[float, "1, coefficient of restitution"] = 1.0,
    d: Annotated[float, "m, gap before the first ball"] = 0.1,
    delta: Annotated[float, "m, gap δ between the others"] = 0.01,
) -> Problem:
    r"""A row of N equal balls, struck at one end: the toy on the desk, as a chain of impacts.

    With a gap δ > 0 between neighbours each impact is alone and transmits ``(1 + e)/2`` of the speed, so

    - the last ball leaves with ``v_N = v0 ((1 + e)/2)^(N-1)`` at ``t_N = d/v0 + Σ_j δ/(v0 ((1 + e)/2)^j)``, 0 < j < N-1.

    For e = 1 that is the toy: one in, one out (and for e = 0 they stay together, ``v_N = v0/N``). With δ = 0 all balls
    touch, Moreau's law moves N - 1 of them as one body,

    - ``v_1 = v0 ((1 + e)/N - e)`` and ``v_i = v0 (1 + e)/N`` for the others,

    and the toy does not work. The trap is to take either as confirmed by the conservation laws: momentum is kept in both,
    ``Σ v_i = v0``, and for e = 1 energy too. What settles it is the stiffness of the contacts. A chain of linear springs
    without tension gives something between the two, and Hertz contacts come close to the toy without reaching it.

    Raises
    ------
    InputError
        If N is no whole number above 1, m, v0 or d is not above zero, delta is negative, or e lies outside [0, 1].

    Examples
    --------
    >>> [round(fact.value, 6) for fact in newtons_cradle().facts]
    [1.0, 0.13, 1.0, 0.0]
    >>> [round(fact.value, 6) for fact in newtons_cradle(delta=0.0).facts]
    [1.0, 0.1, 0.4, -0.6]

    References
    ----------
    Herrmann and Schmälzle, Simple explanation of a well-known collision experiment (1981).
    """
    name = "newtons-cradle"
    N = whole(name, "N", N, least=2)
    _check_row(name, v0, e, d, delta)

    def last_struck() -> float:
        """Return t_N."""
        return d / v0 + sum(delta / (v0 * fraction) for fraction in _passed_on(N, e)[1 : N - 1])

    def t_end() -> float:
        return 2.0 * last_struck()

    def facts() -> tuple[Fact, ...]:
        t_N, last = last_struck(), N - 1
        momentum = Fact("Σv/v0", "momentum", 1.0, "", partial(_total_velocity, unit=v0))
        arrival = Fact("t_N", "last ball struck", t_N, "s", partial(instant, kind="impact", contact=f"R{last}"))
        if delta > 0.0:
            v_N, v_1 = _passed_on(N, e)[last], (1.0 - e) / 2.0
        else:
            v_N, v_1 = (1.0 + e) / N, (1.0 + e) / N - e
        return (
            momentum,
            arrival,
            Fact("v_N/v0", "speed of the last ball", v_N, "", partial(final, series=f"v_x{N}", unit=v0)),
            Fact(
                "v_1/v0", "speed of the first after its impact", v_1, "",
                partial(limit, kind="impact", contact="R1", of="v", i=0, side="right", unit=v0), scale=1.0,
            ),
        )  # fmt: skip

    return Problem(
        name,
        row_of_balls(N, m, e, d, delta),
        v0={"x1": v0},
        t_end=t_end,
        parameters={"N": N},
        source="HerrmannSchmaelzle1981",
        facts=facts,
    )


def _passed_on(N: int, e: float) -> list[float]:
    """Return the speeds of the balls over v0 when they are struck; what does not rebound shares its momentum."""
    fraction = (1.0 + e) / 2.0
    return [fraction**j if e > 0.0 else 1.0 / (j + 1.0) for j in range(N)]


def _total_velocity(run: Readable, unit: float) -> float:
    """Return the sum of all velocities at the end, in a unit."""
    return float(run.v[-1].sum()) / unit


def _check_row(name: str, v0: float, e: float, d: float, delta: float) -> None:
    above_zero(name, v0=v0, d=d)
    restitution(name, e)
    if delta < 0.0:
        raise InputError(f"{name}: delta = {delta:g} must not be negative; 0 lets the balls touch")


def row_of_balls(N: int, m: float, e: float, d: float, delta: float) -> Scheme:
    """Return N balls x1 ... xN with a bumper R1 ... between neighbours, the first open by d and the others by δ."""
    balls = [Mass(f"x{i}", m) for i in range(1, N + 1)]
    gaps = [d] + [delta] * (N - 2)
    bumpers = [
        Bumper(f"x{i}", f"x{i + 1}", gap=gap, e=e, name=f"R{i}", symbols=(f"R_{i}",))
        for i, gap in enumerate(gaps, start=1)
    ]
    return Scheme(*balls, *bumpers)


def _velocities(v: tuple[float, ...], v0: float, after: int | str) -> list[Fact]:
    """Return the facts of the velocities after an impact, the n-th or the first of a contact."""
    number, contact = (after, None) if isinstance(after, int) else (1, after)

    def fact(i: int) -> Fact:
        return Fact(
            f"v_{i + 1}/v0",
            f"velocity of ball {i + 1} after it",
            v[i],
            "",
            partial(limit, kind="impact", number=number, contact=contact, of="v", i=i, side="right", unit=v0),
            scale=1.0,
        )

    return [fact(i) for i in range(len(v))]


@registered
def two_ball_drop(
    m1: Annotated[float, "kg, mass of the lower ball"] = 3.0,
    m2: Annotated[float, "kg, mass of the upper ball"] = 1.0,
    g: Annotated[float, "m/s², gravity"] = 9.81,
    H: Annotated[float, "m, height of fall of the lower ball"] = 1.0,
    e: Annotated[float, "1, coefficient of restitution of both contacts"] = 1.0,
    delta: Annotated[float, "m, gap δ between the balls"] = 0.01,
) -> Problem:
    r"""Two balls dropped one above the other: the light one flies off higher than it came from.

    Ball 1 is the lower. It hits the ground at ``t_1 = sqrt(2 H/g)`` with ``v = sqrt(2 g H)``, turns round, and meets
    ball 2, which still falls δ above it; both fall alike meanwhile, so that takes ``τ = δ/((1 + e) v)``. The two velocities
    just before are ``g τ - e v`` and ``g τ + v``, and momentum with Newton's law gives

    - ``v_1 = g τ + v (m2 (1 + e)² - e (m1 + m2))/(m1 + m2)`` and ``v_2 = g τ + v (m2 - m1 (2 e + e²))/(m1 + m2)``.

    With m1 = 3 m2 and e = 1 the lower ball stops dead and the upper leaves with 2v: it rises to four times the height. The
    trap is δ = 0: then both impacts are simultaneous, the law knows only the relative velocities U⁻ = (-v, 0), and both
    balls leave with e v, no higher than they came from.

    Raises
    ------
    InputError
        If m1, m2, g or H is not above zero, delta is negative or so large that the lower ball lands twice before the
        balls meet, or e lies outside [0, 1].

    Examples
    --------
    >>> [round(fact.value, 6) for fact in two_ball_drop().facts]
    [0.451524, 4.429447, 0.452652, 0.011074, -8.84782]

    References
    ----------
    Mellen, Superball rebound projectiles (1968).
    """
    name = "two-ball-drop"
    above_zero(name, g=g, H=H)
    restitution(name, e)
    if delta < 0.0:
        raise InputError(f"{name}: delta = {delta:g} must not be negative; 0 lets the balls touch")
    scheme = Scheme(
        Mass("x2", m2, symbols=("m_2",)),
        Load("x2", m2 * g, symbols=("m_2 g",)),
        Bumper("x2", "x1", gap=delta, e=e, name="R2", symbols=("R_2",)),
        Mass("x1", m1, symbols=("m_1",)),
        Load("x1", m1 * g, symbols=("m_1 g",)),
        Bumper("x1", GROUND, gap=H, e=e, name="R1", symbols=("R_1",)),
    )
    t_1, v = sqrt(2.0 * H / g), sqrt(2.0 * g * H)
    τ = delta / ((1.0 + e) * v)
    if delta > 0.0 and not τ < 2.0 * e * v / g:
        raise InputError(
            f"{name}: with delta = {delta:g} and e = {e:g} the lower ball lands again before the upper meets it; "
            "take a smaller delta or a larger e"
        )

    def facts() -> tuple[Fact, ...]:
        if delta > 0.0:
            v_1 = g * τ + v * (m2 * (1.0 + e) ** 2 / (m1 + m2) - e)
            v_2 = g * τ + v * (m2 - m1 * (2.0 * e + e**2)) / (m1 + m2)
        else:
            v_1 = v_2 = -e * v
        meeting = "R2" if delta > 0.0 else "R1"
        return (
            Fact("t_1", "impact on the ground", t_1, "s", partial(instant, kind="impact", contact="R1")),
            Fact("v", "its speed", v, "m/s", partial(limit, kind="impact", contact="R1", of="v", i=1, side="left")),
            Fact("t_2", "impact of the balls", t_1 + τ, "s", partial(instant, kind="impact", contact=meeting)),
            Fact(
                "v_1",
                "lower ball after it",
                v_1,
                "m/s",
                partial(limit, kind="impact", contact=meeting, of="v", i=1, side="right"),
                scale=v,
            ),
            Fact(
                "v_2",
                "upper ball after it",
                v_2,
                "m/s",
                partial(limit, kind="impact", contact=meeting, of="v", i=0, side="right"),
                scale=v,
            ),
        )

    return Problem(name, scheme, t_end=2.0 * t_1, source="Mellen1968", facts=facts)


@registered
def two_balls_spring(
    m: Annotated[float, "kg, mass of each ball"] = 1.0,
    k: Annotated[float, "N/m, stiffness"] = 1e4,
    e: Annotated[float, "1, coefficient of restitution"] = 0.8,
    g: Annotated[float, "m/s², gravity"] = 9.81,
    x1: Annotated[float, "m, height of the lower ball's centre"] = 1.0,
    R: Annotated[float, "m, radius of the lower ball"] = 0.2,
) -> Problem:
    r"""Two balls joined by a spring fall on the ground: an impact inside a vibrating system.

    The lower ball starts with its centre x1 above the ground and has the radius R, the upper stands a spring's natural
    length above it, which itself does not matter: the nodes count the way down. Both fall alike until
    ``t_1 = sqrt(2 (x1 - R)/g)``. The impact reverses the lower ball only, and from then on the centre of mass flies on a
    parabola while the balls vibrate with ``ω = sqrt(2 k/m)``:

    - ``q_1 = x1 - R + b - a`` and ``q_2 = x1 - R + b + a`` with ``b = (1 - e) v s/2 + g s²/2`` and
      ``a = (1 + e) v/(2 ω) sin ω s``, where v = g t_1 and s = t - t_1,

    up to the next impact, the first root of b = a. The spring brings the ball back to the ground within 20 ms, though it
    left with 0.8 of its speed: restitution is a matter of the system and not of the contact alone. The trap is a step
    longer than π/ω: the second impact is then missed or doubled, and q is wrong from there on.

    Raises
    ------
    InputError
        If a parameter is not above zero, e lies outside [0, 1], or the ball starts in the ground.

    Examples
    --------
    >>> [round(fact.value, 9) for fact in two_balls_spring().facts]
    [0.403855022, 0.423316969, 3.885997838, 0.753158113, 0.771789688, 2.379839521, 3.114092394]

    References
    ----------
    Chen, Acary, Virlez and Brüls, A nonsmooth generalized-α scheme for flexible multibody systems with unilateral
    constraints (2013), the linear vertical oscillator.
    """
    name = "two-balls-spring"
    above_zero(name, g=g, R=R)
    restitution(name, e)
    H = x1 - R
    if not H > 0.0:
        raise InputError(f"{name}: x1 = {x1:g} must be above R = {R:g}, or the lower ball starts in the ground")
    scheme = Scheme(
        Mass("x2", m), Load("x2", m * g, symbols=("mg",)), Spring("x2", "x1", k),
        Mass("x1", m), Load("x1", m * g, symbols=("mg",)), Bumper("x1", GROUND, gap=H, e=e),
    )  # fmt: skip

    def two_impacts() -> tuple[float, float, float]:
        """Return t_1, the time from then to the second impact, and its approach speed."""
        ω = math.sqrt(2.0 * k / m)
        t_1 = math.sqrt(2.0 * H / g)
        v = g * t_1
        s_2 = _return(lambda s: 0.5 * ((1.0 - e) * v * s + g * s**2 - (1.0 + e) * v / ω * np.sin(ω * s)), ω)
        return t_1, s_2, 0.5 * (1.0 - e) * v + g * s_2 - 0.5 * (1.0 + e) * v * math.cos(ω * s_2)

    def t_end() -> float:
        t_1, s_2, _ = two_impacts()
        return max(1.0, 1.2 * (t_1 + s_2))

    def facts() -> tuple[Fact, ...]:
        t_1, s_2, v_2 = two_impacts()
        known: tuple[Fact, ...] = (
            Fact("t_1", "first impact", t_1, "s", partial(instant, kind="impact")),
            Fact("t_2", "second impact", t_1 + s_2, "s", partial(instant, kind="impact", number=2)),
            Fact(
                "v_2",
                "its approach speed",
                v_2,
                "m/s",
                partial(limit, kind="impact", number=2, of="v", i=1, side="left"),
                scale=g * t_1,
            ),
        )
        if problem.parameters == defaults(two_balls_spring):
            # Published as heights of the centres, which start at 1 and 2 m, and their rates.
            known += (
                Fact(
                    "q_1(1)", "fall of the lower ball", 1.0 - 0.24684188672883527, "m", partial(at, series="x1", t=1.0)
                ),
                Fact(
                    "q_2(1)", "fall of the upper ball", 2.0 - 1.2282103120085011, "m", partial(at, series="x2", t=1.0)
                ),
                Fact("v_1(1)", "its rate, lower ball", 2.3798395214664336, "m/s", partial(at, series="v_x1", t=1.0)),
                Fact("v_2(1)", "its rate, upper ball", 3.1140923936237557, "m/s", partial(at, series="v_x2", t=1.0)),
            )
        return known

    problem = Problem(
        name,
        scheme,
        t_end=t_end,
        source="ChenAcaryVirlezBruels2013, the linear vertical oscillator",
        facts=facts,
    )
    return problem


def _return(height: Callable[[float], float], ω: float) -> float:
    """Return the first root after zero of a function that falls from zero and turns with the frequency ω."""
    step = math.pi / (64.0 * ω)
    s = step
    while height(s) < 0.0:
        s += step
    return float(brentq(height, s - step, s, xtol=1e-16, rtol=4.0 * np.finfo(float).eps))


def pile(rows: int, gap: float = 0.0, m: float = 1.0, g: float = 9.81) -> Problem:
    """A pile of equal discs in a triangle, each on two below at 60°; the floor holds the last row, and e = 0.

    At rest each disc adds half its weight to both lines of contacts below it, so that a contact with k discs on its line
    from it upwards carries k m g/(2 sin 60°). It is no problem of the registry, since only sparse steps take its size.

    Parameters
    ----------
    rows : int
        Number of rows, and of discs in the last row.
    gap : float
        Opening of each contact at the start in m.
    m, g : float
        Mass of a disc in kg, and gravity in m/s².

    Raises
    ------
    InputError
        If rows is no whole number above zero, or m or g is not above zero.

    Examples
    --------
    >>> pile(2).scheme.assemble().reactions
    ('L0.0', 'R0.0', 'L0.1', 'R0.1', 'L1.0', 'R1.0')
    """
    name = "pile"
    rows = whole(name, "rows", rows)
    above_zero(name, m=m, g=g)
    elements: list[Element] = []
    for r in range(rows):
        for i in range(rows - r):
            x, y = f"x{r}.{i}", f"y{r}.{i}"
            elements += [Mass(x, m), Mass(y, m), Load(y, m * g)]
            for side, to_right, j in (("L", -0.5, i), ("R", 0.5, i + 1)):
                below = {f"x{r - 1}.{j}": to_right, f"y{r - 1}.{j}": math.sqrt(0.75)} if r else GROUND
                elements.append(Bumper({x: to_right, y: math.sqrt(0.75)}, below, gap, 0.0, f"{side}{r}.{i}"))
    return Problem(name, SparseScheme(*elements), parameters={"rows": rows, "gap": gap, "m": m, "g": g})
