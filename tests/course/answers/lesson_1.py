"""A model answer: the flights as a geometric series."""

from math import sqrt


def impact_time(n, g, H, e):
    return sqrt(2 * H / g) * (1 + 2 * e * (1 - e ** (n - 1)) / (1 - e))


def apex(n, H, e):
    return H * e ** (2 * n)
