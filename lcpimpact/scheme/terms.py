"""What elements add their terms to: it knows the nodes, and no kind of element."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from lcpimpact.arrays import Array
from lcpimpact.scheme.signals import Signal

GROUND = "ground"
"""The name of the node that does not move."""


@dataclass(frozen=True)
class Row:
    """A row of H with its law: u = q_lower - q_upper + gap, r_min <= r <= r_max, and r pushes the two nodes apart.

    Attributes
    ----------
    element : str           the element, for messages
    name : str              the name of the reaction
    upper, lower : str      the nodes
    gap : float             u in m at zero coordinates
    e : float or None       coefficient of restitution, where one is given
    r0 : float or None      threshold in N of a slider, -r0 <= r <= r0; None for a unilateral row, r >= 0
    """

    element: str
    name: str
    upper: str
    lower: str
    gap: float
    e: float | None = None
    r0: float | None = None


@dataclass(frozen=True)
class PowerLaw:
    r"""A non-linear spring: the force K δⁿ (1 + b δ') + c δ' for δ > 0, which pushes the two nodes apart.

    δ = q_upper - q_lower - gap is the approach of the nodes; the force is zero where δ <= 0. With c > 0 it jumps where
    δ = 0, and never pulls: it is zero too where the sum is negative.

    Attributes
    ----------
    element : str           the element, for messages
    upper, lower : str      the nodes
    gap : float             opening in m at zero coordinates
    K : float               N/mⁿ
    n : float               exponent, at least 1
    b : float               s/m; 0 for a spring without this loss
    c : float               N s/m; 0 for a spring without this loss
    """

    element: str
    upper: str
    lower: str
    gap: float
    K: float
    n: float
    b: float = 0.0
    c: float = 0.0


class Terms:
    """The terms of M, C, K, f and H that elements have added so far.

    Attributes
    ----------
    index : dict of str to int      position of each node in q
    M, C, K : (n, n) arrays         what has been added so far
    loads : list                    index of the node and the load
    rows : list of Row              the rows of H, in this order
    springs : list of PowerLaw      the non-linear springs
    motions : dict                  index of each node whose motion is given, and its motion
    """

    def __init__(self, nodes: Sequence[str]) -> None:
        n = len(nodes)
        self.index = {node: i for i, node in enumerate(nodes)}
        self.M, self.C, self.K = np.zeros((n, n)), np.zeros((n, n)), np.zeros((n, n))
        self.loads: list[tuple[int, float | Callable[[float], float]]] = []
        self.rows: list[Row] = []
        self.springs: list[PowerLaw] = []
        self.motions: dict[int, Signal] = {}

    def direction(self, a: str, b: str) -> Array:
        """Return the row (n,) for which row·q = q_b - q_a; the ground does not move."""
        row = np.zeros(len(self.index))
        if b != GROUND:
            row[self.index[b]] += 1.0
        if a != GROUND:
            row[self.index[a]] -= 1.0
        return row

    def link(self, matrix: Array, a: str, b: str, value: float) -> None:
        """Add ``value`` times the square of (q_b - q_a) to the quadratic form of ``matrix``."""
        d = self.direction(a, b)
        matrix += value * np.outer(d, d)
