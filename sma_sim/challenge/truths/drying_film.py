"""A film of moisture that boils off near one temperature and comes back below it.

Q = -q exp(-((T - T_d)/5 K)^2)   [W]
"""

import math

from sma_sim.challenge.truth import drawn_parameter, simulated_truth
from sma_sim.model.effects.effect import Effect

EFFECT = Effect(
    name='truth_drying_film',
    port='wire_heat',
    equation='Q = -q exp(-((T - T_d)/5)^2)',
    source='heat of evaporation in a band of temperature',
    parameters=(
        drawn_parameter('q', 'W', 0.02, 0.25, 'largest heat per wire'),
        drawn_parameter('T_d', 'K', 310.0, 330.0, 'temperature at which it boils off'),
    ),
    kernel=lambda s, w, p: -p.q * math.exp(-(((s.T - p.T_d) / 5.0) ** 2)),
)
TRUTH = simulated_truth(EFFECT, variables=('T',))
