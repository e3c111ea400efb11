r"""The chain: a row of masses, with springs, dashpots and bumpers between neighbours."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from lcpimpact.arguments import is_name
from lcpimpact.arrays import Array
from lcpimpact.errors import InputError
from lcpimpact.numbers import finite_array, is_count
from lcpimpact.scheme.elements.base import GROUND, MISSING, ArrayElement, Element, Polyline, named
from lcpimpact.scheme.elements.bumper import Bumper
from lcpimpact.scheme.elements.dashpot import Dashpot
from lcpimpact.scheme.elements.load import Load
from lcpimpact.scheme.elements.mass import Mass
from lcpimpact.scheme.elements.spring import Spring

if TYPE_CHECKING:
    from lcpimpact.scheme.sparse import SparseTerms

Values = float | tuple[float, ...]
"""One value for all, or one for each."""


@dataclass(frozen=True)
class Chain(ArrayElement):
    r"""A row of n masses NAME.1 ... NAME.n, each joined to the next by a spring, a dashpot, a bumper, or several of these.

    A column of beads above the floor, a Newton's cradle and a bar in finite elements are chains. Link i is between the
    masses i and i + 1; where ``a`` or ``b`` is given, the first link is between it and the first mass, and the last link
    between the last mass and it. In a `SparseScheme` a chain is assembled by arrays, in a time proportional to n.
    Energy: Σ ½ m v² and Σ ½ k (q_i+1 - q_i)²; dashpots dissipate c (v_i+1 - v_i)², and so do impacts with e < 1.

    ::

               +---+  gap  +---+  gap  +---+
        a o-- =| 1 |=    = | 2 |=    = | 3 |= --o b      each link: k, c, and a bumper with gap and e
               +---+       +---+       +---+
               NAME.1      NAME.2      NAME.3

    Parameters
    ----------
    n : int
        Number of masses.
    m : float or sequence of n floats
        Masses in kg, positive.
    k, c : float or sequence of one float for each link, optional
        Stiffness in N/m and damping in N s/m of the links, positive; None for none.
    gap : float or sequence of one float for each link, optional
        Openings in m of the bumpers when all coordinates are zero; None for no bumpers.
    e : float or sequence of one float for each link, optional
        Coefficients of restitution in [0, 1]; needed with ``gap``, and refused without.
    f : float or sequence of n floats, optional
        Constant loads in N on the masses, such as their weights.
    a, b : str, optional
        The node or ground before the first, and after the last mass.
    name : str
        The name of the chain: the masses are NAME.1, ..., and the reactions of the bumpers NAME.R1, ...
    symbols : tuple of str
        How drawings call the masses.

    Raises
    ------
    InputError
        If n is no whole number above zero, a constant is missing, of another length, not positive or not finite, or e is
        given without a gap, or a gap without e.

    Examples
    --------
    Three beads above the floor; coordinates are positive downwards:

    >>> column = Chain(3, m=0.1, gap=0.01, e=0.5, f=0.981, b="ground", name="bead")
    >>> column.nodes
    ('bead.1', 'bead.2', 'bead.3', 'ground')
    >>> [piece.name for piece in column.parts() if piece.reaction]
    ['bead.R1', 'bead.R2', 'bead.R3']
    """

    n: int
    m: Values = MISSING
    k: Values | None = None
    c: Values | None = None
    gap: Values | None = None
    e: Values | None = None
    f: Values | None = None
    a: str | None = None
    b: str | None = None
    name: str = "x"
    symbols: tuple[str, ...] = ("m",)

    strokes: ClassVar[tuple[Polyline, ...]] = ()

    def __post_init__(self) -> None:
        if not is_count(self.n) or self.n < 1:
            raise InputError(f"a Chain: n = {self.n!r} must be a whole number of masses, at least 1")
        object.__setattr__(self, "n", int(self.n))
        named(self)
        if self.m is MISSING:
            raise InputError(f"{self}: m is missing; give a positive number in kg, or one for each mass")
        if (self.gap is None) != (self.e is None):
            raise InputError(
                f"{self}: bumpers need both gap and e, since both sides have mass: give gap= and e=, or leave both out"
            )
        for symbol, count, least in (("m", self.n, "positive"), ("f", self.n, ""), *self._constants_of_links()):
            self._check(symbol, count, least)
        if self.e is not None and not ((self.values("e") >= 0.0) & (self.values("e") <= 1.0)).all():
            raise InputError(f"{self}: e must lie in [0, 1]")
        if not self.links and (self.k is not None or self.c is not None or self.gap is not None):
            raise InputError(f"{self}: one mass without a and b has no links; leave k, c, gap and e out")
        for end in (each for each in (self.a, self.b) if each is not None):
            if not is_name(end) or end in self.masses or (self.a == self.b and end != GROUND):
                raise InputError(
                    f"{self}: a = {self.a!r} and b = {self.b!r} must be two nodes beside its masses, or ground"
                )
        if not isinstance(self.symbols, tuple) or len(self.symbols) != 1 or not all(map(is_name, self.symbols)):
            raise InputError(f"symbols = {self.symbols!r} of a Chain must be a tuple of 1 strings")

    def _constants_of_links(self) -> tuple[tuple[str, int, str], ...]:
        count = len(self.links)
        return (("k", count, "positive"), ("c", count, "positive"), ("gap", count, ""), ("e", count, ""))

    def _check(self, symbol: str, count: int, least: str) -> None:
        """Check a constant, and keep a sequence of it as a tuple, by which schemes can be compared."""
        given = getattr(self, symbol)
        if given is None:
            return
        values = finite_array(f"{self}: {symbol}", given)
        if values.ndim > 1 or (values.ndim == 1 and len(values) != count):
            raise InputError(
                f"{self}: {symbol} must be one number, or {count} of them, and has the shape {values.shape}"
            )
        if least and not (values > 0.0).all():
            raise InputError(f"{self}: {symbol} must be positive, and is {float(values.min()):g}")
        object.__setattr__(self, symbol, tuple(values.tolist()) if values.ndim else float(values))

    def __str__(self) -> str:
        return f"Chain {self.name!r}"

    @property
    def masses(self) -> tuple[str, ...]:
        """The nodes of the masses."""
        return tuple(f"{self.name}.{i}" for i in range(1, self.n + 1))

    @property
    def nodes(self) -> tuple[str, ...]:
        """The nodes from a to b."""
        return (*(() if self.a is None else (self.a,)), *self.masses, *(() if self.b is None else (self.b,)))

    @property
    def inner(self) -> tuple[str, ...]:
        """None: other elements may be joined to the masses."""
        return ()

    @property
    def links(self) -> range:
        """The numbers of the links, from 1."""
        return range(1, self.n + (self.a is not None) + (self.b is not None))

    @property
    def reactions(self) -> tuple[str, ...]:
        """The names of the reactions of the bumpers."""
        return () if self.gap is None else tuple(f"{self.name}.R{i}" for i in self.links)

    def values(self, symbol: str) -> Array:
        """Return a constant of all masses (n,) or links, by its symbol; zeros where it is None."""
        given = getattr(self, symbol)
        count = self.n if symbol in ("m", "f") else len(self.links)
        return np.full(count, 0.0 if given is None else given, dtype=np.float64)

    def parts(self) -> tuple[Element, ...]:
        """Return the masses, loads, springs, dashpots and bumpers."""
        masses, pairs = self.masses, list(pairwise(self.nodes))
        pieces: list[Element] = [Mass(node, m) for node, m in zip(masses, self.values("m").tolist(), strict=True)]
        if self.f is not None:
            pieces += [Load(node, f) for node, f in zip(masses, self.values("f").tolist(), strict=True)]
        if self.k is not None:
            pieces += [Spring(a, b, k) for (a, b), k in zip(pairs, self.values("k").tolist(), strict=True)]
        if self.c is not None:
            pieces += [Dashpot(a, b, c) for (a, b), c in zip(pairs, self.values("c").tolist(), strict=True)]
        if self.gap is not None:
            each = zip(pairs, self.values("gap").tolist(), self.values("e").tolist(), self.reactions, strict=True)
            pieces += [Bumper(a, b, gap, e, name) for (a, b), gap, e, name in each]
        return tuple(pieces)

    def contribute_arrays(self, terms: SparseTerms) -> None:
        """Add the terms of the parts to sparse matrices, all of a kind at once."""
        places = terms.places(self.nodes)
        upper, lower, masses = places[:-1], places[1:], terms.places(self.masses)
        terms.M.add(self.values("m"), (masses, masses))
        if self.f is not None:
            terms.load(masses, self.values("f"))
        for matrix, symbol in ((terms.K, "k"), (terms.C, "c")):
            if getattr(self, symbol) is not None:
                terms.link_all(matrix, upper, lower, self.values(symbol))
        if self.gap is not None:
            terms.bumpers(self.reactions, upper, lower, self.values("gap"), self.values("e"))
