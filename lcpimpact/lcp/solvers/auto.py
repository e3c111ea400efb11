"""Automatic choice of a solver by size and structure, with fallbacks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lcpimpact.errors import UnsupportedError
from lcpimpact.lcp import SOLVERS
from lcpimpact.lcp.operators import SMALLEST_SPARSE, Delassus, Dense, Factored, Property, Sparse, narrow
from lcpimpact.lcp.solver import LCPSolver, SolverState
from lcpimpact.lcp.solvers.block_triangular import is_irreducible

LARGEST_TABLEAU = 3_000

WIDEST_FAST_FACTOR = 2_000
"""Width of the graph of a sparse M above which sweeps are tried before factors, which take half a minute."""

WIDEST_FACTOR = 4_000
"""Width of the graph of a sparse M above which factors are not tried: they would take gigabytes."""

GENERAL = "lemke", "newton-fb"
"""Methods for any dense M. The path of Lemke may end in a ray at equations of either sign, which Newton's method takes."""


def methods(M: Delassus) -> tuple[str, ...]:
    """Return the methods to try in order; those whose requirements M does not meet are skipped."""
    if isinstance(M, Factored):
        if M.n < SMALLEST_SPARSE or not M.is_sparse:
            return "active-set", "apgd"
        return ("block-pivoting", "active-set", "apgd") if M.n <= LARGEST_TABLEAU else ("block-pivoting", "apgd")
    if isinstance(M, Sparse):
        return methods_of_sparse(M)
    if M.storage == "banded":
        # Active sets and tableaus need memory for n² numbers.
        return "banded", "block-pivoting", *(("active-set", *GENERAL) if M.n <= LARGEST_TABLEAU else ("nncg",))
    if M.n <= 2:
        return "closed-form", "lemke", "enumeration"
    # M declared only semidefinite may have redundant contacts; otherwise the first factorisation detects them.
    if Property.PSD in M.tags and not M.has(Property.P):
        return "active-set", *GENERAL, "enumeration"
    whole = "block-pivoting", "active-set", *GENERAL, "enumeration"
    return whole if is_irreducible(M.W) else ("block-triangular", *whole)


def methods_of_sparse(M: Sparse) -> tuple[str, ...]:
    """Return the methods for sparse M: by sparse factors, unless they would be nearly full, else by sweeps alone."""
    few = ("active-set", *GENERAL) if M.n <= LARGEST_TABLEAU else ()
    if not M.has(Property.POSITIVE_DIAGONAL):
        return "apgd", *few
    width = widest_level(M)
    if width > WIDEST_FACTOR:
        return "nncg", *few
    return ("block-pivoting", "nncg", *few) if width <= WIDEST_FAST_FACTOR else ("nncg", "block-pivoting", *few)


def widest_level(M: Sparse) -> int:
    """Return the largest number of rows at one distance from a row at the rim of the graph of M: the size of separators.

    The graph is that of the largest component. Factors have some width² entries and take width³ operations, as for lattices
    in two and three dimensions.
    """
    from scipy.sparse.csgraph import breadth_first_order, connected_components

    _, part = connected_components(M.M, directed=False)
    start = int(np.argmax(part == np.argmax(np.bincount(part))))
    widest = 0
    for _ in range(2):
        order, before = breadth_first_order(M.M, start, directed=False)
        start = int(order[-1])
    place = np.empty(M.n, np.int64)
    place[order] = np.arange(len(order))
    parents = place[before[order[1:]]]  # ascending, and less than `end` for the next level
    begin, end = 0, 1
    while begin < end:
        widest = max(widest, end - begin)
        begin, end = end, 1 + int(np.searchsorted(parents, end))
    return widest


def suits(name: str, M: Delassus) -> bool:
    """Return whether M has all properties that a method requires."""
    try:
        SOLVERS[name].check(M)
    except UnsupportedError:
        return False
    return True


@dataclass(frozen=True, kw_only=True)
class Auto(LCPSolver):
    """Automatic choice by the properties of the matrix."""

    def init(self, M: Delassus, *, smallest_band: int = 16) -> SolverState:
        """Detect bands and factors whose product is sparse, and prepare the first method suitable for M.

        ``smallest_band``: minimum order at which a dense M is examined for bands.
        """
        chosen: Delassus = M
        if isinstance(M, Factored) and M.n >= SMALLEST_SPARSE:
            chosen = M.formed() or M
        if isinstance(M, Sparse) and M.n < SMALLEST_SPARSE:
            chosen = Dense(M.array(), [each.name.lower() for each in M.tags])
        if isinstance(chosen, Dense) and M.n >= smallest_band:
            chosen = narrow(chosen.W) or chosen
        first, *others = methods(chosen)
        # A prepared solver serves many q, so the first method must suit M; the last accepts any dense M.
        while others and not suits(first, chosen):
            first, *others = others
        if M.n > LARGEST_TABLEAU and isinstance(chosen, Sparse) and not suits(first, chosen):
            raise UnsupportedError(
                f"no solver takes a sparse M of order {M.n} without a positive diagonal that is not symmetric and positive "
                f"semidefinite either, or one that is too full to be factored and not symmetric; up to {LARGEST_TABLEAU} "
                "rows it is made dense"
            )
        state = SOLVERS[first].init(chosen)
        formed = chosen if isinstance(M, Factored) and chosen is not M else None
        return SolverState(state.W, state.kernel, state.compiled, first, tuple(others), formed)


SOLVER = Auto(
    name="auto",
    summary="by structure: closed-form, banded, block-triangular or block-pivoting, then others until an answer holds",
    requires=(),
    storages=("dense", "banded", "sparse", "factored"),
    boxed=True,
    tol=1e-10,
    max_iter=10_000,
    source="-",
)
