r"""Adaptive steps by halving: a step is taken whole and in two halves, and halved until both agree.

With y = (q, v, ...) the state, Φ_h one step of length h <= dt, and ε = rtol max |q|, two halves are accepted where

.. math:: \max\bigl( |Φ_{h/2}^2 q - Φ_h q|, \; dt \, |Φ_{h/2}^2 v - Φ_h v| \bigr) \le ε,
          \qquad -u^+ \le \max(ε, -u) \quad (\text{relative degree 2}),

the norms over the nodes with mass; otherwise each half is treated likewise. In smooth motion the difference is the error
of the whole step. About an impact the whole and the halves differ by the way that the jump of v makes in a part of the
step, and an impact that they both see too late shows as an overlap; so the steps there are halved until such a way is below
ε, which locates the impact. The run holds the steps that were taken, and dt is the longest. A run in which a step would
have to be so short that nothing moves in it but by rounding, as where impacts accumulate and rtol is tight, ends with the
status STEP_SIZE.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from lcpimpact.arrays import Array, Flags
from lcpimpact.errors import Status
from lcpimpact.integrators.base import Grid, Record
from lcpimpact.scheme.dynamics import Dynamics

ROUNDING = 32.0 * np.finfo(float).eps
"""A way this short, relative to the largest |q|, is rounding."""

Take = Callable[[int, float, Array], tuple[Status, Array, Array]]
"""take(level, t, y): one step of length h/2^level from y at t; returns the status, y, and the reactions (nc,)."""


@dataclass
class Halving:
    """Takes steps by halving, and keeps those that were accepted.

    Attributes
    ----------
    take : callable         one step of a level
    h : float               the longest step in s
    rtol : float            tolerance of a step, relative to the largest |q| so far
    massive : (n,) array    the nodes whose q and v are judged; q of all where none has mass
    overlap : callable      the greatest -u in m of the rows of relative degree 2, for q (n,)
    y : (N,) array          the state, q and v first
    """

    take: Take
    h: float
    rtol: float
    massive: Flags
    overlap: Callable[[Array], float]
    y: Array
    scale: float = 0.0
    rejected: int = 0
    t: list[float] = field(default_factory=lambda: [0.0])
    path: list[Array] = field(default_factory=list)
    reactions: list[Array] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.path.append(self.y)

    def advance(self, grid: Grid, first: int, last: int) -> tuple[Status, int]:
        """Take the steps of the grid from t_first to t_last."""
        for k in range(first, last):
            t, end = grid.times(k, k + 1)
            status, whole, _ = self.take(0, t, self.y)
            if status is Status.SOLVED:
                status = self._halve(0, t, end, whole)
            if status is not Status.SOLVED:
                return status, k
        return Status.SOLVED, last

    def _halve(self, level: int, t: float, end: float, whole: Array) -> Status:
        """Go from t to the end in two steps, or in more if these differ from the whole one."""
        middle = 0.5 * (t + end)
        status, y_1, r_1 = self.take(level + 1, t, self.y)
        if status is not Status.SOLVED:
            return status
        status, y_2, r_2 = self.take(level + 1, middle, y_1)
        if status is not Status.SOLVED:
            return status
        n = len(self.massive)
        off = np.abs(y_2 - whole)
        for y in (self.y, y_2):
            self.scale = max(self.scale, np.abs(y[:n]).max(), self.h * np.abs(y[n : 2 * n]).max())
        allowed = self.rtol * self.scale
        judged = self.massive if self.massive.any() else ~self.massive
        difference = max(off[:n][judged].max(), self.h * off[n : 2 * n][self.massive].max(initial=0.0))
        if difference <= allowed and self.overlap(y_2[:n]) <= max(allowed, self.overlap(self.y[:n])):
            for time, y, r in ((middle, y_1, r_1), (end, y_2, r_2)):
                self.t.append(time)
                self.path.append(y)
                self.reactions.append(r)
            self.y = y_2
            return Status.SOLVED
        if (end - t) * max(np.abs(y[n : 2 * n]).max() for y in (self.y, y_1, y_2)) <= ROUNDING * self.scale:
            return Status.STEP_SIZE
        self.rejected += 1
        status = self._halve(level + 1, t, middle, y_1)
        if status is not Status.SOLVED:
            return status
        status, whole, _ = self.take(level + 1, middle, self.y)
        return self._halve(level + 1, middle, end, whole) if status is Status.SOLVED else status

    def write(self, record: Record, reaction_at: float) -> None:
        """Put the steps that were taken in place of the grid; reactions live at t + ``reaction_at`` times the step."""
        n, nc = len(self.massive), record.reaction.shape[1]
        path = np.array(self.path)
        record.t, record.q, record.v = np.array(self.t), path[:, :n].copy(), path[:, n : 2 * n].copy()
        record.t_reaction = record.t[:-1] + reaction_at * np.diff(record.t)
        record.reaction = np.array(self.reactions).reshape(len(self.reactions), nc)
        record.stats["rejected"] = self.rejected


def overlap(dynamics: Dynamics) -> Callable[[Array], float]:
    """Return the function of q that is the greatest overlap of contacts of relative degree 2 in m, at least 0."""
    rows = (dynamics.relative_degree == 2) & ~dynamics.slides
    H, u0 = dynamics.H[rows], dynamics.u0[rows]
    return lambda q: float(-(H @ q + u0).min(initial=0.0))
