"""A power stage that needs time: from 10 to 90 % in t_r.

dP/dt = ln 9/t_r (J - P)   [W/s], the wire gets P
"""

import math

from sma_sim.challenge.truth import drawn_parameter, simulated_truth
from sma_sim.model.effects.effect import Effect

LN_9 = math.log(9.0)

EFFECT = Effect(
    name='truth_driver_lag',
    port='actuation',
    equation='dP/dt = ln 9/t_r (J - P)',
    source='rise time of a first-order stage',
    parameters=(drawn_parameter('t_r', 's', 0.05, 1.5, 'rise time'),),
    stage='lag',
    states=('P',),
    scale=(0.5,),
    rate=lambda s, w, p, m: (LN_9 * (s.J - m.P) / p.t_r,),
    kernel=lambda s, w, p, m: m.P,
)
TRUTH = simulated_truth(
    EFFECT, library='driver_lag', variables=('J', 'memory'), listed=lambda p, of: {'tau': p['t_r'] / LN_9, 'rise': 0.0}
)
