"""Bundles that get different shares of the commanded power.

J_1 -> sqrt(ratio) J_1,   J_2 -> J_2/sqrt(ratio)   [W]: the ratio of the two gains, with their geometric mean 1
"""

import math

from sma_sim.model.effects.effect import Effect
from sma_sim.model.parameters import Parameter

EFFECT = Effect(
    name='power_gain_mismatch',
    title='unequal heating of the two bundles',
    port='actuation',
    stage='gain',
    equation='J_1 -> sqrt(ratio) J_1, J_2 -> J_2/sqrt(ratio)',
    source='two drivers or two bundles of different resistance',
    parameters=(Parameter('ratio', 1.15, '-', (0.1, 10.0), 'gain of bundle 1 over bundle 2', '', 1.0, (0.7, 1.43)),),
    kernel=lambda s, w, p: s.J * math.sqrt(p.ratio) if s.wire < 0.5 else s.J / math.sqrt(p.ratio),
    wires=2,
    description='a gain that both have in common is absorbed by c_V, lambda and latent heat',
    signature='one side reaches further and faster than the other under mirrored commands; agrees at rest',
    confused_with=('gravity', 'sensor_bias'),
)
