"""A beam of plastic that the wires warm, and that is softer when warm.

tau dtheta/dt = (T_1 + T_2)/2 - T_E - theta,   F = c theta K q   [N, N, N m]: stiffness K (1 - c theta)
"""

from sma_sim.challenge.truth import drawn_parameter, simulated_truth
from sma_sim.model.effects.effect import Effect
from sma_sim.model.structures.beam import stiffness_forces

EFFECT = Effect(
    name='truth_warm_beam',
    port='structure_force',
    equation='F = c theta K q; tau dtheta/dt = (T_1 + T_2)/2 - T_E - theta',
    source='modulus of thermoplastics falls by 0.2 to 1 % per kelvin',
    parameters=(
        drawn_parameter('c', '1/K', 1e-3, 8e-3, 'part of the stiffness lost per kelvin'),
        drawn_parameter('tau', 's', 3.0, 30.0, 'time constant of the temperature of the beam'),
    ),
    states=('theta',),
    scale=(10.0,),
    rate=lambda s, b, p, m: ((0.5 * (s.T + s.T_other) - s.T_E - m.theta) / p.tau,),
    kernel=lambda s, b, p, m: stiffness_forces(s.U_x, s.U_y, s.alpha, b, p.c * m.theta),
)
TRUTH = simulated_truth(EFFECT, variables=('alpha', 'T', 'memory'))
