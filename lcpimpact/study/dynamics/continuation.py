"""Branches of periodic orbits along a parameter, up to a fold, a flip or a grazing."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from lcpimpact.arguments import checked
from lcpimpact.errors import InputError, LcpImpactError
from lcpimpact.problems.base import Problem
from lcpimpact.study.dynamics.arclength import Curve
from lcpimpact.study.dynamics.grazing import least_gap
from lcpimpact.study.dynamics.shooting import (
    MAX_HALVINGS,
    MAX_NEWTON_STEPS,
    PeriodicOrbit,
    event_sequence,
    find_orbit,
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
        Of which derivatives the steps were made: exact where the family takes formulas, else differences.
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

    The first orbit is that of `periodic_orbit`; each next one is predicted by the tangent of the branch, and found at the
    value by Newton's method. If it is not found, or has other events, the step is halved up to 12 times before the branch
    ends.

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
    size = max(np.ptp(targets), 1e-3 * max(map(abs, targets))) or 1.0
    curve = Curve.of(family, first, {parameter: float(size)})
    orbits, value, ended = [first], targets[0], ""
    at_value = np.eye(len(curve.unknowns(np.zeros(1))))[-1]
    events = event_sequence(first)
    here = curve.solve(curve.unknowns(np.array([value])), at_value, max_iter) if len(targets) > 1 else None
    for target in watched(targets[1:], len(targets) - 1, "orbits", progress):
        while value != target and not ended and here is not None:
            curve, here = curve.with_start_away(here)
            reason, fraction = "", 1.0
            for _ in range(MAX_HALVINGS):
                next_value = target if fraction == 1.0 else value + fraction * (target - value)
                try:
                    ahead = (next_value - value) / size / here.tangent[-1] * here.tangent
                    there = curve.solve(here.y + ahead, at_value, max_iter, here.at)
                except (LcpImpactError, np.linalg.LinAlgError) as error:
                    reason = str(error)
                else:
                    if event_sequence(there.orbit) == events:
                        here, value = there, next_value
                        break
                    reason = (
                        f"it would have the events {words(event_sequence(there.orbit))} in place of {words(events)}"
                    )
                fraction *= 0.5
            else:
                gap, contact, t = least_gap(here.orbit)
                near = f"; there the least gap is {gap:.3g} m, of {contact} at t = {t:.6g} s" if contact else ""
                ended = f"the branch ends near {value:.9g}{near}: {reason}"
        if ended:
            break
        if here is not None:
            orbits.append(here.orbit)
    return Branch(tuple(orbits), branch_table(targets, orbits, ended), ended, parameter, curve.derivatives)


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
