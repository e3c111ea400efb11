r"""The Zener element, or standard linear solid: a spring beside a Maxwell element."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from numpy.typing import ArrayLike

from lcpimpact.arrays import Array
from lcpimpact.scheme.elements.base import MISSING, Compound, Element, described, distinct, positive
from lcpimpact.scheme.elements.maxwell import inner_nodes, maxwell_arm, relaxation_modulus
from lcpimpact.scheme.elements.spring import Spring


@described
@dataclass(frozen=True)
class Zener(Compound):
    r"""The standard linear solid: stiffness k + k_1 at once, k after a long time.

    After a unit step of the elongation the force is G(t) = k + k_1 exp(-t/τ_1) with τ_1 = c_1/k_1; after a step of the
    force F the elongation creeps to F/k, as F/k (1 - k_1/(k + k_1) exp(-t/τ_c)) with τ_c = τ_1 (k + k_1)/k. The energy is
    that of the two springs; the dashpot dissipates c_1 (rate of its elongation)².

    ::

                        k
             +-------/\/\/\-------+
        a o--|                    |--o b      pulls a towards b when it is stretched
             +--/\/\/\--o--[ |----+
                  k_1 NAME.1  c_1

    Parameters
    ----------
    a, b : str
        The nodes that it joins; one may be the ground.
    k : float
    k_1 : float
    c_1 : float
    name : str, optional
        The name of the inner node, without its number; by default the two ends, as in x-ground.
    symbols : tuple of str
        How drawings call the constants.

    Raises
    ------
    InputError
        If k, k_1 or c_1 is missing, not positive or not finite, or both ends are one node.

    Examples
    --------
    >>> solid = Zener("x", "ground", k=100.0, k_1=300.0, c_1=30.0)
    >>> solid.modulus([0.0, 10.0]).tolist()
    [400.0, 100.0]

    References
    ----------
    Zener, *Elasticity and Anelasticity of Metals* (1948).
    """

    a: str
    b: str
    k: Annotated[float, "N/m, stiffness after a long time, positive"] = MISSING
    k_1: Annotated[float, "N/m, additional instantaneous stiffness, positive"] = MISSING
    c_1: Annotated[float, "N s/m, damping, positive"] = MISSING
    name: str | None = None
    symbols: tuple[str, ...] = ("k", "k_1", "c_1")

    def __post_init__(self) -> None:
        distinct(self)
        positive(self, "k", self.k, "N/m")
        positive(self, "k_1", self.k_1, "N/m")
        positive(self, "c_1", self.c_1, "N s/m")

    @property
    def nodes(self) -> tuple[str, ...]:
        """The two ends, and the node between the spring and the dashpot of the arm."""
        return (self.a, *inner_nodes(self.name, self.a, self.b, 1), self.b)

    def modulus(self, t: ArrayLike) -> Array:
        """Return G(t) in N/m, the force a time t > 0 after a unit step of the elongation, with the shape of t."""
        return relaxation_modulus(t, self.k, (self.k_1,), (self.c_1 / self.k_1,))

    def parts(self) -> tuple[Element, ...]:
        """Return the spring, and the spring and the dashpot of the arm."""
        a, inner, b = self.nodes
        return (Spring(a, b, self.k, self.symbols[:1]), *maxwell_arm(a, inner, b, self.k_1, self.c_1, self.symbols[1:]))
