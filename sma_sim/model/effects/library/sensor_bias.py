"""Offsets of the position sensors (of the load cell, on a wire).

shown = value + offset of the channel
"""

from sma_sim.model.effects.effect import Effect
from sma_sim.model.parameters import Parameter

EFFECT = Effect(
    name='sensor_bias',
    title='a constant offset of the sensors',
    port='sensing',
    stage='bias',
    channels=('U_x', 'U_y', 'alpha', 'stress'),
    equation='shown = value + offset',
    source='zero error of a sensor: JCGM 200, International Vocabulary of Metrology, 4.28',
    parameters=(
        Parameter('U_x', 1e-5, 'm', (-1.0, 1.0), 'offset of U_x', neutral=0.0, realistic=(-1e-4, 1e-4)),
        Parameter('U_y', 2e-4, 'm', (-1.0, 1.0), 'offset of U_y', neutral=0.0, realistic=(-2e-3, 2e-3)),
        Parameter('alpha', 0.01, 'rad', (-3.0, 3.0), 'offset of alpha', neutral=0.0, realistic=(-0.1, 0.1)),
        Parameter(
            'stress',
            2e6,
            'Pa',
            (-1e10, 1e10),
            'offset of the load cell over the section',
            neutral=0.0,
            realistic=(-2e7, 2e7),
        ),
    ),
    by_channel=True,
    kernel=lambda s, w, p: s.value + p.own,
    description='the motion itself is as modelled',
    signature='a constant error of the shown channel, at rest too; forces and temperatures agree',
    confused_with=(
        'gravity',
        'sensor_misalignment',
        'power_gain_mismatch',
        'sensor_gain',
        'wire.sigma_MW0',
        'sensor_drift',
        'sensor_jump',
    ),
)
