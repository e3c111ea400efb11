"""Points of a section of many problems: by threads, and of a stroboscope side by side."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np

from lcpimpact.arrays import Array, Indices
from lcpimpact.errors import LcpImpactError
from lcpimpact.events import zero
from lcpimpact.formula import NotTracedError, Number
from lcpimpact.integrators.base import Integrator
from lcpimpact.numbers import count
from lcpimpact.problems.base import Problem
from lcpimpact.record import Grid
from lcpimpact.study.dynamics.sections import (
    Points,
    Section,
    Stroboscope,
    find_points,
    force_of,
    instants,
    latest,
    steps_to,
)
from lcpimpact.study.progress import Progress, counted
from lcpimpact.sweeps.chunks import run_each
from lcpimpact.sweeps.job import Job
from lcpimpact.sweeps.side_by_side import Output, run_side_by_side


@dataclass(frozen=True)
class Sampling:
    """The points of a section that are taken of each run.

    Attributes
    ----------
    where : Section
    skip, need : int            numbers of the points that are skipped, and of all
    integrator, dt, lcp_solver  as of `poincare`
    """

    where: Section
    skip: int
    need: int
    integrator: Integrator
    dt: float | None = None
    lcp_solver: str = "auto"

    def of(self, problem: Problem) -> Points:
        """Return the points of one run."""
        found, _ = find_points(problem, self.where, self.need, None, self.integrator, self.dt, self.lcp_solver)
        return found.after(self.skip)


@dataclass(frozen=True, eq=False, kw_only=True)
class Strobes(Job):
    """Runs to the last of their stroboscopic points.

    Attributes
    ----------
    sampling : Sampling
    problems : sequence         the problem of each run
    forces : sequence of float  the period of its force in s
    """

    sampling: Sampling
    problems: Sequence[Problem]
    forces: Sequence[float]

    def in_lanes(self, alone: Job, grid: Grid, traced: Job, h: Number) -> dict[str, Output]:
        """Return the outputs by which lanes read the points: from the states at the grid points about them."""
        d = alone.problem.dynamics
        if alone.integrator.impact_steps != 1 or len(d.contacts) > 1 or not d.impenetrable.all():
            raise NotTracedError("lanes keep the impacts of one contact that last one step")
        force = force_of(alone.problem, self.sampling.where)
        near = self.nodes(self.instants(float(force or 0.0), grid.t_end), grid)[:, None] + [-1, 0, 1]
        stops = np.unique(near[(near > 0) & (near <= grid.steps)])

        def find(_: Array, states: Mapping[int, Array], sets: Mapping[str, Array]) -> Array:
            kept = np.array([states[int(k)] for k in stops])
            ends = sets.get("t_end", np.full(kept.shape[-1], grid.t_end))
            runs = zip(map(int, sets["number"]), map(float, ends), np.moveaxis(kept, 2, 0), strict=True)
            return np.array([self.read(number, Grid(end, grid.steps), stops, each) for number, end, each in runs])

        return {"points": Output((), find, tuple(map(int, stops)), bool((d.relative_degree == 2).any()))}

    def instants(self, force: float, end: float) -> Array:
        """Return the instants of the points that are kept, from the period of the force."""
        where = cast(Stroboscope, self.sampling.where)
        return np.minimum(instants(where, force, self.sampling.need, end), end)[self.sampling.skip :]

    def nodes(self, times: Array, grid: Grid, *, node_rtol: float = 1e-6) -> Indices:
        """Return the numbers of the grid points at or before instants, up to rounding.

        ``node_rtol``: distance of an instant from a grid point, in steps, below which it is that point.
        """
        return np.floor(times / grid.h + node_rtol).astype(np.int64)

    def read(self, number: int, grid: Grid, stops: Array | Indices, states: Array) -> Array:
        """Return t, q, v, and speed and step of the last impact at the points of a run (k, 2n + 3).

        All of it is NaN where an impact is at one of the instants up to rounding.

        Parameters
        ----------
        number : int            of the run
        grid : Grid
        stops : (g,) array      numbers of the grid points
        states : (g, m) array   what lanes keep there
        """
        d = self.problems[number].dynamics
        n = len(self.problems[number].dynamics.nodes)
        times = self.instants(self.forces[number], grid.t_end)
        t = np.where(stops == grid.steps, grid.t_end, stops * grid.t_end / grid.steps)
        found = np.full((len(times), 2 * n + 3), np.nan)
        nodes = self.nodes(times, grid)
        at = np.minimum(np.searchsorted(stops, nodes), len(stops) - 1)
        if (stops[at] != nodes).any():
            return found
        found[:, 0] = times
        found[:, 1:-2] = np.array([np.interp(times, t, column) for column in states[:, : 2 * n].T]).T
        if states.shape[1] == 2 * n + len(d.contacts):
            return found
        struck = states[:, -1]
        if ((struck[at] == nodes - 1) & (times < t[at])).any():
            return np.full_like(found, np.nan)
        for i in np.flatnonzero((nodes < grid.steps) & (struck[np.minimum(at + 1, len(stops) - 1)] == nodes)):
            # An impact in the step after a grid point may be at this point.
            k = at[i]
            gaps = d.gap(t[k - 1 : k + 1], states[k - 1 : k + 1, :n])[:, 0]
            at[i] += zero(t[k - 1 : k + 1], gaps, t[k], t[k + 1]) <= times[i]
        for i in np.flatnonzero(struck[at] >= 0.0):
            found[i, -2] = -(d.H[0] @ states[at[i], -1 - n : -1])
            found[i, -1] = struck[at[i]] * grid.t_end / grid.steps
        return found


def points_of_each(
    family: Callable[..., Problem],
    values: Mapping[str, Array],
    alone: Callable[[Problem], Points],
    sampling: Sampling | None,
    workers: int | None,
    shown: tuple[str, Progress],
) -> list[Points | str]:
    """Return the points of the runs of a family of problems, or why there are none.

    Parameters
    ----------
    family : callable
        Takes the values of a run in their order, and returns its problem.
    values : mapping of str to (N,) array
    alone : callable
        Takes a problem, and returns its points.
    sampling : Sampling, optional
        What ``alone`` does, so far as runs may be side by side.
    workers : int, optional
        Number of threads; None for one.
    shown : pair of str and bool or callable
        What is counted, and as of `lcpimpact.study.progress`.
    """
    runs = list(zip(*(column.tolist() for column in values.values()), strict=True))
    found: list[Points | str | None] = [None] * len(runs)

    def run(k: int) -> Points | str:
        try:
            return found[k] or alone(family(*runs[k]))
        except LcpImpactError as error:
            return str(error)

    def checked(k: int) -> Points | None:
        found[k] = each = run(k)
        return None if isinstance(each, str) else each

    threads = 1 if workers is None else workers
    count("workers", threads)
    done = 0
    with counted(len(runs), *shown) as show, ThreadPoolExecutor(int(threads)) as pool:
        if sampling is not None and isinstance(sampling.where, Stroboscope):
            for k, points in _side_by_side(family, values, sampling, checked, int(threads)):
                found[k] = points
        todo = [(k, k) for k in range(len(runs)) if found[k] is None]
        for k, each in run_each(run, todo, pool if threads > 1 else None):
            found[k], done = each, done + 1
            show(done + len(runs) - len(todo))
    return [each for each in found if each is not None]


def _side_by_side(
    family: Callable[..., Problem],
    values: Mapping[str, Array],
    sampling: Sampling,
    run_alone: Callable[[int], Points | None],
    threads: int,
) -> Iterator[tuple[int, Points]]:
    """Yield the points of the runs that lanes take, with their numbers."""
    runs = []
    for k, each in enumerate(zip(*(column.tolist() for column in values.values()), strict=True)):
        try:
            problem = family(*each)
            force = float(force_of(problem, sampling.where) or 0.0)
            end = latest(problem, sampling.where, force, sampling.need)
            runs.append((k, problem, force, end, steps_to(end, problem, force, sampling.dt)))
        except LcpImpactError:
            continue
    if not runs:
        return
    numbers, problems, forces, ends, steps = zip(*runs, strict=True)
    sets = {name: column[list(numbers)] for name, column in values.items()}
    sets |= {"number": np.arange(float(len(runs))), "dt": np.array(ends) / np.array(steps)}
    sets |= {"t_end": np.array(ends)} if len(set(ends)) > 1 else {}
    method, solver = sampling.integrator, sampling.lcp_solver
    job = Strobes(problems[0], method, 1.0, ends[0], solver, sampling=sampling, problems=problems, forces=forces)

    def change(changed: Mapping[str, Any]) -> Job:
        return replace(job, problem=family(*(changed[name] for name in values)))

    def alone(j: int) -> dict[str, Array] | None:
        found = run_alone(numbers[j])
        return None if found is None else {"points": np.column_stack(found[:-1])}

    for rows, found in run_side_by_side(job, sets, change, alone, threads, job.in_lanes):
        for j, points in zip(rows, found["points"], strict=True):
            n = len(problems[j].dynamics.nodes)
            t, q, v, speed, struck = np.split(points, [1, n + 1, 2 * n + 1, 2 * n + 2], axis=1)
            yield numbers[j], Points(t[:, 0], q, v, speed[:, 0], struck[:, 0], np.full((2, n), np.nan))
