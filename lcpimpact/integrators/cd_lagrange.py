r"""CD-Lagrange: central differences, with an impulse for each contact that is closed at a grid point.

Velocities V belong to the midpoints of the steps,

.. math:: q^+ = q + h V, \qquad M (V^+ - V) = h F\bigl(t^+, q^+, \tfrac12 (V + V^+)\bigr) + H^T P,

with Newton's law on the rows with u(q⁺) <= 0:

.. math:: 0 \le P \perp U(V^+) + e U(V) \ge 0 .

The velocity recorded on the grid is the mean of both, at an active contact not below the later one:

.. math:: v^+ = \tfrac12 (V + V^+) + M^{-1} H^T p, \qquad 0 \le p \perp U^+ - U(V^+) \ge 0 \quad (P > 0).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from lcpimpact.arrays import Array
from lcpimpact.integrators.base import Declared
from lcpimpact.integrators.stepping.kernel import StepState
from lcpimpact.integrators.stepping.linear_step import (
    REST_GAP_FACTOR,
    Law,
    LinearStep,
    Step,
    Symbols,
    first_acceleration,
    first_reactions,
)
from lcpimpact.integrators.stepping.strong_dashpots import starting_mass
from lcpimpact.scheme.dynamics import Dynamics
from lcpimpact.scheme.structure import Feature


@dataclass(frozen=True)
class CDLagrange(LinearStep):
    """Central differences with Lagrange multipliers, explicit in the springs.

    Parameters
    ----------
    tol, max_iter : optional
        As of `TimeStepping`; rtol is refused, since V belongs to the step length.

    Notes
    -----
    M, H and F of a Lagrangian system are those at q⁺, and the law has the rows half a step later, where V⁺ is half way.

    The record holds v⁺; the next step starts from V⁺. A load that jumps at t⁺ acts there by the mean of both sides, each for
    half of the way from V to V⁺. Where the jump opens a contact, this holds back the half behind the jump, and the body
    leaves half a step late, slower by up to h/2 times its acceleration.
    """

    laws: ClassVar[int] = 2
    remembers: ClassVar[tuple[str, ...]] = ("V",)
    means: ClassVar[tuple[float, ...]] = (1.0,)
    jumps_at: ClassVar[float | None] = 1.0
    halves: ClassVar[bool] = False

    name: ClassVar[str] = "cd-lagrange"
    declared: ClassVar[Declared] = Declared(
        summary="explicit central differences with impulses at the grid points",
        order_smooth=2,
        order_loss=float("inf"),
        order_impact=1,
        order_friction=1,
        order_penetration=1,
        level="velocity",
        relative_degrees=(2,),
        handles=(Feature.SLIDERS, Feature.POWER_LAWS, Feature.RESTITUTION, Feature.LAGRANGIAN),
        moving=(Feature.FRICTION, Feature.JOINTS),
        reaction_time="at t + h, one for each step",
        energy="near its value for ever, where h is below 2/ω; recorded energies at impacts are less accurate",
        kick=1.0,
        dissipates=False,
        source="FekakBrunGravouilDepale2017; DiStasioEtAl2019",
    )

    def remember(self, d: Dynamics, q: Array, v: Array, h: float) -> dict[str, Array]:
        """Return the velocity after half a step."""
        return {"V": v + 0.5 * h * first_acceleration(d, q, v, h, starting_mass(d, h, 0.5))}

    def first_state(self, d: Dynamics, y: Array, h: float) -> StepState:
        """Return the state with the impulses in the velocity after half a step."""
        state = super().first_state(d, y, h)
        q, v, _ = np.split(y, 3)
        state.P[0] = h * first_reactions(d, q, v, h, starting_mass(d, h, 0.5))
        return state

    @property
    def reaction_at(self) -> float:
        """1."""
        return 1.0

    @property
    def law_at(self) -> float:
        """3/2, where V⁺ is half way."""
        return 1.5

    @property
    def moved_by(self) -> str:
        """V."""
        return "V"

    def equations(self, y: Symbols, d: Dynamics, h: float) -> Step:
        """Write the step."""
        V = y.memory["V"]
        P, p = y.P
        q = y.q + h * V
        # F contains C (V + V⁺)/2, of which C V⁺/2 is on the left-hand side.
        kick = y.momentum(V) + h * y.force(1.0, q, 0.5 * V) + y.push(P)
        A = d.M + 0.5 * h * d.C
        V_next = y.solve(A, kick)
        # V_next contains half of the jump of a load at t + h, and v, which has no part in it, a quarter.
        v = y.after_jump(0.5 * (V + V_next) + y.solve(d.M, y.push(p)), A, -0.25 * h)
        impact = Law(
            L=y.gap_rate(V_next) + d.restitution[:, None] * (y.first_rate if y.moving else y.gap_rate(V)),
            touching=y.gap(q + REST_GAP_FACTOR * (h * h) * y.solve(d.M, y.force(1.0, q, V))),
            springs_at=(q, 0.5 * (V + V_next)),
        )
        reading = Law(
            L=y.end.gap_rate(v) - y.gap_rate(V_next), touching=-P, strictly=True, springs_at=(q, V), weight=0.0
        )
        return Step(q=q, v=v, impulse=P, laws=(impact, reading), memory={"V": V_next})
