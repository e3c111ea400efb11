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

Of many springs the parameters are the rows of an array (ns, 5): gap, K, n, b and c.
"""

from __future__ import annotations

import numpy as np

from lcpimpact.arrays import Array, Matrix, Vector
from lcpimpact.compiled import compiled


@compiled()
def hysteretic_force(K: float, n: float, b: float, δ: float, rate: float) -> tuple[float, float, float]:
    """Return K |δ|ⁿ sign δ (1 + b δ') in N, an odd function of δ, and its derivatives by δ and δ'."""
    secant = K * abs(δ) ** (n - 1.0)
    loss = 1.0 + b * rate
    return secant * δ * loss, n * secant * loss, b * secant * δ


@compiled()
def extended_force(K: float, n: float, b: float, c: float, δ: float, rate: float) -> tuple[float, float, float]:
    """Return K |δ|ⁿ sign δ (1 + b δ') + c δ' in N and its derivatives by δ and δ': s, extended smoothly through its zero."""
    s, by_δ, by_rate = hysteretic_force(K, n, b, δ, rate)
    return s + c * rate, by_δ, by_rate + c


@compiled()
def spring_force(K: float, n: float, b: float, c: float, δ: float, rate: float) -> tuple[float, float, float]:
    """Return s(δ, δ') in N, ∂s/∂δ and ∂s/∂δ'."""
    if not δ > 0.0:
        return 0.0, 0.0, 0.0
    s, by_δ, by_rate = extended_force(K, n, b, c, δ, rate)
    if c > 0.0 and s < 0.0:
        return 0.0, 0.0, 0.0
    return s, by_δ, by_rate


@compiled()
def mean_force(
    K: float, n: float, b: float, c: float, δ: float, rate: float, h: float
) -> tuple[float, float, float]:  # fmt: skip
    """Return F(δ, δ') in N over a step of length h, ∂F/∂δ and ∂F/∂δ'."""
    F = by_δ = by_rate = 0.0
    if δ > 0.0:
        F, by_δ, by_rate = hysteretic_force(K, n, b, δ, rate)
    if c > 0.0:
        start, end = δ - 0.5 * h * rate, δ + 0.5 * h * rate
        if start > 0.0 and end > 0.0:
            # Not the difference of the two, which would be rounded to nothing where δ is large beside h δ'.
            F += c * rate
            by_rate += c
        elif end > 0.0:
            F += c / h * end
            by_δ += c / h
            by_rate += 0.5 * c
        elif start > 0.0:
            F -= c / h * start
            by_δ -= c / h
            by_rate += 0.5 * c
        if F < 0.0:
            return 0.0, 0.0, 0.0
    return F, by_δ, by_rate


@compiled()
def force_at_rate(
    K: float, n: float, b: float, c: float, δ: float, y: float, θh: float, h: float
) -> tuple[float, float]:
    """Return F in N and dF/dy for ends that separate at the rate y in a step: at the penetration δ - θ h y, with δ' = -y."""
    F, by_δ, by_rate = mean_force(K, n, b, c, δ - θh * y, -y, h)
    return F, -by_rate - θh * by_δ


@compiled()
def spring_energy(K: float, n: float, δ: float) -> float:
    """Return the stored energy K δ_+ⁿ⁺¹/(n + 1) in J."""
    return float(K * δ ** (n + 1.0) / (n + 1.0)) if δ > 0.0 else 0.0


def forces(laws: Array, δ: Array, rate: Array, extended: bool = False) -> Array:
    """Return s of springs in N, or the extended force, which disregards contact (..., ns).

    Parameters
    ----------
    laws : (ns, 5) array
        Gap, K, n, b and c of each spring.
    δ, rate : (..., ns) arrays
        Penetration in m and its rate in m/s.
    extended : bool
        Whether the force is `extended_force` in place of `spring_force`.
    """
    return np.asarray(_evaluate(laws, δ, rate, extended, 1)[0])


def tangents(laws: Array, δ: Array, rate: Array, extended: bool = False) -> Array:
    """Return s, ∂s/∂δ and ∂s/∂δ' of springs (3, ..., ns), with the parameters of `forces`."""
    return _evaluate(laws, δ, rate, extended, 3)


def energies(laws: Array, δ: Array) -> Array:
    """Return the stored energy of springs in J, with the shape of δ (..., ns)."""
    return _energies(laws, np.ravel(δ)).reshape(np.shape(δ))


def _evaluate(laws: Array, δ: Array, rate: Array, extended: bool, count: int) -> Array:
    """Return the first ``count`` of s, ∂s/∂δ and ∂s/∂δ' (count, ..., ns)."""
    if np.shape(δ) != np.shape(rate):
        δ, rate = np.broadcast_arrays(δ, rate)
    found = np.empty((count, *np.shape(δ)))
    _fill(laws, np.ravel(δ), np.ravel(rate), extended, found.reshape(count, -1))
    return found


@compiled()
def _fill(laws: Matrix, δ: Vector, rate: Vector, extended: bool, found: Matrix) -> None:
    """Write s (1, m), or s, ∂s/∂δ and ∂s/∂δ' (3, m), for δ and rate (m,), in which the springs take turns."""
    for a in range(len(laws)):
        _, K, n, b, c = laws[a]
        for i in range(a, len(δ), len(laws)):
            if extended:
                s, by_δ, by_rate = extended_force(K, n, b, c, δ[i], rate[i])
            else:
                s, by_δ, by_rate = spring_force(K, n, b, c, δ[i], rate[i])
            found[0, i] = s
            if len(found) > 1:
                found[1, i], found[2, i] = by_δ, by_rate


@compiled()
def _energies(laws: Matrix, δ: Vector) -> Vector:
    """Return the energies (m,) for δ (m,), in which the springs take turns."""
    found = np.empty(len(δ))
    for a in range(len(laws)):
        for i in range(a, len(δ), len(laws)):
            found[i] = spring_energy(laws[a, 1], laws[a, 2], δ[i])
    return found


@compiled()
def mean_forces(laws: Matrix, δ: Matrix, rate: Matrix, h: Vector) -> Matrix:
    """Return F(δ, δ') of each spring in each step (nt, ns); laws (ns, 5), δ and rate (nt, ns), h (nt,)."""
    F = np.empty_like(δ)
    for k in range(len(h)):
        for a in range(len(laws)):
            _, K, n, b, c = laws[a]
            F[k, a], _, _ = mean_force(K, n, b, c, δ[k, a], rate[k, a], h[k])
    return F
