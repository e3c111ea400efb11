"""A model answer: integrals of a rectangle, and NumPy's line of least squares."""

import numpy as np


def jump_errors(v, e, delta):
    return (1 + e) * v, (1 + e) * v * delta, (1 + e) * v * delta**0.5


def slope(h, error):
    return np.polyfit(np.log(h), np.log(error), 1)[0]
