"""The exact solution of a linear scheme: a matrix exponential for each contact mode, with events located to rounding.

`lcpimpact.hybrid.motion` follows it from event to event, `lcpimpact.hybrid.mode_choice` chooses the mode at the start
and after each event, and `lcpimpact.hybrid.flow` finds the end of each mode and misses none.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from lcpimpact.errors import Status
from lcpimpact.hybrid.event_loop import follow
from lcpimpact.hybrid.motion import ExactSolution, HybridMotion, begin_problem, cuts
from lcpimpact.integrators.base import Declared, Integrator
from lcpimpact.numbers import count
from lcpimpact.problems.base import Problem
from lcpimpact.record import ContinuousSolution, Grid, Record
from lcpimpact.scheme.impact_laws import IMPACT_LAWS
from lcpimpact.scheme.structure import Feature


@dataclass(frozen=True)
class Exact(Integrator):
    """The piecewise matrix exponential.

    Parameters
    ----------
    max_events : int
        Maximum number of events.

    Notes
    -----
    Handles constant loads and signals, whose breakpoints end a segment, and sampled forces, which are constants between
    their instants, whatever their law is. The reaction is the force at each instant of the
    grid (its right limit at an event); impulses are in the events.
    """

    max_events: int = 100_000

    name: ClassVar[str] = "exact"
    family: ClassVar[str] = "matrix exponential"
    mode_choice: ClassVar[str] = "mode_choice.py"
    declared: ClassVar[Declared] = Declared(
        summary="matrix exponential in each contact mode, events to rounding; the reference",
        order_smooth=float("inf"),
        order_loss=float("inf"),
        order_force_jump=float("inf"),
        order_force_kink=float("inf"),
        order_impact=float("inf"),
        order_friction=float("inf"),
        order_relay=float("inf"),
        order_penetration=float("inf"),
        level="position and velocity",
        relative_degrees=(0, 1, 2),
        handles=tuple(
            each
            for each in Feature
            if each not in (Feature.POWER_LAWS, Feature.DASHPOTS, Feature.FORCES, Feature.LAGRANGIAN)
        ),
        impact_laws=tuple(IMPACT_LAWS),
        reaction_time="at t, right limit",
        energy="exact",
        balances_energy=True,
        dissipates=True,
        accuracy=1e-12,
        source="vanderSchaftSchumacher1998, modes by the linear dynamic complementarity problem",
    )

    def __post_init__(self) -> None:
        count("max_events", self.max_events)

    def motion(self, problem: Problem, end: float, lcp_solver: str) -> HybridMotion:
        """Return the motion up to an instant."""
        return begin_problem(problem, self.name, end, lcp_solver, self.max_events)

    def start(self, problem: Problem, grid: Grid, lcp_solver: str, record: Record) -> HybridMotion:
        """Choose the first mode, after impacts at t = 0."""
        record.events = []
        return self.motion(problem, grid.t_end, lcp_solver)

    def advance(self, carry: HybridMotion, record: Record, first: int, last: int) -> tuple[Status, int]:
        """Follow the events to t_last."""
        status = follow(carry, float(record.t[last]))
        if status is not Status.SOLVED:
            last = first + int(np.searchsorted(record.t[first : last + 1], carry.next_event[0].hi)) - 1
        return status, last

    def finish(self, carry: HybridMotion, record: Record) -> None:
        """Hand over the events, and the motion on the grid."""
        record.events = carry.events
        carry.solution = ExactSolution.of(carry)
        record.q[:], record.v[:], record.reaction[:] = carry.solution.of_record(record.t)

    def dense(self, carry: HybridMotion) -> ContinuousSolution:
        """Return the solution at any times of the run."""
        solution = carry.solution or ExactSolution.of(carry)
        return ContinuousSolution(solution, *cuts(carry))
