r"""The half-explicit D1⁻ method: forces on both sides of the step, and the impact at its end.

The velocity is linear within the step and jumps at its end. Its slope is the mean of the accelerations at the right
limit of the start and the left limit of the end,

.. math:: M a_+ = F(t, q, v) + H^T λ_+, \qquad v_1 = v + h a_+, \qquad q^+ = q + \tfrac h2 (v + v_1),

.. math:: M a_- = F(t^+, q^+, v_1) + H^T λ_-, \qquad v_- = v + \tfrac h2 (a_+ + a_-), \qquad M (v^+ - v_-) = H^T P,

with forces of the contacts that are closed at the start of the step, u(q) <= 0, and impulses of those that are closed at
its end, u(q⁺) <= 0:

.. math:: 0 \le λ_+ \perp U(v_1) + e U \ge 0, \qquad 0 \le λ_- \perp U_- + e U \ge 0, \qquad
          0 \le P \perp U^+ + e U_- \ge 0 .

In a Lagrangian system M, F and Hᵀ are those at the start for a₊ and at the end for a₋ and P, and all laws have the rows at
the end. At a persistent contact U is zero, so e does not enter the first two; it does if the motion begins with an impact.
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
    held,
)
from lcpimpact.scheme.dynamics import Dynamics


@dataclass(frozen=True)
class D1Minus(LinearStep):
    """Half-explicit D1⁻ at velocity level, explicit in springs and dashpots.

    Parameters
    ----------
    tol, max_iter, rtol : optional
        As of `TimeStepping`.
    """

    laws: ClassVar[int] = 3
    instants: ClassVar[tuple[float, ...]] = (0.0, 1.0)

    name: ClassVar[str] = "d1-minus"
    declared: ClassVar[Declared] = Declared(
        summary="time-discontinuous: forces on both sides of a step, the impact at its end",
        order_smooth=2,
        order_loss=float("inf"),
        order_impact=1,
        order_friction=1,
        order_penetration=1,
        level="velocity",
        relative_degrees=(2,),
        handles=AT_VELOCITY_LEVEL,
        reaction_time="at t + h/2, one for each step",
        energy="without dashpots bounded error in smooth motion for h < 2/ω; impacts never gain",
        slack=3.0,
        kick=0.1,
        dissipates=True,
        source="SchindlerAcary2014; SchindlerRezaeiKursaweAcary2015",
        adaptive="dt, or halved where rtol is given",
    )

    @property
    def frozen_at(self) -> float:
        """1: what holds at the start of a step is frozen there by itself."""
        return 1.0

    def equations(self, y: Symbols, d: Dynamics, h: float) -> Step:
        """Write the step; the unknowns of its first two laws are h λ."""
        start = y.start
        e, U = d.restitution[:, None], y.first_rate
        kick = start.solve(start.mass, h * start.force(0.0, y.q, y.v))
        change = kick + start.solve(start.mass, start.push(y.P[0]))
        v_1 = y.v + change
        q = y.q + 0.5 * h * (y.v + v_1)
        kick_again = y.solve(d.M, h * y.force(1.0, q, v_1, law=1))
        change_again = kick_again + y.solve(d.M, y.push(y.P[1]))
        v_minus = y.v + 0.5 * (change + change_again)
        v = v_minus + y.solve(d.M, y.push(y.P[2]))
        at_start = start.gap(y.q + REST_GAP_FACTOR * h * kick)
        at_end = y.gap(q + REST_GAP_FACTOR * h * kick_again)
        # What pushes to the end of the step is closed there, though it is pressed by other bodies and rounding may open it.
        at_end = at_end - h * y.rest_gap * held(y.rate_change(change_again), y.P[1])
        after = Law(L=y.gap_rate(v_1) + e * U, touching=at_start, springs_at=(y.q, y.v))
        before = Law(L=y.gap_rate(v_minus) + e * U, touching=at_start, springs_at=(q, v_1))
        impact = Law(L=y.gap_rate(v) + e * y.gap_rate(v_minus), touching=at_end, springs_at=(q, v_1), weight=0.0)
        return Step(q=q, v=v, impulse=0.5 * (y.P[0] + y.P[1]) + y.P[2], laws=(after, before, impact))
