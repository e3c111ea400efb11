"""Assembly of elements whose constants are formulas, and the derivatives of their equations of motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from lcpimpact.arrays import Array
from lcpimpact.formula import FormulaSlopes, NotTracedError, mentions, value_of, with_values
from lcpimpact.scheme.assembly import assemble
from lcpimpact.scheme.checks import refuse_parallel_contacts
from lcpimpact.scheme.dynamics import Dynamics, law_numbers
from lcpimpact.scheme.elements.base import Element
from lcpimpact.scheme.elements.negative_spring import NegativeSpring
from lcpimpact.scheme.first_order import signal_states
from lcpimpact.scheme.signals import Harmonic
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


def slopes_of(dynamics: Dynamics, traced: Dynamics, slopes: FormulaSlopes) -> dict[str, Array]:
    """Return the derivatives (p, ...) of the numbers of a system, as of `Dynamics.slopes`.

    Parameters
    ----------
    dynamics, traced : Dynamics
        The equations of motion, and those with formulas.
    slopes : FormulaSlopes
        The derivatives of formulas.

    Raises
    ------
    NotTracedError
        If the structure, or another number, depends on the parameters.
    """
    if any(map(mentions, (traced.springs, traced.dashpots, traced.force_laws, traced.holds))):
        raise NotTracedError("a force that is not linear depends on the parameters")
    given, states = signal_states(dynamics), signal_states(traced, object)
    if given.G.shape != states.G.shape or any(
        mentions(each) for each in states.sources if not isinstance(each, Harmonic)
    ):
        raise NotTracedError("signals depend on the parameters otherwise than by the constants of a Harmonic")
    names = ("M", "C", "K", "H", "u0", "chi", "B", "D", "restitution", "r_min", "r_max", "mu", "mu_s")
    found = {name: slopes.of(getattr(traced, name)) for name in names}
    found |= {name: slopes.of(getattr(states, name)) for name in ("F", "Y", "G")}
    found["s"] = starts = np.zeros((len(slopes.kept), len(given.G)))
    at = 1
    for signal in states.sources:
        if isinstance(signal, Harmonic):
            φ, φ_p = value_of(signal.phase), slopes.of(np.array([signal.phase], dtype=object))[:, 0]
            starts[:, at], starts[:, at + 1] = -np.sin(φ) * φ_p, np.cos(φ) * φ_p
        at += 2 if isinstance(signal, Harmonic) else signal.degree + 1
    massless = np.hstack([dynamics.decomposition.damped, dynamics.decomposition.static])
    static = dynamics.decomposition.static
    if (found["M"] @ massless).any() or (found["C"] @ static).any() or found["H"].any():
        raise NotTracedError("which coordinates have masses and dashpots depends on the parameters")
    return {name: each for name, each in found.items() if each.any()}
