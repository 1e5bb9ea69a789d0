"""Wires that age while they are hot: their transformation stresses sink, faster at a higher temperature.

ds/dt = r exp((T - 330 K)/15 K),   shift of both = -s   [Pa]
"""

import math

from sma_sim.challenge.truth import drawn_parameter, simulated_truth
from sma_sim.model.effects.effect import Effect

EFFECT = Effect(
    name='truth_ageing',
    port='transformation_stress',
    equation='ds/dt = r exp((T - 330)/15); shift of both = -s',
    source='thermally activated stabilisation, linearised exponent',
    parameters=(drawn_parameter('r', 'Pa/s', 2e4, 2e5, 'rate at 330 K'),),
    states=('s',),
    scale=(1e6,),
    rate=lambda s, w, p, m: (p.r * math.exp((s.T - 330.0) / 15.0),),
    kernel=lambda s, w, p, m: (-m.s, -m.s),
    energy='does not enter',
)
TRUTH = simulated_truth(EFFECT, variables=('T', 'memory'))
