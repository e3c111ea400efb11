r"""Balls that spin: from sliding to rolling, and bounces on rough surfaces.

x runs along the floor, y downwards, and φ turns the ball so that the rim at the floor moves with ``x' + R φ'``. A solid
sphere has the moment of inertia ``J = k m R²`` with k = 2/5, a hollow one k = 2/3, a disc k = 1/2.
"""

from __future__ import annotations

import math
from functools import partial
from typing import Annotated

import numpy as np

from lcpimpact.arrays import Array
from lcpimpact.errors import InputError
from lcpimpact.formula import sqrt
from lcpimpact.numbers import between
from lcpimpact.problems.base import Problem, above_zero, not_negative, restitution
from lcpimpact.problems.facts import Fact
from lcpimpact.problems.registered import registered
from lcpimpact.reading import Readable, event, final, instant, limit
from lcpimpact.scheme.elements.base import GROUND, Element
from lcpimpact.scheme.elements.bumper import Bumper
from lcpimpact.scheme.elements.friction import Friction
from lcpimpact.scheme.elements.load import Load
from lcpimpact.scheme.elements.mass import Mass
from lcpimpact.scheme.scheme import Scheme


@registered
def rolling_sphere(
    m: Annotated[float, "kg, mass"] = 1.0,
    R: Annotated[float, "m, radius"] = 0.1,
    k: Annotated[float, "1, moment of inertia over m R²"] = 0.4,
    g: Annotated[float, "m/s², gravity"] = 9.81,
    mu: Annotated[float, "1, coefficient of friction μ"] = 0.2,
    v0: Annotated[float, "m/s, velocity at the start"] = 2.0,
    omega0: Annotated[float, "rad/s, angular velocity ω at the start, above zero backspin"] = 0.0,
) -> Problem:
    r"""A ball that is pushed along the floor: it slides at first, and rolls in the end.

    While the rim slides, ``s = x' + R φ' != 0``, friction is constant, ``μ m g`` against s. It changes x' and R φ' in the
    proportion k to 1, which leaves ``x' - k R φ'`` as it is: the angular momentum about any point of the floor. So

    - it rolls, s = 0, from ``t_r = |s_0| k/((1 + k) μ g)`` on,
    - with ``v_r = (v0 - k R ω_0)/(1 + k)``, whatever the friction: 5/7 of v0 for a sphere that started without spin,
    - having come ``(v0 + v_r) t_r/2`` far by then.

    Rolling takes no force at all. The share ``k/(1 + k)`` of ``m s_0²/2`` is lost, whatever the friction, too. The trap is
    to roll it from the start, which keeps the energy, or to stop the friction only where a step happens to meet s = 0.

    Raises
    ------
    InputError
        If a parameter other than omega0 is not above zero, or the ball rolls from the start.

    Examples
    --------
    >>> [round(fact.value, 9) for fact in rolling_sphere().facts]
    [0.291247998, 1.428571429, 0.499282282, -14.285714286]

    References
    ----------
    Coriolis, Théorie mathématique des effets du jeu de billard (1835).
    """
    return _slides_and_rolls("rolling-sphere", m, R, k, g, mu, v0, omega0)


@registered
def draw_shot(
    m: Annotated[float, "kg, mass"] = 0.2,
    R: Annotated[float, "m, radius"] = 0.03,
    k: Annotated[float, "1, moment of inertia over m R²"] = 0.4,
    g: Annotated[float, "m/s², gravity"] = 9.81,
    mu: Annotated[float, "1, coefficient of friction μ"] = 0.2,
    v0: Annotated[float, "m/s, velocity at the start"] = 2.0,
    omega0: Annotated[float, "rad/s, backspin at the start"] = 800.0 / 3.0,
) -> Problem:
    r"""A billiard ball with backspin: it slows down, turns, and comes back.

    It is `rolling_sphere` with a spin that wins: ``v_r = (v0 - k R ω_0)/(1 + k)`` is below zero for ``k R ω_0 > v0``.
    Sliding friction pushes the ball back all the time, so it

    - turns at ``t_0 = v0/(μ g)``, after ``v0²/(2 μ g)``,
    - and rolls back from ``t_r = (v0 + R ω_0) k/((1 + k) μ g)`` on at |v_r|.

    Friction knows the velocity of the rim and not that of the ball: it does not change sign where the ball turns. That is
    the trap of a law written as ``-μ m g sign x'``.

    Raises
    ------
    InputError
        If a parameter is not above zero, or the spin is too weak to bring the ball back.

    Examples
    --------
    >>> [round(fact.value, 9) for fact in draw_shot().facts]
    [1.456239988, -0.857142857, 0.832137136, 28.571428571]

    References
    ----------
    Coriolis, Théorie mathématique des effets du jeu de billard (1835).
    """
    name = "draw-shot"
    if not k * R * omega0 > v0:
        raise InputError(
            f"{name}: omega0 = {omega0:g} is too weak to bring the ball back; it must be above {v0 / (k * R):g}"
        )
    return _slides_and_rolls(name, m, R, k, g, mu, v0, omega0)


def _slides_and_rolls(
    name: str, m: float, R: float, k: float, g: float, mu: float, v0: float, omega0: float
) -> Problem:
    above_zero(name, m=m, R=R, k=k, g=g, mu=mu, v0=v0)
    s = v0 + R * omega0
    if s == 0.0:
        raise InputError(f"{name}: with R omega0 = {R * omega0:g} = -v0 the ball rolls from the start; change omega0")
    t_r = abs(s) * k / ((1.0 + k) * mu * g)
    v_r = (v0 - k * R * omega0) / (1.0 + k)

    def facts() -> tuple[Fact, ...]:
        return (
            Fact("t_r", "rolls from", t_r, "s", partial(instant, kind="stick")),
            Fact("v_r", "velocity from then on", v_r, "m/s", partial(final, series="v_x"), scale=v0),
            Fact("x_r", "way until then", 0.5 * (v0 + v_r) * t_r, "m",
                 partial(limit, kind="stick", of="q", i=0, side="left"), scale=v0 * t_r),
            Fact("ω_r", "angular velocity", -v_r / R, "rad/s", partial(final, series="v_φ"), scale=v0 / R),
        )  # fmt: skip

    def motion(t: Array) -> tuple[Array, Array]:
        friction = mu * g
        a = -math.copysign(friction, v0 + R * omega0)
        times = np.asarray(t, dtype=np.float64)
        slid = np.minimum(times, t_r)
        rolled = np.maximum(times - t_r, 0.0)
        α, zero = a / (k * R), np.zeros_like(times)
        v, ω = v0 + a * slid, omega0 + α * slid
        x = v0 * slid + 0.5 * a * slid**2 + v * rolled
        φ = omega0 * slid + 0.5 * α * slid**2 + ω * rolled
        return np.column_stack([x, zero, φ]), np.column_stack([v, zero, ω])

    return Problem(
        name,
        _ball(m, R, k, Load("y", m * g, symbols=("mg",)), Bumper("y", GROUND, e=0.0, name="N", symbols=("N",)),
              Friction({"x": 1.0, "φ": R}, GROUND, mu, normal="N")),
        v0={"x": v0, "φ": omega0},
        t_end=1.75 * t_r,
        units={"φ": "rad"},
        source="Coriolis1835",
        facts=facts,
        motion=motion,
    )  # fmt: skip


def _ball(m: float, R: float, k: float, *elements: Element) -> Scheme:
    """Return a ball with the coordinates x, y and φ."""
    return Scheme(Mass("x", m), Mass("y", m), Mass("φ", k * m * (R * R), symbols=("J",)), *elements)


@registered
def spinning_ball(
    m: Annotated[float, "kg, mass"] = 1.0,
    R: Annotated[float, "m, radius"] = 0.1,
    k: Annotated[float, "1, moment of inertia over m R²"] = 0.4,
    g: Annotated[float, "m/s², gravity"] = 9.81,
    mu: Annotated[float, "1, coefficient of friction μ"] = 0.2,
    e: Annotated[float, "1, normal coefficient of restitution"] = 0.5,
    e_T: Annotated[float, "1, tangential coefficient of restitution"] = 0.0,
    v_y: Annotated[float, "m/s, speed at which it meets the floor"] = 3.0,
    omega0: Annotated[float, "rad/s, spin"] = 50.0,
) -> Problem:
    r"""A ball dropped with spin on a rough floor: an impact that slides, sticks, or turns the slip round.

    It falls from rest and meets the floor at v_y with the slip ``s = R ω_0``. The normal impulse is ``P = (1 + e) m v_y``,
    and that of friction at most μ P. To bring the slip to ``-e_T s`` takes ``(1 + e_T) m s k/(1 + k)``, so

    - ``P_F = min(μ P, (1 + e_T) m |s| k/(1 + k))``, and the ball leaves with ``x' = -P_F/m``, ``R φ' = s - P_F/(k m)``,
    - if the first is the smaller it has slid through the impact, and friction does not depend on the slip; else the slip has
      ended, and with e_T = 0 the ball rolls off with ``x' = -k s/(1 + k)``.

    Whatever the impacts, ``x' - k R φ'`` is kept. So the ball rolls in the end with ``-k s/(1 + k)`` even if its first
    impact slides, provided that the floor holds it down at last (e < 1). The trap is to give a superball e_T = 0: it then
    leaves the floor rolling, and never returns its spin.

    Raises
    ------
    InputError
        If m, R, k, g, v_y or omega0 is not above zero, mu is negative, or e or e_T lies outside [0, 1].

    Examples
    --------
    >>> [round(fact.value, 9) for fact in spinning_ball().facts]
    [0.305810398, -0.9, 27.5, 4.5, 0.9, -1.428571429]
    >>> [round(fact.value, 9) for fact in spinning_ball(mu=0.5).facts]
    [0.305810398, -1.428571429, 14.285714286, 4.5, 1.428571429, -1.428571429]

    References
    ----------
    Garwin, Kinematics of an ultraelastic rough ball (1969); Glocker, *Set-Valued Force Laws* (2001).
    """
    name = "spinning-ball"
    above_zero(name, m=m, R=R, k=k, g=g, v_y=v_y, omega0=omega0)
    not_negative(name, mu=mu)
    restitution(name, e)
    between(f"{name}: e_T", e_T, 0.0, 1.0)

    def t_end() -> float:
        bouncing = v_y / g * (1.0 + e) / (1.0 - e) if e < 1.0 else 6.0 * v_y / g
        rolls = R * omega0 * k / ((1.0 + k) * mu * g) if e < 1.0 and mu > 0.0 else 0.0
        return 1.25 * (bouncing + rolls)

    def facts() -> tuple[Fact, ...]:
        s, P = R * omega0, (1.0 + e) * m * v_y
        P_F = min(mu * P, (1.0 + e_T) * m * s * k / (1.0 + k))
        impact = partial(limit, kind="impact", contact="N", of="v", side="right")
        facts: tuple[Fact, ...] = (
            Fact("t_1", "first impact", v_y / g, "s", partial(instant, kind="impact", contact="N")),
            Fact("v", "velocity after it", -P_F / m, "m/s", partial(impact, i=0), scale=s),
            Fact(
                "ω",
                "angular velocity after it",
                omega0 - P_F / (k * m * R),
                "rad/s",
                partial(impact, i=2),
                scale=omega0,
            ),
            Fact("P", "normal impulse", P, "N s", partial(_impulse, contact="N")),
        )
        if P_F > 0.0:
            facts += (Fact("P_F", "impulse of friction", P_F, "N s", partial(_impulse, contact="F")),)
        if e < 1.0 and mu > 0.0:
            v_r = -k * s / (1.0 + k)
            facts += (Fact("v_r", "velocity at last, rolling", v_r, "m/s", partial(final, series="v_x")),)
        return facts

    return Problem(
        name,
        _ball(m, R, k, Load("y", m * g, symbols=("mg",)),
              Bumper("y", GROUND, gap=0.5 * (v_y * v_y) / g, e=e, name="N", symbols=("N",)),
              Friction({"x": 1.0, "φ": R}, GROUND, mu, normal="N", e_T=e_T)),
        v0={"φ": omega0},
        t_end=t_end,
        units={"φ": "rad"},
        source="Garwin1969",
        facts=facts,
    )  # fmt: skip


def _impulse(run: Readable, contact: str) -> float:
    """Return the impulse of a contact in its first impact."""
    return float(event(run, "impact", contact=contact).impulse)


@registered
def super_ball(
    m: Annotated[float, "kg, mass"] = 1.0,
    R: Annotated[float, "m, radius"] = 0.1,
    k: Annotated[float, "1, moment of inertia over m R²"] = 0.4,
    g: Annotated[float, "m/s², gravity"] = 9.81,
    mu: Annotated[float, "1, coefficient of friction μ"] = 50.0,
    H: Annotated[float, "m, height of fall"] = 0.5,
    omega0: Annotated[float, "rad/s, spin"] = 20.0,
) -> Problem:
    r"""A ball that returns its spin, on the floor: every second bounce undoes the one before.

    With e = e_T = 1 and a floor that is rough enough, an impact reverses the velocity of the rim, ``s⁺ = -s``, and keeps
    ``x' - k R φ'``:

    - ``x'⁺ = x' - 2 k/(1 + k) (x' + R φ')`` and ``R φ'⁺ = R φ' - 2/(1 + k) (x' + R φ')``.

    Both together are a reflection of the velocities, which is its own inverse: dropped with spin the ball leaves to one side
    at ``-2 k/(1 + k) R ω_0``, and the second bounce sends it straight up again with all of its spin. It hops along in every
    other flight, and keeps its energy. The trap is to think of friction as a brake: here it turns the slip round in each
    impact, which takes ``2 m |s| k/(1 + k) <= 2 μ m sqrt(2 g H)``.

    Raises
    ------
    InputError
        If a parameter is not above zero, or the floor is not rough enough.

    Examples
    --------
    >>> [round(fact.value, 9) for fact in super_ball().facts]
    [0.319275428, -1.142857143, -8.571428571, 0.0, 20.0]

    References
    ----------
    Garwin, Kinematics of an ultraelastic rough ball (1969).
    """
    name = "super-ball"
    above_zero(name, m=m, R=R, k=k, g=g, mu=mu, H=H, omega0=omega0)
    w = R * omega0
    _grips(name, mu, k * w / (1.0 + k), sqrt(2.0 * g * H))
    fall = sqrt(2.0 * H / g)
    v, u = _bounce(0.0, w, k)

    def facts() -> tuple[Fact, ...]:
        omega1 = u / R
        after = partial(limit, kind="impact", contact="N", of="v", side="right")
        return (
            Fact("t_1", "first bounce", fall, "s", partial(instant, kind="impact", contact="N")),
            Fact("v_1", "velocity after it", v, "m/s", partial(after, i=0)),
            Fact("ω_1", "angular velocity after it", omega1, "rad/s", partial(after, i=2), scale=omega0),
            Fact("v_2", "velocity after the second", 0.0, "m/s", partial(after, i=0, number=2), scale=w),
            Fact("ω_2", "angular velocity after the second", omega0, "rad/s", partial(after, i=2, number=2)),
        )

    def motion(t: Array) -> tuple[Array, Array]:
        omega1 = u / R
        times = np.asarray(t, dtype=np.float64)
        flights = np.floor((times + fall) / (2.0 * fall))
        s = times - 2.0 * fall * flights
        moves = np.mod(flights, 2.0) == 1.0
        # The time spent in flights that move to the side, and in all before the present one.
        aside = 2.0 * fall * np.floor(0.5 * flights) + np.where(moves, s + fall, 0.0)
        zero = np.zeros_like(times)
        q = np.column_stack([v * aside, 0.5 * g * s**2, omega0 * (times - aside) + omega1 * aside])
        return q, np.column_stack([np.where(moves, v, zero), g * s, np.where(moves, omega1, omega0)])

    return Problem(
        name,
        _ball(m, R, k, Load("y", m * g, symbols=("mg",)), Bumper("y", GROUND, gap=H, e=1.0, name="N", symbols=("N",)),
              Friction({"x": 1.0, "φ": R}, GROUND, mu, normal="N", e_T=1.0)),
        v0={"φ": omega0},
        t_end=8.5 * fall,
        units={"φ": "rad"},
        source="Garwin1969",
        facts=facts,
        motion=motion,
    )  # fmt: skip


def _grips(name: str, mu: float, half_impulse: float, v_y: float) -> None:
    """Refuse a coefficient of friction too small to turn a slip round, from half the impulse that this takes over m."""
    if not abs(half_impulse) <= mu * v_y:
        raise InputError(
            f"{name}: mu = {mu:g} is too little to turn the slip round; it must be at least {abs(half_impulse) / v_y:g}"
        )


def _bounce(v: float, w: float, k: float) -> tuple[float, float]:
    """Return x' and R φ' after a bounce that reverses the velocity of the rim, x' + R φ'."""
    s = v + w
    return v - 2.0 * k / (1.0 + k) * s, w - 2.0 / (1.0 + k) * s


@registered
def super_ball_table(
    m: Annotated[float, "kg, mass"] = 1.0,
    R: Annotated[float, "m, radius"] = 0.1,
    k: Annotated[float, "1, moment of inertia over m R²"] = 0.4,
    mu: Annotated[float, "1, coefficient of friction μ of both surfaces"] = 50.0,
    h: Annotated[
        float, "m, clear height between floor and table that the ball leaves, 2 R less than their distance"
    ] = 0.8,
    v_x: Annotated[float, "m/s, velocity at the start, along the floor"] = 1.0,
    v_y: Annotated[float, "m/s, velocity at the start, towards the floor"] = 1.0,
) -> Problem:
    r"""A super ball thrown under a table: it comes back out.

    e = e_T = 1, no gravity. From half of the height it flies down to the floor, up to the table, and down to the floor
    again. Each bounce is the reflection of `super_ball`, but at the table the rim moves with ``x' - R φ'``. So the bounces
    no longer undo each other:

    - for k = 2/5 and no spin at the start x' is 3/7, -31/49 and -333/343 of v_x after the three bounces: it goes back where
      it came from, at nearly the same speed.

    Every impact keeps the energy, and the angular momentum about its own surface, ``x' ∓ k R φ'``, which differ: that is why
    a smooth ball goes on under the table and a rough one does not. The trap is one sign for both surfaces.

    Raises
    ------
    InputError
        If a parameter is not above zero, or the surfaces are not rough enough.

    Examples
    --------
    >>> [round(fact.value, 9) for fact in super_ball_table().facts]
    [0.4, 0.428571429, -0.632653061, -0.970845481, 3.790087464]

    References
    ----------
    Garwin, Kinematics of an ultraelastic rough ball (1969).
    """
    name = "super-ball-table"
    above_zero(name, m=m, R=R, k=k, mu=mu, h=h, v_x=v_x, v_y=v_y)
    states = [(v_x, 0.0)]
    for side in (1.0, -1.0, 1.0):
        v, w = states[-1]
        _grips(name, mu, k * (v + side * w) / (1.0 + k), v_y)
        v, w = _bounce(v, side * w, k)
        states.append((v, side * w))

    def facts() -> tuple[Fact, ...]:
        after = partial(limit, kind="impact", of="v", side="right")
        (v_x, _), (v_1, _), (v_2, _), (v_3, w_3) = states
        return (
            Fact("t_1", "first bounce", 0.5 * h / v_y, "s", partial(instant, kind="impact", contact="N1")),
            Fact("v_1", "velocity after the floor", v_1, "m/s", partial(after, contact="N1", i=0), scale=v_x),
            Fact("v_2", "velocity after the table", v_2, "m/s", partial(after, contact="N2", i=0), scale=v_x),
            Fact("v_3", "velocity after the floor again", v_3, "m/s", partial(after, contact="N1", i=0, number=2),
                 scale=v_x),
            Fact("ω_3", "angular velocity then", w_3 / R, "rad/s", partial(after, contact="N1", i=2, number=2),
                 scale=v_x / R),
        )  # fmt: skip

    return Problem(
        name,
        _ball(m, R, k,
              Bumper("y", GROUND, gap=0.5 * h, e=1.0, name="N1", symbols=("N_1",)),
              Bumper(GROUND, "y", gap=0.5 * h, e=1.0, name="N2", symbols=("N_2",)),
              Friction({"x": 1.0, "φ": R}, GROUND, mu, normal="N1", e_T=1.0, name="F1"),
              Friction({"x": 1.0, "φ": -R}, GROUND, mu, normal="N2", e_T=1.0, name="F2")),
        v0={"x": v_x, "y": v_y},
        t_end=3.25 * h / v_y,
        units={"φ": "rad"},
        source="Garwin1969",
        facts=facts,
    )  # fmt: skip
