r"""The compliant contact law: force, derivatives, stored energy, and mean force over a step.

With the penetration δ and its rate δ' the force that pushes the ends of a non-linear spring apart is

.. math:: s(δ, δ') = K δ^n (1 + b δ') + c\, D(δ)\, δ' \quad (δ > 0), \qquad s = 0 \quad (δ \le 0),

between a K δⁿ and A K δⁿ, a ≤ 1 ≤ A. D = δᵖ, or with a depth d the step function D = z² (3 - 2 z) of z = min(δ/d, 1). It is
Hertz's law where b = c = 0, Hunt and Crossley's where c = 0, and Kelvin and Voigt's without tension where n = 1, D = 1 and
a = 0. With p = 0 it jumps where the ends touch. The spring stores K δ_+ⁿ⁺¹/(n + 1), with δ_+ = max(δ, 0), and dissipates the
power (s(δ, δ') - s(δ, 0)) δ'.

No root of a function of δ' could follow the jump. But the mean of the damping over a step of length h has none, since
c D(δ) δ' dt is c times the change of G(δ) = ∫ D from 0 to δ_+:

.. math:: F(δ, δ') = K δ_+^n (1 + b δ') + \frac ch \bigl(G(δ + \tfrac h2 δ') - G(δ - \tfrac h2 δ')\bigr),

where δ is the penetration at the middle of the step. It grows with δ', so a step has a solution whether the spring is
touched in it or not, and the impulse of the step in which it is touched is right. F has the bounds of s.

Of many springs the parameters are the rows of an array (ns, 9): gap, K, n, b, c, p, d (0 for δᵖ), a and A.
"""

from __future__ import annotations

import math

import numpy as np

from lcpimpact.arrays import Array, Matrix, Vector
from lcpimpact.compiled import compiled


@compiled()
def hysteretic_force(law: Vector, δ: float, rate: float) -> tuple[float, float, float]:
    """Return K |δ|ⁿ sign δ (1 + b δ') in N, an odd function of δ, and its derivatives by δ and δ'."""
    secant = law[1] * abs(δ) ** (law[2] - 1.0)
    loss = 1.0 + law[3] * rate
    return secant * δ * loss, law[2] * secant * loss, law[3] * secant * δ


@compiled()
def damping(law: Vector, δ: float) -> tuple[float, float]:
    """Return D and D' at δ >= 0."""
    p, depth = law[5], law[6]
    if depth > 0.0:
        z = min(δ / depth, 1.0)
        return z * z * (3.0 - 2.0 * z), 6.0 * z * (1.0 - z) / depth
    if p == 0.0:
        return 1.0, 0.0
    if δ == 0.0:
        return 0.0, 0.0
    D = δ**p
    return D, p * D / δ


@compiled()
def damping_passed(law: Vector, a: float, b: float, width: float) -> float:
    """Return ∫ D from a to b = a + width, a >= 0, without the cancellation of a difference where the width is small."""
    p, depth = law[5], law[6]
    if depth > 0.0:
        if a >= depth:
            return width
        beyond = max(b - depth, 0.0)
        # Simpson's rule is exact for this D.
        first, _ = damping(law, a)
        middle, _ = damping(law, a + 0.5 * (width - beyond))
        last, _ = damping(law, b)
        return float((width - beyond) * (first + 4.0 * middle + last) / 6.0 + beyond)
    if p == 0.0:
        return width
    u = width / (a + b)
    if u < 0.01:
        series = 1.0 + p * (p - 1.0) / 6.0 * u * u * (1.0 + (p - 2.0) * (p - 3.0) / 20.0 * u * u)
        return float(width * (0.5 * (a + b)) ** p * series)
    return float((b ** (p + 1.0) - a ** (p + 1.0)) / (p + 1.0))


@compiled()
def extended_force(law: Vector, δ: float, rate: float) -> tuple[float, float, float]:
    """Return K |δ|ⁿ sign δ (1 + b δ') + c D(|δ|) δ' in N and its derivatives: s without bounds, through its zero."""
    s, by_δ, by_rate = hysteretic_force(law, δ, rate)
    c = law[4]
    if c > 0.0:
        D, slope = damping(law, abs(δ))
        s += c * D * rate
        by_δ += c * (slope if δ > 0.0 else -slope) * rate
        by_rate += c * D
    return s, by_δ, by_rate


@compiled()
def bounded(law: Vector, δ: float, s: float, by_δ: float, by_rate: float) -> tuple[float, float, float]:
    """Return a force and its derivatives at δ, or those of the bound that it is beyond: a K δ_+ⁿ or A K δ_+ⁿ."""
    elastic = stiffness = 0.0
    if δ > 0.0:
        elastic, stiffness, _ = hysteretic_force(law, δ, 0.0)
    if law[7] > -np.inf and s < law[7] * elastic:
        return law[7] * elastic, law[7] * stiffness, 0.0
    if law[8] < np.inf and s > law[8] * elastic:
        return law[8] * elastic, law[8] * stiffness, 0.0
    return s, by_δ, by_rate


@compiled()
def spring_force(law: Vector, δ: float, rate: float) -> tuple[float, float, float]:
    """Return s(δ, δ') in N, ∂s/∂δ and ∂s/∂δ'."""
    if not δ > 0.0:
        return 0.0, 0.0, 0.0
    s, by_δ, by_rate = extended_force(law, δ, rate)
    return bounded(law, δ, s, by_δ, by_rate)


@compiled()
def mean_force(law: Vector, δ: float, rate: float, h: float) -> tuple[float, float, float]:
    """Return F(δ, δ') in N over a step of length h, ∂F/∂δ and ∂F/∂δ'."""
    F = by_δ = by_rate = 0.0
    if δ > 0.0:
        F, by_δ, by_rate = hysteretic_force(law, δ, rate)
    c = law[4]
    if c > 0.0:
        half = 0.5 * h * abs(rate)
        a, b = δ - half, δ + half
        if b > 0.0:
            D, _ = damping(law, b)
            D_a = 0.0
            if a > 0.0:
                D_a, _ = damping(law, a)
                passed = damping_passed(law, a, b, 2.0 * half)
            else:
                passed = damping_passed(law, 0.0, b, b)
            F += math.copysign(c / h * passed, rate)
            by_δ += math.copysign(c / h * (D - D_a), rate)
            by_rate += 0.5 * c * (D + D_a)
    return bounded(law, δ, F, by_δ, by_rate)


@compiled()
def force_at_rate(law: Vector, δ: float, y: float, θh: float, h: float) -> tuple[float, float]:
    """Return F in N and dF/dy for ends that separate at the rate y in a step: at the penetration δ - θ h y, with δ' = -y."""
    F, by_δ, by_rate = mean_force(law, δ - θh * y, -y, h)
    return F, -by_rate - θh * by_δ


@compiled()
def spring_energy(K: float, n: float, δ: float) -> float:
    """Return the stored energy K δ_+ⁿ⁺¹/(n + 1) in J."""
    return float(K * δ ** (n + 1.0) / (n + 1.0)) if δ > 0.0 else 0.0


@compiled()
def loss_passed(law: Vector, a: float, b: float) -> float:
    """Return ∫ (K b δⁿ + c D) dδ from a >= 0 to b >= a in N s: the momentum that damping takes on this way."""
    lost = law[3] * (spring_energy(law[1], law[2], b) - spring_energy(law[1], law[2], a)) if law[3] > 0.0 else 0.0
    return lost + law[4] * damping_passed(law, a, b, b - a) if law[4] > 0.0 and b > a else lost


@compiled()
def passed(law: Vector, v: float, a: float, b: float, mobility: float) -> float:
    """Return (1/2) v² of ends after a part of a blow, between the depths a and b, from (1/2) v² before it."""
    inward = b > a
    shallow = min(a, b)
    deep = max(a, b)
    work = mobility * (spring_energy(law[1], law[2], deep) - spring_energy(law[1], law[2], shallow))
    most = work * (law[8] - 1.0 if inward else 1.0 - law[7])
    c = mobility * loss_passed(law, shallow, deep)
    elastic = 0.5 * v * v - (work if inward else -work)
    # Of the rates at both ends of the part the one by which it loses less.
    twice = 2.0 * max(elastic, 0.0)
    after = twice / (math.sqrt(c * c + twice) + c) if twice > 0.0 else 0.0
    lost = min(c * min(v, after), most)
    return float(elastic - lost)


@compiled()
def rate_after(law: Vector, v: float, a: float, b: float, mobility: float) -> float:
    """Return the rate after a part of a blow in which the ends do not turn."""
    kinetic = passed(law, v, a, b, mobility)
    return math.sqrt(2.0 * kinetic) if kinetic > 0.0 else 0.0


@compiled()
def greatest_rebound(law: Vector, δ: float, v: float, mobility: float) -> float:
    """Return a bound, close to it, of the rate in m/s at which ends with the mobility 1/m part that met at δ and v > 0.

    The energy is followed through parts of the depth, in each of which damping takes the least.
    """
    K = law[1]
    n = law[2]
    parts = 64
    touch = max(δ, 0.0)
    energy = 0.5 * v * v / mobility + spring_energy(K, n, touch)
    low = touch
    high = ((n + 1.0) * energy / K) ** (1.0 / (n + 1.0))
    if law[8] == np.inf:
        for _ in range(60):  # to 1e-18 of the depth without damping
            x = 0.5 * (low + high)
            if mobility * loss_passed(law, touch, x) < v:
                low = x
            else:
                high = x
    width = (high - touch) / parts
    deepest = 0
    if not touch + width > touch:  # stopped where it is, to rounding
        v = 0.0
    for i in range(parts):
        kinetic = passed(law, v, touch + i * width, touch + (i + 1) * width, mobility)
        if not kinetic > 0.0:
            break
        v = math.sqrt(2.0 * kinetic)
        deepest = i + 1
    if deepest == parts:  # no deeper: elastic forces or damping alone stop the ends there
        v = 0.0
    for i in range(deepest, 0, -1):
        v = rate_after(law, v, touch + i * width, touch + (i - 1) * width, mobility)
    width = touch / parts
    for i in range(parts if touch > 0.0 else 0, 0, -1):
        v = rate_after(law, v, i * width, (i - 1) * width, mobility)
    return v


@compiled()
def greatest_rebounds(law: Vector, δ: Vector, v: Vector, mobility: float) -> Vector:
    """Return `greatest_rebound` of each step (nt,), 0 where v is not positive."""
    found = np.zeros(len(δ))
    for k in range(len(δ)):
        if v[k] > 0.0:
            found[k] = greatest_rebound(law, δ[k], v[k], mobility)
    return found


def forces(laws: Array, δ: Array, rate: Array, extended: bool = False) -> Array:
    """Return s of springs in N, or the extended force, which disregards contact (..., ns).

    Parameters
    ----------
    laws : (ns, 9) array
        The row of each spring.
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
        for i in range(a, len(δ), len(laws)):
            if extended:
                s, by_δ, by_rate = extended_force(laws[a], δ[i], rate[i])
            else:
                s, by_δ, by_rate = spring_force(laws[a], δ[i], rate[i])
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
    """Return F(δ, δ') of each spring in each step (nt, ns); laws (ns, 9), δ and rate (nt, ns), h (nt,)."""
    F = np.empty_like(δ)
    for k in range(len(h)):
        for a in range(len(laws)):
            F[k, a], _, _ = mean_force(laws[a], δ[k, a], rate[k, a], h[k])
    return F
