"""A model answer: the mass on the spring is an oscillator for half a period."""

from math import pi, sqrt


def stiffness(m, v, d):
    return m * (v / d) ** 2


def contact_time(m, k):
    return pi * sqrt(m / k)


def peak_force(m, v, k):
    return v * sqrt(m * k)


def impulse(m, v, e):
    return m * v * (1 + e)
