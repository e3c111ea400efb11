"""Projects of the course: data that `exact` computes and random numbers blur, and what they ask for; none is measured."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from lcpimpact.arrays import Array
from lcpimpact.numbers import random_numbers
from lcpimpact.problems import load_problem
from lcpimpact.problems.base import Problem
from lcpimpact.simulation import simulate
from lcpimpact.trajectory import Trajectory

Data = dict[str, Array]
"""Columns of a data set by their names, in SI units."""


@dataclass(frozen=True)
class Project:
    """A project with data.

    Attributes
    ----------
    title : str
    asks : str                  the task in a sentence
    noise : mapping             column to the standard deviation of its noise, in SI units; other columns have none
    exact : callable            returns the data without noise
    """

    title: str
    asks: str
    noise: Mapping[str, float]
    exact: Callable[[], Data]

    def data(self, seed: int = 0) -> Data:
        """Return the data with normal noise, the same for the same seed, rounded to a tenth of it.

        Raises
        ------
        InputError
            For a seed that is no whole number, or negative.
        """
        random = random_numbers(seed)
        data = self.exact()
        for name, sigma in self.noise.items():
            digits = math.ceil(-math.log10(sigma)) + 1
            data[name] = np.round(data[name] + random.normal(0.0, sigma, len(data[name])), digits)
        return data


def _exact(problem: Problem, dt: float, t_end: float) -> Trajectory:
    return simulate(problem, "exact", dt=dt, t_end=t_end, progress=False, error=False)


def _bounces() -> Data:
    run = _exact(load_problem("bouncing-ball", H=0.5, e=0.72), 1e-2, 1.9)
    t = np.array([event.t for event in run.events if event.kind == "impact"])[:10]
    return {"n": 1.0 + np.arange(10), "t": t}


def _buffer() -> Data:
    run = _exact(load_problem("system-1", m=80.0, k_o=6000.0, c_o=300.0, h_o=1.2), 2e-3, 0.3)
    return {"t": run.t, "R": np.array(run["R"])}


def _belt() -> Data:
    run = _exact(load_problem("stick-slip-belt", m=2.0, k=180.0, mu=0.25, mu_s=0.42, v_b=0.15), 1e-2, 6.0)
    return {"t": run.t, "x": np.array(run["x"])}


def _slope() -> Data:
    run = _exact(load_problem("block-on-incline", alpha=math.radians(20.0), mu=0.5, v0=3.0), 2e-2, 3.0)
    return {"t": run.t, "x": np.array(run["x"])}


def _stop(*, omega: float = 0.8, settled: int = 20, periods: int = 22, points: int = 200) -> Data:
    # settled, periods: periods of the force after which the vibration is steady, and of the run; points: of a period.
    period = 2.0 * math.pi / omega
    f = np.arange(10, 37, 2) / 100
    problems = [load_problem("shaw-holmes", zeta=0.08, omega=omega, s=1.0, x0=0.0, f=float(each)) for each in f]
    runs = [_exact(each, period / points, periods * period) for each in problems]
    return {"f": f, "x_max": np.array([each["x"][settled * points :].max() for each in runs])}


BOUNCES = Project(
    "a ball heard",
    "from the instants of ten impacts, find e and the height of the fall with their uncertainties, and when the ball rests",
    {"t": 1e-3},
    _bounces,
)
BUFFER = Project(
    "a buffer to be tuned",
    "from the force of the first contact, find k_o and c_o of System 1 with m = 80 kg and h_o = 1.2 m, then the c_o of the "
    "smallest peak",
    {"R": 40.0},
    _buffer,
)
BELT = Project(
    "a block on a belt",
    "from the place of a block of 2 kg on a belt with 0.15 m/s, find k, mu and mu_s",
    {"x": 3e-4},
    _belt,
)
SLOPE = Project(
    "a block comes to rest",
    "from the way of a block down a slope of 20 degrees, find its first velocity and mu, and the friction when it rests",
    {"x": 2e-3},
    _slope,
)
STOP = Project(
    "a stop that is not yet touched",
    "from the greatest x of a steady vibration with m = 1 kg, k = 1 N/m, omega = 0.8 rad/s below its stop at 1 m, find the "
    "damping and the force that reaches the stop",
    {"x_max": 5e-3},
    _stop,
)
