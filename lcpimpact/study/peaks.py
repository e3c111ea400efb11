"""The greatest values of linear functions of an exact motion, with all points at which they are reached."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from lcpimpact.arrays import Array
from lcpimpact.hybrid.motion import ExactSolution


class Peak(NamedTuple):
    """A point of greatest value.

    Attributes
    ----------
    value : float
    function : int      which function it is of
    segment : int       the segment of the motion
    t : float           its instant in s
    side : str          "right" at the start of the segment, "left" at the event that ends it, "" inside or at the run's end
    """

    value: float
    function: int
    segment: int
    t: float
    side: str


def peaks_of(
    solution: ExactSolution, scale: Array, w: Array, w0: Array, *, tie_rtol: float = 1e-10
) -> tuple[list[Peak], float]:
    """Return all points at which the greatest of functions w·(q, v, r) + w0 has its greatest value, and their size.

    ``tie_rtol``: difference of values that are equal, relative to the terms of the functions at their largest.

    Parameters
    ----------
    solution : ExactSolution
    scale : (N,) array          the largest |X| of the motion
    w : (m, 2 n + nc) array
    w0 : (m,) array
    """
    modes = {each.mode.key: each.mode for each in solution.segments}.values()
    sizes = [np.abs(w @ solution.system.coordinates(mode).rows.hi) @ scale + np.abs(w0) for mode in modes]
    size = float(np.max(sizes))
    found = [each for k in range(len(solution.segments)) for each in _peaks_in(solution, scale, k, w, w0)]
    highest = max(each.value for each in found)
    return [each for each in found if each.value >= highest - tie_rtol * size], size


def _peaks_in(
    solution: ExactSolution,
    scale: Array,
    k: int,
    w: Array,
    w0: Array,
    *,
    rate_rtol: float = 1e-12,
    max_points: int = 20_000,
) -> Iterator[Peak]:
    """Yield the ends and the local maxima of functions in segment k; of one that is constant, points within it.

    ``rate_rtol``: rate, relative to its terms at their largest, that is zero.
    ``max_points``: maximum number of samples of a segment, four in a window of its flow.
    """
    system, segments = solution.system, solution.segments
    segment = segments[k]
    last = k + 1 == len(segments)
    length = float(segment.since(np.array(solution.end)) if last else (segments[k + 1].start - segment.start).hi)
    if length <= 0.0 and not last:
        return
    flow, _ = system.reaction(segment.mode)
    rows, A = w @ system.coordinates(segment.mode).rows.hi, flow.A
    times = np.linspace(0.0, max(length, 0.0), min(5 + int(4.0 * length / flow.window), max_points))
    states = flow.at(segment.state, times)
    values, rates = states @ rows.T + w0, states @ (rows @ A).T
    no_rate = rate_rtol * (np.abs(rows @ A) @ scale)
    flat = np.all(np.abs(rates) <= no_rate, axis=0).tolist()
    for i, (row, y) in enumerate(zip(rows, values.T, strict=True)):
        yield Peak(float(y[0]), i, k, segment.t0, "right")
        if length > 0.0:
            yield Peak(float(y[-1]), i, k, segment.t0 + length, "" if last else "left")
        if flat[i]:
            for part in (0.25, 0.5, 0.75):
                yield Peak(float(y[0]), i, k, segment.t0 + part * length, "")
            continue
        rate = rates[:, i]
        # The highest sample does not tell: beside an event the peak may lie between it and the next sample.
        for j in np.flatnonzero((rate[:-1] > 0.0) & (rate[1:] <= 0.0)).tolist():
            t = float(times[j] + (times[j + 1] - times[j]) * rate[j] / (rate[j] - rate[j + 1]))
            for _ in range(6):  # Newton's method for the instant at which the rate is zero
                X = flow.move(segment.state, t).hi
                slope, curvature = float(row @ A @ X), float(row @ A @ A @ X)
                t = float(np.clip(t - slope / curvature if curvature < 0.0 else t, times[j], times[j + 1]))
            X = flow.move(segment.state, t).hi
            if abs(row @ A @ X) <= no_rate[i]:
                yield Peak(float(row @ X + w0[i]), i, k, segment.t0 + t, "")
