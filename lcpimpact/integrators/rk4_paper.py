"""The paper's own method: Eqs (3), (6) and (8), with their case distinctions, by classical Runge-Kutta.

It is independent of the LCP methods: it uses the constants of the paper's systems, not the assembled scheme.

"z - x = 0" needs a tolerance in floating point. ``contact="project"``, the default, closes the contact for
``z - x <= CLOSED_GAP`` and, after each step, projects the massless side onto the other where they penetrate; ``"clip"``
does not project, so that the penetration of the closing step stays for the whole contact; ``"sign"`` requires z - x <= 0,
so that a gap of one rounding error opens the contact for a stage; ``"equal"`` is the printed equality, which never holds
again after the first flight.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from lcpimpact.arrays import Matrix, Vector
from lcpimpact.compiled import compiled
from lcpimpact.errors import InputError, Status, UnsupportedError
from lcpimpact.integrators.base import Declared, Integrator
from lcpimpact.problems import load_problem
from lcpimpact.problems.base import Problem
from lcpimpact.record import Grid, Record
from lcpimpact.registry import nearest
from lcpimpact.scheme.structure import Feature

RULES = ("project", "clip", "sign", "equal")
PROJECT = RULES.index("project")
SIGN = RULES.index("sign")
EQUAL = RULES.index("equal")
CLOSED_GAP = 1e-9
"""Gap in m below which a contact is closed: far above accumulated rounding, far below any gap of interest."""

COORDINATES = {"system-1": [0, 3], "system-2": [0, 2, 3], "system-3": [0, 2, 3]}
"""Indices in (x, x', y, z) of the coordinates of each system."""

CONSTANTS = ("m", "g", "k", "c", "k_o", "c_o")


@compiled()
def positive_part(ξ: float) -> float:
    """Eq. (4): [ξ]^+ = max(0, ξ)."""
    return max(0.0, ξ)


@compiled()
def right_side(system: int, rule: int, s: Vector, p: Vector, ds: Vector) -> float:
    """Write the derivative of s = (x, x', y, z) to ds and return R, with p = (m, g, k, c, k_o, c_o)."""
    x, dx, y, z = s
    m, g, k, c, k_o, c_o = p
    gap = z - x if system == 1 else z - y
    contact = gap == 0.0 if rule == EQUAL else gap <= (0.0 if rule == SIGN else CLOSED_GAP)
    R = 0.0
    dy = 0.0
    dz = -(k_o / c_o) * z

    if system == 1:
        if contact:
            R = positive_part(c_o * dx + k_o * x)  # (3c)
            if c_o * dx + k_o * x > 0.0:
                dz = dx  # (3b)
    elif system == 2:
        dy = dx
        if contact:
            R = k * (x - z)  # (6d)
            dz = (-(k_o + k) * z + k * x) / c_o  # (6c)
            if y < x or (k_o / c_o) * z + dx > 0.0:
                dy = dz  # (6b)
            else:
                R, dz = 0.0, -(k_o / c_o) * z
    else:
        dy = dx + (k / c) * (x - y)
        if contact:
            A = positive_part(dx + (k / c) * (x - y) + (k_o / c_o) * z)  # (8e)
            R = c * c_o / (c + c_o) * A  # (8d)
            dy -= c_o / (c + c_o) * A  # (8b)
            dz += c / (c + c_o) * A  # (8c)

    ds[0] = dx
    ds[1] = g - R / m
    ds[2] = dy
    ds[3] = dz
    return R


class PaperRun(NamedTuple):
    """The run as it passes from block to block: the system, h, its constants, s now, and s, s' and R on the grid."""

    system: int
    h: float
    constants: Vector
    s: Vector
    motion: Matrix
    rates: Matrix
    reaction: Vector


@compiled()
def steps(run: PaperRun, rule: int, first: int, last: int) -> int:
    """Take the steps first ... last of the classical Runge-Kutta method."""
    system = run.system
    h = run.h
    p = run.constants
    s = run.s
    motion = run.motion
    rates = run.rates
    reaction = run.reaction
    d1 = np.empty(4)
    d2 = np.empty(4)
    d3 = np.empty(4)
    d4 = np.empty(4)
    for i in range(first, last):
        right_side(system, rule, s, p, d1)
        right_side(system, rule, s + 0.5 * h * d1, p, d2)
        right_side(system, rule, s + 0.5 * h * d2, p, d3)
        right_side(system, rule, s + h * d3, p, d4)
        s += h / 6.0 * (d1 + 2.0 * d2 + 2.0 * d3 + d4)
        if rule == PROJECT:
            upper = s[0] if system == 1 else s[2]
            if s[3] < upper and system == 1:
                s[3] = upper
            elif s[3] < upper:
                s[2] = s[3]
        reaction[i + 1] = right_side(system, rule, s, p, rates[i + 1])
        motion[i + 1] = s
        if not abs(s[0]) < np.inf:
            return i
    return last


@dataclass(frozen=True)
class RK4Paper(Integrator):
    """The paper's explicit method, for its own three systems.

    Parameters
    ----------
    contact : {"project", "clip", "sign", "equal"}
        What "z - x = 0" means; see the module.
    """

    contact: str = "project"

    name: ClassVar[str] = "rk4-paper"
    family: ClassVar[str] = "explicit Runge-Kutta"
    solves_lcp: ClassVar[bool] = False
    declared: ClassVar[Declared] = Declared(
        summary="Eqs (3), (6), (8) as printed, by the classical Runge-Kutta method; systems 1-3 only",
        order_smooth=4,
        order_force_jump=1,
        order_force_kink=2,
        order_penetration=1,
        level="position",
        relative_degrees=(0, 1),
        handles=(Feature.MASSLESS,),
        reaction_time="at t",
        energy="no bound",
        kick=1.0,
        slack=6.0,
        step=300.0,  # 130 on the systems of the paper, whose plates are projected
        drift=1.0,
        dissipates=False,
        source="GrzesikiewiczZbiciak, Eqs (3), (6), (8)",
    )

    def __post_init__(self) -> None:
        if self.contact not in RULES:
            raise InputError(nearest(str(self.contact), list(RULES), "contact rule"))

    def start(self, problem: Problem, grid: Grid, lcp_solver: str, record: Record) -> PaperRun:
        """Write the initial values, Eqs (3d), (5e), (7e)."""
        if problem.name not in COORDINATES:
            raise UnsupportedError(
                f"rk4-paper knows only {', '.join(COORDINATES)}, whose equations the paper prints, and not "
                f"{problem.name!r}: ",
                ("moreau-jean", "exact"),
            )
        paper = load_problem(problem.name, **problem.parameters)
        if problem.scheme != paper.scheme:
            raise UnsupportedError(
                f"the scheme of this {problem.name!r} is not the paper's, whose equations rk4-paper knows: give the problem "
                "another name and take method='moreau-jean', or get it from load_problem"
            )
        p = np.array([paper.parameters.get(name, np.nan) for name in CONSTANTS])
        x0, y0, z0 = (float(problem.q0.get(node, 0.0)) for node in "xyz")
        s = np.array([x0, float(problem.v0.get("x", 0.0)), y0, z0])
        motion = np.empty((grid.steps + 1, 4))
        rates = np.empty((grid.steps + 1, 4))
        reaction = np.empty(grid.steps + 1)
        run = PaperRun(int(problem.name[-1]), grid.h, p, s, motion, rates, reaction)
        motion[0] = s
        reaction[0] = right_side(run.system, RULES.index(self.contact), s, p, rates[0])
        _write(run, record, 0, 0)
        return run

    def advance(self, carry: PaperRun, record: Record, first: int, last: int) -> tuple[Status, int]:
        """Take the steps of the block."""
        reached = steps(carry, RULES.index(self.contact), first, last)
        record.stats.evaluations += 5 * (reached - first)
        _write(carry, record, first + 1, reached)
        return (Status.SOLVED if reached == last else Status.NON_FINITE), reached


def _write(run: PaperRun, record: Record, first: int, last: int) -> None:
    here = slice(first, last + 1)
    columns = COORDINATES[f"system-{run.system}"]
    record.q[here] = run.motion[here][:, columns]
    record.v[here] = run.rates[here][:, columns]
    record.reaction[here, 0] = run.reaction[here]
