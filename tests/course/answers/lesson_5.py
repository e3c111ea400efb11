"""A model answer: the reduced mass, and the matrix of the step."""

import numpy as np


def dissipated(m1, m2, v1, v2, e):
    return 0.5 * (1 - e**2) * m1 * m2 / (m1 + m2) * (v1 - v2) ** 2


def energy_ratio(omega, h, theta):
    # (omega q, v) after the step: rows of q' = v and v' = -omega² q, each taken at theta
    a = omega * h
    left = np.array([[1.0, -theta * a], [theta * a, 1.0]])
    right = np.array([[1.0, (1 - theta) * a], [-(1 - theta) * a, 1.0]])
    after = np.linalg.solve(left, right @ np.array([1.0, 0.0]))
    return after @ after
