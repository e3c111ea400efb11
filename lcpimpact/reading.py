"""Measurements on a run: events, peaks and crossings; to rounding on an exact run.

What is read is a series by its name, or a function of a `State` of samples (q and v of shape (nt, n), reaction (nt, nc)).
The runs of step methods are read at the order of a good step: parabolas through peaks, lines through crossings.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import islice
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from lcpimpact.arrays import Array
from lcpimpact.errors import InputError
from lcpimpact.record import ContinuousSolution, Event, State
from lcpimpact.registry import nearest
from lcpimpact.scheme.dynamics import Dynamics

Series = str | Callable[[State], Array]


class Moving(Protocol):
    """A problem, of which a run knows the equations of motion."""

    @property
    def dynamics(self) -> Dynamics:
        """The equations of motion."""


class Readable(Protocol):
    """A run as it is read; see `lcpimpact.Trajectory`."""

    @property
    def problem(self) -> Moving:
        """The problem of the run."""

    @property
    def t(self) -> Array:
        """Times of the grid (nt,)."""

    @property
    def q(self) -> Array:
        """Coordinates (nt, n)."""

    @property
    def v(self) -> Array:
        """Velocities (nt, n), right limits."""

    @property
    def t_reaction(self) -> Array:
        """Instants of the forces (nr,)."""

    @property
    def reaction(self) -> Array:
        """Reactions (nr, nc)."""

    @property
    def forces(self) -> Array:
        """Reactions and forces of non-linear springs (nr, nc + ns)."""

    @property
    def names(self) -> Sequence[str]:
        """Names of the series."""

    @property
    def events(self) -> Sequence[Event]:
        """Changes of the contact mode."""

    @property
    def dense(self) -> ContinuousSolution | None:
        """The continuous solution of an exact run."""

    def __getitem__(self, name: str) -> Array:
        """Return a series by its name."""

    def sample(self, t: ArrayLike, side: str = "right") -> State:
        """Return the state at the times t."""


def read(run: Readable, series: Series, t: ArrayLike, side: str = "right") -> Array:
    """Return a series at the times t (nt,); mean forces of steps are interpolated linearly between their instants."""
    state = run.sample(t, side)
    if run.dense is None and 1 < len(run.t_reaction) < len(run.t):
        forces = _on_longer_lines(np.asarray(t, dtype=np.float64), run.t_reaction, run.forces)
        state = replace(state, reaction=forces[:, : run.reaction.shape[1]])
    else:
        forces = np.hstack([state.reaction, run.problem.dynamics.push(state.q, state.v)])
    if callable(series):
        return series(state)
    if series not in run.names:
        raise InputError(nearest(series, list(run.names), "series"))
    columns = np.hstack([state.q, state.v, forces])
    return columns[:, run.names.index(series)]


def at(run: Readable, series: Series, t: float, side: str = "right") -> float:
    """Return a series at one time.

    Raises
    ------
    InputError
        If the run does not last until then.
    """
    end = float(run.t[-1])
    # The end of a run is a number of steps times dt, with its rounding error.
    return float(read(run, series, [end if end < t < end * (1.0 + 1e-12) else t], side)[0])


def event(run: Readable, kind: str, number: int = 1, contact: str | None = None) -> Event:
    """Return the event of a kind with a number, counted from 1, or from the end if negative.

    Raises
    ------
    InputError
        If the run has fewer.
    """
    alike = (each for each in run.events if each.kind == kind and contact in (None, each.contact))
    found = list(islice(alike, number if number > 0 else None))  # later ones may be unknown; see `KnownUntil`
    if not 1 <= abs(number) <= len(found):
        of = f" of {contact}" if contact else ""
        raise InputError(f"the run has {len(found)} events {kind!r}{of}, but number {number} is required: run longer")
    return found[number - 1 if number > 0 else number]


def instant(run: Readable, kind: str, number: int = 1, contact: str | None = None) -> float:
    """Return the instant of an event in s.

    Parameters
    ----------
    run : Trajectory
        A run.
    kind : str
        Kind of the event, as "impact", "close" or "open".
    number : int
        Which event of the kind, counted from 1, or from the end if negative.
    contact : str, optional
        The contact; by default the events of all are counted.

    Raises
    ------
    InputError
        If the run has fewer.

    Examples
    --------
    >>> from lcpimpact import load_problem, simulate
    >>> run = simulate(load_problem("bouncing-ball"), "exact", dt=1e-2, t_end=1.0)
    >>> round(instant(run, "impact"), 6)
    0.451524
    """
    return float(event(run, kind, number, contact).t)


def interval(run: Readable, kind: str, first: int, last: int) -> float:
    """Return the time between two events of a kind, by their numbers."""
    return instant(run, kind, last) - instant(run, kind, first)


def limit(
    run: Readable,
    kind: str,
    number: int = 1,
    contact: str | None = None,
    *,
    of: str,
    i: int,
    side: str,
    unit: float = 1.0,
) -> float:
    """Return q_i or v_i before ("left") or after ("right") an event, in a unit; see `event`."""
    return float(getattr(getattr(event(run, kind, number, contact), side), of)[i]) / unit


def final(run: Readable, series: str, unit: float = 1.0) -> float:
    """Return the last value of a series, in a unit.

    Parameters
    ----------
    run : Trajectory
        A run.
    series : str
        Name of a coordinate, a velocity as ``v_x``, or a reaction.
    unit : float
        The unit in SI units, as 1e-3 for mm.

    Examples
    --------
    >>> from lcpimpact import load_problem, simulate
    >>> run = simulate(load_problem("bouncing-ball"), "exact", dt=1e-2, t_end=0.2)
    >>> round(final(run, "x", 1e-3), 3)
    196.2
    """
    return float(run[series][-1]) / unit


def peak(run: Readable, series: Series, sign: float = 1.0, until: float = math.inf) -> float:
    """Return the maximum of a series, or the minimum with ``sign=-1``, also between the grid points, up to a time.

    Parameters
    ----------
    run : Trajectory
        A run.
    series : str or callable
        Name of a series, or a function of a `State` of samples.
    sign : float
        1 or -1.
    until : float
        Time in s.

    Examples
    --------
    >>> from lcpimpact import load_problem, simulate
    >>> run = simulate(load_problem("system-1"), "exact", dt=1e-2, t_end=1.0)
    >>> round(peak(run, "R"))
    5818
    """
    if run.dense is not None:
        return highest(run, series, sign, until)[1]
    forces = run.names[2 * run.q.shape[1] :]
    times = np.append(0.0, run.t_reaction) if series in forces and run.t_reaction[0] > 0.0 else run.t
    times = times[times <= until]
    return sign * _top(times, sign * read(run, series, times))


def highest(run: Readable, series: Series, sign: float = 1.0, until: float = math.inf) -> tuple[float, float]:
    """Return the instant and value of the maximum of a series of a run with a continuous solution; see `peak`."""
    knots = _knots(run)
    knots = np.append(knots[knots < until], min(until, knots[-1]))
    value, t = _exact_peak(lambda t, side: sign * read(run, series, t, side), np.unique(knots))
    return t, sign * value


def crossing(run: Readable, series: Series, level: float = 0.0, direction: float = 1.0, number: int = 1) -> float:
    """Return the time of the n-th crossing of a level after the start, upwards, or downwards with ``direction=-1``.

    Parameters
    ----------
    run : Trajectory
        A run.
    series : str or callable
        Name of a series, or a function of a `State` of samples.
    level : float
        The level, in the unit of the series.
    direction : float
        1 or -1.
    number : int
        n, counted from 1.

    Raises
    ------
    InputError
        If the run has fewer crossings.

    Examples
    --------
    >>> from lcpimpact import load_problem, simulate
    >>> run = simulate(load_problem("bouncing-ball"), "exact", dt=1e-2, t_end=0.4)
    >>> round(crossing(run, "x", 0.5 * 9.81 * 0.3**2), 12)
    0.3
    """

    def above(t: ArrayLike) -> Array:
        return direction * (read(run, series, t) - level)

    knots = run.t if run.dense is None else _knots(run)
    values = above(knots)
    found = np.flatnonzero((values[:-1] < 0.0) & (values[1:] >= 0.0))
    if len(found) < number:
        raise InputError(f"the run crosses {level:g} {len(found)} times, but crossing {number} is required: run longer")
    j = int(found[number - 1])
    a, b = float(knots[j]), float(knots[j + 1])
    if run.dense is not None:
        # A crossing at a knot may be on either side of it by rounding; then the knot is returned.
        if above([a])[0] >= 0.0 or above([b])[0] < 0.0:
            return a if above([a])[0] >= 0.0 else b
        from scipy.optimize import brentq  # here, as most runs do without it

        return float(brentq(lambda t: above([t])[0], a, b, xtol=1e-15 * b, rtol=4.0 * np.finfo(float).eps))
    return a + (b - a) * float(values[j] / (values[j] - values[j + 1]))


def _knots(run: Readable) -> Array:
    """Return the times between which an exact run is smooth, with few extrema."""
    cuts = np.zeros(0) if run.dense is None else run.dense.cuts
    knots = np.unique(np.concatenate([run.t, cuts, [each.t for each in run.events]]))
    return np.asarray(knots[knots <= run.t[-1]])


def _exact_peak(
    value: Callable[[ArrayLike, str], Array], knots: Array, *, knot_margin: float = 0.125, max_peaks: int = 16
) -> tuple[float, float]:
    """Return the supremum of a series that is smooth between knots, and its instant.

    ``knot_margin``: largest distance of a knot below the peak beside it, relative to the range of the series.
    ``max_peaks``: maximum number of local maxima that are searched.
    """
    highest = np.maximum(value(knots, "left"), value(knots, "right"))
    beside = np.concatenate([[-np.inf], highest, [-np.inf]])
    best = float(highest.max())
    enough = best - knot_margin * (best - float(highest.min()))
    tops = np.flatnonzero((highest >= beside[:-2]) & (highest >= beside[2:]) & (highest >= enough))
    tops = tops[np.argsort(-highest[tops], kind="stable")][:max_peaks]
    found = [(best, float(knots[np.argmax(highest)])), *(_peak_beside(value, knots, int(j)) for j in tops)]
    return max(found, key=lambda each: each[0])


def _peak_beside(value: Callable[[ArrayLike, str], Array], knots: Array, j: int) -> tuple[float, float]:
    """Return the supremum of a series between knot j and its neighbours, and its instant."""
    from scipy.optimize import minimize_scalar  # here, as most runs do without it

    # Two knots may differ by rounding only; then the next one bounds the search.
    apart = np.abs(knots - knots[j]) > 1e-9 * (knots[-1] - knots[0])
    ends = [*knots[apart & (knots < knots[j])][-1:], *knots[apart & (knots > knots[j])][:1]]
    heights = [(-math.inf, float(knots[j]))]
    for end in ends:
        a, b = sorted((float(knots[j]), float(end)))
        found = minimize_scalar(
            lambda t: -value([t], "right")[0], bounds=(a, b), method="bounded", options={"xatol": 1e-9 * (b - a)}
        )
        heights.append((-float(found.fun), float(found.x)))
    return max(heights)


def _top(t: Array, values: Array) -> float:
    """Return the greatest value, on the parabola through it and its neighbours where it lies between them."""
    j = int(np.argmax(values))
    if not 0 < j < len(t) - 1:
        return float(values[j])
    a, b, c = np.polynomial.polynomial.polyfit(t[j - 1 : j + 2] - t[j], values[j - 1 : j + 2] - values[j], 2)
    return float(values[j] + a - b**2 / (4.0 * c)) if c < 0.0 else float(values[j])


def _on_longer_lines(t: Array, nodes: Array, values: Array) -> Array:
    """Return values (nt, nc) at t by linear interpolation between nodes, and extrapolation outside."""
    j = np.clip(np.searchsorted(nodes, t, side="right") - 1, 0, len(nodes) - 2)
    weight = ((t - nodes[j]) / (nodes[j + 1] - nodes[j]))[:, None]
    return np.asarray((1.0 - weight) * values[j] + weight * values[j + 1])


def first_root(u: Callable[[Array], Array], until: float, period: float) -> float | None:
    """Return the first t at which a gap in closed form falls through zero, or None if it does not before ``until``.

    The gap is looked at 400 times in the period of its fastest part. From zero it may fall at once, at t = 0.
    """
    t = np.linspace(0.0, until, max(2, math.ceil(400.0 * until / period)) + 1)[1:]
    below = np.flatnonzero(u(t) < 0.0)
    if len(below) == 0:
        return None
    j = int(below[0])
    start = t[j - 1] if j else 1e-9 * t[0]
    if u(np.array(start)) <= 0.0:
        return 0.0
    from scipy.optimize import brentq  # here, as most runs do without it

    return float(brentq(lambda s: float(u(np.array(s))), start, t[j], xtol=1e-16, rtol=4.0 * np.finfo(float).eps))
