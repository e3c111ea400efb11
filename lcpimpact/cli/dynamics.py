"""The commands poincare, bifurcation, basins and orbit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lcpimpact.cli.finish import check_study, finish
from lcpimpact.cli.options import End, Named, Plot, Report, Set, Solver, Table, resolve_run
from lcpimpact.errors import FailureError, InputError

if TYPE_CHECKING:
    from lcpimpact.problems.base import Problem
    from lcpimpact.schemefile import SchemeFile
    from lcpimpact.study.result import Study

LARGEST = 1_000_000
"""Maximum number of values of a parameter, or of starts."""

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
Skip = Annotated[int, typer.Option(min=0, help="Points that are left out first.")]
Workers = Annotated[int, typer.Option(min=1, help="Threads.")]


def poincare(
    problem: Named,
    set_: Set = None,
    section: SectionName = "force",
    skip: Skip = 100,
    points: Annotated[int, typer.Option(min=1, help="Points that are kept.")] = 1000,
    method: Long = None,
    dt: ShortStep = None,
    solver: Solver = None,
    t_end: End = None,
    out: Table = None,
    plot: Plot = None,
    report: Report = None,
) -> None:
    """Cut a motion: its state once a period of the force, at each impact, or where a coordinate passes a level.

    Example: lcpimpact poincare shaw-holmes --set omega=2.9 --section impact --plot section.pdf
    """
    check_study((problem,), (out,), plot, report)
    spec = _spec(problem, set_, method, solver=solver)
    from lcpimpact.study.dynamics.sections import poincare as points_of

    study = points_of(
        spec.problem,
        section,
        skip=skip,
        points=points,
        t_end=t_end,
        method=spec.run.method,
        dt=dt,
        lcp_solver=spec.run.solver,
        **spec.run.options,
    )
    finish(study, out, plot, report)


def bifurcation(
    problem: Named,
    over: Annotated[str, typer.Option(metavar="NAME=LOW:HIGH:COUNT", help="The parameter and its values.")],
    set_: Set = None,
    section: SectionName = "force",
    skip: Skip = 200,
    points: Annotated[int, typer.Option(min=1, help="Points that are kept, for each value.")] = 50,
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
    solver: Solver = None,
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
    spec = _spec(problem, set_, method, name, solver=solver)
    family = _family(problem, set_, method)
    from lcpimpact.study.dynamics.continuation import continue_orbit
    from lcpimpact.study.dynamics.diagrams import bifurcation as diagram

    def member(value: float) -> Problem:
        return family({name: value})

    study = diagram(
        member,
        values,
        section,
        skip=skip,
        points=points,
        method=spec.run.method,
        dt=dt,
        lcp_solver=spec.run.solver,
        continue_from=follow,
        workers=workers,
        parameter=name,
        **spec.run.options,
    )
    if len(study.failures) == len(study.table):
        raise FailureError(f"no value of {name} has a result: {study.table['failure'].iloc[0]}", None)
    if orbit:
        branch = continue_orbit(member, values, periods=periods, transient=skip, parameter=name)
        study = replace(study, branches=(branch,))
    finish(replace(study, y=y), out, plot, report)


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
    _spec(problem, set_, "exact", one, other)
    family = _family(problem, set_, "exact")
    from lcpimpact.study.dynamics.basins import basins as of

    study = of(
        lambda a, b: family({one: a, other: b}),
        first,
        second,
        parameters=(one, other),
        longest=longest,
        workers=workers,
    )
    finish(study, out, plot, report)


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

    Table and picture show the orbit and its multipliers, or the branch that was followed.

    Example: lcpimpact orbit shaw-holmes --set omega=2.7 --transient 5 --plot orbit.pdf
    """
    check_study((problem,), (out,), plot, report)
    from lcpimpact.study.dynamics.continuation import continue_orbit
    from lcpimpact.study.dynamics.shooting import periodic_orbit

    shooting: dict[str, Any] = {"periods": periods, "T": period, "transient": transient}
    study: Study
    if over is None:
        study = periodic_orbit(_spec(problem, set_, "exact").problem, **shooting)
    else:
        name, values = _range(over)
        _spec(problem, set_, "exact", name)
        family = _family(problem, set_, "exact")
        study = continue_orbit(lambda value: family({name: value}), values, parameter=name, **shooting)
    finish(study, out, plot, report)


def _spec(
    problem: str, set_: list[str] | None, method: str | None, *names: str, solver: str | None = None
) -> SchemeFile:
    """Return the problem and the run, after a look at whether the parameters that vary are its own."""
    from lcpimpact.registry import nearest

    spec = resolve_run(problem, set_, method or "exact", solver=solver)
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
