r"""Number of velocities v⁺ that obey the law at the impacts of a run.

Without friction there is one. With it, in coordinates z = Lᵀ (v⁺ - v⁻) in which the masses M = L Lᵀ are one, and with
the impulses' directions X = L⁻¹ Hᵀ,

.. math:: ξ = X^T z + ξ_0, \qquad z = X P, \qquad 0 \le P_N \perp ξ_N \ge 0, \qquad P_T \in -μ P_N \operatorname{Sgn} ξ_T .

Two solutions, of which s and s' are elements of Sgn ξ_T, differ by δz = X δP with δP_T = τ - μ s δP_N, δP_N δξ_N <= 0 and
τ δξ_T <= 0. So if Q(s) = W T(s) is a P-matrix for all \|s\| <= 1, where W = Xᵀ X and T(s) maps (δP_N, τ) to δP, there is one
solution. That is so if λ_min(W) > \|W_{:T} μ\|, for rows in units in which W has ones on its diagonal: for small μ, where no
contact is redundant. It is so too for one contact that is approached, of any μ, if W is regular.

Elsewhere each contact is tried open, sticking, and slipping one way or the other. A combination determines z, or leaves it
in a polytope: then there is a continuum, whose extremes are those of the coordinates.

Sources: Glocker, *Set-Valued Force Laws* (2001); Cottle, Pang and Stone, *The Linear Complementarity Problem* (1992).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import groupby, product
from typing import NamedTuple

import numpy as np

from lcpimpact.arrays import Array, Flags, Indices, largest
from lcpimpact.certificate.impacts import rows_by_name, struck_by
from lcpimpact.memo import once, remembered
from lcpimpact.record import CLOSED_GAP_RTOL, Event, Record
from lcpimpact.scheme.dynamics import Dynamics
from lcpimpact.scheme.lagrangian import LagrangianDynamics

MAX_ROUGH = 5
"""Maximum number of rough contacts in an impact whose v⁺ are counted."""

MAX_CASES = 2**14
"""Maximum number of combinations of contacts that are tried in a run, about two seconds."""

SAME_RTOL = 1e-8
"""Difference of two v⁺, relative to the largest change of velocity, below which they are one."""

OPEN, STICKS = None, 0
"""The states of a contact, beside the directions 1 and -1 of its slip."""


class Contacts(NamedTuple):
    """Contacts in an impact, in coordinates in which the masses are one.

    Attributes
    ----------
    N, T : (nz, nc) arrays      directions of their impulses; T is zero where there is no friction
    ξ_N, ξ_T : (nc,) arrays     U⁻ + e U⁻
    mu : (nc,) array            coefficients of friction
    slips : (nc,) array         known direction of slip, 1 or -1, of contacts whose forces are asked for; else 0
    """

    N: Array
    T: Array
    ξ_N: Array
    ξ_T: Array
    mu: Array
    slips: Array

    @property
    def rough(self) -> Flags:
        """Flags of the contacts with friction (nc,)."""
        return np.asarray((self.mu > 0.0) & (self.T != 0.0).any(axis=0))


def count_solutions(d: Dynamics, record: Record, events: Sequence[Event]) -> tuple[Event, ...]:
    """Return the events, with the number of v⁺ that obey the law of each impact with friction, and these v⁺."""
    found = list(events)
    if not (d.tangential & (d.relative_degree == 2)).any() or always_one_solution(d):
        return tuple(found)
    struck = [k for k, event in enumerate(events) if event.kind == "impact" and event.impulse != 0.0]
    scale = d.along(record.t, record.q, record.v)
    size = np.abs(scale.H) @ largest(record.q) + np.abs(scale.u0)
    rows, budget = rows_by_name(d), MAX_CASES
    for _, group in groupby(struck, key=lambda k: (events[k].left.v.tobytes(), events[k].right.v.tobytes())):
        together = list(group)
        t = events[together[0]].t
        left = events[together[0]].left
        right = events[together[0]].right
        P = np.zeros(len(rows))
        P[[rows[events[k].contact] for k in together]] = [events[k].impulse for k in together]
        touches = (
            (P != 0.0) | (d.gap(t, left.q) <= CLOSED_GAP_RTOL * size) | (left.reaction > 0.0) | (right.reaction > 0.0)
        )
        normals = np.flatnonzero(touches & d.rigid)
        here = d.at(t, left.q, left.v)
        contacts = contacts_of(here, normals, t, left.q, left.v, right.v)
        how = has_one_solution, normals.tobytes(), contacts.mu.tobytes(), (contacts.ξ_N < 0.0).tobytes()
        if remembered(here, how, partial(has_one_solution, contacts)):
            continue
        number: float | None = None
        ends = list[Array]()
        if contacts.rough.sum() <= MAX_ROUGH and cases_of(contacts) <= budget:
            budget -= cases_of(contacts)
            number, ends = solutions(contacts)
        if number is not None and number <= 1:
            continue
        several = tuple(left.v + each for each in _velocities(here, ends))
        for k in together:
            found[k] = replace(found[k], solutions=number, velocities=several)
    return tuple(found)


def contacts_of(d: Dynamics, normals: Indices, t: float, q: Array, before: Array, after: Array) -> Contacts:
    """Return contacts by their normal rows, between the velocities ``before`` and ``after`` an impact at t and q (n,)."""
    nc = len(normals)
    friction = {int(d.normals[i]): int(i) for i in np.flatnonzero(d.tangential)}
    tangents = [friction.get(int(i), -1) for i in normals]
    rows = np.zeros((2 * nc, len(d.contacts)))
    mu = np.zeros(nc)
    ξ = np.zeros(2 * nc)
    e = d.restitution
    toward = np.where(d.driven, after, before)
    U = d.gap_rate(t, q, before)
    V = d.gap_rate(t, q, toward)
    W = d.gap_rate(t, q, after)
    still = 1e-9 * (np.abs(d.H) @ np.abs(before - after))
    for k, (i, j) in enumerate(zip(normals, tangents, strict=True)):
        rows[k, i], ξ[k] = 1.0, V[i] + e[i] * min(U[i], 0.0)
        if j >= 0 and d.relative_degree[j] == 2:
            rows[nc + k, j], ξ[nc + k] = 1.0, V[j] + e[j] * U[j]
            # Static friction holds what does not slip, before and after.
            mu[k] = d.mu_s[j] if max(abs(U[j]), abs(W[j])) <= still[j] else d.mu[j]
    X = struck_by(d, rows)
    return Contacts(X[:, :nc], X[:, nc:], ξ[:nc], ξ[nc:], mu, np.zeros(nc))


def has_one_solution(contacts: Contacts) -> bool:
    """Return whether it is certain without a search that one v⁺ obeys the law."""
    rough = contacts.rough
    if not rough.any():
        return True
    N = contacts.N
    T = contacts.T[:, rough]
    mu = contacts.mu[rough]
    size_N = np.linalg.norm(N, axis=0)
    size_T = np.linalg.norm(T, axis=0)
    if not (size_N > 0.0).all():
        return False
    X = np.hstack([N / size_N, T / size_T])
    least = float(np.linalg.eigvalsh(X.T @ X)[0])
    if len(size_N) == 1:
        return least > SAME_RTOL and bool(contacts.ξ_N[0] < 0.0)
    coupling = X.T @ X[:, len(size_N) :] * (mu * size_T / size_N[rough])
    return least > SAME_RTOL and bool(np.linalg.norm(coupling, 2) < least)


def solutions(contacts: Contacts) -> tuple[float, list[Array]]:
    """Return the number of v⁺ that obey the law, and z (nz,) of each, or the extremes of a continuum.

    Examples
    --------
    A body falls into a wedge whose walls stop it by its bottom alone, or by friction:

    >>> N, T = np.array([[2.0, 2.0], [-1.0, -1.0]]), np.array([[2.0, -1.0], [0.0, 0.0]])
    >>> v = np.array([-1.0, 2.0])
    >>> number, ends = solutions(Contacts(N, T, N.T @ v, T.T @ v, np.ones(2), np.zeros(2)))
    >>> number, sorted((v + z).round(3).tolist() for z in ends)
    (inf, [[0.0, 0.0], [0.333, 0.667]])
    """
    found, continuum = list[Array](), False
    sizes = np.linalg.norm(np.hstack([contacts.N, contacts.T]), axis=0)
    speeds = np.abs(np.append(contacts.ξ_N, contacts.ξ_T)) / np.where(sizes > 0.0, sizes, np.inf)
    speed = float(speeds.max(initial=0.0))
    near = SAME_RTOL * speed
    for case in product(*(_states(*each) for each in zip(contacts.rough, contacts.slips, strict=True))):
        ends = list(_solutions_of_case(contacts, case, near, found))
        continuum |= any(np.abs(each - ends[0]).max() > 10.0 * near for each in ends)
        for z in ends:
            if not any(np.abs(z - other).max() <= 10.0 * near for other in found):
                found.append(z)
    return (math.inf if continuum else len(found)), found


def cases_of(contacts: Contacts) -> int:
    """Return the number of combinations that are tried."""
    return math.prod(len(_states(*each)) for each in zip(contacts.rough, contacts.slips, strict=True))


def _states(rough: bool, slip: float) -> tuple[int | None, ...]:
    """Return the states that are tried of a contact."""
    if rough and slip != 0.0:
        return OPEN, int(slip)
    return (OPEN, STICKS, 1, -1) if rough else (OPEN, STICKS)


def _solutions_of_case(
    contacts: Contacts, case: Sequence[int | None], near: float, known: Sequence[Array]
) -> Iterator[Array]:
    """Yield the z of a case that is not ``known``, or the extremes of its coordinates where the case leaves z open."""
    N = contacts.N
    T = contacts.T
    ξ_N = contacts.ξ_N
    ξ_T = contacts.ξ_T
    mu = contacts.mu
    slips = contacts.slips
    rough = contacts.rough
    cone = list[Array]()
    held = list[Array]()
    rest = list[float]()
    signs, bounds = list[Array](), list[float]()  # z·sign >= bound
    for k, state in enumerate(case):
        if state is OPEN:
            signs.append(N[:, k])
            bounds.append(-ξ_N[k])
            continue
        held.append(N[:, k])
        rest.append(-ξ_N[k])
        if not rough[k]:
            cone.append(N[:, k])
        elif state == STICKS:
            cone += [N[:, k] - mu[k] * T[:, k], N[:, k] + mu[k] * T[:, k]]
            held.append(T[:, k])
            rest.append(-ξ_T[k])
        else:
            cone.append(N[:, k] - mu[k] * state * T[:, k])
            if slips[k] == 0.0:
                signs.append(state * T[:, k])
                bounds.append(-state * ξ_T[k])
    D = np.array(cone).reshape(-1, len(N)).T
    R = np.array(held).reshape(-1, len(N)).T
    S = np.array(signs).reshape(-1, len(N)).T
    right, least = np.array(rest), np.array(bounds)
    unit_R, unit_S = (
        np.where(each > 0.0, each, 1.0) for each in (np.linalg.norm(R, axis=0), np.linalg.norm(S, axis=0))
    )
    from scipy.optimize import linprog, nnls  # here, as most runs do without it

    # An orthonormal basis of the z that impulses of the case reach.
    basis, size, _ = np.linalg.svd(D, full_matrices=False) if D.size else (np.zeros((len(N), 0)), np.zeros(0), None)
    basis = basis[:, size > SAME_RTOL * size.max(initial=0.0)]
    A = (R / unit_R).T @ basis if R.size else np.zeros((0, basis.shape[1]))
    if np.linalg.matrix_rank(A, SAME_RTOL) == basis.shape[1]:
        z = basis @ np.linalg.lstsq(A, right / unit_R, rcond=SAME_RTOL)[0] if basis.size else np.zeros(len(N))
        if any(np.abs(z - other).max() <= 10.0 * near for other in known):
            return
        fits = (np.abs(R.T @ z - right) <= near * unit_R).all() and (S.T @ z - least >= -near * unit_S).all()
        if fits and (not D.size or nnls(D, z)[1] <= max(near, SAME_RTOL * np.linalg.norm(z))):
            yield z
        return
    limits = {
        "A_ub": -(S / unit_S).T @ D, "b_ub": -least / unit_S + near, "A_eq": (R / unit_R).T @ D, "b_eq": right / unit_R,
    }  # fmt: skip
    for direction in np.vstack([np.eye(len(N)), -np.eye(len(N))]):
        extreme = linprog(direction @ D, **limits)
        if extreme.status == 2:
            return
        if extreme.status == 0:
            yield D @ extreme.x


def _velocities(d: Dynamics, found: Sequence[Array]) -> Iterator[Array]:
    """Yield the change of v (n,) of each z."""
    massive = d.massive
    L = np.linalg.cholesky(d.M[np.ix_(massive, massive)])
    for z in found:
        change = np.zeros(len(d.nodes))
        change[massive] = np.linalg.solve(L.T, z)
        yield change


@once
def always_one_solution(d: Dynamics) -> bool:
    """Return whether it is known that all impacts of a system have one v⁺, whichever contacts take part and wherever."""
    if isinstance(d, LagrangianDynamics):
        return False
    normals = np.flatnonzero(d.rigid)
    still = np.zeros(len(d.nodes))
    contacts = contacts_of(d, normals, 0.0, still, still, still)
    return len(normals) > 0 and has_one_solution(contacts)


def sentence(d: Dynamics, events: Sequence[Event]) -> str:
    """Return in words where several v⁺ obey the law of impact, how many, and which was taken; "" if nowhere."""
    impacts = {event.right.v.tobytes(): event for event in events if event.solutions != 1}
    several = [event for event in impacts.values() if event.solutions is not None]
    parts, unexamined = [], len(impacts) - len(several)
    if several:
        first = several[0]
        more = f", and so at {len(several) - 1} more impacts" if len(several) > 1 else ""
        parts.append(f"Several v⁺ obey the law of impact at t = {first.t:.6g} s: {_in_words(d, first)}{more}")
    if unexamined:
        parts.append(
            f"At {unexamined} impact{'s' if unexamined > 1 else ''} with many rough contacts it was not examined whether "
            "several v⁺ obey the law"
        )
    return "".join(f" {part}." for part in parts)


def _in_words(d: Dynamics, event: Event) -> str:
    """Return the v⁺ of an event in words, a continuum by its extremes, and the v⁺ that was taken."""
    v = np.array(event.velocities)
    zero = SAME_RTOL * np.abs(v).max()
    v[np.abs(v) <= zero] = 0.0
    differ = np.flatnonzero(np.ptp(v, axis=0) > zero)[:4]

    def shown(v: Array) -> str:
        return ", ".join(f"v_{d.nodes[i]} = {v[i]:.4g}" for i in differ)

    if event.solutions == math.inf:
        low, high = v.min(axis=0), v.max(axis=0)
        text = "a continuum, " + ", ".join(f"v_{d.nodes[i]} = {low[i]:.4g} ... {high[i]:.4g}" for i in differ)
    else:
        text = f"{event.solutions:g} distinct ones, " + "; ".join(shown(each) for each in v[:4])
    taken = np.where(np.abs(event.right.v) <= zero, 0.0, event.right.v)
    return f"{text}; the run took {shown(taken)}"
