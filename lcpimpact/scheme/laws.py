r"""Laws of the rows: a reaction in an interval, complementary to the place of its row or to the rate of it.

.. math:: r = r_{min} \text{ where } z > 0, \qquad r = r_{max} \text{ where } z < 0, \qquad
          r_{min} \le r \le r_{max} \text{ where } z = 0,

with z = u or z = U = u'; where a bound is infinite, z does not have the sign that would need it. A bumper is the interval
[0, ∞) and u, a slider [-r0, r0] and U, a joint (-∞, ∞) and u. Whoever needs to know a row asks what its law is like (its
interval, and of which z it is), not which law it is, so that one more is an element that adds rows with it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class RowLaw:
    """Law of a row, apart from the numbers of its interval.

    Attributes
    ----------
    name : str              the law in messages and accounts of energy
    of_rate : bool          whether it is complementary to the rate U, and not to the place u
    tangential : bool       whether another row, its normal row, bounds the reaction
    at_bound, between : str kinds of the events where r comes to a bound, and where it leaves one; "" if there are none

    Examples
    --------
    >>> from lcpimpact import RowLaw
    >>> RowLaw("freewheel", of_rate=True, at_bound="overrun", between="engage").of_rate
    True
    """

    name: str
    of_rate: bool = False
    tangential: bool = False
    at_bound: str = ""
    between: str = ""


class Bounded:
    """Row with a law and an interval: the questions that may be asked of it."""

    law: RowLaw
    bounds: tuple[float, float]

    @property
    def one_sided(self) -> bool:
        """Whether r >= 0 alone: it can push only, and without limit."""
        return math.isinf(self.bounds[1]) and not math.isinf(self.bounds[0])

    @property
    def impenetrable(self) -> bool:
        """Whether u >= 0, which r >= 0 enforces."""
        return not self.law.of_rate and self.one_sided

    @property
    def bilateral(self) -> bool:
        """Whether z = 0 for any r."""
        return math.isinf(self.bounds[0]) and math.isinf(self.bounds[1]) and not self.law.tangential

    @property
    def limited(self) -> bool:
        """Whether r has two bounds of its own."""
        return not math.isinf(self.bounds[0]) and not math.isinf(self.bounds[1])

    @property
    def switches(self) -> bool:
        """Whether r goes from bound to bound where u changes its sign."""
        return self.limited and not self.law.of_rate


CONTACT = RowLaw("contact", at_bound="open", between="close")
"""0 <= r ⟂ u >= 0."""

SLIDER = RowLaw("slider", of_rate=True, at_bound="slip", between="stick")
"""-r0 <= r <= r0, complementary to U."""

FRICTION = RowLaw("friction", of_rate=True, tangential=True, at_bound="slip", between="stick")
"""-μ r_N <= r <= μ r_N, complementary to U, with the reaction r_N of another row; μ_s in place of μ while it sticks."""

JOINT = RowLaw("joint")
"""u = 0, for any r: a joint of a scheme, or an equation of a system."""

RELAY = RowLaw("relay", at_bound="switch", between="slide")
"""r_min <= r <= r_max, complementary to u: r_min where u > 0, r_max where u < 0, any between where u = 0."""
