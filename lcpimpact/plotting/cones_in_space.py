"""The eight complementary cones of an LCP in three unknowns, as spherical triangles on the sphere of the directions of q.

The sphere is seen from (1, 1, 1) and from behind. A cone is clipped to the hemisphere in view: what remains is again a cone
of a few rays, whose great arcs are its outline.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise, product

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle, Polygon
from scipy.optimize import linprog

from lcpimpact.arrays import Array

DEPENDENT_TOL = 1e-12
"""Volume of three unit columns, or sine of an angle, below which they are dependent."""

INFEASIBLE, UNBOUNDED = 2, 3
"""Statuses of SciPy's linear programs."""


@dataclass(frozen=True, eq=False)
class View:
    """A hemisphere as seen from outside.

    Attributes
    ----------
    name : str
    axes : (3, 3) array     directions to the right, upwards, and towards the viewer, as rows
    """

    name: str
    axes: Array

    @classmethod
    def towards(cls, name: str, eye: Sequence[float]) -> View:
        """Return the view from a direction, with the third axis upwards."""
        towards = np.array(eye) / np.linalg.norm(eye)
        up = np.array([0.0, 0.0, 1.0]) - towards[2] * towards
        up /= np.linalg.norm(up)
        return cls(name, np.array([np.cross(up, towards), up, towards]))

    def flat(self, points: Array) -> Array:
        """Return the places of points (..., 3) in the picture (..., 2)."""
        return points @ self.axes[:2].T

    def shows(self, direction: Array) -> bool:
        """Return whether a direction is in front."""
        return bool(direction @ self.axes[2] >= 0.0)


VIEWS = View.towards("seen from (1, 1, 1)", (1.0, 1.0, 1.0)), View.towards("seen from (-1, -1, -1)", (-1.0, -1.0, -1.0))


def unit_columns(columns: Array) -> Array:
    """Return the columns of a cone (3, 3), each as a row of length 1 or 0."""
    lengths = np.linalg.norm(columns, axis=1, keepdims=True)
    return columns / np.where(lengths > 0.0, lengths, 1.0)


def kind_of(columns: Array) -> str:
    """Return the kind of a cone: "wedge" with an inside, or "sector", "line", "ray", "origin"."""
    unit = unit_columns(columns)
    if abs(np.linalg.det(unit)) > DEPENDENT_TOL:
        return "wedge"
    unit = unit[unit.any(axis=1)]
    if not len(unit):
        return "origin"
    if max(np.linalg.norm(np.cross(unit[0], each)) for each in unit) > DEPENDENT_TOL:
        return "sector"
    return "line" if (unit @ unit[0] < 0.0).any() else "ray"


def holds(columns: Array, points: Array) -> Array:
    """Return the flags of the points (..., 3) that a cone with an inside contains."""
    return np.asarray((points @ np.linalg.inv(unit_columns(columns)) > 0.0).all(axis=-1))


def is_dependent_at(columns: Array, q: Array) -> bool:
    """Return whether q is a non-negative combination of dependent columns in more than one way."""
    if kind_of(columns) == "wedge":
        return False
    scaled = q / (np.linalg.norm(q) or 1.0)
    for i, sign in product(range(3), (1.0, -1.0)):
        found = linprog(sign * np.eye(3)[i], A_eq=unit_columns(columns).T, b_eq=scaled)
        if found.status == INFEASIBLE:
            return False
        if found.status == UNBOUNDED:
            return True
        if sign > 0.0:
            least = found.fun
        elif -found.fun - least > 1e-6:
            return True
    return False


def counts(wedges: Sequence[Array], *, near: float = 1e-5) -> list[int]:
    """Return the numbers of cones with an inside that contain a direction, over all regions of the sphere.

    The planes of their faces cut the sphere into regions; each has a corner, where two of the planes meet, so the directions
    about all corners, one between each two neighbouring planes, are in every region.

    ``near``: distance from a corner at which the regions that meet there are sampled.
    """
    normals = [np.cross(a, b) for cone in wedges for a, b in combinations(unit_columns(cone), 2)]
    normals = [each / np.linalg.norm(each) for each in normals]
    corners = [np.cross(a, b) for a, b in combinations(normals, 2)]
    samples = [s * c / np.linalg.norm(c) for c in corners if np.linalg.norm(c) > 1e-9 for s in (1.0, -1.0)]
    found = set[int]()
    for corner in np.unique(np.round(samples, 9), axis=0) if samples else ():
        first = np.cross(corner, normals[int(np.argmin(np.abs(normals @ corner)))])
        first /= np.linalg.norm(first)
        second = np.cross(corner, first)
        angles = [np.arctan2(n @ -first, n @ second) for n in normals if abs(n @ corner) < 1e-6]
        edges = np.unique(np.round([a % np.pi for a in angles], 7))
        edges = np.concatenate([edges, edges + np.pi, [edges[0] + 2.0 * np.pi]])
        middle = 0.5 * (edges[1:] + edges[:-1])
        about = corner + near * (np.outer(np.cos(middle), first) + np.outer(np.sin(middle), second))
        found |= set(np.sum([holds(cone, about) for cone in wedges], axis=0).tolist())
    return sorted(found)


def clipped(rays: Sequence[Array], view: View) -> list[Array]:
    """Return the rays of the part of a convex cone in front, in order."""
    front, found = view.axes[2], list[Array]()
    for a, b in zip(rays, [*rays[1:], rays[0]], strict=True):
        inside, next_inside = a @ front >= 0.0, b @ front >= 0.0
        if inside:
            found.append(a)
        if inside != next_inside:
            crossing = a * abs(b @ front) + b * abs(a @ front)
            found.append(crossing / (np.linalg.norm(crossing) or 1.0))
    return found


def arc(a: Array, b: Array, *, arc_points: int = 33) -> Array:
    """Return the shorter great arc between two directions (`arc_points`, 3).

    ``arc_points``: points of an arc.
    """
    angle = np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b)
    if angle < DEPENDENT_TOL:
        return np.repeat(a[None, :], arc_points, axis=0)
    s = np.linspace(0.0, angle, arc_points)[:, None]
    return np.asarray((np.sin(angle - s) * a + np.sin(s) * b) / np.sin(angle))


def outline(rays: Sequence[Array]) -> Array:
    """Return the closed outline of a cone of several rays on the sphere (n, 3)."""
    return np.concatenate([arc(a, b) for a, b in pairwise([*rays, rays[0]])])


def draw_sphere(ax: Axes, view: View, drawn: Sequence[Array], colors: Sequence[str], edge: str, hatch: str) -> bool:
    """Draw the part of the cones in view on a sphere; return whether there is a region without solution."""
    ax.set(xlim=(-1.25, 1.25), ylim=(-1.25, 1.25), aspect="equal")
    ax.set_axis_off()
    ax.set_title(view.name, loc="center")
    ax.add_patch(Circle((0.0, 0.0), 1.0, facecolor="none", edgecolor=edge, linewidth=1.0, zorder=2.5))
    has_gap = _draw_gaps(ax, view, [cone for cone in drawn if kind_of(cone) == "wedge"], hatch)
    for cone, color in zip(drawn, colors, strict=True):
        unit = unit_columns(cone)
        if kind_of(cone) == "wedge":
            rays = clipped(list(unit), view)
            if len(rays) > 2:
                shape = view.flat(outline(rays))
                ax.add_patch(Polygon(shape, facecolor=(color, 0.32), edgecolor="none", zorder=2.0))
        for a, b in combinations(unit[unit.any(axis=1)], 2):
            _draw_arc(ax, view, a, b, color if kind_of(cone) != "wedge" else edge, kind_of(cone) != "wedge")
        if kind_of(cone) in ("line", "ray"):
            ends = [each for each in unit if each.any() and view.shows(each)]
            places = view.flat(np.array(ends).reshape(-1, 3))
            ax.plot(*places.T, color=color, marker="o", markersize=11.0, linestyle="", zorder=2.2)
    return has_gap


def _draw_arc(ax: Axes, view: View, a: Array, b: Array, color: str, thick: bool) -> None:
    """Draw the part of an arc in front; of opposite directions there is none."""
    if np.linalg.norm(np.cross(a, b)) <= DEPENDENT_TOL:
        return
    points = arc(a, b)
    places = np.where((points @ view.axes[2] >= -1e-12)[:, None], view.flat(points), np.nan)
    ax.plot(*places.T, color=color, linewidth=6.0 if thick else 1.0, linestyle="-", zorder=2.2)


def _draw_gaps(ax: Axes, view: View, wedges: Sequence[Array], hatch: str, *, grid: int = 240) -> bool:
    """Hatch the directions in view that no cone with an inside contains; return whether there are any.

    ``grid``: points of the grid along a diameter, on which regions without solution are found.
    """
    x, y = np.meshgrid(np.linspace(-1.0, 1.0, grid), np.linspace(-1.0, 1.0, grid))
    inside = x**2 + y**2 <= 1.0
    depth = np.sqrt(np.where(inside, 1.0 - x**2 - y**2, 0.0))
    points = np.stack([x, y, depth], axis=-1) @ view.axes
    solved = np.sum([holds(cone, points) for cone in wedges], axis=0) if wedges else np.zeros(x.shape)
    empty = np.ma.masked_array((solved == 0).astype(float), ~inside)
    if empty.max() == 1.0:
        region = ax.contourf(x, y, empty, levels=[0.5, 1.5], hatches=["////"], colors="none", zorder=1.0)
        region.set(edgecolor=hatch, linewidth=0.0)
        return True
    return False


def name_places(
    drawn: Sequence[Array], labels: Sequence[tuple[View, Array]], least: float = 0.22
) -> Iterator[tuple[View, Array] | None]:
    """Yield for each cone the view and the place of its name: in its larger part, away from labels and the others' names."""
    taken = list(labels)
    for cone in drawn:
        best = max(_candidates(cone), key=lambda each: _room(each, taken, least), default=None)
        if best is not None:
            taken.append(best)
        yield best


def _candidates(cone: Array) -> Iterator[tuple[View, Array]]:
    """Yield the views and places where the name of a cone could stand, the larger part first."""
    if kind_of(cone) == "origin":
        return
    wedge = kind_of(cone) == "wedge"
    parts = [(view, clipped(list(unit_columns(cone)), view) if wedge else []) for view in VIEWS]
    for view, rays in sorted(parts, key=lambda each: -_area(*each)):
        if wedge and len(rays) > 2:
            for weights in ((1.0,) * len(rays), *product((1.0, 3.0, 8.0), repeat=len(rays))):
                middle = np.array(weights) @ np.array(rays)
                yield view, view.flat(middle / np.linalg.norm(middle))
        elif not wedge:
            unit = unit_columns(cone)
            for a, b in combinations(unit[unit.any(axis=1)], 2):
                yield from ((view, view.flat(point)) for point in arc(a, b)[12:37:6] if view.shows(point))
            yield from ((view, view.flat(point)) for point in unit if point.any() and view.shows(point))


def _area(view: View, rays: Sequence[Array]) -> float:
    """Return the area of the cone of some rays in a view."""
    if len(rays) < 3:
        return 0.0
    x, y = view.flat(outline(rays)).T
    return 0.5 * abs(float(x @ np.roll(y, 1) - y @ np.roll(x, 1)))


def _room(place: tuple[View, Array], taken: Sequence[tuple[View, Array]], least: float) -> float:
    """Return the distance of a place from the others in its view, as far as it matters."""
    distances = [float(np.hypot(*(place[1] - other))) for view, other in taken if view is place[0]]
    return min([least, *distances])
