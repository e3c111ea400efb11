r"""Derivatives of the outputs of a run with respect to parameters of its problem, right across events.

The outputs are quantities by name (`lcpimpact.quantities`). With X_p = ∂X/∂p of the exact motion
(`lcpimpact.hybrid.variation`) and rows y = c X of a coordinate, velocity or force,

.. math:: \frac{dy(t)}{dp} = c\, X_p + c_p X, \qquad \frac{dt_k}{dp} = t_p, \qquad
          \frac{d y(t_k)}{dp} = c\, (X_p + f\, t_p) + c_p X, \qquad \frac{d}{dp} \max_t y = c\, X_p + c_p X
          \text{ at the peak,}

of a sample at a fixed time, the instant of an event, a value at that instant, which moves with it, and a peak, whose own
motion counts nothing as y' = 0 there (the envelope theorem).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import pandas as pd

from lcpimpact.arguments import checked
from lcpimpact.arrays import Array
from lcpimpact.errors import InputError, UnsupportedError
from lcpimpact.hybrid.motion import ExactSolution
from lcpimpact.hybrid.tangent import impulse_rows
from lcpimpact.hybrid.variation import Member, Variation, family_of
from lcpimpact.integrators.base import Integrator
from lcpimpact.integrators.exact import Exact
from lcpimpact.numbers import positive
from lcpimpact.numerics.double_double import DoubleDouble, stacked
from lcpimpact.problems.base import Problem
from lcpimpact.problems.parameters import changes_at, numbers_of, units_of, value_at
from lcpimpact.quantities import AFTER, EVENT_NAME, quantity, series_names
from lcpimpact.reading import highest
from lcpimpact.record import Event
from lcpimpact.simulation import make_integrator, simulate
from lcpimpact.study.result import Study, table_lines
from lcpimpact.trajectory import Trajectory

INSTANT_RTOL = 1e-12
"""Distance of two instants, relative to the end of the run, below which they are the same."""

AT_EVENT = "at an event: derivative of the motion after it"
"""Note of a sample at the instant of an event."""


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
        says where an output is a sample at the instant of an event. The unit of a derivative is that of the output over
        that of the parameter.
    units : dict of str to str
        The unit of each parameter; pure numbers have none.
    t_end : float
        End of the run in s.
    method : str
    variation : Variation
        The derivatives of the state.
    """

    problem: Problem
    parameters: dict[str, float]
    table: pd.DataFrame
    units: dict[str, str]
    t_end: float
    method: str
    variation: Variation = field(repr=False)

    drawn_by = "lcpimpact.plotting.sensitivity:plot_sensitivity"
    title = "Sensitivity of {0.problem.name}"

    def summary(self) -> str:
        """Return the outputs with their derivatives."""
        of = ", ".join(
            f"{name} = {value:g} {self.units.get(name, '')}".rstrip() for name, value in self.parameters.items()
        )
        shown = self.table if (self.table["note"] != "").any() else self.table.drop(columns="note")
        lines = [f"Sensitivity of {self.problem.name} by {self.method}: d/dp at {of}", *table_lines(shown, ".6g")]
        if self.differenced:
            lines.append(f"by differences of the equations of motion, of order 6: {', '.join(self.differenced)}")
        return "\n".join(lines)

    @property
    def differenced(self) -> tuple[str, ...]:
        """The parameters by which the equations of motion are differenced, as they are no formulas of these there."""
        return self.variation.family.differenced

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
        return _Outputs(self.variation).samples(np.minimum(times, self.t_end))


@checked
def sensitivity(
    problem: Problem,
    wrt: str | Sequence[str],
    outputs: str | Sequence[str],
    *,
    method: str | Integrator = "exact",
    t_end: float | None = None,
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
        ``R.impact:1.impulse``, ``x@2.0``.
    method : str
        Only ``exact``.
    t_end : float, optional
        End in s; by default that of the problem.

    Returns
    -------
    Sensitivity
        With the table of outputs and parameters, ``relative``, and ``jacobian(t)`` of the curves.

    Raises
    ------
    InputError
        For an unknown parameter or output, or one that the run does not have.
    UnsupportedError
        If there is no derivative: at a grazing, where it grows as 1/sqrt, if two events coincide, or if impacts accumulate;
        and for other methods.

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
    family = family_of(
        solution.system,
        problem,
        changes_at(problem, names),
        values,
        sizes(problem, values, units),
    )
    known = _Outputs(Variation(solution, family))
    rows = []
    for name in asked:
        of = quantity(name, problem)
        derivative, note = known.derivative(name, run)
        rows.append(
            {
                "output": name,
                "unit": of.unit,
                "value": float(of.measure(run)),
                **dict(zip(names, (derivative + 0.0).tolist(), strict=True)),
                "note": note,
            }
        )
    return Sensitivity(problem, values, pd.DataFrame(rows), units, float(end), integrator.name, known.variation)


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
    if not EVENT_NAME.fullmatch(name) and "@" not in name and not name.endswith((".max", ".min")):
        raise InputError(
            f"outputs: the derivative of {name!r} is not known: take events, samples or peaks of a series, as open:1, x@2.0 "
            "or R.max"
        )


def sizes(problem: Problem, values: dict[str, float], units: dict[str, str]) -> dict[str, float]:
    """Return the size of each parameter: of one that is 0, the largest of the same unit, or 1."""
    numbers = numbers_of(problem)
    of_numbers = units_of(problem, numbers)
    found = {}
    for name, value in values.items():
        same = [abs(each) for other, each in numbers.items() if of_numbers.get(other) == units.get(name, "-") and each]
        found[name] = abs(value) or max(same, default=1.0)
    return found


@dataclass(frozen=True, eq=False)
class _Outputs:
    """The derivatives of outputs, from those of the state."""

    variation: Variation

    def samples(self, times: Array) -> Array:
        """Return the derivatives of q, v and r at times of the run (nt, 2 n + nc, np), right limits at events."""
        segments, starts = self.variation.solution.segments, self.variation.solution.chain.starts[:, 0]
        owner = np.maximum(np.searchsorted(starts, times, side="right") - 1, 0)
        found = []
        for k in np.unique(owner):
            mine = np.flatnonzero(owner == k)
            X, X_p = self.variation.at(int(k), np.maximum(segments[k].since(times[mine]), 0.0))
            found.append((mine, self._read(int(k), X, X_p)))
        whole = np.empty((len(times), *found[0][1].shape[1:]))
        for mine, part in found:
            whole[mine] = part
        return whole

    def _read(self, k: int, X: Array, X_p: Array) -> Array:
        """Return d(q, v, r)/dp (nt, 2 n + nc, np) of states X (nt, N) with the derivatives X_p in the mode of segment k."""
        rows, rows_p = self.variation.rows(self.variation.solution.segments[k].mode)
        return np.asarray(rows @ X_p + np.einsum("pij,tj->tip", rows_p, X))

    def derivative(self, name: str, run: Trajectory) -> tuple[Array, str]:
        """Return dy/dp (np,) of an output, and a note."""
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
            return self.samples(np.array([t]))[0, names.index(series)], AT_EVENT if close.any() else ""
        series, _, end = name.rpartition(".")
        return self._of_peak(names.index(series), *highest(run, series, 1.0 if end == "max" else -1.0)), ""

    def _limit(self, k: int, side: str) -> tuple[Array, Array]:
        """Return q, v and r at the events at the start of segment k, on one side of them, and their total derivatives."""
        variation, segments = self.variation, self.variation.solution.segments
        if k == 0 and side == "left":

            def start(each: Member) -> DoubleDouble:
                return stacked([[each.q0[None], each.v0[None]]])[0]

            state = start(variation.family.base).hi
            none = np.zeros(len(variation.solution.system.degree))
            given = variation.family.derivative(start).T
            return np.append(state, none), np.vstack([given, np.zeros((len(none), variation.count))])
        if side == "left":
            event, t_p, X_p = variation.arrival(k - 1)
            mode, rate = segments[k - 1].mode, event.before
            X = segments[k].before
        else:
            X_p, X = variation.start(k), segments[k].X
            mode = segments[k].mode
            t_p = variation.arrival(k - 1).t_p if k else np.zeros(variation.count)
            rate = variation.solution.system.mode(mode)[0].A @ X
        rows, rows_p = variation.rows(mode)
        return rows @ X, rows @ (X_p + np.outer(rate, t_p)) + (rows_p @ X).T

    def _of_event(self, event: Event, what: str | None) -> Array:
        """Return the derivative of the instant, the speed or the impulse of an event."""
        variation = self.variation
        solution, family = variation.solution, variation.family
        system = solution.system
        k = next(k for k, segment in enumerate(solution.segments) if any(each is event for each in segment.events))
        i = system.names[event.contact]
        variation.start(k)
        if what is None:
            return variation.arrival(k - 1).t_p if k else np.zeros(variation.count)
        if what == "impulse":
            mode = solution.segments[max(k - 1, 0)].mode
            hit, X = variation.hit(0), solution.segments[k].before
            if k:
                arrival = variation.arrival(k - 1)
                hit, moved = arrival.event.hit, arrival.X_p + np.outer(arrival.event.before, arrival.t_p)
            else:
                moved = family.derivative(lambda each: each.state).T
            L_p = family.derivative(lambda each: impulse_rows(each.system, mode, hit)[i])
            return np.asarray(impulse_rows(system, mode, hit).hi[i] @ moved + L_p @ X)
        n = len(system.dynamics.nodes)
        at, derivative = self._limit(k, "right" if event.kind in AFTER else "left")
        H, v = system.dynamics.H[i], at[n : 2 * n]
        H_p = family.derivative(lambda each: each.system.dynamics.finely("H")[i])
        χ_p = family.derivative(lambda each: each.system.dynamics.finely("chi")[i])
        sign = math.copysign(1.0, float(H @ v + system.dynamics.chi[i]))
        return np.asarray(sign * (H @ derivative[n : 2 * n] + H_p @ v + χ_p))

    def _of_peak(self, row: int, t: float, value: float) -> Array:
        """Return the derivative of a peak found near t: of a row of q, v and r."""
        solution = self.variation.solution
        starts = np.append(solution.chain.starts[:, 0], solution.end)
        near = int(np.argmin(np.abs(starts - t)))
        if near < len(solution.segments) and abs(starts[near] - t) <= INSTANT_RTOL * solution.end:
            # At an event the peak moves with it, and is on the side of the greater value.
            sides = [self._limit(near, side) for side in (("left", "right") if near else ("right",))]
            return np.asarray(min(sides, key=lambda side: abs(side[0][row] - value))[1][row])
        return np.asarray(self.samples(np.array([self._stationary(row, t)]))[0, row])

    def _stationary(self, row: int, t: float, *, max_steps: int = 8) -> float:
        """Return the instant near t at which the rate of a row of q, v and r is zero, by Newton's method, or t."""
        solution = self.variation.solution
        k = max(int(np.searchsorted(solution.chain.starts[:, 0], t, side="right")) - 1, 0)
        segment, mode = solution.segments[k], solution.segments[k].mode
        flow, _ = solution.system.mode(mode)
        c = solution.system.coordinates(mode).rows.hi[row] @ flow.A
        end = solution.segments[k + 1].t0 if k + 1 < len(solution.segments) else solution.end
        for _ in range(max_steps):
            X = flow.move(segment.state, float(segment.since(np.array(t)))).hi
            slope = float(c @ flow.A @ X)
            step = -float(c @ X) / slope if slope else 0.0
            if not segment.t0 < t + step < end:
                return t
            t = t + step
            if abs(step) <= INSTANT_RTOL * solution.end:
                break
        return t
