r"""
The derivative of a time-stepping run across an impact
======================================================

How does the place of a ball at 1 s depend on the height :math:`H` of its fall? Runs of ``moreau-jean`` converge to the
motion, and as a function of :math:`H` they are staircases with level treads: their derivative is zero with every step,
where the truth is -0.3865. ``lcpimpact.sensitivity`` has the tangent.
"""

import matplotlib.pyplot as plt
import numpy as np

import lcpimpact as li

heights = np.linspace(0.95, 1.05, 161)


def places(method, steps):
    """Return x(1) over the heights."""
    found = []
    for H in heights:
        ball = li.load_problem("bouncing-ball", e=0.8, H=H)
        run = li.simulate(ball, method, dt=1 / steps, t_end=1.0)
        found.append(run["x"][-1])
    return np.array(found)


ball = li.load_problem("bouncing-ball", e=0.8)
table = li.sensitivity(ball, ["H"], ["x@1"], t_end=1.0).table
value, slope = table["value"][0], table["H"][0]
print(f"dx(1)/dH = {slope:.12f}")

with li.style() as palette:
    figure, ax = plt.subplots(figsize=(7.0, 3.8), layout="constrained")
    ax.plot(
        heights,
        places("exact", 10),
        color="lightsteelblue",
        linewidth=5.0,
        label="exact",
    )
    for steps, color in ((37, palette[1]), (151, palette[0])):
        ax.step(
            heights,
            places("moreau-jean", steps),
            color=color,
            where="mid",
            label=f"moreau-jean, {steps} steps",
        )
    ax.plot(
        heights,
        value + slope * (heights - 1.0),
        "--",
        color="black",
        linewidth=1.0,
        label="sensitivity at $H$ = 1 m",
    )
    ax.set(xlabel="$H$ [m]", ylabel="$x(1)$ [m]", xlim=(0.95, 1.05))
    ax.legend()
    plt.show()
