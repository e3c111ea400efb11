"""From a list of elements to the equations of motion, refusing by name what cannot be solved."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from lcpimpact.arrays import Array
from lcpimpact.errors import InputError
from lcpimpact.scheme.decomposition import decompose, loose_groups, relative_degrees
from lcpimpact.scheme.dynamics import Contact, Dynamics
from lcpimpact.scheme.elements.base import GROUND, Element
from lcpimpact.scheme.elements.bumper import Bumper
from lcpimpact.scheme.elements.load import Harmonic


class Assembly:
    """The system while elements add their terms to it.

    Attributes
    ----------
    index : dict of str to int      position of each node in q
    M, C, K : (n, n) arrays         what has been added so far
    loads : list                    index of the node and the load
    """

    def __init__(self, nodes: Sequence[str]) -> None:
        n = len(nodes)
        self.index = {node: i for i, node in enumerate(nodes)}
        self.M, self.C, self.K = np.zeros((n, n)), np.zeros((n, n)), np.zeros((n, n))
        self.loads: list[tuple[int, float | Harmonic | Callable[[float], float]]] = []
        self.bumpers: list[Bumper] = []

    def direction(self, a: str, b: str) -> Array:
        """Return the row (n,) for which row·q = q_b - q_a; the ground does not move."""
        row = np.zeros(len(self.index))
        if b != GROUND:
            row[self.index[b]] += 1.0
        if a != GROUND:
            row[self.index[a]] -= 1.0
        return row

    def link(self, matrix: Array, a: str, b: str, value: float) -> None:
        """Add ``value`` times the square of (q_b - q_a) to the quadratic form of ``matrix``."""
        d = self.direction(a, b)
        matrix += value * np.outer(d, d)

    def add_contact(self, bumper: Bumper) -> None:
        """Add a unilateral row."""
        self.bumpers.append(bumper)


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
    system = Assembly(nodes)
    for element in elements:
        element.contribute(system)
    _refuse_loose_nodes(system, nodes)
    rows = [system.direction(bumper.upper, bumper.lower) for bumper in system.bumpers]
    H = np.array(rows).reshape(len(rows), len(nodes))
    u0 = np.array([float(bumper.gap) for bumper in system.bumpers])
    _refuse_ambiguous_contacts(system.bumpers, H, u0)
    degrees = relative_degrees(H, decompose(system.M, system.C))
    contacts = tuple(_contact(bumper, degree) for bumper, degree in zip(system.bumpers, degrees, strict=True))
    for array in (system.M, system.C, system.K, H, u0):
        array.flags.writeable = False
    return Dynamics(tuple(nodes), system.M, system.C, system.K, tuple(system.loads), H, u0, contacts)


def _refuse_loose_nodes(system: Assembly, nodes: Sequence[str]) -> None:
    for group in loose_groups(system.C + system.K, np.diag(system.M) == 0.0):
        names = ", ".join(repr(nodes[i]) for i in group)
        raise InputError(
            f"nothing holds node {names}: join it to the ground or to a mass by a Spring or a Dashpot, "
            "or give it a Mass"
        )


def _refuse_ambiguous_contacts(bumpers: Sequence[Bumper], H: Array, u0: Array) -> None:
    """Refuse bumpers that can be closed together while their rows of H depend on each other: W would be singular."""
    seen: list[str] = []
    for i, bumper in enumerate(bumpers):
        if bumper.name in seen:
            raise InputError(f"{bumper}: the reaction name {bumper.name!r} is taken; give each bumper its own name=")
        seen.append(bumper.name)
        rows = np.column_stack([H, u0])[: i + 1]
        if np.linalg.matrix_rank(rows) < i + 1:
            raise InputError(
                f"{bumper}: bumper {bumper.name!r} acts in parallel with {', '.join(map(repr, seen[:-1]))}, so the "
                "share of each in the reaction is undetermined (W is singular); take one of them out"
            )


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
