r"""The observed order of a method: the slope of log error against log dt, with its scatter, beside the declared order.

Across impacts the sup norm of v converges for no method, since the computed impact is a little early or late. What does
converge is the sup norm of q and the L1 norm of v; so it is in these that methods declare their orders.

A slope through two step counts may be luck: an event that falls on a grid point fakes an order. So there should be six steps
or more, which `lcpimpact.study.accuracy.convergence` keeps clear of events, and the scatter about the line belongs to
the slope.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from lcpimpact.arguments import checked
from lcpimpact.errors import InputError
from lcpimpact.integrators.base import Integrator
from lcpimpact.problems.base import Problem
from lcpimpact.simulation import make_integrator
from lcpimpact.study.accuracy.convergence import SMOOTH, convergence, floor_of
from lcpimpact.study.accuracy.norms import NORMS
from lcpimpact.study.accuracy.reference import Reference
from lcpimpact.trajectory import Trajectory

COUNTS = (307, 487, 773, 1229, 1951, 3089)
"""Numbers of steps: primes, a factor of about 1.6 apart."""

COARSER_COUNTS = (
    (127, 181, 257, 367, 521, 743),
    (29, 43, 61, 89, 127, 181),
    (17, 23, 31, 41, 53, 71),
    (5, 7, 11, 13, 17, 23),
)
"""For methods of a high order, whose errors would soon be rounding."""

EXACT_RTOL = 1e-9
"""Largest error, relative to the scale, of a method that declares to be exact."""

TOLERANCE_FACTOR = 1e3
"""Largest error, relative to the scale and in units of rtol, of a method that declares to follow rtol."""

SMOOTH_BAND, EVENT_BAND = 0.2, 0.35
"""Largest difference of an observed order from the declared one, without events and with them."""


@dataclass(frozen=True)
class Order:
    """What a method was seen to do.

    Attributes
    ----------
    slope : float               of log error against log h, by least squares
    scatter : float             standard deviation of log10 of the errors about the line
    standard_error : float      of the slope, from the scatter and the spread of the steps; nan of two points
    dts : tuple                 the steps in s
    errors : tuple              the error at each of them
    """

    slope: float
    scatter: float
    standard_error: float
    dts: tuple[float, ...]
    errors: tuple[float, ...]


def fit(dts: Sequence[float], errors: Sequence[float]) -> Order:
    r"""Fit :math:`\log_{10} e = p \log_{10} h + c` by least squares.

    Parameters
    ----------
    dts, errors : sequences of float
        At least two steps, and the error above zero at each.

    Examples
    --------
    >>> order = fit([0.1, 0.05, 0.025], [3e-2, 7.5e-3, 1.875e-3])
    >>> round(order.slope, 12), round(order.scatter, 12)
    (2.0, 0.0)
    """
    if len(dts) < 2 or len(dts) != len(errors):
        raise InputError(f"dts = {dts!r}: an order takes at least two steps with an error each, better six")
    x, y = np.log10(dts), np.log10(errors)
    slope, offset = np.polyfit(x, y, 1)
    rest = y - slope * x - offset
    spread = ((x - x.mean()) ** 2).sum()
    variance = (rest**2).sum() / (len(x) - 2) if len(x) > 2 else math.nan
    return Order(
        float(slope),
        float(np.std(rest)),
        float(math.sqrt(variance / spread)),
        tuple(map(float, dts)),
        tuple(map(float, errors)),
    )


@checked
def observed_orders(table: pd.DataFrame, norm: str | None = None) -> pd.DataFrame:
    """Fit the order of each method of a table of `lcpimpact.convergence`, and say whether it is as declared.

    Parameters
    ----------
    table : DataFrame
        Of `lcpimpact.convergence`; with its ``attrs``, or else no error counts as rounding.
    norm : str, optional
        One norm of the table; by default all.

    Returns
    -------
    DataFrame
        One row a method, law, stiffness and norm:

        - ``method``, ``law``, ``k``, ``norm``
        - ``order``: slope of log error against log dt; NaN where fewer than two errors tell one
        - ``scatter``: standard deviation of log10 of the errors about the line
        - ``standard_error``: of the slope
        - ``points``: number of errors that were fitted
        - ``rounding``: number of errors left out, because they are rounding or the reference's own
        - ``failed``: number of runs without a result
        - ``declared``: what the method declares for this problem, in the norm in which it declares it; else NaN. The
          events of the reference decide: the least of the orders declared for smooth motion, for kinks and jumps of the
          force, for friction and for impacts, of those that happen
        - ``verdict``: "as declared" if the order is within 0.2 of the declared one in smooth motion and within 0.35 with
          events, or if a method that is exact, or follows rtol, has errors that are small enough; else "off". "" where
          nothing is declared; "rounding" where there is no order to be seen; "failed" where no run has a result

    Examples
    --------
    >>> from lcpimpact import convergence, load_problem, observed_orders
    >>> table = convergence(load_problem("system-1"), ["moreau-jean"], [0.01 / 1.6**i for i in range(6)])
    >>> orders = observed_orders(table, "sup_q")
    >>> orders["verdict"].item(), bool(abs(orders["order"].item() - 2.0) < 0.35)
    ('as declared', True)
    """
    present = [name for name in NORMS if name in table.columns]
    if norm is not None and norm not in present:
        raise InputError(f"norm = {norm!r} is not in the table; it has {', '.join(present) or 'none'}")
    rows = []
    for (method, law, k), runs in table.groupby(["method", "law", "k"], sort=False, dropna=False):
        for name in present if norm is None else [norm]:
            rows.append({"method": method, "law": law, "k": k, "norm": name} | _observed(runs, name, table.attrs))
    return pd.DataFrame(rows, columns=[*("method", "law", "k", "norm"), *_NAMES])


_NAMES = ("order", "scatter", "standard_error", "points", "rounding", "failed", "declared", "verdict")


def _observed(runs: pd.DataFrame, norm: str, attrs: dict[Any, Any]) -> dict[str, Any]:
    """Return what the runs of one method show in one norm."""
    scale, rounding = float(attrs.get(f"scale_{norm}", 0.0)), floor_of(runs["reference"].iloc[0], norm)
    solved = runs[(runs["failure"] == "") & runs[norm].notna()]
    telling = solved[solved[norm] > rounding * scale]
    declared = float(runs["declared"].iloc[0]) if attrs.get("declared_norm") == norm else math.nan
    row: dict[str, Any] = dict.fromkeys(("order", "scatter", "standard_error"), math.nan)
    row |= {
        "points": len(telling),
        "rounding": len(solved) - len(telling),
        "failed": int((runs["failure"] != "").sum()),
        "declared": declared,
    }
    if len(telling) >= 2 and telling["dt"].nunique() >= 2:
        found = fit(list(telling["dt"]), list(telling[norm]))
        row |= {"order": found.slope, "scatter": found.scatter, "standard_error": found.standard_error}
    band = SMOOTH_BAND if attrs.get("limited_by") == SMOOTH.name else EVENT_BAND
    if len(solved) == 0:
        verdict = "failed"
    elif math.isnan(declared):
        verdict = ""
    elif math.isinf(declared):
        rtol = float(runs["rtol"].max())
        allowed = scale * max(EXACT_RTOL, rounding, 0.0 if math.isnan(rtol) else TOLERANCE_FACTOR * rtol)
        verdict = "as declared" if solved[norm].max() <= allowed else "off"
    elif math.isnan(row["order"]):
        verdict = "rounding"
    else:
        verdict = "as declared" if abs(row["order"] - declared) <= band else "off"
    return row | {"verdict": verdict}


class RoundingError(InputError):
    """The errors of a method are rounding, and tell no order."""


@checked
def observed_order(
    problem: Problem,
    method: str | Integrator,
    counts: Sequence[int] = COUNTS,
    t_end: float | None = None,
    norm: str = "sup_q",
    truth: Trajectory | Reference | None = None,
    **options: Any,
) -> Order:
    """Run a method with several step counts, and fit the order of its errors.

    Parameters
    ----------
    problem : Problem
        What is run.
    method : str or Integrator
        Name or object.
    counts : sequence of int
        Step counts, primes for preference; each is raised to a prime that keeps clear of events.
    t_end : float, optional
        End in s; by default that of the problem.
    norm : str
        A name of `lcpimpact.study.accuracy.norms.NORMS`.
    truth : Trajectory or Reference, optional
        The reference, as of `lcpimpact.convergence`.
    **options
        Options of the method.

    Raises
    ------
    InputError
        For another norm, fewer than two counts, a run that fails, or errors that are rounding.

    Examples
    --------
    >>> from lcpimpact import load_problem
    >>> order = observed_order(load_problem("system-3"), "moreau-jean", counts=(101, 211, 401))
    >>> 1.8 < order.slope < 2.2
    True
    """
    if len(counts) < 2:
        raise InputError(f"counts = {counts!r} must hold at least two step counts, better six that are primes")
    end = problem.t_end if t_end is None else t_end
    integrator = make_integrator(method, options)
    table = convergence(
        problem, [integrator], [end / steps for steps in counts], t_end=end, norms=[norm], reference=truth
    )
    for failure in table["failure"]:
        if failure:
            raise InputError(f"{integrator.name} on {problem.name!r}: {failure}")
    if table[norm].min() <= floor_of(table["reference"].iloc[0], norm) * table.attrs[f"scale_{norm}"]:
        raise RoundingError(
            f"the errors of {integrator.name} on {problem.name!r} are rounding: take larger steps to see an order"
        )
    return fit(list(table["dt"]), list(table[norm]))


@checked
def order_as_declared(
    problem: Problem, method: str, declared: float, norm: str = "sup_q", counts: Sequence[int] = COUNTS
) -> Order | None:
    """Observe the order of a method with step counts that suit it.

    Parameters
    ----------
    problem : Problem
        Run to its ``t_end``.
    method : str
        Name.
    declared : float
        The order to expect: above 2 the first of `COARSER_COUNTS` is taken whose errors are not rounding, else ``counts``.
    norm : str
        As of `observed_order`.
    counts : sequence of int
        Step counts for orders up to 2.

    Returns
    -------
    Order or None
        None where a method of high order is exact but for rounding with any of them, as on a parabola.
    """
    if declared <= 2.0:
        return observed_order(problem, method, counts, norm=norm)
    for few in COARSER_COUNTS:
        try:
            return observed_order(problem, method, few, norm=norm)
        except RoundingError:
            continue
    return None
