"""Greased guides: they take a part of the force of a wire that pulls, and add one to that of a wire that is drawn out.

F_added = mu F v/sqrt(v^2 + v_c^2)   [N]
"""

import math

from sma_sim.challenge.truth import drawn_parameter, simulated_truth
from sma_sim.model.effects.effect import Effect

EFFECT = Effect(
    name='truth_guide_friction',
    port='wire_force',
    equation='F_added = mu F v/sqrt(v^2 + v_c^2)',
    source="Coulomb's law, smooth at rest",
    parameters=(
        drawn_parameter('mu', '-', 0.02, 0.2, 'part of the force that friction takes'),
        drawn_parameter('v_c', 'm/s', 1e-5, 2e-4, 'speed at which it is 71 % of that'),
    ),
    kernel=lambda s, w, p: p.mu * s.F * s.v / math.sqrt(s.v**2 + p.v_c**2),
)
TRUTH = simulated_truth(EFFECT, library='guide_friction', variables=('v', 'F'), listed=lambda p, of: {'mu': p['mu']})
