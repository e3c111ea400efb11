r"""The observed order of a method: errors in the norms that converge, and the slope through many step counts.

Across impacts the sup norm of v converges for no method, since the computed impact is a little early or late. What does
converge is

.. math:: \sup_t |q - q^*|, \qquad \int_0^T |v - v^*| \, dt,

over the nodes with mass, the latter taken between grid points and events and not sampled on the grid of the method. Nodes
without mass follow the others by a balance of forces; in the step in which a contact opens, a method that holds it to the
end of the step leaves a node on a spring O(h) off for that one instant, which says nothing of the motion.

A slope through two step counts may be luck: an event that falls on a grid point fakes an order. So the counts should be
primes, six or more, and the scatter about the line belongs to the slope.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from lcpimpact.arrays import Flags
from lcpimpact.errors import InputError
from lcpimpact.integrators.base import Integrator
from lcpimpact.problems.base import Problem
from lcpimpact.simulation import simulate
from lcpimpact.trajectory import Trajectory

GAUSS_NODES, GAUSS_WEIGHTS = np.polynomial.legendre.leggauss(4)

COUNTS = (307, 487, 773, 1229, 1951, 3089)
"""Primes, a factor of about 1.6 apart."""

RARER = (
    (127, 181, 257, 367, 521, 743),
    (29, 43, 61, 89, 127, 181),
    (17, 23, 31, 41, 53, 71),
    (5, 7, 11, 13, 17, 23),
)
"""For methods of a high order, whose errors would soon be rounding."""

ROUNDING = 1e-12
"""Errors this small, relative to the largest value of the reference, are rounding and tell no order."""


def inertial(run: Trajectory) -> Flags:
    """Return which coordinates are judged (n,): those with mass, or all where none has, as in a system given directly."""
    massive = run.problem.dynamics.massive
    return massive if massive.any() else ~massive


def sup_q(run: Trajectory, truth: Trajectory) -> float:
    """Return the largest |q - q*| in m on the grid of the run, over the nodes that `inertial` names."""
    return float(np.abs(run.q - truth.sample(run.t).q)[:, inertial(run)].max())


def l1_v(run: Trajectory, truth: Trajectory) -> float:
    """Return ∫ Σ |v - v*| dt in m over the same nodes, v between grid points on the line through its values there.

    It is integrated between the points of the grid and the events, so that no jump is passed over.
    """
    located = truth.events + (run.events if run.dense is not None else ())
    events = [event.t for event in located if run.t[0] < event.t < run.t[-1]]
    cuts = np.unique(np.concatenate([run.t, events]))
    half = 0.5 * np.diff(cuts)
    times = ((cuts[:-1] + half)[:, None] + half[:, None] * GAUSS_NODES).ravel()
    errors = np.abs(run.sample(times).v - truth.sample(times).v)[:, inertial(run)].sum(axis=1)
    return float(((errors.reshape(-1, len(GAUSS_NODES)) * GAUSS_WEIGHTS).sum(axis=1) * half).sum())


NORMS = {"q": sup_q, "v": l1_v}


@dataclass(frozen=True)
class Order:
    """What a method was seen to do.

    Attributes
    ----------
    slope : float           of log error against log h, by least squares
    scatter : float         standard deviation of log10 of the errors about the line
    steps : tuple           the step counts
    errors : tuple          the error at each of them
    """

    slope: float
    scatter: float
    steps: tuple[int, ...]
    errors: tuple[float, ...]


class RoundingError(InputError):
    """The errors of a method are rounding, and tell no order."""


def observed_order(
    problem: Problem,
    method: str | Integrator,
    counts: Sequence[int] = COUNTS,
    t_end: float | None = None,
    norm: str = "q",
    truth: Trajectory | None = None,
    **options: Any,
) -> Order:
    """Run a method with several step counts, and fit the order of its errors.

    Parameters
    ----------
    problem : Problem
        What is run; the method ``exact`` must handle it unless ``truth`` is given.
    method : str or Integrator
        Name or object.
    counts : sequence of int
        Step counts, primes for preference.
    t_end : float, optional
        End in s; by default that of the problem.
    norm : {"q", "v"}
        The sup norm of the coordinates, or the L1 norm of the velocities.
    truth : Trajectory, optional
        The reference, which must be one that can be sampled anywhere; by default the solution by ``exact``.
    **options
        Options of the method.

    Raises
    ------
    InputError
        For another norm, fewer than two counts, or errors that are rounding.

    Examples
    --------
    >>> from lcpimpact import load_problem
    >>> order = observed_order(load_problem("system-3"), "moreau-jean", counts=(101, 211, 401))
    >>> 1.8 < order.slope < 2.2
    True
    """
    if norm not in NORMS:
        raise InputError(f"norm = {norm!r} must be one of {', '.join(NORMS)}")
    if len(counts) < 2:
        raise InputError(f"counts = {counts!r} must hold at least two step counts, better six that are primes")
    end = problem.t_end if t_end is None else t_end
    if truth is None:
        truth = simulate(problem, "exact", dt=end / max(counts), t_end=end, progress=False)
    errors = []
    for steps in counts:
        run = simulate(problem, method, dt=end / steps, t_end=end, progress=False, **options)
        errors.append(NORMS[norm](run, truth))
    scale = float(np.abs(truth.q if norm == "q" else truth.v * end).max())
    if min(errors) <= ROUNDING * scale:
        raise RoundingError(
            f"the errors of {run.method} on {problem.name!r} are rounding: take larger steps to see an order"
        )
    x, y = np.log10(end / np.array(counts)), np.log10(errors)
    slope, offset = np.polyfit(x, y, 1)
    return Order(float(slope), float(np.std(y - slope * x - offset)), tuple(counts), tuple(errors))


def order_as_declared(
    problem: Problem, method: str, declared: float, norm: str = "q", counts: Sequence[int] = COUNTS
) -> Order | None:
    """Observe the order of a method with step counts that suit it.

    Parameters
    ----------
    problem : Problem
        Run to its ``t_end``.
    method : str
        Name.
    declared : float
        The order to expect: above 2 the first of `RARER` is taken whose errors are not rounding, else ``counts``.
    norm : {"q", "v"}
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
    for few in RARER:
        try:
            return observed_order(problem, method, few, norm=norm)
        except RoundingError:
            continue
    return None
