"""Make the pictures of comparing.md: ``python docs/comparing.py``."""

from pathlib import Path

from lcpimpact import (
    compare,
    cross_validate,
    energy_ledger,
    load_problem,
    plot_comparison,
    plot_cross_validation,
    plot_ledger,
    simulate,
)

IMAGES = Path(__file__).parent / "images"

if __name__ == "__main__":
    system = load_problem("system-3")
    plot_comparison(compare(system, ["moreau-jean", "rk4-paper"], dt=1e-2), IMAGES / "comparing.svg")
    run = simulate(system, "exact", dt=1e-2, t_end=3.0, progress=False)
    plot_ledger(energy_ledger(run), IMAGES / "ledger.svg")
    plot_cross_validation(cross_validate(system), IMAGES / "cross-validation.svg")
