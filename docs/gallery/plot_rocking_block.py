r"""
A rocking block has no frequency of its own
===========================================

Housner's slender block rocks from edge to edge. Between its impacts :math:`\theta'' = p^2(\theta - \alpha)`: gravity pulls
it back less the farther it is tilted, a spring of negative stiffness. The quarter of a period,

.. math:: \tfrac{T}{4} = \tfrac{1}{p}\,\operatorname{arcosh}\frac{1}{1 - \theta_0/\alpha},

goes to zero with the tilt :math:`\theta_0` and to infinity as it nears the slenderness angle :math:`\alpha`.
"""

import matplotlib.pyplot as plt
import numpy as np

import lcpimpact as li

p, alpha = 2.0, 0.2
with li.style() as palette:
    figure, (motion, period) = plt.subplots(
        1, 2, figsize=(7.6, 3.6), layout="constrained"
    )
    tilts = np.linspace(0.02, 0.98, 60)
    period.plot(
        tilts,
        np.arccosh(1.0 / (1.0 - tilts)) / p,
        color=palette[0],
        label="closed form",
    )
    for part, color, line in (
        (0.3, palette[2], ":"),
        (0.6, palette[1], "--"),
        (0.9, palette[3], "-"),
    ):
        run = li.simulate(
            li.load_problem(
                "rocking-block", p=p, alpha=alpha, theta=part * alpha
            ),
            "exact",
            dt=5e-3,
            t_end=5.0,
        )
        motion.plot(
            run.t,
            run["θ"] / alpha,
            color=color,
            linestyle=line,
            label=f"$\\theta_0 = {part:g}\\,\\alpha$",
        )
        first = next(
            event.t for event in run.events if event.kind == "impact"
        )
        period.plot(part, first, "o", color=color)
        quarter = np.arccosh(1.0 / (1.0 - part)) / p
        print(
            f"tilt {part:g} alpha: first impact at {first:.6f} s,",
            f"closed form {quarter:.6f} s",
        )
    motion.set(xlabel="$t$ [s]", ylabel="$|\\theta|/\\alpha$")
    motion.legend()
    period.set(xlabel="$\\theta_0/\\alpha$", ylabel="$T/4$ [s]")
    period.legend()
    plt.show()
