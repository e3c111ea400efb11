"""The checks of a scheme when it is assembled, on the entries of its matrices: what has no solution is refused by name."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple, NoReturn

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from lcpimpact.arrays import Array, Flags, Indices
from lcpimpact.errors import InputError, UnsupportedError
from lcpimpact.numerics.rounding import EPS
from lcpimpact.scheme.decomposition import NodeKinds, loose_groups
from lcpimpact.scheme.elements.base import Element
from lcpimpact.scheme.signals import jumps
from lcpimpact.scheme.terms import GROUND, ConstraintRows, MatrixEntries, PowerLaw, Row, Terms, entries_of

MISSPELT = ("Ground", "GROUND")
"""Names of the ground with capitals, for which a massless node would be taken."""


@dataclass(frozen=True, eq=False)
class Assembled:
    """The terms of a scheme, summed.

    Attributes
    ----------
    terms : Terms
    nodes : sequence of str
    M, C, K, H : MatrixEntries
    kinds : NodeKinds
    degrees : (nc,) array       relative degree of each row
    """

    terms: Terms
    nodes: Sequence[str]
    M: MatrixEntries
    C: MatrixEntries
    K: MatrixEntries
    H: MatrixEntries
    kinds: NodeKinds
    degrees: Indices

    @property
    def rows(self) -> ConstraintRows:
        """The rows of H."""
        return self.terms.rows


def refuse_shared_inner_nodes(elements: Sequence[Element]) -> None:
    """Refuse two elements that make a node of one name: they would be joined there unasked."""
    makers: dict[str, Element] = {}
    for element in elements:
        for node in element.inner:
            if node in makers:
                raise InputError(
                    f"{makers[node]} and {element} both make a node {node!r}: give one of them another name="
                )
            makers[node] = element


def refuse_unsolvable(scheme: Assembled) -> None:
    """Refuse a scheme whose motion is undetermined, or not that of its equations."""
    terms = scheme.terms
    _refuse_ambiguous_names(scheme.nodes, terms)
    _refuse_driven_masses(scheme)
    _refuse_loose_nodes(scheme)
    _refuse_bounds(terms.rows)
    refuse_parallel_contacts(terms.rows, terms.rows.gaps())
    _refuse_loops_of_sliders(terms)
    _refuse_levers(scheme)
    _refuse_falling_nodes(scheme)
    _refuse_jumps(scheme)
    _refuse_forces_on_springs(scheme)
    _refuse_holds_without_mass(scheme)


def _listed(names: Sequence[str], most: int = 5) -> str:
    """Return names as a list in a message, of which others are counted."""
    shown = ", ".join(repr(name) for name in names[:most])
    return shown if len(names) <= most else f"{shown} and {len(names) - most:,} others"


def _refuse_ambiguous_names(nodes: Sequence[str], terms: Terms) -> None:
    """Raise an error for two series of one name: coordinates, v_NAME, reactions, t and t_R."""
    forces = [*terms.rows.names, *(spring.name for spring in terms.springs)]
    names = ["t", "t_R", *nodes, *(f"v_{node}" for node in nodes), *forces]
    if len(set(names)) == len(names):
        return
    owners = {"t": "the time", "t_R": "the times of the reactions"}
    for name, what in _described(nodes, terms):
        if owners.get(name) == what:
            raise InputError(f"two forces have the same name {name!r}, each {what}: rename one by name=")
        if name in owners:
            raise InputError(f"{what} and {owners[name]} have the same name {name!r}: rename one, a force by name=")
        owners[name] = what


def _described(nodes: Sequence[str], terms: Terms) -> Iterator[tuple[str, str]]:
    """Yield the name of each series with what it is."""
    yield from ((node, f"node {node!r}") for node in nodes)
    yield from ((f"v_{node}", f"the velocity of {node!r}") for node in nodes)
    forces: list[tuple[str, Iterable[Row | PowerLaw]]] = [("reaction", terms.rows), ("force", terms.springs)]
    for kind, rows in forces:
        yield from ((row.name, f"the {kind} of {row.element}") for row in rows)


def _refuse_driven_masses(scheme: Assembled) -> None:
    heavy = scheme.M.row[scheme.kinds.driven[scheme.M.row]]
    if len(heavy):
        raise InputError(
            f"node {scheme.nodes[heavy[0]]!r} has a mass and a prescribed motion, which the mass cannot change: "
            "leave out the Mass or the PrescribedMotion"
        )


def _refuse_loose_nodes(scheme: Assembled) -> None:
    """Refuse massless nodes that nothing holds; one with the name of the ground but for capitals is misspelt."""
    nodes = scheme.nodes
    massless = scheme.kinds.massless
    for node in (nodes[i] for i in np.flatnonzero(massless).tolist()):
        if node in MISSPELT:
            raise InputError(
                f"node {node!r} has no mass: did you mean {GROUND!r}? Else give it another name, or a Mass"
            )
    for group in loose_groups(massless, scheme.C, scheme.K):
        raise InputError(
            f"nothing holds node {_listed([nodes[i] for i in group])}: join it to the ground or to a mass by a Spring or a "
            "Dashpot, or give it a Mass (a Slider, a Bumper or a non-linear spring alone leaves it undetermined)"
        )


def _refuse_falling_nodes(scheme: Assembled) -> None:
    """Refuse quasi-static nodes with a stiffness that is not positive: no equilibrium is stable."""
    groups = scheme.kinds.groups
    group = scheme.kinds.group
    if not groups:
        return
    held = scheme.K.at(group >= 0, group >= 0)
    at = group[held.row], group[held.column]
    stiffness = sparse.coo_array((held.value, at), shape=(len(groups), len(groups))).tocsc()
    if (low := _low_pivots(stiffness)).any():
        node = scheme.nodes[groups[int(np.argmax(low))][0]]
        raise InputError(
            f"node {node!r} has neither mass nor dashpot, and the NegativeSpring at it outweighs the springs that hold it: "
            "give it a Mass, or a stiffer Spring"
        )


def _low_pivots(stiffness: sparse.csc_array, rounding: float = 8.0 * EPS) -> Flags:
    """Return the flags of pivots that are not positive; they are relative, since a soft spring is no falling node."""
    pivots = np.asarray(stiffness.diagonal())
    if not (pivots > 0.0).all() or not (stiffness - sparse.diags_array(pivots)).count_nonzero():
        return ~(pivots > 0.0)
    unit = sparse.diags_array(1.0 / np.sqrt(pivots))
    scaled = (unit @ stiffness @ unit).tocsc()
    try:
        factor = splu(scaled, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    except RuntimeError:
        return np.ones(len(pivots), dtype=np.bool_)
    # A row that takes another's place had the pivot zero.
    pivots = np.where(factor.perm_r == factor.perm_c, factor.U.diagonal()[factor.perm_c], 0.0)
    return ~(pivots > rounding)


def _refuse_jumps(scheme: Assembled) -> None:
    """Raise an error for loads that jump at quasi-static nodes: their positions would jump, with undetermined work."""
    terms = scheme.terms
    loads = [(np.array([i]), load) for i, load in terms.loads]
    loads += [(at[factors != 0.0], load) for at, factors, load in terms.load_arrays]
    for at, load in loads:
        if jumps(load):
            for i in at[scheme.kinds.group[at] >= 0]:
                raise InputError(
                    f"the load on {scheme.nodes[i]!r} jumps, and so would that node, which is quasi-static (held by springs "
                    "only): give it a Mass or a Dashpot, or increase the load gradually by a Ramp or a Table"
                )


def _refuse_forces_on_springs(scheme: Assembled) -> None:
    """Refuse general forces at quasi-static nodes, whose places would be solutions of equations."""
    for law in scheme.terms.force_laws:
        for node in law.nodes:
            if scheme.kinds.group[scheme.terms.index[node]] >= 0:
                raise InputError(
                    f"{law.element}: {node!r} is quasi-static (held by springs only), so that its place would be the "
                    "solution of an equation; give the node a Mass or a Dashpot"
                )


def _refuse_holds_without_mass(scheme: Assembled) -> None:
    """Refuse sampled forces at nodes without mass, whose velocity at an instant would depend on what is set there."""
    for held in scheme.terms.holds:
        for i in held.at:
            if scheme.kinds.massless[i]:
                raise InputError(
                    f"{held.law.element}: {scheme.nodes[i]!r} has no mass, so that its velocity at an instant would depend "
                    "on the force that is set there; give the node a Mass"
                )


def refuse_undetermined_rates(scheme: Assembled, C: Array) -> None:
    """Refuse non-linear dashpots that leave the rate of a massless node undetermined, and those that alone hold one.

    ``C`` is the damping matrix of the linear dashpots.
    """
    terms, group = scheme.terms, scheme.kinds.group
    for law in terms.dashpots:
        ends = [terms.index[node] for node in (law.a, law.b) if node != GROUND]
        for i in ends:
            if group[i] >= 0 and len({int(group[j]) for j in ends}) + (len(ends) < 2) > 1:
                raise InputError(
                    f"{law.element}: its force does not rise with the rate everywhere, so that the rate of "
                    f"{scheme.nodes[i]!r}, which has no mass, is undetermined: put a Dashpot beside it, or give it a Mass"
                )
    loose = loose_groups(scheme.kinds.massless, entries_of(C), scheme.K) if terms.dashpots else []
    for nodes in loose:
        raise InputError(
            f"node {scheme.nodes[nodes[0]]!r} has no mass, and a non-linear dashpot alone holds it: put a Spring or a "
            "Dashpot beside that, or give the node a Mass"
        )


def normals_of(rows: ConstraintRows) -> list[int]:
    """Return the row of the normal force of each row; -1 for all but friction."""
    normals = [-1] * len(rows)
    if not any(row.law.tangential for _, row in rows.single()):
        return normals
    names = rows.names
    bumpers = {names[i]: i for i in np.flatnonzero(rows.impenetrable).tolist()}
    for i, row in rows.single():
        if not row.law.tangential:
            continue
        if row.normal not in bumpers:
            other = next((each.element for _, each in rows.single() if each.name == row.normal), "")
            told = f", which is {other} and no bumper" if other else ""
            known = f"; the bumpers are {', '.join(map(repr, bumpers))}" if bumpers else "; add a Bumper"
            raise InputError(f"{row.element}: its normal force is that of {row.normal!r}{told}{known}")
        normals[i] = bumpers[row.normal]
    return normals


def _refuse_levers(scheme: Assembled) -> None:
    """Refuse levers at massless nodes, whose balances are sums of forces with whole numbers."""
    H = scheme.H
    for k in np.flatnonzero(scheme.kinds.massless[H.column] & (np.abs(H.value) != 1.0)):
        raise InputError(
            f"{scheme.rows[H.row[k]].element}: {scheme.nodes[H.column[k]]!r} has the coefficient {abs(H.value[k]):g} and no "
            "mass, so that its forces balance by levers: give it a Mass, or the coefficient 1"
        )


def refuse_parallel_contacts(rows: ConstraintRows, gaps: Array, *, few: int = 10, rounding: float = 1e-12) -> None:
    """Refuse bumpers that can be closed together while their rows of H depend on each other: W would be singular.

    Bumpers in a loop have dependent rows; all of them can be closed at once if their signed gaps around the loop add up to
    zero. A body between two stops is a loop too, but its gaps do not add up to zero. Bumpers join nodes to trees, in which
    each node has its distance from the root when all bumpers are closed, and a bumper closes a first loop if it joins two
    nodes of a tree. Other loops are looked for if there are ``few``; a contact problem that is singular for another
    reason ends the run. ``rounding``: error of the sum of gaps around a loop, relative to its terms.
    """
    if len(rows) < 2:
        return
    upper, lower = (each.tolist() for each in rows.ends)
    opening = gaps.tolist()
    bumpers = [i for i in np.flatnonzero(rows.impenetrable).tolist() if upper[i] >= -1 and lower[i] >= -1]
    trees = Trees(len(rows.places))
    loops = 0
    for k, i in enumerate(bumpers):
        loop = trees.join(upper[i], lower[i], opening[i])
        if loop is None:
            continue
        loops += 1
        above, below = loop
        if abs(opening[i] + below - above) <= rounding * (abs(opening[i]) + abs(above) + abs(below)):
            edges = [Edge(j, upper[j], lower[j], opening[j]) for j in bumpers[: k + 1]]
            _refuse_loop(rows, edges[-1], _way(edges[-1], edges[:-1]))
    if not 1 < loops <= few or len(bumpers) > few * few:
        return
    edges = [Edge(j, upper[j], lower[j], opening[j]) for j in bumpers]
    for k, edge in enumerate(edges):
        for path, total in _paths(edge.lower, edge.upper, edges[:k]):
            if abs(edge.gap + total) <= rounding * (abs(edge.gap) + abs(total)):
                _refuse_loop(rows, edge, path)


class Edge(NamedTuple):
    """A bumper between two nodes: its row, the nodes by their places, the ground as -1, and its gap."""

    row: int
    upper: int
    lower: int
    gap: float


class Trees:
    """Nodes and the ground, joined by bumpers to trees, with the distance of each from its root while bumpers are closed.

    Parameters
    ----------
    count : int     number of nodes; the ground is the node -1, the last of the lists
    """

    def __init__(self, count: int) -> None:
        self._parent = [*range(count), -1]
        self._distance: list[float] = [0.0] * (count + 1)

    def _root(self, i: int) -> tuple[int, float]:
        """Return the root of a node and the distance from it, and hang the node there."""
        parent = self._parent
        if parent[i] == i:
            return i, 0.0
        path = []
        while parent[i] != i:
            path.append(i)
            i = parent[i]
        total = 0.0
        for j in reversed(path):
            total += self._distance[j]
            parent[j] = i
            self._distance[j] = total
        return i, total

    def join(self, a: int, b: int, gap: float) -> tuple[float, float] | None:
        """Join the trees of the two nodes of a bumper, or return the distances of both from the root of their tree."""
        upper, above = self._root(a)
        lower, below = self._root(b)
        if upper == lower:
            return above, below
        self._parent[lower] = upper
        self._distance[lower] = above - gap - below
        return None


def _refuse_loop(rows: ConstraintRows, edge: Edge, path: Sequence[Edge]) -> NoReturn:
    row = rows[edge.row]
    others = _listed([rows[each.row].name for each in path])
    raise InputError(
        f"{row.element}: bumper {row.name!r} acts in parallel with {others}, so the individual reactions are undetermined "
        "(W is singular); remove one of them"
    )


def _way(edge: Edge, edges: Sequence[Edge]) -> list[Edge]:
    """Return the bumpers that lead from the lower end of a bumper to its upper one, none of which closes a loop."""
    trees = Trees(1 + max(max(each.upper, each.lower) for each in (edge, *edges)))
    joined = [each for each in edges if trees.join(each.upper, each.lower, each.gap) is None]
    beside: dict[int, list[tuple[int, Edge]]] = {}
    for each in joined:
        beside.setdefault(each.upper, []).append((each.lower, each))
        beside.setdefault(each.lower, []).append((each.upper, each))
    ways: dict[int, list[Edge]] = {edge.upper: []}
    ahead = [edge.upper]
    while edge.lower not in ways:
        here = ahead.pop()
        for there, each in beside[here]:
            if there not in ways:
                ways[there] = [each, *ways[here]]
                ahead.append(there)
    return ways[edge.lower]


def _paths(start: int, end: int, edges: Sequence[Edge]) -> Iterator[tuple[tuple[Edge, ...], float]]:
    """Yield every path from one node to another over bumpers, with the sum of the gaps, positive from upper to lower."""
    if start == end:
        yield (), 0.0
        return
    for i, edge in enumerate(edges):
        rest = [*edges[:i], *edges[i + 1 :]]
        for here, there, sign in ((edge.upper, edge.lower, 1.0), (edge.lower, edge.upper, -1.0)):
            if here == start:
                beyond = [each for each in rest if start not in (each.upper, each.lower)]
                for path, opening in _paths(there, end, beyond):
                    yield (edge, *path), sign * edge.gap + opening


def _refuse_bounds(rows: ConstraintRows) -> None:
    """Refuse a half-line that does not begin at zero, whose bound would be no impulse."""
    for _, row in rows.single():
        low, high = row.bounds
        if math.isinf(low) != math.isinf(high) and (low, high) != (0.0, math.inf):
            raise InputError(
                f"{row.element}: its reaction has the bounds {low:g} and {high:g}, and a row has 0 and inf, two finite ones "
                "or none: count r from its finite bound, upwards"
            )


def _refuse_loops_of_sliders(terms: Terms) -> None:
    """Refuse sliders, or rows of the rate like them, whose rows of H depend on each other: they can all stick."""
    sliders = [row for _, row in terms.rows.single() if row.law.of_rate and not row.law.tangential]
    H = np.array([terms.direction(row.upper, row.lower) for row in sliders])
    if not sliders or np.linalg.matrix_rank(H) == len(sliders):
        return
    first = next(n for n in range(1, len(sliders) + 1) if np.linalg.matrix_rank(H[:n]) < n)
    row = sliders[first - 1]
    raise InputError(
        f"{row.element}: {row.law.name} {row.name!r} closes a loop with others, so the individual forces are undetermined "
        f"(W is singular); {'add its r0 to another and ' if row.limited else ''}remove it"
    )


def refuse_restitution(scheme: Assembled, paths: Array) -> None:
    """Raise an error for a contact on an impulse path without e, and for one off all paths with e.

    Parameters
    ----------
    scheme : Assembled
    paths : (np, nc) array      the impulse paths that lead over nodes without mass
    """
    rows = scheme.rows
    e = rows.e
    given = ~np.isnan(e)
    massive = scheme.degrees == 2
    crossed = (paths > 0.0).any(axis=0)
    impenetrable = rows.impenetrable
    suspect = (given & ~massive & ~crossed) | (~given & (crossed | (impenetrable & massive)))
    tangential = [i for i, row in rows.single() if row.law.tangential]
    suspect[tangential] = True
    for i in np.flatnonzero(suspect).tolist():
        row = rows[i]
        if row.law.tangential:
            _check_friction(row, int(scheme.degrees[i]))
        elif not given[i] and impenetrable[i] and massive[i]:
            raise InputError(f"{row.element}: both sides have mass, so impacts need a restitution coefficient; give e=")
        elif not given[i]:
            path = paths[paths[:, i] > 0.0][0]
            others = ", ".join(repr(rows[j].name) for j in map(int, np.flatnonzero(path)) if j != i)
            raise InputError(
                f"{row.element}: once {row.name!r} and {others} are all closed, impulses pass through the nodes without "
                "mass between them, so impacts need a restitution coefficient; give e="
            )
        else:
            raise InputError(
                f"{row.element}: e = {row.e!r} means nothing, since the contact plate is massless, on a spring or dashpot "
                f"(relative degree {scheme.degrees[i]}) and no impulse acts; leave e out"
            )


def _check_friction(row: Row, degree: int) -> None:
    """Refuse friction on surfaces that are quasi-static, and what impulses alone have of it on other massless ones."""
    if degree == 0:
        raise InputError(
            f"{row.element}: a surface is quasi-static (held by springs only), so its friction has no rate to act "
            "on: give its node a Mass or a Dashpot"
        )
    if row.mu_s > row.mu and degree < 2:
        raise InputError(
            f"{row.element}: mu_s = {row.mu_s!r} has no memory to act on, since a surface is massless and its rate "
            "jumps; give its node a Mass, or leave mu_s out"
        )
    if row.e and degree < 2:
        raise InputError(
            f"{row.element}: e_T = {row.e!r} means nothing, since a surface is massless and no impulse acts; leave e_T out"
        )


# ---- what sparse steps do not take --------------------------------------------------------------------------------------


def refuse_other_laws(terms: Terms, take: str) -> None:
    """Refuse elements that only steps with full matrices take; ``take`` says what to do."""
    others = [f"{row.element} (a {row.law.name})" for _, row in terms.rows.single() if not row.impenetrable]
    others += [each.element for each in terms.springs] + [each.element for each in terms.dashpots]
    others += [each.element for each in terms.force_laws] + [each.law.element for each in terms.holds]
    if others:
        raise UnsupportedError(
            f"sparse steps take masses, springs, dashpots, loads, motions and bumpers, and not {others[0]}: {take}"
        )


def refuse_impulse_paths(scheme: Assembled, take: str) -> None:
    """Refuse contacts through which impulses can pass from mass to mass over nodes without mass.

    The impulses on a massless node must balance. So where all of them act in one direction they are zero, and those
    contacts are none of a path; what remains, once these are taken away again and again, may be one.
    """
    count = len(scheme.nodes)
    massless = scheme.kinds.massless[scheme.H.column]
    row = scheme.H.row[massless]
    column = scheme.H.column[massless]
    up = scheme.H.value[massless] > 0.0
    while len(row):
        both = (np.bincount(column[up], minlength=count) > 0) & (np.bincount(column[~up], minlength=count) > 0)
        gone = np.zeros(len(scheme.rows), dtype=np.bool_)
        gone[row[~both[column]]] = True
        keep = ~gone[row]
        if keep.all():
            found = ", ".join(repr(scheme.rows[i].name) for i in row[column == column[0]][:3].tolist())
            raise UnsupportedError(
                f"once the bumpers {found} are closed, impulses pass through {scheme.nodes[column[0]]!r}, which has no "
                f"mass, and sparse steps take no impulses there: give it a Mass, or {take}"
            )
        row = row[keep]
        column = column[keep]
        up = up[keep]


def refuse_fixed_contacts(scheme: Assembled) -> None:
    """Refuse bumpers both sides of which have a prescribed motion or none."""
    moves = np.zeros(len(scheme.rows), dtype=np.bool_)
    moves[scheme.H.row[~scheme.kinds.driven[scheme.H.column]]] = True
    moved = np.ones(len(scheme.rows), dtype=np.bool_)
    moved[scheme.H.row] = moves[scheme.H.row]
    if not moved.all():
        raise UnsupportedError(
            f"both sides of the bumper {scheme.rows.names[int(np.argmin(moved))]!r} have a prescribed motion or none, so "
            "that its reaction changes nothing: leave it out"
        )
