r"""
Three balls collapse if e is below 7 - 4√3
==========================================

Three equal balls in a row: the middle one goes to and fro between the others. Let :math:`p_n` be the speed of approach of
the pair that meets at the n-th impact; then

.. math:: p_{n+1} = \tfrac{1 + e}{2}\, p_n - e\, p_{n-1},

a linear map. Its eigenvalues are real for :math:`e \le e^* = 7 - 4\sqrt 3 = 0.0718`: the impacts never end, in finite time.
Above it they are complex, :math:`p_n` becomes negative, and the balls part after a finite number of impacts.
"""

import matplotlib.pyplot as plt
import numpy as np

import lcpimpact as li

collapse = li.simulate(
    li.load_problem("inelastic-collapse", e=0.05),
    "exact",
    dt=1e-3,
    t_end=0.75,
)
print(collapse)

# %%
# On the left the paths for e = 0.05, up to and beyond the accumulation of the impacts. On the right the speed of
# approach over the number of the impact, by the map: it falls for ever, or ends.

with li.style() as palette:
    figure, (path, speed) = plt.subplots(
        1, 2, figsize=(7.6, 3.6), layout="constrained"
    )
    for name, color, line, place in zip(
        ("x1", "x2", "x3"),
        palette,
        ("-", "--", ":"),
        (0.0, 0.1, 0.3),
        strict=False,
    ):
        path.plot(
            collapse.t,
            collapse[name] + place,
            line,
            color=color,
            label=f"ball {name[1]}",
        )
    path.set(xlabel="$t$ [s]", ylabel="place [m]", title="$e$ = 0.05")
    path.legend()
    for e, color, marker in (
        (0.05, palette[0], "o"),
        (0.0718, palette[2], "s"),
        (0.08, palette[1], "D"),
        (0.12, palette[3], "^"),
    ):
        p = [0.0, 1.0]
        while p[-1] > 1e-8 and len(p) < 40:
            p.append(0.5 * (1.0 + e) * p[-1] - e * p[-2])
        p = np.array([each for each in p[1:] if each > 0.0])
        speed.semilogy(
            p,
            color=color,
            marker=marker,
            markersize=3.5,
            label=f"$e$ = {e:g}",
        )
        problem = li.load_problem("inelastic-collapse", e=e)
        run = li.simulate(problem, "exact", dt=problem.t_end / 100)
        count = sum(event.kind == "impact" for event in run.events)
        print(f"e = {e:g}: {count} impacts in the run")
    speed.set(
        xlabel="number $n$ of the impact",
        ylabel="speed of approach $p_n$ [m/s]",
        ylim=(1e-8, 2.0),
    )
    speed.legend()
    plt.show()
