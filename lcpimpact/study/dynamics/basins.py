"""Basins of attraction: to which attractor each initial state leads."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np
import pandas as pd

from lcpimpact.arguments import checked
from lcpimpact.arrays import Array
from lcpimpact.errors import InputError
from lcpimpact.hybrid.motion import ExactSolution, begin_problem
from lcpimpact.integrators.base import Integrator, Option
from lcpimpact.numbers import count
from lcpimpact.problems.base import Problem
from lcpimpact.simulation import RUN_ARGUMENTS, check_lcp_solver, make_integrator
from lcpimpact.study.dynamics.period import MAX_PERIOD, extents
from lcpimpact.study.dynamics.sections import BLOCK_PERIODS, Points, Stroboscope, last_impacts
from lcpimpact.study.dynamics.shooting import follow_exactly, force_period, refuse_power_laws
from lcpimpact.study.dynamics.strobes import Sampling, points_of_each
from lcpimpact.study.progress import Progress
from lcpimpact.study.result import Study, failure_lines


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
    units : mapping
        Units of the coordinates that are not in m, as of `Problem`.
    """

    table: pd.DataFrame
    attractors: pd.DataFrame
    name: str
    longest: int
    units: Mapping[str, str] = field(default_factory=dict)

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
    method: str | Integrator = "exact",
    dt: float | None = None,
    lcp_solver: str = "auto",
    **method_options: Option,
) -> Basins:
    """Return the basins of attraction over two initial values, by the stroboscopic map of the force.

    Each run ends when its points repeat with a period of at most 16, or after ``longest`` periods; by a method of steps all
    last so long. Attractors whose points agree within a hundredth of their extent are identified.

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
    method, dt, lcp_solver, **method_options
        As of `poincare`: with ``moreau-jean`` many runs are side by side (see docs/guide/sweeps.md).

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

    integrator = make_integrator(method, method_options, RUN_ARGUMENTS)
    check_lcp_solver(integrator, lcp_solver)
    skip = max(0, longest - 2 * MAX_PERIOD - 1)
    sampling = Sampling(Stroboscope(), skip, longest, integrator, dt, lcp_solver)
    exact = integrator.declared.is_exact
    problems: list[Problem] = []

    def seen(*start: float) -> Problem:
        problems[:] = [family(*start)]
        return problems[0]

    values = dict(zip(parameters, np.array(starts).T, strict=True))
    alone = (lambda problem: _settled(problem, longest, tol)) if exact else sampling.of
    runs = points_of_each(seen, values, alone, None if exact else sampling, workers, ("basins", progress))
    cycles = [np.zeros((0, 0)) if isinstance(run, str) else _cycle(run, tol) for run in runs]
    table = pd.DataFrame(starts, columns=list(parameters))
    labels, attractors = _named(cycles)
    table = table.assign(
        attractor=labels,
        period=[len(cycle) for cycle in cycles],
        run=[0 if isinstance(run, str) else round(run.t[-1] / _force(problems[0])) for run in runs],
        failure=[run if isinstance(run, str) else "" for run in runs],
    )
    problem = problems[0] if problems else None
    nodes = () if problem is None else problem.dynamics.nodes
    columns = [*nodes, *(f"v_{node}" for node in nodes), "speed"]
    rows = [
        {"attractor": k, "period": len(cycle), "share": labels.count(k) / len(labels), "point": i}
        | dict(zip(columns, point.tolist(), strict=True))
        for k, cycle in enumerate(attractors, start=1)
        for i, point in enumerate(cycle)
    ]
    found = pd.DataFrame(rows, columns=["attractor", "period", "share", "point", *columns])
    if problem is None:
        return Basins(table, found, "", longest)
    return Basins(table, found, problem.name, longest, problem.units)


def _settled(problem: Problem, longest: int, tol: float) -> Points:
    """Return the last points of the exact motion at phase 0, when they repeat, or after the longest run."""
    force = _force(problem)
    refuse_power_laws(problem)
    motion = begin_problem(problem, "exact", longest * force)
    reached = 0
    while True:
        reached = min(reached + BLOCK_PERIODS, longest)
        follow_exactly(motion, problem, reached * force)
        times = np.minimum(np.arange(max(0, reached - 2 * MAX_PERIOD), reached + 1) * force, motion.end)
        q, v, _ = ExactSolution.of(motion)(times, "right")
        if reached == longest or _period(np.hstack([q, v]), tol):
            last = np.array([q[-1:], v[-1:]])[:, 0]
            return Points(times, q, v, *last_impacts(problem.dynamics, motion.events, times), last)


def _force(problem: Problem) -> float:
    """Return the period of the force in s."""
    force = force_period(problem.dynamics)
    if force is None:
        raise InputError(f"{problem.name} has no force with a period, so it cannot be seen once in each")
    return force


def _period(z: Array, tol: float) -> int:
    """Return the period after which the last points repeat, 0 if they do not."""
    miss = [_miss(z, p) for p in range(1, MAX_PERIOD + 1)]
    # In a slow approach with a negative multiplier every other point converges first.
    return 0 if min(miss) > tol else 1 + next(i for i, each in enumerate(miss) if each <= 100.0 * tol)


def _cycle(points: Points, tol: float) -> Array:
    """Return the points of the attractor of a run, the least coordinate first, with the speeds of their impacts."""
    z = np.hstack([points.q, points.v])
    p = _period(z, tol)
    if not p:
        return np.zeros((0, z.shape[1] + 1))
    # The last impact may belong to the approach.
    speed = points.speed[-p:] if points.struck[-1] > points.t[-1 - p] else np.full(p, np.nan)
    cycle = np.column_stack([z[-p:], speed])
    return np.roll(cycle, -int(np.argmin(cycle[:, 0])), axis=0)


def _miss(z: Array, p: int) -> float:
    """Return the largest difference between the last points and those p before, relative to each column's maximum."""
    seen = max(p, 4)
    if len(z) < seen + p:
        return math.inf
    return float((np.abs(z[-seen:] - z[-seen - p : -p]) / extents(z)).max())


def _named(cycles: list[Array], *, same_attractor_rtol: float = 1e-2) -> tuple[list[int], list[Array]]:
    """Return the attractor number of each cycle, 1 for the most frequent, and the attractors.

    ``same_attractor_rtol``: distance below which two attractors are identified, relative to their extent.
    """
    reach = max((float(np.abs(cycle[:, :-1]).max()) for cycle in cycles if len(cycle)), default=1.0)
    known: list[Array] = []
    found = []
    for cycle in cycles:
        label = -1
        for k, other in enumerate(known):
            # Each cycle has its shortest period, so no cycle is a repetition of another one.
            if len(other) == len(cycle) and _distance(cycle[:, :-1], other[:, :-1]) <= same_attractor_rtol * reach:
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
