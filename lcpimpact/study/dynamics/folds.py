"""Branches of periodic orbits through folds, by pseudo-arclength (`lcpimpact.study.dynamics.arclength`).

At a fold the branch turns back, dp/ds = 0, and a multiplier is 1; at a flip one is -1.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import islice

import numpy as np

from lcpimpact.arguments import checked
from lcpimpact.errors import InputError
from lcpimpact.numbers import between, count, finite
from lcpimpact.problems.base import Problem
from lcpimpact.study.dynamics.arclength import Curve, CurvePoint, Test, flip, points, turn
from lcpimpact.study.dynamics.continuation import Branch, branch_table
from lcpimpact.study.dynamics.shooting import MAX_NEWTON_STEPS, find_orbit
from lcpimpact.study.progress import Progress, watched


@checked
def continue_through_folds(
    family: Callable[[float], Problem],
    bracket: tuple[float, float],
    *,
    periods: int = 1,
    T: float | None = None,
    transient: int = 0,
    step: float = 0.05,
    max_orbits: int = 200,
    max_iter: int = MAX_NEWTON_STEPS,
    parameter: str = "value",
    progress: Progress = True,
) -> Branch:
    r"""Continue a periodic orbit, stable or not, through the folds at which its parameter turns back.

    The branch begins at the first value, towards the other one, and ends where it leaves the values between them, after
    ``max_orbits``, at a grazing, or where the orbit would have other events. Folds and flips are located on it.

    Parameters
    ----------
    family : callable
        Takes a value and returns a Problem; coordinates and contacts must stay the same.
    bracket : pair of float
        The value at which the branch begins, and the one towards which it sets out.
    periods, T, transient
        As in `periodic_orbit`, for the first value.
    step : float
        First step along the branch and a twentieth of the largest, relative to the bracket and to the largest states.
    max_orbits : int
        Maximum number of orbits.
    max_iter : int
        Maximum number of Newton iterations per orbit.
    parameter : str
        Name of the parameter.
    progress : bool or callable
        As in `lcpimpact.study.progress`.

    Returns
    -------
    Branch
        Its table has a column ``point``: "fold" or "flip" at those, else "".

    Raises
    ------
    InputError
        For a bracket without width, or numbers out of range.
    LcpImpactError
        As `periodic_orbit` for the first value.

    Examples
    --------
    An oscillator pressed against its stop strikes it once a period while the force is strong enough:

    >>> from lcpimpact import continue_through_folds, load_problem
    >>> branch = continue_through_folds(
    ...     lambda f: load_problem("shaw-holmes", omega=2.6, s=-0.05, f=f), (0.055, 0.03), transient=60, step=0.2,
    ...     max_orbits=6, progress=False,
    ... )
    >>> branch.table[branch.table["point"] == "fold"]["value"].round(9).tolist()
    [0.046434086]

    References
    ----------
    Keller, Numerical solution of bifurcation and nonlinear eigenvalue problems (1977).
    """
    begin, towards = (float(value) for value in bracket)
    for value in (begin, towards):
        finite("bracket", value)
    if begin == towards:
        raise InputError(f"bracket = {bracket!r} has no width: give the first value and one to set out for")
    between("step", step, 1e-6, 1.0)
    count("max_orbits", max_orbits)
    count("max_iter", max_iter, 1)
    first = find_orbit(family(begin), None, periods, T, transient, max_iter)
    curve = Curve.of(family, first, {parameter: abs(towards - begin)})
    ended: list[str] = []
    on = points(curve, np.array([begin]), np.array([[begin], [towards]]), step, max_iter, _tests, ended)
    found = list(watched(islice(on, max_orbits), max_orbits, "orbits", progress))
    values = [float(curve.values(point.y)[0]) for point, _ in found]
    values[0] = begin
    orbits = tuple(point.orbit for point, _ in found)
    why = f"the branch ends near {values[-1]:.9g}: {ended[0]}" if ended else ""
    table = branch_table(values, list(orbits), "")
    table.insert(len(table.columns) - 1, "point", [kind for _, kind in found])
    return Branch(orbits, table, why, parameter, curve.derivatives)


def _tests(_: CurvePoint) -> dict[str, Test]:
    """Return the tests for folds, where the parameter turns back, and flips."""
    return {"fold": turn, "flip": flip}
