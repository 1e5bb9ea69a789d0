"""Camera that is turned against the base of the beam by theta.

U_x -> U_x cos(theta) + U_y sin(theta),   U_y -> U_y cos(theta) - U_x sin(theta),   alpha -> alpha - theta
Displacements are measured from the tip of the straight beam, so its place in the picture does not matter.
"""

import math
from typing import Any

from sma_sim.model.effects.effect import Effect
from sma_sim.model.effects.ports import State
from sma_sim.model.parameters import Parameter, WireConstants


def turned(s: State, w: WireConstants, p: Any) -> float:
    """The pose in the frame of the camera."""
    theta: float = p.theta
    if s.channel == 2:
        return s.value - theta
    across = s.U_y if s.channel == 0 else -s.U_x
    return s.value * math.cos(theta) + across * math.sin(theta)


EFFECT = Effect(
    name='sensor_misalignment',
    title='a camera turned against the base of the beam',
    port='sensing',
    stage='misalignment',
    channels=('U_x', 'U_y', 'alpha'),
    systems=('module',),
    equation='(U_x, U_y) turned by -theta, alpha -> alpha - theta',
    source='rotation of the frame of reference: Goldstein, Classical Mechanics, 4.2',
    parameters=(Parameter('theta', 0.02, 'rad', (-1.5, 1.5), 'angle of the camera', '', 0.0, (-0.1, 0.1)),),
    kernel=turned,
    description='the motion itself is as modelled',
    signature='a constant error of alpha together with an error of U_x in proportion to U_y',
    confused_with=('sensor_bias',),
)
