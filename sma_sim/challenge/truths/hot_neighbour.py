"""A machine beside bundle 1 that runs now and then and warms it.

Q = q (1 + tanh(8 sin(2 pi t/period)))/2 into wire 1   [W per wire]
"""

import math

from sma_sim.challenge.truth import drawn_parameter, simulated_truth
from sma_sim.model.effects.effect import Effect

EFFECT = Effect(
    name='truth_hot_neighbour',
    port='wire_heat',
    equation='Q_1 = q (1 + tanh(8 sin(2 pi t/period)))/2',
    source='heat from outside with a duty cycle',
    parameters=(
        drawn_parameter('q', 'W', 0.01, 0.12, 'heat while it runs'),
        drawn_parameter('period', 's', 15.0, 45.0, 'period'),
    ),
    kernel=lambda s, w, p: (1.0 - s.wire) * p.q * 0.5 * (1.0 + math.tanh(8.0 * math.sin(2.0 * math.pi * s.t / p.period))),
)
TRUTH = simulated_truth(EFFECT, variables=('t', 'wire'))
