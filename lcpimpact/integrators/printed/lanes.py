"""Many runs of one problem side by side: the straight-line code of a step, its innermost loop over sets of parameters.

The tables are formulas of the parameters (see `lcpimpact.formula`), evaluated for all sets in the same loop. So a run costs
its arithmetic alone, shared by the lanes of a vector register, and has the same bits as by itself. Sets whose formulas are
others, since a comparison in the making of their table comes out differently, and those with a step out of the ordinary, are
not regular: they are to be run alone.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence, Set
from dataclasses import dataclass
from functools import cache
from typing import Any, TypeAlias

import numpy as np

from lcpimpact.arrays import Array, Flags, Indices, Matrix, Vector
from lcpimpact.compiled import COMPILING, compiled_text
from lcpimpact.errors import UnsupportedError
from lcpimpact.expressions import (
    ZERO,
    Assign,
    Expression,
    Name,
    Statement,
    Unless,
    When,
    carried,
    conditions_of,
    equal,
    finite,
    largest,
    operation,
    python_lines,
    select,
)
from lcpimpact.formula import Formula, Number, Program, value_of
from lcpimpact.integrators.printed.step import ROUNDED, SolveLaw, StepStatement, StepWriter, StoreStatement, two_row_law
from lcpimpact.integrators.printed.traced_run import TracedRun, trace_run
from lcpimpact.integrators.stepping.linear_step import LinearStep
from lcpimpact.record import Grid
from lcpimpact.scheme.dynamics import Dynamics

LANES = 48
"""Number of sets side by side: enough that the sums and quotients of one vector register need not wait for each other."""

CACHE_LINE = 8
"""Numbers in a line of the cache, and in the longest vector registers."""

LaneSteps: TypeAlias = Callable[[Matrix, Indices, Matrix, Vector, Vector, Matrix], None]
"""Type of the function of a source."""


@dataclass(frozen=True)
class SeriesReading:
    """A number read from a series: its "max" or "min", or the number of the step of its first maximum, "argmax".

    Attributes
    ----------
    kind : str
    array : str     "q", "v" or "r"
    column : int
    """

    kind: str
    array: str
    column: int


@dataclass(frozen=True, eq=False)
class Lanes:
    """The compiled runs of one problem by one method, for any values of some parameters.

    Attributes
    ----------
    run : callable
    constants : (m,) array          what is the same for all sets
    rows : int                      numbers kept for each lane
    readings : tuple of Reading
    stops : (g,) array              numbers of the steps after which the state is kept, the last step among them; only this,
                                    and no state, where none is asked for
    loads : (steps, nl) array       loads that depend on time, unless they are formulas
    state : int                     number of the kept states and reactions at each stop
    """

    run: LaneSteps
    constants: Array
    rows: int
    readings: tuple[SeriesReading, ...]
    stops: Indices
    loads: Array
    state: int

    def take(self, parameters: Array) -> tuple[Flags, Array, Array]:
        """Run sets of parameters (np, N).

        Returns
        -------
        regular : (N,) array            whether a set was run; others must be run alone
        readings : (nr, N) array
        states : (g, N_y + nc, N) array     state and reactions after the stops; where impacts are kept, followed by the
                                            velocities before the last impact (n) and the number of its step, -1 for none
        """
        N, kept = parameters.shape[1], len(self.readings)
        results = np.empty((1 + kept + len(self.stops) * self.state, N))
        room = np.empty(self.rows * LANES + CACHE_LINE - 1)
        room = room[-room.ctypes.data // room.itemsize % CACHE_LINE :]  # a vector across two lines takes twice as long
        self.run(self.loads, self.stops, np.ascontiguousarray(parameters), self.constants, room, results)
        states = results[1 + kept :].reshape(len(self.stops), self.state, N)
        return results[0] == 0.0, results[1 : 1 + kept], states


def lanes(
    methods: tuple[LinearStep, LinearStep],
    dynamics: tuple[Dynamics, Dynamics],
    start: tuple[Array, Array],
    grid: Grid,
    program: Program,
    readings: Sequence[SeriesReading],
    stops: Sequence[int],
    end: Formula | None = None,
    impacts: bool = False,
    lcp_solver: str = "auto",
    compiles: bool = True,
) -> Lanes:
    """Compile the runs of a problem with formulas.

    Parameters
    ----------
    methods, dynamics : pairs
        The method and the system with formulas, and with their values.
    start : pair of (n,) arrays
        q and v at t = 0, numbers or formulas.
    grid : Grid
    program : Program
        In which the formulas were traced.
    readings, stops
        As of `Lanes`.
    end : Formula, optional
        t_end where each set has its own.
    impacts : bool
        Whether to keep the last impacts.
    lcp_solver : str
    compiles : bool
        Whether to compile what is not in the cache.

    Raises
    ------
    UnsupportedError
        If the step is none that lanes can take (see `trace_run`), or it is to be compiled first.
    NotTracedError
        If loads that depend on time and prescribed motions are not shared, and one is no sum of harmonics and no polynomial
        of numbers.
    """
    if not COMPILING:
        raise UnsupportedError("lanes are compiled")
    run = trace_run(methods, dynamics, start, grid, program, end, lcp_solver)
    ends = np.array(sorted({*stops, grid.steps}), dtype=np.int64)
    source = _source(run, tuple(readings), bool(stops), impacts)
    code = _compiled(source.text)
    if not compiles and not (code.ready or ((file := code.code_file()) and file.exists())):
        raise UnsupportedError("the lanes of this problem are not compiled yet")
    constants = np.array([run.tol, *source.constants])
    return Lanes(code, constants, source.rows, tuple(readings), ends, run.loads, source.state)


@cache
def _compiled(text: str) -> Any:
    """Return the compiled function of a source."""
    names = {"sqrt": math.sqrt, "floor": np.floor, "INFINITY": math.inf, "LANES": LANES}
    return compiled_text(text, LaneSteps, names, vectors=True)


@dataclass(frozen=True, eq=False)
class Source:
    """The source of the runs, and what it reads and keeps.

    Attributes
    ----------
    text : str
    constants : list of float   what is the same for all sets
    rows : int                  numbers kept for each lane
    state : int                 number of those that are kept at each stop
    """

    text: str
    constants: list[float]
    rows: int
    state: int


def _source(run: TracedRun, readings: tuple[SeriesReading, ...], states_kept: bool, impacts: bool) -> Source:
    """Return the source of a function that runs sets of parameters."""
    writer, traced = run.writer, run.traced
    states, loads, nc, _ = writer.sizes
    in_time, inputs = traced.in_time()
    of_sets = traced.program.depending_on(traced.program.parameters[: traced.sets])
    known = run.coefficients | inputs
    varying = {name: value for name, value in known.items() if getattr(value, "name", "") in of_sets}
    fixed = {each.name: each.value for each in traced.shared}
    fixed |= {name: value_of(value) for name, value in known.items() if name not in varying}
    first = _first(run, run.y | varying, readings)
    lasting = _lasting(writer)
    certain = {ROUNDED, *(finite(Name(f"new{i}")) for i in lasting)}
    step = [each for statement in writer.statements for each in _lane(statement, certain)]
    step += _kept(readings, writer.n)
    state = [f"y{i}" for i in range(states)] + [f"r{i}" for i in range(nc)] if states_kept else []
    if impacts:
        state += [f"left{i}" for i in range(writer.n)] + ["struck"]
        first += [f"left{i} = 0.0" for i in range(writer.n)] + ["struck = -1.0"]
        before = [Assign(f"from{i}", Name(f"y{writer.n + i}")) for i in range(writer.n)]
        step = [*before, Assign("pushed", Name("r0")), *step, *_impact(writer.n)]
    kept = len(readings) + 1
    results = ["bad", *(f"kept{i}" for i in range(kept - 1)), *state]
    changing = [*results, *sorted(carried(step) - {*results})]
    place = {name: f"room[{i} * LANES + l]" for i, name in enumerate([*changing, *varying])}
    bad = place["bad"]
    load = [f"{name} = {where}" for name, where in place.items()]
    lines = [
        "tol = constants[0]",
        *(f"{name} = constants[{i + 1}]" for i, name in enumerate(fixed)),
        "N = parameters.shape[1]",
        "for start in range(0, N, LANES):",
        "    count, k = min(LANES, N - start), 0",
        "    for l in range(LANES):",
        *(f"        {line}" for line in first),
        *(f"        {where} = {name}" for name, where in place.items()),
        "    for g in range(len(stops)):",
        "        stop = stops[g]",
        "        while k < stop:",
        *(f"            load{j} = loads[k, {j}]" for j in range(loads if not in_time else 0)),
        "            k += 1",
        "            now = float(k)",
        "            for l in range(LANES):",
        *(f"                {line}" for line in [*load, *python_lines((*in_time, *step))]),
        *(f"                {place[name]} = {name}" for name in changing),
        f"        for i in range({len(state)}):",
        "            for l in range(count):",
        f"                results[{kept} + g * {len(state)} + i, start + l] = room[({kept} + i) * LANES + l]",
        *(f"    for l in range(LANES): {bad} = {bad} if abs({place[f'y{i}']}) < INFINITY else 1.0" for i in lasting),
        f"    for i in range({kept}):",
        "        for l in range(count):",
        "            results[i, start + l] = room[i * LANES + l]",
    ]
    head = "def run(loads, stops, parameters, constants, room, results):\n"
    return Source(head + "".join(f"    {line}\n" for line in lines), list(fixed.values()), len(place), len(state))


def _first(run: TracedRun, given: dict[str, Number], readings: tuple[SeriesReading, ...]) -> list[str]:
    """Return the lines that begin the run of one lane: the coefficients, and whether they are those of its parameters."""
    writer, traced = run.writer, run.traced
    _, _, nc, laws = writer.sizes
    assumed: list[Expression] = [*traced.program.assumptions(), *(finite(Name(name)) for name in given)]
    assumed += [Name(name) > 0.0 for name in run.positive() if name in given]
    lines = [f"p{i} = parameters[{i}, start + min(l, count - 1)]" for i in range(traced.sets)]
    lines += map(str, [*traced.program.assignments(given), Assign("bad", ZERO), *_regular(set(), *assumed)])
    lines += [f"P{i} = 0.0" for i in range(laws * nc)] + [f"r{i} = 0.0" for i in range(nc)]
    for i, each in enumerate(readings):
        value = "INFINITY" if each.kind == "min" else "-INFINITY"
        value = value if each.array == "r" else str(_series(each, writer.n))
        lines += [f"kept{i} = 0.0", f"best{i} = {value}"] if each.kind == "argmax" else [f"kept{i} = {value}"]
    return lines


def _regular(certain: Set[Expression], *conditions: Expression) -> list[Assign]:
    """Return the checks of conditions that are not certain: a lane without one of them is bad."""
    return [Assign("bad", select(each, Name("bad"), 1.0)) for each in conditions if each not in certain]


def _series(reading: SeriesReading, n: int) -> Name:
    """Return the variable of a series after a step."""
    column = reading.column
    return Name({"q": f"y{column}", "v": f"y{n + column}", "r": f"r{column}"}[reading.array])


def _lasting(writer: StepWriter) -> list[int]:
    """Return the coordinates whose new value has their last one as a term: once infinite or NaN, they are so to the end."""
    laws, nc, _ = writer.table.W.shape
    return [i for i in range(writer.n) if writer.table.known[i, 2 * laws * nc + i] != 0.0]


def _kept(readings: tuple[SeriesReading, ...], n: int) -> list[Assign]:
    """Return the statements that keep the readings of the series."""
    found = []
    for i, each in enumerate(readings):
        value = _series(each, n)
        kept = Name(f"kept{i}")
        best = Name(f"best{i}")
        if each.kind == "argmax":
            found.append(Assign(kept.name, select(value > best, Name("now"), kept)))
            found.append(Assign(best.name, largest(value, best)))
        else:
            found.append(Assign(kept.name, operation(each.kind, value, kept)))
    return found


def _impact(n: int) -> list[Assign]:
    """Return the statements that keep the velocity before an impact, and its step; one in the first step is irregular."""
    hit, struck = Name("hit"), Name("struck")
    return [
        Assign("hit", (Name("r0") > 0.0) & (Name("pushed") <= 0.0)),
        *(Assign(f"left{i}", select(hit, Name(f"from{i}"), Name(f"left{i}"))) for i in range(n)),
        Assign("struck", select(hit, Name("now") - 1.0, struck)),
        Assign("bad", select(equal(struck, 0.0), 1.0, Name("bad"))),
    ]


def _lane(statement: StepStatement, certain: Set[Expression]) -> list[Statement]:
    """Return a statement for one lane, without what only counts the work, and checks of what is certain."""
    match statement:
        case Assign("worst", _) | When(_, (Assign("worst", _),)) | StoreStatement():
            return []
        case Assign():
            return [statement]
        case When(condition, then):
            return [When(condition, tuple(line for each in then for line in _lane(each, certain)))]
        case Unless(condition):
            return [*_regular(certain, *conditions_of(condition))]
        case SolveLaw():
            return [*two_row_law(statement)]
