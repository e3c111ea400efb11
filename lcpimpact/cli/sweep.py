"""The command sweep."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import nullcontext
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from lcpimpact.cli.finish import TABLES, check_study, finish
from lcpimpact.cli.options import (
    PATH,
    Count,
    fixed_and_varied,
    over_option,
    plot_option,
    problem_argument,
    report_option,
    resolve_run,
    run_options,
    values_of,
)
from lcpimpact.cli.output import table_output_options
from lcpimpact.errors import InputError
from lcpimpact.files import whole_file

if TYPE_CHECKING:
    from concurrent.futures import ProcessPoolExecutor
    from contextlib import AbstractContextManager

    from lcpimpact.problems.base import Problem
    from lcpimpact.sweeps.samples import Dataset, Samples


@click.command()
@problem_argument
@over_option
@run_options
@click.option(
    "--output",
    multiple=True,
    default=["R.max"],
    help="An output, as R.max, x@2.0, open:1, restitution; repeatable.",
)
@click.option("--samples", type=Count(min=1), help="Number of samples of the ranges, instead of a grid.")
@click.option("--rule", default="latin-hypercube", help="latin-hypercube, sobol, halton, random or saltelli.")
@click.option("--seed", type=Count(min=0), default=0, help="Seed of the samples.")
@click.option("--workers", type=Count(min=1), default=1, help="Processes.")
@click.option(
    "--no-certify",
    is_flag=True,
    help="Run sets side by side by all methods of linear steps: certificates of a few sets only are looked at.",
)
@click.option(
    "--out", type=PATH, help="File for the results: .csv, .xlsx, .tex or .nc; or folder: .zarr, which resumes."
)
@plot_option
@report_option
@table_output_options
def sweep(
    problem: str, over: tuple[str, ...], set_: tuple[str, ...], method: str | None, dt: float | None,
    t_end: float | None, solver: str | None, output: tuple[str, ...], samples: int | None, rule: str, seed: int,
    workers: int, no_certify: bool, out: Path | None, plot: Path | None, report: Path | None,
) -> None:  # fmt: skip
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
    _check_table(spec.problem, output, to_file)
    from lcpimpact.study.sweep_study import SweepStudy
    from lcpimpact.sweeps.sweep import sweep as run

    parameters: Any = swept if samples is None else _samples(swept, samples, rule, seed)
    with _pool(workers) as pool:
        found = run(
            spec.problem, parameters, spec.run.method, dt=step, t_end=end, lcp_solver=spec.run.solver, outputs=output,
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
