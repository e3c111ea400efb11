"""Schemes drawn in the usual symbols of engineering, from the strokes that the elements themselves carry.

Nodes are stacked in levels by their distance from the ground, and every link between two levels is vertical: a node
with several links becomes a rigid bar, or a body wide enough to carry them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from statistics import fmean
from typing import overload

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from lcpimpact.arrays import Array
from lcpimpact.errors import InputError
from lcpimpact.plotting.style import FAINT, INK, PALETTE, SOFT, style
from lcpimpact.plotting.timeline import math_text
from lcpimpact.scheme.elements.base import GROUND, Element
from lcpimpact.scheme.elements.bumper import Bumper
from lcpimpact.scheme.elements.mass import Mass
from lcpimpact.scheme.scheme import Scheme

INCH = 0.42
"""Inches in the unit of the drawing, in which all the lengths below are."""

LINK = 2.1
"""Height of a link."""

BREADTH = 0.75
"""Width of a link's symbol."""

BODY_HEIGHT, BODY_WIDTH = 1.1, 2.6
ARROW = 1.3
"""Unit of a load's frame; its shaft is half as long."""

STUB = 0.35
"""From a body to the rigid bar of links that run sideways."""

CLEAR = 0.2
"""Between a symbol and its label."""

LETTER = 0.32
"""About the width of a letter."""

FORCE, COORDINATE = PALETTE[1], PALETTE[0]

Group = tuple[Element, ...]
"""Links side by side between the same two nodes."""


@dataclass(frozen=True, eq=False)
class Layout:
    """Where everything stands; y grows upwards from the ground at zero."""

    parts: tuple[Element, ...]

    @cached_property
    def nodes(self) -> list[str]:
        """The nodes in the order in which they are mentioned, without the ground."""
        return [node for node in dict.fromkeys(node for part in self.parts for node in part.nodes) if node != GROUND]

    @cached_property
    def groups(self) -> dict[frozenset[str], Group]:
        """The links, by the two nodes that they join."""
        found: dict[frozenset[str], Group] = {}
        for part in self.parts:
            if len(part.nodes) > 1:
                ends = frozenset((part.nodes[0], part.nodes[-1]))
                found[ends] = (*found.get(ends, ()), part)
        return found

    @cached_property
    def level(self) -> dict[str, int]:
        """The distance from the ground in links; what floats freely stands above everything else."""
        level, reached = {GROUND: 0}, [GROUND]
        while True:
            for node in reached:
                new = [other for other in self.neighbours(node) if other not in level]
                level |= dict.fromkeys(new, level[node] + 1)
                reached.extend(new)
            free = [node for node in self.nodes if node not in level]
            if not free:
                return level
            level[free[-1]] = max(level.values()) + 1
            reached = [free[-1]]

    def neighbours(self, node: str) -> list[str]:
        """Return the nodes that links join to a node."""
        return [other for ends in self.groups if node in ends for other in ends - {node}]

    def lower(self, node: str) -> list[str]:
        """Return the neighbours one level below."""
        return [other for other in self.neighbours(node) if self.level[other] < self.level[node]]

    def upper(self, node: str) -> list[str]:
        """Return the neighbours one level above."""
        return [other for other in self.neighbours(node) if self.level[other] > self.level[node]]

    @cached_property
    def label_reach(self) -> float:
        """How far the widest label of a link reaches out from its symbol."""
        links = [part for group in self.groups.values() for part in group]
        return CLEAR + max((_width(_label(part)) for part in links), default=0.0)

    @cached_property
    def half_width(self) -> float:
        """Half of the widest group or body, with its labels."""
        widest = max((self.offsets(group)[-1] for group in self.groups.values()), default=0.0)
        return max(BODY_WIDTH / 2.0, widest + BREADTH / 2.0 + self.label_reach)

    def offsets(self, group: Group) -> list[float]:
        """Return where the links of a group stand, from its middle; the labels of two links stand on the outside."""
        broad = 2.0 * max(map(_half_breadth, group))
        apart = max(2.1 * BREADTH, broad + 2.0 * CLEAR) if len(group) < 3 else broad + CLEAR + self.label_reach
        return [(i - (len(group) - 1) / 2.0) * apart for i in range(len(group))]

    @cached_property
    def x(self) -> dict[str, float]:
        """The middle of each node: above the nodes that carry it, and never too near its neighbours in the level."""
        x = {GROUND: 0.0}
        for level in range(1, max(self.level.values()) + 1):
            row = [node for node in self.nodes if self.level[node] == level]
            wish = {node: fmean([x[other] for other in self.lower(node)] or [0.0]) for node in row}
            row.sort(key=wish.__getitem__)
            x |= zip(row, _spread([wish[node] for node in row], 2.0 * self.half_width + LINK), strict=True)
        return x

    @cached_property
    def height(self) -> dict[str, float]:
        """The height of each node: that of its body, or zero."""
        return {node: BODY_HEIGHT if self.bodies(node) else 0.0 for node in [GROUND, *self.nodes]}

    @cached_property
    def y(self) -> dict[str, float]:
        """The middle of each node."""
        y, top = {GROUND: 0.0}, 0.0
        for level in range(1, max(self.level.values()) + 1):
            row = [node for node in self.nodes if self.level[node] == level]
            thick = max(self.height[node] for node in row)
            y |= dict.fromkeys(row, top + LINK + thick / 2.0)
            top += LINK + thick
        return y

    def bodies(self, node: str) -> list[Mass]:
        """Return the masses at a node."""
        return [part for part in self.parts if isinstance(part, Mass) and part.node == node]

    def loads(self, node: str) -> list[Element]:
        """Return what acts on a node alone and is no mass."""
        return [part for part in self.parts if part.nodes == (node,) and not isinstance(part, Mass)]

    def joint(self, one: str, other: str) -> float:
        """Return the x at which a group stands between two levels: over the node that has no choice."""
        upper, lower = (one, other) if self.level[one] > self.level[other] else (other, one)
        return self.x[lower] if len(self.lower(upper)) > 1 and lower != GROUND else self.x[upper]

    def load_places(self, node: str) -> list[float]:
        """Return the x of each load of a node: in its middle, or left of what stands on it."""
        above = [
            self.joint(node, other) + self.offsets(self.groups[frozenset((node, other))])[0]
            for other in self.upper(node)
        ]
        first = min(above) - BREADTH if above else self.x[node]
        return [first - i * (BREADTH + self.label_reach) for i in range(len(self.loads(node)))]

    def span(self, node: str) -> tuple[float, float]:
        """Return from where to where a node reaches, as a body or as a rigid bar."""
        x = [self.x[node], *self.load_places(node)]
        for other in [*self.lower(node), *self.upper(node)]:
            joint = self.joint(node, other)
            x += [joint + offset for offset in self.offsets(self.groups[frozenset((node, other))])]
        half = BODY_WIDTH / 2.0 if self.bodies(node) else 0.0
        margin = CLEAR if half else 0.0
        return min(self.x[node] - half, min(x) - margin), max(self.x[node] + half, max(x) + margin)

    def ends(self, group: Group) -> list[tuple[Array, Array]]:
        """Return for each link of a group the points of its first and of its last node."""
        one, other = group[0].nodes[0], group[0].nodes[-1]
        offsets = self.offsets(group)
        if self.level[one] == self.level[other]:
            left, right = sorted((one, other), key=self.x.__getitem__)
            inset = STUB if len(group) > 1 else 0.0
            points = {left: self.span(left)[1] + inset, right: self.span(right)[0] - inset}
            found = {node: [np.array([x, self.y[node] + offset]) for offset in offsets] for node, x in points.items()}
        else:
            joint = self.joint(one, other)
            side = 0.5 if self.level[one] > self.level[other] else -0.5
            heights = {one: self.y[one] - side * self.height[one], other: self.y[other] + side * self.height[other]}
            found = {node: [np.array([joint + offset, y]) for offset in offsets] for node, y in heights.items()}
        return [(found[part.nodes[0]][i], found[part.nodes[-1]][i]) for i, part in enumerate(group)]


@overload
def draw_scheme(scheme: Scheme, ax: None = None, *, title: str | None = None, coordinates: bool = True) -> Figure: ...
@overload
def draw_scheme(scheme: Scheme, ax: Axes, *, title: str | None = None, coordinates: bool = True) -> Axes: ...
@style()
def draw_scheme(
    scheme: Scheme, ax: Axes | None = None, *, title: str | None = None, coordinates: bool = True
) -> Figure | Axes:
    """Draw a scheme upright, with the ground at its foot.

    Parameters
    ----------
    scheme : Scheme
        Any scheme.
    ax : Axes, optional
        Where to draw; without it a figure of the right size is made.
    title : str, optional
        Stands above.
    coordinates : bool
        Whether to draw the arrows of the coordinates, positive downwards.

    Returns
    -------
    Figure or Axes
        The new figure, or ``ax``.

    Raises
    ------
    InputError
        If the scheme has no elements.

    Examples
    --------
    >>> from lcpimpact import load_problem
    >>> figure = draw_scheme(load_problem("system-1").scheme)
    >>> sorted(text.get_text() for text in figure.axes[0].texts)
    ['$R$', '$R$', '$c_o$', '$k_o$', '$m$', '$mg$', '$x$', '$z$']
    """
    if not scheme.elements:
        raise InputError("a scheme without elements cannot be drawn: add a Mass, Spring, Dashpot, Bumper, Load, ...")
    figure = Figure(layout="constrained") if ax is None else None
    if figure is not None:
        ax = figure.add_subplot()
    assert ax is not None
    layout = Layout(tuple(part for element in scheme.elements for part in element.parts()))
    if any(GROUND in ends for ends in layout.groups):
        _draw_ground(ax, *layout.span(GROUND))
    for group in layout.groups.values():
        _draw_group(ax, group, layout.ends(group))
    for node in layout.nodes:
        _draw_node(ax, layout, node)
        if coordinates:
            _draw_coordinate(ax, layout, node)
    width, height = _frame(ax)
    if title is not None:
        ax.set_title(title, loc="center", fontsize=11.0)
    if figure is None:
        return ax
    # A title is about 0.09 in a letter wide, and a line of it 0.35 in high.
    figure.set_size_inches(max(width * INCH, 0.09 * len(title or "")), height * INCH + (0.35 if title else 0.0))
    return figure


def _label(part: Element) -> str:
    return ", ".join(math_text(symbol) for symbol in part.symbols)


def _half_breadth(link: Element) -> float:
    return BREADTH * max((abs(t) for stroke in link.strokes for _, t in stroke), default=0.0)


def _width(text: str) -> float:
    return LETTER * len(text.translate(str.maketrans("", "", "$_{}\\")))


def _spread(wish: Sequence[float], pitch: float) -> list[float]:
    """Return the places nearest (least squares) to those wished for, which ascend, a pitch or more apart."""
    blocks: list[list[float]] = []
    for i, x in enumerate(wish):
        blocks.append([x - i * pitch])
        while len(blocks) > 1 and fmean(blocks[-2]) > fmean(blocks[-1]):
            blocks[-2:] = [blocks[-2] + blocks[-1]]
    shifted = [fmean(block) for block in blocks for _ in block]
    return [x + i * pitch for i, x in enumerate(shifted)]


def _draw_strokes(ax: Axes, part: Element, origin: Array, along: Array, across: Array) -> None:
    """Draw an element's strokes: (s, t) in its frame goes to origin + s along + t across; fill those that are closed."""
    body = len(part.nodes) > 1 or isinstance(part, Mass)
    color, inside, width = (INK, FAINT, 1.5) if body else (FORCE, FORCE, 1.1)
    for stroke in part.strokes:
        points = origin + np.asarray(stroke) @ np.array([along, across])
        ax.plot(
            *points.T,
            color=color,
            linewidth=width,
            linestyle="-",
            solid_joinstyle="miter",
            solid_capstyle="round",
            label=f"{part} {_label(part)}",
            zorder=3.0,
        )
        if stroke[0] == stroke[-1]:
            ax.fill(*points.T, facecolor=inside, edgecolor="none", zorder=2.5)


def _write(ax: Axes, text: str, point: Array, side: Array, color: str = INK) -> None:
    """Write beside a point, on the side where the vector points."""
    ha = "left" if side[0] > 0.5 else "right" if side[0] < -0.5 else "center"
    va = "bottom" if side[1] > 0.5 else "top" if side[1] < -0.5 else "center_baseline"
    x, y = point + CLEAR * side
    ax.text(x, y, text, ha=ha, va=va, fontsize=13.0, color=color)


def _draw_group(ax: Axes, group: Group, ends: Sequence[tuple[Array, Array]]) -> None:
    if len(group) > 1 and ends[0][0][1] == ends[0][1][1]:
        _draw_side_bars(ax, np.array(ends))
    for i, (part, (start, end)) in enumerate(zip(group, ends, strict=True)):
        along = end - start
        across = np.array([-along[1], along[0]]) / np.hypot(*along)
        # Across points to the right of a link that runs down; of two or more links the first has its label on the left.
        outwards = (-1.0 if i == 0 and len(group) > 1 else 1.0) * np.sign(across.sum()) * across
        _draw_strokes(ax, part, start, along, BREADTH * across)
        if isinstance(part, Bumper):
            _draw_reaction(ax, part, start, along, outwards)
        else:
            _write(ax, _label(part), start + 0.5 * along + _half_breadth(part) * outwards, outwards)


def _draw_side_bars(ax: Axes, ends: Array) -> None:
    """Join links that run sideways, with ends (links, 2, 2), by a rigid bar at each side, and the bars to their nodes."""
    heights = ends[:, 0, 1]
    for x, outwards in ((ends[..., 0].min(), -STUB), (ends[..., 0].max(), STUB)):
        middle = heights.mean()
        for line in ([[x, x], [heights.min(), heights.max()]], [[x, x + outwards], [middle, middle]]):
            ax.plot(*line, color=INK, linewidth=2.2, linestyle="-", solid_capstyle="round", zorder=2.0)


def _draw_reaction(ax: Axes, bumper: Bumper, start: Array, along: Array, outwards: Array) -> None:
    """Draw R where it acts: on the upper plate upwards, on the lower plate downwards."""
    for tail, tip in ((0.41, 0.14), (0.59, 0.86)):
        foot = start + 0.55 * BREADTH * outwards
        _arrow(ax, foot + tail * along, foot + tip * along, FORCE)
        _write(ax, _label(bumper), foot + 0.5 * (tail + tip) * along, outwards, FORCE)


def _arrow(ax: Axes, tail: Array, tip: Array, color: str) -> None:
    along = (tip - tail) / np.hypot(*(tip - tail))
    across = np.array([-along[1], along[0]])
    base = tip - 0.2 * along
    ax.plot(*np.array([tail, base]).T, color=color, linewidth=1.3, linestyle="-", solid_capstyle="butt", zorder=3.0)
    ax.fill(*np.array([tip, base + 0.08 * across, base - 0.08 * across]).T, color=color, linewidth=0.0, zorder=3.0)


def _draw_node(ax: Axes, layout: Layout, node: str) -> None:
    x, y = layout.x[node], layout.y[node]
    left, right = layout.span(node)
    bodies = layout.bodies(node)
    middle, down = np.array([(left + right) / 2.0, y]), np.array([0.0, -1.0])
    for body in bodies:
        _draw_strokes(ax, body, middle, BODY_HEIGHT * down, np.array([right - left, 0.0]))
    if bodies:
        ax.text(
            middle[0],
            middle[1],
            " + ".join(map(_label, bodies)),
            ha="center",
            va="center_baseline",
            fontsize=14.0,
            color=INK,
        )
    else:
        ax.plot([left, right], [y, y], color=INK, linewidth=2.2, linestyle="-", solid_capstyle="round", zorder=3.0)
        ax.plot([x], [y], "o", color=INK, markersize=4.5, zorder=4.0)
    side = np.array([-1.0 if layout.upper(node) else 1.0, 0.0])
    for load, place in zip(layout.loads(node), layout.load_places(node), strict=True):
        point = np.array([place, y + layout.height[node] / 2.0 + 0.08])
        _draw_strokes(ax, load, point, ARROW * down, np.array([ARROW, 0.0]))
        _write(ax, _label(load), point - 0.3 * ARROW * down, side, FORCE)


def _draw_coordinate(ax: Axes, layout: Layout, node: str) -> None:
    """Draw a coordinate's arrow beside its column, and the thin line that says where it is measured."""
    sideways = [other for other in layout.neighbours(node) if layout.level[other] == layout.level[node]]
    # On the right, unless a link leaves there and none on the left.
    side = -1.0 if sideways and min(layout.x[other] for other in sideways) > layout.x[node] else 1.0
    edge = layout.span(node)[1 if side > 0.0 else 0]
    column = layout.x[node] + side * layout.half_width
    x = (max if side > 0.0 else min)(edge, column) + 2.0 * side * CLEAR
    y = layout.y[node]
    ax.plot([edge + side * CLEAR, x + side * CLEAR], [y, y], color=COORDINATE, linewidth=0.7, linestyle="-", zorder=2.0)
    _arrow(ax, np.array([x, y]), np.array([x, y - 0.75]), COORDINATE)
    _write(ax, math_text(node), np.array([x, y - 0.5]), np.array([side, 0.0]), COORDINATE)


def _draw_ground(ax: Axes, left: float, right: float) -> None:
    left, right, deep = left - 0.8, right + 0.8, 0.35
    ax.plot([left, right], [0.0, 0.0], color=INK, linewidth=2.2, linestyle="-", solid_capstyle="butt", zorder=3.0)
    feet = np.arange(left, right - deep, 0.28)
    hatch = np.array([(x, y) for foot in feet for x, y in ((foot, -deep), (foot + deep, 0.0), (np.nan, np.nan))])
    ax.plot(*hatch.T, color=SOFT, linewidth=0.8, linestyle="-", zorder=2.0)


def _frame(ax: Axes) -> tuple[float, float]:
    """Fit the axes around all that was drawn, equal in both directions; return their width and height."""
    x, y = [ax.dataLim.x0, ax.dataLim.x1], [ax.dataLim.y0, ax.dataLim.y1]
    for text in ax.texts:
        place, width = text.get_position(), _width(text.get_text())
        shift = {"left": 0.0, "center": 0.5, "right": 1.0}[text.get_horizontalalignment()]
        x += [place[0] - shift * width, place[0] + (1.0 - shift) * width]
        y += [place[1] - 0.5, place[1] + 0.5]
    margin = 0.3
    ax.set(xlim=(min(x) - margin, max(x) + margin), ylim=(min(y) - margin, max(y) + margin), aspect="equal")
    ax.set_axis_off()
    return max(x) - min(x) + 2.0 * margin, max(y) - min(y) + 2.0 * margin
