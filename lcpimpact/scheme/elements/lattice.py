r"""The lattice: masses in rows and columns, with springs, dashpots and bumpers between neighbours."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from lcpimpact.arrays import Indices
from lcpimpact.scheme.elements.base import MISSING, Values, described
from lcpimpact.scheme.elements.linked_masses import Ends, LinkedMasses


@described
@dataclass(frozen=True)
class Lattice(LinkedMasses):
    r"""Masses NAME.i.j in rows i and columns j, which move up and down: chains side by side, joined by shear springs.

    Each mass is joined to the one below by a spring, a dashpot, a bumper, or several of these, as in a `Chain`; where ``a``
    or ``b`` is given, so are the first row to it, and the last row. Neighbours of a row are joined by springs and dashpots
    on the difference of their coordinates. Constants with one value for each mass or link are listed row by row. In a
    `SparseScheme` a lattice is assembled by arrays, in a time proportional to the number of masses.
    Energy: Σ ½ m v² and Σ ½ k (q_below - q_above)², as in the rows; dashpots dissipate, and so do impacts with e < 1.

    ::

               +-----+  k_side  +-----+
               | 1.1 |--/\/\/---| 1.2 |
               +-----+  c_side  +-----+
                  =                =        each link of a column: k, c, and a bumper with gap and e
               +-----+          +-----+
               | 2.1 |--/\/\/---| 2.2 |
               +-----+          +-----+
                  =                =
                  o b              o b      coordinates positive downwards

    Parameters
    ----------
    rows, columns : int
        Numbers of the rows and columns.
    m : float or sequence of rows · columns floats
    k : float or sequence of one float for each link of a column, optional
    c : float or sequence of one float for each link of a column, optional
    gap : float or sequence of one float for each link of a column, optional
    e : float or sequence of one float for each link of a column, optional
    k_side : float or sequence of rows · (columns - 1) floats, optional
    c_side : float or sequence of rows · (columns - 1) floats, optional
    f : float or sequence of rows · columns floats, optional
    a, b : str, optional
        The node or ground above the first row, and below the last.
    name : str
        The name of the lattice: the masses are NAME.1.1, ..., and the reactions of the bumpers NAME.R1.1, ..., by the row of
        links from the top and the column.
    symbols : tuple of str
        How drawings call the masses.

    Raises
    ------
    InputError
        If rows or columns is no whole number above zero, a constant is missing, of another length, not positive or not
        finite, or e is given without a gap, or a gap without e.

    Examples
    --------
    >>> lattice = Lattice(2, 3, m=0.1, gap=0.01, e=0.0, k_side=50.0, b="ground", name="bead")
    >>> lattice.nodes
    ('bead.1.1', 'bead.1.2', 'bead.1.3', 'bead.2.1', 'bead.2.2', 'bead.2.3', 'ground')
    >>> lattice.reactions[-1], len(lattice.sides()[0])
    ('bead.R2.3', 4)
    """

    rows: int
    columns: int
    m: Annotated[Values, "kg, masses, positive"] = MISSING
    k: Annotated[Values | None, "N/m, stiffness of the links of a column, positive; None for none"] = None
    c: Annotated[Values | None, "N s/m, damping of the links of a column, positive; None for none"] = None
    gap: Annotated[Values | None, "m, openings of the bumpers at zero coordinates; None for no bumpers"] = None
    e: Annotated[Values | None, "1, coefficients of restitution in [0, 1]; needed with ``gap``, refused without"] = None
    k_side: Annotated[Values | None, "N/m, stiffness between the neighbours of a row, positive; None for none"] = None
    c_side: Annotated[Values | None, "N s/m, damping between the neighbours of a row, positive; None for none"] = None
    f: Annotated[Values | None, "N, constant loads on the masses, such as their weights"] = None
    a: str | None = None
    b: str | None = None
    name: str = "x"
    symbols: tuple[str, ...] = ("m",)

    def __post_init__(self) -> None:
        self._check_counts("rows", "columns")
        self._check_constants()

    @property
    def masses(self) -> tuple[str, ...]:
        """The nodes of the masses, row by row."""
        return tuple(f"{self.name}.{i}.{j}" for i in range(1, self.rows + 1) for j in range(1, self.columns + 1))

    @property
    def outer(self) -> tuple[str, ...]:
        """The ends b and a, where they are given."""
        return tuple(end for end in (self.b, self.a) if end is not None)

    @property
    def reactions(self) -> tuple[str, ...]:
        """The names of the reactions of the bumpers, row by row."""
        if self.gap is None:
            return ()
        rows = len(self.ends()[0]) // self.columns
        return tuple(f"{self.name}.R{i}.{j}" for i in range(1, rows + 1) for j in range(1, self.columns + 1))

    def _places(self) -> Indices:
        """Return the places of the masses in `nodes` (rows, columns)."""
        return np.arange(self.rows * self.columns).reshape(self.rows, self.columns)

    def ends(self) -> Ends:
        """Return the ends of the links of the columns, row by row."""
        masses = self._places()
        above = [np.full((1, self.columns), masses.size + len(self.outer) - 1)] if self.a is not None else []
        below = [np.full((1, self.columns), masses.size)] if self.b is not None else []
        rows = np.vstack([*above, masses, *below])
        return rows[:-1].ravel(), rows[1:].ravel()

    def sides(self) -> Ends:
        """Return the ends of the links of the rows."""
        masses = self._places()
        return masses[:, :-1].ravel(), masses[:, 1:].ravel()
