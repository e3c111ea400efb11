r"""A ball on a vibrating table: from regular motion to chaos."""

from __future__ import annotations

import math
from functools import partial
from typing import Annotated

import numpy as np

from lcpimpact.arrays import Array
from lcpimpact.errors import InputError
from lcpimpact.problems.base import Problem, above_zero, restitution, whole
from lcpimpact.problems.facts import Fact
from lcpimpact.problems.registered import registered
from lcpimpact.reading import Readable, event, first_root, instant, interval, limit
from lcpimpact.scheme.elements.base import GROUND
from lcpimpact.scheme.elements.bumper import Bumper
from lcpimpact.scheme.elements.load import Load
from lcpimpact.scheme.elements.mass import Mass
from lcpimpact.scheme.elements.prescribed_motion import PrescribedMotion
from lcpimpact.scheme.scheme import Scheme
from lcpimpact.scheme.signals import Harmonic


@registered
def vibrating_table(
    m: Annotated[float, "kg, mass of the ball"] = 1.0,
    g: Annotated[float, "m/s², gravity"] = 9.81,
    e: Annotated[float, "1, coefficient of restitution"] = 0.5,
    A: Annotated[float, "m, amplitude of the table"] = 0.003,
    omega: Annotated[float, "rad/s, circular frequency ω of the table"] = 20.0 * math.pi,
    n: Annotated[float, "1, periods of the table from impact to impact"] = 1,
) -> Problem:
    r"""A ball that the table throws once in n of its periods.

    The table moves by ``y(t)`` with amplitude A and frequency ω, whatever strikes it; the ball flies freely between impacts
    ``U⁺ = -e U⁻``. A flight of length ``T = 2 π n/ω`` that ends where it began takes off and lands with ``g T/2``, so in
    the periodic motion

    - the table rises at each impact with ``w = (g T/2)(1 - e)/(1 + e)``, what it needs to make up for the loss,
    - the ball lands on it with the relative speed ``g T/(1 + e)``, and the impulse ``m g T`` carries its mean weight.

    That exists if the table is fast enough, ``A ω >= w``, or ``A ω²/g >= n π (1 - e)/(1 + e)``. Two phases of the table have
    the speed w; the run starts right after an impact in the later one, where the table slows down: a ball that comes late is
    thrown less, and is early next time. The motion is stable up to
    ``(A ω²/g)² = (n π (1 - e)/(1 + e))² + (2 (1 + e²)/(1 + e)²)²``; there the period doubles, and soon all is chaos. The
    trap is that past this point no run can be checked by its end: compare events, or statistics.

    Raises
    ------
    InputError
        If a parameter is out of its range, or the table is too slow for the orbit or strikes the ball in its flight.

    Examples
    --------
    >>> [round(fact.value, 6) for fact in vibrating_table().facts]
    [0.1, 0.1635, 0.654, 0.981]

    References
    ----------
    Holmes, The dynamics of repeated impacts with a sinusoidally vibrating table (1982).
    """
    name = "vibrating-table"
    above_zero(name, g=g, A=A, omega=omega)
    restitution(name, e)
    n = whole(name, "n", n)
    ω = omega
    T = 2.0 * math.pi * n / ω
    take_off = 0.5 * g * T
    w = take_off * (1.0 - e) / (1.0 + e)
    if A * ω < w:
        raise InputError(
            f"{name}: the table is too slow to throw the ball once in n = {n} periods: A omega²/g = {A * ω**2 / g:g} "
            f"must be at least {n * math.pi * (1.0 - e) / (1.0 + e):g}"
        )
    # Downwards y' = -A ω sin(ω t + φ), and y'(0) = -w in the half of the swing where the table slows down.
    table = Harmonic(A, ω, math.pi - math.asin(w / (A * ω)))

    def motion(t: Array) -> tuple[Array, Array]:
        times = np.asarray(t, dtype=np.float64)
        s = np.mod(times, T)
        x = table(0.0) - take_off * s + 0.5 * g * s**2
        phase = ω * times + table.phase
        q = np.column_stack([x, A * np.cos(phase)])
        return q, np.column_stack([g * s - take_off, -A * ω * np.sin(phase)])

    flight, _ = motion(np.linspace(0.0, T, 64 * n + 1)[1:-1])
    if (flight[:, 0] > flight[:, 1]).any():
        raise InputError(
            f"{name}: with A = {A:g} and e = {e:g} the table strikes the ball in its flight; change A or e"
        )
    scheme = Scheme(
        Mass("x", m), Load("x", m * g, symbols=("mg",)), Bumper("x", "y", e=e), PrescribedMotion("y", table)
    )

    def facts() -> tuple[Fact, ...]:
        return (
            Fact("T", "from impact to impact", T, "s", partial(interval, kind="impact", first=2, last=3)),
            Fact(
                "w",
                "speed of the table",
                w,
                "m/s",
                partial(limit, kind="impact", number=3, of="v", i=1, side="left", unit=-1.0),
                scale=take_off,
            ),
            Fact("U", "speed of impact", take_off + w, "m/s", partial(_approach, number=3)),
            Fact("P", "impulse", m * g * T, "N s", partial(_impulse, number=3)),
        )

    return Problem(
        name,
        scheme,
        q0={"x": table(0.0)},
        v0={"x": -take_off},
        t_end=5.5 * T,
        parameters={"omega": ω, "n": n},
        source="Holmes1982",
        facts=facts,
        motion=motion,
    )


@registered
def thrown_ball(
    m: Annotated[float, "kg, mass of the ball"] = 1.0,
    g: Annotated[float, "m/s², gravity"] = 9.81,
    e: Annotated[float, "1, coefficient of restitution"] = 0.5,
    A: Annotated[float, "m, amplitude of the table"] = 0.003,
    omega: Annotated[float, "rad/s, circular frequency ω of the table"] = 20.0 * math.pi,
    h: Annotated[float, "m, height of the start above the middle of the table's swing"] = 0.01,
    v0: Annotated[float, "m/s, speed at the start, downwards"] = 0.0,
) -> Problem:
    r"""A ball let fall on a vibrating table, from any height: rest, regular motion, doubled periods, chaos.

    The table moves by ``y = A cos ω t`` (downwards), whatever strikes it; the ball starts at the height h above the middle
    of the swing. It is `vibrating_table` without the promise of a periodic motion; for diagrams and basins. With
    ``Γ = A ω²/g``,

    - up to Γ = 1 a ball at rest on the table stays there; above, the table throws it off in every period,
    - it lands first where ``A cos ω t = -h + v0 t + g t²/2``, with the relative speed ``U = v0 + g t + A ω sin ω t``,
    - a motion that lands once in n periods is born at ``Γ = n π (1 - e)/(1 + e)``, and doubles its period at
      ``Γ² = (n π (1 - e)/(1 + e))² + (2 (1 + e²)/(1 + e)²)²``.

    Several motions may attract at the same Γ: which one is met depends on h. The trap is a ball that comes to rest within a
    period: infinitely many impacts accumulate before each throw, and a method must get through them to find it.

    Raises
    ------
    InputError
        If a parameter is out of its range, or the ball starts below the table.

    Examples
    --------
    >>> [round(fact.value, 6) for fact in thrown_ball().facts]
    [0.039453, 0.503004]

    References
    ----------
    Holmes, The dynamics of repeated impacts with a sinusoidally vibrating table (1982).
    """
    name = "thrown-ball"
    above_zero(name, g=g, A=A, omega=omega)
    restitution(name, e)
    ω = omega
    if -h > A:
        raise InputError(f"{name}: h = {h:g} is below the table, which starts at {-A:g}: raise h")
    scheme = Scheme(
        Mass("x", m), Load("x", m * g, symbols=("mg",)), Bumper("x", "y", e=e), PrescribedMotion("y", Harmonic(A, ω))
    )

    def first_landing() -> float | None:
        def gap(t: Array) -> Array:
            return np.asarray(A * np.cos(ω * t) + h - v0 * t - 0.5 * g * t**2)

        # By then the ball has fallen below the lowest position of the table.
        latest = (-v0 + math.sqrt(v0**2 + 2.0 * g * (h + A))) / g
        return first_root(gap, latest * (1.0 + 1e-9), 2.0 * math.pi / ω)

    def t_end() -> float:
        return max(1.5 * (first_landing() or 0.0), 5.5 * 2.0 * math.pi / ω)

    def facts() -> tuple[Fact, ...]:
        t_1 = first_landing()
        if t_1 is None or not (t_1 > 0.0 or v0 > 0.0):
            return ()
        U = v0 + g * t_1 + A * ω * math.sin(ω * t_1)
        return (
            Fact("t_1", "first landing", t_1, "s", partial(instant, kind="impact"), scale=1.0 / ω),
            Fact("U_1", "its speed", U, "m/s", partial(_approach, number=1), scale=A * ω),
        )

    return Problem(
        name,
        scheme,
        q0={"x": -h},
        v0={"x": v0},
        t_end=t_end,
        source="Holmes1982",
        facts=facts,
    )


def _approach(run: Readable, number: int) -> float:
    """Return the speed of ball against table just before an impact, by its number."""
    return float(-np.diff(event(run, "impact", number).left.v)[0])


def _impulse(run: Readable, number: int) -> float:
    """Return the impulse of an impact, by its number."""
    return float(event(run, "impact", number).impulse)


@registered
def plastic_ball(
    m: Annotated[float, "kg, mass of the ball"] = 1.0,
    g: Annotated[float, "m/s², gravity"] = 9.81,
    A: Annotated[float, "m, amplitude of the table"] = 0.004,
    omega: Annotated[float, "rad/s, circular frequency ω of the table"] = 20.0 * math.pi,
) -> Problem:
    r"""A ball that does not rebound, on a shaken table: thrown off, landing, and at rest until the next throw.

    The table moves by ``y = A cos ω t`` (downwards) and carries the ball, e = 0. The coordinate z is that of the ball
    relative to the table, where the shaking is a load: ``m z'' = m g + m A ω² cos ω t - R``. The table can push and not
    pull, so the ball leaves it where ``y'' = g``. With ``Γ = A ω²/g > 1`` and the phase θ = ω t,

    - it is thrown at ``cos θ_1 = -1/Γ``,
    - and lands at the first θ_2 > θ_1 with ``Γ (cos θ - cos θ_1 + sin θ_1 (θ - θ_1)) = (θ - θ_1)²/2``, with the relative
      speed ``U = (g/ω) (θ_2 - θ_1 - Γ (sin θ_1 - sin θ_2))``.

    Nothing is left of U. Where the table can hold the ball at θ_2, ``-Γ cos θ_2 <= 1``, the ball waits for the next phase
    θ_1, and all that was before is forgotten: the motion repeats itself after the whole number of periods that covers
    ``θ_2 - θ_1``. Otherwise it is thrown again at once; that happens first from ``Γ = sqrt(1 + π²)`` on, where the flight
    lasts a whole period and θ_2 passes θ_1. The trap is the throw itself: the gap opens with the third power of time, so a
    tolerance of 1e-6 m in it is an error of milliseconds in t_1.

    Raises
    ------
    InputError
        If a parameter is not above zero, or the table does not throw the ball, ``A omega² <= g``.

    Examples
    --------
    >>> [round(fact.value, 9) for fact in plastic_ball().facts]
    [0.035668245, 0.097118781, 0.360631308, 0.135668245]

    References
    ----------
    Mehta and Luck, Novel temporal behavior of a nonlinear dynamical system: the completely inelastic bouncing ball (1990).
    """
    name = "plastic-ball"
    above_zero(name, m=m, g=g, A=A, omega=omega)
    Γ = A * omega**2 / g
    if not Γ > 1.0:
        raise InputError(f"{name}: the table does not throw the ball: A omega²/g = {Γ:g} must be above 1")
    θ_1 = math.acos(-1.0 / Γ)

    def gap(s: Array) -> Array:
        return np.asarray(Γ * (np.cos(θ_1 + s) - math.cos(θ_1) + math.sin(θ_1) * s) - 0.5 * s**2)

    # By then the ball has fallen below the lowest position of the table.
    flight = first_root(gap, Γ + math.sqrt(Γ**2 + 4.0 * Γ) + 0.1, 2.0 * math.pi)
    assert flight is not None
    θ_2 = θ_1 + flight
    periods = math.ceil(flight / (2.0 * math.pi))
    waits = -Γ * math.cos(θ_2) <= 1.0
    motion = None
    if waits:
        motion = partial(_plastic_ball_motion, A=A, g=g, flight=flight, omega=omega, periods=periods, θ_1=θ_1)

    def facts() -> tuple[Fact, ...]:
        """Return the facts of the first throw, and of the next if it follows after a whole number of periods."""
        θ_2 = θ_1 + flight
        U = g / omega * (flight - Γ * (math.sin(θ_1) - math.sin(θ_2)))
        facts: tuple[Fact, ...] = (
            Fact("t_1", "the throw", θ_1 / omega, "s", partial(instant, kind="open")),
            Fact("t_2", "landing", θ_2 / omega, "s", partial(instant, kind="impact")),
            Fact("U", "its speed", U, "m/s", partial(limit, kind="impact", of="v", i=0, side="left")),
        )
        if waits:
            t_3 = θ_1 / omega + 2.0 * math.pi * periods / omega
            facts += (Fact("t_3", "the next throw", t_3, "s", partial(instant, kind="open", number=2)),)
        return facts

    return Problem(
        name,
        Scheme(
            Mass("z", m),
            Load("z", m * g, symbols=("mg",)),
            Load("z", Harmonic(m * A * omega**2, omega), symbols=("mAω² cos ωt",)),
            Bumper("z", GROUND, e=0.0),
        ),
        t_end=(θ_2 + 4.5 * math.pi * periods) / omega,
        source="MehtaLuck1990",
        facts=facts,
        motion=motion,
    )


def _plastic_ball_motion(
    t: Array, *, A: float, g: float, flight: float, omega: float, periods: int, θ_1: float
) -> tuple[Array, Array]:
    θ = omega * np.asarray(t, dtype=np.float64)
    s = np.mod(θ - θ_1, 2.0 * math.pi * periods)
    flies, τ = (θ >= θ_1) & (s < flight), s / omega
    z = A * (math.cos(θ_1) - np.cos(θ_1 + s)) - A * omega * math.sin(θ_1) * τ + 0.5 * g * τ**2
    v = A * omega * (np.sin(θ_1 + s) - math.sin(θ_1)) + g * τ
    return np.where(flies, z, 0.0)[:, None], np.where(flies, v, 0.0)[:, None]
