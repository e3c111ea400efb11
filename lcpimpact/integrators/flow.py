r"""The flow X(s) = exp(A s) X(0) of one contact mode, and the first instant at which a row c·X turns negative.

The time is cut into windows of length δ with ‖A‖ δ <= 1 (A balanced). On a window, a row is the polynomial

.. math:: c \cdot X(t_j + s δ) = \sum_{i=0}^{p} \frac{c (A δ)^i X(t_j)}{i!} s^i + ρ, \qquad
          |ρ| \le \frac{e}{(p+1)!} \, ‖c‖ ‖X(t_j)‖ ,

with p so large that the remainder is below rounding. Written in Bernstein's basis, a polynomial lies in the convex hull
of its coefficients: a window is passed over only if all of them are positive, which proves that there is no root in it;
otherwise it is halved (de Casteljau) until the first sign change is found to rounding. So no event is missed, however
short the excursion.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import matrix_balance

from lcpimpact.arrays import Array, Indices

DEGREE = 22
"""e / 23! = 1e-22: the remainder of a window is below rounding."""

FEW, CHUNK = 16, 256
"""Windows that are examined at once: few at first, then more."""

ROUNDING = 32.0 * np.finfo(float).eps


@dataclass(frozen=True, eq=False)
class Flow:
    """X' = A X.

    Attributes
    ----------
    A : (N, N) array
    """

    A: Array

    @cached_property
    def window(self) -> float:
        """δ, the length of a window in s."""
        balanced = matrix_balance(self.A, permute=False)[0] if self.A.any() else self.A
        return float(1.0 / max(np.abs(balanced).sum(axis=0).max(), 1e-3))

    @cached_property
    def taylor(self) -> Array:
        """(A δ)^i / i!, i = 0 ... p: (p + 1, N, N)."""
        powers = [np.eye(len(self.A))]
        for i in range(1, DEGREE + 1):
            powers.append(powers[-1] @ self.A * (self.window / i))
        return np.array(powers)

    @cached_property
    def over_a_window(self) -> Array:
        """exp(A δ)."""
        return np.asarray(self.taylor[::-1].sum(axis=0))

    def over(self, t: float) -> Array:
        """Return exp(A t) for one time t >= 0 (N, N)."""
        windows = math.floor(t / self.window)
        s = t / self.window - windows
        within = np.zeros_like(self.A)
        for power in self.taylor[::-1]:
            within = within * s + power
        return np.asarray(within @ np.linalg.matrix_power(self.over_a_window, windows))

    def windows(self, X: Array, count: int) -> Array:
        """Return exp(A δ j) X for j = 0 ... count - 1: (count, N), by doubling, so that errors do not accumulate."""
        states, step = X[None, :], self.over_a_window
        while len(states) < count:
            states = np.concatenate([states, states @ step.T])
            step = step @ step
        return states[:count]

    def at(self, X: Array, times: Array) -> Array:
        """Return exp(A t) X at the times t >= 0 (nt,): (nt, N)."""
        if len(times) == 0:
            return np.zeros((0, len(X)))
        window = np.floor(times / self.window).astype(np.int64)
        s = times / self.window - window
        # exp(A δ j) X by the bits of j, so that a few times far apart cost a few products.
        starts, step = np.tile(X, (len(times), 1)), self.over_a_window
        while window.any():
            odd = window % 2 == 1
            starts[odd] = starts[odd] @ step.T
            step, window = step @ step, window // 2
        states = np.zeros_like(starts)
        for power in self.taylor[::-1]:
            states = states * s[:, None] + starts @ power.T
        return states

    def first_crossing(
        self, X: Array, scale: Array, rows: Array, multiplicity: Indices, horizon: float
    ) -> tuple[float, int] | None:
        """Return the first instant before ``horizon`` at which a row turns negative, and which row.

        Parameters
        ----------
        X : (N,) array              state at the start
        scale : (N,) array          largest |X| of the run so far, to which rounding is relative
        rows : (k, N) array         rows c; c·X is zero or positive right after the start
        multiplicity : (k,) array   order of the zero of c·X at the start, which is factored out of the first window
        horizon : float             length of time in s
        """
        total = max(1, math.ceil(horizon / self.window))
        coefficients = np.einsum("kn,inm->kim", rows, self.taylor)
        done, chunk = 0, FEW
        while done < total:
            count, chunk = min(chunk, total - done), min(4 * chunk, CHUNK)
            states = self.windows(X, count)
            found: list[tuple[float, int]] = []
            for k in range(len(rows)):
                a = states @ coefficients[k].T
                noise = ROUNDING * (np.maximum(np.abs(states), scale) @ np.abs(coefficients[k]).sum(axis=0))
                if done == 0:
                    m = int(multiplicity[k])
                    a[0] = np.concatenate([a[0, m:], np.zeros(m)])
                hull = (a @ BERNSTEIN.T).min(axis=1)
                for j in np.flatnonzero(hull < -noise):
                    s = first_sign_change(a[j] @ BERNSTEIN.T, -float(noise[j]))
                    if s is not None:
                        s = polish(a[j], s)
                        found.append(((done + int(j) + s) * self.window, k))
                        break
            if found:
                crossing = min(found)
                return crossing if crossing[0] < horizon else None
            done += count
            X = self.over_a_window @ states[-1]
        return None


def _bernstein() -> Array:
    """Return the matrix from monomial to Bernstein coefficients on [0, 1]: b_j = Σ_i C(j, i)/C(p, i) a_i."""
    p = DEGREE
    return np.array(
        [[math.comb(j, i) / math.comb(p, i) if i <= j else 0.0 for i in range(p + 1)] for j in range(p + 1)]
    )


def _halving() -> tuple[Array, Array]:
    """Return the matrices that map Bernstein coefficients on [0, 1] to those on [0, 1/2] and on [1/2, 1]."""
    p = DEGREE
    left = np.array([[math.comb(j, i) / 2.0**j if i <= j else 0.0 for i in range(p + 1)] for j in range(p + 1)])
    return left, left[::-1, ::-1].copy()


POWERS = np.arange(DEGREE + 1)
BINOMIAL = np.array([float(math.comb(DEGREE, i)) for i in range(DEGREE + 1)])
BINOMIAL_BELOW = np.array([float(math.comb(DEGREE - 1, i)) for i in range(DEGREE)])
BERNSTEIN = _bernstein()
LEFT, RIGHT = _halving()


def first_sign_change(b: Array, floor: float, start: float = 0.0, width: float = 1.0) -> float | None:
    """Return where the polynomial with Bernstein coefficients b first falls below ``floor`` < 0, or None if it does not.

    Halves that lie above the floor by the convex hull are passed over; the leftmost other one is entered, until its
    coefficients change their sign once: then it has one root (variation diminishing).
    """
    if b.min() >= floor:
        return None
    if b[0] < floor:
        return start
    above = b >= floor
    if not above[-1] and np.count_nonzero(above[1:] != above[:-1]) == 1:
        return start + width * only_root(b - floor)
    if width < 1e-16:
        return start + 0.5 * width
    half = 0.5 * width
    left = first_sign_change(LEFT @ b, floor, start, half)
    return left if left is not None else first_sign_change(RIGHT @ b, floor, start + half, half)


def only_root(b: Array) -> float:
    """Return the root in [0, 1] of a polynomial whose Bernstein coefficients change their sign once, from above zero."""
    low, high, s, moved = 0.0, 1.0, float(b[0] / (b[0] - b[-1])), 1.0
    slopes = DEGREE * np.diff(b)
    for _ in range(64):
        left, right = s**POWERS, (1.0 - s) ** POWERS
        value = float((BINOMIAL * left * right[::-1]) @ b)
        low, high = (s, high) if value >= 0.0 else (low, s)
        slope = float((BINOMIAL_BELOW * left[:-1] * right[-2::-1]) @ slopes)
        better = s - value / slope if slope < 0.0 else -1.0
        if not low < better < high:
            better = 0.5 * (low + high)
        # At the last digits the steps of Newton's method become no smaller.
        last, moved, s = moved, abs(better - s), better
        if moved <= 4e-16 or last <= moved < 1e-9:
            break
    return s


def polish(a: Array, s: float) -> float:
    """Return the root of Σ a_i s^i near s by Newton's method; s itself where the root is not simple."""
    coefficients = a.tolist()
    for _ in range(3):
        value = slope = 0.0
        for each in reversed(coefficients):
            slope = slope * s + value
            value = value * s + each
        step = value / slope if slope < 0.0 else 0.0
        if not abs(step) < 1e-6:
            break
        s -= step
    return min(max(s, 0.0), 1.0)
