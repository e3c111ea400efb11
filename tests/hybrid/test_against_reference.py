"""The exact solution against the event simulator of `event_reference`, on random schemes of ten kinds.

From the directory of the repository, ``PYTHONPATH=tests python tests/hybrid/test_against_reference.py KIND SEED`` prints
the scheme and the events of both, side by side.
"""

# ruff: noqa: T201
from __future__ import annotations

import math
import sys
from collections import Counter
from dataclasses import dataclass, fields, replace
from itertools import pairwise

import numpy as np
import pytest
from event_reference import Reference, Undecided

import lcpimpact as li

KINDS = (
    "plain",
    "extreme units",
    "zero gaps",
    "ties",
    "critical damping",
    "e = 1",
    "stiff",
    "soft",
    "accumulation",
    "stopped plates",
)

MOST = 40
"""A run ends before its event of this number, so that errors, which grow with impacts, stay near rounding."""

TIME, PLACE, RATE = 1e-12, 1e-12, 1e-10
"""What times, places, and velocities, forces and impulses may be off by, relative to the run and the scale of its motion."""


@dataclass(frozen=True)
class Numbers:
    """The ranges that the numbers of a kind are drawn from, on a logarithmic scale."""

    m: tuple[float, float] = (0.5, 5.0)
    k: tuple[float, float] = (20.0, 500.0)
    c: tuple[float, float] = (0.5, 30.0)
    gap: tuple[float, float] = (0.01, 0.2)
    e: tuple[float, float] = (0.05, 0.8)
    load: tuple[float, float] = (0.5, 20.0)
    v: tuple[float, float] = (0.3, 5.0)
    end: tuple[float, float] = (1.0, 4.0)


NUMBERS = {
    "e = 1": Numbers(e=(1.0, 1.0)),
    "stiff": Numbers(k=(1e5, 1e9), c=(1e2, 1e5), gap=(1e-4, 1e-1), end=(0.05, 0.5)),
    "soft": Numbers(k=(1e-6, 1e-2), c=(1e-7, 1e-2), load=(1e-3, 1e-1), gap=(0.1, 5.0), end=(20.0, 200.0)),
    "accumulation": Numbers(e=(0.03, 0.6), load=(2.0, 40.0), end=(2.0, 6.0)),
}


class Draw:
    """Random numbers of one kind."""

    def __init__(self, kind: str, seed: int, attempt: int) -> None:
        self.kind, self.rng = kind, np.random.default_rng([KINDS.index(kind), seed, attempt])
        self.ranges = NUMBERS.get(kind, Numbers())

    def chance(self, p: float) -> bool:
        return bool(self.rng.random() < p)

    def __call__(self, name: str) -> float:
        if self.kind == "ties":
            few = {
                "m": [1.0, 2.0],
                "k": [64.0],
                "c": [4.0],
                "gap": [0.0, 0.125, 0.25],
                "e": [0.0, 0.5, 1.0],
                "load": [0.0, 1.0],
                "v": [1.0, 2.0],
                "end": [2.5],
            }
            return float(self.rng.choice(few[name]))
        if name == "gap" and self.kind == "zero gaps" and self.chance(0.7):
            return 0.0
        if name == "e" and self.kind not in ("e = 1", "accumulation") and self.chance(0.2):
            return 0.0
        low, high = getattr(self.ranges, name)
        return float(math.exp(self.rng.uniform(math.log(low), math.log(high))))

    def signed(self, name: str) -> float:
        return self(name) * (1.0 if self.chance(0.5) else -1.0)

    def blocks(self, m: float) -> tuple[float, float]:
        """Return k and c of a Kelvin-Voigt block."""
        if self.kind != "critical damping":
            return self("k"), self("c")
        # c² = 4 k m without rounding: the double pole of m s² + c s + k.
        root = float(self.rng.choice([2.0, 4.0, 8.0, 16.0]))
        return m * root**2, 2.0 * m * root


def scheme_of(kind: str, seed: int, attempt: int = 0) -> tuple[li.Problem, float]:
    """Return a column of one to four bodies, with bumpers, plates on springs and dashpots, and how long to follow it."""
    draw = Draw(kind, seed, attempt)
    if kind == "stopped plates":
        return stopped_plates(draw, seed)
    n = int(draw.rng.choice([1, 2, 3, 4], p=[0.3, 0.35, 0.2, 0.15]))
    bodies = [f"b{i}" for i in range(n)]
    pressed = kind == "accumulation" and draw.chance(0.8)
    alike = kind == "ties" and draw.chance(0.5)
    elements: list = []
    q0, v0 = {}, {}
    masses = {}
    for node in bodies:
        m = float(draw.rng.choice([1.0, 4.0])) if kind == "critical damping" else 1.0 if alike else draw("m")
        masses[node] = m
        elements.append(li.Mass(node, m))
        if pressed or draw.chance(0.6):
            elements.append(li.Load(node, draw("load") if pressed or draw.chance(0.7) else -draw("load")))
        if kind in ("plain", "stiff", "soft", "extreme units", "e = 1") and draw.chance(0.2):
            T = draw.ranges.end[1]
            elements.append(
                li.Load(node, li.Harmonic(draw("load"), draw.rng.uniform(1.0, 20.0) / T, draw.rng.uniform(0, 6)))
            )
        if draw.chance(0.8):
            v0[node] = draw.signed("v")
        if pressed:
            continue
        if draw.chance(0.35):
            k, c = draw.blocks(m)
            element = (
                li.Spring(node, "ground", k),
                li.Dashpot(node, "ground", c),
                li.KelvinVoigt(node, "ground", k, c),
            )
            elements.append(element[int(draw.rng.integers(3))])
    for j, (a, b) in enumerate([*pairwise(bodies), (bodies[-1], "ground"), ("ground", bodies[0])]):
        chosen = draw.rng.random()
        last = b == "ground"
        if a == "ground" and (pressed or draw.chance(0.3)):
            continue
        if chosen < (0.9 if pressed else 0.55):
            elements.append(li.Bumper(a, b, gap=draw("gap"), e=draw("e"), name=f"R{j}"))
        elif chosen < 0.85 or (last and not any(isinstance(each, li.Bumper) for each in elements)):
            k, c = draw.blocks(masses.get(a, masses.get(b, 1.0)))
            plate, upper, lower = f"p{j}", a, b
            if draw.chance(0.5):
                upper, lower = plate, b
                held = a
            else:
                upper, lower = a, plate
                held = b
            kinds = (li.Spring(plate, held, k), li.Dashpot(plate, held, c), li.KelvinVoigt(plate, held, k, c))
            elements.append(kinds[int(draw.rng.integers(3))])
            elements.append(li.Bumper(upper, lower, gap=draw("gap"), name=f"R{j}"))
        elif not last and a != "ground" and draw.chance(0.7):
            k, c = draw.blocks(masses[a])
            elements.append(li.Spring(a, b, k) if draw.chance(0.5) else li.KelvinVoigt(a, b, k, c))
    end = draw("end")
    if kind == "extreme units":
        elements, q0, v0, end = rescaled(draw, elements, q0, v0, end)
    return li.Problem(f"{kind} {seed}", li.Scheme(*elements), q0=q0, v0=v0), end


def stopped_plates(draw: Draw, seed: int) -> tuple[li.Problem, float]:
    """Return bodies that meet plates without mass, which meet each other, stops or other bodies."""
    elements: list = []
    v0 = {}
    bodies = [f"b{i}" for i in range(int(draw.rng.choice([1, 2], p=[0.6, 0.4])))]
    plates = [f"p{i}" for i in range(int(draw.rng.choice([1, 2], p=[0.6, 0.4])))]
    for node in bodies:
        elements.append(li.Mass(node, draw("m")))
        elements.append(li.Load(node, 3.0 * draw("load")))
        v0[node] = draw("v") if draw.chance(0.8) else -draw("v")
        if draw.chance(0.25):
            elements.append(li.KelvinVoigt(node, "ground", draw("k"), draw("c")))
    for i, node in enumerate(plates):
        held = plates[i - 1] if i and draw.chance(0.3) else bodies[-1] if draw.chance(0.2) else "ground"
        k, c = draw("k"), draw("c")
        kinds = (li.Spring(node, held, k), li.Dashpot(node, held, c), li.KelvinVoigt(node, held, k, c))
        elements.append(kinds[int(draw.rng.choice(3, p=[0.3, 0.1, 0.6]))])
        if draw.chance(0.3):
            elements.append(li.Load(node, draw.signed("load")))
    pairs = [(body, plates[0]) for body in bodies] + [*pairwise(plates), (plates[-1], "ground")]
    if len(bodies) == 2 and draw.chance(0.3):
        pairs[1] = ("b0", "b1") if draw.chance(0.5) else (plates[-1], "b1")
    if draw.chance(0.2):
        pairs.append((plates[0], "ground") if len(plates) == 2 else ("ground", plates[0]))
    for j, (upper, lower) in enumerate(pairs):
        gap, e = 0.0 if draw.chance(0.2) else draw("gap"), draw("e")
        try:
            trial = [
                *elements,
                *(li.Bumper(a, b, gap=1.0, e=0.5, name=f"T{i}") for i, (a, b) in enumerate(pairs[j + 1 :])),
            ]
            li.Scheme(*trial, li.Bumper(upper, lower, gap=gap, e=e, name=f"R{j}")).assemble()
            elements.append(li.Bumper(upper, lower, gap=gap, e=e, name=f"R{j}"))
        except li.InputError:
            elements.append(li.Bumper(upper, lower, gap=gap, name=f"R{j}"))
    return li.Problem(f"stopped plates {seed}", li.Scheme(*elements), v0=v0), 0.5 * draw("end")


def rescaled(draw: Draw, elements: list, q0: dict, v0: dict, end: float) -> tuple[list, dict, dict, float]:
    """Return the same scheme in units of mass, length and time that are far from kg, m and s."""
    M, L, T = (10.0 ** draw.rng.uniform(-power, power) for power in (9.0, 9.0, 6.0))
    unit = {"m": M, "k": M / T**2, "c": M / T, "gap": L, "e": 1.0, "f": M * L / T**2}
    found = []
    for each in elements:
        changed = {}
        for f in fields(each):
            value = getattr(each, f.name)
            if f.name in unit and isinstance(value, float):
                changed[f.name] = value * unit[f.name]
            elif isinstance(value, li.Harmonic):
                changed[f.name] = li.Harmonic(value.amplitude * unit["f"], value.omega / T, value.phase)
        found.append(replace(each, **changed))
    return found, {k: v * L for k, v in q0.items()}, {k: v * L / T for k, v in v0.items()}, end * T


def nudged(problem: li.Problem, seed: int) -> li.Problem:
    """Return the problem with each of its numbers one ulp up or down."""
    rng = np.random.default_rng(seed)

    def ulp(value: float) -> float:
        if value in (0.0, 1.0):
            return value
        return float(np.nextafter(value, math.inf if rng.random() < 0.5 else -math.inf))

    elements = []
    for each in problem.scheme.elements:
        changed = {}
        for f in fields(each):
            value = getattr(each, f.name)
            if isinstance(value, float):
                changed[f.name] = ulp(value)
            elif isinstance(value, li.Harmonic):
                changed[f.name] = li.Harmonic(ulp(value.amplitude), ulp(value.omega), ulp(value.phase))
        elements.append(replace(each, **changed))
    q0, v0 = ({node: ulp(value) for node, value in values.items()} for values in (problem.q0, problem.v0))
    return li.Problem(problem.name, li.Scheme(*elements), q0=q0, v0=v0)


@dataclass(frozen=True)
class Seen:
    """What is compared of a run: events in groups of one instant, and the motion on a grid."""

    times: list[float]
    groups: list[Counter]
    impulses: list[dict[str, float]]
    q: np.ndarray
    v: np.ndarray
    r: np.ndarray

    @classmethod
    def of(cls, events, skipped, end, q, v, r) -> Seen:
        """Group (t, kind, contact, impulse); events near the end of an accumulation are not counted."""
        times, groups, impulses = [], [], []
        # Impacts that rounding would hide are not counted either.
        least = 1e-12 * max((impulse for _, _, _, impulse in events), default=0.0)
        for t, kind, contact, impulse in sorted(events):
            if kind == "impact" and impulse < least:
                continue
            if any(abs(t - limit) < 1e-6 * end and contact in names for limit, names in skipped):
                continue
            if not times or t - times[-1] > 1e-9 * end:
                times.append(t)
                groups.append(Counter())
                impulses.append({})
            groups[-1][kind, contact] += 1
            impulses[-1][contact] = impulses[-1].get(contact, 0.0) + impulse
        return cls(times, groups, impulses, q, v, r)


GRID = 32


def follow(problem: li.Problem, end: float) -> tuple[Reference, float]:
    """Return the reference, and the end of the run, earlier where there are many events; those that accumulate are one."""
    found = Reference(problem, end, enough=MOST)
    if found.segments[-1].t < end and len(found.apart) >= MOST:
        end = 0.5 * (found.apart[-2] + found.apart[-1])
    return found, end


def draw_scheme(kind: str, seed: int) -> tuple[li.Problem, Reference, float]:
    """Return a scheme, its reference and the end of its run; one in which little happens is drawn anew, but for a few."""
    for attempt in range(12):
        try:
            problem, end = scheme_of(kind, seed, attempt)
        except li.InputError:
            continue
        truth, end = follow(problem, end)
        if len(truth.apart) > 2 or seed % 10 == 0:
            break
    return problem, truth, end


def seen_in_reference(found: Reference, end: float) -> Seen:
    events = [(float(each.t), each.kind, each.contact, float(each.impulse)) for each in found.events if each.t <= end]
    skipped = [(float(t), names) for t, names in found.accumulations]
    samples = [found.at(t) for t in grid(end)]
    return Seen.of(events, skipped, end, *(np.array(each) for each in zip(*samples, strict=True)))


def seen_in_run(run: li.Trajectory, found: Reference, end: float) -> Seen:
    events = [(each.t, each.kind, each.contact, each.impulse) for each in run.events]
    skipped = [(float(t), names) for t, names in found.accumulations]
    return Seen.of(events, skipped, end, run.q, run.v, run.reaction)


def grid(end: float) -> list[float]:
    return [end * i / GRID for i in range(GRID + 1)]


def differences(one: Seen, other: Seen, end: float, away: np.ndarray) -> dict[str, float]:
    """Return how far two runs are apart, each number in the units of the run; ``away`` tells which samples count."""
    if one.groups != other.groups:
        return {"events": math.inf}
    found = {"events": 0.0}
    found["times"] = max((abs(a - b) for a, b in zip(one.times, other.times, strict=True)), default=0.0) / end
    found["q"] = _largest(one.q - other.q, one.q)
    found["v"] = _largest((one.v - other.v)[away], one.v)
    impulses = np.array([value for each in one.impulses for _, value in sorted(each.items())])
    others = np.array([value for each in other.impulses for _, value in sorted(each.items())])
    found["impulses"] = _largest(impulses - others, impulses)
    # Where only impulses act, their mean over the run is the scale of forces.
    found["r"] = _largest((one.r - other.r)[away], np.append(one.r, np.abs(impulses) / end))
    return found


def _largest(difference: np.ndarray, motion: np.ndarray) -> float:
    scale = np.abs(motion).max(initial=0.0)
    largest = np.abs(difference).max(initial=0.0)
    # What lies still moves by the rounding of double-doubles.
    return float(largest / scale) if scale > 1e-25 else float(largest > 1e-25)


ALLOWED = {"events": 0.0, "times": TIME, "q": PLACE, "v": RATE, "r": RATE, "impulses": RATE}

FADING = {("stiff", 105)}
"""Here a force fades as exp(-25000 t), which the reference takes for zero, and thus for an opening, below its digits."""


@dataclass(frozen=True)
class Verdict:
    """What came of one scheme: "agrees", "ill-conditioned", "refused", "undecided" or "wrong", with what was off."""

    outcome: str
    why: str = ""


def judge(kind: str, seed: int) -> Verdict:
    """Compare `exact` with the reference."""
    if (kind, seed) in FADING:
        return Verdict("undecided", "a force fades below the digits of the reference")
    try:
        problem, truth, end = draw_scheme(kind, seed)
    except Undecided as error:
        return Verdict("undecided", str(error))
    try:
        run = li.simulate(problem, "exact", dt=end / GRID, t_end=end, throw=False)
    except li.UnsupportedError as error:
        return Verdict("refused", str(error))
    if not run.success:
        return Verdict("refused", run.message)
    expected, found = seen_in_reference(truth, end), seen_in_run(run, truth, end)
    switches = [float(each.t) for each in truth.events]
    away = np.array([all(abs(t - s) > 1e-9 * end for s in switches) for t in grid(end)])
    off = differences(expected, found, end, away)
    if all(off[name] <= ALLOWED[name] for name in off):
        return Verdict("agrees")
    # Ten times what one ulp in the data changes.
    largest = dict.fromkeys(ALLOWED, 0.0)
    for sample in range(4):
        try:
            changed = Reference(nudged(problem, sample), end)
            moved = differences(expected, seen_in_reference(changed, end), end, away)
        except (Undecided, li.InputError):
            moved = {"events": math.inf}
        for name in moved:
            largest[name] = max(largest[name], moved[name])
        if largest["events"] or all(off[name] <= max(ALLOWED[name], 10.0 * largest[name]) for name in off):
            return Verdict("ill-conditioned", f"{off} where one ulp changes {largest}")
    return Verdict("wrong", ", ".join(f"{name} {off[name]:.1e} (ulp {largest[name]:.1e})" for name in off))


def examine(kind: str, seeds: range) -> Counter:
    """Return the outcomes; a wrong one fails with the command that shows it."""
    outcomes, wrong = Counter(), []
    for seed in seeds:
        verdict = judge(kind, seed)
        outcomes[verdict.outcome] += 1
        if verdict.outcome == "wrong":
            wrong.append(f"python {sys.argv[0]} '{kind}' {seed}: {verdict.why}")
    assert not wrong, "\n".join(wrong)
    return outcomes


@pytest.mark.parametrize("kind", KINDS)
def test_exact_is_right_on_a_few_schemes(kind):
    outcomes = examine(kind, range(5))
    assert outcomes["agrees"] >= 3


LAST = dict.fromkeys(KINDS, 45) | {"stiff": 20, "stopped plates": 30}
"""Seeds end before this one; the reference of some kinds takes seconds a scheme."""


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_exact_is_right_or_refuses(kind):
    seeds = range(5, LAST[kind])
    outcomes = examine(kind, seeds)
    judged = sum(outcomes.values()) - outcomes["undecided"]
    assert judged >= 0.85 * len(seeds)
    assert outcomes["refused"] <= 0.04 * judged
    assert outcomes["agrees"] >= 0.8 * judged


def main() -> None:
    """Print both lists of events."""
    kind, seed = sys.argv[1], int(sys.argv[2])
    problem, truth, end = draw_scheme(kind, seed)
    print(problem.scheme, dict(problem.v0), f"t_end = {end!r}", sep="\n")
    run = li.simulate(problem, "exact", dt=end / GRID, t_end=end, throw=False)
    print("accumulations:", [(float(t), names) for t, names in truth.accumulations])
    sides = seen_in_reference(truth, end), seen_in_run(run, truth, end)
    print("but for those near an accumulation:", f"{'reference':50} exact: {run.message}", sep="\n")
    lines = [
        [
            (t, f"{t:<22.16g} {kind:7} {contact:3} {impulses.get(contact, 0.0):.10g}")
            for t, group, impulses in zip(side.times, side.groups, side.impulses, strict=True)
            for kind, contact in sorted(group)
        ]
        for side in sides
    ]
    while lines[0] or lines[1]:
        next_times = [side[0][0] if side else math.inf for side in lines]
        shown = [
            side.pop(0)[1] if t <= min(next_times) + 1e-9 * end else ""
            for t, side in zip(next_times, lines, strict=True)
        ]
        print(f"{shown[0]:50} {shown[1]}")
    print(judge(kind, seed))


if __name__ == "__main__":
    main()
