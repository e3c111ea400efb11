"""A model answer: half a drift, the whole kick with Newton's law, half a drift."""

from dataclasses import dataclass

from lcpimpact import Declared, Feature, Law, LinearStep, Step


@dataclass(frozen=True)
class MyMethod(LinearStep):
    """Drift, kick, drift."""

    name = "my-method"
    instants = (0.5,)
    declared = Declared(
        summary="drift, kick, drift", source="the leapfrog of folklore", level="velocity",
        order_smooth=2, order_impact=1, order_penetration=1,
        relative_degrees=(2,), handles=(Feature.RESTITUTION,), reaction_time="at t + h/2",
        energy="near its value in smooth motion", dissipates=False,
    )  # fmt: skip

    def equations(self, y, d, h):
        q_half = y.q + 0.5 * h * y.v
        v = y.solve(d.M, y.momentum(y.v) + h * y.force(0.5, q_half, y.v) + y.push(y.P[0]))
        impact = Law(
            L=y.gap_rate(v) + d.restitution[:, None] * y.gap_rate(y.v), touching=y.gap(q_half), springs_at=(q_half, y.v)
        )
        return Step(q=q_half + 0.5 * h * v, v=v, impulse=y.P[0], laws=(impact,))
