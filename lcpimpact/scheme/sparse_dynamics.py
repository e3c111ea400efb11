"""The equations of motion of schemes of many nodes, in sparse matrices."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cached_property
from typing import NoReturn

import numpy as np
from numpy.typing import ArrayLike

from lcpimpact.arrays import Array, Flags, Indices, Sparse
from lcpimpact.errors import UnsupportedError
from lcpimpact.scheme.decomposition import NodeKinds
from lcpimpact.scheme.dynamics import Dynamics
from lcpimpact.scheme.signals import Signal, Signals, places_and_rates
from lcpimpact.scheme.structure import Contact
from lcpimpact.scheme.terms import GROUND, name_of

TAKE_SCHEME = "take Scheme(..., format='full')"


DENSE = frozenset(name for name in (*vars(Dynamics), *(each.name for each in fields(Dynamics))) if name[0] != "_")
"""Names of the attributes that the dynamics of a `Scheme` have."""


@dataclass(frozen=True, eq=False)
class SparseDynamics:
    r"""The equations of motion of masses with springs, dashpots, loads and bumpers, in sparse matrices.

    .. math:: M \ddot q + C \dot q + K q = f + F s(t) + H^T r, \qquad 0 \le u = H q + u_0 \perp r \ge 0

    with Newton's law at impacts, of contacts of relative degree 2. The rows of nodes with prescribed motion, q_i = y(t), are
    no equations of motion.

    Attributes
    ----------
    nodes : tuple of str            the coordinates, in the order of q
    M, C, K : (n, n) sparse         mass (kg), damping (N s/m), stiffness (N/m), in compressed rows
    f : (n,) array                  constant loads in N
    F : (n, ns) sparse              loads in N for a unit of each signal
    signals : Signals               the functions of time s
    motions : dict                  index of each node with prescribed motion, and its motion
    H : (nc, n) sparse              constraint matrix, in compressed rows
    u0, restitution : (nc,) arrays  gaps in m at q = 0, and coefficients of restitution, 0 where no impulse acts
    reactions : tuple of str        the names of the reactions
    kinds : NodeKinds               nodes with and without mass
    relative_degree : (nc,) array   relative degree of each contact
    """

    nodes: tuple[str, ...]
    M: Sparse
    C: Sparse
    K: Sparse
    f: Array
    F: Sparse
    signals: Signals
    motions: Mapping[int, Signal]
    H: Sparse
    u0: Array
    restitution: Array
    reactions: tuple[str, ...]
    kinds: NodeKinds
    relative_degree: Indices

    @property
    def chi(self) -> Array:
        """The opening rates at v = 0 in m/s: none (nc,)."""
        return np.zeros(len(self.u0))

    @cached_property
    def B(self) -> Sparse:
        """The matrix Hᵀ by which the reactions act."""
        return self.H.T.tocsr()

    def contact(self, i: int) -> Contact:
        """Return the row i with its law, as the dynamics of a `Scheme` have it."""
        row = self.H[[i]].tocoo()
        ends = [
            {self.nodes[j]: abs(c) for j, c in zip(row.col, row.data, strict=True) if c * sign > 0.0}
            for sign in (-1, 1)
        ]
        upper, lower = (name_of(end) if end else GROUND for end in ends)
        return Contact(
            self.reactions[i], upper, lower, float(self.u0[i]), float(self.restitution[i]), int(self.relative_degree[i])
        )

    @property
    def contacts(self) -> tuple[Contact, ...]:
        """All rows with their laws."""
        return tuple(map(self.contact, range(len(self.reactions))))

    @property
    def forces(self) -> tuple[Contact, ...]:
        """All that has a force by a name: the rows."""
        return self.contacts

    def __getattr__(self, name: str) -> NoReturn:
        """Refuse attributes that only the dynamics of a `Scheme` have."""
        if name in DENSE:
            raise UnsupportedError(
                f"this needs {name!r} of full matrices, and the scheme has sparse ones: {TAKE_SCHEME}"
            )
        raise AttributeError(name)

    @property
    def driven(self) -> Flags:
        """Flags of the nodes with a prescribed motion (n,)."""
        return self.kinds.driven

    @property
    def massive(self) -> Flags:
        """Flags of the nodes that move by a mass of their own (n,)."""
        return self.kinds.massive

    def motion(self, t: ArrayLike) -> tuple[Array, Array]:
        """Return y(t) and y'(t) of the driven nodes, in the order of their indices, with the shape of t and then (np,)."""
        return places_and_rates([self.motions[i] for i in sorted(self.motions)], np.asarray(t, dtype=np.float64))

    @cached_property
    def index(self) -> dict[str, int]:
        """The place of each node in q."""
        return {node: i for i, node in enumerate(self.nodes)}

    def gap(self, t: float, q: Array) -> Array:
        """Return u = H q + u0 in m."""
        return np.asarray(self.H @ q + self.u0)

    def energy(self, q: Array, v: Array) -> float:
        """Return ½ vᵀ M v + ½ qᵀ K q in J."""
        with np.errstate(over="ignore"):  # the certificate says so
            return float(0.5 * (v @ (self.M @ v) + q @ (self.K @ q)))
