"""Branches of periodic orbits through folds: the closed form of an oscillator that strikes once a period."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import brentq

from lcpimpact import (
    InputError,
    LinearComplementaritySystem,
    Problem,
    continue_orbit,
    continue_through_folds,
    load_problem,
    periodic_orbit,
)
from lcpimpact.cli.main import main
from lcpimpact.study.dynamics.arclength import Curve
from lcpimpact.study.dynamics.shooting import find_orbit

ZETA, OMEGA, E, S = 0.05, 2.6, 0.8, -0.05


def struck(omega: float = OMEGA, f: float = 0.06):
    """An oscillator pressed against its stop."""
    return load_problem("shaw-holmes", zeta=ZETA, omega=omega, s=S, e=E, f=f)


def amplitude(speed, omega: float = OMEGA):
    """The amplitude of the force with which the orbit strikes once a period, at the speed V (Shaw and Holmes, 1983).

    x = exp(-ζ t) (C1 cos ω_d t + C2 sin ω_d t) + a cos ω t - b sin ω t between x(0) = x(T) = s, x'(0) = -e V and x'(T) = V.
    """
    T, ω_d = 2.0 * math.pi / omega, math.sqrt(1.0 - ZETA**2)
    c, d, decay = math.cos(ω_d * T), math.sin(ω_d * T), math.exp(-ZETA * T)
    rows = [
        [1.0, 0.0, 1.0, 0.0],
        [decay * c, decay * d, 1.0, 0.0],
        [-ZETA, ω_d, 0.0, -omega],
        [decay * (-ZETA * c - ω_d * d), decay * (-ZETA * d + ω_d * c), 0.0, -omega],
    ]
    at_rest, per_speed = np.linalg.solve(rows, [[S, 0.0], [S, 0.0], [0.0, -E], [0.0, 1.0]]).T[:, 2:]
    stiffness = math.hypot(1.0 - omega**2, 2.0 * ZETA * omega)
    lowest = -(at_rest @ per_speed) / (per_speed @ per_speed)
    wave = at_rest + np.multiply.outer(lowest if speed is None else speed, per_speed)
    return stiffness * np.linalg.norm(wave, axis=-1), lowest


@pytest.fixture(scope="module")
def branch():
    return continue_through_folds(
        lambda f: struck(f=f), (0.055, 0.03), transient=60, step=0.2, max_orbits=8, parameter="f", progress=False
    )


def test_the_fold_is_where_the_closed_form_has_it(branch):
    value, speed = amplitude(None)
    fold = branch.table[branch.table["point"] == "fold"]
    assert len(fold) == 1
    assert fold["value"].item() == pytest.approx(value, rel=1e-9)
    assert fold["speed"].item() == pytest.approx(speed, rel=1e-5)
    assert fold["growth"].item() == pytest.approx(1.0, abs=1e-4)


def test_orbits_on_both_sides_of_the_fold_are_those_of_the_closed_form(branch):
    speeds = branch.table["speed"].to_numpy()
    np.testing.assert_allclose(branch.table["value"], amplitude(speeds)[0], rtol=1e-8)
    _, lowest = amplitude(None)
    assert (np.diff(speeds) < 0.0).all()
    assert (speeds > lowest).sum() >= 2
    assert (speeds < lowest - 1e-3).sum() >= 2
    stable = branch.table["stable"].to_numpy()
    assert stable[speeds > lowest + 1e-4].all(), "the faster impacts are stable"
    assert not stable[speeds < lowest - 1e-4].any()


def test_a_flip_is_located_on_the_way():
    """At ω = 2.6589 a multiplier passes -1; det M = e² exp(-2 ζ T) is that of one impact and one period."""
    branch = continue_through_folds(
        lambda omega: load_problem("shaw-holmes", omega=omega),
        (2.63, 2.7),
        transient=60,
        step=0.4,
        max_orbits=4,
        progress=False,
    )
    (k,) = np.flatnonzero(branch.table["point"] == "flip")
    multipliers = branch.orbits[k].floquet.real
    assert multipliers[0] == pytest.approx(-1.0, abs=1e-8)
    assert multipliers[1] == pytest.approx(-(E**2) * math.exp(-2.0 * ZETA * branch.orbits[k].T), abs=1e-8)
    assert branch.table["stable"].to_numpy()[:k].all()
    assert not branch.table["stable"].to_numpy()[k + 1 :].any()


def test_the_branch_is_a_study(branch):
    assert "fold" in branch.summary()
    assert "formulas of the scheme" in branch.derivatives
    assert branch.plot() is not None


@pytest.mark.parametrize("name", ["omega", "f"])
def test_the_derivative_of_the_period_map_by_the_parameter(name):
    """By ω the start and the end of the period move too."""
    base = {"omega": 2.6, "f": 0.06}[name]

    def family(value: float):
        return struck(**{name: value})

    first = find_orbit(family(base), None, 1, None, 60, 40)
    curve = Curve.of(family, first, {name: 0.5 * base})
    y = curve.unknowns(np.array([base]))
    y[0] += 0.01  # beside the orbit
    here = curve.at(y)
    found = here.derivative
    for j in range(3):
        h = 1e-5 * np.eye(3)[j]
        difference = (curve.at(y + h, here).miss - curve.at(y - h, here).miss) / 2e-5
        np.testing.assert_allclose(found[:, j], difference, rtol=1e-6, atol=1e-7)


def relay_feedback(a: float):
    """A relay that switches a plant 1/((s + a)(s + 1)²): it oscillates at a frequency of its own."""
    plant = [[-a, 1.0, 0.0], [0.0, -1.0, 1.0], [0.0, 0.0, -1.0]]
    relay = LinearComplementaritySystem(
        plant, [[0.0], [0.0], [-1.0]], [[-1.0, 0.0, 0.0]], lower=[-1.0], upper=[1.0], states=("x", "y", "z"),
        multipliers=("λ",),
    )  # fmt: skip
    return Problem("relay-feedback", relay, q0={"x": 0.5}, t_end=40.0)


def relay_period(a: float, near: float) -> float:
    """Return the period 2 h of x(h) = -x(0): C (I + exp(A h))⁻¹ A⁻¹ (exp(A h) - I) B = 0."""
    A, B = np.array([[-a, 1.0, 0.0], [0.0, -1.0, 1.0], [0.0, 0.0, -1.0]]), np.array([0.0, 0.0, -1.0])

    def miss(h):
        flow = expm(A * h)
        return np.linalg.solve(np.eye(3) + flow, np.linalg.solve(A, (flow - np.eye(3)) @ B))[0]

    return 2.0 * brentq(miss, 0.4 * near, 0.6 * near, xtol=1e-15)


def test_a_branch_finds_its_periods_without_a_force():
    branch = continue_through_folds(relay_feedback, (1.0, 2.0), transient=10, step=0.2, max_orbits=8, progress=False)
    assert not any(orbit.forced for orbit in branch.orbits)
    assert len(branch.orbits) >= 4
    assert branch.table["value"].iloc[-1] == pytest.approx(2.0, rel=1e-9)
    for value, T in zip(branch.table["value"], branch.table["T"], strict=True):
        assert pytest.approx(relay_period(value, T), rel=1e-10) == T
    assert branch.table["stable"].all()
    same = continue_orbit(relay_feedback, branch.table["value"], transient=10, progress=False)
    np.testing.assert_allclose(same.table["T"], branch.table["T"], rtol=1e-10)
    alone = periodic_orbit(relay_feedback(2.0), transient=10, progress=False)
    assert pytest.approx(branch.orbits[-1].T, rel=1e-9) == alone.T


@pytest.mark.parametrize(("name", "T"), [("bilinear-oscillator", 0.42), ("oscillator-stop", 0.3)])
def test_orbits_without_loss_are_followed_to_the_nearest(name, T):
    """Each stiffness has orbits of all energies: the branch goes along the stiffness and keeps the amplitude."""

    def family(k: float):
        return load_problem(name, k=k) if name == "bilinear-oscillator" else load_problem(name, k=k, e=1.0)

    branch = continue_through_folds(family, (100.0, 110.0), T=T, step=0.2, max_orbits=6, progress=False)
    for k, period in zip(branch.table["value"], branch.table["T"], strict=True):
        half = math.pi / math.sqrt(k)
        known = half + math.pi / math.sqrt(k + 800.0) if name == "bilinear-oscillator" else half
        assert period == pytest.approx(known, rel=1e-9)
    assert (np.diff(branch.table["value"]) > 0.1).all()
    np.testing.assert_allclose(branch.table["x"], branch.table["x"].iloc[0], rtol=0.01)


def test_the_result_says_by_which_parameters_matrices_are_differenced():
    """A family that turns its value into a float takes no formulas."""
    given = {"values": [2.6, 2.62], "transient": 60, "parameter": "ω", "progress": False}
    traced = continue_orbit(lambda omega: struck(omega=omega), **given)
    cut = continue_orbit(lambda omega: struck(omega=float(omega)), **given)
    assert traced.derivatives == "exact by the state; by ω, from the formulas of the scheme"
    assert cut.derivatives == "exact by the state; by ω, matrices are differenced"
    assert cut.orbits[1].speeds[0] == pytest.approx(traced.orbits[1].speeds[0], rel=1e-9)


def test_a_branch_that_ends_at_a_grazing_has_a_last_step():
    """Towards it each step is shorter than the one before."""
    branch = continue_through_folds(
        lambda f: load_problem("shaw-holmes", omega=0.8, s=1.0, x0=0.0, f=f), (0.3, 0.5), transient=20, progress=False
    )
    assert "the branch ends near 0.3687" in branch.ended
    assert len(branch.orbits) < 60


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"bracket": (1.0, 1.0)}, "no width"),
        ({"bracket": (1.0, math.inf)}, "bracket = inf"),
        ({"step": 0.0}, "step = 0.0"),
        ({"max_orbits": 0}, "max_orbits = 0"),
    ],
)
def test_bad_input_gets_one_sentence(given, words):
    with pytest.raises(InputError, match=words):
        continue_through_folds(**{"family": lambda f: struck(f=f), "bracket": (0.06, 0.05), "progress": False} | given)


def test_the_command_refuses_folds_without_a_parameter(capsys):
    with pytest.raises(SystemExit) as refused:
        main(["orbit", "shaw-holmes", "--folds"])
    assert refused.value.code == 2
    assert "--folds needs a parameter to continue along" in " ".join(capsys.readouterr().err.split())
