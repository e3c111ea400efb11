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
    """Nodes with mass, nodes whose velocities are independent states, and nodes without mass (n,)."""

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


def momentum_imbalances(d: Dynamics, q: Array, v: Array, impulses: Array) -> Array:
    """Return the changes of momentum between states (steps + 1, n), less the impulses of all forces (steps, n)."""
    return np.asarray(np.diff(d.momentum(q, v), axis=0) - impulses)


def imbalances(d: Dynamics, q: Array, v: Array, impulses: Array, ways: Array) -> tuple[Array, Array]:
    """Return the imbalances of momentum and of q between states (steps + 1, n), with ∫ F dt + B P and ∫ v dt (steps, n)."""
    return momentum_imbalances(d, q, v, impulses), np.diff(q, axis=0) - ways
