"""Schemes of many nodes: the equations of motion in sparse matrices, assembled without a dense one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy import sparse

from lcpimpact.arrays import Array, Flags, Indices, Sparse
from lcpimpact.errors import InputError, UnsupportedError
from lcpimpact.scheme.dynamics import Dynamics
from lcpimpact.scheme.elements.base import ArrayElement, Element
from lcpimpact.scheme.scheme import Scheme
from lcpimpact.scheme.signals import PiecewisePolynomial, Signal, Signals, places_and_rates
from lcpimpact.scheme.sparse_decomposition import SparseDecomposition, decompose_sparse
from lcpimpact.scheme.sparse_terms import SparseTerms
from lcpimpact.scheme.terms import GROUND

TAKE_SCHEME = "take Scheme in place of SparseScheme"


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
    kinds : SparseDecomposition     nodes with and without mass, and the relative degrees
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
    kinds: SparseDecomposition

    @cached_property
    def B(self) -> Sparse:
        """The matrix Hᵀ by which the reactions act."""
        return self.H.T.tocsr()

    def __getattr__(self, name: str) -> Any:
        """Refuse attributes that only the dynamics of a `Scheme` have."""
        if name in DENSE:
            raise UnsupportedError(f"a SparseScheme has no {name!r} in its dynamics: {TAKE_SCHEME}")
        raise AttributeError(name)

    @property
    def driven(self) -> Flags:
        """Flags of the nodes with a prescribed motion (n,)."""
        return self.kinds.driven

    @property
    def massive(self) -> Flags:
        """Flags of the nodes that move by a mass of their own (n,)."""
        return self.kinds.massive

    @property
    def relative_degree(self) -> Indices:
        """Relative degree of each contact (nc,)."""
        return self.kinds.relative_degree

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


class SparseScheme(Scheme):
    """A scheme of up to millions of nodes, assembled into sparse matrices.

    It takes masses, linear springs and dashpots, loads that are constant or signals, prescribed motions, and bumpers, in any
    number of `Chain`, `Lattice`, `Tree`, `Bar`, `Mass`, ...; and nodes without mass through which no impulse passes.
    `simulate` runs it by moreau-jean, with the result of the same `Scheme`, and records the nodes and reactions that
    ``record=`` names.

    Parameters
    ----------
    *elements : Element
        The elements; more can be added by `add`.

    Examples
    --------
    A column of a thousand beads, 1 mm apart, above a floor that vibrates:

    >>> from lcpimpact import Chain, Harmonic, PrescribedMotion, Problem, SparseScheme, simulate
    >>> column = SparseScheme(
    ...     Chain(1000, m=0.1, gap=1e-3, e=0.0, f=0.981, b="floor", name="bead"),
    ...     PrescribedMotion("floor", Harmonic(amplitude=1e-4, omega=60.0, phase=-1.5707963267948966)),
    ... )
    >>> run = simulate(Problem("column", column), dt=1e-3, t_end=0.05, record=["bead.1000", "bead.R1000"])
    >>> run.success, run["bead.1000"].shape
    (True, (51,))
    """

    def assemble(self) -> SparseDynamics:  # type: ignore[override]
        """Return the equations of motion; what they cannot hold is refused by name (`InputError`, `UnsupportedError`)."""
        return assemble_sparse(self.elements)


def assemble_sparse(elements: Sequence[Element]) -> SparseDynamics:
    """Assemble elements to sparse equations of motion.

    Raises
    ------
    InputError
        If a node is held by nothing, pushed over or would jump, has a mass and a motion or two motions, names are not
        unique, bumpers act in parallel, or a coefficient of restitution is missing or meaningless.
    UnsupportedError
        If an element has another law than that of a bumper, an impulse could pass through a node without mass, or a bumper
        is between two motions.
    """
    nodes = list(dict.fromkeys(node for element in elements for node in element.nodes if node != GROUND))
    if not nodes:
        raise InputError("the scheme has no element yet: add a Chain, a Mass, ... before it is assembled")
    terms = SparseTerms(nodes)
    for element in elements:
        if isinstance(element, ArrayElement):
            element.contribute_arrays(terms)
        else:
            element.contribute(terms)
    _refuse_other_laws(terms)
    n = len(nodes)
    M = terms.M.matrix(n, n)
    C = terms.C.matrix(n, n)
    K = terms.K.matrix(n, n)
    found = list(terms.all_bumpers())
    reactions = tuple(name for names, _, _, _ in found for name in names)
    u0, e = (np.concatenate([np.zeros(0), *(each[k] for each in found)]) for k in (1, 2))
    H = sparse.vstack([sparse.csr_array((0, n)), *(each[3] for each in found)]).tocsr()
    _refuse_same_names(nodes, reactions)
    _refuse_parallel_bumpers(H, u0, reactions)
    for i, load in terms.loads:
        terms.load(i, 1.0, load)
    driven: Flags = np.isin(np.arange(n), list(terms.motions))
    kinds = decompose_sparse((M, C, K), H, driven, (nodes, reactions))
    F = terms.F.matrix(n, len(terms.signals))
    _refuse_jumps(terms.signals, F, kinds, nodes)
    restitution = _restitution(e, kinds, reactions)
    return SparseDynamics(
        tuple(nodes), M, C, K, terms.f, F, terms.signals, dict(terms.motions), H, u0, restitution, reactions, kinds
    )


def _refuse_other_laws(terms: SparseTerms) -> None:
    """Refuse elements that only dense steps can take."""
    others = [f"{row.element} (a {row.law.name})" for row in terms.rows if not row.impenetrable]
    others += [each.element for each in terms.springs] + [each.element for each in terms.force_laws]
    if others:
        raise UnsupportedError(
            f"sparse steps take masses, springs, dashpots, loads, motions and bumpers, and not {others[0]}: {TAKE_SCHEME}"
        )


def _refuse_jumps(signals: Signals, F: Sparse, kinds: SparseDecomposition, nodes: Sequence[str]) -> None:
    """Refuse loads that jump at quasi-static nodes, which would jump too."""
    jumping = np.array(
        [isinstance(each, PiecewisePolynomial) and not each.continuous for each in signals.listed], dtype=np.float64
    )
    if kinds.static.shape[1] and jumping.any():
        moved = (abs(F) @ jumping > 0.0) & (kinds.static.sum(axis=1) > 0.0)
        if moved.any():
            raise InputError(
                f"the load on {nodes[int(np.argmax(moved))]!r} jumps, and so would that node, which is quasi-static "
                "(held by springs only): give it a Mass or a Dashpot, or increase the load gradually by a Ramp or a Table"
            )


def _restitution(e: Array, kinds: SparseDecomposition, reactions: Sequence[str]) -> Array:
    """Return the coefficients of restitution, 0 where no impulse acts; those missing or meaningless are refused."""
    given, impacts = ~np.isnan(e), kinds.relative_degree == 2
    if (missing := impacts & ~given).any():
        raise InputError(
            f"bumper {reactions[int(np.argmax(missing))]!r}: both sides have mass, so impacts need a restitution "
            "coefficient; give e="
        )
    if (vain := given & ~impacts).any():
        raise InputError(
            f"bumper {reactions[int(np.argmax(vain))]!r}: e means nothing, since the contact plate is massless, on a spring "
            "or dashpot, and no impulse acts; leave e out"
        )
    return np.where(given, e, 0.0)


def _refuse_same_names(nodes: Sequence[str], reactions: Sequence[str]) -> None:
    """Refuse two series of one name: coordinates, v_NAME, reactions, t and t_R."""
    taken = {"t", "t_R", *nodes}
    velocities = {f"v_{node}" for node in nodes if node.startswith("v_") or f"v_{node}" in taken}
    twice = [name for name in ("t", "t_R") if name in set(nodes)] + sorted(velocities & taken)
    owners = taken | {node for node in reactions if node.startswith("v_") and node[2:] in taken}
    for name in reactions:
        if name in owners:
            twice.append(name)
        owners.add(name)
    if twice:
        raise InputError(f"two series have the same name {twice[0]!r}: rename one, a reaction by name=")


def _refuse_parallel_bumpers(H: Sparse, u0: Array, reactions: Sequence[str]) -> None:
    """Refuse bumpers in a loop that can all be closed at once, with undetermined reactions.

    Bumpers join nodes to trees, in which each node has its distance from the root when all bumpers are closed. One that
    joins two nodes of a tree at just their distance is parallel to the path between them. Only loops of a bumper with the
    tree are seen; a contact problem that is singular for another reason ends the run.
    """
    n = H.shape[1]
    parent, distance = list(range(n + 1)), [0.0] * (n + 1)

    def root(i: int) -> tuple[int, float]:
        """Return the root of a node and the distance from it, and hang the node there."""
        path, total = [], 0.0
        while parent[i] != i:
            path.append(i)
            i = parent[i]
        for j in reversed(path):
            total += distance[j]
            parent[j], distance[j] = i, total
        return i, total

    starts = H.indptr.tolist()
    columns = H.indices.tolist()
    values = H.data.tolist()
    for row, gap in enumerate(u0.tolist()):
        first, last = starts[row], starts[row + 1]
        signs = values[first:last]
        if sorted(signs) not in ([-1.0], [1.0], [-1.0, 1.0]):
            continue
        ends = dict(zip(signs, columns[first:last], strict=True))
        # Closed: q_lower - q_upper + gap = 0; the ground is the node n.
        upper, above = root(ends.get(-1.0, n))
        lower, below = root(ends.get(1.0, n))
        excess = above - gap - below
        if upper != lower:
            parent[lower], distance[lower] = upper, excess
        elif abs(excess) <= 1e-12 * (abs(gap) + abs(above) + abs(below)):
            raise InputError(
                f"bumper {reactions[row]!r} acts in parallel with others, so the individual reactions are undetermined "
                "(W is singular); remove one of them"
            )
