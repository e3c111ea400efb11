"""The reports of the studies."""

from __future__ import annotations

from functools import singledispatch
from html import escape
from pathlib import Path

from lcpimpact.report.report import Section, write_report
from lcpimpact.study.accuracy.comparison import REFERENCE, Comparison
from lcpimpact.study.accuracy.convergence import Convergence, WorkPrecision, observed_orders
from lcpimpact.study.accuracy.cross_validation import CrossValidation
from lcpimpact.study.design.fit import Fit
from lcpimpact.study.design.sizing import Design
from lcpimpact.study.result import Study
from lcpimpact.validation.case import Fate
from lcpimpact.validation.validate import Validation

MAX_LINES = 40
"""Maximum number of lines of a summary on a page."""


def report(study: Study, path: str | Path) -> Path:
    """Write the page of a study; its lead is the first line of the summary.

    Raises
    ------
    InputError
        For another ending than .html, or a folder that cannot be written.
    """
    lead = " ".join(f"{escape(line)}." for line in study.head())
    return write_report(path, study.title.format(study), lead, parts(study))


@singledispatch
def parts(study: Study) -> list[Section]:
    """Return the sections of the page of a study; by default the picture, the summary and the table."""
    lines = study.summary().split("\n")[len(study.head()) :]
    return [
        Section("Picture", figures=[study.plot()]),
        Section("In words", _items(lines) if len(lines) <= MAX_LINES else ""),
        Section("Table", table=study.table, form=".6g", folded=True),
    ]


def _items(lines: list[str] | tuple[str, ...]) -> str:
    items = "".join(f"<li>{escape(line.strip())}</li>" for line in lines if line)
    return f"<ul>{items}</ul>" if items else ""


@parts.register
def _(study: Convergence) -> list[Section]:
    orders = observed_orders(study)
    here = orders[orders["norm"] == study.norm]
    known = orders[orders["verdict"] != ""]
    others = orders.loc[(orders["norm"] != study.norm) & (orders["points"] >= 2), "norm"].unique()
    return [
        Section("Errors over the step", figures=[study.plot()]),
        Section(
            "Observed orders",
            "<p>Slopes by least squares of log10 of the error over log10 of the step; the scatter is the standard "
            "deviation of log10 of the errors about the line, from which the standard error of the slope follows.</p>",
            table=here,
            form=".3f",
            verdict=not (known["verdict"] == "off").any() if len(known) else None,
        ),
        *(Section(f"In the norm {norm}", figures=[study.plot(norm=norm)]) for norm in others),
        Section("Orders in every norm", table=orders, form=".3f", folded=True),
        Section("Every run", _items(study.remarks()), table=study.table, folded=True),
    ]


@parts.register
def _(study: WorkPrecision) -> list[Section]:
    costs = dict.fromkeys((study.cost, "seconds", "evaluations", "lcp_solves"))
    return [
        *(Section(f"Error over {cost.replace('_', ' ')}", figures=[study.plot(cost=cost)]) for cost in costs),
        Section("Every run", _items(study.remarks()), table=study.table, folded=True),
    ]


@parts.register
def _(study: Comparison) -> list[Section]:
    energies = study.energies()
    return [
        Section("Side by side", figures=[study.plot()]),
        Section(
            "Differences",
            "<p>Each run against the reference, in all norms, SI units.</p>",
            table=study.table,
            form=".2e",
        ),
        Section(
            "Events", "<p>Times in s; the k-th of a contact and kind in one row.</p>", table=study.events(), form=".6f"
        ),
        *[Section("Energies", "<p>At the end, in J.</p>", table=energies, form=".5g")] * bool(len(energies)),
        *(
            Section(f"Energy: {label}", _items(ledger.head()), figures=[ledger.plot()])
            for label, ledger in study.ledgers().items()
            if label != REFERENCE
        ),
    ]


@parts.register
def _(study: CrossValidation) -> list[Section]:
    words = (
        f"<p>{study.outcome.value.capitalize()}. Each route estimates its own error from several steps or tolerances; the "
        "differences must be within those errors, and routes confirm each other only if their families differ "
        "and their refinement shows the order that they declare.</p>"
    )
    return [
        Section("Fate", words + _items(study.reasons), figures=[study.plot()], verdict=study.agree),
        Section("Routes", table=study.table, form=".2e"),
        Section("Pairs", table=study.pairs, form=".2e", folded=True),
    ]


@parts.register
def _(study: Design) -> list[Section]:
    seen = study.measured()
    misses = {
        name: abs(getattr(seen, name) / value - 1.0) for name, value in study.wanted.items() if hasattr(seen, name)
    }
    lines = [f"In the simulation, {name} has a relative error of {miss:.1e}." for name, miss in misses.items()]
    lines += ["Each row meets the requirements; the first has the least damping."] * bool(study.others)
    return [
        Section("The impact", f"<p>Found by: {escape(study.found)}.</p>", figures=[study.plot()]),
        Section(
            "The design",
            _items(lines),
            table=study.table.dropna(axis="columns", how="all"),
            form=".8g",
            verdict=max(misses.values()) <= 1e-8 if misses else None,
        ),
    ]


@parts.register
def _(study: Fit) -> list[Section]:
    correlation = study.correlation.rename_axis("parameter").reset_index()
    return [
        Section("Data and fit", f"<p>{escape(study.message)}</p>", figures=[study.plot()], verdict=study.success),
        Section(f"Parameters, with {study.level:.0%} intervals", _items(study.notes), table=study.table, form=".6g"),
        Section("Correlation of the parameters", table=correlation, form=".4f"),
        Section("Searches", table=study.starts, form=".6g", folded=True),
        Section("Residuals", table=study.residuals, form=".5g", folded=True),
    ]


@parts.register
def _(study: Validation) -> list[Section]:
    table = study.table
    told = table[table["verdict"] != Fate.NOT_FOUND.value]
    others = told[told["why"] != ""]
    return [
        *(
            Section(str(suite), table=rows.drop(columns=["suite", "why"]), form=".10g", formats={"tolerance": ".2g"})
            for suite, rows in told.groupby("suite", sort=False)
        ),
        Section(
            "Refuted, and not met",
            table=others[["case", "quantity", "published", "truth", "verdict", "why"]],
            form=".10g",
            verdict=study.success,
        ),
        Section(
            "Not found",
            table=table.loc[table["verdict"] == Fate.NOT_FOUND.value, ["suite", "case", "quantity", "source", "why"]],
        ),
        Section("Errors over tolerances", figures=[study.plot()]),
    ]
