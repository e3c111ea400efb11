"""Sweeps whose sets run side by side give what the same sets give alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import lcpimpact as li
from lcpimpact.errors import Status
from lcpimpact.integrators.printed.lanes import Lanes
from lcpimpact.quantities import quantity
from lcpimpact.sweeps import sets as sets_module
from lcpimpact.sweeps import side_by_side
from lcpimpact.sweeps.job import Job
from lcpimpact.sweeps.side_by_side import WORTH_COMPILING

pytestmark = pytest.mark.compiled

SYSTEM_1 = li.load_problem("system-1")
OUTPUTS = ("R.max", "R.min", "x.max", "v_z.min", "peak_force", "peak_time", "x@0.5", "v_x@1.0")


@pytest.fixture
def alone(monkeypatch):
    """Count the sets that run alone."""
    counted = []
    run = sets_module._run

    def counting(*args):
        counted.append(args)
        return run(*args)

    monkeypatch.setattr(sets_module, "_run", counting)
    return counted


@pytest.fixture
def taken(monkeypatch):
    """Count the calls of lanes."""
    counted = []
    take = Lanes.take

    def counting(self, parameters):
        counted.append(parameters)
        return take(self, parameters)

    monkeypatch.setattr(Lanes, "take", counting)
    return counted


@pytest.fixture
def few(monkeypatch):
    """A number of sets that is enough for lanes here."""
    monkeypatch.setattr(side_by_side, "WORTH_COMPILING", side_by_side.MIN_SETS)
    return 2 * side_by_side.MIN_SETS


def samples(ranges, count=WORTH_COMPILING, seed=0):
    return li.draw_samples(ranges, count, "random", seed=seed)


@pytest.mark.parametrize(
    ("problem", "ranges", "outputs", "options"),
    [
        pytest.param(SYSTEM_1, {"k_o": (3e3, 5e3), "c_o": (1e2, 4e2), "h_o": (1.0, 9.0)}, OUTPUTS, {}, id="system-1"),
        pytest.param(
            SYSTEM_1,
            {"theta": (0.5, 1.0), "v0.x": (1.0, 9.0)},
            ("R.max", "x.max"),
            {},
            id="options and starts",
            marks=pytest.mark.slow,
        ),
        pytest.param(
            li.load_problem("system-3"),
            {"c": (60.0, 300.0), "m": (50.0, 200.0)},
            ("R.max", "y@1.0"),
            {},
            id="system-3",
            marks=pytest.mark.slow,
        ),
        pytest.param(
            li.load_problem("bouncing-ball"),
            {"2.e": (0.1, 0.9), "2.gap": (0.5, 2.0)},
            ("x.min", "v_x@1.0"),
            {"method": "stormer-verlet-ns", "certify": False},
            id="impacts",
            marks=pytest.mark.slow,
        ),
        pytest.param(
            li.Problem(
                "two plates",
                li.Scheme(
                    li.Mass("x", 1.0),
                    li.KelvinVoigt("x", "a", 400.0, 3.0),
                    li.KelvinVoigt("x", "b", 300.0, 2.0),
                    li.Bumper("a", "ground", gap=0.1),
                    li.Bumper("b", "ground", gap=0.15),
                    li.Load("x", li.Harmonic(30.0, 9.0)),
                ),
            ),
            {"1.k": (300.0, 500.0), "4.gap": (0.05, 0.3)},
            ("peak_force", "peak_time", "x.min", "x@1.0"),
            {},
            id="two contacts",
            marks=pytest.mark.slow,
        ),
        pytest.param(
            li.Problem(
                "pushed",
                li.Scheme(
                    li.Mass("x", 1.0),
                    li.Dashpot("x", "ground", 2.0),
                    li.Load("x", li.Table([0.0, 0.5, 0.5], [3.0, 3.0, -1.0])),
                    li.Bumper("x", "ground", gap=0.2, e=0.5, name="R"),
                ),
            ),
            {"0.m": (1.0, 3.0), "1.c": (1.0, 4.0)},
            ("x.max", "x@1.0", "v_x@0.5"),
            {},
            id="a load that jumps",
            marks=pytest.mark.slow,
        ),
        pytest.param(
            li.load_problem("kelvin-voigt-impact"),
            {"m": (50.0, 200.0), "k": (2e3, 6e3), "c": (100.0, 2e3)},
            ("R.max", "x@1.0"),
            {},
            id="parameters of a problem with closed forms",
            marks=pytest.mark.slow,
        ),
    ],
)
def test_outputs_have_the_bits_of_runs_alone(problem, ranges, outputs, options, alone):
    sets = samples(ranges)
    found = li.sweep(problem, sets, dt=1e-3, t_end=1.0, outputs=outputs, progress=False, **options)
    assert len(alone) < 30
    assert not found["status"].any()
    method = options.get("method", "moreau-jean")
    for k in (0, 17, 500, WORTH_COMPILING - 1):
        values = {name: float(each[k]) for name, each in sets.values.items()}
        changes = {name: value for name, value in values.items() if name != "theta"}
        own = {name: value for name, value in values.items() if name == "theta"}
        run = li.simulate(li.with_values(problem, changes), method, dt=1e-3, t_end=1.0, **own)
        for name in outputs:
            assert float(found[name][k]) == quantity(name, problem).measure(run)


@pytest.mark.slow
def test_sets_without_a_force_have_no_instant_of_its_peak():
    scheme = li.Scheme(
        li.Mass("x", 1.0), li.Load("x", 9.81), li.Bumper("x", "a", gap=0.1), li.KelvinVoigt("a", "ground", 400.0, 3.0)
    )
    gaps = np.linspace(0.1, 5.2, WORTH_COMPILING)
    found = li.sweep(
        li.Problem("may touch", scheme), {"2.gap": gaps}, dt=1e-3, t_end=1.0, outputs=("peak_force", "peak_time"),
        progress=False,
    )  # fmt: skip
    none = found["peak_force"].values == 0.0
    assert 0 < none.sum() < len(gaps)
    assert (np.isnan(found["peak_time"].values) == none).all()


@pytest.mark.slow
def test_steps_of_several_lengths_run_side_by_side(alone):
    c_o = np.linspace(100.0, 400.0, WORTH_COMPILING // 2)
    found = li.sweep(SYSTEM_1, {"dt": [1e-3, 5e-4], "c_o": c_o}, dt=1e-3, t_end=1.0, progress=False)
    assert len(alone) < 30
    for dt in (1e-3, 5e-4):
        run = li.simulate(li.load_problem("system-1", c_o=float(c_o[100])), dt=dt, t_end=1.0)
        assert float(found["R.max"].sel(dt=dt)[100]) == run["R"].max()


def test_sets_that_are_refused_are_rows_with_their_reason(alone):
    c_o = np.linspace(-5.0, 400.0, WORTH_COMPILING)
    found = li.sweep(SYSTEM_1, {"c_o": c_o}, dt=1e-3, t_end=1.0, progress=False)
    refused = c_o <= 0.0
    assert (found["status"].values == np.where(refused, Status.NOT_RUN, Status.SOLVED)).all()
    assert np.isnan(found["R.max"].values[refused]).all()
    assert np.isfinite(found["R.max"].values[~refused]).all()
    assert "c" in str(found["message"].values[0])
    assert len(alone) < 60


def test_a_set_that_a_certificate_rejects_sends_its_group_to_be_run_alone(monkeypatch, alone, few, taken):
    """What lanes cannot see, the certificates of the sets that are run alone do."""

    def rejecting(job, times, quantities):
        status, message, found = plain(job, times, quantities)
        return (
            (Status.VIOLATED, "rejected", {}) if job.problem.scheme.elements[3].c > 390.0 else (status, message, found)
        )

    plain = sets_module._run
    monkeypatch.setattr(sets_module, "_run", rejecting)
    c_o = np.linspace(300.0, 400.0, few)
    found = li.sweep(SYSTEM_1, {"c_o": c_o}, dt=1e-2, t_end=1.0, progress=False)
    assert taken
    assert ((found["status"].values == Status.VIOLATED) == (c_o > 390.0)).all()
    assert len(alone) >= few


def test_wrong_numbers_of_lanes_are_not_used(monkeypatch, alone, few, taken):
    take = Lanes.take

    def wrong(self, parameters):
        regular, numbers, states = take(self, parameters)
        return regular, np.nextafter(numbers, np.inf), states

    monkeypatch.setattr(Lanes, "take", wrong)
    c_o = np.linspace(300.0, 400.0, few)
    found = li.sweep(SYSTEM_1, {"c_o": c_o}, dt=1e-2, t_end=1.0, progress=False)
    assert taken
    assert len(alone) >= few
    run = li.simulate(li.load_problem("system-1", c_o=float(c_o[7])), dt=1e-2, t_end=1.0)
    assert float(found["R.max"][7]) == run["R"].max()


@pytest.mark.slow
def test_what_lanes_do_not_take_runs_alone(alone):
    values = {"c_o": np.linspace(100.0, 400.0, 70)}
    for options in ({"outputs": ("contact_time",)}, {"method": "radau"}, {"rtol": 1e-4}, {"lcp_solver": "lemke"}):
        alone.clear()
        found = li.sweep(SYSTEM_1, values, dt=1e-2, t_end=1.0, progress=False, **options)
        assert len(alone) == 70
        assert not found["status"].any()


@pytest.mark.slow
def test_methods_whose_certificates_judge_their_error_run_alone_unless_told(alone):
    """With a coarse dt the certificate rejects some of these sets, which lanes would not see."""
    ball, sets = li.load_problem("bouncing-ball"), {"2.gap": np.linspace(0.5, 2.0, WORTH_COMPILING)}
    options = {"dt": 1e-2, "t_end": 1.0, "outputs": ("x.max",), "progress": False}
    li.sweep(ball, sets, "newmark-ns", **options)
    assert len(alone) >= WORTH_COMPILING
    alone.clear()
    li.sweep(ball, sets, "newmark-ns", certify=False, **options)
    assert len(alone) < 30


def test_threads_share_the_sets():
    from lcpimpact.simulation import make_integrator

    job = Job(SYSTEM_1, make_integrator("moreau-jean", {}), 1e-2, 1.0, "auto", ("R.max",))
    values = {"c_o": np.linspace(100.0, 400.0, 5000), "k_o": np.linspace(3000.0, 5000.0, 5000)}
    one, two = (sets_module.run_sets(replace(job), values, threads) for threads in (1, 2))
    assert (one.outputs["R.max"] == two.outputs["R.max"]).all()
