"""Building blocks of the methods that step.

- `time_stepping`: the base class of the methods that solve an LCP in each step; `halving`: step control by halving.
- `linear_step`: methods whose step is a linear system of equations, written with symbols; `kernel`: the loop that runs them.
- `law`, `newton`: the contact problem of a step, and Newton's method where springs are not linear.
- `impulse_paths`, `static_balance`: impacts through massless nodes, and quasi-static nodes.
- `runge_kutta`: explicit Runge-Kutta methods.
"""
