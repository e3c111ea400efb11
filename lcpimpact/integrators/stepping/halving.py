r"""Adaptive steps by halving: a step is halved until it agrees with two half steps.

With y = (q, v, ...) the state, Φ_h one step of length h <= dt, and ε = rtol max |q|, two halves are accepted where

.. math:: \max\bigl( |Φ_{h/2}^2 q - Φ_h q|, \; dt \, |Φ_{h/2}^2 v - Φ_h v| \bigr) \le ε,
          \qquad -Σ u^+ \le \max(ε, -Σ u) \quad (\text{impulse paths}),

with norms over the nodes with mass and sums over the contacts of an impulse path, mostly a contact of relative degree 2;
otherwise each half is treated likewise. In smooth motion the difference is the error of the whole step. Near an impact the
whole step and the halves differ by the displacement due to the jump of v, and an impact that both detect late shows as a
penetration; so steps are halved until these are below ε, which locates the impact. A step whose LCP has no solution, as one
too long for an explicit method, is halved, too. Both keep one λ of a relay that switches in the first half, and agree: so
h |B Δλ| of a relay that comes to a bound or leaves it counts as a difference.

The trajectory holds the accepted steps, of length at most dt. A run that needs a step so short that the motion in it is
below rounding error, as for accumulating impacts and a tight rtol, ends with the status STEP_SIZE.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from lcpimpact.arrays import Array, Flags
from lcpimpact.errors import Status
from lcpimpact.numerics.rounding import EPS
from lcpimpact.record import SLIP_RTOL, Grid, Record
from lcpimpact.scheme.dynamics import Dynamics

Take = Callable[[int, float, Array], tuple[Status, Array, Array]]
"""take(level, t, y): one step of length h/2^level from y at t; returns the status, y, and the reactions (nc,)."""


@dataclass
class Halving:
    """Step control by halving, with the accepted steps.

    Attributes
    ----------
    take : callable         one step of a level
    h : float               the longest step in s
    rtol : float            tolerance of a step, relative to the largest |q| so far
    massive : (n,) array    nodes whose q and v are compared; q of all if none has mass
    penetration : callable      largest -Σ u in m along an impulse path, for t and q (n,)
    switched : callable     what relays that go to a bound or leave it change at q and its rate, between two reactions (n,)
    y : (N,) array          the state, q and v first
    """

    take: Take
    h: float
    rtol: float
    massive: Flags
    penetration: Callable[[float, Array], float]
    switched: Callable[[Array, Array], Array]
    y: Array
    scale: float = 0.0
    rejected: int = 0
    t: list[float] = field(default_factory=lambda: [0.0])
    path: list[Array] = field(default_factory=list)
    reactions: list[Array] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.path.append(self.y)

    def advance(self, grid: Grid, first: int, last: int, begin: Callable[[int, Array], None]) -> tuple[Status, int]:
        """Take the steps of the grid from t_first to t_last; ``begin(k, y)`` changes the state where step k begins."""
        for k in range(first, last):
            begin(k, self.y)
            t, end = grid.times(k, k + 1)
            status = self._halve(0, t, end, *self.take(0, t, self.y)[:2])
            if status is not Status.SOLVED:
                return status, k
        return Status.SOLVED, last

    def _halve(
        self,
        level: int,
        t: float,
        end: float,
        solved: Status,
        whole: Array,
        *,
        motion_rtol: float = 32.0 * EPS,
        max_halvings: int = 40,
    ) -> Status:
        """Integrate from t to the end in two steps, or in more if these differ from the whole one or have no solution.

        ``motion_rtol``: displacement of a step, relative to the largest |q|, below which the motion in it is
        below rounding error.
        ``max_halvings``: maximum number of times a step whose LCP has no solution is halved, as where an
        explicit method is unstable.
        """
        middle = 0.5 * (t + end)
        first, y_1, r_1 = self.take(level + 1, t, self.y)
        status, states = first, [self.y]
        if first is Status.SOLVED:
            status, y_2, r_2 = self.take(level + 1, middle, y_1)
            states.append(y_1)
        if status is Status.SOLVED:
            states.append(y_2)
            before = self.reactions[-1] if self.reactions else r_1
            # A switch in the first half is not seen by comparing: it may be anywhere in it.
            switched = (end - t) * (self.switched(before, r_1) + self.switched(r_1, r_2))
            if solved is Status.SOLVED and self._agree(whole, y_2, switched, (t, end)):
                for time, y, r in ((middle, y_1, r_1), (end, y_2, r_2)):
                    self.t.append(time)
                    self.path.append(y)
                    self.reactions.append(r)
                self.y = y_2
                return Status.SOLVED
        n = len(self.massive)
        failure = next((each for each in (status, solved) if each is not Status.SOLVED), None)
        if failure is not None and level == max_halvings:
            return failure
        if failure is None and (end - t) * max(np.abs(y[n : 2 * n]).max() for y in states) <= motion_rtol * self.scale:
            return Status.STEP_SIZE
        self.rejected += 1
        status = self._halve(level + 1, t, middle, first, y_1)
        if status is not Status.SOLVED:
            return status
        return self._halve(level + 1, middle, end, *self.take(level + 1, middle, self.y)[:2])

    def _agree(self, whole: Array, halves: Array, switched: Array, span: tuple[float, float]) -> bool:
        """Return whether the whole step and its two halves agree, without additional penetration.

        ``switched`` (n,) are the errors of q by relays that switch at an instant of the ``span`` that is not known.
        """
        n = len(self.massive)
        off = np.abs(halves - whole)
        off[:n] += switched
        for y in (self.y, halves):
            self.scale = max(self.scale, np.abs(y[:n]).max(), self.h * np.abs(y[n : 2 * n]).max())
        allowed = self.rtol * self.scale
        judged = self.massive if self.massive.any() else ~self.massive
        difference = max(off[:n][judged].max(), self.h * off[n : 2 * n][self.massive].max(initial=0.0))
        before, after = (self.penetration(t, y[:n]) for t, y in zip(span, (self.y, halves), strict=True))
        return bool(difference <= allowed and after <= max(allowed, before))

    def write(self, record: Record, reaction_at: float) -> None:
        """Replace the grid by the accepted steps; reactions refer to t + ``reaction_at`` times the step."""
        n, nc = len(self.massive), record.reaction.shape[1]
        path = np.array(self.path)
        record.t = np.array(self.t)
        record.q = path[:, :n].copy()
        record.v = path[:, n : 2 * n].copy()
        record.t_reaction = record.t[:-1] + reaction_at * np.diff(record.t)
        record.reaction = np.array(self.reactions).reshape(len(self.reactions), nc)
        record.stats.rejected = self.rejected


def switched(dynamics: Dynamics) -> Callable[[Array, Array], Array]:
    """Return the function of two reactions that is the change of the rates by relays between a bound and elsewhere (n,)."""
    rows = dynamics.switches & ~(np.diag(dynamics.D) > 0.0)
    low = dynamics.r_min[rows]
    high = dynamics.r_max[rows]
    B = np.abs(dynamics.B[:, rows])

    def changes(before: Array, after: Array) -> Array:
        near = SLIP_RTOL * (high - low)
        sides = [(r[rows] >= high - near) * 1.0 - (r[rows] <= low + near) for r in (before, after)]
        return B @ np.where(sides[0] != sides[1], np.abs(after - before)[rows], 0.0)

    return changes


def penetration(dynamics: Dynamics) -> Callable[[float, Array], float]:
    """Return the function of t and q that is the largest penetration along impulse paths in m, at least 0."""
    paths = dynamics.impulse_paths
    return lambda t, q: float(-(paths @ dynamics.gap(t, q)).min(initial=0.0))
