r"""The tree: masses, each on another one, with springs, dashpots and bumpers between."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from lcpimpact.arguments import is_sequence
from lcpimpact.arrays import Indices
from lcpimpact.errors import InputError
from lcpimpact.numbers import is_count
from lcpimpact.scheme.elements.base import MISSING, Values, described
from lcpimpact.scheme.elements.linked_masses import Ends, LinkedMasses


@described
@dataclass(frozen=True)
class Tree(LinkedMasses):
    r"""Masses NAME.1 to NAME.n, each joined to the one that it rests on by a spring, a dashpot, a bumper, or several.

    Link i is between the mass i, above, and the mass ``on[i - 1]``, below; 0 is the node ``b`` that the roots rest on, and
    where no b is given roots have no link. In a `SparseScheme` a tree is assembled by arrays, in a time proportional to n.
    Energy: Σ ½ m v² and Σ ½ k (q_below - q_above)²; dashpots dissipate, and so do impacts with e < 1.

    ::

        +---+   +---+   +---+
        | 2 |   | 3 |   | 4 |       on = (0, 1, 1, 1)
        +---+   +---+   +---+
             \    |    /            each link: k, c, and a bumper with gap and e
              +-------+
              |   1   |
              +-------+
                  |
                  o b

    Parameters
    ----------
    on : sequence of n ints
        For each mass the number of the one that it rests on, from 1, and 0 for b; no mass may be its own ancestor.
    m : float or sequence of n floats
    k : float or sequence of one float for each link, optional
    c : float or sequence of one float for each link, optional
    gap : float or sequence of one float for each link, optional
    e : float or sequence of one float for each link, optional
    f : float or sequence of n floats, optional
    b : str, optional
        The node or ground that the roots rest on.
    name : str
        The name of the tree: the masses are NAME.1, ..., and the reactions of the bumpers NAME.R1, ..., by the mass above.
    symbols : tuple of str
        How drawings call the masses.

    Raises
    ------
    InputError
        If ``on`` is no tree, a constant is missing, of another length, not positive or not finite, or e is given without a
        gap, or a gap without e.

    Examples
    --------
    Two beads on one that lies above the floor:

    >>> tree = Tree([0, 1, 1], m=0.1, gap=0.01, e=0.0, f=0.981, b="ground")
    >>> [(piece.upper, piece.lower) for piece in tree.parts() if piece.reaction]
    [('x.1', 'ground'), ('x.2', 'x.1'), ('x.3', 'x.1')]
    """

    on: Sequence[int]
    m: Annotated[Values, "kg, masses, positive"] = MISSING
    k: Annotated[Values | None, "N/m, stiffness of the links, positive; None for none"] = None
    c: Annotated[Values | None, "N s/m, damping of the links, positive; None for none"] = None
    gap: Annotated[Values | None, "m, openings of the bumpers at zero coordinates; None for no bumpers"] = None
    e: Annotated[Values | None, "1, coefficients of restitution in [0, 1]; needed with ``gap``, refused without"] = None
    f: Annotated[Values | None, "N, constant loads on the masses, such as their weights"] = None
    b: str | None = None
    name: str = "x"
    symbols: tuple[str, ...] = ("m",)

    def __post_init__(self) -> None:
        given = self.on.tolist() if isinstance(self.on, np.ndarray) else self.on
        if not is_sequence(given) or not len(given) or not all(is_count(each) or each == 0 for each in given):
            raise InputError(f"a Tree: on = {self.on!r} must be a sequence of whole numbers, one for each mass")
        object.__setattr__(self, "on", tuple(int(each) for each in given))
        if not all(0 <= each <= len(self.on) for each in self.on):
            raise InputError(f"a Tree: on must hold numbers of its {len(self.on)} masses, and 0 for b")
        self._refuse_loops()
        self._check_constants()

    def _refuse_loops(self) -> None:
        """Refuse loops: from each mass, 2, 4, 8, ... links at once must lead to a root."""
        below = np.array((0, *self.on))
        for _ in range(len(self.on).bit_length()):
            below = below[below]
        if below.any():
            raise InputError(
                f"a Tree: the links from mass {int(np.argmax(below > 0))} run into a loop; a tree has none"
            )

    @property
    def masses(self) -> tuple[str, ...]:
        """The nodes of the masses."""
        return tuple(f"{self.name}.{i}" for i in range(1, len(self.on) + 1))

    @property
    def outer(self) -> tuple[str, ...]:
        """The end b, where it is given."""
        return () if self.b is None else (self.b,)

    @property
    def reactions(self) -> tuple[str, ...]:
        """The names of the reactions of the bumpers."""
        return () if self.gap is None else tuple(f"{self.name}.R{i + 1}" for i in self._linked().tolist())

    def _linked(self) -> Indices:
        """Return the masses with a link."""
        return np.arange(len(self.on)) if self.b is not None else np.flatnonzero(self.on)

    def ends(self) -> Ends:
        """Return the ends of each link: a mass, and the node that it rests on."""
        linked, below = self._linked(), np.array(self.on)
        return linked, np.where(below == 0, len(self.on), below - 1)[linked]
