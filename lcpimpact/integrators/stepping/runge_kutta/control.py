"""Step control of the embedded Runge-Kutta methods, by their estimated errors and the penetrations of their steps."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from lcpimpact.arrays import Array
from lcpimpact.errors import InputError, Status
from lcpimpact.hybrid.grid_steps import GridMotion
from lcpimpact.integrators.base import Limits
from lcpimpact.integrators.stepping.law import with_fallbacks
from lcpimpact.integrators.stepping.runge_kutta.events import happened
from lcpimpact.integrators.stepping.runge_kutta.loop import GridValues, StepBlock
from lcpimpact.integrators.stepping.runge_kutta.method import ExplicitRungeKutta
from lcpimpact.integrators.stepping.runge_kutta.right_side import ACTIVE_GAP_FACTOR, ZERO_RTOL
from lcpimpact.integrators.stepping.runge_kutta.run import RungeKuttaRun, take_steps, write
from lcpimpact.lcp.solver import SolverState as Solver
from lcpimpact.numbers import is_real
from lcpimpact.record import Record
from lcpimpact.scheme.power_law import energies, tangents

STATE_FLOOR = 1e-3
"""Smallest scale of a state, relative to the largest of its kind."""

SAMPLED = np.linspace(0.0, 1.0, 17)[1:-1]
"""Positions in a step at which gaps are sampled, in units of its length."""


@dataclass(frozen=True)
class EmbeddedRungeKutta(ExplicitRungeKutta):
    r"""An embedded Runge-Kutta method, with optional step control within each dt.

    Parameters
    ----------
    rtol : float, optional
        Tolerance relative to the motion so far; with None the step is dt.
    atol : float, optional
        Absolute tolerance in the units of each state, 0 by default: for motions that need not be resolved.
    tol, max_iter : optional
        As of `ExplicitRungeKutta`.

    Raises
    ------
    InputError
        If an option is not positive, or atol is given without rtol.

    Notes
    -----
    With rtol the estimated error ε of a step must not exceed a tenth of it in either of two measures: each state relative to
    its largest value so far, and all of them together by the energy of ε relative to the largest energy,

    .. math:: |ε_i| \le \tfrac{1}{10} rtol \max |y_i|, \qquad ε^T G ε \le (\tfrac{1}{10} rtol)^2 \max y^T G y, \quad
              \tfrac 12 y^T G y = \tfrac 12 v^T M v + \tfrac 12 q^T K q .

    The energy norm relates errors of positions and velocities: δ in a position is ω δ in a velocity a quarter of a period
    later. A step with a penetration beyond the tolerance is rejected, too, and repeated up to the closing of the gap; so
    is one in which a gap falls below zero and rises again. Rebounds are suppressed if they are lower than the tolerance,
    or their flight is shorter than rtol dt.

    The error of a run is then a small multiple of rtol, unless the motion amplifies errors, as impacts of several bodies
    may.
    """

    rtol: float | None = None
    atol: float | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, value in (("rtol", self.rtol), ("atol", self.atol)):
            if value is not None and (not is_real(value) or not value > 0.0):
                raise InputError(f"{name} = {value!r} must be above zero, or None")
        if self.atol is not None and self.rtol is None:
            raise InputError(f"atol = {self.atol:g} is given without rtol: give both, or none for steps of dt")

    def limits(self) -> Limits:
        """Return the limits that follow from rtol, if it is given."""
        found = super().limits()
        return found if self.rtol is None else replace(found, precision=max(found.precision, self.rtol))

    def advance(self, carry: RungeKuttaRun | GridMotion, record: Record, first: int, last: int) -> tuple[Status, int]:
        """Take the steps of the block, or several within each by the step control."""
        if self.rtol is None or isinstance(carry, GridMotion):
            return super().advance(carry, record, first, last)
        for k in range(first, last):
            status = self._cross(carry, record, k, self.rtol, self.atol or 0.0)
            if status is not Status.SOLVED:
                write(carry, record, 1, k, diverges=True)
                return status, k
        write(carry, record, first + 1, last)
        return Status.SOLVED, last

    def _cross(self, carry: RungeKuttaRun, record: Record, k: int, rtol: float, atol: float) -> Status:
        """Integrate from t_k to t_k+1 with step control."""
        tableau, grid = self.tableau, carry.grid
        c, ny = np.array(tableau.c), carry.motion.y.shape[1]
        t = grid.t_end * k / grid.steps
        end = grid.t_end * (k + 1) / grid.steps
        motion = GridValues(*(np.repeat(each[k : k + 1], 2, axis=0) for each in carry.motion))
        y = motion.y
        r = motion.r
        P = motion.P
        ahead = np.zeros((2, ny))
        scale = carry.scale.copy()
        inertia = carry.system.degree == 2
        assert record.events is not None
        while t < end:
            h = min(carry.step[0], end - t)
            if h < 4.0 * np.spacing(end):
                if end - t < 4.0 * np.spacing(end):
                    break
                return Status.STEP_SIZE
            given = carry.given_in_steps(np.array([t, end if h == end - t else t + h]), c, h, tableau.b[0])

            def run(solver: Solver, first: int, last: int, h: float = h, given: Array = given) -> tuple[Status, int]:
                block = StepBlock(first, last, h, rtol * grid.h, given, carry.tol, carry.max_iter)
                return take_steps(carry, solver, record.stats, block, tableau, motion, ahead)

            scale[:] = carry.scale
            status, _ = with_fallbacks(run, carry.solver, carry.contacts, 0, 1)
            if status is not Status.SOLVED:
                carry.scale[:] = scale
                if status is not Status.NON_FINITE:
                    return status
                factor = 0.1
            else:
                factor = self._factor(carry, motion, given[0], ahead, h, (rtol, atol))
            if factor < 1.0:
                carry.scale[:] = scale
                carry.step[0] = factor * h
                record.stats.rejected += 1
                continue
            carry.step[0] = max(factor * h, carry.step[0] if h < carry.step[0] else 0.0)
            record.stats.steps += 1
            if (P[1, inertia] > 0.0).any() or ((r[0] > 0.0) != (r[1] > 0.0)).any():
                record.events += happened(carry, np.array([t, t + h]), motion)
            np.maximum(carry.largest, np.abs(y[1]), out=carry.largest)
            carry.energy[0] = max(carry.energy[0], energy_of(carry, np.append(y[1], given[0, -1])))
            for each in motion:
                each[0] = each[1]
            t = end if h == end - t else t + h
        for each, of in zip(carry.motion, motion, strict=True):
            each[k + 1] = of[0]
        return Status.SOLVED

    def _factor(
        self,
        carry: RungeKuttaRun,
        motion: GridValues,
        given: Array,
        ahead: Array,
        h: float,
        tolerances: tuple[float, float],
        *,
        step_tolerance: float = 0.1,
    ) -> float:
        """Return the length of the next step in units of h; below 1 the step of h is to be taken again.

        ``step_tolerance``: error of one step in units of rtol, since the errors of steps add up.
        """
        y = motion.y
        dy = motion.dy
        P = motion.P
        before, error = ahead
        ny = ahead.shape[1]
        rtol, atol = (step_tolerance * each for each in tolerances)
        allowed = allowed_errors(carry, before, h, rtol, atol)
        size = max(relative_error(carry, np.append(before, given[-1]), error, allowed, rtol), 1e-10)
        factor = float(np.clip(0.9 * size ** (-1.0 / (self.tableau.order_embedded + 1.0)), 0.2, 5.0))
        if size > 1.0:
            return factor
        # A penetration beyond the tolerance: back to where the line through both gaps is zero.
        C = carry.matrices.C[carry.system.degree > 0]
        u = C @ np.append(y[0], given[0])
        u_next = C @ np.append(before, given[-1])
        bound = np.abs(C[:, :ny]) @ allowed + ACTIVE_GAP_FACTOR * ZERO_RTOL * (np.abs(C) @ carry.scale)
        begun = (u_next < -bound) & (u > bound)
        if begun.any():
            return float((u[begun] / (u[begun] - u_next[begun])).min())
        if (u_next < -bound).any():
            return 0.5
        if not P[1].any():
            lowest = _lowest(h, u, u_next, *(dy @ C[:, :ny].T))
            if ((u > bound) & (u_next > bound) & (lowest < -bound)).any():
                return 0.5
        return max(factor, 1.0)


def allowed_errors(run: RungeKuttaRun, y: Array, h: float, rtol: float, atol: float) -> Array:
    """Return the tolerance of each state in a step of length h that ends in y (ny,)."""
    size = np.maximum(run.largest, np.abs(y))
    places = len(y) - run.form.parts.massive.shape[1]
    speed = size[places:].max(initial=0.0)
    kinds = np.where(np.arange(len(y)) < places, max(size[:places].max(initial=0.0), h * speed), speed)
    return np.asarray(atol + rtol * np.maximum(size, STATE_FLOOR * kinds))


def relative_error(run: RungeKuttaRun, x: Array, error: Array, allowed: Array, rtol: float) -> float:
    """Return the estimated error of a step that ends in x = (y, signals, loads), relative to its tolerance."""
    δ = _approach(run, x)
    _, stiffness, _ = tangents(run.inputs.law, np.maximum(δ, 0.0), np.zeros_like(δ), extended=True)
    moved = run.inputs.approach[:, : len(error)] @ error
    square = error @ run.metric @ error + (stiffness * moved**2).sum()
    limit = rtol**2 * max(run.energy[0], energy_of(run, x)) + STATE_FLOOR**2 * np.abs(np.diag(run.metric)) @ allowed**2
    single = np.abs(np.divide(error, allowed, out=np.zeros_like(error), where=allowed > 0.0)).max(initial=0.0)
    return max(float(single), math.sqrt(max(square, 0.0) / limit) if limit > 0.0 else 0.0)


def energy_of(run: RungeKuttaRun, x: Array) -> float:
    """Return twice the energy of springs and masses at x, without signals."""
    y = x[: len(run.metric)]
    return float(y @ run.metric @ y + 2.0 * energies(run.inputs.law, _approach(run, x)).sum())


def _approach(run: RungeKuttaRun, x: Array) -> Array:
    """Return δ of the non-linear springs (ns,)."""
    rows = run.inputs.approach
    return np.asarray(rows @ x[: rows.shape[1]])


def _lowest(h: float, u_0: Array, u_1: Array, rate_0: Array, rate_1: Array) -> Array:
    """Return the least values within a step of the cubics through gaps and their rates at both its ends."""
    s = SAMPLED[:, None]
    ends = (1.0 + 2.0 * s) * (1.0 - s) ** 2 * u_0 + s**2 * (3.0 - 2.0 * s) * u_1
    return np.asarray((ends + h * s * (1.0 - s) * ((1.0 - s) * rate_0 - s * rate_1)).min(axis=0))
