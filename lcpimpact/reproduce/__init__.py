"""The paper reproduced: its figures, the cross-validation, and one report that opens offline."""

COMPILED_PARTS = (
    (
        "lcpimpact.lcp.solvers.lemke:lemke",
        "lcpimpact.lcp.solvers.enumeration:enumeration",
        "lcpimpact.lcp.solvers.pgs:pgs",
        "lcpimpact.lcp.operators:all_finite",
        "lcpimpact.certificate.trapezoid:trapezoid_errors",
        "lcpimpact.certificate.trapezoid:mark_mode_changes",
        "lcpimpact.certificate.trapezoid:largest_step_errors",
        "lcpimpact.integrators.rk4_paper:right_side",
        "lcpimpact.integrators.rk4_paper:steps",
        "lcpimpact.study.accuracy.graphs:farthest",
    ),
    (
        "lcpimpact.lcp.solvers.closed_form:closed_form",
        "lcpimpact.integrators.stepping.law:no_springs",
        "lcpimpact.integrators.stepping.features:no_features",
        "lcpimpact.integrators.stepping.kernel:steps",
        "lcpimpact.integrators.stepping.kernel:copy",
        "lcpimpact.integrators.stepping.kernel:begin_step",
        "lcpimpact.integrators.stepping.kernel:choose_rows",
        "lcpimpact.integrators.stepping.kernel:end_law",
        "lcpimpact.numerics.double_double:over",
        "lcpimpact.numerics.double_double:total",
        "lcpimpact.numerics.double_double:product",
        "lcpimpact.numerics.elimination:quotient",
        "lcpimpact.hybrid.spectrum:spectral_radius",
        "lcpimpact.hybrid.generator:on_rows",
        "lcpimpact.hybrid.generator:exponential",
        "lcpimpact.hybrid.sampling:at_windows",
        "lcpimpact.hybrid.sampling:sample",
        "lcpimpact.hybrid.gaps:reading",
        "lcpimpact.hybrid.complementarity:approach",
        "lcpimpact.hybrid.contacts:choose",
        "lcpimpact.hybrid.contact_loop:find_end",
        "lcpimpact.hybrid.contact_loop:follow_contacts",
    ),
)
"""Functions in which the runs of a reproduction spend their time, for two processes to compile side by side; see
`lcpimpact.compiled.compile_ahead`."""
