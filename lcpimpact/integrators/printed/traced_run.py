"""Runs as formulas of the parameters of their problem: the statements of a step, and the numbers that they name.

The tables are formulas of the parameters (see `lcpimpact.formula`), so that the same statements run any set of them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np

from lcpimpact.arrays import Array
from lcpimpact.errors import UnsupportedError
from lcpimpact.expressions import Assign, Name, equal, names, select
from lcpimpact.formula import Formula, NotTracedError, Number, Program, mentions, node
from lcpimpact.integrators.printed.step import StepWriter, write_step
from lcpimpact.integrators.stepping.kernel import StepTable
from lcpimpact.integrators.stepping.linear_step import LinearStep, varying_loads
from lcpimpact.integrators.stepping.static_balance import Static
from lcpimpact.numerics.rounding import EPS
from lcpimpact.record import Grid
from lcpimpact.scheme.dynamics import Dynamics

T = TypeVar("T", StepTable, Static)

TOLERANCES = 16.0 * EPS, 0.5
"""Least and greatest tolerance of an LCP in lanes. Between them |q + W z| <= tol |q| implies that the rounding of this sum
is within tol |q| too: its terms are together at most 3.2 |q|, and their rounding at most 10 EPS |q|."""


@dataclass(frozen=True)
class Clock:
    """The instants of a run as formulas: its end, the number of its steps, and the instants before and after a step."""

    end: Formula
    steps: Formula
    before: Formula
    after: Formula

    def lines(self) -> list[Assign]:
        """Return the lines that compute the instants of the step that ends as number ``now``, with the bits of `Grid`."""
        end, steps, now = node(self.end), node(self.steps), Name("now")
        return [
            Assign(self.before.name, (now - 1.0) * end / steps),
            Assign(self.after.name, select(equal(now, steps), end, now * end / steps)),
        ]


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

    def in_time(self) -> tuple[list[Assign], dict[str, Formula]]:
        """Return the lines that compute the signals of a step, and the formulas that these take as known."""
        if not self.signals:
            return [], {}
        program, clock = self.program, self.clock
        in_time = program.depending_on([clock.before, clock.after])
        if any(not in_time.isdisjoint(names(each)) for each in program.assumed):
            raise NotTracedError("a load or a prescribed motion has cases")
        loads = {f"load{j}": each for j, each in enumerate(self.signals)}
        known = {each.name for each in (*program.parameters, *program.lines.values())} - in_time
        inputs = program.inputs(loads, known) | {each.name: each for each in (clock.end, clock.steps)}
        return clock.lines() + program.assignments(loads, known), inputs


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
        places = self.writer.coefficients.items()
        return [
            name for name, (array, at) in places if array == "SKS" or (self.closed and array == "W" and at[1] == at[2])
        ]


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
        If the step is none of straight-line code (see `lcpimpact.integrators.printed.step`), has a law that is not
        taken, or a tolerance beyond `TOLERANCES`.
    NotTracedError
        If loads that depend on time and prescribed motions are not shared, and one is no sum of harmonics and no polynomial
        of numbers.
    """
    method, known_method = methods
    d, with_values = dynamics
    if d.holds:
        raise UnsupportedError(
            f"{d.holds[0].law.element} is set between steps, which straight-line code does not stop at"
        )
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
