"""The result: series by name, files that round-trip and appear whole or not at all, limits at jumps, the report."""

from __future__ import annotations

import csv
import dataclasses
import importlib.util
import json
import math
import os
import stat
from pathlib import Path

import numpy as np
import pytest

from lcpimpact import (
    Bumper,
    FailureError,
    InputError,
    Load,
    Mass,
    Problem,
    Scheme,
    Spring,
    Status,
    UnsupportedError,
    load_problem,
    simulate,
)
from lcpimpact.files import whole_file
from lcpimpact.integrators.moreau_jean import MoreauJean
from lcpimpact.run_files import WRITERS

OPEN_1 = 0.522438236432474
"""When System No. 1 first lets go (40-digit arithmetic)."""

FORCE_1 = 250.0 * math.sqrt(2.0 * 9.81 * 5.0)
"""c_o v_o, the force of System No. 1 at t = 0+."""


@pytest.fixture(scope="module")
def theta():
    return simulate(load_problem("system-3"), dt=1e-2, t_end=0.5)


@pytest.fixture(scope="module")
def exact():
    return simulate(load_problem("system-1"), "exact", dt=1e-2, t_end=3.0)


@pytest.fixture(scope="module")
def ball():
    return simulate(load_problem("bouncing-ball"), "exact", dt=1e-2, t_end=1.5)


def read_csv(path):
    with path.open(newline="", encoding="utf-8") as file:
        header, *rows = csv.reader(file)
    return header, rows


def column(header, rows, name):
    return np.array([float(row[header.index(name)]) for row in rows if row[header.index(name)] != ""])


# ---- series ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", ["exact", "event-driven", "radau-fesd"])
def test_the_continuous_solution_is_read_at_the_recorded_instants(method):
    run = simulate(load_problem("bouncing-ball"), method, dt=0.1, t_end=1.0)
    assert run.dense is not None
    assert not run.t.flags.writeable
    np.testing.assert_array_equal(run.dense.read(run.t)[0], run.dense.read(run.t, "right")[0])
    np.testing.assert_allclose(run.dense.read(run.t)[0], run.q, atol=1e-14)


def test_shapes_and_the_grid(theta):
    assert theta.t.shape == (51,)
    np.testing.assert_array_equal(theta.t, np.arange(51) * 0.5 / 50)
    assert theta.q.shape == theta.v.shape == (51, 3)
    assert theta.t_reaction.shape == (50,)
    assert theta.reaction.shape == (50, 1)
    np.testing.assert_allclose(theta.t_reaction, theta.t[:-1] + 0.5 * 1e-2, rtol=1e-14, atol=0.0)
    assert theta.success
    assert theta.status is Status.SOLVED
    assert theta.message == Status.SOLVED.sentence
    assert theta.stats.steps == 50
    assert theta.stats.lcp_solves == 50


def test_series_by_name(theta):
    assert theta.names == ("x", "y", "z", "v_x", "v_y", "v_z", "R")
    for i, name in enumerate("xyz"):
        assert (theta[name] == theta.q[:, i]).all()
        assert (theta[f"v_{name}"] == theta.v[:, i]).all()
    assert (theta["R"] == theta.reaction[:, 0]).all()
    assert not np.array_equal(theta["x"], theta["y"])
    assert not np.array_equal(theta["v_x"], theta["x"])


def test_the_velocity_is_the_derivative(theta):
    rate = (theta["x"][2:] - theta["x"][:-2]) / 2e-2
    np.testing.assert_allclose(theta["v_x"][5:-5], rate[4:-4], rtol=0.0, atol=2e-2)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [("v_xx", "did you mean 'v_x'"), ("r", "known are x, y, z, v_x"), ("t", "known are x"), (0, "'0'")],
)
def test_an_unknown_series_offers_the_nearest(theta, wrong, words):
    with pytest.raises(InputError, match=f"unknown series.*{words}"):
        theta[wrong]


# ---- sample ---------------------------------------------------------------------------------------------------------


def test_sides_at_a_jump_of_velocity(ball):
    """The ball hits the ground at sqrt(2 H/g) with sqrt(2 g H), and leaves with e times that."""
    fall, speed = math.sqrt(2.0 / 9.81), math.sqrt(2.0 * 9.81)
    impact = ball.events[0]
    assert impact.kind == "impact"
    assert impact.t == pytest.approx(fall, rel=1e-14)
    left, right = ball.sample(impact.t, "left"), ball.sample(impact.t, "right")
    assert left.v.shape == right.v.shape == (1, 1)
    assert left.v[0, 0] == pytest.approx(speed, rel=1e-12)
    assert right.v[0, 0] == pytest.approx(-0.8 * speed, rel=1e-12)
    assert left.q[0, 0] == pytest.approx(1.0, rel=1e-13)
    assert right.q[0, 0] == pytest.approx(1.0, rel=1e-13)
    assert ball.sample(impact.t).v[0, 0] == right.v[0, 0]
    assert impact.left.v[0] == pytest.approx(speed, rel=1e-12)
    assert impact.right.v[0] == pytest.approx(-0.8 * speed, rel=1e-12)
    assert impact.impulse == pytest.approx(1.8 * speed, rel=1e-12)


def test_sides_at_a_jump_of_force(exact):
    """When the gap of System No. 1 closes, R jumps from zero to c_o x' + k_o x."""
    close = next(event for event in exact.events if event.kind == "close")
    assert close.t == pytest.approx(1.500100083187666, rel=1e-12)
    left, right = exact.sample(close.t, "left"), exact.sample(close.t, "right")
    assert left.reaction[0, 0] == 0.0
    force = 250.0 * right.v[0, 0] + 3924.0 * right.q[0, 0]
    assert force > 100.0
    assert right.reaction[0, 0] == pytest.approx(force, rel=1e-9)
    np.testing.assert_allclose(left.q, right.q, rtol=0.0, atol=1e-12)


def test_sample_of_exact_is_exact_between_the_grid_points(exact):
    finer = simulate(load_problem("system-1"), "exact", dt=1e-3, t_end=3.0)
    state = exact.sample(finer.t)
    np.testing.assert_allclose(state.q, finer.q, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(state.v, finer.v, rtol=0.0, atol=1e-11)
    np.testing.assert_allclose(state.reaction, finer.reaction, rtol=0.0, atol=1e-8)


def test_sample_keeps_the_order_of_the_times(exact):
    times = np.array([2.5, 0.1, OPEN_1 + 1e-6, 0.1, 3.0, 0.0])
    state = exact.sample(times)
    assert state.q.shape == (6, 2)
    for i, t in enumerate(times):
        alone = exact.sample(t)
        np.testing.assert_allclose(state.q[i], alone.q[0], rtol=1e-13, atol=1e-15)
        np.testing.assert_allclose(state.reaction[i], alone.reaction[0], rtol=1e-12, atol=0.0)
    assert state.reaction[5, 0] == pytest.approx(FORCE_1, rel=1e-13)


def test_sample_of_steps_interpolates_the_motion_and_holds_the_force(theta):
    middle = 0.5 * (theta.t[:-1] + theta.t[1:])
    state = theta.sample(middle)
    np.testing.assert_allclose(state.q, 0.5 * (theta.q[:-1] + theta.q[1:]), rtol=0.0, atol=1e-14)
    np.testing.assert_allclose(state.v, 0.5 * (theta.v[:-1] + theta.v[1:]), rtol=0.0, atol=1e-12)
    np.testing.assert_array_equal(state.reaction, theta.reaction)
    left, right = theta.sample(theta.t[10], "left"), theta.sample(theta.t[10], "right")
    assert left.reaction[0, 0] == theta.reaction[9, 0]
    assert right.reaction[0, 0] == theta.reaction[10, 0]
    np.testing.assert_array_equal(theta.sample(theta.t).q, theta.q)
    assert theta.sample(theta.t[-1]).reaction[0, 0] == theta.reaction[-1, 0]
    assert theta.sample(0.0, "left").reaction[0, 0] == theta.reaction[0, 0]


def test_sample_of_a_method_whose_force_lives_on_the_grid():
    traj = simulate(load_problem("system-1"), "rk4-paper", dt=1e-2, t_end=0.5)
    assert len(traj.t_reaction) == len(traj.t)
    state = traj.sample([0.105, 0.2])
    np.testing.assert_allclose(state.reaction[0], 0.5 * (traj.reaction[10] + traj.reaction[11]), rtol=1e-12, atol=0.0)
    assert state.reaction[1, 0] == pytest.approx(traj.reaction[20, 0], rel=1e-12)


@pytest.mark.parametrize("t", [-1e-9, 0.5 + 1e-9, math.nan, math.inf, [0.1, 0.6]], ids=repr)
def test_sample_outside_the_run(theta, exact, t):
    with pytest.raises(InputError, match=r"sample times must lie within the run, 0 to 0\.5 s"):
        theta.sample(t)
    with pytest.raises(InputError, match="within the run"):
        exact.sample(np.asarray(t) * 6.1)


@pytest.mark.parametrize("side", ["middle", "", None, 1], ids=repr)
def test_sample_on_another_side(theta, exact, side):
    for traj in (theta, exact):
        with pytest.raises(InputError, match=r"^side = .* must be (a string|'right' or 'left')"):
            traj.sample(0.1, side)


@pytest.mark.parametrize("traj", ["theta", "exact"])
def test_sample_of_no_times(request, traj):
    state = request.getfixturevalue(traj).sample([])
    assert len(state.q) == len(state.v) == len(state.reaction) == 0


# ---- files ----------------------------------------------------------------------------------------------------------


def test_csv_columns_are_the_contract(theta, exact, ball, tmp_path):
    assert read_csv(theta.save(tmp_path / "3.csv"))[0] == ["t", "x", "y", "z", "v_x", "v_y", "v_z", "t_R", "R"]
    assert read_csv(exact.save(tmp_path / "1.csv"))[0] == ["t", "x", "z", "v_x", "v_z", "t_R", "R"]
    assert read_csv(ball.save(tmp_path / "b.csv"))[0] == ["t", "x", "v_x", "t_R", "R"]
    pair = Scheme(Mass("a", m=1.0), Bumper("a", "b", gap=1.0, e=0.0, name="P"), Mass("b", m=1.0),
                  Bumper("b", "ground", gap=1.0, e=0.0, name="Q"))  # fmt: skip
    traj = simulate(Problem("pair", pair), dt=1e-2, t_end=1e-1)
    assert read_csv(traj.save(tmp_path / "p.csv"))[0] == ["t", "a", "b", "v_a", "v_b", "t_R", "P", "Q"]
    free = simulate(Problem("free", Scheme(Mass("x", m=1.0), Spring("x", "ground", k=1.0))), dt=1e-2, t_end=1e-1)
    assert read_csv(free.save(tmp_path / "f.csv"))[0] == ["t", "x", "v_x", "t_R"]


@pytest.mark.parametrize("traj", ["theta", "exact", "ball"])
def test_csv_values_round_trip_exactly(request, traj, tmp_path):
    traj = request.getfixturevalue(traj)
    header, rows = read_csv(traj.save(tmp_path / "run.csv"))
    assert len(rows) == len(traj.t)
    assert all(len(row) == len(header) for row in rows)
    assert column(header, rows, "t").tobytes() == traj.t.tobytes()
    assert column(header, rows, "t_R").tobytes() == traj.t_reaction.tobytes()
    for name in traj.names:
        assert column(header, rows, name).tobytes() == traj[name].tobytes()


def test_npz_round_trips_exactly(theta, ball, tmp_path):
    for traj in (theta, ball):
        with np.load(traj.save(tmp_path / "run.npz"), allow_pickle=False) as data:
            for name in ("t", "q", "v", "t_reaction", "reaction"):
                assert data[name].dtype == np.float64
                assert data[name].tobytes() == np.ascontiguousarray(getattr(traj, name)).tobytes()
            assert data["names"].tolist() == list(traj.names)
            assert data["event_t"].tolist() == [event.t for event in traj.events]
            assert data["event_kind"].tolist() == [event.kind for event in traj.events]
            assert data["event_contact"].tolist() == [event.contact for event in traj.events]
            assert (str(data["problem"]), str(data["status"])) == (traj.problem.name, "SOLVED")
            assert str(data["method"]) == traj.method
    assert len(ball.events) > 1


def test_save_returns_the_path_and_takes_a_string(theta, tmp_path):
    assert theta.save(str(tmp_path / "run.csv")) == tmp_path / "run.csv"
    assert (tmp_path / "run.csv").stat().st_size > 1000


def test_a_saved_file_has_ordinary_permissions(theta, tmp_path):
    previous = os.umask(0o027)
    try:
        path = theta.save(tmp_path / "run.csv")
    finally:
        os.umask(previous)
    assert stat.S_IMODE(path.stat().st_mode) == 0o640
    assert os.umask(previous) == previous


def test_saving_again_replaces_the_file_and_leaves_nothing_else(theta, exact, tmp_path):
    theta.save(tmp_path / "run.csv")
    first = (tmp_path / "run.csv").read_bytes()
    exact.save(tmp_path / "run.csv")
    assert (tmp_path / "run.csv").read_bytes() != first
    assert sorted(path.name for path in tmp_path.iterdir()) == ["run.csv", "run.events.csv", "run.meta.json"]


@pytest.mark.parametrize("ending", [".csv", ".npz"])
@pytest.mark.parametrize(
    ("error", "raised"), [(OSError(28, "No space left on device"), InputError), (RuntimeError("broken"), RuntimeError),
                          (KeyboardInterrupt(), KeyboardInterrupt)], ids=["disk full", "bug", "Ctrl-C"],
)  # fmt: skip
def test_a_writer_that_fails_half_way_leaves_the_older_file(theta, tmp_path, monkeypatch, ending, error, raised):
    target = tmp_path / f"run{ending}"
    target.write_bytes(b"older and whole")

    def half(run, *paths: Path, decimal: str = ".") -> None:
        paths[0].write_bytes(b"t,x\n0.0,")
        raise error

    monkeypatch.setitem(WRITERS, ending, half)
    with pytest.raises(raised) as caught:
        theta.save(target)
    assert target.read_bytes() == b"older and whole"
    assert [path.name for path in tmp_path.iterdir()] == [target.name]
    if raised is InputError:
        assert "No space left on device" in str(caught.value)
        assert "nothing was changed" in str(caught.value)


def test_a_writer_that_fails_half_way_leaves_no_new_file(theta, tmp_path, monkeypatch):
    def half(run, *paths: Path, decimal: str = ".") -> None:
        paths[0].write_bytes(b"t,x\n0.0,")
        raise OSError(28, "No space left on device")

    monkeypatch.setitem(WRITERS, ".csv", half)
    with pytest.raises(InputError, match=r"cannot write .*run\.csv.*No space left"):
        theta.save(tmp_path / "run.csv")
    assert list(tmp_path.iterdir()) == []


def test_whole_file_writes_beside_and_then_renames(tmp_path):
    target = tmp_path / "table.txt"
    target.write_text("older")
    with whole_file(target) as part:
        assert part.parent == target.parent
        assert part != target
        assert part.suffix == ".txt"
        part.write_text("newer")
        assert target.read_text() == "older"
    assert target.read_text() == "newer"
    assert [path.name for path in tmp_path.iterdir()] == ["table.txt"]


# ---- the report -----------------------------------------------------------------------------------------------------


def test_repr_has_the_status_the_events_and_the_certificate(exact):
    text = repr(exact)
    assert text.splitlines()[:2] == [
        "Trajectory of system-1 by exact: solved", "  options     max_events=100000, lcp_solver=auto"
    ]  # fmt: skip
    assert max(map(len, text.splitlines())) <= 78
    assert f"open R {OPEN_1:.6f}" in text
    assert "close R 1.500100" in text
    assert "300 steps" in text
    assert f"at most {exact['R'].max():.6g} N" in text
    assert "relative degree 1" in text
    assert "residual" in text
    assert Status.SOLVED.sentence in text
    assert "more" not in text


def test_repr_counts_the_events_that_it_does_not_show():
    traj = simulate(load_problem("bouncing-ball", e=0.5), "exact", dt=1e-2, t_end=1.35)
    shown = " ".join(repr(traj).split()).partition(" events ")[2].partition(" certificate ")[0]
    assert len(traj.events) > 6
    assert shown.count("impact R") == 6
    assert shown.endswith(f", and {len(traj.events) - 6} more")


def test_repr_of_a_run_without_events():
    problem = Problem("free", Scheme(Mass("x", m=1.0), Load("x", f=2.0)))
    traj = simulate(problem, "exact", dt=0.5, t_end=2.0)
    assert "events      none" in repr(traj)
    assert "at the end 4 m" in repr(traj)


def test_repr_of_a_failed_run_says_so():
    with pytest.raises(FailureError) as caught:
        simulate(load_problem("bouncing-ball"), "exact", dt=1e-2, t_end=3.0, max_events=3)
    text = repr(caught.value.result)
    assert ": max-events" in text.splitlines()[0]
    assert caught.value.result.message in " ".join(text.split())


# ---- xarray ---------------------------------------------------------------------------------------------------------

HAS_XARRAY = importlib.util.find_spec("xarray") is not None


@pytest.mark.skipif(HAS_XARRAY, reason="xarray is installed")
def test_without_xarray_the_remedy_is_named(theta, tmp_path):
    with pytest.raises(UnsupportedError, match=r"xarray is not installed: pip install 'lcpimpact\[sweep\]'"):
        theta.to_xarray()
    with pytest.raises(UnsupportedError, match="xarray"):
        theta.save(tmp_path / "run.nc")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(not HAS_XARRAY, reason="needs xarray")
def test_with_xarray(theta, tmp_path):
    data = theta.to_xarray()
    assert list(data.coords) == ["t", "t_R", "event_side", "event_node", "event_row"]
    for name in theta.names:
        assert data[name].dims == (("t_R",) if name == "R" else ("t",))
        np.testing.assert_array_equal(data[name].values, theta[name])
    assert data.attrs["problem"] == "system-3"
    assert theta.save(tmp_path / "run.nc").stat().st_size > 1000


# ---- one run in pieces, and without compilation ---------------------------------------------------------------------


@pytest.mark.parametrize("method", ["moreau-jean", "exact", "rk4-paper"])
def test_a_run_is_the_beginning_of_a_longer_one(method):
    """The blocks of steps leave no trace: 3000 steps are two blocks, and 1500 end in the second."""
    short = simulate(load_problem("system-3"), method, dt=2.0**-10, t_end=1500 * 2.0**-10)
    longer = simulate(load_problem("system-3"), method, dt=2.0**-10, t_end=3000 * 2.0**-10)
    if method == "exact":
        np.testing.assert_allclose(longer.q[:1501], short.q, rtol=0.0, atol=1e-13)
    else:
        assert longer.q[:1501].tobytes() == short.q.tobytes()
        assert longer.reaction[: len(short.reaction)].tobytes() == short.reaction.tobytes()


@pytest.mark.parametrize("method", ["moreau-jean", "exact", "rk4-paper"])
def test_a_run_leaves_no_state_behind(method):
    first = simulate(load_problem("system-2"), method, dt=1e-2, t_end=1.0)
    simulate(load_problem("system-2", k=10.0, v_o=1.0), method, dt=5e-3, t_end=2.0)
    again = simulate(load_problem("system-2"), method, dt=1e-2, t_end=1.0)
    assert again.q.tobytes() == first.q.tobytes()
    assert again.v.tobytes() == first.v.tobytes()
    assert again.reaction.tobytes() == first.reaction.tobytes()


@dataclasses.dataclass(frozen=True)
class StoppedByHand(MoreauJean):
    """Ctrl-C in the second block."""

    def advance(self, carry, record, first, last):
        if first > 0:
            raise KeyboardInterrupt
        return super().advance(carry, record, first, last)


def test_an_interrupted_run_keeps_its_finished_steps():
    """`StoppedByHand` is also an integrator that is in no registry."""
    whole = simulate(load_problem("system-1"), dt=1e-3, t_end=3.0)
    traj = simulate(load_problem("system-1"), StoppedByHand(), dt=1e-3, t_end=3.0, throw=False)
    assert traj.status is Status.INTERRUPTED
    assert "Interrupted" in traj.message
    assert 0 < len(traj.reaction) == len(traj.t) - 1 == traj.stats.steps < 3000
    assert traj.q.tobytes() == whole.q[: len(traj.t)].tobytes()
    assert all(event.t <= traj.t[-1] for event in traj.events)
    with pytest.raises(KeyboardInterrupt):
        simulate(load_problem("system-1"), StoppedByHand(), dt=1e-3, t_end=3.0)


BITS = """
import hashlib, json
import numpy as np
from lcpimpact import (
    Harmonic, HertzSpring, Jenkins, Load, Mass, PrescribedMotion, Problem, Scheme, Slider, load_problem, simulate
)

EVERYTHING = Problem("everything", Scheme(
    PrescribedMotion("b", Harmonic(0.1, 7.0)), HertzSpring("x", "b", 500.0), Mass("x", 1.0), Load("x", Harmonic(30.0, 7.0)),
    Jenkins("x", "ground", 100.0, 5.0), Mass("y", 1.0), Slider("x", "y", 2.0, name="G"),
))

def bits():
    out = {}
    ends = {"system-1": 3.0, "system-2": 3.0, "system-3": 3.0, "bouncing-ball": 1.5, "everything": 2.0}
    for name, t_end in ends.items():
        problem = EVERYTHING if name == "everything" else load_problem(name)
        runs = {"moreau-jean": {}, "moreau-jean 1": {"theta": 1.0}, "lemke": {"lcp_solver": "lemke"},
                "pgs": {"lcp_solver": "pgs"}, "rk4-paper": {}, "rk4-paper clip": {"contact": "clip"}}
        for run, options in runs.items():
            method = run.split()[0] if run.startswith("rk4") else "moreau-jean"
            if method == "rk4-paper" and name in ("bouncing-ball", "everything"):
                continue
            traj = simulate(problem, method, dt=1e-2, t_end=t_end, **options)
            arrays = [traj.t, traj.q, traj.v, traj.t_reaction, traj.reaction, np.array([e.t for e in traj.events])]
            c = traj.certificate
            arrays.append(np.array([c.residual, c.complementarity, c.penetration, c.energy_balance, c.energy_scale]))
            digest = hashlib.sha256(b"".join(np.ascontiguousarray(a).tobytes() for a in arrays)).hexdigest()
            last = [float.hex(float(a)) for a in (*traj.q[-1], *traj.v[-1], *traj.reaction[-1])]
            out[f"{name} {run}"] = [digest, len(traj.events), *last]
    return out
"""


@pytest.mark.compiled
@pytest.mark.always
def test_the_interpreter_gives_the_bits_of_the_compiled_code(python):
    namespace: dict = {}
    exec(BITS, namespace)
    compiled = json.loads(json.dumps(namespace["bits"]()))
    interpreted = python(f"{BITS}\nprint(json.dumps(bits()))", LCPIMPACT_COMPILE="never")
    assert len(compiled) == 3 * 6 + 2 * 4
    assert interpreted == compiled


def test_a_run_ends_where_its_problem_does_unless_told():
    problem = load_problem("system-1")
    assert simulate(problem, dt=problem.t_end / 50).t[-1] == problem.t_end
    assert simulate(problem, dt=0.1, t_end=0.5).t[-1] == 0.5
