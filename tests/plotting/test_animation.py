"""Moving pictures: what is drawn stands where the run is, and the files are whole and play as long as was asked."""

from __future__ import annotations

import base64
import io
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from lagrangian_names import LAGRANGIAN
from PIL import Image

import lcpimpact
from lcpimpact import (
    Bumper,
    Dashpot,
    Harmonic,
    InputError,
    LinearComplementaritySystem,
    Load,
    Mass,
    PrescribedMotion,
    Problem,
    Rope,
    Scheme,
    Slider,
    Spring,
    Trajectory,
    UnsupportedError,
)
from lcpimpact.plotting import animation
from lcpimpact.plotting.animation import Film, animate, lay_out_motion
from lcpimpact.plotting.layout import CEILING
from lcpimpact.plotting.schematic import Label, Stroke, extent, picture
from lcpimpact.plotting.style import style
from lcpimpact.problems import PROBLEMS


@pytest.fixture(scope="module")
def fall() -> Trajectory:
    return lcpimpact.simulate(lcpimpact.load_problem("system-3"), "exact", dt=1e-2, t_end=3.0)


@pytest.fixture(scope="module")
def ball() -> Trajectory:
    return lcpimpact.simulate(lcpimpact.load_problem("bouncing-ball"), "exact", dt=1e-2, t_end=1.5)


def run(scheme: Scheme, t_end: float = 2.0, method: str = "moreau-jean", **initial: Any) -> Trajectory:
    return lcpimpact.simulate(Problem("tried", scheme, **initial), method, dt=1e-2, t_end=t_end)


def strokes(pieces: list[Any], kind: str) -> list[np.ndarray]:
    return [piece.points for piece in pieces if isinstance(piece, Stroke) and piece.label.startswith(f"{kind} ")]


def heights(lines: list[np.ndarray]) -> list[float]:
    """Return the heights of the lines that run across."""
    return sorted(float(line[0, 1]) for line in lines if len(line) == 2 and line[0, 1] == pytest.approx(line[1, 1]))


# --- where everything stands -------------------------------------------------------------------------------------------


def test_nodes_move_down_by_their_coordinates_at_one_scale(fall: Trajectory) -> None:
    times = np.linspace(0.0, 3.0, 40)
    layout, postures = lay_out_motion(fall, times)
    q = fall.sample(times).q
    for i, node in enumerate(fall.problem.dynamics.nodes):
        y = np.array([posture.y[node] for posture in postures])
        np.testing.assert_allclose(y, layout.y[node] - layout.scale * q[:, i], rtol=0.0, atol=1e-12)
    assert all(posture.y["ground"] == 0.0 for posture in postures)


def test_the_plates_of_a_bumper_are_as_far_apart_as_its_gap_is_open(fall: Trajectory) -> None:
    times = np.linspace(0.0, 3.0, 40)
    layout, postures = lay_out_motion(fall, times)
    u = fall.problem.dynamics.gap(times, fall.sample(times).q)[:, 0]
    assert u.max() > 1.0
    for posture, opening in zip(postures, u, strict=True):
        lower, upper = heights(strokes(list(picture(layout, posture)), "Bumper"))
        assert upper - lower == pytest.approx(layout.scale * opening, abs=1e-9)


def test_a_stop_above_opens_as_the_mass_moves_down() -> None:
    scheme = Scheme(
        Mass("x", 1.0), Load("x", 1.0), Spring("x", "ground", 40.0), Bumper("ground", "x", gap=0.1, e=0.9, name="R_2"),
        Bumper("x", "ground", gap=0.2, e=0.5),
    )  # fmt: skip
    trajectory = run(scheme, method="exact", v0={"x": -2.0})
    times = np.linspace(0.0, 2.0, 50)
    layout, postures = lay_out_motion(trajectory, times)
    x = trajectory.sample(times).q[:, 0]
    for posture, place in zip(postures, x, strict=True):
        pieces = [p for p in picture(layout, posture) if isinstance(p, Stroke) and p.label.startswith("Bumper")]
        above = [p.points for p in pieces if "'ground' and 'x'" in p.label]
        below = [p.points for p in pieces if "'x' and 'ground'" in p.label]
        lower, upper = heights(above)
        assert upper - lower == pytest.approx(layout.scale * (0.1 + place), abs=1e-9)
        lower, upper = heights(below)
        assert upper - lower == pytest.approx(layout.scale * (0.2 - place), abs=1e-9)
        assert posture.y[CEILING] == layout.y[CEILING] > posture.y["x"]


@pytest.mark.parametrize(
    "element", [Dashpot("x", "ground", 0.3), Dashpot("ground", "x", 0.3), Slider("x", "ground", 0.5)]
)
def test_what_moves_in_a_case_stays_in_it_and_out_of_the_bodies(element: Any) -> None:
    trajectory = run(Scheme(Mass("x", 1.0), Spring("x", "ground", 20.0), element), q0={"x": 1.0})
    layout, postures = lay_out_motion(trajectory, np.linspace(0.0, 2.0, 60))
    depths = []
    for posture in postures:
        pieces = list(picture(layout, posture))
        lines = strokes(pieces, type(element).__name__)
        # The case is the line of four points, or of two that run upright; what moves in it lies across, or is filled.
        first = lines[1][:, 1]
        case = lines[2][:, 1]
        assert case.min() - 1e-9 <= first.min() <= first.max() <= case.max() + 1e-9
        every = np.concatenate([line[:, 1] for line in lines])
        assert every.min() >= -1e-9
        assert every.max() <= layout.edge(posture.y, "x", -1) + 1e-9
        depths.append(first.mean() - case.mean())
    assert np.ptp(depths) == pytest.approx(
        layout.scale * np.ptp(trajectory.sample(np.linspace(0.0, 2.0, 60)).q), rel=1e-9
    )


@pytest.mark.parametrize("name", ["system-1", "system-2", "system-3"])
def test_springs_never_fold(name: str) -> None:
    trajectory = lcpimpact.simulate(lcpimpact.load_problem(name), "exact", dt=1e-2, t_end=3.0)
    layout, postures = lay_out_motion(trajectory, np.linspace(0.0, 3.0, 60))
    for posture in postures:
        for spring in strokes(list(picture(layout, posture)), "Spring"):
            assert (np.diff(spring[:, 1]) < 0.0).all()
            assert np.ptp(spring[:, 1]) > 1.0


def test_a_rope_is_straight_when_it_is_taut() -> None:
    scheme = Scheme(Mass("x", 1.0), Load("x", 9.81), Rope("ground", "x", slack=0.5, e=0.0))
    trajectory = run(scheme, 1.0, "exact")
    times = np.linspace(0.0, 1.0, 30)
    layout, postures = lay_out_motion(trajectory, times)
    x = trajectory.sample(times).q[:, 0]
    assert x[-1] == pytest.approx(0.5, abs=1e-9)
    for posture, place in zip(postures, x, strict=True):
        (rope,) = strokes(list(picture(layout, posture)), "Rope")
        sag = np.ptp(rope[:, 0])
        assert (sag < 1e-3) == (place > 0.5 - 1e-9)
        assert np.ptp(rope[:, 1]) > 0.0


def test_a_bar_shows_the_motion_inside_it() -> None:
    bar = lcpimpact.Bar("a", "b", E=900.0, A=1.0, rho=1.0, L=10.0, elements=24, massless="b")
    scheme = Scheme(bar, Bumper("b", "ground", gap=1.0))
    names = scheme.assemble().nodes
    trajectory = lcpimpact.simulate(
        Problem("bar", scheme, v0=dict.fromkeys(names, 10.0)), "moreau-jean", dt=5e-3, t_end=0.4
    )
    times = np.linspace(0.0, 0.4, 20)
    layout, postures = lay_out_motion(trajectory, times)
    q = dict(zip(names, trajectory.sample(times).q.T, strict=True))
    for i, posture in enumerate(postures):
        lines = strokes(list(picture(layout, posture)), "Bar")
        block = next(line for line in lines if len(line) == 5)
        # At the two ends of the block, and at the mark in its middle, stand the joints of the bar.
        stretch = q["b"][i] - q["a"][i]
        assert np.ptp(block[:, 1]) - np.ptp(_block_at_rest(layout)) == pytest.approx(layout.scale * stretch, abs=1e-9)
        marks = heights(lines)
        middle = layout.scale * (q[bar.joints[12]][i] - q["a"][i])
        at_rest = heights(strokes(list(picture(layout, postures[0])), "Bar"))
        moved = layout.scale * (q["a"][i] - q["a"][0])
        assert marks[len(marks) // 2] == pytest.approx(at_rest[len(marks) // 2] - moved - middle, abs=1e-6)


def _block_at_rest(layout: Any) -> np.ndarray:
    from lcpimpact.plotting.schematic import at_rest

    return next(line for line in strokes(list(picture(layout, at_rest(layout))), "Bar") if len(line) == 5)[:, 1]


def test_a_plate_whose_motion_is_given_moves_with_it() -> None:
    scheme = Scheme(
        Mass("x", 1.0), Load("x", 9.81), Bumper("x", "table", gap=0.1, e=0.5),
        PrescribedMotion("table", Harmonic(0.05, 20.0)),
    )  # fmt: skip
    trajectory = run(scheme, 1.0)
    times = trajectory.t[::4]
    layout, postures = lay_out_motion(trajectory, times)
    y = np.array([posture.y["table"] for posture in postures])
    np.testing.assert_allclose(y, layout.y["table"] - layout.scale * 0.05 * np.cos(20.0 * times), rtol=0.0, atol=1e-9)


def test_the_largest_relative_displacement_sets_the_scale(fall: Trajectory) -> None:
    layout, _ = lay_out_motion(fall, np.linspace(0.0, 3.0, 100))
    q = fall.sample(np.linspace(0.0, 3.0, 100)).q
    apart = [np.ptp(q[:, 0] - q[:, 1]), np.ptp(q[:, 1] - q[:, 2]), np.ptp(q[:, 2])]
    assert layout.scale == pytest.approx(animation.MAX_TRAVEL / max(apart), rel=1e-12)


def test_a_scheme_at_rest_is_animated_too() -> None:
    trajectory = run(Scheme(Mass("x", 1.0), Spring("x", "ground", 1.0)), 0.1)
    layout, postures = lay_out_motion(trajectory, np.linspace(0.0, 0.1, 3))
    assert layout.scale == 1.0
    assert postures[0].y == postures[-1].y


def test_reactions_press_and_impulses_flash(fall: Trajectory, ball: Trajectory) -> None:
    times = np.linspace(0.0, 3.0, 400)
    pressed = np.array([posture.pressed["R"] for posture in lay_out_motion(fall, times)[1]])
    R = fall.sample(times).reaction[:, 0]
    np.testing.assert_allclose(pressed, R / max(R.max(), fall["R"].max()), rtol=1e-12, atol=1e-15)
    times = np.linspace(0.0, 1.5, 240)
    pressed = np.array([posture.pressed["R"] for posture in lay_out_motion(ball, times)[1]])
    first = next(event.t for event in ball.events)
    assert pressed[times < first].max() == 0.0
    assert pressed[np.searchsorted(times, first)] == 1.0


QUICK = ("system-2", "bouncing-ball", "vibrating-table", "newtons-cradle", "coulomb-oscillator")


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=() if name in QUICK else pytest.mark.slow)
        for name in PROBLEMS
        if name not in LAGRANGIAN
    ],
)
def test_every_frame_has_the_same_pieces_within_the_picture(name: str) -> None:
    problem = lcpimpact.load_problem(name)
    trajectory = lcpimpact.simulate(problem, "moreau-jean", dt=problem.t_end / 500, t_end=problem.t_end)
    times = np.linspace(0.0, problem.t_end, 30)
    with style():
        film = Film.of(trajectory, times, 1.0)
    if not isinstance(problem.scheme, Scheme):
        assert not any(film._scenes)
        return
    drawing = film.figure.axes[0]
    kinds = [[type(piece) for piece in scene] for scene in film._scenes]
    assert all(each == kinds[0] for each in kinds)
    for scene in film._scenes:
        left, right, low, high = extent(scene)
        assert drawing.get_xlim()[0] <= left <= right <= drawing.get_xlim()[1] + 1e-9
        assert drawing.get_ylim()[0] <= low + 1e-9 <= high <= drawing.get_ylim()[1] + 1e-9


# --- the frames --------------------------------------------------------------------------------------------------------


def test_the_curves_grow_up_to_the_time_that_is_written(fall: Trajectory) -> None:
    times = np.linspace(0.0, 3.0, 7)
    with style():
        film = Film.of(fall, times, 6.0)
        for i, t in enumerate(times):
            film.show(i)
            assert film._clock.get_text() == f"$t$ = {t:.1f} s"
            for panel, grown, marks in film._growing:
                past = panel.t <= t
                for j, (line, mark) in enumerate(zip(grown, marks, strict=True)):
                    np.testing.assert_array_equal(line.get_xdata(), panel.t[past])
                    np.testing.assert_array_equal(line.get_ydata(), panel.values[past, j])
                    assert list(mark.get_xdata()) == [t]
    text = " ".join(each.get_text() for each in film.figure.texts)
    assert "slowed down 2 times" in text
    assert "system-3 by exact" in text


def test_the_right_limit_is_shown_where_a_force_jumps(fall: Trajectory) -> None:
    event = next(event for event in fall.events if event.kind == "close")
    assert event.left.reaction[0] == pytest.approx(0.0, abs=1e-9)
    with style():
        film = Film.of(fall, np.array([0.0, event.t]), 1.0)
        film.show(1)
    panel, _, (mark,) = film._growing[1]
    assert panel.label == "reaction [N]"
    assert mark.get_ydata()[0] == pytest.approx(event.right.reaction[0], rel=1e-9)
    assert event.right.reaction[0] > 100.0
    posture = lay_out_motion(fall, np.array([0.0, event.t]))[1][1]
    assert posture.pressed["R"] == pytest.approx(event.right.reaction[0] / fall["R"].max(), rel=1e-2)


def test_what_does_not_move_is_painted_once_and_what_moves_is_painted_anew(fall: Trajectory) -> None:
    with style():
        film = Film.of(fall, np.linspace(0.0, 3.0, 4), 1.0)
        frames = [np.asarray(frame) for frame in film.frames()]
        again = [np.asarray(frame) for frame in film.frames()]
    for one, other in zip(frames, again, strict=True):
        np.testing.assert_array_equal(one, other)
    assert len({frame.tobytes() for frame in frames}) == 4
    height, width, _ = frames[0].shape
    assert height % 2 == width % 2 == 0
    # Nothing of an earlier frame stays: the frames shown in another order are the same.
    with style():
        film.show(3)
        back = list(film.frames([2, 0]))
    for found, expected in zip(back, (frames[2], frames[0]), strict=True):
        np.testing.assert_array_equal(np.asarray(found), expected)


def test_impulses_stand_in_the_place_of_a_reaction_that_is_nothing_else(ball: Trajectory) -> None:
    contents = animation._panels_with_impulses(ball)
    assert [panel.label for panel in contents] == ["$x$ [m], downwards", "impulse [N s]"]
    needles = contents[1]
    tips = needles.values[1::3, 0]
    np.testing.assert_allclose(tips, [event.impulse for event in ball.events], rtol=1e-12)
    assert np.isnan(needles.values[2::3]).all()


def test_a_system_given_by_its_matrices_shows_its_block_diagram(tmp_path: Path) -> None:
    system = LinearComplementaritySystem([[0.0]], [[1.0]], [[1.0]], a=[-1.0])
    trajectory = lcpimpact.simulate(Problem("tank", system, q0={"x1": 1.0}), "moreau-jean", dt=1e-2, t_end=2.0)
    with style():
        film = Film.of(trajectory, np.linspace(0.0, 2.0, 3), 1.0)
    assert any("perp" in text.get_text() for text in film.figure.axes[0].texts)
    assert animate(trajectory, tmp_path / "tank.gif", seconds=0.2, fps=10).exists()


def test_labels_keep_to_words_and_lines() -> None:
    assert animation.length_text(0.5) == "0.5 m"
    assert animation.length_text(0.05) == "50 mm"
    assert animation.length_text(2e-5) == "20 µm"
    assert animation.round_below(3.9) == 2.0
    assert animation.round_below(0.05) == pytest.approx(0.05)
    assert animation._round3(77_400.0) == "77,000"
    assert animation._round3(2.667) == "2.67"
    assert Label("x", np.zeros(2), np.array([1.0, 0.0])).place[0] > 0.0


# --- the files ---------------------------------------------------------------------------------------------------------


def test_a_gif_plays_as_long_as_was_asked(fall: Trajectory, tmp_path: Path) -> None:
    path = fall.animate(tmp_path / "run.gif", seconds=1.0, fps=30)
    with Image.open(path) as gif:
        assert gif.n_frames == 30
        lasts = []
        for i in range(gif.n_frames):
            gif.seek(i)
            lasts.append(gif.info["duration"])
    assert set(lasts[:-1]) == {30, 40}
    assert sum(lasts[:-1]) == pytest.approx(1000.0 * 29 / 30, abs=10.0)
    assert lasts[-1] == 1000
    assert [each.name for each in tmp_path.iterdir()] == ["run.gif"]


def test_few_colors_keep_white_white_and_the_colours_of_the_lines(fall: Trajectory) -> None:
    with style():
        film = Film.of(fall, np.linspace(0.0, 3.0, 5), 1.0)
        whole = list(film.frames())
        small = [np.asarray(frame.convert("RGB"), dtype=int) for frame in animation._quantized_frames(film)]
    for one, other in zip(whole, small, strict=True):
        full = np.asarray(one, dtype=int)
        assert (other[(full == 255).all(axis=2)] == 255).all()
        assert np.abs(full - other).max() < 64
        assert np.abs(full - other).mean() < 0.5


def test_a_page_of_html_needs_nothing_else(fall: Trajectory, tmp_path: Path) -> None:
    path = fall.animate(tmp_path / "run.html", seconds=0.5, fps=10)
    text = path.read_text(encoding="utf-8")
    assert "://" not in text
    assert "<title>system-3 by exact</title>" in text
    found = re.findall(r'"(iVBOR[^"]+)"', text)
    assert len(found) == 5
    sizes = {Image.open(io.BytesIO(base64.b64decode(each))).size for each in found}
    assert len(sizes) == 1
    assert "const fps = 10;" in text


def test_the_same_run_gives_the_same_bytes(fall: Trajectory, tmp_path: Path) -> None:
    for ending in ("gif", "html"):
        once, again = (fall.animate(tmp_path / f"{name}.{ending}", seconds=0.3, fps=10) for name in ("a", "b"))
        assert once.read_bytes() == again.read_bytes()


class _Writer:
    """Stands for ffmpeg: keeps what it is given."""

    taken: list[Any]

    def __init__(self, fps: int, metadata: dict[str, str]) -> None:
        self.fps = fps

    @staticmethod
    def isAvailable() -> bool:
        return True

    @contextmanager
    def saving(self, figure: Any, path: str, dpi: float) -> Iterator[None]:
        self.figure, self.path, type(self).taken = figure, path, []
        yield
        Path(path).write_bytes(b"film")

    def grab_frame(self) -> None:
        type(self).taken.append(self.figure.texts[-1].get_text())


def test_an_mp4_is_left_to_ffmpeg_frame_by_frame(
    fall: Trajectory, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(animation, "FFMpegWriter", _Writer)
    path = fall.animate(tmp_path / "run.mp4", seconds=0.4, fps=10)
    assert path.read_bytes() == b"film"
    assert _Writer.taken == [f"$t$ = {t:.0f} s" for t in (0.0, 1.0, 2.0, 3.0)]


def test_without_ffmpeg_an_mp4_is_refused_with_the_remedy(
    fall: Trajectory, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(animation.FFMpegWriter, "isAvailable", classmethod(lambda cls: False))
    with pytest.raises(UnsupportedError, match=r"install ffmpeg, or write .gif or .html"):
        fall.animate(tmp_path / "run.mp4")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"seconds": 0.0}, "seconds = 0.0 must be a positive finite number"),
        ({"seconds": float("nan")}, "must be a positive finite number"),
        ({"fps": 0}, "fps = 0 must be a whole number"),
        ({"fps": 2.5}, "fps = 2.5 must be a whole number"),
        ({"seconds": 0.01}, "make 0 frames"),
        ({"seconds": 1e6}, "change one of them"),
    ],
)
def test_what_makes_no_film_is_refused(fall: Trajectory, tmp_path: Path, options: dict[str, Any], said: str) -> None:
    with pytest.raises(InputError, match=said):
        fall.animate(tmp_path / "run.gif", **options)
    assert not list(tmp_path.iterdir())


def test_another_ending_and_a_missing_folder_are_refused(fall: Trajectory, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"\.gif, \.mp4, \.html"):
        fall.animate(tmp_path / "run.avi")
    with pytest.raises(InputError, match="cannot write"):
        fall.animate(tmp_path / "missing" / "run.gif")


def test_a_run_without_steps_is_refused(fall: Trajectory, tmp_path: Path) -> None:
    empty = Trajectory(
        fall.problem, fall.method, fall.t[:1], fall.q[:1], fall.v[:1], fall.t_reaction[:0], fall.reaction[:0], (),
        lcpimpact.Status.NON_FINITE, "stopped", fall.certificate, fall.stats,
    )  # fmt: skip
    with pytest.raises(InputError, match="without steps does not move"):
        animate(empty, tmp_path / "run.gif")


@pytest.mark.slow
def test_pyplot_stays_out(python: Any) -> None:
    code = """
import json, sys, tempfile
import lcpimpact
run = lcpimpact.simulate(lcpimpact.load_problem("system-1"), dt=1e-2, t_end=0.1)
with tempfile.TemporaryDirectory() as folder:
    run.animate(folder + "/run.gif", seconds=0.2, fps=10)
print(json.dumps("matplotlib.pyplot" in sys.modules))
"""
    assert python(code) is False
