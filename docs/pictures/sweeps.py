"""Draw the pictures of docs/guide/sweeps.md: python docs/pictures/sweeps.py."""

from pathlib import Path

import numpy as np

from lcpimpact import draw_samples, load_problem, plot_sobol, plot_sweep, sobol_indices, sweep

IMAGES = Path(__file__).parents[1] / "images"


def main() -> None:
    """Write the three pictures."""
    problem = load_problem("system-1")
    grid = {"k_o": np.linspace(3000.0, 5000.0, 20), "c_o": np.linspace(50.0, 600.0, 20)}
    found = sweep(problem, grid, dt=1e-2, outputs=("peak_force",))
    plot_sweep(found, "peak_force").save(IMAGES / "sweep-map.svg")
    ranges = {"m": (90.0, 110.0), "k_o": (3000.0, 5000.0), "c_o": (100.0, 400.0), "h_o": (4.0, 6.0)}
    samples = sweep(problem, draw_samples(ranges, 128), dt=1e-2, outputs=("restitution",))
    plot_sweep(samples).save(IMAGES / "sweep-samples.svg")
    found = sweep(problem, draw_samples(ranges, 512, "saltelli"), dt=1e-2, t_end=0.5, outputs=("peak_force",))
    plot_sobol(sobol_indices(found, "peak_force"), "system-1: peak_force").save(IMAGES / "sweep-sobol.svg")


if __name__ == "__main__":
    main()
