"""A beam that bends in two planes, stretches and twists, pulled by three bundles 120 degrees apart around it.

The plate is at (L + U_x, U_y, U_z), turned by R = R_z(alpha) R_y(beta) R_x(gamma). Each plane bends as the planar beam does
(EB-Ba to EB-Bc); stiffness and damping are linear in the coordinates, gyroscopic moments are neglected. Bundle i is clamped
at the foot and on the plate at r (cos phi_i, sin phi_i) across the axis, phi = 0, 120, 240 degrees.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from sma_sim.model.parameters import BEAM_PARAMETERS, MASSES, PAPER, SIZES, Parameter
from sma_sim.model.structures.links import Drawing, Line
from sma_sim.model.structures.structure import Coordinate, Structure

COSINES, SINES = (1.0, -0.5, -0.5), (0.0, math.sqrt(0.75), -math.sqrt(0.75))
SOURCE = 'the module of the paper with a third bundle'


class SpatialConstants(NamedTuple):
    """What the equations read, SI units: lengths, mass and moments of inertia, stiffness, damping."""

    L: float
    r: float
    m_H: float
    J_bend: float  # of the plate, a thin disc, about an axis across the beam [kg m^2]
    J_twist: float
    k_x: float
    k_y: float
    k_ya: float
    k_a: float
    k_twist: float  # G pi h^4/(2 L) [N m]
    b_x: float
    b_y: float
    b_alpha: float
    b_twist: float


def constants(values: Any) -> SpatialConstants:
    """The constants from parameters named ``spatial.*``."""
    p = {
        name: float(values[f'spatial.{name}'])
        for name in ('L', 'E', 'h', 'nu', 'r', 'm_H', 'b_x', 'b_y', 'b_alpha', 'b_twist')
    }
    L, E, bending = p['L'], p['E'], p['E'] * math.pi * p['h'] ** 4 / 4.0
    return SpatialConstants(
        L=L,
        r=p['r'],
        m_H=p['m_H'],
        J_bend=p['m_H'] * p['r'] ** 2 / 4.0,
        J_twist=p['m_H'] * p['r'] ** 2 / 2.0,
        k_x=E * math.pi * p['h'] ** 2 / L,
        k_y=12.0 * bending / L**3,
        k_ya=6.0 * bending / L**2,
        k_a=4.0 * bending / L,
        k_twist=E / (2.0 + 2.0 * p['nu']) * math.pi * p['h'] ** 4 / (2.0 * L),
        b_x=p['b_x'],
        b_y=p['b_y'],
        b_alpha=p['b_alpha'],
        b_twist=p['b_twist'],
    )


def across(i: int, q: Any, p: SpatialConstants) -> tuple[float, float, float]:
    """R (0, y_i, z_i): where bundle `i` holds the plate, from the tip of the beam [m]."""
    y, z = p.r * COSINES[i], p.r * SINES[i]
    turned_y, turned_z = y * math.cos(q.gamma) - z * math.sin(q.gamma), y * math.sin(q.gamma) + z * math.cos(q.gamma)
    leant = turned_z * math.sin(q.beta)
    sine, cosine = math.sin(q.alpha), math.cos(q.alpha)
    return leant * cosine - turned_y * sine, leant * sine + turned_y * cosine, turned_z * math.cos(q.beta)


def wire(i: int, q: Any, p: SpatialConstants) -> tuple[float, float, float, float]:
    """Length of bundle `i` [m] and its direction from the foot to the plate."""
    a_x, a_y, a_z = across(i, q, p)
    x, y, z = p.L + q.U_x + a_x, q.U_y + a_y - p.r * COSINES[i], q.U_z + a_z - p.r * SINES[i]
    length = math.sqrt(x * x + y * y + z * z)
    return length, x / length, y / length, z / length


def gradient(i: int, q: Any, p: SpatialConstants) -> tuple[float, float, float, float, float, float]:
    """dl/dq of bundle `i`: its direction, and its moments about z, the turned y, and the plate's normal."""
    _, x, y, z = wire(i, q, p)
    a_x, a_y, a_z = across(i, q, p)
    sine, cosine = math.sin(q.alpha), math.cos(q.alpha)
    y_axis = (-sine, cosine)
    normal = (cosine * math.cos(q.beta), sine * math.cos(q.beta), -math.sin(q.beta))
    about_z = a_x * y - a_y * x
    about_y = y_axis[0] * (a_y * z - a_z * y) + y_axis[1] * (a_z * x - a_x * z)
    about_normal = normal[0] * (a_y * z - a_z * y) + normal[1] * (a_z * x - a_x * z) + normal[2] * about_z
    return x, y, z, about_z, about_y, about_normal


def lengths(q: Any, p: SpatialConstants) -> tuple[float, float, float]:
    """Lengths of the bundles [m]."""
    return wire(0, q, p)[0], wire(1, q, p)[0], wire(2, q, p)[0]


def gradients(q: Any, p: SpatialConstants) -> tuple[float, ...]:
    """dl/dq, bundle by bundle."""
    return gradient(0, q, p) + gradient(1, q, p) + gradient(2, q, p)


def stiffness(q: Any, p: SpatialConstants, part: float) -> tuple[float, float, float, float, float, float]:
    """K q of a beam that has a part of its stiffness; beta > 0 leans the plate towards -z."""
    return (
        part * p.k_x * q.U_x,
        part * (p.k_y * q.U_y - p.k_ya * q.alpha),
        part * (p.k_y * q.U_z + p.k_ya * q.beta),
        part * (p.k_a * q.alpha - p.k_ya * q.U_y),
        part * (p.k_a * q.beta + p.k_ya * q.U_z),
        part * p.k_twist * q.gamma,
    )


def forces(q: Any, v: Any, p: SpatialConstants) -> tuple[float, float, float, float, float, float]:
    """Elastic and viscous forces and moments of the beam."""
    F_x, F_y, F_z, M_z, M_y, M_x = stiffness(q, p, 1.0)
    return (
        -F_x - p.b_x * v.U_x,
        -F_y - p.b_y * v.U_y,
        -F_z - p.b_y * v.U_z,
        -M_z - p.b_alpha * v.alpha,
        -M_y - p.b_alpha * v.beta,
        -M_x - p.b_twist * v.gamma,
    )


def gravity(
    q: Any, p: SpatialConstants, g_x: float, g_y: float, g_z: float
) -> tuple[float, float, float, float, float, float]:
    """Weight of the plate; the beam's own mass is neglected."""
    return p.m_H * g_x, p.m_H * g_y, p.m_H * g_z, 0.0, 0.0, 0.0


def energy(q: Any, v: Any, p: SpatialConstants) -> float:
    """Energy of the plate's motion and of the bent, stretched and twisted beam [J]."""
    moving = p.m_H * (v.U_x**2 + v.U_y**2 + v.U_z**2) + p.J_bend * (v.alpha**2 + v.beta**2) + p.J_twist * v.gamma**2
    bent = (
        p.k_y * (q.U_y**2 + q.U_z**2) + p.k_a * (q.alpha**2 + q.beta**2) + 2.0 * p.k_ya * (q.U_z * q.beta - q.U_y * q.alpha)
    )
    return float(0.5 * (moving + bent + p.k_x * q.U_x**2 + p.k_twist * q.gamma**2))


def drawn_wires(q: Any, p: SpatialConstants) -> list[Line]:
    """From the feet of the bundles to the plate."""
    wires: list[Line] = []
    for i in range(3):
        a_x, a_y, a_z = across(i, q, p)
        wires.append(((0.0, p.r * COSINES[i], p.r * SINES[i]), (p.L + q.U_x + a_x, q.U_y + a_y, q.U_z + a_z)))
    return wires


def drawn_bodies(q: Any, p: SpatialConstants) -> list[Line]:
    """The axis of the bent beam, the cubic that a cantilever takes, and the plate."""
    axis = []
    for s in (k / 20 for k in range(21)):
        moved, turned = 3 * s**2 - 2 * s**3, p.L * (s**3 - s**2)
        axis.append((s * (p.L + q.U_x), moved * q.U_y + turned * q.alpha, moved * q.U_z - turned * q.beta))
    ends = [wire[-1] for wire in drawn_wires(q, p)]
    return [axis, [*ends, ends[0]]]


STRUCTURE = Structure(
    name='spatial',
    title='beam',
    coordinates=(
        Coordinate('U_x', 'm', lambda p: 3e-4 * p.L, 'stretch of the beam', joint=False, law='U_y'),
        Coordinate('U_y', 'm', lambda p: 0.01 * p.L, 'deflection towards bundle 1', joint=False),
        Coordinate('U_z', 'm', lambda p: 0.01 * p.L, 'deflection across it, towards bundle 2', joint=False),
        Coordinate('alpha', 'rad', 0.15, 'rotation about z', limit=0.5 * math.pi),
        Coordinate('beta', 'rad', 0.15, 'rotation about y', limit=0.5 * math.pi),
        Coordinate('gamma', 'rad', 0.15, 'twist', limit=0.5 * math.pi, joint=False),
    ),
    wires=3,
    lengths=lengths,
    gradients=gradients,
    forces=forces,
    stiffness=stiffness,
    gravity=gravity,
    inertia=lambda p: (p.m_H, p.m_H, p.m_H, p.J_bend, p.J_bend, p.J_twist),
    parameters=(
        *BEAM_PARAMETERS,
        Parameter('nu', 0.4, '-', (-0.9, 0.5), "Poisson's ratio of the beam, for its twist"),
        Parameter('b_twist', 0.02, 'N m s', (0.0, 1e6), 'damping of gamma'),
        Parameter('r', 5e-3, 'm', (1e-4, 10.0), 'of the bundles from the axis', usual=SIZES),
        Parameter('m_H', 10e-3, 'kg', (1e-6, 1e4), 'mass of the plate, a disc of radius r', source=PAPER, usual=MASSES),
    ),
    constants=constants,
    drawing=Drawing(drawn_wires, drawn_bodies, origin=lambda p: (p.L, 0.0, 0.0)),
    size_parameter='spatial.L',
    fitted=('wire.l0', 'spatial.E', 'spatial.b_y', 'spatial.b_alpha'),
    energy=energy,
    description='three bundles with a command each; it bends towards what is heated',
    source=SOURCE,
)
