r"""
θ = 1/2 keeps the energy of a step, θ = 1 eats it
=================================================

The step of ``moreau-jean`` balances forces at the position :math:`\theta` within the step. For a linear vibration the
energy of a step is kept exactly at :math:`\theta = 1/2` and is lost in proportion to :math:`h` at :math:`\theta = 1`. In
System 2 only the dashpot below the plate should take energy out.
"""

import matplotlib.pyplot as plt

import lcpimpact as li

system = li.load_problem("system-2")


def energy(run):
    """Return the stored energy over time: kinetic, elastic, of the load."""
    table = li.energy_ledger(run).table
    return table["t"], table[["kinetic", "elastic", "gravity"]].sum(axis=1)


with li.style() as palette:
    figure, ax = plt.subplots(figsize=(7.0, 3.8), layout="constrained")
    ax.plot(
        *energy(li.simulate(system, "exact", dt=1e-2, t_end=3.0)),
        color="lightsteelblue",
        linewidth=5.0,
        label="exact",
    )
    for theta, h, color, line in (
        (0.5, 1e-2, palette[0], "-"),
        (1.0, 1e-2, palette[1], "--"),
        (1.0, 2.5e-3, palette[2], ":"),
    ):
        run = li.simulate(system, "moreau-jean", dt=h, t_end=3.0, theta=theta)
        t, E = energy(run)
        print(
            f"theta = {theta:g}, h = {h:g} s: "
            f"energy at 3 s {E.iloc[-1]:8.2f} J"
        )
        ax.plot(
            t,
            E,
            color=color,
            linestyle=line,
            label=f"$\\theta$ = {theta:g}, $h$ = {h:g} s",
        )
    ax.set(xlabel="$t$ [s]", ylabel="stored energy [J]", xlim=(0.0, 3.0))
    ax.legend()
    plt.show()
