"""A room that is heated: the air about the wires is warmer by a number of kelvins at the end of 100 s, evenly.

Q = h P l0 (theta - T_E) with the perimeter P = 2 sqrt(pi section) and theta = T_E + rise t/100 s   [W]
"""

import math

from sma_sim.challenge.truth import drawn_parameter, simulated_truth
from sma_sim.model.effects.effect import Effect

PERIOD = 100.0  # [s]

EFFECT = Effect(
    name='truth_ambient_drift',
    port='wire_heat',
    equation='Q = h P l0 rise t/100 s',
    source='heat balance of a room that takes a constant power',
    parameters=(drawn_parameter('rise', 'K', 0.3, 5.0, 'temperature by which the room warms in 100 s'),),
    kernel=lambda s, w, p: w.lambda_ * 2.0 * math.sqrt(math.pi * w.section) * w.l0 * p.rise * s.t / PERIOD,
)
TRUTH = simulated_truth(
    EFFECT, library='ambient_drift', variables=('t',), listed=lambda p, of: {'c': p['rise'] / PERIOD}, signed=('rise',)
)
