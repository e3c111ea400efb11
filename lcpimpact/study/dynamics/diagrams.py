"""Bifurcation diagrams: attractors of a family of problems and their periods."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
import pandas as pd

from lcpimpact.arguments import checked
from lcpimpact.arrays import Array
from lcpimpact.errors import InputError, LcpImpactError
from lcpimpact.integrators.base import Integrator, Option
from lcpimpact.numbers import count
from lcpimpact.problems.base import Problem
from lcpimpact.simulation import RUN_ARGUMENTS, check_lcp_solver, make_integrator
from lcpimpact.study.dynamics.continuation import Branch
from lcpimpact.study.dynamics.period import period_of
from lcpimpact.study.dynamics.sections import Points, Section, force_of, section_of, table_of
from lcpimpact.study.dynamics.strobes import Sampling, points_of_each
from lcpimpact.study.progress import Progress
from lcpimpact.study.result import Study, failure_lines


@dataclass(frozen=True, eq=False, repr=False)
class BifurcationDiagram(Study):
    """The bifurcation diagram of a family of problems.

    Attributes
    ----------
    table : DataFrame           one row per point, see `bifurcation`
    name : str                  name of the problem
    section : Section           the Poincaré section
    method : str
    parameter : str             name of the parameter in summary and plot
    branches : tuple of Branch  branches of periodic orbits added to the plot
    y : str or None             plotted column, if not the default
    units : mapping             units of the coordinates that are not in m, as of `Problem`
    """

    table: pd.DataFrame
    name: str
    section: Section
    method: str
    parameter: str = "value"
    branches: tuple[Branch, ...] = ()
    y: str | None = None
    units: Mapping[str, str] = field(default_factory=dict)

    drawn_by = "lcpimpact.plotting.dynamics:plot_bifurcation"
    title = "Bifurcation diagram of {0.name}"

    def summary(self) -> str:
        """Return the number of values with each period, and the failures."""
        values = self.table.drop_duplicates("value")
        ends = f"from {values['value'].iloc[0]:g} to {values['value'].iloc[-1]:g}"
        lines = [f"{self.name} by {self.method}: {len(values)} values of {self.parameter} {ends}"]
        for period, number in values.loc[values["failure"] == "", "period"].value_counts().sort_index().items():
            lines.append(
                f"  {number} values: " + (f"points repeat after {period:.0f}" if period else "no period found")
            )
        lines += failure_lines(self.failures) + [f"  {branch.ended}" for branch in self.branches if branch.ended]
        return "\n".join(lines)


@checked
def bifurcation(
    family: Callable[[float], Problem],
    values: Iterable[float],
    section: str | Section = "force",
    *,
    skip: int = 200,
    points: int = 50,
    method: str | Integrator = "exact",
    dt: float | None = None,
    lcp_solver: str = "auto",
    continue_from: bool = False,
    tol: float = 1e-6,
    workers: int | None = None,
    parameter: str = "value",
    progress: Progress = True,
    **method_options: Option,
) -> BifurcationDiagram:
    """Return the bifurcation diagram: section points of the motion after transients, for each parameter value.

    Parameters
    ----------
    family : callable
        Takes a value and returns a Problem.
    values : iterable of float
        In the order in which they are run.
    section, method, dt, lcp_solver, **method_options
        As of `poincare`.
    skip, points : int
        Number of points skipped and kept, for each value.
    continue_from : bool
        Start each run from the final state of the previous one, at a whole period of the force: an attractor is followed
        as far as it exists, and sweeps up and down may differ (hysteresis). Else each starts from its initial state.
    tol : float
        Relative tolerance for the repetition of points, for the column ``period``.
    workers : int, optional
        Number of threads; one by default. Not used with ``continue_from``.
    parameter : str
        Name of the parameter.
    progress : bool or callable
        As in `lcpimpact.study.progress`.

    Returns
    -------
    BifurcationDiagram
        Its ``table`` has one row per point: ``value``, then the columns of `poincare`, then ``period`` (in points, 0 if not
        periodic) and ``failure``; a failed run is a row of NaN with the reason.

    Examples
    --------
    >>> from lcpimpact import bifurcation, load_problem
    >>> diagram = bifurcation(lambda omega: load_problem("shaw-holmes", omega=omega), [2.6, 2.7], points=20)
    >>> diagram.table.groupby("value")["period"].first().tolist()
    [1, 2]
    """
    where = section_of(section)
    chosen = [float(value) for value in values]
    if not chosen:
        raise InputError("values is empty: give those that the parameter is to take")
    count("skip", skip, least=0)
    count("points", points)
    integrator = make_integrator(method, method_options, RUN_ARGUMENTS)
    check_lcp_solver(integrator, lcp_solver)
    sampling = Sampling(where, skip, skip + points, integrator, dt, lcp_solver)
    last: list[Array] = []

    def follow(problem: Problem) -> Points:
        found = sampling.of(_continued(problem, last.pop()) if last else problem)
        last[:] = [found.last]
        return found

    alone, together = (follow, None) if continue_from else (sampling.of, sampling)
    shown = ("bifurcation", progress)
    found = points_of_each(
        family, {"value": np.array(chosen)}, alone, together, None if continue_from else workers, shown
    )

    def rows(value: float, found: Points | str) -> pd.DataFrame:
        if isinstance(found, str) or len(found.t) == 0:
            failure = found if isinstance(found, str) else "the motion does not meet the section often enough"
            return pd.DataFrame({"value": [value], "failure": [failure]})
        problem = family(value)
        table = table_of(problem, found, force_of(problem, where))
        table.insert(0, "value", value)
        return table.assign(period=period_of(np.hstack([found.q, found.v]), tol), failure="")

    tables = list(map(rows, chosen, found))
    columns = max((list(table.columns) for table in tables), key=len)
    columns = [*(name for name in columns if name not in ("period", "failure")), "period", "failure"]
    table = pd.concat([each.reindex(columns=columns) for each in tables], ignore_index=True)
    name, units = _name_and_units(family, chosen)
    return BifurcationDiagram(table, name, where, integrator.name, parameter, units=units)


def _name_and_units(family: Callable[[float], Problem], values: Iterable[float]) -> tuple[str, Mapping[str, str]]:
    """Return the name and the units of the first problem that can be built."""
    for value in values:
        try:
            problem = family(value)
        except LcpImpactError:
            continue
        return problem.name, problem.units
    return "", {}


def _continued(problem: Problem, last: Array) -> Problem:
    """Return the problem with the state that a run before has left, where it may begin there."""
    d = problem.dynamics
    free = [i for i in range(len(d.nodes)) if i not in d.motions]
    try:
        q0, v0 = ({d.nodes[i]: float(row[i]) for i in free} for row in last)
        return replace(problem, q0=q0, v0=v0)
    except InputError:
        # The stop has moved to where the mass is.
        return problem
