r"""The laws of impact of a scheme by name; `lcpimpact.hybrid.impact_laws` has their equations.

A contact alone rebounds by all of them with U⁺ = -e U⁻. They differ where bodies touch: momentum and energy leave open what
an impact passes on to closed contacts that do not approach each other.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar, Literal, TypeAlias, get_args

from lcpimpact.errors import InputError
from lcpimpact.numbers import is_real, positive
from lcpimpact.registry import nearest

Named: TypeAlias = Literal["newton", "sequential", "poisson"]
"""The laws without constants of their own."""


@dataclass(frozen=True)
class LZB:
    r"""The law of impact of Liu, Zhao and Brogliato: the contacts share the impulses as their potential energies E_i.

    .. math:: \frac{dP_i}{dP_1} = \left( \frac{k_i}{k_1} \right)^{1/(η + 1)} \left( \frac{E_i}{E_1} \right)^{η/(η + 1)},
              \qquad dE_i = -U_i \, dP_i \times \begin{cases} 1 & U_i < 0 \\ 1/e_i^2 & U_i > 0 \end{cases}

    They are those of springs k_i δ^η of negligible compression, so that only the ratios of the k_i count, with the bistiff
    law of expansion: what a contact returns is e² of the work of its compression (e is the energetic coefficient), and the
    force is continuous between the phases. An impact ends when no energy is left and no contact approaches.

    Parameters
    ----------
    exponent : float
        η: 3/2 by default, as of Hertz's contacts; 1 of linear springs.
    stiffness : mapping of str to float
        k of contacts by their names, in any unit, since only ratios count; 1 of those that are not named.

    Raises
    ------
    InputError
        For an exponent below 1 or above 10, or a stiffness that is not positive.

    Examples
    --------
    >>> from lcpimpact import Bumper, Mass, Problem, Scheme, simulate
    >>> balls = [Mass(x, m=1.0) for x in "abc"]
    >>> row = Scheme(*balls, Bumper("a", "b", e=1.0), Bumper("b", "c", e=1.0), impact_law=LZB(exponent=1.5))
    >>> run = simulate(Problem("row", row, v0={"a": 1.0}), "exact", dt=0.1, t_end=1.0)
    >>> run.v[-1].round(6) + 0.0
    array([-0.070952,  0.076403,  0.994549])

    References
    ----------
    Liu, Zhao and Brogliato, Frictionless multiple impacts in multibody systems I (2008).
    """

    exponent: float = 1.5
    stiffness: Mapping[str, float] = field(default_factory=dict)

    name: ClassVar[str] = "lzb"

    def __post_init__(self) -> None:
        if not is_real(self.exponent) or not 1.0 <= self.exponent <= 10.0:
            raise InputError(f"LZB: exponent = {self.exponent!r} must lie between 1 (linear) and 10; Hertz's is 1.5")
        if not isinstance(self.stiffness, Mapping) or not all(isinstance(each, str) for each in self.stiffness):
            raise InputError(f"LZB: stiffness = {self.stiffness!r} must be a mapping of names of contacts to numbers")
        for contact, k in self.stiffness.items():
            positive(f"LZB: stiffness of {contact!r}", k)

    def __hash__(self) -> int:
        return hash((self.exponent, frozenset(self.stiffness.items())))


ImpactLaw: TypeAlias = Named | LZB
"""A law of impact: the name of one without constants, or one with them."""

IMPACT_LAWS: dict[str, ImpactLaw] = {**{each: each for each in get_args(Named)}, LZB.name: LZB()}
"""The laws by name; "lzb" is that of Hertz's contacts of equal stiffness."""


def impact_law_of(given: str | LZB) -> ImpactLaw:
    """Return the law of a name, or one with constants as it is.

    Raises
    ------
    InputError
        For anything else.
    """
    if isinstance(given, LZB):
        return given
    if not isinstance(given, str):
        raise InputError(f"impact_law = {given!r} must be one of {', '.join(map(repr, IMPACT_LAWS))}, or LZB(...)")
    if given not in IMPACT_LAWS:
        raise InputError(nearest(given, list(IMPACT_LAWS), "law of impact"))
    return IMPACT_LAWS[given]


def name_of_law(law: ImpactLaw) -> str:
    """Return the name of a law."""
    return law if isinstance(law, str) else law.name
