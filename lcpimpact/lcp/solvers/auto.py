"""Automatic choice of a solver by size and structure, with fallbacks."""

from __future__ import annotations

from dataclasses import dataclass

from lcpimpact.errors import UnsupportedError
from lcpimpact.lcp import SOLVERS
from lcpimpact.lcp.operators import Delassus, Property, narrow
from lcpimpact.lcp.solver import LCPSolver, SolverState
from lcpimpact.lcp.solvers.block_triangular import is_irreducible

LARGEST_TABLEAU = 3_000

SMALLEST_BAND = 16
"""Minimum order at which a dense M is examined for bands."""


def methods(M: Delassus) -> tuple[str, ...]:
    """Return the methods to try in order; those whose requirements M does not meet are skipped."""
    if M.storage == "factored":
        return "active-set", "apgd"
    if M.storage == "banded":
        # The others need memory for n² numbers.
        return ("banded", "block-pivoting", "active-set", "lemke")[: 4 if M.n <= LARGEST_TABLEAU else 2]
    if M.n <= 2:
        return "closed-form", "lemke", "enumeration"
    # M declared only semidefinite may have redundant contacts; otherwise the first factorisation detects them.
    if Property.PSD in M.tags and not M.has(Property.P):
        return "active-set", "lemke", "enumeration"
    whole = "block-pivoting", "active-set", "lemke", "enumeration"
    return whole if is_irreducible(M.W) else ("block-triangular", *whole)


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

    def init(self, M: Delassus) -> SolverState:
        """Detect bands, and prepare the first method suitable for M."""
        few = narrow(M.W) if M.storage == "dense" and M.n >= SMALLEST_BAND else None
        chosen = M if few is None else few
        first, *others = methods(chosen)
        # A prepared solver serves many q, so the first method must suit M; the last accepts any M.
        while others and not suits(first, chosen):
            first, *others = others
        state = SOLVERS[first].init(chosen)
        return SolverState(state.W, state.kernel, state.compiled, first, tuple(others))


SOLVER = Auto(
    name="auto",
    summary="by structure: closed-form, banded, block-triangular or block-pivoting, then others until an answer holds",
    requires=(),
    storages=("dense", "banded", "factored"),
    boxed=True,
    tol=1e-10,
    max_iter=10_000,
    source="-",
)
