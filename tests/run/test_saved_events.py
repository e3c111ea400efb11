"""A saved run holds its events, so that its momentum balances from the file alone: M Δv = ∫ f dt + Σ Hᵀ P."""

import csv
import importlib.util
import re
from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.io import loadmat

import lcpimpact as li
from lcpimpact.cli.main import main

FORMATS = [
    ".csv",
    ".npz",
    ".mat",
    *[".nc"] * (importlib.util.find_spec("xarray") is not None),
    *[".parquet"] * (importlib.util.find_spec("pyarrow") is not None),
]
METHODS = ("moreau-jean", "exact", "event-driven", "newmark-ns", "rattle-ns")

BALL, BALLS = "bouncing-ball", "three-balls"


@cache
def run(name, method="moreau-jean", dt=1e-3, t_end=1.1):
    parameters = {BALL: {"m": 3.0, "e": 0.5}, BALLS: {"e": 0.7}}[name]
    return li.simulate(li.load_problem(name, **parameters), method, dt=dt, t_end=t_end, progress=False)


def read_csv(path):
    """Everything but the names is a number."""
    with path.open(newline="", encoding="utf-8") as file:
        header, *rows = csv.reader(file)
    columns = {name: [row[i] for row in rows if row[i] != ""] for i, name in enumerate(header)}
    return {
        name: np.array(v) if name in ("contact", "kind", "law", "velocities") else np.array(v, float)
        for name, v in columns.items()
    }


def read_parquet(path):
    frame = pd.read_parquet(path)
    return {name: frame[name].dropna().to_numpy() for name in frame}


def read(path, nodes, contacts):
    """Return t, v, t_R, R, and of the events t, contact, kind, impulse, q, v and r, from nothing but the file.

    Limits have the shape (ne, 2, ...).
    """
    if path.suffix in (".csv", ".parquet"):
        beside = path.with_name(f"{path.stem}.events{path.suffix}")
        told, events = map(read_csv if path.suffix == ".csv" else read_parquet, (path, beside))

        def both(names):
            sides = [[events[f"{name}_{side}"] for name in names] for side in ("left", "right")]
            return np.array(sides).reshape(2, len(names), -1).transpose(2, 0, 1)

        v = [f"v_{node}" for node in nodes]
        series = [
            told["t"],
            np.array([told[each] for each in v]).T,
            told["t_R"],
            np.array([told[c] for c in contacts]).T,
        ]
        return series, [
            *(events[name] for name in ("t", "contact", "kind", "impulse")),
            *map(both, (nodes, v, contacts)),
        ]
    if path.suffix == ".npz":
        with np.load(path, allow_pickle=False) as told:
            limits = [
                np.stack([told[f"event_{name}_{side}"] for side in ("left", "right")], axis=1)
                for name in ("q", "v", "reaction")
            ]
            series = [told[name] for name in ("t", "v", "t_reaction", "reaction")]
            return series, [*(told[f"event_{name}"] for name in ("t", "contact", "kind", "impulse")), *limits]
    if path.suffix == ".mat":
        told = loadmat(path, squeeze_me=False)
        series = [
            told["t"][:, 0],
            np.hstack([told[f"v_{node}"] for node in nodes]),
            told["t_R"][:, 0],
            np.hstack([told[contact] for contact in contacts]),
        ]
        events = {name: told["events"][name][0, 0] for name in told["events"].dtype.names}
        words = [np.array([each[0] for each in events[name].ravel()], dtype=str) for name in ("contact", "kind")]
        limits = [
            np.stack([events[f"{name}_{side}"] for side in ("left", "right")], axis=1)
            for name in ("q", "v", "reaction")
        ]
        return series, [events["t"].ravel(), *words, events["impulse"].ravel(), *limits]
    import xarray

    told = xarray.load_dataset(path, engine="scipy")
    assert told.event_side.values.tolist() == ["left", "right"]
    assert (told.event_node.values.tolist(), told.event_row.values.tolist()) == (list(nodes), list(contacts))
    columns = [np.array([told[f"{prefix}{name}"].values for name in names]).T
               for prefix, names in (("v_", nodes), ("", contacts))]  # fmt: skip
    series = [told.t.values, columns[0], told.t_R.values, columns[1]]
    return series, [told[f"event_{name}"].values for name in ["t", "contact", "kind", "impulse", "q", "v", "reaction"]]


@pytest.mark.parametrize("ending", FORMATS)
@pytest.mark.parametrize("name", [BALL, BALLS])
def test_every_format_holds_the_events_to_the_last_bit(name, ending, tmp_path):
    found = run(name, "exact", dt=0.1)
    d = found.problem.dynamics
    contacts = [each.name for each in d.contacts]
    _, (t, contact, kind, impulse, q, v, r) = read(found.save(tmp_path / f"run{ending}"), d.nodes, contacts)
    assert len(found.events) == len(t) > 1
    for i, event in enumerate(found.events):
        assert (t[i], contact[i], kind[i], impulse[i]) == (event.t, event.contact, event.kind, event.impulse)
        for side, state in enumerate((event.left, event.right)):
            for saved, values in ((q, state.q), (v, state.v), (r, state.reaction)):
                assert_array_equal(saved[i, side], values)


@pytest.mark.parametrize(
    ("name", "method", "ending"),
    [
        (name, method, FORMATS[(i + j) % len(FORMATS)])
        for i, name in enumerate((BALL, BALLS))
        for j, method in enumerate(METHODS)
    ],
)
def test_momentum_balances_from_the_file_alone(name, method, ending, tmp_path):
    """At each instant of the grid, with masses, weight and the order of the balls from the problem's source.

    Each method with each problem, and each format with each problem: what a format holds does not depend on the method.
    """
    found = run(name, method)
    if name == BALL:
        nodes, contacts, m, H, f = ["x"], ["R"], [3.0], [[-1.0]], [3.0 * 9.81]
    else:
        nodes = list(found.problem.dynamics.nodes)
        contacts = [f"R{i + 1}" for i in range(len(nodes) - 1)]
        m, f = (
            [element.m for element in found.problem.scheme.elements if isinstance(element, li.Mass)],
            [0.0] * len(nodes),
        )
        H = [[-1.0 if j == i else 1.0 if j == i + 1 else 0.0 for j in range(len(nodes))] for i in range(len(contacts))]
    (t, v, t_R, R), (at, contact, _, impulse, *_) = read(found.save(tmp_path / f"run{ending}"), nodes, contacts)

    assert len(at) > 1
    assert impulse.min() > 0.0
    P = np.zeros((len(t), len(contacts)))
    for event, who, p in zip(at, contact, impulse, strict=True):
        P[t >= event - 1e-12, contacts.index(who)] += p
    if len(t_R) < len(t):
        pushed = np.vstack([np.zeros(len(contacts)), np.cumsum(R * np.diff(t)[:, None], axis=0)])
    else:
        assert not R.any(), "the bodies fly between impacts"
        pushed = np.zeros_like(P)
    balance = np.array(m) * (v - v[0]) - np.outer(t - t[0], f) - (pushed + P) @ np.array(H)
    scale = np.abs(np.array(m) * v).max()
    # A step that an impact spreads over ends later than its event.
    inside = np.zeros(len(t), dtype=bool)
    for event in at:
        inside |= (t > event - 2.5e-3) & (t < event + 2.5e-3)
    assert_allclose(balance[~inside], 0.0, rtol=0.0, atol=1e-11 * scale)
    assert (~inside).sum() > 0.8 * len(t)
    assert not inside[-1]
    # And it would not without the impulses.
    assert np.abs(balance[-1] + P[-1] @ np.array(H)).max() > 0.1 * scale


@pytest.mark.parametrize("ending", FORMATS)
def test_a_run_without_events_or_contacts_is_saved_and_read(ending, tmp_path):
    for scheme, contacts in (
        (li.Scheme(li.Mass("x", 1.0), li.Bumper("x", "ground", gap=9.0, e=0.0)), ["R"]),
        (li.Scheme(li.Mass("x", 1.0)), []),
    ):
        found = li.simulate(li.Problem("free", scheme, v0={"x": 1.0}), dt=0.1, t_end=1.0)
        path = found.save(tmp_path / f"run{ending}")
        if contacts:
            (t, *_), (at, *_, q, _, r) = read(path, ["x"], contacts)
            assert len(t) == 11
            assert len(at) == 0
            assert q.shape == r.shape == (0, 2, 1)
        assert path.stat().st_size > 0


@pytest.mark.skipif(".nc" not in FORMATS, reason="needs xarray")
def test_names_that_netcdf_cannot_hold_are_spelled_and_told(tmp_path):
    import xarray

    scheme = li.Scheme(
        li.Mass("θ", 1.0), li.Mass("theta", 2.0), li.Mass("mäß", 3.0), li.Bumper("θ", "ground", 1.0, 0.5, "Λ")
    )
    run = li.simulate(li.Problem("Greek", scheme, v0={"θ": -9.0, "theta": 2.0, "mäß": 3.0}), dt=0.01, t_end=0.5)
    run.save(tmp_path / "run.nc")
    found = xarray.load_dataset(tmp_path / "run.nc", engine="scipy")
    told = {found[name].attrs.get("long_name", name): name for name in found.variables}
    for name in run.names:
        np.testing.assert_array_equal(found[told[name]], run[name])
        assert told[name].isascii()
    assert told["θ"] == "theta_2"
    assert told["theta"] == "theta"
    assert told["Λ"] == "Lamda"  # as Unicode calls it
    assert found["event_node"].values.tolist() == ["θ", "theta", "mäß"]
    assert found["event_contact"].values.tolist() == ["Λ"] * len(run.events)


@pytest.mark.skipif(".nc" not in FORMATS, reason="needs xarray")
def test_a_name_of_the_events_is_refused(tmp_path):
    clash = li.Scheme(li.Mass("x", 1.0), li.Bumper("x", "ground", gap=1.0, e=0.0, name="event_t"))
    with pytest.raises(li.InputError, match="'event_t' has a name that a Dataset needs"):
        li.simulate(li.Problem("clash", clash), dt=0.1, t_end=0.1).to_xarray()
    assert list(tmp_path.iterdir()) == []


def test_the_command_line_writes_both_files_or_neither(tmp_path, capsys):
    out = tmp_path / "run.csv"
    arguments = ["simulate", "bouncing-ball", "--dt", "1e-2", "--t-end", "1", "--out", str(out)]
    with pytest.raises(SystemExit) as stop:
        main(arguments)
    assert stop.value.code == 0
    said = capsys.readouterr().out
    assert str(out) in said
    assert str(tmp_path / "run.events.csv") in said
    events = read_csv(tmp_path / "run.events.csv")
    assert (events["kind"].tolist(), events["contact"].tolist()) == (["impact"], ["R"])
    assert events["impulse"][0] == pytest.approx(1.8 * np.sqrt(2.0 * 9.81), rel=1e-2)

    older = out.read_bytes()
    (tmp_path / "run.events.csv").unlink()
    (tmp_path / "run.events.csv").mkdir()
    with pytest.raises(SystemExit) as stop:
        main([*arguments[:2], "--set", "e=0.1", *arguments[2:]])
    assert stop.value.code == 2
    assert "a folder has that name" in " ".join(capsys.readouterr().err.split())
    assert out.read_bytes() == older


def test_the_example_of_the_docs_balances(tmp_path, monkeypatch, capsys):
    page = (Path(__file__).parents[2] / "docs" / "guide" / "run-files.md").read_text(encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    exec(re.search(r"```python\n(.*?)```", page, re.DOTALL).group(1), {})
    assert capsys.readouterr().out == "True\n"


def test_saving_again_leaves_no_events_of_the_older_run(tmp_path):
    path = run(BALL).save(tmp_path / "run.csv")
    sizes = [len(read_csv(tmp_path / "run.events.csv")["t"])]
    run(BALL, t_end=0.1).save(path)
    sizes.append(len(read_csv(tmp_path / "run.events.csv")["t"]))
    assert sizes[0] > sizes[1] == 0
    assert all(a < b for a, b in pairwise(read_csv(path)["t"]))
