"""The commands about one problem, of the registry or of a scheme file: simulate, draw, animate, export."""

from __future__ import annotations

import inspect
from dataclasses import fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console

from lcpimpact.errors import InputError, LcpImpactError
from lcpimpact.files import check_output
from lcpimpact.integrators import METHODS
from lcpimpact.problems import PROBLEMS
from lcpimpact.registry import nearest

if TYPE_CHECKING:
    from lcpimpact.schemefile import SchemeFile
    from lcpimpact.trajectory import Trajectory

Named = Annotated[
    str, typer.Argument(help="A name of [bold]lcpimpact list problems[/bold], or a file ending in .toml.")
]
Set = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="NAME=VALUE", help="A parameter of the problem or an option of the method; repeat."),
]
Method = Annotated[
    str | None,
    typer.Option(
        help="A name of [bold]lcpimpact list methods[/bold]; by default the file's, or moreau-jean.", show_default=False
    ),
]
Step = Annotated[
    float | None,
    typer.Option(
        help="Step in s; by default the file's, or 1e-3, or a thousandth of the end if that is less.",
        show_default=False,
    ),
]
End = Annotated[
    float | None,
    typer.Option(help="End in s; by default the file's, or what the problem suggests.", show_default=False),
]
Solver = Annotated[
    str | None,
    typer.Option(
        help="A name of [bold]lcpimpact list solvers[/bold]; by default the file's, or auto.", show_default=False
    ),
]


def simulate(
    problem: Named,
    set_: Set = None,
    method: Method = None,
    dt: Step = None,
    t_end: End = None,
    solver: Solver = None,
    out: Annotated[Path | None, typer.Option(help="File for the run: .csv, .npz or .nc.")] = None,
    plot: Annotated[Path | None, typer.Option(help="File for a picture of the run: .png, .svg or .pdf.")] = None,
) -> None:
    """Run one problem by one method, say what came out, and write it to a file if asked.

    What a scheme file says of the run holds where no option says otherwise; another method takes neither the options nor
    the solver of the file.

    Example: lcpimpact simulate system-1 --set c_o=300 --set theta=1 --dt 1e-3 --out run.csv --plot run.png
    """
    from lcpimpact.plotting.style import METADATA as DRAWN_AS
    from lcpimpact.trajectory import SAVED_AS

    if out is not None:
        check_output(out, SAVED_AS)
    if plot is not None:
        check_output(plot, DRAWN_AS)
    trajectory = _chosen(problem, set_, method, dt, t_end, solver).simulate()
    lines = [str(trajectory), *_facts(trajectory)]
    if out is not None:
        lines.append(f"  wrote       {trajectory.save(out)}")
    if plot is not None:
        trajectory.plot(plot)
        lines.append(f"  drew        {plot}")
    _say(*lines)


def draw(
    problem: Named,
    set_: Set = None,
    out: Annotated[
        Path | None,
        typer.Option(help="File for the drawing: .svg, .png or .pdf; by default NAME.svg here.", show_default=False),
    ] = None,
) -> None:
    """Draw the scheme of a problem.

    Example: lcpimpact draw my.toml --out my.png
    """
    from lcpimpact.plotting.schematic import draw_scheme
    from lcpimpact.plotting.style import METADATA as DRAWN_AS
    from lcpimpact.plotting.style import save

    path = Path(f"{_stem(problem)}.svg") if out is None else out
    check_output(path, DRAWN_AS)
    save(draw_scheme(_chosen(problem, set_).problem.scheme), path)
    _say(f"drew {path}")


def animate(
    problem: Named,
    out: Annotated[Path, typer.Option(help="File for the animation: .gif, .mp4 (needs ffmpeg) or .html.")],
    set_: Set = None,
    method: Method = None,
    dt: Step = None,
    t_end: End = None,
    solver: Solver = None,
    seconds: Annotated[float | None, typer.Option(help="How long the animation lasts.", show_default=False)] = None,
    fps: Annotated[int | None, typer.Option(help="Pictures a second.", show_default=False)] = None,
) -> None:
    """Run one problem as simulate does, and show the scheme in motion with the force beside it.

    Example: lcpimpact animate system-3 --out system-3.gif
    """
    from lcpimpact.plotting.animation import FORMATS

    check_output(out, FORMATS)
    trajectory = _chosen(problem, set_, method, dt, t_end, solver).simulate()
    options = {"seconds": seconds, "fps": fps}
    trajectory.animate(out, **{name: value for name, value in options.items() if value is not None})
    _say(str(trajectory), f"  drew        {out}")


def export(
    problem: Named,
    out: Annotated[Path, typer.Option(help="File for the scheme, ending in .toml.")],
    set_: Set = None,
    method: Method = None,
    dt: Step = None,
    t_end: End = None,
    solver: Solver = None,
) -> None:
    """Write a problem to a scheme file, element by element, to change it there; and how to run it, if options say so.

    Example: lcpimpact export system-3 --set c=60 --out my.toml
    """
    from lcpimpact.schemefile import write_scheme_file

    chosen = _chosen(problem, set_, method, dt, t_end, solver)
    _say(f"wrote {write_scheme_file(chosen.problem, out, chosen.run)}")


def _chosen(
    name: str,
    set_: list[str] | None,
    method: str | None = None,
    dt: float | None = None,
    t_end: float | None = None,
    solver: str | None = None,
) -> SchemeFile:
    """Return the problem and the run that a file or a name and the options of a command tell together."""
    from lcpimpact.schemefile import read_scheme_file, registered

    stated = read_scheme_file(name) if _is_file(name) else registered(name, {})
    run = stated.run.changed(method=method)
    parameters = [] if stated.registered is None else list(inspect.signature(PROBLEMS[stated.registered]).parameters)
    options = [each.name for each in fields(METHODS[run.method])]  # type: ignore[arg-type]
    given: dict[str, Any] = {}
    for text in set_ or []:
        key, value = _assignment(text)
        if key not in parameters and key not in options:
            whose = f"parameter of {stated.registered} or " if stated.registered else ""
            why = "" if stated.registered else "; the constants of a scheme file are changed in the file itself"
            raise InputError(nearest(key, [*parameters, *options], f"{whose}option of {run.method}") + why)
        given[key] = value
    changed = stated.with_parameters(**{key: value for key, value in given.items() if key in parameters})
    of_method = {key: value for key, value in given.items() if key not in parameters}
    return replace(changed, run=run.changed(dt=dt, t_end=t_end, solver=solver, **of_method))


def _is_file(name: str) -> bool:
    return Path(name).suffix.lower() == ".toml"


def _stem(name: str) -> str:
    return Path(name).stem if _is_file(name) else name


def _assignment(text: str) -> tuple[str, Any]:
    """Return the name and value of NAME=VALUE: a whole number, another number, true or false, or a word."""
    name, equals, value = text.partition("=")
    if not equals or not name or not value:
        raise InputError(f"--set {text!r} must read NAME=VALUE, as in --set c_o=300")
    for kind in (int, float):
        try:
            return name.strip(), kind(value)
        except ValueError:
            continue
    truth = {"true": True, "false": False}
    return name.strip(), truth.get(value.strip().lower(), value.strip())


def _facts(trajectory: Trajectory) -> list[str]:
    """Return a table of what is known of the problem in closed form, and what the run shows; '-' where it does not."""
    rows = [("", "closed form", "measured", "relative error", "")]
    for fact in trajectory.problem.facts:
        try:
            measured, error = f"{fact.measure(trajectory):.8g}", f"{fact.error(trajectory):.1e}"
        except (LcpImpactError, ArithmeticError, LookupError, ValueError):
            measured, error = "-", "-"
        rows.append((fact.symbol, f"{fact.value:.8g} {fact.unit}".strip(), measured, error, fact.what))
    if len(rows) == 1:
        return []
    widths = [max(len(row[column]) for row in rows) for column in range(4)]
    return ["", *("  " + "  ".join(map(str.ljust, row[:4], widths)) + f"  {row[4]}" for row in rows)]


def _say(*lines: str) -> None:
    Console(highlight=False, soft_wrap=True, markup=False, emoji=False).print("\n".join(lines))
