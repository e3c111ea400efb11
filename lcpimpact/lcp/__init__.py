"""Linear complementarity problems: statement, solvers and the judge of their answers. It knows no mechanics."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lcpimpact.registry import Registry

if TYPE_CHECKING:
    from lcpimpact.lcp.solver import LCPSolver

SOLVERS: Registry[LCPSolver] = Registry(
    "solver",
    {
        "auto": "lcpimpact.lcp.auto:SOLVER",
        "closed-form": "lcpimpact.lcp.closed_form:SOLVER",
        "active-set": "lcpimpact.lcp.active_set:SOLVER",
        "block-pivoting": "lcpimpact.lcp.block_pivoting:SOLVER",
        "banded": "lcpimpact.lcp.banded:SOLVER",
        "lemke": "lcpimpact.lcp.lemke:SOLVER",
        "pgs": "lcpimpact.lcp.pgs:SOLVER",
        "enumeration": "lcpimpact.lcp.enumeration:SOLVER",
        "qp:osqp": "lcpimpact.lcp.qp:qp_solver",
        "qp:osqp:primal": "lcpimpact.lcp.qp:qp_solver",
    },
    families={"qp:": "lcpimpact.lcp.qp:qp_solver"},
)
