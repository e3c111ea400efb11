r"""
Lemke's method walks along edges to the solution
================================================

For the problem :math:`w = M z + q,\ 0 \le z \perp w \ge 0` Lemke's method adds a covering variable :math:`z_0` to each
row, :math:`w = M z + q + z_0`, and exchanges one variable after another with :math:`z_i w_i = 0` throughout, until
:math:`z_0` is gone. The cones show why there is one solution: :math:`M` is a P-matrix, and
each :math:`q` lies in one complementary cone.
"""

import matplotlib.pyplot as plt
import numpy as np

import lcpimpact as li

M, q = [[2.0, 1.0], [1.0, 2.0]], [-5.0, -6.0]
trace = li.solve_lcp(M, q, "lemke", trace=True).trace
print(trace)

# %%
# On the left the path in the plane of :math:`z`, with the lines :math:`(M z + q)_i = 0` that it ends on; the numbers are
# those of the table, with the value of :math:`z_0`. On the right :math:`q` in the cone spanned by :math:`-M_1` and
# :math:`-M_2`: both :math:`z_i` are above 0.

with li.style() as palette:
    figure, (path, cones) = plt.subplots(
        1, 2, figsize=(9.4, 4.0), layout="constrained"
    )
    z = np.array([step.z for step in trace.steps])
    path.plot(z[:, 0], z[:, 1], "o-", color=palette[0])
    for number, step in enumerate(trace.steps, start=1):
        path.annotate(
            f"{number}: $z_0$ = {step.z0:g}",
            step.z,
            (8.0, 0.0),
            textcoords="offset points",
            va="center",
        )
    z_1 = np.array([0.0, 3.2])
    for i, line in enumerate(("--", ":")):
        path.plot(
            z_1,
            (-q[i] - M[i][0] * z_1) / M[i][1],
            line,
            color="black",
            linewidth=0.9,
            label=f"$(Mz + q)_{i + 1} = 0$",
        )
    path.set(
        xlabel="$z_1$", ylabel="$z_2$", xlim=(-0.1, 3.2), ylim=(-0.2, 3.6)
    )
    path.legend(loc="lower left")
    li.plot_cones(M, q, ax=cones)
    cones.set_title("")
    plt.show()
