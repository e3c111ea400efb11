"""The commands about several ways to one motion: compare, and cross-validate."""

from __future__ import annotations

from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from lcpimpact.cli.options import (
    End,
    Named,
    Plot,
    Report,
    Set,
    Solver,
    Step,
    Table,
    bar,
    check_study,
    parse_methods,
    resolve_run,
    say,
    write_table,
)

if TYPE_CHECKING:
    import pandas as pd

    from lcpimpact.study.accuracy.comparison import Comparison
    from lcpimpact.study.accuracy.cross_validation import CrossValidation

SHOWN = ("sup_q", "l1_v", "hausdorff_v", "event_times", "impulses", "penetration")
"""The norms that the terminal shows; the table has all."""

MOST_EVENTS = 12
"""Of more events than these, the terminal shows the first."""


def compare(
    problem: Named,
    methods: Annotated[
        str,
        typer.Option(
            metavar="A,B:OPTION=VALUE,...",
            help="Names of [bold]lcpimpact list methods[/bold], with options or without.",
        ),
    ] = "moreau-jean,exact",
    set_: Set = None,
    dt: Step = None,
    t_end: End = None,
    solver: Solver = None,
    out: Table = None,
    events: Annotated[
        Path | None, typer.Option(help="File for the events side by side: .csv or .tex.", show_default=False)
    ] = None,
    forces: Annotated[
        Path | None, typer.Option(help="File for the forces, where they live: .csv or .tex.", show_default=False)
    ] = None,
    energies: Annotated[
        Path | None, typer.Option(help="File for the energies at the end: .csv or .tex.", show_default=False)
    ] = None,
    plot: Plot = None,
    report: Report = None,
) -> None:
    """Run one problem by several methods, and show what separates them: motion, events, forces and energies.

    They are compared with the exact solution, or an independent one that none of them computed, which is said.

    Example: lcpimpact compare system-3 --methods moreau-jean,moreau-jean:theta=1,rk4-paper --dt 1e-2 --plot three.pdf
    """
    check_study((problem,), (out, events, forces, energies), plot, report)
    taken = parse_methods(methods)
    spec = resolve_run(problem, set_, None, dt, t_end, solver)
    from lcpimpact.study.accuracy import comparison

    end = spec.problem.t_end if spec.run.t_end is None else spec.run.t_end
    step = min(1e-3, end / 1000.0) if spec.run.dt is None else spec.run.dt
    found = comparison.compare(spec.problem, taken, dt=step, t_end=end, lcp_solver=spec.run.solver, watch=bar)
    differences, side_by_side = found.differences(), found.events()
    lines = [f"{spec.problem.name}, {len(taken)} methods against {differences.attrs['reference']}", ""]
    lines += _lines(differences[differences["failure"] == ""][["method", "steps", *SHOWN]])
    broken = differences[differences["violation"] != ""].drop_duplicates("method")
    lines += [f"  {why}" for why in broken["violation"]]
    lines += [f"  {label}: {why}" for label, why in found.failures.items()]
    if len(side_by_side):
        lines += ["", *_lines(side_by_side.head(MOST_EVENTS), ".6f")]
        lines += [f"  and {len(side_by_side) - MOST_EVENTS} more events"] * (len(side_by_side) > MOST_EVENTS)
    at_end = found.energies()
    if len(at_end):
        lines += ["", "  energies at the end in J", *_lines(at_end, ".5g")]
    tables = ((differences, out), (side_by_side, events), (at_end, energies))
    lines += [write_table(table, path) for table, path in tables if path is not None]
    if forces is not None:
        lines.append(write_table(found.forces(), forces))
    if plot is not None:
        from lcpimpact.plotting.comparison import plot_comparison

        plot_comparison(found, plot)
        lines.append(f"drew {plot}")
    if report is not None:
        lines.append(_report(found, differences, side_by_side, report))
    say(*lines)
    raise typer.Exit(0 if found.runs else 1)


def cross_validate(
    problem: Named,
    routes: Annotated[
        str | None,
        typer.Option(
            metavar="A,B,...",
            help="Methods, method:solver for another LCP solver, closed-form, siconos; by default all that there are.",
            show_default=False,
        ),
    ] = None,
    set_: Set = None,
    dt: Annotated[
        float | None, typer.Option(help="The finest step in s; by default the end over 5265.", show_default=False)
    ] = None,
    t_end: End = None,
    tolerance: Annotated[
        float | None,
        typer.Option(help="A difference that is forgiven, relative to the size of the motion.", show_default=False),
    ] = None,
    out: Table = None,
    plot: Plot = None,
    report: Report = None,
) -> None:
    """Take several independent routes to one motion, and judge whether they lead to the same.

    Each route is run with several steps or tolerances, tells its own error from them, and may differ by no more than those
    errors, in coordinates, velocities, forces, impulses and events. The exit code is 0 only if routes of different families
    confirm each other in all of it; it is 1 if they do not agree, and if there is nothing to judge by.

    Example: lcpimpact cross-validate my.toml --routes exact,moreau-jean,moreau-jean:qp:osqp,siconos --report verdict.html
    """
    check_study((problem,), (out,), plot, report)
    spec = resolve_run(problem, set_, None, dt, t_end)
    from lcpimpact.study.accuracy.cross_validation import cross_validate as validate
    from lcpimpact.study.accuracy.routes import CLOSED_FORM

    end = spec.problem.t_end if spec.run.t_end is None else spec.run.t_end
    named = [each.strip() for each in routes.split(",") if each.strip()] if routes is not None else None
    if named is not None:
        named = [CLOSED_FORM if each == "closed-form" else each for each in named]
    verdict = validate(spec.problem, named, dt=dt, t_end=end, tolerance=tolerance, watch=bar)
    columns = ["route", "family", "against", "difference", "allowed", "observed", "declared", "events", "agrees"]
    taken = verdict.table[verdict.table["failure"] == ""]
    first, *reasons = str(verdict).split("\n")
    lines = [first, "", *_lines(taken[columns], ".2g"), *[""] * bool(reasons), *reasons]
    if out is not None:
        lines.append(write_table(verdict.table, out))
    if plot is not None:
        from lcpimpact.plotting.comparison import plot_cross_validation

        plot_cross_validation(verdict, plot)
        lines.append(f"drew {plot}")
    if report is not None:
        lines.append(_report_verdict(verdict, report))
    say(*lines)
    raise typer.Exit(0 if verdict.agree else 1)


def _lines(table: pd.DataFrame, form: str = ".2e") -> list[str]:
    """Return a table as lines for the terminal."""
    from lcpimpact.report.report import cell

    rows = [[str(name) for name in table.columns]]
    rows += [[cell(value, form) for value in row] for row in table.itertuples(index=False, name=None)]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        "  " + "  ".join(text.ljust(width) for text, width in zip(row, widths, strict=True)).rstrip() for row in rows
    ]


def _report(found: Comparison, differences: pd.DataFrame, events: pd.DataFrame, path: Path) -> str:
    from lcpimpact.plotting.comparison import plot_comparison, plot_ledger
    from lcpimpact.report.report import Section, write_report
    from lcpimpact.study.accuracy.comparison import REFERENCE

    attrs = differences.attrs
    lead = (
        f"<p>{escape(found.problem.name)} to {found.t_end:g} s by {len(found.runs)} methods, compared with "
        f"{escape(str(attrs['reference']))}.</p>"
    )
    sections = [
        Section("Side by side", figures=[plot_comparison(found)]),
        Section(
            "Differences",
            "<p>Each run against the reference, in all norms, SI units.</p>",
            table=differences,
            form=".2e",
        ),
        Section("Events", "<p>Times in s; the k-th of a contact and kind in one row.</p>", table=events, form=".6f"),
    ]
    at_end = found.energies()
    if len(at_end):
        sections.append(Section("Energies", "<p>At the end, in J.</p>", table=at_end, form=".5g"))
    for label, ledger in found.ledgers().items():
        if label != REFERENCE:
            text = f"<p>{escape(ledger.promise)}. The largest |balance| is {ledger.balance:.1e} J.</p>"
            sections.append(Section(f"Energy: {label}", text, figures=[plot_ledger(ledger)]))
    return f"wrote {write_report(path, f'{found.problem.name}: methods side by side', lead, sections)}"


def _report_verdict(verdict: CrossValidation, path: Path) -> str:
    from lcpimpact.plotting.comparison import plot_cross_validation
    from lcpimpact.report.report import Section, write_report

    said = "".join(f"<li>{escape(reason)}</li>" for reason in verdict.reasons)
    lead = (
        f"<p>{escape(verdict.problem.name)} by {int((verdict.table['failure'] == '').sum())} routes. Each tells its own "
        "error from several steps or tolerances; the differences may be no larger than those errors allow, and routes "
        "confirm each other only if their families differ and their refinement shows the order that they declare.</p>"
    )
    words = f"{verdict.outcome.value.capitalize()}."
    sections = [
        Section(
            "Verdict", f"<p>{words}</p><ul>{said}</ul>", figures=[plot_cross_validation(verdict)], verdict=verdict.agree
        ),
        Section("Routes", table=verdict.table, form=".2e"),
        Section("Pairs", table=verdict.pairs, form=".2e", folded=True),
    ]
    return f"wrote {write_report(path, f'{verdict.problem.name}: cross-validation', lead, sections)}"
