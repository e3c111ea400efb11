"""Drawings of schemes with standard engineering symbols, built from the strokes of the elements."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from itertools import chain
from typing import overload

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Polygon
from matplotlib.text import Text

from lcpimpact.arrays import Array
from lcpimpact.errors import InputError
from lcpimpact.plotting.block_diagram import draw_system
from lcpimpact.plotting.layout import (
    CEILING,
    CLEARANCE,
    COORDINATE_LENGTH,
    LINK_HEIGHT,
    LOAD_HEIGHT,
    SYMBOL_WIDTH,
    Layout,
    PlacedLink,
    half_breadth,
    label,
    width,
)
from lcpimpact.plotting.style import GREY, INK, LIGHT_GREY, PALETTE, Drawing, style
from lcpimpact.plotting.timeline import math_text
from lcpimpact.scheme.bodies import has_bodies
from lcpimpact.scheme.elements.bar import Bar
from lcpimpact.scheme.elements.base import GROUND, Element
from lcpimpact.scheme.elements.bumper import Bumper
from lcpimpact.scheme.elements.compliant import CompliantContact
from lcpimpact.scheme.elements.mass import Mass
from lcpimpact.scheme.elements.rope import Rope
from lcpimpact.scheme.lagrangian import Lagrangian
from lcpimpact.scheme.scheme import Scheme
from lcpimpact.scheme.system import LinearComplementaritySystem

INCH = 0.42
"""Inches per layout unit, for drawings up to `MAX_HEIGHT`."""

MAX_HEIGHT = 9.0
"""Height in inches above which a drawing is scaled down."""

MAX_WIDTH = 10.0
"""Width in inches above which a drawing is scaled down."""

FORCE_COLOR, MOTION_COLOR = PALETTE[1], PALETTE[0]

DOWN = np.array([0.0, -1.0])
RIGHT = np.array([1.0, 0.0])

CAGE: tuple[tuple[tuple[float, float], ...], ...] = (
    ((0.0, 0.0), (0.62, 0.0)),
    ((0.62, -0.55), (0.62, 0.55)),
    ((0.5, -0.2), (0.5, -0.8), (0.8, -0.8), (0.8, 0.8), (0.5, 0.8), (0.5, 0.2)),
    ((0.8, 0.0), (1.0, 0.0)),
)
"""Strokes of a bumper whose upper plate hangs from the node below: a head behind the lips of a cage."""


@dataclass(frozen=True, eq=False)
class Stroke:
    """A line of the drawing, optionally filled."""

    points: Array
    color: str
    width: float
    label: str = "_"
    fill: str | None = None
    cap: str = "round"
    zorder: float = 3.0


@dataclass(frozen=True, eq=False)
class Label:
    """A text of the drawing; ``side`` is its direction from its anchor point."""

    text: str
    point: Array
    side: Array
    color: str = INK
    size: float = 13.0

    @property
    def place(self) -> Array:
        """Position of the text."""
        return self.point + CLEARANCE * self.side


Piece = Stroke | Label

Painted = tuple[Line2D | None, Polygon | None] | Text
"""The artists of a piece: its line and its area, or its text."""


@dataclass(frozen=True, eq=False)
class Posture:
    """The moving quantities of a drawing.

    Attributes
    ----------
    y : mapping of str to float             height of each node
    pressed : mapping of str to float       relative force of each bumper, from 0 to 1
    down : mapping of str to float          downward displacement of each node, inner nodes of bars included
    """

    y: Mapping[str, float]
    pressed: Mapping[str, float] = field(default_factory=dict)
    down: Mapping[str, float] = field(default_factory=dict)


@overload
def draw_scheme(
    scheme: Scheme | LinearComplementaritySystem | Lagrangian,
    ax: None = None,
    *,
    title: str | None = None,
    coordinates: bool = True,
) -> Figure: ...
@overload
def draw_scheme(
    scheme: Scheme | LinearComplementaritySystem | Lagrangian,
    ax: Axes,
    *,
    title: str | None = None,
    coordinates: bool = True,
) -> Axes: ...
@style()
def draw_scheme(
    scheme: Scheme | LinearComplementaritySystem | Lagrangian,
    ax: Axes | None = None,
    *,
    title: str | None = None,
    coordinates: bool = True,
) -> Figure | Axes:
    """Draw a scheme above the ground, or a system given by its matrices as a block diagram.

    Parameters
    ----------
    scheme : Scheme or LinearComplementaritySystem
        Any.
    ax : Axes, optional
        Axes to draw in; by default a new figure of suitable size.
    title : str, optional
        Title above the drawing.
    coordinates : bool
        Whether to draw the coordinate arrows, positive downwards.

    Returns
    -------
    Figure or Axes
        The new figure, or ``ax``.

    Raises
    ------
    InputError
        If the scheme has no elements, as a Lagrangian system, or has bodies.

    Examples
    --------
    >>> from lcpimpact import load_problem
    >>> figure = draw_scheme(load_problem("system-1").scheme)
    >>> sorted(text.get_text() for text in figure.axes[0].texts)
    ['$R$', '$R$', '$c_o$', '$k_o$', '$m$', '$mg$', '$x$', '$z$']
    """
    if isinstance(scheme, Scheme) and has_bodies(scheme.elements):
        raise InputError(
            "bodies in the plane have no drawing among symbols along a line: plot or animate a run of them"
        )
    if isinstance(scheme, Lagrangian):
        raise InputError(
            "a Lagrangian system has no drawing: it is given by functions, and not by elements; plot a run of it"
        )
    figure = Drawing(layout="constrained") if ax is None else None
    panel = ax if figure is None else figure.add_subplot()
    assert panel is not None
    if isinstance(scheme, LinearComplementaritySystem):
        pieces_width, pieces_height = draw_system(panel, scheme)
    else:
        if not scheme.elements:
            raise InputError(
                "a scheme without elements cannot be drawn: add a Mass, Spring, Dashpot, Bumper, Load, ..."
            )
        layout = Layout(scheme.elements)
        pieces = list(picture(layout, at_rest(layout), coordinates=coordinates))
        left, right, low, high = extent(pieces)
        pieces_width, pieces_height = right - left, high - low
        size = (
            1.0 if figure is None else min(1.0, MAX_HEIGHT / (pieces_height * INCH), MAX_WIDTH / (pieces_width * INCH))
        )
        paint(panel, pieces, size)
        panel.set(xlim=(left, right), ylim=(low, high), aspect="equal")
        panel.set_axis_off()
        pieces_width = pieces_width * size
        pieces_height = pieces_height * size
    if title is not None:
        panel.set_title(title, loc="center", fontsize=11.0)
    if figure is None:
        return panel
    # A title is about 0.09 in a letter wide, and a line of it 0.35 in high.
    figure.set_size_inches(
        max(pieces_width * INCH, 0.09 * len(title or "")), pieces_height * INCH + (0.35 if title else 0.0)
    )
    return figure


def at_rest(layout: Layout) -> Posture:
    """Return the posture of a static drawing: open bumpers, with reactions as full arrows."""
    return Posture(layout.y)


def picture(layout: Layout, posture: Posture, *, coordinates: bool = True) -> Iterator[Piece]:
    """Yield all pieces of a drawing, in the same order for every posture."""
    y = posture.y
    if layout.grounded:
        yield from _ground(*layout.span(GROUND), y[GROUND], reach=0.8)
    if layout.hung:
        yield from _ground(*layout.span(CEILING), y[CEILING], reach=0.8, above=True)
    for link in layout.links:
        yield from _link(layout, link, posture)
    for node, (left, right) in layout.inner_bars.items():
        yield from _bar(left, right, y[node])
    for node in layout.nodes:
        yield from _node(layout, node, y)
        if coordinates:
            yield from _coordinate(layout, node, y[node])


def paint(ax: Axes, pieces: list[Piece], size: float = 1.0) -> list[Painted]:
    """Draw the pieces with a relative size of letters and lines; return the artists of each."""
    return [_paint_line(ax, p, size) if isinstance(p, Stroke) else _paint_words(ax, p, size) for p in pieces]


def extent(pieces: list[Piece]) -> tuple[float, float, float, float]:
    """Return left, right, bottom and top of all pieces, with a margin."""
    x: list[float] = []
    y: list[float] = []
    for piece in pieces:
        if isinstance(piece, Stroke):
            shown = piece.points[np.isfinite(piece.points).all(axis=1)]
            x += shown[:, 0].tolist()
            y += shown[:, 1].tolist()
        else:
            place, long = piece.place, width(piece.text)
            shift = 0.5 - 0.5 * np.round(piece.side[0])
            x += [place[0] - shift * long, place[0] + (1.0 - shift) * long]
            y += [place[1] - 0.5, place[1] + 0.5]
    margin = 0.3
    return min(x) - margin, max(x) + margin, min(y) - margin, max(y) + margin


def _paint_line(ax: Axes, line: Stroke, size: float) -> tuple[Line2D | None, Polygon | None]:
    drawn = None
    if line.width:
        (drawn,) = ax.plot(
            *line.points.T,
            color=line.color,
            linewidth=line.width * size,
            linestyle="-",
            solid_joinstyle="miter",
            solid_capstyle=line.cap,
            label=line.label,
            zorder=line.zorder,
        )
    filled = None
    if line.fill is not None:
        (filled,) = ax.fill(
            *line.points.T,
            facecolor=line.fill,
            edgecolor="none",
            linestyle="-",
            linewidth=0.0,
            zorder=line.zorder - 0.5,
        )
    return drawn, filled


def _paint_words(ax: Axes, words: Label, size: float) -> Text:
    ha = "left" if words.side[0] > 0.5 else "right" if words.side[0] < -0.5 else "center"
    x, y = words.place
    return ax.text(
        x, y, words.text, ha=ha, va="center_baseline", fontsize=words.size * size, color=words.color, zorder=5.0
    )


def _ground(left: float, right: float, y: float, *, reach: float, above: bool = False) -> Iterator[Stroke]:
    return hatched(np.array([[left - reach, y], [right + reach, y]]), above=above)


def hatched(points: Array, *, above: bool = False, deep: float = 0.35) -> Iterator[Stroke]:
    """Yield the surface of the ground along points (n, 2), hatched on the right of the way, or above on its left."""
    steps = np.diff(points, axis=0)
    s = np.append(0.0, np.cumsum(np.hypot(*steps.T)))
    feet = np.arange(0.0, s[-1] - deep + 1e-9, 0.28)
    begin, end = (np.column_stack([np.interp(each, s, x) for x in points.T]) for each in (feet, feet + deep))
    along = (steps / np.diff(s)[:, None])[np.searchsorted(s, feet, side="right") - 1]
    right = deep * np.column_stack([along[:, 1], -along[:, 0]])
    ends = (begin, end - right) if above else (begin + right, end)
    yield Stroke(points, INK, 2.2, cap="butt")
    hatch = np.stack([*ends, np.full_like(begin, np.nan)], axis=1).reshape(-1, 2)
    yield Stroke(hatch, GREY, 0.8, zorder=2.0)


def _bar(left: float, right: float, y: float) -> Iterator[Stroke]:
    yield Stroke(np.array([[left, y], [right, y]]), INK, 2.2)


def arrow(tail: Array, tip: Array, color: str) -> Iterator[Stroke]:
    """Yield a shaft and a head, or nothing for an arrow hardly longer than wide."""
    length = float(np.hypot(*(tip - tail)))
    if length < 0.08:
        yield Stroke(np.full((2, 2), np.nan), color, 1.3, cap="butt")
        yield Stroke(np.full((4, 2), np.nan), color, 0.0, fill=color, zorder=3.5)
        return
    along = (tip - tail) / length
    across = np.array([-along[1], along[0]])
    head_size = min(0.2, 0.7 * length)
    base = tip - head_size * along
    yield Stroke(np.array([tail, base]), color, 1.3, cap="butt")
    head = np.array([tip, base + 0.4 * head_size * across, base - 0.4 * head_size * across, tip])
    yield Stroke(head, color, 0.0, fill=color, zorder=3.5)


def _strokes(part: Element, places: list[Array]) -> Iterator[Stroke]:
    """Yield the positioned strokes of an element; closed ones are filled."""
    body = len(part.nodes) > 1 or isinstance(part, Mass)
    color, inside, wide = (INK, LIGHT_GREY, 1.5) if body else (FORCE_COLOR, FORCE_COLOR, 1.1)
    for points in places:
        closed = len(points) > 3 and bool((points[0] == points[-1]).all())
        yield Stroke(points, color, wide, f"{part} {label(part)}", inside if closed else None)


def _link(layout: Layout, link: PlacedLink, posture: Posture, *, cage_split: float = 0.62) -> Iterator[Piece]:
    part = link.part
    top = layout.edge(posture.y, link.top, -1)
    bottom = layout.edge(posture.y, link.bottom, 1)
    length, down = top - bottom, link.down
    cage = isinstance(part, Bumper) and not down
    first = np.array([link.x, top if down or cage else bottom])
    along = DOWN if down or cage else -DOWN
    # The right side of a link stays on the right for either orientation.
    split = cage_split if cage else part.split
    placed = []
    for stroke in CAGE if cage else part.strokes:
        s, t = np.array(stroke, dtype=np.float64).T
        place = _within(s, link, layout, posture) if isinstance(part, Bar) and posture.down else None
        if place is None:
            place = _along(s, link, length, split)
        placed.append(first + np.outer(place, along) + np.outer(SYMBOL_WIDTH * _sag(t, link, length, layout), RIGHT))
    yield from _strokes(part, placed)
    side = np.array([float(link.side), 0.0])
    if not isinstance(part, Bumper):
        # Beside the symbol, which may be off the middle of the link.
        wide = [y for points in placed for x, y in points.tolist() if abs(x - link.x) > 1e-9]
        middle = (min(wide) + max(wide)) / 2.0 if wide else (top + bottom) / 2.0
        yield Label(label(part), np.array([link.x, middle]) + half_breadth(part) * side, side)
        return
    # R acts on the upper plate upwards and on the lower plate downwards; a cage has both between its plates.
    plates = sorted({float(line[0, 1]) for line in placed if abs(line[0, 1] - line[-1, 1]) < 1e-9 and len(line) == 2})
    pressed = posture.pressed.get(part.name or part.reaction, 1.0)
    yield from _reaction(link, (plates[0] + plates[-1]) / 2.0, pressed, side, cage)


def _along(s: Array, link: PlacedLink, length: float, split: float | None) -> Array:
    """Return the distance of each point of a stroke from the first end of its link."""
    first, last = link.leads
    body = link.body
    if split is None:
        body = length - first - last
    elif isinstance(link.part, CompliantContact):
        body = min(body, length - first - last)
    place = first + s * body
    if split is not None and s.max() > split:
        place = length - last - (1.0 - s) * body - np.where(s < split, link.extra, 0.0)
    return np.where(s == 0.0, 0.0, np.where(s == 1.0, length, place))


def _within(s: Array, link: PlacedLink, layout: Layout, posture: Posture) -> Array:
    """Return the distance of points of a bar from its first end, interpolated between its inner nodes."""
    assert isinstance(link.part, Bar)
    rest = _along(s, link, layout.edge(layout.y, link.top, -1) - layout.edge(layout.y, link.bottom, 1), None)
    block = [s for s, t in chain.from_iterable(link.part.strokes) if t]
    down = np.array([posture.down[node] for node in link.part.joints]) - posture.down[link.part.a]
    moved = np.interp(s, np.linspace(min(block), max(block), len(down)), down)
    return np.asarray(rest + (moved if link.down else -moved))


def _sag(t: Array, link: PlacedLink, length: float, layout: Layout) -> Array:
    """Return the lateral offset of the points of a stroke: a rope straightens until it is taut."""
    if not isinstance(link.part, Rope) or not layout.scale:
        return t
    rest = layout.edge(layout.y, link.top, -1) - layout.edge(layout.y, link.bottom, 1)
    slack = layout.scale * link.part.slack - (length - rest)
    return np.asarray(t * min(1.5, np.sqrt(max(slack, 0.0) / LINK_HEIGHT) * 2.0))


def _reaction(link: PlacedLink, middle: float, pressed: float, side: Array, cage: bool) -> Iterator[Piece]:
    foot = np.array([link.x, middle]) + (half_breadth(link.part) if cage else 0.55 * SYMBOL_WIDTH) * side
    for direction in (-DOWN, DOWN):
        tail = foot + 0.09 * LINK_HEIGHT * direction
        tip = tail + 0.27 * LINK_HEIGHT * pressed * direction
        yield from arrow(tail, tip, FORCE_COLOR)
        at = tail + 0.135 * LINK_HEIGHT * direction
        yield Label(label(link.part) if pressed else "", at, side, FORCE_COLOR)


def _node(layout: Layout, node: str, y: Mapping[str, float]) -> Iterator[Piece]:
    left, right = layout.span(node)
    bodies = layout.bodies(node)
    middle = np.array([(left + right) / 2.0, y[node]])
    for body in bodies:
        frame = np.array([layout.thickness(node) * DOWN, (right - left) * RIGHT])
        yield from _strokes(body, [middle + np.asarray(stroke) @ frame for stroke in body.strokes])
    if bodies:
        yield Label(" + ".join(map(label, bodies)), middle, np.zeros(2), size=14.0)
    elif not layout.motions(node):
        yield from _bar(left, right, y[node])
        if left == right:
            yield Stroke(dot(middle), INK, 0.0, fill=INK, zorder=4.5)
    for motion in layout.motions(node):
        below = any(arm.top == node for arm in layout.arms)
        yield from _ground(left, right, y[node], reach=0.0, above=below)
        foot = np.array([left - 0.4, y[node]])
        for direction in (DOWN, -DOWN):
            yield from arrow(foot, foot + 0.55 * direction, MOTION_COLOR)
        text = label(motion)
        yield Label(f"{text[:-1]}(t)$" if text.endswith("$") else text, foot, -RIGHT, MOTION_COLOR)
    top = layout.edge(y, node, 1)
    for load in layout.loads(node):
        x, side = layout.load_place(load)
        tip = np.array([x, top + 0.08])
        # In a load's frame its arrow has half of the unit's length.
        frame = 2.0 * LOAD_HEIGHT * np.array([DOWN, RIGHT])
        yield from _strokes(load, [tip + np.asarray(stroke) @ frame for stroke in load.strokes])
        yield Label(label(load), tip - 0.6 * LOAD_HEIGHT * DOWN, side * RIGHT, FORCE_COLOR)


def dot(middle: Array, radius: float = 0.09) -> Array:
    """Return the outline of a small disc."""
    angle = np.linspace(0.0, 2.0 * np.pi, 17)
    return middle + radius * np.column_stack([np.cos(angle), np.sin(angle)])


def _coordinate(layout: Layout, node: str, y: float) -> Iterator[Piece]:
    """Yield a coordinate's arrow, and the thin line to the node whose displacement it measures."""
    x, side = layout.coordinate_places[node]
    edge = layout.span(node)[1 if side > 0 else 0]
    ends = np.array([[edge + 0.5 * side * CLEARANCE, y], [x + side * CLEARANCE, y]])
    yield Stroke(ends, MOTION_COLOR, 0.7, zorder=2.0)
    yield from arrow(np.array([x, y]), np.array([x, y - COORDINATE_LENGTH]), MOTION_COLOR)
    yield Label(math_text(node), np.array([x, y - 0.45]), side * RIGHT, MOTION_COLOR)


def round_below(value: float) -> float:
    """Return the largest 1, 2 or 5 times a power of ten not above the value."""
    power = 10.0 ** math.floor(math.log10(value))
    return next(digit * power for digit in (5.0, 2.0, 1.0) if digit * power <= value * (1.0 + 1e-12))


def length_text(metres: float) -> str:
    """Return a length as a number and m, mm or µm."""
    for unit, name in ((1.0, "m"), (1e-3, "mm"), (1e-6, "µm")):
        if metres >= 0.99 * unit * (0.1 if unit == 1.0 else 1.0):
            return f"{metres / unit:g} {name}"
    return f"{metres:.0e} m"
