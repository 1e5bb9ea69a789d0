"""A slider that a wire pulls against a spring, the usual linear actuator; or two wires, one on either side.

m dv/dt = F_1 - F_2 - k (x + x_0) - b v - F_c tanh(v/v_c) - m g sin(incline)

The length of wire 1 is L - x, that of wire 2, which pulls the other way, L + x.
"""

from __future__ import annotations

import math
from typing import Any

from sma_sim.model.parameters import MASSES, Parameter
from sma_sim.model.structures.links import Drawing, Line
from sma_sim.model.structures.structure import Coordinate, NamedEffect, Structure

NAME, SOURCE = 'slider', 'a usual bench actuator'
BAR, SPRING, TURNS = 0.04, 0.3, 8  # of pictures: half a bar and a spring at rest, relative to L; turns of a spring


def lengths(q: Any, p: Any) -> float:
    """Length of the wire [m]: the slider moves towards its anchor."""
    return float(p.L - q.position)


def both_lengths(q: Any, p: Any) -> tuple[float, float]:
    """Lengths of two wires [m]."""
    return p.L - q.position, p.L + q.position


def forces(q: Any, v: Any, p: Any) -> float:
    """Spring, damping, dry friction and weight [N], against the pull of wire 1."""
    weight = p.m * p.g * math.sin(p.incline)
    friction = p.b * v.position + p.F_c * math.tanh(v.position / p.v_c)
    return float(-p.k * (q.position + p.x_0) - friction - weight)


def energy(q: Any, v: Any, p: Any) -> float:
    """Of the motion, the spring and the height [J]."""
    height = q.position * math.sin(p.incline)
    return float(0.5 * p.m * v.position**2 + 0.5 * p.k * (q.position + p.x_0) ** 2 + p.m * p.g * height)


def slider_with(wires: int) -> Structure:
    """A slider with one wire or with two."""
    one = wires == 1
    return Structure(
        name=NAME if one else f'{NAME}_{wires}',
        title='slider',
        coordinates=(Coordinate('position', 'm', lambda p: 0.01 * p.L, 'of the slider, towards the anchor of wire 1'),),
        wires=wires,
        lengths=lengths if one else both_lengths,
        gradients=(lambda q, p: -1.0) if one else (lambda q, p: (-1.0, 1.0)),
        forces=forces,
        stiffness=lambda q, p, part: part * p.k * (q.position + p.x_0),
        inertia=lambda p: p.m,
        parameters=(
            Parameter('wires', 1.0, '-', (1.0, 2.0), 'bundles of wires; the second pulls the other way'),
            Parameter('L', 0.1, 'm', (1e-3, 10.0), 'length of each wire at position 0'),
            Parameter('k', 40.0, 'N/m', (0.0, 1e7), 'stiffness of the spring'),
            Parameter('x_0', 0.025, 'm', (-10.0, 10.0), 'extension of the spring at position 0'),
            Parameter('m', 0.03, 'kg', (1e-6, 1e4), 'moving mass', usual=MASSES),
            Parameter('b', 2.0, 'N s/m', (0.0, 1e6), 'damping'),
            Parameter('F_c', 0.0, 'N', (0.0, 1e4), 'dry friction of the rail'),
            Parameter('v_c', 1e-3, 'm/s', (1e-6, 1.0), 'speed at which it reaches 76 % of F_c'),
            Parameter('g', 9.81, 'm/s^2', (0.0, 100.0), 'gravity'),
            Parameter(
                'incline',
                0.5 * math.pi,
                'rad',
                (-0.5 * math.pi, 0.5 * math.pi),
                'of the rail; positive: wire 1 lifts the slider',
            ),
        ),
        named_effects={
            'joint_friction': NamedEffect(
                'dry friction of the rail (slider.F_c)', {'M_c': 'slider.F_c', 'w_s': 'slider.v_c'}
            )
        },
        drawing=Drawing(lambda q, p: [toward_anchor(q, p)], against_spring) if one else Drawing(drawn_wires),
        size_parameter='slider.L',
        fitted=('slider.k', 'slider.x_0', 'slider.b'),
        defaults={'wire.n': 1.0},
        energy=energy,
        system=NAME,
        size_name='slider.wires',
        of_size=slider_with,
        description='one bundle, or two with slider.wires = 2; position is positive where wire 1 is shorter',
        source=SOURCE,
    )


def toward_anchor(q: Any, p: Any) -> Line:
    """Wire 1, from its anchor to the slider."""
    return [(p.L, 0.0, 0.0), (q.position, 0.0, 0.0)]


def against_spring(q: Any, p: Any) -> list[Line]:
    """The slider, and its spring behind it, which a zigzag stands for."""
    half, fixed = BAR * p.L, -p.x_0 - SPRING * p.L
    step = (q.position - fixed) / (2 * TURNS + 1)
    bent = [(fixed + (k + 0.5) * step, half * (-1.0) ** k, 0.0) for k in range(2 * TURNS + 1)]
    zigzag: Line = [(fixed, 0.0, 0.0), *bent, (q.position, 0.0, 0.0)]
    return [((q.position, -half, 0.0), (q.position, half, 0.0)), zigzag]


def drawn_wires(q: Any, p: Any) -> list[Line]:
    """Both wires."""
    return [toward_anchor(q, p), [(-p.L, 0.0, 0.0), (q.position, 0.0, 0.0)]]


STRUCTURE = slider_with(1)
