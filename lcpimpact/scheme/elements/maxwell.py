r"""The Maxwell element: a spring and a dashpot in series."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike

from lcpimpact.arrays import Array
from lcpimpact.scheme.elements.base import MISSING, Compound, Element, described, distinct, positive
from lcpimpact.scheme.elements.dashpot import Dashpot
from lcpimpact.scheme.elements.spring import Spring


@described
@dataclass(frozen=True)
class Maxwell(Compound):
    r"""A spring in series with a dashpot: a force that relaxes, F' + F/τ = k (v_b - v_a) with τ = c/k.

    The inner node NAME.1 between them has no mass; its position relative to b is the flow, which is permanent. After
    a unit step of the elongation the force is the modulus G(t) = k exp(-t/τ). The energy is ½ F²/k; the dashpot
    dissipates F²/c.

    ::

                      NAME.1   +----+
        a o----/\/\/\----o-----|  --|--o b      pulls a towards b by F
                 k             +----+
                                 c

    Parameters
    ----------
    a, b : str
        The nodes that it joins; one may be the ground.
    k : float
    c : float
    name : str, optional
        The name of the inner node, without its number; by default the two ends, as in x-ground.
    symbols : tuple of str
        How drawings call the two constants.

    Raises
    ------
    InputError
        If k or c is missing, not positive or not finite, or both ends are one node.

    Examples
    --------
    >>> buffer = Maxwell("x", "ground", k=100.0, c=50.0)
    >>> buffer.nodes, buffer.tau
    (('x', 'x-ground.1', 'ground'), 0.5)
    >>> float(buffer.modulus(0.0))
    100.0

    References
    ----------
    Tschoegl, *The Phenomenological Theory of Linear Viscoelastic Behavior* (1989), chapter 3.
    """

    a: str
    b: str
    k: Annotated[float, "N/m, stiffness, positive: how it answers at once"] = MISSING
    c: Annotated[float, "N s/m, damping, positive: how it flows"] = MISSING
    name: str | None = None
    symbols: tuple[str, ...] = ("k", "c")

    def __post_init__(self) -> None:
        distinct(self)
        positive(self, "k", self.k, "N/m")
        positive(self, "c", self.c, "N s/m")

    @property
    def nodes(self) -> tuple[str, ...]:
        """The two ends, and the node between spring and dashpot."""
        return (self.a, *inner_nodes(self.name, self.a, self.b, 1), self.b)

    @property
    def tau(self) -> float:
        """The relaxation time c/k in s."""
        return self.c / self.k

    def modulus(self, t: ArrayLike) -> Array:
        """Return G(t) = k exp(-t/τ) in N/m, the force a time t > 0 after a unit step, with the shape of t."""
        return relaxation_modulus(t, 0.0, (self.k,), (self.tau,))

    def parts(self) -> tuple[Element, ...]:
        """Return the spring and the dashpot."""
        a, inner, b = self.nodes
        return maxwell_arm(a, inner, b, self.k, self.c, self.symbols)


def inner_nodes(name: str | None, a: str, b: str, count: int) -> tuple[str, ...]:
    """Return the names of the nodes that an element makes between its ends: NAME.1, ... or, without a name, a-b.1, ..."""
    return tuple(f"{name or f'{a}-{b}'}.{i}" for i in range(1, count + 1))


def maxwell_arm(a: str, inner: str, b: str, k: float, c: float, symbols: tuple[str, ...]) -> tuple[Spring, Dashpot]:
    """Return a spring k from a to the inner node, and a dashpot c from there to b."""
    return (Spring(a, inner, k, symbols[:1]), Dashpot(inner, b, c, symbols[1:]))


def relaxation_modulus(t: ArrayLike, k_inf: float, k: ArrayLike, tau: ArrayLike) -> Array:
    """Return k_inf + Σ k_i exp(-t/τ_i) in N/m, with the shape of t."""
    times = np.asarray(t, dtype=np.float64)
    return np.asarray(k_inf + np.exp(-times[..., None] / np.asarray(tau)) @ np.asarray(k, dtype=np.float64))
