r"""The derivative of an exact motion with respect to its initial state: flows and saltation matrices.

Within a mode a perturbation follows the flow. Across an event it does not, because the event is shifted in time: with the
row c that falls through zero, the state X⁻ before, the state X⁺ = R(X⁻) after, and the velocities f⁻ = A⁻ X⁻ and f⁺ = A⁺
X⁺ of the two modes, the perturbation is multiplied by the *saltation matrix*

.. math:: S = R_X + \frac{(f^+ - R_X f^-)\, c}{c \cdot f^-} .

At a breakpoint of the signals, whose instant is fixed, S = R_X. R is the identity if there are no impulses; otherwise the
active rows a give

.. math:: R_X = I - B_a G_{aa}^{-1} (1 + e_a)\, (C A)_a , \qquad G = C A B ;

where impulses pass through massless nodes, the rows are sums along the impulse paths (see `lcpimpact.hybrid.impact_law`).

The derivative over a time is the product of the flows and of these matrices in their order. It does not exist at a grazing
(c·f⁻ = 0), nor if two rows fall through zero at once.

It holds for perturbations within the initial mode: closed rows stay closed, and a slider that came to rest at its threshold
stays there. (Beyond it the slider slips back, below it sticks; so with respect to its position the motion has one-sided
derivatives only.)

References: Aizerman and Gantmacher (1958); Leine and Nijmeijer, *Dynamics and Bifurcations of Non-Smooth Mechanical Systems*
(2004), chapter 7.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from lcpimpact.arrays import Array
from lcpimpact.errors import UnsupportedError
from lcpimpact.hybrid.gaps import gaps
from lcpimpact.hybrid.motion import HybridMotion, Segment
from lcpimpact.hybrid.system import Mode, System
from lcpimpact.record import SLIP_RTOL


def place_derivative(system: System, mode: Mode) -> Array:
    """Return the derivative (N, N) of the change of positions of sliders of degree 0 at the end of a mode.

    A slider that has slipped sticks or reverses at its present position: p changes by u = (C + D F) X.
    """
    _, F = system.mode(mode)
    change = np.eye(len(F.T))
    if len(system.remembered):
        u = system.derivatives[0] + system.form.D @ F
        change[len(system.form.A) :] += u[system.remembered]
    return change


def impact_derivative(system: System, mode: Mode, X: Array, P: Array, scale: Array) -> Array:
    """Return the derivative (N, N) at X of the state after impacts with the impulses P (nc,) that end a mode."""
    pushed = P > 0.0
    if not P.any():
        return np.eye(len(X))
    if system.has_friction_or_joints:
        return _frictional_impact_derivative(system, P)
    U = gaps(system, X, scale)[1].hi
    closing = system.derivatives[1]
    if len(system.lines):
        # The velocities of massless nodes are those of the last mode.
        closing = system.rates(mode).hi
        U = closing @ X
    # All contacts of an impulse path are active.
    lines = system.lines[~((system.lines > 0.0) & ~pushed).any(axis=1)]
    paths = np.vstack([np.eye(len(P))[pushed & system.dynamics.rigid], lines])
    rebound = (np.where(U < 0.0, system.dynamics.restitution, 0.0) * paths) @ closing
    A, B, C = system.matrices
    rates, push = paths @ C @ A, B @ paths.T
    return np.asarray(np.eye(len(X)) - push @ np.linalg.lstsq(rates @ push, rates + rebound, rcond=None)[0])


def _frictional_impact_derivative(system: System, P: Array) -> Array:
    """Return the derivative of an impact with friction and joints: of what sticks, and of what slips all along."""
    d = system.dynamics
    A, B, C = system.matrices
    nc = len(P)
    bounds = d.friction_bounds(P)
    slips = d.tangential & (np.abs(P) >= bounds * (1.0 - SLIP_RTOL))
    held = np.flatnonzero(((P != 0.0) | d.bilateral) & ~slips & (d.relative_degree == 2))
    push = np.eye(nc)
    for i in np.flatnonzero(slips):
        push[i] = np.sign(P[i]) * d.mu[i] * push[d.normals[i]]
    rates = C[held] @ A
    jump = np.linalg.lstsq(rates @ B @ push[:, held], (1.0 + d.restitution[held])[:, None] * rates, rcond=None)[0]
    return np.eye(A.shape[0]) - B @ push[:, held] @ jump


def saltation(
    motion: HybridMotion,
    before: Segment,
    after: Segment,
    *,
    grazing_rtol: float = 1e-10,
    simultaneous_rtol: float = 1e-10,
) -> Array:
    """Return the derivative (N, N) across the event between two segments.

    ``grazing_rtol``: slope at a zero, relative to the terms of the row at their largest, below which the row grazes
    zero.
    ``simultaneous_rtol``: value of another row, relative to its terms at their largest, below which it ends the
    mode at the same instant.

    Raises
    ------
    UnsupportedError
        If the event is a grazing, or two events coincide.
    """
    system = motion.system
    names = [contact.name for contact in system.dynamics.contacts]
    c, X = after.ended, after.before
    flow, _ = system.mode(before.mode)
    next_flow, _ = system.mode(after.mode)
    f, rate = flow.A @ X, c @ flow.A
    breakpoint = not c.any()
    what = ", ".join(dict.fromkeys(event.contact for event in after.events)) or "a contact"
    if not breakpoint and not -rate @ X > grazing_rtol * (np.abs(rate) @ motion.scale):
        raise UnsupportedError(
            f"{what} only touches at t = {after.t0:g} s (a grazing, or the end of impacts that accumulate), where the "
            "motion has no derivative: change a parameter a little; grazing(...) finds the value at which an orbit touches"
        )
    watch = system.watch(before.mode)
    for i, row in zip(watch.contacts, watch.rows.hi, strict=True):
        if not np.array_equal(row, c) and abs(row @ X) <= simultaneous_rtol * (np.abs(row) @ motion.scale):
            raise UnsupportedError(
                f"{names[i]} and {'a signal' if breakpoint else what} switch together at t = {after.t0:g} s, where the "
                "motion has no derivative: change a parameter a little"
            )
    P = np.zeros(len(names))
    for event in after.events:
        P[names.index(event.contact)] += event.impulse
    R = place_derivative(system, before.mode) @ impact_derivative(system, before.mode, X, P, motion.scale)
    if breakpoint:
        return R
    return R + np.outer(next_flow.A @ after.X - R @ f, c) / (c @ f)


def factors(motion: HybridMotion, until: float) -> Iterator[Array]:
    """Yield, in order of time, the factors of the derivative of X(until) with respect to the initial state."""
    segments = [each for each in motion.segments if each.t0 <= until]
    ends = [*(each.t0 for each in segments[1:]), until]
    for k, (segment, end) in enumerate(zip(segments, ends, strict=True)):
        if k:
            yield saltation(motion, segments[k - 1], segment)
        yield motion.system.mode(segment.mode)[0].over(end - segment.t0)


def tangent(motion: HybridMotion, until: float) -> Array:
    """Return the derivative (N, N) of X(until) with respect to the right limit of the initial state.

    Raises
    ------
    UnsupportedError
        If the motion grazes, or two events coincide.
    """
    change = np.eye(len(motion.scale))
    for factor in factors(motion, until):
        change = factor @ change
    return change
