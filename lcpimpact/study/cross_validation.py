r"""Cross-validation: one motion by several independent routes, and a verdict whether they agree.

A route brings its own estimate of its error. One that steps runs with the steps h_0 > h_1 > ..., each a third of the last;
with the order p that the method declares for what happens in the motion, neighbours differ by about
:math:`D_j = C (h_j^p - h_{j+1}^p)`, and so with the largest such C its finest run errs by

.. math:: E = C h_m^p.

One with a tolerance errs by less than what its last two tolerances differ by; the exact solution and a closed form by
rounding. Two routes agree if at no instant their coordinates differ by more than a factor times the sum of their estimates.
A route with a wrong mass converges too, and its E is small: that is how it is found out. A route that converges, but more
slowly than it declares, is found out by its observed order. The route that all are judged by is the better of the two that
agree most closely. What no comparison shows is a mistake below the errors that a route owns up to: ``allowed`` says how
large that is, and smaller steps make it less.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np
import pandas as pd
from scipy.linalg import eigh

from lcpimpact.arrays import Array, Flags
from lcpimpact.errors import InputError, LcpImpactError, UnsupportedError
from lcpimpact.integrators.base import Declared, Integrator
from lcpimpact.lcp import SOLVERS
from lcpimpact.numbers import is_real
from lcpimpact.problems.base import Problem
from lcpimpact.simulation import make_integrator, simulate
from lcpimpact.study.convergence import declared_order, labelled, limits_of
from lcpimpact.study.siconos import siconos
from lcpimpact.study.watch import Watch, unwatched
from lcpimpact.trajectory import Trajectory

POINTS = 195
"""Instants at which routes are compared, after the first: 3 x 5 x 13."""

RATIO = 3
"""Of one step to the next finer one."""

LEVELS = 4
"""Runs of a route that steps."""

FEW = (39, 195, 585)
"""Step counts of a route of an order above 2 that knows its motion between its steps."""

ASYMPTOTIC = 1e-3
"""Errors below this, relative to the size of the motion, show an order above 2; before, steps are too long for it."""

RTOLS = (1e-6, 1e-8, 1e-10)
"""Of a route with a tolerance."""

FACTOR = 5.0
"""So many times the sum of their estimates two routes may differ by."""

SLACK = 0.35
"""An observed order may be lower than the declared one by so much of it, and by twice as much where it is 1."""

ROUNDING = 1e-9
"""Differences this small, relative to the size of the motion, are rounding, or a solver's tolerance."""

SOLVER_FACTOR = 100.0
"""So many tolerances of a solver, relative to the size of the motion, a run may be off."""

SOLVERS_COMPARED = ("lemke", "pgs", "qp:osqp", "qp:osqp:primal")
"""A direct and an iterative solver, and a QP in its dual and primal form."""

CLOSED_FORM, SICONOS = "closed form", "siconos"

ClosedForm: TypeAlias = Callable[[Array], tuple[Array, Array]]
Given: TypeAlias = str | Integrator | ClosedForm


@dataclass(frozen=True, eq=False)
class Route:
    """A way to the motion.

    Attributes
    ----------
    label : str
    levels : tuple              what its runs differ in, step counts or tolerances; one where there is one run
    run : callable              takes a level; returns q (nt, n) at equal distances, and the Trajectory or None
    orders : Integrator or None the method whose declared order holds
    kind : str                  "steps", "tolerance", "exact", or "solver": the same steps with another LCP solver
    tol : float                 relative tolerance of a solver
    """

    label: str
    levels: tuple[float, ...]
    run: Callable[[float], tuple[Array, Trajectory | None]]
    orders: Integrator | None
    kind: str
    tol: float = 0.0


@dataclass(frozen=True, eq=False)
class Found:
    """What the runs of a route gave: q (nt, n) of each level that ran, and the finest trajectory."""

    route: Route
    levels: tuple[float, ...]
    q: tuple[Array, ...]
    finest: Trajectory | None


@dataclass(frozen=True, eq=False)
class CrossValidation:
    """The verdict on several routes to one motion.

    Attributes
    ----------
    problem : Problem
    table : DataFrame
        One row a route: ``route``; ``kind`` ("steps", "tolerance", "exact" or "solver"); ``against``, the route that it was
        judged by; ``difference`` (m), the largest of the coordinates at 195 instants; ``allowed`` (m), what it may be;
        ``estimate`` (m), the route's own error E; ``observed`` and ``declared`` order, NaN where none is judged; ``agrees``;
        ``failure``, why a route could not be taken, else "". ``attrs``: problem, t_end, scale (m).
    pairs : DataFrame
        One row a pair of routes that were compared with each other: ``a``, ``b``, ``difference`` (m), ``allowed`` (m),
        ``agrees``.
    reasons : tuple of str
        The verdict in sentences: what disagrees with what, by how much, and what could not be taken and why.
    agree : bool
        Whether at least two routes were taken, and all that were taken agree.
    """

    problem: Problem
    table: pd.DataFrame
    pairs: pd.DataFrame
    reasons: tuple[str, ...]
    agree: bool

    def __str__(self) -> str:
        taken = int((self.table["failure"] == "").sum())
        verdict = f"{taken} routes agree" if self.agree else "the routes do not agree"
        return "\n".join([f"{self.problem.name}: {verdict}", *(f"  {reason}" for reason in self.reasons)])


def cross_validate(
    problem: Problem,
    routes: Sequence[Given] | Mapping[str, Given] | None = None,
    *,
    dt: float | None = None,
    t_end: float | None = None,
    tolerance: float | None = None,
    watch: Watch = unwatched,
) -> CrossValidation:
    """Take several independent routes to one motion, and judge whether they lead to the same.

    Parameters
    ----------
    problem : Problem
        Any problem.
    routes : sequence or mapping, optional
        Names of methods, "method:solver" for a method with another LCP solver (compared with the same steps by ``auto``),
        "closed form" (`Problem.motion`), "siconos", `Integrator` objects, or functions that take times (nt,) and return q
        and v (nt, n); a mapping gives them labels. By default `default_routes`.
    dt : float, optional
        The finest step in s; by default t_end/5265. The coarser ones are 3, 9 and 27 times as long.
    t_end : float, optional
        End in s; by default that of the problem.
    tolerance : float, optional
        Relative to the size of the motion: a difference that is forgiven whatever the estimates say; 1e-9 by default.
    watch : callable
        See `lcpimpact.study.watch`.

    Returns
    -------
    CrossValidation
        The verdict, the reasons, and the numbers.

    Raises
    ------
    InputError
        For an unknown route, two of one label, or numbers that cannot be used.

    Examples
    --------
    >>> from lcpimpact import cross_validate, load_problem
    >>> verdict = cross_validate(load_problem("system-1"), ["exact", "moreau-jean", "rk4-paper"])
    >>> verdict.agree
    True

    Against a wrong closed form they speak up:

    >>> import numpy as np
    >>> spring = load_problem("kelvin-voigt-tension")
    >>> wrong = lambda t: (0.99 * spring.motion(t)[0], spring.motion(t)[1])
    >>> verdict = cross_validate(spring, {"exact": "exact", "moreau-jean": "moreau-jean", "mine": wrong})
    >>> verdict.agree, verdict.reasons[0][:36]
    (False, "'mine' disagrees with 'exact': they ")
    """
    end = problem.t_end if t_end is None else t_end
    for name, value in (("t_end", end), ("dt", end if dt is None else dt)):
        if not is_real(value) or not value > 0.0:
            raise InputError(f"{name} = {value!r} must be a positive finite number in s")
    if tolerance is not None and (not is_real(tolerance) or not 0.0 < tolerance < 1.0):
        raise InputError(
            f"tolerance = {tolerance!r} must be a number between 0 and 1, relative to the size of the motion"
        )
    coarsest = POINTS if dt is None else POINTS * max(1, math.ceil(end / dt / POINTS / RATIO ** (LEVELS - 1)))
    counts = tuple(coarsest * RATIO**k for k in range(LEVELS))
    given = _given(default_routes(problem) if routes is None else routes)
    refused: dict[str, str] = {}
    found: dict[str, Found] = {}
    for label, what in watch(given.items(), len(given), "routes"):
        route = _route(problem, label, what, counts, float(end))
        try:
            found[label] = _take(route)
        except LcpImpactError as error:
            refused[label] = str(error)
    return _judged(problem, given, found, refused, float(end), ROUNDING if tolerance is None else tolerance)


def default_routes(problem: Problem) -> list[Given]:
    """Return every route that there is: the closed form if the problem has one, methods, solvers of their LCPs, and Siconos.

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


def _given(routes: Sequence[Given] | Mapping[str, Given]) -> dict[str, Given]:
    if isinstance(routes, str):
        raise InputError(f"routes = {routes!r} must be a list of routes: write [{routes!r}]")
    if isinstance(routes, Mapping):
        return {str(label): what for label, what in routes.items()}
    found: dict[str, Given] = {}
    for what in routes:
        label = what if isinstance(what, str) else next(iter(labelled([what]))) if isinstance(what, Integrator) else ""
        label = label or getattr(what, "__name__", repr(what))
        if label in found:
            raise InputError(f"routes: {label!r} stands there twice; leave one out, or label them by a mapping")
        found[label] = what
    return found


def _route(problem: Problem, label: str, what: Given, counts: tuple[int, ...], t_end: float) -> Route:
    """Return what was given as a route."""
    times = np.linspace(0.0, t_end, POINTS + 1)
    if what == CLOSED_FORM:
        if problem.motion is None:
            raise InputError(f"{problem.name!r} has no closed form: leave out the route {CLOSED_FORM!r}")
        what = problem.motion
    if what == SICONOS:
        stepped = make_integrator("moreau-jean", {})
        return Route(label, counts, lambda n: (_thin(siconos(problem, int(n), t_end)), None), stepped, "steps")
    if isinstance(what, str):
        name, colon, solver = what.partition(":")
        integrator = make_integrator(name, {})
        if colon:
            return _by_solver(problem, label, integrator, solver, counts[1], t_end)
        return _by_method(problem, label, integrator, counts, t_end)
    if isinstance(what, Integrator):
        return _by_method(problem, label, what, counts, t_end)
    if not callable(what):
        raise InputError(f"route {label!r}: {what!r} must be a name, an Integrator, or a function of times")
    motion: ClosedForm = what

    def closed(_: float) -> tuple[Array, Trajectory | None]:
        q = np.asarray(motion(times)[0], dtype=np.float64)
        if q.shape != (POINTS + 1, len(problem.dynamics.nodes)):
            raise InputError(
                f"route {label!r} returned q of shape {q.shape}: for times (nt,) it must be "
                f"(nt, {len(problem.dynamics.nodes)})"
            )
        return q, None

    return Route(label, (math.nan,), closed, None, "exact")


def _by_solver(problem: Problem, label: str, integrator: Integrator, solver: str, count: int, t_end: float) -> Route:
    tol = SOLVERS[solver].tol

    def run(n: float) -> tuple[Array, Trajectory | None]:
        trajectory = simulate(problem, integrator, dt=t_end / int(n), t_end=t_end, lcp_solver=solver, progress=False)
        return _thin(trajectory.q), trajectory

    return Route(label, (count,), run, integrator, "solver", tol)


def _by_method(problem: Problem, label: str, integrator: Integrator, counts: tuple[int, ...], t_end: float) -> Route:
    chosen: Any = integrator
    declared = integrator.declared
    times = np.linspace(0.0, t_end, POINTS + 1)
    if hasattr(chosen, "rtol") and chosen.rtol is not None:

        def by_tolerance(rtol: float) -> tuple[Array, Trajectory | None]:
            options = {"rtol": rtol, **({"atol": chosen.atol * rtol / chosen.rtol} if hasattr(chosen, "atol") else {})}
            trajectory = simulate(problem, replace(chosen, **options), dt=t_end / POINTS, t_end=t_end, progress=False)
            return trajectory.sample(np.minimum(times, trajectory.t[-1])).q, trajectory

        return Route(label, RTOLS, by_tolerance, integrator, "tolerance")

    def by_steps(n: float) -> tuple[Array, Trajectory | None]:
        trajectory = simulate(problem, chosen, dt=t_end / int(n), t_end=t_end, progress=False)
        return (_thin(trajectory.q) if n >= POINTS else trajectory.q), trajectory

    if math.isinf(declared.order_smooth):
        return Route(label, (POINTS,), by_steps, integrator, "exact")
    high = _lowest_order(declared) > 2.0
    return Route(label, FEW if high else counts, by_steps, integrator, "steps")


def _lowest_order(declared: Declared) -> float:
    """Return the least of the orders that a method declares, but for those that it refuses."""
    orders = (
        declared.order_smooth, declared.order_force_kink, declared.order_force_jump, declared.order_impact,
        declared.order_friction,
    )  # fmt: skip
    return min(order for order in orders if order > 0.0)


def _thin(q: Array) -> Array:
    """Return what stands at the instants at which routes are compared, of a grid with a multiple of them."""
    return np.asarray(q[:: max(1, (len(q) - 1) // POINTS)])


def _take(route: Route) -> Found:
    """Run a route with all its levels; coarse ones may fail, and the finest may not."""
    levels, q, finest = [], [], None
    for level in route.levels:
        last = level == route.levels[-1]
        try:
            with np.errstate(over="ignore", invalid="ignore"):
                motion, finest = route.run(level)
        except UnsupportedError:
            raise
        except LcpImpactError:
            if last or len(route.levels) == 1:
                raise
            continue
        if np.isfinite(motion).all():
            levels.append(level)
            q.append(motion)
        elif last:
            raise UnsupportedError(f"{route.label!r} grew beyond all bounds: take a smaller dt")
    if len(levels) < min(2, len(route.levels)):
        raise UnsupportedError(f"{route.label!r} ran with one step only, which tells no error: take a smaller dt")
    return Found(route, tuple(levels), tuple(q), finest)


def _judged(
    problem: Problem,
    given: Mapping[str, Given],
    found: Mapping[str, Found],
    refused: Mapping[str, str],
    t_end: float,
    tolerance: float,
) -> CrossValidation:
    """Compare what was found, and say what it means."""
    judge = Judge(problem, found, t_end, tolerance)
    pairs = list(judge.pairs())
    leader = judge.leader(pairs)
    rows = [
        judge.row(label, leader)
        if label in found
        else {"route": label, "kind": "", "against": "", "agrees": False, "failure": refused[label]}
        for label in given
    ]
    columns = [
        *("route", "kind", "against", "difference", "allowed", "estimate", "observed", "declared"),
        *("agrees", "failure"),
    ]
    table = pd.DataFrame(rows, columns=columns)
    table.attrs = {"problem": problem.name, "t_end": t_end, "scale": judge.scale}
    taken = [row for row in rows if not row["failure"]]
    reasons = [reason for row in taken if (reason := _reason(row))]
    if len(taken) < 2:
        reasons.append("fewer than two routes were taken, so nothing was compared")
    agree = not reasons
    reasons += [f"{row['route']!r} was not taken: {row['failure']}" for row in rows if row["failure"]]
    listed = pd.DataFrame(pairs, columns=["a", "b", "difference", "allowed", "agrees"])
    listed.attrs = dict(table.attrs)
    return CrossValidation(problem, table, listed, tuple(reasons), agree)


class Judge:
    """What the routes to one motion found, and how it compares.

    Parameters
    ----------
    problem : Problem
    found : mapping of str to Found
    t_end : float
        In s.
    tolerance : float
        Relative to the size of the motion.
    """

    def __init__(self, problem: Problem, found: Mapping[str, Found], t_end: float, tolerance: float) -> None:
        massive = problem.dynamics.massive
        self.judged: Flags = massive if massive.any() else ~massive
        self.t_end, self.fastest = t_end, _highest_frequency(problem)
        self.found = found
        independent = [each for each in found.values() if each.route.kind != "solver"]
        sizes = [float(np.abs(each.q[-1][:, self.judged]).max()) for each in independent]
        # The median: a route that is wrong beyond all bounds must not make the others small.
        self.scale = float(np.median(sizes)) if sizes else 1.0
        self.floor = tolerance * self.scale
        runs = [each.finest for each in independent if each.finest is not None]
        runs.sort(key=lambda run: run.dense is None)
        self.limits = limits_of(runs[0]) if runs else ()
        self.estimates = {label: self._estimate(each) for label, each in found.items()}

    def declared(self, route: Route) -> float:
        """Return the order to be expected of a route for what happens in the motion."""
        if route.orders is None:
            return math.nan
        return declared_order(route.orders, self.limits)

    def _estimate(self, found: Found) -> float:
        """Return E, the error that the runs of a route tell of the finest."""
        if found.route.kind in ("exact", "solver"):
            return 0.0
        D = [self.apart(a, b) for a, b in zip(found.q, found.q[1:], strict=False)]
        if found.route.kind == "tolerance":
            return D[-1]
        p = self.declared(found.route)
        p = 1.0 if math.isnan(p) else p
        h = 1.0 / np.array(found.levels)
        if p > 2.0 and len(D) > 1:
            # Steps that are long beside the fastest period do not show a high order yet.
            seen = math.log(max(D[-2], 1e-300) / max(D[-1], 1e-300)) / math.log(h[-3] / h[-2])
            p, D, h = min(p, max(seen, 1.0)), D[-1:], h[-2:]
        C = max(d / (a**p - b**p) for d, a, b in zip(D, h, h[1:], strict=False))
        return float(C * h[-1] ** p)

    def apart(self, a: Array, b: Array) -> float:
        """Return the largest difference of two motions at the instants that both have."""
        step = (len(b) - 1) / (len(a) - 1)
        a, b = (a, b[:: round(step)]) if step >= 1.0 else (a[:: round(1.0 / step)], b)
        return float(np.abs(a - b)[:, self.judged].max())

    def allowed(self, a: str, b: str) -> float:
        """Return what two routes may differ by."""
        return FACTOR * (self.estimates[a] + self.estimates[b]) + self.floor

    def pairs(self) -> Iterator[dict[str, Any]]:
        """Yield each pair of routes, but for solvers, which are compared with the same steps only."""
        labels = [label for label, each in self.found.items() if each.route.kind != "solver"]
        for i, a in enumerate(labels):
            for b in labels[i + 1 :]:
                difference, allowed = self.apart(self.found[a].q[-1], self.found[b].q[-1]), self.allowed(a, b)
                yield {
                    "a": a, "b": b, "difference": difference, "allowed": allowed, "agrees": difference <= allowed,
                }  # fmt: skip

    def leader(self, pairs: Sequence[Mapping[str, Any]]) -> str | None:
        """Return the better of the two routes that agree most closely, so that each bears the other out.

        Where no two agree it is the one that errs least by its own account; a closed form, of which nothing is known but
        what it says, yields to a method.
        """

        def trust(label: str) -> tuple[float, bool]:
            return self.estimates[label], self.found[label].finest is None

        agreeing = [pair for pair in pairs if pair["agrees"]]
        if agreeing:
            closest = min(agreeing, key=lambda pair: pair["allowed"])
            return min((str(closest["a"]), str(closest["b"])), key=trust)
        independent = [label for label, each in self.found.items() if each.route.kind != "solver"]
        return min(independent, key=trust, default=None)

    def row(self, label: str, leader: str | None) -> dict[str, Any]:
        """Return how a route compares with the leader, and the leader with the best of the rest."""
        found = self.found[label]
        row: dict[str, Any] = {"route": label, "kind": found.route.kind, "failure": "", "declared": math.nan}
        if found.route.kind == "solver":
            return row | self._same_steps(found)
        others = [each for each, other in self.found.items() if each != label and other.route.kind != "solver"]
        if label == leader:
            others.sort(key=lambda each: self.estimates[each])
            against = others[0] if others else None
        else:
            against = leader
        if against is None:
            return row | {"against": "", "estimate": self.estimates[label], "agrees": True}
        difference, allowed = self.apart(found.q[-1], self.found[against].q[-1]), self.allowed(label, against)
        observed = self._observed(found, against)
        declared = self.declared(found.route) if found.route.kind == "steps" else math.nan
        slow = observed < declared - SLACK * max(declared, 2.0)
        return row | {
            "against": against, "difference": difference, "allowed": allowed, "estimate": self.estimates[label],
            "observed": observed, "declared": declared,
            "agrees": label == leader or (difference <= allowed and not slow),
        }  # fmt: skip

    def _observed(self, found: Found, against: str) -> float:
        """Return the slope of log error against log h, nan where the errors may be those of the other route, or rounding."""
        if found.route.kind != "steps" or len(found.levels) < 3:
            return math.nan
        truth = self.found[against].q[-1]
        errors = np.array([self.apart(q, truth) for q in found.q])
        clear = errors > 10.0 * (self.estimates[against] + self.floor)
        # A step that is long beside the fastest vibration shows no order: half of a bar's waves are not in its run.
        clear &= self.t_end / np.array(found.levels) * self.fastest < 1.0
        if self.declared(found.route) > 2.0:
            clear &= errors < ASYMPTOTIC * self.scale
        last = 2 if self.declared(found.route) > 2.0 else len(errors)
        if clear.sum() < min(last, 3):
            return math.nan
        h = -np.log(np.array(found.levels))
        return float(np.polyfit(h[clear][-last:], np.log(errors[clear][-last:]), 1)[0])

    def _same_steps(self, found: Found) -> dict[str, Any]:
        """Compare a solver with the same steps by another."""
        route = found.route
        for label, other in self.found.items():
            same = other.route.kind == "steps" and other.route.orders == route.orders and other.finest is not None
            if same and route.levels[0] in other.levels:
                difference = self.apart(found.q[0], other.q[other.levels.index(route.levels[0])])
                allowed = max(SOLVER_FACTOR * route.tol * self.scale, self.floor)
                return {
                    "against": label, "difference": difference, "allowed": allowed, "estimate": math.nan,
                    "agrees": difference <= allowed,
                }  # fmt: skip
        return {"against": "", "agrees": True, "failure": "there is no run with the same steps to compare it with"}


def _highest_frequency(problem: Problem) -> float:
    """Return the highest circular frequency in 1/s at which the masses vibrate on their springs."""
    d = problem.dynamics
    m = np.flatnonzero(d.massive)
    if len(m) == 0:
        return 0.0
    highest = eigh(d.K[np.ix_(m, m)], d.M[np.ix_(m, m)], eigvals_only=True)[-1]
    return math.sqrt(max(0.0, float(highest)))


def _reason(row: Mapping[str, Any]) -> str:
    """Return why a route is held to be wrong, "" where it is not."""
    if row["agrees"]:
        return ""
    what = f"{row['route']!r} disagrees with {row['against']!r}"
    if row["difference"] > row["allowed"]:
        return f"{what}: they differ by {row['difference']:.2g} m, and {row['allowed']:.2g} m is what " + (
            "the solver's tolerance allows" if row["kind"] == "solver" else "the errors of both allow"
        )
    return f"{what}: it converges with the order {row['observed']:.2g}, and declares {row['declared']:.2g} for such a motion"
