"""The scales of a motion, and the choice of the violation with the largest ratio to its limit."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, TypeAlias

import numpy as np
from numba import types

from lcpimpact.arrays import Array
from lcpimpact.compiled import compiled, f8, vector
from lcpimpact.scheme.dynamics import Dynamics, once

SCALE_FLOOR = 1e-6
"""Smallest scale of a motion, relative to the largest: at a precision of 1e-9, differences below it are rounding."""

Judgement: TypeAlias = dict[str, tuple[float, float]]
"""Violation of each law with the largest ratio to its limit, and that limit."""


class Sizes(NamedTuple):
    """|M|, |C|, |K| (n, n), |B| (n, nc), |H| (nc, n), |D| (nc, nc) and |u0| (nc,) of a system."""

    M: Array
    C: Array
    K: Array
    B: Array
    H: Array
    D: Array
    u0: Array


@once
def sizes(d: Dynamics) -> Sizes:
    """Return the absolute values of the matrices of a system."""
    return Sizes(*map(np.abs, (d.M, d.C, d.K, d.B, d.H, d.D, d.u0)))


@dataclass(frozen=True, eq=False)
class Scales:
    """The largest values of a run: |q| and |v| of each node (n,), |u|, |U| and |r| of each row (nc,), |f| (n,)."""

    dynamics: Dynamics
    q: Array
    v: Array
    u: Array
    U: Array
    r: Array
    f: Array

    @classmethod
    def of(cls, d: Dynamics, q: Array, v: Array, r: Array, f: Array) -> Scales:
        """Return the scales of arrays over time."""
        return cls.of_largest(d, *(np.abs(each).max(axis=0, initial=0.0) for each in (q, v, r, f)))

    @classmethod
    def of_largest(cls, d: Dynamics, q: Array, v: Array, r: Array, f: Array) -> Scales:
        """Return the scales for given largest |q|, |v|, |r| and |f|."""
        size = sizes(d)
        return cls(d, q, v, size.H @ q + size.u0 + size.D @ r, size.H @ v, r, f)

    def at_least(self, h: float) -> Scales:
        """Return scales bounded below for bodies at rest: by the effect of forces in a time h and the largest speed."""
        d, v = self.dynamics, self.v + SCALE_FLOOR * self.v.max(initial=0.0)
        M, forces = masses(d), self.forces[d.massive]
        if len(M):
            v[d.massive] += h * np.abs(forces / M if M.ndim == 1 else np.linalg.solve(M, forces))
        if not d.stores_energy:
            # Rates of a system at rest are the rounding of terms that balance.
            v += SCALE_FLOOR * self.forces
        q = self.q + SCALE_FLOOR * self.q.max(initial=0.0) + h * v
        return Scales.of_largest(d, q, v, self.r, self.f)

    @cached_property
    def forces(self) -> Array:
        """The sum of the largest forces at each node in N (n,)."""
        size, springs = sizes(self.dynamics), self.dynamics.spring_force(self.q, self.v)
        return np.asarray(size.K @ self.q + size.C @ self.v + size.B @ self.r + self.f + np.abs(springs))

    @cached_property
    def momenta(self) -> Array:
        """The largest momentum of each node in N s (n,)."""
        return np.asarray(sizes(self.dynamics).M @ self.v)


@once
def masses(d: Dynamics) -> Array:
    """Return the mass matrix of the nodes with mass, or its diagonal (nm,) if it has no other entries."""
    M = d.M[np.ix_(d.massive, d.massive)]
    return np.diag(M) if np.count_nonzero(M) == len(M) else M


def largest_violation(values: Array, allowed: Array) -> tuple[float, float]:
    """Return the violation with the largest ratio to its limit, and that limit."""
    if values.shape != allowed.shape:
        values, allowed = np.broadcast_arrays(values, allowed)
    return _largest_violation(values.flatten(), allowed.flatten())


@compiled(types.UniTuple(f8, 2)(vector, vector), allocates=False)
def _largest_violation(values: Array, allowed: Array) -> tuple[float, float]:
    """Return the violation with the largest ratio to its limit, and that limit; one that is no number is the largest."""
    at, largest = -1, -1.0
    for i in range(len(values)):
        ratio = values[i] / allowed[i] if values[i] > 0.0 else 0.0
        if values[i] != values[i]:
            ratio = np.inf
        if ratio != ratio:
            return values[i], allowed[i]
        if ratio > largest:
            at, largest = i, ratio
    return (values[at], allowed[at]) if at >= 0 else (0.0, 0.0)


def larger_violation(one: tuple[float, float], other: tuple[float, float]) -> tuple[float, float]:
    """Return the violation with the larger ratio to its limit."""
    return largest_violation(*np.transpose([one, other]))
