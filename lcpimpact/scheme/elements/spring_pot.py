r"""The spring-pot: the fractional element between spring and dashpot, by a Prony series with a proven error bound."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import brentq
from scipy.special import loggamma

from lcpimpact.arrays import Array
from lcpimpact.errors import InputError
from lcpimpact.numbers import is_real
from lcpimpact.scheme.elements.base import MISSING, Compound, Element, Polyline, described, distinct, positive
from lcpimpact.scheme.elements.dashpot import Dashpot
from lcpimpact.scheme.elements.generalized_maxwell import GeneralizedMaxwell
from lcpimpact.scheme.elements.maxwell import inner_nodes


class Prony(NamedTuple):
    """A relaxation modulus k_inf + Σ k_i exp(-t/τ_i).

    Attributes
    ----------
    k_inf : float           N/m, what remains
    k, tau : tuples         N/m and s, the arms, from slow to fast
    """

    k_inf: float
    k: tuple[float, ...]
    tau: tuple[float, ...]


ETA_MAX = 3.0
"""Widest spacing of the trapezoidal rule."""


@described
@dataclass(frozen=True)
class SpringPot(Compound):
    r"""Scott Blair's spring-pot: force c_α D^α x of the elongation x, a spring for α = 0 and a dashpot for α = 1.

    D^α is Caputo's derivative from t = 0, where x = 0: a hereditary force with the modulus

    .. math:: F(t) = \int_0^t G(t - s)\, x'(s)\, ds, \qquad G(t) = \frac{c_α\, t^{-α}}{Γ(1 - α)} .

    The power law is written as an integral over exponentials and this by the trapezoidal rule of spacing η,

    .. math:: t^{-α} = \frac{1}{Γ(α)} \int_{-\infty}^{\infty} \exp(α y - e^y t)\, dy
              \approx \sum_j w_j e^{-s_j t}, \qquad s_j = s_0 e^{jη}, \quad w_j = \frac{η s_j^α}{Γ(α)} .

    Terms so slow that they hardly relax before t_max are merged into one, with their sum of weights and their mean rate;
    terms so fast that they are over by t_min become a dashpot c_0 = c_α/Γ(1 - α) Σ w_j/s_j. What is left acts as a
    `GeneralizedMaxwell` without k_inf. Its modulus differs from G(t) on t_min <= t <= t_max by less than ``bound`` <= rtol,
    relative to G(t); the bound is the sum of

    - 2 |Γ(α + 2πi/η)|/Γ(α)/(1 - √2 exp(-π²/η)) for the rule: by Poisson's summation the error is Σ 2 |Γ(α + 2π i k/η)|/Γ(α),
      the same at all t, and Im ψ(α + i y) >= π/2 - 1/(2y) makes the terms fall at least so fast;
    - η (s_0 t_max)^(2+α)/(2 Γ(α) (exp((2+α)η) - 1)) for the slow terms, whose first two moments are kept;
    - η x^α e^(-x)/Γ(α)/(1 - exp(αη - x (exp(η) - 1))) for the fast terms, x = s_n t_min >= 1 with the first of them.

    The energy is ½ F_i²/k_i of the arms; they and c_0 dissipate.

    ::

             /\
        a o-<  >-o b      pulls a towards b by c_α D^α (q_b - q_a)
             \/
             c_α, α

    Parameters
    ----------
    a, b : str
        The nodes that it joins; one may be the ground.
    c_alpha : float
    alpha : float
    t_min : float
    t_max : float
    rtol : float
    name : str, optional
        The name of the inner nodes, without their number; by default the two ends, as in x-ground.
    symbols : tuple of str
        How drawings call the two constants.

    Raises
    ------
    InputError
        If c_alpha, t_min or t_max is missing, not positive or not finite, t_min >= t_max, alpha is missing or does not lie
        between 0 and 1, rtol lies outside [1e-12, 1), or both ends are one node.

    Examples
    --------
    >>> pot = SpringPot("x", "ground", c_alpha=100.0, alpha=0.5, t_min=1e-4, t_max=10.0)
    >>> len(pot.prony.k), pot.bound < 1e-3
    (16, True)
    >>> t = 0.3
    >>> bool(abs(pot.approximation.modulus(t) / pot.modulus(t) - 1.0) <= pot.bound)
    True

    References
    ----------
    Beylkin and Monzón, Approximation by exponential sums revisited (2010), for the sum; Schmidt and Gaul, Finite element
    formulation of viscoelastic constitutive equations using fractional time derivatives (2002), for the spring-pot and
    what arms cost instead; Koeller, Applications of fractional calculus to the theory of viscoelasticity (1984).
    """

    a: str
    b: str
    c_alpha: Annotated[float, "N s^α/m, modulus c_α, positive"] = MISSING
    alpha: Annotated[float, "1, exponent α, between 0 and 1"] = MISSING
    t_min: Annotated[
        float,
        "s, shortest time after a change on which the memory is to be right, short against all that matters (the "
        "force of a motion with the acceleration a errs by some |a| c_α t_min^(2-α))",
    ] = MISSING
    t_max: Annotated[float, "s, longest such time, no shorter than the run"] = MISSING
    rtol: Annotated[
        float,
        "1, largest relative error of the modulus, from 1e-12 to below 1, which sets the number of arms; it is an "
        "accuracy and no physics, so it has a default",
    ] = 1e-3
    name: str | None = None
    symbols: tuple[str, ...] = ("c_α", "α")

    strokes: ClassVar[tuple[Polyline, ...]] = (
        ((0.0, 0.0), (0.3, 0.0)),
        ((0.3, 0.0), (0.5, 0.5), (0.7, 0.0), (0.5, -0.5), (0.3, 0.0)),
        ((0.7, 0.0), (1.0, 0.0)),
    )

    def __post_init__(self) -> None:
        positive(self, "c_alpha", self.c_alpha, "N s^α/m")
        if not is_real(self.alpha) or not 0.0 < self.alpha < 1.0:
            raise InputError(f"{self}: alpha = {self.alpha!r} must lie between 0 and 1; a spring is 0, and a dashpot 1")
        positive(self, "t_min", self.t_min, "s")
        positive(self, "t_max", self.t_max, "s")
        if not self.t_min < self.t_max:
            raise InputError(f"{self}: t_min = {self.t_min!r} must be below t_max = {self.t_max!r}")
        if not is_real(self.rtol) or not 1e-12 <= self.rtol < 1.0:
            raise InputError(f"{self}: rtol = {self.rtol!r} must lie between 1e-12 and 1")
        distinct(self)

    def __str__(self) -> str:
        # The inner nodes follow from the constants, so a message about these cannot count on them.
        return f"SpringPot between {self.a!r} and {self.b!r}"

    @property
    def nodes(self) -> tuple[str, ...]:
        """The two ends, and between them a node for each arm."""
        return (self.a, *inner_nodes(self.name, self.a, self.b, len(self.prony.k)), self.b)

    @property
    def prony(self) -> Prony:
        """The arms: k_inf = 0 in N/m (a spring-pot flows without end), k_i in N/m and τ_i in s."""
        return self._fit[0]

    @property
    def c_0(self) -> float:
        """The dashpot in N s/m for relaxation faster than t_min; it corrects the force and keeps the modulus."""
        return self._fit[1]

    @property
    def bound(self) -> float:
        """The proven bound of the modulus's relative error on [t_min, t_max], at most rtol."""
        return self._fit[2]

    @property
    def approximation(self) -> GeneralizedMaxwell:
        """The arms as an element; beside it acts the dashpot c_0."""
        return GeneralizedMaxwell(self.a, self.b, *self.prony, name=self.name)

    def modulus(self, t: ArrayLike) -> Array:
        """Return G(t) = c_α t^(-α)/Γ(1 - α) in N/m itself, with the shape of t; `approximation` has the series' own."""
        times = np.asarray(t, dtype=np.float64)
        return np.asarray(self.c_alpha / math.gamma(1.0 - self.alpha) * times**-self.alpha)

    def parts(self) -> tuple[Element, ...]:
        """Return the springs and dashpots of the arms, and the dashpot beside them."""
        return (*self.approximation.parts(), Dashpot(self.a, self.b, self.c_0, ("c_0",)))

    @cached_property
    def _fit(self) -> tuple[Prony, float, float]:
        """Return the arms, c_0 and the bound; each of the three errors gets a third of rtol."""
        α = float(self.alpha)
        t_min = float(self.t_min)
        t_max = float(self.t_max)
        limit, Γ = 0.33 * self.rtol, math.gamma(α)

        def rule(η: float) -> float:
            ratio = math.sqrt(2.0) * math.exp(-(math.pi**2) / η)
            return 2.0 * math.exp(loggamma(complex(α, 2.0 * math.pi / η)).real) / Γ / (1.0 - ratio)

        η = ETA_MAX if rule(ETA_MAX) <= limit else float(brentq(lambda η: math.log(rule(η) / limit), 0.1, ETA_MAX))

        def slow(x: float) -> float:
            return float(η * x ** (2.0 + α) / (2.0 * Γ * math.expm1((2.0 + α) * η)))

        def fast(x: float) -> float:
            return float(η * x**α * math.exp(-x) / Γ / (1.0 - math.exp(α * η - x * math.expm1(η))))

        s_0 = (limit / slow(1.0)) ** (1.0 / (2.0 + α)) / t_max
        n = max(1, math.ceil(-math.log(s_0 * t_min) / η))
        while fast(s_0 * math.exp(n * η) * t_min) > limit:
            n += 1

        s = s_0 * np.exp(η * np.arange(n + 1))
        w = η * s**α / Γ
        # The geometric series of the terms below s_0: the sum of w_j, and that of w_j s_j.
        weight = w[0] / math.expm1(α * η)
        moment = w[0] * s_0 / math.expm1((1.0 + α) * η)
        c = float(self.c_alpha) / math.gamma(1.0 - α)
        k = c * np.append(weight, w[:-1])
        tau = np.append(weight / moment, 1.0 / s[:-1])
        c_0 = c * w[-1] / s[-1] / -math.expm1(-(1.0 - α) * η)
        bound = rule(η) + slow(s_0 * t_max) + fast(float(s[-1]) * t_min)
        return Prony(0.0, tuple(k.tolist()), tuple(tau.tolist())), float(c_0), bound
