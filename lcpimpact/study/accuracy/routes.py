"""Routes to one motion for cross-validation: methods, solvers, closed forms and Siconos, with the quantities of each run.

Routes are of one *family* if they use the same integration rule: θ-steps with different LCP solvers or different θ, and
Siconos's θ-step. They could share an error, so they do not confirm each other. `exact`, `event-driven` and `radau-fesd` are
of three families, but share the choice of the contact mode by `lcpimpact.hybrid.mode_choice`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from lcpimpact.arrays import Array
from lcpimpact.errors import FailureError, InputError, LcpImpactError, UnsupportedError
from lcpimpact.integrators.base import Declared, Integrator
from lcpimpact.lcp import SOLVERS
from lcpimpact.problems.base import Problem
from lcpimpact.reading import Readable, read
from lcpimpact.record import Event, State
from lcpimpact.simulation import make_integrator, simulate
from lcpimpact.study.accuracy.convergence import labelled
from lcpimpact.study.accuracy.siconos import siconos
from lcpimpact.trajectory import Trajectory

POINTS = 195
"""Number of instants at which coordinates are compared, after the first: 3 x 5 x 13."""

RATIO = 3
"""Ratio of one step to the next finer one."""

HIGH_ORDER_COUNTS = (39, 195, 585)
"""Numbers of steps of a route of order above 2 with a continuous solution."""

RTOLS = (1e-6, 1e-8, 1e-10)
"""Tolerances of a route with a tolerance."""

SOLVERS_COMPARED = ("lemke", "pgs", "qp:osqp", "qp:osqp:primal")
"""A direct and an iterative solver, and a QP in its dual and primal form."""

CLOSED_FORM, SICONOS = "closed form", "siconos"

ClosedForm: TypeAlias = Callable[[Array], tuple[Array, Array]]
Given: TypeAlias = str | Integrator | ClosedForm


@dataclass(frozen=True, eq=False)
class Reading:
    """The quantities of one run; None if it lacks them.

    Attributes
    ----------
    q : (nt, n) array               coordinates at equal distances, POINTS of them or a divisor of it, in m
    v : (nf, n) array or None       velocities, once in each of the finest steps, in m/s
    r : (nf, nc) array or None      reactions at the same instants, without impulses, in N; where rows are redundant, and
                                    share a force in any way, the forces on the nodes (nf, n)
    events : tuple or None          its events
    facts : (k,) array              measured value of each fact of the problem, NaN if there is none
    """

    q: Array
    v: Array | None = None
    r: Array | None = None
    events: tuple[Event, ...] | None = None
    facts: Array | None = None


@dataclass(frozen=True, eq=False)
class Route:
    """A route to the motion.

    Attributes
    ----------
    label : str
    levels : tuple              step counts or tolerances of its runs; one for a single run
    run : callable              takes a level; returns the Reading of the run, and the Trajectory or None
    orders : Integrator or None the method whose declared order holds
    kind : str                  "steps", "tolerance", "exact", or "solver": the same steps with another LCP solver
    family : str                the rule by which it advances
    mode_choice : str           common source of the contact mode with other families, "" for none
    tol : float                 relative tolerance of a solver
    """

    label: str
    levels: tuple[float, ...]
    run: Callable[[float], tuple[Reading, Trajectory | None]]
    orders: Integrator | None
    kind: str
    family: str
    mode_choice: str = ""
    tol: float = 0.0


@dataclass(frozen=True, eq=False)
class RouteResult:
    """The results of a route: a reading of each level that ran, and the finest trajectory."""

    route: Route
    levels: tuple[float, ...]
    readings: tuple[Reading, ...]
    trajectory: Trajectory | None

    @property
    def finest(self) -> Reading:
        """The reading that is judged."""
        return self.readings[-1]


def default_routes(problem: Problem) -> list[Given]:
    """Return all available routes: the closed form if the problem has one, methods, solvers of their LCPs, and Siconos.

    Examples
    --------
    >>> from lcpimpact import load_problem
    >>> default_routes(load_problem("kelvin-voigt-tension"))
    ['closed form', 'exact', 'event-driven', 'radau-fesd', 'moreau-jean', 'rk4-paper', 'siconos']
    """
    routes: list[Given] = [CLOSED_FORM] if problem.motion is not None else []
    routes += ["exact", "event-driven", "radau-fesd", "moreau-jean"]
    routes += [f"moreau-jean:{solver}" for solver in SOLVERS_COMPARED if problem.dynamics.contacts]
    return [*routes, "rk4-paper", SICONOS]


def by_label(routes: Sequence[Given] | Mapping[str, Given]) -> dict[str, Given]:
    """Return the routes by their labels.

    Raises
    ------
    InputError
        For a single name, or two routes of one label.
    """
    if isinstance(routes, str):
        raise InputError(f"routes = {routes!r} must be a list of routes: write [{routes!r}]")
    if isinstance(routes, Mapping):
        return {str(label): what for label, what in routes.items()}
    found = {}
    for what in routes:
        label = what if isinstance(what, str) else next(iter(labelled([what]))) if isinstance(what, Integrator) else ""
        label = label or getattr(what, "__name__", repr(what))
        if label in found:
            raise InputError(f"routes: {label!r} is listed twice; leave one out, or label them by a mapping")
        found[label] = what
    return found


def step_counts(t_end: float, dt: float | None, *, levels: int = 4) -> tuple[int, ...]:
    """Return the step counts of a time-stepping route, the last with steps of at most dt.

    ``levels``: number of runs of a time-stepping route.
    """
    coarsest = POINTS if dt is None else POINTS * max(1, math.ceil(t_end / dt / POINTS / RATIO ** (levels - 1)))
    return tuple(coarsest * RATIO**k for k in range(levels))


def make_route(problem: Problem, label: str, what: Given, counts: tuple[int, ...], t_end: float) -> Route:
    """Return the route for a given specification.

    Raises
    ------
    InputError
        For an invalid specification.
    """
    if what == CLOSED_FORM:
        if problem.motion is None:
            raise InputError(f"{problem.name!r} has no closed form: leave out the route {CLOSED_FORM!r}")
        what = problem.motion
    if what == SICONOS:
        stepped = make_integrator("moreau-jean", {})
        return Route(
            label, counts, lambda n: (Reading(_subsample(siconos(problem, int(n), t_end))), None), stepped, "steps",
            stepped.family,
        )  # fmt: skip
    if isinstance(what, str):
        name, colon, solver = what.partition(":")
        integrator = make_integrator(name, {})
        if colon:
            return _by_solver(problem, label, integrator, solver, counts, t_end)
        return _by_method(problem, label, integrator, counts, t_end)
    if isinstance(what, Integrator):
        return _by_method(problem, label, what, counts, t_end)
    if not callable(what):
        raise InputError(f"route {label!r}: {what!r} must be a name, an Integrator, or a function of times")
    return _by_closed_form(problem, label, what, counts, t_end)


def run_route(route: Route) -> RouteResult:
    """Run a route at all its levels; only the finest must succeed.

    Raises
    ------
    UnsupportedError
        If the route does not handle the problem.
    FailureError
        If it fails before the end.
    """
    levels = []
    readings = []
    finest = None
    for level in route.levels:
        last = level == route.levels[-1]
        try:
            with np.errstate(over="ignore", invalid="ignore"):
                reading, finest = route.run(level)
        except (UnsupportedError, InputError):
            raise
        except LcpImpactError:
            if last or len(route.levels) == 1:
                raise
            continue
        if all(np.isfinite(values).all() for values in (reading.q, reading.v, reading.r) if values is not None):
            levels.append(level)
            readings.append(reading)
        elif last:
            raise FailureError(f"{route.label!r} is unstable: take a smaller dt", finest)
    return RouteResult(route, tuple(levels), tuple(readings), finest)


def _by_closed_form(problem: Problem, label: str, motion: ClosedForm, counts: tuple[int, ...], t_end: float) -> Route:
    n = len(problem.dynamics.nodes)

    def checked(values: ArrayLike, nt: int, symbol: str) -> Array:
        found = np.asarray(values, dtype=np.float64)
        if found.shape != (nt, n):
            raise InputError(
                f"route {label!r} returned {symbol} of shape {found.shape}: for times (nt,) it must be (nt, {n})"
            )
        return found

    def closed(_: float) -> tuple[Reading, Trajectory | None]:
        q = checked(motion(np.linspace(0.0, t_end, POINTS + 1))[0], POINTS + 1, "q")
        v = motion(_instants(counts, t_end))[1]
        return Reading(q, None if v is None else checked(v, counts[-1], "v")), None

    return Route(label, (math.nan,), closed, None, "exact", "closed form")


def _by_solver(
    problem: Problem, label: str, integrator: Integrator, solver: str, counts: tuple[int, ...], t_end: float
) -> Route:
    tol = SOLVERS[solver].tol

    def run(n: float) -> tuple[Reading, Trajectory | None]:
        trajectory = simulate(problem, integrator, dt=t_end / int(n), t_end=t_end, lcp_solver=solver, progress=False)
        return Reading(_subsample(trajectory.q)), trajectory

    return Route(label, (counts[1],), run, integrator, "solver", _family(integrator), tol=tol)


def _by_method(problem: Problem, label: str, integrator: Integrator, counts: tuple[int, ...], t_end: float) -> Route:
    declared = integrator.declared
    instants = _instants(counts, t_end)
    family = _family(integrator)
    mode_choice = integrator.mode_choice
    # If dt is only the spacing of the output, facts that are integrals over the grid need a fine one.
    located = counts[-2]

    def run(method: Integrator, steps: int) -> tuple[Reading, Trajectory | None]:
        try:
            trajectory = simulate(problem, method, dt=t_end / steps, t_end=t_end, progress=False)
        except FailureError as error:
            found = error.result
            # A complete coarse run shows how the error decreases, even if it is not valid itself.
            if steps == counts[-1] or math.isinf(declared.order_smooth) or found is None or found.t[-1] < t_end:
                raise
            trajectory = found
        times = np.linspace(0.0, t_end, POINTS + 1)
        on_grid = steps % POINTS == 0 or POINTS % steps == 0
        adaptive = len(trajectory.t) != steps + 1 or not on_grid
        q = trajectory.sample(np.minimum(times, trajectory.t[-1])).q if adaptive else _subsample(trajectory.q)
        return _reading(problem, trajectory, q, np.minimum(instants, trajectory.t[-1])), trajectory

    if integrator.rtol is not None:

        def by_tolerance(rtol: float) -> tuple[Reading, Trajectory | None]:
            return run(integrator.with_tolerance(rtol), located if math.isinf(declared.order_smooth) else POINTS)

        return Route(label, RTOLS, by_tolerance, integrator, "tolerance", family, mode_choice)

    def by_steps(n: float) -> tuple[Reading, Trajectory | None]:
        return run(integrator, int(n))

    if math.isinf(declared.order_smooth):
        return Route(label, (located,), by_steps, integrator, "exact", family, mode_choice)
    high = _lowest_order(declared) > 2.0
    return Route(label, HIGH_ORDER_COUNTS if high else counts, by_steps, integrator, "steps", family, mode_choice)


def _family(integrator: Integrator) -> str:
    return integrator.family or integrator.name


def _instants(counts: tuple[int, ...], t_end: float, *, shift: float = 0.5 * (math.sqrt(5.0) - 1.0)) -> Array:
    """Return the instants at which velocities and forces are compared.

    ``shift``: position in each of the finest steps at which velocities and forces are compared: irrational, so that
    no jump falls there by symmetry.
    """
    return np.asarray((np.arange(counts[-1]) + shift) * (t_end / counts[-1]))


def _reading(problem: Problem, run: Trajectory, q: Array, instants: Array) -> Reading:
    """Return the quantities of a run."""
    d, n = problem.dynamics, len(problem.dynamics.nodes)
    start = d.at(0.0, problem.initial_coordinates, problem.initial_velocities)
    redundant = np.linalg.matrix_rank(np.vstack([start.B, start.D])) < len(d.contacts)

    def forces(state: State) -> Array:
        """Return the reactions, or the forces on the nodes that redundant ones have together."""
        return d.reaction_force(state.q, state.reaction, instants) if redundant else state.reaction

    vr = read(run, lambda state: np.hstack([state.v, forces(state)]), instants)
    facts = _facts(problem, run) if abs(run.t[-1] - problem.t_end) <= 1e-12 * problem.t_end else np.empty(0)
    return Reading(q, vr[:, :n], vr[:, n:], run.events, facts)


def _facts(problem: Problem, run: Trajectory) -> Array:
    """Return the value of each fact in a run, NaN if unavailable, as for a missing event."""

    def measured_value(measure: Callable[[Readable], float]) -> float:
        try:
            return float(measure(run))
        except (LcpImpactError, ArithmeticError, LookupError, ValueError):
            return math.nan

    return np.array([measured_value(fact.measure) for fact in problem.facts])


def _lowest_order(declared: Declared) -> float:
    """Return the minimum of the orders that a method declares, without unsupported cases."""
    orders = (
        declared.order_smooth, declared.order_force_kink, declared.order_force_jump, declared.order_impact,
        declared.order_friction, declared.order_relay,
    )  # fmt: skip
    return min(order for order in orders if order > 0.0)


def _subsample(q: Array) -> Array:
    """Return q at the instants of comparison from a grid with a multiple of them."""
    return q[:: max(1, (len(q) - 1) // POINTS)]
