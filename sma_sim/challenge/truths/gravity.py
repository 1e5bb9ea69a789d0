"""Weight of the plate, on a module that leans: its beam away from upright, its plane out of the vertical.

F = share m_H g (-cos(lean), sin(lean), 0)   [N]
"""

import math

from sma_sim.challenge.truth import drawn_parameter, simulated_truth
from sma_sim.model.effects.effect import Effect

STANDARD_GRAVITY = 9.80665  # [m/s^2]

EFFECT = Effect(
    name='truth_gravity',
    port='structure_force',
    equation='F = share m_H g (-cos(lean), sin(lean), 0)',
    source='weight of a body on an inclined axis',
    parameters=(
        drawn_parameter('share', '-', 0.5, 1.0, 'part of the weight that lies in the plane of the module'),
        drawn_parameter('lean', 'rad', 0.3, 1.57, 'angle between the beam and the vertical'),
    ),
    kernel=lambda s, b, p: (
        -p.share * b.m_H * STANDARD_GRAVITY * math.cos(p.lean),
        p.share * b.m_H * STANDARD_GRAVITY * math.sin(p.lean),
        0.0,
    ),
)
TRUTH = simulated_truth(
    EFFECT,
    library='gravity',
    variables=('constant',),
    listed=lambda p, of: {
        'g_x': -p['share'] * STANDARD_GRAVITY * math.cos(p['lean']),
        'g_y': p['share'] * STANDARD_GRAVITY * math.sin(p['lean']),
    },
    signed=('lean',),
)
