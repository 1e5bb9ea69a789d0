"""A coil spring wound of SMA wire that lifts a weight, pulls against a bias spring, or both.

m dv/dt = F - k (x + x_0) - b v - F_c tanh(v/v_c) - m g sin(incline);   the coil is h = h_0 + delta_0 - x long

Its wire, of length l0 and radius r_0, is a helix whose ends do not turn: with the pitch angle a, sin(a) = h/l0, it has the
torsion t = 2 cos(a_0) h/(D l0) and the curvature c = 2 cos(a_0) cos(a)/D (Love 1927, sections 271 and 272). The shear of
twisting r (t - t_0) and the strain of bending y (c - c_0) are equivalent to one tensile strain (von Mises, gamma =
sqrt(3) eps), whose square is the mean over the section of (r (t - t_0))^2/3 + (y (c - c_0))^2:

    eps = K (h - h_0) sqrt(1 + 3/2 tan^2((a + a_0)/2)),   K = 2 r_0 cos(a_0)/(sqrt(6) D l0)

and by virtual work F = n Om sigma deps/dh. For elastic wires this is the spring of the textbook, G d^4/(8 D^3 N) for small
pitch with G = E/3 (Wahl, Mechanical Springs, 1963): eps is gamma/sqrt(6) of the shear gamma = d (h - h_0)/(pi D^2 N) at the
surface, and sigma is sqrt(3/2) of its stress tau = 8 F D/(pi d^3).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

from sma_sim.model.parameters import MASSES, SIZES, Parameter, declared_in
from sma_sim.model.structures.links import Drawing, Line
from sma_sim.model.structures.structure import (
    BALANCE,
    CONTROL,
    Coordinate,
    Drive,
    Structure,
    at_imposed_temperature,
    in_group,
)

SOURCE = 'a usual coil of thin actuator wire'
STEEPEST = math.sin(math.radians(85.0))  # of the pitch: beyond, where the wire is all but straight, strain is a parabola
POINTS = 12  # of a drawn turn
MACHINE = 'bench.stiffness'


class CoilConstants(NamedTuple):
    """What the equations of a coil read, SI units."""

    D: float
    h_0: float
    delta_0: float
    k: float
    x_0: float
    m: float
    b: float
    F_c: float
    v_c: float
    g: float
    incline: float
    l0: float
    slope: float  # K [1/m]: strain over extension at small pitch
    turns: float  # l0 cos(a_0)/(pi D)
    machine: float  # stiffness of the testing machine [N/m]


def coil_constants(values: Mapping[str, float]) -> CoilConstants:
    """Constants from parameters by full name."""
    own = {parameter.name: float(values[f'coil.{parameter.name}']) for parameter in PARAMETERS}
    D, l0 = own['D'], float(values['wire.l0'])
    cosine = math.sqrt(1.0 - min(own['h_0'] / l0, STEEPEST) ** 2)
    return CoilConstants(
        **own,
        l0=l0,
        slope=2.0 * float(values['wire.r0']) * cosine / (math.sqrt(6.0) * D * l0),
        turns=l0 * cosine / (math.pi * D),
        machine=float(values.get(MACHINE, 0.0)),
    )


def lengths(q: Any, p: Any) -> float:
    """Length of the coil [m]: the load moves towards its anchor."""
    return float(p.h_0 + p.delta_0 - q.stroke)


def strain(l: float, p: Any) -> tuple[float, float]:  # noqa: E741 (the symbol)
    """Equivalent strain of the wire of a coil that is `l` [m] long, and l0 times its derivative."""
    s_0 = min(p.h_0 / p.l0, STEEPEST)
    s = min(max(l / p.l0, -STEEPEST), STEEPEST)
    c_0, c = math.sqrt(1.0 - s_0 * s_0), math.sqrt(1.0 - s * s)
    tangent = (s + s_0) / (c + c_0)  # of the mean pitch
    steeper = (1.0 + tangent * s / c) / (c + c_0)  # d tangent/ds
    bending = math.sqrt(1.0 + 1.5 * tangent * tangent)
    more = 1.5 * tangent * steeper / bending  # d bending/ds
    steepest = (2.0 * steeper * s / c + tangent / c**3) / (c + c_0)  # d2 tangent/ds2
    most = (1.5 * (steeper * steeper + tangent * steepest) - more * more) / bending  # d2 bending/ds2
    size, beyond = p.slope * p.l0, l / p.l0 - s
    ratio, bend = size * (bending + (s - s_0) * more), size * (2.0 * more + (s - s_0) * most)
    return size * (s - s_0) * bending + (ratio + 0.5 * bend * beyond) * beyond, ratio + bend * beyond


def forces(q: Any, v: Any, p: Any) -> float:
    """Bias spring, damping, dry friction and weight [N], against the pull of the coil."""
    friction = p.b * v.stroke + p.F_c * math.tanh(v.stroke / p.v_c)
    return float(-p.k * (q.stroke + p.x_0) - friction - p.m * p.g * math.sin(p.incline))


def machine_forces(q: Any, v: Any, p: Any, u: Any) -> float:
    """Force of a testing machine that moves the end of the coil, critically damped [N]."""
    return float(p.machine * (u.crosshead - q.stroke) - 2.0 * math.sqrt(p.machine * p.m) * v.stroke)


def energy(q: Any, v: Any, p: Any) -> float:
    """Of the motion, the bias spring and the height [J]."""
    height = q.stroke * math.sin(p.incline)
    return float(0.5 * p.m * v.stroke**2 + 0.5 * p.k * (q.stroke + p.x_0) ** 2 + p.m * p.g * height)


def helix(q: Any, p: Any) -> list[Line]:
    """The wire, from the anchor to the load, with its ends on the axis."""
    anchor, count = p.h_0 + p.delta_0, max(1, round(p.turns * POINTS))
    pitch = min(abs(anchor - q.stroke) / p.l0, STEEPEST)
    radius = 0.5 * p.l0 * math.sqrt(1.0 - pitch * pitch) / (math.pi * p.turns)
    places = [(part / count, math.tau * p.turns * part / count) for part in range(count + 1)]
    turned: Line = [
        (anchor + part * (q.stroke - anchor), radius * math.sin(angle), radius * math.cos(angle)) for part, angle in places
    ]
    return [[(anchor, 0.0, 0.0), *turned, (q.stroke, 0.0, 0.0)]]


PARAMETERS = declared_in(
    SOURCE,
    Parameter('D', 2.5e-3, 'm', (1e-5, 1.0), 'mean diameter of the coil at rest, from wire axis to wire axis'),
    Parameter('h_0', 8e-3, 'm', (1e-5, 10.0), 'length of the coil without a load', usual=SIZES),
    Parameter('delta_0', 0.05, 'm', (-10.0, 10.0), 'extension of the coil at stroke 0'),
    Parameter('k', 2.0, 'N/m', (0.0, 1e7), 'stiffness of the bias spring; 0: a weight alone'),
    Parameter('x_0', 0.05, 'm', (-10.0, 10.0), 'extension of the bias spring at stroke 0'),
    Parameter('m', 0.02, 'kg', (1e-6, 1e4), 'mass of the load', usual=MASSES),
    Parameter('b', 0.5, 'N s/m', (0.0, 1e6), 'damping'),
    Parameter('F_c', 0.0, 'N', (0.0, 1e4), 'dry friction of a guide'),
    Parameter('v_c', 1e-3, 'm/s', (1e-6, 1.0), 'speed at which it reaches 76 % of F_c'),
    Parameter('g', 9.81, 'm/s^2', (0.0, 100.0), 'gravity'),
    Parameter('incline', 0.5 * math.pi, 'rad', (-0.5 * math.pi, 0.5 * math.pi), 'of the motion; positive: the coil lifts'),
)
LIFTING = Structure(
    name='coil',
    title='coil',
    coordinates=(Coordinate('stroke', 'm', lambda p: 0.1 * p.l0, 'of the load, towards the anchor of the coil'),),
    wires=1,
    lengths=lengths,
    gradients=lambda q, p: -1.0,
    strain=strain,
    forces=forces,
    stiffness=lambda q, p, part: part * p.k * (q.stroke + p.x_0),
    inertia=lambda p: p.m,
    parameters=in_group('coil', PARAMETERS),
    constants=coil_constants,
    drawing=Drawing(wires=helix),
    size_parameter='coil.D',
    fitted=('coil.delta_0', 'coil.b'),
    defaults={'wire.n': 1.0, 'wire.r0': 1.5e-4, 'wire.l0': 0.2},
    energy=energy,
    options={CONTROL: 'load', **BALANCE},
    description='a coil spring of SMA wire lifts a weight or pulls against a bias spring; wire.l0 is the length of its '
    'wire, pi D N/cos(a_0) for N turns; stroke is positive where the coil is shorter',
    source='Love, Mathematical Theory of Elasticity, 1927, sections 271 and 272; Wahl, Mechanical Springs, 1963',
)
ON_MACHINE = replace(
    LIFTING,
    name='coil_on_machine',
    drives=(Drive('crosshead', 'm', 'stroke to which a testing machine moves the end of the coil'),),
    forces=machine_forces,
    stiffness=None,
    parameters=(
        *LIFTING.parameters,
        Parameter(MACHINE, 1e5, 'N/m', (1.0, 1e9), 'stiffness of the testing machine', source='far above that of any coil'),
    ),
    energy=None,
    fitted=('coil.delta_0',),
    options={CONTROL: 'crosshead', **BALANCE},
    variant_of=LIFTING.name,
    description='a testing machine draws a coil spring of SMA wire, whose force is measured',
)
STRUCTURE = replace(
    LIFTING,
    variants=(
        at_imposed_temperature(LIFTING, 'a coil spring of SMA wire under a load, in a furnace or a bath'),
        ON_MACHINE,
        at_imposed_temperature(ON_MACHINE, 'force over stroke at set temperatures of a coil spring of SMA wire'),
    ),
)
