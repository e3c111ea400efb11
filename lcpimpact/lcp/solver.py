"""The interface of LCP solvers, and their declared properties."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any, NamedTuple, TypeAlias

from lcpimpact.arrays import Array
from lcpimpact.compiled import COMPILING, F, interpreted
from lcpimpact.errors import UnsupportedError
from lcpimpact.lcp.operators import Delassus, Dense, Factored, Property

Kernel: TypeAlias = Callable[[Any, Array, Array, Array, Array, float, int], tuple[int, int]]
"""kernel(W, q, lower, upper, z, tol, max_iter) -> (status, iterations).

W is M in one of the solver's storages; z (n,) holds a guess on entry and the answer on return, or with the status RAY the
direction that proves that there is none.
"""


class SolverState(NamedTuple):
    """A solver prepared for one matrix, as `LCPSolver.init` returns it.

    Attributes
    ----------
    W : array or Factored       what the kernel reads
    kernel : Kernel             may be called for many q, and for other matrices of the same storage
    compiled : bool             whether the kernel can be called from compiled code
    name : str                  the method that the kernel is
    fallbacks : tuple of str    methods to try in turn if its answer does not hold, by a solver that chooses
    """

    W: Any
    kernel: Kernel
    compiled: bool
    name: str
    fallbacks: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class LCPSolver(ABC):
    """An LCP solver: its name, requirements and accuracy.

    To write a new solver: put its method in a file of its own as one compiled kernel, declare it as a `CompiledSolver`,
    and add a line to the registry.

    Attributes
    ----------
    name : str                      the registry name
    summary : str                   one line for tables
    requires : tuple of Property    properties of M that it relies on
    storages : tuple of str         forms of M that it reads: "dense", "banded", "factored"; others are made dense
    boxed : bool                    whether it takes bounds other than lower = 0, upper = inf
    tol : float                     the relative residual that it reaches, its default tolerance
    max_iter : int                  default limit of pivots, sweeps or backend iterations
    source : str                    where the method is from
    largest : int, optional         largest n that it takes
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
        """Do once what depends on M alone: choose its storage, scale it, factor it."""

    def check(self, M: Delassus, boxed: bool = False) -> None:
        """Refuse a problem that lacks a property the solver relies on.

        Raises
        ------
        UnsupportedError
            Naming the property and a solver that does without it.
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
    """A solver whose kernel is compiled and needs nothing but M, q and the bounds."""

    kernel: Kernel

    def init(self, M: Delassus) -> SolverState:
        """Return the kernel, run by the interpreter with the operator's own products where M is by its factors."""
        if M.storage == "factored" and M.storage in self.storages:
            return SolverState(M, matrix_free(self.kernel), False, self.name)
        W = M.W if M.storage in self.storages else Dense(M.array()).W
        return SolverState(W, self.kernel, COMPILING, self.name)


@cache
def matrix_free(function: F) -> F:
    """Return a kernel or judge that asks the operator for its products, columns and size, where it asked an array."""
    asked: dict[str, Any] = {
        "product": Factored.product,
        "transposed_product": Factored.product,
        "absolute_product": Factored.absolute_product,
        "absolute_transposed_product": Factored.absolute_product,
        "spread": Factored.spread,
        "weight": Factored.weight,
        "column": Factored.column,
        "diagonal": Factored.diagonal,
    }
    return interpreted(function, **asked)
