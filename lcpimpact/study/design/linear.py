r"""Contact laws of one spring and one dashpot: the motion in contact is a damped oscillation about equilibrium.

With S, C of `lcpimpact.problems.free_vibration` at ω = 1, τ = ω t and ξ = x/L,

.. math:: ξ'' + 2ζ ξ' + ξ = γ, \qquad y(τ) = γ (1 - C) + S

is the displacement ξ of a Kelvin-Voigt block and the force of a Maxwell block. They differ in the combination of S, C and S'
whose zero ends the contact. Each combination is a constant plus p S' + q S with known extrema; the oscillation decays, so
its first zero lies before the second extremum, or there is none, and successive extrema bracket it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache
from typing import ClassVar

import numpy as np
from scipy.optimize import brentq

from lcpimpact.problems.base import Problem
from lcpimpact.problems.free_vibration import free_vibration
from lcpimpact.problems.viscoelastic_impact import kelvin_voigt_impact, kelvin_voigt_tension, maxwell_impact
from lcpimpact.reading import Series
from lcpimpact.scheme.elements.hard_stop import HardStop
from lcpimpact.study.design.law import ContactLaw, Rebound, grounded, of_spring, opened, struck
from lcpimpact.trajectory import Trajectory


def extremum_times(p: float, q: float, ζ: float) -> tuple[float, ...]:
    """Return the first times τ > 0, two or fewer, at which p S' + q S = 0 (ω = 1).

    Examples
    --------
    >>> [round(τ / math.pi, 12) for τ in extremum_times(1.0, 0.0, 0.0)]
    [0.5, 1.5]
    """
    σ = math.sqrt(abs((1.0 - ζ) * (1.0 + ζ)))
    if ζ < 1.0:
        θ = math.atan2(p, (p * ζ - q) / σ) % math.pi or math.pi
        return (θ / σ, (θ + math.pi) / σ)
    s = p * ζ - q
    if σ == 0.0:
        return (p / s,) if p * s > 0.0 else ()
    return (math.atanh(p * σ / s) / σ,) if p * s > 0.0 and abs(p * σ) < abs(s) else ()


def _first_zero(f: Callable[[float], float], extrema: tuple[float, ...]) -> float:
    """Return the first zero of f, which starts positive or increasing, inf if there is none; ``extrema`` are its extrema."""
    last = 0.0
    for τ in extrema:
        if f(τ) <= 0.0:
            return float(brentq(f, last, τ, xtol=1e-300, rtol=1e-15))
        last = τ
    return math.inf


class Oscillation:
    """The motion for a damping ratio λ = ζ and a weight γ, in the units m = v0 = L = 1."""

    def __init__(self, ζ: float, γ: float) -> None:
        self.ζ, self.γ = ζ, γ

    def parts(self, τ: float) -> tuple[float, float, float]:
        """Return S, C and S' at τ."""
        S, C, dS = free_vibration(τ, 1.0, self.ζ)
        return float(S), float(C), float(dS)

    def y(self, τ: float) -> float:
        """Return y = γ (1 - C) + S."""
        S, C, _ = self.parts(τ)
        return self.γ * (1.0 - C) + S

    def rate(self, τ: float) -> float:
        """Return y' = S' + γ S."""
        S, _, dS = self.parts(τ)
        return dS + self.γ * S

    def force(self, τ: float) -> float:
        """Return 2ζ y' + y = γ - y'', the force of a spring and a dashpot in parallel."""
        S, _, dS = self.parts(τ)
        return self.γ - (self.γ - 2.0 * self.ζ) * dS + S

    def extrema(self) -> tuple[float, ...]:
        """Return the extrema of y."""
        return extremum_times(1.0, self.γ, self.ζ)

    def force_extrema(self) -> tuple[float, ...]:
        """Return the extrema of the force γ - y''."""
        excess = self.γ - 2.0 * self.ζ
        return extremum_times(1.0 + 2.0 * self.ζ * excess, excess, self.ζ)

    def return_time(self) -> float:
        """Return the next time at which y = 0, inf if there is none."""
        return _first_zero(self.y, self.extrema())


def _parallel_rebound(motion: Oscillation, τ_c: float) -> Rebound:
    """Return the contact of a spring and a dashpot in parallel that ends at τ_c."""
    γ = motion.γ
    forces = [motion.force(0.0), *(motion.force(τ) for τ in motion.force_extrema() if τ < τ_c)]
    deflections = [motion.y(τ) for τ in motion.extrema() if τ < τ_c]
    if math.isinf(τ_c):
        # A mass that stays in contact comes to rest under its weight.
        return Rebound(0.0, τ_c, max(*forces, γ), max(*deflections, γ, 0.0))
    return Rebound(-motion.rate(τ_c), τ_c, max(forces), max(deflections))


@lru_cache(maxsize=4096)
def weightless_rebound(ζ: float) -> Rebound:
    """Return the contact without weight of a spring and a dashpot that push and do not pull."""
    known = {fact.symbol: fact.value for fact in kelvin_voigt_impact(1.0, 1.0, 2.0 * ζ, 1.0).facts}
    return Rebound(known["e"], known["t_c"], known["R_max"], known["x_max"])


class KelvinVoigtLaw(ContactLaw):
    """A spring and a dashpot in parallel without adhesion: contact ends when the force is zero."""

    name: ClassVar[str] = "kelvin-voigt"
    losses: ClassVar[tuple[float, float]] = (1e-6, 100.0)

    def rebound(self, λ: float, γ: float, n: float) -> Rebound:
        """Return the contact up to the first zero of γ - y''."""
        if γ == 0.0:
            return weightless_rebound(λ)
        motion = Oscillation(λ, γ)
        return _parallel_rebound(motion, _first_zero(motion.force, motion.force_extrema()))

    def constant(self, λ: float, n: float) -> float:
        """Return c = 2 ζ."""
        return 2.0 * λ

    def number(self, constant: float, n: float) -> float:
        """Return ζ = c/2."""
        return 0.5 * constant

    def light(self, m: float, v0: float, k: float, loss: float, n: float) -> Problem:
        """Return kelvin-voigt-impact."""
        return kelvin_voigt_impact(m, k, loss, v0)

    def measured(self, run: Trajectory) -> Rebound:
        """Return the contact up to the opening of the bumper."""
        return opened(run, self.force(run))


class TensionLaw(KelvinVoigtLaw):
    """Block with tension allowed: contact ends when the displacement is zero again."""

    name: ClassVar[str] = "kelvin-voigt-tension"

    def rebound(self, λ: float, γ: float, n: float) -> Rebound:
        """Return the contact up to the return of y."""
        motion = Oscillation(λ, γ)
        return _parallel_rebound(motion, motion.return_time())

    def light(self, m: float, v0: float, k: float, loss: float, n: float) -> Problem:
        """Return kelvin-voigt-tension."""
        return kelvin_voigt_tension(m, k, loss, v0)

    def measured(self, run: Trajectory) -> Rebound:
        """Return the contact up to x = 0; the force of the block follows from the motion."""
        return grounded(run, self.force(run))

    def force(self, run: Trajectory) -> Series:
        """Return k x + c x'."""
        k = run.problem.parameters["k"]
        c = run.problem.parameters["c"]
        return lambda state: np.asarray(k * state.q[:, 0] + c * state.v[:, 0])


class HardStopLaw(TensionLaw):
    """A spring whose dashpot acts while it is compressed: it returns from the deepest point without loss."""

    name: ClassVar[str] = "hard-stop"
    method: ClassVar[str] = "event-driven"

    def rebound(self, λ: float, γ: float, n: float) -> Rebound:
        """Return the contact: a damped oscillation to its first extremum y, then y'' + y = γ from rest."""
        motion = Oscillation(λ, γ)
        deepest = min(motion.extrema(), default=math.inf)
        y = motion.y(deepest) if math.isfinite(deepest) else γ
        peak = max([motion.force(0.0), *(motion.force(τ) for τ in motion.force_extrema() if τ < deepest), y])
        if y <= 2.0 * γ or math.isinf(deepest):
            return Rebound(0.0, math.inf, max(peak, γ), max(y, γ))
        return Rebound(math.sqrt(y * (y - 2.0 * γ)), deepest + math.acos(-γ / (y - γ)), peak, y)

    def light(self, m: float, v0: float, k: float, loss: float, n: float) -> Problem:
        """Return a mass that meets a `HardStop` at t = 0."""
        stop = HardStop("x", "ground", k=k, c=loss, rebound="undamped")
        return struck(self.name, m, v0, stop, 3.0 * math.pi * math.sqrt(m / k), k=k, c=loss)

    def force(self, run: Trajectory) -> Series:
        """Return the force of the stop."""
        return of_spring(run)


class MaxwellLaw(ContactLaw):
    """A spring and a dashpot in series: y is the force, and contact ends when it returns to zero."""

    name: ClassVar[str] = "maxwell"
    losses: ClassVar[tuple[float, float]] = (1e-6, 100.0)

    def rebound(self, λ: float, γ: float, n: float) -> Rebound:
        """Return the contact up to the return of y; the displacement is x = y + 2ζ (1 + γ τ - x')."""
        ζ, motion = λ, Oscillation(λ, γ)

        def rate(τ: float) -> float:
            S, C, _ = motion.parts(τ)
            return γ * (S + 2.0 * ζ * (1.0 - C)) + C

        τ_c, extrema = motion.return_time(), motion.extrema()
        peak_force = max([motion.y(τ) for τ in extrema[:1]], default=γ)
        if math.isinf(τ_c):
            # The dashpot creeps as long as there is a force: until the momentum is zero, or without end under gravity.
            return Rebound(0.0, τ_c, max(peak_force, γ), math.inf if γ > 0.0 else 2.0 * ζ)
        τ = float(brentq(rate, 0.0, τ_c, xtol=1e-300, rtol=1e-15)) if rate(τ_c) < 0.0 else τ_c
        return Rebound(-motion.rate(τ_c), τ_c, peak_force, motion.y(τ) + 2.0 * ζ * (1.0 + γ * τ))

    def constant(self, λ: float, n: float) -> float:
        """Return c = 1/(2 ζ)."""
        return 0.5 / λ

    def number(self, constant: float, n: float) -> float:
        """Return ζ = 1/(2 c)."""
        return 0.5 / constant

    def light(self, m: float, v0: float, k: float, loss: float, n: float) -> Problem:
        """Return maxwell-impact."""
        return maxwell_impact(m, k, loss, v0)

    def measured(self, run: Trajectory) -> Rebound:
        """Return the contact up to the opening of the bumper."""
        return opened(run, self.force(run))
