"""Jams: steps in which no motion without an impulse obeys the laws of friction, and those in which several do.

While a rough contact slides its force is that of the LCP of the accelerations, which may have no solution or several (see
`lcpimpact.certificate.impact_choices` for the uniqueness, with accelerations in the place of velocities). A step solves an
LCP of impulses, which has one in either case: where there is no other, the impulse is that of an impact without collision,
and no force. Steps whose velocities change by far more than in those beside them are examined; for several motions, the
first step in which contacts slide as they do, or in which rows that turn with the motion make them several.

Sources: Painlevé, *Leçons sur le frottement* (1895); Génot and Brogliato, *New results on Painlevé paradoxes* (1999).
"""

from __future__ import annotations

from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from lcpimpact.arrays import Array, Flags, Indices, largest
from lcpimpact.certificate.impact_choices import (
    MAX_CASES,
    MAX_ROUGH,
    Contacts,
    always_one_solution,
    cases_of,
    has_one_solution,
    solutions,
)
from lcpimpact.certificate.impacts import struck_by
from lcpimpact.memo import remembered
from lcpimpact.record import CLOSED_GAP_RTOL, Event, Record, State
from lcpimpact.scheme.dynamics import Dynamics
from lcpimpact.scheme.lagrangian import LagrangianDynamics

STILL_RTOL = 1e-9
"""Rate, relative to its terms at their largest, below which a contact rests or sticks."""


def find_jams(
    d: Dynamics, record: Record, events: tuple[Event, ...], impulsive: Flags, *, jump_factor: float = 4.0
) -> tuple[tuple[Event, ...], str]:
    """Return the events of a run by steps with its jams, and a sentence; the impulses of jams are marked as ``impulsive``.

    An impact of contacts whose approach is rounding, or began by it in the step before, is a jam too. The sentence tells
    where several motions without an impulse obey the laws, of which the steps took one, and where none does and they slid
    on; "" if nowhere.

    ``jump_factor``: change of velocities in a step, relative to those in the steps beside it, above which it may
    hold an impulse.
    """
    steps = len(record.t) - 1
    rough = d.tangential & (d.relative_degree == 2)
    if steps < 1 or len(record.reaction) != steps or not rough.any() or always_one_solution(d):
        return events, ""
    # The samples of a row or node lie side by side here: arrays are (nc, steps) and (n, steps).
    v = np.ascontiguousarray(record.v.T)
    begin = record.t[:-1], record.q[:-1], record.v[:-1]
    scale = d.along(record.t, record.q, record.v)
    size, speed = (np.abs(scale.H) @ largest(each) for each in (record.q, record.v))
    touch = CLOSED_GAP_RTOL * (size + np.abs(scale.u0))
    U = np.ascontiguousarray(d.gap_rate(*begin).T)
    still = np.tile(STILL_RTOL * speed[:, None], steps)
    if isinstance(d, LagrangianDynamics):
        still[:, 1:] += np.where(d.impenetrable, d.turned(record.t, record.q, record.v), 0.0)[:-1].T
    U[np.abs(U) <= still] = 0.0
    pushes, struck = (np.ascontiguousarray(each.T) for each in (record.reaction > 0.0, impulsive))
    closed = (touch[:, None] >= d.gap(*begin[:2]).T) | pushes
    closed[:, 1:] |= pushes[:, :-1]
    closed &= d.rigid[:, None] & (U == 0.0)
    closed[:, 1:] |= closed[:, :-1] & struck[:, 1:] & (U[:, 1:] < 0.0)
    slips = (rough[:, None] & closed[d.normals]) * ((U > 0.0).astype(np.int8) - (U < 0.0))
    slides = slips.any(axis=0)
    Δv = np.sqrt(np.diag(scale.M)[d.massive] @ np.diff(v[d.massive], axis=1) ** 2)
    beside = np.maximum(np.append(0.0, Δv[:-1]), np.append(Δv[1:], 0.0))
    state = np.concatenate([closed, slips])
    changed = np.append(True, (state[:, 1:] != state[:, :-1]).any(axis=0))
    place = record.q[:-1]
    if isinstance(d, LagrangianDynamics):
        # Rows turn as the bodies move; a step has them where it ends.
        place = place + np.diff(record.t)[:, None] * record.v[:-1]
        changed |= _turns_singular(d, record.t[1:], place, closed, slips)
    begins = slides & ~struck.any(axis=0) & changed
    approached: Flags = np.asarray((struck & d.one_sided[:, None] & ~closed).any(axis=0))
    jumps = slides & (Δv > jump_factor * beside) & ~approached
    found = list(events)
    several, passed = list[float](), list[float]()
    budget = MAX_CASES
    for j in np.flatnonzero(begins | jumps).tolist():
        contacts = _sliding(d, np.flatnonzero(closed[:, j]), slips[:, j], record.t[j], place[j], record.v[j])
        here = d.at(record.t[j], place[j], record.v[j])
        if remembered(here, (_is_regular, state[:, j].tobytes()), partial(_is_regular, contacts)):
            continue
        if contacts.rough.sum() > MAX_ROUGH or (budget := budget - cases_of(contacts)) < 0:
            continue
        number, _ = solutions(contacts)
        if number > 1 and not impulsive[j].any():
            several.append(float(record.t[j]))
        elif number == 0 and jumps[j]:
            found = [each for each in found if not (each.kind == "impact" and _in_step(each, record, j))]
            rows = _linked(here, slips[:, j] != 0, record.reaction[j])
            found += _jam(here, record, j, rows)
            impulsive[j, rows] = True
        elif number == 0 and not impulsive[j].any():
            passed.append(float(record.t[j]))
    found.sort(key=lambda event: event.t)
    told = (
        f" At t = {passed[0]:.6g} s no motion without an impulse obeys the laws of friction, and the steps slid on without "
        "one: whether steps jam there is a chance of dt; take 'event-driven'."
        if passed
        else ""
    )
    if not several:
        return tuple(found), told
    more = f", and so at {len(several) - 1} more instants" if len(several) > 1 else ""
    return tuple(found), told + (
        f" Several motions obey the laws of friction from t = {several[0]:.6g} s on{more} (see all_solutions); the steps "
        "took one."
    )


def _turns_singular(d: LagrangianDynamics, t: Array, q: Array, closed: Flags, slips: NDArray[np.int8]) -> Flags:
    """Return the steps (steps,) from which on det G < 0: their accelerations have no solution, or several.

    G is that of the rows with unknown forces, where friction that slides is in a ratio to its normal force.
    """
    rows = closed | (closed[d.normals] & d.tangential[:, None] & (slips == 0))
    T = np.tile(np.eye(len(rows)), (len(t), 1, 1))
    for k in map(int, np.flatnonzero(d.tangential)):
        T[:, k, k] = slips[k] == 0
        T[:, k, d.normals[k]] = -d.mu[k] * slips[k]
    W = d.compliance(t, q)
    G = np.where(rows.T[:, :, None] & rows.T[:, None, :], W @ T, np.eye(len(rows)))
    sizes = np.where(rows.T, np.diagonal(W, axis1=1, axis2=2), 1.0)
    below: Flags = np.asarray(np.linalg.det(G) < -STILL_RTOL * sizes.prod(axis=1))
    return np.append(below[:1], below[1:] & ~below[:-1])


def _sliding(d: Dynamics, normals: Indices, slips: NDArray[np.int8], t: float, q: Array, v: Array) -> Contacts:
    """Return the closed contacts of a state, with the accelerations of their rows without contact forces."""
    nc = len(normals)
    friction = {int(d.normals[i]): int(i) for i in np.flatnonzero(d.tangential)}
    rows = np.zeros((2 * nc, len(d.contacts)))
    mu = np.zeros(nc)
    signs = np.zeros(nc)
    for k, i in enumerate(normals.tolist()):
        rows[k, i] = 1.0
        if (j := friction.get(i, -1)) >= 0 and d.relative_degree[j] == 2:
            rows[nc + k, j], signs[k] = 1.0, slips[j]
            mu[k] = d.mu[j] if slips[j] else d.mu_s[j]
    κ = rows @ d.rows(t, q, v).kappa if isinstance(d, LagrangianDynamics) else 0.0
    d = d.at(t, q, v)
    X, massive = struck_by(d, rows), d.massive
    F = (d.applied(t, q, v) + d.spring_force(q, v) - d.C @ v - d.K @ q)[massive]
    ξ = X.T @ np.linalg.solve(np.linalg.cholesky(d.M[np.ix_(massive, massive)]), F) + κ
    return Contacts(X[:, :nc], X[:, nc:], ξ[:nc], np.where(signs == 0.0, ξ[nc:], 0.0), mu, signs)


def _is_regular(contacts: Contacts) -> bool:
    """Return whether the accelerations are determined, whatever the forces: by small μ, or as all contacts slide.

    That depends on which contacts are closed and how they slip alone.
    """
    if has_one_solution(contacts._replace(ξ_N=np.zeros_like(contacts.ξ_N))):
        return True
    W = contacts.N.T @ (contacts.N - contacts.mu * contacts.slips * contacts.T)
    slides = ~contacts.rough | (contacts.slips != 0.0)
    return bool(slides.all() and np.linalg.eigvalsh(W + W.T)[0] > STILL_RTOL * np.abs(W).max())


def _linked(d: Dynamics, jammed: Flags, r: Array) -> Indices:
    """Return the rows whose impulses are one jam: those with forces that masses and joints link to friction (k,)."""
    rows = np.flatnonzero((r != 0.0) & d.impulsive | jammed)
    X = struck_by(d, np.eye(len(r))[rows])
    W = np.abs(X.T @ X) > STILL_RTOL * np.outer(*2 * [np.linalg.norm(X, axis=0)])
    W |= (rows[:, None] == d.normals[rows]) | (d.normals[rows][:, None] == rows)
    _, group = connected_components(W, directed=False)
    return np.asarray(rows[np.isin(group, group[jammed[rows]])])


def _in_step(event: Event, record: Record, j: int) -> bool:
    """Return whether an event has the limits of step j."""
    return np.array_equal(event.left.v, record.v[j]) and np.array_equal(event.right.v, record.v[j + 1])


def _jam(d: Dynamics, record: Record, j: int, rows: Indices) -> list[Event]:
    """Return the events of the rows that jam in step j."""
    h, r = float(record.t[j + 1] - record.t[j]), record.reaction
    left = State(record.q[j], record.v[j], r[j - 1] if j else np.zeros(r.shape[1]))
    right = State(record.q[j + 1], record.v[j + 1], r[j])
    t, law = float(record.t[j]), d.law_of_impacts
    return [Event(t, d.contacts[i].name, "jam", left, right, float(h * r[j, i]), law) for i in rows if r[j, i]]
