"""The tables of the reproduction, as rows of text and as CSV."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TypeAlias

from lcpimpact.reproduce.checks import Check
from lcpimpact.reproduce.runs import STEPS, CaseResult, PaperRuns

CROSS_VALIDATION_HEADER = (
    "system", "method", "theta", "lcp_solver", "h [s]", "sup|x| [m]", "sup|x'| [m/s]", "mean|R| [N]",
    "t_1 [s]", "t_2 [s]", "t_3 [s]", "t_4 [s]", "switches too many", "peak R [N]", "LCP residual", "penetration [m]",
    "energy [J]", "seconds", "failure",
)  # fmt: skip
PEAKS_HEADER = ("system", "peak R [N]", "peak of the LCP step, h = 0.0001 s [N]")
ORDERS_HEADER = ("system", "method", "theta", "order of x", "order of x'", "scatter (log10)")
CHECKS_HEADER = ("what", "value", "limit", "unit", "holds")


Row: TypeAlias = Sequence[float | str | None]
"""Cells of a table."""


def cross_validation_rows(found: PaperRuns) -> list[Row]:
    """Return a row for each run; errors are against the exact solution."""
    return [_row(row) for row in found.rows]


def _row(row: CaseResult) -> Row:
    case = row.case
    switches = [*row.switch_errors, *[""] * (4 - len(row.switch_errors))]
    residual, _, penetration, energy = row.certificate or (math.nan,) * 4
    solver = case.lcp_solver if case.method == "moreau-jean" else "-"
    theta = dict(case.options).get("theta", "-")
    return [
        case.label, case.method, theta, solver, case.h, row.sup_x, row.sup_v, row.mean_R, *switches,
        row.extra_switches, row.peak, residual, penetration, energy, row.seconds, row.failure,
    ]  # fmt: skip


def compared_with_rk4(found: PaperRuns) -> str:
    """Return in a sentence in how many rows the θ = 1/2 step errs less than RK4, and in which it does not."""
    by_rk4 = {
        (row.case.label, row.case.h): row for row in found.rows if row.case.method == "rk4-paper" and not row.failure
    }
    pairs = [
        (row, by_rk4[row.case.label, row.case.h])
        for row in found.rows
        if row.case.lcp_solver == "lemke" and row.case.options == (("theta", 0.5),) and not row.failure
        and (row.case.label, row.case.h) in by_rk4
    ]  # fmt: skip
    pairs.sort(key=lambda pair: (pair[0].case.label, -pair[0].case.h))
    parts = []
    for symbol, name in (("x", "sup_x"), ("x'", "sup_v"), ("R", "mean_R")):
        more = [step.case for step, rk4 in pairs if not getattr(step, name) < getattr(rk4, name)]
        but = ", ".join(f"{case.label} with h = {case.h:g} s" for case in more)
        parts.append(f"in {symbol} in {len(pairs) - len(more)}" + (f" (not for {but})" if more else ""))
    return f"Of {len(pairs)} rows, the θ = 1/2 step errs less than RK4 {parts[0]}, {parts[1]} and {parts[2]}."


def peaks_rows(found: PaperRuns) -> list[Row]:
    """Return a row for each system: the peak of R, exact and by the θ = 1/2 step with Lemke's method."""
    by_step = {
        row.case.label: row.peak
        for row in found.rows
        if row.case.lcp_solver == "lemke" and row.case.options == (("theta", 0.5),) and row.case.h == min(STEPS)
    }
    return [[label, peak, by_step[label]] for label, peak in found.peaks.items()]


def orders_rows(found: PaperRuns) -> list[Row]:
    """Return a row for each observed order."""
    return [
        [each.label, each.method, dict(each.options).get("theta", "-"), each.x, each.v, each.scatter]
        for each in found.orders
    ]


def checks_rows(checks: Sequence[Check]) -> list[Row]:
    """Return a row for each stated tolerance."""
    return [[check.what, check.value, check.limit, check.unit, "yes" if check.holds else "NO"] for check in checks]


HEADS = {
    "theta": "θ",
    "lcp_solver": "LCP solver",
    "sup|x| [m]": "sup err x [m]",
    "sup|x'| [m/s]": "sup err x' [m/s]",
    "mean|R| [N]": "mean err R [N]",
}
"""Heads of columns in the report, where they differ from those in the files."""

FORMATS = {
    "h [s]": "g",
    "theta": "g",
    "peak R [N]": ".4f",
    "peak of the LCP step, h = 0.0001 s [N]": ".4f",
    "order of x": ".3f",
    "order of x'": ".3f",
    "scatter (log10)": ".3f",
    "seconds": ".3f",
}
