"""A lever on a joint, turned by two antagonistic wires that run over pulleys of its radius.

J dw/dt = r (F_1 - F_2) - k angle - b w - m g a sin(angle - vertical);   lengths L - r angle and L + r angle
"""

from __future__ import annotations

import math
from typing import Any

from sma_sim.model.parameters import MASSES, SIZES, Parameter
from sma_sim.model.structures.links import Drawing, Line
from sma_sim.model.structures.structure import Coordinate, Structure

SOURCE = 'a usual antagonistic joint'
ARC = tuple(k / 24 for k in range(25))  # parts of a drawn arc


def lengths(q: Any, p: Any) -> tuple[float, float]:
    """Lengths of both wires [m]: a positive angle shortens wire 1."""
    return p.L - p.r * q.angle, p.L + p.r * q.angle


def forces(q: Any, v: Any, p: Any) -> float:
    """Moments of the joint's spring, its damping and the weight [N m]."""
    return float(-p.k * q.angle - p.b * v.angle - p.m * p.g * p.a * math.sin(q.angle - p.vertical))


def drawn_wires(q: Any, p: Any) -> list[Line]:
    """Straight to the pulley, and around it to where they are fastened, in front of the joint at angle 0."""
    foot = min(0.0, 0.5 * math.pi * p.r - p.L)
    wires: list[Line] = []
    for side in (1.0, -1.0):
        turns = [0.5 * math.pi + part * (q.angle * side - 0.5 * math.pi) for part in ARC]
        wires.append([(foot, side * p.r, 0.0), *((p.r * math.cos(t), side * p.r * math.sin(t), 0.0) for t in turns)])
    return wires


def drawn_bodies(q: Any, p: Any) -> list[Line]:
    """The lever to its centre of mass, and the pulley."""
    circle = [(p.r * math.cos(math.tau * part), p.r * math.sin(math.tau * part), 0.0) for part in ARC]
    return [((0.0, 0.0, 0.0), (p.a * math.cos(q.angle), p.a * math.sin(q.angle), 0.0)), circle]


STRUCTURE = Structure(
    name='lever',
    title='lever',
    coordinates=(Coordinate('angle', 'rad', 0.2, 'of the lever', limit=math.pi),),
    wires=2,
    antagonistic=True,
    lengths=lengths,
    gradients=lambda q, p: (-p.r, p.r),
    forces=forces,
    stiffness=lambda q, p, part: part * p.k * q.angle,
    inertia=lambda p: p.J,
    parameters=(
        Parameter('L', 0.1, 'm', (1e-3, 10.0), 'length of each wire at angle 0'),
        Parameter('r', 6e-3, 'm', (1e-5, 10.0), 'radius at which the wires act', usual=SIZES),
        Parameter('J', 2e-5, 'kg m^2', (1e-12, 1e4), 'moment of inertia about the joint'),
        Parameter('k', 0.02, 'N m/rad', (0.0, 1e6), 'stiffness of the joint'),
        Parameter('b', 2e-3, 'N m s/rad', (0.0, 1e6), 'damping of the joint'),
        Parameter('m', 0.02, 'kg', (0.0, 1e4), 'mass of the lever', usual=MASSES),
        Parameter('a', 0.03, 'm', (0.0, 10.0), 'from the joint to the centre of mass'),
        Parameter('g', 9.81, 'm/s^2', (0.0, 100.0), 'gravity'),
        Parameter('vertical', 0.0, 'rad', (-math.pi, math.pi), 'angle at which the lever hangs straight down'),
    ),
    drawing=Drawing(wires=drawn_wires, bodies=drawn_bodies),
    size_parameter='lever.L',
    fitted=('lever.k', 'lever.b'),
    defaults={'wire.n': 1.0},
    energy=lambda q, v, p: (
        0.5 * p.J * v.angle**2 + 0.5 * p.k * q.angle**2 - p.m * p.g * p.a * math.cos(q.angle - p.vertical)
    ),
    description='J_eq > 0 heats wire 1 and turns the lever to positive angles',
    source=SOURCE,
)
