r"""The impact damper: a loose mass in a slot of an oscillator, which it strikes twice in a cycle."""

from __future__ import annotations

import math
from functools import partial
from typing import Annotated

import numpy as np
from scipy.optimize import brentq

from lcpimpact.arrays import Array
from lcpimpact.errors import InputError
from lcpimpact.problems.base import Problem, above_zero, restitution
from lcpimpact.problems.facts import Fact
from lcpimpact.problems.free_vibration import free_vibration
from lcpimpact.problems.registered import registered
from lcpimpact.reading import Readable, event, interval, limit, peak
from lcpimpact.scheme.elements.base import GROUND
from lcpimpact.scheme.elements.bumper import Bumper
from lcpimpact.scheme.elements.kelvin_voigt import KelvinVoigt
from lcpimpact.scheme.elements.load import Load
from lcpimpact.scheme.elements.mass import Mass
from lcpimpact.scheme.scheme import Scheme
from lcpimpact.scheme.signals import Harmonic


@registered
def impact_damper(
    M: Annotated[float, "kg, mass of the oscillator"] = 1.0,
    m: Annotated[float, "kg, mass in its slot"] = 0.1,
    k: Annotated[float, "N/m, stiffness"] = 100.0,
    c: Annotated[float, "N s/m, damping"] = 0.4,
    d: Annotated[float, "m, play of the mass in the slot"] = 0.2,
    e: Annotated[float, "1, coefficient of restitution"] = 0.5,
    F: Annotated[float, "N, amplitude of the force"] = 1.0,
    omega: Annotated[float, "rad/s, circular frequency ω of the force"] = 10.0,
) -> Problem:
    r"""A resonance that a loose mass damps: one impact at each end of its slot in a period of the force.

    ``M x'' + c x' + k x = F cos(ω t + φ)`` between impacts, and a free mass m between two stops, d apart, of the slot in M.
    In the symmetric motion of two impacts in a period each half, ``τ = π/ω``, is the other with its sign changed. With the
    speed w of the loose mass, the place x_0 of the oscillator at an impact, its velocities v⁻ and v⁺, and μ = m/M

    - the way of the loose mass gives ``w τ = d + 2 x_0``, and momentum with Newton's law
      ``v⁻ = -w (1 - e + 2 μ)/(1 + e)`` and ``v⁺ = v⁻ + 2 μ w``: all are affine in w,
    - the forced motion at the impact, p and its rate q, follows from ``x(τ) = -x_0`` and ``x'(τ) = -v⁻`` by two linear
      equations with the free vibration over τ,
    - and ``p² + (q/ω)² = F²/((k - M ω²)² + (c ω)²)`` is a quadratic equation in w, whose larger root is taken.

    By default the oscillator is driven in resonance, where without the loose mass it would swing by ``F/(c ω)`` = 0.25 m;
    with it, by 0.03 m. Each impact takes the energy ``2 m w² (1 + μ) (1 - e)/(1 + e)``, and what it gives back is out of
    phase with the force. The motion is stable for these values, and for many others the impacts come in another order, or
    in none. The trap is to read a damping ratio off it: with e = 1 nothing is lost, and the same play would not do for
    twice the force, which doubles neither w nor the motion.

    Raises
    ------
    InputError
        If a parameter but e is not above zero, e lies outside [0, 1], or there is no such motion.

    Examples
    --------
    >>> [round(fact.value, 6) for fact in impact_damper().facts]
    [0.314159, 0.703095, -0.328111, 0.140619, 0.029684]

    References
    ----------
    Masri and Caughey, On the stability of the impact damper (1966).
    """
    name = "impact-damper"
    above_zero(name, M=M, m=m, k=k, c=c, d=d, F=F, omega=omega)
    restitution(name, e)
    ω, ω_0 = omega, math.sqrt(k / M)
    μ, τ = m / M, math.pi / ω
    ζ = c / (2.0 * M * ω_0)
    S, C, dS = map(float, free_vibration(τ, ω_0, ζ))
    G = F / math.hypot(k - M * ω**2, c * ω)

    def impact(w: float) -> tuple[float, float, float]:
        """Return x_0, v⁻ and v⁺ for a speed w of the loose mass."""
        before = -w * (1.0 - e + 2.0 * μ) / (1.0 + e)
        return 0.5 * (w * τ - d), before, before + 2.0 * μ * w

    def forced(w: float) -> Array:
        """Return p and q/ω for a speed w of the loose mass."""
        x, before, after = impact(w)
        matrix = [[1.0 + C, S], [-(ω_0**2) * S, 1.0 + dS]]
        p, q = np.linalg.solve(matrix, [(1.0 + C) * x + S * after, before - ω_0**2 * S * x + dS * after])
        return np.array([p, q / ω])

    rest = forced(0.0)
    slope = forced(1.0) - rest
    roots = np.roots([slope @ slope, 2.0 * slope @ rest, rest @ rest - G**2])
    w = float(max(roots.real)) if not roots.imag.any() else -1.0
    if w <= 0.0:
        raise InputError(
            f"{name}: with F = {F:g} and d = {d:g} no motion strikes each end once in a period; raise F, or change d"
        )
    x_0, _, after = impact(w)
    p, q_ω = map(float, forced(w))

    def half(t: Array) -> tuple[Array, Array]:
        """Return x and x' within the first half of a period."""
        S, C, dS = free_vibration(t, ω_0, ζ)
        x = p * np.cos(ω * t) + q_ω * np.sin(ω * t) + C * (x_0 - p) + S * (after - q_ω * ω)
        v = ω * (q_ω * np.cos(ω * t) - p * np.sin(ω * t)) - ω_0**2 * S * (x_0 - p) + dS * (after - q_ω * ω)
        return x, v

    def motion(t: Array) -> tuple[Array, Array]:
        times = np.asarray(t, dtype=np.float64)
        halves = np.floor(times / τ)
        sign, s = 1.0 - 2.0 * np.mod(halves, 2.0), times - halves * τ
        x, v = half(s)
        q = np.column_stack([x, x_0 + 0.5 * d - w * s])
        return sign[:, None] * q, sign[:, None] * np.column_stack([v, np.full(len(times), -w)])

    grid = np.linspace(0.0, τ, 513)
    q, _ = motion(grid[1:-1])
    if (np.abs(q[:, 1] - q[:, 0]) > 0.5 * d).any():
        raise InputError(f"{name}: with d = {d:g} and F = {F:g} the slot strikes the mass on its way; change d or F")

    def facts() -> tuple[Fact, ...]:
        _, before, _ = impact(w)
        x, _ = half(grid)
        j = int(np.argmax(np.abs(x)))
        top = abs(x[j])
        if 0 < j < len(grid) - 1:
            at = brentq(lambda s: float(half(np.array(s))[1]), grid[j - 1], grid[j + 1], xtol=1e-15 * τ)
            top = abs(float(half(np.array(at))[0]))
        return (
            Fact("τ", "from impact to impact", τ, "s", partial(interval, kind="impact", first=2, last=3)),
            Fact("w", "speed of the loose mass", w, "m/s",
                 partial(limit, kind="impact", number=2, of="v", i=1, side="left")),
            Fact("v⁻", "velocity of the oscillator before an impact", before, "m/s",
                 partial(limit, kind="impact", number=2, of="v", i=0, side="left"), scale=w),
            Fact("P", "impulse", 2.0 * m * w, "N s", _impulse),
            Fact("X", "amplitude of the oscillator", top, "m", partial(peak, series="x")),
        )  # fmt: skip

    return Problem(
        name,
        Scheme(
            Mass("x", M, symbols=("M",)),
            KelvinVoigt("x", GROUND, k, c),
            Load("x", Harmonic(F, ω, math.atan2(-q_ω, p) + math.atan2(c * ω, k - M * ω**2)), symbols=("F cos ωt",)),
            Mass("y", m),
            Bumper("y", "x", gap=0.5 * d, e=e, name="R1", symbols=("R_1",)),
            Bumper("x", "y", gap=0.5 * d, e=e, name="R2", symbols=("R_2",)),
        ),
        q0={"x": x_0, "y": x_0 + 0.5 * d},
        v0={"x": after, "y": -w},
        t_end=5.5 * τ,
        source="MasriCaughey1966",
        facts=facts,
        motion=motion,
    )


def _impulse(run: Readable) -> float:
    """Return the impulse of the second impact."""
    return float(event(run, "impact", 2).impulse)
