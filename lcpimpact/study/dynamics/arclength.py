r"""Curves of periodic orbits, by pseudo-arclength.

The unknowns are the state X, the period T where no force gives it, and one or two parameters, all in units of their sizes.
With the tangent t of the curve, the next orbit solves

.. math:: P(X, T, p) - X = 0, \qquad g(X, T, p) = 0, \qquad t \cdot (y - y_0) = ds, \qquad y = (X, T, p),

by Newton's method; g is there with two parameters. The derivatives of the period map are those of the exact motion, by X
(`lcpimpact.hybrid.tangent`) and by p (`lcpimpact.hybrid.variation`); those of g are differences.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq

from lcpimpact.arrays import Array, Indices
from lcpimpact.errors import FailureError, InputError, LcpImpactError
from lcpimpact.hybrid.motion import ExactSolution, state_before
from lcpimpact.hybrid.system import System
from lcpimpact.hybrid.tangent import place_derivative
from lcpimpact.hybrid.variation import Variation, family_of, slope_weights
from lcpimpact.numerics.double_double import DoubleDouble
from lcpimpact.problems.base import Problem
from lcpimpact.study.dynamics.grazing import least, out_of_reach
from lcpimpact.study.dynamics.shooting import (
    MAX_HALVINGS,
    Guess,
    Newton,
    Period,
    PeriodicOrbit,
    away_from_events,
    event_sequence,
    exact,
    force_period,
    nearest_solution,
    words,
)


class Map(NamedTuple):
    """The equations of a curve at y.

    Attributes
    ----------
    miss : (n,) array               what they miss, scaled
    derivative : (n, n + 1) array   their derivative by y; the row of g, where there is one, is the last
    borders : (2, m) array          a column and a row that make the matrix regular whose determinant g replaces
    period, newton : the motion over one period, and what it is of
    T : float                       the period in s
    """

    miss: Array
    derivative: Array
    borders: Array
    period: Period
    newton: Newton
    T: float


class CurvePoint(NamedTuple):
    """An orbit of a curve.

    Attributes
    ----------
    y, tangent : (n + 1,) arrays    the unknowns, and the unit tangent there
    at : Map                        the equations there
    orbit : PeriodicOrbit
    steps : int                     the steps of Newton's method that found it
    """

    y: Array
    tangent: Array
    at: Map
    orbit: PeriodicOrbit
    steps: int


Test = Callable[[CurvePoint], float]
"""A number that passes zero at the points that are looked for on a curve."""


@dataclass(frozen=True, eq=False)
class Curve:
    """The equations of a curve of orbits.

    Attributes
    ----------
    family : callable           makes the problem from the values of the parameters
    first : PeriodicOrbit       an orbit on the curve, or near it
    sizes : dict                size of each parameter, by name
    free : (k,) array           the states that are not signals
    unit : (k,) array           their sizes
    kind : str                  which g there is: "fold", "flip" or "grazing"; "" for none
    stop : int                  row of the contact that is out of reach, for a grazing; -1 for none
    differenced : set of str    the names of parameters by which matrices were differenced
    """

    family: Callable[..., Problem]
    first: PeriodicOrbit
    sizes: Mapping[str, float]
    free: Indices
    unit: Array
    kind: str = ""
    stop: int = -1
    differenced: set[str] = field(default_factory=set)

    @classmethod
    def of(
        cls,
        family: Callable[..., Problem],
        orbit: PeriodicOrbit,
        sizes: Mapping[str, float],
        kind: str = "",
        stop: int = -1,
    ) -> Curve:
        """Return the curve through an orbit, or near it; its periods begin where that of the orbit does."""
        newton = Newton.of(orbit)
        return cls(family, orbit, sizes, newton.free, newton.unit, kind, stop)

    @property
    def derivatives(self) -> str:
        """Which derivatives the steps were made of, in words."""
        traced = [name for name in self.sizes if name not in self.differenced]
        by = [f"by {' and '.join(traced)}, from the formulas of the scheme"] * bool(traced)
        by += [f"by {' and '.join(sorted(self.differenced))}, matrices are differenced"] * bool(self.differenced)
        said = "; ".join(["exact by the state", *by])
        return f"{said}; those of the condition of the {self.kind} are differences" if self.kind else said

    @property
    def size(self) -> Array:
        """The sizes of the parameters."""
        return np.array(list(self.sizes.values()))

    @property
    def X(self) -> Array:
        """The state with which the first orbit begins."""
        return exact(self.first.motion).segments[0].X

    def unknowns(self, values: Array) -> Array:
        """Return y of the first orbit, with the values of the parameters."""
        T = [] if self.first.forced else [1.0]
        return np.concatenate([self.X[self.free] / self.unit, T, values / self.size])

    def values(self, y: Array) -> Array:
        """Return the values of the parameters at y."""
        return np.asarray(y[-len(self.sizes) :] * self.size)

    def at(self, y: Array, near: Map | None = None) -> Map:
        """Return the equations at y, with the columns of the parameters and the row of g of a point nearby, if given."""
        m = len(self.sizes)
        if near is None:
            return self.exact(self._period_at(y, np.zeros((len(self.free), m))), y)
        here = self._period_at(y, near.derivative[: len(self.free), -m:])
        if not self.kind:
            return here
        miss = np.append(here.miss, self._condition(here, near.borders))
        return here._replace(
            miss=miss, derivative=np.vstack([here.derivative, near.derivative[-1]]), borders=near.borders
        )

    def exact(self, here: Map, y: Array, *, step: float = 1e-5) -> Map:
        """Return the equations at y with the columns of the parameters and the row of g that belong there.

        ``step``: that of the differences of g.
        """
        k, m = len(self.free), len(self.sizes)
        n = len(y) - m
        by_p = self._by_parameters(here.newton, here.period, self.values(y).tolist(), here.T)[self.free]
        derivative = here.derivative[:n].copy()
        derivative[:k, -m:] = by_p * self.size / self.unit[:, None]
        here = here._replace(miss=here.miss[:n], derivative=derivative)
        if not self.kind:
            return here
        borders = self._borders(here)
        row = np.zeros(len(y))
        for j, d in enumerate(step * np.eye(len(y))):
            above, below = (self._condition(self._period_at(z, derivative[:k, -m:]), borders) for z in (y + d, y - d))
            row[j] = (above - below) / (2.0 * step)
        miss = np.append(here.miss, self._condition(here, borders))
        return here._replace(miss=miss, derivative=np.vstack([derivative, row]), borders=borders)

    def _singular(self, here: Map) -> Array:
        """Return the matrix that is singular at a fold, or at a flip."""
        if self.kind == "flip":
            k = len(self.free)
            return here.derivative[:k, :k] + 2.0 * np.eye(k)
        return orbit_matrix(here)

    def _borders(self, here: Map) -> Array:
        if self.kind == "grazing":
            return np.zeros((2, 0))
        left, _, right = np.linalg.svd(self._singular(here))
        return np.array([left[:, -1], right[-1]])

    def _condition(self, here: Map, borders: Array) -> float:
        """Return g: a gap in its unit, or the last unknown of the bordered system, zero where the matrix is singular."""
        if self.kind == "grazing":
            reach = np.abs(here.newton.system.derivatives[0, self.stop])[self.free] @ self.unit
            return least_gap_of(here.newton, here.period, here.T, self.stop) / float(reach)
        column, row = borders
        bordered = np.block([[self._singular(here), column[:, None]], [row, np.zeros(1)]])
        return float(np.linalg.solve(bordered, np.eye(len(bordered))[-1])[-1])

    def _period_at(self, y: Array, by_p: Array) -> Map:
        """Follow the motion over one period, with its derivative by the state; those by the parameters are given."""
        first, k = self.first, len(self.free)
        values = self.values(y).tolist()
        problem = self.family(*values)
        dynamics = problem.dynamics if self.stop < 0 else out_of_reach(problem.dynamics, self.stop)
        T = first.T * float(y[k]) if not first.forced else self.forced_period(problem)
        if not T > 0.0:
            raise FailureError(f"{problem.name}: the period would be {T:g} s", None)
        system = System(dynamics, T)
        if len(system.O.T) != len(self.X):
            at = ", ".join(f"{value:g}" for value in values)
            raise InputError(f"the problem at {at} has other states than the one before: change constants only")
        # In the first period, where the phase of the force varies least with its frequency.
        start = first.start % first.T * (T / first.T) if first.forced else first.start
        X = self.X.copy()
        X[self.free] = y[:k] * self.unit
        newton = Newton(problem, system, Guess(X, start, T, first.forced, first.motion.scale))
        here = newton.period(X, T)
        by_X = here.M[np.ix_(self.free, self.free)] * self.unit / self.unit[:, None] - np.eye(k)
        miss = here.miss[self.free] / self.unit
        no = np.zeros((2, 0))
        if first.forced:
            return Map(miss, np.column_stack([by_X, by_p]), no, here, newton, T)
        by_T = here.velocity[self.free] / self.unit * first.T
        # Of all states along an orbit, the one nearest to the first orbit's.
        flow = exact(first.motion).system.mode(exact(first.motion).segments[0].mode)[0]
        along = (flow.A @ self.X)[self.free] / self.unit * first.T
        derivative = np.vstack(
            [np.column_stack([by_X, by_T, by_p]), np.concatenate([along, np.zeros(1 + len(values))])]
        )
        phase = along @ (y[:k] - self.X[self.free] / self.unit)
        return Map(np.append(miss, phase), derivative, no, here, newton, T)

    def forced_period(self, problem: Problem) -> float:
        """Return the period of an orbit that a force drives: as many of its periods as in the first orbit."""
        force, whole = (force_period(each.dynamics, tables=True) for each in (problem, self.first.problem))
        if force is None or whole is None:
            raise InputError("the problem has no force with a period, as the first one of the branch has")
        return force * round(self.first.T / whole)

    def _by_parameters(
        self, newton: Newton, here: Period, values: list[float], T: float, *, period_step: float = 1e-3
    ) -> Array:
        """Return the derivative (N, m) of the period map by the parameters.

        ``period_step``: step of the differences of the period of the force, relative to the size of a parameter.
        """
        system, start = newton.system, newton.start
        given = dict(zip(self.sizes, values, strict=True))
        family = family_of(system, newton.problem, lambda each: self.family(*each.values()), given, self.sizes)
        self.differenced.update(family.differenced)
        form, last = system.form, exact(here.motion).segments[-1]
        X_p = np.zeros((len(here.X), len(values)))
        X_p[form.constant : len(form.A)] = family.derivative(lambda each: each.system.form.signals_finely(start)).T
        variation = Variation(ExactSolution.of(exact(here.motion)), family, states=[DoubleDouble.of(X_p.T)])
        until = start + T - last.t0
        found = variation.at(len(exact(here.motion).segments) - 1, np.array([until]))[1][0]
        settle = family.derivative(lambda each: place_derivative(each.system, last.mode))
        found = (
            place_derivative(system, last.mode).hi @ found + (settle @ state_before(exact(here.motion), start + T)).T
        )
        if not self.first.forced:
            return np.asarray(found)
        # The start and the end move with the period of the force.
        offsets = np.array([-2.0, -1.0, 1.0, 2.0])
        T_p = np.zeros(len(values))
        for j, step in enumerate((period_step * self.size).tolist()):
            beside = [
                self.family(*(value + h * step * (i == j) for i, value in enumerate(values))) for h in offsets.tolist()
            ]
            T_p[j] = slope_weights(offsets) @ [self.forced_period(problem) - T for problem in beside] / step
        start_p = T_p * start / T
        rate = np.zeros(len(found))
        rate[self.free] = (system.mode(exact(here.motion).segments[0].mode)[0].A @ here.X)[self.free]
        return np.asarray(found + np.outer(here.velocity, start_p + T_p) - np.outer(here.M @ rate, start_p))

    def solve(
        self, guess: Array, tangent: Array, max_iter: int, near: Map | None = None, *, closure_rtol: float = 1e-11
    ) -> CurvePoint:
        """Return the orbit in the plane through ``guess`` across the tangent.

        The steps take the columns of the parameters and the row of g from ``near``, by default from the guess.

        ``closure_rtol``: residual of the equations, relative to the largest value of each state.

        Raises
        ------
        FailureError
            If Newton's method does not converge.
        """
        y, here = guess, self.at(guess, near)
        for steps in range(max_iter + 1):
            if float(np.abs(here.miss).max(initial=0.0)) <= closure_rtol:
                here = self.exact(here, y) if steps or near is not None else here
                return CurvePoint(
                    y, along(here.derivative, tangent), here, here.newton.orbit(here.period, here.T, steps), steps
                )
            rows, miss = np.vstack([here.derivative, tangent]), np.append(here.miss, tangent @ (y - guess))
            y = y - nearest_solution(rows, miss)
            here = self.at(y, here)
        raise FailureError(f"{here.newton.problem.name}: no next orbit after {max_iter} steps of Newton's method", None)

    def between(self, a: CurvePoint, b: CurvePoint, of: Test, max_iter: int) -> CurvePoint:
        """Return the point between two of the curve at which a number passes zero."""
        length = float(a.tangent @ (b.y - a.y))
        known: dict[float, CurvePoint] = {}

        def at(ds: float) -> float:
            known[ds] = self.solve(a.y + ds * a.tangent, a.tangent, max_iter, a.at) if ds else a
            return of(known[ds])

        ds = float(brentq(at, 0.0, length, xtol=1e-10, rtol=1e-10))
        at(ds)
        return known[ds]

    def with_start_away(self, point: CurvePoint, *, near_rtol: float = 0.05) -> tuple[Curve, CurvePoint]:
        """Return the curve and a point of it, with a start of the periods that is away from the events of that orbit.

        ``near_rtol``: distance of an event from the start, relative to the period, that is far enough.
        """
        orbit = point.orbit
        joins = np.array([segment.t0 for segment in exact(orbit.motion).segments[1:]])
        away = np.minimum(joins - orbit.start, orbit.start + orbit.T - joins)
        if away.min(initial=math.inf) >= near_rtol * orbit.T:
            return self, point
        based = orbit_away(orbit)
        curve = replace(Curve.of(self.family, based, self.sizes, self.kind, self.stop), differenced=self.differenced)
        y = curve.unknowns(self.values(point.y))
        here = curve.at(y)
        # The parameters change at the same rate, wherever the period begins.
        rates = np.concatenate([np.zeros(len(y) - len(self.sizes)), point.tangent[-len(self.sizes) :]])
        return curve, CurvePoint(y, along(here.derivative, rates), here, based, point.steps)


def along(derivative: Array, tangent: Array, *, singular_rtol: float = 1e-9) -> Array:
    """Return the unit tangent: of all y along which the equations hold, the nearest to the tangent of a point nearby.

    ``singular_rtol``: as in `nearest_solution`.
    """
    _, sizes, right = np.linalg.svd(derivative)
    null = right[int((sizes > singular_rtol * sizes[0]).sum()) :]
    found = (null @ tangent) @ null
    return np.asarray(found / np.linalg.norm(found))


def orbit_away(orbit: PeriodicOrbit) -> PeriodicOrbit:
    """Return the orbit with its start in the middle of the longest interval without events."""
    start, X = away_from_events(orbit.motion, orbit.start, orbit.start + orbit.T)
    newton = Newton.of(orbit, start, X)
    return newton.orbit(newton.period(X, orbit.T), orbit.T, orbit.iterations)


def orbit_matrix(here: Map) -> Array:
    """Return the derivative of the equations of an orbit by X, and by T where it is unknown; singular at a fold."""
    n = here.newton.free.size + (not here.newton.forced)
    return here.derivative[:n, :n]


def turn(point: CurvePoint) -> float:
    """Return the rate of the last parameter along the curve, which passes zero where it turns back."""
    return float(point.tangent[-1])


def fold(point: CurvePoint) -> float:
    """Return a determinant that passes zero where a multiplier passes 1."""
    return float(np.linalg.det(orbit_matrix(point.at)))


def flip(point: CurvePoint) -> float:
    """Return det(M + I), which passes zero where a multiplier passes -1."""
    M = point.orbit.monodromy
    return float(np.linalg.det(M + np.eye(len(M))))


def least_gap_of(newton: Newton, period: Period, T: float, stop: int) -> float:
    """Return the least gap along an orbit of a contact that is out of reach, from where it would be, in m."""
    return least(exact(period.motion), newton.start + T, stop, float(newton.problem.dynamics.u0[stop]))[0]


def points(
    curve: Curve,
    start: Array,
    box: Array,
    step: float,
    max_iter: int,
    tests: Callable[[CurvePoint], Mapping[str, Test]],
    ended: list[str],
    *,
    few: int = 6,
) -> Iterator[tuple[CurvePoint, str]]:
    """Yield the points of a curve from some values of its parameters, with those at which a test passes zero.

    It sets out from the first towards the second value of its last parameter in the ``box`` (2, m). The last point is at the
    edge of the box, unless the curve ends before: then ``ended`` says why.

    ``few``: number of Newton steps up to which the next step is longer.
    """
    ahead = np.zeros(len(curve.unknowns(start)))
    ahead[-1] = math.copysign(1.0, box[1, -1] - box[0, -1])
    here = curve.solve(curve.unknowns(start), ahead, max_iter)
    yield here, ""
    low, high = np.sort(box, axis=0) / curve.size

    def outside(point: CurvePoint) -> float:
        values = point.y[-len(start) :]
        return float(np.maximum(low - values, values - high).max())

    events, ds = event_sequence(here.orbit), step
    # Of all steps: towards an end, where each next one is shorter, there would be no last one.
    shortest = step * 0.5**MAX_HALVINGS
    while True:
        curve, here = curve.with_start_away(here)
        reason = ""
        while ds >= shortest:
            try:
                there = curve.solve(here.y + ds * here.tangent, here.tangent, max_iter, here.at)
                found = [
                    (curve.between(here, there, of, max_iter), kind)
                    for kind, of in {**tests(here), "edge": outside}.items()
                    if of(here) * of(there) < 0.0 and (of is not outside or of(there) > 0.0)
                ]
            except np.linalg.LinAlgError:
                reason = "the equations of the orbit are singular there"
            except (LcpImpactError, RuntimeError) as error:
                reason = str(error)
            else:
                others = event_sequence(there.orbit)
                if others != events:
                    reason = f"the orbit would have the events {words(others)} in place of {words(events)}"
                elif float(here.tangent @ there.tangent) > 0.5:
                    break
                else:
                    reason = "it turns within the shortest step"
            ds *= 0.5
        else:
            ended.append(reason)
            return
        for mark, kind in sorted(found, key=lambda each: float(here.tangent @ each[0].y)):
            yield mark, kind if kind != "edge" else ""
            if kind == "edge":
                return
        if outside(there) > 0.0:
            return
        yield there, ""
        ds = min(1.5 * ds, 20.0 * step) if there.steps <= few else 0.7 * ds
        here = there
