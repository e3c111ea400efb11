r"""Relays, sliding modes and reflected motion: systems whose multiplier switches a force on, off or to the other side."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from typing import Annotated, TypeAlias

import numpy as np

from lcpimpact.arrays import Array
from lcpimpact.errors import InputError
from lcpimpact.formula import sqrt
from lcpimpact.problems.base import Problem, above_zero
from lcpimpact.problems.facts import Fact
from lcpimpact.problems.registered import registered
from lcpimpact.reading import Readable, at, crossing, instant, peak
from lcpimpact.scheme.signals import Harmonic, Polynomial, Signal
from lcpimpact.scheme.system import LinearComplementaritySystem


@registered
def filippov(
    f0: Annotated[float, "1, input at the start"] = 2.0,
    s: Annotated[float, "1/s, its rate of fall"] = 1.0,
    depth: Annotated[float, "1, distance from the surface at the start"] = 1.5,
) -> Problem:
    r"""Filippov's smallest example: one field crosses a surface, slides on it, and leaves it.

    ``x' = f(t) - λ`` with ``λ`` in Sgn(x) and the falling input ``f = f0 - s t``, from x = -depth:

    - below zero ``x' = f + 1``: it crosses at ``t_1 = (f0 + 1 - sqrt((f0 + 1)² - 2 s depth))/s``, since there f > 1 and both
      fields point upwards,
    - above zero ``x' = f - 1`` brings it back at ``t_2 = 2 (f0 - 1)/s - t_1``, where |f| < 1 and both fields point at the
      surface: it slides, x = 0 and λ = f,
    - it leaves downwards when λ reaches its bound, f = -1, at ``t_3 = (f0 + 1)/s``.

    What to learn: on the surface the right side is no number but an interval, and the multiplier is what the motion makes of
    it, the mean of an ideal switch. The trap is ``sign(x)`` in an explicit integrator, which chatters about the surface with
    an amplitude of the step, and whose step control ends in tiny steps.

    Raises
    ------
    InputError
        If s or depth is not above zero, or the motion does not cross, slide and leave.

    Examples
    --------
    >>> [round(fact.value, 6) for fact in filippov().facts]
    [0.55051, 1.44949, 3.0, -0.125]

    References
    ----------
    Filippov, *Differential Equations with Discontinuous Righthand Sides* (1988); Nurkanović and Diehl, NOSNOC (2022).
    """
    name = "filippov"
    above_zero(name, s=s, depth=depth)
    root = (f0 + 1.0) ** 2 - 2.0 * s * depth
    t_1 = (f0 + 1.0 - sqrt(max(root, 0.0))) / s
    t_2, t_3 = 2.0 * (f0 - 1.0) / s - t_1, (f0 + 1.0) / s
    if not (root > 0.0 and f0 - s * t_1 > 1.0 and f0 - s * t_2 > -1.0):
        raise InputError(f"{name}: with f0 = {f0:g}, s = {s:g}, depth = {depth:g} it does not cross, slide and leave")
    t_end = t_3 + 0.5 / s

    def facts() -> tuple[Fact, ...]:
        return (
            Fact("t_1", "crosses", t_1, "s", partial(crossing, series="x")),
            Fact("t_2", "begins to slide", t_2, "s", partial(instant, kind="slide")),
            Fact("t_3", "leaves", t_3, "s", partial(_leaves, bound=-1.0)),
            Fact("x", "place at t_end", -0.125 / s, "", partial(at, series="x", t=t_end), scale=depth),
        )

    def motion(t: Array) -> tuple[Array, Array]:
        t = np.asarray(t, dtype=np.float64)
        f = f0 - s * t
        phases = [t < t_1, t < t_2, t < t_3]
        above = (t - t_1) * (f0 - 1.0 - 0.5 * s * (t + t_1))
        x = np.select(phases, [-depth + t * (f0 + 1.0 - 0.5 * s * t), above, 0.0 * t], -0.5 * s * (t - t_3) ** 2)
        return x[:, None], np.select(phases, [f + 1.0, f - 1.0, 0.0 * t], f + 1.0)[:, None]

    return Problem(
        name,
        _relay([[0.0]], [[-1.0]], [[-1.0]], states=("x",), a=[Polynomial((f0, -s))]),
        q0={"x": -depth},
        t_end=t_end,
        source="Filippov1988",
        facts=facts,
        motion=motion,
    )


@registered
def sliding_mode(
    a: Annotated[float, "m/s², control"] = 1.0,
    d: Annotated[float, "m/s², disturbance"] = 0.25,
    c: Annotated[float, "1/s, rate of the decay"] = 1.0,
    x0: Annotated[float, "m, initial place"] = 0.5,
) -> Problem:
    r"""Sliding mode control: a switch makes a disturbed mass do what a first-order equation says.

    ``x' = v`` and ``v' = d - a λ`` with ``λ`` in Sgn(σ), ``σ = v + c x``, from rest at x0 with an unknown disturbance d, of
    which nothing but |d| < a is known. The control pushes until σ = 0, and then

    - it slides from ``t_s = (sqrt(1 + 2 c² x0/(a - d)) - 1)/c`` on,
    - where x decays as ``x_s exp(-c (t - t_s))``, whatever d is,
    - and the mean of the switched control, Utkin's equivalent control, is ``λ = (d + c v)/a``, which tends to ``d/a``:
      it measures the disturbance.

    What to learn: in finite time the order of the system falls by one, and implicit steps find λ and do not chatter. The
    trap is the explicit step, whose control goes to and fro between -a and a for ever, with σ of the size of the step.

    Raises
    ------
    InputError
        If a, c or x0 is not above zero, |d| is not below a, or the control is too weak to slide where σ = 0 is reached.

    Examples
    --------
    >>> [round(fact.value, 6) for fact in sliding_mode().facts]
    [0.527525, 0.395644, 0.019698, 0.230302]

    References
    ----------
    Utkin, *Sliding Modes in Control and Optimization* (1992); Acary and Brogliato, Implicit Euler numerical scheme and
    chattering-free implementation of sliding mode systems (2010).
    """
    name = "sliding-mode"
    above_zero(name, a=a, c=c, x0=x0)
    if not abs(d) < a:
        raise InputError(
            f"{name}: |d| = {abs(d):g} must be below a = {a:g}, or the control cannot hold the disturbance"
        )
    t_s = (sqrt(1.0 + 2.0 * (c * c) * x0 / (a - d)) - 1.0) / c
    x_s, t_end = x0 - 0.5 * (a - d) * (t_s * t_s), t_s + 3.0 / c
    if not c * c * x_s < a + d:
        raise InputError(f"{name}: a = {a:g} is too weak to slide at σ = 0: raise it, or take a smaller c or x0")

    def facts() -> tuple[Fact, ...]:
        v_end = -c * x_s * math.exp(-3.0)
        return (
            Fact("t_s", "begins to slide", t_s, "s", partial(instant, kind="slide")),
            Fact("x_s", "place where it begins to slide", x_s, "m", partial(at, series="x", t=t_s), scale=x0),
            Fact("x", "place at t_end", x_s * math.exp(-3.0), "m", partial(at, series="x", t=t_end), scale=x0),
            Fact(
                "λ", "equivalent control at t_end", (d + c * v_end) / a, "", partial(at, series="λ", t=t_end), scale=1.0
            ),
        )

    def motion(t: Array) -> tuple[Array, Array]:
        push = a - d
        t = np.asarray(t, dtype=np.float64)
        free = t < t_s
        decay = x_s * np.exp(-c * np.maximum(t - t_s, 0.0))
        x = np.where(free, x0 - 0.5 * push * t**2, decay)
        v = np.where(free, -push * t, -c * decay)
        return np.column_stack([x, v]), np.column_stack([v, np.where(free, -push, c**2 * decay)])

    return Problem(
        name,
        _relay([[0.0, 1.0], [0.0, 0.0]], [[0.0], [-a]], [[-c, -1.0]], states=("x", "v"), a=[0.0, d]),
        q0={"x": x0},
        t_end=t_end,
        source="Utkin1992",
        facts=facts,
        motion=motion,
    )


@registered
def relay_oscillator(
    a: Annotated[float, "m/s², acceleration"] = 1.0,
    x0: Annotated[float, "m, initial place"] = 1.0,
) -> Problem:
    r"""A mass driven by a switch, always at full force towards the middle: parabolas, and a period that knows the amplitude.

    ``x'' = -a λ`` with ``λ`` in Sgn(x), let go at x0. The force has the potential ``a |x|``, so nothing is lost:

    - it passes the middle at ``t_1 = sqrt(2 x0/a)``, a quarter of the period ``T = 4 sqrt(2 x0/a)``,
    - with the speed ``sqrt(2 a x0)``.

    Here u = -x feels λ in its second derivative alone: the relative degree is two, and no law of impact is needed, since a
    bounded force never makes a velocity jump. What to learn: a longer swing takes longer, as of no linear oscillator. The
    trap is the instant of the switch: a step that keeps its force for the whole of h switches up to h too early or too late,
    and so adds or takes energy at order one.

    Raises
    ------
    InputError
        If a parameter is not above zero.

    Examples
    --------
    >>> [round(fact.value, 6) for fact in relay_oscillator().facts]
    [1.414214, -1.414214, 4.242641, -1.0]

    References
    ----------
    Tsypkin, *Relay Control Systems* (1984).
    """
    name = "relay-oscillator"
    above_zero(name, a=a, x0=x0)
    quarter = sqrt(2.0 * x0 / a)

    def facts() -> tuple[Fact, ...]:
        v_1 = math.sqrt(2.0 * a * x0)
        return (
            Fact("t_1", "first passes the middle", quarter, "s", partial(crossing, series="x", direction=-1.0)),
            Fact("v_1", "velocity there", -v_1, "m/s", partial(peak, series="v", sign=-1.0, until=2.0 * quarter)),
            Fact("t_2", "passes it again", 3.0 * quarter, "s", partial(crossing, series="x")),
            Fact("x_1", "first turning point", -x0, "m", partial(peak, series="x", sign=-1.0)),
        )

    def motion(t: Array) -> tuple[Array, Array]:
        t = np.asarray(t, dtype=np.float64)
        half = np.floor((t / quarter + 1.0) / 2.0)
        s = t - 2.0 * half * quarter
        sign = 1.0 - 2.0 * np.mod(half, 2.0)
        x, v = sign * 0.5 * a * (quarter**2 - s**2), -sign * a * s
        return np.column_stack([x, v]), np.column_stack([v, -sign * a])

    return Problem(
        name,
        _relay([[0.0, 1.0], [0.0, 0.0]], [[0.0], [-a]], [[-1.0, 0.0]], states=("x", "v")),
        q0={"x": x0},
        t_end=4.5 * quarter,
        source="Tsypkin1984",
        facts=facts,
        motion=motion,
    )


@registered
def twisting(
    r1: Annotated[float, "m/s², acceleration towards the middle"] = 2.0,
    r2: Annotated[float, "m/s², acceleration against the velocity"] = 1.0,
    x0: Annotated[float, "m, initial place"] = 1.0,
) -> Problem:
    r"""The twisting controller: two relays bring a mass to rest in a finite time, by infinitely many switches.

    ``x'' = -r1 λ_1 - r2 λ_2`` with ``λ_1`` in Sgn(x) and ``λ_2`` in Sgn(x'), from rest at x0. Towards the middle the
    acceleration is r1 - r2, away from it r1 + r2, so

    - amplitudes fall by the ratio ``q = (r1 - r2)/(r1 + r2)`` every half swing, and times by its root,
    - half swings begin with one of ``τ = sqrt(2 x0) (1/sqrt(r1 - r2) + sqrt(r1 - r2)/(r1 + r2))``,
    - and the sum of the times is finite: it rests from ``t_∞ = τ/(1 - sqrt(q))`` on.

    The switches accumulate as the impacts of a bouncing ball. At rest ``r1 λ_1 + r2 λ_2 = 0``, and the share of each is not
    determined, though the motion is. What to learn: a bounded force stops a mass in finite time, which no linear controller
    does. The trap is to count events: a method must come through t_∞, and not stop before it.

    Raises
    ------
    InputError
        If a parameter is not above zero, or r1 is not above r2.

    Examples
    --------
    >>> [round(fact.value, 6) for fact in twisting().facts]
    [1.414214, -0.333333, 4.46142, 0.0]

    References
    ----------
    Levant, Sliding order and sliding accuracy in sliding mode control (1993).
    """
    name = "twisting"
    above_zero(name, r1=r1, r2=r2, x0=x0)
    if not r1 > r2:
        raise InputError(f"{name}: r1 = {r1:g} must be above r2 = {r2:g}, or the mass stops before it turns back")
    inwards, outwards = r1 - r2, r1 + r2
    first = sqrt(2.0 * x0 / inwards)
    root = sqrt(inwards / outwards)
    half = first + sqrt(2.0 * x0 * inwards) / outwards
    rest = half / (1.0 - root)

    def facts() -> tuple[Fact, ...]:
        return (
            Fact("t_1", "first passes the middle", first, "s", partial(crossing, series="x", direction=-1.0)),
            Fact("x_1", "first turning point", -x0 * root**2, "m", partial(peak, series="x", sign=-1.0), scale=x0),
            Fact("t_∞", "when it comes to rest", rest, "s", _sum_of_swings, accuracy=1e-8),
            Fact("x", "place at t_end", 0.0, "m", partial(at, series="x", t=1.2 * rest), scale=x0),
        )

    def motion(t: Array) -> tuple[Array, Array]:
        t = np.asarray(t, dtype=np.float64)
        left = np.maximum(1.0 - t / rest, 0.0)
        with np.errstate(divide="ignore"):
            n = np.where(left > 0.0, np.floor(np.log(left) / math.log(root) + 1e-12), 0.0)
        s = np.maximum(rest * (root**n - left), 0.0)
        size = np.where(left > 0.0, root**n, 0.0)
        amplitude, sign = x0 * size**2, 1.0 - 2.0 * np.mod(n, 2.0)
        first = math.sqrt(2.0 * x0 / inwards) * size
        speed, away = inwards * first, s - first
        in_ = away < 0.0
        x = sign * np.where(in_, amplitude - 0.5 * inwards * s**2, -speed * away + 0.5 * outwards * away**2)
        v = sign * np.where(in_, -inwards * s, -speed + outwards * away)
        force = sign * np.where(in_, -inwards, outwards)
        moving = left > 0.0
        return np.where(moving, [x, v], 0.0).T, np.where(moving, [v, force], 0.0).T

    return Problem(
        name,
        _relay(
            [[0.0, 1.0], [0.0, 0.0]], [[0.0, 0.0], [-r1, -r2]], [[-1.0, 0.0], [0.0, -1.0]],
            states=("x", "v"), multipliers=("λ_1", "λ_2"),
        ),
        q0={"x": x0},
        t_end=1.2 * rest,
        source="Levant1993",
        facts=facts,
        motion=motion,
    )  # fmt: skip


def _sum_of_swings(run: Readable) -> float:
    """Return the limit of the passages of the middle by Aitken's rule, which is exact for geometric series."""
    t = [crossing(run, "x", direction=sign, number=n) for sign, n in ((-1.0, 1), (1.0, 1), (-1.0, 2))]
    first, second = t[1] - t[0], t[2] - t[1]
    return t[2] + second**2 / (first - second)


@registered
def reflected_motion(
    A: Annotated[float, "1/s, amplitude of the rate"] = 1.0,
    omega: Annotated[float, "rad/s, circular frequency ω of the rate"] = 1.0,
    x0: Annotated[float, "1, initial place, below A/ω"] = 0.5,
) -> Problem:
    r"""Skorokhod's problem: a motion that is pushed back at zero, and no more than it takes.

    ``x' = A cos ω t + λ`` with ``0 <= λ ⟂ x >= 0``, as a tank that cannot be emptier than empty. Without the push
    the motion would be ``z = x0 + A/ω sin ω t``, and all that was pushed until t is the greatest depth of z so far,

    - ``x = z + max(0, max -z)``, the running maximum of Skorokhod,
    - so it meets zero at ``ω t_1 = π + asin(ω x0/A)``, leaves it at ``ω t_2 = 3 π/2``, and stays above from then on,
    - with all of ``L = A/ω - x0`` pushed.

    What to learn: this is the contact law of relative degree one alone, without mass or spring. The trap is to cut off, x =
    max(0, z), which forgets what was pushed.

    Raises
    ------
    InputError
        If a parameter is not above zero, or zero is never reached.

    Examples
    --------
    >>> [round(fact.value, 6) for fact in reflected_motion().facts]
    [3.665191, 4.712389, 0.5, 2.0]

    References
    ----------
    Skorokhod, Stochastic equations for diffusion processes in a bounded region (1961).
    """
    name = "reflected-motion"
    above_zero(name, A=A, omega=omega, x0=x0)
    reach = A / omega
    if not x0 < reach:
        raise InputError(f"{name}: x0 = {x0:g} must be below A/omega = {reach:g}, or it never comes down to zero")
    t_end = 2.5 * math.pi / omega

    def held_times() -> tuple[float, float]:
        """Return t_1 and t_2."""
        return (math.pi + math.asin(x0 / reach)) / omega, 1.5 * math.pi / omega

    def facts() -> tuple[Fact, ...]:
        t_1, t_2 = held_times()
        return (
            Fact("t_1", "meets zero", t_1, "s", partial(instant, kind="close")),
            Fact("t_2", "leaves it", t_2, "s", partial(instant, kind="open")),
            Fact("L", "what was pushed", reach - x0, "", partial(_pushed, A=A, omega=omega, x0=x0), scale=reach),
            Fact("x", "place at t_end", 2.0 * reach, "", partial(at, series="x", t=t_end)),
        )

    def motion(t: Array) -> tuple[Array, Array]:
        t_1, t_2 = held_times()
        t = np.asarray(t, dtype=np.float64)
        sine = np.sin(omega * t)
        rate = reach * omega * np.cos(omega * t)
        held = (t >= t_1) & (t < t_2)
        x = np.where(held, 0.0, np.where(t < t_1, x0 + reach * sine, reach * (1.0 + sine)))
        return x[:, None], np.where(held, 0.0, rate)[:, None]

    return Problem(
        name,
        LinearComplementaritySystem(
            [[0.0]], [[1.0]], [[1.0]], a=[Harmonic(A, omega)], states=("x",), multipliers=("λ",)
        ),
        q0={"x": x0},
        t_end=t_end,
        source="Skorokhod1961",
        facts=facts,
        motion=motion,
    )


def _pushed(run: Readable, A: float, omega: float, x0: float) -> float:
    """Return x - z at the end of a run."""
    t = float(run.t[-1])
    return at(run, "x", t) - x0 - A / omega * math.sin(omega * t)


Rows: TypeAlias = Sequence[Sequence[float]]


def _relay(
    A: Rows,
    B: Rows,
    C: Rows,
    *,
    states: tuple[str, ...],
    multipliers: tuple[str, ...] = ("λ",),
    a: Sequence[float | Signal] | None = None,
) -> LinearComplementaritySystem:
    """Return x' = A x + B λ + a with λ in Sgn(-C x)."""
    ones = len(multipliers) * [1.0]
    return LinearComplementaritySystem(
        A, B, C, a=a, states=states, multipliers=multipliers, lower=[-each for each in ones], upper=ones
    )


def _leaves(run: Readable, bound: float) -> float:
    """Return when λ comes to a bound for the last time."""
    found = [each.t for each in run.events if each.kind == "switch" and abs(each.right.reaction[0] - bound) < 1e-3]
    if not found:
        raise InputError("no relay leaves within the run: run longer")
    return float(found[-1])
