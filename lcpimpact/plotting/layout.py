"""Layout of the elements in the drawing of a scheme.

Nodes are stacked in levels above the ground and every link is vertical, so that a node moves along its links. The elements
between the same two nodes form an arm: links in parallel, in series, or both.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Literal

from lcpimpact.plotting.timeline import math_text
from lcpimpact.scheme.elements import base
from lcpimpact.scheme.elements.bar import Bar
from lcpimpact.scheme.elements.base import GROUND, Element
from lcpimpact.scheme.elements.bumper import Bumper
from lcpimpact.scheme.elements.compliant import CompliantContact
from lcpimpact.scheme.elements.mass import Mass
from lcpimpact.scheme.elements.prescribed_motion import PrescribedMotion
from lcpimpact.scheme.elements.rope import Rope
from lcpimpact.scheme.terms import name_of

CEILING = "\0ceiling"
"""Name of the ground at the top, for elements whose upper end is the ground."""

LINK_HEIGHT = 2.1
"""Height of a link."""

SYMBOL_WIDTH = 0.75
"""Width of a link's symbol."""

BODY_HEIGHT, BODY_WIDTH = 1.1, 2.6

LOAD_HEIGHT = 0.75
"""Height of a load's arrow above its node."""

COORDINATE_LENGTH = 0.75
"""Length of a coordinate's arrow below its node."""

CLEARANCE = 0.2
"""Distance between a symbol and its label."""

ROW_SPACING = 1.15
"""Distance between two unlinked rows of nodes."""

CROSSING_COST = 6.0
"""Cost of a bar that crosses a link, in units of length of a detour."""

Side = Literal[-1, 1]


def label(part: Element) -> str:
    """Return the label of an element: its symbols; a reaction without a symbol of its own goes by its name."""
    symbols = part.labels
    if part.reaction and symbols == (part.reaction,) and (name := getattr(part, "name", None)):
        symbols = (name,)
    return ", ".join(math_text(symbol) for symbol in symbols)


def width(text: str, *, letter_width: float = 0.29) -> float:
    """Return the approximate width of a text.

    ``letter_width``: approximate width of a letter.
    """
    return letter_width * sum(letter not in "$_{}\\" for letter in text)


def half_breadth(link: Element) -> float:
    """Return the half-width of a link's symbol."""
    return SYMBOL_WIDTH * max((abs(t) for stroke in link.strokes for _, t in stroke), default=0.0)


@dataclass(frozen=True, eq=False)
class Arm:
    """The elements between two nodes: one link, or arms in series or in parallel.

    Attributes
    ----------
    top, bottom : str       the nodes
    link : Element          the element of a single link
    series : tuple of Arm   arms in series, from top to bottom
    beside : tuple of Arm   parallel arms, from left to right
    """

    top: str
    bottom: str
    link: Element | None = None
    series: tuple[Arm, ...] = ()
    beside: tuple[Arm, ...] = ()

    def turned(self) -> Arm:
        """Return the arm upside down."""
        series = tuple(arm.turned() for arm in reversed(self.series))
        return Arm(self.bottom, self.top, self.link, series, tuple(arm.turned() for arm in self.beside))

    def downwards(self, top: str) -> Arm:
        """Return the arm oriented downwards from the node ``top``."""
        return self if self.top == top else self.turned()

    @property
    def links(self) -> list[Element]:
        """All links of the arm."""
        own = [] if self.link is None else [self.link]
        return own + [link for arm in (*self.series, *self.beside) for link in arm.links]


def outer_nodes(part: Element) -> tuple[str, str]:
    """Return the nodes at both ends of an element; a sum of coordinates is a node of its own, by its formula."""
    first, last = part.ends if isinstance(part, base.Link) else (part.nodes[0], part.nodes[-1])
    return name_of(first), name_of(last)


def sums(elements: Sequence[Element]) -> dict[str, Mapping[str, float]]:
    """Return the ends that are sums of coordinates, by the names of their nodes in the drawing."""
    ends = [end for part in elements if isinstance(part, base.Link) for end in part.ends]
    return {name_of(end): end for end in ends if isinstance(end, Mapping)}


def ends(link: Element) -> tuple[str, str]:
    """Return the two nodes joined by a link in the drawing."""
    first, last = outer_nodes(link)
    return (CEILING if first == GROUND and _has_upper_end(link) else first), last


def side_by_side(arms: Sequence[Arm]) -> Arm:
    """Combine arms between the same two nodes in parallel."""
    first = arms[0]
    flat = [each for arm in arms for each in (arm.downwards(first.top).beside or (arm.downwards(first.top),))]
    return flat[0] if len(flat) == 1 else Arm(first.top, first.bottom, beside=tuple(flat))


def in_series(upper: Arm, lower: Arm) -> Arm:
    """Combine two consecutive arms in series."""
    return Arm(upper.top, lower.bottom, series=(*(upper.series or (upper,)), *(lower.series or (lower,))))


def arms_between(elements: Sequence[Element]) -> list[Arm]:
    """Return an arm for each pair of joined nodes, including the inner nodes of elements."""
    inner = [node for element in elements for node in element.inner]
    outer = {node for element in elements for node in outer_nodes(element)}
    arms = [Arm(*ends(p), p) for e in elements for p in e.drawn() if len(p.nodes) > 1]
    while True:
        arms = in_parallel(arms)
        at = {node: [arm for arm in arms if node in (arm.top, arm.bottom)] for node in inner if node not in outer}
        node = next((node for node, here in at.items() if len(here) == 2), None)
        if node is None:
            return arms
        upper, lower = at[node]
        joined = in_series(upper.turned() if upper.top == node else upper, lower.downwards(node))
        arms = [joined if arm is upper else arm for arm in arms if arm is not lower]


def in_parallel(arms: Sequence[Arm]) -> list[Arm]:
    """Combine all arms between the same two nodes."""
    found: list[list[Arm]] = []
    for arm in arms:
        beside = next((each for each in found if {each[0].top, each[0].bottom} == {arm.top, arm.bottom}), None)
        if beside is None:
            found.append([arm])
        else:
            beside.append(arm)
    return [side_by_side(each) for each in found]


@dataclass(frozen=True)
class PlacedLink:
    """A positioned link, vertical between two nodes.

    Attributes
    ----------
    part : Element              the element
    top, bottom : str           the nodes at its ends
    x : float                   horizontal position
    side : 1 or -1              side of its label, right or left
    body : float                height of its symbol
    leads : tuple of float      lengths of the leads from its first and last node to the symbol
    extra : float               extra length of the outer part of a telescoping symbol, which moves with the last node
    """

    part: Element
    top: str
    bottom: str
    x: float
    side: Side
    body: float
    leads: tuple[float, float]
    extra: float

    @property
    def down(self) -> bool:
        """Whether it runs down from its first node."""
        return ends(self.part)[0] == self.top


@dataclass(frozen=True)
class Box:
    """An occupied rectangle of the drawing: range of x, and range of levels."""

    left: float
    right: float
    low: float
    high: float
    owner: str | int | None = None

    def moved(self, x: float) -> Box:
        """Return the box moved to the right."""
        return Box(self.left + x, self.right + x, self.low, self.high, self.owner)

    def overlaps(self, other: Box) -> bool:
        """Return whether two boxes overlap."""
        return (
            min(self.right, other.right) - max(self.left, other.left) > 1e-9
            and min(self.high, other.high) - max(self.low, other.low) > 1e-9
        )


def at_rest(top: str, bottom: str) -> tuple[float, float]:
    """Return the range of the relative motion of two nodes in a drawing without motion."""
    return 0.0, 0.0


@dataclass(frozen=True, eq=False)
class Layout:
    """Positions of all parts of the drawing; y points upwards from the ground at zero.

    Parameters
    ----------
    elements : tuple of Element
        Elements of a scheme.
    travel : mapping of str to (low, high) of relative motion, optional
        Called with two nodes, returns the minimum and maximum displacement of the lower relative to the upper, in drawing
        units; links are sized for it.
    scale : float
        Drawing units per metre of motion; zero for a static drawing.
    """

    elements: tuple[Element, ...]
    travel: Callable[[str, str], tuple[float, float]] = at_rest
    scale: float = 0.0

    # --- contents ------------------------------------------------------------------------------------------------------

    @cached_property
    def parts(self) -> list[Element]:
        """The pieces to draw."""
        return [part for element in self.elements for part in element.drawn()]

    @cached_property
    def undirected_arms(self) -> list[Arm]:
        """The arms, without an orientation."""
        return arms_between(self.elements)

    @cached_property
    def nodes(self) -> list[str]:
        """The nodes in order of first occurrence, without the ground and inner nodes."""
        named = dict.fromkeys(node for part in self.parts for node in outer_nodes(part))
        merged = {node for element in self.elements for node in element.inner} - {
            end for arm in self.undirected_arms for end in (arm.top, arm.bottom)
        }
        named = {node: None for node in named if node not in merged}
        named |= dict.fromkeys(end for arm in self.undirected_arms for end in (arm.top, arm.bottom))
        return [node for node in named if node not in (GROUND, CEILING)]

    def bodies(self, node: str) -> list[Mass]:
        """Return the masses at a node."""
        return [part for part in self.parts if isinstance(part, Mass) and part.node == node]

    def motions(self, node: str) -> list[PrescribedMotion]:
        """Return the prescribed motions of a node."""
        return [part for part in self.parts if isinstance(part, PrescribedMotion) and part.node == node]

    def loads(self, node: str) -> list[Element]:
        """Return the elements on a single node other than masses and prescribed motions."""
        return [p for p in self.parts if p.nodes == (node,) and not isinstance(p, (Mass, PrescribedMotion))]

    # --- vertical order ------------------------------------------------------------------------------------------------

    @cached_property
    def distance(self) -> dict[str, int]:
        """Number of arms from each node to the ground or, if unconnected to it, to a supported node."""
        found: dict[str, int] = {}
        bases = [GROUND]
        while bases:
            found |= dict.fromkeys(bases, 0)
            for node in (reached := list(bases)):
                new = [other for other in self._neighbours(node) if other not in found]
                found |= dict.fromkeys(new, found[node] + 1)
                reached.extend(new)
            free = [node for node in reversed(self.nodes) if node not in found]
            carries = {
                outer_nodes(link)[0] for arm in self.undirected_arms for link in arm.links if _has_upper_end(link)
            }
            bases = sorted(free, key=lambda node: (not self.motions(node), node in carries))[:1]
        return found

    def _neighbours(self, node: str) -> list[str]:
        arms = [
            arm
            for arm in self.undirected_arms
            if node in (arm.top, arm.bottom) and CEILING not in (arm.top, arm.bottom)
        ]
        return [arm.bottom if arm.top == node else arm.top for arm in arms]

    @cached_property
    def arms(self) -> list[Arm]:
        """The arms, each oriented downwards from its upper node; the directed graph has no cycle."""
        rank = {node: (self.distance[node], -i) for i, node in enumerate([GROUND, *self.nodes])}
        rank[CEILING] = (len(rank), 0)
        below: dict[str, list[str]] = {node: [] for node in rank}

        def leads(start: str, end: str) -> bool:
            return start == end or any(leads(other, end) for other in below[start])

        found: dict[int, Arm] = {}

        # An upper plate is placed above the lower one unless the path to the ground decides otherwise.
        def urgency(each: tuple[int, Arm]) -> tuple[bool, bool]:
            fixed = {GROUND, CEILING} & {each[1].top, each[1].bottom}
            return not fixed, not any(map(_has_upper_end, each[1].links))

        for i, arm in sorted(enumerate(self.undirected_arms), key=urgency):
            top = next((ends(link)[0] for link in arm.links if _has_upper_end(link)), None)
            if top is None or {GROUND, CEILING} & {arm.top, arm.bottom}:
                top = arm.top if rank[arm.top] > rank[arm.bottom] else arm.bottom
            if leads(arm.downwards(top).bottom, top):
                top = arm.downwards(top).bottom
            found[i] = arm.downwards(top)
            below[top].append(found[i].bottom)
        return [found[i] for i in sorted(found)]

    @cached_property
    def level(self) -> dict[str, int]:
        """Length of the longest downward path from each node."""
        found = {GROUND: 0}

        def measure(node: str) -> int:
            if node not in found:
                found[node] = 1 + max((measure(arm.bottom) for arm in self.arms if arm.top == node), default=0)
            return found[node]

        for node in self.nodes:
            measure(node)
        return found | {CEILING: 1 + max(found.values())}

    @property
    def grounded(self) -> bool:
        """Whether anything stands on the ground."""
        return any(arm.bottom == GROUND for arm in self.arms)

    @property
    def hung(self) -> bool:
        """Whether anything hangs from the ceiling."""
        return any(arm.top == CEILING for arm in self.arms)

    # --- horizontal positions ------------------------------------------------------------------------------------------

    def reach(self, arm: Arm, side: Side = 1) -> tuple[float, float]:
        """Return the extent of an arm to the left and right of its middle, labels included."""
        if arm.link is not None:
            half = half_breadth(arm.link)
            beside = half + CLEARANCE + width(label(arm.link))
            return (half, beside) if side > 0 else (beside, half)
        if arm.series:
            each = [self.reach(piece, side) for piece in arm.series]
            return max(left for left, _ in each), max(right for _, right in each)
        offsets = self.offsets(arm)
        first = self.reach(arm.beside[0], -1)
        last = self.reach(arm.beside[-1], 1)
        return first[0] - offsets[0], offsets[-1] + last[1]

    def offsets(self, arm: Arm) -> list[float]:
        """Return the offsets of parallel arms from their common middle; the first has its labels on the left."""
        reaches = [self.reach(each, -1 if i == 0 else 1) for i, each in enumerate(arm.beside)]
        x = [0.0]
        for (_, right), (left, _) in pairwise(reaches):
            x.append(x[-1] + max(2.1 * SYMBOL_WIDTH, right + left + 2.0 * CLEARANCE))
        return [each - x[-1] / 2.0 for each in x]

    def feet(self, arm: Arm, x: float, end: str) -> list[float]:
        """Return every x at which an arm with its middle at ``x`` joins the node at one of its ends."""
        if arm.series:
            return self.feet(arm.series[0 if end == arm.top else -1], x, end)
        if arm.beside:
            pairs = zip(arm.beside, self.offsets(arm), strict=True)
            return [foot for each, offset in pairs for foot in self.feet(each, x + offset, end)]
        return [x]

    @cached_property
    def _across(self) -> tuple[dict[int, float], dict[str, list[float]], dict[int, tuple[float, Side]]]:
        """Middle of each arm, extent of each node, and position and label side of each load."""
        occupied: list[Box] = []
        middle, extents = self._place_arms(occupied)
        return middle, extents, self._place_loads(middle, extents, occupied)

    def _place_arms(self, occupied: list[Box]) -> tuple[dict[int, float], dict[str, list[float]]]:
        """Return the middle of each arm and the required extent of each node; append to the occupied boxes."""
        middle: dict[int, float] = {}
        extents: dict[str, list[float]] = {}

        def place(node: str, x: float) -> None:
            if node not in extents:
                half = self._half(node)
                extents[node] = [x - half, x + half] if half else [x]
                occupied.append(self._node_box(node, x, (0.0, 0.0)))

        order = sorted(range(len(self.arms)), key=lambda i: (self.level[self.arms[i].bottom], i))
        hanging = {arm.bottom for arm in self.arms if arm.top == CEILING}
        free = [node for node in self.nodes if node not in hanging and not any(arm.top == node for arm in self.arms)]
        for node in free:
            if self.level[node] == 1 and not self.grounded and not extents:
                place(node, 0.0)
            else:
                x = self._place(0.0, [self._node_box(node, 0.0, (0.0, 0.0))], occupied, {}, [])
                place(node, x)
        for i in order:
            arm = self.arms[i]
            top, bottom = arm.top, arm.bottom
            left, right = self.reach(arm)
            boxes = [Box(-left, right, self.level[bottom] + 0.25, self.level[top] - 0.25, i)]
            boxes += [
                self._node_box(node, 0.0, (left, right))
                for node in (top, bottom)
                if node not in extents and node not in (GROUND, CEILING)
            ]
            own = [node for node in (top, bottom) if node not in (GROUND, CEILING)]
            # A node is extended to a bar below the feet of its arms.
            for node in own:
                first, last = _span(self.feet(arm, 0.0, node))
                level = self.level[node]
                boxes.append(Box(first - CLEARANCE, last + CLEARANCE, level - 0.25, level + 0.25, node))
            preferred = _middle(extents[bottom]) if bottom in extents else 0.0
            if bottom == GROUND and top in extents:
                preferred = _middle(extents[top])
            bars = {self.level[node]: _span(extents[node]) for node in (top, bottom) if node in extents}
            x = self._place(preferred, boxes, occupied, bars, own)
            middle[i] = x
            if top not in extents:
                extents[top] = [x - self._half(top), x + self._half(top)] if self._half(top) else []
            occupied.extend(box.moved(x) for box in boxes)
            extents[top] += self.feet(arm, x, top)
            extents.setdefault(bottom, []).extend(self.feet(arm, x, bottom))
        for node in free:
            # The initial position of a node is dropped once links lead to it.
            if not self._half(node):
                extents[node] = extents[node][1:] or extents[node]
        return middle, extents

    def _place_loads(
        self, middle: dict[int, float], extents: dict[str, list[float]], occupied: list[Box]
    ) -> dict[int, tuple[float, Side]]:
        """Return the position and label side of each load, and extend the nodes accordingly."""
        loads = {}
        for node in self.nodes:
            above = [
                foot
                for i, arm in enumerate(self.arms)
                if arm.bottom == node
                for foot in self.feet(arm, middle[i], node)
            ]
            for load in self.loads(node):
                side: Side = -1 if above else 1
                text = CLEARANCE + width(label(load))
                left, right = (0.15, 0.15 + text) if side > 0 else (0.15 + text, 0.15)
                box = Box(-left, right, self.level[node] + 0.25, self.level[node] + 0.6)
                preferred = min(above) - SYMBOL_WIDTH if above else _middle(extents[node])
                x = self._place(preferred, [box], occupied, {self.level[node]: _span(extents[node])}, [node])
                loads[id(load)] = x, side
                extents[node].append(x)
                occupied.append(Box(x - left, x + right, box.low, box.high))
        return loads

    def _half(self, node: str, *, plate_half_width: float = 1.0) -> float:
        # plate_half_width: half-width of a plate with prescribed motion.
        return BODY_WIDTH / 2.0 if self.bodies(node) else plate_half_width if self.motions(node) else 0.0

    def _node_box(self, node: str, x: float, around: tuple[float, float]) -> Box:
        """Return the box occupied by a node with its coordinate and prescribed motion."""
        half = self._half(node)
        left = max(half, around[0]) + (0.9 + width("y(t)") if self.motions(node) else 0.0)
        right = max(half, around[1]) + 4.0 * CLEARANCE + width(math_text(node))
        return Box(x - left, x + right, self.level[node] - 0.45, self.level[node] + 0.25, node)

    def _place(
        self, preferred: float, boxes: Sequence[Box], occupied: Sequence[Box], bars: Mapping[int, tuple[float, float]],
        own: Sequence[str],
    ) -> float:  # fmt: skip
        """Return the x nearest to the preferred one at which boxes, given relative to it, overlap no occupied box.

        A node's own box is no obstacle to its arms. Bars (level to span) would be extended to the new position; crossing
        others with them costs as much as a long detour.
        """
        obstacles = [box for box in occupied if box.owner not in own]

        def cost(x: float) -> tuple[float, float]:
            crossings = 0
            for level, (left, right) in bars.items():
                line = Box(min(left, x), max(right, x), level - 0.01, level + 0.01)
                before = Box(left, right, level - 0.01, level + 0.01)
                crossings += sum(line.overlaps(box) and not before.overlaps(box) for box in obstacles)
            return abs(x - preferred) + CROSSING_COST * crossings, -x

        def is_clear(x: float) -> bool:
            moved = [box.moved(x) for box in boxes]
            return not any(box.overlaps(other) for box in moved for other in obstacles)

        candidates = [preferred]
        for box in boxes:
            for other in obstacles:
                candidates += [other.left - box.right - CLEARANCE, other.right - box.left + CLEARANCE]
        return min((x for x in candidates if is_clear(x)), key=cost)

    # --- heights -------------------------------------------------------------------------------------------------------

    def need(
        self,
        link: Element,
        top: str,
        bottom: str,
        *,
        piece: bool,
        series_link_height: float = 1.6,
        bar_height: float = 2.0 * LINK_HEIGHT,
        bumper_opening: float = 0.12,
    ) -> tuple[float, float, float, float]:
        """Return the height of a link at rest, the height of its symbol, and the distances it opens and closes by.

        ``series_link_height``: height of a link in series with others.
        ``bar_height``: height of a bar.
        ``bumper_opening``: distance between the strokes of a bumper, relative to its height.
        """
        body = bar_height if isinstance(link, Bar) else series_link_height if piece else LINK_HEIGHT
        low, high = self.travel(top, bottom)
        opens, closes = max(high, 0.0), max(-low, 0.0)
        gap = self.scale * getattr(link, "gap", 0.0)
        if not self.scale:
            return body + (0.25 * body if _is_compliant(link) else 0.0), body, 0.0, 0.0
        if isinstance(link, Bumper):
            if ends(link)[0] == top:
                return (1.0 - bumper_opening) * body + gap, body, 0.0, 0.0
            deep = max(gap - low, 0.0)
            return (1.0 + bumper_opening) * body - gap + 2.0 * deep, body, 0.0, deep
        if _is_compliant(link):
            penetration = max(-low - gap, 0.0)
            return body + penetration + gap, body + penetration, 0.0, 0.0
        if link.split is None:
            return body + closes, body + closes, 0.0, 0.0
        return body + opens + 2.0 * closes, body, opens, closes

    def height(self, arm: Arm, *, piece: bool = False) -> float:
        """Return the required height of an arm at rest."""
        if arm.link is not None:
            return self.need(arm.link, arm.top, arm.bottom, piece=piece)[0]
        if arm.series:
            return sum(self.height(each, piece=True) for each in arm.series)
        return max(self.height(each, piece=piece) for each in arm.beside)

    @cached_property
    def rows(self) -> list[list[str]]:
        """The nodes from the ground up, in rows of equal height: one per level unless nodes would overlap."""
        found = []
        for level in range(1, self.level[CEILING]):
            rows: list[list[str]] = [[]]
            for node in (node for node in self.nodes if self.level[node] == level):
                left, right = self.span(node)
                free = (r for r in rows if all(right < self.span(o)[0] or left > self.span(o)[1] for o in r))
                row = next(free, None)
                if row is None:
                    rows.append(row := [])
                row.append(node)
            found += [row for row in rows if row]
        return [*found, [CEILING]] if self.hung else found

    def thickness(self, node: str) -> float:
        """Return the height of a node's body, or zero."""
        return BODY_HEIGHT if self.bodies(node) else 0.0

    @cached_property
    def y(self) -> dict[str, float]:
        """Height of the middle of each node at rest, inner nodes included."""
        y = {GROUND: 0.0}
        top = 0.0
        level = 0
        for row in self.rows:
            here = self.level[row[0]]
            thick = max(self.thickness(node) for node in row)
            if len(y) > 1 or self.grounded:
                below = [
                    arm
                    for i, arm in enumerate(self.arms)
                    if arm.bottom in y and (arm.top in row or (i in self._crossed))
                ]
                lift = ROW_SPACING if here == level else 0.9 * LINK_HEIGHT
                base = max([top + lift, *(self.edge(y, arm.bottom, 1) + self.height(arm) for arm in below)])
            else:
                base = 0.0
            y |= dict.fromkeys(row, base + thick / 2.0)
            top, level = base + thick, here
        return y | dict(self._inner(y))

    def edge(self, y: Mapping[str, float], node: str, side: Side) -> float:
        """Return the y of the upper (1) or lower (-1) edge of a node's body, where links join it."""
        return y[node] + side * self.thickness(node) / 2.0

    def _inner(self, y: Mapping[str, float]) -> Iterator[tuple[str, float]]:
        def walk(arm: Arm, top: float, bottom: float, *, low: bool) -> Iterator[tuple[str, float]]:
            for each in arm.beside:
                yield from walk(each, top, bottom, low=low)
            needs = [self.height(each, piece=True) for each in arm.series]
            for i, (each, need) in enumerate(zip(arm.series, needs, strict=True)):
                # The excess length of the arm is distributed over its pieces, or given to the first.
                spare = top - bottom - sum(needs[i:])
                foot = top - need - (spare if low else spare / (len(needs) - i))
                yield from walk(each, top, foot, low=low)
                if each is not arm.series[-1]:
                    yield each.bottom, foot
                top = foot

        for i, arm in enumerate(self.arms):
            yield from walk(arm, self.edge(y, arm.top, -1), self.edge(y, arm.bottom, 1), low=i in self._crossed)

    @cached_property
    def _crossed(self) -> set[int]:
        """The arms that pass behind a node; their symbols are placed below it."""
        found = set()
        for i, arm in enumerate(self.arms):
            left, right = (self._across[0][i] + side * out for side, out in zip((-1, 1), self.reach(arm), strict=True))
            for node in (node for node in self.nodes if node not in (arm.top, arm.bottom)):
                start, end = self.span(node)
                between = self.level[arm.bottom] <= self.level[node] <= self.level[arm.top]
                if between and start < right and end > left:
                    found.add(i)
        return found

    # --- result --------------------------------------------------------------------------------------------------------

    @cached_property
    def _placed(self) -> tuple[list[PlacedLink], dict[str, tuple[float, float]]]:
        links: list[PlacedLink] = []
        bars: dict[str, tuple[float, float]] = {}

        def walk(arm: Arm, x: float, side: Side, *, piece: bool, low: bool) -> None:
            if arm.link is not None:
                need, body, opens, closes = self.need(arm.link, arm.top, arm.bottom, piece=piece)
                spare = self.edge(self.y, arm.top, -1) - self.edge(self.y, arm.bottom, 1) - need
                top_lead, bottom_lead = (spare, 0.0) if low else (spare / 2.0, spare / 2.0)
                if not self.scale and _is_compliant(arm.link):
                    top_lead = top_lead + 0.08 * body
                    bottom_lead = bottom_lead + 0.08 * body
                first_up = ends(arm.link)[0] == arm.top
                first, last = (top_lead, bottom_lead) if first_up else (bottom_lead, top_lead)
                # The rod of a telescoping symbol is long enough that the case never reaches the first node.
                extra = opens + closes
                links.append(PlacedLink(arm.link, arm.top, arm.bottom, x, side, body, (first + extra, last), extra))
            for each in arm.series:
                walk(each, x, side, piece=True, low=low)
            for upper, lower in pairwise(arm.series):
                feet = self.feet(upper, x, upper.bottom) + self.feet(lower, x, lower.top)
                bars[upper.bottom] = min(feet), max(feet)
            for i, (each, offset) in enumerate(zip(arm.beside, self.offsets(arm) if arm.beside else [], strict=True)):
                walk(each, x + offset, -1 if i == 0 else 1, piece=piece, low=low)

        for i, arm in enumerate(self.arms):
            walk(arm, self._across[0][i], 1, piece=False, low=i in self._crossed)
        return links, bars

    @property
    def links(self) -> list[PlacedLink]:
        """All links with their positions."""
        return self._placed[0]

    @property
    def inner_bars(self) -> dict[str, tuple[float, float]]:
        """Horizontal range of each inner node."""
        return self._placed[1]

    def load_place(self, load: Element) -> tuple[float, Side]:
        """Return the x of a load and the side of its label."""
        return self._across[2][id(load)]

    def span(self, node: str) -> tuple[float, float]:
        """Return the horizontal range of a node, a body or a rigid bar."""
        extents = self._across[1].get(node, [0.0])
        left, right = _span(extents)
        margin = CLEARANCE if self.bodies(node) and right - left > BODY_WIDTH + 1e-9 else 0.0
        return left - margin, right + margin

    @cached_property
    def coordinate_places(self) -> dict[str, tuple[float, Side]]:
        """The x of each coordinate's arrow and the side of its name, at the nearest free position beside the node."""
        occupied = [self._link_box(link) for link in self.links]
        for node in self.nodes:
            left, right = self.span(node)
            half = max(self.thickness(node) / 2.0, 0.1)
            motion = 0.9 + width("y(t)") if self.motions(node) else 0.0
            occupied.append(Box(left - motion, right, self.y[node] - half, self.y[node] + half))
            for load in self.loads(node):
                x, side = self.load_place(load)
                text = CLEARANCE + width(label(load))
                top = self.edge(self.y, node, 1)
                left, right = (text, 0.15) if side < 0 else (0.15, text)
                occupied.append(Box(x - left, x + right, top, top + LOAD_HEIGHT + 0.1))
        found = {}
        for node in self.nodes:
            size = 2.0 * CLEARANCE + width(math_text(node))
            low = self.y[node] - COORDINATE_LENGTH - 0.1
            high = self.y[node] + 0.3
            best: tuple[float, float, Side, Box] | None = None
            for side, edge in ((1, self.span(node)[1]), (-1, self.span(node)[0])):
                starts = [edge + side * 2.0 * CLEARANCE]
                starts += [(box.right if side > 0 else box.left) + side * CLEARANCE for box in occupied]
                for x in starts:
                    if side * (x - edge) < CLEARANCE:
                        continue
                    box = Box(min(x - CLEARANCE, x + side * size), max(x + CLEARANCE, x + side * size), low, high)
                    leader = Box(min(edge, x), max(edge, x), self.y[node] - 0.05, self.y[node] + 0.05)
                    crossings = sum(leader.overlaps(other) for other in occupied)
                    cost = abs(x - edge) + (0.0 if side > 0 else 2.0) + CROSSING_COST * crossings
                    if (best is None or cost < best[0]) and not any(box.overlaps(other) for other in occupied):
                        best = cost, x, side, box
            assert best is not None
            found[node] = best[1], best[2]
            occupied.append(best[3])
        return found

    def _link_box(self, link: PlacedLink) -> Box:
        half = half_breadth(link.part)
        beside = half + CLEARANCE + width(label(link.part))
        left, right = (half, beside) if link.side > 0 else (beside, half)
        return Box(link.x - left, link.x + right, self.edge(self.y, link.bottom, 1), self.edge(self.y, link.top, -1))


def _is_compliant(link: Element) -> bool:
    """Return whether the link is a compliant contact between two bodies."""
    return isinstance(link, CompliantContact)


def _has_upper_end(link: Element) -> bool:
    """Return whether the link itself defines which of its ends is the upper one."""
    return isinstance(link, (Bumper, CompliantContact, Rope))


def _span(x: Sequence[float]) -> tuple[float, float]:
    return min(x), max(x)


def _middle(x: Sequence[float]) -> float:
    low, high = _span(x)
    return (low + high) / 2.0
