"""Standard deviations of outputs from those of parameters: closed forms, Monte Carlo by sweeps, and what is refused."""

import math

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose
from scipy.stats import t as student

import lcpimpact as li
from lcpimpact.cli.main import main

G, H, E = 9.81, 1.0, 0.8
OUTPUTS = ["impact:2", "impact:2.speed", "x@1"]


def ball(wrt=("H", "e")):
    return li.sensitivity(li.load_problem("bouncing-ball", e=E), list(wrt), OUTPUTS, t_end=1.2)


def by_hand(height, e):
    """The instant of the second impact, its speed, and x(1) after the first, which counts downwards from the start."""
    T, v = np.sqrt(2.0 * height / G), np.sqrt(2.0 * G * height)
    s = 1.0 - T
    return np.array([(1.0 + 2.0 * e) * T, e * v, height - e * v * s + 0.5 * G * s**2])


def test_standard_deviations_are_those_of_a_hundred_thousand_closed_motions():
    """Correlated deviations of 0.2 %, within which the outputs are straight: Monte Carlo errs by 0.3 %."""
    covariance = np.array([[2e-3**2, 0.7 * 2e-3 * 1.5e-3], [0.7 * 2e-3 * 1.5e-3, 1.5e-3**2]])
    found = ball().uncertainty(pd.DataFrame(covariance, index=["H", "e"], columns=["H", "e"]))
    height, e = np.random.default_rng(0).multivariate_normal([H, E], covariance, 100_000).T
    sampled = np.cov(by_hand(height, e))
    assert_allclose(found.table["deviation"], np.sqrt(np.diag(sampled)), rtol=0.01)
    scale = np.sqrt(np.outer(np.diag(sampled), np.diag(sampled)))
    assert_allclose(found.covariance.to_numpy() / scale, sampled / scale, atol=0.01)
    assert found.covariance.index.tolist() == OUTPUTS


def test_the_parts_of_independent_parameters_add_up_as_squares():
    derivatives = ball()
    found = derivatives.uncertainty({"e": 0.01, "H": 0.02})
    assert_allclose(found.table["H"], 0.02 * derivatives.table["H"], rtol=1e-14)
    assert_allclose(found.table["deviation"], np.hypot(found.table["H"], found.table["e"]), rtol=1e-14)
    assert found.deviations == pytest.approx({"H": 0.02, "e": 0.01})
    # A parameter that is not named is known.
    alone = derivatives.uncertainty({"e": 0.01})
    assert_allclose(alone.table["deviation"], np.abs(found.table["e"]), rtol=1e-14)
    assert found.summary().startswith(
        "Uncertainty of bouncing-ball by exact, to first order: H = 1 ± 0.02, e = 0.8 ± 0.01"
    )


def test_samples_have_the_covariance_and_a_sweep_of_them_the_deviations():
    covariance = pd.DataFrame([[4e-4, -2e-4], [-2e-4, 4e-4]], index=["e", "H"], columns=["e", "H"])
    found = ball().uncertainty(covariance)
    drawn = found.samples(20_000, seed=3).table
    assert_allclose(drawn.cov().loc[["e", "H"], ["e", "H"]], covariance, rtol=0.05)
    assert_allclose(drawn.mean(), [H, E], atol=1e-3)
    assert found.samples(5, seed=3).table.equals(found.samples(5, seed=3).table)
    problem = li.load_problem("bouncing-ball", e=E)
    runs = li.sweep(problem, found.samples(60), "exact", dt=0.1, t_end=1.5, outputs=["impact:2", "x@1"], progress=False)
    with pytest.raises(li.InputError, match=r"unknown output 'impact:2.speed'.*outputs="):
        found.compared(runs)
    part = li.sensitivity(problem, ["H", "e"], ["impact:2", "x@1"], t_end=1.5).uncertainty(covariance)
    beside = part.compared(runs)
    assert (np.abs(beside["sampled"] - beside["deviation"]) < 4.0 * beside["standard_error"]).all()
    assert beside["results"].tolist() == [60, 60]
    assert_allclose(beside["standard_error"], beside["sampled"] / math.sqrt(118.0), rtol=1e-12)


@pytest.mark.slow
def test_the_uncertainty_of_system_1_is_that_of_a_sweep():
    """Deviations of 1 %, across two contacts and a jump of the force."""
    problem, outputs = li.load_problem("system-1"), ["R.max", "open:1", "close:1", "x@2.0"]
    found = li.sensitivity(problem, ["k_o", "c_o", "h_o"], outputs, t_end=3.0)
    sure = found.uncertainty({"k_o": 39.0, "c_o": 2.5, "h_o": 0.05})
    runs = li.sweep(problem, sure.samples(1000, seed=1), "exact", dt=0.1, t_end=3.0, outputs=outputs, progress=False)
    beside = sure.compared(runs)
    assert (np.abs(beside["sampled"] - beside["deviation"]) < 4.0 * beside["standard_error"]).all(), beside


def test_what_a_fit_does_not_know_is_carried_on():
    truth = li.simulate(li.load_problem("bouncing-ball", e=E), "exact", dt=0.05, t_end=1.0, error=False)
    data = pd.DataFrame({"t": truth.t, "x": truth["x"] + np.random.default_rng(1).normal(0.0, 0.01, len(truth.t))})
    fitted = li.fit(li.load_problem("bouncing-ball"), {"H": 1.02, "e": 0.75}, data)
    carried = li.sensitivity(fitted.problem, ["H", "e"], ["x@0.9"], t_end=1.0).uncertainty(fitted.covariance)
    rows = fitted.band[np.isclose(fitted.band["t"], 0.9)]
    half = float((rows["high"] - rows["fitted"]).iloc[0])
    assert carried.table["deviation"][0] == pytest.approx(half / student.ppf(0.975, fitted.freedom), rel=1e-3)


@pytest.mark.parametrize(
    ("deviations", "says"),
    [
        ({}, "no parameter is uncertain"),
        ({"g": 0.1}, "unknown parameter of the derivatives 'g'"),
        ({"H": -0.1}, "the standard deviation of H = -0.1 must be a finite number, at least 0"),
        ({"H": math.nan}, "the standard deviation of H = nan"),
        (pd.DataFrame([[1.0]], index=["H"], columns=["e"]), "same names as index and columns"),
        (pd.DataFrame([[1.0, 2.0], [2.0, 1.0]], index=["H", "e"], columns=["H", "e"]), "negative eigenvalues"),
        (pd.DataFrame([[1.0, 0.5], [0.0, 1.0]], index=["H", "e"], columns=["H", "e"]), "symmetric"),
        (pd.DataFrame([[math.nan]], index=["H"], columns=["H"]), "finite"),
        (3.0, "deviations = 3.0 must be"),
    ],
)
def test_what_is_no_uncertainty_is_refused(deviations, says):
    with pytest.raises(li.InputError, match=says):
        ball().uncertainty(deviations)


def test_the_command(capsys, tmp_path):
    table, picture = tmp_path / "table.csv", tmp_path / "tornado.svg"
    named = [
        "sensitivity",
        "bouncing-ball",
        "--wrt",
        "H,e",
        "--outputs",
        "impact:2,x@1",
        "--t-end",
        "1.2",
        "--set",
        "e=0.8",
    ]
    with pytest.raises(SystemExit) as end:
        main([*named, "--deviations", "H=0.02,e=0.01", "--out", str(table), "--plot", str(picture)])
    assert end.value.code == 0
    assert "to first order" in capsys.readouterr().out
    written = pd.read_csv(table)
    assert_allclose(
        written["deviation"], ball().uncertainty({"H": 0.02, "e": 0.01}).table["deviation"][[0, 2]], rtol=1e-12
    )
    assert picture.stat().st_size > 100
    for wrong in ("H", "H=a", "g=1", "H=-1"):
        with pytest.raises(SystemExit) as end:
            main([*named, "--deviations", wrong])
        assert end.value.code == 2
        assert capsys.readouterr().err.count("\n") == 1
