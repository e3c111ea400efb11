r"""The elastic-plastic element of Jenkins and Prandtl: a spring and a slider in series."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated, ClassVar

from lcpimpact.scheme.elements.base import MISSING, Compound, Element, described, distinct, positive
from lcpimpact.scheme.elements.slider import Slider
from lcpimpact.scheme.elements.spring import Spring


@described
@dataclass(frozen=True)
class Jenkins(Compound):
    r"""A spring in series with a slider: elastic until the force reaches f_y, then plastic, with hardening if k_h is given.

    The node between them, NAME.1, is the plastic strain: it stands still while the slider sticks. The energy is
    ½ k (elongation of the spring)², and ½ k_h (plastic elongation)² with hardening; the slider dissipates f_y |U|.

    ::

                      NAME.1
        a o--/\/\/\--o--[=====]--o b       force k times the elongation of the spring, at most f_y;
               k     |    f_y    |         with hardening at most f_y + k_h (plastic elongation)
                     +--/\/\/\---+
                          k_h

    Parameters
    ----------
    a, b : str
        The nodes that it joins; one may be the ground.
    k : float
    f_y : float
    k_h : float, optional
    name : str, optional
        The name of the slider's force in results, and of the inner node; by default F, and F_2, F_3, ... for the next ones
        of a scheme without a name.
    symbols : tuple of str
        How drawings call the constants.

    Raises
    ------
    InputError
        If k or f_y is missing, not positive or not finite, k_h is given and is not so, or both ends are one node.

    Examples
    --------
    >>> Jenkins("x", "ground", k=100.0, f_y=5.0).nodes
    ('x', 'F.1', 'ground')

    References
    ----------
    Jenkins, Analysis of the stress-strain relationships in reactor grade graphite (1962).
    """

    a: str
    b: str
    k: Annotated[float, "N/m, elastic stiffness, positive"] = MISSING
    f_y: Annotated[float, "N, yield force, positive"] = MISSING
    k_h: Annotated[float | None, "N/m, hardening stiffness; that of the element past yield is k k_h/(k + k_h)"] = None
    name: str | None = None
    symbols: tuple[str, ...] = ("k", "f_y", "k_h")

    reaction: ClassVar[str] = "F"

    def __post_init__(self) -> None:
        distinct(self)
        positive(self, "k", self.k, "N/m")
        positive(self, "f_y", self.f_y, "N")
        if self.k_h is not None:
            positive(self, "k_h", self.k_h, "N/m")

    @property
    def nodes(self) -> tuple[str, ...]:
        """The two ends, and the node of the plastic strain between them."""
        return (self.a, f"{self.name or self.reaction}.1", self.b)

    def parts(self) -> tuple[Element, ...]:
        """Return the spring, the slider, and the hardening spring if there is one."""
        (a, middle), (_, b) = pairwise(self.nodes)
        k, f_y, k_h = self.symbols
        parts: tuple[Element, ...] = (Spring(a, middle, self.k, (k,)), Slider(middle, b, self.f_y, self.name, (f_y,)))
        if self.k_h is not None:
            parts += (Spring(middle, b, self.k_h, (k_h,)),)
        return parts
