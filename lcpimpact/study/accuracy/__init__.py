"""Studies of accuracy: errors and their norms, convergence, observed orders, comparisons, cross-validation."""
