"""The equations of motion: M q'' + C q' + K q = f(t, q, q') + s(q, q') + Hᵀ r, u = H q + u0, with a law for each row."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TypedDict, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from lcpimpact.arrays import Array, Flags, Indices
from lcpimpact.memo import Memo, remembered
from lcpimpact.numerics.double_double import DoubleDouble, with_slopes
from lcpimpact.scheme import force_law
from lcpimpact.scheme.force_law import ForceLaw
from lcpimpact.scheme.held_force import HeldForce
from lcpimpact.scheme.impact_laws import name_of_law
from lcpimpact.scheme.signals import (
    Signal,
    breaks,
    jumps,
    limits_at,
    limits_in_steps,
    places_and_rates,
    values_at,
    values_in_steps,
)
from lcpimpact.scheme.structure import Contact, Structure
from lcpimpact.scheme.terms import End, PowerLaw, RateLaw, Row, Terms

T = TypeVar("T")


def shared(read: Callable[[Structure], T]) -> cached_property[T]:
    """Return an attribute of a system that is one of its structure."""
    return cached_property(lambda d: read(d.structure))


@dataclass(frozen=True)
class Dynamics(Memo):
    r"""The equations of motion of a scheme.

    .. math:: M \ddot q + C \dot q + K q = f(t, q, \dot q) + s(q, \dot q) + B r, \qquad u = H q + D r + u_0, \qquad
              U = H v + \chi

    with one law for each row: 0 <= u ⟂ r >= 0, or -r0 <= r <= r0 ⟂ u' for a slider, or r_min <= r <= r_max ⟂ u for a relay
    (see `lcpimpact.scheme.laws`). In a scheme B = Hᵀ and D = 0; a
    complementarity system that is given directly has both of its own. The rows of nodes with prescribed motion, q_i = y(t),
    are no equations of motion: their residual is the force that drives the node.

    What no motion changes is its `Structure`, whose attributes are attributes of the system too; the others are the *values*
    at a time, a place and a velocity, which `at` returns.

    Attributes
    ----------
    structure : Structure               nodes, rows and their laws, relative degrees, kinds of coordinates, features
    M, C, K : (n, n) arrays             mass (kg, singular where nodes are massless), damping (N s/m), stiffness (N/m)
    loads : tuple of (int, load)        index of the node and the force in N, or a function of time
    H : (nc, n) array                   for each row of the constraint +1 at its lower and -1 at its upper node
    u0 : (nc,) array                    openings in m at q = 0
    chi : (nc,) array                   χ in m/s, the opening rates at v = 0
    B : (n, nc) array                   how the reactions act
    D : (nc, nc) array                  how they act on u directly
    restitution : (nc,) array           coefficient of restitution of each row
    r_min, r_max : (nc,) arrays         bounds of the reactions in N
    mu, mu_s : (nc,) arrays             kinetic and static coefficient of friction; 0 of rows with other laws
    springs : tuple of PowerLaw         the non-linear springs, whose forces are s
    dashpots : tuple of RateLaw         the non-linear dashpots, whose forces stand beside s
    force_laws : tuple of ForceLaw      the general forces, which f holds beside the loads
    holds : tuple of HeldForce          the sampled forces, which f holds too once they are set: `with_held_forces`
    motions : dict of int to Signal     index of each node with prescribed motion, and its motion
    residues : tuple of arrays          what rounding has left out of M, C and K, (n, n) each; none where they were given
    slopes : dict of str to array       derivatives (p, ...) by p parameters of the numbers that depend on them, by name: of
                                        those above, and of F, Y, G and s of `lcpimpact.scheme.first_order.SignalStates`
    """

    structure: Structure
    M: Array
    C: Array
    K: Array
    loads: tuple[tuple[int, float | Callable[[float], float]], ...]
    H: Array
    u0: Array
    chi: Array
    B: Array
    D: Array
    restitution: Array
    r_min: Array
    r_max: Array
    mu: Array
    mu_s: Array
    springs: tuple[PowerLaw, ...] = ()
    dashpots: tuple[RateLaw, ...] = ()
    force_laws: tuple[ForceLaw, ...] = ()
    holds: tuple[HeldForce, ...] = ()
    motions: Mapping[int, Signal] = field(default_factory=dict)
    residues: tuple[Array, Array, Array] | None = None
    slopes: Mapping[str, Array] = field(default_factory=dict)

    nodes = shared(lambda s: s.nodes)
    contacts = shared(lambda s: s.contacts)
    decomposition = shared(lambda s: s.decomposition)
    stores_energy = shared(lambda s: s.stores_energy)
    impact_law = shared(lambda s: s.impact_law)
    has_other_impact_law = shared(lambda s: s.has_other_impact_law)
    features = shared(lambda s: s.features)
    driven = shared(lambda s: s.driven)
    massive = shared(lambda s: s.massive)
    of_rate = shared(lambda s: s.of_rate)
    one_sided = shared(lambda s: s.one_sided)
    impenetrable = shared(lambda s: s.impenetrable)
    bilateral = shared(lambda s: s.bilateral)
    limited = shared(lambda s: s.limited)
    tangential = shared(lambda s: s.tangential)
    switches = shared(lambda s: s.switches)
    permanent = shared(lambda s: s.permanent)
    rigid = shared(lambda s: s.rigid)
    impulsive = shared(lambda s: s.impulsive)
    normals = shared(lambda s: s.normals)
    relative_degree = shared(lambda s: s.relative_degree)
    impulse_paths = shared(lambda s: s.impulse_paths)
    impulse_lines = shared(lambda s: s.impulse_lines)
    gap_paths = shared(lambda s: s.gap_paths)

    def at(self, t: float, q: Array, v: Array) -> Dynamics:
        """Return M, C, K, f, H, u0 and χ where the system is at t: those of a linear one are everywhere the same."""
        return self

    def along(self, t: Array, q: Array, v: Array) -> Dynamics:
        """Return M, H and u0 of the scales of a motion: those of a linear system are everywhere the same."""
        return self

    @property
    def entries(self) -> tuple[Flags, Flags]:
        """Flags of the entries of H (nc, n) and M (n, n) that may differ from zero."""
        return self.H != 0.0, self.M != 0.0

    def finely(self, name: str) -> DoubleDouble:
        """Return M, C, K, H, u0 ... by name as double-doubles, with their derivatives if they depend on parameters."""
        value = DoubleDouble.of(getattr(self, name))
        if self.residues and name in "MCK":
            value = DoubleDouble(np.stack([value.hi, self.residues["MCK".index(name)]]))
        return with_slopes(value, self.slopes[name]) if name in self.slopes else value

    @property
    def forces(self) -> tuple[Contact | PowerLaw, ...]:
        """All that has a force by a name: the rows, whose reactions are unknowns, and the non-linear springs."""
        return (*self.contacts, *self.springs)

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
    def jumping(self) -> Flags:
        """Flags of the nodes with a prescribed motion that jumps, as inputs of relays may (n,)."""
        motions = self.motions.items()
        found = [i for i, each in motions if jumps(each)]
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
        return self.thresholds + self.mu * np.maximum(r[..., self.normals], 0.0)

    def holding_bounds(self, r: Array) -> Array:
        """Return the bounds in N of |r| of sliders, r0, and of friction that sticks, μ_s r_N; 0 of others (..., nc)."""
        return self.thresholds + self.mu_s * np.maximum(r[..., self.normals], 0.0)

    def interval(self, r: Array) -> tuple[Array, Array]:
        """Return the bounds in N of each reaction, those of friction by the normal forces in r (..., nc)."""
        if not self.tangential.any():
            return self.r_min, self.r_max
        bounds = self.friction_bounds(r)
        return np.where(self.tangential, -bounds, self.r_min), np.where(self.tangential, bounds, self.r_max)

    @property
    def rebounds_decay(self) -> Flags:
        """Flags of the contacts whose rebounds decay, so that their impacts may accumulate (nc,).

        By Newton's law that are those with e < 1; by another one, which makes contacts that touch rebound too, all of them
        where one has e < 1.
        """
        decay: Flags = np.asarray(self.restitution < 1.0)
        return self.rigid & decay[self.rigid].any() if self.has_other_impact_law else decay

    @property
    def law_of_impacts(self) -> str:
        """Name of the law of impact."""
        return name_of_law(self.impact_law)

    @cached_property
    def directions(self) -> Array:
        """For each non-linear spring the row d with δ = -(d·q + gap) (ns, n)."""
        return self._directions([(spring.upper, spring.lower) for spring in self.springs])

    @property
    def rate_directions(self) -> Array:
        """For each non-linear dashpot the row d with v_b - v_a = d·v (nd, n)."""
        return remembered(self, "rate directions", lambda: self._directions([(law.a, law.b) for law in self.dashpots]))

    def _directions(self, ends: Sequence[tuple[End, End]]) -> Array:
        terms = Terms(self.nodes)
        return np.array([terms.direction(a, b) for a, b in ends]).reshape(len(ends), len(self.nodes))

    @property
    def rate_laws(self) -> Array:
        """The rows of `lcpimpact.scheme.rate_law` of the non-linear dashpots (nd, nr)."""
        return remembered(self, "rate laws", self._rows_of_dashpots)

    def _rows_of_dashpots(self) -> Array:
        laws = np.zeros((len(self.dashpots), max((len(law.numbers) for law in self.dashpots), default=0)))
        massless = ~(self.massive | self.driven)
        for row, law, ends in zip(laws, self.dashpots, self.rate_directions, strict=True):
            row[: len(law.numbers)] = law.numbers
            light = massless & (ends != 0.0)
            heavy = self.massive & (ends != 0.0)
            row[5] = 0.0 if light.any() else float((ends[heavy] ** 2 / np.diag(self.M)[heavy]).sum())
            row[6] = float(np.diag(self.K)[light].max(initial=0.0))
        return laws

    @property
    def substitutes(self) -> Array:
        """A linear dashpot in N s/m for each non-linear one at a massless node, with its slope at 1 m/s; else 0 (nd,)."""
        light = (self.rate_directions[:, ~(self.massive | self.driven)] != 0.0).any(axis=1)
        return np.asarray(light * np.array([law.usual_slope for law in self.dashpots]))

    @property
    def substitute_damping(self) -> Array:
        """C with the `substitutes` of non-linear dashpots at massless nodes, on which it is regular (n, n)."""
        N = self.rate_directions
        return self.C + (N.T * self.substitutes) @ N if self.substitutes.any() else self.C

    @property
    def push_laws(self) -> Array:
        """The numbers of the springs, of the dashpots, and 0 of the general forces, in the order of `pushes`."""
        laws = self.power_laws, self.rate_laws, np.zeros((len(self.acted_on), 0))
        width = max(each.shape[1] for each in laws)
        return np.vstack([np.pad(each, [(0, 0), (0, width - each.shape[1])]) for each in laws])

    @property
    def damps(self) -> Flags:
        """Flags of the `pushes` that are dashpots (ns + nd + ng,)."""
        return np.repeat([False, True, False], [len(self.springs), len(self.dashpots), len(self.acted_on)])

    @cached_property
    def power_laws(self) -> Array:
        """The row of `lcpimpact.scheme.power_law` of each non-linear spring (ns, 9)."""
        return np.array([each.numbers for each in self.springs]).reshape(-1, 9)

    def motion(self, t: ArrayLike) -> tuple[Array, Array]:
        """Return y(t) and y'(t) of the driven nodes, in the order of their indices, with the shape of t and then (np,)."""
        times = _instants(t)
        return places_and_rates([self.motions[i] for i in sorted(self.motions)], times, np.result_type(times, self.M))

    @cached_property
    def constant_loads(self) -> bool:
        """Whether no load depends on time, and none on the motion."""
        return not self.force_laws and not self.holds and not any(callable(load) for _, load in self.loads)

    @property
    def held_at(self) -> Indices:
        """The nodes of the sampled forces, one after another (nu,)."""
        return np.array([i for held in self.holds for i in held.at], dtype=np.int64)

    def with_held_forces(self, end: float, read: Callable[[Array], tuple[Array, Array]]) -> Dynamics:
        """Return the system with its sampled forces as the loads that they were in a run up to ``end``.

        ``read(t)`` gives q and v of the run (nt, n), the right limits, at the instants t (nt,).
        """
        if not self.holds:
            return self
        set_ = (load for held in self.holds for load in held.loads(end, read))
        return replace(self, loads=(*self.loads, *set_), holds=())

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
        """Directions in which non-linear springs, then dashpots, then general forces push the nodes (ns + nd + ng, n)."""
        return np.vstack([self.directions, self.rate_directions, np.eye(len(self.nodes))[self.acted_on]])

    def applied(self, t: ArrayLike, q: ArrayLike, v: ArrayLike) -> Array:
        """Return f(t, q, v) in N (..., n): the loads and the general forces, with t (...) and q and v (..., n)."""
        return self.force(t) + self.motion_forces(t, q, v)

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

    def gap(self, t: ArrayLike, q: ArrayLike) -> Array:
        """Return the openings H q + u0 in m at t, for q of shape (..., n), without the part D r."""
        return np.asarray(q) @ self.H.T + self.u0

    def gap_rate(self, t: ArrayLike, q: ArrayLike, v: ArrayLike) -> Array:
        """Return the opening rates U = H v + χ in m/s at t and q, for v of shape (..., n)."""
        return np.asarray(v) @ self.H.T + self.chi

    def momentum(self, q: ArrayLike, v: ArrayLike) -> Array:
        """Return M v in N s at q, for v of shape (..., n)."""
        return np.asarray(v) @ self.M

    def reaction_force(self, q: ArrayLike, r: ArrayLike, t: ArrayLike = 0.0) -> Array:
        """Return B r in N at t and q, the force of the reactions on the nodes, for r of shape (..., nc)."""
        return np.asarray(r) @ self.B.T

    def kinetic_energy(self, q: ArrayLike, v: ArrayLike) -> Array:
        """Return ½ vᵀ M v in J at q, for v of shape (..., n)."""
        return 0.5 * _quadratic_form(self.M, v)

    def elastic_energy(self, q: ArrayLike) -> Array:
        """Return ½ qᵀ K q + Σ K δⁿ⁺¹/(n + 1) in J, for q of shape (..., n)."""
        linear = 0.5 * _quadratic_form(self.K, q)
        if not self.springs:
            return linear
        from lcpimpact.scheme.power_law import energies  # here, as a scheme is read, checked and drawn without it

        return np.asarray(linear + energies(self.power_laws, self.approach(q)).sum(axis=-1))

    def approach(self, q: ArrayLike) -> Array:
        """Return δ of the non-linear springs in m (..., ns), for q of shape (..., n)."""
        return -(np.asarray(q) @ self.directions.T + self.power_laws[:, 0])

    def approach_rate(self, v: ArrayLike) -> Array:
        """Return δ' of the non-linear springs in m/s (..., ns), for v of shape (..., n)."""
        return -np.asarray(v) @ self.directions.T

    def push(self, q: ArrayLike, v: ArrayLike, extended: bool = False) -> Array:
        """Return the force in N by which each non-linear spring pushes its ends apart (..., ns).

        With ``extended`` it is without regard to contact and bounds: K |δ|ⁿ sign δ (1 + b δ') + c D(|δ|) δ'.
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
        return (s - forces(self.power_laws, δ, np.zeros_like(rate))) * rate

    def spring_force(self, q: ArrayLike, v: ArrayLike) -> Array:
        """Return s(q, v) in N, the forces of the non-linear springs on the nodes (..., n)."""
        if not self.springs:
            return np.zeros(np.shape(q))
        return self.push(q, v) @ self.directions

    def dashpot_forces(self, v: ArrayLike) -> Array:
        """Return the force in N by which each non-linear dashpot pulls its ends together (..., nd), for v (..., n)."""
        rates = np.asarray(v) @ self.rate_directions.T
        if not self.dashpots:
            return rates
        from lcpimpact.scheme.rate_law import forces  # here, as it is compiled

        return forces(self.rate_laws, rates)

    def dashpot_force(self, v: ArrayLike) -> Array:
        """Return the forces in N of the non-linear dashpots on the nodes (..., n)."""
        return -self.dashpot_forces(v) @ self.rate_directions

    def energy(self, q: ArrayLike, v: ArrayLike) -> Array:
        """Return the stored energy, kinetic and elastic, in J."""
        return np.asarray(self.kinetic_energy(q, v) + self.elastic_energy(q))


class Numbers(TypedDict):
    """Numbers of the laws of rows, one of each for a row, under their names in `Dynamics`."""

    restitution: Array
    r_min: Array
    r_max: Array
    mu: Array
    mu_s: Array


def law_numbers(rows: Iterable[Contact | Row], kind: type = float) -> Numbers:
    """Return the numbers of the laws of rows, or with ``kind=object`` their formulas."""
    numbers = [(each.e or 0.0, *each.bounds, each.mu, each.mu_s) for each in rows]
    columns: Array = np.array(numbers, dtype=kind).reshape(-1, 5)
    e, r_min, r_max, mu, mu_s = columns.T.copy()
    return Numbers(restitution=e, r_min=r_min, r_max=r_max, mu=mu, mu_s=mu_s)


def _instants(t: ArrayLike) -> Array:
    """Return times as an array, of floats if they are no formulas."""
    times = np.asarray(t)
    return times if times.dtype == object else times.astype(np.float64)


def _quadratic_form(matrix: Array, x: ArrayLike) -> Array:
    """Return xᵀ matrix x for x of shape (..., n)."""
    vectors = np.asarray(x, dtype=np.float64)
    return np.asarray(np.einsum("...i,...i->...", vectors @ matrix, vectors))
