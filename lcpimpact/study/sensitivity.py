r"""Derivatives of the outputs of a run with respect to parameters of its problem, right across events.

The outputs are quantities by name (`lcpimpact.quantities`). With X_p = ∂X/∂p of the exact motion
(`lcpimpact.hybrid.variation`) and rows y = c X of a coordinate, velocity or force,

.. math:: \frac{dy(t)}{dp} = c\, X_p + c_p X, \qquad \frac{dt_k}{dp} = t_p, \qquad
          \frac{d y(t_k)}{dp} = c\, (X_p + f\, t_p) + c_p X, \qquad \frac{d}{dp} \max_t y = c\, X_p + c_p X
          \text{ at the peak,} \qquad \frac{d}{dp} \int y\, dt = \int (c\, X_p + c_p X)\, dt + \sum_k (y_k^- - y_k^+)\, t_p ,

of a sample at a fixed time, the instant of an event, a value at that instant, which moves with it, a peak, whose own
motion counts nothing as y' = 0 there (the envelope theorem), and an integral over the run.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Literal

import numpy as np
import pandas as pd

from lcpimpact.arguments import checked
from lcpimpact.arrays import Array
from lcpimpact.errors import InputError, LcpImpactError, UnsupportedError
from lcpimpact.hybrid.motion import ExactSolution
from lcpimpact.hybrid.variation import Member, Variation, family_of
from lcpimpact.integrators.base import Integrator
from lcpimpact.integrators.exact import Exact
from lcpimpact.numbers import positive
from lcpimpact.numerics.double_double import DoubleDouble
from lcpimpact.problems.base import Problem
from lcpimpact.problems.parameters import numbers_of, units_of, value_at, with_values
from lcpimpact.quantities import (
    AFTER,
    EVENT_NAME,
    SUMMARY,
    first_touch,
    gaps_of_bodies,
    pieces_of,
    pushing_columns,
    quantity,
    series_names,
)
from lcpimpact.record import Event
from lcpimpact.simulation import make_integrator, simulate
from lcpimpact.study.event_order import first_difference, groups_of, marks_of, needed_of, reach_of
from lcpimpact.study.one_sided import Nearby, limit_of
from lcpimpact.study.peaks import Peak, peaks_of
from lcpimpact.study.result import Study, table_lines
from lcpimpact.trajectory import Trajectory

INSTANT_RTOL = 1e-12
"""Distance of two instants, relative to the end of the run, below which they are the same."""

AT_EVENT = "at an event: derivative of the motion after it"
"""Note of a sample at the instant of an event."""

ONE_SIDED = "to one side"
"""Note of a derivative that is a limit from one side."""


@dataclass(frozen=True, eq=False, repr=False)
class Sensitivity(Study):
    """Derivatives of outputs of a run with respect to parameters.

    Attributes
    ----------
    problem : Problem
    parameters : dict of str to float
        The values of the parameters, by address.
    table : DataFrame
        One row per output: ``output``, ``unit``, ``value``, then dy/dp in one column per parameter, and a ``note``, which
        says where an output is a sample at the instant of an event, or derivatives are limits from one side. The unit of a
        derivative is that of the output over that of the parameter.
    units : dict of str to str
        The unit of each parameter; pure numbers have none.
    t_end : float
        End of the run in s.
    method : str
    variation : Variation
        The derivatives of the state.
    ranges : DataFrame or None
        Where asked for, one row per parameter: its ``value``, the values ``low`` and ``high`` between which the events
        keep their order, as far as the outputs depend on them, and what happens ``at low`` and ``at high``: "" if nothing
        does up to 100 % of the parameter.
    """

    problem: Problem
    parameters: dict[str, float]
    table: pd.DataFrame
    units: dict[str, str]
    t_end: float
    method: str
    variation: Variation = field(repr=False)
    ranges: pd.DataFrame | None = None

    drawn_by = "lcpimpact.plotting.sensitivity:plot_sensitivity"
    title = "Sensitivity of {0.problem.name}"

    def summary(self) -> str:
        """Return the outputs with their derivatives."""
        of = ", ".join(
            f"{name} = {value:g} {self.units.get(name, '')}".rstrip() for name, value in self.parameters.items()
        )
        shown = self.table if (self.table["note"] != "").any() else self.table.drop(columns="note")
        lines = [f"Sensitivity of {self.problem.name} by {self.method}: d/dp at {of}", *table_lines(shown, ".6g")]
        if self.ranges is not None:
            lines += [
                "The events that the outputs depend on keep their order between:",
                *table_lines(self.ranges, ".6g"),
            ]
        return "\n".join(lines)

    @property
    def relative(self) -> pd.DataFrame:
        """The table with (p/y) dy/dp, the change of an output in % for 1 % of a parameter; NaN of an output that is 0."""
        found = self.table.copy()
        value = found["value"].where(found["value"] != 0.0)
        for name, p in self.parameters.items():
            found[name] = p * found[name] / value
        return found

    @property
    def series(self) -> tuple[str, ...]:
        """The names of the series of the run: coordinates, velocities and forces."""
        return series_names(self.problem.dynamics)

    @checked
    def jacobian(self, t: Sequence[float] | Array) -> Array:
        """Return the derivatives of all series at some times: (nt, ns, np), in the order of ``series`` and ``parameters``.

        Parameters
        ----------
        t : (nt,) array
            Times in s within the run, of which an event has the right limit.

        Raises
        ------
        InputError
            For a time outside the run.
        UnsupportedError
            If the motion has no derivative up to there.

        Examples
        --------
        >>> from lcpimpact import load_problem, sensitivity
        >>> found = sensitivity(load_problem("bouncing-ball"), ["g"], ["impact:1"], t_end=0.6)
        >>> x = found.series.index("x")
        >>> found.jacobian([0.2, 0.3])[:, x, 0].round(12)  # x = g t²/2
        array([0.02 , 0.045])
        """
        times = np.atleast_1d(np.asarray(t, dtype=np.float64))
        if times.ndim != 1 or not len(times):
            raise InputError("jacobian: t must be a list of times in s, as [0.1, 0.2]")
        if not ((times >= 0.0) & (times <= self.t_end * (1.0 + INSTANT_RTOL))).all():
            raise InputError(f"jacobian: the times must lie in the run, 0 to {self.t_end:g} s; run longer with t_end")
        return _Outputs(self.variation).samples(np.minimum(times, self.t_end))[1]


@checked
def sensitivity(
    problem: Problem,
    wrt: str | Sequence[str],
    outputs: str | Sequence[str],
    *,
    method: str | Integrator = "exact",
    t_end: float | None = None,
    side: Literal["left", "right"] | None = None,
    ranges: bool = False,
) -> Sensitivity:
    r"""Differentiate outputs of a run with respect to parameters, across impacts, contacts, friction and relays.

    With A the generator of a mode, c the row whose zero ends it, R the jump of the state there, and f⁻ and f⁺ its rates,

    .. math:: X_p' = A X_p + A_p X, \qquad t_p = -\frac{c\, X_p + c_p X^-}{c \cdot f^-}, \qquad
              X_p^+ = R\, (X_p^- + f^- t_p) + R_p X^- - f^+ t_p .

    A difference quotient of runs by time stepping does not converge to this where bodies strike: a step that stays in its
    cell does not move with its impact.

    Parameters
    ----------
    problem : Problem
        One that the method ``exact`` handles.
    wrt : sequence of str
        Addresses of parameters (`lcpimpact.problems.parameters`): ``k_o``, ``KelvinVoigt.c``, ``2.e``, ``v0.x``.
    outputs : sequence of str
        Names of outputs (`lcpimpact.quantities`): ``R.max``, ``x.min``, ``open:1``, ``impact:2.speed``,
        ``R.impact:1.impulse``, ``x@2.0``, ``peak_force``, ``dissipated``.
    method : str
        Only ``exact``.
    t_end : float, optional
        End in s; by default that of the problem.
    side : "left" or "right", optional
        For derivatives by smaller or larger values of each parameter only, where two events coincide, a contact touches at
        the start, a sample is at an event, or two peaks are equal: the limits of the derivatives beside it, with the order
        of events that holds there. Where there are derivatives to both sides, these.
    ranges : bool
        Whether to find the range of each parameter in which the events keep their order, by some 40 runs each: the
        distance to either side grows from 1e-6 of the parameter to 100 %, and is bisected to 1 % of it where the order of
        events, samples and the end of the run, up to the last that an output depends on, is another. An order that comes
        back between two of these distances is not seen.

    Returns
    -------
    Sensitivity
        With the table of outputs and parameters, ``relative``, and ``jacobian(t)`` of the curves.

    Raises
    ------
    InputError
        For an unknown parameter or output, or one that the run does not have.
    UnsupportedError
        If there is no derivative: at a grazing, where it grows as 1/sqrt, if two events coincide, if impacts accumulate, or
        if a greatest value is reached twice; and for other methods.

    Notes
    -----
    The derivative holds as long as the order of the events does. At a parameter at the end of its domain, as e = 1, it is
    one-sided.

    Examples
    --------
    A ball falls from H = 1 m: the instant sqrt(2 H/g) of its impact and the speed sqrt(2 g H) by H.

    >>> from lcpimpact import load_problem, sensitivity
    >>> found = sensitivity(load_problem("bouncing-ball"), ["H", "e"], ["impact:1", "impact:1.speed"], t_end=0.6)
    >>> found.table[["output", "value", "H", "e"]].round(9)
               output     value         H    e
    0        impact:1  0.451524  0.225762  0.0
    1  impact:1.speed  4.429447  2.214723  0.0
    >>> found.relative["H"].round(9).tolist()
    [0.5, 0.5]

    References
    ----------
    Leine and Nijmeijer, *Dynamics and Bifurcations of Non-Smooth Mechanical Systems* (2004), chapter 7.
    """
    integrator = _integrator(method)
    names, asked = _listed("wrt", wrt), _listed("outputs", outputs)
    values = {name: value_at(problem, name) for name in names}
    for name, value in values.items():
        if not math.isfinite(value):
            raise InputError(
                f"wrt: {name} = {value:g} is not finite, and has no derivative: give it a finite value first"
            )
    end = problem.t_end if t_end is None else t_end
    positive("t_end", end, "s")
    for name in asked:
        _check_output(name, problem, end)
    run = simulate(problem, integrator, dt=end / 200, t_end=end, progress=False, error=False)
    assert run.dense is not None
    solution = run.dense.solution
    assert isinstance(solution, ExactSolution)
    units = units_of(problem, names)
    sizes = _sizes(problem, values, units)
    family = family_of(
        solution.system,
        problem,
        lambda name, value: with_values(problem, {name: value}),
        values,
        sizes,
    )
    known = _Outputs(Variation(solution, family), np.array(list(sizes.values())))
    quantities = [quantity(name, problem) for name in asked]
    measured = np.array([float(each.measure(run)) for each in quantities])
    if side is None:
        found = [known.derivative(name, run) for name in asked]
    else:
        sign = 1.0 if side == "right" else -1.0
        by_names = [_one_sided(problem, integrator, name, sign * sizes[name], asked, measured, end) for name in names]
        note = ONE_SIDED if any(limits for _, limits in by_names) else ""
        found = [(np.array([slopes[j] for slopes, _ in by_names]), note) for j in range(len(asked))]
    rows = []
    for of, value, (derivative, note) in zip(quantities, measured.tolist(), found, strict=True):
        row = dict(zip(names, (derivative + 0.0).tolist(), strict=True))
        rows.append({"output": of.name, "unit": of.unit, "value": value, **row, "note": note})
    table = _ranges(problem, values, sizes, run, asked) if ranges else None
    return Sensitivity(problem, values, pd.DataFrame(rows), units, float(end), integrator.name, known.variation, table)


def _one_sided(
    problem: Problem, integrator: Exact, name: str, size: float, outputs: Sequence[str], measured: Array, end: float
) -> tuple[Array, bool]:
    """Return the derivatives (m,) of outputs by a parameter to the side of the sign of its size, and if they are limits."""

    def at(change: float) -> Sensitivity:
        there = with_values(problem, {name: value_at(problem, name) + change}) if change else problem
        return sensitivity(there, [name], outputs, method=integrator, t_end=end)

    def beside(change: float) -> Nearby:
        found = at(change)
        events = [event for segment in found.variation.solution.segments for event in segment.events]
        order = groups_of(needed_of(marks_of(found.problem, events, end, outputs), outputs))
        return Nearby(found.table["value"].to_numpy(), found.table[name].to_numpy(), order)

    try:
        found = at(0.0)
        if not (found.table["note"] == AT_EVENT).any():
            return found.table[name].to_numpy(), False
    except UnsupportedError:
        pass
    where = f"{name} to the {'right' if size > 0.0 else 'left'}"
    try:
        return limit_of(beside, measured, size), True
    except InputError as error:
        raise InputError(f"{where}: {error}") from None
    except UnsupportedError as error:
        raise UnsupportedError(f"{where}: {error}") from None


def _ranges(
    problem: Problem, values: dict[str, float], sizes: dict[str, float], run: Trajectory, outputs: Sequence[str]
) -> pd.DataFrame:
    """Return the range of each parameter in which the events of a run keep their order."""
    assert run.integrator is not None
    integrator, end = run.integrator, float(run.t[-1])
    known = groups_of(needed_of(marks_of(problem, run.events, end, outputs), outputs))

    def happens(name: str, value: float) -> str:
        try:
            changed = with_values(problem, {name: value})
            other = simulate(changed, integrator, dt=end / 2, t_end=end, throw=False, progress=False, error=False)
        except LcpImpactError as error:
            return str(error)
        found = groups_of(marks_of(changed, other.events, end, outputs))
        return first_difference(known, found) or ("" if other.success else other.message)

    rows = []
    for name, value in values.items():
        (low, at_low), (high, at_high) = (
            reach_of(value, sign * sizes[name], partial(happens, name)) for sign in (-1.0, 1.0)
        )
        rows.append({"parameter": name, "value": value, "low": low, "high": high, "at low": at_low, "at high": at_high})
    return pd.DataFrame(rows)


def _integrator(method: str | Integrator) -> Exact:
    """Return the method, if it is `Exact`."""
    integrator = make_integrator(method, {})
    if isinstance(integrator, Exact):
        return integrator
    if integrator.declared.order_impact <= 1.0:
        raise UnsupportedError(
            f"sensitivity: derivatives of a run by {integrator.name!r} converge to wrong numbers across impacts, since an "
            "impact does not move within its step: ",
            ("exact",),
        )
    raise UnsupportedError(f"sensitivity: derivatives of a run by {integrator.name!r} are not known: ", ("exact",))


def _listed(what: str, names: str | Sequence[str]) -> list[str]:
    """Return names as a list, checked."""
    found = [names] if isinstance(names, str) else list(names)
    if not found or len(set(found)) < len(found):
        example = "['k_o', 'c_o']" if what == "wrt" else "['R.max', 'x@2.0']"
        raise InputError(f"{what} = {found!r} must name at least one, each once, as in {what}={example}")
    return found


def _check_output(name: str, problem: Problem, end: float) -> None:
    """Refuse outputs that are unknown, a whole curve, or no event, sample or peak."""
    of = quantity(name, problem)
    if of.series:
        raise InputError(
            f"outputs: {name!r} is a curve: take {name}@{end:g} or {name}.max, or jacobian(t) of the result"
        )
    if of.until > end:
        raise InputError(
            f"outputs: {name!r} lies after the end of the run, {end:g} s: take an earlier one, or a later t_end"
        )
    if name == "impacts":
        raise InputError(
            "outputs: 'impacts' is a number of events, which has no derivative: take one of them, as impact:1"
        )


def _sizes(problem: Problem, values: dict[str, float], units: dict[str, str]) -> dict[str, float]:
    """Return the size of each parameter: of one that is 0, the largest of the same unit, or 1."""
    numbers = numbers_of(problem)
    of_numbers = units_of(problem, numbers)
    found = {}
    for name, value in values.items():
        same = [abs(each) for other, each in numbers.items() if of_numbers.get(other) == units.get(name, "-") and each]
        found[name] = abs(value) or max(same, default=1.0)
    return found


@dataclass(frozen=True, eq=False)
class _Rows:
    """Linear functions y = w·(q, v, r) + w0 of the motion, and their derivatives by the parameters.

    Attributes
    ----------
    w, w0 : (m, 2 n + nc), (m,) arrays
    w_p, w0_p : (np, m, 2 n + nc), (np, m) arrays
    """

    w: Array
    w0: Array
    w_p: Array
    w0_p: Array

    def derivative(self, i: int, s: Array, s_p: Array) -> Array:
        """Return dy_i/dp (np,) at values s (2 n + nc,) of q, v and r with the derivatives s_p (2 n + nc, np)."""
        return np.asarray(self.w[i] @ s_p + self.w_p[:, i] @ s + self.w0_p[:, i])


@dataclass(frozen=True, eq=False)
class _Outputs:
    """The derivatives of outputs, from those of the state.

    Attributes
    ----------
    variation : Variation
    sizes : (np,) array         the sizes of the parameters
    """

    variation: Variation
    sizes: Array = field(default_factory=lambda: np.ones(1))

    def samples(self, times: Array) -> tuple[Array, Array]:
        """Return q, v and r at times of the run (nt, 2 n + nc), right limits at events, and their derivatives (..., np)."""
        segments, starts = self.variation.solution.segments, self.variation.solution.chain.starts[:, 0]
        owner = np.maximum(np.searchsorted(starts, times, side="right") - 1, 0)
        found = []
        for k in np.unique(owner):
            mine = np.flatnonzero(owner == k)
            X, X_p = self.variation.at(int(k), np.maximum(segments[k].since(times[mine]), 0.0))
            found.append((mine, *self._read(int(k), X, X_p)))
        s = np.empty((len(times), found[0][1].shape[1]))
        s_p = np.empty((*s.shape, self.variation.count))
        for mine, values, derivatives in found:
            s[mine], s_p[mine] = values, derivatives
        return s, s_p

    def _read(self, k: int, X: Array, X_p: Array) -> tuple[Array, Array]:
        """Return q, v and r (nt, 2 n + nc), and d(q, v, r)/dp, of states X (nt, N) with X_p in the mode of segment k."""
        rows, rows_p = self.variation.rows(self.variation.solution.segments[k].mode)
        return X @ rows.T, np.asarray(rows @ X_p + np.einsum("pij,tj->tip", rows_p, X))

    def derivative(self, name: str, run: Trajectory) -> tuple[Array, str]:
        """Return dy/dp (np,) of an output, and a note."""
        if name in SUMMARY:
            return self._of_summary(name, run), ""
        if event := EVENT_NAME.fullmatch(name):
            found = [e for e in run.events if e.kind == event["kind"] and event["contact"] in (None, e.contact)]
            number = int(event["number"])
            if len(found) < number:
                of = f" of {event['contact']}" if event["contact"] else ""
                raise InputError(
                    f"outputs: {name!r} is not in the run, which has {len(found)} events {event['kind']!r}{of} up to "
                    f"{run.t[-1]:g} s: take an earlier one, or a later t_end"
                )
            return self._of_event(found[number - 1], event["what"]), ""
        series, mark, end = name.rpartition("@")
        names = series_names(run.problem.dynamics)
        if mark:
            t = min(float(end), self.variation.solution.end)
            starts = self.variation.solution.chain.starts[1:, 0]
            close = np.abs(starts - t) <= INSTANT_RTOL * self.variation.solution.end
            return self.samples(np.array([t]))[1][0, names.index(series)], AT_EVENT if close.any() else ""
        series, _, end = name.rpartition(".")
        return self._of_peak(name, self._series([names.index(series)]), 1.0 if end == "max" else -1.0), ""

    def _limit(self, k: int, side: str) -> tuple[Array, Array]:
        """Return q, v and r at the events at the start of segment k, on one side of them, and their total derivatives."""
        variation, segments = self.variation, self.variation.solution.segments
        if k == 0 and side == "left":

            def start(each: Member) -> Array:
                return np.concatenate([each.problem.initial_coordinates, each.problem.initial_velocities])

            state = start(variation.family.base)
            none = np.zeros(len(variation.solution.system.degree))
            given = variation.family.derivative(start).T
            return np.append(state, none), np.vstack([given, np.zeros((len(none), variation.count))])
        if side == "left":
            arrival = variation.arrival(k - 1)
            t_p, X_p = arrival.t_p, arrival.X_p
            mode, rate = segments[k - 1].mode, arrival.event.before
            X = segments[k].before
        else:
            X_p, X = variation.start(k), segments[k].X
            mode = segments[k].mode
            t_p = variation.arrival(k - 1).t_p if k else np.zeros(variation.count)
            rate = variation.solution.system.mode(mode)[0].A @ X
        rows, rows_p = variation.rows(mode)
        return rows @ X, rows @ (X_p + np.outer(rate, t_p)) + (rows_p @ X).T

    def _at(self, event: Event) -> int:
        """Return the segment at whose start an event is."""
        segments = self.variation.solution.segments
        return next(k for k, segment in enumerate(segments) if any(each is event for each in segment.events))

    def _instant(self, k: int) -> Array:
        """Return the derivative of the initial instant of segment k."""
        self.variation.start(k)
        return self.variation.arrival(k - 1).t_p if k else np.zeros(self.variation.count)

    def _of_event(self, event: Event, what: str | None) -> Array:
        """Return the derivative of the instant, the speed or the impulse of an event."""
        variation = self.variation
        system, family = variation.solution.system, variation.family
        k = self._at(event)
        i = system.names[event.contact]
        t_p = self._instant(k)
        if what is None:
            return t_p
        if what == "impulse":
            return np.asarray(variation.impulses(k)[1][i])
        n = len(system.dynamics.nodes)
        at, derivative = self._limit(k, "right" if event.kind in AFTER else "left")
        H, v = system.dynamics.H[i], at[n : 2 * n]
        H_p = family.derivative(lambda each: each.system.dynamics.H[i])
        χ_p = family.derivative(lambda each: each.system.dynamics.chi[i])
        sign = math.copysign(1.0, float(H @ v + system.dynamics.chi[i]))
        return np.asarray(sign * (H @ derivative[n : 2 * n] + H_p @ v + χ_p))

    # ---- peaks --------------------------------------------------------------------------------------------------------

    def _series(self, columns: Sequence[int]) -> _Rows:
        """Return series as functions, by their columns among q, v and r."""
        d, count = self.variation.solution.system.dynamics, self.variation.count
        w = np.eye(2 * len(d.nodes) + len(d.contacts))[columns]
        return _Rows(w, np.zeros(len(w)), np.zeros((count, *w.shape)), np.zeros((count, len(w))))

    def _peaks(self, rows: _Rows, sign: float) -> tuple[list[tuple[Peak, Array]], float]:
        """Return the peaks of functions with their derivatives, and the size of the functions."""
        peaks, size = peaks_of(self.variation.solution, self.variation.scale, sign * rows.w, sign * rows.w0)
        found = []
        for peak in peaks:
            if peak.side:
                s, s_p = self._limit(peak.segment + (peak.side == "left"), peak.side)
            else:
                s, s_p = (each[0] for each in self.samples(np.array([peak.t])))
            found.append((peak, rows.derivative(peak.function, s, s_p)))
        return found, size

    def _of_peak(self, name: str, rows: _Rows, sign: float, *, agree_rtol: float = 1e-7) -> Array:
        """Return the derivative of the greatest value of functions, or the least; of equal peaks, if theirs are the same.

        ``agree_rtol``: difference of derivatives that are the same, relative to the larger, or to the size of the
        functions over that of the parameter.
        """
        peaks, size = self._peaks(rows, sign)
        slopes = np.array([slope for _, slope in peaks])
        apart = np.ptp(slopes, axis=0) > agree_rtol * (np.abs(slopes).max(axis=0) + size / self.sizes)
        if apart.any():
            order = np.argsort(slopes[:, np.argmax(apart)])
            raise self._tie(name, [peaks[order[0]][0], peaks[order[-1]][0]])
        return np.asarray(slopes[0])

    def _tie(self, name: str, peaks: Sequence[Peak]) -> UnsupportedError:
        first, second = sorted(each.t for each in peaks)
        return UnsupportedError(
            f"{name} is reached at t = {first:g} s and at {second:g} s alike, where it has one-sided derivatives only: "
            "change a parameter a little"
        )

    # ---- quantities of the whole run ------------------------------------------------------------------------------------

    def _of_summary(self, name: str, run: Trajectory) -> Array:
        """Return the derivative of a quantity of the whole run."""
        if math.isnan(SUMMARY[name][1](run)):
            raise InputError(
                f"outputs: {name!r} is not in the run up to {run.t[-1]:g} s: take another, or a later t_end"
            )
        d = self.variation.solution.system.dynamics
        if name in ("peak_force", "peak_time"):
            rows = self._series((2 * len(d.nodes) + pushing_columns(run)).tolist())
            return self._of_peak(name, rows, 1.0) if name == "peak_force" else self._of_peak_time(name, rows)
        if name == "deformation":
            return self._of_deformation(name)
        if name == "impulse":
            return self._of_impulse(run)
        if name == "dissipated":
            return self._of_dissipation(run)
        touch = first_touch(run)
        begin, end = (None if event is None else self._at(event) for event in (touch.closing, touch.opening))
        if name == "contact_time":
            assert end is not None
            return self._instant(end) - (0.0 if begin is None else self._instant(begin))
        after = self._of_rate(touch.column, begin if touch.closing and touch.closing.kind == "impact" else end, "right")
        if name == "rebound_speed":
            return after
        before = self._of_rate(touch.column, begin, "left")
        return -(after - before * touch.after / touch.before) / touch.before

    def _of_rate(self, column: int, k: int | None, side: str) -> Array:
        """Return the derivative of U of a contact at the start of segment k, or of the run, on one side."""
        n = len(self.variation.solution.system.dynamics.nodes)
        s, s_p = self._limit(k or 0, side)
        rate = gaps_of_bodies(self.variation.solution.system.dynamics)[column]
        rate_p = self.variation.family.derivative(lambda each: gaps_of_bodies(each.system.dynamics)[column])
        return np.asarray(rate @ s_p[n : 2 * n] + rate_p @ s[n : 2 * n])

    def _of_peak_time(self, name: str, rows: _Rows) -> Array:
        """Return the derivative of the instant of the greatest value of functions; y' = 0 there, or it is at an event."""
        variation = self.variation
        peaks = [each for each, _ in self._peaks(rows, 1.0)[0]]
        if max(each.t for each in peaks) - min(each.t for each in peaks) > INSTANT_RTOL * variation.solution.end:
            raise self._tie(name, [peaks[0], peaks[-1]])
        peak = peaks[0]
        if peak.side:
            return self._instant(peak.segment + (peak.side == "left"))
        if peak.t >= variation.solution.end:
            return np.zeros(variation.count)
        mode = variation.solution.segments[peak.segment].mode
        since = variation.solution.segments[peak.segment].since(np.array([peak.t]))
        X, X_p = (each[0] for each in variation.at(peak.segment, since))

        def slope(each: Member) -> DoubleDouble:
            return (
                DoubleDouble.of(rows.w[[peak.function]])
                @ each.system.coordinates(mode).rows
                @ each.system.reaction(mode)[0].generator
            )

        rate = slope(variation.family.base).hi[0]
        rate_p = variation.family.derivative(slope)[:, 0]
        return np.asarray(-(rate @ X_p + rate_p @ X) / (rate @ variation.solution.system.mode(mode)[0].A @ X))

    def _of_deformation(self, name: str) -> Array:
        """Return the derivative of the greatest approach of bodies beyond touch, which is at least zero."""
        d, family = self.variation.solution.system.dynamics, self.variation.family
        compliant = d.impenetrable & (d.relative_degree < 2)

        # A function that is zero stands for no touch.
        def approach(each: Member) -> Array:
            rows = gaps_of_bodies(each.system.dynamics)[compliant]
            w = np.zeros((len(rows) + 1, 2 * len(d.nodes) + len(d.contacts)))
            w[:-1, : len(d.nodes)] = -rows
            return w

        def at_rest(each: Member) -> Array:
            return np.append(-each.system.dynamics.u0[compliant], 0.0)

        base = family.base
        rows = _Rows(approach(base), at_rest(base), family.derivative(approach), family.derivative(at_rest))
        return self._of_peak(name, rows, 1.0)

    def _of_impulse(self, run: Trajectory) -> Array:
        """Return the derivative of ∫ R dt + Σ Λ."""
        d = self.variation.solution.system.dynamics
        columns = 2 * len(d.nodes) + pushing_columns(run)
        found = self._integral(run, lambda s: s[:, columns].sum(axis=1), lambda s, s_p: s_p[:, columns].sum(axis=1))
        for k, segment in enumerate(self.variation.solution.segments):
            if any(event.impulse for event in segment.events):
                found = found + self.variation.impulses(k)[1][d.impenetrable].sum(axis=0)
        return found

    def _of_dissipation(self, run: Trajectory) -> Array:
        r"""Return the derivative of ∫ (vᵀ C v - rᵀ H v) dt - Σ Λᵀ H (v⁻ + v⁺)/2."""
        d, family = self.variation.solution.system.dynamics, self.variation.family
        n = len(d.nodes)
        C, C_p = d.C, family.derivative(lambda each: each.system.dynamics.C)
        H, H_p = d.H, family.derivative(lambda each: each.system.dynamics.H)

        def power(s: Array) -> Array:
            v, r = s[:, n : 2 * n], s[:, 2 * n :]
            return np.asarray(np.einsum("ti,ij,tj->t", v, C, v) - np.einsum("ti,ij,tj->t", r, H, v))

        def change(s: Array, s_p: Array) -> Array:
            v, v_p = s[:, n : 2 * n], s_p[:, n : 2 * n]
            r, r_p = s[:, 2 * n :], s_p[:, 2 * n :]
            found = np.einsum("ti,tip->tp", v @ (C + C.T) - r @ H, v_p) - np.einsum("ti,tip->tp", v @ H.T, r_p)
            return np.asarray(found + np.einsum("ti,pij,tj->tp", v, C_p, v) - np.einsum("ti,pij,tj->tp", r, H_p, v))

        found = self._integral(run, power, change)
        for k, segment in enumerate(self.variation.solution.segments):
            if any(event.impulse for event in segment.events):
                P, P_p = self.variation.impulses(k)
                sides = [self._limit(k, side) for side in ("left", "right")]
                v, v_p = (sum(each[j][n : 2 * n] for each in sides) / 2.0 for j in range(2))
                found = found - (H @ v @ P_p + P @ H @ v_p + H_p @ v @ P)
        return found

    def _integral(self, run: Trajectory, y: Callable[[Array], Array], y_p: Callable[[Array, Array], Array]) -> Array:
        """Return the derivative (np,) of ∫ y dt over the run, of a function y (nt,) of q, v and r with y_p (nt, np)."""
        assert run.dense is not None
        pieces = pieces_of(run, run.dense)
        found = pieces.each(y_p(*self.samples(pieces.times))).sum(axis=0)
        for k in range(1, len(self.variation.solution.segments)):
            before, after = (y(self._limit(k, side)[0][None])[0] for side in ("left", "right"))
            found = found + (before - after) * self._instant(k)
        return np.asarray(found)
