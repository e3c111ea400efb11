"""Static friction above the kinetic one: what sticks holds up to μ_s r_N, what slides has μ r_N until its slip is zero."""

import math

import numpy as np
import pytest

import lcpimpact as li
from lcpimpact import (
    Bumper,
    Friction,
    Harmonic,
    InputError,
    Load,
    Mass,
    Polynomial,
    PrescribedMotion,
    Problem,
    Ramp,
    Scheme,
    Spring,
    simulate,
)
from lcpimpact.integrators import METHODS
from lcpimpact.scheme.structure import Feature

LOCATING = ("exact", "event-driven")
ABLE = sorted(name for name, kind in METHODS.items() if Feature.STATIC_FRICTION in kind.declared.handles)
STEPS = [name for name in ABLE if name not in LOCATING]


def block(force, *, mu=0.3, mu_s=0.5, normal=20.0, m=2.0, v0=0.0, q0=0.0):
    """A block on the floor, pressed by a normal load and pushed along the floor."""
    scheme = Scheme(
        Mass("x", m),
        Mass("y", m),
        Load("x", force),
        Load("y", normal),
        Bumper("y", "ground", e=0.0, name="N"),
        Friction("x", "ground", mu, normal="N", mu_s=mu_s),
    )
    return Problem("block", scheme, q0={"x": q0}, v0={"x": v0})


def kinds(run):
    return [(event.kind, event.contact) for event in run.events]


def blocks_on_a_belt(seed, n=3, v_b=0.1):
    """Blocks in a row, joined by springs to each other and to the ground, on one belt."""
    rng = np.random.default_rng(seed)
    elements = [PrescribedMotion("b", Polynomial((0.0, v_b)))]
    for i in range(n):
        m, mu, k = (float(rng.uniform(*each)) for each in ((0.5, 2.0), (0.1, 0.4), (20.0, 60.0)))
        elements += [
            Mass(f"x{i}", m),
            Spring(f"x{i}", "ground", k),
            Mass(f"y{i}", m),
            Load(f"y{i}", 9.81 * m),
            Bumper(f"y{i}", "ground", e=0.0, name=f"N{i}"),
            Friction(f"x{i}", "b", mu, normal=f"N{i}", mu_s=mu * float(rng.uniform(1.1, 2.0)), name=f"F{i}"),
        ]
        if i:
            elements.append(Spring(f"x{i - 1}", f"x{i}", float(rng.uniform(10.0, 50.0))))
    return Problem("blocks", Scheme(*elements))


def test_which_methods_take_it():
    assert ABLE == [
        "d1-minus", "event-driven", "exact", "moreau-jean", "moreau-midpoint", "newmark-ns", "stormer-verlet-ns",
    ]  # fmt: skip
    for name in sorted(set(METHODS) - set(ABLE)):
        with pytest.raises(li.UnsupportedError, match=name):
            simulate(block(1.0), name, dt=0.01, t_end=0.1)


@pytest.mark.parametrize("method", LOCATING)
@pytest.mark.parametrize("parameters", [{}, {"mu_s": 0.31, "v_b": 0.05}, {"mu": 0.05, "mu_s": 0.9, "v_b": 2.0}])
def test_the_belt_in_closed_form(method, parameters):
    problem = li.load_problem("stick-slip-belt", **parameters)
    run = simulate(problem, method, dt=problem.t_end / 235, t_end=problem.t_end)
    near = 1e-12 if method == "exact" else 1e-7
    q, v = problem.motion(run.t)
    assert run.q == pytest.approx(q, abs=near)
    assert run.v == pytest.approx(v, abs=10.0 * near)
    stick, period = (fact.value for fact in problem.facts[:2])
    want = [(stick + k * period, "slip") for k in range(4)] + [(k * period, "stick") for k in range(1, 4)]
    assert [event.kind for event in run.events] == [kind for _, kind in sorted(want)]
    assert [event.t for event in run.events] == pytest.approx([t for t, _ in sorted(want)], abs=near)
    first = run.events[0]
    weight = 9.81
    mu, mu_s = problem.parameters["mu"], problem.parameters["mu_s"]
    assert abs(first.left.reaction[1]) == pytest.approx(mu_s * weight, rel=1e-7)
    assert abs(first.right.reaction[1]) == pytest.approx(mu * weight, rel=1e-7)


def test_steps_on_the_belt_are_of_order_one():
    problem = li.load_problem("stick-slip-belt")
    counts, errors = (331, 661, 1327, 2663, 5323, 10_657), []
    for n in counts:
        run = simulate(problem, dt=problem.t_end / n, t_end=problem.t_end)
        assert [event.kind for event in run.events] == 3 * ["slip", "stick"] + ["slip"]
        errors.append(np.abs(run.q - problem.motion(run.t)[0]).max())
    assert -np.polyfit(np.log(counts), np.log(errors), 1)[0] == pytest.approx(1.0, abs=0.35)


@pytest.mark.parametrize("method", ABLE)
def test_a_block_holds_up_to_its_static_bound(method):
    """It rests at the threshold of 10 N itself; beyond it, it slides at once with 6 N, in both directions."""
    for force in (6.0, 9.999, 10.0, -10.0):
        run = simulate(block(force), method, dt=0.01, t_end=1.0)
        assert run["x"] == pytest.approx(0.0, abs=1e-15), force
        assert not run.events
    run = simulate(block(10.0 + 1e-6), method, dt=0.01, t_end=1.0)
    assert run["x"][-1] == pytest.approx(0.5 * (10.0 + 1e-6 - 6.0) / 2.0, rel=1e-9 if method != "d1-minus" else 1e-2)
    ramp = simulate(block(Ramp(0.0, -20.0, 0.0, 1.0)), method, dt=1e-3, t_end=1.0)
    # It breaks loose at t = 1/2, and x'' = -(20 t - 6)/2 then.
    near = 1e-9 if method in LOCATING else 3e-3
    assert ramp["x"][-1] == pytest.approx(-11.0 / 24.0, abs=near)
    assert [(event.kind, round(event.t, 2)) for event in ramp.events] == [("slip", 0.5)]


@pytest.mark.parametrize("method", ABLE)
def test_a_block_that_comes_to_rest_sticks_where_static_friction_suffices(method):
    """Thrown against a force of 8 N, between the bounds of 6 and 10 N, it stops and stays; against 12 N it turns back."""
    run = simulate(block(8.0, v0=-2.0), method, dt=1e-3, t_end=1.0)
    assert kinds(run) == [("stick", "F")]
    assert run.events[0].t == pytest.approx(2.0 / 7.0, abs=1e-3)
    assert run["x"][-1] == pytest.approx(-2.0 / 7.0, abs=2e-6 if method not in LOCATING else 1e-9)
    assert run["F"][-1] == pytest.approx(-8.0 if run["F"][-1] < 0.0 else 8.0)
    turning = simulate(block(12.0, v0=-2.0), method, dt=1e-3, t_end=1.0)
    # x'' = (12 + 6)/2 up to 2/9 s, and (12 - 6)/2 then.
    assert turning["x"][-1] == pytest.approx(-2.0 / 9.0 + 1.5 * (7.0 / 9.0) ** 2, abs=5e-3)
    assert kinds(turning) == [("slip", "F")]


@pytest.mark.parametrize("method", ABLE)
def test_equal_coefficients_are_one(method):
    """With mu_s = mu a run is that without mu_s, bit for bit."""
    force = Harmonic(9.0, 2.0)
    plain, equal = (simulate(block(force, mu_s=mu_s), method, dt=0.01, t_end=4.0) for mu_s in (None, 0.3))
    for name in ("q", "v", "reaction"):
        np.testing.assert_array_equal(getattr(plain, name), getattr(equal, name))
    assert kinds(plain) == kinds(equal)


@pytest.mark.parametrize("method", ABLE)
def test_a_normal_force_that_vanishes_and_returns(method):
    """Lifted at 2.4 cos 5 t g the block breaks loose, leaves the floor, and lands sliding."""
    problem = block(7.0, normal=Harmonic(24.0, 5.0))
    run = simulate(problem, method, dt=1e-3 if method not in LOCATING else 0.01, t_end=0.6)
    # 24 cos 5 t = 7/0.5 and 0.
    assert kinds(run) == [("slip", "F"), ("open", "N")]
    assert [event.t for event in run.events] == pytest.approx([math.acos(7.0 / 12.0) / 5.0, 0.1 * math.pi], abs=2e-3)
    lands = block(4.0, normal=Ramp(20.0, 10.0, 0.0, 1.0))
    held = simulate(lands, method, dt=1e-3 if method not in LOCATING else 0.01, t_end=0.5)
    assert kinds(held) == []
    assert held["x"] == pytest.approx(0.0, abs=1e-15)


@pytest.mark.parametrize("method", ABLE)
def test_a_run_is_continued_from_any_instant(method):
    """Sticking at 8 N above the kinetic bound, and sliding at 8 N: the velocity is the memory."""
    first = simulate(block(8.0, v0=-2.0), method, dt=1e-3, t_end=0.5)
    again = block(8.0, q0=float(first["x"][-1]), v0=float(first["v_x"][-1]))
    rest = simulate(again, method, dt=1e-3, t_end=0.5)
    assert rest["x"] == pytest.approx(first["x"][-1], abs=1e-9)
    sliding = simulate(block(8.0, v0=0.5), method, dt=1e-3, t_end=1.0)
    # 8 N against 6 N: it speeds up.
    half = simulate(block(8.0, q0=float(sliding["x"][500]), v0=float(sliding["v_x"][500])), method, dt=1e-3, t_end=0.5)
    assert half["x"][-1] == pytest.approx(sliding["x"][-1], abs=1e-6)
    assert sliding["x"][-1] == pytest.approx(0.5 + 0.5, abs=1e-3)


@pytest.mark.parametrize("seed", range(3))
def test_blocks_that_hold_each_other_back(seed):
    """Events of several rows in any order: two ways to follow a mode and time steps go the same way."""
    problem = blocks_on_a_belt(seed)
    runs = {
        method: simulate(problem, method, dt=2e-4 if method == "moreau-jean" else 0.01, t_end=4.0)
        for method in ("exact", "event-driven", "moreau-jean")
    }
    truth = runs["exact"]
    for method, near in (("event-driven", 1e-8), ("moreau-jean", 1e-4)):
        assert sorted(kinds(runs[method])) == sorted(kinds(truth))
        assert np.abs(runs[method].sample(truth.t).q - truth.q).max() < near


@pytest.mark.parametrize("method", ABLE)
def test_a_blow_breaks_static_friction_by_its_impulse(method):
    """A ball strikes a resting block; no friction acts against the impulse, since no normal impulse does."""
    scheme = block(0.0).scheme.add(Mass("b", 1.0), Bumper("b", "x", gap=0.1, e=0.5, name="R"))
    problem = Problem("blow", scheme, v0={"b": 2.0})
    run = simulate(problem, method, dt=1e-4, t_end=0.2)
    struck = next(event for event in run.events if event.kind == "impact")
    assert struck.impulse == pytest.approx(2.0 * 1.5 / (1.0 + 0.5), rel=1e-2)
    # The block leaves at 1 m/s and is braked by 6 N.
    t = run.t[-1] - struck.t
    assert run["x"][-1] == pytest.approx(t - 1.5 * t**2, abs=2e-3)


@pytest.mark.parametrize("method", LOCATING)
def test_impulses_stick_up_to_the_static_coefficient(method):
    """A block lands with no slip while a strut presses it aside at 22°: tan 22° = 0.404 is between 0.3 and 0.5."""
    tangent = 0.4
    oblique = {"y": 1.0, "x": tangent}

    def landing(mu_s):
        scheme = Scheme(
            Mass("x", 1.0),
            Mass("y", 1.0),
            Load("y", 10.0),
            Bumper("y", "ground", e=0.0, name="N"),
            Friction("x", "ground", 0.3, normal="N", mu_s=mu_s),
            Mass("b", 1.0),
            Bumper("b", oblique, gap=0.0, e=0.0, name="R"),
        )
        return simulate(Problem("landing", scheme, v0={"b": 1.0}), method, dt=0.01, t_end=0.05)

    # The strut's impulse of 1 N s presses by 1 and 0.4: it sticks with μ_s = 0.5 alone.
    assert landing(0.5)["v_x"][0] == pytest.approx(0.0, abs=1e-15)
    assert landing(0.35)["v_x"][0] > 0.05
    assert landing(0.35)["v_x"][0] == pytest.approx(landing(None)["v_x"][0], abs=1e-14)


def test_a_certificate_knows_both_bounds():
    """Held above μ r_N a block obeys μ_s only, and one that slides with μ_s r_N breaks the law."""
    for method in ("moreau-jean", "exact"):
        run = simulate(block(8.0), method, dt=0.01, t_end=1.0)
        assert run.certify().holds
        assert run.certify(block(8.0, mu_s=0.35)).failures
        slides = simulate(block(15.0, mu=0.5, mu_s=None), method, dt=0.01, t_end=1.0)
        assert slides.certify(block(15.0, mu=0.3)).failures


def test_bad_input_is_refused_in_a_sentence():
    for mu_s, says in (
        (0.2, r"mu_s = 0\.2 must be a finite number, at least mu = 0\.3"),
        (math.nan, "mu_s = nan must be"),
        (-1.0, r"mu_s = -1\.0 must be"),
        ("much", "mu_s = 'much' must be"),
    ):
        with pytest.raises(InputError, match=says):
            Friction("x", "ground", 0.3, normal="N", mu_s=mu_s)
    with pytest.raises(InputError, match="together are no law"):
        Friction("x", "ground", 0.3, normal="N", mu_s=0.5, e_T=0.5)
    loose = Scheme(li.KelvinVoigt("x", "ground", k=1.0, c=1.0), Mass("y", 1.0), Bumper("y", "ground", e=0.0, name="N"))
    with pytest.raises(InputError, match=r"mu_s = 0\.5 has no memory to act on, since a surface is massless"):
        loose.add(Friction("x", "ground", 0.3, normal="N", mu_s=0.5)).assemble()
    with pytest.raises(InputError, match=r"mu_s = 0\.2 must be above mu = 0\.3"):
        li.load_problem("stick-slip-belt", mu_s=0.2)


def test_the_drawing_and_the_file_name_both_coefficients(tmp_path):
    problem = li.load_problem("stick-slip-belt")
    path = li.write_scheme_file(problem, tmp_path / "belt.toml")
    assert "mu_s = 0.5" in path.read_text(encoding="utf-8")
    assert li.read_scheme_file(path).problem.scheme == problem.scheme
    labels = [element.labels for element in problem.scheme.elements if isinstance(element, Friction)]
    assert labels == [("μ", "μ_s")]
    assert Friction("x", "ground", 0.3, normal="N").labels == ("μ",)


@pytest.mark.parametrize("method", ["exact", "event-driven", "moreau-jean"])
def test_slip_that_ends_under_a_load_between_both_bounds_sticks(method):
    """F = 4 t - t² breaks the block loose; where its slip ends, F lies between μ and μ_s times its weight, and it stays."""
    mu, mu_s, g = 0.2, 0.4, 9.81
    scheme = Scheme(
        Mass("x", 1.0), Mass("y", 1.0), Load("y", g), Load("x", Polynomial((0.0, 4.0, -1.0))),
        Bumper("y", "ground", e=0.0, name="N"), Friction("x", "ground", mu, "N", mu_s=mu_s, name="T"),
    )  # fmt: skip
    loose, again = 2.0 - np.sqrt(4.0 - mu_s * g), 2.0 + np.sqrt(4.0 + mu_s * g)
    speed = np.poly1d([-1.0 / 3.0, 2.0, -mu * g, 0.0])
    stop = max((speed - speed(loose)).roots.real)
    back = np.poly1d([-1.0 / 3.0, 2.0, mu * g, 0.0])
    x = (speed - speed(loose)).integ()(stop) - (speed - speed(loose)).integ()(loose)
    x += (back - back(again)).integ()(8.0) - (back - back(again)).integ()(again)
    assert mu * g < abs(4.0 * stop - stop**2) < mu_s * g
    run = simulate(Problem("load", scheme), method, dt=1e-3 if method == "moreau-jean" else 1e-2, t_end=8.0)
    tolerance = 2e-3 if method == "moreau-jean" else 1e-8
    assert [event.kind for event in run.events] == ["slip", "stick", "slip"]
    assert [event.t for event in run.events] == pytest.approx([loose, stop, again], abs=tolerance)
    assert run["x"][-1] == pytest.approx(x, abs=2.0 * tolerance)
