"""Draw docs/images/many-contacts.svg: a column of beads, a cradle, an elastic bar at a wall, a pile, and a lattice.

python docs/pictures/many_contacts.py
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import EllipseCollection, LineCollection

from lcpimpact import (
    Bumper,
    Chain,
    Drawing,
    Harmonic,
    Lattice,
    Loads,
    PrescribedMotion,
    Problem,
    SparseScheme,
    Table,
    pile,
    simulate,
    style,
)

PICTURE = Path(__file__).parents[1] / "images" / "many-contacts.svg"


def draw_column(ax: Axes) -> None:
    """Draw the paths of beads that fall on each other; the floor is at zero."""
    n, gap = 1000, 1e-3
    shown = [1, *range(100, n + 1, 100)]
    scheme = SparseScheme(Chain(n, m=0.1, gap=gap, e=0.0, f=0.981, b="ground", name="bead"))
    run = simulate(Problem("column", scheme), dt=1e-5, t_end=0.6, record=[f"bead.{i}" for i in shown])
    for place, i in enumerate(shown):
        height = (n + 1 - i) * gap - run.q[:, place]
        ax.plot(run.t[::800], height[::800], color="black", linewidth=0.9, linestyle="-")
    t = run.t[::800]
    ax.plot(t, np.maximum(n * gap - 0.5 * 9.81 * t**2, 0.0), color="lightsteelblue", linestyle="--", linewidth=1.5)
    ax.set(xlabel="$t$ [s]", ylabel="height [m]", title="1,000 beads fall on a floor", ylim=(-0.05, 1.05))


def draw_cradle(ax: Axes) -> None:
    """Draw the velocities of balls that hand on an impact from the first to the last."""
    n = 40
    scheme = SparseScheme(Chain(n, m=1.0, gap=1e-3, e=1.0, name="ball"))
    run = simulate(Problem("cradle", scheme, v0={"ball.1": 1.0}), dt=1e-4, t_end=0.045)
    image = ax.pcolormesh(
        run.t[::4], np.arange(1, n + 1), run.v[::4].T, cmap="Greys", vmin=0.0, vmax=1.0, rasterized=True
    )
    ax.figure.colorbar(image, ax=ax, label="$v$ [m/s]")
    ax.plot(run.t, 1.0 + run.t / 1e-3, color="C1", linewidth=0.8, linestyle="--")
    ax.set(xlabel="$t$ [s]", ylabel="ball", title="40 balls hand on an impact", ylim=(0.5, n + 0.5))


def draw_bar(ax: Axes) -> None:
    """Draw the force of an elastic bar on a wall, and d'Alembert's."""
    E, A, rho, L, v0, n = 900.0, 1.0, 1.0, 10.0, 10.0, 1000
    dx, c = L / n, np.sqrt(E / rho)
    m = np.full(n + 1, rho * A * dx)
    m[[0, -1]] /= 2.0
    bar = Chain(n + 1, m=tuple(m), k=E * A / dx, name="u")
    scheme = SparseScheme(bar, Bumper(f"u.{n + 1}", "ground", 0.0, 0.0))
    dt = 0.5 * dx / c
    run = simulate(
        Problem("bar", scheme, v0=dict.fromkeys(bar.masses, v0)), dt=dt, t_end=round(0.9 / dt) * dt, record=["R"]
    )
    force, release = rho * c * A * v0, 2.0 * L / c
    ax.plot(
        [0.0, release, release, 0.9],
        [force, force, 0.0, 0.0],
        color="lightsteelblue",
        linewidth=3.0,
        label="d'Alembert",
    )
    ax.plot(run.t_reaction[::4], run["R"][::4], color="black", linewidth=0.6, linestyle="-", label="1,000 elements")
    ax.set(xlabel="$t$ [s]", ylabel="$R$ [N]", title="An elastic bar hits a wall", ylim=(-20.0, 620.0))
    ax.legend(loc="upper right")


def draw_pile(ax: Axes) -> None:
    """Draw a pile at rest, with lines between the discs as thick as their forces."""
    rows = 12
    run = simulate(pile(rows, 2e-3), dt=1e-3, t_end=0.2, record=())
    force = dict(zip(run.problem.dynamics.reactions, run.final.reaction, strict=True))
    places = {(r, i): (i + 0.5 * r, 0.75**0.5 * r) for r in range(rows) for i in range(rows - r)}
    ends = [
        (force[f"{side}{r}.{i}"], [(x, y), (x + to_right, y - 0.75**0.5)])
        for (r, i), (x, y) in places.items()
        for side, to_right in (("L", -0.5), ("R", 0.5))
    ]
    widths = [4.0 * each / max(force.values()) for each, _ in ends]
    ax.add_collection(LineCollection([line for _, line in ends], linewidths=widths, colors="C1", linestyles="-"))
    ax.add_collection(
        EllipseCollection(
            1.0,
            1.0,
            0.0,
            units="xy",
            offsets=list(places.values()),
            transOffset=ax.transData,
            facecolors="none",
            edgecolors="black",
            linewidths=0.5,
        )
    )
    ax.set(title="A pile carries its weight", xlim=(-1.2, rows + 0.2), ylim=(-1.2, 0.9 * rows), aspect="equal")
    ax.axis("off")


def draw_lattice(early: Axes, late: Axes) -> None:
    """Draw the velocities by which a blow on the first row runs through a lattice on a shaken table, at two instants."""
    rows, columns = 30, 45
    beads = Lattice(
        rows, columns, m=0.1, k=2e3, k_side=2e3, gap=2e-5, e=0.0, c=0.2, b="table", name="bead"
    )  # fmt: skip
    table = PrescribedMotion("table", Harmonic(1e-4, 400.0, -0.5 * np.pi))
    x = np.arange(1, columns + 1)
    blow = Loads(
        [(1, int(j)) for j in x], f=Table([0.0, 0.0, 0.02, 0.02], [0.0, 20.0, 20.0, 0.0]),
        a=np.exp(-(((x - 23.0) / 2.0) ** 2)), name="bead",
    )  # fmt: skip
    problem = Problem("lattice", SparseScheme(beads, table, blow))
    ends = (0.06, 0.12)
    found = [
        simulate(problem, dt=2.5e-4, t_end=end, record=()).final.v[: rows * columns].reshape(rows, columns)
        for end in ends
    ]
    most = float(np.quantile(np.abs(found), 0.995))
    for ax, end, v in zip((early, late), ends, found, strict=True):
        image = ax.imshow(
            v, interpolation="none", cmap="RdBu_r", vmin=-most, vmax=most, extent=(0.5, columns + 0.5, rows + 0.5, 0.5)
        )
        ax.figure.colorbar(image, ax=ax, label="$v$ [m/s], downwards", extend="both")
        ax.set(xlabel="column", ylabel="row", title=f"A blow in a shaken lattice, {end:g} s", aspect="auto")
        ax.grid(False)


@style()
def draw() -> Drawing:
    """Return the picture."""
    figure = Drawing(figsize=(7.6, 7.8), layout="constrained")
    axes = figure.subplots(3, 2).ravel()
    for ax, each in zip(axes[:4], (draw_column, draw_cradle, draw_bar, draw_pile), strict=True):
        each(ax)
    draw_lattice(*axes[4:])
    return figure


if __name__ == "__main__":
    draw().save(PICTURE)
