"""Assembly of elements to the equations of motion, in full or in sparse matrices, with checks of solvability."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal, cast, overload

import numpy as np

from lcpimpact.arrays import Array, Indices, Sparse
from lcpimpact.errors import InputError, UnsupportedError
from lcpimpact.registry import nearest
from lcpimpact.scheme import checks
from lcpimpact.scheme.checks import Assembled
from lcpimpact.scheme.decomposition import kinds_of
from lcpimpact.scheme.dynamics import Dynamics, law_numbers
from lcpimpact.scheme.elements.base import ArrayElement, Element
from lcpimpact.scheme.impact_laws import LZB, ImpactLaw, name_of_law
from lcpimpact.scheme.signals import Signals, TimeFunction, breaks
from lcpimpact.scheme.sparse_dynamics import TAKE_SCHEME, SparseDynamics
from lcpimpact.scheme.structure import Contact, Feature, Structure
from lcpimpact.scheme.terms import GROUND, Sum, Terms, entries_of, name_of

MAX_NODES = 10_000
"""Maximum number of nodes: a full matrix takes 800 MB."""


@overload
def assemble(elements: Sequence[Element]) -> Dynamics: ...
@overload
def assemble(elements: Sequence[Element], in_sparse_matrices: Literal[True]) -> SparseDynamics: ...
def assemble(elements: Sequence[Element], in_sparse_matrices: bool = False) -> Dynamics | SparseDynamics:
    """Assemble elements to the equations of motion, in full or in sparse matrices.

    Parameters
    ----------
    elements : sequence of Element
        The scheme; coordinates are ordered as the elements name them.

    Raises
    ------
    InputError
        If a node is held by nothing, pushed over or would jump, bumpers or sliders act in parallel, two reactions or inner
        nodes have one name, a node has a mass and a motion or two motions, or a coefficient of restitution is missing or
        meaningless.
    UnsupportedError
        If sparse matrices are asked for, and an element has another law than that of a bumper, an impulse could pass through
        a node without mass, or a bumper is between two motions.
    """
    nodes = list(dict.fromkeys(node for element in elements for node in element.nodes if node != GROUND))
    if not nodes:
        raise InputError("the scheme has no element yet: add a Mass, a Spring, ... before it is assembled")
    if len(nodes) > MAX_NODES and not in_sparse_matrices:
        raise InputError(f"{_too_many(len(nodes))}: leave out format='full', or model it coarser")
    checks.refuse_shared_inner_nodes(elements)
    terms = Terms(nodes)
    for element in elements:
        if in_sparse_matrices and isinstance(element, ArrayElement):
            element.contribute_arrays(terms)
        else:
            element.contribute(terms)
    return _in_sparse_matrices(terms) if in_sparse_matrices else _in_full_matrices(terms)


def assemble_by_size(elements: Sequence[Element], *, largest: int = 1_000) -> Dynamics:
    """Assemble elements to sparse matrices above a ``largest`` number of nodes if they take them, else to full ones."""
    count = len({node for element in elements for node in element.nodes if node != GROUND})
    if count <= largest:
        return assemble(elements)
    try:
        return cast(Dynamics, assemble(elements, in_sparse_matrices=True))
    except UnsupportedError as error:
        if count <= MAX_NODES:
            return assemble(elements)
        raise InputError(
            f"{_too_many(count)}: model it coarser, or of masses, linear springs, dashpots, loads, motions and bumpers "
            "alone, which sparse ones take"
        ) from error


def under_law(dynamics: Dynamics, law: ImpactLaw) -> Dynamics:
    """Return the equations of motion under a law of impact.

    Raises
    ------
    UnsupportedError
        If the system has rows to which a law other than Newton's does not extend.
    InputError
        If a stiffness is that of no contact between masses.
    """
    if law == "newton":
        return dynamics
    d, beside = dynamics, ""
    if isinstance(dynamics, SparseDynamics):
        beside = "sparse matrices"
    elif Feature.LAGRANGIAN in d.features:
        beside = Feature.LAGRANGIAN.value
    elif (rubs := d.tangential & (d.relative_degree == 2)).any():
        beside = f"friction ({d.contacts[int(np.argmax(rubs))].name!r})"
    elif (holds := d.permanent & (d.relative_degree == 2)).any():
        beside = f"joints ({d.contacts[int(np.argmax(holds))].name!r})"
    elif Feature.IMPULSE_PATHS in d.features:
        beside = f"{Feature.IMPULSE_PATHS.value} ({d.features[Feature.IMPULSE_PATHS]})"
    elif jumping := [d.nodes[i] for i, each in d.motions.items() if breaks(each) and d.H[d.rigid, i].any()]:
        beside = f"prescribed velocities that jump (node {jumping[0]!r})"
    if beside:
        raise UnsupportedError(
            f"impact_law={name_of_law(law)!r} does not extend to {beside}: leave it out, which is Newton's law"
        )
    if isinstance(law, LZB):
        known = [each.name for each, rigid in zip(d.contacts, d.rigid, strict=True) if rigid]
        for name in law.stiffness:
            if name not in known:
                raise InputError(f"LZB: stiffness: {nearest(name, known, 'contact between masses')}")
    return replace(d, structure=replace(d.structure, impact_law=law))


def _too_many(count: int) -> str:
    return f"the scheme has {count:,} nodes, and full matrices are kept of {MAX_NODES:,}"


def _in_full_matrices(terms: Terms) -> Dynamics:
    """Return the equations of motion in full matrices, once they are checked."""
    M = terms.M.full()
    C = terms.C.full()
    K = terms.K.full()
    H, _ = terms.rows.matrix().full()
    scheme = _checked(terms, M[0], C[0] + _rising_dashpots(terms), K[0], H)
    checks.refuse_undetermined_rates(scheme, C[0])
    normals = checks.normals_of(terms.rows)
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
        for row, degree, normal in zip(terms.rows, scheme.degrees.tolist(), normals, strict=True)
    )
    residues = M[1], C[1], K[1]
    u0 = terms.rows.gaps()
    B, D = H.T.copy(), np.zeros((len(H), len(H)))
    for array in (M[0], C[0], K[0], H, u0, B, D, *residues):
        array.flags.writeable = False
    dynamics = Dynamics(
        Structure(tuple(terms.index), contacts, scheme.kinds.basis(), B, _causes(terms)), M=M[0], C=C[0], K=K[0],
        loads=tuple(terms.loads), H=H, u0=u0, chi=np.zeros(len(H)), B=B, D=D, **law_numbers(contacts),
        springs=tuple(terms.springs), dashpots=tuple(terms.dashpots), force_laws=tuple(terms.force_laws),
        holds=tuple(terms.holds), motions=dict(terms.motions), residues=residues,
    )  # fmt: skip
    checks.refuse_restitution(scheme, dynamics.impulse_paths)
    return dynamics


def _rising_dashpots(terms: Terms) -> Array:
    """Return the damping matrix of dashpots of 1 N s/m in the places of the non-linear ones that determine a rate."""
    C = Sum(len(terms.index), len(terms.index))
    for law in terms.dashpots:
        if law.rises:
            terms.link(C, law.a, law.b, 1.0)
    return C.value


def _causes(terms: Terms) -> dict[Feature, str]:
    """Return the features beyond those of masses and rows, with the first element that causes each."""
    nodes = list(terms.index)
    causes = {
        Feature.POWER_LAWS: [spring.element for spring in terms.springs],
        Feature.DASHPOTS: [law.element for law in terms.dashpots],
        Feature.FORCES: [law.element for law in terms.force_laws],
        Feature.HOLDS: [held.law.element for held in terms.holds],
        Feature.MOTIONS: [f"node {nodes[i]!r}" for i in terms.motions],
    }
    return {feature: elements[0] for feature, elements in causes.items() if elements}


def _in_sparse_matrices(terms: Terms) -> SparseDynamics:
    """Return the equations of motion in sparse matrices, once they are checked."""
    checks.refuse_other_laws(terms, TAKE_SCHEME)
    M = terms.M.compressed()
    C = terms.C.compressed()
    K = terms.K.compressed()
    H = terms.rows.matrix().compressed()
    scheme = _checked(terms, M, C, K, H)
    checks.refuse_impulse_paths(scheme, TAKE_SCHEME)
    checks.refuse_fixed_contacts(scheme)
    checks.refuse_restitution(scheme, np.zeros((0, len(terms.rows))))
    f, F, signals = _loads(terms)
    return SparseDynamics(
        nodes=tuple(terms.index), M=M, C=C, K=K, f=f, F=F, signals=signals, motions=dict(terms.motions), H=H,
        u0=terms.rows.gaps(), restitution=np.nan_to_num(terms.rows.e), reactions=terms.rows.names, kinds=scheme.kinds,
        relative_degree=scheme.degrees,
    )  # fmt: skip


def _checked(terms: Terms, M: Array | Sparse, C: Array | Sparse, K: Array | Sparse, H: Array | Sparse) -> Assembled:
    """Return a scheme with matrices of any format, once it is checked."""
    nodes = list(terms.index)
    of_M = entries_of(M)
    of_C = entries_of(C)
    of_H = entries_of(H)
    driven = np.zeros(len(nodes), dtype=np.bool_)
    driven[list(terms.motions)] = True
    kinds = kinds_of(of_M, of_C, driven)
    scheme = Assembled(
        terms, nodes, of_M, of_C, entries_of(K), of_H, kinds, kinds.relative_degrees(of_H, len(terms.rows))
    )
    checks.refuse_unsolvable(scheme)
    return scheme


def _loads(terms: Terms) -> tuple[Array, Sparse, Signals]:
    """Return the constant loads (n,), those for a unit of each signal (n, ns), and the signals, each listed once."""
    f = np.zeros(len(terms.index))
    F, signals = Sum(len(f), 0), Signals()
    loads: list[tuple[Indices | int, Array | float, float | TimeFunction]]
    loads = [*terms.load_arrays, *((i, 1.0, load) for i, load in terms.loads)]
    for at, factors, load in loads:
        if callable(load):
            unit, place = signals.place(load)
            F.add(unit * np.asarray(factors), (at, place))
        else:
            f[at] += load * factors
    F.shape = len(f), len(signals)
    return f, F.compressed(), signals
