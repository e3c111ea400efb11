"""A model answer: the sign of friction by the sign of the velocity."""

from math import copysign, cos, inf, sin


def stop_time(g, alpha, mu, v0):
    a = g * sin(alpha) - copysign(mu * g * cos(alpha), v0)
    return -v0 / a if a * v0 < 0 else inf


def resting_friction(m, g, alpha, mu):
    needed, largest = m * g * sin(alpha), mu * m * g * cos(alpha)
    return needed if needed <= largest else largest
