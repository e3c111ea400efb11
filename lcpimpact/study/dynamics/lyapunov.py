"""Lyapunov exponents, by the derivative of the exact motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd

from lcpimpact.arguments import checked
from lcpimpact.arrays import Array
from lcpimpact.errors import InputError
from lcpimpact.hybrid.motion import begin, begin_problem, state_before
from lcpimpact.hybrid.tangent import factors
from lcpimpact.numbers import positive
from lcpimpact.problems.base import Problem
from lcpimpact.study.dynamics.shooting import follow_exactly, free_coordinates, refuse_power_laws
from lcpimpact.study.progress import Progress, watched
from lcpimpact.study.result import Study

CHAOS_STRETCHING = 5.0
"""ln of the stretching over the second half of the time from which a positive exponent is called chaos. Stretching that is
only proportional to time, as by a shear, contributes ln 2."""


@dataclass(frozen=True, eq=False, repr=False)
class LyapunovExponents(Study):
    """The Lyapunov exponents of a motion.

    Attributes
    ----------
    problem : Problem
    table : DataFrame       one row per event: ``t`` (s) and the running average of each exponent, ``1``, ``2``, ... (1/s)
    exponents : (k,) array  final values in 1/s, the largest first
    stretching : float      ln |R| of the largest, summed over the events in the second half of the time
    """

    problem: Problem
    table: pd.DataFrame
    exponents: Array
    stretching: float

    drawn_by = "lcpimpact.plotting.dynamics:plot_lyapunov"
    title = "Lyapunov exponents of {0.problem.name}"

    def summary(self) -> str:
        """Return the exponents, and whether the largest one shows chaos."""
        verdict = "no chaos"
        if len(self.exponents) and self.exponents[0] > 0.0:
            enough = self.stretching >= CHAOS_STRETCHING
            verdict = "chaos" if enough else "too short a run to tell a positive exponent from zero"
        rows = [f"  {exponent:+.9g} 1/s" for exponent in self.exponents]
        return "\n".join([f"{self.problem.name}: Lyapunov exponents, {verdict}", *rows])


@checked
def lyapunov(
    problem: Problem, *, t_end: float | None = None, t_start: float = 0.0, progress: Progress = True
) -> LyapunovExponents:
    r"""Return the Lyapunov exponents of a motion in 1/s, the largest first.

    .. math:: λ_i = \lim_{t → ∞} \frac{1}{t - t_\mathrm{start}} \sum \ln |R_{ii}|

    with the QR factors of the fundamental matrix, the product of flows and saltation matrices. A positive largest exponent
    means chaos, if the run is long enough to tell it from zero; where a contact stays closed or a slider sticks, directions
    are lost and their exponent is -inf.

    Parameters
    ----------
    problem : Problem
        One that the method ``exact`` handles.
    t_end : float, optional
        End in s; by default that of the problem.
    t_start : float
        Start of the average in s, after the transient.
    progress : bool or callable
        As of `lcpimpact.study.progress`.

    Raises
    ------
    InputError
        For invalid times, or a start not before the end.
    UnsupportedError
        If the motion grazes, or two events happen at once.

    Examples
    --------
    >>> import math
    >>> from lcpimpact import load_problem, lyapunov
    >>> T = 2.0 * math.pi / 2.6
    >>> λ = lyapunov(load_problem("impact-oscillator"), t_end=100.5 * T, t_start=0.5 * T).exponents
    >>> bool(abs(λ.sum() - (2.0 * math.log(0.8) / T - 0.1)) < 1e-9)
    True

    References
    ----------
    Müller, Calculation of Lyapunov exponents for dynamic systems with discontinuities (1995).
    """
    end = problem.t_end if t_end is None else t_end
    positive("t_end", end, "s")
    if t_start != 0.0:
        positive("t_start", t_start, "s")
    if t_start >= end:
        raise InputError(f"t_start = {t_start:g} s must lie before t_end = {end:g} s: run longer, or begin earlier")
    refuse_power_laws(problem)
    first = begin_problem(problem, "exact", end)
    follow_exactly(first, problem, t_start)
    motion = first
    if t_start > 0.0:
        motion = begin(first.system, state_before(first, t_start), end, t_start, scale=first.scale)
    follow_exactly(motion, problem, motion.end)
    free = free_coordinates(motion.system)
    Q = np.eye(len(free))
    total = np.zeros(len(free))
    totals = []
    for factor in watched(factors(motion, motion.end), 2 * len(motion.segments) - 1, "events", progress):
        Q, R = np.linalg.qr(factor[np.ix_(free, free)] @ Q)
        with np.errstate(divide="ignore"):
            total = total + np.log(np.abs(np.diag(R)))
        totals.append(total)
    # Flows and saltation matrices alternate; each flow ends at an event.
    t = np.array([*(segment.t0 for segment in motion.segments[1:]), motion.end])
    sums = np.array(totals[::2])[:, np.argsort(-total, kind="stable")]
    averages = sums / (t - t_start)[:, None]
    middle = int(np.searchsorted(t, 0.5 * (t_start + end)))
    with np.errstate(invalid="ignore"):
        stretching = float(sums[-1, 0] - sums[middle, 0]) if len(free) else 0.0
    columns = {str(k): average for k, average in enumerate(averages.T, start=1)}
    exponents = np.sort(total / (end - t_start))[::-1]
    return LyapunovExponents(problem, pd.DataFrame({"t": t, **columns}), exponents, stretching)
