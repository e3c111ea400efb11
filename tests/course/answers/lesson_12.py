"""A model answer: time by elliptic integrals, the energy at the wall, and the error of frozen steps."""

from math import acos, asin, cos, log2, sin, sqrt

from scipy.special import ellipj, ellipk, ellipkinc


def first_impact(phi, wall, g, L):
    k = abs(sin(phi / 2))
    to_wall = ellipkinc(asin(sin(wall / 2) / k), k**2)
    return (ellipk(k**2) + to_wall) / sqrt(g / L)


def turning_angle(phi, wall, e):
    kinetic = e**2 * (cos(wall) - cos(phi))
    return -acos(cos(wall) - kinetic)


def order(phi, g, L, t, n):
    def error(n):
        h, q, v = t / n, phi, 0.0
        for _ in range(n):
            half = q + h / 2 * v
            F, K = -g / L * sin(half), g / L * cos(half)
            w = (F + K * (half - q) + 2 * v / h) / (2 / h + h / 2 * K)
            q, v = q + h * w, 2 * w - v
        k = abs(sin(phi / 2))
        _, cn, dn, _ = ellipj(sqrt(g / L) * t, k**2)
        return abs(q + 2 * asin(k * cn / dn))

    return log2(error(n) / error(2 * n))
