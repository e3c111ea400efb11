r"""
A slow belt makes a block stick and slip
========================================

A block on a spring is carried along by a belt until the spring outweighs static friction
:math:`\mu_s N`; it slips under the smaller kinetic friction :math:`\mu N`, and the belt catches it again. With
:math:`\Delta = (\mu_s - \mu) m g/k` it sticks for :math:`2\Delta/v_b` in every period: the slower the belt, the longer.
"""

import matplotlib.pyplot as plt
import numpy as np

import lcpimpact as li

# %%
# In the phase plane the block sticks on a straight piece at the speed of the belt and slips on an arc of an ellipse.

with li.style() as palette:
    figure, (motion, plane) = plt.subplots(
        1, 2, figsize=(7.6, 3.6), layout="constrained"
    )
    for v_b, color, line in (
        (0.1, palette[0], "-"),
        (0.2, palette[1], "--"),
        (0.4, palette[2], ":"),
    ):
        run = li.simulate(
            li.load_problem("stick-slip-belt", v_b=v_b),
            "exact",
            dt=4e-3,
            t_end=4.0,
        )
        sticks = [event.t for event in run.events if event.kind == "stick"]
        print(f"v_b = {v_b:g} m/s: period {np.diff(sticks).mean():.4f} s")
        motion.plot(
            run.t,
            run["x"],
            color=color,
            linestyle=line,
            label=f"$v_b$ = {v_b:g} m/s",
        )
        plane.plot(run["x"], run["v_x"], color=color, linestyle=line)
    motion.set(xlabel="$t$ [s]", ylabel="$x$ [m]", xlim=(0.0, 4.0))
    plane.set(xlabel="$x$ [m]", ylabel="$v$ [m/s]")
    plane.axhline(0.0, color="black", linewidth=0.6)
    figure.legend(
        *motion.get_legend_handles_labels(),
        loc="outside lower center",
        ncols=3,
    )
    plt.show()
