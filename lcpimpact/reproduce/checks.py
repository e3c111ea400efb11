"""The tolerances stated in the report; all of them must hold."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from lcpimpact.problems.reference import KNOWN
from lcpimpact.reproduce.runs import DIRECT_SOLVERS, QP_SOLVERS, STEPS, CaseResult, PaperRuns


@dataclass(frozen=True)
class Check:
    """One stated tolerance.

    Attributes
    ----------
    what : str          what is compared, in words
    value : float       what was found; NaN where it could not be computed, which never passes
    limit : float       what it must not exceed
    unit : str
    """

    what: str
    value: float
    limit: float
    unit: str = ""

    @property
    def holds(self) -> bool:
        """Whether the value is within the limit."""
        return bool(self.value <= self.limit)


def all_checks(found: PaperRuns) -> list[Check]:
    """Return every tolerance of the reproduction."""
    return [
        *_no_failures(found),
        *_exact(found),
        *_peaks(found),
        *_step_errors(found),
        *_orders(found),
        *_solvers_agree(found),
        *_witness(found),
        *_routes_agree(found),
        *_certificates(found),
    ]


def _worst(values: Iterable[float]) -> float:
    """Return the largest value; NaN if there is none or one is NaN."""
    array = np.array(list(values), dtype=np.float64)
    return float(array.max()) if len(array) else float("nan")


def _select(found: PaperRuns, method: str, theta: float | None = None, label: str | None = None) -> list[CaseResult]:
    return [
        row
        for row in found.rows
        if row.case.method == method
        and (theta is None or dict(row.case.options).get("theta") == theta)
        and (label is None or row.case.label == label)
    ]


def _no_failures(found: PaperRuns) -> list[Check]:
    return [Check("runs that failed", float(sum(bool(row.failure) for row in found.rows)), 0.0)]


def _exact(found: PaperRuns) -> list[Check]:
    units = {"switches": (1e-12, "s"), "x": (1e-11, "m"), "y": (1e-11, "m"), "R": (1e-8, "N")}
    checks = []
    for label, errors in found.exact_errors.items():
        for name, value in errors.items():
            limit, unit = units[name]
            what = "switching times" if name == "switches" else f"{name}(3 s)"
            checks.append(Check(f"{label}: exact against 40-digit arithmetic, {what}", value, limit, unit))
    return checks


def _peaks(found: PaperRuns) -> list[Check]:
    checks = [
        Check(f"{system.label}: peak of R by exact", abs(found.peaks[system.label] - system.peak), 1e-4, "N")
        for system in KNOWN
        if system.peak is not None
    ]
    first = found.peaks["System 1"]
    second = found.peaks["System 2"]
    third = found.peaks["System 3"]
    checks.append(Check("the paper's ranking: R_2 / R_1 of the peaks is below one", second / first, 1.0))
    checks.append(Check("the paper's ranking: R_3 / R_2 of the peaks is below one", third / second, 1.0))
    return checks


def _step_errors(found: PaperRuns) -> list[Check]:
    checks = []
    for system in KNOWN:
        for h, limit in zip(STEPS, system.limits, strict=True):
            rows = [row for row in _select(found, "moreau-jean", 0.5, system.label) if row.case.h == h]
            worst = _worst(row.sup_x for row in rows)
            checks.append(
                Check(f"{system.label}: sup error of x, θ = 1/2, h = {h:g} s, every solver", worst, limit, "m")
            )
    return checks


def _orders(found: PaperRuns) -> list[Check]:
    checks = []
    for each in found.orders:
        theta = dict(each.options).get("theta")
        if theta == 0.5:
            checks.append(Check(f"{each.label}: 2 less the order of x, θ = 1/2", 2.0 - each.x, 0.1))
            checks.append(Check(f"{each.label}: 2 less the order of x', θ = 1/2", 2.0 - each.v, 0.1))
        elif theta == 1.0:
            checks.append(Check(f"{each.label}: order of x less 1, θ = 1", abs(each.x - 1.0), 0.1))
            checks.append(Check(f"{each.label}: order of x' less 1, θ = 1", abs(each.v - 1.0), 0.1))
    return checks


def _solvers_agree(found: PaperRuns, *, qp_tolerance: float = 1e-7) -> list[Check]:
    """Compare the final coordinates of each solver with those of Lemke's method, relative to the largest coordinate.

    ``qp_tolerance``: relative agreement of a QP backend's trajectory with the direct solvers; OSQP has a tolerance
    of 1e-11, and scaling.
    """
    lemke = {
        (row.case.label, row.case.options, row.case.h): row for row in found.rows if row.case.lcp_solver == "lemke"
    }
    checks = []
    for solver in (each for each in (*DIRECT_SOLVERS, *QP_SOLVERS) if each != "lemke"):
        differences = []
        for row in (row for row in found.rows if row.case.lcp_solver == solver):
            differences.append(_difference(row, lemke[row.case.label, row.case.options, row.case.h]))
        limit = qp_tolerance if solver in QP_SOLVERS else 1e-10
        checks.append(Check(f"{solver} ends where lemke ends, relative", _worst(differences), limit))
    return checks


def _difference(row: CaseResult, reference: CaseResult) -> float:
    """Return the difference of the final coordinates of two runs, relative to the largest; NaN if one failed."""
    if row.failure or reference.failure:
        return float("nan")
    expected = np.array(reference.q_end)
    return float(np.abs(np.array(row.q_end) - expected).max() / np.abs(expected).max())


def _witness(found: PaperRuns) -> list[Check]:
    rows = [row for row in _select(found, "rk4-paper") if row.case.h == min(STEPS)]
    return [
        Check(f"{row.case.label}: sup error of x, rk4-paper, h = {row.case.h:g} s", row.sup_x, 2e-4, "m")
        for row in rows
    ]


def _routes_agree(found: PaperRuns) -> list[Check]:
    return [
        Check(f"{label}: exact, moreau-jean and rk4-paper agree, to what part of the motion", verdict.resolution, 1e-2)
        for label, verdict in found.verdicts.items()
    ]


def _certificates(found: PaperRuns) -> list[Check]:
    rows = [row for row in _select(found, "moreau-jean", 0.5) if row.certificate]
    residual, complementarity, penetration = (_worst(row.certificate[i] for row in rows) for i in range(3))
    return [
        Check("θ = 1/2: LCP residual, every step and solver, relative", residual, 1e-7),
        Check("θ = 1/2: complementarity R u at the end of a step", complementarity, 1e-4, "J"),
        Check("θ = 1/2: penetration", penetration, 1e-8, "m"),
    ]
