"""How many velocities obey the law of an impact with friction: against closed forms and enumeration in the test itself."""

from __future__ import annotations

import csv
import importlib.util
import json
import math
from itertools import product

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import linprog

import lcpimpact as li
from lcpimpact.certificate.impact_choices import Contacts, has_one_solution, solutions

WEDGE = ([(2.0, -1.0), (2.0, -1.0)], [(2.0, 0.0), (-1.0, 0.0)], 1.0, (-1.0, 2.0))
"""Every v⁺ = (a, 2 a), 0 <= a <= 1/3, obeys the law."""

BETWEEN = ([(-2.0, 0.0, 1.0), (0.0, 0.0, 2.0)], [(1.0, 2.0, 0.0), (1.0, 0.0, -1.0)], 0.5, (2.0, -2.0, -2.0))
"""Every v⁺ = (0, a, 0), -10/13 <= a <= -6/11, obeys the law."""


def unit_masses(N, T, mu, v, gap=0.0, e=0.0, e_T=0.0, mu_s=None):
    """Coordinates of 1 kg with rough contacts gap + N·q >= 0, which slide with T·v."""
    names, static = [f"q{i}" for i in range(len(v))], {} if mu_s is None else {"mu_s": mu_s}
    scheme = li.Scheme(*(li.Mass(name, 1.0) for name in names))
    for k, (normal, tangent) in enumerate(zip(N, T, strict=True)):
        rows = ({a: float(x) for a, x in zip(names, row, strict=True) if x} for row in (normal, tangent))
        scheme.add(li.Bumper("ground", next(rows), gap, e, f"N{k}"))
        scheme.add(li.Friction("ground", next(rows), mu, f"N{k}", e_T, f"T{k}", **static))
    return li.Problem("unit masses", scheme, v0=dict(zip(names, map(float, v), strict=True)))


@pytest.mark.parametrize("method", ["exact", "event-driven", "moreau-jean"])
@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(
    ("law", "v"),
    [
        ({"mu": 0.66}, (0.0, 0.0)),
        ({"mu": 0.67}, (0.0, 0.0)),
        ({"mu": 1.0}, (0.0, 0.0)),
        ({"mu": 3.0}, (0.0, 0.0)),
        ({"mu": 1.0, "gap": 0.0}, (0.0, 0.0)),
        ({"mu": 1.0, "mu_s": 1.2}, (0.0, 0.0)),
        ({"mu": 1.0, "e": 0.5}, (0.5, -0.75)),
        ({"mu": 1.0, "e_T": 0.5}, (0.0, -0.05)),
    ],
    ids=str,
)
def test_an_impact_that_stops_a_slip_it_would_reverse(method, side, law, v):
    """M = I, N = (1, 0), T = (3/2, 1): sticking gives P = -W⁻¹ (U + e U), within the cone of friction."""
    problem = unit_masses([(1.0, 0.0)], [(1.5, side)], v=(-1.0, 1.6 * side), **{"gap": 0.1} | law)
    run = li.simulate(problem, method, dt=0.01, t_end=0.2)
    assert_allclose(run.v[-1], [v[0], side * v[1]], atol=1e-9)
    impulses = {event.contact: event.impulse for event in run.events if event.kind == "impact"}
    H, e, e_T = np.array([[1.0, 0.0], [1.5, side]]), law.get("e", 0.0), law.get("e_T", 0.0)
    P = np.linalg.solve(H @ H.T, -np.diag([1.0 + e, 1.0 + e_T]) @ H @ [-1.0, 1.6 * side])
    assert_allclose([impulses["N0"], impulses["T0"]], P, rtol=1e-9)
    assert {event.solutions for event in run.events} == {1}
    assert {event.law for event in run.events if event.kind == "impact"} == {"newton"}


@pytest.mark.parametrize("method", ["exact", "moreau-jean"])
@pytest.mark.parametrize(
    ("case", "ends"), [(WEDGE, [(0, 0), (1 / 3, 2 / 3)]), (BETWEEN, [(0, -10 / 13, 0), (0, -6 / 11, 0)])]
)
def test_a_continuum_of_velocities(method, case, ends):
    run = li.simulate(unit_masses(*case), method, dt=0.01, t_end=0.1)
    impacts = [event for event in run.events if event.kind == "impact"]
    assert {event.solutions for event in impacts} == {math.inf}
    found = np.array(impacts[0].velocities)
    assert_allclose([found.min(axis=0), found.max(axis=0)], ends, atol=1e-9)
    assert run.success
    assert "Several v⁺ obey the law of impact at t" in run.message
    assert "continuum" in run.message


@pytest.mark.parametrize("method", ["exact", "moreau-jean"])
def test_each_impact_of_a_run_is_counted_by_its_own_contacts(method):
    """A body strikes alone, with one v⁺, and after it others, with many: what one impact was found to have is no other's."""
    N, T, mu, v = WEDGE
    apart = (0.0, 0.0)
    problem = unit_masses(
        [*((*row, *apart) for row in N), (*apart, 1.0, 0.0)], [*((*row, *apart) for row in T), (*apart, 0.0, 1.0)],
        mu, (*v, -8.0, 1.0), gap=0.1,
    )  # fmt: skip
    run = li.simulate(problem, method, dt=1e-3, t_end=0.05)
    counted = {event.contact: event.solutions for event in run.events if event.kind == "impact"}
    assert counted.pop("N2") == 1
    assert set(counted) - {"T2"} <= {"N0", "T0", "N1", "T1"}
    assert {number for contact, number in counted.items() if contact != "T2"} == {math.inf}


def test_the_verdict_says_that_several_motions_obey_the_laws():
    found = li.cross_validate(unit_masses(*BETWEEN), ["exact", "moreau-jean"], t_end=0.1, dt=1e-2)
    assert "Several v⁺" in found.reasons[0]
    assert "continuum" in str(found)
    stops = unit_masses([(1.0, 0.0)], [(1.5, 1.0)], 1.0, (-1.0, 1.6))
    assert not li.cross_validate(stops, ["exact", "event-driven"], t_end=0.1, dt=1e-2).several


def by_linear_programs(contacts, direction):
    """Return the interval of direction·z in each feasible combination of open, sticking and slipping contacts."""
    N, T, ξ_N, ξ_T, mu, _ = contacts
    for case in product((None, 0, 1, -1), repeat=len(mu)):
        P = np.hstack([N, T])
        equal, right, below, most = [], [], [], []
        for k, state in enumerate(case):
            normal, slip, n, t = np.zeros((4, 2 * len(mu)))
            normal, slip, n[k], t[len(mu) + k] = N[:, k] @ P, T[:, k] @ P, 1.0, 1.0
            if state is None:
                equal += [n, t]
                right += [0.0, 0.0]
                below.append(-normal)
                most.append(ξ_N[k])
                continue
            equal.append(normal)
            right.append(-ξ_N[k])
            if state == 0:
                equal.append(slip)
                right.append(-ξ_T[k])
                below += [t - mu[k] * n, -t - mu[k] * n]
                most += [0.0, 0.0]
            else:
                equal.append(t + state * mu[k] * n)
                right.append(0.0)
                below.append(-state * slip)
                most.append(state * ξ_T[k])
        bounds = [(0.0, None)] * len(mu) + [(None, None)] * len(mu)
        limits = [
            linprog(sign * direction @ P, below or None, most or None, equal, right, bounds) for sign in (1.0, -1.0)
        ]
        if all(each.status == 0 for each in limits):
            yield limits[0].fun, -limits[1].fun


def disjoint(intervals):
    """Return intervals merged where they touch."""
    merged = []
    for low, high in sorted(intervals):
        if merged and low <= merged[-1][1] + 1e-6:
            merged[-1][1] = max(merged[-1][1], high)
        else:
            merged.append([low, high])
    return merged


@pytest.mark.parametrize("seed", [*range(12), *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(12, 60))])
def test_the_number_of_velocities_is_that_of_linear_programs(seed):
    rng = np.random.default_rng(seed)
    nc, whole = int(rng.integers(1, 3)), bool(seed % 2)
    n = int(rng.integers(2, 2 * nc + 2))
    sizes = (n, nc), (n, nc), n
    N, T, v = (rng.integers(-2, 3, size).astype(float) if whole else rng.normal(size=size) for size in sizes)
    contacts = Contacts(N, T, N.T @ v, T.T @ v, rng.choice([0.05, 0.5, 1.0, 2.0], nc), np.zeros(nc))
    number, ends = solutions(contacts)
    direction = rng.normal(size=n)
    found = disjoint(by_linear_programs(contacts, direction))
    along = sorted(float(direction @ z) for z in ends)
    if has_one_solution(contacts):
        assert number == 1
    if number == math.inf:
        assert any(high - low > 1e-6 for low, high in found)
        return
    assert number == len(found)
    assert_allclose(np.array(found).reshape(-1, 2), np.repeat(along, 2).reshape(-1, 2), atol=1e-6)


def contacts_of_unit_masses(N, T, mu, v, e):
    """The contacts of `unit_masses`, for `by_linear_programs`."""
    N, T, v, nc = np.array(N, float).T, np.array(T, float).T, np.array(v, float), len(N)
    U = v @ N
    return Contacts(N, T, U + e * np.minimum(U, 0.0), v @ T, np.full(nc, mu), np.zeros(nc))


@pytest.mark.parametrize("method", ["exact", "event-driven"])
@pytest.mark.parametrize(
    "seed", [0, 1, 14, 41, 47, 53, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(60, 80))]
)
def test_redundant_rough_contacts_are_struck_as_linear_programs_say(seed, method):
    """Three contacts in the plane, of which two or three have one normal, or one tangent."""
    rng = np.random.default_rng(seed)
    while True:
        N, T, v = (rng.integers(-2, 3, size) for size in ((3, 2), (3, 2), 2))
        N[1], T[2] = (N[0], T[2]) if seed % 2 else (N[1], T[0])
        if N.any(axis=1).all() and T.any(axis=1).all() and (N @ v < 0).any():
            break
    mu, e = rng.choice([0.3, 1.0, 2.0]), 0.0 if seed % 4 else 0.5
    direction = rng.normal(size=2)
    intervals = list(by_linear_programs(contacts_of_unit_masses(N, T, mu, v, e), direction))
    problem = unit_masses(N, T, mu, v, e=e)
    if not intervals:
        with pytest.raises(li.UnsupportedError, match="begins with an impact"):
            li.simulate(problem, method, dt=1e-6, t_end=1e-6)
        return
    run = li.simulate(problem, method, dt=1e-6, t_end=1e-6, throw=False, error=False)
    assert run.status.name != "SINGULAR"
    struck = [event for event in run.events if event.kind == "impact"]
    taken = direction @ (struck[0].right.v - v)
    assert any(low - 1e-6 <= taken <= high + 1e-6 for low, high in intervals)


def test_more_than_five_rough_contacts_are_not_examined():
    N, T = [(1.0, 0.0)] * 6, [(0.2 * k, 1.0) for k in range(6)]
    run = li.simulate(unit_masses(N, T, 1.0, (-1.0, 0.5)), dt=0.01, t_end=0.02)
    assert {event.solutions for event in run.events if event.kind == "impact"} == {None}
    assert "not examined" in run.message


def test_a_rounding_impulse_is_no_impact():
    """N = (-1, 2, -2), T = (2, -2, 0): with v0 = (2, 0, 2) the slip is parallel to what the normal impulse changes."""
    for N, T, mu, v in (
        ((-1.0, 2.0, -2.0), (2.0, -2.0, 0.0), 2.0, (2.0, 0.0, 2.0)),
        ((1.0, 2.0), (1.0, 1.0), 0.1, (-1.0, -2.0)),
        ((2.0, -2.0), (2.0, 1.0), 0.5, (-1.0, 1.0)),
    ):
        run = li.simulate(unit_masses([N], [T], mu, v), "exact", dt=0.01, t_end=0.02)
        sizes = [abs(event.impulse) for event in run.events if event.kind == "impact"]
        assert run.success
        assert min(sizes) > 1e-3


@pytest.mark.parametrize("method", ["exact", "moreau-jean", "rk4"])
def test_the_law_that_touching_bodies_were_struck_by(method):
    """Of three balls the last two touch; two others meet at the same instant elsewhere: all by the law of their scheme."""
    scheme = li.Scheme(*(li.Mass(name, 1.0) for name in ("a", "b", "c", "d", "e")))
    for pair, gap in (("ab", 0.05), ("bc", 0.0), ("de", 0.05)):
        scheme.add(li.Bumper(*pair, gap, 1.0, pair.upper()))
    run = li.simulate(li.Problem("balls", scheme, v0={"a": 1.0, "d": 1.0}), method, dt=0.01, t_end=0.1)
    laws = {event.contact: event.law for event in run.events if event.kind == "impact"}
    assert {"AB", "DE"} <= laws.keys()
    assert set(laws.values()) == {"newton"}


def test_files_with_the_former_word_for_newtons_law_are_read(tmp_path):
    run = li.simulate(li.load_problem("three-balls"), "exact", dt=0.1, error=False)
    run.save(tmp_path / "run.npz")
    with np.load(tmp_path / "run.npz") as file:
        held = dict(file)
    assert set(held["event_law"]) == {"newton"}
    held["event_law"] = np.full(len(held["event_law"]), "simultaneous")
    np.savez(tmp_path / "old.npz", **held)
    assert [each.law for each in li.read_run(tmp_path / "old.npz").events] == [each.law for each in run.events]


@pytest.mark.parametrize("ending", [".npz", ".csv", *[".nc"] * (importlib.util.find_spec("xarray") is not None)])
def test_files_hold_the_law_and_the_number_of_solutions_with_their_extremes(ending, tmp_path):
    run = li.simulate(unit_masses(*BETWEEN), "exact", dt=0.01, t_end=0.02)
    path = run.save(tmp_path / f"run{ending}")
    if ending == ".csv":
        with (tmp_path / "run.events.csv").open(encoding="utf-8", newline="") as file:
            told = list(csv.DictReader(file))
        assert [line["law"] for line in told] == [event.law for event in run.events]
        assert [float(line["solutions"]) for line in told] == [event.solutions for event in run.events]
        velocities = [json.loads(line["velocities"] or "[]") for line in told]
    else:
        again = li.read_run(path).events
        assert [(event.law, event.solutions) for event in again] == [
            (event.law, event.solutions) for event in run.events
        ]
        velocities = [[v.tolist() for v in event.velocities] for event in again]
    assert velocities == [[v.tolist() for v in event.velocities] for event in run.events]
    assert max(map(len, velocities)) == 2


@pytest.mark.parametrize("method", ["exact", "event-driven"])
def test_rebounds_that_exclude_each_other_are_called_so(method):
    """No velocity obeys the law with e = 1/2, as linear programs say, and one does with e = 0."""
    N, T, v = [(-1.0, -1.0), (-2.0, 0.0)], [(-1.0, 0.0), (-2.0, -2.0)], (1.0, 1.0)
    assert not list(by_linear_programs(contacts_of_unit_masses(N, T, 1.0, v, 0.5), np.array([0.6, 0.8])))
    with pytest.raises(li.UnsupportedError, match=r"begins with an impact.*take e = 0 there"):
        li.simulate(unit_masses(N, T, 1.0, v, e=0.5), method, dt=0.01, t_end=0.2)
    run = li.simulate(unit_masses(N, T, 1.0, v, gap=0.2, e=0.5), method, dt=0.01, t_end=0.2, throw=False)
    assert run.status.name == "NO_VELOCITY"
    assert "take e = 0 there" in run.message
    run = li.simulate(unit_masses(N, T, 1.0, v, gap=0.2), method, dt=0.01, t_end=0.2)
    assert_allclose(run.v[-1], 0.0, atol=1e-9)


@pytest.mark.parametrize("e", [0.0717, 0.07])
@pytest.mark.parametrize("method", ["exact", "event-driven"])
def test_an_accumulation_near_the_threshold_of_collapse_lasts_to_its_limit(method, e):
    """The impacts are at d + δ p_(n-1)/p_n, with p_(n+1) = h p_n - e p_(n-1), until t = d + δ/λ."""
    h = 0.5 * (1.0 + e)
    limit = 0.1 + 0.2 / (0.5 * (h + math.sqrt(h**2 - 4.0 * e)))
    run = li.simulate(li.load_problem("inelastic-collapse", e=e), method, dt=0.1, t_end=1.0)
    assert run.events[-1].t == pytest.approx(limit, rel=1e-8)
    assert_allclose(run.v[-1], 1.0 / 3.0, rtol=1e-12)


@pytest.mark.parametrize(("e", "accuracy"), [(0.0718, 1e-5), (0.072, 1e-6)])
@pytest.mark.parametrize("method", ["exact", "event-driven", "radau-fesd"])
def test_impacts_just_above_the_threshold_of_collapse_take_their_time(method, e, accuracy):
    """503 or 63 impacts, the last ones far below rounding: that of t_N is long after those that can be told apart."""
    problem = li.load_problem("inelastic-collapse", e=e)
    t_N = next(fact.value for fact in problem.facts if fact.symbol == "t_N")
    run = li.simulate(problem, method, dt=problem.t_end / 40.0, t_end=problem.t_end)
    assert run.events[-1].t == pytest.approx(t_N, rel=accuracy)
    assert run.v[-1] == pytest.approx([1.0 / 3.0] * 3, abs=1e-12)
