r"""
Conservation laws do not decide what Newton's cradle does
=========================================================

Five equal balls in a row; the first one strikes. With a gap between neighbours each impact is alone and hands the whole
speed on. With no gap all contacts are struck at once, and Moreau's law of impact moves the four others as one body: 0.4 of
the speed each, and the first comes back with 0.6. Both conserve momentum and energy.
"""

import matplotlib.pyplot as plt

import lcpimpact as li

with li.style() as palette:
    figure, axes = plt.subplots(
        1,
        2,
        sharex=True,
        sharey=True,
        figsize=(7.6, 3.4),
        layout="constrained",
    )
    for ax, gap in zip(axes, (0.01, 0.0), strict=True):
        cradle = li.load_problem("newtons-cradle", delta=gap)
        run = li.simulate(cradle, "exact", dt=1e-3, t_end=0.26)
        v = run.v[-1]
        print(
            f"gap {gap:g} m: v = {v.round(6) + 0.0} m/s, "
            f"momentum {v.sum():.4g} kg m/s, energy {0.5 * (v @ v):.4g} J"
        )
        for i, color in enumerate(palette[:5]):
            # Each ball is drawn 5 cm behind its neighbour: their diameter.
            ax.plot(run.t, run.q[:, i] + 0.05 * i, color=color)
            ax.annotate(
                f"{i + 1}",
                (run.t[-1], run.q[-1, i] + 0.05 * i),
                (3.0, 0.0),
                textcoords="offset points",
                va="center",
            )
        ax.set(xlabel="$t$ [s]", title=f"gap {1e3 * gap:g} mm")
    axes[0].set_ylabel("position of the ball [m]")
    plt.show()
