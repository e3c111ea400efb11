"""The command sweep."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lcpimpact.cli.finish import write_table
from lcpimpact.cli.options import End, Method, Named, Plot, Solver, Step, files, numbers, resolve_run
from lcpimpact.cli.output import print_answer
from lcpimpact.errors import FailureError, InputError, Status
from lcpimpact.files import check_outputs, whole_file

if TYPE_CHECKING:
    from concurrent.futures import ProcessPoolExecutor
    from contextlib import AbstractContextManager

    import pandas as pd

    from lcpimpact.problems.base import Problem
    from lcpimpact.sweeps.samples import Dataset, Samples


def sweep(
    problem: Named,
    set_: Annotated[
        list[str],
        typer.Option(
            "--set",
            metavar="NAME=VALUES",
            help="A parameter, dt, or option of the method: LOW:HIGH:COUNT, or with :log after it, or values separated by "
            "commas; with --samples LOW:HIGH; one VALUE is the same for all. Repeatable.",
        ),
    ],
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
        typer.Option(help="File for the results: .nc or .csv; or folder: .zarr, which resumes.", show_default=False),
    ] = None,
    plot: Plot = None,
) -> None:
    """Run a problem for many values of its parameters: a grid, or samples of ranges.

    The picture is a line of one parameter, a heat map of two, or parallel coordinates of samples; with --rule saltelli it
    shows the Sobol' indices.

    Example: lcpimpact sweep system-1 --set k_o=3000:5000:50 --set c_o=100:400:50 --output peak_force --out sweep.nc
    """
    from lcpimpact.plotting.style import METADATA as DRAWN_AS

    to_file = None if out is None or out.suffix == ".zarr" else out
    check_outputs([(to_file, (".nc", ".csv", ".zarr")), (plot, DRAWN_AS)], files(problem))
    fixed, swept = _parts(set_, samples is not None)
    spec = resolve_run(problem, fixed, method, dt, t_end, solver)
    step, end = spec.step_and_end(spec.run)
    outputs = output or ["R.max"]
    _check_table(spec.problem, outputs, to_file)
    from lcpimpact.sweeps.sweep import sweep as run

    parameters = swept if samples is None else _samples(swept, samples, rule, seed)
    with _pool(workers) as pool:
        found = run(
            spec.problem, parameters, spec.run.method, dt=step, t_end=end, lcp_solver=spec.run.solver, outputs=outputs,
            executor=pool, out=out if to_file is None else None, certify=not no_certify, **spec.run.options,
        )  # fmt: skip
    lines = _summary(found)
    if to_file is not None:
        lines.append(_write(found, to_file))
    elif out is not None:
        lines.append(f"wrote {out}")
    if plot is not None:
        lines.append(_draw(found, plot))
    print_answer(
        lines,
        lambda: {
            "problem": found.attrs["problem"],
            "method": found.attrs["method"],
            "table": _table(found).to_dict("records"),
            "files": [path for path in (out, plot) if path is not None],
        },
    )


def _parts(set_: Sequence[str], ranges: bool) -> tuple[list[str], dict[str, Any]]:
    """Return the options --set that fix a value, and the values or ranges of the others."""
    fixed, swept = list[str](), dict[str, Any]()
    for text in set_:
        name, equals, span = (part.strip() for part in text.partition("="))
        if not equals or not name or not span:
            raise InputError(f"--set {text!r} must read NAME=VALUES, as in --set k_o=3000:5000:50")
        if ":" not in span and "," not in span:
            fixed.append(text)
            continue
        if name in swept:
            raise InputError(f"--set {name} is given twice: give all its values at once")
        swept[name] = _range(text, span) if ranges else _values(text, span)
    if not swept:
        raise InputError("--set names no range: write --set k_o=3000:5000:50, or --set k_o=3000,4000")
    return fixed, swept


def _values(text: str, span: str, *, max_values: int = 100_000_000) -> Any:
    """Return the values of LOW:HIGH:COUNT, LOW:HIGH:COUNT:log or of a list.

    ``max_values``: maximum number of values of a parameter.
    """
    import numpy as np

    if ":" not in span:
        return numbers(span, "--set")
    low, high, *more = span.split(":")
    try:
        ends, count = (float(low), float(high)), int(more[0])
    except (ValueError, IndexError):
        ends, count = (np.nan, np.nan), 0
    log = more[1:] == ["log"]
    if not np.isfinite(ends).all() or not 1 <= count <= max_values or more[1:] not in ([], ["log"]):
        raise InputError(
            f"--set {text!r} must read NAME=LOW:HIGH:COUNT, as in --set k_o=3000:5000:50, or :log after it"
        )
    if log and min(ends) <= 0.0:
        raise InputError(f"--set {text!r}: a logarithmic scale needs ends above zero")
    return np.geomspace(*ends, count) if log else np.linspace(*ends, count)


def _range(text: str, span: str) -> tuple[float, float, bool]:
    low, *more = span.split(":")
    try:
        if more[1:] not in ([], ["log"]):
            raise ValueError
        return float(low), float(more[0]), more[1:] == ["log"]
    except (ValueError, IndexError):
        raise InputError(
            f"--set {text!r} with --samples must read NAME=LOW:HIGH, as in --set k_o=3000:5000, or :log after it"
        ) from None


def _samples(swept: dict[str, tuple[float, float, bool]], count: int, rule: str, seed: int) -> Samples:
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
        if path is not None and path.suffix == ".csv" and each.series:
            raise InputError(f"{each.name}: a table has no whole series; write a .nc or .zarr, or take {each.name}.max")


def _summary(found: Dataset, *, max_reasons: int = 5) -> list[str]:
    """Return the range of each output and the sets without a result.

    ``max_reasons``: maximum number of reasons listed for sets without a result.
    """
    import numpy as np

    status = np.asarray(found["status"])
    messages = np.asarray(found["message"])
    parameters = found.attrs["parameters"].split(", ")
    shape = " x ".join(str(n) for n in status.shape)
    lines = [f"{found.attrs['problem']} by {found.attrs['method']}: {shape} sets of {', '.join(parameters)}"]
    if (status != Status.SOLVED).all():
        raise FailureError(f"no set has a result: {messages.ravel()[0]}", None)
    for name in found.attrs["outputs"].split(", "):
        values = np.asarray(found[name])
        unit = found[name].attrs.get("units", "")
        known = values[np.isfinite(values)]
        missing = int(np.isnan(values[status == Status.SOLVED]).sum())
        text = f"{known.min():.6g} ... {known.max():.6g} {unit}".rstrip() if len(known) else "none"
        lines.append(f"  {name:<14} {text}" + (f"; {missing} runs have none" if missing else ""))
    failed = status != Status.SOLVED
    reasons, counts = np.unique(messages[failed].astype(str), return_counts=True)
    order = np.argsort(-counts, kind="stable")
    lines += [f"  {counts[k]} without a result: {reasons[k]}" for k in order[:max_reasons]]
    if len(order) > max_reasons:
        lines.append(f"  {counts[order[max_reasons:]].sum()} more without a result: see the message of each")
    return lines


def _write(found: Dataset, path: Path) -> str:
    if path.suffix == ".csv":
        return write_table(_table(found), path)
    from lcpimpact.run_files import netcdf

    with whole_file(path) as part:
        netcdf(found).to_netcdf(part, engine="scipy")
    return f"wrote {path}"


def _table(found: Dataset) -> pd.DataFrame:
    """Return a row for each set: its parameters, outputs, status and message."""
    names = [*found.attrs["parameters"].split(", "), *found.attrs["outputs"].split(", "), "status", "message"]
    return found.to_dataframe().reset_index()[names]


def _draw(found: Dataset, path: Path) -> str:
    from lcpimpact.plotting.style import save
    from lcpimpact.plotting.sweeps import plot_sobol, plot_sweep
    from lcpimpact.sweeps.indices import sobol_indices

    first = found.attrs["outputs"].split(", ")[0]
    if found.attrs["rule"] == "saltelli":
        save(plot_sobol(sobol_indices(found, first), f"{found.attrs['problem']}: {first}"), path)
    else:
        save(plot_sweep(found, first), path)
    return f"drew {path}"
