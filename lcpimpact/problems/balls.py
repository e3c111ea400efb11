r"""Colliding balls: simultaneous and sequential impacts, and the limits of a restitution law.

Coordinates are positive downwards (to the right, for balls in a row), and count from where each ball starts.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from scipy.optimize import brentq

from lcpimpact.errors import InputError
from lcpimpact.formula import sqrt
from lcpimpact.problems.base import Problem, above_zero, restitution, whole
from lcpimpact.problems.facts import Fact
from lcpimpact.reading import at, final, instant, limit
from lcpimpact.scheme.elements.base import GROUND, Element
from lcpimpact.scheme.elements.bumper import Bumper
from lcpimpact.scheme.elements.load import Load
from lcpimpact.scheme.elements.mass import Mass
from lcpimpact.scheme.elements.spring import Spring
from lcpimpact.scheme.scheme import Scheme
from lcpimpact.scheme.sparse import SparseScheme

MOREAU = "Moreau, Unilateral contact and dry friction in finite freedom dynamics (1988)"


def three_balls(m: float = 1.0, v0: float = 1.0, e: float = 1.0, d: float = 0.5, delta: float = 0.0) -> Problem:
    r"""One ball strikes two equal ones that touch: the problem that impact laws disagree about.

    Ball 1 runs through d at v0. Where balls 2 and 3 touch (δ = 0), Newton's law in Moreau's form asks for all impulses at
    once, ``0 <= P ⟂ U⁺ + e U⁻ >= 0``: the pair moves off as one body,

    - ``v = v0 ((1 - 2e)/3, (1 + e)/3, (1 + e)/3)``, for e = 1 ``(-1/3, 2/3, 2/3) v0``.

    The least gap δ > 0 makes it two impacts in a row, and after them

    - ``v = v0 ((1 - e)/2, (1 - e²)/4, (1 + e)²/4)``, for e = 1 ``(0, 0, 1) v0``: Newton's cradle.

    (with e = 0 the first two stay together, and all three go on with v0/3). Both keep momentum, and for e = 1 both keep
    energy. So the outcome depends on δ without a limit as δ → 0, and real balls (elastic, so neither) lie between. The trap:
    a solver that perturbs the gaps, or rounding that opens them by 1e-16, may silently turn one answer into the other.

    Parameters
    ----------
    m : float
        Mass of each ball in kg.
    v0 : float
        Speed of the first ball in m/s.
    e : float
        Coefficient of restitution.
    d : float
        Gap in m before the first ball.
    delta : float
        Gap δ in m between the other two.

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
    return Problem(
        name,
        row_of_balls(3, m, e, d, delta),
        v0={"x1": v0},
        t_end=2.0 * second,
        parameters={"m": m, "v0": v0, "e": e, "d": d, "delta": delta},
        source=MOREAU,
        facts=partial(_three_balls_facts, v0, e, d / v0, second, delta),
    )


def _three_balls_facts(v0: float, e: float, hit: float, second: float, delta: float) -> tuple[Fact, ...]:
    touch = Fact("t_1", "first impact", hit, "s", partial(instant, kind="impact"))
    if delta == 0.0:
        v = ((1.0 - 2.0 * e) / 3.0, (1.0 + e) / 3.0, (1.0 + e) / 3.0)
        return (touch, *_velocities(v, v0, 1))
    v = ((1.0 - e) / 2.0, (1.0 - e**2) / 4.0, (1.0 + e) ** 2 / 4.0) if e > 0.0 else (1.0 / 3.0,) * 3
    next_touch = Fact("t_2", "second impact", second, "s", partial(instant, kind="impact", contact="R2"))
    return (touch, next_touch, *_velocities(v, v0, "R2"))


def newtons_cradle(
    N: float = 5, m: float = 1.0, v0: float = 1.0, e: float = 1.0, d: float = 0.1, delta: float = 0.01
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

    Parameters
    ----------
    N : int
        Number of balls, at least 2.
    m : float
        Mass of each ball in kg.
    v0 : float
        Speed of the first ball in m/s.
    e : float
        Coefficient of restitution.
    d : float
        Gap in m before the first ball.
    delta : float
        Gap δ in m between the others.

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
    return Problem(
        name,
        row_of_balls(N, m, e, d, delta),
        v0={"x1": v0},
        t_end=partial(_newtons_cradle_end, N, v0, e, d, delta),
        parameters={"N": N, "m": m, "v0": v0, "e": e, "d": d, "delta": delta},
        source="Herrmann and Schmälzle, Simple explanation of a well-known collision experiment (1981)",
        facts=partial(_newtons_cradle_facts, N, v0, e, d, delta),
    )


def _passed_on(N: int, e: float) -> list[float]:
    """Return the speeds of the balls over v0 when they are struck; what does not rebound shares its momentum."""
    fraction = (1.0 + e) / 2.0
    return [fraction**j if e > 0.0 else 1.0 / (j + 1.0) for j in range(N)]


def _last_struck(N: int, v0: float, e: float, d: float, delta: float) -> float:
    """Return t_N."""
    return d / v0 + sum(delta / (v0 * fraction) for fraction in _passed_on(N, e)[1 : N - 1])


def _newtons_cradle_end(N: int, v0: float, e: float, d: float, delta: float) -> float:
    return 2.0 * _last_struck(N, v0, e, d, delta)


def _newtons_cradle_facts(N: int, v0: float, e: float, d: float, delta: float) -> tuple[Fact, ...]:
    t_N, last = _last_struck(N, v0, e, d, delta), N - 1
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


def _total_velocity(run: Any, unit: float) -> float:
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


def two_ball_drop(
    m1: float = 3.0, m2: float = 1.0, g: float = 9.81, H: float = 1.0, e: float = 1.0, delta: float = 0.01
) -> Problem:
    r"""Two balls dropped one above the other: the light one flies off higher than it came from.

    Ball 1 is the lower. It hits the ground at ``t_1 = sqrt(2 H/g)`` with ``v = sqrt(2 g H)``, turns round, and meets
    ball 2, which still falls δ above it; both fall alike meanwhile, so that takes ``τ = δ/((1 + e) v)``. The two velocities
    just before are ``g τ - e v`` and ``g τ + v``, and momentum with Newton's law gives

    - ``v_1 = g τ + v (m2 (1 + e)² - e (m1 + m2))/(m1 + m2)`` and ``v_2 = g τ + v (m2 - m1 (2 e + e²))/(m1 + m2)``.

    With m1 = 3 m2 and e = 1 the lower ball stops dead and the upper leaves with 2v: it rises to four times the height. The
    trap is δ = 0: then both impacts are simultaneous, the law knows only the relative velocities U⁻ = (-v, 0), and both
    balls leave with e v, no higher than they came from.

    Parameters
    ----------
    m1, m2 : float
        Masses of the lower and the upper ball in kg.
    g : float
        Gravity in m/s².
    H : float
        Height of fall of the lower ball in m.
    e : float
        Coefficient of restitution of both contacts.
    delta : float
        Gap δ in m between the balls.

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
    return Problem(
        name,
        scheme,
        t_end=2.0 * t_1,
        parameters={"m1": m1, "m2": m2, "g": g, "H": H, "e": e, "delta": delta},
        source="Mellen, Superball rebound projectiles (1968)",
        facts=partial(_two_ball_drop_facts, m1, m2, g, e, delta, t_1, v, τ),
    )


def _two_ball_drop_facts(
    m1: float, m2: float, g: float, e: float, delta: float, t_1: float, v: float, τ: float
) -> tuple[Fact, ...]:
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


def two_balls_spring(
    m: float = 1.0, k: float = 1e4, e: float = 0.8, g: float = 9.81, x1: float = 1.0, R: float = 0.2
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

    Parameters
    ----------
    m, k : float
        Mass of each ball in kg and stiffness in N/m.
    e : float
        Coefficient of restitution.
    g : float
        Gravity in m/s².
    x1, R : float
        Height of the lower ball's centre and its radius in m.

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
    parameters = {"m": m, "k": k, "e": e, "g": g, "x1": x1, "R": R}
    return Problem(
        name,
        scheme,
        t_end=partial(_two_balls_spring_end, **parameters),
        parameters=parameters,
        source="Chen, Acary, Virlez and Brüls, A nonsmooth generalized-α scheme (2013), the linear vertical oscillator",
        facts=partial(_two_balls_spring_facts, **parameters),
    )


def _two_impacts(m: float, k: float, e: float, g: float, x1: float, R: float) -> tuple[float, float, float]:
    """Return t_1, the time from then to the second impact, and its approach speed."""
    ω = math.sqrt(2.0 * k / m)
    t_1 = math.sqrt(2.0 * (x1 - R) / g)
    v = g * t_1
    s_2 = _return(lambda s: 0.5 * ((1.0 - e) * v * s + g * s**2 - (1.0 + e) * v / ω * np.sin(ω * s)), ω)
    return t_1, s_2, 0.5 * (1.0 - e) * v + g * s_2 - 0.5 * (1.0 + e) * v * math.cos(ω * s_2)


def _two_balls_spring_end(**parameters: float) -> float:
    t_1, s_2, _ = _two_impacts(**parameters)
    return max(1.0, 1.2 * (t_1 + s_2))


def _two_balls_spring_facts(**parameters: float) -> tuple[Fact, ...]:
    t_1, s_2, v_2 = _two_impacts(**parameters)
    facts: tuple[Fact, ...] = (
        Fact("t_1", "first impact", t_1, "s", partial(instant, kind="impact")),
        Fact("t_2", "second impact", t_1 + s_2, "s", partial(instant, kind="impact", number=2)),
        Fact(
            "v_2",
            "its approach speed",
            v_2,
            "m/s",
            partial(limit, kind="impact", number=2, of="v", i=1, side="left"),
            scale=parameters["g"] * t_1,
        ),
    )
    if list(parameters.values()) == [1.0, 1e4, 0.8, 9.81, 1.0, 0.2]:
        # Published as heights of the centres, which start at 1 and 2 m, and their rates.
        facts += (
            Fact("q_1(1)", "fall of the lower ball", 1.0 - 0.24684188672883527, "m", partial(at, series="x1", t=1.0)),
            Fact("q_2(1)", "fall of the upper ball", 2.0 - 1.2282103120085011, "m", partial(at, series="x2", t=1.0)),
            Fact("v_1(1)", "its rate, lower ball", 2.3798395214664336, "m/s", partial(at, series="v_x1", t=1.0)),
            Fact("v_2(1)", "its rate, upper ball", 3.1140923936237557, "m/s", partial(at, series="v_x2", t=1.0)),
        )
    return facts


def _return(height: Callable[[Any], Any], ω: float) -> float:
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
