r"""Blocks on rough surfaces: friction that is bounded by a normal force."""

from __future__ import annotations

import math
from functools import partial
from typing import Annotated

import numpy as np

from lcpimpact.arrays import Array
from lcpimpact.errors import InputError
from lcpimpact.formula import sqrt
from lcpimpact.problems.base import Problem, above_zero, not_negative, restitution
from lcpimpact.problems.facts import Fact
from lcpimpact.problems.registered import registered
from lcpimpact.reading import final, instant, interval, limit, peak
from lcpimpact.scheme.elements.base import GROUND
from lcpimpact.scheme.elements.bumper import Bumper
from lcpimpact.scheme.elements.friction import Friction
from lcpimpact.scheme.elements.load import Load
from lcpimpact.scheme.elements.mass import Mass
from lcpimpact.scheme.elements.prescribed_motion import PrescribedMotion
from lcpimpact.scheme.elements.spring import Spring
from lcpimpact.scheme.scheme import Scheme
from lcpimpact.scheme.signals import Polynomial


@registered
def block_on_incline(
    m: Annotated[float, "kg, mass"] = 1.0,
    g: Annotated[float, "m/s², gravity"] = 9.81,
    alpha: Annotated[float, "rad, angle α of the incline, below π/2"] = math.pi / 6.0,
    mu: Annotated[float, "1, coefficient of friction μ"] = 0.7,
    v0: Annotated[float, "m/s, speed at the start, down the incline"] = 2.0,
) -> Problem:
    r"""A block that slides down a rough incline: the first exercise on friction.

    x runs down the incline and y into it; the normal force is ``N = m g cos α``. The block starts down at v0, and
    ``x'' = a = g (sin α - μ cos α)`` while it slides.

    - For ``μ > tan α`` it stops at ``t = v0/|a|`` after the way ``v0²/(2 |a|)`` and stays. Friction then is what it has to
      be, ``F = m g sin α``, less than its bound ``μ N``.
    - For ``μ < tan α`` it never stops; friction keeps its bound.

    The trap is ``F = -μ N sign x'`` in a smooth integrator: at rest sign 0 = 0 lets the block go, the next step stops it,
    and it creeps down the incline for ever.

    Raises
    ------
    InputError
        If m, g, alpha or v0 is not above zero, mu is negative, or the incline is not below the vertical.

    Examples
    --------
    >>> [round(fact.value, 9) for fact in block_on_incline().facts]
    [1.91939234, 1.91939234, 4.905]

    References
    ----------
    Coulomb, Théorie des machines simples (1785).
    """
    name = "block-on-incline"
    above_zero(name, m=m, g=g, alpha=alpha, v0=v0)
    not_negative(name, mu=mu)
    if not alpha < 0.5 * math.pi:
        raise InputError(f"{name}: alpha = {alpha:g} must be below π/2, or the block does not lie on the incline")
    a = g * (math.sin(alpha) - mu * math.cos(alpha))

    def stop() -> float:
        """Return when the block stops, if it does."""
        return v0 / -a if a < 0.0 else math.inf

    def t_end() -> float:
        return 1.5 * stop() if a < 0.0 else 2.0 * v0 / g

    def facts() -> tuple[Fact, ...]:
        if a < 0.0:
            t_stop = stop()
            return (
                Fact("t_s", "when it stops", t_stop, "s", partial(instant, kind="stick")),
                Fact("s", "way until then", 0.5 * v0 * t_stop, "m", partial(final, series="x")),
                Fact("F", "friction at rest", m * g * math.sin(alpha), "N", partial(final, series="F")),
            )
        v = v0 + a * t_end()
        return (
            Fact("v", "speed at the end", v, "m/s", partial(final, series="v_x")),
            Fact("F", "friction", mu * m * g * math.cos(alpha), "N", partial(final, series="F"), scale=m * g),
        )

    def motion(t: Array) -> tuple[Array, Array]:
        t_stop = stop()
        s = np.minimum(np.asarray(t, dtype=np.float64), t_stop)
        zero = np.zeros_like(s)
        return np.column_stack([v0 * s + 0.5 * a * s**2, zero]), np.column_stack(
            [np.where(s < t_stop, v0 + a * s, 0.0), zero]
        )

    return Problem(
        name,
        Scheme(
            Mass("x", m),
            Mass("y", m),
            Load("x", m * g * math.sin(alpha), symbols=("mg sin α",)),
            Load("y", m * g * math.cos(alpha), symbols=("mg cos α",)),
            Bumper("y", GROUND, e=0.0, name="N", symbols=("N",)),
            Friction("x", GROUND, mu, normal="N"),
        ),
        v0={"x": v0},
        t_end=t_end,
        source="Coulomb1785",
        facts=facts,
        motion=motion,
    )


@registered
def block_on_belt(
    m: Annotated[float, "kg, mass"] = 1.0,
    g: Annotated[float, "m/s², gravity"] = 9.81,
    k: Annotated[float, "N/m, stiffness"] = 100.0,
    mu: Annotated[float, "1, coefficient of friction μ"] = 0.3,
    v_b: Annotated[float, "m/s, speed of the belt"] = 0.1,
) -> Problem:
    r"""A block on a moving belt, held by a spring: it slips, sticks, and slips again.

    The spring holds the block, which starts at rest with the spring relaxed, and the belt drags it along. With
    ``ω = sqrt(k/m)`` and ``x_s = μ m g/k``, where the spring balances sliding friction,

    - it slips at first, ``x = x_s (1 - cos ω t)``, until it has the belt's speed at ``t_1 = asin(v_b/(x_s ω))/ω``,
    - sticks, and goes with the belt up to x_s, at ``t_2 = t_1 + sqrt(x_s² - (v_b/ω)²)/v_b``,
    - and slips again, ``x = x_s + (v_b/ω) sin ω (t - t_2)``.

    The last is a free vibration whose greatest speed is the belt's own. So a period ``2 π/ω`` later block and belt touch in
    speed, with the friction just at its bound: whether they stick there for an instant is decided by rounding, and the run
    ends before. With one coefficient μ there is no stick-slip vibration; the sustained one of a bow or a brake needs a
    friction that is larger at rest, or falls with speed. The trap is a friction law smoothed over a range of speeds: the
    block never sticks in it, and lags behind the belt.

    Raises
    ------
    InputError
        If a parameter is not above zero, or the belt is too fast for the block ever to stick.

    Examples
    --------
    >>> [round(fact.value, 9) for fact in block_on_belt().facts]
    [0.034669289, 0.311458902, 0.03943]

    References
    ----------
    Leine and Nijmeijer, *Dynamics and Bifurcations of Non-Smooth Mechanical Systems* (2004), chapter 4.
    """
    name = "block-on-belt"
    above_zero(name, m=m, g=g, k=k, mu=mu, v_b=v_b)
    ω: float = sqrt(k / m)
    x_s = mu * m * g / k
    if not v_b < x_s * ω:
        raise InputError(
            f"{name}: v_b = {v_b:g} is too fast for the block ever to stick; it must be below {x_s * ω:g} m/s"
        )

    def sticking() -> tuple[float, float]:
        """Return t_1 and t_2."""
        t_1 = math.asin(v_b / (x_s * ω)) / ω
        return t_1, t_1 + math.sqrt(x_s**2 - (v_b / ω) ** 2) / v_b

    def t_end() -> float:
        return sticking()[1] + 1.5 * math.pi / ω

    def facts() -> tuple[Fact, ...]:
        t_1, t_2 = sticking()
        return (
            Fact("t_1", "first stick", t_1, "s", partial(instant, kind="stick")),
            Fact("t_2", "first slip", t_2, "s", partial(instant, kind="slip", number=-1)),
            Fact("x_max", "largest displacement", x_s + v_b / ω, "m", partial(peak, series="x")),
        )

    def motion(t: Array) -> tuple[Array, Array]:
        t_1, t_2 = sticking()
        times = np.asarray(t, dtype=np.float64)
        phases = [times < t_1, times < t_2]
        x = np.select(phases, [x_s * (1.0 - np.cos(ω * times)), x_s + v_b * (times - t_2)],
                      x_s + v_b / ω * np.sin(ω * (times - t_2)))  # fmt: skip
        v = np.select(phases, [x_s * ω * np.sin(ω * times), np.full_like(times, v_b)], v_b * np.cos(ω * (times - t_2)))
        return _beside_belt(times, x, v, v_b)

    return Problem(
        name,
        _belt(m, g, k, v_b, Friction("x", "b", mu, normal="N")),
        t_end=t_end,
        source="LeineNijmeijer2004, chapter 4",
        facts=facts,
        motion=motion,
    )


def _belt(m: float, g: float, k: float, v_b: float, friction: Friction) -> Scheme:
    """Return a block on a spring, pressed by its weight on a belt of the speed v_b."""
    return Scheme(
        Mass("x", m),
        Spring("x", GROUND, k),
        Mass("y", m),
        Load("y", m * g, symbols=("mg",)),
        Bumper("y", GROUND, e=0.0, name="N", symbols=("N",)),
        PrescribedMotion("b", Polynomial((0.0, v_b))),
        friction,
    )


def _beside_belt(t: Array, x: Array, v: Array, v_b: float) -> tuple[Array, Array]:
    """Return the coordinates and velocities of block and belt from the block's x and v."""
    zero = np.zeros_like(t)
    return np.column_stack([x, zero, v_b * t]), np.column_stack([v, zero, np.full_like(t, v_b)])


@registered
def stick_slip_belt(
    m: Annotated[float, "kg, mass"] = 1.0,
    g: Annotated[float, "m/s², gravity"] = 9.81,
    k: Annotated[float, "N/m, stiffness"] = 100.0,
    mu: Annotated[float, "1, kinetic coefficient of friction μ"] = 0.3,
    mu_s: Annotated[float, "1, static coefficient of friction μ_s"] = 0.5,
    v_b: Annotated[float, "m/s, speed of the belt"] = 0.2,
) -> Problem:
    r"""A block on a moving belt that holds it better than it drags it: the stick-slip of bows, brakes and squeaking doors.

    The spring holds the block, and the belt carries it along until the spring outweighs static friction. With
    ``ω = sqrt(k/m)``, ``x_s = μ m g/k``, where the spring balances kinetic friction, and ``Δ = (μ_s - μ) m g/k``, by which
    static friction lets it go beyond, the motion is periodic from its first instant on, where the block sticks at
    ``x = x_s - Δ``:

    - it sticks for ``t_st = 2 Δ/v_b``, with the belt up to ``x_s + Δ``,
    - slips for ``t_sl = (2/ω) (π - atan(ω Δ/v_b))`` by ``x = x_s + Δ cos ω τ + (v_b/ω) sin ω τ``, at whose end it has the
      belt's speed at ``x_s - Δ`` again, where static friction holds it,
    - so the period is ``T = t_st + t_sl``, longer than the free one, ``2 π/ω``, at low speed of the belt; the block moves
      within ``x_s ± sqrt(Δ² + (v_b/ω)²)``.

    What to learn: the force at rest is larger than in motion, and so energy of the belt goes into the vibration. The fall
    of friction at the start of slip is sudden: the block has to remember whether it sticks, since at the same place and
    velocity of the belt either force would be possible. The trap is one coefficient, with which a vibration lives on at
    most without sticking (see block-on-belt).

    Raises
    ------
    InputError
        If a parameter is not above zero, or mu_s is not above mu.

    Examples
    --------
    >>> [round(fact.value, 9) for fact in stick_slip_belt().facts]
    [0.1962, 0.669357062, 0.057446859]

    References
    ----------
    Leine and Nijmeijer, *Dynamics and Bifurcations of Non-Smooth Mechanical Systems* (2004), chapter 4; Popp and Stelter,
    Stick-slip vibrations and chaos (1990).
    """
    name = "stick-slip-belt"
    above_zero(name, m=m, g=g, k=k, mu=mu, mu_s=mu_s, v_b=v_b)
    if not mu_s > mu:
        raise InputError(f"{name}: mu_s = {mu_s:g} must be above mu = {mu:g}, or the vibration does not stick")
    ω: float = sqrt(k / m)
    x_s = mu * m * g / k
    Δ = (mu_s - mu) * m * g / k

    def stick_and_period() -> tuple[float, float]:
        """Return t_st and T."""
        t_stick = 2.0 * Δ / v_b
        return t_stick, t_stick + 2.0 / ω * (math.pi - math.atan(ω * Δ / v_b))

    def t_end() -> float:
        return 3.5 * stick_and_period()[1]

    def facts() -> tuple[Fact, ...]:
        t_stick, T = stick_and_period()
        return (
            Fact("t_st", "first slip, time of sticking", t_stick, "s", partial(instant, kind="slip")),
            Fact("T", "period", T, "s", partial(interval, kind="slip", first=1, last=2)),
            Fact("x_max", "largest displacement", x_s + math.hypot(Δ, v_b / ω), "m", partial(peak, series="x")),
        )

    def motion(t: Array) -> tuple[Array, Array]:
        t_stick, T = stick_and_period()
        times = np.asarray(t, dtype=np.float64)
        s = times - T * np.floor(times / T)
        τ, sticks = ω * (s - t_stick), s < t_stick
        x = np.where(sticks, x_s - Δ + v_b * s, x_s + Δ * np.cos(τ) + v_b / ω * np.sin(τ))
        v = np.where(sticks, v_b, v_b * np.cos(τ) - ω * Δ * np.sin(τ))
        return _beside_belt(times, x, v, v_b)

    return Problem(
        name,
        _belt(m, g, k, v_b, Friction("x", "b", mu, normal="N", mu_s=mu_s)),
        q0={"x": x_s - Δ},
        v0={"x": v_b},
        t_end=t_end,
        source="LeineNijmeijer2004, chapter 4",
        facts=facts,
        motion=motion,
    )


@registered
def thrown_block(
    m: Annotated[float, "kg, mass"] = 1.0,
    g: Annotated[float, "m/s², gravity"] = 9.81,
    mu: Annotated[float, "1, coefficient of friction μ"] = 0.1,
    e: Annotated[float, "1, coefficient of restitution, below 1"] = 0.5,
    v_x: Annotated[float, "m/s, velocity at the start along the floor"] = 3.0,
    v_y: Annotated[float, "m/s, velocity at the start upwards"] = 2.0,
) -> Problem:
    r"""A block thrown along a rough floor: it skips, slides, and comes to rest at a known place.

    It leaves the floor with v_x along it and v_y upwards, and does not turn. A landing at the speed w has the normal
    impulse ``(1 + e) m w``, and the impulse of friction is μ times that while the block slides. The n-th landing is at
    ``eⁿ⁻¹ v_y``; so

    - after n landings ``v_n = v_x - d (1 - eⁿ)``, with ``d = μ (1 + e) v_y/(1 - e)``, and the next flight takes
      ``2 eⁿ v_y/g``,
    - infinitely many landings end at ``t_∞ = 2 v_y/(g (1 - e))`` with ``v_∞ = v_x - d``, and the block slides until
      ``t_s = t_∞ + v_∞/(μ g)``,
    - at rest ``x = (2 v_y/g) (v_∞/(1 - e) + d/(1 - e²)) + v_∞²/(2 μ g)``.

    For ``d >= v_x`` it stops in the landing N, the first with ``v_N <= 0``, skips on the spot, and
    ``x = (2 v_y/g) (v_∞ (1 - e^N)/(1 - e) + d (1 - e^(2N))/(1 - e²))``. The trap is friction without impulses: the floor
    then brakes the block only while it lies there, and it comes too far.

    Raises
    ------
    InputError
        If a parameter is not above zero, or e is 1.

    Examples
    --------
    >>> [round(fact.value, 9) for fact in thrown_block().facts]
    [0.407747197, 2.7, 5.219164118, 3.261977574]

    References
    ----------
    Brogliato, *Nonsmooth Mechanics* (2016), chapter 4.
    """
    name = "thrown-block"
    above_zero(name, m=m, g=g, mu=mu, e=e, v_x=v_x, v_y=v_y)
    restitution(name, e)
    if e == 1.0:
        raise InputError(f"{name}: e = 1 never lets the block rest; take it below 1")

    def rest() -> float:
        """Return t_s."""
        v_inf = v_x - mu * (1.0 + e) * v_y / (1.0 - e)
        return 2.0 * v_y / (g * (1.0 - e)) + max(v_inf, 0.0) / (mu * g)

    def t_end() -> float:
        return 1.25 * rest()

    def facts() -> tuple[Fact, ...]:
        d, flight = mu * (1.0 + e) * v_y / (1.0 - e), 2.0 * v_y / g
        v_inf = v_x - d
        slides = v_inf > 0.0
        left = 0.0 if slides else e ** math.ceil(math.log1p(-v_x / d) / math.log(e) - 1e-12) if v_x < d else 0.0
        x = flight * (v_inf * (1.0 - left) / (1.0 - e) + d * (1.0 - left**2) / (1.0 - e**2))
        x += v_inf**2 / (2.0 * mu * g) if slides else 0.0
        after = max(v_x - mu * (1.0 + e) * v_y, 0.0)
        facts: tuple[Fact, ...] = (
            Fact("t_1", "first landing", flight, "s", partial(instant, kind="impact", contact="N")),
            Fact("v_1", "speed after it", after, "m/s",
                 partial(limit, kind="impact", contact="N", of="v", i=0, side="right"), scale=v_x),
            Fact("x_∞", "place at rest", x, "m", partial(final, series="x")),
        )  # fmt: skip
        if slides:
            t_s = rest()
            facts += (Fact("t_s", "when it rests", t_s, "s", partial(instant, kind="stick", number=-1)),)
        return facts

    return Problem(
        name,
        Scheme(
            Mass("x", m),
            Mass("y", m),
            Load("y", m * g, symbols=("mg",)),
            Bumper("y", GROUND, e=e, name="N", symbols=("N",)),
            Friction("x", GROUND, mu, normal="N"),
        ),
        v0={"x": v_x, "y": -v_y},
        t_end=t_end,
        source="Brogliato2016, chapter 4",
        facts=facts,
    )
