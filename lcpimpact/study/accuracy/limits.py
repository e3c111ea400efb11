"""What limits the order of a method on a motion, and the order that the method declares for it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any

from lcpimpact.integrators import METHODS
from lcpimpact.integrators.base import Declared, Integrator
from lcpimpact.trajectory import Trajectory


@dataclass(frozen=True)
class Limit:
    """What limits the order of a method on a problem, and where its declared order stands.

    Attributes
    ----------
    name : str          "smooth", "force kink", "force jump", "friction", "impact", or "compliant law"
    order : str         field of `Declared`; "" where nothing is declared
    norm : str          the norm in which it is declared
    """

    name: str
    order: str
    norm: str = "sup_q"


SMOOTH = Limit("smooth", "order_smooth")
KINK = Limit("force kink", "order_force_kink")
JUMP = Limit("force jump", "order_force_jump")
FRICTION = Limit("friction", "order_friction")
IMPACT = Limit("impact", "order_impact", "l1_v")
COMPLIANT = Limit("compliant law", "")


def limits_of(truth: Trajectory) -> tuple[Limit, ...]:
    """Return what limits the orders on a motion, by its events; those that happen, the worst last.

    A contact that opens or closes counts by its relative degree: 0 a kink of the force, 1 a jump, 2 an impact, which may
    pass through contacts of a lower degree too. The jump at the start of a system is no matter of steps. A slider of
    degree 2 that sticks or slips is friction; where it has a spring or a dashpot in series, a kink or a jump. About the
    kinks and jumps of non-linear springs nothing is declared.

    Examples
    --------
    >>> from lcpimpact import load_problem, simulate
    >>> [limit.name for limit in limits_of(simulate(load_problem("system-1"), "exact", dt=0.1, t_end=3.0))]
    ['smooth', 'force jump']
    """
    d = truth.problem.dynamics
    contacts = {contact.name: contact for contact in d.contacts}
    happened = {SMOOTH}
    if d.springs:
        happened.add(COMPLIANT)
    for event in truth.events:
        if event.contact not in contacts:
            continue
        contact = contacts[event.contact]
        last = FRICTION if contact.r0 is not None else IMPACT
        if event.kind != "jump":
            happened.add((KINK, JUMP, last)[2 if event.kind == "impact" else contact.relative_degree])
    return tuple(limit for limit in (SMOOTH, KINK, JUMP, FRICTION, IMPACT, COMPLIANT) if limit in happened)


def floor_of(reference: str, norm: str) -> float:
    """Return the error of a reference of that name, relative to the scale of a norm, below which no error is seen.

    In the L2 norm of v a jump that comes late by δ counts as δ^(1/2).

    Examples
    --------
    >>> floor_of("exact", "sup_q"), floor_of("event-driven (rtol=1e-12)", "sup_q"), floor_of("exact", "l2_v")
    (1e-12, 1e-09, 1e-06)
    """
    method = METHODS.get(reference.replace("(", " ").split(" ")[0])
    floor = Declared.accuracy if method is None else method.declared.accuracy
    return math.sqrt(floor) if norm == "l2_v" else floor


def declared_order(integrator: Integrator, limits: Sequence[Limit]) -> float:
    """Return the order that a method declares where these limits hold, the least of them; nan where it declares none.

    What is declared holds for the usual options, and for any tolerance.

    Examples
    --------
    >>> from lcpimpact.integrators.moreau_jean import MoreauJean
    >>> declared_order(MoreauJean(), (SMOOTH, JUMP)), declared_order(MoreauJean(theta=1.0), (SMOOTH, JUMP))
    (2.0, nan)
    """
    if COMPLIANT in limits or not all(option in integrator.tolerances for option in chosen_options(integrator)):
        return math.nan
    return float(min(getattr(integrator.declared, limit.order) for limit in limits))


def chosen_options(integrator: Integrator) -> dict[str, Any]:
    """Return the options of a method that are not the usual ones."""
    values = {each.name: (getattr(integrator, each.name), each.default) for each in fields(integrator)}  # type: ignore[arg-type]
    return {name: value for name, (value, usual) in values.items() if value != usual}
