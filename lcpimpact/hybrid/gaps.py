"""Gaps and gap rates of a state, set to zero where a mode holds them closed or where they are rounding."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from lcpimpact.arrays import Array, Flags, Matrix, Stack, Vector
from lcpimpact.compiled import compiled
from lcpimpact.hybrid.system import ZERO, Mode, Still, System, combined, round_to_zero, rounded_product
from lcpimpact.numerics.double_double import DoubleDouble, add, multiply, stacked

REFINEMENTS = 2
"""Number of corrections in floats, which give the digits of double-doubles."""


@compiled()
def reading(C: Stack, CA: Stack, X: Matrix, scale: Vector, no_gap: Flags, no_rate: Flags, zero: float) -> Stack:
    """Return C X and C A X (2, 2, nc) of X (2, N), with held values and rounding set to zero."""
    found = np.zeros((2, 2, C.shape[1]))
    for k, (rows, at_zero) in enumerate(((C, no_gap), (CA, no_rate))):
        for i in range(C.shape[1]):
            size = 0.0
            x = 0.0
            x_lo = 0.0
            for j in range(C.shape[2]):
                if rows[0, i, j] != 0.0:
                    y, y_lo = multiply(rows[0, i, j], rows[1, i, j], X[0, j], X[1, j])
                    x, x_lo = add(x, x_lo, y, y_lo)
                    size += abs(rows[0, i, j]) * scale[j]
            if not at_zero[i] and abs(x) > zero * size:
                found[k, 0, i], found[k, 1, i] = x, x_lo
    return found


def gaps(
    system: System, X: ArrayLike | DoubleDouble, scale: Array, held: Still | None = None, zero: float = ZERO
) -> tuple[DoubleDouble, DoubleDouble]:
    """Return u and U of the rows (nc,), for r = 0, with held values and rounding set to zero."""
    u, U = openings_and_rates(system, DoubleDouble.of(X), scale, held or still(system, None), zero)
    return DoubleDouble(u), DoubleDouble(U)


def openings_and_rates(system: System, X: DoubleDouble, scale: Array, held: Still, zero: float) -> Array:
    """Return the parts of u and U of `gaps` (2, 2, nc)."""
    fine = system.fine
    return reading(fine.C.parts, fine.CA.parts, np.ascontiguousarray(X.parts), scale, held.u, held.U, zero)


def still(system: System, mode: Mode | None) -> Still:
    """Return the zeros of a mode."""
    if mode is not None:
        return system.watch(mode).held
    none = np.zeros(len(system.degree), dtype=np.bool_)
    return Still(none, none, none)


def settled(
    system: System, mode: Mode | None, X: DoubleDouble, scale: Array, held: Still | None = None
) -> DoubleDouble:
    """Return X projected onto the zero gaps and rates of a mode, or of ``held``."""
    held = held or still(system, mode)
    if held.none and not system.mixed:
        return X
    constraint = zero_rows(system, mode, held)
    return project(system, constraint, X, scale)


def zero_rows(system: System, mode: Mode | None, held: Still) -> DoubleDouble:
    """Return the rows c with c·X = 0 (k, N) of the zero gaps and rates of a mode, or of ``held``."""
    C, CA = system.fine.C, system.fine.CA
    if system.mixed:
        closed = system.together(mode.closed if mode else ())
        return stacked([[closed.C[closed.degree > 0]], [closed.CA[closed.degree == 2]]])
    return stacked([[C[np.flatnonzero(held.u)]], [CA[np.flatnonzero(held.U & ~system.dynamics.of_rate)]]])


def project(system: System, constraint: DoubleDouble, X: DoubleDouble, scale: Array) -> DoubleDouble:
    """Return X projected so that these rows of it are zero."""
    # The constant and the signals stay; the other states move in proportion to their size.
    moves = np.where(np.arange(len(X)) < system.form.constant, scale, 0.0)
    for _ in range(REFINEMENTS):
        rest = (constraint @ X).hi
        if not rest.any():
            break
        correction = np.linalg.lstsq(constraint.hi * moves, rest, rcond=ZERO)[0]
        X = X - DoubleDouble.of(moves * correction)
    return X


def scale_after(system: System, scale: Array, P: Array) -> Array:
    """Return the scale (N,) with the effect of impulses P (nc,): the residual of balanced ones is rounding."""
    return np.maximum(scale, system.pushes @ P) if P.any() else scale


def combined_gaps(
    system: System, rows: tuple[int, ...], u: DoubleDouble, held: Still, scale: Array, zero: float
) -> DoubleDouble:
    """Return the combinations T u of the openings of rows, those of degree 0 as zero, since forces decide on them."""
    together, at = system.together(rows), list(rows)
    found = DoubleDouble.of(together.T) @ u[at]
    # Of rows that were closed, but for those that contained the force of another one, which may be open now.
    alone = ~combined(together.T, system.fine.D[at]).hi.any(axis=1)
    by_definition = alone & ~(together.T[:, ~held.closed[at]] != 0.0).any(axis=1)
    terms = np.abs(together.T) @ (np.abs(system.fine.C.hi[at]) @ scale)
    found.parts[:, (together.degree == 0) | by_definition] = 0.0
    return round_to_zero(found, terms, zero)


def touching_paths(system: System, u: DoubleDouble, held: Still, scale: Array, zero: float) -> Array:
    """Return the impulse paths (np, nc) over massless nodes whose contacts, with the openings ``u``, are all closed."""
    found = [
        not (combined_gaps(system, tuple(map(int, np.flatnonzero(line))), u, held, scale, zero).hi > 0.0).any()
        for line in system.lines
    ]
    return system.lines[np.array(found, dtype=np.bool_)]


def path_rates(system: System, lines: Array, X: DoubleDouble, scale: Array, zero: float) -> DoubleDouble:
    """Return the opening rates of impulse paths, which do not depend on massless nodes, with rounding set to zero."""
    rates = rounded_product(combined(lines, system.fine.C), system.fine.A)
    return round_to_zero(rates @ X, np.abs(rates.hi) @ scale, zero)
