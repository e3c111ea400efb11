r"""Blocks on their corners: rocking, landing flat, and sliding, by functions of the motion."""

from __future__ import annotations

import math
from functools import partial
from typing import Annotated

import numpy as np

from lcpimpact.arrays import Array
from lcpimpact.errors import InputError
from lcpimpact.problems.base import Problem, above_zero
from lcpimpact.problems.facts import Fact
from lcpimpact.problems.registered import registered
from lcpimpact.problems.rods import corner, rigid_body
from lcpimpact.reading import Readable, at, crossing, event, final, instant, limit, peak
from lcpimpact.scheme.lagrangian import Lagrangian


class Rocking:
    """A block that turns about one corner: its tilt θ, with ``θ'' = -p² sin(α - θ)``."""

    def __init__(self, name: str, b: float, h: float, theta: float, mu: float, g: float) -> None:
        self.alpha = math.atan2(b, h)
        if not 0.0 < theta < self.alpha:
            raise InputError(f"{name}: phi = {theta:g} must be above 0 and below the slenderness {self.alpha:g}")
        self.p = math.sqrt(0.75 * g / math.hypot(b, h))
        u = np.linspace(self.alpha - theta, self.alpha, 400)
        swing = 1.5 * (math.cos(self.alpha - theta) - np.cos(u))
        ratio = np.sin(u) * (0.75 * np.cos(u) - swing) / (1.0 - 0.75 * np.sin(u) ** 2 - swing * np.cos(u))
        if not np.abs(ratio).max() <= mu:
            raise InputError(f"{name}: with mu = {mu:g} its corner slips; mu must be at least {np.abs(ratio).max():g}")

    def fall(self, theta: float) -> float:
        """Return the time from rest at a tilt until it lands."""
        from scipy.special import ellipk, ellipkinc

        k = math.cos(0.5 * (self.alpha - theta))
        return float(ellipk(k * k) - ellipkinc(math.asin(math.cos(0.5 * self.alpha) / k), k * k)) / self.p

    def speed(self, theta: float) -> float:
        """Return the angular speed with which it lands."""
        return self.p * math.sqrt(2.0 * (math.cos(self.alpha - theta) - math.cos(self.alpha)))

    def tilt(self, speed: float) -> float:
        """Return the tilt to which it rocks with an angular speed at θ = 0."""
        return self.alpha - math.acos(math.cos(self.alpha) + 0.5 * (speed / self.p) ** 2)


def _block(m: float, b: float, h: float, mu: float, g: float) -> Lagrangian:
    """Return a block 2 b wide and 2 h high, with its lower corners A on the left and B on the right."""
    return rigid_body(m, m * (b * b + h * h) / 3.0, g, [corner("A", -b, -h, mu), corner("B", b, -h, mu)])


@registered
def rocking_block_bodies(
    m: Annotated[float, "kg, mass"] = 1.0,
    b: Annotated[float, "m, half the width"] = 0.1,
    h: Annotated[float, "m, half the height"] = 0.4,
    phi: Annotated[float, "rad, angle φ at the start, on the left corner"] = 0.1,
    mu: Annotated[float, "1, coefficient of friction μ"] = 1.0,
    g: Annotated[float, "m/s², gravity"] = 9.81,
) -> Problem:
    r"""Housner's block as a body on two rough corners: its ratio 1 - (3/2) sin² α follows from the impact law.

    With ``tan α = b/h``, ``R² = b² + h²`` and ``p² = 3 g/(4 R)`` it turns about one corner as ``θ'' = -p² sin(α - θ)``. From
    rest at θ_0, with ``k = cos((α - θ_0)/2)``,

    - it lands after ``(K(k) - F(asin(cos(α/2)/k), k))/p`` with ``ω² = 2 p² (cos(α - θ_0) - cos α)``,
    - both corners have e = 0: the one that it stood on lifts off, the other sticks, and ``ω⁺ = (1 - (3/2) sin² α) ω``,
    - it rocks to ``cos(α - θ_1) = cos α + (ω⁺/p)²/2``, and so on.

    `rocking_block` is its limit of small angles. Nowhere is it said which corner takes over; the law for both corners at
    once decides that. The trap is e > 0 for the corners, which has nothing to do with Housner's ratio.

    Raises
    ------
    InputError
        If m, b, h or g is not above zero, phi is not between 0 and α, the block is squat, or mu is so small that it slips.

    Examples
    --------
    >>> [round(fact.value, 9) for fact in rocking_block_bodies().facts]
    [0.264713416, 0.831368077, 0.75801207, -0.078909325, 0.710901009]

    References
    ----------
    Housner, The behavior of inverted pendulum structures during earthquakes (1963).
    """
    name = "rocking-block-bodies"
    above_zero(name, m=m, b=b, h=h, g=g)
    if not b * b < 2.0 * h * h:
        raise InputError(f"{name}: with b = {b:g} and h = {h:g} it lands flat and stays; see squat-block")
    rocking = Rocking(name, b, h, phi, mu, g)
    r = 1.0 - 1.5 * math.sin(rocking.alpha) ** 2
    least = h * (1.0 - r) / (b * (1.0 + r))
    if not least <= mu:
        raise InputError(f"{name}: with mu = {mu:g} it slips as it lands; mu must be at least {least:g}")

    def second() -> tuple[float, float]:
        """Return the tilt after the first impact, and the time of the second."""
        tilt = rocking.tilt(r * rocking.speed(phi))
        return tilt, rocking.fall(phi) + 2.0 * rocking.fall(tilt)

    def t_end() -> float:
        return 1.1 * second()[1]

    def facts() -> tuple[Fact, ...]:
        tilt, t_2 = second()
        ω = rocking.speed(phi)
        of = partial(limit, kind="impact", contact="B", of="v", i=2, unit=-1.0)
        return (
            Fact("t_1", "first impact", rocking.fall(phi), "s", partial(instant, kind="impact", contact="B")),
            Fact("ω_1", "angular speed before it", ω, "rad/s", partial(of, side="left")),
            Fact("ω_1⁺", "angular speed after it", r * ω, "rad/s", partial(of, side="right")),
            Fact("φ_1", "angle to which it rocks", -tilt, "rad", partial(peak, series="φ", sign=-1.0)),
            Fact("t_2", "second impact", t_2, "s", partial(crossing, series="φ")),
        )

    c, s = math.cos(phi), math.sin(phi)
    return Problem(
        name,
        _block(m, b, h, mu, g),
        q0={"x": 0.0, "y": b * s + h * c, "φ": phi},
        t_end=t_end,
        units={"φ": "rad"},
        source="Housner1963",
        facts=facts,
    )


@registered
def squat_block(
    m: Annotated[float, "kg, mass"] = 1.0,
    b: Annotated[float, "m, half the width"] = 0.4,
    h: Annotated[float, "m, half the height"] = 0.2,
    phi: Annotated[float, "rad, angle φ at the start, on the left corner"] = 0.1,
    mu: Annotated[float, "1, coefficient of friction μ"] = 1.0,
    g: Annotated[float, "m/s², gravity"] = 9.81,
) -> Problem:
    r"""A flat block, let go on one corner: it lands on both, and stays.

    It falls as `rocking_block_bodies` does. About the corner B on which it lands its angular momentum would turn it on with
    Housner's ``1 - (3/2) sin² α``, which is below zero for b > √2 h: the corner A would go through the floor. So both
    corners take impulses at once, and all motion ends:

    - together they take ``P_N = m b ω`` and ``P_T = m h ω``, which stick if ``h/b <= μ``,
    - the kinetic energy ``(2/3) m R² ω²`` is lost.

    How the impulse of friction is shared by the corners nobody can say; the motion is unique all the same. The trap is a
    code in which the corner that lands takes over.

    Raises
    ------
    InputError
        If m, b, h or g is not above zero, phi is not between 0 and α, the block is slender, or mu is so small that it slips.

    Examples
    --------
    >>> [round(fact.value, 9) for fact in squat_block().facts]
    [0.119318742, 1.692508122, 0.0, 0.0, 0.677003249]

    References
    ----------
    Housner, The behavior of inverted pendulum structures during earthquakes (1963).
    """
    name = "squat-block"
    above_zero(name, m=m, b=b, h=h, g=g)
    if not b * b > 2.0 * h * h:
        raise InputError(f"{name}: with b = {b:g} and h = {h:g} it rocks on; see rocking-block-bodies")
    if not h <= mu * b:
        raise InputError(f"{name}: with mu = {mu:g} it slips as it lands; mu must be at least {h / b:g}")
    rocking = Rocking(name, b, h, phi, mu, g)

    def t_end() -> float:
        return 1.5 * rocking.fall(phi)

    def facts() -> tuple[Fact, ...]:
        ω = rocking.speed(phi)
        of = partial(limit, kind="impact", of="v", i=2, unit=-1.0)
        return (
            Fact("t_1", "impact", rocking.fall(phi), "s", partial(instant, kind="impact", contact="B")),
            Fact("ω_1", "angular speed before it", ω, "rad/s", partial(of, contact="B", side="left")),
            Fact("ω_1⁺", "angular speed after it", 0.0, "rad/s", partial(of, contact="B", side="right"), scale=ω),
            Fact("φ", "angle at last", 0.0, "rad", partial(final, series="φ"), scale=phi),
            Fact("P_N", "normal impulse of both corners", m * b * ω, "N s", _impulses),
        )

    c, s = math.cos(phi), math.sin(phi)
    return Problem(
        name,
        _block(m, b, h, mu, g),
        q0={"x": 0.0, "y": b * s + h * c, "φ": phi},
        t_end=t_end,
        units={"φ": "rad"},
        source="Housner1963",
        facts=facts,
    )


def _impulses(run: Readable) -> float:
    """Return the normal impulse of both corners, by the momentum that the landing of B changes."""
    found = event(run, "impact", contact="B")
    return float(run.problem.dynamics.momentum(found.left.q, found.right.v - found.left.v)[1])


@registered
def block_on_corners(
    m: Annotated[float, "kg, mass"] = 1.0,
    b: Annotated[float, "m, half the width"] = 0.2,
    h: Annotated[float, "m, half the height"] = 0.3,
    mu: Annotated[float, "1, coefficient of friction μ"] = 0.4,
    v0: Annotated[float, "m/s, velocity at the start"] = 2.0,
    g: Annotated[float, "m/s², gravity"] = 9.81,
) -> Problem:
    r"""A block that slides on two corners: friction brakes it, and loads the corner in front.

    Friction ``μ m g`` on the floor has the moment ``μ m g h`` about the middle, so while it slides

    - the corners carry ``N = m g (1 ± μ h/b)/2``, the one in front more,
    - and it stops at ``t = v0/(μ g)``, ``x = v0²/(2 μ g)``.

    Where it stops the corners carry ``m g/2`` again: the normal forces jump with the friction. It tips over its front corner
    for ``μ h > b``. At rest the friction of the two corners is not unique, as any pair of equal and opposite forces may be
    added: W is singular there, and that is the trap for solvers that need a positive definite one.

    Raises
    ------
    InputError
        If a parameter is not above zero, or the block would tip over.

    Examples
    --------
    >>> [round(fact.value, 9) for fact in block_on_corners().facts]
    [0.254841998, 0.509683996, 7.848, 1.962]

    References
    ----------
    Glocker, *Set-Valued Force Laws* (2001).
    """
    name = "block-on-corners"
    above_zero(name, m=m, b=b, h=h, mu=mu, v0=v0, g=g)
    if not mu * h < b:
        raise InputError(f"{name}: with mu = {mu:g} it tips over its front corner; mu must be below b/h = {b / h:g}")
    t_s = v0 / (mu * g)

    def facts() -> tuple[Fact, ...]:
        weight, more = 0.5 * m * g, mu * h / b
        return (
            Fact("t", "its velocity is halved", 0.5 * t_s, "s",
                 partial(crossing, series="v_x", level=0.5 * v0, direction=-1.0)),
            Fact("x_s", "way until then", 0.5 * v0 * t_s, "m", partial(final, series="x")),
            Fact("N_B", "normal force in front while it slides", weight * (1.0 + more), "N",
                 partial(at, series="B", t=0.5 * t_s)),
            Fact("N_A", "normal force behind", weight * (1.0 - more), "N", partial(at, series="A", t=0.5 * t_s)),
        )  # fmt: skip

    def motion(t: Array) -> tuple[Array, Array]:
        s = np.minimum(np.asarray(t, dtype=np.float64), t_s)
        zero = np.zeros_like(s)
        q = np.column_stack([v0 * s - 0.5 * mu * g * s**2, zero + h, zero])
        return q, np.column_stack([mu * g * (t_s - s), zero, zero])

    return Problem(
        name,
        _block(m, b, h, mu, g),
        q0={"y": h},
        v0={"x": v0},
        t_end=1.5 * t_s,
        units={"φ": "rad"},
        source="Glocker2001",
        facts=facts,
        motion=motion,
    )
