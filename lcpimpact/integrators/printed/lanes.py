"""Many runs of one problem side by side: the straight-line code of a step, its innermost loop over sets of parameters.

The tables are formulas of the parameters (see `lcpimpact.formula`), evaluated for all sets in the same loop. So a run costs
its arithmetic alone, shared by the lanes of a vector register, and has the same bits as by itself. Sets whose formulas are
others, since a comparison in the making of their table comes out differently, and those with a step out of the ordinary, are
not regular: they are to be run alone.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, TypeAlias, TypeVar

import numpy as np

from lcpimpact.arrays import Array, Flags, Indices, Matrix, Vector
from lcpimpact.compiled import COMPILING, compiled_text, source_file
from lcpimpact.errors import UnsupportedError
from lcpimpact.formula import Formula, NotTracedError, Number, Program, mentions, value_of
from lcpimpact.integrators.printed.straight_line import (
    ROUNDED,
    Set,
    SolveLaw,
    Statement,
    StepWriter,
    StoreStatement,
    Unless,
    When,
    finite,
    write_step,
)
from lcpimpact.integrators.stepping.kernel import StepTable
from lcpimpact.integrators.stepping.linear_step import LinearStep, varying_loads
from lcpimpact.integrators.stepping.static_balance import Static
from lcpimpact.numba_types import numba_type
from lcpimpact.numerics.rounding import EPS
from lcpimpact.record import Grid
from lcpimpact.scheme.dynamics import Dynamics

T = TypeVar("T", StepTable, Static)

LANES = 48
"""Number of sets side by side: enough that the sums and quotients of one vector register need not wait for each other."""

CACHE_LINE = 8
"""Numbers in a line of the cache, and in the longest vector registers."""

TOLERANCES = 16.0 * EPS, 0.5
"""Least and greatest tolerance of an LCP in lanes. Between them |q + W z| <= tol |q| implies that the rounding of this sum
is within tol |q| too: its terms are together at most 3.2 |q|, and their rounding at most 10 EPS |q|."""

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


@dataclass(frozen=True)
class Clock:
    """The instants of a run as formulas: its end, the number of its steps, and the instants before and after a step."""

    end: Formula
    steps: Formula
    before: Formula
    after: Formula

    def lines(self) -> list[str]:
        """Return the lines that compute the instants of the step that ends as number ``now``, with the bits of `Grid`."""
        end, steps = self.end.name, self.steps.name
        return [
            f"{self.before.name} = (now - 1.0) * {end} / {steps}",
            f"{self.after.name} = {end} if now == {steps} else now * {end} / {steps}",
        ]


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
    if not compiles and not source_file(source.text).exists():
        raise UnsupportedError("the lanes of this problem are not compiled yet")
    constants = np.array([run.tol, *source.constants])
    return Lanes(_compiled(source.text), constants, source.rows, tuple(readings), ends, run.loads, source.state)


@cache
def _compiled(text: str) -> LaneSteps:
    """Return the compiled function of a source."""
    names = {"sqrt": math.sqrt, "floor": np.floor, "inf": math.inf, "INFINITY": math.inf, "LANES": LANES}
    run = compiled_text(text, "run", numba_type(LaneSteps).signature, names)
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


def _numbers(formulas: Array, *, placeholder: float = 2.5) -> Array:
    """Return an array with a number in place of each formula.

    ``placeholder``: number that stands for a formula in the pattern of a table: neither 0 nor 1.
    """
    flat = [placeholder if isinstance(each, Formula) else each for each in formulas.ravel()]
    return np.array(flat, dtype=np.float64).reshape(formulas.shape)


@dataclass(frozen=True, eq=False)
class Traced:
    """The traced program of a run, with its clock and its signals.

    Attributes
    ----------
    program : Program
    sets : int                  number of its parameters that each set has its own values of
    clock : Clock
    signals : list of number    loads and prescribed motions in a step that are formulas
    """

    program: Program
    sets: int
    clock: Clock
    signals: list[Number]

    @property
    def shared(self) -> list[Formula]:
        """The end and the number of steps, so far as all sets have the same."""
        return self.program.parameters[self.sets : -2]

    def in_time(self) -> tuple[list[str], dict[str, Formula]]:
        """Return the lines that compute the signals of a step, and the formulas that these take as known."""
        if not self.signals:
            return [], {}
        program, clock = self.program, self.clock
        in_time = program.depending_on([clock.before, clock.after])
        if any(not in_time.isdisjoint(each) for each in program.assumed):
            raise NotTracedError("a load or a prescribed motion has cases")
        loads = {f"load{j}": each for j, each in enumerate(self.signals)}
        known = {each.name for each in (*program.parameters, *program.lines.values())} - in_time
        inputs = program.inputs(loads, known) | {each.name: each for each in (clock.end, clock.steps)}
        return clock.lines() + program.source(loads, known), inputs


@dataclass(frozen=True, eq=False)
class TracedRun:
    """A run of a problem as formulas: the statements of a step, and what they name.

    Attributes
    ----------
    writer : Writer
    coefficients : dict of str to number    those of the step
    y : dict of str to number               the initial state
    traced : Traced
    loads : (steps, nl) array               loads that depend on time, unless they are formulas
    tol : float                             tolerance of the LCP
    closed : bool                           whether each law has a closed form
    """

    writer: StepWriter
    coefficients: dict[str, Number]
    y: dict[str, Number]
    traced: Traced
    loads: Array
    tol: float
    closed: bool

    def positive(self) -> list[str]:
        """Return the coefficients that are above zero where the closed forms of the step hold."""
        pattern = r"W_\d+_(\d+)_\1|SKS_.*" if self.closed else "SKS_.*"
        return [name for name in self.coefficients if re.fullmatch(pattern, name)]


def trace_run(
    methods: tuple[LinearStep, LinearStep],
    dynamics: tuple[Dynamics, Dynamics],
    start: tuple[Array, Array],
    grid: Grid,
    program: Program,
    end: Formula | None = None,
    lcp_solver: str = "auto",
    open_forms: bool = False,
) -> TracedRun:
    """Trace the runs of a problem; arguments as of `lanes`.

    With ``open_forms`` laws without a closed form are taken too: three rows or more, friction, and two rows of which one is
    no contact.

    Raises
    ------
    UnsupportedError
        If the step is none of straight-line code (see `lcpimpact.integrators.printed.straight_line`), has a law that is not
        taken, or a tolerance beyond `TOLERANCES`.
    NotTracedError
        If loads that depend on time and prescribed motions are not shared, and one is no sum of harmonics and no polynomial
        of numbers.
    """
    method, known_method = methods
    d, with_values = dynamics
    known = known_method.prepare(with_values, grid.h, lcp_solver)
    nc = len(with_values.contacts)
    contacts = bool(with_values.impenetrable.all())
    closed = known.plain and (nc < 2 or (nc == 2 and known.solver.name == "closed-form" and contacts))
    if not (closed or (open_forms and known.written)):
        raise UnsupportedError("only linear steps with at most two contacts are straight-line code in closed form")
    if not TOLERANCES[0] <= known.tol <= TOLERANCES[1]:
        raise UnsupportedError(f"the tolerance {known.tol:g} does not bound the rounding of a row")
    sets = len(program.parameters)
    loads = np.zeros((grid.steps, 0))
    signals = []
    given = (end.value if end else grid.t_end, grid.steps, 0.0, grid.h)
    ours, *others = map(program.parameter, given)  # parameters, so that runs of all lengths share their code
    clock = Clock(end or ours, *others)
    h: Any = clock.end / clock.steps
    table, _, step = method.tabulate(d, h)
    y = method.begin(d, *start, h)
    if end is None and _same_signals(d, with_values):
        loads = known.loads(grid.times(0, grid.steps))
    else:
        signals = list(method.loads(d, h)(np.array([clock.before, clock.after]))[0])
    writer = write_step(_pattern(table), _pattern(step.static), len(d.nodes), with_values.normals.tolist())
    for law, i, j in np.ndindex(table.W.shape if nc > 1 else (0, 0, 0)):
        writer.coefficient("W", law, i, j)
    for law, i in np.ndindex(table.lower.shape if nc > 1 and open_forms else (0, 0)):
        writer.coefficient("lower", law, i)
        writer.coefficient("upper", law, i)
    rubs = np.flatnonzero(with_values.tangential).tolist()
    for i in rubs:
        writer.coefficient("mu", i)
        if any(_may_hold(d.mu[k], d.mu_s[k]) for k in rubs):
            writer.coefficient("mu_s", i)
            for j in range(len(d.nodes)):
                writer.coefficient("H", i, j)
    arrays = table._asdict() | step.static._asdict() | {"mu": d.mu, "mu_s": d.mu_s, "H": d.H}
    coefficients = {name: arrays[key][index] for name, (key, index) in writer.coefficients.items()}
    first = {f"y{i}": value for i, value in enumerate(y)}
    return TracedRun(writer, coefficients, first, Traced(program, sets, clock, signals), loads, known.tol, closed)


def _may_hold(mu: Number, mu_s: Number) -> bool:
    """Return whether static friction is above kinetic one for some values of the formulas."""
    return mu_s is not mu and (isinstance(mu, Formula) or isinstance(mu_s, Formula) or mu_s > mu)


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
    certain = {ROUNDED, *(finite(f"new{i}") for i in lasting)}
    step = [line for statement in writer.statements for line in _lane(statement, certain)] + _kept(readings, writer.n)
    state = [f"y{i}" for i in range(states)] + [f"r{i}" for i in range(nc)] if states_kept else []
    if impacts:
        state += [f"left{i}" for i in range(writer.n)] + ["struck"]
        first += [f"left{i} = 0.0" for i in range(writer.n)] + ["struck = -1.0"]
        step = [*(f"from{i} = y{writer.n + i}" for i in range(writer.n)), "pushed = r0", *step, *_impact(writer.n)]
    kept = len(readings) + 1
    results = ["bad", *(f"kept{i}" for i in range(kept - 1)), *state]
    changing = [*results, *sorted(carried(step) - {*results})]
    place = {name: f"room[{i} * LANES + l]" for i, name in enumerate([*changing, *varying])}
    bad = place["bad"]
    load = [f"{name} = {where}" for name, where in place.items()] + in_time
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
        *(f"                {line}" for line in [*load, *step]),
        *(f"                {place[name]} = {name}" for name in changing),
        f"        for i in range({len(state)}):",
        "            for l in range(count):",
        f"                results[{kept} + g * {len(state)} + i, start + l] = room[({kept} + i) * LANES + l]",
        *(f"    for l in range(LANES): {bad} = {bad} if {finite(place[f'y{i}'])} else 1.0" for i in lasting),
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
    lines = [f"p{i} = parameters[{i}, start + min(l, count - 1)]" for i in range(traced.sets)]
    lines += traced.program.source(given)
    assumed = [*traced.program.assumptions(), *map(finite, given)]
    assumed += [f"{name} > 0.0" for name in run.positive() if name in given]
    lines += ["bad = 0.0", *(f"bad = bad if {each} else 1.0" for each in assumed)]
    lines += [f"P{i} = 0.0" for i in range(laws * nc)] + [f"r{i} = 0.0" for i in range(nc)]
    for i, each in enumerate(readings):
        value = "INFINITY" if each.kind == "min" else "-INFINITY"
        value = value if each.array == "r" else _series(each, writer.n)
        lines += [f"kept{i} = 0.0", f"best{i} = {value}"] if each.kind == "argmax" else [f"kept{i} = {value}"]
    return lines


def _series(reading: SeriesReading, n: int) -> str:
    """Return the variable of a series after a step."""
    return {"q": f"y{reading.column}", "v": f"y{n + reading.column}", "r": f"r{reading.column}"}[reading.array]


def _lasting(writer: StepWriter) -> list[int]:
    """Return the coordinates whose new value has their last one as a term: once infinite or NaN, they are so to the end."""
    laws, nc, _ = writer.table.W.shape
    return [i for i in range(writer.n) if writer.table.known[i, 2 * laws * nc + i] != 0.0]


def carried(step: list[str]) -> set[str]:
    """Return the names that a step sets, but reads before."""
    read = set[str]()
    assigned = set[str]()
    known = dict[str, int]()
    for line in step:
        depth = len(line) - len(line.lstrip())
        known = {name: each for name, each in known.items() if each <= depth}
        targets, values = (re.findall(r"\b[^\W\d]\w*", part) for part in line.rpartition(" = ")[::2])
        read |= {*values} - known.keys()
        known = dict.fromkeys(targets, depth) | known
        assigned |= {*targets}
    return read & assigned


def _kept(readings: tuple[SeriesReading, ...], n: int) -> list[str]:
    """Return the lines that keep the readings of the series."""
    lines = []
    for i, each in enumerate(readings):
        value = _series(each, n)
        if each.kind == "argmax":
            lines += [f"kept{i} = now if {value} > best{i} else kept{i}", f"best{i} = max({value}, best{i})"]
        else:
            lines.append(f"kept{i} = {each.kind}({value}, kept{i})")
    return lines


def _impact(n: int) -> list[str]:
    """Return the lines that keep the velocity before an impact, and its step; one in the first step is irregular."""
    return [
        "hit = r0 > 0.0 and pushed <= 0.0",
        *(f"left{i} = from{i} if hit else left{i}" for i in range(n)),
        "struck = now - 1.0 if hit else struck",
        "bad = 1.0 if struck == 0.0 else bad",
    ]


def two_rows(solve: SolveLaw) -> list[str]:
    """Return the lines that solve a law of two rows as `closed_form` does, on those of them that are active, and check it.

    With x and y from one row alone, and x_both and y_both from both, the same cases are looked at in the same order.
    """
    z = [f"z{2 * solve.law + i}" for i in range(2)]
    a, b, c, d = (f"W_{solve.law}_{i}_{j}" for i in range(2) for j in range(2))
    lines = [f"on{i} = {condition or 'True'}" for i, condition in enumerate(solve.touching)]
    lines += [
        "both = on0 and on1",
        f"x, y = -free0 / {a}, -free1 / {d}",
        "open = free0 >= 0.0 and free1 >= 0.0",
        f"first = free0 < 0.0 and x * {c} + free1 >= 0.0",
        f"second = free1 < 0.0 and y * {b} + free0 >= 0.0",
        f"swap = abs({a}) < abs({c})",
        f"A, B, F = {c} if swap else {a}, {d} if swap else {b}, free1 if swap else free0",
        f"C, D, G = {a} if swap else {c}, {b} if swap else {d}, free0 if swap else free1",
        "multiplier = C / A",
        "rest = D - multiplier * B",
        "y_both = (multiplier * F - G) / rest",
        "x_both = -(F + B * y_both) / A",
        "closed = abs(rest) > 1e-15 * (abs(D) + abs(multiplier * B))",
        "closed = closed and 0.0 <= x_both and x_both < INFINITY and 0.0 <= y_both and y_both < INFINITY",
        "bad = bad if not both or open or first or second or closed else 1.0",
        f"{z[0]} = x if first else (0.0 if second else x_both)",
        f"{z[1]} = 0.0 if first else (y if second else y_both)",
        f"{z[0]} = (0.0 if open else {z[0]}) if both else (max(x, 0.0) if on0 else 0.0)",
        f"{z[1]} = (0.0 if open else {z[1]}) if both else (max(y, 0.0) if on1 else 0.0)",
    ]
    for i, row in enumerate(((a, b), (c, d))):
        s, t = (f"{W} * {each}" for W, each in zip(row, z, strict=True))
        lines += [
            f"w, size = free{i} + {s} + {t}, tol * abs(free{i})",
            f"terms = {4.0 * EPS!r} * (abs(free{i}) + abs({s}) + abs({t}))",
            f"held = w >= -size if {z[i]} == 0.0 else ({z[i]} > 0.0 and abs(w) <= size and terms <= size)",
            f"bad = bad if held or not on{i} else 1.0",
        ]
    return lines


def _lane(statement: Statement, certain: set[str]) -> list[str]:
    """Return the lines of a statement for one lane, without what only counts the work, and checks of what is certain."""
    match statement:
        case Set("worst", _) | When(_, (Set("worst", _),)) | StoreStatement():
            return []
        case Set(name, value):
            return [f"{name} = {value}"]
        case When(condition, then):
            return [f"if {condition}:", *(f"    {line}" for each in then for line in _lane(each, certain))]
        case Unless(condition):
            return [f"bad = bad if {each} else 1.0" for each in condition.split(" and ") if each not in certain]
        case SolveLaw():
            return two_rows(statement)
