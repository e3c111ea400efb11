r"""Cross-validation: one motion computed by several independent routes, and a verdict on their agreement.

A route estimates its own error in each quantity that it provides. A time-stepping route runs with the steps
h_0 > h_1 > ..., each a third of the previous; with the declared order p of the method for the events of the motion,
successive runs differ by about :math:`D_j = C (h_j^p - h_{j+1}^p)`, so with the largest such C the error of the finest is

.. math:: E = C h_m^p.

For a route with a tolerance E is the difference between the runs with its two smallest tolerances; for the exact solution
and a closed form it is the rounding error. Two routes agree if their coordinates, velocities, forces, impulses and event
times differ by at most a factor times the sum of their estimates, and both have the same events. All are compared with the
more accurate of the two that agree most closely.

Agreement is evidence only if a common error is unlikely and an error would be detected. Routes confirm each other if

- they are of different families (`lcpimpact.study.accuracy.routes`), and if there are contacts, at least one pair of
  them chooses the contact mode independently;
- the differences of their own runs decrease with the order that each declares;
- their error estimates are small compared with the motion.

If no such pair agrees on each quantity, the verdict is that there is nothing to judge by. If a route fails before the end,
there is no agreement either. The closed-form values of the problem are checked on each route.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from itertools import pairwise
from textwrap import TextWrapper
from typing import Any, TypedDict

import numpy as np
import pandas as pd
from scipy.linalg import eigh

from lcpimpact.arguments import checked
from lcpimpact.arrays import Array, Flags
from lcpimpact.certificate.impact_choices import sentence
from lcpimpact.errors import FailureError, InputError, LcpImpactError, UnsupportedError
from lcpimpact.numbers import is_real, positive
from lcpimpact.problems.base import Problem
from lcpimpact.scheme.sparse_dynamics import TAKE_SCHEME
from lcpimpact.study.accuracy.limits import FRICTION, IMPACT, JUMP, declared_order, limits_of
from lcpimpact.study.accuracy.paired_events import Pairing, farthest, pair_events
from lcpimpact.study.accuracy.routes import (
    RATIO,
    Given,
    Reading,
    Route,
    RouteResult,
    by_label,
    default_routes,
    make_route,
    run_route,
    step_counts,
)
from lcpimpact.study.progress import Progress, watched
from lcpimpact.study.result import Study, table_lines

AGREEMENT_FACTOR = 5.0
"""Maximum difference of two agreeing routes, in units of the sum of their error estimates."""

ROUNDING_RTOL = 1e-9
"""Difference, relative to the size of the motion, attributed to rounding or a solver's tolerance."""

ACCUMULATION_RTOL = 1e-6
"""Tolerance of times and impulses, relative to the largest: routes truncate accumulations of impacts differently."""

COORDINATES = "coordinates"
VELOCITIES = "velocities"
FORCES = "forces"
IMPULSES, TIMES = "impulses", "times of events"

UNITS = {COORDINATES: "m", VELOCITIES: "m", FORCES: "N s", IMPULSES: "N s", TIMES: "s"}
"""Units of differences; the differences of velocities and forces are integrals over time."""


class Outcome(Enum):
    """The outcome of a cross-validation."""

    AGREE = "the routes agree"
    DISAGREE = "the routes do not agree"
    NOTHING = "nothing to judge by"


@dataclass(frozen=True, eq=False, repr=False)
class CrossValidation(Study):
    """The verdict on several routes to one motion.

    Attributes
    ----------
    problem : Problem
    table : DataFrame
        One row per route: ``route``; ``kind`` ("steps", "tolerance", "exact" or "solver"); ``family``, its integration
        rule; ``against``, the route it is compared with; ``difference`` (m), the largest of the coordinates at 195
        instants; ``allowed`` (m), its limit; ``estimate`` (m), the route's own error E; ``observed`` and ``declared`` order
        of the coordinates, NaN if not judged; ``events``, their number; ``agrees``, in all quantities; ``doubt``, why it
        cannot confirm another, else ""; ``failure``, why there is no motion, else "".
    pairs : DataFrame
        One row per pair of routes and quantity: ``a``, ``b``, ``quantity``, ``difference``, ``allowed``, ``scale`` (size of
        the motion), ``agrees``, and ``confirms``: whether they are of different families and free of doubt. Coordinates in m
        at 195 instants; velocities in m and forces in N s, integrated over time; impulses in N s; times of events in s.
    reasons : tuple of str
        Reasons of the verdict: disagreements with their size, missing evidence, unsupported and failed routes.
    outcome : Outcome
        AGREE, DISAGREE, or NOTHING to judge by.
    resolution : float
        Smallest detectable error, relative to the size of the motion: the maximum over the quantities of the smallest limit
        of a confirming pair. NaN without agreement.
    t_end : float
        s
    scale : float
        Size of the motion in the coordinates, in m.
    several : str
        Where several v⁺ obey the law of impact, or this was not examined, in words (see `lcpimpact.record.Event`); "" if
        nowhere. Routes that agree have taken the same one, and others obey the law too.
    """

    problem: Problem
    table: pd.DataFrame
    pairs: pd.DataFrame
    reasons: tuple[str, ...]
    outcome: Outcome
    resolution: float
    t_end: float
    scale: float
    several: str = ""

    drawn_by = "lcpimpact.plotting.comparison:plot_cross_validation"
    title = "{0.problem.name}: cross-validation"

    @property
    def agree(self) -> bool:
        """Whether there are independent routes, and all routes agree."""
        return self.outcome is Outcome.AGREE

    def __str__(self) -> str:
        return "\n".join([*self.head(), *self._indented()])

    def head(self) -> list[str]:
        """Return the verdict in one line."""
        completed = self.table[self.table["failure"] == ""]
        verdict = self.outcome.value
        if self.agree:
            families = completed["family"].nunique()
            verdict = f"{len(completed)} routes of {families} families agree, to {self.resolution:.1g} of the motion"
            if self.several.startswith("Several"):
                verdict += ", one of several that obey the laws"
        return [f"{self.problem.name}: {verdict}"]

    def summary(self) -> str:
        """Return the verdict, the routes, and the reasons."""
        columns = ["route", "family", "against", "difference", "allowed", "observed", "declared", "events", "agrees"]
        routes = table_lines(self.table.loc[self.table["failure"] == "", columns], ".2g")
        return "\n".join([*self.head(), "", *routes, *([""] * bool(self.reasons)), *self._indented()])

    def _indented(self) -> list[str]:
        """Return the reasons in lines that no page cuts."""
        fold = TextWrapper(78, initial_indent="  ", subsequent_indent="    ", break_on_hyphens=False)
        return [fold.fill(reason) for reason in self.reasons]


@checked
def cross_validate(
    problem: Problem,
    routes: Sequence[Given] | Mapping[str, Given] | None = None,
    *,
    dt: float | None = None,
    t_end: float | None = None,
    tol: float | None = None,
    progress: Progress = True,
) -> CrossValidation:
    """Compute one motion by several independent routes, and judge whether they agree.

    Parameters
    ----------
    problem : Problem
        Any problem.
    routes : sequence or mapping, optional
        Names of methods, "method:solver" for a method with another LCP solver (compared with the same steps by ``auto``),
        "closed form" (`Problem.motion`), "siconos", `Integrator` objects, or functions that take times (nt,) and return q
        and v (nt, n); a mapping gives them labels. By default `lcpimpact.study.accuracy.routes.default_routes`.
    dt : float, optional
        The finest step in s; by default t_end/5265. The coarser ones are 3, 9 and 27 times as long.
    t_end : float, optional
        End in s; by default that of the problem, to which its facts refer.
    tol : float, optional
        Minimum allowed difference, relative to the size of the motion; 1e-9 by default.
    progress : bool or callable
        As of `lcpimpact.study.progress`.

    Returns
    -------
    CrossValidation
        The verdict, the reasons, and the numbers.

    Raises
    ------
    InputError
        For an unknown route, a duplicate label, or invalid numbers.
    UnsupportedError
        For a `SparseScheme`.

    Examples
    --------
    >>> from lcpimpact import cross_validate, load_problem
    >>> verdict = cross_validate(load_problem("system-1"), ["exact", "moreau-jean", "rk4-paper"])
    >>> verdict.agree
    True

    A wrong closed form is detected:

    >>> import numpy as np
    >>> spring = load_problem("kelvin-voigt-tension")
    >>> wrong = lambda t: (0.99 * spring.motion(t)[0], spring.motion(t)[1])
    >>> verdict = cross_validate(spring, {"exact": "exact", "moreau-jean": "moreau-jean", "mine": wrong})
    >>> verdict.agree, verdict.reasons[0][:36]
    (False, "'mine' disagrees with 'exact': they ")

    Two variants of one method are no evidence:

    >>> print(cross_validate(spring, ["moreau-jean", "moreau-midpoint"]))  # doctest: +ELLIPSIS
    kelvin-voigt-tension: nothing to judge by
      ... are of one family, Moreau time stepping...
    """
    end = problem.t_end if t_end is None else t_end
    positive("t_end", end, "s")
    positive("dt", end if dt is None else dt, "s")
    if tol is not None and (not is_real(tol) or not 0.0 < tol < 1.0):
        raise InputError(f"tol = {tol!r} must be a number between 0 and 1, relative to the size of the motion")
    if problem.sparse:
        raise UnsupportedError(f"sparse matrices are run by one family of methods: {TAKE_SCHEME}")
    counts = step_counts(float(end), dt)
    given = by_label(default_routes(problem) if routes is None else routes)
    found: dict[str, RouteResult] = {}
    missing: dict[str, Missing] = {}
    for label, what in watched(given.items(), len(given), "routes", progress):
        route = make_route(problem, label, what, counts, float(end))
        try:
            found[label] = run_route(route)
        except LcpImpactError as error:
            missing[label] = Missing(route, str(error), isinstance(error, FailureError))
    return _judged(problem, given, found, missing, float(end), ROUNDING_RTOL if tol is None else tol)


class Pair(TypedDict):
    """The comparison of two routes in a quantity, with what the events of one lack."""

    a: str
    b: str
    quantity: str
    difference: float
    allowed: float
    scale: float
    agrees: bool
    missing: tuple[str, ...]
    confirms: bool


@dataclass(frozen=True, eq=False)
class Missing:
    """A route without a motion: the reason, and whether it failed or was unsupported."""

    route: Route
    why: str
    broke_off: bool


def _judged(
    problem: Problem,
    given: Mapping[str, Given],
    found: Mapping[str, RouteResult],
    missing: Mapping[str, Missing],
    t_end: float,
    tol: float,
) -> CrossValidation:
    """Compare the results, and return the verdict."""
    judge = Judge(problem, found, t_end, tol)
    pairs = list(judge.pairs())
    leader = judge.leader(pairs)
    rows = [
        judge.row(label, leader)
        if label in found
        else {
            "route": label, "kind": missing[label].route.kind, "family": missing[label].route.family, "against": "",
            "agrees": False, "doubt": "", "failure": missing[label].why,
        }
        for label in given
    ]  # fmt: skip
    columns = [
        *("route", "kind", "family", "against", "difference", "allowed", "estimate", "observed", "declared", "events"),
        *("agrees", "doubt", "failure"),
    ]
    table = pd.DataFrame(rows, columns=columns).astype({"events": "Int64"})
    broke_off = [f"{label!r} broke off: {each.why}" for label, each in missing.items() if each.broke_off]
    refused = [f"{label!r} was not run: {each.why}" for label, each in missing.items() if not each.broke_off]
    wrong = [reason for label in found for reason in judge.reasons(label, leader)]
    # A solver failure is no evidence about the motion.
    ended = any(each.broke_off and each.route.kind != "solver" for each in missing.values())
    lacking: list[str] = [] if wrong or ended else list(judge.lacking(pairs))
    outcome = Outcome.DISAGREE if wrong or ended else Outcome.NOTHING if lacking else Outcome.AGREE
    listed = pd.DataFrame(pairs, columns=["a", "b", "quantity", "difference", "allowed", "scale", "agrees", "confirms"])
    resolution = judge.resolution(pairs) if outcome is Outcome.AGREE else math.nan
    told = (
        sentence(problem.dynamics, each.trajectory.events) for each in found.values() if each.trajectory is not None
    )
    several = next(filter(None, told), "").strip()
    reasons = (*filter(None, [several]), *wrong, *broke_off, *lacking, *refused)
    scale = judge.scale[COORDINATES]
    return CrossValidation(problem, table, listed, reasons, outcome, resolution, t_end, scale, several)


class Judge:
    """The results of the routes to one motion, and their comparison.

    Parameters
    ----------
    problem : Problem
    found : mapping of str to RouteResult
    t_end : float
        In s.
    tol : float
        Relative to the size of the motion.
    """

    def __init__(self, problem: Problem, found: Mapping[str, RouteResult], t_end: float, tol: float) -> None:
        self.problem = problem
        self.t_end = t_end
        self.found = found
        massive = problem.dynamics.massive
        self.judged: Flags = massive if massive.any() else ~massive
        self.fastest = _highest_frequency(problem)
        independent = {label: each for label, each in found.items() if each.route.kind != "solver"}
        runs = [each.trajectory for each in independent.values() if each.trajectory is not None]
        runs.sort(key=lambda run: run.dense is None)
        self.limits = limits_of(runs[0]) if runs else ()
        degrees = [contact.relative_degree for contact in problem.dynamics.contacts if contact.impenetrable]
        self.quantities = [COORDINATES, VELOCITIES, *[FORCES, TIMES] * bool(problem.dynamics.contacts)]
        self.quantities += [IMPULSES] * (2 in degrees)
        # The median, so that a divergent route does not dominate the scale.
        sizes = [self._sizes(each.finest) for each in independent.values()]
        self.scale = {
            quantity: float(np.median([size[quantity] for size in sizes if quantity in size] or [0.0]))
            for quantity in self.quantities
        }
        self.floor = {quantity: tol * self.scale[quantity] for quantity in self.quantities}
        self.floor |= {
            quantity: max(tol, ACCUMULATION_RTOL) * self.scale[quantity]
            for quantity in (TIMES, IMPULSES)
            if quantity in self.scale
        }
        self.estimates = {label: self._estimates(each) for label, each in independent.items()}
        self.doubts = {label: self._doubts(label) for label in independent}

    # ---- readings, and their differences -----------------------------------------------------------------------------

    def _sizes(self, reading: Reading) -> dict[str, float]:
        """Return the size of the motion in each quantity of a run."""
        sizes = {COORDINATES: float(np.abs(reading.q[:, self.judged]).max()), TIMES: self.t_end}
        if reading.v is not None:
            sizes[VELOCITIES] = self._integral(reading.v[:, self.judged])
        if reading.r is not None and reading.events is not None and reading.r.shape[1]:
            impulses = [event.impulse for event in reading.events]
            sizes[IMPULSES] = max(map(abs, impulses), default=0.0)
            sizes[FORCES] = float(np.abs(reading.r).mean(axis=0).max() * self.t_end + sum(map(abs, impulses)))
        return sizes

    def _integral(self, values: Array) -> float:
        """Return the integral over time of the sum of |values| (nf, m), sampled once in each of equal steps."""
        return float(np.abs(values).sum(axis=1).mean() * self.t_end)

    def apart(self, quantity: str, a: Reading, b: Reading) -> float:
        """Return the difference of two runs in coordinates, velocities or forces, NaN if one lacks them."""
        if quantity == COORDINATES:
            step = (len(b.q) - 1) / (len(a.q) - 1)
            p, q = (a.q, b.q[:: round(step)]) if step >= 1.0 else (a.q[:: round(1.0 / step)], b.q)
            return float(np.abs(p - q)[:, self.judged].max())
        if quantity == VELOCITIES:
            return math.nan if a.v is None or b.v is None else self._integral((a.v - b.v)[:, self.judged])
        if a.r is None or b.r is None or not self.problem.dynamics.contacts:
            return math.nan
        return float(np.abs(a.r - b.r).mean(axis=0).max() * self.t_end)

    def paired(self, a: Reading, b: Reading, window: float, least: float) -> Pairing | None:
        """Return the differences of the events of two runs, None if one lacks them."""
        if a.events is None or b.events is None:
            return None
        return pair_events(a.events, b.events, window, self.t_end, least)

    # ---- error estimates of the routes ------------------------------------------------------------------------------

    def declared(self, route: Route, quantity: str = COORDINATES) -> float:
        """Return the expected order of a route for the events of the motion; NaN if none is declared.

        Velocities and forces known only at grid points are interpolated linearly, which limits the order to 2; across a
        jump of a force the error equals the jump during one step.
        """
        if route.orders is None:
            return math.nan
        order = declared_order(route.orders, self.limits)
        if quantity == COORDINATES or (found := self.found[route.label].trajectory) is None or found.dense is not None:
            return order
        if quantity == FORCES:
            jumps = any(limit in self.limits for limit in (JUMP, FRICTION, IMPACT))
        else:
            # Without any mass velocities follow the forces.
            jumps = len(self.limits) > 1 and not self.problem.dynamics.massive.any()
        return min(order, 1.0 if jumps else 2.0)

    def _estimates(self, found: RouteResult) -> dict[str, float]:
        """Return E, the estimated error of the finest run of a route, for each quantity."""
        E = {quantity: self._estimate(found, quantity) for quantity in (COORDINATES, VELOCITIES, FORCES)}
        if found.finest.events is not None:
            E |= self._event_estimates(found)
        return {quantity: E[quantity] for quantity in self.quantities if not math.isnan(E.get(quantity, math.nan))}

    def _differences(self, found: RouteResult, quantity: str) -> Array:
        """Return the difference of each run from the next finer one."""
        pairs = zip(found.readings, found.readings[1:], strict=False)
        return np.array([self.apart(quantity, coarse, fine) for coarse, fine in pairs])

    def _estimate(self, found: RouteResult, quantity: str) -> float:
        """Return E for coordinates, velocities or forces, NaN if the route lacks them."""
        if found.route.kind == "exact":
            return self.apart(quantity, found.finest, found.finest)
        D = self._differences(found, quantity)
        if len(D) == 0:
            return math.inf
        if found.route.kind == "tolerance":
            return float(D[-1])
        p = self.declared(found.route, quantity)
        p = 1.0 if math.isnan(p) else p
        h = 1.0 / np.array(found.levels)
        if p > 2.0 and len(D) > 1:
            # Steps that are long compared with the shortest period are not yet in the asymptotic range.
            seen = math.log(max(D[-2], 1e-300) / max(D[-1], 1e-300)) / math.log(h[-3] / h[-2])
            p = min(p, max(seen, 1.0))
            D = D[-1:]
            h = h[-2:]
        C = max(d / (a**p - b**p) for d, a, b in zip(D, h, h[1:], strict=False))
        return float(C * h[-1] ** p)

    def _event_estimates(self, found: RouteResult) -> dict[str, float]:
        """Return E for event times and impulses, from the last two runs.

        A run without event location resolves events to one step, with order 1 across impacts.
        """
        if found.route.kind == "exact":
            return {TIMES: 0.0, IMPULSES: 0.0}
        if len(found.readings) < 2:
            return {TIMES: math.inf, IMPULSES: math.inf}
        events = [reading.events or () for reading in found.readings]
        pairs = list(pairwise(events))
        if found.trajectory is None or found.trajectory.dense is not None:
            E = farthest(*pairs[-1], self.t_end)
            return {TIMES: E, IMPULSES: pair_events(*pairs[-1], 2.0 * AGREEMENT_FACTOR * E, self.t_end, 0.0).impulse}
        # In what the coarsest runs have, events may be missing.
        pairs, h = pairs[-2:], self.t_end / np.array(found.levels)
        E = max(float(h[-1]), _first_order([farthest(*pair, self.t_end) for pair in pairs], h))
        window = AGREEMENT_FACTOR * (1.0 + RATIO) * E
        return {TIMES: E, IMPULSES: _first_order([pair_events(*p, window, self.t_end, 0.0).impulse for p in pairs], h)}

    def observed(self, found: RouteResult, quantity: str = COORDINATES, *, asymptotic_rtol: float = 1e-3) -> float:
        """Return the slope of log D over log h in a route's own refinement, NaN if there is none.

        Differences at rounding level are excluded, and steps that are long compared with the shortest vibration period,
        which do not resolve the waves of a bar.

        ``asymptotic_rtol``: error, relative to the size of the motion, below which an order above 2 is
        observable.
        """
        if found.route.kind != "steps" or len(found.levels) < 3:
            return math.nan
        D = self._differences(found, quantity)
        if self.declared(found.route, quantity) <= 1.0:
            # An error depends on where in a step an event is, and a coarse run may have a small one by chance.
            D = np.maximum.accumulate(D[::-1])[::-1]
        h = self.t_end / np.array(found.levels)[:-1]
        clear = (10.0 * self.floor[quantity] < D) & (h * self.fastest < 1.0)
        high = self.declared(found.route, quantity) > 2.0
        if high:
            clear &= asymptotic_rtol * self.scale[quantity] > D
        if clear.sum() < 2:
            return math.nan
        last = 2 if high else len(D)
        return float(np.polyfit(np.log(h[clear][-last:]), np.log(D[clear][-last:]), 1)[0])

    def _expected(self, found: RouteResult) -> float:
        return self.declared(found.route) if found.route.kind == "steps" else math.nan

    def slow(self, found: RouteResult, quantity: str, *, order_slack: float = 0.35) -> bool:
        """Whether a route converges more slowly than declared or, without a declared order, does not converge.

        ``order_slack``: maximum shortfall of an observed order, relative to the smaller of the declared order
        and 2.
        """
        declared = self.declared(found.route, quantity)
        declared = 1.0 if math.isnan(declared) else declared
        return self.observed(found, quantity) < declared - order_slack * max(declared, 2.0)

    def _doubts(self, label: str, *, rough_rtol: float = 0.2) -> dict[str, str]:
        """Return for each quantity why a route cannot confirm it, else "".

        ``rough_rtol``: AGREEMENT_FACTOR times the error, relative to the size of the motion, above which a
        route is too inaccurate.
        """
        found, E = self.found[label], self.estimates[label]
        doubts = {}
        for quantity in E:
            allowed = AGREEMENT_FACTOR * E[quantity]
            doubts[quantity] = ""
            if allowed > rough_rtol * self.scale[quantity] and allowed > self.floor[quantity]:
                size = f"{allowed / self.scale[quantity]:.0%}" if self.scale[quantity] > 0.0 else "all"
                doubts[quantity] = f"too rough: its {quantity} may be off by {size} of their size; take a smaller dt"
        if found.route.kind == "steps":
            # Across impacts an order is declared of the integral of |v - v*|, which bounds the error of q.
            quantities = (VELOCITIES,) if IMPACT in self.limits and VELOCITIES in E else (COORDINATES, VELOCITIES)
            for quantity in quantities:
                if quantity in E and (doubt := self._doubtful_order(found, quantity)):
                    return dict.fromkeys(doubts, doubt)
        return doubts

    def _doubts_of(self, label: str) -> list[str]:
        """Return the doubts about a route, each once."""
        return list(dict.fromkeys(doubt for doubt in self.doubts[label].values() if doubt))

    def undecided(self, label: str) -> bool:
        """Whether no order of the coordinates is observable from the runs of a route."""
        found = self.found[label]
        return (
            found.route.kind == "steps"
            and not self.slow(found, COORDINATES)
            and bool(self._doubtful_order(found, COORDINATES))
        )

    def _doubtful_order(self, found: RouteResult, quantity: str) -> str:
        """Return why the refinement of a route does not support its estimate, "" if it does."""
        D = self._differences(found, quantity)
        observed = self.observed(found, quantity)
        if self.slow(found, quantity):
            declared = self.declared(found.route, quantity)
            text = f"{declared:.2g}" if not math.isnan(declared) else "none"
            return f"its {quantity} converge with the order {observed:.2g}, and it declares {text} for such a motion"
        settled = len(D) > 0 and D[-1] <= 10.0 * self.floor[quantity]
        falling = self.declared(found.route, quantity) > 2.0 and len(D) > 1 and D[-1] < 0.5 * D[-2]
        if math.isnan(observed) and not settled and not falling:
            return f"its runs show no order of its {quantity}: take a smaller dt"
        return ""

    # ---- pairs ----------------------------------------------------------------------------------------------------------

    def allowed(self, a: str, b: str, quantity: str) -> float:
        """Return the allowed difference of two routes."""
        return AGREEMENT_FACTOR * (self.estimates[a][quantity] + self.estimates[b][quantity]) + self.floor[quantity]

    def compared(self, a: str, b: str) -> Iterator[Pair]:
        """Yield the comparison of two routes in each common quantity."""
        one, other = self.found[a].finest, self.found[b].finest
        both = [each for each in self.quantities if each in self.estimates[a] and each in self.estimates[b]]
        pairing = None
        if TIMES in both:
            least = self.allowed(a, b, IMPULSES) if IMPULSES in both else 0.0
            pairing = self.paired(one, other, self.allowed(a, b, TIMES), least)
        for quantity in both:
            allowed = self.allowed(a, b, quantity)
            missing: tuple[str, ...] = ()
            if quantity == TIMES and pairing is not None:
                difference, missing = pairing.time, pairing.missing
            elif quantity == IMPULSES and pairing is not None:
                difference = pairing.impulse
            else:
                difference = self.apart(quantity, one, other)
            families = self.found[a].route.family, self.found[b].route.family
            yield {
                "a": a, "b": b, "quantity": quantity, "difference": difference, "allowed": allowed,
                "scale": self.scale[quantity], "agrees": difference <= allowed and not missing, "missing": missing,
                "confirms": families[0] != families[1] and not self.doubts[a][quantity] and not self.doubts[b][quantity],
            }  # fmt: skip

    def pairs(self) -> Iterator[Pair]:
        """Yield the comparison of each pair of routes; solvers are compared only with the same steps."""
        labels = list(self.estimates)
        for i, a in enumerate(labels):
            for b in labels[i + 1 :]:
                yield from self.compared(a, b)

    def leader(self, pairs: Sequence[Pair]) -> str | None:
        """Return the more accurate of the two routes that agree most closely, else the one that no closed form refutes.

        Two methods are preferred, and of two routes the method: a closed form has no estimate, so a coarse method that
        agrees with a wrong one is no evidence against an accurate method.
        """

        def trust(label: str) -> tuple[bool, float]:
            return self.found[label].trajectory is None, self.estimates[label][COORDINATES]

        apart = {(pair["a"], pair["b"]) for pair in pairs if not pair["agrees"]}
        agreeing = [p for p in pairs if p["quantity"] == COORDINATES and (p["a"], p["b"]) not in apart]
        if not agreeing:
            sound = [label for label in self.estimates if not self.facts(label)]
            return sound[0] if len(sound) == 1 else None
        closest = min(agreeing, key=lambda pair: (trust(pair["a"])[0] + trust(pair["b"])[0], pair["allowed"]))
        return min((closest["a"], closest["b"]), key=trust)

    # ---- the verdict ------------------------------------------------------------------------------------------------

    def against(self, label: str, leader: str | None) -> str | None:
        """Return the route that one is compared with: the leader, or without it, and for it, the best of the rest."""
        if leader not in (None, label):
            return leader
        others = [each for each in self.estimates if each != label]
        return min(others, key=lambda each: self.estimates[each][COORDINATES], default=None)

    def row(self, label: str, leader: str | None) -> dict[str, Any]:
        """Return the comparison of a route with the leader, or of the leader with the best of the rest."""
        found = self.found[label]
        events = found.trajectory.events if found.trajectory is not None else None
        row: dict[str, Any] = {
            "route": label, "kind": found.route.kind, "family": found.route.family, "failure": "",
            "events": None if events is None else len(events), "declared": math.nan,
        }  # fmt: skip
        if found.route.kind == "solver":
            return row | self._same_steps(found) | {"doubt": "another solver of the same steps"}
        row |= {"estimate": self.estimates[label][COORDINATES], "doubt": "; ".join(self._doubts_of(label))}
        row |= {"observed": self.observed(found), "declared": self._expected(found)}
        row["agrees"] = not self.reasons(label, leader)
        against = self.against(label, leader)
        if against is None:
            return row | {"against": ""}
        coordinates = next(self.compared(label, against))
        return row | {
            "against": against, "difference": coordinates["difference"], "allowed": coordinates["allowed"],
        }  # fmt: skip

    def reasons(self, label: str, leader: str | None) -> list[str]:
        """Return why a route is judged wrong, in sentences."""
        found = self.found[label]
        if found.route.kind == "solver":
            return _solver_reason(label, self._same_steps(found))
        reasons = self.facts(label)
        other = self.against(label, leader)
        if label == leader or other is None:
            return reasons
        apart = [each for each in self.compared(label, other) if not each["agrees"]]
        # Outside the asymptotic range the estimates are not bounds.
        if apart and not any(self.undecided(each) for each in (label, other)):
            alone = (
                ""
                if leader
                else ", and no two routes agree, which would tell the wrong one: add a route of another family"
            )
            reasons.insert(0, f"{label!r} disagrees with {other!r}: {_in_words(apart)}{alone}")
        elif self.slow(found, COORDINATES) and self.declared(found.route) > 1.0:
            reasons.insert(0, f"{label!r} disagrees with {other!r}: {self._doubtful_order(found, COORDINATES)}")
        return reasons

    def facts(self, label: str) -> list[str]:
        """Return a sentence for each contradiction of a route with the closed-form values."""
        wrong = list(self._wrong_facts(label))
        more = f", and {len(wrong) - 1} more" if len(wrong) > 1 else ""
        return [f"{label!r} is wrong by a closed form: {wrong[0]}{more}"] if wrong else []

    def _wrong_facts(self, label: str) -> Iterator[str]:
        found = self.found[label]
        if found.finest.facts is None or len(found.finest.facts) == 0:
            return
        values = np.array([reading.facts for reading in found.readings if reading.facts is not None])
        for k, fact in enumerate(self.problem.facts):
            shown = values[:, k]
            size = max(abs(fact.value), fact.scale)
            allowed = fact.accuracy * size
            if found.route.kind != "exact":
                apart = np.abs(np.diff(shown))
                if len(apart) == 0 or np.isnan(apart).any():
                    continue
                steps = found.route.kind == "steps"
                E = _first_order(apart, 1.0 / np.array(found.levels)) if steps else float(apart[-1])
                allowed += AGREEMENT_FACTOR * E + (self._relative_error(label) + ACCUMULATION_RTOL) * size
            if not abs(shown[-1] - fact.value) <= allowed:
                text = "cannot be read" if math.isnan(shown[-1]) else f"is {shown[-1]:.9g} {fact.unit}".rstrip()
                yield f"{fact.symbol} ({fact.what}) {text}, and must be {fact.value:.9g} {fact.unit}".rstrip()

    def _relative_error(self, label: str) -> float:
        """Return the largest of the routes' own error estimates in motion and times, relative to their size."""
        E = self.estimates[label]
        known = [each for each in (COORDINATES, VELOCITIES, TIMES) if each in E and self.scale[each] > 0.0]
        return max((AGREEMENT_FACTOR * E[each] / self.scale[each] for each in known), default=0.0)

    def lacking(self, pairs: Sequence[Pair]) -> Iterator[str]:
        """Yield the reasons why there is no verdict."""
        doubts = [f"{label!r}: {doubt}" for label in self.estimates for doubt in self._doubts_of(label)]
        if len(self.estimates) < 2:
            only = [label for label, each in self.found.items() if each.route.kind == "solver"]
            yield "fewer than two routes were run, so nothing was compared" + (
                f"; {', '.join(map(repr, only))} only solve the LCPs of the same steps again" if only else ""
            )
            yield from doubts
            return
        families = {self.found[label].route.family for label in self.estimates}
        if len(families) == 1:
            routes = ", ".join(map(repr, self.estimates))
            yield f"{routes} are of one family, {families.pop()}, and could have the same errors: add a route of another"
            yield from doubts
            return
        confirming = [pair for pair in pairs if pair["confirms"]]
        without = [each for each in self.quantities if each not in {pair["quantity"] for pair in confirming}]
        for quantity in without:
            yield self._unconfirmed(quantity)
        if without or not self.problem.dynamics.contacts:
            return
        for quantity in (COORDINATES, VELOCITIES):
            if not any(self._have_independent_modes(p["a"], p["b"]) for p in confirming if p["quantity"] == quantity):
                alike = dict.fromkeys(label for pair in confirming for label in (pair["a"], pair["b"]))
                yield (
                    f"{', '.join(map(repr, alike))} take the contact mode from one source, lcpimpact.hybrid.mode_choice, "
                    "and could have the same errors: add a time-stepping route with a dt that shows its order"
                )
                yield from doubts
                return

    def resolution(self, pairs: Sequence[Pair]) -> float:
        """Return the largest limit of confirming pairs, each quantity by its best pair, relative to the motion."""
        best = dict.fromkeys(self.quantities, math.inf)
        for pair in pairs:
            needs_modes = pair["quantity"] in (COORDINATES, VELOCITIES) and self.problem.dynamics.contacts
            if pair["confirms"] and (not needs_modes or self._have_independent_modes(pair["a"], pair["b"])):
                size = pair["allowed"] / pair["scale"] if pair["scale"] > 0.0 else 0.0
                best[pair["quantity"]] = min(best[pair["quantity"]], size)
        return max(best.values())

    def _have_independent_modes(self, a: str, b: str) -> bool:
        one = self.found[a].route.mode_choice
        other = self.found[b].route.mode_choice
        return one != other or not one

    def _unconfirmed(self, quantity: str) -> str:
        """Return why no two routes confirm each other in a quantity."""
        known = [label for label in self.estimates if quantity in self.estimates[label]]
        doubted = [f"{label!r} ({self.doubts[label][quantity]})" for label in known if self.doubts[label][quantity]]
        sound = [label for label in known if not self.doubts[label][quantity]]
        by = f"by {' and '.join(map(repr, sound))} alone" if sound else "by no reliable route"
        families = {self.found[label].route.family for label in sound}
        if len(sound) > 1 and len(families) == 1:
            by = f"by one family alone, {families.pop()}"
        return f"{quantity} are computed {by}" + (f"; not by {', '.join(doubted)}" if doubted else "")

    def _same_steps(self, found: RouteResult, *, solver_factor: float = 100.0) -> dict[str, Any]:
        """Compare a solver with the same steps by another.

        ``solver_factor``: maximum error of a run, relative to the size of the motion, in units of the tolerance
        of its solver.
        """
        route = found.route
        for label, other in self.found.items():
            same = other.route.kind == "steps" and other.route.orders == route.orders and other.trajectory is not None
            if same and route.levels[0] in other.levels:
                reading = other.readings[other.levels.index(route.levels[0])]
                difference = self.apart(COORDINATES, found.finest, reading)
                allowed = max(solver_factor * route.tol * self.scale[COORDINATES], self.floor[COORDINATES])
                return {
                    "against": label, "difference": difference, "allowed": allowed, "estimate": math.nan,
                    "agrees": difference <= allowed,
                }  # fmt: skip
        return {"against": "", "agrees": True, "failure": "there is no run with the same steps to compare it with"}


def _first_order(D: Sequence[float] | Array, h: Array) -> float:
    """Return E = C h_m, with the largest C of the differences D of the last runs, of steps h."""
    h = h[-len(D) - 1 :]
    return float(max(d / (a - b) for d, a, b in zip(D, h, h[1:], strict=False)) * h[-1])


def _highest_frequency(problem: Problem) -> float:
    """Return the highest circular frequency in 1/s at which the masses vibrate on their springs."""
    d = problem.dynamics
    m = np.flatnonzero(d.massive)
    if len(m) == 0:
        return 0.0
    d = d.at(0.0, problem.initial_coordinates, problem.initial_velocities)
    K = 0.5 * (d.K + d.K.T)  # that of a Lagrangian system has gyroscopic parts
    highest = eigh(K[np.ix_(m, m)], d.M[np.ix_(m, m)], eigvals_only=True)[-1]
    return math.sqrt(max(0.0, float(highest)))


def _in_words(apart: Sequence[Pair]) -> str:
    """Return the quantities in which two routes differ, the first with numbers."""
    first = apart[0]
    quantity, unit = first["quantity"], UNITS[first["quantity"]]
    if first["missing"]:
        text = f"one has {first['missing'][0]}" + (
            f", and {len(first['missing']) - 1} more differences of their events" if len(first["missing"]) > 1 else ""
        )
    else:
        text = (
            f"they differ by {first['difference']:.2g} {unit} in {quantity}, and the errors of both allow "
            f"{first['allowed']:.2g} {unit}"
        )
    rest = [each["quantity"] for each in apart[1:]]
    return text + (f"; so do {', '.join(rest)}" if rest else "")


def _solver_reason(label: str, row: Mapping[str, Any]) -> list[str]:
    if row["agrees"]:
        return []
    return [
        f"{label!r} disagrees with {row['against']!r}: they differ by {row['difference']:.2g} m, and the tolerance of "
        f"the solver allows {row['allowed']:.2g} m"
    ]
