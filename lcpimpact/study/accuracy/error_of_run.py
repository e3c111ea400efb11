"""Estimates of the error of a run: against the exact motion of its problem, or by runs with half and a quarter of its step.

*Halving.* With d01, d12 and d02 the distances of the runs at dt, dt/2 and dt/4 at the instants of the first, the order is
p = log2(d01/d12), and the error of the first is d02/(1 - 4^-p) where p is at least `LEAST_ORDER`; where it is less, the
runs are not in the asymptotic range, and the error is `scatter` times the largest of the three distances. Velocities are
compared after the first instant, at which all runs have the given ones: nodes without mass leave these at once.

*Events.* Across impacts a run is of order 1 with a factor that depends on where in its step each impact falls: by luck it
may be small in one of the three, and p says little. The three grids share the instants of the first, besides, and an event
soon after one of these is late, or one soon before it is early, in all runs alike. Where there are impacts, or no order, or
events across which the order is below that of smooth motion, the error is therefore the distance d03 to a fourth run, whose
steps are s = `FINEST` times smaller and fall nowhere together with those of the first; where a signal jumps at an instant
of the first, which is then no error of it, s = 17. By luck the first may be as close to the truth as the fourth, which is
off by d23/(s/4 - 1) at order 1: this is added. A number of impacts that differs among the three finer runs is not known:
where impacts accumulate, smaller steps resolve more of them without end. Where events keep the order of smooth motion,
errors may be far below those of reading the fourth run between its instants: its steps are `fifths` times smaller then, and
the error of a coordinate is at least d03 at every fifth instant, which both runs have.

A penetration of a contact that only pushes is an error of the coordinates whatever the runs have in common: the estimate is
not below it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from lcpimpact.arrays import Array, Flags, Indices
from lcpimpact.errors import InputError, LcpImpactError, Status, UnsupportedError
from lcpimpact.integrators import METHODS
from lcpimpact.integrators.base import Integrator
from lcpimpact.quantities import SUMMARY
from lcpimpact.record import Event, Grid
from lcpimpact.run_error import COARSE, EventError, RunError
from lcpimpact.scheme.dynamics import Dynamics
from lcpimpact.scheme.signals import TimeFunction, breakpoints_at, jumps
from lcpimpact.scheme.sparse_dynamics import SparseDynamics
from lcpimpact.simulation import run_within, simulate
from lcpimpact.trajectory import Trajectory

LEAST_ORDER = 0.5
"""Order of halving below which runs are not in the asymptotic range."""

NO_SCHEME = "the run was read from a file without its scheme: give read_run(path, problem)"

AGREEMENT_RTOL = 1e-12
"""Distance of runs, relative to the largest value, below which they agree: many steps of rounding."""

COUNT = [*SUMMARY].index("impacts")
"""Place of the number of impacts in the summary."""

POINTS = 64
"""Number of grid points of the exact motion, which is read between them."""

FINER = 100.0
"""Factor by which the tolerance of a run that chooses its steps is tightened."""

FINEST = 16.0 + 0.5 * (math.sqrt(5.0) - 1.0)
"""Steps of the fourth run for each of the first: by the golden ratio, so that their instants stay apart."""

NESTED = 17.0
"""Steps of the fourth run where instants shall be shared."""

HALVINGS = 2.0 + 4.0 + NESTED
"""Cost of the runs at dt/2 and dt/4, and of the fourth, in units of the run."""

FAILURES = (LcpImpactError, ArithmeticError, ValueError, LookupError, MemoryError)
"""Exceptions of a method for a problem that it cannot run."""


def estimate_error(
    run: Trajectory, how: str = "auto", columns: Sequence[str] | None = None, seconds: float = math.inf
) -> RunError | None:
    """Return the estimated error of a run.

    Parameters
    ----------
    run : Trajectory
    how : {"auto", "exact", "halving"}
        "auto" takes the exact motion where `exact` takes the problem, else halving.
    columns : sequence of str, optional
        Names of series; by default all.
    seconds : float
        The time that it may take in s.

    Returns
    -------
    RunError or None
        None where it would take longer.
    """
    if how not in ("auto", "exact", "halving"):
        raise InputError(f"how = {how!r} must be 'auto', 'exact' or 'halving'")
    for name in columns or ():
        run[name]
    if run.lacks == "scheme":
        return RunError.unknown(NO_SCHEME)
    if len(run.t) < 2:
        return RunError.unknown("the run ended before its first step")
    refused = ""
    if how != "halving":
        found, refused = _against_exact(run, seconds)
        if found is not None:
            return found.of(columns)
        if how == "exact":
            return RunError.unknown(refused) if refused else None
    if HALVINGS * run.stats.seconds > seconds:
        return None
    found = _by_halving(run)
    if not found.known and refused:
        found = replace(found, reason=f"{found.reason}; {refused}")
    return found.of(columns)


def _against_exact(run: Trajectory, seconds: float, *, exact_parts: float = 3.0) -> tuple[RunError | None, str]:
    """Return the error against the exact motion, or why there is none; neither where it would take longer.

    ``exact_parts``: cost of the exact motion with its certificate and summary, in units of the motion alone.
    """
    if run.problem.sparse:
        return None, "exact takes no sparse matrices"
    if run.integrator is not None and run.integrator.declared.is_exact:
        rounding = run.integrator.declared.accuracy
        why = f"{run.integrator.name}: to rounding, {rounding:.0e} of the largest value"
        return _error("exact", run, run, _rounding(run, rounding), why), ""
    end = float(run.t[-1])
    try:
        truth = run_within(run.problem, METHODS["exact"](), Grid(end, POINTS), seconds / exact_parts)
    except UnsupportedError as error:
        return None, str(error)
    except FAILURES as error:
        return None, f"exact fails: {error}"
    if truth.status is Status.INTERRUPTED:
        return None, ""
    if not truth.success:
        return None, truth.message
    return error_against(run, truth), ""


def error_against(run: Trajectory, truth: Trajectory) -> RunError:
    """Return the error of a run by the exact motion of its problem."""
    return _error("exact", run, truth, _distance(run, truth, run), "against the exact motion")


def _by_halving(run: Trajectory, *, near_order: float = 0.5, fifths: float = 83.0 / 5.0) -> RunError:
    """Return the error by runs of smaller steps, or of a tighter tolerance where the method chooses its steps.

    ``near_order``: largest deficit of an observed order, below that of smooth motion, where steps resolve the
    events.
    ``fifths``: steps of the fourth run where every fifth instant shall be shared.
    """
    method = run.integrator
    if method is None:
        return RunError.unknown("the method of the run is not known")
    if method.declared.is_exact:
        return RunError.unknown(f"{method.name} has no steps to halve")

    def finer(parts: float, with_method: Integrator = method) -> Trajectory:
        return simulate(
            run.problem,
            with_method,
            dt=end / round(steps * parts),
            t_end=end,
            lcp_solver=run.lcp_solver,
            throw=False,
            progress=False,
            record=[*run.nodes, *run.force_names] if run.problem.sparse else None,
            error=False,
        )

    end, steps = float(run.t[-1]), len(run.t) - 1
    try:
        if method.rtol is not None:
            tight = method.with_tolerance(method.rtol / FINER)
            runs = [finer(1, tight)]
        else:
            runs = [finer(2), finer(4)]
    except FAILURES as error:
        return RunError.unknown(f"a more accurate run fails: {error}")
    for each in runs:
        if not each.ended:
            return RunError.unknown(f"a more accurate run fails: {each.message}")
    if method.rtol is not None:
        why = f"against the run with rtol = {method.rtol / FINER:g}"
        return _error("halving", run, runs[0], _distance(run, runs[0], run), why)
    half, quarter = runs
    d01, d12, d02 = (_distance(a, b, run) for a, b in ((run, half), (half, quarter), (run, quarter)))
    distance = _extrapolated(d01, d12, d02)
    finest = quarter
    q = slice(len(run.nodes))
    # Of sparse steps no events are known.
    events = [event for each in (run, *runs) for event in each.events]
    eventful = run.problem.sparse or any(event.impulse != 0.0 for event in events)
    least = method.declared.order_smooth - near_order if events else LEAST_ORDER
    clean = (distance.order[q] >= least) | (d02.columns[q] == 0.0)
    if eventful or not clean.all():
        with suppress(*FAILURES):
            parts = NESTED if _jumps_at_instants(run) else FINEST
            fourth = finer(parts)
            if fourth.ended:
                d03, d23 = (_distance(each, fourth, run, _kinks(fourth)) for each in (run, quarter))
                finest = fourth
                distance = replace(_beyond(d03, d23, parts), order=distance.order)
                if len({_summary(each)[COUNT] for each in (half, quarter, fourth)}) > 1:
                    distance.summary[COUNT] = np.nan
    elif events:
        with suppress(*FAILURES):
            fourth = finer(fifths)
            if fourth.ended:
                d03 = _distance(run, fourth, run, _unshared(run, fourth))
                distance.columns[q] = np.fmax(distance.columns[q], d03.columns[q])
                finest = fourth
                distance = replace(distance, instants=np.fmax(distance.instants, d03.instants))
    return _error("halving", run, finest, distance)


def _unshared(run: Trajectory, finer: Trajectory) -> list[tuple[float, float]]:
    """Return the instants of a run that a finer one has not, each as a time that begins and ends there."""
    steps, parts = len(run.t) - 1, len(finer.t) - 1
    return [(t, t) for t in run.t[np.arange(steps + 1) * parts % steps != 0]]


def _kinks(run: Trajectory) -> list[tuple[float, float]]:
    """Return the times around the events of a run in which it is read across a kink where an instant is none of its own."""
    h = float(np.diff(run.t).max())
    return [(event.t - h, event.t + h) for event in run.events]


def _jumps_at_instants(run: Trajectory) -> bool:
    """Return whether a signal or a sampled force jumps at an instant of the run, where its steps see both limits."""
    signals: tuple[float | TimeFunction, ...]
    d: Dynamics | SparseDynamics = run.problem.dynamics
    if isinstance(d, SparseDynamics):
        signals = (*d.signals.listed, *d.motions.values())
    else:
        signals = (*(load for _, load in d.loads), *d.motions.values())
        if d.holds:
            return True
    return any(jumps(signal) and len(breakpoints_at(signal, run.t)[0]) for signal in signals)


@dataclass(frozen=True, eq=False)
class Distance:
    """Distance of two runs of one problem.

    Attributes
    ----------
    columns : (nn,) array               largest difference of each column
    instants, impulses : (ne,) arrays   differences of each event of the run that is judged; NaN without a counterpart
    summary : (ns,) array               differences of the usual quantities
    order : (nn,) array                 observed order of each column, NaN where there is none
    """

    columns: Array
    instants: Array
    impulses: Array
    summary: Array
    order: Array


def _distance(a: Trajectory, b: Trajectory, run: Trajectory, kinks: Sequence[tuple[float, float]] = ()) -> Distance:
    """Return the distance of two runs at the instants, and of the events, of the run that is judged.

    Coordinates are left out in the times of ``kinks``.
    """
    pairs = _paired(a.events, b.events)
    h, n = float(np.diff(run.t).max()), len(run.nodes)
    windows = [
        (min(x.t, y.t) - h, max(x.t, y.t) + h) for x, y in ((a.events[i], b.events[j]) for i, j in pairs.items())
    ]
    with np.errstate(all="ignore"):
        motion, force = (np.abs(x - y) for x, y in zip(_columns(a, run), _columns(b, run), strict=True))
        summary = np.abs(_summary(a) - _summary(b))
    q = _away(motion[:, :n], run.t, kinks)
    v = _away(motion[1:, n:], run.t[1:], windows)
    columns = np.concatenate([q, v, _away(force, run.t_reaction, windows)])
    instants, impulses = np.full((2, len(run.events)), np.nan)
    for k, i in _paired(run.events, a.events).items():
        if i in pairs:
            x, y = a.events[i], b.events[pairs[i]]
            instants[k] = abs(x.t - y.t)
            impulses[k] = abs(x.impulse - y.impulse)
    return Distance(columns, instants, impulses, summary, np.full(len(columns), np.nan))


def _rounding(run: Trajectory, relative: float) -> Distance:
    """Return the distance from the truth of a run that is exact but for rounding."""
    motion, force = _columns(run, run)
    columns = np.abs(np.concatenate([motion.max(axis=0, initial=0.0), force.max(axis=0, initial=0.0)]))
    instants = np.full(len(run.events), relative * float(run.t[-1]))
    impulses = relative * np.abs(np.array([event.impulse for event in run.events], dtype=np.float64))
    return Distance(
        relative * columns, instants, impulses, relative * np.abs(_summary(run)), np.full(len(columns), np.nan)
    )


def _extrapolated(
    d01: Distance, d12: Distance, d02: Distance, *, greatest_order: float = 4.0, scatter: float = 1.5
) -> Distance:
    """Return the error of the run at dt from the distances of the runs at dt, dt/2 and dt/4.

    ``greatest_order``: order of halving above which it says no more.
    ``scatter``: error of a run outside the asymptotic range, in units of the largest distance of three.
    """

    def of(first: Array, second: Array, both: Array) -> tuple[Array, Array]:
        with np.errstate(all="ignore"):
            p = np.log2(first / second)
            factor = 1.0 / (1.0 - 4.0 ** -np.clip(p, LEAST_ORDER, greatest_order))
        largest = np.fmax(np.fmax(first, second), both)
        return np.where(p >= LEAST_ORDER, factor * both, scatter * largest), p

    columns, order = of(d01.columns, d12.columns, d02.columns)
    instants, _ = of(d01.instants, d12.instants, d02.instants)
    impulses, _ = of(d01.impulses, d12.impulses, d02.impulses)
    summary, _ = of(d01.summary, d12.summary, d02.summary)
    return Distance(columns, instants, impulses, summary, order)


def _beyond(d03: Distance, d23: Distance, parts: float) -> Distance:
    """Return the error of the run at dt from the distances of the runs at dt and dt/4 from one at dt/parts."""

    def of(first: Array, rest: Array) -> Array:
        return first + np.nan_to_num(rest) / (0.25 * parts - 1.0)

    return Distance(
        of(d03.columns, d23.columns),
        of(d03.instants, d23.instants),
        of(d03.impulses, d23.impulses),
        of(d03.summary, d23.summary),
        d03.order,
    )


def _columns(run: Trajectory, at: Trajectory) -> tuple[Array, Array]:
    """Return coordinates and velocities, and the forces, of a run at the instants of another one."""
    if run is at:
        return np.hstack([run.q, run.v]), run.forces
    t, t_force = (np.clip(each, run.t[0], run.t[-1]) for each in (at.t, at.t_reaction))
    if run.dense is not None:
        state, forces = run.sample(t), run.sample(t_force)
        push = run.problem.dynamics.push(forces.q, forces.v)
        return np.hstack([state.q, state.v]), np.hstack([forces.reaction, push])
    return _between(t, run.t, np.hstack([run.q, run.v])), _between(t_force, run.t_reaction, run.forces)


def _between(times: Array, t: Array, values: Array) -> Array:
    """Return columns at other instants, linear between their own."""
    return np.array([np.interp(times, t, each) for each in values.T]).reshape(values.shape[1], len(times)).T


def _away(apart: Array, t: Array, windows: Sequence[tuple[float, float]]) -> Array:
    """Return the largest of each column at the instants in no window, or at all if each lies in one."""
    change = np.zeros(len(t) + 1)
    for begin, end in windows:
        change[np.searchsorted(t, begin, side="left")] += 1.0
        change[np.searchsorted(t, end, side="right")] -= 1.0
    away: Flags = np.cumsum(change)[:-1] == 0.0
    return np.asarray((apart[away] if away.any() else apart).max(axis=0, initial=0.0))


def _summary(run: Trajectory) -> Array:
    if run.problem.sparse:
        return np.full(len(SUMMARY), np.nan)
    return np.array([*run.summary().values()], dtype=np.float64)


def _paired(a: Sequence[Event], b: Sequence[Event]) -> dict[int, int]:
    """Return of each event of a run the index of that of another, where each is the other's nearest of contact and kind."""
    if a is b:
        return {k: k for k in range(len(a))}
    mine, theirs = _by_kind(a), _by_kind(b)
    found: dict[int, int] = {}
    for key in mine.keys() & theirs.keys():
        s, t = (np.array([events[k].t for k in own]) for events, own in ((a, mine[key]), (b, theirs[key])))
        there, back = _nearest(s, t), _nearest(t, s)
        found |= {mine[key][i]: theirs[key][j] for i, j in enumerate(there) if back[j] == i}
    return found


def _by_kind(events: Sequence[Event]) -> dict[tuple[str, str], list[int]]:
    """Return the indices of the events of each row and kind, in order of time."""
    found: dict[tuple[str, str], list[int]] = {}
    for k, event in enumerate(events):
        found.setdefault((event.contact, event.kind), []).append(k)
    return found


def _nearest(s: Array, t: Array) -> Indices:
    """Return the index of the instant of t nearest to each of s, both in order."""
    after = np.clip(np.searchsorted(t, s), 0, len(t) - 1)
    before = np.maximum(after - 1, 0)
    return np.where(s - t[before] <= np.abs(t[after] - s), before, after)


def _error(
    how: str, run: Trajectory, better: Trajectory, distance: Distance, reason: str = "", *, phase: float = 2.0
) -> RunError:
    """Return the error of a run by its distance from the truth; without a reason, that of halving with its order.

    ``phase``: factor by which errors across impacts exceed their mean, by where in their steps these fall.
    """
    largest = np.concatenate([np.abs(each).max(axis=0, initial=0.0) for each in _columns(run, run)])
    off = distance.columns.copy()
    if how == "halving":
        off[: len(run.nodes)] = np.fmax(off[: len(run.nodes)], _penetrations(run))
    with np.errstate(all="ignore"):
        motion, force = _columns(better, run)
        ranges = [np.ptp(each, axis=0) if len(each) else np.full(each.shape[1], np.nan) for each in (motion, force)]

    def named(values: Array) -> dict[str, float]:
        return dict(zip(run.names, map(float, values), strict=True))

    events = tuple(
        EventError(event.t, event.contact, event.kind, float(instant), float(impulse))
        for event, instant, impulse in zip(run.events, distance.instants, distance.impulses, strict=True)
    )
    summary = dict(zip(SUMMARY, map(float, distance.summary), strict=True))
    error = RunError(how, reason, named(off), named(np.concatenate(ranges)), run.nodes, events, summary)
    worst, relative = error.worst
    column = run.nodes.index(worst) if worst else 0
    p = float(distance.order[column])
    converges = p >= LEAST_ORDER
    if not reason:
        steps, finest = len(run.t) - 1, len(better.t) - 1
        runs = "dt/2 and dt/4" if finest == 4 * steps else f"dt/2, dt/4 and dt/{finest / steps:.1f}"
        if not worst or off[column] <= AGREEMENT_RTOL * largest[column]:
            reason = f"{runs} agree to rounding"
        elif converges:
            reason = f"{runs}, order {p:.1f}"
        else:
            reason = f"{runs}, not in the asymptotic range"
    dt = math.nan
    if COARSE < relative < math.inf and run.integrator is not None and run.integrator.rtol is None:
        order = min(p, 2.0) if converges and not run.events else 1.0
        # An error near the range of the motion is bounded by it, and falls more slowly at first.
        parts = math.ceil((phase * (1.0 + min(relative, 1.0)) * relative / COARSE) ** (1.0 / order))
        dt = float(run.t[-1]) / ((len(run.t) - 1) * parts)
    return replace(error, reason=reason, order=p, dt=dt)


def _penetrations(run: Trajectory) -> Array:
    """Return by how much each node is off at least, since contacts that only push are penetrated (n,)."""
    if run.problem.sparse:
        return np.zeros(len(run.nodes))
    d = run.problem.dynamics
    depth = np.maximum(-d.gap(run.t, run.q), 0.0).max(axis=0, initial=0.0) * d.impenetrable
    H = d.along(run.t, run.q, run.v).H
    shares = np.abs(H).sum(axis=1)
    depth = np.divide(depth, shares, out=np.zeros_like(depth), where=shares > 0.0)
    return np.asarray((depth[:, None] * (H != 0.0)).max(axis=0, initial=0.0))
