r"""Power laws δⁿ: Hertz's, without loss, and Hunt and Crossley's.

In the units m = v0 = L = 1 the mass obeys ``δ'' = γ - (n + 1)/2 δⁿ (1 + a δ')`` with a = b v0. Without weight the closed
forms of `lcpimpact.problems.hertz` hold; only the duration is an integral, which the variable y = ln(1 + a δ') makes

.. math:: T = \frac{2}{(n+1)\, a} \int_{y_-}^{y_+} \frac{dy}{δ(y)^n}, \qquad
          δ^{n+1} = \frac{2}{a^2} (ψ(y_+) - ψ(y)), \qquad ψ(y) = e^y - 1 - y,

with ψ(y_-) = ψ(y_+): an entire ψ, and ends where δⁿ is a power of the distance, as Gauss and Jacobi's rule wants it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache, lru_cache
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike
from scipy.integrate import ode, quad
from scipy.optimize import brentq
from scipy.special import roots_jacobi

from lcpimpact.arrays import Array
from lcpimpact.problems.base import Problem
from lcpimpact.problems.hertz import hertz_impact, hunt_crossley_impact
from lcpimpact.reading import Series
from lcpimpact.scheme.power_law import spring_energy, spring_force
from lcpimpact.study.design.law import ContactLaw, Rebound, grounded, of_spring
from lcpimpact.trajectory import Trajectory

NODES = 60
"""Number of Gauss-Jacobi nodes on either side of the greatest penetration."""

SERIES = [1.0 / math.factorial(i) for i in range(2, 12)]
"""Coefficients of (exp y - 1 - y)/y²."""

RTOL, ATOL = 1e-12, 1e-14
"""Tolerances of the integration with weight; all lengths and times are near 1."""

State = tuple[float, float, float]
"""t, δ and δ'."""


class HertzLaw(ContactLaw):
    """The spring K δⁿ: it returns with v0, with and without weight."""

    name: ClassVar[str] = "hertz"
    loss: ClassVar[str] = ""
    losses: ClassVar[tuple[float, float]] = (0.0, 0.0)
    method: ClassVar[str] = "event-driven"
    n: ClassVar[float | None] = None

    def rebound(self, λ: float, γ: float, n: float) -> Rebound:
        """Return the contact from its energy: δ'² = 1 + 2 γ δ - δⁿ⁺¹."""
        K = 0.5 * (n + 1.0)
        if γ == 0.0:
            facts = {fact.symbol: fact.value for fact in hertz_impact(1.0, K, n, 1.0).facts}
            return Rebound(1.0, facts["T"], facts["F_max"], facts["δ_max"])
        high = 2.0 * max(1.0, 2.0 * γ) ** (1.0 / n) + 1.0
        δ_max = float(brentq(lambda δ: 1.0 + 2.0 * γ * δ - δ ** (n + 1.0), 0.5, high, xtol=1e-300, rtol=1e-15))

        def slowness(u: float) -> float:
            # The substitution δ = δ_max (1 - u²) removes the singularity at maximum penetration.
            w = δ_max ** (n + 1.0) * -math.expm1((n + 1.0) * math.log1p(-u * u)) - 2.0 * γ * δ_max * u * u
            return u / math.sqrt(w) if w > 0.0 else 1.0 / math.sqrt((n + 1.0) * δ_max ** (n + 1.0) - 2.0 * γ * δ_max)

        T = 4.0 * δ_max * quad(slowness, 0.0, 1.0, epsabs=0.0, epsrel=1e-13)[0]
        return Rebound(1.0, float(T), K * δ_max**n, δ_max)

    def constant(self, λ: float) -> float:
        """Return that there is none."""
        return 0.0

    def number(self, constant: float) -> float:
        """Return that there is none."""
        return 0.0

    def light(self, m: float, v0: float, k: float, loss: float, n: float) -> Problem:
        """Return hertz-impact."""
        return hertz_impact(m, k, n, v0)

    def measured(self, run: Trajectory) -> Rebound:
        """Return the contact up to x = 0."""
        return grounded(run, self.force(run))

    def force(self, run: Trajectory) -> Series:
        """Return the force of the spring."""
        return of_spring(run)


class HuntCrossleyLaw(HertzLaw):
    """Hertz's spring with the loss b: K δⁿ (1 + b δ')."""

    name: ClassVar[str] = "hunt-crossley"
    loss: ClassVar[str] = "b"
    losses: ClassVar[tuple[float, float]] = (1e-3, 100.0)

    def rebound(self, λ: float, γ: float, n: float) -> Rebound:
        """Return the contact: in closed form without weight, else by an integration."""
        return _without_weight(λ, n) if γ == 0.0 else _integrated(λ, γ, n)

    def constant(self, λ: float) -> float:
        """Return b = a."""
        return λ

    def number(self, constant: float) -> float:
        """Return a = b."""
        return constant

    def light(self, m: float, v0: float, k: float, loss: float, n: float) -> Problem:
        """Return hunt-crossley-impact."""
        return hunt_crossley_impact(m, k, loss, n, v0)


@lru_cache(maxsize=4096)
def _without_weight(a: float, n: float) -> Rebound:
    """Return the contact without weight from the closed forms and the integral."""
    facts = {fact.symbol: fact.value for fact in hunt_crossley_impact(1.0, 0.5 * (n + 1.0), a, n, 1.0).facts}
    e, y_plus = facts["e"], math.log1p(a)
    ψ_end = float(_ψ(y_plus))
    # ψ(y_-) = ψ(y_+), which sharpens what cancellation has left of e where a is small, or e a near 1.
    y_minus = -e * a - ψ_end
    for _ in range(3):
        y_minus -= (float(_ψ(y_minus)) - ψ_end) / math.expm1(y_minus)
    T = 0.0
    for end in (y_plus, y_minus):
        s, weights = _jacobi(n)
        y = end * (1.0 - s)
        δ = (2.0 / a**2 * (ψ_end - _ψ(y))) ** (1.0 / (n + 1.0))
        T += abs(end) * float(weights @ (s ** (n / (n + 1.0)) / δ**n))
    return Rebound(-math.expm1(y_minus) / a, 2.0 / ((n + 1.0) * a) * T, facts["F_max"], facts["δ_max"])


def _ψ(y: ArrayLike) -> Array:
    """Return exp y - 1 - y without the cancellation at small y."""
    y = np.asarray(y, dtype=np.float64)
    series = np.polynomial.polynomial.polyval(y, SERIES)
    return np.asarray(np.where(np.abs(y) < 0.1, y**2 * series, np.expm1(y) - y))


@cache
def _jacobi(n: float) -> tuple[Array, Array]:
    """Return nodes and weights of ∫ f(s) s^(-n/(n+1)) ds over [0, 1]."""
    power = -n / (n + 1.0)
    x, weights = roots_jacobi(NODES, 0.0, power)
    return 0.5 * (1.0 + x), weights * 0.5 ** (1.0 + power)


def _integrated(a: float, γ: float, n: float, *, max_time: float = 1e6) -> Rebound:
    """Return the contact with weight by DOP853, up to δ = 0 or until the mass stays in contact.

    ``max_time``: maximum time, in units of L/v0.
    """
    contact = _Contact(a, γ, n)
    contact.follow((0.0, 0.0, 1.0), max_time, contact.visit)
    # What is stationary in time need not be sharp in it.
    deepest = contact.fall(lambda _, v: v, 1e-9)
    strongest = contact.fall(contact.force_rate, 1e-9)
    left = contact.fall(lambda δ, _: δ, 1e-15)
    peak = contact.force(*(strongest or contact.steps[-1])[1:])
    way = deepest[1] if deepest else contact.rest
    if left is None:
        # A mass that never leaves comes to rest under its weight.
        return Rebound(0.0, math.inf, max(peak, γ), max(way, contact.rest))
    return Rebound(-left[2], left[0], peak, way)


@dataclass(eq=False)
class _Contact:
    """The contact with weight: the initial value problem δ'' = γ - F(δ, δ'), and the steps of its solution."""

    a: float
    γ: float
    n: float
    steps: list[State] = field(default_factory=list)

    @property
    def K(self) -> float:
        return 0.5 * (self.n + 1.0)

    @property
    def row(self) -> Array:
        """The law's row of `lcpimpact.scheme.power_law`."""
        return np.array([0.0, self.K, self.n, self.a, 0.0, 0.0, 0.0, -math.inf, math.inf])

    @property
    def rest(self) -> float:
        """δ at rest under the weight."""
        return math.pow(self.γ / self.K, 1.0 / self.n)

    def law(self, δ: float, v: float) -> tuple[float, float, float]:
        """Return F and its derivatives by δ and δ'."""
        return spring_force(self.row, δ, v)

    def force(self, δ: float, v: float) -> float:
        return self.law(δ, v)[0]

    def force_rate(self, δ: float, v: float) -> float:
        return self.n * v * (1.0 + self.a * v) + self.a * δ * (self.γ - self.force(δ, v))

    def settles(self, δ: float, v: float) -> bool:
        """Whether the mass never leaves: its energy, which falls and at δ = 0 is v²/2, is below zero, or it creeps."""
        energy = 0.5 * v * v + spring_energy(self.K, self.n, δ) - self.γ * δ
        return (v <= 0.0 and energy < 0.0) or self.creeps(δ, v)

    def creeps(self, δ: float, v: float) -> bool:
        # With v below μ (rest - δ) once, it is so ever after, and the mass does not pass its place of rest.
        if not 0.0 < δ < self.rest or v <= 0.0 or self.force_rate(δ, v) > 0.0:
            return False
        μ = v / (self.rest - δ)
        return self.law(self.rest, 0.0)[1] + μ * μ <= self.law(δ, v)[2] * μ

    def visit(self, t: float, state: Array) -> int:
        """Record a step; return -1 if it is the last."""
        δ, v = map(float, state)
        self.steps.append((t, δ, v))
        return -1 if self.settles(δ, v) or (t > 0.0 and δ <= 0.0) else 0

    def follow(self, start: State, t: float, visited: Callable[[float, Array], int] | None = None) -> State:
        """Return the state at t after another."""
        rate = ode(lambda _, state: [state[1], self.γ - self.force(*state)])
        solver = rate.set_integrator("dop853", rtol=RTOL, atol=ATOL, nsteps=100_000)
        if visited:
            solver.set_solout(visited)
        δ, v = solver.set_initial_value(start[1:], start[0]).integrate(t)
        return t, float(δ), float(v)

    def fall(self, g: Callable[[float, float], float], xtol: float) -> State | None:
        """Return the first state in which g has decreased to zero."""
        signs = [g(δ, v) for _, δ, v in self.steps]
        falls = [i for i in range(2, len(signs)) if signs[i - 1] > 0.0 >= signs[i]]
        if not falls:
            return None
        before, after = self.steps[falls[0] - 1], self.steps[falls[0]]

        def value(t: float) -> float:
            return g(*(before if t == before[0] else self.follow(before, t))[1:])

        if value(after[0]) > 0.0:
            return after
        return self.follow(before, float(brentq(value, before[0], after[0], xtol=xtol, rtol=1e-15)))
