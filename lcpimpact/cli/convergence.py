"""The commands converge and work-precision."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from lcpimpact.cli.finish import check_study, finish
from lcpimpact.cli.options import (
    End,
    Named,
    Penalties,
    Plot,
    Report,
    Set,
    Solver,
    Table,
    numbers,
    parse_methods,
    parse_penalty,
    resolve_run,
)
from lcpimpact.errors import InputError, UnsupportedError

if TYPE_CHECKING:
    from lcpimpact.integrators.base import Integrator
    from lcpimpact.problems.base import Problem

DEFAULT_METHODS = ("moreau-jean", "generalized-alpha", "rattle-ns", "heun", "rk4", "radau-fesd")
"""Methods run by default, if they handle the problem."""

COARSEST = 100
"""Smallest of the default step counts."""

Methods = Annotated[
    str | None,
    typer.Option(
        metavar="A,B:OPTION=VALUE,...",
        help="Names of [bold]lcpimpact list methods[/bold], optionally with options; by default a few that handle it.",
        show_default=False,
    ),
]
Steps = Annotated[
    str | None,
    typer.Option(
        metavar="H1,H2,...",
        help="Steps in s; by default six, from a hundredth of the end down. Each becomes the end over a prime.",
        show_default=False,
    ),
]
NormName = Annotated[
    str | None,
    typer.Option(help="Norm that is printed and drawn; by default that of the declared orders.", show_default=False),
]


def converge(
    problem: Named,
    set_: Set = None,
    methods: Methods = None,
    dts: Steps = None,
    counts: Annotated[
        str | None, typer.Option(metavar="N1,N2,...", help="Step counts instead of steps.", show_default=False)
    ] = None,
    norm: NormName = None,
    penalty: Penalties = None,
    t_end: End = None,
    solver: Solver = None,
    check: Annotated[
        bool, typer.Option("--check", help="Exit with 1 if an observed order differs from the declared one.")
    ] = False,
    out: Table = None,
    orders: Annotated[
        Path | None,
        typer.Option(help="File for the table of observed orders: .csv, .xlsx or .tex.", show_default=False),
    ] = None,
    plot: Plot = None,
    report: Report = None,
) -> None:
    """Run one problem by several methods with several steps, and observe the order of each in every norm.

    The reference, which is named, is the exact solution or an independent one; the steps avoid events at grid points.

    Example: lcpimpact converge system-1 --methods moreau-jean,moreau-jean:theta=1,rk4 --plot orders.pdf --out orders.csv
    """
    check_study((problem,), (out, orders), plot, report)
    spec = resolve_run(problem, set_, t_end=t_end, solver=solver)
    end = spec.problem.t_end if spec.run.t_end is None else spec.run.t_end
    if dts is not None and counts is not None:
        raise InputError("--dts and --counts both give the steps: give only one of them")
    steps = _steps(dts, counts, end)
    from lcpimpact.study.accuracy.convergence import convergence, observed_orders

    study = convergence(
        spec.problem,
        _methods(methods, spec.problem, end),
        steps,
        t_end=end,
        penalties=[parse_penalty(each) for each in penalty or []],
        lcp_solver=spec.run.solver,
    )
    study = replace(study, norm=_norm(norm) or study.norm)
    found = observed_orders(study)
    finish(study, out, plot, report, more=[(lambda: found, orders)])
    raise typer.Exit(1 if check and (found["verdict"] == "off").any() else 0)


def work_precision(
    problem: Named,
    set_: Set = None,
    methods: Methods = None,
    dts: Steps = None,
    rtols: Annotated[
        str | None,
        typer.Option(
            metavar="R1,R2,...",
            help="Tolerances of adaptive methods; by default 1e-3 to 1e-10.",
            show_default=False,
        ),
    ] = None,
    repeats: Annotated[int, typer.Option(min=1, help="Runs of each; the shortest time counts.")] = 5,
    norm: NormName = None,
    cost: Annotated[
        str, typer.Option(help="Cost to draw: seconds, steps, evaluations, lcp_solves, lcp_iterations, ...")
    ] = "seconds",
    penalty: Penalties = None,
    t_end: End = None,
    solver: Solver = None,
    out: Table = None,
    plot: Plot = None,
    report: Report = None,
) -> None:
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

    if cost not in COSTS:
        raise InputError(nearest(cost, list(COSTS), "cost"))
    study = measure(
        spec.problem,
        _methods(methods, spec.problem, end, ("event-driven", "exact")),
        steps,
        rtols=RTOLS if rtols is None else numbers(rtols, "--rtols"),
        t_end=end,
        repeats=repeats,
        penalties=[parse_penalty(each) for each in penalty or []],
        lcp_solver=spec.run.solver,
    )
    finish(replace(study, norm=_norm(norm) or study.norm, cost=cost), out, plot, report)


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


def _norm(norm: str | None) -> str | None:
    from lcpimpact.registry import nearest
    from lcpimpact.study.accuracy.norms import NORMS

    if norm is not None and norm not in NORMS:
        raise InputError(nearest(norm, list(NORMS), "norm"))
    return norm
