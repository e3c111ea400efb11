"""The Dormand-Prince pair of orders 5 and 4."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from lcpimpact.integrators.base import Declared
from lcpimpact.integrators.stepping.runge_kutta.control import EmbeddedRungeKutta
from lcpimpact.integrators.stepping.runge_kutta.method import declare
from lcpimpact.integrators.stepping.runge_kutta.tableau import Tableau


@dataclass(frozen=True)
class DormandPrince(EmbeddedRungeKutta):
    """The Dormand-Prince pair of orders 5 and 4.

    Parameters
    ----------
    rtol, atol, tol, max_iter : optional
        As of `EmbeddedRungeKutta`.
    """

    tableau: ClassVar[Tableau] = Tableau(
        a=(
            (),
            (1 / 5,),
            (3 / 40, 9 / 40),
            (44 / 45, -56 / 15, 32 / 9),
            (19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729),
            (9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656),
            (35 / 384, 0.0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84),
        ),
        b=(35 / 384, 0.0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84, 0.0),
        c=(0.0, 1 / 5, 3 / 10, 4 / 5, 8 / 9, 1.0, 1.0),
        order=5,
        b_embedded=(5179 / 57600, 0.0, 7571 / 16695, 393 / 640, -92097 / 339200, 187 / 2100, 1 / 40),
        order_embedded=4,
    )

    name: ClassVar[str] = "dopri5"
    declared: ClassVar[Declared] = declare(
        summary="Dormand and Prince's pair 5(4), an LCP at each stage",
        order_smooth=5,
        order_loss=5,
        loss_constant=1 / 1800,
        source="DormandPrince1980",
        adaptive="with rtol, steps within each dt by the embedded method",
    )
