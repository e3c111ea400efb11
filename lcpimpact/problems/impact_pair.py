r"""The impact pair: a mass that is thrown to and fro in a box."""

from __future__ import annotations

import math
from functools import partial
from typing import Annotated

import numpy as np

from lcpimpact.arrays import Array
from lcpimpact.errors import InputError
from lcpimpact.problems.base import Problem, above_zero, restitution, whole
from lcpimpact.problems.facts import Fact
from lcpimpact.problems.registered import registered
from lcpimpact.reading import Readable, event, instant, limit
from lcpimpact.scheme.elements.bumper import Bumper
from lcpimpact.scheme.elements.mass import Mass
from lcpimpact.scheme.elements.prescribed_motion import PrescribedMotion
from lcpimpact.scheme.scheme import Scheme
from lcpimpact.scheme.signals import Harmonic


@registered
def impact_pair(
    m: Annotated[float, "kg, mass"] = 1.0,
    d: Annotated[float, "m, play"] = 0.1,
    e: Annotated[float, "1, coefficient of restitution"] = 0.6,
    A: Annotated[float, "m, amplitude of the box"] = 0.03,
    omega: Annotated[float, "rad/s, circular frequency ω of the box"] = 10.0,
    n: Annotated[float, "1, periods of the box from one impact to the next at the same wall, odd"] = 1,
) -> Problem:
    r"""A free mass between the walls of a shaken box: one impact at each wall in n of its periods.

    The box moves by ``y = A cos(ω t + φ)``, whatever strikes it, and leaves the mass the play d. Nothing else acts on the
    mass. In the symmetric motion, n odd, it crosses the box at the speed w in half a period ``τ = n π/ω``, while the box
    goes from y_0 to -y_0, and at each impact the wall comes towards it. With ``ρ = (1 - e)/(1 + e)``

    - the way gives ``w τ = d + 2 y_0``, ``y_0 = A cos φ``, and Newton's law the speed of the wall, ``A ω sin φ = ρ w``,
    - so W = w/ω is a root of ``(n π W - d)² + 4 ρ² W² = 4 A²``; real ones exist for ``A/d >= ρ/sqrt(n² π² + 4 ρ²)``,
    - the mass arrives with the relative speed ``2 w/(1 + e)`` and takes the impulse ``2 m w``.

    From one impact to the next a small deviation is multiplied by a matrix of the determinant e² and the trace
    ``2 e - (1 + e)² n π y_0/(2 W)``. That makes the root with the smaller W unstable, and the other, which the run takes,
    stable while ``(n² π² - 4) W < n π d``; there the two walls begin to be struck differently. A box with such a mass in it
    is an impact damper: it takes ``2 m w² ρ`` from the drive in each half period. The trap is to start at rest: one wall
    strikes the mass then, which may settle in quite another motion.

    Raises
    ------
    InputError
        If a parameter is out of its range, n is even, or there is no such motion.

    Examples
    --------
    >>> [round(fact.value, 9) for fact in impact_pair().facts]
    [0.314159265, 0.492471628, 0.123117907, 0.615589535, 0.984943256]

    References
    ----------
    Bapat, Popplewell and McLachlan, Stable periodic motions of an impact-pair (1983).
    """
    name = "impact-pair"
    above_zero(name, m=m, d=d, A=A, omega=omega)
    restitution(name, e)
    n = whole(name, "n", n)
    if n % 2 == 0:
        raise InputError(f"{name}: n = {n} must be odd, or the box is not on its other side after half of the motion")
    ρ, τ = (1.0 - e) / (1.0 + e), n * math.pi / omega
    roots = np.roots([(n * math.pi) ** 2 + 4.0 * ρ**2, -2.0 * n * math.pi * d, d**2 - 4.0 * A**2])
    W = float(max(roots.real)) if not roots.imag.any() else -1.0
    if W <= 0.0:
        least = d * ρ / math.hypot(n * math.pi, 2.0 * ρ)
        raise InputError(f"{name}: A = {A:g} is too small for this motion; with e = {e:g} it must be above {least:g}")
    w = W * omega
    box = Harmonic(A, omega, math.atan2(ρ * W, 0.5 * (n * math.pi * W - d)))

    def motion(t: Array) -> tuple[Array, Array]:
        times = np.asarray(t, dtype=np.float64)
        halves = np.floor(times / τ)
        sign = 1.0 - 2.0 * np.mod(halves, 2.0)
        x = sign * (box(0.0) + 0.5 * d - w * (times - halves * τ))
        phase = box.omega * times + box.phase
        q = np.column_stack([x, box.amplitude * np.cos(phase)])
        return q, np.column_stack([-sign * w, -box.amplitude * box.omega * np.sin(phase)])

    q, _ = motion(np.linspace(0.0, τ, 64 * n + 1)[1:-1])
    if (np.abs(q[:, 0] - q[:, 1]) > 0.5 * d).any():
        raise InputError(f"{name}: with A = {A:g} and d = {d:g} a wall strikes the mass on its way; change A or d")

    def facts() -> tuple[Fact, ...]:
        return (
            Fact("τ", "from wall to wall", τ, "s", _crossing),
            Fact("w", "speed of the mass", w, "m/s",
                 partial(limit, kind="impact", number=2, of="v", i=0, side="left")),
            Fact("ρw", "speed of the wall that it strikes", (1.0 - e) / (1.0 + e) * w, "m/s",
                 partial(limit, kind="impact", number=2, of="v", i=1, side="left", unit=-1.0), scale=w),
            Fact("U", "relative speed before", 2.0 * w / (1.0 + e), "m/s", _relative_speed),
            Fact("P", "impulse", 2.0 * m * w, "N s", _impulse),
        )  # fmt: skip

    return Problem(
        name,
        Scheme(
            Mass("x", m),
            PrescribedMotion("y", box),
            Bumper("x", "y", gap=0.5 * d, e=e, name="R1", symbols=("R_1",)),
            Bumper("y", "x", gap=0.5 * d, e=e, name="R2", symbols=("R_2",)),
        ),
        q0={"x": box(0.0) + 0.5 * d},
        v0={"x": -w},
        t_end=5.5 * τ,
        parameters={"n": n},
        source="BapatPopplewellMcLachlan1983",
        facts=facts,
        motion=motion,
    )


def _crossing(run: Readable) -> float:
    """Return the time from the first impact at one wall to the next at the other."""
    return instant(run, "impact", contact="R1") - instant(run, "impact", contact="R2")


def _relative_speed(run: Readable) -> float:
    """Return the speed of the mass against the box just before the second impact."""
    return float(np.diff(event(run, "impact", 2).left.v)[0]) * -1.0


def _impulse(run: Readable) -> float:
    """Return the impulse of the second impact."""
    return float(event(run, "impact", 2).impulse)
