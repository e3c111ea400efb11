r"""Impulse paths: a contact between two masses, or a line of contacts over massless nodes between them.

An impulse on a massless node must be balanced at the same instant, since no mass takes it up. So the impulses P of contacts
that touch form the cone

.. math:: \{ P \ge 0 : E_d^T B P = 0, \; E_s^T B P = 0 \}

with the damped and quasi-static nodes of `lcpimpact.scheme.decomposition`. Its extreme rays are the *impulse paths*: a
contact whose sides both have mass, are driven or are ground, and every line of contacts from one such side to another
over massless nodes. The openings of the contacts on a path add up to one that only masses, motions and the ground decide:
while all of them are closed, the path has relative degree 2, whatever the degree of each contact.
"""

from __future__ import annotations

from itertools import product

import numpy as np

from lcpimpact.arrays import Array
from lcpimpact.errors import InputError

MAX_PATHS = 4_096
"""Maximum number of impulse paths through one node."""


def extreme_rays(balance: Array) -> Array:
    """Return the extreme rays (k, n) of the cone P >= 0, balance P = 0, by the double description method.

    Parameters
    ----------
    balance : (m, n) array
        One equation a row; whole numbers keep the arithmetic exact.

    Examples
    --------
    Two contacts act on the same plate from above and one from below:

    >>> extreme_rays(np.array([[1.0, 1.0, -1.0]]))
    array([[1., 0., 1.],
           [0., 1., 1.]])

    Raises
    ------
    InputError
        If there are too many.

    References
    ----------
    Fukuda and Prodon, *Double description method revisited* (1996).
    """
    rays = np.eye(balance.shape[1])
    if not len(balance):
        return rays
    for equation in balance:
        value = rays @ equation
        positive = np.flatnonzero(value > 0.0)
        negative = np.flatnonzero(value < 0.0)
        if len(positive) * len(negative) > MAX_PATHS:
            raise InputError(
                f"there are more than {MAX_PATHS:,} impulse paths over massless nodes: give some of them a Mass"
            )
        sums = [rays[i] * -value[j] + rays[j] * value[i] for i, j in product(positive, negative)]
        rays = np.vstack([rays[value == 0.0], *sums])
        if sums:
            # A ray is extreme if no other has its support within that of the ray.
            support = (rays != 0.0).astype(np.float64)
            size = support.sum(axis=1)
            within = (support @ support.T == size) & (size < size[:, None])
            rays = rays[~within.any(axis=1)]
    return np.asarray(rays / rays.max(axis=1, initial=1.0, keepdims=True))


def impulse_paths(B_massive: Array, B_massless: Array) -> Array:
    """Return the impulse paths (np, nc): P = paths.T y with y >= 0 are all impulses that masses can take up.

    Parameters
    ----------
    B_massive : (nm, nc) array      E_mᵀ B, how the reactions act on masses
    B_massless : (nz, nc) array     [E_d E_s]ᵀ B, how they act on massless nodes

    Returns
    -------
    paths : (np, nc) array
        One ray a row. Rays that move no mass are left out: the gaps around such a loop have a constant sum, so its
        contacts cannot all close.

    Examples
    --------
    A body on a massless plate, which a stop can catch: body-plate and plate-ground.

    >>> impulse_paths(np.array([[-1.0, 0.0]]), np.array([[1.0, -1.0]]))
    array([[1., 1.]])
    """
    rays = extreme_rays(B_massless)
    return np.asarray(rays[(rays @ B_massive.T != 0.0).any(axis=1)])
