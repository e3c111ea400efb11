r"""
A rope that comes taut is a bumper seen from the other side
===========================================================

A scheme of one's own: a load falls on an elastic rope. ``Rope`` pulls where a ``Bumper`` pushes, by the same law
:math:`0 \le u \perp T \ge 0`, with u the slack that is left. The spring in series makes it elastic, the dashpot
dissipates.
"""

import matplotlib.pyplot as plt

import lcpimpact as li

m, g, slack = 80.0, 9.81, 4.0
scheme = li.Scheme(
    li.KelvinVoigt("ground", "y", k=4e3, c=300.0),
    li.Rope("y", "x", slack=slack),
    li.Mass("x", m=m),
    li.Load("x", f=m * g, symbols=("mg",)),
)
fall = li.Problem("a fall into a rope", scheme)
run = li.simulate(fall, "exact", dt=5e-3, t_end=6.0)
print(
    f"peak tension {run['T'].max():.0f} N, "
    f"that is {run['T'].max() / (m * g):.1f} times the weight"
)
print([(event.kind, round(event.t, 3)) for event in run.events])

# %%
# The rope is slack in free fall, taut from 4 m on, and slack again while the load bounces.

with li.style() as palette:
    figure = plt.figure(figsize=(8.4, 4.2), layout="constrained")
    scheme_ax, right = figure.subplots(1, 2, width_ratios=(1, 1.4))
    li.draw_scheme(scheme, scheme_ax)
    right.remove()
    grid = right.get_subplotspec().subgridspec(2, 1, height_ratios=(2, 1))
    place, tension = grid.subplots(sharex=True)
    place.plot(run.t, run["x"], color=palette[0], label="load $x$")
    place.plot(
        run.t,
        run["y"],
        color=palette[1],
        linestyle="--",
        label="end of the spring $y$",
    )
    place.invert_yaxis()
    place.set_ylabel("down to [m]")
    place.legend()
    tension.plot(run.t_reaction, run["T"] / 1e3, color=palette[2])
    tension.set(xlabel="$t$ [s]", ylabel="$T$ [kN]", xlim=(0.0, 6.0))
    plt.show()
