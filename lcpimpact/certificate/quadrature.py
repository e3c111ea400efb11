"""Gaussian quadrature over the pieces of a continuous solution, with an estimate of its error."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lcpimpact.arrays import Array

GAUSS_NODES, GAUSS_WEIGHTS = np.polynomial.legendre.leggauss(6)

SAMPLES = len(GAUSS_NODES) + 2
"""Samples of a piece: both of its ends, and the Gauss nodes."""

LEGENDRE = np.polynomial.legendre.legvander(GAUSS_NODES, 5) * GAUSS_WEIGHTS[:, None] * (np.arange(6) + 0.5)
"""Matrix from values at the Gauss nodes to Legendre coefficients."""


@dataclass(frozen=True, eq=False)
class Pieces:
    """The pieces of a motion between cuts, and integrals over them by Gaussian quadrature.

    Attributes
    ----------
    cuts : (nk,) array          in ascending order
    lengths : (nk - 1,) array   the length of each piece
    samples : (ns,) array       the cuts, each followed by the Gauss nodes of its piece
    times : (nt,) array         the Gauss nodes in ascending order
    """

    cuts: Array
    lengths: Array
    samples: Array
    times: Array

    @classmethod
    def between(cls, instants: Array) -> Pieces:
        """Return the pieces between some instants, in any order."""
        instants = np.sort(instants)
        cuts = instants[np.append(True, instants[1:] > instants[:-1])]
        lengths = cuts[1:] - cuts[:-1]
        samples = np.empty(len(lengths) * (SAMPLES - 1) + 1)
        samples[-1] = cuts[-1]
        inner = samples[:-1].reshape(-1, SAMPLES - 1)
        half = 0.5 * lengths[:, None]
        inner[:, 0] = cuts[:-1]
        inner[:, 1:] = (cuts[:-1, None] + half) + half * GAUSS_NODES
        return cls(cuts, lengths, samples, inner[:, 1:].ravel())

    def at_cuts(self, values: Array) -> Array:
        """Return the values at the cuts (nk, m), of the values (ns, m) at the samples."""
        return values[:: SAMPLES - 1]

    def at_nodes(self, values: Array) -> Array:
        """Return the values at the Gauss nodes (nt, m), of the values (ns, m) at the samples."""
        m, pieces = values.shape[1], len(self.cuts) - 1
        inner = values.T[:, :-1].reshape(m, pieces, SAMPLES - 1)[:, :, 1:]
        return inner.reshape(m, pieces * len(GAUSS_NODES)).T

    def each(self, values: Array) -> Array:
        """Return the integral of values (nt, ...) at the nodes over each piece (nk - 1, ...)."""
        inner = np.asarray(values).reshape(len(self.cuts) - 1, len(GAUSS_NODES), *values.shape[1:])
        return np.asarray(np.einsum("kg...,g,k->k...", inner, GAUSS_WEIGHTS, 0.5 * self.lengths))

    def integral(self, values: Array) -> Array:
        """Return the integral of values (nt, ...) at the nodes from the first cut to each (nk, ...)."""
        pieces = self.each(values)
        return np.concatenate([np.zeros((1, *values.shape[1:])), np.cumsum(pieces, axis=0)])

    def unresolved(self, values: Array, degree: int) -> Array:
        """Return h Σ |a_j|, j = ``degree`` ... 5, with the Legendre coefficients a_j on each piece (nk - 1, ...)."""
        inner = np.asarray(values).reshape(len(self.cuts) - 1, len(GAUSS_NODES), *values.shape[1:])
        a = np.abs(np.einsum("kg...,gj->kj...", inner, LEGENDRE[:, min(degree, 5) :])).sum(axis=1)
        return np.asarray(a * self.lengths.reshape(-1, *[1] * (values.ndim - 1)))

    def error(self, values: Array, order: float) -> Array:
        """Return the estimated error of the integral of values (nt, n) of a solution of given order up to each cut (nk, n).

        The estimate uses the highest Legendre coefficients on each piece; it is zero for an exact solution.
        """
        if np.isinf(order):
            return np.zeros((len(self.cuts), values.shape[1]))
        pieces = self.unresolved(values, int(order) - 1)
        return np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(pieces, axis=0)])


def interleaved(first: Array, then: Array) -> Array:
    """Return the rows of two arrays in turn, which begin with one of the first (ns, ...)."""
    found = np.empty((len(first) + len(then), *first.shape[1:]))
    found[::2], found[1::2] = first, then
    return found
