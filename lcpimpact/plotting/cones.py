r"""The complementary cones of an LCP in two or three unknowns, and the number of solutions for each q.

.. math:: q = I w - M z, \qquad z, w \ge 0, \quad z_i w_i = 0

states that q lies in a complementary cone, spanned by one column of each pair e_i, -M_i. Each cone that contains q gives a
solution: the cones partition the plane or space if M is a P-matrix; where they overlap there are several solutions, and in
a gap there is none.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from pathlib import Path
from typing import Any, overload

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Wedge
from matplotlib.patheffects import withStroke
from numpy.typing import ArrayLike

from lcpimpact.arguments import checked
from lcpimpact.arrays import Array
from lcpimpact.errors import InputError
from lcpimpact.lcp.operators import as_operator, finite_array
from lcpimpact.lcp.solvers.enumeration import all_solutions
from lcpimpact.plotting import cones_in_space as space
from lcpimpact.plotting.style import GREY, INK, LCP, PALETTE, RK4, Drawing, Look, save, style

COLORS = PALETTE[5], PALETTE[4], PALETTE[2], PALETTE[3]
COLORS_IN_SPACE = *COLORS, PALETTE[0], PALETTE[1], "#f0e442", GREY
DIAMOND = "D"
"""Marker of q on the sphere."""

RADII = 1.0, 0.84, 0.68, 0.52
"""Radius of each cone where cones overlap, distinct so that their rims are visible; else all have the first."""

COLUMN, RIGHT_SIDE = LCP, RK4
HATCH = "#ccd3dc"


@dataclass(frozen=True)
class Cone:
    """The cone of non-negative combinations of n columns; its angles and kind are those in the plane, n = 2.

    Attributes
    ----------
    basis : tuple of int        the rows whose column is that of -M: z is basic there, and w in the others
    columns : (n, n) array      the columns, each as a row
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
        if abs(a[0] * b[1] - a[1] * b[0]) > space.DEPENDENT_TOL:
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
    """Return the 2ⁿ cones of a matrix (n, n), in the order of the sizes of their bases."""
    n = len(M)
    pairs = np.eye(n), -M.T
    bases = [basis for size in range(n + 1) for basis in combinations(range(n), size)]
    return [Cone(basis, np.array([pairs[i in basis][i] for i in range(n)])) for basis in bases]


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
    """Draw the complementary cones of LCP(M, q), with the directions of the columns and of q.

    Of order 2 they lie in the plane of q; where they overlap each has its own radius, and the common sectors are hatched:
    lengths have no meaning. Of order 3 they are triangles
    on the sphere of the directions of q, seen from the front and from behind. A degenerate cone is a thick line, on which
    solutions form a continuum. Regions outside all cones are hatched. The numbers of solutions in the title hold for q in
    the interior of the cones.

    Parameters
    ----------
    M : (n, n) array_like, sparse matrix or operator
        Any matrix of order 2 or 3.
    q : (n,) array_like, optional
        Right-hand side, drawn as an arrow or point; its solutions are listed.
    path : str or Path, optional
        A file ending in .png, .svg or .pdf to write.
    ax : Axes, optional
        Axes to draw in, of order 2; by default a new figure.

    Returns
    -------
    Figure or Axes
        The new figure, or ``ax``.

    Raises
    ------
    InputError
        If M is not of order 2 or 3 or q does not fit it; for another ending, or a folder that cannot be written.

    Examples
    --------
    >>> plot_cones([[1.0, 2.0], [2.0, 1.0]], [-1.0, -1.0]).axes[0].get_title(loc="left").splitlines()[1]
    '1 or 3 solutions, depending on $q$'

    References
    ----------
    Cottle, Pang and Stone, *The Linear Complementarity Problem* (1992), section 1.3.
    """
    operator = as_operator(M)
    if operator.n not in (2, 3):
        raise InputError(f"M has order {operator.n}; the cones can be drawn for order 2 and 3: give such a matrix")
    if operator.n == 3 and ax is not None:
        raise InputError("the cones of a matrix of order 3 are drawn in a figure of two views: leave ax out")
    full = operator.array()
    right = None if q is None else finite_array("q", q)
    if right is not None and right.shape != (operator.n,):
        raise InputError(f"q must have shape ({operator.n},) to fit M, and its shape is {right.shape}")
    if operator.n == 3:
        figure = _plot_in_space(full, right)
    elif ax is not None:
        _plot_in_plane(ax, full, right)
        return ax
    else:
        figure = Drawing(figsize=(7.2, 4.6), layout="constrained")
        _plot_in_plane(figure.add_subplot(), full, right)
    if path is not None:
        save(figure, path)
    return figure


def _plot_in_plane(panel: Axes, full: Array, right: Array | None, *, half_width: float = 1.32) -> None:
    # half_width: half of the width of the picture, in units of the largest radius.
    drawn = cones(full)
    parts = sectors(drawn)
    panel.set(xlim=(-half_width, half_width), ylim=(-half_width, half_width), aspect="equal")
    panel.set_axis_off()
    gaps = _draw_gaps(panel, parts)
    several = sorted({count for _, _, count in parts if count > 1})
    radii = RADII if several or any(cone.kind != "wedge" for cone in drawn) else RADII[:1] * len(drawn)
    for cone, color, radius in zip(drawn, COLORS, radii, strict=True):
        _draw_cone(panel, cone, color, radius)
    _draw_overlaps(panel, parts)
    _draw_directions(panel, full, right)
    _name_cones(panel, drawn, radii)
    entries = [_entry(cone, cone.kind, color) for cone, color in zip(drawn, COLORS, strict=True)]
    entries += [Patch(label=f"{count} cones overlap", **_overlap(count)) for count in several]
    entries += _other_entries(full, bool(gaps))
    if several:
        entries.append(_text_entry("radii: only to tell the cones apart"))
    if right is not None:
        entries += _answers(full, right, any(cone.is_dependent_at(right) for cone in drawn), "$\\rightarrow$")
    panel.legend(handles=entries, loc="center left", bbox_to_anchor=(1.0, 0.5))
    verdict = _verdict([count for _, _, count in parts], [cone.kind for cone in drawn])
    panel.set_title(f"{_title(full)}\n{verdict}", loc="left")


def _plot_in_space(full: Array, right: Array | None) -> Figure:
    drawn = cones(full)
    columns = [cone.columns for cone in drawn]
    kinds = [space.kind_of(each) for each in columns]
    figure = Drawing(figsize=(10.4, 4.6), layout="constrained")
    panels = dict(zip(space.VIEWS, figure.subplots(1, 2), strict=True))
    gaps = [space.draw_sphere(ax, view, columns, COLORS_IN_SPACE, INK, HATCH) for view, ax in panels.items()]
    labels = [(view, place) for view, ax in panels.items() for place in _draw_points(ax, view, full, right)]
    for cone, color, place in zip(drawn, COLORS_IN_SPACE, space.name_places(columns, labels), strict=True):
        if place is not None:
            _name_cone(panels[place[0]], cone, color, place[1], 11.0)
    entries = [_entry(cone, kind, color) for cone, kind, color in zip(drawn, kinds, COLORS_IN_SPACE, strict=True)]
    entries += _other_entries(full, any(gaps))
    if right is not None:
        entries += _answers(full, right, any(space.is_dependent_at(each, right) for each in columns), DIAMOND)
    figure.legend(handles=entries, loc="outside right center", fontsize=11.0)
    counts = space.counts([each for each, kind in zip(columns, kinds, strict=True) if kind == "wedge"])
    figure.suptitle(f"{_title(full)}\n{_verdict(counts, kinds)}", x=0.01, ha="left", fontsize=12.0)
    return figure


def _draw_points(ax: Axes, view: space.View, M: Array, q: Array | None) -> list[Array]:
    """Mark the directions of the columns and of q that a view of the sphere shows; return the places of their names."""
    placed: list[Array] = []
    halo = [withStroke(linewidth=3.0, foreground="white")]
    for name, vector, color in _directions(M, q):
        if not vector.any() or not view.shows(vector):
            continue
        at = view.flat(vector / np.linalg.norm(vector))
        marker = DIAMOND if name == "$q$" else "o"
        ax.plot(*at, color=color, marker=marker, markersize=6.5, linestyle="", zorder=3.0)
        outward = np.degrees(np.arctan2(at[1], at[0])) if np.hypot(*at) > 0.1 else 90.0
        places = [at + _at(outward + turn, 0.16) for turn in (0.0, 60.0, -60.0, 120.0, -120.0, 180.0)]
        free = (each for each in places if all(_clear(each, other) > 0.0 for other in placed))
        x, y = next(free, places[0])
        placed.append(np.array([x, y]))
        ax.text(x, y, name, ha="center", va="center", fontsize=14.0, color=color, path_effects=halo, zorder=4.0)
    return placed


def _angle(vector: Array) -> float:
    return float(np.degrees(np.arctan2(vector[1], vector[0]))) % 360.0


def _turn(first: float, last: float) -> float:
    """Return the anticlockwise angle in degrees from one direction to another."""
    return (last - first) % 360.0


def _at(angle: float, radius: float) -> Array:
    return radius * np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle))])


def _title(M: Array) -> str:
    rows = ", ".join(f"[{', '.join(f'{each:.4g}' for each in row)}]" for row in M + 0.0)
    return f"Complementary cones of $M$ = [{rows}]"


def _verdict(numbers: Sequence[int], kinds: Sequence[str]) -> str:
    """Return the numbers of solutions in words, of the regions of q and the kinds of the cones."""
    counts = sorted(set(numbers))
    flat = any(kind != "wedge" for kind in kinds)
    if counts == [1]:
        text = "one solution" if flat else "one solution for every $q$: a P-matrix"
    else:
        *some, last = map(str, counts)
        text = f"{', '.join(some)} or {last} solutions, depending on $q$" if some else f"{last} solutions"
    if flat:
        text += "; infinitely many on a thick line"
    return text


def _draw_gaps(ax: Axes, parts: Sequence[tuple[float, float, int]]) -> int:
    empty = [(first, last) for first, last, count in parts if count == 0]
    hatched: Look = {"facecolor": "none", "edgecolor": HATCH, "hatch": "////", "label": "no solution"}
    for first, last in empty:
        ax.add_patch(Wedge((0.0, 0.0), RADII[0], first, last, linewidth=0.0, **hatched))
    return len(empty)


def _overlap(count: int) -> Look:
    """Return the look of a sector that several cones have in common."""
    return {
        "facecolor": "none",
        "edgecolor": GREY,
        "hatch": {2: "\\\\\\\\", 3: "xxxx"}.get(count, "++++"),
        "linewidth": 0.0,
    }


def _draw_overlaps(ax: Axes, parts: Sequence[tuple[float, float, int]]) -> None:
    """Hatch the sectors in which cones overlap, up to the rim of the smallest."""
    for first, last, count in parts:
        if count > 1:
            ax.add_patch(Wedge((0.0, 0.0), RADII[-1], first, last, zorder=2.05, **_overlap(count)))


def _draw_cone(ax: Axes, cone: Cone, color: str, radius: float) -> None:
    if cone.kind == "wedge":
        shape: Look = {"label": cone.name, "zorder": 2.0}
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


def _directions(M: Array, q: Array | None) -> list[tuple[str, Array, str]]:
    """Return the columns and q with their names and colours."""
    named = [(f"$e_{i + 1}$", each, INK) for i, each in enumerate(np.eye(len(M)))]
    named += [(f"${{-}}M_{i + 1}$", -each, COLUMN) for i, each in enumerate(M.T)]
    return named if q is None else [*named, ("$q$", q, RIGHT_SIDE)]


def _draw_directions(ax: Axes, M: Array, q: Array | None) -> None:
    """Draw the columns and q as arrows to the rim, with labels that do not overlap."""
    labels: dict[float, list[tuple[str, str]]] = {}
    for name, vector, color in _directions(M, q):
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


def _name_cones(ax: Axes, drawn: Sequence[Cone], radii: Sequence[float]) -> None:
    """Label each cone with its basis, inside its rim and clear of other labels."""
    placed: list[Array] = []
    for cone, color, radius in zip(drawn, COLORS, radii, strict=True):
        places = list(_places(cone, radius - 0.08))
        best = max(places, key=lambda place: min((_clear(place, other) for other in placed), default=0.0) > 0.0)
        placed.append(best)
        _name_cone(ax, cone, color, best)


def _name_cone(ax: Axes, cone: Cone, color: str, place: Array, size: float = 9.0) -> None:
    name = "$\\{" + cone.name[1:-1] + "\\}$"
    ground = {"facecolor": "white", "edgecolor": color, "boxstyle": "round,pad=0.15", "linewidth": 0.8}
    ax.text(place[0], place[1], name, ha="center", va="center", fontsize=size, color=INK, bbox=ground, zorder=4.0)


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


def _entry(cone: Cone, kind: str, color: str) -> Artist:
    columns = ", ".join(f"{{-}}M_{i + 1}" if i in cone.basis else f"e_{i + 1}" for i in range(len(cone.columns)))
    text = f"$\\{{{cone.name[1:-1]}\\}}$: pos$({columns})$"
    if kind == "wedge":
        return Patch(facecolor=(color, 0.3), edgecolor=color, linewidth=1.4, label=text)
    if kind == "origin":
        return Line2D([], [], color=color, linestyle="none", marker="o", label=f"{text}, the origin")
    return Line2D([], [], color=color, linewidth=6.0, label=f"{text}, a {kind}")


def _other_entries(M: Array, gaps: bool) -> list[Artist]:
    """Return the legend entries of regions without solution and of columns without direction."""
    hatched = Patch(facecolor="none", edgecolor=HATCH, hatch="////", label="no solution")
    zero = [_text_entry(f"${{-}}M_{i + 1} = 0$") for i in range(len(M)) if not M[:, i].any()]
    return [*([hatched] if gaps else []), *zero]


def _answers(M: Array, q: Array, endless: bool, marker: str) -> list[Artist]:
    """Return the legend entries with the number and list of solutions for q, whose marker is that of the picture."""
    found = all_solutions(M, q)
    number = str(len(found)) if found else "no"
    given = f"$q$ = {_tuple(q)}"
    text = f"{given}: {number} solution{'' if len(found) == 1 else 's'}"
    if endless:
        text = f"{given}: infinitely many, among them"
    first = _text_entry(text)
    first.set(marker=marker, markersize=6.5 if marker == DIAMOND else 14.0, color=RIGHT_SIDE)
    return [first, *(_text_entry(f"$z$ = {_tuple(z)}") for z in found)]


def _tuple(values: Array) -> str:
    return f"({', '.join(f'{each:.4g}' for each in values)})"


def _text_entry(text: str) -> Line2D:
    return Line2D([], [], linestyle="none", label=text)
