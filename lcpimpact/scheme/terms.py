"""The terms of M, C, K, f and H that elements contribute."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import numpy as np

from lcpimpact.arrays import Array
from lcpimpact.scheme.force_law import ForceLaw
from lcpimpact.scheme.laws import CONTACT, Bounded, RowLaw
from lcpimpact.scheme.signals import Signal

GROUND = "ground"
"""The name of the node that does not move."""

End = str | Mapping[str, float]
"""An end of a contact: a node, or a point that moves by a sum of coordinates, as {"x": 1.0, "φ": -0.1}."""


def nodes_of(end: End) -> tuple[str, ...]:
    """Return the nodes of an end."""
    return tuple(end) if isinstance(end, Mapping) else (end,)


def name_of(end: End) -> str:
    """Return a node's name, or a sum in words.

    Examples
    --------
    >>> name_of({"x": 1.0, "φ": -0.1})
    'x - 0.1 φ'
    """
    if not isinstance(end, Mapping):
        return end
    terms = [f"{'-' if c < 0.0 else '+'} {'' if abs(c) == 1.0 else f'{abs(c):g} '}{node}" for node, c in end.items()]
    text = " ".join(terms).removeprefix("+ ")
    return f"-{text[2:]}" if text.startswith("- ") else text


class NodeKind(IntEnum):
    """Kinds of nodes: quasi-static, massless with dashpots, with mass, with prescribed motion."""

    FREE = -1
    DAMPED = 0
    MASSIVE = 1
    DRIVEN = 2


@dataclass(frozen=True)
class Row(Bounded):
    """A row of H with its law: u = q_lower - q_upper + gap, r_min <= r <= r_max, and r pushes the two nodes apart.

    Attributes
    ----------
    element : str           the element, for messages
    name : str              the name of the reaction
    upper, lower : End      the nodes, or sums of coordinates
    gap : float             u in m at zero coordinates
    e : float or None       coefficient of restitution, where one is given
    law : RowLaw
    bounds : (float, float) r_min and r_max in N
    mu, mu_s : float        kinetic and static coefficient of friction
    normal : str            name of the row whose reaction bounds the friction
    """

    element: str
    name: str
    upper: End
    lower: End
    gap: float
    e: float | None = None
    law: RowLaw = CONTACT
    bounds: tuple[float, float] = (0.0, math.inf)
    mu: float = 0.0
    mu_s: float = 0.0
    normal: str = ""


@dataclass(frozen=True)
class PowerLaw:
    r"""A non-linear spring, or compliant contact: the force K δⁿ (1 + b δ') + c δ' for δ > 0, which pushes two nodes apart.

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
    name : str              the name of the force
    """

    element: str
    upper: str
    lower: str
    gap: float
    K: float
    n: float
    b: float = 0.0
    c: float = 0.0
    name: str = "F"


@dataclass(eq=False)
class Sum:
    """A matrix as a sum of terms, with its rounding error.

    Springs of 1e9 and 1 N/m at one node sum to a float that has lost half the digits of the weaker one, and the rows of a
    stiffness that should cancel in a rigid motion no longer do.

    Attributes
    ----------
    value, residue : (n, n) arrays      the sum, and its rounding error
    """

    value: Array
    residue: Array

    def add(self, term: float | Array, at: Any = ...) -> None:
        """Add a term to the entries ``at``; the rounding error of a sum is itself a float (Knuth)."""
        before = np.array(self.value[at])
        total = before + term
        added = total - before
        self.residue[at] += (before - (total - added)) + (term - added)
        self.value[at] = total


class Terms:
    """The terms of M, C, K, f and H that elements have added so far: floats, or with ``kind=object`` formulas.

    Attributes
    ----------
    index : dict of str to int      position of each node in q
    M, C, K : Sum                   what has been added so far
    loads : list                    index of the node and the load
    rows : list of Row              the rows of H, in this order
    springs : list of PowerLaw      the non-linear springs
    force_laws : list of ForceLaw   the general forces
    motions : dict                  index of each node with prescribed motion, and its motion

    Examples
    --------
    >>> from lcpimpact import Spring, Terms
    >>> terms = Terms(("x", "y"))
    >>> Spring("x", "y", k=100.0).contribute(terms)
    >>> terms.K.value
    array([[ 100., -100.],
           [-100.,  100.]])
    """

    def __init__(self, nodes: Sequence[str], kind: type = float) -> None:
        shape = len(nodes), len(nodes)
        self.index = {node: i for i, node in enumerate(nodes)}
        self.M, self.C, self.K = (Sum(np.full(shape, 0.0, kind), np.full(shape, 0.0, kind)) for _ in range(3))
        self.loads: list[tuple[int, float | Callable[[float], float]]] = []
        self.rows: list[Row] = []
        self.springs: list[PowerLaw] = []
        self.force_laws: list[ForceLaw] = []
        self.motions: dict[int, Signal] = {}

    def direction(self, a: End, b: End) -> Array:
        """Return the row (n,) for which row·q = q_b - q_a; the ground does not move."""
        row = np.zeros(len(self.index))
        for end, sign in ((b, 1.0), (a, -1.0)):
            for node, coefficient in ({end: 1.0} if isinstance(end, str) else end).items():
                if node != GROUND:
                    row[self.index[node]] += sign * coefficient
        return row

    def link(self, matrix: Sum, a: str, b: str, value: float) -> None:
        """Add ``value`` times the square of (q_b - q_a) to the quadratic form of ``matrix``."""
        ends = [self.index[node] for node in (a, b) if node != GROUND]
        signs = [1.0 if i == j else -1.0 for i in ends for j in ends]
        matrix.add(value * np.array(signs), ([i for i in ends for _ in ends], ends * len(ends)))
