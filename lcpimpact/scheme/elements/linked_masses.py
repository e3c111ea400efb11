"""Masses in number, joined by links with a spring, a dashpot, a bumper, or several of these: chains, trees and lattices."""

from __future__ import annotations

from abc import abstractmethod
from typing import ClassVar

import numpy as np

from lcpimpact.arguments import is_name
from lcpimpact.arrays import Array, Indices
from lcpimpact.errors import InputError
from lcpimpact.numbers import is_count
from lcpimpact.scheme.elements.base import GROUND, MISSING, ArrayElement, Element, Polyline, Values, named, one_or_each
from lcpimpact.scheme.elements.bumper import Bumper
from lcpimpact.scheme.elements.dashpot import Dashpot
from lcpimpact.scheme.elements.load import Load
from lcpimpact.scheme.elements.mass import Mass
from lcpimpact.scheme.elements.spring import Spring
from lcpimpact.scheme.terms import Terms

Ends = tuple[Indices, Indices]
"""The upper and the lower end of each link, by their places in the nodes."""


class LinkedMasses(ArrayElement):
    """Masses with constants m and f, joined by links with k, c, gap and e, each one number or one for each."""

    name: str
    symbols: tuple[str, ...]

    strokes: ClassVar[tuple[Polyline, ...]] = ()

    @property
    @abstractmethod
    def masses(self) -> tuple[str, ...]:
        """The nodes of the masses."""

    @property
    @abstractmethod
    def outer(self) -> tuple[str, ...]:
        """The nodes and ground that links join to the masses."""

    @property
    @abstractmethod
    def reactions(self) -> tuple[str, ...]:
        """The names of the reactions of the bumpers."""

    @abstractmethod
    def ends(self) -> Ends:
        """Return the ends of the links."""

    def sides(self) -> Ends:
        """Return the ends of links that have a spring k_side and a dashpot c_side only: none."""
        return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)

    @property
    def nodes(self) -> tuple[str, ...]:
        """The masses, one after another, and the nodes that links join to them."""
        return (*self.masses, *self.outer)

    @property
    def inner(self) -> tuple[str, ...]:
        """None: other elements may be joined to the masses."""
        return ()

    def __str__(self) -> str:
        return f"{type(self).__name__} {self.name!r}"

    def _check_counts(self, *names: str) -> None:
        """Check numbers of masses, and keep them as integers."""
        for name in names:
            count = getattr(self, name)
            if not is_count(count) or count < 1:
                raise InputError(
                    f"a {type(self).__name__}: {name} = {count!r} must be a whole number of masses, at least 1"
                )
            object.__setattr__(self, name, int(count))

    def _check_constants(self) -> None:
        """Check the constants, the outer nodes and the symbols."""
        named(self)
        masses = len(self.masses)
        if self._given("m") is MISSING:
            raise InputError(f"{self}: m is missing; give a positive number in kg, or one for each mass")
        if (self._given("gap") is None) != (self._given("e") is None):
            raise InputError(
                f"{self}: bumpers need both gap and e, since both sides have mass: give gap= and e=, or leave both out"
            )
        for symbol, least in (("m", "positive"), ("f", "")):
            self._check(symbol, masses, least)
        links, sides = len(self.ends()[0]), len(self.sides()[0])
        counts = {"k": links, "c": links, "gap": links, "e": links, "k_side": sides, "c_side": sides}
        for symbol, count in counts.items():
            self._check(symbol, count, "" if symbol in ("gap", "e") else "positive")
            if not count and self._given(symbol) is not None:
                raise InputError(f"{self}: it has no links for {symbol}; leave it out, or give a node at an end")
        if self._given("e") is not None and not ((self.values("e") >= 0.0) & (self.values("e") <= 1.0)).all():
            raise InputError(f"{self}: e must lie in [0, 1]")
        own = set(self.masses)
        for end in self.outer:
            if not is_name(end) or end in own or (self.outer.count(end) > 1 and end != GROUND):
                raise InputError(
                    f"{self}: the ends {self.outer!r} must be different nodes beside its masses, or ground"
                )

    def _given(self, symbol: str) -> Values | None:
        return getattr(self, symbol, None)

    def _check(self, symbol: str, count: int, least: str) -> None:
        """Check a constant, and keep it as a number or a tuple."""
        given = self._given(symbol)
        if given is None:
            return
        values = one_or_each(f"{self}: {symbol}", given, count)
        if least and not np.min(values, initial=np.inf) > 0.0:
            raise InputError(f"{self}: {symbol} must be positive, and is {np.min(values):g}")
        object.__setattr__(self, symbol, values)

    def values(self, symbol: str) -> Array:
        """Return a constant of all masses or links, by its symbol; zeros where it is None."""
        given = self._given(symbol)
        if symbol in ("m", "f"):
            count = len(self.masses)
        else:
            count = len((self.sides() if symbol.endswith("_side") else self.ends())[0])
        return np.full(count, 0.0 if given is None else given, dtype=np.float64)

    def parts(self) -> tuple[Element, ...]:
        """Return the masses, loads, springs, dashpots and bumpers."""
        masses, nodes = self.masses, self.nodes
        pieces: list[Element] = [Mass(node, m) for node, m in zip(masses, self.values("m").tolist(), strict=True)]
        if self._given("f") is not None:
            pieces += [Load(node, f) for node, f in zip(masses, self.values("f").tolist(), strict=True)]
        pairs = [(nodes[i], nodes[j]) for i, j in zip(*(each.tolist() for each in self.ends()), strict=True)]
        sides = [(nodes[i], nodes[j]) for i, j in zip(*(each.tolist() for each in self.sides()), strict=True)]
        for symbol, kind, joined in (
            ("k", Spring, pairs),
            ("c", Dashpot, pairs),
            ("k_side", Spring, sides),
            ("c_side", Dashpot, sides),
        ):
            if self._given(symbol) is not None:
                pieces += [kind(a, b, x) for (a, b), x in zip(joined, self.values(symbol).tolist(), strict=True)]
        if self._given("gap") is not None:
            each = zip(pairs, self.values("gap").tolist(), self.values("e").tolist(), self.reactions, strict=True)
            pieces += [Bumper(a, b, gap, e, name) for (a, b), gap, e, name in each]
        return tuple(pieces)

    def contribute_arrays(self, terms: Terms) -> None:
        """Add the terms of the parts to sparse matrices, all of a kind at once."""
        places = terms.places(self.nodes)
        first = self.nodes.index(self.masses[0])
        masses = places[first : first + len(self.masses)]
        ends = self.ends()
        sides = self.sides()
        terms.M.add(self.values("m"), (masses, masses))
        if self._given("f") is not None:
            terms.load_arrays.append((masses, self.values("f"), 1.0))
        links = (terms.K, "k", ends), (terms.C, "c", ends), (terms.K, "k_side", sides), (terms.C, "c_side", sides)
        for matrix, symbol, (upper, lower) in links:
            if self._given(symbol) is not None:
                terms.link_all(matrix, places[upper], places[lower], self.values(symbol))
        if self._given("gap") is not None:
            upper, lower = (places[each] for each in ends)
            terms.rows.add_bumpers(self.reactions, upper, lower, self.values("gap"), self.values("e"))
