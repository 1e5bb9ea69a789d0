"""A battery that sags during the run.

P = J (1 - s (1 - exp(-t/tau)))   [W]
"""

import math

from sma_sim.challenge.truth import drawn_parameter, simulated_truth
from sma_sim.model.effects.effect import Effect

EFFECT = Effect(
    name='truth_supply_sag',
    port='actuation',
    equation='P = J (1 - sag (1 - exp(-t/tau)))',
    source='discharge of a battery',
    parameters=(
        drawn_parameter('sag', '-', 0.03, 0.3, 'part of the power that is lost in the end'),
        drawn_parameter('tau', 's', 15.0, 60.0, 'time constant'),
    ),
    stage='gain',
    kernel=lambda s, w, p: s.J * (1.0 - p.sag * (1.0 - math.exp(-max(s.t, 0.0) / p.tau))),
)
TRUTH = simulated_truth(EFFECT, variables=('t', 'J'))
