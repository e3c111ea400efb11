"""What elements add their terms to: it knows the nodes, and no kind of element."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from lcpimpact.arrays import Array

GROUND = "ground"
"""The name of the node that does not move."""


class Terms:
    """The terms of M, C, K, f and H that elements have added so far.

    Attributes
    ----------
    index : dict of str to int      position of each node in q
    M, C, K : (n, n) arrays         what has been added so far
    loads : list                    index of the node and the load
    bumpers : list                  the rows of H, in this order
    """

    def __init__(self, nodes: Sequence[str]) -> None:
        n = len(nodes)
        self.index = {node: i for i, node in enumerate(nodes)}
        self.M, self.C, self.K = np.zeros((n, n)), np.zeros((n, n)), np.zeros((n, n))
        self.loads: list[tuple[int, float | Callable[[float], float]]] = []
        self.bumpers: list[Any] = []

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

    def add_contact(self, bumper: Any) -> None:
        """Add a unilateral row."""
        self.bumpers.append(bumper)
