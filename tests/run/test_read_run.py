"""Runs come back from the files that they wrote, with scheme, certificate and error."""

import importlib.util
import json
from dataclasses import asdict, replace

import numpy as np
import pytest
from numpy.testing import assert_array_equal

import lcpimpact as li
from lcpimpact.run_files import plain

ENDINGS = ["npz", *["nc"] * (importlib.util.find_spec("xarray") is not None)]
RUNS = [
    ("system-1", "moreau-jean", {"theta": 0.75}),
    ("bouncing-ball", "exact", {}),
    ("hertz-impact", "moreau-jean", {}),
    ("block-on-belt", "radau", {}),
]


def assert_same(a, b):
    for name in ("t", "q", "v", "t_reaction", "reaction", "push"):
        assert_array_equal(getattr(a, name), getattr(b, name))
    assert (a.names, a.method, a.status, a.message) == (b.names, b.method, b.status, b.message)
    assert plain(asdict(a.certificate)) == plain(asdict(b.certificate))
    assert repr(a.error) == repr(b.error)
    assert repr(dict(a.summary())) == repr(dict(b.summary()))
    assert a.stats.steps == b.stats.steps
    for x, y in zip(a.events, b.events, strict=True):
        assert (x.t, x.contact, x.kind, x.impulse) == (y.t, y.contact, y.kind, y.impulse)
        for side in ("left", "right"):
            for name in ("q", "v", "reaction"):
                assert_array_equal(getattr(getattr(x, side), name), getattr(getattr(y, side), name))


@pytest.mark.parametrize("ending", ENDINGS)
@pytest.mark.parametrize(("name", "method", "options"), RUNS)
def test_a_run_comes_back_whole(tmp_path, ending, name, method, options):
    problem = li.load_problem(name)
    run = li.simulate(problem, method, dt=problem.t_end / 50, **options)
    assert run.error.known
    again = li.read_run(run.save(tmp_path / f"run.{ending}"))
    assert_same(run, again)
    assert (again.problem, again.integrator) == (problem, run.integrator)
    if run.dense is None:
        assert plain(asdict(again.certify())) == plain(asdict(run.certificate))
    else:
        with pytest.raises(li.UnsupportedError, match="read without its continuous solution cannot be judged anew"):
            again.certify()
    assert again.success


@pytest.mark.parametrize("ending", ENDINGS)
def test_a_scheme_that_no_file_holds_is_given_or_missing(tmp_path, ending):
    scheme = li.Scheme(li.Mass("x", 1.0), li.Load("x", lambda t: 1.0 + t), li.Bumper("x", "ground", gap=0.1, e=0.5))
    problem = li.Problem("f", scheme)
    run = li.simulate(problem, dt=1e-2, t_end=1.0)
    path = run.save(tmp_path / f"run.{ending}")
    bare = li.read_run(path)
    assert_array_equal(bare["x"], run["x"])
    assert bare.certificate == run.certificate
    assert repr(dict(bare.summary())) == repr(dict(run.summary()))
    with pytest.raises(li.UnsupportedError, match="read without its scheme"):
        bare.certify()
    assert bare.estimate_error().how == "unknown"
    assert "give read_run" in bare.estimate_error().reason
    whole = li.read_run(path, problem)
    assert whole.certify() == run.certificate
    with pytest.raises(li.InputError, match="the series of its run are x, v_x, R"):
        li.read_run(path, li.load_problem("system-1"))


def test_a_changed_run_without_its_continuous_solution_is_still_judged():
    run = li.simulate(li.load_problem("bouncing-ball"), "exact", dt=1e-2, t_end=1.0)
    assert not replace(run, v=run.v + 0.1, dense=None).certify().holds


def test_tables_are_refused_in_words(tmp_path):
    run = li.simulate(li.load_problem("bouncing-ball"), dt=1e-2, t_end=0.5)
    for ending in ("csv", "mat"):
        with pytest.raises(li.InputError, match=r"a table for other programs.*save the run as \.npz or \.nc"):
            li.read_run(run.save(tmp_path / f"run.{ending}"))


@pytest.mark.parametrize("ending", ENDINGS)
@pytest.mark.parametrize("content", [b"", b"not a run", b"PK\x03\x04 cut", b"CDF\x01"])
def test_other_files_are_refused_in_words(tmp_path, ending, content):
    path = tmp_path / f"other.{ending}"
    path.write_bytes(content)
    with pytest.raises(li.InputError, match="cannot read"):
        li.read_run(path)


def test_a_planted_object_is_not_loaded(tmp_path):
    path = tmp_path / "planted.npz"
    np.savez(path, t=np.array([{"a": 1}], dtype=object))
    with pytest.raises(li.InputError, match="cannot read"):
        li.read_run(path)
    with pytest.raises(li.InputError, match="there is no such file"):
        li.read_run(tmp_path / "none.npz")


def test_every_file_has_the_certificate_and_the_error(tmp_path):
    run = li.simulate(li.load_problem("bouncing-ball"), dt=1e-2, t_end=0.5)
    run.error  # noqa: B018
    run.save(tmp_path / "run.csv")
    found = json.loads((tmp_path / "run.meta.json").read_text(encoding="utf-8"))
    assert found["certificate"]["penetration"] == run.certificate.penetration
    assert found["error"]["columns"]["x"] == run.error["x"]
    from scipy.io import loadmat

    told = loadmat(run.save(tmp_path / "run.mat"), simplify_cells=True)["metadata"]
    assert json.loads(told["error"])["columns"]["x"] == run.error["x"]
    assert json.loads(told["certificate"])["residual"] == run.certificate.residual
