"""A sweep on a cluster of dask.distributed that loses a worker."""

import os
import signal
import threading
import time

import numpy as np
import pytest
from numpy.testing import assert_array_equal

import lcpimpact as li
from lcpimpact.sweeps import chunks
from lcpimpact.sweeps.job import run_sets
from lcpimpact.sweeps.store import NOT_YET

distributed = pytest.importorskip("distributed")
pytest.importorskip("zarr")
xarray = pytest.importorskip("xarray")

PARAMETERS = {"k_o": np.linspace(3000.0, 5000.0, 8), "c_o": np.linspace(100.0, 400.0, 5)}
CALL = {"dt": 1e-3, "outputs": ("R.max", "open:1", "x@3.0"), "progress": False}


class Logged:
    """Runs a chunk slowly, and leaves a line for each: which process began which values."""

    def __init__(self, folder):
        self.folder = folder

    def __call__(self, job, values):
        with open(self.folder / f"{os.getpid()}.log", "a", encoding="utf-8") as file:
            file.write(f"{values['k_o'][0]} {values['c_o'][0]}\n")
        time.sleep(0.2)
        return run_sets(job, values)


@pytest.mark.slow
def test_a_worker_that_is_killed_costs_nothing_that_was_stored(tmp_path, monkeypatch):
    serial = li.sweep(li.load_problem("system-1"), PARAMETERS, **CALL)
    out, logs = tmp_path / "runs.zarr", tmp_path / "logs"
    logs.mkdir()
    monkeypatch.setattr(chunks, "run_sets", Logged(logs))
    stored_at_the_kill, finished = [], threading.Event()

    def kill_in_the_middle(victim):
        while not stored_at_the_kill and not finished.is_set():
            time.sleep(0.02)
            try:
                status = xarray.open_zarr(out, consolidated=False)["status"].values.ravel()
            except (OSError, KeyError, ValueError):
                continue
            if 12 <= (status != NOT_YET).sum() < 36:
                began = {path.name: path.read_text(encoding="utf-8").split("\n")[:-1] for path in logs.iterdir()}
                os.kill(victim, signal.SIGKILL)
                stored_at_the_kill.append((status, began))

    with (
        distributed.LocalCluster(2, threads_per_worker=1, processes=True, dashboard_address=None) as cluster,
        distributed.Client(cluster) as client,
    ):
        victim = next(iter(client.run(os.getpid).values()))
        killer = threading.Thread(target=kill_in_the_middle, args=(victim,))
        killer.start()
        found = li.sweep(
            li.load_problem("system-1"), PARAMETERS, executor=client.get_executor(), out=out, chunk=1, **CALL
        )
        finished.set()
        killer.join()
    xarray.testing.assert_equal(found.drop_vars("message").load(), serial.drop_vars("message"))
    ((status, began),) = stored_at_the_kill
    sets = [f"{k_o} {c_o}" for k_o in PARAMETERS["k_o"] for c_o in PARAMETERS["c_o"]]
    runs = [line for path in logs.iterdir() for line in path.read_text(encoding="utf-8").split("\n")[:-1]]
    assert set(runs) == set(sets)
    assert any(str(victim) in name for name in began), "the worker that was killed had run chunks"
    stored = {each for each, code in zip(sets, status, strict=True) if code != NOT_YET}
    assert len(stored) >= 12
    assert all(runs.count(each) == 1 for each in stored)
    # Run twice is only what the worker had in hand, or had not handed over yet.
    assert len(runs) - len(sets) <= 4
    del runs, sets
    before = sum(len(path.read_text(encoding="utf-8")) for path in logs.iterdir())
    li.sweep(li.load_problem("system-1"), PARAMETERS, out=out, **CALL)
    assert sum(len(path.read_text(encoding="utf-8")) for path in logs.iterdir()) == before
    assert_array_equal(found["status"], 0)
