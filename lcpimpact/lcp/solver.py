"""The interface of LCP solvers, and their declared properties."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from lcpimpact.arrays import Matrix, Vector
from lcpimpact.compiled import COMPILING, F
from lcpimpact.errors import UnsupportedError
from lcpimpact.interpreter import interpreted
from lcpimpact.lcp.compressed import Entries, for_entries
from lcpimpact.lcp.operators import Delassus, Dense, Factored, Property

Kernel: TypeAlias = Callable[[Matrix, Vector, Vector, Vector, Vector, float, int], tuple[int, int]]
"""kernel(W, q, lower, upper, z, tol, max_iter) -> (status, iterations).

W is M in one of the solver's storages; z (n,) holds the initial guess on entry, and on return the solution or, with the
status RAY, a certificate of infeasibility.
"""


class SolverState(NamedTuple):
    """A solver prepared for one matrix, as `LCPSolver.init` returns it.

    Attributes
    ----------
    W : array, Entries or Factored      matrix argument of the kernel
    kernel : Kernel             may be called for many q, and for other matrices of the same storage
    compiled : bool             whether the kernel can be called from compiled code
    name : str                  name of the kernel's method
    fallbacks : tuple of str    methods to try in order if the kernel fails; set by automatic selection
    chosen : Delassus or None   the form of M that they take, if not that of the problem
    """

    W: Any
    kernel: Kernel
    compiled: bool
    name: str
    fallbacks: tuple[str, ...] = ()
    chosen: Delassus | None = None


@dataclass(frozen=True, kw_only=True)
class LCPSolver(ABC):
    """An LCP solver: its name, requirements and accuracy.

    To add a solver: write its method as a compiled kernel in its own file, declare it as a `CompiledSolver`, and add a
    line to the registry.

    Attributes
    ----------
    name : str                      the registry name
    summary : str                   one line for tables
    requires : tuple of Property    required properties of M
    storages : tuple of str         accepted storages of M: "dense", "banded", "sparse", "factored"; others are converted
                                    to dense
    boxed : bool                    whether bounds other than lower = 0, upper = inf are accepted
    tol : float                     default tolerance: the attainable relative residual
    max_iter : int                  default maximum number of pivots, sweeps or backend iterations
    source : str                    where the method is from: keys of the bibliography, each with the place in it, or words
    largest : int, optional         maximum n
    """

    name: str
    summary: str
    requires: tuple[Property, ...]
    storages: tuple[str, ...]
    boxed: bool
    tol: float
    max_iter: int
    source: str
    largest: int | None = None

    @abstractmethod
    def init(self, M: Delassus) -> SolverState:
        """Prepare M once: choose its storage, scale it, factor it."""

    def check(self, M: Delassus, boxed: bool = False) -> None:
        """Reject a problem that lacks a property the solver requires.

        Raises
        ------
        UnsupportedError
            Naming the property and a solver that does not require it.
        """
        needs = ""
        for each in self.requires:
            if not M.has(each):
                needs = f"M with the property {each.value!r}"
                break
        if boxed and not self.boxed:
            needs = "lower = 0 and upper = inf"
        if self.largest is not None and M.n > self.largest:
            needs = f"n <= {self.largest}"
        if needs:
            raise UnsupportedError(
                f"solver {self.name!r} needs {needs}, and this problem is not so; "
                "take solver='lemke', or 'auto' to let it be chosen"
            )


@dataclass(frozen=True, kw_only=True)
class CompiledSolver(LCPSolver):
    """A solver whose compiled kernel depends only on M, q and the bounds.

    Examples
    --------
    The closed form of a diagonal M, which is declared for n = 1:

    >>> import numpy as np
    >>> from lcpimpact import CompiledSolver, Status, solve_lcp
    >>> def divide(W, q, lower, upper, z, tol, max_iter):
    ...     z[:] = np.clip(-q / np.diag(W), lower, upper)
    ...     return int(Status.SOLVED), 1
    >>> scalar = CompiledSolver(
    ...     name="scalar", summary="one row", requires=(), storages=("dense",), boxed=True, tol=1e-14, max_iter=1,
    ...     source="division", kernel=divide, largest=1,
    ... )
    >>> solve_lcp([[2.0]], [-5.0], scalar).z
    array([2.5])
    """

    kernel: Kernel

    def init(self, M: Delassus) -> SolverState:
        """Return the kernel for the storage of M; for a factored M it runs in the interpreter with its products."""
        W = M.W if M.storage in self.storages else Dense(M.array()).W
        return SolverState(W, for_storage(self.kernel, W), COMPILING and isinstance(W, np.ndarray), self.name)


def for_storage(function: F, W: Any) -> F:
    """Return a kernel or judge that takes W."""
    if isinstance(W, np.ndarray):
        return function
    found: F = for_entries(function) if isinstance(W, Entries) else matrix_free(function)
    return found


@cache
def matrix_free(function: F) -> F:
    """Return a kernel or judge that takes products, columns and size from the operator instead of an array."""
    asked: dict[str, Any] = {
        "product": Factored.product,
        "transposed_product": Factored.product,
        "absolute_product": Factored.absolute_product,
        "absolute_transposed_product": Factored.absolute_product,
        "spread": Factored.spread,
        "weight": Factored.weight,
        "longest_row": Factored.longest_row,
        "column": Factored.column,
        "diagonal": Factored.diagonal,
    }
    return interpreted(function, **asked)
