"""A rheological scheme: elements between named nodes."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from copy import copy
from dataclasses import fields, replace
from itertools import count
from typing import Any, Literal, Self, TypeAlias, cast, get_args

import numpy as np
from numpy.typing import ArrayLike

from lcpimpact.errors import InputError
from lcpimpact.numbers import finite_array
from lcpimpact.registry import html_of, nearest
from lcpimpact.scheme.assembly import assemble, assemble_by_size, under_law
from lcpimpact.scheme.bodies import assemble_bodies, has_bodies
from lcpimpact.scheme.dynamics import Dynamics
from lcpimpact.scheme.elements.base import Element
from lcpimpact.scheme.elements.bumper import Bumper
from lcpimpact.scheme.elements.substructure import Substructure
from lcpimpact.scheme.impact_laws import LZB, ImpactLaw, impact_law_of
from lcpimpact.scheme.signals import TimeFunction
from lcpimpact.scheme.traced import assemble_formulas, is_traced

Format: TypeAlias = Literal["auto", "full", "sparse"]
"""Format of the matrices of a scheme."""


class Scheme:
    """Masses, springs, dashpots and bumpers between named nodes and the ground.

    Parameters
    ----------
    *elements : Element
        The elements; more can be added by `add`.
    format : str
        Format of the matrices: "full", "sparse" as of `lcpimpact.SparseScheme`, or "auto": sparse above 1,000 nodes, where
        sparse matrices take all of the elements.
    impact_law : str or LZB
        The law of impacts in which several contacts take part: "newton" (Moreau's, all contacts at once), "sequential",
        "poisson", or "lzb", which is `lcpimpact.LZB` with Hertz's exponent and equal stiffnesses.

    Raises
    ------
    InputError
        For an object that is not an element, another format, and another law.

    Examples
    --------
    The paper's System No. 1:

    >>> from lcpimpact import Bumper, KelvinVoigt, Load, Mass, Scheme
    >>> scheme = Scheme(Mass("x", m=100.0), Load("x", f=981.0), Bumper("x", "z"))
    >>> dynamics = scheme.add(KelvinVoigt("z", "ground", k=3924.0, c=250.0)).assemble()
    >>> dynamics.nodes
    ('x', 'z')
    >>> dynamics.contacts[0].relative_degree
    1
    """

    def __init__(self, *elements: Element, format: Format = "auto", impact_law: str | LZB = "newton") -> None:
        if format not in get_args(Format):
            raise InputError(nearest(str(format), list(get_args(Format)), "format of matrices"))
        self.elements: tuple[Element, ...] = ()
        self.format = format
        self.impact_law: ImpactLaw = impact_law_of(impact_law)
        self.add(*elements)

    @classmethod
    def of_matrices(
        cls,
        M: ArrayLike,
        C: ArrayLike | None = None,
        K: ArrayLike | None = None,
        f: Sequence[float | TimeFunction] | None = None,
        *,
        H: ArrayLike = (),
        gaps: Sequence[float] | None = None,
        e: Sequence[float | None] | None = None,
        coordinates: Sequence[str] | None = None,
        contacts: Sequence[str] | None = None,
        impact_law: str | LZB = "newton",
    ) -> Scheme:
        """Return the scheme M q'' + C q' + K q = f + Hᵀ r, u = H q + gaps, 0 <= u ⟂ r >= 0.

        Other elements, such as `Friction`, may be added to it.

        Parameters
        ----------
        M, C, K, f
            As of `lcpimpact.Substructure`.
        H : (nc, n) array_like, optional
            The constraint matrix, a row for each contact.
        gaps : sequence of nc float, optional
            Openings in m at q = 0; zero by default.
        e : sequence of nc float, optional
            Coefficients of restitution; needed where there are contacts.
        coordinates : sequence of n str, optional
            Names; by default q1, q2, ...
        contacts : sequence of nc str, optional
            Names of the reactions; by default R, R_2, ...
        impact_law : str or LZB, optional
            As of `Scheme`.

        Raises
        ------
        InputError
            If shapes do not fit, and for what `Substructure` and `Bumper` refuse.

        Examples
        --------
        A body that falls 1 m:

        >>> ball = Scheme.of_matrices([[2.0]], f=[-19.62], H=[[1.0]], gaps=[1.0], e=[0.5], coordinates=["y"])
        >>> ball.assemble().gap(0.0, [0.25])
        array([1.25])
        """
        n = len(np.atleast_1d(np.asarray(M, dtype=object)))
        names = tuple(f"q{i + 1}" for i in range(n)) if coordinates is None else tuple(coordinates)
        rows = np.atleast_2d(finite_array("H", H)) if np.size(np.asarray(H, dtype=object)) else np.zeros((0, n))
        if rows.shape[1] != n or len(names) != n:
            raise InputError(
                f"M has {n} rows, H the shape {rows.shape}, and there are {len(names)} coordinates: they must fit"
            )
        count = len(rows)
        gaps = [0.0] * count if gaps is None else gaps
        e = [None] * count if e is None else e
        reactions: Sequence[str | None] = [None] * count if contacts is None else contacts
        for name, values in (("gaps", gaps), ("e", e), ("contacts", reactions)):
            if len(values) != count:
                raise InputError(f"{name} = {values!r} must hold {count} values, one for each row of H")
        scheme = cls(Substructure(names, cast(Any, M), cast(Any, C), cast(Any, K), f), impact_law=impact_law)
        for row, gap, each, reaction in zip(rows, gaps, e, reactions, strict=True):
            point = {node: float(c) for node, c in zip(names, row, strict=True) if c != 0.0}
            scheme.add(Bumper("ground", point, gap, each, reaction))
        return scheme

    def add(self, *elements: Element) -> Scheme:
        """Add elements and return the scheme itself.

        Reactions without a name get one, in the order of the elements: the first bumper R, the next R_2, R_3, ...; likewise
        F of sliders and Jenkins elements and T of ropes. Names that are given, also those that follow in the same call, are
        passed over, and stay as they are.

        Raises
        ------
        InputError
            If an object that is not an element is added.
        """
        for element in elements:
            if not isinstance(element, Element):
                raise InputError(f"{element!r} is not an element: add a Mass, Spring, Dashpot, Bumper, Load, ...")
        self.elements += tuple(_named(self.elements, elements))
        return self

    def assemble(self) -> Dynamics:
        """Return the equations of motion; what cannot be solved is refused by name (`InputError`, `UnsupportedError`)."""
        if has_bodies(self.elements):
            found = assemble_bodies(self.elements, self._assembled)
        elif is_traced(self.elements):
            found = assemble_formulas(self.elements)
        else:
            found = self._assembled(self.elements)
        return under_law(found, self.impact_law)

    def with_elements(self, elements: Iterable[Element]) -> Self:
        """Return a scheme of other elements, which have their names, with the same format and law of impact."""
        other = copy(self)
        other.elements = tuple(elements)
        return other

    def _assembled(self, elements: Sequence[Element]) -> Dynamics:
        if self.format == "sparse":
            return cast(Dynamics, assemble(elements, in_sparse_matrices=True))
        return assemble(elements) if self.format == "full" else assemble_by_size(elements)

    def __eq__(self, other: Any) -> bool:
        return type(other) is type(self) and self.elements == other.elements and self.impact_law == other.impact_law

    __hash__ = None  # type: ignore[assignment]

    def _repr_html_(self) -> str:
        return html_of(self)

    def __repr__(self) -> str:
        lines = [f"    {type(e).__name__}({', '.join(_arguments(e))})," for e in self.elements]
        lines += [f"    format={self.format!r},"] * (self.format != "auto")
        lines += [f"    impact_law={self.impact_law!r},"] * (self.impact_law != "newton")
        return "\n".join(["Scheme(", *lines, ")"])


def _named(before: Sequence[Element], added: Sequence[Element]) -> Iterator[Element]:
    """Yield the elements that are added; a reaction without a name gets the first that is free of R, R_2, R_3, ..."""
    taken = {getattr(element, "name", None) for element in (*before, *added) if element.reaction}
    free = {reaction: _names(reaction) for reaction in dict.fromkeys(element.reaction for element in added)}
    for element in added:
        if not element.reaction or getattr(element, "name", "") is not None:
            yield element
            continue
        name = next(name for name in free[element.reaction] if name not in taken)
        # Its symbol in drawings follows, unless given.
        follows = name != element.reaction and element.symbols == (element.reaction,)
        yield replace(element, name=name, **{"symbols": (name,)} if follows else {})  # type: ignore[type-var]


def _names(reaction: str) -> Iterator[str]:
    """Yield R, R_2, R_3, ..."""
    yield reaction
    for i in count(2):
        yield f"{reaction}_{i}"


def _arguments(element: Element) -> list[str]:
    values = {f.name: (getattr(element, f.name), f.default) for f in fields(element)}  # type: ignore[arg-type]
    return [f"{name}={value!r}" for name, (value, default) in values.items() if value != default]
