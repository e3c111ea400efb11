"""The scales of a motion, and the choice of the violation with the largest ratio to its limit."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, TypeAlias

import numpy as np

from lcpimpact.arrays import Array, Matrix, Vector, largest
from lcpimpact.memo import once
from lcpimpact.numerics.rounding import EPS
from lcpimpact.scheme.dynamics import Dynamics
from lcpimpact.scheme.lagrangian import LagrangianDynamics
from lcpimpact.scheme.power_law import tangents

SCALE_FLOOR = 1e-6
"""Smallest scale of a motion, relative to the largest: at a precision of 1e-9, differences below it are rounding."""

Judgement: TypeAlias = dict[str, tuple[float, float]]
"""Violation of each law with the largest ratio to its limit, and that limit."""


class Sizes(NamedTuple):
    """|M|, |C|, |K| (n, n), |B| (n, nc), |H| (nc, n), |D| (nc, nc) and |u0| (nc,) of a system."""

    M: Matrix
    C: Matrix
    K: Matrix
    B: Matrix
    H: Matrix
    D: Matrix
    u0: Vector


@once
def sizes(d: Dynamics) -> Sizes:
    """Return the absolute values of the matrices of a system."""
    return Sizes(*(np.array(np.abs(each), order="C") for each in (d.M, d.C, d.K, d.B, d.H, d.D, d.u0)))


@dataclass(frozen=True, eq=False)
class Scales:
    """The largest values of a run: |q| and |v| of each node (n,), |u|, |U| and |r| of each row (nc,).

    And, of each node (n,), those of the loads |f| and of the forces |s| of non-linear springs.
    """

    dynamics: Dynamics
    q: Array
    v: Array
    u: Array
    U: Array
    r: Array
    f: Array
    s: Array

    @classmethod
    def of(cls, d: Dynamics, q: Array, v: Array, r: Array, f: Array) -> Scales:
        """Return the scales of arrays over time, with q and v at the same instants."""
        return cls.of_largest(d, largest(q), largest(v), largest(r), largest(f), largest_spring_forces(d, q, v))

    @classmethod
    def of_largest(cls, d: Dynamics, q: Array, v: Array, r: Array, f: Array, s: Array) -> Scales:
        """Return the scales for given largest |q|, |v|, |r|, |f| and |s|."""
        size = sizes(d)
        return cls(d, q, v, size.u0 + size.H @ q + size.D @ r, size.H @ v, r, f, s)

    @classmethod
    def of_moving(
        cls, d: LagrangianDynamics, motion: tuple[Array, Array, Array], r: Array, G: Array, gains: Array
    ) -> Scales:
        """Return the scales of a motion t, q, v with forces G; bodies at rest have the speeds ``gains`` (n,).

        A direction in which nothing moves but by rounding has a part of the speed that it had with the energy of all.
        """
        t, q, v = motion
        speed = largest(v) + gains
        M = d.mass(q[:1])[0]
        speed = speed + SCALE_FLOOR * np.sqrt(speed @ np.abs(M) @ speed * np.diag(np.linalg.inv(M)))
        return cls.of_largest(d.along(t, q, v), largest(q), speed, largest(r), largest(G), 0.0 * speed)

    def at_least(self, h: float) -> Scales:
        """Return scales bounded below for bodies at rest: by the effect of forces in a time h and the largest speed."""
        d = self.dynamics
        v = self.v + SCALE_FLOOR * self.v.max(initial=0.0)
        M, forces = masses(d), self.forces[d.massive]
        if len(M):
            v[d.massive] += h * np.abs(forces / M if M.ndim == 1 else np.linalg.solve(M, forces))
            # Inner nodes of elements at a body at rest move by rounding errors only: their motion gives no scale for them.
            v[~d.massive & ~d.driven] += SCALE_FLOOR * v[d.massive].max()
        if not d.stores_energy:
            # Rates of a system at rest are the rounding of terms that balance.
            v += SCALE_FLOOR * self.forces
        q = self.q + SCALE_FLOOR * self.q.max(initial=0.0) + h * v
        return Scales.of_largest(d, q, v, self.r, self.f, self.s)

    @cached_property
    def forces(self) -> Array:
        """The sum of the largest forces at each node in N (n,)."""
        size = sizes(self.dynamics)
        return np.asarray(size.K @ self.q + size.C @ self.v + size.B @ self.r + self.f + self.s)

    @cached_property
    def momenta(self) -> Array:
        """The largest momentum of each node in N s (n,)."""
        return np.asarray(sizes(self.dynamics).M @ self.v)


def largest_spring_forces(
    d: Dynamics, q: Array, v: Array, *, rate_rounding: float = 8.0 * EPS, precision: float = 1e-9
) -> Array:
    """Return the largest force of non-linear springs and dashpots on each node in N (n,), q and v (nt, n), with rounding.

    ``rate_rounding``: that of a rate, relative to the largest velocities. By it the force of a dashpot with n < 1 changes at
    rest by much more than a part of itself, and what is balanced to the ``precision`` of methods is a part of this scale.
    """
    N = np.abs(d.rate_directions)
    turned = rate_rounding * largest(v) * np.sign(d.rate_directions)
    at_rest = np.abs(np.diagonal(d.dashpot_forces(turned)))
    of_dashpots = (largest(d.dashpot_forces(v)) + at_rest / precision) @ N
    if not d.springs:
        return np.asarray(of_dashpots)
    N = np.abs(d.directions)
    error, error_rate = (SCALE_FLOOR * (N @ largest(each)) for each in (q, v))
    s, by_δ, by_rate = tangents(d.power_laws, d.approach(q), d.approach_rate(v))
    forces = np.abs(s) + np.abs(by_δ) * error + np.abs(by_rate) * error_rate
    return np.asarray(largest(forces) @ N + of_dashpots)


@once
def masses(d: Dynamics) -> Array:
    """Return the mass matrix of the nodes with mass, or its diagonal (nm,) if it has no other entries."""
    M = d.M[np.ix_(d.massive, d.massive)]
    return np.diag(M) if np.count_nonzero(M) == len(M) else M


@once
def turning_time(d: Dynamics) -> float:
    """Return the time in s for which forces act in the same direction, at the fastest node with mass; inf without one."""
    mass, damping, stiffness = (np.abs(np.diag(each)[d.massive]) for each in (d.M, d.C, d.K))
    fastest = float(np.maximum(damping / mass, np.sqrt(stiffness / mass)).max(initial=0.0))
    return 1.0 / fastest if fastest > 0.0 else np.inf


def largest_violation(values: Array, allowed: Array) -> tuple[float, float]:
    """Return the violation with the largest ratio to its limit, and that limit."""
    if values.shape != allowed.shape:
        values, allowed = np.broadcast_arrays(values, allowed)
    if not values.size:
        return 0.0, 0.0
    # No number is the worst, and no violation none, whatever is allowed.
    with np.errstate(all="ignore"):
        ratio = np.divide(values, allowed, out=np.zeros(values.shape), where=~(values <= 0.0))
    worst = int(ratio.argmax())
    return float(values.item(worst)), float(allowed.item(worst))


def larger_violation(one: tuple[float, float], other: tuple[float, float]) -> tuple[float, float]:
    """Return the violation with the larger ratio to its limit."""
    return largest_violation(*np.transpose([one, other]))
