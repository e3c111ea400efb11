"""Curves of folds, flips and grazings against closed forms of orbits, solved here by scipy."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import brentq, root

import lcpimpact as li
from lcpimpact.cli.main import main

ZETA = 0.05


def struck(**given):
    return li.load_problem("shaw-holmes", **{"zeta": ZETA, "e": 0.8, **given})


def curve(family, *given, **options):
    return li.bifurcation_curve(family, *given, **{"progress": False, **options})


def orbit(speed: float, omega: float, e: float, s: float) -> tuple[float, float]:
    """Return the amplitude of the force and the trace of the map of an orbit that strikes once a period at a speed.

    x = exp(-ζ t) (C1 cos ω_d t + C2 sin ω_d t) + a cos ω t - b sin ω t, x(0) = x(T) = s, x'(0) = -e V, x'(T) = V.
    """
    T, ω_d = 2.0 * math.pi / omega, math.sqrt(1.0 - ZETA**2)
    c, d, decay = math.cos(ω_d * T), math.sin(ω_d * T), math.exp(-ZETA * T)
    rows = [
        [1.0, 0.0, 1.0, 0.0],
        [decay * c, decay * d, 1.0, 0.0],
        [-ZETA, ω_d, 0.0, -omega],
        [decay * (-ZETA * c - ω_d * d), decay * (-ZETA * d + ω_d * c), 0.0, -omega],
    ]
    _, _, a, b = np.linalg.solve(rows, [s, s, -e * speed, speed])
    force = (1.0 - omega**2) * a - 2.0 * ZETA * omega * b
    before, after = (force - s - 2.0 * ZETA * v for v in (speed, -e * speed))
    jump = np.array([[-e, 0.0], [(after + e * before) / speed, -e]])
    flow = expm(np.array([[0.0, 1.0], [-1.0, -2.0 * ZETA]]) * T)
    return math.hypot(1.0 - omega**2, 2.0 * ZETA * omega) * math.hypot(a, b), float(np.trace(flow @ jump))


def fold_at(omega: float, near: float) -> tuple[float, float]:
    """Return the speed and the force of the fold of the pressed oscillator: 1 - tr M + det M = 0, det M = e² exp(-2 ζ T)."""
    det = 0.64 * math.exp(-4.0 * math.pi * ZETA / omega)
    speed = brentq(lambda v: 1.0 - orbit(v, omega, 0.8, -0.05)[1] + det, 0.8 * near, 1.2 * near, xtol=1e-15)
    return speed, orbit(speed, omega, 0.8, -0.05)[0]


def flip_at(e: float, speed: float = 0.44, omega: float = 2.65) -> tuple[float, float]:
    """Return the speed and the frequency of the flip of the oscillator with f = 1 and its stop at rest's place."""

    def miss(unknowns):
        amplitude, trace = orbit(*unknowns, e, 0.0)
        return amplitude - 1.0, 1.0 + trace + e**2 * math.exp(-4.0 * math.pi * ZETA / unknowns[1])

    return tuple(root(miss, [speed, omega], tol=1e-14).x)


@pytest.fixture(scope="module")
def folds():
    return curve(
        lambda f, omega: struck(f=f, omega=omega, s=-0.05), (0.055, 0.02), (2.6, 2.9), "fold", parameters=("f", "omega"),
        transient=60,
    )  # fmt: skip


def test_folds_are_where_the_closed_form_has_them(folds):
    table = folds.table
    assert len(table) >= 5
    assert table["omega"].iloc[[0, -1]].tolist() == pytest.approx([2.6, 2.9], abs=1e-9)
    for row in table.itertuples():
        speed, f = fold_at(row.omega, row.speed)
        assert row.f == pytest.approx(f, rel=1e-8)
        assert row.speed == pytest.approx(speed, rel=1e-6)
        assert row.T * row.omega == pytest.approx(2.0 * math.pi, rel=1e-12)
        assert row.real_1 == pytest.approx(0.64 * math.exp(-2.0 * ZETA * row.T), rel=1e-6)
        assert (row.imaginary_1, row.events, row.point) == (0.0, "impact R", "")


def test_a_curve_says_why_it_ends_and_which_derivatives_it_has(folds):
    assert folds.ended.startswith("the curve leaves the box at f = 0.0369")
    assert "by f and omega, from the formulas" in folds.derivatives
    assert "condition of the fold are differences" in folds.derivatives
    assert "curve of folds in the plane of f and omega" in folds.summary()
    assert folds.ended in folds.summary()
    assert not folds.failures.size


def test_flips_are_where_the_closed_form_has_them():
    found = curve(
        lambda omega, e: struck(omega=omega, e=e),
        (2.63, 2.9),
        (0.8, 0.6),
        "flip",
        parameters=("omega", "e"),
        transient=60,
    )
    assert len(found.table) >= 5
    for row in found.table.itertuples():
        speed, omega = flip_at(row.e)
        assert (row.omega, row.speed) == (pytest.approx(omega, rel=1e-8), pytest.approx(speed, rel=1e-8))
        assert row.real_1 == pytest.approx(-(row.e**2) * math.exp(-2.0 * ZETA * row.T), rel=1e-7)


def test_grazings_are_where_the_amplitude_is_the_gap():
    found = curve(
        lambda f, omega: struck(f=f, omega=omega, s=1.0), (0.2, 1.0), (0.7, 1.4), "grazing", parameters=("f", "omega"),
        transient=20, max_points=100,
    )  # fmt: skip
    f, omega = found.table["f"], found.table["omega"]
    np.testing.assert_allclose(f, np.hypot(1.0 - omega**2, 2.0 * ZETA * omega), rtol=1e-9)
    np.testing.assert_allclose(found.table["gap"], 0.0, atol=1e-10)
    np.testing.assert_allclose(
        np.hypot(found.table["real_1"], found.table["imaginary_1"]), np.exp(-ZETA * found.table["T"])
    )
    assert found.ended.startswith("the curve leaves the box at f = 0.2")


def test_a_curve_on_which_the_second_parameter_changes_nothing_is_a_line():
    """With the stop at rest's place the motion scales with the force; so the flip has one frequency."""
    found = curve(lambda omega, f: struck(omega=omega, f=f), (2.63, 2.7), (1.0, 3.0), "flip", transient=60)
    np.testing.assert_allclose(found.table["p"], flip_at(0.8)[1], rtol=1e-8)
    assert found.table["s"].iloc[-1] == pytest.approx(3.0)
    unused = curve(lambda omega, _: struck(omega=omega), (2.63, 2.7), (0.0, 1e6), "flip", transient=60)
    np.testing.assert_allclose(unused.table["p"], found.table["p"].iloc[0], rtol=1e-9)


def test_a_sum_of_both_parameters_is_constant_along_its_curve():
    found = curve(lambda p, s: struck(omega=p + s), (2.6, 2.75), (0.0, -0.05), "flip", transient=60)
    np.testing.assert_allclose(found.table.eval("p + s"), flip_at(0.8)[1], rtol=1e-8)


def test_sizes_of_parameters_do_not_matter():
    """The force in units of 1e-6 and the frequency in units of 1e6."""
    units = curve(
        lambda f, omega: struck(f=f * 1e-6, omega=omega * 1e6, s=-0.05), (55000.0, 20000.0), (2.6e-6, 2.7e-6), "fold",
        transient=60, max_points=4,
    )  # fmt: skip
    for row in units.table.itertuples():
        assert row.p == pytest.approx(1e6 * fold_at(row.s * 1e6, row.speed)[1], rel=1e-8)


def two_struck(f: float, omega: float):
    """Two oscillators side by side that the same force drives: one has the fold, the other one the flip."""
    first, second = (
        [
            li.Mass(x, 1.0),
            li.KelvinVoigt(x, "ground", k=1.0, c=2.0 * ZETA),
            li.Bumper(x, "ground", gap=gap, e=e, name=R),
        ]
        for x, R, gap, e in (("x", "R1", -0.05, 0.8), ("y", "R2", 0.0, 0.8))
    )
    loads = [li.Load("x", li.Harmonic(f, omega)), li.Load("y", li.Harmonic(1.0, omega))]
    start = {"x": -0.3, "y": -0.6}
    return li.Problem("two", li.Scheme(*first, *second, *loads), q0=start, t_end=20.0)


@pytest.mark.slow
def test_a_fold_meets_a_flip():
    """The curve of folds of the first oscillator goes on where the second one has its flip, at a frequency of its own."""
    found = curve(two_struck, (0.055, 0.02), (2.6, 2.75), "fold", parameters=("f", "omega"), transient=60)
    (k,) = np.flatnonzero(found.table["point"] == "flip")
    assert found.table["omega"][k] == pytest.approx(flip_at(0.8)[1], rel=1e-8)
    assert 2 <= k < len(found.table) - 2
    for row in found.table.itertuples():
        assert row.f == pytest.approx(fold_at(row.omega, 0.14)[1], rel=1e-8)


def pressed(omega: float, f: float):
    """A forced oscillator that another spring stops softly: it bends its resonance."""
    scheme = li.Scheme(
        li.Mass("x", 1.0), li.KelvinVoigt("x", "ground", k=1.0, c=2.0 * ZETA), li.Bumper("x", "z", gap=1.0),
        li.Spring("z", "ground", 3.0), li.Load("x", li.Harmonic(f, omega)),
    )  # fmt: skip
    return li.Problem("pressed", scheme, t_end=10.0)


@pytest.mark.slow
def test_a_curve_of_folds_turns_at_a_cusp_and_comes_back_on_the_other_fold():
    found = curve(pressed, (0.99, 1.1), (0.12, 0.05), "fold", parameters=("omega", "f"), transient=40)
    branch = li.continue_through_folds(lambda omega: pressed(omega, 0.12), (0.99, 1.1), transient=40, progress=False)
    high, low = branch.table.loc[branch.table["point"] == "fold", "value"]
    assert found.table["omega"].iloc[[0, -1]].tolist() == pytest.approx([high, low], rel=1e-8)
    (k,) = np.flatnonzero(found.table["point"] == "cusp")
    cusp = found.table.iloc[k]
    assert cusp["f"] == pytest.approx(found.table["f"].min(), rel=1e-9)
    for f, folds in ((cusp["f"] * 1.02, 2), (cusp["f"] * 0.98, 0)):
        beside = li.continue_through_folds(
            lambda omega, f=f: pressed(omega, f), (0.99, 1.05), transient=40, progress=False
        )
        assert (beside.table["point"] == "fold").sum() == folds


@pytest.mark.slow
def test_runs_have_the_periods_that_the_curve_of_flips_says():
    found = curve(
        lambda omega, e: struck(omega=omega, e=e),
        (2.63, 2.9),
        (0.8, 0.6),
        "flip",
        parameters=("omega", "e"),
        transient=60,
    )
    for row in found.table.iloc[[0, 3, -1]].itertuples():
        for side, periods in ((-0.01, 1), (0.01, 2)):
            diagram = li.bifurcation(
                lambda omega, e=row.e: struck(omega=omega, e=e), [row.omega + side], skip=600, points=16, progress=False
            )
            assert diagram.table["period"].iloc[0] == periods


@pytest.mark.slow
def test_runs_lose_the_orbit_beyond_the_curve_of_folds(folds):
    """Below the force of the fold no run strikes once a period."""
    for row in folds.table.iloc[[0, len(folds.table) // 2]].itertuples():
        start = folds.orbits[row.Index].sample(0.0)
        for factor, strikes in ((1.02, True), (0.98, False)):
            problem = struck(
                f=factor * row.f, omega=row.omega, s=-0.05, x0=float(start.q[0, 0]), v0=float(start.v[0, 0])
            )
            speeds = li.poincare(problem, "force", skip=400, points=20, progress=False).table
            at = speeds[["x", "v_x"]].to_numpy()
            assert np.abs(at - at[0]).max() < 1e-6
            assert (at[0, 1] > 0.5 * row.v_x) == strikes, "else it lies at its stop"


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"first": (1.0, 1.0)}, r"first = \(1.0, 1.0\) has no width"),
        ({"second": (1.0, math.nan)}, "second = nan"),
        ({"kind": "hopf"}, "kind = 'hopf' must be one of 'fold', 'flip', 'grazing'"),
        ({"contact": "R"}, "contact = 'R' is of curves of grazings"),
        ({"kind": "grazing", "contact": "S"}, "contact 'S'"),
        ({"parameters": ("f", "f")}, "two names that differ"),
        ({"step": 0.0}, "step = 0.0"),
        ({"max_points": 0}, "max_points = 0"),
    ],
)
def test_bad_input_gets_one_sentence(given, words):
    standard = {"first": (0.06, 0.05), "second": (2.6, 2.7), "kind": "fold"}
    with pytest.raises(li.InputError, match=words):
        curve(lambda f, omega: struck(f=f, omega=omega), **{**standard, **given})


def test_without_a_bifurcation_on_the_way_there_is_no_curve():
    with pytest.raises(li.FailureError, match=r"the orbit has no flip along omega from 2.5 to 2.52; give other values"):
        curve(
            lambda omega, e: struck(omega=omega, e=e), (2.5, 2.52), (0.8, 0.7), "flip", parameters=("omega", "e"),
            transient=60,
        )  # fmt: skip


def test_the_command_draws_and_writes_a_curve(tmp_path, capsys):
    out = tmp_path / "curve.csv"
    with pytest.raises(SystemExit) as ended:
        main(
            ["orbit", "shaw-holmes", "--over", "omega=2.63:2.7:3", "--over", "e=0.8:0.75:3", "--curve", "flip",
             "--transient", "60", "--out", str(out), "--plot", str(tmp_path / "curve.svg")]
        )  # fmt: skip
    assert ended.value.code == 0
    assert "curve of flips in the plane of omega and e" in capsys.readouterr().out
    assert out.read_text(encoding="utf-8").startswith("omega,e,T,x,v_x,")
    assert (tmp_path / "curve.svg").stat().st_size > 1000


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (["--curve", "flip"], "--over names 0 parameters: a curve needs two"),
        (["--curve", "flip", "--over", "omega=2.6:2.7:3"], "--over names 1 parameters: a curve needs two"),
        (
            ["--curve", "flip", "--folds", "--over", "omega=2.6:2.7:3", "--over", "e=0.8:0.7:3"],
            "give one of the two options",
        ),
        (["--contact", "R", "--over", "omega=2.6:2.7:3"], "--contact R is of --curve grazing"),
    ],
)
def test_the_command_refuses_in_one_sentence(given, words, capsys):
    with pytest.raises(SystemExit) as refused:
        main(["orbit", "shaw-holmes", *given])
    assert refused.value.code == 2
    assert words in " ".join(capsys.readouterr().err.split())
