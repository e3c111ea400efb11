"""The command sensitivity."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import click

from lcpimpact.cli.finish import check_study, finish
from lcpimpact.cli.options import (
    deviations_of,
    deviations_option,
    end_option,
    problem_argument,
    resolve_run,
    set_option,
    study_options,
)
from lcpimpact.cli.output import table_output_options


@click.command()
@problem_argument
@click.option(
    "--wrt",
    metavar="NAME,...",
    required=True,
    help="Parameters: those of the problem, constants as `KelvinVoigt.k` or `2.k`, initial values as `v0.x`.",
)
@click.option(
    "--outputs",
    metavar="NAME,...",
    required=True,
    help="Outputs: R.max, peak_force, instants as open:1, values there as impact:2.speed, samples as x@2.0.",
)
@click.option("--order", type=int, default=1, show_default=True, help="1, or 2 for second derivatives too.")
@click.option(
    "--side",
    type=click.Choice(["left", "right"]),
    help="For derivatives by smaller or larger values only, as where two events coincide.",
)
@click.option(
    "--ranges",
    is_flag=True,
    help="Find the range of each parameter in which the events keep their order, by some 40 runs.",
)
@deviations_option
@set_option
@click.option(
    "--method",
    default="auto",
    show_default=True,
    help="`exact`, `event-driven`, or the first of them that handles the problem: auto.",
)
@end_option
@study_options
@table_output_options
def sensitivity(
    problem: str, wrt: str, outputs: str, order: int, side: Literal["left", "right"] | None, ranges: bool,
    deviations: str | None, set_: tuple[str, ...], method: str, t_end: float | None, out: Path | None,
    plot: Path | None, report: Path | None,
) -> None:  # fmt: skip
    """Differentiate outputs of a run with respect to parameters, across impacts, contacts, friction and relays.

    With --deviations the table, picture and report are those of the uncertainty of the outputs.

    Example: lcpimpact sensitivity system-1 --wrt k_o,c_o --outputs R.max,open:1,x@2.0 --plot tornado.pdf
    """
    check_study((problem,), (out,), plot, report)
    sizes = deviations_of(deviations, "k_o=10,c_o=5")
    spec = resolve_run(problem, set_, "exact" if method == "auto" else method, None, t_end)
    from lcpimpact.simulation import make_integrator
    from lcpimpact.study.sensitivity import sensitivity as differentiate

    chosen = method if method == "auto" else make_integrator(method, dict(spec.run.options))
    found = differentiate(
        spec.problem,
        _names(wrt),
        _names(outputs),
        method=chosen,
        t_end=spec.run.t_end,
        order=order,
        side=side,
        ranges=ranges,
    )
    if sizes is None:
        finish(found, out, plot, report)
    else:
        finish(found.uncertainty(sizes), out, plot, report)


def _names(text: str) -> list[str]:
    """Return the names of a list NAME,..."""
    return [each.strip() for each in text.split(",") if each.strip()]
