r"""Balances of momentum and of displacement over the steps of a run, under any rule of integration.

Between successive states of a run, which may be the limits at a jump, it is

.. math:: M (v^+ - v) = \int (f + s - K q - C v + B r)\,dt + B P, \qquad q^+ - q = \int v\,dt,

and a rule says what the integrals are: exact sums of θ-steps, Gauss's on the pieces of a continuous solution, the
trapezoidal one on a grid.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lcpimpact.arrays import Array, Flags
from lcpimpact.certificate.laws import node_kinds
from lcpimpact.memo import once
from lcpimpact.scheme.dynamics import Dynamics
from lcpimpact.scheme.terms import NodeKind


class JudgedNodes(NamedTuple):
    """The nodes by their balances (n,).

    Attributes
    ----------
    massive     nodes with mass: M v balances the impulses
    moving      nodes whose velocities are independent states: q balances ∫ v dt
    massless    nodes without mass: the forces balance
    """

    massive: Flags
    moving: Flags
    massless: Flags


@once
def judged_nodes(d: Dynamics) -> JudgedNodes:
    """Return the nodes of a system by their balances."""
    kind = node_kinds(d)
    return JudgedNodes(
        kind == NodeKind.MASSIVE,
        (kind >= NodeKind.DAMPED) & ~d.jumping,
        np.isin(kind, (NodeKind.DAMPED, NodeKind.FREE)),
    )


class Imbalances(NamedTuple):
    """What the changes between successive states differ by from their integrals: of M v in N s, of q in m (steps, n)."""

    momentum: Array
    way: Array

    def summed(self) -> Imbalances:
        """Return the sums since the first state."""
        return Imbalances(*(np.cumsum(each, axis=0) for each in self))


def momentum_imbalances(d: Dynamics, v: Array, impulses: Array) -> Array:
    """Return what the momenta between velocities v (steps + 1, n) change by, less the impulses of all forces (steps, n)."""
    return np.asarray(np.diff(v @ d.M.T, axis=0) - impulses)


def imbalances(d: Dynamics, q: Array, v: Array, impulses: Array, ways: Array) -> Imbalances:
    """Return the imbalances between states q and v (steps + 1, n), with ∫ F dt + B P and ∫ v dt (steps, n)."""
    return Imbalances(momentum_imbalances(d, v, impulses), np.diff(q, axis=0) - ways)
