r"""The twelve problems of `others.py`: their truth, and the quantity that a user would ask for.

All are problems of the registry with its default parameters. A contestant returns a `Motion` in the registry's
coordinates (positive downwards), at instants of its own; its errors are taken there.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.integrate import trapezoid

import lcpimpact as li

Array = np.ndarray


class Motion(NamedTuple):
    """What a contestant found.

    Attributes
    ----------
    t : ndarray, shape (nt,)
        Its instants in s, the first at the start; the last is that at which it stopped.
    q, v : ndarray, shape (nt, n)
        Coordinates, and their rates.
    force : ndarray, shape (nf,), optional
        The contact force in N, at instants of its own; only its greatest value is read.
    seconds : float, optional
        CPU time, by those who measure it themselves.
    """

    t: Array
    q: Array
    v: Array
    force: Array | None = None
    seconds: float | None = None


@dataclass(frozen=True)
class Case:
    """One problem: which coordinates are compared, over which time, and the quantity asked for.

    Attributes
    ----------
    name : str
        The registered problem.
    what : str
        The problem in a few words, and why it is here.
    t_end : float
        End in s.
    columns : tuple of str
        The coordinates that are compared, which have one unit.
    unit : str
        Their unit.
    asked : str
        The quantity that a user asks for, with its unit.
    quantity : callable
        ``quantity(motion)``: its value in a run.
    value : float
        Its true value, from the closed form.
    motion : callable, optional
        ``motion(t)``: the true q and v, where the registry has no closed form of the whole motion.
    rates : bool
        Whether v is compared.
    """

    name: str
    what: str
    t_end: float
    columns: tuple[str, ...]
    unit: str
    asked: str
    quantity: Callable[[Motion], float]
    value: float
    motion: Callable[[Array], tuple[Array, Array]] | None = None
    rates: bool = True

    @cached_property
    def problem(self) -> li.Problem:
        """The registered problem."""
        return li.load_problem(self.name)

    @property
    def known(self) -> bool:
        """Whether the whole motion is known in closed form; the truth is that of `exact` otherwise."""
        return self.motion is not None or self.problem.motion is not None

    @cached_property
    def scale(self) -> float:
        """The greatest |q| of the true motion."""
        return float(np.max(np.abs(self.truth(np.linspace(0.0, self.t_end, 2001))[0])))

    def truth(self, t: Array) -> tuple[Array, Array]:
        """Return the true q and v at the instants t: closed forms, or samples of `exact` where there are none."""
        if self.known:
            q, v = (self.motion or self.problem.motion)(np.asarray(t))
            return q[:, : len(self.columns)], v[:, : len(self.columns)]
        found = self._exact.sample(np.minimum(t, self.t_end))  # an own grid may end a rounding later
        columns = [self.problem.dynamics.nodes.index(name) for name in self.columns]
        return found.q[:, columns], found.v[:, columns]

    @cached_property
    def _exact(self) -> li.Trajectory:
        return li.simulate(self.problem, "exact", dt=self.t_end / 1000, t_end=self.t_end, progress=False)

    def errors(self, motion: Motion) -> tuple[float, float, float]:
        """Return sup |q - q*|, the integral of max |v - v*| over time (nan without rates), and the quantity's error.

        Instants at which v* itself jumps are left out of the integral: there each of its limits is right.
        """
        (q, v), ε = self.truth(motion.t), 1e-9 * self.t_end
        (_, left), (_, right) = (self.truth(np.clip(motion.t + side, 0.0, self.t_end)) for side in (-ε, ε))
        off = np.max(np.abs(motion.v - v), axis=1) if self.rates else np.full(len(motion.t), math.nan)
        off[np.max(np.abs(right - left), axis=1) > 1e-6] *= 0.0
        return float(np.max(np.abs(motion.q - q))), float(trapezoid(off, motion.t)), self.asked_error(motion)

    def asked_error(self, motion: Motion) -> float:
        """Return how far the quantity is from its true value."""
        return abs(self.quantity(motion) - self.value)


def final(column: int) -> Callable[[Motion], float]:
    """Return the quantity: a coordinate at the end."""
    return lambda motion: float(motion.q[-1, column])


def final_rate(column: int) -> Callable[[Motion], float]:
    """Return the quantity: a velocity at the end."""
    return lambda motion: float(motion.v[-1, column])


def vertex(values: Array) -> float:
    """Return the greatest value at equal spacing, of the parabola through the greatest and its two neighbours."""
    top = int(np.clip(np.argmax(values), 1, len(values) - 2))
    before, here, after = values[top - 1 : top + 2]
    bend = before - 2.0 * here + after
    return float(here - (after - before) ** 2 / (8.0 * bend)) if bend < 0.0 else float(np.max(values))


def peak_force(motion: Motion) -> float:
    """Return the greatest contact force; nan of those who have none to show."""
    return math.nan if motion.force is None else vertex(motion.force)


def rebound_height(motion: Motion) -> float:
    """Return how high the ball rises between its third and its fourth impact."""
    return vertex(1.0 - motion.q[(motion.t > 1.8) & (motion.t < 2.2), 0])


def time_of_rest(motion: Motion) -> float:
    """Return the last instant at which the ball is a millimetre from where it ends; linear between its instants."""
    away = np.abs(motion.q[:, 0] - motion.q[-1, 0]) - 1e-3
    k = np.flatnonzero(away > 0.0)[-1]
    return float(motion.t[k] + (motion.t[k + 1] - motion.t[k]) * away[k] / (away[k] - away[k + 1]))


def last_millimetre(g: float = 9.81, H: float = 1.0, e: float = 0.8, height: float = 1e-3) -> float:
    """Return when the bouncing ball falls through ``height`` for the last time."""
    n = math.floor(math.log(height / H) / (2.0 * math.log(e)))  # the last bounce that is higher
    fall = math.sqrt(2.0 * H / g)
    landing = fall + 2.0 * fall * sum(e**i for i in range(1, n + 1))
    speed = e**n * math.sqrt(2.0 * g * H)
    return landing - (speed - math.sqrt(speed**2 - 2.0 * g * height)) / g


def cradle(t: Array) -> tuple[Array, Array]:
    """Return the cradle with e = 1: the speed of 1 m/s is handed on at 0.10, 0.11, 0.12 and 0.13 s."""
    struck = np.array([0.0, 0.10, 0.11, 0.12, 0.13, math.inf])
    t = t[:, None]
    q = np.clip(t, struck[:-1], struck[1:]) - struck[:-1]
    return q, ((t >= struck[:-1]) & (t < struck[1:])).astype(float)


def fact(name: str, symbol: str) -> float:
    """Return a closed form of a registered problem."""
    return next(each.value for each in li.load_problem(name).facts if each.symbol == symbol)


def shaking() -> tuple[float, float, float]:
    """Return amplitude, angular frequency and phase of the harmonic force of the impact oscillator."""
    load = next(each.f for each in CASES["impact-oscillator"].problem.scheme.elements if isinstance(each, li.Load))
    return load.amplitude, load.omega, load.phase


def shaken(t: float) -> float:
    """Return the harmonic force of the impact oscillator at time t."""
    amplitude, ω, phase = shaking()
    return amplitude * math.cos(ω * t + phase)


def _cases() -> tuple[Case, ...]:
    pi_billiard = li.load_problem("pi-billiard")
    oscillator = li.load_problem("impact-oscillator")
    swing = 12.0
    return (
        Case(
            "bouncing-ball", "four impacts of a ball (e = 0.8) before they accumulate", 2.5, ("x",), "m",
            "height of the third rebound, m", rebound_height, 0.8**6,
        ),
        Case(
            "bouncing-ball", "the same ball through infinitely many impacts to rest", 5.0, ("x",), "m",
            "last millimetre above the floor, s", time_of_rest, last_millimetre(),
        ),
        Case(
            "system-1", "System 1 of the paper: the force jumps", 3.0, ("x",), "m", "peak force, N",
            peak_force, fact("system-1", "R_max"),
        ),
        Case(
            "system-2", "System 2 of the paper: the force has kinks", 3.0, ("x",), "m", "peak force, N",
            peak_force, fact("system-2", "R_max"),
        ),
        Case(
            "system-3", "System 3 of the paper: massless on both sides", 3.0, ("x",), "m", "peak force, N",
            peak_force, fact("system-3", "R_max"),
        ),
        Case(
            "impact-oscillator", "a forced oscillator against a stop (e = 0.8), one impact a period", swing, ("x",), "m",
            "place at the end, m", final(0), float(oscillator.motion(np.array([swing]))[0][0, 0]),
        ),
        Case(
            "newtons-cradle", "five balls with small gaps, e = 1", 0.2, ("x1", "x2", "x3", "x4", "x5"), "m",
            "speed of the last ball, m/s", final_rate(4), 1.0, cradle,
        ),
        Case(
            "pi-billiard", "31 elastic impacts of two balls and a wall, masses 100 : 1", 4.3, ("x1", "x2"), "m",
            "final speed of the heavy ball, m/s", final_rate(0), float(pi_billiard.motion(np.array([4.3]))[1][0, 0]),
        ),
        Case(
            "coulomb-oscillator", "dry friction stops a vibration off its centre", 2.0, ("x",), "m",
            "place at rest, m", final(0), -0.03,
        ),
        Case(
            "block-on-incline", "a block slides down and sticks", 2.8, ("x", "y"), "m",
            "way until it stops, m", final(0), fact("block-on-incline", "s"),
        ),
        Case(
            "diode-bridge", "four ideal diodes", 0.005, ("v_L",), "V", "voltage at the end, V", final(0),
            fact("diode-bridge", "v_L"), rates=False,
        ),
        Case(
            "filippov", "a relay: crossing, sliding, leaving", 3.5, ("x",), "-", "place at the end", final(0), -0.125,
            rates=False,
        ),
    )  # fmt: skip


CASES = {case.name + (" to rest" if case.t_end == 5.0 else ""): case for case in _cases()}
"""The problems by title."""
