"""Schemes of many nodes, whose equations of motion are in sparse matrices."""

from __future__ import annotations

from typing import cast

from lcpimpact.scheme.elements.base import Element
from lcpimpact.scheme.scheme import Scheme
from lcpimpact.scheme.sparse_dynamics import SparseDynamics


class SparseScheme(Scheme):
    """A scheme of up to millions of nodes, assembled into sparse matrices.

    It takes masses, linear springs and dashpots, loads that are constant or signals, prescribed motions, and bumpers, in any
    number of `Chain`, `Lattice`, `Tree`, `Bar`, `Mass`, ...; and nodes without mass through which no impulse passes.
    `simulate` runs it by moreau-jean, with the result of the same `Scheme`, and records the nodes and reactions that
    ``record=`` names.

    Parameters
    ----------
    *elements : Element
        The elements; more can be added by `add`.

    Examples
    --------
    A column of a thousand beads, 1 mm apart, above a floor that vibrates:

    >>> from lcpimpact import Chain, Harmonic, PrescribedMotion, Problem, SparseScheme, simulate
    >>> column = SparseScheme(
    ...     Chain(1000, m=0.1, gap=1e-3, e=0.0, f=0.981, b="floor", name="bead"),
    ...     PrescribedMotion("floor", Harmonic(amplitude=1e-4, omega=60.0, phase=-1.5707963267948966)),
    ... )
    >>> run = simulate(Problem("column", column), dt=1e-3, t_end=0.05, record=["bead.1000", "bead.R1000"])
    >>> run.success, run["bead.1000"].shape
    (True, (51,))
    """

    def __init__(self, *elements: Element) -> None:
        super().__init__(*elements, format="sparse")

    def assemble(self) -> SparseDynamics:  # type: ignore[override]
        """Return the equations of motion; what they cannot hold is refused by name (`InputError`, `UnsupportedError`)."""
        return cast(SparseDynamics, super().assemble())

    def __repr__(self) -> str:
        return f"Sparse{Scheme(*self.elements)!r}"
