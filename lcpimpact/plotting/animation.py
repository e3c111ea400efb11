"""Animation of a run: the moving scheme beside its curves."""

from __future__ import annotations

import base64
import io
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from pathlib import Path
from subprocess import CalledProcessError
from typing import Any

import numpy as np
from jinja2 import Environment, PackageLoader
from matplotlib.animation import FFMpegWriter
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.text import Text
from PIL import Image

from lcpimpact.arguments import checked
from lcpimpact.arrays import Array, Flags
from lcpimpact.errors import InputError, UnsupportedError
from lcpimpact.files import check_output, whole_file
from lcpimpact.numbers import count, positive
from lcpimpact.plotting.block_diagram import draw_system
from lcpimpact.plotting.layout import CEILING, Layout, sums
from lcpimpact.plotting.plane import lay_out_plane
from lcpimpact.plotting.schematic import (
    INCH,
    Label,
    Painted,
    Piece,
    Posture,
    Stroke,
    extent,
    length_text,
    paint,
    picture,
    round_below,
)
from lcpimpact.plotting.style import GREY, INK, Look, style
from lcpimpact.plotting.timeline import axis_label, impulse_label, shown_events
from lcpimpact.plotting.trajectory import Panel, draw_panel, force_names, panels, title_of
from lcpimpact.record import Event
from lcpimpact.scheme.bodies import has_bodies
from lcpimpact.scheme.elements.base import GROUND
from lcpimpact.scheme.lagrangian import Lagrangian
from lcpimpact.scheme.scheme import Scheme
from lcpimpact.trajectory import Trajectory

FORMATS = (".gif", ".mp4", ".html")

DEFAULT_SECONDS = 8.0
"""Default duration of an animation in s."""

MAX_TRAVEL = 3.6
"""Largest relative displacement in the picture, in units of the layout."""

COLOR_COUNT = 96
"""Number of colours of a GIF or of a frame in HTML, anti-aliasing included."""

MAX_FRAMES = 10_000
"""Maximum number of frames of an animation."""

DPI = 100.0
"""Pixels in an inch."""


@style()
@checked
def animate(
    trajectory: Trajectory, path: str | Path, *, seconds: float | None = None, fps: int = 30, up: bool = False
) -> Path:
    """Animate a run: the moving scheme on the left, and its coordinates and forces over time on the right.

    The frames are evenly spaced in time over the whole run; at a jump the right limit is shown. All displacements have one
    scale, chosen by the largest elongation of an element and shown by a scale bar. The arrows at a bumper are proportional
    to its reaction; an impulse is shown briefly as an arrow of maximum length.

    Bodies are drawn in the plane, x to the right and y upwards, as they stand and turn. An arrow from the point of contact
    into each of the two bodies is the reaction on it, normal force and friction together, and another one, shown briefly,
    the impulse; both have scales below. Springs, dashpots and loads on coordinates of bodies are not drawn.

    Parameters
    ----------
    trajectory : Trajectory
        Any run of at least one step.
    path : str or Path
        A file ending in .gif, .html (self-contained player) or .mp4 (requires ffmpeg).
    seconds : float, optional
        Duration in s, 8 by default.
    fps : int
        Frames per second.
    up : bool
        Whether the curves of coordinates that point downwards are heights.

    Returns
    -------
    Path
        The file, which is written atomically.

    Raises
    ------
    InputError
        For another ending, a folder that cannot be written, a run without steps, or seconds and fps that are not positive
        or give fewer than 2 or more than 10,000 frames.
    UnsupportedError
        For .mp4 where ffmpeg is not installed.

    Examples
    --------
    >>> import tempfile
    >>> from lcpimpact import load_problem, simulate
    >>> run = simulate(load_problem("system-1"), "exact", dt=1e-2, t_end=1.0)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     animate(run, f"{folder}/run.gif", seconds=0.2, fps=10).name
    'run.gif'
    """
    path = Path(path)
    check_output(path, FORMATS)
    length = DEFAULT_SECONDS if seconds is None else seconds
    positive("seconds", length, "s")
    count("fps", fps)
    frames = round(length * fps)
    if not 2 <= frames <= MAX_FRAMES:
        raise InputError(
            f"seconds = {length:g} at fps = {fps} make {frames} frames; 2 to {MAX_FRAMES} are possible: change one of them"
        )
    if len(trajectory.t) < 2:
        raise InputError("a run without steps does not move: simulate it further before it is animated")
    if path.suffix == ".mp4" and not FFMpegWriter.isAvailable():
        raise UnsupportedError("an .mp4 needs ffmpeg, which is not installed: install ffmpeg, or write .gif or .html")
    film = Film.of(trajectory, np.linspace(trajectory.t[0], trajectory.t[-1], frames), length, up=up)
    with whole_file(path) as part:
        {".gif": _write_gif, ".mp4": _write_mp4, ".html": _write_html}[path.suffix](film, part, fps)
    return path


@dataclass(frozen=True, eq=False)
class Film:
    """A figure that can show each of its frames.

    Attributes
    ----------
    figure : Figure             the figure with its moving artists
    times : (nf,) array         time of each frame in s
    scale : float               units of the layout per metre of motion
    moving : sequence of Artist artists that change from frame to frame, in painting order
    title : str                 title of the figure
    """

    figure: Figure
    times: Array
    scale: float
    moving: Sequence[Artist]
    title: str
    _scenes: list[list[Piece]]
    _artists: list[Painted]
    _growing: list[tuple[Panel, list[Line2D], list[Line2D]]]
    _clock: Text

    @classmethod
    def of(
        cls,
        trajectory: Trajectory,
        times: Array,
        seconds: float,
        *,
        up: bool = False,
        heights: tuple[float, float] = (3.8, 6.4),
        scheme_width: float = 5.0,
        curves_width: float = 5.6,
    ) -> Film:
        """Lay out the film of a run with one frame per time.

        The least and the greatest of its ``heights``, the largest width of its scheme and the width of its curves are in
        inches.
        """
        low_height, high_height = heights
        contents = _panels_with_impulses(trajectory, up=up)
        scheme = trajectory.problem.scheme
        scenes: list[list[Piece]] = [[] for _ in times]
        if isinstance(scheme, Lagrangian):
            raise UnsupportedError(
                f"{trajectory.problem.name!r} is given by its energies and gaps, which say nothing of how its bodies look: "
                "build it of Body, Wall, Touch, Pin and Guide with shapes, or draw its coordinates by run.plot()"
            )
        scale = 0.0
        left = 0.0
        right = 0.0
        low = 0.0
        high = 0.0
        in_plane = isinstance(scheme, Scheme) and has_bodies(scheme.elements)
        if isinstance(scheme, Scheme):
            if in_plane:
                scale, scenes = lay_out_plane(trajectory, times, list(_shown_impacts(trajectory, times)))
            else:
                layout, postures = lay_out_motion(trajectory, times)
                scale = layout.scale
                scenes = [list(picture(layout, posture, coordinates=True)) for posture in postures]
            sides = np.array([extent(scene) for scene in scenes])
            left, low = sides[:, 0].min() - (0.0 if in_plane else 1.6), sides[:, 2].min()
            right, high = sides[:, 1].max(), sides[:, 3].max()
        else:
            spare = Figure().add_subplot()
            wide, tall = draw_system(spare, scheme)
            right, high = wide, tall
        height = _even(min(high_height, max(low_height, 1.2 * len(contents), (high - low) * INCH + 0.8)))
        unit = min(INCH, (height - 0.8) / (high - low), scheme_width / (right - left))
        width = _even((right - left) * unit + 0.2 + curves_width)
        figure = Figure(figsize=(width, height), dpi=DPI)
        drawing = figure.add_axes((0.1 / width, 0.4 / height, (right - left) * unit / width, 1.0 - 0.8 / height))
        artists: list[Painted] = []
        if isinstance(scheme, Scheme):
            artists = paint(drawing, scenes[0], unit / INCH)
            drawing.set(xlim=(left, right), ylim=(low, high), aspect="equal")
            drawing.set_axis_off()
            if not in_plane:
                _scale_bar(drawing, left + 0.5, low + 0.4, scale, unit / INCH)
        else:
            draw_system(drawing, scheme)

        growing = _draw_curves(figure, contents, trajectory, ((right - left) * unit + 0.2) / width)
        title = title_of(trajectory)
        figure.text(0.15 / width, 1.0 - 0.2 / height, title, ha="left", va="center", fontsize=10.5, color=INK)
        ratio = (times[-1] - times[0]) / seconds
        pace = f"slowed down {_round3(1.0 / ratio)} times" if ratio < 1.0 else f"sped up {_round3(ratio)} times"
        pace = "as fast as it is" if abs(ratio - 1.0) < 5e-3 else pace
        figure.text(1.0 - 0.15 / width, 1.0 - 0.2 / height, pace, ha="right", va="center", fontsize=9.0, color=GREY)
        clock = figure.text(0.15 / width, 0.2 / height, "", ha="left", va="center", fontsize=11.0, color=INK)
        moving = [artist for group in artists for artist in (group if isinstance(group, tuple) else (group,)) if artist]
        moving += [line for _, grown, marks in growing for line in (*grown, *marks)]
        moving.append(clock)
        for artist in moving:
            artist.set_animated(True)
        order = sorted(moving, key=lambda artist: artist.get_zorder())
        return cls(figure, times, scale, order, title, _scenes=scenes, _artists=artists, _growing=growing, _clock=clock)

    def show(self, frame: int) -> None:
        """Set all moving artists to a frame."""
        t = float(self.times[frame])
        for piece, artist in zip(self._scenes[frame], self._artists, strict=True):
            if isinstance(piece, Stroke) and isinstance(artist, tuple):
                drawn, filled = artist
                if drawn is not None:
                    drawn.set_data(*piece.points.T)
                if filled is not None:
                    filled.set_xy(piece.points)
            elif isinstance(piece, Label) and isinstance(artist, Text):
                place = piece.place
                artist.set_position((float(place[0]), float(place[1])))
                artist.set_text(piece.text)
        for panel, grown, marks in self._growing:
            past = int(np.searchsorted(panel.t, t, side="right"))
            for i, (line, mark) in enumerate(zip(grown, marks, strict=True)):
                line.set_data(panel.t[:past], panel.values[:past, i])
                here = panel.values[past - 1 : past, i]
                mark.set_data([t] * len(here), here)
        self._clock.set_text(f"$t$ = {t:.{self._digits}f} s")

    @property
    def _digits(self) -> int:
        """Smallest number of decimals that distinguishes successive frames."""
        step = (self.times[-1] - self.times[0]) / (len(self.times) - 1)
        return max(0, math.ceil(-math.log10(step)))

    def frames(self, chosen: Iterable[int] | None = None) -> Iterator[Image.Image]:
        """Yield the image of each frame, or of the chosen ones; the static background is painted once."""
        canvas: Any = FigureCanvasAgg(self.figure)
        canvas.draw()
        still = canvas.copy_from_bbox(self.figure.bbox)
        for i in range(len(self.times)) if chosen is None else chosen:
            canvas.restore_region(still)
            self.show(i)
            for artist in self.moving:
                artist.draw(canvas.get_renderer())
            yield Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3].copy())


def lay_out_motion(trajectory: Trajectory, times: Array) -> tuple[Layout, list[Posture]]:
    """Return the layout, with space for the motion of the run, and the posture at each time.

    Parameters
    ----------
    trajectory : Trajectory
        A run of a scheme.
    times : (nf,) array
        Times within the run, in s.
    """
    problem = trajectory.problem
    assert isinstance(problem.scheme, Scheme)
    dynamics = problem.dynamics
    state = trajectory.sample(times, "right")
    q: dict[str, Array] = {GROUND: np.zeros(len(times)), CEILING: np.zeros(len(times))}
    q |= dict(zip(dynamics.nodes, state.q.T, strict=True))
    for name, end in sums(problem.scheme.elements).items():
        q[name] = np.stack([c * q[node] for node, c in end.items()]).sum(axis=0)
    plain = Layout(problem.scheme.elements)
    stretched = [np.ptp(q[link.bottom] - q[link.top]) for link in plain.links]
    carried = {arm.top for arm in plain.arms if arm.bottom in (GROUND, *plain.nodes)}
    largest = max([*stretched, *(np.ptp(q[node]) for node in plain.nodes if node not in carried)], default=0.0)
    scale = MAX_TRAVEL / largest if largest > 0.0 else 1.0
    layout = Layout(problem.scheme.elements, partial(_relative_travel, q, scale), scale)

    pressed = _pressed(trajectory, times, np.hstack([state.reaction, dynamics.push(state.q, state.v)]))
    rest = layout.y
    moved = {node: scale * each for node, each in q.items()}
    postures = []
    for i in range(len(times)):
        here = {node: float(each[i]) for node, each in moved.items()}
        y = {node: place - here[node] for node, place in rest.items()}
        postures.append(Posture(y, {name: float(each[i]) for name, each in pressed.items()}, here))
    return layout, postures


def _relative_travel(q: Mapping[str, Array], scale: float, top: str, bottom: str) -> tuple[float, float]:
    """Return the minimum and maximum relative displacement of two nodes, in units of the layout."""
    apart = scale * (q[bottom] - q[top])
    return float(apart.min()), float(apart.max())


def _shown_impacts(
    trajectory: Trajectory, times: Array, *, flash_seconds: float = 0.15
) -> Iterator[tuple[Event, Flags]]:
    """Yield impacts, each with the frames (nf,) in which it is marked.

    ``flash_seconds``: duration in s of the animation for which an impact is marked.
    """
    # A frame stands for flash_seconds/DEFAULT_SECONDS of the run at least.
    instant = flash_seconds / DEFAULT_SECONDS * (times[-1] - times[0])
    for event in shown_events(trajectory):
        if event.impulse != 0.0:
            yield event, (times >= event.t) & (times < event.t + instant)


def _pressed(trajectory: Trajectory, times: Array, force: Array) -> dict[str, Array]:
    """Return the relative force of each contact at each time, from 0 to 1; an impulse is 1 for an instant."""
    names = [each.name for each in trajectory.problem.dynamics.forces]
    r = np.nan_to_num(force)
    largest = max(float(np.abs(r).max(initial=0.0)), float(np.abs(np.nan_to_num(trajectory.forces)).max(initial=0.0)))
    found = {name: np.abs(column) / (largest or 1.0) for name, column in zip(names, r.T, strict=True)}
    for event, frames in _shown_impacts(trajectory, times):
        if event.impulse > 0.0:
            found[event.contact][frames] = 1.0
    return found


def _panels_with_impulses(trajectory: Trajectory, *, up: bool = False) -> list[Panel]:
    """Return the panels of a run, with impulses as needles."""
    impacts = [event for event in shown_events(trajectory) if event.impulse > 0.0]
    if not impacts:
        return panels(trajectory, up=up)
    names = force_names(trajectory)
    needles = np.full((3 * len(impacts), len(names)), np.nan)
    for i, event in enumerate(impacts):
        needles[3 * i : 3 * i + 2, names.index(event.contact)] = 0.0, event.impulse
    t = np.repeat([event.t for event in impacts], 3)
    return [*panels(trajectory, up=up), Panel(impulse_label(trajectory.problem), names, t, needles)]


def _round3(value: float) -> str:
    """Format a number with three significant digits, or from a hundred on as an integer with two."""
    return f"{value:.3g}" if value < 99.5 else f"{float(f'{value:.2g}'):,.0f}"


def _draw_curves(
    figure: Figure, contents: Sequence[Panel], trajectory: Trajectory, start: float
) -> list[tuple[Panel, list[Line2D], list[Line2D]]]:
    """Draw the curves faintly, and return them with the lines that grow over them and the markers at their ends."""
    width, height = figure.get_size_inches()
    left, right = start + 0.75 / width, 1.0 - 1.0 / width
    low, high = 0.55 / height, 1.0 - 0.5 / height
    each = (high - low) / len(contents)
    found = []
    first: Axes | None = None
    for i, panel in enumerate(contents):
        box = (left, high - (i + 1) * each + (0.12 / height if i + 1 < len(contents) else 0.0), right - left, each)
        ax = figure.add_axes((box[0], box[1], box[2], box[3] - 0.12 / height), sharex=first)
        first = first or ax
        draw_panel(ax, panel, faint=True)
        ax.set_xlim(float(trajectory.t[0]), float(trajectory.t[-1]))
        if i + 1 < len(contents):
            ax.tick_params(labelbottom=False)
        else:
            ax.set_xlabel(axis_label("$t$", trajectory.problem.unit("t")))
        pale = list(ax.get_lines())
        for line, entry in zip(pale, ax.get_legend().get_lines(), strict=True):  # type: ignore[union-attr]
            entry.set_alpha(1.0)
            entry.set_linestyle(line.get_linestyle())
        looks: list[Look] = [
            {"color": line.get_color(), "linestyle": line.get_linestyle(), "linewidth": line.get_linewidth()}
            for line in pale
        ]
        grown = [ax.plot([], [], **look, label="_")[0] for look in looks]
        marks = [
            ax.plot([], [], "o", color=look["color"], markersize=5.0, label="_", clip_on=False, zorder=5.0)[0]
            for look in looks
        ]
        ax.set_autoscale_on(False)
        found.append((panel, grown, marks))
    return found


def _scale_bar(ax: Axes, x: float, y: float, scale: float, size: float) -> None:
    """Draw a vertical scale bar of a round length in metres, with its length."""
    metres = round_below(1.6 / scale)
    long = metres * scale
    ax.plot([x, x], [y, y + long], color=GREY, linewidth=1.2 * size, linestyle="-", solid_capstyle="butt")
    for end in (y, y + long):
        ax.plot([x - 0.12, x + 0.12], [end, end], color=GREY, linewidth=1.2 * size, linestyle="-")
    ax.text(
        x + 0.22, y + long / 2.0, length_text(metres), ha="left", va="center_baseline", fontsize=10.0 * size, color=GREY
    )


def _even(inches: float) -> float:
    """Round a length to an even number of pixels, as video codecs require."""
    return 2.0 * math.ceil(inches * DPI / 2.0) / DPI


def common_palette(pictures: Sequence[Image.Image], colors: int = COLOR_COUNT) -> Image.Image:
    """Return an image whose palette suits all the pictures and contains pure white."""
    together = Image.fromarray(np.vstack([np.asarray(picture) for picture in pictures]))
    palette = together.quantize(colors, method=Image.Quantize.MEDIANCUT)
    rgb = np.array(palette.getpalette()).reshape(-1, 3)
    # Nearest colours are found coarsely, so no other palette colour may be close to white.
    rgb[rgb.min(axis=1) >= 246] = 255
    palette.putpalette(rgb.ravel().tolist())
    return palette


def _quantized_frames(film: Film) -> Iterator[Image.Image]:
    """Yield the frames in one palette, computed from four of them."""
    palette = common_palette(list(film.frames(np.linspace(0, len(film.times) - 1, 4).round().astype(int).tolist())))
    for frame in film.frames():
        yield frame.quantize(palette=palette, dither=Image.Dither.NONE)


def _write_gif(film: Film, path: Path, fps: int, *, hold_seconds: float = 1.0) -> None:
    # hold_seconds: duration of the last frame of a GIF in s.
    first, *others = _quantized_frames(film)
    # GIF durations are in hundredths of a second, so frames of 1/30 s last 3, 3 and 4 of them.
    ends = [round(100.0 * i / fps) for i in range(len(film.times) + 1)]
    lasts = [10 * max(2, after - before) for before, after in pairwise(ends)]
    lasts[-1] = round(1000.0 * hold_seconds)
    first.save(path, format="GIF", save_all=True, append_images=others, duration=lasts, loop=0, optimize=False)


def _write_mp4(film: Film, path: Path, fps: int) -> None:
    writer = FFMpegWriter(fps=fps, metadata={"title": film.title})
    try:
        with writer.saving(film.figure, str(path), dpi=DPI):
            for i in range(len(film.times)):
                film.show(i)
                writer.grab_frame()
    except (CalledProcessError, BrokenPipeError) as error:
        raise UnsupportedError(
            f"ffmpeg could not write the film ({error}): install an ffmpeg with an H.264 encoder, or write .gif or .html"
        ) from None


def _write_html(film: Film, path: Path, fps: int) -> None:
    pictures = []
    for frame in _quantized_frames(film):
        data = io.BytesIO()
        frame.save(data, format="PNG", optimize=False)
        pictures.append(base64.b64encode(data.getvalue()).decode("ascii"))
    template = Environment(loader=PackageLoader("lcpimpact.plotting", "."), autoescape=True).get_template(
        "player.html.j2"
    )
    width, height = (round(DPI * inches) for inches in film.figure.get_size_inches())
    text = template.render(title=film.title, pictures=pictures, fps=fps, width=width, height=height)
    path.write_text(text, encoding="utf-8")
