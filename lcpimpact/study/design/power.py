r"""Laws of a power δⁿ: Hertz's, which loses nothing, and Hunt and Crossley's.

In the units m = v0 = L = 1 the mass obeys ``δ'' = γ - (n + 1)/2 δⁿ (1 + a δ')`` with a = b v0. Without weight the closed
forms of `lcpimpact.problems.hertz` hold; only the duration is an integral, which the variable y = ln(1 + a δ') makes

.. math:: T = \frac{2}{(n+1)\, a} \int_{y_-}^{y_+} \frac{dy}{δ(y)^n}, \qquad
          δ^{n+1} = \frac{2}{a^2} (ψ(y_+) - ψ(y)), \qquad ψ(y) = e^y - 1 - y,

with ψ(y_-) = ψ(y_+): an entire ψ, and ends where δⁿ is a power of the distance, as Gauss and Jacobi's rule wants it.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any, ClassVar

import numpy as np
from scipy.integrate import quad, solve_ivp
from scipy.optimize import brentq
from scipy.special import roots_jacobi

from lcpimpact.arrays import Array
from lcpimpact.problems.base import Problem
from lcpimpact.problems.hertz import hertz_impact, hunt_crossley_impact
from lcpimpact.study.design.law import Law, Rebound, grounded
from lcpimpact.trajectory import Trajectory

NODES = 60
"""Of Gauss and Jacobi's rule, on either side of the deepest place."""

RTOL, ATOL = 1e-12, 1e-14
"""Of the integration where there is weight; all lengths and times are near 1."""

LONG = 1e3
"""Times of L/v0 after which a mass that has not turned is taken to creep to its place of rest."""


class HertzLaw(Law):
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
            # With δ = δ_max (1 - u²) the root of δ'² at the deepest place leaves the integrand.
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
        dynamics = run.problem.dynamics
        return grounded(run, lambda state: np.asarray(-dynamics.spring_force(state.q, state.v)[:, 0]))


class HuntCrossleyLaw(HertzLaw):
    """Hertz's spring with the loss b: K δⁿ (1 + b δ')."""

    name: ClassVar[str] = "hunt-crossley"
    loss: ClassVar[str] = "b"
    losses: ClassVar[tuple[float, float]] = (1e-3, 1e3)

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


def _without_weight(a: float, n: float) -> Rebound:
    facts = {fact.symbol: fact.value for fact in hunt_crossley_impact(1.0, 0.5 * (n + 1.0), a, n, 1.0).facts}
    e, y_plus = facts["e"], math.log1p(a)
    ψ_end = math.expm1(y_plus) - y_plus
    # 1 - e a cancels where e a is near 1, and this does not: ψ(y_-) = ψ(y_+).
    y_minus = -e * a - ψ_end
    T = 0.0
    for end in (y_plus, y_minus):
        s, weights = _jacobi(n)
        y = end * (1.0 - s)
        δ = (2.0 / a**2 * (ψ_end - (np.expm1(y) - y))) ** (1.0 / (n + 1.0))
        T += abs(end) * float(weights @ (s ** (n / (n + 1.0)) / δ**n))
    return Rebound(e, 2.0 / ((n + 1.0) * a) * T, facts["F_max"], facts["δ_max"])


@cache
def _jacobi(n: float) -> tuple[Array, Array]:
    """Return nodes and weights of ∫ f(s) s^(-n/(n+1)) ds over [0, 1]."""
    power = -n / (n + 1.0)
    x, weights = roots_jacobi(NODES, 0.0, power)
    return 0.5 * (1.0 + x), weights * 0.5 ** (1.0 + power)


def _integrated(a: float, γ: float, n: float) -> Rebound:
    """Return the contact with weight by SciPy's DOP853, up to where δ = 0 or, on the way down again, to where it stays."""
    K = 0.5 * (n + 1.0)

    def force(δ: float, v: float) -> float:
        return K * max(δ, 0.0) ** n * (1.0 + a * v)

    def rate(t: float, state: Array) -> list[float]:
        δ, v = state
        return [v, γ - force(δ, v)]

    def leaves(t: float, state: Array) -> float:
        return float(state[0])

    def turns(t: float, state: Array) -> float:
        return float(state[1])

    def falls_back(t: float, state: Array) -> float:
        return float(state[1])

    def force_peaks(t: float, state: Array) -> float:
        δ, v = state
        return float(n * v * (1.0 + a * v) + a * δ * (γ - force(δ, v)))

    events: list[Any] = [leaves, turns, falls_back, force_peaks]
    for each, direction in zip(events, (-1.0, -1.0, 1.0, -1.0), strict=True):
        each.direction, each.terminal = direction, each in (leaves, falls_back)
    found = solve_ivp(rate, (0.0, LONG), [0.0, 1.0], "DOP853", events=events, rtol=RTOL, atol=ATOL)
    left, deepest, _, peaks = found.y_events
    rest = (γ / K) ** (1.0 / n)
    forces = [force(*state) for state in peaks]
    if not len(left):
        ways = [float(state[0]) for state in deepest]
        return Rebound(0.0, math.inf, max([*forces, γ]), max([*ways, rest]))
    return Rebound(-float(left[0][1]), float(found.t_events[0][0]), max(forces), float(deepest[0][0]))
