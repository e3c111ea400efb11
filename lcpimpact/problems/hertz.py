r"""Hertzian point contact: non-linear springs with and without loss."""

from __future__ import annotations

import math
from functools import partial
from typing import Annotated

from scipy.optimize import brentq
from scipy.special import beta, lambertw

from lcpimpact.arrays import Array
from lcpimpact.errors import InputError
from lcpimpact.problems.base import Problem, above_zero
from lcpimpact.problems.facts import Fact
from lcpimpact.problems.registered import registered
from lcpimpact.reading import Readable, at, crossing, peak
from lcpimpact.record import State
from lcpimpact.scheme.elements.base import GROUND
from lcpimpact.scheme.elements.hertz_spring import HertzSpring
from lcpimpact.scheme.elements.hunt_crossley import HuntCrossley
from lcpimpact.scheme.elements.mass import Mass
from lcpimpact.scheme.scheme import Scheme


@registered
def hertz_impact(
    m: Annotated[float, "kg, mass"] = 0.0327,
    K: Annotated[float, "N/mⁿ, stiffness, for a sphere on a wall 4/3 E* sqrt(R)"] = 1.54e10,
    n: Annotated[float, "1, exponent, at least 1; n = 1 is the linear spring with T = π sqrt(m/K)"] = 1.5,
    v0: Annotated[float, "m/s, speed at first touch"] = 1.0,
) -> Problem:
    r"""A ball strikes a wall by Hertz's law, Eq. (1): the contact time depends on the speed.

    ``m δ'' = -K δⁿ`` while δ > 0, with n = 3/2 for smooth bodies. The energy gives the rest:

    - largest penetration ``δ_max = ((n + 1) m v0²/(2 K))^(1/(n + 1))``, for n = 3/2 ``(5 m v0²/(4 K))^(2/5)``,
    - contact time ``T = 2/(n + 1) B(1/(n + 1), 1/2) δ_max/v0``, for n = 3/2 ``2.94327518 δ_max/v0``,
    - greatest force ``F_max = K δ_maxⁿ``, and the ball returns with v0.

    So T goes as v0^(-1/5): faster impacts are shorter, and F_max as v0^(6/5). The defaults are a steel ball of radius
    10 mm on a steel wall at 1 m/s: 0.023 mm, 0.069 ms, 1.75 kN. The law is smooth but for its second derivative at δ = 0,
    and that is the trap: a Runge-Kutta step across it drops to a lower order, whatever its name.

    Raises
    ------
    InputError
        If m, K or v0 is not above zero, or n < 1.

    Examples
    --------
    >>> [round(fact.value, 9) for fact in hertz_impact(m=1.0, K=1.0).facts]
    [1.093362074, 3.21806546, 1.14326263, 1.0]

    References
    ----------
    Johnson, *Contact Mechanics* (1985), section 11.4.
    """
    name = "hertz-impact"
    above_zero(name, v0=v0)
    scheme = Scheme(Mass("x", m), HertzSpring("x", GROUND, K, n))

    def contact() -> tuple[float, float]:
        """Return δ_max and T."""
        δ_max = ((n + 1.0) * m * v0**2 / (2.0 * K)) ** (1.0 / (n + 1.0))
        return δ_max, 2.0 / (n + 1.0) * float(beta(1.0 / (n + 1.0), 0.5)) * δ_max / v0

    def t_end() -> float:
        return 1.5 * contact()[1]

    def facts() -> tuple[Fact, ...]:
        δ_max, T = contact()
        return (
            Fact("δ_max", "largest penetration", δ_max, "m", partial(peak, series="x")),
            Fact("T", "contact time", T, "s", partial(crossing, series="x", direction=-1.0)),
            Fact("F_max", "greatest force", K * δ_max**n, "N", _greatest_push),
            Fact("e", "restitution", 1.0, "", partial(_rebound, unit=v0)),
        )

    return Problem(name, scheme, v0={"x": v0}, t_end=t_end, source="Johnson1985, section 11.4", facts=facts)


@registered
def hunt_crossley_impact(
    m: Annotated[float, "kg, mass"] = 0.0327,
    K: Annotated[float, "N/mⁿ, stiffness"] = 1.54e10,
    b: Annotated[float, "s/m, loss"] = 0.3,
    n: Annotated[float, "1, exponent, at least 1"] = 1.5,
    v0: Annotated[float, "m/s, speed at first touch"] = 1.0,
) -> Problem:
    r"""Elastic ball with Hunt and Crossley's loss: a restitution that falls with the speed, in closed form.

    ``m δ'' = -K δⁿ (1 + b δ')`` while δ > 0. With ``a = b v0`` the velocity as a function of the penetration integrates to
    ``b δ' - ln(1 + b δ') = a - ln(1 + a) - K b² δⁿ⁺¹/((n + 1) m)``, so

    - ``δ_maxⁿ⁺¹ = (n + 1) m (a - ln(1 + a))/(K b²)``,
    - ``e = (1 + W_0(-(1 + a) exp(-(1 + a))))/a``, with Lambert's W_0,
    - ``F_max = K δⁿ (1 + w)`` where w = b δ' solves ``n w + (n + 1)(w - ln(1 + w)) = (n + 1)(a - ln(1 + a))``.

    e depends on ``a`` alone, and is about ``1 - 2a/3`` for small ``a``: hence the usual ``b = 3 (1 - e)/(2 v0)``, which is
    not the truth for low e (asked for 1/2 it gives 0.66). Unlike the dashpot of Kelvin and Voigt, the force starts from
    zero and never pulls. The trap is to take the e of one speed as a constant of the material.

    Raises
    ------
    InputError
        If m, K, b or v0 is not above zero, or n < 1.

    Examples
    --------
    >>> [round(fact.value, 9) for fact in hunt_crossley_impact(m=1.0, K=1.0).facts]
    [1.017932928, 0.832869792, 1.05831467]

    References
    ----------
    Hunt and Crossley, Coefficient of restitution interpreted as damping in vibroimpact (1975).
    """
    name = "hunt-crossley-impact"
    above_zero(name, v0=v0)
    scheme = Scheme(Mass("x", m), HuntCrossley("x", GROUND, K, b, n))
    a = b * v0
    if a < 1e-4:
        raise InputError(f"{name}: b v0 = {a:g} is so small that e = 1 to rounding; take hertz-impact")

    def contact() -> tuple[float, float]:
        """Return δ_max and e."""
        δ_max = ((n + 1.0) * m * (a - math.log1p(a)) / (K * b**2)) ** (1.0 / (n + 1.0))
        return δ_max, (1.0 + float(lambertw(-(1.0 + a) * math.exp(-(1.0 + a))).real)) / a

    def t_end() -> float:
        δ_max, e = contact()
        return 6.0 * δ_max / v0 / math.sqrt(e)

    def facts() -> tuple[Fact, ...]:
        δ_max, e = contact()
        lost = a - math.log1p(a)
        w = brentq(lambda w: n * w + (n + 1.0) * (w - math.log1p(w) - lost), 0.0, a, xtol=1e-16)
        F_max = n * m * w / b**2 * (1.0 + w) / (n * m * w / (K * b**2)) ** (1.0 / (n + 1.0))
        return (
            Fact("δ_max", "largest penetration", δ_max, "m", partial(peak, series="x")),
            Fact("e", "restitution", e, "", partial(_rebound, unit=v0)),
            Fact("F_max", "greatest force", F_max, "N", _greatest_push),
        )

    return Problem(
        name,
        scheme,
        v0={"x": v0},
        t_end=t_end,
        source="HuntCrossley1975",
        facts=facts,
    )


def _rebound(run: Readable, unit: float) -> float:
    """Return the speed at which x falls through zero again, in a unit."""
    return -at(run, "v_x", crossing(run, "x", direction=-1.0)) / unit


def _greatest_push(run: Readable) -> float:
    """Return the greatest force of the spring."""
    dynamics = run.problem.dynamics

    def push(state: State) -> Array:
        return -dynamics.spring_force(state.q, state.v)[:, 0]

    return peak(run, push)
