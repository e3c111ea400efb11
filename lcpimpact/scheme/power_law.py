r"""The compliant contact law: force, derivatives, stored energy, and mean force over a step.

With the penetration δ and its rate δ' the force that pushes the ends of a non-linear spring apart is

.. math:: s(δ, δ') = K δ^n (1 + b δ') + c δ' \quad (δ > 0), \qquad s = 0 \quad (δ \le 0) .

It is Hertz's law where b = c = 0, Hunt and Crossley's where c = 0, and Kelvin and Voigt's where n = 1 and b = 0. With c > 0
it jumps where the ends touch, and is zero too where the sum is negative: the contact does not pull. The spring stores
K δ_+ⁿ⁺¹/(n + 1), with δ_+ = max(δ, 0), and dissipates the power (s(δ, δ') - s(δ, 0)) δ'.

No root of a function of δ' could follow the jump. But the mean of the damping over a step of length h has none, since
c δ' dt on δ > 0 is c times the change of δ_+:

.. math:: F(δ, δ') = K δ_+^n (1 + b δ') + \frac ch \bigl((δ + \tfrac h2 δ')_+ - (δ - \tfrac h2 δ')_+\bigr),

where δ is the penetration at the middle of the step. It grows with δ', so a step has a solution whether the spring is
touched in it or not, and the impulse of the step in which it is touched is right. With c > 0 the force is zero where F < 0.

The parameters of one spring stand in a vector (5,): gap, K, n, b and c.
"""

from __future__ import annotations

import numpy as np
from numba import types

from lcpimpact.arrays import Array
from lcpimpact.compiled import compiled, f8, matrix, vector

TRIPLE = types.UniTuple(f8, 3)


@compiled(TRIPLE(vector, f8, f8))
def hysteretic_force(law: Array, δ: float, rate: float) -> tuple[float, float, float]:
    """Return K |δ|ⁿ sign δ (1 + b δ') in N, an odd function of δ, and its derivatives by δ and δ'."""
    _, K, n, b, _ = law
    secant = K * abs(δ) ** (n - 1.0)
    loss = 1.0 + b * rate
    return secant * δ * loss, n * secant * loss, b * secant * δ


@compiled(TRIPLE(vector, f8, f8))
def extended_force(law: Array, δ: float, rate: float) -> tuple[float, float, float]:
    """Return K |δ|ⁿ sign δ (1 + b δ') + c δ' in N and its derivatives by δ and δ': s, extended smoothly through its zero."""
    s, by_δ, by_rate = hysteretic_force(law, δ, rate)
    return s + law[4] * rate, by_δ, by_rate + law[4]


@compiled(TRIPLE(vector, f8, f8))
def spring_force(law: Array, δ: float, rate: float) -> tuple[float, float, float]:
    """Return s(δ, δ') in N, ∂s/∂δ and ∂s/∂δ'."""
    if not δ > 0.0:
        return 0.0, 0.0, 0.0
    s, by_δ, by_rate = extended_force(law, δ, rate)
    if law[4] > 0.0 and s < 0.0:
        return 0.0, 0.0, 0.0
    return s, by_δ, by_rate


@compiled(TRIPLE(vector, f8, f8, f8))
def mean_force(law: Array, δ: float, rate: float, h: float) -> tuple[float, float, float]:
    """Return F(δ, δ') in N over a step of length h, ∂F/∂δ and ∂F/∂δ'."""
    c, start, end = law[4], δ - 0.5 * h * rate, δ + 0.5 * h * rate
    if c == 0.0 or (start > 0.0 and end > 0.0):
        # Not by the difference of the ends, which would be rounded to nothing where δ is large beside h δ'.
        return spring_force(law, δ, rate)
    F, by_δ, by_rate = 0.0, 0.0, 0.0
    if δ > 0.0:
        F, by_δ, by_rate = hysteretic_force(law, δ, rate)
    if end > 0.0:
        F, by_δ, by_rate = F + c / h * end, by_δ + c / h, by_rate + 0.5 * c
    elif start > 0.0:
        F, by_δ, by_rate = F - c / h * start, by_δ - c / h, by_rate + 0.5 * c
    if F < 0.0:
        return 0.0, 0.0, 0.0
    return F, by_δ, by_rate


@compiled(f8(vector, f8))
def spring_energy(law: Array, δ: float) -> float:
    """Return the stored energy K δ_+ⁿ⁺¹/(n + 1) in J."""
    _, K, n, _, _ = law
    return float(K * max(δ, 0.0) ** (n + 1.0) / (n + 1.0))


def forces(laws: Array, δ: Array, rate: Array, extended: bool = False) -> Array:
    """Return s, ∂s/∂δ and ∂s/∂δ' of springs (3, ..., ns), or those of the extended force.

    Parameters
    ----------
    laws : (ns, 5) array
        Gap, K, n, b and c of each spring.
    δ, rate : (..., ns) arrays
        Penetration in m and its rate in m/s.
    extended : bool
        Whether the force is `extended_force`, without regard to contact, in place of `spring_force`.
    """
    if np.shape(δ) != np.shape(rate):
        δ, rate = np.broadcast_arrays(δ, rate)
    return _forces(laws, np.ravel(δ), np.ravel(rate), extended).reshape(3, *np.shape(δ))


def energies(laws: Array, δ: Array) -> Array:
    """Return the stored energy of springs in J, with the shape of δ (..., ns)."""
    return _energies(laws, np.ravel(δ)).reshape(np.shape(δ))


@compiled(matrix(matrix, vector, vector, types.boolean))
def _forces(laws: Array, δ: Array, rate: Array, extended: bool) -> Array:
    """Return the three of `forces` (3, m) for δ and rate (m,), in which the springs take turns."""
    found = np.empty((3, len(δ)))
    for i in range(len(δ)):
        law = laws[i % len(laws)]
        if extended:
            found[0, i], found[1, i], found[2, i] = extended_force(law, δ[i], rate[i])
        else:
            found[0, i], found[1, i], found[2, i] = spring_force(law, δ[i], rate[i])
    return found


@compiled(vector(matrix, vector))
def _energies(laws: Array, δ: Array) -> Array:
    """Return the energies (m,) for δ (m,), in which the springs take turns."""
    found = np.empty(len(δ))
    for i in range(len(δ)):
        found[i] = spring_energy(laws[i % len(laws)], δ[i])
    return found


@compiled(matrix(matrix, matrix, matrix, vector))
def mean_forces(laws: Array, δ: Array, rate: Array, h: Array) -> Array:
    """Return F(δ, δ') of each spring in each step (nt, ns); laws (ns, 5), δ and rate (nt, ns), h (nt,)."""
    F = np.empty_like(δ)
    for k in range(len(h)):
        for a in range(len(laws)):
            F[k, a], _, _ = mean_force(laws[a], δ[k, a], rate[k, a], h[k])
    return F
