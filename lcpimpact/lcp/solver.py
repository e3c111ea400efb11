"""What an LCP solver declares, and the small interface that it is called through."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import TypeAlias

import numpy as np

from lcpimpact.arrays import Array
from lcpimpact.compiled import interpreted
from lcpimpact.errors import UnsupportedError

Kernel: TypeAlias = Callable[[Array, Array, Array, float, int], tuple[int, int]]
"""kernel(M, q, z, tol, max_iter) -> (status, iterations); z (n,) holds a guess on entry and the answer on return."""


class Requirement(Enum):
    """A property of M that a solver relies on."""

    SYMMETRIC = "symmetric"
    PSD = "positive semidefinite"
    POSITIVE_DIAGONAL = "positive diagonal"
    AT_MOST_2 = "n <= 2"
    AT_MOST_15 = "n <= 15"

    def holds(self, M: Array) -> bool:
        """Return whether M has the property, to rounding."""
        if self is Requirement.AT_MOST_2:
            return len(M) <= 2
        if self is Requirement.AT_MOST_15:
            return len(M) <= 15
        if self is Requirement.POSITIVE_DIAGONAL:
            return bool((np.diag(M) > 0.0).all())
        scale = np.abs(M).max() or 1.0
        if self is Requirement.SYMMETRIC:
            return bool(np.abs(M - M.T).max() <= 1e-12 * scale)
        return bool(np.linalg.eigvalsh(0.5 * (M + M.T))[0] >= -1e-12 * len(M) * scale)


@dataclass(frozen=True)
class Delassus:
    """W = H A⁻¹ Hᵀ, with the A and H that it came from where they are known.

    Attributes
    ----------
    W : (nc, nc) array            the matrix of the LCP
    A : (n, n) array, optional    symmetric positive definite
    H : (nc, n) array, optional   the rows of the contacts
    """

    W: Array
    A: Array | None = None
    H: Array | None = None


@dataclass(frozen=True)
class LCPSolver(ABC):
    """A method for LCPs: what it is called, what it needs, how exact it is.

    To write a new solver: put its method in a file of its own as one compiled kernel, declare it as a `CompiledSolver`,
    and add a line to the registry.

    Attributes
    ----------
    name : str                      the registry name
    summary : str                   one line for tables
    requires : tuple                properties of M that it relies on
    tol : float                     the relative residual that it reaches, and is judged by, unless told otherwise
    max_iter : int                  default limit of pivots, sweeps or backend iterations
    source : str                    where the method is from
    """

    name: str
    summary: str
    requires: tuple[Requirement, ...]
    tol: float
    max_iter: int
    source: str

    @abstractmethod
    def prepare(self, delassus: Delassus) -> Kernel:
        """Return the kernel for a fixed matrix, which may then be called for many q."""

    @property
    @abstractmethod
    def is_compiled(self) -> bool:
        """Whether the kernel can be called from compiled code."""

    def check(self, M: Array) -> None:
        """Refuse a matrix that lacks a property the solver relies on.

        Raises
        ------
        UnsupportedError
            Naming the property and a solver that does without it.
        """
        for requirement in self.requires:
            if not requirement.holds(M):
                raise UnsupportedError(
                    f"solver {self.name!r} needs M with {requirement.value}, and this M is not so; "
                    "take solver='lemke', or 'auto' to let it be chosen"
                )


@dataclass(frozen=True)
class CompiledSolver(LCPSolver):
    """A solver whose kernel is compiled and needs nothing but M and q."""

    kernel: Kernel

    @property
    def is_compiled(self) -> bool:
        """True, unless compilation is switched off."""
        return interpreted(self.kernel) is not self.kernel

    def prepare(self, delassus: Delassus) -> Kernel:
        """Return the kernel."""
        return self.kernel
