"""Camera that is turned against the base of the beam by theta.

U_x -> U_x cos(theta) + U_y sin(theta),   U_y -> U_y cos(theta) - U_x sin(theta),   alpha -> alpha - theta
Displacements are measured from the tip of the straight beam, so its place in the picture does not matter.

In space the camera is turned by Q = R_z(theta) R_y(theta_y) R_x(theta_x): it sees Q^T (U_x, U_y, U_z) and the angles of
Q^T R, where R = R_z(alpha) R_y(beta) R_x(gamma) is how the plate is turned.
"""

import math
from typing import Any

from sma_sim.model.effects.effect import Effect
from sma_sim.model.effects.ports import CHANNELS, State
from sma_sim.model.parameters import Parameter, WireConstants

# Numbers of channels: the module's own, then others by their place among (U_x, U_y, U_z, alpha, beta, gamma).
ALPHA, U_Z, BETA, GAMMA = CHANNELS.index('alpha'), len(CHANNELS) + 2, len(CHANNELS) + 4, len(CHANNELS) + 5
Rows = tuple[float, float, float, float, float, float, float, float, float]  # of a matrix, one after another


def turned(s: State, w: WireConstants, p: Any) -> float:
    """The pose in the frame of the camera."""
    theta: float = p.theta
    if s.channel == 2:
        return s.value - theta
    across = s.U_y if s.channel == 0 else -s.U_x
    return s.value * math.cos(theta) + across * math.sin(theta)


def rotation(z: float, y: float, x: float) -> Rows:
    """R_z(z) R_y(y) R_x(x)."""
    a, b, c, d, e, f = math.cos(z), math.sin(z), math.cos(y), math.sin(y), math.cos(x), math.sin(x)
    return (a * c, a * d * f - b * e, a * d * e + b * f, b * c, b * d * f + a * e, b * d * e - a * f, -d, c * f, c * e)


def along(Q: Rows, R: Rows, i: int, j: int) -> float:
    """Entry (i, j) of Q^T R."""
    return Q[i] * R[j] + Q[3 + i] * R[3 + j] + Q[6 + i] * R[6 + j]


def turned_in_space(s: Any, w: WireConstants, p: Any) -> float:
    """The pose of a beam that moves in space in the frame of the camera; where every sensor is true."""
    Q, R = rotation(p.theta, p.theta_y, p.theta_x), rotation(s.alpha, s.beta, s.gamma)
    if s.channel == ALPHA:
        return math.atan2(along(Q, R, 1, 0), along(Q, R, 0, 0))
    if s.channel == BETA:
        return -math.asin(max(-1.0, min(1.0, along(Q, R, 2, 0))))
    if s.channel == GAMMA:
        return math.atan2(along(Q, R, 2, 1), along(Q, R, 2, 2))
    i = 2 if s.channel == U_Z else int(s.channel)
    seen: float = Q[i] * s.U_x + Q[3 + i] * s.U_y + Q[6 + i] * s.U_z
    return seen


EFFECT = Effect(
    name='sensor_misalignment',
    title='a camera turned against the base of the beam',
    port='sensing',
    stage='misalignment',
    channels=('U_x', 'U_y', 'alpha'),
    systems=('module', 'spatial'),
    kernels=(('spatial', turned_in_space),),
    in_space=(
        Parameter('theta_y', 0.02, 'rad', (-1.5, 1.5), 'angle of the camera about y', neutral=0.0, realistic=(-0.1, 0.1)),
        Parameter('theta_x', 0.02, 'rad', (-1.5, 1.5), 'angle of the camera about x', neutral=0.0, realistic=(-0.1, 0.1)),
    ),
    equation='(U_x, U_y) turned by -theta, alpha -> alpha - theta',
    source='rotation of the frame of reference: Goldstein, Classical Mechanics, 4.2',
    parameters=(Parameter('theta', 0.02, 'rad', (-1.5, 1.5), 'angle of the camera', neutral=0.0, realistic=(-0.1, 0.1)),),
    kernel=turned,
    description='the motion itself is as modelled; theta is about z, in space theta_y and theta_x are about the others',
    signature='a constant error of alpha together with an error of U_x in proportion to U_y',
    confused_with=('sensor_bias',),
)
