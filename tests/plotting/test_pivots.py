"""The picture of a trace: its points are those of tableaus by hand, in their order."""

from itertools import pairwise

import numpy as np
import pytest
from numpy.testing import assert_allclose
from test_plotting import assert_nothing_is_cut_off, assert_nothing_overlaps

import lcpimpact as li
from lcpimpact.plotting.style import LCP

KAPPEL = ([[2.0, 1.0], [1.0, 2.0]], [-5.0, -6.0])
"""The LCP of docs/guide/lcp.md: Lemke's method goes from z = 0 by (0, 1) to (4/3, 7/3), and z0 from 6 by 4 to 0."""

SPACE = ([[1.0, 2.0, 0.0], [2.0, 1.0, 0.0], [0.0, 0.0, 1.0]], [-4.0, -5.0, -1.0])


def drawn(M, q, solver="lemke", **options):
    trace = li.solve_lcp(M, q, solver, trace=True, throw=False, **options).trace
    return trace, li.plot_trace(trace)


def test_the_path_of_lemke_by_hand():
    _, figure = drawn(*KAPPEL)
    path, covering = figure.axes
    line = next(line for line in path.get_lines() if len(line.get_xdata()) == 3)
    assert_allclose(line.get_xydata(), [[0.0, 0.0], [0.0, 1.0], [4 / 3, 7 / 3]], atol=1e-12)
    assert [text.get_text() for text in path.texts if text.get_text()] == ["1", "2", "3"]
    assert_allclose(covering.get_lines()[0].get_xydata(), [[1.0, 6.0], [2.0, 4.0], [3.0, 0.0]], atol=1e-12)
    written = [tick.get_text() for tick in covering.get_xticklabels()]
    assert written[1] == "2\n+ $z_{2}$\n− $w_{1}$"
    assert "covering vector $d$ = (1, 1)" in figure.get_suptitle()
    assert_nothing_overlaps(figure)
    assert_nothing_is_cut_off(figure)


def test_on_the_dashed_lines_w_is_zero():
    trace, figure = drawn(*KAPPEL)
    lines = {line.get_label(): line.get_xydata() for line in figure.axes[0].get_lines() if "w_" in line.get_label()}
    assert list(lines) == ["$w_1 = 0$", "$w_2 = 0$"]
    for i, points in enumerate(lines.values()):
        assert_allclose(points @ trace.M[i] + trace.q[i], 0.0, atol=1e-12)


def test_the_path_of_lemke_is_almost_complementary_in_space():
    """Of every pair but one, z_i or w_i is zero on each segment, by the points that were drawn."""
    _, figure = drawn(*SPACE)
    blue = [line for line in figure.axes[0].get_lines() if line.get_color() == LCP]
    xyz = next(np.array(line.get_data_3d()) for line in blue if len(line.get_data_3d()[0]) == 3)
    assert_allclose(xyz.T, [[0.0, 0.0, 0.0], [0.0, 4.0, 0.0], [0.0, 5.0, 1.0]], atol=1e-12)
    M, q = map(np.array, SPACE)
    z0 = figure.axes[1].get_lines()[0].get_ydata()
    for (a, low), (b, high) in pairwise(zip(xyz.T, z0, strict=True)):
        z, w = 0.5 * (a + b), M @ (0.5 * (a + b)) + q + 0.5 * (low + high)
        assert (z > -1e-12).all()
        assert (w > -1e-12).all()
        assert np.count_nonzero(z * w > 1e-12) <= 1


def test_a_path_that_ends_on_a_ray_says_where_it_stops():
    _, figure = drawn([[0.0, 1.0], [-1.0, 0.0]], [-1.0, -1.0])
    assert "lemke in 1 step: it stops at $z$ = (0, 0) with $z_0$ = 1" in figure.get_suptitle()


@pytest.mark.parametrize("solver", ["murty", "keller", "psor", "block-pivoting", "newton-fb", "interior-point"])
def test_other_solvers_end_at_the_solution_with_their_residual(solver):
    trace, figure = drawn([[2.0, -1.0], [-1.0, 2.0]], [-1.0, -1.0], solver)
    last = figure.axes[1].get_lines()[0].get_xydata()[-1]
    assert last[0] == len(trace)
    assert last[1] < 1e-6
    assert f"{solver} in" in figure.get_suptitle()
    assert "$z$ = (1, 1)" in figure.get_suptitle()


def test_iterates_are_named_at_their_ends():
    _, figure = drawn([[2.0, -1.0], [-1.0, 2.0]], [-1.0, -1.0], "psor")
    assert [text.get_text() for text in figure.axes[0].texts if text.get_text()] == ["1", "25"]
    assert_nothing_overlaps(figure)


def test_what_cannot_be_drawn_is_refused(tmp_path):
    for n in (1, 4):
        trace = li.solve_lcp(np.eye(n), -np.ones(n), "lemke", trace=True).trace
        with pytest.raises(li.InputError, match=f"the LCP has order {n}; the path of z can be drawn for order 2 and 3"):
            li.plot_trace(trace)
    trace = li.solve_lcp(*KAPPEL, "lemke", trace=True).trace
    with pytest.raises(li.InputError, match="must end in one of"):
        li.plot_trace(trace, tmp_path / "a.jpg")
    assert li.plot_trace(trace, tmp_path / "a.svg")
    assert [each.name for each in tmp_path.iterdir()] == ["a.svg"]
