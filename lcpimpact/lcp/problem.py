r"""The linear complementarity problem, its solution, and the judge of every answer.

.. math:: w = M z + q, \qquad 0 \le z \perp w \ge 0
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import types
from numpy.typing import ArrayLike

from lcpimpact.arrays import Array
from lcpimpact.compiled import compiled, f8, i8, matrix, vector
from lcpimpact.errors import InputError, Status


def real_array(name: str, values: ArrayLike) -> Array:
    """Return a C-ordered copy in float64, refusing what is no array of real numbers."""
    try:
        array = np.array(values, order="C")
        if array.dtype.kind in "fiub":
            return array.astype(np.float64)
    except (TypeError, ValueError, OverflowError):
        pass
    raise InputError(f"{name} must be an array of real numbers, all rows of one length, and it is {values!r}")


@dataclass(frozen=True)
class LCP:
    """LCP(M, q): find z >= 0 with w = M z + q >= 0 and z·w = 0.

    Parameters
    ----------
    M : (n, n) array
        Any square matrix of finite numbers.
    q : (n,) array
        Finite numbers.

    Raises
    ------
    InputError
        If M is not square, q does not fit, or a number is not finite.
    """

    M: Array
    q: Array

    @classmethod
    def checked(cls, M: ArrayLike, q: ArrayLike) -> LCP:
        """Coerce to C-ordered float64 and check shapes and numbers."""
        matrix_, vector_ = real_array("M", M), real_array("q", q)
        if matrix_.ndim != 2 or matrix_.shape[0] != matrix_.shape[1]:
            raise InputError(f"M must be square, and its shape is {matrix_.shape}")
        if vector_.shape != (len(matrix_),):
            raise InputError(f"q must have shape ({len(matrix_)},) to fit M, and its shape is {vector_.shape}")
        if len(vector_) == 0:
            raise InputError("the LCP is empty: give at least one row")
        for name, array in (("M", matrix_), ("q", vector_)):
            if not np.isfinite(array).all():
                raise InputError(f"{name} has an entry that is not finite: replace NaN and inf before solving")
        return cls(matrix_, vector_)


@dataclass(frozen=True)
class LCPSolution:
    """What a solver found, judged from outside.

    Attributes
    ----------
    z, w : (n,) arrays      the answer and M z + q
    status : Status
    residual : float        ‖min(z, w)‖_inf / max(1, ‖q‖_inf)
    iterations : int        pivots, sweeps or backend iterations
    solver : str            the solver that gave the answer
    """

    z: Array
    w: Array
    status: Status
    residual: float
    iterations: int
    solver: str

    @property
    def success(self) -> bool:
        """Whether the status is SOLVED."""
        return self.status is Status.SOLVED

    @property
    def message(self) -> str:
        """The status in words, with its remedy."""
        return self.status.sentence


def natural_residual(M: Array, q: Array, z: Array) -> float:
    """Return ‖min(z, M z + q)‖_inf / max(1, ‖q‖_inf), which is zero at solutions and nowhere else."""
    defect = np.abs(np.minimum(z, M @ z + q)).max()
    return float(defect / max(1.0, np.abs(q).max())) if np.isfinite(defect) else np.inf


@compiled(f8(matrix, vector, vector))
def scaled_residual(M: Array, q: Array, z: Array) -> float:
    """Return the natural residual of LCP(M/s, q/p) at z s/p, with s = max |M|, p = max |q|: free of the data's units.

    This is what the judge of every answer looks at; NaN counts as infinite.
    """
    s, p = 0.0, 0.0
    for i in range(len(q)):
        p = max(p, abs(q[i]))
        for j in range(len(q)):
            s = max(s, abs(M[i, j]))
    p = p if p > 0.0 else 1.0
    s = s if s > 0.0 else 1.0
    residual = 0.0
    for i in range(len(q)):
        w = q[i]
        for j in range(len(q)):
            w += M[i, j] * z[j]
        w /= p
        zi = z[i] * (s / p)
        if not (w == w and zi == zi):
            return np.inf
        residual = max(residual, abs(min(zi, w)))
    return residual


KERNEL = types.FunctionType(types.UniTuple(i8, 2)(matrix, vector, vector, f8, i8))
"""Type of a compiled solver: kernel(M, q, z, tol, max_iter) -> (status, iterations); z holds a guess and the answer."""
