"""What a scheme assembles to: M q'' + C q' + K q = f(t) + Hᵀ r, u = H q + u0, one law for each row of r."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from lcpimpact.arrays import Array, Flags, Indices
from lcpimpact.scheme.elements.load import Harmonic

DEGREE_REASON = {
    0: "a spring gives way under a plate that has neither mass nor dashpot, so the force is continuous",
    1: "a dashpot gives way under a plate without mass, so the force is a function that may jump, without impulse",
    2: "both sides have mass or are ground, so velocities jump and impulses act",
}


@dataclass(frozen=True)
class Contact:
    """One unilateral row: 0 <= u ⟂ r >= 0 with u = q_lower - q_upper + gap.

    Attributes
    ----------
    name : str
        The name of the reaction.
    upper, lower : str
        The nodes of the plates.
    gap : float
        Opening in m at zero coordinates.
    e : float
        Coefficient of restitution; 0 where the relative degree is below 2 and it means nothing.
    relative_degree : int
        How often u must be differentiated before r appears: 0, 1 or 2.
    """

    name: str
    upper: str
    lower: str
    gap: float
    e: float
    relative_degree: int

    @property
    def sentence(self) -> str:
        """Say what the relative degree is and why."""
        return (
            f"{self.name} between {self.upper!r} and {self.lower!r} has relative degree {self.relative_degree}: "
            f"{DEGREE_REASON[self.relative_degree]}."
        )


@dataclass(frozen=True)
class Dynamics:
    r"""The equations of motion of a scheme.

    .. math:: M \ddot q + C \dot q + K q = f(t) + H^T r, \qquad u = H q + u_0, \qquad 0 \le u \perp r \ge 0

    Attributes
    ----------
    nodes : tuple of str                the coordinates, in the order of q
    M, C, K : (n, n) arrays             mass (kg, singular where nodes are massless), damping (N s/m), stiffness (N/m)
    loads : tuple of (int, load)        index of the node and the force in N, or a function of time
    H : (nc, n) array                   row of +1 at the lower and -1 at the upper plate of each contact
    u0 : (nc,) array                    openings in m at q = 0
    contacts : tuple of Contact         name, law and relative degree of each row
    """

    nodes: tuple[str, ...]
    M: Array
    C: Array
    K: Array
    loads: tuple[tuple[int, float | Harmonic | Callable[[float], float]], ...]
    H: Array
    u0: Array
    contacts: tuple[Contact, ...]

    @property
    def massive(self) -> Flags:
        """Which nodes carry mass (n,)."""
        return np.diag(self.M) > 0.0

    @property
    def relative_degree(self) -> Indices:
        """Relative degree of each row (nc,)."""
        return np.array([contact.relative_degree for contact in self.contacts], dtype=np.int64)

    @property
    def restitution(self) -> Array:
        """Coefficient of restitution of each row (nc,)."""
        return np.array([contact.e for contact in self.contacts], dtype=np.float64)

    @property
    def constant_loads(self) -> bool:
        """Whether no load depends on time."""
        return not any(callable(load) for _, load in self.loads)

    def force(self, t: ArrayLike) -> Array:
        """Return the loads f(t) in N, with the shape of t followed by (n,)."""
        times = np.asarray(t, dtype=np.float64)
        f = np.zeros((*times.shape, len(self.nodes)))
        for i, load in self.loads:
            if callable(load):
                f[..., i] += np.array([load(float(s)) for s in times.ravel()]).reshape(times.shape)
            else:
                f[..., i] += load
        return f

    def gap(self, q: ArrayLike) -> Array:
        """Return the openings u = H q + u0 in m, for q of shape (..., n)."""
        return np.asarray(np.asarray(q) @ self.H.T + self.u0)

    def gap_rate(self, v: ArrayLike) -> Array:
        """Return the opening rates U = H v in m/s, for v of shape (..., n)."""
        return np.asarray(np.asarray(v) @ self.H.T)

    def kinetic_energy(self, v: ArrayLike) -> Array:
        """Return ½ vᵀ M v in J, for v of shape (..., n)."""
        return 0.5 * _quadratic_form(self.M, v)

    def elastic_energy(self, q: ArrayLike) -> Array:
        """Return ½ qᵀ K q in J, for q of shape (..., n)."""
        return 0.5 * _quadratic_form(self.K, q)

    def energy(self, q: ArrayLike, v: ArrayLike) -> Array:
        """Return the stored energy, kinetic and elastic, in J."""
        return np.asarray(self.kinetic_energy(v) + self.elastic_energy(q))

    def dissipated_power(self, v: ArrayLike) -> Array:
        """Return vᵀ C v >= 0, the power that the dashpots dissipate, in W."""
        return _quadratic_form(self.C, v)

    def load_power(self, t: ArrayLike, v: ArrayLike) -> Array:
        """Return f(t)·v, the power of the loads, in W."""
        return np.asarray((self.force(t) * np.asarray(v)).sum(axis=-1))


def _quadratic_form(matrix: Array, x: ArrayLike) -> Array:
    """Return xᵀ matrix x for x of shape (..., n)."""
    vectors = np.asarray(x, dtype=np.float64)
    return np.asarray(((vectors @ matrix) * vectors).sum(axis=-1))
