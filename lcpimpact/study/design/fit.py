r"""Parameters of any scheme fitted to a measured curve or to target outputs, with their uncertainty.

The parameters p minimise the sum of squares of

.. math:: r_i = \frac{y(t_i; p) - y_i}{σ}

with y a coordinate, velocity or reaction of the run. An unknown σ is estimated from the residuals of the best fit,
``s² = Σ r²/(N - n)``, and with the Jacobian J of r

.. math:: \operatorname{cov} p = s^2 (J^T J)^{-1}, \qquad p_j \pm t_{N-n} \sqrt{\operatorname{cov}_{jj}},

with Student's quantile t. N counts the numbers that depend on a parameter: the initial state among the data does not, and
tells nothing of the noise. If s² over these numbers is smaller than over all, that over all is taken. A curve that the fit
gives has the same uncertainty by the delta method: with its Jacobian G with respect to the parameters,

.. math:: y(t) \pm t_{N-n} \sqrt{G \operatorname{cov} p\, G^T}, \qquad
          y(t) \pm t_{N-n} \sqrt{σ^2 + G \operatorname{cov} p\, G^T},

the band of the curve and that of a further reading.

Parameters with positive start values are fitted by their logarithms, so they and their intervals stay positive. Each of
several series, and one beside targets of known σ, is weighted by its residual scatter: first in a fit without those targets,
then in fits to all.

*The Jacobian* of runs by ``exact`` is that of the motion (`lcpimpact.study.sensitivity`), from one run: across impacts,
contacts, friction and relays. It is of differences of runs where the motion has no derivative, as at a grazing or after
impacts that accumulate, for targets whose measure is a function, and for methods that locate impacts. A step of the other
methods that stays in its cell does not move with its impact, so differences of their runs converge to wrong numbers: where a
body strikes, J is that of the exact motion with the same parameters, beside the residuals of the method. `Fit.derivatives`
says which.

*Jumps.* A velocity jumps at an impact, and a reaction where a contact closes against a dashpot, at an instant that
depends on the parameters. A sample is compared with the run on its side of the jump, and J is the derivative of that
branch: the sum of squares is smooth until the instant passes a sample, and jumps then. What the jump itself tells of
the instant, that it lies between two samples, counts nothing in the intervals, and there is a minimum on either side of
it. Differences of runs are taken to both sides, and where they disagree the smaller is used, which has not crossed the
jump. With ``sampling="mean"`` the run is averaged over the cell of each sample, which is continuous in the parameters:
appropriate for a sensor no faster than its sampling, biased for a faster one.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from scipy.optimize import OptimizeResult, least_squares
from scipy.stats import norm
from scipy.stats import t as student

from lcpimpact.arguments import check_fields, checked
from lcpimpact.arrays import Array, Indices
from lcpimpact.errors import FailureError, InputError, UnsupportedError
from lcpimpact.integrators.base import Integrator, Option
from lcpimpact.integrators.exact import Exact
from lcpimpact.numbers import count, finite, is_real, positive, random_numbers
from lcpimpact.problems.base import Problem
from lcpimpact.problems.parameters import changes_at, check_independent, units_of, value_at
from lcpimpact.quantities import quantity, series_names
from lcpimpact.reading import read
from lcpimpact.registry import nearest
from lcpimpact.simulation import RUN_ARGUMENTS, check_lcp_solver, make_integrator, simulate
from lcpimpact.study.design.curves import CurveTable
from lcpimpact.study.progress import Progress, watched
from lcpimpact.study.result import Study, failed_rows
from lcpimpact.study.sensitivity import Outputs, outputs_of, sizes_of
from lcpimpact.trajectory import Trajectory
from lcpimpact.units import is_alike

GAUSS_NODES, GAUSS_WEIGHTS = np.polynomial.legendre.leggauss(4)

SAMPLES, STEPS = 200, 2000
"""Default numbers of output points of methods whose error does not depend on dt, and of steps of all others."""

XTOL, MAX_STEPS = 1e-7, 100
"""Tolerance of the parameters of a least-squares search, and its maximum number of steps."""

FAILURE_RESIDUAL = 1e6
"""Residual of a run that fails."""

WEIGHINGS = 3
"""Number of searches by which the noise of each series is estimated, each with the weights that the one before gives."""

ENDINGS = {
    0: f"The search stopped after {MAX_STEPS} steps: start it nearer, set bounds, or take more starts.",
    1: "The search has converged: no small change of the parameters reduces the sum of squares.",
    2: "The search has converged: the sum of squares falls no further.",
    3: "The search has converged: the parameters change no further.",
    4: "The search has converged: the sum of squares falls no further, and the parameters change no further.",
}
"""The end of a search by SciPy's number of it, ``OptimizeResult.status``: no step left, gtol, ftol, xtol, both."""

LOSSES = ("linear", "soft_l1", "huber", "cauchy", "arctan")
SAMPLINGS = ("point", "mean")


@dataclass(frozen=True)
class Target:
    """A target value of an output of a run.

    Attributes
    ----------
    measure : str or callable   name of an output (`lcpimpact.quantities`), as "R.max"; or a function that takes a
                                Trajectory and returns the number, for which `lcpimpact.reading` has the means
    value : float               target value
    sigma : float, optional     its uncertainty in the same unit; by default its magnitude, for equal weights
    """

    measure: str | Callable[[Trajectory], float]
    value: float
    sigma: float | None = None

    def __post_init__(self) -> None:
        check_fields(self)
        finite("Target: value", self.value)
        if self.sigma is not None:
            positive("Target: sigma", self.sigma)

    @property
    def scale(self) -> float:
        """Scale of the error."""
        return self.sigma or abs(self.value) or 1.0

    def shown_by(self, run: Trajectory) -> float:
        """Return the number of a run.

        Raises
        ------
        FailureError
            If the run has no such number.
        """
        if callable(self.measure):
            return float(self.measure(run))
        found = float(quantity(self.measure, run.problem).measure(run))
        if math.isnan(found):
            raise FailureError(f"the run has no {self.measure!r}", run)
        return found


@dataclass(frozen=True, eq=False, repr=False)
class Fit(Study):
    """The result of a fit.

    Attributes
    ----------
    problem : Problem           with the fitted values
    run : Trajectory            of that problem
    table : DataFrame           one row per parameter: parameter, unit, start, value, standard_error, low, high (SI)
    correlation : DataFrame     correlation of the parameters, between -1 and 1; nan if unknown
    residuals : DataFrame       one row per data value: series, t (s; nan for a target), measured, fitted, residual
    band : DataFrame            the curves between them: series, t, fitted, low, high of the curve, reading_low, reading_high
    starts : DataFrame          one row per start: the start values, cost (half the sum of squares), failure
    level : float               confidence level of the intervals low ... high
    freedom : int               degrees of freedom: numbers that depend on a parameter, less the parameters
    success : bool              whether the search converged
    message : str               description of the end of the search
    origin : str                which columns of the data are the series, in which units, where that is not plain
    notes : tuple of str        warnings: parameters without influence, meaningless intervals, a run unlike the data
    derivatives : str           what the Jacobian is of: the exact motion, or differences of runs, and why
    evaluations : int           number of runs
    """

    problem: Problem
    run: Trajectory
    table: pd.DataFrame
    correlation: pd.DataFrame
    residuals: pd.DataFrame
    band: pd.DataFrame
    starts: pd.DataFrame
    level: float
    freedom: int
    success: bool
    message: str
    origin: str = ""
    notes: tuple[str, ...] = ()
    derivatives: str = ""
    evaluations: int = 0

    drawn_by = "lcpimpact.plotting.design:plot_fit"
    title = "Fit"

    @property
    def values(self) -> dict[str, float]:
        """The fitted value of each parameter."""
        return dict(zip(self.table["parameter"], self.table["value"], strict=True))

    @property
    def intervals(self) -> dict[str, tuple[float, float]]:
        """The interval of each parameter."""
        ends = zip(self.table["low"], self.table["high"], strict=True)
        return dict(zip(self.table["parameter"], ends, strict=True))

    @property
    def covariance(self) -> pd.DataFrame:
        """The covariance of the parameters, in SI units, for `lcpimpact.Sensitivity.uncertainty`; nan if unknown."""
        errors = self.table["standard_error"].to_numpy()
        with np.errstate(invalid="ignore"):
            return self.correlation * np.outer(errors, errors)

    @property
    def rms(self) -> dict[str, float]:
        """The root of the mean square of the residuals of each curve, in its unit."""
        curves = self.residuals.dropna(subset="t").groupby("series", sort=False)["residual"]
        return {str(name): float(np.sqrt(np.mean(each**2))) for name, each in curves}

    @property
    def failures(self) -> pd.DataFrame:
        """The starts whose search failed, with the reason in the column ``failure``."""
        return failed_rows(self.starts)

    def head(self) -> list[str]:
        """Return the problem and the number of data values."""
        counts = f"{len(self.residuals)} numbers, {len(self.table)} parameters"
        return [f"Fit of {self.problem.name}: {counts}, {self.level:.0%} intervals"]

    def summary(self) -> str:
        """Return each parameter with its standard error, unit and interval, how the data were read, and the warnings."""
        rows = [
            f"  {row.parameter:<16} {f'{row.value:.8g} ± {row.standard_error:.2g} {row.unit}'.rstrip()}, "
            f"{row.low:.6g} ... {row.high:.6g}"
            for row in self.table.itertuples()
        ]
        sizes = [f"{size:.3g} {self.problem.unit(name)} in {name}" for name, size in self.rms.items()]
        said = [f"data: {self.origin}"] if self.origin else []
        said += [f"RMS residual: {', '.join(sizes)}"] if sizes else []
        said += [f"derivatives: {self.derivatives}"] if self.derivatives else []
        return "\n".join([*self.head(), *rows, *(f"  {line}" for line in (*said, self.message, *self.notes))])


@checked
def fit(
    problem: Problem | Callable[..., Problem],
    free: Sequence[str] | Mapping[str, float],
    data: str | Path | pd.DataFrame | None = None,
    *,
    column: str | Sequence[str] | Mapping[str, str] | None = None,
    time: str | None = None,
    units: Mapping[str, str] | None = None,
    decimal: str | None = None,
    outputs: Mapping[str, Target] | None = None,
    sigma: float | None = None,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    sampling: str = "point",
    loss: str = "linear",
    method: str | Integrator = "exact",
    dt: float | None = None,
    t_end: float | None = None,
    lcp_solver: str = "auto",
    starts: int = 1,
    seed: int = 0,
    level: float = 0.95,
    progress: Progress = True,
    **method_options: Option,
) -> Fit:
    r"""Fit parameters of a problem to a measured curve, to target outputs, or to both, by least squares.

    Parameters
    ----------
    problem : Problem or callable
        A problem, or a function that takes the free parameters by name and returns one.
    free : sequence of str, or mapping of str to float
        Addresses of the parameters to fit (`lcpimpact.problems.parameters`: ``k``, ``KelvinVoigt.c``, ``2.k``,
        ``v0.x``), which start from the values of the problem; or each with its start value.
    data : path or DataFrame, optional
        A table, or a file as `lcpimpact.read_curves` reads it: CSV or .xlsx, with an increasing column of times and columns
        named like the series of a run (``R``, ``x``, ``v_x``), with units in the header or in the SI. A file of
        `Trajectory.save` is accepted: its reactions are read at t_R.
    column : str, sequence of str, or mapping of str to str, optional
        Columns to fit; or the column of each series, ``{"R": "Kraft"}``; by default all that are named as one.
    time, units, decimal
        The column of times, units of columns, and the decimal mark, as of `lcpimpact.read_curves`.
    outputs : mapping of str to Target, optional
        Target outputs.
    sigma : float, optional
        Standard deviation of the noise of the data, in their unit. Without it, it is estimated from the residuals.
    bounds : mapping of str to (float, float), optional
        Minimum and maximum of parameters.
    sampling : {"point", "mean"}
        Compare the run at the samples, or its mean over the cell about each, for forces that jump.
    loss : {"linear", "soft_l1", "huber", "cauchy", "arctan"}
        Robust losses reduce the weight of residuals above the median; intervals are then approximate.
    method, dt, t_end, lcp_solver, **method_options
        Arguments of the simulation; by default ``exact`` to the end of the data. Where a body strikes in runs by a method
        that does not locate impacts, the derivatives are those of the exact motion.
    starts : int
        Number of searches: the first from the start values, others from random ones, log-normal about them or uniform in
        the bounds.
    seed : int
        Seed of the random starts.
    level : float
        Confidence level of the intervals.
    progress : bool or callable
        As in `lcpimpact.study.progress`.

    Returns
    -------
    Fit
        Best of the searches.

    Raises
    ------
    InputError
        For invalid parameters, data or settings, each named; or if the run at the start values fails.
    UnsupportedError
        If the method does not handle the problem; or if a body strikes, the method does not locate impacts, and ``exact``
        does not handle the problem.

    Notes
    -----
    There may be several local minima: use several ``starts``. Intervals are those of the linearised problem. Beside a
    velocity sample near an impact the sum of squares jumps; see the module's *Jumps* for what is compared.

    Examples
    --------
    >>> from lcpimpact import load_problem, simulate
    >>> truth = simulate(load_problem("kelvin-voigt-impact", k=3000.0), "exact", dt=0.01, t_end=0.4)
    >>> data = pd.DataFrame({"t": truth.t, "R": truth["R"]})
    >>> found = fit(load_problem("kelvin-voigt-impact"), ["k", "c"], data)
    >>> {name: round(value, 4) for name, value in found.values.items()}
    {'k': 3000.0, 'c': 250.0}

    References
    ----------
    Bates and Watts, *Nonlinear Regression Analysis and Its Applications* (1988), chapter 2.
    """
    _check_settings(sampling, loss, starts, level, sigma)
    integrator = make_integrator(method, method_options, RUN_ARGUMENTS)
    check_lcp_solver(integrator, lcp_solver)
    parameters = _Parameters.of(problem, free, bounds or {})
    try:
        first = parameters.problem(parameters.start)
    except InputError as error:
        raise InputError(f"fit: the start values make no problem: {error}") from None
    curves, origin = ([], "") if data is None else _curves(first, data, column, time, units or {}, decimal)
    measured = _Measured.of(curves, outputs or {}, sampling, sigma)
    end = t_end or measured.last or first.t_end
    _check_measured(measured, parameters, first, end)
    h = dt or end / (SAMPLES if math.isinf(integrator.declared.order_smooth) else STEPS)

    def run(problem: Problem, method: Integrator) -> Trajectory:
        if method is integrator:
            return simulate(problem, method, dt=h, t_end=end, lcp_solver=lcp_solver, progress=False)
        return simulate(problem, method, dt=end / SAMPLES, t_end=end, progress=False)

    known = units_of(first, parameters.names) if isinstance(problem, Problem) else {}
    sizes = sizes_of(first, dict(zip(parameters.names, parameters.given, strict=True)), known)

    weigh = sigma is None and measured.differ and sum(len(t) for _, t in measured.curves) > len(parameters.names)
    model = _Model(parameters, measured.without_known_targets() if weigh else measured, integrator, run, sizes)
    model.check_start()
    begun = parameters.starts(starts, seed)
    results = [model.search(θ, loss) for θ in watched(begun, starts, "searches", progress)]
    rows = [model.row(θ, found) for θ, found in zip(begun, results, strict=True)]
    number = int(np.argmin([float(each.cost) for each in results]))
    best = results[number]
    if weigh:
        for _ in range(WEIGHINGS):
            model.measured = measured = measured.weighed(best.fun)
            best = model.search(best.x, loss)
    last = model.run_at(best.x)
    fitted = last.problem
    errors = _Errors.of(best, parameters, measured.known, level, loss)
    errors.table.insert(1, "unit", [known.get(name, "") for name in parameters.names])
    compared = measured.compared(last)
    shifted = _shifted(errors.table, model.shift(best) * parameters.scale(best.x), integrator.name)
    return Fit(
        problem=fitted, run=last, table=errors.table, correlation=errors.correlation, residuals=compared,
        band=model.band(best.x, last, errors), starts=pd.DataFrame(rows), level=level,
        freedom=errors.freedom, success=bool(best.success) and rows[number]["failure"] == "",
        message=_ending(best), origin=origin, notes=(*errors.notes, *_unlike(compared), *shifted),
        derivatives=model.said(best), evaluations=model.evaluations,
    )  # fmt: skip


def _ending(found: OptimizeResult) -> str:
    """Return the end of a search in words."""
    return ENDINGS.get(found.status, str(found.message))


def _unlike(compared: pd.DataFrame, *, spread: float = 0.5, rounding_rtol: float = 1e-10) -> list[str]:
    """Return a warning for each curve that the run does not follow.

    ``spread``: size of the residuals, relative to the standard deviation of the data, from which on it does not.
    ``rounding_rtol``: size of the residuals, relative to the largest datum, that is rounding.
    """
    found = []
    for name, rows in compared.dropna(subset="t").groupby("series", sort=False):
        size, scatter = float(np.sqrt(np.mean(rows["residual"] ** 2))), float(np.std(rows["measured"]))
        if size > spread * scatter + rounding_rtol * float(np.abs(rows["measured"]).max()):
            found.append(
                f"The model does not follow the data: the RMS residual of {name} is {size:.3g}, and the standard deviation "
                f"of the data is {scatter:.3g}."
            )
    return found


def _shifted(table: pd.DataFrame, shifts: Array, method: str, *, large: float = 0.25) -> list[str]:
    """Return a warning for each parameter that the steps of a method shift.

    ``large``: shift from which on, in standard errors.
    """
    rows = zip(table["parameter"], shifts, table["standard_error"], strict=True)
    return [
        f"The steps of {method} shift {name} by {shift:.2g}, and its standard error is {error:.2g}: take a smaller dt, or "
        "method='exact'."
        for name, shift, error in rows
        if abs(shift) > large * error
    ]


def _check_settings(sampling: str, loss: str, starts: int, level: float, sigma: float | None) -> None:
    if sampling not in SAMPLINGS:
        raise InputError(f"fit: {nearest(str(sampling), list(SAMPLINGS), 'sampling')}")
    if loss not in LOSSES:
        raise InputError(f"fit: {nearest(str(loss), list(LOSSES), 'loss')}")
    count("fit: starts", starts)
    if not is_real(level) or not 0.0 < level < 1.0:
        raise InputError(f"fit: level = {level!r} must lie between 0 and 1, as 0.95")
    if sigma is not None:
        positive("fit: sigma", sigma)


def _check_measured(measured: _Measured, parameters: _Parameters, problem: Problem, t_end: float) -> None:
    """Reject fewer data values than parameters, targets that are no numbers, and a run that ends before the data."""
    if len(measured.values) < len(parameters.names):
        raise InputError(
            f"fit: {len(measured.values)} numbers cannot determine {len(parameters.names)} parameters: give more data, or "
            "free fewer"
        )
    for of in (quantity(each.measure, problem) for each in measured.targets if isinstance(each.measure, str)):
        if of.series:
            raise InputError(f"fit: the target {of.name!r} is a curve: take {of.name}.max or {of.name}@{t_end:g}")
        if of.until > t_end:
            raise InputError(
                f"fit: the target {of.name!r} lies after the end of the run, {t_end:g} s: run longer with t_end"
            )
    if measured.last > t_end:
        raise InputError(
            f"fit: the data last until {measured.last:g} s, and t_end = {t_end:g} s: run longer, or cut the data"
        )


@dataclass(eq=False)
class _Model:
    """The fitted quantities as a function of θ, by counted runs.

    Attributes
    ----------
    run : callable              takes a problem and a method, and returns the run
    sizes : mapping             the size of each parameter at the start
    evaluations : int           number of runs
    jacobians, differenced      number of Jacobians, and of those by differences of runs
    derivatives : str           what the last one is of, as of `Fit`
    reason : str                why the last one by differences is
    """

    parameters: _Parameters
    measured: _Measured
    integrator: Integrator
    run: Callable[[Problem, Integrator], Trajectory]
    sizes: Mapping[str, float]
    evaluations: int = 0
    jacobians: int = 0
    differenced: int = 0
    derivatives: str = ""
    reason: str = ""
    runs: dict[str, tuple[bytes, Trajectory]] = field(default_factory=dict)
    known: tuple[bytes, Outputs] | None = None

    def run_at(self, θ: Array, method: Integrator | None = None) -> Trajectory:
        """Return the run with these parameters, by default by the method of the fit; the last one of a method is kept."""
        method = method or self.integrator
        key, found = self.runs.get(method.name, (b"", None))
        if found is None or key != θ.tobytes():
            self.evaluations += 1
            found = self.run(self.parameters.problem(θ), method)
            self.runs[method.name] = (θ.tobytes(), found)
        return found

    def residuals(self, θ: Array) -> Array:
        """Return r (N,), large where the run fails."""
        try:
            return (self.measured.shown_by(self.run_at(θ)) - self.measured.values) / self.measured.scales
        except (InputError, FailureError):
            return np.full(len(self.measured.values), FAILURE_RESIDUAL)

    def jacobian(self, θ: Array) -> Array:
        """Return ∂r/∂θ (N, n), zero where the run fails."""
        scales = self.measured.scales
        try:
            return self.slopes(
                θ,
                lambda run: self.measured.shown_by(run) / scales,
                lambda outputs, run: self.measured.slopes(outputs, run) / scales[:, None],
            )
        except (InputError, FailureError):
            return np.zeros((len(scales), len(θ)))

    def slopes(
        self, θ: Array, values: Callable[[Trajectory], Array], slopes: Callable[[Outputs, Trajectory], Array]
    ) -> Array:
        """Return the derivatives (N, n) of values of a run with respect to θ.

        Parameters
        ----------
        θ : (n,) array
        values : callable
            Returns the values of a run (N,), in their scales.
        slopes : callable
            Returns their derivatives with respect to the parameters, from those of the outputs of an exact run.
        """
        method, reason = self.integrator, ""
        self.jacobians += 1
        if misled := self.misled(θ):
            method = Exact()
        if isinstance(method, Exact):
            run = self._exact_run(θ) if misled else self.run_at(θ)
            try:
                found = slopes(self._outputs(θ, run), run)
            except UnsupportedError as error:
                reason = str(error).rpartition(": ")[0]
            except InputError as error:
                reason = str(error)
            else:
                wrong = f", as differences of runs by {self.integrator.name} converge to wrong numbers across impacts"
                self.derivatives = f"of the exact motion{wrong * misled}"
                return found * self.parameters.scale(θ)
        self.differenced += 1
        self.reason = f", since {reason}" if reason else ""
        self.derivatives = f"differences of runs by {method.name}{self.reason}"
        here = values(self.run_at(θ, method))

        def there(θ: Array) -> Array:
            try:
                return values(self.run_at(θ, method))
            except (InputError, FailureError):
                return np.full(len(here), FAILURE_RESIDUAL)

        return jacobian_by_differences(there, θ, self.parameters.limits)

    def misled(self, θ: Array) -> bool:
        """Return whether a body strikes in the run, and the method does not locate impacts."""
        strikes = any(event.kind == "impact" for event in self.run_at(θ).events)
        return strikes and self.integrator.declared.order_impact <= 1.0

    def shift(self, found: OptimizeResult) -> Array:
        """Return the error of θ (n,) that the steps of a method cause that does not locate impacts; zero for others."""
        if not self.misled(found.x):
            return np.zeros(len(found.x))
        try:
            shown = self.measured.shown_by(self.run_at(found.x, Exact()))
        except FailureError:
            return np.zeros(len(found.x))
        exact = (shown - self.measured.values) / self.measured.scales
        return np.asarray(np.linalg.lstsq(found.jac, exact - found.fun, rcond=None)[0])

    def _exact_run(self, θ: Array) -> Trajectory:
        """Return the run by ``exact`` that the derivatives are taken from, where those of the method are wrong."""
        try:
            return self.run_at(θ, Exact())
        except UnsupportedError:
            impacts = [event.t for event in self.run_at(θ).events if event.kind == "impact"]
            raise UnsupportedError(
                f"fit: a body strikes at t = {impacts[0]:g} s, and derivatives of runs by {self.integrator.name} "
                "converge to wrong numbers there, as it does not locate impacts: take method='event-driven' or 'radau-fesd'"
            ) from None

    def _outputs(self, θ: Array, run: Trajectory) -> Outputs:
        """Return the derivatives of the outputs of an exact run; the last ones are kept."""
        if self.known is None or self.known[0] != θ.tobytes():
            names = self.parameters.names
            values = dict(zip(names, self.parameters.values(θ), strict=True))
            sizes = {
                name: abs(values[name]) if log else max(abs(values[name]), self.sizes[name])
                for name, log in zip(names, self.parameters.logarithmic, strict=True)
            }
            self.known = (θ.tobytes(), outputs_of(run, self.parameters.make, values, sizes))
        return self.known[1]

    def band(self, θ: Array, run: Trajectory, errors: _Errors, *, points: int = 400) -> pd.DataFrame:
        """Return the curves of the fit with their bands.

        ``points``: number of instants of each, beside those of the events.
        """
        end = float(run.t[-1])
        t = np.union1d(np.linspace(0.0, end, points + 1), [each.t for each in run.events if each.t <= end])
        scales = self.measured.scales[np.cumsum([0, *(len(times) for _, times in self.measured.curves)])[:-1]]
        rows = [pd.DataFrame(columns=["series", "t", "fitted", "low", "high", "reading_low", "reading_high"])]
        for (series, _), scale in zip(self.measured.curves, scales, strict=True):

            def curve(run: Trajectory, series: str = series, scale: float = scale) -> Array:
                return read(run, series, t) / scale

            def slopes(outputs: Outputs, run: Trajectory, series: str = series, scale: float = scale) -> Array:
                return _sampled(outputs, run, series, t) / scale

            fitted = read(run, series, t)
            G = self.slopes(θ, curve, slopes)
            half = errors.quantile * scale * errors.deviation(G)
            wide = np.hypot(half, errors.quantile * scale * errors.noise)
            ends = {"low": fitted - half, "high": fitted + half}
            ends |= {"reading_low": fitted - wide, "reading_high": fitted + wide}
            rows.append(pd.DataFrame({"series": series, "t": t, "fitted": fitted, **ends}))
        return pd.concat(rows[min(len(rows) - 1, 1) :], ignore_index=True)

    def check_start(self) -> None:
        """Reject start values for which the run fails."""
        try:
            self.measured.shown_by(self.run_at(self.parameters.start))
        except (InputError, FailureError) as error:
            raise InputError(f"fit: the run at the start values fails: {error}") from None

    def search(self, θ: Array, loss: str, *, cost_rtol: float = 1e-10) -> OptimizeResult:
        """Return SciPy's result of the least-squares search from θ, with what its last Jacobian is of.

        ``cost_rtol``: relative change of the sum of squares, and size of its gradient, at which it ends.
        """
        limits = self.parameters.limits
        settings: dict[str, Any] = {
            "jac": self.jacobian, "bounds": limits, "x_scale": np.maximum(np.abs(θ), 1.0), "ftol": cost_rtol, "xtol": XTOL,
            "gtol": cost_rtol, "max_nfev": MAX_STEPS,
        }  # fmt: skip
        found = least_squares(self.residuals, θ, **settings)
        if loss != "linear":
            usual = 1.4826 * float(np.median(np.abs(found.fun)))
            found = least_squares(self.residuals, found.x, loss=loss, f_scale=max(usual, 1e-12), **settings)
        found["derivatives"] = self.derivatives
        return found

    def said(self, found: OptimizeResult) -> str:
        """Return the source of the derivatives of a search, and the number of others by differences, in words."""
        text = str(found["derivatives"])
        if not self.differenced or text.startswith("differences"):
            return text
        return f"{text}; {self.differenced} of {self.jacobians} Jacobians by differences of runs{self.reason}"

    def row(self, θ: Array, found: OptimizeResult) -> dict[str, float | str]:
        """Return the result of a search from θ as a row: the start, the cost, and the reason of failure."""
        failure = "" if found.success else _ending(found)
        if np.abs(found.fun).max() >= FAILURE_RESIDUAL:
            failure = "the run fails"
        start = dict(zip(self.parameters.names, self.parameters.values(θ), strict=True))
        return {**start, "cost": found.cost, "failure": failure}


def jacobian_by_differences(
    residuals: Callable[[Array], Array],
    θ: Array,
    limits: tuple[Array, Array],
    *,
    difference_step: float = 1e-6,
    jump_rtol: float = 0.1,
) -> Array:
    """Return ∂r/∂θ by one-sided differences; where both sides disagree because of a jump, the smaller is used.

    ``difference_step``: relative finite-difference step of the Jacobian (absolute for logarithms of parameters).
    ``jump_rtol``: relative difference of the one-sided differences above which a jump is assumed.
    """
    here, columns = residuals(θ), []
    for j, x in enumerate(θ):
        h = difference_step * max(abs(x), 1.0)
        slopes = []
        for step in (h, -h):
            there = θ.copy()
            there[j] = min(max(x + step, limits[0][j]), limits[1][j])
            if there[j] != x:
                slopes.append((residuals(there) - here) / (there[j] - x))
        ahead, behind = slopes[0], slopes[-1]
        smaller = np.where(np.abs(ahead) < np.abs(behind), ahead, behind)
        jumped = np.abs(ahead - behind) > jump_rtol * np.abs(smaller) + jump_rtol
        columns.append(np.where(jumped, smaller, 0.5 * (ahead + behind)))
    return np.column_stack(columns)


@dataclass(frozen=True, eq=False)
class _Parameters:
    """The free parameters: θ contains the logarithms of those with positive start values, and the others unchanged."""

    make: Callable[[Mapping[str, float]], Problem]
    names: tuple[str, ...]
    given: tuple[float, ...]
    start: Array
    logarithmic: tuple[bool, ...]
    limits: tuple[Array, Array]

    @classmethod
    def of(
        cls,
        problem: Problem | Callable[..., Problem],
        free: Sequence[str] | Mapping[str, float],
        bounds: Mapping[str, tuple[float, float]],
    ) -> _Parameters:
        """Check the free parameters and their bounds."""
        if isinstance(free, str):
            free = [free]
        given = dict(free) if isinstance(free, Mapping) else {}
        names = tuple(free)
        if not names:
            raise InputError("fit: nothing is free; name the parameters to fit, as ['k', 'c']")
        if len(set(names)) < len(names):
            raise InputError(f"fit: {', '.join(names)}: a parameter is listed twice; name each once")
        if isinstance(problem, Problem):
            base = problem
            start = {name: given.get(name, value_at(base, name)) for name in names}
            check_independent(base, names)

            make = changes_at(base, names)
        else:
            builder = problem
            if not given:
                raise InputError(
                    "fit: a function that makes problems needs the start of each parameter: free={'k': 1e3}"
                )
            start = given

            def make(values: Mapping[str, float]) -> Problem:
                return builder(**values)

        for name in bounds:
            if name not in names:
                raise InputError(f"fit: bounds: {nearest(name, list(names), 'free parameter')}")
        lows = []
        highs = []
        θ = []
        logarithmic = []
        for name in names:
            low, high = bounds.get(name, (-math.inf, math.inf))
            value = start[name]
            finite(f"fit: the start {name}", value)
            if not low < high or not low <= value <= high:
                raise InputError(
                    f"fit: {name} starts at {value:g}, which must lie within its bounds {low:g} ... {high:g}; change one"
                )
            log = value > 0.0 and (low >= 0.0 or name not in bounds)
            logarithmic.append(log)
            θ.append(math.log(value) if log else float(value))
            lows.append(math.log(low) if log and low > 0.0 else -math.inf if log else low)
            highs.append(math.log(high) if log else high)
        return cls(
            make,
            names,
            tuple(float(start[name]) for name in names),
            np.array(θ),
            tuple(logarithmic),
            (np.array(lows), np.array(highs)),
        )

    def values(self, θ: Array) -> list[float]:
        """Return the parameters."""
        # Larger logarithms are not meaningful parameters.
        return [
            math.exp(min(max(x, -600.0), 600.0)) if log else float(x)
            for x, log in zip(θ.tolist(), self.logarithmic, strict=True)
        ]

    def scale(self, θ: Array) -> Array:
        """Return dp/dθ (n,)."""
        return np.where(self.logarithmic, self.values(θ), 1.0)

    def problem(self, θ: Array) -> Problem:
        """Return the problem with these parameters."""
        return self.make(dict(zip(self.names, self.values(θ), strict=True)))

    def starts(self, number: int, seed: int, *, start_spread: float = math.log(3.0)) -> list[Array]:
        """Return the given start and random starts.

        ``start_spread``: standard deviation of the logarithms of random starts.
        """
        random = random_numbers(seed)
        low, high = self.limits
        inner = np.isfinite(low) & np.isfinite(high)
        found = [self.start]
        for _ in range(number - 1):
            wide = np.where(self.logarithmic, start_spread, np.maximum(np.abs(self.start), 1.0))
            θ = self.start + wide * random.standard_normal(len(self.start))
            fraction = random.random(len(self.start))
            θ[inner] = low[inner] + fraction[inner] * (high - low)[inner]
            found.append(np.clip(θ, low, high))
        return found


@dataclass(frozen=True, eq=False)
class _Measured:
    """The data to fit: values of curves and targets.

    Attributes
    ----------
    values, scales : (N,) arrays        values and the scales of their errors
    labels : DataFrame                  series and t of each value
    curves : tuple                      series and times of each curve
    targets : tuple                     targets, whose values follow those of the curves
    known : bool                        whether the scales are standard deviations
    """

    values: Array
    scales: Array
    labels: pd.DataFrame
    curves: tuple[tuple[str, Array], ...]
    targets: tuple[Target, ...]
    sampling: str
    known: bool
    last: float = field(default=0.0)

    @classmethod
    def of(
        cls,
        curves: Sequence[tuple[str, Array, Array]],
        outputs: Mapping[str, Target],
        sampling: str,
        sigma: float | None,
    ) -> _Measured:
        """Return the data of curves, with series, times and values of each, and of targets."""
        if not curves and not outputs:
            raise InputError("fit: nothing to fit to; give data, a curve, or outputs")
        values = [y for _, _, y in curves] + [np.array([target.value for target in outputs.values()])]
        scales = [np.full(len(y), sigma or float(np.sqrt(np.mean(y**2))) or 1.0) for _, _, y in curves]
        scales.append(np.array([target.scale for target in outputs.values()]))
        series = [name for name, t, _ in curves for _ in t] + list(outputs)
        times = [*(t for _, t, _ in curves), np.full(len(outputs), np.nan)]
        known = (sigma is not None or not curves) and all(target.sigma for target in outputs.values())
        return cls(
            np.concatenate(values),
            np.concatenate(scales),
            pd.DataFrame({"series": series, "t": np.concatenate(times)}),
            tuple((name, t) for name, t, _ in curves),
            tuple(outputs.values()),
            sampling,
            known,
            max([float(t[-1]) for _, t, _ in curves], default=0.0),
        )

    @property
    def differ(self) -> bool:
        """Whether a series of unknown noise stands beside others, or beside targets of known noise."""
        return len(self.curves) > 1 or (len(self.curves) == 1 and any(target.sigma for target in self.targets))

    def without_known_targets(self) -> _Measured:
        """Return the data with targets of known noise left out, by an infinite scale, so that the series show their own."""
        scales = self.scales.copy()
        begin = len(self.scales) - len(self.targets)
        scales[begin:] = np.where([bool(target.sigma) for target in self.targets], np.inf, scales[begin:])
        return replace(self, scales=scales)

    def weighed(self, residuals: Array) -> _Measured:
        """Return the data with each series scaled by the scatter of its residuals."""
        scales, begin = self.scales.copy(), 0
        for _, t in self.curves:
            part = slice(begin, begin + len(t))
            scales[part] *= max(float(np.sqrt(np.mean(residuals[part] ** 2))), 1e-12)
            begin += len(t)
        return replace(self, scales=scales)

    def shown_by(self, run: Trajectory) -> Array:
        """Return the corresponding values of a run."""
        value = _means if self.sampling == "mean" else read
        curves = [value(run, series, t) for series, t in self.curves]
        return np.concatenate([*curves, [target.shown_by(run) for target in self.targets]])

    def slopes(self, outputs: Outputs, run: Trajectory) -> Array:
        """Return the derivatives (N, np) of these values of an exact run with respect to its parameters.

        Raises
        ------
        UnsupportedError
            If they have none.
        """
        value = _slopes_of_means if self.sampling == "mean" else _sampled
        curves = [value(outputs, run, series, t) for series, t in self.curves]
        targets = [outputs.derivative(_named(target), run)[0] for target in self.targets]
        return np.vstack([*curves, *targets])

    def compared(self, run: Trajectory) -> pd.DataFrame:
        """Return the data beside the values of a run."""
        fitted = self.shown_by(run)
        return self.labels.assign(measured=self.values, fitted=fitted, residual=fitted - self.values)


def _curves(
    problem: Problem,
    data: str | Path | pd.DataFrame,
    column: str | Sequence[str] | Mapping[str, str] | None,
    time: str | None,
    units: Mapping[str, str],
    decimal: str | None,
) -> tuple[list[tuple[str, Array, Array]], str]:
    """Return series, times and values of each curve in the data, and how the columns were read, in words."""
    forces = [each.name for each in problem.dynamics.forces]
    known = list(series_names(problem.dynamics))
    table = CurveTable.of(data, decimal)
    wanted = {"t": problem.unit("t")} | {name: problem.unit(name) for name in known}
    if column is None:
        asked = {name: name for name in known if name in table.names}
    else:
        given = [column] if isinstance(column, str) else column
        asked = dict(given) if isinstance(given, Mapping) else {name: name for name in given}
    for name in asked:
        if name not in known:
            raise InputError(f"fit: {nearest(name, known, f'series of problem {problem.name!r}')}")
    if not asked:
        times = table.clock(time)
        pairs = [
            (series, name)
            for name, header in zip(table.names, table.header, strict=True)
            if header != times
            for series in (known[-1], *known)
            if is_alike(units.get(name, table.units.get(header, "")), wanted[series])
        ]
        series, some = next(iter(pairs), (known[-1], "COLUMN"))
        raise InputError(
            f"fit: none of the columns {', '.join(table.header)} is a series of problem {problem.name!r}, which has "
            f"{', '.join(known)}: say which one is which, as column={{{series!r}: {some!r}}} (--column {series}={some})"
        )
    found, said = [], list[str]()
    for name, header in asked.items():
        clock = "t_R" if time is None and name in forces and "t_R" in table.header else table.clock(time)
        curve = table.curve({name: header}, clock, units, wanted)
        if not len(curve):
            raise InputError(f"fit: column {header} holds no numbers; measure some")
        found.append((name, curve["t"].to_numpy(), curve[name].to_numpy()))
        said += ["" if clock == "t_R" else table.said("t", clock, wanted["t"], units)]
        said += [table.said(name, header, wanted[name], units)]
    return found, ", ".join(filter(None, dict.fromkeys(said)))


def _named(target: Target) -> str:
    """Return the name of the output of a target, of which there are derivatives."""
    if callable(target.measure):
        raise UnsupportedError("the measure of a target is a function: name an output, as 'R.max'")
    return target.measure


def _sampled(outputs: Outputs, run: Trajectory, series: str, t: Array) -> Array:
    """Return the derivatives (nt, np) of a series of an exact run at the times t."""
    column = series_names(run.problem.dynamics).index(series)
    return outputs.samples(np.minimum(t, outputs.variation.solution.end))[1][:, column]


class _Cells(NamedTuple):
    """The cells about the times of samples, which meet halfway, cut at the events of a run, with Gauss points in each piece.

    Attributes
    ----------
    edges : (nt + 1,) array     ends of the cells
    times : (m, 4) array        Gauss points
    half : (m,) array           half the length of each piece
    cell : (m,) integers        the cell of each
    """

    edges: Array
    times: Array
    half: Array
    cell: Indices

    @classmethod
    def of(cls, run: Trajectory, t: Array) -> _Cells:
        """Return the cells about the times t of at least two samples."""
        edges = np.concatenate([[t[0]], 0.5 * (t[1:] + t[:-1]), [t[-1]]])
        cuts = np.unique(np.concatenate([edges, [each.t for each in run.events if edges[0] < each.t < edges[-1]]]))
        half = 0.5 * np.diff(cuts)
        times = (cuts[:-1] + half)[:, None] + half[:, None] * GAUSS_NODES
        return cls(edges, times, half, np.searchsorted(edges, cuts[:-1], side="right") - 1)

    def integrals(self, values: Array) -> Array:
        """Return the integrals over the cells (nt, ...) of values at all Gauss points (4 m, ...)."""
        parts = np.einsum(
            "kg...,g,k->k...", values.reshape(*self.times.shape, *values.shape[1:]), GAUSS_WEIGHTS, self.half
        )
        found = np.zeros((len(self.edges) - 1, *values.shape[1:]))
        np.add.at(found, self.cell, parts)
        return found


def _means(run: Trajectory, series: str, t: Array) -> Array:
    """Return the means of a series over the cells about the times."""
    if len(t) == 1:
        return read(run, series, t)
    cells = _Cells.of(run, t)
    return cells.integrals(read(run, series, cells.times.ravel())) / np.diff(cells.edges)


def _slopes_of_means(outputs: Outputs, run: Trajectory, series: str, t: Array) -> Array:
    """Return the derivatives (nt, np) of the means of a series of an exact run: its jumps move with their instants."""
    if len(t) == 1:
        return _sampled(outputs, run, series, t)
    cells, column = _Cells.of(run, t), series_names(run.problem.dynamics).index(series)
    found = cells.integrals(_sampled(outputs, run, series, cells.times.ravel()))
    for instant, jump, t_p in outputs.jumps(float(t[-1])):
        if cells.edges[0] < instant < cells.edges[-1]:
            found[np.searchsorted(cells.edges, instant, side="right") - 1] += jump[column] * t_p
    return np.asarray(found / np.diff(cells.edges)[:, None])


@dataclass(frozen=True, eq=False)
class _Errors:
    """Uncertainty of the fitted parameters.

    Attributes
    ----------
    table, correlation, notes : as of `Fit`
    freedom : int               as of `Fit`
    noise : float               standard deviation of the residuals
    quantile : float            number of standard deviations to the end of an interval
    told, hidden : (n, .) arrays    directions in the parameters, each for a residual of 1, and those that show in none
    """

    table: pd.DataFrame
    correlation: pd.DataFrame
    notes: tuple[str, ...]
    freedom: int
    noise: float
    quantile: float
    told: Array
    hidden: Array

    def deviation(self, G: Array, *, hidden_rtol: float = 1e-4) -> Array:
        """Return the standard deviations of quantities with the Jacobian G (N, n), in the scales of the residuals.

        They are infinite where a direction of the parameters of which the data say nothing changes the quantity.
        ``hidden_rtol``: change in such a direction, relative to the greatest in any, below which it is rounding.
        """
        seen = np.abs(G @ self.hidden).max(axis=1, initial=0.0)
        largest = float(np.abs(G).max(initial=0.0) * np.abs(self.hidden).max(initial=0.0))
        with np.errstate(invalid="ignore"):
            found = self.noise * np.linalg.norm(G @ self.told, axis=1)
        return np.where(seen > hidden_rtol * largest, np.inf, found)

    @classmethod
    def of(
        cls,
        found: OptimizeResult,
        parameters: _Parameters,
        known: bool,
        level: float,
        loss: str,
        *,
        singular_rtol: float = 1e-6,
        influence_rtol: float = 1e-8,
    ) -> _Errors:
        """Return standard errors, intervals and correlations from the Jacobian at the solution.

        ``singular_rtol``: relative singular value of the scaled Jacobian below which parameters are not
        identifiable.
        ``influence_rtol``: relative change of the residuals, for a change of a parameter by its own size, below
        which it has no influence.
        """
        names, notes = parameters.names, []
        J = np.asarray(found.jac)
        N = len(found.fun)
        n = len(names)
        widths = np.linalg.norm(J * np.where(parameters.logarithmic, 1.0, np.maximum(np.abs(found.x), 1e-12)), axis=0)
        silent = widths <= influence_rtol * math.sqrt(N)
        norms = np.where(silent, 1.0, np.linalg.norm(J, axis=0))
        _, s, Vt = np.linalg.svd(J / norms, full_matrices=False)
        weak = s <= singular_rtol * s[0]
        blind = silent | (np.abs(Vt[weak]) > 0.1).any(axis=0)
        inverse = np.where(weak, 0.0, 1.0 / np.where(weak, 1.0, s))
        depends = np.abs(J / norms).max(axis=1) > influence_rtol
        freedom = max(int(depends.sum()) - n, 0)
        squares = 2.0 * float(found.cost)
        # A robust loss is never above the square, so the smaller of the two bounds its part.
        part = min(squares, float(np.sum(found.fun[depends] ** 2)))
        s2 = 1.0 if known else max(part / freedom, squares / (N - n)) if freedom else math.inf
        unscaled = (Vt.T * inverse**2) @ Vt / np.outer(norms, norms)
        spread = np.sqrt(np.diag(unscaled))
        with np.errstate(invalid="ignore", divide="ignore"):
            correlation = unscaled / np.outer(spread, spread)
            errors = np.where(blind, np.inf, math.sqrt(s2) * spread)
        correlation[blind, :] = correlation[:, blind] = np.nan
        quantile = float(norm.ppf(0.5 + 0.5 * level) if known else student.ppf(0.5 + 0.5 * level, max(freedom, 1)))
        low = found.x - quantile * errors
        high = found.x + quantile * errors
        values = parameters.values(found.x)
        log = parameters.logarithmic
        rows = [
            {
                "parameter": name,
                "start": parameters.given[j],
                "value": values[j],
                "standard_error": values[j] * errors[j] if log[j] else errors[j],
                "low": _exp(low[j]) if log[j] else low[j],
                "high": _exp(high[j]) if log[j] else high[j],
            }
            for j, name in enumerate(names)
        ]
        for name in np.array(names)[silent]:
            notes.append(f"The numbers say nothing of {name}: it has no influence on them.")
        mixed = [name for name, hidden in zip(names, blind & ~silent, strict=True) if hidden]
        if mixed:
            notes.append(
                f"{' and '.join(mixed)} cannot be told apart by these numbers: fix one of them, or measure something else."
            )
        at = np.flatnonzero(np.asarray(found.active_mask))
        for j in at:
            notes.append(f"{names[j]} ends at its bound, so its interval means nothing.")
        if not freedom and not known:
            notes.append(
                "There are as many parameters as numbers that depend on them, so nothing is left to tell the scatter: no "
                "intervals."
            )
        if loss != "linear":
            notes.append(f"The intervals are approximate, since outliers count less (loss={loss!r}).")
        labelled = pd.DataFrame(correlation, index=list(names), columns=list(names))
        told = (Vt.T * inverse)[:, ~weak] / norms[:, None]
        hidden = Vt[weak].T / norms[:, None]
        return cls(pd.DataFrame(rows), labelled, tuple(notes), freedom, math.sqrt(s2), quantile, told, hidden)


def _exp(x: float) -> float:
    return math.exp(x) if x < 700.0 else math.inf
