r"""
A dashpot sets the restitution, the stiffness the contact time
==============================================================

A body of mass m on a bumper with a spring k and a dashpot c behind its plate. Without gravity the restitution depends on
the damping ratio :math:`\zeta = c/(2\sqrt{k m})` alone, and the contact time is :math:`\sqrt{m/k}` times a function of
:math:`\zeta`. So the two can be chosen apart: ``design`` finds k and c from them.
"""

import matplotlib.pyplot as plt
import numpy as np

import lcpimpact as li

e = np.linspace(0.15, 0.9, 7)
t_c = np.array([2e-3, 5e-3, 10e-3])
found = [
    [
        li.design(
            "kelvin-voigt", m=1.0, v0=2.0, e=float(a), contact_time=float(b)
        )
        for a in e
    ]
    for b in t_c
]
one = found[2][3]
print(
    f"e = {one.e:g}, t_c = {one.contact_time:g} s: "
    f"k = {one.k:.5g} N/m, c = {one.c:.5g} N s/m"
)

# %%
# Each line is the same curve, shifted: k goes as :math:`1/t_c^2` and c as :math:`1/t_c`. On the right the points of
# all three lines fall on one curve.

with li.style() as palette:
    figure, (plane, ratio) = plt.subplots(
        1, 2, figsize=(7.6, 3.6), layout="constrained"
    )
    for row, time, color, marker in zip(
        found, t_c, palette, "os^", strict=False
    ):
        k, c = (
            np.array([each.k for each in row]),
            np.array([each.c for each in row]),
        )
        plane.loglog(
            k,
            c,
            color=color,
            marker=marker,
            markersize=4.0,
            label=f"$t_c$ = {1e3 * time:g} ms",
        )
        ratio.plot(
            e,
            c / (2.0 * np.sqrt(k)),
            color=color,
            marker=marker,
            markersize=9.0 - 2.5 * "os^".index(marker),
            linestyle="none",
        )
    plane.set(xlabel="$k$ [N/m]", ylabel="$c$ [N s/m]")
    plane.legend()
    ratio.set(xlabel="restitution $e$", ylabel="$\\zeta = c/(2\\sqrt{k m})$")
    plt.show()
