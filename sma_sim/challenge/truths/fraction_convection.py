"""Wires that lie against their guide while they are martensite: they lose more heat then.

Q = -h A_s x_M (T - T_E)   [W]
"""

from sma_sim.challenge.truth import drawn_parameter, simulated_truth
from sma_sim.model.effects.effect import Effect

EFFECT = Effect(
    name='truth_fraction_convection',
    port='wire_heat',
    equation='Q = -h A_s x_M (T - T_E)',
    source='contact with a heat sink that depends on the phase',
    parameters=(drawn_parameter('h', 'W/(m^2 K)', 30.0, 300.0, 'coefficient that martensite adds'),),
    kernel=lambda s, w, p: -p.h * w.surface * s.x * (s.T - s.T_E),
)
TRUTH = simulated_truth(EFFECT, variables=('x', 'T'))
