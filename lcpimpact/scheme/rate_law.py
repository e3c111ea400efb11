r"""The law of a non-linear dashpot: force, slope, and mean force over a step.

With the rate v at which its ends part, the force that pulls them together is

.. math:: F(v) = c_+ v^n \quad (v > 0), \qquad F(v) = -c_- |v|^n \quad (v < 0),

or a piecewise linear function through points (v_i, F_i), which goes on straight before the first and after the last. F does
not fall, and F(0) = 0, so that it dissipates F v >= 0.

In a θ-step a mass that begins at the rate v_0 parts at the mean rate y, and ends with v_0 + (y - v_0)/θ. A dashpot that
stops it within the step, (1 - θ) h F'/m > 1, would throw it back from step to step; and so would a spring of a massless
plate whose dashpot is weak, F' < (1 - θ) h k. So the step has the force

.. math:: \hat F(y) = F\bigl((1 - β) y + β (v_0 + (y - v_0)/θ)\bigr) + κ y, \qquad
          β = \Bigl[1 - \frac{m}{(1 - θ) h F'(v_0)}\Bigr]^+, \qquad κ = [(1 - θ) h k - F'(v_0)]^+ ,

the first between masses, the second at a massless node in a step in which its rate turns back, y v_0 < 0. They are F(y)
where h is small, and at rest that of the end of the step. For the infinite slope of n < 1 at rest β is 1, for the slope zero
of n > 1 κ is that of the spring.

Of many dashpots the parameters are the rows of an array: 0, 0, n, c_-, c_+, 1/m, k, and a constant c_* that is added to F',
then, from the place 8 on, v_i and F_i; of a table of p points -p stands for n. The 0 in the place of the stiffness tells
them from the springs of `lcpimpact.scheme.power_law`, among which they stand in a step.
"""

from __future__ import annotations

import math

import numpy as np

from lcpimpact.arrays import Array, Matrix, Vector
from lcpimpact.compiled import compiled
from lcpimpact.scheme.power_law import force_at_rate


@compiled()
def dashpot_force(law: Vector, v: float) -> tuple[float, float]:
    """Return F(v) in N, and its slope in N s/m, which is infinite at v = 0 for n < 1."""
    n = law[2]
    if n > 0.0:
        c = law[4] if v > 0.0 else law[3]
        if v == 0.0:
            c = max(law[3], law[4])
            return 0.0, c if n == 1.0 else 0.0 if n > 1.0 or c == 0.0 else math.inf
        secant = c * abs(v) ** (n - 1.0)
        return secant * v, n * secant
    i = 8
    while i < 8 + 2 * (int(-n) - 2) and v >= law[i + 2]:
        i += 2
    slope = (law[i + 3] - law[i + 1]) / (law[i + 2] - law[i])
    return law[i + 1] + slope * (v - law[i]), slope


@compiled()
def rate_of(law: Vector, F: float) -> float:
    """Return the rate v with F(v) = F in m/s, that nearest to zero; infinite where F is larger than any force."""
    if F == 0.0:
        return 0.0
    if law[2] > 0.0:
        c = law[4] if F > 0.0 else law[3]
        v = float((abs(F) / c) ** (1.0 / law[2])) if c > 0.0 else math.inf
        return v if F > 0.0 else -v
    i = 8
    while i < 8 + 2 * (int(-law[2]) - 2) and law[i + 3] < F:
        i += 2
    rise = law[i + 3] - law[i + 1]
    if rise == 0.0:
        return math.inf if F > 0.0 else -math.inf
    return float(law[i] + (law[i + 2] - law[i]) / rise * (F - law[i + 1]))


@compiled()
def dashpot_at_rate(
    law: Vector, start: float, y: float, θh: float, h: float, least: float
) -> tuple[float, float]:  # fmt: skip
    """Return the force in N by which a dashpot pushes its ends apart in a step, and its derivative by their mean rate y.

    ``start`` is the rate at the start of the step. Slopes are those of a rate of at least the size ``least``, that of the
    rounding of y.
    """
    over = h - θh
    _, slope = dashpot_force(law, start)
    β = 0.0
    if over * slope * law[5] > 1.0:
        β = 1.0 - 1.0 / (over * slope * law[5])
    κ = law[7]
    if y * start < -1e-9 * y * y and over * law[6] > slope:  # a start from rest is rounded
        κ += over * law[6] - slope
    v = y
    by_y = 1.0
    if β > 0.0:
        v = (1.0 - β) * y + β * (start + (y - start) * (h / θh))
        by_y = 1.0 - β + β * (h / θh)
    F, _ = dashpot_force(law, v)
    _, slope = dashpot_force(law, v if abs(v) > least else -least if v < 0.0 else least)
    return -(F + κ * y), -(slope * by_y + κ)


@compiled()
def rate_on_graph(law: Vector, δ: float, s: float, y: float, θh: float, h: float) -> float:
    """Return the mean rate at which Newton's method makes a law linear: y, or where a slope may be infinite, that of s.

    As a function of its force s the rate of a dashpot with n < 1 is a power above one, on which the method is safe.
    """
    if law[1] != 0.0 or not 0.0 < law[2] < 1.0:
        return y
    over = h - θh
    _, slope = dashpot_force(law, -δ)
    v = rate_of(law, -s)
    if not abs(v) < math.inf or over * law[6] > slope:
        return y
    if over * slope * law[5] > 1.0:
        β = 1.0 - 1.0 / (over * slope * law[5])
        return float((v - β * (-δ + δ * (h / θh))) / (1.0 - β + β * (h / θh)))
    return v


@compiled()
def law_at_rate(law: Vector, δ: float, y: float, θh: float, h: float, least: float) -> tuple[float, float]:
    """Return F in N and dF/dy of a spring or dashpot whose ends separate at the rate y: `force_at_rate`, `dashpot_at_rate`.

    In the place of the penetration a dashpot has the rate of approach at the start of the step.
    """
    if law[1] == 0.0:
        return dashpot_at_rate(law, -δ, y, θh, h, least)
    return force_at_rate(law, δ, y, θh, h)


@compiled()
def _fill(laws: Matrix, v: Vector, F: Vector) -> None:
    """Write F for v (m,), in which the dashpots take turns."""
    for a in range(len(laws)):
        for i in range(a, len(v), len(laws)):
            F[i], _ = dashpot_force(laws[a], v[i])


def forces(laws: Array, v: Array) -> Array:
    """Return F(v) of dashpots in N, with the shape of their rates v in m/s (..., nd)."""
    rates = np.ascontiguousarray(v, dtype=np.float64)
    F = np.empty(rates.shape)
    _fill(laws, rates.ravel(), F.reshape(-1))
    return F


def pieces(laws: Array, v: Array) -> Array:
    """Return how many of the points where its law has a kink are below the rate v of each dashpot (..., nd)."""
    points = [law[8 : 8 + 2 * int(-law[2]) : 2] if law[2] < 0.0 else np.zeros(1) for law in laws]
    return np.stack([np.searchsorted(each, v[..., a]) for a, each in enumerate(points)], axis=-1)


@compiled()
def mean_forces(laws: Matrix, start: Matrix, y: Matrix, θ: float, h: Vector) -> Matrix:
    """Return the force that pulls the ends of each dashpot together in each step (nt, nd).

    Takes the rates at the starts of the steps and the mean rates (nt, nd), and the lengths h (nt,) of the steps.
    """
    F = np.empty_like(y)
    for k in range(len(h)):
        for a in range(len(laws)):
            F[k, a], _ = dashpot_at_rate(laws[a], start[k, a], y[k, a], θ * h[k], h[k], 0.0)
            F[k, a] = -F[k, a]
    return F


@compiled()
def parting_rate(law: Vector, a: float, G: float, free: float) -> float:
    """Return the v of a v + G F(v) = free, with a >= 0 and G >= 0, in m/s.

    Each term is at most the right side, and one of them at least half of it: so v lies between two rates, in which Newton's
    method is safe.
    """
    if free == 0.0:
        return 0.0
    if G <= 0.0:
        return free / a
    if a <= 0.0:
        return rate_of(law, free / G)
    high, low = rate_of(law, free / G), rate_of(law, 0.5 * free / G)
    high = math.copysign(min(abs(high), abs(free / a)), free)
    low = math.copysign(min(abs(low), abs(0.5 * free / a)), free)
    v = high
    for _ in range(100):
        F, slope = dashpot_force(law, v)
        off = a * v + G * F - free
        if off * free > 0.0:
            high = v
        else:
            low = v
        step = off / (a + G * slope)
        v -= step
        if not min(low, high) <= v <= max(low, high):
            v = 0.5 * (low + high)
        elif abs(step) <= 1e-15 * abs(v):
            break
    return v


@compiled()
def rates_together(laws: Matrix, G: Matrix, free: Matrix, v: Matrix, least: float, most: int) -> None:
    """Write the rates v of dashpots that move each other, v = free + G (c_* v - F(v)), row by row (m, nd).

    They are solved in turn, which takes a convex function down, until none changes by more than ``least`` of the largest, in
    at most ``most`` turns; where that does not end they are NaN.
    """
    nd = len(laws)
    d = np.zeros(nd)
    for i in range(len(free)):
        for j in range(nd):
            d[j] = 0.0
            v[i, j] = free[i, j]
        change = math.inf
        size = 0.0
        turn = 0
        while change > least * size and turn < most:
            change = 0.0
            size = 0.0
            for j in range(nd):
                known = free[i, j]
                for k in range(nd):
                    if k != j:
                        known += G[j, k] * d[k]
                a = 1.0 + G[j, j] * laws[j, 7]
                found = parting_rate(laws[j], a if a > 1e-12 else 0.0, G[j, j], known)
                change = max(change, abs(found - v[i, j]))
                size = max(size, abs(found))
                v[i, j] = found
                F, _ = dashpot_force(laws[j], found)
                d[j] = -laws[j, 7] * found - F
            turn += 1
            if nd == 1:
                change = 0.0
        if change > least * size:
            for j in range(nd):
                v[i, j] = math.nan


def rates(laws: Array, G: Array, free: Array) -> Array:
    """Return the rates v of dashpots in m/s, with v = free + G (c_* v - F(v)), in the shape of free (..., nd)."""
    given = np.ascontiguousarray(free, dtype=np.float64).reshape(-1, len(laws))
    v = np.empty_like(given)
    rates_together(laws, np.ascontiguousarray(G), given, v, 4e-16, 1000)
    return v.reshape(np.shape(free))


def slopes(laws: Array, v: Array, *, least: float = 1e-8, largest: float = 1e12) -> Array:
    """Return F' of dashpots at their rates v (nd,) in N s/m, from ``least`` to ``largest`` times the larger one at 1 m/s.

    Powers have the slope zero, or an infinite one, at rest, by which a linear system would not determine the rate.
    """
    found = np.array([dashpot_force(law, float(each))[1] for law, each in zip(laws, v, strict=True)])
    usual = np.array([max(dashpot_force(law, sign)[1] for sign in (1.0, -1.0)) for law in laws])
    return np.asarray(np.clip(found, least * usual, largest * usual))
