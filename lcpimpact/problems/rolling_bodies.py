r"""Balls and discs as bodies in the plane: with spin, from slip to rolling, and rolling in a bowl."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial
from typing import Annotated

import numpy as np

from lcpimpact.errors import InputError
from lcpimpact.problems.base import Problem, above_zero
from lcpimpact.problems.facts import Fact
from lcpimpact.problems.registered import registered
from lcpimpact.problems.rods import rigid_body
from lcpimpact.problems.rolling_balls import rolling_sphere, spinning_ball
from lcpimpact.reading import Readable, at, crossing, event
from lcpimpact.scheme.lagrangian import FrictionContact, Lagrangian


def _ball(m: float, R: float, k: float, g: float, mu: float, e: float = 0.0, e_T: float = 0.0) -> Lagrangian:
    """Return a ball over a rough floor."""
    floor = FrictionContact("N", gap=lambda t, q: q[1] - R, slip=lambda t, q, v: v[0] + R * v[2], mu=mu, e=e, e_T=e_T)
    return rigid_body(m, k * m * R * R, g, [floor])


@registered
def ball_with_spin(
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
    r"""A ball dropped with spin on a rough floor, as a body: nine lines of functions.

    x and y of its middle, y upwards, and its angle φ, with ``g_N = y - R`` and ``U_T = x' + R φ'``. Its motion is that of
    `spinning_ball`, with the same numbers:

    - ``P_F = min(μ P, (1 + e_T) m s k/(1 + k))`` of the slip ``s = R ω_0`` and ``P = (1 + e) m v_y``,
    - it leaves with ``x' = -P_F/m`` and ``R φ' = s - P_F/(k m)``, and rolls at last with ``-k s/(1 + k)``.

    Capobianco et al. (section 10.1) let it fall from y = 1 m, v_y = 4.2021 m/s, with e = 0: with a spin of 50 rad/s it
    slides through the impact and rolls later, with 10 rad/s it rolls at once. M and the rows are constant here, so that
    every step of a method must agree with its step of the linear scheme. The trap is the sign of the spin: U_T is the slip
    of the point of contact, not that of the middle.

    Raises
    ------
    InputError
        As `spinning_ball`.

    Examples
    --------
    >>> [round(fact.value, 9) for fact in ball_with_spin().facts]
    [0.305810398, -0.9, 27.5, 4.5, 0.9, -1.428571429]

    References
    ----------
    Garwin, Kinematics of an ultraelastic rough ball (1969); Glocker, *Set-Valued Force Laws* (2001); Capobianco, Harsch,
    Eugster and Leine, A nonsmooth generalized-alpha method for mechanical systems with frictional contact (2021).
    """
    linear = spinning_ball(m=m, R=R, k=k, g=g, mu=mu, e=e, e_T=e_T, v_y=v_y, omega0=omega0)

    def t_end() -> float:
        return linear.t_end

    def facts() -> tuple[Fact, ...]:
        """Return the facts of the linear scheme, whose friction has another name."""
        return tuple(replace(each, measure=_friction) if each.symbol == "P_F" else each for each in linear.facts)

    return Problem(
        "ball-with-spin",
        _ball(m, R, k, g, mu, e, e_T),
        q0={"y": R + 0.5 * v_y * v_y / g},
        v0={"φ": omega0},
        t_end=t_end,
        units={"φ": "rad"},
        source="Garwin1969; Glocker2001; CapobiancoHarschEugsterLeine2021",
        facts=facts,
    )


def _friction(run: Readable) -> float:
    """Return the impulse of friction against the slip in the first impact."""
    return -float(event(run, "impact", contact="N_T").impulse)


@registered
def rolling_disc(
    m: Annotated[float, "kg, mass"] = 1.0,
    R: Annotated[float, "m, radius"] = 0.1,
    k: Annotated[float, "1, moment of inertia over m R²"] = 0.5,
    g: Annotated[float, "m/s², gravity"] = 9.81,
    mu: Annotated[float, "1, coefficient of friction μ"] = 0.2,
    v0: Annotated[float, "m/s, velocity at the start"] = 2.0,
    omega0: Annotated[float, "rad/s, angular velocity at the start"] = 0.0,
) -> Problem:
    r"""A disc set down in motion, as a body: it slides, then rolls.

    Friction ``μ m g`` brakes the middle and spins the disc up, with ``k = J/(m R²)``, until its rim is at rest on the floor:

    - at ``t_r = (v0 + R ω_0) k/((1 + k) μ g)``, which is ``v0/(3 μ g)`` for a disc without spin,
    - and it rolls on with ``(v0 - k R ω_0)/(1 + k)``, with 2/3 of the velocity, on any floor.

    `rolling_sphere` is the same as a linear scheme. There is no impact, and the contact is closed throughout: a method shows
    its order for friction alone. The trap is a penalty for slip, which leaves the disc creeping.

    Raises
    ------
    InputError
        If m, R, k, g, mu or v0 is not above zero, or the disc rolls from the start.

    Examples
    --------
    >>> [round(fact.value, 9) for fact in rolling_disc().facts]
    [0.339789331, 1.333333333, 0.566315551, -13.333333333]

    References
    ----------
    Coriolis, Théorie mathématique des effets du jeu de billard (1835).
    """
    linear = rolling_sphere(m=m, R=R, k=k, g=g, mu=mu, v0=v0, omega0=omega0)

    def facts() -> tuple[Fact, ...]:
        return linear.facts

    return Problem(
        "rolling-disc",
        _ball(m, R, k, g, mu),
        q0={"y": R},
        v0={"x": v0, "φ": omega0},
        t_end=linear.t_end,
        units={"φ": "rad"},
        source="Coriolis1835",
        facts=facts,
    )


@registered
def disc_in_bowl(
    m: Annotated[float, "kg, mass"] = 1.0,
    R: Annotated[float, "m, radius of the bowl"] = 1.0,
    r: Annotated[float, "m, radius of the disc"] = 0.1,
    k: Annotated[float, "1, moment of inertia over m r²"] = 0.5,
    theta: Annotated[float, "rad, angle θ of the disc from the bottom at the start"] = 0.6,
    mu: Annotated[float, "1, coefficient of friction μ"] = 1.0,
    g: Annotated[float, "m/s², gravity"] = 9.81,
) -> Problem:
    r"""A disc that rolls in a bowl: a closed contact whose direction turns.

    While it rolls it is a pendulum with ``θ'' = -g sin θ/((1 + k) (R - r))``. Let go at θ_0

    - it passes the bottom after ``sqrt((1 + k)(R - r)/g) K(sin(θ_0/2))`` and comes back after four times as long,
    - has turned by ``θ_0 (R - r)/r`` there,
    - and presses on the bowl with ``m g (1 + 2 (1 - cos θ_0)/(1 + k))``.

    It rolls if ``tan θ_0 k/(1 + k) <= μ``. Normal and tangent of the contact turn with θ, and a step that takes either from
    one end alone has order 1: that is the trap, and what this problem is for.

    Raises
    ------
    InputError
        If a parameter is not above zero, r is not below R, theta is not below π/2, or mu is so small that it slips.

    Examples
    --------
    >>> [round(fact.value, 9) for fact in disc_in_bowl().facts]
    [0.59609765, 5.4, 12.094610157, 0.508178226]

    References
    ----------
    Glocker, *Set-Valued Force Laws* (2001).
    """
    name = "disc-in-bowl"
    above_zero(name, m=m, R=R, r=r, k=k, theta=theta, mu=mu, g=g)
    if not r < R:
        raise InputError(f"{name}: r = {r:g} must be below R = {R:g}")
    if not theta < 0.5 * math.pi:
        raise InputError(f"{name}: theta = {theta:g} must be below π/2")
    if not (least := math.tan(theta) * k / (1.0 + k)) <= mu:
        raise InputError(f"{name}: with mu = {mu:g} it slips; mu must be at least {least:g}")
    d = R - r

    def quarter() -> float:
        from scipy.special import ellipk

        return math.sqrt((1.0 + k) * d / g) * float(ellipk(math.sin(0.5 * theta) ** 2))

    def t_end() -> float:
        return 4.1 * quarter()

    def facts() -> tuple[Fact, ...]:
        T = quarter()
        return (
            Fact("T/4", "it passes the bottom", T, "s", partial(crossing, series="x", direction=-1.0)),
            Fact("φ", "angle by which it has turned there", theta * d / r, "rad", partial(at, series="φ", t=T)),
            Fact("N", "normal force there", m * g * (1.0 + 2.0 * (1.0 - math.cos(theta)) / (1.0 + k)), "N",
                 partial(at, series="N", t=T)),
            Fact("x(T)", "place after a period", d * math.sin(theta), "m", partial(at, series="x", t=4.0 * T)),
        )  # fmt: skip

    bowl = FrictionContact(
        "N",
        gap=lambda t, q: d - np.sqrt(q[0] ** 2 + q[1] ** 2),
        slip=lambda t, q, v: (v[1] * q[0] - v[0] * q[1]) / np.sqrt(q[0] ** 2 + q[1] ** 2) + r * v[2],
        mu=mu,
    )
    return Problem(
        name,
        rigid_body(m, k * m * r * r, g, [bowl]),
        q0={"x": d * math.sin(theta), "y": -d * math.cos(theta)},
        t_end=t_end,
        units={"φ": "rad"},
        source="Glocker2001",
        facts=facts,
    )
