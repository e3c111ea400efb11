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
from typing import NamedTuple

import numpy as np

from lcpimpact.arrays import Array, Flags
from lcpimpact.errors import UnsupportedError
from lcpimpact.hybrid.gaps import gaps
from lcpimpact.hybrid.motion import HybridMotion, Segment
from lcpimpact.hybrid.system import Mode, System, slip_coupling
from lcpimpact.memo import remembered
from lcpimpact.numerics.double_double import DoubleDouble, stacked
from lcpimpact.record import SLIP_RTOL
from lcpimpact.scheme.decomposition import least_squares

GRAZING_RTOL = 1e-7
"""Slope of a row at its zero, relative to its terms at their largest, below which it grazes zero.

With another state or parameter the zero is gone where that lowers the row by the square of the slope. So the derivative,
which grows as the inverse of the slope, would hold for relative changes below 1e-14 only, a few dozen roundings of a float.
"""


def place_derivative(system: System, mode: Mode) -> DoubleDouble:
    """Return the derivative (N, N) of the change of positions of sliders of degree 0 at the end of a mode.

    A slider that has slipped sticks or reverses at its present position: p changes by u = (C + D F) X.
    """
    fine, kept, changed = system.fine, len(system.form.A), system.remembered
    unit = np.eye(len(fine.A))
    if not len(changed):
        return DoubleDouble.of(unit)
    _, F = system.reaction(mode)
    return stacked([[unit[:kept]], [(fine.C + fine.D @ F)[changed] + unit[kept:]]])


class Hit(NamedTuple):
    """How the rows take part in impacts at one instant.

    Attributes
    ----------
    paths : (m, nc) array       the rows whose rates the impulses determine, and the impulse paths
    bounces : (nc,) array       whether a row rebounds with its coefficient of restitution
    slips : tuple               the rows of friction that slip all along, with the sign of their impulse
    """

    paths: Array
    bounces: Flags
    slips: tuple[tuple[int, float], ...]

    @property
    def key(self) -> tuple[bytes, bytes, tuple[tuple[int, float], ...]]:
        """Key that impacts with the same L share."""
        return self.paths.tobytes(), self.bounces.tobytes(), self.slips


def hit_of(system: System, mode: Mode, X: Array, P: Array, scale: Array) -> Hit | None:
    """Return the impacts at X with the impulses P (nc,) that end a mode; None without any."""
    d, pushed = system.dynamics, P > 0.0
    if not pushed.any():
        return None
    if system.has_friction_or_joints:
        slips = d.tangential & (np.abs(P) >= d.friction_bounds(P) * (1.0 - SLIP_RTOL))
        held = ((P != 0.0) | d.bilateral) & ~slips & (d.relative_degree == 2)
        signs = tuple((int(i), float(np.sign(P[i]))) for i in np.flatnonzero(slips))
        return Hit(np.eye(len(P))[held], np.ones(len(P), np.bool_), signs)
    U = gaps(system, X, scale)[1].hi
    if len(system.lines):
        # The velocities of massless nodes are those of the last mode.
        U = system.rates(mode).hi @ X
    # All contacts of an impulse path are active.
    lines = system.lines[~((system.lines > 0.0) & ~pushed).any(axis=1)]
    return Hit(np.vstack([np.eye(len(P))[pushed & d.rigid], lines]), U < 0.0, ())


def impulse_rows(system: System, mode: Mode, hit: Hit | None) -> DoubleDouble:
    """Return L (nc, N) of the impulses P = L X⁻ of impacts that end a mode."""
    d = system.dynamics
    A, B, C = system.fine.A, system.fine.B, system.fine.C
    if hit is None:
        return DoubleDouble.of(np.zeros((len(d.contacts), len(A))))
    closing = system.rates(mode) if len(system.lines) and not system.has_friction_or_joints else system.fine.CA
    push = slip_coupling(d, hit.slips) @ (hit.paths.T)
    rates, rebound = hit.paths @ C @ A, d.finely("restitution") * hit.bounces
    return -push @ least_squares(rates @ B @ push, rates + hit.paths @ (closing * rebound[:, None]))


def jump_matrix(system: System, mode: Mode, hit: Hit | None) -> DoubleDouble:
    """Return R (N, N) with X⁺ = R X⁻ where a mode ends: the impacts, and the new positions of sliders of degree 0."""

    def found() -> DoubleDouble:
        B = system.fine.B
        return place_derivative(system, mode) @ (B @ impulse_rows(system, mode, hit) + np.eye(len(B)))

    return remembered(system, ("jump", mode.key, hit and hit.key), found)


class Passage(NamedTuple):
    """The end of a segment, and the start of the next.

    Attributes
    ----------
    row : int                       the event function that falls through zero, of the ones of the mode; -1 at a breakpoint
    c : (N,) array                  its row; zero at a breakpoint
    hit : Hit or None               the impacts
    R : (N, N) array                X⁺ = R X⁻
    before, after : (N,) arrays     f⁻ and f⁺
    """

    row: int
    c: Array
    hit: Hit | None
    R: Array
    before: Array
    after: Array


def passage(
    system: System,
    scale: Array,
    before: Segment,
    after: Segment,
    slow: bool = False,
    *,
    simultaneous_rtol: float = 1e-10,
) -> Passage:
    """Return the event between two segments; ``scale`` (N,) is the largest |X| of the motion.

    With ``slow`` a slope that is as low as at a grazing is none, as of impacts that accumulate.

    ``simultaneous_rtol``: value of another row, relative to its terms at their largest, below which it ends the
    mode at the same instant.

    Raises
    ------
    UnsupportedError
        If the event is a grazing, or two events coincide.
    """
    names = [contact.name for contact in system.dynamics.contacts]
    c, X = after.ended, after.before
    flow, _ = system.mode(before.mode)
    next_flow, _ = system.mode(after.mode)
    f, rate = flow.A @ X, c @ flow.A
    breakpoint = not c.any()
    what = ", ".join(dict.fromkeys(event.contact for event in after.events)) or "a contact"
    if not (breakpoint or slow) and not -rate @ X > GRAZING_RTOL * (np.abs(rate) @ scale):
        raise UnsupportedError(
            f"{what} only touches at t = {after.t0:g} s (a grazing, or the end of impacts that accumulate), where the "
            "motion has no derivative: change a parameter a little; grazing(...) finds the value at which an orbit touches"
        )
    watch = system.watch(before.mode)
    rows = watch.rows.hi
    same = (rows == c).all(axis=1)
    zero = ~same & (np.abs(rows @ X) <= simultaneous_rtol * (np.abs(rows) @ scale))
    if zero.any():
        raise UnsupportedError(
            f"{names[watch.contacts[np.argmax(zero)]]} and {'a signal' if breakpoint else what} switch together at t = "
            f"{after.t0:g} s, where the motion has no derivative: change a parameter a little"
        )
    found = int(np.flatnonzero(same)[-1]) if same.any() else -1
    P = np.zeros(len(names))
    for event in after.events:
        P[names.index(event.contact)] += event.impulse
    hit = hit_of(system, before.mode, X, P, scale)
    return Passage(found, c, hit, jump_matrix(system, before.mode, hit).hi, f, next_flow.A @ after.X)


def saltation(motion: HybridMotion, before: Segment, after: Segment) -> Array:
    """Return the derivative (N, N) across the event between two segments.

    Raises
    ------
    UnsupportedError
        If the event is a grazing, or two events coincide.
    """
    at = passage(motion.system, motion.scale, before, after)
    if not at.c.any():
        return at.R
    return at.R + np.outer(at.after - at.R @ at.before, at.c) / (at.c @ at.before)


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
