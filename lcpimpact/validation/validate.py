"""The run of the suites, and its result: published numbers beside ours."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from lcpimpact.arguments import checked
from lcpimpact.bibliography import cited
from lcpimpact.errors import LcpImpactError
from lcpimpact.quantities import quantity
from lcpimpact.simulation import simulate
from lcpimpact.study.result import Study, table_lines
from lcpimpact.trajectory import Trajectory
from lcpimpact.validation.case import Fate, Published, PublishedCase, Suite
from lcpimpact.validation.suites import SUITES

FIXED = ("suite", "case", "quantity", "source", "published", "tolerance", "truth", "verdict", "why")
"""Columns of the table beside those of the methods."""


@dataclass(frozen=True, eq=False, repr=False)
class Validation(Study):
    """Published numbers beside ours.

    Attributes
    ----------
    table : DataFrame
        One row per published number: ``suite``, ``case``, ``quantity``, ``source``, ``published``, ``tolerance`` of the
        source (absolute; nan for a requirement to be below the number), one column per method with our value, nan where the
        case is not run by it, ``truth`` by a closed form, ``verdict`` and ``why``: the derivation of what is refuted, or the
        reason of what is not met or not found.
    """

    table: pd.DataFrame

    drawn_by = "lcpimpact.plotting.validation:plot_validation"
    title = "Published numbers and ours"

    @property
    def methods(self) -> list[str]:
        """The methods of the runs."""
        return [str(name) for name in self.table.columns if name not in FIXED]

    @property
    def success(self) -> bool:
        """Whether each number is met, refuted, or listed as not found."""
        return not self._of(Fate.NOT_MET)

    def head(self) -> list[str]:
        """Return the number of values by their verdicts."""
        numbers = self.table[self.table["verdict"] != Fate.NOT_FOUND.value]
        counts = [f"{self._of(each)} {each.value}" for each in Fate if each is not Fate.NOT_FOUND]
        cases = numbers[["suite", "case"]].drop_duplicates()
        return [
            f"{len(numbers)} published values of {len(cases)} cases: {', '.join(counts)}",
            f"Not found or not reproduced: {self._of(Fate.NOT_FOUND)} entries, with their reasons",
        ]

    def summary(self) -> str:
        """Return a table for each suite, the derivations of refuted values, and what is not found."""
        return "\n".join([*self.head(), *self._lines()])

    def _of(self, verdict: Fate) -> int:
        return int((self.table["verdict"] == verdict.value).sum())

    def _lines(self) -> Iterator[str]:
        for suite, rows in self.table.groupby("suite", sort=False):
            yield f"{suite}: {SUITES[str(suite)].title}"
            told = rows[rows["verdict"] != Fate.NOT_FOUND.value].drop(columns=["suite", "source", "why"])
            told = told.drop(columns=[name for name in ("truth", *self.methods) if told[name].isna().all()])
            yield from table_lines(told, ".10g")
            for verdict in (Fate.REFUTED, Fate.NOT_MET, Fate.NOT_FOUND):
                alike = rows[rows["verdict"] == verdict.value].groupby(["case", "why"], sort=False)["quantity"]
                for (case, why), quantities in alike:
                    yield f"  {verdict.value}: {case}: {'; '.join(quantities)}: {why}"


@checked
def validate(suites: str | Sequence[str] = ()) -> Validation:
    """Run the cases that others published, and compare their numbers with ours.

    Parameters
    ----------
    suites : str or sequence of str
        Names of `lcpimpact.validation.suites.SUITES`; all by default.

    Returns
    -------
    Validation

    Raises
    ------
    InputError
        For an unknown suite, or a file of published numbers that is not there.

    Examples
    --------
    >>> from lcpimpact import validate
    >>> validate("arch").success
    True
    """
    names = [suites] if isinstance(suites, str) else list(suites) or list(SUITES)
    rows = [row for name in dict.fromkeys(names) for row in _rows(name, SUITES[name])]
    table = pd.DataFrame(rows)
    methods = [name for name in table.columns if name not in FIXED]
    return Validation(table[[*FIXED[:6], *methods, *FIXED[6:]]])


def _rows(name: str, suite: Suite) -> Iterator[dict[str, float | str]]:
    for case in suite.cases:
        runs = {run.method: _run(case, k) for k, run in enumerate(case.runs)}
        for each in case.published:
            ours = {method: _measured(each, run) for method, run in runs.items()}
            verdict = each.verdict(np.array(list(ours.values())))
            failed = [f"{method}: {run}" for method, run in runs.items() if isinstance(run, str)]
            yield {
                "suite": name, "case": case.name, "quantity": each.what, "source": cited(case.source),
                "published": each.value, "tolerance": math.nan if each.below else each.tolerance, **ours,
                "truth": each.truth, "verdict": verdict.value,
                "why": "; ".join(failed) if verdict is Fate.NOT_MET else each.derivation,
            }  # fmt: skip
    for missing in suite.not_found:
        yield {
            "suite": name, "case": missing.name, "quantity": missing.what, "source": cited(missing.source),
            "published": math.nan, "tolerance": math.nan, "truth": math.nan, "verdict": Fate.NOT_FOUND.value,
            "why": missing.reason,
        }  # fmt: skip


def _run(case: PublishedCase, k: int) -> Trajectory | str:
    """Return the k-th run of a case, or why there is none."""
    run, problem = case.runs[k], case.problem()
    try:
        return simulate(
            problem, run.method, dt=run.dt or problem.t_end, t_end=run.t_end, lcp_solver=run.solver, progress=False,
            error=False, **run.options,
        )  # fmt: skip
    except LcpImpactError as error:
        return str(error)


def _measured(published: Published, run: Trajectory | str) -> float:
    """Return the value of a published quantity in a run, nan where it shows nothing."""
    if isinstance(run, str):
        return math.nan
    if isinstance(published.measure, str):
        return float(quantity(published.measure, run.problem).measure(run))
    try:
        return float(published.measure(run))
    except LcpImpactError:
        return math.nan
