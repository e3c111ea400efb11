"""A model answer: the dynamic stiffness, and the determinants of the parts of a period."""

from math import exp, pi, sqrt


def grazing_force(m, k, c, gap, omega):
    return gap * sqrt((k - m * omega**2) ** 2 + (c * omega) ** 2)


def contraction(m, c, e, omega, impacts):
    return e ** (2 * impacts) * exp(-2 * pi * c / (m * omega))
