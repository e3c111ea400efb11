"""Draw docs/images/norms.svg: why the sup of v does not converge across impacts, and what does.

python docs/pictures/norms.py
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from lcpimpact import Drawing, error_norms, load_problem, reference, simulate, style, sup_v

PICTURE = Path(__file__).parents[1] / "images" / "norms.svg"
T_END = 1.7
COUNTS = (53, 83, 131, 211, 331, 523, 829, 1307, 2069, 3271, 5167, 8167)
SHOWN = {
    "sup_q": r"$\sup\,|q-q^{\ast}|$ [m]",
    "l1_v": r"$\int\,|v-v^{\ast}|\,dt$ [m]",
    "l2_v": r"$\|v-v^{\ast}\|_{L^2}$ [m/s$^{1/2}$]",
}


@style()
def draw() -> Drawing:
    """Return the picture: v about an impact by three step counts, and the norms over the step."""
    ball = load_problem("bouncing-ball")
    truth = reference(ball, T_END).trajectory
    figure = Drawing(figsize=(7.2, 3.1), layout="constrained")
    near, far = figure.subplots(1, 2)

    impact = truth.events[0]
    t = np.linspace(impact.t - 0.06, impact.t + 0.06, 241)
    v = truth.sample(t).v[:, 0]
    v[np.argmin(np.abs(t - impact.t))] = np.nan
    near.plot(t - impact.t, v, color="lightsteelblue", linewidth=4.0, label="exact")
    for n, colour, marker in ((53, "C1", "o"), (211, "C0", "s")):
        run = simulate(ball, dt=T_END / n, t_end=T_END)
        near.plot(run.t - impact.t, run.v[:, 0], color=colour, marker=marker, markersize=3.5, label=f"$h$ = 1.7/{n} s")
    near.set_xlim(-0.06, 0.06)
    near.set_xlabel("$t - t_1$ [s]")
    near.set_ylabel("$v$ [m/s]")
    near.legend(loc="upper left", bbox_to_anchor=(0.52, 0.98))

    h = T_END / np.array(COUNTS)
    found = []
    for n in COUNTS:
        run = simulate(ball, dt=T_END / n, t_end=T_END)
        found.append([sup_v(run, truth), *error_norms(run, truth, [*SHOWN, "hausdorff_v"]).values()])
    labels = [r"$\sup\,|v-v^{\ast}|$ [m/s]", *SHOWN.values(), r"$d_H(v, v^{\ast})$ (no unit)"]
    order = [0, 3, 2, 1, 4]
    for place, (i, marker) in enumerate(zip(order, "oDs^v", strict=True)):
        far.loglog(
            h, np.array(found)[:, i], marker=marker, markersize=3.5, linewidth=0.9, color=f"C{(1, 3, 2, 0, 4)[place]}",
            label=labels[i],
        )  # fmt: skip
    for slope, text, start, at in ((1.0, "$h$", h[5], 7e-4), (0.5, "$h^{1/2}$", h[-2], 0.5)):
        guide = np.array([start, 3.0 * start])
        far.loglog(guide, at * (guide / start) ** slope, color="black", linewidth=0.8)
        far.text(1.1 * guide[1], at * 3.0**slope, text, va="center", fontsize=9)
    far.set_xlabel("$h$ [s]")
    far.set_ylabel("error, in the unit of its norm")
    far.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure


if __name__ == "__main__":
    draw().save(PICTURE)
