r"""Rods and planks over an edge, a floor or a plate: falling, tipping, tumbling and bouncing, by functions of the motion."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from typing import Annotated, NamedTuple

import numpy as np

from lcpimpact.arrays import Array
from lcpimpact.errors import InputError
from lcpimpact.problems.base import Problem, above_zero, not_negative, restitution
from lcpimpact.problems.facts import Fact
from lcpimpact.problems.registered import registered
from lcpimpact.reading import Readable, first_root, instant, limit
from lcpimpact.scheme.lagrangian import FrictionContact, Joint, Lagrangian


def rigid_body(
    m: float, J: float, g: float, contacts: Sequence[FrictionContact], joints: Sequence[Joint] = ()
) -> Lagrangian:
    """Return a body in the plane: x and y of its centre of mass, y upwards, and its angle φ, counterclockwise."""
    return Lagrangian(
        "x y φ", M=lambda q: np.diag([m, m, J]), V=lambda q: m * g * q[1], contacts=contacts, joints=joints
    )


def corner(name: str, a: float, b: float, mu: float = 0.0, e: float = 0.0, e_T: float = 0.0) -> FrictionContact:
    """Return the contact of the point (a, b) of a body, seen from its centre of mass, with the floor y = 0."""
    return FrictionContact(
        name,
        gap=lambda t, q: q[1] + a * np.sin(q[2]) + b * np.cos(q[2]),
        slip=lambda t, q, v: v[0] - (a * np.sin(q[2]) + b * np.cos(q[2])) * v[2],
        mu=mu,
        e=e,
        e_T=e_T,
    )


def impact(W: Array, U: Array, mu: float, e: float, e_T: float = 0.0) -> Array:
    """Return the impulses P = (P_N, P_T) of one contact with the rates U before it, where a unit impulse changes U by W.

    It sticks, or turns its slip round by e_T, if the cone of friction allows it, and slides else.
    """
    b = np.array([1.0 + e, 1.0 + e_T]) * U
    P = -np.linalg.solve(W, b)
    if abs(P[1]) <= mu * P[0]:
        return np.asarray(P, dtype=np.float64)
    side = math.copysign(mu, P[1])
    P_N = -b[0] / (W[0, 0] + side * W[0, 1])
    return np.array([P_N, side * P_N])


def of_corner(m: float, J: float, x: float, y: float) -> Array:
    """Return W (2, 2) of a point (x, y) of a body, seen from its centre of mass."""
    return np.array([[1.0 / m + x * x / J, -x * y / J], [-x * y / J, 1.0 / m + y * y / J]])


@registered
def falling_rod(
    m: Annotated[float, "kg, mass"] = 1.0,
    L: Annotated[float, "m, length"] = 1.0,
    mu: Annotated[float, "1, coefficient of friction μ"] = 0.3,
    theta: Annotated[float, "rad, angle θ from upright at the start"] = 0.1,
    g: Annotated[float, "m/s², gravity"] = 9.81,
) -> Problem:
    r"""A uniform rod that falls over, and whose foot slips: the pencil on a rough table.

    It has left the upright position, where it was balanced, and at the start passes the angle θ. While its foot sticks it is
    a pendulum on its separatrix, ``θ' = ω = sqrt(6 g/L) sin(θ/2)``, so

    - from θ_0 to θ takes ``2 sqrt(L/(6 g)) ln(tan(θ/4)/tan(θ_0/4))``,
    - the floor gives ``N = m g (1 - 3 cos θ)²/4`` and ``T = (3/4) m g sin θ (3 cos θ - 2)``,
    - and the foot slips backwards where ``T/N = 3 sin θ (3 cos θ - 2)/(1 - 3 cos θ)² = μ``.

    This ratio has its maximum ``15 sqrt(10)/128 = 0.3706`` at cos θ = 9/11. On a rougher floor the foot passes, and slips
    forwards later. The trap is to look at the floor's force alone at the end of the fall: the normal force vanishes at
    cos θ = 1/3, and no friction whatever holds the foot until then.

    Raises
    ------
    InputError
        If a parameter is not above zero, the foot slips from the start, or the floor is so rough that it passes.

    Examples
    --------
    >>> [round(fact.value, 9) for fact in falling_rod().facts]
    [0.421771293, 0.376119726, 1.605954807, 7.400422654]

    References
    ----------
    Cufaro Petroni, The falling pencil: a divertimento in four movements (2021).
    """
    name = "falling-rod"
    above_zero(name, m=m, L=L, mu=mu, theta=theta, g=g)
    top = math.acos(9.0 / 11.0)

    def ratio(θ: float) -> float:
        """Return T/N."""
        c = math.cos(θ)
        return 3.0 * math.sin(θ) * (3.0 * c - 2.0) / (1.0 - 3.0 * c) ** 2

    if not (theta < top and ratio(theta) < mu < ratio(top)):
        raise InputError(
            f"{name}: with theta = {theta:g} the foot slips backwards later for mu above {ratio(min(theta, top)):g} and "
            f"below {ratio(top):g} only, and mu = {mu:g}; change theta or mu"
        )

    def slip() -> tuple[float, float]:
        """Return the angle where the foot slips, and the time."""
        from scipy.optimize import brentq

        θ = float(brentq(lambda θ: ratio(θ) - mu, theta, top, xtol=1e-16, rtol=4.0 * np.finfo(float).eps))
        return θ, 2.0 * math.sqrt(L / (6.0 * g)) * math.log(math.tan(0.25 * θ) / math.tan(0.25 * theta))

    def t_end() -> float:
        return 1.2 * slip()[1]

    def facts() -> tuple[Fact, ...]:
        θ, t = slip()
        slips = partial(limit, kind="slip", side="left")
        return (
            Fact("θ_s", "angle from upright where the foot slips", θ, "rad", _from_upright),
            Fact("t_s", "the foot slips", t, "s", partial(instant, kind="slip")),
            Fact("ω_s", "angular velocity then", math.sqrt(6.0 * g / L) * math.sin(0.5 * θ), "rad/s",
                 partial(slips, of="v", i=2, unit=-1.0)),
            Fact("N_s", "normal force then", 0.25 * m * g * (1.0 - 3.0 * math.cos(θ)) ** 2, "N",
                 partial(slips, of="reaction", i=0)),
        )  # fmt: skip

    φ, ω = 0.5 * math.pi - theta, math.sqrt(6.0 * g / L) * math.sin(0.5 * theta)
    c, s = 0.5 * L * math.cos(φ), 0.5 * L * math.sin(φ)
    return Problem(
        name,
        rigid_body(m, m * L * L / 12.0, g, [corner("N", -0.5 * L, 0.0, mu)]),
        q0={"x": c, "y": s, "φ": φ},
        v0={"x": s * ω, "y": -c * ω, "φ": -ω},
        t_end=t_end,
        units={"φ": "rad"},
        source="CufaroPetroni2021",
        facts=facts,
    )


def _from_upright(run: Readable) -> float:
    """Return the angle from upright where a rod first slips."""
    return 0.5 * math.pi - limit(run, kind="slip", of="q", i=2, side="left")


@registered
def tipping_plank(
    m: Annotated[float, "kg, mass"] = 1.0,
    L: Annotated[float, "m, length"] = 1.0,
    a: Annotated[float, "m, distance of the edge from the middle"] = 0.2,
    mu: Annotated[float, "1, coefficient of friction μ"] = 0.4,
    g: Annotated[float, "m/s², gravity"] = 9.81,
) -> Problem:
    r"""A plank that is let go on the edge of a table: it tips, and slips off.

    It lies level over the edge, with its middle a beyond it. While it sticks it turns about the edge by the angle θ, with
    the radius of gyration ``k² = L²/12``:

    - ``θ'² = 2 g a sin θ/(k² + a²)``, and ``t = ∫ dθ/θ'`` from 0,
    - ``N = m g cos θ k²/(k² + a²)`` and ``T = m g sin θ (1 + 2 a²/(k² + a²))``,
    - so it slips at ``tan θ = μ/(1 + 36 a²/L²)``, for any mass, length at a given a/L, and gravity.

    A book slips at atan μ on an incline, and this one much earlier: the edge must also hold the plank on its circle. Normal
    and tangent turn with the plank, which a law written in x and y misses: that is the trap.

    Raises
    ------
    InputError
        If a parameter is not above zero, or the edge is beyond the end of the plank.

    Examples
    --------
    >>> [round(fact.value, 9) for fact in tipping_plank().facts]
    [0.162489109, 0.142991143, 2.268715328, 6.541067159]

    References
    ----------
    Cufaro Petroni, The falling pencil: a divertimento in four movements (2021).
    """
    name = "tipping-plank"
    above_zero(name, m=m, L=L, a=a, mu=mu, g=g)
    if not a < 0.5 * L:
        raise InputError(
            f"{name}: a = {a:g} must be below L/2 = {0.5 * L:g}, or the edge is beyond the end of the plank"
        )
    kk = L * L / 12.0
    θ = math.atan(mu / (1.0 + 36.0 * (a / L) ** 2))
    rate = 2.0 * g * a / (kk + a * a)

    def slip() -> float:
        """Return the time of the slip: the integral with θ = u², which is smooth."""
        from scipy.integrate import quad

        found, _ = quad(
            lambda u: 2.0 / math.sqrt(rate * (math.sin(u * u) / (u * u) if u else 1.0)),
            0.0,
            math.sqrt(θ),
            epsabs=0.0,
            epsrel=1e-13,
        )
        return float(found)

    def t_end() -> float:
        return 1.2 * slip()

    def facts() -> tuple[Fact, ...]:
        slips = partial(limit, kind="slip", side="left")
        return (
            Fact("θ_s", "angle where it slips", θ, "rad", partial(slips, of="q", i=2, unit=-1.0)),
            Fact("t_s", "it slips", slip(), "s", partial(instant, kind="slip")),
            Fact("ω_s", "angular velocity then", math.sqrt(rate * math.sin(θ)), "rad/s",
                 partial(slips, of="v", i=2, unit=-1.0)),
            Fact("N_s", "normal force then", m * g * math.cos(θ) * kk / (kk + a * a), "N",
                 partial(slips, of="reaction", i=0)),
        )  # fmt: skip

    edge = FrictionContact(
        "N",
        gap=lambda t, q: q[1] * np.cos(q[2]) - q[0] * np.sin(q[2]),
        slip=lambda t, q, v: (v[0] + q[1] * v[2]) * np.cos(q[2]) + (v[1] - q[0] * v[2]) * np.sin(q[2]),
        mu=mu,
    )
    return Problem(
        name,
        rigid_body(m, m * kk, g, [edge]),
        q0={"x": a},
        t_end=t_end,
        units={"φ": "rad"},
        source="CufaroPetroni2021",
        facts=facts,
    )


class TwoEnds(NamedTuple):
    """A body that strikes a plate with either of two round ends, falls freely in between, and starts at rest.

    Attributes
    ----------
    m, J : float            mass and moment of inertia
    half : float            distance of the middle of each end from that of the body
    mu, e, g : float        friction and restitution of both ends, and gravity
    r : float               radius of the ends
    a, rate : float         the height of the plate is a sin(rate t)
    """

    m: float
    J: float
    half: float
    mu: float
    e: float
    g: float
    r: float = 0.0
    a: float = 0.0
    rate: float = 1e-9

    def flight(self, t: float, y: float, φ: float, v: Array) -> tuple[float, float]:
        """Return how long the body flies from its place at t, and the end that strikes, ±half."""
        half, r, a, rate, g = self.half, self.r, self.a, self.rate, self.g
        last = (v[1] + math.sqrt(v[1] ** 2 + 2.0 * g * (y + half - r + a))) / g
        turn = 2.0 * math.pi / max(abs(v[2]), rate, 1e-3 * math.sqrt(0.5 * g / half))

        def gap(s: Array, end: float) -> Array:
            return np.asarray(
                y + v[1] * s - 0.5 * g * s * s + end * np.sin(φ + v[2] * s) - r - a * np.sin(rate * (t + s))
            )

        found = [(first_root(partial(gap, end=end), 1.001 * last, min(turn, last)), end) for end in (-half, half)]
        return min((s, end) for s, end in found if s is not None)

    def impacts(self, number: int, y: float, φ: float) -> list[tuple[float, Array, str]]:
        """Return the first impacts from rest at y and φ: when, the velocity after each (3,), and the end, A or B."""
        t, v = 0.0, np.zeros(3)
        found: list[tuple[float, Array, str]] = []
        while len(found) < number:
            s, end = self.flight(t, y, φ, v)
            t, y, φ = t + s, y + v[1] * s - 0.5 * self.g * s * s, φ + v[2] * s
            v = v - np.array([0.0, self.g * s, 0.0])
            x_end, y_end = end * math.cos(φ), end * math.sin(φ) - self.r
            plate = self.a * self.rate * math.cos(self.rate * t)
            U = np.array([v[1] + x_end * v[2] - plate, v[0] - y_end * v[2]])
            P_N, P_T = impact(of_corner(self.m, self.J, x_end, y_end), U, self.mu, self.e)
            v = v + np.array([P_T / self.m, P_N / self.m, (x_end * P_N - y_end * P_T) / self.J])
            found.append((t, v, "B" if end > 0.0 else "A"))
        return found


def _times(known: Sequence[tuple[float, Array, str]]) -> list[Fact]:
    """Return the instants of the impacts of two ends as facts."""
    ends = [end for *_, end in known]
    return [
        Fact(f"t_{n + 1}", f"impact {n + 1}, of the end {end}", t, "s",
             partial(instant, kind="impact", contact=end, number=ends[: n + 1].count(end)))
        for n, (t, _, end) in enumerate(known)
    ]  # fmt: skip


@registered
def tumbling_rod(
    m: Annotated[float, "kg, mass"] = 1.0,
    L: Annotated[float, "m, length"] = 1.0,
    mu: Annotated[float, "1, coefficient of friction μ"] = 0.3,
    e: Annotated[float, "1, coefficient of restitution of both ends"] = 0.5,
    h: Annotated[float, "m, height of the middle at the start"] = 1.0,
    phi: Annotated[float, "rad, angle φ at the start"] = 0.3,
    g: Annotated[float, "m/s², gravity"] = 9.81,
) -> Problem:
    r"""A rod dropped aslant on a rough floor: each impact sets it spinning, and the other end comes down.

    Between impacts the middle falls freely and the rod turns at a constant rate, so an end at ``±L/2`` meets the floor where
    ``y + v_y s - g s²/2 ± (L/2) sin(φ + ω s) = 0``. One end at a time strikes, at a place r of the rod, with

    - ``W_NN = 1/m + r_x²/J``, ``W_TT = 1/m + r_y²/J``, ``W_NT = -r_x r_y/J``, ``J = m L²/12``,
    - a sticking impulse ``P = -W⁻¹ ((1 + e) U_N, U_T)`` if ``|P_T| <= μ P_N``, else one with ``|P_T| = μ P_N``.

    So its impacts follow one after the other from roots of one function each. The trap is the ratio of the speeds of the
    middle: it is no coefficient of restitution, and after an impact near the end of a flat rod the middle still moves down.

    Raises
    ------
    InputError
        If m, L, h or g is not above zero, mu is negative, e lies outside [0, 1], or the rod starts below the floor.

    Examples
    --------
    >>> [round(fact.value, 9) for fact in tumbling_rod().facts]
    [0.416832358, -9.155128952, 0.458709244, 0.481580011, 0.696073682]

    References
    ----------
    Glocker and Pfeiffer, Multiple impacts with friction in rigid multibody systems (1995).
    """
    name = "tumbling-rod"
    above_zero(name, m=m, L=L, h=h, g=g)
    restitution(name, e)
    not_negative(name, mu=mu)
    if not h > 0.5 * L * abs(math.sin(phi)):
        raise InputError(f"{name}: with h = {h:g} and phi = {phi:g} an end is below the floor; raise h")
    J, half = m * L * L / 12.0, 0.5 * L
    rod = TwoEnds(m, J, half, mu=mu, e=e, g=g)

    def t_end() -> float:
        return 1.01 * rod.impacts(4, h, phi)[-1][0]

    def facts() -> tuple[Fact, ...]:
        known = rod.impacts(4, h, phi)
        first = partial(limit, kind="impact", contact=known[0][2], of="v", i=2, side="right")
        what = "angular velocity after the first impact"
        spin = Fact("ω_1", what, float(known[0][1][2]), "rad/s", first, scale=math.sqrt(g / L))
        times = _times(known)
        return times[0], spin, *times[1:]

    return Problem(
        name,
        rigid_body(m, J, g, [corner("A", -half, 0.0, mu, e), corner("B", half, 0.0, mu, e)]),
        q0={"y": h, "φ": phi},
        t_end=t_end,
        units={"φ": "rad"},
        source="GlockerPfeiffer1995",
        facts=facts,
    )


@registered
def bouncing_dimer(
    m: Annotated[float, "kg, mass of each ball"] = 0.001,
    r: Annotated[float, "m, radius of the balls"] = 0.0025,
    L: Annotated[float, "m, distance of their middles"] = 0.02,
    mu: Annotated[float, "1, coefficient of friction μ"] = 0.3,
    e: Annotated[float, "1, coefficient of restitution"] = 0.6,
    a: Annotated[float, "m, amplitude of the plate"] = 4e-4,
    omega: Annotated[float, "rad/s, circular frequency ω of the plate"] = 50.0 * math.pi,
    h: Annotated[float, "m, height of the middle at the start"] = 0.012,
    phi: Annotated[float, "rad, angle φ at the start"] = 0.2,
    g: Annotated[float, "m/s², gravity"] = 9.81,
) -> Problem:
    r"""A dimer, two balls joined by a light rod, let fall aslant on a vibrating plate: one end strikes, and it drifts.

    The height of the plate is ``a sin ω t``. The dimer has the mass 2 m, ``J = 2 m ((L/2)² + (2/5) r²)``, and touches
    the plate below the middles of its balls, at ``(±(L/2) cos φ, ±(L/2) sin φ - r)`` from its own. The law of each impact is
    that of `tumbling_rod`, with the plate's velocity in U_N, so that

    - impacts are roots of ``y + v_y s - g s²/2 ± (L/2) sin(φ + φ' s) - r = a sin(ω (t + s))``,
    - the first gives the velocity ``x' = P_T/(2 m)`` along the plate, with ``|P_T| = μ P_N`` where the end slips through it,
      although both plate and dimer moved up and down only.

    This is how friction at one end makes dimers drift, steadily where the other end stays on the plate, which was seen for
    certain aspect ratios and accelerations of the plate. The numbers here are not those of that experiment. The trap is a
    ball's law with e alone, for which nothing ever moves sideways.

    Raises
    ------
    InputError
        If m, r, L, omega, h or g is not above zero, mu or a is negative, e lies outside [0, 1], or a ball is in the plate.

    Examples
    --------
    >>> [round(fact.value, 9) for fact in bouncing_dimer().facts]
    [0.118787737, -32.660477005, 0.039258632, 0.049015215, 0.104676434, 0.118458667]

    References
    ----------
    Dorbolo, Volfson, Tsimring and Kudrolli, Dynamics of a bouncing dimer (2005).
    """
    name = "bouncing-dimer"
    above_zero(name, m=m, r=r, L=L, omega=omega, h=h, g=g)
    not_negative(name, mu=mu, a=a)
    restitution(name, e)
    half = 0.5 * L
    if not h > r + half * abs(math.sin(phi)):
        raise InputError(f"{name}: with h = {h:g} and phi = {phi:g} a ball is in the plate; raise h")
    dimer = TwoEnds(2.0 * m, 2.0 * m * (half * half + 0.4 * r * r), half, mu, e, g, r, a, omega)

    def t_end() -> float:
        return 1.01 * dimer.impacts(4, h, phi)[-1][0]

    def facts() -> tuple[Fact, ...]:
        known = dimer.impacts(4, h, phi)
        _, v, end = known[0]
        after = partial(limit, kind="impact", contact=end, of="v", side="right")
        return (
            Fact("v_1", "velocity along the plate after the first", float(v[0]), "m/s", partial(after, i=0),
                 scale=math.sqrt(g * L)),
            Fact("ω_1", "angular velocity after it", float(v[2]), "rad/s", partial(after, i=2), scale=math.sqrt(g / L)),
            *_times(known),
        )  # fmt: skip

    def ball(name: str, x: float) -> FrictionContact:
        return FrictionContact(
            name,
            gap=lambda t, q: q[1] + x * np.sin(q[2]) - r - a * np.sin(omega * t),
            slip=lambda t, q, v: v[0] - (x * np.sin(q[2]) - r) * v[2],
            mu=mu,
            e=e,
        )

    return Problem(
        name,
        rigid_body(dimer.m, dimer.J, g, [ball("A", -half), ball("B", half)]),
        q0={"y": h, "φ": phi},
        t_end=t_end,
        units={"φ": "rad"},
        source="DorboloVolfsonTsimringKudrolli2005",
        facts=facts,
    )
