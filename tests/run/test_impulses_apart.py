"""Impulses apart from forces: through contacts that are closed before an impact too, by every method with steps."""

from __future__ import annotations

import csv
import itertools
import json
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lcpimpact import (
    Bumper,
    Friction,
    Load,
    Mass,
    PrescribedMotion,
    Problem,
    RigidLink,
    Scheme,
    Spring,
    Table,
    simulate,
    sweep,
)

STEPS = (
    "moreau-jean", "moreau-midpoint", "newmark-ns", "generalized-alpha", "rattle-ns", "stormer-verlet-ns", "d1-minus",
    "cd-lagrange", "schatzman-paoli", "radau",
)  # fmt: skip
ROUGH = ("moreau-jean", "moreau-midpoint", "newmark-ns", "stormer-verlet-ns", "d1-minus", "radau")


def struck_block(e: float = 0.5) -> Problem:
    """2 kg at rest on a floor under a load of 20 N, struck by 1 kg at 1 m/s after 0.1 s: the block stays, P = 1.5 N s."""
    scheme = Scheme(
        Mass("x", m=2.0), Mass("y", m=1.0), Load("x", f=20.0),
        Bumper("x", "ground", e=e, name="R1"), Bumper("y", "x", e=0.5, name="R2"),
    )  # fmt: skip
    return Problem("struck block", scheme, q0={"y": -0.1}, v0={"y": 1.0}, t_end=0.2)


def impulses(run: Any) -> dict[str, list[float]]:
    """The impulses of each contact."""
    found: dict[str, list[float]] = {}
    for event in run.events:
        if event.impulse:
            assert event.kind == "impact"
            found.setdefault(event.contact, []).append(event.impulse)
    return found


@pytest.mark.parametrize("dt", [1e-2, 1e-3, pytest.param(1e-4, marks=pytest.mark.slow)])
@pytest.mark.parametrize("method", STEPS)
def test_a_floor_that_holds_a_struck_block_takes_the_impulse_and_keeps_its_force(method: str, dt: float) -> None:
    run = simulate(struck_block(), method, dt=dt)
    assert impulses(run) == {"R1": [pytest.approx(1.5, abs=1e-9)], "R2": [pytest.approx(1.5, abs=1e-9)]}
    np.testing.assert_allclose(run["R1"], 20.0, rtol=1e-9)
    found = run.summary()
    assert found["peak_force"] == pytest.approx(20.0, rel=1e-9)
    assert found["impacts"] == 2.0
    assert found["impulse"] == pytest.approx(20.0 * 0.2 + 3.0, rel=1e-9)
    assert len({event.t for event in run.events}) == 1  # one impact, at one instant


@pytest.mark.parametrize("method", STEPS)
def test_touching_balls_without_a_load_have_impulses_and_no_force(method: str) -> None:
    scheme = Scheme(
        *(Mass(name, m=1.0) for name in "abc"), Bumper("a", "b", e=0.0, name="R1"), Bumper("b", "c", e=0.0, name="R2")
    )
    for dt in (1e-2, 1e-3):
        run = simulate(Problem("three balls", scheme, v0={"a": 1.0}, t_end=0.2), method, dt=dt)
        assert impulses(run) == {"R1": [pytest.approx(2 / 3)], "R2": [pytest.approx(1 / 3)]}
        assert np.abs(run.reaction).max() < 1e-10
        assert run.summary()["peak_force"] < 1e-10


@pytest.mark.parametrize("method", STEPS)
def test_a_hammer_on_a_sprung_anvil(method: str) -> None:
    """Falls of a hammer of 1 kg end with (1 + e) V; the anvil rests on its stop, and a spring presses it there by 4.2 N."""
    scheme = Scheme(
        Mass("anvil", m=2.0), Mass("hammer", m=1.0), Load("anvil", f=2.0 * 9.81 + 4.2), Load("hammer", f=9.81),
        Spring("anvil", "ground", k=1000.0), Bumper("anvil", "ground", e=0.3, name="A"),
        Bumper("hammer", "anvil", e=0.5, name="H"),
    )  # fmt: skip
    V = np.sqrt(2.0 * 9.81 * 0.2)
    dt = 1e-3
    run = simulate(Problem("hammer", scheme, q0={"hammer": -0.2}, t_end=0.45), method, dt=dt)
    found = impulses(run)
    for name in "AH":
        assert found[name] == [pytest.approx(1.5 * V, abs=4 * 9.81 * dt), pytest.approx(0.75 * V, abs=6 * 9.81 * dt)]
    np.testing.assert_allclose(run["A"], 23.82, rtol=1e-6)  # the hammer is in flight, and no force of it counts
    assert run.summary()["peak_force"] == pytest.approx(23.82, rel=1e-6)
    assert run.summary()["impacts"] == 4.0


@pytest.mark.parametrize("method", ROUGH)
def test_a_block_on_a_rough_floor_struck_from_above(method: str) -> None:
    scheme = Scheme(
        Mass("x", m=3.0), Mass("z", m=3.0), Mass("p", m=1.0), Load("z", f=29.43),
        Bumper("z", "ground", e=0.0, name="N"), Friction("x", "ground", mu=0.3, normal="N", name="T"),
        Bumper({"p": 1.0}, {"x": 0.6, "z": 0.8}, gap=0.1, e=0.5, name="S"),
    )  # fmt: skip
    # The block slides: P_N = 0.8 P, P_T = 0.3 P_N; U⁺ = P (1 + 0.6 (0.6 - 0.24)/3) - 1 = 0.5.
    P = Fraction(3, 2) / (1 + Fraction(6, 10) * (Fraction(6, 10) - Fraction(24, 100)) / 3)
    dt = 1e-3
    run = simulate(Problem("rough floor", scheme, v0={"p": 1.0}, t_end=0.2), method, dt=dt)
    found = impulses(run)
    assert found["S"] == [pytest.approx(float(P), abs=6 * dt)]
    assert found["N"] == [pytest.approx(0.8 * float(P), abs=6 * dt)]
    assert np.abs(found["T"]) == [pytest.approx(0.24 * float(P), abs=6 * dt)]
    np.testing.assert_allclose(run["N"], 29.43, rtol=1e-9)
    assert (np.abs(run["T"]) <= 0.3 * run["N"] * (1.0 + 1e-9)).all()
    assert run.summary()["peak_force"] == pytest.approx(29.43, rel=1e-9)


@pytest.mark.parametrize("method", ["moreau-jean", "moreau-midpoint", "newmark-ns", "stormer-verlet-ns", "d1-minus"])
def test_a_joint_between_the_struck_body_and_what_stands_on_the_floor(method: str) -> None:
    scheme = Scheme(
        Mass("x", m=2.0), Mass("w", m=1.0), Mass("y", m=1.0), Load("x", f=20.0), RigidLink("x", "w", name="L"),
        Bumper("w", "ground", e=0.5, name="R1"), Bumper("y", "x", e=0.5, name="R2"),
    )  # fmt: skip
    for dt in (1e-2, 1e-3):
        run = simulate(Problem("joint", scheme, q0={"y": -0.1}, v0={"y": 1.0}, t_end=0.2), method, dt=dt)
        assert impulses(run) == {name: [pytest.approx(1.5)] for name in ("L", "R1", "R2")}
        np.testing.assert_allclose(run["R1"], 20.0, rtol=1e-9)
        np.testing.assert_allclose(run["L"], 20.0, rtol=1e-9)


def test_a_path_over_a_plate_without_mass() -> None:
    scheme = Scheme(
        Mass("x", m=2.0), Mass("y", m=1.0), Load("x", f=20.0), Spring("z", "ground", k=100.0),
        Bumper("x", "z", e=0.5, name="R1"), Bumper("z", "ground", e=0.5, name="S"), Bumper("y", "x", e=0.5, name="R2"),
    )  # fmt: skip
    run = simulate(Problem("plate", scheme, q0={"y": -0.1}, v0={"y": 1.0}, t_end=0.2), dt=1e-3)
    assert impulses(run) == {name: [pytest.approx(1.5)] for name in ("R1", "S", "R2")}
    np.testing.assert_allclose(run["R1"], 20.0, rtol=1e-6)
    np.testing.assert_allclose(run["S"], 20.0, rtol=1e-6)


@pytest.mark.parametrize("method", ["moreau-jean", "radau"])
def test_a_floor_whose_velocity_jumps_lifts_what_stands_on_it(method: str) -> None:
    scheme = Scheme(
        Mass("x", m=2.0), PrescribedMotion("g", y=Table([0.0, 0.1, 1.0], [0.0, 0.0, -0.9])), Load("x", f=20.0),
        Bumper("x", "g", e=0.0, name="R"),
    )  # fmt: skip
    dt = 1e-3
    run = simulate(Problem("lift", scheme, t_end=0.15), method, dt=dt)
    found = impulses(run)["R"]
    assert found[0] == pytest.approx(2.0, abs=21 * dt)  # m times the jump of 1 m/s
    assert run.summary()["peak_force"] <= 20.0 * (1.0 + 1e-9)


def test_a_closed_contact_has_the_force_of_what_stays_on_it() -> None:
    """A heavy striker that rebounds adds nothing to the force of the floor, at any step."""
    scheme = Scheme(
        Mass("x", m=2.0), Mass("y", m=5.0), Load("x", f=20.0), Load("y", f=50.0),
        Bumper("x", "ground", e=0.0, name="R1"), Bumper("y", "x", e=0.9, name="R2"),
    )  # fmt: skip
    for method in STEPS:
        run = simulate(Problem("heavy", scheme, q0={"y": -0.1}, t_end=0.25), method, dt=1e-3)
        assert run.summary()["peak_force"] == pytest.approx(20.0, rel=1e-6), method


@pytest.mark.parametrize("method", STEPS)
def test_a_body_at_rest_under_a_load_has_a_force_and_no_impulse(method: str) -> None:
    scheme = Scheme(Mass("x", m=2.0), Load("x", f=20.0), Bumper("x", "ground", e=0.5, name="R"))
    run = simulate(Problem("rest", scheme, t_end=0.3), method, dt=1e-3)
    assert not impulses(run)
    np.testing.assert_allclose(run["R"], 20.0, rtol=1e-9)


def newton(m: list[float], v: list[float], closed: list[int], e: float) -> np.ndarray:
    """Impulses of a stack of bodies, contact k between body k and k - 1 or the floor, by trying all sets that push."""
    n = len(m)
    H = np.eye(n) - np.eye(n, k=1)  # heights: U_k = v_k - v_{k-1}
    H = H.T
    U, W = H @ v, H @ np.diag(1.0 / np.array(m)) @ H.T
    for size in range(len(closed) + 1):
        for pushing in itertools.combinations(closed, size):
            A, P = list(pushing), np.zeros(n)
            P[A] = -np.linalg.solve(W[np.ix_(A, A)], (U + e * np.minimum(U, 0.0))[A])
            rate = U + W @ P + e * np.minimum(U, 0.0)
            if (P >= -1e-12).all() and (rate[closed] >= -1e-12).all():
                return P
    raise AssertionError("the law has no solution")


@pytest.mark.parametrize("seed", range(4))
def test_random_stacks_have_the_impulses_of_the_law_and_the_weights_as_forces(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n, g, e = 4, 9.81, 0.4
    m, V = list(rng.uniform(0.5, 3.0, n)), 1.0
    bumpers = [Bumper("x0", "ground", e=e, name="R0")]
    bumpers += [Bumper(f"x{k}", f"x{k - 1}", e=e, name=f"R{k}") for k in range(1, n)]
    loads = [Load(f"x{k}", f=m[k] * g) for k in range(n - 1)]  # the last body strikes, without a load
    scheme = Scheme(*(Mass(f"x{k}", m=m[k]) for k in range(n)), *loads, *bumpers)
    last = f"x{n - 1}"
    problem = Problem("stack", scheme, q0={last: -0.1 + 5e-4}, v0={last: V}, t_end=0.12)
    expected = newton(m, [0.0] * (n - 1) + [-V], list(range(n)), e)
    weights = g * np.append(np.cumsum(m[n - 2 :: -1])[::-1], 0.0)
    for method in ("moreau-jean", "generalized-alpha", "rattle-ns"):
        run = simulate(problem, method, dt=1e-3)
        found = impulses(run)
        for k in range(n):
            # The part of the weights that falls into the step of the impact is the impulse's or the force's.
            assert found[f"R{k}"][0] == pytest.approx(expected[k], abs=2e-3 * (1.0 + weights.max())), (method, k)
            assert run[f"R{k}"].max() <= weights[k] * (1.0 + 1e-6) + 1e-9, (method, k)
        assert run["R0"][0] == pytest.approx(weights[0])


def test_redundant_supports_share_force_and_impulse() -> None:
    arms = (-1.0, -0.3, 0.4, 1.0)
    scheme = Scheme(
        Mass("x", m=2.0), Mass("φ", m=0.5), Mass("y", m=1.0), Load("x", f=20.0),
        *(Bumper({"x": 1.0, "φ": a}, "ground", e=0.2, name=f"R{i}") for i, a in enumerate(arms)),
        Bumper("y", {"x": 1.0, "φ": 0.2}, e=0.5, name="S"),
    )  # fmt: skip
    run = simulate(Problem("plank", scheme, q0={"y": -0.1}, v0={"y": 1.0}, t_end=0.2), dt=1e-3)
    found = {name: sum(each) for name, each in impulses(run).items()}
    assert found.pop("S") == pytest.approx(1.5)
    assert sum(found.values()) == pytest.approx(1.5)
    assert sum(P * arms[int(name[1])] for name, P in found.items()) == pytest.approx(0.2 * 1.5)
    np.testing.assert_allclose(run.reaction.sum(axis=1), 20.0, rtol=1e-9)


@pytest.mark.parametrize("method", ["moreau-jean", "newmark-ns", "radau"])
def test_momentum_balances_from_the_files(method: str, tmp_path: Path) -> None:
    """M (v(t) - v(0)) = ∫ (f + Hᵀ r) dt + Σ Hᵀ P with nothing but what is in the file, at each instant of the grid."""
    run = simulate(struck_block(), method, dt=1e-3)
    m, f, H = np.array([2.0, 1.0]), np.array([20.0, 0.0]), {"R1": [-1.0, 0.0], "R2": [1.0, -1.0]}

    def off(t: np.ndarray, v: np.ndarray, r: dict[str, np.ndarray], events: list[tuple[float, str, float]]) -> float:
        momentum = m * v[0] + np.outer(t, f)
        for name, row in H.items():
            momentum[1:] += np.outer(np.cumsum(np.diff(t) * r[name]), row)
        for instant, name, P in events:
            momentum[t >= instant - 1e-12] += P * np.array(H[name])
        far = np.abs(t[:, None] - [each[0] for each in events]).min(axis=1) > 1.5e-3
        return float(np.abs(momentum - m * v)[far].max())

    run.save(tmp_path / "run.npz")
    with np.load(tmp_path / "run.npz") as file:
        r = dict(zip(("R1", "R2"), file["reaction"].T, strict=True))
        events = list(zip(file["event_t"], map(str, file["event_contact"]), file["event_impulse"], strict=True))
        assert off(file["t"], file["v"], r, events) < 1e-11
    run.save(tmp_path / "run.csv")
    assert json.loads((tmp_path / "run.meta.json").read_text())["status"] == "SOLVED"
    with (tmp_path / "run.csv").open() as file, (tmp_path / "run.events.csv").open() as other:
        rows, found = list(csv.DictReader(file)), list(csv.DictReader(other))
    r = {name: np.array([float(row[name]) for row in rows if row[name]]) for name in H}
    v = np.array([[float(row["v_x"]), float(row["v_y"])] for row in rows])
    events = [(float(row["t"]), row["contact"], float(row["impulse"])) for row in found]
    assert off(np.array([float(row["t"]) for row in rows]), v, r, events) < 1e-11


def test_a_sweep_has_the_forces_and_counts_of_its_runs() -> None:
    pytest.importorskip("xarray")
    outputs = ("R1.max", "peak_force", "impacts", "R1.impact:1.impulse")
    found = sweep(struck_block(), {"R1.e": [0.1, 0.5]}, dt=1e-3, outputs=outputs, progress=False)
    assert (found["status"] == 0).all()
    np.testing.assert_allclose(found["R1.max"], 20.0, rtol=1e-9)
    np.testing.assert_allclose(found["peak_force"], 20.0, rtol=1e-9)
    np.testing.assert_allclose(found["impacts"], 2.0)
    np.testing.assert_allclose(found["R1.impact:1.impulse"], 1.5, rtol=1e-9)


def test_bodies_that_meet_again_in_the_next_step_have_an_impact_in_each() -> None:
    """A ball between a heavy body and a wall, hit in every step: its contacts never part on the grid."""
    scheme = Scheme(
        Mass("a", m=100.0), Mass("b", m=1.0), Bumper("a", "b", gap=1e-2, e=0.9, name="R1"),
        Bumper("b", "ground", gap=1e-3, e=0.9, name="R2"),
    )  # fmt: skip
    run = simulate(Problem("squeezed", scheme, v0={"a": 1.0}, t_end=0.05), dt=1e-3)
    assert np.abs(run.reaction).max() < 1e-6  # nothing presses the bodies together
    a = sum(event.impulse for event in run.events if event.contact == "R1")
    assert 100.0 * (run["v_a"][-1] - 1.0) == pytest.approx(-a)
