"""Studies of periodic and other long motions: sections, diagrams, basins, orbits and their continuation, exponents."""
