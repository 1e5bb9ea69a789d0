"""A plate that carries a payload, on a module whose beam leans away from upright.

F = load m_H g (-cos(lean), sin(lean), 0)   [N]
"""

import math

from sma_sim.challenge.truth import acting, ranged
from sma_sim.model.effects.effect import Effect

EFFECT = Effect(
    name='truth_gravity',
    port='structure_force',
    equation='F = load m_H g (-cos(lean), sin(lean), 0)',
    source='weight of a body on an inclined axis',
    parameters=(
        ranged('load', '-', 0.5, 2.0, 'weight that counts over the weight of the plate'),
        ranged('lean', 'rad', 0.3, 1.57, 'angle between the beam and the vertical'),
    ),
    kernel=lambda s, b, p: (-9.80665 * p.load * b.m_H * math.cos(p.lean), 9.80665 * p.load * b.m_H * math.sin(p.lean), 0.0),
)
TRUTHS = (acting(EFFECT, library='gravity', variables=('constant',), file=__file__, signed=('lean',)),)
