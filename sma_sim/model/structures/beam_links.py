"""The module as a tree of links: the clamp, the plate at the beam's tip, and both ends of each wire.

The bent beam is no rigid body: markers draw it and the wires.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from sma_sim.model.parameters import BeamConstants, beam_constants, wire_constants
from sma_sim.model.structures.geometry import OVERHANG
from sma_sim.model.structures.links import AXES, Box, Joint, Link, LinkTree, Motion

BASE_FRAME = 'base'  # origin at the clamp, x along the straight beam, y across it
PLATE_FRAME = 'plate'  # origin at the beam's tip
PLATE_THICKNESS, CLAMP_THICKNESS = 3e-3, 10e-3  # [m], drawn
CLAMP_COLOUR, PLATE_COLOUR = '#888888', '#222222'


def beam_links(values: Mapping[str, float]) -> LinkTree:
    """The tree of a module with parameters `values` by full name, SI units. A positive alpha leans towards wire 1 (+y)."""
    b = beam_constants(values)
    edges = (PLATE_THICKNESS, OVERHANG * b.W, b.W)
    inertia = (2.0 * b.J_H, b.J_H, b.J_H)  # of a thin square plate with the paper's J_H about z
    links = [
        Link(BASE_FRAME, Box((CLAMP_THICKNESS, *edges[1:]), (-0.5 * CLAMP_THICKNESS, 0.0, 0.0), CLAMP_COLOUR)),
        Link('tip_x'),
        Link('tip_y'),
        Link(PLATE_FRAME, Box(edges, (0.0, 0.0, 0.0), PLATE_COLOUR), b.m_H, inertia),
    ]
    motions = motions_of(b, bundle_force_limit(values))
    joints = [
        Joint(BASE_FRAME, 'tip_x', (b.L, 0.0, 0.0), motions[0]),
        Joint('tip_x', 'tip_y', (0.0, 0.0, 0.0), motions[1]),
        Joint('tip_y', PLATE_FRAME, (0.0, 0.0, 0.0), motions[2]),
    ]
    for wire, y in (('wire_1', 0.5 * b.W), ('wire_2', -0.5 * b.W)):
        for parent, child in ((BASE_FRAME, wire), (PLATE_FRAME, f'{wire}_plate')):
            links.append(Link(child))
            joints.append(Joint(parent, child, (0.0, y, 0.0)))
    return LinkTree('sma_module', tuple(links), tuple(joints))


def motions_of(b: BeamConstants, force: float) -> tuple[Motion, Motion, Motion]:
    """U_x, U_y and alpha; limits for sliders and planners, well beyond what the wires reach: the model has none."""
    x, y, angle = 0.1 * b.L, 0.5 * b.L, 0.5 * math.pi
    return (
        Motion('U_x', False, AXES['x'], -x, x, 2.0 * force, x, b.b_x),
        Motion('U_y', False, AXES['y'], -y, y, 2.0 * force, y, b.b_y),
        Motion('alpha', True, AXES['z'], -angle, angle, force * b.W, angle, b.b_alpha),
    )


def bundle_force_limit(values: Mapping[str, float]) -> float:
    """Force [N] of a bundle of austenite that is stretched by the transformation strain: wires pull less."""
    w = wire_constants(values)
    return w.n * w.section * w.E_A * w.eps_T
