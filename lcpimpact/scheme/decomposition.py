r"""The three kinds of coordinates: with mass, with a dashpot only, and with a spring only.

A massless node moves by a first-order equation where a dashpot holds it, and has no equation of motion at all, only a
balance of forces, where nothing but springs hold it. Which is which follows from the graph of the elements: massless
nodes that dashpots join to one another, but to no mass and not to the ground, move together without resistance.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse.csgraph import connected_components

from lcpimpact.arrays import Array, Flags, Indices


@dataclass(frozen=True)
class Decomposition:
    """A basis q = E_m q_m + E_d q_d + E_s q_s of the coordinates.

    Attributes
    ----------
    massive : (n, nm) array     unit vectors of the nodes with mass
    damped : (n, nd) array      massless, and C is positive definite on them
    static : (n, ns) array      massless, and C vanishes on them: each column moves a dashpot-joined group as one
    """

    massive: Array
    damped: Array
    static: Array


def loose_groups(A: Array, massless: Flags) -> list[Indices]:
    """Return the groups of massless nodes that the links in A join to each other but to neither mass nor ground.

    Parameters
    ----------
    A : (n, n) array
        A sum of links, as C or K: positive diagonal, and a row sums to what ties the node to the ground.
    massless : (n,) array of bool
        The nodes without mass.
    """
    nodes = np.flatnonzero(massless)
    inner = A[np.ix_(nodes, nodes)]
    count, label = connected_components(inner != 0.0, directed=False)
    groups = []
    for group in range(count):
        members = np.flatnonzero(label == group)
        tie = abs(inner[np.ix_(members, members)].sum())
        if tie <= 8.0 * np.finfo(float).eps * np.trace(inner[np.ix_(members, members)]):
            groups.append(nodes[members])
    return groups


def decompose(M: Array, C: Array) -> Decomposition:
    """Split the coordinates by what holds them.

    Parameters
    ----------
    M, C : (n, n) arrays
        Mass and damping matrix of a scheme.
    """
    identity = np.eye(len(M))
    massless = np.diag(M) == 0.0
    groups = loose_groups(C, massless)
    static = np.zeros((len(M), len(groups)))
    damped = massless.copy()
    for column, group in enumerate(groups):
        static[group, column] = 1.0
        damped[group[0]] = False
    return Decomposition(identity[:, ~massless], identity[:, damped], static)


def relative_degrees(H: Array, parts: Decomposition) -> list[int]:
    """Return the relative degree of each row of H: 0 if a static coordinate moves u, else 1 if a damped one, else 2."""
    moves_static = (H @ parts.static != 0.0).any(axis=1)
    moves_damped = (H @ parts.damped != 0.0).any(axis=1)
    return [0 if s else 1 if d else 2 for s, d in zip(moves_static, moves_damped, strict=True)]
