r"""The scheme of Schatzman and Paoli: central differences of positions, with restitution at position level.

.. math:: M \frac{q^+ - 2 q + q_-}{h^2} = F\Bigl(t, q, \frac{q^+ - q_-}{2 h}\Bigr) + H^T r, \qquad
          0 \le r \perp u\Bigl(\frac{q^+ + e q_-}{1 + e}\Bigr) \ge 0 .

The constraint is on q⁺ plus e times the previous position, so a body that arrives with V leaves with -e V.
Row i is multiplied by 1 + e_i. The recorded velocity is V⁺ = (q⁺ - q)/h plus half a step of the smooth forces, projected on
U⁺ >= 0 at active contacts:

.. math:: M (v^+ - V^+) = \tfrac h2 F(t^+, q^+, V^+) + H^T p, \qquad 0 \le p \perp U^+ \ge 0 \quad (r > 0).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from lcpimpact.arrays import Array
from lcpimpact.integrators.base import Declared
from lcpimpact.integrators.stepping.linear_step import Law, LinearStep, Step, Symbols, first_acceleration, pushed
from lcpimpact.scheme.dynamics import Dynamics
from lcpimpact.scheme.structure import Feature


@dataclass(frozen=True)
class SchatzmanPaoli(LinearStep):
    """The two-step scheme at position level, explicit in the springs.

    Parameters
    ----------
    tol, max_iter : optional
        As of `TimeStepping`; rtol is refused, since the previous position belongs to the step length.

    Notes
    -----
    The record holds v⁺; the method itself uses positions only. A slider's law is imposed on V⁺. A load that jumps at t acts
    there by the mean of both sides: where the jump opens a contact, this holds back the half behind the jump, and the body
    leaves half a step late, slower by up to h/2 times its acceleration.
    """

    laws: ClassVar[int] = 2
    instants: ClassVar[tuple[float, ...]] = (0.0, 1.0)
    means: ClassVar[tuple[float, ...]] = (0.0,)
    remembers: ClassVar[tuple[str, ...]] = ("q_before",)
    halves: ClassVar[bool] = False
    impact_steps: ClassVar[int] = 2
    sums_alone: ClassVar[bool] = False

    name: ClassVar[str] = "schatzman-paoli"
    family: ClassVar[str] = "Schatzman-Paoli"
    declared: ClassVar[Declared] = Declared(
        summary="two-step scheme on positions, restitution through the previous position",
        order_smooth=2,
        order_loss=float("inf"),
        order_impact=1,
        order_friction=1,
        order_penetration=1,
        level="position",
        relative_degrees=(2,),
        handles=(Feature.SLIDERS, Feature.POWER_LAWS, Feature.RESTITUTION, Feature.LAGRANGIAN),
        reaction_time="at t, one for each step",
        energy="bounded error in smooth motion for h < 2/ω; no rule at impacts",
        kick=1.0,
        slack=4.0,
        dissipates=False,
        source="PaoliSchatzman2002",
    )

    def remember(self, d: Dynamics, q: Array, v: Array, h: float) -> dict[str, Array]:
        """Return the position one step before the start."""
        return {"q_before": q - h * v + 0.5 * (h * h) * first_acceleration(d, q, v, h, d.M)}

    @property
    def reaction_at(self) -> float:
        """0."""
        return 0.0

    def equations(self, y: Symbols, d: Dynamics, h: float) -> Step:
        """Write the step; the unknown of its first law is h r."""
        q_before = y.memory["q_before"]
        P, p = y.P
        slides = d.of_rate[:, None]
        # F contains C (q⁺ - q₋)/2h, of which C q⁺/2h is on the left-hand side.
        drive = y.momentum(2.0 * y.q - q_before) + (h * h) * y.force(0.0, y.q, -q_before / (2.0 * h)) + h * y.push(P)
        q = y.solve(d.M + 0.5 * h * d.C, drive)
        V = (q - y.q) / h
        half_kick = 0.5 * h * y.force(1.0, q, V, law=1) + y.push(0.5 * np.where(slides, P, 0.0) + p)
        v = V + y.solve(d.M, half_kick)
        place = Law(
            L=np.where(slides, h * y.gap_rate(V), y.gap(q) + d.restitution[:, None] * y.gap(q_before)),
            touching=None,
            springs_at=(y.q, (q - q_before) / (2.0 * h)),
        )
        reading = Law(L=y.gap_rate(v), touching=pushed(place.L, P), strictly=True, springs_at=(q, V), weight=0.0)
        return Step(q=q, v=v, impulse=P, laws=(place, reading), memory={"q_before": y.q})
