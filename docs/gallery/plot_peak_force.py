r"""
The peak force of a buffer is least at a middle damping
=======================================================

System 1: a body on a bumper with spring and dashpot. A weak dashpot lets the spring stop the body, a strong one stops it
by itself: the force at first touch is :math:`c_o v_o`. Between them lies the damping of the least peak force, for each
stiffness another. A sweep runs all 66 buffers at once.
"""

import matplotlib.pyplot as plt
import numpy as np

import lcpimpact as li

problem = li.load_problem("system-1")
grid = {
    "k_o": np.linspace(1000.0, 6000.0, 6),
    "c_o": np.linspace(50.0, 850.0, 11),
}
found = li.sweep(
    problem, grid, dt=2e-2, t_end=0.6, outputs=("peak_force",), progress=False
)
peak = found["peak_force"].transpose("c_o", "k_o")

with li.style() as palette:
    figure, ax = plt.subplots(figsize=(6.4, 4.4), layout="constrained")
    lines = ax.contourf(
        grid["k_o"], grid["c_o"], peak / 1e3, 14, cmap="cividis"
    )
    figure.colorbar(lines, label="peak force [kN]")
    best = grid["c_o"][peak.argmin("c_o")]
    ax.plot(
        grid["k_o"],
        best,
        "o",
        color=palette[1],
        markeredgecolor="white",
        clip_on=False,
        label="least of each column",
    )
    ax.set(xlabel="$k_o$ [N/m]", ylabel="$c_o$ [N s/m]")
    ax.grid(False)
    ax.legend()
    i = 3
    print(
        f"k_o = {grid['k_o'][i]:.0f} N/m: "
        f"least at c_o = {best[i]:.0f} N s/m, {float(peak.min('c_o')[i]):.0f} N"
    )
    plt.show()
