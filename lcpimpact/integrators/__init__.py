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
        "newmark-ns": "lcpimpact.integrators.newmark_ns:NewmarkNS",
        "generalized-alpha": "lcpimpact.integrators.generalized_alpha:GeneralizedAlpha",
        "rattle-ns": "lcpimpact.integrators.rattle_ns:RattleNS",
        "stormer-verlet-ns": "lcpimpact.integrators.stormer_verlet_ns:StormerVerletNS",
        "d1-minus": "lcpimpact.integrators.d1_minus:D1Minus",
        "cd-lagrange": "lcpimpact.integrators.cd_lagrange:CDLagrange",
        "schatzman-paoli": "lcpimpact.integrators.schatzman_paoli:SchatzmanPaoli",
        "exact": "lcpimpact.integrators.exact:Exact",
        "radau": "lcpimpact.integrators.radau:Radau",
        "radau-fesd": "lcpimpact.integrators.radau_fesd:RadauFESD",
        "event-driven": "lcpimpact.integrators.event_driven:EventDriven",
        "heun": "lcpimpact.integrators.heun:Heun",
        "ssprk3": "lcpimpact.integrators.ssprk3:SSPRK3",
        "bs23": "lcpimpact.integrators.bs23:BogackiShampine",
        "rk4": "lcpimpact.integrators.rk4:RK4",
        "dopri5": "lcpimpact.integrators.dopri5:DormandPrince",
        "rk4-paper": "lcpimpact.integrators.rk4_paper:RK4Paper",
    },
    group="lcpimpact.methods",
    check="lcpimpact.integrators.base:check_method",
)
