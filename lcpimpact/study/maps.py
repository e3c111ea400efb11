"""Sections through motions, and what they show of a family: Poincaré maps, bifurcation diagrams, basins of attraction."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from lcpimpact.arguments import check_fields, checked
from lcpimpact.arrays import Array
from lcpimpact.errors import FailureError, InputError, LcpImpactError, Status
from lcpimpact.hybrid.modes import ZERO, System
from lcpimpact.hybrid.motion import Motion, begin_problem, follow, read
from lcpimpact.integrators.base import Integrator
from lcpimpact.integrators.exact import Exact
from lcpimpact.numbers import is_count, is_real
from lcpimpact.problems.base import Problem
from lcpimpact.record import Event
from lcpimpact.registry import nearest
from lcpimpact.simulation import make_integrator, simulate
from lcpimpact.study.orbits import force_period, refuse_power_laws
from lcpimpact.study.watch import Watch, unwatched

BLOCK = 8
"""Periods that are run at once, before it is asked whether more are needed."""

MOST = 16
"""Longest period, in points of the section, that is looked for."""

SAME = 1e-2
"""Two attractors are one if their points lie nearer than this, relative to how far the attractors reach."""

STEPS = 200
"""Steps in a period of the force, or in a hundredth of the problem's end, of a method that steps, unless dt is given."""


@dataclass(frozen=True)
class Stroboscope:
    """A section at a fixed phase of the force.

    Parameters
    ----------
    phase : float
        As a share of the period, from 0 to 1.
    period : float, optional
        In s; by default that of the force.
    """

    phase: float = 0.0
    period: float | None = None

    def __post_init__(self) -> None:
        check_fields(self)
        if not (is_real(self.phase) and 0.0 <= self.phase < 1.0):
            raise InputError(f"phase = {self.phase!r} must be a share of the period, from 0 to below 1")
        if self.period is not None and not (is_real(self.period) and self.period > 0.0):
            raise InputError(f"period = {self.period!r} must be a positive number in s")


@dataclass(frozen=True)
class Impacts:
    """A section at the impacts.

    Parameters
    ----------
    contact : str, optional
        Name of one contact; by default every one counts.
    side : {"left", "right"}
        Whether the state right before or right after is meant.
    """

    contact: str | None = None
    side: str = "left"

    def __post_init__(self) -> None:
        if self.side not in ("left", "right"):
            raise InputError(f"side = {self.side!r} must be 'left' or 'right'")


@dataclass(frozen=True)
class Crossing:
    """A section where a coordinate, a velocity or a gap passes a level; a jump over it does not count.

    Parameters
    ----------
    series : str
        A coordinate, a velocity as v_NAME, or a contact, whose gap is meant.
    level : float
        In m or m/s.
    direction : {1, -1, 0}
        Upwards, downwards, or both.
    """

    series: str
    level: float = 0.0
    direction: int = 0

    def __post_init__(self) -> None:
        check_fields(self)
        if not is_real(self.level) or self.direction not in (-1, 0, 1):
            raise InputError(f"{self}: the level must be a number, and the direction 1, -1 or 0")


Section = Stroboscope | Impacts | Crossing


@checked
def section_of(text: str | Section) -> Section:
    """Return the section that a text tells, as on the command line.

    Parameters
    ----------
    text : str or Section
        ``force`` or ``force:0.25`` (at a phase), ``impact`` or ``impact:R`` (of one contact), ``x=0.1`` (a crossing),
        ``x>0.1`` (upwards) or ``x<0.1`` (downwards).

    Raises
    ------
    InputError
        For any other text.

    Examples
    --------
    >>> section_of("force:0.25")
    Stroboscope(phase=0.25, period=None)
    >>> section_of("v_x>0")
    Crossing(series='v_x', level=0.0, direction=1)
    """
    if isinstance(text, (Stroboscope, Impacts, Crossing)):
        return text
    word, _, more = str(text).partition(":")
    if word == "force" and (phase := _number(more or "0")) is not None:
        return Stroboscope(phase)
    if word == "impact":
        return Impacts(more or None)
    found = re.fullmatch(r"(.+?)\s*([=<>])\s*(\S+)", str(text))
    if found and (level := _number(found[3])) is not None:
        return Crossing(found[1], level, {"=": 0, ">": 1, "<": -1}[found[2]])
    raise InputError(
        f"section {text!r} must read force, force:PHASE, impact, impact:CONTACT, x=LEVEL, x>LEVEL or x<LEVEL"
    )


def _number(text: str) -> float | None:
    try:
        return float(text)
    except ValueError:
        return None


class Points(NamedTuple):
    """Where a motion meets a section: t (k,), q and v (k, n), and the speed of the impact at or before each point (k,).

    ``last`` is q and v (2, n) at the last whole period of the force, or the last point: where another run can go on.
    """

    t: Array
    q: Array
    v: Array
    speed: Array
    last: Array

    def after(self, count: int) -> Points:
        """Return the points after the first ones."""
        return Points(self.t[count:], self.q[count:], self.v[count:], self.speed[count:], self.last)


@checked
def poincare(
    problem: Problem,
    section: str | Section = "force",
    *,
    transient: int = 0,
    crossings: int = 200,
    t_end: float | None = None,
    method: str | Integrator = "exact",
    dt: float | None = None,
    **method_options: Any,
) -> pd.DataFrame:
    """Return the points at which a motion meets a section.

    With ``exact`` they are found to rounding, and none is missed; a method that steps is read on its own grid, between whose
    points coordinates are lines.

    Parameters
    ----------
    problem : Problem
    section : str or Section
        `Stroboscope`, `Impacts`, `Crossing`, or a text as of `section_of`.
    transient, crossings : int
        So many points are left out first, and so many kept.
    t_end : float, optional
        Latest time in s; by default four periods of the force a point, or without force the problem's t_end a point. The
        table is shorter where this is not enough.
    method : str or Integrator
        ``exact``, or any method that steps.
    dt : float, optional
        Step in s of such a method; by default 200 a period.
    **method_options
        Options of the method.

    Returns
    -------
    DataFrame
        One row a point: ``point`` (from 0), ``t`` (s), ``phase`` (share of the period of the force, NaN without), the
        coordinates (m), the velocities (m/s, ``v_NAME``), ``speed`` (m/s, of the impact at the point, or the last before).

    Raises
    ------
    LcpImpactError
        If the section does not fit the problem, or the run fails.

    Examples
    --------
    >>> from lcpimpact import load_problem, poincare
    >>> table = poincare(load_problem("shaw-holmes"), "impact", transient=60, crossings=2)
    >>> table["speed"].round(7).tolist()
    [0.5006725, 0.5006725]
    """
    where = section_of(section)
    points, force = _points(problem, where, transient, crossings, t_end, method, dt, method_options)
    table = _frame(problem, points, force)
    table.attrs = _told(problem.name, where, method, transient)
    return table


def _told(problem: str, where: Section, method: str | Integrator, transient: int) -> dict[str, Any]:
    name = method if isinstance(method, str) else method.name
    return {"problem": problem, "section": str(where), "method": name, "transient": transient}


def _points(
    problem: Problem,
    where: Section,
    transient: int,
    crossings: int,
    t_end: float | None,
    method: str | Integrator,
    dt: float | None,
    options: dict[str, Any],
) -> tuple[Points, float | None]:
    """Return the points that are kept, and the period of the force."""
    force = _checked(problem, where)
    _whole(transient=(transient, 0), crossings=(crossings, 1))
    need = transient + crossings
    end = t_end if t_end is not None else _latest(problem, where, force, need)
    if not (is_real(end) and end > 0.0):
        raise InputError(f"t_end = {t_end!r} must be a positive number in s")
    integrator = make_integrator(method, options)
    if isinstance(integrator, Exact):
        found = _by_exact(problem, where, force, need, end, integrator.max_events)
    else:
        found = _by_steps(problem, where, force, need, end, integrator, dt)
    return found.after(transient), force


def _whole_period(times: Array, force: float | None) -> float:
    """Return the last whole period of the force at or before the last time, or without force that time; 0 without times."""
    end = float(times[-1]) if len(times) else 0.0
    return end if force is None else math.floor(end / force * (1.0 + 1e-12)) * force


def _whole(**values: tuple[int, int]) -> None:
    for name, (value, least) in values.items():
        if not (is_count(value) or (value == 0 and least == 0 and not isinstance(value, bool))):
            raise InputError(f"{name} = {value!r} must be a whole number, at least {least}")


def _checked(problem: Problem, where: Section) -> float | None:
    """Return the period of the force, after a look at whether the section fits the problem."""
    d = problem.dynamics
    names = [contact.name for contact in d.contacts]
    if isinstance(where, Stroboscope):
        force = where.period or force_period(d)
        if force is None:
            raise InputError(
                f"{problem.name} has no force with a period: give Stroboscope(period=...) or another section"
            )
        return force
    if isinstance(where, Impacts):
        if where.contact is not None and where.contact not in names:
            raise InputError(nearest(where.contact, names, "contact"))
        if not any(contact.relative_degree == 2 and contact.r0 is None for contact in d.contacts):
            raise InputError(f"{problem.name} has no impacts, whose plates would both have mass: take another section")
    else:
        known = [*d.nodes, *(f"v_{node}" for node in d.nodes), *names]
        if where.series not in known:
            raise InputError(nearest(where.series, known, "series"))
    try:
        return force_period(d)
    except LcpImpactError:
        return None


def _latest(problem: Problem, where: Section, force: float | None, need: int) -> float:
    """Return a time by which so many points should have been met."""
    if isinstance(where, Stroboscope):
        return need * float(force or 0.0) + where.phase * float(force or 0.0)
    return need * (problem.t_end if force is None else 4.0 * force)


def _instants(where: Stroboscope, force: float, need: int, end: float) -> Array:
    """Return the times of a stroboscope; the start of the motion is none of them."""
    t = (np.arange(need) + (where.phase or 1.0)) * force
    return np.asarray(t[t <= end * (1.0 + 1e-12)])


def _by_exact(problem: Problem, where: Section, force: float | None, need: int, end: float, max_events: int) -> Points:
    """Follow the exact motion until it has met the section often enough, or to the end."""
    refuse_power_laws(problem)
    motion = begin_problem(problem, "exact", end, max_events=max_events)
    block = BLOCK * (force or problem.t_end)
    reached = 0.0
    if isinstance(where, Stroboscope):
        times = np.minimum(_instants(where, float(force or 0.0), need, end), end)
        _go_on(motion, problem, end)
        return _read_at(motion, times, "right", force)
    times = np.zeros(0)
    while reached < end and len(times) < need:
        reached = min(reached + block, end)
        _go_on(motion, problem, reached)
        if isinstance(where, Impacts):
            hits = _impacts(motion.events, where.contact)
            times = np.array([event.t for event in hits])
        else:
            times = _crossings(motion, where, reached)
        block *= 2.0
    return _read_at(motion, times[:need], where.side if isinstance(where, Impacts) else "right", force)


def _go_on(motion: Motion, problem: Problem, until: float) -> None:
    status = follow(motion, until)
    if status is not Status.SOLVED:
        raise FailureError(
            f"{problem.name}: the exact run ended at t = {motion.next_event[0].hi:g} s: {status.sentence}", None
        )


def _impacts(events: Iterable[Event], contact: str | None) -> list[Event]:
    return [event for event in events if event.kind == "impact" and contact in (None, event.contact)]


def _read_at(motion: Motion, times: Array, side: str, force: float | None) -> Points:
    segments = tuple(motion.segments)
    q, v, _ = read(motion.system, segments, times, side)
    q_last, v_last, _ = read(motion.system, segments, np.array([_whole_period(times, force)]), "right")
    speed = _speeds(motion.system.dynamics, motion.events, times)
    return Points(times, q, v, speed, np.concatenate([q_last, v_last]))


def _speeds(dynamics: Any, events: Sequence[Event], times: Array) -> Array:
    """Return -U⁻ of the last impact at or before each time, NaN where there is none."""
    names = [contact.name for contact in dynamics.contacts]
    hits = _impacts(events, None)
    at = np.array([event.t for event in hits])
    speed = np.array([np.nan, *(-dynamics.gap_rate(event.left.v)[names.index(event.contact)] for event in hits)])
    return np.asarray(speed[np.searchsorted(at, times, side="right")])


def _crossings(motion: Motion, where: Crossing, until: float) -> Array:
    """Return the times at which a series passes its level: every one, by the convex hulls of its windows."""
    system, found = motion.system, []
    was = 0.0
    for k, segment in enumerate(motion.segments):
        last = motion.segments[k + 1].t0 if k + 1 < len(motion.segments) else until
        flow, F = system.mode(segment.mode)
        c = _row(system, where.series, flow.A, F)
        c[system.form.constant] -= where.level
        t, X = segment.t0, segment.X
        sign, zeros = _sign(c, flow.A, X, motion.scale)
        if was * sign < 0.0 and zeros and sign * where.direction >= 0.0:
            found.append(t)
        while sign and t < last:
            crossing = flow.first_crossing(X, motion.scale, (sign * c)[None], np.array([zeros]), last - t)
            if crossing.row < 0:
                break
            t, X = t + float(crossing.t.hi), crossing.state.hi
            sign, zeros = -sign, 1
            if sign * where.direction >= 0.0:
                found.append(t)
        was = sign
    return np.array(found)


def _row(system: System, series: str, A: Array, F: Array) -> Array:
    """Return the row that reads a coordinate, a velocity or a gap off the state in a mode (N,)."""
    nodes = system.dynamics.nodes
    Q, Qr = system.read
    if series in nodes:
        return np.asarray((Q + Qr @ F)[nodes.index(series)])
    if series.startswith("v_") and series[2:] in nodes:
        return np.asarray(((Q + Qr @ F) @ A)[nodes.index(series[2:])])
    names = [contact.name for contact in system.dynamics.contacts]
    return np.asarray((system.derivatives[0] + system.form.D @ F)[names.index(series)])


def _sign(c: Array, A: Array, X: Array, scale: Array) -> tuple[float, int]:
    """Return the sign of c·X right after an instant, and the order of the zero that it has there."""
    for order in range(len(X)):
        if abs(c @ X) > ZERO * (np.abs(c) @ scale):
            return float(np.sign(c @ X)), order
        c = c @ A
    return 0.0, 0


def _by_steps(
    problem: Problem,
    where: Section,
    force: float | None,
    need: int,
    end: float,
    method: Integrator,
    dt: float | None,
) -> Points:
    """Run a method that steps, and read its grid."""
    h = (force or problem.t_end / 100.0) / STEPS if dt is None else dt
    if not (is_real(h) and h > 0.0):
        raise InputError(f"dt = {dt!r} must be a positive number in s")
    steps = max(1, math.ceil(end / h * (1.0 - 1e-12)))
    run = simulate(problem, method, dt=end / steps, t_end=end, progress=False)
    side = "right"
    if isinstance(where, Stroboscope):
        times = np.minimum(_instants(where, float(force or 0.0), need, end), run.t[-1])
    elif isinstance(where, Impacts):
        side = where.side
        hits = _impacts(run.events, where.contact)[:need]
        q, v = (
            np.array([getattr(getattr(event, side), name) for event in hits]).reshape(len(hits), run.q.shape[1])
            for name in ("q", "v")
        )
        times = np.array([event.t for event in hits])
        last = run.sample(min(_whole_period(times, force), float(run.t[-1])))
        return Points(times, q, v, _speeds(problem.dynamics, run.events, times), np.concatenate([last.q, last.v]))
    else:
        names = [contact.name for contact in problem.dynamics.contacts]
        gap = where.series in names
        y = problem.dynamics.gap(run.q)[:, names.index(where.series)] if gap else run[where.series]
        y = y - where.level
        up, down = (y[:-1] < 0.0) & (y[1:] >= 0.0), (y[:-1] > 0.0) & (y[1:] <= 0.0)
        j = np.flatnonzero({1: up, -1: down, 0: up | down}[where.direction])
        times = run.t[j] + y[j] / (y[j] - y[j + 1]) * np.diff(run.t)[j]
    times = times[:need]
    state, last = run.sample(times, side), run.sample(min(_whole_period(times, force), float(run.t[-1])))
    speed = _speeds(problem.dynamics, run.events, times)
    return Points(times, state.q, state.v, speed, np.concatenate([last.q, last.v]))


def _frame(problem: Problem, points: Points, force: float | None) -> pd.DataFrame:
    nodes = problem.dynamics.nodes
    columns: dict[str, Any] = {
        "point": np.arange(len(points.t)),
        "t": points.t,
        "phase": np.full(len(points.t), np.nan) if force is None else _phase(points.t / force),
    }
    columns |= {node: points.q[:, i] for i, node in enumerate(nodes)}
    columns |= {f"v_{node}": points.v[:, i] for i, node in enumerate(nodes)}
    return pd.DataFrame(columns | {"speed": points.speed})


def _phase(turns: Array) -> Array:
    """Return the share of the period, 0 where rounding makes it just less than 1."""
    share = np.mod(turns, 1.0)
    return np.asarray(np.where(share > 1.0 - 1e-9, 0.0, share))


def period_of(points: Array, tol: float = 1e-6, most: int = MOST) -> int:
    """Return after how many points a sequence repeats itself, 0 where it does not.

    Parameters
    ----------
    points : (k, d) array
        Points of a section, the transient left out.
    tol : float
        Largest miss, relative to the largest |value| of each column, or a millionth of the largest of all.
    most : int
        Longest period that is looked for; half of the points must show it.

    Examples
    --------
    >>> period_of(np.array([[1.0], [2.0], [1.0], [2.0], [1.0], [2.0]]))
    2
    """
    points = np.atleast_2d(np.asarray(points, dtype=np.float64))
    unit = tol * _sizes(points)
    for p in range(1, min(most, len(points) // 2) + 1):
        if (np.abs(points[p:] - points[:-p]) <= unit).all():
            return p
    return 0


def _sizes(points: Array) -> Array:
    """Return the largest |value| of each column, of which what is far below the others is rounding (d,)."""
    sizes = np.abs(points).max(axis=0, initial=0.0)
    return np.asarray(np.maximum(sizes, max(1e-6 * sizes.max(initial=0.0), 1e-300)))


def each_of(function: Callable[[Any], Any], items: Sequence[Any], workers: int | None) -> Iterator[Any]:
    """Yield function(item) for each item, in order, by so many threads (None or 1: by none)."""
    if workers is None or workers == 1:
        yield from map(function, items)
        return
    if not is_count(workers):
        raise InputError(f"workers = {workers!r} must be a whole number above zero")
    with ThreadPoolExecutor(int(workers)) as pool:
        yield from pool.map(function, items)


@checked
def bifurcation(
    family: Callable[[float], Problem],
    values: Iterable[float],
    section: str | Section = "force",
    *,
    transient: int = 200,
    kept: int = 50,
    method: str | Integrator = "exact",
    dt: float | None = None,
    continue_from: bool = False,
    tol: float = 1e-6,
    workers: int | None = None,
    watch: Watch = unwatched,
    **method_options: Any,
) -> pd.DataFrame:
    """Return where motions end up, value by value of a parameter: the points of a bifurcation diagram.

    Parameters
    ----------
    family : callable
        Takes a value and returns a Problem.
    values : iterable of float
        In the order in which they are run.
    section, method, dt, **method_options
        As of `poincare`.
    transient, kept : int
        Points that are left out first, and that are kept, for each value.
    continue_from : bool
        Start each run where the one before ended, at a whole period of the force: an attractor is then followed as far as it
        exists, and a sweep down may show others than a sweep up (hysteresis). Else each starts from its problem's own state.
    tol : float
        Relative miss within which points repeat themselves, for the column ``period``.
    workers : int, optional
        Threads; one unless more are asked for. Runs that continue each other take none.
    watch : callable
        Sees the values go by.

    Returns
    -------
    DataFrame
        One row a point: ``value``, then the columns of `poincare`, then ``period`` (points after which they repeat, 0 where
        they do not) and ``failure``; a run that fails is a row of NaN with the reason.

    Examples
    --------
    >>> from lcpimpact import bifurcation, load_problem
    >>> table = bifurcation(lambda omega: load_problem("shaw-holmes", omega=omega), [2.6, 2.7], kept=20)
    >>> table.groupby("value")["period"].first().tolist()
    [1, 2]
    """
    where = section_of(section)
    chosen = [float(value) for value in values]
    if not chosen:
        raise InputError("values is empty: give those that the parameter is to take")
    _whole(transient=(transient, 0), kept=(kept, 1))
    last: list[Array] = []

    def one(value: float) -> pd.DataFrame:
        try:
            problem = family(value)
            if last:
                problem = _continued(problem, last.pop())
            points, force = _points(problem, where, transient, kept, None, method, dt, method_options)
        except LcpImpactError as error:
            return pd.DataFrame({"value": [value], "failure": [str(error)]})
        if continue_from:
            last[:] = [points.last]
        if len(points.t) == 0:
            return pd.DataFrame({"value": [value], "failure": ["the motion does not meet the section often enough"]})
        table = _frame(problem, points, force)
        table.insert(0, "value", value)
        return table.assign(period=period_of(np.hstack([points.q, points.v]), tol), failure="")

    tables = list(watch(each_of(one, chosen, None if continue_from else workers), len(chosen), "bifurcation"))
    columns = max((list(table.columns) for table in tables), key=len)
    columns = [*(name for name in columns if name not in ("period", "failure")), "period", "failure"]
    table = pd.concat([each.reindex(columns=columns) for each in tables], ignore_index=True)
    table.attrs = _told(_name(family, chosen[0]), where, method, transient) | {"kept": kept}
    return table


def _name(family: Callable[[float], Problem], value: float) -> str:
    try:
        return family(value).name
    except LcpImpactError:
        return ""


def _continued(problem: Problem, last: Array) -> Problem:
    """Return the problem with the state that a run before has left, where it may begin there."""
    d = problem.dynamics
    free = [i for i in range(len(d.nodes)) if i not in d.motions]
    try:
        q0, v0 = ({d.nodes[i]: float(row[i]) for i in free} for row in last)
        return replace(problem, q0=q0, v0=v0)
    except InputError:
        # The stop has moved to where the mass is.
        return problem


@dataclass(frozen=True, eq=False)
class Basins:
    """Which start leads where.

    Attributes
    ----------
    table : DataFrame
        One row a start: its two values, ``attractor`` (1, 2, ... by how many starts it draws; 0: none found within the
        longest run), ``period`` (of it, in periods of the force), ``run`` (periods until it was clear) and ``failure``.
    attractors : DataFrame
        One row a point of an attractor: ``attractor``, ``period``, ``share`` (of all starts), ``point``, the coordinates and
        velocities at the phase 0 of the force, and ``speed`` (m/s) of the impact before it.
    """

    table: pd.DataFrame
    attractors: pd.DataFrame


@checked
def basins(
    family: Callable[[float, float], Problem],
    first: Iterable[float],
    second: Iterable[float],
    *,
    names: tuple[str, str] = ("first", "second"),
    longest: int = 400,
    tol: float = 1e-5,
    workers: int | None = None,
    watch: Watch = unwatched,
) -> Basins:
    """Return the basins of attraction over two values of the start, by the exact motion seen once a period of the force.

    Each start is run until its points repeat themselves, after at most 16 periods, or to the longest run. Attractors are one
    where their points lie within a hundredth of their reach.

    Parameters
    ----------
    family : callable
        Takes the two values and returns a Problem with a periodic force.
    first, second : iterable of float
        The grid.
    names : pair of str
        How the table calls the two values.
    longest : int
        Periods after which a start is left as 0.
    tol : float
        Relative miss within which points repeat themselves.
    workers : int, optional
        Threads; one unless more are asked for.
    watch : callable
        Sees the starts go by.

    Raises
    ------
    InputError
        For an empty grid or counts that are none.

    Examples
    --------
    >>> from lcpimpact import basins, load_problem
    >>> found = basins(lambda x0, v0: load_problem("shaw-holmes", x0=x0, v0=v0), [-0.5, -0.1], [0.0, 0.5])
    >>> found.table["attractor"].tolist(), found.attractors["period"].tolist()
    ([1, 1, 1, 2], [1, 3, 3, 3])
    """
    _whole(longest=(longest, 1))
    starts = [(float(a), float(b)) for a in first for b in list(second)]
    if not starts:
        raise InputError("first and second must both hold values")

    def one(start: tuple[float, float]) -> tuple[Array, int, int, str, tuple[str, ...]]:
        try:
            problem = family(*start)
            cycle, run = _settled(problem, longest, tol)
        except LcpImpactError as error:
            return np.zeros((0, 0)), 0, 0, str(error), ()
        return cycle, len(cycle), run, "", problem.dynamics.nodes

    ended = list(watch(each_of(one, starts, workers), len(starts), "basins"))
    table = pd.DataFrame(starts, columns=list(names))
    labels, attractors = _named([cycle for cycle, *_ in ended])
    table = table.assign(
        attractor=labels,
        period=[len(cycle) for cycle, *_ in ended],
        run=[run for _, _, run, *_ in ended],
        failure=[failure for *_, failure, _ in ended],
    )
    nodes = next((names for *_, names in ended if names), ())
    columns = [*nodes, *(f"v_{node}" for node in nodes), "speed"]
    rows = [
        {"attractor": k, "period": len(cycle), "share": labels.count(k) / len(labels), "point": i}
        | dict(zip(columns, point.tolist(), strict=True))
        for k, cycle in enumerate(attractors, start=1)
        for i, point in enumerate(cycle)
    ]
    found = pd.DataFrame(rows, columns=["attractor", "period", "share", "point", *columns])
    table.attrs = {"longest": longest, "tol": tol}
    return Basins(table, found)


def _settled(problem: Problem, longest: int, tol: float) -> tuple[Array, int]:
    """Return the points of the attractor on which a run ends, in order, and the periods that it took."""
    force = force_period(problem.dynamics)
    if force is None:
        raise InputError(f"{problem.name} has no force with a period, so it cannot be seen once in each")
    refuse_power_laws(problem)
    motion = begin_problem(problem, "exact", longest * force)
    reached = 0
    while reached < longest:
        reached = min(reached + BLOCK, longest)
        _go_on(motion, problem, reached * force)
        times = np.minimum(np.arange(max(0, reached - 2 * MOST), reached + 1) * force, motion.end)
        q, v, _ = read(motion.system, tuple(motion.segments), times, "right")
        z = np.hstack([q, v])
        miss = [_miss(z, p) for p in range(1, MOST + 1)]
        if min(miss) <= tol:
            # Where a slow approach turns by half a circle a period, every other point settles first.
            p = 1 + next(i for i, each in enumerate(miss) if each <= 100.0 * tol)
            speed = _speeds(problem.dynamics, motion.events, times[-p:])
            if not any(event.t > times[-1 - p] for event in _impacts(motion.events, None)):
                speed[:] = np.nan  # the last impact belongs to the approach
            cycle = np.column_stack([z[-p:], speed])
            return np.roll(cycle, -int(np.argmin(cycle[:, 0])), axis=0), reached
    return np.zeros((0, 1 + 2 * len(problem.dynamics.nodes))), reached


def _miss(z: Array, p: int) -> float:
    """Return how far the last points miss those p before, relative to the largest value of each column."""
    seen = max(p, 4)
    if len(z) < seen + p:
        return math.inf
    return float((np.abs(z[-seen:] - z[-seen - p : -p]) / _sizes(z)).max())


def _named(cycles: list[Array]) -> tuple[list[int], list[Array]]:
    """Return for each cycle the number of its attractor, 1 for the one that is met most, and the attractors."""
    reach = max((float(np.abs(cycle[:, :-1]).max()) for cycle in cycles if len(cycle)), default=1.0)
    known: list[Array] = []
    found = []
    for cycle in cycles:
        label = -1
        for k, other in enumerate(known):
            # A cycle that is the other run through twice does not occur: the shortest period is taken.
            if len(other) == len(cycle) and _distance(cycle[:, :-1], other[:, :-1]) <= SAME * reach:
                label = k
                break
        if label < 0 and len(cycle):
            known.append(cycle)
            label = len(known) - 1
        found.append(label)
    rank = sorted(range(len(known)), key=lambda k: (-found.count(k), k))
    return [rank.index(k) + 1 if k >= 0 else 0 for k in found], [known[k] for k in rank]


def _distance(a: Array, b: Array) -> float:
    """Return how far two cycles of the same length are apart, over all phases of one to the other."""
    return min(float(np.abs(np.roll(a, shift, axis=0) - b).max()) for shift in range(len(a)))
