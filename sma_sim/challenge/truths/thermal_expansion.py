"""Thermal expansion with the coefficient of each phase.

e = (a_A (1 - x_M) + a_M x_M) (T - 298 K)   [-]
"""

from sma_sim.challenge.truth import drawn_parameter, simulated_truth
from sma_sim.model.effects.effect import Effect

EFFECT = Effect(
    name='truth_thermal_expansion',
    port='wire_strain',
    equation='e = (a_A (1 - x_M) + a_M x_M)(T - 298)',
    source='NiTi: 11e-6 1/K in austenite, 6.6e-6 1/K in martensite',
    parameters=(
        drawn_parameter('a_A', '1/K', 9e-6, 2e-5, 'coefficient of austenite'),
        drawn_parameter('a_M', '1/K', 5e-6, 1.2e-5, 'coefficient of martensite'),
    ),
    kernel=lambda s, w, p: (p.a_A * (1.0 - s.x) + p.a_M * s.x) * (s.T - 298.0),
    energy='does not enter',
)
TRUTH = simulated_truth(
    EFFECT,
    library='thermal_expansion',
    variables=('T', 'x'),
    listed=lambda p, of: {'a': p['a_A'], 'da': p['a_M'] - p['a_A'], 'T_ref': 298.0},
)
