"""A sweep on a cluster of dask.distributed that loses a worker."""

import os
import signal
import time

import numpy as np
import pytest
from numpy.testing import assert_array_equal

import lcpimpact as li
from lcpimpact.sweeps import chunks
from lcpimpact.sweeps.sets import run_sets
from lcpimpact.sweeps.store import Store

distributed = pytest.importorskip("distributed")
pytest.importorskip("zarr")
xarray = pytest.importorskip("xarray")

PARAMETERS = {"k_o": np.linspace(3000.0, 5000.0, 8), "c_o": np.linspace(100.0, 400.0, 5)}
CALL = {"dt": 1e-3, "outputs": ("R.max", "open:1", "x@3.0"), "progress": False}


class Logged:
    """Runs a chunk slowly, and leaves a line for each: which process began which values."""

    def __init__(self, folder):
        self.folder = folder

    def __call__(self, job, values, threads=1):
        with open(self.folder / f"{os.getpid()}.log", "a", encoding="utf-8") as file:
            file.write(f"{values['k_o'][0]} {values['c_o'][0]}\n")
        time.sleep(0.2)
        return run_sets(job, values, threads)


@pytest.mark.slow
def test_a_worker_that_is_killed_costs_nothing_that_was_stored(tmp_path, monkeypatch):
    serial = li.sweep(li.load_problem("system-1"), PARAMETERS, **CALL)
    out, logs = tmp_path / "runs.zarr", tmp_path / "logs"
    logs.mkdir()
    monkeypatch.setattr(chunks, "run_sets", Logged(logs))
    victims, stored, write = [], [], Store.write

    def write_and_kill(store, block, sets):
        write(store, block, sets)
        if len(stored) < 15:
            stored.append([each.start for each in block])
        elif victims:
            os.kill(victims.pop(), signal.SIGKILL)

    monkeypatch.setattr(Store, "write", write_and_kill)
    with (
        distributed.LocalCluster(2, threads_per_worker=1, processes=True, dashboard_address=None) as cluster,
        distributed.Client(cluster) as client,
    ):
        victims.append(next(iter(client.run(os.getpid).values())))
        victim = str(victims[0])
        found = li.sweep(
            li.load_problem("system-1"), PARAMETERS, executor=client.get_executor(), out=out, chunk=1, **CALL
        )
        assert len(client.run(os.getpid)) == 2, "the cluster replaced it"
    xarray.testing.assert_equal(found.drop_vars("message").load(), serial.drop_vars("message"))
    assert not victims
    runs = {path.stem: path.read_text(encoding="utf-8").split("\n")[:-1] for path in logs.iterdir()}
    assert runs[victim], "the worker that was killed had run chunks"
    every = [line for lines in runs.values() for line in lines]
    sets = [f"{k_o} {c_o}" for k_o in PARAMETERS["k_o"] for c_o in PARAMETERS["c_o"]]
    assert set(every) == set(sets)
    for k_o, c_o in stored:
        assert every.count(f"{PARAMETERS['k_o'][k_o]} {PARAMETERS['c_o'][c_o]}") == 1
    # Run twice is only what the worker had in hand, or had not handed over yet.
    assert len(every) - len(sets) <= 10
    before = sum(len(path.read_text(encoding="utf-8")) for path in logs.iterdir())
    li.sweep(li.load_problem("system-1"), PARAMETERS, out=out, **CALL)
    assert sum(len(path.read_text(encoding="utf-8")) for path in logs.iterdir()) == before
    assert_array_equal(found["status"], 0)
