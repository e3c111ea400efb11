r"""
Two balls and a wall count the digits of π
==========================================

A heavy ball drives a light one against a wall, and all impacts are elastic. In the plane of the coordinates weighted by
:math:`\sqrt M` and :math:`\sqrt m` the point moves on a straight line inside a wedge of the angle
:math:`\theta = \arctan\sqrt{m/M}` and is reflected at its sides, at most :math:`\lceil \pi/\theta\rceil - 1` times
(Galperin, 2003). For :math:`M/m = 100^k` that number has the first :math:`k + 1` digits of π.
"""

import matplotlib.pyplot as plt
import numpy as np

import lcpimpact as li

runs = {}
for k in range(3):
    problem = li.load_problem("pi-billiard", M=100.0**k)
    runs[k] = li.simulate(problem, "exact", dt=problem.t_end / 200)
    count = sum(event.kind == "impact" for event in runs[k].events)
    print(f"M/m = {100**k}: {count} impacts")

# %%
# The heavy ball is slowed at each impact and turns round; the light ball goes to and fro between it and the wall. Distances
# are measured from the wall.

with li.style() as palette:
    figure, (time, wedge) = plt.subplots(
        1, 2, figsize=(7.6, 3.6), layout="constrained"
    )
    run, M, D, d = runs[1], 100.0, 1.0, 1.0
    t = np.union1d(run.t, [event.t for event in run.events])
    q = run.sample(t).q
    X, x = D + d - q[:, 0], d - q[:, 1]
    time.plot(t, X, color=palette[1], linestyle="--", label="heavy, $X$")
    time.plot(t, x, color=palette[0], label="light, $x$")
    time.set(xlabel="$t$ [s]", ylabel="distance from the wall [m]")
    time.legend()
    wedge.plot(np.sqrt(M) * X, x, color=palette[2])
    side = np.array([0.0, 20.0])
    wedge.fill_between(side, 0.0, side / np.sqrt(M), color="#eef1f5")
    wedge.set(
        xlabel="$\\sqrt{M}\\, X$ [kg$^{1/2}$ m]",
        ylabel="$\\sqrt{m}\\, x$ [kg$^{1/2}$ m]",
        title="the billiard in its wedge",
    )
    plt.show()
