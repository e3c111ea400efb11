"""The commands compare and cross-validate."""

from __future__ import annotations

from pathlib import Path

import click
from click.exceptions import Exit

from lcpimpact.cli.finish import check_study, finish
from lcpimpact.cli.options import (
    PATH,
    end_option,
    parse_methods,
    parse_penalty,
    penalty_option,
    problem_argument,
    resolve_run,
    set_option,
    solver_option,
    step_option,
    study_options,
    up_option,
)
from lcpimpact.cli.output import table_output_options


@click.command()
@problem_argument
@click.option(
    "--methods",
    metavar="A,B:OPTION=VALUE,...",
    default="moreau-jean,exact",
    help="Names of `lcpimpact list methods`, optionally with options.",
)
@penalty_option
@set_option
@step_option
@end_option
@solver_option
@click.option("--events", type=PATH, help="File for the events side by side: .csv, .xlsx or .tex.")
@click.option("--forces", type=PATH, help="File for the forces at their instants: .csv, .xlsx or .tex.")
@click.option("--energies", type=PATH, help="File for the energies at the end: .csv, .xlsx or .tex.")
@study_options
@up_option
@table_output_options
def compare(
    problem: str, methods: str, penalty: tuple[str, ...], set_: tuple[str, ...], dt: float | None,
    t_end: float | None, solver: str | None, events: Path | None, forces: Path | None, energies: Path | None,
    up: bool, out: Path | None, plot: Path | None, report: Path | None,
) -> None:  # fmt: skip
    """Run one problem by several methods, and show their differences in motion, events, forces and energies.

    The reference, which is named, is the exact solution or an independent one computed by none of them. With --penalty,
    compliant variants, run by event-driven, stand beside the rigid motion.

    Example: lcpimpact compare system-3 --methods moreau-jean,moreau-jean:theta=1,rk4-paper --dt 1e-2 --plot three.pdf
    """
    check_study((problem,), (out, events, forces, energies), plot, report)
    parsed = parse_methods(methods)
    spec = resolve_run(problem, set_, None, dt, t_end, solver)
    from lcpimpact.study.accuracy import comparison

    end = spec.problem.t_end if spec.run.t_end is None else spec.run.t_end
    step = min(1e-3, end / 1000.0) if spec.run.dt is None else spec.run.dt
    study = comparison.compare(
        spec.problem, parsed, dt=step, t_end=end, lcp_solver=spec.run.solver,
        penalties=[parse_penalty(each) for each in penalty],
    )  # fmt: skip
    finish(
        study,
        out,
        plot,
        report,
        drawn={"up": up},
        more=[(study.events, events), (study.forces, forces), (study.energies, energies)],
    )
    raise Exit(0 if study.runs else 1)


@click.command()
@problem_argument
@click.option(
    "--routes",
    metavar="A,B,...",
    help="Methods, method:solver for another LCP solver, closed-form, siconos; by default all that there are.",
)
@set_option
@click.option("--dt", type=float, help="The finest step in s; by default the end over 5265.")
@end_option
@click.option("--tol", type=float, help="A difference that is forgiven, relative to the size of the motion.")
@study_options
@table_output_options
def cross_validate(
    problem: str, routes: str | None, set_: tuple[str, ...], dt: float | None, t_end: float | None, tol: float | None,
    out: Path | None, plot: Path | None, report: Path | None,
) -> None:  # fmt: skip
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
    verdict = validate(spec.problem, named, dt=dt, t_end=end, tol=tol)
    finish(verdict, out, plot, report)
    raise Exit(0 if verdict.agree else 1)
