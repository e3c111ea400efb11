"""The commands about long motions: poincare, bifurcation, basins and orbit."""

from __future__ import annotations

from collections.abc import Callable
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lcpimpact.cli.options import End, Named, Plot, Report, Set, Table, bar, check_study, resolve_run, say, write_table
from lcpimpact.errors import FailureError, InputError

if TYPE_CHECKING:
    import pandas as pd

    from lcpimpact.problems.base import Problem
    from lcpimpact.schemefile import SchemeFile

LARGEST = 1_000_000
"""Maximum number of values of a parameter, or of starts."""

SHOWN = 12
"""Rows of a table that are said."""

SectionName = Annotated[
    str,
    typer.Option(
        help="force (once a period) or force:PHASE, impact or impact:CONTACT, or a crossing: x=0.1, up x>0.1, down x<0.1."
    ),
]
Long = Annotated[
    str | None,
    typer.Option(
        "--method", help="A name of [bold]lcpimpact list methods[/bold]; by default exact.", show_default=False
    ),
]
ShortStep = Annotated[
    float | None,
    typer.Option("--dt", help="Step in s of a method that steps; by default 200 a period.", show_default=False),
]
Transient = Annotated[int, typer.Option(min=0, help="Points that are left out first.")]
Workers = Annotated[int, typer.Option(min=1, help="Threads.")]


def poincare(
    problem: Named,
    set_: Set = None,
    section: SectionName = "force",
    transient: Transient = 100,
    crossings: Annotated[int, typer.Option(min=1, help="Points that are kept.")] = 1000,
    method: Long = None,
    dt: ShortStep = None,
    t_end: End = None,
    out: Table = None,
    plot: Plot = None,
    report: Report = None,
) -> None:
    """Cut a motion: its state once a period of the force, at each impact, or where a coordinate passes a level.

    Example: lcpimpact poincare shaw-holmes --set omega=2.9 --section impact --plot section.pdf
    """
    check_study((problem,), (out,), plot, report)
    spec = _spec(problem, set_, method)
    from lcpimpact.plotting.dynamics import plot_poincare
    from lcpimpact.study.dynamics.diagrams import period_of
    from lcpimpact.study.dynamics.sections import poincare as points_of

    table = points_of(
        spec.problem,
        section,
        transient=transient,
        crossings=crossings,
        t_end=t_end,
        method=spec.run.method,
        dt=dt,
        **spec.run.options,
    )
    nodes = spec.problem.dynamics.nodes
    period = period_of(table[[*nodes, *(f"v_{node}" for node in nodes)]].to_numpy()) if len(table) else 0
    words = f"they repeat after {period}" if period else "they do not repeat themselves"
    lead = f"{spec.problem.name} by {spec.run.method}: {len(table)} points at {section}; {words}"
    lines = [lead, *table.head(SHOWN).to_string(index=False).split("\n")]
    _finish(
        lines,
        out,
        plot,
        report,
        table,
        lambda path: plot_poincare(table, path=path),
        lead,
        f"Section of {spec.problem.name}",
    )


def bifurcation(
    problem: Named,
    over: Annotated[str, typer.Option(metavar="NAME=LOW:HIGH:COUNT", help="The parameter and its values.")],
    set_: Set = None,
    section: SectionName = "force",
    transient: Transient = 200,
    kept: Annotated[int, typer.Option(min=1, help="Points that are kept, for each value.")] = 50,
    follow: Annotated[
        bool, typer.Option("--follow", help="Start each run where the one before ended; HIGH:LOW sweeps down.")
    ] = False,
    orbit: Annotated[
        bool, typer.Option("--orbit", help="Draw the periodic orbit from the first value on, stable or not.")
    ] = False,
    periods: Annotated[int, typer.Option(min=1, help="Periods of the force in one of that orbit.")] = 1,
    y: Annotated[str | None, typer.Option(help="Column that is drawn.", show_default=False)] = None,
    method: Long = None,
    dt: ShortStep = None,
    workers: Workers = 1,
    out: Table = None,
    plot: Plot = None,
    report: Report = None,
) -> None:
    """Show where motions end up, for many values of a parameter.

    Example: lcpimpact bifurcation shaw-holmes --over omega=2.5:3.4:200 --section impact --plot diagram.pdf
    """
    check_study((problem,), (out,), plot, report)
    name, values = _range(over)
    spec = _spec(problem, set_, method, name)
    family = _family(problem, set_, method)
    from lcpimpact.plotting.dynamics import plot_bifurcation
    from lcpimpact.study.dynamics.continuation import continue_orbit
    from lcpimpact.study.dynamics.diagrams import bifurcation as diagram

    table = diagram(
        lambda value: family({name: value}),
        values,
        section,
        transient=transient,
        kept=kept,
        method=spec.run.method,
        dt=dt,
        continue_from=follow,
        workers=workers,
        watch=bar,
        **spec.run.options,
    )
    if (table["failure"] != "").all():
        raise FailureError(f"no value of {name} has a result: {table['failure'].iloc[0]}", None)
    branches = []
    if orbit:
        branch = continue_orbit(
            lambda value: family({name: value}), values, periods=periods, transient=transient, watch=bar
        )
        branches.append(branch)
    firsts = table.drop_duplicates("value")
    counted = firsts.loc[firsts["failure"] == "", "period"].value_counts().sort_index()
    failed = firsts.loc[firsts["failure"] != "", "failure"]
    lead = (
        f"{spec.problem.name} by {spec.run.method}: {len(values)} values of {name} from {values[0]:g} to {values[-1]:g}"
    )
    lines = [lead]
    for period, count in counted.items():
        lines.append(f"  {count} values: " + (f"points repeat after {period:.0f}" if period else "no period found"))
    lines += [f"  {len(rows)} without a result: {reason}" for reason, rows in failed.groupby(failed, sort=False)]
    lines += [f"  {branch.ended}" for branch in branches if branch.ended]

    def draw(path: Path | None) -> Any:
        return plot_bifurcation(table, y, path, branches=branches, parameter=name)

    _finish(lines, out, plot, report, table, draw, lead, f"Bifurcation diagram of {spec.problem.name}")


def basins(
    problem: Named,
    over: Annotated[
        list[str], typer.Option(metavar="NAME=LOW:HIGH:COUNT", help="Two values of the start; give it twice.")
    ],
    set_: Set = None,
    longest: Annotated[int, typer.Option(min=1, help="Periods of the force after which a start is given up.")] = 400,
    workers: Workers = 1,
    out: Table = None,
    plot: Plot = None,
    report: Report = None,
) -> None:
    """Show which start leads to which attractor, by the exact motion.

    Example: lcpimpact basins shaw-holmes --set omega=3.2 --over x0=-1:0:40 --over v0=-1:1:40 --plot basins.pdf
    """
    check_study((problem,), (out,), plot, report)
    if len(over) != 2:
        raise InputError(
            f"--over is given {len(over)} times: a plane needs two, as --over x0=-1:0:40 --over v0=-1:1:40"
        )
    (one, first), (other, second) = map(_range, over)
    if one == other:
        raise InputError(f"--over {one} is given twice: a plane needs two values of the start")
    if len(first) * len(second) > LARGEST:
        raise InputError(f"{len(first) * len(second):,} starts are more than {LARGEST:,}: take fewer")
    spec = _spec(problem, set_, "exact", one, other)
    family = _family(problem, set_, "exact")
    from lcpimpact.plotting.dynamics import plot_basins
    from lcpimpact.study.dynamics.basins import basins as of

    result = of(
        lambda a, b: family({one: a, other: b}),
        first,
        second,
        names=(one, other),
        longest=longest,
        workers=workers,
        watch=bar,
    )
    lost = float((result.table["attractor"] == 0).mean())
    lead = f"{spec.problem.name}: {len(result.table)} starts"
    lines = [lead]
    for row in result.attractors.drop_duplicates("attractor").to_dict("records"):
        lines.append(f"  attractor {row['attractor']}: period {row['period']}, of {row['share']:.1%} of the starts")
    if lost:
        lines.append(f"  no period found after {longest} periods of the force: {lost:.1%}")
    _finish(
        lines, out, plot, report, result.table, lambda path: plot_basins(result, path), lead,
        f"Basins of attraction of {spec.problem.name}",
    )  # fmt: skip


def orbit(
    problem: Named,
    set_: Set = None,
    periods: Annotated[int, typer.Option(min=1, help="Periods of the force in one of the orbit.")] = 1,
    period: Annotated[
        float | None, typer.Option(help="A guess of the period in s, where there is no force.", show_default=False)
    ] = None,
    transient: Annotated[int, typer.Option(min=0, help="Periods that are run before the search begins.")] = 0,
    over: Annotated[
        str | None,
        typer.Option(metavar="NAME=LOW:HIGH:COUNT", help="Follow the orbit along a parameter.", show_default=False),
    ] = None,
    out: Table = None,
    plot: Plot = None,
    report: Report = None,
) -> None:
    """Find a periodic orbit by shooting, with its Floquet multipliers, and follow it along a parameter if asked.

    The table holds the multipliers, or the branch that was followed.

    Example: lcpimpact orbit shaw-holmes --set omega=2.7 --transient 5 --plot orbit.pdf
    """
    check_study((problem,), (out,), plot, report)
    import pandas as pd

    from lcpimpact.plotting.dynamics import plot_orbit
    from lcpimpact.study.dynamics.continuation import continue_orbit
    from lcpimpact.study.dynamics.shooting import periodic_orbit

    if over is not None:
        name, values = _range(over)
        _spec(problem, set_, "exact", name)
        family = _family(problem, set_, "exact")
        branch = continue_orbit(
            lambda value: family({name: value}), values, periods=periods, T=period, transient=transient, watch=bar
        )
        found, table = branch.orbits[-1], branch.table
        lines = table.drop(columns="failure").to_string(index=False, na_rep="-").split("\n")
        lines += [branch.ended] if branch.ended else []
    else:
        found = periodic_orbit(_spec(problem, set_, "exact").problem, periods=periods, T=period, transient=transient)
        μ = found.floquet
        table = pd.DataFrame({"real": μ.real, "imaginary": μ.imag, "modulus": abs(μ)})
        lines = [f"  multiplier {each.real:+.12f} {each.imag:+.12f}i   |μ| = {abs(each):.12f}" for each in μ]
        lines += [f"  {event.kind} {event.contact} at t = {event.t:.12g} s" for event in found.events]
        lines += [f"  speed {speed:.15g} m/s" for speed in found.speeds]
    lead = (
        f"{found.problem.name}: T = {found.T:.15g} s, {'stable' if found.stable else 'not stable'}, "
        f"found to {found.residual:.1e} in {found.iterations} steps"
    )
    _finish(
        [lead, *lines], out, plot, report, table, lambda path: plot_orbit(found, path=path), lead,
        f"Periodic orbit of {found.problem.name}",
    )  # fmt: skip


def _spec(problem: str, set_: list[str] | None, method: str | None, *names: str) -> SchemeFile:
    """Return the problem and the run, after a look at whether the parameters that vary are its own."""
    from lcpimpact.registry import nearest

    spec = resolve_run(problem, set_, method or "exact")
    for name in names:
        if spec.registered is None:
            raise InputError(f"--over {name}: the constants of a scheme file are changed in the file itself")
        if name not in spec.problem.parameters:
            raise InputError(nearest(name, list(spec.problem.parameters), f"parameter of {spec.problem.name}"))
    return spec


def _family(problem: str, set_: list[str] | None, method: str | None) -> Callable[[dict[str, float]], Problem]:
    """Return how the problem is made anew with other values."""

    def family(values: dict[str, float]) -> Problem:
        given = [*(set_ or []), *(f"{name}={value!r}" for name, value in values.items())]
        return resolve_run(problem, given, method or "exact").problem

    return family


def _range(text: str) -> tuple[str, list[float]]:
    """Return the name and the values of NAME=LOW:HIGH:COUNT."""
    import numpy as np

    name, equals, span = text.partition("=")
    try:
        low, high, count = span.split(":")
        ends, number = (float(low), float(high)), int(count)
    except ValueError:
        equals = ""
    if not equals or not name.strip() or not np.isfinite(ends).all() or not 1 <= number <= LARGEST:
        raise InputError(f"--over {text!r} must read NAME=LOW:HIGH:COUNT, as in --over f=0.1:0.5:200")
    return name.strip(), [float(value) for value in np.linspace(*ends, number)]


def _finish(
    lines: list[str],
    out: Path | None,
    plot: Path | None,
    report: Path | None,
    table: pd.DataFrame,
    draw: Callable[[Path | None], Any],
    lead: str,
    title: str,
) -> None:
    """Write what is asked for, and say it."""
    from lcpimpact.report.report import Section as Part
    from lcpimpact.report.report import write_report

    if out is not None:
        lines.append(write_table(table, out))
    if plot is not None:
        draw(plot)
        lines.append(f"drew {plot}")
    if report is not None:
        said = "".join(
            f"<li>{escape(line.strip())}</li>" for line in lines[1:] if not line.startswith(("wrote", "drew"))
        )
        parts: list[Part] = [
            Part("Picture", figures=[draw(None)]),
            Part("In words", text=f"<ul>{said}</ul>" if len(lines) <= 40 else ""),
            Part("Table", table=table, form=".6g", folded=True),
        ]
        write_report(report, title, escape(lead), parts)
        lines.append(f"wrote {report}")
    say(*lines)
