"""Basins of attraction: to which attractor each initial state leads."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
import pandas as pd

from lcpimpact.arguments import checked
from lcpimpact.arrays import Array
from lcpimpact.errors import InputError, LcpImpactError
from lcpimpact.hybrid.motion import begin_problem, read
from lcpimpact.numbers import count
from lcpimpact.problems.base import Problem
from lcpimpact.study.dynamics.diagrams import each_of
from lcpimpact.study.dynamics.period import MAX_PERIOD, extents
from lcpimpact.study.dynamics.sections import BLOCK_PERIODS, impact_speeds, impacts_of
from lcpimpact.study.dynamics.shooting import follow_exactly, force_period, refuse_power_laws
from lcpimpact.study.progress import Progress, watched
from lcpimpact.study.result import Study, failure_lines

SAME_ATTRACTOR_RTOL = 1e-2
"""Distance below which two attractors are identified, relative to their extent."""


@dataclass(frozen=True, eq=False, repr=False)
class Basins(Study):
    """Basins of attraction on a grid of initial states.

    Attributes
    ----------
    table : DataFrame
        One row per initial state: its two values, ``attractor`` (numbered by basin size; 0: not converged), its ``period``
        (in periods of the force), ``run`` (periods until convergence) and ``failure``.
    attractors : DataFrame
        One row per point of an attractor: ``attractor``, ``period``, ``share`` (of all initial states), ``point``, the
        coordinates and velocities at phase 0 of the force, and ``speed`` (m/s) of the preceding impact.
    name : str
        Name of the problem.
    longest : int
        Maximum number of periods of the force per run.
    """

    table: pd.DataFrame
    attractors: pd.DataFrame
    name: str
    longest: int

    drawn_by = "lcpimpact.plotting.dynamics:plot_basins"
    title = "Basins of attraction of {0.name}"

    def summary(self) -> str:
        """Return the period of each attractor and the fraction of initial states in its basin."""
        lines = [f"{self.name}: {len(self.table)} starts"]
        for row in self.attractors.drop_duplicates("attractor").to_dict("records"):
            lines.append(f"  attractor {row['attractor']}: period {row['period']}, of {row['share']:.1%} of the starts")
        lost = float((self.table["attractor"] == 0).mean())
        lines += [f"  no period found after {self.longest} periods of the force: {lost:.1%}"] * (lost > 0.0)
        return "\n".join(lines + failure_lines(self.failures))


@checked
def basins(
    family: Callable[[float, float], Problem],
    first: Iterable[float],
    second: Iterable[float],
    *,
    parameters: tuple[str, str] = ("first", "second"),
    longest: int = 400,
    tol: float = 1e-5,
    workers: int | None = None,
    progress: Progress = True,
) -> Basins:
    """Return the basins of attraction over two initial values, by the exact stroboscopic map of the force.

    Each run ends when its points repeat with a period of at most 16, or after ``longest`` periods. Attractors whose points
    agree within a hundredth of their extent are identified.

    Parameters
    ----------
    family : callable
        Takes the two values and returns a Problem with a periodic force.
    first, second : iterable of float
        The grid.
    parameters : pair of str
        Names of the two values.
    longest : int
        Maximum number of periods per run.
    tol : float
        Relative tolerance for the repetition of points.
    workers : int, optional
        Number of threads; one by default.
    progress : bool or callable
        As in `lcpimpact.study.progress`.

    Raises
    ------
    InputError
        For an empty grid or invalid counts.

    Examples
    --------
    >>> from lcpimpact import basins, load_problem
    >>> found = basins(lambda x0, v0: load_problem("shaw-holmes", x0=x0, v0=v0), [-0.5, -0.1], [0.0, 0.5])
    >>> found.table["attractor"].tolist(), found.attractors["period"].tolist()
    ([1, 1, 1, 2], [1, 3, 3, 3])
    """
    count("longest", longest)
    starts = [(float(a), float(b)) for a in first for b in list(second)]
    if not starts:
        raise InputError("first and second must both hold values")

    def one(start: tuple[float, float]) -> tuple[Array, int, str, Problem | None]:
        problem = None
        try:
            problem = family(*start)
            cycle, run = _settled(problem, longest, tol)
        except LcpImpactError as error:
            return np.zeros((0, 0)), 0, str(error), problem
        return cycle, run, "", problem

    ended = list(watched(each_of(one, starts, workers), len(starts), "basins", progress))
    table = pd.DataFrame(starts, columns=list(parameters))
    labels, attractors = _named([cycle for cycle, *_ in ended])
    table = table.assign(
        attractor=labels,
        period=[len(cycle) for cycle, *_ in ended],
        run=[run for _, run, *_ in ended],
        failure=[failure for *_, failure, _ in ended],
    )
    problem = next((problem for *_, problem in ended if problem is not None), None)
    nodes = () if problem is None else problem.dynamics.nodes
    columns = [*nodes, *(f"v_{node}" for node in nodes), "speed"]
    rows = [
        {"attractor": k, "period": len(cycle), "share": labels.count(k) / len(labels), "point": i}
        | dict(zip(columns, point.tolist(), strict=True))
        for k, cycle in enumerate(attractors, start=1)
        for i, point in enumerate(cycle)
    ]
    found = pd.DataFrame(rows, columns=["attractor", "period", "share", "point", *columns])
    return Basins(table, found, "" if problem is None else problem.name, longest)


def _settled(problem: Problem, longest: int, tol: float) -> tuple[Array, int]:
    """Return the ordered points of the attractor of a run, and the number of periods until convergence."""
    force = force_period(problem.dynamics)
    if force is None:
        raise InputError(f"{problem.name} has no force with a period, so it cannot be seen once in each")
    refuse_power_laws(problem)
    motion = begin_problem(problem, "exact", longest * force)
    reached = 0
    while reached < longest:
        reached = min(reached + BLOCK_PERIODS, longest)
        follow_exactly(motion, problem, reached * force)
        times = np.minimum(np.arange(max(0, reached - 2 * MAX_PERIOD), reached + 1) * force, motion.end)
        q, v, _ = read(motion.system, tuple(motion.segments), times, "right")
        z = np.hstack([q, v])
        miss = [_miss(z, p) for p in range(1, MAX_PERIOD + 1)]
        if min(miss) <= tol:
            # In a slow approach with a negative multiplier every other point converges first.
            p = 1 + next(i for i, each in enumerate(miss) if each <= 100.0 * tol)
            speed = impact_speeds(problem.dynamics, motion.events, times[-p:])
            if not any(event.t > times[-1 - p] for event in impacts_of(motion.events, None)):
                speed[:] = np.nan  # the last impact belongs to the approach
            cycle = np.column_stack([z[-p:], speed])
            return np.roll(cycle, -int(np.argmin(cycle[:, 0])), axis=0), reached
    return np.zeros((0, 1 + 2 * len(problem.dynamics.nodes))), reached


def _miss(z: Array, p: int) -> float:
    """Return the largest difference between the last points and those p before, relative to each column's maximum."""
    seen = max(p, 4)
    if len(z) < seen + p:
        return math.inf
    return float((np.abs(z[-seen:] - z[-seen - p : -p]) / extents(z)).max())


def _named(cycles: list[Array]) -> tuple[list[int], list[Array]]:
    """Return the attractor number of each cycle, 1 for the most frequent, and the attractors."""
    reach = max((float(np.abs(cycle[:, :-1]).max()) for cycle in cycles if len(cycle)), default=1.0)
    known: list[Array] = []
    found = []
    for cycle in cycles:
        label = -1
        for k, other in enumerate(known):
            # Each cycle has its shortest period, so no cycle is a repetition of another one.
            if len(other) == len(cycle) and _distance(cycle[:, :-1], other[:, :-1]) <= SAME_ATTRACTOR_RTOL * reach:
                label = k
                break
        if label < 0 and len(cycle):
            known.append(cycle)
            label = len(known) - 1
        found.append(label)
    rank = sorted(range(len(known)), key=lambda k: (-found.count(k), k))
    return [rank.index(k) + 1 if k >= 0 else 0 for k in found], [known[k] for k in rank]


def _distance(a: Array, b: Array) -> float:
    """Return the distance of two cycles of equal length, minimised over their relative phase."""
    return min(float(np.abs(np.roll(a, shift, axis=0) - b).max()) for shift in range(len(a)))
