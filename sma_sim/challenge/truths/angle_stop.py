"""A stop that the plate meets at an angle.

M = -k max(0, alpha - a) for a stop at a > 0, mirrored for a < 0   [N m], rounded over 1 mrad
"""

import math
from typing import Any

from sma_sim.challenge.truth import drawn_parameter, simulated_truth
from sma_sim.model.effects.effect import Effect
from sma_sim.model.effects.ports import State
from sma_sim.model.parameters import BeamConstants


def stop_moment(s: State, b: BeamConstants, p: Any) -> tuple[float, float, float]:
    """Moment on the plate [N m]."""
    side = math.copysign(1.0, p.a)
    depth = side * s.alpha - abs(p.a)
    return 0.0, 0.0, -side * p.k * 0.5 * (depth + math.sqrt(depth * depth + 1e-6))


EFFECT = Effect(
    name='truth_angle_stop',
    port='structure_force',
    equation='M = -k max(0, alpha - a) (a > 0), +k max(0, a - alpha) (a < 0)',
    source='contact with an elastic stop',
    parameters=(
        drawn_parameter('k', 'N m/rad', 0.3, 5.0, 'stiffness of the stop'),
        drawn_parameter('a', 'rad', 0.02, 0.08, 'angle at which it is met'),
    ),
    kernel=stop_moment,
)
TRUTH = simulated_truth(EFFECT, variables=('alpha',), signed=('a',))
