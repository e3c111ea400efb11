"""Random schemes that benchmarks and tests run."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

import lcpimpact as li


def random_problem(seed: int) -> li.Problem:
    """A column of up to four nodes, some massless, with gaps between some of them and at both ends."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 5))
    nodes = [f"n{i}" for i in range(n)]
    massive = rng.random(n) < 0.6
    massive[int(rng.integers(n))] = True
    elements, v0 = [], {}
    for i, node in enumerate(nodes):
        if massive[i]:
            elements += [li.Mass(node, rng.uniform(0.5, 5.0)), li.Load(node, rng.uniform(-5.0, 20.0))]
            elements += [li.Load(node, li.Harmonic(rng.uniform(1.0, 20.0), rng.uniform(1.0, 8.0)))]
            v0[node] = float(rng.normal() * 3.0)
        else:
            k, c = rng.uniform(50.0, 500.0), rng.uniform(2.0, 30.0)
            other = "ground" if rng.random() < 0.5 or n == 1 else nodes[(i + 1) % n]
            held = (li.Spring(node, other, k), li.KelvinVoigt(node, other, k, c), li.Dashpot(node, other, c))
            elements.append(held[int(rng.integers(3))])
    elements.append(li.KelvinVoigt(nodes[0], "ground", rng.uniform(20.0, 200.0), rng.uniform(0.5, 5.0)))
    for j, (a, b) in enumerate([*pairwise(nodes), (nodes[-1], "ground"), ("ground", nodes[0])]):
        if rng.random() < 0.6:
            gap, e = rng.uniform(0.0, 0.3), rng.uniform(0.0, 0.8)
            try:
                scheme = li.Scheme(*elements, li.Bumper(a, b, gap=gap, name=f"R{j}"))
                scheme.assemble()
            except li.InputError:
                scheme = li.Scheme(*elements, li.Bumper(a, b, gap=gap, e=e, name=f"R{j}"))
            elements = list(scheme.elements)
    return li.Problem(f"random {seed}", li.Scheme(*elements), v0=v0)


def frictional(seed: int) -> li.Problem:
    """The same with sliders, Jenkins elements and sliders behind dashpots, to the ground or to a shaker."""
    base, rng = random_problem(seed), np.random.default_rng(10_000 + seed)
    elements = list(base.scheme.elements)
    for j, node in enumerate(base.dynamics.nodes):
        other = "ground" if rng.random() < 0.5 else "shaker"
        name, r0, k = f"F{j}", rng.uniform(1.0, 15.0), rng.uniform(50.0, 500.0)
        chosen = int(rng.integers(4))
        if chosen == 0:
            elements.append(li.Slider(node, other, r0, name))
        elif chosen == 1:
            hardening = None if rng.random() < 0.5 else rng.uniform(5.0, 50.0)
            elements.append(li.Jenkins(node, other, k, r0, hardening, name))
        elif chosen == 2:
            inner = f"i{j}"
            elements += [li.KelvinVoigt(node, inner, k, rng.uniform(1.0, 20.0)), li.Slider(inner, other, r0, name)]
    if any("shaker" in element.nodes for element in elements):
        motion = li.Harmonic(rng.uniform(0.05, 0.2), rng.uniform(2.0, 8.0), -0.5 * np.pi)
        elements.append(li.PrescribedMotion("shaker", motion))
    return li.Problem(f"frictional {seed}", li.Scheme(*elements), v0=base.v0)
