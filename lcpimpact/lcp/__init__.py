"""Linear complementarity problems: statement, solvers and independent checks of their solutions. It knows no mechanics.

From the call to the solution:

- `solve`         `solve_lcp` and `prepare_lcp`: solver call, fallbacks and verification of each solution
- `operators`     M: dense, banded, sparse or factored, with its properties
- `problem`       the problem with bounds, and its solution
- `solver`        the solver interface and the properties that a solver declares
- `solvers/`      the methods, one per file
- `derivative`    derivatives of solutions, by M, q and the bounds
- `judge`         residuals and certificates, computed outside the solvers
- `rational`      exact decision in rational arithmetic where floating point is inconclusive
- `farkas`        certificates of infeasibility by a linear program
- `files`         input and output files

Shared by the methods:

- `storage`       dense and banded storage of M in compiled code: entries, products, columns
- `compressed`    sparse storage of M in compiled code, for which kernels are compiled again
- `scaling`       scaling to a unit diagonal, or to entries near one
- `reduction`     reduction of bounds to a plain LCP with more unknowns
- `sparse_pivoting`  block principal pivoting by sparse LU
- `basis`         complementary bases and basic solutions
- `pivoting`      the principal pivotal transform, and the steps of the principal pivoting methods
- `polish`        recomputation of the final basic solution
- `lapack`        linear systems
- `trace`         the pivots and iterates of a run
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from lcpimpact.registry import Registry

if TYPE_CHECKING:
    from lcpimpact.lcp.solver import LCPSolver

SOLVERS: Registry[LCPSolver] = Registry(
    "solver",
    {
        "auto": "lcpimpact.lcp.solvers.auto:SOLVER",
        "closed-form": "lcpimpact.lcp.solvers.closed_form:SOLVER",
        "active-set": "lcpimpact.lcp.solvers.active_set:SOLVER",
        "block-pivoting": "lcpimpact.lcp.solvers.block_pivoting:SOLVER",
        "block-triangular": "lcpimpact.lcp.solvers.block_triangular:SOLVER",
        "banded": "lcpimpact.lcp.solvers.banded:SOLVER",
        "lemke": "lcpimpact.lcp.solvers.lemke:SOLVER",
        "murty": "lcpimpact.lcp.solvers.murty:SOLVER",
        "keller": "lcpimpact.lcp.solvers.keller:SOLVER",
        "dantzig": "lcpimpact.lcp.solvers.dantzig:SOLVER",
        "nnls": "lcpimpact.lcp.solvers.nnls:SOLVER",
        "pgs": "lcpimpact.lcp.solvers.pgs:SOLVER",
        "psor": "lcpimpact.lcp.solvers.psor:SOLVER",
        "nncg": "lcpimpact.lcp.solvers.nncg:SOLVER",
        "apgd": "lcpimpact.lcp.solvers.apgd:SOLVER",
        "newton-fb": "lcpimpact.lcp.solvers.newton_fb:SOLVER",
        "interior-point": "lcpimpact.lcp.solvers.interior_point:SOLVER",
        "enumeration": "lcpimpact.lcp.solvers.enumeration:SOLVER",
        "qp:osqp": "lcpimpact.lcp.solvers.qp:qp_solver",
        "qp:osqp:primal": "lcpimpact.lcp.solvers.qp:qp_solver",
    },
    families={"qp:": "lcpimpact.lcp.solvers.qp:qp_solver"},
)
