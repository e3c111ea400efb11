"""Sobol' indices against a function whose indices are known, and against SciPy."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import stats

import lcpimpact as li

xarray = pytest.importorskip("xarray")

PI = np.pi


def dataset_of(samples, function):
    """The Dataset that a sweep would return for a function of the parameters."""
    columns = [samples.values[name] for name in samples.values]
    data = {"y": ("sample", function(np.array(columns))), "status": ("sample", np.zeros(len(samples), dtype=int))}
    return xarray.Dataset(
        data, attrs={"rule": samples.rule, "count": samples.count, "parameters": ", ".join(samples.values)}
    )


def ishigami(x):
    return np.sin(x[0]) + 7.0 * np.sin(x[1]) ** 2 + 0.1 * x[2] ** 4 * np.sin(x[0])


def test_the_function_of_ishigami():
    samples = li.draw_samples(dict.fromkeys(["x1", "x2", "x3"], (-PI, PI)), 4096, "saltelli")
    table = li.sobol_indices(dataset_of(samples, ishigami), "y")
    variance = 49.0 / 8.0 + 0.1 * PI**4 / 5.0 + 0.01 * PI**8 / 18.0 + 0.5
    first = np.array([0.5 * (1.0 + 0.1 * PI**4 / 5.0) ** 2, 49.0 / 8.0, 0.0]) / variance
    both = 8.0 * 0.01 * PI**8 / 225.0 / variance
    assert_allclose(table["first"], first, atol=0.01)
    assert_allclose(table["total"], first + np.array([both, 0.0, both]), atol=0.01)
    for name in ("first", "total"):
        assert (table[f"{name}_low"] <= table[name]).all()
        assert (table[name] <= table[f"{name}_high"]).all()
        assert (table[f"{name}_high"] - table[f"{name}_low"]).max() < 0.2
    again = li.sobol_indices(dataset_of(samples, ishigami), "y")
    assert again.equals(table), "the intervals have a seed"


def test_the_estimators_are_those_of_scipy():
    samples = li.draw_samples({"a": (0.0, 1.0), "b": (1.0, 3.0)}, 64, "saltelli", seed=5)
    y = ishigami(np.array([*samples.values.values(), samples.values["a"]]))
    table = li.sobol_indices(dataset_of(samples, lambda x: y), "y")
    a, b, *mixed = y.reshape(4, 1, 64)
    theirs = stats.sobol_indices(func={"f_A": a, "f_B": b, "f_AB": np.array(mixed)}, n=64)
    assert_allclose(table["first"], theirs.first_order.ravel(), rtol=1e-12)
    assert_allclose(table["total"], theirs.total_order.ravel(), rtol=1e-12)


def test_one_parameter_explains_everything():
    samples = li.draw_samples({"k_o": (3000.0, 5000.0)}, 64, "saltelli")
    found = li.sweep(li.load_problem("system-1"), samples, dt=1e-2, t_end=0.5, progress=False)
    table = li.sobol_indices(found, "R.max")
    assert_allclose(table[["first", "total"]], 1.0, atol=0.1)


def test_what_has_no_indices():
    samples = li.draw_samples({"a": (0.0, 1.0), "b": (1.0, 3.0)}, 4, "saltelli")
    good = dataset_of(samples, ishigami2)
    for dataset, output, said in (
        (dataset_of(li.draw_samples({"a": (0.0, 1.0)}, 4, "sobol"), lambda x: x[0]), "y", "draw_samples"),
        (good, "z", "unknown output"),
        (dataset_of(samples, lambda x: np.where(x[0] > 0.5, np.nan, x[0])), "y", "has no value in"),
        (dataset_of(samples, lambda x: 0.0 * x[0]), "y", "the same in all sets"),
        (dataset_of(samples, lambda x: 0.8 + 1e-16 * np.round(3.0 * x[0])), "y", "but for rounding"),
        (3.0, "y", "must be a Dataset of sweep"),
    ):
        with pytest.raises(li.InputError, match=said):
            li.sobol_indices(dataset, output)


def ishigami2(x):
    return np.sin(x[0]) + x[1]
