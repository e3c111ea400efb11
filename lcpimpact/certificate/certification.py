"""The certificate of a run: the largest violation of each law of the system, computed from the results of the run alone."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from lcpimpact.arrays import Array, Flags, largest
from lcpimpact.certificate.continuous import SUM_RTOL, judge_continuous
from lcpimpact.certificate.damping import judge_damping
from lcpimpact.certificate.drives import MOMENTUM_FRACTION, SEEN_FRACTION, between_steps, missed_impulses
from lcpimpact.certificate.energy import INFLOWS, Energies, account_of
from lcpimpact.certificate.grid import judge_grid
from lcpimpact.certificate.growth import judge_growth
from lcpimpact.certificate.impact_gain import ImpactGain, impact_gain
from lcpimpact.certificate.laws import elastic_contacts, steady_loads
from lcpimpact.certificate.moving import judge_moving
from lcpimpact.certificate.scales import Judgement, Scales, larger_violation, largest_violation
from lcpimpact.certificate.theta_steps import judge_theta_steps
from lcpimpact.certificate.trapezoid import trapezoid_errors, trapezoids
from lcpimpact.integrators.base import Integrator, Limits
from lcpimpact.record import ContinuousSolution, Event, Record
from lcpimpact.scheme.dynamics import Dynamics
from lcpimpact.scheme.lagrangian import LagrangianDynamics
from lcpimpact.scheme.power_law import forces as spring_forces
from lcpimpact.scheme.signals import jumps, limits_at

RESIDUAL_FACTOR = 1e3
"""Violation of a law, in its own unit, per unit of the residual to which the LCPs are solved."""

DRIFT = 0.2
"""Largest unexplained drift of the energy, growth or loss, relative to the largest stored energy."""

THROWN = 0.5
"""Impulse of damping while bodies part, relative to the largest momentum; up to c h/m = 1 it is less."""

WORK_RTOL = 0.005
"""Largest accumulated error of the work of general forces, relative to the sum of its absolute values."""

SENTENCES = {
    "complementarity": ("force and gap, or friction and sliding, violate complementarity by {}", "J"),
    "penetration": ("bodies penetrate by {}", "m"),
    "energy_balance": ("the energy is out of balance by {}", "J"),
    "energy_growth": ("the energy grows by {} that nothing supplies: take shorter steps", "J"),
    "energy_loss": ("the steps lose {} of energy that no element takes: take shorter ones", "J"),
    "tension": ("a reaction is outside its bounds by {}", "N"),
    "impact_law": ("the impact law is violated by {}", "m/s"),
    "momentum": ("the momentum is out of balance by {}", "N s"),
    "equilibrium": ("a massless node is out of balance by {}", "N"),
    "kinematics": ("coordinates and velocities differ by {}", "m"),
    "missed_impulse": ("the steps miss {} of a load, a damped stop or a prescribed motion: take shorter ones", "N s"),
    "damping": ("dashpots stop masses within a step, of whose velocities {} remains: take shorter steps", "m/s"),
    "growth": ("errors grow by the factor {} in steps beyond the limit of stability: take shorter ones", ""),
    "sampling": ("the record differs from the continuous solution by {} of its scale", ""),
    "motion": ("a node deviates from its prescribed motion by {}", "m"),
}
"""The sentence for each violation, and its unit."""


@dataclass(frozen=True)
class Certificate:
    """Greatest violations over a run; each is zero for the exact motion.

    Attributes
    ----------
    residual : float
        Largest residual of the LCPs of the steps, in units where max |W| = max |q| = 1; zero if none is solved.
    complementarity : float
        Largest product in J: r u of a closed contact, impulse times U⁺ + e U⁻ in an impact, and r0 |U| + r U of a slider
        over a step, by which its friction dissipates too little. What a contact of relative degree 0 or 1 dissipates in a
        step of force r is r u at its beginning less r u at its end: nothing while it stays closed, and r u in the step that
        closes it.
    penetration : float
        Largest -u in m.
    energy_balance : float
        Largest imbalance in J of the stored, supplied and dissipated energies since t = 0, the sum of the energy ledger
        (`lcpimpact.energy_ledger`). With the θ-method it is the numerical gain or dissipation, zero to rounding for θ = 1/2
        and linear springs; a method that corrects positions does work against the loads. NaN for a system given by its
        matrices, which has no energy.
    energy_scale : float
        Largest stored energy of the run in J, for comparison.
    energy_growth : float
        Largest growth in J of the stored energy over that at t = 0, beyond what loads and prescribed motions supplied and
        impacts gained. It is computed if the energy is out of balance by a sixth of the energy scale, for methods whose
        steps do not impose the law of impact, and under general forces, whose balance may close by what one instant of
        a step says; it is zero otherwise, and for driven systems if the method takes several steps between two instants of
        the record, as with rtol. An explicit method is unstable on springs and contacts that are too stiff for its steps.
    energy_loss : float
        Largest loss in J of the stored energy since t = 0 beyond what dashpots, friction, contacts and impacts took, less
        what loads and prescribed motions supplied, and beyond what the steps lose by themselves. With the θ-method that is
        (θ - 1/2) (Δv·M Δv + Δq·K Δq) in each step, an identity for linear springs, which closes to rounding. Else it is the
        energy of the differences of q and v over m steps, by twice the constant that a method declares for its loss of order
        2 m - 1 (`lcpimpact.integrators.base.Declared`), and a fifth of the energy scale is allowed, or of what elements
        took. It is zero where the energy balance has a limit, and where a method takes several steps between two instants
        of the record. Of the θ-method it is also what a contact on springs alone takes in the step that closes it, if that
        is more than a fifth of the energy scale: a stop whose springs are too stiff for the steps is no brake.
    tension : float
        Largest violation of the bounds of a reaction in N: -r, -P/h for an impulse in a step, or |r| - r0 of a slider.
    impact_law : float
        Largest violation in m/s of P >= 0, U⁺ + e U⁻ >= 0, P (U⁺ + e U⁻) = 0: |U⁺ + e U⁻| where an impulse acts.
    momentum : float
        Largest |M v - M v(0) - ∫ (f + s - K q - C v + B r) dt - Σ B P| of a node with mass in N s. A record with rtol has
        no integrals where more than two steps lie between its instants: it is zero then, and kinematics too.
    equilibrium : float
        Largest |f + s - K q - C v + B r| in N of a massless node; for the θ-method, the largest imbalance of impulses there,
        divided by the duration.
    kinematics : float
        Largest |q - q(0) - ∫ v dt| in m of a node whose velocity is an independent state.
    motion : float
        Largest |q_i - y(t)| in m of a node with prescribed motion, at the instants of the steps and between them, or
        |y(t) - y(0) - ∫ y' dt| by the velocity that is given with y.
    missed_impulse : float
        Largest impulse in N s by which a time-dependent load, or a prescribed motion by springs and dashpots, differs from
        what its values at the instants of the steps say (`lcpimpact.certificate.drives`): a blow within a step, a load that
        turns once in each. Loads that are signals with breakpoints act by their means, and none is missed. It is also the
        impulse by which the damping of a compliant contact pushes bodies that part in a step. Zero where
        the method chooses its steps: for a continuous solution, and with rtol.
    damping : float
        Largest velocity in m/s that remains at the end of a step in which dashpots should have taken it, beyond what other
        forces and impulses explain (`lcpimpact.certificate.damping`); zero where no dashpot stops a mass within a step.
    growth : float
        Factor by which an explicit method multiplies errors of a complementarity system in a run, where it is above 10: its
        steps are beyond their limit of stability (`lcpimpact.certificate.growth`).
    sampling : float
        Largest difference between the record and the continuous solution, relative to the scale of each series.
    length_scale, velocity_scale, force_scale, momentum_scale : float
        Largest gap in m and gap rate in m/s, largest sum of forces at a node in N, and largest momentum of a node in N s,
        for comparison.
    impact_gain : ImpactGain
        Whether Newton's law can gain energy at the impacts of the run, and what it gained; and what prescribed motions
        added. It is a property of the law and not an error of the run, so that it has no limit: it is in the energy balance.
    limits : mapping of str to float
        Limit of each violation that the method declares; see `lcpimpact.integrators.base.Limits`.
    """

    residual: float
    complementarity: float
    penetration: float
    energy_balance: float
    energy_scale: float
    energy_growth: float = 0.0
    energy_loss: float = 0.0
    tension: float = 0.0
    impact_law: float = 0.0
    momentum: float = 0.0
    equilibrium: float = 0.0
    kinematics: float = 0.0
    motion: float = 0.0
    missed_impulse: float = 0.0
    damping: float = 0.0
    growth: float = 0.0
    sampling: float = 0.0
    length_scale: float = 0.0
    velocity_scale: float = 0.0
    force_scale: float = 0.0
    momentum_scale: float = 0.0
    impact_gain: ImpactGain = field(default_factory=ImpactGain)
    limits: Mapping[str, float] = field(default_factory=dict)

    @property
    def failures(self) -> tuple[str, ...]:
        """Violations beyond their limits, as sentences with value and limit, in descending order of their ratio."""
        return self.sentences()

    def sentences(self, unit: Callable[[str], str] = str) -> tuple[str, ...]:
        """Return the `failures`; ``unit`` gives the unit in place of one in SI, as `Problem.own_unit` does."""
        beyond = {
            name: float(getattr(self, name) / limit if limit > 0.0 else np.inf)
            for name, limit in self.limits.items()
            if not getattr(self, name) <= limit < np.inf
        }
        return tuple(self._sentence(name, unit) for name in sorted(beyond, key=lambda name: -beyond[name]))

    def _sentence(self, name: str, unit: Callable[[str], str]) -> str:
        if not np.isfinite(self.limits[name]):
            return f"the run cannot be judged by its {name.replace('_', ' ')}, which overflows: take other units"
        sentence, of = SENTENCES[name]
        value = f"{getattr(self, name):.3g} {unit(of)}".rstrip()
        return f"{sentence.format(value)}, where {self.limits[name]:.2g} is allowed"

    @property
    def holds(self) -> bool:
        """Whether all violations are within their limits."""
        return not self.failures


def certify(
    dynamics: Dynamics,
    start: tuple[Array, Array],
    record: Record,
    dense: ContinuousSolution | None,
    events: Sequence[Event],
    integrator: Integrator | None,
    *,
    resolved_steps: float = 2.0,
) -> Certificate:
    """Judge a run from its results.

    Parameters
    ----------
    dynamics : Dynamics
        The system whose laws apply.
    start : pair of (n,) arrays
        Initial q and v.
    record : Record
        The recorded motion; its reactions do not include impulses.
    dense : ContinuousSolution or None
        The solution as a function of time, if the method has one; the laws are then judged on it by Gaussian quadrature.
    events : sequence of Event
        The events, with their impulses.
    integrator : Integrator or None
        The method, which declares the limits, and θ if the forces of its steps balance at t + θ h; None for no limits.
    resolved_steps : float
        Mean number of steps between two instants of a record up to which its integrals are those of the steps.
    """
    d = dynamics
    limits = Limits() if integrator is None else integrator.limits()
    residual = record.stats.residual
    limits = replace(limits, precision=limits.precision + RESIDUAL_FACTOR * residual)
    θ = None if integrator is None else integrator.balance_point()
    # A method that chooses its steps may take several between two instants of the record.
    adaptive = integrator is not None and integrator.rtol is not None
    with np.errstate(all="ignore"):
        if len(record.t) < 2:
            found, scales, energies = _nothing(d, record)
        elif dense is None and isinstance(d, LagrangianDynamics):
            found, scales, energies = judge_moving(d, start, record, events, integrator, limits)
        elif θ is not None:
            found, scales, energies = judge_theta_steps(d, record, events, θ, limits)
        elif dense is not None:
            found, scales, energies = judge_continuous(d, start, record, dense, events, limits)
        else:
            resolved = not adaptive or record.stats.steps <= resolved_steps * (len(record.t) - 1)
            found, scales, energies = judge_grid(d, start, record, events, integrator, limits, resolved=resolved)
        found["motion"] = _motion(d, record, limits)
        forces, momenta = scales.forces, scales.momenta
        several = adaptive and record.stats.steps > len(record.t) - 1
        every_step = dense is None and len(record.t) > 1 and not several
        if every_step and d.stores_energy and not isinstance(d, LagrangianDynamics):
            found["missed_impulse"] = _missed_impulse(d, record.t, momenta)
            if θ is None and d.springs:
                thrown = _thrown_back(d, record), THROWN * float(np.abs(record.v @ d.M).max())
                found["missed_impulse"] = larger_violation(found["missed_impulse"], thrown)
            found["motion"] = larger_violation(found["motion"], _missed_motion(d, record, limits))
            damping = judge_damping(d, record, events)
            if damping is not None:
                found["damping"] = damping
        if every_step and not d.stores_energy and integrator is not None:
            found["growth"] = judge_growth(d, record, integrator)
        gained = impact_gain(d, record, events, integrator, limits.precision) if d.stores_energy else ImpactGain()
        unseen = bool(d.force_laws) and every_step
        known = every_step or not _driven(d)
        spread = 1 if integrator is None else integrator.impact_steps
        passed = np.zeros(1)
        # Where steps do not impose the law of impact, what an impact gains is balanced by the work of its impulse.
        unsure = (θ is None and dense is None) or (1.0 + DRIFT) * energies.imbalance > DRIFT * energies.scale
        if d.stores_energy and (unseen or (known and unsure)):
            work, passed = account_of(d).supplied(record, events, spread)
            supplied = work + WORK_RTOL * passed + gained.gained
            found["energy_growth"] = _growth(d, start, record, scales, supplied, limits)
        # Where a balance closes, nothing is lost beyond it.
        if d.stores_energy and every_step and not {"energy_balance", "energy_loss"} & found.keys():
            slight = WORK_RTOL * passed[-1] + _slight(d, record, scales, energies.scale, limits)
            scale = energies.scale
            if energies.loss > DRIFT * scale + slight:
                flows = account_of(d).by_theta_rule(record, events, 0.5 if θ is None else θ, spread)
                scale = max(scale, float(np.cumsum(flows[:, len(INFLOWS) :].sum(axis=1)).max()))
            found["energy_loss"] = energies.loss, DRIFT * scale + slight
        if d.stores_energy and every_step and θ is not None and (elastic := elastic_contacts(d)).any():
            closing = _closing_loss(d, record, scales, energies.scale, elastic, limits)
            found["energy_loss"] = larger_violation(found.get("energy_loss", (0.0, 0.0)), closing)
    if not d.stores_energy:
        energies = Energies(np.nan, np.nan)
    allowed = {name: limit for name, (_, limit) in found.items()} if integrator is not None else {}
    if not limits.balances_energy or not d.stores_energy:
        allowed.pop("energy_balance", None)
    elif "energy_balance" in allowed and 0.0 < found["energy_balance"][0] < energies.imbalance:
        # The largest violation is reported; its ratio to its limit need not be the largest.
        allowed["energy_balance"] *= energies.imbalance / found["energy_balance"][0]
    violations = {name: float(value) for name, (value, _) in found.items() if name != "energy_balance"}
    return Certificate(
        residual=residual,
        energy_balance=float(energies.imbalance),
        energy_scale=float(energies.scale),
        length_scale=float(scales.u.max(initial=0.0)),
        velocity_scale=float(scales.U.max(initial=0.0)),
        force_scale=float(forces.max(initial=0.0)),
        momentum_scale=float(momenta.max(initial=0.0)),
        impact_gain=gained,
        limits={name: float(limit) for name, limit in allowed.items()},
        **violations,
    )


def _nothing(d: Dynamics, record: Record) -> tuple[Judgement, Scales, Energies]:
    """Return the certificate's values of a run that ended before its first step."""
    q = record.q
    v = record.v
    r = np.zeros((1, len(d.contacts)))
    energy = float(np.abs(d.energy(q, v)).max(initial=0.0))
    laws = ("complementarity", "penetration", "energy_balance")
    return dict.fromkeys(laws, (0.0, 0.0)), Scales.of(d, q, v, r, d.applied(record.t, q, v)), Energies(0.0, energy)


def _growth(
    d: Dynamics, start: tuple[Array, Array], record: Record, scales: Scales, supplied: Array, limits: Limits
) -> tuple[float, float]:
    """Return the largest growth of the stored energy beyond that ``supplied`` up to each instant (nt,), and its limit."""
    account = account_of(d)
    q0, v0 = start
    before = account.stored(q0[None], v0[None], q0).sum()
    stored = account.stored(record.q, record.v, q0)
    # An impact at an instant of the record has changed its velocities, and its work is that of the step that begins there.
    soon = np.maximum(supplied, np.append(supplied[1:], supplied[-1:]))
    growth = np.maximum(stored.sum(axis=1) - before - soon, 0.0)
    # A negative spring stores less than nothing, so that the energy of a fast motion may be small.
    scale = float((np.abs(stored[:, :2]).sum(axis=1) - growth).max(initial=0.0))
    limit = DRIFT * scale + _slight(d, record, scales, scale, limits)
    return float(growth.max(initial=0.0)), limit


def _closing_loss(
    d: Dynamics, record: Record, scales: Scales, scale: float, elastic: Flags, limits: Limits
) -> tuple[float, float]:
    """Return the largest energy in J that elastic contacts take in one step, and its limit.

    In the step that closes a contact the force at its end acts along the opening at its beginning. It rises from zero, so
    that the product is of the second order, unless a body is stopped within the step where springs would throw it back.
    """
    taken = np.maximum(-record.reaction * np.diff(d.gap(record.t, record.q), axis=0), 0.0)[:, elastic].sum(axis=1)
    h = float(np.diff(record.t).max())
    v = largest(record.v)
    m = np.diag(d.M)
    load = largest(d.applied(record.t, record.q, record.v))
    v = np.maximum(v, np.divide(h * load, m, out=np.zeros_like(load), where=m > 0.0))
    allowed = DRIFT * scale + h * float(load @ v) + _slight(d, record, scales, scale, limits)
    return float(taken.max(initial=0.0)), allowed


def _slight(d: Dynamics, record: Record, scales: Scales, scale: float, limits: Limits) -> float:
    """Return the energy in J that is no gain and no loss, of a run whose stored energy has a given scale.

    What rests may be moved by the loads of one step, and energies of large terms that cancel have their rounding error.
    """
    h = float(np.diff(record.t).max(initial=0.0))
    q = largest(record.q)
    v = largest(record.v)
    load, m = np.abs(steady_loads(d)), np.diag(d.M)
    v = np.maximum(v, np.divide(h * load, m, out=np.zeros_like(load), where=m > 0.0))
    slight = h * float(load @ v) + limits.precision * (scale + float(load @ q))
    return slight + SUM_RTOL * float(scales.forces @ scales.q + scales.momenta @ v)


def _driven(d: Dynamics) -> bool:
    """Return whether something may supply energy: a load that changes, a prescribed motion, a general force."""
    return not d.constant_loads or bool(d.motions or d.force_laws) or isinstance(d, LagrangianDynamics)


def _missed_impulse(d: Dynamics, t: Array, momenta: Array) -> tuple[float, float]:
    """Return the largest impulse of the drives that the steps miss, and its limit."""
    missed, had = missed_impulses(d, t)
    by_momentum = MOMENTUM_FRACTION * np.where(d.massive, momenta, momenta.max(initial=0.0))
    return largest_violation(missed, SEEN_FRACTION * had + by_momentum)


def _thrown_back(d: Dynamics, record: Record) -> float:
    """Return the largest impulse in N s by which the damping of a non-linear spring pushes in a step whose ends part.

    Damping only holds back what parts. Its forces at the ends of a step that say otherwise turn the body, as the last force
    of a dashpot does that stopped it within the step before.
    """
    δ, rate = d.approach(record.q), d.approach_rate(record.v)
    damping = spring_forces(d.power_laws, δ, rate) - spring_forces(d.power_laws, δ, np.zeros_like(rate))
    pushes = np.diff(record.t)[:, None] * 0.5 * (damping[1:] + damping[:-1])
    return float(np.where(np.diff(δ, axis=0) < 0.0, pushes, 0.0).max(initial=0.0))


def _missed_motion(d: Dynamics, record: Record, limits: Limits) -> tuple[float, float]:
    """Return the largest deviation of a prescribed motion between the steps, or from the integral of its velocity."""
    if not d.motions:
        return 0.0, 0.0
    t, nodes = record.t, list(d.motions)
    q, v = (np.ascontiguousarray(each[:, nodes]) for each in (record.q, record.v))
    off = [between_steps(motion, t, q[:, k], v[:, k]) for k, motion in enumerate(d.motions.values())]
    limit = SEEN_FRACTION * np.ptp(q, axis=0) + MOMENTUM_FRACTION * np.abs(record.q).max()
    between = largest_violation(np.array(off), limit)
    way = np.cumsum(np.diff(q, axis=0) - trapezoids(np.diff(t)[:, None], v), axis=0)
    allowed = limits.precision * np.abs(q).max(axis=0) + limits.slack * trapezoid_errors(np.diff(t), v, limits.order)
    return larger_violation(between, largest_violation(np.abs(way), allowed))


def _motion(d: Dynamics, record: Record, limits: Limits) -> tuple[float, float]:
    """Return the largest deviation of the nodes with prescribed motion from it, and its limit."""
    if not d.motions:
        return 0.0, 0.0
    y, _ = d.motion(record.t)
    h = np.diff(record.t)
    v = np.ascontiguousarray(record.v[:, d.driven])
    off = np.abs(record.q[:, d.driven] - y)
    for k, (i, motion) in enumerate(sorted(d.motions.items())):
        if jumps(motion):  # an instant of the grid that is that of a jump has either value
            off[:, k] = np.min([np.abs(record.q[:, i] - each) for each in limits_at(motion, record.t)], axis=0)
    off = off.max(axis=0)
    between = trapezoid_errors(h, v, limits.order).max(axis=0, initial=0.0)
    return largest_violation(off, limits.precision * np.abs(y).max(axis=0) + between)
