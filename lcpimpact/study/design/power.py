r"""Power laws δⁿ: Hertz's, without loss, Hunt and Crossley's, Tsuji's, and Kuwabara and Kono's.

In the units m = v0 = L = 1 the mass obeys ``δ'' = γ - (n + 1)/2 δⁿ`` less the force of the loss. With that of Hunt and
Crossley, ``(n + 1)/2 δⁿ a δ'`` with a = b v0, and without weight the closed forms of `lcpimpact.problems.hertz` hold; only
the duration is an integral, which the variable y = ln(1 + a δ') makes

.. math:: T = \frac{2}{(n+1)\, a} \int_{y_-}^{y_+} \frac{dy}{δ(y)^n}, \qquad
          δ^{n+1} = \frac{2}{a^2} (ψ(y_+) - ψ(y)), \qquad ψ(y) = e^y - 1 - y,

with ψ(y_-) = ψ(y_+): an entire ψ, and ends where δⁿ is a power of the distance, as Gauss and Jacobi's rule wants it.

With Tsuji's loss, ``(n + 1) ζ δ^((n-1)/2) δ'``, y = δ^((n+1)/2) is the free vibration S(τ) of
`lcpimpact.problems.free_vibration` at ω = 1, with dτ = (n + 1)/2 δ^((n-1)/2) dt. With that of Kuwabara and Kono,
``(n + 1)/2 n a δⁿ⁻¹ δ'`` with a = A v0/L, there is no closed form. Both push and do not pull.
"""

from __future__ import annotations

import math
from functools import cache, lru_cache
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike
from scipy.integrate import quad
from scipy.optimize import brentq
from scipy.special import roots_jacobi

from lcpimpact.arrays import Array
from lcpimpact.problems.base import Problem
from lcpimpact.problems.free_vibration import free_vibration
from lcpimpact.problems.hertz import hertz_impact, hunt_crossley_impact
from lcpimpact.reading import Series
from lcpimpact.scheme.elements.kuwabara_kono import KuwabaraKono
from lcpimpact.scheme.elements.tsuji import Tsuji
from lcpimpact.study.design.integrated import integrated
from lcpimpact.study.design.law import ContactLaw, Rebound, grounded, of_spring, opened, struck
from lcpimpact.study.design.linear import extremum_times, weightless_rebound
from lcpimpact.trajectory import Trajectory

NODES = 60
"""Number of Gauss-Jacobi nodes on either side of the greatest penetration."""

SERIES = [1.0 / math.factorial(i) for i in range(2, 12)]
"""Coefficients of (exp y - 1 - y)/y²."""


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

    def constant(self, λ: float, n: float) -> float:
        """Return that there is none."""
        return 0.0

    def number(self, constant: float, n: float) -> float:
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
        return _without_weight(λ, n) if γ == 0.0 else integrated(γ, n, b=λ)

    def constant(self, λ: float, n: float) -> float:
        """Return b = a."""
        return λ

    def number(self, constant: float, n: float) -> float:
        """Return a = b."""
        return constant

    def power(self, n: float) -> float:
        """Return that b is a number over v0."""
        return 0.0

    def unit(self, n: float) -> str:
        """Return the unit of b."""
        return "s/m"

    def light(self, m: float, v0: float, k: float, loss: float, n: float) -> Problem:
        """Return hunt-crossley-impact."""
        return hunt_crossley_impact(m, k, loss, n, v0)


class TsujiLaw(HertzLaw):
    """Hertz's spring with the loss c of Tsuji: max(0, K δⁿ + c δ^((n-1)/2) δ')."""

    name: ClassVar[str] = "tsuji"
    loss: ClassVar[str] = "c"
    losses: ClassVar[tuple[float, float]] = (1e-6, 100.0)

    def rebound(self, λ: float, γ: float, n: float) -> Rebound:
        """Return the contact: without weight that of a linear block in another time, else by an integration."""
        return _stretched(λ, n) if γ == 0.0 else integrated(γ, n, c=(n + 1.0) * λ, p=0.5 * (n - 1.0))

    def constant(self, λ: float, n: float) -> float:
        """Return c = (n + 1) ζ."""
        return (n + 1.0) * λ

    def number(self, constant: float, n: float) -> float:
        """Return ζ = c/(n + 1)."""
        return constant / (n + 1.0)

    def power(self, n: float) -> float:
        """Return the power of L in c."""
        return -0.5 * (n + 1.0)

    def unit(self, n: float) -> str:
        """Return the unit of c."""
        return f"N s/m^{0.5 * (n + 1.0):g}" if n > 1.0 else "N s/m"

    def light(self, m: float, v0: float, k: float, loss: float, n: float) -> Problem:
        """Return a mass that meets a `Tsuji` at t = 0."""
        stop = Tsuji("x", "ground", K=k, c=loss, n=n)
        return struck(self.name, m, v0, stop, _long(m, k, n, v0), k=k, c=loss, n=n)

    def measured(self, run: Trajectory) -> Rebound:
        """Return the contact up to the end of the force."""
        return opened(run, self.force(run))


class KuwabaraKonoLaw(TsujiLaw):
    """Hertz's spring with the loss A of viscoelastic bodies: max(0, K (δⁿ + n A δⁿ⁻¹ δ'))."""

    name: ClassVar[str] = "kuwabara-kono"
    loss: ClassVar[str] = "A"
    losses: ClassVar[tuple[float, float]] = (1e-4, 100.0)
    closed: ClassVar[bool] = False

    def rebound(self, λ: float, γ: float, n: float) -> Rebound:
        """Return the contact by an integration."""
        return integrated(γ, n, c=0.5 * (n + 1.0) * n * λ, p=n - 1.0)

    def constant(self, λ: float, n: float) -> float:
        """Return A = a."""
        return λ

    def number(self, constant: float, n: float) -> float:
        """Return a = A."""
        return constant

    def power(self, n: float) -> float:
        """Return the power of L in A."""
        return 1.0

    def unit(self, n: float) -> str:
        """Return the unit of A."""
        return "s"

    def light(self, m: float, v0: float, k: float, loss: float, n: float) -> Problem:
        """Return a mass that meets a `KuwabaraKono` at t = 0."""
        stop = KuwabaraKono("x", "ground", K=k, A=loss, n=n)
        return struck(self.name, m, v0, stop, _long(m, k, n, v0), k=k, A=loss, n=n)


def _long(m: float, k: float, n: float, v0: float) -> float:
    """Return three times the contact time of `HertzLaw`, in s."""
    return 3.0 * next(fact.value for fact in hertz_impact(m, k, n, v0).facts if fact.symbol == "T")


@lru_cache(maxsize=4096)
def _stretched(ζ: float, n: float) -> Rebound:
    """Return the contact of Tsuji's law without weight: y = S, δ = y^(2/(n+1)), and F = (n + 1)/2 y^p (S + 2ζ S')."""
    linear = weightless_rebound(ζ)
    q = 0.5 * (n + 1.0)
    p = (n - 1.0) / (n + 1.0)

    def vibration(φ: float) -> tuple[float, float]:
        """Return S and S' where S'/S = cot φ."""
        τ = extremum_times(math.sin(φ), -math.cos(φ), ζ)[0] if φ > 0.0 else 0.0
        S, dS = free_vibration(τ, 1.0, ζ)[::2]
        return float(S), float(dS)

    def slowness(φ: float) -> float:
        """Return (n + 1)/2 dt/dφ."""
        return math.pow(vibration(φ)[0], -p) / (1.0 + ζ * math.sin(2.0 * φ))

    # S vanishes at φ = 0 and near the end, φ = π - ψ, as a power that φ = sᑫ and π - φ = sᑫ take away.
    ψ = math.atan(2.0 * ζ)
    half = (0.5 * math.pi) ** (1.0 / q)
    T = quad(lambda s: slowness(s**q) * s ** (q - 1.0), 0.0, half, epsabs=0.0, epsrel=1e-12, limit=200)[0]
    T += quad(
        lambda s: slowness(math.pi - s**q) * s ** (q - 1.0), ψ ** (1.0 / q), half, epsabs=0.0, epsrel=1e-12, limit=200
    )[0]
    # The force is greatest where 2ζ p r² + (p + 1 - 4ζ²) r = 2ζ with r = S'/S: at the start if p = 0 and ζ ≥ 1/2.
    middle = p + 1.0 - 4.0 * ζ**2
    root = math.hypot(middle, 4.0 * ζ * math.sqrt(p))
    S, dS = vibration(math.atan2(root + middle, 4.0 * ζ) if middle > 0.0 else math.atan2(4.0 * ζ * p, root - middle))
    return Rebound(linear.e, float(T), q * S**p * (S + 2.0 * ζ * dS), linear.deflection ** (1.0 / q))


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
