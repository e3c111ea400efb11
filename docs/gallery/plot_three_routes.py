"""
Three independent routes to System 3 agree
==========================================

System No. 3 of Grzesikiewicz and Zbiciak is a body on a spring and a dashpot, a bumper, and a plate on a spring and a
dashpot. The exact solution joins matrix exponentials at the events; ``moreau-jean`` solves a linear complementarity problem
in each step; ``rk4-paper`` is the Runge-Kutta method with case distinctions of the paper. None uses the results of another.
"""

import matplotlib.pyplot as plt
import numpy as np

import lcpimpact as li

system = li.load_problem("system-3")
exact, lcp, rk4 = (
    li.simulate(system, method, dt=1e-2, t_end=3.0)
    for method in ("exact", "moreau-jean", "rk4-paper")
)
for event in exact.events:
    print(f"the contact {event.kind}s at {event.t:.6f} s")

# %%
# The force jumps where the contact closes: its plates stand on dashpots, and the approach speed is positive. The LCP's force
# is the mean over a step, so it lives at the middle of the step. The error of the position, against the exact solution, is
# below: that of ``rk4-paper`` grows by orders of magnitude at an event, since its step does not know where in the step the
# contact changes.

with li.style() as palette:
    figure, (force, error) = plt.subplots(
        2,
        1,
        sharex=True,
        figsize=(7.0, 5.2),
        layout="constrained",
        height_ratios=(2, 1),
    )
    force.plot(
        exact.t,
        exact["R"],
        color="lightsteelblue",
        linewidth=5.0,
        label="exact",
    )
    force.plot(
        lcp.t_reaction,
        lcp["R"],
        "o",
        color=palette[0],
        markerfacecolor="none",
        markevery=8,
        label="moreau-jean",
    )
    force.plot(
        rk4.t_reaction,
        rk4["R"],
        "x",
        color=palette[1],
        markevery=(4, 8),
        label="rk4-paper",
    )
    force.set(ylabel="$R$ [N]", xlim=(0.0, 3.0))
    force.legend()
    for run, look in (
        (lcp, {"color": palette[0]}),
        (rk4, {"color": palette[1], "linestyle": "--"}),
    ):
        difference = np.abs(run["x"] - exact.sample(run.t).q[:, 0])
        error.semilogy(
            run.t[1:],
            difference[1:],
            label=run.method.partition("(")[0],
            **look,
        )
    error.set(
        xlabel="$t$ [s]",
        ylabel="$|x - x_\\mathrm{exact}|$ [m]",
        ylim=(1e-11, 1e-1),
    )
    error.legend(loc="lower right")
    plt.show()
