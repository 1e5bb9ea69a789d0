"""Friction in a joint that is greased: against the motion, and nearly the same at every speed but the slowest.

M = -M_c w/sqrt(w^2 + w_c^2), w = dalpha/dt   [N m]
"""

import math

from sma_sim.challenge.truth import drawn_parameter, simulated_truth
from sma_sim.model.effects.effect import Effect

EFFECT = Effect(
    name='truth_joint_friction',
    port='structure_force',
    equation='M = -M_c w/sqrt(w^2 + w_c^2), w = dalpha/dt',
    source="Coulomb's law, smooth at rest",
    parameters=(
        drawn_parameter('M_c', 'N m', 2e-3, 8e-3, 'moment of friction'),
        drawn_parameter('w_c', 'rad/s', 1e-3, 1e-2, 'speed at which it is 71 % of that'),
    ),
    kernel=lambda s, b, p: (0.0, 0.0, -p.M_c * s.dalpha / math.sqrt(s.dalpha**2 + p.w_c**2)),
)
TRUTH = simulated_truth(EFFECT, library='joint_friction', variables=('dalpha',), listed=lambda p, of: {'M_c': p['M_c']})
