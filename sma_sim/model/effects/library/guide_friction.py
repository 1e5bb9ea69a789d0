"""Friction where the wires pass their guides (belt friction).

F_added = F (exp(mu tanh(v/v_s)) - 1)   [N]: the structure feels more when the wire is drawn out, less when it pulls.
"""

import math

from sma_sim.model.effects.effect import Effect
from sma_sim.model.parameters import Parameter

EFFECT = Effect(
    name='guide_friction',
    title='friction of the wires in their guides',
    port='wire_force',
    equation='F_added = F (exp(mu tanh(v/v_s)) - 1)',
    source='Euler-Eytelwein equation with a regularised Coulomb law',
    parameters=(
        Parameter('mu', 0.05, '-', (0.0, 3.0), 'friction coefficient times wrap angle', neutral=0.0, realistic=(0.01, 0.5)),
        Parameter('v_s', 1e-4, 'm/s', (1e-7, 1.0), 'speed at which friction is fully developed', realistic=(1e-5, 1e-3)),
    ),
    kernel=lambda s, w, p: s.F * (math.exp(p.mu * math.tanh(s.v / p.v_s)) - 1.0),
    tried='timed',
    straight=True,
    energy='dissipates F (exp(mu) - 1) |v| or less; the heat goes into the guide, not into the wire',
    description='the structure feels less of a wire that pulls, more of one that is drawn out',
    signature='hysteresis of the pose that does not depend on temperature but on force; seen at each reversal',
    confused_with=('joint_friction', 'beam.b_alpha', 'wire.dsigma', 'latent_heat_scale'),
)
