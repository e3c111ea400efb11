r"""Butcher tableau of an explicit Runge-Kutta method, with a check of the order conditions.

A method has order p when for every rooted tree τ of at most p nodes

.. math:: \sum_i b_i φ_i(τ) = \frac{1}{γ(τ)}, \qquad φ_i([τ_1 \dots τ_k]) = \prod_j \sum_l a_{il} φ_l(τ_j), \quad
          γ([τ_1 \dots τ_k]) = |τ| \prod_j γ(τ_j) .

There are 1, 2, 4, 8 and 17 of them up to the orders 1 to 5.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache, cached_property
from typing import TypeAlias

import numpy as np

from lcpimpact.arrays import Array
from lcpimpact.errors import InputError

Tree: TypeAlias = tuple["Tree", ...]
"""A rooted tree: its subtrees, in an order that makes equal trees equal."""

ORDER_CONDITION_TOL = 1e-14
"""Tolerance of the order conditions."""


@cache
def trees(nodes: int) -> tuple[Tree, ...]:
    """Return the rooted trees with a given number of nodes."""
    return tuple(_forests(nodes - 1, nodes - 1))


def _forests(nodes: int, largest: int) -> Iterator[Tree]:
    """Yield each multiset of trees with a given total number of nodes, none above ``largest``, once."""
    if nodes == 0:
        yield ()
        return
    for size in range(min(nodes, largest), 0, -1):
        for k, tree in enumerate(trees(size)):
            for rest in _forests(nodes - size, size):
                if not rest or size > _size(rest[0]) or trees(size).index(rest[0]) <= k:
                    yield (tree, *rest)


def _size(tree: Tree) -> int:
    return 1 + sum(_size(each) for each in tree)


def _density(tree: Tree) -> float:
    """Return γ."""
    return float(_size(tree) * np.prod([_density(each) for each in tree]))


@dataclass(frozen=True)
class Tableau:
    """A Butcher tableau: the coefficients a, b, c and those of an embedded method.

    Parameters
    ----------
    a : tuple of tuple
        Row i holds a_i1 ... a_i,i-1; the first is empty.
    b : tuple
        Weights of the stages.
    c : tuple
        Instants of the stages, which are the sums of the rows of a.
    order : int
        Order p, up to 5.
    b_embedded : tuple, optional
        Weights of the embedded method, for the error estimate.
    order_embedded : int
        Its order.

    Raises
    ------
    InputError
        If the shape, the row sums or the order of the coefficients are wrong.

    Examples
    --------
    >>> Tableau(a=((), (1.0,)), b=(0.5, 0.5), c=(0.0, 1.0), order=2).stages
    2

    References
    ----------
    Hairer, Nørsett and Wanner, *Solving Ordinary Differential Equations I* (1993), section II.2.
    """

    a: tuple[tuple[float, ...], ...]
    b: tuple[float, ...]
    c: tuple[float, ...]
    order: int
    b_embedded: tuple[float, ...] | None = None
    order_embedded: int = 0

    def __post_init__(self) -> None:
        s = len(self.b)
        if [len(row) for row in self.a] != list(range(s)) or len(self.c) != s:
            raise InputError(
                f"a tableau of {s} stages has rows of 0 ... {s - 1} coefficients a, and as many instants c"
            )
        for i, (row, c) in enumerate(zip(self.a, self.c, strict=True)):
            if abs(sum(row) - c) > ORDER_CONDITION_TOL:
                raise InputError(f"row {i + 1} of a sums to {sum(row):.15g} and not to c = {c:.15g}")
        self._check("b", self.b, self.order)
        if self.b_embedded is not None:
            self._check("b_embedded", self.b_embedded, self.order_embedded)

    def amplification(self, z: Array) -> Array:
        """Return the stability function R(z) = 1 + z Σ b_i k_i, with k_i = 1 + z Σ a_ij k_j, with the shape of z."""
        k: list[Array] = []
        for row in self.a:
            k.append(np.asarray(1.0 + z * sum(a * each for a, each in zip(row, k, strict=True))))
        return np.asarray(1.0 + z * sum(b * each for b, each in zip(self.b, k, strict=True)))

    def _check(self, name: str, b: tuple[float, ...], order: int) -> None:
        """Refuse weights without the claimed order."""
        if len(b) != self.stages or not 1 <= order <= 5:
            raise InputError(
                f"{name} must hold a weight for each of {self.stages} stages, and have an order from 1 to 5"
            )
        for nodes in range(1, order + 1):
            for tree in trees(nodes):
                found = float(np.dot(b, self._weight(tree)))
                wanted = 1.0 / _density(tree)
                if abs(found - wanted) > ORDER_CONDITION_TOL * self.stages:
                    raise InputError(
                        f"{name} is not of order {order}: a condition of order {nodes} asks for {wanted:.15g}, and the "
                        f"coefficients give {found:.15g}"
                    )

    def _weight(self, tree: Tree) -> Array:
        """Return φ (s,)."""
        φ = np.ones(self.stages)
        for each in tree:
            φ = φ * (self.matrix @ self._weight(each))
        return φ

    @property
    def stages(self) -> int:
        """Number of stages."""
        return len(self.b)

    @cached_property
    def matrix(self) -> Array:
        """The coefficients a (s, s)."""
        a = np.zeros((self.stages, self.stages))
        for i, row in enumerate(self.a):
            a[i, :i] = row
        return a

    @cached_property
    def error(self) -> Array:
        """The weights of the error estimate, b - b_embedded (s,)."""
        return np.subtract(self.b, self.b if self.b_embedded is None else self.b_embedded)

    @cached_property
    def fixed(self) -> Tableau:
        """The method without the last stages, which only the error estimate uses."""
        s = self.stages
        while self.b[s - 1] == 0.0:
            s -= 1
        return Tableau(self.a[:s], self.b[:s], self.c[:s], self.order)
