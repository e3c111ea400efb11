r"""Motion of a Lagrangian system by a Runge-Kutta method with the steps of a grid, from event to event.

In a mode the accelerations are functions of time and state, X' = f(t, X), and a step is

.. math:: K_i = f\Bigl(t + c_i h, X + h \sum_j a_{ij} K_j\Bigr), \qquad X^+ = X + h \sum_i b_i K_i ,

after which X is projected onto closed gaps, joints and zero rates. Events are found within a step on polynomials through
both its ends, of degree 5 for q and 3 for v; the next step leads to the next instant of the grid.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.integrate import DenseOutput, OdeSolver

from lcpimpact.arrays import Array
from lcpimpact.hybrid.dense_output import DENSE_DEGREE, samples_of
from lcpimpact.hybrid.moving import MovingMotion, MovingSegment, SolverOptions, expected_scale_of_motion
from lcpimpact.numerics.rounding import EPS
from lcpimpact.problems.base import Problem
from lcpimpact.record import Grid, Record
from lcpimpact.scheme.lagrangian import LagrangianDynamics

EVENT_RTOL = 1e-9
"""Part of the motion by which functions that are zero for ever may fall below zero before they end a mode."""

MAX_EVENTS = 100_000
"""Maximum number of events in a run."""


class Stages(NamedTuple):
    """A Runge-Kutta method: a (s, s), and b and c (s,)."""

    a: Array
    b: Array
    c: Array


@dataclass(eq=False, kw_only=True)
class GridMotion(MovingMotion):
    """A motion by the steps of a grid."""

    grid: Grid
    stages: Stages

    @classmethod
    def start(
        cls, problem: Problem, grid: Grid, lcp_solver: str, record: Record, method: str, stages: Stages
    ) -> GridMotion:
        """Begin a motion, whose reactions are recorded at all instants."""
        d = problem.dynamics
        assert isinstance(d, LagrangianDynamics)
        q, v = problem.initial_coordinates, problem.initial_velocities
        record.events = []
        record.t_reaction = record.t
        record.reaction = np.zeros((len(record.t), len(d.contacts)))
        most = 2 * grid.steps + MAX_EVENTS
        motion = cls(
            d, grid.t_end, lcp_solver, MAX_EVENTS, np.zeros(0), np.abs(np.concatenate([q, v])), events=record.events,
            options=SolverOptions(GridSteps, EVENT_RTOL, None, math.inf, most, 1.0 / grid.steps), stats=record.stats,
            samples=samples_of(DENSE_DEGREE), expected=expected_scale_of_motion(d, q, v, grid.t_end),
            grid=grid, stages=stages,
        )  # fmt: skip
        motion.begin(problem, record, method)
        return motion

    def _solver(self, segment: MovingSegment, X: Array, *, max_phase: float = 2.0) -> OdeSolver:
        """Return the steps that start from X; they are as long as those of the grid, whatever vibrates."""
        sizes = np.maximum(self.scale, self.expected).reshape(2, -1).max(axis=1)
        return GridSteps(segment, X, self.grid, self.stages, np.repeat(sizes, len(X) // 2))


class GridSteps(OdeSolver):  # type: ignore[misc]
    """Steps of a mode to the instants of a grid; one without a result is halved."""

    t: float
    y: Array

    def __init__(self, segment: MovingSegment, X: Array, grid: Grid, stages: Stages, sizes: Array) -> None:
        super().__init__(segment.rate, 0.0, X, segment.end - segment.t0, vectorized=False)
        self.segment = segment
        self.grid = grid
        self.stages = stages
        self.sizes = sizes
        self.f = self.fun(self.t, self.y)
        self.start = self.t, self.y, self.f

    def _step_impl(self, *, shortest: float = 1e-12) -> tuple[bool, str | None]:
        """Take a step."""
        t, grid = self.segment.t0 + self.t, self.grid
        # An event may be at an instant of the grid but for rounding.
        k = int(np.floor(t / grid.h * (1.0 + 4.0 * EPS) + 4.0 * EPS)) + 1
        ahead = self.t_bound if k >= grid.steps else float(grid.times(k, k)[0]) - self.segment.t0
        h = ahead - self.t
        while h > shortest * grid.h:
            X, rate = self._stepped(h)
            if np.isfinite(X).all() and np.isfinite(rate).all():
                self.start = self.t, self.y, self.f
                self.t = ahead if self.t + h >= ahead else self.t + h
                self.y, self.f = X, rate
                return True, None
            h *= 0.5
        return False, "no step has a result"

    def _stepped(self, h: float) -> tuple[Array, Array]:
        """Return X after a step of length h, and X' there."""
        rk = self.stages
        K = np.tile(self.f, (len(rk.b), 1))
        if np.triu(rk.a).any():
            K = self._collocated(h, K)
        else:
            for i in range(1, len(K)):
                K[i] = self.fun(self.t + rk.c[i] * h, self.y + h * rk.a[i, :i] @ K[:i])
        X = self.y + h * rk.b @ K
        X = self.segment.held(self.t + h, X) if np.isfinite(X).all() else X
        return X, self.fun(self.t + h, X) if np.isfinite(X).all() else X

    def _collocated(self, h: float, K: Array, *, most: int = 40) -> Array:
        """Return X' at the stages (s, N) of an implicit method, by a simplified Newton iteration; NaN if it does not end."""
        rk = self.stages
        matrix = np.eye(K.size) - h * np.kron(rk.a, self.segment.slopes(self.t, self.y))
        for _ in range(most):
            off = np.array([self.fun(self.t + c * h, X) for c, X in zip(rk.c, self.y + h * rk.a @ K, strict=True)]) - K
            change = np.linalg.solve(matrix, off.ravel()).reshape(K.shape)
            K = K + change
            if (h * np.abs(change) <= 64.0 * EPS * self.sizes).all():
                return K
        return np.full_like(K, np.nan)

    def _dense_output_impl(self) -> DenseOutput:
        return GridDense(*self.start, self.t, self.y, self.f)


class GridDense(DenseOutput):  # type: ignore[misc]
    """The polynomials through both ends of a step."""

    def __init__(self, t0: float, X0: Array, f0: Array, t1: float, X1: Array, f1: Array) -> None:
        super().__init__(t0, t1)
        n, h = len(X0) // 2, t1 - t0
        self.h, self.X0 = h, X0
        Δ = X1 - X0
        d0, d1 = h * f0, h * f1
        # In powers of s from 1 on: the cubic of each state, and for q what the accelerations at both ends add.
        self.powers = np.array([d0, 3.0 * Δ - 2.0 * d0 - d1, d0 + d1 - 2.0 * Δ, 0.0 * Δ, 0.0 * Δ])
        end = np.zeros((2, len(X0)))
        end[:, :n] = h * h * np.array([f0[n:], f1[n:]])
        end -= np.array([2.0 * self.powers[1], 2.0 * self.powers[1] + 6.0 * self.powers[2]])
        end[:, n:] = 0.0
        # s² (1 - s)² (α + β s) has the second derivatives 2 α and 2 (α + β) at the ends.
        α, β = 0.5 * end[0], 0.5 * (end[1] - end[0])
        self.powers[1:] += np.array([α, β - 2.0 * α, α - 2.0 * β, β])

    def _call_impl(self, t: ArrayLike) -> Array:
        s = (np.asarray(t) - self.t_old) / self.h
        found = np.zeros(np.shape(np.multiply.outer(self.X0, s)))
        for power in self.powers[::-1]:
            found = (found.T + power).T * s
        return (found.T + self.X0).T
