"""The runs of the paper's systems: the LCP step with every solver, the paper's RK4 and the exact solution, side by side."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, TypeAlias, TypeVar

import numpy as np

from lcpimpact.errors import LcpImpactError
from lcpimpact.problems import load_problem
from lcpimpact.problems.base import Problem
from lcpimpact.problems.reference import KNOWN, Known
from lcpimpact.reading import peak
from lcpimpact.simulation import simulate
from lcpimpact.study.accuracy.cross_validation import CrossValidation, cross_validate
from lcpimpact.study.accuracy.fitted_order import fit
from lcpimpact.study.progress import Progress, watched
from lcpimpact.trajectory import Trajectory

A = TypeVar("A")
R = TypeVar("R")

T_END = 3.0
STEPS = (1e-2, 1e-3, 1e-4)
DIRECT_SOLVERS = ("closed-form", "lemke", "pgs", "enumeration")
QP_SOLVERS = ("qp:osqp", "qp:osqp:primal")

ORDER_COUNTS = (307, 487, 773, 1229, 1951, 3089, 4903, 7789, 12373, 19661, 31223, 49597)
"""Primes, so that no switch falls on a grid point: a lucky alignment fakes an order."""


Options: TypeAlias = tuple[tuple[str, Any], ...]
"""Options of a method, by name."""


@dataclass(frozen=True)
class Case:
    """One run of one of the paper's systems.

    Attributes
    ----------
    label : str                 which of the known systems
    method : str                registry name
    options : tuple             pairs of option and value
    lcp_solver : str            registry name
    h : float                   step in s
    """

    label: str
    method: str
    options: Options
    lcp_solver: str
    h: float


@dataclass(frozen=True)
class CaseResult:
    """Errors of one run against the exact solution.

    Attributes
    ----------
    case : Case
    sup_x, sup_v : float        sup |x - exact| in m and sup |x' - exact| in m/s on the grid
    mean_R : float              L1 norm of R - exact over the length of the run, in N, at the instants of the recorded force
    switch_errors : tuple       error of each switching time in s; NaN where the switch is missing
    extra_switches : int        switches that the exact solution does not have
    peak : float                greatest R in N
    certificate : tuple         residual, complementarity (J), penetration (m), energy balance (J)
    seconds : float             of the run
    q_end : tuple               the coordinates at the end, to compare solvers
    failure : str               why the run failed, else empty
    """

    case: Case
    sup_x: float = np.nan
    sup_v: float = np.nan
    mean_R: float = np.nan
    switch_errors: tuple[float, ...] = ()
    extra_switches: int = 0
    peak: float = np.nan
    certificate: tuple[float, ...] = ()
    seconds: float = np.nan
    q_end: tuple[float, ...] = ()
    failure: str = ""


@dataclass(frozen=True)
class Orders:
    """Observed orders of a method on one system over ORDER_COUNTS.

    Attributes
    ----------
    label, method : str
    options : tuple
    x, v : float                slope of log sup|x - exact| and of log sup|x' - exact| against log h
    scatter : float             standard deviation of log10 of the errors in x about the line
    """

    label: str
    method: str
    options: Options
    x: float
    v: float
    scatter: float


@dataclass(frozen=True)
class PaperRuns:
    """The results of the runs of the paper's systems.

    Attributes
    ----------
    rows : tuple of CaseResult
    orders : tuple of Orders
    verdicts : dict             label to the `CrossValidation` of the exact solution, the LCP step and the paper's RK4
    exact_errors : dict         label to the largest error of exact in switching times (s), x, y (m) and R (N)
    peaks : dict                label to the greatest R of exact in N
    """

    rows: tuple[CaseResult, ...]
    orders: tuple[Orders, ...]
    verdicts: dict[str, CrossValidation] = field(default_factory=dict)
    exact_errors: dict[str, dict[str, float]] = field(default_factory=dict)
    peaks: dict[str, float] = field(default_factory=dict)


def known(label: str) -> Known:
    """Return the digits of the system called ``label``."""
    return next(each for each in KNOWN if each.label == label)


def problem_of(label: str) -> Problem:
    """Return a known system as a problem."""
    system = known(label)
    return load_problem(system.problem, **system.parameters)


@lru_cache(maxsize=32)
def exact_solution(label: str, steps: int) -> Trajectory:
    """Return the exact solution of a known system on a grid of ``steps`` steps."""
    return simulate(problem_of(label), "exact", dt=T_END / steps, t_end=T_END, progress=False)


def peak_reaction(trajectory: Trajectory) -> float:
    """Return the greatest reaction in N; of the exact solution, between the grid points too."""
    return peak(trajectory, "R") if trajectory.dense is not None else float(trajectory["R"].max())


def switch_errors(trajectory: Trajectory, exact: Trajectory) -> tuple[tuple[float, ...], int]:
    """Pair the k-th openings, and the k-th closings, of two runs; return the errors, and the number of unpaired events."""
    errors = []
    extra = 0
    for kind in ("open", "close"):
        found = [event.t for event in trajectory.events if event.kind == kind]
        true = [event.t for event in exact.events if event.kind == kind]
        extra += max(0, len(found) - len(true))
        errors += [found[k] - t if k < len(found) else np.nan for k, t in enumerate(true)]
    order = np.argsort([event.t for kind in ("open", "close") for event in exact.events if event.kind == kind])
    return tuple(float(errors[i]) for i in order), extra


def run_case(case: Case) -> CaseResult:
    """Run one case and measure it against the exact solution on the same grid; a failure becomes a row too."""
    try:
        found = simulate(
            problem_of(case.label),
            case.method,
            dt=case.h,
            t_end=T_END,
            lcp_solver=case.lcp_solver,
            progress=False,
            **dict(case.options),
        )
    except LcpImpactError as error:
        return CaseResult(case, failure=str(error))
    exact = exact_solution(case.label, round(T_END / case.h))
    R = exact.sample(found.t_reaction).reaction[:, 0]
    errors, extra = switch_errors(found, exact)
    c = found.certificate
    return CaseResult(
        case,
        sup_x=float(np.abs(found["x"] - exact["x"]).max()),
        sup_v=float(np.abs(found["v_x"] - exact["v_x"]).max()),
        mean_R=float(np.abs(found["R"] - R).mean()),
        switch_errors=errors,
        extra_switches=extra,
        peak=peak_reaction(found),
        certificate=(c.residual, c.complementarity, c.penetration, c.energy_balance),
        seconds=found.stats.seconds,
        q_end=tuple(float(value) for value in found.q[-1]),
    )


def observed_orders(label: str, method: str, options: Options) -> Orders:
    """Fit the order of a method over ORDER_COUNTS."""
    errors = []
    for steps in ORDER_COUNTS:
        exact = exact_solution(label, steps)
        found = simulate(exact.problem, method, dt=T_END / steps, t_end=T_END, progress=False, **dict(options))
        errors.append([float(np.abs(found[name] - exact[name]).max()) for name in ("x", "v_x")])
    x, v = (fit([T_END / steps for steps in ORDER_COUNTS], each) for each in zip(*errors, strict=True))
    return Orders(label, method, options, x.slope, v.slope, x.scatter)


def verdict(label: str) -> CrossValidation:
    """Cross-validate the exact solution, the LCP step and the paper's RK4 on one system."""
    return cross_validate(problem_of(label), ["exact", "moreau-jean", "rk4-paper"], t_end=T_END, progress=False)


def exact_errors(label: str) -> dict[str, float]:
    """Return the largest errors of the exact solution against the known digits."""
    system = known(label)
    exact = exact_solution(label, round(T_END / 1e-2))
    found = np.array([event.t for event in exact.events])
    errors = {
        "switches": float(np.abs(found - system.switches).max()) if len(found) == len(system.switches) else np.inf
    }
    for name, value in system.at_3.items():
        errors[name] = abs(float(exact[name][-1]) - value)
    return errors


def all_cases() -> list[Case]:
    """Return every run, in the order of the systems, methods, options, solvers and steps."""
    kinds: list[tuple[str, Options, str]] = [
        *(("moreau-jean", (("theta", θ),), solver) for θ in (0.5, 1.0) for solver in (*DIRECT_SOLVERS, *QP_SOLVERS)),
        ("rk4-paper", (), "auto"),
        ("exact", (), "auto"),
    ]
    return [Case(system.label, *kind, h) for system in KNOWN for kind in kinds for h in STEPS]


def order_studies() -> list[tuple[str, str, Options]]:
    """Return the arguments of `observed_orders`."""
    methods: list[tuple[str, Options]] = [
        ("moreau-jean", (("theta", 0.5),)),
        ("moreau-jean", (("theta", 1.0),)),
        ("rk4-paper", ()),
    ]
    return [(system.label, method, options) for system in KNOWN for method, options in methods]


def run_all(
    cases: Sequence[Case] | None = None,
    *,
    workers: int | None = None,
    progress: Progress = True,
    meanwhile: Callable[[], None] = lambda: None,
) -> PaperRuns:
    """Run the paper's systems on all cores.

    Parameters
    ----------
    cases : sequence of Case, optional
        Which runs; by default `all_cases`.
    workers : int, optional
        Processes; by default one a core.
    progress : bool or callable
        As of `lcpimpact.study.progress`.
    meanwhile : callable, optional
        Work of this process beside the first runs.

    Returns
    -------
    PaperRuns
        The rows in the order of the cases.
    """
    cases = all_cases() if cases is None else list(cases)
    studies = order_studies()
    labels = [system.label for system in KNOWN]
    longest_first = sorted(cases, key=lambda case: (case.h, case.lcp_solver not in QP_SOLVERS))
    stages: dict[str, tuple[Callable[..., Any], Sequence[tuple[Any, ...]]]] = {
        "runs": (run_case, [(case,) for case in longest_first]),
        "orders": (observed_orders, studies),
        "cross-validation": (verdict, [(label,) for label in labels]),
    }
    with _processes(workers or os.cpu_count() or 1) as pool:
        begun = {
            stage: {pool.submit(function, *each): each for each in arguments}
            for stage, (function, arguments) in stages.items()
        }
        meanwhile()
        found = {
            stage: dict(watched(_results(each), len(each), stage, progress, stage=True))
            for stage, each in begun.items()
        }
    return PaperRuns(
        tuple(found["runs"][case,] for case in cases),
        tuple(found["orders"][study] for study in studies),
        {label: found["cross-validation"][label,] for label in labels},
        {label: exact_errors(label) for label in labels},
        {label: peak_reaction(exact_solution(label, round(T_END / 1e-2))) for label in labels},
    )


@contextmanager
def _processes(workers: int) -> Iterator[ProcessPoolExecutor]:
    """Start a pool of processes, which ends at once if an error ends the block.

    Processes are spawned, since a fork copies the locks of numerical libraries; each keeps to one thread, since the
    matrices are small and the cores are taken.
    """
    context = multiprocessing.get_context("spawn")
    with _environment(OPENBLAS_NUM_THREADS="1", OMP_NUM_THREADS="1"), ProcessPoolExecutor(workers, context) as pool:
        try:
            yield pool
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def _results(begun: Mapping[Future[R], A]) -> Iterator[tuple[A, R]]:
    """Yield the arguments of each call with its result, in the order of completion."""
    for future in as_completed(begun):
        yield begun[future], future.result()


@contextmanager
def _environment(**values: str) -> Iterator[None]:
    """Set environment variables for processes started within the block."""
    before = {name: os.environ.get(name) for name in values}
    os.environ.update(values)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
