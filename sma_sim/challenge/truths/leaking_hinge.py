"""A hinge with hysteresis that leaks: a friction element whose moment fades at rest.

dz/dt = dalpha/dt - |dalpha/dt| z/z_c - z/tau,   M = -M_c z/z_c   [N m]
"""

from sma_sim.challenge.truth import drawn_parameter, simulated_truth
from sma_sim.model.effects.effect import Effect

EFFECT = Effect(
    name='truth_leaking_hinge',
    port='structure_force',
    equation='dz/dt = dalpha/dt - |dalpha/dt| z/z_c - z/tau; M = -M_c z/z_c',
    source='Bouc-Wen element with relaxation',
    parameters=(
        drawn_parameter('M_c', 'N m', 5e-4, 8e-3, 'largest moment'),
        drawn_parameter('z_c', 'rad', 3e-3, 2e-2, 'angle over which it builds up'),
        drawn_parameter('tau', 's', 3.0, 20.0, 'time in which it fades'),
    ),
    states=('z',),
    scale=(1e-2,),
    rate=lambda s, b, p, m: (s.dalpha - abs(s.dalpha) * m.z / p.z_c - m.z / p.tau,),
    kernel=lambda s, b, p, m: (0.0, 0.0, -p.M_c * m.z / p.z_c),
)
TRUTH = simulated_truth(EFFECT, variables=('dalpha', 'memory'))
