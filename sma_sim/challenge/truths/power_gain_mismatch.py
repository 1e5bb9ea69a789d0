"""The leads of bundle 2 have more resistance than those of bundle 1, and take their part of the power.

P_2 = J_2/(1 + r), P_1 = J_1   [W], r the resistance of the leads over that of the wires
"""

from sma_sim.challenge.truth import drawn_parameter, simulated_truth
from sma_sim.model.effects.effect import Effect

EFFECT = Effect(
    name='truth_power_gain_mismatch',
    port='actuation',
    equation='P_1 = J_1; P_2 = J_2/(1 + r)',
    source='voltage divider, driven by power',
    parameters=(drawn_parameter('r', '-', 0.01, 0.15, 'excess resistance of the leads over that of the wires'),),
    stage='gain',
    kernel=lambda s, w, p: s.J / (1.0 + p.r * s.wire),
)
TRUTH = simulated_truth(
    EFFECT, library='power_gain_mismatch', variables=('J', 'wire'), listed=lambda p, of: {'ratio': 1.0 + p['r']}
)
