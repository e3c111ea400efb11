r"""The classical Runge-Kutta method, used by the paper.

.. math:: k_1 = F(t, X), \quad k_2 = F(t + \tfrac h2, X + \tfrac h2 k_1), \quad k_3 = F(t + \tfrac h2, X + \tfrac h2 k_2),
          \quad k_4 = F(t + h, X + h k_3), \quad X^+ = X + \tfrac h6 (k_1 + 2 k_2 + 2 k_3 + k_4) .

`rk4_paper` contains the case distinctions of three systems; this method finds them by LCPs, for any scheme.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from lcpimpact.integrators.base import Declared
from lcpimpact.integrators.stepping.runge_kutta.method import ExplicitRungeKutta, declare
from lcpimpact.integrators.stepping.runge_kutta.tableau import Tableau


@dataclass(frozen=True)
class RK4(ExplicitRungeKutta):
    """The classical method of order 4.

    Parameters
    ----------
    tol, max_iter : optional
        As of `ExplicitRungeKutta`.
    """

    tableau: ClassVar[Tableau] = Tableau(
        a=((), (1 / 2,), (0.0, 1 / 2), (0.0, 0.0, 1.0)),
        b=(1 / 6, 1 / 3, 1 / 3, 1 / 6),
        c=(0.0, 1 / 2, 1 / 2, 1.0),
        order=4,
    )

    name: ClassVar[str] = "rk4"
    declared: ClassVar[Declared] = declare(
        summary="the classical method, an LCP at each stage",
        order_smooth=4,
        order_loss=5,
        loss_constant=1 / 72,
        source="Kutta1901",
    )
