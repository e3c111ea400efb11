r"""The observed order of a method, the slope of log error against log dt, with its scatter and the declared order.

Across impacts the sup norm of the error of v converges for no method, since the computed impact is slightly early or late.
The sup norm of q and the L1 norm of v converge, so methods declare their orders in these.

A slope through two steps may be accidental, as when an event falls on a grid point. So at least six steps should be used,
which `lcpimpact.study.accuracy.convergence` keeps clear of events, and the slope be reported with its scatter.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from lcpimpact.errors import InputError
from lcpimpact.study.accuracy.limits import SMOOTH, Limit, floor_of

SMOOTH_BAND, EVENT_BAND = 0.2, 0.35
"""Maximum difference of the observed from the declared order, without and with events."""


@dataclass(frozen=True)
class Order:
    """The observed order of a method.

    Attributes
    ----------
    slope : float               slope of log error against log h, by least squares
    scatter : float             standard deviation of log10 of the errors about the line
    standard_error : float      standard error of the slope; nan for two points
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
        At least two steps, and the positive error at each.

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


def stated(order: float, standard_error: float) -> str:
    """Return an order with its standard error, which two points do not tell.

    Examples
    --------
    >>> stated(1.97, 0.04), stated(1.35, math.nan)
    ('1.97 ± 0.04', '1.35 by two points')
    """
    return f"{order:.2f} by two points" if math.isnan(standard_error) else f"{order:.2f} ± {standard_error:.2f}"


def observe(
    runs: pd.DataFrame,
    norm: str,
    scale: float,
    declared: float = math.nan,
    limited_by: Limit | None = None,
    *,
    exact_rtol: float = 1e-9,
    tolerance_factor: float = 1e3,
    event_points: int = 6,
) -> dict[str, Any]:
    """Return the columns of `observed_orders` from ``order`` on for the runs of one method in one norm.

    ``exact_rtol``: maximum error, relative to the scale, of a method declared exact.
    ``tolerance_factor``: maximum error, relative to the scale and in units of rtol, of a method declared to follow
    rtol.
    ``event_points``: minimum number of errors for a verdict with events: each depends on where in its step an event
    falls, and a line through few of them has by chance a small scatter and a wrong slope.

    Parameters
    ----------
    runs : DataFrame
        Rows of `lcpimpact.convergence`; with a column ``noise``, errors below it do not count either.
    norm : str
        Column of the errors.
    scale : float
        Scale of the errors; 0 if unknown, and then no error counts as rounding.
    declared : float
        The declared order; nan if nothing is declared in this norm.
    limited_by : Limit, optional
        What limits the order.
    """
    rounding = floor_of(runs["reference"].iloc[0], norm)
    solved = runs[(runs["failure"] == "") & runs[norm].notna()]
    open_ = solved.get("noise", 0.0)
    telling = solved[solved[norm] > np.maximum(rounding * scale, open_)]
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
    smooth = limited_by == SMOOTH
    band = SMOOTH_BAND if smooth else EVENT_BAND
    if len(solved) == 0:
        verdict = "failed"
    elif math.isnan(declared):
        verdict = ""
    elif math.isinf(declared):
        rtol = float(runs["rtol"].max())
        allowed = scale * max(exact_rtol, rounding, 0.0 if math.isnan(rtol) else tolerance_factor * rtol)
        verdict = "as declared" if solved[norm].max() <= allowed else "off"
    elif math.isnan(row["order"]):
        verdict = "rounding"
    else:
        off = abs(row["order"] - declared)
        chance = 0.0 if smooth else 2.0 * row["standard_error"]
        if (not smooth and len(telling) < event_points) or band < off <= band + chance:
            verdict = "too few steps to tell"
        else:
            verdict = "as declared" if off <= band else "off"
    return row | {"verdict": verdict}
