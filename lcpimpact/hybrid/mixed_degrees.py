"""Mode choice for contacts without a common relative degree, by Murty's exchange of one row at a time.

Where combinations of gaps have a higher relative degree than each gap (see `lcpimpact.hybrid.system`), no order of LCPs can
say beforehand which rows that will be. The mode is the one of all sets of rows for which the first derivatives of r and u
that are not zero are positive.
"""

from __future__ import annotations

import numpy as np

from lcpimpact.arrays import Array, Indices
from lcpimpact.hybrid.complementarity import FLOAT_ZERO
from lcpimpact.hybrid.gaps import combined_gaps, gaps, project, touching_paths
from lcpimpact.hybrid.system import Mode, Still, System, combined, rounded_product, solve_regular
from lcpimpact.numerics.double_double import DoubleDouble, stacked

ZERO_FACTORS = (1.0, 16.0, 256.0)
"""Factors on the tolerance for zero that are tried in turn until a mode fits."""


def exchanged_mode(
    system: System, X: DoubleDouble, scale: Array, held: Still, zero: float
) -> tuple[Mode, DoubleDouble]:
    """Return the mode of contacts without common relative degrees, and X.

    A number near the tolerance may count as zero in one combination and not in another, and then no mode fits: so larger
    tolerances are tried, too.

    Raises
    ------
    numpy.linalg.LinAlgError
        If no mode fits without an impulse.
    """
    for wider in ZERO_FACTORS:
        found = _exchanged(system, X, scale, held, wider * zero)
        if found is not None:
            return found
    raise np.linalg.LinAlgError("no mode")


def _exchanged(
    system: System, X: DoubleDouble, scale: Array, held: Still, zero: float
) -> tuple[Mode, DoubleDouble] | None:
    """Return the mode, by exchanges of the last row with a wrong sign, and X; None if the exchanges cycle.

    They do not, but for rounding, since the rows depend on their forces by a P-matrix of rational functions, ordered by the
    first terms of their series. X differs only by rounding, which is set to zero beforehand.
    """
    degree, nc = system.degree, len(system.degree)
    u, U = gaps(system, X, scale, held, zero)
    apart = (degree > 0) & ((u.hi > 0.0) | ((degree == 2) & (U.hi > 0.0)))
    every = system.together(tuple(range(nc)))
    near = tuple(map(int, np.flatnonzero(~apart)))
    slow = zero * float((np.abs(every.CA.hi[every.degree == 2]) @ scale).max(initial=0.0))
    X = _at_rest(system, near, X, (u, slow), held, scale, zero)
    u, U = gaps(system, X, scale, held, zero)
    closed: set[int] = set()
    seen: set[tuple[int, ...]] = set()
    while (rows := tuple(sorted(closed))) not in seen:
        seen.add(rows)
        order, sign, impulsive = _first_terms(system, rows, X, (u, U), held, scale, zero, slow)
        wrong = np.flatnonzero((sign < 0.0) & ~apart)
        if len(wrong) == 0:
            first = np.where(apart, np.where(u.hi > 0.0, 0, 1), order)
            return None if impulsive else (Mode(rows, (), tuple(map(int, first)), (0,) * nc), X)
        closed ^= _exchange(system, frozenset(closed), int(wrong[-1]), near)
    return None


def _exchange(system: System, closed: frozenset[int], row: int, near: tuple[int, ...]) -> frozenset[int]:
    """Return the rows to exchange: one, or with it another where the force of the one does not act on its own gap."""
    others = [frozenset({row, each}) for each in reversed(near) if each != row]
    pairs = (each for each in [frozenset({row}), *others] if _regular(system, closed ^ each))
    return next(pairs, frozenset({row}))


def _regular(system: System, closed: frozenset[int]) -> bool:
    """Return whether closed rows have forces that their constraints determine."""
    rows = sorted(closed)
    try:
        solve_regular(system.together(tuple(rows)).G[:, rows], DoubleDouble.of(np.zeros(len(rows))))
    except np.linalg.LinAlgError:
        return False
    return True


def _at_rest(
    system: System,
    rows: tuple[int, ...],
    X: DoubleDouble,
    opening: tuple[DoubleDouble, float],
    held: Still,
    scale: Array,
    zero: float,
) -> DoubleDouble:
    """Return X projected onto closed combinations of these rows, and onto zero rates of the slow ones.

    ``opening`` holds u, and the rate that is slow.
    """
    u, slow = opening
    together = system.together(rows)
    touches = (combined_gaps(system, rows, u, held, scale, zero).hi == 0.0) & (together.degree > 0)
    lines = combined(touching_paths(system, u, held, scale, zero), system.fine.C)
    rates = stacked([[together.CA[touches & (together.degree == 2)]], [rounded_product(lines, system.fine.A)]])
    rests = rates[np.abs((rates @ X).hi) <= slow]
    return project(system, stacked([[together.C[touches]], [lines], [rests]]), X, scale)


def _first_terms(
    system: System,
    rows: tuple[int, ...],
    X: DoubleDouble,
    opening: tuple[DoubleDouble, DoubleDouble],
    held: Still,
    scale: Array,
    zero: float,
    slow: float,
) -> tuple[Indices, Array, bool]:
    """Return the order and the sign of the first nonzero term of r on closed ``rows``, and of u on others.

    The order is -1 if there is none. Rows inconsistent with the state, whose ``opening`` is (u, U), need impulses,
    r = p' δ' + p δ + ..., whose signs come first; the flag says whether there are any. Combinations of degree 2 that open no
    faster than ``slow`` are at rest.
    """
    A = system.fine.A
    B = system.fine.B
    at, together = list(rows), system.together(rows)
    u, U = opening
    open_, D = np.isin(np.arange(len(system.degree)), at, invert=True), system.fine.D.hi
    order = np.full(len(system.degree), -1)
    sign = np.zeros(len(system.degree))
    impulsive = False
    state = X
    sizes = scale

    def push(lacks: DoubleDouble) -> DoubleDouble:
        """Return B p of the impulses p that make the combinations consistent, and write the signs of p, and of D p in u."""
        p = np.zeros((2, len(sign)))
        p[:, at] = solve_regular(together.G[:, at], -lacks).parts
        size = np.zeros(len(sign))
        size[at] = np.abs(np.linalg.inv(together.G.hi[:, at])) @ np.abs(lacks.hi)
        jumps, terms = p[0].copy(), size.copy()
        if not system.dynamics.stores_energy:  # impulses on nodes without mass balance each other
            jumps[open_], terms[open_] = (D[open_] @ p[0]), np.abs(D[open_]) @ size
        new = (np.abs(jumps) > FLOAT_ZERO * terms) & (sign == 0.0)
        order[new], sign[new] = 0, np.sign(jumps[new])
        return B @ DoubleDouble(p)

    gap = combined_gaps(system, rows, u, held, scale, zero)
    if gap.hi.any():
        impulsive = True
        # δ' displaces the masses to close their gaps; δ displaces the rest and stops the masses.
        state = state + A @ push(DoubleDouble(np.where(together.degree == 2, gap.parts, 0.0)))
        sizes = np.maximum(sizes, np.abs(state.hi))
    rate = together.CA @ state
    rate.parts[:, (together.degree < 2) | (np.abs(rate.hi) <= slow)] = 0.0
    if gap.hi.any() or rate.hi.any():
        impulsive = True
        first = together.C @ state
        first.parts[:, ~((together.degree == 1) & (gap.hi != 0.0))] = 0.0
        state = state + push(first + rate)
        sizes = np.maximum(sizes, np.abs(state.hi))
    flow, F = system.reaction(Mode(rows, (), (), ()))
    reads = system.openings(F)
    reads.parts[:, at] = F.parts[:, at]
    for k in range(len(X) + 1):
        value = (reads @ state).hi
        if k == 0 and not impulsive:
            direct = open_ & (system.degree > 0)
            value = np.where(direct, u.hi, value)
        elif k == 1 and not impulsive:
            value = np.where(open_ & (system.degree == 2), U.hi, value)
        new = (sign == 0.0) & (np.abs(value) > zero * (np.abs(reads.hi) @ sizes))
        order[new], sign[new] = k, np.sign(value[new])
        if sign.all():
            break
        state = flow.generator @ state
        sizes = np.abs(flow.generator.hi) @ sizes
    return order, sign, impulsive
