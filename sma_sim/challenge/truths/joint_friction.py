"""Dry friction in the joint, elastic before it slides (Dahl).

dz/dt = dalpha/dt - |dalpha/dt| z/z_c,   M = -M_c z/z_c   [N m]
"""

from sma_sim.challenge.truth import acting, ranged
from sma_sim.model.effects.effect import Effect

EFFECT = Effect(
    name='truth_joint_friction',
    port='structure_force',
    equation='dz/dt = dalpha/dt - |dalpha/dt| z/z_c; M = -M_c z/z_c',
    source='Dahl, AIAA Journal 14 (1976) 1675',
    parameters=(
        ranged('M_c', 'N m', 2e-3, 8e-3, 'sliding moment'),
        ranged('z_c', 'rad', 1e-4, 5e-4, 'angle over which sliding sets in'),
    ),
    states=('z',),
    scale=(1e-3,),
    rate=lambda s, b, p, m: (s.dalpha - abs(s.dalpha) * m.z / p.z_c,),
    kernel=lambda s, b, p, m: (0.0, 0.0, -p.M_c * m.z / p.z_c),
)
TRUTHS = (acting(EFFECT, library='joint_friction', variables=('dalpha', 'memory'), file=__file__),)
