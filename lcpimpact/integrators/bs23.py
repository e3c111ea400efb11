"""The Bogacki-Shampine pair of orders 3 and 2."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from lcpimpact.integrators.base import Declared
from lcpimpact.integrators.stepping.runge_kutta.control import EmbeddedRungeKutta
from lcpimpact.integrators.stepping.runge_kutta.method import declare
from lcpimpact.integrators.stepping.runge_kutta.tableau import Tableau


@dataclass(frozen=True)
class BogackiShampine(EmbeddedRungeKutta):
    """The Bogacki-Shampine pair of orders 3 and 2.

    Parameters
    ----------
    rtol, atol, tol, max_iter : optional
        As of `EmbeddedRungeKutta`.
    """

    tableau: ClassVar[Tableau] = Tableau(
        a=((), (1 / 2,), (0.0, 3 / 4), (2 / 9, 1 / 3, 4 / 9)),
        b=(2 / 9, 1 / 3, 4 / 9, 0.0),
        c=(0.0, 1 / 2, 3 / 4, 1.0),
        order=3,
        b_embedded=(7 / 24, 1 / 4, 1 / 3, 1 / 8),
        order_embedded=2,
    )

    name: ClassVar[str] = "bs23"
    declared: ClassVar[Declared] = declare(
        summary="Bogacki and Shampine's pair 3(2), an LCP at each stage",
        order_smooth=3,
        order_loss=3,
        loss_constant=1 / 12,
        slack=6.0,  # 3 where a massless plate comes to rest within few steps
        source="BogackiShampine1989",
        adaptive="with rtol, steps within each dt by the embedded method",
    )
