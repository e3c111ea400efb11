"""Linear complementarity problems: statement, solvers and the judge of their answers. It knows no mechanics."""

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
