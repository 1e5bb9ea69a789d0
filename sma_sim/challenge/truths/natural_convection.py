"""Buoyancy around a warm wire: the heat transfer coefficient grows with the temperature difference.

h = h_50 (|T - T_E|/50 K)^m (T_f/323 K)^0.8, T_f the mean of wire and air (conductivity of air), Q = -h A_s (T - T_E)   [W]
"""

from sma_sim.challenge.truth import drawn_parameter, simulated_truth
from sma_sim.model.effects.effect import Effect

EFFECT = Effect(
    name='truth_natural_convection',
    port='wire_heat',
    equation='Q = -h_50 (|T - T_E|/50)^m (T_f/323)^0.8 A_s (T - T_E)',
    source='free convection about horizontal cylinders; conductivity of air ~ T^0.8',
    parameters=(
        drawn_parameter('h_50', 'W/(m^2 K)', 30.0, 160.0, 'coefficient at 50 K above the air'),
        drawn_parameter('m', '-', 0.15, 0.33, 'exponent'),
    ),
    kernel=lambda s, w, p: (
        -p.h_50 * (abs(s.T - s.T_E) / 50.0) ** p.m * (0.5 * (s.T + s.T_E) / 323.0) ** 0.8 * w.surface * (s.T - s.T_E)
    ),
)
TRUTH = simulated_truth(
    EFFECT,
    library='natural_convection',
    variables=('T',),
    listed=lambda p, of: {'k': p['h_50'] / 50.0 ** p['m'], 'm': p['m']},
)
