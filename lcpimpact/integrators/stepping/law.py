"""The contact problem of a step: its LCP is solved, judged outside the solver, counted, and tried by other solvers."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np
from numba import types

from lcpimpact.arrays import Array
from lcpimpact.compiled import compiled, f8, i8, matrix, vector
from lcpimpact.errors import Status, UnsupportedError
from lcpimpact.lcp import SOLVERS
from lcpimpact.lcp.judge import clear_residual, holds, measure
from lcpimpact.lcp.operators import Delassus
from lcpimpact.lcp.problem import KERNEL
from lcpimpact.lcp.solver import Kernel, State

SOLVED, INACCURATE, NON_FINITE = int(Status.SOLVED), int(Status.INACCURATE), int(Status.NON_FINITE)

Springs: TypeAlias = Callable[..., tuple[int, int, int, float]]

SPRINGS_SIGNATURE: Any = types.Tuple((i8, i8, i8, f8))(
    matrix, vector, vector, vector, vector, vector, types.boolean, f8, i8, KERNEL,
    matrix, matrix, matrix, vector, vector, matrix, f8, f8, vector, vector,
)  # fmt: skip
"""Of `newton.solve_with_springs`, the solver for schemes with non-linear springs."""

SPRINGS: Any = types.FunctionType(SPRINGS_SIGNATURE)


@compiled(types.Tuple((i8, f8))(i8, matrix, vector, vector, vector, vector, vector, f8))
def examine(
    status: int, W: Array, b: Array, lower: Array, upper: Array, z: Array, gap: Array, tol: float
) -> tuple[int, float]:
    """Judge an answer that is not clear, outside the solver: status and residual."""
    residual, _, rounding = measure(W, b, lower, upper, z, gap)
    if status == SOLVED and not holds(residual, rounding, tol):
        return INACCURATE if residual < np.inf else NON_FINITE, residual
    return status, residual


@compiled(
    types.Tuple((i8, i8, f8))(matrix, vector, vector, vector, vector, vector, types.boolean, f8, i8, KERNEL)
)  # fmt: skip
def solve_law(
    W: Array,
    b: Array,
    lower: Array,
    upper: Array,
    z: Array,
    gap: Array,
    plain: bool,
    tol: float,
    max_iter: int,
    solve: Kernel,
) -> tuple[int, int, float]:
    """Solve the LCP of a step, and judge the answer outside the solver: status, iterations, residual."""
    status, count = solve(W, b, lower, upper, z, tol, max_iter)
    residual = clear_residual(W, b, z, tol) if plain else np.inf
    if residual == np.inf:
        status, residual = examine(status, W, b, lower, upper, z, gap, tol)
    return status, count, residual


@compiled(SPRINGS_SIGNATURE)
def no_springs(
    W: Array, b: Array, lower: Array, upper: Array, z: Array, gap: Array, plain: bool, tol: float, max_iter: int,
    solve: Kernel, HGs: Array, NG: Array, NGs: Array, y_free: Array, δ: Array, law: Array, θh: float, h: float,
    y: Array, s: Array,
) -> tuple[int, int, int, float]:  # fmt: skip
    """Stand where a scheme has no non-linear springs: it is never called."""
    return SOLVED, 0, 0, 0.0


def with_fallbacks(
    run: Callable[[State, int, int], tuple[Status, int]], solver: State, contacts: Delassus, first: int, last: int
) -> tuple[Status, int]:
    """Take steps by ``run(solver, first, last)``; one whose LCP is not solved is tried by those the solver falls back on."""
    status, reached = run(solver, first, last)
    while status is not Status.SOLVED:
        for name in solver.fallbacks:
            method = SOLVERS[name]
            try:
                method.check(contacts)
            except UnsupportedError:
                continue
            again, after = run(method.init(contacts), reached, reached + 1)
            if again is Status.SOLVED:
                break
        else:
            return status, reached
        if after == last:
            return Status.SOLVED, last
        status, reached = run(solver, after, last)
    return status, reached
