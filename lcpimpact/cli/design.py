"""The commands design and fit."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click
from click.exceptions import Exit

from lcpimpact.cli.finish import TABLES, check_study, finish
from lcpimpact.cli.options import (
    PATH,
    Count,
    deviations_of,
    deviations_option,
    number_of,
    pairs_of,
    plot_option,
    problem_argument,
    report_option,
    resolve_run,
    run_options,
)
from lcpimpact.cli.output import table_output_options
from lcpimpact.errors import InputError

if TYPE_CHECKING:
    from lcpimpact.study.design.fit import Target

SCHEME = ".toml"

out_option = click.option("--out", type=PATH, help="File for the table, .csv, .xlsx or .tex, or for the scheme, .toml.")


@click.command()
@click.argument(
    "law",
    help="kelvin-voigt, kelvin-voigt-tension, hard-stop, maxwell, hertz, hunt-crossley, tsuji or kuwabara-kono.",
)
@click.option("--m", type=float, required=True, help="Mass in kg.")
@click.option("--v0", type=float, required=True, help="Impact speed in m/s.")
@click.option("--g", default=0.0, help="Gravity in m/s².")
@click.option("--e", type=float, help="Required restitution.")
@click.option("--contact-time", type=float, help="Required contact time in s.")
@click.option("--peak-force", type=float, help="Required peak force in N.")
@click.option("--deflection", type=float, help="Required peak deflection in m.")
@click.option("--k", type=float, help="Stiffness in N/m, or N/mⁿ.")
@click.option("--c", type=float, help="Damping in N s/m, of tsuji in N s/m^((n+1)/2).")
@click.option("--b", type=float, help="Loss of hunt-crossley in s/m.")
@click.option("--a", "A", type=float, help="Time of dissipation of kuwabara-kono, A in s.")
@click.option("--n", type=float, help="Exponent of a power law; 3/2 by default.")
@deviations_option
@out_option
@plot_option
@report_option
@table_output_options
def design(
    law: str, m: float, v0: float, g: float, e: float | None, contact_time: float | None, peak_force: float | None,
    deflection: float | None, k: float | None, c: float | None, b: float | None, A: float | None, n: float | None,
    deviations: str | None, out: Path | None, plot: Path | None, report: Path | None,
) -> None:  # fmt: skip
    """Size a block for a required impact, or compute the impact of a given block: any two quantities give all others.

    A file ending in .toml receives the impact as a scheme. With --deviations, as m=0.01,k=50, the table, picture and
    report are those of the uncertainty of the outputs.

    Example: lcpimpact design kelvin-voigt --m 1 --v0 2 --e 0.5 --contact-time 0.01 --plot impact.pdf
    """
    check_study((), (out,), plot, report, (*TABLES, SCHEME))
    sizes = deviations_of(deviations, "m=0.01,k=50")
    from lcpimpact.schemefile import Run, write_scheme_file
    from lcpimpact.study.design.sizing import LAWS
    from lcpimpact.study.design.sizing import design as size

    wanted = {
        "e": e, "contact_time": contact_time, "peak_force": peak_force, "deflection": deflection, "k": k, "c": c, "b": b,
        "A": A,
    }  # fmt: skip
    found = size(law, m=m, v0=v0, g=g, n=n, **wanted)
    problem = found.problem()
    run = Run(LAWS[law].method, dt=problem.t_end / 1000, t_end=problem.t_end)
    shown = found if sizes is None else found.uncertainty(sizes)
    finish(shown, out, plot, report, writers={SCHEME: lambda path: write_scheme_file(problem, path, run)})


@click.command()
@problem_argument
@click.option(
    "--free",
    metavar="NAME[=START],...",
    required=True,
    help="Quantities to fit: parameters, constants as `KelvinVoigt.k` or `2.k`, initial values as `v0.x`.",
)
@click.option(
    "--to",
    type=PATH,
    help="File of the measurement, .csv or .xlsx: a header, as Zeit [s];Kraft [kN], and numbers.",
)
@click.option(
    "--target",
    "targets",
    metavar="OUTPUT=VALUE[:SIGMA]",
    multiple=True,
    help="Wanted output, as open:1=0.52 or R.max=800:5 with its standard deviation; repeatable.",
)
@click.option(
    "--column",
    metavar="SERIES[=COLUMN],...",
    help="Series to fit to, as R or x, and their columns in the file, as R=Kraft; by default all columns that are named "
    "as a series.",
)
@click.option(
    "--time",
    metavar="COLUMN",
    help="Column of the times; by default t, time or Zeit, or the only one with a unit of time.",
)
@click.option(
    "--unit",
    "units",
    metavar="COLUMN=UNIT",
    multiple=True,
    help="Unit of a column, as Zeit=ms or Kraft=kN, in place of that in the header; repeatable.",
)
@click.option("--decimal", metavar="MARK", help="Decimal mark of the file, . or ,; by default as its numbers show.")
@click.option(
    "--bound",
    "bounds",
    metavar="NAME=LOW:HIGH",
    multiple=True,
    help="Lower and upper bound of a parameter; repeatable.",
)
@click.option("--sigma", type=float, help="Standard deviation of the noise, if known.")
@click.option(
    "--sampling", default="point", help="point: compare at the samples; mean: average over the cell around each."
)
@click.option("--loss", default="linear", help="linear, or soft_l1, huber, cauchy, arctan against outliers.")
@click.option("--starts", type=Count(min=1), default=1, help="Number of searches, the first from the start values.")
@click.option("--seed", default=0, help="Seed of the random starts.")
@click.option("--level", default=0.95, help="Level of the confidence intervals.")
@run_options
@out_option
@plot_option
@report_option
@table_output_options
def fit(
    problem: str, free: str, to: Path | None, targets: tuple[str, ...], column: str | None, time: str | None,
    units: tuple[str, ...], decimal: str | None, bounds: tuple[str, ...], sigma: float | None, sampling: str,
    loss: str, starts: int, seed: int, level: float, set_: tuple[str, ...], method: str | None, dt: float | None,
    t_end: float | None, solver: str | None, out: Path | None, plot: Path | None, report: Path | None,
) -> None:  # fmt: skip
    """Fit parameters of a problem to a measured curve, to wanted outputs, or to both, with confidence intervals.

    The default method is exact; a file ending in .toml receives the fitted scheme. The exit code is 1 if no search
    converged.

    Example: lcpimpact fit system-1 --free k_o,c_o --to force.csv --column R=Kraft --plot fit.pdf
    """
    check_study([problem] if to is None else [problem, to], (out,), plot, report, (*TABLES, SCHEME))
    spec = resolve_run(problem, set_, method or "exact", dt, t_end, solver)
    from lcpimpact.problems.parameters import value_at
    from lcpimpact.schemefile import write_scheme_file
    from lcpimpact.study.design.fit import fit as search

    pairs = pairs_of(free, "--free", "NAME or NAME=START", "k=1e3,c")
    given = {
        name: number_of(start, "--free") if start else value_at(spec.problem, name) for name, start in pairs.items()
    }
    # The [run] table of the file does not apply.
    step, end = (dt, t_end) if method is None else (spec.run.dt, spec.run.t_end)
    found = search(
        spec.problem, given, to, column=_columns(column), time=time, units=dict(map(_unit, units)),
        decimal=decimal, outputs=dict(map(_target, targets)), sigma=sigma,
        bounds=dict(map(_bound, bounds)), sampling=sampling, loss=loss, method=spec.run.method, dt=step, t_end=end,
        starts=starts, seed=seed, level=level, progress=starts > 1,
        lcp_solver=spec.run.solver, **spec.run.options,
    )  # fmt: skip
    finish(found, out, plot, report, writers={SCHEME: lambda path: write_scheme_file(found.problem, path, spec.run)})
    raise Exit(0 if found.success else 1)


def _columns(text: str | None) -> dict[str, str] | None:
    """Return the columns by series of SERIES[=COLUMN],..."""
    if text is None:
        return None
    pairs = pairs_of(text, "--column", "SERIES or SERIES=COLUMN", "R=Kraft,x")
    return {name: column or name for name, column in pairs.items()}


def _unit(text: str) -> tuple[str, str]:
    """Return the column and the unit of COLUMN=UNIT."""
    name, unit = text.rpartition("=")[::2]
    if not name.strip() or not unit.strip():
        raise InputError(f"--unit {text!r} must read COLUMN=UNIT, as in --unit Kraft=kN")
    return name.strip(), unit.strip()


def _target(text: str) -> tuple[str, Target]:
    """Return the name and the target of OUTPUT=VALUE[:SIGMA]."""
    from lcpimpact.study.design.fit import Target

    name, equals, given = text.rpartition("=")
    value, colon, sigma = given.partition(":")
    if not equals or not name.strip() or (colon and not sigma.strip()):
        raise InputError(f"--target {text!r} must read OUTPUT=VALUE or OUTPUT=VALUE:SIGMA, as in --target open:1=0.52")
    name = name.strip()
    return name, Target(name, number_of(value, "--target"), number_of(sigma, "--target") if colon else None)


def _bound(text: str) -> tuple[str, tuple[float, float]]:
    name, equals, ends = text.partition("=")
    low, colon, high = ends.partition(":")
    if not equals or not colon or not name.strip():
        raise InputError(f"--bound {text!r} must read NAME=LOW:HIGH, as in --bound k=1e3:1e5")
    return name.strip(), (number_of(low or "-inf", "--bound"), number_of(high or "inf", "--bound"))
