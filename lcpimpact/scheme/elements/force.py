r"""A general force: a function of the time and of the coordinates and velocities of several nodes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

from lcpimpact.arguments import is_sequence
from lcpimpact.arrays import Array
from lcpimpact.errors import InputError
from lcpimpact.scheme.elements.base import GROUND, MISSING, Element, Polyline, distinct
from lcpimpact.scheme.elements.load import Load
from lcpimpact.scheme.force_law import ForceLaw
from lcpimpact.scheme.terms import Terms


@dataclass(frozen=True)
class Force(Element):
    r"""Forces f(t, q, v) on several nodes, by their coordinates q and velocities v, positive downwards; their power is f·v.

    ::

            |            |
            v  f_1       v  f_2      f(t, q, v) of q = (q_1, q_2, ...) and v = (v_1, v_2, ...)
            o            o

    The Jacobian is found by the complex step, for which f must be analytic: np.sin in place of math.sin, np.sqrt(x**2) in
    place of abs(x); comparisons are those of the real parts. The function is called in Python: a step of `moreau-jean`
    takes some 0.2 ms. A law of one node is a `Load`.

    Parameters
    ----------
    nodes : tuple of str
        The nodes that it acts on, none of them the ground.
    f : callable
        Takes t in s, q in m (k,) and v in m/s (k,), and returns the forces in N (k,).
    jacobian : callable, optional
        Takes the same, and returns the pair of ∂f/∂q in N/m and ∂f/∂v in N s/m (k, k).
    symbols : tuple of str
        How drawings call the forces.

    Raises
    ------
    InputError
        If f is missing or is no function, a node is the ground or is named twice; and where a run starts, if f or its
        Jacobian has another shape or is not finite, or the Jacobian is not that of f.

    Examples
    --------
    >>> import numpy as np
    >>> spring = Force(("x", "y"), lambda t, q, v: -100.0 * (q[0] - q[1]) ** 3 * np.array([1.0, -1.0]))
    >>> spring.nodes
    ('x', 'y')

    References
    ----------
    Kovacic and Brennan, *The Duffing Equation* (2011), for cubic springs.
    """

    nodes: tuple[str, ...] = MISSING
    f: Callable[[float, Array, Array], Array] = MISSING
    jacobian: Callable[[float, Array, Array], tuple[Array, Array]] | None = None
    symbols: tuple[str, ...] = ("f",)

    strokes: ClassVar[tuple[Polyline, ...]] = ()

    def __post_init__(self) -> None:
        if not is_sequence(self.nodes) or not len(self.nodes):
            raise InputError(f"nodes = {self.nodes!r} of a Force must be a sequence of the nodes that it acts on")
        object.__setattr__(self, "nodes", tuple(self.nodes))
        distinct(self)
        if GROUND in self.nodes:
            raise InputError(f"{self}: a force on the ground moves nothing; name other nodes")
        if self.f is MISSING:
            raise InputError(f"{self}: f is missing; give a function of t, q and v")
        for name, function in (("f", self.f), ("jacobian", self.jacobian)):
            if not callable(function) and (name == "f" or function is not None):
                raise InputError(f"{self}: {name} = {function!r} must be a function of t, q and v")

    @property
    def inner(self) -> tuple[str, ...]:
        """No inner nodes: it acts on nodes of other elements."""
        return ()

    def drawn(self) -> tuple[Element, ...]:
        """Return an arrow at each node."""
        return tuple(Load(node, 0.0, symbols=self.symbols) for node in self.nodes)

    def contribute(self, terms: Terms) -> None:
        """Add the force law."""
        terms.force_laws.append(ForceLaw(str(self), self.nodes, self.f, self.jacobian))
