"""Drawings of bodies in the plane: shapes that move and turn, walls, joints, and the forces where they touch."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from lcpimpact.arrays import Array, Flags
from lcpimpact.plotting.layout import width
from lcpimpact.plotting.schematic import (
    FORCE_COLOR,
    RIGHT,
    Label,
    Piece,
    Stroke,
    arrow,
    dot,
    extent,
    hatched,
    length_text,
    round_below,
)
from lcpimpact.plotting.style import GREY, INK, LIGHT_GREY, PALETTE
from lcpimpact.plotting.timeline import math_text
from lcpimpact.record import Event
from lcpimpact.scheme.bodies import surfaces_of
from lcpimpact.scheme.elements.base import GROUND
from lcpimpact.scheme.elements.body import Body, Wall
from lcpimpact.scheme.elements.touch import Guide, Pin, Touch
from lcpimpact.scheme.lagrangian import traced_rows
from lcpimpact.scheme.motion_function import MotionArguments, MotionFunction
from lcpimpact.scheme.scheme import Scheme
from lcpimpact.scheme.shapes import Disk, Line
from lcpimpact.trajectory import Trajectory

LONGEST_ARROW = 2.0
"""Length of the arrow of the largest force, and of the largest impulse, in units of the layout."""

IMPULSE_COLOR = PALETTE[3]

CIRCLE = np.column_stack([f(np.linspace(0.0, 2.0 * np.pi, 65)) for f in (np.cos, np.sin)])

SUPPORT = np.array([[0.0, 0.0], [0.3, -0.45], [-0.3, -0.45], [0.0, 0.0]])
"""Outline of what carries a pin of the ground, in units of the layout."""

Impacts = Sequence[tuple[Event, Flags]]
"""Impacts, each with the frames in which it is shown."""


@dataclass(frozen=True, eq=False)
class ContactForce:
    """Force and impulse on a body where another surface touches it.

    Attributes
    ----------
    name : str                  name of the normal reaction
    body : str
    point : (nf, 2) array       place of the contact in m
    force, impulse : (nf, 2) arrays
                                the force in N, and the impulse in N s in the frames in which an impact is shown
    """

    name: str
    body: str
    point: Array
    force: Array
    impulse: Array


@dataclass(frozen=True, eq=False)
class PlaneMotion:
    """Places of the bodies of a run at the times of its frames.

    Attributes
    ----------
    trajectory : Trajectory
    scheme : Scheme             that of the run
    times : (nf,) array         times of the frames in s
    places : dict of str to (nf, 3) array
                                x, y and φ of each body, wall and the ground in m and rad
    """

    trajectory: Trajectory
    scheme: Scheme
    times: Array
    places: dict[str, Array]

    @classmethod
    def of(cls, trajectory: Trajectory, times: Array) -> PlaneMotion:
        """Return the motion of a run of a scheme with bodies."""
        scheme = trajectory.problem.scheme
        assert isinstance(scheme, Scheme)
        q = dict(zip(trajectory.nodes, trajectory.sample(times).q.T, strict=True))
        places = {GROUND: np.zeros((len(times), 3))}
        for each in scheme.elements:
            if isinstance(each, Body):
                places[each.name] = np.column_stack([q[node] for node in each.nodes])
            elif isinstance(each, Wall):
                places[each.name] = np.tile([each.x, each.y, 0.0], (len(times), 1))
        return cls(trajectory, scheme, times, places)

    def points(self, name: str, points: Sequence[Sequence[float]] | Array) -> Array:
        """Return points (np, 2) of a body, a wall or the ground as they stand (nf, np, 2)."""
        place = self.places[name][:, None]
        along = np.concatenate([np.cos(place[..., 2:]), np.sin(place[..., 2:])], axis=-1)
        across = along[..., ::-1] * [-1.0, 1.0]
        seen = np.asarray(points, dtype=np.float64)
        return np.asarray(place[..., :2] + seen[:, :1] * along + seen[:, 1:] * across)

    def outline(self, part: Body | Wall) -> Array:
        """Return the outline of a shape (nf, np, 2); without one, lines from the centre of mass to the joints."""
        shape = part.shape
        if isinstance(shape, Disk):
            return self.points(part.name, shape.R * CIRCLE)
        if isinstance(shape, Line):
            return self.points(part.name, shape.points)
        if shape is not None:
            return self.points(part.name, [*shape.points, shape.points[0]])
        ends = [end for e in self.pins_and_guides for end in ((e.a, e.p), (e.b, getattr(e, "q", None)))]
        own = [p for name, p in ends if name == part.name and p]
        return self.points(part.name, [(0.0, 0.0), *(each for p in own for each in (p, (0.0, 0.0)))])

    def stretch(self, name: str, line: Line, points: Array, scale: float, *, beyond: float = 0.8) -> Array:
        """Return the ends of a line of a body or wall (nf, 2, 2) that goes beyond points (nf, np, 2) on both sides.

        ``beyond``: this length in units of the layout, of which a metre has ``scale``.
        """
        reach = beyond / scale
        n = np.array(line.normal)
        along = np.array([n[1], -n[0]])
        frame = self.points(name, np.array([[0.0, 0.0], along]))
        s = ((points - frame[:, :1]) * (frame[:, 1:] - frame[:, :1])).sum(axis=-1)
        return self.points(name, line.height * n + np.outer([s.min() - reach, s.max() + reach], along))

    @property
    def bodies(self) -> list[Body]:
        """The bodies."""
        return [each for each in self.scheme.elements if isinstance(each, Body)]

    @property
    def touches(self) -> list[Touch]:
        """The contacts."""
        return [each for each in self.scheme.elements if isinstance(each, Touch)]

    @property
    def pins_and_guides(self) -> list[Pin | Guide]:
        """The joints."""
        return [each for each in self.scheme.elements if isinstance(each, Pin | Guide)]

    def moves(self, name: str) -> bool:
        """Return whether a name is that of a body."""
        return any(each.name == name for each in self.bodies)

    def contact_forces(self, impacts: Impacts) -> list[ContactForce]:
        """Return force and impulse at each contact on each of its bodies.

        A body with the rows n = ∂U_N/∂(x', y') and t = ∂U_T/∂(x', y') is touched at the distances -∂U_T/∂φ' along n and
        ∂U_N/∂φ' along t from its centre of mass.
        """
        surfaces = surfaces_of(self.scheme.elements, [node for each in self.bodies for node in each.nodes])
        q = np.hstack([self.places[each.name] for each in self.bodies])
        names = self.trajectory.force_names
        reactions = dict(zip(names, np.nan_to_num(self.trajectory.sample(self.times).reaction).T, strict=False))
        impulses = {name: np.zeros(len(self.times)) for name in names}
        for event, frames in impacts:
            for name in (event.contact, f"{event.contact}_T"):
                if name in names:
                    impulses[name][frames] = event.impulse if name == event.contact else 0.0
        nothing = np.zeros(len(self.times))
        found = []
        for touch in self.touches:
            # With friction, so that each contact has a row along the tangent, too.
            laws = list(replace(touch, mu=1.0).laws(surfaces))
            x = MotionArguments.of(q.shape[1])
            (H,) = MotionFunction(x, (np.array([row.H for row in traced_rows(laws, x)], dtype=object),))(
                self.times, q, q
            )
            for i, law in enumerate(laws):
                for body in (touch.a, touch.b):
                    if not surfaces[body].at:
                        continue
                    N, T = H[:, 2 * i, surfaces[body].at], H[:, 2 * i + 1, surfaces[body].at]
                    n, t = N[:, :2], T[:, :2]
                    point = self.places[body][:, :2] - T[:, 2:] * n + N[:, 2:] * t
                    force, impulse = (
                        each[law.name][:, None] * n + each.get(f"{law.name}_T", nothing)[:, None] * t
                        for each in (reactions, impulses)
                    )
                    found.append(ContactForce(law.name, body, point, force, impulse))
        return found


def lay_out_plane(
    trajectory: Trajectory, times: Array, impacts: Impacts, *, travel: float = 9.0
) -> tuple[float, list[list[Piece]]]:
    """Return the scale in units of the layout per metre, and the pieces at each time, in the same order.

    Parameters
    ----------
    trajectory : Trajectory
        A run of a scheme with bodies.
    times : (nf,) array
        Times within the run, in s.
    impacts : sequence of (Event, (nf,) flags)
        Impacts, each with the frames in which it is shown.
    travel : float
        Width or height of all places of the bodies, whichever is greater, in units of the layout.
    """
    motion = PlaneMotion.of(trajectory, times)
    parts = [each for each in motion.scheme.elements if isinstance(each, Body | Wall)]
    solid = [each for each in parts if isinstance(each, Body) or not isinstance(each.shape, Line)]
    every = np.concatenate([motion.outline(each).reshape(-1, 2) for each in solid])
    scale = travel / (float(np.ptp(every, axis=0).max()) or 1.0)
    columns: list[list[Piece]] = []
    for each in parts:
        columns += _surface(motion, each, scale)
    for joint in motion.pins_and_guides:
        columns += _joint(motion, joint, scale)
    contacts = motion.contact_forces(impacts)
    bars: list[tuple[float, str, str]] = []
    for what, unit, color in (("force", "N", FORCE_COLOR), ("impulse", "N s", IMPULSE_COLOR)):
        most = max((float(np.hypot(*getattr(c, what).T).max()) for c in contacts), default=0.0)
        if most == 0.0:
            continue
        length = LONGEST_ARROW / most
        for c in contacts:
            tips = scale * c.point + length * getattr(c, what)
            columns += _moving([list(arrow(*ends, color)) for ends in zip(scale * c.point, tips, strict=True)])
        bars.append((length, trajectory.problem.own_unit(unit), color))
    scenes = [list(each) for each in zip(*columns, strict=True)]
    corner = np.array([extent(each) for each in scenes]).min(axis=0)[[0, 2]] + [0.5, -0.4]
    fixed = list(_scale_bars(scale, trajectory.problem.own_unit("m"), bars, corner))
    return scale, [[*each, *fixed] for each in scenes]


def _moving(scenes: Iterable[Sequence[Piece]]) -> list[list[Piece]]:
    """Return the pieces of several frames, each piece over all frames."""
    return [list(each) for each in zip(*scenes, strict=True)]


def _surface(motion: PlaneMotion, part: Body | Wall, scale: float) -> list[list[Piece]]:
    """Return the pieces of a body or wall, each over all frames."""
    shape, frames = part.shape, len(motion.times)
    outline = scale * motion.outline(part)
    hollow = isinstance(shape, Disk) and shape.hollow
    if isinstance(part, Wall) and isinstance(shape, Line):
        touching = {name for e in motion.touches if part.name in (e.a, e.b) for name in (e.a, e.b)}
        bodies = [each for each in motion.bodies if each.name in touching] or motion.bodies
        points = np.concatenate([motion.outline(each) for each in bodies], axis=1)
        return _moving([list(hatched(scale * motion.stretch(part.name, shape, points, scale)[0]))] * frames)
    if isinstance(part, Wall) and hollow:
        return _moving([list(hatched(outline[0]))] * frames)
    thin = shape is None or isinstance(shape, Line)
    filled = None if hollow or thin else LIGHT_GREY
    found: list[list[Piece]] = [[Stroke(each, INK, 2.6 if thin else 1.5, str(part), filled) for each in outline]]
    if isinstance(part, Wall):
        return found
    if isinstance(shape, Disk):
        spokes = scale * motion.points(part.name, [(0.0, 0.0), (shape.R, 0.0)])
        found.append([Stroke(each, INK, 1.0, f"spoke of {part}") for each in spokes])
    middle = scale * motion.places[part.name][:, :2]
    found.append([Stroke(dot(each), INK, 0.0, fill=INK, zorder=4.0) for each in middle])
    # The name stands beside a rod, and above what has an area.
    across = shape.normal if isinstance(shape, Line) else (0.0, 1.0)
    names = np.column_stack([middle[:, 0], outline[..., 1].max(axis=1) + 0.3])
    if thin:
        names = middle + 0.4 * (motion.points(part.name, [across])[:, 0] - motion.places[part.name][:, :2])
    found.append([Label(math_text(part.name), each, np.zeros(2)) for each in names])
    return found


def _joint(motion: PlaneMotion, joint: Pin | Guide, scale: float) -> list[list[Piece]]:
    """Return the pieces of a joint, each over all frames."""
    places = scale * motion.points(joint.a, [joint.p])
    found: list[list[Piece]] = []
    if isinstance(joint, Guide):
        track = scale * motion.stretch(joint.b, joint.line, places / scale, scale)
        found.append([Stroke(each, GREY, 1.2, str(joint), zorder=2.5) for each in track])
    elif not motion.moves(joint.b):
        foot = scale * motion.points(joint.b, [joint.q])[0, 0]
        support = [Stroke(foot + SUPPORT, INK, 1.2), *hatched(foot + np.array([[-0.45, -0.45], [0.45, -0.45]]))]
        found += _moving([support] * len(places))
    return [*found, [Stroke(dot(each[0], 0.13), INK, 1.3, str(joint), "white", zorder=4.5) for each in places]]


def _scale_bars(scale: float, unit: str, arrows: Iterable[tuple[float, str, str]], start: Array) -> Iterator[Piece]:
    """Yield a bar of a round length, and an arrow of a round force and of a round impulse, side by side."""
    metres = round_below(1.6 / scale)
    text = length_text(metres) if unit == "m" else f"{metres:g} {unit}".rstrip()
    bar = np.array([[0.0, 0.12], [0.0, -0.12], [0.0, 0.0], [1.0, 0.0], [1.0, 0.12], [1.0, -0.12]])
    yield Stroke(start + bar * [metres * scale, 1.0], GREY, 1.2, cap="butt")
    end = start + metres * scale * RIGHT
    yield Label(text, end, RIGHT, GREY, 10.0)
    for length, unit_of_arrow, color in arrows:
        tail = end + (width(text) + 0.6) * RIGHT
        value = round_below(1.6 / length)
        text = f"{value:g} {unit_of_arrow}".rstrip()
        end = tail + value * length * RIGHT
        yield from arrow(tail, end, color)
        yield Label(text, end, RIGHT, color, 10.0)
