r"""The nonsmooth generalized-α method: smooth forces at order 2, separate impulses, contact at both levels.

The smooth part is that of Chung and Hulbert, with ``a`` that follows the acceleration d of the smooth forces alone,

.. math:: (1 - α_m) a^+ + α_m a = (1 - α_f) d^+ + α_f d, \qquad
          \tilde v = v + h \bigl((1 - γ) a + γ a^+\bigr), \qquad
          \tilde q = q + h v + h^2 \bigl((\tfrac12 - β) a + β a^+\bigr),

and all four parameters follow from ρ∞, the spectral radius at infinite frequency:

.. math:: α_m = \frac{2 ρ_\infty - 1}{ρ_\infty + 1}, \qquad α_f = \frac{ρ_\infty}{ρ_\infty + 1}, \qquad
          γ = \tfrac12 + α_f - α_m, \qquad β = \tfrac14 \bigl(γ + \tfrac12\bigr)^2 .

A projection removes the penetration, and an impulse corrects the velocity of the contacts that it activates:

.. math:: q^+ = \tilde q + D, \quad (M + c γ h C) D = H^T ν, \quad 0 \le ν \perp u(q^+) \ge 0, \qquad
          v^+ = \tilde v + w, \quad M w = H^T P, \quad 0 \le P \perp U^+ + e U \ge 0,

with c = (1 - α_f)/(1 - α_m). The smooth forces are those at the end of the step, M d⁺ = F(t⁺, q⁺, v⁺); the position is
computed with an acceleration without w, and with forces of non-linear springs without D.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from lcpimpact.arrays import Array
from lcpimpact.errors import InputError
from lcpimpact.integrators.base import Declared
from lcpimpact.integrators.stepping.linear_step import Law, LinearStep, Step, Symbols, pushed, smooth_force
from lcpimpact.integrators.stepping.strong_dashpots import starting_mass
from lcpimpact.numbers import is_real
from lcpimpact.numerics.elimination import solve
from lcpimpact.scheme.dynamics import Dynamics
from lcpimpact.scheme.structure import Feature


@dataclass(frozen=True)
class GeneralizedAlpha(LinearStep):
    """Nonsmooth generalized-α.

    Parameters
    ----------
    rho_inf : float
        ρ∞ in [0, 1]: 1 keeps the energy of smooth motion, 0 removes the highest frequencies in one step.
    tol, max_iter, rtol : optional
        As of `TimeStepping`.

    Raises
    ------
    InputError
        If ρ∞ lies outside [0, 1].

    Notes
    -----
    A body that would end a step below the ground is projected onto it, and rebounds with e times its speed at the start of
    the step, in which the work of repelling forces during the step is missing. So for e near 1 an impact may add up to
    h times their power.
    """

    rho_inf: float = 0.8

    laws: ClassVar[int] = 2
    remembers: ClassVar[tuple[str, ...]] = ("a", "d")
    jumps_at: ClassVar[float | None] = 0.0
    sums_alone: ClassVar[bool] = False

    name: ClassVar[str] = "generalized-alpha"
    declared: ClassVar[Declared] = Declared(
        summary="tunable damping of high frequencies; contact at position and velocity level, no penetration",
        order_smooth=2,
        order_loss=3,
        loss_constant=1 / 729,
        order_impact=1,
        order_penetration=float("inf"),
        level="position and velocity",
        relative_degrees=(2,),
        handles=(Feature.POWER_LAWS, Feature.RESTITUTION, Feature.LAGRANGIAN),
        reaction_time="at t + h/2, one for each step",
        energy="ρ∞ = 1 keeps it in smooth motion, less damps at order 3; impacts with e near 1 may add the work of a step",
        dissipates=False,
        source="ChungHulbert1993; BruelsAcaryCardona2014, with impulses",
        adaptive="dt, or halved where rtol is given",
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if not is_real(self.rho_inf) or not 0.0 <= self.rho_inf <= 1.0:
            raise InputError(f"rho_inf = {self.rho_inf!r} must lie in [0, 1]: 1 without damping, 0 for the most")

    def own_loss(self) -> tuple[float, float]:
        """Return order 3 for ρ∞ < 1."""
        ρ = self.rho_inf
        order, _ = super().own_loss()
        return (order, ((1.0 - ρ) / (1.0 + ρ)) ** 3) if ρ < 1.0 else (float("inf"), 0.0)

    def weights(self) -> tuple[float, float, float, float]:
        """Return α_m, α_f, γ and β."""
        ρ = self.rho_inf
        α_m = (2.0 * ρ - 1.0) / (ρ + 1.0)
        α_f = ρ / (ρ + 1.0)
        γ = 0.5 + α_f - α_m
        return α_m, α_f, γ, 0.25 * (γ + 0.5) ** 2

    def first_mass(self, d: Dynamics, h: float) -> Array:
        """Return the `starting_mass` of a step, whose acceleration acts on dashpots by c γ h."""
        α_m, α_f, γ, _ = self.weights()
        return starting_mass(d, h, (1.0 - α_f) / (1.0 - α_m) * γ)

    @property
    def frozen_at(self) -> float:
        """1, as its accelerations are those at the ends of steps."""
        return 1.0

    @property
    def directed_at(self) -> float:
        """1/2, as its impulses act over the steps."""
        return 0.5

    def remember(self, d: Dynamics, q: Array, v: Array, h: float) -> dict[str, Array]:
        """Return the smooth acceleration at the start, twice."""
        a = solve(self.first_mass(d, h), smooth_force(d, q, v))
        return {"a": a, "d": a}

    def equations(self, y: Symbols, d: Dynamics, h: float) -> Step:
        """Write the step."""
        α_m, α_f, γ, β = self.weights()
        M_0 = self.first_mass(d, h)
        a_before = y.after_jump(y.memory["a"], M_0)
        d_before = y.after_jump(y.memory["d"], M_0)
        # a⁺ = c d⁺ + a_0, of which d⁺ is still unknown.
        c = (1.0 - α_f) / (1.0 - α_m)
        a_0 = (α_f * d_before - α_m * a_before) / (1.0 - α_m)
        v_0 = y.v + h * ((1.0 - γ) * a_before + γ * a_0)
        q_0 = y.q + h * y.v + (h * h) * ((0.5 - β) * a_before + β * a_0)
        A = d.M + c * γ * h * d.C
        S = A + c * β * (h * h) * d.K
        free = y.solve(S, y.force(1.0, q_0, v_0))
        D = y.solve(A, y.push(y.P[0]))
        w = y.solve(y.mass, y.push(y.P[1]))
        a = y.solve(S, y.force(1.0, q_0 + D, v_0))
        q = q_0 + D + c * β * (h * h) * a
        # The changes by w and the springs; K q would be lost in rounding for h far above 2/ω.
        a = a + y.solve(A, y.force(1.0, q, v_0 + w, law=1) - y.force(1.0, q, v_0))
        v = v_0 + w + c * γ * h * a
        place = Law(L=y.gap(q), touching=None, springs_at=(q_0 + c * β * (h * h) * free, v_0 + c * γ * h * free))
        velocity = Law(
            L=y.gap_rate(v) + d.restitution[:, None] * y.first_rate,
            touching=pushed(place.L, y.P[0]),
            strictly=True,
            springs_at=(q, v),
        )
        return Step(q=q, v=v, impulse=y.P[1], laws=(place, velocity), memory={"a": c * a + a_0, "d": a})
