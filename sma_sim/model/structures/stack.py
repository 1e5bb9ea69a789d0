"""Modules in series: each is the paper's module, clamped to the plate of the one below.

Every module bends in the frame of the plate that carries it, as the paper's does (EB-Ba to EB-B3); these frames move and
turn as far as they may. With (f_x, f_y, M) the force and moment of module k (beam, damping, wires, effects) on its plate, in
the frame of plate k-1, R_k the rotation by alpha_k, r_k = (L + U_x, U_y), w the rate at which plate k-1 turns:

    m_H a_k = f_k - R_k f_(k+1) + m_H g            J_H dw_k/dt = M_k - M_(k+1) - r_(k+1) x f_(k+1)
    d^2 r_k/dt^2 = a_k - a_(k-1) - dw/dt x r_k - 2 w x dr_k/dt - w x (w x r_k)    d^2 alpha_k/dt^2 = dw_k/dt - dw_(k-1)/dt

These are Lagrange's equations M(q) d^2q/dt^2 + C(q, dq/dt) dq/dt + dV/dq = f: in the plates' own velocities the mass matrix
is diagonal, which solves for the accelerations without factorising M(q).
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from sma_sim.model.parameters import PAPER, BeamConstants, Parameter, beam_constants
from sma_sim.model.structures import module
from sma_sim.model.structures.geometry import shape_of
from sma_sim.model.structures.links import Drawing, Line
from sma_sim.model.structures.series import in_series, parts
from sma_sim.model.structures.structure import NamedEffect, Structure

NAME, DEFAULT_MODULES, MAX_MODULES = 'stack', 3, 10
DRAWN_POINTS = 21  # of a bent beam
SOURCE = "the paper's module; gravity is off, as there"


class StackConstants(NamedTuple):
    """What the equations read, SI units: those of each module's beam (`BeamConstants`), and gravity."""

    L: float
    W: float
    m_H: float
    J_H: float
    k_x: float
    k_y: float
    k_ya: float
    k_a: float
    b_x: float
    b_y: float
    b_alpha: float
    g_x: float
    g_y: float


def constants(values: Any) -> StackConstants:
    """The constants from parameters named ``beam.*``, ``plate.*`` and ``stack.*``."""
    return StackConstants(*beam_constants(values), g_x=float(values['stack.g_x']), g_y=float(values['stack.g_y']))


def plate(k: int, q: Any, f: Any, p: StackConstants) -> tuple[float, float, float]:
    """Accelerations of plate `k` under the modules on either side [m/s^2, rad/s^2], in the frame of the plate below."""
    x, y, moment = f[k, 0], f[k, 1], f[k, 2]
    if k + 1 < q.shape[0]:
        sine, cosine = math.sin(q[k, 2]), math.cos(q[k, 2])
        F_x, F_y = f[k + 1, 0], f[k + 1, 1]
        x -= cosine * F_x - sine * F_y
        y -= sine * F_x + cosine * F_y
        moment -= f[k + 1, 2] + (p.L + q[k + 1, 0]) * F_y - q[k + 1, 1] * F_x
    return x / p.m_H, y / p.m_H, moment / p.J_H


def accelerations(k: int, q: Any, v: Any, f: Any, p: StackConstants) -> tuple[float, float, float]:
    """d^2/dt^2 of U_x, U_y and alpha of module `k`, from 0 on."""
    x, y, turn = plate(k, q, f, p)
    if k == 0:
        return x + p.g_x, y + p.g_y, turn
    b_x, b_y, b_turn = plate(k - 1, q, f, p)
    sine, cosine = math.sin(q[k - 1, 2]), math.cos(q[k - 1, 2])
    w = 0.0
    for j in range(k):
        w += v[j, 2]
    r_x, r_y = p.L + q[k, 0], q[k, 1]
    x += b_turn * r_y + 2.0 * w * v[k, 1] + w * w * r_x - (cosine * b_x + sine * b_y)
    y += -b_turn * r_x - 2.0 * w * v[k, 0] + w * w * r_y - (cosine * b_y - sine * b_x)
    return x, y, turn - b_turn


def gravity(q: Any, p: StackConstants, g_x: float, g_y: float, g_z: float) -> tuple[float, float, float]:
    """Generalised forces of the weight of all plates on module ``q.k``: it carries those beyond it [N, N, N m]."""
    count, angle, moment = q.Q.shape[0], 0.0, 0.0
    for i in range(q.k):
        angle += q.Q[i, 2]
    sine, cosine = math.sin(angle), math.cos(angle)
    carried = p.m_H * (count - q.k)
    across = carried * (cosine * g_y - sine * g_x)
    for i in range(q.k + 1, count):
        angle += q.Q[i - 1, 2]
        r_x, r_y = p.L + q.Q[i, 0], q.Q[i, 1]
        x, y = math.cos(angle) * r_x - math.sin(angle) * r_y, math.sin(angle) * r_x + math.cos(angle) * r_y
        moment += p.m_H * (count - i) * (x * g_y - y * g_x)
    return carried * (cosine * g_x + sine * g_y), across, moment


def energy(q: Any, v: Any, p: StackConstants) -> float:
    """Energy of the plates' motion and height, and of the bent beams [J]."""
    x = y = angle = v_x = v_y = w = total = 0.0
    beam = BeamConstants(*p[: len(BeamConstants._fields)])
    for part, rate in parts(MODULE, q, v):
        sine, cosine = math.sin(angle), math.cos(angle)
        r_x, r_y = cosine * (p.L + part.U_x) - sine * part.U_y, sine * (p.L + part.U_x) + cosine * part.U_y
        v_x += cosine * rate.U_x - sine * rate.U_y - w * r_y
        v_y += sine * rate.U_x + cosine * rate.U_y + w * r_x
        x, y, angle, w = x + r_x, y + r_y, angle + part.alpha, w + rate.alpha
        total += module.energy(part, type(rate)(0.0, 0.0, 0.0), beam) + 0.5 * p.m_H * (v_x**2 + v_y**2)
        total += 0.5 * p.J_H * w**2 - p.m_H * (p.g_x * x + p.g_y * y)
    return float(total)


def drawn(q: Any, p: StackConstants) -> list[tuple[list[Line], list[Line]]]:
    """The lines of every module: its wires; its beam and plate."""
    beam, found = BeamConstants(*p[: len(BeamConstants._fields)]), []
    x = y = angle = 0.0
    for (part,) in parts(MODULE, q):
        sine, cosine = math.sin(angle), math.cos(angle)
        shape = shape_of(part.U_x, part.U_y, part.alpha, beam, DRAWN_POINTS)
        lines: list[Line] = [
            [(x + cosine * a - sine * b, y + sine * a + cosine * b, 0.0) for a, b in line.tolist()]
            for line in (*shape.wires, shape.beam, shape.plate)
        ]
        found.append((lines[:2], lines[2:]))
        (x, y, _), angle = lines[2][-1], angle + part.alpha
    return found


def stack_of(modules: int) -> Structure:
    """A stack of so many modules."""
    return in_series(
        MODULE,
        modules,
        'module',
        name=NAME if modules == DEFAULT_MODULES else f'{NAME}_{modules}',
        title='stack',
        parameters=(
            *MODULE.parameters,
            Parameter('stack.modules', float(modules), '-', (1.0, MAX_MODULES), 'modules, a whole number', source=SOURCE),
            Parameter('stack.g_x', 0.0, 'm/s^2', (-50.0, 50.0), 'gravity along the first beam at rest', source=SOURCE),
            Parameter('stack.g_y', 0.0, 'm/s^2', (-50.0, 50.0), 'gravity across it', source=SOURCE),
        ),
        accelerations=accelerations,
        gravity=gravity,
        named_effects={'gravity': NamedEffect('gravity (stack.g_x, stack.g_y)', {'g_x': 'stack.g_x', 'g_y': 'stack.g_y'})},
        constants=constants,
        energy=energy,
        drawing=Drawing(
            lambda q, p: [line for wires, _ in drawn(q, p) for line in wires],
            lambda q, p: [line for _, bodies in drawn(q, p) for line in bodies],
            lambda p: (p.L, 0.0, 0.0),
        ),
        system=NAME,
        size_name='stack.modules',
        of_size=stack_of,
        description='modules on top of each other, numbered from the base, with a command each; wires 1 and 2 are those of '
        'module 1, wires 3 and 4 of module 2; coordinates are relative to the plate below; stack.g_x = 9.81 lets it hang, '
        '-9.81 stand',
        source=PAPER,
    )


MODULE = module.STRUCTURE
STRUCTURE = stack_of(DEFAULT_MODULES)
