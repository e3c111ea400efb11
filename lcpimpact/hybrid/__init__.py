"""Hybrid motion of piecewise linear systems: contact modes, their flows, and the events between them.

- `flow`: the motion within one mode, exp(A t) X, and the first zero of its event functions; `generator`: A and the series of
  exp(A δ) X; `windows`: proofs that no event is missed; `sampling`: values at many times; `spectrum`: fast and slow rates.
- `system`: the system in first-order form, its modes, their constraints and event functions; `gaps`: gaps and rates.
- `mode_choice`: the choice of the next mode by linear complementarity problems; `mixed_degrees`: the same for contacts
  without a common relative degree; `impacts`: Newton's law of impact.
- `complementarity`, `impact_law`: those problems in double-doubles; the law of impact over paths of massless nodes.
- `event_loop`: the loop from event to event, for any integrator between them: limits, failures, one-sided limits.
- `transition`: impacts, the next mode, and the events between two modes.
- `motion`: the exact motion as a chain of modes.
- `burst`: accumulating impacts of several bodies, for numerical methods; `tangent`: derivatives of the motion.
- `state_jump`: jumps of systems with inconsistent initial states.
- `forced_modes`, `dense_output`: contact modes under general forces, and events on the dense output of SciPy's solvers.
- `radau_iia`: the collocation method of Radau IIA; `finite_elements`: its elements in one contact mode, and the proof that
  no event falls into them.
"""
