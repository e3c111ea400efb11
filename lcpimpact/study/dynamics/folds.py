r"""Branches of periodic orbits through folds, by pseudo-arclength.

The unknowns are the state X, the period T where no force gives it, and the parameter p, all in units of their sizes. With
the tangent t of the branch, the next orbit solves

.. math:: P(X, T, p) - X = 0, \qquad t \cdot (y - y_0) = ds, \qquad y = (X, T, p),

by Newton's method. The derivatives of the period map are those of the exact motion, by X (`lcpimpact.hybrid.tangent`) and by
p (`lcpimpact.hybrid.variation`). At a fold the branch turns back, dp/ds = 0, and a multiplier is 1; at a flip one is -1.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from itertools import islice
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq

from lcpimpact.arguments import checked
from lcpimpact.arrays import Array
from lcpimpact.errors import FailureError, InputError, LcpImpactError
from lcpimpact.hybrid.motion import ExactSolution, state_before
from lcpimpact.hybrid.system import System
from lcpimpact.hybrid.tangent import place_derivative
from lcpimpact.hybrid.variation import Variation, family_of, slope_weights
from lcpimpact.numbers import between, count, finite
from lcpimpact.numerics.double_double import DoubleDouble
from lcpimpact.problems.base import Problem
from lcpimpact.study.dynamics.continuation import Branch, branch_table, event_sequence
from lcpimpact.study.dynamics.shooting import (
    MAX_HALVINGS,
    MAX_NEWTON_STEPS,
    Guess,
    Newton,
    Period,
    PeriodicOrbit,
    find_orbit,
    force_period,
)
from lcpimpact.study.progress import Progress, watched


class _Point(NamedTuple):
    """An orbit of the branch: the unknowns y, the tangent there, and the steps of Newton's method that found it."""

    y: Array
    tangent: Array
    orbit: PeriodicOrbit
    steps: int

    def flip(self) -> float:
        """Return det(M + I), which passes zero where a multiplier passes -1."""
        M = self.orbit.monodromy
        return float(np.linalg.det(M + np.eye(len(M))))


class _Map(NamedTuple):
    """The period map at y: the scaled miss (k,), its derivative (k, k + 1) by y, the motion and what it is of."""

    miss: Array
    derivative: Array
    period: Period
    newton: Newton
    T: float


@dataclass(frozen=True, eq=False)
class _Curve:
    """The equations of the branch; ``differenced`` says of each derivative by p whether it is by differences."""

    family: Callable[[float], Problem]
    first: PeriodicOrbit
    size: float
    X: Array
    free: Array
    unit: Array
    differenced: list[bool] = field(default_factory=list)

    @property
    def start(self) -> Array:
        """The unknowns of the first orbit, without the parameter."""
        T = [] if self.first.forced else [1.0]
        return np.concatenate([self.X[self.free] / self.unit, T])

    def at(self, y: Array, by_p: Array | None = None) -> _Map:
        """Follow the motion over one period, with its derivatives; that by p may be given from a point nearby."""
        first, k = self.first, len(self.free)
        value = float(y[-1]) * self.size
        problem = self.family(value)
        T = first.T * float(y[k]) if not first.forced else self._forced_period(problem)
        if not T > 0.0:
            raise FailureError(f"{problem.name}: the period would be {T:g} s", None)
        system = System(problem.dynamics, T)
        if len(system.O.T) != len(self.X):
            raise InputError(f"the problem at {value:g} has other states than the one before: change constants only")
        # In the first period, where the phase of the force varies least with its frequency.
        start = first.start % first.T * (T / first.T) if first.forced else first.start
        X = self.X.copy()
        X[self.free] = y[:k] * self.unit
        newton = Newton(problem, system, Guess(X, start, T, first.forced, first.motion.scale))
        here = newton.period(X, T)
        if by_p is None:
            by_p = self._by_parameter(newton, here, value, T)[self.free] * self.size / self.unit
        by_X = here.M[np.ix_(self.free, self.free)] * self.unit / self.unit[:, None] - np.eye(k)
        miss = here.miss[self.free] / self.unit
        if first.forced:
            return _Map(miss, np.column_stack([by_X, by_p]), here, newton, T)
        by_T = here.velocity[self.free] / self.unit * first.T
        # Of all states along an orbit, the one nearest to the first orbit's.
        flow = first.motion.system.mode(first.motion.segments[0].mode)[0]
        along = (flow.A @ self.X)[self.free] / self.unit * first.T
        phase = np.concatenate([along, [0.0, 0.0]])
        derivative = np.vstack([np.column_stack([by_X, by_T, by_p]), phase])
        return _Map(np.append(miss, along @ (y[:k] - self.start[:k])), derivative, here, newton, T)

    def _forced_period(self, problem: Problem) -> float:
        """Return the period of an orbit that a force drives: as many of its periods as in the first orbit."""
        force, whole = (force_period(each.dynamics, tables=True) for each in (problem, self.first.problem))
        if force is None or whole is None:
            raise InputError("the problem has no force with a period, as the first one of the branch has")
        return force * round(self.first.T / whole)

    def _by_parameter(
        self, newton: Newton, here: Period, value: float, T: float, *, period_step: float = 1e-3
    ) -> Array:
        """Return the derivative (N,) of the period map by p.

        ``period_step``: step of the differences of the period of the force, relative to the size of p.
        """
        system, start = newton.system, newton.start
        family = family_of(
            system, newton.problem, lambda given: self.family(given["p"]), {"p": value}, {"p": self.size}
        )
        self.differenced.append(bool(family.differenced))
        form, last = system.form, here.motion.segments[-1]
        X_p = np.zeros((len(here.X), 1))
        X_p[form.constant : len(form.A)] = family.derivative(lambda each: each.system.form.signals_finely(start)).T
        variation = Variation(ExactSolution.of(here.motion), family, states=[DoubleDouble.of(X_p.T)])
        until = start + T - last.t0
        found = variation.at(len(here.motion.segments) - 1, np.array([until]))[1][0, :, 0]
        settle = family.derivative(lambda each: place_derivative(each.system, last.mode))[0]
        found = place_derivative(system, last.mode).hi @ found + settle @ state_before(here.motion, start + T)
        if not self.first.forced:
            return np.asarray(found)
        # The start and the end move with the period of the force.
        offsets = np.array([-2.0, -1.0, 1.0, 2.0])
        T_p = (
            slope_weights(offsets)
            @ [self._forced_period(self.family(value + h * period_step * self.size)) - T for h in offsets.tolist()]
            / (period_step * self.size)
        )
        start_p = T_p * start / T
        rate = np.zeros(len(found))
        rate[self.free] = (system.mode(here.motion.segments[0].mode)[0].A @ here.X)[self.free]
        return np.asarray(found + here.velocity * (start_p + T_p) - here.M @ rate * start_p)

    def solve(self, guess: Array, tangent: Array, max_iter: int, *, closure_rtol: float = 1e-11) -> _Point:
        """Return the orbit in the plane through ``guess`` across the tangent.

        ``closure_rtol``: residual of a closed orbit, relative to the largest value of each state.

        Raises
        ------
        FailureError
            If Newton's method does not converge.
        """
        y = guess
        here = self.at(y)
        for steps in range(max_iter + 1):
            if float(np.abs(here.miss).max(initial=0.0)) <= closure_rtol:
                here = self.at(y) if steps else here
                along = np.linalg.solve(np.vstack([here.derivative, tangent]), np.eye(len(y))[-1])
                return _Point(y, along / np.linalg.norm(along), self._orbit(here, steps), steps)
            step = np.linalg.solve(np.vstack([here.derivative, tangent]), np.append(here.miss, tangent @ (y - guess)))
            y = y - step
            here = self.at(y, here.derivative[: len(self.free), -1])
        raise FailureError(f"{here.newton.problem.name}: no next orbit after {max_iter} steps of Newton's method", None)

    def _orbit(self, here: _Map, steps: int) -> PeriodicOrbit:
        newton, monodromy = here.newton, here.period.M[np.ix_(self.free, self.free)]
        residual = newton.residual(here.period)
        return PeriodicOrbit(
            newton.problem, here.T, self.first.forced, newton.start, here.period.motion, monodromy, residual, steps
        )

    def between(self, a: _Point, b: _Point, of: Callable[[_Point], float], max_iter: int) -> _Point:
        """Return the point between two of the branch at which a number passes zero."""
        length = float(a.tangent @ (b.y - a.y))
        known: dict[float, _Point] = {}

        def at(ds: float) -> float:
            known[ds] = self.solve(a.y + ds * a.tangent, a.tangent, max_iter) if ds else a
            return of(known[ds])

        ds = float(brentq(at, 0.0, length, xtol=1e-10, rtol=1e-10))
        at(ds)
        return known[ds]


@checked
def continue_through_folds(
    family: Callable[[float], Problem],
    bracket: tuple[float, float],
    *,
    periods: int = 1,
    T: float | None = None,
    transient: int = 0,
    step: float = 0.05,
    max_orbits: int = 200,
    max_iter: int = MAX_NEWTON_STEPS,
    parameter: str = "value",
    progress: Progress = True,
) -> Branch:
    r"""Continue a periodic orbit, stable or not, through the folds at which its parameter turns back.

    The branch begins at the first value, towards the other one, and ends where it leaves the values between them, after
    ``max_orbits``, at a grazing, or where the orbit would have other events. Folds and flips are located on it.

    Parameters
    ----------
    family : callable
        Takes a value and returns a Problem; coordinates and contacts must stay the same.
    bracket : pair of float
        The value at which the branch begins, and the one towards which it sets out.
    periods, T, transient
        As in `periodic_orbit`, for the first value.
    step : float
        First step along the branch and a twentieth of the largest, relative to the bracket and to the largest states.
    max_orbits : int
        Maximum number of orbits.
    max_iter : int
        Maximum number of Newton iterations per orbit.
    parameter : str
        Name of the parameter.
    progress : bool or callable
        As in `lcpimpact.study.progress`.

    Returns
    -------
    Branch
        Its table has a column ``point``: "fold" or "flip" at those, else "".

    Raises
    ------
    InputError
        For a bracket without width, or numbers out of range.
    LcpImpactError
        As `periodic_orbit` for the first value.

    Examples
    --------
    An oscillator pressed against its stop strikes it once a period while the force is strong enough:

    >>> from lcpimpact import continue_through_folds, load_problem
    >>> branch = continue_through_folds(
    ...     lambda f: load_problem("shaw-holmes", omega=2.6, s=-0.05, f=f), (0.055, 0.03), transient=60, step=0.2,
    ...     max_orbits=6, progress=False,
    ... )
    >>> branch.table[branch.table["point"] == "fold"]["value"].round(9).tolist()
    [0.046434086]

    References
    ----------
    Keller, Numerical solution of bifurcation and nonlinear eigenvalue problems (1977).
    """
    begin, towards = (float(value) for value in bracket)
    for value in (begin, towards):
        finite("bracket", value)
    if begin == towards:
        raise InputError(f"bracket = {bracket!r} has no width: give the first value and one to set out for")
    between("step", step, 1e-6, 1.0)
    count("max_orbits", max_orbits)
    count("max_iter", max_iter, 1)
    first = find_orbit(family(begin), None, periods, T, transient, max_iter)
    X = first.motion.segments[0].X
    newton = Newton(
        first.problem, first.motion.system, Guess(X, first.start, first.T, first.forced, first.motion.scale)
    )
    curve = _Curve(family, first, abs(towards - begin), X, newton.free, newton.unit)
    ended: list[str] = []
    points = _points(curve, begin, towards, step, max_iter, ended)
    found = list(watched(islice(points, max_orbits), max_orbits, "orbits", progress))
    orbits = [point.orbit for point, _ in found]
    values = [float(point.y[-1]) * curve.size for point, _ in found]
    values[0] = begin
    table = branch_table(values, orbits, "")
    table.insert(len(table.columns) - 1, "point", [kind for _, kind in found])
    branch = Branch(tuple(orbits), table, ended[0] if ended else "", parameter)
    how = "matrices are differenced" if any(curve.differenced) else "from the formulas of the scheme"
    return replace(branch, derivatives=f"exact by the state; by the parameter, {how}")


def _points(
    curve: _Curve, begin: float, towards: float, step: float, max_iter: int, ended: list[str], *, few: int = 3
) -> Iterator[tuple[_Point, str]]:
    """Yield the points of the branch, with folds and flips; say in ``ended`` why it ends.

    ``few``: number of Newton steps up to which the next step is longer.
    """
    y = np.append(curve.start, begin / curve.size)
    ahead = np.zeros(len(y))
    ahead[-1] = math.copysign(1.0, towards - begin)
    here = curve.solve(y, ahead, max_iter)
    yield here, ""
    low, high = sorted((begin, towards))
    events, ds = event_sequence(here.orbit), step
    while True:
        reason = ""
        for _ in range(MAX_HALVINGS):
            try:
                there = curve.solve(here.y + ds * here.tangent, here.tangent, max_iter)
                marks = _marks(curve, here, there, max_iter)
            except (LcpImpactError, np.linalg.LinAlgError, RuntimeError) as error:
                reason = str(error)
            else:
                if event_sequence(there.orbit) == events and float(here.tangent @ there.tangent) > 0.5:
                    break
                reason = "the orbit would have other events"
            ds *= 0.5
        else:
            ended.append(f"the branch ends near {float(here.y[-1]) * curve.size:.9g}: {reason}")
            return
        yield from marks
        if not low <= float(there.y[-1]) * curve.size <= high:
            return
        yield there, ""
        ds = min(1.5 * ds, 20.0 * step) if there.steps <= few else 0.7 * ds
        here = there


def _marks(curve: _Curve, here: _Point, there: _Point, max_iter: int) -> list[tuple[_Point, str]]:
    """Return the folds and flips between two points, in their order."""
    found = []
    for kind, of in (("fold", lambda point: float(point.tangent[-1])), ("flip", _Point.flip)):
        if of(here) * of(there) < 0.0:
            found.append((curve.between(here, there, of, max_iter), kind))
    return sorted(found, key=lambda mark: float(here.tangent @ mark[0].y))
