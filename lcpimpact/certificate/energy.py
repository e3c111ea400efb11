r"""Energy account of a run: the supplied energy, and the dissipation of each element.

.. math::

    T + V - f_0·(q - q(0)) = T_0 + V_0 + \int (f - f_0)·v\,dt + W_{motions} - \sum_e \int P_e\,dt - \sum \text{impacts}

with T the kinetic energy, V that of the springs, f_0 the constant loads, and P_e the power that one dashpot, slider,
contact or lossy spring dissipates. In an impact a contact dissipates -Λ (U⁻ + U⁺)/2, with its impulse Λ and the limits of
its opening rate.

Flows are rows (2 + m,): the work of time-dependent loads, that of the forces that drive prescribed motions, and the
dissipation of each of m sinks. In the ledger each element is a sink; in the certificate there is one sink for all.

Source: Acary and Brogliato, *Numerical Methods for Nonsmooth Dynamical Systems* (2008), section 10.1.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from lcpimpact.arrays import Array
from lcpimpact.certificate.impacts import RunImpacts, rows_by_name
from lcpimpact.certificate.laws import (
    early_velocities,
    impulses_of_breaks,
    loads_in_steps,
    mean_motion_forces,
    motion_forces_in_steps,
    steady_loads,
)
from lcpimpact.events import steps_of
from lcpimpact.memo import once
from lcpimpact.problems.base import Problem
from lcpimpact.record import Event, Record
from lcpimpact.scheme.dynamics import Dynamics
from lcpimpact.scheme.elements.base import GROUND, Element
from lcpimpact.scheme.lagrangian import LagrangianDynamics
from lcpimpact.scheme.power_law import mean_forces
from lcpimpact.scheme.rate_law import mean_forces as pulls
from lcpimpact.scheme.scheme import Scheme
from lcpimpact.scheme.terms import Terms

STORED = ("kinetic", "elastic", "gravity")
INFLOWS = ("loads", "motions")


class Energies(NamedTuple):
    """The energies of a run in J: the largest imbalance in size, the largest stored one, and the largest loss.

    The loss is that beyond what the steps lose by themselves; of a continuous solution it is not computed.
    """

    imbalance: float
    scale: float
    loss: float = 0.0


@dataclass(frozen=True, eq=False)
class Sinks:
    """The dissipating elements of a scheme.

    Attributes
    ----------
    names : tuple of m str
    dashpots : tuple of pairs
        Nodes, a list or all, and damping matrix of each of the first sinks, which are dashpots.
    springs, rate_laws, contacts : (ns, m), (nd, m), (nc, m) arrays
        1 if a sink includes the loss of a non-linear spring, of a non-linear dashpot, or of a contact or slider; else 0.
    """

    names: tuple[str, ...]
    dashpots: tuple[tuple[list[int] | slice, Array], ...]
    springs: Array
    rate_laws: Array
    contacts: Array

    @classmethod
    def all_as_one(cls, d: Dynamics) -> Sinks:
        """Return one sink for all dissipating elements."""
        moving = isinstance(d, LagrangianDynamics)  # whose dashpots are among its other forces
        dashpots = ((slice(None), d.C),) if not moving and d.C.any() else ()
        others = (np.ones((len(each), 1)) for each in (d.springs, d.dashpots, d.contacts))
        return cls(("dissipated",), dashpots, *others)

    @classmethod
    def by_element(cls, problem: Problem) -> Sinks:
        """Return a sink for each dashpot, lossy spring, slider and contact."""
        d = problem.dynamics
        index = {node: i for i, node in enumerate(problem.dynamics.nodes)}
        elements = problem.scheme.elements if isinstance(problem.scheme, Scheme) else ()
        names: list[str] = []
        dashpots: list[tuple[list[int] | slice, Array]] = []
        for part in (part for element in elements for part in _elementary_parts(element)):
            own = [node for node in part.nodes if node != GROUND]
            terms = Terms(own)
            part.contribute(terms)
            if terms.C.value.any():
                names.append(f"dashpot {' to '.join(part.nodes)}")
                dashpots.append(([index[node] for node in own], terms.C.value))
        lossy = [a for a, spring in enumerate(d.springs) if spring.lossy]
        for spring in (d.springs[a] for a in lossy):
            names.append(f"{spring.element.split()[0]} {spring.upper} to {spring.lower}")
        names += [f"NonlinearDashpot {law.a} to {law.b}" for law in d.dashpots]
        for contact in d.contacts:
            kind = "impact" if contact.impenetrable and contact.relative_degree == 2 else contact.law.name
            names.append(f"{kind} {contact.name}")
        springs = np.zeros((len(d.springs), len(names)))
        rate_laws = np.zeros((len(d.dashpots), len(names)))
        contacts = np.zeros((len(d.contacts), len(names)))
        springs[lossy, len(dashpots) + np.arange(len(lossy))] = 1.0
        first = len(names) - len(d.contacts)
        rate_laws[:, first - len(d.dashpots) : first] = np.eye(len(d.dashpots))
        contacts[:, first:] = np.eye(len(d.contacts))
        return cls(tuple(_numbered(names)), tuple(dashpots), springs, rate_laws, contacts)


def _elementary_parts(element: Element) -> Iterator[Element]:
    """Yield the elementary parts of an element, recursively."""
    parts = element.parts()
    if len(parts) == 1 and parts[0] is element:
        yield element
    else:
        for part in parts:
            yield from _elementary_parts(part)


def _numbered(names: Sequence[str]) -> Iterator[str]:
    """Yield the names, with a number after repeated ones."""
    seen = Counter[str]()
    for name in names:
        seen[name] += 1
        yield name if seen[name] == 1 else f"{name} {seen[name]}"


@dataclass(frozen=True, eq=False)
class Account:
    """The flows of energy into and out of a system, and their three quadratures."""

    d: Dynamics
    sinks: Sinks

    @property
    def moving(self) -> bool:
        """Whether the system is Lagrangian: its loads are the other forces Q, and its surfaces may move by themselves."""
        return isinstance(self.d, LagrangianDynamics)

    @cached_property
    def signs(self) -> Array:
        """The sign with which each flow changes the stored energy (2 + m,)."""
        return np.repeat([1.0, -1.0], [len(INFLOWS), len(self.sinks.names)])

    def stored(self, q: Array, v: Array, start: Array) -> Array:
        """Return the kinetic, elastic and potential energy -f_0·(q - q(0)) in J (nt, 3).

        The elastic energy of a Lagrangian system is V(q) - V(q(0)).
        """
        elastic = self.d.elastic_energy(q)
        if self.moving:
            elastic = elastic - self.d.elastic_energy(start)
        potential = -(q - start) @ steady_loads(self.d)
        return np.stack([self.d.kinetic_energy(q, v), elastic, potential], axis=1)

    def powers(self, t: Array, q: Array, v: Array, r: Array) -> Array:
        """Return all flows in W (nt, 2 + m)."""
        return self.powers_under(t, self.d.applied(t, q, v), q, v, r)

    def powers_under(self, t: Array, f: Array, q: Array, v: Array, r: Array) -> Array:
        """Return all flows in W (nt, 2 + m) under given loads f (nt, n)."""
        without = self._without_contacts(f, q, v, self.d.push(q, v), self.d.dashpot_forces(v))
        return without + self.of_contacts(t, q, v, r)

    def balance(self, flows: Array) -> Array:
        """Return the change of the stored energy (...) by flows (..., 2 + m)."""
        return np.asarray(flows @ self.signs)

    def imbalance(self, stored: Array, first: Array, net: Array) -> Array:
        """Return the imbalance in J (nt,) of stored energies (nt, 3), their initial values (3,) and the net inflow (nt,)."""
        return np.asarray((stored - first) @ np.ones(len(STORED)) - net)

    def of_contacts(self, t: Array, q: Array, v: Array, r: Array) -> Array:
        """Return the flows due to reactions: in W for forces in N, in J for impulses in N s (nt, 2 + m)."""
        d = self.d
        flows = np.zeros((len(v), len(INFLOWS) + len(self.sinks.names)))
        if d.motions:
            flows[:, 1] = -((r @ d.B.T) * v)[:, d.driven].sum(axis=1)
        if self.moving:
            flows[:, 1] = -(r * d.gap_rate(t, q, np.zeros_like(v))).sum(axis=1)
        flows[:, len(INFLOWS) :] = -(r * d.gap_rate(t, q, v)) @ self.sinks.contacts
        return flows

    def of_impacts(self, impacts: RunImpacts) -> Array:
        """Return the flows in J due to impacts, with the mean of the velocities before and after (ni, 2 + m)."""
        return self.of_contacts(impacts.t, impacts.q, 0.5 * (impacts.before + impacts.after), impacts.P)

    def _without_contacts(self, f: Array, q: Array, v: Array, s: Array, F: Array) -> Array:
        """Return the flows in W due to loads f, prescribed motions, dashpots, and non-linear springs and dashpots.

        The latter push with s and pull with F.
        """
        d = self.d
        flows = np.zeros((len(v), len(INFLOWS) + len(self.sinks.names)))
        if self.moving or not d.constant_loads:
            flows[:, 0] = np.einsum("ki,ki->k", f - steady_loads(self.d), v)
        if d.motions:
            held = q @ d.K.T + v @ d.C.T - f - s @ d.directions + F @ d.rate_directions
            flows[:, 1] = (held * v)[:, d.driven].sum(axis=1)
        for k, (nodes, C) in enumerate(self.sinks.dashpots, len(INFLOWS)):
            flows[:, k] = np.einsum("ki,ki->k", v[:, nodes] @ C, v[:, nodes])
        if d.springs:
            flows[:, len(INFLOWS) :] += d.spring_losses(q, v, s) @ self.sinks.springs
        flows[:, len(INFLOWS) :] += (F * (v @ d.rate_directions.T)) @ self.sinks.rate_laws
        return flows

    def by_theta_rule(self, record: Record, events: Sequence[Event], θ: float, impact_steps: int = 1) -> Array:
        """Return the flows of each step in J, h w·(forces at t + θ h) with w = (q⁺ - q)/h (steps, 2 + m).

        For θ = 1/2 and linear springs it is an identity of the θ-step. Reactions at the ends of a step act by their mean.
        """
        d, h = self.d, np.diff(record.t)
        w = np.diff(record.q, axis=0) / h[:, None]
        f = loads_in_steps(d, record.t, θ)
        q = (1.0 - θ) * record.q[:-1] + θ * record.q[1:]
        f += motion_forces_in_steps(d, record, θ)
        s = mean_forces(d.power_laws, d.approach(q), d.approach_rate(w), h)
        N = d.rate_directions.T
        F = pulls(d.rate_laws, record.v[:-1] @ N, w @ N, θ, h)
        impulses = _all_impulses(d, record, events, impact_steps)
        flows = h[:, None] * self._without_contacts(f, q, w, s, F)
        stops = self.sinks.springs.any(axis=0) | (np.arange(len(self.sinks.names)) < len(self.sinks.dashpots))
        if stops.any() and len(early := early_velocities(d, record, impulses > 0.0, θ)):
            # In a step in which they stop a body dashpots and springs take more than at its mean velocity, in proportion.
            lost = flows[:, len(INFLOWS) :] * stops
            taken = np.einsum("ki,ki->k", np.diff(record.v, axis=0) @ d.M, early)
            total = lost.sum(axis=1)
            lost *= np.divide(taken, total, out=np.zeros_like(taken), where=total > 0.0)[:, None]
            flows[:, len(INFLOWS) :] += lost
        return flows + self.of_contacts((1.0 - θ) * record.t[:-1] + θ * record.t[1:], q, w, impulses)

    def supplied(self, record: Record, events: Sequence[Event], impact_steps: int) -> tuple[Array, Array]:
        """Return the work in J of time-dependent loads, general forces and prescribed motions since t = 0, along q⁺ - q.

        Displacements have no jumps, and the work on springs along them is a difference of their energies for any step.
        General forces are taken along the whole of each step: at its middle alone, a stiff spring supplies too much.
        Where the velocity of a prescribed motion jumps in a step, an impulse supplies what it does at either velocity, and
        so does that of a load with breakpoints.

        Returns
        -------
        work, passed : (nt,) arrays
            The work; and the sum of the absolute works of the general forces in the steps, to which their error is
            proportional.
        """
        d = self.d
        way = np.diff(record.q, axis=0)
        passed = np.zeros(len(record.t) - 1)
        work = self.by_theta_rule(record, events, 0.5, impact_steps)[:, : len(INFLOWS)].sum(axis=1)
        if d.force_laws:
            at_middle = motion_forces_in_steps(d, record, 0.5)
            mean = mean_motion_forces(d, record)
            work += np.einsum("ki,ki->k", mean - at_middle, way * ~d.driven)
            passed = np.abs(mean * way).sum(axis=1)
        if d.motions and len(d.contacts):
            w = way / np.diff(record.t)[:, None]
            jump = np.maximum(np.abs(record.v[:-1] - w), np.abs(record.v[1:] - w)) * d.driven
            work += np.einsum("ki,ki->k", np.abs(_all_impulses(d, record, events, impact_steps)), jump @ np.abs(d.B))
        work += open_work(d, record)
        sums = np.cumsum([work, passed], axis=1)
        return np.append(0.0, sums[0]), np.append(0.0, sums[1])

    def by_trapezoidal_rule(self, record: Record, events: Sequence[Event], impact_steps: int = 1) -> Array:
        """Return the flows of each step in J, by the powers at its ends (steps, 2 + m).

        Reactions and impulses of steps act at the mean of the velocities at the ends of the step, other impulses at the
        limits of their event. In the latter case loads do work along q⁺ - q, which has no jumps.
        """
        d = self.d
        t = record.t
        q = record.q
        v = record.v
        r = record.reaction
        h = np.diff(t)[:, None]
        mean = 0.5 * (v[1:] + v[:-1])
        in_steps = len(r) < len(t)
        f = d.applied(t, q, v)
        powers = self._without_contacts(f, q, v, d.push(q, v), d.dashpot_forces(v))
        if not in_steps:
            powers += self.of_contacts(t, q, v, r)
        flows = 0.5 * h * (powers[1:] + powers[:-1])
        if in_steps:
            impulses = h * r + impulses_in_steps(d, record, events, impact_steps)
            flows += self.of_contacts(0.5 * (t[1:] + t[:-1]), 0.5 * (q[1:] + q[:-1]), mean, impulses)
        else:
            impacts = RunImpacts.of(d, events)
            impacts = impacts[impacts.t > t[0]]
            np.add.at(flows, impacts.steps(t), self.of_impacts(impacts))
            if self.moving or not d.constant_loads:
                flows[:, 0] = np.einsum("ki,ki->k", 0.5 * (f[1:] + f[:-1]) - steady_loads(self.d), np.diff(q, axis=0))
        if d.breaking_loads:
            flows[:, 0] += np.einsum("ki,ki->k", impulses_of_breaks(d, t), np.diff(q, axis=0) / h)
        return flows


def open_work(d: Dynamics, record: Record) -> Array:
    """Return the work in J of impulses of loads with breakpoints that depends on when they act within a step (steps,)."""
    w = np.diff(record.q, axis=0) / np.diff(record.t)[:, None]
    if not d.breaking_loads:
        return np.zeros(len(w))
    jump = np.maximum(np.abs(record.v[:-1] - w), np.abs(record.v[1:] - w))
    return np.asarray(np.einsum("ki,ki->k", np.abs(impulses_of_breaks(d, record.t)), jump))


@once
def account_of(d: Dynamics) -> Account:
    """Return the account of a system with one sink for all."""
    return Account(d, Sinks.all_as_one(d))


def _all_impulses(d: Dynamics, record: Record, events: Sequence[Event], impact_steps: int) -> Array:
    """Return the impulse of each row in each step, by its reaction and its impacts, in N s (steps, nc)."""
    r = record.reaction
    means = r if len(r) < len(record.t) else 0.5 * (r[1:] + r[:-1])
    return np.asarray(np.diff(record.t)[:, None] * means + impulses_in_steps(d, record, events, impact_steps))


def impulses_in_steps(d: Dynamics, record: Record, events: Sequence[Event], impact_steps: int) -> Array:
    """Return the impulse of each row by its impacts in each step, in N s (steps, nc).

    An impact over several steps is distributed over them in proportion to the change of U.
    """
    P = np.zeros((len(record.t) - 1, len(d.contacts)))
    rows = rows_by_name(d)
    struck = [event for event in events if event.impulse != 0.0]
    for event, first in zip(struck, steps_of(struck, record.t, record.q, record.v), strict=True):
        i = rows[event.contact]
        of = slice(first, first + impact_steps + 1)
        U = d.gap_rate(record.t[of], record.q[of], record.v[of])[:, i]
        part = (
            np.diff(U) / (U[-1] - U[0])
            if len(U) > 2 and U[-1] != U[0]
            else np.full(len(U) - 1, 1.0 / max(len(U) - 1, 1))
        )
        P[first : first + len(part), i] += event.impulse * part
    return P
