r"""Newton's law of impact for contacts of any relative degree, with impulses that balance on massless nodes.

At one instant closed contacts transmit impulses P. With the basis E_m, E_d, E_s of
`lcpimpact.scheme.decomposition`,

.. math:: M_m (v^+ - v^-) = E_m^T B P, \qquad E_d^T B P = 0, \quad E_s^T B P = 0,
          \qquad 0 \le P \perp U^+ + e\, U^- \ge 0, \quad U^+ = H (E_m v^+ + E_p y' + [E_d\, E_s]\, w),

where the free w are the velocities of the massless nodes, the multipliers of their balance. The P that balance form a
cone whose extreme rays are the impulse paths R (see `lcpimpact.scheme.impulse_paths`), and on it w drops out: P = Rᵀ y
with

.. math:: 0 \le y \perp R (U^- + e\, U^-) + R H_m M_m^{-1} B_m R^T y \ge 0 ,

which is one row for each path: the line of contacts acts as one, with the opening rate Σ U and the rebound -Σ e U⁻ of its
contacts. For contacts of relative degree 2 alone this is Newton's law. A lone contact of lower degree is on no path, and
P = 0. A body on a plate whose stop is hit (U⁻ of the body's contact is zero) leaves with e of the stop, and a body that
hits a plate in contact with its stop leaves with e of its own contact. An impact loses energy, ½ P·(U⁺ + U⁻) <= 0.

The velocities of massless nodes before the impact are in U⁻; those after it are not states and follow from the forces after
the impact.
"""

from __future__ import annotations

import numpy as np

from lcpimpact.arrays import Array


def restitution(paths: Array, U: Array, e: Array) -> Array:
    """Return Σ e U⁻ (np,) in m/s of paths (np, nt), corrected for contacts that open already.

    Parameters
    ----------
    paths : (np, nt) array
    U : (nt,) array             opening rates before the impact, with those of massless nodes
    e : (nt,) array             coefficients of restitution

    Examples
    --------
    A body on a massless plate hits a stop with 3 m/s; e of the stop is 1/2:

    >>> restitution(np.array([[1.0, 1.0]]), np.array([0.0, -3.0]), np.array([0.9, 0.5]))
    array([-1.5])
    """
    opening, approach = paths @ U, np.minimum(U, 0.0)
    whole = np.divide(opening, paths @ approach, out=np.zeros_like(opening), where=opening < 0.0)
    return whole * (paths @ (e * approach))
