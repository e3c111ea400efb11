"""The pictures: everything that should be in them is, nothing overlaps, and jumps are drawn as jumps."""

from __future__ import annotations

import html
from collections import Counter
from functools import lru_cache
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
from matplotlib.path import Path as MplPath
from matplotlib.text import Text

import lcpimpact
import lcpimpact as li
from lcpimpact import (
    Bar,
    Bumper,
    Dashpot,
    GeneralizedMaxwell,
    Harmonic,
    HertzSpring,
    HuntCrossley,
    InputError,
    Jenkins,
    KelvinVoigt,
    LinearComplementaritySystem,
    Load,
    Mass,
    Maxwell,
    NegativeSpring,
    PrescribedMotion,
    Problem,
    Rope,
    Scheme,
    Slider,
    Spring,
    SpringPot,
    Trajectory,
    Zener,
)
from lcpimpact.plotting import cones_in_space as space
from lcpimpact.plotting.cones import RADII, Cone, cones, plot_cones, sectors
from lcpimpact.plotting.figures import figure_2, figure_3, force_figure, motion_figure
from lcpimpact.plotting.layout import CEILING, Layout, half_breadth
from lcpimpact.plotting.schematic import FORCE_COLOR, draw_scheme
from lcpimpact.plotting.style import save, style
from lcpimpact.plotting.timeline import contact_intervals, curves, math_text, shown_events
from lcpimpact.plotting.trajectory import plot_trajectory
from lcpimpact.problems import PROBLEMS
from lcpimpact.scheme.elements import ELEMENTS

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
    "dry friction": Scheme(Mass("x", 1.0), Spring("x", "ground", 1.0), Slider("x", "ground", 1.0)),
    "elastic-plastic": Scheme(Mass("x", 1.0), Jenkins("x", "ground", 1.0, 1.0)),
    "elastic-plastic with hardening, beside a dashpot": Scheme(
        Mass("x", 1.0), Load("x", 1.0), Jenkins("x", "ground", 1.0, 1.0, k_h=1.0), Dashpot("x", "ground", 1.0)
    ),
    "Maxwell beside a spring": Scheme(
        Mass("x", 1.0), Bumper("x", "y"), Maxwell("y", "ground", 1.0, 1.0), Spring("y", "ground", 1.0)
    ),
    "Zener": Scheme(Mass("x", 1.0), Bumper("x", "y"), Zener("y", "ground", 1.0, 1.0, 1.0)),
    "three arms": Scheme(Mass("x", 1.0), GeneralizedMaxwell("x", "ground", 1.0, (1.0,) * 3, (1.0,) * 3)),
    "five arms": Scheme(Mass("x", 1.0), GeneralizedMaxwell("x", "ground", 1.0, (1.0,) * 5, (1.0,) * 5)),
    "spring-pot": Scheme(Mass("x", 1.0), SpringPot("x", "ground", 1.0, 0.5, 1e-3, 1.0)),
    "Hertz": Scheme(Mass("x", 1.0), Load("x", 1.0), HertzSpring("x", "ground", 1.0)),
    "Hunt and Crossley": Scheme(Mass("x", 1.0), HuntCrossley("x", "ground", 1.0, 1.0)),
    "hanging on a rope": Scheme(Mass("x", 1.0), Load("x", 1.0), Rope("ground", "x", slack=1.0, e=0.5)),
    "tied down, and pushed away": Scheme(
        Mass("x", 1.0), Rope("x", "ground", slack=1.0, e=0.5), NegativeSpring("x", "ground", 1.0)
    ),
    "between two stops": Scheme(
        Mass("x", 1.0),
        Bumper("ground", "x", gap=1.0, e=0.5, name="R_2", symbols=("R_2",)),
        Spring("x", "ground", 1.0),
        Bumper("x", "ground", gap=1.0, e=0.5),
    ),
    "a table that moves": Scheme(
        Mass("x", 1.0), Load("x", 1.0), Bumper("x", "table", e=0.5), PrescribedMotion("table", Harmonic(1.0, 2.0))
    ),
    "a ceiling that moves": Scheme(
        PrescribedMotion("base", Harmonic(1.0, 2.0)),
        Mass("x", 1.0),
        KelvinVoigt("base", "x", 1.0, 1.0),
        Bumper("x", "ground", e=0.5, gap=1.0),
    ),
    "balls in a column": Scheme(
        *(Mass(f"x_{i}", 1.0, symbols=(f"m_{i}",)) for i in range(1, 6)),
        *(Bumper(f"x_{i}", f"x_{i + 1}", e=1.0, name=f"R_{i}", symbols=(f"R_{i}",)) for i in range(1, 5)),
    ),
    "a bar above a wall": Scheme(
        bar := Bar("a", "b", E=900.0, A=1.0, rho=1.0, L=10.0, elements=40, massless="b"),
        *bar.weight(10.0),
        Bumper("b", "ground", gap=5.0),
    ),
    "two chains": Scheme(Mass("a", 1.0), Spring("a", "ground", 1.0), Mass("b", 1.0), Spring("b", "ground", 1.0)),
}


@pytest.fixture(scope="module")
def runs() -> dict[str, list[Trajectory]]:
    """Each system by each method."""
    problems = {name: lcpimpact.load_problem(name) for name in SYSTEMS}
    return {
        name: [lcpimpact.simulate(problem, method, dt=1e-2, t_end=3.0) for method in METHODS]
        for name, problem in problems.items()
    }


def pieces(scheme: Scheme) -> list[Any]:
    """Return what is to be drawn: loads on nodes that elements keep to themselves are not."""
    inner = {node for element in scheme.elements for node in element.inner}
    every = [piece for element in scheme.elements for piece in element.drawn()]
    return [piece for piece in every if len(piece.nodes) > 1 or piece.node not in inner]


def random_scheme(seed: int) -> Scheme:
    """Return elements of every kind between any of two to six nodes."""
    rng = np.random.default_rng(seed)
    nodes = ["ground", "x", "y_1", "a", "w", "z_12"][: 2 + seed % 5]
    scheme = Scheme()
    for i in range(int(rng.integers(len(nodes), 2 * len(nodes) + 1))):
        a, b = (nodes[j] for j in rng.choice(len(nodes), 2, replace=False))
        node, name, arms = nodes[1 + i % (len(nodes) - 1)], f"N{i}", (1.0,) * (1 + i % 5)
        kinds = [
            Spring(a, b, 1.0),
            Dashpot(a, b, 1.0),
            KelvinVoigt(a, b, 1.0, 1.0),
            Bumper(a, b, e=0.5, name=name),
            Slider(a, b, 1.0, name=name),
            Jenkins(a, b, 1.0, 1.0, k_h=1.0 if i % 2 else None, name=name),
            HertzSpring(a, b, 1.0),
            HuntCrossley(a, b, 1.0, 1.0),
            Maxwell(a, b, 1.0, 1.0, name=name),
            Zener(a, b, 1.0, 1.0, 1.0, name=name),
            GeneralizedMaxwell(a, b, 1.0, arms, arms, name=name),
            Rope(a, b, slack=1.0, name=name),
            NegativeSpring(a, b, 1.0),
            Mass(node, 1.0),
            Load(node, 1.0),
        ]
        scheme.add(kinds[rng.integers(len(kinds))])
    return scheme


def registered(name: str) -> Scheme:
    scheme = lcpimpact.load_problem(name).scheme
    if not isinstance(scheme, Scheme):
        pytest.skip("no scheme, but matrices")
    return scheme


def assert_no_symbol_meets_another_or_a_text(scheme: Scheme, figure: Figure) -> None:
    """The boxes around symbols and bodies are apart, and no text stands in one but the names of the bodies."""
    layout = Layout(scheme.elements)
    ax = figure.axes[0]
    found: list[tuple[str, float, float, float, float]] = []
    for link in layout.links:
        half = half_breadth(link.part)
        low, high = layout.edge(layout.y, link.bottom, 1), layout.edge(layout.y, link.top, -1)
        # Without its leads, which a label may stand beside.
        ends = link.leads if link.down else link.leads[::-1]
        s = [s for stroke in link.part.strokes for s, t in stroke if t]
        top, bottom = (min(s), max(s)) if link.down else (1.0 - max(s), 1.0 - min(s))
        low, high = low + ends[1] + (1.0 - bottom) * link.body, high - ends[0] - top * link.body
        found.append((str(link.part), link.x - half, link.x + half, low, high))
    for node in layout.nodes:
        if layout.bodies(node):
            left, right = layout.span(node)
            found.append((f"Mass {node}", left, right, layout.edge(layout.y, node, -1), layout.edge(layout.y, node, 1)))
    assert len(found) == len(layout.links) + len({p.node for p in pieces(scheme) if isinstance(p, Mass)})
    for one, other in combinations(found, 2):
        across = min(one[2], other[2]) - max(one[1], other[1])
        along = min(one[4], other[4]) - max(one[3], other[3])
        assert across <= 1e-9 or along <= 1e-9, (one, other)
    for text, box in boxes(figure):
        (x0, y0), (x1, y1) = ax.transData.inverted().transform([(box.x0, box.y0), (box.x1, box.y1)])
        for name, left, right, low, high in found:
            inside = min(x1, right) - max(x0, left) > 0.02 and min(y1, high) - max(y0, low) > 0.02
            assert not inside or (name.startswith("Mass") and left <= x0 <= x1 <= right), (text, name)


def texts(figure: Figure) -> list[Text]:
    """Return every text that shows, tick labels and legends included."""
    return [text for text in figure.findobj(Text) if text.get_visible() and text.get_text().strip()]


@lru_cache(maxsize=1)
def boxes(figure: Figure) -> list[tuple[str, Any]]:
    """Return each text with its box in pixels, as the Agg renderer places it; a figure that is judged changes no more."""
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
    shown = pieces(scheme)
    expected = Counter(", ".join(map(math_text, p.symbols)) for p in shown if not isinstance(p, PrescribedMotion))
    expected += Counter(math_text(symbol) for p in shown if isinstance(p, Bumper) for symbol in p.symbols)
    expected += Counter("$y(t)$" for p in shown if isinstance(p, PrescribedMotion))
    outer = {node for e in scheme.elements for node in (e.nodes[0], e.nodes[-1])}
    inner = {node for e in scheme.elements for node in e.inner}
    expected += Counter(math_text(node) for node in outer - inner - {"ground"})
    assert written == expected


@pytest.mark.parametrize("name", SCHEMES)
def test_every_element_is_drawn_by_its_own_strokes(name: str) -> None:
    ax = draw_scheme(SCHEMES[name]).axes[0]
    for kind in (each for each in ELEMENTS.values() if each.strokes and each is not PrescribedMotion):
        count = sum(type(piece) is kind for piece in pieces(SCHEMES[name]))
        lines = points(ax, kind.__name__)
        assert [len(line) for line in lines] == [len(stroke) for stroke in kind.strokes] * count


@pytest.mark.parametrize("name", SCHEMES)
def test_no_two_texts_or_symbols_of_a_scheme_overlap_and_none_is_cut_off(name: str) -> None:
    figure = draw_scheme(SCHEMES[name], title=name)
    assert_nothing_overlaps(figure)
    assert_nothing_is_cut_off(figure)
    assert_no_symbol_meets_another_or_a_text(SCHEMES[name], figure)


@pytest.mark.parametrize("name", list(PROBLEMS))
def test_every_registered_problem_is_drawn_without_overlaps(name: str) -> None:
    scheme = registered(name)
    figure = draw_scheme(scheme, title=name)
    assert_nothing_overlaps(figure)
    assert_nothing_is_cut_off(figure)
    assert_no_symbol_meets_another_or_a_text(scheme, figure)


@pytest.mark.parametrize("seed", [*range(20), 46, 69, 84, 96])
def test_a_random_scheme_is_drawn_without_overlaps(seed: int) -> None:
    scheme = random_scheme(seed)
    figure = draw_scheme(scheme)
    assert_nothing_overlaps(figure)
    assert_nothing_is_cut_off(figure)
    assert_no_symbol_meets_another_or_a_text(scheme, figure)


@pytest.mark.parametrize("scheme", [*SCHEMES.values(), random_scheme(69)], ids=[*SCHEMES, "two components"])
def test_no_link_runs_through_a_node(scheme: Scheme) -> None:
    layout = Layout(scheme.elements)
    for link in layout.links:
        for node in layout.nodes:
            left, right = layout.span(node)
            crosses = left < link.x < right and layout.y[link.bottom] < layout.y[node] < layout.y[link.top]
            assert node in (link.top, link.bottom) or not crosses, (str(link.part), node)


def test_pieces_in_series_are_drawn_as_an_arm_with_no_coordinate_of_their_own() -> None:
    ax = draw_scheme(SCHEMES["Zener"]).axes[0]
    (dashpot,), springs = [np.vstack(points(ax, "Dashpot"))], points(ax, "Spring")
    arm, alone = sorted(springs, key=lambda spring: abs(spring[0, 0] - dashpot[0, 0]))
    assert arm[[0, -1], 0] == pytest.approx(dashpot[[0, -1], 0], abs=1e-12)
    assert arm[:, 1].min() == pytest.approx(dashpot[:, 1].max(), abs=1e-12)
    assert alone[:, 1].max() == pytest.approx(arm[:, 1].max(), abs=1e-12)
    assert alone[:, 1].min() == pytest.approx(dashpot[:, 1].min(), abs=1e-12) == 0.0
    assert not [text.get_text() for text in ax.texts if "ground" in text.get_text()]


def test_a_bar_is_one_block_and_its_weight_stands_at_its_end_only() -> None:
    ax = draw_scheme(SCHEMES["a bar above a wall"]).axes[0]
    assert len(points(ax, "Bar")) == len(Bar.strokes)
    assert len(points(ax, "Load")) == len(Load.strokes)
    assert not points(ax, "Spring")


def test_more_than_three_arms_are_one_symbol() -> None:
    few, many = draw_scheme(SCHEMES["three arms"]).axes[0], draw_scheme(SCHEMES["five arms"]).axes[0]
    assert (len(points(few, "Spring")), len(points(many, "Spring"))) == (4, 0)
    assert len(points(many, "GeneralizedMaxwell")) == len(GeneralizedMaxwell.strokes)


def test_what_the_ground_holds_from_above_hangs() -> None:
    layout = Layout(SCHEMES["between two stops"].elements)
    assert layout.y[CEILING] > layout.y["x"] > layout.y["ground"]
    # Its reaction, too, pushes the mass down and the ceiling up.
    ax = draw_scheme(SCHEMES["between two stops"]).axes[0]
    labels = sorted(text.get_position()[1] for text in ax.texts if text.get_text() == "$R_2$")
    assert layout.y["x"] < labels[0] < labels[1] < layout.y[CEILING]


def test_a_plate_that_is_called_the_upper_one_stands_above() -> None:
    for a, b in (("p", "q"), ("q", "p")):
        layout = Layout((Bumper(a, b), Mass("p", 1.0), Mass("q", 1.0)))
        assert layout.y[a] > layout.y[b]


def test_no_link_runs_sideways() -> None:
    layout = Layout(SCHEMES["two masses side by side"].elements)
    assert all(layout.y[link.top] > layout.y[link.bottom] for link in layout.links)
    assert len(layout.links) == 4


def test_a_system_given_by_its_matrices_is_a_block_diagram() -> None:
    system = LinearComplementaritySystem(
        [[0.0, 1.0], [-1.0, 0.0]], np.eye(2), np.eye(2), np.eye(2), a=[1.0, 0.0], states=("v_C", "i_L")
    )
    figure = draw_scheme(system, title="circuit")
    written = " ".join(text.get_text() for text in figure.axes[0].texts)
    assert "A\\,x + B\\,λ + a(t)" in written
    assert "C\\,x + D\\,λ$" in written
    assert "$v_C$, $i_L$" in written
    assert r"0 \leq λ \perp w \geq 0" in written
    assert_nothing_overlaps(figure)
    assert_nothing_is_cut_off(figure)


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
    heads = [patch.get_xy() for patch in ax.patches if to_hex(patch.get_facecolor()) == FORCE_COLOR]
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
    assert motion.get_ylabel() == "$x$, $y$, $z$ [m]"
    assert [text.get_text() for text in motion.texts[:3]] == ["$x$", "$y$", "$z$"]
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == [
        "exact",
        "LCP, $h=0.01$ s",
        "RK4, $h=0.01$ s",
        "in contact",
    ]
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
    assert np.array_equal(reaction, lcp.reaction)


def test_contact_intervals_of_system_2_start_closed_though_its_force_starts_at_zero(
    runs: dict[str, list[Trajectory]],
) -> None:
    exact = runs["system-2"][0]
    opened, closed = (event.t for event in exact.events)
    assert contact_intervals(exact, "R") == [(0.0, opened), (closed, 3.0)]


# --- any run -----------------------------------------------------------------------------------------------------------


def ball(method: str, t_end: float) -> Trajectory:
    return lcpimpact.simulate(lcpimpact.load_problem("bouncing-ball"), method, dt=1e-2, t_end=t_end)


def simulated(name: str, method: str, **parameters: float) -> Trajectory:
    problem = lcpimpact.load_problem(name, **parameters)
    return lcpimpact.simulate(problem, method, dt=problem.t_end / 500, t_end=problem.t_end)


def oscillator(method: str) -> Trajectory:
    scheme = Scheme(Mass("x", 1.0), KelvinVoigt("x", "ground", 10.0, 0.5))
    return lcpimpact.simulate(Problem("oscillator", scheme, q0={"x": 1.0}), method, dt=1e-2, t_end=1.0)


@pytest.mark.parametrize("method", ["exact", "moreau-jean"])
def test_a_run_without_contacts_has_one_panel(method: str) -> None:
    figure = plot_trajectory(oscillator(method))
    assert [ax.get_ylabel() for ax in figure.axes] == ["$x$ [m]"]
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


def test_friction_is_drawn_on_both_sides_of_zero_with_the_names_of_its_events() -> None:
    run = simulated("coulomb-oscillator", "exact")
    figure = run.plot()
    motion, force = figure.axes
    assert force.get_ylabel() == "force [N]"
    (line,) = force.get_lines()
    values = np.asarray(line.get_ydata())
    r0 = run.problem.dynamics.r_max[0]
    assert np.nanmin(values) == pytest.approx(-r0, rel=1e-9)
    assert np.nanmax(values) == pytest.approx(r0, rel=1e-9)
    assert [text.get_text() for text in motion.texts] == ["slips"] * (len(run.events) - 1) + ["sticks"]
    assert_nothing_overlaps(figure)
    assert_nothing_is_cut_off(figure)


def test_what_an_element_has_inside_stays_out_of_the_picture() -> None:
    run = simulated("plastic-bar-impact", "moreau-jean", elements=6)
    assert len(run.problem.dynamics.nodes) > 10
    assert len(run.problem.dynamics.contacts) > 3
    figure = run.plot()
    assert [[line.get_label() for line in ax.get_lines()] for ax in figure.axes[:2]] == [["$x$", "$y$", "$w$"], ["$R$"]]
    assert {event.contact for event in run.events} > {"R"}
    assert {event.contact for event in shown_events(run)} <= {"R"}
    assert not [text for ax in figure.axes for text in ax.texts if "F" in text.get_text()]
    # A Jenkins element is drawn with its slider, whose force is shown; its inner node is not.
    figure = simulated("jenkins-cycle", "moreau-jean").plot()
    assert [[line.get_label() for line in ax.get_lines()] for ax in figure.axes] == [["$x$"], ["$F$"]]


def test_a_system_given_by_its_matrices_has_states_and_multipliers() -> None:
    figure = simulated("diode-bridge", "moreau-jean").plot()
    assert [ax.get_ylabel() for ax in figure.axes] == ["states", "mean multipliers of a step"]
    assert len(figure.axes[1].get_lines()) == 4


def test_a_reaction_that_is_all_impulses_has_no_panel_of_its_own() -> None:
    figure = ball("exact", 1.0).plot()
    assert [ax.get_ylabel() for ax in figure.axes] == ["$x$ [m], downwards", "impulse [N s]"]
    (needles,) = figure.axes[1].get_lines()
    assert len(needles.get_xdata()) == 1


def test_the_title_says_the_options_that_are_not_the_usual_ones() -> None:
    assert ball("moreau-jean", 0.1).plot().get_suptitle() == "bouncing-ball by moreau-jean"
    run = lcpimpact.simulate(lcpimpact.load_problem("bouncing-ball"), "moreau-jean", dt=1e-2, t_end=0.1, theta=1.0)
    assert run.plot().get_suptitle() == "bouncing-ball by moreau-jean(theta=1.0)"


def test_many_events_are_marked_but_not_named() -> None:
    run = ball("exact", 5.0)
    assert len(run.events) > 100
    figure = plot_trajectory(run)
    assert [ax.get_ylabel() for ax in figure.axes] == ["$x$ [m], downwards", "reaction [N]", "impulse [N s]"]
    assert not [text for ax in figure.axes for text in ax.texts]
    assert f"{len(run.events)} events" in figure.get_suptitle()
    (impulses,) = figure.axes[2].get_lines()
    np.testing.assert_allclose(impulses.get_ydata(), [e.impulse for e in run.events if e.impulse > 0.0], rtol=1e-12)
    assert_nothing_overlaps(figure)


def test_events_that_stand_close_share_one_name_and_names_do_not_overlap() -> None:
    run = ball("exact", 3.6)
    assert 9 <= len(run.events) < 12
    figure = plot_trajectory(run)
    names = figure.axes[0].texts
    assert {text.get_text() for text in names} == {"impact"}
    assert len({text.get_position()[1] for text in names}) == 1
    assert 3 <= len(names) < len(run.events)
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
    for cone, text in zip(cones(np.array(M)), [t for t in ax.texts if "\\{" in t.get_text()], strict=True):
        x, y = text.get_position()
        if cone.kind == "wedge":
            radius = wedges(ax)[cone.name][0].r
            assert cone.contains(np.degrees(np.arctan2(y, x)) % 360.0)
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
    FigureCanvasAgg(figure).draw()  # the legend beside the plane takes its room in the next drawing
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
    for name, angles in expected.items():
        (wedge,) = found[name]
        assert (wedge.theta1, wedge.theta2) == pytest.approx(angles, abs=1e-9)
        assert wedge.r == RADII[0]
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
        assert sum(cone.contains(angle) for cone in drawn) == len(solutions)
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
    assert [cone.contains(angle) for angle in (89.9, 90.0, 180.0, 225.0, 225.1, 0.0)] == [
        False,
        True,
        True,
        True,
        False,
        False,
    ]
    across = Cone((0, 1), np.array([[1.0, 1.0], [1.0, -1.0]]))
    assert [across.contains(angle) for angle in (0.0, 44.0, 46.0, 314.0, 316.0, 180.0)] == [
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
        (np.eye(4), None, None, "M has order 4; the cones can be drawn for order 2 and 3"),
        ([[1.0, np.nan], [0.0, 1.0]], None, None, "not finite"),
        (np.eye(2), [1.0], None, r"q must have shape \(2,\)"),
        (np.eye(2), [1.0, np.inf], None, "q has an entry that is not finite"),
        (np.eye(3), [1.0, 0.0], None, r"q must have shape \(3,\)"),
        (np.eye(2), None, "cones.jpg", "must end in one of"),
    ],
)
def test_cones_that_cannot_be_drawn_are_refused(M: Any, q: Any, path: str | None, said: str) -> None:
    with pytest.raises(InputError, match=said):
        plot_cones(M, q, path)


# --- complementary cones in space --------------------------------------------------------------------------------------

CASES_IN_SPACE = {
    "a P-matrix": ([[2, -1, 0], [-1, 2, -1], [0, -1, 2]], [-1, -1, 0.5], "one solution for every $q$: a P-matrix"),
    "not symmetric": ([[1, 2, 2], [0, 1, 2], [0, 0, 1]], [-1, -1, -1], "one solution for every $q$: a P-matrix"),
    "indefinite": ([[1, 2, 0], [2, 1, 0], [0, 0, 1]], [-4, -5, -1], "1 or 3 solutions, depending on $q$"),
    "redundant contacts": ([[1, 1, 0], [1, 1, 0], [0, 0, 1]], [-1, -1, -1], "one solution; infinitely many on a thick"),
    "negative": (-np.eye(3), [1, 1, 1], "0 or 8 solutions, depending on $q$"),
    "zero": (np.zeros((3, 3)), [0, 1, 0], "0 or 1 solutions, depending on $q$; infinitely many on a thick line"),
}


@pytest.mark.parametrize("case", CASES_IN_SPACE)
def test_the_eight_cones_are_drawn_named_and_counted(case: str, tmp_path: Path) -> None:
    M, q, verdict = CASES_IN_SPACE[case]
    figure = plot_cones(np.array(M, dtype=float), q, tmp_path / "cones.svg")
    assert verdict in figure.get_suptitle()
    legend = [text.get_text() for text in figure.legends[0].get_texts()]
    names = ["$\\{" + cone.name[1:-1] + "\\}$" for cone in cones(np.array(M, dtype=float))]
    assert [f"{text.split('$:')[0]}$" for text in legend[:8]] == names
    written = [text.get_text() for ax in figure.axes for text in ax.texts]
    degenerate = 1 if case == "zero" else 0  # the cone {0} has no place
    assert len([name for name in names if name in written]) == 8 - degenerate
    assert "$e_1$" in written
    found = lcpimpact.all_solutions(np.array(M, dtype=float), q)
    assert len([text for text in legend if text.startswith("$z$")]) == len(found)


@pytest.mark.parametrize("seed", range(12))
def test_a_direction_in_space_lies_in_as_many_cones_as_the_problem_has_solutions(seed: int) -> None:
    rng = np.random.default_rng(seed)
    M = rng.normal(size=(3, 3)) + seed % 4 * np.eye(3)
    columns = [cone.columns for cone in cones(M)]
    numbers = space.counts(columns)
    q = rng.normal(size=(40, 3))
    counted = np.sum([space.holds(cone, q) for cone in columns], axis=0)
    assert counted.tolist() == [len(lcpimpact.all_solutions(M, each)) for each in q]
    assert set(counted.tolist()) <= set(numbers)
    minors = [np.linalg.det(M[np.ix_(rows, rows)]) for k in (1, 2, 3) for rows in map(list, combinations(range(3), k))]
    assert (numbers == [1]) == (min(minors) > 0.0), "one solution for every q: exactly the P-matrices"


@pytest.mark.parametrize("seed", range(6))
def test_the_outline_in_each_view_holds_what_its_cone_holds(seed: int) -> None:
    rng = np.random.default_rng(seed)
    for cone in cones(rng.normal(size=(3, 3))):
        for view in space.VIEWS:
            rays = space.clipped(list(space.unit_columns(cone.columns)), view)
            points = rng.normal(size=(200, 3))
            points /= np.linalg.norm(points, axis=1, keepdims=True)
            points = points[points @ view.axes[2] > 0.0]
            inside = space.holds(cone.columns, points)
            if len(rays) < 3:
                assert not inside.any()
                continue
            rim, places = view.flat(space.outline(rays)), view.flat(points)
            sure = np.linalg.norm(places[:, None] - rim, axis=2).min(axis=1) > 0.05
            np.testing.assert_array_equal(MplPath(rim).contains_points(places)[sure], inside[sure])
            assert sure.mean() > 0.5


@pytest.mark.parametrize(
    ("columns", "q", "kind", "endless"),
    [
        ([[1, 0, 0], [0, 1, 0], [1, 1, 0]], [1, 1, 0], "sector", True),
        ([[1, 0, 0], [0, 1, 0], [1, 1, 0]], [1, 0, 0], "sector", False),
        ([[1, 0, 0], [0, 1, 0], [1, 1, 0]], [1, 0, 1], "sector", False),
        ([[1, 0, 0], [2, 0, 0], [3, 0, 0]], [1, 0, 0], "ray", True),
        ([[1, 0, 0], [-2, 0, 0], [3, 0, 0]], [0, 0, 0], "line", True),
        ([[1, 0, 0], [0, 0, 0], [0, 1, 0]], [1, 0, 0], "sector", True),
        ([[0, 0, 0]] * 3, [0, 0, 1], "origin", False),
        ([[1, 0, 0], [0, 1, 0], [0, 0, 1]], [1, 1, 1], "wedge", False),
    ],
)
def test_flat_cones_hold_a_direction_in_one_way_or_many(columns: Any, q: Any, kind: str, endless: bool) -> None:
    assert space.kind_of(np.array(columns, dtype=float)) == kind
    assert space.is_dependent_at(np.array(columns, dtype=float), np.array(q, dtype=float)) == endless


def test_axes_are_for_the_plane() -> None:
    with pytest.raises(InputError, match="a figure of two views: leave ax out"):
        plot_cones(np.eye(3), ax=Figure().add_subplot())


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
from lcpimpact.plotting.schematic import FORCE_COLOR, draw_scheme
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


def with_unit(unit):
    elements = [
        li.Mass("x", 1.0),
        li.Load("x", 9.81),
        li.Bumper("x", "ground", 0.1, 0.5),
        li.Spring("x", "ground", 40.0),
    ]
    return li.Problem("unit", li.Scheme(*elements), t_end=0.5, units={"x": unit})


@pytest.mark.parametrize("unit", ["$$", r"$\nope$", "$", r"\$", "m$^{", "$x", "_^{}"])
def test_a_unit_is_no_mathematics(unit, tmp_path):
    run = li.simulate(with_unit(unit), dt=0.05)
    run.plot(tmp_path / "run.png")
    assert unit in html.unescape(run._repr_html_())


def test_a_unit_is_no_mathematics_in_studies_either(tmp_path):
    problem = with_unit(r"$\nope$")
    li.simulate(problem, dt=0.05).animate(tmp_path / "run.html", seconds=0.2, fps=10)
    li.compare(problem, ["moreau-jean"], dt=0.05).plot(tmp_path / "compare.png")
    li.convergence(problem, ["moreau-jean"], dts=[0.05, 0.02]).plot(tmp_path / "converge.png")
    pytest.importorskip("xarray")
    found = li.sweep(problem, {"Mass.m": [1.0, 2.0]}, dt=0.05, outputs=("x.max",))
    save(li.plot_sweep(found, "x.max"), tmp_path / "sweep.png")
