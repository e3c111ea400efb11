"""Derivatives of discrete runs: right where they are, wrong by the known limits where they are not, and refused by name."""

import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import lcpimpact as li
from lcpimpact.cli.main import main
from lcpimpact.errors import InputError
from lcpimpact.integrators import METHODS
from lcpimpact.study.accuracy.convergence import GradientConvergence

E = 0.8
BY_H = (1.0 + E) * (1.0 - 9.81 * (1.0 - math.sqrt(2.0 / 9.81)) / math.sqrt(2.0 * 9.81))
"""d x(1)/d H of the ball."""

LIMITS = dict.fromkeys(
    ("moreau-jean", "moreau-midpoint", "newmark-ns", "stormer-verlet-ns", "d1-minus", "cd-lagrange", "radau"), 0.0
)
LIMITS |= {"generalized-alpha": 1.0, "rattle-ns": 1.0, "schatzman-paoli": 1.0 + E}
"""What the derivatives by H of runs with a ball tend to, of the methods that do not move their impact."""


def ball(**parameters):
    return li.load_problem("bouncing-ball", **{"e": E} | parameters)


def measured(problem, methods, dts, gradient, **options):
    return li.convergence(problem, methods, dts, gradient=gradient, progress=False, **options)


@pytest.mark.parametrize("method", [name for name, each in METHODS.items() if 2 in each.declared.relative_degrees])
def test_each_method_has_its_limit_on_the_ball(method):
    study = measured(ball(), [method], [1 / 101, 1 / 401], ("x@1", "H"), t_end=1.0)
    assert study.gradient.truth == pytest.approx(BY_H, rel=1e-12)
    assert study["derivative"].to_numpy() == pytest.approx(LIMITS.get(method, BY_H), abs=1e-7)
    assert study["gradient"].to_numpy() == pytest.approx(abs(LIMITS.get(method, BY_H) - BY_H), abs=1e-7)
    said = study.summary().split("\n")[3]
    assert (f"tends to {LIMITS[method]:g}: wrong" if method in LIMITS else "right to ") in said


@pytest.mark.parametrize("method", ["moreau-jean", "generalized-alpha", "schatzman-paoli", "cd-lagrange"])
def test_derivatives_by_e_which_acts_in_the_law_converge_with_order_one(method):
    study = measured(ball(), [method], [0.03 / 1.6**i for i in range(8)], ("x@1", "e"), t_end=1.0)
    fall = math.sqrt(2.0 / 9.81)
    assert study.gradient.truth == pytest.approx(-math.sqrt(2.0 * 9.81) * (1.0 - fall), rel=1e-10)
    assert li.observed_orders(study)["order"].item() == pytest.approx(1.0, abs=0.2)
    assert "converges with order" in study.summary()


def two_balls():
    scheme = li.Scheme(li.Mass("x1", m=1.0), li.Mass("x2", m=1.0), li.Bumper("x1", "x2", gap=-0.2, e=1.0))
    return li.Problem("two-balls", scheme, q0={"x1": 0.0, "x2": 0.52}, v0={"x1": 1.0, "x2": 0.0}, t_end=1.0)


@pytest.mark.parametrize(
    ("method", "limit"),
    [
        ("moreau-jean", (0.0, 1.0, 0.68, 0.32)),
        ("rattle-ns", (0.5, 0.5, 0.84, 0.16)),
        ("schatzman-paoli", (1.0, 0.0, 1.0, 0.0)),
        ("rk4", (1.0, 0.0, 1.0, 0.0)),
    ],
)
def test_two_balls_exchange_their_velocities(method, limit):
    """The scene of nimblephysics #97."""
    for name, truth, tends in zip(("q0.x1", "q0.x2", "v0.x1", "v0.x2"), (1.0, 0.0, 1.0, 0.0), limit, strict=True):
        study = measured(two_balls(), [method], [1e-3], ("x2@1", name))
        assert study.gradient.truth == pytest.approx(truth, abs=1e-12)
        assert study["derivative"].item() == pytest.approx(tends, abs=2e-3)


def test_the_chapter_shows_every_method_that_takes_impacts():
    page = (Path(__file__).parents[2] / "docs" / "theory" / "11-derivatives.md").read_text(encoding="utf-8")
    shown = re.search(r'methods = """(.*?)"""', page, re.DOTALL)[1].split()
    assert shown == [name for name, each in METHODS.items() if 2 in each.declared.relative_degrees]


def test_two_balls_on_a_spring_are_wrong_by_nine_times():
    study = measured(
        li.load_problem("two-balls-spring"), ["moreau-jean"], [1 / 3307, 1 / 10007], ("x1@1", "k"), t_end=1.0
    )
    assert study.gradient.truth == pytest.approx(-1.12591885e-5, rel=1e-8)
    assert study["derivative"].to_numpy() / study.gradient.truth == pytest.approx(9.3, abs=0.5)
    values = li.convergence(study.problem, ["moreau-jean"], [1e-3, 1e-4], t_end=1.0, norms=["sup_q"], progress=False)
    assert values["sup_q"].iloc[1] < 0.2 * values["sup_q"].iloc[0], "the motion itself converges"


@pytest.mark.parametrize(
    ("name", "gradient", "method"),
    [
        ("system-2", ("x@3", "c_o"), "moreau-jean"),
        ("coulomb-oscillator", ("x@1", "F"), "moreau-jean"),
        ("coulomb-oscillator", ("x@1", "F"), "radau"),
    ],
)
def test_without_jumps_of_the_state_the_order_is_one(name, gradient, method):
    end = float(gradient[0].split("@")[1])
    study = measured(li.load_problem(name), [method], [0.02 / 2.0**i for i in range(9)], gradient, t_end=end)
    assert li.observed_orders(study)["order"].item() == pytest.approx(1.0, abs=0.35)


def test_a_method_that_smears_the_jump_of_a_force_is_wrong():
    study = measured(li.load_problem("system-1"), ["rk4-paper"], [3e-3, 1e-3], ("x@3", "c_o"), t_end=3.0)
    assert study["derivative"].to_numpy() / study.gradient.truth == pytest.approx(0.68, abs=0.02)
    assert "wrong" in study.summary()


def test_compliant_contacts_with_located_events_are_off_as_their_model_is():
    study = measured(
        ball(), ["event-driven"], [1e-2], ("x@1", "H"), t_end=1.0, penalties=[("kelvin-voigt", k) for k in (1e4, 1e6)]
    )
    soft, stiff = study.table.loc[study["law"] != "rigid", "gradient"]
    assert stiff / soft == pytest.approx(0.1, rel=0.03)
    assert study.summary().count("kelvin-voigt") == 2


def test_compliant_contacts_at_fixed_steps_are_the_worse_the_stiffer():
    study = measured(
        ball(), ["dopri5"], [1 / 2003], ("x@1", "H"), t_end=1.0, penalties=[("kelvin-voigt", k) for k in (1e4, 1e6)]
    )
    soft, stiff = study.table.loc[study["law"] != "rigid", "gradient"]
    assert soft > 10.0 * abs(BY_H)
    assert stiff / soft == pytest.approx(10.0, rel=0.2)


def test_the_derivative_is_that_of_differences_by_hand():
    study = measured(li.load_problem("system-1"), ["moreau-jean"], [0.01], ("R.max", "c_o"), t_end=0.4)
    dt = study["dt"].item()
    peaks = [
        li.simulate(li.load_problem("system-1", c_o=250.0 + d), dt=dt, t_end=0.4)["R"].max() for d in (1e-5, -1e-5)
    ]
    assert study["derivative"].item() == pytest.approx((peaks[0] - peaks[1]) / 2e-5, rel=1e-5)
    assert study.gradient.truth == pytest.approx(-2.845880978171018939, rel=1e-10)


def test_steps_that_follow_a_tolerance_are_differenced_more_widely():
    """event-driven takes other steps with other parameters, so that small differences are noise."""
    study = measured(li.load_problem("system-1"), ["event-driven"], [0.01], ("x@3", "c_o"), t_end=3.0)
    assert study["derivative"].item() == pytest.approx(-3.595882189779274228e-3, rel=1e-4)


def test_exact_is_judged_by_differences_of_another_method():
    study = measured(ball(), ["exact", "moreau-jean"], [1e-2], ("x@1", "H"), t_end=1.0)
    assert list(study["reference"]) == ["event-driven (rtol=1e-12) by differences", "exact with its saltation matrices"]
    assert study["gradient"].iloc[0] < 1e-7


def test_a_run_at_a_jump_has_no_derivative_and_says_so():
    scheme = li.Scheme(li.Mass("x", m=1.0), li.Bumper("x", "ground", gap=1.0, e=E))
    thrown = li.Problem("thrown", scheme, v0={"x": 2.0}, t_end=1.0)
    study = measured(thrown, ["moreau-jean", "generalized-alpha"], [1e-2], ("x@1", "R.gap"))
    failed, whole = study["failure"]
    assert "the run has no d x@1/d R.gap" in failed
    assert "take another dt" in failed
    assert math.isnan(study["derivative"].iloc[0])
    assert whole == ""


def test_at_the_end_of_a_domain_the_difference_is_one_sided():
    study = measured(ball(e=1.0), ["moreau-jean"], [1e-3], ("x@1", "e"), t_end=1.0)
    with pytest.raises(InputError):
        ball(e=1.0 + 1e-9)
    assert study["failure"].item() == ""
    assert study["derivative"].item() == pytest.approx(study.gradient.truth, rel=1e-2)


def test_an_output_that_the_run_does_not_have_is_a_failure_of_the_row():
    study = measured(ball(), ["moreau-jean"], [0.5, 1e-3], ("impact:3", "H"), t_end=1.9)
    assert "the run has no impact:3: take smaller steps" in study["failure"].iloc[0]
    assert study["failure"].iloc[1] == ""


@pytest.mark.parametrize(
    ("gradient", "says"),
    [
        (("x@1", "Hh"), "did you mean 'H'"),
        (("y@1", "H"), "did you mean 'x@1.0'"),
        (("x@9", "H"), "lies after the end of the run"),
        (("x", "H"), "is a curve"),
        (("impact:7", "H"), "is not in the run"),
        (("impacts", "H"), "'impacts'"),
        ("x@1", "must be a sequence"),
        (("x@1",), "must name an output and a parameter"),
    ],
)
def test_wrong_input_is_named(gradient, says):
    with pytest.raises(InputError, match=says.replace("(", r"\(")):
        measured(ball(), ["moreau-jean"], [0.1], gradient, t_end=1.0)


def test_norms_and_references_of_motions_are_refused():
    for options in ({"norms": ["sup_q"]}, {"reference": li.simulate(ball(), "exact", dt=0.1, t_end=1.0)}):
        with pytest.raises(InputError, match="leave out norms and reference"):
            measured(ball(), ["moreau-jean"], [0.1], ("x@1", "H"), t_end=1.0, **options)


def test_a_non_linear_problem_is_judged_by_event_driven():
    hertz = li.load_problem("hertz-impact")
    steps = [hertz.t_end / 200, hertz.t_end / 800]
    study = measured(hertz, ["moreau-jean"], steps, (f"x@{hertz.t_end / 2:g}", "m"))
    assert study["gradient"].iloc[1] < 0.5 * study["gradient"].iloc[0]
    assert study["gradient"].iloc[1] < 1e-2 * abs(study.gradient.truth)


def made(derivatives, truth=1.0, noise=1e-9):
    """Return a study of these derivatives with steps that are halved."""
    known = measured(ball(), ["moreau-jean"], [0.1], ("x@1", "H"), t_end=1.0)
    rows = pd.concat([known.table] * len(derivatives), ignore_index=True)
    rows["dt"] = [0.1 / 2**i for i in range(len(derivatives))]
    rows["derivative"], rows["noise"], rows["failure"] = derivatives, noise, ""
    rows["gradient"] = np.abs(rows["derivative"] - truth)
    return replace(known, table=rows, gradient=replace(known.gradient, truth=truth))


def test_what_the_derivatives_do_is_said():
    assert "right to 1e-08" in made([1.0, 1.0 + 1e-8]).summary()
    assert "tends to 3: wrong" in made([2.0, 2.9, 3.01, 3.0]).summary()
    assert "converges with order 1.00" in made([1.4, 1.2, 1.1, 1.05]).summary()
    assert "no limit to be seen" in made([1.1, 3.0, -2.0, 4.0]).summary()
    assert "2 with one step" in made([2.0]).summary()
    below = made([1.4, 1.2, 1.1, 1.05], noise=0.3)
    assert li.observed_orders(below)["rounding"].item() == 3, "what noise leaves open tells no order"


def test_the_study_is_drawn_and_written(tmp_path):
    study = measured(ball(), ["moreau-jean", "event-driven"], [0.1, 0.05], ("x@1", "H"), t_end=1.0)
    assert isinstance(study, GradientConvergence)
    axes = study.plot(tmp_path / "out.png").axes[0]
    assert axes.get_title(loc="left") + axes.get_title() == "bouncing-ball: error of d x@1/d H"
    assert "m per m" in axes.get_ylabel()
    page = study.report(tmp_path / "out.html").read_text(encoding="utf-8")
    assert "Convergence of d x@1/d H of bouncing-ball" in page
    with pytest.raises(InputError, match="norm of this table"):
        study.plot(norm="sup_q")


def told(capsys, *words):
    with pytest.raises(SystemExit) as stop:
        main(["converge", "bouncing-ball", "--set", "e=0.8", "--t-end", "1", "--methods", "moreau-jean", *words])
    captured = capsys.readouterr()
    return stop.value.code or 0, captured.out, captured.err


def test_the_command_says_where_derivatives_tend(capsys, tmp_path):
    out = tmp_path / "out.csv"
    code, said, _ = told(capsys, "--counts", "50,100", "--gradient", "x@1", "H", "--out", str(out))
    assert code == 0
    assert "d x@1/d H = -0.386502 m per m on bouncing-ball" in said
    assert "tends to 0: wrong" in said
    assert pd.read_csv(out)["derivative"].to_numpy() == pytest.approx([0.0, 0.0], abs=1e-7)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--gradient"], "unknown number of problem"),
        (["--gradient", "x@1", "Hh"], "did you mean 'H'"),
        (["--gradient", "x@1", "H", "--norm", "sup_q"], "leave out --norm"),
    ],
)
def test_wrong_words_are_one_line_and_nothing_is_written(capsys, tmp_path, words, says):
    out = tmp_path / "out.csv"
    code, _, said = told(capsys, *words, "--out", str(out))
    assert code == 2
    assert says in said
    assert said.count("\n") == 1
    assert not out.exists()
