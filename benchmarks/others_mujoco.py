r"""The contestant MuJoCo in `others.py`: its soft contacts, limits and friction losses.

A contact is a spring and a dashpot for a unit mass, ``solref = (-k, -c)`` ("Solver parameters" in the chapter Modeling of
MuJoCo's documentation); there is no coefficient of restitution, and c is chosen for it. The default has MuJoCo's own time
step and impedance, and a contact that lasts ten steps; tuned has short steps, stiff contacts and an impedance next to one.
"""

from __future__ import annotations

import math
from functools import partial
from typing import NamedTuple

import mujoco
import numpy as np
from others_penalty import damping_ratio
from others_problems import CASES, Motion, shaken

VERSIONS = ("mujoco",)

R = 0.05
"""Radius of all balls in m; their motion does not know it."""


class Setting(NamedTuple):
    """The time step in s, the stiffness of contacts for a unit mass in 1/s², and impedance and friction to go with it."""

    h: float
    stiffness: float
    solimp: str
    friction: str
    exact: bool

    def solref(self, e: float) -> str:
        """Return the contact's parameters for the restitution e: -k, -c for a unit mass."""
        ζ = damping_ratio(e, self.exact) if e > 0.0 else 1.0
        return f"{-self.stiffness} {-2.0 * ζ * math.sqrt(self.stiffness)}"


OWN = "0.9 0.95 0.001"
"""MuJoCo's own impedance."""

DEFAULT = Setting(2e-3, 2.5e4, OWN, "0.02 1", exact=False)
TUNED = Setting(2e-5, 1e7, "0.9999 0.9999 0.001", "0.00004 1", exact=True)


def model(body: str, setting: Setting, e: float, gravity: str = "0 0 0", option: str = "") -> mujoco.MjModel:
    """Return a compiled model with the contact parameters for the restitution e."""
    return mujoco.MjModel.from_xml_string(f"""
    <mujoco>
      <option timestep="{setting.h}" gravity="{gravity}" {option}/>
      <default>
        <geom solref="{setting.solref(e)}" solimp="{setting.solimp}" condim="1"/>
        <joint solreflimit="{setting.solref(e)}" solimplimit="{setting.solimp}"
          solreffriction="{setting.friction}" solimpfriction="{setting.solimp}"/>
      </default>
      <worldbody>{body}</worldbody>
    </mujoco>""")


def stepped(m: mujoco.MjModel, title: str, v: list[float], force: bool = False) -> tuple[np.ndarray, ...]:
    """Return t, q and v of all joints after every step."""
    data = mujoco.MjData(m)
    data.qvel[:] = v
    steps = round(CASES[title].t_end / m.opt.timestep)
    q, rates = np.zeros((steps + 1, m.nv)), np.zeros((steps + 1, m.nv))
    q[0], rates[0] = data.qpos, data.qvel
    for k in range(steps):
        if force:
            data.qfrc_applied[0] = shaken(data.time + 0.5 * m.opt.timestep)
        mujoco.mj_step(m, data)
        q[k + 1], rates[k + 1] = data.qpos, data.qvel
    return m.opt.timestep * np.arange(steps + 1), q, rates


def ball(title: str, setting: Setting) -> Motion:
    """Return a sphere on a plane."""
    body = f"""<geom type="plane" size="1 1 1"/>
      <body pos="0 0 {1.0 + R}"><joint type="slide" axis="0 0 1"/><geom type="sphere" size="{R}" mass="1"/></body>"""
    t, q, v = stepped(model(body, setting, 0.8, "0 0 -9.81"), title, [0.0])
    return Motion(t, -q, -v)


def impact_oscillator(title: str, setting: Setting) -> Motion:
    """Return a sliding joint with a spring, a dashpot, and a limit as the stop."""
    body = f"""<body><joint type="slide" axis="1 0 0" stiffness="1" damping="0.1" limited="true" range="-100 0"/>
      <geom type="sphere" size="{R}" mass="1"/></body>"""
    v = float(CASES[title].problem.v0["x"])
    return Motion(*stepped(model(body, setting, 0.8), title, [v], force=True))


def row(
    masses: list[float], gaps: list[float], wall: float | None, v: list[float], title: str, setting: Setting
) -> Motion:
    """Return spheres on one line, with a wall to their right if there is one."""
    places = np.cumsum([0.0, *(2.0 * R + gap for gap in gaps)])
    body = "".join(
        f"""<body pos="{x} 0 0"><joint type="slide" axis="1 0 0"/><geom type="sphere" size="{R}" mass="{m}"/></body>"""
        for x, m in zip(places, masses, strict=True)
    )
    if wall is not None:
        body += f"""<geom type="plane" size="1 1 1" pos="{places[-1] + R + wall} 0 0" zaxis="-1 0 0"/>"""
    return Motion(*stepped(model(body, setting, 1.0), title, v))


def coulomb(title: str, setting: Setting) -> Motion:
    """Return a sliding joint with a spring and a friction loss."""
    body = f"""<body><joint type="slide" axis="1 0 0" stiffness="100" springref="-0.53" frictionloss="5"/>
      <geom type="sphere" size="{R}" mass="1"/></body>"""
    t, q, v = stepped(model(body, setting, 0.0), title, [0.0])
    return Motion(t, q + 0.53, v)


def incline(title: str, setting: Setting) -> Motion:
    """Return a block on a plane under inclined gravity; MuJoCo advises elliptic cones and impratio > 1 against creep."""
    α = math.pi / 6.0
    body = f"""<geom type="plane" size="10 10 1" condim="3" friction="0.7"/>
      <body pos="0 0 {R}"><joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/>
      <geom type="box" size="{R} {R} {R}" mass="1" condim="3" friction="0.7"/></body>"""
    option = 'cone="elliptic" impratio="100"' if setting.exact else ""
    gravity = f"{9.81 * math.sin(α)} 0 {-9.81 * math.cos(α)}"
    t, q, v = stepped(model(body, setting, 0.0, gravity, option), title, [2.0, 0.0])
    return Motion(t, q * [1.0, -1.0], v * [1.0, -1.0])


RUNS = {
    "bouncing-ball": ball,
    "bouncing-ball to rest": ball,
    "impact-oscillator": impact_oscillator,
    "newtons-cradle": partial(row, [1.0] * 5, [0.1, 0.01, 0.01, 0.01], None, [1.0, 0.0, 0.0, 0.0, 0.0]),
    "pi-billiard": partial(row, [100.0, 1.0], [1.0], 1.0, [1.0, 0.0]),
    "coulomb-oscillator": coulomb,
    "block-on-incline": incline,
}

MASSLESS = "a massless plate: MuJoCo's joints need inertia"
ABSENT = {
    **dict.fromkeys(("system-1", "system-2", "system-3"), MASSLESS),
    "diode-bridge": "no mechanics",
    "filippov": "no mechanics",
}


def settings(title: str) -> dict[str, tuple[str, partial[Motion]]]:
    """Return the runs of a problem."""
    return {
        key: (f"h = {it.h:g} s, k/m = {it.stiffness:g} 1/s²", partial(RUNS[title], title, it))
        for key, it in (("default", DEFAULT), ("tuned", TUNED))
    }
