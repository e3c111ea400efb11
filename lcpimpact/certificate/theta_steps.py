"""Certificate of θ-steps, whose forces balance at t + θ h: exact to rounding except for kinks of positions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from lcpimpact.arrays import Array, Flags, Places, Vector
from lcpimpact.certificate.energy import Energies
from lcpimpact.certificate.impacts import largest_impulses, rows_by_name
from lcpimpact.certificate.laws import (
    early_velocities,
    law_residual,
    loads_in_steps,
    motion_forces_in_steps,
    node_kinds,
    rate_forces,
)
from lcpimpact.certificate.scales import Judgement, Scales, largest_spring_forces, sizes, worse
from lcpimpact.certificate.theta_balance import (
    Impulses,
    JudgedRows,
    Kinds,
    Nodes,
    Recorded,
    SparsityPattern,
    SpringLaws,
    Violations,
    block_steps,
    certify_steps,
    kinds_of,
    no_violations,
)
from lcpimpact.compiled import compiled
from lcpimpact.events import steps_of
from lcpimpact.integrators.base import Limits
from lcpimpact.memo import once
from lcpimpact.numerics.rounding import EPS
from lcpimpact.record import SLIP_RTOL, Event, Record
from lcpimpact.scheme.dynamics import Dynamics
from lcpimpact.scheme.signals import jumps, limits_at


class Constants(NamedTuple):
    """The constants of a system that the certificates of all its runs share.

    Attributes
    ----------
    loads : (1, n) array                the loads at t = 0, those of the run if they are constant
    nodes, contacts, springs            the system for the compiled loop
    kinds : Kinds                       rows with a feedthrough, and rows on impulse paths
    balances : bool                     whether no node is quasi-static
    at_velocity_level : (nc,) flags     contacts whose law may be at velocity level, and those of impulse paths
    strict : (nc,) flags                rows that must not penetrate
    of_relays : (nc,) array             -1, for runs without relays
    of_rate, switches, feeds_through    whether there are laws of the rate, and relays, and whether D is not zero
    """

    loads: Array
    nodes: Nodes
    contacts: JudgedRows
    springs: SpringLaws
    kinds: Kinds
    balances: bool
    at_velocity_level: Flags
    strict: Flags
    of_relays: Array
    of_rate: bool
    switches: bool
    feeds_through: bool


@once
def _constants(d: Dynamics) -> Constants:
    """Return the constants of a system that the certificates of all its runs share."""
    pattern, at = _pattern((d.M != 0.0) | (d.C != 0.0) | (d.K != 0.0))
    H_pattern, H_at = _pattern(d.H != 0.0)
    contacts = JudgedRows(
        *(H_pattern, d.H[H_at], np.array(d.B, order="C"), np.array(d.D, order="C"), d.u0.copy(), d.restitution),
        *(d.r_min, d.r_max, d.relative_degree, d.of_rate),
        *(d.mu, d.mu_s, d.normals, np.array(d.impulse_lines, order="C")),
    )
    balances = bool((node_kinds(d) >= 0).all())
    # Contacts of an impulse path over massless nodes meet at velocity level, and may penetrate as others close.
    at_velocity_level = ((d.relative_degree == 2) & ~d.switches) | (d.impulse_lines > 0.0).any(axis=0)
    return Constants(
        d.force(np.zeros(1)),
        Nodes(pattern, d.M[at], d.C[at], d.K[at], node_kinds(d)),
        contacts,
        SpringLaws(d.directions, d.power_laws),
        kinds_of(contacts),
        balances,
        at_velocity_level,
        (d.bilateral & ~d.of_rate) | (~at_velocity_level & balances),
        np.full(len(d.contacts), -1.0),
        bool(d.of_rate.any()),
        bool(d.switches.any()),
        bool(d.D.any()),
    )


def judge_theta_steps(
    d: Dynamics, record: Record, events: Sequence[Event], θ: float, limits: Limits
) -> tuple[Judgement, Scales, Energies]:
    """Judge the run of a θ-method."""
    f = _constants(d).loads if d.constant_loads else d.force(record.t)
    f_θ = np.zeros((0, len(d.nodes)))
    if d.force_laws:
        f_θ = motion_forces_in_steps(d, record, θ)
    if d.breaking_loads:
        # The mean of a step has the left limit of the loads at its end, and f the right one.
        f = d.force_limits(record.t)[1]
        f_θ = loads_in_steps(d, record.t, θ) - ((1.0 - θ) * f[:-1] + θ * f[1:]) + (f_θ if len(f_θ) else 0.0)
    violations, (balance, loss, scale), h = _violations(d, record, events, θ, (f, f_θ))
    largest = np.abs(f).max(axis=0) + np.abs(f_θ).max(axis=0, initial=0.0)
    springs = largest_spring_forces(d, record.q, record.v)
    scales = Scales.of_largest(d, violations.q, violations.v, violations.r, largest, springs).at_least(h)
    steps = len(record.t) - 1
    duration = float(record.t[-1] - record.t[0]) or 1.0
    # In systems with jumps of coordinates, steps with θ = 1 are recognised by u, which is ambiguous if no contact is active.
    late = (1.0 - θ) * h / duration if _constants(d).feeds_through else 0.0
    run = RunFigures(steps, duration, h, float(np.diff(record.t).min()), late, limits.precision)
    impulses = largest_impulses(d, events)
    nodes = judge_nodes(violations, _node_scales(scales), sizes(d).B @ impulses, run)
    found = dict(zip(("momentum", "equilibrium", "kinematics"), nodes, strict=True))
    found |= _judge_contacts(d, record, impulses, (violations, scales), run, θ)
    # The energy balance of a step is an identity, except with springs in series and non-linear springs.
    if _constants(d).balances and not d.springs and (θ == 0.5 or d.stores_energy):
        ε = limits.precision + 8.0 * steps * EPS
        momenta = scales.momenta + h * scales.forces
        allowed = ε * (scale + float(scales.v @ momenta))
        found |= {"energy_balance": (balance, allowed)} if θ == 0.5 else {"energy_loss": (loss, allowed)}
    return found, scales, Energies(balance, scale, loss)


def _violations(
    d: Dynamics, record: Record, events: Sequence[Event], θ: float, forces: tuple[Array, Array]
) -> tuple[Violations[Vector], tuple[float, float, float], float]:
    """Return the largest violations of each row and node; the energy imbalance, its loss and scale; the longest step."""
    rows, constants = rows_by_name(d), _constants(d)
    struck = [event for event in events if event.impulse != 0.0]
    step = steps_of(struck, record.t, record.q, record.v)
    row = np.array([rows[event.contact] for event in struck], dtype=np.int64)
    impulse = np.array([event.impulse for event in struck])
    order = np.lexsort((impulse, row, step)) if struck else step
    nc, n = len(d.contacts), len(d.nodes)
    violations = no_violations(nc, n, block_steps(nc, n, len(record.t) - 1))
    impulses = Impulses(step[order], row[order], impulse[order])
    pushes = record.reaction > 0.0
    pushes[impulses.step, impulses.row] |= impulses.P > 0.0
    *energies, h = certify_steps(
        Recorded(record.t, record.q, record.v, record.reaction, *forces, early_velocities(d, record, pushes, θ)),
        impulses,
        float(θ),
        constants.nodes,
        constants.contacts,
        constants.springs,
        constants.kinds,
        violations,
    )
    balance, loss, scale = energies
    return Violations(*(each.max(axis=1) for each in violations)), (balance, loss, scale), h


def _pattern(filled: Array) -> tuple[SparsityPattern, tuple[Places, Places]]:
    """Return the sparsity pattern of a matrix in compressed rows, and the rows and columns of its entries."""
    rows, columns = np.nonzero(filled)
    starts = np.append(0, np.cumsum(np.count_nonzero(filled, axis=1)))
    places = rows.astype(np.uint64), columns.astype(np.uint64)
    return SparsityPattern(starts.astype(np.uint64), places[1]), places


class RunFigures(NamedTuple):
    """The figures of a run that set its limits: number of steps, duration, longest and shortest step.

    ``late`` is the part of h by which a balance of forces may lie off, relative to the duration, and ``precision`` the
    precision to which laws are solved.
    """

    steps: int
    duration: float
    h: float
    shortest: float
    late: float
    precision: float


class NodeScales(NamedTuple):
    """The scales of the nodes (n,): |q|, |v|, forces and momenta."""

    q: Vector
    v: Vector
    forces: Vector
    momenta: Vector


class ContactScales(NamedTuple):
    """The scales of the rows, which set their limits (nc,).

    Attributes
    ----------
    u, U            the largest |u| and |U|
    impulse         the largest impulse, of friction that its normal force allows
    bounds          the bounds of friction that slides, and how far it may slip backward on springs in a step
    slip
    slow            rounding of U
    gap_change      the largest change of u in a step
    product         complementarity
    of_relays       limit of the product of a relay; negative for other rows
    """

    u: Vector
    U: Vector
    impulse: Vector
    bounds: Vector
    slip: Vector
    slow: Vector
    gap_change: Vector
    product: Vector
    of_relays: Vector


@compiled(allocates=False)
def judge_nodes(
    found: Violations[Vector], scales: NodeScales, pushed: Vector, run: RunFigures
) -> tuple[tuple[float, float], tuple[float, float], tuple[float, float]]:
    """Judge momentum, the balance of massless nodes and kinematics; nodes are ``pushed`` by the largest impulses."""
    momentum = equilibrium = kinematics = (-1.0, 0.0, 0.0)
    h, ε = run.h, run.precision + 8.0 * run.steps * EPS
    # A step length is a difference of times and inherits their rounding; an impulse is h times a mean force.
    blur = 4.0 * EPS * run.duration
    for i in range(len(pushed)):
        p, f = scales.momenta[i], scales.forces[i]
        allowed_p = ε * (p + h * f) + blur * (run.steps * f + pushed[i] / run.shortest)
        allowed_f = run.late * f + ε * (f + (pushed[i] + p) / run.duration)
        momentum = worse(momentum, found.momentum[i], allowed_p)
        equilibrium = worse(equilibrium, found.equilibrium[i] / run.duration, allowed_f)
        kinematics = worse(kinematics, found.kinematics[i], run.precision * (scales.q[i] + h * scales.v[i]))
    return momentum[1:], equilibrium[1:], kinematics[1:]


@compiled(allocates=False)
def judge_contacts(
    found: Violations[Vector], scales: ContactScales, kinds: tuple[Flags, Flags, Flags], q: float, run: RunFigures
) -> tuple[tuple[float, float], tuple[float, float], tuple[float, float], tuple[float, float]]:
    """Judge complementarity, penetration, bounds and the law of impact.

    ``kinds`` are which rows are at velocity level, which must not penetrate, and which have friction; q is the largest |q|.
    """
    complementarity = penetration = tension = impact_law = (-1.0, 0.0, 0.0)
    at_velocity_level, strict, frictional = kinds
    h = run.h
    ε = run.precision
    for i in range(len(scales.u)):
        r = found.r[i]
        bound = scales.bounds[i]
        slow = scales.slow[i]
        impulse = scales.impulse[i]
        # A gap that is held closed is a sum of places that need not be small themselves.
        near = ε * scales.u[i] + 64.0 * EPS * q
        allowed = r * near + ε * h * bound * scales.U[i] + 2.0 * bound * scales.slip[i]
        if scales.of_relays[i] >= 0.0:
            allowed = scales.of_relays[i]
        elif at_velocity_level[i]:
            allowed = (h * (r + bound) + impulse) * slow
        complementarity = worse(complementarity, scales.product[i], allowed)
        penetration = worse(penetration, found.penetration[i], (0.0 if strict[i] else scales.gap_change[i]) + near)
        beyond = r + (bound if frictional[i] else 0.0) + impulse / max(h, 1e-300)
        tension = worse(tension, found.tension[i], ε * beyond)
        impact_law = worse(impact_law, found.law[i], slow)
    return complementarity[1:], penetration[1:], tension[1:], impact_law[1:]


def _node_scales(scales: Scales) -> NodeScales:
    """Return the scales of the nodes."""
    return NodeScales(scales.q, scales.v, scales.forces, scales.momenta)


def _judge_contacts(
    d: Dynamics, record: Record, impulses: Array, results: tuple[Violations[Vector], Scales], run: RunFigures, θ: float
) -> Judgement:
    """Judge complementarity, penetration, bounds and the law of impact, with the largest impulses (nc,)."""
    violations, scales = results
    constants = _constants(d)
    none = np.zeros(len(d.contacts))
    bounds = none
    slip = none
    of_relays = constants.of_relays
    product = violations.product
    if constants.of_rate:
        # Friction is bounded by the normal force, and its impulse by that of the normal row.
        bounds = rate_forces(d, violations.r)
        slip = _slip_tolerance(d, record)
        impulses = np.maximum(impulses, d.friction_bounds(impulses) * d.tangential)
    slow = np.full(len(none), run.precision * scales.U.max(initial=0.0))
    if d.motions:
        # A node with prescribed motion has the mean velocity of its step in the law, and its own in the record.
        turned = np.abs(np.diff(record.v[:, d.driven], axis=0)).max(axis=0, initial=0.0)
        slow += sizes(d).H[:, d.driven] @ turned
    gap_change = np.maximum(violations.gap_change, run.h * scales.U)
    for path in constants.contacts.paths > 0.0:
        gap_change[path] = gap_change[path].sum()
        slow[path] = np.maximum(slow[path], slow[path].sum())
    if constants.switches:
        # Forces that balance at rest leave their rounding in u.
        reach = run.precision * scales.u + 64.0 * EPS * run.h * (sizes(d).H @ scales.forces)
        of_relays = np.where(d.switches, (d.r_max - d.r_min) * reach, -1.0)
        product = np.maximum(product, _missing_switches(d, record, θ))
    rows = ContactScales(scales.u, scales.U, impulses, bounds, slip, slow, gap_change, product, of_relays)
    kinds = constants.at_velocity_level, constants.strict, d.tangential
    found = judge_contacts(violations, rows, kinds, float(scales.q.max(initial=0.0)), run)
    return dict(zip(("complementarity", "penetration", "tension", "impact_law"), found, strict=True))


def _missing_switches(d: Dynamics, record: Record, θ: float) -> Array:
    """Return by how much relays miss their law in any step (nc,), with the u of `lcpimpact.integrators.moreau_jean`."""
    t = record.t
    q = record.q
    r = record.reaction
    end = _ends_of_steps(d, t, q)
    u, in_step = _images(d.H, end) + d.u0, np.diag(d.D) > 0.0
    if in_step.any():
        u = np.where(in_step, _images(d.H, (1.0 - θ) * q[:-1] + θ * end) + d.u0, u)
    u += _images(d.D, r)
    late = d.switches & (d.relative_degree > 1)
    if late.any():
        h = np.diff(t)
        level = np.rint(np.log2(h.max() / h))
        implicit = np.empty_like(q[1:])
        for k in np.unique(level):
            here = level == k
            A = d.C + h[here].mean() * d.K
            A[d.driven] = np.eye(len(A))[d.driven]
            forces = d.force_limits(t)[0][1:][here] + _images(d.B, r[here])
            right = _images(d.C, q[:-1][here]) + h[here, None] * forces
            right[:, d.driven] = end[here][:, d.driven]
            implicit[here] = np.linalg.solve(A, right.T).T
        u = np.where(late, _images(d.H, implicit) + d.u0, u)
    return np.asarray(law_residual(d, r, u, d.switches).max(axis=0, initial=0.0))


def _ends_of_steps(d: Dynamics, t: Array, q: Array) -> Array:
    """Return q at the ends of the steps, with the left limits of inputs that jump (steps, n)."""
    end = q[1:].copy()
    for i, motion in d.motions.items():
        if jumps(motion):
            end[:, i] = limits_at(motion, t)[0][1:]
    return end


def _images(A: Array, x: Array) -> Array:
    """Return A x of many instants, x (nt, n), by the entries of A: for a few columns BLAS would start threads (nt, m)."""
    found = np.zeros((len(x), len(A)))
    for i, j in np.argwhere(A):
        found[:, i] += A[i, j] * x[:, j]
    return found


def _slip_tolerance(d: Dynamics, record: Record) -> Array:
    """Return the allowed backward slip in m of a slider on springs near its threshold, per step (nc,).

    It is `SLIP_RTOL` times the deflection of the adjacent springs at the threshold, plus the difference of successive
    displacements, since a node between springs is in balance at the end of a step and its force is that at t + θ h.
    """
    static = d.decomposition.static
    if not static.any() or not (d.limited & d.of_rate).any():
        return np.zeros(len(d.contacts))
    moves = d.H @ static
    gives = np.abs(moves * np.linalg.lstsq(static.T @ d.K @ static, moves.T, rcond=None)[0].T).sum(axis=1)
    held = d.limited & d.of_rate & (d.relative_degree == 0)
    turned = np.abs(np.diff(np.diff(record.q, axis=0) @ d.H[held].T, axis=0)).max(axis=0, initial=0.0)
    tolerance = np.asarray(SLIP_RTOL * d.thresholds * gives)
    tolerance[held] += turned
    return tolerance
