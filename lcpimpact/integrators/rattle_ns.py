r"""Nonsmooth RATTLE: two half kicks and a drift; the first prevents penetration, the second obeys the impact law.

.. math:: M (v_½ - v) = \tfrac h2 F(t, q, v_½) + H^T P_1, \qquad q^+ = q + h v_½, \qquad 0 \le P_1 \perp u(q^+) \ge 0,

.. math:: M (v^+ - v_½) = \tfrac h2 F(t^+, q^+, v_½) + H^T (P - P_1),

with Newton's law for the impulse P of the whole step at the contacts activated by the first half:

.. math:: 0 \le P \perp U^+ + e U \ge 0 .
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from lcpimpact.integrators.base import Declared
from lcpimpact.integrators.stepping.linear_step import Law, LinearStep, Step, Symbols, pushed
from lcpimpact.scheme.dynamics import Dynamics
from lcpimpact.scheme.structure import Feature


@dataclass(frozen=True)
class RattleNS(LinearStep):
    """Nonsmooth RATTLE, explicit in the springs, without penetration.

    Parameters
    ----------
    tol, max_iter : optional
        As of `TimeStepping`; rtol is refused, since no penetration shows that an impact was late.

    Notes
    -----
    A slider's law is imposed on U(v½), for half of its impulse, and on U⁺.
    """

    halves: ClassVar[bool] = False
    laws: ClassVar[int] = 2
    instants: ClassVar[tuple[float, ...]] = (0.0, 1.0)
    sums_alone: ClassVar[bool] = False

    name: ClassVar[str] = "rattle-ns"
    declared: ClassVar[Declared] = Declared(
        summary="kick, drift, kick; contact at position and velocity level, no penetration",
        order_smooth=2,
        order_loss=float("inf"),
        order_impact=1,
        order_friction=1,
        order_penetration=float("inf"),
        level="position and velocity",
        relative_degrees=(2,),
        handles=(Feature.SLIDERS, Feature.POWER_LAWS, Feature.RESTITUTION, Feature.LAGRANGIAN),
        reaction_time="at t + h/2, one for each step",
        energy="bounded error in smooth motion; impacts with e near 1 may add the work of the forces in a step",
        dissipates=False,
        source="BreulingCapobiancoEugsterLeine2024",
    )

    def equations(self, y: Symbols, d: Dynamics, h: float) -> Step:
        """Write the step."""
        P_1, P = y.P
        # F contains C v½, which is on the left-hand side.
        kick = y.momentum(y.v) + 0.5 * h * y.force(0.0, y.q, 0.0 * y.v) + y.push(P_1)
        v_half = y.solve(d.M + 0.5 * h * d.C, kick)
        q = y.q + h * v_half
        v = v_half + y.solve(d.M, 0.5 * h * y.force(1.0, q, v_half, law=1) + y.push(P - P_1))
        place = Law(
            L=np.where(d.of_rate[:, None], h * y.gap_rate(v_half), y.gap(q)),
            touching=None,
            springs_at=(y.q, v_half),
            weight=0.5 * h,
        )
        velocity = Law(
            L=y.gap_rate(v) + d.restitution[:, None] * y.first_rate,
            touching=pushed(place.L, P_1),
            strictly=True,
            springs_at=(q, v_half),
        )
        return Step(q=q, v=v, impulse=P, laws=(place, velocity))
