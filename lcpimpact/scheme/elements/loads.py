r"""Loads on many nodes of one name, by their numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

import numpy as np

from lcpimpact.arguments import is_sequence
from lcpimpact.arrays import Array
from lcpimpact.errors import InputError
from lcpimpact.numbers import is_count, is_real
from lcpimpact.scheme.elements.base import (
    MISSING,
    ArrayElement,
    Element,
    Polyline,
    Values,
    described,
    named,
    one_or_each,
)
from lcpimpact.scheme.elements.load import Load
from lcpimpact.scheme.signals import Signal, TimeFunction, checked, loads_of, scaled
from lcpimpact.scheme.terms import Terms


@described
@dataclass(frozen=True)
class Loads(ArrayElement):
    r"""Loads a_i f(t) on the nodes NAME.i of a `Chain`, `Tree` or `Lattice`, whose numbers i are given.

    In a `SparseScheme` f is computed once a step for all of these nodes. The power of each is a_i f v_i.

    ::

         a_1 f(t)   a_2 f(t)   a_3 f(t)
            |          |          |
            v          v          v
            o          o          o       NAME.i

    Parameters
    ----------
    at : sequence of m ints, or of m pairs of ints
        The numbers of the nodes, from 1; pairs of row and column for a `Lattice`.
    f : float, signal or callable
        A number; a `Harmonic`, `Polynomial`, `Ramp`, `Table` or `Square`, or a sum of them; or any function of the time in
        s.
    a : float or sequence of m floats
    name : str
        The first part of the names of the nodes.
    symbols : tuple of str
        How drawings call the forces.

    Raises
    ------
    InputError
        If a number is no whole number above zero or is given twice, f is missing, or the factors are not finite or of
        another length.

    Examples
    --------
    >>> from lcpimpact import Harmonic
    >>> wave = Loads([1, 2, 4], f=Harmonic(amplitude=1.0, omega=30.0), a=[0.5, 1.0, 2.0], name="bead")
    >>> [(load.node, load.f.amplitude) for load in wave.parts()]
    [('bead.1', 0.5), ('bead.2', 1.0), ('bead.4', 2.0)]
    """

    at: Sequence[int | Sequence[int]]
    f: float | Signal | TimeFunction = MISSING
    a: Annotated[Values, "N, factors of f, which is a pure number"] = 1.0
    name: str = "x"
    symbols: tuple[str, ...] = ("f",)

    strokes: ClassVar[tuple[Polyline, ...]] = ()

    def __post_init__(self) -> None:
        named(self)
        given: Any = self.at.tolist() if isinstance(self.at, np.ndarray) else self.at
        if not is_sequence(given) or not len(given):
            raise InputError(f"{self}: at = {self.at!r} must be a sequence of numbers of nodes, or of pairs of them")
        at = tuple(tuple(each) if is_sequence(each) else (each,) for each in given)
        if len({len(each) for each in at}) > 1 or not all(is_count(i) and i > 0 for each in at for i in each):
            raise InputError(f"{self}: at must hold whole numbers above zero, or pairs of row and column")
        if len(set(at)) < len(at):
            raise InputError(f"{self}: a node is listed twice in at; add its factors, or take another Loads")
        numbers = tuple(tuple(map(int, each)) for each in at)
        object.__setattr__(self, "at", numbers if len(at[0]) > 1 else tuple(i for (i,) in numbers))
        if self.f is MISSING or not (callable(self.f) or is_real(self.f)):
            raise InputError(f"{self}: f = {self.f!r} must be a finite number or a function of time")
        object.__setattr__(self, "a", one_or_each(f"{self}: a", self.a, len(at)))
        if callable(self.f) and Load(self.nodes[0], self.f).follows_motion:
            raise InputError(f"{self}: f must be a function of the time alone; take a Load for each node")

    def __str__(self) -> str:
        return f"Loads on {self.name!r}"

    @property
    def nodes(self) -> tuple[str, ...]:
        """The nodes that the forces act on."""
        pairs: Any = self.at
        return tuple(f"{self.name}.{'.'.join(map(str, i)) if isinstance(i, tuple) else i}" for i in pairs)

    @property
    def inner(self) -> tuple[str, ...]:
        """None."""
        return ()

    @property
    def factors(self) -> Array:
        """The factors of f (m,)."""
        return np.full(len(self.at), self.a, dtype=np.float64)

    def parts(self) -> tuple[Element, ...]:
        """Return the loads."""
        each = zip(self.nodes, self.factors.tolist(), strict=True)
        return tuple(Load(node, scaled(self.f, a), symbols=self.symbols) for node, a in each)

    def contribute_arrays(self, terms: Terms) -> None:
        """Add the forces to the loads, with one signal for all."""
        for each in loads_of(self.f):
            load = checked(f"{self}: f", each, "") if callable(each) else each
            terms.load_arrays.append((terms.places(self.nodes), self.factors, load))
