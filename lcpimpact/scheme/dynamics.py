"""The equations of motion: M q'' + C q' + K q = f(t, q, q') + s(q, q') + Hᵀ r, u = H q + u0, with a law for each row."""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from functools import cached_property, partial, wraps
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from lcpimpact.arrays import Array, Flags, Indices
from lcpimpact.scheme import force_law
from lcpimpact.scheme.decomposition import Decomposition, decompose
from lcpimpact.scheme.force_law import ForceLaw
from lcpimpact.scheme.impulse_paths import extreme_rays, impulse_paths
from lcpimpact.scheme.laws import CONTACT, Bounded, RowLaw
from lcpimpact.scheme.signals import (
    PiecewisePolynomial,
    Signal,
    breaks,
    limits_at,
    limits_in_steps,
    places_and_rates,
    values_at,
    values_in_steps,
)
from lcpimpact.scheme.terms import PowerLaw, Terms

T = TypeVar("T")

DEGREE_REASON = {
    0: "the contact plate is massless and carried by a spring only, so the force is continuous",
    1: "the contact plate is massless and rests on a dashpot, so the force may jump, without an impulse",
    2: "both sides have mass or are ground, so velocities jump and impulses act",
}


class Feature(StrEnum):
    """Features of a system beyond masses, springs, dashpots and bumpers, which not every method handles."""

    SLIDERS = "sliders"
    RELAYS = "relays"
    POWER_LAWS = "non-linear springs"
    FORCES = "general forces"
    MOTIONS = "prescribed motion"
    SYSTEMS = "systems given directly"
    MASSLESS = "massless nodes"
    RESTITUTION = "restitution"
    IMPULSE_PATHS = "impulses through massless nodes"
    FRICTION = "friction bounded by a normal force"
    JOINTS = "joints"
    EQUATIONS = "equations of a system"
    STATIC_FRICTION = "static friction above the kinetic one"


@dataclass(frozen=True)
class Contact(Bounded):
    """One row of the constraint, u = H q + D r + u0, with its law.

    Attributes
    ----------
    name : str
        The name of the reaction.
    upper, lower : str
        The nodes that r pushes apart.
    gap : float
        u in m at zero coordinates.
    e : float
        Coefficient of restitution; 0 where no impulse can act and it means nothing.
    relative_degree : int
        How often u must be differentiated before r appears: 0, 1 or 2, and more for relays.
    law : RowLaw
        The law of r.
    bounds : (float, float)
        r_min and r_max in N; infinite for friction, which μ r_N bounds.
    mu, mu_s : float
        Kinetic and static coefficient of friction.
    normal : int
        The row whose reaction r_N bounds the friction; -1 for other laws.
    """

    name: str
    upper: str
    lower: str
    gap: float
    e: float
    relative_degree: int
    law: RowLaw = CONTACT
    bounds: tuple[float, float] = (0.0, math.inf)
    mu: float = 0.0
    mu_s: float = 0.0
    normal: int = -1

    @property
    def sentence(self) -> str:
        """The relative degree and its reason, in words."""
        reason = DEGREE_REASON[self.relative_degree]
        if self.limited and self.law.of_rate:
            reason = reason.replace("and impulses act", "but no impulse acts, since friction is bounded")
        where = f" between {self.upper!r} and {self.lower!r}" if self.upper or self.lower else ""
        if not where:
            k = self.relative_degree
            names = {0: "u", 1: "the first derivative of u", 2: "the second derivative of u"}
            reason = f"r appears in {names.get(k, f'the derivative {k} of u, if in any')}"
        return f"{self.name}{where} has relative degree {self.relative_degree}: {reason}."


@dataclass(frozen=True)
class Dynamics:
    r"""The equations of motion of a scheme.

    .. math:: M \ddot q + C \dot q + K q = f(t, q, \dot q) + s(q, \dot q) + B r, \qquad u = H q + D r + u_0

    with one law for each row: 0 <= u ⟂ r >= 0, or -r0 <= r <= r0 ⟂ u' for a slider, or r_min <= r <= r_max ⟂ u for a relay
    (see `lcpimpact.scheme.laws`). In a scheme B = Hᵀ and D = 0; a
    complementarity system that is given directly has both of its own. The rows of nodes with prescribed motion, q_i = y(t),
    are no equations of motion: their residual is the force that drives the node.

    Attributes
    ----------
    nodes : tuple of str                the coordinates, in the order of q
    M, C, K : (n, n) arrays             mass (kg, singular where nodes are massless), damping (N s/m), stiffness (N/m)
    loads : tuple of (int, load)        index of the node and the force in N, or a function of time
    H : (nc, n) array                   for each row of the constraint +1 at its lower and -1 at its upper node
    u0 : (nc,) array                    openings in m at q = 0
    contacts : tuple of Contact         name, law and relative degree of each row
    B : (n, nc) array                   how the reactions act
    D : (nc, nc) array                  how they act on u directly
    springs : tuple of PowerLaw         the non-linear springs, whose forces are s
    force_laws : tuple of ForceLaw      the general forces, which f holds beside the loads
    motions : dict of int to Signal     index of each node with prescribed motion, and its motion
    stores_energy : bool                whether ½ vᵀ M v + ½ qᵀ K q is an energy
    residues : tuple of arrays          what rounding has left out of M, C and K, (n, n) each; none where they were given
    """

    nodes: tuple[str, ...]
    M: Array
    C: Array
    K: Array
    loads: tuple[tuple[int, float | Callable[[float], float]], ...]
    H: Array
    u0: Array
    contacts: tuple[Contact, ...]
    B: Array
    D: Array
    springs: tuple[PowerLaw, ...] = ()
    force_laws: tuple[ForceLaw, ...] = ()
    motions: Mapping[int, Signal] = field(default_factory=dict)
    stores_energy: bool = True
    residues: tuple[Array, Array, Array] | None = None

    @cached_property
    def computed(self) -> dict[Any, Any]:
        """The cache of results that other modules compute from this system, by their keys; it is not copied."""
        return {}

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in vars(self).items() if name != "computed"}

    @cached_property
    def features(self) -> dict[Feature, str]:
        """Its features that not every method handles, with the element or name that causes each."""
        found: dict[Feature, str] = {}
        of_laws = (
            (Feature.SLIDERS, self.of_rate & ~self.tangential),
            (Feature.FRICTION, self.tangential),
            (Feature.STATIC_FRICTION, self.mu_s > self.mu),
            (Feature.JOINTS if self.stores_energy else Feature.EQUATIONS, self.bilateral),
            (Feature.RELAYS, self.switches),
        )
        for feature, rows in of_laws:
            if rows.any():
                first = self.contacts[int(np.argmax(rows))]
                found[feature] = f"{first.law.name if self.stores_energy else 'multiplier'} {first.name!r}"
        if self.springs:
            found[Feature.POWER_LAWS] = self.springs[0].element
        if self.force_laws:
            found[Feature.FORCES] = self.force_laws[0].element
        if self.motions:
            found[Feature.MOTIONS] = f"node {self.nodes[next(iter(self.motions))]!r}"
        if not self.stores_energy:
            found[Feature.SYSTEMS] = "A, B, C, D"
        elif not (self.massive | self.driven).all():
            found[Feature.MASSLESS] = f"node {self.nodes[int(np.argmin(self.massive | self.driven))]!r}"
        if bouncing := [contact.name for contact in self.contacts if contact.e > 0.0 and contact.normal < 0]:
            found[Feature.RESTITUTION] = f"contact {bouncing[0]!r}"
        if len(path := self.impulse_lines[:1]):
            names = ", ".join(repr(self.contacts[i].name) for i in np.flatnonzero(path[0]))
            found[Feature.IMPULSE_PATHS] = f"contacts {names}, once all are closed"
        return found

    @cached_property
    def decomposition(self) -> Decomposition:
        """The kinds of coordinates."""
        return decompose(self.M, self.C, self.driven)

    @cached_property
    def impulse_paths(self) -> Array:
        """The contacts through which an impulse can pass from mass to mass or ground, one path a row (np, nc)."""
        paths = np.zeros((0, len(self.contacts)))
        parts, rows = self.decomposition, self.impenetrable
        if parts.massive.size:
            massless = np.column_stack([parts.damped, parts.static])
            found = impulse_paths(parts.massive.T @ self.B[:, rows], massless.T @ self.B[:, rows])
            paths = np.zeros((len(found), len(self.contacts)))
            paths[:, rows] = found
        return paths

    @cached_property
    def gap_paths(self) -> Array:
        """The contacts whose gaps add up to one that no quasi-static node changes: it must not be negative (nr, nc)."""
        rows = self.impenetrable
        rays = extreme_rays(self.decomposition.static.T @ self.B[:, rows])
        paths = np.zeros((len(rays), len(self.contacts)))
        paths[:, rows] = rays
        return paths

    @cached_property
    def impulse_lines(self) -> Array:
        """The impulse paths that lead over massless nodes, so that no contact on them has relative degree 2 alone."""
        return np.asarray(self.impulse_paths[np.count_nonzero(self.impulse_paths, axis=1) > 1])

    @property
    def forces(self) -> tuple[Contact | PowerLaw, ...]:
        """All that has a force by a name: the rows, whose reactions are unknowns, and the non-linear springs."""
        return (*self.contacts, *self.springs)

    @cached_property
    def driven(self) -> Flags:
        """Flags of the nodes with a prescribed motion (n,)."""
        return np.isin(np.arange(len(self.nodes)), list(self.motions))

    @cached_property
    def r_min(self) -> Array:
        """Lower bound of each reaction in N (nc,)."""
        return np.array([each.bounds[0] for each in self.contacts], dtype=np.float64)

    @cached_property
    def r_max(self) -> Array:
        """Upper bound of each reaction in N (nc,)."""
        return np.array([each.bounds[1] for each in self.contacts], dtype=np.float64)

    @cached_property
    def of_rate(self) -> Flags:
        """Flags of the rows whose law is that of a rate U, and not of a place u (nc,)."""
        return self._where(lambda row: row.law.of_rate)

    @cached_property
    def one_sided(self) -> Flags:
        """Flags of the rows whose reactions push only, and without limit (nc,)."""
        return self._where(lambda row: row.one_sided)

    @cached_property
    def impenetrable(self) -> Flags:
        """Flags of the rows with u >= 0 (nc,)."""
        return self._where(lambda row: row.impenetrable)

    @cached_property
    def bilateral(self) -> Flags:
        """Flags of the rows with u = 0, whose reactions have any sign (nc,)."""
        return self._where(lambda row: row.bilateral)

    @cached_property
    def limited(self) -> Flags:
        """Flags of the rows whose reactions have two bounds of their own (nc,)."""
        return self._where(lambda row: row.limited)

    @cached_property
    def tangential(self) -> Flags:
        """Flags of the rows with friction, whose reactions those of normal rows bound (nc,)."""
        return self._where(lambda row: row.law.tangential)

    @cached_property
    def switches(self) -> Flags:
        """Flags of the rows whose reactions go from bound to bound where u changes its sign (nc,)."""
        return self._where(lambda row: row.switches)

    @cached_property
    def permanent(self) -> Flags:
        """Flags of the rows that act at all times and without limit, so that they take part in any impact (nc,)."""
        return np.asarray(~(self.impenetrable | self.limited | self.tangential))

    @cached_property
    def rigid(self) -> Flags:
        """Flags of the contacts between masses, at which impulses act (nc,)."""
        return np.asarray(self.impenetrable & (self.relative_degree == 2))

    @cached_property
    def impulsive(self) -> Flags:
        """Flags of the rows between masses whose reactions have no limit, so that they may be impulses (nc,)."""
        return np.asarray((self.relative_degree == 2) & ~self.limited)

    @cached_property
    def markov(self) -> Array:
        """Action of the reactions on the derivative ρ of u of a given system, row by row D, H B, -H K B, ... (nc, nc)."""
        found, row = self.D.copy(), self.H
        for degree in range(1, self.relative_degree.max(initial=0) + 1):
            rows = self.relative_degree == degree
            found[rows] = (row @ self.B)[rows]
            row = -row @ self.K
        return found

    @cached_property
    def elimination(self) -> Array:
        """T (nc, nc), with which r = T r: the reactions of the equations of a given system follow the others."""
        T, equations = np.eye(len(self.contacts)), self.bilateral
        if equations.any() and not self.stores_energy:
            G = self.markov[equations]
            T[equations] = -np.linalg.solve(G[:, equations], np.where(equations, 0.0, G))
        return T

    @cached_property
    def mu(self) -> Array:
        """Coefficient of friction of each row; 0 of rows with other laws (nc,)."""
        return np.array([each.mu for each in self.contacts], dtype=np.float64)

    @cached_property
    def mu_s(self) -> Array:
        """Static coefficient of friction of each row; 0 of rows with other laws (nc,)."""
        return np.array([each.mu_s for each in self.contacts], dtype=np.float64)

    @cached_property
    def normals(self) -> Indices:
        """The row whose reaction bounds the friction of each row; -1 of rows with other laws (nc,)."""
        return np.array([each.normal for each in self.contacts], dtype=np.int64)

    @cached_property
    def jumping(self) -> Flags:
        """Flags of the nodes with a prescribed motion that jumps, as inputs of relays may (n,)."""
        motions = self.motions.items()
        found = [i for i, each in motions if isinstance(each, PiecewisePolynomial) and not each.continuous]
        return np.isin(np.arange(len(self.nodes)), found)

    @property
    def friction(self) -> tuple[Indices, Indices, Array]:
        """The rows with friction, those of their normal forces, and the coefficients of friction (nf,) each."""
        rows = np.flatnonzero(self.tangential)
        return rows, self.normals[rows], self.mu[rows]

    @cached_property
    def thresholds(self) -> Array:
        """Largest |r| in N of each slider, r0; 0 of other rows (nc,)."""
        return np.where(self.limited & self.of_rate, np.maximum(-self.r_min, self.r_max), 0.0)

    def friction_bounds(self, r: Array) -> Array:
        """Return the bounds in N of |r| of sliders, r0, and of friction that slides, μ r_N; 0 of other rows (..., nc)."""
        return np.asarray(self.thresholds + self.mu * np.maximum(r[..., self.normals], 0.0))

    def holding_bounds(self, r: Array) -> Array:
        """Return the bounds in N of |r| of sliders, r0, and of friction that sticks, μ_s r_N; 0 of others (..., nc)."""
        return np.asarray(self.thresholds + self.mu_s * np.maximum(r[..., self.normals], 0.0))

    def interval(self, r: Array) -> tuple[Array, Array]:
        """Return the bounds in N of each reaction, those of friction by the normal forces in r (..., nc)."""
        if not self.tangential.any():
            return self.r_min, self.r_max
        bounds = self.friction_bounds(r)
        return np.where(self.tangential, -bounds, self.r_min), np.where(self.tangential, bounds, self.r_max)

    def laws_of_impact(self, struck: Flags) -> tuple[str, ...]:
        """Return the law of each row in an impact of the rows ``struck`` (nc,).

        It is "newton" for a contact alone, and "simultaneous" where masses and joints couple contacts: all by Newton's law
        at once. Friction has the law of its normal row.
        """
        rows = np.flatnonzero(struck & (self.one_sided | self.bilateral))
        if np.count_nonzero(self.one_sided[rows]) < 2:
            return ("newton",) * len(self.contacts)
        return remembered(self, ("laws of impact", rows.tobytes()), partial(self._laws_of_coupled, rows))

    def _laws_of_coupled(self, rows: Indices) -> tuple[str, ...]:
        """Return the law of each row in an impact of several contacts and joints ``rows``."""
        from scipy.sparse.csgraph import connected_components  # here, since other runs need none of SciPy

        massive = self.massive
        _, body = connected_components(self.M[np.ix_(massive, massive)] != 0.0, directed=False)
        acts = (self.H[rows][:, massive] != 0.0) @ (body[:, None] == np.arange(body.max(initial=0) + 1))
        _, group = connected_components(acts @ acts.T, directed=False)
        together = np.bincount(group, self.one_sided[rows]) > 1.0
        laws = dict(zip(rows.tolist(), np.where(together[group], "simultaneous", "newton").tolist(), strict=True))
        owners = np.where(self.tangential, self.normals, np.arange(len(self.contacts))).tolist()
        return tuple(laws.get(i, "newton") for i in owners)

    def _where(self, holds: Callable[[Contact], bool]) -> Flags:
        """Return the flags of the rows of which something holds (nc,)."""
        return np.array([holds(each) for each in self.contacts], dtype=np.bool_)

    @cached_property
    def directions(self) -> Array:
        """For each non-linear spring the row d with δ = -(d·q + gap) (ns, n)."""
        terms = Terms(self.nodes)
        rows = [terms.direction(spring.upper, spring.lower) for spring in self.springs]
        return np.array(rows).reshape(len(rows), len(self.nodes))

    @cached_property
    def power_laws(self) -> Array:
        """Gap, K, n, b and c of each non-linear spring (ns, 5)."""
        return np.array([(each.gap, each.K, each.n, each.b, each.c) for each in self.springs]).reshape(-1, 5)

    def motion(self, t: ArrayLike) -> tuple[Array, Array]:
        """Return y(t) and y'(t) of the driven nodes, in the order of their indices, with the shape of t and then (np,)."""
        times = _instants(t)
        return places_and_rates([self.motions[i] for i in sorted(self.motions)], times, np.result_type(times, self.M))

    @cached_property
    def massive(self) -> Flags:
        """Flags of the nodes that move by a mass of their own (n,)."""
        return (np.diag(self.M) > 0.0) & ~self.driven

    @cached_property
    def relative_degree(self) -> Indices:
        """Relative degree of each row (nc,)."""
        return np.array([contact.relative_degree for contact in self.contacts], dtype=np.int64)

    @cached_property
    def restitution(self) -> Array:
        """Coefficient of restitution of each row (nc,)."""
        return np.array([contact.e for contact in self.contacts], dtype=np.float64)

    @cached_property
    def constant_loads(self) -> bool:
        """Whether no load depends on time, and none on the motion."""
        return not self.force_laws and not any(callable(load) for _, load in self.loads)

    def force(self, t: ArrayLike) -> Array:
        """Return the loads f(t) in N, with the shape of t followed by (n,)."""
        times = _instants(t)
        f = np.full((*times.shape, len(self.nodes)), 0.0, np.result_type(times, self.M))
        for i, load in self.loads:
            if callable(load):
                f[..., i] += values_at(load, times)
            else:
                f[..., i] += load
        return f

    @cached_property
    def breaking_loads(self) -> bool:
        """Whether a load is a signal that may have breakpoints."""
        return any(breaks(load) for _, load in self.loads)

    def force_limits(self, t: Array, kept: float | None = None) -> tuple[Array, Array]:
        """Return the left and the right limits of the loads in N at the instants of a grid as its steps see them (nt, n).

        With the end of a step that is ``kept`` as in `lcpimpact.scheme.signals.limits_in_steps`. A quasi-static
        node is in balance with the loads at the end of a step, and not with their mean.
        """
        left = self.force(t)
        right = left.copy()
        held: Flags = np.asarray(self.decomposition.static.any(axis=1))
        for i in {i for i, load in self.loads if breaks(load)}:
            left[:, i] = right[:, i] = 0.0
            for load in (load for j, load in self.loads if i == j):
                if callable(load):
                    below, above = limits_at(load, t) if held[i] else limits_in_steps(load, t, kept)
                    left[:, i] += below
                    right[:, i] += above
                else:
                    left[:, i] += load
                    right[:, i] += load
        return left, right

    def force_in_steps(self, t: Array, c: float) -> Array:
        """Return the loads in N that the steps of a grid see at t + c h, 0 < c < 1 (steps, n)."""
        f = np.zeros((len(t) - 1, len(self.nodes)))
        for i, load in self.loads:
            f[:, i] += values_in_steps(load, t, c) if callable(load) else load
        return f

    @cached_property
    def acted_on(self) -> Indices:
        """The nodes of the general forces, one law after another (ng,)."""
        found = [self.nodes.index(node) for law in self.force_laws for node in law.nodes]
        return np.array(found, dtype=np.int64)

    @cached_property
    def pushes(self) -> Array:
        """Directions in which the forces of non-linear springs, then the general forces, act on the nodes (ns + ng, n)."""
        return np.vstack([self.directions, np.eye(len(self.nodes))[self.acted_on]])

    def applied(self, t: ArrayLike, q: ArrayLike, v: ArrayLike) -> Array:
        """Return f(t, q, v) in N (..., n): the loads and the general forces, with t (...) and q and v (..., n)."""
        return np.asarray(self.force(t) + self.motion_forces(t, q, v))

    def motion_forces(self, t: ArrayLike, q: ArrayLike, v: ArrayLike) -> Array:
        """Return the general forces alone in N (..., n)."""
        if not self.force_laws:
            return np.zeros(np.shape(q))
        q = np.asarray(q, dtype=np.float64)
        v = np.asarray(v, dtype=np.float64)
        times = np.broadcast_to(np.asarray(t, dtype=np.float64), q.shape[:-1])
        f, here = np.zeros(q.shape), self.acted_on
        for at in np.ndindex(times.shape):
            np.add.at(f[at], here, force_law.forces(self.force_laws, float(times[at]), q[at][here], v[at][here]))
        return f

    def gap(self, q: ArrayLike) -> Array:
        """Return the openings H q + u0 in m, for q of shape (..., n), without the part D r."""
        return np.asarray(np.asarray(q) @ self.H.T + self.u0)

    def gap_rate(self, v: ArrayLike) -> Array:
        """Return the opening rates U = H v in m/s, for v of shape (..., n)."""
        return np.asarray(np.asarray(v) @ self.H.T)

    def kinetic_energy(self, v: ArrayLike) -> Array:
        """Return ½ vᵀ M v in J, for v of shape (..., n)."""
        return 0.5 * _quadratic_form(self.M, v)

    def elastic_energy(self, q: ArrayLike) -> Array:
        """Return ½ qᵀ K q + Σ K δⁿ⁺¹/(n + 1) in J, for q of shape (..., n)."""
        linear = 0.5 * _quadratic_form(self.K, q)
        if not self.springs:
            return linear
        from lcpimpact.scheme.power_law import energies  # here, as a scheme is read, checked and drawn without numba

        return np.asarray(linear + energies(self.power_laws, self.approach(q)).sum(axis=-1))

    def approach(self, q: ArrayLike) -> Array:
        """Return δ of the non-linear springs in m (..., ns), for q of shape (..., n)."""
        return np.asarray(-(np.asarray(q) @ self.directions.T + self.power_laws[:, 0]))

    def approach_rate(self, v: ArrayLike) -> Array:
        """Return δ' of the non-linear springs in m/s (..., ns), for v of shape (..., n)."""
        return np.asarray(-np.asarray(v) @ self.directions.T)

    def push(self, q: ArrayLike, v: ArrayLike, extended: bool = False) -> Array:
        """Return the force in N by which each non-linear spring pushes its ends apart (..., ns).

        With ``extended`` it is K |δ|ⁿ sign δ (1 + b δ') + c δ', without regard to contact.
        """
        if not self.springs:
            return np.zeros((*np.shape(q)[:-1], 0))
        from lcpimpact.scheme.power_law import forces

        return forces(self.power_laws, self.approach(q), self.approach_rate(v), extended)

    def spring_losses(self, q: ArrayLike, v: ArrayLike, s: Array | None = None) -> Array:
        """Return (s - K δ_+ⁿ) δ', the power in W that each non-linear spring dissipates (..., ns); s is `push` or given."""
        from lcpimpact.scheme.power_law import forces

        δ, rate = self.approach(q), self.approach_rate(v)
        s = forces(self.power_laws, δ, rate) if s is None else s
        return np.asarray((s - forces(self.power_laws, δ, np.zeros_like(rate))) * rate)

    def spring_force(self, q: ArrayLike, v: ArrayLike) -> Array:
        """Return s(q, v) in N, the forces of the non-linear springs on the nodes (..., n)."""
        if not self.springs:
            return np.zeros(np.shape(q))
        return np.asarray(self.push(q, v) @ self.directions)

    def energy(self, q: ArrayLike, v: ArrayLike) -> Array:
        """Return the stored energy, kinetic and elastic, in J."""
        return np.asarray(self.kinetic_energy(v) + self.elastic_energy(q))


def remembered(d: Dynamics, key: Hashable, compute: Callable[[], T]) -> T:
    """Return a result that depends on a system, which does not change, and on a key alone; it is computed once."""
    if key not in d.computed:
        d.computed[key] = compute()
    found: T = d.computed[key]
    return found


def once(function: Callable[[Dynamics], T]) -> Callable[[Dynamics], T]:
    """Let a function of a system compute its result once for each system."""

    @wraps(function)
    def read(d: Dynamics) -> T:
        return remembered(d, function, partial(function, d))

    return read


def _instants(t: ArrayLike) -> Array:
    """Return times as an array, of floats if they are no formulas."""
    times = np.asarray(t)
    return times if times.dtype == object else times.astype(np.float64)


def _quadratic_form(matrix: Array, x: ArrayLike) -> Array:
    """Return xᵀ matrix x for x of shape (..., n)."""
    vectors = np.asarray(x, dtype=np.float64)
    return np.asarray(np.einsum("...i,...i->...", vectors @ matrix, vectors))
