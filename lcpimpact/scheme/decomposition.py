r"""The kinds of coordinates: with mass, with a dashpot only, with a spring only, and with a prescribed motion.

A massless node moves by a first-order equation where a dashpot holds it. Held by springs only it has no equation of motion
but a balance of forces: it is *quasi-static*. Which is which follows from the graph of the elements: massless
nodes that dashpots join to one another, but to no mass and not to the ground, move together without resistance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import sparse

from lcpimpact.arrays import Array, Flags, Indices, Sparse
from lcpimpact.numerics.double_double import DoubleDouble, lifted, with_slopes
from lcpimpact.numerics.elimination import solve_finely
from lcpimpact.numerics.rounding import EPS
from lcpimpact.scheme.terms import MatrixEntries, entries_of


@dataclass(frozen=True, eq=False)
class NodeKinds:
    """The kinds of nodes.

    Attributes
    ----------
    massive, driven : (n,) flags    nodes with mass, and with prescribed motion; others are massless
    groups : list of indices        quasi-static, C vanishes on them: groups of nodes that dashpots join, each moving as one
    group : (n,) array              the number of the group of each node, -1 for nodes in none
    """

    massive: Flags
    driven: Flags
    groups: list[Indices]
    group: Indices

    @property
    def massless(self) -> Flags:
        """Flags of the nodes with neither mass nor a prescribed motion (n,)."""
        return ~(self.massive | self.driven)

    @property
    def damped(self) -> Flags:
        """Flags of massless nodes on which C is positive definite: all but the first of each quasi-static group (n,)."""
        damped = self.massless
        damped[[group[0] for group in self.groups]] = False
        return damped

    @property
    def static(self) -> Sparse:
        """E_s in compressed rows (n, ns): each column moves a quasi-static group as one."""
        row = np.concatenate([np.zeros(0, dtype=np.int64), *self.groups])
        column = np.repeat(np.arange(len(self.groups)), [len(group) for group in self.groups])
        return sparse.csr_array((np.ones(len(row)), (row, column)), shape=(len(self.massive), len(self.groups)))

    def relative_degrees(self, H: MatrixEntries, count: int) -> Indices:
        """Return the degree of each row of H: 0 if a quasi-static coordinate moves u, else 1 if a damped node, else 2."""
        degree = np.full(count, 2, dtype=np.int64)
        degree[H.row[self.damped[H.column]]] = 1
        if self.groups:
            held = H.at(np.ones(count, dtype=np.bool_), self.group >= 0)
            # The two ends of a row may be in one group, whose motion leaves u as it is.
            place, of = np.unique(held.row * len(self.groups) + self.group[held.column], return_inverse=True)
            moved = np.bincount(of, held.value, len(place)) != 0.0
            degree[place[moved] // len(self.groups)] = 0
        return degree

    def basis(self) -> Decomposition:
        """Return the basis of the coordinates in full matrices."""
        identity = np.eye(len(self.massive))
        static = np.zeros((len(identity), len(self.groups)))
        for column, group in enumerate(self.groups):
            static[group, column] = 1.0
        return Decomposition(identity[:, self.massive], identity[:, self.damped], static, identity[:, self.driven])


@dataclass(frozen=True)
class Decomposition:
    """A basis q = E_m q_m + E_d q_d + E_s q_s + E_p y(t) of the coordinates.

    Attributes
    ----------
    massive : (n, nm) array     unit vectors of the nodes with mass
    damped : (n, nd) array      massless, and C is positive definite on them
    static : (n, ns) array      quasi-static, C vanishes on them: each column moves a dashpot-joined group as one
    driven : (n, np) array      unit vectors of the nodes with prescribed motion, in the order of their indices
    """

    massive: Array
    damped: Array
    static: Array
    driven: Array


def loose_groups(massless: Flags, *links: MatrixEntries, rounding: float = 8.0 * EPS) -> list[Indices]:
    """Return the groups of massless nodes that links join to each other but to neither mass nor ground.

    Parameters
    ----------
    massless : (n,) array of bool
        The massless nodes.
    *links : MatrixEntries
        Sums of links, as C and K: a row sums to what ties the node to the ground. A tie counts whatever its sign.
    rounding : float
        Rounding error of such a sum, relative to its terms.
    """
    nodes = np.flatnonzero(massless)
    if len(nodes) < 2:
        return [] if any(massless[each.row[massless[each.column]]].any() for each in links) else [nodes] * len(nodes)
    place = np.cumsum(massless) - 1
    inner = [each.at(massless, massless) for each in links]
    inner = [MatrixEntries(place[each.row], place[each.column], each.value) for each in inner]
    label = np.arange(len(nodes))
    for each in inner:
        label = joined(label, each)
    loose = np.ones(len(nodes), dtype=np.bool_)
    for each in inner:
        of = label[each.row]
        ties = np.bincount(of, each.value, len(nodes))
        diagonal = each.row == each.column
        terms = np.bincount(of[diagonal], np.abs(each.value[diagonal]), len(nodes))
        loose &= np.abs(ties) <= rounding * terms
    found = np.flatnonzero(loose[label])
    found = found[np.argsort(label[found], kind="stable")]
    return np.split(nodes[found], np.flatnonzero(np.diff(label[found])) + 1) if len(found) else []


def joined(label: Indices, links: MatrixEntries) -> Indices:
    """Return the smallest node of the component of each (n,), once links join the components of their two nodes."""
    while True:
        low = label.copy()
        np.minimum.at(low, label[links.row], label[links.column])
        while (low != (lower := low[low])).any():
            low = lower
        low = low[label]
        if (low == label).all():
            return label
        label = low


def kinds_of(M: MatrixEntries, C: MatrixEntries, driven: Flags) -> NodeKinds:
    """Return the kinds of the nodes of a scheme with given mass and damping matrices, and with nodes that are driven."""
    massive = np.zeros(len(driven), dtype=np.bool_)
    massive[M.row[(M.row == M.column) & (M.value > 0.0)]] = True
    massive &= ~driven
    groups = loose_groups(~(massive | driven), C)
    group = np.full(len(driven), -1)
    for k, members in enumerate(groups):
        group[members] = k
    return NodeKinds(massive, driven, groups, group)


def decompose(M: Array, C: Array, driven: Flags) -> Decomposition:
    """Split the coordinates into those with mass, damped, static and driven ones.

    Parameters
    ----------
    M, C : (n, n) arrays
        Mass and damping matrix of a scheme.
    driven : (n,) array of bool
        The nodes with prescribed motion.
    """
    return kinds_of(entries_of(M), entries_of(C), driven).basis()


def degrees_together(levels: Sequence[Array]) -> tuple[Array, Indices]:
    """Return independent combinations T of rows that are closed together, and the relative degree of each.

    Rows on one massless node have its coordinate in common: all combinations of their openings but one can be formed without
    it, and have a higher relative degree than any of the rows. Of a system by its matrices they are those of the rows of
    [D, C B].

    Parameters
    ----------
    levels : sequence of (nc, ...) arrays
        What combinations of degree 1 do not contain, and what those of degree 2 do not contain either: the static and the
        damped coordinates of H, whose combinations are of whole numbers, or D and C B of the rows.

    Returns
    -------
    T : (nc, nc) array
        One combination a row, those of the lowest degree first.
    degree : (nc,) array

    Examples
    --------
    A body on a damped plate on its stop: together the contacts support the body on the ground.

    >>> T, degree = degrees_together([np.zeros((2, 0)), np.array([[1.0], [-1.0]])])
    >>> T[degree == 2]
    array([[1., 1.]])
    """
    T = np.eye(len(levels[0]))
    kept = [np.zeros((0, len(T)))]
    degree = []
    for level, columns in enumerate(levels):
        moved, free = T @ columns, list(range(len(T)))
        found = []
        for j in range(moved.shape[1]):
            pivot = next((i for i in free if moved[i, j] != 0.0), None)
            if pivot is None:
                continue
            free.remove(pivot)
            found.append(pivot)
            for i in free:
                factor = moved[i, j] / moved[pivot, j]
                moved[i] -= factor * moved[pivot]
                T[i] -= factor * T[pivot]
        kept.append(T[found])
        degree += [level] * len(found)
        T = T[free]
    return np.vstack([*kept, T]), np.array(degree + [2] * len(T), dtype=np.int64)


def is_singular(G: Array) -> bool:
    """Return whether a block of G is singular to rounding; one number is left to the elimination."""
    if len(G) < 2:
        return False
    # Rows of springs and of masses have different units, which must not make them look dependent.
    rows = np.abs(G).max(axis=1, keepdims=True)
    balanced = G / np.where(rows > 0.0, rows, 1.0)
    columns = np.abs(balanced).max(axis=0)
    return not np.linalg.cond(balanced / np.where(columns > 0.0, columns, 1.0)) < 1e13


def least_squares(G: DoubleDouble, right: DoubleDouble) -> DoubleDouble:
    """Return the least solution of G X = right; of redundant rows, in floats."""
    if not is_singular(G.hi):
        return solve_finely(G, right)
    length = max(len(G.parts), len(right.parts))
    G, right = DoubleDouble(lifted(G, length)), DoubleDouble(lifted(right, length))
    inverse = np.linalg.pinv(G.hi)
    X, null = inverse @ right.hi, np.eye(len(inverse)) - inverse @ G.hi
    # G X' = right' - G' X, and X stays orthogonal to the null space.
    slopes = inverse @ (right.slopes.hi - G.slopes.hi @ X) + null @ G.slopes.hi.transpose(0, 2, 1) @ inverse.T @ X
    return with_slopes(X, slopes)
