"""Up and down in plots over time: which way each coordinate points, and the surfaces that bodies meet.

In the drawing of a scheme every coordinate points downwards, and so it does in the plot of a run: its axis is inverted, and
a body that falls is drawn falling, onto a hatched line. Weight says what is vertical. Coordinates that springs, dashpots and
contacts join lie along one line; the sum of their constant loads acts downwards if it is positive, and upwards where heights
were taken as coordinates. A line without weight points downwards if there is a contact along it, as in the drawing. Angles,
and coordinates along a surface, where no weight and no contact acts, point neither way.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patheffects import Normal, TickedStroke
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from lcpimpact.arrays import Array
from lcpimpact.plotting.style import GREY
from lcpimpact.plotting.timeline import coordinates_label, math_text
from lcpimpact.problems.base import Problem
from lcpimpact.scheme.dynamics import Dynamics
from lcpimpact.scheme.elements.base import GROUND, Link
from lcpimpact.scheme.elements.bumper import Bumper
from lcpimpact.scheme.elements.compliant import CompliantContact
from lcpimpact.scheme.scheme import Scheme
from lcpimpact.scheme.terms import nodes_of

CONTACTS = (Bumper, CompliantContact)
"""Elements with a gap between two surfaces."""


@dataclass(frozen=True)
class Surface:
    """A resting surface that a body meets.

    Attributes
    ----------
    node : str          the coordinate of the body
    place : float       of the surface on its axis, in m
    below : bool        whether it keeps the body from going down, as drawn, or up
    """

    node: str
    place: float
    below: bool


@dataclass(frozen=True, eq=False)
class CoordinateAxis:
    """Coordinates of one unit that point one way, drawn in one panel.

    Attributes
    ----------
    nodes : tuple of str            the coordinates
    label : str                     label of the axis
    down : bool                     whether the axis is inverted
    surfaces : tuple of Surface     the surfaces along it
    zeros : (n,) array              places in m of the coordinates where the axis has its zero
    sign : float                    -1 where heights are drawn, opposite to the coordinates
    """

    nodes: tuple[str, ...]
    label: str
    down: bool
    surfaces: tuple[Surface, ...]
    zeros: Array
    sign: float

    def values(self, q: Array) -> Array:
        """Return the values to draw (nt, n) of the coordinates q of the nodes."""
        return np.asarray(self.sign * (q - self.zeros))

    def orient(self, ax: Axes, largest: float = 0.0, *, near: float = 0.15, rest: float = 1e-9) -> None:
        """Invert a panel whose curves are drawn, if they point downwards, and draw the surfaces near them.

        ``largest``: largest coordinate of the run.
        ``near``: distance from the curves, relative to their range, up to which a surface is drawn.
        ``rest``: range of the curves, relative to the largest coordinate, below which it is rounding.
        """
        low, high = ax.dataLim.intervaly
        if high - low < rest * largest:
            ax.set_ylim(low - 0.05 * largest, high + 0.05 * largest)
        low, high = ax.get_ylim()
        named: dict[tuple[float, bool], list[str]] = {}
        for each in self.surfaces:
            if low - near * (high - low) <= each.place <= high + near * (high - low):
                named.setdefault((each.place, each.below), []).append(each.node)
        for (place, below), nodes in named.items():
            # Of several coordinates with zeros of their own a surface is not one of all.
            name = f"surface of {', '.join(map(math_text, nodes))}" if len(nodes) < len(self.nodes) else ""
            _draw_surface(ax, place, below, name)
        if self.down:
            ax.invert_yaxis()


def axes_of(problem: Problem, nodes: Iterable[str], *, up: bool = False) -> list[CoordinateAxis]:
    """Return the axes of coordinates: one for each unit and direction, in the order of the coordinates.

    With ``up``, coordinates that point downwards are drawn as heights: above the floor where there is one, else above zero.
    """
    found: dict[tuple[str, int], list[str]] = {}
    pointing = _directions(problem)
    for node in nodes:
        found.setdefault((problem.unit(node), pointing.get(node, 0)), []).append(node)
    return [_axis(problem, tuple(group), way, up) for (_, way), group in found.items()]


def _axis(problem: Problem, nodes: tuple[str, ...], way: int, up: bool) -> CoordinateAxis:
    down = way > 0 and not up
    surfaces = [
        Surface(node, place, towards_greater == (way > 0)) for node, place, towards_greater in _limits(problem, nodes)
    ]
    floors = {each.place for each in surfaces if each.below}
    zeros = np.zeros(len(nodes))
    label = math_text(nodes[0]) if len(nodes) == 1 else "coordinates"
    height = up and way > 0
    if height:
        label = "height" if len(nodes) == 1 else "heights"
        if len(floors) == 1:
            label = f"{label} above the floor"
            zeros = np.full(len(nodes), min(floors))
        surfaces = [replace(each, place=float(zeros[0] - each.place)) for each in surfaces]
    text = coordinates_label(problem, nodes, label)
    text = f"{text}, downwards" if down else text
    return CoordinateAxis(nodes, text, down, tuple(surfaces), zeros, -1.0 if height else 1.0)


def _draw_surface(ax: Axes, place: float, below: bool, name: str) -> None:
    """Draw a line with a name, hatched on the side where no body can be: below it, or above."""
    hatching = TickedStroke(spacing=6.0, angle=-135.0 if below else 45.0, length=0.8, linewidth=0.8, foreground=GREY)
    ax.hlines(
        place, 0.0, 1.0, transform=ax.get_yaxis_transform(), path_effects=[hatching, Normal()], clip_on=False,
        colors=GREY, linewidths=1.2, linestyles="solid", zorder=1.6,
    )  # fmt: skip
    if name:
        ax.annotate(
            name, (0.01, place), (0.0, 3.0 if below else -3.0), xycoords=ax.get_yaxis_transform(),
            textcoords="offset points", va="bottom" if below else "top", fontsize=8.0, color=GREY,
        )  # fmt: skip


def _directions(problem: Problem) -> dict[str, int]:
    """Return 1 for each coordinate that points downwards, and -1 for each that points upwards; others are left out."""
    if not isinstance(problem.scheme, Scheme):
        return {}
    d = problem.dynamics
    index = {node: i for i, node in enumerate(d.nodes) if problem.units.get(node) != "rad"}
    weight = np.zeros(len(d.nodes))
    if isinstance(d, Dynamics):
        for i, load in d.loads:
            weight[i] += 0.0 if callable(load) else load
    else:
        weight += d.f
    meets = np.zeros(len(d.nodes), dtype=bool)
    joined: list[tuple[int, int]] = []
    for element in problem.scheme.elements:
        oblique = (
            any(len(index.keys() & nodes_of(end)) > 1 for end in element.ends) if isinstance(element, Link) else False
        )
        if oblique:
            continue
        along = [index[node] for node in element.nodes if node in index]
        joined += [(along[0], i) for i in along]
        meets[along] |= isinstance(element, CONTACTS)
    first, last = np.array(joined, dtype=int).reshape(-1, 2).T
    graph = coo_array((np.ones(len(first)), (first, last)), shape=(len(weight), len(weight)))
    count, line = connected_components(graph, directed=False)
    total = np.bincount(line, weight, count)
    ways = np.where(total != 0.0, np.sign(total), np.bincount(line, meets, count) > 0.0).astype(int)[line]
    return {node: int(ways[i]) for node, i in index.items() if ways[i]}


def _limits(problem: Problem, nodes: Sequence[str]) -> list[tuple[str, float, bool]]:
    """Return the places at which resting surfaces end the way of coordinates, and whether it is that to greater values."""
    found = []
    for element in problem.scheme.elements if isinstance(problem.scheme, Scheme) else ():
        if isinstance(element, CONTACTS):
            if element.upper in nodes and element.lower == GROUND:
                found.append((str(element.upper), element.gap, True))
            elif element.lower in nodes and element.upper == GROUND:
                found.append((str(element.lower), -element.gap, False))
    return found
