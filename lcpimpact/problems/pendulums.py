r"""Pendulums: one in x and y, and others that strike a wall, a stop, each other, and a rough floor."""

from __future__ import annotations

import math
from functools import partial
from typing import Annotated

import numpy as np

from lcpimpact.arrays import Array
from lcpimpact.errors import InputError
from lcpimpact.numbers import between
from lcpimpact.problems.base import Problem, above_zero, defaults, restitution
from lcpimpact.problems.facts import Fact
from lcpimpact.problems.registered import registered
from lcpimpact.problems.rods import impact, rigid_body
from lcpimpact.reading import Readable, at, crossing, event, instant, limit, peak
from lcpimpact.scheme.lagrangian import FrictionContact, Joint, Lagrangian


def quarter_swing(phi: float, rate: float) -> float:
    """Return the time from rest at an angle to the bottom, of a pendulum with the circular frequency ``rate``."""
    from scipy.special import ellipk

    return float(ellipk(math.sin(0.5 * phi) ** 2)) / rate


def impacts_with_wall(phi: float, wall: float, e: float, rate: float, number: int) -> list[float]:
    """Return the times when a pendulum that is let go at ``phi`` < 0 strikes a wall at an angle."""
    from scipy.special import ellipk, ellipkinc

    w = math.sin(0.5 * wall) ** 2
    k2, t = math.sin(0.5 * phi) ** 2, 0.0
    found: list[float] = []
    for n in range(number):
        swing = float(ellipk(k2) + ellipkinc(math.asin(math.sin(0.5 * wall) / math.sqrt(k2)), k2)) / rate
        t += swing if n == 0 else 2.0 * swing
        found.append(t)
        k2 = w + e * e * (k2 - w)
    return found


def _refuse_wall(name: str, phi: float, wall: float) -> None:
    if not -math.pi < phi < 0.0:
        raise InputError(f"{name}: phi = {phi:g} must be between -π and 0, on the side away from the wall")
    if not 0.0 <= wall < min(-phi, 0.5 * math.pi):
        raise InputError(f"{name}: wall = {wall:g} must be at least 0, and below -phi = {-phi:g} and π/2")


@registered
def pendulum_xy(
    m: Annotated[float, "kg, mass"] = 1.0,
    L: Annotated[float, "m, length"] = 1.0,
    phi: Annotated[float, "rad, angle φ from the vertical at the start"] = 0.5 * math.pi,
    g: Annotated[float, "m/s², gravity"] = 9.81,
) -> Problem:
    r"""A pendulum in x and y with one joint, let go at rest: the first problem of a library of mechanisms, in closed form.

    A mass on a bar without mass, ``sqrt(x² + y²) = L``. With ``ω = sqrt(g/L)``, ``k = sin(φ_0/2)`` and Jacobi's functions
    of ωt and k, ``sin(φ/2) = k cn/dn`` for all times, so

    - it passes the bottom after ``K(k)/ω``, and is back after four times as long,
    - there its speed is ``2 k sqrt(g L)``, and the bar pulls with ``m g (3 - 2 cos φ_0)``, thrice the weight from level.

    The library starts it level and runs it for 2,000 s, a thousand periods: the trap is a joint that holds in each step a
    little less, or a small error of the energy, either of which shifts the period.

    Raises
    ------
    InputError
        If m, L or g is not above zero, or phi is not between 0 and π.

    Examples
    --------
    >>> [round(fact.value, 9) for fact in pendulum_xy().facts]
    [0.591960487, 4.429446918, 29.43, 1.0]

    References
    ----------
    González, Dopico, Lugrís and Cuadrado, A benchmarking system for MBS simulation software (2006), problem A01.
    """
    name = "pendulum-xy"
    above_zero(name, m=m, L=L, g=g)
    if not 0.0 < phi < math.pi:
        raise InputError(f"{name}: phi = {phi:g} must be between 0 and π")
    k, rate = math.sin(0.5 * phi), math.sqrt(g / L)

    def t_end() -> float:
        return 4.2 * quarter_swing(phi, rate)

    def facts() -> tuple[Fact, ...]:
        t = quarter_swing(phi, rate)
        return (
            Fact("t", "it passes the bottom", t, "s", partial(crossing, series="x", direction=-1.0)),
            Fact("v", "speed there", 2.0 * k * math.sqrt(g * L), "m/s", partial(_backwards, t=t)),
            Fact("R", "pull of the bar there", m * g * (3.0 - 2.0 * math.cos(phi)), "N", partial(_pull, t=t)),
            Fact("x(T)", "place after a period", L * math.sin(phi), "m", partial(at, series="x", t=4.0 * t)),
        )

    def motion(t: Array) -> tuple[Array, Array]:
        from scipy.special import ellipj

        sn, cn, dn, _ = ellipj(rate * np.asarray(t, dtype=np.float64), k * k)
        c = math.cos(0.5 * phi) / dn  # cos(φ/2)
        s = k * cn / dn
        turn = -2.0 * k * rate * math.cos(0.5 * phi) * sn / dn
        x, y = 2.0 * L * s * c, L * (s * s - c * c)
        return np.column_stack([x, y]), np.column_stack([-y * turn, x * turn])

    bar = Joint("bar", gap=lambda t, q: np.sqrt(q[0] ** 2 + q[1] ** 2) - L)
    return Problem(
        name,
        Lagrangian("x y", M=lambda q: m * np.eye(2), V=lambda q: m * g * q[1], joints=[bar]),
        q0={"x": L * math.sin(phi), "y": -L * math.cos(phi)},
        t_end=t_end,
        source="GonzalezDopicoLugrisCuadrado2006, problem A01",
        facts=facts,
        motion=motion,
    )


def _backwards(run: Readable, t: float) -> float:
    """Return -x' at a time."""
    return -at(run, "v_x", t)


def _pull(run: Readable, t: float) -> float:
    """Return the force of the bar at a time, towards the pivot."""
    return -at(run, "bar", t)


def _first_impulse(run: Readable) -> float:
    """Return the impulse of the first impact."""
    return float(event(run, "impact").impulse)


@registered
def pendulum_and_wall(
    m: Annotated[float, "kg, mass"] = 1.0,
    L: Annotated[float, "m, length"] = 1.0,
    phi: Annotated[float, "rad, angle φ at the start, below zero"] = -1.0,
    wall: Annotated[float, "rad, angle where the pendulum meets the wall"] = 0.3,
    e: Annotated[float, "1, coefficient of restitution"] = 0.8,
    g: Annotated[float, "m/s², gravity"] = 9.81,
) -> Problem:
    r"""A pendulum let go far from a wall that it strikes: impacts by elliptic integrals.

    ``φ'' = -(g/L) sin φ``, with a vertical wall at ``φ_w``. With ``ω_0 = sqrt(g/L)``, ``k = sin(φ_max/2)`` and
    ``s_w = sin(φ_w/2)``, from the turning point to the wall takes ``(K(k) + F(asin(s_w/k), k))/ω_0``, so

    - the first impact is at that time, each later one twice as much after the last, where
    - an impact changes k² to ``s_w² + e² (k² - s_w²)``, since ``φ'² = 4 ω_0² (k² - s_w²)`` at the wall.

    The impulse acts on the angle with the lever ``L cos φ_w``: ``P = (1 + e) m L |φ'|/cos φ_w``. With e < 1 the amplitude
    falls to φ_w in infinitely many impacts that take infinitely long: a wall off the bottom has no accumulation. The trap is
    the linear pendulum, whose first impact is 6 % early here.

    Raises
    ------
    InputError
        If m, L or g is not above zero, e lies outside [0, 1], or the angles are not -π < φ < 0 <= wall < -φ, π/2.

    Examples
    --------
    >>> [round(fact.value, 9) for fact in pendulum_and_wall().facts]
    [0.636375399, 2.853589087, 5.376598104, 1.931565897, 3.26689502]

    References
    ----------
    Brogliato, *Nonsmooth Mechanics* (2016).
    """
    name = "pendulum-and-wall"
    above_zero(name, m=m, L=L, g=g)
    restitution(name, e)
    _refuse_wall(name, phi, wall)
    rate = math.sqrt(g / L)
    speed = rate * math.sqrt(2.0 * (math.cos(wall) - math.cos(phi)))

    def t_end() -> float:
        return 1.05 * impacts_with_wall(phi, wall, e, rate, 3)[-1]

    def facts() -> tuple[Fact, ...]:
        t = impacts_with_wall(phi, wall, e, rate, 3)
        facts = (
            Fact("t_1", "first impact", t[0], "s", partial(instant, kind="impact")),
            Fact("ω_1", "angular velocity before it", speed, "rad/s",
                 partial(limit, kind="impact", of="v", i=0, side="left")),
            Fact("P_1", "its impulse", (1.0 + e) * m * L * speed / math.cos(wall), "N s",
                 _first_impulse),
        )  # fmt: skip
        later = [
            Fact(f"t_{n}", f"impact {n}", t[n - 1], "s", partial(instant, kind="impact", number=n)) for n in (2, 3)
        ]
        return (*facts, *later) if e > 0.0 else facts

    return Problem(
        name,
        Lagrangian(
            "φ",
            M=lambda q: np.array([[m * L * L]]),
            V=lambda q: -m * g * L * np.cos(q[0]),
            contacts=[FrictionContact("N", gap=lambda t, q: L * (math.sin(wall) - np.sin(q[0])), e=e)],
        ),
        q0={"φ": phi},
        t_end=t_end,
        units={"φ": "rad"},
        source="Brogliato2016",
        facts=facts,
    )


@registered
def double_pendulum_stop(
    m: Annotated[float, "kg, mass of each bob"] = 1.0,
    L: Annotated[float, "m, length of each rod"] = 1.0,
    phi1: Annotated[float, "rad, first angle at the start"] = -0.8,
    phi2: Annotated[float, "rad, second angle at the start"] = -0.3,
    d: Annotated[float, "m, distance of the wall"] = 0.2,
    e: Annotated[float, "1, coefficient of restitution"] = 0.5,
    g: Annotated[float, "m/s², gravity"] = 9.81,
) -> Problem:
    r"""A double pendulum whose lower bob strikes a wall: masses that depend on the motion.

    Angles from the vertical, ``M = m l² [[2, cos(φ_1 - φ_2)], [cos(φ_1 - φ_2), 1]]`` and ``V = -m g L (2 cos φ_1 + cos
    φ_2)``; the lower bob stays at ``L (sin φ_1 + sin φ_2) <= d``. There is no closed form of the motion, but some of what
    any run must show:

    - before the first impact the energy is that of the start, ``-m g L (2 cos φ_1 + cos φ_2)``,
    - the impact reverses ``U = -L (cos φ_1 φ_1' + cos φ_2 φ_2')`` by the factor -e,
    - and its impulse has no moment that turns both rods at a fixed wall: ``p_1/cos φ_1 = p_2/cos φ_2`` for the jumps of the
      generalized momenta ``p = M v``.

    With the values here the digits of the first impact, and of both angles at t = 2, are known from Taylor series in
    30-digit arithmetic. The trap is a mass matrix taken at the beginning of a step alone: it costs an order.

    Raises
    ------
    InputError
        If m, L or g is not above zero, e lies outside [0, 1], or the lower bob starts beyond the wall.

    Examples
    --------
    >>> [round(fact.value, 9) for fact in double_pendulum_stop().facts]
    [-23.041236596, 0.5, 0.0, 0.746122043, 0.038213518, -0.460311412]

    References
    ----------
    Brogliato, *Nonsmooth Mechanics* (2016).
    """
    name = "double-pendulum-stop"
    above_zero(name, m=m, L=L, g=g)
    restitution(name, e)
    reach = L * (math.sin(phi1) + math.sin(phi2))
    if not reach < d:
        raise InputError(f"{name}: d = {d:g} must be above L (sin phi1 + sin phi2) = {reach:g}, where the bob starts")

    def facts() -> tuple[Fact, ...]:
        E = -m * g * L * (2.0 * math.cos(phi1) + math.cos(phi2))
        known: tuple[Fact, ...] = (
            Fact("E", "energy before the first impact", E, "J", _energy_before, scale=m * g * L),
            Fact("e", "speed of the bob from the wall over that before", e, "", _ratio, scale=1.0),
            Fact("δp", "difference of the jumps p_1/cos φ_1 and p_2/cos φ_2", 0.0, "kg m²/s", _moment,
                 scale=m * L * math.sqrt(g * L)),
        )  # fmt: skip
        if problem.parameters == defaults(double_pendulum_stop):
            known += (
                Fact("t_1", "first impact", 0.746122042951, "s", partial(instant, kind="impact"), digits=12),
                Fact("φ_1", "first angle at t = 2", 0.0382135176317, "rad", partial(at, series="φ_1", t=2.0),
                     scale=1.0, digits=12),
                Fact("φ_2", "second angle at t = 2", -0.460311411861, "rad", partial(at, series="φ_2", t=2.0),
                     scale=1.0, digits=12),
            )  # fmt: skip
        return known

    def M(q: Array) -> Array:
        c = np.cos(q[0] - q[1])
        return m * L * L * np.array([[2.0, c], [c, 1.0]])

    problem = Problem(
        name,
        Lagrangian(
            "φ_1 φ_2",
            M=M,
            V=lambda q: -m * g * L * (2.0 * np.cos(q[0]) + np.cos(q[1])),
            contacts=[FrictionContact("N", gap=lambda t, q: d - L * (np.sin(q[0]) + np.sin(q[1])), e=e)],
        ),
        q0={"φ_1": phi1, "φ_2": phi2},
        t_end=2.0,
        units={"φ_1": "rad", "φ_2": "rad"},
        source="Brogliato2016",
        facts=facts,
    )
    return problem


def _energy_before(run: Readable) -> float:
    """Return the energy before the first impact."""
    left = event(run, "impact").left
    return float(run.problem.dynamics.energy(left.q, left.v))


def _ratio(run: Readable) -> float:
    """Return -U⁺/U⁻ of the first impact of a double pendulum with a wall."""
    found = event(run, "impact")
    c = np.cos(found.left.q)
    return -float(c @ found.right.v) / float(c @ found.left.v)


def _moment(run: Readable) -> float:
    """Return the difference of the jumps of M v over cos φ in the first impact of a double pendulum with a wall."""
    found = event(run, "impact")
    p = run.problem.dynamics.momentum(found.left.q, found.right.v - found.left.v) / np.cos(found.left.q)
    return float(p[0] - p[1])


@registered
def rod_on_pin(
    m: Annotated[float, "kg, mass"] = 1.0,
    L: Annotated[float, "m, length"] = 1.0,
    phi: Annotated[float, "rad, angle φ at the start, below zero"] = -1.0,
    wall: Annotated[float, "rad, angle where the rod meets the wall"] = 0.3,
    e: Annotated[float, "1, coefficient of restitution"] = 0.8,
    g: Annotated[float, "m/s², gravity"] = 9.81,
) -> Problem:
    r"""A rod that hangs on a pin, in three coordinates and two joints, and strikes a wall with its end.

    x and y of the middle and the angle φ, held by ``x = (L/2) sin φ`` and ``y = -(L/2) cos φ``: the same motion as that of a
    pendulum of the length ``2 L/3``, so

    - its impacts are those of `pendulum_and_wall` with ``ω_0 = sqrt(3 g/(2 L))``,
    - and where it first hangs straight, after ``K(sin(φ_0/2))/ω_0``, the pin carries ``m g (1 + (3/2) (1 - cos φ_0))``.

    At an impact the pin takes an impulse as well, unless it strikes at 2/3 of its length, the centre of percussion. The trap
    is a joint that is held by its velocity alone: it drifts apart, by a little in every step.

    Raises
    ------
    InputError
        If m, L or g is not above zero, e lies outside [0, 1], or the angles are not -π < φ < 0 <= wall < -φ, π/2.

    Examples
    --------
    >>> [round(fact.value, 9) for fact in rod_on_pin().facts]
    [0.519598337, 3.494918599, 0.436649634, 16.574451569, 1.577116951, 2.667408614]

    References
    ----------
    Glocker, *Set-Valued Force Laws* (2001).
    """
    name = "rod-on-pin"
    above_zero(name, m=m, L=L, g=g)
    restitution(name, e)
    _refuse_wall(name, phi, wall)
    rate = math.sqrt(1.5 * g / L)

    def t_end() -> float:
        return 1.05 * impacts_with_wall(phi, wall, e, rate, 3)[-1]

    def facts() -> tuple[Fact, ...]:
        t = impacts_with_wall(phi, wall, e, rate, 3)
        speed = rate * math.sqrt(2.0 * (math.cos(wall) - math.cos(phi)))
        t_0 = quarter_swing(phi, rate)
        facts = (
            Fact("t_1", "first impact", t[0], "s", partial(instant, kind="impact", contact="N")),
            Fact("ω_1", "angular velocity before it", speed, "rad/s",
                 partial(limit, kind="impact", contact="N", of="v", i=2, side="left")),
            Fact("t_0", "it hangs straight", t_0, "s", partial(crossing, series="φ")),
            Fact("R", "force of the pin then", m * g * (1.0 + 1.5 * (1.0 - math.cos(phi))), "N",
                 partial(at, series="pin_y", t=t_0)),
        )  # fmt: skip
        later = [
            Fact(f"t_{n}", f"impact {n}", t[n - 1], "s", partial(instant, kind="impact", contact="N", number=n))
            for n in (2, 3)
        ]
        return (*facts, *later) if e > 0.0 else facts

    wall_of_end = FrictionContact("N", gap=lambda t, q: L * math.sin(wall) - q[0] - 0.5 * L * np.sin(q[2]), e=e)
    pin = [
        Joint("pin_x", gap=lambda t, q: q[0] - 0.5 * L * np.sin(q[2])),
        Joint("pin_y", gap=lambda t, q: q[1] + 0.5 * L * np.cos(q[2])),
    ]
    return Problem(
        name,
        rigid_body(m, m * L * L / 12.0, g, [wall_of_end], pin),
        q0={"x": 0.5 * L * math.sin(phi), "y": -0.5 * L * math.cos(phi), "φ": phi},
        t_end=t_end,
        units={"φ": "rad"},
        source="Glocker2001",
        facts=facts,
    )


@registered
def pendulum_cradle(
    m: Annotated[float, "kg, mass of each ball"] = 1.0,
    L: Annotated[float, "m, length of the pendulums"] = 1.0,
    r: Annotated[float, "m, radius of the balls"] = 0.05,
    phi: Annotated[float, "rad, angle by which the first is lifted"] = 0.5,
    e: Annotated[float, "1, coefficient of restitution"] = 1.0,
    g: Annotated[float, "m/s², gravity"] = 9.81,
) -> Problem:
    r"""Newton's cradle of three pendulums that touch: Newton's law does not send the last ball off alone.

    The first ball is lifted by φ and let go. It arrives after ``K(sin(φ/2)) sqrt(L/g)`` with
    ``ω = 2 sqrt(g/L) sin(φ/2)``, and strikes two that touch. Newton's law for both contacts at once,
    ``U_i⁺ = -e U_i⁻``, leaves

    - ``(1 - 2 e)/3 ω``, ``(1 + e)/3 ω``, ``(1 + e)/3 ω``: -1/3, 2/3, 2/3 for e = 1,
    - so the last two swing up together, to ``sin(φ_3/2) = (1 + e)/3 sin(φ/2)``.

    Energy and momentum are kept for e = 1, and so they are by (0, 0, 1), which is seen in the laboratory and what gaps
    between the balls give, however small. The trap is to hold either for the law of a cradle: what the balls do while they
    touch is beyond rigid bodies.

    Raises
    ------
    InputError
        If m, L, r or g is not above zero, e lies outside [0, 1], or phi is not between 0 and π/2.

    Examples
    --------
    >>> [round(fact.value, 9) for fact in pendulum_cradle().facts]
    [0.509466979, -0.516594633, 1.033189266, 1.033189266, 0.331386189]

    References
    ----------
    Glocker and Pfeiffer, Multiple impacts with friction in rigid multibody systems (1995).
    """
    name = "pendulum-cradle"
    above_zero(name, m=m, L=L, r=r, g=g)
    restitution(name, e)
    if not 0.0 < phi < 0.5 * math.pi:
        raise InputError(f"{name}: phi = {phi:g} must be between 0 and π/2")
    rate = math.sqrt(g / L)

    def t_end() -> float:
        return 2.1 * quarter_swing(phi, rate)

    def facts() -> tuple[Fact, ...]:
        ω = 2.0 * rate * math.sin(0.5 * phi)
        both = (1.0 + e) / 3.0
        after = partial(limit, kind="impact", of="v", side="right")
        return (
            Fact("t_1", "impact", quarter_swing(phi, rate), "s", partial(instant, kind="impact")),
            *(
                Fact(f"ω_{i + 1}", f"velocity of ball {i + 1} after it", share * ω, "rad/s", partial(after, i=i), scale=ω)
                for i, share in enumerate(((1.0 - 2.0 * e) / 3.0, both, both))
            ),
            Fact("φ_3", "greatest angle of the last", 2.0 * math.asin(both * math.sin(0.5 * phi)), "rad",
                 partial(peak, series="φ_3")),
        )  # fmt: skip

    def between_balls(i: int) -> FrictionContact:
        """Return the contact of balls i and i + 1."""
        return FrictionContact(
            f"N{i + 1}",
            gap=lambda t, q: (
                np.sqrt(
                    (2.0 * r + L * (np.sin(q[i + 1]) - np.sin(q[i]))) ** 2
                    + (L * (np.cos(q[i + 1]) - np.cos(q[i]))) ** 2
                )
                - 2.0 * r
            ),
            e=e,
        )

    return Problem(
        name,
        Lagrangian(
            "φ_1 φ_2 φ_3",
            M=lambda q: m * L * L * np.eye(3),
            V=lambda q: -m * g * L * (np.cos(q[0]) + np.cos(q[1]) + np.cos(q[2])),
            contacts=[between_balls(0), between_balls(1)],
        ),
        q0={"φ_1": -phi},
        t_end=t_end,
        units=dict.fromkeys(("φ_1", "φ_2", "φ_3"), "rad"),
        source="GlockerPfeiffer1995",
        facts=facts,
    )


@registered
def kane_pendulum(
    m: Annotated[float, "kg, mass of each rod"] = 1.0,
    L: Annotated[float, "m, length of each rod"] = 1.0,
    phi1: Annotated[float, "rad, angle of the upper rod"] = math.pi / 9.0,
    phi2: Annotated[float, "rad, angle of the lower rod"] = math.pi / 6.0,
    v1: Annotated[float, "rad/s, angular velocity of the upper rod"] = -0.1,
    v2: Annotated[float, "rad/s, angular velocity of the lower rod"] = -0.2,
    mu: Annotated[float, "1, coefficient of friction μ"] = 0.5,
    e: Annotated[float, "1, normal coefficient of restitution"] = 0.5,
    e_T: Annotated[float, "1, tangential coefficient of restitution"] = 0.0,
) -> Problem:
    r"""Kane's double pendulum: Newton's law and Coulomb's make energy out of nothing.

    Two uniform rods hang on a hinge, without gravity, and the tip strikes a rough floor at the start. With
    ``M = m l² [[4/3, c/2], [c/2, 1/3]]``, ``c = cos(φ_1 - φ_2)``, and the rows
    ``H = L [[sin φ_1, sin φ_2], [cos φ_1, cos φ_2]]`` of the tip, it sticks if the impulse

    - ``P = -(H M⁻¹ Hᵀ)⁻¹ ((1 + e) U_N, (1 + e_T) U_T)``

    lies in the cone of friction, and ``v⁺ = v + M⁻¹ Hᵀ P``. With e = 0.5 and e_T = 0 the kinetic energy rises from 0.0232 J
    to 0.0368 J, although the tip comes off more slowly and friction has brought its slip to an end: the normal impulse pays
    for both. With e_T = e, one coefficient for normal and tangent, energy never grows. The trap is to read e <= 1 as "no
    energy is gained".

    Raises
    ------
    InputError
        If m or L is not above zero, mu is negative, e or e_T lies outside [0, 1], or the tip does not approach the floor.

    Examples
    --------
    >>> [round(fact.value, 9) for fact in kane_pendulum().facts]
    [-0.33464893, 0.363115364, 0.036800367, 0.56797988, -0.244596591]

    References
    ----------
    Kane and Levinson, *Dynamics: Theory and Applications* (1985).
    """
    name = "kane-pendulum"
    above_zero(name, m=m, L=L)
    restitution(name, e)
    between(f"{name}: e_T", e_T, 0.0, 1.0)
    if mu < 0.0:
        raise InputError(f"{name}: mu = {mu:g} must not be negative")
    v = np.array([v1, v2])
    c = math.cos(phi1 - phi2)
    M = m * L * L * np.array([[4.0 / 3.0, 0.5 * c], [0.5 * c, 1.0 / 3.0]])
    H = L * np.array([[math.sin(phi1), math.sin(phi2)], [math.cos(phi1), math.cos(phi2)]])
    U = H @ v
    if not U[0] < 0.0:
        raise InputError(f"{name}: the tip moves off the floor at {U[0]:g} m/s; change v1 or v2")

    def facts() -> tuple[Fact, ...]:
        P = impact(H @ np.linalg.solve(M, H.T), U, mu, e, e_T)
        w = v + np.linalg.solve(M, H.T @ P)
        after = partial(limit, kind="impact", contact="N", of="v", side="right")
        size = float(np.abs(v).max())
        impulses = zip(("N", "T"), ("N", "N_T"), ("normal impulse", "impulse of friction"), P, strict=True)
        return (
            Fact(
                "ω_1",
                "angular velocity of the upper rod after it",
                float(w[0]),
                "rad/s",
                partial(after, i=0),
                scale=size,
            ),
            Fact(
                "ω_2",
                "angular velocity of the lower rod after it",
                float(w[1]),
                "rad/s",
                partial(after, i=1),
                scale=size,
            ),
            Fact("T", "kinetic energy after it", float(0.5 * w @ M @ w), "J", _energy_after),
            *(
                Fact(f"P_{symbol}", what, float(value), "N s", partial(_impulse, contact=contact), scale=float(P[0]))
                for symbol, contact, what, value in impulses
            ),
        )

    def mass(q: Array) -> Array:
        c = np.cos(q[0] - q[1])
        return m * L * L * np.array([[4.0 / 3.0, 0.5 * c], [0.5 * c, 1.0 / 3.0]])

    height = L * (math.cos(phi1) + math.cos(phi2))
    tip = FrictionContact(
        "N",
        gap=lambda t, q: height - L * (np.cos(q[0]) + np.cos(q[1])),
        slip=lambda t, q, v: L * (np.cos(q[0]) * v[0] + np.cos(q[1]) * v[1]),
        mu=mu,
        e=e,
        e_T=e_T,
    )
    return Problem(
        name,
        Lagrangian("φ_1 φ_2", M=mass, contacts=[tip]),
        q0={"φ_1": phi1, "φ_2": phi2},
        v0={"φ_1": v1, "φ_2": v2},
        t_end=0.1 / float(np.abs(v).max()),
        units={"φ_1": "rad", "φ_2": "rad"},
        source="KaneLevinson1985",
        facts=facts,
    )


def _energy_after(run: Readable) -> float:
    """Return the kinetic energy after the first impact."""
    right = event(run, "impact").right
    return float(run.problem.dynamics.kinetic_energy(right.q, right.v))


def _impulse(run: Readable, contact: str) -> float:
    """Return the impulse of a row in its first impact."""
    return float(event(run, "impact", contact=contact).impulse)
