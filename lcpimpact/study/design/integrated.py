r"""The first contact on a spring with any loss, integrated: with weight, and where there is no closed form without.

In the units m = v0 = L = 1 the mass obeys δ'' = γ - F(δ, δ') with the force F of `lcpimpact.scheme.power_law`. The contact
ends where F returns to zero. A mass stays if its energy has fallen below the least with which F can end: that is 0, or with
a damping c δᵖ δ' the minimum over δ of its energy on the curve F = 0, δ' = -(K/c) δⁿ⁻ᵖ. And it stays if it is no longer to
come so deep as to cross that curve, which it does only where γ < (n - p) (K/c)² δ^(2(n-p)-1).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from scipy.integrate import ode
from scipy.optimize import brentq

from lcpimpact.arrays import Array
from lcpimpact.scheme.power_law import extended_force, spring_energy
from lcpimpact.study.design.law import Rebound

RTOL, ATOL = 1e-12, 1e-14
"""Tolerances of the integration; all lengths and times are near 1."""

State = tuple[float, float, float]
"""t, δ and δ'."""


def integrated(γ: float, n: float, *, b: float = 0.0, c: float = 0.0, p: float = 0.0, max_time: float = 1e6) -> Rebound:
    """Return the contact by DOP853, up to the end of the force or until the mass stays in contact.

    Parameters
    ----------
    γ, n : float
        Weight and exponent of the spring, whose stiffness is (n + 1)/2.
    b, c, p : float
        Constants of its loss (`lcpimpact.scheme.power_law`): b, or c and p.
    max_time : float
        Maximum time, in units of L/v0.
    """
    contact = _Contact(γ, n, b, c, p)
    contact.follow((0.0, 0.0, 1.0), max_time, contact.visit)
    # What is stationary in time need not be sharp in it.
    deepest = contact.fall(lambda _, v: v, 1e-9)
    strongest = contact.fall(contact.force_rate, 1e-9)
    left = contact.fall(contact.margin, 1e-15) or contact.dip()
    peak = max(contact.force(*state[1:]) for state in (contact.steps[0], strongest or contact.steps[-1]))
    way = deepest[1] if deepest else contact.rest
    if left is None:
        # A mass that never leaves comes to rest under its weight.
        return Rebound(0.0, math.inf, max(peak, γ), max(way, contact.rest))
    return Rebound(-left[2], left[0], peak, way)


@dataclass(eq=False)
class _Contact:
    """The initial value problem δ'' = γ - F(δ, δ'), and the steps of its solution."""

    γ: float
    n: float
    b: float
    c: float
    p: float
    steps: list[State] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.K = 0.5 * (self.n + 1.0)
        self.row = np.array([0.0, self.K, self.n, self.b, self.c, self.p, 0.0, -math.inf, math.inf])
        # δ at rest under the weight
        self.rest = math.pow(self.γ / self.K, 1.0 / self.n)
        # On the curve on which the force is zero δ' = -(K/c) δᵖ, with this p.
        self.power = self.n - self.p
        # the δ up to which the force cannot end
        self.least_depth = math.pow(self.γ * (self.c / self.K) ** 2 / self.power, 1.0 / (2.0 * self.power - 1.0))
        self.least_energy = self.least_on_curve() if self.c > 0.0 and self.γ > 0.0 else 0.0

    def least_on_curve(self) -> float:
        """Return the least energy on the curve on which the force is zero; it is convex in δ."""
        speed = self.K / self.c

        def slope(δ: float) -> float:
            rise = self.K * math.pow(δ, self.n) + self.power * speed**2 * math.pow(δ, 2.0 * self.power - 1.0)
            return rise - self.γ

        δ = float(brentq(slope, 0.0, 2.0 * self.rest, xtol=1e-300, rtol=1e-15))
        return self.energy(δ, speed * δ**self.power)

    def energy(self, δ: float, v: float) -> float:
        return 0.5 * v * v + spring_energy(self.K, self.n, δ) - self.γ * δ

    def law(self, δ: float, v: float) -> tuple[float, float, float]:
        """Return F, which goes on through its end, and its derivatives by δ and δ'."""
        return extended_force(self.row, δ, v)

    def force(self, δ: float, v: float) -> float:
        return self.law(δ, v)[0]

    def force_rate(self, δ: float, v: float) -> float:
        law = self.law(δ, v)
        return law[1] * v + law[2] * (self.γ - law[0])

    def margin(self, δ: float, v: float) -> float:
        """Return a smooth function with the sign of F: δ, or K δ^(n-p) + c δ'."""
        return self.K * math.copysign(math.pow(abs(δ), self.power), δ) + self.c * v if self.c > 0.0 else δ

    def margin_rate(self, δ: float, v: float) -> float:
        return self.K * self.power * math.pow(abs(δ), self.power - 1.0) * v + self.c * (self.γ - self.force(δ, v))

    def settles(self, δ: float, v: float) -> bool:
        """Whether the mass never leaves."""
        if v > 0.0:
            return self.creeps(δ, v)
        energy, safe = self.energy(δ, v), self.least_depth
        return energy < self.least_energy or (max(δ, self.rest) <= safe and energy <= self.energy(safe, 0.0))

    def creeps(self, δ: float, v: float) -> bool:
        """Whether v is below some μ (rest - δ), which it is ever after, and the mass does not pass its place of rest."""
        if not 0.0 < δ < self.rest or self.force_rate(δ, v) > 0.0:
            return False
        damping = self.law(δ, v)[2]
        μ = max(v / (self.rest - δ), 0.5 * damping)
        return self.law(self.rest, 0.0)[1] + μ * μ <= damping * μ

    def visit(self, t: float, state: Array) -> int:
        """Record a step; return -1 if it is the last."""
        δ, v = map(float, state)
        self.steps.append((t, δ, v))
        return -1 if self.settles(δ, v) or (t > 0.0 and self.margin(δ, v) <= 0.0) else 0

    def follow(self, start: State, t: float, visited: Callable[[float, Array], int] | None = None) -> State:
        """Return the state at t after another."""
        rate = ode(lambda _, state: [state[1], self.γ - self.force(*state)])
        solver = rate.set_integrator("dop853", rtol=RTOL, atol=ATOL, nsteps=100_000)
        if visited:
            solver.set_solout(visited)
        δ, v = solver.set_initial_value(start[1:], start[0]).integrate(t)
        return t, float(δ), float(v)

    def dip(self) -> State | None:
        """Return the end of a force with damping that is zero and grows again within one step."""
        for before, after in pairwise(self.steps[1:] if self.c > 0.0 else ()):
            if self.margin_rate(*before[1:]) < 0.0 < self.margin_rate(*after[1:]):
                lowest = self.root(self.margin_rate, before, after, 1e-12)
                if self.margin(*lowest[1:]) <= 0.0:
                    return self.root(self.margin, before, lowest, 1e-15)
        return None

    def fall(self, g: Callable[[float, float], float], xtol: float) -> State | None:
        """Return the first state in which g has decreased to zero."""
        signs = [g(δ, v) for _, δ, v in self.steps]
        falls = [i for i in range(2, len(signs)) if signs[i - 1] > 0.0 >= signs[i]]
        return self.root(g, self.steps[falls[0] - 1], self.steps[falls[0]], xtol) if falls else None

    def root(self, g: Callable[[float, float], float], before: State, after: State, xtol: float) -> State:
        """Return the state between two in which g is zero, or the latter if g has not changed its sign there."""

        def value(t: float) -> float:
            return g(*(before if t == before[0] else self.follow(before, t))[1:])

        if value(before[0]) * value(after[0]) > 0.0:
            return after
        return self.follow(before, float(brentq(value, before[0], after[0], xtol=xtol, rtol=1e-15)))
