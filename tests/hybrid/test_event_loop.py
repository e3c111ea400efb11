"""The event loop by itself, with motions that are made up."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
import pytest

import lcpimpact as li
from lcpimpact.errors import Status
from lcpimpact.hybrid.event_loop import Ending, EventLoop, Unresolved, follow, read_segments
from lcpimpact.hybrid.system import System


@dataclass(eq=False)
class Listed(EventLoop):
    """A motion whose modes end where a list says, and that fails where another says."""

    endings: list[Ending] = field(default_factory=list)
    failures: dict[float, Exception | Status] = field(default_factory=dict)
    entered: list[float] = field(default_factory=list)

    def integrate(self, until):
        waiting = self.endings[len(self.entered) :]
        return waiting[0] if waiting and waiting[0].t <= until else Status.SOLVED

    def enter(self, ending):
        failure = self.failures.get(ending.t, Status.SOLVED)
        if isinstance(failure, Exception):
            raise failure
        self.entered.append(ending.t)
        return failure


def listed(times, max_events=100_000, failures=None, breakpoints=()):
    at = []
    for last, t in pairwise([0.0, *times]):
        signal = t in breakpoints
        at.append(Ending(t, t - last, np.zeros(3), -1 if signal else 0, signal))
    system = System(li.load_problem("bouncing-ball").dynamics, 1.0)
    return Listed(system, 10.0, "auto", max_events, np.array(breakpoints), np.zeros(3), at, failures or {})


def test_a_motion_is_followed_up_to_an_instant_and_from_there_on():
    motion = listed([1.0, 2.0, 3.0])
    assert follow(motion, 2.0) is Status.SOLVED
    assert motion.entered == [1.0, 2.0]
    assert follow(motion, 9.0) is Status.SOLVED
    assert motion.entered == [1.0, 2.0, 3.0]


def test_breakpoints_of_signals_are_not_counted_as_events():
    motion = listed([1.0, 2.0, 3.0, 4.0], max_events=2, breakpoints=(2.0, 4.0))
    assert follow(motion, 9.0) is Status.SOLVED
    motion = listed([1.0, 2.0, 3.0, 4.0], max_events=1, breakpoints=(2.0, 4.0))
    assert follow(motion, 9.0) is Status.MAX_EVENTS
    assert motion.entered == [1.0, 2.0]


def test_events_at_one_instant_come_to_an_end_and_others_do_not():
    motion = listed([1.0] * 1000)
    assert follow(motion, 9.0) is Status.MAX_EVENTS
    assert len(motion.entered) == motion.max_at_once - 1
    motion = listed([1.0] * 99 + [2.0] * 99)
    assert follow(motion, 9.0) is Status.SOLVED


@pytest.mark.parametrize(
    ("failure", "status"),
    [
        (np.linalg.LinAlgError(), Status.SINGULAR),
        (Unresolved(), Status.ACCUMULATION),
        (Status.STEP_SIZE, Status.STEP_SIZE),
        (li.FailureError("", li.solve_lcp([[-1.0]], [-1.0], throw=False)), Status.RAY),
    ],
)
def test_a_failure_at_an_event_is_a_status(failure, status):
    motion = listed([1.0, 2.0, 3.0], failures={2.0: failure})
    assert follow(motion, 9.0) is status
    assert motion.entered[0] == 1.0


def test_the_motion_is_read_on_either_side_of_an_event():
    starts, t = np.array([0.0, 1.0, 2.0]), np.array([0.0, 0.5, 1.0, 1.5, 2.0])
    system = System(li.load_problem("bouncing-ball").dynamics, 1.0)
    kind, asked = np.array([4, 7, 4]), []

    def read(owner, mine):
        asked.append(kind[owner[0]])
        return (10.0 * kind[owner, None] + t[mine, None],) * 3

    for side, kinds in (("left", [4, 4, 4, 7, 7]), ("right", [4, 4, 7, 7, 4])):
        asked.clear()
        found = read_segments(system.dynamics, starts, kind, t, side, read)
        assert asked == [4, 7]
        for each in found:
            np.testing.assert_array_equal(each[:, 0], 10.0 * np.array(kinds) + t)
