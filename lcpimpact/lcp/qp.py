r"""QP backends of qpsolvers, in the dual form (over r) and in the primal form (over w, Gauss's principle).

For symmetric positive semidefinite M the LCP is the optimality condition of

.. math:: \text{dual:} \quad \min_{r \ge 0} \; \tfrac12 r^T M r + q^T r, \qquad
          \text{primal:} \quad \min_{H δ + q \ge 0} \; \tfrac12 δ^T A δ ,

with M = H A⁻¹ Hᵀ, δ = w - w_free the deviation from the free motion, and r the multipliers of the gap. Gauss's principle
of least constraint is the primal one: among the velocities that the contacts admit, the true one is nearest to the free
one in the metric of A.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.sparse import csc_matrix, diags, triu

from lcpimpact.arrays import Array
from lcpimpact.errors import InputError, Status
from lcpimpact.lcp.operators import Delassus, Dense, Property
from lcpimpact.lcp.solver import Kernel, LCPSolver, State
from lcpimpact.registry import nearest

FORMS = ("dual", "primal")

TIGHT: dict[str, dict[str, Any]] = {
    "osqp": {"eps_abs": 1e-11, "eps_rel": 1e-11, "polishing": False, "warm_starting": False, "raise_error": False},
    "daqp": {"primal_tol": 1e-12},
}
"""Settings of each backend that are tighter than its defaults."""


@dataclass(frozen=True, kw_only=True)
class QPSolver(LCPSolver):
    """A backend of qpsolvers in one of the two forms.

    Attributes
    ----------
    backend : str           its name in qpsolvers
    form : str              "dual" or "primal"
    settings : dict         passed to the backend
    """

    backend: str
    form: str
    settings: dict[str, Any] = field(default_factory=dict)

    def init(self, M: Delassus) -> State:
        """Scale the matrices once, and return a kernel for many q."""
        return State(M.W, self._kernel(M), False, self.name)

    def _kernel(self, operator: Delassus) -> Kernel:
        dual = self.form == "dual"
        P, G, unit = self._dual(operator) if dual else self._primal(operator)

        def kernel(W: Any, q: Array, lower: Array, upper: Array, z: Array, tol: float, max_iter: int) -> tuple[int, int]:
            """Minimise in units of max |q| = 1; q is the linear cost of the dual form, and the bound of the primal one."""
            if len(q) != operator.n:
                # A step in which not all contacts act hands over their own matrix.
                return self._kernel(Dense(W))(W, q, lower, upper, z, tol, max_iter)
            p = float(np.abs(q).max()) or 1.0
            if dual:
                box = {"lb": lower / (p * unit), "ub": upper / (p * unit)}
                solution, status, iterations = self._solve(P, q / p, box, max_iter)
            else:
                solution, status, iterations = self._solve(P, np.zeros(P.shape[0]), {"G": G, "h": q / p}, max_iter)
            found = 0.0 if solution is None else (solution.x if dual else solution.z) * (p * unit)
            z[:] = np.clip(found, lower, upper)
            return status, iterations

        return kernel

    def _dual(self, operator: Delassus) -> tuple[csc_matrix, None, float]:
        """Return the cost of the form over z with max |M| = 1, and the unit of its unknowns for max |q| = 1."""
        M = operator.array()
        s = np.abs(M).max() or 1.0
        return self._cost(M / s), None, 1.0 / s

    def _primal(self, operator: Delassus) -> tuple[csc_matrix, csc_matrix, float]:
        """Return P and G of the form over w with unit diagonal of A and max |H| = 1, and the unit of the multipliers."""
        A, H = getattr(operator, "A", None), getattr(operator, "H", None)
        if A is None or H is None:
            values, vectors = np.linalg.eigh(operator.array())
            A, H = np.eye(len(values)), vectors * np.sqrt(np.maximum(values, 0.0))
        unit = diags(1.0 / np.sqrt(A.diagonal()))
        scaled = csc_matrix(H) @ unit
        s = abs(scaled).max() or 1.0
        return self._cost(unit @ csc_matrix(A) @ unit), csc_matrix(-scaled / s), 1.0 / s**2

    def _cost(self, P: Any) -> csc_matrix:
        """Return the matrix of the cost as the backend wants it: OSQP seeks the upper triangle of a full one each time."""
        return csc_matrix(triu(P) if self.backend == "osqp" else P)

    def _solve(self, P: csc_matrix, q: Array, constraints: dict[str, Any], max_iter: int) -> tuple[Any, int, int]:
        import qpsolvers

        settings = dict(self.settings)
        if self.backend == "osqp":
            settings["max_iter"] = max_iter
        try:
            with warnings.catch_warnings():
                # qpsolvers warns of what the status says.
                warnings.simplefilter("ignore", UserWarning)
                solution = qpsolvers.solve_problem(qpsolvers.Problem(P, q, **constraints), solver=self.backend, **settings)
        except (qpsolvers.QPError, ValueError):
            return None, int(Status.UNDECIDED), 0
        info = (solution.extras or {}).get("info")
        iterations = int(getattr(info, "iter", 0))
        if solution.x is None or solution.z is None:
            return None, int(Status.UNDECIDED), iterations
        if not solution.found:
            return solution, int(Status.MAX_ITER), iterations
        return solution, int(Status.SOLVED), iterations


def qp_solver(name: str) -> QPSolver:
    """Return the solver called ``qp:BACKEND`` (dual form) or ``qp:BACKEND:primal``.

    Raises
    ------
    InputError
        If qpsolvers does not know the backend, or it is not installed.
    """
    import qpsolvers

    backend, _, form = name.removeprefix("qp:").partition(":")
    form = form or "dual"
    if form not in FORMS:
        raise InputError(nearest(form, list(FORMS), "form of QP"))
    if backend not in qpsolvers.available_solvers:
        installed = [f"qp:{each}" for each in qpsolvers.available_solvers]
        raise InputError(f"{nearest(name, installed, 'installed QP backend')}; install others with pip")
    unknown = "over r >= 0" if form == "dual" else "over w, Gauss's principle"
    return QPSolver(
        name=f"qp:{backend}" if form == "dual" else f"qp:{backend}:primal",
        summary=f"{backend} through qpsolvers, {form} form ({unknown})",
        requires=(Property.SYMMETRIC, Property.PSD),
        storages=("dense", "banded", "factored"),
        boxed=form == "dual",
        tol=1e-7,
        max_iter=20_000,
        source="Caron et al., qpsolvers; Stellato et al. (2020) for OSQP",
        backend=backend,
        form=form,
        settings=TIGHT.get(backend, {}),
    )
