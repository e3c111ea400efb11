r"""One mass, a spring and a stop: the oscillators of nonsmooth dynamics."""

from __future__ import annotations

import math
from functools import partial
from typing import Annotated

import numpy as np

from lcpimpact.arrays import Array
from lcpimpact.errors import InputError
from lcpimpact.formula import atan2, number, sqrt, value_of
from lcpimpact.numerics.elimination import solve
from lcpimpact.problems.base import Problem, above_zero, restitution, whole
from lcpimpact.problems.facts import Fact
from lcpimpact.problems.free_vibration import free_vibration
from lcpimpact.problems.registered import registered
from lcpimpact.reading import Readable, final, first_root, instant, interval, limit, peak
from lcpimpact.scheme.elements.base import GROUND
from lcpimpact.scheme.elements.bumper import Bumper
from lcpimpact.scheme.elements.kelvin_voigt import KelvinVoigt
from lcpimpact.scheme.elements.load import Load
from lcpimpact.scheme.elements.mass import Mass
from lcpimpact.scheme.elements.spring import Spring
from lcpimpact.scheme.scheme import Scheme
from lcpimpact.scheme.signals import Harmonic


@registered
def oscillator_stop(
    m: Annotated[float, "kg, mass"] = 1.0,
    k: Annotated[float, "N/m, stiffness"] = 100.0,
    e: Annotated[float, "1, coefficient of restitution"] = 0.8,
    v0: Annotated[float, "m/s, speed at the start"] = 1.0,
) -> Problem:
    r"""An oscillator with its stop at equilibrium: periodic impacts.

    ``m x'' + k x = 0`` for x <= 0, and ``v⁺ = -e v⁻`` at x = 0. The mass leaves the stop at t = 0 with the speed v0. It
    returns after half a period whatever its speed, so with ``ω = sqrt(k/m)``

    - the n-th impact is at ``t_n = n π/ω``, and leaves the speed ``v_n = eⁿ v0``.

    Compare it with the bouncing ball: there the flights shrink with the speed and the impacts accumulate; here the speeds
    shrink alike, but the impacts go on for ever at equal intervals. The trap is a step that divides π/ω: impacts then fall
    on the grid, and the order of a method looks better than it is.

    Raises
    ------
    InputError
        If m, k or v0 is not above zero, or e lies outside [0, 1].

    Examples
    --------
    >>> [round(fact.value, 6) for fact in oscillator_stop().facts]
    [0.314159, 0.942478, 0.512, 0.1]

    References
    ----------
    Brogliato, *Nonsmooth Mechanics* (2016), chapter 7.
    """
    name = "oscillator-stop"
    above_zero(name, v0=v0)
    restitution(name, e)
    scheme = Scheme(Mass("x", m), Spring("x", GROUND, k), Bumper("x", GROUND, e=e))
    ω = sqrt(k / m)

    def facts() -> tuple[Fact, ...]:
        facts = (
            Fact("t_1", "first impact", math.pi / ω, "s", partial(instant, kind="impact")),
            Fact("t_3", "third impact", 3.0 * math.pi / ω, "s", partial(instant, kind="impact", number=3)),
            Fact(
                "v_3",
                "speed after it",
                e**3 * v0,
                "m/s",
                partial(limit, kind="impact", number=3, of="v", i=0, side="right", unit=-1.0),
                scale=v0,
            ),
            Fact("x_min", "farthest position", v0 / ω, "m", _farthest),
        )
        return facts if e > 0.0 else facts[:1] + facts[3:]

    def motion(t: Array) -> tuple[Array, Array]:
        times = np.asarray(t, dtype=np.float64)
        n = np.floor(times * ω / math.pi)
        s, speed = ω * times - n * math.pi, v0 * e**n
        return -(speed / ω * np.sin(s))[:, None], -(speed * np.cos(s))[:, None]

    return Problem(
        name,
        scheme,
        v0={"x": -v0},
        t_end=10.5 * math.pi / ω,
        source="Brogliato2016, chapter 7",
        facts=facts,
        motion=motion,
    )


def _farthest(run: Readable) -> float:
    """Return the greatest distance of x from zero to the side without a stop."""
    return -peak(run, "x", -1.0)


@registered
def bilinear_oscillator(
    m: Annotated[float, "kg, mass"] = 1.0,
    k: Annotated[float, "N/m, stiffness of the spring that always acts"] = 100.0,
    k_1: Annotated[float, "N/m, stiffness of the one-sided spring"] = 800.0,
    v0: Annotated[float, "m/s, speed at x = 0"] = 1.0,
) -> Problem:
    r"""A spring on both sides and another on one side only: a non-linear oscillator whose period knows no amplitude.

    ``m x'' + k x = -R`` with ``R = k_1 x`` where x > 0 and R = 0 elsewhere: the second spring stands behind a massless
    plate (relative degree 0), so force and acceleration are continuous. The mass passes x = 0 at t = 0 with v0. Each half
    of the motion is a half sine of its own frequency, ``ω_1 = sqrt(k/m)`` and ``ω_2 = sqrt((k + k_1)/m)``:

    - the period is ``T = π/ω_1 + π/ω_2``, of which contact takes ``π/ω_2``,
    - the mass goes from ``-v0/ω_1`` to ``v0/ω_2``, and the force reaches ``k_1 v0/ω_2``.

    It is the simplest model of a cracked beam or a one-sided support. The trap is the mean stiffness: k + k_1/2 gives a
    wrong period. As k_1 grows it turns into `oscillator_stop` with e = 1.

    Raises
    ------
    InputError
        If a parameter is not above zero.

    Examples
    --------
    >>> [round(fact.value, 6) for fact in bilinear_oscillator().facts]
    [0.418879, 0.10472, 0.033333, -0.1, 26.666667]

    References
    ----------
    Shaw and Holmes, A periodically forced piecewise linear oscillator (1983).
    """
    name = "bilinear-oscillator"
    above_zero(name, v0=v0)
    scheme = Scheme(Mass("x", m), Spring("x", GROUND, k), Bumper("x", "z"), Spring("z", GROUND, k_1, symbols=("k_1",)))
    ω_1, ω_2 = sqrt(k / m), sqrt((k + k_1) / m)
    half = math.pi / ω_2
    T = math.pi / ω_1 + half

    def facts() -> tuple[Fact, ...]:
        return (
            Fact("T", "period", T, "s", partial(interval, kind="open", first=1, last=2)),
            Fact("π/ω_2", "time in contact", half, "s", partial(instant, kind="open")),
            Fact("x_max", "farthest position against both springs", v0 / ω_2, "m", partial(peak, series="x")),
            Fact("x_min", "farthest position against one", -v0 / ω_1, "m", partial(peak, series="x", sign=-1.0)),
            Fact("R_max", "greatest force", k_1 * v0 / ω_2, "N", partial(peak, series="R")),
        )

    def motion(t: Array) -> tuple[Array, Array]:
        s = np.mod(np.asarray(t, dtype=np.float64), T)
        pressed = s < half
        x = np.where(pressed, v0 / ω_2 * np.sin(ω_2 * s), -v0 / ω_1 * np.sin(ω_1 * (s - half)))
        v = np.where(pressed, v0 * np.cos(ω_2 * s), -v0 * np.cos(ω_1 * (s - half)))
        return np.column_stack([x, np.where(pressed, x, 0.0)]), np.column_stack([v, np.where(pressed, v, 0.0)])

    return Problem(
        name,
        scheme,
        v0={"x": v0},
        t_end=3.25 * T,
        source="ShawHolmes1983",
        facts=facts,
        motion=motion,
    )


@registered
def impact_oscillator(
    zeta: Annotated[float, "1, damping ratio ζ"] = 0.05,
    omega: Annotated[float, "1, circular frequency ω of the force over the oscillator's own"] = 2.6,
    f: Annotated[float, "1, amplitude of the force over the stiffness"] = 1.0,
    s: Annotated[float, "1, position of the stop"] = 0.0,
    e: Annotated[float, "1, coefficient of restitution"] = 0.8,
    n: Annotated[float, "1, periods of the force from impact to impact"] = 1,
) -> Problem:
    r"""A forced oscillator that strikes a stop once in n periods of the force.

    ``x'' + 2 ζ x' + x = f cos(ω t + φ)`` for x <= s, and ``v⁺ = -e v⁻`` at x = s. The run starts right after an impact of
    the periodic orbit, whose phase φ and impact speed v⁻ follow from four linear equations and one circle. With the forced
    motion ``x_p``, ``x_p(0) = p``, ``x_p'(0) = d`` and the free one over ``T = 2 π n/ω``,

    - ``C s_h + S d_h = s_h`` and ``-S s_h + S' d_h = v⁻ - d``, where ``s_h = s - p`` and ``d_h = -e v⁻ - d``,
    - ``p² + (d/ω)² = f²/((1 - ω²)² + (2 ζ ω)²)``: a quadratic equation in v⁻.

    Orbits are born in pairs; the faster one, which may be stable, is chosen. At ω = 2.6 the oscillator without a stop
    would follow the force with amplitude 0.17; with the stop it is one of many motions, periodic or chaotic. Raised from
    small f, the first touch is at ``f* = |s| sqrt((1 - ω²)² + (2 ζ ω)²)``, and there the map from impact to impact has an
    infinite slope (a square root). That is the trap: no analysis of stability, and no continuation in a parameter, passes
    a grazing.

    Raises
    ------
    InputError
        If a parameter is out of its range, or no such orbit exists.

    Examples
    --------
    >>> [round(fact.value, 12) for fact in impact_oscillator().facts]
    [0.500672492549, 2.416609733531]

    References
    ----------
    Shaw and Holmes, A periodically forced piecewise linear oscillator (1983).
    """
    name = "impact-oscillator"
    above_zero(name, zeta=zeta, omega=omega, f=f)
    restitution(name, e)
    n = whole(name, "n", n)
    ζ, ω = zeta, omega
    T = 2.0 * math.pi * n / ω
    stiff, loss = 1.0 - ω * ω, 2.0 * ζ * ω
    G = f / sqrt(stiff * stiff + loss * loss)
    S, C, dS = free_vibration(T, 1.0, ζ)

    # s_h = α v and d = β v, from the two linear equations; then (s - α v)² + (β v/ω)² = G², with the larger root v.
    α, β = solve(np.array([[C - 1.0, -S], [-S, 1.0 - dS]]), np.array([e * S, 1.0 + e * dS]))
    square = α * α + (β / ω) * (β / ω)
    rest = α * s * α * s - square * (s * s - G * G)
    v = number((α * s + sqrt(rest)) / square) if rest >= 0.0 else -1.0
    p, d = s - α * v, β * v
    φ_p = atan2(-d / ω, p)

    orbit = partial(
        _impact_oscillator_orbit, G=value_of(G), d=value_of(d), e=value_of(e), v=value_of(v), α=value_of(α),
        ζ=value_of(ζ), φ_p=value_of(φ_p), ω=value_of(ω),
    )  # fmt: skip
    period = value_of(T)

    if v <= 0.0 or orbit(np.linspace(0.0, period, 64 * n + 1)[1:-1])[0].max() > value_of(s):
        raise InputError(
            f"{name}: no orbit strikes the stop s = {s:g} just once in n = {n} periods of the force; "
            "change f, omega or n, or bring the stop nearer"
        )

    phase = φ_p + atan2(loss, stiff)
    scheme = Scheme(
        Mass("x", 1.0),
        KelvinVoigt("x", GROUND, 1.0, 2.0 * ζ, symbols=("1", "2ζ")),
        Load("x", Harmonic(f, ω, phase), symbols=("f cos ωt",)),
        Bumper("x", GROUND, gap=s, e=e),
    )

    def facts() -> tuple[Fact, ...]:
        return (
            Fact(
                "v⁻", "speed of every impact", v, "", partial(limit, kind="impact", number=3, of="v", i=0, side="left")
            ),
            Fact("T", "from impact to impact", T, "", partial(interval, kind="impact", first=2, last=3)),
        )

    def motion(t: Array) -> tuple[Array, Array]:
        x, rate = orbit(np.mod(np.asarray(t, dtype=np.float64), period))
        return x[:, None], rate[:, None]

    return Problem(
        name,
        scheme,
        q0={"x": s},
        v0={"x": -e * v},
        t_end=5.5 * T,
        parameters={"zeta": ζ, "omega": ω, "n": n},
        units={"x": ""},
        source="ShawHolmes1983",
        facts=facts,
        motion=motion,
    )


def _impact_oscillator_orbit(
    τ: Array, *, G: float, d: float, e: float, v: float, α: float, ζ: float, φ_p: float, ω: float
) -> tuple[Array, Array]:
    S, C, dS = free_vibration(τ, 1.0, ζ)
    s_h, d_h = α * v, -e * v - d
    x = G * np.cos(ω * τ + φ_p) + C * s_h + S * d_h
    return x, -G * ω * np.sin(ω * τ + φ_p) - S * s_h + dS * d_h


@registered
def shaw_holmes(
    zeta: Annotated[float, "1, damping ratio ζ"] = 0.05,
    omega: Annotated[float, "1, circular frequency ω of the force over the oscillator's own"] = 2.6,
    f: Annotated[float, "1, amplitude of the force over the stiffness"] = 1.0,
    s: Annotated[float, "1, position of the stop"] = 0.0,
    e: Annotated[float, "1, coefficient of restitution"] = 0.8,
    x0: Annotated[float, "1, position at the start, x0 <= s"] = -0.3,
    v0: Annotated[float, "1, velocity at the start"] = 0.0,
) -> Problem:
    r"""The forced oscillator with a stop, from any state: periodic, chaotic, or clear of the stop.

    ``x'' + 2 ζ x' + x = f cos ω t`` for x <= s, and ``v⁺ = -e v⁻`` at x = s. It is `impact_oscillator` without the promise
    that it starts on an orbit, or that there is one; for diagrams, basins and shooting. Up to the first impact the motion is
    that of the oscillator without its stop, ``x = x_p + C (x0 - p) + S (v0 - d)``, with the forced motion

    - ``x_p = G cos(ω t - ψ)``, with ``G = f/sqrt((1 - ω²)² + (2 ζ ω)²)`` and ``tan ψ = 2 ζ ω/(1 - ω²)``,
      ``p = x_p(0)``, ``d = x_p'(0)``.

    For s > 0 the forced motion stays clear of the stop while ``f < f* = s sqrt((1 - ω²)² + (2 ζ ω)²)``. There it grazes: the
    derivative of the map of one period is infinite on the side of the impacts, and an attracting orbit may be replaced at
    once by chaos. The trap is a large step near it: whether a slow contact is detected decides the rest of the motion.

    Raises
    ------
    InputError
        If a parameter is out of its range, or it starts beyond the stop.

    Examples
    --------
    >>> [round(fact.value, 6) for fact in shaw_holmes().facts]
    [0.826689, 0.443012]

    References
    ----------
    Shaw and Holmes, A periodically forced piecewise linear oscillator (1983).
    """
    name = "shaw-holmes"
    above_zero(name, zeta=zeta, omega=omega, f=f)
    restitution(name, e)
    if x0 > s:
        raise InputError(f"{name}: x0 = {x0:g} must not lie beyond the stop s = {s:g}")
    ζ = zeta
    ω = omega
    t_end = 8.0 * math.pi / ω
    scheme = Scheme(
        Mass("x", 1.0),
        KelvinVoigt("x", GROUND, 1.0, 2.0 * ζ, symbols=("1", "2ζ")),
        Load("x", Harmonic(f, ω), symbols=("f cos ωt",)),
        Bumper("x", GROUND, gap=s, e=e),
    )

    def facts() -> tuple[Fact, ...]:
        G = f / math.hypot(1.0 - ω**2, 2.0 * ζ * ω)
        ψ = math.atan2(2.0 * ζ * ω, 1.0 - ω**2)
        p, d = G * math.cos(ψ), G * ω * math.sin(ψ)

        def free(t: Array | float) -> tuple[Array, Array]:
            S, C, dS = free_vibration(t, 1.0, ζ)
            x = G * np.cos(ω * np.asarray(t) - ψ) + C * (x0 - p) + S * (v0 - d)
            return x, -G * ω * np.sin(ω * np.asarray(t) - ψ) - S * (x0 - p) + dS * (v0 - d)

        t_1 = first_root(lambda t: s - free(t)[0], t_end, 2.0 * math.pi / max(ω, 1.0))
        if t_1 is None:
            end = float(free(t_end)[0])
            return (
                Fact("x(T)", "position at the end, clear of the stop", end, "m", partial(final, series="x"), scale=G),
            )
        if t_1 > 0.0 or v0 > 0.0:
            return (
                Fact("t_1", "first impact", t_1, "", partial(instant, kind="impact"), scale=1.0),
                Fact(
                    "v_1",
                    "its speed",
                    float(free(t_1)[1]),
                    "",
                    partial(limit, kind="impact", of="v", i=0, side="left"),
                    scale=G,
                ),
            )
        return ()

    return Problem(
        name,
        scheme,
        q0={"x": x0},
        v0={"x": v0},
        t_end=t_end,
        units={"x": ""},
        source="ShawHolmes1983",
        facts=facts,
    )
