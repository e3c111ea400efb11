"""Starts from published data, whose rounding lets bumpers penetrate."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import lcpimpact as li
from lcpimpact.problems.base import least_distance


def pile(a: float, b: float, **more) -> li.Problem:
    scheme = li.Scheme(
        li.Mass("a", 1.0), li.Mass("b", 2.0), li.Load("a", 9.81), li.Load("b", 19.62),
        li.Bumper("a", "b", gap=0.1, e=0.0), li.Bumper("b", "ground", gap=0.2, e=0.0),
    )  # fmt: skip
    return li.Problem("pile", scheme, q0={"a": a, "b": b}, t_end=0.1, **more)


@pytest.mark.parametrize("method", ["exact", "moreau-jean", "rk4"])
def test_a_penetration_by_the_rounding_of_data_is_opened_and_said(method):
    problem = pile(0.3 + 8.8e-7, 0.2)
    # min Δa² + Δb² with both bumpers closed: b stays on the ground, and a goes back alone
    assert problem.initial_coordinates == pytest.approx([0.3, 0.2], abs=1e-15)
    run = li.simulate(problem, method, dt=1e-2)
    assert run.success
    assert "penetrated by 8.8e-07 m" in run.message
    assert "penetrated by 8.8e-07 m" in li.simulate(replace(problem, t_end=0.2), method, dt=1e-2).message


def test_a_larger_penetration_is_refused():
    with pytest.raises(li.InputError, match="starts penetrated by"):
        pile(0.3 + 8.8e-6, 0.2)


def test_a_start_without_penetration_is_kept():
    assert pile(0.3 - 8.8e-7, 0.2).note == ""
    assert pile(0.3 - 8.8e-7, 0.2).initial_coordinates[0] == 0.3 - 8.8e-7


def test_given_motions_are_not_moved():
    scheme = li.Scheme(
        li.Mass("x", 1.0), li.PrescribedMotion("y", li.Harmonic(0.0, 1.0)), li.Bumper("x", "y", gap=0.1, e=0.0)
    )
    assert li.Problem("table", scheme, q0={"x": 0.1 + 1e-7}).q0 == {"x": pytest.approx(0.1, abs=1e-15)}


@pytest.mark.parametrize("seed", range(5))
def test_least_distance_satisfies_the_conditions_of_optimality(seed):
    rng = np.random.default_rng(seed)
    A, b = rng.normal(size=(4, 6)), rng.normal(size=4)
    x = least_distance(A, b)
    assert x is not None
    assert (A @ x >= b - 1e-12).all()
    multipliers = np.linalg.lstsq(A.T, x, rcond=None)[0]
    np.testing.assert_allclose(A.T @ multipliers, x, atol=1e-12)
    assert (multipliers >= -1e-12).all()
    np.testing.assert_allclose(multipliers * (A @ x - b), 0.0, atol=1e-12)


def test_no_point_within_contradicting_bounds():
    assert least_distance(np.array([[1.0], [-1.0]]), np.array([1.0, 1.0])) is None
