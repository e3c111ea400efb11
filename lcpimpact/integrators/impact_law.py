r"""Newton's law of impact for contacts of any relative degree, with impulses that balance on massless nodes.

At one instant the contacts that touch exchange impulses P. With the basis E_m, E_d, E_s of
`lcpimpact.scheme.decomposition`,

.. math:: M_m (v^+ - v^-) = E_m^T B P, \qquad E_d^T B P = 0, \quad E_s^T B P = 0,
          \qquad 0 \le P \perp U^+ + e\, U^- \ge 0, \quad U^+ = H (E_m v^+ + E_p y' + [E_d\, E_s]\, w),

where w, free, are the rates of the massless nodes and multipliers of their balance. The P that balance form a cone whose
extreme rays are the impulse paths R (see `lcpimpact.scheme.impulse_paths`), and on it w drops out: P = Rᵀ y with

.. math:: 0 \le y \perp R (U^- + e\, U^-) + R H_m M_m^{-1} B_m R^T y \ge 0 ,

which is one row for each path: the line of contacts meets as one, with the opening rate Σ U and the rebound -Σ e U⁻ of its
contacts. For contacts of relative degree 2 alone this is Newton's law. A lone contact of lower degree is on no path, and
P = 0. A body on a plate whose stop is hit (U⁻ of the body's contact is zero) leaves with e of the stop, and a body that
hits a plate that is pressed to its stop leaves with e of its own contact. An impact loses energy, ½ P·(U⁺ + U⁻) <= 0.

The rates of massless nodes before the impact are in U⁻; those after it are no part of its result, as they are no states:
they follow from the forces after the impact.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lcpimpact.arrays import Array
from lcpimpact.lcp.solve import PreparedLCP, prepare_lcp
from lcpimpact.scheme.impulse_paths import impulse_paths


@dataclass(frozen=True, eq=False)
class ImpactLaw:
    """The law of impact of contacts that touch at once.

    Attributes
    ----------
    paths : (np, nt) array      the impulse paths R among these contacts
    jump : (nm, nt) array       M_m⁻¹ E_mᵀ B, by which v_m⁺ = v_m⁻ + jump P
    lcp : PreparedLCP or None   of the matrix R H_m M_m⁻¹ B_m Rᵀ; None where no path is closed
    """

    paths: Array
    jump: Array
    lcp: PreparedLCP | None

    def impulses(self, U: Array, e: Array) -> Array:
        """Return P (nt,) in N s.

        Parameters
        ----------
        U : (nt,) array
            Opening rates before the impact in m/s, with those of massless nodes; exactly zero where a contact was closed.
            One above zero, as a contact may have at the start of a motion only, rebounds by nothing, and the others on
            its path by no more than in proportion to the approach of the path as a whole.
        e : (nt,) array
            Coefficients of restitution.

        Raises
        ------
        FailureError
            If the LCP is not solved.
        """
        opening = self.paths @ U
        if self.lcp is None or not (opening < 0.0).any():
            return np.zeros(self.paths.shape[1])
        q = opening + restitution(self.paths, U, e)
        return np.asarray(self.lcp.solve(q).z @ self.paths)


def restitution(paths: Array, U: Array, e: Array) -> Array:
    """Return Σ e U⁻ (np,) in m/s of paths (np, nt), less what those of their contacts take away that open already.

    Parameters
    ----------
    paths : (np, nt) array
    U, e : (nt,) arrays         opening rates before the impact, and coefficients of restitution
    """
    opening, approach = paths @ U, np.minimum(U, 0.0)
    whole = np.divide(opening, paths @ approach, out=np.zeros_like(opening), where=opening < 0.0)
    return np.asarray(whole * (paths @ (e * approach)))


def impact_law(H_m: Array, B_m: Array, B_massless: Array, M_m: Array, solver: str = "auto") -> ImpactLaw:
    """Prepare the law of impact of contacts that touch at once; keep it for each set of them.

    Parameters
    ----------
    H_m : (nt, nm) array            H E_m in the rows of these contacts
    B_m : (nm, nt) array            E_mᵀ B in their columns
    B_massless : (nz, nt) array     [E_d E_s]ᵀ B in their columns
    M_m : (nm, nm) array            masses in kg
    solver : str                    name of an LCP solver that takes semidefinite matrices

    Examples
    --------
    A body of 2 kg on a massless plate meets a stop with 3 m/s; e of the stop is 1/2:

    >>> H_m, B_massless = np.array([[-1.0], [0.0]]), np.array([[1.0, -1.0]])
    >>> law = impact_law(H_m, H_m.T, B_massless, np.array([[2.0]]))
    >>> P = law.impulses(U=np.array([0.0, -3.0]), e=np.array([0.9, 0.5]))
    >>> P, 3.0 + law.jump @ P
    (array([9., 9.]), array([-1.5]))
    """
    paths, jump = impulse_paths(B_m, B_massless), np.asarray(np.linalg.solve(M_m, B_m), dtype=np.float64)
    W = paths @ H_m @ jump @ paths.T
    return ImpactLaw(paths, jump, prepare_lcp(W, solver, tags=("psd",)) if len(paths) else None)
