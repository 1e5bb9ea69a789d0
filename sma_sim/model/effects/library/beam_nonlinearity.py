"""Beam whose stiffness depends on how far it is bent: by its material, and by the shortening that comes with bending.

V = integral of E I (kappa^2/2 + b L^2 kappa^4/4) + k_x (U_x + c S)^2/2, S = 3 U_y^2/(5 L) - U_y alpha/10 + L alpha^2/15
The linear beam has b = c = 0; the effect adds the rest of -dV/dq, q = (U_x, U_y, alpha). The curvature kappa is that
of the beam's cubic shape, linear from the root to the plate; S is half the integral of its slope squared.

With b < 0 the moment has a maximum at L kappa = 1/sqrt(-3 b), where the tangent stiffness E I (1 + 3 b (L kappa)^2) is zero;
a beam that is bent beyond gives way. The paper's module bends to L kappa = 0.43 under full heating, with b = -0.5 and some c
to 0.67, where a third of the stiffness is left. Hence the realistic range begins at b = -0.5, with its maximum at 0.82.

A beam that bends in two planes has kappa^2 = kappa_y^2 + kappa_z^2 and S = S_y + S_z, with the slope alpha of its end in the
plane of U_y and -beta in that of U_z; twist takes no part.
"""

import math
from typing import Any, NamedTuple

from sma_sim.model.effects.effect import Effect
from sma_sim.model.effects.ports import State
from sma_sim.model.parameters import BeamConstants, Parameter

GAUSS = math.sqrt(0.15)  # of three points in 0 to 1, from the middle


def forces(s: State, b: BeamConstants, p: Any) -> tuple[float, float, float]:
    """Forces beyond those of the linear beam [N, N, N m]."""
    L = b.L
    bend = 2.0 * (3.0 * s.U_y - L * s.alpha) / (L * L)
    tip = 2.0 * (2.0 * L * s.alpha - 3.0 * s.U_y) / (L * L)
    # integral of kappa^4 over the beam is L/5 (bend^4 + bend^3 tip + ... + tip^4)
    by_bend = 4.0 * bend**3 + 3.0 * bend**2 * tip + 2.0 * bend * tip**2 + tip**3
    by_tip = 4.0 * tip**3 + 3.0 * tip**2 * bend + 2.0 * tip * bend**2 + bend**3
    hardening = p.b * L**4 * b.k_a / 80.0  # E I = k_a L/4
    shortening = p.c * (0.6 * s.U_y**2 / L - 0.1 * s.U_y * s.alpha + L * s.alpha**2 / 15.0)
    pull = b.k_x * (s.U_x + shortening) * p.c
    return (
        -b.k_x * shortening,
        -hardening * 6.0 / (L * L) * (by_bend - by_tip) - pull * (1.2 * s.U_y / L - 0.1 * s.alpha),
        -hardening * 2.0 / L * (2.0 * by_tip - by_bend) - pull * (2.0 * L * s.alpha / 15.0 - 0.1 * s.U_y),
    )


class Bending(NamedTuple):
    """Bending in one plane: curvature at root and plate [1/m], shortening [m], and its derivatives in tip and slope."""

    root: float
    end: float
    shortening: float
    by_tip: float
    by_slope: float


def bending(tip: float, slope: float, L: float) -> Bending:
    """Of a beam whose end has moved by `tip` [m] and has a `slope`."""
    return Bending(
        2.0 * (3.0 * tip - L * slope) / (L * L),
        2.0 * (2.0 * L * slope - 3.0 * tip) / (L * L),
        0.6 * tip**2 / L - 0.1 * tip * slope + L * slope**2 / 15.0,
        1.2 * tip / L - 0.1 * slope,
        2.0 * L * slope / 15.0 - 0.1 * tip,
    )


def moments(own: Bending, other: Bending) -> tuple[float, float]:
    """Integrals of (kappa^2 + kappa_other^2) kappa over the beam's length, weighted with 1 - s and with s, s from 0 to 1."""
    at_root = at_end = 0.0
    for s, weight in ((0.5 - GAUSS, 5.0), (0.5, 8.0), (0.5 + GAUSS, 5.0)):  # exact for these polynomials of order 4
        kappa, across = own.root + s * (own.end - own.root), other.root + s * (other.end - other.root)
        part = weight / 18.0 * (kappa * kappa + across * across) * kappa
        at_root += (1.0 - s) * part
        at_end += s * part
    return at_root, at_end


def forces_in_space(s: Any, b: Any, p: Any) -> tuple[float, float, float, float, float, float]:
    """Forces beyond those of the linear beam, on U_x, U_y, U_z, alpha, beta and gamma."""
    L = b.L
    y, z = bending(s.U_y, s.alpha, L), bending(s.U_z, -s.beta, L)
    shortening = p.c * (y.shortening + z.shortening)
    pull = b.k_x * (s.U_x + shortening) * p.c
    hardening = p.b * L**4 * b.k_a / 4.0  # E I = k_a L/4
    root_y, end_y = moments(y, z)
    root_z, end_z = moments(z, y)
    return (
        -b.k_x * shortening,
        -hardening * 6.0 / (L * L) * (root_y - end_y) - pull * y.by_tip,
        -hardening * 6.0 / (L * L) * (root_z - end_z) - pull * z.by_tip,
        -hardening * 2.0 / L * (2.0 * end_y - root_y) - pull * y.by_slope,
        hardening * 2.0 / L * (2.0 * end_z - root_z) + pull * z.by_slope,
        0.0,
    )


EFFECT = Effect(
    name='beam_nonlinearity',
    title='a nonlinear stiffness of the beam',
    port='structure_force',
    systems=('module', 'spatial'),
    kernels=(('spatial', forces_in_space),),
    equation='F = -dV/dq; V = int E I b L^2 kappa^4/4 + k_x ((U_x + c S)^2 - U_x^2)/2, S = int w\'^2/2',
    source='von Karman beam with a cubic law of bending: Reddy, Energy Principles and Variational Methods',
    parameters=(
        Parameter(
            'b',
            3.0,
            '1/rad^2',
            (-5.0, 1e3),
            'bending moment grows by 1 + b (L kappa)^2: above 0 stiffer',
            neutral=0.0,
            realistic=(-0.5, 30.0),
        ),
        Parameter(
            'c', 0.0, '-', (0.0, 2.0), 'shortening by bending: 1 for a slender beam', neutral=0.0, realistic=(0.0, 1.2)
        ),
    ),
    kernel=forces,
    energy='elastic: the force of a potential, none is lost',
    description='b is the material or the joint; c couples the pull of the wires with bending; b < 0 gives way beyond '
    'L kappa = 1/sqrt(-3 b)',
    signature='large angles fall short of (b > 0) or exceed the model, small ones agree; odd in alpha, no hysteresis',
    confused_with=('beam.E', 'plate.W', 'sensor_gain'),
)
