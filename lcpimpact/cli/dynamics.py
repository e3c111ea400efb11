"""The commands poincare, bifurcation, basins and orbit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lcpimpact.cli.finish import check_study, finish
from lcpimpact.cli.options import (
    End,
    Named,
    Over,
    Plot,
    Report,
    Set,
    Solver,
    Table,
    fixed_and_varied,
    resolve_run,
    values_of,
)
from lcpimpact.errors import FailureError, InputError

if TYPE_CHECKING:
    from lcpimpact.problems.base import Problem
    from lcpimpact.schemefile import SchemeFile
    from lcpimpact.study.result import Study

MAX_VALUES = 1_000_000
"""Maximum number of values of a parameter, or of initial states."""

SectionName = Annotated[
    str,
    typer.Option(
        help="force (once a period) or force:PHASE, impact or impact:CONTACT, or a crossing: x=0.1, up x>0.1, down x<0.1."
    ),
]
ExactMethod = Annotated[
    str | None,
    typer.Option(
        "--method", help="A name of [bold]lcpimpact list methods[/bold]; by default exact.", show_default=False
    ),
]
SteppingDt = Annotated[
    float | None,
    typer.Option("--dt", help="Step in s of time stepping; by default 1/200 of the period.", show_default=False),
]
Skip = Annotated[int, typer.Option(min=0, help="Number of initial points to discard.")]
Workers = Annotated[int, typer.Option(min=1, help="Threads.")]


def poincare(
    problem: Named,
    set_: Set = None,
    section: SectionName = "force",
    skip: Skip = 100,
    points: Annotated[int, typer.Option(min=1, help="Number of points to record.")] = 1000,
    method: ExactMethod = None,
    dt: SteppingDt = None,
    solver: Solver = None,
    t_end: End = None,
    out: Table = None,
    plot: Plot = None,
    report: Report = None,
) -> None:
    """Compute a Poincaré section: the states once per period of the force, at impacts, or at level crossings.

    Example: lcpimpact poincare shaw-holmes --set omega=2.9 --section impact --plot section.pdf
    """
    check_study((problem,), (out,), plot, report)
    spec = _resolve(problem, set_, method, solver=solver)
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
    over: Over = None,
    set_: Set = None,
    section: SectionName = "force",
    skip: Skip = 200,
    points: Annotated[int, typer.Option(min=1, help="Number of points to record for each value.")] = 50,
    follow: Annotated[
        bool, typer.Option("--follow", help="Start each run at the end of the previous one; HIGH:LOW sweeps down.")
    ] = False,
    orbit: Annotated[
        bool, typer.Option("--orbit", help="Draw the branch of periodic orbits from the first value, stable or not.")
    ] = False,
    periods: Annotated[int, typer.Option(min=1, help="Periods of the force per period of that orbit.")] = 1,
    y: Annotated[str | None, typer.Option(help="Column to draw.", show_default=False)] = None,
    method: ExactMethod = None,
    dt: SteppingDt = None,
    solver: Solver = None,
    workers: Workers = 1,
    out: Table = None,
    plot: Plot = None,
    report: Report = None,
) -> None:
    """Compute a bifurcation diagram: the attractors for many values of a parameter.

    Example: lcpimpact bifurcation shaw-holmes --over omega=2.5:3.4:200 --section impact --plot diagram.pdf
    """
    check_study((problem,), (out,), plot, report)
    fixed, ((name, values),) = _varied(set_, over, 1, "a diagram needs one, as --over omega=2.5:3.4:200")
    spec = _resolve(problem, fixed, method, name, solver=solver)
    family = _problem_family(problem, fixed, method)
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
    over: Over = None,
    set_: Set = None,
    longest: Annotated[int, typer.Option(min=1, help="Maximum number of periods of the force to convergence.")] = 400,
    method: ExactMethod = None,
    dt: SteppingDt = None,
    solver: Solver = None,
    workers: Workers = 1,
    out: Table = None,
    plot: Plot = None,
    report: Report = None,
) -> None:
    """Compute basins of attraction in a plane of initial states.

    Example: lcpimpact basins shaw-holmes --set omega=3.2 --over x0=-1:0:40 --over v0=-1:1:40 --plot basins.pdf
    """
    check_study((problem,), (out,), plot, report)
    fixed, pair = _varied(set_, over, 2, "a plane needs two, as --over x0=-1:0:40 --over v0=-1:1:40")
    (one, first), (other, second) = pair
    if len(first) * len(second) > MAX_VALUES:
        raise InputError(f"{len(first) * len(second):,} initial states are more than {MAX_VALUES:,}: take fewer")
    spec = _resolve(problem, fixed, method, one, other, solver=solver)
    family = _problem_family(problem, fixed, method)
    from lcpimpact.study.dynamics.basins import basins as of

    study = of(
        lambda a, b: family({one: a, other: b}),
        first,
        second,
        parameters=(one, other),
        longest=longest,
        workers=workers,
        method=spec.run.method,
        dt=dt,
        lcp_solver=spec.run.solver,
        **spec.run.options,
    )
    finish(study, out, plot, report)


def orbit(
    problem: Named,
    set_: Set = None,
    periods: Annotated[int, typer.Option(min=1, help="Periods of the force per period of the orbit.")] = 1,
    period: Annotated[
        float | None, typer.Option(help="Estimate of the period in s, if there is no force.", show_default=False)
    ] = None,
    transient: Annotated[int, typer.Option(min=0, help="Periods to simulate before the search.")] = 0,
    over: Over = None,
    out: Table = None,
    plot: Plot = None,
    report: Report = None,
) -> None:
    """Find a periodic orbit by shooting, with its Floquet multipliers, and optionally continue it along a parameter.

    The table and the picture show the orbit and its multipliers, or the continued branch.

    Example: lcpimpact orbit shaw-holmes --set omega=2.7 --transient 5 --plot orbit.pdf
    """
    check_study((problem,), (out,), plot, report)
    from lcpimpact.study.dynamics.continuation import continue_orbit
    from lcpimpact.study.dynamics.shooting import periodic_orbit

    shooting: dict[str, Any] = {"periods": periods, "T": period, "transient": transient}
    study: Study
    fixed, varied = _varied(set_, over, None, "a branch needs one, as --over omega=2.6:3.0:20")
    if not varied:
        study = periodic_orbit(_resolve(problem, set_, "exact").problem, **shooting)
    else:
        ((name, values),) = varied
        _resolve(problem, fixed, "exact", name)
        family = _problem_family(problem, fixed, "exact")
        study = continue_orbit(lambda value: family({name: value}), values, parameter=name, **shooting)
    finish(study, out, plot, report)


def _resolve(
    problem: str, set_: list[str] | None, method: str | None, *names: str, solver: str | None = None
) -> SchemeFile:
    """Return the problem and the run, after a check that the varied parameters belong to the problem."""
    from lcpimpact.registry import nearest

    spec = resolve_run(problem, set_, method or "exact", solver=solver)
    for name in names:
        if spec.registered is None:
            raise InputError(f"--over {name}: a scheme file has no parameters; change its constants in the file")
        if name not in spec.problem.parameters:
            raise InputError(nearest(name, list(spec.problem.parameters), f"parameter of {spec.problem.name}"))
    return spec


def _problem_family(problem: str, set_: list[str] | None, method: str | None) -> Callable[[dict[str, float]], Problem]:
    """Return the function that makes the problem for given parameter values."""

    def family(values: dict[str, float]) -> Problem:
        given = [*(set_ or []), *(f"{name}={value!r}" for name, value in values.items())]
        return resolve_run(problem, given, method or "exact").problem

    return family


def _varied(
    set_: list[str] | None, over: list[str] | None, count: int | None, needed: str
) -> tuple[list[str], list[tuple[str, list[float]]]]:
    """Return the options that fix a value, and the names and values of the parameters that are varied, ``count`` of them.

    Without a count there is one or none; ``needed`` is the remedy.
    """
    fixed, varied = fixed_and_varied(set_, over)
    if len(varied) != count and (count is not None or len(varied) > 1):
        raise InputError(f"--over names {len(varied)} parameters: {needed}")
    return fixed, [(name, values_of(name, span, max_values=MAX_VALUES)) for name, span in varied.items()]
