"""The registration of the commands, and the commands reproduce and list."""

from __future__ import annotations

import inspect
from dataclasses import MISSING as NO_DEFAULT
from dataclasses import fields
from enum import StrEnum
from importlib.metadata import metadata
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.table import Table
from rich.text import Text

from lcpimpact import __version__
from lcpimpact.cli.cache import cache
from lcpimpact.cli.comparison import compare, cross_validate
from lcpimpact.cli.convergence import converge, work_precision
from lcpimpact.cli.design import design, fit
from lcpimpact.cli.dynamics import basins, bifurcation, orbit, poincare
from lcpimpact.cli.lcp import solve
from lcpimpact.cli.runs import animate, draw, export, simulate
from lcpimpact.cli.sweep import sweep
from lcpimpact.integrators import METHODS
from lcpimpact.lcp import SOLVERS
from lcpimpact.problems import PROBLEMS, load_problem
from lcpimpact.scheme.elements import ELEMENTS

MAX_CONTACTS = 3
"""Maximum number of contacts listed."""

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
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
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version.")
    ] = False,
) -> None:
    """Handle the options before the command."""


@app.command()
def reproduce(
    out: Annotated[Path, typer.Option(help="Folder for the figures, the tables and report.html.")] = Path("report"),
    workers: Annotated[int | None, typer.Option(min=1, help="Number of processes; by default one per core.")] = None,
) -> None:
    """Reproduce the paper: Figures 1-9, the cross-validation tables, and a self-contained report.

    Systems 1, 2, 3, and 3 with c = 60, are run by the LCP step with every solver, by the paper's RK4, and exactly. The
    exit code is 0 only if every stated tolerance holds.
    """
    from lcpimpact.compiled import compile_ahead
    from lcpimpact.files import make_folder
    from lcpimpact.reproduce import COMPILED_PARTS

    make_folder(out)
    compile_ahead(*COMPILED_PARTS)
    from lcpimpact.reproduce.run import reproduce as run

    result = run(out, workers=workers)
    console = Console(highlight=False)
    failed = [check for check in result.checks if not check.holds]
    for check in failed:
        console.print(f"does not hold: {check.what}: {check.value:.3g} exceeds {check.limit:.3g} {check.unit}")
    verdict = "all hold" if not failed else f"{len(failed)} do not hold"
    console.print(f"{len(result.checks)} stated tolerances: {verdict} ({result.seconds:.0f} s)")
    console.print(f"open {result.report}", soft_wrap=True)
    raise typer.Exit(1 if failed else 0)


for command in (
    simulate,
    draw,
    animate,
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
    cache,
):
    app.command()(command)


class Kind(StrEnum):
    """Registries that can be listed."""

    problems = "problems"
    methods = "methods"
    solvers = "solvers"
    elements = "elements"


@app.command("list")
def list_(kind: Annotated[Kind, typer.Argument(help="problems, methods, solvers or elements.")]) -> None:
    """List the registered problems, methods, solvers or elements with their declared properties."""
    tables = {
        Kind.problems: _problems,
        Kind.methods: _methods,
        Kind.solvers: _solvers,
        Kind.elements: _elements,
    }
    console = Console()
    if not console.is_terminal:
        console = Console(width=200)
    console.print(tables[kind]())


def _table(*columns: str) -> Table:
    table = Table(box=None, header_style="bold", pad_edge=False)
    for column in columns:
        table.add_column(column, overflow="fold")
    return table


def _first_line(thing: Any) -> str:
    return (inspect.getdoc(thing) or "").split("\n")[0]


def _problems() -> Table:
    table = _table("problem", "parameters (SI)", "relative degree", "closed forms", "source")
    for name in PROBLEMS:
        problem = load_problem(name)
        parameters = ", ".join(f"{key}={value:.6g}" for key, value in problem.parameters.items())
        contacts = problem.dynamics.contacts
        more = f" And {len(contacts) - MAX_CONTACTS} more." if len(contacts) > MAX_CONTACTS else ""
        degrees = " ".join(contact.sentence for contact in contacts[:MAX_CONTACTS]) + more
        table.add_row(name, parameters, degrees, ", ".join(fact.symbol for fact in problem.facts), problem.source)
    return table


def _methods() -> Table:
    table = _table("method", "what it is; what it declares; where it is from")
    for name, kind in METHODS.items():
        d = kind.declared
        orders = ", ".join(f"{where} {order}" for where, order in d.orders.items())
        degrees = ", ".join(map(str, d.relative_degrees)) or "none"
        handles = ", ".join(feature.value for feature in d.handles) or "no further features"
        options = ", ".join(f"{each.name}={each.default}" for each in fields(kind) if each.default is not NO_DEFAULT)  # type: ignore[arg-type]
        lines = (
            f"orders: {orders}",
            f"relative degrees {degrees}; {handles}",
            f"contacts at level: {d.level}; penetration after impacts: {d.penetration}; force {d.reaction_time}",
            f"energy: {d.energy}" + ("; impacts never increase it" if d.dissipates else ""),
            *[f"steps: {d.adaptive}"] * bool(d.adaptive),
            f"options: {options or 'none'}",
            d.source,
        )
        table.add_row(name, _lines(d.summary, *lines))
    for name, reason in METHODS.broken.items():
        table.add_row(name, _lines("broken: registered by another package, and cannot be loaded", reason))
    return table


def _solvers() -> Table:
    table = _table("solver", "what it is; what it declares; where it is from")
    for name in SOLVERS:
        solver = SOLVERS[name]
        needs = ", ".join(each.value for each in solver.requires)
        declared = (
            f"M: {needs}" if needs else "any M",
            f"reads {', '.join(solver.storages)}",
            f"bounds: {'yes' if solver.boxed else 'no'}",
            "any n" if solver.largest is None else f"n <= {solver.largest}",
            f"residual {solver.tol:g}",
        )
        table.add_row(name, _lines(solver.summary, "; ".join(declared), *[solver.source] * (solver.source != "-")))
    here, elsewhere = _backends()
    table.add_row("qp:NAME", _lines(f"any backend of qpsolvers, as qp:osqp; installed: {', '.join(here) or 'none'}"))
    install = f"not installed: {', '.join(elsewhere) or 'none'}"
    table.add_row("", _lines(f"{install}; pip install 'qpsolvers[NAME]' installs one of them"))
    return table


def _lines(first: str, *others: str) -> Text:
    return Text(first).append("".join(f"\n{line}" for line in others), style="dim")


def _backends() -> tuple[list[str], list[str]]:
    """Return the QP backends that pip can install with qpsolvers: the installed ones, and the others."""
    extras = metadata("qpsolvers").get_all("Provides-Extra") or []
    # Two of the extras are collections of others.
    names = sorted(name for name in extras if "-" not in name and f"qp:{name}" not in list(SOLVERS))
    here = [name for name in names if f"qp:{name}" in SOLVERS]
    return here, [name for name in names if name not in here]


def _elements() -> Table:
    table = _table("element", "what it is", "constants")
    for name, kind in ELEMENTS.items():
        constants = ", ".join(each.name for each in fields(kind) if each.name != "symbols")  # type: ignore[arg-type]
        table.add_row(name, _first_line(kind).strip(), constants)
    return table
