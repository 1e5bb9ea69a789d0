"""Bundles that get different shares of the commanded power.

J_1 -> sqrt(ratio) J_1,   J_2 -> J_2/sqrt(ratio)   [W]: the ratio of the two gains, with their geometric mean 1
Of three bundles or more each beyond the first has a gain of its own besides: J_i -> gain_i J_i/sqrt(ratio), i > 1.
"""

import math

from sma_sim.model.effects.effect import EachBundle, Effect
from sma_sim.model.parameters import Parameter

EFFECT = Effect(
    name='power_gain_mismatch',
    title='unequal heating of the bundles',
    port='actuation',
    stage='gain',
    equation='J_1 -> sqrt(ratio) J_1, J_i -> gain_i J_i/sqrt(ratio)',
    source='drivers or bundles of different resistance',
    parameters=(
        Parameter('ratio', 1.15, '-', (0.1, 10.0), 'gain of bundle 1 over the others', neutral=1.0, realistic=(0.7, 1.43)),
    ),
    each_bundle=(
        EachBundle(
            Parameter('gain', 1.0, '-', (0.1, 10.0), 'further gain of bundle', neutral=1.0, realistic=(0.7, 1.43)), 2, 3
        ),
    ),
    kernel=lambda s, w, p: s.J * math.sqrt(p.ratio) if s.wire < 0.5 else s.J * p.gain / math.sqrt(p.ratio),
    wires=2,
    description='a gain that two bundles have in common is absorbed by c_V, lambda and latent heat',
    signature='one side reaches further and faster than the other under mirrored commands; agrees at rest',
    confused_with=('gravity', 'sensor_bias'),
)
