"""Bifurcation diagrams: where the motions of a family end up, and with what period."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd

from lcpimpact.arguments import checked
from lcpimpact.arrays import Array
from lcpimpact.errors import InputError, LcpImpactError
from lcpimpact.integrators.base import Integrator
from lcpimpact.numbers import count
from lcpimpact.problems.base import Problem
from lcpimpact.study.dynamics.sections import Section, described, find_points, section_of, table_of
from lcpimpact.study.watch import Watch, unwatched

MAX_PERIOD = 16
"""Longest period sought, in points of the section."""


def period_of(points: Array, tol: float = 1e-6, most: int = MAX_PERIOD) -> int:
    """Return after how many points a sequence repeats itself, 0 where it does not.

    Parameters
    ----------
    points : (k, d) array
        Points of a section, the transient left out.
    tol : float
        Largest miss, relative to the largest |value| of each column, or a millionth of the largest of all.
    most : int
        Longest period that is looked for; half of the points must show it.

    Examples
    --------
    >>> period_of(np.array([[1.0], [2.0], [1.0], [2.0], [1.0], [2.0]]))
    2
    """
    points = np.atleast_2d(np.asarray(points, dtype=np.float64))
    unit = tol * extents(points)
    for p in range(1, min(most, len(points) // 2) + 1):
        if (np.abs(points[p:] - points[:-p]) <= unit).all():
            return p
    return 0


def extents(points: Array) -> Array:
    """Return the largest |value| of each column, of which what is far below the others is rounding (d,)."""
    sizes = np.abs(points).max(axis=0, initial=0.0)
    return np.asarray(np.maximum(sizes, max(1e-6 * sizes.max(initial=0.0), 1e-300)))


def each_of(function: Callable[[Any], Any], items: Sequence[Any], workers: int | None) -> Iterator[Any]:
    """Yield function(item) for each item, in order, by so many threads (None or 1: by none)."""
    if workers is None or workers == 1:
        yield from map(function, items)
        return
    count("workers", workers)
    with ThreadPoolExecutor(int(workers)) as pool:
        yield from pool.map(function, items)


@checked
def bifurcation(
    family: Callable[[float], Problem],
    values: Iterable[float],
    section: str | Section = "force",
    *,
    transient: int = 200,
    kept: int = 50,
    method: str | Integrator = "exact",
    dt: float | None = None,
    continue_from: bool = False,
    tol: float = 1e-6,
    workers: int | None = None,
    watch: Watch = unwatched,
    **method_options: Any,
) -> pd.DataFrame:
    """Return where motions end up, value by value of a parameter: the points of a bifurcation diagram.

    Parameters
    ----------
    family : callable
        Takes a value and returns a Problem.
    values : iterable of float
        In the order in which they are run.
    section, method, dt, **method_options
        As of `poincare`.
    transient, kept : int
        Points that are left out first, and that are kept, for each value.
    continue_from : bool
        Start each run where the one before ended, at a whole period of the force: an attractor is then followed as far as it
        exists, and a sweep down may show others than a sweep up (hysteresis). Else each starts from its problem's own state.
    tol : float
        Relative miss within which points repeat themselves, for the column ``period``.
    workers : int, optional
        Threads; one unless more are asked for. Runs that continue each other take none.
    watch : callable
        Sees the values go by.

    Returns
    -------
    DataFrame
        One row a point: ``value``, then the columns of `poincare`, then ``period`` (points after which they repeat, 0 where
        they do not) and ``failure``; a run that fails is a row of NaN with the reason.

    Examples
    --------
    >>> from lcpimpact import bifurcation, load_problem
    >>> table = bifurcation(lambda omega: load_problem("shaw-holmes", omega=omega), [2.6, 2.7], kept=20)
    >>> table.groupby("value")["period"].first().tolist()
    [1, 2]
    """
    where = section_of(section)
    chosen = [float(value) for value in values]
    if not chosen:
        raise InputError("values is empty: give those that the parameter is to take")
    count("transient", transient, least=0)
    count("kept", kept)
    last: list[Array] = []

    def one(value: float) -> pd.DataFrame:
        try:
            problem = family(value)
            if last:
                problem = _continued(problem, last.pop())
            points, force = find_points(problem, where, transient, kept, None, method, dt, method_options)
        except LcpImpactError as error:
            return pd.DataFrame({"value": [value], "failure": [str(error)]})
        if continue_from:
            last[:] = [points.last]
        if len(points.t) == 0:
            return pd.DataFrame({"value": [value], "failure": ["the motion does not meet the section often enough"]})
        table = table_of(problem, points, force)
        table.insert(0, "value", value)
        return table.assign(period=period_of(np.hstack([points.q, points.v]), tol), failure="")

    tables = list(watch(each_of(one, chosen, None if continue_from else workers), len(chosen), "bifurcation"))
    columns = max((list(table.columns) for table in tables), key=len)
    columns = [*(name for name in columns if name not in ("period", "failure")), "period", "failure"]
    table = pd.concat([each.reindex(columns=columns) for each in tables], ignore_index=True)
    table.attrs = described(_name(family, chosen[0]), where, method, transient) | {"kept": kept}
    return table


def _name(family: Callable[[float], Problem], value: float) -> str:
    try:
        return family(value).name
    except LcpImpactError:
        return ""


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
