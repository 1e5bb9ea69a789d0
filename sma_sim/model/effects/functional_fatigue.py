"""Functional fatigue: strain that stays behind grows with all transformation so far, and saturates.

dz/dt = |dx_M/dt|,   e = eps_r (1 - exp(-z/z_r))   [-]        z counts transformation: 2 for a full cycle
"""

import math

from sma_sim.model.effects.effect import Effect
from sma_sim.model.parameters import Parameter

EFFECT = Effect(
    name='functional_fatigue',
    port='wire_strain',
    equation='e = eps_r (1 - exp(-z/z_r)), dz/dt = |dx_M/dt|',
    source='Eggeler et al., Mater. Sci. Eng. A 378 (2004) 24; saturation: Lagoudas, Shape Memory Alloys, 5.2',
    parameters=(
        Parameter('eps_r', 3e-3, '-', (0.0, 0.1), 'strain that stays behind in the end', '', 0.0, (3e-4, 0.02)),
        Parameter('z_r', 5.0, '-', (1e-2, 1e6), 'transformation after which 63 % of it is there', '', None, (1.0, 1000.0)),
    ),
    states=('z',),
    scale=(1.0,),
    rate=lambda s, w, p, m: abs(s.dx),
    kernel=lambda s, w, p, m: p.eps_r * (1.0 - math.exp(-m.z / p.z_r)),
    energy='its work, Om sigma de/dt, leaves the balance: below eps_r/(z_r eps_T) of the latent heat',
    description='counts from the start of each run: a wire that is trained already has a small eps_r',
    signature='drift from cycle to cycle that never recovers and stops when nothing transforms; hidden on the plateaus',
    confused_with=('wire.l0', 'beam_creep', 'ambient_heating', 'pretension_mismatch'),
)
