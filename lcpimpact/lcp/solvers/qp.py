r"""QP backends of qpsolvers, in the dual form (over r) and in the primal form (over w, Gauss's principle).

For symmetric positive semidefinite M the LCP is the optimality condition of

.. math:: \text{dual:} \quad \min_{r \ge 0} \; \tfrac12 r^T M r + q^T r, \qquad
          \text{primal:} \quad \min_{H δ + q \ge 0} \; \tfrac12 δ^T A δ ,

with M = H A⁻¹ Hᵀ, δ = w - w_free the deviation from the free motion, and r the multipliers of the gap. The primal form is
Gauss's principle of least constraint: the velocity is the projection of the free one onto the admissible velocities in the
metric of A.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np
from scipy.sparse import csc_matrix, diags, eye, triu

from lcpimpact.arrays import Array
from lcpimpact.errors import InputError, Status
from lcpimpact.lcp.operators import Delassus, Dense, Property, Sparse
from lcpimpact.lcp.problem import is_plain
from lcpimpact.lcp.solver import Kernel, LCPSolver, SolverState
from lcpimpact.registry import nearest

SOLVED = int(Status.SOLVED)
UNDECIDED = int(Status.UNDECIDED)
MAX_ITER = int(Status.MAX_ITER)

FORMS = ("dual", "primal")


@dataclass(frozen=True)
class Backend:
    """Settings and accuracy of a backend of qpsolvers.

    Attributes
    ----------
    tol : float         residual achieved in at least 90 % of definite, singular and degenerate problems
    limit : str         name of its iteration limit, "" if it has none
    max_iter : int
    dense : bool        whether it takes dense matrices; else sparse ones
    settings : dict     tightest attainable tolerances
    """

    tol: float
    limit: str
    max_iter: int
    dense: bool
    settings: dict[str, Any] = field(default_factory=dict)


BACKENDS = {
    "osqp": Backend(1e-7, "max_iter", 20_000, False, {
        "eps_abs": 1e-10, "eps_rel": 1e-10, "eps_dual_inf": 1e-10,
        "polishing": False, "warm_starting": False,
    }),
    "daqp": Backend(1e-9, "iter_limit", 10_000, True, {"primal_tol": 1e-12, "dual_tol": 1e-13}),
    "proxqp": Backend(1e-7, "max_iter", 100, True, {
        "eps_abs": 1e-11, "eps_rel": 0.0,
        "check_duality_gap": True, "eps_duality_gap_abs": 1e-11, "eps_duality_gap_rel": 1e-12,
    }),
    "scs": Backend(1e-7, "max_iters", 20_000, False, {"eps_abs": 1e-11, "eps_rel": 1e-11, "eps_infeas": 1e-12}),
    "clarabel": Backend(1e-6, "max_iter", 200, False, {
        "tol_gap_abs": 1e-14, "tol_gap_rel": 1e-14, "tol_feas": 1e-12, "static_regularization_constant": 1e-10,
        "iterative_refinement_abstol": 1e-14, "iterative_refinement_reltol": 1e-14, "iterative_refinement_max_iter": 20,
    }),
    "piqp": Backend(1e-6, "max_iter", 250, True, {
        "eps_abs": 1e-13, "eps_rel": 1e-13, "eps_duality_gap_abs": 1e-14, "eps_duality_gap_rel": 1e-14,
    }),
    "highs": Backend(1e-6, "qp_iteration_limit", 10_000, False, {
        "primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10, "qp_regularization_value": 1e-12,
    }),
}  # fmt: skip
"""Calibrated backends; any other is called with its own defaults."""


@dataclass(frozen=True, kw_only=True)
class QPSolver(LCPSolver):
    """A backend of qpsolvers in one of the two forms.

    Attributes
    ----------
    backend : str           its name in qpsolvers
    form : str              "dual" or "primal"
    call : Backend          its settings
    """

    backend: str
    form: str
    call: Backend

    def init(self, M: Delassus) -> SolverState:
        """Scale the matrices once, and return a kernel for many q."""
        return SolverState(M.W, self._kernel(M), False, self.name)

    def _kernel(self, operator: Delassus, *, noise_fraction: float = 0.1) -> Kernel:
        # noise_fraction: fraction of the tolerance below which a force, scaled to max |q| = 1, is set to zero.
        dual = self.form == "dual"
        P, G, unit = self._dual(operator) if dual else self._primal(operator)
        zero = np.zeros(P.shape[0])
        # qpsolvers would convert bounds to rows of G at each call.
        plain = {"G": self._stored(-eye(operator.n)), "h": np.zeros(operator.n)} if dual else {}
        osqp = self._osqp(P, G) if self.backend == "osqp" else None

        def kernel(
            W: Any, q: Array, lower: Array, upper: Array, z: Array, tol: float, max_iter: int
        ) -> tuple[int, int]:
            """Minimise the problem scaled to max |q| = 1; q is the linear cost of the dual form, the bound of the primal."""
            if len(q) != operator.n or (W is not operator.W and not np.array_equal(W, operator.W)):
                # A step with a subset of the contacts, or with springs, passes its own matrix.
                return self._kernel(Dense(W))(W, q, lower, upper, z, tol, max_iter)
            if q.min() >= 0.0 and not lower.any():
                # q >= 0: z = 0 without a call of the backend, as in half of the steps of a rebound.
                z[:] = 0.0
                return SOLVED, 0
            b = q * unit
            p = float(np.abs(b).max()) or 1.0
            b /= p
            z[:] = 0.0
            scale = p * unit
            if osqp:
                x, status, iterations = osqp(b, lower / scale, upper / scale, max_iter)
            elif dual:
                limits = plain if is_plain(lower, upper) else {"lb": lower / scale, "ub": upper / scale}
                x, status, iterations = self._solve(P, b, limits, max_iter)
            else:
                x, status, iterations = self._solve(P, zero, {"G": G, "h": b}, max_iter)
            if x is not None:
                # Backends leave noise in zero forces, and a row without data has no other scale.
                z[:] = np.where(np.abs(x) > noise_fraction * self.call.tol, x, 0.0) * scale
            np.maximum(z, lower, out=z)
            np.minimum(z, upper, out=z)
            return status, iterations

        return kernel

    def _dual(self, operator: Delassus) -> tuple[Any, None, Array]:
        """Return the cost of the dual form scaled to a unit diagonal, and the units of its unknowns for max |q| = 1."""
        d = np.empty(operator.n)
        operator.diagonal(d)
        unit = inverse_root(d)
        if isinstance(operator, Sparse) and not self.call.dense:
            return self._cost(diags(unit) @ operator.M @ diags(unit)), None, unit
        return self._cost(operator.array() * unit[:, None] * unit), None, unit

    def _primal(self, operator: Delassus) -> tuple[Any, Any, Array]:
        """Return P and G of the primal form for A with a unit diagonal and unit rows of H, and the multipliers' units.

        If the operator has no factors A and H, M = H Hᵀ is factored.
        """
        A = getattr(operator, "A", None)
        H = getattr(operator, "H", None)
        if A is None or H is None:
            values, vectors = np.linalg.eigh(operator.array())
            A = np.eye(len(values))
            H = vectors * np.sqrt(np.maximum(values, 0.0))
        columns = diags(inverse_root(A.diagonal()))
        scaled = csc_matrix(H) @ columns
        unit = inverse_root(np.asarray(scaled.multiply(scaled).sum(axis=1)).ravel())
        return self._cost(columns @ csc_matrix(A) @ columns), self._stored(-(diags(unit) @ scaled)), unit

    def _cost(self, P: Any) -> Any:
        """Return the cost matrix in the backend's form: OSQP would extract the upper triangle at each call."""
        return self._stored(triu(csc_matrix(P)) if self.backend == "osqp" else P)

    def _stored(self, matrix: Any) -> Any:
        """Return a matrix in the backend's storage, to avoid a conversion at each call."""
        if not self.call.dense:
            return csc_matrix(matrix)
        return np.ascontiguousarray(matrix.toarray() if hasattr(matrix, "toarray") else matrix)

    def _osqp(
        self, P: Any, G: Any, *, osqp_rho: float = 0.1
    ) -> Callable[[Array, Array, Array, int], tuple[Array | None, int, int]]:
        """Return OSQP as a function of b, the bounds and max_iter; it is set up once, at the cost of ten solves.

        ``osqp_rho``: OSQP's initial ρ.
        """
        import osqp

        n = P.shape[0]
        rows = eye(P.shape[0], format="csc") if G is None else G
        free = np.full(rows.shape[0], np.inf)
        solver = osqp.OSQP()
        solver.setup(P, np.zeros(n), rows, -free, free, verbose=False, **self.call.settings)

        def solve(b: Array, lower: Array, upper: Array, max_iter: int) -> tuple[Array | None, int, int]:
            try:
                # OSQP adapts ρ, which would carry over to the next problem.
                solver.update_settings(max_iter=max_iter, rho=osqp_rho)
                solver.update(**({"q": b, "l": lower, "u": upper} if G is None else {"u": b}))
                found = solver.solve(raise_error=False)
            except failures():
                return None, UNDECIDED, 0
            said = str(found.info.status)
            iterations = int(found.info.iter)
            return self._judged(found.x if G is None else found.y, said == "solved", said, iterations)

        return solve

    def _solve(self, P: Any, q: Array, constraints: dict[str, Any], max_iter: int) -> tuple[Array | None, int, int]:
        """Return the solution of a backend called by qpsolvers, or None, the status and the iterations."""
        import qpsolvers

        settings = dict(self.call.settings)
        if self.call.limit:
            settings[self.call.limit] = max_iter
        try:
            with warnings.catch_warnings():
                # qpsolvers warns about what the status reports.
                warnings.simplefilter("ignore", UserWarning)
                problem = qpsolvers.Problem(P, q, **constraints)
                solution = qpsolvers.solve_problem(problem, solver=self.backend, **settings)
        except failures():
            return None, UNDECIDED, 0
        extras = solution.extras or {}
        info = extras.get("info")
        iterations = int(getattr(info, "iter", 0) if info is not None else extras.get("iter", 0))
        answer = None if solution.x is None else solution.x if self.form == "dual" else solution.z
        said = str(extras.get("status") or getattr(info, "status", ""))
        return self._judged(answer, bool(solution.found), said, iterations)

    def _judged(self, answer: Array | None, found: bool, said: str, iterations: int) -> tuple[Array | None, int, int]:
        """Return a solution, or None, with its status.

        The tolerances are not always attainable, so a solution that the backend reports as inaccurate is left to the judge.
        Infeasibility reported by a backend is not a proof.
        """
        if answer is None:
            return None, UNDECIDED, iterations
        said = said.lower()
        if found:
            return answer, SOLVED, iterations
        if "max" in said and "iter" in said:
            return answer, MAX_ITER, iterations
        if not said or "infeasible" in said or "unbounded" in said:
            return None, UNDECIDED, iterations
        return answer, SOLVED, iterations


def inverse_root(d: Array) -> Array:
    """Return d^-1/2, with max d in place of non-positive entries."""
    widest = float(d.max())
    inverse: Array = 1.0 / np.sqrt(np.where(d > 0.0, d, widest if widest > 0.0 else 1.0))
    return inverse


@cache
def failures() -> tuple[type[Exception], ...]:
    """Return the exceptions that qpsolvers and the backends raise on failure."""
    import osqp
    import qpsolvers

    return qpsolvers.QPError, osqp.OSQPException, ValueError, ArithmeticError, RuntimeError


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
    call = BACKENDS.get(backend) or Backend(1e-6, "", 20_000, backend in qpsolvers.dense_solvers)
    return QPSolver(
        name=f"qp:{backend}" if form == "dual" else f"qp:{backend}:primal",
        summary=f"{backend} through qpsolvers, {form} form ({unknown})",
        requires=(Property.SYMMETRIC, Property.PSD),
        storages=("dense", "banded", "sparse", "factored"),
        boxed=form == "dual",
        tol=call.tol,
        max_iter=call.max_iter,
        source="Caron2026; Stellato2020, for OSQP",
        backend=backend,
        form=form,
        call=call,
    )
