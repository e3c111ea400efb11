"""Up and down in plots over time: falling bodies are drawn falling, onto hatched surfaces."""

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from numpy.testing import assert_allclose

import lcpimpact as li
from lcpimpact.plotting.trajectory import panels
from lcpimpact.plotting.vertical import Surface, axes_of


def drawn_below(ax, low, high):
    """Whether the value low is drawn below the value high."""
    places = ax.transData.transform([(0.0, low), (0.0, high)])[:, 1]
    return places[0] < places[1]


def surfaces(ax):
    return [
        line.get_segments()[0][0, 1]
        for line in ax.collections
        if isinstance(line, LineCollection) and line.get_path_effects()
    ]


@pytest.fixture(scope="module")
def ball():
    return li.simulate(li.load_problem("bouncing-ball", H=2.0, e=0.5), "exact", dt=1e-2, t_end=1.0)


def test_a_ball_falls_onto_the_floor(ball):
    ax = ball.plot().axes[0]
    assert drawn_below(ax, 2.0, 0.0)
    assert surfaces(ax) == [2.0]
    assert ax.get_ylabel() == "$x$ [m], downwards"
    low, high = sorted(ax.get_ylim())
    assert low < 0.0
    assert high > 2.0


def test_heights_are_above_the_floor(ball):
    ax = ball.plot(up=True).axes[0]
    (line,) = ax.get_lines()
    assert_allclose([line.get_ydata()[0], np.nanmin(line.get_ydata())], [2.0, 0.0], atol=1e-12)
    assert drawn_below(ax, 0.0, 2.0)
    assert surfaces(ax) == [0.0]
    assert ax.get_ylabel() == "height above the floor [m]"


def test_an_animation_falls_as_its_curve_does(ball):
    (panel, *_) = panels(ball)
    assert panel.axis.down
    (panel, *_) = panels(ball, up=True)
    assert panel.axis.label == "height above the floor [m]"


def test_a_coordinate_that_weight_pulls_down_to_smaller_values_is_a_height():
    scheme = li.Scheme(li.Mass("y", m=1.0), li.Load("y", f=-9.81), li.Bumper("ground", "y", gap=0.5, e=0.0))
    run = li.simulate(li.Problem("height", scheme), "exact", dt=1e-2, t_end=0.5)
    ax = run.plot().axes[0]
    assert_allclose(run["y"][-1], -0.5)
    assert drawn_below(ax, -0.5, 0.0)
    assert surfaces(ax) == [-0.5]
    (axis,) = axes_of(run.problem, ["y"])
    assert axis.surfaces == (Surface("y", -0.5, below=True),)


def test_a_floor_and_a_ceiling_are_on_their_sides():
    scheme = li.Scheme(
        li.Mass("x", m=1.0), li.Bumper("x", "ground", gap=0.1, e=1.0), li.Bumper("ground", "x", gap=0.2, e=1.0)
    )
    problem = li.Problem("between", scheme, v0={"x": 1.0})
    (axis,) = axes_of(problem, ["x"])
    assert axis.down
    assert axis.surfaces == (Surface("x", 0.1, below=True), Surface("x", -0.2, below=False))
    assert sorted(surfaces(li.simulate(problem, "exact", dt=1e-2, t_end=1.0).plot().axes[0])) == [-0.2, 0.1]
    (axis,) = axes_of(problem, ["x"], up=True)
    assert [(each.place, each.below) for each in axis.surfaces] == [(0.0, True), (pytest.approx(0.3), False)]


def test_a_surface_out_of_reach_is_not_drawn():
    scheme = li.Scheme(li.Mass("x", m=1.0), li.Load("x", f=1.0), li.Bumper("x", "ground", gap=1e3, e=1.0))
    ax = li.simulate(li.Problem("far", scheme), "exact", dt=1e-2, t_end=1.0).plot().axes[0]
    assert surfaces(ax) == []
    assert drawn_below(ax, 0.5, 0.0)


@pytest.mark.parametrize(
    ("name", "found"),
    [
        ("system-3", [("x y z", True)]),
        ("coulomb-oscillator", [("x", False)]),
        ("rolling-sphere", [("x", False), ("y", True), ("φ", False)]),
        ("block-on-belt", [("x b", False), ("y", True)]),
        ("pi-billiard", [("x1 x2", True)]),
        ("rocking-block", [("θ", False)]),
        ("woodpecker", [("y", True), ("φ_M φ_S", False)]),
        ("diode-bridge", [("v_L i_L", False)]),
        ("hertz-impact", [("x", True)]),
    ],
)
def test_coordinates_of_one_unit_and_direction_share_a_panel(name, found):
    problem = li.load_problem(name)
    axes = axes_of(problem, problem.dynamics.nodes)
    assert [(" ".join(axis.nodes), axis.down) for axis in axes] == found


def test_the_block_of_angles_rocks_on_what_is_below():
    (axis,) = axes_of(li.load_problem("rocking-block"), ["θ"])
    assert axis.surfaces == (Surface("θ", 0.0, below=True),)


def test_the_surface_of_one_of_several_coordinates_is_named():
    ax = li.simulate(li.load_problem("pi-billiard"), "exact", dt=1e-2, t_end=4.0).plot().axes[0]
    assert "surface of $x_2$" in [text.get_text() for text in ax.texts]


def test_a_rope_is_no_floor():
    scheme = li.Scheme(li.Mass("x", m=1.0), li.Load("x", f=9.81), li.Rope("ground", "x", slack=0.1, e=0.0))
    (axis,) = axes_of(li.Problem("rope", scheme), ["x"])
    assert (axis.down, axis.surfaces) == (True, ())


def test_what_rests_is_drawn_at_rest_and_not_as_rounding():
    run = li.simulate(li.load_problem("rolling-sphere"), "exact", dt=1e-2, t_end=0.5)
    ax = next(ax for ax in run.plot().axes if ax.get_ylabel().startswith("$y$"))
    assert np.ptp(ax.get_ylim()) > 0.05


def test_the_names_at_the_ends_of_curves_stand_beside_them():
    figure = li.compare(li.load_problem("two-ball-drop"), ["moreau-jean"], dt=1e-3, t_end=0.8).plot()
    ax = figure.axes[0]
    ends = {text.get_text(): text.xy[1] for text in ax.texts if text.get_text() in ("$x_1$", "$x_2$")}
    assert ends["$x_2$"] > ends["$x_1$"]


@pytest.mark.parametrize(("gap", "below"), [(1.0, True), (-1.0, False)])
def test_the_hatching_is_on_the_side_where_no_body_can_be(gap, below):
    ends = ("x", "ground") if below else ("ground", "x")
    scheme = li.Scheme(li.Mass("x", m=1.0), li.Bumper(*ends, gap=1.0, e=1.0))
    (axis,) = axes_of(li.Problem("one side", scheme), ["x"])
    figure = Figure(dpi=100)
    ax = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    ax.set_axis_off()
    ax.plot([0.0, 1.0], [-2.0, 2.0], alpha=0.0)
    axis.orient(ax)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    ink = 255.0 - np.asarray(canvas.buffer_rgba())[..., 0].astype(float)
    row = round(ink.shape[0] - ax.transData.transform((0.0, gap))[1])
    over, under = ink[row - 9 : row - 2].sum(), ink[row + 3 : row + 10].sum()
    assert (under > 10.0 * over + 1.0) if below else (over > 10.0 * under + 1.0)
