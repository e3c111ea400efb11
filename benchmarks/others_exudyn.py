"""The contestant Exudyn in `others.py`: contacts by stiffness and damping, and friction of bristles, with implicit steps.

Written after its test models contactCoordinateTest (`ObjectContactCoordinate`, which reduces the step at the switch, with
the trapezoidal rule) and coordinateSpringDamperExt (the bristle model of friction, with the generalized-α method, which its
manual recommends for it). There is no coefficient of restitution; the damping is chosen for it, by the usual formula, which
is exact for a contact that pulls before it opens, as this one does. The default has step and stiffness of those models;
tuned has a smaller step and stiffer contacts.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import exudyn as exu
import exudyn.itemInterface as item
import numpy as np
from others_penalty import damping_ratio
from others_problems import CASES, Array, Motion, shaken
from others_scipy import C_O, K_O, V_O, C, G, K, M

VERSIONS = ("exudyn",)


class Setting(NamedTuple):
    """The step in s, and the stiffness of contacts in N/m and of bristles in N/m."""

    h: float
    contact: float
    bristle: float


class System:
    """Masses on one line, after the commands of its tutorials; q of all of them is recorded at each step."""

    def __init__(self, title: str, setting: Setting) -> None:
        self.title, self.setting = title, setting
        self.mbs = exu.SystemContainer().AddSystem()
        ground = self.mbs.AddNode(item.NodePointGround(referenceCoordinates=[0.0, 0.0, 0.0]))
        self.ground = self.mbs.AddMarker(item.MarkerNodeCoordinate(nodeNumber=ground, coordinate=0))
        self.sensors: list[Any] = []

    def mass(self, m: float, q: float = 0.0, v: float = 0.0) -> Any:
        """Add a mass, and return the marker of its coordinate."""
        node = self.mbs.AddNode(item.Node1D(referenceCoordinates=[0.0], initialCoordinates=[q], initialVelocities=[v]))
        self.mbs.AddObject(item.Mass1D(nodeNumber=node, mass=m))
        for kind in (exu.OutputVariableType.Coordinates, exu.OutputVariableType.Coordinates_t):
            self.sensors.append(
                self.mbs.AddSensor(item.SensorNode(nodeNumber=node, storeInternal=True, outputVariableType=kind))
            )
        return self.mbs.AddMarker(item.MarkerNodeCoordinate(nodeNumber=node, coordinate=0))

    def contact(self, below: Any, above: Any, gap: float, k: float, c: float) -> None:
        """Add a contact: above minus below is at least -gap."""
        data = self.mbs.AddNode(item.NodeGenericData(initialCoordinates=[gap], numberOfDataCoordinates=1))
        self.mbs.AddObject(
            item.ObjectContactCoordinate(
                markerNumbers=[below, above], nodeNumber=data, contactStiffness=k, contactDamping=c, offset=-gap
            )
        )

    def spring(self, marker: Any, k: float, c: float, offset: float = 0.0, other: Any = None) -> None:
        """Add a spring and a dashpot to the ground or to another mass."""
        markers = [self.ground if other is None else other, marker]
        self.mbs.AddObject(item.CoordinateSpringDamper(markerNumbers=markers, stiffness=k, damping=c, offset=offset))

    def friction(self, marker: Any, force: float, slips: float) -> None:
        """Add dry friction against the ground, with the direction in which it slips at the start."""
        k = self.setting.bristle
        data = self.mbs.AddNode(item.NodeGenericData(initialCoordinates=[slips, 0.0, 0.0], numberOfDataCoordinates=3))
        self.mbs.AddObject(
            item.CoordinateSpringDamperExt(
                markerNumbers=[self.ground, marker], nodeNumber=data, fDynamicFriction=force, stickingStiffness=k,
                stickingDamping=2.0 * math.sqrt(k), frictionProportionalZone=0.0,
            )
        )  # fmt: skip

    def load(self, marker: Any, force: float, of_time: Callable[[float], float] | None = None) -> None:
        """Add a load."""
        more = {} if of_time is None else {"loadUserFunction": lambda mbs, t, load: of_time(t)}
        self.mbs.AddLoad(item.LoadCoordinate(markerNumber=marker, load=force, **more))

    def solved(
        self, solver: Any = exu.DynamicSolverType.TrapezoidalIndex2, accelerations: Sequence[float] = ()
    ) -> tuple[Array, Array, Array]:
        """Run it, and return t, q and v; accelerations at the start are given where massless nodes have none.

        Raises
        ------
        RuntimeError
            If the solver gives up.
        """
        self.mbs.Assemble()
        if accelerations:
            self.mbs.systemData.SetODE2Coordinates_tt(accelerations, exu.ConfigurationType.Initial)
        t_end = CASES[self.title].t_end
        settings = exu.SimulationSettings()
        settings.solution.file.write = False
        settings.solution.sensors.writePeriod = 1e-10
        time = settings.timeIntegration
        time.numberOfSteps, time.endTime, time.minimumStepSize = round(t_end / self.setting.h), t_end, 1e-12
        time.verboseMode = 0
        time.generalizedAlpha.computeInitialAccelerations = not accelerations
        time.newton.useModifiedNewton = False
        time.discontinuous.iterationTolerance = 1e-3
        time.discontinuous.maxIterations = 2
        time.discontinuous.ignoreMaxIterations = False
        time.adaptiveStepRecoverySteps, time.adaptiveStepIncrease = 0, 10
        time.generalizedAlpha.spectralRadius = 1.0 if solver == exu.DynamicSolverType.TrapezoidalIndex2 else 0.9
        try:
            self.mbs.SolveDynamic(settings, solverType=solver)
        except RuntimeError as failure:
            raise RuntimeError(f"its solver gives up: {failure}") from None
        data = [self.mbs.GetSensorStoredData(each) for each in self.sensors]
        q, v = (np.column_stack([each[:, 1] for each in data[which::2]]) for which in (0, 1))
        return data[0][:, 0], q, v


def damping(setting: Setting, m: float, e: float) -> float:
    """Return the damping of a contact with the restitution e for the effective mass m."""
    return 2.0 * damping_ratio(e, exact=False) * math.sqrt(setting.contact * m)


def ball(title: str, setting: Setting) -> Motion:
    """Return the bouncing ball."""
    system = System(title, setting)
    body = system.mass(1.0)
    system.load(body, 9.81)
    system.contact(body, system.ground, 1.0, setting.contact, damping(setting, 1.0, 0.8))
    return Motion(*system.solved())


def impact_oscillator(title: str, setting: Setting) -> Motion:
    """Return the oscillator that strikes its stop."""
    system = System(title, setting)
    body = system.mass(1.0, v=float(CASES[title].problem.v0["x"]))
    system.spring(body, 1.0, 0.1)
    system.load(body, 0.0, shaken)
    system.contact(body, system.ground, 0.0, setting.contact, damping(setting, 1.0, 0.8))
    return Motion(*system.solved())


def row(
    masses: list[float], gaps: list[float], wall: float | None, v: list[float], title: str, setting: Setting
) -> Motion:
    """Return bodies in a row with elastic contacts between them, and with a wall if there is one."""
    system = System(title, setting)
    markers = [system.mass(m, v=speed) for m, speed in zip(masses, v, strict=True)]
    for i, gap in enumerate(gaps):
        system.contact(markers[i], markers[i + 1], gap, setting.contact, 0.0)
    if wall is not None:
        system.contact(markers[-1], system.ground, wall, setting.contact, 0.0)
    return Motion(*system.solved())


def coulomb(title: str, setting: Setting) -> Motion:
    """Return the oscillator with dry friction."""
    system = System(title, setting)
    body = system.mass(1.0, q=0.53)
    system.spring(body, 100.0, 0.0)
    system.friction(body, 5.0, -5.0)
    return Motion(*system.solved(exu.DynamicSolverType.GeneralizedAlpha))


def incline(title: str, setting: Setting) -> Motion:
    """Return the block on the incline, whose normal force is known."""
    α = math.pi / 6.0
    system, friction = System(title, setting), 0.7 * 9.81 * math.cos(α)
    body = system.mass(1.0, v=2.0)
    system.load(body, 9.81 * math.sin(α))
    system.friction(body, friction, friction)
    t, q, v = system.solved(exu.DynamicSolverType.GeneralizedAlpha)
    still = np.zeros((len(t), 1))
    return Motion(t, np.hstack([q, still]), np.hstack([v, still]))


def on_plate(title: str, setting: Setting, contact: float, series: tuple[float, float] | None = None) -> Motion:
    """Return the body on the massless plate of Systems 1 to 3; in series is the spring and dashpot of System 3."""
    system = System(title, setting)
    body = system.mass(M, v=V_O)
    system.load(body, M * G)
    upper = body
    if series is not None:
        upper = system.mass(0.0)
        system.spring(upper, *series, other=body)
    plate = system.mass(0.0)
    system.spring(plate, K_O, C_O)
    system.contact(upper, plate, 0.0, contact, 0.0)
    t, q, v = system.solved(accelerations=[G] + [0.0] * (len(system.sensors) // 2 - 1))
    return Motion(t, q[:, :1], v[:, :1], contact * np.maximum(q[:, -2] - q[:, -1], 0.0))


RUNS: dict[str, Callable[[str, Setting], Motion]] = {
    "bouncing-ball": ball,
    "bouncing-ball to rest": ball,
    "system-1": lambda title, setting: on_plate(title, setting, setting.contact),
    "system-2": lambda title, setting: on_plate(title, setting, K),
    "system-3": lambda title, setting: on_plate(title, setting, setting.contact, (K, C)),
    "impact-oscillator": impact_oscillator,
    "newtons-cradle": partial(row, [1.0] * 5, [0.1, 0.01, 0.01, 0.01], None, [1.0, 0.0, 0.0, 0.0, 0.0]),
    "pi-billiard": partial(row, [100.0, 1.0], [1.0], 1.0, [1.0, 0.0]),
    "coulomb-oscillator": coulomb,
    "block-on-incline": incline,
}

ABSENT = dict.fromkeys(("diode-bridge", "filippov"), "no mechanics")


def settings(title: str) -> dict[str, tuple[str, partial[Motion]]]:
    """Return the runs of a problem."""
    rubs = title in ("coulomb-oscillator", "block-on-incline")
    runs = {}
    for key, it in (("default", Setting(2e-4, 2e6, 1e4)), ("tuned", Setting(2e-5, 1e8, 1e8))):
        stiffness = f"bristles {it.bristle:g} N/m" if rubs else f"k = {K if title == 'system-2' else it.contact:g} N/m"
        runs[key] = (f"h = {it.h:g} s, {stiffness}", partial(RUNS[title], title, it))
    return runs
