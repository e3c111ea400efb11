r"""The complementary cones of an LCP in two unknowns, and the number of solutions for each q.

.. math:: q = I w - M z, \qquad z, w \ge 0, \quad z_i w_i = 0

states that q lies in a complementary cone, spanned by one column of each pair e_i, -M_i. Each cone that contains q gives a
solution: the four cones partition the plane if M is a P-matrix; where they overlap there are several solutions, and in a
gap there is none.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, overload

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Wedge
from numpy.typing import ArrayLike

from lcpimpact.arguments import checked
from lcpimpact.arrays import Array
from lcpimpact.errors import InputError
from lcpimpact.lcp.operators import as_operator, finite_array
from lcpimpact.lcp.solvers.enumeration import all_solutions
from lcpimpact.plotting.style import INK, LCP, PALETTE, RK4, Drawing, save, style

BASES = ((), (0,), (1,), (0, 1))
"""Complementary bases, each as the rows whose z is basic; w is basic in the others."""

COLORS = PALETTE[5], PALETTE[4], PALETTE[2], PALETTE[3]
RADII = 1.0, 0.84, 0.68, 0.52
"""Radius of each cone, distinct so that the rims of overlapping cones are visible."""

PARALLEL_TOL = 1e-12
"""Sine of the angle below which two columns are parallel."""

COLUMN, RIGHT_SIDE = LCP, RK4
HALF_WIDTH = 1.32
"""Half of the width of the picture, in units of the largest radius."""


@dataclass(frozen=True)
class Cone:
    """The cone of non-negative combinations of two columns.

    Attributes
    ----------
    basis : tuple of int        the rows whose column is that of -M
    columns : (2, 2) array      the columns, each as a row
    """

    basis: tuple[int, ...]
    columns: Array

    @property
    def name(self) -> str:
        """The basis as a set of row numbers from 1."""
        return "{" + ",".join(str(i + 1) for i in self.basis) + "}"

    @cached_property
    def angles(self) -> tuple[float, ...]:
        """Directions in degrees of the non-zero columns, anticlockwise if two columns span the plane."""
        a, b = self.columns
        found = [_angle(each) for each in (a, b) if each.any()]
        if self.kind == "wedge":
            first, last = found if _turn(found[0], found[1]) < 180.0 else reversed(found)
            return first, first + _turn(first, last)
        return tuple(found)

    @cached_property
    def kind(self) -> str:
        """Kind of the cone: "wedge", or if degenerate "line", "ray" or "origin"."""
        a, b = (each / (np.hypot(*each) or 1.0) for each in self.columns)
        if not (a.any() or b.any()):
            return "origin"
        if abs(a[0] * b[1] - a[1] * b[0]) > PARALLEL_TOL:
            return "wedge"
        return "line" if a @ b < 0.0 else "ray"

    def is_dependent_at(self, q: Array) -> bool:
        """Return whether q has several representations in the cone: the columns are dependent and q lies in their span."""
        if self.kind == "wedge":
            return False
        if q.any():
            return self.contains(_angle(q))
        return self.kind == "line" or not self.columns.any(axis=1).all()

    def contains(self, direction: float) -> bool:
        """Return whether the cone contains a direction in degrees."""
        near = 1e-9
        if self.kind == "wedge":
            return _turn(self.angles[0] - near, direction) <= self.angles[1] - self.angles[0] + 2.0 * near
        return any(abs(_turn(each - 180.0, direction) - 180.0) <= near for each in self.angles)


def cones(M: Array) -> list[Cone]:
    """Return the four cones of a matrix (2, 2), in the order of `BASES`."""
    pairs = np.eye(2), -M.T
    return [Cone(basis, np.array([pairs[i in basis][i] for i in range(2)])) for basis in BASES]


def sectors(all_cones: Sequence[Cone]) -> list[tuple[float, float, int]]:
    """Return the sectors between the edges of wedges: first and last angle, and number of wedges that contain it."""
    wedges = [cone for cone in all_cones if cone.kind == "wedge"]
    edges = np.unique(np.round([angle % 360.0 for cone in wedges for angle in cone.angles], 9))
    found = []
    for first, last in zip(edges, [*edges[1:], edges[0] + 360.0], strict=True):
        if last - first > 1e-6:
            count = sum(cone.contains((first + last) / 2.0) for cone in wedges)
            found.append((float(first), float(last), count))
    return found


@overload
def plot_cones(M: Any, q: ArrayLike | None = None, path: str | Path | None = None, *, ax: None = None) -> Figure: ...
@overload
def plot_cones(M: Any, q: ArrayLike | None = None, path: None = None, *, ax: Axes) -> Axes: ...
@style()
@checked
def plot_cones(
    M: Any, q: ArrayLike | None = None, path: str | Path | None = None, *, ax: Axes | None = None
) -> Figure | Axes:
    """Draw the complementary cones of LCP(M, q) in the plane of q, with the directions of the columns and of q.

    Each cone has its own radius; lengths have no meaning. A degenerate cone is a thick line, on which solutions form a
    continuum. Regions outside all cones are hatched. The numbers of solutions in the title hold for q in the interior of
    the cones.

    Parameters
    ----------
    M : (2, 2) array_like, sparse matrix or operator
        Any matrix.
    q : (2,) array_like, optional
        Right-hand side, drawn as an arrow; its solutions are listed.
    path : str or Path, optional
        A file ending in .png, .svg or .pdf to write.
    ax : Axes, optional
        Axes to draw in; by default a new figure.

    Returns
    -------
    Figure or Axes
        The new figure, or ``ax``.

    Raises
    ------
    InputError
        If M is not of order 2 or q not 2 numbers; for another ending, or a folder that cannot be written.

    Examples
    --------
    >>> plot_cones([[1.0, 2.0], [2.0, 1.0]], [-1.0, -1.0]).axes[0].get_title(loc="left").splitlines()[1]
    '1 or 3 solutions, depending on $q$'

    References
    ----------
    Cottle, Pang and Stone, *The Linear Complementarity Problem* (1992), section 1.3.
    """
    operator = as_operator(M)
    if operator.n != 2:
        raise InputError(f"M has order {operator.n}; the cones can be drawn for order 2 only: give a matrix of order 2")
    full = operator.array()
    right = None if q is None else finite_array("q", q)
    if right is not None and right.shape != (2,):
        raise InputError(f"q must have shape (2,) to fit M, and its shape is {right.shape}")
    figure = Drawing(figsize=(7.2, 4.6), layout="constrained") if ax is None else None
    panel = ax if figure is None else figure.add_subplot()
    assert panel is not None

    drawn = cones(full)
    parts = sectors(drawn)
    panel.set(xlim=(-HALF_WIDTH, HALF_WIDTH), ylim=(-HALF_WIDTH, HALF_WIDTH), aspect="equal")
    panel.set_axis_off()
    gaps = _draw_gaps(panel, parts)
    for cone, color, radius in zip(drawn, COLORS, RADII, strict=True):
        _draw_cone(panel, cone, color, radius)
    _draw_directions(panel, full, right)
    _name_cones(panel, drawn)
    entries = [_entry(cone, color) for cone, color in zip(drawn, COLORS, strict=True)]
    if gaps:
        entries.append(Patch(facecolor="none", edgecolor="#ccd3dc", hatch="////", label="no solution"))
    entries += [_text_entry(f"${{-}}M_{i + 1} = 0$") for i in range(2) if not full[:, i].any()]
    if right is not None:
        entries += _answers(full, right, drawn)
    panel.legend(handles=entries, loc="center left", bbox_to_anchor=(1.0, 0.5))
    rows = ", ".join(f"[{row[0]:.4g}, {row[1]:.4g}]" for row in full + 0.0)
    panel.set_title(f"Complementary cones of $M$ = [{rows}]\n{_verdict(drawn, parts)}", loc="left")
    if figure is None:
        return panel
    if path is not None:
        save(figure, path)
    return figure


def _angle(vector: Array) -> float:
    return float(np.degrees(np.arctan2(vector[1], vector[0]))) % 360.0


def _turn(first: float, last: float) -> float:
    """Return the anticlockwise angle in degrees from one direction to another."""
    return (last - first) % 360.0


def _at(angle: float, radius: float) -> Array:
    return radius * np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle))])


def _verdict(drawn: Sequence[Cone], parts: Sequence[tuple[float, float, int]]) -> str:
    counts = sorted({count for _, _, count in parts})
    if counts == [1]:
        text = "one solution for every $q$: a P-matrix"
        if any(cone.kind != "wedge" for cone in drawn):
            text = "one solution"
    else:
        *some, last = map(str, counts)
        text = f"{', '.join(some)} or {last} solutions, depending on $q$" if some else f"{last} solutions"
    if any(cone.kind != "wedge" for cone in drawn):
        text += "; infinitely many on a thick line"
    return text


def _draw_gaps(ax: Axes, parts: Sequence[tuple[float, float, int]]) -> int:
    empty = [(first, last) for first, last, count in parts if count == 0]
    hatched: dict[str, Any] = {"facecolor": "none", "edgecolor": "#ccd3dc", "hatch": "////", "label": "no solution"}
    for first, last in empty:
        ax.add_patch(Wedge((0.0, 0.0), RADII[0], first, last, linewidth=0.0, **hatched))
    return len(empty)


def _draw_cone(ax: Axes, cone: Cone, color: str, radius: float) -> None:
    if cone.kind == "wedge":
        shape: dict[str, Any] = {"label": cone.name, "zorder": 2.0}
        ax.add_patch(Wedge((0.0, 0.0), radius, *cone.angles, color=color, alpha=0.3, linewidth=0.0, **shape))
        ax.add_patch(
            Wedge((0.0, 0.0), radius, *cone.angles, facecolor="none", edgecolor=color, linewidth=1.4, zorder=2.1)
        )
        return
    ends = [_at(angle, radius) for angle in cone.angles] or [np.zeros(2)]
    if cone.kind == "ray":
        ends = [np.zeros(2), ends[0]]
    x, y = np.array(ends).T
    ax.plot(
        x, y, color=color, linewidth=6.0, linestyle="-", marker="o" if cone.kind == "origin" else "", markersize=11.0,
        solid_capstyle="butt", zorder=2.2, label=cone.name,
    )  # fmt: skip


def _draw_directions(ax: Axes, M: Array, q: Array | None) -> None:
    """Draw the columns and q as arrows to the rim, with labels that do not overlap."""
    named = [("$e_1$", np.array([1.0, 0.0]), INK), ("$e_2$", np.array([0.0, 1.0]), INK)]
    named += [(f"${{-}}M_{i + 1}$", -M[:, i], COLUMN) for i in range(2)]
    named += [] if q is None else [("$q$", q, RIGHT_SIDE)]
    labels: dict[float, list[tuple[str, str]]] = {}
    for name, vector, color in named:
        if not vector.any():
            continue
        angle = _angle(vector)
        angle = next((other for other in labels if abs(_turn(other - 180.0, angle) - 180.0) < 0.5), angle)
        labels.setdefault(angle, []).append((name, color))
        arrow = {"arrowstyle": "-|>", "color": color, "linewidth": 1.6, "shrinkA": 0.0, "shrinkB": 0.0}
        # Of two arrows in one direction the later one is shorter, so that both tips are visible.
        tip = _at(_angle(vector), 1.06 - 0.1 * (len(labels[angle]) - 1))
        ax.annotate("", (tip[0], tip[1]), (0.0, 0.0), arrowprops=arrow, zorder=3.0)
    for (_, names), place in zip(sorted(labels.items()), _apart(sorted(labels)), strict=True):
        x, y = _at(place, 1.12)
        ha = "left" if x > 0.35 else "right" if x < -0.35 else "center"
        va = "bottom" if y > 0.35 else "top" if y < -0.35 else "center"
        color = names[0][1] if len({color for _, color in names}) == 1 else INK
        # Labels of one direction form a column beside the picture, a row above and below it.
        between = ", " if ha == "center" else "\n"
        ax.text(x, y, between.join(name for name, _ in names), ha=ha, va=va, fontsize=12.0, color=color)


def _apart(angles: Sequence[float], least: float = 17.0) -> list[float]:
    """Return ascending angles moved as little as possible to a minimum spacing in degrees."""
    moved = list(angles)
    for _ in range(50 * (len(moved) > 1)):
        for i in range(len(moved)):
            last = (i + 1) % len(moved)
            short = least - _turn(moved[i], moved[last])
            if short > 0.0:
                moved[i] -= short / 2.0
                moved[last] += short / 2.0
    return moved


def _name_cones(ax: Axes, drawn: Sequence[Cone]) -> None:
    """Label each cone with its basis, inside its rim and clear of other labels."""
    placed: list[Array] = []
    for cone, color, radius in zip(drawn, COLORS, RADII, strict=True):
        places = list(_places(cone, radius - 0.08))
        best = max(places, key=lambda place: min((_clear(place, other) for other in placed), default=0.0) > 0.0)
        placed.append(best)
        name = "$\\{" + cone.name[1:-1] + "\\}$"
        ground = {"facecolor": "white", "edgecolor": color, "boxstyle": "round,pad=0.15", "linewidth": 0.8}
        ax.text(best[0], best[1], name, ha="center", va="center", fontsize=9.0, color=INK, bbox=ground, zorder=4.0)


def _places(cone: Cone, radius: float) -> Iterator[Array]:
    """Yield candidate positions of a cone's label, the best first."""
    if cone.kind == "wedge":
        first, last = cone.angles
        for part in (0.5, 0.35, 0.65, 0.22, 0.78):
            yield _at(first + part * (last - first), radius)
    for angle in cone.angles:
        for side in (9.0, -9.0):
            yield _at(angle + side, radius)
    if cone.kind == "origin":
        for angle in (225.0, 315.0, 135.0, 45.0):
            yield _at(angle, 0.2)


def _clear(one: Array, other: Array) -> float:
    """Return the clearance of two labels, in the direction in which it is larger."""
    return float(max(abs(one[0] - other[0]) - 0.24, abs(one[1] - other[1]) - 0.16))


def _entry(cone: Cone, color: str) -> Artist:
    columns = ", ".join(f"{{-}}M_{i + 1}" if i in cone.basis else f"e_{i + 1}" for i in range(2))
    text = f"$\\{{{cone.name[1:-1]}\\}}$: pos$({columns})$"
    if cone.kind == "wedge":
        return Patch(facecolor=(color, 0.3), edgecolor=color, linewidth=1.4, label=text)
    if cone.kind == "origin":
        return Line2D([], [], color=color, linestyle="none", marker="o", label=f"{text}, the origin")
    return Line2D([], [], color=color, linewidth=6.0, label=f"{text}, a {cone.kind}")


def _answers(M: Array, q: Array, drawn: Sequence[Cone]) -> list[Artist]:
    """Return the legend entries with the number and list of solutions for q."""
    found = all_solutions(M, q)
    endless = any(cone.is_dependent_at(q) for cone in drawn)
    number = str(len(found)) if found else "no"
    text = f"$q$ = ({q[0]:.4g}, {q[1]:.4g}): {number} solution{'' if len(found) == 1 else 's'}"
    if endless:
        text = f"$q$ = ({q[0]:.4g}, {q[1]:.4g}): infinitely many, among them"
    arrow = _text_entry(text)
    arrow.set(marker="$\\rightarrow$", markersize=14.0, color=RIGHT_SIDE)
    return [arrow, *(_text_entry(f"$z$ = ({z[0]:.4g}, {z[1]:.4g})") for z in found)]


def _text_entry(text: str) -> Line2D:
    return Line2D([], [], linestyle="none", label=text)
