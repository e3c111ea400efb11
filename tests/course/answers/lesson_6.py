"""A model answer: a geometric series and a logarithm."""

from math import floor, log, sqrt


def rest_time(g, H, v0, e):
    v = sqrt(v0**2 + 2 * g * H)
    return (v - v0) / g + 2 * e * v / (g * (1 - e))


def resolved_impacts(g, H, e, h):
    return floor(log(h / (2 * sqrt(2 * H / g))) / log(e))
