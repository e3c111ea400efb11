"""The paper reproduced: its figures, the cross-validation, and one report that opens offline."""

COMPILED_PARTS = (
    (
        "lcpimpact.lcp.solvers.lemke",
        "lcpimpact.lcp.solvers.block_triangular",
        "lcpimpact.lcp.solvers.enumeration",
        "lcpimpact.lcp.solvers.pgs",
    ),
    (
        "lcpimpact.double_double",
        "lcpimpact.hybrid.mode_choice",
        "lcpimpact.hybrid.contact_loop",
        "lcpimpact.certificate",
        "lcpimpact.study.accuracy.graphs",
        "lcpimpact.integrators.rk4_paper",
        "lcpimpact.integrators.moreau_jean",
    ),
)
"""What a reproduction runs, for two processes to compile side by side; see `lcpimpact.compiled.compile_ahead`."""
