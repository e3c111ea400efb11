"""Moving pictures of bodies: shapes stand where the run is, and arrows are the reactions and impulses on each body."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import lcpimpact as li
from lcpimpact.plotting.animation import Film, _shown_impacts
from lcpimpact.plotting.plane import IMPULSE_COLOR, LONGEST_ARROW, ContactForce, PlaneMotion, lay_out_plane
from lcpimpact.plotting.schematic import FORCE_COLOR, Stroke, extent
from lcpimpact.plotting.style import style

g = 9.81
CORNERS = [(-0.1, -0.2), (0.1, -0.2), (0.1, 0.2), (-0.1, 0.2)]
FLOOR = li.Wall("floor", li.Line((0.0, 0.0), (1.0, 0.0)))
WEIGHT = {"m": 1.0, "g": g}


def ball() -> li.Problem:
    """A ball that slips on the floor before it rolls."""
    body = li.Body("ball", J=0.004, shape=li.Disk(0.1), **WEIGHT)
    scheme = li.Scheme(FLOOR, body, li.Touch("ball", "floor", e=0.0, mu=0.3))
    return li.Problem("ball", scheme, q0={"ball.y": 0.1}, v0={"ball.x": 2.0, "ball.φ": 3.0}, t_end=0.15)


def block() -> li.Problem:
    """A block that turns about its right lower corner."""
    body = li.Body("block", J=0.05 / 3, shape=li.Polygon(CORNERS), **WEIGHT)
    scheme = li.Scheme(FLOOR, body, li.Touch("block", "floor", e=0.0, mu=0.8))
    start = {"block.φ": -2.2, "block.x": 0.44, "block.y": 0.22}
    return li.Problem("block", scheme, q0={"block.y": 0.2}, v0=start, t_end=0.3)


def stack() -> li.Problem:
    """A disc that rolls off another one, which lies on a floor that slopes."""
    slope = li.Wall("slope", li.Line((0.0, 0.0), (1.0, 0.1)))
    under = li.Body("under", J=0.01, shape=li.Disk(0.2), **WEIGHT)
    above = li.Body("above", J=0.002, shape=li.Disk(0.1), m=0.5, g=g)
    scheme = li.Scheme(
        slope, under, above, li.Touch("under", "slope", e=0.0, mu=0.4), li.Touch("under", "above", e=0.0, mu=0.4)
    )
    y = 0.2 * np.hypot(1.0, 0.1)
    q0 = {"under.y": y, "above.x": 0.3 * np.sin(0.2), "above.y": y + 0.3 * np.cos(0.2)}
    return li.Problem("stack", scheme, q0=q0, t_end=0.1)


def bowl() -> li.Problem:
    """A disc in a bowl that stands beside the origin."""
    wall = li.Wall("bowl", li.Disk(1.0, hollow=True), x=0.4, y=0.3)
    body = li.Body("disc", J=0.005, shape=li.Disk(0.1), **WEIGHT)
    scheme = li.Scheme(wall, body, li.Touch("disc", "bowl", e=0.0, mu=0.5))
    q0 = {"disc.x": 0.4 + 0.9 * np.sin(1.0), "disc.y": 0.3 - 0.9 * np.cos(1.0)}
    return li.Problem("bowl", scheme, q0=q0, t_end=0.5)


def plank() -> li.Problem:
    """A plank that tips over a peg: the wall is the disc, and the body the line."""
    peg = li.Wall("peg", li.Disk(0.1))
    body = li.Body("plank", J=0.1, shape=li.Line((0.5, 0.0), (-0.5, 0.0)), **WEIGHT)
    scheme = li.Scheme(peg, body, li.Touch("peg", "plank", e=0.0, mu=0.6))
    return li.Problem("plank", scheme, q0={"plank.x": 0.1, "plank.y": 0.1}, t_end=0.2)


def meeting() -> li.Problem:
    """Two discs that meet."""
    scheme = li.Scheme(
        li.Body("a", m=1.0, J=0.005, shape=li.Disk(0.1)),
        li.Body("b", m=2.0, J=0.02, shape=li.Disk(0.15)),
        li.Touch("a", "b", e=0.7, mu=0.3),
    )
    return li.Problem("meeting", scheme, q0={"b.x": 0.8, "b.y": 0.1}, v0={"a.x": 1.5, "a.φ": 3.0}, t_end=0.6)


def pendulum() -> li.Problem:
    """A rod on a pin, and a bead that slides on the rod."""
    rod = li.Body("rod", J=1.0 / 12.0, shape=li.Line((0.0, 0.5), (0.0, -0.5)), **WEIGHT)
    bead = li.Body("bead", m=0.2, J=0.01, g=g)
    guide = li.Guide("bead", (0.0, 0.0), li.Line((0.0, 0.0), (0.0, 1.0)), b="rod")
    q0 = {"rod.φ": 0.6, "rod.x": 0.5 * np.sin(0.6), "rod.y": -0.5 * np.cos(0.6)}
    bead_at = {"bead.x": 0.2 * np.sin(0.6), "bead.y": -0.2 * np.cos(0.6)}
    return li.Problem("pendulum", li.Scheme(rod, bead, li.Pin("rod", (0.0, 0.5)), guide), q0=q0 | bead_at, t_end=0.5)


@cache
def run(build: Any, method: str = "moreau-jean") -> li.Trajectory:
    problem = build()
    return li.simulate(problem, method, dt=5e-4, t_end=problem.t_end)


def acting(trajectory: li.Trajectory, times: np.ndarray) -> list[ContactForce]:
    return PlaneMotion.of(trajectory, times).contact_forces(list(_shown_impacts(trajectory, times)))


def outlines(scenes: list[list[Any]], label: str) -> np.ndarray:
    """Return the points of the line of a label over all frames."""
    return np.array(
        [next(each.points for each in scene if isinstance(each, Stroke) and each.label == label) for scene in scenes]
    )


def arrows(scene: list[Any], color: str) -> list[np.ndarray]:
    """Return tail and tip of the arrows of a colour, without the last, which is the scale."""
    lines = [each for each in scene if isinstance(each, Stroke) and each.color == color]
    return [np.array([shaft.points[0], head.points[0]]) for shaft, head in zip(lines[::2], lines[1::2], strict=True)][
        :-1
    ]


# --- where everything stands -------------------------------------------------------------------------------------------


def test_the_corners_of_a_block_stand_where_its_coordinates_say() -> None:
    trajectory = run(block)
    times = np.linspace(0.0, 0.3, 7)
    scale, scenes = lay_out_plane(trajectory, times, [])
    x, y, φ = trajectory.sample(times).q.T
    assert np.ptp(φ) > 0.15
    found = outlines(scenes, "Body 'block'")
    for i, (a, b) in enumerate([*CORNERS, CORNERS[0]]):
        corner = x + a * np.cos(φ) - b * np.sin(φ), y + a * np.sin(φ) + b * np.cos(φ)
        np.testing.assert_allclose(found[:, i], scale * np.column_stack(corner), rtol=0.0, atol=1e-12)


def test_the_spoke_of_a_disc_turns_with_it() -> None:
    trajectory = run(ball)
    times = np.linspace(0.0, 0.15, 9)
    scale, scenes = lay_out_plane(trajectory, times, [])
    x, y, φ = trajectory.sample(times).q.T
    assert np.ptp(φ) > 0.3
    spoke = outlines(scenes, "spoke of Body 'ball'")
    np.testing.assert_allclose(spoke[:, 0], scale * np.column_stack([x, y]), atol=1e-12)
    np.testing.assert_allclose(
        spoke[:, 1], scale * np.column_stack([x + 0.1 * np.cos(φ), y + 0.1 * np.sin(φ)]), atol=1e-12
    )
    rim = outlines(scenes, "Body 'ball'") - spoke[:, :1]
    np.testing.assert_allclose(np.hypot(rim[..., 0], rim[..., 1]), 0.1 * scale, rtol=1e-12)


def test_joints_stand_on_both_of_their_bodies() -> None:
    trajectory = run(pendulum)
    times = np.linspace(0.0, 0.5, 9)
    scale, scenes = lay_out_plane(trajectory, times, [])
    q = dict(zip(trajectory.nodes, trajectory.sample(times).q.T, strict=True))
    assert np.ptp(q["bead.y"]) > 0.3
    for i, scene in enumerate(scenes):
        slot, ring = (e.points for e in scene if isinstance(e, Stroke) and e.label == "Guide between 'bead' and 'rod'")
        rod = np.array([np.sin(q["rod.φ"][i]), -np.cos(q["rod.φ"][i])])
        assert slot @ [-rod[1], rod[0]] == pytest.approx(np.zeros(2), abs=1e-3)
        bead = scale * np.array([q["bead.x"][i], q["bead.y"][i]])
        np.testing.assert_allclose(ring[:-1].mean(axis=0), bead, atol=1e-9)
        assert min(slot @ rod) < bead @ rod < max(slot @ rod)
    pin = outlines(scenes, "Pin between 'rod' and 'ground'")
    np.testing.assert_allclose(pin[:, :-1].mean(axis=1), 0.0, atol=1e-12)


def test_a_wall_is_hatched_on_the_side_that_is_not_free() -> None:
    _, scenes = lay_out_plane(run(ball), np.array([0.0, 0.15]), [])
    line, hatch = scenes[0][:2]
    assert (line.points[:, 1] == 0.0).all()
    depths = hatch.points[np.isfinite(hatch.points[:, 1]), 1]
    assert depths.min() < -0.3
    assert depths.max() == pytest.approx(0.0, abs=1e-12)
    _, scenes = lay_out_plane(run(bowl), np.array([0.0, 0.5]), [])
    scale, _ = lay_out_plane(run(bowl), np.array([0.0, 0.5]), [])
    ends = scenes[0][1].points - scale * np.array([0.4, 0.3])
    radii = np.hypot(*ends[np.isfinite(ends[:, 0])].T) / scale
    assert radii.min() > 0.998
    assert radii.max() > 1.03


# --- forces ------------------------------------------------------------------------------------------------------------


def test_the_arrow_at_a_ball_is_its_reaction_and_friction_at_one_scale() -> None:
    trajectory = run(ball)
    times = 0.5 * (trajectory.t[20:-1:40] + trajectory.t[21::40])
    scale, scenes = lay_out_plane(trajectory, times, [])
    state = trajectory.sample(times)
    N, T = state.reaction.T
    assert T.min() < -2.5
    for i, scene in enumerate(scenes):
        ((tail, tip),) = arrows(scene, FORCE_COLOR)
        assert tail == pytest.approx(scale * np.array([state.q[i, 0], 0.0]), abs=1e-9)
        assert tip - tail == pytest.approx(LONGEST_ARROW * np.array([T[i], N[i]]) / np.hypot(N, T).max(), abs=1e-9)


@pytest.mark.parametrize("build", [ball, block, stack, bowl, plank], ids=lambda build: build.__name__)
def test_the_forces_on_each_body_are_what_moves_and_turns_it(build: Any) -> None:
    """m a = m g + F and J ω' = r x F in the middle of steps, with the accelerations as differences of the velocities."""
    trajectory = run(build)
    steps = slice(40, -1, 10)
    times = (0.5 * (trajectory.t[1:] + trajectory.t[:-1]))[steps]
    found = acting(trajectory, times)
    rates = (np.diff(trajectory.v, axis=0) / np.diff(trajectory.t)[:, None])[steps]
    q = trajectory.sample(times).q
    for k, body in enumerate(each for each in trajectory.problem.scheme.elements if isinstance(each, li.Body)):
        own = [each for each in found if each.body == body.name]
        force = sum(each.force for each in own)
        arms = [each.point - q[:, 3 * k : 3 * k + 2] for each in own]
        moment = sum(r[:, 0] * c.force[:, 1] - r[:, 1] * c.force[:, 0] for r, c in zip(arms, own, strict=True))
        most = np.abs(force).max()
        assert most > 1.0
        expected = body.m * (rates[:, 3 * k : 3 * k + 2] + [0.0, body.g])
        np.testing.assert_allclose(force, expected, atol=2e-3 * most)
        np.testing.assert_allclose(moment, body.J * rates[:, 3 * k + 2], atol=2e-3 * 0.1 * most)


def test_an_impulse_acts_on_both_bodies_and_fades() -> None:
    trajectory = run(meeting, "event-driven")
    event = trajectory.events[0]
    times = np.sort(np.append(np.linspace(0.0, 0.6, 240), event.t))
    impacts = list(_shown_impacts(trajectory, times))
    scale, scenes = lay_out_plane(trajectory, times, impacts)
    a, b = acting(trajectory, times)
    i = int(np.searchsorted(times, event.t))
    gained = event.right.v - event.left.v
    assert a.impulse[i] == pytest.approx(1.0 * gained[:2], rel=1e-9)
    assert b.impulse[i] == pytest.approx(2.0 * gained[3:5], rel=1e-9)
    apart = event.left.q[3:5] - event.left.q[:2]
    touch = event.left.q[:2] + 0.1 * apart / np.hypot(*apart)
    assert a.point[i] == pytest.approx(touch, abs=1e-9)
    r = a.point[i] - event.left.q[:2]
    assert r[0] * a.impulse[i, 1] - r[1] * a.impulse[i, 0] == pytest.approx(0.005 * gained[2], rel=1e-8)
    ends = arrows(scenes[i], IMPULSE_COLOR)
    assert [np.hypot(*(tip - tail)) for tail, tip in ends] == pytest.approx([LONGEST_ARROW] * 2)
    assert ends[0][0] == pytest.approx(scale * a.point[i])
    assert not np.abs(a.impulse[: i - 1]).any()
    assert not np.abs(a.impulse[times > event.t + 0.15 / 8.0 * 0.6]).any()


# --- the film ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "build", [ball, block, stack, bowl, plank, meeting, pendulum], ids=lambda build: build.__name__
)
def test_every_frame_has_the_same_pieces_within_the_picture(build: Any) -> None:
    trajectory = run(build)
    with style():
        film = Film.of(trajectory, np.linspace(0.0, trajectory.t[-1], 12), 1.0)
    drawing = film.figure.axes[0]
    kinds = [[type(piece) for piece in scene] for scene in film._scenes]
    assert all(each == kinds[0] for each in kinds)
    for scene in film._scenes:
        left, right, low, high = extent(scene)
        assert drawing.get_xlim()[0] <= left + 1e-9 <= right <= drawing.get_xlim()[1] + 1e-9
        assert drawing.get_ylim()[0] <= low + 1e-9 <= high <= drawing.get_ylim()[1] + 1e-9


def test_a_film_of_bodies_is_written(tmp_path: Path) -> None:
    path = run(meeting).animate(tmp_path / "run.gif", seconds=0.4, fps=10)
    with Image.open(path) as gif:
        assert gif.n_frames == 4
