"""The structure of a system: its rows with their laws, and which of its nodes have mass; no motion changes it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from functools import cached_property

import numpy as np

from lcpimpact.arrays import Array, Flags, Indices
from lcpimpact.scheme.decomposition import Decomposition
from lcpimpact.scheme.impact_laws import ImpactLaw
from lcpimpact.scheme.impulse_paths import extreme_rays, impulse_paths
from lcpimpact.scheme.laws import CONTACT, Bounded, RowLaw

DEGREE_REASON = {
    0: "the contact plate is massless and carried by a spring only, so the force is continuous",
    1: "the contact plate is massless and rests on a dashpot, so the force may jump, without an impulse",
    2: "both sides have mass or are ground, so velocities jump and impulses act",
}


class Feature(StrEnum):
    """Features of a system beyond masses, springs, dashpots and bumpers, which not every method handles."""

    SLIDERS = "sliders"
    RELAYS = "relays"
    POWER_LAWS = "non-linear springs"
    DASHPOTS = "non-linear dashpots"
    FORCES = "general forces"
    HOLDS = "sampled forces"
    MOTIONS = "prescribed motion"
    SYSTEMS = "systems given directly"
    MASSLESS = "massless nodes"
    RESTITUTION = "restitution"
    IMPULSE_PATHS = "impulses through massless nodes"
    FRICTION = "friction bounded by a normal force"
    JOINTS = "joints"
    EQUATIONS = "equations of a system"
    STATIC_FRICTION = "static friction above the kinetic one"
    LAGRANGIAN = "masses and directions that depend on the motion"


@dataclass(frozen=True)
class Contact(Bounded):
    """One row of the constraint, u = H q + D r + u0, with its law.

    Attributes
    ----------
    name : str
        The name of the reaction.
    upper, lower : str
        The nodes that r pushes apart.
    gap : float
        u in m at zero coordinates.
    e : float
        Coefficient of restitution; 0 where no impulse can act and it means nothing.
    relative_degree : int
        How often u must be differentiated before r appears: 0, 1 or 2, and more for relays.
    law : RowLaw
        The law of r.
    bounds : (float, float)
        r_min and r_max in N; infinite for friction, which μ r_N bounds.
    mu, mu_s : float
        Kinetic and static coefficient of friction.
    normal : int
        The row whose reaction r_N bounds the friction; -1 for other laws.
    """

    name: str
    upper: str
    lower: str
    gap: float
    e: float
    relative_degree: int
    law: RowLaw = CONTACT
    bounds: tuple[float, float] = (0.0, math.inf)
    mu: float = 0.0
    mu_s: float = 0.0
    normal: int = -1

    @property
    def sentence(self) -> str:
        """The relative degree and its reason, in words."""
        reason = DEGREE_REASON[self.relative_degree]
        if self.limited and self.law.of_rate:
            reason = reason.replace("and impulses act", "but no impulse acts, since friction is bounded")
        where = f" between {self.upper!r} and {self.lower!r}" if self.upper or self.lower else ""
        if not where:
            k = self.relative_degree
            names = {0: "u", 1: "the first derivative of u", 2: "the second derivative of u"}
            reason = f"r appears in {names.get(k, f'the derivative {k} of u, if in any')}"
        return f"{self.name}{where} has relative degree {self.relative_degree}: {reason}."


@dataclass(frozen=True, eq=False)
class Structure:
    """Nodes, rows and kinds of coordinates: all of a system that neither its motion nor the sizes of its constants change.

    Attributes
    ----------
    nodes : tuple of str                the coordinates, in the order of q
    contacts : tuple of Contact         name, law and relative degree of each row
    decomposition : Decomposition       the kinds of coordinates
    B : (n, nc) array                   how the reactions act, where the impulse paths are looked for
    causes : dict of Feature to str     features beyond those of masses and rows, with the element that causes each
    stores_energy : bool                whether ½ vᵀ M v + ½ qᵀ K q is an energy
    impact_law : str or LZB             the law of impact
    """

    nodes: tuple[str, ...]
    contacts: tuple[Contact, ...]
    decomposition: Decomposition
    B: Array
    causes: Mapping[Feature, str] = field(default_factory=dict)
    stores_energy: bool = True
    impact_law: ImpactLaw = "newton"

    @cached_property
    def features(self) -> dict[Feature, str]:
        """Its features that not every method handles, with the element or name that causes each."""
        found = {}
        of_laws = (
            (Feature.SLIDERS, self.of_rate & ~self.tangential),
            (Feature.FRICTION, self.tangential),
            (Feature.STATIC_FRICTION, self._where(lambda row: row.mu_s > row.mu)),
            (Feature.JOINTS if self.stores_energy else Feature.EQUATIONS, self.bilateral),
            (Feature.RELAYS, self.switches),
        )
        for feature, rows in of_laws:
            if rows.any():
                first = self.contacts[int(np.argmax(rows))]
                found[feature] = f"{first.law.name if self.stores_energy else 'multiplier'} {first.name!r}"
        found.update(self.causes)
        if not self.stores_energy:
            found[Feature.SYSTEMS] = "A, B, C, D"
        elif not (self.massive | self.driven).all():
            found[Feature.MASSLESS] = f"node {self.nodes[int(np.argmin(self.massive | self.driven))]!r}"
        if bouncing := [contact.name for contact in self.contacts if contact.e > 0.0 and contact.normal < 0]:
            found[Feature.RESTITUTION] = f"contact {bouncing[0]!r}"
        if len(path := self.impulse_lines[:1]):
            names = ", ".join(repr(self.contacts[i].name) for i in np.flatnonzero(path[0]))
            found[Feature.IMPULSE_PATHS] = f"contacts {names}, once all are closed"
        return found

    @property
    def has_other_impact_law(self) -> bool:
        """Whether its impacts may differ from those by Newton's law: by another one, of two contacts or more."""
        return self.impact_law != "newton" and bool(np.count_nonzero(self.rigid) > 1)

    @cached_property
    def impulse_paths(self) -> Array:
        """The contacts through which an impulse can pass from mass to mass or ground, one path a row (np, nc)."""
        paths = np.zeros((0, len(self.contacts)))
        parts, rows = self.decomposition, self.impenetrable
        if parts.massive.size:
            massless = np.column_stack([parts.damped, parts.static])
            found = impulse_paths(parts.massive.T @ self.B[:, rows], massless.T @ self.B[:, rows])
            paths = np.zeros((len(found), len(self.contacts)))
            paths[:, rows] = found
        return paths

    @cached_property
    def gap_paths(self) -> Array:
        """The contacts whose gaps add up to one that no quasi-static node changes: it must not be negative (nr, nc)."""
        rows = self.impenetrable
        rays = extreme_rays(self.decomposition.static.T @ self.B[:, rows])
        paths = np.zeros((len(rays), len(self.contacts)))
        paths[:, rows] = rays
        return paths

    @cached_property
    def impulse_lines(self) -> Array:
        """The impulse paths that lead over massless nodes, so that no contact on them has relative degree 2 alone."""
        return np.asarray(self.impulse_paths[np.count_nonzero(self.impulse_paths, axis=1) > 1])

    @cached_property
    def driven(self) -> Flags:
        """Flags of the nodes with a prescribed motion (n,)."""
        return np.asarray(self.decomposition.driven.any(axis=1))

    @cached_property
    def massive(self) -> Flags:
        """Flags of the nodes that move by a mass of their own (n,)."""
        return np.asarray(self.decomposition.massive.any(axis=1))

    @cached_property
    def of_rate(self) -> Flags:
        """Flags of the rows whose law is that of a rate U, and not of a place u (nc,)."""
        return self._where(lambda row: row.law.of_rate)

    @cached_property
    def one_sided(self) -> Flags:
        """Flags of the rows whose reactions push only, and without limit (nc,)."""
        return self._where(lambda row: row.one_sided)

    @cached_property
    def impenetrable(self) -> Flags:
        """Flags of the rows with u >= 0 (nc,)."""
        return self._where(lambda row: row.impenetrable)

    @cached_property
    def bilateral(self) -> Flags:
        """Flags of the rows with u = 0, whose reactions have any sign (nc,)."""
        return self._where(lambda row: row.bilateral)

    @cached_property
    def limited(self) -> Flags:
        """Flags of the rows whose reactions have two bounds of their own (nc,)."""
        return self._where(lambda row: row.limited)

    @cached_property
    def tangential(self) -> Flags:
        """Flags of the rows with friction, whose reactions those of normal rows bound (nc,)."""
        return self._where(lambda row: row.law.tangential)

    @cached_property
    def switches(self) -> Flags:
        """Flags of the rows whose reactions go from bound to bound where u changes its sign (nc,)."""
        return self._where(lambda row: row.switches)

    @cached_property
    def permanent(self) -> Flags:
        """Flags of the rows that act at all times and without limit, so that they take part in any impact (nc,)."""
        return ~(self.impenetrable | self.limited | self.tangential)

    @cached_property
    def rigid(self) -> Flags:
        """Flags of the contacts between masses, at which impulses act (nc,)."""
        return np.asarray(self.impenetrable & (self.relative_degree == 2))

    @cached_property
    def impulsive(self) -> Flags:
        """Flags of the rows between masses whose reactions have no limit, so that they may be impulses (nc,)."""
        return np.asarray((self.relative_degree == 2) & ~self.limited)

    @cached_property
    def normals(self) -> Indices:
        """The row whose reaction bounds the friction of each row; -1 of rows with other laws (nc,)."""
        return np.array([each.normal for each in self.contacts], dtype=np.int64)

    @cached_property
    def relative_degree(self) -> Indices:
        """Relative degree of each row (nc,)."""
        return np.array([contact.relative_degree for contact in self.contacts], dtype=np.int64)

    def _where(self, holds: Callable[[Contact], bool]) -> Flags:
        """Return the flags of the rows of which something holds (nc,)."""
        return np.array([holds(each) for each in self.contacts], dtype=np.bool_)
