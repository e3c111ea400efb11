"""A model answer: a dozen lines for the ball; unit impulses, one after the other."""

import numpy as np


def bounce(H, g, e, h, steps):
    x, v = np.zeros(steps + 1), np.zeros(steps + 1)
    for n in range(steps):
        free = v[n] + h * g
        closed = x[n] + 0.5 * h * v[n] >= H
        P = max(0.0, free + e * v[n]) if closed else 0.0
        v[n + 1] = free - P
        x[n + 1] = x[n] + 0.5 * h * (v[n] + v[n + 1])
    return x[-1], v[-1]


def delassus(m1, m2):
    return [[1 / m1, -1 / m1], [-1 / m1, 1 / m1 + 1 / m2]]


def free_rates(v1, v2, g, h, e):
    return [-(v1 + h * g) - e * v1, (1 + e) * (v1 - v2)]
