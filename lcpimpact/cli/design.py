"""The commands design and fit."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from lcpimpact.cli.finish import TABLES, check_study, finish
from lcpimpact.cli.options import End, Method, Named, Plot, Report, Set, Solver, Step, resolve_run
from lcpimpact.errors import InputError

SCHEME = ".toml"

Out = Annotated[
    Path | None,
    typer.Option(
        "--out", help="File for the table, .csv, .xlsx or .tex, or for the scheme, .toml.", show_default=False
    ),
]


def design(
    law: Annotated[str, typer.Argument(help="kelvin-voigt, kelvin-voigt-tension, maxwell, hertz or hunt-crossley.")],
    m: Annotated[float, typer.Option("--m", help="Mass in kg.", show_default=False)],
    v0: Annotated[float, typer.Option("--v0", help="Impact speed in m/s.", show_default=False)],
    g: Annotated[float, typer.Option("--g", help="Gravity in m/s².")] = 0.0,
    e: Annotated[float | None, typer.Option("--e", help="Required restitution.", show_default=False)] = None,
    contact_time: Annotated[float | None, typer.Option(help="Required contact time in s.", show_default=False)] = None,
    peak_force: Annotated[float | None, typer.Option(help="Required peak force in N.", show_default=False)] = None,
    deflection: Annotated[float | None, typer.Option(help="Required peak deflection in m.", show_default=False)] = None,
    k: Annotated[float | None, typer.Option("--k", help="Stiffness in N/m, or N/mⁿ.", show_default=False)] = None,
    c: Annotated[float | None, typer.Option("--c", help="Damping in N s/m.", show_default=False)] = None,
    b: Annotated[float | None, typer.Option("--b", help="Loss of hunt-crossley in s/m.", show_default=False)] = None,
    n: Annotated[
        float | None, typer.Option("--n", help="Exponent of a power law; 3/2 by default.", show_default=False)
    ] = None,
    out: Out = None,
    plot: Plot = None,
    report: Report = None,
) -> None:
    """Size a block for a required impact, or compute the impact of a given block: any two quantities give all others.

    A file ending in .toml receives the impact as a scheme.

    Example: lcpimpact design kelvin-voigt --m 1 --v0 2 --e 0.5 --contact-time 0.01 --plot impact.pdf
    """
    check_study((), (out,), plot, report, (*TABLES, SCHEME))
    from lcpimpact.schemefile import Run, write_scheme_file
    from lcpimpact.study.design.sizing import LAWS
    from lcpimpact.study.design.sizing import design as size

    wanted = {
        "e": e, "contact_time": contact_time, "peak_force": peak_force, "deflection": deflection, "k": k, "c": c, "b": b
    }  # fmt: skip
    found = size(law, m=m, v0=v0, g=g, n=n, **wanted)
    problem = found.problem()
    run = Run(LAWS[law].method, dt=problem.t_end / 1000, t_end=problem.t_end)
    finish(found, out, plot, report, writers={SCHEME: lambda path: write_scheme_file(problem, path, run)})


def fit(
    problem: Named,
    free: Annotated[
        str,
        typer.Option(
            metavar="NAME[=START],...",
            help="Quantities to fit: parameters, constants as [bold]KelvinVoigt.k[/bold] or [bold]2.k[/bold], "
            "initial values as [bold]v0.x[/bold].",
            show_default=False,
        ),
    ],
    to: Annotated[
        Path,
        typer.Option(
            "--to",
            help="File of the measurement, .csv or .xlsx: a header, as Zeit [s];Kraft [kN], and numbers.",
            show_default=False,
        ),
    ],
    column: Annotated[
        str | None,
        typer.Option(
            metavar="SERIES[=COLUMN],...",
            help="Series to fit to, as R or x, and their columns in the file, as R=Kraft; by default all columns that are "
            "named as a series.",
            show_default=False,
        ),
    ] = None,
    time: Annotated[
        str | None,
        typer.Option(
            metavar="COLUMN",
            help="Column of the times; by default t, time or Zeit, or the only one with a unit of time.",
            show_default=False,
        ),
    ] = None,
    units: Annotated[
        list[str] | None,
        typer.Option(
            "--unit",
            metavar="COLUMN=UNIT",
            help="Unit of a column, as Zeit=ms or Kraft=kN, in place of that in the header; repeatable.",
        ),
    ] = None,
    decimal: Annotated[
        str | None,
        typer.Option(
            metavar="MARK", help="Decimal mark of the file, . or ,; by default as its numbers show.", show_default=False
        ),
    ] = None,
    set_: Set = None,
    bounds: Annotated[
        list[str] | None,
        typer.Option("--bound", metavar="NAME=LOW:HIGH", help="Lower and upper bound of a parameter; repeatable."),
    ] = None,
    sigma: Annotated[
        float | None, typer.Option(help="Standard deviation of the noise, if known.", show_default=False)
    ] = None,
    sampling: Annotated[
        str, typer.Option(help="point: compare at the samples; mean: average over the cell around each.")
    ] = "point",
    loss: Annotated[str, typer.Option(help="linear, or soft_l1, huber, cauchy, arctan against outliers.")] = "linear",
    starts: Annotated[int, typer.Option(min=1, help="Number of searches, the first from the start values.")] = 1,
    seed: Annotated[int, typer.Option(help="Seed of the random starts.")] = 0,
    level: Annotated[float, typer.Option(help="Level of the confidence intervals.")] = 0.95,
    method: Method = None,
    dt: Step = None,
    t_end: End = None,
    solver: Solver = None,
    out: Out = None,
    plot: Plot = None,
    report: Report = None,
) -> None:
    """Fit parameters of a problem to a measured curve, with confidence intervals.

    The default method is exact; a file ending in .toml receives the fitted scheme. The exit code is 1 if no search
    converged.

    Example: lcpimpact fit system-1 --free k_o,c_o --to force.csv --column R=Kraft --plot fit.pdf
    """
    check_study((problem, to), (out,), plot, report, (*TABLES, SCHEME))
    spec = resolve_run(problem, set_, method or "exact", dt, t_end, solver)
    from lcpimpact.problems.parameters import value_at
    from lcpimpact.schemefile import write_scheme_file
    from lcpimpact.study.design.fit import fit as search

    pairs = _pairs(free, "--free", "NAME or NAME=START", "k=1e3,c")
    given = {name: _number(start, "--free") if start else value_at(spec.problem, name) for name, start in pairs.items()}
    # The [run] table of the file does not apply.
    step, end = (dt, t_end) if method is None else (spec.run.dt, spec.run.t_end)
    found = search(
        spec.problem, given, to, column=_columns(column), time=time, units=dict(map(_unit, units or [])),
        decimal=decimal, sigma=sigma,
        bounds=dict(map(_bound, bounds or [])), sampling=sampling, loss=loss, method=spec.run.method, dt=step, t_end=end,
        starts=starts, seed=seed, level=level, progress=starts > 1,
        lcp_solver=spec.run.solver, **spec.run.options,
    )  # fmt: skip
    finish(found, out, plot, report, writers={SCHEME: lambda path: write_scheme_file(found.problem, path, spec.run)})
    raise typer.Exit(0 if found.success else 1)


def _pairs(text: str, option: str, form: str, example: str) -> dict[str, str]:
    """Return the names and values of NAME[=VALUE],..., "" for a name without one."""
    found = dict[str, str]()
    for part in text.split(","):
        name, value = part.partition("=")[::2]
        if not name.strip() or ("=" in part and not value.strip()):
            raise InputError(f"{option} {text!r} must read {form}, separated by commas, as in {option} {example}")
        if name.strip() in found:
            raise InputError(f"{option} {text!r} names {name.strip()} twice: name it once")
        found[name.strip()] = value.strip()
    return found


def _columns(text: str | None) -> dict[str, str] | None:
    """Return the columns by series of SERIES[=COLUMN],..."""
    if text is None:
        return None
    pairs = _pairs(text, "--column", "SERIES or SERIES=COLUMN", "R=Kraft,x")
    return {name: column or name for name, column in pairs.items()}


def _unit(text: str) -> tuple[str, str]:
    """Return the column and the unit of COLUMN=UNIT."""
    name, unit = text.rpartition("=")[::2]
    if not name.strip() or not unit.strip():
        raise InputError(f"--unit {text!r} must read COLUMN=UNIT, as in --unit Kraft=kN")
    return name.strip(), unit.strip()


def _bound(text: str) -> tuple[str, tuple[float, float]]:
    name, equals, ends = text.partition("=")
    low, colon, high = ends.partition(":")
    if not equals or not colon or not name.strip():
        raise InputError(f"--bound {text!r} must read NAME=LOW:HIGH, as in --bound k=1e3:1e5")
    return name.strip(), (_number(low or "-inf", "--bound"), _number(high or "inf", "--bound"))


def _number(text: str, option: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise InputError(f"{option}: {text!r} is not a number: write it as in 1e3") from None
