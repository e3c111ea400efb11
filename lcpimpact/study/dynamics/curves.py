r"""Bifurcations of periodic orbits in the plane of two parameters p and s: curves of folds, flips and grazings.

On the curve the equations of the orbit have one more beside them (`lcpimpact.study.dynamics.arclength`),

.. math:: P(X, T, p, s) - X = 0, \qquad g(X, T, p, s) = 0 .

At a grazing g is the least gap of the contact. At a fold (a multiplier is 1) the derivative A of the orbit's equations by
X, and by T where it is unknown, is singular, at a flip (a multiplier is -1) A = M + I; with a column b and a row c that keep
the larger matrix regular, g is the last unknown of

.. math:: \begin{pmatrix} A & b \\ c & 0 \end{pmatrix} \begin{pmatrix} v \\ g \end{pmatrix} =
          \begin{pmatrix} 0 \\ 1 \end{pmatrix}, \qquad g = -\frac{\det A}{c \operatorname{adj}(A)\, b} .
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import islice

import numpy as np
import pandas as pd

from lcpimpact.arguments import checked
from lcpimpact.arrays import Array
from lcpimpact.errors import FailureError, InputError
from lcpimpact.numbers import between, count, finite
from lcpimpact.problems.base import Problem
from lcpimpact.study.dynamics.arclength import (
    Curve,
    CurvePoint,
    Test,
    flip,
    fold,
    least_gap_of,
    orbit_away,
    points,
    turn,
)
from lcpimpact.study.dynamics.continuation import branch_table
from lcpimpact.study.dynamics.grazing import out_of_reach, touched_stop
from lcpimpact.study.dynamics.shooting import MAX_NEWTON_STEPS, PeriodicOrbit, event_sequence, find_orbit, words
from lcpimpact.study.progress import Progress, watched
from lcpimpact.study.result import Study, table_lines

KINDS = ("fold", "flip", "grazing")
"""The bifurcations of which there are curves."""


@dataclass(frozen=True, eq=False, repr=False)
class BifurcationCurve(Study):
    """A curve of bifurcations of periodic orbits in the plane of two parameters.

    Attributes
    ----------
    kind : str
        "fold", "flip" or "grazing".
    orbits : tuple of PeriodicOrbit
        One orbit per point; at a grazing with the stop out of reach.
    table : DataFrame
        One row per point: both parameters by their names, ``T`` (s), the coordinates (m) and velocities (m/s, ``v_NAME``) at
        t = 0 of the force or at the start of the orbit, number of ``impacts`` per period, ``speed`` (m/s, of the fastest),
        ``gap`` (m, the minimum between contacts, NaN if none), the other multipliers (``real_1``, ``imaginary_1``, ...:
        without the 1 of a fold, the -1 of a flip, the trivial one without a force), ``events``, and ``point``: "cusp" of a
        curve of folds, "fold" or "flip" where another multiplier is 1 or -1, else "".
    ended : str
        Why the curve ends.
    parameters : pair of str
        Names of the parameters.
    derivatives : str
        Of which derivatives the steps were made.
    """

    kind: str
    orbits: tuple[PeriodicOrbit, ...]
    table: pd.DataFrame
    ended: str
    parameters: tuple[str, str]
    derivatives: str

    drawn_by = "lcpimpact.plotting.dynamics:plot_bifurcation_curve"
    title = "Curve of {0.kind}s of {0.orbits[0].problem.name}"

    def summary(self) -> str:
        """Return the points of the curve, the reason for its end, and the derivatives."""
        name = self.orbits[0].problem.name
        p, s = self.parameters
        head = f"{name}: {len(self.orbits)} points of a curve of {self.kind}s in the plane of {p} and {s}"
        rows = table_lines(self.table.drop(columns="events"), ".6g")
        events = f"events of a period: {self.table['events'].iloc[0]}"
        return "\n".join([head, *rows, events, self.ended, f"derivatives: {self.derivatives}"])


@checked
def bifurcation_curve(
    family: Callable[[float, float], Problem],
    first: tuple[float, float],
    second: tuple[float, float],
    kind: str,
    *,
    contact: str | None = None,
    periods: int = 1,
    T: float | None = None,
    transient: int = 0,
    step: float = 0.05,
    max_points: int = 200,
    max_iter: int = MAX_NEWTON_STEPS,
    parameters: tuple[str, str] = ("p", "s"),
    progress: Progress = True,
) -> BifurcationCurve:
    r"""Follow a fold, a flip or a grazing of a periodic orbit in the plane of two parameters, by pseudo-arclength.

    With the second parameter at its first value, the orbit is continued along the first parameter to the nearest bifurcation
    of the kind; from there its curve is followed, also where either parameter turns back. It ends where it leaves the values
    between those given, after ``max_points``, or where the orbit would have other events.

    Parameters
    ----------
    family : callable
        Takes two values and returns a Problem; coordinates and contacts must stay the same.
    first, second : pair of float
        For each parameter the value to begin at, and the one at the other side of the box.
    kind : str
        "fold" (a multiplier is 1), "flip" (a multiplier is -1), or "grazing" (the least gap of a contact is 0, which the
        orbit does not strike otherwise).
    contact : str, optional
        Name of the contact that is grazed; by default the only one.
    periods, T, transient
        As in `periodic_orbit`, for the first values.
    step : float
        First step along the curve and a twentieth of the largest, relative to the box and to the largest states.
    max_points : int
        Maximum number of points.
    max_iter : int
        Maximum number of Newton iterations per orbit.
    parameters : pair of str
        Names of the parameters.
    progress : bool or callable
        As in `lcpimpact.study.progress`.

    Returns
    -------
    BifurcationCurve
        With table, orbits, the reason for its end, and which derivatives are exact.

    Raises
    ------
    InputError
        For a range without width, an unknown kind or contact, equal names, or numbers out of range.
    FailureError
        If there is no bifurcation of the kind on the way along the first parameter.
    LcpImpactError
        As `periodic_orbit` for the first values.

    Examples
    --------
    A linear oscillator touches its stop where its amplitude is the gap:

    >>> from lcpimpact import bifurcation_curve, load_problem
    >>> touch = bifurcation_curve(
    ...     lambda f, omega: load_problem("shaw-holmes", f=f, omega=omega, s=1.0), (0.2, 1.0), (0.7, 0.9), "grazing",
    ...     parameters=("f", "omega"), transient=20, progress=False,
    ... )
    >>> f, omega = touch.table["f"], touch.table["omega"]
    >>> bool(abs(f - ((1.0 - omega**2) ** 2 + (2 * 0.05 * omega) ** 2) ** 0.5).max() < 1e-9)
    True

    References
    ----------
    Govaerts, *Numerical Methods for Bifurcations of Dynamical Equilibria* (2000), on bordered systems; Nordmark (1991).
    """
    for name, pair in zip(("first", "second"), (first, second), strict=True):
        for value in pair:
            finite(name, value)
        if pair[0] == pair[1]:
            raise InputError(f"{name} = {pair!r} has no width: give the value to begin at and the one to set out for")
    if kind not in KINDS:
        raise InputError(f"kind = {kind!r} must be one of {', '.join(map(repr, KINDS))}")
    if contact is not None and kind != "grazing":
        raise InputError(f"contact = {contact!r} is of curves of grazings: leave it out for those of {kind}s")
    if len(set(parameters)) < 2:
        raise InputError(f"parameters = {parameters!r} must be two names that differ")
    between("step", step, 1e-6, 1.0)
    count("max_points", max_points)
    count("max_iter", max_iter, 1)
    corners = np.array([first, second], dtype=np.float64)
    start, towards = corners.T
    sizes = dict(zip(parameters, np.abs(towards - start).tolist(), strict=True))
    problem = family(*start.tolist())
    stop = touched_stop(problem, contact) if kind == "grazing" else -1
    dynamics = out_of_reach(problem.dynamics, stop) if kind == "grazing" else None
    orbit = find_orbit(problem, dynamics, periods, T, transient, max_iter)
    p = parameters[0]
    along = Curve.of(lambda value: family(value, second[0]), orbit, {p: sizes[p]}, stop=stop)
    reached = _first_of(kind, along, first, step, max_iter, parameters)
    here = np.array([along.values(reached.y)[0], start[1]])
    curve = Curve.of(family, orbit_away(reached.orbit), sizes, kind, stop)
    ended: list[str] = []
    on = points(curve, here, corners.T, step, max_iter, _tests(kind), ended)
    found = list(watched(islice(on, max_points), max_points, "points", progress))
    values = np.array([curve.values(point.y) for point, _ in found])
    kept = [k for k, (point, mark) in enumerate(found) if mark != "cusp" or _is_cusp(point)]
    orbits = tuple(found[k][0].orbit for k in kept)
    table = _table(kind, parameters, values[kept], orbits, [found[k][1] for k in kept])
    at = ", ".join(f"{name} = {value:.9g}" for name, value in zip(parameters, values[-1].tolist(), strict=True))
    if ended:
        why = f"the curve ends near {at}: {ended[0]}"
    elif len(found) == max_points:
        why = f"the curve goes on at {at}, after {max_points} points"
    else:
        why = f"the curve leaves the box at {at}"
    return BifurcationCurve(kind, orbits, table, why, parameters, curve.derivatives)


def _first_of(
    kind: str, along: Curve, line: tuple[float, float], step: float, max_iter: int, parameters: tuple[str, str]
) -> CurvePoint:
    """Return the first bifurcation of a kind on the branch along the first parameter."""

    def gap(point: CurvePoint) -> float:
        return least_gap_of(point.at.newton, point.at.period, point.at.T, along.stop)

    test = {"fold": turn, "flip": flip, "grazing": gap}[kind]
    ended: list[str] = []
    p, s = parameters
    begin = value = line[0]
    for point, mark in points(
        along, np.array([begin]), np.array(line)[:, None], step, max_iter, lambda _: {kind: test}, ended
    ):
        if mark:
            return point
        value = float(along.values(point.y)[0])
    why = f", where it ends: {ended[0]}" if ended else ""
    raise FailureError(
        f"the orbit has no {kind} along {p} from {begin:g} to {value:.6g}{why}; give other values of {p}, or begin at "
        f"another value of {s}",
        None,
    )


def _tests(kind: str) -> Callable[[CurvePoint], dict[str, Test]]:
    """Return the tests of points on a curve of a kind at which another bifurcation meets it."""

    def of(here: CurvePoint) -> dict[str, Test]:
        def cusp(point: CurvePoint) -> float:
            return float(point.tangent[-2:] @ here.tangent[-2:])

        return {name: test for name, test in (("cusp", cusp), ("fold", fold), ("flip", flip)) if _meets(kind, name)}

    return of


def _meets(kind: str, name: str) -> bool:
    """Return whether points of a name are looked for on a curve: the test of its own kind is zero all along it."""
    return kind == "fold" if name == "cusp" else name != kind


def _is_cusp(point: CurvePoint, *, cusp_tol: float = 1e-6) -> bool:
    """Return whether the parameters stand still; else the curve has only turned by a right angle between two points.

    ``cusp_tol``: their part of the unit tangent, below which they do.
    """
    return float(np.linalg.norm(point.tangent[-2:])) < cusp_tol


def _table(
    kind: str, parameters: tuple[str, str], values: Array, orbits: tuple[PeriodicOrbit, ...], marks: list[str]
) -> pd.DataFrame:
    """Return the table of a curve."""
    table = branch_table([0.0] * len(orbits), list(orbits), "")
    table = table.drop(columns=["value", "growth", "stable", "failure"])
    for j, name in enumerate(parameters):
        table.insert(j, name, values[:, j])
    others = np.array([_others(kind, orbit) for orbit in orbits])
    for j in range(others.shape[1]):
        table[f"real_{j + 1}"] = others[:, j].real
        table[f"imaginary_{j + 1}"] = others[:, j].imag
    return table.assign(events=[words(event_sequence(orbit)) for orbit in orbits], point=marks)


def _others(kind: str, orbit: PeriodicOrbit) -> Array:
    """Return the multipliers of an orbit without those that it has by its kind, or without a force."""
    found = orbit.floquet
    for known in [*([] if orbit.forced else [1.0]), *{"fold": [1.0], "flip": [-1.0], "grazing": []}[kind]]:
        found = np.delete(found, np.argmin(np.abs(found - known)))
    return found
