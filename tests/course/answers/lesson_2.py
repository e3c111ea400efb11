"""A model answer: unit impulses, one after the other."""


def delassus(m1, m2):
    return [[1 / m1, -1 / m1], [-1 / m1, 1 / m1 + 1 / m2]]


def free_rates(v1, v2, g, h, e):
    return [-(v1 + h * g) - e * v1, (1 + e) * (v1 - v2)]
