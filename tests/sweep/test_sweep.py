"""A sweep gives for every set what a single run gives, whatever runs it, and repeats nothing that it has stored."""

import itertools
import math
import pickle
import sys
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from multiprocessing import get_context

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import lcpimpact as li
from lcpimpact.errors import Status
from lcpimpact.simulation import make_integrator
from lcpimpact.sweeps import chunks, sweep
from lcpimpact.sweeps.chunks import blocks_of, chunk_shape, sets_of
from lcpimpact.sweeps.job import Job
from lcpimpact.sweeps.sets import Sets, run_sets

xarray = pytest.importorskip("xarray")
SYSTEM_1 = li.load_problem("system-1")
GRID = {"k_o": [3000.0, 3924.0, 5000.0], "c_o": [200.0, 250.0]}


def sweep_of(parameters, *args, problem=SYSTEM_1, dt=1e-2, progress=False, **options):
    return li.sweep(problem, parameters, *args, dt=dt, progress=progress, **options)


def test_every_set_is_a_single_run_to_the_bit():
    outputs = ("R.max", "x@2.0", "open:1", "restitution", "x", "R")
    found = sweep_of(GRID, outputs=outputs)
    assert list(found["R.max"].dims) == ["k_o", "c_o"]
    assert found["x"].dims == ("k_o", "c_o", "t")
    assert found["R"].dims == ("k_o", "c_o", "t_R")
    assert found["R.max"].attrs["units"] == "N"
    for k_o, c_o in itertools.product(*GRID.values()):
        run = li.simulate(li.load_problem("system-1", k_o=k_o, c_o=c_o), dt=1e-2)
        one = found.sel(k_o=k_o, c_o=c_o)
        assert one["R.max"] == run["R"].max()
        assert one["x@2.0"] == run["x"][200]
        assert one["restitution"] == run.summary()["restitution"]
        assert one["open:1"] == next(event.t for event in run.events if event.kind == "open")
        assert_array_equal(one["x"], run["x"])
        assert_array_equal(one["R"], run["R"])
        assert_array_equal(one["t"], run.t)
        assert_array_equal(one["t_R"], run.t_reaction)


@pytest.mark.parametrize(
    ("name", "values", "run"),
    [
        ("theta", [0.5, 1.0], lambda value: li.simulate(SYSTEM_1, dt=1e-2, theta=value)),
        ("dt", [1e-2, 2e-2], lambda value: li.simulate(SYSTEM_1, dt=value)),
        ("h_o", [4.0, 5.0], lambda value: li.simulate(li.load_problem("system-1", h_o=value), dt=1e-2)),
        ("g", [9.0, 10.0], lambda value: li.simulate(li.load_problem("system-1", g=value), dt=1e-2)),
        ("v0.x", [4.0, 5.0], lambda value: li.simulate(li.with_values(SYSTEM_1, {"v0.x": value}), dt=1e-2)),
        ("3.c", [200.0, 250.0], lambda value: li.simulate(li.load_problem("system-1", c_o=value), dt=1e-2)),
        ("max_iter", [50, 60], lambda value: li.simulate(SYSTEM_1, dt=1e-2, max_iter=value)),
    ],
)
def test_what_can_be_swept(name, values, run):
    found = sweep_of({name: values})
    assert found["status"].max() == 0
    assert found["R.max"].values.tolist() == [run(value)["R"].max() for value in values]


def test_a_given_speed_stays_where_another_parameter_changes():
    assert li.with_values(li.load_problem("system-1", v_o=3.0), {"g": 5.0}).v0 == {"x": 3.0}
    assert li.with_values(SYSTEM_1, {"g": 5.0}).v0 == li.load_problem("system-1", g=5.0).v0


def test_constants_of_signals_are_swept():
    scheme = li.Scheme(li.Mass("x", m=1.0), li.Load("x", f=li.Harmonic(1.0, 2.0) + 3.0))
    problem = li.Problem("driven", scheme)
    addresses = {"Load.f.terms.0.amplitude": [1.0, 5.0], "f.terms.1.coefficients.0": [2.0, 3.0]}
    found = li.sweep(problem, addresses, dt=0.1, t_end=1.0, outputs=("x@1.0",))["x@1.0"]
    by_hand = [[a * (1.0 - math.cos(2.0)) / 4.0 + c / 2.0 for c in (2.0, 3.0)] for a in (1.0, 5.0)]
    assert_allclose(found, by_hand, rtol=1e-2)
    assert found["Load.f.terms.0.amplitude"].attrs["units"] == "N"


def test_a_list_of_sets_has_one_dimension():
    table = pd.DataFrame({"k_o": [3000.0, 3924.0, 3924.0], "c_o": [200.0, 250.0, 250.0]})
    for given in (table, li.Samples(table), li.Samples({name: list(table[name]) for name in table})):
        found = sweep_of(given)
        assert found["R.max"].dims == ("sample",)
        assert_array_equal(found["k_o"], table["k_o"])
        assert found["R.max"][1] == found["R.max"][2] == li.simulate(SYSTEM_1, dt=1e-2)["R"].max()


@pytest.mark.parametrize("rule", ["latin-hypercube", "sobol", "halton", "random", "saltelli"])
def test_samples_fill_their_ranges_and_are_the_same_for_the_same_seed(rule):
    ranges = {"k_o": (3000.0, 5000.0), "c_o": (1.0, 1e4)}
    found = li.draw_samples(ranges, 64, rule, seed=3, log=["c_o"])
    assert len(found) == 64 * (4 if rule == "saltelli" else 1)
    for name, (low, high) in ranges.items():
        assert low <= found.values[name].min() < found.values[name].max() <= high
    assert 80.0 < np.exp(np.log(found.values["c_o"]).mean()) < 125.0, "uniform in the logarithm"
    again = li.draw_samples(ranges, 64, rule, seed=3, log=["c_o"])
    assert again.table.equals(found.table)
    assert not li.draw_samples(ranges, 64, rule, seed=4, log=["c_o"]).table.equals(found.table)
    if rule == "latin-hypercube":
        cells = np.floor((found.values["k_o"] - 3000.0) / 2000.0 * 64)
        assert sorted(cells) == list(range(64))


def test_a_refused_set_is_a_row_with_its_status_and_the_others_have_theirs():
    found = sweep_of({"c_o": [-1.0, 250.0], "theta": [0.5, 7.0]})
    assert found["status"].values.tolist() == [[21, 21], [0, 21]]
    assert Status(21) is Status.NOT_RUN
    assert "must be a positive" in found["message"].values[0, 0]
    assert "theta" in found["message"].values[1, 1]
    assert found["message"].values[1, 0] == ""
    assert np.isnan(found["R.max"].values[0, 0])
    assert found["R.max"].values[1, 0] > 0.0


def test_a_failed_run_is_a_row_too_and_what_a_run_does_not_have_is_not_a_failure():
    ball = li.load_problem("bouncing-ball", e=0.5)
    found = sweep_of({"max_events": [2, 1000]}, "exact", problem=ball, t_end=1.3, outputs=("impact:1", "impact:9"))
    assert found["status"].values.tolist() == [Status.MAX_EVENTS, 0]
    assert "max_events" in found["message"].values[0]
    assert np.isnan(found["impact:1"].values[0])
    short = sweep_of({"e": [0.5]}, "exact", problem=ball, t_end=0.5, outputs=("impact:1", "impact:2"))
    assert short["status"].values.tolist() == [0]
    assert np.isnan(short["impact:2"].values[0])


def test_a_run_that_breaks_its_laws_has_no_outputs():
    found = sweep_of({"dt": [0.3, 0.001]}, "heun", problem=li.load_problem("system-2"))
    assert found["status"].values.tolist() == [Status.VIOLATED, 0]
    assert np.isnan(found["R.max"].values[0])
    assert "heun" in found["message"].values[0]


@pytest.mark.parametrize(
    ("parameters", "options", "said"),
    [
        ({"k_oo": [1.0]}, {}, "did you mean 'k_o'"),
        ({"thet": [1.0]}, {}, "did you mean 'theta'"),
        ({"9.k": [1.0]}, {}, "unknown number"),
        ({"q0.w": [1.0]}, {}, "unknown node"),
        ({"friction": [1.0]}, {}, "is no number"),
        ({"k_o": []}, {}, "at least one number"),
        ({"k_o": [1.0, np.nan]}, {}, "value 1 of k_o is nan"),
        ({"k_o": ["stiff"]}, {}, "must be numbers"),
        ({"k_o": [1.0, 1.0]}, {}, "repeat"),
        ({}, {}, "must map names"),
        (3.0, {}, "parameters"),
        ({"dt": [0.07]}, {}, "whole number of steps"),
        ({"k_o": [1.0]}, {"outputs": ("R.mx",)}, "did you mean 'R.max'"),
        ({"k_o": [1.0]}, {"outputs": ()}, "names nothing"),
        ({"k_o": [1.0]}, {"outputs": ("x@9.0",)}, "end at t_end = 3"),
        ({"dt": [1e-2]}, {"outputs": ("x",)}, "one dt"),
        ({"k_o": [1.0]}, {"outputs": ("R.max", "R.max")}, "named twice"),
        ({"k_o": [1.0]}, {"out": "here.csv"}, "must end in .zarr"),
        ({"k_o": [1.0]}, {"out": "/no/such/folder/a.zarr"}, "no folder"),
        ({"k_o": [1.0]}, {"theta_": 1.0}, "did you mean 'theta'"),
        ({"k_o": [1.0]}, {"lcp_solver": "lemk"}, "did you mean 'lemke'"),
        ({"k_o": [1.0]}, {"chunk": 0}, "chunk"),
    ],
)
def test_a_mistake_in_the_call_is_an_error_before_anything_runs(parameters, options, said, monkeypatch):
    monkeypatch.setattr(chunks, "run_sets", lambda *_: pytest.fail("a run"))
    with pytest.raises(li.InputError, match=said):
        sweep_of(parameters, **options)


@pytest.mark.parametrize(
    ("values", "said"),
    [({"a": [1.0], "b": [1.0, 2.0]}, "1 of a, 2 of b"), ({}, "none"), (4, "DataFrame"), ({"a": [np.inf]}, "finite")],
)
def test_a_list_of_sets_must_be_complete(values, said):
    with pytest.raises(li.InputError, match=said):
        li.Samples(values)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (({}, 4), "names no parameter"),
        (({"a": (1.0, 2.0)}, 0), "count"),
        (({"a": (1.0, 2.0)}, 12, "sobol"), "take 16"),
        (({"a": (1.0, 2.0)}, 4, "grid"), "unknown rule"),
        (({"a": (2.0, 1.0)}, 4), "lower one first"),
        (({"a": (1.0,)}, 4), "two finite numbers"),
    ],
)
def test_ranges_that_cannot_be_sampled(arguments, said):
    with pytest.raises(li.InputError, match=said):
        li.draw_samples(*arguments)
    with pytest.raises(li.InputError, match="above zero"):
        li.draw_samples({"a": (0.0, 1.0)}, 4, log=["a"])


def test_a_method_that_does_not_handle_the_problem_is_refused_before_anything_runs():
    with pytest.raises(li.UnsupportedError, match="rk4-paper does not handle"):
        sweep_of({"e": [0.5]}, "rk4-paper", problem=li.load_problem("bouncing-ball"))


def test_a_method_that_chooses_its_steps_gives_series_on_the_grid():
    found = sweep_of({"k_o": [3000.0, 5000.0]}, "dopri5", rtol=1e-8, dt=1e-1, t_end=0.4, outputs=("x", "R"))
    run = li.simulate(li.load_problem("system-1", k_o=5000.0), "exact", dt=1e-1, t_end=0.4)
    assert found["x"].shape == (2, 5)
    np.testing.assert_allclose(found["x"][1], run["x"], rtol=1e-3)


@pytest.mark.parametrize(("shape", "count"), [((7,), 3), ((3, 5), 4), ((3, 5), 100), ((2, 3, 4), 8), ((4, 3), 1)])
def test_the_blocks_of_a_sweep_hold_every_set_once(shape, count):
    chunk = chunk_shape(shape, count)
    assert np.prod(chunk) <= max(count, 1)
    every = np.concatenate([sets_of(block, shape) for block in blocks_of(shape, chunk)])
    assert sorted(every) == list(range(int(np.prod(shape))))


def test_results_of_chunks_join_and_part():
    one = Sets({"a": np.array([1.0, 2.0])}, np.array([0, 21]), {1: "why"})
    both = Sets.joined([one, one])
    assert both.messages == {1: "why", 3: "why"}
    part = both[np.array([3, 0])]
    assert (part.outputs["a"].tolist(), part.status.tolist(), part.messages) == ([2.0, 1.0], [21, 0], {0: "why"})


def test_a_job_and_its_results_travel():
    job = Job(SYSTEM_1, make_integrator("moreau-jean", {}), 1e-2, 1.0, "auto", ("R.max",))
    values = {"c_o": np.array([250.0, -1.0])}
    again = pickle.loads(pickle.dumps(job))
    assert vars(again) == vars(job)
    found, other = run_sets(job, values), pickle.loads(pickle.dumps(run_sets(again, values)))
    assert_array_equal(found.outputs["R.max"], other.outputs["R.max"])
    assert found.messages == other.messages


# ---- executors ------------------------------------------------------------------------------------------------------


def test_threads_give_the_same_and_run_each_set_once(counted):
    serial = sweep_of(GRID)
    del counted[:]
    with ThreadPoolExecutor(2) as pool:
        found = sweep_of(GRID, executor=pool, chunk=1)
    assert found.identical(serial)
    assert sum(counted) == 6


@pytest.mark.slow
def test_processes_give_the_same(tmp_path):
    serial = sweep_of(GRID, outputs=("R.max", "x"))
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        found = sweep_of(GRID, outputs=("R.max", "x"), executor=pool, chunk=2, out=tmp_path / "a.zarr")
    xarray.testing.assert_equal(found.drop_vars("message").load(), serial.drop_vars("message"))


class Broken(ThreadPoolExecutor):
    def submit(self, function, *args, **kwargs):
        return super().submit(sys.exit, 3) if kwargs else super().submit(self.fail)

    @staticmethod
    def fail():
        raise OSError("the node is gone")


def test_an_executor_that_fails_is_one_sentence():
    with Broken(1) as pool, pytest.raises(li.FailureError, match=r"the node is gone.*resumes"):
        sweep_of(GRID, executor=pool, chunk=1)


# ---- the store ------------------------------------------------------------------------------------------------------


def interrupted_after(monkeypatch, count):
    done = itertools.count()

    def runs(job, values, threads=1):
        if next(done) == count:
            raise KeyboardInterrupt
        return run_sets(job, values, threads)

    monkeypatch.setattr(chunks, "run_sets", runs)


def test_an_interrupted_sweep_resumes_and_repeats_nothing(tmp_path, monkeypatch):
    pytest.importorskip("zarr")
    parameters = {"k_o": np.linspace(3000.0, 5000.0, 5), "c_o": [-1.0, 200.0, 250.0]}
    outputs = ("R.max", "x", "open:1")
    serial = sweep_of(parameters, outputs=outputs)
    out = tmp_path / "runs.zarr"
    with monkeypatch.context() as patch:
        interrupted_after(patch, 7)
        with pytest.raises(KeyboardInterrupt):
            sweep_of(parameters, outputs=outputs, out=out, chunk=2)
    kept = xarray.open_zarr(out)
    assert int((kept["status"] != -1).sum()) == 11, "seven chunks, of 2 and 1 sets in turn"
    counted = []

    def counting(job, values, threads=1):
        counted.append(len(values["k_o"]))
        return run_sets(job, values, threads)

    monkeypatch.setattr(chunks, "run_sets", counting)
    found = sweep_of(parameters, outputs=outputs, out=out)
    assert sum(counted) == 4
    assert_array_equal(found["message"].values.astype(object), serial["message"].values)
    xarray.testing.assert_equal(found.drop_vars("message").load(), serial.drop_vars("message"))
    assert found["R.max"].attrs["units"] == "N"
    assert_array_equal(xarray.open_zarr(out)["x"], serial["x"])
    del counted[:]
    sweep_of(parameters, outputs=outputs, out=out, chunk=3)
    assert counted == []


def test_a_trial_run_is_not_repeated(tmp_path, counted):
    pytest.importorskip("zarr")
    parameters = {"k_o": np.linspace(3000.0, 5000.0, 23), "c_o": [200.0, 250.0, 300.0]}
    found = sweep_of(parameters)
    assert sum(counted) == found["R.max"].size == 69
    del counted[:]
    stored = sweep_of(parameters, out=tmp_path / "a.zarr")
    assert sum(counted) == 69
    assert_array_equal(stored["R.max"], found["R.max"])


def test_another_sweep_into_the_same_store_is_refused(tmp_path):
    pytest.importorskip("zarr")
    out = tmp_path / "runs.zarr"
    sweep_of(GRID, out=out)
    for parameters, options, what in (
        ({**GRID, "c_o": [200.0, 251.0]}, {}, "values of the parameters"),
        ({"k_o": GRID["k_o"]}, {}, "parameters"),
        (GRID, {"outputs": ("x.max",)}, "outputs"),
        (GRID, {"dt": 2e-2}, "dt"),
        (GRID, {"theta": 1.0}, "method"),
        (GRID, {"problem": li.load_problem("system-1", m=90.0)}, "problem parameters"),
    ):
        with pytest.raises(li.InputError, match=f"holds another sweep, which differs in the {what}"):
            sweep_of(parameters, out=out, **options)
    (tmp_path / "other.zarr").mkdir()
    with pytest.raises(li.InputError, match="is no sweep"):
        sweep_of(GRID, out=tmp_path / "other.zarr")


def test_a_missing_package_is_named_with_the_remedy(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "zarr", None)
    with pytest.raises(li.UnsupportedError, match=r"zarr is not installed: pip install 'lcpimpact\[sweep\]'"):
        sweep_of(GRID, out=tmp_path / "a.zarr")
    monkeypatch.setitem(sys.modules, "xarray", None)
    with pytest.raises(li.UnsupportedError, match=r"xarray is not installed: pip install 'lcpimpact\[sweep\]'"):
        sweep_of(GRID)


def test_results_that_do_not_fit_in_memory_are_refused_with_the_remedy(monkeypatch):
    monkeypatch.setattr("lcpimpact.memory.free_memory", lambda: 1e5)
    monkeypatch.setattr("lcpimpact.memory.SMALL", 0.0)
    with pytest.raises(li.InputError, match=r"give out='sweep.zarr'"):
        sweep_of({"k_o": np.linspace(3000.0, 5000.0, 100)}, outputs=("x",))


def test_the_dataset_can_be_written_as_netcdf_and_table(tmp_path):
    found = sweep_of(GRID)
    found.to_netcdf(tmp_path / "a.nc", engine="scipy")
    assert_array_equal(xarray.open_dataset(tmp_path / "a.nc")["R.max"], found["R.max"])
    assert len(found.to_dataframe()) == 6
    assert sweep.ENDING == ".zarr"
