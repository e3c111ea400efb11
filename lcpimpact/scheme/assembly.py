"""From a list of elements to the equations of motion, refusing by name what cannot be solved."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from lcpimpact.errors import InputError
from lcpimpact.scheme.decomposition import decompose, loose_groups, relative_degrees
from lcpimpact.scheme.dynamics import Contact, Dynamics
from lcpimpact.scheme.elements.base import GROUND, Element
from lcpimpact.scheme.elements.bumper import Bumper
from lcpimpact.scheme.terms import Terms


def assemble(elements: Sequence[Element]) -> Dynamics:
    """Assemble elements to the equations of motion.

    Parameters
    ----------
    elements : sequence of Element
        The scheme; coordinates are ordered as the elements name them.

    Raises
    ------
    InputError
        If a node is held by nothing, bumpers act in parallel, two reactions have one name, or a coefficient of
        restitution is missing or meaningless.
    """
    nodes = list(dict.fromkeys(node for element in elements for node in element.nodes if node != GROUND))
    if not nodes:
        raise InputError("the scheme has no element yet: add a Mass, a Spring, ... before it is assembled")
    terms = Terms(nodes)
    for element in elements:
        element.contribute(terms)
    _refuse_ambiguous_names(nodes, terms.bumpers)
    _refuse_loose_nodes(terms, nodes)
    rows = [terms.direction(bumper.upper, bumper.lower) for bumper in terms.bumpers]
    H = np.array(rows).reshape(len(rows), len(nodes))
    u0 = np.array([float(bumper.gap) for bumper in terms.bumpers])
    _refuse_parallel_contacts(terms.bumpers)
    degrees = relative_degrees(H, decompose(terms.M, terms.C))
    contacts = tuple(_contact(bumper, degree) for bumper, degree in zip(terms.bumpers, degrees, strict=True))
    for array in (terms.M, terms.C, terms.K, H, u0):
        array.flags.writeable = False
    return Dynamics(tuple(nodes), terms.M, terms.C, terms.K, tuple(terms.loads), H, u0, contacts)


def _refuse_loose_nodes(terms: Terms, nodes: Sequence[str]) -> None:
    for group in loose_groups(terms.C + terms.K, np.diag(terms.M) == 0.0):
        names = ", ".join(repr(nodes[i]) for i in group)
        raise InputError(
            f"nothing holds node {names}: join it to the ground or to a mass by a Spring or a Dashpot, "
            "or give it a Mass"
        )


def _refuse_ambiguous_names(nodes: Sequence[str], bumpers: Sequence[Bumper]) -> None:
    """Refuse two series of one name, since results are read by name: coordinates, v_NAME, reactions, t and t_R."""
    taken = {"t": "the time", "t_R": "the times of the reactions"}
    names = [
        *((node, f"node {node!r}") for node in nodes),
        *((f"v_{node}", f"the velocity of {node!r}") for node in nodes),
    ]
    names += [(bumper.name, f"the reaction of {bumper}") for bumper in bumpers]
    for name, what in names:
        if name in taken:
            raise InputError(f"{what} and {taken[name]} have one name, {name!r}: rename one, a reaction by name=")
        taken[name] = what


def _refuse_parallel_contacts(bumpers: Sequence[Bumper]) -> None:
    """Refuse bumpers that can be closed together while their rows of H depend on each other: W would be singular.

    Rows of H depend where bumpers form a loop, and around a loop the gaps with their signs add up to zero if all of them
    can be closed at once. A body between two stops is a loop too, but its gaps do not add up to zero.
    """
    for i, bumper in enumerate(bumpers):
        for path, opening in _paths(bumper.lower, bumper.upper, bumpers[:i]):
            total = bumper.gap + opening
            if abs(total) <= 1e-12 * (abs(bumper.gap) + abs(opening)):
                others = ", ".join(repr(each.name) for each in path)
                raise InputError(
                    f"{bumper}: bumper {bumper.name!r} acts in parallel with {others}, so the share of each in the "
                    "reaction is undetermined (W is singular); take one of them out"
                )


def _paths(start: str, end: str, bumpers: Sequence[Bumper]) -> Iterator[tuple[tuple[Bumper, ...], float]]:
    """Yield every way from one node to another over bumpers, with the sum of the gaps, positive from upper to lower."""
    if start == end:
        yield (), 0.0
        return
    for i, bumper in enumerate(bumpers):
        rest = [*bumpers[:i], *bumpers[i + 1 :]]
        for here, there, sign in ((bumper.upper, bumper.lower, 1.0), (bumper.lower, bumper.upper, -1.0)):
            if here == start:
                beyond = [each for each in rest if start not in each.nodes]
                for path, opening in _paths(there, end, beyond):
                    yield (bumper, *path), sign * bumper.gap + opening


def _contact(bumper: Bumper, degree: int) -> Contact:
    if degree == 2 and bumper.e is None:
        raise InputError(f"{bumper}: both sides have mass, so impacts need a restitution coefficient; give e=")
    if degree < 2 and bumper.e is not None:
        raise InputError(
            f"{bumper}: e = {bumper.e!r} means nothing, since a spring or dashpot gives way under a massless plate "
            f"(relative degree {degree}) and no impulse acts; leave e out"
        )
    e = 0.0 if bumper.e is None else float(bumper.e)
    return Contact(bumper.name, bumper.upper, bumper.lower, float(bumper.gap), e, degree)
