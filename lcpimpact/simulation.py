"""The driver: time grid, record, progress, and failures of a method."""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, fields, replace
from functools import partial
from typing import Any

import numpy as np

from lcpimpact.arguments import check_kind
from lcpimpact.arrays import Array
from lcpimpact.certificate import certify
from lcpimpact.certificate.impact_choices import count_solutions, sentence
from lcpimpact.certificate.jams import find_jams
from lcpimpact.errors import FailureError, InputError, LcpImpactError, Status, UnsupportedError
from lcpimpact.events import TOUCH_RTOL, events_of_springs, events_of_steps
from lcpimpact.hybrid.state_jump import enter_constraint, into_balance, jump_events
from lcpimpact.integrators import METHODS
from lcpimpact.integrators.base import Declared, Integrator, Option
from lcpimpact.integrators.moreau_jean import MoreauJean
from lcpimpact.lcp import SOLVERS
from lcpimpact.logs import LOG, progress_bar
from lcpimpact.memory import check_memory
from lcpimpact.numbers import positive
from lcpimpact.problems.base import Problem
from lcpimpact.record import Event, Grid, Record, State
from lcpimpact.registry import nearest
from lcpimpact.scheme.dynamics import Dynamics
from lcpimpact.scheme.force_law import forces
from lcpimpact.scheme.impact_laws import name_of_law
from lcpimpact.scheme.signals import Described, TimeFunction, check_harmonics
from lcpimpact.scheme.sparse_dynamics import TAKE_SCHEME
from lcpimpact.scheme.structure import Feature
from lcpimpact.trajectory import Trajectory

BLOCK_SECONDS = 0.1
"""Target duration of a block of steps in s: short for progress and Ctrl-C, long enough to cost nothing."""

FIRST_BLOCK_NUMBERS = 1 << 16
"""Number of steps in the first block times the numbers in the matrices of a step, of a large system."""

FEWER_STEPS = "take a larger dt or a shorter t_end"

MASSES_APART, MASSES_BEYOND = 1e8, 1e13
"""Ratios of the masses of bodies in contact, beyond which floats, and the rank of their matrices, are in doubt."""

HIDDEN_BY_ROUNDING = (Status.INFEASIBLE, Status.UNDECIDED, Status.SINGULAR, Status.INACCURATE)
"""Statuses of an LCP whose answer rounding may have hidden."""

ASKED_AGAIN = (0.0, 0.38, 1.0)
"""When functions of time are asked twice for their value, relative to the run."""

MAX_ALTERNATIVES = 4
"""Maximum number of alternative methods listed in an error."""

RUN_ARGUMENTS = ("dt", "t_end", "lcp_solver", "progress", "record", "error")
"""Arguments of every function that runs one method, in addition to the options of the method."""


def simulate(
    problem: Problem,
    method: str | Integrator = "moreau-jean",
    *,
    dt: float,
    t_end: float | None = None,
    lcp_solver: str = "auto",
    throw: bool = True,
    progress: bool = True,
    record: Sequence[str] | None = None,
    error: bool = True,
    **method_options: Option,
) -> Trajectory:
    """Integrate a problem over 0 <= t <= t_end.

    Parameters
    ----------
    problem : Problem
        From `load_problem`, or made of a `Scheme` of your own.
    method : str or Integrator
        A name of ``lcpimpact list methods``, or an object that is an integrator.
    dt : float
        Step in s; t_end must be a whole number of steps. With ``exact`` and ``event-driven`` it is the spacing of the output
        only, and with the option ``rtol`` of other methods the longest step.
    t_end : float, optional
        End in s; by default that of the problem. Events with 0 <= t <= t_end are kept; where a method locates one at t_end
        itself, the run ends with its right limit.
    lcp_solver : str
        A name of ``lcpimpact list solvers``.
    throw : bool
        Raise if the run does not reach its end, instead of returning the finished steps; so too for Ctrl-C, which with
        ``throw=False`` returns them with the status INTERRUPTED.
    progress : bool
        Show progress when the run takes more than a second (not on a terminal: ten).
    record : sequence of str, optional
        Of a `SparseScheme`, or a `Scheme` of more than 1,000 nodes: the nodes and reactions whose series are kept; all
        by default. The memory of a run does not depend on its steps but for these.
    error : bool
        Whether the run has an estimated error, which is computed when it is first asked for: `Trajectory.error`.
    **method_options
        Options of the method, as ``theta=1.0``.

    Returns
    -------
    Trajectory
        t, q, v, t_reaction, reaction, events, status, message, certificate and stats.

    Raises
    ------
    InputError
        For values that cannot be used and names that are not known.
    UnsupportedError
        If the method does not handle the problem; raised before the first step.
    FailureError
        If the run fails and ``throw`` is set; its ``result`` is the trajectory up to the failure.

    Examples
    --------
    >>> from lcpimpact import load_problem, simulate
    >>> traj = simulate(load_problem("system-1"), dt=1e-3, t_end=3.0)
    >>> f"{traj['R'].max():.0f} N"
    '5818 N'

    References
    ----------
    Acary and Brogliato, *Numerical Methods for Nonsmooth Dynamical Systems* (2008).
    """
    flags = (("throw", throw, bool), ("progress", progress, bool), ("error", error, bool))
    for name, value, kind in (("problem", problem, Problem), *flags):
        if type(value) is not kind:
            check_kind(name, value, kind)
    integrator = make_integrator(method, method_options, RUN_ARGUMENTS)
    grid = time_grid(dt, problem.t_end if t_end is None else t_end)
    check_lcp_solver(integrator, lcp_solver)
    if problem.sparse:
        run = _run_sparse(problem, integrator, grid, lcp_solver, record, progress)
        return _finish(run if error else replace(run, estimates=False), throw)
    if record is not None:
        raise InputError(f"record = {record!r} is for a SparseScheme: leave it out, and all nodes are recorded")
    check_handled(integrator, problem)
    _check_forces(problem, grid.t_end)

    with np.errstate(all="ignore"):  # a number that is not finite is a status of the run
        begun = Begun.of(problem, integrator, grid, lcp_solver)
        run = begun.end(*_run(begun.advance, integrator.name, grid, begun.size, progress))
    return _finish(run if error else replace(run, estimates=False), throw)


def run_within(problem: Problem, integrator: Integrator, grid: Grid, seconds: float) -> Trajectory:
    """Run a problem that the method takes in at most so many seconds, else return the part reached as INTERRUPTED."""
    check_handled(integrator, problem)
    _check_forces(problem, grid.t_end)
    with np.errstate(all="ignore"):
        begun = Begun.of(problem, integrator, grid, "auto")
        return replace(begun.end(*_run_timed(begun.advance, grid, seconds)), estimates=False)


def _finish(trajectory: Trajectory, throw: bool) -> Trajectory:
    """Return a run, or raise an error if it failed and ``throw`` is set."""
    if LOG.isEnabledFor(logging.INFO):
        stats = trajectory.stats
        LOG.info(
            "%s by %s: %d steps in %.3g s, %s",
            trajectory.problem.name, trajectory.method, stats.steps, stats.seconds, trajectory.status.name,
        )  # fmt: skip
    if throw and not trajectory.success:
        if trajectory.status is Status.INTERRUPTED:
            raise KeyboardInterrupt
        raise FailureError(trajectory.message, trajectory)
    return trajectory


@dataclass(frozen=True, eq=False)
class Begun:
    """A run with full matrices whose method has begun.

    Attributes
    ----------
    problem, inside : Problem       as given; and with the start that the constraints allow
    integrator, grid, lcp_solver    how it is run
    record : Record                 the arrays that the run fills
    carry : object                  what the method carries from block to block
    jump : (nc,) array              the impulses that lead to that start
    moved : sequence of str         the nodes that it moves
    started : float                 the clock when it began
    """

    problem: Problem
    inside: Problem
    integrator: Integrator
    grid: Grid
    lcp_solver: str
    record: Record
    carry: Any
    jump: Array
    moved: Sequence[str]
    started: float

    @classmethod
    def of(cls, problem: Problem, integrator: Integrator, grid: Grid, lcp_solver: str) -> Begun:
        """Begin a run."""
        started = time.perf_counter()
        inside, jump = enter_constraint(problem)
        inside, moved = into_balance(inside)
        record = _empty_record(integrator, problem.dynamics, grid)
        try:
            carry = _start(integrator, inside, grid, lcp_solver, record)
        except UnsupportedError as refusal:
            if not refusal.methods:
                raise
            # Those that it proposes may refuse the problem for a reason of their own.
            able = methods_that_take(problem, refusal.methods) or methods_that_take(problem)
            raise UnsupportedError(refusal.reason, able) from None
        return cls(problem, inside, integrator, grid, lcp_solver, record, carry, jump, moved, started)

    @property
    def size(self) -> int:
        """Count of numbers in the matrices of a step."""
        return int(self.record.q.shape[1] + self.record.reaction.shape[1]) ** 2

    @property
    def advance(self) -> Callable[[int, int], tuple[Status, int]]:
        """The function that takes the steps from one to another."""
        return partial(self.integrator.advance, self.carry, self.record)

    def end(self, status: Status, reached: int) -> Trajectory:
        """Judge the run, which has reached a step, and return it."""
        record, integrator = self.record, self.integrator
        _cut(record, self.grid, reached)
        integrator.finish(self.carry, record)

        dense = integrator.dense(self.carry) if len(record.t) > 1 else None
        d = self.problem.dynamics.with_held_forces(float(record.t[-1]), record.reader(dense))
        several = ""
        if record.events is not None:
            events = tuple(record.events)
            impulsive = np.zeros(record.reaction.shape, dtype=bool)
        else:
            events, impulsive = events_of_steps(d, record, integrator.impact_steps)
            events, several = find_jams(d, record, events, impulsive)
        record.reaction[impulsive] = 0.0
        start = (self.inside.initial_coordinates, self.inside.initial_velocities)
        certificate = certify(d, start, record, dense, events, integrator)
        events = count_solutions(d, record, events)
        several = sentence(d, events) + several
        events = tuple(sorted((*events, *events_of_springs(d, record, dense)), key=lambda event: event.t))
        if self.jump.any():
            events = (
                *jump_events(self.problem, self.jump, State(record.q[0], record.v[0], record.reaction[0])),
                *events,
            )
        if status is not Status.SOLVED:
            status, why = _why_it_stopped(d, status, record, self.grid, events, self.lcp_solver)
            ratio = _ratio_of_masses(d.at(float(record.t[-1]), record.q[-1], record.v[-1]))
            if status in HIDDEN_BY_ROUNDING and ratio >= MASSES_APART:
                status = Status.INACCURATE
                why = _too_few_digits(d, integrator.name, ratio)
            message = f"{integrator.name} stopped after step {reached} (t = {record.t[-1]:g} s): {why}"
            if status is Status.NEWTON:
                message += _smaller_dt(self.inside, integrator, self.grid, self.lcp_solver, reached + 1)
        elif certificate.holds:
            message = " ".join([status.sentence, self.problem.note]).rstrip()
        else:
            status = Status.VIOLATED
            remedy = _violation_remedy(integrator, d)
            message = f"{integrator.name}: {'; '.join(certificate.sentences(self.problem.own_unit))}. {remedy}"
        message += several
        if self.moved:
            nodes = ", ".join(map(repr, self.moved))
            message += f" Quasi-static nodes (held by springs only) begin in balance, and not where q0 says: {nodes}."
        message += _narrow_gaps(self.inside, integrator)
        record.stats.steps = record.stats.steps or len(record.t) - 1
        record.stats.seconds = time.perf_counter() - self.started
        return Trajectory(
            problem=self.problem, method=describe(integrator, self.lcp_solver), t=record.t, q=record.q, v=record.v,
            t_reaction=record.t_reaction, reaction=record.reaction, events=events, status=status, message=message,
            certificate=certificate, stats=record.stats, dense=dense, integrator=integrator, lcp_solver=self.lcp_solver,
        )  # fmt: skip


def _start(integrator: Integrator, problem: Problem, grid: Grid, lcp_solver: str, record: Record) -> Any:
    """Return the carry of a method, or refuse a problem whose matrices are singular or not finite."""
    try:
        return integrator.start(problem, grid, lcp_solver, record)
    except LcpImpactError:
        raise
    except (np.linalg.LinAlgError, ArithmeticError, ValueError) as error:
        raise InputError(
            f"{integrator.name} cannot begin {problem.name!r}: a matrix is singular to rounding, or a number too large "
            f"({error}): bring the constants closer in size, or take other units"
        ) from error


def _run_sparse(
    problem: Problem, integrator: Integrator, grid: Grid, lcp_solver: str, record: Sequence[str] | None, progress: bool
) -> Trajectory:
    """Run a problem with sparse matrices, whose laws are judged in its steps."""
    if not isinstance(integrator, MoreauJean) or integrator.rtol is not None or lcp_solver != "auto":
        raise UnsupportedError(
            f"{problem.name!r} is in sparse matrices, and runs by method='moreau-jean' without rtol, which chooses its LCP "
            f"solver by itself, and not by {describe(integrator, lcp_solver)}: use these settings, or {TAKE_SCHEME}"
        )
    from lcpimpact.sparse_run import SparseRun  # here, since other runs need none of its compiled code

    started = time.perf_counter()
    run = SparseRun(problem, integrator, grid, record)
    with np.errstate(all="ignore"):
        status, reached = _run(run.advance, integrator.name, grid, run.size, progress)
    run.stats.seconds = time.perf_counter() - started
    return run.trajectory(status, reached, describe(integrator, lcp_solver))


def _empty_record(integrator: Integrator, dynamics: Dynamics, grid: Grid, *, memory_factor: float = 2.0) -> Record:
    """Allocate the arrays of a run, after a check that they fit in memory.

    ``memory_factor``: memory of a run in units of the memory of its record; the rest is for the sampling and the
    certificate.
    """
    n, nc = len(dynamics.nodes), len(dynamics.contacts)
    size = 8.0 * (grid.steps + 1) * (1 + 2 * n + 1 + nc)  # t, q, v, and t and r of the reactions
    check_memory(memory_factor * size, f"{grid.steps:,} steps do", FEWER_STEPS)
    try:
        t = grid.times(0, grid.steps)
        q = np.empty((grid.steps + 1, n))
        v = np.empty((grid.steps + 1, n))
        t_reaction = integrator.reaction_times(grid)
        return Record(t, q, v, t_reaction, np.empty((len(t_reaction), nc)))
    except MemoryError:
        raise InputError(f"{grid.steps:,} steps do not fit in memory: {FEWER_STEPS}") from None


def _cut(record: Record, grid: Grid, reached: int) -> None:
    """Cut the record of a run that ended early to the steps that it reached."""
    if reached < grid.steps:
        nr = reached if len(record.t_reaction) == grid.steps else reached + 1
        record.t = record.t[: reached + 1]
        record.q = record.q[: reached + 1]
        record.v = record.v[: reached + 1]
        record.t_reaction = record.t_reaction[:nr]
        record.reaction = record.reaction[:nr]


def _run(
    advance: Callable[[int, int], tuple[Status, int]],
    name: str,
    grid: Grid,
    size: int,
    progress: bool,
    *,
    first_block: int = 1024,
) -> tuple[Status, int]:
    """Advance block by block until the end, a failure, or Ctrl-C; ``size`` is the numbers in the matrices of a step.

    ``first_block``: number of steps in the first block of a small system.
    """
    reached, bar = 0, None
    block = min(first_block, max(1, FIRST_BLOCK_NUMBERS // size))
    with ExitStack() as shown:
        try:
            while reached < grid.steps:
                began = time.perf_counter()
                status, now = advance(reached, min(reached + block, grid.steps))
                if bar is not None:
                    bar.update(now - reached)
                reached = now
                if status is not Status.SOLVED:
                    return status, reached
                if time.perf_counter() - began < BLOCK_SECONDS:
                    block *= 4
                elif bar is None:  # a bar takes longer to make than many runs
                    bar = progress_bar(progress, total=grid.steps, initial=reached, desc=name, unit="step", leave=False)
                    shown.enter_context(bar)
        except KeyboardInterrupt:
            return Status.INTERRUPTED, reached
    return Status.SOLVED, reached


def _run_timed(
    advance: Callable[[int, int], tuple[Status, int]], grid: Grid, seconds: float, *, timed_blocks: int = 64
) -> tuple[Status, int]:
    """Advance block by block until the end, a failure, or the time is over.

    ``timed_blocks``: number of blocks of a run whose time is limited.
    """
    reached, until = 0, time.perf_counter() + seconds
    block = -(-grid.steps // timed_blocks)
    while reached < grid.steps:
        if time.perf_counter() > until:
            return Status.INTERRUPTED, reached
        last = min(reached + block, grid.steps)
        status, reached = advance(reached, last)
        if status is not Status.SOLVED:
            return status, reached
    return Status.SOLVED, reached


def _why_it_stopped(
    d: Dynamics, status: Status, record: Record, grid: Grid, events: tuple[Event, ...], lcp_solver: str
) -> tuple[Status, str]:
    """Return the status of a run that stopped, and its reason: a non-finite value, or accumulating contacts."""
    if given := _not_finite(d, record, grid):
        return Status.NON_FINITE, f"{Status.NON_FINITE.sentence} {given}"
    if status is Status.ACCUMULATION:
        return status, f"{status.sentence} The impacts are those of {_last_to_meet(d, events)}."
    return status, status.sentence_of(lcp_solver)


def _narrow_gaps(problem: Problem, integrator: Integrator) -> str:
    """Return in words which contacts begin open by less than a method tells from a closed one, and by more than rounding."""
    if not integrator.narrowest:
        return ""
    d, q = problem.dynamics, problem.initial_coordinates
    here = d.at(0.0, q, problem.initial_velocities)
    gap, terms = d.gap(0.0, q), np.abs(here.H) @ np.abs(q) + np.abs(here.u0)
    narrow = d.impenetrable & (gap > TOUCH_RTOL * terms) & (gap < integrator.narrowest * terms)
    if not narrow.any():
        return ""
    given = ", ".join(f"{d.contacts[i].name!r} {gap[i]:.2g} m" for i in np.flatnonzero(narrow))
    remedy = ", take method='exact'" if "exact" in methods_that_handle(d) else ", take wider gaps"
    return (
        f" The gaps at the start are too narrow for {integrator.name}, which takes the contacts for closed ({given}): if "
        f"bodies are to meet one after the other{remedy}."
    )


def _ratio_of_masses(d: Dynamics) -> float:
    """Return the largest ratio of the masses of bodies with contacts, each as its contacts feel it."""
    reach = np.abs(d.H).max(axis=0, initial=0.0)
    mass = np.diag(d.M)
    felt = (reach > 0.0) & (mass > 0.0)
    masses = mass[felt] / reach[felt] ** 2
    return float(masses.max() / masses.min()) if len(masses) else 1.0


def _too_few_digits(d: Dynamics, method: str, ratio: float) -> str:
    """Return why a run stopped whose bodies in contact have masses of such a ratio."""
    finer = ratio < MASSES_BEYOND and method != "exact" and "exact" in methods_that_handle(d)
    remedy = "take method='exact', which computes in 32 digits" if finer else "take masses that are nearer"
    return (
        f"The masses of bodies with contacts differ by a factor of {ratio:.0e}, and a force between them that has the 16 "
        f"digits of a float is too coarse for the lighter one: {remedy}."
    )


def _violation_remedy(integrator: Integrator, dynamics: Dynamics) -> str:
    """Return the advice for a run with a failed certificate, with methods of other families that handle the system."""
    others = [name for name in methods_that_handle(dynamics) if METHODS[name].family != integrator.family]
    named = f" such as {' or '.join(map(repr, others[:MAX_ALTERNATIVES]))}" if others else ""
    return f"{Status.VIOLATED.sentence.rstrip('.')}{named}."


def _smaller_dt(
    problem: Problem, integrator: Integrator, grid: Grid, lcp_solver: str, steps: int, *, most_tried: int = 1000
) -> str:
    """Return the advice to take a smaller dt, where eighths of the ``steps`` pass the one that failed; else "".

    ``most_tried``: largest number of steps of a run that are tried again with an eighth of their length.
    """
    if steps > most_tried:
        return ""
    fine = Grid(grid.t_end * steps / grid.steps, 8 * steps)
    record = _empty_record(integrator, problem.dynamics, fine)
    status, _ = integrator.advance(integrator.start(problem, fine, lcp_solver, record), record, 0, fine.steps)
    return f" Steps of dt = {fine.h:g} s pass there: take a smaller dt." if status is Status.SOLVED else ""


def _last_to_meet(d: Dynamics, events: tuple[Event, ...], *, together_rtol: float = 1e-9) -> str:
    """Return the contacts, and their nodes, with impacts within `together_rtol` of the last one.

    ``together_rtol``: time between impacts, relative to the time passed, below which they accumulate together.
    """
    impacts = [event for event in events if event.kind == "impact"]
    last = {event.contact for event in impacts if event.t >= impacts[-1].t * (1.0 - together_rtol)}
    return ", ".join(f"{c.name} ({c.upper} and {c.lower})" for c in d.contacts if c.name in last)


def _functions_of_time(d: Dynamics) -> list[tuple[str, TimeFunction]]:
    """Return the loads, and the places and velocities of prescribed motions, each with its name in words."""
    found = [(f"The load on {d.nodes[i]!r}", load) for i, load in d.loads if callable(load)]
    found += [(f"The motion of {d.nodes[i]!r}", signal) for i, signal in d.motions.items()]
    return found + [(f"The velocity given to {d.nodes[i]!r}", signal.rate) for i, signal in d.motions.items()]


def _not_finite(d: Dynamics, record: Record, grid: Grid) -> str:
    """Return the load, force or prescribed motion that is not finite in the steps after a failed run, or ""."""
    q, v = record.q[-1, d.acted_on], record.v[-1, d.acted_on]
    forced = [f"The force of {law.element}" for law in d.force_laws for _ in law.nodes]
    for t in map(float, record.t[-1] + grid.h * np.linspace(0.0, 2.0, 33)):
        if t > grid.t_end:
            break
        given = [(what, function(t)) for what, function in _functions_of_time(d)]
        given += zip(forced, forces(d.force_laws, t, q, v).tolist(), strict=True)
        for what, value in given:
            if not math.isfinite(value):
                return f"{what} is {value:g} at t = {t:.6g} s."
    return ""


def make_integrator(
    method: str | Integrator, method_options: Mapping[str, Any], arguments: Sequence[str] = ()
) -> Integrator:
    """Return the method of a name with its options, or a given integrator object.

    Parameters
    ----------
    method : str or Integrator
    method_options : mapping of str to value
        Only for a name.
    arguments : sequence of str
        Arguments of the caller beside the options, which an unknown option may be meant for.

    Raises
    ------
    InputError
        For an unknown name, and for options that the method does not have.
    """
    if isinstance(method, Integrator):
        if method_options:
            raise InputError(
                f"{', '.join(method_options)}: options belong in the integrator object that was passed as method"
            )
        return method
    if not isinstance(method, str):
        raise InputError(f"method = {method!r} must be a name or an Integrator object")
    kind = METHODS[method]
    known = [each.name for each in fields(kind)]  # type: ignore[arg-type]
    for key in method_options:
        if key not in known:
            raise InputError(nearest(key, known, f"option of {method}", arguments))
    return kind(**method_options)


def time_grid(dt: float, t_end: float, *, steps_of_a_run: int = 100) -> Grid:
    """Return the instants of a run, after a check that t_end is a whole number of steps.

    ``steps_of_a_run``: number of steps that is advised where dt is longer than the run.
    """
    positive("dt", dt, "s")
    positive("t_end", t_end, "s")
    if t_end / dt > 1e9:
        raise InputError(f"dt = {dt:g} s cuts t_end = {t_end:g} s into more than 1e9 steps: take a larger dt")
    steps = max(1, round(t_end / dt))
    if abs(steps * dt - t_end) > 1e-9 * t_end:
        if dt > t_end:
            raise InputError(
                f"t_end = {t_end:g} s is not a whole number of steps dt = {dt:g} s, which is longer than the run: take "
                f"dt = {t_end / steps_of_a_run:.12g} (t_end/{steps_of_a_run}) or smaller"
            )
        fitting = math.ceil(t_end / dt)
        raise InputError(
            f"t_end = {t_end:g} s is not a whole number of steps dt = {dt:g} s: take dt = {t_end / fitting:.12g} "
            f"(t_end/{fitting})"
        )
    return Grid(float(t_end), steps)


def check_lcp_solver(integrator: Integrator, lcp_solver: str) -> None:
    """Refuse an unknown LCP solver, and one for a method that solves no LCP."""
    SOLVERS[lcp_solver]
    if not integrator.solves_lcp and lcp_solver != "auto":
        raise InputError(f"{integrator.name} solves no LCP, so lcp_solver = {lcp_solver!r} means nothing: leave it out")


def check_handled(integrator: Integrator, problem: Problem) -> None:
    """Refuse undeclared features before the first step, naming them and the methods that handle them."""
    dynamics = problem.dynamics
    missing = _missing(integrator.declared, dynamics)
    if missing:
        able = methods_that_take(problem)
        reason = f"{integrator.name} does not handle {missing} of {problem.name!r}: "
        raise UnsupportedError(reason if able else f"{reason}no method that is registered does", able)


def _check_forces(problem: Problem, t_end: float) -> None:
    """Refuse forces that fail at the start, or whose Jacobian there is not theirs, and signals too fast to follow.

    So is what returns another value at the same time, as random numbers do, which no step says anything of.
    """
    d = problem.dynamics
    signals: list[TimeFunction] = [*(load for _, load in d.loads if callable(load)), *d.motions.values()]
    check_harmonics(signals, t_end)
    if not all(isinstance(each, Described) for each in signals):
        for what, function in _functions_of_time(d):
            for t in (t_end * part for part in ASKED_AGAIN):
                first, second = function(t), function(t)
                if first != second and not (math.isnan(first) and math.isnan(second)):
                    raise InputError(
                        f"{what} is {first:g} at t = {t:.6g} s, and {second:g} when it is asked again: a function of time "
                        "has one value at a time; draw random numbers once, as the points of a Table"
                    )
    for held in d.holds:
        held.check(problem.initial_coordinates[list(held.at)], problem.initial_velocities[list(held.at)])
    for law in d.force_laws:
        here = [d.nodes.index(node) for node in law.nodes]
        law.check(0.0, problem.initial_coordinates[here], problem.initial_velocities[here])


def methods_that_handle(dynamics: Dynamics) -> list[str]:
    """Return the methods that handle a system, by their declarations, the most general first."""
    able = [name for name, kind in METHODS.items() if not _missing(kind.declared, dynamics)]
    return sorted(able, key=lambda name: -len(METHODS[name].declared.handles))


def methods_that_take(problem: Problem, names: Sequence[str] = (), *, asked_steps: int = 64) -> list[str]:
    """Return the first methods, of these or of all, that take a problem by what they declare and by their own checks.

    ``asked_steps``: number of steps of the run that a method is asked whether it would take.
    """
    grid, found = Grid(problem.t_end, asked_steps), []
    known = problem.dynamics.memo.setdefault(methods_that_take, {})
    start = tuple(sorted(problem.q0.items())), tuple(sorted(problem.v0.items())), problem.t_end
    able = methods_that_handle(problem.dynamics)
    for name in able if not names else [each for each in names if each in able]:
        if (start, name) not in known:
            integrator = METHODS[name]()
            try:
                inside, _ = into_balance(enter_constraint(problem)[0])
                with np.errstate(all="ignore"):  # as in a run
                    _start(integrator, inside, grid, "auto", _empty_record(integrator, problem.dynamics, grid))
            except LcpImpactError:
                known[start, name] = False
            else:
                known[start, name] = True
        found += [name] * known[start, name]
        if len(found) == MAX_ALTERNATIVES:
            break
    return found


def _missing(declared: Declared, dynamics: Dynamics) -> str:
    """Return the first undeclared feature of a system and the element that causes it, or ""."""
    for contact in dynamics.contacts:
        if contact.relative_degree not in declared.relative_degrees and not contact.switches:
            return f"relative degree {contact.relative_degree} (contact {contact.name!r})"
    handles = declared.handles + (declared.moving if Feature.LAGRANGIAN in dynamics.features else ())
    for feature, what in dynamics.features.items():
        if feature not in handles:
            return f"{feature.value} ({what})"
    law = name_of_law(dynamics.impact_law)
    if dynamics.has_other_impact_law and law not in declared.impact_laws:
        return f"a law of impact other than Newton's (impact_law={law!r})"
    return ""


def describe(integrator: Integrator, lcp_solver: str) -> str:
    """Return the method with its options as a call."""
    values = [(each.name, getattr(integrator, each.name)) for each in fields(integrator)]  # type: ignore[arg-type]
    options = [f"{name}={value}" for name, value in values if value is not None]
    if integrator.solves_lcp:
        options.append(f"lcp_solver={lcp_solver}")
    return f"{integrator.name}({', '.join(options)})"
