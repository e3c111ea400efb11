"""Many runs of one problem side by side: the straight-line code of a step, its innermost loop over sets of parameters.

The tables are formulas of the parameters (see `lcpimpact.formula`), evaluated for all sets in the same loop. So a run costs
its arithmetic alone, shared by the lanes of a vector register, and has the same bits as by itself. Sets whose formulas are
others, since a comparison in the making of their table comes out differently, and those with a step out of the ordinary, are
not regular: they are to be run alone.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, TypeVar

import numpy as np
from numba import types

from lcpimpact.arrays import Array, Flags, Indices
from lcpimpact.compiled import COMPILING, compiled_text, matrix, source_file, vector
from lcpimpact.errors import UnsupportedError
from lcpimpact.formula import Formula, NotTracedError, Number, Program, mentions, value_of
from lcpimpact.integrators.stepping.kernel import StepTable
from lcpimpact.integrators.stepping.linear_step import LinearStep, varying_loads
from lcpimpact.integrators.stepping.static_balance import Static
from lcpimpact.integrators.stepping.straight_line import (
    Set,
    SolveLaw,
    Statement,
    Store,
    Unless,
    When,
    Writer,
    write_step,
)
from lcpimpact.record import Grid
from lcpimpact.scheme.dynamics import Dynamics

T = TypeVar("T", StepTable, Static)

LANES = 32
"""Number of sets side by side: the numbers of one step of theirs fill the nearest cache, and vector registers many times."""

GENERIC = 2.5
"""Value that stands for a formula in the pattern of a table: neither 0 nor 1."""

SIGNATURE: Any = types.void(matrix, types.int64[::1], matrix, vector, vector, matrix)


@dataclass(frozen=True)
class Reading:
    """What is kept of a series: its "max" or "min", or the number of the step of its first maximum, "argmax".

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
    h : float                       step in s, the last parameter of the compiled code
    constants : (m,) array          coefficients that no parameter changes
    rows : int                      numbers kept for each lane
    readings : tuple of Reading
    stops : (g,) array              numbers of the steps after which the state is kept, the last step among them
    loads : (steps, nl) array       loads that depend on time
    state : int                     number of the kept states and reactions at each stop
    """

    run: Callable[..., None]
    h: float
    constants: Array
    rows: int
    readings: tuple[Reading, ...]
    stops: Indices
    loads: Array
    state: int

    def take(self, parameters: Array) -> tuple[Flags, Array, Array]:
        """Run sets of parameters (np, N).

        Returns
        -------
        regular : (N,) array            whether a set was run; others must be run alone
        readings : (nr, N) array
        states : (g, N_y + nc, N) array     state and reactions after the stops
        """
        N, kept = parameters.shape[1], len(self.readings)
        given = np.vstack([parameters, np.full(N, self.h)])
        results = np.empty((1 + kept + len(self.stops) * self.state, N))
        room = np.zeros(self.rows * LANES)
        self.run(self.loads, self.stops, given, self.constants, room, results)
        states = results[1 + kept :].reshape(len(self.stops), self.state, N)
        return results[0] == 0.0, results[1 : 1 + kept], states


def lanes(
    methods: tuple[LinearStep, LinearStep],
    dynamics: tuple[Dynamics, Dynamics],
    start: tuple[Array, Array],
    grid: Grid,
    program: Program,
    readings: Sequence[Reading],
    stops: Sequence[int],
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
    lcp_solver : str
    compiles : bool
        Whether to compile what is not in the cache.

    Raises
    ------
    UnsupportedError
        If the step is none that lanes can take: see `lcpimpact.integrators.stepping.straight_line`; beyond one contact; or
        it is to be compiled first.
    NotTracedError
        If loads that depend on time are formulas.
    """
    (method, known_method), (d, with_values) = methods, dynamics
    known = known_method.prepare(with_values, grid.h, lcp_solver)
    if not COMPILING or not known.regular or known.table.W.shape[1] > 1:
        raise UnsupportedError("lanes take compiled linear steps with at most one contact")
    if not _same_signals(d, with_values):
        raise NotTracedError("lanes share the loads that depend on time, and prescribed motions")
    loads = known.loads(grid.times(0, grid.steps))
    h: Any = program.parameter(grid.h)  # so that steps of all lengths share their code
    table, _, step = method.tabulate(d, h)
    y = method.begin(d, *start, h)
    writer = write_step(_pattern(table), _pattern(step.static), len(d.nodes))
    arrays = table._asdict() | step.static._asdict()
    coefficients = {name: arrays[key][index] for name, (key, index) in writer.coefficients.items()}
    source = _source(writer, coefficients, y, program, tuple(readings))
    if not compiles and not source_file(source.text).exists():
        raise UnsupportedError("the lanes of this problem are not compiled yet")
    run = _compiled(source.text)
    state, _, nc, _ = writer.sizes
    ends = np.array([*stops, grid.steps] if grid.steps not in stops else [*stops], dtype=np.int64)
    return Lanes(
        run, grid.h, np.array([known.tol, *source.constants]), source.rows, tuple(readings), ends, loads, state + nc
    )


@cache
def _compiled(text: str) -> Callable[..., None]:
    """Return the compiled function of a source."""
    names = {"sqrt": math.sqrt, "inf": math.inf, "INFINITY": math.inf, "LANES": LANES}
    run = compiled_text(text, "run", SIGNATURE, names)
    if run is None:
        raise UnsupportedError("there is no folder for compiled code")
    return run


def _same_signals(d: Dynamics, with_values: Dynamics) -> bool:
    """Return whether the loads on nodes with one that depends on time, and the prescribed motions, are no formulas."""
    varying = varying_loads(d)
    ours, theirs = (
        [*each.motions.items(), *(load for load in each.loads if varying[load[0]])] for each in (d, with_values)
    )
    return all(a is b or (not mentions(a) and a == b) for (_, a), (_, b) in zip(ours, theirs, strict=True))


def _pattern(arrays: T) -> T:
    """Return arrays with a number in place of each formula."""
    replaced: Any = {name: _numbers(each) for name, each in arrays._asdict().items() if each.dtype == object}
    return arrays._replace(**replaced)


def _numbers(formulas: Array) -> Array:
    """Return an array with a number in place of each formula."""
    flat = [GENERIC if isinstance(each, Formula) else each for each in formulas.ravel()]
    return np.array(flat, dtype=np.float64).reshape(formulas.shape)


@dataclass(frozen=True, eq=False)
class Source:
    """The source of the runs, and what it reads and keeps.

    Attributes
    ----------
    text : str
    constants : list of float   coefficients that no parameter changes
    rows : int                  numbers kept for each lane
    """

    text: str
    constants: list[float]
    rows: int


def _source(
    writer: Writer, coefficients: dict[str, Number], y: Array, program: Program, readings: tuple[Reading, ...]
) -> Source:
    """Return the source of a function that runs sets of parameters, the coefficients and initial state y as formulas."""
    states, loads, nc, laws = writer.sizes
    *swept, _ = program.parameters  # the last is h, which all sets share
    of_sets = program.depending_on(swept)
    varying = {name: value for name, value in coefficients.items() if getattr(value, "name", "") in of_sets}
    fixed = {name: value_of(value) for name, value in coefficients.items() if name not in varying}
    state = [f"y{i}" for i in range(states)] + [f"r{i}" for i in range(nc)]
    best = [f"best{i}" for i, each in enumerate(readings) if each.kind == "argmax"]
    results = ["bad", *(f"kept{i}" for i in range(len(readings))), *state]
    changing = [*results, *(f"P{i}" for i in range(laws * nc)), *best]
    place = {name: f"room[{i} * LANES + l]" for i, name in enumerate([*changing, *varying])}
    load = [f"{name} = {where}" for name, where in place.items()]
    first = _first(writer, {f"y{i}": value for i, value in enumerate(y)} | varying, program, readings)
    step = [line for statement in writer.statements for line in _lane(statement)] + _kept(readings, writer.n)
    kept = len(readings) + 1
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
        "        while k < stops[g]:",
        *(f"            load{j} = loads[k, {j}]" for j in range(loads)),
        "            k += 1",
        "            now = float(k)",
        "            for l in range(LANES):",
        *(f"                {line}" for line in [*load, *step]),
        *(f"                {place[name]} = {name}" for name in changing),
        f"        for i in range({len(state)}):",
        "            for l in range(count):",
        f"                results[{kept} + g * {len(state)} + i, start + l] = room[({kept} + i) * LANES + l]",
        f"    for i in range({kept}):",
        "        for l in range(count):",
        "            results[i, start + l] = room[i * LANES + l]",
    ]
    head = "def run(loads, stops, parameters, constants, room, results):\n"
    return Source(head + "".join(f"    {line}\n" for line in lines), list(fixed.values()), len(place))


def _first(writer: Writer, given: dict[str, Number], program: Program, readings: tuple[Reading, ...]) -> list[str]:
    """Return the lines that begin the run of one lane: the coefficients, and whether they are those of its parameters."""
    _, _, nc, laws = writer.sizes
    lines = [f"p{i} = parameters[{i}, start + min(l, count - 1)]" for i in range(len(program.parameters))]
    lines += program.source(given)
    assumed = [*program.assumptions(), *(f"abs({name}) < INFINITY" for name in given)]
    assumed += [f"{name} > 0.0" for name in given if name.startswith(("W_", "SKS_"))]
    lines += ["bad = 0.0", *(f"bad = bad if {each} else 1.0" for each in assumed)]
    lines += [f"P{i} = 0.0" for i in range(laws * nc)] + [f"r{i} = 0.0" for i in range(nc)]
    for i, each in enumerate(readings):
        value = "INFINITY" if each.kind == "min" else "-INFINITY"
        value = value if each.array == "r" else _series(each, writer.n)
        lines += [f"kept{i} = 0.0", f"best{i} = {value}"] if each.kind == "argmax" else [f"kept{i} = {value}"]
    return lines


def _series(reading: Reading, n: int) -> str:
    """Return the variable of a series after a step."""
    return {"q": f"y{reading.column}", "v": f"y{n + reading.column}", "r": f"r{reading.column}"}[reading.array]


def _kept(readings: tuple[Reading, ...], n: int) -> list[str]:
    """Return the lines that keep what is read of the series."""
    lines = []
    for i, each in enumerate(readings):
        value = _series(each, n)
        if each.kind == "argmax":
            lines += [f"kept{i} = now if {value} > best{i} else kept{i}", f"best{i} = max({value}, best{i})"]
        else:
            lines.append(f"kept{i} = {each.kind}({value}, kept{i})")
    return lines


def _lane(statement: Statement) -> list[str]:
    """Return the lines of a statement for one lane; what only counts the work is left out."""
    match statement:
        case Set("worst", _) | When(_, (Set("worst", _),)) | Store():
            return []
        case Set(name, value):
            return [f"{name} = {value}"]
        case When(condition, then):
            return [f"if {condition}:", *(f"    {line}" for each in then for line in _lane(each))]
        case Unless(condition):
            return [f"bad = bad if {each} else 1.0" for each in condition.split(" and ")]
        case SolveLaw():
            raise UnsupportedError("lanes solve laws of one row")
