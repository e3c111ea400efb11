r"""Newton's law of impact, as an LCP of its own where plates that both have mass meet with U < 0.

.. math:: 0 \le P \perp U^+ + e U^- \ge 0, \qquad U^+ = U^- + C A B P .

With friction and joints it is that of `lcpimpact.hybrid.friction`. Over massless nodes impulses act on impulse paths, by the
law of `lcpimpact.hybrid.impact_law`. Other laws are those of `lcpimpact.hybrid.multiple_impacts`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from lcpimpact.arrays import Array, Flags, Indices
from lcpimpact.errors import FailureError, UnsupportedError
from lcpimpact.hybrid.complementarity import Meeting, approach, at_rest, rebound
from lcpimpact.hybrid.friction import frictional_impact
from lcpimpact.hybrid.gaps import openings_and_rates, path_rates, still, touching_paths
from lcpimpact.hybrid.impact_law import restitution as path_restitution
from lcpimpact.hybrid.multiple_impacts import Touching, impulses
from lcpimpact.hybrid.system import FINE_ZERO, ZERO, Still, System
from lcpimpact.numerics.double_double import DoubleDouble
from lcpimpact.scheme.dynamics import Dynamics
from lcpimpact.scheme.signals import Described

NO_PATHS = np.zeros((0, 0))


def impact(
    system: System,
    X: ArrayLike | DoubleDouble,
    scale: Array,
    solver: str,
    restitution: Array | None = None,
    held: Still | None = None,
    zero: float = ZERO,
    among: Flags | None = None,
    left: DoubleDouble | None = None,
    rates: ArrayLike | DoubleDouble | None = None,
) -> tuple[DoubleDouble, Array, Still]:
    """Return X after the impacts at this instant, the impulses (nc,), and the zeros after them.

    Newton's law is 0 <= P ⟂ U⁺ + e U⁻ >= 0; at contacts that open already e is 0. The coefficients e
    are those of the rows, or ``restitution`` (nc,). The rows ``among`` (nc,), or else all closed ones, undergo impacts. If a
    prescribed velocity jumps, X has its right limit, and ``left`` (N,), which gives U⁻, its left limit. The left limits
    ``rates`` (nc,) of U, with those of massless nodes, which are not in X, determine the rebound of the impulse paths of
    `lcpimpact.hybrid.impact_law`.
    """
    e = system.dynamics.restitution if restitution is None else restitution
    state, held = DoubleDouble.of(X), held or still(system, None)
    u, U = openings_and_rates(system, state, scale, held, zero)
    before = U if left is None else openings_and_rates(system, left, scale, held, zero)[1]
    if among is None:
        meeting, bounce, q, meet = approach(u, U, before, e, system.dynamics.rigid)
    else:
        meeting, bounce, q, meet = approach(np.zeros_like(u), U, before, e, system.dynamics.rigid & among)
    if system.dynamics.has_other_impact_law and len(meeting) > 1:
        return _by_other_law(system, state, meeting, e, U, held, solver, zero)
    lines = NO_PATHS
    G, B = (system.fine.G, system.fine.B)
    toward = U
    back = before
    if len(system.lines) and rates is not None and among is None:
        lines = touching_paths(system, DoubleDouble(u), held, scale, zero)
        speeds = path_rates(system, lines, state, scale, zero)
        known = DoubleDouble.of(rates)
        rebounds = path_restitution(lines, known.hi, e)
        G, B = system.path_matrices(lines)
        toward, back = (
            np.concatenate([each, more.parts], 1) for each, more in ((U, speeds), (before, DoubleDouble.of(rebounds)))
        )
        meeting = np.append(meeting, len(e) + np.arange(len(lines)))
        bounce = np.append(bounce, np.ones(len(lines)))
        q = toward[0, meeting] + bounce * back[0, meeting]
        meet = bool((q < 0.0).any())
    if not meet:
        return state, np.zeros(len(system.degree)), held
    if system.has_friction_or_joints:
        law = np.where(system.dynamics.rigid, 0.0, e)
        law[meeting] = bounce
        end, pushed, stops = frictional_impact(system, state, meeting, law, U, before, solver, zero)
        unmoved = held.U & (system.G @ pushed == 0.0) & (system.degree == 2)
        return end, pushed, Still(held.u, stops | unmoved, held.closed)
    floats = system.impact_lcp(G, lines, meeting, solver).solve(q, throw=False)
    # Where floats have too few digits, as for masses that differ by 1e9, double-doubles decide, to their own rounding.
    zero = zero if floats.success else FINE_ZERO
    parts = np.ascontiguousarray(state.parts)
    meets = Meeting(meeting, bounce, toward, back)
    after, impulses, ended = rebound(G.parts, B.parts, parts, meets, floats.z, zero)
    if not ended and not floats.success:
        raise FailureError(floats.message, floats)
    if not ended:
        raise np.linalg.LinAlgError("no complementary basis")
    P = impulses[0] if len(lines) == 0 else impulses[0, : len(e)] + impulses[0, len(e) :] @ lines
    rests = at_rest(P, before, e, system.G, held.U, system.degree)
    return DoubleDouble(after), P, Still(held.u, rests, held.closed)


def _by_other_law(
    system: System, state: DoubleDouble, meeting: Indices, e: Array, U: Array, held: Still, solver: str, zero: float
) -> tuple[DoubleDouble, Array, Still]:
    """Return the result of `impact` by another law than Newton's, of several contacts ``meeting``, with their rates U."""
    P = np.zeros(len(e))
    if not (U[0, meeting] < 0.0).any():
        return state, P, held
    d, fine = system.dynamics, system.fine
    G = DoubleDouble(np.ascontiguousarray(fine.G.parts[:, meeting[:, None], meeting]))
    rates = DoubleDouble(np.ascontiguousarray(U[:, meeting]))
    contacts = Touching(G, rates, e[meeting], [d.contacts[i].name for i in meeting])
    found, stops = impulses(d.impact_law, contacts, solver, zero)
    P[meeting] = found.hi
    rests = held.U & (system.G @ P == 0.0)
    rests[meeting] |= stops & (P[meeting] > 0.0)
    return state + fine.B[:, meeting] @ found, P, Still(held.u, rests & (system.degree == 2), held.closed)


def refuse_velocity_jumps(dynamics: Dynamics, t_end: float, method: str) -> None:
    """Refuse a bumper with e > 0 on a node whose prescribed velocity jumps, for methods with the right limit of U only."""
    for i, motion in dynamics.motions.items():
        rows = np.flatnonzero(
            (dynamics.H[:, i] != 0.0) & (dynamics.relative_degree == 2) & (dynamics.restitution > 0.0)
        )
        if len(rows) and isinstance(motion, Described) and len(motion.breakpoints(0.0, t_end)):
            raise UnsupportedError(
                f"the velocity of the node {dynamics.nodes[i]!r} jumps, and the contact {dynamics.contacts[rows[0]].name!r} "
                f"there has a coefficient of restitution, which {method!r} does not handle: ",
                ("exact", "moreau-jean"),
            )
