"""Martensite begins to form gradually and turns back gradually: each stress rises with x_M in a way of its own.

shift of sigma_A = a (x_M^2 - 1/3),   shift of sigma_M = b (1/3 - (1 - x_M)^2)   [Pa]
"""

from sma_sim.challenge.truth import drawn_parameter, simulated_truth
from sma_sim.model.effects.effect import Effect

EFFECT = Effect(
    name='truth_smooth_transformation',
    port='transformation_stress',
    equation='shifts a (x_M^2 - 1/3) and b (1/3 - (1 - x_M)^2)',
    source='quadratic hardening, each way apart',
    parameters=(
        drawn_parameter('a', 'Pa', 8e6, 3e7, 'rise of sigma_A from the first to the last martensite'),
        drawn_parameter('b', 'Pa', 8e6, 3e7, 'fall of sigma_M while it turns back'),
    ),
    kernel=lambda s, w, p: (p.a * (s.x * s.x - 1.0 / 3.0), p.b * (1.0 / 3.0 - (1.0 - s.x) * (1.0 - s.x))),
    energy='latent heat at the shifted stress',
)
TRUTH = simulated_truth(
    EFFECT, library='smooth_transformation', variables=('x',), listed=lambda p, of: {'width_A': p['a'], 'width_M': p['b']}
)
