"""The pictures: everything that should be in them is, nothing overlaps, and jumps are drawn as jumps."""

from __future__ import annotations

from collections import Counter
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.patches import Wedge
from matplotlib.text import Text

import lcpimpact
from lcpimpact import Bumper, Dashpot, InputError, KelvinVoigt, Load, Mass, Problem, Scheme, Spring, Trajectory
from lcpimpact.plotting.cones import RADII, Cone, cones, plot_cones, sectors
from lcpimpact.plotting.figures import figure_2, figure_3, force_figure, motion_figure
from lcpimpact.plotting.schematic import FORCE, draw_scheme
from lcpimpact.plotting.style import save, style
from lcpimpact.plotting.timeline import contact_intervals, curves, math_text
from lcpimpact.plotting.trajectory import plot_trajectory

METHODS = ("exact", "moreau-jean", "rk4-paper")
SYSTEMS = ("system-1", "system-2", "system-3")

SCHEMES = {
    **{name: lcpimpact.load_problem(name).scheme for name in (*SYSTEMS, "bouncing-ball")},
    "two masses in a chain": Scheme(
        Mass("a", 1.0, symbols=("m_1",)),
        Load("a", 1.0, symbols=("m_1 g",)),
        KelvinVoigt("a", "b", 1.0, 1.0, symbols=("k_12", "c_12")),
        Mass("b", 1.0, symbols=("m_2",)),
        Load("b", 1.0, symbols=("m_2 g",)),
        Bumper("b", "ground", e=0.5),
    ),
    "one mass on two supports": Scheme(
        Mass("x", 1.0),
        Bumper("x", "y"),
        Bumper("x", "z", name="R_2", symbols=("R_2",)),
        KelvinVoigt("y", "ground", 1.0, 1.0, symbols=("k_1", "c_1")),
        KelvinVoigt("z", "ground", 1.0, 1.0, symbols=("k_2", "c_2")),
    ),
    "two masses side by side": Scheme(
        Mass("x", 1.0),
        Mass("y", 1.0),
        KelvinVoigt("x", "y", 1.0, 1.0),
        Bumper("x", "ground", e=0.5),
        Bumper("y", "ground", e=0.5, name="R_2", symbols=("R_2",)),
    ),
    "four links in parallel, two loads": Scheme(
        Mass("x", 1.0),
        Spring("x", "ground", 1.0),
        Dashpot("x", "ground", 1.0),
        Spring("x", "ground", 1.0, symbols=("k_2",)),
        Bumper("x", "ground", gap=1.0, e=0.5),
        Load("x", 1.0, symbols=("mg",)),
        Load("x", 1.0, symbols=("f",)),
    ),
    "a load on a massless node below a link": Scheme(
        Mass("x", 1.0),
        Spring("x", "y", 1.0),
        Load("y", 1.0),
        KelvinVoigt("y", "ground", 1.0, 1.0, symbols=("k_o", "c_o")),
    ),
    "free bodies": Scheme(Mass("x", 1.0), Mass("y", 2.0), Bumper("x", "y", e=1.0), Mass("z", 1.0)),
}


@pytest.fixture(scope="module")
def runs() -> dict[str, list[Trajectory]]:
    """Each system by each method."""
    problems = {name: lcpimpact.load_problem(name) for name in SYSTEMS}
    return {
        name: [lcpimpact.simulate(problem, method, dt=1e-2, t_end=3.0) for method in METHODS]
        for name, problem in problems.items()
    }


def parts(scheme: Scheme) -> list[Any]:
    return [part for element in scheme.elements for part in element.parts()]


def texts(figure: Figure) -> list[Text]:
    """Return every text that shows, tick labels and legends included."""
    return [text for text in figure.findobj(Text) if text.get_visible() and text.get_text().strip()]


def boxes(figure: Figure) -> list[tuple[str, Any]]:
    """Return each text with its box in pixels, as the Agg renderer places it."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    shown = [(text.get_text(), text.get_window_extent(canvas.get_renderer())) for text in drawn(figure)]
    return [(text, box) for text, box in shown if box.width > 0.0]


def drawn(figure: Figure) -> list[Text]:
    """Return the texts that the last drawing painted: matplotlib keeps tick labels outside the limits, unpainted."""
    hidden = set()
    for ax in figure.axes:
        for axis in (ax.xaxis, ax.yaxis):
            painted = {id(tick) for tick in axis._update_ticks()} if ax.axison else set()
            ticks = [*axis.majorTicks, *axis.minorTicks]
            hidden |= {id(label) for t in ticks if id(t) not in painted for label in (t.label1, t.label2)}
            if not ax.axison:
                hidden |= {id(axis.label)}
    return [text for text in texts(figure) if id(text) not in hidden]


def assert_nothing_overlaps(figure: Figure) -> None:
    found = boxes(figure)
    assert found
    for (one, a), (other, b) in combinations(found, 2):
        across = min(a.x1, b.x1) - max(a.x0, b.x0)
        along = min(a.y1, b.y1) - max(a.y0, b.y0)
        assert across <= 0.5 or along <= 0.5, f"{one!r} and {other!r} overlap by {across:.1f} x {along:.1f} pixels"


def assert_nothing_is_cut_off(figure: Figure) -> None:
    page = figure.bbox
    for text, box in boxes(figure):
        assert page.x0 <= box.x0 <= box.x1 <= page.x1, text
        assert page.y0 <= box.y0 <= box.y1 <= page.y1, text


def points(ax: Axes, kind: str) -> list[np.ndarray]:
    """Return the lines that were drawn for the elements of a kind, as arrays of points."""
    return [line.get_xydata() for line in ax.get_lines() if str(line.get_label()).startswith(f"{kind} ")]


# --- schemes -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", SCHEMES)
def test_every_symbol_and_every_coordinate_is_written(name: str) -> None:
    scheme = SCHEMES[name]
    written = Counter(text.get_text() for text in draw_scheme(scheme).axes[0].texts)
    expected = Counter(math_text(symbol) for part in parts(scheme) for symbol in part.symbols)
    expected += Counter(
        math_text(symbol) for part in parts(scheme) if isinstance(part, Bumper) for symbol in part.symbols
    )
    expected += Counter(
        math_text(node) for node in {node for part in parts(scheme) for node in part.nodes} - {"ground"}
    )
    assert written == expected


@pytest.mark.parametrize("name", SCHEMES)
def test_every_element_is_drawn_by_its_own_strokes(name: str) -> None:
    ax = draw_scheme(SCHEMES[name]).axes[0]
    for kind in (Mass, Spring, Dashpot, Bumper, Load):
        count = sum(type(part) is kind for part in parts(SCHEMES[name]))
        lines = points(ax, kind.__name__)
        assert [len(line) for line in lines] == [len(stroke) for stroke in kind.strokes] * count


@pytest.mark.parametrize("name", SCHEMES)
def test_no_two_texts_of_a_scheme_overlap_and_none_is_cut_off(name: str) -> None:
    figure = draw_scheme(SCHEMES[name], title=name)
    assert_nothing_overlaps(figure)
    assert_nothing_is_cut_off(figure)


@pytest.mark.parametrize("name", SCHEMES)
def test_no_two_symbols_share_a_place(name: str) -> None:
    """The boxes around the symbols of springs, dashpots, bumpers and masses meet at most along their edges."""
    ax = draw_scheme(SCHEMES[name]).axes[0]
    found: dict[str, np.ndarray] = {}
    for label in {str(line.get_label()) for line in ax.get_lines()}:
        if label.startswith(("Mass", "Spring", "Dashpot", "Bumper")):
            found[label] = np.vstack([line.get_xydata() for line in ax.get_lines() if line.get_label() == label])
    assert len(found) == sum(not isinstance(part, Load) for part in parts(SCHEMES[name]))
    for (one, a), (other, b) in combinations(found.items(), 2):
        shared = np.minimum(a.max(axis=0), b.max(axis=0)) - np.maximum(a.min(axis=0), b.min(axis=0))
        assert (shared <= 1e-9).any(), (one, other)


@pytest.mark.parametrize("name", SCHEMES)
def test_no_text_stands_on_a_spring_or_a_dashpot(name: str) -> None:
    figure = draw_scheme(SCHEMES[name])
    written = boxes(figure)
    ax = figure.axes[0]
    for line in ax.get_lines():
        if str(line.get_label()).startswith(("Spring", "Dashpot")):
            (x0, y0), (x1, y1) = (f(ax.transData.transform(line.get_xydata()), axis=0) for f in (np.min, np.max))
            for text, box in written:
                assert min(x1, box.x1) <= max(x0, box.x0) or min(y1, box.y1) <= max(y0, box.y0), text


def test_a_stroke_is_placed_by_the_frame_of_its_element() -> None:
    ax = draw_scheme(Scheme(Mass("x", 1.0), Spring("x", "ground", 2.0))).axes[0]
    (spring,), (box,) = points(ax, "Spring"), points(ax, "Mass")
    assert spring[0, 1] == pytest.approx(box[:, 1].min(), abs=1e-12)
    assert spring[-1, 1] == pytest.approx(0.0, abs=1e-12)
    # A relabelling of the ends turns the symbol round, and it still joins the same points.
    ax = draw_scheme(Scheme(Mass("x", 1.0), Spring("ground", "x", 2.0))).axes[0]
    np.testing.assert_allclose(points(ax, "Spring")[0][[0, -1]], spring[[-1, 0]], rtol=0.0, atol=1e-12)
    s = np.array([s for s, _ in Spring.strokes[0]])
    np.testing.assert_allclose(spring[:, 1], (1.0 - s) * spring[0, 1], rtol=0.0, atol=1e-12)


def test_nodes_stand_in_the_order_of_their_distance_from_the_ground() -> None:
    ax = draw_scheme(lcpimpact.load_problem("system-3").scheme).axes[0]
    heights = {t.get_text(): t.get_position()[1] for t in ax.texts}
    assert heights["$x$"] > heights["$y$"] > heights["$z$"] > 0.0
    assert heights["$mg$"] > heights["$m$"] > heights["$c$"] > heights["$c_o$"] > 0.0


def test_parallel_links_stand_side_by_side_on_a_rigid_bar() -> None:
    ax = draw_scheme(lcpimpact.load_problem("system-1").scheme).axes[0]
    spring, dashpot = np.vstack(points(ax, "Spring")), np.vstack(points(ax, "Dashpot"))
    assert spring[:, 0].max() < dashpot[:, 0].min()
    labels = {text.get_text(): text.get_position()[0] for text in ax.texts}
    assert labels["$k_o$"] < spring[:, 0].min()
    assert labels["$c_o$"] > dashpot[:, 0].max()
    top = spring[:, 1].max()
    bars = [line.get_xydata() for line in ax.get_lines() if len(line.get_xydata()) == 2]
    ends = [spring[spring[:, 1].argmax(), 0], dashpot[dashpot[:, 1].argmax(), 0]]
    assert any(np.allclose(bar, [[ends[0], top], [ends[1], top]], rtol=0.0, atol=1e-9) for bar in bars)


def test_the_reaction_pushes_the_plates_apart() -> None:
    ax = draw_scheme(lcpimpact.load_problem("system-1").scheme).axes[0]
    plates = sorted(line[0, 1] for line in points(ax, "Bumper") if line[0, 1] == pytest.approx(line[1, 1]))
    labels = sorted(text.get_position()[1] for text in ax.texts if text.get_text() == "$R$")
    assert labels[0] < plates[0] < plates[1] < labels[1]
    heads = [patch.get_xy() for patch in ax.patches if to_hex(patch.get_facecolor()) == FORCE]
    lower, upper = sorted((head for head in heads if abs(head[0, 0]) > 0.1), key=lambda head: head[0, 1])
    assert upper[0, 1] > upper[1:3, 1].max() > plates[1]
    assert lower[0, 1] < lower[1:3, 1].min() < plates[0]


def test_drawing_into_given_axes_returns_them_equal_in_both_directions() -> None:
    ax = Figure().add_subplot()
    assert draw_scheme(SCHEMES["system-2"], ax, coordinates=False) is ax
    assert ax.get_aspect() == 1.0
    assert not {"$x$", "$y$", "$z$"} & {text.get_text() for text in ax.texts}


@pytest.mark.parametrize("seed", range(20))
def test_any_scheme_can_be_drawn(seed: int, tmp_path: Path) -> None:
    """Links between any nodes, loads and masses anywhere, names that are no formulas."""
    rng = np.random.default_rng(seed)
    nodes = ["ground", "x", "y_1", "a b", "_", "$%", "z_1_2"][: 2 + seed % 6]
    scheme = Scheme()
    for _ in range(3 * len(nodes)):
        a, b = (nodes[i] for i in rng.choice(len(nodes), 2, replace=False))
        link = [
            Spring(a, b, 1.0, symbols=("k^",)),
            Dashpot(a, b, 1.0),
            Bumper(a, b, e=0.5),
            KelvinVoigt(a, b, 1.0, 1.0),
        ]
        point = [Mass(nodes[-1], 1.0), Load(nodes[-1], 1.0)]
        scheme.add([*link, *point][rng.integers(6)])
    assert save(draw_scheme(scheme), tmp_path / "any.svg").stat().st_size > 1000


def test_a_scheme_without_elements_is_refused() -> None:
    with pytest.raises(InputError, match="without elements"):
        draw_scheme(Scheme())


# --- figures of the paper ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("draw", [figure_2, figure_3])
def test_the_corner_is_the_graph_of_complementarity(draw: Any) -> None:
    figure = draw()
    (line,) = figure.axes[0].get_lines()
    u, R = line.get_data()
    assert (np.asarray(u) * np.asarray(R) == 0.0).all()
    assert max(u) > 0.0
    assert max(R) > 0.0
    assert min(*u, *R) == 0.0
    assert_nothing_overlaps(figure)
    assert_nothing_is_cut_off(figure)


@pytest.mark.parametrize(("number", "name"), [(6, "system-1"), (7, "system-2"), (8, "system-3")])
def test_force_figures_show_three_methods_and_both_limits_of_every_jump(
    runs: dict[str, list[Trajectory]], number: int, name: str
) -> None:
    exact, lcp, rk4 = runs[name]
    figure = force_figure(exact, lcp, rk4, number=number)
    force, error = figure.axes
    lines = {str(line.get_label()).split(",")[0]: np.array(line.get_data()) for line in force.get_lines()}
    assert set(lines) == {"exact", "LCP", "RK4"}
    for event in exact.events:
        (at,) = np.nonzero(lines["exact"][0] == event.t)
        left, gap, right = lines["exact"][1, at]
        assert left == pytest.approx(event.left.reaction[0], rel=1e-9, abs=1e-9)
        assert np.isnan(gap)
        assert right == pytest.approx(event.right.reaction[0], rel=1e-9, abs=1e-9)
    np.testing.assert_array_equal(lines["LCP"], [lcp.t_reaction, lcp["R"]])
    np.testing.assert_array_equal(lines["RK4"], [rk4.t_reaction, rk4["R"]])

    # The errors are read where each force lives: the LCP's in the middle of its steps.
    of_lcp, of_rk4 = (np.array(line.get_data()) for line in error.get_lines())
    middle = 0.5 * (lcp.t[1:] + lcp.t[:-1])
    np.testing.assert_allclose(of_lcp[0], middle, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(of_rk4[0], rk4.t, rtol=0.0, atol=1e-12)
    difference = np.abs(lcp["R"] - exact.sample(middle).reaction[:, 0])
    np.testing.assert_allclose(np.nan_to_num(of_lcp[1]), difference, rtol=1e-9, atol=1e-9)
    assert error.get_yscale() == "log"

    words = Counter(text.get_text() for text in force.texts)
    kinds = Counter({"open": "opens", "close": "closes"}[event.kind] for event in exact.events)
    assert {word: words[word] for word in kinds} == kinds
    peak = {"system-1": 5818, "system-2": 4486, "system-3": 4010}[name]
    assert f"peak {peak} N" in words
    assert_nothing_overlaps(figure)
    assert_nothing_is_cut_off(figure)


def test_figure_9_shows_every_coordinate_and_shades_the_time_in_contact(runs: dict[str, list[Trajectory]]) -> None:
    exact, lcp, rk4 = runs["system-3"]
    figure = motion_figure(exact, lcp, rk4, number=9)
    motion, error = figure.axes
    assert "positive downwards" in motion.get_ylabel()
    assert len(motion.get_lines()) == 9
    drawn = [np.array(line.get_data()) for line in motion.get_lines()]
    for i in range(3):
        np.testing.assert_array_equal(drawn[3 * i + 1], [lcp.t, lcp.q[:, i]])
        np.testing.assert_array_equal(drawn[3 * i + 2], [rk4.t, rk4.q[:, i]])
    opened, closed = (event.t for event in exact.events)
    spans = [(patch.get_x(), patch.get_x() + patch.get_width()) for patch in motion.patches]
    np.testing.assert_allclose(spans, [(0.0, opened), (closed, 3.0)], rtol=0.0, atol=1e-12)
    assert len(error.get_lines()) == 2
    assert_nothing_overlaps(figure)
    assert_nothing_is_cut_off(figure)


def test_a_curve_breaks_at_events_and_nowhere_else(runs: dict[str, list[Trajectory]]) -> None:
    exact = runs["system-1"][0]
    t, q, t_reaction, reaction = curves(exact)
    breaks = np.isnan(q).all(axis=1)
    assert sorted(t[breaks]) == [event.t for event in exact.events]
    np.testing.assert_array_equal(breaks, np.isnan(reaction).all(axis=1))
    np.testing.assert_array_equal(t, t_reaction)
    assert (np.diff(t) >= 0.0).all()
    # Between breaks a curve is fine: no step of the force beyond what 3 s / 2000 at its steepest gives.
    steps = np.abs(np.diff(reaction[:, 0]))
    assert np.nanmax(steps) < 100.0


def test_a_run_that_is_not_exact_is_drawn_as_recorded(runs: dict[str, list[Trajectory]]) -> None:
    lcp = runs["system-1"][1]
    t, q, t_reaction, reaction = curves(lcp)
    assert t is lcp.t
    assert q is lcp.q
    assert t_reaction is lcp.t_reaction
    assert reaction is lcp.reaction


def test_contact_intervals_of_system_2_start_closed_though_its_force_starts_at_zero(
    runs: dict[str, list[Trajectory]],
) -> None:
    exact = runs["system-2"][0]
    opened, closed = (event.t for event in exact.events)
    assert contact_intervals(exact, "R") == [(0.0, opened), (closed, 3.0)]


# --- any run -----------------------------------------------------------------------------------------------------------


def ball(method: str, t_end: float) -> Trajectory:
    return lcpimpact.simulate(lcpimpact.load_problem("bouncing-ball"), method, dt=1e-2, t_end=t_end)


def oscillator(method: str) -> Trajectory:
    scheme = Scheme(Mass("x", 1.0), KelvinVoigt("x", "ground", 10.0, 0.5))
    return lcpimpact.simulate(Problem("oscillator", scheme, q0={"x": 1.0}), method, dt=1e-2, t_end=1.0)


@pytest.mark.parametrize("method", ["exact", "moreau-jean"])
def test_a_run_without_contacts_has_one_panel(method: str) -> None:
    figure = plot_trajectory(oscillator(method))
    assert [ax.get_ylabel() for ax in figure.axes] == ["coordinates [m]"]
    assert_nothing_is_cut_off(figure)


@pytest.mark.parametrize("method", METHODS)
def test_a_run_shows_coordinates_reactions_and_the_names_of_its_events(method: str) -> None:
    run = lcpimpact.simulate(lcpimpact.load_problem("system-3"), method, dt=1e-2, t_end=3.0)
    figure = run.plot()
    upper, lower = figure.axes
    assert [line.get_label() for line in upper.get_lines()] == ["$x$", "$y$", "$z$"]
    assert [line.get_label() for line in lower.get_lines()] == ["$R$"]
    assert [text.get_text() for text in upper.texts] == ["opens", "closes"]
    assert_nothing_overlaps(figure)
    assert_nothing_is_cut_off(figure)


def test_many_events_are_marked_but_not_named() -> None:
    run = ball("exact", 5.0)
    assert len(run.events) > 100
    figure = plot_trajectory(run)
    assert [ax.get_ylabel() for ax in figure.axes] == ["coordinates [m]", "reaction [N]", "impulse [N s]"]
    assert not [text for ax in figure.axes for text in ax.texts]
    assert f"{len(run.events)} events" in figure.get_suptitle()
    (impulses,) = figure.axes[2].get_lines()
    np.testing.assert_allclose(impulses.get_ydata(), [e.impulse for e in run.events if e.impulse > 0.0], rtol=1e-12)
    assert_nothing_overlaps(figure)


def test_names_of_events_that_stand_close_do_not_overlap() -> None:
    run = ball("exact", 3.6)
    assert 9 <= len(run.events) < 12
    figure = plot_trajectory(run)
    assert len(figure.axes[0].texts) == len(run.events)
    assert_nothing_overlaps(figure)
    assert_nothing_is_cut_off(figure)


def test_a_run_with_no_steps_is_drawn() -> None:
    run = ball("moreau-jean", 0.1)
    empty = Trajectory(
        run.problem, run.method, run.t[:1], run.q[:1], run.v[:1], run.t_reaction[:0], run.reaction[:0], (),
        lcpimpact.Status.NON_FINITE, "stopped", run.certificate, run.stats,
    )  # fmt: skip
    assert "non-finite" in plot_trajectory(empty).get_suptitle()


# --- complementary cones -----------------------------------------------------------------------------------------------

MATRICES = {
    "a P-matrix": ([[2.0, -1.0], [-1.0, 2.0]], [-1.0, 0.3]),
    "not symmetric": ([[1.0, -4.0], [1.0, 1.0]], [-3.0, -1.0]),
    "redundant contacts": ([[1.0, 1.0], [1.0, 1.0]], [-1.0, -1.0]),
    "bodies pressed together": ([[1.0, -1.0], [-1.0, 1.0]], [-1.0, 1.0]),
    "indefinite": ([[1.0, 2.0], [2.0, 1.0]], [-4.0, -5.0]),
    "negative": ([[-1.0, 0.0], [0.0, -1.0]], [1.0, 1.5]),
    "zero": ([[0.0, 0.0], [0.0, 0.0]], [0.0, 1.0]),
    "zero diagonal": ([[0.0, 1.0], [1.0, 0.0]], [-1.0, -1.0]),
    "a column of zeros": ([[0.0, 0.0], [0.0, 1.0]], [-1.0, 1.0]),
    "nearly parallel": ([[1.0, 1.0], [1.0, 1.2]], [-1.0, -1.1]),
    "three in one direction": ([[-1.0, 0.0], [0.0, -1.0]], [1.0, 0.0]),
    "badly scaled": ([[1e9, 0.0], [0.0, 1e-9]], [-1e9, -1e-9]),
}
NAMES = ["{}", "{1}", "{2}", "{1,2}"]


def wedges(ax: Axes) -> dict[str, list[Wedge]]:
    """Return the wedges that were drawn, by their labels: one for each cone with an inside, and those without solution."""
    found: dict[str, list[Wedge]] = {}
    for patch in ax.patches:
        if isinstance(patch, Wedge) and not str(patch.get_label()).startswith("_") and patch.get_label():
            found.setdefault(str(patch.get_label()), []).append(patch)
    return found


def entries(ax: Axes) -> list[str]:
    legend = ax.get_legend()
    assert legend is not None
    return [text.get_text() for text in legend.get_texts()]


def arrows(ax: Axes) -> list[tuple[float, float]]:
    return [text.xy for text in ax.texts if getattr(text, "arrow_patch", None) is not None]


@pytest.mark.parametrize("case", MATRICES)
def test_every_cone_and_every_column_is_named_and_nothing_overlaps(case: str) -> None:
    M, q = MATRICES[case]
    figure = plot_cones(M, q)
    (ax,) = figure.axes
    written = [text.get_text() for text in ax.texts if text.get_text()]
    assert [name for name in written if name.startswith("$\\{")] == [f"$\\{{{name[1:-1]}\\}}$" for name in NAMES]
    for cone, radius, text in zip(
        cones(np.array(M)), RADII, [t for t in ax.texts if "\\{" in t.get_text()], strict=True
    ):
        x, y = text.get_position()
        if cone.kind == "wedge":
            assert cone.holds(np.degrees(np.arctan2(y, x)) % 360.0)
            assert radius - 0.16 < np.hypot(x, y) < radius
    columns = " ".join(written).replace(",", " ").split()
    expected = {"$e_1$", "$e_2$", "$q$"} | {f"${{-}}M_{i + 1}$" for i in range(2) if np.any(np.array(M)[:, i])}
    assert expected <= set(columns)
    for i in range(2):
        assert (f"${{-}}M_{i + 1} = 0$" in entries(ax)) == (f"${{-}}M_{i + 1}$" not in expected)
    # Each column, and q, is an arrow in its own direction.
    vectors = [each for each in (*np.eye(2), *-np.transpose(M), np.array(q)) if each.any()]
    drawn = arrows(ax)
    assert len(drawn) == len(vectors)
    for tip, vector in zip(drawn, vectors, strict=True):
        assert np.arctan2(*tip) == pytest.approx(np.arctan2(*vector), abs=1e-12)
    assert ax.get_aspect() == 1.0
    assert_nothing_overlaps(figure)
    assert_nothing_is_cut_off(figure)
    beside = ax.get_legend().get_window_extent().x0
    assert all(text.get_window_extent().x1 < beside for text in ax.texts if text.get_text())


def test_the_cones_of_a_P_matrix_have_the_angles_of_its_columns_and_cover_the_plane_once() -> None:
    ax = plot_cones([[2.0, -1.0], [-1.0, 2.0]]).axes[0]
    found = wedges(ax)
    lower, left = -np.degrees(np.arctan2(2.0, 1.0)) % 360.0, np.degrees(np.arctan2(1.0, -2.0))
    expected = {"{}": (0.0, 90.0), "{1}": (90.0, left), "{2}": (lower, 360.0), "{1,2}": (left, lower)}
    assert set(found) == set(expected)
    for (name, angles), radius in zip(expected.items(), RADII, strict=True):
        (wedge,) = found[name]
        assert (wedge.theta1, wedge.theta2) == pytest.approx(angles, abs=1e-9)
        assert wedge.r == radius
    assert "one solution for every $q$: a P-matrix" in ax.get_title(loc="left")


@pytest.mark.parametrize(
    ("case", "kinds", "gaps", "said"),
    [
        ("not symmetric", ["wedge"] * 4, [], "a P-matrix"),
        ("redundant contacts", ["wedge"] * 3 + ["ray"], [], "one solution; infinitely many on a thick line"),
        ("bodies pressed together", ["wedge"] * 3 + ["line"], [(135.0, 315.0)], "0 or 1 solutions"),
        ("indefinite", ["wedge"] * 4, [], "1 or 3 solutions"),
        ("negative", ["wedge"] * 4, [(90.0, 360.0)], "0 or 4 solutions"),
        ("zero", ["wedge", "ray", "ray", "origin"], [(90.0, 360.0)], "infinitely many on a thick line"),
        ("zero diagonal", ["wedge", "line", "line", "wedge"], [(90.0, 180.0), (270.0, 360.0)], "0 or 1"),
        ("a column of zeros", ["wedge", "ray", "wedge", "ray"], [(90.0, 270.0)], "0 or 1"),
        ("badly scaled", ["wedge"] * 4, [], "a P-matrix"),
    ],
)
def test_overlaps_gaps_and_lines_are_drawn(
    case: str, kinds: list[str], gaps: list[tuple[float, float]], said: str
) -> None:
    M, q = MATRICES[case]
    ax = plot_cones(M, q).axes[0]
    assert [cone.kind for cone in cones(np.array(M))] == kinds
    found = wedges(ax)
    empty = [(wedge.theta1, wedge.theta2) for wedge in found.pop("no solution", [])]
    assert np.ravel(empty) == pytest.approx(np.ravel(gaps), abs=1e-9)
    assert ("no solution" in entries(ax)) == bool(gaps)
    assert list(found) == [name for name, kind in zip(NAMES, kinds, strict=True) if kind == "wedge"]
    lines = {str(line.get_label()): line for line in ax.get_lines()}
    assert list(lines) == [name for name, kind in zip(NAMES, kinds, strict=True) if kind != "wedge"]
    for name, line in lines.items():
        # A line runs through the origin, a ray begins there, and the cone {0} is a point.
        kind, points = kinds[NAMES.index(name)], line.get_xydata()
        lengths = np.hypot(*points.T)
        radius = RADII[NAMES.index(name)]
        assert sorted(lengths) == pytest.approx({"line": [radius] * 2, "ray": [0.0, radius], "origin": [0.0]}[kind])
        if kind == "line":
            np.testing.assert_allclose(points[0], -points[1], rtol=0.0, atol=1e-12)
    assert said in ax.get_title(loc="left")
    for entry, kind in zip(entries(ax)[:4], kinds, strict=True):
        assert entry.endswith(")$" if kind == "wedge" else f" {kind}")


@pytest.mark.parametrize("seed", range(40))
def test_a_direction_lies_in_as_many_cones_as_the_problem_has_solutions(seed: int) -> None:
    rng = np.random.default_rng(seed)
    M = rng.normal(size=(2, 2)) * 10.0 ** rng.integers(-3, 4, size=2)
    drawn = cones(M)
    parts = sectors(drawn)
    assert sum(last - first for first, last, _ in parts) == pytest.approx(360.0, abs=1e-6)
    for angle in rng.uniform(0.0, 360.0, size=20):
        q = np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle))])
        solutions = lcpimpact.all_solutions(M, q)
        assert sum(cone.holds(angle) for cone in drawn) == len(solutions)
        assert sum(count for first, last, count in parts if (angle - first) % 360.0 < last - first) == len(solutions)


def test_the_solutions_for_q_are_counted_and_listed() -> None:
    def said(M: Any, q: Any) -> list[str]:
        listed = entries(plot_cones(M, q).axes[0])
        return listed[next(i for i, text in enumerate(listed) if text.startswith("$q$")) :]

    M = [[1.0, 2.0], [2.0, 1.0]]
    assert said(M, [-4, -5]) == ["$q$ = (-4, -5): 3 solutions", "$z$ = (4, 0)", "$z$ = (0, 5)", "$z$ = (2, 1)"]
    assert said(M, [1, -2]) == ["$q$ = (1, -2): 1 solution", "$z$ = (0, 2)"]
    assert said([[1, -4], [1, 1]], [-3, -1]) == ["$q$ = (-3, -1): 1 solution", "$z$ = (3, 0)"]
    assert said(-np.eye(2), [-1, -1]) == ["$q$ = (-1, -1): no solutions"]
    assert said(np.ones((2, 2)), [-1, -1])[0] == "$q$ = (-1, -1): infinitely many, among them"
    assert said(np.ones((2, 2)), [-1, -2])[0] == "$q$ = (-1, -2): 1 solution"
    assert said(np.ones((2, 2)), [0, 0])[0] == "$q$ = (0, 0): 1 solution"
    assert said(np.zeros((2, 2)), [0, 0])[0] == "$q$ = (0, 0): infinitely many, among them"
    assert said([[1, -1], [-1, 1]], [0, 0])[0] == "$q$ = (0, 0): infinitely many, among them"
    assert not [text for text in entries(plot_cones(M).axes[0]) if text.startswith("$q$")]


def test_a_cone_holds_its_edges_and_what_lies_between() -> None:
    cone = Cone((0,), np.array([[-1.0, -1.0], [0.0, 1.0]]))
    assert cone.name == "{1}"
    assert cone.angles == pytest.approx((90.0, 225.0))
    assert [cone.holds(angle) for angle in (89.9, 90.0, 180.0, 225.0, 225.1, 0.0)] == [
        False,
        True,
        True,
        True,
        False,
        False,
    ]
    across = Cone((0, 1), np.array([[1.0, 1.0], [1.0, -1.0]]))
    assert [across.holds(angle) for angle in (0.0, 44.0, 46.0, 314.0, 316.0, 180.0)] == [
        True,
        True,
        False,
        False,
        True,
        False,
    ]


def test_cones_are_drawn_into_given_axes_or_a_file(tmp_path: Path) -> None:
    ax = Figure().add_subplot()
    assert plot_cones(np.eye(2), ax=ax) is ax
    assert set(wedges(ax)) == set(NAMES)
    once, again = tmp_path / "once.svg", tmp_path / "again.svg"
    plot_cones(*MATRICES["indefinite"], once)
    plot_cones(*MATRICES["indefinite"], again)
    assert once.read_bytes().startswith(b"<?xml")
    assert once.read_bytes() == again.read_bytes()


@pytest.mark.parametrize(
    ("M", "q", "path", "said"),
    [
        (np.eye(3), None, None, "of order 2, and it is of order 3"),
        ([[1.0, np.nan], [0.0, 1.0]], None, None, "not finite"),
        (np.eye(2), [1.0], None, r"q must have shape \(2,\)"),
        (np.eye(2), [1.0, np.inf], None, "q has an entry that is not finite"),
        (np.eye(2), None, "cones.jpg", "must end in one of"),
    ],
)
def test_cones_of_what_is_no_plane_are_refused(M: Any, q: Any, path: str | None, said: str) -> None:
    with pytest.raises(InputError, match=said):
        plot_cones(M, q, path)


# --- files -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("suffix", "magic"), [(".png", b"\x89PNG"), (".svg", b"<?xml"), (".pdf", b"%PDF")])
def test_a_picture_is_written_whole_and_the_same_every_time(tmp_path: Path, suffix: str, magic: bytes) -> None:
    run = ball("exact", 1.0)
    once, again = tmp_path / f"once{suffix}", tmp_path / f"again{suffix}"
    run.plot(once)
    save(plot_trajectory(run), again)
    assert once.read_bytes().startswith(magic)
    assert once.read_bytes() == again.read_bytes()
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted([once.name, again.name])


def test_an_svg_needs_no_font_and_bears_no_date(tmp_path: Path) -> None:
    svg = save(draw_scheme(SCHEMES["system-1"]), tmp_path / "scheme.svg").read_text(encoding="utf-8")
    assert "<path" in svg
    assert "<text" not in svg
    assert "<dc:date>" not in svg


@pytest.mark.parametrize("name", ["run.jpg", "run", "run.PNG"])
def test_another_ending_is_refused_by_name(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError, match=r"\.png, \.svg, \.pdf"):
        ball("exact", 0.1).plot(tmp_path / name)
    assert not list(tmp_path.iterdir())


def test_a_folder_that_is_missing_is_an_input_error(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot write"):
        ball("exact", 0.1).plot(tmp_path / "missing" / "run.png")


def test_nothing_is_left_in_pyplot_and_the_settings_are_put_back(python: Any) -> None:
    code = """
import json, sys, matplotlib
before = {key: matplotlib.rcParams[key] for key in matplotlib.rcParams if not key.startswith("backend")}
import lcpimpact
from lcpimpact.plotting.figures import figure_2
from lcpimpact.plotting.schematic import FORCE, draw_scheme
figure_2()
draw_scheme(lcpimpact.load_problem("system-3").scheme)
lcpimpact.simulate(lcpimpact.load_problem("system-1"), dt=1e-2, t_end=0.1).plot()
changed = [key for key in before if before[key] != matplotlib.rcParams[key]]
print(json.dumps([changed, "matplotlib.pyplot" in sys.modules]))
"""
    assert python(code) == [[], False]


def test_the_style_does_not_depend_on_the_user() -> None:
    import matplotlib

    with matplotlib.rc_context({"lines.linewidth": 9.0, "text.usetex": True}), style():
        assert matplotlib.rcParams["lines.linewidth"] < 9.0
        assert not matplotlib.rcParams["text.usetex"]
