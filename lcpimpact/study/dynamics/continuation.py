"""Branches of periodic orbits along a parameter, up to a fold, a flip or a grazing."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from lcpimpact.arguments import checked
from lcpimpact.arrays import Array
from lcpimpact.errors import InputError, LcpImpactError
from lcpimpact.hybrid.system import System
from lcpimpact.problems.base import Problem
from lcpimpact.study.dynamics.grazing import least_gap
from lcpimpact.study.dynamics.shooting import (
    MAX_HALVINGS,
    MAX_NEWTON_STEPS,
    Guess,
    PeriodicOrbit,
    away_from_events,
    event_sequence,
    find_orbit,
    force_period,
    shoot,
    words,
)
from lcpimpact.study.progress import Progress, watched
from lcpimpact.study.result import Study, table_lines


@dataclass(frozen=True, eq=False, repr=False)
class Branch(Study):
    """A branch of periodic orbits of a family of problems.

    Attributes
    ----------
    orbits : tuple of PeriodicOrbit
        One orbit per value reached.
    table : DataFrame
        One row per value: ``value``, ``T`` (s), the coordinates (m) and velocities (m/s, ``v_NAME``) at t = 0 of the force
        or at the start of the orbit, number of ``impacts`` per period, ``speed`` (m/s, of the fastest), ``gap`` (m, the
        minimum between contacts, NaN if none), ``growth`` (the largest |μ|), ``stable`` and ``failure``.
    ended : str
        Reason why the branch ends before the last value, else "".
    parameter : str
        Name of the parameter in the plot.
    derivatives : str
        Of which derivatives `continue_through_folds` made its steps; "" of a branch of `continue_orbit`.
    """

    orbits: tuple[PeriodicOrbit, ...]
    table: pd.DataFrame
    ended: str
    parameter: str = "value"
    derivatives: str = ""

    drawn_by = "lcpimpact.plotting.dynamics:plot_branch"
    title = "Branch of periodic orbits of {0.orbits[0].problem.name}"

    def summary(self) -> str:
        """Return the last orbit, the orbits along the branch, and the reason for its end."""
        rows = table_lines(self.table.drop(columns="failure"), ".6g")
        return "\n".join([*self.orbits[-1].head(), *rows, *[self.ended] * bool(self.ended)])


@checked
def continue_orbit(
    family: Callable[[float], Problem],
    values: Sequence[float],
    *,
    periods: int = 1,
    T: float | None = None,
    transient: int = 0,
    max_iter: int = MAX_NEWTON_STEPS,
    parameter: str = "value",
    progress: Progress = True,
) -> Branch:
    """Continue a periodic orbit, stable or not, along a parameter up to a grazing or a fold.

    The first orbit is that of `periodic_orbit`; each next one is predicted by the secant of the previous two. If it is not
    found, or has other events, the step is halved up to 12 times before the branch ends.

    Parameters
    ----------
    family : callable
        Takes a value and returns a Problem; coordinates and contacts must stay the same.
    values : sequence of float
        Parameter values in the order of continuation.
    periods, T, transient
        As in `periodic_orbit`, for the first value.
    max_iter : int
        Maximum number of Newton iterations per orbit.
    parameter : str
        Name of the parameter.
    progress : bool or callable
        As in `lcpimpact.study.progress`.

    Returns
    -------
    Branch
        With orbits, table and ended.

    Raises
    ------
    LcpImpactError
        As `periodic_orbit` for the first value.

    Examples
    --------
    >>> from lcpimpact import continue_orbit, load_problem
    >>> branch = continue_orbit(lambda f: load_problem("impact-oscillator", f=f), [1.0, 1.1, 1.2])
    >>> [round(speed, 6) for speed in branch.table["speed"]]
    [0.500672, 0.55074, 0.600807]
    """
    targets = [float(value) for value in values]
    if not targets:
        raise InputError("values is empty: give those that the parameter is to take")
    first = find_orbit(family(targets[0]), None, periods, T, transient, max_iter)
    orbits = [first]
    found = [(targets[0], first)]
    ended = ""
    events = event_sequence(first)
    for target in watched(targets[1:], len(targets) - 1, "orbits", progress):
        while found[-1][0] != target and not ended:
            reason, fraction = "", 1.0
            for _ in range(MAX_HALVINGS):
                here = found[-1][0]
                value = target if fraction == 1.0 else here + fraction * (target - here)
                try:
                    orbit = _next_orbit(family(value), value, found, max_iter)
                except (LcpImpactError, np.linalg.LinAlgError) as error:
                    reason = str(error)
                else:
                    if event_sequence(orbit) == events:
                        found.append((value, orbit))
                        break
                    reason = f"it would have the events {words(event_sequence(orbit))} in place of {words(events)}"
                fraction *= 0.5
            else:
                gap, contact, t = least_gap(found[-1][1])
                near = f"; there the least gap is {gap:.3g} m, of {contact} at t = {t:.6g} s" if contact else ""
                ended = f"the branch ends near {found[-1][0]:.9g}{near}: {reason}"
        if ended:
            break
        orbits.append(found[-1][1])
    return Branch(tuple(orbits), branch_table(targets, orbits, ended), ended, parameter)


def _next_orbit(
    problem: Problem, value: float, found: list[tuple[float, PeriodicOrbit]], max_iter: int
) -> PeriodicOrbit:
    """Find an orbit from one or two previous ones, with the secant as predictor."""
    a, last = found[-1]
    b, other = found[-2] if len(found) > 1 else (a, last)
    slope = (value - a) / (a - b) if a != b else 0.0
    start, _ = away_from_events(last.motion, last.start, last.start + last.T)
    X = _state_at(last, start)
    before = _state_at(other, start * other.T / last.T)
    T = last.T + slope * (last.T - other.T)
    system = System(problem.dynamics, T)
    if len(system.O.T) != len(X):
        raise InputError(f"the problem at {value:g} has other states than the one before: change constants only")
    if last.forced:
        force = force_period(problem.dynamics)
        if force is None:
            raise InputError(f"the problem at {value:g} has no force with a period, as the one before has")
        whole = force_period(last.problem.dynamics) or last.T
        T = force * round(last.T / whole)
    guess = Guess(X + slope * (X - before), start * T / last.T, T, last.forced, last.motion.scale)
    return shoot(problem, system, guess, max_iter)


def _state_at(orbit: PeriodicOrbit, t: float) -> Array:
    """Return X of an orbit at any time (N,)."""
    within = orbit.start + (t - orbit.start) % orbit.T
    segments = orbit.motion.segments
    segment = segments[int(np.searchsorted([each.t0 for each in segments], within, side="right")) - 1]
    flow, _ = orbit.motion.system.mode(segment.mode)
    return flow.move(segment.state, float(segment.since(np.array(within)))).hi


def branch_table(values: list[float], orbits: list[PeriodicOrbit], ended: str) -> pd.DataFrame:
    """Return the table of a branch, whose last row says why it ended before its last value."""
    nodes = orbits[0].problem.dynamics.nodes
    rows: list[dict[str, float | str]] = []
    for value, orbit in zip(values, orbits, strict=False):
        state = orbit.sample(0.0 if orbit.forced else orbit.start)
        gap = least_gap(orbit)[0]
        rows.append(
            {"value": value, "T": orbit.T}
            | dict(zip(nodes, state.q[0].tolist(), strict=True))
            | {f"v_{node}": v for node, v in zip(nodes, state.v[0].tolist(), strict=True)}
            | {"impacts": len(orbit.impacts), "speed": float(orbit.speeds.max(initial=0.0))}
            | {
                "gap": gap if math.isfinite(gap) else math.nan,
                "growth": orbit.growth,
                "stable": orbit.stable,
                "failure": "",
            }
        )
    if ended:
        rows.append({"value": values[len(orbits)], "failure": ended})
    return pd.DataFrame(rows)
