"""Dry friction in joints and rails: against the turning of a beam's plate, in the bearing of a lever, of a slider.

M = -M_c tanh((dalpha/dt)/w_s)   [N m, of a coordinate in m: N]        Coulomb friction, regularised: below w_s it creeps
"""

import math

from sma_sim.model.effects.effect import Effect
from sma_sim.model.parameters import Parameter

EFFECT = Effect(
    name='joint_friction',
    title='dry friction against the turning of the plate',
    general_title='dry friction of the joints',
    port='structure_force',
    needs=('joint',),
    equation='M = -M_c tanh((dalpha/dt)/w_s)',
    source='Coulomb friction: Olsson et al., European Journal of Control 4 (1998) 176',
    parameters=(
        Parameter(
            'M_c', 0.02, 'N m', (0.0, 100.0), 'moment of friction', neutral=0.0, realistic=(2e-3, 0.2), quantity='force'
        ),
        Parameter(
            'w_s',
            5e-3,
            'rad/s',
            (1e-5, 100.0),
            'speed at which friction is fully developed',
            realistic=(1e-3, 0.05),
            quantity='rate',
        ),
    ),
    kernel=lambda s, b, p: -p.M_c * math.tanh(s.dq / p.w_s),
    energy='dissipates M_c |dalpha/dt|; the heat goes into the joint, not into the wires',
    description='the same moment at every angle, always against the motion',
    signature='alpha lags behind at every reversal by the same angle, fast or slow; small commands move nothing',
    confused_with=('guide_friction', 'beam.b_alpha', 'wire.dsigma'),
)
