"""The commands simulate, draw, animate and export."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from lcpimpact.cli.options import PATH, files, problem_argument, resolve_run, run_options, set_option, stem, up_option
from lcpimpact.cli.output import DECIMAL, output_options, print_answer, table_output_options
from lcpimpact.errors import LcpImpactError
from lcpimpact.files import Json, check_outputs

if TYPE_CHECKING:
    from lcpimpact.problems.facts import Fact
    from lcpimpact.trajectory import Trajectory


@click.command()
@problem_argument
@run_options
@click.option("--out", type=PATH, help="File for the run: .csv, .xlsx, .npz, .nc, .parquet or .mat.")
@click.option("--plot", type=PATH, help="File for a picture of the run: .png, .svg or .pdf.")
@up_option
@click.option("--no-error", is_flag=True, help="Do not estimate the error of the run.")
@table_output_options
def simulate(
    problem: str, set_: tuple[str, ...], method: str | None, dt: float | None, t_end: float | None,
    solver: str | None, out: Path | None, plot: Path | None, up: bool, no_error: bool,
) -> None:  # fmt: skip
    """Run one problem by one method, print the results, and write them to a file if requested.

    Options override the run settings of a scheme file; with another method, the options and the solver of the file are
    ignored.

    Example: lcpimpact simulate system-1 --set c_o=300 --set theta=1 --dt 1e-3 --out run.csv --plot run.png
    """
    from lcpimpact.plotting.style import METADATA as DRAWN_AS
    from lcpimpact.run_files import WRITERS, check_format, companions

    beside = () if out is None else companions(out)
    check_outputs(((out, WRITERS), *((each, (each.suffix,)) for each in beside), (plot, DRAWN_AS)), files(problem))
    if out is not None:
        check_format(out)
    trajectory = resolve_run(problem, set_, method, dt, t_end, solver).simulate(error=not no_error)
    lines = [str(trajectory), *_fact_table(trajectory)]
    if out is not None:
        decimal = DECIMAL.get() if out.suffix == ".csv" else "."
        lines += [f"  wrote       {each}" for each in (trajectory.save(out, decimal), *beside)]
    if plot is not None:
        trajectory.plot(plot, up=up)
        lines.append(f"  drew        {plot}")
    print_answer(lines, lambda: _answer(trajectory, out, *beside, plot))


@click.command()
@problem_argument
@set_option
@click.option("--out", type=PATH, help="File for the drawing: .svg, .png or .pdf; by default NAME.svg here.")
@output_options
def draw(problem: str, set_: tuple[str, ...], out: Path | None) -> None:
    """Draw the scheme of a problem.

    Example: lcpimpact draw my.toml --out my.png
    """
    from lcpimpact.plotting.schematic import draw_scheme
    from lcpimpact.plotting.style import METADATA as DRAWN_AS
    from lcpimpact.plotting.style import save

    path = Path(f"{stem(problem)}.svg") if out is None else out
    check_outputs([(path, DRAWN_AS)], files(problem))
    save(draw_scheme(resolve_run(problem, set_).problem.scheme), path)
    print_answer([f"drew {path}"], lambda: {"files": [path]})


@click.command()
@problem_argument
@click.option("--out", type=PATH, required=True, help="File for the animation: .gif, .mp4 (needs ffmpeg) or .html.")
@run_options
@click.option("--seconds", type=float, help="Duration of the animation in s.")
@click.option("--fps", type=int, help="Frames per second.")
@up_option
@output_options
def animate(
    problem: str, set_: tuple[str, ...], method: str | None, dt: float | None, t_end: float | None,
    solver: str | None, out: Path, seconds: float | None, fps: int | None, up: bool,
) -> None:  # fmt: skip
    """Run one problem as simulate does, and animate the scheme with its curves beside it.

    Example: lcpimpact animate system-3 --out system-3.gif
    """
    from lcpimpact.plotting.animation import FORMATS

    check_outputs([(out, FORMATS)], files(problem))
    trajectory = resolve_run(problem, set_, method, dt, t_end, solver).simulate()
    options = {"seconds": seconds, "fps": fps}
    trajectory.animate(out, up=up, **{name: value for name, value in options.items() if value is not None})
    print_answer([str(trajectory), f"  drew        {out}"], lambda: _answer(trajectory, out))


@click.command()
@problem_argument
@click.option("--out", type=PATH, required=True, help="File for the scheme, ending in .toml.")
@run_options
@output_options
def export(
    problem: str, set_: tuple[str, ...], method: str | None, dt: float | None, t_end: float | None,
    solver: str | None, out: Path,
) -> None:  # fmt: skip
    """Write a problem to an editable scheme file, element by element, with the run settings given as options.

    Example: lcpimpact export system-3 --set c=60 --out my.toml
    """
    from lcpimpact.schemefile import ENDING, write_scheme_file

    check_outputs([(out, (ENDING,))], files(problem))
    spec = resolve_run(problem, set_, method, dt, t_end, solver)
    written = write_scheme_file(spec.problem, out, spec.run)
    print_answer([f"wrote {written}"], lambda: {"files": [written]})


def _answer(trajectory: Trajectory, *files: Path | None) -> dict[str, Json]:
    """Return the data of a run that --json prints."""
    return {
        "problem": trajectory.problem.name,
        "method": trajectory.method,
        "status": trajectory.status,
        "success": trajectory.success,
        "message": trajectory.message,
        "parameters": trajectory.problem.parameters,
        "steps": trajectory.stats.steps,
        "t_end": trajectory.t[-1],
        "seconds": trajectory.stats.seconds,
        "summary": trajectory.summary(),
        "error": _error(trajectory),
        "facts": {
            fact.symbol: {"value": fact.value, "unit": fact.unit, "measured": _measured(fact, trajectory)}
            for fact in trajectory.problem.facts
        },
        "files": [each for each in files if each is not None],
    }


def _error(trajectory: Trajectory) -> dict[str, Json] | None:
    """Return the estimated error of a run, where it is known or quick."""
    error = trajectory.quick_error() if trajectory.estimates else None
    return None if error is None else error.to_dict() | {"coarse": error.coarse}


def _measured(fact: Fact, trajectory: Trajectory) -> float | None:
    """Return the value of a closed-form quantity in a run, or None if it is not measurable."""
    try:
        return fact.measure(trajectory)
    except (LcpImpactError, ArithmeticError, LookupError, ValueError):
        return None


def _relative_error(fact: Fact, measured: float, *, fact_zero_rtol: float = 1e-12) -> str:
    """Return |measured - value|/|value|, and "-" of a value that is zero but for rounding.

    ``fact_zero_rtol``: size of a value, relative to the scale of its errors, below which it is zero.
    """
    zero = abs(fact.value) <= fact_zero_rtol * fact.scale
    return "-" if zero else f"{abs(measured - fact.value) / abs(fact.value):.1e}"


def _fact_table(trajectory: Trajectory) -> list[str]:
    """Return the lines of a table of the closed-form facts and their measured values; '-' if not measurable."""
    rows = [("", "closed form", "measured", "relative error", "")]
    for fact in trajectory.problem.facts:
        value = _measured(fact, trajectory)
        measured, error = ("-", "-") if value is None else (f"{value:.8g}", _relative_error(fact, value))
        rows.append((fact.symbol, f"{fact.value:.8g} {fact.unit}".strip(), measured, error, fact.what))
    if len(rows) == 1:
        return []
    widths = [max(len(row[column]) for row in rows) for column in range(4)]
    return ["", *("  " + "  ".join(map(str.ljust, row[:4], widths)) + f"  {row[4]}" for row in rows)]
