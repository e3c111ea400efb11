"""Named, parametrised problems with their sources and closed forms. They hold no solver."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from lcpimpact.registry import Registry

if TYPE_CHECKING:
    from lcpimpact.problems.base import Problem

PROBLEMS: Registry[Callable[..., Problem]] = Registry(
    "problem",
    {
        "system-1": "lcpimpact.problems.paper:system_1",
        "system-2": "lcpimpact.problems.paper:system_2",
        "system-3": "lcpimpact.problems.paper:system_3",
        "bouncing-ball": "lcpimpact.problems.bouncing_ball:bouncing_ball",
        "ball-in-air": "lcpimpact.problems.ball_in_air:ball_in_air",
        "kelvin-voigt-impact": "lcpimpact.problems.viscoelastic_impact:kelvin_voigt_impact",
        "kelvin-voigt-tension": "lcpimpact.problems.viscoelastic_impact:kelvin_voigt_tension",
        "maxwell-impact": "lcpimpact.problems.viscoelastic_impact:maxwell_impact",
        "impact-oscillator": "lcpimpact.problems.oscillators:impact_oscillator",
        "shaw-holmes": "lcpimpact.problems.oscillators:shaw_holmes",
        "oscillator-stop": "lcpimpact.problems.oscillators:oscillator_stop",
        "bilinear-oscillator": "lcpimpact.problems.oscillators:bilinear_oscillator",
        "three-balls": "lcpimpact.problems.balls:three_balls",
        "two-ball-drop": "lcpimpact.problems.balls:two_ball_drop",
        "two-balls-spring": "lcpimpact.problems.balls:two_balls_spring",
        "newtons-cradle": "lcpimpact.problems.balls:newtons_cradle",
        "balls-on-springs": "lcpimpact.problems.ball_chains:balls_on_springs",
        "hertz-chain": "lcpimpact.problems.ball_chains:hertz_chain",
        "pi-billiard": "lcpimpact.problems.impact_counts:pi_billiard",
        "inelastic-collapse": "lcpimpact.problems.impact_counts:inelastic_collapse",
        "hertz-impact": "lcpimpact.problems.hertz:hertz_impact",
        "hunt-crossley-impact": "lcpimpact.problems.hertz:hunt_crossley_impact",
        "coulomb-oscillator": "lcpimpact.problems.friction:coulomb_oscillator",
        "forced-coulomb-oscillator": "lcpimpact.problems.friction:forced_coulomb_oscillator",
        "jenkins-cycle": "lcpimpact.problems.friction:jenkins_cycle",
        "block-on-incline": "lcpimpact.problems.sliding_blocks:block_on_incline",
        "block-on-belt": "lcpimpact.problems.sliding_blocks:block_on_belt",
        "stick-slip-belt": "lcpimpact.problems.sliding_blocks:stick_slip_belt",
        "inertia-drive": "lcpimpact.problems.inertia_drive:inertia_drive",
        "thrown-block": "lcpimpact.problems.sliding_blocks:thrown_block",
        "rolling-sphere": "lcpimpact.problems.rolling_balls:rolling_sphere",
        "draw-shot": "lcpimpact.problems.rolling_balls:draw_shot",
        "spinning-ball": "lcpimpact.problems.rolling_balls:spinning_ball",
        "super-ball": "lcpimpact.problems.rolling_balls:super_ball",
        "super-ball-table": "lcpimpact.problems.rolling_balls:super_ball_table",
        "woodpecker": "lcpimpact.problems.woodpecker:woodpecker",
        "vibrating-table": "lcpimpact.problems.vibrating_table:vibrating_table",
        "thrown-ball": "lcpimpact.problems.vibrating_table:thrown_ball",
        "plastic-ball": "lcpimpact.problems.vibrating_table:plastic_ball",
        "impact-pair": "lcpimpact.problems.impact_pair:impact_pair",
        "impact-damper": "lcpimpact.problems.impact_damper:impact_damper",
        "nonsmooth-mode": "lcpimpact.problems.nonsmooth_modes:nonsmooth_mode",
        "cam-follower": "lcpimpact.problems.cam_follower:cam_follower",
        "rocking-block": "lcpimpact.problems.rocking_block:rocking_block",
        "diode-bridge": "lcpimpact.problems.diode_bridge:diode_bridge",
        "diode-bridge-supply": "lcpimpact.problems.diode_bridge:diode_bridge_supply",
        "buck-converter": "lcpimpact.problems.buck_converter:buck_converter",
        "train-brakes": "lcpimpact.problems.train_brakes:train_brakes",
        "filippov": "lcpimpact.problems.relays:filippov",
        "sliding-mode": "lcpimpact.problems.relays:sliding_mode",
        "relay-oscillator": "lcpimpact.problems.relays:relay_oscillator",
        "twisting": "lcpimpact.problems.relays:twisting",
        "reflected-motion": "lcpimpact.problems.relays:reflected_motion",
        "hereditary-impact": "lcpimpact.problems.viscoelastic_impact:hereditary_impact",
        "bar-impact": "lcpimpact.problems.bars:bar_impact",
        "bouncing-bar": "lcpimpact.problems.bars:bouncing_bar",
        "plastic-bar-impact": "lcpimpact.problems.bars:plastic_bar_impact",
        "pendulum-xy": "lcpimpact.problems.pendulums:pendulum_xy",
        "pendulum-and-wall": "lcpimpact.problems.pendulums:pendulum_and_wall",
        "double-pendulum-stop": "lcpimpact.problems.pendulums:double_pendulum_stop",
        "rod-on-pin": "lcpimpact.problems.pendulums:rod_on_pin",
        "pendulum-cradle": "lcpimpact.problems.pendulums:pendulum_cradle",
        "kane-pendulum": "lcpimpact.problems.pendulums:kane_pendulum",
        "rocking-block-bodies": "lcpimpact.problems.blocks:rocking_block_bodies",
        "squat-block": "lcpimpact.problems.blocks:squat_block",
        "block-on-corners": "lcpimpact.problems.blocks:block_on_corners",
        "ball-with-spin": "lcpimpact.problems.rolling_bodies:ball_with_spin",
        "rolling-disc": "lcpimpact.problems.rolling_bodies:rolling_disc",
        "disc-in-bowl": "lcpimpact.problems.rolling_bodies:disc_in_bowl",
        "falling-rod": "lcpimpact.problems.rods:falling_rod",
        "tipping-plank": "lcpimpact.problems.rods:tipping_plank",
        "tumbling-rod": "lcpimpact.problems.rods:tumbling_rod",
        "bouncing-dimer": "lcpimpact.problems.rods:bouncing_dimer",
        "painleve-rod": "lcpimpact.problems.painleve:painleve_rod",
        "painleve-jam": "lcpimpact.problems.painleve:painleve_jam",
        "wedge-billiard": "lcpimpact.problems.billiards:wedge_billiard",
        "rotating-box": "lcpimpact.problems.billiards:rotating_box",
        "slider-crank": "lcpimpact.problems.mechanisms:slider_crank",
        "guided-slider-crank": "lcpimpact.problems.mechanisms:guided_slider_crank",
        "coupled-linkages": "lcpimpact.problems.mechanisms:four_bars",
        "rod-chain": "lcpimpact.problems.mechanisms:rod_chain",
        "woodpecker-bodies": "lcpimpact.problems.mechanisms:woodpecker_bodies",
    },
)


def load_problem(name: str, **parameters: float) -> Problem:
    """Return the registered problem ``name`` with some of its parameters changed.

    Parameters
    ----------
    name : str
        A name of ``lcpimpact list problems``.
    **parameters : float
        New values, in SI units; the others keep the values of the problem's source.

    Raises
    ------
    InputError
        For an unknown name or parameter (the nearest is offered), or a value that the problem refuses.

    Examples
    --------
    >>> load_problem("system-1", c_o=300.0).parameters["c_o"]
    300.0
    """
    from lcpimpact.problems.base import build

    return build(name, PROBLEMS[name], parameters)
