r"""Errors of methods over steps and tolerances, with the cost of each run.

An observed order may be accidental: errors are smaller if an event falls on a grid point, or always at the same fraction of
its step. So each requested step becomes t_end/n with the smallest prime n >= t_end/dt for which no event of the reference
is closer than 1e-6 steps to a grid point.

No method is its own reference: `lcpimpact.study.accuracy.reference` excludes the methods under study, and each row names the
reference of its errors.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import pandas as pd

from lcpimpact.arguments import checked
from lcpimpact.errors import InputError, LcpImpactError
from lcpimpact.integrators.base import Integrator
from lcpimpact.numbers import count, positive
from lcpimpact.problems.base import Problem
from lcpimpact.problems.penalty import penalized
from lcpimpact.registry import nearest
from lcpimpact.simulation import make_integrator
from lcpimpact.study.accuracy.fitted_order import observe, stated
from lcpimpact.study.accuracy.gradients import COLUMNS, Gradient
from lcpimpact.study.accuracy.limits import Limit, chosen_options, declared_order, limits_of
from lcpimpact.study.accuracy.norms import NORMS, ErrorLabel, error_norms
from lcpimpact.study.accuracy.reference import Reference, given_reference
from lcpimpact.study.accuracy.reference import reference as find_reference
from lcpimpact.study.progress import Progress, watched
from lcpimpact.study.result import Study, failure_lines, table_lines
from lcpimpact.sweeps.job import Job
from lcpimpact.trajectory import Trajectory

Penalty = tuple[str, float] | tuple[str, float, Mapping[str, float]]
"""A law, its stiffness k, and further arguments of `penalized`."""

Methods = Sequence[str | Integrator] | Mapping[str, str | Integrator]
"""Names or objects, or a mapping from labels to either."""

RTOLS = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10)
"""Relative tolerances of methods with adaptive steps."""

SCALES: dict[str, Callable[[Trajectory], float]] = {
    "sup_q": lambda truth: float(np.abs(truth.q).max()),
    "l1_v": lambda truth: float(np.abs(truth.v).max() * truth.t[-1]),
    "l2_v": lambda truth: float(np.abs(truth.v).max() * math.sqrt(truth.t[-1])),
    "hausdorff_v": lambda truth: 1.0,
    "event_times": lambda truth: float(truth.t[-1]),
    "impulses": lambda truth: max((abs(event.impulse) for event in truth.events), default=0.0),
    "energy": lambda truth: truth.certificate.energy_scale,
    "penetration": lambda truth: float(np.abs(truth.q).max()),
    "complementarity": lambda truth: truth.certificate.energy_scale,
}
"""Scale of an error in each norm."""

COUNTS = (*("steps", "closings", "events"), *("lcp_solves", "lcp_iterations", "newton_iterations", "evaluations"))
"""Columns of counters."""

GRIDS = "dt = t_end/n, n raised to a prime that keeps events off the grid"
"""Choice of the steps, in words."""

COSTS = ("steps", "lcp_solves", "lcp_iterations", "newton_iterations", "evaluations", "seconds")
"""Columns of the cost of a run."""


def labelled(methods: Methods) -> dict[str, Integrator]:
    """Return the methods by label: the key of the mapping, or the name with its non-default options.

    Raises
    ------
    InputError
        For an unknown name, an empty list, or a duplicate label.

    Examples
    --------
    >>> from lcpimpact.integrators.moreau_jean import MoreauJean
    >>> list(labelled(["moreau-jean", MoreauJean(theta=1.0)]))
    ['moreau-jean', 'moreau-jean(theta=1.0)']
    """
    if isinstance(methods, str):
        raise InputError(f"methods = {methods!r} must be a list of methods: write [{methods!r}]")
    if isinstance(methods, Mapping):
        found = {str(label): make_integrator(method, {}) for label, method in methods.items()}
    else:
        found = {}
        for method in methods:
            integrator = make_integrator(method, {})
            label = _label(integrator)
            if label in found:
                raise InputError(f"methods: {label!r} is listed twice; leave one out, or label them by a mapping")
            found[label] = integrator
    if not found:
        raise InputError("methods is empty: name at least one of 'lcpimpact list methods'")
    return found


def _label(integrator: Integrator) -> str:
    chosen = [f"{name}={value}" for name, value in chosen_options(integrator).items()]
    return f"{integrator.name}({', '.join(chosen)})" if chosen else integrator.name


def steps_clear_of(
    events: Iterable[float], t_end: float, dt: float, *, event_clearance: float = 1e-6, max_primes: int = 50
) -> int:
    """Return the smallest prime n >= t_end/dt for which no event is closer than 1e-6 steps to a grid point.

    ``event_clearance``: minimum distance of events of the reference from grid points, in steps.
    ``max_primes``: maximum number of primes tried; if events are so dense that all fail, the first is used.

    Parameters
    ----------
    events : iterable of float
        Instants in s; those at 0 and at t_end are on every grid and are ignored.
    t_end, dt : float
        End and requested step, in s.

    Examples
    --------
    >>> steps_clear_of([], 1.0, 0.1), steps_clear_of([3.0 / 11.0], 1.0, 0.1)
    (11, 13)
    """
    times = np.array([t for t in events if 0.0 < t < t_end])
    first = n = _prime_from(math.ceil(t_end / dt * (1.0 - 1e-12)))
    for _ in range(max_primes):
        place = times * (n / t_end)
        if (np.abs(place - np.rint(place)) > event_clearance).all():
            return n
        n = _prime_from(n + 1)
    return first


def _prime_from(n: int) -> int:
    """Return the smallest prime >= n."""
    n = max(n, 2)
    while any(n % d == 0 for d in range(2, math.isqrt(n) + 1)):
        n += 1
    return n


@dataclass(frozen=True, eq=False, repr=False)
class Convergence(Study):
    """Errors of methods over their steps.

    Columns and attributes of its table are accessible directly: ``study["sup_q"]`` is ``study.table["sup_q"]``.

    Attributes
    ----------
    problem : Problem
    t_end : float           s
    table : DataFrame       one row per variant, method and step, see `convergence`
    norm : str              norm of the summary, plot and report: that of the declared orders, if measured
    limited_by : Limit      what limits the orders, see `lcpimpact.study.accuracy.limits`; None without a reference
    scales : mapping        norm to the scale of its errors
    """

    problem: Problem
    t_end: float
    table: pd.DataFrame
    norm: str
    limited_by: Limit | None = None
    scales: Mapping[str, float] = field(default_factory=dict)

    drawn_by = "lcpimpact.plotting.convergence:plot_convergence"
    title = "Convergence on {0.problem.name}"

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any:
            if name.startswith("_") or name == "table":
                raise AttributeError(name)
            return getattr(self.table, name)

    def __getitem__(self, key: str) -> pd.Series:
        return self.table[key]

    def __len__(self) -> int:
        return len(self.table)

    @property
    def norms(self) -> Mapping[str, ErrorLabel]:
        """The errors in the table by the names of their columns, with their words."""
        return {name: norm for name, norm in NORMS.items() if name in self.table}

    def head(self) -> list[str]:
        """Return the first lines of the summary: the problem, the references and the norm."""
        references = " or ".join(dict.fromkeys(name for name in self.table["reference"] if name)) or "nothing"
        limit = "nothing" if self.limited_by is None else self.limited_by.name
        norm = self.norms[self.norm]
        unit = norm.unit_in(self.problem)
        end = f"{self.t_end:g} {self.problem.own_unit('s')}".rstrip()
        return [
            f"{self.problem.name} to t = {end}, against {references}; orders limited by: {limit}",
            f"{self.norm}: {norm.what}" + (f", {unit}" if unit else ""),
            GRIDS,
        ]

    def remarks(self) -> list[str]:
        """Return a line for each reason of failure, and for each method whose runs violate laws."""
        broken = self.table[self.table["violation"] != ""]
        return failure_lines(self.failures) + [
            f"  {len(runs)} whose certificate fails: {runs['violation'].iloc[0]}"
            for _, runs in broken.groupby("method", sort=False)
        ]

    def summary(self) -> str:
        """Return the observed order of each method, its standard error, the declared order, and the failures."""
        orders = observed_orders(self, self.norm).to_dict("records")
        return "\n".join([*self.head(), *map(_order_line, orders), *self.remarks()])


@checked
def observed_orders(study: Convergence, norm: str | None = None) -> pd.DataFrame:
    """Fit the order of each method of a convergence study, and compare it with the declared order.

    Parameters
    ----------
    study : Convergence
        Result of `lcpimpact.convergence`.
    norm : str, optional
        One norm of its table; by default all.

    Returns
    -------
    DataFrame
        One row per method, law, stiffness and norm:

        - ``method``, ``law``, ``k``, ``norm``
        - ``order``: slope of log error against log dt; NaN for fewer than two usable errors
        - ``scatter``: standard deviation of log10 of the errors about the line
        - ``standard_error``: standard error of the slope
        - ``points``: number of fitted errors
        - ``rounding``: number of errors excluded because they are at the level of rounding or of the reference's error
        - ``failed``: number of runs without a result
        - ``declared``: order declared by the method for this problem, in the norm of the declaration; else NaN. It is the
          minimum of the orders declared for those of smooth motion, kinks and jumps of the force, friction and impacts
          that occur in the reference
        - ``verdict``: "as declared" if the order is within 0.2 of the declared one in smooth motion and within 0.35 with
          events, or if the errors of a method that is exact, or follows rtol, are small enough; else "off". "too few steps
          to tell" with events and fewer than six errors, or if two standard errors reach the band. "" if nothing is
          declared; "rounding" if no order is observable; "failed" if no run has a result

    Examples
    --------
    >>> from lcpimpact import convergence, load_problem, observed_orders
    >>> study = convergence(load_problem("system-1"), ["moreau-jean"], [0.01 / 1.6**i for i in range(6)])
    >>> orders = observed_orders(study, "sup_q")
    >>> orders["verdict"].item(), bool(abs(orders["order"].item() - 2.0) < 0.35)
    ('as declared', True)
    """
    present = list(study.norms)
    if norm is not None and norm not in present:
        raise InputError(f"norm = {norm!r} is not in the table; it has {', '.join(present) or 'none'}")
    limit, rows = study.limited_by, []
    for (method, law, k), runs in study.table.groupby(["method", "law", "k"], sort=False, dropna=False):
        for name in present if norm is None else [norm]:
            declared = float(runs["declared"].iloc[0]) if limit is not None and limit.norm == name else math.nan
            found = observe(runs, name, study.scales.get(name, 0.0), declared, limit)
            rows.append({"method": method, "law": law, "k": k, "norm": name} | found)
    table = pd.DataFrame(rows)
    # What is asked for stands in the first and last columns, which a narrow terminal shows.
    first = [name for name in ("method", "order", "standard_error") if name in table]
    return table[[*first, *(name for name in table if name not in first)]]


def _order_line(row: Mapping[str, Any]) -> str:
    name = row["method"] if row["law"] == "rigid" else f"{row['method']}, {row['law']} k={row['k']:g}"
    if row["points"] < 2:
        return f"  {name:<28} {row['verdict'] or 'no order to be seen'}"
    declared = "" if math.isnan(row["declared"]) else f"  declared {row['declared']:g}"
    return f"  {name:<28} order {stated(row['order'], row['standard_error'])}{declared}  {row['verdict']}"


@dataclass(frozen=True, eq=False, repr=False)
class WorkPrecision(Convergence):
    """Errors of methods over the cost of their runs.

    Attributes
    ----------
    problem, t_end, table, norm, limited_by, scales
        As in `Convergence`.
    cost : str              cost column of the summary, plot and report
    """

    cost: str = "seconds"

    drawn_by = "lcpimpact.plotting.convergence:plot_work_precision"
    title = "Work and precision on {0.problem.name}"

    def summary(self) -> str:
        """Return the error and the cost of each run, and the failures."""
        columns = ["method", "law", "k", "rtol", "dt", "steps", self.norm, self.cost]
        rows = self.table.loc[self.table["failure"] == "", list(dict.fromkeys(columns))]
        return "\n".join([*self.head(), *table_lines(rows), *self.remarks()])


@dataclass(frozen=True, eq=False, repr=False)
class GradientConvergence(Convergence):
    """Errors of the derivatives of discrete runs over their steps.

    Attributes
    ----------
    problem, t_end, table, norm, limited_by, scales
        As in `Convergence`; the norm is "gradient".
    gradient : Gradient         the derivative
    """

    gradient: Gradient = field(kw_only=True)

    title = "Convergence of {0.gradient.name} of {0.problem.name}"

    @property
    def norms(self) -> Mapping[str, ErrorLabel]:
        """The error of the derivative, with its words."""
        return {self.norm: self.gradient.label}

    def summary(self) -> str:
        """Return where the derivative of the runs of each method tends, its order, and the failures."""
        orders = observed_orders(self, self.norm).to_dict("records")
        groups = [runs for _, runs in self.table.groupby(["method", "law", "k"], sort=False, dropna=False)]
        lines = [self._limit_line(row, runs) for row, runs in zip(orders, groups, strict=True)]
        return "\n".join([*self.head(), *lines, *self.remarks()])

    def head(self) -> list[str]:
        """Return the first lines of the summary: the derivative, by the exact motion, and how that of runs is formed."""
        unit = f" {self.problem.own_unit(self.gradient.unit)}".rstrip()
        end = f"{self.t_end:g} {self.problem.own_unit('s')}".rstrip()
        return [
            f"{self.gradient.name} = {self.gradient.truth:.6g}{unit} on {self.problem.name} to t = {end}, by sensitivity",
            "of runs: differences so small that no event changes its step",
            GRIDS,
        ]

    def _limit_line(
        self, row: Mapping[str, float], runs: pd.DataFrame, *, part: float = 0.2, right_rtol: float = 1e-6
    ) -> str:
        """Return the line of one method: where the derivatives of its runs tend.

        ``part``: largest spread of the derivatives with the finer half of the steps, relative to their least error, for
        which they tend to a wrong number.
        ``right_rtol``: largest relative error of derivatives that are right with every step.
        """
        first = runs.iloc[0]
        name = first["method"] if first["law"] == "rigid" else f"{first['method']}, {first['law']} k={first['k']:g}"
        solved = runs[runs["failure"] == ""].sort_values("dt")
        finer = solved.iloc[: max(len(solved) // 2, min(len(solved), 2))]
        last = f"{finer['derivative'].iloc[0]:.6g}" if len(finer) else ""
        if len(solved) == 0:
            said = "no derivative"
        elif (solved[self.norm] <= np.maximum(solved["noise"], right_rtol * abs(self.gradient.truth))).all():
            said = f"right to {solved[self.norm].max():.0e}"
        elif len(solved) < 2:
            said = f"{last} with one step"
        elif np.ptp(finer["derivative"]) <= part * finer[self.norm].min():
            said = f"tends to {last}: wrong"
        elif row["order"] > 0.0 and finer[self.norm].max() < solved[self.norm].max():
            said = f"converges with order {stated(row['order'], row['standard_error'])}"
        else:
            said = "no limit to be seen"
        return f"  {name:<28} {said}"


@dataclass(frozen=True, eq=False)
class RowTask:
    """Specification of one row: method, problem (or why there is none), step and tolerance."""

    method: str
    integrator: Integrator
    law: str
    k: float
    variant: Problem | str
    t_end: float
    steps: int
    truth: Reference | str


Measure = Callable[[RowTask, Trajectory], dict[str, float]]
"""Function of the task and the run of a row that returns the columns of its errors."""


@checked
def convergence(
    problem: Problem,
    methods: Methods,
    dts: Sequence[float],
    *,
    t_end: float | None = None,
    norms: Sequence[str] | None = None,
    penalties: Sequence[Penalty] = (),
    reference: Trajectory | Reference | Literal["auto"] = "auto",
    repeats: int = 1,
    gradient: Sequence[str] | None = None,
    lcp_solver: str = "auto",
    progress: Progress = True,
) -> Convergence:
    r"""Run a problem, and its compliant variants, by several methods with several steps, and measure the errors.

    With ``gradient=("x@1", "H")`` the error of each run is that of its derivative of an output by a parameter,

    .. math:: |D_h y - D y|, \qquad D_h y = \frac{y_h(p + d) - y_h(p - d)}{2 d},

    with d so small that no event changes its step. D y, the derivative of the exact motion, is by `lcpimpact.sensitivity`.

    Parameters
    ----------
    problem : Problem
        Any problem with an available reference.
    methods : sequence or mapping
        Names or `Integrator` objects, or either by label; each runs every variant.
    dts : sequence of float
        Steps in s, each shortened to t_end/n, n a prime chosen to keep events off the grid; duplicates are dropped.
    t_end : float, optional
        End in s; by default that of the problem.
    norms : sequence of str, optional
        Names of `lcpimpact.study.accuracy.norms.NORMS`; by default all.
    penalties : sequence of tuples
        ``(law, k)`` or ``(law, k, {"v0": ...})`` for each compliant variant, as in `penalized`. Their errors against the
        rigid motion combine those of method and model.
    reference : Trajectory, Reference or "auto"
        Reference of the errors. "auto" is `lcpimpact.reference`, which is never computed by the
        method under study; nor is one that is given taken for its own method.
    repeats : int
        Runs of each row, interleaved; the time is their minimum, without compilation.
    gradient : (str, str), optional
        An output and a parameter, as in `lcpimpact.sensitivity`: measures the error of this derivative, in place of norms.
    lcp_solver : str
        For the methods that solve LCPs.
    progress : bool or callable
        As of `lcpimpact.study.progress`.

    Returns
    -------
    Convergence
        Its ``table`` has one row per variant, method and step, in this order:

        - ``method``: label; ``law``, ``k``: "rigid" and inf, or the law and its stiffness in N/m or N/mⁿ
        - ``rtol``: tolerance of a method that has one, else NaN; ``dt``: step in s, t_end/n
        - ``steps``: number of steps taken, n unless the method is adaptive
        - one column per norm, in its unit
        - ``closings``: number of closing events of contacts, compliant or rigid
        - ``events``: number of events of the run
        - ``lcp_solves``, ``lcp_iterations`` (pivots or sweeps), ``newton_iterations``
        - ``evaluations``: number of right-hand sides: stages of explicit methods, LCPs, and Newton iterations
        - ``seconds``: time of the run
        - ``declared``: order declared by the method for this problem
        - ``reference``: name of the reference of the errors
        - ``violation``: laws violated beyond the tolerance of the method, "" for none
        - ``failure``: why there is no result (the numbers are then NaN), else ""

        With ``gradient`` it is a `GradientConvergence`; in place of the norms there are ``gradient``, the error of the
        derivative, ``derivative``, that of the run, and ``noise``, what rounding leaves open of it.

    Raises
    ------
    InputError
        For invalid input. Unsupported problems and failed runs are rows of the table.

    Examples
    --------
    >>> from lcpimpact import convergence, load_problem
    >>> study = convergence(load_problem("system-1"), ["moreau-jean"], [1e-2, 1e-3], norms=["sup_q"])
    >>> [f"{row.steps} {row.sup_q:.0e}" for row in study.table.itertuples()]
    ['307 9e-04', '3001 2e-05']

    By how much does the place of a ball at 1 s depend on the height of its fall?

    >>> ball = load_problem("bouncing-ball", e=0.8)
    >>> print(convergence(ball, ["moreau-jean"], [1e-2, 1e-3], t_end=1.0, gradient=("x@1", "H")))
    d x@1/d H = -0.386502 m per m on bouncing-ball to t = 1 s, by sensitivity
    of runs: differences so small that no event changes its step
    dt = t_end/n, n raised to a prime that keeps events off the grid
      moreau-jean                  tends to 0: wrong
    """
    if gradient is not None and (norms is not None or reference != "auto"):
        raise InputError("gradient measures a derivative against sensitivity: leave out norms and reference")
    found = _run_all(
        problem, methods, dts, rtols=(), t_end=t_end, norms=norms, penalties=penalties, reference=reference,
        repeats=repeats, gradient=gradient, lcp_solver=lcp_solver, progress=progress,
    )  # fmt: skip
    return Convergence(**found) if gradient is None else GradientConvergence(**found)


@checked
def work_precision(
    problem: Problem,
    methods: Methods,
    dts: Sequence[float],
    *,
    rtols: Sequence[float] = RTOLS,
    t_end: float | None = None,
    norms: Sequence[str] | None = None,
    penalties: Sequence[Penalty] = (),
    reference: Trajectory | Reference | Literal["auto"] = "auto",
    repeats: int = 5,
    lcp_solver: str = "auto",
    progress: Progress = True,
) -> WorkPrecision:
    """Measure errors against costs: as `convergence`, but over tolerances for adaptive methods.

    A method with a tolerance (``event-driven``, or an object with ``rtol`` set) runs with each of ``rtols`` instead of each
    of ``dts``; the largest of ``dts`` is then its maximum step, or the spacing of its output. ``exact`` is one row. The
    methods alternate within each repeat, so that variations of the machine's speed affect all of them.

    Parameters
    ----------
    problem, methods, dts, t_end, norms, penalties, reference, repeats, lcp_solver, progress
        As in `convergence`.
    rtols : sequence of float
        Relative tolerances; atol, where a method has it, keeps its ratio to rtol.

    Returns
    -------
    WorkPrecision
        With a table as in `convergence`.

    Examples
    --------
    >>> from lcpimpact import load_problem, work_precision
    >>> study = work_precision(
    ...     load_problem("bouncing-ball"), ["moreau-jean", "event-driven"], [1e-2, 1e-3], rtols=[1e-4, 1e-8], t_end=1.0
    ... )
    >>> list(study.table["method"]), list(study.table["rtol"].dropna())
    (['moreau-jean', 'moreau-jean', 'event-driven', 'event-driven'], [0.0001, 1e-08])
    """
    return WorkPrecision(**_run_all(
        problem, methods, dts, rtols=rtols, t_end=t_end, norms=norms, penalties=penalties, reference=reference,
        repeats=repeats, lcp_solver=lcp_solver, progress=progress,
    ))  # fmt: skip


def _run_all(
    problem: Problem,
    methods: Methods,
    dts: Sequence[float],
    *,
    rtols: Sequence[float],
    t_end: float | None,
    norms: Sequence[str] | None,
    penalties: Sequence[Penalty],
    reference: Trajectory | Reference | Literal["auto"],
    repeats: int,
    lcp_solver: str,
    progress: Progress,
    gradient: Sequence[str] | None = None,
) -> dict[str, Any]:
    """Check the arguments, create and run the tasks, and return the fields of the result."""
    end = problem.t_end if t_end is None else t_end
    for name, values in (("t_end", [end]), ("dts", dts), ("rtols", rtols)):
        for value in values:
            positive(name, value)
    if not len(dts):
        raise InputError("dts is empty: give at least one step in s, for an order better six of them")
    if end / min(dts) > 1e9:
        raise InputError(f"dts: {min(dts):g} s cuts t_end = {end:g} s into more than 1e9 steps: take larger ones")
    count("repeats", repeats)
    taking_part = labelled(methods)
    names = list(NORMS) if norms is None else list(norms)
    for name in names or [""]:
        if name not in NORMS:
            raise InputError(nearest(str(name), list(NORMS), "norm"))
    asked = None if gradient is None else Gradient.of(problem, gradient, end)
    truths = _truths(problem, end, taking_part, reference)

    if asked is None:
        measure = _errors(names)
    else:
        names = list(COLUMNS)
        measure = _derivatives(asked, truths, penalties, lcp_solver)
    tasks = list(_tasks(problem, taking_part, dts, rtols, end, penalties, truths))

    found: list[dict[str, Any]] = [{} for _ in tasks]
    turns = ((number, turn) for turn in range(repeats) for number in range(len(tasks)))
    for number, turn in watched(turns, len(tasks) * repeats, "runs", progress):
        task, row = tasks[number], found[number]
        if turn == 0:
            row.update(_first(task, measure, lcp_solver))
        elif not row["failure"]:
            run = _simulate(task, lcp_solver)
            row["seconds"] = min(row["seconds"], run.stats.seconds)
    table = pd.DataFrame(found, columns=_columns(names)).astype(dict.fromkeys(COUNTS, "Int64"))
    known = next((truth.trajectory for truth in truths.values() if isinstance(truth, Reference)), None)
    if asked is not None:
        return {"problem": problem, "t_end": float(end), "table": table, "norm": names[0], "gradient": asked}
    if known is None:
        return {"problem": problem, "t_end": float(end), "table": table, "norm": names[0]}
    limit = limits_of(known)[-1]
    return {
        "problem": problem, "t_end": float(end), "table": table, "limited_by": limit,
        "norm": limit.norm if limit.norm in names else names[0], "scales": {name: SCALES[name](known) for name in names},
    }  # fmt: skip


def _errors(norms: Sequence[str]) -> Measure:
    """Return the measure of the error of a motion in norms."""

    def measure(task: RowTask, run: Trajectory) -> dict[str, float]:
        assert isinstance(task.truth, Reference)
        return error_norms(run, task.truth.trajectory, norms)

    return measure


def _derivatives(
    asked: Gradient, truths: dict[str, Reference | str], penalties: Sequence[Penalty], lcp_solver: str
) -> Measure:
    """Return the measure of the error of a derivative, and rename the references after the derivatives that they give."""
    exact = dict[str, float]()
    for name, truth in truths.items():
        if isinstance(truth, Reference):
            try:
                exact[name], said = asked.truth_unlike(name, truth)
                truths[name] = replace(truth, name=said)
            except LcpImpactError as error:
                truths[name] = str(error)
    laws = {penalty[:2]: penalty for penalty in penalties}

    def measure(task: RowTask, run: Trajectory) -> dict[str, float]:
        def again(p: float) -> Trajectory:
            changed = asked.with_value(p)
            if (law := laws.get((task.law, task.k))) is not None:
                changed = penalized_by(changed, law)
            return _simulate(replace(task, variant=changed), lcp_solver)

        return asked.measure(again, run, exact[task.integrator.name])

    return measure


def _columns(norms: Sequence[str]) -> list[str]:
    costs = [name for name in COSTS if name != "steps"]
    return [
        *("method", "law", "k", "rtol", "dt", "steps", *norms, "closings", "events", *costs),
        *("declared", "reference", "violation", "failure"),
    ]


def _truths(
    problem: Problem, t_end: float, methods: Mapping[str, Integrator], given: Trajectory | Reference | Literal["auto"]
) -> dict[str, Reference | str]:
    """Return the reference of each method by name, or why there is none."""
    if given != "auto":
        known = given_reference(given, problem, t_end)
        refused = (
            f"the reference that is given is by {_name(known.trajectory)} itself: give one by another method, or 'auto'"
        )
        names = [integrator.name for integrator in methods.values()]
        return {name: refused if name == _name(known.trajectory) else known for name in names}
    best = _truth(problem, t_end, ())
    found = {}
    for integrator in methods.values():
        own = isinstance(best, Reference) and _name(best.trajectory) == integrator.name
        found[integrator.name] = _truth(problem, t_end, (integrator.name,)) if own else best
    return found


def _truth(problem: Problem, t_end: float, unlike: tuple[str, ...]) -> Reference | str:
    try:
        return find_reference(problem, t_end, unlike=unlike)
    except LcpImpactError as error:
        return str(error)


def _name(truth: Trajectory) -> str:
    return truth.method.partition("(")[0]


def _tasks(
    problem: Problem,
    methods: Mapping[str, Integrator],
    dts: Sequence[float],
    rtols: Sequence[float],
    t_end: float,
    penalties: Sequence[Penalty],
    truths: Mapping[str, Reference | str],
) -> Iterable[RowTask]:
    variants: list[tuple[str, float, Problem | str]] = [("rigid", math.inf, problem)]
    for penalty in penalties:
        try:
            variants.append((*penalty[:2], penalized_by(problem, penalty)))
        except LcpImpactError as error:
            variants.append((*penalty[:2], str(error)))
    grids: dict[str, list[int]] = {}
    for name, truth in truths.items():
        events = [event.t for event in truth.trajectory.events] if isinstance(truth, Reference) else []
        grids[name] = list(dict.fromkeys(steps_clear_of(events, t_end, dt) for dt in dts))
    for law, k, variant in variants:
        for label, integrator in methods.items():
            truth, grid = truths[integrator.name], grids[integrator.name]
            by_tolerance = [] if integrator.rtol is None else [integrator.with_tolerance(rtol) for rtol in rtols]
            if by_tolerance or (rtols and integrator.declared.is_exact):
                grid = [min(grid)]
            for each in by_tolerance or [integrator]:
                for steps in grid:
                    yield RowTask(label, each, law, k, variant, t_end, steps, truth)


def penalized_by(problem: Problem, penalty: Penalty) -> Problem:
    """Return the problem with the compliant law of a penalty."""
    return penalized(problem, penalty[0], k=penalty[1], **dict(*penalty[2:]))


def _simulate(task: RowTask, lcp_solver: str) -> Trajectory:
    assert isinstance(task.variant, Problem)
    return Job(task.variant, task.integrator, task.t_end / task.steps, task.t_end, lcp_solver).run()


def _first(task: RowTask, measure: Measure, lcp_solver: str) -> dict[str, Any]:
    """Run a task for the first time, and return its row."""
    rtol = task.integrator.rtol
    limits = limits_of(task.truth.trajectory) if isinstance(task.truth, Reference) else ()
    row: dict[str, Any] = {
        "method": task.method,
        "law": task.law,
        "k": task.k,
        "rtol": math.nan if rtol is None else rtol,
        "dt": task.t_end / task.steps,
        "steps": task.steps,
        "declared": declared_order(task.integrator, limits) if limits and task.law == "rigid" else math.nan,
        "reference": task.truth.name if isinstance(task.truth, Reference) else "",
        "violation": "",
        "failure": "",
    }
    for reason in (task.variant, task.truth):
        if isinstance(reason, str):
            return row | {"failure": reason}
    try:
        _compile(task, lcp_solver)
        run = _simulate(task, lcp_solver)
        if not run.ended:
            return row | {"failure": run.message}
        with np.errstate(over="ignore", invalid="ignore"):
            found = measure(task, run)
    except LcpImpactError as error:
        return row | {"failure": str(error)}
    if any(math.isinf(value) for value in found.values()):
        return row | {"failure": f"{task.method} is unstable with dt = {row['dt']:.3g} s: take a smaller dt"}
    solved = bool(run.problem.dynamics.contacts)
    stats = run.stats
    return (
        row
        | found
        | {
            "steps": stats.steps,
            "closings": sum(event.kind in ("close", "impact") for event in run.events),
            "events": len(run.events),
            "lcp_solves": stats.lcp_solves if solved else 0,
            "lcp_iterations": stats.lcp_iterations if solved else 0,
            "newton_iterations": stats.newton_iterations,
            "evaluations": stats.evaluations,
            "seconds": stats.seconds,
            "violation": "" if run.success else run.message,
        }
    )


def _compile(task: RowTask, lcp_solver: str) -> None:
    """Take one step, so that compilation on first use is not timed."""
    _simulate(replace(task, t_end=task.t_end / task.steps, steps=1), lcp_solver)
