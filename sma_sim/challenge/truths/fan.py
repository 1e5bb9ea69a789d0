"""A fan that switches on during the run.

Q = -h A_s (T - T_E) (1 + tanh((t - t_on)/0.3 s))/2   [W]
"""

import math

from sma_sim.challenge.truth import drawn_parameter, simulated_truth
from sma_sim.model.effects.effect import Effect

EFFECT = Effect(
    name='truth_fan',
    port='wire_heat',
    equation='Q = -h A_s (T - T_E) (1 + tanh((t - t_on)/0.3))/2',
    source='forced convection from an instant on',
    parameters=(
        drawn_parameter('h', 'W/(m^2 K)', 30.0, 250.0, 'coefficient that the fan adds'),
        drawn_parameter('t_on', 's', 20.0, 70.0, 'instant, counted from the beginning of the run'),
    ),
    kernel=lambda s, w, p: -p.h * w.surface * (s.T - s.T_E) * 0.5 * (1.0 + math.tanh((s.t - p.t_on) / 0.3)),
)
TRUTH = simulated_truth(EFFECT, variables=('t', 'T'))
