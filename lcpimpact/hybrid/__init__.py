"""Hybrid motion of piecewise linear systems: modes of the contacts, and what leads from one to the next.

- `flow`: the motion within one mode, exp(A t) X, and the first instant at which a function of it falls through zero.
- `system`: the system in first-order form, its modes, and what each holds and ends with; `gaps`: gaps and rates of a state.
- `mode_choice`: the choice of the next mode by linear complementarity problems; `mixed_degrees`: the same for contacts
  without a common relative degree; `impacts`: Newton's law of impact.
- `complementarity`, `impact_law`: those problems in double-doubles; the law of impact over paths of massless nodes.
- `event_loop`: from event to event, whatever integrates between them: limits, failures, and the motion on either side.
- `transition`: impacts, the mode that follows, and the events that this makes.
- `motion`: the chain of modes from the start to the end, and what it is at any time.
- `burst`: accumulating impacts at one instant for methods that step; `tangent`: derivatives of the motion.
- `state_jump`: systems that begin outside their constraints.
"""
