"""Block diagram of a linear complementarity system: a linear block with the complementarity law as feedback."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Rectangle

from lcpimpact.plotting.layout import width
from lcpimpact.plotting.style import INK, LIGHT_GREY, PALETTE
from lcpimpact.plotting.timeline import math_text
from lcpimpact.scheme.system import LinearComplementaritySystem

SIGNAL = PALETTE[1]


def draw_system(ax: Axes, system: LinearComplementaritySystem) -> tuple[float, float]:
    """Draw the block diagram of x' = A x + B λ + a, w = C x + D λ + c with the law of λ; return its width and height."""
    assert system.states is not None
    assert system.multipliers is not None
    a = system.a or ()
    forced = any(callable(each) or each != 0.0 for each in a)
    terms = {
        "C\\,x": True,
        "D\\,λ": bool(np.asarray(system.D).any()),
        "c(t)" if any(map(callable, system.c or ())) else "c": any(each != 0.0 for each in system.c or ()),
    }
    output = " + ".join(term for term, there in terms.items() if there)
    equations = [f"$\\dot x = A\\,x + B\\,λ{' + a(t)' if forced else ''}$", f"$w = {output}$"]
    names = f"$x$ = ({_some(system.states)})", f"$λ$ = ({_some(system.multipliers)})"
    half = max(3.0, *(width(text) / 2.0 + 0.6 for text in names))

    _box(ax, half, 2.5, 2.5)
    for line, height in zip((*equations, names[0]), (4.25, 3.55, 2.9), strict=True):
        _draw_text(ax, line, height, 14.0 if line == names[0] else 17.0)
    _box(ax, half, 0.0, 1.6)
    law = r"λ_{\min} \leq λ \leq λ_{\max} \perp w"
    if all(low == 0.0 and math.isinf(high) for low, high in system.bounds):
        law = r"0 \leq λ \perp w \geq 0"
    elif all(math.isinf(low) for low, _ in system.bounds):
        law = "w = 0"
    _draw_text(ax, f"${law}$", 1.1, 17.0)
    _draw_text(ax, names[1], 0.45, 14.0)
    outside = half + 1.2
    # w runs around the right side, and λ back on the left.
    for side, name, path in ((1.0, "$w$", (3.75, 0.8)), (-1.0, "$λ$", (0.8, 3.75))):
        start, end = path
        ax.plot(
            [side * half, side * outside, side * outside, side * (half + 0.2)],
            [start, start, end, end],
            color=SIGNAL,
            linewidth=1.3,
            linestyle="-",
            solid_joinstyle="miter",
        )
        tip = np.array([[0.0, 0.0], [0.3, 0.11], [0.3, -0.11]]) * [side, 1.0] + [side * half, end]
        ax.fill(*tip.T, color=SIGNAL, linewidth=0.0)
        ax.text(
            side * (outside + 0.2), 2.275, name, ha="left" if side > 0.0 else "right", va="center", fontsize=14.0,
            color=SIGNAL,
        )  # fmt: skip
    wide, high = 2.0 * (outside + 1.0), 5.6
    ax.set(xlim=(-wide / 2.0, wide / 2.0), ylim=(-0.3, high - 0.3), aspect="equal")
    ax.set_axis_off()
    return wide, high


def _some(names: Sequence[str], *, max_names: int = 4) -> str:
    # max_names: maximum number of names written in full; otherwise the first and the last.
    shown = [math_text(name) for name in names]
    return ", ".join(shown if len(shown) <= max_names else [*shown[:2], "…", shown[-1]])


def _box(ax: Axes, half: float, low: float, height: float) -> None:
    ax.add_patch(Rectangle((-half, low), 2.0 * half, height, facecolor=LIGHT_GREY, edgecolor=INK, linewidth=1.5))


def _draw_text(ax: Axes, text: str, height: float, size: float) -> None:
    ax.text(0.0, height, text, ha="center", va="center", fontsize=size, color=INK)
