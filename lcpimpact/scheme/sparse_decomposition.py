r"""The kinds of coordinates of a sparse scheme, as `lcpimpact.scheme.decomposition` finds them in full matrices.

What sparse steps cannot solve is refused here by name: nodes that nothing holds, or that a mass and a motion hold both, and
impulses that pass through nodes without mass.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu

from lcpimpact.arrays import Flags, Indices, Sparse
from lcpimpact.errors import InputError, UnsupportedError
from lcpimpact.numerics.rounding import EPS
from lcpimpact.scheme.assembly import refuse_misspelt_ground

TIE_ROUNDING = 8.0 * EPS
"""Rounding error of what ties a node to the ground, and of a pivot of stiffnesses, relative to their terms."""


@dataclass(frozen=True, eq=False)
class SparseDecomposition:
    """The kinds of coordinates, and the relative degree of each contact.

    Attributes
    ----------
    massive, driven : (n,) flags        nodes with mass, and with prescribed motion; others are massless
    static : (n, k) sparse              quasi-static, C vanishes on them: each column moves a dashpot-joined group as one
    relative_degree : (nc,) array       0 if a quasi-static coordinate moves the gap, else 1 if a massless node does, else 2
    """

    massive: Flags
    driven: Flags
    static: Sparse
    relative_degree: Indices

    @property
    def massless(self) -> Flags:
        """Flags of the nodes with neither mass nor a prescribed motion (n,)."""
        return ~(self.massive | self.driven)


def loose_groups(massless: Flags, *links: Sparse) -> list[Indices]:
    """Return the groups of massless nodes that links join to each other but to neither mass nor ground.

    ``links`` are sums of links, as C and K: a row sums to what ties the node to the ground. A tie counts whatever its sign.
    """
    nodes = np.flatnonzero(massless)
    blocks = [A[nodes][:, nodes].tocoo() for A in links]
    count, label = connected_components(sum(abs(block) for block in blocks), directed=False)
    loose = np.ones(count, dtype=np.bool_)
    for block in blocks:
        ties = np.bincount(label[block.row], block.data, count)
        terms = np.bincount(label, np.abs(block.diagonal()), count)
        loose &= np.abs(ties) <= TIE_ROUNDING * terms
    order = np.argsort(label, kind="stable")
    groups = np.split(nodes[order], np.flatnonzero(np.diff(label[order])) + 1)
    return [group for group, is_loose in zip(groups, loose.tolist(), strict=True) if is_loose]


def decompose_sparse(
    matrices: tuple[Sparse, Sparse, Sparse], H: Sparse, driven: Flags, names: tuple[Sequence[str], Sequence[str]]
) -> SparseDecomposition:
    """Find the kinds of the coordinates, and refuse what has no solution, or none that sparse steps find.

    Parameters
    ----------
    matrices : M, C and K
    H : (nc, n) sparse
    driven : (n,) flags
        The nodes with prescribed motion.
    names : pair of sequences of str
        Those of the nodes and of the reactions.
    """
    M, C, K = matrices
    nodes, reactions = names
    heavy: Flags = M.diagonal() > 0.0
    if (heavy & driven).any():
        raise InputError(
            f"node {nodes[int(np.argmax(heavy & driven))]!r} has a mass and a prescribed motion, which the mass cannot "
            "change: leave out the Mass or the PrescribedMotion"
        )
    massless = ~(heavy | driven)
    degree = np.full(len(reactions), 2, dtype=np.int64)
    static = sparse.csr_array((len(nodes), 0))
    if massless.any():
        refuse_misspelt_ground(nodes, massless)
        for group in loose_groups(massless, C, K):
            held = ", ".join(repr(nodes[i]) for i in group[:5].tolist())
            raise InputError(
                f"nothing holds node {held}: join it to the ground or to a mass by a Spring or a Dashpot, or give it a Mass "
                "(a Bumper alone leaves it undetermined)"
            )
        groups = loose_groups(massless, C)
        rows = np.concatenate([np.zeros(0, dtype=np.int64), *groups])
        columns = np.repeat(np.arange(len(groups)), [len(group) for group in groups])
        static = sparse.csr_array((np.ones(len(rows)), (rows, columns)), shape=(len(nodes), len(groups)))
        damped = massless.copy()
        damped[[group[0] for group in groups]] = False
        degree[_touches(H @ sparse.diags_array(damped.astype(float)).tocsr())] = 1
        degree[_touches(H @ static)] = 0
        _refuse_levers(H, massless, names)
        _refuse_impulse_paths(H, massless, names)
        _refuse_falling_nodes(K, static, nodes)
    fixed = _touches(H) & ~_touches(H @ sparse.diags_array((~driven).astype(float)).tocsr())
    if fixed.any():
        raise UnsupportedError(
            f"both sides of the bumper {reactions[int(np.argmax(fixed))]!r} have a prescribed motion or none, so that its "
            "reaction changes nothing: leave it out"
        )
    return SparseDecomposition(heavy & ~driven, driven, static, degree)


def _touches(H: Sparse) -> Flags:
    """Return the flags of the rows with an entry that is not zero."""
    return np.asarray(abs(H).sum(axis=1)).ravel() > 0.0


def _refuse_levers(H: Sparse, massless: Flags, names: tuple[Sequence[str], Sequence[str]]) -> None:
    """Refuse levers at massless nodes, whose balances are sums of forces with whole numbers."""
    entries = H.tocoo()
    levers = massless[entries.col] & (np.abs(entries.data) != 1.0) & (entries.data != 0.0)
    if levers.any():
        k = int(np.argmax(levers))
        node = names[0][int(entries.col[k])]
        reaction = names[1][int(entries.row[k])]
        raise InputError(
            f"bumper {reaction!r}: {node!r} has the coefficient {abs(entries.data[k]):g} and no mass, so that its forces "
            "balance by levers: give it a Mass, or the coefficient 1"
        )


def _refuse_impulse_paths(H: Sparse, massless: Flags, names: tuple[Sequence[str], Sequence[str]]) -> None:
    """Refuse contacts through which impulses can pass from mass to mass over nodes without mass.

    The impulses on a massless node must balance. So where all of them act in one direction they are zero, and those
    contacts are none of a path; what remains, once these are taken away again and again, may be one.
    """
    entries = H[:, np.flatnonzero(massless)].tocoo()
    row = entries.row
    column = entries.col
    up = entries.data > 0.0
    count = entries.shape[1]
    while len(row):
        both = (np.bincount(column[up], minlength=count) > 0) & (np.bincount(column[~up], minlength=count) > 0)
        gone = np.zeros(H.shape[0], dtype=np.bool_)
        gone[row[~both[column]]] = True
        keep = ~gone[row]
        if keep.all():
            node = names[0][int(np.flatnonzero(massless)[column[0]])]
            found = ", ".join(repr(names[1][i]) for i in row[column == column[0]][:3].tolist())
            raise UnsupportedError(
                f"once the bumpers {found} are closed, impulses pass through {node!r}, which has no mass, and sparse steps "
                "take no impulses there: give it a Mass, or take Scheme in place of SparseScheme"
            )
        row = row[keep]
        column = column[keep]
        up = up[keep]


def _refuse_falling_nodes(K: Sparse, static: Sparse, nodes: Sequence[str]) -> None:
    """Refuse quasi-static nodes with a stiffness that is not positive: no equilibrium is stable."""
    if static.shape[1] == 0:
        return
    stiffness = (static.T @ K @ static).tocsc()
    pivots, scaled = np.asarray(stiffness.diagonal()), None
    if (pivots > 0.0).all() and (stiffness - sparse.diags_array(pivots)).count_nonzero():
        unit = sparse.diags_array(1.0 / np.sqrt(pivots))
        scaled = (unit @ stiffness @ unit).tocsc()
        try:
            factor = splu(scaled, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
            # A row that takes another's place had the pivot zero.
            pivots = np.where(factor.perm_r == factor.perm_c, factor.U.diagonal()[factor.perm_c], 0.0)
        except RuntimeError:
            pivots = np.zeros(1)
    # The diagonal in units of its own: a soft spring is no falling node.
    if (low := ~(pivots > (TIE_ROUNDING if scaled is not None else 0.0))).any():
        node = nodes[int(static.tocsc().indices[static.tocsc().indptr[int(np.argmax(low))]])]
        raise InputError(
            f"node {node!r} has neither mass nor dashpot, and the NegativeSpring at it outweighs the springs that hold it: "
            "give it a Mass, or a stiffer Spring"
        )
