r"""The method of Shu and Osher: three stages, each a convex combination of Euler steps.

.. math:: X_1 = X + h F(X), \qquad X_2 = \tfrac34 X + \tfrac14 (X_1 + h F(X_1)), \qquad
          X^+ = \tfrac13 X + \tfrac23 (X_2 + h F(X_2)) .

A convex functional that no Euler step of length h increases does not increase in this step either.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from lcpimpact.integrators.base import Declared
from lcpimpact.integrators.stepping.runge_kutta.method import ExplicitRungeKutta, declare
from lcpimpact.integrators.stepping.runge_kutta.tableau import Tableau


@dataclass(frozen=True)
class SSPRK3(ExplicitRungeKutta):
    """The strong-stability-preserving method of order 3.

    Parameters
    ----------
    tol, max_iter : optional
        As of `ExplicitRungeKutta`.
    """

    tableau: ClassVar[Tableau] = Tableau(
        a=((), (1.0,), (1 / 4, 1 / 4)), b=(1 / 6, 1 / 6, 2 / 3), c=(0.0, 1.0, 1 / 2), order=3
    )

    name: ClassVar[str] = "ssprk3"
    declared: ClassVar[Declared] = declare(
        summary="convex combinations of Euler steps, an LCP at each stage",
        order_smooth=3,
        order_loss=3,
        loss_constant=1 / 12,
        slack=6.0,  # 3 where a massless plate comes to rest within few steps
        source="ShuOsher1988",
    )
