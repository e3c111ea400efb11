"""Impulses apart from forces where a wall moves."""

import numpy as np
import pytest

import lcpimpact as li
from lcpimpact.integrators.stepping.impulses import Blow, separate


@pytest.mark.parametrize("speed", [0.0, 1.0])
def test_the_force_of_a_closed_contact_is_left_apart_from_its_impulse_on_a_moving_wall(speed):
    """A blow on x presses y on a wall that it moves with: P = M Δv, and 0.01 N s are due to the force of the step."""
    system = li.Lagrangian(
        "x y",
        M=lambda q: np.array([[2.0, 1.0], [1.0, 2.0]]),
        contacts=[
            li.FrictionContact("wall", gap=lambda t, q: q[1] - speed * t, e=0.0),
            li.FrictionContact("stop", gap=lambda t, q: q[0], e=0.0),
        ],
    )
    before, after = np.array([-1.0, speed]), np.array([0.0, speed])
    here = li.Problem("wall", system, v0=dict(zip("xy", before.tolist(), strict=True))).dynamics.at(
        0.0, np.zeros(2), before
    )
    blow = Blow(before, after, np.zeros(2), np.array([1.01, 2.0]), np.array([False, True]))
    np.testing.assert_allclose(separate(here, blow), [1.0, 0.0], rtol=1e-12, atol=1e-12)
