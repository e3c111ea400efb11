r"""Errors of methods over steps and tolerances, with what each run cost, in one table.

The observed order of a method may be luck: where an event of the motion falls on a grid point, or always at the same
place in its step, errors are smaller than elsewhere. So each step that is asked for becomes t_end/n with n the smallest
prime, not below t_end/dt, for which no event of the reference lies within 1e-6 of a step of a grid point.

No method is its own reference: `lcpimpact.study.accuracy.reference` excludes the methods under study, and each row names the
reference of its errors.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
import pandas as pd

from lcpimpact.arguments import checked
from lcpimpact.errors import InputError, LcpImpactError
from lcpimpact.integrators import METHODS
from lcpimpact.integrators.base import Declared, Integrator
from lcpimpact.numbers import count, positive
from lcpimpact.problems.base import Problem
from lcpimpact.problems.penalty import penalized
from lcpimpact.registry import nearest
from lcpimpact.simulation import make_integrator, simulate
from lcpimpact.study.accuracy.norms import NORMS, errors
from lcpimpact.study.accuracy.reference import Reference
from lcpimpact.study.accuracy.reference import reference as find_reference
from lcpimpact.study.watch import Watch, unwatched
from lcpimpact.trajectory import Trajectory

Penalty = tuple[str, float] | tuple[str, float, Mapping[str, float]]
"""A law, its stiffness k, and what else `penalized` is to be given."""

Methods = Sequence[str | Integrator] | Mapping[str, str | Integrator]
"""Names or objects, or either of them by the label that it shall have."""

RTOLS = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10)
"""Tolerances of methods that choose their steps."""

EVENT_CLEARANCE = 1e-6
"""Distance, in steps, that events of the reference keep from grid points."""

MAX_PRIMES = 50
"""Number of primes tried; where none is clear of events, since they stand so dense, the first is used."""

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

COUNTS = (
    *("steps", "closings", "events"),
    *("lcp_solves", "lcp_iterations", "newton_iterations", "evaluations"),
)
"""The columns that count."""

COSTS = ("steps", "lcp_solves", "lcp_iterations", "newton_iterations", "evaluations", "seconds")
"""The columns that say what a run cost."""


@dataclass(frozen=True)
class Limit:
    """What limits the order of a method on a problem, and where its declared order stands.

    Attributes
    ----------
    name : str          "smooth", "force kink", "force jump", "friction", "impact", or "compliant law"
    order : str         field of `Declared`; "" where nothing is declared
    norm : str          the norm in which it is declared
    """

    name: str
    order: str
    norm: str = "sup_q"


SMOOTH = Limit("smooth", "order_smooth")
KINK = Limit("force kink", "order_force_kink")
JUMP = Limit("force jump", "order_force_jump")
FRICTION = Limit("friction", "order_friction")
IMPACT = Limit("impact", "order_impact", "l1_v")
COMPLIANT = Limit("compliant law", "")


def limits_of(truth: Trajectory) -> tuple[Limit, ...]:
    """Return what limits the orders on a motion, by its events; those that happen, the worst last.

    A contact that opens or closes counts by its relative degree: 0 a kink of the force, 1 a jump, 2 an impact, which may
    pass through contacts of a lower degree too. The jump at the start of a system is no matter of steps. A slider of
    degree 2 that sticks or slips is friction; where it has a spring or a dashpot in series, a kink or a jump. About the
    kinks and jumps of non-linear springs nothing is declared.

    Examples
    --------
    >>> from lcpimpact import load_problem, simulate
    >>> [limit.name for limit in limits_of(simulate(load_problem("system-1"), "exact", dt=0.1, t_end=3.0))]
    ['smooth', 'force jump']
    """
    d = truth.problem.dynamics
    contacts = {contact.name: contact for contact in d.contacts}
    happened = {SMOOTH}
    if d.springs:
        happened.add(COMPLIANT)
    for event in truth.events:
        if event.contact not in contacts:
            continue
        contact = contacts[event.contact]
        last = FRICTION if contact.r0 is not None else IMPACT
        if event.kind != "jump":
            happened.add((KINK, JUMP, last)[2 if event.kind == "impact" else contact.relative_degree])
    return tuple(limit for limit in (SMOOTH, KINK, JUMP, FRICTION, IMPACT, COMPLIANT) if limit in happened)


def floor_of(reference: str, norm: str) -> float:
    """Return the error of a reference of that name, relative to the scale of a norm, below which no error is seen.

    In the L2 norm of v a jump that comes late by δ counts as δ^(1/2).

    Examples
    --------
    >>> floor_of("exact", "sup_q"), floor_of("event-driven (rtol=1e-12, atol=1e-14)", "sup_q"), floor_of("exact", "l2_v")
    (1e-12, 1e-09, 1e-06)
    """
    method = METHODS.get(reference.replace("(", " ").split(" ")[0])
    floor = Declared.accuracy if method is None else method.declared.accuracy
    return math.sqrt(floor) if norm == "l2_v" else floor


def declared_order(integrator: Integrator, limits: Sequence[Limit]) -> float:
    """Return the order that a method declares where these limits hold, the least of them; nan where it declares none.

    What is declared holds for the usual options, and for any tolerance.

    Examples
    --------
    >>> from lcpimpact.integrators.moreau_jean import MoreauJean
    >>> declared_order(MoreauJean(), (SMOOTH, JUMP)), declared_order(MoreauJean(theta=1.0), (SMOOTH, JUMP))
    (2.0, nan)
    """
    if COMPLIANT in limits or not all(option in integrator.tolerances for option in _chosen(integrator)):
        return math.nan
    return float(min(getattr(integrator.declared, limit.order) for limit in limits))


def _chosen(integrator: Integrator) -> dict[str, Any]:
    """Return the options of a method that are not the usual ones."""
    values = {each.name: (getattr(integrator, each.name), each.default) for each in fields(integrator)}  # type: ignore[arg-type]
    return {name: value for name, (value, usual) in values.items() if value != usual}


def labelled(methods: Methods) -> dict[str, Integrator]:
    """Return the methods by label: that of the mapping, or the name with those options that are not the usual ones.

    Raises
    ------
    InputError
        For an unknown name, an empty list, and two methods of one label.

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
                raise InputError(f"methods: {label!r} stands there twice; leave one out, or label them by a mapping")
            found[label] = integrator
    if not found:
        raise InputError("methods is empty: name at least one of 'lcpimpact list methods'")
    return found


def _label(integrator: Integrator) -> str:
    chosen = [f"{name}={value}" for name, value in _chosen(integrator).items()]
    return f"{integrator.name}({', '.join(chosen)})" if chosen else integrator.name


def steps_clear_of(events: Iterable[float], t_end: float, dt: float) -> int:
    """Return the smallest prime n >= t_end/dt for which no event lies within 1e-6 of a step of a grid point.

    Parameters
    ----------
    events : iterable of float
        Instants in s; those at 0 and at t_end are on every grid, and do not count.
    t_end, dt : float
        End and the step that is wanted, in s.

    Examples
    --------
    >>> steps_clear_of([], 1.0, 0.1), steps_clear_of([3.0 / 11.0], 1.0, 0.1)
    (11, 13)
    """
    times = np.array([t for t in events if 0.0 < t < t_end])
    first = n = _prime_from(math.ceil(t_end / dt * (1.0 - 1e-12)))
    for _ in range(MAX_PRIMES):
        place = times * (n / t_end)
        if (np.abs(place - np.rint(place)) > EVENT_CLEARANCE).all():
            return n
        n = _prime_from(n + 1)
    return first


def _prime_from(n: int) -> int:
    """Return the smallest prime that is not below n."""
    n = max(n, 2)
    while any(n % d == 0 for d in range(2, math.isqrt(n) + 1)):
        n += 1
    return n


@dataclass(frozen=True, eq=False)
class Task:
    """One row to be: a method, the problem that it runs (or why there is none), the step, and the tolerance."""

    method: str
    integrator: Integrator
    law: str
    k: float
    variant: Problem | str
    t_end: float
    steps: int
    truth: Reference | str


@checked
def convergence(
    problem: Problem,
    methods: Methods,
    dts: Sequence[float],
    *,
    t_end: float | None = None,
    norms: Sequence[str] | None = None,
    penalties: Sequence[Penalty] = (),
    reference: Trajectory | Reference | None = None,
    repeats: int = 1,
    lcp_solver: str = "auto",
    watch: Watch = unwatched,
) -> pd.DataFrame:
    r"""Run a problem, and its compliant variants, by several methods with several steps, and measure every error.

    Parameters
    ----------
    problem : Problem
        Any problem that some reference can be found for.
    methods : sequence or mapping
        Names or `Integrator` objects, or either by label; each runs every variant.
    dts : sequence of float
        Steps in s, each shortened to t_end/n as the module says; two that become one are one.
    t_end : float, optional
        End in s; by default that of the problem.
    norms : sequence of str, optional
        Names of `lcpimpact.study.accuracy.norms.NORMS`; by default all.
    penalties : sequence of tuples
        ``(law, k)`` or ``(law, k, {"v0": ...})`` for each compliant variant, as of `penalized`. Their errors are those
        against the rigid motion: of the method and of the model together.
    reference : Trajectory or Reference, optional
        The truth; by default `lcpimpact.study.accuracy.reference.reference`, which is never by the method under study.
    repeats : int
        Runs of each row, in turn; the time is their minimum. What compiles is compiled before.
    lcp_solver : str
        For the methods that solve LCPs.
    watch : callable
        See `lcpimpact.study.watch`.

    Returns
    -------
    DataFrame
        One row a variant, method and step, in this order:

        - ``method``: label; ``law``, ``k``: "rigid" and inf, or the law and its stiffness in N/m or N/mⁿ
        - ``rtol``: tolerance of a method that has one, else NaN; ``dt``: step in s, t_end/n
        - ``steps``: steps taken, which are n unless the method chooses its own
        - one column a norm, in its unit
        - ``closings``: how often a contact closed, compliant or rigid, as the events tell
        - ``events``: number of events of the run
        - ``lcp_solves``, ``lcp_iterations`` (pivots or sweeps), ``newton_iterations``
        - ``evaluations``: right sides that were set up: stages of explicit methods, LCPs, and Newton iterations
        - ``seconds``: time of the run
        - ``declared``: the order that the method declares for this problem
        - ``reference``: what the errors were measured against
        - ``violation``: which of its laws the run breaks, by more than its method allows, "" for none
        - ``failure``: why there is no result, "" where there is one; then the numbers are NaN

        ``attrs``: problem, t_end, limited_by (what limits the order, see `limits_of`), declared_norm (the norm in which
        methods declare such an order), and for each norm ``scale_NORM``, what an error in it is to be compared with.

    Raises
    ------
    InputError
        For wrong input. What a method refuses, or a run that fails, is a row.

    Examples
    --------
    >>> from lcpimpact import convergence, load_problem
    >>> table = convergence(load_problem("system-1"), ["moreau-jean"], [1e-2, 1e-3], norms=["sup_q"])
    >>> [f"{row.steps} {row.sup_q:.0e}" for row in table.itertuples()]
    ['307 9e-04', '3001 2e-05']
    """
    return _run_all(problem, methods, dts, (), t_end, norms, penalties, reference, repeats, lcp_solver, watch)


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
    reference: Trajectory | Reference | None = None,
    repeats: int = 5,
    lcp_solver: str = "auto",
    watch: Watch = unwatched,
) -> pd.DataFrame:
    """Measure errors against costs: as `convergence`, with tolerances where a method chooses its steps.

    A method that has a tolerance (``event-driven``, or an object that was given ``rtol``) runs with each of ``rtols``
    instead of each of ``dts``; the largest of ``dts`` is then its longest step, or the spacing of its output. ``exact`` is
    one row. Methods take turns within each repeat, so that a slow minute of the machine falls on all of them.

    Parameters
    ----------
    problem, methods, dts, t_end, norms, penalties, reference, repeats, lcp_solver, watch
        As of `convergence`.
    rtols : sequence of float
        The tolerances; atol, where a method has it, keeps its ratio to rtol.

    Returns
    -------
    DataFrame
        As of `convergence`.

    Examples
    --------
    >>> from lcpimpact import load_problem, work_precision
    >>> table = work_precision(
    ...     load_problem("bouncing-ball"), ["moreau-jean", "event-driven"], [1e-2, 1e-3], rtols=[1e-4, 1e-8], t_end=1.0
    ... )
    >>> list(table["method"]), list(table["rtol"].dropna())
    (['moreau-jean', 'moreau-jean', 'event-driven', 'event-driven'], [0.0001, 1e-08])
    """
    return _run_all(problem, methods, dts, rtols, t_end, norms, penalties, reference, repeats, lcp_solver, watch)


def _run_all(
    problem: Problem,
    methods: Methods,
    dts: Sequence[float],
    rtols: Sequence[float],
    t_end: float | None,
    norms: Sequence[str] | None,
    penalties: Sequence[Penalty],
    reference: Trajectory | Reference | None,
    repeats: int,
    lcp_solver: str,
    watch: Watch,
) -> pd.DataFrame:
    """Check what was given, make the tasks, and run them in turn."""
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
    for name in names:
        if name not in NORMS:
            raise InputError(nearest(str(name), list(NORMS), "norm"))
    truths = _truths(problem, end, taking_part, reference)
    tasks = list(_tasks(problem, taking_part, dts, rtols, end, penalties, truths))

    found: list[dict[str, Any]] = [{} for _ in tasks]
    turns = ((number, turn) for turn in range(repeats) for number in range(len(tasks)))
    for number, turn in watch(turns, len(tasks) * repeats, "runs"):
        task, row = tasks[number], found[number]
        if turn == 0:
            row.update(_first(task, names, lcp_solver))
        elif not row["failure"]:
            run = _simulate(task, lcp_solver)
            row["seconds"] = min(row["seconds"], run.stats.seconds)
    table = pd.DataFrame(found, columns=_columns(names)).astype(dict.fromkeys(COUNTS, "Int64"))
    known = next((truth for truth in truths.values() if isinstance(truth, Reference)), None)
    table.attrs = {"problem": problem.name, "t_end": float(end)}
    if known is not None:
        truth = known.trajectory
        limit = limits_of(truth)[-1]
        table.attrs |= {"limited_by": limit.name, "declared_norm": limit.norm}
        table.attrs |= {f"scale_{name}": SCALES[name](truth) for name in names}
    return table


def _columns(norms: Sequence[str]) -> list[str]:
    costs = [name for name in COSTS if name != "steps"]
    return [
        *("method", "law", "k", "rtol", "dt", "steps", *norms, "closings", "events", *costs),
        *("declared", "reference", "violation", "failure"),
    ]


def _truths(
    problem: Problem, t_end: float, methods: Mapping[str, Integrator], given: Trajectory | Reference | None
) -> dict[str, Reference | str]:
    """Return by the name of each method what it is measured against, or why there is nothing."""
    if isinstance(given, Trajectory):
        given = Reference(given, given.method)
    if given is not None and given.trajectory.t[-1] < t_end * (1.0 - 1e-9):
        raise InputError(
            f"reference ends at {given.trajectory.t[-1]:g} s, before t_end = {t_end:g} s: take a longer one"
        )
    if given is not None:
        return {integrator.name: given for integrator in methods.values()}
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
) -> Iterable[Task]:
    variants: list[tuple[str, float, Problem | str]] = [("rigid", math.inf, problem)]
    for law, k, *more in penalties:
        try:
            variants.append((law, k, penalized(problem, law, k=k, **dict(*more))))
        except LcpImpactError as error:
            variants.append((law, k, str(error)))
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
                    yield Task(label, each, law, k, variant, t_end, steps, truth)


def _simulate(task: Task, lcp_solver: str) -> Trajectory:
    assert isinstance(task.variant, Problem)
    solver = lcp_solver if task.integrator.solves_lcp else "auto"
    h = task.t_end / task.steps
    # A run that grows beyond all bounds fails; that its certificate is made of infinities is no news.
    with np.errstate(over="ignore", invalid="ignore"):
        return simulate(
            task.variant, task.integrator, dt=h, t_end=task.t_end, lcp_solver=solver, progress=False, throw=False
        )


def _first(task: Task, norms: Sequence[str], lcp_solver: str) -> dict[str, Any]:
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
    assert isinstance(task.truth, Reference)
    try:
        _compile(task, lcp_solver)
        run = _simulate(task, lcp_solver)
        if not run.ended:
            return row | {"failure": run.message}
        with np.errstate(over="ignore", invalid="ignore"):
            found = errors(run, task.truth.trajectory, norms)
    except LcpImpactError as error:
        return row | {"failure": str(error)}
    if any(math.isinf(value) for value in found.values()):
        return row | {"failure": f"{task.method} grew beyond all bounds with dt = {row['dt']:.3g} s: take a smaller dt"}
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


def _compile(task: Task, lcp_solver: str) -> None:
    """Take one step, so that whatever compiles on first use has been compiled when the clock starts."""
    _simulate(replace(task, t_end=task.t_end / task.steps, steps=1), lcp_solver)
