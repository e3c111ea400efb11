"""The commands poincare, bifurcation, basins and orbit."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from lcpimpact.cli.finish import check_study, finish
from lcpimpact.cli.options import (
    Count,
    end_option,
    fixed_and_varied,
    names_of,
    over_option,
    problem_argument,
    resolve_run,
    set_option,
    solver_option,
    study_options,
    values_of,
)
from lcpimpact.cli.output import table_output_options
from lcpimpact.errors import FailureError, InputError
from lcpimpact.integrators import METHODS

if TYPE_CHECKING:
    from lcpimpact.problems.base import Problem
    from lcpimpact.schemefile import SchemeFile
    from lcpimpact.study.result import Study

MAX_VALUES = 1_000_000
"""Maximum number of values of a parameter, or of initial states."""

section_option = click.option(
    "--section",
    default="force",
    help="force (once a period) or force:PHASE, impact or impact:CONTACT, or a crossing: x=0.1, up x>0.1, down x<0.1.",
)
method_option = click.option(
    "--method", shell_complete=names_of(METHODS), help="A name of `lcpimpact list methods`; by default exact."
)
step_option = click.option("--dt", type=float, help="Step in s of time stepping; by default 1/200 of the period.")
workers_option = click.option("--workers", type=Count(min=1), default=1, help="Threads.")


@click.command()
@problem_argument
@set_option
@section_option
@click.option("--skip", type=Count(min=0), default=100, help="Number of initial points to discard.")
@click.option("--points", type=Count(min=1), default=1000, help="Number of points to record.")
@method_option
@step_option
@solver_option
@end_option
@study_options
@table_output_options
def poincare(
    problem: str, set_: tuple[str, ...], section: str, skip: int, points: int, method: str | None, dt: float | None,
    solver: str | None, t_end: float | None, out: Path | None, plot: Path | None, report: Path | None,
) -> None:  # fmt: skip
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


@click.command()
@problem_argument
@over_option
@set_option
@section_option
@click.option("--skip", type=Count(min=0), default=200, help="Number of initial points to discard.")
@click.option("--points", type=Count(min=1), default=50, help="Number of points to record for each value.")
@click.option("--follow", is_flag=True, help="Start each run at the end of the previous one; HIGH:LOW sweeps down.")
@click.option("--orbit", is_flag=True, help="Draw the branch of periodic orbits from the first value, stable or not.")
@click.option("--periods", type=Count(min=1), default=1, help="Periods of the force per period of that orbit.")
@click.option("--y", help="Column to draw.")
@method_option
@step_option
@solver_option
@workers_option
@study_options
@table_output_options
def bifurcation(
    problem: str, over: tuple[str, ...], set_: tuple[str, ...], section: str, skip: int, points: int, follow: bool,
    orbit: bool, periods: int, y: str | None, method: str | None, dt: float | None, solver: str | None, workers: int,
    out: Path | None, plot: Path | None, report: Path | None,
) -> None:  # fmt: skip
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


@click.command()
@problem_argument
@over_option
@set_option
@click.option(
    "--longest",
    type=Count(min=1),
    default=400,
    help="Maximum number of periods of the force to convergence.",
)
@method_option
@step_option
@solver_option
@workers_option
@study_options
@table_output_options
def basins(
    problem: str, over: tuple[str, ...], set_: tuple[str, ...], longest: int, method: str | None, dt: float | None,
    solver: str | None, workers: int, out: Path | None, plot: Path | None, report: Path | None,
) -> None:  # fmt: skip
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


@click.command()
@problem_argument
@set_option
@click.option("--periods", type=Count(min=1), default=1, help="Periods of the force per period of the orbit.")
@click.option("--period", type=float, help="Estimate of the period in s, if there is no force.")
@click.option("--transient", type=Count(min=0), default=0, help="Periods to simulate before the search.")
@over_option
@click.option(
    "--folds", is_flag=True, help="Continue through folds, from LOW towards HIGH, in COUNT - 1 steps at first."
)
@click.option(
    "--curve",
    type=click.Choice(["fold", "flip", "grazing"]),
    help="Follow the first such bifurcation along the first --over in the plane of two --over, from LOW of the second.",
)
@click.option("--contact", help="Contact of --curve grazing; by default the only one.")
@study_options
@table_output_options
def orbit(
    problem: str, set_: tuple[str, ...], periods: int, period: float | None, transient: int, over: tuple[str, ...],
    folds: bool, curve: str | None, contact: str | None, out: Path | None, plot: Path | None, report: Path | None,
) -> None:  # fmt: skip
    """Find a periodic orbit by shooting, with its Floquet multipliers, and optionally continue it along parameters.

    The table and the picture show the orbit and its multipliers, the branch along one parameter, or the curve of its
    folds, flips or grazings in the plane of two.

    Example: lcpimpact orbit shaw-holmes --set omega=2.7 --transient 5 --plot orbit.pdf
    """
    check_study((problem,), (out,), plot, report)
    from lcpimpact.study.dynamics.continuation import continue_orbit
    from lcpimpact.study.dynamics.shooting import periodic_orbit

    shooting: dict[str, Any] = {"periods": periods, "T": period, "transient": transient}
    study: Study
    needed = "a curve needs two, as --over omega=2.6:3.0:20 --over e=0.8:0.5:20"
    if not curve:
        needed = "a branch needs one, as --over omega=2.6:3.0:20"
    fixed, varied = _varied(set_, over, 2 if curve else None, needed)
    if curve and folds:
        raise InputError("--folds is of branches along one parameter, --curve of two: give one of the two options")
    if contact and curve != "grazing":
        raise InputError(f"--contact {contact} is of --curve grazing: leave it out")
    if (folds or curve) and (not varied or min(len(values) for _, values in varied) < 2):
        what = f"--curve {curve}" if curve else "--folds"
        raise InputError(f"{what} needs a parameter to continue along: give --over NAME=LOW:HIGH:COUNT")
    if not varied:
        study = periodic_orbit(_resolve(problem, set_, "exact").problem, **shooting)
    else:
        names = tuple(name for name, _ in varied)
        _resolve(problem, fixed, "exact", *names)
        family = _problem_family(problem, fixed, "exact")

        def member(*values: float) -> Problem:
            return family(dict(zip(names, values, strict=True)))

        ends = [(values[0], values[-1]) for _, values in varied]
        step = 1.0 / (len(varied[0][1]) - 1) if folds or curve else 1.0
        if curve:
            from lcpimpact.study.dynamics.curves import bifurcation_curve

            study = bifurcation_curve(
                member, ends[0], ends[1], curve, contact=contact, step=step, parameters=(names[0], names[1]), **shooting
            )
        elif folds:
            from lcpimpact.study.dynamics.folds import continue_through_folds

            study = continue_through_folds(member, ends[0], step=step, parameter=names[0], **shooting)
        else:
            study = continue_orbit(member, varied[0][1], parameter=names[0], **shooting)
    finish(study, out, plot, report)


def _resolve(
    problem: str, set_: Sequence[str], method: str | None, *names: str, solver: str | None = None
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


def _problem_family(problem: str, set_: Sequence[str], method: str | None) -> Callable[[dict[str, float]], Problem]:
    """Return the function that makes the problem for given parameter values."""

    def family(values: dict[str, float]) -> Problem:
        given = [*set_, *(f"{name}={value!r}" for name, value in values.items())]
        return resolve_run(problem, given, method or "exact").problem

    return family


def _varied(
    set_: Sequence[str], over: Sequence[str], count: int | None, needed: str
) -> tuple[list[str], list[tuple[str, list[float]]]]:
    """Return the options that fix a value, and the names and values of the parameters that are varied, ``count`` of them.

    Without a count there is one or none; ``needed`` is the remedy.
    """
    fixed, varied = fixed_and_varied(set_, over)
    if len(varied) != count and (count is not None or len(varied) > 1):
        raise InputError(f"--over names {len(varied)} parameters: {needed}")
    return fixed, [(name, values_of(name, span, max_values=MAX_VALUES)) for name, span in varied.items()]
