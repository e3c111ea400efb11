"""Explicit Runge-Kutta methods, with an LCP at each stage.

- `method`: methods with steps of dt, from start to end; `control`: embedded ones, whose error estimate controls their steps.
- `tableau`: coefficients and their order; `right_side`: the right-hand side at one instant, with the `dashpots`
  whose rates follow from it; `loop`: the loop over steps.
- `corrections`: impulses and positions at the end of a step; `events`: impacts, closings and openings within a step.
- `run`: what is carried from block to block, and the coordinates of its states.
"""
