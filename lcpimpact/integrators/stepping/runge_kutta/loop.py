"""The loop over the steps of an explicit Runge-Kutta method."""

from __future__ import annotations

from typing import NamedTuple

from lcpimpact.arrays import Matrix, Stack, Vector
from lcpimpact.compiled import compiled
from lcpimpact.errors import Status
from lcpimpact.integrators.stepping.kernel import copy
from lcpimpact.integrators.stepping.law import Solving
from lcpimpact.integrators.stepping.runge_kutta.corrections import end_step, hold, slips_off
from lcpimpact.integrators.stepping.runge_kutta.right_side import (
    SOLVED,
    Matrices,
    Point,
    StageWorkspace,
    right_side,
    touching,
)
from lcpimpact.lcp.solver import Kernel

NON_FINITE = int(Status.NON_FINITE)

MAX_STATE = 1e100
"""Largest state: beyond, a step is too long to be a motion; its energy is still a number."""


class GridValues(NamedTuple):
    """Results of the steps at each instant of the grid: y, y', r, P, and the time since each gap closed."""

    y: Matrix
    dy: Matrix
    r: Matrix
    P: Matrix
    since: Matrix


class Weights(NamedTuple):
    """The tableau: a (s, s), b (s,), and the weights of the estimated error (s,)."""

    a: Matrix
    b: Vector
    b_error: Vector


class StepBlock(NamedTuple):
    """The steps of a block.

    Attributes
    ----------
    first, last : int               indices of the first and the last instant
    h, shortest : float             length of the steps, and of the shortest flight, in s
    given : (steps or 1, s + 1, ng) signals and loads at the stages and at the end of a step
    tol, max_iter                   tolerance of the LCP solver, and its limit of iterations
    """

    first: int
    last: int
    h: float
    shortest: float
    given: Stack
    tol: float
    max_iter: int


@compiled()
def add_to_scale(system: Matrices, x: Vector, r: Vector, h: float, scale: Vector, moves: Vector) -> None:
    """Raise the scale to the displacements of a step.

    A body at rest has no velocity to compare with, but balanced forces, and their effect in a step.
    """
    ny = len(moves)
    for j in range(ny):
        sum_ = 0.0
        for l in range(len(x)):  # noqa: E741
            sum_ += abs(system.A[j, l] * x[l])
        for c in range(len(r)):
            sum_ += abs(system.B[j, c] * r[c])
        moves[j] = h * sum_
    for j in range(ny):
        sum_ = 0.0
        for l in range(ny):  # noqa: E741
            sum_ += abs(system.A[j, l]) * moves[l]
        scale[j] = max(scale[j], moves[j], h * sum_)


@compiled()
def steps(
    block: StepBlock,
    system: Matrices,
    weights: Weights,
    motion: GridValues,
    now: tuple[Vector, Vector],
    ahead: Matrix,
    room: StageWorkspace,
    solve: Kernel,
) -> tuple[int, int, int, float]:
    """Take a block of steps: compute the motion at [k + 1] from that at [k].

    ``now`` holds x and its scale so far; ``ahead`` (2, ny) becomes the last state before its correction, and its error
    estimate. Returns the status, the step reached, the sum of the LCP iterations, and the largest residual.
    """
    x, scale = now
    h = block.h
    given = block.given
    K = room.K
    s = len(weights.b)
    ny = motion.y.shape[1]
    nc = motion.r.shape[1]
    solving = Solving(block.tol, block.max_iter, solve)
    total, worst = 0, 0.0
    for k in range(block.first, block.last):
        p = k - block.first if len(given) > 1 else 0
        y, force = motion.y[k], motion.r[k + 1]
        copy(motion.dy[k], K[0])
        copy(motion.r[k], force)
        copy(y, x[:ny])
        copy(given[p, 0], x[ny:])
        add_to_scale(system, x, force, h, scale, room.moves)
        touching(x, system, scale, force, room.together)
        for i in range(1, s):
            for j in range(ny):
                sum_ = 0.0
                for l in range(i):  # noqa: E741
                    sum_ += weights.a[i, l] * K[l, j]
                x[j] = y[j] + h * sum_
            copy(given[p, i], x[ny:])
            touching(x, system, scale, force, room.touches)
            for c in range(nc):
                # A contact open at the start of the step stays so until its end, where `end_step` corrects it; one that
                # has pushed so far is closed, whatever the error of the stage.
                room.touches[c] = room.together[c] and (room.touches[c] or force[c] > 0.0)
            status, count, residual = right_side(x, system, force, K[i], room, solving)
            total, worst = total + count, max(worst, residual)
            if status != SOLVED:
                return status, k, total, worst
        for j in range(ny):
            sum_, estimate = 0.0, 0.0
            for l in range(s):  # noqa: E741
                sum_ += weights.b[l] * K[l, j]
                estimate += weights.b_error[l] * K[l, j]
            x[j] = y[j] + h * sum_
            ahead[0, j], ahead[1, j] = x[j], h * estimate
            if not abs(x[j]) < MAX_STATE:
                return NON_FINITE, k, total, worst
        copy(given[p, s], x[ny:])
        for j in range(len(scale)):
            scale[j] = max(scale[j], abs(x[j]))
        end = Point(x, motion.dy[k + 1], force, motion.P[k + 1], motion.since[k + 1])
        if slips_off(x, system, scale, force, room.together):
            status, count, residual = hold(end, system, h, room, solving)
            total, worst = total + count, max(worst, residual)
            if status != SOLVED:
                return status, k, total, worst
        status, count, residual = end_step(
            end, system, scale, (h, block.shortest), room, block.tol, block.max_iter, solve
        )
        total, worst = total + count, max(worst, residual)
        if status != SOLVED:
            return status, k, total, worst
        copy(x[:ny], motion.y[k + 1])
    return SOLVED, block.last, total, worst
