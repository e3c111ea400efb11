r"""Assembly of schemes with bodies: linear equations where all is linear, else those of a Lagrangian system.

.. math:: M \dot v + C v + K q = f(t) + H^T(t, q)\, r

M, C, K and f are those of the elements; the gaps, slips and joints of bodies are traced, as those of a `Lagrangian`. Where
their directions do not depend on the motion, as for discs on fixed lines, they are rows of a linear scheme.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import cast

import numpy as np
from numpy.typing import ArrayLike

from lcpimpact.errors import InputError, UnsupportedError
from lcpimpact.formula import Formula, NotTracedError, Number, mentions
from lcpimpact.scheme.assembly import assemble
from lcpimpact.scheme.dynamics import Dynamics
from lcpimpact.scheme.elements.base import GROUND, Element
from lcpimpact.scheme.elements.body import Body, Planar, Wall
from lcpimpact.scheme.elements.touch import Coupling, Partner
from lcpimpact.scheme.lagrangian import LagrangianDynamics, TracedRow, equations_of_motion, traced_rows
from lcpimpact.scheme.motion_function import MotionArguments, MotionFunction
from lcpimpact.scheme.signals import Checked, Harmonic, Polynomial, TimeFunction, terms_of
from lcpimpact.scheme.structure import Feature
from lcpimpact.scheme.terms import Row, Terms

UNTAKEN = (Feature.POWER_LAWS, Feature.DASHPOTS, Feature.HOLDS)


@dataclass(frozen=True)
class LinearRows(Planar):
    """Rows of contacts and joints whose directions do not depend on the motion."""

    rows: tuple[Row, ...]

    @property
    def nodes(self) -> tuple[str, ...]:
        """The ground."""
        return (GROUND,)

    def contribute(self, terms: Terms) -> None:
        """Add the rows to H."""
        for row in self.rows:
            terms.rows.append(row)


def has_bodies(elements: Sequence[Element]) -> bool:
    """Return whether some elements are bodies, or couple bodies."""
    return any(isinstance(each, Planar) for each in elements)


def assemble_bodies(elements: Sequence[Element], linear: Callable[[Sequence[Element]], Dynamics]) -> Dynamics:
    """Return the equations of motion of elements, with bodies among them; ``linear`` assembles those of linear ones.

    Raises
    ------
    InputError
        For names that are unknown or given twice, and shapes whose contacts are not known.
    UnsupportedError
        If directions depend on the motion, and an element is there that a Lagrangian system does not take.
    """
    if any(map(mentions, elements)):
        raise NotTracedError("the rows of bodies depend on more than sums and products of their constants")
    couplings = [each for each in elements if isinstance(each, Coupling)]
    others = [each for each in elements if not isinstance(each, Coupling)]
    nodes = list(dict.fromkeys(node for each in others for node in each.nodes if node != GROUND))
    if not nodes:
        raise InputError("the scheme has walls or couplings and nothing that moves: add a Body")
    surfaces = surfaces_of(others, nodes)
    x = MotionArguments.of(len(nodes))
    sources: list[str] = []
    rows: list[TracedRow] = []
    for each in couplings:
        rows += traced_rows(each.laws(surfaces), x, before=len(rows))
        sources += [str(each)] * (len(rows) - len(sources))
    if not any(isinstance(number, Formula) for row in rows for number in (*row.H, row.chi, row.kappa)):
        return linear([*others, LinearRows(tuple(_linear(rows, sources, nodes, x)))])
    return _lagrangian(assemble(others), couplings, surfaces)


def surfaces_of(elements: Sequence[Element], nodes: list[str]) -> dict[str, Partner]:
    """Return the bodies and walls by name, and the ground."""
    found = {GROUND: Partner(None, ())}
    for each in elements:
        if isinstance(each, Body | Wall):
            if each.name in found:
                raise InputError(f"{each}: two bodies or walls have the name {each.name!r}; rename one")
            found[each.name] = Partner(each, tuple(map(nodes.index, each.nodes)) if isinstance(each, Body) else ())
    return found


def _linear(rows: list[TracedRow], sources: list[str], nodes: list[str], x: MotionArguments) -> Iterator[Row]:
    """Yield the rows of a linear scheme."""
    none = np.zeros(len(nodes))
    (u0,) = MotionFunction(x, (np.array([row.g for row in rows], dtype=object),))(0.0, none, none)
    for row, gap, source in zip(rows, u0.tolist(), sources, strict=True):
        law = row.contact
        yield Row(
            source,
            law.name,
            GROUND,
            {node: float(c) for node, c in zip(nodes, row.H, strict=True) if c != 0.0},
            gap,
            None if law.bilateral else law.e,
            law.law,
            law.bounds,
            law.mu,
            law.mu_s,
            rows[law.normal].contact.name if law.normal >= 0 else "",
        )


def _lagrangian(d: Dynamics, couplings: Sequence[Coupling], surfaces: dict[str, Partner]) -> LagrangianDynamics:
    """Return the equations of a Lagrangian system: those of linear elements, with the traced rows of couplings."""
    _refuse_others(d)
    driven = sorted(d.motions)
    free = [i for i in range(len(d.nodes)) if i not in d.motions]
    x = MotionArguments.of(len(free))
    q, v = np.full(len(d.nodes), 0.0, dtype=object), np.full(len(d.nodes), 0.0, dtype=object)
    q[free], v[free] = x.q, x.v
    for i in driven:
        q[i] = _of_time(x, f"the motion of node {d.nodes[i]!r}", d.motions[i])
        (v[i],) = x.program.derivatives([q[i]], x.t)
    Q = -(d.C @ v) - d.K[:, driven] @ q[driven]
    for i, load in d.loads:
        Q[i] = Q[i] + _of_time(x, f"the load on node {d.nodes[i]!r}", load)
    for law in d.force_laws:
        at, shape = [d.nodes.index(node) for node in law.nodes], () if law.scalar else (len(law.nodes),)
        own = replace(x, q=q[at].reshape(shape), v=v[at].reshape(shape))
        Q[at] = Q[at] + own.call(f"f of {law.element}", law.f, "tqv", shape)
    rows = [
        TracedRow.of_gap(contact, lambda *_, h=h, u0=u0: h @ q + u0, x)
        for contact, h, u0 in zip(d.contacts, d.H, d.u0, strict=True)
    ]
    rows = [row._replace(g=0.0) if row.contact.law.tangential else row for row in rows]
    surfaces = {name: each._replace(at=tuple(free.index(i) for i in each.at)) for name, each in surfaces.items()}
    for each in couplings:
        rows += traced_rows(each.laws(surfaces), x, before=len(rows))
    M, K = d.M[np.ix_(free, free)].astype(object), d.K[np.ix_(free, free)]
    V = np.array(0.5 * (x.q @ K @ x.q), dtype=object)
    return equations_of_motion(tuple(d.nodes[i] for i in free), x, M, V, Q[free], rows)


def _refuse_others(d: Dynamics) -> None:
    """Refuse what a Lagrangian system does not take."""
    causes = d.structure.causes
    found = [f"{causes[each]} has {each}" for each in UNTAKEN if each in causes]
    found += [
        f"node {d.nodes[i]!r} has no mass" for i in map(int, np.flatnonzero(np.diag(d.M) == 0.0)) if i not in d.motions
    ]
    found += [
        f"{row.name!r} is a {row.law.name}" for row in d.contacts if row.limited or (row.one_sided and row.law.of_rate)
    ]
    found += [f"{row.name!r} has mu_s above mu" for row in d.contacts if row.mu_s != row.mu]
    if found:
        raise UnsupportedError(
            f"{found[0]}, and contacts or joints of bodies turn with the motion: take masses, linear springs and dashpots, "
            "loads, forces, motions, bumpers, friction and rigid links alone"
        )


def _of_time(x: MotionArguments, what: str, signal: float | TimeFunction) -> Number:
    """Return a signal as a formula of t."""
    total: Number = 0.0
    for each in terms_of(signal):
        if not callable(each):
            total = total + each
        elif isinstance(each, Harmonic | Polynomial | Checked):
            total = total + x.call(what, _formula(each), "t", ()).item()
        else:
            raise UnsupportedError(
                f"{what} is a {type(each).__name__}, no single formula of time, and contacts or joints of bodies turn "
                "with the motion: give a Harmonic, a Polynomial, or a function of NumPy there"
            )
    return total


def _formula(signal: Harmonic | Polynomial | Checked) -> Callable[..., ArrayLike | Number]:
    """Return a signal as a function that takes formulas of the time."""
    if isinstance(signal, Harmonic):
        return lambda t: signal.amplitude * np.cos(signal.omega * t + signal.phase)
    if isinstance(signal, Polynomial):
        return lambda t: sum(c * t**k for k, c in enumerate(signal.coefficients))
    return cast(Callable[..., ArrayLike], signal.given)
