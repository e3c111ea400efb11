"""Sets of parameters side by side in the lanes of vector registers, where the step and the outputs allow it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, TypeAlias, cast
from weakref import WeakKeyDictionary

import numpy as np

from lcpimpact.arrays import Array, Flags, Indices
from lcpimpact.formula import NotTracedError, Number, Program, mentions
from lcpimpact.integrators.printed.lanes import LANES, Lanes, SeriesReading, lanes
from lcpimpact.integrators.stepping.linear_step import LinearStep
from lcpimpact.quantities import Quantity, extreme, hides_closing, peak_force, peak_time, series_names
from lcpimpact.reading import at
from lcpimpact.record import Grid
from lcpimpact.scheme.dynamics import Dynamics
from lcpimpact.sweeps.job import Job

MIN_SETS = 64
"""Number of sets below which they are run one after another."""

WORTH_COMPILING = 1024
"""Number of sets from which lanes repay their compilation, of some seconds."""

Outputs: TypeAlias = Mapping[str, float | Array]
Change: TypeAlias = Callable[[Mapping[str, Any]], Job]


@dataclass(frozen=True, eq=False)
class Output:
    """The reader of an output from lanes.

    Attributes
    ----------
    readings : tuple of Reading
    find : callable     takes the numbers of the readings (nr, N), the states (size, N) at each stop, and the values of the
                        sets, and returns (N, ...), with NaN first where it is not known
    stops : tuple of int    numbers of the steps whose states it needs
    impacts : bool      whether it needs the last impacts before these, too
    """

    readings: tuple[SeriesReading, ...]
    find: Callable[[Array, Mapping[int, Array], Mapping[str, Array]], Array]
    stops: tuple[int, ...] = ()
    impacts: bool = False


Readers: TypeAlias = Callable[[Job, Grid, Job, Number], dict[str, Output]]
"""Function of a job, its grid, the job with formulas in place of numbers, and its step, which may be one: the readers of its
outputs by name; it raises `NotTracedError` where lanes cannot read them."""


@dataclass(frozen=True, eq=False)
class JobTrace:
    """The runs of a job in lanes, with formulas made at one set of parameters.

    Attributes
    ----------
    lanes : Lanes
    outputs : dict of str to Output     how each output is read
    """

    lanes: Lanes
    outputs: dict[str, Output]

    def take(self, sets: Mapping[str, Array], threads: int) -> tuple[Flags, dict[str, Array]]:
        """Run sets of parameters: for which of them the formulas hold, and their outputs."""
        regular, numbers, states = _take(self.lanes, np.array([*sets.values()]).reshape(len(sets), -1), threads)
        kept = dict(zip(self.lanes.readings, numbers, strict=True))
        at_stops = dict(zip(map(int, self.lanes.stops), states, strict=True))
        found = {
            name: each.find(np.array([kept[reading] for reading in each.readings]), at_stops, sets)
            for name, each in self.outputs.items()
        }
        for each in found.values():
            regular &= ~np.isnan(each.reshape(len(regular), -1)[:, 0])
        return regular, found


TRACES: WeakKeyDictionary[Job, dict[tuple[int | str, ...], list[JobTrace]]] = WeakKeyDictionary()
"""The traces of the jobs of this process, by the number of steps and the names of the parameters: chunks share them."""


def run_side_by_side(
    job: Job,
    values: Mapping[str, Array],
    change: Change,
    run_alone: Callable[[int], Outputs | None],
    threads: int,
    readers: Readers,
    *,
    max_traces: int = 4,
) -> Iterator[tuple[Indices, dict[str, Array]]]:
    """Run the sets of parameters that lanes take.

    A few sets of each group with the same formulas are run alone too, certificate included: the group counts only if these
    are solved and have the same outputs, bit for bit. What the certificate of a θ-step judges holds by its equations once
    its LCP is solved, which is checked in each step; that of other methods judges their error too, so that they are taken
    only where the job does not ask for certificates.

    ``max_traces``: number of sets at which formulas are made anew, for sets for which none made so far hold.

    Parameters
    ----------
    job : Job
    values : mapping of str to (N,) array
    change : callable
        Takes the values of a set, which may be formulas, and returns its job.
    run_alone : callable
        Runs a set by its number, and returns its outputs; None if it is not solved.
    threads : int
    readers : callable
        Gives the readers of the outputs.

    Yields
    ------
    (m,) array, dict of (m, ...) arrays
        The numbers of sets, and their outputs.
    """
    N = len(next(iter(values.values())))
    steps = np.rint(values.get("t_end", job.t_end) / values.get("dt", np.array(job.dt))).astype(np.int64)
    for number in map(int, np.unique(steps)):
        remaining = np.flatnonzero(np.broadcast_to(steps == number, N))
        for i in range(max_traces):
            sets = {name: each[remaining] for name, each in values.items() if name != "dt"}
            if len(remaining) < MIN_SETS or not has_trace(job, number, sets, change, readers, N, i):
                break
            regular, numbers = TRACES[job][number, *sets][i].take(sets, threads)
            found = {name: each[regular] for name, each in numbers.items()}
            rows, remaining = remaining[regular], remaining[~regular]
            if len(rows) and _agree(rows, found, run_alone):
                yield rows, found


def has_trace(
    job: Job, steps: int, sets: Mapping[str, Array], change: Change, readers: Readers, count: int, i: int = 0
) -> bool:
    """Return whether there is a trace number i of runs of so many steps; a new one, for ``count`` sets, is made at one."""
    traces = TRACES.setdefault(job, {}).setdefault((steps, *sets), [])
    last = len(next(iter(sets.values()), [0])) - 1
    for k in sorted({0, last // 2, last}):
        if i == len(traces):  # a set may be one that the problem refuses
            values = {name: float(each[k]) for name, each in sets.items()}
            trace = _trace(job, Grid(values.get("t_end", job.t_end), steps), values, change, readers, count)
            traces += [trace] if trace else []
    return i < len(traces)


def _agree(rows: Indices, numbers: Mapping[str, Array], run_alone: Callable[[int], Outputs | None]) -> bool:
    """Return whether the first and last set, and those with extreme outputs, are solved alone with the same outputs."""
    last = [each.reshape(len(rows), -1)[:, -1] for each in numbers.values()]
    chosen = {0, len(rows) - 1, *(int(find(each)) for each in last for find in (np.argmin, np.argmax))}
    for k in sorted(chosen):
        alone = run_alone(int(rows[k]))
        if alone is None or not all(np.array_equal(alone[name], each[k], True) for name, each in numbers.items()):
            return False
    return True


def _trace(
    job: Job,
    grid: Grid,
    values: Mapping[str, float],
    change: Change,
    readers: Readers,
    sets: int,
    *,
    steps_worth_compiling: int = 5_000_000,
) -> JobTrace | None:
    """Return the runs in lanes with the formulas of one set; None if there are none, or not worth it for so many sets.

    ``steps_worth_compiling``: number of steps of all sets from which lanes repay it.
    """
    method = job.integrator
    if not isinstance(method, LinearStep) or method.rtol is not None:
        return None
    if job.certify and method.balance_point() is None:
        return None
    program = Program()
    formulas = {name: program.parameter(value) for name, value in values.items()}
    try:
        alone, traced = change(values), change(formulas)
        h = formulas["t_end"] / grid.steps if "t_end" in formulas else grid.h
        outputs = readers(alone, grid, traced, h)
        compiled = lanes(
            (cast(LinearStep, traced.integrator), cast(LinearStep, alone.integrator)),
            (traced.problem.dynamics, alone.problem.dynamics),
            (traced.problem.initial_coordinates, traced.problem.initial_velocities),
            grid,
            program,
            tuple(dict.fromkeys(reading for each in outputs.values() for reading in each.readings)),
            sorted({stop for each in outputs.values() for stop in each.stops}),
            end=formulas.get("t_end"),
            impacts=any(each.impacts for each in outputs.values()),
            lcp_solver=job.lcp_solver,
            compiles=sets >= WORTH_COMPILING or sets * grid.steps >= steps_worth_compiling,
        )
    except Exception:  # noqa: BLE001 (formulas are no floats, and a builder may do anything with its arguments)
        return None
    return JobTrace(compiled, outputs)


def _take(
    compiled: Lanes, parameters: Array, threads: int, *, sets_of_a_thread: int = 64 * LANES
) -> tuple[Flags, Array, Array]:
    """Run sets of parameters, shared among threads.

    ``sets_of_a_thread``: number of sets below which they are not shared among threads.
    """
    N = parameters.shape[1]
    parts = min(threads, N // sets_of_a_thread)
    if parts < 2:
        return compiled.take(parameters)
    ends = [i * N // parts // LANES * LANES for i in range(parts)] + [N]
    pieces = [parameters[:, a:b] for a, b in pairwise(ends)]
    with ThreadPoolExecutor(parts) as pool:
        regular, numbers, states = zip(*pool.map(compiled.take, pieces), strict=True)
    return np.concatenate(regular), np.concatenate(numbers, axis=1), np.concatenate(states, axis=2)


def readers_of(job: Job) -> Readers:
    """Return the function that gives the readers of the outputs of a job."""
    quantities = job.quantities()

    def read(alone: Job, grid: Grid, traced: Job, h: Number) -> dict[str, Output]:
        return {each.name: output_of(each, alone, grid, traced, h) for each in quantities}

    return read


def output_of(quantity: Quantity, job: Job, grid: Grid, traced: Job, h: Number) -> Output:
    """Return the reader of a quantity of a job in lanes; the numbers of the job ``traced`` and its step h may be formulas.

    Raises
    ------
    NotTracedError
        If they cannot.
    """
    d, measure = job.problem.dynamics, quantity.measure
    keywords = getattr(measure, "keywords", {})
    function = getattr(measure, "func", measure)
    if function is extreme:
        array, column = _column(keywords["series"], d)
        kind = "max" if keywords.get("sign", 1.0) > 0.0 else "min"
        return Output((SeriesReading(kind, array, column),), lambda read, *_: read[0])
    if function in (peak_force, peak_time) and len(d.contacts) and d.impenetrable.all() and not d.springs:
        if hides_closing(traced.problem.dynamics, h):
            raise NotTracedError(f"{quantity.name} counts forces with which contacts close, which lanes do not read")
        columns = [_column(contact.name, d) for contact in d.contacts]
        most = tuple(SeriesReading("max", *each) for each in columns)
        if function is peak_force:
            return Output(most, lambda read, *_: read.max(axis=0))
        if not mentions(traced.integrator):
            times = job.integrator.reaction_times(grid)

            def first(read: Array, *_: Mapping[int, Array] | Mapping[str, Array]) -> Array:
                heights, steps = np.split(read, 2)
                step = np.where(heights == heights.max(axis=0), steps, np.inf).min(axis=0)
                return np.where(heights.max(axis=0) > 0.0, times[step.astype(np.int64) - 1], np.nan)

            return Output((*most, *(SeriesReading("argmax", *each) for each in columns)), first)
    if function is at:
        array, column = _column(keywords["series"], d)
        t = grid.times(0, grid.steps)
        k = grid.steps if keywords["t"] >= t[-1] else int(np.searchsorted(t, keywords["t"]))
        if array != "r" and k > 0 and (k == grid.steps or t[k] == keywords["t"]):
            row = column + len(d.nodes) * (array == "v")
            return Output((), lambda _, states, __: states[k][row], (k,))
    raise NotTracedError(f"lanes do not read {quantity.name}")


def _column(series: str, d: Dynamics) -> tuple[str, int]:
    """Return the array and the column of a series."""
    i, n = series_names(d).index(series), len(d.nodes)
    impulsive = d.rigid.any() or len(d.impulse_lines)
    if i >= 2 * n and (impulsive or i >= 2 * n + len(d.contacts)):
        raise NotTracedError(f"{series} holds what is known of a run only with its impacts")
    return ("q", i) if i < n else ("v", i - n) if i < 2 * n else ("r", i - 2 * n)
