r"""Energy that impacts can gain by Newton's law, and the energy that the impacts of a run have gained.

With the velocities U = H v + χ of the rows, where χ is that of belts and moving walls, E the diagonal matrix of the
coefficients e (e_T for friction), ξ = U⁺ + E U⁻, W = H M⁻¹ Hᵀ and impulses P, an impact changes the kinetic energy by

.. math:: ΔT = P^T \left( \tfrac12 (U^+ + U^-) - χ \right),
   \qquad \tfrac12 P^T (U^+ + U^-) = P^T (I + E)^{-1} ξ - \tfrac12 P^T Δ W P,
   \qquad Δ = (I - E)(I + E)^{-1},

since U⁺ - U⁻ = W P. The law makes the first term zero or negative: P_N ξ_N = 0, and P_T ξ_T = -μ P_N \|ξ_T\|. So the energy
cannot grow relative to the surfaces where Δ W + W Δ is positive semidefinite: if all e are equal (Moreau), or if W does not
couple rows with different e. Otherwise it may, which is Kane's paradox.

Normal rows only lose: where P_N > 0 an approach U_N⁻ <= 0 ends with U_N⁺ = -e U_N⁻, so that P_N (W P)_N >= 0. So any smaller
number may stand in place of Δ_N, as min(Δ_N, max Δ_T). It follows that no impact without friction gains, nor one
whose e_T are equal and none of its e larger.

What moving surfaces add is -Pᵀ χ, the work of their drives. If χ jumps at the impact, χ is the mean of its limits here,
and the jump adds -½ Pᵀ Δ (χ⁺ - χ⁻) to the gain.

Sources: Kane and Levinson, *Dynamics: Theory and Applications* (1985); Glocker, *Set-Valued Force Laws* (2001); Leine and
van de Wouw, *Stability and Convergence of Mechanical Systems with Unilateral Constraints* (2008).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from lcpimpact.arrays import Array, Flags
from lcpimpact.certificate.energy import account_of
from lcpimpact.certificate.impacts import EIGENVALUE_ROUNDING, RunImpacts, struck_by
from lcpimpact.integrators.base import Integrator
from lcpimpact.record import Event, Record
from lcpimpact.scheme.dynamics import Dynamics
from lcpimpact.scheme.lagrangian import LagrangianDynamics


def gain_eigenvalue(d: Dynamics, rows: ArrayLike | None = None) -> float:
    r"""Least eigenvalue of Δ W + W Δ: if it is not negative, an impact of these rows gains no energy by Newton's law.

    .. math:: W = H M^{-1} H^T, \qquad Δ = (I - E)(I + E)^{-1}, \qquad E = \mathrm{diag}(e, e_T)

    Since normal rows only lose, min(Δ_N, max Δ_T) may stand in place of Δ_N; it does where that gives the larger number. The
    condition is sufficient. Where the eigenvalue is negative, some impulses would gain, but friction bounded by μ P_N
    need not reach them.

    W has the masses only: nodes with prescribed motion take up no impulse, and contacts on massless nodes act along the
    impulse paths of `lcpimpact.scheme.impulse_paths`, each as one row with the largest e of its contacts. Joints take part
    in every impact and stay at rest, so W is that of the masses with their joints. It may be singular, as with redundant
    contacts.

    Parameters
    ----------
    d : Dynamics
        The system, as ``problem.dynamics`` or ``scheme.assemble()``; of a Lagrangian one ``problem.dynamics.at(t, q, v)``.
    rows : array_like of int or bool, optional
        The rows that take part, contacts and friction; by default all. Sliders and relays take no impulses.

    Returns
    -------
    float
        The least eigenvalue in 1/kg, 0 where it is negative by rounding only; 0 without friction.

    Examples
    --------
    The tip of an inclined rod on a rough floor: U_N = y' + φ' couples with U_T = x' - φ'. With e = 0.8 and e_T = 0
    energy may grow, with both at 0.8 it cannot:

    >>> from lcpimpact import Bumper, Friction, Mass, Scheme
    >>> def rod(e_T):
    ...     tip, slip = {"y": 1.0, "φ": 1.0}, {"x": 1.0, "φ": -1.0}
    ...     return Scheme(
    ...         Mass("x", 1.0), Mass("y", 1.0), Mass("φ", 0.5), Bumper("ground", tip, e=0.8, name="N"),
    ...         Friction(slip, "ground", 0.8, normal="N", e_T=e_T, name="T"),
    ...     ).assemble()
    >>> [round(gain_eigenvalue(rod(e_T)), 9) for e_T in (0.0, 0.8)]
    [-0.137888745, 0.222222222]

    References
    ----------
    Kane and Levinson, *Dynamics: Theory and Applications* (1985); Leine and van de Wouw, *Stability and Convergence of
    Mechanical Systems with Unilateral Constraints* (2008).
    """
    every = np.arange(len(d.contacts))
    given = every if rows is None else np.asarray(rows)
    taking_part = given if given.dtype == np.bool_ else np.isin(every, given)
    normal = d.impulse_paths[~(d.impulse_paths[:, ~taking_part] != 0.0).any(axis=1)]
    rubbing = taking_part & d.tangential & (d.relative_degree == 2)
    if not rubbing.any():
        return 0.0
    δ = (1.0 - d.restitution) / (1.0 + d.restitution)
    W = _compliance(d, np.vstack([normal, np.eye(len(δ))[rubbing]]))
    Δ_T = δ[rubbing]
    Δ_N = np.where(normal != 0.0, δ, np.inf).min(axis=1)
    return max(_least_eigenvalue(np.append(each, Δ_T), W) for each in (Δ_N, np.minimum(Δ_N, Δ_T.max())))


def _least_eigenvalue(Δ: Array, W: Array) -> float:
    """Return the least eigenvalue of Δ W + W Δ, or 0 where it is negative by rounding only."""
    S = (Δ[:, None] + Δ) * W
    # The sign does not depend on the units of the rows, and rounding is least where W has ones on its diagonal.
    size = np.sqrt(np.diag(W))
    unit = np.divide(1.0, size, out=np.zeros_like(size), where=size > 0.0)
    scaled, vectors = np.linalg.eigh(unit[:, None] * S * unit)
    least = float(np.linalg.eigvalsh(S)[0])
    x = unit * vectors[:, 0]
    return max(least, 0.0) if scaled[0] >= -EIGENVALUE_ROUNDING * len(S) else min(least, float(x @ S @ x / (x @ x)))


def _compliance(d: Dynamics, R: Array) -> Array:
    """Return R H M⁻¹ Hᵀ Rᵀ of combinations R (k, nc) of the rows, with the masses only and their joints held (k, k)."""
    X = struck_by(d, R)
    return np.asarray(X.T @ X)


@dataclass(frozen=True)
class ImpactGain:
    """The energy that the impacts of a run have gained by Newton's law, and that belts and moving walls have added.

    Attributes
    ----------
    eigenvalue : float
        The least `gain_eigenvalue` of the rows of an impact in 1/kg, or 0 if none is negative: then none can gain.
    gained : float
        Sum of ½ Pᵀ (U⁺ + U⁻) in J over the impacts that gain.
    largest : float
        The largest of these gains in J.
    instant : float or None
        Its time in s; None if no impact has gained.
    by_motions : float
        Work -Pᵀ χ in J of the nodes with prescribed motion in all impacts.
    """

    eigenvalue: float = 0.0
    gained: float = 0.0
    largest: float = 0.0
    instant: float | None = None
    by_motions: float = 0.0

    @property
    def case(self) -> str:
        """Case of the run: "cannot gain", "can gain" or "gained"."""
        if self.instant is not None:
            return "gained"
        return "can gain" if self.eigenvalue < 0.0 else "cannot gain"

    @property
    def sentence(self) -> str:
        """The case and the work of moving surfaces in words; empty if impacts cannot gain and nothing moves."""
        parts = []
        if self.instant is not None:
            parts.append(
                f"Newton's law gained {self.gained:.3g} J, at most {self.largest:.3g} J at {self.instant:.6g} s"
            )
        elif self.eigenvalue < 0.0:
            parts.append("Newton's law could gain energy, and did not")
        if self.by_motions:
            parts.append(f"prescribed motions added {self.by_motions:.3g} J")
        return "; ".join(parts)


def impact_gain(
    d: Dynamics, record: Record, events: Sequence[Event], integrator: Integrator | None, precision: float
) -> ImpactGain:
    """Return the energy that the impacts of a run have gained; below the precision of the method it counts as none."""
    none, moving = ImpactGain(), isinstance(d, LagrangianDynamics)
    if not (d.motions or moving or d.tangential.any()) or not any(event.impulse for event in events):
        return none
    if len(record.reaction) == len(record.t):
        impacts = RunImpacts.of(d, events)
    else:
        impacts = RunImpacts.of_steps(d, record, events, integrator.impact_steps if integrator else 1)
    impacts = impacts[impacts.t <= record.t[-1]]
    struck = (impacts.P != 0.0) & (d.one_sided | d.tangential)
    if moving:
        places = zip(impacts.t.tolist(), impacts.q, impacts.before, struck, strict=True)
        eigenvalues = np.array([_eigenvalues(d.at(t, q, v), rows[None])[0] for t, q, v, rows in places])
    else:
        eigenvalues = _eigenvalues(d, struck)
    if not d.motions and not moving and (eigenvalues == 0.0).all():
        return none
    _, by_motions, lost = account_of(d).of_impacts(impacts).T
    U = (d.gap_rate(impacts.t, impacts.q, v) for v in (impacts.before, impacts.after))
    speeds = sum(map(np.abs, U))
    counts = (eigenvalues < 0.0) & (-lost > precision * (np.abs(impacts.P) * speeds).sum(axis=1))
    gains = np.where(counts, -lost, 0.0)
    most = int(gains.argmax()) if counts.any() else None
    return ImpactGain(
        eigenvalue=float(eigenvalues.min(initial=0.0)),
        gained=float(gains.sum()),
        largest=float(gains.max(initial=0.0)),
        instant=None if most is None else float(impacts.t[most]),
        by_motions=float(by_motions.sum()),
    )


def _eigenvalues(d: Dynamics, struck: Flags) -> Array:
    """Return the `gain_eigenvalue` of the rows ``struck`` (ni, nc) in each impact, or 0 where it is not negative (ni,)."""
    found = np.zeros(len(struck))
    mixed = np.where(struck, d.restitution, -1.0).max(axis=1) > np.where(struck, d.restitution, 2.0).min(axis=1)
    if mixed.any():
        sets, which = np.unique(struck[mixed], axis=0, return_inverse=True)
        found[mixed] = np.minimum([gain_eigenvalue(d, rows) for rows in sets], 0.0)[which.ravel()]
    return found
