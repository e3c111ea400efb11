r"""The Moreau-Jean θ-step: one linear solve and one LCP a step, the same for relative degree 0, 1 and 2.

With w the mean velocity of the step, q⁺ = q + h w and v⁺ = v + (w - v)/θ at the nodes with mass, the equation of motion
at t_θ reads

.. math:: A w = f_θ - K q + \frac{1}{θ h} M v + H^T r, \qquad A = \frac{1}{θ h} M + C + θ h K .

Massless nodes stay unknowns. The contact law is imposed at the level of its relative degree,

.. math:: 0 \le r \perp \frac{u^+}{h} = H w + \frac{u}{h} \ge 0 \quad (0, 1), \qquad
          0 \le r \perp θ (U^+ + e U) = H w + (θ e - (1 - θ)) U \ge 0 \quad (2),

the latter only at contacts predicted to close, u + h U/2 <= 0. With w = w_free + A⁻¹ Hᵀ r this is an LCP with
the Delassus matrix W = H A⁻¹ Hᵀ.

Impacts through massless nodes are treated in `lcpimpact.integrators.stepping.impulse_paths`; massless nodes held by springs
only are projected onto equilibrium in `lcpimpact.integrators.stepping.static_balance`.

Friction with -μ r_N <= r_T <= μ r_N is at the level of sliders, with θ (U⁺ + e_T U) at relative degree 2, and in the same
LCP; a joint has U⁺ = 0 (2), or u⁺ = 0.

A slider's law is at velocity level: -r_0 <= r <= r_0 is complementary to H w (0, 1) or to θ U⁺ (2), so the LCP has
bounds and is otherwise the same. A system given directly, u = C x + D λ + c, is imposed at t_θ in the nonzero rows of D,
since λ is a mean of the step, and at the end of the step in the others. If rows of contacts can constrain x itself, as ideal
diodes tie the voltage of a capacitor to a source, x would oscillate for ever with θ < 1: there a step in which rows become
active or inactive uses θ = 1.

A relay is imposed at t_θ where D_ii > 0, and otherwise, since it constrains x while it slides, at the end of the step.
Where λ does not act on u' itself (relative degree 2 and more) u' would oscillate in a sliding mode with θ = 1/2; there u is
the one that the same λ gives at the end of a step of the backward Euler method,

.. math:: \hat u = C \hat x + c^+, \qquad \hat x = x + h (A \hat x + B λ + a^+),

which moves a switch by O(h) and takes u and its derivatives to zero in a sliding mode. Across a switch from bound to bound
the order is 1, for λ is constant in the step; into a sliding mode of relative degree 1 it is 2.

An equation of a system is imposed at t_θ where λ acts on it directly, and else at the end of the step; at relative degree 2
its rate C (A x + a) + c' is, by which y stays zero for a constant c.

Where a dashpot stops a mass within a step, c h/m > 1/(1 - θ), M/θ is M/θ_k in the direction in which it does while the same
contacts are closed, so that the velocity decays and is never turned back; see
`lcpimpact.integrators.stepping.strong_dashpots`. Below that a step is that of θ: a body that begins with velocity on a
dashpot is off by 3.5 % of its way at c h/m = 1. A contact may open up to 2 h late, so that a body between strong stops is
off by the way that it takes in this time. A step in which a spring that damps would part its ends faster than after a blow
of its law has another θ_k in the direction of the spring, with which they part with the restitution of this law.

The row of A of a node with prescribed motion is that of the identity. Forces of non-linear springs are evaluated at t_θ, by
Newton's method around the LCP; see `lcpimpact.integrators.stepping.newton`, and for general forces
`lcpimpact.integrators.stepping.force_newton`.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any, ClassVar, cast

import numpy as np

from lcpimpact.arrays import Array, Indices
from lcpimpact.errors import InputError, UnsupportedError
from lcpimpact.integrators.base import Declared, refuse_hysteresis
from lcpimpact.integrators.stepping.impulse_paths import impulse_paths
from lcpimpact.integrators.stepping.kernel import Watched
from lcpimpact.integrators.stepping.linear_step import Law, LinearStep, Step, Symbols, Tabulated
from lcpimpact.integrators.stepping.sparse_symbols import SparseStep, prescribe, select, sparse_symbols
from lcpimpact.integrators.stepping.static_balance import static_coordinates
from lcpimpact.integrators.stepping.strong_dashpots import (
    added_mass,
    blows,
    largest_weight,
    on_strong_dashpots,
    refuse_strong_dashpots,
)
from lcpimpact.lcp.friction import FORMULATIONS
from lcpimpact.lcp.operators import Dense
from lcpimpact.numbers import is_real
from lcpimpact.numerics.elimination import product, solve
from lcpimpact.registry import nearest
from lcpimpact.scheme.dynamics import Dynamics
from lcpimpact.scheme.lagrangian import FrozenDynamics, LagrangianDynamics
from lcpimpact.scheme.signals import Described, jumps
from lcpimpact.scheme.sparse_dynamics import SparseDynamics
from lcpimpact.scheme.structure import Feature


@dataclass(frozen=True)
class MoreauJean(LinearStep):
    """The θ-step with an LCP.

    Parameters
    ----------
    theta : float
        θ in [1/2, 1]; 1/2 is of second order and keeps the energy of smooth motion, 1 damps and is of first order.
    friction : str
        Formulation of Coulomb friction as an LCP, "glocker", "stewart-trinkle" or "anitescu-potra" (see
        `lcpimpact.lcp.friction`); the first two have the same solutions, the last is convex, and sliding bodies lift off.
    tol, max_iter, rtol : optional
        As of `lcpimpact.integrators.stepping.time_stepping.TimeStepping`.

    Raises
    ------
    InputError
        If the formulation is unknown, or θ lies outside [1/2, 1]: an undamped vibration ω grows by the factor
        sqrt((1 + (1 - θ)² ω² h²)/(1 + θ² ω² h²)) a step, which is above 1 for θ < 1/2 and any h.

    Notes
    -----
    Velocities of massless nodes are means of the step. The reaction is the mean force of the step, which refers to t + θ h.
    A contact of relative degree 2 closes by an impact, whose impulse is in the event and not among the reactions.
    A `SampledForce` is set by q and v at the end of a step, the velocity after its impacts, and is constant in the next.
    A `lcpimpact.SparseScheme`, of up to millions of nodes with springs, dashpots, bumpers, loads and motions, takes this
    step with sparse matrices; see docs/guide/many-contacts.md.
    """

    theta: float = 0.5
    friction: str = "glocker"

    instants: ClassVar[tuple[float, ...]] = (0.0, 1.0)

    name: ClassVar[str] = "moreau-jean"
    declared: ClassVar[Declared] = Declared(
        summary="θ-step with an LCP; massless nodes stay unknowns",
        order_smooth=2,
        order_loss=float("inf"),
        order_force_jump=2,
        order_force_kink=2,
        order_impact=1,
        order_friction=1,
        order_relay=1,
        order_penetration=1,
        level="velocity; position where r does not impact",
        relative_degrees=(0, 1, 2),
        handles=tuple(Feature),
        reaction_time="at t + θ h, one for each step",
        energy="kept in smooth motion for θ = 1/2, else lost at order 1; impacts of approaching bodies never gain for "
        "θ <= 1/(1 + e)",
        balances_energy=True,
        dissipates=True,
        source="Moreau1988; Jean1999; AcaryBrogliato2008, chapter 10",
        adaptive="dt, or halved where rtol is given",
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.friction not in FORMULATIONS:
            raise InputError(nearest(str(self.friction), list(FORMULATIONS), "formulation of friction"))
        if not is_real(self.theta) or not 0.5 <= self.theta <= 1.0:
            raise InputError(
                f"theta = {self.theta!r} must lie in [0.5, 1]: 0.5 for second order, 1.0 for damping; below 0.5 vibrations "
                "grow at every dt"
            )

    @property
    def formulation(self) -> str:  # type: ignore[override]
        """Formulation of friction: the option ``friction``."""
        return self.friction

    @property
    def reaction_at(self) -> float:
        """θ."""
        return self.theta

    def balance_point(self) -> float:
        """Return θ."""
        return self.theta

    def own_loss(self) -> tuple[float, float]:
        """Return order 1 for θ > 1/2, whose steps lose (θ - 1/2) (Δv·M Δv + Δq·K Δq)."""
        return (1.0, 2.0 * self.theta - 1.0) if self.theta > 0.5 else super().own_loss()

    def prepare(self, d: Dynamics, h: float, lcp_solver: str) -> Tabulated:
        """Tabulate the step.

        Raises
        ------
        UnsupportedError
            If a relay has D_ii < 0, once equations hold, where the LCP of a step has several solutions, or an equation of
            relative degree 2 has a signal, from which y would drift by O(h²).
        """
        refuse_hysteresis(d, self.name)
        second = d.bilateral & (d.relative_degree == 2) & (not d.stores_energy) & (d.H[:, d.driven] != 0.0).any(axis=1)
        if second.any():
            raise UnsupportedError(
                f"the equation of {d.contacts[int(np.argmax(second))].name!r} has relative degree 2 and a signal in c, from "
                f"which the steps of {self.name!r} would drift: ",
                ("exact", "event-driven"),
            )
        return super().prepare(d, h, lcp_solver)

    def matrix(self, d: Dynamics | SparseDynamics, h: float) -> Array:
        """Return A = M/(θ h) + C + θ h K, of a sparse system in sparse form."""
        return d.M / (self.theta * h) + d.C + self.theta * h * d.K

    def momentum(self, y: Symbols, d: Dynamics | SparseDynamics, h: float) -> Array:
        """Return f_θ - K q + M v/(θ h) + Hᵀ r."""
        θ, at_rest = self.theta, 0.0 * y.v
        F = (1.0 - θ) * y.force(0.0, y.q, at_rest) + θ * y.force(1.0, y.q, at_rest)
        return F + y.momentum(y.v) / (θ * h) + y.push(y.P[0] / h)

    def end(self, y: Symbols, w: Array, h: float) -> tuple[Array, Array]:
        """Return q⁺ and, of nodes with mass, v⁺."""
        return y.q + h * w, y.v + (w - y.v) / self.theta

    def law_of_impact(self, y: Symbols, w: Array, e: Array, h: float) -> Array:
        """Return θ (U⁺ + e U)."""
        θ = self.theta
        return y.gap_rate(w) - (1.0 - θ) * y.gap_rate(y.v) + θ * e[:, None] * y.first_rate

    def weight_of_paths(self, d: Dynamics, h: float) -> float:
        """Return θ."""
        return self.theta

    def predicted_gap(self, y: Symbols, h: float) -> Array:
        """Return u + h U/2, at which contacts of relative degree 2 are active where it is not positive."""
        return y.gap(y.q + 0.5 * h * y.v, before_end=0.5 * h)

    def sparse_step(self, d: SparseDynamics, h: float) -> SparseStep:
        """Return the step of a system with bumpers alone, and no impulse paths over massless nodes, in sparse matrices."""
        refuse_strong_dashpots(d, h, self.theta)
        y = sparse_symbols(d)
        w = y.solve(*prescribe(y, self.matrix(d, h), self.momentum(y, d, h), h))
        q, v = self.end(y, w, h)
        v = select(d.massive, v, w)
        q = select(~d.driven, q, y.prescribed.place)
        v = select(~d.driven, v, y.prescribed.rate)
        impacts = d.relative_degree == 2
        L = self.law_of_impact(y, select(~d.driven, w, y.prescribed.mean_rate), d.restitution, h)
        touching = self.predicted_gap(y, h)
        if not impacts.all():
            L = select(impacts, L, y.gap_rate(w) + y.gap(y.q) / h)
            touching = select(impacts, touching, -y.column(np.ones(len(impacts))))
        unbalanced = d.kinds.static.T @ (y.loads[1.0] - d.K @ q + y.push(y.P[0] / h))
        return SparseStep(y, q, v, L, touching, unbalanced)

    @property
    def ends_blows(self) -> bool:
        """Whether θ < 1, with which a step may throw."""
        return self.theta < 1.0

    def stopping_contacts(self, d: Dynamics, h: float) -> Indices | None:
        """Return the contacts on dashpots, or between masses on them, if some dashpot may stop a mass within a step.

        And the springs that damp.
        """
        rows = on_strong_dashpots(d, h, self.theta)
        damps = (blows(d) > 0.0) & self.ends_blows
        if rows is None and not damps.any():
            return None
        nc = len(d.contacts)
        watched = np.zeros(nc + len(d.pushes), dtype=np.int64)
        watched[nc:][damps] = Watched.APART
        if rows is not None:
            watched[rows] = np.where(
                (d.relative_degree[rows] == 2) & (d.restitution[rows] > 0.0), Watched.APART, Watched.OPEN
            )
        return watched

    def on_moving(self, d: LagrangianDynamics) -> MoreauJean:
        """Return the step with its own weights by which dashpots among the other forces never turn a velocity back."""
        return DampedStep(**self._options()) if d.damped else self

    def _options(self) -> dict[str, Any]:
        return {each.name: getattr(self, each.name) for each in fields(self)}

    def in_mode(self, d: Dynamics, watched: Indices) -> ClosedMode:
        """Return the step with its own weights in the directions of strong dashpots and of blows that end."""
        rows, springs = np.split(watched, [len(d.contacts)])
        closed = np.flatnonzero((rows == Watched.CLOSED) | (rows == Watched.STRUCK))
        ended = np.flatnonzero(springs >= Watched.BLOW)
        ends = zip(ended.tolist(), (springs[ended] - Watched.BLOW).tolist(), strict=True)
        return ClosedMode(**self._options(), closed=tuple(closed.tolist()), ends=tuple(ends))

    def equations(self, y: Symbols, d: Dynamics, h: float) -> Step:
        """Write the step."""
        θ = self.theta
        r = y.P[0] / h
        driven = d.driven
        A = self.matrix(d, h)
        momentum = self.momentum(y, d, h)
        equations = d.bilateral & (not d.stores_energy)
        impacts = (d.relative_degree == 2) & ~d.switches & ~equations
        mean_rate = y.prescribed.mean_rate[driven]
        A[driven] = np.eye(len(A))[driven]
        momentum[driven] = mean_rate
        if d.stores_energy and any(each[:, driven].any() for each in (d.C, d.K, d.H[~impacts])):
            # All but impacts follow the places, also where these take another mean of a rate that jumps.
            momentum[driven] = (y.prescribed.place - y.q)[driven] / h
        w, at_rest = y.solve(A, momentum), 0.0 * y.v
        struck = w.copy()
        struck[driven] = mean_rate
        q, v = self.end(y, w, h)
        v = np.where(d.massive[:, None], v, w)
        q[driven] = y.prescribed.place[driven]
        v[driven] = y.prescribed.rate[driven]

        of_rate = d.of_rate[:, None]
        # u is that at the end of the step, or at t_θ if it depends on r, a mean of the step; a law of the rate has none.
        middle = np.where(d.switches, np.diag(d.D @ d.elimination) > 0.0, d.D.any(axis=1))
        at = np.where(middle, θ * h, h)[:, None]
        position = y.gap_rate(w) + np.where(of_rate, 0.0, (y.gap(y.q) + product(d.D, r)) / at)
        if (late := d.switches & (d.relative_degree > 1)).any():
            position[late] = (y.gap(self._backward_euler(y, d, h)) / h)[late]
        if (second := equations & (d.relative_degree == 2)).any():
            rate = y.force(1.0, q, at_rest)
            rate[driven] = y.prescribed.rate[driven]
            position[second] = y.rate_change(rate)[second]
        law = Law(
            L=np.where(impacts[:, None], self.law_of_impact(y, struck, d.restitution, h), position),
            touching=np.where(impacts[:, None], self.predicted_gap(y, h), -y.one),
            springs_at=(y.q + θ * h * w, w),
        )
        paths = impulse_paths(d, self.weight_of_paths(d, h), h)
        static = static_coordinates(d)
        return Step(q=q, v=v, impulse=y.P[0], laws=(law,), paths=paths, static=static)

    def _backward_euler(self, y: Symbols, d: Dynamics, h: float) -> Array:
        """Return the state of a system at the end of a step of the backward Euler method, with the same multipliers."""
        at_rest, A = 0.0 * y.v, d.C + h * d.K
        right = product(d.C, y.q) + h * (y.force(1.0, at_rest, at_rest) + y.push(y.P[0] / h))
        place = y.prescribed.place
        if any(jumps(motion) for motion in d.motions.values()):
            place = y.q + h * y.prescribed.mean_rate  # the left limit
        A[d.driven] = np.eye(len(A))[d.driven]
        right[d.driven] = place[d.driven]
        return y.solve(A, right)

    def contact_matrix(self, d: Dynamics, h: float, W: Array) -> Dense:
        """Return W = H A⁻¹ Hᵀ/h, with A and H/√h where it has that form."""
        if not d.stores_energy or len(d.pushes):
            return Dense(W)
        free = ~d.driven
        return Dense(W, A=self.matrix(d, h)[np.ix_(free, free)], H=d.H[:, free] / np.sqrt(h))

    def at_switches(self, d: Dynamics) -> LinearStep | None:
        """Return the step with θ = 1, for systems whose state can jump."""
        return replace(self, theta=1.0) if self.theta < 1.0 and can_jump(d) else None

    def mean_rates(self, d: Dynamics | SparseDynamics, h: float, t: Array, y: Array, rate: Array) -> Array:
        """Return the mean rates; if y' jumps in a step, the rate for which U⁺ of its impacts contains y' at its end."""
        mean = super().mean_rates(d, h, t, y, rate)
        struck = abs(d.H[d.relative_degree == 2]).sum(axis=0) > 0.0
        for k, (i, motion) in enumerate(sorted(d.motions.items())):
            if struck[i] and isinstance(motion, Described) and motion.continuous:
                steps = np.searchsorted(t, motion.breakpoints(t[0], t[-1])) - 1
                mean[steps, k] = (1.0 - self.theta) * rate[steps, k] + self.theta * rate[steps + 1, k]
        return mean


@dataclass(frozen=True)
class ClosedMode(MoreauJean):
    """The θ-step on strong dashpots while some contacts are closed, with M/θ_k for M/θ in their directions.

    With N of `lcpimpact.integrators.stepping.strong_dashpots.added_mass`, M w/(θ h) becomes (M/θ + N) w/h, and
    M (v⁺ - v) = (M/θ + N) (w - v).

    Parameters
    ----------
    closed : tuple of int
        The rows of the closed contacts.
    ends : tuple of (int, int)
        The springs whose blows end in the step, and the i of their weights 1/θ_k = 1 + i/n, n = `WEIGHTS`.
    """

    closed: tuple[int, ...] = ()
    ends: tuple[tuple[int, int], ...] = ()

    def stopping_contacts(self, d: Dynamics, h: float) -> Indices | None:
        """Return none: it is the step of one mode."""
        return None

    def added_mass(self, d: Dynamics, h: float) -> Array:
        """Return N (n, n)."""
        return added_mass(d, h, self.theta, np.isin(np.arange(len(d.contacts)), self.closed), dict(self.ends))

    def added_velocity(self, y: Symbols, w: Array, h: float) -> Array:
        """Return M⁻¹ N (w - v), of nodes with mass."""
        d = y.dynamics
        found, m = np.zeros_like(w), d.massive
        found[m] = solve(d.M[np.ix_(m, m)], product(self.added_mass(d, h), w - y.v)[m])
        return found

    def matrix(self, d: Dynamics | SparseDynamics, h: float) -> Array:
        """Return (M/θ + N)/h + C + θ h K."""
        return super().matrix(d, h) + self.added_mass(cast(Dynamics, d), h) / h

    def momentum(self, y: Symbols, d: Dynamics | SparseDynamics, h: float) -> Array:
        """Return f_θ - K q + (M/θ + N) v/h + Hᵀ r."""
        return super().momentum(y, d, h) + product(self.added_mass(cast(Dynamics, d), h), y.v) / h

    def end(self, y: Symbols, w: Array, h: float) -> tuple[Array, Array]:
        """Return q⁺ and, of nodes with mass, v⁺ = v + (1/θ + M⁻¹ N) (w - v)."""
        q, v = super().end(y, w, h)
        return q, v + self.added_velocity(y, w, h)

    def law_of_impact(self, y: Symbols, w: Array, e: Array, h: float) -> Array:
        """Return θ (U⁺ + e U)."""
        return super().law_of_impact(y, w, e, h) + self.theta * y.rate_change(self.added_velocity(y, w, h))

    def contact_matrix(self, d: Dynamics, h: float, W: Array) -> Dense:
        """Return W, with its factors where all rows have the form of those at position level, and A is symmetric."""
        plain = (d.relative_degree < 2).all() and len({i for _, i in self.ends}) < 2
        return super().contact_matrix(d, h, W) if plain else Dense(W)

    def weight_of_paths(self, d: Dynamics, h: float) -> float:
        """Return θ_k of the closed contacts that lie on an impulse path, the largest."""
        on_path = (d.impulse_lines > 0.0).any(axis=0)
        return largest_weight(d, h, self.theta, on_path & np.isin(np.arange(len(d.contacts)), self.closed))


@dataclass(frozen=True)
class DampedStep(ClosedMode):
    r"""The θ-step of a Lagrangian system with dashpots among its other forces.

    A dashpot C that stops a mass within a step would throw it back, with θ = 1/2 by (1 - z/2)/(1 + z/2), z = h C/M. With

    .. math:: θ(z) = \frac{θ + z/2}{1 + z/2}

    in place of θ it decays by 1/(1 + z + z²/2) for θ = 1/2, a rational function of order 2; so N = (M/θ(z)) - M/θ.
    """

    def added_mass(self, d: Dynamics, h: float) -> Array:
        """Return -(1/θ - 1) h C (2 θ M + h C)⁻¹ M, with C = -∂Q/∂v (n, n)."""
        hC, θ = h * cast(FrozenDynamics, d).damping, self.theta
        return (1.0 - 1.0 / θ) * product(hC, solve(2.0 * θ * d.M + hC, d.M))

    def weight_of_paths(self, d: Dynamics, h: float) -> float:
        """Return θ, as there are no massless nodes."""
        return self.theta


def can_jump(d: Dynamics) -> bool:
    """Return whether contacts with D ≠ 0 can take impulses, p >= 0 with D p >= 0 and (D + Dᵀ) p = 0.

    Their u = 0 constrains x; imposed at t_θ with θ < 1, x would oscillate about it for ever.
    """
    D = (d.D @ d.elimination)[np.ix_(d.impenetrable, d.impenetrable)]
    direct, symmetric = D.any(axis=1), D + D.T
    if not direct.any():
        return False
    if np.linalg.eigvalsh(symmetric)[0] < -1e-12 * np.abs(D).max():
        return True
    from scipy.optimize import linprog  # here, as most runs do without it

    found = linprog(-direct.astype(float), -D, np.zeros(len(D)), symmetric, np.zeros(len(D)), (0.0, 1.0))
    return bool(found.fun < -1e-9)
