"""Problems and digits that others published, for the section *Judged from outside* of docs/benchmarks/others.md."""

from __future__ import annotations

import math

import lcpimpact as li


def gearbox(m: float = 3.2, M: float = 18.1, θ: float = 0.628318530717959, ζ: float = 0.9) -> li.Problem:
    """Return the meshing gearbox of ARCH-COMP, GRBX01 from the centre of its initial box.

    A sleeve of mass m is pushed between two flanks at ±θ of a gear of mass M, and is meshed when its tooth arrives at
    px = -3 mm. Source: JuliaReach/ARCH2024_AFF_RE, models/Gearbox/gearbox.jl.
    """
    s, c = math.sin(θ), math.cos(θ)
    scheme = li.Scheme(
        li.Mass("px", m), li.Mass("py", M), li.Load("px", 70.0), li.Load("py", -M * 0.08 * 1.0 / 0.7),
        li.Bumper({"px": s, "py": c}, "ground", e=ζ, name="upper"),
        li.Bumper({"px": s, "py": -c}, "ground", e=ζ, name="lower"),
        li.Bumper("px", "ground", gap=-0.003, e=0.0, name="tooth"),
    )  # fmt: skip
    return li.Problem("gearbox", scheme, q0={"px": -0.0167, "py": 0.003})


def gearbox_by_its_automaton(
    m: float = 3.2, M: float = 18.1, θ: float = 0.628318530717959, ζ: float = 0.9
) -> tuple[list[tuple[float, float]], float, float]:
    """Return the impacts (time, growth of I), the time when it is meshed, and I after that.

    By the guards and the reset maps of the published automaton, with the roots of its parabolas in closed form.
    """
    s, c, tan = math.sin(θ), math.cos(θ), math.tan(θ)
    a, b = 70.0 / m, -0.08 / 0.7
    denominator = m * c**2 + M * s**2
    t, vx, vy, px, py, impulse = 0.0, 0.0, 0.0, -0.0167, 0.003, 0.0
    impacts: list[tuple[float, float]] = []

    def later(accelerating: float, speed: float, distance: float) -> float:
        """Return the first t > 0 at which distance + speed t + accelerating t²/2 rises through zero."""
        roots = [
            (-speed + sign * math.sqrt(max(speed**2 - 2.0 * accelerating * distance, 0.0))) / accelerating
            for sign in (-1.0, 1.0)
        ]
        return min((r for r in roots if r > 1e-12 and speed + accelerating * r > 0.0), default=math.inf)

    while True:
        flank = {sign: later(a * tan + sign * b, vx * tan + sign * vy, px * tan + sign * py) for sign in (1.0, -1.0)}
        mesh = later(a, vx, px + 0.003)
        step = min(mesh, *flank.values())
        px, py = px + vx * step + 0.5 * a * step**2, py + vy * step + 0.5 * b * step**2
        t, vx, vy = t + step, vx + a * step, vy + b * step
        if step == mesh:
            return impacts, t, impulse + m * (abs(vx) + abs(vy))
        sign = 1.0 if step == flank[1.0] else -1.0
        growth = (ζ + 1.0) * m * M * (s * vx + sign * c * vy) / denominator
        vx, vy = (
            ((m * c**2 - M * ζ * s**2) * vx - sign * (ζ + 1.0) * M * s * c * vy) / denominator,
            ((M * s**2 - m * ζ * c**2) * vy - sign * (ζ + 1.0) * m * s * c * vx) / denominator,
        )
        impacts.append((t, growth))
        impulse += growth


REFERENCE_FMU_BOUNCES = (0.451522, 1.08365, 1.52613, 1.83585, 2.05263, 2.20436, 2.31052, 2.38477)
"""Times in s of the first impacts in modelica/Reference-FMUs, BouncingBall/BouncingBall_ref.csv (e = 0.7, from 1 m)."""


def two_balls(x1: float = 0.0, x2: float = 0.52, v0: float = 1.0, u0: float = 0.0, r: float = 0.1) -> li.Problem:
    """Return the elastic impact of two equal balls of nimblephysics#97, where x_f = v0 T + x1 + 2 r after it."""
    scheme = li.Scheme(li.Mass("x1", 1.0), li.Mass("x2", 1.0), li.Bumper("x1", "x2", gap=-2.0 * r, e=1.0))
    return li.Problem("two-balls", scheme, q0={"x1": x1, "x2": x2}, v0={"x1": v0, "x2": u0})


def gradient(method: str, dt: float, h: float = 1e-6, T: float = 1.0) -> tuple[float, ...]:
    """Return d x_f / d (x1, x2, v0, u0) of the two balls by central differences of runs."""
    start = {"x1": 0.0, "x2": 0.52, "v0": 1.0, "u0": 0.0}

    def end(**changed: float) -> float:
        run = li.simulate(two_balls(**{**start, **changed}), method, dt=dt, t_end=T, progress=False)
        return float(run["x2"][-1])

    return tuple((end(**{key: at + h}) - end(**{key: at - h})) / (2.0 * h) for key, at in start.items())
