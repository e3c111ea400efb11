r"""Derivatives of the outputs of a run with respect to parameters of its problem, right across events.

The outputs are quantities by name (`lcpimpact.quantities`). With X_p = ∂X/∂p of the motion
(`lcpimpact.hybrid.variation`, `lcpimpact.hybrid.forced_variation`) and rows y = c X of a coordinate, velocity or force,

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
from lcpimpact.hybrid.dense_output import EventDrivenSolution
from lcpimpact.hybrid.forced_variation import EventDrivenMotion, ForcedVariation
from lcpimpact.hybrid.motion import ExactSolution
from lcpimpact.hybrid.tangent import impulse_rows
from lcpimpact.hybrid.variation import Member, Variation, family_of
from lcpimpact.integrators.base import Integrator
from lcpimpact.integrators.event_driven import EventDriven
from lcpimpact.integrators.exact import Exact
from lcpimpact.numbers import positive
from lcpimpact.numerics.double_double import DoubleDouble, stacked
from lcpimpact.problems.base import Problem
from lcpimpact.problems.parameters import changes_at, numbers_of, units_of, value_at
from lcpimpact.quantities import AFTER, EVENT_NAME, quantity, series_names
from lcpimpact.reading import highest
from lcpimpact.record import Event
from lcpimpact.simulation import make_integrator, methods_that_take, simulate
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
    method: str | Integrator = "auto",
    t_end: float | None = None,
) -> Sensitivity:
    r"""Differentiate outputs of a run with respect to parameters, across impacts, contacts, friction and relays.

    By ``exact`` the derivatives are exact to rounding. By ``event-driven`` they are integrated beside a motion with
    non-linear springs and dashpots, general forces and any loads, at a tenth of the tolerance of the run: their relative
    error is some ten to a hundred times its ``rtol`` (see `lcpimpact.integrators.event_driven`), 1e-9 by default.

    With A the generator of a mode, c the row whose zero ends it, R the jump of the state there, and f⁻ and f⁺ its rates,

    .. math:: X_p' = A X_p + A_p X, \qquad t_p = -\frac{c\, X_p + c_p X^-}{c \cdot f^-}, \qquad
              X_p^+ = R\, (X_p^- + f^- t_p) + R_p X^- - f^+ t_p .

    A difference quotient of runs by time stepping does not converge to this where bodies strike: a step that stays in its
    cell does not move with its impact.

    Parameters
    ----------
    problem : Problem
        One that the method ``exact`` or ``event-driven`` handles.
    wrt : sequence of str
        Addresses of parameters (`lcpimpact.problems.parameters`): ``k_o``, ``KelvinVoigt.c``, ``2.e``, ``v0.x``.
    outputs : sequence of str
        Names of outputs (`lcpimpact.quantities`): ``R.max``, ``x.min``, ``open:1``, ``impact:2.speed``,
        ``R.impact:1.impulse``, ``x@2.0``.
    method : str or Integrator
        ``exact`` or ``event-driven``, as ``EventDriven(rtol=1e-12)`` for more digits; by default ``exact`` where it handles
        the problem, and ``event-driven`` elsewhere. The result says which.
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

    A ball with Hertz's force strikes a wall: the duration of the contact goes as v^(-1/5).

    >>> from lcpimpact import HertzSpring, Mass, Problem, Scheme
    >>> ball = Scheme(Mass("x", m=2.0), HertzSpring("x", "ground", K=1e5, gap=0.0, name="F"))
    >>> struck = Problem("hertz", ball, v0={"x": 1.0})
    >>> found = sensitivity(struck, ["v0.x"], ["open:1"], t_end=0.1)
    >>> found.method, found.relative["v0.x"].round(8).tolist()
    ('event-driven', [-0.2])

    References
    ----------
    Leine and Nijmeijer, *Dynamics and Bifurcations of Non-Smooth Mechanical Systems* (2004), chapter 7.
    """
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
    run = _run(problem, method, end)
    chosen = run.integrator
    assert chosen is not None
    units = units_of(problem, names)
    known = _Outputs(_variation(run, values, _sizes(problem, values, units)))
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
    return Sensitivity(problem, values, pd.DataFrame(rows), units, float(end), chosen.name, known.variation)


def _run(problem: Problem, method: str | Integrator, end: float) -> Trajectory:
    """Return the run of a problem whose derivatives are known: by ``auto`` that of ``exact``, or of ``event-driven``."""
    if method == "auto":
        try:
            return _run(problem, "exact", end)
        except UnsupportedError:
            return _run(problem, "event-driven", end)
    integrator = make_integrator(method, {})
    if isinstance(integrator, EventDriven) and not integrator.kinks:
        raise UnsupportedError(
            "sensitivity: with kinks=False the instants at which springs close are not known, and derivatives jump there: "
            "take kinks=True"
        )
    if not isinstance(integrator, Exact | EventDriven):
        why = "are not known"
        if integrator.declared.order_impact <= 1.0:
            why = "converge to wrong numbers across impacts, since an impact does not move within its step"
        raise UnsupportedError(
            f"sensitivity: derivatives of a run by {integrator.name!r} {why}: ", ("exact", "event-driven")
        )
    try:
        return simulate(problem, integrator, dt=end / 200, t_end=end, progress=False, error=False)
    except UnsupportedError as refusal:
        others = [name for name in ("exact", "event-driven") if refusal.methods and name != integrator.name]
        raise UnsupportedError(refusal.reason, methods_that_take(problem, others)[:1] if others else ()) from None


def _variation(run: Trajectory, values: dict[str, float], sizes: dict[str, float]) -> Variation:
    """Return the derivatives of the state of a run."""
    assert run.dense is not None
    solution, problem = run.dense.solution, run.problem
    integrator, make = run.integrator, changes_at(problem, values)
    if isinstance(solution, ExactSolution):
        return Variation(solution, family_of(solution.system, problem, make, values, sizes))
    assert isinstance(solution, EventDrivenSolution)
    assert isinstance(integrator, EventDriven)
    family = family_of(solution.forced.system, problem, make, values, sizes, solution.forced)
    return ForcedVariation(
        solution=EventDrivenMotion.of(solution, family.base.state.hi, run.events, float(run.t[-1])), family=family,
        sizes=np.array(list(sizes.values())), solver=integrator.ode_solver, rtol=integrator.rtol,
        max_step=integrator.max_step,
    )  # fmt: skip


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
class _Outputs:
    """The derivatives of outputs, from those of the state."""

    variation: Variation

    def samples(self, times: Array) -> Array:
        """Return the derivatives of all series at times of the run (nt, ns, np), right limits at events."""
        segments, starts = self.variation.solution.segments, self.variation.starts
        owner = np.maximum(np.searchsorted(starts, times, side="right") - 1, 0)
        found = []
        for k in np.unique(owner):
            mine = np.flatnonzero(owner == k)
            found.append((mine, self.variation.series(int(k), np.maximum(segments[k].since(times[mine]), 0.0))))
        whole = np.empty((len(times), *found[0][1].shape[1:]))
        for mine, part in found:
            whole[mine] = part
        return whole

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
            starts = self.variation.starts[1:]
            close = np.abs(starts - t) <= INSTANT_RTOL * self.variation.solution.end
            return self.samples(np.array([t]))[0, names.index(series)], AT_EVENT if close.any() else ""
        series, _, end = name.rpartition(".")
        return self._of_peak(names.index(series), *highest(run, series, 1.0 if end == "max" else -1.0)), ""

    def _of_event(self, event: Event, what: str | None) -> Array:
        """Return the derivative of the instant, the speed or the impulse of an event."""
        variation = self.variation
        solution, family = variation.solution, variation.family
        system = solution.system
        k = variation.started_by(event)
        variation.start(k)
        if what is None:
            return variation.instant(k)
        if what == "impulse" and event.impulse == 0.0:
            return np.zeros(variation.count)
        if what == "impulse":
            i = system.names[event.contact]
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
        i = [each.name for each in system.dynamics.forces].index(event.contact)
        at, derivative = variation.limit(k, "right" if event.kind in AFTER else "left")

        def rate(each: Member) -> DoubleDouble:
            """Return the row of the rate of approach or opening, by v and the given motions (n + 1,)."""
            d = each.system.dynamics
            none = np.zeros((len(d.directions), 1))
            return stacked([[d.finely("H"), d.finely("chi")[:, None]], [-d.directions, none]])[i]

        row, v = rate(variation.family.base).hi, np.append(at[n : 2 * n], 1.0)
        sign = math.copysign(1.0, float(row @ v))
        return np.asarray(sign * (row[:n] @ derivative[n : 2 * n] + family.derivative(rate) @ v))

    def _of_peak(self, row: int, t: float, value: float) -> Array:
        """Return the derivative of a peak of a series found near t."""
        solution = self.variation.solution
        starts = np.append(self.variation.starts, solution.end)
        near = int(np.argmin(np.abs(starts - t)))
        if near < len(solution.segments) and abs(starts[near] - t) <= INSTANT_RTOL * solution.end:
            # At an event the peak moves with it, and is on the side of the greater value.
            sides = [self.variation.limit(near, side) for side in (("left", "right") if near else ("right",))]
            return np.asarray(min(sides, key=lambda side: abs(side[0][row] - value))[1][row])
        return np.asarray(self.samples(np.array([self.variation.stationary(row, t)]))[0, row])
