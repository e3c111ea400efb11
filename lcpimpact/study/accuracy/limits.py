"""Limits of the order of a method on a motion, and the order that the method declares for it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields

from lcpimpact.integrators import METHODS
from lcpimpact.integrators.base import Declared, Integrator, Option
from lcpimpact.trajectory import Trajectory


@dataclass(frozen=True)
class Limit:
    """A limit of the order of a method on a problem, and the field of its declared order.

    Attributes
    ----------
    name : str          "smooth", "force kink", "force jump", "friction", "relay", "impact", or "compliant law"
    order : str         field of `Declared`; "" if nothing is declared
    norm : str          norm of the declared order
    """

    name: str
    order: str
    norm: str = "sup_q"


SMOOTH = Limit("smooth", "order_smooth")
KINK = Limit("force kink", "order_force_kink")
JUMP = Limit("force jump", "order_force_jump")
FRICTION = Limit("friction", "order_friction")
RELAY = Limit("relay", "order_relay")
IMPACT = Limit("impact", "order_impact", "l1_v")
COMPLIANT = Limit("compliant law", "")


def limits_of(truth: Trajectory) -> tuple[Limit, ...]:
    """Return the limits of the orders given by the events of a motion, the most severe last.

    The opening or closing of a contact counts by its relative degree: 0 a kink of the force, 1 a jump, 2 an impact, which
    may also act through contacts of lower degree. The initial jump of a system does not depend on steps. Stick and slip of
    a slider of degree 2 is friction; with a spring or a dashpot in series, a kink or a jump. No order is declared for the
    kinks and jumps of non-linear springs. Relays switch with a jump of λ, except those of degree 0, with a kink.

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
        last = FRICTION if contact.limited else IMPACT
        if contact.switches:
            # The λ of a relay of degree 0 that slides is continuous.
            happened.add(KINK if contact.relative_degree == 0 else RELAY)
        elif event.kind != "jump":
            happened.add((KINK, JUMP, last)[2 if event.kind == "impact" else contact.relative_degree])
    return tuple(limit for limit in (SMOOTH, KINK, JUMP, FRICTION, RELAY, IMPACT, COMPLIANT) if limit in happened)


def floor_of(reference: str, norm: str) -> float:
    """Return the error of the named reference, relative to the scale of a norm, below which no error is resolved.

    In the L2 norm of v the error of a jump delayed by δ is proportional to δ^(1/2).

    Examples
    --------
    >>> floor_of("exact", "sup_q"), floor_of("event-driven (rtol=1e-12)", "sup_q"), floor_of("exact", "l2_v")
    (1e-12, 1e-09, 1e-06)
    """
    method = METHODS.get(reference.replace("(", " ").split(" ")[0])
    floor = Declared.accuracy if method is None else method.declared.accuracy
    return math.sqrt(floor) if norm == "l2_v" else floor


def declared_order(integrator: Integrator, limits: Sequence[Limit]) -> float:
    """Return the minimum of the orders that a method declares for these limits; nan if it declares none.

    Declared orders hold for the default options, and for any tolerance.

    Examples
    --------
    >>> from lcpimpact.integrators.moreau_jean import MoreauJean
    >>> declared_order(MoreauJean(), (SMOOTH, JUMP)), declared_order(MoreauJean(theta=1.0), (SMOOTH, JUMP))
    (2.0, nan)
    """
    if COMPLIANT in limits or not all(option in integrator.tolerances for option in chosen_options(integrator)):
        return math.nan
    return float(min(getattr(integrator.declared, limit.order) for limit in limits))


def chosen_options(integrator: Integrator) -> dict[str, Option]:
    """Return the non-default options of a method."""
    values = {each.name: (getattr(integrator, each.name), each.default) for each in fields(integrator)}  # type: ignore[arg-type]
    return {name: value for name, (value, usual) in values.items() if value != usual}
