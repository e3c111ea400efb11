r"""Störmer-Verlet with impulses: kick, drift, kick, and half of each impulse in either kick.

.. math:: M (v_½ - v) = \tfrac h2 F(t, q, v_½) + \tfrac12 H^T P, \qquad q^+ = q + h v_½, \qquad
          M (v^+ - v_½) = \tfrac h2 F(t^+, q^+, v_½) + \tfrac12 H^T P,

with Newton's law on the contacts that the drift without impulses closes by mid-step:

.. math:: 0 \le P \perp U^+ + e U \ge 0 .

The dual method, drift, kick, drift, is moreau-midpoint: where the mass matrix is constant, the dual Störmer-Verlet and the
symmetric Moreau-type scheme of the literature are that rule. Here spring forces are those at q⁺, which depends on the
impulses; so the Delassus matrix contains K, and is positive definite if the method is stable, h < 2/ω.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from lcpimpact.integrators.base import Declared
from lcpimpact.integrators.stepping.linear_step import AT_VELOCITY_LEVEL, Law, LinearStep, Step, Symbols
from lcpimpact.scheme.dynamics import Dynamics


@dataclass(frozen=True)
class StormerVerletNS(LinearStep):
    """Störmer-Verlet with impulses, explicit in the springs.

    Parameters
    ----------
    tol, max_iter, rtol : optional
        As of `TimeStepping`.
    """

    laws: ClassVar[int] = 2
    instants: ClassVar[tuple[float, ...]] = (0.0, 1.0)

    name: ClassVar[str] = "stormer-verlet-ns"
    declared: ClassVar[Declared] = Declared(
        summary="kick, drift, kick, with half of each impulse in either kick",
        order_smooth=2,
        order_loss=float("inf"),
        order_impact=1,
        order_friction=1,
        order_penetration=1,
        level="velocity",
        relative_degrees=(2,),
        handles=AT_VELOCITY_LEVEL,
        reaction_time="at t + h/2, one for each step",
        energy="bounded error in smooth motion for h < 2/ω; impacts of approaching bodies never gain",
        dissipates=True,
        source="HairerLubichWanner2003; CapobiancoEugster2018, with impulses",
        adaptive="dt, or halved where rtol is given",
    )

    def equations(self, y: Symbols, d: Dynamics, h: float) -> Step:
        """Write the step."""
        # F contains C v½, which is on the left-hand side.
        A, P = d.M + 0.5 * h * d.C, y.P[1]
        v_free = y.solve(A, y.momentum(y.v) + 0.5 * h * y.force(0.0, y.q, 0.0 * y.v))
        v_half = v_free + y.solve(A, 0.5 * y.push(P))
        q = y.q + h * v_half
        v = v_half + y.solve(d.M, 0.5 * h * y.force(1.0, q, v_half, law=1) + 0.5 * y.push(P))
        # A law without contacts, for the non-linear springs of the first kick, before the impulses.
        springs = Law(L=y.P[0], touching=0.0 * y.P[0] + y.one, springs_at=(y.q, v_free), weight=0.0)
        impact = Law(
            L=y.gap_rate(v) + d.restitution[:, None] * y.first_rate,
            touching=y.gap(y.q + 0.5 * h * v_free, 0.5 * h),
            springs_at=(q, v_half),
        )
        return Step(q=q, v=v, impulse=P, laws=(springs, impact))
