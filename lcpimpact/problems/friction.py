r"""Dry friction: bounded forces and permanent displacements."""

from __future__ import annotations

import math
from functools import partial
from typing import Annotated

import numpy as np

from lcpimpact.arrays import Array
from lcpimpact.errors import InputError
from lcpimpact.formula import sqrt
from lcpimpact.problems.base import Problem, above_zero
from lcpimpact.problems.facts import Fact
from lcpimpact.problems.registered import registered
from lcpimpact.reading import Readable, at, final, instant, interval, peak
from lcpimpact.record import State
from lcpimpact.scheme.elements.base import GROUND
from lcpimpact.scheme.elements.jenkins import Jenkins
from lcpimpact.scheme.elements.load import Load
from lcpimpact.scheme.elements.mass import Mass
from lcpimpact.scheme.elements.prescribed_motion import PrescribedMotion
from lcpimpact.scheme.elements.slider import Slider
from lcpimpact.scheme.elements.spring import Spring
from lcpimpact.scheme.scheme import Scheme
from lcpimpact.scheme.signals import Harmonic


@registered
def coulomb_oscillator(
    m: Annotated[float, "kg, mass"] = 1.0,
    k: Annotated[float, "N/m, stiffness"] = 100.0,
    F: Annotated[float, "N, friction"] = 5.0,
    x0: Annotated[float, "m, initial position"] = 0.53,
) -> Problem:
    r"""A mass on a spring and a rough table: it loses the same length in every half swing, and stops off centre.

    ``m x'' + k x = -F sign x'``, let go at x0. While it slides one way the friction is a constant force, which only shifts
    the centre of the vibration by F/k. So with ``ω = sqrt(k/m)``

    - it turns at ``x_n = (-1)ⁿ (x0 - 2 n F/k)`` every half period ``π/ω``, the same as without friction,
    - and stops for good at the first n with ``|x_n| <= F/k``, where the spring can no longer overcome the friction.

    Amplitudes fall along a straight line (viscous damping makes an exponential of it), motion ends in finite time, and
    any position in |x| <= F/k is an equilibrium: equilibria form a set. The trap is ``sign x'`` in a smooth integrator:
    it chatters about x' = 0 for ever, or with sign 0 = 0 lets the stopped mass creep back to the centre.

    Raises
    ------
    InputError
        If a parameter is not above zero.

    Examples
    --------
    >>> [round(fact.value, 6) for fact in coulomb_oscillator().facts]
    [-0.43, 1.570796, -0.03]

    References
    ----------
    Den Hartog, *Mechanical Vibrations* (1956), on Coulomb damping.
    """
    name = "coulomb-oscillator"
    above_zero(name, F=F, x0=x0)
    scheme = Scheme(Mass("x", m), Spring("x", GROUND, k), Slider("x", GROUND, F, symbols=("F",)))
    ω: float = sqrt(k / m)
    loss = F / k

    def half_swings() -> tuple[int, float]:
        """Return the number of half swings, and the place where the last one ends."""
        halves = max(0, math.ceil(0.5 * (x0 / loss - 1.0) - 1e-12))
        return halves, (-1) ** halves * (x0 - 2 * halves * loss)

    def t_end() -> float:
        return (half_swings()[0] + 1.5) * math.pi / ω

    def facts() -> tuple[Fact, ...]:
        halves, rest = half_swings()
        place = Fact("x_∞", "final position", rest, "m", partial(final, series="x"), scale=x0)
        if not halves:
            return (place,)
        return (
            Fact(
                "x_1", "first turning point", -(x0 - 2.0 * loss), "m", partial(peak, series="x", sign=-1.0), scale=loss
            ),
            Fact("t_∞", "when it stops", halves * math.pi / ω, "s", partial(instant, kind="stick", number=-1)),
            place,
        )

    def motion(t: Array) -> tuple[Array, Array]:
        halves, rest = half_swings()
        times = np.asarray(t, dtype=np.float64)
        n = np.minimum(np.floor(times * ω / math.pi), halves)
        s = ω * times - n * math.pi
        sign = 1.0 - 2.0 * np.mod(n, 2.0)
        swing = np.where(n < halves, x0 - (2.0 * n + 1.0) * loss, 0.0)
        x = np.where(n < halves, sign * (loss + swing * np.cos(s)), rest)
        return x[:, None], (-sign * swing * ω * np.sin(s))[:, None]

    return Problem(
        name,
        scheme,
        q0={"x": x0},
        t_end=t_end,
        source="DenHartog1956, on Coulomb damping",
        facts=facts,
        motion=motion,
    )


@registered
def forced_coulomb_oscillator(
    m: Annotated[float, "kg, mass"] = 1.0,
    k: Annotated[float, "N/m, stiffness"] = 100.0,
    F: Annotated[float, "N, friction"] = 3.0,
    P: Annotated[float, "N, amplitude of the force"] = 10.0,
    omega: Annotated[float, "rad/s, circular frequency ω of the force"] = 8.0,
) -> Problem:
    r"""A mass on a spring and a rough table under a harmonic force: Den Hartog's motion without stops.

    ``m x'' + k x = -F sign x' + P cos(ω t + φ)``. In the steady motion that never rests, x falls from X to -X in half a
    period and rises back in the next, and friction is constant in each half. The run starts at the turning point x = X;
    with ``ω_n = sqrt(k/m)``, ``β = ω/ω_n``, the static deflections ``a = P/k`` and ``x_f = F/k``, and the functions

    - ``V = 1/(1 - β²)`` of response and ``U = sin(π/β)/(β (1 + cos(π/β)))`` of damping,

    the conditions ``x = X``, ``x' = 0`` at t = 0 and ``x = -X``, ``x' = 0`` at t = π/ω give

    - ``X = sqrt(V² a² - U² x_f²)``,
    - ``x = x_f (1 - cos ω_n t - β U sin ω_n t) + X cos ω t + U x_f sin ω t`` in the first half period, ``-x`` in the second,
    - and a force that is ahead of the turning points by φ, ``V a cos φ = X`` and ``V a sin φ = -U x_f``.

    This holds as long as the mass does not turn within the half period; at the turning point that asks for
    ``(F/P)² < V²/(U² + 1/β⁴)``. With more friction the mass stops for part of each swing, and there is no such formula. At
    resonance friction below ``F/P = π/4`` does not bound the amplitude: the force does more work in a cycle than the
    ``4 F X`` that friction takes, since both grow in proportion to X. The trap is to put an equivalent viscous damper in
    place of the slider: it bounds what is not bounded, and knows nothing of stops.

    Raises
    ------
    InputError
        If a parameter is not above zero, the force is in resonance, or there is no such motion without stops.

    Examples
    --------
    >>> [round(fact.value, 9) for fact in forced_coulomb_oscillator().facts]
    [0.262610488, 0.195230402, 0.392699082]

    References
    ----------
    Den Hartog, Forced vibrations with combined Coulomb and viscous friction (1931).
    """
    name = "forced-coulomb-oscillator"
    above_zero(name, m=m, k=k, F=F, P=P, omega=omega)
    ω = omega
    ω_n = math.sqrt(k / m)
    x_f = F / k
    a = P / k
    β, half = ω / ω_n, math.pi / ω
    if abs(β - 1.0) < 1e-6 or abs(1.0 + math.cos(math.pi / β)) < 1e-9:
        raise InputError(
            f"{name}: omega = {omega:g} is sqrt(k/m) = {ω_n:g} over a whole odd number, where there is no such motion; "
            "change omega"
        )
    V = 1.0 / (1.0 - β**2)
    U = math.sin(math.pi / β) / (β * (1.0 + math.cos(math.pi / β)))
    X = math.sqrt(max(0.0, (V * a) ** 2 - (U * x_f) ** 2))

    def motion(t: Array | float) -> tuple[Array, Array]:
        times = np.atleast_1d(np.asarray(t, dtype=np.float64))
        halves = np.floor(times * ω / math.pi)
        sign = 1.0 - 2.0 * np.mod(halves, 2.0)
        s = times - halves * math.pi / ω
        free = ω_n * s
        forced = ω * s
        x = x_f * (1.0 - np.cos(free) - β * U * np.sin(free)) + X * np.cos(forced) + U * x_f * np.sin(forced)
        v = x_f * ω_n * (np.sin(free) - β * U * np.cos(free)) + ω * (U * x_f * np.cos(forced) - X * np.sin(forced))
        return (sign * x)[:, None], (sign * v)[:, None]

    _, falling = motion(np.linspace(0.0, half, 2001)[1:-1])
    if X == 0.0 or (falling >= 0.0).any():
        raise InputError(
            f"{name}: with F = {F:g} and P = {P:g} the mass stops within a swing, and no closed form is known; take less "
            "friction or a larger force"
        )
    force = Harmonic(P, ω, math.atan2(-U * x_f / V, X / V))

    def facts() -> tuple[Fact, ...]:
        return (
            Fact("X", "amplitude", X, "m", partial(peak, series="x")),
            Fact("x(T/8)", "position after an eighth of a period", float(motion(0.25 * half)[0][0, 0]), "m",
                 partial(at, series="x", t=0.25 * half), scale=X),
            Fact("T/2", "from turn to turn", half, "s", partial(interval, kind="slip", first=1, last=2)),
        )  # fmt: skip

    return Problem(
        name,
        Scheme(
            Mass("x", m),
            Spring("x", GROUND, k),
            Slider("x", GROUND, F, symbols=("F",)),
            Load("x", force, symbols=("P cos ωt",)),
        ),
        q0={"x": X},
        t_end=5.25 * half,
        source="DenHartog1931",
        facts=facts,
        motion=motion,
    )


@registered
def jenkins_cycle(
    k: Annotated[float, "N/m, elastic stiffness"] = 100.0,
    f_y: Annotated[float, "N, yield force"] = 5.0,
    X: Annotated[float, "m, amplitude of the end"] = 0.12,
    omega: Annotated[float, "rad/s, circular frequency ω of the end"] = 2.0 * math.pi,
    k_h: Annotated[float, "N/m, hardening stiffness, 0 for none"] = 0.0,
) -> Problem:
    r"""An elastic-plastic element pulled to and fro: the hysteresis loop of St-Venant, Prandtl and Jenkins.

    A spring k in series with a slider f_y, and a hardening spring k_h beside the slider if there is one; the end moves by
    ``x = X sin ω t``. The force is ``f = k (x - p)``, where p is the plastic elongation, which follows x only while the
    slider slips. It first yields at ``sin ω t_y = f_y/(k X)``; from the first turn on the loop repeats itself:

    - p goes between ``±p_max``, ``p_max = (k X - f_y)/(k + k_h)``, and f between ``±(f_y + k_h p_max)``,
    - the work of a cycle is the area of the loop, ``W = 4 f_y p_max``, so ``4 f_y (X - f_y/k)`` without hardening.

    The loss knows no rate: at any ω it is the same, unlike that of a dashpot, and below X = f_y/k there is none. No mass is
    in the scheme; at each instant it is in equilibrium. The trap is a load cycle read from its start: the first quarter, the
    virgin curve, is no part of the loop.

    Raises
    ------
    InputError
        If k, f_y, X or omega is not above zero, or k_h is negative.

    Examples
    --------
    >>> [round(fact.value, 6) for fact in jenkins_cycle().facts]
    [0.068401, 0.07, 5.0, 1.4]

    References
    ----------
    Jenkins, Analysis of the stress-strain relationships in reactor grade graphite (1962).
    """
    name = "jenkins-cycle"
    above_zero(name, X=X, omega=omega)
    if k_h < 0.0:
        raise InputError(f"{name}: k_h = {k_h:g} must not be negative; 0 leaves the hardening out")
    scheme = Scheme(
        PrescribedMotion("x", Harmonic(X, omega, -0.5 * math.pi)),
        Jenkins("x", GROUND, k, f_y, k_h if k_h > 0.0 else None),
    )
    T = 2.0 * math.pi / omega

    def plastic_elongation() -> float:
        """Return p_max."""
        return max(0.0, (k * X - f_y) / (k + k_h))

    def facts() -> tuple[Fact, ...]:
        p_max = plastic_elongation()
        facts: tuple[Fact, ...] = (
            Fact("p_max", "plastic elongation", p_max, "m", partial(peak, series="F.1"), scale=X),
            Fact("f_max", "greatest force", k * (X - p_max), "N", partial(peak, series=partial(_spring_force, k=k))),
            Fact("W", "work of a cycle", 4.0 * f_y * p_max, "J", partial(_work, k=k, T=T), scale=f_y * X),
        )
        if p_max > 0.0:
            t_y = math.asin(f_y / (k * X)) / omega
            facts = (Fact("t_y", "first yield", t_y, "s", partial(instant, kind="slip")), *facts)
        return facts

    def motion(t: Array) -> tuple[Array, Array]:
        p_max = plastic_elongation()
        times = np.asarray(t, dtype=np.float64)
        x = X * np.sin(omega * times)
        rate = X * omega * np.cos(omega * times)
        turns = np.floor(omega * times / math.pi + 0.5)
        rising = np.mod(turns, 2.0) == 0.0
        held = np.where(turns == 0.0, 0.0, np.where(rising, -p_max, p_max))
        yielding = (k * x + np.where(rising, -f_y, f_y)) / (k + k_h)
        slips = np.where(rising, yielding > held, yielding < held)
        p = np.where(slips, yielding, held)
        return np.column_stack([x, p]), np.column_stack([rate, np.where(slips, k / (k + k_h) * rate, 0.0)])

    return Problem(
        name,
        scheme,
        t_end=2.25 * T,
        source="Jenkins1962",
        facts=facts,
        motion=motion,
    )


def _spring_force(state: State, k: float) -> Array:
    """Return k times x minus the plastic elongation, the force of the spring."""
    return k * (state.q[:, 0] - state.q[:, 1])


def _work(run: Readable, k: float, T: float) -> float:
    """Return ∮ f dx over the second cycle; f is a line in x between events and turns, so the trapezoidal rule is exact."""
    corners = np.concatenate([run.t, [each.t for each in run.events], T * (1.0 + 0.25 * np.arange(5))])
    t = np.unique(corners[(corners >= T) & (corners <= 2.0 * T)])
    x, p = run.sample(t).q.T
    f = k * (x - p)
    return float(0.5 * ((f[1:] + f[:-1]) * np.diff(x)).sum())
