"""Loads and prescribed motions between the instants of a run: what its steps do not see is found out."""

import numpy as np
import pytest
from scipy.integrate import cumulative_trapezoid

from lcpimpact import (
    Bumper,
    Dashpot,
    Harmonic,
    Load,
    Mass,
    Motion,
    PrescribedMotion,
    Problem,
    Scheme,
    SparseScheme,
    Spring,
    Square,
    Table,
    UnsupportedError,
    load_problem,
    simulate,
)
from lcpimpact.certificate.drives import missed_impulses
from lcpimpact.errors import Status
from lcpimpact.integrators import METHODS

STEPPING = ["moreau-jean", "stormer-verlet-ns", "radau", "heun", "rk4", "dopri5", "schatzman-paoli"]
BLOW = Table([0.9012, 0.9014, 0.9016], [0.0, 1e4, 0.0])
"""2 N s in 0.4 ms."""


def oscillator(*drive):
    """A body of 1 kg on a spring of 1 N/m."""
    return Problem("driven", Scheme(Mass("x", 1.0), Spring("x", "ground", 1.0), *drive))


def run(problem, method, dt, t_end=3.0):
    """Run a problem; None where the method refuses it."""
    try:
        return simulate(problem, method, dt=dt, t_end=t_end, throw=False)
    except UnsupportedError:
        return None


@pytest.mark.parametrize("method", [name for name in METHODS if name != "rk4-paper"])
def test_a_blow_within_one_step_is_not_called_a_run_at_rest(method):
    """It sets the body moving with 2 m/s; generalized-alpha takes it up over some steps, which is found out."""
    found = run(oscillator(Load("x", BLOW)), method, dt=0.01)
    x = 2.0 * np.sin(np.maximum(found.t - 0.9014, 0.0))
    assert (found.status is Status.SOLVED) == (method != "generalized-alpha")
    assert np.abs(found["x"] - x).max() < 0.03


@pytest.mark.parametrize("method", STEPPING)
@pytest.mark.parametrize("turns", [1.0, 2.0, 1.01])
@pytest.mark.parametrize("phase", [0.0, -0.5 * np.pi])
def test_a_wave_that_returns_with_the_steps_is_no_constant_load(method, turns, phase):
    """Its closed form has two parts, and none of a constant load of 50 N, by which the body would move by 50 m."""
    omega = 2.0 * np.pi * turns / 0.01
    found = run(oscillator(Load("x", Harmonic(50.0, omega, phase))), method, dt=0.01)
    a = 50.0 / (1.0 - omega**2)
    x = a * (
        np.cos(omega * found.t + phase) - np.cos(phase) * np.cos(found.t) + omega * np.sin(phase) * np.sin(found.t)
    )
    off = np.abs(found["x"] - x).max() / np.abs(x).max()
    assert found.status is Status.VIOLATED or off < 0.1
    assert run(oscillator(Load("x", Harmonic(50.0, omega, phase))), method, dt=0.01 / (24 * turns), t_end=0.5).success


def test_a_function_of_unknown_form_is_sampled_too():
    wave = oscillator(Load("x", lambda t: 50.0 * np.sin(100.0 * np.pi * t) ** 2))
    found = run(wave, "moreau-jean", dt=0.01)
    assert np.abs(found["x"]).max() < 1e-9
    assert found.status is Status.VIOLATED
    assert "the steps miss 75 N s of a load" in found.message
    assert run(wave, "moreau-jean", dt=0.001).success


SPARSE = {
    "a wave": (Load("x", Harmonic(50.0, 200.0 * np.pi)),),
    "a base": (Spring("x", "b", 1.0), PrescribedMotion("b", Harmonic(1.0, 200.0 * np.pi))),
}


@pytest.mark.parametrize("drive", SPARSE)
def test_sparse_steps_are_judged_too(drive):
    scheme = SparseScheme(Mass("x", 1.0), Spring("x", "ground", 1.0), *SPARSE[drive])
    found = run(Problem("driven", scheme), "moreau-jean", dt=0.01)
    assert found.status is Status.VIOLATED
    assert "the steps miss" in found.message
    assert run(Problem("driven", scheme), "moreau-jean", dt=1e-4, t_end=1.0).success


BASE = {
    "a spring, once in a step": (Spring("x", "b", 1.0), Harmonic(1.0, 200.0 * np.pi)),
    "a spring, twice in a step": (Spring("x", "b", 1.0), Harmonic(1.0, 400.0 * np.pi)),
    "a dashpot, within a step": (Dashpot("x", "b", 1.0), Table([0.9012, 0.9014, 0.9016], [0.0, 1.0, 0.0])),
    "a contact, within a step": (Bumper("x", "b", gap=0.1, e=0.5), Table([0.9012, 0.9014, 0.9016], [0.0, -1.0, 0.0])),
}


@pytest.mark.parametrize("way", BASE)
@pytest.mark.parametrize("method", ["moreau-jean", "radau", "heun", "rk4"])
def test_a_base_that_moves_between_the_instants_is_found_out(method, way):
    element, motion = BASE[way]
    found = run(oscillator(element, PrescribedMotion("b", motion)), method, dt=0.01)
    assert found is None or found.status is Status.VIOLATED


@pytest.mark.parametrize("method", ["exact", "event-driven"])
@pytest.mark.parametrize("phase", [0.0, -0.5 * np.pi])
def test_the_spacing_of_the_output_is_no_step(method, phase):
    """The base moves once between two instants of the record, by 0.1 μm on the body."""
    base = PrescribedMotion("b", Harmonic(1e-3, 2000.0 * np.pi, phase))
    found = run(oscillator(Spring("x", "b", 1.0), base), method, dt=1e-3, t_end=0.02)
    assert found.certificate.motion < 1e-9


@pytest.mark.parametrize("velocity", [lambda t: 0.0, lambda t: 2.0 * np.cos(t), lambda t: 1.02 * np.cos(t)])
def test_a_motion_whose_velocity_is_not_its_own_is_found_out(velocity):
    for own, status in ((velocity, Status.VIOLATED), (np.cos, Status.SOLVED)):
        base = PrescribedMotion("b", Motion(np.sin, own))
        assert run(oscillator(Dashpot("x", "b", 1.0), base), "moreau-jean", dt=0.01).status is status


@pytest.mark.parametrize("method", STEPPING)
def test_a_slight_drive_that_the_steps_miss_is_no_matter(method):
    """A blow of 0.002 N s on a body that moves with 1 kg m/s."""
    slight = Table(BLOW.times, tuple(1e-3 * f for f in BLOW.values))
    problem = oscillator(Load("x", slight))
    problem = Problem("slight", problem.scheme, v0={"x": 1.0})
    assert run(problem, method, dt=0.01).success


@pytest.mark.parametrize("scheme", [Scheme, SparseScheme])
def test_a_blow_within_one_step_is_seen(scheme):
    """It sets a free body moving with 2 m/s."""
    found = run(Problem("struck", scheme(Mass("x", 1.0), Load("x", BLOW))), "moreau-jean", dt=0.01)
    assert found["v_x"][-1] == pytest.approx(2.0, rel=1e-12)
    assert found.success


def test_no_impulse_of_a_square_wave_is_missed():
    d = Scheme(Mass("x", 1.0), Load("x", Square(1.0, np.pi, 0.5 * np.pi)), Load("x", lambda t: 0.0)).assemble()
    missed, had = missed_impulses(d, np.linspace(-0.05, 0.95, 11))
    assert missed == 0.0
    assert had == pytest.approx(0.95 - 0.05)


def test_no_impulse_of_constant_and_linear_drives_is_missed():
    scheme = Scheme(
        Mass("x", 1.0), Load("x", 3.0), Load("x", Table([0.0, 1.0], [0.0, 5.0])), Load("x", lambda t: 2.0 * t)
    )
    missed, had = missed_impulses(scheme.assemble(), np.linspace(0.0, 1.0, 8))
    assert missed == pytest.approx(0.0, abs=1e-14)
    assert had == pytest.approx(3.5)


@pytest.mark.parametrize(
    "drive", [Table(np.linspace(0.0, 1.0, 13), np.sin(np.arange(13.0))), np.cos], ids=["table", "cos"]
)
def test_the_missed_impulses_are_those_of_quadrature(drive):
    """At instants that have nothing to do with those of the table, by sums over very short intervals."""
    t = np.linspace(0.0, 1.0, 10)
    base = (Spring("x", "b", 1.0), PrescribedMotion("b", drive)) if isinstance(drive, Table) else (Load("x", drive),)
    missed, had = missed_impulses(Scheme(Mass("x", 1.0), *base).assemble(), t)
    fine = np.linspace(0.0, 1.0, 90_001)
    acts, line = np.array([drive(s) for s in fine]), np.interp(fine, t, [drive(s) for s in t])
    ends = np.sort(np.append(t, t[:-1] + 0.5 * (3.0 - 5.0**0.5) * np.diff(t)))
    acts, seen = (np.interp(ends, fine, cumulative_trapezoid(f, fine, initial=0.0)) for f in (acts, line))
    assert had[0] == pytest.approx(np.abs(seen).max(), rel=1e-6)
    assert missed[0] == pytest.approx(np.abs(acts - seen).max(), rel=1e-4)


@pytest.mark.parametrize("method", ["bs23", "dopri5"])
def test_a_method_that_chooses_its_steps_sees_loads_between_the_instants_of_its_record(method):
    """Seven instants over many periods of the load: what is recorded says nothing of what the steps saw."""
    problem = load_problem("shaw-holmes")
    h = problem.t_end / 7
    run = simulate(problem, method, dt=h, rtol=1e-6)
    truth = simulate(problem, "exact", dt=h)
    assert run.stats.steps > 7
    assert np.abs(run.q - truth.q).max() < 2e-5 * np.abs(truth.q).max()
    assert run.certificate.missed_impulse == 0.0
