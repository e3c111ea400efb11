"""Scores of results from any program: their samples against the facts and the exact motion of a problem.

The program integrates nothing here: what is read of its samples is what the facts of the problem ask for, by the same
functions that read the runs of this package.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.integrate import trapezoid

from lcpimpact.arguments import checked
from lcpimpact.arrays import Array
from lcpimpact.errors import InputError, LcpImpactError
from lcpimpact.numbers import is_real
from lcpimpact.problems import load_problem
from lcpimpact.problems.base import Problem
from lcpimpact.problems.facts import Fact
from lcpimpact.record import Event, State
from lcpimpact.registry import nearest
from lcpimpact.run_files import EVENT_COLUMNS
from lcpimpact.study.accuracy.reference import reference
from lcpimpact.study.accuracy.samples import KnownUntil, SampledRun, events_in
from lcpimpact.study.design.curves import CurveTable
from lcpimpact.study.result import Study, failure_lines, table_lines
from lcpimpact.trajectory import Trajectory

INSTANTS = "t_R"
"""Column of the instants of reactions, where they are not those of the coordinates."""


@dataclass(frozen=True, eq=False, repr=False)
class Score(Study):
    """Results of any program beside the truths of a problem.

    Attributes
    ----------
    problem : Problem
    table : DataFrame
        One row per fact, then one per coordinate and rate that the results have: ``quantity``, ``what``, ``unit``,
        ``truth``, ``value``, ``error`` (absolute), ``relative`` (to the larger of the truth and its scale), and
        ``failure``, why the samples do not tell it. Of a coordinate the error is the largest at a sample, of a rate its mean
        over time without the samples at jumps.
    run : SampledRun            the results, with the events that were found in them
    errors : DataFrame          |q - q*| of each coordinate at the samples, relative to its largest true value; ``t`` in s
    against : str               what the motion is compared with: "closed form", or the method of a reference
    left_out : tuple of str     columns of the results that the problem does not have
    """

    problem: Problem
    table: pd.DataFrame
    run: SampledRun
    errors: pd.DataFrame
    against: str
    left_out: tuple[str, ...] = ()

    drawn_by = "lcpimpact.plotting.score:plot_score"
    title = "{0.problem.name}: results and truths"

    def head(self) -> list[str]:
        """Return how many facts are told, and the largest error of them and of the motion."""
        facts, rows = len(self.facts), self.table[self.table["failure"] == ""]
        told = int((self.facts["failure"] == "").sum())
        lines = [f"{self.problem.name}: {told} of {facts} facts can be told from {len(self.run.t)} samples"]
        if len(rows):
            worst = rows.loc[rows["relative"].idxmax()]
            of = f" of {told} of {facts} facts and of the motion" if told < facts else ""
            error = f"{worst['relative']:.1e}, of {worst['quantity']} ({worst['what']})"
            lines.append(f"The largest relative error{of} is {error}")
        return lines

    def summary(self) -> str:
        """Return the facts with truth, value and error, and the errors of the motion."""
        shown = self.table[["quantity", "unit", "truth", "value", "error", "relative"]].astype(object)
        for name, form in (("truth", ".10g"), ("value", ".10g"), ("error", ".1e"), ("relative", ".1e")):
            shown[name] = [format(each, form) if math.isfinite(each) else "-" for each in self.table[name]]
        lines = [*self.head(), *table_lines(shown), f"The motion is compared with: {self.against}"]
        lines += failure_lines(self.failures)
        if self.left_out:
            lines.append(f"Columns that the problem does not have were left out: {', '.join(self.left_out)}")
        return "\n".join(lines)

    @property
    def facts(self) -> pd.DataFrame:
        """The rows of the table that are facts of the problem."""
        return self.table.iloc[: len(self.problem.facts)]


@checked
def score(
    results: str | Path | pd.DataFrame,
    problem: str | Problem,
    *,
    events: str | Path | pd.DataFrame | None = None,
    **parameters: float,
) -> Score:
    """Return results of any program beside the truths of a problem.

    Parameters
    ----------
    results : path or DataFrame
        Samples: the column ``t`` in s from 0 on, the coordinates by the names of the problem, and if they are known the
        rates ``v_NAME`` and the reactions by the names of their rows in N, without impulses. Coordinates with a given
        motion may be left out. Reactions with instants of their own, as those in the middle of steps, have them in ``t_R``.
        Other units are those of the header, as in ``t [ms]``.
    problem : str or Problem
        A registered problem, as in the files of `write_truths`, or any problem with facts.
    events : path or DataFrame, optional
        The events, where the program locates them: ``t``, ``contact``, ``kind``, and if they are known ``impulse`` and the
        limits ``NAME_left``, ``NAME_right``. By default they are found in the samples.
    **parameters : float
        Parameters of a registered problem that are not the default ones.

    Returns
    -------
    Score

    Raises
    ------
    InputError
        For a file that cannot be read, columns that do not fit, cells that hold no number, times that do not rise or do not
        begin at 0, or a problem without facts.

    Examples
    --------
    >>> import numpy as np, pandas as pd
    >>> from lcpimpact import score
    >>> t = np.linspace(0.0, 0.9, 181)
    >>> ball = pd.DataFrame({"t": t, "x": np.minimum(0.5 * 9.81 * t**2, 1.0)})
    >>> round(float(score(ball, "bouncing-ball").table["value"][0]), 2)
    0.45
    """
    known = load_problem(problem, **parameters) if isinstance(problem, str) else problem
    if not isinstance(problem, str) and parameters:
        raise InputError("parameters go with the name of a problem: change those of the Problem by with_values")
    if not known.facts:
        raise InputError(f"{known.name} has no facts to score results by: take a problem of lcpimpact list problems")
    table = CurveTable.of(results)
    run, left_out = _sampled(table, known)
    if events is None:
        run = replace(run, events=events_in(run))
    else:
        given = CurveTable.of(events)
        run = replace(run, events=_events(given, run))
        left_out += [name for name in given.header if name not in (*EVENT_COLUMNS, *_limits(run))]
    rows = [_fact(fact, run) for fact in known.facts]
    motion, errors, against = _motion(run)
    return Score(known, pd.DataFrame([*rows, *motion]), run, errors, against, tuple(left_out))


def _sampled(table: CurveTable, problem: Problem) -> tuple[SampledRun, list[str]]:
    """Return the samples of a table, and the names of the columns that the problem does not have."""
    d = problem.dynamics
    given = [node for i, node in enumerate(d.nodes) if i in d.motions]
    nodes = [node for node in d.nodes if node not in given]
    rates, rows = [f"v_{node}" for node in d.nodes], [each.name for each in d.contacts]
    there = {*table.header, *table.names}
    if "t" not in there or not there & set(nodes):
        optional = ", ".join([*rates, *rows])
        where = "" if table.path is None else f"line 1 of {str(table.path)!r}: "
        raise InputError(
            f"{where}the columns wanted are t, {', '.join(nodes)}, and if they are known {optional}, in SI units or with "
            f"their units as in t [ms]; found are {', '.join(table.header) or 'none'}"
        )
    of_motion = [name for name in (*d.nodes, *rates) if name in there]
    units = {name: problem.unit(name) for name in (*of_motion, *rows)}
    motion = table.curve(of_motion, wanted=units)
    t = motion["t"].to_numpy()
    if len(t) < 3 or t[0] != 0.0:
        begun = f"begin at t = {t[0]:g} s" if len(t) else "are empty"
        raise InputError(
            f"the results {begun} and have {len(t)} samples: write the state at t = 0 and two more at least"
        )
    if t[-1] > 100.0 * problem.t_end:
        raise InputError(
            f"the results end at t = {t[-1]:g} s, and {problem.name} at {problem.t_end:g} s: write t in s, or its unit in "
            "the header, as t [ms]"
        )
    q, v = (_columns(motion, names) for names in (d.nodes, rates))
    if given:
        places = [d.nodes.index(node) for node in given]
        q[:, places], v[:, places] = d.motion(t)
    missing = [i for i in range(len(d.nodes)) if np.isnan(v[:, i]).all() and not np.isnan(q[:, i]).all()]
    v[:, missing] = np.gradient(q[:, missing], t, axis=0)
    of_rows = [name for name in rows if name in there]
    instants = INSTANTS if INSTANTS in there else "t"
    forces = table.curve(of_rows, instants, wanted=units) if of_rows else motion
    known = {"t", INSTANTS, *d.nodes, *rates, *(each.name for each in d.forces)}
    run = SampledRun(problem, t, q, v, forces["t"].to_numpy(), _columns(forces, rows))
    return run, [header for header, name in zip(table.header, table.names, strict=True) if not {header, name} & known]


def _columns(table: pd.DataFrame, names: list[str] | tuple[str, ...]) -> Array:
    """Return columns of a table (nt, m), nan where it does not have them."""
    columns = [table[name].to_numpy() if name in table else np.full(len(table), math.nan) for name in names]
    return np.array(columns).T.reshape(len(table), len(names))


def _events(table: CurveTable, run: SampledRun) -> tuple[Event, ...]:
    """Return the events of a table, their limits by the samples where it has none."""
    d, place = run.problem.dynamics, "" if table.path is None else f" of {str(table.path)!r}"
    absent = [name for name in ("t", "contact", "kind") if name not in table.header]
    if absent:
        raise InputError(
            f"line 1{place}: the columns wanted are t, contact and kind, and if they are known impulse, NAME_left and "
            f"NAME_right; found are {', '.join(table.header) or 'none'}"
        )
    columns = [name for name in ("t", "impulse", *_limits(run)) if name in table.header]
    numbers = pd.DataFrame({name: table.numbers(table.frame[name]) for name in columns})
    lines = [f"{'row' if table.path is None else 'line'} {line}{place}" for line in table.frame.index]
    contacts = {each.name: each for each in d.contacts}
    found: list[Event] = []
    for line, cells, row in zip(lines, table.frame.to_dict("records"), numbers.to_dict("records"), strict=True):
        for name in columns:
            left_open = name != "t" and (pd.isna(cells[name]) or cells[name] in ("", "nan"))
            if not (math.isfinite(row[name]) or left_open):
                raise InputError(f"{line}: {name} = {cells[name]!r} is no number; write one, with one decimal mark")
        t, last = row["t"], found[-1].t if found else 0.0
        if t < last:
            before = "the event above; sort the events by time" if found else "the start; begin at t = 0"
            raise InputError(f"{line}: t = {t:g} s lies before {last:g} s, {before}")
        if t > run.t[-1] * (1.0 + 1e-12):
            raise InputError(
                f"{line}: t = {t:g} s lies after the last sample, at {run.t[-1]:g} s; write samples until then"
            )
        contact, kind = cells["contact"], cells["kind"]
        if contact not in contacts:
            raise InputError(f"{line}: {nearest(str(contact), list(contacts), 'contact')}")
        law = contacts[contact].law
        kinds = [each for each in ("impact", law.at_bound, law.between, "jam", "jump") if each]
        if kind not in kinds:
            raise InputError(f"{line}: {nearest(str(kind), kinds, 'kind')}")
        left, right = (_limit(run, row, side, t) for side in ("left", "right"))
        found.append(Event(t, contact, kind, left, right, row.get("impulse", math.nan)))
    return tuple(found)


def _limits(run: SampledRun) -> list[str]:
    """Return the columns of the limits of events."""
    return [f"{name}_{side}" for side in ("left", "right") for name in run.names]


def _limit(run: SampledRun, row: Mapping[str, float], side: str, t: float) -> State:
    """Return a limit of an event: by its columns, and else the sample on that side."""
    after = int(np.searchsorted(run.t, t, side="left" if side == "right" else "right"))
    j = min(max(after - (side == "left"), 0), len(run.t) - 1)
    nodes = len(run.problem.dynamics.nodes)
    near = np.concatenate([run.q[j], run.v[j], run.sample(run.t[j]).reaction[0]])
    given = np.array([row.get(f"{name}_{side}", math.nan) for name in run.names[: len(near)]])
    values = np.where(np.isfinite(given), given, near)
    return State(values[:nodes], values[nodes : 2 * nodes], values[2 * nodes :])


def _fact(fact: Fact, run: SampledRun) -> dict[str, float | str]:
    """Return the row of a fact."""
    try:
        value, failure = float(fact.measure(run)), ""
    except (LcpImpactError, IndexError) as error:
        value, failure = math.nan, str(error)
    if not is_real(value):
        untold = run.untold
        value, failure = math.nan, failure or "the samples do not tell it"
        if untold and not (isinstance(run.events, KnownUntil) and failure == run.events.why):
            failure += f"; the results have no column{'s' * (len(untold) > 1)} {', '.join(untold)}"
    off = abs(value - fact.value)
    return {
        "quantity": fact.symbol, "what": fact.what, "unit": fact.unit, "truth": fact.value, "value": value, "error": off,
        "relative": off / (max(abs(fact.value), fact.scale) or 1.0), "failure": failure,
    }  # fmt: skip


def _truth(run: SampledRun, *, max_nodes: int = 20) -> tuple[str, Trajectory | None]:
    """Return the name of what the true motion is from, and the reference where there is no closed form.

    ``max_nodes``: number of coordinates up to which a reference takes seconds; of the hundred of a bar it takes minutes.
    """
    if run.problem.motion is not None:
        return "closed form", None
    if len(run.problem.dynamics.nodes) > max_nodes:
        return f"nothing, as there is no closed form, and over {max_nodes} coordinates no reference is computed", None
    found = reference(run.problem, float(run.t[-1]))
    return found.name, found.trajectory


def _motion(run: SampledRun) -> tuple[list[dict[str, float | str]], pd.DataFrame, str]:
    """Return the rows of the motion, and the relative errors of the coordinates at the samples."""
    problem, end = run.problem, float(run.t[-1])
    against, exact = _truth(run)
    if exact is None and problem.motion is None:
        return [], pd.DataFrame({"t": run.t}), against

    def truth(t: Array) -> tuple[Array, Array]:
        if exact is None:
            assert problem.motion is not None
            return problem.motion(t)
        state = exact.sample(np.clip(t, exact.t[0], exact.t[-1]))
        return state.q, state.v

    q, v = truth(run.t)
    ε = 1e-9 * end
    jumps = np.abs(truth(np.minimum(run.t + ε, end))[1] - truth(np.maximum(run.t - ε, 0.0))[1])
    smooth = jumps.max(axis=1) <= 1e-6 * np.abs(v).max()
    rows: list[dict[str, float | str]] = []
    errors = {"t": run.t}
    unit = problem.unit
    for i, node in enumerate(problem.dynamics.nodes):
        if i in problem.dynamics.motions or np.isnan(run.q[:, i]).any():
            continue
        off, rate = np.abs(run.q[:, i] - q[:, i]), np.where(smooth, np.abs(run.v[:, i] - v[:, i]), 0.0)
        scale, speed = float(np.abs(q[:, i]).max()) or 1.0, float(np.abs(v[:, i]).max()) or 1.0
        errors[node] = off / scale
        for name, what, each, size in (
            (node, "largest error of a sample", float(off.max()), scale),
            (f"v_{node}", "mean error", float(trapezoid(rate, run.t)) / end, speed),
        ):
            rows.append(
                {
                    "quantity": name, "what": what, "unit": unit(name), "truth": 0.0, "value": each, "error": each,
                    "relative": each / size, "failure": "",
                }
            )  # fmt: skip
    return rows, pd.DataFrame(errors), against
