r"""The rows of a step whose equations A w = b have banded matrices, with w as unknowns beside the knowns.

A table of n nodes without w is dense, for A⁻¹ has no zeros: it takes n² products a step. With w it is sparse,

.. math:: A_1 w_1 = B_1 x + c_1, \qquad A_2 w_2 = B_2 (x, w_1) + c_2, \quad \dots, \qquad \text{rows} = S (x, w) + c,

where x are the state, a place for the constant 1, the loads and the impulses P of each law. Each w takes two sweeps over the
factors of its A.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from scipy import sparse

from lcpimpact.arrays import Array, Sparse, Stack, Vector
from lcpimpact.compiled import compiled
from lcpimpact.integrators.stepping.stencil import Stencil, apply, stencil
from lcpimpact.numerics.banded import factor, half_bandwidth, lower_bands, solve_banded


class BandedTable(NamedTuple):
    """The rows of a step and its equations A w = b; no factors where the dense table is taken.

    Attributes
    ----------
    right : Stencil                     the right sides b of all equations (m n rows), of (x, w)
    factors : (m, width, n) array       the factors of each A, as of `factor`
    rows : Stencil                      the rows of the table, of (x, w)
    """

    right: Stencil
    factors: Stack
    rows: Stencil


EMPTY = stencil(sparse.csr_array((0, 0)))
DENSE = BandedTable(EMPTY, np.zeros((0, 0, 0)), EMPTY)
"""The place holder of steps that take the dense table."""


def banded_table(
    equations: list[tuple[Array, Array]], rows: Array, one: int, dense: Any, *, banded_cost: float = 4.0
) -> BandedTable:
    """Return the banded form of a step, or `DENSE` where it has none, would take longer, or is another function.

    ``banded_cost``: time of a product of banded rows, or of a sweep, over the time of a product of a dense table.

    Parameters
    ----------
    equations : list of (A, b)      each with a row of b, in the symbols of x and w, for a row of A
    rows : array                    the rows of the table in the same symbols
    one : int                       the column of the constant 1
    dense : StepTable               the dense table
    """
    matrices = [sparse.csr_array(A) for A, _ in equations]
    if not matrices or any((A != A.T).nnz for A in matrices):
        return DENSE
    width = max(half_bandwidth(A) for A in matrices)
    sides, ends = (sparse.csr_array(each) for each in (np.vstack([b for _, b in equations]), rows))
    terms = sides.nnz + ends.nnz + 2 * (width + 1) * sides.shape[0]
    if banded_cost * terms > dense.known.size:
        return DENSE
    factors = np.array([lower_bands(A, width) for A in matrices])
    if not all(factor(each, each[:0], 0.0) for each in factors):
        return DENSE
    table = BandedTable(_affine(sides, one), factors, _affine(ends, one))
    return table if _agrees(table, one, dense) else DENSE


def _agrees(table: BandedTable, one: int, dense: Any, *, agrees_rtol: float = 1e-6) -> bool:
    """Return whether a table has the rows of the dense one for some x, to rounding.

    That of equations that read the coefficients of their symbols has others.

    ``agrees_rtol``: largest difference of a banded row from the dense one, relative to its terms, that counts as
    rounding.
    """
    columns = np.vstack([dense.known, dense.unknown])
    equations = len(table.right.c)
    rows = np.zeros(len(table.rows.c))
    x = np.cos(np.arange(float(len(columns))))
    x[one] = 1.0
    find_rows(table, np.concatenate([x, np.zeros(equations)]), np.zeros(equations), rows)
    return bool(np.all(np.abs(rows - x @ columns) <= agrees_rtol * (np.abs(x) @ np.abs(columns))))


def _affine(rows: Sparse, one: int) -> Stencil:
    """Return symbols as a stencil, with the column of the constant 1 apart."""
    constants = rows[:, [one]].toarray()[:, 0]
    rows = rows @ sparse.diags_array(np.where(np.arange(rows.shape[1]) == one, 0.0, 1.0))
    rows.eliminate_zeros()
    return stencil(rows, constants)


@compiled()
def find_rows(table: BandedTable, x: Vector, right: Vector, rows: Vector) -> None:
    """Solve the equations in turn, writing w behind the knowns in x, and write the rows."""
    equations, n = len(table.factors), table.factors.shape[2]
    first = len(x) - equations * n
    for e in range(equations):
        apply(table.right, x, right)
        w = x[first + e * n : first + (e + 1) * n]
        for i in range(n):
            w[i] = right[e * n + i]
        solve_banded(table.factors[e], w)
    apply(table.rows, x, rows)
