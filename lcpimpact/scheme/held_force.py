r"""Held forces: set at instants by a function of the time and of the state there, and constant until the next.

.. math:: f(t) = g(t_k, q(t_k), v(t_k^+)), \qquad t_k \le t < t_{k+1}, \qquad t_k = φ + k T, \quad k = 0, 1, 2, \dots

Between two instants they are constant loads, so that the motion is that of the discrete-time loop with a zero-order hold
(Åström and Wittenmark, *Computer-Controlled Systems* (1997)). Before φ they are zero. Where an impact falls on an
instant, v(t_k^+) is the velocity after it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from lcpimpact.arrays import Array
from lcpimpact.errors import InputError
from lcpimpact.formula import NotTracedError, mentions
from lcpimpact.scheme.force_law import ForceLaw
from lcpimpact.scheme.signals import MAX_BREAKPOINTS, Table


@dataclass(frozen=True)
class HeldForce:
    """Forces on some nodes, by a law of their own coordinates and velocities at the instants phase + k period.

    Attributes
    ----------
    law : ForceLaw              the law g
    at : tuple of k int         the positions of its nodes in q
    period, phase : float       T and φ in s
    """

    law: ForceLaw
    at: tuple[int, ...]
    period: float
    phase: float

    def __post_init__(self) -> None:
        if mentions(self.period) or mentions(self.phase):
            raise NotTracedError(f"{self.law.element}: its instants are none of the run")

    def __call__(self, t: float, q: Array, v: Array, *, beyond: float = 1e150) -> Array:
        """Return the forces in N that are set at t, for q and v of its nodes (k,); NaN in a state beyond all numbers.

        ``beyond``: place or velocity whose square is no number, where an unstable loop ends.

        Raises
        ------
        InputError
            If the law gives no finite numbers.
        """
        if not np.abs([q, v]).max() < beyond:
            return np.full(len(q), np.nan)
        forces = self.law(t, q, v)
        if not np.isfinite(forces).all():
            raise InputError(
                f"{self.law.element}: f gives {forces.tolist()} at t = {t:g} s for q = {q.tolist()} and v = {v.tolist()}; "
                "return finite numbers"
            )
        return forces

    def sets_at(self, t: float) -> bool:
        """Return whether t is one of its instants."""
        k = round((t - self.phase) / self.period)
        return k >= 0 and self.phase + k * self.period == t

    def breakpoints(self, start: float, end: float) -> Array:
        """Return its instants in start < t <= end, in their order.

        Raises
        ------
        InputError
            If they are more than a million.
        """
        count = (end - max(start, self.phase)) / self.period
        if not count <= MAX_BREAKPOINTS:
            raise InputError(
                f"{self.law.element} is set {count:.1e} times until {end:g} s, and at most {MAX_BREAKPOINTS:,} times are "
                "followed: shorten the run, or take a longer period"
            )
        first = max(math.floor((start - self.phase) / self.period) - 1, 0)
        last = math.ceil((end - self.phase) / self.period) + 1
        t = self.phase + np.arange(first, max(last, first) + 1, dtype=np.float64) * self.period
        return t[(t > start) & (t <= end)]

    def instants(self, end: float) -> Array:
        """Return its instants in 0 <= t <= end."""
        return np.concatenate([[0.0] if self.sets_at(0.0) else [], self.breakpoints(0.0, end)])

    def check(self, q: Array, v: Array) -> None:
        """Refuse a law that fails at its first instant with q and v of its nodes (k,), or that keeps a memory.

        Raises
        ------
        InputError
            If it gives no finite numbers, or others when it is asked again.
        """
        first, second = self(self.phase, q, v), self(self.phase, q, v)
        if (first != second).any():
            raise InputError(
                f"{self.law.element}: f gives {first.tolist()} and {second.tolist()} for the same t, q and v: it must be a "
                "function of these alone, without a memory or random numbers of its own"
            )

    def loads(self, end: float, read: Callable[[Array], tuple[Array, Array]]) -> list[tuple[int, float | Table]]:
        """Return the loads that it was up to ``end``, with the nodes; ``read(t)`` gives q and v at t (nt, n)."""
        t = self.instants(end)
        if not len(t):
            return []
        q, v = (each[:, self.at] for each in read(t))
        forces = np.nan_to_num([self(at, *state) for at, *state in zip(t.tolist(), q, v, strict=True)])
        before = forces[0] if t[0] == 0.0 else 0.0 * forces[0]
        values = np.repeat(np.vstack([before, forces]), 2, axis=0)[1:-1]
        times = tuple(np.repeat(t, 2).tolist())
        return [(i, Table(times, tuple(each))) for i, each in zip(self.at, values.T.tolist(), strict=True)]
