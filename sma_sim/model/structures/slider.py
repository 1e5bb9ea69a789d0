"""A slider that a wire pulls against a spring: the usual linear actuator.

m dv/dt = F - k (x + x_0) - b v - m g sin(incline);   wire length = L - x
"""

from __future__ import annotations

import math
from typing import Any

from sma_sim.model.parameters import Parameter
from sma_sim.model.structures.links import Drawing
from sma_sim.model.structures.structure import Coordinate, Structure

SOURCE = 'a usual bench actuator'


def lengths(q: Any, p: Any) -> float:
    """Length of the wire [m]: the slider moves towards its anchor."""
    return float(p.L - q.position)


def forces(q: Any, v: Any, p: Any) -> float:
    """Spring, damping and weight [N], against the wire's pull."""
    weight = p.m * p.g * math.sin(p.incline)
    return float(-p.k * (q.position + p.x_0) - p.b * v.position - weight)


STRUCTURE = Structure(
    name='slider',
    title='slider',
    coordinates=(Coordinate('position', 'm', lambda p: 0.01 * p.L, 'of the slider, towards the anchor of the wire'),),
    wires=1,
    lengths=lengths,
    gradients=lambda q, p: -1.0,
    forces=forces,
    stiffness=lambda q, p, part: part * p.k * (q.position + p.x_0),
    inertia=lambda p: p.m,
    parameters=(
        Parameter('L', 0.1, 'm', (1e-3, 10.0), 'length of the wire at position 0', SOURCE),
        Parameter('k', 40.0, 'N/m', (0.0, 1e7), 'stiffness of the spring', SOURCE),
        Parameter('x_0', 0.025, 'm', (-10.0, 10.0), 'extension of the spring at position 0', SOURCE),
        Parameter('m', 0.03, 'kg', (1e-6, 1e4), 'moving mass', SOURCE),
        Parameter('b', 2.0, 'N s/m', (0.0, 1e6), 'damping', SOURCE),
        Parameter('g', 9.81, 'm/s^2', (0.0, 100.0), 'gravity', SOURCE),
        Parameter('incline', 0.5 * math.pi, 'rad', (-0.5 * math.pi, 0.5 * math.pi),
                  'of the rail; positive: the wire lifts the slider', SOURCE),
    ),
    drawing=Drawing(wires=lambda q, p: [((p.L, 0.0, 0.0), (q.position, 0.0, 0.0))]),
    size_parameter='slider.L',
    fitted=('slider.k', 'slider.x_0', 'slider.b'),
    defaults={'wire.n': 1.0},
    energy=lambda q, v, p: 0.5 * p.m * v.position**2 + 0.5 * p.k * (q.position + p.x_0) ** 2
    + p.m * p.g * math.sin(p.incline) * q.position,
    description='one bundle; position is positive where the wire is shorter',
    source=SOURCE,
)  # fmt: skip
