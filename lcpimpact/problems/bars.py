r"""Elastic and elastic-plastic bars: impact as a wave.

A bar is a continuum, the scheme its finite elements; so the closed forms here are those of the wave equation, and even an
exact run of the scheme is off by its Δx. Waves of the length of an element travel at the wrong speed, and a force that is
a rectangle in truth comes out with a ripple. ``c = sqrt(E/ρ)`` is the wave speed, ``ρ c A`` the impedance.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Annotated

import numpy as np

from lcpimpact.arrays import Array
from lcpimpact.errors import InputError
from lcpimpact.formula import sqrt
from lcpimpact.problems.base import Problem, above_zero, whole
from lcpimpact.problems.facts import Fact
from lcpimpact.problems.registered import registered
from lcpimpact.reading import Readable, at, instant
from lcpimpact.scheme.elements.bar import Bar
from lcpimpact.scheme.elements.base import GROUND
from lcpimpact.scheme.elements.bumper import Bumper
from lcpimpact.scheme.elements.dashpot import Dashpot
from lcpimpact.scheme.elements.mass import Mass
from lcpimpact.scheme.scheme import Scheme


@registered
def bar_impact(
    E: Annotated[float, "Pa, Young's modulus"] = 900.0,
    A: Annotated[float, "m², cross-section"] = 1.0,
    rho: Annotated[float, "kg/m³, density"] = 1.0,
    L: Annotated[float, "m, length"] = 10.0,
    gap: Annotated[float, "m, distance to the wall"] = 5.0,
    v0: Annotated[float, "m/s, speed"] = 10.0,
    elements: Annotated[float, "1, number of finite elements, at least 4"] = 100,
    mu: Annotated[float, "1, coupling mass μ over the mass of an element, up to 1/4"] = 0.125,
) -> Problem:
    r"""An elastic bar flies into a wall, lengthwise: contact lasts as long as a wave runs to the far end and back.

    The front end stops at ``t_c = gap/v0``. A wave of compression runs up the bar at c and stops it, returns from the free
    end as a wave of relief that turns every point round, and the bar leaves whole and without vibration:

    - contact for ``2 L/c``, at the constant force ``R = ρ c A v0``, which is a rectangle in time,
    - momentum ``∫ R dt = 2 m v0``: the bar rebounds with v0, though no coefficient of restitution is in the scheme.

    The front node carries no mass (it went to its neighbour), so the force is a function and not a train of impulses.
    With mass in that node each step of a time-stepping method is a small impact, R chatters and energy leaks; with a
    coefficient e > 0 on it, worse. What remains is the ripple of the elements; it goes down with Δx, but its greatest value
    does not (Gibbs). The trap is to judge by that value: the error is to be measured in L1.

    Raises
    ------
    InputError
        If a parameter is out of its range.

    Examples
    --------
    >>> [round(fact.value, 6) for fact in bar_impact().facts]
    [0.5, 1.166667, 200.0, -10.0, 0.0]

    References
    ----------
    Doyen, Ern and Piperno, Time-integration schemes for the finite element dynamic Signorini problem (2011).
    """
    name = "bar-impact"
    above_zero(name, gap=gap, v0=v0)
    bar, wall = _falling_bar(name, E, A, rho, L, gap, elements, mu)
    c = sqrt(E / rho)
    t_c, τ = gap / v0, 2.0 * L / c

    def facts() -> tuple[Fact, ...]:
        m = bar.rho * bar.A * bar.L
        R, P = bar.rho * c * bar.A * v0, 2.0 * m * v0
        force = partial(_bar_impact_force, R=R, t_c=t_c, τ=τ)
        coarse = 4.0 / bar.elements
        return (
            Fact("t_c", "contact begins", t_c, "s", partial(instant, kind="close")),
            Fact("t_o", "contact ends", t_c + τ, "s", partial(instant, kind="open", number=-1), coarse),
            Fact("∫R dt", "impulse", P, "N s", _impulse, coarse),
            Fact("v", "mean velocity afterwards", -v0, "m/s", partial(_mean_velocity, m=m), coarse),
            Fact(
                "ε_R", "error of R, in L1 over ∫R dt", 0.0, "", partial(_force_error, force=force, unit=P), coarse, 1.0
            ),
        )

    return Problem(
        name,
        Scheme(bar, wall),
        v0=dict.fromkeys(bar.joints, v0),
        t_end=t_c + 1.5 * τ,
        parameters={"elements": bar.elements},
        source="DoyenErnPiperno2011",
        facts=facts,
    )  # fmt: skip


def _bar_impact_force(t: Array, *, R: float, t_c: float, τ: float) -> Array:
    """Return R*, a rectangle in time."""
    return np.where((t >= t_c) & (t < t_c + τ), R, 0.0)


@registered
def bouncing_bar(
    E: Annotated[float, "Pa, Young's modulus"] = 900.0,
    A: Annotated[float, "m², cross-section"] = 1.0,
    rho: Annotated[float, "kg/m³, density"] = 1.0,
    L: Annotated[float, "m, length"] = 10.0,
    gap: Annotated[float, "m, height of fall"] = 5.0,
    g: Annotated[float, "m/s², gravity"] = 10.0,
    elements: Annotated[float, "1, number of finite elements, at least 4"] = 100,
    mu: Annotated[float, "1, coupling mass μ over the mass of an element, up to 1/4"] = 0.125,
) -> Problem:
    r"""Elastic bar dropped under gravity, which bounces, and a run that shows whether energy is kept.

    It hits the ground at ``t_1 = sqrt(2 gap/g)`` with ``v_1 = g t_1``, stays for ``τ = 2 L/c``, and all the while its waves
    feel gravity:

    - ``R = ρ c A (v_1 + g (t - t_1))`` in the first contact, with the defaults from 300 to 500 N,
    - ``∫ R dt = m (2 v_1 + g τ)``: the centre of mass leaves with v_1, and the bar vibrates in its flight of ``2 v_1/g``.

    If the flight is a whole number of τ, the period of that vibration, the second contact is the first one backwards in
    time: R falls, here from 500 to 300 N on 11/3 <= t <= 13/3; the bar is then at rest inside, rises to where it began, and
    all repeats itself with the period ``2 t_1 + 2 τ + 2 v_1/g``, here 16/3. Hence it is the test of methods for elastic
    contact: a method that loses or makes energy in the first contact spoils the second. The trap is to look at the first
    contact only, or at a bounce of the centre of mass, which hardly shows it.

    Raises
    ------
    InputError
        If a parameter is out of its range.

    Examples
    --------
    >>> [round(fact.value, 6) for fact in bouncing_bar().facts]
    [1.0, 1.666667, 3.666667, 533.333333, 0.0]

    References
    ----------
    Doyen, Ern and Piperno, Time-integration schemes for the finite element dynamic Signorini problem (2011).
    """
    name = "bouncing-bar"
    above_zero(name, gap=gap, g=g)
    bar, wall = _falling_bar(name, E, A, rho, L, gap, elements, mu)

    def two_contacts() -> tuple[float, float, float, bool]:
        """Return t_1, τ, when the second contact begins, and whether it is the first one backwards in time."""
        t_1 = math.sqrt(2.0 * gap / g)
        τ = 2.0 * bar.L / bar.wave_speed
        flight = 2.0 * (g * t_1) / g
        return t_1, τ, t_1 + τ + flight, abs(flight / τ - round(flight / τ)) < 1e-9

    def t_end() -> float:
        t_1, τ, t_2, repeats = two_contacts()
        return t_2 + τ + 0.25 * t_1 if repeats else t_1 + τ + 0.5 * min(2.0 * (g * t_1) / g, τ)

    def facts() -> tuple[Fact, ...]:
        t_1, τ, t_2, repeats = two_contacts()
        c = bar.wave_speed
        v_1 = g * t_1
        P = rho * A * L * (2.0 * v_1 + g * τ)
        force = partial(_bouncing_bar_force, A=A, c=c, g=g, repeats=repeats, rho=rho, t_1=t_1, t_2=t_2, v_1=v_1, τ=τ)
        total = P * (2.0 if repeats else 1.0)
        coarse = 4.0 / bar.elements
        ended = partial(_switch, kind="open", earliest=t_1, latest=t_1 + 1.5 * τ, which=-1)
        again = partial(_switch, kind="close", earliest=t_2 - 0.5 * τ, latest=t_end(), which=0)
        second = (Fact("t_2", "second contact begins", t_2, "s", again, coarse),) if repeats else ()
        error = partial(_force_error, force=force, unit=total)
        return (
            Fact("t_1", "first contact begins", t_1, "s", partial(instant, kind="close")),
            Fact("t_1 + τ", "first contact ends", t_1 + τ, "s", ended, coarse),
            *second,
            Fact("∫R dt", "impulse", total, "N s", _impulse, coarse),
            Fact("ε_R", "error of R, in L1 over ∫R dt", 0.0, "", error, coarse, 1.0),
        )

    return Problem(
        name,
        Scheme(bar, *bar.weight(g), wall),
        t_end=t_end,
        parameters={"elements": bar.elements},
        source="DoyenErnPiperno2011",
        facts=facts,
    )  # fmt: skip


def _bouncing_bar_force(
    t: Array, *, A: float, c: float, g: float, repeats: bool, rho: float, t_1: float, t_2: float, v_1: float, τ: float
) -> Array:
    """Return R*, a line in each contact."""
    first = (t >= t_1) & (t < t_1 + τ)
    second = (t >= t_2) & (t < t_2 + τ)
    rising, falling = v_1 + g * (t - t_1), v_1 + g * (t_2 + τ - t)
    return rho * c * A * np.where(first, rising, np.where(second & repeats, falling, 0.0))


@registered
def plastic_bar_impact(
    m: Annotated[float, "kg, mass of the body"] = 10.0,
    E: Annotated[float, "Pa, Young's modulus"] = 900.0,
    A: Annotated[float, "m², cross-section"] = 1.0,
    rho: Annotated[float, "kg/m³, density"] = 1.0,
    L: Annotated[float, "m, length of the part that is divided into elements"] = 10.0,
    sigma_y: Annotated[float, "Pa, yield stress"] = 150.0,
    v0: Annotated[float, "m/s, speed of the body, above v_y"] = 10.0,
    elements: Annotated[float, "1, number of finite elements, at least 4"] = 40,
) -> Problem:
    r"""A rigid body strikes a long elastic-plastic bar: the last of the paper's announcements.

    As long as it stays elastic the bar answers as a dashpot of its impedance, ``R = ρ c A v``. Perfect plasticity caps that
    at ``A σ_y``, which a body faster than ``v_y = σ_y/(ρ c)`` exceeds. Then an elastic wave of the stress σ_y runs ahead,
    the rest of the shortening gathers in the section that was struck, and

    - the force is ``R = A σ_y`` and the body slows down evenly, to v_y at ``t_y = m (v0 - v_y)/(A σ_y)``,
    - later ``v = v_y exp(-ρ c A (t - t_y)/m)``: elastic again,
    - the section that was struck has taken ``D = ½ m (v0 - v_y)²`` of plastic work.

    So the ledger of the energy is closed, ``½ m v0² = D + waves + body``, and D is what the body would lose in a plastic
    impact on a wall that moves off at v_y. A dashpot ρ c A at the far end swallows the waves, as if the bar went on for
    ever; a fixed end would double the stress of the wave and yield too. The trap is an expected plastic *wave*: without
    hardening it does not move, and in the elements all the plastic strain sits in the first one, however small it is. (The
    struck node keeps its mass here, and the body takes it along in an impact with e = 0: on a massless node the
    first element would have to stay elastic, and the force would ring against the yielding of the second.)

    Raises
    ------
    InputError
        If a parameter is out of its range, or the bar stays elastic.

    Examples
    --------
    >>> [round(fact.value, 6) for fact in plastic_bar_impact().facts]
    [150.0, 5.0, 0.676676, 125.0]

    References
    ----------
    Kolsky, *Stress Waves in Solids* (1963), chapter VII, on plastic waves.
    """
    name = "plastic-bar-impact"
    above_zero(name, m=m, E=E, A=A, rho=rho, L=L, sigma_y=sigma_y, v0=v0)
    elements = whole(name, "elements", elements, least=4)
    c = sqrt(E / rho)
    v_y, impedance = sigma_y / (rho * c), rho * c * A
    bar = Bar("y", "w", E, A, rho, L, elements, mass="consistent", sigma_y=sigma_y, name="bar")
    scheme = Scheme(Mass("x", m), Bumper("x", "y", e=0.0), bar, Dashpot("w", GROUND, impedance, symbols=("ρcA",)))
    if not v0 > v_y:
        raise InputError(f"{name}: v0 = {v0:g} must be above v_y = sigma_y/(rho c) = {v_y:g}, or the bar stays elastic")
    t_y = m * (v0 - v_y) / (A * sigma_y)
    t_end = t_y + 2.0 * m / impedance

    def facts() -> tuple[Fact, ...]:
        coarse = 4.0 / elements
        v_end = v_y * math.exp(-2.0)
        return (
            Fact("R", "force while it yields", A * sigma_y, "N", partial(at, series="R", t=0.5 * t_y), coarse),
            Fact("v(t_y)", "speed at the end of yielding", v_y, "m/s", partial(at, series="v_x", t=t_y), coarse),
            Fact("v(t_end)", "speed at the end", v_end, "m/s", partial(at, series="v_x", t=t_end), coarse, v_y),
            Fact(
                "D",
                "plastic work",
                0.5 * m * (v0 - v_y) ** 2,
                "J",
                partial(_plastic_work, f_y=A * sigma_y),
                2.0 * coarse,
            ),
        )

    return Problem(
        name,
        scheme,
        v0={"x": v0},
        t_end=t_end,
        parameters={"elements": elements},
        source="Kolsky1963, chapter VII, on plastic waves",
        facts=facts,
    )  # fmt: skip


def _falling_bar(
    name: str, E: float, A: float, rho: float, L: float, gap: float, elements: float, mu: float
) -> tuple[Bar, Bumper]:
    """Return a bar from x to y whose massless lower end y is a gap above the ground, and the bumper between."""
    elements = whole(name, "elements", elements, least=4)
    return Bar("x", "y", E, A, rho, L, elements, mass=mu, massless=("y",), name="bar"), Bumper("y", GROUND, gap=gap)


def _over_time(run: Readable, value: Callable[[Array, Array], Array]) -> float:
    """Return the integral of a function of t and R: the sum over the steps that R is the mean of, or by trapezia."""
    if len(run.t_reaction) < len(run.t):
        return float((value(run.t_reaction, run["R"]) * np.diff(run.t)).sum())
    f = value(run.t, run["R"])
    return float((0.5 * (f[1:] + f[:-1]) * np.diff(run.t)).sum())


def _impulse(run: Readable) -> float:
    """Return the integral of R over the run."""
    return _over_time(run, lambda t, r: r)


def _force_error(run: Readable, force: Callable[[Array], Array], unit: float) -> float:
    """Return the integral of |R - R*| over the run, in a unit, with R* of the closed form."""
    return _over_time(run, lambda t, r: np.abs(r - force(t))) / unit


def _mean_velocity(run: Readable, m: float) -> float:
    """Return the momentum at the end over the mass."""
    return float((run.problem.dynamics.M @ run.v[-1]).sum()) / m


def _switch(run: Readable, kind: str, earliest: float, latest: float, which: int) -> float:
    """Return the time of one of the events of a kind between two times; ripples may open and close a contact again."""
    found = [each.t for each in run.events if each.kind == kind and earliest < each.t < latest]
    if not found:
        raise InputError(f"the run has no event {kind!r} between {earliest:g} and {latest:g} s: run longer")
    return float(found[which])


def _plastic_work(run: Readable, f_y: float) -> float:
    """Return f_y times the path of all sliders."""
    dynamics = run.problem.dynamics
    return float(f_y * np.abs(np.diff(run.q @ dynamics.H[dynamics.of_rate].T, axis=0)).sum())
