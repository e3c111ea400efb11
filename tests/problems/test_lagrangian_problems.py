"""Registered Lagrangian systems: their mass matrices, their starts, their facts in runs, and where they have no picture.

Their facts against computations by hand are among the tests of all problems, in test_problems.py.
"""

import lagrangian_names
import numpy as np
import pytest

import lcpimpact as li
from lcpimpact.cli.main import main
from lcpimpact.plotting.schematic import draw_scheme
from lcpimpact.problems import PROBLEMS, load_problem
from lcpimpact.problems.parameters import is_registered

LAGRANGIAN = [name for name in PROBLEMS if isinstance(load_problem(name).scheme, li.Lagrangian)]

CHANCE = {"painleve-jam": {"ω_j", "P_N"}}
"""Facts of a point where flight and jam are both solutions, so that a step method finds either."""


def run(name, steps):
    problem = load_problem(name)
    return li.simulate(problem, "moreau-jean", dt=problem.t_end / steps, t_end=problem.t_end, throw=False, error=False)


def test_there_are_all_kinds_of_them():
    rows = {each.law.name for name in LAGRANGIAN for each in load_problem(name).dynamics.contacts}
    assert len(LAGRANGIAN) == 25
    assert len(rows) == 3, "contacts, friction and joints"


@pytest.mark.parametrize("name", LAGRANGIAN)
def test_m_is_symmetric_and_positive_along_the_motion(name):
    found = run(name, 100)
    M = found.problem.dynamics.forces_at(found.t, found.q, found.v).M
    assert np.abs(M - np.swapaxes(M, -1, -2)).max() <= 1e-15 * np.abs(M).max()
    assert np.linalg.eigvalsh(M).min() > 0.0


@pytest.mark.parametrize("name", LAGRANGIAN)
def test_the_start_satisfies_gaps_and_joints(name):
    problem = load_problem(name)
    d = problem.dynamics
    rows = d.rows(0.0, problem.initial_coordinates, problem.initial_velocities)
    size = 1e-14 * max(1.0, np.abs(problem.initial_coordinates).max())
    assert (rows.g[d.impenetrable] >= -size).all()
    assert np.abs(rows.g[d.bilateral]).max(initial=0.0) <= size
    speeds = 1e-14 * max(1.0, np.abs(problem.initial_velocities).max())
    assert np.abs(rows.rates(problem.initial_velocities)[d.bilateral]).max(initial=0.0) <= speeds


@pytest.mark.parametrize("name", LAGRANGIAN)
def test_event_driven_meets_the_facts(name):
    problem = load_problem(name)
    found = li.simulate(
        problem, "event-driven", dt=problem.t_end / 100, t_end=problem.t_end, rtol=1e-12, throw=False, error=False
    )
    for fact in problem.facts:
        assert fact.error(found) <= max(fact.accuracy, 1e-8), fact


@pytest.mark.parametrize(("omega0", "rolls"), [(50.0, False), (10.0, True)])
def test_balls_of_capobianco_et_al_slide_and_roll(omega0, rolls):
    """Section 10.1 of their paper: m = 1, R = 0.1, μ = 0.2, e = 0, let fall from y = 1."""
    problem = load_problem("ball-with-spin", v_y=(2.0 * 9.81 * 0.9) ** 0.5, e=0.0, omega0=omega0)
    found = li.simulate(problem, "event-driven", dt=problem.t_end / 100, rtol=1e-12, error=False)
    assert found["y"][0] == pytest.approx(1.0, rel=1e-15)
    for fact in problem.facts:
        assert fact.error(found) <= 1e-9, fact
    right = next(each for each in found.events if each.kind == "impact" and each.contact == "N").right.v
    assert (abs(right[0] + 0.1 * right[2]) < 1e-9) == rolls


@pytest.mark.parametrize("name", LAGRANGIAN)
def test_moreau_jean_approaches_the_facts(name):
    found = run(name, 1200)
    known = [fact for fact in found.problem.facts if fact.symbol not in CHANCE.get(name, ())]
    errors = {fact.symbol: fact.error(found) for fact in known}
    assert max(errors.values()) <= 0.03, errors


@pytest.mark.parametrize(
    ("bodies", "linear"),
    [("ball-with-spin", "spinning-ball"), ("rolling-disc", "rolling-sphere"), ("woodpecker-bodies", "woodpecker")],
)
def test_bodies_move_as_their_linear_schemes(bodies, linear):
    a = run(bodies, 400)
    parameters = {name: value for name, value in a.problem.parameters.items() if name != "name"}
    problem = load_problem(linear, **parameters)
    b = li.simulate(problem, "moreau-jean", dt=a.problem.t_end / 400, t_end=a.problem.t_end)
    for i, node in enumerate(a.problem.dynamics.nodes):
        # Heights are upwards there, and from another level.
        sign, start = (1.0, 0.0) if linear == "woodpecker" or node != "y" else (-1.0, a.q[0, i])
        ours, theirs = sign * (a.q[:, i] - start), b.q[:, problem.dynamics.nodes.index(node)]
        assert np.abs(ours - theirs).max() <= 1e-9 * max(1.0, np.abs(theirs).max()), node


@pytest.mark.parametrize("name", LAGRANGIAN)
def test_it_is_registered_equal_to_itself_alone(name):
    problem = load_problem(name)
    assert is_registered(problem)
    other = load_problem(name, **{"g": 9.0} if "g" in problem.parameters else {"m": 2.0})
    assert other.scheme != problem.scheme
    assert hash(load_problem(name).scheme) == hash(problem.scheme)


def test_it_is_listed_and_has_no_drawing(capsys, tmp_path):
    with pytest.raises(li.InputError, match="a Lagrangian system has no drawing: it is given by functions"):
        draw_scheme(load_problem("rod-on-pin").scheme)
    for words, code, text in (
        (["list", "problems", "rod-on-pin"], 0, "three coordinates and two joints"),
        (["draw", "rod-on-pin", "--out", str(tmp_path / "rod.png")], 2, "has no drawing"),
    ):
        with pytest.raises(SystemExit) as end:
            main(words)
        shown = capsys.readouterr()
        assert end.value.code == code
        assert text in " ".join((shown.out + shown.err).split())
    assert not (tmp_path / "rod.png").exists()


def test_names_of_all_lagrangian_problems_are_listed():
    assert list(lagrangian_names.LAGRANGIAN) == LAGRANGIAN


def test_gaps_of_angles_are_lengths_and_their_reactions_forces():
    problem = load_problem("double-pendulum-stop")
    assert [problem.unit(name) for name in ("φ_1", "v_φ_1", "N")] == ["rad", "rad/s", "N"]
    study = li.convergence(problem, ["moreau-jean"], [2e-3, 1e-3], t_end=0.05, progress=False)
    units = [study.norms[name].unit_in(problem) for name in ("sup_q", "l2_v", "penetration", "impulses")]
    assert units == ["rad", "rad/s^(1/2)", "m", "N s"]
