r"""Moreau's midpoint rule: half a step of the coordinates, the velocities with impulses, the other half.

.. math:: q_M = q + \tfrac h2 v, \qquad
          M (v^+ - v) = h \, F\bigl(t_M, q_M, \tfrac12 (v + v^+)\bigr) + H^T P, \qquad q^+ = q_M + \tfrac h2 v^+,

with Newton's law on the contacts that are closed at the midpoint, u(q_M) <= 0:

.. math:: 0 \le P \perp U^+ + e U \ge 0 .

Spring forces are those at q_M, which is known, so only M and C are factored. The dashpots see the mean velocity, which
keeps order 2.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from lcpimpact.integrators.base import Declared
from lcpimpact.integrators.stepping.linear_step import (
    AT_VELOCITY_LEVEL,
    REST_GAP_FACTOR,
    Law,
    LinearStep,
    Step,
    Symbols,
)
from lcpimpact.scheme.dynamics import Dynamics


@dataclass(frozen=True)
class MoreauMidpoint(LinearStep):
    """Moreau's midpoint rule, explicit in the springs.

    Parameters
    ----------
    tol, max_iter : optional
        As of `LinearStep`.
    """

    instants: ClassVar[tuple[float, ...]] = (0.5,)

    name: ClassVar[str] = "moreau-midpoint"
    declared: ClassVar[Declared] = Declared(
        summary="half a step, impulses at the contacts closed there, the other half",
        order_smooth=2,
        order_loss=float("inf"),
        order_impact=1,
        order_friction=1,
        order_penetration=1,
        level="velocity",
        relative_degrees=(2,),
        handles=AT_VELOCITY_LEVEL,
        reaction_time="at t + h/2, one for each step",
        energy="bounded error in smooth motion for h < 2/ω",
        dissipates=True,
        source="Moreau1988; Studer2009, section 4.2",
        adaptive="dt, or halved where rtol is given",
    )

    def equations(self, y: Symbols, d: Dynamics, h: float) -> Step:
        """Write the step."""
        q_M = y.q + 0.5 * h * y.v
        # F contains C (v + v⁺)/2, of which C v⁺/2 is on the left-hand side.
        kick = y.momentum(y.v) + h * y.force(0.5, q_M, 0.5 * y.v) + y.push(y.P[0])
        v = y.solve(d.M + 0.5 * h * d.C, kick)
        impact = Law(
            L=y.gap_rate(v) + d.restitution[:, None] * y.first_rate,
            touching=y.gap(q_M + REST_GAP_FACTOR * (h * h) * y.solve(d.M, y.force(0.5, q_M, y.v)), 0.5 * h),
            springs_at=(q_M, 0.5 * (y.v + v)),
        )
        return Step(q=q_M + 0.5 * h * v, v=v, impulse=y.P[0], laws=(impact,))
