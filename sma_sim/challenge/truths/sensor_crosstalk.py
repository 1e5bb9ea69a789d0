"""Load cells whose axes are not those of the bundles: each sees a part of the other's pull.

F_shown,1 = F_1 + F_2 tan(tilt),   F_shown,2 = F_2 + F_1 tan(tilt)
"""

import math

import numpy as np

from sma_sim.challenge.truth import Channels, Values, drawn_parameter, sensor_truth
from sma_sim.model.arrays import Vector


def tilted_axes(time: Vector, channels: Channels, p: Values) -> dict[str, Vector]:
    """Both forces through a symmetric matrix."""
    seen = np.array([[1.0, math.tan(p['tilt'])], [math.tan(p['tilt']), 1.0]]) @ [channels['F_1'], channels['F_2']]
    return {'F_1': seen[0], 'F_2': seen[1]}


TRUTH = sensor_truth(
    'truth_sensor_crosstalk',
    tilted_axes,
    drawn_parameter('tilt', 'rad', 0.02, 0.15, 'angle between the axis of a load cell and that of its bundle'),
    library='sensor_crosstalk',
    variables=('value',),
    signed=('tilt',),
)
