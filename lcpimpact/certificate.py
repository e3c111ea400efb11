"""The certificate of a run: how far it is from the laws that it should obey, computed from what the run holds alone."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal, TypeAlias

import numpy as np
from numba import types

from lcpimpact.arrays import Array, Flags, Indices, Places
from lcpimpact.compiled import compiled, f8, flags, matrix, vector
from lcpimpact.events import step_of
from lcpimpact.integrators.base import Integrator, Limits
from lcpimpact.record import SLIPS, ContinuousSolution, Event, Record
from lcpimpact.scheme.dynamics import Dynamics
from lcpimpact.theta_balance import (
    DAMPED,
    DRIVEN,
    FREE,
    MASSIVE,
    Contacts,
    Impulses,
    Nodes,
    Recorded,
    Sparse,
    SpringLaws,
    certify_steps,
    no_violations,
    sums_for,
)

GAUSS_NODES, GAUSS_WEIGHTS = np.polynomial.legendre.leggauss(6)

LEGENDRE = np.polynomial.legendre.legvander(GAUSS_NODES, 5) * GAUSS_WEIGHTS[:, None] * (np.arange(6) + 0.5)
"""Matrix from values at Gauss's nodes to the coefficients of Legendre's polynomials."""

RESIDUAL_FACTOR = 1e3
"""Violation of the laws, each in its own unit, that an LCP solved to a residual causes, in units of it."""

SLOPE, JUMP = 0.25, 0.6
"""Differences of a method from the trapezoidal rule, in units of h times a change and of h times a second difference;
the rule's own are 1/12 and 1/2."""

NEIGHBOURS = 5
"""Number of points on either side of a step whose second differences bound the error of the step."""

IMPACT_FACTOR = 2.0
"""Error of an impulse, in units of h times the jump of the forces at an impact: registered problems show up to 1."""

UNIFORM_RTOL = 1e-6
"""Difference of a step from the shortest, relative to it, above which the steps are not uniform."""

MIN_POINTS = 3
"""Number of points up to which a run shows no second differences."""

SCALE_FLOOR = 1e-6
"""Smallest scale of a motion, relative to the largest: at a precision of 1e-9 of it, it is rounding."""

SENTENCES = {
    "complementarity": "force and gap, or friction and sliding, are complementary but for {:.3g} J",
    "penetration": "bodies penetrate by {:.3g} m",
    "energy_balance": "the energy is out of balance by {:.3g} J",
    "tension": "a reaction is outside its bounds by {:.3g} N",
    "impact_law": "the impact law is violated by {:.3g} m/s",
    "momentum": "the momentum is out of balance by {:.3g} N s",
    "equilibrium": "a node without mass is out of balance by {:.3g} N",
    "kinematics": "coordinates and velocities differ by {:.3g} m",
    "sampling": "what is recorded differs from the continuous solution by {:.3g} of its scale",
    "motion": "a node is off the motion that is given by {:.3g} m",
}

Found: TypeAlias = dict[str, tuple[float, float]]
"""The violation of each law, and what is allowed there."""


@dataclass(frozen=True)
class Certificate:
    """Greatest violations over a run; each is zero for the exact motion.

    Attributes
    ----------
    residual : float
        Largest residual of the LCPs of the steps, in units where max |W| = max |q| = 1; zero where none is solved.
    complementarity : float
        Largest product in J: r u while a contact pushes, impulse times U⁺ + e U⁻ in an impact, and what the friction of a
        slider should dissipate in a step more than it does, r0 |U| + r U.
    penetration : float
        Largest -u in m.
    energy_balance : float
        Largest |E(t) - E(0) - work of loads and contacts + dissipation| in J, where an impact works P (U⁻ + U⁺)/2. With
        the θ-method it is what the method itself adds or takes, zero to rounding for θ = 1/2 and linear springs. NaN for a
        system that is given directly, which has no energy to balance.
    energy_scale : float
        Largest size of the stored energy in the run in J, to compare with.
    tension : float
        By how much a reaction leaves its bounds in N: -r, -P/h for an impulse in a step, or |r| - r0 of a slider.
    impact_law : float
        Largest violation in m/s of P >= 0, U⁺ + e U⁻ >= 0, P (U⁺ + e U⁻) = 0: |U⁺ + e U⁻| where an impulse acts.
    momentum : float
        Largest |M v - M v(0) - ∫ (f + s - K q - C v + B r) dt - Σ B P| of a node with mass in N s.
    equilibrium : float
        Largest |f + s - K q - C v + B r| in N of a node without mass; of the θ-method, the largest impulse that has gone
        missing there, over the duration.
    kinematics : float
        Largest |q - q(0) - ∫ v dt| in m of a node that has a velocity of its own.
    motion : float
        Largest |q_i - y(t)| in m of a node whose motion is given.
    sampling : float
        Largest difference of what is recorded from the continuous solution, relative to the scale of each series.
    length_scale, velocity_scale, force_scale, momentum_scale : float
        Largest opening in m, its rate in m/s, the largest sum of forces at a node in N, and the largest momentum of a node
        in N s, to compare with.
    limits : mapping of str to float
        What the method allows of each, where it declares a limit; see `lcpimpact.integrators.base.Limits`.
    """

    residual: float
    complementarity: float
    penetration: float
    energy_balance: float
    energy_scale: float
    tension: float = 0.0
    impact_law: float = 0.0
    momentum: float = 0.0
    equilibrium: float = 0.0
    kinematics: float = 0.0
    motion: float = 0.0
    sampling: float = 0.0
    length_scale: float = 0.0
    velocity_scale: float = 0.0
    force_scale: float = 0.0
    momentum_scale: float = 0.0
    limits: Mapping[str, float] = field(default_factory=dict)

    @property
    def failures(self) -> tuple[str, ...]:
        """What is beyond its limit, the worst first, each as a sentence with the number and the limit."""
        beyond = {
            name: float(getattr(self, name) / limit if limit > 0.0 else np.inf)
            for name, limit in self.limits.items()
            if not getattr(self, name) <= limit
        }
        return tuple(
            f"{SENTENCES[name].format(getattr(self, name))}, where {self.limits[name]:.2g} is allowed"
            for name in sorted(beyond, key=lambda name: -beyond[name])
        )

    @property
    def holds(self) -> bool:
        """Whether nothing is beyond its limit."""
        return not self.failures


@dataclass(frozen=True, eq=False)
class Pieces:
    """The pieces of a motion between cuts (nk,), and integrals over them by Gauss's rule."""

    cuts: Array

    @property
    def times(self) -> Array:
        """The nodes of the rule, in the order of time (nt,)."""
        half = 0.5 * np.diff(self.cuts)
        return np.asarray(((self.cuts[:-1] + half)[:, None] + half[:, None] * GAUSS_NODES).ravel())

    def each(self, values: Array) -> Array:
        """Return the integral of values (nt, ...) at the nodes over each piece (nk - 1, ...)."""
        inner = np.asarray(values).reshape(len(self.cuts) - 1, len(GAUSS_NODES), *values.shape[1:])
        return np.asarray(np.einsum("kg...,g,k->k...", inner, GAUSS_WEIGHTS, 0.5 * np.diff(self.cuts)))

    def integral(self, values: Array) -> Array:
        """Return the integral of values (nt, ...) at the nodes from the first cut to each (nk, ...)."""
        pieces = self.each(values)
        return np.concatenate([np.zeros((1, *values.shape[1:])), np.cumsum(pieces, axis=0)])

    def unresolved(self, values: Array, degree: int) -> Array:
        """Return h Σ |a_j|, j = ``degree`` ... 5, with Legendre's coefficients a_j on each piece (nk - 1, ...)."""
        inner = np.asarray(values).reshape(len(self.cuts) - 1, len(GAUSS_NODES), *values.shape[1:])
        a = np.abs(np.einsum("kg...,gj->kj...", inner, LEGENDRE[:, min(degree, 5) :])).sum(axis=1)
        return np.asarray(a * np.diff(self.cuts).reshape(-1, *[1] * (values.ndim - 1)))


@dataclass(frozen=True, eq=False)
class Scales:
    """The largest values of a run: |q| and |v| of each node (n,), |u|, |U| and |r| of each row (nc,), |f| (n,)."""

    q: Array
    v: Array
    u: Array
    U: Array
    r: Array
    f: Array

    @classmethod
    def of(cls, d: Dynamics, q: Array, v: Array, r: Array, f: Array) -> Scales:
        """Return those of arrays over time."""
        q, v, r, f = (np.abs(each).max(axis=0, initial=0.0) for each in (q, v, r, f))
        return cls(q, v, np.abs(d.H) @ q + np.abs(d.u0) + np.abs(d.D) @ r, np.abs(d.H) @ v, r, f)

    def at_least(self, d: Dynamics, h: float) -> Scales:
        """Return scales that a body at rest has, too: what its forces would do in a time h, and a share of the fastest."""
        v = self.v + SCALE_FLOOR * self.v.max(initial=0.0)
        massive = d.massive
        if massive.any():
            v[massive] += h * np.abs(np.linalg.solve(d.M[np.ix_(massive, massive)], self.forces(d)[massive]))
        q = self.q + SCALE_FLOOR * self.q.max(initial=0.0) + h * v
        return Scales(q, v, np.abs(d.H) @ q + np.abs(d.u0) + np.abs(d.D) @ self.r, np.abs(d.H) @ v, self.r, self.f)

    def forces(self, d: Dynamics) -> Array:
        """Return the sum of the largest forces at each node in N (n,)."""
        linear = np.abs(d.K) @ self.q + np.abs(d.C) @ self.v + np.abs(d.B) @ self.r + self.f
        return np.asarray(linear + np.abs(d.spring_force(self.q, self.v)))

    def momenta(self, d: Dynamics) -> Array:
        """Return the largest momentum of each node in N s (n,)."""
        return np.asarray(np.abs(d.M) @ self.v)


def certify(
    dynamics: Dynamics,
    start: tuple[Array, Array],
    record: Record,
    dense: ContinuousSolution | None,
    events: Sequence[Event],
    integrator: Integrator | None,
) -> Certificate:
    """Judge a run from what it holds.

    Parameters
    ----------
    dynamics : Dynamics
        The system whose laws are meant.
    start : pair of (n,) arrays
        q and v with which its motion begins.
    record : Record
        What was recorded. Reactions hold no impulses.
    dense : ContinuousSolution or None
        The solution as a function of time, where the method has one: then all is judged on it, by Gauss's rule.
    events : sequence of Event
        What happened, with the impulses.
    integrator : Integrator or None
        The method, which says what it allows, and θ where the forces of its steps balance at t + θ h; without one nothing
        is beyond a limit.
    """
    d = dynamics
    limits = Limits() if integrator is None else integrator.limits()
    residual = record.stats.residual
    limits = replace(limits, precision=limits.precision + RESIDUAL_FACTOR * residual)
    θ = None if integrator is None else integrator.balance_point()
    with np.errstate(all="ignore"):
        if len(record.t) < 2:
            found, scales, energies = _nothing(d, record)
        elif θ is not None:
            found, scales, energies = _judge_by_balance(d, record, events, θ, limits)
        elif dense is not None:
            found, scales, energies = _judge_dense(d, start, record, dense, events, limits)
        else:
            found, scales, energies = _judge_grid(d, start, record, events, integrator, limits)
        found["motion"] = _motion(d, record, limits)
        forces, momenta = scales.forces(d), scales.momenta(d)
    if not d.stores_energy:
        energies = (np.nan, np.nan)
    allowed = {name: limit for name, (_, limit) in found.items()} if integrator is not None else {}
    if not limits.balances_energy or not d.stores_energy:
        allowed.pop("energy_balance", None)
    elif allowed and 0.0 < found["energy_balance"][0] < energies[0]:
        # What is told is the largest violation, which may be allowed more than the one that is worst beside its limit.
        allowed["energy_balance"] *= energies[0] / found["energy_balance"][0]
    violations = {name: float(value) for name, (value, _) in found.items() if name != "energy_balance"}
    return Certificate(
        residual=residual,
        energy_balance=float(energies[0]),
        energy_scale=float(energies[1]),
        length_scale=float(scales.u.max(initial=0.0)),
        velocity_scale=float(scales.U.max(initial=0.0)),
        force_scale=float(forces.max(initial=0.0)),
        momentum_scale=float(momenta.max(initial=0.0)),
        limits=allowed,
        **violations,
    )


def _nothing(d: Dynamics, record: Record) -> tuple[Found, Scales, tuple[float, float]]:
    """Judge a run that ended before its first step."""
    q, v, r = record.q, record.v, np.zeros((1, len(d.contacts)))
    energy = float(np.abs(d.energy(q, v)).max(initial=0.0))
    laws = ("complementarity", "penetration", "energy_balance")
    return dict.fromkeys(laws, (0.0, 0.0)), Scales.of(d, q, v, r, d.force(record.t)), (0.0, energy)


def _worst(values: Array, allowed: Array) -> tuple[float, float]:
    """Return the violation that is worst beside what is allowed of it, and that limit."""
    values, allowed = np.broadcast_arrays(np.asarray(values, dtype=np.float64), allowed)
    if values.size == 0:
        return 0.0, 0.0
    ratio = np.where(values > 0.0, values / allowed, 0.0)
    at = int(np.argmax(np.where(np.isnan(values), np.inf, ratio)))
    return float(values.ravel()[at]), float(allowed.ravel()[at])


def _motion(d: Dynamics, record: Record, limits: Limits) -> tuple[float, float]:
    """Return how far driven nodes are from their motion."""
    if not d.motions:
        return 0.0, 0.0
    y, _ = d.motion(record.t)
    h, v = np.diff(record.t), np.ascontiguousarray(record.v[:, d.driven])
    off = np.abs(record.q[:, d.driven] - y).max(axis=0)
    return _worst(off, limits.precision * np.abs(y).max(axis=0) + bends(h, v, limits.order).max(axis=0, initial=0.0))


def _kinds(d: Dynamics) -> Indices:
    """Return the kinds of the nodes: 1 with mass, 2 with a given motion, 0 with dashpots, -1 held by springs only (n,)."""
    driven, massive = d.driven, d.massive
    loose: Flags = np.zeros(len(massive), dtype=np.bool_)
    if not (driven | massive).all():
        loose = np.asarray(d.decomposition.static.any(axis=1))
    return np.select([driven, massive, loose], [DRIVEN, MASSIVE, FREE], DAMPED).astype(np.int64)


def _largest_impulses(d: Dynamics, events: Sequence[Event]) -> Array:
    """Return the largest impulse of each row in N s (nc,)."""
    P = np.zeros(len(d.contacts))
    rows = _rows(d)
    for event in events:
        if event.impulse:
            P[rows[event.contact]] = max(P[rows[event.contact]], abs(event.impulse))
    return P


def _rows(d: Dynamics) -> dict[str, int]:
    """Return the row of each contact by its name."""
    return {contact.name: i for i, contact in enumerate(d.contacts)}


def _pattern(filled: Array) -> tuple[Sparse, tuple[Places, Places]]:
    """Return where the filled places of a matrix are, by rows, and their rows and columns."""
    rows, columns = np.nonzero(filled)
    starts = np.append(0, np.cumsum(np.count_nonzero(filled, axis=1)))
    places = rows.astype(np.uint64), columns.astype(np.uint64)
    return Sparse(starts.astype(np.uint64), places[1]), places


def _judge_by_balance(
    d: Dynamics, record: Record, events: Sequence[Event], θ: float, limits: Limits
) -> tuple[Found, Scales, tuple[float, float]]:
    """Judge steps whose forces balance at t + θ h: all but kinks in position is exact there."""
    rows, kind = _rows(d), _kinds(d)
    acting = sorted(
        (step_of(event, record.t, record.q, record.v), rows[event.contact], event.impulse)
        for event in events
        if event.impulse != 0.0
    )
    step, row = (np.array([each[i] for each in acting], dtype=np.int64) for i in (0, 1))
    f = d.force(np.zeros(1) if d.constant_loads else record.t)
    pattern, at = _pattern((d.M != 0.0) | (d.C != 0.0) | (d.K != 0.0))
    H_pattern, H_at = _pattern(d.H != 0.0)
    contacts = Contacts(
        *(H_pattern, d.H[H_at], np.array(d.B, order="C"), np.array(d.D, order="C"), d.u0.copy(), d.restitution),
        *(d.r_min, d.r_max, d.relative_degree, np.array(d.impulse_lines, order="C")),
    )
    of = no_violations(len(d.contacts), len(d.nodes))
    balance, scale, h = certify_steps(
        Recorded(record.t, record.q, record.v, record.reaction, f),
        Impulses(step, row, np.array([each[2] for each in acting])),
        float(θ),
        Nodes(pattern, d.M[at], d.C[at], d.K[at], kind),
        contacts,
        SpringLaws(d.directions, d.power_laws),
        sums_for(contacts, len(d.nodes)),
        of,
    )
    product, R, stroke, q, v = of.product, of.r, of.stroke, of.q, of.v
    scales = Scales(
        q, v, np.abs(d.H) @ q + np.abs(d.u0) + np.abs(d.D) @ R, np.abs(d.H) @ v, R, np.abs(f).max(axis=0)
    ).at_least(d, h)
    steps, duration = len(record.t) - 1, float(record.t[-1] - record.t[0]) or 1.0
    forces, largest, bounds = scales.forces(d), _largest_impulses(d, events), np.where(d.slides, d.r_max, 0.0)
    ε = limits.precision + 8.0 * steps * np.finfo(float).eps
    momenta = scales.momenta(d) + h * forces
    # The length of a step is a difference of times, and has their rounding; an impulse is h times a mean force.
    blur, shortest = 4.0 * np.finfo(float).eps * duration, float(np.diff(record.t).min())
    # A node whose motion is given has the mean velocity of its step in the law, and its own in the record.
    turned = np.abs(np.diff(record.v[:, d.driven], axis=0)).max(axis=0, initial=0.0)
    slow = limits.precision * scales.U.max(initial=0.0) + np.abs(d.H[:, d.driven]) @ turned
    # Contacts of an impulse path over massless nodes meet at velocity level, and may overlap as others close.
    met = (d.relative_degree == 2) | (d.impulse_lines > 0.0).any(axis=0)
    strict = ~met & ~(kind < 0).any()
    stroke = np.maximum(stroke, h * scales.U)
    for path in d.impulse_lines > 0.0:
        stroke[path] = stroke[path].sum()
        slow[path] = np.maximum(slow[path], slow[path].sum())
    # Which steps of a system that can jump were taken with θ = 1 is read off u, and not certain where no row pushes.
    late = (1.0 - θ) * h / duration if d.D.any() else 0.0
    found = {
        "complementarity": _worst(
            product,
            np.where(
                met,
                (h * (R + bounds) + largest) * slow,
                limits.precision * (R * scales.u + h * bounds * scales.U) + 2.0 * bounds * _crept(d, record),
            ),
        ),
        "penetration": _worst(of.penetration, np.where(strict, 0.0, stroke) + limits.precision * scales.u),
        "energy_balance": (
            balance, ε * (scale + float(v @ momenta)) if θ == 0.5 and (kind >= 0).all() and not d.springs else np.inf,
        ),
        "tension": _worst(of.tension, limits.precision * (R + largest / max(h, 1e-300))),
        "impact_law": _worst(of.law, slow),
        "momentum": _worst(of.momentum, ε * momenta + blur * (steps * forces + np.abs(d.B) @ largest / shortest)),
        "equilibrium": _worst(
            of.equilibrium / duration,
            late * forces + ε * (forces + (np.abs(d.B) @ largest + scales.momenta(d)) / duration),
        ),
        "kinematics": _worst(of.kinematics, limits.precision * (scales.q + h * scales.v)),
    }  # fmt: skip
    return found, scales, (balance, scale)


def _crept(d: Dynamics, record: Record) -> Array:
    """Return how far a slider on springs may be moved back in a step, as one that is near its threshold slips, in m (nc,).

    That is by a force of `SLIPS` times its threshold on the springs that hold it; and as a node between springs alone goes
    to its balance at the end of a step whose force is that at t + θ h, by what the way of one step differs from the next.
    """
    static = d.decomposition.static
    if not static.any() or not d.slides.any():
        return np.zeros(len(d.contacts))
    moves = d.H @ static
    gives = np.abs(moves * np.linalg.lstsq(static.T @ d.K @ static, moves.T, rcond=None)[0].T).sum(axis=1)
    held = d.slides & (d.relative_degree == 0)
    turned = np.abs(np.diff(np.diff(record.q, axis=0) @ d.H[held].T, axis=0)).max(axis=0, initial=0.0)
    crept = np.asarray(SLIPS * np.where(d.slides, d.r_max, 0.0) * gives)
    crept[held] += turned
    return crept


@dataclass(frozen=True, eq=False)
class Impacts:
    """The impacts of a run, one of each instant.

    Attributes
    ----------
    t : (ni,) array                 when
    q, before, after : (ni, n)      the places, and the limits of the velocities
    P : (ni, nc)                    the impulses
    """

    t: Array
    q: Array
    before: Array
    after: Array
    P: Array

    @classmethod
    def of(cls, d: Dynamics, events: Sequence[Event]) -> Impacts:
        """Return those of events, where such as have their limits in common are one."""
        rows = _rows(d)
        struck = [event for event in events if event.impulse != 0.0]
        limits = [(event.t, event.left.v.tobytes(), event.right.v.tobytes()) for event in struck]
        first = [k for k, each in enumerate(limits) if k == 0 or each != limits[k - 1]]
        n, P = len(d.nodes), np.zeros((len(first), len(d.contacts)))
        one = np.searchsorted(first, np.arange(len(struck)), side="right") - 1
        row = np.array([rows[event.contact] for event in struck], dtype=np.int64)
        np.add.at(P, (one, row), [event.impulse for event in struck])
        t = np.array([struck[k].t for k in first])
        q, before, after = (
            np.array([getattr(getattr(struck[k], side), name) for k in first]).reshape(-1, n)
            for side, name in (("left", "q"), ("left", "v"), ("right", "v"))
        )
        return cls(t, q, before, after, P)

    def steps(self, t: Array, side: Literal["left", "right"] = "left") -> Indices:
        """Return the step of the grid t in which each is; one on the grid is in the step on that side of it."""
        return np.clip(np.searchsorted(t, self.t, side=side) - 1, 0, len(t) - 2)

    def __getitem__(self, chosen: Any) -> Impacts:
        """Return some of them."""
        return Impacts(self.t[chosen], self.q[chosen], self.before[chosen], self.after[chosen], self.P[chosen])


def _impact_law(d: Dynamics, impacts: Impacts, touch: Array) -> Array:
    """Return the violation of the law in m/s of each row in each impact (ni, nc); rows with u <= ``touch`` touch.

    The rates of nodes without mass after an impact are no states: they are what fits the law best.
    """
    before, after, P, e = d.gap_rate(impacts.before), d.gap_rate(impacts.after), impacts.P, d.restitution
    struck, off = P != 0.0, after + e * before
    # A contact that opens already, and is held back by another, may part at any greater rate.
    off = np.where((before > 0.0) & (np.abs(after) < np.abs(off)), after, off)
    free = d.H[:, ~d.massive & ~d.driven]
    for k in np.flatnonzero((struck & free.any(axis=1)).any(axis=1)):
        rows = struck[k]
        off[k, rows] -= free[rows] @ np.linalg.lstsq(free[rows], off[k, rows], rcond=None)[0]
    violation = np.where(struck, np.abs(off), 0.0)
    violation = np.where(P < 0.0, np.maximum(violation, np.abs(after - before)), violation)
    idle = ~struck & ~d.slides & (d.gap(impacts.q) <= touch) & ~free.any(axis=1)
    return np.where(idle, np.maximum(0.0, -(after + e * np.minimum(before, 0.0))), violation)


def _judge_impacts(d: Dynamics, impacts: Impacts, touch: Array, shortest: float = 0.0) -> tuple[Array, Array]:
    """Return the largest violation of the impact law and product of each row (nc,).

    A row that has flown for less than ``shortest`` may stay closed: so accumulating impacts are ended.
    """
    violation, count = _impact_law(d, impacts, touch), np.arange(len(impacts.t))
    flown = np.full(violation.shape, np.inf)
    for i in range(len(d.contacts)):
        struck = np.flatnonzero(impacts.P[:, i])
        last = np.searchsorted(struck, count) - 1
        flown[last >= 0, i] = (impacts.t - impacts.t[struck[last]])[last >= 0] if len(struck) else 0.0
    ends = flown < shortest
    violation = np.where(ends, np.minimum(violation, np.abs(d.gap_rate(impacts.after))), violation)
    return violation.max(axis=0, initial=0.0), (np.abs(impacts.P) * violation).max(axis=0, initial=0.0)


def _work(d: Dynamics, impacts: Impacts) -> Array:
    """Return the work P (U⁻ + U⁺)/2 of impacts in J (ni,), and that of the forces that drive the nodes they strike."""
    mean = 0.5 * (impacts.before + impacts.after)
    driving = ((impacts.P @ d.B.T) * mean)[:, d.driven].sum(axis=1)
    return np.asarray((impacts.P * d.gap_rate(mean)).sum(axis=1) - driving)


def _friction(d: Dynamics, r: Array, U: Array) -> Array:
    """Return the power r0 |U| + r U in W that sliders should take more than they do; zero for other rows (..., nc)."""
    bounds = np.where(d.slides, d.r_max, 0.0)
    return np.asarray(np.where(d.slides, bounds * np.abs(U) + r * U, 0.0))


def _excess(d: Dynamics, r: Array) -> Array:
    """Return by how much reactions leave their bounds in N (..., nc)."""
    return np.maximum(np.maximum(d.r_min - r, r - d.r_max), 0.0)


def _smooth(d: Dynamics, t: Array, q: Array, v: Array, r: Array | None) -> tuple[Array, Array]:
    """Return the loads f, and the forces f + s - K q - C v + B r on the nodes (nt, n); without r those that are smooth."""
    f = np.broadcast_to(d.force(0.0), q.shape) if d.constant_loads else d.force(t)
    g = f - q @ d.K.T - v @ d.C.T
    if d.springs:
        g += d.spring_force(q, v)
    if r is not None:
        g += r @ d.B.T
    return f, g


def _powers(d: Dynamics, t: Array, q: Array, v: Array, r: Array) -> Array:
    """Return the power in W of loads, sliders and forces that drive nodes, less what dashpots and springs dissipate."""
    friction = (r * d.gap_rate(v))[:, d.slides].sum(axis=1)
    return np.asarray(d.load_power(t, v) - d.dissipated_power(q, v) + friction + d.driving_power(t, q, v, r))


def _judge_dense(
    d: Dynamics,
    start: tuple[Array, Array],
    record: Record,
    dense: ContinuousSolution,
    events: Sequence[Event],
    limits: Limits,
) -> tuple[Found, Scales, tuple[float, float]]:
    """Judge a solution that is known at all times, piece by piece between its cuts and its events."""
    ε, kind = limits.precision, _kinds(d)
    end = record.t[-1]
    cuts = np.unique(
        np.concatenate([dense.cuts[dense.cuts <= end], [event.t for event in events if event.t <= end], [end]])
    )
    pieces = Pieces(cuts)
    times, resolved = pieces.times, dense.resolves(cuts)
    h = np.where(resolved, np.diff(cuts), 0.0)
    q, v, r = dense.read(times, "right")
    q_right, v_right, r_right = dense.read(cuts, "right")
    q_left, v_left = q_right.copy(), v_right.copy()
    q_left[0], v_left[0] = start
    rates = kind >= DAMPED
    if not d.stores_energy:
        q_left[0] = q_right[0]
    instants, first = np.unique([event.t for event in events], return_index=True)
    for k, one in zip(np.searchsorted(cuts, instants), first, strict=True):
        if 0 < k < len(cuts):
            q_left[k], v_left[k] = events[one].left.q, events[one].left.v
    impacts = Impacts.of(d, events)
    impacts = impacts[impacts.t <= end]
    P = np.zeros((len(cuts), len(d.nodes)))
    worked = np.zeros(len(cuts))
    at = np.searchsorted(cuts, impacts.t)
    np.add.at(P, at, impacts.P @ d.B.T)
    np.add.at(worked, at, _work(d, impacts))
    f, g = _smooth(d, times, q, v, r)
    all_q, all_v, all_r = (np.concatenate(each) for each in ((q, q_right), (v, v_right, v_left), (r, r_right)))
    scales = Scales.of(d, all_q, all_v, all_r, f).at_least(d, float(h.max(initial=0.0)))
    forces, momenta = scales.forces(d), scales.momenta(d)

    jump = (v_right - v_left) @ d.M.T - P
    between = (v_left[1:] - v_right[:-1]) @ d.M.T - pieces.each(g)
    # What a rule cannot integrate is not judged by it.
    lack = _cumulated(jump, between * resolved[:, None])
    way = q_left[1:] - q_right[:-1] - pieces.each(v)
    moved = _cumulated(q_right - q_left, way * resolved[:, None])
    free, ways = ~d.driven, rates
    rounding = 64.0 * np.finfo(float).eps * np.cumsum(np.append(0.0, h))
    coarse_g, coarse_v = (limits.slack * _grown(pieces, each, limits.order) for each in (g, v))
    allowed_p = np.repeat(ε * momenta + rounding[:, None] * forces + coarse_g, 2, axis=0)
    allowed_q = np.repeat(ε * scales.q + rounding[:, None] * scales.v + coarse_v, 2, axis=0)

    stored_right, stored_left = d.energy(q_right, v_right), d.energy(q_left, v_left)
    power = _powers(d, times, q, v, r)
    gained = stored_left[1:] - stored_right[:-1] - pieces.each(power)
    energy = _cumulated(stored_right - stored_left - worked, gained * resolved)
    scale = float(np.abs(np.concatenate([stored_right, stored_left])).max())
    # What jumps at the very start is judged by the momentum: nodes that springs hold go to their balance.
    energy = np.append(0.0, energy[1:] - energy[1])
    # Energies of large terms that cancel are rounding of these.
    terms = 64.0 * np.finfo(float).eps * float(forces @ scales.q + momenta @ scales.v)
    coarse_E = limits.slack * _grown(pieces, power[:, None], limits.order)[:, 0]
    allowed_E = ε * scale + terms + rounding * np.abs(power).max() + coarse_g @ scales.v + coarse_v @ forces + coarse_E

    u, U = d.gap(q) + r @ d.D.T, d.gap_rate(v)
    u_right = d.gap(q_right) + r_right @ d.D.T
    one_sided = ~d.slides
    overlap = np.maximum(0.0, -np.minimum(u.min(axis=0), u_right.min(axis=0)))
    product = np.maximum(np.abs(r * u).max(axis=0), np.abs(r_right * u_right).max(axis=0))
    friction = np.abs(pieces.each(_friction(d, r, U))).max(axis=0)
    # What touches but for rounding may be one of the next instant.
    touch = -ε * scales.u
    violation, worked_off = _judge_impacts(d, impacts, touch, limits.rest * end)
    largest = _largest_impulses(d, events)
    accelerations = _accelerations(d, g)
    slow = ε * scales.U + limits.rest * end * accelerations
    for path in d.impulse_lines > 0.0:
        slow[path] = np.maximum(slow[path], slow[path].sum())
    opened = ε * scales.u + np.abs(d.H) @ coarse_v[-1]
    products = np.maximum(np.where(one_sided, product, friction), worked_off)
    bounds = np.where(d.slides, d.r_max, 0.0)
    massless = np.isin(kind, (DAMPED, FREE))
    missing = np.abs(g[:, massless]).max(axis=0)
    found = {
        "complementarity": _worst(
            products, scales.r * opened + largest * slow + bounds * (np.abs(d.H) @ coarse_v[-1] + ε * end * scales.U)
        ),
        "penetration": _worst(overlap[one_sided], opened[one_sided]),
        "energy_balance": _worst(np.abs(energy), np.repeat(allowed_E, 2)),
        "tension": _worst(np.maximum(_excess(d, r).max(axis=0), _excess(d, r_right).max(axis=0)), ε * scales.r),
        "impact_law": _worst(violation, slow),
        "momentum": _worst(np.abs(lack[:, free]), allowed_p[:, free]),
        "equilibrium": _worst(missing, ε * forces[massless]),
        "kinematics": _worst(np.abs(moved[:, ways]), allowed_q[:, ways]),
        "sampling": _sampling(record, dense, scales, ε),
    }
    return found, scales, (float(np.abs(energy).max()), scale)


def _cumulated(jumps: Array, between: Array) -> Array:
    """Return the running sum of what happens at cuts (nk, ...) and between them (nk - 1, ...), at each limit (2 nk, ...)."""
    ordered = np.zeros((2 * len(jumps), *jumps.shape[1:]))
    ordered[1::2], ordered[2::2] = jumps, between
    return np.cumsum(ordered, axis=0)


def _grown(pieces: Pieces, values: Array, order: float) -> Array:
    """Return what a rule of an order leaves out of the integral of values up to each cut, by their highest parts (nk, n)."""
    nothing = np.zeros((1, values.shape[1]))
    if np.isinf(order):
        return np.zeros((len(pieces.cuts), values.shape[1]))
    return np.concatenate([nothing, np.cumsum(pieces.unresolved(values, int(order) - 1), axis=0)])


def _accelerations(d: Dynamics, g: Array) -> Array:
    """Return what the forces g on the nodes with mass may change U by, in m/s², of each row (nc,)."""
    massive = d.massive
    M = d.M[np.ix_(massive, massive)]
    if np.count_nonzero(M) == len(M):
        largest = np.abs(g).max(axis=0, initial=0.0)[massive] / np.diag(M)
    else:
        largest = np.abs(np.linalg.solve(M, g[:, massive].T)).max(axis=1, initial=0.0)
    return np.asarray(np.abs(d.H[:, massive]) @ largest)


def _sampling(record: Record, dense: ContinuousSolution, scales: Scales, ε: float) -> tuple[float, float]:
    """Return by how much the record differs from the continuous solution, in units of each scale; either limit will do."""
    ours = (record.q, record.v, record.reaction)
    size = (scales.q, scales.v, scales.r)
    off = np.array([_relative(a, b, s) for a, b, s in zip(ours, dense.read(record.t, "right"), size, strict=True)])
    worst = off.max(axis=0)
    if (worst > ε).any():
        off = np.array([_relative(a, b, s) for a, b, s in zip(ours, dense.read(record.t, "left"), size, strict=True)])
        worst = np.minimum(worst, off.max(axis=0))
    return float(worst.max()), ε


def _relative(a: Array, b: Array, size: Array) -> Array:
    """Return the largest |a - b| of each instant, in units of the size of each column (nt,)."""
    return np.asarray((np.abs(a - b) / np.where(size > 0.0, size, 1.0)).max(axis=1, initial=0.0))


def _judge_grid(
    d: Dynamics,
    start: tuple[Array, Array],
    record: Record,
    events: Sequence[Event],
    integrator: Integrator | None,
    limits: Limits,
) -> tuple[Found, Scales, tuple[float, float]]:
    """Judge a run by the trapezoidal rule from point to point, whose error the bends of the run itself bound."""
    ε, kind, rows = limits.precision, _kinds(d), _rows(d)
    in_steps = len(record.reaction) < len(record.t)
    spread = integrator.impact_steps if integrator is not None else 1
    struck = [event for event in events if event.impulse != 0.0]
    if in_steps:
        first = np.array([step_of(event, record.t, record.q, record.v) for event in struck], dtype=np.int64)
    else:
        first = np.searchsorted(record.t, [event.t for event in struck]) - 1
    # The steps over which one impact spreads are one.
    within = np.zeros(len(record.t), dtype=np.bool_)
    for k in range(1, spread):
        within[np.minimum(first + k, len(record.t) - 1)] = True
    within[-1] = False
    kept = np.flatnonzero(~within)
    step = np.searchsorted(kept, first, side="right") - 1
    t, q, v = (record.t, record.q, record.v) if spread == 1 else (record.t[kept], record.q[kept], record.v[kept])
    h = np.diff(t)[:, None]
    P = np.zeros((len(h), len(d.contacts)))
    P_start, P_end = np.zeros(len(d.contacts)), np.zeros_like(P)
    for k, event in zip(step, struck, strict=True):
        (P_start if k < 0 else P[min(k, len(P) - 1)])[rows[event.contact]] += event.impulse
        if k >= 0 and event.t >= t[min(k, len(P) - 1) + 1]:
            P_end[min(k, len(P) - 1), rows[event.contact]] += event.impulse
    if in_steps:
        R = record.reaction
        if spread > 1:
            R = np.add.reduceat(np.diff(record.t)[:, None] * R, kept[:-1]) / h
        r = R
        f, g = _smooth(d, t, q, v, None)
        acting = g[1:] + R @ d.B.T
        as_mean = integrator is None or integrator.reaction_is_mean
        total = g if as_mean else np.concatenate([g[:1] + R[:1] @ d.B.T, acting])
        given = (h * R + P if as_mean else P) @ d.B.T
        at = slice(1, None)
    else:
        R = r = record.reaction if spread == 1 else record.reaction[kept]
        f, g = _smooth(d, t, q, v, r)
        acting = total = g
        given = P @ d.B.T
        at = slice(None)
    longest = float(h.max(initial=0.0))
    # Springs that are damped as they are compressed leave a linear step order 1.
    order = min(limits.order, 1.0) if in_steps and d.springs and d.power_laws[:, 3:].any() else limits.order
    bare = Scales.of(d, q, v, r, f)
    scales = bare.at_least(d, longest)
    turn = scales.v - bare.v
    forces, momenta, largest = scales.forces(d), scales.momenta(d), _largest_impulses(d, events)

    at_rest = np.zeros(len(d.nodes))
    first_p, first_q = (
        (d.M @ (v[0] - start[1]) - d.B @ P_start, q[0] - start[0]) if d.stores_energy else (at_rest, at_rest)
    )
    lack = out_of_balance(h.ravel(), v @ d.M.T, total, given, first_p)
    moved = out_of_balance(h.ravel(), q, v, given[:0], first_q)
    lacking = np.abs(lack)
    if not in_steps:
        # What is recorded at the very instant of an impact may be the limit before it.
        lacking = np.minimum(lacking, np.abs(lack + P_end @ d.B.T))
    elapsed = 64.0 * np.finfo(float).eps * (t[1:] - t[0])[:, None]
    kicks, links = np.abs(g).max(axis=0), np.abs(d.B)
    # A contact passes on what acts at its nodes, be it as a force or in the impulse of a step.
    passed = np.maximum(np.abs(R).max(axis=0, initial=0.0), (links * kicks[:, None]).max(axis=0, initial=0.0))
    kicks = np.maximum(kicks, links @ passed)
    allowed_p = limits.slack * bends(h.ravel(), total, order)
    allowed_p += ε * momenta + elapsed * forces + h * (limits.kick * kicks)
    # Within a step a body may turn about as its forces let it, and show nothing of it at the ends.
    turning = limits.slack * SLOPE * np.where(kind == MASSIVE, turn, 0.0)
    allowed_q = limits.slack * bends(h.ravel(), v, order)
    allowed_q += ε * scales.q + elapsed * scales.v + h * turning
    hit = np.flatnonzero(P.any(axis=1))
    impacts = Impacts(t[hit], q[hit], v[hit], v[hit + 1], P[hit]) if in_steps else Impacts.of(d, events)
    if not in_steps:
        # Several impacts within a step may set a body in motion and stop it.
        jumps = np.zeros_like(q[1:])
        np.add.at(jumps, impacts.steps(t), np.abs(impacts.after - impacts.before))
        allowed_q += np.cumsum(h * jumps, axis=0)
    massive, ways, massless = kind == MASSIVE, kind >= DAMPED, np.isin(kind, (DAMPED, FREE))
    turns = 0.0
    if limits.drift:
        # What is moved by hand lags its forces, whose errors add up to those of the way that it goes.
        allowed_p += limits.drift * h * (np.abs(d.K[:, massless]) @ np.ptp(q[:, massless], axis=0))
        allowed_q += limits.drift * h * np.maximum.accumulate(np.abs(v[1:]), axis=0)
        turns = limits.drift * np.abs(np.diff(q, axis=0) @ d.K.T).max(axis=0, initial=0.0)

    u = d.gap(q[at]) + r @ d.D.T
    one_sided = ~d.slides
    reach = np.where((d.relative_degree == 2) | (2 not in limits.relative_degrees), limits.penetration, 0.0)
    opened = ε * scales.u + reach * longest * scales.U
    slow = 2.0 * spread * min(limits.slack, 3.0) * longest * _accelerations(d, acting) + ε * scales.U
    # An impact that spreads over several steps obeys its law only where no other contact pushes in them.
    alone = ~R[hit].any(axis=1) & (np.count_nonzero(P[hit], axis=1) == 1) if spread > 1 else slice(None)
    violation, worked_off = _judge_impacts(d, impacts[alone], -opened)
    pushed_apart = np.abs(r * np.maximum(u, 0.0)).max(axis=0, initial=0.0)
    overlapping = np.abs(r * np.minimum(u, 0.0)).max(axis=0, initial=0.0)
    # A contact may open in the step over which its force is a mean.
    opening = longest * scales.U * ((d.relative_degree == 2) & in_steps)
    friction = turned = np.zeros(len(d.contacts))
    if d.slides.any():
        mean = 0.5 * (v[1:] + v[:-1]) if in_steps else v
        duration = h if in_steps else np.append(h, h[-1:], axis=0)
        friction = np.abs(duration * _friction(d, r, d.gap_rate(mean))).max(axis=0, initial=0.0)
        turned = np.abs(np.diff(d.gap_rate(v), axis=0)).max(axis=0, initial=0.0)
    bounds = np.where(d.slides, d.r_max, 0.0)
    found = {
        "complementarity": _worst(
            np.concatenate([pushed_apart[one_sided], overlapping[one_sided], friction, worked_off]),
            np.concatenate(
                [
                    (scales.r * (ε * scales.u + opening))[one_sided],
                    (scales.r * opened)[one_sided],
                    bounds * longest * (ε * scales.U + 2.0 * turned),
                    largest * slow,
                ]
            ),
        ),
        "penetration": _worst(np.maximum(0.0, -u.min(axis=0, initial=0.0))[one_sided], opened[one_sided]),
        "tension": _worst(
            _excess(d, r).max(axis=0, initial=0.0), ε * (scales.r + largest / float(h.max(initial=1e-300)))
        ),
        "impact_law": _worst(violation, slow),
        "momentum": _worst(lacking[:, massive], allowed_p[:, massive]),
        "equilibrium": _massless(d, acting, P, in_steps, massless, ε * forces + turns),
        "kinematics": _worst(np.abs(moved[:, ways]), allowed_q[:, ways]),
    }
    if d.stores_energy:
        alone = _judge_steps(d, t, q, v, R, f, total, given if in_steps else given[:0], events, scales, turn, limits)
        alone["momentum"] = _worse(
            alone["momentum"], _judge_impulses(d, t, lack, total, R, step, events, momenta, limits)
        )
        for name, pair in alone.items():
            found[name] = _worse(found[name], pair)
    energies = _balance_on_grid(d, t, q, v, r, f, impacts, in_steps)
    found["energy_balance"] = (energies[0], np.inf)
    return found, scales, energies


@compiled(matrix(vector, matrix, f8))
def bends(h: Array, values: Array, order: float) -> Array:
    """Return what the trapezoidal rule may leave out up to each point but the first, after bends and jumps (nt - 1, n).

    Where the values are smooth its errors cancel but for h/12 of the change of their slope; where they jump it misses up to
    h/2 of the jump, which may show only at the end of the next step: of each step and the next the greater change counts.
    A method of order 1 may miss h times what the values change at all. At up to `MIN_POINTS` points no bend is seen.
    """
    steps, n = len(h), values.shape[1]
    left_out = np.empty((steps, n))
    for i in range(n):
        slope, few, bent, changed = 0.0, 0.0, 0.0, 0.0
        before, now = 0.0, values[min(1, steps), i] - values[0, i]
        for k in range(steps):
            after = values[k + 2, i] - values[k + 1, i] if k + 2 <= steps else now
            slope = max(slope, h[k] * max(abs(now), abs(after)))
            bend = abs(now - before)
            if k + 2 <= steps:
                bend = max(bend, abs(after - now))
            bent += h[k] * bend
            left_out[k, i] = JUMP * bent
            if order < 2.0:
                changed = max(changed, abs(values[k + 1, i] - values[0, i]))
                left_out[k, i] += h[k] * changed
            before, now = now, after
        if steps < MIN_POINTS:
            for k in range(steps + 1):
                few = max(few, abs(values[k, i]))
        for k in range(steps):
            left_out[k, i] += SLOPE * (slope + h[k] * few)
    return left_out


@compiled(matrix(vector, matrix, matrix, matrix, vector))
def out_of_balance(h: Array, x: Array, rate: Array, given: Array, start: Array) -> Array:
    """Return start + x - x(0) - ∫ rate dt - Σ given at each point but the first (nt - 1, n), by the trapezoidal rule.

    ``given`` (nt - 1, n) belongs to the steps; without rows it is zero.
    """
    sums, lack = start.copy(), np.empty((len(h), x.shape[1]))
    for k in range(len(h)):
        for i in range(x.shape[1]):
            sums[i] += x[k + 1, i] - x[k, i] - 0.5 * h[k] * (rate[k + 1, i] + rate[k, i])
            if len(given) > 0:
                sums[i] -= given[k, i]
            lack[k, i] = sums[i]
    return lack


@compiled(types.void(matrix, vector, vector, flags))
def changes_of_mode(r: Array, r_min: Array, r_max: Array, loud: Flags) -> None:
    """Mark the steps of ``loud`` (nt - 1,) near which a row of r (nr, nc) begins or ceases to push, or a slider to slip."""
    for i in range(r.shape[1]):
        slides, before = r_max[i] < np.inf, 0
        for k in range(len(r)):
            if slides:
                mode = 1 if r[k, i] >= r_max[i] * (1.0 - SLIPS) else -1 if r[k, i] <= r_min[i] * (1.0 - SLIPS) else 0
            else:
                mode = 1 if r[k, i] != 0.0 else 0
            if k > 0 and mode != before:
                loud[k - 1] = True
                loud[min(k, len(loud) - 1)] = True
            before = mode


@compiled(matrix(vector, matrix, matrix, matrix, matrix, flags, vector, f8))
def worst_steps(
    h: Array, x: Array, rate: Array, given: Array, kicks: Array, loud: Flags, rounding: Array, slack: float
) -> Array:
    """Return |x⁺ - x - ∫ rate dt - given| of the quiet step that is worst beside its limit, and that limit (2, n).

    A step is quiet with nothing in ``loud`` (nt - 1,) within `NEIGHBOURS` + 1 of it. Its limit is the rounding, what
    stands in ``kicks`` (nt - 1, n; none without rows), and ``slack`` h times the second differences of the rate around,
    but for those that the values at its own ends make, and their mean.
    """
    steps, n = len(h), x.shape[1]
    quiet, count, last = np.zeros(steps, np.bool_), 0, -1
    for k in range(steps):
        if loud[k]:
            last = k
        quiet[k] = NEIGHBOURS <= k < steps - NEIGHBOURS and k - last > NEIGHBOURS + 1
    last = 2 * steps
    for k in range(steps - 1, -1, -1):
        if loud[k]:
            last = k
        quiet[k] = quiet[k] and last - k > NEIGHBOURS + 1
        count += quiet[k]
    worst = np.zeros((2, n))
    bend = np.zeros(steps + 1)
    for i in range(n):
        mean, ratio = 0.0, 0.0
        for k in range(1, steps):
            bend[k] = abs(rate[k + 1, i] - 2.0 * rate[k, i] + rate[k - 1, i])
            if quiet[k]:
                mean += bend[k] / count
        for k in range(steps):
            if not quiet[k]:
                continue
            off = x[k + 1, i] - x[k, i] - 0.5 * h[k] * (rate[k + 1, i] + rate[k, i])
            if len(given) > 0:
                off -= given[k, i]
            off = abs(off)
            if off <= rounding[i] + slack * h[k] * mean:
                continue
            around = max(max(bend[k - 2], bend[k - 3]), max(bend[k + 3], bend[k + 4]))
            limit = rounding[i] + slack * h[k] * (around + mean)
            if len(kicks) > 0:
                limit += kicks[k, i]
            if not off <= ratio * limit:
                worst[0, i], worst[1, i], ratio = off, limit, off / limit
    return worst


def _judge_steps(
    d: Dynamics,
    t: Array,
    q: Array,
    v: Array,
    R: Array,
    f: Array,
    total: Array,
    given: Array,
    events: Sequence[Event],
    scales: Scales,
    turn: Array,
    limits: Limits,
) -> Found:
    """Judge the momentum and the way of each step alone, away from events: there the bends around it are its only error."""
    kind, h = _kinds(d), np.diff(t)
    loud = h > (1.0 + UNIFORM_RTOL) * h.min(initial=np.inf)
    changes_of_mode(R, d.r_min, d.r_max, loud)
    near = np.searchsorted(t, [event.t for event in events])[:, None] + np.array([-2, -1, 0])
    loud[np.clip(near, 0, len(h) - 1)] = True
    if d.springs:
        loud |= (np.diff(d.push(q, v) != 0.0, axis=0)).any(axis=1)
    kicks = np.zeros((0, len(d.nodes)))
    if limits.kick or not d.constant_loads or d.motions:
        # What is given may bend within a step, and what is recorded of a reaction may lag it.
        told = f if not d.motions else f - q[:, d.driven] @ d.K[:, d.driven].T - v[:, d.driven] @ d.C[:, d.driven].T
        kicks = 2.0 * h[:, None] * _around(np.abs(np.diff(told, n=2, axis=0)), len(h))
        if limits.kick:
            kicks += limits.kick * h[:, None] * _beside(np.abs(np.diff(R, axis=0)) @ np.abs(d.B).T, len(h))
    if (d.power_laws[:, 3:] > 0.0).any():
        # Where in a step the way and the rate of a lossy spring are taken is for a method to choose.
        ends, mixed = d.spring_force(q, v), d.spring_force(q[1:], v[:-1])
        changes = np.abs(ends[1:] - mixed) + np.abs(mixed - ends[:-1])
        lossy = h[:, None] * _beside(changes, len(h))
        kicks = kicks + lossy if len(kicks) else lossy
    ε, n = max(limits.precision, SCALE_FLOOR), len(d.nodes)
    p, total = v @ d.M.T, np.ascontiguousarray(total)
    lack = worst_steps(h, p, total, given, kicks, loud, ε * scales.momenta(d), limits.step)
    # A force that belongs to a step acts anywhere in it.
    placed = max(limits.kick, float(len(R) < len(t)))
    rounding = ε * scales.q + placed * h.max(initial=0.0) * turn
    # A load that jumps within a step moves its node by h times what it does to the velocity.
    moves = h[:, None] * (kicks @ np.abs(np.linalg.pinv(d.M))) if not d.constant_loads else np.zeros((0, n))
    moved = worst_steps(h, q, v, np.zeros((0, n)), moves, loud, rounding, limits.step)
    ways = (kind == MASSIVE) | (kind == DAMPED)
    return {"momentum": _worst(*lack[:, kind == MASSIVE]), "kinematics": _worst(*moved[:, ways])}


def _judge_impulses(
    d: Dynamics,
    t: Array,
    lack: Array,
    total: Array,
    R: Array,
    step: Indices,
    events: Sequence[Event],
    momenta: Array,
    limits: Limits,
) -> tuple[float, float]:
    """Judge the momentum over the steps around each impact that no other event is near.

    When in its step an impact acts is for the method to choose: what jumps there in the forces may count h more or less.
    """
    happened, hit = np.searchsorted(t, [event.t for event in events]) - 1, np.unique(step)
    alone = np.array(
        [(np.abs(happened - k) <= 1).sum() == (np.abs(happened - k) <= 2 * NEIGHBOURS).sum() for k in hit], dtype=bool
    )
    hit = hit[alone & (hit >= 2 * NEIGHBOURS) & (hit < len(lack) - 2 * NEIGHBOURS)]
    around = hit[:, None] + np.arange(-NEIGHBOURS, NEIGHBOURS + 1)
    jump = np.abs(np.diff(total[around], axis=1)).max(axis=1)
    longest = np.diff(t)[around].max(axis=1, keepdims=True)
    allowed = max(limits.precision, SCALE_FLOOR) * momenta + IMPACT_FACTOR * longest * jump
    if limits.kick:
        allowed += limits.kick * longest * (np.ptp(R[around], axis=1) @ np.abs(d.B).T)
    off = np.abs(lack[hit + NEIGHBOURS - 1] - lack[hit - NEIGHBOURS])
    return _worst(off[:, d.massive], allowed[:, d.massive])


def _worse(one: tuple[float, float], other: tuple[float, float]) -> tuple[float, float]:
    """Return the violation that is worse beside its limit."""
    return _worst(*np.transpose([one, other]))


def _beside(changes: Array, steps: int) -> Array:
    """Return for each step the greatest of the changes from step to step on both sides, but for its own (steps, n)."""
    return _greatest(changes, steps, NEIGHBOURS, (NEIGHBOURS - 3, NEIGHBOURS - 2, NEIGHBOURS + 3, NEIGHBOURS + 4))


def _around(changes: Array, steps: int) -> Array:
    """Return for each step the greatest change at its ends and one further on either side (steps, n)."""
    return _greatest(changes, steps, 1, range(steps + 3 - len(changes)))


def _greatest(changes: Array, steps: int, margin: int, shifts: Iterable[int]) -> Array:
    """Return for each step k the greatest of the changes k + margin - shift (steps, n)."""
    wide = np.zeros((steps + 2 * margin, changes.shape[1]))
    for shift in shifts:
        part = wide[shift : shift + len(changes)]
        np.maximum(part, changes, out=part)
    return wide[margin:-margin]


def _massless(d: Dynamics, g: Array, P: Array, in_steps: bool, massless: Flags, allowed: Array) -> tuple[float, float]:
    """Return the force that is missing at nodes without mass, and the impulses that do not balance there over a step."""
    if not massless.any():
        return 0.0, 0.0
    # Where the force of a step was an impulse, it is not known beside it.
    whole = ~P.any(axis=1) if in_steps else np.ones(len(g), dtype=np.bool_)
    return _worst(np.abs(g[whole][:, massless]).max(axis=0, initial=0.0), allowed[massless])


def _balance_on_grid(
    d: Dynamics,
    t: Array,
    q: Array,
    v: Array,
    r: Array,
    f: Array,
    impacts: Impacts,
    in_steps: bool,
) -> tuple[float, float]:
    """Return the largest |E(t) - E(0) - work| with the power integrated by the trapezoidal rule, and the scale of E."""
    h, v_m = np.diff(t), 0.5 * (v[1:] + v[:-1])
    stored = d.energy(q, v)
    # The work of loads is what they do on the way that was gone; a method that corrects places has none for that part.
    way = h[:, None] * v_m if in_steps else np.diff(q, axis=0)
    work = way @ f[0] if d.constant_loads else 0.5 * np.einsum("ki,ki->k", f[1:] + f[:-1], way)
    power = -d.dissipated_power(q, v)
    if in_steps:
        work += h * np.einsum("ki,ki->k", r, d.gap_rate(v_m))
    else:
        power += np.einsum("ki,ki->k", r, d.gap_rate(v))
    if d.motions:
        none = np.zeros((len(t), len(d.contacts)))
        power += d.driving_power(t, q, v, none if in_steps else r)
        if in_steps:
            middle, q_m = (0.5 * (each[1:] + each[:-1]) for each in (t, q))
            work += h * (d.driving_power(middle, q_m, v_m, r) - d.driving_power(middle, q_m, v_m, none[1:]))
    work += 0.5 * h * (power[1:] + power[:-1])
    within = impacts if in_steps else impacts[impacts.t > t[0]]
    np.add.at(work, within.steps(t, "right" if in_steps else "left"), _work(d, within))
    balance = np.cumsum(np.diff(stored) - work)
    return float(np.abs(balance).max(initial=0.0)), float(np.abs(stored).max())
