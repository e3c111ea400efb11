r"""
A Hertzian contact shortens with speed, a linear one does not
=============================================================

A steel ball of 10 mm radius strikes a wall. By Hertz's law, :math:`f = K\delta^{3/2}`, the contact time falls as
:math:`v_0^{-1/5}` and the peak force grows as :math:`v_0^{6/5}`. A linear spring behind a bumper, of the stiffness that
gives the same contact time at 1 m/s, has :math:`T = \pi\sqrt{m/k}` at every speed and a force in proportion to :math:`v_0`.
"""

import matplotlib.pyplot as plt
import numpy as np

import lcpimpact as li

m, K = 0.0327, 1.54e10


def hertz_time(v0):
    """Return the contact time of Hertz's law, 2.94327518 δ_max/v0."""
    return 2.94327518 * (5.0 * m * v0**2 / (4.0 * K)) ** 0.4 / v0


k = m * (np.pi / hertz_time(1.0)) ** 2
scheme = li.Scheme(
    li.Mass("x", m=m), li.Bumper("x", "z"), li.Spring("z", "ground", k=k)
)
print(
    f"contact time at 1 m/s: {1e6 * hertz_time(1.0):.1f} µs; k = {k:.3g} N/m"
)

# %%
# Force over time for three speeds, and the contact time over the speed.

with li.style() as palette:
    figure, (force, times) = plt.subplots(
        1, 2, figsize=(7.6, 3.6), layout="constrained"
    )
    for v0, color in (
        (0.5, palette[2]),
        (1.0, palette[0]),
        (2.0, palette[1]),
    ):
        end = 1.2 * hertz_time(0.5)
        hertz = li.simulate(
            li.load_problem("hertz-impact", m=m, K=K, v0=v0),
            dt=end / 400,
            t_end=end,
        )
        linear = li.simulate(
            li.Problem("linear", scheme, v0={"x": v0}),
            "exact",
            dt=end / 400,
            t_end=end,
        )
        force.plot(
            1e6 * hertz.t_reaction,
            hertz["F"] / 1e3,
            color=color,
            label=f"Hertz, {v0:g} m/s",
        )
        force.plot(
            1e6 * linear.t_reaction,
            linear["R"] / 1e3,
            color=color,
            linestyle="--",
            label=f"linear, {v0:g} m/s",
        )
        opened = next(
            event.t for event in linear.events if event.kind == "open"
        )
        times.plot(v0, 1e6 * hertz.events[-1].t, "o", color=color)
        times.plot(
            v0, 1e6 * opened, "s", color=color, markerfacecolor="white"
        )
    force.set(xlabel="$t$ [µs]", ylabel="force [kN]")
    force.legend(fontsize=8.0)
    v = np.geomspace(0.4, 2.5, 40)
    times.loglog(
        v, 1e6 * hertz_time(v), color=palette[0], label="Hertz, $v_0^{-1/5}$"
    )
    times.loglog(
        v,
        np.full_like(v, 1e6 * np.pi * np.sqrt(m / k)),
        color=palette[1],
        linestyle="--",
        label="linear",
    )
    times.set(
        xlabel="$v_0$ [m/s]",
        ylabel="contact time [µs]",
        xticks=(0.5, 1.0, 2.0),
        xticklabels=("0.5", "1", "2"),
    )
    times.set(yticks=(60, 70, 80), yticklabels=("60", "70", "80"))
    times.minorticks_off()
    times.legend()
    plt.show()
