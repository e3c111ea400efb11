r"""Newmark's method with impulses, and its damped variant by Hilber, Hughes and Taylor (HHT).

.. math:: v^+ = v + h \bigl((1 - γ) a + γ a^+\bigr) + w, \qquad
          q^+ = q + h v + h^2 \bigl((\tfrac12 - β) a + β a^+\bigr) + \tfrac h2 w, \qquad M w = H^T P,

where the acceleration a is that of the smooth forces alone,

.. math:: M a^+ = (1 + α) F(t^+, q^+, v^+) - α F(t, q, v),

with Newton's law on the contacts that the smooth motion closes by mid-step, u(q + h v/2 + h² a/8) <= 0:

.. math:: 0 \le P \perp U^+ + e U \ge 0 .
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from lcpimpact.arrays import Array
from lcpimpact.errors import InputError, UnsupportedError
from lcpimpact.integrators.base import Declared
from lcpimpact.integrators.stepping.linear_step import AT_VELOCITY_LEVEL, Law, LinearStep, Step, Symbols, smooth_force
from lcpimpact.numbers import is_real
from lcpimpact.numerics.elimination import solve
from lcpimpact.scheme.dynamics import Dynamics


@dataclass(frozen=True)
class NewmarkNS(LinearStep):
    """Nonsmooth Newmark and HHT.

    Parameters
    ----------
    alpha : float
        α from -1/3 to 0: the numerical damping of HHT; 0 for Newmark.
    beta : float, optional
        β >= 0; by default (1 - α)²/4, for order 2.
    gamma : float, optional
        γ >= 1/2; by default 1/2 - α, for order 2.
    tol, max_iter, rtol : optional
        As of `TimeStepping`.

    Raises
    ------
    InputError
        If α, β or γ lies outside these limits.

    Notes
    -----
    At α = 0 the defaults are β = 1/4 and γ = 1/2, the average acceleration; then a step is that of moreau-jean at
    θ = 1/2. γ > 1/2 damps and is of order 1. With 2 β = γ and α = 0 impacts of approaching bodies never gain energy.
    """

    alpha: float = 0.0
    beta: float | None = None
    gamma: float | None = None

    remembers: ClassVar[tuple[str, ...]] = ("a", "F")
    jumps_at: ClassVar[float | None] = 0.0

    name: ClassVar[str] = "newmark-ns"
    declared: ClassVar[Declared] = Declared(
        summary="average acceleration with impulses; α < 0 damps high frequencies",
        order_smooth=2,
        order_loss=float("inf"),
        order_impact=1,
        order_friction=1,
        order_penetration=1,
        level="velocity",
        relative_degrees=(2,),
        handles=AT_VELOCITY_LEVEL,
        reaction_time="at t + h/2, one for each step",
        energy="α = 0 keeps it in smooth motion, α < 0 loses it at order 3; impacts of approaching bodies never gain",
        dissipates=True,
        source="HilberHughesTaylor1977; Acary2016, with impulses",
        adaptive="dt, or halved where rtol is given",
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if not is_real(self.alpha) or not -1.0 / 3.0 <= self.alpha <= 0.0:
            raise InputError(f"alpha = {self.alpha!r} must lie in [-1/3, 0]: 0 for Newmark, below it for damping")
        β, γ = self.weights()
        if not is_real(γ) or not γ >= 0.5:
            raise InputError(f"gamma = {self.gamma!r} must be at least 1/2: below it energy grows without limit")
        if not is_real(β) or not β >= 0.0:
            raise InputError(f"beta = {self.beta!r} must not be negative: 0.25 for the average acceleration")

    def weights(self) -> tuple[float, float]:
        """Return β and γ."""
        β = (1.0 - self.alpha) ** 2 / 4.0 if self.beta is None else self.beta
        γ = 0.5 - self.alpha if self.gamma is None else self.gamma
        return β, γ

    def own_loss(self) -> tuple[float, float]:
        """Return order 1 for γ > 1/2 - α, else 3 for α < 0."""
        _, γ = self.weights()
        α = self.alpha
        if γ > 0.5 - α + 1e-12:
            return 1.0, γ - 0.5 + α - 0.25 * α * (1.0 + α) ** 2
        return (3.0, -0.25 * α * (1.0 + α) ** 2) if α < 0.0 else super().own_loss()

    @property
    def frozen_at(self) -> float:
        """1, as its accelerations are those at the ends of steps."""
        return 1.0

    @property
    def directed_at(self) -> float:
        """1/2, as its impulses act over the steps."""
        return 0.5

    def remember(self, d: Dynamics, q: Array, v: Array, h: float) -> dict[str, Array]:
        """Return the smooth acceleration and force at the start."""
        F = smooth_force(d, q, v)
        return {"a": solve(d.M, F), "F": F}

    def equations(self, y: Symbols, d: Dynamics, h: float) -> Step:
        """Write the step."""
        β, γ = self.weights()
        α = self.alpha
        a = y.after_jump(y.memory["a"], d.M)
        F = y.after_jump(y.memory["F"])
        if d.springs and d.contacts and abs(2.0 * β - γ) > 1e-12:
            raise UnsupportedError(
                f"newmark-ns does not handle non-linear springs beside contacts with 2 beta = {2.0 * β:g} and "
                f"gamma = {γ:g}: take alpha=0.0 with 2 beta = gamma, or method='generalized-alpha'"
            )
        touching = y.gap(y.q + 0.5 * h * y.v + 0.125 * (h * h) * a, 0.5 * h)
        w = y.solve(y.mass, y.push(y.P[0]))
        q_0 = y.q + h * y.v + (0.5 - β) * (h * h) * a + 0.5 * h * w
        v_0 = y.v + (1.0 - γ) * h * a + w
        # The part of F in a⁺ is on the left-hand side.
        S = d.M + (1.0 + α) * (γ * h * d.C + β * (h * h) * d.K)
        a = y.solve(S, (1.0 + α) * y.force(1.0, q_0, v_0) - α * F)
        q, v = q_0 + β * (h * h) * a, v_0 + γ * h * a
        impact = Law(L=y.gap_rate(v) + d.restitution[:, None] * y.first_rate, touching=touching, springs_at=(q, v))
        return Step(q=q, v=v, impulse=y.P[0], laws=(impact,), memory={"a": a, "F": y.force(1.0, q, v)})
