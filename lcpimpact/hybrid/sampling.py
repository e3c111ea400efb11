"""Values of rows R X of a chain of segments at many times, from the polynomials of their windows."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lcpimpact.arrays import Array, Indices, Matrix, Stack, Stacks, Vector
from lcpimpact.compiled import compiled
from lcpimpact.hybrid.generator import DEGREE, FINE_TERMS, Generator, SparseRows, expand_finely, move_by, summed, walk
from lcpimpact.hybrid.windows import Window
from lcpimpact.numerics.double_double import DoubleDouble, add, multiply

READING_RTOL = 2.0**-75
"""Terms of a reading in floats, relative to the largest, that are omitted after the last larger one."""


@compiled()
def read_terms(R: SparseRows, Z: Stack, a: Matrix, sums: Matrix) -> int:
    """Write R Z_i (m, p + 1) into a, and return the last term that counts in a row; ``sums`` (2, p + 1) is scratch.

    The terms after the first `FINE_TERMS` are floats, and so are their sums.
    """
    last = 0
    terms = len(Z)
    fine = min(len(Z), FINE_TERMS + 1)
    for j in range(len(a)):
        for i in range(terms):
            sums[0, i], sums[1, i] = 0.0, 0.0
        for at in range(R.starts[j], R.starts[j + 1]):
            c = float(R.entries[0, at])
            c_lo = float(R.entries[1, at])
            k = R.columns[at]
            for i in range(fine):
                x, x_lo = float(Z[i, 0, k]), float(Z[i, 1, k])
                if c != 1.0 or c_lo != 0.0:
                    x, x_lo = multiply(c, c_lo, x, x_lo)
                sums[0, i], sums[1, i] = add(float(sums[0, i]), float(sums[1, i]), x, x_lo)
            for i in range(fine, terms):
                sums[0, i] += c * Z[i, 0, k]
        size = 0.0
        for i in range(terms):
            a[j, i] = sums[0, i]
            size = max(size, abs(a[j, i]))
            last = max(last, i) if abs(a[j, i]) > READING_RTOL * size else last
    return last


@compiled()
def evaluate(a: Matrix, last: int, s: Vector, found: Matrix, first: int) -> None:
    """Write Σ a_i s^i, i <= ``last``, of each row of a (m, p + 1) and s (nt,) into found (m, ...), from column ``first``."""
    for j in range(len(a)):
        x = found[j, first : first + len(s)]
        x[:] = a[j, last]
        for i in range(last - 1, -1, -1):
            np.multiply(x, s, x)
            np.add(x, a[j, i], x)


class Expansions(NamedTuple):
    """The polynomials of R X in the windows of some segments, one segment after the other (nw).

    Attributes
    ----------
    first : (k + 1,) array          the first window of each segment, and the end; (1,) if none are kept
    last : (nw,) array              the last power that counts, or -1 as long as they are not computed
    a : (nw, m, p + 1) array        the coefficients
    together : bool                 whether all of them have been computed, as by `expand`
    """

    first: Indices
    last: Indices
    a: Stack
    together: bool


@compiled()
def moved(A: Generator, δ: float, powers: Stacks, X: Matrix, windows: int, degree: int) -> Matrix:
    """Return the state (2, N) after a number of windows, by ``powers`` exp(2ᵏ A δ), or none to walk from one to the next."""
    if len(powers) == 0:
        return walk(A, δ, X, windows, degree)
    X = X.copy()
    work = np.empty_like(X)
    bit = 0
    while windows:
        if windows & 1:
            move_by(powers[bit], X, work)
        windows, bit = windows >> 1, bit + 1
    return X


class Segments(NamedTuple):
    """Segments, one after the other (ns): their initial instants (ns, 2) and states (ns, 2, N), double-doubles."""

    starts: Matrix
    states: Stack


@compiled()
def at_windows(step: Stack, chain: Segments, mine: Indices, first: Indices) -> Stack:
    """Return the states (nw, 2, N) at the start of each window of some segments of a chain, by exp(A δ)."""
    X = np.empty((first[-1], 2, chain.states.shape[2]))
    work = np.empty_like(X[0])
    for j in range(len(mine)):
        X[first[j]] = chain.states[mine[j]]
        for w in range(first[j] + 1, first[j + 1]):
            X[w] = X[w - 1]
            move_by(step, X[w], work)
    return X


def expand(kept: Expansions, terms: DoubleDouble, states: Array) -> Expansions:
    """Return the polynomials of all windows, from their ``states`` (nw, 2, N) and the `Flow.terms` of their rows."""
    coefficients = terms @ DoubleDouble(states.transpose(1, 2, 0))
    a = np.ascontiguousarray(coefficients.hi.T).reshape(len(states), kept.a.shape[1], -1)
    return Expansions(kept.first, np.full(len(a), a.shape[2] - 1), a, True)


@compiled()
def sample(
    window: Window, powers: Stacks, chain: Segments, mine: Indices, t: Vector, bounds: Indices, R: SparseRows,
    kept: Expansions, found: Matrix,
) -> None:  # fmt: skip
    """Write R X in floats at the sorted times t (nt,) in the segments ``mine`` of a chain into ``found`` (m, nt).

    Segment i has the times t[bounds[i]] to t[bounds[i + 1] - 1]. Cancellation in R X, as in a stiff force, happens in the
    coefficients of a window, which are double-doubles; those of the windows ``kept`` are computed once. ``powers`` are as
    in `moved`.
    """
    A = window.A
    δ = window.δ
    starts = chain.starts
    states = chain.states
    degree = DEGREE
    scratch = np.empty((len(found), degree + 1))
    sums = np.empty((2, degree + 1))
    s = np.empty(len(t))
    for j in range(len(mine)):
        i, here = mine[j], 0
        first, last = bounds[i], bounds[i + 1]
        state, Z = states[i].copy(), np.empty((0, 2, states.shape[2]))
        for k in range(first, last):
            s[k] = ((t[k] - starts[i, 0]) - starts[i, 1]) / δ
        while first < last:
            w, end = int(max(s[first], 0.0)), first + 1
            while end < last and int(max(s[end], 0.0)) == w:
                end += 1
            place = kept.first[j] + w if j + 1 < len(kept.first) else len(kept.last)
            keeps = j + 1 < len(kept.first) and place < kept.first[j + 1]
            a, power = (kept.a[place], kept.last[place]) if keeps else (scratch, -1)
            if power < 0:
                if len(Z) > 0 and len(powers) == 0:
                    state, here = summed(Z), here + 1
                state, here = moved(A, δ, powers, state, w - here, degree), w
                Z = expand_finely(A, δ, state, degree)
                power = read_terms(R, Z, a, sums)
                if keeps:
                    kept.last[place] = power
            for k in range(first, end):
                s[k] -= w
            evaluate(a, power, s[first:end], found, first)
            first = end


def sample_together(
    window: Window, powers: Stacks, chain: Segments, mine: Indices, t: Vector, bounds: Indices, R: SparseRows,
    kept: Expansions, found: Matrix,
) -> None:  # fmt: skip
    """Do what `sample` does, with the same bits, where the interpreter runs: at all times at once, by known polynomials."""
    j = np.repeat(np.arange(len(mine)), np.diff(bounds)[mine])
    k = np.concatenate([np.arange(bounds[i], bounds[i + 1]) for i in mine])
    starts = chain.starts[mine[j]]
    first = kept.first[j]
    s = ((t[k] - starts[:, 0]) - starts[:, 1]) / window.δ
    place = np.minimum(first + np.maximum(s, 0.0).astype(np.int64), kept.first[j + 1] - 1)
    s -= place - first
    a = np.ascontiguousarray(kept.a.T)
    x = a[-1].take(place, axis=1)
    for each in a[-2::-1]:
        x *= s
        x += each.take(place, axis=1)
    found[:, k] = x
