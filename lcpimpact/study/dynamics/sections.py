"""Poincaré sections: stroboscopic, at impacts, and at level crossings."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from lcpimpact.arguments import check_fields, checked
from lcpimpact.arrays import Array
from lcpimpact.errors import InputError, LcpImpactError
from lcpimpact.events import steps_of
from lcpimpact.hybrid.motion import ExactSolution, HybridMotion
from lcpimpact.hybrid.system import ZERO, System
from lcpimpact.integrators.base import Integrator, Option
from lcpimpact.numbers import count, is_real, positive
from lcpimpact.problems.base import Problem
from lcpimpact.record import Event
from lcpimpact.registry import nearest
from lcpimpact.scheme.dynamics import Dynamics
from lcpimpact.simulation import RUN_ARGUMENTS, check_lcp_solver, make_integrator, simulate
from lcpimpact.study.dynamics.period import period_of
from lcpimpact.study.dynamics.shooting import follow_exactly, force_period, refuse_power_laws
from lcpimpact.study.progress import Progress, counted, ignore_count
from lcpimpact.study.result import Study, table_lines
from lcpimpact.trajectory import Trajectory

BLOCK_PERIODS = 8
"""Number of periods simulated first, until enough points are found."""

MAX_POINTS_SHOWN = 12
"""Maximum number of points in a summary."""


@dataclass(frozen=True)
class Stroboscope:
    """A section at a fixed phase of the force.

    Parameters
    ----------
    phase : float
        As a fraction of the period, from 0 to 1.
    period : float, optional
        In s; by default that of the force.
    """

    phase: float = 0.0
    period: float | None = None

    def __str__(self) -> str:
        return f"force:{self.phase:g}" if self.phase else "force"

    def __post_init__(self) -> None:
        check_fields(self)
        if not (is_real(self.phase) and 0.0 <= self.phase < 1.0):
            raise InputError(f"phase = {self.phase!r} must be a fraction of the period, from 0 to below 1")
        if self.period is not None:
            positive("period", self.period, "s")


@dataclass(frozen=True)
class Impacts:
    """A section at the impacts.

    Parameters
    ----------
    contact : str, optional
        Name of one contact; by default all.
    side : {"left", "right"}
        State before or after the impact.
    """

    contact: str | None = None
    side: str = "left"

    def __str__(self) -> str:
        return "impact" if self.contact is None else f"impact:{self.contact}"

    def __post_init__(self) -> None:
        if self.side not in ("left", "right"):
            raise InputError(f"side = {self.side!r} must be 'left' or 'right'")


@dataclass(frozen=True)
class Crossing:
    """A section where a coordinate, a velocity or a gap crosses a level continuously.

    Parameters
    ----------
    series : str
        A coordinate, a velocity as v_NAME, or a contact (its gap).
    level : float
        In m or m/s.
    direction : {1, -1, 0}
        Upwards, downwards, or both.
    """

    series: str
    level: float = 0.0
    direction: int = 0

    def __str__(self) -> str:
        return f"{self.series}{'=><'[self.direction]}{self.level:g}"

    def __post_init__(self) -> None:
        check_fields(self)
        if not is_real(self.level) or self.direction not in (-1, 0, 1):
            raise InputError(f"{self!r}: the level must be a number, and the direction 1, -1 or 0")


Section = Stroboscope | Impacts | Crossing


@checked
def section_of(text: str | Section) -> Section:
    """Return the section specified by a string, as on the command line.

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
    """Crossings of a section: t (k,), q and v (k, n), and the speed of the last impact at or before each point (k,).

    ``struck`` is the instant of that impact (k,), or of steps the beginning of its step; NaN without one.
    ``last`` is q and v (2, n) at the last whole period of the force, or the last point, from which a run can continue.
    """

    t: Array
    q: Array
    v: Array
    speed: Array
    struck: Array
    last: Array

    def after(self, count: int) -> Points:
        """Return the points after the first ones."""
        return Points._make([*(each[count:] for each in self[:-1]), self.last])


@dataclass(frozen=True, eq=False, repr=False)
class PoincareSection(Study):
    """The points of a Poincaré section.

    Attributes
    ----------
    table : DataFrame       one row per point, see `poincare`
    problem : Problem
    section : Section
    method : str
    """

    table: pd.DataFrame
    problem: Problem
    section: Section
    method: str

    drawn_by = "lcpimpact.plotting.dynamics:plot_poincare"
    title = "Section of {0.problem.name}"

    def summary(self) -> str:
        """Return the period of the points, and the first of them."""
        nodes = self.problem.dynamics.nodes
        period = period_of(self.table[[*nodes, *(f"v_{node}" for node in nodes)]].to_numpy()) if len(self.table) else 0
        words = f"they repeat after {period}" if period else "they do not repeat themselves"
        first = f"{self.problem.name} by {self.method}: {len(self.table)} points at {self.section}; {words}"
        return "\n".join([first, *table_lines(self.table.head(MAX_POINTS_SHOWN), ".6g")])


@checked
def poincare(
    problem: Problem,
    section: str | Section = "force",
    *,
    skip: int = 0,
    points: int = 200,
    t_end: float | None = None,
    method: str | Integrator = "exact",
    dt: float | None = None,
    lcp_solver: str = "auto",
    progress: Progress = True,
    **method_options: Option,
) -> PoincareSection:
    """Return the points of a Poincaré section.

    With ``exact`` all points are found, to rounding error; a time-stepping method is interpolated linearly on its grid.

    Parameters
    ----------
    problem : Problem
    section : str or Section
        `Stroboscope`, `Impacts`, `Crossing`, or a string as in `section_of`.
    skip, points : int
        Number of points omitted first, and number kept.
    t_end : float, optional
        Latest time in s; by default four periods of the force per point, or without force the problem's t_end per point.
        The table is shorter if this is not enough.
    method : str or Integrator
        ``exact``, or any time-stepping method.
    dt : float, optional
        Step in s of such a method; by default 1/200 of a period.
    lcp_solver : str
        A name of ``lcpimpact list solvers``, for the LCPs of the method.
    progress : bool or callable
        As of `lcpimpact.study.progress`.
    **method_options
        Options of the method.

    Returns
    -------
    PoincareSection
        Its ``table`` has one row per point: ``point`` (from 0), ``t`` (s), ``phase`` (fraction of the period of the force,
        NaN without), the coordinates (m), the velocities (m/s, ``v_NAME``), ``speed`` (m/s, of the impact at or before the
        point).

    Raises
    ------
    LcpImpactError
        If the section does not fit the problem, or the run fails.

    Examples
    --------
    >>> from lcpimpact import load_problem, poincare
    >>> section = poincare(load_problem("shaw-holmes"), "impact", skip=60, points=2)
    >>> section.table["speed"].round(7).tolist()
    [0.5006725, 0.5006725]
    """
    where = section_of(section)
    integrator = make_integrator(method, method_options, RUN_ARGUMENTS)
    count("skip", skip, least=0)
    count("points", points)
    with counted(skip + points, "points", progress) as done:
        found, force = find_points(problem, where, skip + points, t_end, integrator, dt, lcp_solver, done)
    return PoincareSection(table_of(problem, found.after(skip), force), problem, where, integrator.name)


def find_points(
    problem: Problem,
    where: Section,
    need: int,
    t_end: float | None,
    integrator: Integrator,
    dt: float | None,
    lcp_solver: str,
    done: Callable[[int], None] = ignore_count,
) -> tuple[Points, float | None]:
    """Return the requested number of points, or those before the end, and the period of the force."""
    force = force_of(problem, where)
    end = t_end if t_end is not None else latest(problem, where, force, need)
    positive("t_end", end, "s")
    check_lcp_solver(integrator, lcp_solver)
    if integrator.declared.is_exact:
        refuse_power_laws(problem)
    motion = integrator.motion(problem, end, lcp_solver)
    if motion is None:
        steps = steps_to(end, problem, force, dt)
        run = simulate(problem, integrator, dt=end / steps, t_end=end, lcp_solver=lcp_solver, progress=False)
        found = _on_grid(run, where, force, need, end)
    else:
        found = _on_motion(motion, problem, where, force, need, done)
    done(len(found.t))
    return found, force


def steps_to(
    end: float, problem: Problem, force: float | None, dt: float | None, *, steps_per_period: int = 200
) -> int:
    """Return the number of steps until the end, each at most dt, or by default a part of the period of the force.

    ``steps_per_period``: default number of time steps per period of the force, or per t_end/100 without a force.
    """
    h = (force or problem.t_end / 100.0) / steps_per_period if dt is None else dt
    positive("dt", h, "s")
    return max(1, math.ceil(end / h * (1.0 - 1e-12)))


def _whole_period(times: Array, force: float | None) -> float:
    """Return the last whole period of the force at or before the last time, or without force that time; 0 without times."""
    end = float(times[-1]) if len(times) else 0.0
    return end if force is None else math.floor(end / force * (1.0 + 1e-12)) * force


def force_of(problem: Problem, where: Section) -> float | None:
    """Check that the section is valid for the problem, and return the period of the force."""
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
        if not d.rigid.any():
            raise InputError(f"{problem.name} has no impacts, whose plates would both have mass: take another section")
    else:
        known = [*d.nodes, *(f"v_{node}" for node in d.nodes), *names]
        if where.series not in known:
            raise InputError(nearest(where.series, known, "series"))
    try:
        return force_period(d)
    except LcpImpactError:
        return None


def latest(problem: Problem, where: Section, force: float | None, need: int) -> float:
    """Return an estimated time for a number of points."""
    if isinstance(where, Stroboscope):
        return need * float(force or 0.0) + where.phase * float(force or 0.0)
    return need * (problem.t_end if force is None else 4.0 * force)


def instants(where: Stroboscope, force: float, need: int, end: float) -> Array:
    """Return the times of a stroboscope, without the start of the motion."""
    t = (np.arange(need) + (where.phase or 1.0)) * force
    return np.asarray(t[t <= end * (1.0 + 1e-12)])


def _on_motion(
    motion: HybridMotion,
    problem: Problem,
    where: Section,
    force: float | None,
    need: int,
    done: Callable[[int], None],
    *,
    spare: float = 1.1,
) -> Points:
    """Follow the exact motion until enough points of the section are found, or to the end.

    ``spare``: time that is simulated next, relative to that in which as many points as are missing have been found.
    """
    end = motion.end
    block = shortest = BLOCK_PERIODS * (force or problem.t_end)
    reached = 0.0
    if isinstance(where, Stroboscope):
        times = np.minimum(instants(where, float(force or 0.0), need, end), end)
        for number in range(0, len(times), BLOCK_PERIODS):
            follow_exactly(motion, problem, float(times[number]))
            done(number)
        follow_exactly(motion, problem, end)
        return _read_at(motion, times, "right", force)
    times = np.zeros(0)
    while reached < end and len(times) < need:
        reached = min(reached + block, end)
        follow_exactly(motion, problem, reached)
        if isinstance(where, Impacts):
            hits = impacts_of(motion.events, where.contact)
            times = np.array([event.t for event in hits])
        else:
            times = _crossings(motion, where, reached)
        done(min(len(times), need))
        likely = spare * (need - len(times)) * reached / max(len(times), 1)
        block = min(2.0 * block, max(likely, shortest))
    return _read_at(motion, times[:need], where.side if isinstance(where, Impacts) else "right", force)


def impacts_of(events: Iterable[Event], contact: str | None) -> list[Event]:
    """Return the impacts among events, of one contact or of all."""
    return [event for event in events if event.kind == "impact" and contact in (None, event.contact)]


def _read_at(motion: HybridMotion, times: Array, side: str, force: float | None) -> Points:
    read = ExactSolution.of(motion)
    q, v, _ = read(times, side)
    q_last, v_last, _ = read(np.array([_whole_period(times, force)]), "right")
    struck = last_impacts(motion.system.dynamics, motion.events, times)
    return Points(times, q, v, *struck, np.concatenate([q_last, v_last]))


def last_impacts(
    dynamics: Dynamics, events: Sequence[Event], times: Array, began: Callable[[Sequence[Event]], Array] | None = None
) -> tuple[Array, Array]:
    """Return -U⁻ and the instant of the last impact at or before each time, or when it ``began``; NaN without one."""
    rows = {contact.name: i for i, contact in enumerate(dynamics.contacts)}
    hits = impacts_of(events, None)
    at = np.array([event.t for event in hits])
    row = np.array([rows[event.contact] for event in hits], dtype=np.int64)
    q, before = (np.array([getattr(event.left, x) for event in hits]).reshape(-1, len(dynamics.nodes)) for x in "qv")
    speed = np.append(np.nan, -dynamics.gap_rate(at, q, before)[np.arange(len(hits)), row])
    last = np.searchsorted(at, times, side="right")
    return speed[last], np.append(np.nan, at if began is None else began(hits))[last]


def _crossings(motion: HybridMotion, where: Crossing, until: float) -> Array:
    """Return all times at which a series crosses its level, by the convex hulls of its polynomials."""
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
    """Return the row vector that maps the state in a mode to a coordinate, a velocity or a gap (N,)."""
    nodes = system.dynamics.nodes
    Q, Qr = system.read
    if series in nodes:
        return np.asarray((Q + Qr @ F)[nodes.index(series)])
    if series.startswith("v_") and series[2:] in nodes:
        return np.asarray(((Q + Qr @ F) @ A)[nodes.index(series[2:])])
    names = [contact.name for contact in system.dynamics.contacts]
    return np.asarray((system.derivatives[0] + system.form.D @ F)[names.index(series)])


def _sign(c: Array, A: Array, X: Array, scale: Array) -> tuple[float, int]:
    """Return the sign of c·X just after an instant, and the order of its zero there."""
    for order in range(len(X)):
        if abs(c @ X) > ZERO * (np.abs(c) @ scale):
            return float(np.sign(c @ X)), order
        c = c @ A
    return 0.0, 0


def _on_grid(run: Trajectory, where: Section, force: float | None, need: int, end: float) -> Points:
    """Return the points by linear interpolation on the grid of a run."""
    dynamics, side = run.problem.dynamics, "right"

    def points(times: Array, q: Array, v: Array) -> Points:
        struck = last_impacts(dynamics, run.events, times, lambda hits: run.t[steps_of(hits, run.t, run.q, run.v)])
        last = run.sample(min(_whole_period(times, force), float(run.t[-1])))
        return Points(times, q, v, *struck, np.concatenate([last.q, last.v]))

    if isinstance(where, Stroboscope):
        times = np.minimum(instants(where, float(force or 0.0), need, end), run.t[-1])
    elif isinstance(where, Impacts):
        side = where.side
        hits = impacts_of(run.events, where.contact)[:need]
        q, v = (
            np.array([getattr(getattr(event, side), name) for event in hits]).reshape(len(hits), run.q.shape[1])
            for name in ("q", "v")
        )
        return points(np.array([event.t for event in hits]), q, v)
    else:
        names = [contact.name for contact in dynamics.contacts]
        gap = where.series in names
        y = dynamics.gap(run.t, run.q)[:, names.index(where.series)] if gap else run[where.series]
        y = y - where.level
        up = (y[:-1] < 0.0) & (y[1:] >= 0.0)
        down = (y[:-1] > 0.0) & (y[1:] <= 0.0)
        j = np.flatnonzero({1: up, -1: down, 0: up | down}[where.direction])
        times = run.t[j] + y[j] / (y[j] - y[j + 1]) * np.diff(run.t)[j]
    times = times[:need]
    state = run.sample(times, side)
    return points(times, state.q, state.v)


def table_of(problem: Problem, points: Points, force: float | None) -> pd.DataFrame:
    """Return the points as a table, one row per point."""
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
    """Return the fraction of the period, 0 if rounding makes it just less than 1."""
    fraction = np.mod(turns, 1.0)
    return np.where(fraction > 1.0 - 1e-9, 0.0, fraction)
