"""A driver that keeps the power P_q for itself: what is commanded below it does not arrive, nor does that part above it.

P = max(J_bundle - P_q, 0)/n   [W]
"""

from sma_sim.challenge.truth import drawn_parameter, simulated_truth
from sma_sim.model.effects.effect import Effect

EFFECT = Effect(
    name='truth_driver_deadband',
    port='actuation',
    equation='P = max(n J - P_q, 0)/n',
    source='idle power of a power stage',
    parameters=(drawn_parameter('P_q', 'W', 0.1, 1.5, 'power of the bundle that is lost'),),
    stage='deadband',
    kernel=lambda s, w, p: max(w.n * s.J - p.P_q, 0.0) / w.n,
)
TRUTH = simulated_truth(
    EFFECT, library='driver_deadband', variables=('J',), listed=lambda p, of: {'J_d': p['P_q'] / of['wire.n']}
)
