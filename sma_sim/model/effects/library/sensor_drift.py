"""Zeros of the sensors that drift during a recording.

shown = value + c (1 - exp(-k t))/k, with k = 0 value + c t;   t since the beginning of the recording, c of the channel
"""

import math
from typing import Any

from sma_sim.model.effects.effect import Effect
from sma_sim.model.effects.ports import State
from sma_sim.model.parameters import Parameter, WireConstants

STRAIGHT = 1e-9  # k t, below which the drift is linear


def drifting(s: State, w: WireConstants, p: Any) -> float:
    """What the sensor shows."""
    bent = p.k * s.t
    return float(s.value + p.own * (s.t if abs(bent) < STRAIGHT else -math.expm1(-bent) / p.k))


EFFECT = Effect(
    name='sensor_drift',
    title='a drift of the zeros of the sensors',
    port='sensing',
    stage='bias',
    channels=('U_x', 'U_y', 'alpha', 'F_1', 'F_2', 'stress'),
    equation='shown = value + c (1 - exp(-k t))/k',
    source='instrumental drift: JCGM 200, International Vocabulary of Metrology, 4.21; warming of a first-order system',
    parameters=(
        Parameter('U_x', 1e-6, 'm/s', (-1.0, 1.0), 'drift of U_x', neutral=0.0, realistic=(-2e-6, 2e-6)),
        Parameter('U_y', 1e-5, 'm/s', (-1.0, 1.0), 'drift of U_y', neutral=0.0, realistic=(-2e-5, 2e-5)),
        Parameter('alpha', 1e-3, 'rad/s', (-3.0, 3.0), 'drift of alpha', neutral=0.0, realistic=(-1e-3, 1e-3)),
        Parameter('F_1', 0.02, 'N/s', (-1e3, 1e3), 'drift of F_1', neutral=0.0, realistic=(-0.1, 0.1)),
        Parameter('F_2', 0.02, 'N/s', (-1e3, 1e3), 'drift of F_2', neutral=0.0, realistic=(-0.1, 0.1)),
        Parameter(
            'stress',
            1e6,
            'Pa/s',
            (-1e10, 1e10),
            'drift of the load cell over the section',
            neutral=0.0,
            realistic=(-1e6, 1e6),
        ),
        Parameter('k', 0.0, '1/s', (0.0, 10.0), 'one over the time in which the drift ends', realistic=(0.0, 0.1)),
    ),
    by_channel=True,
    kernel=drifting,
    tried='timed',
    description='the motion itself is as modelled; all channels come to rest within the same time',
    signature='an error of the shown channel that grows in time, whatever the robot does; the other channels agree',
    confused_with=('sensor_jump', 'sensor_bias', 'ambient_drift'),
)
