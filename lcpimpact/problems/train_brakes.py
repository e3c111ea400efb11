r"""The brakes of a train, whose air is a circuit with a diode in each car."""

from __future__ import annotations

from functools import partial
from typing import Annotated

import numpy as np
from scipy.linalg import expm
from scipy.optimize import brentq

from lcpimpact.arrays import Array, Flags
from lcpimpact.errors import InputError
from lcpimpact.problems.base import Problem, above_zero, not_negative, whole
from lcpimpact.problems.facts import Fact
from lcpimpact.problems.registered import registered
from lcpimpact.reading import at, crossing
from lcpimpact.scheme.signals import Table
from lcpimpact.scheme.system import LinearComplementaritySystem


@registered
def train_brakes(
    N: Annotated[float, "1, number of cars"] = 3,
    R: Annotated[float, "Ω, resistance of the pipe between two cars"] = 100.0,
    S: Annotated[float, "Ω, resistance of a check valve"] = 10.0,
    C: Annotated[float, "F, capacitance of a reservoir"] = 1e-3,
    D: Annotated[float, "F, capacitance of a brake cylinder"] = 1e-4,
    w0: Annotated[float, "V, pressure of the engine"] = 10.0,
    u0: Annotated[float, "V, pressure to which the reservoirs were charged"] = 7.5,
    rho: Annotated[float, "1, share ρ of it by which they differ from car to car"] = 0.6667,
    t_s: Annotated[float, "s, when the engine lets the air out"] = 0.3,
) -> Problem:
    r"""Air brakes as a circuit: the pipe is filled until every reservoir is, and then let out, and each car brakes.

    A pipe with the resistance R between two cars leads from the engine, at the pressure w0, and from t_s on at 0, to the
    last car. In car i the pipe, at w_i, fills a reservoir, at u_i, across a brake cylinder, at ``v_i = w_i - u_i``, beside a
    check valve that lets air past it into the reservoir, k_i, and none back. With pressures as voltages

    - ``C u_i' = (w_{i-1} - 2 w_i + w_{i+1})/R`` and ``D v_i' = C u_i' - k_i``, the last car without w_{i+1},
    - ``0 <= k_i ⟂ S k_i - v_i >= 0``.

    The motion is ``X(t) = exp(A t) X(0)`` of a linear system from valve to valve. While the pipe is filled the valves open
    in turn from the engine on, and they close alike when it lets the air out. From then on ``C u_i - D v_i`` does not
    change: the air of the reservoirs holds the brakes, v_i < 0, without any supply, and so it does where the pipe breaks.
    What to learn: with D in y = C x + D λ the complementarity is that of a piecewise linear system, whose motion has no
    more than a kink. The trap is a step longer than S D, with which explicit methods are unstable.

    Raises
    ------
    InputError
        If N is no whole number up to 20, a parameter but u0 and rho is not above zero, or one of these is negative.

    Examples
    --------
    >>> [round(fact.value, 6) for fact in train_brakes().facts]
    [0.012873, 0.08177, 0.248253, 0.304898, 7.623389, 6.406656, -6.393581]

    References
    ----------
    Acary and others, An introduction to Siconos (2019), the tutorial train_brakes by B. Caillaud, which runs for 10 s.
    """
    name = "train-brakes"
    N = whole(name, "N", N)
    if N > 20:
        raise InputError(f"{name}: N = {N:g} is too many; take at most 20 cars")
    above_zero(name, R=R, S=S, C=C, D=D, w0=w0, t_s=t_s)
    not_negative(name, u0=u0, rho=rho)
    L = (np.diag(np.ones(N - 1), 1) + np.diag(np.ones(N - 1), -1) - 2.0 * np.eye(N)) / R
    L[-1, -1] += 1.0 / R
    A = np.block([[L / C, L / C], [L / D, L / D]])
    b = np.zeros(2 * N)
    b[0], b[N] = w0 / (R * C), w0 / (R * D)
    steps = rho * u0 / N * np.arange(2 * N)
    start = np.concatenate([(1.0 - rho) * u0 + steps[:N], -(1.0 - rho) * u0 - steps[N:]])
    t_end, cars = 2.0 * t_s, range(1, N + 1)

    def flow(opened: Flags, t: float) -> Array:
        """Return the matrix of X' = A X + b and 1' = 0, with some valves open, at or after t."""
        matrix = np.zeros((2 * N + 1, 2 * N + 1))
        matrix[:-1, :-1] = A
        matrix[range(N, 2 * N), range(N, 2 * N)] -= opened / (S * D)
        matrix[:-1, -1] = b if t < t_s else 0.0
        return matrix

    def follow(count: int = 2000) -> tuple[list[list[float]], Array]:
        """Return the instants at which each valve opens and closes in turn, and X at t_end.

        ``count``: number of points from an instant to the next that is known, at which the signs of v_i are looked at.
        """
        X, t = np.append(start, 1.0), 0.0
        opened, found = start[N:] > 0.0, [list[float]() for _ in cars]
        while t < t_end:
            until = t_s if t < t_s else t_end
            matrix, h = flow(opened, t), (until - t) / count
            step = expm(matrix * h)
            points, changed = [X], np.zeros(0, dtype=int)
            while len(points) <= count and not len(changed):
                points.append(step @ points[-1])
                changed = np.flatnonzero((points[-1][N:-1] > 0.0) != opened)
            if not len(changed):
                X, t = points[-1], until
                continue
            before, t = points[-2], t + (len(points) - 2) * h
            instants = [_root(matrix, before, h, N + int(i)) for i in changed]
            soonest = int(np.argmin(instants))
            i = int(changed[soonest])
            X, t = expm(matrix * instants[soonest]) @ before, t + instants[soonest]
            X[N + i] = 0.0
            opened[i] = not opened[i]
            found[i].append(t)
        return found, X[:-1]

    def facts() -> tuple[Fact, ...]:
        found, X = follow()
        opening = [
            Fact(f"t_{i}", f"valve {i} opens", each[0], "s", partial(crossing, series=f"v{i}"))
            for i, each in zip(cars, found, strict=True)
            if each and each[0] > 0.0
        ]
        closing = [
            Fact("t_c", "the last one closes", each[1], "s", partial(crossing, series=f"v{N}", direction=-1.0))
            for each in found[-1:]
            if len(each) > 1
        ]
        held = [
            Fact(
                symbol,
                f"{what} of car {i}, at the end",
                float(X[place]),
                "V",
                partial(at, series=series, t=t_end),
                scale=w0,
            )
            for i, symbol, what, place, series in (
                (1, "u_1'", "pressure of the reservoir", 0, "u1"),
                (N, f"u_{N}'", "pressure of the reservoir", N - 1, f"u{N}"),
                (N, f"v_{N}'", "pressure of the brake", 2 * N - 1, f"v{N}"),
            )
        ]
        return (*opening, *closing, *held[N == 1 :])

    zero, one = np.zeros((N, N)), np.eye(N)
    supply = [Table((0.0, t_s, t_s, t_end), (each, each, 0.0, 0.0)) if each else 0.0 for each in b.tolist()]
    states = [f"{letter}{i}" for letter in "uv" for i in cars]
    return Problem(
        name,
        LinearComplementaritySystem(
            A, np.vstack([zero, -one / D]), np.hstack([zero, -one]), S * one, a=supply, states=states,
            multipliers=[f"k{i}" for i in cars],
        ),
        q0=dict(zip(states, start.tolist(), strict=True)),
        t_end=t_end,
        parameters={"N": N},
        source="Siconos2019, the tutorial train_brakes by B. Caillaud",
        facts=facts,
    )  # fmt: skip


def _root(matrix: Array, X: Array, h: float, i: int) -> float:
    """Return the instant up to h at which X_i passes zero, by a flow."""
    return float(brentq(lambda s: (expm(matrix * s) @ X)[i], 0.0, h, xtol=1e-18, rtol=8.9e-16))
