r"""The kinds of coordinates: with mass, with a dashpot only, with a spring only, and with a prescribed motion.

A massless node moves by a first-order equation where a dashpot holds it. Held by springs only it has no equation of motion
but a balance of forces: it is *quasi-static*. Which is which follows from the graph of the elements: massless
nodes that dashpots join to one another, but to no mass and not to the ground, move together without resistance.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lcpimpact.arrays import Array, Flags, Indices


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


def loose_groups(massless: Flags, *links: Array) -> list[Indices]:
    """Return the groups of massless nodes that links join to each other but to neither mass nor ground.

    Parameters
    ----------
    massless : (n,) array of bool
        The massless nodes.
    *links : (n, n) arrays
        Sums of links, as C and K: a row sums to what ties the node to the ground. A tie counts whatever its sign.
    """
    nodes = np.flatnonzero(massless)
    if len(nodes) < 2:
        return [nodes] if len(nodes) and not any(A[nodes[0], nodes[0]] for A in links) else []
    inner = [A[nodes][:, nodes] for A in links]
    joined = sum(A != 0.0 for A in inner)
    label = np.arange(len(nodes))
    for i, j in np.argwhere(np.triu(joined, 1)):
        label[label == max(label[i], label[j])] = min(label[i], label[j])
    rounding = 8.0 * np.finfo(float).eps
    groups = []
    for group in sorted(set(label.tolist())):
        members = np.flatnonzero(label == group)
        blocks = [A[members][:, members] for A in inner]
        if all(abs(block.sum()) <= rounding * abs(np.diag(block)).sum() for block in blocks):
            groups.append(nodes[members])
    return groups


def decompose(M: Array, C: Array, driven: Flags) -> Decomposition:
    """Split the coordinates into those with mass, damped, static and driven ones.

    Parameters
    ----------
    M, C : (n, n) arrays
        Mass and damping matrix of a scheme.
    driven : (n,) array of bool
        The nodes with prescribed motion.
    """
    identity = np.eye(len(M))
    massive = (np.diag(M) > 0.0) & ~driven
    massless = ~massive & ~driven
    groups = loose_groups(massless, C)
    static = np.zeros((len(M), len(groups)))
    damped = massless.copy()
    for column, group in enumerate(groups):
        static[group, column] = 1.0
        damped[group[0]] = False
    return Decomposition(identity[:, massive], identity[:, damped], static, identity[:, driven])


def relative_degrees(H: Array, parts: Decomposition) -> list[int]:
    """Return the relative degree of each row of H: 0 if a quasi-static node moves u, else 1 if a damped one, else 2."""
    moves_static = (H @ parts.static != 0.0).any(axis=1)
    moves_damped = (H @ parts.damped != 0.0).any(axis=1)
    return [0 if s else 1 if d else 2 for s, d in zip(moves_static, moves_damped, strict=True)]


def degrees_together(H: Array, parts: Decomposition) -> tuple[Array, Indices]:
    """Return independent combinations T of rows of H that are closed together, and the relative degree of each.

    Rows on one massless node have its coordinate in common: all combinations of their openings but one can be formed without
    it, and have a higher relative degree than any of the rows.

    Parameters
    ----------
    H : (nc, n) array
        Rows of +1 at the lower and -1 at the upper plate of each contact: all their combinations here are of whole numbers.
    parts : Decomposition

    Returns
    -------
    T : (nc, nc) array
        One combination a row, those of the lowest degree first.
    degree : (nc,) array

    Examples
    --------
    A body on a damped plate on its stop: together the contacts support the body on the ground.

    >>> none = np.zeros((2, 0))
    >>> parts = Decomposition(np.array([[1.0], [0.0]]), np.array([[0.0], [1.0]]), none, none)
    >>> T, degree = degrees_together(np.array([[-1.0, 1.0], [0.0, -1.0]]), parts)
    >>> T[degree == 2]
    array([[1., 1.]])
    """
    T = np.eye(len(H))
    kept = [np.zeros((0, len(H)))]
    degree = []
    for level, basis in enumerate((parts.static, parts.damped)):
        moved, free = T @ H @ basis, list(range(len(T)))
        found: list[int] = []
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
