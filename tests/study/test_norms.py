"""The norms against closed forms on trajectories that are constructed, brute force, and what is known to converge."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.spatial.distance import cdist

from lcpimpact import (
    Bumper,
    FailureError,
    InputError,
    Mass,
    Problem,
    Scheme,
    Spring,
    Status,
    Trajectory,
    load_problem,
    simulate,
)
from lcpimpact.certificate import Certificate
from lcpimpact.record import ContinuousSolution, Event, State
from lcpimpact.study.accuracy import graphs, norms
from lcpimpact.study.accuracy.graphs import hausdorff, polyline
from lcpimpact.study.accuracy.norms import NORMS, error_norms
from lcpimpact.study.accuracy.reference import reference

BALL = Problem("ball", Scheme(Mass("x", 2.0), Spring("x", "ground", 8.0), Bumper("x", "ground", gap=1.0, e=0.5)))
CERTIFICATE = Certificate(0.0, 0.25, 0.0, 0.0, 1.0)


def constructed(t, q=None, v=None, events=(), dense=None, problem=BALL):
    """A trajectory of one mass on a grid, from columns or functions of time."""
    t = np.asarray(t, dtype=np.float64)
    columns = [np.zeros_like(t) if f is None else f(t) if callable(f) else np.asarray(f, float) for f in (q, v)]
    return Trajectory(
        problem, "by hand", t, columns[0][:, None], columns[1][:, None], t, np.zeros((len(t), 1)), tuple(events),
        Status.SOLVED, "", CERTIFICATE, {}, dense,
    )  # fmt: skip


def known(q, v, cuts, events=()):
    """A trajectory that is known at all times; the functions take times and the side."""

    def read(t, side):
        return q(t, side)[:, None], v(t, side)[:, None], np.zeros((len(t), 1))

    cuts = np.asarray(cuts, dtype=np.float64)
    return constructed(cuts, lambda t: q(t, "right"), lambda t: v(t, "right"), events, ContinuousSolution(read, cuts))


def smooth(f):
    return lambda t, side: f(t)


def step(at, before, after):
    return lambda t, side: np.where(t >= at if side == "right" else t > at, after, before) + 0.0 * t


def event(t, kind="impact", impulse=0.0, contact="R"):
    state = State(np.zeros(1), np.zeros(1), np.zeros(1))
    return Event(t, contact, kind, state, state, impulse)


def rest(t_end):
    return known(smooth(lambda t: 0.0 * t), smooth(lambda t: 0.0 * t), np.linspace(0.0, t_end, 4))


def test_integrals_and_suprema_of_a_sine_are_those_of_the_books():
    end = 7.0
    run = known(smooth(np.sin), smooth(np.sin), np.linspace(0.0, end, 8))
    zero = rest(end)
    assert norms.sup_q(run, zero) == pytest.approx(1.0, rel=1e-14), "the peak at π/2 lies on no point of the grid"
    assert norms.sup_v(run, zero) == pytest.approx(1.0, rel=1e-14)
    assert norms.l1_v(run, zero) == pytest.approx(2.0 * 2.0 + 1.0 - np.cos(end - 2.0 * np.pi), rel=1e-14)
    assert norms.l2_v(run, zero) == pytest.approx(np.sqrt(0.5 * end - 0.25 * np.sin(2.0 * end)), rel=1e-14)
    assert norms.energy(run, zero) == pytest.approx(
        (0.5 * 8.0 + 0.5 * 2.0) * (0.5 * end - 0.25 * np.sin(2 * end)) / end
    )
    assert norms.penetration(run, zero) < 1e-15


def test_a_line_of_a_grid_is_compared_between_its_points():
    """v = t² against its chords over [0, 1]: each of n has the area h³/6 above it."""
    n = 7
    truth = known(smooth(lambda t: t**3 / 3.0), smooth(lambda t: t**2), [0.0, 0.3, 1.0])
    run = constructed(np.linspace(0.0, 1.0, n + 1), lambda t: t**3 / 3.0, lambda t: t**2)
    assert norms.l1_v(run, truth) == pytest.approx(n * (1.0 / n) ** 3 / 6.0, rel=1e-12)
    assert norms.l2_v(run, truth) == pytest.approx(np.sqrt(n * (1.0 / n) ** 5 / 30.0), rel=1e-12)
    assert norms.sup_v(run, truth) == pytest.approx((1.0 / n) ** 2 / 4.0, rel=1e-12)
    assert norms.sup_q(run, truth) < 1e-15, "on its grid, where it is right"


@pytest.mark.parametrize("size", [1.0, 1e-6, 1e6])
def test_the_rounding_of_a_contact_that_stays_closed_is_not_halved(size, monkeypatch):
    """u = gap - q is a difference of equal numbers, and v is what rounding leaves of a rest."""
    monkeypatch.setattr(norms, "MAX_PIECES", 1000)
    scheme = Scheme(Mass("x", 2.0), Spring("x", "ground", 8.0), Bumper("x", "ground", gap=size, e=0.5))
    problem = Problem("ball", scheme)

    def noise(t):
        return np.finfo(float).eps * size * np.sin(1e9 * t)

    run = known(lambda t, side: size + noise(t), smooth(noise), np.linspace(0.0, 0.5, 9))
    run, truth = replace(run, problem=problem), replace(rest(0.5), problem=problem)
    truth = replace(truth, q=truth.q + size)
    assert norms.penetration(run, truth) <= 4.0 * np.finfo(float).eps * size
    for norm in (norms.l1_v, norms.l2_v, norms.sup_v):
        assert norm(run, truth) <= 4.0 * np.finfo(float).eps * size


def test_a_norm_of_what_turns_without_end_is_refused_with_a_sentence(monkeypatch):
    monkeypatch.setattr(norms, "MAX_PIECES", 10_000)
    run = known(smooth(lambda t: np.sin(1e9 * t)), smooth(lambda t: np.sin(1e9 * t)), [0.0, 1.0])
    for norm in (norms.sup_q, norms.l1_v, norms.hausdorff_v):
        with pytest.raises(FailureError, match=r"a norm would take more than 10,000 intervals: .*take a shorter t_end"):
            norm(run, rest(1.0))
    monkeypatch.setattr(graphs, "MAX_PIECES", 1_000)
    line = np.array([[0.0, 0.0], [1.0, 0.0]])
    comb = np.column_stack([np.linspace(0.0, 1.0, 2001), np.resize([0.0, 1.0], 2001)])
    for distance in (
        lambda: hausdorff(comb, line),
        lambda: polyline(line[:, 0], line[:, 1], 1e9 * line[:, :1] + [0, 0, 1e9], 1e-9),
    ):
        with pytest.raises(FailureError, match=r"more than 1,000 pieces: .*take a shorter t_end"):
            distance()


@pytest.mark.parametrize("late", [0.1, 1e-3, 1e-6])
def test_an_impact_that_comes_late(late):
    """A jump J late by δ: L1 has J δ, L2 J δ^(1/2), the graphs are δ/T apart, and sup v is J for ever."""
    at, T, before, after = 1.0 / np.sqrt(2.0), 4.0, 3.0, -1.5
    jump = before - after

    def run(t):
        return known(smooth(lambda s: 0.0 * s), step(t, before, after), [0.0, 2.0, T], [event(t, impulse=2.0 * jump)])

    truth, found = run(at), run(at + late)
    assert norms.l1_v(found, truth) == pytest.approx(jump * late, rel=1e-9)
    assert norms.l2_v(found, truth) == pytest.approx(jump * np.sqrt(late), rel=1e-9)
    assert norms.hausdorff_v(found, truth) == pytest.approx(late / T, rel=2e-3)
    assert norms.sup_v(found, truth) == pytest.approx(jump, rel=1e-14)
    assert norms.event_times(found, truth) == pytest.approx(late, rel=1e-9)
    assert norms.impulses(found, truth) == 0.0
    assert norms.energy(found, truth) == pytest.approx(0.5 * 2.0 * (before**2 - after**2) * late / T, rel=1e-9)


def test_a_ramp_in_place_of_a_jump_is_near_it():
    """A grid sees an impact as a line over a step: near in the graphs and in L1, not in the sup."""
    h, T, at = 1.0 / 8.0, 1.0, 0.4375
    truth = known(smooth(lambda t: 0.0 * t), step(at, 1.0, -1.0), [0.0, T], [event(at)])
    run = constructed([0.0, 0.375, 0.5, 1.0], v=[1.0, 1.0, -1.0, -1.0])
    assert norms.l1_v(run, truth) == pytest.approx(2.0 * 0.5 * (h / 2.0) * 1.0, rel=1e-12)
    assert norms.sup_v(run, truth) == pytest.approx(1.0, rel=1e-12)
    # The point of the ramp nearest to the corner (at, 1), scaled by T and V: x - at = y - 1 on the ramp.
    apart = (h / 2.0) / (1.0 + h / 2.0)
    assert norms.hausdorff_v(run, truth) == pytest.approx(apart, rel=2e-3)


def test_events_are_paired_by_contact_and_kind():
    truth = constructed([0.0, 3.0], events=[event(1.0, impulse=5.0), event(2.0, impulse=4.0), event(2.0, "open")])
    run = constructed([0.0, 3.0], events=[event(1.1, impulse=5.5), event(2.3, "open"), event(2.2, impulse=4.1)])
    assert norms.event_times(run, truth) == pytest.approx(0.3)
    assert norms.impulses(run, truth) == pytest.approx(0.5)
    fewer = constructed([0.0, 3.0], events=[event(1.0)])
    assert np.isnan(norms.event_times(fewer, truth))
    assert np.isnan(norms.impulses(fewer, truth))
    none = constructed([0.0, 3.0])
    assert norms.event_times(none, none) == 0.0


def test_penetration_is_that_of_the_bumpers_of_the_truth_and_found_between_points():
    run = known(smooth(lambda t: 1.25 * np.sin(t)), smooth(lambda t: 1.25 * np.cos(t)), [0.0, 1.0, 3.0])
    assert norms.penetration(run, rest(3.0)) == pytest.approx(0.25, rel=1e-12)
    grid = constructed([0.0, 1.0, 2.0], [0.0, 1.125, 0.5])
    assert norms.penetration(grid, rest(3.0)) == pytest.approx(0.125, rel=1e-12)
    assert norms.complementarity(grid, rest(3.0)) == CERTIFICATE.complementarity


def test_curves_a_hair_apart_are_told_apart():
    """v = t² and t² + ε, of pieces with other cuts: chords a hundredth away would show more."""
    ε = 1e-5
    truth = known(smooth(lambda t: 0.0 * t), smooth(lambda t: t**2), [0.0, 1.0])
    run = known(smooth(lambda t: 0.0 * t), smooth(lambda t: t**2 + ε), [0.0, 0.37, 1.0])
    assert norms.hausdorff_v(run, truth) == pytest.approx(ε, rel=2e-3)


def test_nodes_without_mass_and_sliders_are_not_judged():
    """z carries no mass; a slider has two sides, and no overlap."""
    problem = load_problem("system-1")
    truth = simulate(problem, "exact", dt=0.1, t_end=0.5)
    q, v = truth.q + np.array([0.01, 5.0]), truth.v + np.array([0.0, 5.0])
    run = replace(truth, q=q, v=v, dense=None)
    assert norms.sup_q(run, truth) == pytest.approx(0.01, rel=1e-9)
    assert norms.l1_v(run, truth) < norms.l1_v(replace(run, v=v + 0.1), truth) < 0.2
    sliding = load_problem("coulomb-oscillator")
    scheme = Scheme(*sliding.scheme.elements, Bumper("x", "ground", gap=9.0, e=0.0))
    run = simulate(Problem("both", scheme, q0=sliding.q0), dt=1e-2, t_end=1.0)
    assert run.q.min() < -0.01
    assert norms.penetration(run, run) == 0.0


def test_a_run_that_ended_early_is_judged_as_far_as_it_came():
    truth = known(smooth(lambda t: t), smooth(lambda t: 1.0 + 0.0 * t), [0.0, 4.0])
    run = constructed([0.0, 1.0, 2.0], [0.0, 1.5, 2.0], [1.0, 1.0, 1.0])
    assert norms.sup_q(run, truth) == pytest.approx(0.5)
    assert norms.l1_v(run, truth) == pytest.approx(0.0, abs=1e-13)
    assert norms.hausdorff_v(run, truth) == pytest.approx(0.0, abs=1e-12)


@given(
    st.lists(st.floats(-2.0, 2.0), min_size=3, max_size=9),
    st.floats(0.5, 20.0),
    st.floats(-1.0, 1.0),
)
@settings(max_examples=40, deadline=None)
def test_integrals_agree_with_an_adaptive_quadrature(values, ω, shift):
    t = np.linspace(0.0, 1.0, len(values))
    run = constructed(t, v=values)
    truth = known(smooth(lambda s: 0.0 * s), smooth(lambda s: shift + np.cos(ω * s)), np.linspace(0.0, 1.0, 3))

    def error(s):
        return abs(np.interp(s, t, values) - shift - np.cos(ω * s))

    fine = np.linspace(0.0, 1.0, 401)
    points = np.union1d(fine, t)
    area = sum(quad(error, a, b)[0] for a, b in pairwise(points))
    square = sum(quad(lambda s: error(s) ** 2, a, b)[0] for a, b in pairwise(points))
    assert norms.l1_v(run, truth) == pytest.approx(area, rel=1e-7, abs=1e-9)
    assert norms.l2_v(run, truth) == pytest.approx(np.sqrt(square), rel=1e-7, abs=1e-9)
    assert norms.sup_v(run, truth) >= max(map(error, points)) - 1e-12
    assert norms.sup_v(run, truth) == pytest.approx(max(map(error, np.linspace(0, 1, 4001))), abs=2e-2)


def graph(values, gaps):
    t = np.concatenate([[0.0], np.cumsum(gaps)])[: len(values)]
    return np.column_stack([t / max(t[-1], 1e-9), values[: len(t)]])


polylines = st.builds(
    graph,
    st.lists(st.floats(-1.0, 1.0), min_size=2, max_size=7),
    st.lists(st.sampled_from([0.0, 0.1, 0.3, 1.0]), min_size=6, max_size=6),
).filter(lambda a: a[-1, 0] > 0.5)


def thick(points, n=400):
    s = np.linspace(0.0, 1.0, n)[:, None]
    return np.concatenate([a + s * (b - a) for a, b in pairwise(points)])


@given(polylines, polylines)
@settings(max_examples=60, deadline=None)
def test_the_distance_of_graphs_agrees_with_brute_force(A, B):
    d = hausdorff(A, B)
    many = cdist(thick(A), thick(B), "chebyshev")
    brute = max(many.min(axis=0).max(), many.min(axis=1).max())
    assert d == pytest.approx(brute, abs=0.5 * 2.0 / 399 + 1e-9)
    assert d == pytest.approx(hausdorff(B, A), abs=1e-12)
    assert hausdorff(A, A) == 0.0


def test_the_distance_of_a_square_wave_from_a_line_is_found_between_corners():
    """The farthest point need not be a corner of either polyline."""
    V = np.array([[0.0, 0.0], [0.5, 0.4], [1.0, 0.0]])
    line = np.array([[0.0, 0.4], [1.0, 0.4]])
    assert hausdorff(V, line) == pytest.approx(0.4, rel=1e-12)
    # From the middle of the segment (0, 1)-(1, 1) both posts are 1/2 away, from the corners 0.
    assert (
        hausdorff(np.array([[0.0, 1.0], [1.0, 1.0]]), np.array([[0.0, 1.0], [0.0, -9.0], [1.0, -9.0], [1.0, 1.0]]))
        == 10
    )
    post = np.array([[0.0, 1.0], [0.0, 0.0], [1.0, 0.0], [1.0, 1.0]])
    roof = np.array([[0.0, 0.0], [0.0, 1.0], [1.0, 1.0], [1.0, 0.0]])
    assert hausdorff(roof, post) == pytest.approx(0.5, rel=1e-9)


def test_a_polyline_stays_near_its_curve():
    c = np.array([[0.3, -1.0, 0.5, 0.2, -0.4]])
    for tolerance in (1e-1, 1e-3, 1e-5):
        points = polyline(np.array([2.0]), np.array([3.0]), c, tolerance)
        t = np.linspace(2.0, 5.0, 10_001)
        curve = np.polynomial.chebyshev.chebval(2.0 * (t - 2.0) / 3.0 - 1.0, c[0])
        off = np.abs(np.interp(t, points[:, 0], points[:, 1]) - curve).max()
        assert off <= tolerance
        assert off > 1e-3 * tolerance, "no finer than it must be"


@pytest.mark.parametrize("e", [0.5, 0.8])
def test_what_converges_across_impacts_and_what_does_not(e):
    """The bouncing ball by Moreau-Jean: orders 1, 1, 1/2 and 1; the sup of v does not fall."""
    ball = load_problem("bouncing-ball", e=e)
    truth = reference(ball, 1.7).trajectory
    counts = np.array([307, 487, 773, 1229, 1951, 3089, 4903, 7789])
    found = []
    for n in counts:
        run = simulate(ball, dt=1.7 / n, t_end=1.7)
        found.append(
            [
                *error_norms(run, truth, ["sup_q", "l1_v", "l2_v", "hausdorff_v", "energy"]).values(),
                norms.sup_v(run, truth),
            ]
        )
    slopes = np.polyfit(np.log(1.7 / counts), np.log(found), 1)[0]
    assert slopes[:5] == pytest.approx([1.0, 1.0, 0.5, 1.0, 1.0], abs=0.35)
    jump = max((event.left.v - event.right.v)[0] for event in truth.events)
    assert np.array(found)[:, -1].min() > 0.4 * jump


def test_norms_that_are_not_known_and_runs_that_do_not_belong_together_are_refused():
    run = rest(1.0)
    with pytest.raises(InputError, match="unknown norm 'sup_p': did you mean 'sup_q'"):
        error_norms(run, run, ["sup_p"])
    other = simulate(load_problem("system-1"), dt=0.1, t_end=1.0)
    with pytest.raises(InputError, match="coordinates"):
        error_norms(other, run)


@pytest.mark.parametrize("name", ["system-1", "bouncing-ball", "coulomb-oscillator", "diode-bridge", "hertz-impact"])
def test_every_norm_of_the_truth_against_itself_is_nothing(name):
    problem = load_problem(name)
    truth = reference(problem).trajectory
    found = error_norms(truth, truth)
    assert set(found) == set(NORMS)
    for norm, value in found.items():
        if norm == "energy" and not problem.dynamics.stores_energy:
            assert np.isnan(value)
        else:
            scale = max(np.abs(truth.q).max(), np.abs(truth.v).max(), truth.certificate.energy_scale, 1.0)
            assert abs(value) <= 1e-9 * np.nan_to_num(scale, nan=1.0), norm


def test_a_reference_is_never_the_method_under_study():
    ball = load_problem("bouncing-ball")
    assert reference(ball, 1.0).name == "exact"
    other = reference(ball, 1.0, unlike=["exact"])
    assert other.name.startswith("event-driven")
    assert norms.sup_q(other.trajectory, reference(ball, 1.0).trajectory) < 1e-9
    last = reference(load_problem("hertz-impact"), unlike=["exact", "event-driven", "radau-fesd"])
    assert last.name.startswith("moreau-jean")
    with pytest.raises(Exception, match="nothing to judge 'bouncing-ball' against"):
        reference(ball, 1.0, unlike=["exact", "event-driven", "radau-fesd", "moreau-jean"])
