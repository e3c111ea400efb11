"""Lyapunov exponents, by the derivative of the exact motion."""

from __future__ import annotations

import numpy as np

from lcpimpact.arguments import checked
from lcpimpact.arrays import Array
from lcpimpact.hybrid.motion import begin, begin_problem, state_before
from lcpimpact.hybrid.tangent import factors
from lcpimpact.numbers import positive
from lcpimpact.problems.base import Problem
from lcpimpact.study.dynamics.shooting import follow_exactly, free_coordinates, refuse_power_laws
from lcpimpact.study.watch import Watch, unwatched


@checked
def lyapunov(problem: Problem, *, t_end: float, transient: float = 0.0, watch: Watch = unwatched) -> Array:
    r"""Return the Lyapunov exponents of a motion in 1/s, the largest first.

    .. math:: λ_i = \lim_{t → ∞} \frac{1}{t} \sum \ln |R_{ii}|

    with the derivative along the motion, flows and saltation matrices in turn, kept as Q R. A largest exponent above zero
    means chaos; where a contact stays closed or a slider sticks, directions are lost for ever and their exponent is -inf.

    Parameters
    ----------
    problem : Problem
        One that the method ``exact`` handles.
    t_end : float
        Length of the average in s.
    transient : float
        Time before it in s.
    watch : callable
        Sees the events go by.

    Raises
    ------
    UnsupportedError
        If the motion grazes, or two events happen at once.

    Examples
    --------
    >>> import math
    >>> from lcpimpact import load_problem, lyapunov
    >>> T = 2.0 * math.pi / 2.6
    >>> λ = lyapunov(load_problem("impact-oscillator"), t_end=100 * T, transient=0.5 * T)
    >>> bool(abs(λ.sum() - (2.0 * math.log(0.8) / T - 0.1)) < 1e-9)
    True

    References
    ----------
    Müller, Calculation of Lyapunov exponents for dynamic systems with discontinuities (1995).
    """
    positive("t_end", t_end, "s")
    if transient != 0.0:
        positive("transient", transient, "s")
    refuse_power_laws(problem)
    first = begin_problem(problem, "exact", transient + t_end)
    follow_exactly(first, problem, transient)
    motion = first
    if transient > 0.0:
        motion = begin(first.system, state_before(first, transient), transient + t_end, transient, scale=first.scale)
    follow_exactly(motion, problem, motion.end)
    free = free_coordinates(motion.system)
    Q, total = np.eye(len(free)), np.zeros(len(free))
    for factor in watch(factors(motion, motion.end), 2 * len(motion.segments) - 1, "events"):
        Q, R = np.linalg.qr(factor[np.ix_(free, free)] @ Q)
        with np.errstate(divide="ignore"):
            total += np.log(np.abs(np.diag(R)))
    return np.sort(total / t_end)[::-1]
