"""The registration of the commands, and the command reproduce."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from lcpimpact import __version__
from lcpimpact.cli.cache import cache
from lcpimpact.cli.check import check
from lcpimpact.cli.comparison import compare, cross_validate
from lcpimpact.cli.convergence import converge, work_precision
from lcpimpact.cli.design import design, fit
from lcpimpact.cli.dynamics import basins, bifurcation, orbit, poincare
from lcpimpact.cli.explore import explore
from lcpimpact.cli.lcp import solve
from lcpimpact.cli.listing import cite, list_
from lcpimpact.cli.output import DECIMAL, print_answer, with_output_options
from lcpimpact.cli.project import project
from lcpimpact.cli.runs import animate, draw, export, simulate
from lcpimpact.cli.sweep import sweep
from lcpimpact.cli.truth import score, truths

app = typer.Typer(
    invoke_without_command=True,
    rich_markup_mode="rich",
    help="A laboratory for impact mechanics: one rheological scheme, run by smooth and nonsmooth integrators, and judged "
    "against an exact solution.",
    epilog="Start with [bold]lcpimpact reproduce[/bold], then [bold]lcpimpact simulate system-1 --set c_o=300[/bold].",
)


def _version(wanted: bool) -> None:
    if wanted:
        Console().print(f"lcpimpact {__version__}", highlight=False)
        raise typer.Exit


@app.callback()
def common(
    context: typer.Context,
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version.")
    ] = False,
) -> None:
    """Handle the options before the command; without a command, print the help."""
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())


def reproduce(
    out: Annotated[Path, typer.Option(help="Folder for the figures, the tables and report.html.")] = Path("report"),
    workers: Annotated[int | None, typer.Option(min=1, help="Number of processes; by default one per core.")] = None,
) -> None:
    """Reproduce the paper: Figures 1-9, the cross-validation tables, and a self-contained report.

    Systems 1, 2, 3, and 3 with c = 60, are run by the LCP step with every solver, by the paper's RK4, and exactly. The
    exit code is 0 only if every stated tolerance holds.
    """
    from lcpimpact.reproduce.run import reproduce as run

    result = run(out, workers=workers, decimal=DECIMAL.get())
    failed = [check for check in result.checks if not check.holds]
    lines = [
        f"does not hold: {check.what}: {check.value:.3g} exceeds {check.limit:.3g} {check.unit}" for check in failed
    ]
    verdict = "all hold" if not failed else f"{len(failed)} do not hold"
    lines += [f"{len(result.checks)} stated tolerances: {verdict} ({result.seconds:.0f} s)", f"open {result.report}"]
    print_answer(
        lines,
        lambda: {
            "tolerances": [
                {"what": each.what, "value": each.value, "limit": each.limit, "unit": each.unit, "holds": each.holds}
                for each in result.checks
            ],
            "seconds": result.seconds,
            "files": [result.report],
        },
    )
    raise typer.Exit(1 if failed else 0)


WITHOUT_TABLES = (draw, animate, explore, export, check, cache)
"""Commands that write no tables."""

for command in (
    reproduce,
    simulate,
    draw,
    animate,
    explore,
    design,
    fit,
    export,
    solve,
    converge,
    work_precision,
    sweep,
    poincare,
    bifurcation,
    basins,
    orbit,
    compare,
    cross_validate,
    check,
    truths,
    score,
    project,
    cite,
    cache,
):
    app.command()(with_output_options(command, tables=command not in WITHOUT_TABLES))
app.command("list")(with_output_options(list_))
