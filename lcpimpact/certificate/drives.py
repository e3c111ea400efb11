r"""Loads and prescribed motions between the instants of a run: what steps that are too long do not see of them.

A method knows a load at some instants of a step, and takes it as smooth between them. A blow that is over before the next
instant is missed, and a load that turns once in a step acts as a constant one. The impulse that a run misses is

.. math:: \left|\int_0^t (f - \bar f)\,dt\right|, \qquad f = f(t) - K y - C y',

with the forces of springs and dashpots that lead to nodes with prescribed motions y, and the line f̄ between the values of
f at the ends of each step.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from lcpimpact.arrays import Array
from lcpimpact.certificate.quadrature import Pieces
from lcpimpact.scheme.dynamics import Dynamics
from lcpimpact.scheme.signals import Harmonic, PiecewisePolynomial, Signal, values_at
from lcpimpact.scheme.waves import sine

SPLIT = 0.5 * (3.0 - 5.0**0.5)
"""Where each step is cut in two, by the golden section: there no wave that returns with the steps returns too."""

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
        parts = [_parts_of_steps(load, t) for node, load in d.loads if node == i and callable(load)]
        parts += [
            _by_motion(motion, t, d.K[i, j], d.C[i, j]) for j, motion in d.motions.items() if d.K[i, j] or d.C[i, j]
        ]
        if parts:
            acts, seen = (np.cumsum(np.sum(each, axis=0)) for each in zip(*parts, strict=True))
            missed[i], had[i] = np.abs(acts - seen).max(), np.abs(seen).max()
    return missed, had


def _by_motion(motion: Signal, t: Array, k: float, c: float) -> tuple[Array, Array]:
    """Return what `_parts_of_steps` does of the force -k y - c y' of a prescribed motion y."""
    acts, seen = _parts_of_steps(motion, t)
    rises, moves = np.diff(values_at(motion, _ends_of_parts(t))), _by_ends(values_at(motion.rate, t), np.diff(t))
    return -k * acts - c * rises, -k * seen - c * moves


def _parts_of_steps(signal: Any, t: Array) -> tuple[Array, Array]:
    """Return the integrals of a function of time over both parts of each step, and those of the line between its ends.

    A function of unknown form is sampled in `MOST_STEPS` steps, which stand for those between them. (2 nt - 2,) each.
    """
    steps, ends = len(t) - 1, _ends_of_parts(t)
    if isinstance(signal, Harmonic):
        turned = sine(signal.omega * ends + signal.phase) * (signal.amplitude / signal.omega)
        return np.diff(turned), _by_ends(values_at(signal, t), np.diff(t))
    if isinstance(signal, PiecewisePolynomial):
        cuts = np.union1d(ends, signal.breakpoints(float(t[0]), float(t[-1])))
        pieces = Pieces(cuts)
        integral = pieces.integral(values_at(signal, pieces.times))
        return np.diff(integral[np.searchsorted(cuts, ends)]), _by_ends(values_at(signal, t), np.diff(t))
    stride = -(-steps // MOST_STEPS)
    acts, seen = np.zeros((2, steps, 2))
    for k in range(0, steps, stride):
        step, pieces = t[k : k + 2], Pieces(ends[2 * k : 2 * k + 3])
        acts[k] = stride * pieces.each(values_at(signal, pieces.times))
        seen[k] = stride * _by_ends(values_at(signal, step), np.diff(step))
    return acts.ravel(), seen.ravel()


def _ends_of_parts(t: Array) -> Array:
    """Return the instants of a run, with those that cut its steps in two (2 nt - 1,)."""
    found = np.empty(2 * len(t) - 1)
    found[::2], found[1::2] = t, (1.0 - SPLIT) * t[:-1] + SPLIT * t[1:]
    return found


def _by_ends(values: Array, h: Array) -> Array:
    """Return the integrals over both parts of each step of the line between the values (nt,) at its ends (2 nt - 2,)."""
    whole = 0.5 * h * (values[:-1] + values[1:])
    first = h * SPLIT * (values[:-1] + 0.5 * SPLIT * np.diff(values))
    return np.stack([first, whole - first], axis=1).ravel()


def between_steps(motion: Signal, t: Array, q: Array, v: Array) -> float:
    """Return by how much a prescribed motion leaves the cubic through q and v (nt,) between the instants of a run, in m."""
    if isinstance(motion, PiecewisePolynomial):
        cuts = motion.breakpoints(float(t[0]), float(t[-1]))
        times = np.union1d(_ends_of_parts(t)[1::2], cuts)
    else:
        stride = 1 if isinstance(motion, Harmonic) else -(-(len(t) - 1) // MOST_STEPS)
        times = _ends_of_parts(t)[1 :: 2 * stride]
    return float(np.abs(values_at(motion, times) - CubicHermiteSpline(t, q, v)(times)).max(initial=0.0))
