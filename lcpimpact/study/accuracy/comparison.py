"""Comparison of methods on one problem: errors, events, forces and energies."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import combinations
from typing import Literal

import numpy as np
import pandas as pd

from lcpimpact.arguments import checked
from lcpimpact.arrays import Array
from lcpimpact.errors import InputError, LcpImpactError, UnsupportedError
from lcpimpact.integrators.base import Integrator
from lcpimpact.numbers import positive
from lcpimpact.problems.base import Problem
from lcpimpact.simulation import make_integrator
from lcpimpact.study.accuracy.convergence import Penalty, labelled, penalized_by
from lcpimpact.study.accuracy.error_of_run import error_against
from lcpimpact.study.accuracy.norms import NORMS, error_norms
from lcpimpact.study.accuracy.reference import Reference, given_reference
from lcpimpact.study.accuracy.reference import reference as find_reference
from lcpimpact.study.ledger import Ledger, energy_ledger
from lcpimpact.study.progress import Progress, watched
from lcpimpact.study.result import Study, table_lines
from lcpimpact.sweeps.job import Job
from lcpimpact.trajectory import Trajectory

REFERENCE = "reference"
"""Label of the reference in tables."""

SHOWN_NORMS = ("sup_q", "l1_v", "hausdorff_v", "event_times", "impulses", "penetration")
"""Norms shown in a summary; the table has all."""

SHOWN_EVENTS = 12
"""Maximum number of events in a summary."""


@dataclass(frozen=True, eq=False, repr=False)
class Comparison(Study):
    """Runs of one problem by several methods.

    Attributes
    ----------
    problem : Problem
    t_end : float               s
    runs : dict                 label to Trajectory, for the methods that reached the end, in input order
    reasons : dict              label to the reason why there is no run
    reference : Reference or None
        The common reference; None if they are compared with each other.
    """

    problem: Problem
    t_end: float
    runs: Mapping[str, Trajectory]
    reasons: Mapping[str, str] = field(default_factory=dict)
    reference: Reference | None = None

    drawn_by = "lcpimpact.plotting.comparison:plot_comparison"
    title = "{0.problem.name}: methods side by side"

    @cached_property
    def table(self) -> pd.DataFrame:
        """The errors of each run against the reference, or the differences of each pair without one.

        Columns: ``method``, ``against`` (the reference by its name, or another label), ``dt`` (s) and ``steps`` of the run,
        one column per norm of `lcpimpact.study.accuracy.norms.NORMS` in its unit, ``events`` (their number), ``seconds``
        of the run, ``violation``: laws violated beyond the tolerance of the method, "" for none, and ``failure``: why
        there is no run, else "".
        """
        pairs: list[tuple[str, Trajectory, str, Trajectory]]
        if self.reference is not None:
            pairs = [(name, run, self.reference.name, self.reference.trajectory) for name, run in self.runs.items()]
        else:
            pairs = [(a, x, b, y) for (a, x), (b, y) in combinations(self.runs.items(), 2)]
        rows = [
            {
                "method": name,
                "against": against,
                "dt": run.t[-1] / (len(run.t) - 1),
                "steps": len(run.t) - 1,
                **_finite(run, truth),
                "events": len(run.events),
                "seconds": run.stats.seconds,
                "violation": "" if run.success else run.message,
                "failure": "",
            }
            for name, run, against, truth in pairs
        ]
        rows += [{"method": name, "against": "", "violation": "", "failure": why} for name, why in self.reasons.items()]
        columns = ["method", "against", "dt", "steps", *NORMS, "events", "seconds", "violation", "failure"]
        return pd.DataFrame(rows, columns=columns).astype({"steps": "Int64", "events": "Int64"})

    def summary(self) -> str:
        """Return the differences, the events side by side, and the energies at the end."""
        differences = self.table
        events = self.events()
        energies = self.energies()
        broken = differences[differences["violation"] != ""].drop_duplicates("method")
        against = "each other" if self.reference is None else self.reference.name
        number = len(self.runs) + len(self.reasons)
        lines = [f"{self.problem.name}, {number} methods against {against}, to {self.t_end:g} s", ""]
        lines += table_lines(differences.loc[differences["failure"] == "", ["method", "steps", *SHOWN_NORMS]], ".2e")
        lines += [f"  error of {label}: {'; '.join(each)}" for label, each in self._errors().items() if each]
        lines += [f"  {why}" for why in broken["violation"]]
        lines += [f"  {label}: {why}" for label, why in self.reasons.items()]
        if len(events):
            lines += ["", *table_lines(events.head(SHOWN_EVENTS), ".6f")]
            lines += [f"  and {len(events) - SHOWN_EVENTS} more events"] * (len(events) > SHOWN_EVENTS)
        if len(energies):
            lines += ["", "  energies at the end in J", *table_lines(energies, ".5g")]
        return "\n".join(lines)

    def events(self) -> pd.DataFrame:
        """Return the events side by side: one row for the k-th of each contact and kind, in order of time.

        Returns
        -------
        DataFrame
            ``contact``, ``kind``, ``k`` (from 1), then a column of times in s for the reference, if any, and for each
            method, NaN for a missing event, and ``spread``, the latest minus the earliest.
        """
        runs = self._all()
        found: dict[tuple[str, str, int], dict[str, float]] = {}
        for label, run in runs.items():
            count: dict[tuple[str, str], int] = {}
            for event in run.events:
                what = (event.contact, event.kind)
                count[what] = count.get(what, 0) + 1
                found.setdefault((*what, count[what]), {})[label] = event.t
        rows = [
            {"contact": contact, "kind": kind, "k": k, **dict.fromkeys(runs, math.nan), **times}
            for (contact, kind, k), times in found.items()
        ]
        table = pd.DataFrame(rows, columns=["contact", "kind", "k", *runs])
        times = table[list(runs)]
        table["spread"] = times.max(axis=1) - times.min(axis=1)
        order = times.min(axis=1).to_numpy().argsort(kind="stable")
        return table.iloc[order].reset_index(drop=True)

    def forces(self) -> pd.DataFrame:
        """Return the forces of all contacts, including compliant ones, by all methods, each at its own instants.

        A step force refers to one instant of its step and is not interpolated. The reference force, if it is known at all
        times, is evaluated at these instants as the right limit.

        Returns
        -------
        DataFrame
            ``method``, ``contact``, ``t`` (s), ``r`` (N), ``reference`` (N) and ``difference`` (N), the last two NaN
            without a reference known at all times.
        """
        truth = None if self.reference is None else self.reference.trajectory
        parts = []
        for label, run in self.runs.items():
            t, d = run.t_reaction, self.problem.dynamics
            known: dict[str, Array] = {}
            if truth is not None and truth.dense is not None and len(t):
                state = truth.sample(np.minimum(t, truth.t[-1]))
                known = dict(
                    zip(truth.force_names, np.hstack([state.reaction, d.push(state.q, state.v)]).T, strict=True)
                )
            for contact, r in zip(run.force_names, run.forces.T, strict=True):
                there = known.get(contact, np.full(len(t), np.nan))
                columns = {"t": t, "r": r, "reference": there, "difference": r - there}
                parts.append(pd.DataFrame({"method": label, "contact": contact, **columns}))
        names = ["method", "contact", "t", "r", "reference", "difference"]
        return pd.concat(parts, ignore_index=True) if parts else pd.DataFrame(columns=names)

    def ledgers(self) -> dict[str, Ledger]:
        """Return the energy ledger of each run, and of the reference under "reference"; none for a system given directly."""
        try:
            return {label: energy_ledger(run) for label, run in self._all().items()}
        except UnsupportedError:
            return {}

    def energies(self) -> pd.DataFrame:
        """Return the final value of each ledger: ``item``, then a column in J for the reference and each method."""
        ledgers = self.ledgers()
        columns = {label: ledger.totals.set_index("item")["end"] for label, ledger in ledgers.items()}
        return pd.DataFrame(columns).rename_axis("item").reset_index() if columns else pd.DataFrame(columns=["item"])

    def _errors(self) -> dict[str, list[str]]:
        """Return the error of each run in words: against the reference if that is exact, else where it is quick."""
        truth = None if self.reference is None else self.reference.trajectory
        if truth is None or truth.integrator is None or not truth.integrator.declared.is_exact:
            return {label: run.error_lines() for label, run in self.runs.items()}
        unit = self.problem.unit
        return {
            label: error_against(run, truth).lines(unit) if run.problem is self.problem else run.error_lines()
            for label, run in self.runs.items()
            if run.estimates
        }

    def _all(self) -> dict[str, Trajectory]:
        """Return the reference followed by the runs."""
        first = {} if self.reference is None else {REFERENCE: self.reference.trajectory}
        return {**first, **self.runs}


Views = Sequence[str | Integrator] | Mapping[str, str | Integrator | tuple[Problem, str | Integrator]]
"""Methods as of `Methods`, or by label too a variant of the problem and a method."""


@checked
def compare(
    problem: Problem,
    methods: Views,
    *,
    dt: float | Mapping[str, float],
    t_end: float | None = None,
    penalties: Sequence[Penalty] = (),
    reference: Trajectory | Reference | Literal["auto"] | None = "auto",
    lcp_solver: str = "auto",
    progress: Progress = True,
) -> Comparison:
    """Run one problem by several methods, and its compliant variants, and compare the results.

    With ``penalties`` one picture shows an impact in three views: rigid, with a law for the velocities; as the limit of a
    stiff law; and as an event between smooth motions.

    Parameters
    ----------
    problem : Problem
        Any problem.
    methods : sequence or mapping
        Names of ``lcpimpact list methods`` or `Integrator` objects; the keys of a mapping are their labels. A pair
        ``(variant, method)`` in a mapping runs another problem with the same coordinates, as one by `penalized`.
    dt : float or mapping
        Step in s of all methods, or of each by label; shortened to divide t_end.
    t_end : float, optional
        End in s; by default that of the problem.
    penalties : sequence of tuples
        ``(law, k)`` or ``(law, k, {"e": ...})`` for each compliant variant, as in `penalized`. It is run by
        ``event-driven``, so that its difference from the rigid motion is that of the model.
    reference : Trajectory, Reference, "auto" or None
        Reference of the errors. "auto" is `lcpimpact.reference`, by a method not among those
        compared, if available; None compares the runs with each other.
    lcp_solver : str
        A name of ``lcpimpact list solvers``, for the methods that solve LCPs.
    progress : bool or callable
        As of `lcpimpact.study.progress`.

    Returns
    -------
    Comparison
        The runs, and the reasons of those missing; its methods return the tables.

    Raises
    ------
    InputError
        For an unknown method, a duplicate label, an invalid step, or a variant with other coordinates.

    Examples
    --------
    >>> from lcpimpact import compare, load_problem
    >>> ball = load_problem("bouncing-ball", e=0.8)
    >>> views = compare(ball, ["moreau-jean", "exact"], dt=1e-3, t_end=1.0, penalties=[("kelvin-voigt", 1e6)])
    >>> list(views.runs)
    ['moreau-jean', 'exact', 'kelvin-voigt, k=1e+06']

    >>> found = compare(load_problem("system-1"), ["moreau-jean", "rk4-paper"], dt=1e-3)
    >>> found.reference.name
    'exact'
    >>> found.events()[["kind", "spread"]].round(4).values.tolist()
    [['open', 0.0], ['close', 0.0], ['open', 0.0003], ['close', 0.0008]]
    """
    end = problem.t_end if t_end is None else t_end
    positive("t_end", end, "s")
    variants, chosen = _views(problem, methods, penalties)
    if REFERENCE in chosen:
        raise InputError(f"methods: the label {REFERENCE!r} is that of the reference; give another")
    steps = {label: _steps(label, dt, end) for label in chosen}
    if isinstance(dt, Mapping) and (unknown := [label for label in dt if label not in chosen]):
        raise InputError(f"dt: there is no method {unknown[0]!r} among {', '.join(chosen)}")
    truth = _reference(problem, end, {each.name for each in chosen.values()}, reference)
    runs, reasons = {}, {}
    for label, integrator in watched(chosen.items(), len(chosen), "methods", progress):
        try:
            run = Job(variants.get(label, problem), integrator, end / steps[label], end, lcp_solver).run()
        except InputError:
            raise
        except LcpImpactError as error:
            reasons[label] = str(error)
            continue
        if run.ended:
            runs[label] = run
        else:
            reasons[label] = run.message
    return Comparison(problem, float(end), runs, reasons, truth)


def _views(
    problem: Problem, methods: Views, penalties: Sequence[Penalty]
) -> tuple[dict[str, Problem], dict[str, Integrator]]:
    """Return the variants that are run in place of the problem, and all methods, by label."""
    variants: dict[str, Problem] = {}
    if isinstance(methods, Mapping):
        plain: dict[str, str | Integrator] = {}
        for label, view in methods.items():
            pair = view if isinstance(view, tuple) else (problem, view)
            if len(pair) != 2 or not isinstance(pair[0], Problem):
                raise InputError(f"methods[{label!r}] must be a method, or a pair of a Problem and a method")
            plain[label] = pair[1]
            if pair[0] is not problem:
                variants[str(label)] = pair[0]
        chosen = labelled(plain)
    else:
        chosen = labelled(methods)
    for penalty in penalties:
        label = f"{penalty[0]}, k={penalty[1]:g}"
        if label in chosen:
            raise InputError(f"penalties: {label!r} is there twice; leave one out")
        variants[label] = penalized_by(problem, penalty)
        chosen[label] = make_integrator("event-driven", {})
    for label, variant in variants.items():
        if variant.dynamics.nodes != problem.dynamics.nodes:
            raise InputError(
                f"methods[{label!r}]: {variant.name!r} has the coordinates {', '.join(variant.dynamics.nodes)}, and "
                f"{problem.name!r} has {', '.join(problem.dynamics.nodes)}: compare problems with the same coordinates"
            )
    return variants, chosen


def _steps(label: str, dt: float | Mapping[str, float], t_end: float) -> int:
    if isinstance(dt, Mapping) and label not in dt:
        raise InputError(f"dt: there is no step for {label!r}; give one number, or one for each label")
    value = dt[label] if isinstance(dt, Mapping) else dt
    positive(f"{label}: dt", value, "s")
    return max(1, math.ceil(t_end / value * (1.0 - 1e-12)))


def _reference(
    problem: Problem, t_end: float, compared: set[str], given: Trajectory | Reference | Literal["auto"] | None
) -> Reference | None:
    if given is None:
        return None
    if given != "auto":
        return given_reference(given, problem, t_end)
    try:
        return find_reference(problem, t_end, unlike=compared)
    except UnsupportedError:
        return None


def _finite(run: Trajectory, truth: Trajectory) -> dict[str, float]:
    """Return the errors of a run in all norms; NaN where they are not finite."""
    with np.errstate(over="ignore", invalid="ignore"):
        found = error_norms(run, truth)
    return {name: value if math.isfinite(value) else math.nan for name, value in found.items()}
