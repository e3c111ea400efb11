r"""
A time step passes infinitely many impacts
==========================================

A ball that loses a part of its speed at each impact, :math:`U^+ = -e\,U^-`, bounces infinitely often before

.. math:: t_\infty = \sqrt{2H/g}\; \frac{1 + e}{1 - e}

and then rests. A method that goes from impact to impact needs a rule to get past that instant; a step that solves for the
contact at its end needs none.
"""

import matplotlib.pyplot as plt
import numpy as np

import lcpimpact as li

H, g, e = 1.0, 9.81, 0.7
ball = li.load_problem("bouncing-ball", H=H, g=g, e=e)
run = li.simulate(ball, "moreau-jean", dt=2e-3, t_end=3.2)
rest = np.sqrt(2.0 * H / g) * (1.0 + e) / (1.0 - e)
print(
    f"at rest from {rest:.4f} s; "
    f"height of the last step {H - run['x'][-1]:.1e} m"
)

# %%
# Below, the impulse of each impact: a factor e from one to the next, until the steps no longer resolve them.

with li.style() as palette:
    figure, (height, force) = plt.subplots(
        2,
        1,
        sharex=True,
        figsize=(7.0, 4.6),
        layout="constrained",
        height_ratios=(2, 1),
    )
    height.plot(run.t, H - run["x"], color=palette[0])
    height.set(ylabel="height [m]", xlim=(0.0, 3.2))
    for ax in (height, force):
        ax.axvline(rest, color="black", linestyle="--", linewidth=0.9)
    height.annotate(
        "$t_\\infty$", (rest, 0.9), (4.0, 0.0), textcoords="offset points"
    )
    t = [event.t for event in run.events if event.kind == "impact"]
    force.semilogy(
        t,
        [event.impulse for event in run.events if event.kind == "impact"],
        "o",
        markersize=3.0,
        color=palette[1],
    )
    force.set(xlabel="$t$ [s]", ylabel="impulse [N s]")
    plt.show()
