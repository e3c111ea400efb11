"""Linear complementarity problems: statement, solvers and independent checks of their solutions. It knows no mechanics.

From the call to the answer:

- `solve`         `solve_lcp` and `prepare_lcp`: one problem by one call, fallbacks, the verdict on each answer
- `operators`     M: dense, banded or by its factors, with its properties
- `problem`       the problem with bounds, and its solution
- `solver`        what a solver declares, and the interface that it is called through
- `solvers/`      the methods, one a file
- `judge`         residuals and certificates, computed outside the solvers
- `rational`      what rounding leaves undecided, in rational arithmetic
- `farkas`        a proof that there is no solution, by a linear program
- `files`         problems as files

What the methods share:

- `storage`       M as compiled code reads it, dense or banded: entries, products, columns
- `scaling`       units: a unit diagonal, or entries near one
- `reduction`     bounds as a plain LCP in more unknowns
- `basis`         complementary bases and their points
- `pivoting`      the principal pivotal transform, and the steps of the pivoting methods on it
- `polish`        the basis at the end, solved anew
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
        "apgd": "lcpimpact.lcp.solvers.apgd:SOLVER",
        "newton-fb": "lcpimpact.lcp.solvers.newton_fb:SOLVER",
        "interior-point": "lcpimpact.lcp.solvers.interior_point:SOLVER",
        "enumeration": "lcpimpact.lcp.solvers.enumeration:SOLVER",
        "qp:osqp": "lcpimpact.lcp.solvers.qp:qp_solver",
        "qp:osqp:primal": "lcpimpact.lcp.solvers.qp:qp_solver",
    },
    families={"qp:": "lcpimpact.lcp.solvers.qp:qp_solver"},
)
