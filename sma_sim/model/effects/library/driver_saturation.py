"""Driver or supply that gives no more than a largest power.

J_out = J/(1 + (r J)^(2 p))^(1/(2 p))   [W] per wire: 1/r is the largest heating of one wire, p how sharp the limit is
"""

import math
from typing import Any

from sma_sim.model.effects.effect import Effect
from sma_sim.model.effects.ports import State
from sma_sim.model.parameters import Parameter, WireConstants

SMALLEST = 1e-12  # r J, below which nothing is limited


def passed(s: State, w: WireConstants, p: Any) -> float:
    """What the driver passes on [W]; beyond its limit in the powers of 1/(r J), which do not overflow."""
    part = p.r * s.J
    if part < SMALLEST:
        return s.J
    if part <= 1.0:
        return float(s.J * math.exp(-math.log1p(part ** (2.0 * p.p)) / (2.0 * p.p)))
    return float(math.exp(-math.log1p(part ** (-2.0 * p.p)) / (2.0 * p.p)) / p.r)


EFFECT = Effect(
    name='driver_saturation',
    title='a limit of the power that the driver gives',
    port='actuation',
    stage='saturation',
    equation='J_out = J/(1 + (r J)^(2 p))^(1/(2 p))',
    source='soft limiter: Rapp, 2nd European Conference on Satellite Communications (1991) 179',
    parameters=(
        Parameter(
            'r', 1.0, '1/W', (0.0, 1e3), 'one over the largest heating of one wire (of n)', neutral=0.0, realistic=(0.3, 3.0)
        ),
        Parameter('p', 2.0, '-', (0.5, 30.0), 'sharpness of the limit: 2 soft, 6 nearly a clip', realistic=(1.0, 6.0)),
    ),
    kernel=passed,
    description='a limit of each bundle; nothing is lost well below it',
    signature='small commands agree, large ones heat less, and no more beyond a limit',
    confused_with=('resistance_feedback', 'natural_convection', 'wire.lambda'),
)
