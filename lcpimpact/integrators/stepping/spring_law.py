r"""The force of a non-linear spring in a step: what Newton's method solves for and the certificate counts.

A spring with c > 0 has a force that jumps where its ends touch, which no root of a function of their rate could follow. But
the mean of the damping over a step has no jump, since c δ' dt on δ > 0 is c times the change of δ_+ = max(δ, 0):

.. math:: F(δ, y) = K δ_+^n (1 - b y) + \frac ch \bigl((δ - \tfrac h2 y)_+ - (δ + \tfrac h2 y)_+\bigr),

where δ is the approach at the middle of the step and y = -δ' the rate at which the ends part in it. It falls with y, so a
step has a solution whether the spring is touched in it or not, and the impulse of the step in which it is touched is right.
With c > 0 the force is zero where F < 0.
"""

from __future__ import annotations

import numpy as np
from numba import types

from lcpimpact.arrays import Array
from lcpimpact.compiled import compiled, f8, matrix, vector


@compiled(types.UniTuple(f8, 3)(vector, f8, f8, f8))
def push(law: Array, δ: float, y: float, h: float) -> tuple[float, float, float]:
    """Return F(δ, y) in N over a step of length h, ∂F/∂δ and ∂F/∂y; law (5,) holds gap, K, n, b and c."""
    _, K, n, b, c = law
    F = by_δ = by_y = 0.0
    if δ > 0.0:
        stiffness = K * δ ** (n - 1.0)
        F = stiffness * δ * (1.0 - b * y)
        by_δ = n * stiffness * (1.0 - b * y)
        by_y = -b * stiffness * δ
    if c > 0.0:
        before, after = δ + 0.5 * h * y, δ - 0.5 * h * y
        if before > 0.0 and after > 0.0:
            # Not the difference of the two, which would be rounded to nothing where δ is large beside h y.
            F -= c * y
            by_y -= c
        elif after > 0.0:
            F += c / h * after
            by_δ += c / h
            by_y -= 0.5 * c
        elif before > 0.0:
            F -= c / h * before
            by_δ -= c / h
            by_y -= 0.5 * c
        if F < 0.0:
            return 0.0, 0.0, 0.0
    return F, by_δ, by_y


@compiled(matrix(matrix, matrix, matrix, vector))
def pushes(laws: Array, δ: Array, y: Array, h: Array) -> Array:
    """Return F(δ, y) of each spring in each step (nt, ns); laws (ns, 5), δ and y (nt, ns), h (nt,)."""
    F = np.empty_like(δ)
    for k in range(len(h)):
        for a in range(len(laws)):
            F[k, a], _, _ = push(laws[a], δ[k, a], y[k, a], h[k])
    return F
