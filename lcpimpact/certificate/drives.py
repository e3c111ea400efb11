r"""Loads and prescribed motions between the instants of a run: the part of them that steps miss which are too long.

A method knows a load at some instants of a step, and takes it as smooth between them. A blow that is over before the next
instant is missed, and a load that turns once in a step acts as a constant one. The impulse that a run misses is

.. math:: \left|\int_0^t (f - \bar f)\,dt\right|, \qquad f = f(t) - K y - C y',

with the forces of springs and dashpots that lead to nodes with prescribed motions y, and the line f̄ between the values of
f at the ends of each step. Of a load that is a signal with breakpoints nothing is missed: a step with some has its mean.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from lcpimpact.arrays import Array
from lcpimpact.certificate.quadrature import Pieces
from lcpimpact.scheme.dynamics import Dynamics
from lcpimpact.scheme.signals import (
    Described,
    Harmonic,
    PiecewisePolynomial,
    Signal,
    SignalSum,
    breaks,
    limits_at,
    snapped,
    values_at,
)
from lcpimpact.scheme.waves import sine

SEEN_FRACTION, MOMENTUM_FRACTION = 0.5, 0.01
"""Impulse of loads and prescribed motions that steps may miss, as fractions of the impulse that they see and of the
momentum; likewise the deviation of a motion between steps, of its range and of the largest |q|."""

GOLDEN_SECTION = 0.5 * (3.0 - 5.0**0.5)
"""Fraction of each step at which it is cut in two: irrational, so that a wave which has the same phase at the ends of all
steps has another phase at the cuts."""

MOST_STEPS = 1000
"""Number of steps in which a function of unknown form is sampled; they lie evenly in the run."""


def missed_impulses(d: Dynamics, t: Array) -> tuple[Array, Array]:
    """Return for each node the largest impulse that the steps miss, and that they have, in N s (n,).

    Parameters
    ----------
    d : Dynamics
    t : (nt,) array
        The instants of the run.

    Returns
    -------
    missed, had : (n,) arrays
        Zero where nothing drives, and at nodes with prescribed motion.
    """
    missed, had = np.zeros((2, len(d.nodes)))
    for i in np.flatnonzero(~d.driven):
        loads = [load for node, load in d.loads if node == i and callable(load)]
        meant = [load for load in loads if breaks(load) and not d.decomposition.static[i].any()]
        signals = [(load, 1.0, 0.0) for load in loads if load not in meant]
        signals += [(motion, -d.K[i, j], -d.C[i, j]) for j, motion in d.motions.items() if d.K[i, j] or d.C[i, j]]
        if not all(_is_resolved(signal, t) for signal, _, _ in signals):
            acts, seen = np.cumsum(np.sum([_impulses(*each, t) for each in signals], axis=0), axis=1)
            given = np.cumsum(np.sum([_integrals(load, t)[0] for load in meant], axis=0))
            missed[i] = np.abs(acts - seen).max()
            had[i] = np.abs(seen + given).max()
    return missed, had


def missed_integral(signal: Any, t: Array) -> float:
    """Return the largest integral of a function of time that the steps miss; 0 below `SEEN_FRACTION` of what they see."""
    if _is_resolved(signal, t):
        return 0.0
    acts, seen = np.cumsum(_integrals(signal, t), axis=1)
    missed = float(np.abs(acts - seen).max())
    return 0.0 if missed <= SEEN_FRACTION * np.abs(seen).max() else missed


def _is_resolved(signal: Any, t: Array, *, resolved: float = 0.5) -> bool:
    """Return whether it is known of a function of time that it is nearly a line in each step.

    ``resolved``: angle in rad by which a wave turns in a step whose line misses no more than 2 % of its impulse.
    """
    if len(t) < 2:
        return True
    if isinstance(signal, SignalSum):
        return all(_is_resolved(each, t) for each in signal.terms)
    if isinstance(signal, Harmonic):
        return bool(signal.omega * np.diff(t).max() < resolved)
    if isinstance(signal, PiecewisePolynomial):
        return bool(snapped(t, signal.breakpoints(float(t[0]), float(t[-1])))[1].all())
    return False


def _impulses(signal: Any, k: float, c: float, t: Array) -> Array:
    """Return the impulses k f + c f' of a function of time in both parts of each step, and of lines (2, 2 nt - 2)."""
    found = k * _integrals(signal, t)
    if c:
        found[0] += c * np.diff(values_at(signal, _ends_of_parts(t)))
        found[1] += c * _by_ends(values_at(signal.rate, t), np.diff(t))
    return found


def _integrals(signal: Any, t: Array) -> Array:
    """Return the integrals of a function of time over both parts of each step, and of lines between its ends (2, 2 nt - 2).

    A function of unknown form is sampled in `MOST_STEPS` steps, which stand for those between them.
    """
    ends, h = _ends_of_parts(t), np.diff(t)
    if isinstance(signal, SignalSum):
        return np.asarray(np.sum([_integrals(each, t) for each in signal.terms], axis=0))
    if isinstance(signal, Harmonic):
        turned = sine(signal.omega * ends + signal.phase) * (signal.amplitude / signal.omega)
        return np.stack([np.diff(turned), _by_ends(values_at(signal, t), h)])
    if isinstance(signal, PiecewisePolynomial):
        # Only where a step holds breakpoints does its line differ from the signal by more than the error of the method.
        times = signal.breakpoints(float(t[0]), float(t[-1]))
        stride = 1
        chosen = np.unique(np.searchsorted(t, times) - 1)
        left, right = limits_at(signal, t)
        seen = _by_ends(right, h, left)
    else:
        times, stride = t[:0], -(-len(h) // MOST_STEPS)
        chosen = np.arange(0, len(h), stride)
        values, seen = np.zeros(len(t)), np.zeros(2 * len(h))
        for k in (chosen, chosen + 1):
            values[k] = values_at(signal, t[k])
        seen.reshape(-1, 2)[chosen] = stride * _by_ends(values, h).reshape(-1, 2)[chosen]
    parts = ends[2 * chosen[:, None] + np.arange(3)]
    acts = seen.copy()
    pieces = Pieces.between(np.concatenate([parts.ravel(), times]))
    integral = pieces.integral(values_at(signal, pieces.times))
    acts.reshape(-1, 2)[chosen] = stride * np.diff(integral[np.searchsorted(pieces.cuts, parts)], axis=1)
    return np.stack([acts, seen])


def _ends_of_parts(t: Array) -> Array:
    """Return the instants of a run, with those that cut its steps in two (2 nt - 1,)."""
    found = np.empty(2 * len(t) - 1)
    found[::2] = t
    found[1::2] = (1.0 - GOLDEN_SECTION) * t[:-1] + GOLDEN_SECTION * t[1:]
    return found


def _by_ends(values: Array, h: Array, left: Array | None = None) -> Array:
    """Return the integrals over both parts of each step of the line between the values (nt,) at its ends (2 nt - 2,).

    Those at the end of a step are the ``left`` limits, where given.
    """
    begin = values[:-1]
    end = (values if left is None else left)[1:]
    whole = 0.5 * h * (begin + end)
    first = h * GOLDEN_SECTION * (begin + 0.5 * GOLDEN_SECTION * (end - begin))
    return np.stack([first, whole - first], axis=1).ravel()


def between_steps(motion: Signal, t: Array, q: Array, v: Array) -> float:
    """Return by how much a prescribed motion leaves the cubic through q and v (nt,) between the instants of a run, in m."""
    from scipy.interpolate import CubicHermiteSpline  # here, as most runs do without it

    if isinstance(motion, Described):
        times = np.union1d(_ends_of_parts(t)[1::2], motion.breakpoints(float(t[0]), float(t[-1])))
    else:
        times = _ends_of_parts(t)[1 :: 2 * -(-(len(t) - 1) // MOST_STEPS)]
    return float(np.abs(values_at(motion, times) - CubicHermiteSpline(t, q, v)(times)).max(initial=0.0))
