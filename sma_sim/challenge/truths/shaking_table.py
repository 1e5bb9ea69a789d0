"""The table shakes: a periodic force across the beam.

F_y = F_0 sin(2 pi f t)   [N]
"""

import math

from sma_sim.challenge.truth import drawn_parameter, simulated_truth
from sma_sim.model.effects.effect import Effect

EFFECT = Effect(
    name='truth_shaking_table',
    port='structure_force',
    equation='F_y = F_0 sin(2 pi f t)',
    source='inertia of the plate on a moving base',
    parameters=(
        drawn_parameter('F_0', 'N', 0.02, 0.15, 'amplitude'),
        drawn_parameter('f', 'Hz', 0.05, 0.5, 'frequency'),
    ),
    kernel=lambda s, b, p: (0.0, p.F_0 * math.sin(2.0 * math.pi * p.f * s.t), 0.0),
)
TRUTH = simulated_truth(EFFECT, variables=('t',))
