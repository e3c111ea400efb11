r"""The chain: a row of masses, with springs, dashpots and bumpers between neighbours."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from lcpimpact.scheme.elements.base import MISSING, Values, described
from lcpimpact.scheme.elements.linked_masses import Ends, LinkedMasses


@described
@dataclass(frozen=True)
class Chain(LinkedMasses):
    r"""A row of n masses, NAME.1 to NAME.n, each joined to the next by a spring, a dashpot, a bumper, or several of these.

    A column of beads above the floor, a Newton's cradle and a bar in finite elements are chains. Link i is between the
    masses i and i + 1; where ``a`` or ``b`` is given, the first link is between it and the first mass, and the last link
    between the last mass and it. In a `SparseScheme` a chain is assembled by arrays, in a time proportional to n.
    Energy: Σ ½ m v² and Σ ½ k (q_(i+1) - q_i)²; dashpots dissipate c (v_(i+1) - v_i)², and so do impacts with e < 1.

    ::

               +---+  gap  +---+  gap  +---+
        a o-- =| 1 |=    = | 2 |=    = | 3 |= --o b      each link: k, c, and a bumper with gap and e
               +---+       +---+       +---+
               NAME.1      NAME.2      NAME.3

    Parameters
    ----------
    n : int
        Number of masses.
    m : float or sequence of n floats
    k : float or sequence of one float for each link, optional
    c : float or sequence of one float for each link, optional
    gap : float or sequence of one float for each link, optional
    e : float or sequence of one float for each link, optional
    f : float or sequence of n floats, optional
    a, b : str, optional
        The node or ground before the first, and after the last mass.
    name : str
        The name of the chain: the masses are NAME.1, ..., and the reactions of the bumpers NAME.R1, ...
    symbols : tuple of str
        How drawings call the masses.

    Raises
    ------
    InputError
        If n is no whole number above zero, a constant is missing, of another length, not positive or not finite, or e is
        given without a gap, or a gap without e.

    Examples
    --------
    Three beads above the floor; coordinates are positive downwards:

    >>> column = Chain(3, m=0.1, gap=0.01, e=0.5, f=0.981, b="ground", name="bead")
    >>> column.nodes
    ('bead.1', 'bead.2', 'bead.3', 'ground')
    >>> [piece.name for piece in column.parts() if piece.reaction]
    ['bead.R1', 'bead.R2', 'bead.R3']
    """

    n: int
    m: Annotated[Values, "kg, masses, positive"] = MISSING
    k: Annotated[Values | None, "N/m, stiffness of the links, positive; None for none"] = None
    c: Annotated[Values | None, "N s/m, damping of the links, positive; None for none"] = None
    gap: Annotated[Values | None, "m, openings of the bumpers at zero coordinates; None for no bumpers"] = None
    e: Annotated[Values | None, "1, coefficients of restitution in [0, 1]; needed with ``gap``, refused without"] = None
    f: Annotated[Values | None, "N, constant loads on the masses, such as their weights"] = None
    a: str | None = None
    b: str | None = None
    name: str = "x"
    symbols: tuple[str, ...] = ("m",)

    def __post_init__(self) -> None:
        self._check_counts("n")
        self._check_constants()

    @property
    def masses(self) -> tuple[str, ...]:
        """The nodes of the masses."""
        return tuple(f"{self.name}.{i}" for i in range(1, self.n + 1))

    @property
    def outer(self) -> tuple[str, ...]:
        """The ends b and a, where they are given."""
        return tuple(end for end in (self.b, self.a) if end is not None)

    @property
    def nodes(self) -> tuple[str, ...]:
        """The nodes from a to b."""
        return (*(() if self.a is None else (self.a,)), *self.masses, *(() if self.b is None else (self.b,)))

    @property
    def reactions(self) -> tuple[str, ...]:
        """The names of the reactions of the bumpers."""
        return () if self.gap is None else tuple(f"{self.name}.R{i}" for i in range(1, len(self.ends()[0]) + 1))

    def ends(self) -> Ends:
        """Return the ends of the links, each a node and the next."""
        upper = np.arange(len(self.nodes) - 1)
        return upper, upper + 1
