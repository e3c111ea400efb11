r"""Heun's method, the explicit trapezoidal rule.

.. math:: k_1 = F(t, X), \qquad k_2 = F(t + h, X + h k_1), \qquad X^+ = X + \tfrac h2 (k_1 + k_2) .
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from lcpimpact.integrators.base import Declared
from lcpimpact.integrators.stepping.runge_kutta.method import ExplicitRungeKutta, declare
from lcpimpact.integrators.stepping.runge_kutta.tableau import Tableau


@dataclass(frozen=True)
class Heun(ExplicitRungeKutta):
    """Heun's method, of order 2.

    Parameters
    ----------
    tol, max_iter : optional
        As of `ExplicitRungeKutta`.
    """

    tableau: ClassVar[Tableau] = Tableau(a=((), (1.0,)), b=(0.5, 0.5), c=(0.0, 1.0), order=2)

    name: ClassVar[str] = "heun"
    declared: ClassVar[Declared] = declare(
        summary="explicit trapezoidal rule, an LCP at each stage",
        order_smooth=2,
        order_loss=float("inf"),
        step=5.0,  # 2.5 where a massless plate comes to rest within few steps
        source="Heun1900; HairerNorsettWanner1993, section II.1",
    )
