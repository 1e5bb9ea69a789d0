"""A harness that runs over a toothed guide: a moment that is periodic in the angle.

M = -M_0 sin(2 pi (alpha - alpha_0)/period)   [N m]
"""

import math

from sma_sim.challenge.truth import drawn_parameter, simulated_truth
from sma_sim.model.effects.effect import Effect

EFFECT = Effect(
    name='truth_harness_ripple',
    port='structure_force',
    equation='M = -M_0 sin(2 pi (alpha - alpha_0)/period)',
    source='detents of a cable guide',
    parameters=(
        drawn_parameter('M_0', 'N m', 8e-4, 3e-3, 'amplitude'),
        drawn_parameter('period', 'rad', 0.05, 0.12, 'distance of the teeth'),
        drawn_parameter('alpha_0', 'rad', -0.05, 0.05, 'a tooth'),
    ),
    kernel=lambda s, b, p: (0.0, 0.0, -p.M_0 * math.sin(2.0 * math.pi * (s.alpha - p.alpha_0) / p.period)),
)
TRUTH = simulated_truth(EFFECT, variables=('alpha',))
