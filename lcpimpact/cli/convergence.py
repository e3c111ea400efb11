"""The commands converge and work-precision."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click
from click.exceptions import Exit

from lcpimpact.cli.finish import check_study, finish
from lcpimpact.cli.options import (
    PATH,
    Count,
    end_option,
    numbers,
    parse_methods,
    parse_penalty,
    penalty_option,
    problem_argument,
    resolve_run,
    set_option,
    solver_option,
    study_options,
)
from lcpimpact.cli.output import table_output_options
from lcpimpact.errors import InputError, UnsupportedError

if TYPE_CHECKING:
    from lcpimpact.integrators.base import Integrator
    from lcpimpact.problems.base import Problem

DEFAULT_METHODS = ("moreau-jean", "generalized-alpha", "rattle-ns", "heun", "rk4", "radau-fesd")
"""Methods run by default, if they handle the problem."""

COARSEST = 100
"""Smallest of the default step counts."""

methods_option = click.option(
    "--methods",
    metavar="A,B:OPTION=VALUE,...",
    help="Names of `lcpimpact list methods`, optionally with options; by default a few that handle it.",
)
steps_option = click.option(
    "--dts",
    metavar="H1,H2,...",
    help="Steps in s; by default six, from a hundredth of the end down. Each becomes the end over a prime.",
)
norm_option = click.option("--norm", help="Norm that is printed and drawn; by default that of the declared orders.")


@click.command()
@problem_argument
@set_option
@methods_option
@steps_option
@click.option("--counts", metavar="N1,N2,...", help="Step counts instead of steps.")
@norm_option
@click.option(
    "--gradient",
    nargs=2,
    metavar="OUTPUT PARAMETER",
    help="Measure the error of a derivative of the runs instead, as `--gradient x@1 H`, against `sensitivity`.",
)
@penalty_option
@end_option
@solver_option
@click.option("--check", is_flag=True, help="Exit with 1 if an observed order differs from the declared one.")
@click.option("--orders", type=PATH, help="File for the table of observed orders: .csv, .xlsx or .tex.")
@study_options
@table_output_options
def converge(
    problem: str, set_: tuple[str, ...], methods: str | None, dts: str | None, counts: str | None, norm: str | None,
    gradient: tuple[str, str] | None, penalty: tuple[str, ...], t_end: float | None, solver: str | None, check: bool,
    orders: Path | None, out: Path | None, plot: Path | None, report: Path | None,
) -> None:  # fmt: skip
    """Run one problem by several methods with several steps, and observe the order of each in every norm.

    The reference, which is named, is the exact solution or an independent one; the steps avoid events at grid points.

    Example: lcpimpact converge system-1 --methods moreau-jean,moreau-jean:theta=1,rk4 --plot orders.pdf --out orders.csv
    """
    check_study((problem,), (out, orders), plot, report)
    spec = resolve_run(problem, set_, t_end=t_end, solver=solver)
    end = spec.problem.t_end if spec.run.t_end is None else spec.run.t_end
    if dts is not None and counts is not None:
        raise InputError("--dts and --counts both give the steps: give only one of them")
    if gradient is not None and norm is not None:
        raise InputError("--gradient measures the error of a derivative, which has no norm: leave out --norm")
    _check_norm(norm)
    steps = _steps(dts, counts, end)
    from lcpimpact.study.accuracy.convergence import convergence, observed_orders

    study = convergence(
        spec.problem,
        _methods(methods, spec.problem, end),
        steps,
        t_end=end,
        penalties=[parse_penalty(each) for each in penalty],
        gradient=gradient,
        lcp_solver=spec.run.solver,
    )
    study = replace(study, norm=norm or study.norm)
    found = observed_orders(study)
    finish(study, out, plot, report, more=[(lambda: found, orders)])
    raise Exit(1 if check and (found["verdict"] == "off").any() else 0)


@click.command()
@problem_argument
@set_option
@methods_option
@steps_option
@click.option("--rtols", metavar="R1,R2,...", help="Tolerances of adaptive methods; by default 1e-3 to 1e-10.")
@click.option("--repeats", type=Count(min=1), default=5, help="Runs of each; the shortest time counts.")
@norm_option
@click.option(
    "--cost",
    default="seconds",
    help="Cost to draw: seconds, steps, evaluations, lcp_solves, lcp_iterations, ...",
)
@penalty_option
@end_option
@solver_option
@study_options
@table_output_options
def work_precision(
    problem: str, set_: tuple[str, ...], methods: str | None, dts: str | None, rtols: str | None, repeats: int,
    norm: str | None, cost: str, penalty: tuple[str, ...], t_end: float | None, solver: str | None, out: Path | None,
    plot: Path | None, report: Path | None,
) -> None:  # fmt: skip
    """Measure errors against costs, counted and timed, of smooth and nonsmooth methods on one diagram.

    Adaptive methods run with several tolerances instead of several steps.

    Example: lcpimpact work-precision bouncing-ball --set e=0.8 --t-end 2 --penalty kelvin-voigt:1e6 --plot cost.pdf
    """
    check_study((problem,), (out,), plot, report)
    spec = resolve_run(problem, set_, t_end=t_end, solver=solver)
    end = spec.problem.t_end if spec.run.t_end is None else spec.run.t_end
    steps = _steps(dts, None, end)
    from lcpimpact.registry import nearest
    from lcpimpact.study.accuracy.convergence import COSTS, RTOLS
    from lcpimpact.study.accuracy.convergence import work_precision as measure

    _check_norm(norm)
    if cost not in COSTS:
        raise InputError(nearest(cost, list(COSTS), "cost"))
    study = measure(
        spec.problem,
        _methods(methods, spec.problem, end, ("event-driven", "exact")),
        steps,
        rtols=RTOLS if rtols is None else numbers(rtols, "--rtols"),
        t_end=end,
        repeats=repeats,
        penalties=[parse_penalty(each) for each in penalty],
        lcp_solver=spec.run.solver,
    )
    finish(replace(study, norm=norm or study.norm, cost=cost), out, plot, report)


def _steps(dts: str | None, counts: str | None, end: float, *, levels: int = 6, refinement: float = 1.6) -> list[float]:
    """Return the steps that are asked for, or those of ``levels`` step counts, each ``refinement`` times the one before."""
    if dts is not None:
        return numbers(dts, "--dts")
    if counts is not None:
        found = numbers(counts, "--counts")
        if any(count < 1 for count in found):
            raise InputError(f"--counts {counts!r} must be step counts of at least 1, as in --counts 100,200")
        return [end / count for count in found]
    return [end / (COARSEST * refinement**i) for i in range(levels)]


def _methods(
    text: str | None, problem: Problem, end: float, others: tuple[str, ...] = ()
) -> dict[str, Integrator] | list[str]:
    """Return the named methods, or the default ones that handle the problem."""
    from lcpimpact.simulation import simulate

    if text is not None:
        return parse_methods(text)
    supported = []
    for name in (*DEFAULT_METHODS, *others):
        try:
            simulate(problem, name, dt=end / COARSEST, t_end=end / COARSEST, throw=False, progress=False)
        except UnsupportedError:
            continue
        supported.append(name)
    if not supported:
        raise InputError(f"none of the default methods handles {problem.name!r}: name others by --methods")
    return supported


def _check_norm(norm: str | None) -> None:
    from lcpimpact.registry import nearest
    from lcpimpact.study.accuracy.norms import NORMS

    if norm is not None and norm not in NORMS:
        raise InputError(nearest(norm, list(NORMS), "norm"))
