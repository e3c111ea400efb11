"""Assembly of elements whose constants are formulas."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from lcpimpact.formula import NotTracedError, mentions, with_values
from lcpimpact.scheme.assembly import assemble
from lcpimpact.scheme.checks import refuse_parallel_contacts
from lcpimpact.scheme.dynamics import Dynamics, law_numbers
from lcpimpact.scheme.elements.base import Element
from lcpimpact.scheme.elements.negative_spring import NegativeSpring
from lcpimpact.scheme.terms import Terms


def is_traced(elements: Sequence[Element]) -> bool:
    """Return whether any constant of some elements is a formula."""
    return any(map(mentions, elements))


def assemble_formulas(elements: Sequence[Element]) -> Dynamics:
    """Return the equations of motion with formulas in place of numbers.

    Their structure, checks included, is that of the values of the formulas.

    Raises
    ------
    NotTracedError
        If the structure or a check depends on more than the signs of the constants.
    """
    dynamics = assemble(list(map(with_values, elements)))
    terms = Terms(dynamics.nodes, kind=object)
    for element in elements:
        if isinstance(element, NegativeSpring) and dynamics.decomposition.static.size:
            raise NotTracedError("what a NegativeSpring outweighs depends on all springs beside it")
        element.contribute(terms)
    u0 = terms.rows.gaps(object)
    refuse_parallel_contacts(terms.rows, u0)
    return replace(
        dynamics,
        M=terms.M.full()[0],
        C=terms.C.full()[0],
        K=terms.K.full()[0],
        u0=u0,
        loads=tuple(terms.loads),
        springs=tuple(terms.springs),
        dashpots=tuple(terms.dashpots),
        motions=dict(terms.motions),
        **law_numbers(terms.rows, object),
    )
