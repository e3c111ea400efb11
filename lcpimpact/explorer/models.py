"""The model of a problem in a page: its sliders, and its runs by some methods as formulas of them."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, cast

import numpy as np

from lcpimpact.arrays import Array
from lcpimpact.errors import LcpImpactError, UnsupportedError
from lcpimpact.formula import NotTracedError, Program
from lcpimpact.integrators.moreau_jean import MoreauJean
from lcpimpact.integrators.printed.traced_run import TracedRun, trace_run
from lcpimpact.integrators.stepping.linear_step import LinearStep
from lcpimpact.problems.base import Problem
from lcpimpact.problems.parameters import changes_at, constants_of, is_registered, numbers_of
from lcpimpact.scheme.dynamics import Dynamics
from lcpimpact.scheme.lagrangian import LagrangianDynamics
from lcpimpact.scheme.signals import Harmonic, check_harmonics
from lcpimpact.scheme.sparse_dynamics import TAKE_SCHEME, SparseDynamics
from lcpimpact.simulation import check_handled, make_integrator
from lcpimpact.sweeps.job import Job, changes_of

STEPS = 1000
"""Number of steps in the run that a page shows first."""

MAX_NODES = 8
"""Number of nodes above which the formulas of a table are longer than all others of a page together."""

MAX_ROWS = 6
"""Maximum number of rows with a law of a problem in a page, which tries their cases one after the other."""

MOST_STEPS = 10_000
"""Maximum number of steps of a run in a page."""

MAX_CASES = 3
"""Maximum number of traces of a method that a page stores, each with its own sequence of pivots or other choices."""

THETA = (0.5, 1.0)
"""Range of the option θ of moreau-jean."""

LOWER, UPPER = (0.25, 0.5, 0.8, 0.95), (4.0, 2.0, 1.25, 1.05)
"""Factors of a value that its slider may reach, the widest that the problem accepts."""

FIRST = (
    "moreau-jean",
    "schatzman-paoli",
    "moreau-midpoint",
    "newmark-ns",
    "rattle-ns",
    "stormer-verlet-ns",
    "cd-lagrange",
    "d1-minus",
    "generalized-alpha",
)
"""The methods with a linear step, those first of which a page holds some."""

REFUSALS = (LcpImpactError, NotTracedError, TypeError, ValueError, ArithmeticError)
"""Exceptions of a builder that is not pure arithmetic, or that refuses its values."""


@dataclass(frozen=True)
class PageSlider:
    """A number that a page can change.

    Attributes
    ----------
    name : str              its address (see `lcpimpact.problems.parameters`)
    value, low, high : float
    """

    name: str
    value: float
    low: float
    high: float


@dataclass(frozen=True, eq=False)
class PageTrace:
    """A run as formulas of the numbers of some names and of its end, which is the last parameter of the program.

    Attributes
    ----------
    names : tuple of str
    method : LinearStep         with its options as numbers
    program : Program
    dynamics : Dynamics         with formulas
    start : pair of (n,) arrays q and v at t = 0
    run : TracedRun
    """

    names: tuple[str, ...]
    method: LinearStep
    program: Program
    dynamics: Dynamics
    start: tuple[Array, Array]
    run: TracedRun

    def holds(self, values: Mapping[str, float], t_end: float, steps: int) -> bool:
        """Return whether the formulas are those of a run with these values."""
        return self.program.holds([*(values[name] for name in self.names), t_end, t_end, steps, 0.0, t_end / steps])


@dataclass(frozen=True, eq=False)
class Model:
    """A problem in a page.

    Attributes
    ----------
    problem : Problem
    t_end : float
    sliders : list of Slider
    numbers : dict of str to float          all numbers, those without a slider too
    traces : dict of str to list of Trace   by method: the formulas of its runs, in the cases that sliders reach
    """

    problem: Problem
    t_end: float
    sliders: list[PageSlider]
    numbers: dict[str, float]
    traces: dict[str, list[PageTrace]]


def why_not_taken(d: Dynamics | SparseDynamics) -> str:
    """Return the property of a system for which no step is printed, in words; "" for none."""
    if isinstance(d, SparseDynamics):
        return f"sparse matrices, for which no step is printed: {TAKE_SCHEME}"
    if isinstance(d, LagrangianDynamics):
        return "matrices that change as it moves, as a Lagrangian system"
    if len(d.nodes) > MAX_NODES:
        return f"more than {MAX_NODES} nodes, whose formulas are too long for a page"
    for has, what in (
        (bool(d.force_laws), "forces by a function of the motion"),
        (bool(d.springs), "non-linear springs"),
        (bool(d.dashpots), "non-linear dashpots"),
        (bool(d.holds), "sampled forces"),
        (d.has_other_impact_law, "a law of impact other than Newton's"),
        (d.decomposition.static.shape[1] > 1, "several quasi-static nodes"),
        (len(d.impulse_lines) > 0, "contacts that pass impulses on over nodes without mass"),
        (len(d.contacts) > MAX_ROWS, f"more than {MAX_ROWS} rows with a law, whose cases are too many for a page"),
        (len(d.contacts) > 1 and d.bilateral.any(), "joints beside other rows"),
    ):
        if has:
            return what
    return ""


def why_not_exact(d: Dynamics) -> str:
    """Return why a page does not know the exact motion of a system; "" if it does."""
    if not d.stores_energy:
        return "the exact motion of a system given by its matrices is not drawn here"
    sliders = (d.thresholds > 0.0) & (d.r_min == -d.r_max)
    if not (d.impenetrable | (sliders & (d.relative_degree > 0))).all():
        return "the exact motion is drawn for contacts, and for sliders on a mass or a dashpot"
    if any(
        callable(load) and not isinstance(load, Harmonic)
        for load in (*(load for _, load in d.loads), *d.motions.values())
    ):
        return "the exact motion is drawn for constant and harmonic loads and motions"
    return ""


def model(problem: Problem, t_end: float, methods: Sequence[str] = (), most: int = 3) -> Model:
    """Trace the runs of a problem by the first methods whose step is straight-line code, by default of `FIRST`.

    Raises
    ------
    UnsupportedError
        If no method has such a step for the problem.
    """
    if why := why_not_taken(problem.dynamics):
        raise UnsupportedError(f"the explorer does not take {problem.name!r}: it has {why}")
    traces = dict[str, list[PageTrace]]()
    refused = dict[str, str]()
    numbers = _numbers(problem, t_end)
    for method in methods or FIRST:
        if len(traces) == most:
            break
        try:
            traces[method] = [trace_most(problem, method, numbers, t_end)]
        except LcpImpactError as error:
            refused[method] = str(error)
        except REFUSALS:
            refused[method] = "its equations are no sums, products and square roots of its numbers"
    if not traces:
        raise UnsupportedError(f"the explorer does not take {problem.name!r}: {next(iter(refused.values()))}")
    sliders = []
    for name in dict.fromkeys(name for each in traces.values() for name in each[0].names):
        uses = [each[0] for each in traces.values() if name in each[0].names]
        slider = _slider(name, problem, uses[0], numbers, t_end)
        if slider:
            sliders.append(slider)
    found = Model(problem, t_end, sliders, numbers, traces)
    _add_cases(found)
    return found


def _numbers(problem: Problem, t_end: float) -> dict[str, float]:
    """Return the numbers that sliders change: parameters, or the constants of elements where these are no formulas."""
    numbers = numbers_of(problem)
    if not is_registered(problem) or _is_traced(problem, "moreau-jean", numbers, t_end):
        return numbers
    traced = [name for name, value in numbers.items() if _is_traced(problem, "moreau-jean", {name: value}, t_end)]
    return numbers if 2 * len(traced) > len(numbers) else constants_of(problem)


def trace_most(problem: Problem, method: str, numbers: Mapping[str, float], t_end: float) -> PageTrace:
    """Trace a run as formulas of as many of the numbers as possible: those with which alone it can be traced."""
    integrator = make_integrator(method, {})
    if not isinstance(integrator, LinearStep):
        raise UnsupportedError(f"a step of {method!r} is no linear one")
    check_handled(integrator, problem)
    options = {"theta": integrator.theta} if isinstance(integrator, MoreauJean) and "theta" not in numbers else {}
    every = {**numbers, **options}
    try:
        return trace(problem, method, every, t_end)
    except UnsupportedError:
        raise
    except REFUSALS:
        kept = {name: value for name, value in every.items() if _is_traced(problem, method, {name: value}, t_end)}
        return trace(problem, method, kept, t_end)


def _is_traced(problem: Problem, method: str, values: Mapping[str, float], t_end: float) -> bool:
    try:
        trace(problem, method, values, t_end)
    except REFUSALS:
        return False
    return True


def trace(problem: Problem, method: str, values: Mapping[str, float], t_end: float, steps: int = STEPS) -> PageTrace:
    """Trace a run as formulas of numbers at these values."""
    job = Job(problem, make_integrator(method, {}), t_end / steps, t_end, "auto")
    change = changes_of(job, tuple(values))
    program = Program()
    formulas: dict[str, Any] = {name: program.parameter(value) for name, value in values.items()}
    alone, traced = change(values), change(formulas)
    end: Any = program.parameter(t_end)
    methods = cast(LinearStep, traced.integrator), cast(LinearStep, alone.integrator)
    start = traced.problem.initial_coordinates, traced.problem.initial_velocities
    d = traced.problem.dynamics
    check_harmonics((*(load for _, load in d.loads), *d.motions.values()), end)
    run = trace_run(methods, (d, alone.problem.dynamics), start, job.grid, program, end=end, open_forms=True)
    return PageTrace(tuple(values), methods[1], program, d, start, run)


def _slider(
    name: str, problem: Problem, traced: PageTrace, numbers: Mapping[str, float], t_end: float
) -> PageSlider | None:
    """Return the slider of a number, over the widest range that the problem accepts with the same formulas."""
    values = {**numbers, "theta": numbers.get("theta", THETA[0])}
    value = values[name]
    if name not in numbers:
        return PageSlider(name, value, *THETA)
    factors: tuple[Sequence[float], Sequence[float]]
    if value == 0.0:
        factors = ((-1.0, -0.1), (1.0, 0.1))
    else:
        widest, *others = UPPER
        factors = (LOWER, (widest, *([1.0 / value] if 0.0 < value < 1.0 else []), *others))
    ends = []
    for each in factors:
        tried = [float(f"{factor * value:.4g}") if value else factor for factor in each]
        ends.append(
            next((end for end in tried if _accepts(problem, traced, {**values, name: end}, numbers, t_end)), value)
        )
    low, high = sorted(ends)
    return PageSlider(name, value, low, high) if low < high else None


def refusals_of(found: Model) -> dict[str, list[tuple[str, float, str]]]:
    """Return the messages of Python for numbers that it refuses, by name: a comparison, a bound, and a text with {value}."""
    refused: dict[str, list[tuple[str, float, str]]] = {}
    for name in (each.name for each in found.sliders):
        tried: list[tuple[str, float, tuple[float, ...]]] = [("<", 0.0, (-1.5, -2.0)), ("=", 0.0, (0.0,))]
        if name not in found.numbers:
            tried = [("<", THETA[0], (0.25, 0.375)), (">", THETA[1], (1.5, 2.5))]
        elif name.rpartition(".")[2] == "e":
            tried.append((">", 1.0, (1.5, 2.5)))
        for comparison, bound, values in tried:
            texts = {_refusal(found, name, value) for value in values}
            text = texts.pop() if len(texts) == 1 else ""
            # What names other numbers, too, would not be true of theirs.
            if "= {value}" in text and not re.search(r"= -?\d", text):
                refused.setdefault(name, []).append((comparison, bound, text))
    return refused


def _refusal(found: Model, name: str, value: float) -> str:
    """Return the message for a number that is refused, with {value} in its place; "" if it is not."""
    try:
        if name in found.numbers:
            changed = changes_at(found.problem, (name,))({name: value})
            return "" if changed.dynamics.nodes else "?"
        make_integrator("moreau-jean", {name: value})
    except LcpImpactError as error:
        return str(error).replace(repr(value), "{value}")
    return ""


def _accepts(
    problem: Problem, traced: PageTrace, values: Mapping[str, float], numbers: Mapping[str, float], t_end: float
) -> bool:
    """Return whether a problem has a motion with these values, by the same formulas."""
    try:
        changed = changes_at(problem, tuple(numbers))({name: values[name] for name in numbers})
    except REFUSALS:
        return False
    return bool(changed.dynamics.nodes) and traced.holds(values, t_end, STEPS)


def _add_cases(found: Model, *, samples: int = 24) -> None:
    """Trace runs anew at values of the sliders, of so many samples, for which no formulas hold yet."""
    rng = np.random.default_rng(0)
    for method, traces in found.traces.items():
        for share in rng.random((samples, len(found.sliders) + 1)):
            values = {
                each.name: each.low + x * (each.high - each.low) for each, x in zip(found.sliders, share, strict=False)
            }
            values = {"theta": THETA[0], **found.numbers, **values}
            steps = int(MOST_STEPS ** share[-1]) + 1
            if len(traces) == MAX_CASES or any(each.holds(values, found.t_end, steps) for each in traces):
                continue
            try:
                new = trace(found.problem, method, {name: values[name] for name in traces[0].names}, found.t_end, steps)
            except REFUSALS:
                continue
            traces.append(new)
