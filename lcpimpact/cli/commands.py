"""The registration of the commands, and the command reproduce."""

from __future__ import annotations

from pathlib import Path

import click
from click.exceptions import Exit

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
from lcpimpact.cli.options import PATH, Count
from lcpimpact.cli.output import DECIMAL, print_answer, table_output_options
from lcpimpact.cli.project import project
from lcpimpact.cli.runs import animate, draw, export, simulate
from lcpimpact.cli.sensitivity import sensitivity
from lcpimpact.cli.sweep import sweep
from lcpimpact.cli.truth import score, truths
from lcpimpact.cli.validation import validate


class Commands(click.Group):
    """All commands, which the help shows in their order and with their whole first sentences."""

    def format_commands(self, context: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the list of the commands, which click would sort and cut."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, each.get_short_help_str(limit=1000)) for name, each in self.commands.items()])

    def invoke(self, context: click.Context) -> None:
        """Run the command; Ctrl-C, for which click would print an empty line, is Abort."""
        try:
            super().invoke(context)
        except KeyboardInterrupt:
            raise click.Abort from None


@click.group(
    cls=Commands,
    invoke_without_command=True,
    help="A laboratory for impact mechanics: one rheological scheme, run by smooth and nonsmooth integrators, and judged "
    "against an exact solution.",
    context_settings={"show_default": True, "max_content_width": 120},
    epilog="Start with `lcpimpact reproduce`, then `lcpimpact simulate system-1 --set c_o=300`.",
)
@click.version_option(__version__, message="%(prog)s %(version)s", help="Show the version.")
@click.pass_context
def app(context: click.Context) -> None:
    """Print the help, where no command is given."""
    if context.invoked_subcommand is None:
        click.echo(context.get_help())


@click.command()
@click.option("--out", type=PATH, default="report", help="Folder for the figures, the tables and report.html.")
@click.option("--workers", type=Count(min=1), help="Number of processes; by default one per core.")
@table_output_options
def reproduce(out: Path, workers: int | None) -> None:
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
    raise Exit(1 if failed else 0)


for command in (
    reproduce,
    simulate,
    draw,
    animate,
    explore,
    design,
    fit,
    sensitivity,
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
    validate,
    project,
    cite,
    cache,
    list_,
):
    app.add_command(command)
