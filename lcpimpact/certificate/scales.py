"""The scales of a motion, and the choice of the violation with the largest ratio to its limit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from lcpimpact.arrays import Array
from lcpimpact.scheme.dynamics import Dynamics

SCALE_FLOOR = 1e-6
"""Smallest scale of a motion, relative to the largest: at a precision of 1e-9, differences below it are rounding."""

Judgement: TypeAlias = dict[str, tuple[float, float]]
"""Violation of each law with the largest ratio to its limit, and that limit."""


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
        """Return the scales of arrays over time."""
        return cls.of_largest(d, *(np.abs(each).max(axis=0, initial=0.0) for each in (q, v, r, f)))

    @classmethod
    def of_largest(cls, d: Dynamics, q: Array, v: Array, r: Array, f: Array) -> Scales:
        """Return the scales for given largest |q|, |v|, |r| and |f|."""
        return cls(q, v, np.abs(d.H) @ q + np.abs(d.u0) + np.abs(d.D) @ r, np.abs(d.H) @ v, r, f)

    def at_least(self, d: Dynamics, h: float) -> Scales:
        """Return scales bounded below for bodies at rest: by the effect of forces in a time h and the largest speed."""
        v = self.v + SCALE_FLOOR * self.v.max(initial=0.0)
        massive = d.massive
        if massive.any():
            v[massive] += h * np.abs(np.linalg.solve(d.M[np.ix_(massive, massive)], self.forces(d)[massive]))
        if not d.stores_energy:
            # Rates of a system at rest are the rounding of terms that balance.
            v += SCALE_FLOOR * self.forces(d)
        q = self.q + SCALE_FLOOR * self.q.max(initial=0.0) + h * v
        return Scales.of_largest(d, q, v, self.r, self.f)

    def forces(self, d: Dynamics) -> Array:
        """Return the sum of the largest forces at each node in N (n,)."""
        linear = np.abs(d.K) @ self.q + np.abs(d.C) @ self.v + np.abs(d.B) @ self.r + self.f
        return np.asarray(linear + np.abs(d.spring_force(self.q, self.v)))

    def momenta(self, d: Dynamics) -> Array:
        """Return the largest momentum of each node in N s (n,)."""
        return np.asarray(np.abs(d.M) @ self.v)


def largest_violation(values: Array, allowed: Array) -> tuple[float, float]:
    """Return the violation with the largest ratio to its limit, and that limit."""
    values, allowed = np.broadcast_arrays(np.asarray(values, dtype=np.float64), allowed)
    if values.size == 0:
        return 0.0, 0.0
    ratio = np.where(values > 0.0, values / allowed, 0.0)
    at = int(np.argmax(np.where(np.isnan(values), np.inf, ratio)))
    return float(values.ravel()[at]), float(allowed.ravel()[at])


def larger_violation(one: tuple[float, float], other: tuple[float, float]) -> tuple[float, float]:
    """Return the violation with the larger ratio to its limit."""
    return largest_violation(*np.transpose([one, other]))
