"""Base class of the time-stepping methods: options, blocks of steps, fallback solvers, step halving."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import ClassVar, Generic, Protocol, TypeVar

import numpy as np

from lcpimpact.arrays import Array
from lcpimpact.errors import InputError, Status
from lcpimpact.integrators.base import Integrator
from lcpimpact.integrators.stepping.halving import Halving, penetration, switched
from lcpimpact.integrators.stepping.held_forces import HeldSteps
from lcpimpact.integrators.stepping.kernel import StepState
from lcpimpact.lcp import SOLVERS
from lcpimpact.lcp.operators import Dense
from lcpimpact.lcp.solve import limits
from lcpimpact.lcp.solver import SolverState
from lcpimpact.numbers import is_real
from lcpimpact.problems.base import Problem
from lcpimpact.record import Grid, Record, Stats
from lcpimpact.scheme.dynamics import Dynamics

LONGEST_STEP = 1e150
"""Longest step in s: its square is a number, with room for masses and stiffnesses beside it."""


class Prepared(Protocol):
    """A prepared step of one length, with the solver of its LCP."""

    @property
    def contacts(self) -> Dense:
        """The matrix of the LCP."""

    @property
    def solver(self) -> SolverState:
        """The solver prepared for it."""


S = TypeVar("S", bound=Prepared)


@dataclass(frozen=True, eq=False)
class SteppingRun(Generic[S]):
    """State carried from block to block: the motion, the prepared steps by halving level, and the step control.

    ``times(first, last)`` are the instants between two steps, and ``held`` sets the sampled forces.
    """

    dynamics: Dynamics
    grid: Grid
    times: Callable[[int, int], Array]
    lcp_solver: str
    state: StepState
    steps: dict[int, S]
    halving: Halving | None
    held: HeldSteps


@dataclass(frozen=True)
class TimeStepping(Integrator, Generic[S]):
    """A time-stepping method: one LCP or more in each step.

    Parameters
    ----------
    tol : float, optional
        Largest LCP residual, in units where max |W| = max |q| = 1; by default what the LCP solver declares.
    max_iter : int, optional
        Limit of LCP iterations in a step; by default what the LCP solver declares.
    rtol : float, optional
        Halve steps until two halves agree with the whole to rtol max |q|; see
        `lcpimpact.integrators.stepping.halving`. Then dt is the longest step, and the trajectory holds the accepted ones.

    Raises
    ------
    InputError
        If tol or max_iter is not positive, or rtol lies outside [1e-12, 1) or is given to a method that cannot halve.
    """

    tol: float | None = None
    max_iter: int | None = None
    rtol: float | None = None

    family: ClassVar[str] = "Moreau time stepping"
    halves: ClassVar[bool] = True
    """Whether steps of different length may follow each other: not if the memory depends on h."""

    def __post_init__(self) -> None:
        limits(SOLVERS["auto"], self.tol, self.max_iter)
        if self.rtol is not None and (not is_real(self.rtol) or not 1e-12 <= self.rtol < 1.0):
            raise InputError(f"rtol = {self.rtol!r} must lie between 1e-12 and 1, or be None for steps of dt")
        if self.rtol is not None and not self.halves:
            raise InputError(
                f"rtol = {self.rtol!r}: the steps of {self.name} must all have one length; leave rtol out, or take "
                "method='moreau-jean', which can halve them"
            )

    @property
    @abstractmethod
    def reaction_at(self) -> float:
        """Instant of the mean force of a step, in units of the step."""

    @abstractmethod
    def prepare(self, d: Dynamics, h: float, lcp_solver: str) -> S:
        """Return the constant data of steps of length h."""

    def prepared(self, d: Dynamics, h: float, lcp_solver: str) -> S:
        """Return the constant data of steps of length h, which may be those of an earlier run."""
        return self.prepare(d, h, lcp_solver)

    @abstractmethod
    def begin(self, d: Dynamics, q: Array, v: Array, h: float) -> Array:
        """Return the state at t = 0: q, v and other memory (N,)."""

    @abstractmethod
    def first_state(self, d: Dynamics, y: Array, h: float) -> StepState:
        """Return the initial state of the steps, with y."""

    def reaction_times(self, grid: Grid) -> Array:
        """Return one instant for each step, which rounding does not put outside it."""
        t = grid.times(0, grid.steps)
        instants = np.diff(t)
        instants *= self.reaction_at
        instants += t[:-1]
        return instants

    def start(self, problem: Problem, grid: Grid, lcp_solver: str, record: Record) -> SteppingRun[S]:
        """Write the initial state and the prescribed motion, and prepare the step."""
        if grid.h > LONGEST_STEP:
            raise InputError(
                f"dt = {grid.h:g} s is longer than {LONGEST_STEP:g} s, and dt² no number: take a smaller dt"
            )
        d = problem.dynamics
        record.q[0] = problem.initial_coordinates
        record.v[0] = problem.initial_velocities
        record.q[0, d.driven], record.v[0, d.driven] = d.motion(0.0)
        first = d.at(0.0, record.q[0], record.v[0])
        y = self.begin(first, record.q[0], record.v[0], grid.h)
        run = SteppingRun(
            d,
            grid,
            grid.times,
            lcp_solver,
            self.first_state(first, y, grid.h),
            {0: self.prepared(d, grid.h, lcp_solver)},
            halving=None,
            held=HeldSteps.of(d, grid),
        )
        if self.rtol is None:
            return run

        def take(level: int, t: float, y: Array) -> tuple[Status, Array, Array]:
            return self._take(run, record.stats, level, t, y)

        return replace(run, halving=Halving(take, grid.h, self.rtol, d.massive, penetration(d), switched(d), y))

    def finish(self, carry: SteppingRun[S], record: Record) -> None:
        """Replace the grid by the accepted steps."""
        if carry.halving:
            carry.halving.write(record, self.reaction_at)

    def _take(self, carry: SteppingRun[S], stats: Stats, level: int, t: float, y: Array) -> tuple[Status, Array, Array]:
        """Take one step of length h/2^level from y at t."""
        d, h = carry.dynamics, carry.grid.h / 2**level
        if level not in carry.steps:
            carry.steps[level] = self.prepared(d, h, carry.lcp_solver)
        n, times = len(d.nodes), np.array([t, t + h])
        one = Record(times, np.empty((2, n)), np.empty((2, n)), times[:1], np.empty((1, len(d.contacts))), stats=stats)
        state = carry.state._replace(y=y.copy())
        alone = replace(carry, halving=None, held=HeldSteps({}, n))  # a force that is held is in y
        step = replace(alone, times=lambda *_: times, state=state, steps={0: carry.steps[level]})
        status, _ = self.advance(step, one, 0, 1)
        return status, state.y, one.reaction[0]
