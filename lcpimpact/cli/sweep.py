"""The command sweep."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import nullcontext
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lcpimpact.cli.finish import TABLES, check_study, finish
from lcpimpact.cli.options import (
    End,
    Method,
    Named,
    Over,
    Plot,
    Report,
    Set,
    Solver,
    Step,
    fixed_and_varied,
    resolve_run,
    values_of,
)
from lcpimpact.errors import InputError
from lcpimpact.files import whole_file

if TYPE_CHECKING:
    from concurrent.futures import ProcessPoolExecutor
    from contextlib import AbstractContextManager

    from lcpimpact.problems.base import Problem
    from lcpimpact.sweeps.samples import Dataset, Samples


def sweep(
    problem: Named,
    over: Over = None,
    set_: Set = None,
    output: Annotated[
        list[str] | None,
        typer.Option(
            help="An output, as R.max, x@2.0, open:1, restitution; repeatable; by default R.max.", show_default=False
        ),
    ] = None,
    samples: Annotated[
        int | None, typer.Option(min=1, help="Number of samples of the ranges, instead of a grid.", show_default=False)
    ] = None,
    rule: Annotated[str, typer.Option(help="latin-hypercube, sobol, halton, random or saltelli.")] = "latin-hypercube",
    seed: Annotated[int, typer.Option(min=0, help="Seed of the samples.")] = 0,
    method: Method = None,
    dt: Step = None,
    t_end: End = None,
    solver: Solver = None,
    workers: Annotated[int, typer.Option(min=1, help="Processes.")] = 1,
    no_certify: Annotated[
        bool,
        typer.Option(
            "--no-certify",
            help="Run sets side by side by all methods of linear steps: certificates of a few sets only are looked at.",
        ),
    ] = False,
    out: Annotated[
        Path | None,
        typer.Option(
            help="File for the results: .csv, .xlsx, .tex or .nc; or folder: .zarr, which resumes.", show_default=False
        ),
    ] = None,
    plot: Plot = None,
    report: Report = None,
) -> None:
    """Run a problem for many values of its parameters: a grid, or samples of ranges.

    The picture is a line of one parameter, a heat map of two, or parallel coordinates of samples; with --rule saltelli it
    shows the Sobol' indices. With --samples a range is LOW:HIGH.

    Example: lcpimpact sweep system-1 --over k_o=3000:5000:50 --over c_o=100:400:50 --output peak_force --out sweep.nc
    """
    to_file = None if out is None or out.suffix == ".zarr" else out
    check_study((problem,), (to_file,), plot, report, (*TABLES, ".nc", ".zarr"))
    fixed, varied = fixed_and_varied(set_, over)
    if not varied:
        raise InputError("--over names no range: write --over k_o=3000:5000:50, or --over k_o=3000,4000")
    swept = {name: values_of(name, span) if samples is None else _range(name, span) for name, span in varied.items()}
    spec = resolve_run(problem, fixed, method, dt, t_end, solver)
    step, end = spec.step_and_end(spec.run)
    outputs = output or ["R.max"]
    _check_table(spec.problem, outputs, to_file)
    from lcpimpact.study.sweep_study import SweepStudy
    from lcpimpact.sweeps.sweep import sweep as run

    parameters: Any = swept if samples is None else _samples(swept, samples, rule, seed)
    with _pool(workers) as pool:
        found = run(
            spec.problem, parameters, spec.run.method, dt=step, t_end=end, lcp_solver=spec.run.solver, outputs=outputs,
            executor=pool, out=out if to_file is None else None, certify=not no_certify, **spec.run.options,
        )  # fmt: skip
    # A store has been written in the course of the sweep.
    writers: dict[str, Callable[[Path], Path | None]] = {".nc": partial(_write_netcdf, found), ".zarr": lambda _: None}
    data = {"problem": spec.problem.name, "method": found.attrs["method"]}
    finish(SweepStudy(found), out, plot, report, writers=writers, data=data)


def _write_netcdf(found: Dataset, path: Path) -> None:
    from lcpimpact.run_files import netcdf

    with whole_file(path) as part:
        netcdf(found).to_netcdf(part, engine="scipy")


def _range(name: str, span: str) -> tuple[float, float, bool]:
    """Return the ends of LOW:HIGH, and whether :log is after it."""
    low, *more = span.split(":")
    try:
        if more[1:] not in ([], ["log"]):
            raise ValueError
        return float(low), float(more[0]), more[1:] == ["log"]
    except (ValueError, IndexError):
        raise InputError(
            f"--over '{name}={span}' with --samples must read NAME=LOW:HIGH, as in --over k_o=3000:5000, or :log after it"
        ) from None


def _samples(swept: dict[str, Any], count: int, rule: str, seed: int) -> Samples:
    from lcpimpact.sweeps.samples import draw_samples

    ranges = {name: (low, high) for name, (low, high, _) in swept.items()}
    return draw_samples(ranges, count, rule, seed=seed, log=[name for name, (*_, log) in swept.items() if log])


def _pool(workers: int) -> AbstractContextManager[ProcessPoolExecutor | None]:
    if workers == 1:
        return nullcontext()
    from concurrent.futures import ProcessPoolExecutor
    from multiprocessing import get_context

    return ProcessPoolExecutor(workers, mp_context=get_context("spawn"))


def _check_table(problem: Problem, outputs: Sequence[str], path: Path | None) -> None:
    """Refuse, before any run, what the file cannot hold."""
    from lcpimpact.quantities import quantity

    for each in (quantity(name, problem) for name in outputs):
        if path is not None and path.suffix in TABLES and each.series:
            raise InputError(f"{each.name}: a table has no whole series; write a .nc or .zarr, or take {each.name}.max")
