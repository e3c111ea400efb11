"""Assembly of elements to the equations of motion, with checks of solvability."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from lcpimpact.arrays import Array, Flags
from lcpimpact.errors import InputError
from lcpimpact.scheme.decomposition import decompose, loose_groups, relative_degrees
from lcpimpact.scheme.dynamics import Dynamics, numbers_of
from lcpimpact.scheme.elements.base import Element
from lcpimpact.scheme.signals import PiecewisePolynomial
from lcpimpact.scheme.structure import Contact, Feature, Structure
from lcpimpact.scheme.terms import GROUND, End, PowerLaw, Row, Terms, name_of

MAX_NODES = 10_000
"""Maximum number of nodes: a full matrix takes 800 MB."""

MISSPELT = ("Ground", "GROUND")
"""Names of the ground with capitals, for which a massless node would be taken."""


def assemble(elements: Sequence[Element]) -> Dynamics:
    """Assemble elements to the equations of motion.

    Parameters
    ----------
    elements : sequence of Element
        The scheme; coordinates are ordered as the elements name them.

    Raises
    ------
    InputError
        If a node is held by nothing, pushed over or would jump, bumpers or sliders act in parallel, two reactions or inner
        nodes have one name, a node has two motions, or a coefficient of restitution is missing or meaningless.
    """
    nodes = list(dict.fromkeys(node for element in elements for node in element.nodes if node != GROUND))
    if not nodes:
        raise InputError("the scheme has no element yet: add a Mass, a Spring, ... before it is assembled")
    if len(nodes) > MAX_NODES:
        raise InputError(
            f"the scheme has {len(nodes):,} nodes, and full matrices are kept of {MAX_NODES:,}: model it coarser, "
            "or take SparseScheme if bumpers are its only law"
        )
    _refuse_shared_inner_nodes(elements)
    terms = Terms(nodes)
    for element in elements:
        element.contribute(terms)
    M = terms.M.value
    C = terms.C.value
    K = terms.K.value
    driven = np.zeros(len(nodes), dtype=np.bool_)
    driven[list(terms.motions)] = True
    _refuse_ambiguous_names(nodes, (*terms.rows, *terms.springs))
    _refuse_driven_masses(terms, nodes)
    _refuse_loose_nodes(terms, nodes, driven)
    rows = [terms.direction(row.upper, row.lower) for row in terms.rows]
    H = np.array(rows).reshape(len(rows), len(nodes))
    u0 = np.array([row.gap for row in terms.rows])
    _refuse_bounds(terms.rows)
    refuse_parallel_contacts(terms.rows)
    normals = _normals(terms.rows)
    _refuse_loops_of_sliders(H, terms.rows)
    parts = decompose(M, C, driven)
    _refuse_levers(H, terms.rows, ~(parts.massive.any(axis=1) | driven), nodes)
    _refuse_falling_nodes(K, parts.static, nodes)
    _refuse_jumps(terms, parts.static, nodes)
    _refuse_forces_on_springs(terms, parts.static)
    degrees = relative_degrees(H, parts)
    contacts = tuple(
        Contact(
            row.name,
            upper=name_of(row.upper),
            lower=name_of(row.lower),
            gap=row.gap,
            e=row.e or 0.0,
            relative_degree=degree,
            law=row.law,
            bounds=row.bounds,
            mu=row.mu,
            mu_s=row.mu_s,
            normal=normal,
        )
        for row, degree, normal in zip(terms.rows, degrees, normals, strict=True)
    )
    B, D = H.T.copy(), np.zeros((len(rows), len(rows)))
    residues = (terms.M.residue, terms.C.residue, terms.K.residue)
    for array in (M, C, K, H, u0, B, D, *residues):
        array.flags.writeable = False
    dynamics = Dynamics(
        Structure(tuple(nodes), contacts, parts, B, _causes(terms, nodes)), M=M, C=C, K=K, loads=tuple(terms.loads), H=H,
        u0=u0, chi=np.zeros(len(rows)), B=B, D=D, **numbers_of(contacts), springs=tuple(terms.springs),
        force_laws=tuple(terms.force_laws), motions=dict(terms.motions), residues=residues,
    )  # fmt: skip
    _check_restitution(dynamics, terms.rows)
    return dynamics


def _causes(terms: Terms, nodes: Sequence[str]) -> dict[Feature, str]:
    """Return the features beyond those of masses and rows, with the first element that causes each."""
    causes = {
        Feature.POWER_LAWS: [spring.element for spring in terms.springs],
        Feature.FORCES: [law.element for law in terms.force_laws],
        Feature.MOTIONS: [f"node {nodes[i]!r}" for i in terms.motions],
    }
    return {feature: elements[0] for feature, elements in causes.items() if elements}


def _refuse_shared_inner_nodes(elements: Sequence[Element]) -> None:
    """Refuse two elements that make a node of one name: they would be joined there unasked."""
    makers: dict[str, Element] = {}
    for element in elements:
        for node in element.inner:
            if node in makers:
                raise InputError(
                    f"{makers[node]} and {element} both make a node {node!r}: give one of them another name="
                )
            makers[node] = element


def _refuse_driven_masses(terms: Terms, nodes: Sequence[str]) -> None:
    for i in terms.motions:
        if terms.M.value[i].any():
            raise InputError(
                f"node {nodes[i]!r} has a mass and a prescribed motion, which the mass cannot change: "
                "leave out the Mass or the PrescribedMotion"
            )


def _refuse_loose_nodes(terms: Terms, nodes: Sequence[str], driven: Flags) -> None:
    massless = (np.diag(terms.M.value) == 0.0) & ~driven
    refuse_misspelt_ground(nodes, massless)
    for group in loose_groups(massless, terms.C.value, terms.K.value):
        names = ", ".join(repr(nodes[i]) for i in group)
        raise InputError(
            f"nothing holds node {names}: join it to the ground or to a mass by a Spring or a Dashpot, "
            "or give it a Mass (a Slider, a Bumper or a non-linear spring alone leaves it undetermined)"
        )


def refuse_misspelt_ground(nodes: Sequence[str], massless: Flags) -> None:
    """Refuse a massless node whose name is that of the ground but for capitals: it would move with what it shall hold."""
    for node in (nodes[i] for i in np.flatnonzero(massless).tolist()):
        if node in MISSPELT:
            raise InputError(
                f"node {node!r} has no mass: did you mean {GROUND!r}? Else give it another name, or a Mass"
            )


def _refuse_falling_nodes(K: Array, static: Array, nodes: Sequence[str]) -> None:
    """Refuse quasi-static nodes with a stiffness that is not positive: no equilibrium is stable."""
    if static.size == 0:
        return
    stiffness = static.T @ K @ static
    scale = np.sqrt(np.abs(np.diag(stiffness)))
    values, vectors = np.linalg.eigh(stiffness / np.outer(scale, scale))
    if values[0] <= 8.0 * np.finfo(float).eps:
        node = nodes[int(np.argmax(np.abs(static @ (vectors[:, 0] / scale))))]
        raise InputError(
            f"node {node!r} has neither mass nor dashpot, and the NegativeSpring at it outweighs the springs that hold it: "
            "give it a Mass, or a stiffer Spring"
        )


def _refuse_jumps(terms: Terms, static: Array, nodes: Sequence[str]) -> None:
    """Raise an error for loads that jump at quasi-static nodes: their positions would jump, with undetermined work."""
    for i, load in terms.loads:
        if isinstance(load, PiecewisePolynomial) and not load.continuous and static[i].any():
            raise InputError(
                f"the load on {nodes[i]!r} jumps, and so would that node, which is quasi-static (held by springs only): "
                "give it a Mass or a Dashpot, or increase the load gradually by a Ramp or a Table"
            )


def _refuse_forces_on_springs(terms: Terms, static: Array) -> None:
    """Refuse general forces at quasi-static nodes, whose places would be solutions of equations."""
    for law in terms.force_laws:
        for node in law.nodes:
            if static[terms.index[node]].any():
                raise InputError(
                    f"{law.element}: {node!r} is quasi-static (held by springs only), so that its place would be the "
                    "solution of an equation; give the node a Mass or a Dashpot"
                )


def _refuse_ambiguous_names(nodes: Sequence[str], rows: Sequence[Row | PowerLaw]) -> None:
    """Raise an error for two series of one name: coordinates, v_NAME, reactions, t and t_R."""
    owners = {"t": "the time", "t_R": "the times of the reactions"}
    names = [
        *((node, f"node {node!r}") for node in nodes),
        *((f"v_{node}", f"the velocity of {node!r}") for node in nodes),
    ]
    names += [(row.name, f"the {'reaction' if isinstance(row, Row) else 'force'} of {row.element}") for row in rows]
    for name, what in names:
        if owners.get(name) == what:
            raise InputError(f"two forces have the same name {name!r}, each {what}: rename one by name=")
        if name in owners:
            raise InputError(f"{what} and {owners[name]} have the same name {name!r}: rename one, a force by name=")
        owners[name] = what


def _normals(rows: Sequence[Row]) -> list[int]:
    """Return the row of the normal force of each row; -1 for all but friction."""
    bumpers = {row.name: i for i, row in enumerate(rows) if row.impenetrable}
    for row in rows:
        if row.law.tangential and row.normal not in bumpers:
            other = next((each.element for each in rows if each.name == row.normal), "")
            told = f", which is {other} and no bumper" if other else ""
            known = f"; the bumpers are {', '.join(map(repr, bumpers))}" if bumpers else "; add a Bumper"
            raise InputError(f"{row.element}: its normal force is that of {row.normal!r}{told}{known}")
    return [bumpers[row.normal] if row.law.tangential else -1 for row in rows]


def _refuse_levers(H: Array, rows: Sequence[Row], massless: Flags, nodes: Sequence[str]) -> None:
    """Refuse levers at massless nodes, whose balances are sums of forces with whole numbers."""
    levers = (np.abs(H) != 1.0) & (H != 0.0) & massless
    for i, j in np.argwhere(levers) if levers.any() else ():
        raise InputError(
            f"{rows[i].element}: {nodes[j]!r} has the coefficient {abs(H[i, j]):g} and no mass, so that its forces balance "
            "by levers: give it a Mass, or the coefficient 1"
        )


def refuse_parallel_contacts(rows: Sequence[Row]) -> None:
    """Refuse bumpers that can be closed together while their rows of H depend on each other: W would be singular.

    Bumpers in a loop have dependent rows; all of them can be closed at once if their signed gaps around the loop add up to
    zero. A body between two stops is a loop too, but its gaps do not add up to zero.
    """
    bumpers = [row for row in rows if row.impenetrable and isinstance(row.upper, str) and isinstance(row.lower, str)]
    for i, bumper in enumerate(bumpers):
        for path, opening in _paths(bumper.lower, bumper.upper, bumpers[:i]):
            total = bumper.gap + opening
            if abs(total) <= 1e-12 * (abs(bumper.gap) + abs(opening)):
                others = ", ".join(repr(each.name) for each in path)
                raise InputError(
                    f"{bumper.element}: bumper {bumper.name!r} acts in parallel with {others}, so the individual "
                    "reactions are undetermined (W is singular); remove one of them"
                )


def _paths(start: End, end: End, bumpers: Sequence[Row]) -> Iterator[tuple[tuple[Row, ...], float]]:
    """Yield every path from one node to another over bumpers, with the sum of the gaps, positive from upper to lower."""
    if start == end:
        yield (), 0.0
        return
    for i, bumper in enumerate(bumpers):
        rest = [*bumpers[:i], *bumpers[i + 1 :]]
        for here, there, sign in ((bumper.upper, bumper.lower, 1.0), (bumper.lower, bumper.upper, -1.0)):
            if here == start:
                beyond = [each for each in rest if start not in (each.upper, each.lower)]
                for path, opening in _paths(there, end, beyond):
                    yield (bumper, *path), sign * bumper.gap + opening


def _refuse_bounds(rows: Sequence[Row]) -> None:
    """Refuse a half-line that does not begin at zero, whose bound would be no impulse."""
    for row in rows:
        low, high = row.bounds
        if math.isinf(low) != math.isinf(high) and (low, high) != (0.0, math.inf):
            raise InputError(
                f"{row.element}: its reaction has the bounds {low:g} and {high:g}, and a row has 0 and inf, two finite ones "
                "or none: count r from its finite bound, upwards"
            )


def _refuse_loops_of_sliders(H: Array, rows: Sequence[Row]) -> None:
    """Refuse sliders, or rows of the rate like them, whose rows of H depend on each other: they can all stick."""
    sliders = [i for i, row in enumerate(rows) if row.law.of_rate and not row.law.tangential]
    if not sliders or np.linalg.matrix_rank(H[sliders]) == len(sliders):
        return
    first = next(n for n in range(1, len(sliders) + 1) if np.linalg.matrix_rank(H[sliders[:n]]) < n)
    row = rows[sliders[first - 1]]
    raise InputError(
        f"{row.element}: {row.law.name} {row.name!r} closes a loop with others, so the individual forces are undetermined "
        f"(W is singular); {'add its r0 to another and ' if row.limited else ''}remove it"
    )


def _check_restitution(dynamics: Dynamics, rows: Sequence[Row]) -> None:
    """Raise an error for a contact on an impulse path without e, and for one off all paths with e."""
    for i, (row, contact) in enumerate(zip(rows, dynamics.contacts, strict=True)):
        if row.law.tangential:
            if contact.relative_degree == 0:
                raise InputError(
                    f"{row.element}: a surface is quasi-static (held by springs only), so its friction has no rate to act "
                    "on: give its node a Mass or a Dashpot"
                )
            if row.mu_s > row.mu and contact.relative_degree < 2:
                raise InputError(
                    f"{row.element}: mu_s = {row.mu_s!r} has no memory to act on, since a surface is massless and its rate "
                    "jumps; give its node a Mass, or leave mu_s out"
                )
            if row.e and contact.relative_degree < 2:
                raise InputError(
                    f"{row.element}: e_T = {row.e!r} means nothing, since a surface is massless and no impulse acts; leave "
                    "e_T out"
                )
            continue
        paths = dynamics.impulse_paths[dynamics.impulse_paths[:, i] > 0.0]
        if row.e is None and row.impenetrable and contact.relative_degree == 2:
            raise InputError(f"{row.element}: both sides have mass, so impacts need a restitution coefficient; give e=")
        if row.e is None and len(paths):
            others = ", ".join(repr(rows[j].name) for j in map(int, np.flatnonzero(paths[0])) if j != i)
            raise InputError(
                f"{row.element}: once {row.name!r} and {others} are all closed, impulses pass through the nodes without "
                "mass between them, so impacts need a restitution coefficient; give e="
            )
        if row.e is not None and contact.relative_degree < 2 and not len(paths):
            raise InputError(
                f"{row.element}: e = {row.e!r} means nothing, since the contact plate is massless, on a spring or dashpot "
                f"(relative degree {contact.relative_degree}) and no impulse acts; leave e out"
            )
