"""Time integrators, one method a file, behind one small interface."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lcpimpact.registry import Registry

if TYPE_CHECKING:
    from lcpimpact.integrators.base import Integrator

METHODS: Registry[type[Integrator]] = Registry(
    "method",
    {
        "moreau-jean": "lcpimpact.integrators.moreau_jean:MoreauJean",
        "moreau-midpoint": "lcpimpact.integrators.moreau_midpoint:MoreauMidpoint",
        "exact": "lcpimpact.integrators.exact:Exact",
        "rk4-paper": "lcpimpact.integrators.rk4_paper:RK4Paper",
    },
    group="lcpimpact.methods",
)
