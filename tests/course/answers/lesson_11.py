"""A model answer: the change of the instant, the law, and the way back to a fixed time."""

from math import sqrt


def saltation(v, e, a, a_after):
    earlier = 1 / v  # by how much a change of the place by 1 m brings the impact forward
    place = 1 - (1 + e) * v * earlier
    speed = (a_after + e * a) * earlier
    return [[place, 0], [speed, -e]]


def place_by_height(t, g, H, e):
    v = sqrt(2 * g * H)
    delay = 1 / v
    return (1 + e) * v * delay - (1 + e) * g * delay * (t - v / g)
