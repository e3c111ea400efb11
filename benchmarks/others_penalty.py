r"""The contestant "SciPy, penalty" in `others.py`: no modes and no events, but stiff laws in their place.

A contact becomes a Kelvin-Voigt block without tension, ``F = max(0, k δ + c δ')``, a slider ``F = F_0 tanh(v/ε)``, a relay
``tanh(x/ε)``, a diode Shockley's law. The default has a moderate stiffness and the tolerances of `solve_ivp`; tuned, it is
stiffer by orders, with tight tolerances, and with the damping that gives the wanted restitution exactly.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
from others_problems import CASES, Array, Motion, shaken
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from scipy.special import wrightomega

VERSIONS = ("scipy",)


class Law(NamedTuple):
    """How stiff the laws are, and how they are integrated."""

    k: float
    ε: float
    exact: bool
    options: dict

    def contact(self, m: float, e: float) -> Callable[[float, float], float]:
        """Return F(δ, δ') with the restitution e for the effective mass m."""
        c = 2.0 * damping_ratio(e, self.exact) * math.sqrt(self.k * m)
        return lambda δ, rate: max(0.0, self.k * δ + c * rate) if δ > 0.0 else 0.0


def damping_ratio(e: float, exact: bool) -> float:
    """Return ζ of a Kelvin-Voigt contact: of the half period (the usual formula), or of the end without tension."""
    if e == 1.0:
        return 0.0
    usual = -math.log(e) / math.hypot(math.pi, math.log(e))
    if not exact:
        return usual
    return brentq(lambda ζ: math.exp(-2.0 * ζ * math.acos(ζ) / math.sqrt(1.0 - ζ**2)) - e, 1e-6, 0.9)


def solved(rates: Callable, y: Sequence[float], title: str, law: Law) -> tuple[Array, Array]:
    """Return 2001 instants and the states there."""
    t = np.linspace(0.0, CASES[title].t_end, 2001)
    found = solve_ivp(rates, (0.0, t[-1]), y, t_eval=t, **law.options)
    if found.status < 0:
        raise RuntimeError(found.message)
    return t, found.y.T


def ball(title: str, law: Law) -> Motion:
    """Return the bouncing ball on a floor of springs and dashpots."""
    force = law.contact(1.0, 0.8)
    t, y = solved(lambda t, y: [y[1], 9.81 - force(y[0] - 1.0, y[1])], [0.0, 0.0], title, law)
    return Motion(t, y[:, :1], y[:, 1:])


M, K, K_O, C, C_O, G = 100.0, 1962.0, 3924.0, 125.0, 250.0, 9.81
V_O = math.sqrt(2.0 * G * 5.0)


def system_1(title: str, law: Law) -> Motion:
    """Return System 1 with a stiff spring between the body and its massless plate."""

    def force(y):
        return law.k * np.maximum(y[0] - y[2], 0.0)

    def rates(t, y):
        return [y[1], G - force(y) / M, (force(y) - K_O * y[2]) / C_O]

    t, y = solved(rates, [0.0, V_O, 0.0], title, law)
    return Motion(t, y[:, :1], y[:, 1:2], force(y.T))


def system_3(title: str, law: Law) -> Motion:
    """Return System 3 with a stiff spring between its two massless plates."""

    def force(s):
        return law.k * np.maximum(s[2] - s[3], 0.0)

    def rates(t, s):
        R = force(s)
        return [s[1], G - R / M, s[1] - (K * (s[2] - s[0]) + R) / C, (R - K_O * s[3]) / C_O]

    t, s = solved(rates, [0.0, V_O, 0.0, 0.0], title, law)
    return Motion(t, s[:, :1], s[:, 1:2], force(s.T))


def impact_oscillator(title: str, law: Law) -> Motion:
    """Return the oscillator that strikes a stiff stop."""
    start, force = float(CASES[title].problem.v0["x"]), law.contact(1.0, 0.8)

    def rates(t, y):
        return [y[1], shaken(t) - y[0] - 0.1 * y[1] - force(y[0], y[1])]

    t, y = solved(rates, [0.0, start], title, law)
    return Motion(t, y[:, :1], y[:, 1:])


def row(masses: Sequence[float], gaps: Sequence[float], wall: float | None, v: Sequence[float], title: str, law: Law):
    """Return bodies in a row with elastic contacts between them, and with a wall if there is one."""
    n, masses, gaps = len(masses), np.array(masses), np.array(gaps)

    def rates(t, y):
        between = law.k * np.maximum(y[: n - 1] - y[1:n] - gaps, 0.0)
        push = np.concatenate([[0.0], between]) - np.concatenate([between, [0.0]])
        if wall is not None:
            push[-1] -= law.k * max(y[n - 1] - wall, 0.0)
        return np.concatenate([y[n:], push / masses])

    t, y = solved(rates, [*np.zeros(n), *v], title, law)
    return Motion(t, y[:, :n], y[:, n:])


def coulomb(title: str, law: Law) -> Motion:
    """Return the oscillator with a slider without a step."""
    t, y = solved(lambda t, y: [y[1], -100.0 * y[0] - 5.0 * math.tanh(y[1] / law.ε)], [0.53, 0.0], title, law)
    return Motion(t, y[:, :1], y[:, 1:])


def incline(title: str, law: Law) -> Motion:
    """Return the block on the incline, which its friction lets creep."""
    α, g = math.pi / 6.0, 9.81

    def rates(t, y):
        return [y[1], g * (math.sin(α) - 0.7 * math.cos(α) * math.tanh(y[1] / law.ε))]

    t, y = solved(rates, [0.0, 2.0], title, law)
    still = np.zeros((len(t), 1))
    return Motion(t, np.hstack([y[:, :1], still]), np.hstack([y[:, 1:], still]))


def bridge_current(v: float, w: float, R: float = 1e3, I_s: float = 1e-12) -> float:
    r"""Return the current in A into a bridge of four diodes of Shockley's law ``i = I_s (exp(v/w) - 1)``.

    With half the bridge's voltage a = v/2 and half the resistor's voltage s, the currents at its outlet give
    ``2 I_s (exp(-s/w) cosh(a/w) - 1) = 2 s/R``, which Wright's ω function solves.
    """
    a = abs(v) / (2.0 * w)
    log_cosh = a + math.log1p(math.exp(-2.0 * a)) - math.log(2.0)
    small = I_s * R / w
    s = w * (wrightomega(math.log(small) + small + log_cosh).real - small)
    return 2.0 * (s / R + I_s) * math.tanh(v / (2.0 * w))


def diode_bridge(title: str, law: Law) -> Motion:
    """Return the bridge of four diodes of Shockley's law, where ε is the thermal voltage in V."""
    L, C_F = 1e-2, 1e-6
    t, y = solved(lambda t, y: [-(y[1] + bridge_current(y[0], law.ε)) / C_F, y[0] / L], [10.0, 0.0], title, law)
    return Motion(t, y[:, :1], np.zeros((len(t), 1)))


def filippov(title: str, law: Law) -> Motion:
    """Return the relay without a step."""
    t, y = solved(lambda t, y: [2.0 - t - math.tanh(y[0] / law.ε)], [-1.5], title, law)
    return Motion(t, y, y)


RUNS: dict[str, Callable[[str, Law], Motion]] = {
    "bouncing-ball": ball,
    "bouncing-ball to rest": ball,
    "system-1": system_1,
    "system-3": system_3,
    "impact-oscillator": impact_oscillator,
    "newtons-cradle": partial(row, [1.0] * 5, [0.1, 0.01, 0.01, 0.01], None, [1.0, 0.0, 0.0, 0.0, 0.0]),
    "pi-billiard": partial(row, [100.0, 1.0], [1.0], 1.0, [1.0, 0.0]),
    "coulomb-oscillator": coulomb,
    "block-on-incline": incline,
    "diode-bridge": diode_bridge,
    "filippov": filippov,
}

ABSENT = {"system-2": "its spring is no penalty but part of the system: see SciPy, events"}

SHOCKLEY = {"diode-bridge": (2.585e-2, 2.585e-4)}
STIFFNESS = {"system-1": (1e5, 1e8), "system-3": (1e5, 1e8)}


def settings(title: str) -> dict[str, tuple[str, partial[Motion]]]:
    """Return the runs of a problem."""
    k, stiff = STIFFNESS.get(title, (1e4, 1e8))
    ε, steep = SHOCKLEY.get(title, (1e-2, 1e-6))
    tight = {"method": "LSODA", "rtol": 1e-9, "atol": 1e-12, "max_step": CASES[title].t_end / 1000.0}
    if title in ("coulomb-oscillator", "block-on-incline", "filippov"):
        said = (f"tanh, ε = {ε:g}", f"tanh, ε = {steep:g}")
    elif title in SHOCKLEY:
        said = (f"Shockley, n V_T = {1e3 * ε:g} mV", f"Shockley, n V_T = {1e3 * steep:g} mV")
    else:
        said = (f"k = {k:g} N/m", f"k = {stiff:g} N/m")
    default, tuned = Law(k, ε, False, {}), Law(stiff, steep, True, tight)
    return {
        "default": (f"{said[0]}, RK45, rtol = 1e-3", partial(RUNS[title], title, default)),
        "tuned": (f"{said[1]}, LSODA, rtol = 1e-9", partial(RUNS[title], title, tuned)),
    }
