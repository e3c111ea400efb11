"""Pictures of sweeps show what was computed."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import lcpimpact as li
from lcpimpact.plotting.style import save

pytest.importorskip("xarray")
SYSTEM_1 = li.load_problem("system-1")


def sweep_of(parameters, **options):
    return li.sweep(SYSTEM_1, parameters, **{"dt": 1e-2, "progress": False} | options)


@pytest.fixture(scope="module")
def grid():
    k_o, c_o = [5000.0, 3000.0, 3500.0, 4000.0, 4500.0], [-1.0, 200.0, 250.0, 300.0, 350.0]
    return sweep_of({"k_o": k_o, "c_o": c_o}, outputs=("R.max", "x"))


def test_one_parameter_is_a_line(tmp_path):
    found = sweep_of({"c_o": [300.0, -1.0, 200.0]})
    figure = li.plot_sweep(found)
    line, without = figure.axes[0].lines
    assert_array_equal(line.get_xdata(), [-1.0, 200.0, 300.0])
    assert_array_equal(line.get_ydata(), found["R.max"].values[[1, 2, 0]])
    assert_array_equal(without.get_xdata(), [-1.0])
    assert figure.axes[0].get_xlabel() == "$c_o$ [N s/m]"
    save(figure, tmp_path / "a.svg")


def test_two_parameters_are_a_heat_map_with_contours(grid, tmp_path):
    figure = li.plot_sweep(grid, "R.max")
    mesh = next(each for each in figure.axes[0].collections if hasattr(each, "get_coordinates"))
    shown = np.ma.filled(np.ma.asarray(mesh.get_array(), dtype=float), np.nan).reshape(5, 5)
    assert_array_equal(shown, grid["R.max"].sortby(["k_o", "c_o"]).values.T)
    assert "grey" in figure.axes[0].get_title(loc="left")
    assert figure.axes[1].get_ylabel() == "R.max [N]"
    save(figure, tmp_path / "a.png")


def test_two_parameters_as_lines_and_one_at_a_value_of_the_other(grid):
    figure = li.plot_sweep(grid, x="c_o")
    assert len(figure.axes[0].lines) == 6, "five values of k_o, and the mark of the refused one of c_o"
    one = li.plot_sweep(grid, at={"k_o": 3600.0}).axes[0].lines[0]
    assert_array_equal(one.get_ydata(), grid["R.max"].sel(k_o=3500.0).sortby("c_o"))


def test_samples_are_parallel_coordinates(tmp_path):
    found = sweep_of(li.draw_samples({"k_o": (3000.0, 5000.0), "c_o": (-50.0, 400.0)}, 16))
    figure = li.plot_sweep(found)
    strands = figure.axes[0].collections[0].get_segments()
    assert len(strands) == 16
    heights = np.array(strands)[:, :, 1]
    known = ~np.isnan(found["R.max"].values)
    assert (heights[:, 2] < 0.0).sum() == (~known).sum() > 0
    assert_allclose(heights[-1, 2], 1.0), "the greatest is on top"
    k_o = found["k_o"].values[np.nanargmax(found["R.max"].values)]
    assert_allclose(heights[-1, 0], (k_o - found["k_o"].values.min()) / np.ptp(found["k_o"].values))
    save(figure, tmp_path / "a.pdf")


def test_sobol_indices_are_bars(tmp_path):
    found = sweep_of(li.draw_samples({"k_o": (3000.0, 5000.0), "m": (90.0, 110.0)}, 32, "saltelli"), t_end=0.5)
    table = li.sobol_indices(found, "R.max").sort_values("total")
    figure = li.plot_sobol(table, "R.max")
    total, first = (sorted(bar.get_width() for bar in bars) for bars in figure.axes[0].containers[:3:2])
    assert_allclose(total, table["total"])
    assert_allclose(first, sorted(table["first"]))
    save(figure, tmp_path / "a.png")


def test_what_cannot_be_drawn_is_a_sentence(grid):
    three = sweep_of({"k_o": [3e3, 4e3], "c_o": [2e2, 3e2], "m": [90.0, 100.0]}, dt=0.1)
    for dataset, options, said in (
        (grid, {"output": "R.min"}, "did you mean 'R.max'"),
        (grid, {"output": "x"}, "unknown output"),
        (grid, {"x": "k"}, "did you mean 'k_o'"),
        (grid, {"at": {"m": 1.0}}, "unknown parameter"),
        (grid, {"at": {"c_o": -1.0}}, "has no value in any set"),
        (three, {}, "give values of k_o by at"),
        (sweep_of({"k_o": [3e3]}, outputs=("x",)), {}, "whole series only"),
        (3, {}, "must be a Dataset of sweep"),
    ):
        with pytest.raises(li.InputError, match=said):
            li.plot_sweep(dataset, **options)
