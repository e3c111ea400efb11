r"""A buck converter with pulse width modulation: a switch that compares a voltage with a sawtooth."""

from __future__ import annotations

import math
from functools import partial
from typing import Annotated

import numpy as np
from scipy.linalg import expm
from scipy.optimize import brentq

from lcpimpact.arrays import Array
from lcpimpact.errors import InputError
from lcpimpact.problems.base import Problem, above_zero, whole
from lcpimpact.problems.facts import Fact
from lcpimpact.problems.registered import registered
from lcpimpact.reading import at, instant
from lcpimpact.scheme.signals import Table
from lcpimpact.scheme.system import LinearComplementaritySystem


@registered
def buck_converter(
    E: Annotated[float, "V, voltage of the source"] = 22.0,
    L: Annotated[float, "H, inductance"] = 20e-3,
    C: Annotated[float, "F, capacitance"] = 47e-6,
    R: Annotated[float, "Ω, resistance of the load"] = 22.0,
    V_ref: Annotated[float, "V, voltage that is wanted"] = 11.3,
    a: Annotated[float, "1, amplification of the error"] = 8.4,
    V_L: Annotated[float, "V, lower voltage of the sawtooth"] = 3.8,
    V_U: Annotated[float, "V, upper voltage of the sawtooth"] = 8.2,
    T: Annotated[float, "s, period"] = 400e-6,
    periods: Annotated[float, "1, whole number of periods of the sawtooth, with which the run ends"] = 4.0,
) -> Problem:
    r"""A direct voltage made smaller by a switch: its control is stable, doubles its period, and becomes chaotic.

    A switch (relay λ in [0, 1]) puts the source E on an inductor, which feeds a capacitor and a load; while it is open a
    diode carries the current on, ``0 <= λ_D ⟂ i >= 0``:

    - ``C v' = i - v/R`` and ``L i' = E λ - v + λ_D``,
    - the switch is closed while the sawtooth is above the amplified error, ``y = v - V_ref - s(t)/a < 0``, where s rises
      from V_L to V_U in each period T and falls back at its end.

    In the motion of period T the switch is open for a time δ, and closed for the rest of the period. With ``X = (v, i)``,
    ``X' = A X + b E λ`` and ``Φ = exp(A T)``

    - ``X(0) = (I - Φ)⁻¹ A⁻¹ (exp(A (T - δ)) - I) b E``,
    - and δ is where ``y = 0``: ``v(δ) = V_ref + (V_L + (V_U - V_L) δ/T)/a``, with ``X(δ) = exp(A δ) X(0)``.

    The run begins on it. What to learn: the mean voltage is nearly independent of E, as the control wants; but for E above
    24.52 V the motion of period T is not stable, and one of period 2 T is, then 4 T, and chaos from 32 V on. A relay of
    relative degree 2 whose input jumps, and a diode, say this exactly. The trap is the averaged model, a linear circuit with
    the duty cycle as its input, which is stable at any E.

    Raises
    ------
    InputError
        If a parameter but V_L is not above zero, V_U is not above V_L, the number of periods is not whole, or no motion of
        period T switches once and keeps its current.

    Examples
    --------
    >>> [round(fact.value, 9) for fact in buck_converter().facts]
    [0.000182045, 11.998231708, 0.599635798]

    References
    ----------
    Fossas and Olivar, Study of chaos in the buck converter (1996); di Bernardo, Garofalo, Glielmo and Vasca, Switchings,
    bifurcations, and chaos in DC/DC converters (1998).
    """
    name = "buck-converter"
    above_zero(name, E=E, L=L, C=C, R=R, V_ref=V_ref, a=a, T=T)
    count = whole(name, "periods", periods)
    if not V_U > V_L:
        raise InputError(f"{name}: V_U = {V_U:g} must be above V_L = {V_L:g}")
    A = np.array([[-1.0 / (R * C), 1.0 / C], [-1.0 / L, 0.0]])
    source = np.linalg.solve(A, np.array([0.0, E / L]))

    def start(δ: float) -> Array:
        """Return X(0) of the motion of period T with the switch open until δ."""
        return np.linalg.solve(np.eye(2) - expm(A * T), expm(A * (T - δ)) @ source - source)

    def error(δ: float) -> float:
        """Return y at δ."""
        return float(a * ((expm(A * δ) @ start(δ))[0] - V_ref) - V_L - (V_U - V_L) * δ / T)

    if not error(0.0) > 0.0 > error(T):
        raise InputError(
            f"{name}: with E = {E:g} no motion of period T switches once in it; take another E, a or V_ref"
        )
    δ = float(brentq(error, 0.0, T, xtol=1e-16 * T, rtol=8.9e-16))
    X = start(δ)
    if not min(X[1], (expm(A * δ) @ X)[1]) > 0.0:
        raise InputError(f"{name}: with R = {R:g} the current stops in each period; take a smaller R or a larger L")
    edges: Array = T * np.arange(count + 1, dtype=np.float64)
    sawtooth = Table(tuple(np.repeat(edges, 2)[1:-1].tolist()), tuple(count * [-V_ref - V_L / a, -V_ref - V_U / a]))

    def facts() -> tuple[Fact, ...]:
        return (
            Fact("δ", "time for which the switch is open", δ, "s", partial(instant, kind="switch")),
            Fact("v_0", "voltage at the start of a period", float(X[0]), "V", partial(at, series="v", t=T)),
            Fact("i_0", "largest current", float(X[1]), "A", partial(at, series="i", t=T)),
        )

    def motion(t: Array) -> tuple[Array, Array]:
        b = np.array([0.0, E / L])
        times = np.asarray(t, dtype=np.float64)
        s = times - edges[np.clip(np.searchsorted(edges, times, side="right") - 1, 0, len(edges) - 2)]
        closed = s >= δ
        begun = np.where(closed[:, None], expm(A * δ) @ X + source, X)
        equilibrium = np.where(closed[:, None], source, 0.0)
        # exp(A s) = exp(σ s) (cos ω s + (A - σ) sin(ω s)/ω)
        σ = 0.5 * np.trace(A)
        ω = np.sqrt(complex(np.linalg.det(A) - σ**2))
        since = np.where(closed, s - δ, s)[:, None]
        turned = np.cos(ω * since) * begun + np.sin(ω * since) / ω * (begun @ (A - σ * np.eye(2)).T)
        found = np.exp(σ * since) * turned.real - equilibrium
        c, rate = sawtooth.derivatives(times).T
        return np.column_stack([found, c]), np.column_stack([found @ A.T + closed[:, None] * b, rate])

    return Problem(
        name,
        LinearComplementaritySystem(
            A, [[0.0, 0.0], [E / L, 1.0 / L]], [[1.0, 0.0], [0.0, 1.0]], c=[sawtooth, 0.0], states=("v", "i"),
            multipliers=("λ", "λ_D"), lower=[0.0, 0.0], upper=[1.0, math.inf],
        ),
        q0={"v": float(X[0]), "i": float(X[1])},
        t_end=count * T,
        source="FossasOlivar1996",
        facts=facts,
        motion=motion,
    )  # fmt: skip
