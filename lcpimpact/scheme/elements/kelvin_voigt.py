r"""The Kelvin-Voigt element: a spring and a dashpot in parallel."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from lcpimpact.scheme.elements.base import MISSING, Compound, Element, described, distinct, positive
from lcpimpact.scheme.elements.dashpot import Dashpot
from lcpimpact.scheme.elements.spring import Spring


@described
@dataclass(frozen=True)
class KelvinVoigt(Compound):
    r"""A Kelvin-Voigt block: force k (q_b - q_a) + c (v_b - v_a) on node a and its opposite on node b.

    Energy ½ k (q_b - q_a)²; dissipates c (v_b - v_a)².

    ::

               +--/\/\/\--+
        a o----|          |----o b
               +---[ |----+

    Parameters
    ----------
    a, b : str
        The nodes that it joins; one may be the ground.
    k : float
    c : float
    symbols : tuple of str
        How drawings call the two constants.

    Raises
    ------
    InputError
        If k or c is missing, not positive or not finite, or both ends are one node.

    Examples
    --------
    >>> [str(part) for part in KelvinVoigt("z", "ground", k=3924.0, c=250.0).parts()]
    ["Spring between 'z' and 'ground'", "Dashpot between 'z' and 'ground'"]
    """

    a: str
    b: str
    k: Annotated[float, "N/m, stiffness, positive"] = MISSING
    c: Annotated[float, "N s/m, damping, positive"] = MISSING
    symbols: tuple[str, ...] = ("k", "c")

    def __post_init__(self) -> None:
        distinct(self)
        positive(self, self.symbols[0], self.k, "N/m")
        positive(self, self.symbols[1], self.c, "N s/m")

    @property
    def nodes(self) -> tuple[str, ...]:
        """The two ends."""
        return (self.a, self.b)

    def parts(self) -> tuple[Element, ...]:
        """Return the spring and the dashpot."""
        spring, dashpot = self.symbols
        return (Spring(self.a, self.b, self.k, (spring,)), Dashpot(self.a, self.b, self.c, (dashpot,)))
