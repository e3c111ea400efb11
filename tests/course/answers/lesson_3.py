"""A model answer: the peak force by small steps of the motion, and a search by golden section."""

from math import sqrt


def peak(c, m, k, g, v):
    x, h, largest = 0.0, 8e-3 * sqrt(m / k), c * v
    for _ in range(500):
        a = g - (c * v + k * x) / m
        half = v + h * a / 2
        x_half = x + h * v / 2
        x, v = x + h * half, v + h * (g - (c * half + k * x_half) / m)
        largest = max(largest, c * v + k * x)
    return largest


def damping(m, k_o, g, v_o):
    low, high = 0.0, 2 * sqrt(k_o * m)
    for _ in range(30):
        left, right = low + 0.382 * (high - low), low + 0.618 * (high - low)
        if peak(left, m, k_o, g, v_o) < peak(right, m, k_o, g, v_o):
            high = right
        else:
            low = left
    return (low + high) / 2
