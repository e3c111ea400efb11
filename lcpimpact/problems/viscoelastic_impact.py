r"""Impact of a mass on a linear viscoelastic block, without gravity.

In each problem x is the mass, positive towards the block, and touches it at t = 0 with the speed v0. Restitution is no
constant of these schemes: e = -v(end)/v0 comes out of them.
"""

from __future__ import annotations

import math
from functools import partial
from typing import Annotated

import numpy as np
from scipy.optimize import brentq, minimize_scalar
from scipy.special import rgamma

from lcpimpact.arrays import Array
from lcpimpact.errors import InputError
from lcpimpact.formula import sqrt
from lcpimpact.problems.base import Problem, above_zero
from lcpimpact.problems.facts import Fact
from lcpimpact.problems.free_vibration import angle, free_vibration
from lcpimpact.problems.registered import registered
from lcpimpact.reading import Readable, at, crossing, instant, limit, peak
from lcpimpact.scheme.elements.base import GROUND
from lcpimpact.scheme.elements.bumper import Bumper
from lcpimpact.scheme.elements.kelvin_voigt import KelvinVoigt
from lcpimpact.scheme.elements.mass import Mass
from lcpimpact.scheme.elements.maxwell import Maxwell
from lcpimpact.scheme.elements.spring_pot import SpringPot
from lcpimpact.scheme.scheme import Scheme


@registered
def kelvin_voigt_impact(
    m: Annotated[float, "kg, mass"] = 100.0,
    k: Annotated[float, "N/m, stiffness of the block"] = 3924.0,
    c: Annotated[float, "N s/m, damping of the block"] = 250.0,
    v0: Annotated[float, "m/s, speed at first touch"] = 10.0,
) -> Problem:
    r"""A mass on a Kelvin-Voigt block without tension: System No. 1 without its weight.

    In contact ``m x'' = -R`` with ``R = c x' + k x``. Three things are to be learnt from it. The force does not start from
    zero but jumps to ``R(0+) = c v0``. Contact ends where R falls to zero, which is *before* the block has regained its
    length: x > 0 still, and the plate creeps home behind the mass as ``exp(-k t/c)``. And the restitution depends on
    ``ζ = c/(2 sqrt(k m))`` alone, with ``ω = sqrt(k/m)``:

    - duration ``t_c = 2 acos ζ/(ω sqrt(1 - ζ²))``, restitution ``e = exp(-2 ζ acos ζ/sqrt(1 - ζ²))``,
    - peak force ``R_max = m ω v0 exp(-ζ ω t_m)`` at ``ω t_m = (3 acos ζ - π)/sqrt(1 - ζ²)`` if ζ < 1/2, else ``R(0+)``,
    - largest deflection ``x_max = v0/ω exp(-ζ acos ζ/sqrt(1 - ζ²))``.

    For ζ > 1 read acosh and sqrt(ζ² - 1): even an overdamped block throws the mass back. The trap is
    `kelvin_voigt_tension`, where the block is left only at x = 0.

    Raises
    ------
    InputError
        If a parameter is not above zero.

    Examples
    --------
    >>> [round(fact.value, 6) for fact in kelvin_voigt_impact().facts]
    [2500.0, 0.446353, 0.572387, 5143.325792, 1.207759]

    References
    ----------
    Schwager and Pöschel, Coefficient of restitution and linear-dashpot model revisited (2007).
    """
    name = "kelvin-voigt-impact"
    above_zero(name, v0=v0)
    scheme = Scheme(Mass("x", m), Bumper("x", "z"), KelvinVoigt("z", GROUND, k, c))
    ω: float = sqrt(k / m)
    ζ: float = c / (2.0 * sqrt(k * m))

    def contact() -> tuple[float, float]:
        """Return t_c and e of the Kelvin-Voigt block without tension."""
        return 2.0 * angle(ζ) / ω, math.exp(-2.0 * ζ * angle(ζ))

    def t_end() -> float:
        return 2.0 * contact()[0]

    def facts() -> tuple[Fact, ...]:
        t_c, e = contact()
        R_max = c * v0
        if ζ < 0.5:
            ω_t_m = (3.0 * math.acos(ζ) - math.pi) / math.sqrt((1.0 - ζ) * (1.0 + ζ))
            R_max = m * ω * v0 * math.exp(-ζ * ω_t_m)
        return (
            Fact("R(0+)", "force at first touch", c * v0, "N", partial(at, series="R", t=0.0)),
            Fact("t_c", "duration of the contact", t_c, "s", partial(instant, kind="open")),
            Fact("e", "restitution", e, "", partial(limit, kind="open", of="v", i=0, side="right", unit=-v0)),
            Fact("R_max", "greatest force", R_max, "N", partial(peak, series="R")),
            Fact("x_max", "largest deflection", v0 / ω * math.exp(-ζ * angle(ζ)), "m", partial(peak, series="x")),
        )

    def motion(t: Array) -> tuple[Array, Array]:
        t_c, e = contact()
        times = np.asarray(t, dtype=np.float64)
        S, _, dS = free_vibration(np.minimum(times, t_c), ω, ζ)
        after = times >= t_c
        free = np.maximum(times - t_c, 0.0)
        x = v0 * S - e * v0 * free
        v = np.where(after, -e * v0, v0 * dS)
        creep = np.exp(-k / c * free)
        z = v0 * S * creep
        return np.column_stack([x, z]), np.column_stack([v, np.where(after, -k / c * z, v)])

    return Problem(
        name,
        scheme,
        v0={"x": v0},
        t_end=t_end,
        source="SchwagerPoeschel2007",
        facts=facts,
        motion=motion,
    )


@registered
def kelvin_voigt_tension(
    m: Annotated[float, "kg, mass"] = 100.0,
    k: Annotated[float, "N/m, stiffness of the block"] = 3924.0,
    c: Annotated[float, "N s/m, damping of the block"] = 250.0,
    v0: Annotated[float, "m/s, speed at first touch"] = 10.0,
) -> Problem:
    r"""Mass glued to a viscoelastic block, as many particle codes compute its impact.

    ``m x'' + c x' + k x = 0``, and contact ends where x returns to zero. Then

    - ``t_c = π/(ω sqrt(1 - ζ²))`` and ``e = exp(-π ζ/sqrt(1 - ζ²))``,
    - the force that is left at the end is ``-c e v0``: the block *pulls* at the mass that it is about to release.

    The formula is quoted in textbooks as "the restitution of a linear dashpot", and that is the trap: it belongs to a scheme
    without a bumper. With one, the contact ends earlier and the rebound is faster: see `kelvin_voigt_impact`. For ζ >= 1
    the glued mass does not come back at all, and e = 0.

    Raises
    ------
    InputError
        If a parameter is not above zero.

    Examples
    --------
    >>> [round(fact.value, 6) for fact in kelvin_voigt_tension().facts]
    [0.51181, 0.527418, -1318.544048]

    References
    ----------
    Schwager and Pöschel, Coefficient of restitution and linear-dashpot model revisited (2007).
    """
    name = "kelvin-voigt-tension"
    above_zero(name, v0=v0)
    scheme = Scheme(Mass("x", m), KelvinVoigt("x", GROUND, k, c))
    ω: float = sqrt(k / m)
    ζ: float = c / (2.0 * sqrt(k * m))

    def t_end() -> float:
        return 2.0 * (math.pi / (ω * _root(ζ)) if ζ < 1.0 else 2.0 * angle(ζ) / ω)

    def facts() -> tuple[Fact, ...]:
        if ζ < 1.0:
            t_c = math.pi / (ω * _root(ζ))
            e = math.exp(-math.pi * ζ / _root(ζ))
            return (
                Fact("t_c", "time of return", t_c, "s", partial(crossing, series="x", direction=-1.0)),
                Fact("e", "speed of return over v0", e, "", partial(_rate_of_return, unit=v0), scale=1.0),
                Fact(
                    "R(t_c)",
                    "force at the return",
                    -c * e * v0,
                    "N",
                    partial(_rate_of_return, unit=-1.0 / c),
                    scale=c * v0,
                ),
            )
        return (
            Fact("x_max", "largest deflection", v0 / ω * math.exp(-ζ * angle(ζ)), "m", partial(peak, series="x")),
            Fact("e", "speed of return over v0", 0.0, "", _returns, scale=1.0),
        )

    def motion(t: Array) -> tuple[Array, Array]:
        S, _, dS = free_vibration(t, ω, ζ)
        return v0 * S[:, None], v0 * dS[:, None]

    return Problem(
        name,
        scheme,
        v0={"x": v0},
        t_end=t_end,
        source="SchwagerPoeschel2007",
        facts=facts,
        motion=motion,
    )


def _root(ζ: float) -> float:
    """Return sqrt(1 - ζ²), and 0 where the block is overdamped."""
    return math.sqrt((1.0 - ζ) * (1.0 + ζ)) if ζ < 1.0 else 0.0


def _rate_of_return(run: Readable, unit: float) -> float:
    """Return the speed at which x falls through zero, in a unit."""
    return -at(run, "v_x", crossing(run, "x", direction=-1.0)) / unit


def _returns(run: Readable) -> float:
    """Return 1 if x falls below zero, else 0."""
    return float((run["x"] < 0.0).any())


def _openings(run: Readable) -> float:
    """Return the number of ends of contact."""
    return float(sum(each.kind == "open" for each in run.events))


@registered
def maxwell_impact(
    m: Annotated[float, "kg, mass"] = 100.0,
    k: Annotated[float, "N/m, stiffness of the block"] = 3924.0,
    c: Annotated[float, "N s/m, damping of the block"] = 1000.0,
    v0: Annotated[float, "m/s, speed at first touch"] = 10.0,
) -> Problem:
    r"""A mass on a Maxwell block: a spring and a dashpot in series, which keeps a dent.

    In contact ``m x'' = -R`` with ``R'/k + R/c = x'``, so R itself vibrates: with ``a = k/(2 c)`` and
    ``ω_d = sqrt(k/m - a²)``

    - ``R = k v0/ω_d exp(-a t) sin(ω_d t)``, which starts from zero (relative degree 0),
    - duration ``t_c = π/ω_d``, restitution ``e = exp(-a π/ω_d)``,
    - permanent dent ``s = m v0 (1 + e)/c``, since the dashpot has taken up the whole momentum, c s = ∫ R dt.

    Here *more* damping constant means *less* loss: c → ∞ is the bare spring. With ``c <= sqrt(k m)/2`` the force decays
    without a zero: the mass sinks in, never leaves, and e = 0. The trap is to look for the end of contact at x = 0.

    Raises
    ------
    InputError
        If a parameter is not above zero.

    Examples
    --------
    >>> [round(fact.value, 6) for fact in maxwell_impact().facts]
    [0.528088, 0.354833, 4144.821693, 1.354833]

    References
    ----------
    Goldsmith, *Impact* (1960), on impact of viscoelastic bodies.
    """
    name = "maxwell-impact"
    above_zero(name, v0=v0)
    scheme = Scheme(Mass("x", m), Bumper("x", "z"), Maxwell("z", GROUND, k, c))
    ω: float = sqrt(k / m)
    ζ: float = sqrt(k * m) / (2.0 * c)

    def contact() -> tuple[float, float]:
        """Return t_c and e of the Maxwell block."""
        if not ζ < 1.0:
            return math.inf, 0.0
        return math.pi / (ω * _root(ζ)), math.exp(-math.pi * ζ / _root(ζ))

    def t_end() -> float:
        if ζ < 1.0:
            return 2.0 * contact()[0]
        # The slow one of the two rates has decayed to exp(-10).
        return 10.0 / (ω / (ζ + math.sqrt((ζ - 1.0) * (ζ + 1.0))))

    def facts() -> tuple[Fact, ...]:
        t_c, e = contact()
        R_max = k * v0 / ω * math.exp(-ζ * angle(ζ))
        peak_force = Fact("R_max", "greatest force", R_max, "N", partial(peak, series="R"))
        if ζ < 1.0:
            return (
                Fact("t_c", "duration of the contact", t_c, "s", partial(instant, kind="open")),
                Fact(
                    "e",
                    "restitution",
                    e,
                    "",
                    partial(limit, kind="open", of="v", i=0, side="right", unit=-v0),
                    scale=1.0,
                ),
                peak_force,
                Fact(
                    "s",
                    "permanent dent",
                    m * v0 * (1.0 + e) / c,
                    "m",
                    partial(limit, kind="open", of="q", i=2, side="right"),
                ),
            )
        _, v = motion(np.array([t_end()]))
        return (
            peak_force,
            Fact("openings", "ends of the contact", 0.0, "", _openings, scale=1.0),
            Fact(
                "v",
                "speed that is left at t_end",
                float(v[0, 0]),
                "m/s",
                partial(at, series="v_x", t=t_end()),
                scale=v0,
            ),
        )

    def motion(t: Array) -> tuple[Array, Array]:
        t_c, e = contact()
        times = np.asarray(t, dtype=np.float64)
        S, C, _ = free_vibration(np.minimum(times, t_c), ω, ζ)
        after = times >= t_c
        s = v0 * m / c * (1.0 - C)
        v = np.where(after, -e * v0, v0 * C)
        z = s + np.where(after, 0.0, v0 * S)
        x = z + (v * (times - t_c) if ζ < 1.0 else 0.0) * after
        rates = np.column_stack([v, np.where(after, 0.0, v), np.where(after, 0.0, k / c * v0 * S)])
        return np.column_stack([x, z, s]), rates

    return Problem(
        name,
        scheme,
        v0={"x": v0},
        t_end=t_end,
        source="Goldsmith1960, on impact of viscoelastic bodies",
        facts=facts,
        motion=motion,
    )


@registered
def hereditary_impact(
    m: Annotated[float, "kg, mass"] = 1.0,
    c_alpha: Annotated[float, "N s^α/m, stiffness of the spring-pot"] = 100.0,
    alpha: Annotated[float, "1, order α of the derivative, from 0.05 to 0.95"] = 0.5,
    v0: Annotated[float, "m/s, speed at first touch"] = 1.0,
    t_min: Annotated[
        float | None, "s, shortest time that the sum of exponentials resolves, by default (m/c_α)^(1/β)/100"
    ] = None,
    rtol: Annotated[float, "1, relative accuracy of that sum"] = 1e-3,
) -> Problem:
    r"""A mass on a spring-pot: a structure that remembers, as the paper announces it (an integral operator).

    In contact ``m x'' = -R`` with the hereditary force ``R(t) = ∫ G(t - s) x'(s) ds``, ``G(t) = c_α t^(-α)/Γ(1 - α)``: the
    fractional derivative ``R = c_α D^α x``, between a spring (α = 0) and a dashpot (α = 1). With Mittag-Leffler's
    ``E_{β,γ}(z) = Σ z^j/Γ(β j + γ)``, ``β = 2 - α`` and ``τ = t (c_α/m)^(1/β)``,

    - ``x' = v0 E_{β,1}(-τ^β)`` and ``R = m v0 (c_α/m)^(1/β) τ^(β-1) E_{β,β}(-τ^β)``.

    Contact ends at the first root of R. So the restitution depends on the order α alone, neither on the mass nor on the
    stiffness nor on the speed: e = 0.8208, 0.3002, 0.0279 for α = 0.1, 1/2, 0.9. The memory is a `SpringPot`, a sum of
    exponentials that is right to rtol from t_min on. The trap: the plate does not come to rest after the mass has left, but
    creeps home by a power law for ever, so a second impact would remember the first.

    Raises
    ------
    InputError
        If a parameter is not above zero, or alpha lies outside [0.05, 0.95].

    Examples
    --------
    >>> [round(fact.value, 6) for fact in hereditary_impact().facts]
    [0.137082, 0.300195, 15.64345]

    References
    ----------
    Mainardi, *Fractional Calculus and Waves in Linear Viscoelasticity* (2010), chapter 3 and appendix E.
    """
    name = "hereditary-impact"
    above_zero(name, m=m, c_alpha=c_alpha, v0=v0)
    if not 0.05 <= alpha <= 0.95:
        raise InputError(
            f"{name}: alpha = {alpha:g} must lie between 0.05 and 0.95, where its series is summed to rounding"
        )
    β = 2.0 - alpha
    T = (m / c_alpha) ** (1.0 / β)
    t_min = 1e-2 * T if t_min is None else t_min
    # The root lies between 2.9 and 5.5 for these alpha, and no other before it.
    τ_c = float(brentq(_hereditary_force, 2.0, 6.0, args=(β,), xtol=1e-15))
    t_c = τ_c * T
    scheme = Scheme(Mass("x", m), Bumper("x", "z"), SpringPot("z", GROUND, c_alpha, alpha, t_min, 2.0 * t_c, rtol))
    # The part of the memory that is over by t_min acts as a dashpot; what that neglects is of the order 2 - α.
    accuracy = rtol + (t_min / T) ** β

    def facts() -> tuple[Fact, ...]:
        t_c, e = τ_c * T, -mittag_leffler(-(τ_c**β), β, 1.0)
        top = minimize_scalar(
            lambda τ: -_hereditary_force(τ, β), bounds=(0.0, τ_c), method="bounded", options={"xatol": 1e-10}
        )
        return (
            Fact("t_c", "duration of the contact", t_c, "s", partial(instant, kind="open"), accuracy),
            Fact(
                "e",
                "restitution",
                e,
                "",
                partial(limit, kind="open", of="v", i=0, side="right", unit=-v0),
                accuracy,
                scale=1.0,
            ),
            Fact("R_max", "greatest force", -float(top.fun) * m * v0 / T, "N", partial(peak, series="R"), accuracy),
        )

    return Problem(
        name,
        scheme,
        v0={"x": v0},
        t_end=1.5 * t_c,
        parameters={"t_min": t_min},
        source="Mainardi2010",
        facts=facts,
    )


def _hereditary_force(τ: float, β: float) -> float:
    """Return R over m v0 (c_α/m)^(1/β)."""
    return float(τ ** (β - 1.0) * mittag_leffler(-(τ**β), β, β))


def mittag_leffler(z: float, β: float, γ: float) -> float:
    """Return E_{β,γ}(z) = Σ z^j/Γ(β j + γ) by its series, to rounding times E_{β,γ}(|z|): for |z|^(1/β) up to ten or so.

    Examples
    --------
    >>> round(mittag_leffler(-2.0, 1.0, 1.0), 12) == round(math.exp(-2.0), 12)
    True
    """
    j = np.arange(200)
    with np.errstate(over="ignore", invalid="ignore"):
        terms = np.float64(z) ** j * rgamma(β * j + γ)
    return math.fsum(terms[np.isfinite(terms)])
