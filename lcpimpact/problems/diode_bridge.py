r"""Four diodes, a resistor and an oscillating circuit: complementarity outside mechanics."""

from __future__ import annotations

import math
from functools import partial
from typing import Annotated

import numpy as np
from scipy.optimize import brentq

from lcpimpact.arrays import Array
from lcpimpact.formula import sqrt
from lcpimpact.problems.base import Problem, above_zero
from lcpimpact.problems.facts import Fact
from lcpimpact.problems.free_vibration import angle, free_vibration
from lcpimpact.problems.registered import registered
from lcpimpact.reading import at, crossing, instant, peak
from lcpimpact.record import State
from lcpimpact.scheme.signals import Harmonic
from lcpimpact.scheme.system import LinearComplementaritySystem


@registered
def diode_bridge(
    L: Annotated[float, "H, inductance"] = 1e-2,
    C: Annotated[float, "F, capacitance"] = 1e-6,
    R: Annotated[float, "Ω, resistance"] = 1e3,
    v0: Annotated[float, "V, voltage at the start"] = 10.0,
) -> Problem:
    r"""A full-wave rectifier: whichever way the current flows, the resistor sees it in one direction.

    The capacitor (voltage v_L, v0 at the start) and the inductor (current i_L, 0 at the start) form an oscillator; the
    bridge of four ideal diodes hangs between its ends 1 and 2, the resistor between the bridge's outlets + and -.

    - ``C v_L' = -i_L - (i_DR2 - i_DF2)`` and ``L i_L' = v_L``,
    - each diode: ``0 <= -v ⟂ i >= 0``, its voltage backwards against its current.

    Diodes F go from 1 or 2 to +, diodes R from - to 1 or 2. With ``λ = (-v_DR1, -v_DF1, i_DF2, i_DR2)``, the resistor's
    voltage is ``λ_1 + λ_2``, and Kirchhoff's laws give ``w = C x + D λ`` for the partners
    ``(i_DR1, i_DF1, -v_DF2, -v_DR2)``, with D positive semidefinite, though not symmetric.

    There is no threshold, so two diodes always conduct: the resistor has the voltage ``|v_L|`` and the circuit feels it as
    if the bridge were not there, a damped oscillation with ``ω = 1/sqrt(L C)`` and ``ζ = sqrt(L/C)/(2 R)``:

    - ``v_L = v0 S'(t)`` and ``i_L = v0 S(t)/L``, where S is the free vibration with S(0) = 0, S'(0) = 1,
    - the diodes change over first at ``ω t = acos ζ/sqrt(1 - ζ²)``.

    What to learn: the same step, LCP and solvers run circuits, with the relative degree 0 everywhere. The trap is a smooth
    diode law (exponential, or a stiff resistor), which makes this stiff without making it truer.

    Raises
    ------
    InputError
        If a parameter is not above zero.

    Examples
    --------
    >>> [round(fact.value, 9) for fact in diode_bridge().facts]
    [0.000152268, 0.79032282, -0.00264785, 0.79032282]

    References
    ----------
    Acary and Brogliato, *Numerical Methods for Nonsmooth Dynamical Systems* (2008), the four-diode bridge rectifier.
    """
    name = "diode-bridge"
    above_zero(name, L=L, C=C, R=R, v0=v0)
    system = LinearComplementaritySystem(
        A=[[0.0, -1.0 / C], [1.0 / L, 0.0]],
        B=[[0.0, 0.0, 1.0 / C, -1.0 / C], [0.0, 0.0, 0.0, 0.0]],
        C=[[0.0, 0.0], [0.0, 0.0], [1.0, 0.0], [-1.0, 0.0]],
        D=[
            [1.0 / R, 1.0 / R, 0.0, -1.0],
            [1.0 / R, 1.0 / R, -1.0, 0.0],
            [0.0, 1.0, 0.0, 0.0],
            [1.0, 0.0, 0.0, 0.0],
        ],
        states=("v_L", "i_L"),
        multipliers=("-v_DR1", "-v_DF1", "i_DF2", "i_DR2"),
    )
    ω: float = 1.0 / sqrt(L * C)
    ζ: float = sqrt(L / C) / (2.0 * R)

    def t_end() -> float:
        # Until the slowest part has decayed to exp(-2.5), and no more than eight periods.
        slowest = ζ if ζ < 1.0 else 1.0 / (ζ + math.sqrt((ζ - 1.0) * (ζ + 1.0)))
        return min(50.0, 2.5 / slowest) / ω

    def facts() -> tuple[Fact, ...]:
        t = t_end()
        v, i = map(float, motion(np.array([t]))[0][0])
        return (
            Fact("t_1", "diodes change over", angle(ζ) / ω, "s", partial(crossing, series="v_L", direction=-1.0)),
            Fact("v_L", "voltage at t_end", v, "V", partial(at, series="v_L", t=t), scale=v0),
            Fact("i_L", "current at t_end", i, "A", partial(at, series="i_L", t=t), scale=v0 * math.sqrt(C / L)),
            Fact(
                "v_R",
                "voltage of the resistor at t_end",
                abs(v),
                "V",
                partial(at, series=_resistor_voltage, t=t),
                scale=v0,
            ),
        )

    def motion(t: Array) -> tuple[Array, Array]:
        S, _, dS = free_vibration(t, ω, ζ)
        v, i = v0 * dS, v0 / L * S
        return np.column_stack([v, i]), np.column_stack([-v0 * ω * (2.0 * ζ * dS + ω * S), v / L])

    return Problem(
        name,
        system,
        q0={"v_L": v0},
        t_end=t_end,
        source="AcaryBrogliato2008, the four-diode bridge rectifier",
        facts=facts,
        motion=motion,
    )


@registered
def diode_bridge_supply(
    V0: Annotated[float, "V, amplitude of the supply"] = 10.0,
    omega: Annotated[float, "rad/s, circular frequency ω of the supply"] = 1e4,
    C: Annotated[float, "F, capacitance of the filter"] = 300e-9,
    R: Annotated[float, "Ω, resistance of the load"] = 1e3,
) -> Problem:
    r"""A rectifier with a filter: four diodes between an alternating supply and a capacitor with its load.

    The supply ``V = V0 sin ω t`` is connected to the ends 1 and 2 of the bridge, the capacitor (voltage v) and the load to
    its outlets + and -. Diodes F1 and R1 go from 1 and 2 to +, R2 and F2 from - to 1 and 2. With
    ``λ = (i_DR1, -v_DF2, i_DF1, i_DR2)`` Kirchhoff's laws are

    - ``C v' = -v/R + λ_1 + λ_3`` and ``0 <= λ ⟂ (v - λ_2, λ_1 + λ_3 - λ_4, v - λ_2 - V, λ_2 + V) >= 0``.

    Two diodes conduct while the supply lifts the capacitor, v = |V|, up to where their current ``C v' + v/R`` falls to zero,

    - ``ω t_o = π - atan ω R C``, and then all four block, ``v = V0 sin(ω t_o) exp(-(t - t_o)/(R C))``,
    - until t_c in the next half period, the root of ``v = |V|``. The run begins between the two, on the periodic motion.

    What to learn: no diode's law has its own multiplier in it, and sums of them have none at all, so that the relative
    degree is not that of the single rows and changes with the diodes that conduct. While all block, nothing determines at
    what voltage the bridge floats: λ_2 is one of many, and v does not feel it. The trap is a solver that wants the matrix of
    the LCP to be positive definite; a resistor in each diode makes it so, and the circuit stiff.

    Raises
    ------
    InputError
        If a parameter is not above zero.

    Examples
    --------
    >>> [round(fact.value, 9) for fact in diode_bridge_supply().facts]
    [0.000189255, 10.0, 6.256095349, 0.01969143]

    References
    ----------
    Acary and Brogliato, *Numerical Methods for Nonsmooth Dynamical Systems* (2008), the four-diode bridge rectifier; Acary
    and others, An introduction to Siconos (2019), the tutorial DiodeBridgePowSup.
    """
    name = "diode-bridge-supply"
    above_zero(name, V0=V0, omega=omega, C=C, R=R)
    supply, half = Harmonic(V0, omega, -0.5 * math.pi), math.pi / omega
    τ = R * C
    t_o = (math.pi - math.atan(omega * τ)) / omega
    top = V0 * math.sin(omega * t_o)
    start = top * math.exp(-(half - t_o) / τ)
    # The diodes conduct again within the quarter in which |V| rises.
    t_c = float(brentq(lambda t: start * math.exp(-t / τ) - V0 * math.sin(omega * t), 0.0, 0.5 * half, xtol=1e-20))

    def facts() -> tuple[Fact, ...]:
        t_m = 0.5 * (t_c + t_o)
        current = C * V0 * (omega * math.cos(omega * t_m) + math.sin(omega * t_m) / τ)
        return (
            Fact("t_o", "the diodes block", t_o, "s", partial(instant, kind="open", contact="i_DF1")),
            Fact("v_max", "greatest voltage of the load", V0, "V", partial(peak, series="v")),
            Fact("v_0", "voltage after half a period", start, "V", partial(at, series="v", t=half)),
            Fact("i_m", "current in the middle of its time", current, "A", partial(at, series="i_DF1", t=t_m)),
        )

    return Problem(
        name,
        LinearComplementaritySystem(
            A=[[-1.0 / τ]],
            B=[[1.0 / C, 0.0, 1.0 / C, 0.0]],
            C=[[1.0], [0.0], [1.0], [0.0]],
            D=[[0.0, -1.0, 0.0, 0.0], [1.0, 0.0, 1.0, -1.0], [0.0, -1.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0]],
            c=[0.0, 0.0, -supply, supply],
            states=("v",),
            multipliers=("i_DR1", "-v_DF2", "i_DF1", "i_DR2"),
        ),
        q0={"v": start},
        t_end=2.8 * half,
        source="AcaryBrogliato2008, the four-diode bridge rectifier; Siconos2019, the tutorial DiodeBridgePowSup",
        facts=facts,
    )


def _resistor_voltage(state: State) -> Array:
    """Return -v_DR1 - v_DF1, the voltage of the resistor."""
    return state.reaction[:, 0] + state.reaction[:, 1]
