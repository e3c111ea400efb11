r"""A part of a scheme that is given by its matrices."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from lcpimpact.arguments import is_name, is_sequence
from lcpimpact.errors import InputError
from lcpimpact.numbers import finite_array, is_real
from lcpimpact.scheme.elements.base import MISSING, Element, Polyline
from lcpimpact.scheme.signals import Signal, TimeFunction, checked
from lcpimpact.scheme.terms import Terms


@dataclass(frozen=True)
class Substructure(Element):
    r"""Coordinates with coupled inertia, damping and stiffness: M q'' + C q' + K q = f, by matrices.

    ::

        o--+-------+
           | M C K |     as many nodes as rows
        o--+-------+

    Its energy is ½ q'ᵀ M q' + ½ qᵀ K q, and it dissipates q'ᵀ C q'. For mechanisms with a mass matrix that is not diagonal,
    finite elements, and modal models. Any other element may join the same coordinates.

    Parameters
    ----------
    coordinates : sequence of n str
        The nodes.
    M : (n, n) nested sequence of float
        Mass matrix, symmetric and positive definite.
    C, K : (n, n) nested sequence of float, optional
        Damping and stiffness matrix; K is symmetric. Zero by default.
    f : sequence of n numbers, signals or functions of time, optional
        Loads. Zero by default.
    symbols : tuple of str
        Empty: drawings show no constant.

    Raises
    ------
    InputError
        If shapes do not fit, a number is not finite, M is not positive definite, M or K is not symmetric, or a name repeats.

    Examples
    --------
    Two bodies with a coupled mass matrix:

    >>> pair = Substructure(("x", "φ"), M=[[2.0, 0.5], [0.5, 1.0]], K=[[4.0, 0.0], [0.0, 1.0]])
    >>> from lcpimpact import Scheme
    >>> Scheme(pair).assemble().M
    array([[2. , 0.5],
           [0.5, 1. ]])

    References
    ----------
    Craig and Kurdila, *Fundamentals of Structural Dynamics* (2006), chapter 17.
    """

    coordinates: Sequence[str]
    M: Sequence[Sequence[float]] = MISSING
    C: Sequence[Sequence[float]] | None = None
    K: Sequence[Sequence[float]] | None = None
    f: Sequence[float | Signal | TimeFunction] | None = None
    symbols: tuple[str, ...] = ()

    strokes: ClassVar[tuple[Polyline, ...]] = (((0.0, -0.5), (1.0, -0.5), (1.0, 0.5), (0.0, 0.5), (0.0, -0.5)),)

    def __post_init__(self) -> None:
        names = self.coordinates
        if not is_sequence(names) or not len(names) or not all(map(is_name, names)) or len(set(names)) < len(names):
            raise InputError(f"Substructure: coordinates = {names!r} must be names of nodes, each one once")
        object.__setattr__(self, "coordinates", tuple(names))
        if self.M is MISSING:
            raise InputError(f"{self}: M is missing; give its mass matrix")
        for name in ("M", "C", "K"):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, self._matrix(name, getattr(self, name)))
        M = np.array(self.M)
        if not np.linalg.eigvalsh(M)[0] > 0.0:
            raise InputError(f"{self}: M must be positive definite; give each coordinate an inertia")
        if self.f is not None:
            if not is_sequence(self.f) or len(self.f) != len(names):
                raise InputError(f"{self}: f must hold {len(names)} loads, one for each coordinate")
            if not all(callable(each) or is_real(each) for each in self.f):
                raise InputError(f"{self}: f must hold finite numbers in N, signals or functions of time")
            loads = (checked(f"{self}: f[{i}]", each, "N") if callable(each) else each for i, each in enumerate(self.f))
            object.__setattr__(self, "f", tuple(loads))

    def _matrix(self, name: str, value: ArrayLike, *, symmetry_rtol: float = 1e-12) -> tuple[tuple[float, ...], ...]:
        # symmetry_rtol: asymmetry of M and K, relative to their largest entry, below which it is rounding.
        n = len(self.coordinates)
        matrix = finite_array(f"{self}: {name}", value)
        if matrix.shape != (n, n):
            raise InputError(f"{self}: {name} has the shape {matrix.shape}, and the coordinates ask for {(n, n)}")
        if name != "C":
            if np.abs(matrix - matrix.T).max() > symmetry_rtol * np.abs(matrix).max():
                raise InputError(f"{self}: {name} is not symmetric, so it stores no energy; give a symmetric matrix")
            matrix = 0.5 * (matrix + matrix.T)
        return tuple(map(tuple, matrix.tolist()))

    @property
    def nodes(self) -> tuple[str, ...]:
        """The coordinates."""
        return tuple(self.coordinates)

    @property
    def inner(self) -> tuple[str, ...]:
        """None."""
        return ()

    def contribute(self, terms: Terms) -> None:
        """Add the matrices and the loads."""
        at = [terms.index[node] for node in self.nodes]
        for whole, part in ((terms.M, self.M), (terms.C, self.C), (terms.K, self.K)):
            if part is not None:
                whole.add(np.array(part), np.ix_(at, at))
        for i, load in zip(at, self.f or (), strict=False):
            if callable(load) or load != 0.0:
                terms.loads.append((i, load))
