"""The paper's module: a flexible beam with a plate at its tip, bent by two antagonistic bundles (EB-Ba to EB-B3)."""

from __future__ import annotations

import math
from typing import Any

from sma_sim.model.parameters import BEAM_PARAMETERS, PAPER, PLATE_PARAMETERS, BeamConstants, beam_constants
from sma_sim.model.structures.beam import inclined_wire_length, stiffness_forces
from sma_sim.model.structures.beam_links import beam_links
from sma_sim.model.structures.geometry import Line as PlaneLine
from sma_sim.model.structures.geometry import shape_of
from sma_sim.model.structures.links import Drawing, Line
from sma_sim.model.structures.structure import Coordinate, Structure, in_group

STRETCH, DEFLECTION, ROTATION = 3e-4, 0.01, 0.15  # usual changes of U_x/L, U_y/L and alpha


def lengths(q: Any, b: BeamConstants) -> tuple[float, float]:
    """Lengths of both wires [m] (EB-B2a)."""
    sine, cosine = math.sin(q.alpha), math.cos(q.alpha)
    first = inclined_wire_length(q.U_x, q.U_y, sine, cosine, -1.0, b)
    second = inclined_wire_length(q.U_x, q.U_y, sine, cosine, 1.0, b)
    return first[0], second[0]


def gradients(q: Any, b: BeamConstants) -> tuple[float, float, float, float, float, float]:
    """Their derivatives in U_x, U_y and alpha (EB-B3)."""
    sine, cosine = math.sin(q.alpha), math.cos(q.alpha)
    first = inclined_wire_length(q.U_x, q.U_y, sine, cosine, -1.0, b)
    second = inclined_wire_length(q.U_x, q.U_y, sine, cosine, 1.0, b)
    return first[1], first[2], first[3], second[1], second[2], second[3]


def forces(q: Any, v: Any, b: BeamConstants) -> tuple[float, float, float]:
    """Elastic and viscous forces of the beam [N, N, N m] (EB-Ba to EB-Bc)."""
    F_x, F_y, M = stiffness_forces(q.U_x, q.U_y, q.alpha, b)
    return -F_x - b.b_x * v.U_x, -F_y - b.b_y * v.U_y, -M - b.b_alpha * v.alpha


def stiffness(q: Any, b: BeamConstants, part: float) -> tuple[float, float, float]:
    """K q of a beam that has a part of its stiffness [N, N, N m]."""
    return stiffness_forces(q.U_x, q.U_y, q.alpha, b, part)


def gravity(q: Any, b: BeamConstants, g_x: float, g_y: float, g_z: float) -> tuple[float, float, float]:
    """Weight of the plate [N, N, N m]; the beam's own mass is neglected, as in the paper, and it bends in x and y only."""
    return b.m_H * g_x, b.m_H * g_y, 0.0


def energy(q: Any, v: Any, b: BeamConstants) -> float:
    """Energy of the plate's motion and of the bent beam [J]."""
    F_x, F_y, M = stiffness_forces(q.U_x, q.U_y, q.alpha, b)
    moving = b.m_H * (v.U_x**2 + v.U_y**2) + b.J_H * v.alpha**2
    return float(0.5 * (moving + F_x * q.U_x + F_y * q.U_y + M * q.alpha))


def in_plane(*lines: PlaneLine) -> list[Line]:
    """Lines of the plane z = 0."""
    return [[(x, y, 0.0) for x, y in line.tolist()] for line in lines]


def drawn_wires(q: Any, b: BeamConstants) -> list[Line]:
    """From the clamp to the plate."""
    return in_plane(*shape_of(q.U_x, q.U_y, q.alpha, b).wires)


def drawn_bodies(q: Any, b: BeamConstants) -> list[Line]:
    """The bent beam, and the plate."""
    shape = shape_of(q.U_x, q.U_y, q.alpha, b)
    return in_plane(shape.beam, shape.plate)


STRUCTURE = Structure(
    name='module',
    title='beam',
    coordinates=(
        Coordinate(
            'U_x',
            'm',
            lambda b: STRETCH * b.L,
            'stretch of the beam',
            lambda b: STRETCH * b.L * math.sqrt(b.k_x / b.m_H),
            1e-4,
            motion='stretch',
            joint=False,
            force='force on the plate along the beam',
            small_force=1.0,
            law='U_y',
        ),
        Coordinate(
            'U_y',
            'm',
            lambda b: DEFLECTION * b.L,
            'deflection of its tip',
            lambda b: DEFLECTION * b.L * math.sqrt(b.k_y / b.m_H),
            1e-3,
            motion='deflection',
            joint=False,
            force='force on the plate across the beam',
            small_force=0.02,
        ),
        # A plate that has turned this far is far beyond what the wires can bend a beam to.
        Coordinate(
            'alpha',
            'rad',
            ROTATION,
            'rotation of the plate',
            lambda b: ROTATION * math.sqrt(b.k_a / b.J_H),
            0.15,
            0.5 * math.pi,
            'rotation',
            force='moment on the plate',
            small_force=1e-3,
        ),
    ),
    wires=2,
    antagonistic=True,
    lengths=lengths,
    gradients=gradients,
    forces=forces,
    stiffness=stiffness,
    gravity=gravity,
    inertia=lambda b: (b.m_H, b.m_H, b.J_H),
    parameters=(*in_group('beam', BEAM_PARAMETERS), *in_group('plate', PLATE_PARAMETERS)),
    constants=beam_constants,
    size_parameter='beam.L',
    fitted=('wire.l0', 'beam.E', 'beam.b_y', 'beam.b_alpha'),
    links=beam_links,
    drawing=Drawing(drawn_wires, drawn_bodies),
    energy=energy,
    description='two bundles, one on each side of the beam, pull on the plate; J_eq > 0 heats bundle 1, J_eq < 0 bundle 2',
    source=PAPER,
)
