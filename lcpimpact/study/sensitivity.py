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
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Literal

import numpy as np
import pandas as pd

from lcpimpact.arguments import checked
from lcpimpact.arrays import Array
from lcpimpact.errors import InputError, LcpImpactError, UnsupportedError
from lcpimpact.hybrid.dense_output import EventDrivenSolution
from lcpimpact.hybrid.forced_variation import EventDrivenMotion, ForcedVariation
from lcpimpact.hybrid.motion import ExactSolution
from lcpimpact.hybrid.variation import Member, Variation, family_of
from lcpimpact.integrators.base import Integrator
from lcpimpact.integrators.event_driven import EventDriven
from lcpimpact.integrators.exact import Exact
from lcpimpact.memo import remembered
from lcpimpact.numbers import positive
from lcpimpact.numerics.double_double import DoubleDouble, stacked
from lcpimpact.problems.base import Problem
from lcpimpact.problems.parameters import changes_at, check_independent, numbers_of, units_of, value_at, with_values
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
from lcpimpact.reading import highest
from lcpimpact.record import Event
from lcpimpact.scheme.impact_laws import name_of_law
from lcpimpact.scheme.structure import Feature
from lcpimpact.simulation import make_integrator, methods_that_take, simulate
from lcpimpact.study.event_order import Group, first_difference, groups_of, marks_of, needed_of, reach_of
from lcpimpact.study.one_sided import Nearby, limit_of
from lcpimpact.study.peaks import Peak, peaks_of
from lcpimpact.study.result import Study, table_lines
from lcpimpact.study.second_derivatives import Gradients, second_derivatives
from lcpimpact.study.uncertainty import Uncertainty, uncertainty_of
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
    hessian : dict of str to DataFrame
        At order 2, for each output d²y/dp dp' by the parameters (np, np).
    asymmetry : float
        Largest difference of a Hessian from its transpose before both were averaged, relative to the second derivatives
        by the sizes of the parameters: what rounding leaves of it. NaN at order 1.
    ranges : DataFrame or None
        Where asked for, one row per parameter: its ``value``, the values ``low`` and ``high`` between which the events
        keep their order, as far as the outputs depend on them, and what happens ``at low`` and ``at high``: "" if nothing
        does up to 100 % of the parameter.
    errors : DataFrame or None
        By ``event-driven``, the estimated errors of the derivatives, one row per output: their changes with a tenth of the
        tolerance of the run, or with the tenfold one near rounding. By ``exact`` they are those of rounding, and there is
        none.
    """

    problem: Problem
    parameters: dict[str, float]
    table: pd.DataFrame
    units: dict[str, str]
    t_end: float
    method: str
    variation: Variation = field(repr=False)
    ranges: pd.DataFrame | None = None
    hessian: dict[str, pd.DataFrame] = field(default_factory=dict)
    asymmetry: float = math.nan
    errors: pd.DataFrame | None = None

    drawn_by = "lcpimpact.plotting.sensitivity:plot_sensitivity"
    title = "Sensitivity of {0.problem.name}"

    def summary(self) -> str:
        """Return the outputs with their derivatives."""
        of = ", ".join(
            f"{name} = {value:g} {self.units.get(name, '')}".rstrip() for name, value in self.parameters.items()
        )
        shown = self.table if (self.table["note"] != "").any() else self.table.drop(columns="note")
        lines = [f"Sensitivity of {self.problem.name} by {self.method}: d/dp at {of}", *table_lines(shown, ".6g")]
        if self.errors is not None:
            lines += ["estimated errors of the derivatives, from a run with another tolerance:"]
            lines += table_lines(self.errors, ".1e")
        if self.differenced:
            lines.append(f"by differences of the equations of motion, of order 6: {', '.join(self.differenced)}")
        for name, second in self.hessian.items():
            lines += [f"d²/dp² of {name}:", *table_lines(second.rename_axis("by").reset_index(), ".6g")]
        if self.hessian:
            lines.append(f"Second derivatives are symmetric to {self.asymmetry:.1g}.")
        if self.ranges is not None:
            lines += [
                "The events that the outputs depend on keep their order between:",
                *table_lines(self.ranges, ".6g"),
            ]
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

    @checked
    def uncertainty(self, deviations: Mapping[str, float] | pd.DataFrame) -> Uncertainty:
        r"""Return the standard deviations of the outputs from those of uncertain parameters, to first order.

        .. math:: \operatorname{cov} y = G \operatorname{cov} p\, G^T, \qquad G = \partial y/\partial p

        Parameters
        ----------
        deviations : mapping of str to float, or DataFrame
            The standard deviations of independent parameters by address, those left out being known; or the covariance
            of parameters, with their addresses as index and columns, as `lcpimpact.Fit.covariance`.

        Raises
        ------
        InputError
            For other parameters than those of the derivatives, negative deviations, or what is no covariance.

        Examples
        --------
        The instant sqrt(2 H/g) of an impact, if H is known to 2 cm and g to 0.01 m/s².

        >>> from lcpimpact import load_problem, sensitivity
        >>> found = sensitivity(load_problem("bouncing-ball"), ["H", "g"], ["impact:1"], t_end=0.6)
        >>> found.uncertainty({"H": 0.02, "g": 0.01}).table.round(6)
             output unit     value  deviation         H        g
        0  impact:1    s  0.451524   0.004521  0.004515 -0.00023
        """
        return uncertainty_of(self.problem.name, self.method, self.parameters, self.table, deviations)

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
        return Outputs(self.variation).samples(np.minimum(times, self.t_end))[1]


@checked
def sensitivity(
    problem: Problem,
    wrt: str | Sequence[str],
    outputs: str | Sequence[str],
    *,
    method: str | Integrator = "auto",
    t_end: float | None = None,
    order: int = 1,
    side: Literal["left", "right"] | None = None,
    ranges: bool = False,
) -> Sensitivity:
    r"""Differentiate outputs of a run with respect to parameters, across impacts, contacts, friction and relays.

    With A the generator of a mode, c the row whose zero ends it, R the jump of the state there, and f⁻ and f⁺ its rates,

    .. math:: X_p' = A X_p + A_p X, \qquad t_p = -\frac{c\, X_p + c_p X^-}{c \cdot f^-}, \qquad
              X_p^+ = R\, (X_p^- + f^- t_p) + R_p X^- - f^+ t_p .

    By ``exact`` the derivatives are exact to rounding. By ``event-driven`` they are integrated beside a motion with
    non-linear springs and dashpots, general forces and any loads, at a tenth of the tolerance of the run; their changes
    with a tenth of its ``rtol``, 1e-9 by default, are the ``errors`` of the result.

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
        ``R.impact:1.impulse``, ``x@2.0``, ``peak_force``, ``dissipated``.
    method : str or Integrator
        ``exact`` or ``event-driven``, as ``EventDriven(rtol=1e-12)`` for more digits; by default ``exact`` where it handles
        the problem, and ``event-driven`` elsewhere. The result says which.
    t_end : float, optional
        End in s; by default that of the problem.
    order : int
        1, or 2 for second derivatives too: differences of order 6 of the derivatives between six neighbouring values of each
        parameter with the same order of events. Their error is some 1e-11, and ``asymmetry`` is a measure of it.
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
    >>> twice = sensitivity(load_problem("bouncing-ball"), ["H"], ["impact:1"], t_end=0.6, order=2)
    >>> float(twice.hessian["impact:1"].loc["H", "H"].round(9))  # -√(2/g)/4
    -0.11288091

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
    if order not in (1, 2):
        raise InputError(f"order = {order!r} must be 1, or 2 for second derivatives too")
    if order == 2 and side is not None:
        raise InputError(f"order = 2 and side = {side!r}: second derivatives are those to both sides; leave one out")
    values = {name: value_at(problem, name) for name in names}
    check_independent(problem, names)
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
    sizes = sizes_of(problem, values, units)
    rows, variation = _rows(problem, run, values, sizes, asked, side)
    result = Sensitivity(problem, values, rows, units, float(end), chosen.name, variation)
    if isinstance(chosen, EventDriven):
        there, _ = _rows(problem, _run(problem, _other_tolerance(chosen), end), values, sizes, asked, side)
        result = replace(result, errors=rows[["output"]].join((rows[names] - there[names]).abs()))
    if ranges:
        result = replace(result, ranges=_ranges(problem, values, sizes, run, asked))
    return _with_hessian(result, chosen, sizes) if order == 2 else result


def _rows(
    problem: Problem,
    run: Trajectory,
    values: Mapping[str, float],
    sizes: Mapping[str, float],
    asked: Sequence[str],
    side: Literal["left", "right"] | None,
) -> tuple[pd.DataFrame, Variation]:
    """Return the table of a `Sensitivity`, of a run, and the derivatives of its state."""
    names, method, end = list(values), run.integrator, float(run.t[-1])
    assert method is not None
    known = outputs_of(run, changes_at(problem, names), values, sizes)
    quantities = [quantity(name, problem) for name in asked]
    measured = np.array([known.value(name, run) for name in asked])
    if side is None:
        found = [known.derivative(name, run) for name in asked]
    else:
        sign = 1.0 if side == "right" else -1.0
        by_names = [_one_sided(problem, method, name, sign * sizes[name], asked, measured, end) for name in names]
        note = ONE_SIDED if any(limits for _, limits in by_names) else ""
        found = [(np.array([slopes[j] for slopes, _ in by_names]), note) for j in range(len(asked))]
    rows = []
    for of, value, (derivative, note) in zip(quantities, measured.tolist(), found, strict=True):
        row = dict(zip(names, (derivative + 0.0).tolist(), strict=True))
        rows.append({"output": of.name, "unit": of.unit, "value": value, **row, "note": note})
    return pd.DataFrame(rows), known.variation


def _order_of(problem: Problem, variation: Variation, outputs: Sequence[str], end: float) -> list[Group]:
    """Return the order of the events, up to the last that an output depends on."""
    return groups_of(needed_of(marks_of(problem, variation.events, end, outputs), outputs))


def _with_hessian(found: Sensitivity, method: Integrator, sizes: Mapping[str, float]) -> Sensitivity:
    """Return derivatives with the second ones."""
    names, outputs, end = list(found.parameters), found.table["output"].tolist(), found.t_end
    make = changes_at(found.problem, names)

    def beside(name: str, change: float) -> Gradients:
        values = {**found.parameters, name: found.parameters[name] + change}
        run = _run(make(values), method, end)
        known = outputs_of(run, make, values, sizes)
        slopes = np.array([known.derivative(each, run)[0] for each in outputs])
        return Gradients(slopes, _order_of(run.problem, known.variation, outputs, end))

    here = Gradients(found.table[names].to_numpy(), _order_of(found.problem, found.variation, outputs, end))
    columns = [second_derivatives(partial(beside, name), here, name, sizes[name]) for name in names]
    H = np.stack(columns, axis=2)
    p = np.array([sizes[name] for name in names])
    scaled = H * np.outer(p, p)
    size = np.abs(scaled).max(axis=(1, 2), initial=0.0, keepdims=True)
    apart = np.abs(scaled - scaled.transpose(0, 2, 1)) / np.where(size > 0.0, size, 1.0)
    both = 0.5 * (H + H.transpose(0, 2, 1))
    tables = {name: pd.DataFrame(each, names, names) for name, each in zip(outputs, both, strict=True)}
    return replace(found, hessian=tables, asymmetry=float(apart.max(initial=0.0)))


def _one_sided(
    problem: Problem,
    integrator: Integrator,
    name: str,
    size: float,
    outputs: Sequence[str],
    measured: Array,
    end: float,
) -> tuple[Array, bool]:
    """Return the derivatives (m,) of outputs by a parameter to the side of the sign of its size, and if they are limits."""

    def at(change: float) -> tuple[Problem, pd.DataFrame, Variation]:
        there = with_values(problem, {name: value_at(problem, name) + change}) if change else problem
        values = {name: value_at(there, name)}
        sizes = sizes_of(there, values, units_of(there, values))
        return there, *_rows(there, _run(there, integrator, end), values, sizes, outputs, None)

    def beside(change: float) -> Nearby:
        there, table, variation = at(change)
        order = _order_of(there, variation, outputs, end)
        return Nearby(table["value"].to_numpy(), table[name].to_numpy(), order)

    try:
        _, table, _ = at(0.0)
        if not (table["note"] == AT_EVENT).any():
            return table[name].to_numpy(), False
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


def outputs_of(
    run: Trajectory,
    make: Callable[[Mapping[str, float]], Problem],
    values: Mapping[str, float],
    sizes: Mapping[str, float],
) -> Outputs:
    """Return the derivatives of the outputs of a run by ``exact`` or ``event-driven``.

    Parameters
    ----------
    run : Trajectory
    make : callable
        Returns its problem with other values of the parameters.
    values, sizes : mapping of str to float
        The value of each parameter, and its size, above zero.

    Raises
    ------
    InputError
        If a parameter cannot be changed.
    UnsupportedError
        If the structure of the problem changes with a parameter.
    """
    assert run.dense is not None
    solution, integrator = run.dense.solution, run.integrator
    if isinstance(solution, ExactSolution):
        family = family_of(solution.system, run.problem, make, values, sizes)
        return Outputs(Variation(solution, family))
    assert isinstance(solution, EventDrivenSolution)
    assert isinstance(integrator, EventDriven)
    family = family_of(solution.forced.system, run.problem, make, values, sizes, solution.forced)
    motion = EventDrivenMotion.of(solution, family.base.state.hi, run.events, float(run.t[-1]))
    variation = ForcedVariation(
        solution=motion, family=family, solver=integrator.ode_solver, rtol=integrator.rtol,
        max_step=integrator.max_step,
    )  # fmt: skip
    return Outputs(variation)


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
        raise UnsupportedError(
            f"sensitivity: derivatives are those of the motion, not of runs by {integrator.name!r}, whose own converge to "
            "wrong numbers across impacts unless the method locates these (convergence with gradient= measures it): ",
            ("exact", "event-driven"),
        )
    if what := problem.dynamics.features.get(Feature.LAGRANGIAN):
        raise UnsupportedError(
            f"sensitivity: {problem.name!r} has {Feature.LAGRANGIAN.value} ({what}), and derivatives of such a motion are "
            "not computed: take differences of its runs by 'event-driven', as fit does"
        )
    if problem.dynamics.has_other_impact_law:
        raise UnsupportedError(
            f"sensitivity: {problem.name!r} has impact_law={name_of_law(problem.dynamics.impact_law)!r}, and derivatives "
            "are those of impacts by Newton's law: leave it out, or take differences of runs, as fit does"
        )
    try:
        return simulate(problem, integrator, dt=end / 200, t_end=end, progress=False, error=False)
    except UnsupportedError as refusal:
        others = [name for name in ("exact", "event-driven") if refusal.methods and name != integrator.name]
        raise UnsupportedError(refusal.reason, methods_that_take(problem, others)[:1] if others else ()) from None


def _other_tolerance(method: EventDriven, *, least: float = 1e-11) -> EventDriven:
    """Return the method with a tenth of its tolerance, or with the tenfold one where that is near rounding.

    ``least``: rtol of which a tenth of a tenth, to which derivatives are integrated, is above rounding.
    """
    factor = 0.1 if method.rtol >= least else 10.0
    return replace(method, rtol=factor * method.rtol, atol=None if method.atol is None else factor * method.atol)


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


def sizes_of(problem: Problem, values: Mapping[str, float], units: Mapping[str, str]) -> dict[str, float]:
    """Return the size of each parameter: of one that is 0, the largest of the same unit, or 1."""
    if all(values.values()):
        return {name: abs(value) for name, value in values.items()}
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
class Outputs:
    """The derivatives of outputs, from those of the state."""

    variation: Variation

    def samples(self, times: Array) -> tuple[Array, Array]:
        """Return all series at times of the run (nt, ns), right limits at events, and their derivatives (nt, ns, np)."""
        segments, starts = self.variation.solution.segments, self.variation.starts
        owner = np.maximum(np.searchsorted(starts, times, side="right") - 1, 0)
        found = []
        for k in np.unique(owner):
            mine = np.flatnonzero(owner == k)
            found.append((mine, *self.variation.series(int(k), np.maximum(segments[k].since(times[mine]), 0.0))))
        s = np.empty((len(times), found[0][1].shape[1]))
        s_p = np.empty((*s.shape, self.variation.count))
        for mine, values, derivatives in found:
            s[mine], s_p[mine] = values, derivatives
        return s, s_p

    def jumps(self, until: float) -> list[tuple[float, Array, Array]]:
        """Return the instant of each event up to a time, y⁻ - y⁺ of q, v and r there, and the derivative of the instant."""
        segments = self.variation.solution.segments
        return [
            (
                segments[k].t0,
                self.variation.limit(k, "left")[0] - self.variation.limit(k, "right")[0],
                self.variation.arrival(k - 1).t_p,
            )
            for k in range(1, len(segments))
            if segments[k].t0 <= until
        ]

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
            starts = self.variation.starts[1:]
            close = np.abs(starts - t) <= INSTANT_RTOL * self.variation.solution.end
            return self.samples(np.array([t]))[1][0, names.index(series)], AT_EVENT if close.any() else ""
        if name not in self._extremes:
            raise UnsupportedError(
                f"the derivative of {name!r} is not known: take events, samples or peaks of a series"
            )
        column, sign = self._extremes[name]
        if isinstance(self.variation, ForcedVariation):
            return self._near_peak(column, *highest(run, names[column], sign)), ""
        return self._of_peak(name, self._series([column]), sign), ""

    def value(self, name: str, run: Trajectory) -> float:
        """Return an output; the greatest value of a series by the peaks that its derivative takes."""

        def found() -> float:
            if name in self._extremes and isinstance(self.variation.solution, ExactSolution):
                column, sign = self._extremes[name]
                peaks, size = self._tops(name, self._series([column]), sign)
                value = sign * max(peak.value for peak in peaks)
                return value if abs(value) > np.finfo(float).eps * size else 0.0
            return float(quantity(name, run.problem).measure(run))

        return remembered(self.variation, ("value", name), found)

    @property
    def _extremes(self) -> dict[str, tuple[int, float]]:
        """The column and the sign of the greatest and least values of the series, by name."""
        names = series_names(self.variation.solution.system.dynamics)
        ends = {"max": 1.0, "min": -1.0}
        return {f"{name}.{end}": (i, sign) for i, name in enumerate(names) for end, sign in ends.items()}

    def _instant(self, k: int) -> Array:
        """Return the derivative of the initial instant of segment k."""
        self.variation.start(k)
        return self.variation.instant(k)

    def _of_event(self, event: Event, what: str | None) -> Array:
        """Return the derivative of the instant, the speed or the impulse of an event."""
        variation = self.variation
        d = variation.solution.system.dynamics
        k = variation.started_by(event)
        t_p = self._instant(k)
        if what is None:
            return t_p
        if what == "impulse" and event.impulse == 0.0:
            return np.zeros(variation.count)
        i = [each.name for each in d.forces].index(event.contact)
        if what == "impulse":
            return np.asarray(variation.impulses(k)[1][i])
        n = len(d.nodes)
        at, derivative = variation.limit(k, "right" if event.kind in AFTER else "left")

        def rate(each: Member) -> DoubleDouble:
            """Return the row of the rate of approach or opening, by v and the given motions (n + 1,)."""
            d = each.system.dynamics
            none = np.zeros((len(d.directions), 1))
            return stacked([[d.finely("H"), d.finely("chi")[:, None]], [-d.directions, none]])[i]

        row, v = rate(variation.family.base).hi, np.append(at[n : 2 * n], 1.0)
        sign = math.copysign(1.0, float(row @ v))
        return np.asarray(sign * (row[:n] @ derivative[n : 2 * n] + variation.family.derivative(rate) @ v))

    # ---- peaks --------------------------------------------------------------------------------------------------------

    def _series(self, columns: Sequence[int]) -> _Rows:
        """Return series as functions, by their columns among q, v and r."""
        d, count = self.variation.solution.system.dynamics, self.variation.count
        w = np.eye(2 * len(d.nodes) + len(d.contacts))[columns]
        return _Rows(w, np.zeros(len(w)), np.zeros((count, *w.shape)), np.zeros((count, len(w))))

    def _tops(self, name: str, rows: _Rows, sign: float) -> tuple[list[Peak], float]:
        """Return the peaks of the functions of an output, and their size."""
        variation, solution = self.variation, self.variation.solution
        assert isinstance(solution, ExactSolution)
        return remembered(
            variation, ("peaks", name), lambda: peaks_of(solution, variation.scale, sign * rows.w, sign * rows.w0)
        )

    def _peaks(self, name: str, rows: _Rows, sign: float) -> tuple[list[tuple[Peak, Array]], float]:
        """Return the peaks of the functions of an output with their derivatives, and the size of the functions."""
        peaks, size = self._tops(name, rows, sign)
        found = []
        for peak in peaks:
            if peak.side:
                s, s_p = self.variation.limit(peak.segment + (peak.side == "left"), peak.side)
            else:
                s, s_p = (each[0] for each in self.samples(np.array([peak.t])))
            found.append((peak, rows.derivative(peak.function, s, s_p)))
        return found, size

    def _of_peak(self, name: str, rows: _Rows, sign: float, *, agree_rtol: float = 1e-7) -> Array:
        """Return the derivative of the greatest value of functions, or the least; of equal peaks, if theirs are the same.

        ``agree_rtol``: difference of derivatives that are the same, relative to the larger, or to the size of the
        functions over that of the parameter.
        """
        peaks, size = self._peaks(name, rows, sign)
        slopes = np.array([slope for _, slope in peaks])
        apart = np.ptp(slopes, axis=0) > agree_rtol * (np.abs(slopes).max(axis=0) + size / self.variation.family.sizes)
        if apart.any():
            order = np.argsort(slopes[:, np.argmax(apart)])
            raise self._tie(name, [peaks[order[0]][0], peaks[order[-1]][0]])
        return np.asarray(slopes[0])

    def _near_peak(self, row: int, t: float, value: float) -> Array:
        """Return the derivative of a peak of a series of an event-driven run, found near t."""
        solution = self.variation.solution
        starts = np.append(self.variation.starts, solution.end)
        near = int(np.argmin(np.abs(starts - t)))
        if near < len(solution.segments) and abs(starts[near] - t) <= INSTANT_RTOL * solution.end:
            # At an event the peak moves with it, and is on the side of the greater value.
            sides = [self.variation.limit(near, side) for side in (("left", "right") if near else ("right",))]
            return np.asarray(min(sides, key=lambda side: abs(side[0][row] - value))[1][row])
        assert isinstance(self.variation, ForcedVariation)
        return np.asarray(self.samples(np.array([self.variation.stationary(row, t)]))[1][0, row])

    def _tie(self, name: str, peaks: Sequence[Peak]) -> UnsupportedError:
        first, second = sorted(each.t for each in peaks)
        return UnsupportedError(
            f"{name} is reached at t = {first:g} s and at {second:g} s alike, where it has one-sided derivatives only: "
            "change a parameter a little"
        )

    # ---- quantities of the whole run ------------------------------------------------------------------------------------

    def _of_summary(self, name: str, run: Trajectory) -> Array:
        """Return the derivative of a quantity of the whole run."""
        if math.isnan(self.value(name, run)):
            raise InputError(
                f"outputs: {name!r} is not in the run up to {run.t[-1]:g} s: take another, or a later t_end"
            )
        if isinstance(self.variation, ForcedVariation):
            raise InputError(
                f"outputs: {name!r} has a derivative by exact only: take instants and speeds of events, or R.max"
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
        begin = None if touch.closing is None else self.variation.started_by(touch.closing)
        end = None if touch.opening is None else self.variation.started_by(touch.opening)
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
        s, s_p = self.variation.limit(k or 0, side)
        rate = gaps_of_bodies(self.variation.solution.system.dynamics).hi[column]
        rate_p = self.variation.family.derivative(lambda each: gaps_of_bodies(each.system.dynamics)[column])
        return np.asarray(rate @ s_p[n : 2 * n] + rate_p @ s[n : 2 * n])

    def _of_peak_time(self, name: str, rows: _Rows) -> Array:
        """Return the derivative of the instant of the greatest value of functions; y' = 0 there, or it is at an event."""
        variation = self.variation
        peaks = self._tops(name, rows, 1.0)[0]
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
        def approach(each: Member) -> DoubleDouble:
            rows, none = gaps_of_bodies(each.system.dynamics)[compliant], np.zeros((1, len(d.nodes)))
            rest = np.zeros((len(rows) + 1, len(d.nodes) + len(d.contacts)))
            return stacked([[stacked([[-rows], [none]]), rest]])

        def at_rest(each: Member) -> DoubleDouble:
            u0 = each.system.dynamics.finely("u0")[compliant]
            return stacked([[-u0[None], np.zeros((1, 1))]])[0]

        base = family.base
        rows = _Rows(approach(base).hi, at_rest(base).hi, family.derivative(approach), family.derivative(at_rest))
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
        C, C_p = d.C, family.derivative(lambda each: each.system.dynamics.finely("C"))
        H, H_p = d.H, family.derivative(lambda each: each.system.dynamics.finely("H"))

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
                sides = [self.variation.limit(k, side) for side in ("left", "right")]
                v, v_p = (sum(each[j][n : 2 * n] for each in sides) / 2.0 for j in range(2))
                found = found - (H @ v @ P_p + P @ H @ v_p + H_p @ v @ P)
        return found

    def _integral(self, run: Trajectory, y: Callable[[Array], Array], y_p: Callable[[Array, Array], Array]) -> Array:
        """Return the derivative (np,) of ∫ y dt over the run, of a function y (nt,) of q, v and r with y_p (nt, np)."""
        assert run.dense is not None
        pieces = pieces_of(run, run.dense)
        found = pieces.each(y_p(*self.samples(pieces.times))).sum(axis=0)
        for k in range(1, len(self.variation.solution.segments)):
            before, after = (y(self.variation.limit(k, side)[0][None])[0] for side in ("left", "right"))
            found = found + (before - after) * self._instant(k)
        return np.asarray(found)
