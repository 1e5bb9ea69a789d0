"""A supply that gives way at high power.

P = J/(1 + (n J/P_max)^4)^(1/4)   [W]
"""

from sma_sim.challenge.truth import drawn_parameter, simulated_truth
from sma_sim.model.effects.effect import Effect

EFFECT = Effect(
    name='truth_supply_limit',
    port='actuation',
    equation='P = J/(1 + (n J/P_max)^4)^(1/4)',
    source='soft current limit',
    parameters=(drawn_parameter('P_max', 'W', 8.0, 16.0, 'power of a bundle that is never exceeded'),),
    stage='saturation',
    kernel=lambda s, w, p: s.J / (1.0 + (w.n * s.J / p.P_max) ** 4) ** 0.25,
)
TRUTH = simulated_truth(
    EFFECT, library='driver_saturation', variables=('J',), listed=lambda p, of: {'r': of['wire.n'] / p['P_max'], 'p': 2.0}
)
